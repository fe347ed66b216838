"""The lattice of square cells that rasters lie on."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from affine import Affine
from numpy.typing import ArrayLike, NDArray

from toolbox.errors import DataError

if TYPE_CHECKING:
    from toolbox.data.raster import Raster

MAX_INDEX = 2**53
"""Cells are counted from the origin of the coordinates in whole float64 numbers."""

MAX_CELLS = 1_000_000_000
"""A lattice with more cells than this is taken for a mistake in the cell size."""

_ROUNDING = 1e-6  # cells: coordinates this close to a cell boundary lie on it


def in_plan(bounds: Sequence[float]) -> Sequence[float]:
    """Bounds (xmin, ymin, xmax, ymax), also of those with heights as a point cloud has them.

    >>> in_plan((0, 1, 5, 2, 3, 6))
    (0, 1, 2, 3)
    """
    return (*bounds[:2], *bounds[3:5]) if len(bounds) == 6 else bounds


@dataclass(frozen=True)
class Lattice:
    """Square cells in rows from north to south and columns from west to east.

    A cell holds its west and south edge; the last ones hold the outer east and north edge too,
    so that every point of the covered bounds has a cell. Which cell a point falls in does not
    depend on where the lattice begins, so tiles agree with the whole to the last bit.

    Parameters
    ----------
    west, north : outer corner, in CRS units
    cell : size of a cell, in CRS units
    rows, cols : number of cells

    Raises
    ------
    DataError
        The lattice has no cells, or more than `MAX_CELLS`.

    Examples
    --------
    >>> lattice = Lattice.cover((0, 0, 9, 5), cell=2.5)
    >>> lattice.shape, lattice.bounds
    ((2, 4), (0.0, 0.0, 10.0, 5.0))
    >>> x, y = lattice.centres()
    >>> x
    array([1.25, 3.75, 6.25, 8.75])
    """

    west: float
    north: float
    cell: float
    rows: int
    cols: int

    def __post_init__(self) -> None:
        if not (math.isfinite(self.cell) and self.cell > 0):
            raise DataError(f"the cell size must be > 0, got {self.cell}")
        if self.rows < 1 or self.cols < 1:
            raise DataError(f"a raster needs cells, got {self.rows} rows x {self.cols} columns")
        if self.rows * self.cols > MAX_CELLS:
            raise DataError(
                f"cells of {self.cell:g} make {self.rows} rows x {self.cols} columns, more than "
                f"{MAX_CELLS} cells; choose larger cells or work in tiles"
            )

    @classmethod
    def cover(cls, bounds: Sequence[float], cell: float) -> Lattice:
        """The smallest lattice over bounds whose edges are whole multiples of the cell.

        Parameters
        ----------
        bounds : (xmin, ymin, xmax, ymax), or with heights as a point cloud has them
        cell : in the unit of the bounds

        Raises
        ------
        DataError
            The bounds are not finite, or hold more than `MAX_CELLS` cells.
        """
        bounds = in_plan(bounds)
        if not (math.isfinite(cell) and cell > 0):
            raise DataError(f"the cell size must be > 0, got {cell}")
        if not all(math.isfinite(value) for value in bounds):
            raise DataError(f"cannot lay cells over the bounds {tuple(bounds)}; no points?")
        if max(map(abs, bounds)) / MAX_INDEX >= cell:
            raise DataError(f"cells of {cell:g} cannot be counted so far from the origin")
        low = [math.floor(value / cell + _ROUNDING) for value in bounds[:2]]
        high = [math.ceil(value / cell - _ROUNDING) for value in bounds[2:]]
        cols, rows = (max(1, h - w) for w, h in zip(low, high, strict=True))
        return cls(_multiple(low[0], cell), _multiple(low[1] + rows, cell), cell, rows, cols)

    @classmethod
    def of(cls, raster: Raster) -> Lattice:
        """The lattice of an existing raster, to use it as a template."""
        return cls(raster.transform.c, raster.transform.f, raster.cell, *raster.shape)

    def window(self, rows: slice, cols: slice) -> Lattice:
        """The lattice of some rows and columns of this one."""
        (col, east), (top, north) = self._corner
        first_row, last_row, _ = rows.indices(self.rows)
        first_col, last_col, _ = cols.indices(self.cols)
        return Lattice(
            _multiple(col + first_col, self.cell) + east * self.cell,
            _multiple(top - first_row, self.cell) + north * self.cell,
            self.cell,
            last_row - first_row,
            last_col - first_col,
        )

    def near(self, bounds: Sequence[float]) -> Lattice | None:
        """The window of cells that touch bounds (xmin, ymin, xmax, ymax), and one around; or None.

        With that one, no edge of the bounds becomes an outer edge, which the last cells hold.
        """
        west, south, east, north = bounds
        ends = (west - self.west, east - self.west), (self.north - north, self.north - south)
        cols, rows = (
            slice(
                max(0, math.floor(first / self.cell) - 1),
                max(0, math.ceil(last / self.cell) + 1),
            )
            for first, last in ends
        )
        empty = cols.start >= min(cols.stop, self.cols) or rows.start >= min(rows.stop, self.rows)
        return None if empty else self.window(rows, cols)

    @classmethod
    def union(cls, lattices: Iterable[Lattice]) -> Lattice:
        """The smallest lattice that has all cells of some windows of one lattice.

        Raises
        ------
        DataError
            Their cells do not fit each other.
        """
        windows = list(lattices)
        first = windows[0]
        west, north = min(w.west for w in windows), max(w.north for w in windows)
        rows = max(round((north - w.north) / first.cell) + w.rows for w in windows)
        cols = max(round((w.west - west) / first.cell) + w.cols for w in windows)
        whole = cls(west, north, first.cell, rows, cols)
        for window in windows:
            whole.position_of(window)
        return whole

    def position_of(self, window: Lattice) -> tuple[int, int]:
        """Row and column of this lattice at which a window of it begins.

        Raises
        ------
        DataError
            The cells of the window are of another size, or lie between those of this lattice.
        """
        row, col = (self.north - window.north) / self.cell, (window.west - self.west) / self.cell
        off = max(abs(row - round(row)), abs(col - round(col)))
        if window.cell != self.cell or off > 1e-3:
            raise DataError(
                f"cells of {window.cell:g} do not fit those of {self.cell:g} beside them"
            )
        return round(row), round(col)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.rows, self.cols

    @property
    def transform(self) -> Affine:
        """The affine transform from (column, row) of a cell corner to coordinates."""
        return Affine(self.cell, 0.0, self.west, 0.0, -self.cell, self.north)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax) of the outer edges."""
        (col, east), (top, north) = self._corner
        return (
            self.west,
            _multiple(top - self.rows, self.cell) + north * self.cell,
            _multiple(col + self.cols, self.cell) + east * self.cell,
            self.north,
        )

    @property
    def _corner(self) -> tuple[tuple[int, float], tuple[int, float]]:
        """Cells from the origin to the west and the north edge; whole ones, and the rest of one."""
        return _cells_from_origin(self.west, self.cell), _cells_from_origin(self.north, self.cell)

    def centres(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Coordinates of the cell centres: x of shape (cols,), y of shape (rows,)."""
        (col, east), (top, north) = self._corner
        cols = np.arange(col, col + self.cols, dtype=np.float64)
        rows = np.arange(top, top - self.rows, -1, dtype=np.float64)
        return (cols + (0.5 + east)) * self.cell, (rows - (0.5 - north)) * self.cell

    def indices(self, x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of the cell that holds each point.

        Points outside get a row < 0 or >= rows, or a column < 0 or >= cols (see `holds`).

        Parameters
        ----------
        x, y : arrays of one shape, finite

        Returns
        -------
        row, col : int64 arrays of that shape
        """
        col, (east, north) = _cells(x, self.west, self.cell), self.bounds[2:]
        row = np.asarray(-1 - _cells(y, self.north, self.cell))
        slack = _ROUNDING * self.cell
        col[(col == self.cols) & (np.asarray(x) <= east + slack)] = self.cols - 1
        row[(row == -1) & (np.asarray(y) <= north + slack)] = 0
        return row, col

    def holds(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """Mask of the points that lie on the lattice."""
        row, col = self.indices(x, y)
        return (row >= 0) & (row < self.rows) & (col >= 0) & (col < self.cols)


def _cells_from_origin(value: float, cell: float) -> tuple[int, float]:
    """A coordinate as whole cells from the origin, and the rest (0 on a snapped lattice)."""
    whole = round(value / cell)
    rest = value / cell - whole
    return whole, 0.0 if abs(rest) <= _ROUNDING else rest


def _cells(values: ArrayLike, corner: float, cell: float) -> NDArray[np.int64]:
    """Number of whole cells from a corner to each value, rounded down."""
    whole, rest = _cells_from_origin(corner, cell)
    cells = np.floor(np.asarray(values, float) / cell - rest + _ROUNDING).astype(np.int64)
    return np.asarray(cells - whole)


def _multiple(count: int, cell: float) -> float:
    """`count` cells, as the number a person would write: 3 cells of 0.1 are 0.3."""
    per_unit = round(1 / cell)
    return count / per_unit if per_unit and 1 / per_unit == cell else count * cell
