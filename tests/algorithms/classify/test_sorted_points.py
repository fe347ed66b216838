"""Points in polygons, found by squares: all that lie within, wherever the polygon is."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from algorithms.classify._sorted_points import SIDE, SortedPoints

FOOT = 0.3048


@pytest.mark.parametrize("metre", [1.0, 1 / FOOT])
def test_all_points_in_a_polygon_are_found(metre: float) -> None:
    rng = np.random.default_rng(1)
    xyz = (rng.uniform(-50, 50, (3000, 3)) - [7, 300, 0]).round(2) * metre
    some = rng.random(len(xyz)) < 0.5
    points = SortedPoints.of(xyz, metre)
    disc = shapely.Point(-7, -300).buffer(1.0)
    for east, north, size in [
        *rng.uniform(-60, 60, (40, 3)),
        (0, 0, 200),
        (500, 0, 3),
        (0, 500, 3),
    ]:
        shape = shapely.transform(disc, lambda xy: (xy * abs(size) + [east, north]) * metre)  # noqa: B023
        inside = shapely.intersects_xy(shape, *xyz[:, :2].T)
        np.testing.assert_array_equal(points.within(shape, xyz), np.flatnonzero(inside))
        both = points.within(shape, xyz, some)
        np.testing.assert_array_equal(both, np.flatnonzero(inside & some))


def test_points_on_the_edges_of_squares_and_polygons_are_found() -> None:
    xyz = np.array([[x, y, 0.0] for x in range(-8, 9, 4) for y in range(-8, 9, 4)])
    points = SortedPoints.of(xyz, 1.0)
    for box in (shapely.box(-4, -4, 4, 4), shapely.box(-8, -8, 8, 8), shapely.box(8, 8, 9, 9)):
        on = shapely.intersects_xy(box, *xyz[:, :2].T)
        np.testing.assert_array_equal(points.within(box, xyz), np.flatnonzero(on))
    assert SIDE == 4.0  # or these points are on no edges


def test_nothing_is_in_a_polygon_without_area() -> None:
    points = SortedPoints.of(np.zeros((1, 3)), 1.0)
    assert points.within(shapely.Polygon(), np.zeros((1, 3))).size == 0
