"""Points at one position: each position once, in the order in which they come."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from algorithms.shared import places
from algorithms.shared.places import may_be_near, once_each


@pytest.mark.parametrize("marks", [places.MARKS, 1])  # with 1, most are looked at closely
def test_each_position_once(marks: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(places, "MARKS", marks)
    rng = np.random.default_rng(0)
    own = rng.uniform(0, 100, (500, 3))
    xyz = own[rng.integers(0, 500, 900)]
    first = np.sort(np.unique(xyz, axis=0, return_index=True)[1])
    np.testing.assert_array_equal(once_each(xyz), xyz[first])


def test_without_two_at_one_position_the_points_are_taken_as_they_are() -> None:
    xyz = np.random.default_rng(0).uniform(0, 100, (500, 3))
    assert once_each(xyz) is xyz


@pytest.mark.parametrize("reach", [1.0, 0.001])  # the second in wider cells
def test_none_within_reach_is_left_out(reach: float) -> None:
    rng = np.random.default_rng(0)
    xy, some = rng.uniform(0, 100, (20_000, 2)), rng.uniform(20, 80, (40, 2))
    some = np.vstack(
        [some, some + np.array([reach, 0]), some - np.array([0, reach]), [[-1e3, 5e3]]]
    )
    near = may_be_near(xy, some, reach)
    away = cKDTree(some).query(xy)[0]
    assert near[away <= reach].all()
    assert near[away > 3 * max(reach, 6e3 / 4096)].sum() == 0
    assert not may_be_near(xy, some[:0], reach).any()
