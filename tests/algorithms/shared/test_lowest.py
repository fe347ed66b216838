"""Low outliers: what is found, what must stay, how far the search looks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from algorithms.shared import low_noise
from algorithms.shared.lowest import (
    OUTLIER_ROUNDS,
    cells_of,
    lattice_around,
    outlier_reach,
    require_finite,
    without_low_outliers,
)
from toolbox.context import QUIET
from toolbox.errors import DataError

Floats = NDArray[np.float64]
FOOT = 0.3048


def terrain(
    density: float, height: Callable[[Any, Any], Any], side: float = 60.0, seed: int = 3
) -> Floats:
    """Points at random on a surface around (500000, 5000000)."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-side / 2, side / 2, (2, int(density * side**2)))
    z = height(x, y) + rng.normal(0, 0.03, len(x))
    return np.column_stack([x + 500_000, y + 5_000_000, z])


def group(count: int, depth: float, at: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """Points within 2.6 m, as deep as given below the height 0."""
    rng = np.random.default_rng(count)
    away = rng.uniform(-1.3, 1.3, (count, 2))
    return np.column_stack([away + at + (500_000, 5_000_000), rng.normal(-depth, 0.2, count)])


def used(xyz: Floats, metre: float = 1.0) -> NDArray[np.bool_]:
    return without_low_outliers(xyz, metre, metre, QUIET)


@pytest.mark.parametrize("count", [1, 3, 6, 10])
@pytest.mark.parametrize(
    ("density", "depth"),
    [(0.2, 6), (0.2, 50), (1, 6), (5, 2.5), (5, 4), (30, 2.5), (30, 10), (150, 2.5), (150, 50)],
)
def test_small_groups_are_found_and_nothing_else(density: float, depth: float, count: int) -> None:
    side = 60 if density < 100 else 30
    ground = terrain(density, lambda x, y: 0.03 * x, side)
    use = used(np.concatenate([ground, group(count, depth)]))
    assert use[: len(ground)].all()
    assert not use[len(ground) :].any()


@pytest.mark.parametrize("density", [1.0, 8.0])
@pytest.mark.parametrize(
    "height",
    [
        lambda x, y: np.minimum(np.abs(x), 20),
        lambda x, y: np.where(np.abs(x) < 3, -20, 0.0),
        lambda x, y: np.where(np.abs(x) < 1, -2, 0.0),
        lambda x, y: np.where(np.hypot(x, y) < 15, -10, 0.0),
        lambda x, y: np.where(np.hypot(x, y) < 3, -5, 0.0),
        lambda x, y: np.minimum(0.5 * np.hypot(x, y) - 10, 0),
        lambda x, y: np.where(x < 0, -30, 0.0),
        lambda x, y: 0.6 * np.abs(x) + 0.3 * y,
    ],
    ids=["valley", "gorge", "ditch", "quarry", "pit", "funnel", "cliff", "ravine"],
)
def test_terrain_stays(height: Callable[[Any, Any], Any], density: float) -> None:
    assert used(terrain(density, height)).all()


def test_a_cellar_entrance_stays_where_points_are_dense() -> None:
    """1.2 m x 4 m and 2.5 m deep: more points than a group of outliers has."""
    entrance = terrain(
        30, lambda x, y: np.where((np.abs(x) < 0.6) & (np.abs(y) < 2), -2.5, 0.0), 40
    )
    assert used(entrance).all()


def test_a_larger_group_is_terrain() -> None:
    ground = terrain(5, lambda x, y: 0 * x)
    use = used(np.concatenate([ground, group(30, 2.5)]))
    assert use.all()


def test_an_outlier_does_not_hide_another_above_it() -> None:
    ground = terrain(1, lambda x, y: 0 * x)
    low = np.concatenate([group(1, depth) for depth in (50, 20, 8)])
    np.testing.assert_array_equal(used(np.concatenate([ground, low]))[len(ground) :], False)


def test_feet_and_any_order_give_the_same() -> None:
    xyz = np.concatenate(
        [
            terrain(5, lambda x, y: 0.03 * x),
            *(group(4, depth, (3.0 * depth - 15, 9)) for depth in (1.5, 2.5, 4.5, 9)),
        ]
    )
    use = used(xyz)
    assert 8 <= (~use).sum() < 16
    np.testing.assert_array_equal(used(xyz / FOOT, 1 / FOOT), use)
    order = np.random.default_rng(1).permutation(len(xyz))
    np.testing.assert_array_equal(used(xyz[order]), use[order])


def test_what_lies_beyond_the_reach_does_not_count() -> None:
    """A chain of outliers hands nothing on farther than the rounds allow."""
    side = 240.0
    xyz = np.concatenate(
        [
            terrain(0.5, lambda x, y: 0 * x, side),
            *(group(3, 8 + k, (7.0 * k - 110, 0)) for k in range(32)),
        ]
    )
    reach = outlier_reach(1.0)
    assert reach == pytest.approx(OUTLIER_ROUNDS * (10 + 4 * np.sqrt(2)) + low_noise.REACH)
    use = used(xyz)
    assert not use.all()
    for middle in (-60, 0, 60):
        away = np.abs(xyz[:, 0] - 500_000 - middle)
        near = away < reach + 5
        np.testing.assert_array_equal(used(xyz[near])[away[near] < 5], use[away < 5])


@pytest.mark.parametrize("cell", [0.1, 0.7, 1 / FOOT])
def test_cells_are_those_of_the_lattice(cell: float) -> None:
    xyz = terrain(1, lambda x, y: 0 * x)
    xyz[:500, :2] = (xyz[:500, :2] / cell).round() * cell  # on the edges of cells
    lattice = lattice_around(xyz, cell)
    row, col = lattice.indices(xyz[:, 0], xyz[:, 1])
    np.testing.assert_array_equal(cells_of(xyz, lattice), row * lattice.cols + col)


def test_a_shallow_hollow_between_few_points_stays() -> None:
    hollow = terrain(0.4, lambda x, y: np.where(np.hypot(x, y) < 2, -3, 0.0))
    assert (hollow[:, 2] < -2).any()
    assert used(hollow).all()


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        (np.nan, "must be finite numbers, got y = nan"),
        (-np.inf, "must be finite numbers, got y = -inf"),
        (1e300, r"must be below 1e\+12 in size, got y = 1e\+300"),
        (-1e12, r"must be below 1e\+12 in size, got y = -1000000000000.0"),
    ],
)
def test_coordinates_that_mean_nothing(value: float, problem: str) -> None:
    xyz = np.full((4, 3), 9.9e11)
    require_finite(xyz)
    require_finite(xyz[:0])
    xyz[2, 1] = value
    with pytest.raises(DataError, match=f"points: coordinates {problem} at point 2"):
        require_finite(xyz)
