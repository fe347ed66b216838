"""Water bodies from cells: areas that look like water are filled up to their levels.

Near-infrared light is absorbed by water or mirrored away from it, so a lake is a hole in the data,
or flat and dark with few returns. But shadows behind buildings and gaps between strips are holes
too, and roads and sports grounds are flat and dark. What tells water from them is that it stays
where it is: everything around a water body is higher than its level. So water is poured on every
hole and every calm place up to the level found there, and what runs off was no water.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.special import fdtrc

from algorithms.shared.lowest import blocks, cells_of, lattice_around
from algorithms.shared.otsu import otsu_threshold
from algorithms.shared.water_surface import WIDEST
from algorithms.shared.windows import between
from algorithms.shoreline import _kernels as kernels
from algorithms.shoreline._kernels import TAKEN
from algorithms.shoreline._level import (
    BLOCKS,
    FINE,
    Level,
    even_blocks,
    lowest_mode,
    mode,
    two_levels_fit,
)
from algorithms.shoreline._returns import UNIT, Returns
from toolbox.context import QUIET, Context
from toolbox.data import Lattice
from toolbox.data.crs import Unit, unit_of

Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]
Floats = NDArray[np.floating[Any]]
Doubles = NDArray[np.float64]

# Lengths in metres, from the noise of airborne points (0.02 to 0.05) and the waves of small waters.
COARSE = 4.0  # cells on which the density is counted, unless they hold too few points
PER_CELL = 4.0  # points in a cell of land
SMALLEST_CELL = 0.5
SURE_CELLS = 12  # of a body: fewer hold few points by chance; 100 m2 are as many at 0.5 per m2
REACH = 2  # cells on each side whose heights are compared
CALM = 0.12  # spread of their heights on water
WAVY = 0.3  # and on water with waves of 0.15 (standard deviation of points)
KNOWN = 5  # cells of 25 with points, to compare their heights
FILLED = 13  # cells of 25 with points, around a single empty one that is no hole
CREST = 3.0  # standard deviations of points on the water above its level
STEP = 0.10  # above the level where a first look at a body ends
DROP = 0.25  # below the level: water does not stay above such ground
WEIR = 1.0  # m from water to lower water beside it, at a weir or rapids
RUN_OFF = 0.02  # share of a body that may seem to lie lower
BLOCK = 4  # cells, with 64 points of land: flights that cover them have some there
SPARSE = 0.5  # of the density of the shore: pulses were lost
FEWER = 0.75  # half of the way to it: enough for what is level and of no shape, as water is
DARK = 0.5  # separation of intensities on water and on the shore, 0 for none, 1 for a full one
LEVEL_SPREAD = 0.06  # m between the heights of a surface that is level
SIGMAS = 1.683  # standard deviations of a normal distribution between its 20 % and its 80 %
BENT = 0.02  # m between places of a dark surface that is none of water: strips fit to so much
SHAPE = 6  # terms of a quadratic surface
CHANCE = 0.001  # that noise has a shape so clear: of flat waters that are very dark one in 1000
STEEPEST = 0.03  # slope of a river: of steeper streams no plane is the surface
PAVED = 0.005  # slope: half of what drains paved ground at least; calm rivers fall by less
PIECES = 4  # of a river, along it, of which each has a shape across
FOR_SHAPE = 20  # cells that tell that shape
ENDS = 0.1, 0.9  # share of a river that is its end
LONG = 2.0  # length of a place that falls as a river may, in widths
CORE = 0.3  # of the distance to the middle of a body, from where its level is taken
SECTOR = 4  # cells of the edge of a hole of which the lowest point counts
FEWEST_SECTORS = 6
RIM = 3.0  # m from a shore, to where a bank reaches but no parapet
WALL = 1.0  # m that a wall is high
BANK = 20.0  # m from a shore, to where it rises by what water does not run over
BANKS = 0.75  # of the rim of a water: rivers go on beyond the data, and at rapids
GROWN = 10  # times its cells: nine tenths of a body that grew so were not looked at
START = 4  # starting cells may be this many times fewer than those of a body
WIDE = 0.2  # of its cells are not at the edge of a hole that nothing else speaks for
WITHOUT_WAVES = 0.12  # of the root of the cells of a body, over which heights are averaged
COMPACT = 0.8  # of the cells of a part at one level are in one piece
CONTACT = 0.5  # of the root of the cells of a body: so wide it meets another that it is part of
RIVER = 4  # smallest river, in smallest bodies
TILTED = 0.6  # share of the variance of these points that a plane explains, on a slope
FEW = "few returns"  # evidence that thin points on land give, too
LEVEL_ALONE = "level"  # evidence that is not enough, unless it is the level of other water
LARGE = 500.0  # m2 of such a surface that need not be dark
VERY_DARK = 0.75  # and of one that returns its pulses
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
    amid : separation of the intensities if other water beside it counts as shore, as `dark` else
    """

    cells: Ints
    level: float
    tilt: Tilt
    lost: float
    dark: float
    evidence: str
    waves: float = math.inf
    amid: float = 0.0

    @property
    def few(self) -> bool:
        """Whether it returns few pulses, which banks and roads do not."""
        return self.lost <= SPARSE

    @property
    def holds(self) -> bool:
        """Whether it may stand above other water beside it, as behind a sluice or a weir.

        A bank of that water returns its pulses, and is hardly darker than land and water around.
        """
        return self.few or self.amid >= VERY_DARK

    @property
    def doubtful(self) -> bool:
        """Whether its level is all that speaks for it: squares and cuttings are level, too."""
        return self.evidence == LEVEL_ALONE

    def rough(self, metre: float) -> bool:
        """Whether waves are known to be higher than islands and banks may be."""
        return STEP * metre < self.waves < math.inf


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
        seen.flights(),
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

    def flights(self) -> NDArray[np.uint16]:
        """How many flights cover each cell: what lies amid points of one is covered, too."""
        amid = (one | (between(one, 0) & between(one, 1)) for one in self.blocks)
        count = np.maximum(sum(one.astype(np.uint16) for one in amid), 1).astype(np.uint16)
        rows, cols = self.lattice.shape
        return np.asarray(count.repeat(BLOCK, 0).repeat(BLOCK, 1)[:rows, :cols])


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


Pool = tuple[Ints, float, Tilt]  # cells to pour on, up to a level on a tilted plane


def find_bodies(cells: CellGrid, pour: Pour, ctx: Context = QUIET) -> list[Body]:
    """All water bodies, the largest first."""
    holes = list(_holes(cells, pour.first))
    found: list[Body] = []
    places = _places(cells, holes, pour.first)
    for done, place in enumerate(places):
        ctx.progress(0.9 * done / len(places))
        found += pour.on(*place)
    for hole in holes:  # of fields on terraces the bund above is higher than that below
        if hole.tilt != LEVEL:
            found += pour.on(hole.cells, hole.level, LEVEL)
    for place in _level_places(cells, cells.calm(WAVY) & (pour.state != TAKEN), pour.first):
        ctx.progress(0.9)
        found += pour.on(*place, rough=True)
    for spread in (CALM, WAVY):
        calm = cells.calm(spread) & (pour.state != TAKEN)
        for place in _slopes(cells, calm, spread, RIVER * pour.least):
            ctx.progress(0.9)
            found += pour.on(*place, rough=spread > CALM)
    found += pour.beside_water()
    found += pour.doubted()
    ctx.progress(1.0)
    return sorted(joined(cells, found), key=lambda body: (-len(body.cells), body.cells[0]))


def _places(cells: CellGrid, holes: Sequence[Hole], least: int) -> list[Pool]:
    """Holes, then level places that are calm or of a class of water, the largest of each first.

    Holes come first: a few cells at the lower end of a river would fill it to their level. Those on
    hillsides come last, as they are no water that others may be part of.
    """
    classed = 2 * cells.water > np.maximum(cells.count, 1)
    level = [
        place for where in (cells.calm(), classed) for place in _level_places(cells, where, least)
    ]
    pools = sorted(_pools(cells, holes, least), key=_by_size)
    steep = [pool for pool in pools if pool[2].steep(cells.lattice.cell)]
    others = [pool for pool in pools if not pool[2].steep(cells.lattice.cell)]
    return others + sorted(level, key=_by_size) + steep


def _by_size(place: Pool) -> tuple[int, int]:
    return -len(place[0]), int(place[0][0])


class _Later(NamedTuple):
    """A place that is looked at again when other water is known.

    Attributes
    ----------
    place : where water is poured
    rough : see :meth:`Pour.on`
    doubtful : whether its level speaks for it
    body : its cells
    shore : number of cells that it was compared with
    """

    place: Pool
    rough: bool
    doubtful: bool
    body: Ints
    shore: int


class Pour:
    """Simulation of water that is poured on cells and spreads at its level.

    Parameters
    ----------
    cells : see :func:`grid`
    least_area : of a body, in square units of the data

    Attributes
    ----------
    least : cells of the least area
    fewest : cells of a body
    first : fewest cells to begin with
    state : array of shape (rows, cols), TAKEN where a body has been found
    lowest : array of shape (rows, cols), to where water runs off: the median of the lowest heights
        around, amid holes that at their edge
    middle : the same, but in bodies their level
    later : places that are known by their level alone, or too little, as far as their shores tell
    ran_off : places as level and large as water may be, from which water would run off
    refused : the largest area that was no water: its cells and the reason
    reasons : why the last place that begins with a cell is no water, by that cell
    """

    def __init__(self, cells: CellGrid, least_area: float) -> None:
        self.cells, self.floor, self.rim = cells, cells.floor, cells.rim
        self.least = max(1, math.ceil(least_area / cells.area))
        self.fewest = max(self.least, SURE_CELLS)
        self.first = math.ceil(self.least / START)
        self.lowest = _below(cells, self.first)
        self.empty()
        self.stack = np.empty(self.floor.size, np.int32)
        self.later: list[_Later] = []
        self.ran_off: list[Body] = []
        self.refused: tuple[Ints, str] = (np.zeros(0, np.int64), "")
        self.reasons: dict[int, str] = {}

    def empty(self) -> None:
        """Forget what has been found."""
        self.state = np.zeros(self.floor.shape, np.uint8)
        self.middle = self.lowest.copy()

    def on(
        self, starts: Ints, level: float, tilt: Tilt, *, rough: bool = False, last: bool = False
    ) -> list[Body]:
        """The body that holds water poured on some cells up to a level; empty if it runs off.

        Rough water is known by being dark: meadows are level, and woods return few pulses, too.
        What holds behind dikes alone, and is seen, must be level or dark, too: hedges and grass
        around thin points look like dikes. What is known by its level alone has to wait until the
        last: it may be a square by a lake.
        """
        if (self.state.ravel()[starts] == TAKEN).mean() > 0.5:  # found from elsewhere
            return []
        metre = self.cells.metre
        most_lower = int(max(self.least / 2, RUN_OFF * len(starts)))
        body, lower = self._spread(
            starts, level + STEP * metre, level - DROP * metre, most_lower, tilt
        )
        dikes = lower > most_lower and tilt == LEVEL and not rough
        if dikes:
            body, lower = self._behind_dikes(starts, level, most_lower)
        if lower > most_lower:
            self._note(starts, level, tilt)
            return self._refuse(starts, body, f"water would run off to ground {DROP:g} m lower")
        if len(body) < self.fewest:
            return self._refuse(starts, body, "too small")
        whole = shore_of(self.cells, body)
        shore = self._on_land(whole)
        judged, why = judge(self.cells, body, level, tilt, shore, whole, rough=rough)
        if judged and not judged.holds and (dikes or self._above_water(body, level) > most_lower):
            self._note(starts, level, tilt)
            judged, why = None, f"it is a bank of water {DROP:g} m lower"
        if judged and dikes and judged.evidence == FEW and self._is_seen(body):
            judged, why = None, "water would run off, unless over dikes, and it is not level"
        if not last and (judged is None or judged.doubtful):
            doubtful = judged is not None
            self.later.append(_Later((starts, level, tilt), rough, doubtful, body, len(shore)))
        if judged is None:
            return self._refuse(starts, body, why)
        if judged.doubtful and not last:
            return []
        self._take(body, level, tilt)
        return [judged]

    def _shore(self, body: Ints) -> Ints:
        """Cells with points near a body that are no water found: what it is compared with."""
        return self._on_land(shore_of(self.cells, body))

    def _on_land(self, shore: Ints) -> Ints:
        """Cells of a shore but for water that was found."""
        return np.asarray(shore[self.state.ravel()[shore] != TAKEN])

    def _is_seen(self, body: Ints) -> bool:
        """Whether most cells of a body have points, which tell whether it is level or dark."""
        return bool((self.cells.count.ravel()[body] > 0).mean() > 0.5)

    def _note(self, starts: Ints, level: float, tilt: Tilt) -> None:
        """Keep a place that water runs off from, if it is large and nearly all of it is level."""
        if tilt != LEVEL:
            return
        large = LARGE * self.cells.metre**2 / self.cells.area
        for whole in connected(self.cells.lattice, starts, large):
            shore = shore_of(self.cells, whole)
            judged, _ = judge(self.cells, whole, level, LEVEL, self._on_land(shore), shore)
            if judged and "level" in judged.evidence:
                self.ran_off.append(judged)

    def beside_water(self) -> list[Body]:
        """Bodies whose shore told too little, as it is other water that was found after them.

        Fields and ponds between dikes have more water than land around them.
        """
        found: list[Body] = []
        while True:
            waiting, before = self._waiting(), len(found)
            self.later = []
            for one in waiting:
                if len(self._shore(one.body)) < one.shore:
                    found += self.on(*one.place, rough=one.rough)
                else:
                    self.later.append(one)
            if len(found) == before:
                return found

    def doubted(self) -> list[Body]:
        """Bodies that are known by their level alone, beside all others."""
        places = [one.place for one in self._waiting() if one.doubtful]
        return [body for place in places for body in self.on(*place, last=True)]

    def _waiting(self) -> list[_Later]:
        """The places to be looked at again, the largest first."""
        return sorted(self.later, key=lambda one: _by_size(one.place))

    def _above_water(self, body: Ints, level: float) -> int:
        """Number of cells of lower water beside a body."""
        beside = around(self.cells.lattice, body, 1)
        beside = beside[self.state.ravel()[beside] == TAKEN]
        return int((self.middle.ravel()[beside] < level - DROP * self.cells.metre).sum())

    def _take(self, body: Ints, level: float, tilt: Tilt) -> None:
        cols = self.cells.lattice.cols
        self.state.ravel()[body] = TAKEN
        self.middle.ravel()[body] = level + tilt.at(body // cols, body % cols)

    def _refuse(self, starts: Ints, body: Ints, reason: str) -> list[Body]:
        self.reasons[int(starts[0])] = reason
        if len(body) > len(self.refused[0]):
            self.refused = body, reason
        return []

    def no_water(self, wet: Mask) -> list[tuple[Ints, str]]:
        """Holes as large as bodies that are no water, each with the reason, the largest first.

        Data lie around them: of those at the edge of the data no shore is known, and narrow ones
        are gaps between strips and shadows.

        Parameters
        ----------
        wet : array of shape (rows, cols), True in all water that was found
        """
        holes = [
            (hole, self.reasons[int(hole[0])])
            for hole in patches(self.cells.hole, self.fewest)
            if int(hole[0]) in self.reasons
            and not wet.ravel()[hole].any()
            and not self.rim.ravel()[hole].any()
            and _is_wide(self.cells, hole)
        ]
        return sorted(holes, key=lambda one: (-len(one[0]), one[0][0]))

    def again(self, body: Body, level: Level, tilt: Tilt) -> list[Body]:
        """The body extended to all cells that its waves reach, up to a crest above its level.

        Where these would run off, as over a low dam, it is extended by less, and by the crests that
        it encloses: a level without them is too low. Where it would still run off, to other water,
        there is none, unless it may stand above that and its level is nearly what it was: then it
        stays as it is, since cells are wider than the wall between.
        """
        step, sigma = STEP * self.cells.metre, level.sigma
        height, top = level.height - self.cells.base, level.highest - self.cells.base
        below = height - DROP * self.cells.metre - CREST * sigma
        cells, lower = body.cells, 0
        for crest in (max(CREST * sigma, step), step):
            most = int(max(self.least / 2, RUN_OFF * len(body.cells)))
            cells, lower = self._spread(body.cells, top + crest, below, most, tilt)
            if lower <= most:
                break
        else:
            if not body.holds or abs(level.height - body.level) > step + sigma:
                self.ran_off.append(body)
                return []
            cells = body.cells[self.state.ravel()[body.cells] != TAKEN]
        is_bank = not body.holds and self._above_water(cells, height) > most
        if is_bank or not len(cells):  # of holes at the edge of the data alone nothing is held
            self.ran_off.append(body)
            return []
        cells = self._enclosed(cells, top + max(CREST * sigma, step), tilt)
        if len(cells) > GROWN * len(body.cells) and self._is_other(cells, body):
            cells = body.cells[self.state.ravel()[body.cells] != TAKEN]
        self._take(cells, height, tilt)
        waves = max(sigma, step) + top - height
        return [replace(body, cells=cells, level=level.height, tilt=tilt, waves=waves)]

    def _is_other(self, grown: Ints, body: Body) -> bool:
        """Whether most of what a body grew to is not what it was found by: few returns, or dark."""
        if not (body.few or body.dark >= DARK):
            return False
        return not looks_like_water(self.cells, grown, self._shore(grown))

    def _enclosed(self, body: Ints, height: float, tilt: Tilt) -> Ints:
        """A body with the cells up to a height that nothing but the body is beside."""
        lattice = self.cells.lattice
        (top, left), mask = window(lattice, body, 0)
        r, c = np.nonzero(ndimage.binary_fill_holes(mask) & ~mask)
        amid = (r + top) * lattice.cols + c + left
        free = self.state.ravel()[amid] != TAKEN
        low = self.floor.ravel()[amid] <= height + tilt.at(r + top, c + left)
        return np.union1d(body, amid[free & low])

    def _spread(
        self, starts: Ints, level: float, below: float, most_lower: int, tilt: Tilt
    ) -> tuple[Ints, int]:
        """Cells that water at a level covers, and how many of them lie clearly below it.

        Water that runs off across a hole at the edge of the data, where nobody knows whether there
        is a dam, is held there: how such edges lie to rows and columns must not decide.
        """
        body, lower = self._over(self.floor, starts, level, below, most_lower, tilt)
        if lower <= most_lower or not self.rim.ravel()[body].any():
            return body, lower
        inner = starts[~self.rim.ravel()[starts]]
        return self._over(self._held, inner, level, below, most_lower, tilt)

    @cached_property
    def _held(self) -> Floats:
        """The floor with a dam around the holes at the edge of the data."""
        return np.where(self.rim, np.float32(np.inf), self.floor)

    def _behind_dikes(self, starts: Ints, level: float, most_lower: int) -> tuple[Ints, int]:
        """What water covers, and how many cells lie below, if points above it hold it.

        Cells may be as wide as a dike, and their lowest points on the water beside it.
        """
        metre = self.cells.metre
        top, below = level + STEP * metre, level - DROP * metre
        return self._over(self.floor, starts, top, below, most_lower, LEVEL, dike=top)

    def _over(
        self,
        floor: Floats,
        starts: Ints,
        level: float,
        below: float,
        most_lower: int,
        tilt: Tilt,
        *,
        dike: float = math.inf,
    ) -> tuple[Ints, int]:
        """Cells of a floor that water at a level covers, and how many lie clearly below it.

        Cells with a point higher than `dike` hold it.
        """
        middle = self.middle
        if tilt != LEVEL:
            rows, cols = floor.shape
            trend = tilt.at(np.arange(rows)[:, None], np.arange(cols)).astype(np.float32)
            floor, middle = floor - trend, middle - trend
            middle.ravel()[starts] = np.nan  # of a hole, whose edge is no level
        size, lower = kernels.spread(
            floor,
            self.cells.high,
            np.float32(dike),
            middle,
            level,
            below,
            level - WEIR * self.cells.metre,
            most_lower,
            starts,
            self.state,
            self.stack,
        )
        body = np.sort(self.stack[:size]).astype(np.int64)
        self.state.ravel()[body] = 0
        return body, lower


def _below(cells: CellGrid, least: int) -> Floats:
    """Median of the lowest heights around each cell; amid holes, that of those at the edge."""
    below = cells.middle.copy()
    for hole in patches(cells.hole, least):
        heights = cells.low.ravel()[around(cells.lattice, hole, 1)]
        heights = heights[np.isfinite(heights)]
        inner = hole[np.isnan(below.ravel()[hole])]
        if len(heights):
            below.ravel()[inner] = np.median(heights)
    return below


def fit(cells: CellGrid, some: Ints, heights: Floats) -> tuple[float, Tilt]:
    """Level and tilt of the least-squares plane through heights at cells."""
    r, c = some // cells.lattice.cols, some % cells.lattice.cols
    row, col = float(r.mean()), float(c.mean())
    design = np.column_stack([np.ones(len(some)), r - row, c - col])
    (level, south, east), *_ = np.linalg.lstsq(design, heights.astype(float), rcond=None)
    return float(level), Tilt(float(south), float(east), row, col)


class Hole(NamedTuple):
    """A hole in the data, the cells at its edge with their heights, and their level and tilt."""

    cells: Ints
    edge: Ints
    heights: NDArray[np.float32]
    level: float
    tilt: Tilt


def _holes(cells: CellGrid, least: int) -> Iterator[Hole]:
    """Holes in the data that have points at their edges."""
    for hole in patches(cells.hole, least):
        edge = around(cells.lattice, hole, 1)
        heights = cells.low.ravel()[edge]
        may_flow = is_long(cells, hole) or not cells.whole.ravel()[edge].all()
        edge, heights = edge[np.isfinite(heights)], heights[np.isfinite(heights)]
        if not len(heights):
            continue
        level = lowest_mode(heights, STEP * cells.metre)
        higher = edge[heights >= level - STEP * cells.metre]
        if _is_above(heights, level, cells.metre):
            level = float(np.quantile(heights, RUN_OFF))
        yield Hole(hole, edge, heights, level, _tilt_of(cells, higher) if may_flow else LEVEL)


def _pools(cells: CellGrid, holes: Sequence[Hole], least: int) -> Iterator[Pool]:
    """Holes as starting cells, with the level at their edges.

    The edge of a lake is at one level, that of a shadow or of a gap between strips follows the
    terrain, and so does that of a river. A hole that is neither long nor reaches the edge of the
    data holds no river: where its edge is tilted, as around a field on a terrace, that is its bank.
    """
    for hole in holes:
        if hole.tilt == LEVEL:
            yield hole.cells, hole.level, LEVEL
        elif len(hole.cells) >= START * RIVER * least:
            r, c = hole.edge // cells.lattice.cols, hole.edge % cells.lattice.cols
            rest = hole.heights - hole.tilt.at(r, c)
            level = lowest_mode(rest, STEP * cells.metre)
            if not _is_above(rest, level, cells.metre):
                yield hole.cells, level, hole.tilt


def _is_above(heights: Floats, level: float, metre: float) -> bool:
    """Whether more at the edge of a hole is clearly below a level than errors are.

    Walls are seen here and there, at any height down to the water, so no height is frequent but
    that of their tops; and water is no higher than the lowest of what is beside it.
    """
    return bool((heights < level - DROP * metre).mean() > RUN_OFF)


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
        level, tilt = fit(cells, lows, heights)
        trend = tilt.at(lows // cells.lattice.cols, lows % cells.lattice.cols)
        off = abs(heights - level - trend)
        explained = trend.var() / max(heights.var(), 1e-12)
        lows = lows[off <= max(2.5 * float(np.median(off)), 0.01 * cells.metre)]
    is_slope = np.ptp(trend) > CALM * cells.metre and explained > TILTED
    return tilt if is_slope else LEVEL


def _slopes(cells: CellGrid, where: Mask, spread: float, least: int) -> Iterator[Pool]:
    """Calm tilted areas with few or dark returns, which may be rivers, with levels and tilts.

    Parameters
    ----------
    where : cells that are calm
    spread : of heights on such water, in metres
    """
    on_land = cells.density * cells.lattice.cell**2
    for place in patches(where, least):
        heights = cells.middle.ravel()[place]
        level, tilt = fit(cells, place, heights)
        trend = tilt.at(place // cells.lattice.cols, place % cells.lattice.cols)
        low, high = np.percentile(heights - trend, (10, 90))
        if high - low <= spread * cells.metre and np.ptp(trend) > CALM * cells.metre:
            thin = cells.count.ravel()[place].mean() <= SPARSE * on_land
            if thin or _darkness(cells, place, shore_of(cells, place)) >= VERY_DARK:
                yield place, level, tilt


def flows(cells: CellGrid, some: Ints, tilt: Tilt) -> bool:
    """Whether a tilted place falls along itself alone, from one edge of the data to another.

    A river does, and not much, where it is calm. Paved ground is drained: it falls or bends across
    as well, or ends in the data.
    """
    along = tilt.at(some // cells.lattice.cols, some % cells.lattice.cols)
    low, high = np.quantile(along, ENDS)
    cut = ~cells.whole.ravel()[some]
    if not (is_long(cells, some) and cut[along <= low].any() and cut[along >= high].any()):
        return False
    core = core_of(cells, some)
    drained = _drained(cells, core[np.isfinite(cells.low.ravel()[core])])
    return max(drained, math.hypot(tilt.south, tilt.east) / cells.lattice.cell) <= PAVED


def is_long(cells: CellGrid, some: Ints) -> bool:
    """Whether cells lie along a line, as rivers and roads do."""
    return _along_a_line(some // cells.lattice.cols, some % cells.lattice.cols)


def _along_a_line(south: NDArray[Any], east: NDArray[Any]) -> bool:
    if len(south) < 2:
        return False
    spread = np.linalg.eigvalsh(np.cov(south, east))
    wide, long = np.sqrt(np.maximum(spread, 0))  # of one row it may be rounded below 0
    return bool(long >= LONG * wide)


def _drained(cells: CellGrid, some: Ints) -> float:
    """How much a long place rises to one side, or to its middle: the median of pieces along it.

    Waves are averaged, which local slopes would be of.
    """
    spots = np.column_stack([some // cells.lattice.cols, some % cells.lattice.cols]).astype(float)
    centred = spots - spots.mean(axis=0)
    across, along = (centred @ np.linalg.eigh(np.cov(centred.T))[1]).T
    order = np.argsort(along, kind="stable")
    steep = []
    for piece in np.array_split(order, PIECES):
        if len(piece) >= FOR_SHAPE:
            line = np.vander(along[piece] - along[piece].mean(), 3)
            aside = across[piece] - line @ np.linalg.lstsq(line, across[piece], rcond=None)[0]
            shape = np.column_stack([aside, np.abs(aside), line])
            rise = np.linalg.lstsq(shape, cells.low.ravel()[some[piece]], rcond=None)[0][:2]
            steep.append(np.abs(rise).max() / cells.lattice.cell)
    return float(np.median(steep)) if steep else math.inf


def _level_places(cells: CellGrid, where: Mask, least: int) -> Iterator[Pool]:
    """Cells at one level each, from patches that are calm or of a class of water."""
    step = STEP * cells.metre
    for place in patches(where, least):
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


def judge(
    cells: CellGrid,
    body: Ints,
    level: float,
    tilt: Tilt,
    ring: Ints,
    shore: Ints,
    *,
    rough: bool = False,
) -> tuple[Body | None, str]:
    """The body with the evidence that it is water, or none if that is too weak, and why.

    An area that returns no pulses is water, unless it is narrow as shadows are. One that returns
    them must be level, and very dark or large. A rough one must be dark in any case. What one
    flight covers beside ground that two cover has fewer points, but no banks.

    Parameters
    ----------
    ring : the cells of its shore, but for other water
    shore : these and those of other water, see :func:`shore_of`
    """
    count = cells.count.ravel()
    here = body[count[body] > 0]
    lost = _lost(cells, body, ring)
    if lost <= FEWER < (for_each := _lost(cells, body, ring, by_flights=True)):
        lost = for_each
    amid = _darkness(cells, body, shore)
    dark = amid if rough else _darkness(cells, body, ring)  # wet banks are rough and dark, too
    classed = cells.water.ravel()[body].sum() > 0.5 * count[body].sum()
    core = _known(cells, body) if tilt == LEVEL else body[:0]
    level_enough = _is_level(cells, core)
    shaped = level_enough and _bent(cells, core, surely=dark >= VERY_DARK)
    fewer = SPARSE < lost <= FEWER and level_enough and not shaped
    across = tilt != LEVEL and dark >= VERY_DARK and flows(cells, body, tilt)
    reasons = {
        FEW: lost <= SPARSE,
        "fewer returns": fewer and _beside_banks(cells, body, level),
        "level": level_enough,
        "level across": across,
        "dark": dark >= DARK and not shaped,
        "class": classed,
    }
    few = lost <= SPARSE and (dark >= DARK or level_enough or _is_wide(cells, body))
    large = len(here) >= LARGE * cells.metre**2 / cells.area
    enough = few or classed or across or (level_enough and (dark >= VERY_DARK or large))
    if not enough or (rough and dark < DARK):
        return None, (
            f"it returns {lost:.0%} of the pulses that its shore does, its intensities separate by "
            f"{dark:.2f} (1 is fully), and it is {'' if level_enough else 'not '}level"
        )
    if not (few or classed) and _raised(cells, body, level):
        return None, f"ground {WALL:g} m lower is close behind its rim, as around a roof"
    evidence = ", ".join(name for name, holds in reasons.items() if holds)
    return Body(body, cells.base + level, tilt, lost, dark, evidence, amid=amid), ""


def _lost(cells: CellGrid, body: Ints, ring: Ints, *, by_flights: bool = False) -> float:
    """Number of points in a cell of a body over that on its shore; 1 where it is not known.

    Cells at the edge of the data lie only in part in them: they do not count. With `by_flights`
    the points of a cell are those for each flight that covers it: ground that one covers has half
    of those where two do.
    """
    whole = cells.whole.ravel()
    body, ring = body[whole[body]], ring[whole[ring]]
    if not (len(body) and len(ring)):
        return 1.0
    count, flights = cells.count.ravel(), cells.flights.ravel()
    if by_flights:
        return float((count[body] / flights[body]).mean() / np.median(count[ring] / flights[ring]))
    return float(count[body].mean() / median_of_counts(count[ring]))


def _beside_banks(cells: CellGrid, body: Ints, level: float) -> bool:
    """Whether ground beside most of the rim of a place is higher than water runs over.

    Ground that one flight covers has half of the points of that which two cover, and level ground
    ends where it rises by little, or at the edge of the data, beyond which no bank is known.
    """
    width = max(REACH, math.ceil(BANK * cells.metre / cells.lattice.cell))
    (top, left), wet = window(cells.lattice, body, width)
    ground = cells.middle[top : top + wet.shape[0], left : left + wet.shape[1]]
    ground = np.where(wet | np.isnan(ground), -np.inf, ground)
    banks = ndimage.maximum_filter(ground, 2 * width + 1) >= level + DROP * cells.metre
    rim = ndimage.binary_dilation(wet, np.ones((3, 3), bool)) & ~wet
    return bool(banks[rim].mean() >= BANKS)


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


def looks_like_water(cells: CellGrid, some: Ints, shore: Ints) -> bool:
    """Whether cells return few of the pulses that those of a shore do, or are darker."""
    return _lost(cells, some, shore) <= SPARSE or _darkness(cells, some, shore) >= DARK


def _raised(cells: CellGrid, body: Ints, level: float) -> bool:
    """Whether the ground is lower close behind the rim of a body, as around a flat roof."""
    width = max(2, math.ceil(RIM * cells.metre / cells.lattice.cell))
    ring = around(cells.lattice, body, width, width - 1)
    heights = cells.low.ravel()[ring]
    heights = heights[np.isfinite(heights)]
    return bool(len(heights) and np.median(heights) < level - WALL * cells.metre)


def _darkness(cells: CellGrid, body: Ints, ring: Ints) -> float:
    """Separation of the intensities in the cells of a body and of its shore."""
    bright, count = cells.bright.ravel(), cells.count.ravel()
    return separation(bright[body[count[body] > 0]], bright[ring])


def separation(water: Floats, land: Floats) -> float:
    """Largest difference of the distribution functions of two samples, where water is darker."""
    if not (len(water) and len(land)):
        return 0.0
    water, land = np.sort(water), np.sort(land)
    at = np.concatenate([water, land])
    below = [np.searchsorted(some, at, side="right") / len(some) for some in (water, land)]
    return max(0.0, float((below[0] - below[1]).max()))


def _is_wide(cells: CellGrid, hole: Ints) -> bool:
    """Whether enough cells of a hole are not at its edge, unlike those of gaps and shadows."""
    return len(core_of(cells, hole, 0.0)) >= WIDE * len(hole)


def _known(cells: CellGrid, some: Ints) -> Ints:
    """Cells far from the edge of some around which heights are known."""
    core = core_of(cells, some)
    return np.asarray(core[np.isfinite(cells.middle.ravel()[core])])


def _is_level(cells: CellGrid, core: Ints) -> bool:
    """Whether cells lie on one level surface, more exactly than fields do.

    Waves may be longer than a cell and its neighbours, so the means of compact blocks are compared.
    They still differ, by no more than the waves are high.
    """
    if len(core) < KNOWN:
        return False
    middle, waves = cells.middle.ravel()[core], waves_of(cells, core)
    return _flat(cells, core, middle, waves) or _two_levels(cells, core, middle, waves)


def _bent(cells: CellGrid, core: Ints, *, surely: bool) -> bool:
    """Whether cells that are nearly level lie on a tilted or curved surface, as paved ground does.

    Water has no shape: what the heights of its blocks differ by are waves, noise, and steps between
    flights. Two levels explain all of these better than a quadratic surface does, as noise is
    halved by its median, and a step is one. Only rivers fall, which are long.

    With `surely` the shape must also be more than chance: see :func:`_is_by_chance`.
    """
    heights = cells.middle.ravel()[core].astype(float)
    spots = np.column_stack([core // cells.lattice.cols, core % cells.lattice.cols]).astype(float)
    parts = even_blocks(spots, FINE)
    if len(parts) < BLOCKS:
        return False
    z = np.array([heights[part].mean() for part in parts])
    z, fit, _ = _fitted(np.array([spots[part].mean(axis=0) for part in parts]), z)
    bent = np.ptp(fit) >= BENT * cells.metre and not two_levels_fit(z, fit)
    return bool(bent and not (surely and _is_by_chance(cells, core, spots)))


def _is_by_chance(cells: CellGrid, core: Ints, spots: Floats) -> bool:
    """Whether noise alone may be the shape of a surface, by the F-test of independent heights.

    Medians of cells side by side share most of their heights, so those of a few dozen cells lie on
    a smooth surface though the water is flat. The lowest heights themselves share none.
    """
    low = cells.low.ravel()[core].astype(float)
    off = abs(low - cells.middle.ravel()[core])
    near = off <= WIDEST * waves_of(cells, core)  # but for boats and errors
    z, fit, terms = _fitted(spots[near], low[near])
    freedom = len(z) - SHAPE
    if freedom <= 0:
        return False
    ratio = (fit @ fit / terms) / max(float(((z - fit) ** 2).sum()) / freedom, 1e-12)
    return bool(fdtrc(terms, freedom, ratio) > CHANCE)


def _fitted(spots: Floats, heights: Floats) -> tuple[Doubles, Doubles, int]:
    """Heights about their mean, a quadratic surface through them, and its terms but for that.

    Of a long place they are those about a plane, which has two of the terms.
    """
    south, east = (spots - spots.mean(axis=0)).T
    design = np.column_stack([np.ones(len(south)), south, east, south**2, south * east, east**2])
    known = 3 if _along_a_line(south, east) else 1
    z = heights - design[:, :known] @ np.linalg.lstsq(design[:, :known], heights, rcond=None)[0]
    return z, design @ np.linalg.lstsq(design, z, rcond=None)[0], SHAPE - known


def waves_of(cells: CellGrid, some: Ints) -> float:
    """Standard deviation of the lowest heights in cells from those around."""
    off = (cells.low.ravel() - cells.middle.ravel())[some]
    off = off[np.isfinite(off)]
    return float(np.ptp(np.percentile(off, (20, 80)))) / SIGMAS if len(off) else 0.0


def _flat(cells: CellGrid, some: Ints, heights: Floats, waves: float) -> bool:
    """Whether heights at cells neither fall, nor sag, nor differ between blocks beyond waves."""
    cols, limit = cells.lattice.cols, LEVEL_SPREAD * cells.metre
    spots = np.column_stack([some // cols, some % cols])
    (top, left), inside = window(cells.lattice, some, 1)
    depth = ndimage.distance_transform_edt(inside)[spots[:, 0] - top, spots[:, 1] - left]
    centred = spots - spots.mean(axis=0)
    design = np.column_stack([np.ones(len(some)), centred, depth - depth.mean()])
    (_, south, east, inward), *_ = np.linalg.lstsq(design, heights.astype(float), rcond=None)
    fall = math.hypot(south, east) * math.sqrt(len(some))
    sag = abs(inward) * float(np.ptp(depth))  # hollows in land are deepest far from their edge
    means = [float(heights[block].mean()) for block in even_blocks(spots.astype(float))]
    low, high = np.percentile(means, (10, 90))
    return bool(max(fall, sag) <= limit and high - low <= math.hypot(limit, waves))


def _two_levels(cells: CellGrid, some: Ints, heights: Floats, waves: float) -> bool:
    """Whether heights at cells are of two flat parts side by side, as of flights on two days."""
    smooth = smoothed(cells, some, heights)
    upper = smooth >= otsu_threshold(smooth)
    for part in (upper, ~upper):
        labels, _ = ndimage.label(window(cells.lattice, some[part], 0)[1])
        of_one = np.bincount(labels.ravel())[1:].max(initial=0)
        if part.sum() < KNOWN or of_one < COMPACT * part.sum():
            return False
        if not _flat(cells, some[part], heights[part], waves):
            return False
    apart = float(heights[upper].mean() - heights[~upper].mean())
    return apart <= DROP * cells.metre


def smoothed(cells: CellGrid, some: Ints, heights: Floats) -> Floats:
    """Heights at cells without waves, which are averaged over a share of the place."""
    (top, left), inside = window(cells.lattice, some, 0)
    spot = some // cells.lattice.cols - top, some % cells.lattice.cols - left
    held, mean = np.zeros(inside.shape), float(heights.mean())
    held[spot] = heights - mean
    reach = WITHOUT_WAVES * math.sqrt(len(some))
    smooth = ndimage.gaussian_filter(held, reach) / np.maximum(
        ndimage.gaussian_filter(inside.astype(float), reach), 1e-9
    )
    return np.asarray(smooth[spot] + mean)


def touching(cells: CellGrid, bodies: Sequence[Body]) -> list[list[int]]:
    """Numbers of the bodies that are one, for there is nothing between them.

    Their levels differ where they were flown on different days; the water at a weir falls more.
    """
    of = np.full(cells.low.shape, -1)
    for k, body in enumerate(bodies):
        of.ravel()[body.cells] = k
    sides = [(of[1:], of[:-1]), (of[:, 1:], of[:, :-1])]
    pairs = np.concatenate([np.stack([a.ravel(), b.ravel()]) for a, b in sides], axis=1)
    pairs = np.sort(pairs[:, (pairs >= 0).all(axis=0) & (pairs[0] != pairs[1])], axis=0)
    met, length = np.unique(pairs, axis=1, return_counts=True)
    near = [
        (a, b)
        for (a, b), sides_met in zip(met.T, length, strict=True)
        if bodies[a].tilt == bodies[b].tilt == LEVEL
        and bodies[a].doubtful == bodies[b].doubtful
        and abs(bodies[a].level - bodies[b].level) <= DROP * cells.metre
        and sides_met >= CONTACT * math.sqrt(min(len(bodies[a].cells), len(bodies[b].cells)))
    ]
    links = np.array(near, np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(links.shape[1]), links), shape=(len(bodies), len(bodies)))
    count, group = connected_components(graph, directed=False)
    return [np.flatnonzero(group == k).tolist() for k in range(count)]


def joined(cells: CellGrid, bodies: Sequence[Body]) -> list[Body]:
    """Bodies, where those that touch are one."""
    whole = []
    for some in touching(cells, bodies):
        largest = max((bodies[k] for k in some), key=lambda body: len(body.cells))
        every = np.unique(np.concatenate([bodies[k].cells for k in some]))
        whole.append(replace(largest, cells=every, waves=math.inf) if len(some) > 1 else largest)
    return whole


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
    ring = around(cells.lattice, body.cells, 5, 1)
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
