"""Bounds of mean distances, and that verdicts do not depend on whether there are any."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from algorithms.points import denoise
from algorithms.points._noise_bounds import lowest_around
from algorithms.shared.neighbours import PointTree

Floats = NDArray[np.float64]
RATIO, FEW = 3.5, 5


def meadow(rng: np.random.Generator) -> Floats:
    """Level ground, four times as dense in one half, with a centimetre of noise."""
    west = rng.uniform([0, 0, 0], [30, 30, 0.01], (3600, 3))
    return np.vstack([west, rng.uniform([30, 0, 0], [60, 30, 0.01], (14400, 3))])


def forest(rng: np.random.Generator) -> Floats:
    """Ground, a canopy 20 m above it, few points between, and stray ones."""
    ground, canopy = rng.uniform([0, 0, 0], [50, 50, 1], (5000, 3)), meadow(rng)
    canopy[:, 2] += 20
    between = rng.uniform([0, 0, 0], [50, 50, 20], (2000, 3))
    return np.vstack([ground, canopy, between, rng.uniform([0, 0, -40], [60, 60, 80], (60, 3))])


def clumps(rng: np.random.Generator) -> Floats:
    """Many points at one place, others in lines, and a few far apart."""
    places = rng.uniform(0, 40, (3000, 3)) * [1, 1, 0.05]
    line = np.column_stack([np.linspace(0, 40, 2000), np.full(2000, 20), np.full(2000, 9)])
    return np.vstack([places, np.repeat(places[:40], 30, axis=0), line])


def pits(rng: np.random.Generator) -> Floats:
    """Level ground, and single points a little below it, some of them noise."""
    ground = rng.uniform([0, 0, 0], [40, 40, 0.01], (40_000, 3))
    return np.vstack([ground, rng.uniform([0, 0, -1.6], [40, 40, -0.4], (60, 3))])


def heap(rng: np.random.Generator) -> Floats:
    """A meadow with more points in one place than any window holds."""
    return np.vstack([meadow(rng), rng.uniform([20, 20, 0], [20.2, 20.2, 0.2], (2000, 3))])


SCENES = (meadow, forest, clumps, pits, heap)
FAR = np.array([[500_000.0, 6_000_000.0, 100.0]])


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("shift", [0.0, 1.0])
@pytest.mark.parametrize("reach", [1.0, 20.0])
def test_bounds_hold(
    scene: Callable[[np.random.Generator], Floats], shift: float, reach: float
) -> None:
    xyz = scene(np.random.default_rng(1)) + shift * FAR
    tree, around = lowest_around(xyz, 20, reach, RATIO, FEW)
    lowest, within = around.astype(np.float64)
    mean, farthest = tree.mean_distances(20, max_distance=reach)
    sure = np.isinf(lowest)
    assert sure.any() or reach == 1.0
    for i in np.random.default_rng(2).choice(len(mean), 400, replace=False):
        away = np.linalg.norm(tree.xyz - tree.xyz[i], axis=1)
        if sure[i]:
            assert farthest[i] < reach
            nearest = np.argsort(away)[1 : FEW + 1]
            assert mean[i] <= RATIO * np.median(mean[nearest])
        else:
            assert lowest[i] <= mean[away <= within[i]].min()


@pytest.mark.parametrize(("scene", "share"), [(meadow, 0.9), (heap, 0.8)])
def test_most_points_of_a_meadow_are_beyond_doubt(
    scene: Callable[[np.random.Generator], Floats], share: float
) -> None:
    _, around = lowest_around(scene(np.random.default_rng(3)), 20, 20.0, RATIO, FEW)
    assert np.isinf(around[0]).mean() > share


def test_a_heap_that_would_take_longer_than_all_else_is_searched_in_a_tree() -> None:
    rng = np.random.default_rng(3)
    many = rng.uniform([20, 20, 0], [20.2, 20.2, 0.2], (20_000, 3))
    _, around = lowest_around(np.vstack([meadow(rng), many]), 20, 20.0, RATIO, FEW)
    assert not around.any()


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize(("k", "fewest", "threshold"), [(20, 6, 10.0), (8, 3, 2.0), (1, 1, 0.0)])
def test_verdicts_are_those_without_bounds(
    scene: Callable[[np.random.Generator], Floats],
    k: int,
    fewest: int,
    threshold: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    xyz = scene(np.random.default_rng(4))
    settings = {"neighbours": k, "min_neighbours": fewest, "threshold": threshold, "reach": 6.0}
    found = denoise.noise(xyz, **settings)  # type: ignore[arg-type]
    monkeypatch.setattr(denoise, "SEARCHED", -1.0)
    np.testing.assert_array_equal(found, denoise.noise(xyz, **settings))  # type: ignore[arg-type]
    monkeypatch.setattr(denoise, "SEARCHED", 1.0)
    nothing = np.zeros((2, len(xyz)), np.float32)
    monkeypatch.setattr(denoise, "lowest_around", lambda xyz, *_: (PointTree.of(xyz), nothing))
    np.testing.assert_array_equal(found, denoise.noise(xyz, **settings))  # type: ignore[arg-type]


def test_stray_points_far_away_leave_all_in_doubt() -> None:
    xyz = np.vstack([meadow(np.random.default_rng(5)), [[1e7, 0, 0]]])
    _, around = lowest_around(xyz, 20, 20.0, RATIO, FEW)
    assert not around.any()


def test_a_point_beside_a_meadow_is_not_compared_with_itself() -> None:
    """Nothing but itself is as near as its bound holds for, and its neighbours are all farther."""
    dense = np.random.default_rng(6).uniform([0, 0, 0], [10, 10, 0.01], (10_000, 3))
    assert denoise.noise(np.vstack([dense, [[-2.1, 5, -0.05]]]))[-1] == denoise.LOW
