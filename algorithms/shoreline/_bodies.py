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
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from algorithms.shared.lowest import blocks, cells_of, lattice_around
from algorithms.shoreline import _kernels as kernels
from algorithms.shoreline._level import lowest_mode, mode
from algorithms.shoreline._returns import UNIT, Returns
from toolbox.context import QUIET, Context
from toolbox.data import Lattice

Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]
Floats = NDArray[np.floating[Any]]

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
LEVEL_SLOPE, LEVEL_SPREAD = 0.002, 0.06  # of a surface that is level, and m between its heights
LARGE = 500.0  # m2 of such a surface that need not be dark
TAKEN = 2
PEAKS = 12  # levels that are looked for in one calm place


@dataclass(frozen=True)
class Grid:
    """What is known of each cell; arrays of shape (rows, cols), lengths in the unit of the data.

    Attributes
    ----------
    lattice : the cells
    metre : length of one metre in the unit of the data
    base : height from which the others are counted
    low : lowest height, inf where there is no point
    count : number of points
    bright : mean intensity, NaN where there is no point
    water : number of points of a class of water
    middle : median of the lowest heights around, NaN where there is none
    spread : of these, from 20 to 80 %
    known : number of cells around that have points, of 25
    inside : whether the cell is surrounded by data
    density : points per square unit on land
    """

    lattice: Lattice
    metre: float
    base: float
    low: Floats
    count: NDArray[np.int32]
    bright: Floats
    water: NDArray[np.int32]
    middle: Floats
    spread: Floats
    known: NDArray[np.uint8]
    inside: Mask
    density: float

    @property
    def area(self) -> float:
        """Of a cell, square metres."""
        return (self.lattice.cell / self.metre) ** 2

    @property
    def hole(self) -> Mask:
        """Cells without points, but for single ones."""
        return np.asarray(self.inside & (self.count == 0) & (self.known < FILLED))

    @property
    def calm(self) -> Mask:
        """Cells around which heights are nearly the same."""
        calm = self.spread <= CALM * self.metre
        return np.asarray(self.inside & (self.known >= KNOWN) & calm)

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
    cells : array of shape (n,), indices into the raveled cells, rising
    level : a first estimate, in the unit of the data; of a river at its middle
    gradient : rise per cell southwards and eastwards
    lost : density of points on the water over that on its shore
    dark : separation of the intensities on water and shore, 0 to 1
    evidence : what speaks for water
    """

    cells: Ints
    level: float
    gradient: tuple[float, float]
    lost: float
    dark: float
    evidence: str


def grid(points: Returns, ctx: Context = QUIET) -> Grid:
    """Count points into cells whose size follows from their density."""
    metre = points.metre
    corners = points.origin + UNIT * np.array([f(points.packed, axis=0) for f in (np.min, np.max)])
    coarse = lattice_around(corners, COARSE * metre)
    counts = np.zeros(coarse.rows * coarse.cols, np.int64)
    for some in points.blocks():
        counts += np.bincount(cells_of(points.xyz(some), coarse), minlength=len(counts))
        ctx.progress(0.2 * some.stop / len(points))
    density = float(np.percentile(counts[counts > 0], 75)) / coarse.cell**2
    size = math.sqrt(PER_CELL / density) / metre
    lattice = lattice_around(corners, min(max(size, SMALLEST_CELL), LARGEST_CELL) * metre)
    low, bright = np.full(lattice.shape, np.inf, np.float32), np.zeros(lattice.shape, np.float32)
    count, water = np.zeros(lattice.shape, np.int32), np.zeros(lattice.shape, np.int32)
    base = float(corners[0, 2])
    for some in points.blocks():
        xyz = points.xyz(some)
        kernels.gather(
            cells_of(xyz, lattice), xyz[:, 2] - base, points.intensity[some], points.water[some],
            low.ravel(), count.ravel(), bright.ravel(), water.ravel(),
        )  # fmt: skip
        ctx.progress(0.2 + 0.5 * some.stop / len(points))
    middle, spread = np.full_like(low, np.nan), np.full_like(low, np.inf)
    known = np.zeros(lattice.shape, np.uint8)
    for first, last in blocks(lattice.rows, 25 * lattice.cols):
        kernels.surroundings(low, first, last, REACH, middle, spread, known)
        ctx.progress(0.7 + 0.3 * last / lattice.rows)
    with np.errstate(invalid="ignore"):
        bright /= count
    inside = enclosed(count > 0)
    return Grid(
        lattice, metre, base, low, count, bright, water, middle, spread, known, inside, density
    )


def enclosed(data: Mask) -> Mask:
    """Cells with data, and those that lie between data in their row or in their column."""
    inside = data.copy()
    for axis in (0, 1):
        before = np.logical_or.accumulate(data, axis=axis)
        after = np.flip(np.logical_or.accumulate(np.flip(data, axis), axis=axis), axis)
        inside |= before & after
    return inside


def find_bodies(cells: Grid, pour: Pour, ctx: Context = QUIET) -> list[Body]:
    """All water bodies, the largest first."""
    places = [*_holes(cells, pour.least), *_calm_places(cells, pour.least)]
    places.sort(key=lambda place: (-len(place[0]), place[0][0]))
    found: list[Body] = []
    for done, (starts, level) in enumerate(places):
        ctx.progress(0.9 * done / len(places))
        found += pour.at(starts, level)
    for starts in _patches(cells.calm & (pour.state != TAKEN), 4 * pour.least):
        ctx.progress(0.9)
        found += pour.down(starts)
    ctx.progress(1.0)
    return sorted(found, key=lambda body: (-len(body.cells), body.cells[0]))


class Pour:
    """Water poured on places of the cells.

    Parameters
    ----------
    cells : see :func:`grid`
    least_area : of a body, square metres

    Attributes
    ----------
    least : cells of a body
    state : array of shape (rows, cols), TAKEN where a body has been found
    """

    def __init__(self, cells: Grid, least_area: float) -> None:
        self.cells, self.floor = cells, cells.floor
        self.least = max(1, math.ceil(least_area / cells.area))
        self.state = np.zeros(self.floor.shape, np.uint8)
        self.stack = np.empty(self.floor.size, np.int32)

    def at(self, starts: Ints, level: float) -> list[Body]:
        """The body that holds water poured to a level on some cells, if there is one."""
        if (self.state.ravel()[starts] == TAKEN).mean() > 0.5:  # found from elsewhere
            return []
        body = self._held(self.floor, self.cells.middle, level, starts)
        return [] if body is None else self._take(judge(self.cells, body, level))

    def down(self, starts: Ints) -> list[Body]:
        """A river on some cells, whose surface is a plane."""
        cells = self.cells
        heights, south, east = _plane(cells, starts)
        trend = self._trend(south, east, starts)
        middle = cells.middle - trend
        rest = middle.ravel()[starts]
        fall = math.hypot(south, east) * math.sqrt(len(starts))
        straight = np.subtract(*np.percentile(rest, (90, 10))) <= CALM * cells.metre
        thin = cells.count.ravel()[starts].mean() <= SPARSE * cells.density * cells.lattice.cell**2
        if not (straight and thin and fall > STEP * cells.metre):
            return []
        body = self._held(self.floor - trend, middle, heights, starts)
        return [] if body is None else self._take(judge(cells, body, heights, (south, east)))

    def over_waves(self, body: Body, level: float, crest: float) -> Body:
        """The body with the cells that its waves reach, up to a crest above its level."""
        if crest <= STEP * self.cells.metre:
            return body
        floor = self.floor - self._trend(*body.gradient, body.cells)
        self.state.ravel()[body.cells] = 0
        size, _ = kernels.spread(
            floor, self.cells.middle, level - self.cells.base + crest, -np.inf, 0, body.cells,
            self.state, self.stack,
        )  # fmt: skip
        wider = np.sort(self.stack[:size]).astype(np.int64)
        self.state.ravel()[wider] = TAKEN
        return replace(body, cells=wider)

    def _held(self, floor: Floats, middle: Floats, level: float, starts: Ints) -> Ints | None:
        """Cells that water at a level covers, unless it runs off or they are too few."""
        metre = self.cells.metre
        most_lower = int(max(self.least / 2, RUN_OFF * len(starts)))
        size, lower = kernels.spread(
            floor, middle, level + STEP * metre, level - DROP * metre, most_lower, starts,
            self.state, self.stack,
        )  # fmt: skip
        body = np.sort(self.stack[:size]).astype(np.int64)
        self.state.ravel()[body] = 0
        return None if lower > most_lower or size < self.least else body

    def _take(self, body: Body | None) -> list[Body]:
        if body is None:
            return []
        self.state.ravel()[body.cells] = TAKEN
        return [body]

    def _trend(self, south: float, east: float, some: Ints) -> Floats:
        """Rise from the middle of some cells to all cells."""
        rows, cols = self.floor.shape
        r, c = np.arange(rows) - (some // cols).mean(), np.arange(cols) - (some % cols).mean()
        return np.asarray(south * r[:, None] + east * c, np.float32)


def _plane(cells: Grid, some: Ints) -> tuple[float, float, float]:
    """Height at the middle of some cells, and rise per cell southwards and eastwards."""
    r, c = some // cells.lattice.cols, some % cells.lattice.cols
    design = np.column_stack([np.ones(len(some)), r - r.mean(), c - c.mean()])
    heights = cells.middle.ravel()[some].astype(float)
    known = np.isfinite(heights)
    found, *_ = np.linalg.lstsq(design[known], heights[known], rcond=None)
    return float(found[0]), float(found[1]), float(found[2])


def _holes(cells: Grid, least: int) -> Iterator[tuple[Ints, float]]:
    """Holes in the data, with the level at their edge."""
    for hole in _patches(cells.hole, least):
        heights = cells.low.ravel()[_around(cells.lattice, hole, 1)]
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
    (top, left), mask = window(lattice, some, width)
    ring = ndimage.binary_dilation(mask, np.ones((3, 3), bool), iterations=width) & ~mask
    r, c = np.nonzero(ring)
    return (r + top) * lattice.cols + c + left


def window(lattice: Lattice, some: Ints, margin: int) -> tuple[tuple[int, int], Mask]:
    """First row and column, and mask, of the smallest window with a margin around some cells."""
    r, c = some // lattice.cols, some % lattice.cols
    top, left = max(0, r.min() - margin), max(0, c.min() - margin)
    bottom = min(lattice.rows, r.max() + margin + 1)
    right = min(lattice.cols, c.max() + margin + 1)
    mask = np.zeros((bottom - top, right - left), bool)
    mask[r - top, c - left] = True
    return (int(top), int(left)), mask


def judge(
    cells: Grid, body: Ints, level: float, gradient: tuple[float, float] = (0.0, 0.0)
) -> Body | None:
    """What speaks for water in a place that holds it; None where too little does.

    A place that swallows pulses is water. One that returns them must be level, and dark or large.
    """
    count, bright = cells.count.ravel(), cells.bright.ravel()
    ring = np.setdiff1d(_around(cells.lattice, body, 5), _around(cells.lattice, body, 1))
    ring = ring[count[ring] > 0]
    here = body[count[body] > 0]
    on_land = float(np.median(count[ring])) if len(ring) else 0.0
    lost = float(count[body].mean()) / on_land if on_land else 1.0
    dark = separation(bright[here], bright[ring])
    classed = cells.water.ravel()[body].sum() > 0.5 * count[body].sum()
    level_enough = gradient == (0.0, 0.0) and _is_level(cells, here)
    reasons = {
        "few returns": lost <= SPARSE,
        "level": level_enough,
        "dark": dark >= DARK,
        "class": classed,
    }
    large = len(here) >= LARGE / cells.area
    if not (lost <= SPARSE or classed or (level_enough and (dark >= DARK or large))):
        return None
    evidence = ", ".join(name for name, holds in reasons.items() if holds)
    return Body(body, cells.base + level, gradient, lost, dark, evidence)


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
    if len(some) < 10:
        return False
    heights = cells.middle.ravel()[some]
    low, middle, high = np.percentile(heights, (10, 50, 90))
    if high - low > LEVEL_SPREAD * cells.metre:
        return False
    inner = abs(heights - middle) <= LEVEL_SPREAD * cells.metre / 2  # without banks
    _, south, east = _plane(cells, some[inner])
    return math.hypot(south, east) / cells.lattice.cell < LEVEL_SLOPE
