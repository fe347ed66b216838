"""Water bodies from cells: areas that look like water are filled up to their levels.

What looks like water (see `_evidence`) may be none. What tells water from the rest is that it stays
where it is: everything around a water body is higher than its level. So water is poured on every
hole and every calm place up to the level found there, and what runs off was no water.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.shoreline import _kernels as kernels
from algorithms.shoreline._cells import (
    CALM,
    LEVEL,
    CellGrid,
    Tilt,
    around,
    connected,
    fit,
    patches,
    shore_of,
    window,
)
from algorithms.shoreline._evidence import (
    CORE,
    DARK,
    DROP,
    FEW,
    LARGE,
    SPARSE,
    STEP,
    VERY_DARK,
    Body,
    core_of,
    darkness,
    is_long,
    is_wide,
    judge,
    looks_like_water,
)
from algorithms.shoreline._kernels import TAKEN
from algorithms.shoreline._level import Level, lowest_mode, mode
from toolbox.context import QUIET, Context

Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]
Floats = NDArray[np.floating[Any]]

# Lengths in metres, from the noise of airborne points (0.02 to 0.05).
SURE_CELLS = 12  # of a body: fewer hold few points by chance; 100 m2 are as many at 0.5 per m2
WAVY = 0.3  # as CALM, on water with waves of 0.15 (standard deviation of points)
CREST = 3.0  # standard deviations of points on the water above its level
WEIR = 1.0  # m from water to lower water beside it, at a weir or rapids
RUN_OFF = 0.02  # share of a body that may seem to lie lower
SECTOR = 4  # cells of the edge of a hole of which the lowest point counts
FEWEST_SECTORS = 6
GROWN = 10  # times its cells: nine tenths of a body that grew so were not looked at
START = 4  # starting cells may be this many times fewer than those of a body
CONTACT = 0.5  # of the root of the cells of a body: so wide it meets another that it is part of
RIVER = 4  # smallest river, in smallest bodies
TILTED = 0.6  # share of the variance of heights around a hole that a plane explains, on a slope
PEAKS = 12  # levels that are looked for in one calm area
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
            and is_wide(self.cells, hole)
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
            if thin or darkness(cells, place, shore_of(cells, place)) >= VERY_DARK:
                yield place, level, tilt


def _level_places(cells: CellGrid, where: Mask, least: int) -> Iterator[Pool]:
    """Cells at one level each, from patches that are calm or of a class of water.

    Where land far off is at the level of a lake, too, and water would run off from there, the lake
    is most of the cells at that level: it is given alone as well.
    """
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
                for most in connected(cells.lattice, rest[at], max(least, at.sum() / 2)):
                    if len(most) < at.sum():
                        yield most, level, LEVEL
            rest = rest[~at]


def numbers_on(cells: CellGrid, bodies: Sequence[Body]) -> Ints:
    """Number of the body on each cell, shape (rows, cols); -1 for none."""
    of = np.full(cells.low.shape, -1)
    for k, body in enumerate(bodies):
        of.ravel()[body.cells] = k
    return of


def touching(cells: CellGrid, bodies: Sequence[Body]) -> list[list[int]]:
    """Numbers of the bodies that are one, for there is nothing between them.

    Their levels differ where they were flown on different days; the water at a weir falls more.
    """
    of = numbers_on(cells, bodies)
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
