"""Compiled loops over cells: statistics of points, and water that spreads."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import kernel

TAKEN = 2  # state of cells that belong to another body
NEIGHBOURS = ((-1, 0), (0, -1), (0, 1), (1, 0))  # of a cell: water does not creep over corners


@kernel
def gather(cells, z, intensity, is_water, low, high, count, bright, water):
    """Add points to their cells: heights, count, sum of intensities, count of class water."""
    for i in range(len(cells)):
        k = cells[i]
        low[k] = min(low[k], z[i])
        high[k] = max(high[k], z[i])
        count[k] += 1
        bright[k] += intensity[i]
        water[k] += is_water[i]


@kernel
def surroundings(low, first, last, reach, middle, spread, known):
    """Fill in median, 20-80 % range and number of the heights within `reach` cells of each cell."""
    rows, cols = low.shape
    held = np.empty((2 * reach + 1) ** 2, low.dtype)
    for r in range(first, last):
        for c in range(cols):
            n = 0
            for i in range(max(0, r - reach), min(rows, r + reach + 1)):
                for j in range(max(0, c - reach), min(cols, c + reach + 1)):
                    if low[i, j] < np.inf:
                        _insert(held, n, low[i, j])
                        n += 1
            known[r, c] = n
            if n:
                middle[r, c] = held[n // 2]
                spread[r, c] = held[(4 * (n - 1) + 2) // 5] - held[(n - 1 + 2) // 5]


@kernel
def _insert(held, size, value):
    """Insert a value into the first, sorted ones of an array: few are sorted fastest so."""
    k = size
    while k > 0 and held[k - 1] > value:
        held[k] = held[k - 1]
        k -= 1
    held[k] = value


@kernel
def spread(heights, high, dike, middle, level, below, weir, most_lower, starts, state, stack):
    """Spread water at a level from cells; number of cells reached, and of those lying lower.

    A cell is reached when its height is at most the level; `heights` is infinite on land and
    minus infinite where nothing is known, so that water spreads over it. Cells whose highest point
    is above `dike` hold it. It stops early where more than `most_lower` cells lie below `below`,
    or below `weir` where other water is: it would run off.

    Parameters
    ----------
    heights, high, middle : arrays of shape (cells,): lowest height, highest one, and median of the
        surroundings, or level of other water
    starts : cells to begin with
    state : array of shape (cells,), 0 where water may go, TAKEN where other water is; set to 1
        where it went
    stack : array of shape (cells,) that is overwritten by the cells reached
    """
    rows, cols = heights.shape
    size, lower = 0, 0
    for k in starts:
        r, c = k // cols, k % cols
        if state[r, c] == 0 and heights[r, c] <= level and high[r, c] <= dike:
            state[r, c] = 1
            stack[size] = k
            size += 1
    done = 0
    while done < size:
        r, c = stack[done] // cols, stack[done] % cols
        done += 1
        if middle[r, c] < below:
            lower += 1
            if lower > most_lower:
                break
        for a, b in NEIGHBOURS:
            i, j = r + a, c + b
            if not (0 <= i < rows and 0 <= j < cols):
                continue
            if state[i, j] == 0 and heights[i, j] <= level and high[i, j] <= dike:
                state[i, j] = 1
                stack[size] = i * cols + j
                size += 1
            elif state[i, j] == TAKEN and middle[i, j] < weir:
                lower += 1
    return size, lower
