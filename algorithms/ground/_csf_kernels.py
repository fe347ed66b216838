"""Compiled loops of the cloth simulation filter; see :mod:`algorithms.ground.csf`.

Heights are turned upside down: the cloth falls towards smaller values and rests on
`obstacle`. A particle is movable as long as it is above its obstacle, so no mask is kept.
The cloth is worked on in tiles of ALONG x ACROSS nodes. A tile reads the heights before the
step in its own nodes and around them, and writes its own nodes of another array. So the
result is the same, bit for bit, for any number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

REACH = 2  # nodes: the longest spring
ALONG, ACROSS = 64, 128  # nodes of a tile; its scratch stays in the cache


@njit(cache=True, nogil=True)
def tiles_of(rows, cols):  # type: ignore[no-untyped-def]
    """First row and column of every tile, shape (tiles, 2)."""
    corners = [(r, c) for r in range(0, rows, ALONG) for c in range(0, cols, ACROSS)]
    return np.array(corners)


@njit(cache=True, nogil=True)
def movable(tiles, height, obstacle):  # type: ignore[no-untyped-def]
    """True for tiles with a movable particle."""
    found = np.empty(len(tiles), np.bool_)
    for t in range(len(tiles)):
        row, col = tiles[t]
        own = (slice(row, row + ALONG), slice(col, col + ACROSS))
        found[t] = (height[own] > obstacle[own]).any()
    return found


@njit(cache=True, nogil=True)
def step_serial(tiles, height, out, before, obstacle, passes, drag, drop):  # type: ignore[no-untyped-def]
    """As :func:`step`, without the price of waking threads."""
    moved = np.zeros(len(tiles))
    for t in range(len(tiles)):
        moved[t] = _tile(tiles[t], height, out, before, obstacle, passes, drag, drop)
    return moved


@njit(cache=True, nogil=True, parallel=True)
def step(tiles, height, out, before, obstacle, passes, drag, drop):  # type: ignore[no-untyped-def]
    """One step of the simulation for the given tiles; the largest movement in each.

    `height` are the heights after gravity acted, `out` receives those of the next step.
    `before` are the heights before gravity acted, and is brought up to date.
    """
    moved = np.zeros(len(tiles))
    for t in prange(len(tiles)):
        moved[t] = _tile(tiles[t], height, out, before, obstacle, passes, drag, drop)
    return moved


@njit(cache=True, nogil=True)
def _tile(corner, height, out, before, obstacle, passes, drag, drop):  # type: ignore[no-untyped-def]
    """Springs, then inertia and gravity, for one tile; the largest movement in it."""
    rows, cols = height.shape
    halo = REACH * passes
    first_row, first_col = corner[0] - halo, corner[1] - halo  # of the scratch
    last_row, last_col = min(corner[0] + ALONG, rows), min(corner[1] + ACROSS, cols)
    a = np.empty((last_row - corner[0] + 2 * halo, last_col - corner[1] + 2 * halo))
    b = np.empty_like(a)
    for i in range(len(a)):
        r = min(max(first_row + i, 0), rows - 1)
        for j in range(a.shape[1]):
            a[i, j] = height[r, min(max(first_col + j, 0), cols - 1)]
    for k in range(1, passes + 1):
        _pull(a, b, obstacle, first_row, first_col, REACH * k)
        _continue_edges(b, first_row, first_col, rows, cols)
        a, b = b, a
    largest = 0.0
    for r in range(corner[0], last_row):
        for c in range(corner[1], last_col):
            here, rest = a[r - first_row, c - first_col], obstacle[r, c]
            way = here - before[r, c]
            to = here + (1.0 - drag) * way - drop
            out[r, c] = max(to, rest) if here > rest else rest
            before[r, c] = here
            largest = max(largest, abs(way))
    return largest


@njit(cache=True, nogil=True)
def _pull(a, b, obstacle, first_row, first_col, margin):  # type: ignore[no-untyped-def]
    """Each movable particle goes half way to the mean of its 16 neighbours, from a to b.

    Rows are cut out first, so that indices start at 0 and the loop becomes vector code.
    """
    rows, cols = obstacle.shape
    start, stop = max(margin, -first_col), min(a.shape[1] - margin, cols - first_col)
    wide = slice(start - REACH, stop + REACH)
    for i in range(max(margin, -first_row), min(len(a) - margin, rows - first_row)):
        n2, n1, own = a[i - 2, wide], a[i - 1, wide], a[i, wide]
        s1, s2 = a[i + 1, wide], a[i + 2, wide]
        rest = obstacle[first_row + i, first_col + start : first_col + stop]
        to = b[i, start:stop]
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
            here, floor = own[j + 2], rest[j]
            pulled = 0.5 * here + (near + far) / 32.0
            if here <= floor or pulled < floor:
                pulled = floor
            to[j] = pulled


@njit(cache=True, nogil=True)
def _continue_edges(a, first_row, first_col, rows, cols):  # type: ignore[no-untyped-def]
    """Beyond the lattice repeat its outermost nodes: the cloth has a free edge."""
    left, right = max(-first_col, 0), min(a.shape[1], cols - first_col)
    top, bottom = max(-first_row, 0), min(len(a), rows - first_row)
    for i in range(top, bottom):
        a[i, :left] = a[i, left]
        a[i, right:] = a[i, right - 1]
    for i in range(top):
        a[i] = a[top]
    for i in range(bottom, len(a)):
        a[i] = a[bottom - 1]


@njit(cache=True, nogil=True)
def settle_slopes(height, obstacle, step):  # type: ignore[no-untyped-def]
    """Let movable particles down beside unmovable ones, from the rim inwards (in place).

    A particle is let down on its obstacle where that lies within `step` of the obstacle of
    one of its four neighbours that rests already. The outcome is what can be reached from
    the rim, whatever the order of the visits.
    """
    rows, cols = height.shape
    waiting = np.empty((np.sum(height > obstacle), 2), np.int64)
    count = 0
    for row in range(rows):
        for col in range(cols):
            if height[row, col] <= obstacle[row, col]:
                count = _let_down(height, obstacle, step, row, col, waiting, count)
    while count > 0:
        count -= 1
        row, col = waiting[count]
        count = _let_down(height, obstacle, step, row, col, waiting, count)


@njit(cache=True, nogil=True)
def _let_down(height, obstacle, step, row, col, waiting, count):  # type: ignore[no-untyped-def]
    """Let down the movable neighbours of a resting particle and note them as waiting."""
    for r, c in ((row - 1, col), (row + 1, col), (row, col - 1), (row, col + 1)):
        if 0 <= r < height.shape[0] and 0 <= c < height.shape[1]:
            movable = height[r, c] > obstacle[r, c]
            if movable and abs(obstacle[r, c] - obstacle[row, col]) < step:
                height[r, c] = obstacle[r, c]
                waiting[count] = r, c
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
