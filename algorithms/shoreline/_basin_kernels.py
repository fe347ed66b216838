"""Compiled loops of storage curves; see :mod:`algorithms.shoreline._basin_pieces`."""

from __future__ import annotations

import numpy as np
from numba import njit

from algorithms.shared.kernels.compiling import helper

BLOCK = 200_000  # steps between two checks for cancellation
PUSHES = 8 * BLOCK  # that they may make


@helper
def _push(levels, items, size, level, item):
    """Put an item on a heap, which has the item of the lowest level on top (Williams 1964)."""
    i = size[0]
    size[0] += 1
    while i > 0 and levels[(i - 1) // 2] > level:
        levels[i], items[i] = levels[(i - 1) // 2], items[(i - 1) // 2]
        i = (i - 1) // 2
    levels[i], items[i] = level, item


@helper
def _pop(levels, items, size):
    """Take the item of the lowest level off a heap: level and item."""
    size[0] -= 1
    first, last = (levels[0], items[0]), (levels[size[0]], items[size[0]])
    i = 0
    while True:
        k = 2 * i + 1
        if k + 1 < size[0] and levels[k + 1] < levels[k]:
            k += 1
        if k >= size[0] or levels[k] >= last[0]:
            break
        levels[i], items[i] = levels[k], items[k]
        i = k
    levels[i], items[i] = last
    return first


@njit(cache=True, nogil=True)
def flood_facets(triangles, neighbours, z, low, used, joined, levels, items, size):
    """Flood triangles in the order of rising level; whether there is more to do.

    Water gets from one triangle to the next at the lower end of the edge between them.

    Parameters
    ----------
    low : array of shape (t,), lowest ground of each triangle
    used : array of shape (t,), triangles that may hold water
    joined : array of shape (t,), level above which a triangle is one water with the start;
        infinity but for the start. Is filled in.
    levels, items, size : heap with the start in it, and room for PUSHES more; is used up
    """
    for _ in range(BLOCK):
        if size[0] == 0:
            return False
        level, t = _pop(levels, items, size)
        if level > joined[t]:
            continue
        for k in range(3):
            n = neighbours[t, k]
            if n >= 0 and used[n]:
                gate = min(z[triangles[t, (k + 1) % 3]], z[triangles[t, (k + 2) % 3]])
                there = max(level, gate, low[n])
                if there < joined[n]:
                    joined[n] = there
                    _push(levels, items, size, there, n)
    return True


@njit(cache=True, nogil=True)
def flood_cells(heights, used, joined, levels, items, size):
    """Flood the cells of a raster in the order of rising level; whether there is more to do.

    Arrays of shape (rows, cols); cells are numbered row by row. Water is at a cell above its
    height, and gets across a corner above the mean of the four cells that meet there, if known.
    """
    rows, cols = heights.shape
    for _ in range(BLOCK):
        if size[0] == 0:
            return False
        level, number = _pop(levels, items, size)
        row, col = number // cols, number % cols
        if level > joined[row, col]:
            continue
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(col - 1, 0), min(col + 2, cols)):
                if not used[r, c]:
                    continue
                there = max(level, heights[r, c])
                if r != row and c != col:
                    corner = heights[r, c] + heights[row, col] + heights[r, col] + heights[row, c]
                    if np.isnan(corner):
                        continue
                    there = max(there, corner / 4.0)
                if there < joined[r, c]:
                    joined[r, c] = there
                    _push(levels, items, size, there, r * cols + c)
    return True


@helper
def _below(a, b, c, level):
    """Share of a triangle's area below a level, and mean water depth; heights are a <= b <= c."""
    if level <= b:
        share = (level - a) / (b - a) * ((level - a) / (c - a))
        return share, share * (level - a) / 3.0
    dry = (c - level) / (c - a) * ((c - level) / (c - b))
    return 1.0 - dry, level - (a + b + c) / 3.0 + dry * (c - level) / 3.0


@njit(cache=True, nogil=True)
def add_block(triangles, z, areas, joined, levels, first, last, sums):
    """Add the areas and volumes of triangles first..last to the sums for each level.

    Parameters
    ----------
    triangles : array of shape (t, 3), indices of z
    areas : array of shape (t,), below zero for what is to be taken away
    joined : array of shape (t,), see flood_facets
    levels : array of shape (k,), rising
    sums : array of shape (6, k + 1): area and volume of triangles that a level cuts; area, and
        area times height above the first level, of those that are all under water from this level
        on; and the area of those that are cut, and all below, whether they are joined or not
    """
    for t in range(first, last):
        a, b, c = z[triangles[t, 0]], z[triangles[t, 1]], z[triangles[t, 2]]
        a, b, c = min(a, b, c), max(min(a, b), min(max(a, b), c)), max(a, b, c)
        area = areas[t]
        wet = np.searchsorted(levels, joined[t], side="right")
        whole = np.searchsorted(levels, c, side="right")
        for i in range(np.searchsorted(levels, a, side="right"), whole):
            share, depth = _below(a, b, c, levels[i])
            sums[4, i] += area * share
            if i >= wet:
                sums[0, i] += area * share
                sums[1, i] += area * depth
        sums[5, whole] += area
        whole = max(whole, wet)
        sums[2, whole] += area
        sums[3, whole] += area * ((a + b + c) / 3.0 - levels[0])
