"""Tools by themselves, how they grow, and beside Open3D."""

from __future__ import annotations

import statistics
import time
from pathlib import Path

from tests.bench.ground import ground_filters
from tests.bench.measuring import DATA, alternately, folder, say, timed, toolbox

SIZES = (1, 5, 10)  # millions of points


def speed() -> None:
    """Tools by themselves, filters beside laspy's reading, and denoise beside Open3D."""
    _command_line()
    _growth()
    _beside_open3d()


def _command_line() -> None:
    """Seconds per million points, reading and writing included."""
    path = DATA / "autzen_ept/autzen_south_5M.laz"
    with folder() as out:
        runs = {
            "ground.csf": ["--cloth_resolution", "1", "--classified", out / "a.laz"],
            "points.filter": ["--classes", "2", "--kept", out / "b.laz"],
            "surface.grid": ["--cell", "1", "--surface", out / "c.tif"],
            "points.info": [],
        }
        for id, arguments in runs.items():
            found = toolbox("run", id, "--points", path, *arguments, "--json")
            say(
                f"speed    {id:28} {found['seconds'] / 5.05:.2f} s, "
                f"{found['cpu'] / 5.05:.2f} CPU s per million points (exit {found['code']})"
            )


def _growth() -> None:
    """Processor time of the filters beside that of laspy's reading, and how it grows."""
    import laspy

    from algorithms.points.denoise import PointsDenoise
    from toolbox.data import PointCloud

    makes = ground_filters() | {"points.denoise": PointsDenoise}
    seconds: dict[str, list[float]] = {id: [] for id in makes}
    with folder() as out:
        for millions in SIZES:
            path = out / f"{millions}.laz"
            survey(millions, path)
            cloud, count = PointCloud.open(path), laspy.read(path).header.point_count / 1e6
            reading = statistics.median(
                timed(lambda path=path: laspy.read(path).xyz, time.process_time)  # type: ignore[misc]
                for _ in range(3)
            )
            for id, make in makes.items():
                make(points=cloud.select(range(50_000))).run()  # compiles
                seconds[id].append(timed(make(points=cloud).run, time.process_time) / count)
                say(
                    f"speed    {id:28} {count:5.2f} M points: {seconds[id][-1]:.2f} CPU s "
                    f"per million, {seconds[id][-1] * count / reading:.1f} times reading"
                )
    for id, found in seconds.items():
        growth = found[-1] / found[0]
        say(f"speed    {id:28} per point, {SIZES[-1]} M over {SIZES[0]} M: {growth:.2f}")


def survey(millions: int, path: Path) -> None:
    """Write the west of two copies of a survey side by side, at its own density."""
    import laspy
    import numpy as np

    las = laspy.read(DATA / "autzen_ept/autzen_south_5M.laz")
    west, count = las.points.array, millions * 1_000_000
    east = west.copy()
    east["X"] += np.ptp(west["X"]) + 1
    both = np.concatenate([west, east])
    both = both[both["X"] <= np.partition(both["X"], count - 1)[count - 1]]
    scales, offsets = las.header.scales, las.header.offsets
    las.points = laspy.ScaleAwarePointRecord(both, las.point_format, scales, offsets)
    las.write(path)


def _beside_open3d() -> None:
    """Statistical outlier removal of 5 M points with 20 neighbours, in processor time."""
    from algorithms.points.denoise import noise
    from toolbox.data import PointCloud

    try:
        import open3d  # type: ignore[import-not-found]
    except ImportError:
        say("speed    Open3D is not installed")
        return
    cloud = PointCloud.open(DATA / "autzen_ept/autzen_south_5M.laz")
    xyz, metre = cloud.xyz, cloud.metre
    theirs = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(xyz.copy()))
    for scope in ("local", "classic"):
        our_seconds, their_seconds = alternately(
            lambda scope=scope: noise(xyz, scope=scope, reach=20 * metre, height_gap=100 * metre),  # type: ignore[misc]
            lambda: theirs.remove_statistical_outlier(21, 5.0),  # it counts the point itself
            *(3, time.process_time),
        )
        say(
            f"speed    points.denoise {scope:7} {our_seconds:.1f} CPU s, Open3D "
            f"{their_seconds:.1f} CPU s, ratio {their_seconds / our_seconds:.2f}"
        )
