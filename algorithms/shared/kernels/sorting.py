"""Sorting and searching, mostly for use within kernels."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from algorithms.shared.kernels.compiling import helper

Number = TypeVar("Number", bound=np.generic)


def distinct(values: NDArray[Number]) -> NDArray[Number]:
    """The distinct values of an array in rising order.

    np.unique puts them into a hash table, which takes 30 times as long for a million.
    """
    ordered = np.sort(values)
    return np.concatenate([ordered[:1], ordered[1:][ordered[1:] != ordered[:-1]]])


def stable(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Order of whole numbers, none below zero, equal ones as they come, and the numbers in it.

    Number and index share one whole number where both fit: those are sorted four times as fast
    as np.argsort orders five million numbers.

    >>> order, ordered = stable(np.array([7, 3, 7, 0]))
    >>> order.tolist(), ordered.tolist()
    ([3, 1, 0, 2], [0, 3, 7, 7])
    """
    bits = len(keys).bit_length()
    if int(keys.max(initial=0)) >> (63 - bits):
        order = np.argsort(keys, kind="stable")
        return order, keys[order]
    both = (keys << bits) | np.arange(len(keys))
    both.sort()
    return both & ((1 << bits) - 1), both >> bits


def grouped(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The distinct whole numbers, none below zero, and for each of `keys` which of them it is.

    >>> [found.tolist() for found in grouped(np.array([7, 3, 7, 0]))]
    [[0, 3, 7], [2, 1, 2, 0]]
    """
    order, ordered = stable(keys)
    new = np.diff(ordered, prepend=-1) != 0
    number = np.empty(len(keys), np.int64)
    number[order] = np.cumsum(new) - 1
    return ordered[new], number


@njit(cache=True, nogil=True)
def sort_few(values):
    """Sort a few values in place, by insertion."""
    for i in range(1, len(values)):
        value, j = values[i], i
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value


@helper
def first_at(rising, value, start, stop):
    """The first index in start..stop whose value is not below a given one; stop if there is none.

    np.searchsorted takes long to compile.
    """
    while start < stop:
        middle = (start + stop) >> 1
        if rising[middle] < value:
            start = middle + 1
        else:
            stop = middle
    return start


@njit(cache=True, nogil=True)
def add_ranges(rising, step, far, before, total):
    """Add to each row the values of all rows numbered `step` on, up to `far` before or after that.

    `rising` has no number twice, so both ends of the range move on with the row; `before` holds
    the sums of the values of all rows before each, and of all.
    """
    low = high = 0
    for row in range(len(rising)):
        wanted = rising[row] + step
        while low < len(rising) and rising[low] < wanted - far:
            low += 1
        while high < len(rising) and rising[high] <= wanted + far:
            high += 1
        for k in range(total.shape[1]):
            total[row, k] += before[high, k] - before[low, k]


@helper
def median(values):
    """Median of values, which are reordered (selection by Hoare 1961, FIND).

    np.median takes seconds to compile.
    """
    middle, low, high = len(values) // 2, 0, len(values) - 1
    while low < high:
        pivot, i, j = values[(low + high) >> 1], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break
    upper = values[middle]
    return upper if len(values) % 2 else 0.5 * (upper + values[:middle].max())
