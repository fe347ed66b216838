"""Delaunay triangulation of points in the plane: exact, incremental, the same for any order.

Every decision is exact whatever the coordinates. Points on a common circle are joined by a rule
that looks at positions alone: of the two diagonals of four such points, the one that does not
end in the point with the greatest x (then y). So a set of points has one triangulation.

:func:`triangulate` is for points that stay, :class:`LiveMesh` for points that come in rounds,
:mod:`algorithms.shared.kernels.delaunay` for calls from compiled loops.

References
----------
Amenta, N., Choi, S. & Rote, G. (2003). Incremental constructions con BRIO. Proc. 19th Symposium
on Computational Geometry, 211-219. The order of insertion; the kernels name the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels import delaunay as kernels
from algorithms.shared.kernels import delaunay_strips as strips
from algorithms.shared.kernels.threads import in_blocks
from algorithms.shared.lowest import blocks, require_finite
from toolbox.context import QUIET, Context
from toolbox.errors import DataError

SMALLEST, GREATEST = 1e-50, 1e50  # the fourth powers of coordinates neither over- nor underflow
MAX_POINTS = 2**30  # triangles, two for each, are numbered with 32 bits
RUN = 100_000  # points that are between two checks for cancellation

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Room = tuple[Ints, Ints]
Frame = tuple[float, float, float]  # west and south end of a square, cells of the curve per unit


@dataclass(frozen=True, eq=False)
class Mesh:
    """A Delaunay triangulation; all arrays are read-only.

    Attributes
    ----------
    xy : array of shape (n, 2)
    triangles : array of shape (t, 3), indices of points, counter-clockwise
    neighbours : array of shape (t, 3), the triangle across the edge opposite vertex k; -1 at
        the hull
    duplicate_of : array of shape (n,), of all points at the same position the first; a point that
        is alone there names itself. Triangles use only first points.

    Examples
    --------
    >>> mesh = triangulate(np.array([[0, 0], [4, 0], [0, 4], [4, 4.0]]))
    >>> len(mesh.triangles)
    2
    >>> mesh.interpolate(np.array([0, 4, 0, 4.0]), np.array([[1, 2], [9, 9.0]]))
    array([ 1., nan])
    """

    xy: Floats
    triangles: Ints
    neighbours: Ints
    duplicate_of: Ints

    def locate(self, xy: Floats, *, ctx: Context = QUIET) -> Ints:
        """Index of the triangle at each position of shape (m, 2).

        Returns
        -------
        array of shape (m,)
            -1 outside the hull. The hull itself is inside. On an edge or a vertex it is the
            triangle a hair to the right (then above), where there is one: the answer depends on
            the place alone.

        Raises
        ------
        ValueError
            See :func:`triangulate`.
        """
        return _located(self.xy, self.triangles, self.neighbours, _checked(xy), ctx)

    def interpolate(self, values: Floats, xy: Floats, *, ctx: Context = QUIET) -> Floats:
        """Interpolate linearly in each triangle.

        Parameters
        ----------
        values : array of shape (n,), at the points; those of points that are not the first at
            their place are not used
        xy : array of shape (m, 2)
        ctx : progress and cancellation

        Returns
        -------
        array of shape (m,)
            NaN outside the hull; at a vertex exactly its value.

        Raises
        ------
        ValueError
            There is not one value for each point; or see :func:`triangulate`.
        """
        if np.shape(values) != (len(self.xy),):
            raise ValueError(
                f"values: must have shape ({len(self.xy)},), one for each point, "
                f"got {np.shape(values)}"
            )
        values = _frozen(np.ascontiguousarray(values, np.float64))
        places = _checked(xy)
        found = self.locate(places, ctx=ctx.part(0, 0.9))
        out = np.empty(len(places))
        for first, last in blocks(len(places)):
            kernels.interpolate_block(
                self.xy, self.triangles, values, places, found, first, last, out
            )
            ctx.progress(0.9 + 0.1 * last / len(places))
        return out


def triangulate(xy: Floats, *, ctx: Context = QUIET) -> Mesh:
    """Delaunay triangulation of points of shape (n, 2).

    Raises
    ------
    DataError
        There are fewer than three points, or all lie on one line.
    ValueError
        A coordinate is not a finite number, or is so large or small (not within 1e-50 to 1e50,
        nor 0) that the exact arithmetic could fail.

    Notes
    -----
    The points are worked on in a copy sorted by the order of insertion: what is near on the
    ground is then near in memory. Many points are worked on in strips, side by side in threads,
    which are then sewn together.

    Examples
    --------
    >>> triangulate(np.array([[0, 0], [3, 0], [0, 4.0]])).triangles.shape
    (1, 3)
    """
    xy = _checked(xy)
    if len(xy) < 2 * strips.STRIP:
        return _whole(xy, ctx)
    return _sewn(xy, ctx)


def _whole(xy: Floats, ctx: Context) -> Mesh:
    """Triangulate all points at once."""
    everything = np.arange(len(xy), dtype=np.int32)
    room = _room(len(xy))
    live, order, vertex_of = _grown(xy, everything, _frame(xy), room, ctx.part(0, 0.9))
    triangles, neighbours = room
    count = kernels.drop_ghosts(triangles, neighbours, live.size[0])
    triangles, neighbours = triangles[:count], neighbours[:count]
    _gather(order, triangles, triangles, ctx.part(0.9, 1))
    duplicate_of = np.empty_like(order)
    duplicate_of[order] = order[vertex_of]
    return Mesh(xy, _frozen(triangles), _frozen(neighbours), _frozen(duplicate_of))


def _sewn(xy: Floats, ctx: Context) -> Mesh:
    """Triangulate strips of the points in threads, and join them by triangulated seams."""
    frame, (dealt, starts, bounds) = _frame(xy), strips.dealt(xy)
    ctx.progress(0.1)
    triangles, neighbours = _room(len(xy))
    loose, duplicate_of = np.zeros(len(xy), np.bool_), np.empty(len(xy), np.int32)
    free, rims = ([np.empty(0, np.int64)] * len(starts[1:]) for _ in range(2))

    def work(k: int, _: int) -> None:
        points, here = dealt[starts[k] : starts[k + 1]], slice(2 * starts[k], 2 * starts[k + 1])
        try:
            live, order, vertex_of = _grown(
                xy, points, frame, (triangles[here], neighbours[here]), QUIET
            )
        except DataError:  # they are on one line, or none
            loose[points] = True
            free[k] = np.arange(here.start, here.stop)
            return
        duplicate_of[order] = order[vertex_of]
        free[k], rims[k] = strips.settle(live, order, bounds[k : k + 2], here.start, loose)

    in_blocks(work, len(rims), 1, ctx.part(0.1, 0.9))
    seamed = np.flatnonzero(loose).astype(np.int32)
    seam = _whole(xy[seamed], ctx.part(0.9, 0.95))
    duplicate_of[seamed] = seamed[seam.duplicate_of]
    size = strips.sew(
        triangles,
        neighbours,
        np.concatenate(free),
        np.concatenate(rims),
        seamed[seam.triangles],
        seam.neighbours,
    )
    ctx.progress(1.0)
    triangles, neighbours = triangles[:size], neighbours[:size]
    return Mesh(xy, _frozen(triangles), _frozen(neighbours), _frozen(duplicate_of))


def _grown(
    xy: Floats, points: Ints, frame: Frame, room: Room, ctx: Context
) -> tuple[kernels.Arrays, Ints, Ints]:
    """Triangulate some of the points, in a copy sorted by the order of insertion.

    Returns
    -------
    live : the triangles of the copy
    order : array of shape (m,), the point that each one of the copy is
    vertex_of : array of shape (m,), the one of the copy at the position of each
    """
    order = _order(xy, points, frame, ctx.part(0, 0.2))
    copy = _gather(xy, order, np.empty((len(order), 2)), ctx.part(0.2, 0.25))
    live, vertex_of = _empty(_frozen(copy), room), np.empty_like(order)
    _fill(live, np.arange(len(order), dtype=np.int32), 0, vertex_of, ctx.part(0.25, 1))
    return live, order, vertex_of


class LiveMesh:
    """A Delaunay triangulation that grows round by round.

    Some of the triangles are ghosts: each hull edge has one, joined to the vertex at infinity,
    -1, which is vertex 1 or 2 of it and never vertex 0. So `triangles[t].min() < 0` tells a
    ghost. Numbers of triangles are used again at the same position: an old number is a good hint
    of where to look next.

    Parameters
    ----------
    xy : array of shape (n, 2), all points that may be inserted, now or later

    Attributes
    ----------
    arrays : what kernels work on. `walk` and `locate` take `xy`, `triangles` and `neighbours`
        (whole, or the views of the same name here), `insert` takes it all.
    round_of : array of shape (n,), in which call of :meth:`insert` (0, 1, ...) a point became a
        vertex; -1 for points that are none
    duplicate_of : array of shape (n,), the vertex at the position of a point: itself, or the one
        that was there first; -1 before the point was inserted

    Raises
    ------
    DataError, ValueError
        See :func:`triangulate`.

    Examples
    --------
    >>> live = LiveMesh(np.array([[0, 0], [4, 0], [0, 4], [1, 1.0]]))
    >>> first, then = live.insert(np.arange(3)), live.insert(np.array([3]))
    >>> live.round_of.tolist(), len(live.mesh().triangles)
    ([0, 0, 0, 1], 3)
    """

    def __init__(self, xy: Floats) -> None:
        xy = _checked(xy)
        self.arrays = _empty(xy, _room(len(xy)))
        self.round_of = np.full(len(xy), -1, np.int32)
        self.duplicate_of = np.full(len(xy), -1, np.int32)
        self._frame = _frame(xy)
        self._rounds = 0
        self._hint = 0

    @property
    def triangles(self) -> Ints:
        """Vertices of shape (size, 3), counter-clockwise, ghosts included; read-only view."""
        return _frozen(self.arrays.triangles[: self.arrays.size[0]])

    @property
    def neighbours(self) -> Ints:
        """Triangles across the edge opposite vertex k, (size, 3), never -1; read-only view."""
        return _frozen(self.arrays.neighbours[: self.arrays.size[0]])

    def insert(self, indices: NDArray[np.integer[Any]], *, ctx: Context = QUIET) -> Ints:
        """Insert points by index, as one round; their order makes no difference.

        Returns
        -------
        array of shape (c,)
            Numbers of all triangles (and ghosts) that this round made, in rising order. A place
            whose triangle is not among them is still in that triangle. Vertex 0 of a triangle
            is the one that came last, so `round_of[triangles[t, 0]]` is the round that made t.

        Raises
        ------
        DataError
            In the first round: there are fewer than three points, or all lie on one line.
        IndexError
            An index is not one of the points.
        """
        points = np.ascontiguousarray(indices).astype(np.int32, casting="same_kind")
        if len(points) and not 0 <= points.min() <= points.max() < len(self.round_of):
            raise IndexError(
                f"indices: must be 0 to {len(self.round_of) - 1}, "
                f"got {points.min()} to {points.max()}"
            )
        order = _order(self.arrays.xy, points, self._frame, ctx.part(0, 0.2))
        self._hint = _fill(self.arrays, order, self._hint, self.duplicate_of, ctx.part(0.2, 1))
        made = points[(self.duplicate_of[points] == points) & (self.round_of[points] < 0)]
        self.round_of[made] = self._rounds
        changed = self.round_of[self.triangles[:, 0]] == self._rounds
        self._rounds += 1
        return np.flatnonzero(changed).astype(np.int32)

    def locate(self, xy: Floats, *, ctx: Context = QUIET) -> Ints:
        """Index of the triangle at each position, as :meth:`Mesh.locate`; after the first round."""
        arrays = self.arrays  # kernels would be compiled for the read-only views once more
        return _located(arrays.xy, arrays.triangles, arrays.neighbours, _checked(xy), ctx)

    def mesh(self) -> Mesh:
        """The present triangulation without ghosts, in arrays that no longer change."""
        triangles, neighbours = self.triangles.copy(), self.neighbours.copy()
        count = kernels.drop_ghosts(triangles, neighbours, len(triangles))
        return Mesh(
            self.arrays.xy,
            _frozen(triangles[:count]),
            _frozen(neighbours[:count]),
            _frozen(self.duplicate_of.copy()),
        )


def _room(points: int) -> Room:
    """Memory for the triangles and neighbours of a number of points; not used until written to."""
    return np.empty((2 * points, 3), np.int32), np.empty((2 * points, 3), np.int32)


def _empty(xy: Floats, room: Room) -> kernels.Arrays:
    """A mesh without triangles."""
    triangles, neighbours = room
    size, scratch = np.zeros(1, np.int64), np.empty((4, len(triangles)), np.int64)
    return kernels.Arrays(xy, triangles, neighbours, size, scratch)


def _fill(mesh: kernels.Arrays, points: Ints, hint: int, vertex_of: Ints, ctx: Context) -> int:
    """Insert points in order, and note the vertex at the position of each; the next hint."""
    if not mesh.size[0] and (len(points) < 3 or not kernels.start(mesh, points)):
        which = f"all {len(points)} lie on one line and" if len(points) > 2 else len(points)
        raise DataError(f"points: {which} do not span a triangle")
    hint = min(hint, int(mesh.size[0]) - 1)  # triangles may have gone
    for first, last in _runs(len(points)):
        hint = kernels.insert_block(mesh, points, first, last, hint, vertex_of)
        ctx.progress(last / len(points))
    return hint


def _located(xy: Floats, triangles: Ints, neighbours: Ints, places: Floats, ctx: Context) -> Ints:
    """Index of the triangle at each position; each search starts from the position before."""
    found = np.empty(len(places), np.int32)
    everything = np.arange(len(places), dtype=np.int32)
    order = _order(places, everything, _frame(places), ctx.part(0, 0.2), in_rounds=False)
    hint = 0
    for first, last in _runs(len(places)):
        hint = kernels.locate_block(
            xy, triangles, neighbours, places, order, first, last, hint, found
        )
        ctx.progress(0.2 + 0.8 * last / len(places))
    return found


def _checked(xy: Floats) -> Floats:
    """The points as one contiguous read-only array, checked for exact arithmetic."""
    xy = _frozen(np.ascontiguousarray(xy, np.float64))
    require_finite(xy, largest=np.inf)
    if len(xy) > MAX_POINTS:
        raise DataError(f"points: at most {MAX_POINTS:,} can be triangulated, got {len(xy):,}")
    for first, last in blocks(len(xy)):
        size = np.abs(xy[first:last])
        wrong = (size > GREATEST) | ((size < SMALLEST) & (size > 0))
        if wrong.any():
            point, axis = np.argwhere(wrong)[0]
            raise DataError(
                f"xy: coordinates must be 0 or of {SMALLEST:g} to {GREATEST:g} in size, "
                f"got {'xy'[axis]} = {xy[first + point, axis]} at point {first + point}"
            )
    return xy


def _frame(xy: Floats) -> Frame:
    """Bounding square of the points, with the number of cells of a Hilbert curve per unit."""
    if not len(xy):
        return 0.0, 0.0, 0.0
    west, south = xy[:, 0].min(), xy[:, 1].min()
    extent = max(xy[:, 0].max() - west, xy[:, 1].max() - south)
    return west, south, (2**kernels.BITS - 1) / extent if extent else 0.0


def _order(xy: Floats, points: Ints, frame: Frame, ctx: Context, *, in_rounds: bool = True) -> Ints:
    """Points in the order of insertion: along a Hilbert curve, in rounds of growing size.

    Few points, drawn by their position, come first and keep the cost down where the curve alone
    would build on the rim of what is there. Points of one cell stay in the order they have.
    """
    keys = np.empty(len(points), np.int64)
    counts = np.zeros((kernels.PASSES, 2**kernels.DIGIT), np.int64)
    for first, last in _runs(len(points)):
        kernels.keys_block(xy, points, *frame, in_rounds, first, last, keys, counts)
        ctx.progress(0.4 * last / len(points))
    now, spare = (keys, points.copy()), (np.empty_like(keys), np.empty_like(points))
    for p, starts in enumerate(np.cumsum(counts, axis=1) - counts):
        for first, last in _runs(len(points)):
            kernels.sort_block(*now, p * kernels.DIGIT, starts, first, last, *spare)
        now, spare = spare, now
        ctx.progress(0.4 + 0.6 * (p + 1) / kernels.PASSES)
    return now[1]


def _gather(source: NDArray[Any], index: Ints, out: NDArray[Any], ctx: Context) -> NDArray[Any]:
    """`out` = `source[index]`, block by block; `out` may be `index`."""
    for first, last in blocks(len(index)):
        out[first:last] = source[index[first:last]]
        ctx.progress(last / len(index))
    return out


def _runs(total: int) -> list[tuple[int, int]]:
    """Cut `total` items into short runs (first, last)."""
    return [(first, min(first + RUN, total)) for first in range(0, total, RUN)]


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    """A read-only view."""
    view = array.view()
    view.flags.writeable = False
    return view
