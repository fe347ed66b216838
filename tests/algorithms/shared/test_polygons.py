"""Points in polygons: exact on edges, in holes and overlaps, as another program has it."""

from __future__ import annotations

import geopandas
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from algorithms.shared.polygons import Polygons, polygons
from toolbox.data import Vector
from toolbox.errors import DataError

SQUARE = shapely.Polygon([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1, 1), (3, 1), (3, 3), (1, 3)]])


def held(shapes: list[shapely.Polygon], xy: NDArray[np.float64]) -> list[bool]:
    found: list[bool] = Polygons.of(np.array(shapes)).hold(xy).tolist()
    return found


def test_edges_corners_and_rims_of_holes_are_inside() -> None:
    xy = np.array([[0, 0], [4, 2], [2, 4], [1, 1], [2, 1], [1, 2.0]])
    assert held([SQUARE], xy) == [True] * 6


def test_holes_are_outside() -> None:
    assert (
        held([SQUARE], np.array([[2, 2], [0.5, 2], [4.1, 2], [-1, 0.0]]))
        == [False, True] + [False] * 2
    )


def test_direction_of_rings_does_not_matter() -> None:
    backwards = shapely.Polygon(SQUARE.exterior.coords[::-1], [SQUARE.interiors[0].coords[::-1]])
    xy = np.array([[2, 2], [0.5, 2]])
    assert held([SQUARE], xy) == held([backwards], xy) == [False, True]


def test_a_point_beside_a_slanted_edge_by_one_bit_is_outside() -> None:
    """The edge passes through (1/3, 1/3) rounded; the next number in x is no longer on it."""
    triangle = shapely.Polygon([(0, 0), (3e6, 3e6), (0, 3e6)])
    on = 1e6 + 1 / 3
    assert held([triangle], np.array([[on, on], [np.nextafter(on, 2e6), on]])) == [True, False]


def test_overlapping_polygons_count_once_and_islands_in_holes_count() -> None:
    island = shapely.box(1.5, 1.5, 2.5, 2.5)
    beside = shapely.box(3.5, 0, 6, 4)
    xy = np.array([[2, 2], [1.2, 2], [3.75, 2], [5, 2], [2.9, 2.9]])
    assert held([SQUARE, island, beside], xy) == [True, False, True, True, False]


def test_several_polygons_in_one_are_all_there() -> None:
    two = shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(5, 0, 6, 1)])
    places = np.array([(0.5, 0.5), (3.0, 0.5), (5.5, 0.5)])
    assert Polygons.of(np.array([two])).hold(places).tolist() == [True, False, True]


def test_no_polygons_and_no_points() -> None:
    assert held([], np.array([[0.0, 0.0]])) == [False]
    assert held([SQUARE], np.empty((0, 2))) == []


@st.composite
def scenes(draw: st.DrawFn) -> tuple[list[shapely.Polygon], NDArray[np.float64]]:
    """Polygons on a coarse lattice, so that much coincides, far from the origin or at it."""
    far = draw(st.sampled_from([0.0, 0.1, 500_000.0, 4_600_000.3]))
    place = st.tuples(st.integers(0, 12), st.integers(0, 12))
    shapes = []
    for _ in range(draw(st.integers(1, 4))):
        ring = draw(st.lists(place, min_size=3, max_size=9, unique=True))
        made = shapely.make_valid(shapely.Polygon(ring))
        parts = [part for part in shapely.get_parts(made) if part.geom_type == "Polygon"]
        moved = shapely.transform(np.array(parts, object), lambda xy: xy / 3 + far)
        shapes += [part for part in moved if part.is_valid and part.area > 0]
    lattice = np.stack(np.meshgrid(np.arange(-1, 14), np.arange(-1, 14)), axis=-1).reshape(-1, 2)
    between = lattice + np.array(draw(st.tuples(*[st.floats(0, 1)] * 2)))
    return shapes, np.vstack([lattice, between]) / 3 + far


@given(scenes())
def test_the_same_as_geos(
    scene: tuple[list[shapely.Polygon], NDArray[np.float64]],
) -> None:
    shapes, xy = scene
    wanted = np.zeros(len(xy), bool)
    for shape in shapes:
        wanted |= shapely.intersects_xy(shape, xy[:, 0], xy[:, 1])
    assert held(shapes, xy) == wanted.tolist()


def test_a_long_thin_polygon_far_away_does_not_take_all_memory() -> None:
    sliver = shapely.Polygon([(1e7, 1e7), (2e7, 1e7 + 1e-6), (2e7, 1e7 + 2e-6)])
    index = Polygons.of(np.array([sliver]))
    assert len(index.winding) < 100_000
    assert index.hold(np.array([[1e7, 1e7], [1.5e7, 1e7 + 1e-2]])).tolist() == [True, False]


def test_what_is_no_valid_polygon_is_refused() -> None:
    line = Vector(geopandas.GeoDataFrame(geometry=[SQUARE.exterior]), name="l.gpkg")
    with pytest.raises(DataError, match=r"area: must be polygons, l\.gpkg holds a Linear"):
        polygons(line, "area")
    bow = shapely.Polygon([(0, 0), (2, 2), (2, 0), (0, 2)])
    with pytest.raises(DataError, match=r"area: a polygon of b\.gpkg is not valid \(Self-inter"):
        polygons(Vector(geopandas.GeoDataFrame(geometry=[bow]), name="b.gpkg"), "area")
