"""Sorting and searching."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from algorithms.shared.kernels.sorting import distinct, median


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
