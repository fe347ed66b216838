"""Starting, reading, writing, and files that are odd or damaged."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from functools import partial
from typing import Any

from tests.bench.measuring import DATA, PEAK, ROOT, ROUNDS, alternately, folder, say, toolbox


def startup() -> None:
    """Wall time of the verbs that must answer at once; aim below 0.3 s."""
    for arguments in (["list"], ["describe", "ground.csf"], ["run", "ground.csf", "--help"]):
        seconds = statistics.median(toolbox(*arguments)["seconds"] for _ in range(ROUNDS))
        say(f"startup  {' '.join(arguments):24} {seconds:.3f} s")


def reading() -> None:
    """Reading and writing LAZ against plain laspy; aims 1.15 and 1.25."""
    import laspy

    from toolbox.data import PointCloud

    path = DATA / "autzen_ept/autzen_south_5M.laz"
    ours, theirs = alternately(lambda: PointCloud.open(path).xyz, lambda: laspy.read(path).xyz)
    say(f"reading  {ours:.2f} s, laspy {theirs:.2f} s, ratio {ours / theirs:.2f}")
    cloud, las = PointCloud.open(path), laspy.read(path)
    with folder() as out:
        ours, theirs = alternately(
            lambda: cloud.save(out / "a.laz", overwrite=True), lambda: las.write(out / "b.laz")
        )
    say(f"writing  {ours:.2f} s, laspy {theirs:.2f} s, ratio {ours / theirs:.2f}")


def copc() -> None:
    """Writing COPC against LAZ of the same points, CPU time; and a bounds query of 1 %."""
    import numpy as np

    from toolbox.data import PointCloud

    def cpu(work: Any) -> float:
        start = time.process_time()
        work()
        return time.process_time() - start

    with folder() as out:
        PointCloud.open(DATA / "autzen_ept/autzen_south_5M.laz").save(out / "a.copc.laz")
        cloud = PointCloud.open(out / "a.copc.laz")  # in a point format that COPC has
        cloud = cloud.select(np.argsort(cloud["gps_time"], kind="stable"))
        names = ("a.laz", "a.copc.laz")
        pairs = [
            [cpu(partial(cloud.save, out / name, overwrite=True)) for name in names]
            for _ in range(ROUNDS)
        ]
        plain, tree = (statistics.median(times) for times in zip(*pairs, strict=True))
        sizes = [(out / name).stat().st_size / len(cloud) for name in names]
        say(
            f"copc     {tree:.2f} s of CPU, LAZ {plain:.2f} s, ratio {tree / plain:.1f}; "
            f"{sizes[1]:.2f} bytes per point, LAZ {sizes[0]:.2f}"
        )
        low, high = np.reshape(cloud.bounds, (2, 3))[:, :2]
        box = (*(low + 0.4 * (high - low)), *(low + 0.5 * (high - low)))
        near, whole = (
            cpu(lambda name=name: PointCloud.open(out / name, bounds=box))
            for name in ("a.copc.laz", "a.laz")
        )
        say(f"copc     a hundredth of the area in {near:.2f} s of CPU, of LAZ {whole:.2f} s")


def reprojecting() -> None:
    """Reprojecting points against pyproj alone, CPU time; aim 1.2."""
    import numpy as np
    from pyproj import CRS, Transformer

    from algorithms.points.reproject import PointsReproject
    from toolbox.data import PointCloud

    cloud = PointCloud.open(DATA / "autzen_ept/autzen_south_5M.laz")
    x, y = np.ascontiguousarray(cloud.xyz[:, 0]), np.ascontiguousarray(cloud.xyz[:, 1])
    alone = Transformer.from_crs(cloud.crs, 32610, always_xy=True)
    job = PointsReproject(points=cloud, crs=CRS(32610))
    pairs = []
    for _ in range(ROUNDS):
        start = time.process_time()
        alone.transform(x, y)
        middle = time.process_time()
        job.run()
        pairs.append((middle - start, time.process_time() - middle))
    theirs, ours = (statistics.median(times) for times in zip(*pairs, strict=True))
    say(f"reproject {len(cloud):,} points {ours:.2f} s of CPU, pyproj alone {theirs:.2f} s, ")
    say(f"          ratio {ours / theirs:.2f}")


def memory() -> None:
    """Peak memory per point of reading with coordinates, in processes of their own."""
    path = DATA / "autzen_ept/autzen_south_5M.laz"
    code = f"import sys; {{}}; print({PEAK})"
    opened = "from toolbox.data import PointCloud; c = PointCloud.open(sys.argv[1]); c.xyz"
    plain = "import laspy; c = laspy.read(sys.argv[1]); xyz = c.xyz"
    small = DATA / "feet/autzen_trim.laz"
    for name, work in [("ours", opened), ("laspy", plain)]:
        peaks = [
            int(subprocess.check_output([sys.executable, "-c", code.format(work), file], cwd=ROOT))
            for file in (path, small)
        ]
        grown = 1024 * (peaks[0] - peaks[1]) / (5_050_000 - 110_000)
        say(f"memory   {name:6} {peaks[0] / 1024:.0f} MiB at the peak, {grown:.0f} bytes per point")


def damaged() -> None:
    """Every odd or damaged file: outcome, seconds and the memory of the process."""
    for path in sorted((DATA / "robustness").glob("*.la[sz]")):
        code = (
            "import sys\nfrom toolbox.cli.main import main\n"
            "code = main(['info', sys.argv[1], '--json'])\n"
            f"print({PEAK} // 1024, code, file=sys.stderr)"
        )
        start = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-c", code, str(path)],
            capture_output=True,
            text=True,
            cwd=ROOT,
            check=False,
        )
        *messages, last = done.stderr.strip().splitlines()
        points = next(
            (r["value"] for r in json.loads(done.stdout or "[]") if r["property"] == "points"), "-"
        )
        mib, exit_code = last.split()
        note = messages[0][:90] if messages else ""
        say(
            f"damaged  {path.name:32} exit {exit_code}  {points:>6} points  "
            f"{time.perf_counter() - start:.1f} s  {mib} MiB  {note}"
        )
