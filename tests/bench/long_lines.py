"""Long power lines, whole model: memory of all processes together, and processor time."""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from tests.bench.measuring import DATA, ROOT, folder, say

COPIES = (15, 29)  # of two tiles in turn: 12.2 and 23.4 million points
GAP = 200.0  # metres between them
OUTPUTS = {
    "classified": "c.laz",
    "wires": "w.gpkg",
    "towers": "t.gpkg",
    "violations": "v.laz",
    "objects": "o.gpkg",
    "spans": "s.csv",
    "report": "r.html",
}
WAYS: dict[str, tuple[Any, ...]] = {
    "in tiles": ("--tile", 1000, "--workers", 2, "--memory", "4GB"),
    "in one piece": (),
}


def long_lines() -> None:
    """models.power_line_clearance on rows of the tiles of AHN4, all outputs."""
    for copies in COPIES:
        with folder() as work:
            count = row_of_tiles(copies, work / "survey")
            for way, options in WAYS.items():
                (work / way).mkdir()
                paths = [(f"--{name}", work / way / file) for name, file in OUTPUTS.items()]
                peak, cpu = measured(
                    "run",
                    "models.power_line_clearance",
                    "--points",
                    work / "survey",
                    *options,
                    *(word for pair in paths for word in pair),
                )
                say(
                    f"long line {count / 1e6:5.1f} M points, {way:12}  {peak / 1e9:.2f} GB  "
                    f"{cpu:.0f} CPU s"
                )


def row_of_tiles(copies: int, place: Path) -> int:
    """Write unlabelled copies of two tiles in a row to the north; gives the number of points."""
    import numpy as np
    from pyproj import CRS

    from toolbox.data import PointCloud

    names = ("12BZ1_21", "12AN2_20")
    tiles = [PointCloud.open(DATA / f"powerline_ahn4/{n}_as_published.laz") for n in names]
    place.mkdir()
    north, count = 560_000.3, 0
    for k in range(copies):
        tile = tiles[k % 2].with_crs(CRS(28992))
        classes = np.ones(len(tile), np.uint8)
        corner = np.array([*tile.bounds[:2], 0.0])
        moved = tile.with_xyz(tile.xyz - corner + np.array([230_000.0, north, 0.0]))
        moved.with_attributes({"classification": classes}).save(place / f"{k:02}.laz")
        north += np.ceil(tile.bounds[4] - tile.bounds[1]) + GAP
        count += len(tile)
    return count


def measured(*arguments: Any) -> tuple[float, float]:
    """Run the command line; most bytes of all its processes (shared ones once), and CPU seconds."""
    import psutil

    command = [sys.executable, "-m", "toolbox", *map(str, arguments)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    peak = 0.0
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
    first = psutil.Process(process.pid)
    while process.poll() is None:
        used = 0.0
        try:
            for each in (first, *first.children(recursive=True)):
                used += each.memory_full_info().pss
        except psutil.Error:  # it has ended meanwhile
            continue
        peak = max(peak, used)
        time.sleep(0.3)
    assert process.returncode == 0
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return peak, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
