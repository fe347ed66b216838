"""The ground of a basin as triangles between points.

It knows, as that of a raster, where water runs from one piece to the next, and gives triangles to
sum up.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from algorithms.shared.alpha_shape import ROUNDING, circumradii
from algorithms.shared.delaunay import triangulate
from algorithms.shared.places import averaged
from algorithms.shoreline import _basin_kernels as kernels
from algorithms.shoreline._basin_pieces import (
    BLOCK,
    Array,
    Pieces,
    Polygon,
    cut,
    first_of,
    no_cut,
    no_ground,
    placed,
    share_missing,
    spread,
)
from toolbox.context import QUIET, Context
from toolbox.errors import DataError


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

    spill : None: only a lake on a raster runs over

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
        self._inside, self._cut = there, no_cut()
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
        self.spill = None

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
        first = first_of(low)
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
        return spread(kernels.flood_facets, what, joined, start, self._low[start], ctx)

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
