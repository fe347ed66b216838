"""Sorting and searching."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from algorithms.shared.kernels.sorting import distinct, grouped, median, stable


@njit
def _median(values):
    return median(values)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 9, 10, 501, 502])
@pytest.mark.parametrize("digits", [0, 9])
def test_median_is_that_of_numpy(count: int, digits: int) -> None:
    values = np.random.default_rng(count).normal(0, 3, count).round(digits)
    assert _median(values.copy()) == np.median(values)
    assert _median(np.sort(values)) == np.median(values)


@pytest.mark.parametrize("values", [[], [3], [2, 2, 2], [5, -1, 5, 0, -1]])
def test_distinct_values_rise_and_none_is_twice(values: list[int]) -> None:
    given = np.array(values, np.int64)
    assert distinct(given).tolist() == sorted(set(values))
    assert given.tolist() == values


@pytest.mark.parametrize("count", [0, 1, 2, 255, 256, 5000])
@pytest.mark.parametrize("largest", [1, 50, 1 << 40, (1 << 62) + 5])
def test_whole_numbers_are_ordered_as_numpy_orders_them(count: int, largest: int) -> None:
    """Also those that leave no room for an index beside them."""
    keys = np.random.default_rng(count).integers(0, largest, count, endpoint=True)
    order, ordered = stable(keys)
    assert np.array_equal(order, np.argsort(keys, kind="stable"))
    assert np.array_equal(ordered, np.sort(keys))
    for ours, theirs in zip(grouped(keys), np.unique(keys, return_inverse=True), strict=True):
        assert np.array_equal(ours, theirs)


def test_the_largest_numbers_with_room_for_an_index_keep_their_order() -> None:
    keys = np.array([(1 << 61) - 1, 3, (1 << 61) - 1])  # two bits hold three indices
    assert stable(keys)[0].tolist() == [1, 0, 2]
    assert stable(keys + 1)[0].tolist() == [1, 0, 2]
