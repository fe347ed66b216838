"""Power lines, real and synthetic."""

from __future__ import annotations

import time
from typing import Any

from tests.bench.measuring import DATA, say


def corridor() -> None:
    """Wires, towers and spans of two real tiles and ten synthetic corridors."""
    import numpy as np
    from pyproj import CRS

    from algorithms.compare.spans import CompareSpans
    from algorithms.corridor.extract import CorridorExtract
    from algorithms.samples.scene import SamplesScene
    from toolbox.data import PointCloud, Vector

    def shares(said: Any, true: Any) -> str:
        both = (said & true).sum()
        whole = (said.sum(), true.sum(), (said | true).sum())
        return " / ".join(f"{100 * both / max(n, 1):5.1f}" for n in whole)

    def report(name: str, points: PointCloud, truth: Any, lines: Vector | None) -> None:
        start = time.process_time()
        found = CorridorExtract(points=points).run()
        seconds = (time.process_time() - start) / len(points) * 1e6
        said = found.classified["classification"]
        text = f"wires {shares(said == 14, np.isin(truth, (13, 14)))}"
        text += f"  towers {shares(said == 15, np.isin(truth, (15, 16)))}"
        if lines:
            spans = CompareSpans(wires=found.wires, reference=lines).run()
            text += f"  spans {spans.in_full}/{spans.in_part}/{spans.missed}"
            text += f"  invented {spans.invented}  height {spans.height_rms} m"
        say(f"corridor {name:12} {text}  {seconds:.1f} CPU s / M points")

    for tile in ("12AN2_20", "12BZ1_21"):
        cloud = PointCloud.open(DATA / f"powerline_ahn4/{tile}_as_published.laz")
        report(tile, cloud.with_crs(CRS(28992)), cloud["classification"], None)
    for seed, density in enumerate((5, 8, 10, 12, 16, 20, 25, 30, 40, 60)):
        made = SamplesScene(kind="power_lines", size=400.0, density=float(density), seed=seed).run()
        truth = made.points["classification"]
        features = made.features.frame
        blank = made.points.with_attributes({"classification": np.ones(len(truth), np.uint8)})
        wires = Vector(features[features.kind == "wire"])
        report(f"seed {seed}", blank, truth, wires)
