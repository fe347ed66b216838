"""Densification of a triangulation: scenes with a known answer, each setting, bad input."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS
from scenes import towns
from scenes.layers import cloud
from scenes.towns import EAST, NORTH, inside

from algorithms.ground import _ptd_kernels as kernels
from algorithms.ground.ptd import GroundPtd, Growth, densified, ground_mask, heights_on
from toolbox.context import QUIET
from toolbox.data import Lattice, PointCloud
from toolbox.declare import ClassList
from toolbox.errors import DataError

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
THREADS = numba.get_num_threads()
FOOT = 1200 / 3937


def ground_of(height: Callable[[Floats, Floats], Floats], side: float = 80.0) -> Floats:
    """Jittered points on a surface, far from the origin."""
    x, y = (axis.round(3) for axis in towns.jittered(side, 0.8))
    return np.column_stack([x + EAST, y + NORTH, (300 + height(x, y)).round(3)])


def tilted(x: Floats, y: Floats) -> Floats:
    return 0.05 * x + 0.03 * y


def town() -> tuple[Floats, Mask]:
    """A tilted plane with three boxes and no ground under them; what is roof."""
    boxes = {(10, 20, 10, 25): 4, (38, 68, 20, 60): 8, (15, 19, 50, 54): 5}
    return towns.town(ground_of(tilted), boxes)


def labels(xyz: Floats, **settings: Any) -> Mask:
    return ground_mask(xyz, densified(xyz, **settings))


@pytest.mark.parametrize("thresholds", ["facets", "median"])
def test_buildings_on_a_tilted_plane_are_told_from_it(thresholds: str) -> None:
    xyz, roof = town()
    np.testing.assert_array_equal(labels(xyz, thresholds=thresholds), ~roof)


def test_a_hall_that_fills_its_seed_cell_is_found_out() -> None:
    """Seeds on a roof start a patch that drops on all sides."""
    xyz = ground_of(tilted, side=120)
    hall = inside(xyz, (30, 70, 35, 75))
    xyz[hall, 2] += 7
    found = labels(xyz, max_building_size=30.0)
    assert found[hall].mean() < 0.01
    assert found[~hall].mean() > 0.99


def test_a_terrace_is_ground_on_both_levels_if_points_are_mirrored() -> None:
    xyz = ground_of(lambda x, y: tilted(x, y) + np.where(x > 62, 4.0, 0.0), side=160)
    assert labels(xyz).mean() > 0.99
    assert labels(xyz, mirror=False).mean() < labels(xyz).mean()


def test_points_on_the_walls_of_a_hall_do_not_let_its_roof_in() -> None:
    """They enter one above the other; mirrored at them, the roof would follow."""
    rng = np.random.default_rng(1)
    xyz = ground_of(tilted, 120)
    hall, inner = inside(xyz, (30, 65, 30, 90)), inside(xyz, (31.5, 63.5, 31.5, 88.5))
    wall = hall & ~inner & (rng.random(len(xyz)) < 0.9)
    xyz[hall, 2] += 4
    xyz[wall, 2] -= rng.uniform(0, 4, wall.sum())
    found = labels(xyz)
    assert found[hall & ~wall].mean() < 0.01
    assert found[~hall].mean() > 0.99


@pytest.mark.parametrize("east", [0, 17, 31, 44])
def test_a_row_of_terraces_wherever_the_seed_grid_falls(east: int) -> None:
    xyz = ground_of(lambda x, y: 0.3 * x + 2 * np.floor(x / 15), side=120)
    assert labels(xyz + np.array([east, 2 * east, 0])).mean() > 0.98


@pytest.mark.parametrize("rise", [0.3, 0.5, 1.0])
def test_a_slope_is_ground_up_to_the_end_of_the_data(rise: float) -> None:
    xyz = ground_of(lambda x, y: rise * x + 2 * np.sin(y / 15), side=120)
    assert labels(xyz).mean() > 0.999


def test_a_steep_slope_is_ground_and_its_shrubs_are_not() -> None:
    xyz = ground_of(lambda x, y: 0.5 * x + 2 * np.sin(y / 15))
    shrub = np.random.default_rng(2).random(len(xyz)) < 0.1
    xyz[shrub, 2] += 2.5
    found = labels(xyz)
    assert found[~shrub].mean() > 0.98
    assert found[shrub].mean() < 0.05


def test_low_outliers_do_not_pull_the_surface_down() -> None:
    xyz, roof = town()
    low = np.argmin(np.hypot(xyz[:, 0] - EAST - 30, xyz[:, 1] - NORTH - 8))
    xyz[low, 2] -= 20
    expected = ~roof
    expected[low] = False
    np.testing.assert_array_equal(labels(xyz), expected)


@pytest.mark.parametrize("thresholds", ["facets", "median"])
def test_order_duplicates_and_equal_heights_do_not_matter(thresholds: str) -> None:
    xyz = np.concatenate([town()[0], rough() + np.array([200, 0, 0])])
    xyz = np.concatenate([xyz, xyz[:500]])
    xyz[:, 2] = xyz[:, 2].round(1)
    order = np.random.default_rng(3).permutation(len(xyz))
    found = labels(xyz, thresholds=thresholds)
    np.testing.assert_array_equal(labels(xyz[order], thresholds=thresholds), found[order])


@pytest.mark.skipif(THREADS < 2, reason="one thread only")
@pytest.mark.parametrize("thresholds", ["facets", "median"])
def test_the_number_of_threads_does_not_matter(thresholds: str) -> None:
    xyz, _ = town()
    try:
        numba.set_num_threads(1)
        one = labels(xyz, thresholds=thresholds)
        numba.set_num_threads(2)
        np.testing.assert_array_equal(labels(xyz, thresholds=thresholds), one)
    finally:
        numba.set_num_threads(THREADS)


def test_a_regular_lattice_of_points() -> None:
    """All corners of four on one circle, and all nearest neighbours at equal distance."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(80.0), np.arange(80.0)))
    xyz = np.column_stack([x, y, 0.1 * x])
    roof = (abs(x - 40) < 10) & (abs(y - 40) < 10)
    xyz[roof, 2] += 6
    order = np.random.default_rng(4).permutation(len(xyz))
    found = labels(xyz)
    np.testing.assert_array_equal(found, ~roof)
    np.testing.assert_array_equal(labels(xyz[order]), found[order])


def test_points_in_one_cell_on_a_line_and_on_a_wall() -> None:
    cell = np.array([[5.1, 5.1, 1.0], [5.2, 5.1, 1.3], [5.1, 5.2, 4.0], [5.1, 5.1, 1.0]])
    np.testing.assert_array_equal(labels(cell), [True, True, False, True])
    line = np.column_stack([np.arange(90.0), np.arange(90.0), np.zeros(90)])
    assert labels(line).all()
    height = np.tile(np.arange(0.0, 10, 0.1), 20)
    wall = np.column_stack([np.repeat(np.arange(20.0), 100), np.full(2000, 7.0), height])
    np.testing.assert_array_equal(labels(wall), height <= 0.4)


def test_no_points_and_bad_coordinates() -> None:
    with pytest.raises(DataError, match="points: there are none"):
        densified(np.empty((0, 3)))
    xyz, _ = town()
    for bad in (np.nan, np.inf):
        xyz[7, 1] = bad
        with pytest.raises(ValueError, match=rf"finite numbers, got y = {bad} at point 7"):
            densified(xyz)


def test_a_stray_point_far_away_is_refused() -> None:
    xyz = np.vstack([town()[0], [[900_000.0, 5_000_000.0, 300.0]]])
    with pytest.raises(DataError, match="remove stray points"):
        densified(xyz)


def test_the_surface_is_the_terrain_under_roofs_too() -> None:
    xyz, _ = town()
    lattice = Lattice.cover((EAST, NORTH, EAST + 80, NORTH + 80), 4.0)
    heights = heights_on(densified(xyz), lattice)
    x, y = lattice.centres()
    expected = 300 + tilted(x - EAST, (y - NORTH)[:, None])
    np.testing.assert_allclose(heights, expected, atol=0.02)
    beyond = Lattice.cover((EAST - 400, NORTH, EAST - 300, NORTH + 80), 4.0)
    assert np.isnan(heights_on(densified(xyz), beyond)).all()


def test_the_surface_of_the_tool_covers_the_points_in_its_cells() -> None:
    xyz, _ = town()
    far = np.array([[EAST + 5000.0, NORTH, 300.0]])  # ignored: it must not widen the surface
    classes = [0] * len(xyz) + [7]
    out = GroundPtd(
        points=cloud(np.vstack([xyz, far]), classes), ignore=ClassList([7]), cell=2.0
    ).run()
    assert out.surface.shape == (40, 40)
    assert out.surface.cell == 2.0
    lattice = Lattice.of(out.surface)
    np.testing.assert_array_equal(out.surface.values[0], heights_on(densified(xyz), lattice))


def rough() -> Floats:
    """Waves, a terrace, plants of all heights and a hall: every setting matters somewhere."""
    rng = np.random.default_rng(5)
    xyz = ground_of(lambda x, y: 3 * np.sin(x / 8) + 0.2 * y + np.where(y > 50, 3.0, 0.0), 120)
    plants = rng.random(len(xyz)) < 0.3
    xyz[plants, 2] += rng.uniform(0, 2.0, plants.sum())
    xyz[inside(xyz, (30, 65, 20, 45)), 2] += 5
    return xyz


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("max_building_size", 20.0),
        ("terrain_angle", 20.0),
        ("iteration_angle", 5.0),
        ("iteration_distance", 0.4),
        ("thresholds", "median"),
        ("reduce_angle_below", 0.0),
        ("stop_edge", 6.0),
        ("mirror", False),
        ("class_distance", 0.1),
    ],
)
def test_each_setting_of_the_tool_has_its_effect(name: str, value: Any) -> None:
    xyz = rough()
    plain = GroundPtd(points=cloud(xyz)).run().classified["classification"]
    out = GroundPtd(points=cloud(xyz), **{name: value}).run()
    surface = densified(xyz, **({} if name == "class_distance" else {name: value}))
    threshold = {name: value} if name == "class_distance" else {}
    expected = ground_mask(xyz, surface, **threshold)
    np.testing.assert_array_equal(out.classified["classification"], np.where(expected, 2, 1))
    assert out.ground_share == expected.mean()
    assert not np.array_equal(plain == 2, expected), "a setting without effect proves nothing"


@pytest.mark.parametrize("thresholds", ["facets", "median"])
def test_the_tool_in_feet_is_the_tool_in_metres(thresholds: Any) -> None:
    xyz = rough()
    metric = GroundPtd(points=cloud(xyz), thresholds=thresholds).run().classified["classification"]
    feet = GroundPtd(points=PointCloud(xyz / FOOT, crs=CRS(2263)), thresholds=thresholds).run()
    assert (feet.classified["classification"] == metric).mean() > 0.999


def test_ignored_classes_take_no_part_and_others_may_be_kept() -> None:
    xyz, roof = town()
    low = inside(xyz, (24, 28, 4, 8))
    xyz[low, 2] -= 3  # too many to be outliers
    before = np.where(low, 7, np.where(roof, 6, 5))
    out = GroundPtd(
        points=cloud(xyz, before), ignore=ClassList([7]), keep_classes=ClassList(range(256))
    ).run()
    found = out.classified["classification"]
    np.testing.assert_array_equal(found, np.where(low, 7, np.where(roof, 6, 2)))


def test_the_tool_reports_rounds(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO", "toolbox"):
        GroundPtd(points=cloud(town()[0])).run()
    assert " vertices after " in caplog.text


def test_the_reach_is_finite_and_follows_the_building_size() -> None:
    points = cloud(town()[0])
    assert 0 < GroundPtd(points=points).halo() < 150
    assert GroundPtd(points=points, max_building_size=30.0).halo() == pytest.approx(67.5)
    assert GroundPtd(points=points, thresholds="median").halo() == np.inf


def test_bumps_are_ground_thanks_to_seed_grids_with_a_wider_angle() -> None:
    xyz = ground_of(lambda x, y: 2.5 * np.sin(x / 5) * np.sin(y / 5), 120)
    assert labels(xyz, mirror=False).mean() > 0.99


def grown(xyz: Floats, metre: float = 1.0, through: Any = slice(None)) -> Growth:
    """The surface through the points, or some of them."""
    growth = Growth(xyz, metre)
    growth.start(np.arange(len(xyz))[through], QUIET)
    return growth


def fine_lattice(height: Callable[[Floats, Floats], Any], side: float = 20.0) -> Floats:
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0.0, side, 0.5), np.arange(0.0, side, 0.5)))
    return np.column_stack([x, y, np.broadcast_to(height(x, y), x.shape)])


def on(x: Floats, y: Floats, west: float, east: float, south: float, north: float) -> Mask:
    return (x >= west) & (x < east) & (y >= south) & (y < north)


def beside_higher_ground(north: float) -> Callable[[Floats, Floats], Floats]:
    """A block of 3 m; on its west side, up to `north`, ground of 6 m."""
    return lambda x, y: 3.0 * on(x, y, 5, 13, 5, 13) + 6.0 * on(x, y, 0, 5, 0, north)


@pytest.mark.parametrize("metre", [1.0, 1 / FOOT])
@pytest.mark.parametrize(
    ("height", "extent", "raised"),
    [
        (lambda x, y: 3 * on(x, y, 5, 13, 5, 13), 8.0, True),
        (lambda x, y: 3 * on(x, y, 5, 13, 5, 13), 7.0, False),  # too wide
        (lambda x, y: 3 * on(y, x, 5, 13, 4, 13), 8.0, False),  # too wide from south to north
        (lambda x, y: 1.1 * on(x, y, 5, 13, 5, 13), 8.0, True),
        (lambda x, y: 0.9 * on(x, y, 5, 13, 5, 13), 8.0, False),  # no wall
        (lambda x, y: -3 * on(x, y, 5, 13, 5, 13), 19.0, False),  # a pit
        (lambda x, y: 3 * on(x, y, 5, 13, 0, 13), 15.0, True),  # the data ends on one side of four
        (lambda x, y: 3 * on(x, y, 0, 8, 0, 8), 15.0, False),  # and on two
        (beside_higher_ground(20), 8.0, False),
        (beside_higher_ground(7), 8.0, True),
    ],
)
def test_what_is_a_raised_patch(height: Any, extent: float, raised: bool, metre: float) -> None:
    xyz = fine_lattice(height)
    expected = (xyz[:, 2] == xyz[22 + 40 * 22, 2]) if raised else np.zeros(len(xyz), bool)
    found = grown(xyz * metre, metre).raised(extent * metre, QUIET)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("turn", [0, 1])
@pytest.mark.parametrize(("extent", "raised"), [(8.0, False), (8.1, True)])
def test_the_first_and_the_last_vertex_count_for_the_width(
    extent: float, raised: bool, turn: int
) -> None:
    xyz = fine_lattice(lambda x, y: 3 * on(x, y, 5, 13, 5, 13))
    widest = np.argmin(np.hypot(xyz[:, 0] - 13, xyz[:, 1] - 9))
    xyz[widest, 2] = 3
    xyz = np.roll(xyz, -widest - 1 + turn, axis=0)
    found = grown(xyz).raised(extent, QUIET)
    np.testing.assert_array_equal(found, (xyz[:, 2] == 3) & raised)


@pytest.mark.parametrize(("rise", "raised"), [(0.6, False), (1.0, True)])
def test_the_top_of_a_hill_is_raised_if_its_sides_are_walls(rise: float, raised: bool) -> None:
    xyz = fine_lattice(lambda x, y: 0.0) * [4, 4, 1]  # steps of 2 m
    away = np.abs(xyz[:, :2] - 40).max(axis=1)
    xyz[:, 2] = rise * np.clip(30 - away, 0, 20)
    found = grown(xyz).raised(50.0, QUIET)
    np.testing.assert_array_equal(found, (away <= 10) & raised)


@pytest.mark.parametrize(("rise", "raised"), [(0.275, False), (0.5, True)])
def test_a_ramp_is_no_wall(rise: float, raised: bool) -> None:
    """However high the steps between its vertices, which are 4 m apart."""
    xyz = fine_lattice(lambda x, y: 0.0) * [8, 8, 1]
    x, y = xyz[:, 0], xyz[:, 1]
    xyz[:, 2] = on(x, y, 20, 160, 60, 100) * np.clip(12 - rise * (x - 56), 0, 12)
    found = grown(xyz).raised(60.0, QUIET)
    np.testing.assert_array_equal(found, (xyz[:, 2] == 12) & raised)


def test_taking_vertices_out_leaves_the_triangulation_of_the_others() -> None:
    rng = np.random.default_rng(6)
    xyz = rng.uniform(0, 40, (3000, 3))
    xyz[:1500] = np.round(xyz[:1500])  # many on common circles
    xyz = xyz[np.unique(xyz[:, :2], axis=0, return_index=True)[1]]
    vertex = rng.random(len(xyz)) < 0.6
    gone = vertex & ((rng.random(len(xyz)) < 0.1) | (np.abs(xyz[:, :2] - 20).max(axis=1) < 6))
    growth = grown(xyz, through=vertex)
    limits = kernels.PointLimits(
        angle=0.0, distance=0.0, steepest=0.0, stop=99.0, reduce=0.0, mirror=False, gentle=0.0
    )
    growth.grow(np.arange(len(xyz)), limits, QUIET)
    waiting = growth.take_out(gone)
    fresh = grown(xyz, through=vertex & ~gone)
    np.testing.assert_array_equal(triangles(growth), triangles(fresh))
    np.testing.assert_allclose(growth.z, fresh.z)  # the ring, too
    neighbours, size = growth.mesh.neighbours, growth.mesh.arrays.size[0]
    for t, k in np.ndindex(size, 3):
        shared = np.isin(growth.mesh.triangles[neighbours[t, k]], growth.mesh.triangles[t])
        assert shared.sum() == 2
        assert growth.mesh.triangles[t, k] not in growth.mesh.triangles[neighbours[t, k]]
    assert not gone[waiting].any()
    growth.settle(waiting, limits, QUIET)
    left = np.flatnonzero(~vertex)
    np.testing.assert_array_equal(growth.facet[left], growth.mesh.locate(xyz[left, :2]))
    facets, lists = np.arange(size), (growth.head, growth.following, growth.waiting)
    count = kernels.points_of(facets, *lists)
    np.testing.assert_array_equal(np.sort(growth.waiting[:count]), left)


def triangles(growth: Growth) -> Any:
    """Triangles by their sorted vertices, in order."""
    return np.unique(np.sort(growth.mesh.triangles, axis=1), axis=0)


@pytest.mark.parametrize(("rise", "slopes"), [(0.5, True), (2.0, False)])
def test_the_ring_goes_on_with_a_slope_that_is_no_wall(rise: float, slopes: bool) -> None:
    growth = grown(fine_lattice(lambda x, y: rise * x, 60.0))
    (x, y), z = growth.xy[growth.real :].T, growth.z[growth.real :]
    beside = (y >= 0) & (y <= 59.5)
    expected = rise * (x if slopes else np.clip(x, 0, 59.5))
    np.testing.assert_allclose(z[beside], expected[beside], atol=1e-9)


def test_the_ring_in_feet_is_that_in_metres() -> None:
    xyz = fine_lattice(lambda x, y: 0.5 * x, 60.0)
    metric, feet = grown(xyz), grown(xyz / FOOT, 1 / FOOT)
    np.testing.assert_allclose(feet.xy * FOOT, metric.xy, atol=1e-9)
    np.testing.assert_allclose(feet.z * FOOT, metric.z, atol=1e-9)


def test_the_ring_is_level_where_there_is_no_surface_to_go_on_from() -> None:
    """Behind a narrow strip there is only the ring itself."""
    growth = grown(np.array([[0.0, 0, 1], [3, 0, 2], [0, 60, 1], [3, 60, 2]]))
    before = growth.z.copy()
    assert set(before[growth.real :]) == {1.0, 2.0}
    growth.lift_ring()
    np.testing.assert_array_equal(growth.z, before)


def test_a_slope_at_the_rim_is_climbed_as_the_ring_rises_with_it() -> None:
    xyz = ground_of(lambda x, y: 0.5 * np.maximum(np.abs(x - 60) - 40, 0), 120)
    assert labels(xyz).mean() > 0.99


FINE = kernels.PointLimits(
    angle=10.0, distance=1.5, steepest=99.0, stop=1.0, reduce=5.0, mirror=True, gentle=1.2
)


@pytest.mark.parametrize(
    ("order", "expected"), [([4, 5], 4), ([5, 4], 4), ([4, 5, 6], 6), ([6, 5, 4], 6)]
)
def test_of_a_facet_the_lowest_point_enters(order: list[int], expected: int) -> None:
    """Of equal ones that with the least x."""
    corners = [[0, 0, 0], [40, 0, 0], [0, 40, 0], [40, 40, 0]]
    growth = grown(np.array([*corners, [10, 5, 0.3], [11, 5, 0.3], [12, 5, 0.2]]), through=range(4))
    chosen = growth.look(np.array(order), FINE, QUIET)
    np.testing.assert_array_equal(growth.best[chosen], [expected])


def square(*heights: float) -> Growth:
    """A level square of two facets, and points of these heights around one of its corners."""
    corners = np.array([[0, 0, 0], [40, 0, 0], [0, 40, 0], [40, 40, 0]])
    turn = np.linspace(0.3, 0.6, len(heights))
    points = np.column_stack([10 * np.cos(turn), 10 * np.sin(turn), heights])
    return grown(np.vstack([corners, points]), through=range(4))


@pytest.mark.parametrize(
    ("angle", "distance", "expected"),
    [
        (10.0, 1.5, (np.degrees(np.arctan(0.03)), 0.3)),
        (10.0, 0.2, (np.degrees(np.arctan(0.03)), 0.2)),  # the settings are upper limits
        (1.0, 1.5, (1.0, 0.3)),
    ],
)
def test_limits_are_lowered_to_medians_of_the_points_above_the_surface(
    angle: float, distance: float, expected: tuple[float, float]
) -> None:
    growth = square(0.1, -5.0, 0.3, 4.0, -0.2)
    limits = FINE._replace(angle=angle, distance=distance)
    found = growth.lowered(limits, np.arange(4, 9), QUIET)
    np.testing.assert_allclose((found.angle, found.distance), expected)
    assert found._replace(angle=angle, distance=distance) == limits
    assert growth.lowered(limits, np.array([5, 8]), QUIET) == limits  # none is above


def test_a_high_point_among_low_ones_keeps_the_settings_but_not_the_medians() -> None:
    heights = (0.1, 0.1, 0.1, 0.1, 0.6)
    medians = square(*heights).lowered(FINE, np.arange(4, 9), QUIET)
    for limits, expected in ((FINE, [8]), (medians, [])):
        growth = square(*heights)
        chosen = growth.look(np.array([8]), limits, QUIET)
        np.testing.assert_array_equal(growth.best[chosen], expected)


def test_points_are_looked_at_again_when_medians_rise() -> None:
    """Also on facets that no new vertex has changed: that of the high point, far from the rest."""
    corners = [[x, y, 0] for x in (0, 40, 200, 240) for y in (0, 40)]
    low = [[225, 20, 0.1], [235, 20, 0.1], [220, 5, 0.1]]
    growth = Growth(np.array([*corners, *low, [5, 20, 0.9]]), 1.0, "median")
    growth.start(np.arange(8), QUIET)
    assert growth.lowered(FINE, np.arange(8, 12), QUIET).distance == pytest.approx(0.1)
    growth.grow(np.arange(8, 12), FINE, QUIET)
    assert growth.entered.all()


def test_medians_take_the_place_of_the_rule_for_short_facets() -> None:
    xyz = rough()
    expected = labels(xyz, thresholds="median", reduce_angle_below=0.0)
    np.testing.assert_array_equal(labels(xyz, thresholds="median"), expected)


@pytest.mark.parametrize(
    ("height", "steepest", "enters"),
    [
        (4.1, 1.5, True),  # the way down to the highest corner is steeper
        (4.1, 0.5, False),
        (3.9, 0.5, True),  # below the facet, at 4 m there, anything enters
        (-2.0, 0.5, True),  # however deep
        (8.0, 99.0, False),  # but not so high
    ],
)
def test_what_enters_a_steep_facet(height: float, steepest: float, enters: bool) -> None:
    corners = [[-4, 0, 0], [4, 0, 0], [0, 6, 12]]
    growth = grown(np.array([*corners, [0, 2, height]]), through=range(3))
    limits = FINE._replace(steepest=steepest, mirror=False)
    assert len(growth.look(np.array([3]), limits, QUIET)) == enters


def test_it_makes_no_difference_at_which_corner_a_facet_begins() -> None:
    """Nor which of two equally high corners comes first."""
    xyz = fine_lattice(lambda x, y: 1.0 * np.floor(x / 5)) * [4, 4, 1]
    vertex = np.random.default_rng(7).random(len(xyz)) < 0.3
    found = []
    for turn in range(3):
        growth = grown(xyz, through=vertex)
        triangles, neighbours = growth.mesh.arrays.triangles, growth.mesh.arrays.neighbours
        real = growth.mesh.triangles.min(axis=1) >= 0
        for array in (triangles, neighbours):
            array[: len(real)][real] = np.roll(array[: len(real)][real], turn, axis=1)
        chosen = growth.look(np.flatnonzero(~vertex), FINE, QUIET)
        found.append(np.sort(growth.best[chosen]))
    np.testing.assert_array_equal(found[1], found[0])
    np.testing.assert_array_equal(found[2], found[0])


def test_the_ring_takes_the_nearest_vertex_however_far() -> None:
    xyz = np.array([[0.0, 0, 1], [150, 150, 2], [151, 150, 3], [300, 300, 4]])
    growth = grown(xyz)
    ring = growth.xy[growth.real :]
    away = np.hypot(*(ring[:, None] - xyz[:, :2]).T)
    np.testing.assert_array_equal(growth.nearest_to_ring(), away.argmin(axis=0))
