"""points.denoise_voxels: single points, counts at the limit, and edges of voxels and tiles."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes.layers import cloud

from algorithms.points.denoise_voxels import HIGH, LOW, PointsDenoiseVoxels, isolated
from toolbox.declare import ClassList
from toolbox.errors import DataError

Floats = NDArray[np.float64]


def terrain(side: float = 60.0, density: float = 2.0) -> Floats:
    """A rough slope."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, side, (2, int(density * side * side)))
    return np.column_stack([x, y, 0.2 * x + rng.normal(0, 0.05, len(x))])


PLANTED = np.array([[20, 20, 34], [40, 30, 300], [30, 40, -24], [10, 50, -250.0]])


def by_definition(xyz: Floats, voxel: float, most: int) -> NDArray[np.bool_]:
    """True for noise, counted voxel by voxel."""
    place = np.floor(xyz / voxel).astype(int)
    near = (np.abs(place[:, None] - place[None]) <= 1).all(axis=2)
    return np.asarray(near.sum(axis=1) <= most)


def test_single_points_are_noise_on_their_side_of_the_ground() -> None:
    found = isolated(np.vstack([terrain(), PLANTED]), 5.0, 6)
    assert list(found[-4:]) == [HIGH, HIGH, LOW, LOW]
    assert not found[:-4].any()


@pytest.mark.parametrize("most", [1, 3, 6, 20])
@pytest.mark.parametrize("shift", [0.0, -1000.5])
def test_verdicts_are_those_of_the_definition(most: int, shift: float) -> None:
    rng = np.random.default_rng(most)
    xyz = rng.uniform(0, 30, (200, 3)) + shift
    found = isolated(xyz, 3.0, most)
    assert np.array_equal(found > 0, by_definition(xyz, 3.0, most))
    assert most in (1, 20) or 0 < np.count_nonzero(found) < len(xyz)


def test_as_many_as_most_are_noise_and_one_more_is_none() -> None:
    group = np.array([2.5, 2.5, 102.5]) + np.arange(7)[:, None] * 0.01
    assert (isolated(np.vstack([terrain(), group[:6]]), 5.0, 6)[-6:] == HIGH).all()
    assert not isolated(np.vstack([terrain(), group]), 5.0, 6).any()


def test_points_at_the_opposite_edge_are_not_around() -> None:
    """Rows of voxels end: the last of one is not beside the first of the next."""
    xyz = np.array([[0.5, 9.5, 9.5], [1.5, 0.5, 0.5], [0.5, 0.5, 0.5], [0.5, 0.5, 1.5]])
    assert np.array_equal(isolated(xyz, 1.0, 1) > 0, by_definition(xyz, 1.0, 1))


def test_noise_is_labelled_or_removed_and_counted() -> None:
    points = cloud(np.vstack([terrain(), PLANTED]))
    labelled = PointsDenoiseVoxels(points=points, action="label").run()
    assert (labelled.low_noise, labelled.high_noise) == (2, 2)
    assert list(labelled.clean["classification"][-4:]) == [HIGH, HIGH, LOW, LOW]
    assert labelled.in_words() == "4 points were taken for noise: 2 low, 2 high."
    assert len(PointsDenoiseVoxels(points=points).run().clean) == len(points) - 4


def test_ignored_classes_are_neither_noise_nor_company() -> None:
    codes = np.full(10, 1, np.uint8)
    codes[3:] = 7
    points = cloud(np.full((10, 3), 2.5)).with_attributes({"classification": codes})
    assert len(PointsDenoiseVoxels(points=points).run().clean) == 7
    assert len(PointsDenoiseVoxels(points=points, ignore=None).run().clean) == 10
    assert len(PointsDenoiseVoxels(points=points, ignore=ClassList([1])).run().clean) == 10


def test_more_noise_than_there_can_be_is_told(caplog: pytest.LogCaptureFixture) -> None:
    points = cloud(terrain(density=0.05))
    with caplog.at_level(logging.WARNING):
        PointsDenoiseVoxels(points=points).run()
    assert "no survey has more than 1 %: raise cell or lower most" in caplog.text


def test_no_points_are_no_noise_and_too_many_voxels_are_refused() -> None:
    assert len(isolated(np.zeros((0, 3)), 5.0, 6)) == 0
    with pytest.raises(DataError, match=r"more than .* voxels: remove stray points"):
        isolated(np.array([[0, 0, 0], [1e9, 1e9, 1e9]]), 0.5, 6)
