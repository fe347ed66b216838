"""The ground of a basin as squares between the cell centres of a raster."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from algorithms.shared.error_measures import NORMAL
from algorithms.shared.polygons import cells_within
from algorithms.shoreline import _basin_kernels as kernels
from algorithms.shoreline._basin_pieces import (
    BLOCK,
    Array,
    Cut,
    Mask,
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
from toolbox.data import Lattice
from toolbox.errors import DataError


class Spill(NamedTuple):
    """Where a lake runs over its rim: level, and position of the cell of the saddle."""

    level: float
    x: float
    y: float


class RasterBasin:
    """Ground as squares between the centres of four cells, each cut into four triangles.

    The half cells at the edge of the raster, and around cells without a value, hold nothing. The
    rest as that of points, `PointBasin`.

    Parameters
    ----------
    fall : what ground behind a saddle must be lower than it to be behind a rim, for `rise`, in the
        unit of the heights

    Attributes
    ----------
    spill : where the lake runs over first; from `rise` on, None if it never does
    """

    def __init__(
        self,
        heights: Array,
        lattice: Lattice,
        outline: Polygon | None,
        *,
        fall: float = 0.0,
        ctx: Context = QUIET,
    ) -> None:
        if min(heights.shape) < 2:
            raise DataError("a raster needs two rows and two columns of points to be a surface")
        self._lattice = lattice
        self._x, self._y = lattice.centres()
        self._cell, self._heights = lattice.cell, np.ascontiguousarray(heights, np.float64)
        there = _at_all_corners(np.isfinite(self._heights))
        self._inside, self._cut = there, no_cut()
        self._outline, self._lake = outline, no_cut()
        outside = _outside(there)
        wanted = np.count_nonzero(~outside) * self._cell**2
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
        self._outer = self._rim & ~_at_all_squares(~outside)
        self._starts = _of_any_square(self._inside) if self._inside.any() else self._used
        found = np.concatenate([self._heights[self._starts], self._cut.z.ravel()])
        self.lowest, self.highest = float(found.min()), float(found.max())
        covered = self._inside.sum() * self._cell**2 + self._cut.areas.sum()
        self.missing = share_missing(covered, wanted)
        self._joined = np.full(self._heights.shape, -np.inf)
        self._fall = fall
        self.spill: Spill | None = None

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
        first = first_of(low)
        self.lowest = float(low.flat[first])
        self._joined = self._flooded(first, ctx.part(0.5, 1))
        ctx.progress(1.0)

    def rise(self, start: int, lake: Polygon, *, ctx: Context = QUIET) -> None:
        """Find the water connected with that of the cell `start`, as it rises from there.

        What lies behind the rim over which it runs first is never connected; see `spill`.
        The lake counts with all of its area from that height on, and squares that its outline cuts
        with what is outside of it: without that half a cell would be lost along the shore.
        """
        self.lowest = float(self._heights.flat[start])
        self._joined = self._risen(start, lake, ctx)
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

    def _risen(self, start: int, lake: Polygon, ctx: Context) -> Array:
        """Levels above which cells are one water with the lake, on its side of the rim."""
        heights, used = self._heights, self._used
        wet = np.zeros(heights.shape, bool)
        wet[cells_within(lake, self._lattice)] = True
        wet &= used
        wet.flat[start] = True
        joined = np.where(wet, np.fmax(heights, self.lowest), np.inf)
        shore = np.flatnonzero(ndimage.binary_dilation(wet) & used & ~wet)
        levels = np.fmax(heights.flat[shore], self.lowest)
        order = np.argsort(levels, kind="stable")  # in which order they are taken
        levels, items = levels[order], 2 * shore[order]
        size = np.array([len(levels)])
        side = np.where(wet, kernels.OWN, kernels.FREE).astype(np.uint8)
        tally = np.array([np.count_nonzero(wet), joined[wet].sum()])
        spill = np.array([np.inf, -1.0])
        what = (heights, used, self._outer, self.lowest, self._fall, joined, side, tally, spill)
        more = len(levels) > 0
        while more:
            ctx.progress(0.0)
            levels, items, more = kernels.flood_lake(*what, levels, items, size)
        if np.isfinite(spill[0]):
            row, col = divmod(int(spill[1]), heights.shape[1])
            self.spill = Spill(float(spill[0]), float(self._x[col]), float(self._y[row]))
        return joined

    def opens(self) -> float:
        """See :meth:`PointBasin.opens`."""
        levels = np.fmax(self._heights, self._joined)
        return float(levels.min(where=self._rim, initial=np.inf))

    def roughness(self, level: float) -> float:
        """Standard error of a cell's height on the ground around the water of a level.

        That of its height less the mean of the four beside it, by the median, as steps of walls and
        banks are no error. Between points the cells of a raster are smooth, which it does not see.
        """
        wet = np.fmax(self._heights, self._joined) <= level
        z = np.pad(self._heights, 1, constant_values=np.nan)
        around = (z[:-2, 1:-1] + z[2:, 1:-1] + z[1:-1, :-2] + z[1:-1, 2:]) / 4
        off = np.abs(self._heights - around)[ndimage.binary_dilation(wet) & ~wet]
        off = off[np.isfinite(off)]
        return float(NORMAL * np.median(off) / math.sqrt(1.25)) if len(off) else 0.0

    def _flooded(self, start: int, ctx: Context) -> Array:
        joined = np.full(self._heights.shape, np.inf)
        what = (self._heights, self._used, joined)
        return spread(kernels.flood_cells, what, joined, start, self._heights.flat[start], ctx)

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


def _outside(there: Mask) -> Mask:
    """True for squares beyond the end of the data, and not in a gap that it encloses.

    Parameters
    ----------
    there : array of shape (rows - 1, cols - 1), squares that are known
    """
    outside = np.pad(~there, 1, constant_values=True)
    border = np.ones(outside.shape, bool)
    border[1:-1, 1:-1] = False
    ends = ndimage.binary_propagation(border, np.ones((3, 3), bool), outside)
    return np.asarray(ends[1:-1, 1:-1])


def _of_any_square(squares: Mask) -> Mask:
    """True for cells that touch a square that is true."""
    wide = np.pad(squares, 1)
    return ~_at_all_corners(~wide)


def _at_all_squares(squares: Mask) -> Mask:
    """True for cells whose four squares exist and are all true."""
    return _at_all_corners(np.pad(squares, 1))
