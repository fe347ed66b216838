"""Compiled loop of :mod:`algorithms.shared.breaklines`."""

from __future__ import annotations

import math

import numpy as np

from algorithms.shared.kernels.compiling import kernel


@kernel
def off_continuations(
    first, last, cells, heights, z, ground, reach, octants, wide, least, stiff, out
):
    """Heights above the plane that continues the ground on one side of a cell.

    The heights first..last are asked for, each at its one of the `cells`, counted row by row.
    Of the parts of a disc to eight sides, `wide` octants each, the one is taken whose plane comes
    nearest. `reach` holds the radius, in metres, for blocks of 8 x 8 cells; `octants` the octant of
    each offset from a cell, 8 for the cell itself. A part must hold `least` cells of ground.
    Planes are held level by `stiff` of the square of the radius. Infinite where none does.
    """
    rows, cols = z.shape
    middle = octants.shape[0] // 2
    m, s = np.empty((9, 10)), np.empty(10)
    for p in range(first, last):
        r = cells[p] // cols
        c = cells[p] - r * cols
        out[p] = np.inf
        m[:] = 0.0
        radius = reach[r >> 3, c >> 3]
        square = radius * radius
        far = min(math.ceil(radius), middle)
        for i in range(max(0, r - far), min(rows, r + far + 1)):
            for j in range(max(0, c - far), min(cols, c + far + 1)):
                y, x = i - r, j - c
                away = y * y + x * x
                if away < square and ground[i, j]:
                    a = m[octants[y + middle, x + middle]]
                    w, v = (1 - away / square) ** 2, z[i, j] - heights[p]
                    a[0] += w
                    a[1] += w * x
                    a[2] += w * y
                    a[3] += w * x * x
                    a[4] += w * x * y
                    a[5] += w * y * y
                    a[6] += w * v
                    a[7] += w * v * x
                    a[8] += w * v * y
                    a[9] += 1
        for side in range(8):
            s[:] = 0.0
            for k in range(side, side + wide):
                for n in range(10):
                    s[n] += m[k & 7, n]
            if s[9] < least:
                continue
            x, y, v = s[1] / s[0], s[2] / s[0], s[6] / s[0]
            xx, yy = s[3] / s[0] - x * x + stiff * square, s[5] / s[0] - y * y + stiff * square
            xy, xv, yv = s[4] / s[0] - x * y, s[7] / s[0] - x * v, s[8] / s[0] - y * v
            determinant = xx * yy - xy * xy
            east = (xv * yy - yv * xy) / determinant
            south = (yv * xx - xv * xy) / determinant
            above = east * x + south * y - v
            if abs(above) < abs(out[p]):
                out[p] = above
