"""Robust interpolation: scenes with a known answer, the weights, the reach, bad input."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import towns
from scenes.layers import UTM, cloud
from scenes.towns import EAST, NORTH, Box, inside, isprs, terrain

from algorithms.ground import _robust_interpolation_kernels as kernels
from algorithms.ground.robust_interpolation import (
    GroundRaster,
    GroundRobustInterpolation,
    cells_of_levels,
    ground_mask,
    reach,
    residuals,
    robust_interpolation,
)
from algorithms.shared.lowest import outlier_reach
from toolbox.data import Lattice
from toolbox.errors import DataError

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
FOOT = 0.3048

# sample: total error in % that the defaults reach
ISPRS = {12: 2.84, 21: 1.28, 23: 7.93, 31: 1.38, 42: 2.12, 51: 2.21, 54: 3.02, 61: 3.08}


BOXES: dict[Box, float] = {(10, 20, 10, 25): 4.0, (32, 76, 25, 69): 8.0, (15, 19, 40, 44): 5.0}
plane = functools.partial(towns.plane, side=90.0)


def town() -> Floats:
    """The plane with three flat-roofed boxes of 4 to 8 m, the widest 44 m, no ground below."""
    return towns.town(plane(), BOXES)[0]


def on_roof(xyz: Floats) -> Mask:
    return towns.town(xyz, BOXES)[1]


def forest(side: float = 90.0, slope: float = 0.4) -> tuple[Floats, Mask]:
    """A steep rough slope of which few points reach the ground, and which do."""
    rng = np.random.default_rng(4)
    xyz = plane(side=side)
    x, y = xyz[:, 0] - EAST, xyz[:, 1] - NORTH
    xyz[:, 2] += slope * x + np.sin(x / 7) + np.cos(y / 5) + rng.normal(0, 0.05, len(xyz))
    ground = rng.random(len(xyz)) < 0.3
    xyz[~ground, 2] += rng.uniform(1.5, 20, np.count_nonzero(~ground))
    return xyz, ground


def hill() -> Floats:
    """The plane with a ridge 8 m high whose flanks are 40 % steep."""
    xyz = plane(side=120)
    xyz[:, 2] += np.clip(9 - 0.4 * np.abs(xyz[:, 0] - EAST - 60), 0, 8)
    return xyz


def labels(xyz: Floats, **options: Any) -> Mask:
    return ground_mask(xyz, robust_interpolation(xyz, **options))


def test_buildings_on_a_tilted_plane_are_told_from_it_exactly() -> None:
    xyz = town()
    np.testing.assert_array_equal(labels(xyz), ~on_roof(xyz))


def test_a_residual_is_positive_above_the_surface() -> None:
    """z - surface, whatever abstracts say: vegetation positive, ground about zero."""
    level = GroundRaster(np.full((4, 4), 50.0), Lattice(0.0, 4.0, 1.0, 4, 4))
    xyz = np.array([[2.0, 2.0, 53.0], [2.0, 2.0, 50.0], [2.0, 2.0, 48.5]])
    np.testing.assert_array_equal(residuals(xyz, level), [3.0, 0.0, -1.5])
    np.testing.assert_array_equal(ground_mask(xyz, level), [False, True, False])
    xyz, ground = forest()
    found = residuals(xyz, robust_interpolation(xyz))
    assert found[~ground].min() > 0
    assert np.median(found[~ground]) > 5
    assert abs(np.median(found[ground])) < 0.1


def test_weights_fall_above_the_shift_and_stay_below_it() -> None:
    """p = 1 / (1 + (a |r - g|)^b) with a = 1 / half width and b = 4 above g, cut off far away."""

    def weight(residual: float) -> float:
        return float(kernels.robust_weight.py_func(residual, -0.1, 0.2, 1.0))

    assert [weight(r) for r in (-0.9, -0.1)] == [1.0, 1.0]
    assert weight(0.1) == pytest.approx(1 / 2)
    assert weight(0.3) == pytest.approx(1 / 17)
    assert [weight(r) for r in (0.51, 9.0, -1.01, -50.0)] == [0, 0, 0, 0]


def test_a_level_is_the_trend_and_a_robust_plane_above_it() -> None:
    """Two levels of 12 and 6 m against the formulas solved with numpy."""
    xyz, _ = forest()
    settings: dict[str, Any] = {"building_size": 36.0, "half_width": 0.5, "relief": 0.0}
    trend = robust_interpolation(xyz, cell=12.0, **settings)
    surface = robust_interpolation(xyz, cell=6.0, **settings)
    used = xyz[ground_mask(xyz, trend, above=0.5, below=1 + 0.2 * 12)]
    lowest: dict[tuple[int, ...], Floats] = {}
    for point in used[np.argsort(-used[:, 2])]:
        lowest[tuple(np.floor(point[:2] / 6).astype(int))] = point
    x, y = surface.lattice.centres()
    for row, col in [(3, 5), (8, 8), (1, 1), (12, 4)]:
        node = np.array([x[col], y[row], 0.0])
        own = np.floor(node[:2] / 6).astype(int)
        near = [np.abs(np.subtract(cell, own)).max() <= 2 for cell in lowest]
        points = np.array(list(lowest.values()))[near]
        expected = plane_above(points, node, residuals(points, trend))
        expected -= residuals(node[None], trend)[0]
        assert surface.heights[row, col] == pytest.approx(expected, abs=1e-9)


def plane_above(points: Floats, node: Floats, z: Floats) -> float:
    """Height over the trend by four rounds of weighted least squares with nuggets."""
    offset = (points - node)[:, :2] / 6
    design = np.column_stack([np.ones(len(points)), offset])
    distance = np.clip(1 - (offset**2).sum(axis=1) / 9, 0, None) ** 2
    unknown = np.zeros(3)
    for _ in range(4):
        r = z - design @ unknown
        low = (r < 0) & (r >= -2.2)
        shift = np.average(r[low], weights=distance[low]) if low.any() else 0.0
        above = np.clip((r - shift) / 0.5, 0, None)
        weight = distance * (r >= -2.2) * (above <= 3) / (1 + above**4)
        normal = design.T @ (weight[:, None] * design) + np.diag([0.02, 0.1, 0.1])
        unknown = np.linalg.solve(normal, design.T @ (weight * z))
    return float(unknown[0])


def test_the_surface_comes_down_as_it_is_computed_again() -> None:
    """One level alone, where half of the lowest points are leaves."""
    xyz, ground = forest(slope=0.0)
    means = [
        float(
            residuals(xyz, robust_interpolation(xyz, building_size=1.0, iterations=n))[
                ground
            ].mean()
        )
        for n in (0, 2, 8)
    ]
    assert means[0] < -2
    assert means[0] < means[1] < means[2] < 0.1


def test_the_surface_runs_through_a_plane() -> None:
    surface = robust_interpolation(plane())
    x, y = np.meshgrid(*surface.lattice.centres())
    error = surface.heights - terrain(x - EAST, y - NORTH)
    assert np.abs(error[5:-5, 5:-5]).max() < 0.01
    assert np.abs(error).max() < 0.2  # no points around the outermost


def test_few_ground_points_in_a_forest_on_a_slope_are_found() -> None:
    xyz, ground = forest()
    found = labels(xyz)
    assert found[ground].mean() > 0.97
    assert found[~ground].mean() < 0.002


def test_coarse_cells_remove_what_is_as_wide_as_said() -> None:
    xyz = town()
    found = labels(xyz, building_size=15.0)
    assert found[inside(xyz, (48.0, 60.0, 41.0, 53.0))].all()
    assert not found[inside(xyz, (10, 20, 10, 25))].any()


def test_levels_go_down_and_those_for_vegetation_twice() -> None:
    assert cells_of_levels(1.0, 48.0) == [16, 8, 4, 2, 1, 4, 2, 1]
    assert cells_of_levels(0.5, 20.0) == [8, 4, 2, 1, 0.5, 4, 2, 1, 0.5]
    assert cells_of_levels(6.0, 60.0) == [24, 12, 6]
    assert cells_of_levels(2.0, 6.0) == [2]
    in_feet = cells_of_levels(1.25 / FOOT, 60 / FOOT, 1 / FOOT)
    np.testing.assert_allclose(np.multiply(in_feet, FOOT), [20, 10, 5, 2.5, 1.25, 2.5, 1.25])


def test_a_steep_ridge_stays_ground() -> None:
    xyz = hill()
    assert labels(xyz).mean() > 0.99
    assert labels(xyz, relief=0.02).mean() < 0.95


def test_a_terrace_is_ground_on_both_levels() -> None:
    xyz = plane()
    xyz[inside(xyz, (45.0, 99.0, -9.0, 99.0)), 2] += 3.0
    near_edge = inside(xyz, (43.0, 48.0, -9.0, 99.0))
    assert labels(xyz)[~near_edge].all()


def test_the_face_of_a_wall_is_not_ground() -> None:
    """A free-standing wall of 6 m, scanned on its face: many points over one line."""
    rng = np.random.default_rng(2)
    n = 3000
    wall = np.column_stack([np.full(n, EAST + 30.25), NORTH + rng.uniform(5, 85, n), np.zeros(n)])
    wall[:, 2] = terrain(wall[:, 0] - EAST, wall[:, 1] - NORTH) + rng.uniform(0.6, 6, n)
    xyz = np.vstack([plane(), wall])
    ground = labels(xyz)
    assert ground[:-n].all()
    assert not ground[-n:].any()


def test_the_surface_spans_a_gap() -> None:
    xyz = plane()
    gap = inside(xyz, (30.0, 60.0, 30.0, 60.0))
    surface = robust_interpolation(xyz[~gap])
    assert np.abs(residuals(xyz[gap], surface)).max() < 0.2
    assert ground_mask(xyz, surface).all()


def test_low_outliers_do_not_pull_the_surface_down() -> None:
    """Single ones, and a patch of 30 as multipath makes them."""
    xyz = town()
    clean = labels(xyz)
    middle = np.hypot(xyz[:, 0] - EAST - 27, xyz[:, 1] - NORTH - 10).argsort()
    for count, depth in [(2, 5.0), (2, 50.0), (30, 8.0), (30, 40.0)]:
        low = middle[:count]
        bad = xyz.copy()
        bad[low, 2] -= depth
        ground = labels(bad)
        assert not ground[low].any()
        np.testing.assert_array_equal(np.delete(ground, low), np.delete(clean, low))


def test_a_low_outlier_in_every_coarse_cell_leaves_the_ground_whole() -> None:
    """The lowest points of the coarse level would be outliers only."""
    xyz = town()
    clean = labels(xyz)
    cells = np.floor(xyz[:, :2] / 16)
    _, low = np.unique(cells, axis=0, return_index=True)
    xyz[low, 2] -= 20 + np.arange(len(low))
    ground = labels(xyz)
    assert not ground[low].any()
    np.testing.assert_array_equal(np.delete(ground, low), np.delete(clean, low))


def test_feet_give_the_labels_of_metres() -> None:
    xyz, _ = forest()
    lengths = {"cell": 1.0, "building_size": 48.0, "half_width": 0.1, "height_tolerance": 0.5}
    in_feet: dict[str, Any] = {name: length / FOOT for name, length in lengths.items()}
    metres = robust_interpolation(xyz)
    surface = robust_interpolation(xyz / FOOT, below=1 / FOOT, metre=1 / FOOT, **in_feet)
    feet = ground_mask(xyz / FOOT, surface, above=0.35 / FOOT, below=1 / FOOT)
    np.testing.assert_array_equal(feet, ground_mask(xyz, metres))
    np.testing.assert_allclose(surface.heights * FOOT, metres.heights, rtol=0, atol=1e-6)


@pytest.mark.parametrize("cell", [0.7, 1.0, 3.0])
def test_a_tile_with_its_halo_is_the_whole_to_the_last_bit(cell: float) -> None:
    xyz, _ = forest(side=300.0)
    xyz = xyz[xyz[:, 1] - NORTH < 30]
    size = 9 * cell
    whole = robust_interpolation(xyz, cell=cell, building_size=size)
    halo, x = reach(cell, size), xyz[:, 0] - EAST
    core = x < 20
    part = xyz[x < 20 + halo]
    assert len(part) < 0.9 * len(xyz)
    tile = robust_interpolation(part, cell=cell, building_size=size)
    np.testing.assert_array_equal(residuals(xyz[core], tile), residuals(xyz[core], whole))
    narrow = (halo - outlier_reach(cell)) / 3  # there are no outliers here
    less = robust_interpolation(xyz[x < 20 + narrow], cell=cell, building_size=size)
    assert not np.array_equal(residuals(xyz[core], less), residuals(xyz[core], whole))


def test_no_points() -> None:
    none = np.empty((0, 3))
    with pytest.raises(DataError, match="points: there are none"):
        robust_interpolation(none)
    surface = robust_interpolation(plane(side=5))
    assert ground_mask(none, surface).shape == residuals(none, surface).shape == (0,)


def test_beyond_the_surface_nothing_is_known() -> None:
    surface = robust_interpolation(plane(side=5))
    far = plane(side=5) + np.array([1000.0, 0.0, 0.0])
    assert np.isnan(residuals(far, surface)).all()
    assert not ground_mask(far, surface).any()


def test_the_surface_ends_far_from_all_points() -> None:
    xyz = plane(side=20)
    surface = robust_interpolation(np.vstack([xyz, xyz + np.array([300.0, 0.0, 0.0])]))
    known = np.isfinite(surface.heights)
    x, _ = surface.lattice.centres()
    assert known[:, x - EAST < 20].all()
    assert not known[:, np.abs(x - EAST - 160) < 30].any()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_coordinates_must_be_finite(bad: float) -> None:
    xyz = town()
    surface = robust_interpolation(xyz)
    xyz[7, 1] = bad
    calls: list[Callable[[], Any]] = [
        lambda: robust_interpolation(xyz),
        lambda: ground_mask(xyz, surface),
        lambda: residuals(xyz, surface),
    ]
    for call in calls:
        with pytest.raises(ValueError, match=rf"finite numbers, got y = {bad} at point 7"):
            call()


def test_wide_buildings_take_no_more_memory() -> None:
    """The coarsest cells of 1 km have a margin of kilometres, the finest ones have none."""
    surface = robust_interpolation(plane(side=20), building_size=2000.0)
    assert surface.lattice.shape == robust_interpolation(plane(side=20)).lattice.shape


def test_inputs_and_results_are_read_only() -> None:
    xyz = town()
    xyz.flags.writeable = False
    surface = robust_interpolation(xyz)
    assert ground_mask(xyz, surface).any()
    with pytest.raises(ValueError, match="read-only"):
        surface.heights[0, 0] = 1


def test_the_tool_gives_classes_share_and_surface() -> None:
    xyz = town()
    out = GroundRobustInterpolation(points=cloud(xyz)).run()
    ground = labels(xyz)
    np.testing.assert_array_equal(out.classified["classification"], np.where(ground, 2, 1))
    assert out.classified["classification"].dtype == np.uint8
    assert out.ground_share == ground.mean()
    surface = robust_interpolation(xyz)
    np.testing.assert_array_equal(out.surface.band(), surface.heights.astype(np.float32))
    assert (out.surface.crs, out.surface.units) == (UTM, ("metre",))
    assert out.surface.cell == 1.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("cell", 0.7),
        ("building_size", 15.0),
        ("half_width", 0.4),
        ("relief", 0.3),
        ("height_tolerance", 0.1),
        ("iterations", 0),
        ("above", 0.1),
        ("below", 0.3),
    ],
)
def test_each_setting_of_the_tool_reaches_the_surface(name: str, value: Any) -> None:
    xyz, _ = forest()
    plain = GroundRobustInterpolation(points=cloud(xyz)).run()
    out = GroundRobustInterpolation(points=cloud(xyz), **{name: value}).run()
    surface = robust_interpolation(xyz, **({} if name == "above" else {name: value}))
    limits = {name: value} if name in ("above", "below") else {}
    expected = ground_mask(xyz, surface, **limits)
    np.testing.assert_array_equal(out.classified["classification"] == 2, expected)
    np.testing.assert_array_equal(out.surface.band(), surface.heights.astype(np.float32))
    same_surface = np.array_equal(out.surface.band(), plain.surface.band(), equal_nan=True)
    same_labels = np.array_equal(expected, plain.classified["classification"] == 2)
    assert not (same_labels if name == "above" else same_surface), "proves nothing"


def test_the_reach_of_the_defaults_fits_a_tile() -> None:
    assert GroundRobustInterpolation(points=cloud(plane(side=5))).halo() == pytest.approx(
        reach(1.0, 48.0)
    )
    assert math.isclose(reach(1.0, 96.0), reach(1.0, 48.0) + 3.5 * 32)
    assert reach(1.0, 48.0) < 192


@pytest.mark.slow
def test_isprs_samples_stay_at_the_error_we_reached(data: Callable[[str], Path]) -> None:
    errors = {}
    for sample in ISPRS:
        xyz, truth = isprs(data(f"isprs_samples/samp{sample}.txt.gz"))
        errors[sample] = 100 * float((labels(xyz) != truth).mean())
    assert errors == pytest.approx(ISPRS, abs=0.3)
    assert np.mean(list(errors.values())) <= 3.05


@pytest.mark.slow
def test_tiles_of_a_real_survey_have_the_labels_of_the_whole(data: Callable[[str], Path]) -> None:
    xyz, _ = isprs(data("isprs_samples/samp61.txt.gz"))
    whole = labels(xyz)
    middle = np.median(xyz[:, :2], axis=0)
    off = np.abs(xyz[:, :2] - middle).max(axis=1)
    core, tile = off < 40, off < 40 + reach(1.0, 48.0)
    assert core.sum() > 500
    assert tile.mean() < 0.9
    np.testing.assert_array_equal(labels(xyz[tile])[core[tile]], whole[core])
