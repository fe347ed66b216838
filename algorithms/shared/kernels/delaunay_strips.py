"""Delaunay triangulation in threads: strips of points are triangulated apart and then joined.

Points are dealt into strips from west to east, and each strip is triangulated by itself. A
triangle whose circle lies within its strip is certain: there are no other points in it. What is
left is a seam along the cuts, and thin triangles at the hull. Their vertices, those that are at
the hull of a strip or in an uncertain triangle, are triangulated once more. Of that, all triangles
that the certain ones leave room for are Delaunay triangles of the whole: a triangle of the whole
that is not certain can only have such vertices, since each of its corners is, in its own strip,
taken up by something uncertain.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels.compiling import kernel
from algorithms.shared.kernels.delaunay import is_ghost, orient

STRIP = 200_000  # points: wide enough that seams are few of all
ROUNDING = 1e-14  # of a circle, in relation to how thin its triangle is
STOUT = 1e-6  # twice the area of a triangle by its longest edge squared: rounding does not matter

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Edges = NDArray[np.int64]  # numbered 3 t + k; edge k is opposite vertex k of triangle t


def dealt(xy: Floats) -> tuple[Ints, list[int], Floats]:
    """Distribute points over strips of about STRIP points; points of equal x share a strip.

    Returns
    -------
    order : array of shape (n,), the points of one strip after the other, in each as they come
    starts : where those of each strip begin, and their end
    bounds : array of shape (strips + 1,), strip k has the x from bounds[k] to below bounds[k + 1]
    """
    x, strips = np.ascontiguousarray(xy[:, 0]), len(xy) // STRIP
    last = np.arange(1, strips) * len(xy) // strips
    cuts = np.unique(np.partition(x, last)[last])
    strip = np.searchsorted(cuts, x, side="right").astype(np.uint16)
    order = np.argsort(strip, kind="stable").astype(np.int32)
    sizes = np.bincount(strip, minlength=len(cuts) + 1)
    return order, [0, *np.cumsum(sizes).tolist()], np.array([-np.inf, *cuts, np.inf])


@kernel
def _is_certain(xy, a, b, c, west, east):
    """Whether the circumcircle of a triangle surely lies between two x coordinates."""
    ax, ay = xy[a, 0], xy[a, 1]
    bx, by, cx, cy = xy[b, 0] - ax, xy[b, 1] - ay, xy[c, 0] - ax, xy[c, 1] - ay
    bb, cc, bc = bx * bx + by * by, cx * cx + cy * cy, (cx - bx) ** 2 + (cy - by) ** 2
    twice = orient(ax, ay, xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1])
    longest = max(bb, cc, bc)
    room = min(ax - west, east - ax)
    if twice > STOUT * longest and bb * cc * bc < (0.5 * room * twice) ** 2:
        return True  # its diameter is far less than the room: no need of roots
    x, y = (cy * bb - by * cc) / (2.0 * twice), (bx * cc - cx * bb) / (2.0 * twice)
    radius = np.sqrt(x * x + y * y)
    slack = ROUNDING * longest * (np.sqrt(longest) + radius) / twice
    return x - radius - slack > west - ax and x + radius + slack < east - ax


@kernel
def settle(mesh, order, bounds, first, loose):
    """Turn the certain triangles of a strip into triangles of the whole, and mark loose vertices.

    Parameters
    ----------
    mesh : live, of the strip; comes to name points and triangles of the whole, with -1 for
        neighbours that are not certain
    order : the point of the whole that each vertex is
    bounds : of the strip, in x
    first : number that its first triangle has in the whole
    loose : of all points; takes the vertices of all other triangles, and at the hull

    Returns
    -------
    free : numbers of what is no certain triangle
    rim : edges of the certain triangles towards what is not certain
    """
    triangles, neighbours, size = mesh.triangles, mesh.neighbours, mesh.size[0]
    certain = np.zeros(len(triangles), np.bool_)
    edges = 0
    for t in range(size):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        certain[t] = not is_ghost(triangles, t) and _is_certain(
            mesh.xy, a, b, c, bounds[0], bounds[1]
        )
        if not certain[t]:
            edges += 3
            for vertex in (a, b, c):
                if vertex >= 0:
                    loose[order[vertex]] = True
    rim, found = np.empty(edges, np.int64), 0
    for t in range(size):
        if certain[t]:
            for k in range(3):
                triangles[t, k] = order[triangles[t, k]]
                if certain[neighbours[t, k]]:
                    neighbours[t, k] += first
                else:
                    neighbours[t, k] = -1
                    rim[found] = 3 * (first + t) + k
                    found += 1
    return first + np.flatnonzero(~certain), rim[:found]


def sew(
    triangles: Ints, neighbours: Ints, free: Edges, rim: Edges, seam: Ints, across: Ints
) -> int:
    """Insert the triangles of the seam that fit between the certain ones; the number of triangles.

    Parameters
    ----------
    triangles, neighbours : of the whole; all of them are used from the first one on in the end
    free : numbers of triangles that are not used yet, rising
    rim : edges of the certain triangles without a neighbour
    seam, across : arrays of shape (s, 3), triangles of the loose vertices and their neighbours
    """
    # An edge of the rim runs the other way round in the triangle of the seam beyond it.
    _, mine, its = np.intersect1d(
        _edge_keys(triangles, rim, forward=True),
        _edge_keys(seam, np.arange(seam.size), forward=False),
        assume_unique=True,
        return_indices=True,
    )
    mine = rim[mine]
    of, beyond = np.repeat(np.arange(len(seam)), 3), across.flatten()
    pair = np.minimum(of, beyond) * len(seam) + np.maximum(of, beyond)
    joined = (beyond >= 0) & ~np.isin(pair, pair[its])
    fits = (
        _reached(of[its], across, joined.reshape(-1, 3)) if len(its) else np.ones(len(seam), bool)
    )
    places, left = np.split(free, [np.count_nonzero(fits)])
    number = np.full(len(seam), -1, np.int32)
    number[fits] = places
    beyond[joined] = number[beyond[joined]]
    beyond[its] = mine // 3
    neighbours.reshape(-1)[mine] = number[of[its]]
    triangles[places], neighbours[places] = seam[fits], beyond.reshape(-1, 3)[fits]
    return int(_close_up(triangles, neighbours, left))


def _edge_keys(triangles: Ints, edges: Edges, *, forward: bool) -> Edges:
    """One number for both ends of each edge."""
    t, k = np.divmod(edges, 3)
    begin, end = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
    if not forward:
        begin, end = end, begin
    return np.asarray((begin.astype(np.int64) << 32) | end)


@kernel
def _reached(start, across, joined):
    """True for the triangles `start`, and for those connected with them."""
    reached, waiting, count = np.zeros(len(across), np.bool_), np.empty(len(across), np.int64), 0
    for t in start:
        if not reached[t]:
            reached[t], waiting[count] = True, t
            count += 1
    while count > 0:
        count -= 1
        t = waiting[count]
        for k in range(3):
            n = across[t, k]
            if joined[t, k] and not reached[n]:
                reached[n], waiting[count] = True, n
                count += 1
    return reached


@kernel
def _close_up(triangles, neighbours, free):
    """Move the last triangles to the free indices, which are in rising order; their number."""
    end, last, i = len(triangles), len(free) - 1, 0
    while i <= last:
        end -= 1
        if free[last] == end:
            last -= 1
            continue
        place = free[i]
        i += 1
        for k in range(3):
            n = neighbours[end, k]
            triangles[place, k], neighbours[place, k] = triangles[end, k], n
            for j in range(3):
                if n >= 0 and neighbours[n, j] == end:
                    neighbours[n, j] = place
    return end
