"""Compiled loops of :mod:`algorithms.shared.polygons`.

A directed edge is (x1, y1, x2, y2); shells turn counter-clockwise and holes clockwise, so that the
winding number of a place is the number of polygons that hold it. Every place is thought of as moved
by an infinitely small step up, and by a still smaller one to the right (Edelsbrunner & Mücke 1990):
then no place lies on an edge, and each crossing counts once.
"""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel
from algorithms.shared.kernels.delaunay import orient


@kernel
def count(edges, west, south, cell, margin, rows, cols):
    """Start of each cell in the list that `fill` makes, array of shape (rows * cols + 1,)."""
    starts = np.zeros(rows * cols + 1, np.int64)
    for e in range(len(edges)):
        first, last = _span(edges[e, 1], edges[e, 3], south, cell, margin, rows)
        for row in range(first, last + 1):
            low, high = _within_row(edges[e], row, south, cell, margin)
            left, right = _span(low, high, west, cell, margin, cols)
            for col in range(left, right + 1):
                starts[row * cols + col + 1] += 1
    for k in range(rows * cols):
        starts[k + 1] += starts[k]
    return starts


@kernel
def fill(edges, west, south, cell, margin, rows, cols, starts):
    """Indices of the edges that may touch each cell, cell by cell."""
    listed, free = np.empty(starts[-1], np.int32), starts[:-1].copy()
    for e in range(len(edges)):
        first, last = _span(edges[e, 1], edges[e, 3], south, cell, margin, rows)
        for row in range(first, last + 1):
            low, high = _within_row(edges[e], row, south, cell, margin)
            left, right = _span(low, high, west, cell, margin, cols)
            for col in range(left, right + 1):
                listed[free[row * cols + col]] = e
                free[row * cols + col] += 1
    return listed


@kernel
def corners(edges, listed, starts, west, south, cell, rows, cols):
    """Winding number of the lower left corner of each cell; 0 in the first column."""
    winding = np.zeros(rows * cols, np.int32)
    for row in range(rows):
        y = south + row * cell
        for col in range(cols - 1):
            here = row * cols + col
            x, next_x = west + col * cell, west + (col + 1) * cell
            change = 0
            for k in range(starts[here], starts[here + 1]):
                e = edges[listed[k]]
                change += _crossings_of_ray(e, next_x, y) - _crossings_of_ray(e, x, y)
            winding[here + 1] = winding[here] + change
    return winding


@kernel
def inside(first, last, xyz, edges, listed, starts, winding, frame, found):
    """Set `found` for the points first..last that are in a polygon or on its edge.

    Parameters
    ----------
    xyz : array of shape (n, 2 or 3)
    edges, listed, starts, winding : of the other kernels
    frame : west, south, cell, rows, cols
    found : array of shape (n,), all False
    """
    west, south, cell, rows, cols = frame
    for i in range(first, last):
        x, y = xyz[i, 0], xyz[i, 1]
        right, up = (x - west) / cell, (y - south) / cell
        if not (0 <= right < cols and 0 <= up < rows):
            continue
        col, row = int(right), int(up)
        here = row * cols + col
        number = winding[here]
        corner_x, corner_y = west + col * cell, south + row * cell
        for k in range(starts[here], starts[here + 1]):
            e = edges[listed[k]]
            if _is_on(e, x, y):
                number = 1
                break
            number += _crossings_of_ray(e, x, y) - _crossings_of_ray(e, corner_x, y)
            number += _crossing_upwards(e, corner_x, corner_y, y)
        found[i] = number > 0


@helper
def _span(a, b, begin, cell, margin, size):
    """First and last index of the cells that an interval may touch."""
    first = int((min(a, b) - margin - begin) / cell)
    last = int((max(a, b) + margin - begin) / cell)
    return max(first, 0), min(last, size - 1)


@helper
def _within_row(e, row, south, cell, margin):
    """x at both ends of the section of an edge within a row of cells."""
    x1, y1, x2, y2 = e
    low, high = south + row * cell - margin, south + (row + 1) * cell + margin
    ends = (x1, x2)
    if y1 == y2:
        return ends
    slope = (x2 - x1) / (y2 - y1)
    a = x1 if low <= y1 <= high else x1 + ((low if y1 < low else high) - y1) * slope
    b = x2 if low <= y2 <= high else x1 + ((low if y2 < low else high) - y1) * slope
    return a, b


@helper
def _is_on(e, x, y):
    """Whether a position is on a closed edge, exactly."""
    x1, y1, x2, y2 = e
    if x < min(x1, x2) or x > max(x1, x2) or y < min(y1, y2) or y > max(y1, y2):
        return False
    return orient(x1, y1, x2, y2, x, y) == 0.0


@helper
def _crossings_of_ray(e, x, y):
    """Crossing of an edge by the ray to the left: 1 if the edge goes down, -1 up, 0 for none."""
    x1, y1, x2, y2 = e
    way = -1
    if y1 > y2:
        x1, y1, x2, y2, way = x2, y2, x1, y1, 1
    if not y1 <= y < y2 or x < min(x1, x2):
        return 0
    if x > max(x1, x2):
        return way
    turn = orient(x1, y1, x2, y2, x, y)
    is_right = turn < 0.0 or (turn == 0.0 and x2 <= x1)  # a step up leads to the right of it
    return way if is_right else 0


@helper
def _crossing_upwards(e, x, low, high):
    """Crossing of an edge by the way up from low to high: 1 if it goes right, -1 left, 0 for none.

    Going down counts the other way round.
    """
    x1, y1, x2, y2 = e
    way = 1
    if x1 > x2:
        x1, y1, x2, y2, way = x2, y2, x1, y1, -1
    if not x1 <= x < x2:
        return 0
    above_low = orient(x1, y1, x2, y2, x, low) >= 0.0  # a step up leads above it
    above_high = orient(x1, y1, x2, y2, x, high) >= 0.0
    if above_low == above_high:
        return 0
    return way if above_high else -way
