"""Surfaces from the nearest points: inverse distance weighting and nearest neighbour."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels.compiling import kernel
from algorithms.shared.kernels.threads import in_blocks
from toolbox.context import QUIET, Context
from toolbox.data import Lattice

BLOCK = 20_000  # cells or points between two checks for cancellation
PER_BUCKET = 3  # points: fewer and there is more to look up, more and there is more to measure
ROUNDING = 1e-9  # share by which a search reaches farther than it has to

Array = NDArray[np.float64]


class Weighting(NamedTuple):
    """Which points around a position count in a mean, and with which weights.

    Attributes
    ----------
    neighbours : of the nearest points that count
    reach : farthest that counts
    power : of the inverse distance
    smoothing : added to the distance, as the other side of a right angle
    """

    neighbours: int = 1
    reach: float = math.inf
    power: float = 2.0
    smoothing: float = 0.0


class Buckets(NamedTuple):
    """Points sorted into squares, row by row from the south.

    Attributes
    ----------
    xy : array of shape (n, 2), sorted
    order : array of shape (n,), index of each among the points given
    starts : array of shape (rows * cols + 1,), where those of each square begin
    west, south, size : of the squares
    rows, cols : how many there are
    """

    xy: Array
    order: NDArray[np.int32]
    starts: NDArray[np.int64]
    west: float
    south: float
    size: float
    rows: int
    cols: int


def buckets(xy: Array, cells: int, *, ctx: Context = QUIET) -> Buckets:
    """Sort points of shape (n, 2) into squares with PER_BUCKET points in those that have any.

    There are never more than four squares to a point or to one of the `cells` to be filled.
    """
    west, south = xy[:, 0].min(), xy[:, 1].min()
    width, height = xy[:, 0].max() - west, xy[:, 1].max() - south
    most = 4 * (len(xy) + cells)
    smallest = max(math.sqrt(width * height / most), width / most, height / most, 1e-300)
    size = max(math.sqrt(width * height * PER_BUCKET / len(xy)), smallest)
    while True:
        rows, cols = int(height / size) + 1, int(width / size) + 1
        starts = _count(xy, west, south, size, rows, cols)
        ctx.progress(0.3)
        crowd = len(xy) / np.count_nonzero(np.diff(starts))
        if crowd <= 4 * PER_BUCKET or size == smallest:  # else a part of the area is empty
            break
        size = max(smallest, size * math.sqrt(PER_BUCKET / crowd))
    order = _fill(xy, west, south, size, cols, starts)
    ctx.progress(0.7)
    sorted_xy = np.empty_like(xy)
    in_blocks(
        lambda first, last: _gather(xy, order, first, last, sorted_xy),
        len(xy),
        BLOCK,
        ctx.part(0.7, 1.0),
    )
    return Buckets(sorted_xy, order, starts, west, south, size, rows, cols)


@kernel
def _count(xy, west, south, size, rows, cols):
    """Start of the points of each square in the sorted points."""
    starts = np.zeros(rows * cols + 1, np.int64)
    for i in range(len(xy)):
        starts[int((xy[i, 1] - south) / size) * cols + int((xy[i, 0] - west) / size) + 1] += 1
    for square in range(rows * cols):
        starts[square + 1] += starts[square]
    return starts


@kernel
def _fill(xy, west, south, size, cols, starts):
    """Indices of the points, sorted by square."""
    order, free = np.empty(len(xy), np.int32), starts[:-1].copy()
    for i in range(len(xy)):
        square = int((xy[i, 1] - south) / size) * cols + int((xy[i, 0] - west) / size)
        order[free[square]] = i
        free[square] += 1
    return order


@kernel
def _gather(xy, order, first, last, out):
    """Copy the coordinates of points first..last of the order to the sorted array."""
    for i in range(first, last):
        out[i, 0], out[i, 1] = xy[order[i], 0], xy[order[i], 1]


def weighted(
    there: Buckets,
    values: Array,
    lattice: Lattice,
    weighting: Weighting,
    max_gap: float = math.inf,
    *,
    ctx: Context = QUIET,
) -> tuple[Array, NDArray[np.int32], Array]:
    """Means of the nearest points of each cell centre, weighted by the inverse of their distance.

    Of points equally far from a centre those count that come first by x, then y.

    Parameters
    ----------
    there : the points, each position once, in the order of x, then y
    values : array of shape (n,), in the order of the points given
    lattice : the cells
    weighting : which count and how much
    max_gap : cells without a point as near as that stay empty

    Returns
    -------
    surface : array of shape (rows, cols), NaN where there is no point
    used : array of shape (rows, cols), number of points
    nearest : array of shape (rows, cols), distance to the nearest of them
    """
    surface, nearest = (np.full(lattice.shape, np.nan) for _ in range(2))
    used = np.zeros(lattice.shape, np.int32)
    results = (surface, used, nearest)
    x, y = lattice.centres()
    in_blocks(
        lambda first, last: _weigh_cells(
            there, values, first, last, x, y, lattice.cell, weighting, max_gap, *results
        ),
        lattice.rows,
        BLOCK // lattice.cols,
        ctx,
    )
    return results


def left_out(there: Buckets, values: Array, weighting: Weighting, *, ctx: Context = QUIET) -> Array:
    """Squared leave-one-out error of each point: its value against the mean of its neighbours.

    Returns
    -------
    array of shape (n,)
        NaN where there is no other within the reach.
    """
    squares = np.full(len(values), np.nan)
    in_blocks(
        lambda first, last: _leave_out(there, values, first, last, weighting, squares),
        len(values),
        BLOCK,
        ctx,
    )
    return squares


@kernel
def _weigh_cells(
    there, values, first, last, xs, ys, cell, weighting, max_gap, surface, used, nearest
):
    """Fill in the cells of the rows first..last."""
    k = weighting.neighbours
    most, far, near = np.empty(k), np.empty(4 * k + 64), np.empty(4 * k + 64, np.int32)
    for row in range(first, last):
        before = np.inf
        for col in range(len(xs)):
            # What was near enough to the centre before is at most a cell farther from this one.
            bound = before + cell if before > cell else np.inf
            found = _search(there, xs[col], ys[row], -1, weighting.reach, bound, most, far, near)
            before = math.sqrt(far[found - 1]) if found == k else np.inf
            if found > 0 and far[0] <= max_gap * max_gap:
                surface[row, col] = _mean(values, near, far, found, weighting)
                used[row, col], nearest[row, col] = found, math.sqrt(far[0])


@kernel
def _leave_out(there, values, first, last, weighting, squares):
    """Fill in the squared errors of the points first..last of the buckets."""
    k = weighting.neighbours
    most, far, near = np.empty(k), np.empty(4 * k + 64), np.empty(4 * k + 64, np.int32)
    for i in range(first, last):
        own, x, y = there.order[i], there.xy[i, 0], there.xy[i, 1]
        found = _search(there, x, y, own, weighting.reach, np.inf, most, far, near)
        if found > 0:
            squares[own] = (values[own] - _mean(values, near, far, found, weighting)) ** 2


@kernel
def _mean(values, near, far, found, weighting):
    """Weighted mean of points from their squared distances, the nearest first."""
    least = far[0] + weighting.smoothing**2
    if least == 0.0:
        return values[near[0]]
    total, above, low = 0.0, 0.0, values[near[0]]
    for i in range(found):
        ratio = least / (far[i] + weighting.smoothing**2)  # so that no power overflows
        weight = ratio if weighting.power == 2.0 else ratio ** (0.5 * weighting.power)
        total += weight
        above += weight * (values[near[i]] - low)
    return low + above / total


@kernel
def _search(there, x, y, own, reach, bound, most, far, near):
    """Find the len(most) points nearest to a position, except point `own`, within `reach`.

    Parameters
    ----------
    bound : a distance within which there are enough, if known
    most : scratch
    far, near : take squared distances, rising, and indices; longer than `most`

    Returns
    -------
    found : how many there are
    """
    if np.isinf(bound):
        bound = _enough(there, x, y, len(most) + (own >= 0))
    bound = min(reach, bound) * (1.0 + ROUNDING)
    most[:] = bound * bound
    xy, order, starts, west, south, size, rows, cols = there
    found = 0
    middle = (y - south) / size
    row = min(max(math.floor(middle), 0), rows - 1)
    up, down = row, row - 1
    while True:  # rows of squares, the nearest first
        rise, fall = up - middle, middle - (down + 1)
        if up < rows and (rise <= fall or down < 0):
            r, away = up, max(rise, 0.0) * size
            up += 1
        elif down >= 0:
            r, away = down, max(fall, 0.0) * size
            down -= 1
        else:
            break
        half = most[0] - (away * (1.0 - ROUNDING)) ** 2
        if half < 0.0:
            if r == row:
                continue
            break
        half = math.sqrt(half) * (1.0 + ROUNDING) + ROUNDING * size
        left = (x - half - west) / size
        right = (x + half - west) / size
        if right < 0.0 or left >= cols:
            continue
        begin = r * cols + int(max(left, 0.0))
        end = r * cols + int(min(right, cols - 1.0)) + 1
        for p in range(starts[begin], starts[end]):
            dx, dy = xy[p, 0] - x, xy[p, 1] - y
            square = dx * dx + dy * dy
            if square <= most[0] and order[p] != own:
                if found == len(far):
                    found = _first(found, most, reach, far, near)
                far[found], near[found] = square, order[p]
                found += 1
                _lower(square, most)
    return _first(found, most, reach, far, near)


@kernel
def _lower(square, most):
    """Insert a number into an array of the least numbers so far, the largest first.

    All elements are computed without a branch, so that the processor can do it in parallel.
    """
    last = len(most) - 1
    for j in range(last):
        kept = square if square < most[j] else most[j]
        most[j] = kept if kept > most[j + 1] else most[j + 1]
    most[last] = square if square < most[last] else most[last]


@kernel
def _first(found, most, reach, far, near):
    """Keep the nearest points, sorted by distance, then by index; the number kept."""
    kept = 0
    for k in range(found):
        square, i = far[k], near[k]
        if square > most[0] or square > reach * reach:
            continue
        at = kept
        while at > 0 and (square < far[at - 1] or (square == far[at - 1] and i < near[at - 1])):
            far[at], near[at] = far[at - 1], near[at - 1]
            at -= 1
        far[at], near[at] = square, i
        kept += 1
    return min(kept, len(most))


@kernel
def _enough(there, x, y, wanted):
    """Distance within which there are at least `wanted` points; inf if there are fewer in all."""
    _, _, starts, west, south, size, rows, cols = there
    col = min(max(math.floor((x - west) / size), 0), cols - 1)
    row = min(max(math.floor((y - south) / size), 0), rows - 1)
    around = 0
    while True:
        left, right = max(col - around, 0), min(col + around, cols - 1)
        low, high = max(row - around, 0), min(row + around, rows - 1)
        count = 0
        for r in range(low, high + 1):
            begin, end = r * cols + left, r * cols + right + 1
            count += starts[end] - starts[begin]
        if count >= wanted:
            dx = max(x - (west + left * size), west + (right + 1) * size - x)
            dy = max(y - (south + low * size), south + (high + 1) * size - y)
            return math.sqrt(dx * dx + dy * dy)
        if around > max(rows, cols):
            return np.inf
        around += 1 + around // 4
