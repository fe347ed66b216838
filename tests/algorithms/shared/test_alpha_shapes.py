"""Alpha shapes: against their definition, against scipy, and on degenerate input."""

from __future__ import annotations

import contextlib
import itertools
import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, Delaunay

from algorithms.shared.alpha_shape import AlphaShape, Gaps, alpha_shape, alpha_shapes_of_groups
from toolbox.errors import DataError

Floats = NDArray[np.float64]
Edge = frozenset[tuple[float, float]]

FAR = np.array([500_000.25, 4_600_000.5])  # a place as in a map projection
few_points = st.lists(
    st.tuples(st.integers(0, 7), st.integers(0, 7)), min_size=3, max_size=22, unique=True
)
alphas = st.sampled_from([0.6, 0.75, 0.9, 1.05, 1.3, 1.55, 2.03, 2.71, 4.09, 9.3])  # radii of none


def spans(points: list[tuple[int, int]]) -> bool:
    xy = np.array(points, float)
    return bool(np.linalg.matrix_rank(xy - xy[0]) == 2)


spanning = few_points.filter(spans)


def edges(shape: AlphaShape) -> set[Edge]:
    """All edges of the outlines."""
    found: set[Edge] = set()
    for polygon in shape.polygons:
        for ring in (polygon.exterior, *polygon.interiors):
            found |= {frozenset(pair) for pair in itertools.pairwise(ring.coords)}
    return found


def exposed(xy: Floats, alpha: float) -> set[Edge]:
    """Edges that a disc without points in it can touch with both ends, but from one side only."""
    found = set()
    for a, b in itertools.combinations(xy, 2):
        way = b - a
        square = float(way @ way)
        if square > 4 * alpha**2:
            continue
        height = math.sqrt(alpha**2 / square - 0.25)  # the seed's equation of the rolling circle
        normal = np.array([-way[1], way[0]])
        centres = [(a + b) / 2 + sign * height * normal for sign in (1, -1)]
        free = [bool((np.hypot(*(xy - c).T) > alpha - 1e-9).all()) for c in centres]
        if free[0] != free[1]:
            found.add(frozenset([tuple(a), tuple(b)]))
    return found


def circumradii(corners: Floats) -> Floats:
    """Of triangles of shape (t, 3, 2)."""
    a, b, c = (np.hypot(*(corners[:, i] - corners[:, j]).T) for i, j in ((0, 1), (1, 2), (2, 0)))
    (ux, uy), (vx, vy) = ((corners[:, k] - corners[:, 0]).T for k in (1, 2))
    return np.asarray(a * b * c / (2 * np.abs(ux * vy - uy * vx)))


def scattered(n: int = 600, seed: int = 0) -> Floats:
    """A square with a round gap and a bay."""
    xy = np.random.default_rng(seed).random((n, 2)) * 20
    gap = np.hypot(*(xy - [8, 8]).T) < 3
    bay = (np.abs(xy[:, 1] - 15) < 1.5) & (xy[:, 0] > 12)
    return np.asarray(xy[~gap & ~bay])


@given(spanning, alphas)
def test_outlines_are_the_edges_that_the_definition_names(
    points: list[tuple[int, int]], alpha: float
) -> None:
    xy = np.array(points, float)
    shape = alpha_shape(xy, alpha)
    assert edges(shape) == exposed(xy, alpha)


@given(spanning, alphas, st.floats(0, 9), st.floats(0, 9))
def test_polygons_are_valid_and_apart(
    points: list[tuple[int, int]], alpha: float, hole: float, region: float
) -> None:
    xy = np.array(points, float) + FAR
    shape = alpha_shape(xy, alpha, hole_threshold=hole, region_threshold=region)
    assert shapely.is_valid(shape.polygons).all()
    areas = shapely.area(shape.polygons)
    assert list(areas) == sorted(areas, reverse=True)
    assert shapely.area(shapely.union_all(shape.polygons)) == pytest.approx(areas.sum(), abs=1e-6)
    assert (areas >= region - 1e-9).all()
    if hole:
        rings = [r for p in shape.polygons for r in p.interiors]
        assert all(shapely.area(shapely.polygons(r)) >= hole - 1e-6 for r in rings)


@given(spanning, st.randoms())
def test_order_of_points_makes_no_difference(points: list[tuple[int, int]], random: Any) -> None:
    there = np.array(points * 2, float)
    order = list(range(len(there)))
    random.shuffle(order)
    for alpha in (1.2, "auto"):
        one, other = (alpha_shape(xy, alpha) for xy in (there, there[order]))  # type: ignore[arg-type]
        assert [p.wkb for p in one.polygons] == [p.wkb for p in other.polygons]
        np.testing.assert_array_equal(one.points, other.points)


@pytest.mark.slow
@given(spanning)
def test_auto_is_the_first_radius_with_one_region_of_all_points(
    points: list[tuple[int, int]],
) -> None:
    """Tried one after the other: the radii of all triangles of an independent triangulation."""
    xy = np.array(points, float)
    mesh = Delaunay(xy)
    radii = np.unique(circumradii(xy[mesh.simplices]).round(9))
    radii = radii[radii < 1e6]  # triangles without an area, which scipy may make
    for rule, regions in (("all_points", math.inf), ("auto", 1)):
        tried = (alpha_shape(xy, radius + 1e-9) for radius in radii)
        first = next(s for s in tried if s.points.sum() == len(xy) and len(s.polygons) <= regions)
        found = alpha_shape(xy, rule)  # type: ignore[arg-type]
        assert found.alpha == pytest.approx(first.alpha, rel=1e-6)
        assert edges(found) == edges(first)


@pytest.mark.parametrize("alpha", [0.5, 0.8, 1.5, 4.0])
def test_triangles_are_those_of_scipy_within_the_radius(alpha: float) -> None:
    xy = scattered()
    mesh = Delaunay(xy)
    kept = mesh.simplices[circumradii(xy[mesh.simplices]) <= alpha]
    sides = np.sort(kept[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    once, count = np.unique(sides, axis=0, return_counts=True)
    wanted = {frozenset(map(tuple, pair)) for pair in xy[once[count == 1]].tolist()}
    shape = alpha_shape(xy, alpha)
    assert edges(shape) == wanted
    corners = xy[kept]
    area = shapely.area(shapely.polygons(corners)).sum()
    assert shapely.area(shape.polygons).sum() == pytest.approx(area, rel=1e-12)


def test_area_grows_with_alpha_up_to_the_convex_hull() -> None:
    xy = scattered()
    areas = [shapely.area(alpha_shape(xy, a).polygons).sum() for a in (0.1, 0.5, 1, 2, 8, 99)]
    assert areas == sorted(areas)
    whole = alpha_shape(xy, math.inf)
    assert shapely.area(whole.polygons).sum() == pytest.approx(ConvexHull(xy).volume, rel=1e-12)
    assert whole.points.sum() == len(xy)


def test_gap_and_bay_are_found() -> None:
    shape = alpha_shape(scattered(4000), 1.0)
    (polygon,) = shape.polygons
    (hole,) = polygon.interiors
    assert shapely.area(shapely.Polygon(hole)) == pytest.approx(9 * math.pi, rel=0.1)
    assert not polygon.contains(shapely.Point(16, 15))


def grid(columns: int, rows: int) -> Floats:
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return np.column_stack([x.ravel(), y.ravel()]).astype(float)


@pytest.mark.parametrize("size", [1.0, 0.1, 1 / 3, 1e-6, 1e9])
def test_a_lattice_is_all_there_or_not_at_all(size: float) -> None:
    """All circles are equal, so rounding must not take single triangles out."""
    xy = grid(30, 20) * size + FAR * size
    radius = size * math.sqrt(0.5)
    (polygon,) = alpha_shape(xy, radius).polygons
    assert polygon.area == pytest.approx(29 * 19 * size**2, rel=1e-6)
    assert len(polygon.exterior.coords) == 2 * (29 + 19) + 1
    assert not polygon.interiors
    empty = alpha_shape(xy, 0.999 * radius)
    assert len(empty.polygons) == len(empty.points) == 0
    assert empty.least == pytest.approx(radius, rel=1e-8)
    assert alpha_shape(xy, "auto").alpha == pytest.approx(radius, rel=1e-8)


def test_points_on_one_circle() -> None:
    turn = np.linspace(0, 2 * math.pi, 360, endpoint=False)
    xy = 10 * np.column_stack([np.cos(turn), np.sin(turn)]) + FAR
    (polygon,) = alpha_shape(xy, 10.0).polygons
    assert len(polygon.exterior.coords) == 361
    assert len(alpha_shape(xy, 9.99).polygons) == 0


def test_duplicates_count_but_change_nothing() -> None:
    xy = scattered(100)
    one, other = alpha_shape(xy, 2.0), alpha_shape(np.repeat(xy, 3, axis=0), 2.0)
    assert [p.wkb for p in one.polygons] == [p.wkb for p in other.polygons]
    np.testing.assert_array_equal(other.points, 3 * one.points)


@pytest.mark.parametrize(
    "xy", [np.empty((0, 2)), grid(1, 1), grid(2, 1), grid(9, 1), np.repeat(grid(2, 1), 4, axis=0)]
)
def test_too_little_is_an_error(xy: Floats) -> None:
    with pytest.raises(DataError, match="do not span a triangle"):
        alpha_shape(xy, 1.0)


def test_three_points_are_a_triangle() -> None:
    shape = alpha_shape(np.array([[0, 0], [4, 0], [0, 3.0]]), "auto")
    assert shape.alpha == pytest.approx(2.5)
    assert shape.polygons[0].area == 6
    assert list(shape.points) == [3]


def test_regions_that_touch_in_a_point_are_two() -> None:
    xy = np.array([[0, 0], [-2, 0.5], [-2, -0.5], [2, 0.6], [2, -0.6]])
    shape = alpha_shape(xy, 1.2)
    assert shapely.area(shape.polygons) == pytest.approx([1.2, 1.0])
    assert list(shape.points) == [3, 2]  # the point in between counts once, for the larger


def test_a_ring_that_closes_in_a_point_has_a_hole() -> None:
    """Two rings of triangles without their centre, and without one point of the outer ring."""
    i, j = np.mgrid[-2:3, -2:3].reshape(2, -1)
    away = np.maximum(np.abs(i), np.maximum(np.abs(j), np.abs(i + j)))
    some = (away > 0) & (away <= 2) & ~((i == 2) & (j == 0))
    xy = np.column_stack([i + j / 2, j * math.sqrt(0.75)])[some]
    (polygon,) = alpha_shape(xy, 0.6).polygons
    assert polygon.is_valid
    assert polygon.area == pytest.approx((24 - 6 - 2) * math.sqrt(3) / 4)
    (hole,) = polygon.interiors
    assert set(hole.coords) & set(polygon.exterior.coords) == {(1.0, 0.0)}


def island() -> Floats:
    """A lattice of 20 x 20 with a hole, in which is a piece of 3 x 3 points, and a piece beside."""
    xy = grid(20, 20)
    away = np.abs(xy - 9).max(axis=1)
    return np.vstack([xy[(away > 4) | (away < 2)], grid(4, 4) + np.array([25, 0])])


def test_holes_are_filled_with_their_islands_and_small_regions_dropped() -> None:
    xy = island()
    shape = alpha_shape(xy, 0.8)
    assert shapely.area(shape.polygons) == pytest.approx([361 - 98, 9, 4])
    assert list(shape.points) == [400 - 81, 16, 9]
    # Four halves of squares are in its corners; the gap is what they and the island leave.
    kept = alpha_shape(xy, 0.8, hole_threshold=94.0)
    assert shapely.area(kept.polygons) == pytest.approx([361 - 98, 9, 4])
    filled = alpha_shape(xy, 0.8, hole_threshold=94.1)
    assert shapely.area(filled.polygons) == pytest.approx([361, 9])
    assert filled.points[0] == 400 - 81 + 9
    dropped = alpha_shape(xy, 0.8, region_threshold=9.1)
    assert shapely.area(dropped.polygons) == pytest.approx([263])
    assert dropped.points.sum() == 319


def test_a_triangle_in_the_middle_of_a_hole_is_a_region_again() -> None:
    """A larger alpha than the critical one may have more regions; then they are told apart."""
    turn = np.linspace(0, 2 * math.pi, 60, endpoint=False)
    rim = np.column_stack([np.cos(turn), np.sin(turn)])
    spikes = np.vstack([rim[k] * r for k in (0, 20, 40) for r in np.arange(3.2, 10, 0.4)[:, None]])
    xy = np.vstack([rim * 10, rim * 9.2, spikes])
    critical = alpha_shape(xy, "auto").alpha
    counts = [len(alpha_shape(xy, a).polygons) for a in (critical, 3.3, 99.0)]
    assert counts == [1, 2, 1]


def test_groups_have_the_shapes_that_they_have_alone() -> None:
    """Also those that overlap, touch or are too small, far from the origin."""
    rng = np.random.default_rng(1)
    xy = np.round(rng.random((3000, 2)) * [90, 60] + [634000.0, 4850000.0], 2)
    group = rng.integers(0, 40, 3000)
    group[:5] = [40, 40, 41, 42, 42]  # too few points
    xy[5:9] = xy[5] + np.arange(4)[:, None] * [0.25, 0.5]  # on one line
    group[5:9] = 43
    polygons, groups = alpha_shapes_of_groups(xy, group, 6.0)
    assert (np.diff(shapely.area(polygons)) <= 0).all()
    for number in range(44):
        alone = []
        with contextlib.suppress(DataError):
            alone = alpha_shape(xy[group == number], 6.0, hole_threshold=np.inf).polygons
        here = polygons[groups == number]
        assert len(here) == len(alone)
        assert shapely.equals_exact(here, alone).all()


def test_groups_without_a_triangle() -> None:
    assert len(alpha_shapes_of_groups(np.zeros((2, 2)), np.array([0, 1]), 1.0)[0]) == 0


def test_no_wide_triangle_bridges_a_gap() -> None:
    """Two squares 2 apart: triangles between them, and only these, are asked and left out."""
    square = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0)), -1).reshape(-1, 2)
    xy = np.concatenate([square, square + np.array([5.0, 0.0])])
    asked: list[Any] = []

    def are_open(places: Any) -> Any:
        asked.extend(places[:, 0])
        return np.full(len(places), True)

    assert len(alpha_shape(xy, 2.0).polygons) == 1
    shape = alpha_shape(xy, 2.0, gaps=Gaps(0.75, are_open))
    assert [polygon.area for polygon in shape.polygons] == [9.0, 9.0]
    assert 3 < min(asked) < max(asked) < 5
    assert len(alpha_shape(xy, 2.0, gaps=Gaps(1.5, are_open)).polygons) == 1
