"""Compiled loops of points.thin: groups of points, and one point or the mean of each."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel


@kernel
def number(first, last, codes, table, groups, size):
    """Fill in the group numbers of the points first..last, found by a hash table.

    Parameters
    ----------
    codes : array of shape (n, k); points are of one group if all k are the same
    table : array of 2**m > n entries, at first all -1; each holds a point of one group
    groups : array of shape (n,), to fill
    size : array of shape (1,), how many groups there are so far
    """
    mask = np.uint64(len(table) - 1)
    for i in range(first, last):
        key = np.uint64(0)
        for k in range(codes.shape[1]):
            key = (key ^ np.uint64(codes[i, k])) * np.uint64(0x9E3779B97F4A7C15)
            key ^= key >> np.uint64(32)
        place = key & mask
        while table[place] >= 0 and not _same(codes, table[place], i):
            place = (place + np.uint64(1)) & mask
        if table[place] < 0:
            table[place] = i
            groups[i] = size[0]
            size[0] += 1
        else:
            groups[i] = groups[table[place]]


@helper
def _same(codes, i, j):
    for k in range(codes.shape[1]):  # noqa: SIM110  numba compiles loops, not generators
        if codes[i, k] != codes[j, k]:
            return False
    return True


@kernel
def lowest(first, last, groups, key, xyz, rank, best):
    """Fill in the point of each group with the lowest key; ties are decided by x, y, z, then rank.

    Parameters
    ----------
    groups, key, rank : arrays of shape (n,)
    xyz : array of shape (n, 3)
    best : array of one entry per group, at first all -1
    """
    for i in range(first, last):
        j = best[groups[i]]
        if j < 0:
            best[groups[i]] = i
            continue
        order = _order(key[i], key[j])
        for axis in range(3):
            if order == 0:
                order = _order(xyz[i, axis], xyz[j, axis])
        if order < 0 or (order == 0 and rank[i] < rank[j]):
            best[groups[i]] = i


@helper
def _order(a, b):
    """Sign of a comparison: -1 if a is lower than b, 1 if it is higher, else 0."""
    return -1 if a < b else int(a > b)


@kernel
def add(first, last, groups, values, high, low, count):
    """Add values to the sums of their groups; NaN is left out.

    The sums, high + low, have twice the digits of a float, so that the order of the points does not
    matter (Knuth's exact sum of two).
    """
    for i in range(first, last):
        value, g = values[i], groups[i]
        if np.isnan(value):
            continue
        total = high[g] + value
        part = total - high[g]
        low[g] += (high[g] - (total - part)) + (value - part)
        high[g] = total
        count[g] += 1
