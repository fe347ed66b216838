"""Gridding beside other programs: processor time, alternately, and memory."""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.bench.measuring import (
    DATA,
    FEW,
    ROOT,
    command_seconds,
    folder,
    say,
    toolbox,
)
from tests.bench.peers import GDAL, GRIDDATA, MEASURED, OURS, PEERS
from tests.bench.speed import SIZES, survey

METHODS = ("mean", "nearest", "idw", "linear", "natural", "cubic")


def gridding() -> None:
    """surface.grid beside other programs: processor time, alternately, and memory.

    LIDAR_PEERS may name a Python in which scipy, startinpy, verde and matplotlib are installed.
    """
    import numpy as np

    with folder() as out:
        xyz = _in_metres()
        for step in (1, 5):
            np.save(out / f"{step}.npy", xyz[::step])
        for method, name, program, bar, aim, step in PEERS:
            for cell in (1.0, 0.5):
                found = [
                    [_measured(code, out / f"{step}.npy", cell, peer) for code, peer in pair]
                    for pair in [((OURS.format(method), False), (program, True))] * FEW
                ]
                if not all(map(all, found)):
                    say(f"gridding {method:8} {name}: not installed")
                    break
                _say_ratio(method, name, bar, aim, found)
        for method in METHODS:
            _memory_of(f"ours {method}", OURS.format(method), out / "5.npy", peer=False)
        for method in ("linear", "cubic"):
            _memory_of(f"griddata {method}", GRIDDATA.format(method), out / "5.npy", peer=True)
        _growth(out)
        _beside_gdal_grid(xyz, out)
        _beside_floor(out)


def _in_metres() -> Any:
    """Five million points of a survey."""
    from toolbox.data import PointCloud

    cloud = PointCloud.open(DATA / "autzen_ept/autzen_south_5M.laz")
    return cloud.xyz / cloud.metre


def _measured(code: str, points: Path, cell: float, peer: bool) -> dict[str, float] | None:
    """What a program took; None if it is not installed."""
    python = os.environ.get("LIDAR_PEERS", sys.executable) if peer else sys.executable
    done = subprocess.run(
        [python, "-c", MEASURED.format(code), str(points), str(cell)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    if "ModuleNotFoundError" in done.stderr:
        return None
    if done.returncode:
        raise RuntimeError(done.stderr)
    return dict(json.loads(done.stdout))


def _say_ratio(method: str, name: str, bar: float, aim: float, found: list[Any]) -> None:
    cpu, wall = (
        [statistics.median(row[i][clock] for row in found) for i in (0, 1)]
        for clock in ("cpu", "wall")
    )
    points, cells = (found[0][0][what] / 1e6 for what in ("points", "cells"))
    peaks = [found[0][i]["peak"] / 2**20 for i in (0, 1)]
    say(
        f"gridding {method:8} {points:.1f} M points, {cells:.1f} M cells: {cpu[0]:6.2f} CPU s, "
        f"{name} {cpu[1]:6.2f}, ratio {cpu[1] / cpu[0]:5.1f} (bar {bar}, aim {aim}); seconds "
        f"{wall[0]:.2f}, {wall[1]:.2f}, ratio {wall[1] / wall[0]:.1f}; MiB "
        f"{peaks[0]:.0f}, {peaks[1]:.0f}"
    )


def _memory_of(name: str, code: str, points: Path, *, peer: bool) -> None:
    """Bytes at the peak beyond the points, per point and per cell."""
    coarse, fine = (_measured(code, points, cell, peer) for cell in (4.0, 0.5))
    if coarse is None or fine is None:
        say(f"gridding memory {name}: not installed")
        return
    per_cell = (fine["peak"] - coarse["peak"]) / (fine["cells"] - coarse["cells"])
    per_point = (coarse["peak"] - per_cell * coarse["cells"]) / coarse["points"]
    say(f"gridding memory {name:16} {per_point:5.0f} bytes per point, {per_cell:3.0f} per cell")


def _growth(out: Path) -> None:
    """Processor time per point of a survey that grows at its own density."""
    import numpy as np

    from toolbox.data import PointCloud

    for millions in SIZES:
        survey(millions, out / "survey.laz")
        cloud = PointCloud.open(out / "survey.laz")
        np.save(out / f"{millions} M.npy", cloud.xyz / cloud.metre)
    for method in METHODS:
        spent = []
        for millions in SIZES:
            found = _measured(OURS.format(method), out / f"{millions} M.npy", 1.0, peer=False)
            assert found
            spent.append(found["cpu"] / found["points"] * 1e6)
        sizes = ", ".join(f"{s:.2f} at {m} M" for s, m in zip(spent, SIZES, strict=True))
        say(f"gridding growth {method:8} CPU s per M points: {sizes}; {spent[-1] / spent[0]:.2f}")


def _beside_gdal_grid(xyz: Any, out: Path) -> None:
    """Whole commands, processor time; gdal_grid reads text, which it takes best, and we LAZ."""
    if not shutil.which("gdal_grid"):
        say("gridding gdal_grid is not installed")
        return
    cloud = DATA / "autzen_ept/autzen_south_5M.laz"
    _write_text(xyz, out / "p.csv")
    (west, south, _), (east, north, _) = xyz.min(axis=0), xyz.max(axis=0)
    edges = ["-txe", west, east, "-tye", north, south]
    command = ["gdal_grid", "-q", "--config", "GDAL_NUM_THREADS", "ALL_CPUS", *edges]

    def theirs(algorithm: str, cell: float) -> float:
        size = ["-outsize", *(max(1, round(d / cell)) for d in (east - west, north - south))]
        files = ["-l", "p", out / "p.vrt", out / "g.tif"]
        return command_seconds([*command, *size, "-a", algorithm, *files])

    reading = theirs("average", 1e6)  # into a single cell
    say(f"gridding gdal_grid reads the points in {reading:.1f} CPU s")
    for method, (algorithm, bar, aim) in GDAL.items():
        for cell in (1.0, 0.5):
            options = ["--points", cloud, "--method", method, "--cell", cell, "--json"]
            done = [
                (
                    toolbox("run", "surface.grid", *options, "--surface", out / f"{n}{cell}.tif"),
                    theirs(algorithm, cell),
                )
                for n in range(FEW)
            ]
            ours, other = (
                statistics.median(column)
                for column in zip(*((row[0]["cpu"], row[1]) for row in done), strict=True)
            )
            inside = _measured(OURS.format(method), out / "1.npy", cell, peer=False)
            assert inside
            say(
                f"gridding {method:8} cells of {cell} m: command {ours:.1f} CPU s, gdal_grid "
                f"{other:.1f}, ratio {other / ours:.1f} (bar {bar}, aim {aim}); interpolation "
                f"{inside['cpu']:.1f}, {other - reading:.1f}, "
                f"ratio {(other - reading) / inside['cpu']:.1f}"
            )


def _beside_floor(out: Path) -> None:
    """Each method as one command, and what no program can do without: read, sort, write."""
    path = DATA / "autzen_ept/autzen_south_5M.laz"
    code = (
        "import sys, time, laspy, numpy as np, rasterio\n"
        "def lap(name, work, start=time.process_time):\n"
        "    begin = start(); found = work(); print(name, start() - begin); return found\n"
        "xyz = lap('reading', lambda: laspy.read(sys.argv[1]).xyz)\n"
        "lap('sorting', lambda: xyz[np.argsort(xyz[:, 0])])\n"
        "values = np.random.default_rng(0).normal(100, 5, (1354, 2044)).astype('float32')\n"
        "how = dict(driver='GTiff', dtype='float32', count=1, width=2044, height=1354,\n"
        "           compress='deflate', predictor=3)\n"
        "lap('writing', lambda: rasterio.open(sys.argv[2], 'w', **how).write(values, 1))\n"
    )
    command = [sys.executable, "-W", "ignore", "-c", code, str(path), str(out / "floor.tif")]
    lines = subprocess.check_output(command, text=True, cwd=ROOT).split("\n")
    floor = {line.split()[0]: float(line.split()[1]) for line in lines if line}
    total = sum(floor.values())
    parts = ", ".join(f"{name} {seconds:.1f}" for name, seconds in floor.items())
    say(f"gridding floor {total:.1f} CPU s: {parts}")
    for method in METHODS:
        options = ["--points", path, "--method", method, "--cell", 0.5, "--json"]
        seconds = toolbox("run", "surface.grid", *options, "--surface", out / f"{method}.tif")
        say(
            f"gridding floor {method:8} {seconds['cpu']:.1f} CPU s, "
            f"{seconds['cpu'] / total:.1f} times the floor"
        )


def _write_text(xyz: Any, path: Path) -> None:
    import numpy as np

    np.savetxt(path, xyz, "%.3f", delimiter=",", header="x,y,z", comments="")
    path.with_suffix(".vrt").write_text(
        f"""<OGRVRTDataSource><OGRVRTLayer name="{path.stem}">
        <SrcDataSource>{path}</SrcDataSource><GeometryType>wkbPoint25D</GeometryType>
        <GeometryField encoding="PointFromColumns" x="x" y="y" z="z"/>
        </OGRVRTLayer></OGRVRTDataSource>"""
    )
