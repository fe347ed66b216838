"""models.power_line_clearance: from raw points to what is too close, and the real line of AHN4."""

from __future__ import annotations

import os
from pathlib import Path

import corridor_scenes as scenes
import numpy as np
import pytest
from pyproj import CRS
from scipy.spatial import cKDTree

import toolbox
from algorithms.corridor._objects import groups
from toolbox.data import PointCloud

MODEL = "models.power_line_clearance"
TILES = Path(os.environ.get("TOOLBOX_TEST_DATA", "/nowhere")) / "powerline_ahn4"
TREES, CRANES = 5, 26  # classes of what was pasted under the line


@pytest.mark.slow
def test_a_tree_below_the_wires_is_found() -> None:
    curves, points, poles = scenes.line([0.0, 60.0, 120.0], [-1.0, 1.0], 10.0, 300.0)
    low = float(curves[0].height(np.array(30.0)))
    tree = scenes.tree(30.0, 1.0, low - 2.0, 1.5, 800)
    ground = scenes.ground(120.0, 60.0, 6.0)
    cloud = scenes.cloud(ground, *points, poles, tree)
    found = toolbox.run(MODEL, {"points": cloud, "distance": 4.0, "falling": False})
    frame = found["objects"].frame
    assert found["span_count"] == 2
    assert frame.clearance.to_list() == pytest.approx([2.0], abs=0.1)
    assert frame.geometry.x[0] == pytest.approx(scenes.CORNER[0] + 30, abs=1.5)
    assert found["critical_count"] == 1
    assert len(found["classified"]) == len(cloud)


def test_without_a_line_there_is_nothing_too_close(caplog: pytest.LogCaptureFixture) -> None:
    cloud = scenes.cloud(scenes.ground(60.0, 60.0, 3.0), scenes.tree(30, 0, 8, 2, 300))
    found = toolbox.run(MODEL, {"points": cloud})
    assert (found["span_count"], found["object_count"]) == (0, 0)
    assert "no power line was found" in caplog.text


@pytest.mark.slow
@pytest.mark.skipif(not TILES.is_dir(), reason="the AHN4 power line is not there")
@pytest.mark.parametrize("tile", ["12AN2_20", "12BZ1_21"])
def test_all_that_was_pasted_near_the_line_is_found_and_nothing_else(tile: str) -> None:
    cloud = PointCloud.open(TILES / f"{tile}_as_published.laz", assume_crs=CRS(28992))
    found = toolbox.run(MODEL, {"points": cloud, "distance": 5.0, "falling": False})
    classes = np.asarray(cloud["classification"])
    pasted = np.flatnonzero(np.isin(classes, (TREES, CRANES)))
    number = groups(cloud.xyz[pasted], np.zeros(len(pasted), np.int64), 1.5)
    away = cKDTree(cloud.xyz[classes == 14]).query(cloud.xyz[pasted])[0]
    near = {int(k) for k in np.unique(number[away < 4.9])}
    bad = found["violations"]
    distance, own = cKDTree(cloud.xyz[pasted]).query(bad.xyz)
    assert near == {int(k) for k in np.unique(number[own[bad["object_id"] > 0]])}
    assert distance[bad["object_id"] > 0].max() < 0.01
