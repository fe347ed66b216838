"""Compiled loops of :mod:`algorithms.shared.clusters`."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels import cells
from algorithms.shared.kernels.compiling import helper, kernel
from algorithms.shared.sets import root


@kernel
def dense(first_cell, last_cell, xyz, key, start, stride, reach, enough, is_core):
    """Tell which points have at least `enough` points, themselves too, within reach."""
    step, at = cells.columns(stride, key)
    first, last = np.empty(cells.COLUMNS, np.int64), np.empty(cells.COLUMNS, np.int64)
    if first_cell < last_cell:
        cells.begin(key, first_cell, step, at)
    for cell in range(first_cell, last_cell):
        total = cells.around(key, start, cell, step, at, first, last)
        for own in range(start[cell], start[cell + 1]):
            is_core[own] = total >= enough and _has_enough(xyz, own, first, last, reach, enough)


@helper
def _has_enough(xyz, own, first, last, reach, enough):
    count = 0
    for c in range(len(first)):
        for i in range(first[c], last[c]):
            count += _squared(xyz, own, i) <= reach * reach
            if count == enough:
                return True
    return False


@kernel
def join(xyz, key, start, stride, reach, is_core, parent):
    """Give core points within reach of each other one root: `parent` leads there (in place)."""
    step, at = cells.columns(stride, key)
    first, last = np.empty(cells.COLUMNS, np.int64), np.empty(cells.COLUMNS, np.int64)
    for cell in range(len(key)):
        cells.around(key, start, cell, step, at, first, last)
        for own in range(start[cell], start[cell + 1]):
            if not is_core[own]:
                continue
            lowest = root(parent, own)
            for c in range(cells.COLUMNS):
                for i in range(first[c], min(last[c], own)):
                    if not is_core[i] or parent[i] == lowest:
                        continue
                    if _squared(xyz, own, i) <= reach * reach:
                        other = root(parent, i)
                        lowest, high = min(lowest, other), max(lowest, other)
                        parent[high] = lowest
    for i in range(len(parent)):
        parent[i] = root(parent, i)


@kernel
def border(first_cell, last_cell, xyz, key, start, stride, reach, is_core, nearest):
    """Fill in the nearest core point within reach of points that are none, -1 without one.

    Of equally near ones that whose x, y, z come first.
    """
    step, at = cells.columns(stride, key)
    first, last = np.empty(cells.COLUMNS, np.int64), np.empty(cells.COLUMNS, np.int64)
    if first_cell < last_cell:
        cells.begin(key, first_cell, step, at)
    for cell in range(first_cell, last_cell):
        cells.around(key, start, cell, step, at, first, last)
        for own in range(start[cell], start[cell + 1]):
            best, least = -1, reach * reach
            for c in range(cells.COLUMNS if not is_core[own] else 0):
                for i in range(first[c], last[c]):
                    if is_core[i]:
                        away = _squared(xyz, own, i)
                        if away < least or (away == least and _before(xyz, i, best)):
                            best, least = i, away
            nearest[own] = best


@helper
def _before(xyz, i, other):
    """Whether a point comes before another one by x, then y, then z; all come before -1."""
    if other < 0:
        return True
    for a in range(3):
        if xyz[i, a] != xyz[other, a]:
            return xyz[i, a] < xyz[other, a]
    return False


@helper
def _squared(xyz, i, j):
    dx, dy, dz = xyz[i, 0] - xyz[j, 0], xyz[i, 1] - xyz[j, 1], xyz[i, 2] - xyz[j, 2]
    return dx * dx + dy * dy + dz * dz
