"""Compiled loops of :mod:`algorithms.surface._centre_triangles`."""

from __future__ import annotations

import math

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel
from algorithms.shared.kernels.delaunay import in_circle, orient
from algorithms.surface._tin_kernels import on_corners

# A circle around a position reaches no farther than its diameter, so those with radii up to 2.4
# squares end within WINDOW. A larger one, cut down to 2.4, holds 2 x 2 whole squares, as
# sqrt(2) (2 + 1) / 2 < 2.4; and what is on it is within SPREAD of these, as 2.4 + 1 / 2 - 1 < 2.
WINDOW = 5  # squares on each side
WINDOWS = (1, 2, 3, WINDOW)  # looked into one after the other, until the circle lies within
SPREAD = 2  # squares on each side of 2 x 2 empty ones
ROUNDING = 2.0**-44  # share by which a plane is wrong at most, for a triangle of some breadth
SLIVER = 1e-8  # of the square of the extent: the circle of a flatter triangle is not known well
MARGIN = 1e-5  # share of a window that the circles of all others may be wrong by


@kernel
def settle(xy, values, starts):
    """Average points at one position, in place, and sort those of each square by x, y.

    Values are added from the lowest on, so that the order of the points makes no difference.
    `starts` is that of fewer points afterwards; returns how many there are.
    """
    count = begin = 0
    for square in range(len(starts) - 1):
        end = starts[square + 1]
        _sort(xy, values, begin, end)
        while begin < end:
            x, y, low, above, size = xy[begin, 0], xy[begin, 1], values[begin], 0.0, 0
            while begin < end and xy[begin, 0] == x and xy[begin, 1] == y:
                above += values[begin] - low
                size += 1
                begin += 1
            xy[count, 0], xy[count, 1], values[count] = x, y, low + above / size
            count += 1
        starts[square + 1] = count
    return count


@helper
def _sort(xy, values, start, stop):
    """Sort points by x, y, then value, in place (Shell 1959)."""
    gap = 1
    while gap < (stop - start) // 9:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(start + gap, stop):
            x, y, value, j = xy[i, 0], xy[i, 1], values[i], i
            while j >= start + gap and (x, y, value) < (
                xy[j - gap, 0],
                xy[j - gap, 1],
                values[j - gap],
            ):
                xy[j, 0], xy[j, 1], values[j] = xy[j - gap, 0], xy[j - gap, 1], values[j - gap]
                j -= gap
            xy[j, 0], xy[j, 1], values[j] = x, y, value
        gap //= 3


@kernel
def fill(first_row, last_row, xy, values, starts, west, south, size, rows, cols, xs, ys, surface):
    """Fill in some rows of the surface where the triangle around the centre is small."""
    near, index = np.empty((3, 256)), np.empty(256, np.int64)
    corners, heights, nearest = np.empty((3, 2)), np.empty(3), np.empty(4, np.int64)
    for row in range(first_row, last_row):
        for col in range(len(xs)):
            x, y = xs[col], ys[row]
            at_row, at_col = math.floor((y - south) / size), math.floor((x - west) / size)
            if not (0 <= at_row < rows and 0 <= at_col < cols):
                continue
            a = b = c = np.int64(-1)
            for wide in WINDOWS:
                near, index, count = _gather(
                    xy, starts, rows, cols, at_row, at_col, wide, x, y, near, index
                )
                if a < 0:
                    a, b, c = _surrounding(xy, near, index, count, nearest, x, y)
                    if a < 0:
                        continue
                a, b, c, reach = _smallest(xy, near, index, count, a, b, c, x, y)
                if reach <= wide * size * (1.0 - MARGIN):
                    surface[row, col] = _height(xy, values, a, b, c, corners, heights, x, y)
                    break


@helper
def _gather(xy, starts, rows, cols, row, col, wide, x, y, near, index):
    """Copy the points of a window: where they are from a position, their squared distance, index.

    Returns the arrays given, or larger ones, and how many points there are.
    """
    low, high = max(row - wide, 0), min(row + wide + 1, rows)
    left, right = max(col - wide, 0), min(col + wide + 1, cols)
    count = 0
    for r in range(low, high):
        count += starts[r * cols + right] - starts[r * cols + left]
    if count > len(index):
        near, index = np.empty((3, 2 * count)), np.empty(2 * count, np.int64)
    count = 0
    for r in range(low, high):
        for i in range(starts[r * cols + left], starts[r * cols + right]):
            near[0, count], near[1, count] = xy[i, 0] - x, xy[i, 1] - y
            near[2, count] = near[0, count] ** 2 + near[1, count] ** 2
            index[count] = i
            count += 1
    return near, index, count


@helper
def _before(xy, a, b):
    """Whether point a comes before b, by x, then y."""
    return xy[a, 0] < xy[b, 0] or (xy[a, 0] == xy[b, 0] and xy[a, 1] < xy[b, 1])


@helper
def _height(xy, values, a, b, c, corners, heights, x, y):
    """Linear interpolation in a triangle, its corners numbered by x, then y, as in a Tin."""
    if _before(xy, b, a) and _before(xy, b, c):
        a, b, c = b, c, a
    elif _before(xy, c, a) and _before(xy, c, b):
        a, b, c = c, a, b
    second, third = (1, 2) if _before(xy, b, c) else (2, 1)
    corners[0, 0], corners[0, 1], heights[0] = xy[a, 0], xy[a, 1], values[a]
    corners[second, 0], corners[second, 1], heights[second] = xy[b, 0], xy[b, 1], values[b]
    corners[third, 0], corners[third, 1], heights[third] = xy[c, 0], xy[c, 1], values[c]
    return on_corners(corners, heights, 0, second, third, x, y)


@helper
def _left(xy, a, b, x, y):
    """Whether a position is to the left of the line from a to b; if on it, a hair east of it.

    And if it is on the line then, a hair of a hair north of it.
    """
    ax, ay, bx, by = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1]
    side = orient(ax, ay, bx, by, x, y)
    if side != 0.0:
        return side > 0.0
    return by < ay or (by == ay and bx > ax)


@helper
def _surrounding(xy, near, index, count, nearest, x, y):
    """Three points around a position, counter-clockwise, -1 if there is not one in each quarter.

    Of the nearest in each quarter, those on that side of the diagonal on which the position is.
    """
    nearest[:] = -1
    for i in range(count):
        quarter = 2 * (near[1, i] > 0.0) + (near[0, i] > 0.0)
        if nearest[quarter] < 0 or near[2, i] < near[2, nearest[quarter]]:
            nearest[quarter] = i
    for quarter in range(4):
        if nearest[quarter] < 0:
            return np.int64(-1), np.int64(-1), np.int64(-1)
    southwest, southeast = index[nearest[0]], index[nearest[1]]
    northwest, northeast = index[nearest[2]], index[nearest[3]]
    if _left(xy, southwest, northeast, x, y):
        return southwest, northeast, northwest
    return southwest, southeast, northeast


@helper
def _smallest(xy, near, index, count, a, b, c, x, y):
    """The triangle around a position whose circle holds none of some points, and its reach.

    A point within the circle takes the place of that vertex without which the position stays in
    the triangle. Above the position, the plane through the vertices raised by their squared
    distances sinks each time, so this ends (the simplex method).

    Returns
    -------
    a, b, c : the vertices
    reach : how far from the position the circle extends at most, infinite if not known well
    """
    while True:
        ax, ay, bx, by = xy[a, 0] - x, xy[a, 1] - y, xy[b, 0] - x, xy[b, 1] - y
        cx, cy = xy[c, 0] - x, xy[c, 1] - y
        raised = ax * ax + ay * ay
        ux, uy, uz = bx - ax, by - ay, bx * bx + by * by - raised
        vx, vy, vz = cx - ax, cy - ay, cx * cx + cy * cy - raised
        area = ux * vy - uy * vx
        east, north = (uz * vy - vz * uy) / area, (ux * vz - vx * uz) / area
        level = raised - east * ax - north * ay
        farthest = max(abs(ax), abs(ay), abs(bx), abs(by), abs(cx), abs(cy))
        lowest, at, extent = _deepest(near, count, east, north, level)
        extent = max(extent, farthest * farthest)
        slack = np.inf
        if area > SLIVER * extent:
            steep = (abs(east) + abs(north)) / math.sqrt(extent)
            slack = ROUNDING * extent * (1.0 + extent / area) * (1.0 + steep)
        if lowest < -slack:
            p = index[at]
        else:
            p = _in_doubt(xy, near, index, count, a, b, c, east, north, level, slack)
            if p < 0:
                break
        to_a, to_b, to_c = _left(xy, p, a, x, y), _left(xy, p, b, x, y), _left(xy, p, c, x, y)
        if to_b and not to_c:
            a = p
        elif to_c and not to_a:
            b = p
        else:
            c = p
    if not area > SLIVER * extent:
        return a, b, c, np.inf
    away = (east * east + north * north) / 4.0
    return a, b, c, math.sqrt(away) + math.sqrt(away + level)


@helper
def _deepest(near, count, east, north, level):
    """How far the points are above a plane at least, which one that is, and how far they reach."""
    lowest, at, extent = np.inf, 0, 0.0
    for i in range(count):
        above = near[2, i] - (east * near[0, i] + north * near[1, i] + level)
        if above < lowest:
            lowest, at = above, i
        extent = max(extent, near[2, i])
    return lowest, at, extent


@helper
def _in_doubt(xy, near, index, count, a, b, c, east, north, level, slack):
    """A point that is within the circle of a triangle though rounding hides it, -1 if none is."""
    for i in range(count):
        above = near[2, i] - (east * near[0, i] + north * near[1, i] + level)
        p = index[i]
        if above > slack or p in (a, b, c):
            continue
        if in_circle(
            xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1], xy[p, 0], xy[p, 1]
        ):
            return p
    return np.int64(-1)
