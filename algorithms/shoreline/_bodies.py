"""Water bodies from cells: areas that look like water are filled up to their levels.

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
from typing import Any, NamedTuple

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
WAVY = 0.3  # and on water with waves of 0.15 (standard deviation of points)
KNOWN = 5  # cells of 25 with points, to compare their heights
FILLED = 13  # cells of 25 with points, around a single empty one that is no hole
CREST = 3.0  # standard deviations of points on the water above its level
STEP = 0.10  # above the level where a first look at a body ends
DROP = 0.25  # below the level: water does not stay above such ground
RUN_OFF = 0.02  # share of a body that may seem to lie lower
SPARSE = 0.5  # of the density of the shore: pulses were lost
DARK = 0.5  # separation of intensities on water and on the shore, 0 for none, 1 for a full one
LEVEL_SPREAD = 0.06  # m between the heights of a surface that is level
MEDIAN = 1.91  # 10-90 % range of medians over the 20-80 % range of n heights, times root n
CORE = 0.3  # of the distance to the middle of a body, from where its level is taken
SECTOR = 4  # cells of the edge of a hole of which the lowest point counts
FEWEST_SECTORS = 6
START = 4  # starting cells may be this many times fewer than those of a body
WIDE = 0.2  # of its cells are not at the edge of a hole that nothing else speaks for
RIVER = 4  # smallest river, in smallest bodies
TILTED = 0.6  # share of the variance of these points that a plane explains, on a slope
LARGE = 500.0  # m2 of such a surface that need not be dark
VERY_DARK = 0.75  # and of one that returns its pulses
TAKEN = 2
PEAKS = 12  # levels that are looked for in one calm area


@dataclass(frozen=True)
class CellGrid:
    """Statistics of the points in each cell, arrays of shape (rows, cols), in the data's unit.

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
        """Area of a cell."""
        return self.lattice.cell**2

    @property
    def hole(self) -> Mask:
        """True for cells without points, unless single ones among cells with points."""
        return np.asarray(self.inside & (self.count == 0) & (self.known < FILLED))

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


class Tilt(NamedTuple):
    """A plane through height 0 at a row and a column, with its rise per cell."""

    south: float = 0.0
    east: float = 0.0
    row: float = 0.0
    col: float = 0.0

    def at(self, row: Any, col: Any) -> Floats:
        """Heights of the plane at rows and columns."""
        return np.asarray(self.south * (row - self.row) + self.east * (col - self.col))


LEVEL = Tilt()


@dataclass(frozen=True)
class Body:
    """A water body as a set of cells, with the evidence for it.

    Attributes
    ----------
    cells : array of shape (n,), indices into the raveled cells, rising
    level : a first estimate, in the unit of the data, to be added to the tilt
    tilt : of a river
    lost : density of points on the water over that on its shore
    dark : separation of the intensities on water and shore, 0 to 1
    evidence : what speaks for water
    waves : height above the level up to which a cell is on open water, rather than on a bank
    """

    cells: Ints
    level: float
    tilt: Tilt
    lost: float
    dark: float
    evidence: str
    waves: float = math.inf

    def rough(self, metre: float) -> bool:
        """Whether waves are known to be higher than islands and banks may be."""
        return STEP * metre < self.waves < math.inf


def grid(points: Returns, ctx: Context = QUIET) -> CellGrid:
    """Statistics of points in cells, whose size follows from the density of the points."""
    metre = points.metre
    corners = points.origin + UNIT * np.array([f(points.packed, axis=0) for f in (np.min, np.max)])
    coarse = lattice_around(corners, COARSE * metre, count=len(points))
    counts = np.zeros(coarse.rows * coarse.cols, np.int64)
    for some in points.blocks():
        counts += np.bincount(cells_of(points.xyz(some), coarse), minlength=len(counts))
        ctx.progress(0.2 * some.stop / len(points))
    density = float(np.percentile(counts[counts > 0], 75)) / coarse.cell**2
    size = math.sqrt(PER_CELL / density) / metre
    size = min(max(size, SMALLEST_CELL), LARGEST_CELL)
    lattice = lattice_around(corners, size * metre, count=len(points))
    low, bright = np.full(lattice.shape, np.inf, np.float32), np.zeros(lattice.shape, np.float32)
    count, water = np.zeros(lattice.shape, np.int32), np.zeros(lattice.shape, np.int32)
    base = float(corners[0, 2])
    for some in points.blocks():
        xyz = points.xyz(some)
        kernels.gather(
            cells_of(xyz, lattice),
            xyz[:, 2] - base,
            points.intensity[some],
            points.water[some],
            low.ravel(),
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
    inside = enclosed(count > 0)
    return CellGrid(
        lattice, metre, base, low, count, bright, water, middle, spread, known, inside, density
    )


def enclosed(data: Mask) -> Mask:
    """True for cells with data, and for cells between data in their row or column."""
    inside = data.copy()
    for axis in (0, 1):
        before = np.logical_or.accumulate(data, axis=axis)
        after = np.flip(np.logical_or.accumulate(np.flip(data, axis), axis=axis), axis)
        inside |= before & after
    return inside


Pool = tuple[Ints, float, Tilt]  # cells to pour on, up to a level on a tilted plane


def find_bodies(cells: CellGrid, pour: Pour, ctx: Context = QUIET) -> list[Body]:
    """All water bodies, the largest first."""
    classed = 2 * cells.water > np.maximum(cells.count, 1)
    places = [
        *_holes(cells, pour.first),
        *_level_places(cells, cells.calm(), pour.first),
        *_level_places(cells, classed, pour.first),
    ]
    places.sort(key=lambda place: (place[2] != LEVEL, -len(place[0]), place[0][0]))
    found: list[Body] = []
    for done, place in enumerate(places):
        ctx.progress(0.9 * done / len(places))
        found += pour.on(*place)
    for place in _level_places(cells, cells.calm(WAVY) & (pour.state != TAKEN), pour.first):
        ctx.progress(0.9)
        found += pour.on(*place, rough=True)
    for place in _slopes(cells, cells.calm() & (pour.state != TAKEN), RIVER * pour.least):
        ctx.progress(0.9)
        found += pour.on(*place)
    ctx.progress(1.0)
    return sorted(found, key=lambda body: (-len(body.cells), body.cells[0]))


class Pour:
    """Simulation of water that is poured on cells and spreads at its level.

    Parameters
    ----------
    cells : see :func:`grid`
    least_area : of a body, in square units of the data

    Attributes
    ----------
    least : cells of a body
    first : fewest cells to begin with
    state : array of shape (rows, cols), TAKEN where a body has been found
    refused : the largest area that was no water: its cells and the reason
    """

    def __init__(self, cells: CellGrid, least_area: float) -> None:
        self.cells, self.floor = cells, cells.floor
        self.least = max(1, math.ceil(least_area / cells.area))
        self.first = math.ceil(self.least / START)
        self.state = np.zeros(self.floor.shape, np.uint8)
        self.stack = np.empty(self.floor.size, np.int32)
        self.refused: tuple[Ints, str] = (np.zeros(0, np.int64), "")

    def on(self, starts: Ints, level: float, tilt: Tilt, *, rough: bool = False) -> list[Body]:
        """The body that holds water poured on some cells up to a level; empty if it runs off.

        Rough water is known by being dark: meadows are level, and woods return few pulses, too.
        """
        if (self.state.ravel()[starts] == TAKEN).mean() > 0.5:  # found from elsewhere
            return []
        metre = self.cells.metre
        most_lower = int(max(self.least / 2, RUN_OFF * len(starts)))
        body, lower = self._spread(
            starts, level + STEP * metre, level - DROP * metre, most_lower, tilt
        )
        if lower > most_lower:
            return self._refuse(body, f"water would run off to ground {DROP:g} m lower")
        if len(body) < self.least:
            return self._refuse(body, "too small")
        judged = judge(self.cells, body, level, tilt, rough=rough)
        if judged is None:
            return self._refuse(body, "neither few returns, nor level and dark or large")
        self.state.ravel()[body] = TAKEN
        return [judged]

    def _refuse(self, body: Ints, reason: str) -> list[Body]:
        if len(body) > len(self.refused[0]):
            self.refused = body, reason
        return []

    def again(self, body: Body, level: float, sigma: float, tilt: Tilt) -> Body:
        """The body extended to all cells that its waves reach, up to a crest above its level."""
        step = STEP * self.cells.metre
        top = level - self.cells.base + max(CREST * sigma, step)
        wider, _ = self._spread(body.cells, top, -np.inf, 0, tilt)
        self.state.ravel()[wider] = TAKEN
        return replace(body, cells=wider, level=level, tilt=tilt, waves=max(sigma, step))

    def _spread(
        self, starts: Ints, level: float, below: float, most_lower: int, tilt: Tilt
    ) -> tuple[Ints, int]:
        """Cells that water at a level covers, and how many of them lie clearly below it."""
        floor, middle = self.floor, self.cells.middle
        if tilt != LEVEL:
            rows, cols = floor.shape
            trend = tilt.at(np.arange(rows)[:, None], np.arange(cols)).astype(np.float32)
            floor, middle = floor - trend, middle - trend
        size, lower = kernels.spread(
            floor, middle, level, below, most_lower, starts, self.state, self.stack
        )
        body = np.sort(self.stack[:size]).astype(np.int64)
        self.state.ravel()[body] = 0
        return body, lower


def _fit(cells: CellGrid, some: Ints, heights: Floats) -> tuple[float, Tilt]:
    """Level and tilt of the least-squares plane through heights at cells."""
    r, c = some // cells.lattice.cols, some % cells.lattice.cols
    row, col = float(r.mean()), float(c.mean())
    design = np.column_stack([np.ones(len(some)), r - row, c - col])
    (level, south, east), *_ = np.linalg.lstsq(design, heights.astype(float), rcond=None)
    return float(level), Tilt(float(south), float(east), row, col)


def _holes(cells: CellGrid, least: int) -> Iterator[Pool]:
    """Holes in the data as starting cells, with the level at their edges.

    The edge of a lake is at one level, that of a shadow or of a gap between strips follows the
    terrain, and so does that of a river.
    """
    for hole in _patches(cells.hole, least):
        edge = around(cells.lattice, hole, 1)
        heights = cells.low.ravel()[edge]
        edge, heights = edge[np.isfinite(heights)], heights[np.isfinite(heights)]
        if not len(heights):
            continue
        level = lowest_mode(heights, STEP * cells.metre)
        tilt = _tilt_of(cells, edge[heights >= level - STEP * cells.metre])
        if tilt == LEVEL:
            yield hole, level, LEVEL
        elif len(hole) >= START * RIVER * least:
            rest = heights - tilt.at(edge // cells.lattice.cols, edge % cells.lattice.cols)
            yield hole, lowest_mode(rest, STEP * cells.metre), tilt


def _tilt_of(cells: CellGrid, edge: Ints) -> Tilt:
    """Tilt of the plane through the lowest points along an edge; LEVEL if they lie on none."""
    r, c = edge // cells.lattice.cols, edge % cells.lattice.cols
    order = np.lexsort((cells.low.ravel()[edge], c // SECTOR, r // SECTOR))
    sector = np.stack([r // SECTOR, c // SECTOR])[:, order]
    first = np.ones(len(edge), bool)
    first[1:] = (np.diff(sector, axis=1) != 0).any(axis=0)
    lows, tilt = edge[order][first], LEVEL
    for _ in range(3):  # walls and trees here and there are no slope
        if len(lows) < FEWEST_SECTORS:
            return LEVEL
        heights = cells.low.ravel()[lows]
        level, tilt = _fit(cells, lows, heights)
        trend = tilt.at(lows // cells.lattice.cols, lows % cells.lattice.cols)
        off = abs(heights - level - trend)
        explained = trend.var() / max(heights.var(), 1e-12)
        lows = lows[off <= max(2.5 * float(np.median(off)), 0.01 * cells.metre)]
    is_slope = np.ptp(trend) > CALM * cells.metre and explained > TILTED
    return tilt if is_slope else LEVEL


def _slopes(cells: CellGrid, where: Mask, least: int) -> Iterator[Pool]:
    """Calm tilted areas with few returns, which may be rivers, with their levels and tilts."""
    on_land = cells.density * cells.lattice.cell**2
    for place in _patches(where, least):
        heights = cells.middle.ravel()[place]
        level, tilt = _fit(cells, place, heights)
        trend = tilt.at(place // cells.lattice.cols, place % cells.lattice.cols)
        low, high = np.percentile(heights - trend, (10, 90))
        thin = cells.count.ravel()[place].mean() <= SPARSE * on_land
        if thin and high - low <= CALM * cells.metre < np.ptp(trend):
            yield place, level, tilt


def _level_places(cells: CellGrid, where: Mask, least: int) -> Iterator[Pool]:
    """Cells at one level each, from patches that are calm or of a class of water."""
    step = STEP * cells.metre
    for place in _patches(where, least):
        rest = place
        for _ in range(PEAKS):
            if len(rest) < least:
                break
            heights = cells.middle.ravel()[rest]
            level = mode(heights, step / 2)
            at = abs(heights - level) <= step
            if at.sum() >= least:
                yield rest[at], level, LEVEL
            rest = rest[~at]


def _patches(mask: Mask, least: int) -> Iterator[Ints]:
    """Indices of the cells of each connected patch of at least `least` cells."""
    labels, _ = ndimage.label(mask)
    sizes = np.bincount(labels.ravel())
    order = np.argsort(labels.ravel(), kind="stable")
    ends = np.cumsum(sizes)
    for label in np.flatnonzero(sizes >= least):
        if label:
            yield order[ends[label] - sizes[label] : ends[label]]


def around(lattice: Lattice, some: Ints, width: int) -> Ints:
    """Indices of the cells within a number of cells of some, without these."""
    (top, left), mask = window(lattice, some, width)
    ring = ndimage.binary_dilation(mask, np.ones((3, 3), bool), iterations=width) & ~mask
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


def judge(
    cells: CellGrid, body: Ints, level: float, tilt: Tilt = LEVEL, *, rough: bool = False
) -> Body | None:
    """The body with the evidence that it is water; None if that is too weak.

    An area that returns no pulses is water, unless it is narrow as shadows are. One that returns
    them must be level, and very dark or large. A rough one must be dark in any case.
    """
    count, bright = cells.count.ravel(), cells.bright.ravel()
    ring = np.setdiff1d(around(cells.lattice, body, 5), around(cells.lattice, body, 1))
    ring = ring[count[ring] > 0]
    here = body[count[body] > 0]
    on_land = float(np.median(count[ring])) if len(ring) else 0.0
    lost = float(count[body].mean()) / on_land if on_land else 1.0
    dark = separation(bright[here], bright[ring])
    classed = cells.water.ravel()[body].sum() > 0.5 * count[body].sum()
    level_enough = tilt == LEVEL and _is_level(cells, body)
    reasons = {
        "few returns": lost <= SPARSE,
        "level": level_enough,
        "dark": dark >= DARK,
        "class": classed,
    }
    wide = len(core_of(cells, body, 0.0)) >= WIDE * len(body)
    few = lost <= SPARSE and (wide or dark >= DARK or level_enough)
    large = len(here) >= LARGE * cells.metre**2 / cells.area
    if not (few or classed or (level_enough and (dark >= VERY_DARK or large))):
        return None
    if rough and dark < DARK:
        return None
    evidence = ", ".join(name for name, holds in reasons.items() if holds)
    return Body(body, cells.base + level, tilt, lost, dark, evidence)


def separation(water: Floats, land: Floats) -> float:
    """Largest difference of the distribution functions of two samples, where water is darker."""
    if not (len(water) and len(land)):
        return 0.0
    water, land = np.sort(water), np.sort(land)
    at = np.concatenate([water, land])
    below = [np.searchsorted(some, at, side="right") / len(some) for some in (water, land)]
    return max(0.0, float((below[0] - below[1]).max()))


def _is_level(cells: CellGrid, some: Ints) -> bool:
    """Whether cells lie on one level surface, more exactly than fields do.

    The medians of waves differ, too, by what the heights around them and their number make likely.
    """
    core = core_of(cells, some)
    core = core[np.isfinite(cells.middle.ravel()[core])]
    if len(core) < KNOWN:
        return False
    middle, off = cells.middle.ravel()[core], (cells.low - cells.middle).ravel()[core]
    low, high = np.percentile(middle, (10, 90))
    spread = np.ptp(np.percentile(off[np.isfinite(off)], (20, 80))) if np.isfinite(off).any() else 0
    waves = MEDIAN * float(spread / np.sqrt(np.median(cells.known.ravel()[core])))
    _, tilt = _fit(cells, core, middle)
    fall = math.hypot(tilt.south, tilt.east) * math.sqrt(len(core))
    limit = LEVEL_SPREAD * cells.metre
    return bool(fall <= limit and high - low <= math.hypot(limit, waves))


def open_water(
    cells: CellGrid, body: Body, share: float = CORE, *, crests: bool = True, bright: bool = False
) -> Ints:
    """Indices of the cells that tell the level of a body: far from banks and islands.

    The crests of waves reach up banks, which are no part of it. But single cells among lower ones
    are crests themselves: they belong to it, so that no height is left out for being high.

    Parameters
    ----------
    cells, body : see :class:`Body`
    share : of the way from the edge to the middle that is left out, a cell at least
    crests : whether single cells among lower ones belong to it
    bright : whether cells as bright as land belong to it, where others are rough and very dark
    """
    some = body.cells
    if not bright and body.rough(cells.metre) and body.dark >= VERY_DARK:
        some = some[~_as_bright_as_land(cells, body)]
    low = cells.low.ravel()[some]
    r, c = some // cells.lattice.cols, some % cells.lattice.cols
    top = body.level - cells.base + body.waves + body.tilt.at(r, c)
    calm = some[(low <= top) | np.isinf(low)]
    if not len(calm):
        return calm
    if math.isinf(body.waves):  # how high they are is not known yet
        return core_of(cells, calm, share)
    return core_of(cells, calm, share, some if crests else calm)


def _as_bright_as_land(cells: CellGrid, body: Body) -> Mask:
    """Which cells of a body are nearer to the brightness of its shore than to its own.

    They are islands and banks among waves of their height, told apart without looking at heights.
    The limit is the geometric mean, since intensities scatter by a share of themselves.
    """
    bright = cells.bright.ravel()
    here = bright[body.cells]
    ring = np.setdiff1d(around(cells.lattice, body.cells, 5), around(cells.lattice, body.cells, 1))
    water, land = here[~np.isnan(here)], bright[ring][~np.isnan(bright[ring])]
    if not len(land):
        return np.zeros(len(here), bool)
    return np.asarray(here > math.sqrt(float(np.median(water)) * float(np.median(land))))


def core_of(cells: CellGrid, some: Ints, share: float = CORE, among: Ints | None = None) -> Ints:
    """Indices of the cells far from the edge of some, where flat banks may count as water.

    Parameters
    ----------
    cells : see :class:`CellGrid`
    some : cells; gaps between them of a cell or two are filled
    share : of the way from the edge to the middle that is left out, a cell at least
    among : cells that may be filled; all by default
    """
    (top, left), mask = window(cells.lattice, some, 1)
    wet = mask | ndimage.binary_closing(mask, np.ones((3, 3), bool))
    if among is not None:
        r, c = among // cells.lattice.cols - top, among % cells.lattice.cols - left
        here = (r >= 0) & (r < mask.shape[0]) & (c >= 0) & (c < mask.shape[1])
        allowed = np.zeros_like(mask)
        allowed[r[here], c[here]] = True
        wet &= allowed
    depth = ndimage.distance_transform_edt(wet)
    r, c = np.nonzero((depth > 1) & (depth >= share * depth.max()))
    return np.asarray((r + top) * cells.lattice.cols + c + left)
