"""Cells of a survey in which water is looked for: their heights, points and intensities."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from algorithms.shared.lowest import blocks, cells_of, lattice_around
from algorithms.shared.windows import between
from algorithms.shoreline import _kernels as kernels
from algorithms.shoreline._returns import UNIT, Returns
from toolbox.context import QUIET, Context
from toolbox.data import Lattice
from toolbox.data.crs import Unit, unit_of

Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]
Floats = NDArray[np.floating[Any]]

# Lengths in metres, from the noise of airborne points (0.02 to 0.05) and the waves of small waters.
COARSE = 4.0  # cells on which the density is counted, unless they hold too few points
PER_CELL = 4.0  # points in a cell of land
SMALLEST_CELL = 0.5
REACH = 2  # cells on each side whose heights are compared
CALM = 0.12  # spread of the heights of these cells on water
KNOWN = 5  # cells of 25 with points, to compare their heights
FILLED = 13  # cells of 25 with points, around a single empty one that is no hole
BLOCK = 4  # cells, with 64 points of land: flights that cover them have some there
STEEPEST = 0.03  # slope of a river: of steeper streams no plane is the surface


@dataclass(frozen=True)
class CellGrid:
    """Statistics of the points in each cell, arrays of shape (rows, cols), in the data's unit.

    Attributes
    ----------
    lattice : the cells
    metre : length of one metre in the unit of the data
    base : height from which the others are counted
    low : lowest height, inf where there is no point
    high : highest, -inf where there is none
    count : number of points
    bright : mean intensity, NaN where there is no point
    water : number of points of a class of water
    middle : median of the lowest heights around, NaN where there is none
    spread : of these, from 20 to 80 %
    known : number of cells around that have points, of 25
    inside : whether the cell has data, or lies between data in its row or column
    surrounded : whether it has data, or lies between data in its row and in its column
    flights : number of flights that cover the cell, at least 1
    flown : whether a flight has points in the cell, or on both sides of it in its row or column
    strips : number of flights that are told apart
    density : points per square unit on land
    """

    lattice: Lattice
    metre: float
    base: float
    low: Floats
    high: Floats
    count: NDArray[np.int32]
    bright: Floats
    water: NDArray[np.int32]
    middle: Floats
    spread: Floats
    known: NDArray[np.uint8]
    inside: Mask
    surrounded: Mask
    flights: NDArray[np.uint16]
    flown: Mask
    strips: int
    density: float

    @property
    def unit(self) -> str:
        """The unit of the data, as it may be written behind a height; "" for another one."""
        return unit_of(1 / self.metre)

    @property
    def own(self) -> Unit | None:
        """That unit with its metres; None of metres, and of one without a name."""
        return (self.unit, 1 / self.metre) if self.unit not in ("", "m") else None

    @property
    def area(self) -> float:
        """Area of a cell."""
        return self.lattice.cell**2

    def centres(self, some: Ints) -> NDArray[np.float64]:
        """Positions of cells by their indices, shape (n, 2)."""
        xs, ys = self.lattice.centres()
        return np.column_stack([xs[some % self.lattice.cols], ys[some // self.lattice.cols]])

    @cached_property
    def whole(self) -> Mask:
        """True for cells that the edge of the data does not cut."""
        return np.asarray(ndimage.binary_erosion(self.inside, np.ones((3, 3), bool)))

    @property
    def hole(self) -> Mask:
        """True for cells without points, unless single ones among cells with points."""
        return np.asarray(self.inside & (self.count == 0) & (self.known < FILLED))

    def without(self, some: Ints) -> CellGrid:
        """The same, but for some cells without points that are taken to lie outside of the data."""
        there = np.ones(self.inside.shape, bool)
        there.ravel()[some] = False
        return replace(self, inside=self.inside & there, surrounded=self.surrounded & there)

    def calm(self, spread: float = CALM) -> Mask:
        """True for cells around which the heights are nearly equal, to a spread in metres."""
        calm = self.spread <= spread * self.metre
        return np.asarray(self.inside & (self.known >= KNOWN) & calm)

    @property
    def floor(self) -> Floats:
        """Height from which water covers a cell; -inf in holes, inf outside of the data."""
        floor = np.where(self.count > 0, self.low, self.middle)
        floor[self.hole] = -np.inf
        floor[~self.inside] = np.inf
        return floor

    @property
    def rim(self) -> Mask:
        """True for holes at the edge of the data: of what lies there nothing is known."""
        return np.asarray(self.hole & ~self.surrounded)


class Tilt(NamedTuple):
    """A plane through height 0 at a row and a column, with its rise per cell."""

    south: float = 0.0
    east: float = 0.0
    row: float = 0.0
    col: float = 0.0

    def at(self, row: Any, col: Any) -> Floats:
        """Heights of the plane at rows and columns."""
        return np.asarray(self.south * (row - self.row) + self.east * (col - self.col))

    def steep(self, cell: float) -> bool:
        """Whether no river falls so that its surface is a plane, in cells of a size."""
        return math.hypot(self.south, self.east) > STEEPEST * cell


LEVEL = Tilt()


def grid(points: Returns, ctx: Context = QUIET) -> CellGrid:
    """Statistics of points in cells, whose size follows from the density of the points."""
    metre = points.metre
    corners = points.origin + UNIT * np.array([f(points.packed, axis=0) for f in (np.min, np.max)])
    density = _density(points, corners, ctx.part(0.0, 0.2))
    size = max(math.sqrt(PER_CELL / density) / metre, SMALLEST_CELL)
    lattice = lattice_around(corners, size * metre, count=len(points))
    low, high = (np.full(lattice.shape, v, np.float32) for v in (np.inf, -np.inf))
    bright = np.zeros(lattice.shape, np.float32)
    count, water = np.zeros(lattice.shape, np.int32), np.zeros(lattice.shape, np.int32)
    base = float(corners[0, 2])
    seen = _Seen.by(points.strip, lattice)
    for some in points.blocks():
        xyz = points.xyz(some)
        cell = cells_of(xyz, lattice)
        seen.mark(points.strip[some], cell)
        kernels.gather(
            cell,
            xyz[:, 2] - base,
            points.intensity[some],
            points.water[some],
            low.ravel(),
            high.ravel(),
            count.ravel(),
            bright.ravel(),
            water.ravel(),
        )
        ctx.progress(0.2 + 0.5 * some.stop / len(points))
    middle, spread = np.full_like(low, np.nan), np.full_like(low, np.inf)
    known = np.zeros(lattice.shape, np.uint8)
    for first, last in blocks(lattice.rows, 25 * lattice.cols):
        kernels.surroundings(low, first, last, REACH, middle, spread, known)
        ctx.progress(0.7 + 0.3 * last / lattice.rows)
    with np.errstate(invalid="ignore"):
        bright /= count
    column, row = between(count > 0, 0), between(count > 0, 1)
    inside, surrounded = column | row, column & row
    return CellGrid(
        lattice,
        metre,
        base,
        low,
        high,
        count,
        bright,
        water,
        middle,
        spread,
        known,
        inside,
        surrounded,
        *seen.cover(),
        len(seen.blocks),
        density,
    )


class _Seen(NamedTuple):
    """In which blocks of cells each flight has points, shape (flights, rows, cols)."""

    lattice: Lattice
    number: NDArray[np.intp]
    blocks: Mask

    @classmethod
    def by(cls, strip: NDArray[np.uint16], lattice: Lattice) -> _Seen:
        """No blocks yet; `strip` are those of all points."""
        there = np.bincount(strip, minlength=1) > 0
        shape = (int(there.sum()), *(-(-size // BLOCK) for size in lattice.shape))
        return cls(lattice, np.cumsum(there) - 1, np.zeros(shape, bool))

    def mark(self, strip: NDArray[np.uint16], cell: NDArray[np.integer[Any]]) -> None:
        """Take in some points, by their flights and cells."""
        if len(self.blocks) > 1:
            row, col = np.divmod(cell, self.lattice.cols)
            self.blocks[self.number[strip], row // BLOCK, col // BLOCK] = True

    def cover(self) -> tuple[NDArray[np.uint16], Mask]:
        """How many flights cover each cell, at least 1, and whether one covers it at all.

        What lies amid points of one, in its row and its column, is covered, too. Wide water and
        shadows from edge to edge have points on two sides alone, in their rows or columns; but what
        lies between two strips that do not overlap has not.
        """
        flights = np.zeros(self.blocks.shape[1:], np.uint16)
        flown = np.zeros(self.blocks.shape[1:], bool)
        for one in self.blocks:  # of which there may be thousands
            column, row = between(one, 0), between(one, 1)
            flights += column & row
            flown |= column | row
        return self._of_cells(np.maximum(flights, 1)), self._of_cells(flown)

    def _of_cells(self, blocks: NDArray[Any]) -> NDArray[Any]:
        rows, cols = self.lattice.shape
        return blocks.repeat(BLOCK, 0).repeat(BLOCK, 1)[:rows, :cols]


def _density(points: Returns, corners: NDArray[np.float64], ctx: Context) -> float:
    """Points per square unit on land, counted on cells that grow until most of these hold several.

    Where most cells hold none, a single point would make the one that it is in seem dense.
    """
    size, extent = COARSE * points.metre, float(np.ptp(corners[:, :2], axis=0).max())
    while True:
        coarse = lattice_around(corners, size, count=len(points))
        counts = np.zeros(coarse.rows * coarse.cols, np.int64)
        for some in points.blocks():
            counts += np.bincount(cells_of(points.xyz(some), coarse), minlength=len(counts))
            ctx.progress(some.stop / len(points))
        on_land = float(np.percentile(counts[counts > 0], 75))
        if on_land >= PER_CELL or size >= extent:
            return on_land / size**2
        size *= 2


def fit(cells: CellGrid, some: Ints, heights: Floats) -> tuple[float, Tilt]:
    """Level and tilt of the least-squares plane through heights at cells."""
    r, c = some // cells.lattice.cols, some % cells.lattice.cols
    row, col = float(r.mean()), float(c.mean())
    design = np.column_stack([np.ones(len(some)), r - row, c - col])
    (level, south, east), *_ = np.linalg.lstsq(design, heights.astype(float), rcond=None)
    return float(level), Tilt(float(south), float(east), row, col)


def patches(mask: Mask, least: int, beside: NDArray[Any] | None = None) -> Iterator[Ints]:
    """Indices of the cells of each connected patch of at least `least` cells.

    Parameters
    ----------
    beside : which of 3 x 3 cells are connected to the middle one; by default those at its sides
    """
    labels, _ = ndimage.label(mask, beside)
    sizes = np.bincount(labels.ravel())
    order = np.argsort(labels.ravel(), kind="stable")
    ends = np.cumsum(sizes)
    for label in np.flatnonzero(sizes >= least):
        if label:
            yield order[ends[label] - sizes[label] : ends[label]]


def connected(lattice: Lattice, some: Ints, least: float) -> Iterator[Ints]:
    """The connected cells among some, where they are many enough."""
    if len(some) < least:
        return
    (top, left), mask = window(lattice, some, 0)
    labels, count = ndimage.label(mask)
    of = labels[some // lattice.cols - top, some % lattice.cols - left]
    for number in np.flatnonzero(np.bincount(of, minlength=count + 1) >= least):
        yield some[of == number]


def around(lattice: Lattice, some: Ints, width: int, inner: int = 0) -> Ints:
    """Indices of the cells within a number of cells of some, but for those within fewer of them."""
    (top, left), near = window(lattice, some, width)
    square = np.ones((3, 3), bool)
    if inner:
        near = ndimage.binary_dilation(near, square, iterations=inner)
    ring = ndimage.binary_dilation(near, square, iterations=width - inner) & ~near
    r, c = np.nonzero(ring)
    return (r + top) * lattice.cols + c + left


def window(lattice: Lattice, some: Ints, margin: int) -> tuple[tuple[int, int], Mask]:
    """First row and column, and mask, of the smallest window around cells with a margin."""
    r, c = some // lattice.cols, some % lattice.cols
    top, left = max(0, r.min() - margin), max(0, c.min() - margin)
    bottom = min(lattice.rows, r.max() + margin + 1)
    right = min(lattice.cols, c.max() + margin + 1)
    mask = np.zeros((bottom - top, right - left), bool)
    mask[r - top, c - left] = True
    return (int(top), int(left)), mask


def shore_of(cells: CellGrid, body: Ints) -> Ints:
    """Indices of the cells with points around a body, but for those at its very edge."""
    ring = around(cells.lattice, body, 5, 1)
    return np.asarray(ring[cells.count.ravel()[ring] > 0])


def median_of_counts(counts: NDArray[np.integer[Any]]) -> float:
    """Median of whole numbers as if each were spread evenly over the half numbers around it.

    Their plain median jumps by a whole number, from 3 to 4, where few of them change.

    Examples
    --------
    >>> median_of_counts(np.array([3, 3, 3, 4, 4]))
    3.3333333333333335
    >>> median_of_counts(np.array([3, 3, 4, 4, 4]))
    3.6666666666666665
    >>> median_of_counts(np.array([3, 3, 4, 4]))
    3.5
    """
    middle = np.sort(counts)[(len(counts) - 1) // 2]
    below, at = (counts < middle).sum(), (counts == middle).sum()
    return float(middle - 0.5 + (len(counts) / 2 - below) / at)
