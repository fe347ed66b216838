"""points.normalise: heights as z, and back bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scenes.layers import cloud

import toolbox
from algorithms.points.normalise import PointsNormalise
from toolbox.data import PointCloud
from toolbox.errors import DataError, NothingToDo


def slope() -> PointCloud:
    """Ground that rises by a tenth, and a tree of 7.5 m."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(9.0), np.arange(9.0)))
    ground = np.column_stack([x, y, 0.1 * x + 700])
    tree = np.array([[4.5, 4.5, 700.45 + 7.5]])
    classes = np.r_[np.full(81, 2), 5].astype(np.uint8)
    return cloud(np.vstack([ground, tree]) + np.array([500_000, 4_600_000, 0]), classes)


def test_heights_become_z() -> None:
    out = PointsNormalise(points=slope()).run().normalised
    np.testing.assert_allclose(out["z"][:81], 0, rtol=0, atol=1e-9)
    assert out["z"][81] == pytest.approx(7.5, abs=1e-9)
    np.testing.assert_array_equal(out["elevation"], slope()["z"])
    assert out.descriptions["elevation"] == "before normalising, metre"


def test_heights_that_are_there_are_taken() -> None:
    points = slope().with_attributes({"HeightAboveGround": np.arange(82.0)})
    assert PointsNormalise(points=points).run().normalised["z"].tolist() == list(range(82))
    gaps = slope().with_attributes({"HeightAboveGround": np.full(82, np.nan)})
    with pytest.raises(DataError, match=r"82 of 82 points of a\.laz have no HeightAboveGround"):
        PointsNormalise(points=gaps).run()


def test_back_through_files_bit_for_bit(tmp_path: Path) -> None:
    slope().save(tmp_path / "a.laz")
    run = toolbox.run
    run("points.normalise", {"points": tmp_path / "a.laz", "normalised": tmp_path / "n.laz"})
    again = {"points": tmp_path / "n.laz", "undo": True, "normalised": tmp_path / "b.laz"}
    run("points.normalise", again)
    before, after = PointCloud.open(tmp_path / "a.laz"), PointCloud.open(tmp_path / "b.laz")
    np.testing.assert_array_equal(after.xyz, before.xyz)
    assert after.names == before.names  # elevation is gone


def test_what_is_refused() -> None:
    once = PointsNormalise(points=slope()).run().normalised
    with pytest.raises(DataError, match="is it normalised already"):
        PointsNormalise(points=once)
    with pytest.raises(DataError, match=r"undo: a\.laz has no attribute elevation"):
        PointsNormalise(points=slope(), undo=True)
    with pytest.raises(DataError, match="has no classification"):
        PointsNormalise(points=cloud([[0, 0, 0.0]]))
    with pytest.raises(NothingToDo, match="none is of class"):
        PointsNormalise(points=cloud([[0, 0, 0.0]], 1)).run()
