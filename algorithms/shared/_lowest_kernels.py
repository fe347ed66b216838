"""Compiled loops of :mod:`algorithms.shared.lowest`."""

from __future__ import annotations

from numba import njit


@njit(cache=True, nogil=True)
def lowest_points(xyz, use, start, row, col, lowest):  # type: ignore[no-untyped-def]
    """Enter the points from start on, in cells (row, col), as the lowest of their cell.

    Equal heights are decided by position, never by the order of the points.
    """
    for k in range(len(row)):
        i = start + k
        if not use[i]:
            continue
        j = lowest[row[k], col[k]]
        if j < 0 or (xyz[i, 2], xyz[i, 0], xyz[i, 1]) < (xyz[j, 2], xyz[j, 0], xyz[j, 1]):
            lowest[row[k], col[k]] = i


@njit(cache=True, nogil=True)
def alone_below(z, lowest, first, last, reach, step, rise, few, found):  # type: ignore[no-untyped-def]
    """Mark in `found` the cells of the rows first..last whose point is a low outlier.

    A cone with the slope `rise` per cell is put, `step` above its tip, on the point. A point
    of the ground has neighbours under the cone; a low outlier has almost none.
    """
    rows, cols = lowest.shape
    for row in range(first, last):
        for col in range(cols):
            if lowest[row, col] < 0:
                continue
            tip = z[lowest[row, col]] + step
            under, above = 0, 0
            for ring in range(1, reach + 1):
                for r in range(max(0, row - ring), min(rows, row + ring + 1)):
                    stride = 1 if abs(r - row) == ring else 2 * ring
                    for c in range(col - ring, col + ring + 1, stride):
                        if 0 <= c < cols and lowest[r, c] >= 0:
                            if z[lowest[r, c]] < tip + rise * ring:
                                under += 1
                            else:
                                above += 1
                if under >= few:
                    break
            found[row, col] = under < few and above >= 2 * few


@njit(cache=True, nogil=True)
def _nearer(x, y, xyz, near, row, col, from_row, from_col):  # type: ignore[no-untyped-def]
    """Let the node take over its neighbour's point if that is nearer than its own."""
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


@njit(cache=True, nogil=True)
def spread_rows(xyz, near, empty, xs, ys, start, stop, way):  # type: ignore[no-untyped-def]
    """Hand points on to `empty` nodes at (xs, ys), row by row from start to stop by `way`.

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
