"""Where water is: cells of a survey, places that look like water, and what they fill.

Near-infrared light is absorbed by water or mirrored away from it, so a lake is a hole in the data,
or flat and dark with few returns. But shadows behind buildings and gaps between strips are holes
too, and roads and sports grounds are flat and dark. What tells water from them is that it stays
where it is: everything around a water body is higher than its level. So water is poured on every
hole and every calm place up to the level found there, and what runs off was no water.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from algorithms.shared.lowest import blocks, cells_of, lattice_around
from algorithms.shoreline import _kernels as kernels
from algorithms.shoreline._level import lowest_mode, mode
from toolbox.context import QUIET, Context
from toolbox.data import Lattice

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]

# Lengths in metres, from the noise of airborne points (0.02 to 0.05) and the waves of small waters.
COARSE = 4.0  # cells on which the density is counted
PER_CELL = 4.0  # points in a cell of land
SMALLEST_CELL, LARGEST_CELL = 0.5, 10.0
REACH = 2  # cells on each side whose heights are compared
CALM = 0.12  # spread of their heights on water
KNOWN = 5  # cells of 25 with points, to compare their heights
FILLED = 13  # cells of 25 with points, around a single empty one that is no hole
STEP = 0.10  # above the level where a first look at a body ends
DROP = 0.25  # below the level: water does not stay above such ground
RUN_OFF = 0.02  # share of a body that may seem to lie lower
SPARSE = 0.5  # of the density of the shore: pulses were lost
DARK = 0.5  # separation of intensities on water and on the shore, 0 for none, 1 for a full one
LEVEL_SLOPE = 0.0005  # of a surface that is level
PEAKS = 12  # levels that are looked for in one calm place


@dataclass(frozen=True)
class Grid:
    """What is known of each cell; arrays of shape (rows, cols), lengths in the unit of the data.

    Attributes
    ----------
    lattice : the cells
    metre : length of one metre in the unit of the data
    low : lowest height, inf where there is no point
    count : number of points
    bright : mean intensity, NaN where there is no point
    middle : median of the lowest heights around, NaN where there is none
    spread : of these, from 20 to 80 %
    known : number of cells around that have points, of 25
    inside : whether the cell is surrounded by data
    density : points per square unit on land
    """

    lattice: Lattice
    metre: float
    low: Floats
    count: NDArray[np.int32]
    bright: Floats
    middle: Floats
    spread: Floats
    known: NDArray[np.int32]
    inside: Mask
    density: float

    @property
    def area(self) -> float:
        """Of a cell, square metres."""
        return (self.lattice.cell / self.metre) ** 2

    @property
    def hole(self) -> Mask:
        """Cells without points, but for single ones."""
        return self.inside & (self.count == 0) & (self.known < FILLED)

    @property
    def calm(self) -> Mask:
        """Cells around which heights are nearly the same."""
        return self.inside & (self.known >= KNOWN) & (self.spread <= CALM * self.metre)

    @property
    def floor(self) -> Floats:
        """Height that water must reach to cover a cell; -inf in holes, inf outside of the data."""
        floor = np.where(self.count > 0, self.low, self.middle)
        floor[self.hole] = -np.inf
        floor[~self.inside] = np.inf
        return floor


@dataclass(frozen=True)
class Body:
    """Water as the cells show it.

    Attributes
    ----------
    cells : array of shape (n,), indices into the raveled cells
    level : a first estimate, in the unit of the data
    lost : density of points on the water over that on its shore
    dark : separation of the intensities on water and shore, 0 to 1
    """

    cells: Ints
    level: float
    lost: float
    dark: float


def grid(xyz: Floats, intensity: Floats, metre: float, ctx: Context = QUIET) -> Grid:
    """Count points into cells whose size follows from their density.

    Parameters
    ----------
    xyz : array of shape (n, 3), last returns
    intensity : array of shape (n,)
    metre : length of one metre in the unit of the points
    ctx : progress and cancellation
    """
    coarse = lattice_around(xyz, COARSE * metre)
    counts = np.bincount(cells_of(xyz, coarse))
    density = float(np.percentile(counts[counts > 0], 75)) / coarse.cell**2
    ctx.progress(0.1)
    size = math.sqrt(PER_CELL / density) / metre
    lattice = lattice_around(xyz, min(max(size, SMALLEST_CELL), LARGEST_CELL) * metre)
    low, bright = np.full(lattice.shape, np.inf), np.zeros(lattice.shape)
    count = np.zeros(lattice.shape, np.int32)
    for first, last in blocks(len(xyz)):
        cells = cells_of(xyz[first:last], lattice)
        kernels.gather(
            cells, xyz[first:last, 2], intensity[first:last], low.ravel(), count.ravel(),
            bright.ravel(),
        )  # fmt: skip
        ctx.progress(0.1 + 0.5 * last / len(xyz))
    middle, spread = np.full(lattice.shape, np.nan), np.full(lattice.shape, np.inf)
    known = np.zeros(lattice.shape, np.int32)
    for first, last in blocks(lattice.rows, 25 * lattice.cols):
        kernels.surroundings(low, first, last, REACH, middle, spread, known)
        ctx.progress(0.6 + 0.4 * last / lattice.rows)
    with np.errstate(invalid="ignore"):
        bright /= count
    return Grid(
        lattice, metre, low, count, bright, middle, spread, known, enclosed(count > 0), density
    )


def enclosed(data: Mask) -> Mask:
    """Cells with data, and those that lie between data in their row or in their column."""
    inside = data.copy()
    for axis in (0, 1):
        before = np.logical_or.accumulate(data, axis=axis)
        after = np.flip(np.logical_or.accumulate(np.flip(data, axis), axis=axis), axis)
        inside |= before & after
    return inside


def find_bodies(cells: Grid, least_area: float, ctx: Context = QUIET) -> list[Body]:
    """All water bodies, the largest first.

    Parameters
    ----------
    cells : see :func:`grid`
    least_area : of a body, square metres
    ctx : progress and cancellation
    """
    floor = cells.floor
    least = max(1, math.ceil(least_area / cells.area))
    state, stack = np.zeros(floor.shape, np.uint8), np.empty(floor.size, np.int64)
    found: list[Body] = []
    places = [*_holes(cells, least), *_calm_places(cells, least)]
    places.sort(key=lambda place: -len(place[0]))
    for done, (starts, level) in enumerate(places):
        ctx.progress(done / len(places))
        if (state.ravel()[starts] == 2).mean() > 0.5:  # found from elsewhere
            continue
        top, below = level + STEP * cells.metre, level - DROP * cells.metre
        most_lower = int(max(least / 2, RUN_OFF * len(starts)))
        size, lower = kernels.spread(
            floor, cells.middle, top, below, most_lower, starts, state, stack
        )
        body = stack[:size].copy()
        state.ravel()[body] = 0
        if lower > most_lower or size < least:
            continue
        judged = judge(cells, body, level)
        if judged:
            state.ravel()[body] = 2
            found.append(judged)
    ctx.progress(1.0)
    return sorted(found, key=lambda body: (-len(body.cells), body.cells[0]))


def _holes(cells: Grid, least: int) -> Iterator[tuple[Ints, float]]:
    """Holes in the data, with the level at their edge."""
    for hole in _patches(cells.hole, least):
        edge = _around(cells.lattice, hole, 1)
        heights = cells.low.ravel()[edge]
        heights = heights[np.isfinite(heights)]
        if len(heights):
            yield hole, lowest_mode(heights, STEP * cells.metre)


def _calm_places(cells: Grid, least: int) -> Iterator[tuple[Ints, float]]:
    """Calm places at one level each."""
    step = STEP * cells.metre
    for place in _patches(cells.calm, least):
        rest = place
        for _ in range(PEAKS):
            if len(rest) < least:
                break
            heights = cells.middle.ravel()[rest]
            level = mode(heights, step / 2)
            at = abs(heights - level) <= step
            if at.sum() >= least:
                yield rest[at], level
            rest = rest[~at]


def _patches(mask: Mask, least: int) -> Iterator[Ints]:
    """Indices of the cells of each connected patch of at least so many cells."""
    labels, _ = ndimage.label(mask)
    sizes = np.bincount(labels.ravel())
    order = np.argsort(labels.ravel(), kind="stable")
    ends = np.cumsum(sizes)
    for label in np.flatnonzero(sizes >= least):
        if label:
            yield order[ends[label] - sizes[label] : ends[label]]


def _around(lattice: Lattice, some: Ints, width: int) -> Ints:
    """Cells within a width of some cells, but not these."""
    window, mask = _window(lattice, some, width)
    ring = ndimage.binary_dilation(mask, np.ones((3, 3), bool), iterations=width) & ~mask
    r, c = np.nonzero(ring)
    return (r + window[0]) * lattice.cols + c + window[1]


def _window(lattice: Lattice, some: Ints, margin: int) -> tuple[tuple[int, int], Mask]:
    """First row and column, and mask, of the smallest window with a margin around some cells."""
    r, c = some // lattice.cols, some % lattice.cols
    top, left = max(0, r.min() - margin), max(0, c.min() - margin)
    bottom = min(lattice.rows, r.max() + margin + 1)
    right = min(lattice.cols, c.max() + margin + 1)
    mask = np.zeros((bottom - top, right - left), bool)
    mask[r - top, c - left] = True
    return (int(top), int(left)), mask


def judge(cells: Grid, body: Ints, level: float) -> Body | None:
    """What speaks for water in a place that holds it; None where too little does."""
    ring = np.setdiff1d(_around(cells.lattice, body, 5), _around(cells.lattice, body, 1))
    ring = ring[cells.count.ravel()[ring] > 0]
    count, bright = cells.count.ravel(), cells.bright.ravel()
    here = body[count[body] > 0]
    on_land = float(np.median(count[ring])) if len(ring) else 0.0
    lost = float(count[body].mean()) / on_land if on_land else 1.0
    dark = separation(bright[here], bright[ring])
    if lost > SPARSE and dark < DARK and not _is_level(cells, here):
        return None
    return Body(body, level, lost, dark)


def separation(water: Floats, land: Floats) -> float:
    """Largest difference between the distributions of two samples, where water is the darker."""
    if not (len(water) and len(land)):
        return 0.0
    water, land = np.sort(water), np.sort(land)
    at = np.concatenate([water, land])
    below = [np.searchsorted(some, at, side="right") / len(some) for some in (water, land)]
    return max(0.0, float((below[0] - below[1]).max()))


def _is_level(cells: Grid, some: Ints) -> bool:
    """Whether cells lie on a level surface; a dry field is never as level."""
    heights = cells.middle.ravel()[some]
    if len(some) < 100 or np.subtract(*np.percentile(heights, (90, 10))) > 0.06 * cells.metre:
        return False
    r, c = some // cells.lattice.cols, some % cells.lattice.cols
    design = np.column_stack([np.ones(len(some)), r - r.mean(), c - c.mean()])
    (_, south, east), *_ = np.linalg.lstsq(design, heights, rcond=None)
    return bool(math.hypot(south, east) / cells.lattice.cell < LEVEL_SLOPE)
