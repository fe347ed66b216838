"""Power lines, real and synthetic."""

from __future__ import annotations

import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.bench.measuring import DATA, FEW, alternately, say

DENSITIES = (5.0, 8.0, 10.0, 12.0, 16.0, 20.0, 25.0, 30.0, 40.0, 60.0)  # points per square metre
TILES = ("12AN2_20", "12BZ1_21")
_CLASS_OF_REFERENCE = np.array([1, 14, 15], np.uint8)  # of the attribute: other, wire, tower
SEEDS = (range(10), range(200, 210), range(300, 310), range(400, 410))  # the last: hardly seen


def corridor() -> None:
    """Wires, towers and spans of real and of random synthetic corridors; speed."""
    from pyproj import CRS

    from toolbox.data import PointCloud

    for tile in TILES:
        path = DATA / f"powerline_ahn4/{tile}_as_published.laz"
        _whole_model(path)
        cloud = PointCloud.open(path).with_crs(CRS(28992))
        _extracted(tile, cloud, cloud["classification"], None)
    hills = PointCloud.open(DATA / "line_quebec_hills/west.laz")
    _extracted("hills", hills, _CLASS_OF_REFERENCE[hills["reference"]], None)
    for seeds in SEEDS:
        rows = [_synthetic(seed, DENSITIES[seed % 10]) for seed in seeds]
        say(
            f"corridor seeds {seeds[0]} to {seeds[-1]}: mean quality of wires "
            f"{statistics.mean(row['wires'] for row in rows):.1f}, of towers "
            f"{statistics.mean(row['towers'] for row in rows):.1f}, spans in full "
            f"{sum(row['full'] for row in rows)} of {sum(row['spans'] for row in rows)}, "
            f"wires invented {sum(row['invented'] for row in rows)}"
        )


def _whole_model(path: Path) -> None:
    """Say how much processor time all steps, layers and the page take, and reading the LAZ."""
    import laspy
    from pyproj import CRS

    import toolbox
    from toolbox.data import PointCloud

    def model() -> None:
        cloud = PointCloud.open(path).with_crs(CRS(28992))
        toolbox.run("models.power_line_clearance", {"points": cloud})["report"].html()

    def read() -> None:
        _ = laspy.read(path).xyz

    ours, reading = alternately(model, read, FEW, time.process_time)
    say(
        f"corridor {path.stem:14} whole model {ours:.2f} CPU s, {ours / reading:.1f} times reading "
        f"the LAZ ({reading:.2f})"
    )


def _synthetic(seed: int, density: float) -> dict[str, float]:
    """Figures of a random corridor, all points of which are unlabelled."""
    from algorithms.samples.scene import SamplesScene
    from toolbox.data import Vector

    made = SamplesScene(kind="power_lines", size=400.0, density=density, seed=seed).run()
    truth, features = made.points["classification"], made.features.frame
    blank = made.points.with_attributes({"classification": np.ones(len(truth), np.uint8)})
    name = f"seed {seed} {density:g}/m2"
    return _extracted(name, blank, truth, Vector(features[features.kind == "wire"]))


def _extracted(name: str, points: Any, truth: Any, lines: Any) -> dict[str, float]:
    """Say what is found of one cloud; guard wires count as wires, insulators as towers."""
    from algorithms.compare.spans import CompareSpans
    from algorithms.corridor.extract import CorridorExtract

    start = time.process_time()
    found = CorridorExtract(points=points).run()
    seconds = (time.process_time() - start) / len(points) * 1e6
    said = found.classified["classification"]
    wires = _shares(said == 14, np.isin(truth, (13, 14)))
    towers = _shares(said == 15, np.isin(truth, (15, 16)))
    row = {"wires": wires[2], "towers": towers[2]}
    text = "  ".join(
        f"{what} {' / '.join(f'{share:5.1f}' for share in shares)}"
        for what, shares in (("wires", wires), ("towers", towers))
    )
    if lines is not None:
        spans = CompareSpans(wires=found.wires, reference=lines).run()
        whole = spans.in_full + spans.in_part + spans.missed
        row |= {"full": spans.in_full, "spans": whole, "invented": spans.invented}
        text += f"  spans in full {spans.in_full} of {whole}, invented {spans.invented}"
        text += f", found twice {spans.doubled}"
        text += f", height RMS {spans.height_rms or float('nan'):.4f} m"
    say(f"corridor {name:14} {text}  {seconds:.1f} CPU s / M points")
    return row


def _shares(said: Any, true: Any) -> tuple[float, float, float]:
    """Correctness, completeness and quality in per cent."""
    both = (said & true).sum()
    correct, complete, quality = (
        float(100 * both / max(n, 1)) for n in (said.sum(), true.sum(), (said | true).sum())
    )
    return correct, complete, quality
