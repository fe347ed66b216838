"""Compiled loops of storage curves; see :mod:`algorithms.shoreline._basin_pieces`."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel

BLOCK = 200_000  # steps between two checks for cancellation
PUSHES = 8 * BLOCK  # that they may make
FREE, OWN, BEHIND = 0, 1, 2  # sides of the rim over which a lake runs


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


@kernel
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


@kernel
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
def _put(levels, items, size, level, item):
    """Put an item on a heap that grows where it is full; gives the arrays of the heap."""
    if size[0] == len(levels):
        levels, items = np.append(levels, levels), np.append(items, items)
    _push(levels, items, size, level, item)
    return levels, items


@helper
def _gate(heights, row, col, r, c):
    """Height above which water gets from one cell to a neighbour; NaN if it never does."""
    height = max(heights[row, col], heights[r, c])
    if r != row and c != col:
        corner = heights[r, c] + heights[row, col] + heights[r, col] + heights[row, c]
        return corner if np.isnan(corner) else max(height, corner / 4.0)
    return height


@helper
def _hollow(heights, used, edge, side, start, level, below):
    """The free ground below a level that is joined to a cell; it is marked as side OWN.

    Returns
    -------
    found : array of its cells
    room : sum of its depths
    leaves : it reaches the edge of the data on ground lower than `below`
    """
    rows, cols = heights.shape
    found = np.empty(64, np.int64)
    found[0], count, first = start, 1, 0
    side.flat[start] = OWN
    room, leaves = 0.0, False
    while first < count:
        row, col = found[first] // cols, found[first] % cols
        first += 1
        room += level - heights[row, col]
        leaves |= edge[row, col] and heights[row, col] < below
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(col - 1, 0), min(col + 2, cols)):
                if not used[r, c] or side[r, c] != FREE:
                    continue
                if _gate(heights, row, col, r, c) < level:
                    if count == len(found):
                        found = np.append(found, found)
                    found[count] = r * cols + c
                    count += 1
                    side[r, c] = OWN
    return found[:count], room, leaves


@helper
def _saddle(heights, side, cell):
    """The cell of the own side over which the water gets to a cell."""
    rows, cols = heights.shape
    row, col = cell // cols, cell % cols
    best, lowest = cell, np.inf
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        for c in range(max(col - 1, 0), min(col + 2, cols)):
            if side[r, c] == OWN and _gate(heights, row, col, r, c) < lowest:
                best, lowest = r * cols + c, _gate(heights, row, col, r, c)
    return best


@helper
def _reach(heights, used, side, cell, level, behind, levels, items, size):
    """Put the free neighbours of a cell on the heap; gives the arrays of the heap."""
    rows, cols = heights.shape
    row, col = cell // cols, cell % cols
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        for c in range(max(col - 1, 0), min(col + 2, cols)):
            if used[r, c] and side[r, c] == FREE:
                there = _gate(heights, row, col, r, c)
                if not np.isnan(there):
                    number = 2 * (r * cols + c) + behind
                    levels, items = _put(levels, items, size, max(level, there), number)
    return levels, items


@kernel
def flood_lake(
    heights, used, edge, surveyed, fall, joined, side, tally, spill, levels, items, size
):
    """Flood cells from a lake as its level rises, on both sides of the rim it runs over.

    Where the water comes down over a saddle, the hollow behind it is looked at before. It is of
    the lake, unless it leaves the data, lower than the lake was surveyed, or takes more than what
    the lake has stored by then and in another `fall`. Then the lake runs over there, and what the
    water reaches from behind the saddle is BEHIND: both sides grow with the level, and each cell
    belongs to the one that reaches it first (Meyer 1994, watersheds by flooding from markers).

    Parameters
    ----------
    edge : array of shape (rows, cols), cells beside which the data ends
    surveyed : level of the lake at the start
    fall : what ground behind a saddle must be lower than it to be behind a rim, in the unit of
        the heights
    joined : as in flood_cells, infinity but for the lake; that of what is behind stays infinity
    side : array of shape (rows, cols), OWN for the lake, else FREE
    tally : number of cells of the own side, and the sum of their heights
    spill : level at which the lake runs over first, and the cell of the saddle; infinity before
    levels, items, size : heap of twice the cell, plus one for what is behind

    Returns
    -------
    levels, items : arrays of the heap, which may have grown
    more : whether there is more to do
    """
    cols = heights.shape[1]
    found = np.empty(1, np.int64)
    for _ in range(BLOCK):
        if size[0] == 0:
            return levels, items, False
        level, item = _pop(levels, items, size)
        cell, behind = item // 2, item % 2
        if side.flat[cell] != FREE:
            continue
        if heights.flat[cell] < level and not behind:
            saddle = _saddle(heights, side, cell)
            below = min(surveyed, level - fall)
            some, room, leaves = _hollow(heights, used, edge, side, cell, level, below)
            behind = int(leaves or room > tally[0] * (level + fall) - tally[1])
            if behind and level < spill[0]:
                spill[0], spill[1] = level, saddle
        else:
            found[0] = cell
            some = found
        for one in some:
            row, col = one // cols, one % cols
            side[row, col] = BEHIND if behind else OWN
            if not behind:
                joined[row, col] = level
                tally[0] += 1
                tally[1] += heights[row, col]
        for one in some:
            levels, items = _reach(heights, used, side, one, level, behind, levels, items, size)
    return levels, items, True


@helper
def _below(a, b, c, level):
    """Share of a triangle's area below a level, and mean water depth; heights are a <= b <= c."""
    if level <= b:
        share = (level - a) / (b - a) * ((level - a) / (c - a))
        return share, share * (level - a) / 3.0
    dry = (c - level) / (c - a) * ((c - level) / (c - b))
    return 1.0 - dry, level - (a + b + c) / 3.0 + dry * (c - level) / 3.0


@kernel
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
