"""Compiled loops of the cloth simulation filter; see :mod:`algorithms.ground.csf`.

Heights are turned upside down: the cloth falls towards smaller values and rests on `obstacle`.
Arrays of heights have a rim of REACH nodes on all sides, which repeats the outermost nodes: the
cloth has a free edge. A step reads one array of heights and writes another, node by node, so the
result is the same, bit for bit, for any number of threads.

Steps follow each other at a distance, strip after strip down the lattice: what one has written is
still near at hand, in the cache, when the next reads it.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

REACH = 2  # nodes: the longest spring
TILE = 64  # nodes: side of the squares that fall asleep one by one
STRIP = 8  # rows of a tile that are worked on at a time


@njit(cache=True, nogil=True)
def step_serial(strips, even, odd, obstacle, drop, inertia):  # type: ignore[no-untyped-def]
    """As :func:`step`, without the price of waking threads."""
    for t in range(len(strips)):
        _step_strip(strips[t], even, odd, obstacle, drop, inertia)


@njit(cache=True, nogil=True, parallel=True)
def step(strips, even, odd, obstacle, drop, inertia):  # type: ignore[no-untyped-def]
    """Springs, gravity and inertia of one step for the given strips (row, column, step).

    Even steps read the heights `even` and write `odd`, odd ones the other way round. What is
    written held the heights one step earlier, and receives those one step later.
    """
    for t in prange(len(strips)):
        _step_strip(strips[t], even, odd, obstacle, drop, inertia)


@njit(cache=True, nogil=True)
def _step_strip(strip, even, odd, obstacle, drop, inertia):  # type: ignore[no-untyped-def]
    """One step of one strip.

    A particle goes half way to the mean of its 16 neighbours, keeps the share `inertia` of its
    last way, falls by `drop` and is held up by the obstacle. Rows are cut out first, so that
    indices start at 0 and the loop becomes vector code.
    """
    height, out = (even, odd) if strip[2] % 2 == 0 else (odd, even)
    rows, cols = obstacle.shape
    first, last = strip[1], min(strip[1] + TILE, cols)
    wide = slice(first, last + 2 * REACH)
    for r in range(strip[0], min(strip[0] + STRIP, rows)):
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
        _continue_edges(out, r, first, last, rows, cols)


@njit(cache=True, nogil=True)
def _continue_edges(height, row, first, last, rows, cols):  # type: ignore[no-untyped-def]
    """Let the rim repeat the nodes first..last of a row that are outermost."""
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


@njit(cache=True, nogil=True)
def movement(tiles, height, before):  # type: ignore[no-untyped-def]
    """The longest way of a particle of each tile in the last step."""
    longest = np.zeros(len(tiles))
    rows, cols = height.shape[0] - REACH, height.shape[1] - REACH
    for t in range(len(tiles)):
        row, col = tiles[t]
        for r in range(row + REACH, min(row + REACH + TILE, rows)):
            for c in range(col + REACH, min(col + REACH + TILE, cols)):
                longest[t] = max(longest[t], abs(height[r, c] - before[r, c]))
    return longest


@njit(cache=True, nogil=True)
def hold(tiles, height, before):  # type: ignore[no-untyped-def]
    """Let both arrays agree on tiles that fall asleep."""
    rows, cols = height.shape[0] - REACH, height.shape[1] - REACH
    for t in range(len(tiles)):
        row, col = tiles[t]
        for r in range(row + REACH, min(row + REACH + TILE, rows)):
            for c in range(col + REACH, min(col + REACH + TILE, cols)):
                before[r, c] = height[r, c]


@njit(cache=True, nogil=True)
def settle_slopes(height, obstacle, resting, steep, step):  # type: ignore[no-untyped-def]
    """Let movable particles down beside `resting` ones, from the rim inwards (in place).

    A `steep` particle is let down on its obstacle where that lies within `step` of the obstacle
    of one of its four neighbours that rests already. The outcome is what can be reached from
    the rim, whatever the order of the visits.
    """
    rows, cols = height.shape
    waiting = np.empty(rows * cols - np.sum(resting), np.int64)
    count = 0
    for row in range(rows):
        for col in range(cols):
            if resting[row, col]:
                count = _let_down(obstacle, resting, steep, step, row, col, waiting, count)
    while count > 0:
        count -= 1
        row, col = divmod(waiting[count], cols)
        height[row, col] = obstacle[row, col]
        count = _let_down(obstacle, resting, steep, step, row, col, waiting, count)


@njit(cache=True, nogil=True)
def _let_down(obstacle, resting, steep, step, row, col, waiting, count):  # type: ignore[no-untyped-def]
    """Let the steep movable neighbours of a resting particle rest and note them as waiting."""
    for r, c in ((row - 1, col), (row + 1, col), (row, col - 1), (row, col + 1)):
        if 0 <= r < obstacle.shape[0] and 0 <= c < obstacle.shape[1]:
            if resting[r, c] or not steep[r, c]:
                continue
            if abs(obstacle[r, c] - obstacle[row, col]) < step:
                resting[r, c] = True
                waiting[count] = r * obstacle.shape[1] + c
                count += 1
    return count


@njit(cache=True, nogil=True, parallel=True)
def near_surface(heights, left, top, cell, xyz, threshold):  # type: ignore[no-untyped-def]
    """Whether each point is within threshold + slope x cell of the bilinear lattice, up or down.

    The lattice begins `left` and `top` cells from the origin of the coordinates; beyond its
    outermost nodes it goes on level.
    """
    rows, cols = heights.shape
    near = np.empty(len(xyz), np.bool_)
    for i in prange(len(xyz)):
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
    return near
