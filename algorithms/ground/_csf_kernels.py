"""Compiled loops of the cloth simulation filter; see :mod:`algorithms.ground.csf`.

Heights are turned upside down: the cloth falls towards smaller values and rests on `obstacle`.
Arrays of heights have a rim of REACH nodes on all sides, which repeats the outermost nodes: the
cloth has a free edge. A step reads one array of heights and writes another, node by node, so the
result is the same, bit for bit, for any number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

REACH = 2  # nodes: the longest spring
TILE = 64  # nodes: side of the squares that fall asleep one by one


@njit(cache=True, nogil=True)
def step_serial(tiles, height, out, obstacle, drop, inertia):  # type: ignore[no-untyped-def]
    """As :func:`step`, without the price of waking threads."""
    for t in range(len(tiles)):
        _step_tile(tiles[t], height, out, obstacle, drop, inertia)


@njit(cache=True, nogil=True, parallel=True)
def step(tiles, height, out, obstacle, drop, inertia):  # type: ignore[no-untyped-def]
    """Springs, gravity and inertia of one step for the given tiles (first row, first column).

    `out` holds the heights before `height`, and receives those after it.
    """
    for t in prange(len(tiles)):
        _step_tile(tiles[t], height, out, obstacle, drop, inertia)


@njit(cache=True, nogil=True)
def _step_tile(corner, height, out, obstacle, drop, inertia):  # type: ignore[no-untyped-def]
    """One step of one tile.

    A particle goes half way to the mean of its 16 neighbours, keeps the share `inertia` of its
    last way, falls by `drop` and is held up by the obstacle. Rows are cut out first, so that
    indices start at 0 and the loop becomes vector code.
    """
    rows, cols = obstacle.shape
    first, last = corner[1], min(corner[1] + TILE, cols)
    wide = slice(first, last + 2 * REACH)
    for r in range(corner[0], min(corner[0] + TILE, rows)):
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


@njit(cache=True, nogil=True)
def continue_edges(height):  # type: ignore[no-untyped-def]
    """Let the rim repeat the outermost nodes."""
    for k in range(REACH):
        height[:, k] = height[:, REACH]
        height[:, -1 - k] = height[:, -1 - REACH]
    for k in range(REACH):
        height[k] = height[REACH]
        height[-1 - k] = height[-1 - REACH]


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
        row, col = tiles[t] + REACH
        r, c = slice(row, min(row + TILE, rows)), slice(col, min(col + TILE, cols))
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
