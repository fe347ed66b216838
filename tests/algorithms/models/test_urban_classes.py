"""models.urban_classes: what stays as the file has it."""

from __future__ import annotations

import numpy as np
from pyproj import CRS

import toolbox
from toolbox import catalog
from toolbox.data import PointCloud


def test_bridges_and_quays_of_dutch_surveys_stay_unless_they_are_not_named() -> None:
    x, y = (axis.ravel() + 0.01 for axis in np.mgrid[0:60:0.7, 0:60:0.7])
    deck = abs(x - 30) < 5
    z = 0.02 * np.sin(7 * x + 3 * y) + 1.5 * deck
    classes = np.where(deck, 26, 1).astype(np.uint8)
    xyz = np.column_stack([x + 5e5, y + 4.6e6, z])
    points = PointCloud(xyz, {"classification": classes}, crs=CRS(32635))
    values = {"points": points, "denoise": False, "water": False}
    kept = toolbox.run("models.urban_classes", values)["classified"]["classification"]
    assert (kept[deck] == 26).all()
    assert (kept[~deck] == 2).mean() > 0.95
    lost = toolbox.run("models.urban_classes", {**values, "keep_classes": "17"})["classified"]
    assert not (lost["classification"] == 26).any()


def test_a_set_says_what_its_confidences_are() -> None:
    """The word was a heading in the report, and a column in the README, and nothing else."""
    spec = catalog.load("models.urban_classes")
    assert "confidence: share of points on planes" in spec.outputs["outlines"].help
    assert "Share of the points" in spec.outputs["outlines"].columns["confidence"].meaning
    (points,) = (one for one in spec.deliver if one.file == "classified.laz")
    assert "confidence, 0 doubtful to 1 clear" in points.help
