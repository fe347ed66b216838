"""Pieces of the ground of a basin: triangles to sum up, also those that an outline cuts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shared.alpha_shape import ROUNDING
from algorithms.shoreline import _basin_kernels as kernels
from toolbox.context import Context
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


def no_cut() -> Cut:
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
    found = [no_cut()]
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
        return no_cut()
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


def first_of(low: Array) -> int:
    """Index of the lowest triangle or cell."""
    first = int(np.argmin(low))
    if low.flat[first] == np.inf:
        raise DataError("lies where the ground is not below the highest level")
    return first


def spread(
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
