"""Scattered noise below surfaces is told from all that is a surface of few points."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes.layers import cloud
from scenes.towns import EAST, NORTH, inside, plane

from algorithms.ground.classify import GroundClassify
from algorithms.shared import low_noise
from algorithms.shared.kernels.sorting import DENSE
from algorithms.shared.low_noise import DEEPEST, REACH, SLICE, scattered_below

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


def field(tilt: float = 0.05, side: float = 48.0) -> Floats:
    """Ground with 25 points/m2, which scatter by 3 cm."""
    xyz = plane(side, 0.2, jitter=0.2, tilt=tilt)
    xyz[:, 2] += np.random.default_rng(2).normal(0, 0.03, len(xyz))
    return xyz


def with_noise(xyz: Floats, share: float, deep: float, seed: int = 1) -> tuple[Floats, Mask]:
    """Some of the points 1.5 m and up to `deep` metres too low; which these are."""
    rng = np.random.default_rng(seed)
    low = rng.random(len(xyz)) < share
    xyz = xyz.copy()
    xyz[low, 2] -= rng.uniform(1.5, deep, low.sum())
    return xyz, low


@pytest.mark.parametrize(("share", "deep"), [(0.001, 6), (0.003, 6), (0.01, 16), (0.03, 60)])
def test_noise_is_found_and_nothing_else(share: float, deep: float) -> None:
    xyz, low = with_noise(field(), share, deep)
    found = scattered_below(xyz, 1.0)
    assert not found[~low].any()
    assert found[low].mean() > 0.97


def test_noise_below_a_surface_does_not_hide_the_ground() -> None:
    xyz, low = with_noise(field(), 0.003, 6)
    out = GroundClassify(points=cloud(xyz)).run()
    ground = out.classified["classification"] == 2
    assert ground[~low].all()


@pytest.mark.parametrize(("share", "tilt"), [(0.03, 0.05), (0.03, 0.6), (0.08, 0.9)])
def test_ground_of_a_thick_wood_stays(share: float, tilt: float) -> None:
    xyz = field(tilt)
    rng = np.random.default_rng(6)
    leaves = rng.random(len(xyz)) > share
    xyz[leaves, 2] += rng.uniform(8, 12, leaves.sum())
    assert scattered_below(xyz, 1.0)[~leaves].mean() < 0.05


def test_crowns_are_no_surface_that_makes_ground_noise() -> None:
    """A wood 18 m high with 60 points per m2, of which one in two thousand is of the ground."""
    rng = np.random.default_rng(8)
    xyz = rng.uniform((0, 0, 2), (40, 40, 20), (96_000, 3))
    xyz[::2000, 2] = 0.0
    assert not scattered_below(xyz, 1.0).any()


def test_stray_heights_change_nothing_for_others() -> None:
    xyz, _ = with_noise(field(), 0.003, 6)
    stray = np.vstack([xyz, [[EAST, NORTH, 1e17], [EAST, NORTH, -1e17]]])
    np.testing.assert_array_equal(scattered_below(stray, 1.0)[:-2], scattered_below(xyz, 1.0))


@pytest.mark.parametrize("width", [2.0, 3.0, 10.0])
def test_pits_stay(width: float) -> None:
    """As wide as that, 5 m deep, anywhere in the squares."""
    for shift in (0.0, 1.3, 2.6):
        xyz = field()
        west = 20 + shift
        pit = inside(xyz, (west, west + width, west, west + width))
        xyz[pit, 2] -= 5
        assert not scattered_below(xyz, 1.0).any()


def test_ground_beside_a_wall_and_below_a_glass_roof_stays() -> None:
    xyz = field()
    roof = inside(xyz, (10, 40, 10, 40))
    through = np.random.default_rng(7).random(len(xyz)) < 0.03
    xyz[roof & ~through, 2] += 9
    assert not scattered_below(xyz, 1.0).any()


def test_surfaces_of_few_points_are_not_judged() -> None:
    """With 2 points/m2 no square holds the 40 points of a surface that noise could lie below."""
    xyz = plane(60.0, 0.71, jitter=0.2)
    assert not scattered_below(with_noise(xyz, 0.05, 9)[0], 1.0).any()
    xyz, low = with_noise(plane(60.0, 0.57, jitter=0.2), 0.01, 9)  # with 3 some do
    found = scattered_below(xyz, 1.0)
    assert found[low].mean() > 0.9
    assert not found[~low].any()


def test_noise_below_a_steep_roof_is_found() -> None:
    """A band of 1.5 m holds a quarter of a square of a roof of 55 degrees: 50 of 190 points."""
    xyz = plane(60.0, 0.29, jitter=0.2)
    xyz[:, 2] = 8 + 1.43 * (10 - np.abs(xyz[:, 1] % 20 - 10))
    low = np.random.default_rng(3).random(len(xyz)) < 0.02
    xyz[low, 2] = -np.random.default_rng(4).uniform(1.5, 15, low.sum())
    found = scattered_below(xyz, 1.0)
    assert found[low].mean() > 0.6  # a fifth if a surface needs 60 points in a square
    assert not found[~low].any()
    assert not scattered_below(xyz[:0], 1.0).any()


def test_order_unit_and_stray_heights_do_not_matter() -> None:
    xyz, _ = with_noise(field(), 0.01, 16)
    xyz = xyz.round(3) + 0.0004
    found = scattered_below(xyz, 1.0)
    order = np.random.default_rng(1).permutation(len(xyz))
    np.testing.assert_array_equal(scattered_below(xyz[order], 1.0), found[order])
    np.testing.assert_array_equal(scattered_below(xyz / 0.3048, 1 / 0.3048), found)
    stray = np.vstack([xyz, [[EAST + 9, NORTH + 9, 1e11], [EAST + 9, NORTH + 9, -1e11]]])
    again = scattered_below(stray, 1.0)
    np.testing.assert_array_equal(again[:-2], found)
    assert again[-2:].tolist() == [False, True]
    assert DEEPEST * SLICE > 9000


def test_points_beyond_the_reach_do_not_count() -> None:
    xyz, _ = with_noise(field(), 0.03, 16)
    found = scattered_below(xyz, 1.0)
    away = np.hypot(xyz[:, 0] - EAST - 24, xyz[:, 1] - NORTH - 24)
    near = away < REACH + 4
    assert found[away < 4].any()
    np.testing.assert_array_equal(scattered_below(xyz[near], 1.0)[away[near] < 4], found[away < 4])


def test_numbers_are_counted_or_sorted_with_the_same_answer() -> None:
    """A stray point makes far more squares than there are points, too many to count one by one."""
    xyz, _ = with_noise(field(), 0.01, 16)
    found = scattered_below(xyz, 1.0)
    assert found.any()
    stray = np.vstack([xyz, xyz[0] + [4e3, 4e3, 0]])
    assert low_noise._numbered(xyz, 1.0)[0].max() < DENSE * len(xyz)
    assert low_noise._numbered(stray, 1.0)[0].max() > DENSE * len(stray)
    np.testing.assert_array_equal(scattered_below(stray, 1.0)[:-1], found)
