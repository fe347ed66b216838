"""points.height_above_ground: planes with known heights, gaps, edges and bad ground."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS
from scipy.interpolate import LinearNDInterpolator

from algorithms.points.height_above_ground import PointsHeightAboveGround
from algorithms.shared.above_ground import height_above_ground
from toolbox.data import PointCloud
from toolbox.declare import ClassList
from toolbox.errors import DataError, ParameterError

Floats = NDArray[np.float64]
UTM = CRS(32635)
ORIGIN = np.array([500_000.3, 4_600_000.4, 0.0])


def plane(xy: Floats) -> Floats:
    """Elevation of a slope."""
    return np.asarray(0.3 * xy[:, 0] - 0.2 * xy[:, 1] + 50)


def scene(n: int = 500) -> tuple[Floats, Floats, Floats]:
    """Ground points on a slope, points above it within its hull, and their heights."""
    rng = np.random.default_rng(0)
    ground = np.vstack([rng.uniform(0, 50, (n, 2)), [[0, 0], [50, 0], [0, 50], [50, 50]]])
    above, height = rng.uniform(0, 50, (200, 2)), rng.uniform(-3, 30, 200)
    lift = np.column_stack([above, plane(above) + height])
    return np.column_stack([ground, plane(ground)]) + ORIGIN, lift + ORIGIN, height


def test_heights_above_a_slope_are_exact() -> None:
    ground, xyz, height = scene()
    np.testing.assert_allclose(height_above_ground(xyz, ground), height, atol=1e-9)
    np.testing.assert_array_equal(height_above_ground(ground, ground), 0)


def test_triangles_are_those_of_scipy() -> None:
    rng = np.random.default_rng(1)
    ground, xyz, _ = scene()
    ground[:, 2] += rng.normal(0, 5, len(ground))
    wanted = xyz[:, 2] - LinearNDInterpolator(ground[:, :2] - ORIGIN[:2], ground[:, 2])(
        xyz[:, :2] - ORIGIN[:2]
    )
    np.testing.assert_allclose(height_above_ground(xyz, ground), wanted, atol=1e-6)


def test_outside_the_hull_the_nearest_ground_point_tells() -> None:
    ground = np.array([[0, 0, 10], [10, 0, 20], [0, 10, 30.0]])
    xyz = np.array([[-5, -1, 15], [30, -4, 15], [2, 2, 20.0]])
    np.testing.assert_allclose(height_above_ground(xyz, ground), [5, -5, 4])
    found = height_above_ground(xyz, ground, max_distance=6.0)
    np.testing.assert_allclose(found, [5, np.nan, 4])


def test_max_distance_holds_inside_triangles_as_well() -> None:
    ground = np.array([[0, 0, 10], [30, 0, 10], [0, 30, 10.0]])
    xyz = np.array([[10, 10, 15], [3, 4, 15.0]])
    np.testing.assert_allclose(height_above_ground(xyz, ground, max_distance=5.0), [np.nan, 5])


def test_nearest_and_inverse_distance() -> None:
    ground = np.array([[0, 0, 10], [4, 0, 20], [0, 30, 90.0]])
    xyz = np.array([[1, 0, 50], [4, 0, 50], [2.5, 0, 50.0]])
    found = height_above_ground(xyz, ground, method="nearest")
    np.testing.assert_allclose(found, [40, 30, 30])
    found = height_above_ground(xyz, ground, method="nearest", count=2)
    np.testing.assert_allclose(found, [50 - (10 * 3 + 20) / 4, 30, 50 - (10 * 1.5 + 20 * 2.5) / 4])
    some = height_above_ground(xyz, ground[:1], method="nearest", count=7)
    np.testing.assert_allclose(some, 40)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_equally_near_ground_is_chosen_by_its_place(count: int) -> None:
    """A tile or another order sees the same; on a grid every midpoint has four nearest."""
    x, y = (g.ravel() for g in np.meshgrid(np.arange(12.0), np.arange(12.0)))
    ground = np.column_stack([x, y, np.random.default_rng(0).uniform(0, 9, len(x))])
    xyz = np.column_stack([x[:60] + 0.5, y[:60] + 0.5, np.full(60, 20.0)])
    whole = height_above_ground(xyz, ground, method="nearest", count=count)
    rng = np.random.default_rng(1)
    for part in (ground[rng.permutation(len(ground))], ground[ground[:, 1] < 8]):
        found = height_above_ground(xyz, part, method="nearest", count=count)
        np.testing.assert_array_equal(found[:40], whole[:40])


@pytest.mark.parametrize(
    "ground",
    [[[3, 4, 7.0]], [[3, 4, 7], [9, 9, 9.0]], [[3, 4, 7], [4, 5, 8], [5, 6, 9.0]]],
    ids=["one point", "two", "on a line"],
)
def test_ground_without_a_triangle_is_taken_from_the_nearest(ground: Any) -> None:
    found = height_above_ground(np.array([[2, 4, 10.0]]), np.array(ground))
    np.testing.assert_allclose(found, [3])


def test_ground_at_one_place_is_averaged_and_none_is_thinned() -> None:
    ground, xyz, height = scene()
    twice = np.vstack([ground + np.array([0, 0, 1]), ground - np.array([0, 0, 1])])
    np.testing.assert_allclose(height_above_ground(xyz, twice), height, atol=1e-9)
    pit = np.vstack([ground, xyz[0] - [0, 0, 30 + height[0]]])
    assert height_above_ground(xyz, pit)[0] == pytest.approx(30 + height[0])


def cloud(crs: CRS = UTM, unit: float = 1.0, **attributes: Any) -> tuple[PointCloud, Floats]:
    """Ground of class 2 and points of class 1 above it, and all their heights in metres."""
    ground, xyz, height = scene()
    classes = np.repeat([2, 1], [len(ground), len(xyz)]).astype(np.uint8)
    points = PointCloud(
        np.vstack([ground, xyz]) / unit, {"classification": classes} | attributes, crs=crs
    )
    return points, np.concatenate([np.zeros(len(ground)), height])


def test_the_attribute() -> None:
    points, height = cloud()
    out = PointsHeightAboveGround(points=points).run()
    assert out.heights["HeightAboveGround"].dtype == np.float32
    np.testing.assert_allclose(out.heights["HeightAboveGround"], height, atol=1e-5)
    assert out.heights.descriptions["HeightAboveGround"] == "above ground, metre"
    assert out.without_height == 0


def test_feet_stay_feet_and_distances_are_metres(tmp_path: Path) -> None:
    foot = 1200 / 3937
    points, height = cloud(CRS(2263), foot)
    out = PointsHeightAboveGround(points=points).run()
    np.testing.assert_allclose(out.heights["HeightAboveGround"], height / foot, atol=1e-4)
    far = PointsHeightAboveGround(points=points, method="nearest", max_distance=0.5).run()
    ground = points.xyz[points["classification"] == 2, :2]
    gaps = np.array([np.hypot(*(ground - p).T).min() for p in points.xyz[:, :2]])
    assert far.without_height == (gaps * foot > 0.5).sum() > 20
    far.heights.save(tmp_path / "a.laz")
    back = PointCloud.open(tmp_path / "a.laz")
    assert np.isnan(back["HeightAboveGround"]).sum() == far.without_height
    assert back.descriptions["HeightAboveGround"] == "above ground, US survey foot"


def test_ground_classes_and_withheld_points() -> None:
    points, height = cloud()
    classes = np.where(points["classification"] == 2, 8, 1).astype(np.uint8)
    classes[0] = 2
    points = points.with_attributes({"classification": classes})
    both = PointsHeightAboveGround(points=points, ground_classes=ClassList([2, 8])).run()
    np.testing.assert_allclose(both.heights["HeightAboveGround"], height, atol=1e-5)
    points = points.with_attributes({"withheld": (classes == 2).astype(np.uint8)})
    with pytest.raises(DataError, match="all 1 points of class 2,9-11 are withheld"):
        PointsHeightAboveGround(points=points).run()
    with pytest.raises(DataError, match="none is of class 9; classify them first"):
        PointsHeightAboveGround(points=points, ground_classes=ClassList([9])).run()


def test_bad_input() -> None:
    points, _ = cloud()
    with pytest.raises(DataError, match="no classification; classify ground first"):
        PointsHeightAboveGround(points=PointCloud(points.xyz, crs=UTM, name="a.laz"))
    with pytest.raises(ParameterError, match="count: is for method nearest; must be 1"):
        PointsHeightAboveGround(points=points, count=3)
    with pytest.raises(DataError, match="no ground to measure"):
        height_above_ground(points.xyz, points.xyz[:0])
    with pytest.raises(ValueError, match="finite numbers, got z = nan at point 0"):
        height_above_ground(np.array([[0, 0, np.nan]]), points.xyz)


def test_halo() -> None:
    points, _ = cloud()
    assert np.isinf(PointsHeightAboveGround(points=points, max_distance=9.0).halo())
    near = PointsHeightAboveGround(points=points, method="nearest", max_distance=9.0)
    assert near.halo() == 9
    assert np.isinf(PointsHeightAboveGround(points=points, method="nearest").halo())


def test_wires_of_a_real_line_hang_as_high_as_reported(data: Callable[[str], Path]) -> None:
    """The lowest wires are 12.8 to 13.7 m above the ground, and ground is at 0."""
    points = PointCloud.open(data("powerline_ahn4/12AN2_20_as_published.laz"))
    some = points.select(np.flatnonzero(points["classification"] != 5)[::4])
    found = PointsHeightAboveGround(points=some).run().heights["HeightAboveGround"]
    assert np.percentile(found[some["classification"] == 14], 0.5) == pytest.approx(13.2, abs=0.8)
    assert not found[some["classification"] == 2].any()
