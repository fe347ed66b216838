"""Compiled loops of the cloth simulation filter; see :mod:`algorithms.ground.csf`.

Heights are turned upside down: the cloth falls towards smaller values and rests on `obstacle`.
Arrays of heights have a rim of REACH nodes on all sides, which repeats the outermost nodes: the
cloth has a free edge. A step reads one array of heights and writes another, node by node, so the
result is the same, bit for bit, for any number of threads.

Several steps are made at once in bands of columns that fit into the cache. Each step of a band is
narrower than the one before by what it must not know of other bands, and the seams between the
bands, where steps grow wider as they grow narrower beside them, are made afterwards (split
tiling: Bandishti, V. et al. 2012. Tiling stencil computations to maximize parallelism. SC '12).
No band and no seam needs another, and none overwrites what another still reads.
"""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel

REACH = 2  # nodes: the longest spring
TILE = 64  # nodes: side of the squares that are skipped once they are at rest
STRIP = 4  # rows that are worked on at a time: divides TILE, and REACH or more
BAND = 256  # columns: at least twice the reach of all steps that are made at once


@kernel
def fall(first, last, spread, steps, awake, even, odd, obstacle, drop, inertia):
    """Make several steps of the bands first..last, or of the seams at their left.

    Parameters
    ----------
    first, last : numbers of the bands
    spread : columns by which each step is wider than the one before on either side: -REACH for
        bands, REACH for seams, which begin with none
    steps : even ones read the heights `even` and write `odd`, odd ones the other way round; what
        is written held the heights one step earlier, and receives those one step later
    awake : which tiles to work on
    """
    rows, cols = obstacle.shape
    strips = (rows + STRIP - 1) // STRIP
    for band in range(first, last):
        west, east = band * BAND, (band * BAND if spread > 0 else (band + 1) * BAND)
        # A step follows the one before two strips behind: it needs what that wrote beside its own
        # strip, and overwrites what that has read.
        for turn in range(strips + 2 * (steps - 1)):
            for number in range(steps):
                strip = turn - 2 * number
                if not 0 <= strip < strips:
                    continue
                left = west - spread * number if west > 0 else 0
                right = east + spread * number if east < cols else cols
                heights, out = (even, odd) if number % 2 == 0 else (odd, even)
                _step_strip(
                    strip * STRIP,
                    max(left, 0),
                    min(right, cols),
                    awake,
                    heights,
                    out,
                    obstacle,
                    drop,
                    inertia,
                )


@helper
def _step_strip(row, left, right, awake, height, out, obstacle, drop, inertia):
    """Make one step of the awake tiles in the columns left..right of a strip of rows."""
    last = min(row + STRIP, obstacle.shape[0])
    while left < right:
        end = left
        while end < right and awake[row // TILE, end // TILE]:
            end = min((end // TILE + 1) * TILE, right)
        for r in range(row, last if end > left else row):
            _step_row(r, left, end, height, out, obstacle, drop, inertia)
            _continue_edges(out, r, left, end, *obstacle.shape)
        left = (end // TILE + 1) * TILE


@helper
def _step_row(r, first, last, height, out, obstacle, drop, inertia):
    """Make one step of the columns first..last of a row: springs, gravity and inertia.

    A particle goes half way to the mean of its 16 neighbours, keeps the share `inertia` of its
    last way, falls by `drop` and is held up by the obstacle. Rows are cut out first, so that
    indices start at 0 and the loop becomes vector code.
    """
    wide = slice(first, last + 2 * REACH)
    n2, n1, own = height[r, wide], height[r + 1, wide], height[r + 2, wide]
    s1, s2 = height[r + 3, wide], height[r + 4, wide]
    to = out[r + REACH, first + REACH : last + REACH]
    floor, fall = obstacle[r, first:last], drop[r, first:last]
    for j in range(len(to)):
        near = (
            (n1[j + 1] + n1[j + 2] + n1[j + 3])
            + (own[j + 1] + own[j + 3])
            + (s1[j + 1] + s1[j + 2] + s1[j + 3])
        )
        far = (
            (n2[j] + n2[j + 2] + n2[j + 4])
            + (own[j] + own[j + 4])
            + (s2[j] + s2[j + 2] + s2[j + 4])
        )
        here = own[j + 2]
        free = 0.5 * here + (near + far) / 32.0 + inertia * (here - to[j]) - fall[j]
        to[j] = max(free, floor[j])


@helper
def _continue_edges(height, row, first, last, rows, cols):
    """Copy the outermost nodes among first..last of a row into the rim."""
    here = height[row + REACH]
    for k in range(REACH):
        if first == 0:
            here[k] = here[REACH]
        if last == cols:
            here[cols + REACH + k] = here[cols + REACH - 1]
    if row not in (0, rows - 1):
        return
    for c in range(first + (REACH if first else 0), last + REACH + (REACH if last == cols else 0)):
        for k in range(REACH):
            if row == 0:
                height[k, c] = here[c]
            if row == rows - 1:
                height[rows + REACH + k, c] = here[c]


@kernel
def movement(first, last, awake, height, before, still, moving):
    """Set `moving` for tiles in which a particle moved by more than `still`."""
    rows, cols = height.shape[0] - REACH, height.shape[1] - REACH
    for i in range(first, last):
        for j in range(awake.shape[1]):
            longest, row, col = 0.0, REACH + i * TILE, REACH + j * TILE
            if awake[i, j]:
                for r in range(row, min(row + TILE, rows)):
                    for c in range(col, min(col + TILE, cols)):
                        longest = max(longest, abs(height[r, c] - before[r, c]))
            moving[i, j] = longest > still


@kernel
def settle_slopes(height, obstacle, resting, steep, step, waiting):
    """Let movable particles down beside `resting` ones, from the resting ones inwards (in place).

    A `steep` particle is let down on its obstacle where that lies within `step` of the obstacle of
    one of its four neighbours that rests already. The outcome is what can be reached from the
    resting ones, whatever the order of the visits. `waiting` is scratch for all movable particles.
    """
    rows, cols = height.shape
    count = np.int64(0)  # a plain 0 would be a type of its own, and _let_down compiled twice
    for row in range(rows):
        for col in range(cols):
            if resting[row, col]:
                count = _let_down(obstacle, resting, steep, step, row, col, waiting, count)
    while count > 0:
        count -= 1
        row, col = divmod(waiting[count], cols)
        height[row, col] = obstacle[row, col]
        count = _let_down(obstacle, resting, steep, step, row, col, waiting, count)


@helper
def _let_down(obstacle, resting, steep, step, row, col, waiting, count):
    """Let the steep movable neighbours of a resting particle down, and list them as waiting."""
    for r, c in ((row - 1, col), (row + 1, col), (row, col - 1), (row, col + 1)):
        if 0 <= r < obstacle.shape[0] and 0 <= c < obstacle.shape[1]:
            if resting[r, c] or not steep[r, c]:
                continue
            if abs(obstacle[r, c] - obstacle[row, col]) < step:
                resting[r, c] = True
                waiting[count] = r * obstacle.shape[1] + c
                count += 1
    return count


@kernel
def near_surface(first, last, xyz, heights, left, top, cell, threshold, near):
    """Set `near` for points within threshold + slope x cell of the bilinear lattice, up or down.

    The lattice begins `left` and `top` cells from the origin of the coordinates; beyond its
    outermost nodes it goes on level.
    """
    rows, cols = heights.shape
    for i in range(first, last):
        y = min(max(top - xyz[i, 1] / cell - 0.5, 0.0), rows - 1.0)
        x = min(max(xyz[i, 0] / cell - left - 0.5, 0.0), cols - 1.0)
        row, col = min(int(y), rows - 2), min(int(x), cols - 2)
        v, u = y - row, x - col
        nw, ne = heights[row, col], heights[row, col + 1]
        sw, se = heights[row + 1, col], heights[row + 1, col + 1]
        elevation = (nw * (1 - u) + ne * u) * (1 - v) + (sw * (1 - u) + se * u) * v
        eastward = (ne - nw) * (1 - v) + (se - sw) * v  # rise per cell
        southward = (sw - nw) * (1 - u) + (se - ne) * u
        near[i] = abs(xyz[i, 2] - elevation) <= threshold + np.hypot(eastward, southward)
