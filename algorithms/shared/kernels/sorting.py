"""Sorting and searching, mostly for use within kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels.compiling import helper, kernel

DENSE = 4  # numbers up to so many times their count take less to count than to sort

Number = TypeVar("Number", bound=np.generic)


def distinct(values: NDArray[Number]) -> NDArray[Number]:
    """The distinct values of an array in rising order.

    np.unique puts them into a hash table, which takes 30 times as long for a million.
    """
    ordered = np.sort(values)
    return np.concatenate([ordered[:1], ordered[1:][ordered[1:] != ordered[:-1]]])


def stable(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Order of whole numbers, none below zero, equal ones as they come, and the numbers in it.

    Number and index share one whole number where both fit, and only the bits of the number are
    sorted by: a tenth of the time of np.argsort for five million, and a third of that of np.sort.

    >>> order, ordered = stable(np.array([7, 3, 7, 0]))
    >>> order.tolist(), ordered.tolist()
    ([3, 1, 0, 2], [0, 3, 7, 7])
    """
    bits = len(keys).bit_length()
    if int(keys.max(initial=0)) >> (63 - bits):
        order = np.argsort(keys, kind="stable")
        return order, keys[order]
    order, ordered = _by_bits(keys, bits, bits + int(keys.max(initial=0)).bit_length())
    return order, ordered


@kernel
def _by_bits(keys, first, last):
    """Order of whole numbers, and the numbers in it, see :func:`stable`.

    An index is laid into the lowest bits, below `first`. Numbers are dealt out by eight bits at a
    time, the lowest first (Seward 1954), into a spare array and back, up to the bit `last`.
    """
    values, spare = np.empty(len(keys), np.int64), np.empty(len(keys), np.int64)
    for i in range(len(keys)):
        values[i] = (keys[i] << first) | i
    for shift in range(first, last, 8):
        at = np.zeros(257, np.int64)  # where the next number of each kind goes
        for value in values:
            at[((value >> shift) & 255) + 1] += 1
        for kind in range(256):
            at[kind + 1] += at[kind]
        for value in values:
            own = (value >> shift) & 255
            spare[at[own]] = value
            at[own] += 1
        values, spare = spare, values
    for i in range(len(keys)):
        spare[i] = values[i] & ((1 << first) - 1)
        values[i] >>= first
    return spare, values


def firsts(ordered: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which of some ordered numbers differ from the one before, as the first one does.

    >>> firsts(np.array([3, 3, 7])).tolist()
    [True, False, True]
    """
    new = np.ones(len(ordered), bool)
    np.not_equal(ordered[1:], ordered[:-1], out=new[1:])
    return new


def grouped(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The distinct whole numbers, none below zero, and for each of `keys` which of them it is.

    >>> [found.tolist() for found in grouped(np.array([7, 3, 7, 0]))]
    [[0, 3, 7], [2, 1, 2, 0]]
    """
    order, ordered = stable(keys)
    new = firsts(ordered)
    number = np.empty(len(keys), np.int64)
    number[order] = np.cumsum(new) - 1
    return ordered[new], number


def counted(numbers: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The whole numbers that occur, none below zero, in order, and how often.

    >>> [found.tolist() for found in counted(np.array([7, 3, 7, 0]))]
    [[0, 3, 7], [1, 1, 2]]
    """
    if numbers.max(initial=0) > DENSE * len(numbers):
        keys, counts = np.unique(numbers, return_counts=True)
        return keys, counts
    counts = np.bincount(numbers)
    keys = np.flatnonzero(counts)
    return keys, counts[keys]


@kernel
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


def sums_around(
    keys: NDArray[np.int64],
    values: Sequence[NDArray[np.number]],
    step: NDArray[np.int64],
    far: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """How many points there are in the cells around each cell, and sums of their values.

    Parameters
    ----------
    keys : number of the cell of each point, none below zero, array of shape (n,)
    values : whole numbers, k arrays of shape (n,); no sum may be above 2**53
    step, far : arrays of shape (m,); all cells numbered `step` on, up to `far` before or after
        that, are around a cell

    Returns
    -------
    sums : array of shape (cells, 1 + k)
    place : array of shape (n,), the cell of each point among them

    Examples
    --------
    >>> sums, place = sums_around(
    ...     np.array([7, 3, 7, 8]), [np.array([10, 20, 30, 40])], np.array([0]), np.array([1])
    ... )
    >>> sums[place].tolist()
    [[3, 80], [1, 20], [3, 80], [3, 80]]
    """
    own, place = grouped(keys)
    before = np.zeros((len(own) + 1, 1 + len(values)), np.int64)
    before[1:, 0] = np.bincount(place)
    for k, column in enumerate(values, start=1):
        before[1:, k] = np.bincount(place, column)  # exact
    np.cumsum(before, axis=0, out=before)
    sums = np.zeros((len(own), before.shape[1]), np.int64)
    _add_ranges(own, step, far, before, sums)
    return sums, place


@kernel
def _add_ranges(rising, step, far, before, total):
    """Add to each row the values of rows whose numbers lie in ranges around its own.

    `rising` has no number twice, so both ends of each range move on with the row; `before` holds
    the sums of the values of all rows before each, and of all.
    """
    low, high = np.zeros(len(step), np.int64), np.zeros(len(step), np.int64)
    for row in range(len(rising)):
        for c in range(len(step)):
            wanted = rising[row] + step[c]
            first, last = low[c], high[c]
            while first < len(rising) and rising[first] < wanted - far[c]:
                first += 1
            while last < len(rising) and rising[last] <= wanted + far[c]:
                last += 1
            low[c], high[c] = first, last
            if first < last:
                for k in range(total.shape[1]):
                    total[row, k] += before[last, k] - before[first, k]


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
