"""Compiled loops of :mod:`algorithms.points._noise_bounds`."""

from __future__ import annotations

import numpy as np
from numba import njit

from algorithms.shared.kernels.compiling import helper, rough_sums

WIDEST = 3  # cells on each side of a window: where points are nine times as sparse as usual
MOST = 25  # times k points in a window; the sums of more would take longer than a search
ROUNDING = 1e-6  # of a coordinate in single precision; and of distances, a thousand times as much


@njit(cache=True, nogil=True)
def sort_into_cells(xyz, west, south, cell, columns, rows):
    """The points row by row of cells, their indices, and where each cell begins among them."""
    edges = np.zeros(columns * rows + 2, np.int64)
    for i in range(len(xyz)):
        edges[_cell(xyz, i, west, south, cell, columns) + 2] += 1
    for k in range(2, len(edges)):
        edges[k] += edges[k - 1]
    placed, order = np.empty_like(xyz), np.empty(len(xyz), np.int64)
    for i in range(len(xyz)):
        k = _cell(xyz, i, west, south, cell, columns) + 1
        placed[edges[k]], order[edges[k]] = xyz[i], i
        edges[k] += 1
    return placed, order, edges[:-1]


@helper
def _cell(xyz, i, west, south, cell, columns):
    """Number of the cell of a point."""
    return int((xyz[i, 1] - south) / cell) * columns + int((xyz[i, 0] - west) / cell)


@njit(cache=True, nogil=True)
def bounds(first_row, last_row, xyz, edges, columns, cell, k, reach, upper, low, wide):
    """Fill in bounds of the mean distance to the k nearest points, for some rows of cells.

    `upper` is for each point, in the order of the cells; `low`, for each cell, lies below those of
    all its points; `wide` is the number of cells on each side of the window it was found in.
    """
    near = np.empty((3, MOST * k), np.float32)
    rows = (len(edges) - 1) // columns
    for at in range(first_row * columns, last_row * columns):
        low[at] = np.inf
        if edges[at] == edges[at + 1]:
            continue
        row, column = at // columns, at % columns
        for w in range(1, WIDEST + 1):
            wide[at] = w
            count = _count(edges, columns, rows, row, column, w)
            if count > 2 * k:
                break
        if count > near.shape[1]:
            low[at] = 0.0
            upper[edges[at] : edges[at + 1]] = np.inf
            continue
        own = _gather(xyz, edges, columns, rows, row, column, wide[at], near)
        step = np.float32(min(wide[at] * cell, reach))
        for j in range(edges[at], edges[at + 1]):
            under, upper[j] = _bounds(near, count, own + j - edges[at], step, k, reach)
            low[at] = min(low[at], under)


@helper
def _span(edges, columns, row, column, w):
    """Where the points of a row of a window begin and end."""
    low, high = max(column - w, 0), min(column + w + 1, columns)
    return edges[row * columns + low], edges[row * columns + high]


@helper
def _count(edges, columns, rows, row, column, w):
    """Number of points in a window."""
    count = 0
    for r in range(max(row - w, 0), min(row + w + 1, rows)):
        start, stop = _span(edges, columns, r, column, w)
        count += stop - start
    return count


@helper
def _gather(xyz, edges, columns, rows, row, column, w, near):
    """Copy the points of a window, relative to the first of its cell; the place of that one."""
    at = edges[row * columns + column]
    x, y, z = xyz[at, 0], xyz[at, 1], xyz[at, 2]
    count = own = 0
    for r in range(max(row - w, 0), min(row + w + 1, rows)):
        start, stop = _span(edges, columns, r, column, w)
        if r == row:
            own = count + at - start
        for i in range(start, stop):
            near[0, count], near[1, count] = xyz[i, 0] - x, xyz[i, 1] - y
            near[2, count] = xyz[i, 2] - z
            count += 1
    return own


@helper
def _bounds(near, count, own, step, k, reach):
    """Lower and upper bound of the mean distance of a point to its k nearest.

    All points within `step` are there. The mean of the k smallest distances d is at least
    t - sum(max(t - d, 0)) / k for any t, of those within t; and where the n points within t are k
    or more, it is at most the mean of these, t - sum(max(t - d, 0)) / n.
    """
    x, y, z = near[0, own], near[1, own], near[2, own]
    half, twice = np.float32(0.5) * step, np.float32(min(2.0 * step, reach))
    of_half, of_step, of_twice, within, in_all = _sums(near, count, x, y, z, half, step, twice)
    slack = ROUNDING * (abs(x) + abs(y) + abs(z) + 1000.0 * twice)
    # The point itself, at no distance, is in all of them.
    under = max(half - (of_half - half) / k, step - (of_step - step) / k)
    over = np.inf
    if within > k:
        over = step - (of_step - step) / (within - 1)
    if in_all > k:
        over = min(over, twice - (of_twice - twice) / (in_all - 1))
    return max(under - slack, 0.0), over + slack


@rough_sums
def _sums(near, count, x, y, z, half, step, twice):
    """Sums of what distances are below three limits, and the counts within the last two."""
    nought = np.float32(0.0)
    of_half, of_step, of_twice = nought, nought, nought
    within, in_all = np.int32(0), np.int32(0)
    for i in range(count):
        dx, dy, dz = near[0, i] - x, near[1, i] - y, near[2, i] - z
        d = np.sqrt(dx * dx + dy * dy + dz * dz)
        of_half += max(half - d, nought)
        of_step += max(step - d, nought)
        of_twice += max(twice - d, nought)
        within += np.int32(d <= step)
        in_all += np.int32(d <= twice)
    return of_half, of_step, of_twice, within, in_all


@njit(cache=True, nogil=True)
def doubtful(order, edges, columns, cell, ratio, upper, low, wide, lowest, within):
    """Fill in the lower bound of all points within some distance, where it leaves a doubt.

    The distance is that of two windows. There is no doubt, and the bound becomes infinite, where
    the upper bound of a point is at most `ratio` times the lowest of the lower bounds there.
    """
    rows = (len(edges) - 1) // columns
    for at in range(rows * columns):
        if edges[at] == edges[at + 1]:
            continue
        row, column, w = at // columns, at % columns, 2 * wide[at]
        least = np.float32(np.inf)
        for r in range(max(row - w, 0), min(row + w + 1, rows)):
            for c in range(max(column - w, 0), min(column + w + 1, columns)):
                least = min(least, low[r * columns + c])
        for j in range(edges[at], edges[at + 1]):
            lowest[order[j]] = np.inf if upper[j] <= ratio * least else least
            within[order[j]] = w * cell * (1.0 - ROUNDING)
