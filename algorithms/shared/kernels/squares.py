"""Compiled loops over points in squares: their numbers, and what is counted in them."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel


@kernel
def numbered(xyz, size, margin):
    """Number of the square of each point, row by row, and how far apart rows are.

    Before the first row and column there are `margin` empty ones, and a row ends in an empty
    square at least, so that the last of a row is beside none of the next.
    """
    west, east, south = np.inf, -np.inf, np.inf
    for i in range(len(xyz)):
        west, east, south = min(west, xyz[i, 0]), max(east, xyz[i, 0]), min(south, xyz[i, 1])
    first, bottom = _whole(west, size) - margin, _whole(south, size) - margin
    cols = _whole(east, size) - first + 2
    found = np.empty(len(xyz), np.int64)
    for i in range(len(xyz)):
        row, col = _whole(xyz[i, 1], size) - bottom, _whole(xyz[i, 0], size) - first
        found[i] = row * cols + col
    return found, cols


@helper
def _whole(value, size):
    """Number of the strip of a coordinate."""
    return int(np.floor(value / size))


@kernel
def shared_by_two(above, blocks, reach, width, lower, upper):
    """Add each height to the classes of its block whose middles are below and above it.

    Classes are `width` wide and begin at -`reach`. `lower` takes the shares of those below,
    `upper` of those above, shape (blocks, classes), as sums depend on their order.
    """
    for i in range(len(above)):
        place = (above[i] + reach) / width - 0.5
        if 0.0 < place < lower.shape[1] - 1:
            k = int(place)
            part = place - k
            lower[blocks[i], k] += 1.0 - part
            upper[blocks[i], k + 1] += part


@kernel
def tops(squares, chosen, xyz, size):
    """Number of the chosen points of each square, and the highest of them; infinite without any."""
    counts, top = np.zeros(size, np.int64), np.full(size, np.inf)
    for i in range(len(squares)):
        if chosen[i]:
            square = squares[i]
            top[square] = max(top[square], xyz[i, 2]) if counts[square] else xyz[i, 2]
            counts[square] += 1
    return counts, top


@kernel
def box(xyz):
    """West, south, east and north end of the points, an order faster than axis by axis."""
    west, south, east, north = np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(xyz)):
        west, east = min(west, xyz[i, 0]), max(east, xyz[i, 0])
        south, north = min(south, xyz[i, 1]), max(north, xyz[i, 1])
    return west, south, east, north


@kernel
def tops_between(ends, chosen, xyz, size, most):
    """Highest of the chosen points of each square, row by row from the south; NaN without any.

    A row ends in an empty square. `ends` are the west, south, east and north end of all points.
    Nothing where this takes more than `most` squares.
    """
    first, bottom = _whole(ends[0], size), _whole(ends[1], size)
    rows, cols = _whole(ends[3], size) - bottom + 1, _whole(ends[2], size) - first + 2
    if rows * cols > most:
        return np.empty((0, 0))
    top = np.full((rows, cols), np.nan)
    for i in range(len(xyz)):
        if chosen[i]:
            row, col = _whole(xyz[i, 1], size) - bottom, _whole(xyz[i, 0], size) - first
            if not top[row, col] >= xyz[i, 2]:  # which is also false for NaN
                top[row, col] = xyz[i, 2]
    return top


@kernel
def rises(places, cols, heights):
    """Rises of squares to those east and north of them, shape (2, n), where there are both.

    `places` are the numbers of squares in order, of which rows have `cols`.
    """
    found, count, north = np.empty((2, len(places))), 0, 0
    for i in range(len(places) - 1):
        while north < len(places) and places[north] < places[i] + cols:
            north += 1
        if north == len(places):
            break
        if places[i + 1] == places[i] + 1 and places[north] == places[i] + cols:
            found[0, count] = heights[i + 1] - heights[i]
            found[1, count] = heights[north] - heights[i]
            count += 1
    return found[:, :count]


@kernel
def layers_above(squares, xyz, top, metre, clear, thick):
    """Squares of the points that are `clear` metres above the top of theirs, and their layers."""
    above, layers, count = np.empty_like(squares), np.empty_like(squares), 0
    for i in range(len(squares)):
        height = (xyz[i, 2] - top[squares[i]]) / metre - clear
        if height >= 0.0:
            above[count], layers[count] = squares[i], int(height / thick)
            count += 1
    return above[:count], layers[:count]


@kernel
def ends(squares, xyz, size):
    """Lowest and highest height of the points of each square."""
    low, high = np.full(size, np.inf), np.full(size, -np.inf)
    for i in range(len(squares)):
        low[squares[i]] = min(low[squares[i]], xyz[i, 2])
        high[squares[i]] = max(high[squares[i]], xyz[i, 2])
    return low, high


@kernel
def near_bottom(squares, kept, xyz, size, reach):
    """Whether each point is kept, and less than `reach` above the lowest kept of its square."""
    low, near = np.full(size, np.inf), np.zeros(len(squares), np.bool_)
    for i in range(len(squares)):
        if kept[i]:
            low[squares[i]] = min(low[squares[i]], xyz[i, 2])
    for i in range(len(squares)):
        near[i] = kept[i] and xyz[i, 2] - low[squares[i]] < reach
    return near


@kernel
def held(squares, number, kept):
    """Indices of the kept points whose square has a number from 0 on."""
    count = 0
    for i in range(len(squares)):
        if kept[i] and number[squares[i]] >= 0:
            count += 1
    index = np.empty(count, np.int64)
    count = 0
    for i in range(len(squares)):
        if kept[i] and number[squares[i]] >= 0:
            index[count] = i
            count += 1
    return index


@kernel
def slice_ends(xyz, thick):
    """Lowest and highest number of the slices of height that hold points."""
    lowest, highest = np.inf, -np.inf
    for i in range(len(xyz)):
        level = np.floor(xyz[i, 2] / thick)
        lowest, highest = min(lowest, level), max(highest, level)
    return lowest, highest


@kernel
def add_slices(squares, xyz, thick, lowest, highest, span):
    """Make numbers of squares those of slices, of which each square has `span`, the first empty.

    Points below `lowest` and above `highest` count for those.
    """
    for i in range(len(xyz)):
        level = min(max(np.floor(xyz[i, 2] / thick), lowest), highest)
        squares[i] = squares[i] * span + int(level - lowest) + 1
