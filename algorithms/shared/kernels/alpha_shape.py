"""Compiled loops of alpha shapes; see :mod:`algorithms.shared.alpha_shape`.

Triangles and neighbours are those of :class:`algorithms.shared.delaunay.Mesh`. Edge k of a
triangle is the one opposite its vertex k; it runs counter-clockwise, the triangle on its left.
"""

from __future__ import annotations

import math

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel
from algorithms.shared.kernels.delaunay import orient
from algorithms.shared.sets import root


@kernel
def radii_block(xy, triangles, first, last, radii):
    """Write the radii of the circles around triangles first..last: abc / (4 area)."""
    for t in range(first, last):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
        product = (
            math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)  # hypot would take four times as long
            * math.sqrt((cx - bx) ** 2 + (cy - by) ** 2)
            * math.sqrt((ax - cx) ** 2 + (ay - cy) ** 2)
        )
        radii[t] = product / (2.0 * orient(ax, ay, bx, by, cx, cy))


@kernel
def areas_block(xy, triangles, first, last, areas):
    """Write the areas of triangles first..last."""
    for t in range(first, last):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        areas[t] = 0.5 * orient(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1])


@kernel
def covering_radius(triangles, radii, least):
    """The least radius limit at which each vertex has a triangle of at most that circumradius.

    `least`, of shape (n,), comes filled with infinity.
    """
    for t in range(len(triangles)):
        for k in range(3):
            least[triangles[t, k]] = min(least[triangles[t, k]], radii[t])
    greatest = 0.0
    for radius in least:
        if radius < math.inf:  # the others share their position with a vertex
            greatest = max(greatest, radius)
    return greatest


@kernel
def patches(neighbours, kept):
    """Patch of each triangle: triangles joined by edges that are all kept, or all not kept.

    Returns
    -------
    patch : array of shape (t,)
    count : how many there are
    """
    patch = np.full(len(kept), -1, np.int32)
    waiting = np.empty(len(kept), np.int32)
    count = 0
    for start in range(len(kept)):
        if patch[start] >= 0:
            continue
        patch[start], waiting[0], size = count, start, 1
        while size > 0:
            size -= 1
            t = waiting[size]
            for k in range(3):
                n = neighbours[t, k]
                if n >= 0 and patch[n] < 0 and kept[n] == kept[t]:
                    patch[n], waiting[size] = count, n
                    size += 1
        count += 1
    return patch, count


@kernel
def one_piece(neighbours, radii, order, node, nodes, pieces, slack):
    """The circumradius at which triangles, added in rising order, first make one connected piece.

    Parameters
    ----------
    order : numbers of the triangles to add, in the order of their radii
    node : array of shape (t,), the patch of triangles that are there, below `nodes`; -1 for
        those to add. Is filled in.
    pieces : how many patches are there
    slack : radii that differ by no more than this share come together
    """
    parent = np.arange(nodes + len(order))
    for i, t in enumerate(order):
        node[t] = nodes + i
        pieces += 1
        for k in range(3):
            n = neighbours[t, k]
            if n >= 0 and node[n] >= 0:
                a, b = root(parent, node[t]), root(parent, node[n])
                if a != b:
                    parent[a] = b
                    pieces -= 1
        last = i + 1 == len(order) or radii[order[i + 1]] > radii[t] * (1.0 + slack)
        if pieces == 1 and last:
            return radii[t]
    return math.inf


@kernel
def owners(triangles, rank, owner):
    """Set the lowest rank of the triangles at each vertex; `owner` is filled with a higher one."""
    for t in range(len(triangles)):
        if rank[t] >= 0:
            for k in range(3):
                owner[triangles[t, k]] = min(owner[triangles[t, k]], rank[t])


@helper
def _is_rim(neighbours, kept, t, k):
    """Whether edge k of a kept triangle t is on the rim: the triangle beyond it is not kept."""
    n = neighbours[t, k]
    return n < 0 or not kept[n]


@kernel
def count_rim(neighbours, kept):
    """Number of rim edges of the kept triangles."""
    count = 0
    for t in range(len(kept)):
        if kept[t]:
            for k in range(3):
                count += _is_rim(neighbours, kept, t, k)
    return count


@kernel
def trace(xy, triangles, neighbours, kept, length):
    """The rings around the kept triangles, which are on the left of each.

    From the end of an edge the way goes on around the kept triangles at that vertex, so that a
    ring stays with what is joined by edges. Where it comes to a vertex a second time, the loop
    since then is a ring of its own: so no ring touches itself.

    Parameters
    ----------
    length : as :func:`count_rim` gives it

    Returns
    -------
    corners : array of shape (length,), vertices, ring after ring, each from its lowest (x, y)
    ends : array of shape (rings,), where in `corners` each ends
    facets : array of shape (rings,), a kept triangle at each
    twice : array of shape (rings,), twice the area inside, below zero for holes
    """
    corners, facets = np.empty(length, np.int32), np.empty(length // 3, np.int32)
    ends, twice = np.empty(length // 3, np.int64), np.empty(length // 3)
    done = np.zeros((len(triangles), 3), np.bool_)
    place = np.full(len(xy), -1, np.int32)  # of a vertex on the way so far
    way = np.empty(length + 1, np.int32)
    written, rings = 0, 0
    for start in range(len(triangles)):
        for first in range(3):
            if not kept[start] or done[start, first] or not _is_rim(neighbours, kept, start, first):
                continue
            t, k, size = start, first, 0
            while True:
                v = triangles[t, (k + 1) % 3]
                if place[v] >= 0:
                    loop = way[place[v] : size]
                    size = place[v]
                    twice[rings] = _emit(xy, loop, place, corners, written)
                    written += len(loop)
                    ends[rings], facets[rings] = written, start
                    rings += 1
                if done[t, k]:
                    break
                done[t, k] = True
                place[v], way[size] = size, v
                size += 1
                k = (k + 1) % 3  # the next edge of this triangle begins where the last one ended
                while not _is_rim(neighbours, kept, t, k):
                    v, t = triangles[t, (k + 1) % 3], neighbours[t, k]
                    k = 2 if triangles[t, 0] == v else 0 if triangles[t, 1] == v else 1
    return corners, ends[:rings], facets[:rings], twice[:rings]


@helper
def _emit(xy, loop, place, corners, first):
    """Write a ring from its lowest (x, y), and reset its vertices in `place`; twice its area."""
    low, twice = 0, 0.0
    x0, y0 = xy[loop[0], 0], xy[loop[0], 1]
    for i, v in enumerate(loop):
        place[v] = -1
        x, y, best = xy[v, 0], xy[v, 1], loop[low]
        if x < xy[best, 0] or (x == xy[best, 0] and y < xy[best, 1]):
            low = i
        w = loop[(i + 1) % len(loop)]
        twice += (x - x0) * (xy[w, 1] - y0) - (xy[w, 0] - x0) * (y - y0)
    for i in range(len(loop)):
        corners[first + i] = loop[(low + i) % len(loop)]
    return twice
