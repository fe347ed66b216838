"""Strips of a front in the shadow of posts and trees, in squares."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from algorithms.planes._strips import Strip, filled, strips

HIGHEST, NARROWEST, WIDEST = 30, 2, 8  # squares
FOUND = [Strip(20, 24, 0, 50)]


def front() -> NDArray[np.bool_]:
    """A wall 50 squares high with a strip of four."""
    seen = np.ones((50, 40), bool)
    seen[:, 20:24] = False
    return seen


def found(seen: NDArray[np.bool_]) -> list[Strip]:
    return strips(seen, HIGHEST, NARROWEST, WIDEST)


def test_a_strip_over_the_height_of_a_front() -> None:
    assert found(front()) == FOUND


def test_the_ground_at_its_foot_is_not_in_it() -> None:
    seen = front()
    seen[0] = True
    assert found(seen) == FOUND
    seen[:3] = True
    assert found(seen) == []


def test_it_is_higher_than_an_opening_or_reaches_the_top() -> None:
    seen = front()
    seen[40:] = True
    assert found(seen) == [Strip(20, 24, 0, 41)]
    seen[25:] = True
    assert found(seen) == []
    assert found(front()[:20]) == [Strip(20, 24, 0, 20)]


@pytest.mark.parametrize(("last", "number"), [(22, 0), (23, 1), (28, 1), (29, 0)])
def test_it_parts_a_region_and_is_no_gap_between_houses(last: int, number: int) -> None:
    seen = np.ones((50, 40), bool)
    seen[:, 20:last] = False
    assert len(found(seen)) == number


@pytest.mark.parametrize(("high", "number"), [(20, 0), (30, 1)])
def test_both_of_its_sides_are_the_front(high: int, number: int) -> None:
    """Beyond the end of a house a low wall is none."""
    seen = front()
    seen[high:, 24:] = False
    seen[high:, 30:] = True
    assert len(found(seen)) == number


def test_what_is_on_both_sides_is_in_it() -> None:
    states = np.array([[2, 0, 3, 0, 2], [1, 0, 2, 0, 2], [0, 0, 0, 0, 1]], np.int8)
    strip = [Strip(1, 4, 0, 3)]
    kept = [[2, 2, 2, 2, 2], [1, 1, 2, 1, 2], [0, 0, 0, 0, 1]]
    assert filled(states, strip, 1, 2, 3).tolist() == kept
    kept[0] = [2, 1, 1, 1, 2]  # more than a post hides: there may be wall in it
    assert filled(states, strip, 1, 2, 2).tolist() == kept
