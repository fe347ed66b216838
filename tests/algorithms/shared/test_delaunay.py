"""The Delaunay triangulation: against exact arithmetic, against scipy, and for any order."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, Delaunay

from algorithms.shared import delaunay
from algorithms.shared.delaunay import LiveMesh, Mesh, triangulate
from algorithms.shared.kernels import delaunay as kernels
from toolbox.context import Context
from toolbox.errors import Cancelled, DataError

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Point = tuple[Fraction, Fraction]
Places = set[frozenset[tuple[float, float]]]


def for_python(helper: Any) -> Any:
    """A kernel that does nothing but call a helper, which Python cannot."""
    return numba.njit(lambda *arguments: helper(*arguments))  # noqa: PLW0108  that is the point


called_orient, called_orient_exact = map(for_python, (kernels.orient, kernels._orient_exact))
called_in_circle, called_circle_exact = map(for_python, (kernels.in_circle, kernels._circle_exact))
called_locate, called_is_ghost = map(for_python, (kernels.locate, kernels.is_ghost))
called_insert = for_python(kernels.insert)


def scattered(n: int, seed: int = 1) -> Floats:
    return np.random.default_rng(seed).random((n, 2))


def grid(rows: int, cols: int) -> Floats:
    x, y = np.meshgrid(np.arange(float(cols)), np.arange(float(rows)))
    return np.column_stack([x.ravel(), y.ravel()])


def shuffled(xy: Floats, seed: int = 2) -> Floats:
    return np.random.default_rng(seed).permutation(xy)


def as_places(mesh: Mesh) -> Places:
    """The triangles by the coordinates of their vertices, whatever the numbers of the points."""
    return {frozenset(map(tuple, corners)) for corners in mesh.xy[mesh.triangles].tolist()}


def sorted_rows(triangles: NDArray[np.integer]) -> NDArray[np.integer]:
    rows = np.sort(triangles, axis=1)
    return rows[np.lexsort(rows.T)]


# What a triangulation is, in exact arithmetic


def side(a: Point, b: Point, c: Point) -> Fraction:
    """Twice the area of abc, > 0 counter-clockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def in_circle(a: Point, b: Point, c: Point, p: Point) -> Fraction:
    """> 0 where p is inside the circle of the counter-clockwise triangle abc."""
    rows = [(q[0] - p[0], q[1] - p[1]) for q in (a, b, c)]
    (ax, ay), (bx, by), (cx, cy) = rows
    return (
        (ax * ax + ay * ay) * (bx * cy - by * cx)
        + (bx * bx + by * by) * (cx * ay - cy * ax)
        + (cx * cx + cy * cy) * (ax * by - ay * bx)
    )


def exact(xy: Floats) -> list[Point]:
    return [(Fraction(x), Fraction(y)) for x, y in xy.tolist()]


def twice_hull_area(points: list[Point]) -> Fraction:
    """By the monotone chain."""

    def chain(ordered: list[Point]) -> list[Point]:
        kept: list[Point] = []
        for p in ordered:
            while len(kept) > 1 and side(kept[-2], kept[-1], p) <= 0:
                kept.pop()
            kept.append(p)
        return kept

    ordered = sorted(points)
    around = chain(ordered)[:-1] + chain(ordered[::-1])
    return sum((a[0] * b[1] - a[1] * b[0] for a, b in pairwise(around)), Fraction(0))


def assert_neighbours_agree(mesh: Mesh) -> None:
    """Across edge k of a triangle is the one that has the same edge the other way round."""
    edges = {}
    for t, (a, b, c) in enumerate(mesh.triangles.tolist()):
        for k, edge in enumerate(((b, c), (c, a), (a, b))):
            assert edge not in edges
            edges[edge] = t, k
    for (a, b), (t, k) in edges.items():
        assert mesh.neighbours[t, k] == edges.get((b, a), (-1,))[0]


def assert_delaunay(mesh: Mesh) -> None:
    """Triangles turn left, cover the hull, use all places, and their circles are empty."""
    points = exact(mesh.xy)
    area = Fraction(0)
    for triangle in mesh.triangles.tolist():
        a, b, c = (points[v] for v in triangle)
        assert side(a, b, c) > 0
        area += side(a, b, c)
        for p in points:
            inside = in_circle(a, b, c, p)
            assert inside <= 0
            if inside == 0 and p not in (a, b, c):  # the diagonal avoids the greatest
                assert_diagonal_rule(a, b, c, p)
    assert area == twice_hull_area(points)
    assert set(mesh.triangles.ravel().tolist()) == set(mesh.duplicate_of.tolist())
    assert_neighbours_agree(mesh)


def assert_diagonal_rule(a: Point, b: Point, c: Point, p: Point) -> None:
    """Of four on a circle the greatest is no end of the diagonal, if abc and p share an edge."""
    for u, v, w in ((a, b, c), (b, c, a), (c, a, b)):
        if side(u, v, p) < 0:  # p is across edge uv, which is then the diagonal or overlain
            assert max(a, b, c, p) in (w, p)


small = st.lists(
    st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=3, max_size=25, unique=True
).map(lambda points: np.array(points, float))
scales = st.sampled_from([(1.0, 0.0), (0.1, 5e6), (0.001, 5e6 + 0.05), (1 / 3, -7e5), (1e-30, 0)])


def spans(xy: Floats) -> bool:
    a, *others = exact(xy)
    return any(side(a, b, c) != 0 for b in others for c in others)


@settings(max_examples=80)
@given(small, scales)
def test_circles_are_empty_in_exact_arithmetic(xy: Floats, scale: tuple[float, float]) -> None:
    xy = xy * scale[0] + scale[1]
    if spans(xy):
        assert_delaunay(triangulate(xy))
    else:
        with pytest.raises(DataError, match="do not span a triangle"):
            triangulate(xy)


@settings(max_examples=50)
@given(small, st.integers(2, 25), st.randoms())
def test_rounds_and_order_make_no_difference(xy: Floats, cut: int, random: object) -> None:
    if not spans(xy):
        return
    order = np.random.default_rng(cut).permutation(len(xy))
    live = LiveMesh(xy)
    if spans(xy[order[:cut]]):
        live.insert(order[:cut])
    live.insert(order)
    assert_delaunay(live.mesh())
    assert as_places(live.mesh()) == as_places(triangulate(xy)) == as_places(triangulate(xy[order]))


@pytest.mark.parametrize("n", [3, 4, 5, 10, 100, 20_000])
def test_same_triangles_as_scipy(n: int) -> None:
    xy = scattered(n)
    mesh = triangulate(xy)
    assert np.array_equal(sorted_rows(mesh.triangles), sorted_rows(Delaunay(xy).simplices))
    assert_neighbours_agree(mesh)


@pytest.mark.parametrize("strip", [3, 40, 700])
@pytest.mark.parametrize("kind", ["random", "gridded", "flat", "tall", "circle", "columns"])
def test_strips_sewn_together_are_the_triangulation(
    strip: int, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(strip)
    angle = rng.uniform(0, 7, 1500)
    xy = {
        "random": rng.uniform(0, 100, (1500, 2)) + np.array([6e5, 5.2e6]),
        "gridded": np.round(rng.uniform(0, 40, (1500, 2))),
        "flat": rng.uniform(0, (1000, 1), (1500, 2)),
        "tall": rng.uniform(0, (1, 1000), (1500, 2)),
        "circle": 50 * np.column_stack([np.cos(angle), np.sin(angle)]),
        "columns": rng.uniform(0, 50, (1500, 2)) // [10, 0.01] * [10, 1],
    }[kind]
    xy = shuffled(np.concatenate([xy, xy[::7]]))
    whole = triangulate(xy)
    monkeypatch.setattr(delaunay.strips, "STRIP", strip)
    mesh = triangulate(xy)
    assert np.array_equal(sorted_rows(mesh.triangles), sorted_rows(whole.triangles))
    assert np.array_equal(mesh.duplicate_of, whole.duplicate_of)
    assert_neighbours_agree(mesh)
    other = triangulate(shuffled(xy))  # no number depends on the order, nor where one begins
    assert np.array_equal(mesh.xy[mesh.triangles], other.xy[other.triangles])


@pytest.mark.parametrize("size", [2, 500])
def test_strips_of_a_line(size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(delaunay.strips, "STRIP", 1)
    with pytest.raises(DataError, match=f"{size}.* do not span a triangle"):
        triangulate(np.column_stack([np.arange(float(size))] * 2))


def test_survey_coordinates_in_millimetres() -> None:
    """Far from the origin, many pairs a few millimetres apart: each edge is locally Delaunay."""
    xy = np.round(scattered(400) * 30, 3)
    xy = np.concatenate([xy, xy[:200] + np.array([0.001, -0.002])])
    xy += 500_000, 5_200_000
    mesh = triangulate(xy)
    points = exact(xy)
    area = Fraction(0)
    for corners, across in zip(mesh.triangles.tolist(), mesh.neighbours.tolist(), strict=True):
        a, b, c = (points[v] for v in corners)
        area += side(a, b, c)
        for t in across:
            far = {*mesh.triangles[t].tolist()} - {*corners} if t >= 0 else set()
            assert all(in_circle(a, b, c, points[v]) <= 0 for v in far)
    assert area == twice_hull_area(points)
    assert_neighbours_agree(mesh)


@pytest.mark.parametrize(("cell", "offset"), [(1.0, 0.0), (0.1, 5e6), (1 / 3, 7e5)])
def test_cells_of_a_grid_are_cut_from_upper_left_to_lower_right(cell: float, offset: float) -> None:
    rows = cols = 200
    xy = grid(rows, cols)
    order = np.random.default_rng(5).permutation(len(xy))
    mesh = triangulate((xy * cell + offset)[order])
    west = (np.arange(rows - 1)[:, None] * cols + np.arange(cols - 1)).ravel()
    lower = np.column_stack([west, west + 1, west + cols])
    upper = np.column_stack([west + 1, west + cols, west + cols + 1])
    expected = np.concatenate([lower, upper])
    assert np.array_equal(sorted_rows(order[mesh.triangles]), sorted_rows(expected))


def test_points_on_one_circle() -> None:
    """All triples of whole numbers with x² + y² = 65², and the centre last or first."""
    r = 65
    whole = np.arange(-r, r + 1)
    y = np.sqrt(r**2 - whole**2).round().astype(int)
    on = whole**2 + y**2 == r**2
    circle = np.concatenate([np.c_[whole, y][on], np.c_[whole, -y][on]]).astype(float)
    circle = np.unique(circle, axis=0)
    assert len(circle) == 36
    assert_delaunay(triangulate(shuffled(circle)))
    hub = LiveMesh(np.concatenate([circle, [[0.0, 0.0]]]))
    hub.insert(np.arange(len(circle)))
    changed = hub.insert(np.array([len(circle)]))
    assert len(changed) == len(circle) == len(hub.mesh().triangles)


@pytest.mark.parametrize("point", [(0.5, 1e-9), (-3.0, 2.0), (7.0, -1e-30)])
def test_a_line_and_one_point(point: tuple[float, float]) -> None:
    line = np.column_stack([np.arange(50.0), np.zeros(50)])
    mesh = triangulate(shuffled(np.concatenate([line, [point]])))
    assert len(mesh.triangles) == 49
    assert_delaunay(mesh)


def test_slanted_line_whose_points_are_rounded() -> None:
    """Points that are collinear but for rounding: slivers, of which none may be lost."""
    t = np.arange(60.0)
    assert_delaunay(triangulate(np.column_stack([5e6 + 0.1 * t, 6e5 + 0.3 * t])))


def test_duplicates_are_of_the_first() -> None:
    xy = scattered(60)
    xy[40:] = xy[:20]
    xy[50:] = xy[50]
    xy = shuffled(xy)
    mesh = triangulate(xy)
    first = np.array([np.flatnonzero((xy == p).all(axis=1))[0] for p in xy])
    assert np.array_equal(mesh.duplicate_of, first)
    assert_delaunay(mesh)


def test_the_two_zeros_are_one_place() -> None:
    mesh = triangulate(np.array([(0.0, -0.0), (1.0, 0.0), (-0.0, 0.0), (0.0, 1.0)]))
    assert mesh.duplicate_of.tolist() == [0, 1, 0, 3]


def test_hull_is_the_convex_hull() -> None:
    xy = scattered(5000)
    mesh = triangulate(xy)
    t, k = np.nonzero(mesh.neighbours < 0)
    ends = mesh.triangles[t, (k + 1) % 3], mesh.triangles[t, (k + 2) % 3]
    assert np.array_equal(sorted_rows(np.column_stack(ends)), sorted_rows(ConvexHull(xy).simplices))


def test_stray_point_far_away() -> None:
    """All other points share a few cells of the curve."""
    xy = np.concatenate([scattered(3000), [[2e8, 1e8]]])
    assert len(triangulate(xy).triangles) == 2 * len(xy) - 2 - len(ConvexHull(xy).vertices)


@pytest.mark.parametrize(
    ("xy", "text"),
    [
        (np.empty((0, 2)), "points: 0 do not span"),
        (scattered(2), "points: 2 do not span"),
        (np.full((9, 2), 7.0), "points: all 9 lie on one line"),
        (np.column_stack([np.arange(9.0)] * 2), "points: all 9 lie on one line"),
    ],
)
def test_no_triangle(xy: Floats, text: str) -> None:
    with pytest.raises(DataError, match=text):
        triangulate(xy)


@pytest.mark.parametrize(
    ("value", "text"),
    [(np.nan, "finite.* y = nan at point 4"), (1e60, "1e-50 to 1e\\+50"), (-1e-60, "y = -1e-60")],
)
def test_coordinates_that_cannot_be(value: float, text: str) -> None:
    xy = scattered(9)
    mesh = triangulate(xy)
    xy[4, 1] = value
    for call in (triangulate, LiveMesh, mesh.locate):
        with pytest.raises(ValueError, match=text):
            call(xy)


# Exact arithmetic of the kernels

floats = st.floats(-1e6, 1e6).filter(lambda x: x == 0 or abs(x) > 1e-40)


@settings(max_examples=300)
@given(st.lists(floats, min_size=8, max_size=8), st.integers(0, 3), st.integers(-2, 2))
def test_signs_are_exact(numbers: list[float], kind: int, ulps: int) -> None:
    """Any numbers; on a line but for some ulps; corners of rectangles, of parallelograms."""
    a, b, c, d = np.reshape(numbers, (4, 2))
    if kind == 1:
        c, d = (a + b) / 2, a + (b - a) / 3
    if kind == 2:
        c, d = np.array([a[0], b[1]]), np.array([b[0], a[1]])
    if kind == 3:
        d = a + c - b
    d = d + ulps * np.where(d == 0, 0, np.spacing(d))  # the smallest float would underflow
    points = exact(np.array([a, b, c, d]))
    assert np.sign(called_orient(*a, *b, *d)) == np.sign(side(points[0], points[1], points[3]))
    assert np.sign(called_orient_exact(*a, *b, *d)) == np.sign(
        side(points[0], points[1], points[3])
    )
    circle = in_circle(*points)
    assert np.sign(called_circle_exact(*a, *b, *c, *d)) == np.sign(circle)
    if side(*points[:3]) > 0 and circle != 0:
        assert called_in_circle(*a, *b, *c, *d) == (circle > 0)


# Places in the mesh


def hits(mesh: Mesh, place: Point) -> list[int]:
    """All triangles that hold a place."""
    points = exact(mesh.xy)
    found = []
    for t, corners in enumerate(mesh.triangles.tolist()):
        a, b, c = (points[v] for v in corners)
        if min(side(a, b, place), side(b, c, place), side(c, a, place)) >= 0:
            found.append(t)
    return found


@settings(max_examples=25)
@given(small, st.lists(st.tuples(st.integers(-2, 14), st.integers(-2, 14)), min_size=1))
def test_locate_against_brute_force(xy: Floats, places: list[tuple[int, int]]) -> None:
    """Places at vertices, on edges, on and outside the hull."""
    if not spans(xy):
        return
    mesh, live = triangulate(xy), LiveMesh(xy)
    live.insert(np.arange(len(xy)))
    where = np.array(places) / 2.0
    found, found_live = mesh.locate(where), live.locate(where)
    hair = Fraction(1, 10**6)
    for place, t, s in zip(exact(where), found, found_live, strict=True):
        right = hits(mesh, (place[0] + hair, place[1] + hair**2))
        held = hits(mesh, place)
        assert t in (right if right and held else held or [-1])
        corners = frozenset(mesh.triangles[t].tolist()) if t >= 0 else frozenset()
        corners_live = frozenset(live.triangles[s].tolist()) if s >= 0 else frozenset()
        assert corners == corners_live
    assert np.array_equal(mesh.locate(where[::-1]), found[::-1])


@pytest.mark.parametrize("corner", [(0.0, 0.0), (9.0, 0.0), (0.0, 9.0), (9.0, 9.0), (9.0, 4.0)])
def test_any_hint_leads_to_the_same_triangle(corner: tuple[float, float]) -> None:
    extra = [[3.3, 4.4], [8.5, 8.6], [8.4, 0.3], [8.5, 3.8], [8.5, 4.2]]
    mesh = triangulate(np.concatenate([grid(10, 10), extra]))
    arrays = mesh.xy, mesh.triangles, mesh.neighbours
    assert len({called_locate(*arrays, *corner, hint) for hint in range(len(mesh.triangles))}) == 1


def test_plane_is_reproduced() -> None:
    xy = scattered(5000) * 1000 + [7e5, 5e6]
    mesh = triangulate(xy)
    places = scattered(20_000, seed=3) * 1100 + [7e5 - 50, 5e6 - 50]

    def plane(at: Floats) -> Floats:
        return 300 + 0.3 * (at[:, 0] - 7e5) - 0.1 * (at[:, 1] - 5e6)

    values = mesh.interpolate(plane(xy), places)
    inside = mesh.locate(places) >= 0
    assert np.array_equal(np.isnan(values), ~inside)
    assert 0.7 < inside.mean() < 0.9
    assert np.allclose(values[inside], plane(places)[inside], rtol=0, atol=1e-7)


def test_a_vertex_has_exactly_its_value() -> None:
    xy = shuffled(np.concatenate([scattered(500), grid(20, 20)]))
    z = np.random.default_rng(4).random(len(xy))
    assert np.array_equal(triangulate(xy).interpolate(z, xy), z)


def test_slivers_interpolate_between_their_values() -> None:
    """Their areas are smaller than the rounding errors of a plain formula."""
    t = np.arange(60.0)
    mesh = triangulate(np.column_stack([0.1 * t, 0.3 * t]))
    share = np.random.default_rng(6).dirichlet([1, 1, 1], (len(mesh.triangles), 50))
    places = (share @ mesh.xy[mesh.triangles]).reshape(-1, 2)
    found = mesh.locate(places)
    values = mesh.interpolate(t, places)[found >= 0]
    corners = t[mesh.triangles[found[found >= 0]]]
    assert len(values) > 100
    assert (values >= corners.min(axis=1) - 1e-9).all()
    assert (values <= corners.max(axis=1) + 1e-9).all()


def test_one_value_per_point() -> None:
    with pytest.raises(ValueError, match=r"values: must have shape \(9,\)"):
        triangulate(scattered(9)).interpolate(np.zeros(8), scattered(2))


def test_no_places() -> None:
    mesh = triangulate(scattered(9))
    assert mesh.locate(np.empty((0, 2))).shape == (0,)
    assert mesh.interpolate(np.zeros(9), np.empty((0, 2))).shape == (0,)


# A mesh that grows


def grown(n: int = 3000, rounds: int = 5) -> tuple[LiveMesh, Floats]:
    xy = scattered(n)
    live = LiveMesh(xy)
    for part in np.array_split(np.arange(n), rounds):
        live.insert(part)
    return live, xy


def test_rounds_make_the_same_mesh_as_one_call() -> None:
    live, xy = grown()
    assert as_places(live.mesh()) == as_places(triangulate(xy))
    assert_neighbours_agree(live.mesh())
    assert np.array_equal(live.duplicate_of, np.arange(len(xy)))


def test_ghosts_close_the_mesh() -> None:
    live, xy = grown()
    ghost = (live.triangles < 0).any(axis=1)
    assert len(live.triangles) == 2 * len(xy) - 2  # Euler, with the vertex at infinity
    assert (live.triangles[:, 0] >= 0).all()
    hull = live.triangles[ghost]
    assert np.array_equal(np.unique(hull[hull >= 0]), np.sort(ConvexHull(xy).vertices))
    assert [called_is_ghost(live.triangles, t) for t in range(len(ghost))] == ghost.tolist()
    back = live.neighbours[live.neighbours]
    assert ((back == np.arange(len(back))[:, None, None]).sum(axis=2) == 1).all()


def test_what_did_not_change_is_as_before() -> None:
    xy = scattered(3000)
    live = LiveMesh(xy)
    live.insert(np.arange(2000))
    before = live.triangles.copy()
    changed = live.insert(np.arange(2000, 2050))
    after = live.triangles
    rest = np.setdiff1d(np.arange(len(after)), changed)
    assert 4 * 50 < len(changed) < 10 * 50
    assert (rest < len(before)).all()
    assert np.array_equal(after[rest], before[rest])
    assert np.isin(np.arange(2000, 2050), after[changed]).all()
    assert np.array_equal(live.round_of, np.repeat([0, 1, -1], [2000, 50, 950]))
    assert (live.round_of[after[changed, 0]] == 1).all()


def test_equal_points_in_later_rounds() -> None:
    xy = scattered(20)
    xy[15:] = xy[:5]
    live = LiveMesh(xy)
    live.insert(np.arange(10))
    assert live.duplicate_of[15] == -1
    assert len(live.insert(np.arange(15, 20))) == 0
    assert live.duplicate_of[15:].tolist() == [0, 1, 2, 3, 4]
    assert (live.round_of[15:] == -1).all()
    assert len(live.insert(np.arange(10))) == 0
    assert (live.round_of[:10] == 0).all()


def test_the_star_of_a_new_vertex_is_all_that_changes() -> None:
    xy = scattered(1000)
    xy[999] = xy[7]
    live = LiveMesh(xy)
    live.insert(np.arange(900))
    for point in range(900, 999):
        before = live.triangles.copy()
        around = [called_insert(live.arrays, np.int32(point), 0)]
        while (t := live.neighbours[around[-1], 1]) != around[0]:
            around.append(t)
        assert (live.triangles[around, 0] == point).all()
        assert np.count_nonzero(live.triangles == point) == len(around)
        rest = np.setdiff1d(np.arange(len(before)), around)
        assert np.array_equal(live.triangles[rest], before[rest])
    assert called_insert(live.arrays, np.int32(999), 0) == ~7
    assert as_places(live.mesh()) == as_places(triangulate(xy))


def test_first_round_must_span_a_triangle() -> None:
    live = LiveMesh(grid(5, 5))
    with pytest.raises(DataError, match="all 5 lie on one line"):
        live.insert(np.arange(5))
    live.insert(np.arange(25))
    assert len(live.mesh().triangles) == 32


def test_index_that_is_no_point() -> None:
    with pytest.raises(IndexError, match="must be 0 to 8, got 3 to 9"):
        LiveMesh(scattered(9)).insert(np.array([3, 9]))


# Manners


def test_arrays_are_read_only_and_the_input_is_kept() -> None:
    xy = scattered(100)
    before = xy.copy()
    mesh = triangulate(xy)
    for array in (mesh.xy, mesh.triangles, mesh.neighbours, mesh.duplicate_of):
        assert not array.flags.writeable
    assert np.array_equal(xy, before)
    assert xy.flags.writeable


def test_columns_of_a_cloud() -> None:
    xyz = np.column_stack([scattered(100), np.zeros(100)])
    assert as_places(triangulate(xyz[:, :2])) == as_places(triangulate(scattered(100)))


def test_progress_rises_and_any_moment_can_be_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(delaunay, "RUN", 50)
    xy = scattered(501)
    mesh = triangulate(xy)
    calls: list[Callable[[Context], object]] = [
        lambda ctx: triangulate(xy, ctx=ctx),
        lambda ctx: LiveMesh(xy).insert(np.arange(len(xy)), ctx=ctx),
        lambda ctx: mesh.interpolate(xy[:, 0], xy, ctx=ctx),
    ]
    for call in calls:
        seen: list[float] = []
        call(Context(report=seen.append))
        assert len(seen) > 22  # twice at least for each run of points
        assert seen == sorted(seen)
        assert seen[-1] == pytest.approx(1)
        for moment in range(len(seen)):
            asked = iter(range(len(seen)))
            with pytest.raises(Cancelled):
                call(Context(stop=lambda asked=asked, moment=moment: next(asked) == moment))
