"""Probabilities that neighbours share: what is mended, what stays, and what must not matter."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from algorithms.classify._learning.smoothing import smoothed

CLASSES = np.array([2, 3, 5, 6], np.uint8)
Floats = NDArray[np.float64]


def scene(seed: int = 0) -> tuple[Floats, Floats]:
    """Points of 20 x 10 m, and chances of classes that are nothing but luck."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(0, (20, 10, 3), (4000, 3)) + np.array([500_000, 4_600_000, 80])
    return xyz, rng.dirichlet(np.ones(4) / 2, 4000)


def test_a_few_wrong_points_of_a_house_are_outvoted() -> None:
    xyz, chance = scene()
    chance[:] = (0.01, 0.01, 0.03, 0.95)
    wrong = np.random.default_rng(1).random(len(xyz)) < 0.2
    chance[wrong] = (0.01, 0.01, 0.93, 0.05)
    assert (CLASSES[smoothed(chance, CLASSES, xyz, 1.5).argmax(axis=1)] == 6).all()


def yard_of_edges(seed: int) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Lawn with a kerb of shrubs of 0.5 m, a house, and a tree 1 m from its wall.

    Of each class 15 in 100 points are surely of another one, and are to be mended; ground and what
    stands on it are told apart as they should be.
    """
    rng = np.random.default_rng(seed)
    parts = []
    for number, low, size, points in (
        (0, (0, 0, 0), (20, 20, 0.05), 8000),  # lawn
        (1, (0, 9, 0.2), (6, 0.5, 0.3), 600),  # a row of shrubs
        (2, (12, 4, 3), (5, 5, 5), 3000),  # crown
        (3, (1, 1, 5), (10, 7, 0.2), 4000),  # roof
        (3, (11, 1, 0), (0.1, 7, 5), 1500),  # wall
    ):
        parts.append((rng.uniform(0, 1, (points, 3)) * size + low, np.full(points, number)))
    xyz, truth = (np.concatenate(column) for column in zip(*parts, strict=True))
    chance = np.full((len(xyz), 4), 0.02)
    said = np.where(rng.random(len(xyz)) < 0.15, np.where(truth == 3, 2, 3), truth)
    said = np.where(truth == 0, 0, said)
    chance[np.arange(len(xyz)), said] = 0.94
    return xyz + np.array([500_000, 4_600_000, 80]), truth, chance


@pytest.mark.parametrize("seed", range(3))
def test_objects_are_mended_and_edges_stay(seed: int) -> None:
    """Nearly all errors go, also within half a metre of another object, and no ground is lost."""
    xyz, truth, chance = yard_of_edges(seed)
    found = smoothed(chance, CLASSES, xyz, 1.5).argmax(axis=1)
    before = chance.argmax(axis=1) != truth
    kind = np.array([0, 1, 1, 2])  # low and high plants are one kind
    after = kind[found] != kind[truth]
    objects = truth > 0
    assert 0.13 < before[objects].mean() < 0.17
    assert after[objects].mean() < 0.01
    assert not after[~objects].any()
    shrubs = truth == 1
    assert after[shrubs].mean() < 0.1 * before[shrubs].mean()  # a mean over all makes them ground
    facing = ((truth == 2) & (xyz[:, 0] < 500_012.5)) | (xyz[:, 0] > 500_010.9) & (truth == 3)
    assert after[facing].mean() < 0.25 * before[facing].mean()


def test_ground_and_the_height_of_vegetation_stay_their_own() -> None:
    xyz, chance = scene()
    found = smoothed(chance, CLASSES, xyz, 1.5)
    np.testing.assert_array_equal(found[:, 0], chance[:, 0])
    np.testing.assert_allclose(found[:, 1] * chance[:, 2], found[:, 2] * chance[:, 1], atol=1e-12)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-9)
    assert np.abs(found - chance).max() > 0.5


def test_points_that_are_ground_have_no_say() -> None:
    """A roof over ground, whose points would be leaves if they were no ground."""
    xyz = np.random.default_rng(0).uniform(0, 1, (40, 3))
    chance = np.tile([0.0, 0.0, 0.1, 0.9], (40, 1))
    chance[10:] = (0.999, 0.0, 0.001, 0.0)
    found = smoothed(chance, CLASSES, xyz, 2.0)
    assert (found[:10, 3] > 0.89).all()


def test_neighbours_are_those_within_the_radius() -> None:
    """Against point by point, where all points of a cell lie in its middle."""
    rng = np.random.default_rng(0)
    xyz = (rng.integers(0, 12, (300, 3)) + 0.5) / 2
    chance = rng.dirichlet(np.ones(4), 300)
    found = smoothed(chance, CLASSES, xyz, 1.5)
    for i in range(0, 300, 11):
        near = np.linalg.norm(xyz - xyz[i], axis=1) < 1.5 + 1e-6
        kinds = np.array([chance[near, 1:3].sum(), chance[near, 3].sum()])
        expected = (1 - chance[i, 0]) * kinds[1] / kinds.sum()
        assert found[i, 3] == pytest.approx(expected, abs=1e-5)


def test_a_part_of_the_points_has_what_the_whole_has() -> None:
    """To the last bit, with twice the radius around, and in any order."""
    xyz, chance = scene()
    whole = smoothed(chance, CLASSES, xyz, 1.5)
    part = np.flatnonzero(xyz[:, 0] < 500_012)[::-1]
    found = smoothed(chance[part], CLASSES, xyz[part], 1.5)
    inner = xyz[part, 0] < 500_009
    np.testing.assert_array_equal(found[inner], whole[part][inner])


@pytest.mark.parametrize("classes", [[2, 5], [5, 6], [1, 14, 15]])
def test_any_classes_will_do(classes: Any) -> None:
    """A single kind beside ground has nothing to share; without ground all share."""
    xyz, chance = scene()
    chance = chance[:, : len(classes)] / chance[:, : len(classes)].sum(axis=1, keepdims=True)
    found = smoothed(chance, np.array(classes, np.uint8), xyz, 1.5)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-9)
    assert (np.abs(found - chance).max() < 1e-9) == (classes == [2, 5])


def test_chances_of_zero_make_no_holes() -> None:
    xyz = np.zeros((4, 3))
    chance = np.array([[1.0, 0, 0, 0], [0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 1]])
    found = smoothed(chance, CLASSES, xyz, 1.0)
    np.testing.assert_allclose(found, chance)
    np.testing.assert_allclose(smoothed(chance[:1], CLASSES, xyz[:1], 1.0), chance[:1])
    other = np.array([[0.0, 0, 0, 1], [0, 0, 1, 0]])
    np.testing.assert_allclose(smoothed(other, CLASSES, xyz[:2], 1.0)[:, 1:].sum(axis=1), 1.0)
