"""The ground of a basin, as triangles between points or between the cell centres of a raster.

Both kinds know where water runs from one piece to the next, and give triangles to sum up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shared.alpha_shape import ROUNDING, circumradii
from algorithms.shared.delaunay import triangulate
from algorithms.shared.places import averaged
from algorithms.shoreline import _basin_kernels as kernels
from toolbox.context import QUIET, Context
from toolbox.data import Lattice
from toolbox.errors import DataError

BLOCK = 200_000  # squares or triangles at a time
AT_ONCE = 500  # triangles cut by the part of an outline that is near them

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Polygon = Any  # of shapely, or a MultiPolygon


class Pieces(NamedTuple):
    """Triangles of ground with heights, areas and the levels from which they are connected.

    Attributes
    ----------
    triangles : array of shape (t, 3), indices of heights
    z : array of shape (n,), heights
    areas : array of shape (t,), in the plane; below zero for parts to be taken away
    joined : array of shape (t,), the level above which its water is one with that at the start
    """

    triangles: NDArray[np.int64]
    z: Array
    areas: Array
    joined: Array


class PointBasin:
    """Ground as the triangulation of points.

    Parameters
    ----------
    xyz : array of shape (n, 3); heights of points at one position are averaged
    outline : wall around the water; None for none
    max_gap : triangles whose circle, in which there is no point, has a larger radius are no ground

    Attributes
    ----------
    lowest : height of the lowest ground within the outline, from `fill` on of the basin
    highest : height of the highest ground within the outline
    missing : share of the outline, or of the convex hull, without ground

    Raises
    ------
    DataError
        There is no triangle within the outline.
    """

    def __init__(
        self, xyz: Array, outline: Polygon | None, max_gap: float, *, ctx: Context = QUIET
    ) -> None:
        xy, self._z = averaged(xyz[:, :2], xyz[:, 2], ctx=ctx.part(0, 0.1))
        self._mesh = triangulate(xy, ctx=ctx.part(0.1, 0.7))
        corners = self._mesh.triangles
        there = np.ones(len(corners), bool)
        if max_gap < math.inf:
            there = circumradii(self._mesh, ctx=ctx.part(0.7, 0.75)) <= max_gap * (1 + ROUNDING)
        u, v = (xy[corners[:, k]] - xy[corners[:, 0]] for k in (1, 2))
        self._areas = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
        self._low = self._z[corners].min(axis=1)
        self._inside, self._cut = there, _no_cut()
        wanted = float(self._areas.sum())
        if outline is not None:
            centres = xy[corners].mean(axis=1)
            reach = np.hypot(*(xy[corners] - centres[:, None]).transpose(2, 0, 1)).max(axis=1)
            self._inside, near = placed(outline, centres, reach, there, ctx.part(0.75, 0.85))
            part = near.nonzero()[0]
            self._cut = cut(
                outline, xy[corners[part]], self._z[corners[part]], ctx.part(0.85, 0.98)
            )
            self._cut = self._cut._replace(parent=part[self._cut.parent])
            wanted = outline.area
        self._used = self._inside.copy()
        self._used[self._cut.parent] = True
        if not self._used.any():
            raise no_ground(outline)
        self._low[self._cut.parent] = np.inf
        np.minimum.at(self._low, self._cut.parent, self._cut.z.min(axis=1))
        self._rim = (self._mesh.neighbours < 0) | ~there[self._mesh.neighbours]
        self._rim &= self._inside[:, None]
        self.lowest = float(self._low[self._used].min())
        tops = [self._z[corners[self._inside]].ravel(), self._cut.z.ravel()]
        self.highest = float(np.concatenate(tops).max())
        covered = self._areas[self._inside].sum() + self._cut.areas.sum()
        self.missing = share_missing(covered, wanted)
        self._joined = np.full(len(corners), -np.inf)

    def at(self, x: float, y: float) -> int:
        """Index of the triangle at a position.

        Raises
        ------
        DataError
            There is none.
        """
        t = int(self._mesh.locate(np.array([[x, y]]))[0])
        if t < 0 or not self._used[t]:
            raise DataError("lies where there is no ground")
        return t

    def fill(self, start: int | None, highest: float, *, ctx: Context = QUIET) -> None:
        """Find the water connected with the lowest ground of the basin.

        The basin is what a lake of the level `highest` covers that contains the triangle
        `start`; without `start` it is the one of the lowest ground. Before this is called,
        all water counts as connected.

        Raises
        ------
        DataError
            The piece is not below the level.
        """
        low = np.where(self._used, self._low, np.inf)
        if start is not None:
            low[self._flooded(start, ctx.part(0, 0.5)) >= highest] = np.inf
        first = _first(low)
        self.lowest = float(low.flat[first])
        self._joined = self._flooded(first, ctx.part(0.5, 1))
        ctx.progress(1.0)

    def opens(self) -> float:
        """Level above which water reaches unknown ground; infinity if it never does."""
        ends = self._z[self._mesh.triangles]
        gates = np.minimum(np.roll(ends, -1, axis=1), np.roll(ends, -2, axis=1))
        levels = np.maximum(gates, self._joined[:, None])
        return float(levels.min(where=self._rim, initial=np.inf))

    def _flooded(self, start: int, ctx: Context) -> Array:
        mesh, joined = self._mesh, np.full(len(self._low), np.inf)
        what = (mesh.triangles, mesh.neighbours, self._z, self._low, self._used, joined)
        return _spread(kernels.flood_facets, what, joined, start, self._low[start], ctx)

    def pieces(self) -> Iterator[Pieces]:
        """Triangles of all ground within the outline, block by block."""
        t = np.flatnonzero(self._inside)
        for first in range(0, len(t), BLOCK):
            some = t[first : first + BLOCK]
            yield Pieces(
                self._mesh.triangles[some].astype(np.int64),
                self._z,
                self._areas[some],
                self._joined[some],
            )
        yield self._cut.pieces(self._joined)


class RasterBasin:
    """Ground as squares between the centres of four cells, each cut into four triangles.

    The half cells at the edge of the raster, and around cells without a value, hold nothing. The
    rest as :class:`PointBasin`.
    """

    def __init__(
        self, heights: Array, lattice: Lattice, outline: Polygon | None, *, ctx: Context = QUIET
    ) -> None:
        if min(heights.shape) < 2:
            raise DataError("a raster needs two rows and two columns of points to be a surface")
        self._x, self._y = lattice.centres()
        self._cell, self._heights = lattice.cell, np.ascontiguousarray(heights, np.float64)
        there = _at_all_corners(np.isfinite(self._heights))
        self._inside, self._cut = there, _no_cut()
        self._outline, self._lake = outline, _no_cut()
        wanted = there.size * self._cell**2
        if outline is not None:
            self._inside, near = self._placed(outline, there, ctx.part(0, 0.5))
            xy, z, square = self._around(np.flatnonzero(near))
            self._cut = cut(outline, xy, z, ctx.part(0.5, 1))
            self._cut = self._cut._replace(parent=square[self._cut.parent])
            wanted = outline.area
        squares = self._squares()
        if not squares.any():
            raise no_ground(outline)
        self._used = _of_any_square(squares)
        known = _at_all_squares(there)
        self._rim = _of_any_square(self._inside) & ~known
        self._starts = _of_any_square(self._inside) if self._inside.any() else self._used
        found = np.concatenate([self._heights[self._starts], self._cut.z.ravel()])
        self.lowest, self.highest = float(found.min()), float(found.max())
        covered = self._inside.sum() * self._cell**2 + self._cut.areas.sum()
        self.missing = share_missing(covered, wanted)
        self._joined = np.full(self._heights.shape, -np.inf)

    def at(self, x: float, y: float) -> int:
        """Index of the cell at a position; see :meth:`PointBasin.at`."""
        col = int(np.floor((x - self._x[0]) / self._cell + 0.5))
        row = int(np.floor((self._y[0] - y) / self._cell + 0.5))
        rows, cols = self._used.shape
        if not (0 <= row < rows and 0 <= col < cols and self._used[row, col]):
            raise DataError("lies where there is no ground")
        return int(row * cols + col)

    def fill(self, start: int | None, highest: float, *, ctx: Context = QUIET) -> None:
        """See :meth:`PointBasin.fill`."""
        low = np.where(self._starts, self._heights, np.inf)
        if start is not None:
            low[self._flooded(start, ctx.part(0, 0.5)) >= highest] = np.inf
        first = _first(low)
        self.lowest = float(low.flat[first])
        self._joined = self._flooded(first, ctx.part(0.5, 1))
        ctx.progress(1.0)

    def rise(self, start: int, lake: Polygon, *, ctx: Context = QUIET) -> None:
        """Find the water connected with that of the cell `start`, as it rises from there.

        The lake counts with all of its area from that height on, and squares that its outline cuts
        with what is outside of it: without that half a cell would be lost along the shore.
        """
        self.lowest = float(self._heights.flat[start])
        self._joined = self._flooded(start, ctx)
        inside, near = self._placed(lake, self._squares(), QUIET)
        water = inside | near
        around = shapely.box(*lake.bounds).buffer(2 * self._cell)
        if self._outline is not None:
            around, lake = self._outline, lake.intersection(self._outline)
        xy, z, square = self._around(np.flatnonzero(near))
        land = cut(shapely.difference(around, lake), xy, z, QUIET)
        land = land._replace(parent=square[land.parent])
        self._inside = self._inside & ~water
        self._cut = self._cut.of(~water.flat[self._cut.parent]).joined_by(land)
        under = np.nextafter(self.lowest, -np.inf)  # water counts where it is above the ground
        self._lake = Cut(np.full((1, 3), under), np.array([lake.area]), np.zeros(1, int))
        ctx.progress(1.0)

    def opens(self) -> float:
        """See :meth:`PointBasin.opens`."""
        levels = np.fmax(self._heights, self._joined)
        return float(levels.min(where=self._rim, initial=np.inf))

    def _flooded(self, start: int, ctx: Context) -> Array:
        joined = np.full(self._heights.shape, np.inf)
        what = (self._heights, self._used, joined)
        return _spread(kernels.flood_cells, what, joined, start, self._heights.flat[start], ctx)

    def pieces(self) -> Iterator[Pieces]:
        """See :meth:`PointBasin.pieces`."""
        joined = _lowest_corner(self._joined)
        squares = np.flatnonzero(self._inside)
        for first in range(0, len(squares), BLOCK):
            some = squares[first : first + BLOCK]
            heights = self._corners(some)
            z = np.concatenate([heights, heights.mean(axis=1, keepdims=True)], axis=1)
            triangles = (5 * np.arange(len(some)))[:, None, None] + _FOUR
            areas = np.full(4 * len(some), self._cell**2 / 4)
            yield Pieces(
                triangles.reshape(-1, 3), z.ravel(), areas, np.repeat(joined.flat[some], 4)
            )
        yield self._cut.pieces(joined.ravel())
        yield self._lake.pieces(np.full(1, -np.inf))

    def _squares(self) -> Mask:
        """The squares of which some part holds water, shape (rows - 1, cols - 1)."""
        squares = self._inside.copy()
        squares.flat[self._cut.parent] = True
        return squares

    def _placed(self, outline: Polygon, there: Mask, ctx: Context) -> tuple[Mask, Mask]:
        """Masks of the squares within the outline and near it, shape (rows - 1, cols - 1)."""
        inside, near = np.zeros_like(there), np.zeros_like(there)
        x, y = (self._x[1:] + self._x[:-1]) / 2, (self._y[1:] + self._y[:-1]) / 2
        west, south, east, north = outline.bounds
        cols = np.flatnonzero((x > west - self._cell) & (x < east + self._cell))
        rows = np.flatnonzero((y > south - self._cell) & (y < north + self._cell))
        if not len(cols) or not len(rows):
            return inside, near
        per_block = max(1, BLOCK // len(cols))
        for first in range(0, len(rows), per_block):
            some = np.ix_(rows[first : first + per_block], cols)
            centres = np.stack(np.meshgrid(x[cols], y[some[0].ravel()]), axis=-1).reshape(-1, 2)
            reach = np.full(len(centres), self._cell * math.sqrt(0.5))
            found = placed(outline, centres, reach, there[some].ravel(), QUIET)
            inside[some], near[some] = (mask.reshape(there[some].shape) for mask in found)
            ctx.progress(first / len(rows))
        return inside, near

    def _around(self, squares: NDArray[np.int64]) -> tuple[Array, Array, NDArray[np.int64]]:
        """Corners, heights and index of the square, for the four triangles of each square."""
        row, col = np.divmod(squares, len(self._x) - 1)
        x = np.stack([self._x[col], self._x[col + 1]] * 2, axis=1)[:, [0, 1, 3, 2]]
        y = np.stack([self._y[row]] * 2 + [self._y[row + 1]] * 2, axis=1)
        places = np.stack([x, y, self._corners(squares)], axis=-1)
        five = np.concatenate([places, places.mean(axis=1, keepdims=True)], axis=1)
        corners = five[:, _FOUR].reshape(-1, 3, 3)
        return corners[..., :2], corners[..., 2], np.repeat(squares, 4)

    def _corners(self, squares: NDArray[np.int64]) -> Array:
        """Heights at the corners of squares, going around, array of shape (m, 4)."""
        row, col = np.divmod(squares, len(self._x) - 1)
        z = self._heights
        around = [z[row, col], z[row, col + 1], z[row + 1, col + 1], z[row + 1, col]]
        return np.stack(around, axis=1)


_FOUR = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])  # 4 is the middle of a square


def _at_all_corners(cells: Mask) -> Mask:
    """True for squares whose four cells are all true."""
    return cells[:-1, :-1] & cells[:-1, 1:] & cells[1:, :-1] & cells[1:, 1:]


def _lowest_corner(cells: Array) -> Array:
    """The least value of the four cells of each square."""
    rows = np.minimum(cells[:-1], cells[1:])
    return np.minimum(rows[:, :-1], rows[:, 1:])


def _of_any_square(squares: Mask) -> Mask:
    """True for cells that touch a square that is true."""
    wide = np.pad(squares, 1)
    return ~_at_all_corners(~wide)


def _at_all_squares(squares: Mask) -> Mask:
    """True for cells whose four squares exist and are all true."""
    return _at_all_corners(np.pad(squares, 1))


def _first(low: Array) -> int:
    """Index of the lowest triangle or cell."""
    first = int(np.argmin(low))
    if low.flat[first] == np.inf:
        raise DataError("lies where the ground is not below the highest level")
    return first


def _spread(
    kernel: Callable[..., bool],
    what: tuple[Any, ...],
    joined: Array,
    start: int,
    level: float,
    ctx: Context,
) -> Array:
    """Levels above which each triangle or cell is connected with the start."""
    joined.flat[start] = level
    levels, items, size = np.full(1, level), np.full(1, start, np.int64), np.ones(1, np.int64)
    more = True
    while more:
        ctx.progress(0.0)
        levels = np.concatenate([levels[: size[0]], np.empty(kernels.PUSHES)])
        items = np.concatenate([items[: size[0]], np.empty(kernels.PUSHES, np.int64)])
        more = kernel(*what, levels, items, size)
    return joined


class Cut(NamedTuple):
    """Ground that an outline cuts, as triangles from the first vertex of each ring to its edges.

    Attributes
    ----------
    z : array of shape (t, 3)
    areas : array of shape (t,), below zero where the ring turns the other way
    parent : array of shape (t,), number of the piece
    """

    z: Array
    areas: Array
    parent: NDArray[np.int64]

    def pieces(self, joined: Array) -> Pieces:
        """The triangles for the sums; `joined` has the level of each piece of the basin."""
        triangles = np.arange(self.z.size).reshape(-1, 3)
        return Pieces(triangles, self.z.ravel(), self.areas, joined[self.parent])

    def of(self, wanted: Mask) -> Cut:
        """Some of the triangles."""
        return Cut(self.z[wanted], self.areas[wanted], self.parent[wanted])

    def joined_by(self, other: Cut) -> Cut:
        """These triangles and others."""
        return Cut(*(np.concatenate(both) for both in zip(self, other, strict=True)))


def _no_cut() -> Cut:
    return Cut(np.empty((0, 3)), np.empty(0), np.empty(0, np.int64))


def placed(
    outline: Polygon, centres: Array, reach: Array, there: Mask, ctx: Context
) -> tuple[Mask, Mask]:
    """Which triangles or squares lie within an outline, and which may be cut by it.

    Parameters
    ----------
    centres : array of shape (t, 2)
    reach : array of shape (t,), distance from the centre to the farthest corner
    there : array of shape (t,), the pieces to look at
    """
    boundary = outline.boundary
    shapely.prepare(outline)
    shapely.prepare(boundary)
    inside, near = np.zeros(len(there), bool), np.zeros(len(there), bool)
    for first in range(0, len(there), BLOCK):
        some = first + np.flatnonzero(there[first : first + BLOCK])
        points = shapely.points(centres[some])
        near[some] = shapely.dwithin(boundary, points, reach[some] * (1 + ROUNDING))  # type: ignore[call-overload]
        inside[some] = shapely.contains_properly(outline, points) & ~near[some]
        ctx.progress(first / len(there))
    return inside, near


def cut(outline: Polygon, xy: Array, z: Array, ctx: Context) -> Cut:
    """Intersection of triangles with an outline, as triangles.

    Each intersection may have any shape, with holes. It is given as the triangles from the first
    vertex of each ring to its edges; an integral over it is the sum over these triangles, those
    that turn clockwise subtracted.

    Parameters
    ----------
    xy : array of shape (t, 3, 2)
    z : array of shape (t, 3)
    """
    found = [_no_cut()]
    for first in range(0, len(xy), AT_ONCE):
        last = min(first + AT_ONCE, len(xy))
        # Of a long outline each triangle meets a small part: the rest is cut off for all at once.
        low, high = xy[first:last].min(axis=(0, 1)), xy[first:last].max(axis=(0, 1))
        near = shapely.box(*(2 * low - high - 1), *(2 * high - low + 1))
        part = outline if len(xy) <= AT_ONCE else shapely.intersection(outline, near)
        shapes = shapely.intersection(shapely.polygons(xy[first:last]), part)
        parts, parent = shapely.get_parts(shapes, return_index=True)
        areal = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
        parts, parent = shapely.orient_polygons(parts[areal]), parent[areal]
        rings, part = shapely.get_rings(parts, return_index=True)
        found.append(_fans(rings, first + parent[part], xy, z))
        ctx.progress(last / len(xy))
    return Cut(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))


def _fans(rings: NDArray[Any], parent: NDArray[np.int64], xy: Array, z: Array) -> Cut:
    """Triangles from the first vertex of each ring to its edges, with heights on the ground."""
    places, ring = shapely.get_coordinates(rings, return_index=True)
    if not len(rings):
        return _no_cut()
    begin = np.searchsorted(ring, np.arange(len(rings)))
    edge = np.flatnonzero(ring[1:] == ring[:-1])
    corners = np.stack([begin[ring[edge]], edge, edge + 1], axis=1)
    at, base = parent[ring], xy[parent[ring], 0]
    (ux, uy), (vx, vy), (px, py) = ((way - base).T for way in (xy[at, 1], xy[at, 2], places))
    area = ux * vy - uy * vx
    second, third = (px * vy - py * vx) / area, (ux * py - uy * px) / area
    heights = z[at, 0] + second * (z[at, 1] - z[at, 0]) + third * (z[at, 2] - z[at, 0])
    # Rounding in a thin triangle must not lift its plane off it.
    heights = np.clip(heights, z[at].min(axis=1), z[at].max(axis=1))
    x, y = (np.stack([p[corners[:, k]] for k in range(3)]) for p in (px, py))
    areas = ((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])) / 2
    return Cut(heights[corners], areas, at[edge])


def no_ground(outline: Polygon | None) -> DataError:
    """The error that there is no ground."""
    where = "" if outline is None else " within the outline"
    return DataError(f"neither points nor cells: there is no ground{where}")


def share_missing(covered: float, wanted: float) -> float:
    """Share of an area that is not covered; rounding errors count as none."""
    share = 1 - covered / wanted
    return float(share) if share > ROUNDING else 0.0
