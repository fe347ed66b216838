"""Compiled loops of :mod:`algorithms.shared.lowest`."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel
from algorithms.shared.kernels.sorting import first_at

GROUP, MOST = 3.0, 12  # metres, points: of a group of low outliers
SUPPORTER = 3  # points of a group that one supporter farther away weighs
STEP, SLOPE, REACHED = 1.0, 0.3, 10  # metres, -, cells: a cone, and how many must be above it
BAND, DENSE = 5.0, 20  # metres, points: dense terrain above a group
ROUNDING = 1e-6  # cells, as in toolbox.data.Lattice


@kernel
def cells_of(xyz, left, top, cell, rows, cols):
    """Index of the cell of each point, `left` and `top` being the lattice's corner in cells."""
    found = np.empty(len(xyz), np.int32)
    for i in range(len(xyz)):
        col = int(np.floor(xyz[i, 0] / cell + ROUNDING)) - left
        row = top - 1 - int(np.floor(xyz[i, 1] / cell + ROUNDING))
        found[i] = max(row, 0) * cols + min(col, cols - 1)  # outermost edges belong to them
    return found


@kernel
def enter_lowest(xyz, use, start, cells, height, lowest):
    """Update the lowest point of each cell with the points from `start` on, which lie in `cells`.

    Equal heights are decided by position, never by the order of the points.
    """
    for k in range(len(cells)):
        i, cell = start + k, cells[k]
        if not use[i] or xyz[i, 2] > height[cell]:
            continue
        j = lowest[cell]
        if j < 0 or (xyz[i, 2], xyz[i, 0], xyz[i, 1]) < (xyz[j, 2], xyz[j, 0], xyz[j, 1]):
            lowest[cell], height[cell] = i, xyz[i, 2]


@helper
def _support(tops, x, y, z, row, col, cell, reach, metre):
    """Count the cells whose lowest point is under or above a cone and a plane at (x, y, z).

    Cells as near as a group is wide count above only. Enough cells under the plane end the count.
    """
    rows, cols, _ = tops.shape
    cone, plane, above_cone, above_plane = 0, 0, 0, 0
    tip = z + STEP * metre
    for ring in range(int(np.ceil(reach / cell)) + 1):
        for r in range(max(0, row - ring), min(rows, row + ring + 1)):
            stride = 1 if abs(r - row) == ring else 2 * ring
            for c in range(col - ring, col + ring + 1, stride):
                if not 0 <= c < cols:
                    continue
                away = np.sqrt((tops[r, c, 0] - x) ** 2 + (tops[r, c, 1] - y) ** 2)
                if away > reach:
                    continue
                beside, rise = away > GROUP * metre, tops[r, c, 2] - tip
                plane += beside and rise < 0
                above_plane += rise >= 0
                cone += beside and rise < SLOPE * away
                above_cone += rise >= SLOPE * away
        if SUPPORTER * plane >= MOST:
            break
    return cone, plane, above_cone, above_plane


@kernel
def suspects(tops, first, last, cell, reach, metre, ceiling):
    """Set the ceiling of cells in the rows first..last whose lowest point may be an outlier.

    `ceiling` takes the height below which points around it tell whether it is an outlier.
    """
    for row in range(first, last):
        for col in range(tops.shape[1]):
            x, y, z = tops[row, col]
            if np.isinf(x):
                continue
            cone, plane, above_cone, above_plane = _support(
                tops, x, y, z, row, col, cell, reach, metre
            )
            if SUPPORTER * cone < MOST and above_cone >= REACHED:
                ceiling[row, col] = z + (2 * STEP + SLOPE * GROUP) * metre
            elif SUPPORTER * plane < MOST and above_plane >= REACHED:
                ceiling[row, col] = z + (STEP + BAND) * metre


@kernel
def below(xyz, use, start, cells, ceiling):
    """Indices of the points in use, from `start` on, that are below the ceiling of their cell."""
    found, count = np.empty(len(cells), np.int64), 0
    for k in range(len(cells)):
        if xyz[start + k, 2] < ceiling[cells[k]] and use[start + k]:
            found[count] = start + k
            count += 1
    return found[:count].copy()


@kernel
def judge(tops, places, low, cells, cell, reach, metre, alone):
    """Mark the outliers among the low points of the cells at `places`, from the lowest upwards.

    `low` are points sorted by their `cells`, and by height in each.
    """
    for p in range(len(places)):
        row, col = places[p]
        own = row * tops.shape[1] + col
        k = first_at(cells, own, 0, len(cells))
        while k < len(low) and cells[k] == own and low[k, 2] <= tops[row, col, 2] + STEP * metre:
            alone[k] = _is_alone(tops, low[k], row, col, low, cells, cell, reach, metre)
            if not alone[k]:
                break
            k += 1


@helper
def _is_alone(tops, point, row, col, low, cells, cell, reach, metre):
    """Whether few points lie under the cone of a point, or under its plane and dense terrain."""
    rows, cols, _ = tops.shape
    x, y, z = point
    cone, plane, above_cone, above_plane = _support(tops, x, y, z, row, col, cell, reach, metre)
    cone, plane, dense = SUPPORTER * cone, SUPPORTER * plane, 0
    around = int(np.ceil(GROUP * metre / cell))
    for r in range(max(0, row - around), min(rows, row + around + 1)):
        begin = first_at(cells, r * cols + max(0, col - around), 0, len(cells))
        end = first_at(cells, r * cols + min(cols, col + around + 1), 0, len(cells))
        for k in range(begin, end):
            away = np.sqrt((low[k, 0] - x) ** 2 + (low[k, 1] - y) ** 2)
            if away <= GROUP * metre:
                rise = low[k, 2] - z - STEP * metre
                cone += rise < SLOPE * away
                plane += rise < 0
                dense += 0 <= rise < (BAND - STEP) * metre
        if plane > MOST:
            return False
    by_cone = cone <= MOST and above_cone >= REACHED
    return by_cone or (plane <= MOST and above_plane >= REACHED and dense >= DENSE)


@helper
def _nearer(x, y, xyz, near, row, col, from_row, from_col):
    """Set the point of a node to that of a neighbouring node if this one is nearer."""
    if not (0 <= from_row < near.shape[0] and 0 <= from_col < near.shape[1]):
        return
    j, i = near[from_row, from_col], near[row, col]
    if j < 0 or j == i:
        return
    there = (xyz[j, 0] - x) ** 2 + (xyz[j, 1] - y) ** 2
    if i >= 0:
        here = (xyz[i, 0] - x) ** 2 + (xyz[i, 1] - y) ** 2
        if (there, xyz[j, 2], xyz[j, 0]) >= (here, xyz[i, 2], xyz[i, 0]):
            return
    near[row, col] = j


@kernel
def spread_rows(xyz, near, empty, xs, ys, start, stop, way):
    """Pass points on to `empty` nodes at (xs, ys), row by row from start to stop by `way`.

    Two such sweeps, one down and one up, give each node its nearest point (Danielsson 1980,
    vector distance transform with the true positions of the points).
    """
    cols = near.shape[1]
    for row in range(start, stop, way):
        y = ys[row]
        before = row - way
        for col in range(cols):
            if empty[row, col]:
                x = xs[col]
                _nearer(x, y, xyz, near, row, col, before, col - 1)
                _nearer(x, y, xyz, near, row, col, before, col)
                _nearer(x, y, xyz, near, row, col, before, col + 1)
                _nearer(x, y, xyz, near, row, col, row, col - 1)
        for col in range(cols - 2, -1, -1):
            if empty[row, col]:
                x = xs[col]
                _nearer(x, y, xyz, near, row, col, row, col + 1)
