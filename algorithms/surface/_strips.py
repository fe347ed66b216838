"""Delaunay triangulation in several threads: in strips, which are then sewn together.

Each strip of points is triangulated by itself. A triangle whose circle lies within its strip is
certain: there are no other points in it. What is left is a seam along the cuts, and thin triangles
at the hull. Their vertices, those that are at the hull of a strip or in an uncertain triangle,
are triangulated once more. Of that, all triangles that the certain ones leave room for are
Delaunay triangles of the whole: a triangle of the whole that is not certain can only have such
vertices, since each of its corners is, in its own strip, taken up by something uncertain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from algorithms.shared._delaunay_kernels import orient
from algorithms.shared.delaunay import Mesh, triangulate
from algorithms.shared.threads import in_blocks
from toolbox.context import QUIET, Context
from toolbox.errors import DataError

STRIP = 200_000  # points: wide enough that seams are few of all
ROUNDING = 1e-14  # of a circle, in relation to how thin its triangle is

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


class Strip(NamedTuple):
    """What one strip contributes.

    Attributes
    ----------
    triangles : array of shape (t, 3), those that are certain
    neighbours : array of shape (t, 3), numbers within the strip, -1 for what is not certain
    loose : array of shape (m,), vertices of all others and at the hull
    """

    triangles: Ints
    neighbours: Ints
    loose: Ints


def triangulate_sorted(xy: Floats, *, ctx: Context = QUIET) -> Mesh:
    """Delaunay triangulation of places in the order of their x, no place twice.

    As :func:`algorithms.shared.delaunay.triangulate`, of which it has the triangles, in another
    order, and the errors.
    """
    if len(xy) < 2 * STRIP:
        return triangulate(xy, ctx=ctx)
    strips: dict[int, Strip] = {}

    def work(first: int, last: int) -> None:
        strips[first] = _strip(xy, first, last)

    in_blocks(work, len(xy), STRIP, ctx.part(0.0, 0.85))
    parts = [strips[first] for first in sorted(strips)]
    loose = np.concatenate([part.loose for part in parts])
    seam = triangulate(xy[loose], ctx=ctx.part(0.85, 0.95))
    triangles, neighbours = _sewn(parts, loose[seam.triangles], seam.neighbours)
    ctx.progress(1.0)
    arrays = (xy.view(), triangles, neighbours, np.arange(len(xy), dtype=np.int32))
    for array in arrays:
        array.flags.writeable = False
    return Mesh(*arrays)


def _strip(xy: Floats, first: int, last: int) -> Strip:
    """Triangulate the points first..last."""
    west = xy[first - 1, 0] if first > 0 else -np.inf
    east = xy[last, 0] if last < len(xy) else np.inf
    try:
        mesh = triangulate(xy[first:last])
    except DataError:  # all on one line
        none = np.empty((0, 3), np.int32)
        return Strip(none, none, np.arange(first, last, dtype=np.int32))
    triangles, neighbours, loose = _certain(mesh.xy, mesh.triangles, mesh.neighbours, west, east)
    triangles += np.int32(first)
    return Strip(triangles, neighbours, np.flatnonzero(loose).astype(np.int32) + np.int32(first))


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
def _certain(xy, triangles, neighbours, west, east):  # type: ignore[no-untyped-def]
    """The certain triangles, their neighbours, and which vertices are loose."""
    number, count = np.empty(len(triangles), np.int32), 0
    loose = np.zeros(len(xy), np.bool_)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        number[t] = -1
        if _is_certain(xy, a, b, c, west, east):
            number[t] = count
            count += 1
        else:
            loose[a] = loose[b] = loose[c] = True
        for k in range(3):
            if neighbours[t, k] < 0:
                loose[triangles[t, (k + 1) % 3]] = loose[triangles[t, (k + 2) % 3]] = True
    kept, across = np.empty((count, 3), np.int32), np.empty((count, 3), np.int32)
    for t in range(len(triangles)):
        if number[t] >= 0:
            for k in range(3):
                n = neighbours[t, k]
                kept[number[t], k] = triangles[t, k]
                across[number[t], k] = number[n] if n >= 0 else -1
    return kept, across, loose


def _sewn(parts: list[Strip], seam: Ints, across: Ints) -> tuple[Ints, Ints]:
    """Triangles and neighbours of all strips, with those of the seam that fit between them.

    Parameters
    ----------
    seam : array of shape (s, 3), triangles of the loose vertices
    across : array of shape (s, 3), their neighbours
    """
    sizes = [len(part.triangles) for part in parts]
    triangles = np.concatenate([part.triangles for part in parts])
    neighbours = np.concatenate([part.neighbours for part in parts])
    for start, size in zip(np.cumsum(sizes) - sizes, sizes, strict=True):
        some = neighbours[start : start + size]
        some[some >= 0] += np.int32(start)
    rim = np.flatnonzero(neighbours < 0)
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
    number = np.where(fits, len(triangles) + np.cumsum(fits) - 1, -1).astype(np.int32)
    beyond[joined] = number[beyond[joined]]
    beyond[its] = mine // 3
    neighbours.reshape(-1)[mine] = number[of[its]]
    return (
        np.concatenate([triangles, seam[fits]]),
        np.concatenate([neighbours, beyond.reshape(-1, 3)[fits]]),
    )


def _edge_keys(triangles: Ints, edges: NDArray[np.int64], *, forward: bool) -> NDArray[np.int64]:
    """Both ends of edges 3 t + k, which are opposite vertex k, in one number."""
    t, k = np.divmod(edges, 3)
    begin, end = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
    if not forward:
        begin, end = end, begin
    return np.asarray((begin.astype(np.int64) << 32) | end)
