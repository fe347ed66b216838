"""Compiled loops of :mod:`algorithms.shared.cells`: runs of cells around a cell."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel
from algorithms.shared.kernels.sorting import first_at

COLUMNS = 9  # of cells around a cell, with its own; the cells of each are side by side in order


@kernel
def numbers(xyz, low, side, stride):
    """Number of the cube of each point: one from `low` is the first that has another before it."""
    found = np.empty(len(xyz), np.int64)
    for i in range(len(xyz)):
        x, y = int((xyz[i, 0] - low[0]) / side) + 1, int((xyz[i, 1] - low[1]) / side) + 1
        z = int((xyz[i, 2] - low[2]) / side) + 1
        found[i] = x * stride[0] + y * stride[1] + z
    return found


@helper
def columns(stride, key):
    """What is added to the number of a cell to get that in the columns around it, and its rank.

    Returns
    -------
    two arrays of shape (COLUMNS,)
        Differences of the numbers, and the index of the first cell at or above each, for `key[0]`.
    """
    step, at, c = np.empty(COLUMNS, np.int64), np.zeros(COLUMNS, np.int64), 0
    for x in range(-1, 2):
        for y in range(-1, 2):
            step[c] = x * stride[0] + y * stride[1]
            c += 1
    return step, at


@helper
def begin(key, cell, step, at):
    """Set `at` to the first cell of each column around a cell, by search."""
    for c in range(COLUMNS):
        at[c] = first_at(key, key[cell] + step[c] - 1, 0, len(key))


@helper
def around(key, start, cell, step, at, first, last):
    """Fill in the runs of points (first, last) in the nine columns of 27 cells around a cell.

    `at` moves on from the cell before: numbers of cells rise, so it never goes back. Returns how
    many points there are.
    """
    total = 0
    for c in range(COLUMNS):
        low = key[cell] + step[c] - 1
        i = at[c]
        while i < len(key) and key[i] < low:
            i += 1
        at[c] = i
        while i < len(key) and key[i] <= low + 2:
            i += 1
        first[c], last[c] = start[at[c]], start[i]
        total += last[c] - first[c]
    return total
