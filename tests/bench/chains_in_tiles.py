"""``models.terrain`` in tiles, on copies of a survey laid out side by side."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

from tests.bench.chains import AUTZEN, reading
from tests.bench.measuring import DATA, folder, say, toolbox

MEMORY = "4GB"


def in_tiles(millions: int, workers: int) -> float:
    """Run it, say what it takes, and give its processor time as times of reading."""
    with folder() as out:
        survey = out / "survey"
        survey.mkdir()
        count = _lay_out(survey, millions)
        start = time.perf_counter()
        base = sum(reading(path) for path in sorted(survey.iterdir()))
        spent = time.perf_counter() - start
        made = _run(survey, out, workers)
    say(
        f"chains   tiles          {count / 1e6:.1f} M points, {workers} workers, {MEMORY}: "
        f"{made['cpu']:.0f} CPU s, {made['seconds']:.0f} s, {made['cpu'] / base:.1f} times reading "
        f"({base:.1f} CPU s; measured in {spent:.0f} s), exit {made['code']} {made['error'][-300:]}"
    )
    return float(made["cpu"] / base)


def _run(survey: Path, out: Path, workers: int) -> dict[str, Any]:
    products = [f"--{name}={out / name}.tif" for name in ("dtm", "dsm", "ndsm", "intensity")]
    tiles = ["--tile", "auto", "--memory", MEMORY, "--workers", workers]
    classified = f"--classified={out / 'classified'}/"
    return toolbox(
        "run", "models.terrain", "--points", survey, classified, *products, *tiles, "--json"
    )


def _lay_out(into: Path, millions: int) -> int:
    """Copies of the survey in rows and columns, a file each, its own density kept; their points."""
    import laspy
    import numpy as np

    las = laspy.read(DATA / AUTZEN)
    copies = max(1, round(millions * 1e6 / len(las.points)))
    across = math.ceil(math.sqrt(copies))
    x, y = las.points.array["X"].copy(), las.points.array["Y"].copy()
    for number in range(copies):
        row, col = divmod(number, across)
        las.points.array["X"] = x + col * (np.ptp(x) + 1)
        las.points.array["Y"] = y + row * (np.ptp(y) + 1)
        las.write(into / f"{row}_{col}.laz")
    return copies * len(las.points)
