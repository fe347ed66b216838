"""Points that continue the ground beyond its bends, against their description and brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from algorithms.shared import breaklines
from algorithms.shared.breaklines import (
    HALF,
    LEAST,
    QUARTER,
    STIFF,
    learned,
    off_continuations,
    off_tops,
    taken_back,
)
from toolbox.context import QUIET

Cells = NDArray[np.float32]
Mask = NDArray[np.bool_]
FULL = np.ones((8, 8))
ALL = np.arange(4096)  # the cells of 64 x 64


def brute_off(z: Cells, ground: Mask, r: int, c: int, radius: float, wide: int) -> float:
    """The height above the best plane through a part of a disc, by weighted least squares."""
    best = math.inf
    rows, cols = np.nonzero(ground)
    y, x = rows - r, cols - c
    away = np.hypot(y, x)
    inside = (away < radius) & (away > 0)
    y, x, v, away = y[inside], x[inside], z[rows, cols][inside] - z[r, c], away[inside]
    octant = np.floor(8 * ((np.arctan2(y, x) / math.tau + 1 - 1e-9) % 1)).astype(int)
    for side in range(8):
        half = ((octant - side) % 8) < wide
        if half.sum() < LEAST:
            continue
        w = (1 - (away[half] / radius) ** 2) ** 2
        w = w / w.sum()
        design = np.column_stack([np.ones(half.sum()), x[half], y[half]])
        mean = w @ design[:, 1:]  # the plane is held level about the middle of the half disc
        design[:, 1:] -= mean
        normal = design.T @ (design * w[:, None]) + STIFF * radius**2 * np.diag([0, 1, 1])
        height, east, south = np.linalg.solve(normal, design.T @ (w * v[half]))
        above = east * mean[0] + south * mean[1] - height
        best = above if abs(above) < abs(best) else best
    return best


@pytest.mark.parametrize("wide", [HALF, QUARTER])
@pytest.mark.parametrize("radius", [3.0, 5.5, 8.0])
def test_off_continuations_are_those_of_parts_of_discs(radius: float, wide: int) -> None:
    rng = np.random.default_rng(1)
    z = np.cumsum(rng.normal(0, 0.3, (32, 48)), axis=1).astype(np.float32)
    z[rng.random(z.shape) < 0.3] = np.nan
    ground = np.isfinite(z) & (rng.random(z.shape) < 0.5)
    ground[:, 20:26] = False
    asked = np.flatnonzero(np.isfinite(z) & ~ground)
    share = np.full((4, 6), 2 * breaklines.HALF_DISC / (math.pi * radius**2))
    off = off_continuations(asked, z.ravel()[asked], z, ground, share, QUIET, wide=wide)
    places = np.column_stack(np.unravel_index(asked, z.shape))
    expected = [brute_off(z, ground, r, c, radius, wide) for r, c in places]
    np.testing.assert_allclose(off, expected, atol=1e-4)
    assert np.isinf(expected).any() == (radius < 2 + 8 / wide)  # too little ground within it


def test_edge_and_ridge_are_taken_back_but_no_bush() -> None:
    """Ground is what continues a side: a terrace of 4 m, a ridge of 1:3; bushes are of 1 m."""
    z = np.zeros((64, 64), np.float32)
    z[:, 40:] = 4.0
    z[:, :30] = 5 - 0.33 * np.abs(np.arange(30, dtype=np.float32) - 15)
    lost = np.zeros(z.shape, bool)
    lost[:, 40:42] = lost[:, 14:17] = True
    bush = np.zeros(z.shape, bool)
    bush[10:12, 34:36] = bush[30, 52] = True
    z[bush] += 1.0
    found = taken_back(z, ~lost & ~bush, lost | bush, FULL, QUIET)
    assert found[lost].all()
    assert not found[~lost].any()


def test_a_wide_edge_is_taken_back_round_by_round(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a strip of 20 m half discs of 3 m reach 2 m, and those of the next round more."""
    z = np.zeros((64, 64), np.float32)
    lost = np.zeros(z.shape, bool)
    lost[:, 20:40] = True
    z[:, :20] = -4.0
    widths = []
    for rounds in (1, 2, 3):
        monkeypatch.setattr(breaklines, "ROUNDS", rounds)
        found = taken_back(z, ~lost, lost, FULL, QUIET)
        widths.append(int(found[32].sum()))
    assert widths == sorted(set(widths))
    assert not found[32, 20:24].any()


def test_what_lies_on_the_ground_by_chance_is_left() -> None:
    """Heights of shrubs from 0.2 to 2 m: no more lie close to the ground than farther up."""
    rng = np.random.default_rng(3)
    z = np.zeros((64, 64), np.float32)
    shrub = rng.random(z.shape) < 0.2
    z[shrub] = rng.uniform(0.2, 2.0, shrub.sum())
    assert not taken_back(z, ~shrub, shrub, FULL, QUIET).any()
    z[shrub] = np.where(rng.random(shrub.sum()) < 0.6, 0.05, z[shrub])
    found = taken_back(z, ~shrub, shrub, FULL, QUIET)
    assert found[shrub & (z < 0.06)].all()


@pytest.mark.parametrize(
    ("mixed", "allowed"),
    [
        ([0.1] * 4 + [0.25] * 4, 0.0),  # as many beyond 0.15 m as within: not more
        ([0.1] * 4 + [0.25] * 3, 0.9),
        ([0.1] * 4 + [0.2] * 3 + [0.5] * 9, 0.15),  # 7 within 0.3 m, 9 from there to 0.6 m
        ([0.1] * 4 + [0.5] * 3 + [0.8] * 2, 0.3),
        ([0.2] * 8 + [0.1], 0.0),
        ([0.1] * 4 + [-0.5] * 9, 0.9),  # what is below is no plant
    ],
)
def test_how_far_off_ground_may_be_is_learned(mixed: list[float], allowed: float) -> None:
    off = np.resize(np.array(mixed, np.float32), 4096)
    assert learned(off, ALL, (64, 64))[2, 2] == pytest.approx(allowed)
    assert learned(np.full(4096, np.inf, np.float32), ALL, (64, 64)).max() == 0


def test_a_single_point_changes_what_is_learned_by_little() -> None:
    """Within and beyond a step are as many: a point more beyond, or one less, decides nothing."""
    off = np.resize(np.array([0.1] * 9 + [0.25] * 8, np.float32), 4096)
    found = learned(off, ALL, (64, 64))
    assert 0.01 < found[2, 2] < 0.8
    for height in (0.1, 0.25):
        off[32 * 64 + 32] = height
        np.testing.assert_allclose(learned(off, ALL, (64, 64)), found, rtol=0, atol=0.02)


def stepped(count: int) -> tuple[Cells, NDArray[np.int64], Cells]:
    """A step of 4 m along a cell, its lowest points at the foot, and points at the top of it."""
    z = np.zeros((64, 64), np.float32)
    z[:, 32:] = 4.0
    cells = np.resize(np.arange(31, 4096, 64), count)
    return z, cells, np.full(count, 4.05, np.float32)


def test_tops_of_steps_are_told_from_plants_at_any_angle() -> None:
    """Half discs would hold the foot of the step as well, unless it runs along their edge."""
    rows, cols = np.mgrid[:64, :64]
    for angle in np.radians([0, 20, 45, 70]):
        away = (cols - 32) * np.cos(angle) + (rows - 32) * np.sin(angle)
        z = np.where(away > 0.7, 4.0, 0.0).astype(np.float32)  # the lowest points of the cells
        top = np.repeat(np.flatnonzero(np.abs(away - 0.35) <= 0.35), 5)  # half of the cell and more
        plant = np.flatnonzero((away < -5) & (rows % 5 == 0))
        heights = np.resize(np.float32([0.6, 1.1, 1.7]), len(top) + len(plant))
        heights[: len(top)] = 4.1
        cells = np.concatenate([top, plant])
        off = off_tops(cells, heights, z, np.ones(z.shape, bool), FULL)
        assert (off[: len(top)] <= 1).mean() > 0.95
        assert (off[len(top) :] > 1).all()


@pytest.mark.parametrize(
    ("count", "others", "ground"),
    [
        (30, 0, False),  # fewer than twice the few that have to be outnumbered
        (400, 0, True),
        (400, 100, True),
        (400, 220, False),  # so many are on the continuation by chance, too
    ],
)
def test_few_or_mixed_points_are_no_tops(count: int, others: int, ground: bool) -> None:
    z, cells, heights = stepped(count + others)
    heights[count:] = 4.25
    off = off_tops(cells, heights, z, np.ones(z.shape, bool), FULL)
    assert (off[:count] <= 1).any() == ground
    assert (off[count:] > 1).all()
