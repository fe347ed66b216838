"""Delaunay triangulation in several threads: in strips, which are then sewn together.

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
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from algorithms.shared._delaunay_kernels import is_ghost, orient

STRIP = 200_000  # points: wide enough that seams are few of all
SAMPLE = 1000  # points for each strip that say where to cut
ROUNDING = 1e-14  # of a circle, in relation to how thin its triangle is

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Edges = NDArray[np.int64]  # numbered 3 t + k; edge k is opposite vertex k of triangle t


def dealt(xy: Floats) -> tuple[Ints, list[int], Floats]:
    """Deal points into strips of some STRIP points; those of one x are never parted.

    Returns
    -------
    order : array of shape (n,), the points of one strip after the other, in each as they come
    starts : where those of each strip begin, and their end
    bounds : array of shape (strips + 1,), strip k has the x from bounds[k] to below bounds[k + 1]
    """
    x, strips = xy[:, 0], len(xy) // STRIP
    drawn = np.random.default_rng(0).integers(0, len(xy), SAMPLE * strips)
    cuts = np.unique(np.sort(x[drawn])[SAMPLE::SAMPLE])
    strip = np.searchsorted(cuts, x, side="right").astype(np.uint16)
    order = np.argsort(strip, kind="stable").astype(np.int32)
    sizes = np.bincount(strip, minlength=len(cuts) + 1)
    return order, [0, *np.cumsum(sizes).tolist()], np.array([-np.inf, *cuts, np.inf])


@njit(cache=True, nogil=True)
def _is_certain(xy, a, b, c, west, east):  # type: ignore[no-untyped-def]
    """Whether the circle of a triangle is between two meridians for sure."""
    bx, by, cx, cy = (
        xy[b, 0] - xy[a, 0],
        xy[b, 1] - xy[a, 1],
        xy[c, 0] - xy[a, 0],
        xy[c, 1] - xy[a, 1],
    )
    bb, cc = bx * bx + by * by, cx * cx + cy * cy
    twice = 2.0 * orient(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1])
    x, y = (cy * bb - by * cc) / twice, (bx * cc - cx * bb) / twice
    radius, longest = np.sqrt(x * x + y * y), np.sqrt(4.0 * max(bb, cc))
    slack = ROUNDING * longest * longest * (longest + radius) / twice
    return x - radius - slack > west - xy[a, 0] and x + radius + slack < east - xy[a, 0]


@njit(cache=True, nogil=True)
def keep_certain(mesh, order, bounds, first, triangles, neighbours, loose):  # type: ignore[no-untyped-def]
    """Copy the certain triangles of a strip to where they belong, and mark its loose vertices.

    Parameters
    ----------
    mesh : live, of the strip
    order : the point of the whole that each vertex is
    bounds : of the strip, in x
    first : number of its first triangle in the whole
    triangles, neighbours : of the whole; take the certain ones, with -1 beyond what is certain
    loose : of all points; takes the vertices of all other triangles, and at the hull

    Returns
    -------
    count : of certain triangles
    rim : their edges towards what is not certain
    """
    size, west, east = mesh.size[0], bounds[0], bounds[1]
    number, count = np.empty(size, np.int32), 0
    for t in range(size):
        number[t] = -1
        a, b, c = mesh.triangles[t, 0], mesh.triangles[t, 1], mesh.triangles[t, 2]
        if not is_ghost(mesh.triangles, t) and _is_certain(mesh.xy, a, b, c, west, east):
            number[t] = first + count
            count += 1
        else:
            for vertex in (a, b, c):
                if vertex >= 0:
                    loose[order[vertex]] = True
    rim, edges = np.empty(64, np.int64), 0
    for t in range(size):
        n = number[t]
        if n >= 0:
            for k in range(3):
                triangles[n, k] = order[mesh.triangles[t, k]]
                neighbours[n, k] = number[mesh.neighbours[t, k]]
                if neighbours[n, k] < 0:
                    if edges == len(rim):
                        rim = np.concatenate((rim, rim))
                    rim[edges] = 3 * n + k
                    edges += 1
    return count, rim[:edges]


def sew(
    triangles: Ints, neighbours: Ints, free: Edges, rim: Edges, seam: Ints, across: Ints
) -> int:
    """Enter what fits of the seam between the certain triangles; how many there are in the end.

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
    graph = csr_array((joined[joined], (of[joined], beyond[joined])), (len(seam), len(seam)))
    _, patch = connected_components(graph, directed=False)  # type: ignore[arg-type]
    fits = np.isin(patch, patch[of[its]]) if len(its) else np.ones(len(seam), bool)
    places, left = np.split(free, [np.count_nonzero(fits)])
    number = np.full(len(seam), -1, np.int32)
    number[fits] = places
    beyond[joined] = number[beyond[joined]]
    beyond[its] = mine // 3
    neighbours.reshape(-1)[mine] = number[of[its]]
    triangles[places], neighbours[places] = seam[fits], beyond.reshape(-1, 3)[fits]
    return int(_close_up(triangles, neighbours, left))


def _edge_keys(triangles: Ints, edges: Edges, *, forward: bool) -> Edges:
    """Both ends of edges in one number."""
    t, k = np.divmod(edges, 3)
    begin, end = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
    if not forward:
        begin, end = end, begin
    return np.asarray((begin.astype(np.int64) << 32) | end)


@njit(cache=True, nogil=True)
def _close_up(triangles, neighbours, free):  # type: ignore[no-untyped-def]
    """Move the last triangles to the free places, which are in rising order; how many there are."""
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
