"""Water bodies with their levels from points: what the tools of this group share."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from algorithms.shoreline._bodies import (
    CONTACT,
    RIVER,
    WEIR,
    Pour,
    find_bodies,
    joined,
    numbers_on,
)
from algorithms.shoreline._cells import (
    LEVEL,
    STEEPEST,
    CellGrid,
    Tilt,
    around,
    grid,
    shore_of,
)
from algorithms.shoreline._dikes import apart
from algorithms.shoreline._evidence import (
    BANK,
    DARK,
    DROP,
    ENDS,
    LARGE,
    LEVEL_ALONE,
    STEP,
    WALL,
    Body,
    core_of,
    flows,
    is_bent,
    is_long,
    looks_like_water,
)
from algorithms.shoreline._kernels import TAKEN
from algorithms.shoreline._level import DAYS, NINETY_FIVE, Level, under_cover
from algorithms.shoreline._reaches import along_banks, reaches
from algorithms.shoreline._returns import Returns
from algorithms.shoreline._strip_gaps import shoreless, strip_gaps
from algorithms.shoreline._surfaces import FALL, Water, islands_hide, lattice_place, with_levels
from toolbox.context import QUIET, Context, log, setting_name
from toolbox.data.crs import own_unit
from toolbox.declare import Position
from toolbox.errors import DataError

ROUNDS, MOST_ROUNDS = 3, 6  # the latter where bodies meet and become one
SAME = 0.02, 0.15  # m, least and most between levels that may be the same, by their intervals
KNOWN = 0.02  # m, interval of a level that others can be told to be equal to
OVERLAP = 0.2  # share of a level place that is water found: its rest is not told of
LEAST_SIDE = 0.1  # of a lake, at a level of its own: as much as two levels are looked for in
BESIDE = 3  # cells: two places so close meet, as the median of heights hides the step between
ABRUPT = 0.75  # of a step from water to a level place: height of the cells beside the water
SURROUNDED = 0.25  # share of the rim of a water without a shore that has points
HILLSIDE = 25.0  # m, of half of what is beside a gap: more than crowns and most walls are high
NARROW = 4  # cells: narrower waters are often lost, see docs/explanation/shoreline.md
APART = BESIDE + NARROW  # cells: no water that could be told lies between two so close
NEEDED = 100  # points of land that a water covers; of smaller ones most were lost
FEWEST_POINTS = 50  # that tell water from land: as many as the smallest body would hold on land
LOW_SHORE = 0.1  # share of land by a bright water that is at its level: dark waters have up to 0.04
WALLED = 0.5  # share of its rim with points a wall above its level
OVERGROWN = 0.5  # share of cells with points a wall above their lowest: dark waters have up to 0.16
LISTED = 10  # bodies that are told of one by one
IN_A_WARNING = 5  # places that one warning names
NEAR_PLACE = 3.0  # cells: a place so close to a body is meant to be on it
OFF = 90  # per cent of a long water that lie as its banks do

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def find_water(
    points: Returns, least_area: float, *, level_alone: bool = False, ctx: Context = QUIET
) -> tuple[CellGrid, list[Water]]:
    """The cells, and all water bodies of at least an area, the largest first.

    Bodies that are known by their level alone are left out, and told of: see :func:`_sure`.

    Parameters
    ----------
    points : last returns
    least_area : of a body, in square units of the data
    level_alone : whether such bodies are given, too
    ctx : progress and cancellation
    """
    cells = grid(points, ctx.part(0.0, 0.5))
    if len(points) < FEWEST_POINTS:
        log.warning("points: only %d take part, too few to tell water from land", len(points))
        return cells, []
    pour, first, found, steep = _poured(points, cells, least_area, ctx.part(0.5, 0.8))
    if gaps := strip_gaps(cells, found):
        _tell_strip_gaps(cells, gaps)
        cells = cells.without(np.concatenate(gaps))
        pour, first, found, steep = _poured(points, cells, least_area, ctx.part(0.8, 1.0))
    found = _without_gaps(cells, found, steep)  # of whose pieces some would be level
    found = [part for water in found for part in _parted(points, cells, pour.fewest, water)]
    found = [
        reach
        for water in found
        for reach in _reaches(points, cells, pour.fewest, water)
        if reach is water or _is_wet(cells, water, reach)
    ]
    found = _of_two_days(points, cells, found, first)
    ctx.progress(1.0)
    found = [_on_top(_uncovered(cells, water)) for water in found if not _is_road(cells, water)]
    found = _doubted(cells, found)
    if not level_alone:
        found = _sure(cells, found)
    if not found:
        _tell_nothing(cells, pour)
    _tell_sparse(cells, least_area)
    _tell_above(cells, pour, found)
    _tell_holes(cells, pour, found)
    _tell_steps(cells, found)
    return cells, [with_hidden_shore(cells, one) for one in sorted(found, key=_by_size)]


def _poured(
    points: Returns, cells: CellGrid, least_area: float, ctx: Context
) -> tuple[Pour, list[Body], list[Water], list[Water]]:
    """What was poured, the bodies found first, these as they are in the end, and too steep ones."""
    pour = Pour(cells, least_area)
    bodies = first = find_bodies(cells, pour, ctx.part(0.0, 0.4))
    found: list[Water] = []
    steep: list[Water] = []  # would run into lakes below them
    for k in range(MOST_ROUNDS):  # waves and slopes are known after a first look
        ctx.progress(0.4 + 0.6 * k / MOST_ROUNDS)
        found = with_levels(points, cells, bodies)
        steep += [water for water in found if _is_steep(cells, water)]
        found = _filled(cells, pour, [water for water in found if not _is_steep(cells, water)])
        bodies = joined(cells, [water.body for water in found])
        if k + 1 >= ROUNDS and len(bodies) == len(found):
            break
    return pour, first, found, steep


def _parted(points: Returns, cells: CellGrid, least: int, water: Water) -> list[Water]:
    """Waters on both sides of dikes, if they stand at levels of their own, or the water whole."""
    if water.fall or water.level.strips > DAYS * cells.metre:  # a step between flights is no dike
        return [water]
    sides = water.level.parts
    parts = apart(cells, water.body, least, sides.upper if sides else -math.inf)
    if len(parts) < 2:
        return [water]
    found = with_levels(points, cells, parts)
    levels = [one.level for one in found]
    pairs = [(a, b) for k, a in enumerate(levels) for b in levels[:k]]
    differ = any(not _alike(a, b, cells.metre) for a, b in pairs)
    return found if differ else [water]


def _reaches(points: Returns, cells: CellGrid, least: int, water: Water) -> list[Water]:
    """A river of pools and rapids as waters of their own, each level or a plane; or the water."""
    level = water.level
    if level.basis == "shore" or level.parts or level.strips > DAYS * cells.metre:
        return [water]
    parts = reaches(cells, water.body, RIVER * least, FALL * cells.metre)
    if len(parts) < 2:
        return [water]
    found = with_levels(points, cells, parts)
    return [reach for part in found for reach in _reaches(points, cells, least, part)]


def _of_two_days(
    points: Returns, cells: CellGrid, found: Sequence[Water], first: Sequence[Body]
) -> list[Water]:
    """Waters, where a lake that was flown on two days is whole, and has the levels of both.

    Its level may be that of one day alone, and what lies at the other left out of it or filled
    with it. So all of the bodies that were found first is looked at again.
    """
    whole = _as_first(cells, found, first)
    doubtful = [k for k, water in enumerate(found) if _may_be_of_two_days(cells, water, whole[k])]
    bodies = [replace(found[k].body, cells=whole[k]) for k in doubtful]
    waters = list(found)
    for k, one in zip(doubtful, with_levels(points, cells, bodies, two_days=True), strict=True):
        if one.level.parts:
            waters[k] = one
    return waters


def _as_first(cells: CellGrid, found: Sequence[Water], first: Sequence[Body]) -> list[Ints]:
    """Cells of each water, with those of the bodies of which it kept most and no other has any."""
    of = numbers_on(cells, [water.body for water in found]).ravel()
    whole = [water.body.cells for water in found]
    for body in first:
        kept = np.bincount(of[body.cells] + 1, minlength=len(found) + 1)[1:]
        if kept.any():
            k = int(np.argmax(kept))
            own = body.cells[np.isin(of[body.cells], (-1, k))]
            whole[k] = np.union1d(whole[k], own)
    return whole


def _may_be_of_two_days(cells: CellGrid, water: Water, whole: Ints) -> bool:
    """Whether a tenth of a lake or more is not at its level, and no flights tell why."""
    if water.fall or water.level.basis == "shore" or water.level.strips:
        return False
    off = abs(cells.middle.ravel()[core_of(cells, whole)] + cells.base - water.level.height)
    return bool((off >= DAYS * cells.metre).sum() >= LEAST_SIDE * max(len(off), 1))


def _is_wet(cells: CellGrid, whole: Water, reach: Water) -> bool:
    """Whether a part of a water looks like it does: several ponds may be filled over their dikes.

    What is cut from them is then dikes and land beside, too, at heights of their own.
    """
    if not (whole.body.few or whole.body.dark >= DARK):
        return True
    return looks_like_water(cells, reach.body.cells, shore_of(cells, whole.body.cells))


def _without_gaps(cells: CellGrid, found: Sequence[Water], steep: Sequence[Water]) -> list[Water]:
    """Waters but for gaps of the data on land, which are told of with those known as steep."""
    kept: list[Water] = []
    gaps = list(steep)
    for water in found:
        (gaps if _is_gap(cells, water) else kept).append(water)
    if gaps:
        log.warning(
            "points: gaps of the data that are left out: %d; they fall by more than %.0f %%, as "
            "hillsides do, or end on land, or have no shore, or half of what is beside them is "
            "more than %g m above their lowest shore: %s",
            len(gaps),
            100 * STEEPEST,
            HILLSIDE,
            some_of([_spot(cells, one.body.cells) for one in gaps]),
        )
    return kept


def _tell_strip_gaps(cells: CellGrid, gaps: Sequence[Ints]) -> None:
    """Log gaps between strips that water runs into."""
    log.warning(
        "points: gaps between strips that water runs into, and that are left out of it: %d; "
        "nothing came back from them, and all that is seen beside is more than %g m above the "
        "water. Where its outline meets them it is no shore: %s",
        len(gaps),
        WALL,
        some_of([_spot(cells, one) for one in gaps]),
    )


def _is_steep(cells: CellGrid, water: Water) -> bool:
    """Whether a place falls by more than smooth water does: a gap of the data on a hillside.

    Steeper streams fall in steps and cascades (Montgomery and Buffington, 1997, Channel-reach
    morphology in mountain drainage basins).
    """
    return "class" not in water.body.evidence and _tilt(cells, water).steep(cells.lattice.cell)


def _is_gap(cells: CellGrid, water: Water) -> bool:
    """Whether a place is steep, ends on land, or has no shore or no data around."""
    if "class" in water.body.evidence:
        return False
    if _is_steep(cells, water):
        return True
    if water.fall and water.body.few and _ends_on_land(cells, water.body, _tilt(cells, water)):
        return True
    hidden = _hidden(cells, water)
    beside = cells.count.ravel()[around(cells.lattice, water.body.cells, 1)] > 0
    return bool(hidden > 0 and beside.mean() < SURROUNDED) or hidden > HILLSIDE * cells.metre


def _ends_on_land(cells: CellGrid, body: Body, tilt: Tilt) -> bool:
    """Whether the lower end of a place that falls is as bright and returns as much as its shore.

    Water that loses pulses does so there, too; out of a notch of the data it would run over land.
    """
    whole = body.cells[cells.whole.ravel()[body.cells]]
    along = tilt.at(*np.divmod(whole, cells.lattice.cols))
    end = whole[along <= np.quantile(along, ENDS[0])] if len(whole) else body.cells
    return not looks_like_water(cells, end, shore_of(cells, body.cells))


def _is_road(cells: CellGrid, water: Water) -> bool:
    """Whether a long place that slopes, and returns its pulses, is drained as roads are."""
    body = water.body
    if not water.fall or body.few or "class" in body.evidence or not is_long(cells, body.cells):
        return False
    return not flows(cells, body.cells, _tilt(cells, water))


def _doubted(cells: CellGrid, found: Sequence[Water]) -> list[Water]:
    """Waters, of which those that may be courts or woods are known by their level alone.

    What returns its pulses is known by being level and dark. So is a square among houses, darker
    than their roofs; but ground as low as it is close by, and would be under water but for the
    houses. So is the ground of a wood, as crowns take their share of each pulse; water has hardly
    anything above it. And so is the flat middle of paved ground that is drained.
    """
    wet = _wet(cells, found).ravel()
    return [
        replace(water, body=replace(water.body, evidence=LEVEL_ALONE))
        if not water.body.few
        and not water.fall
        and "class" not in water.body.evidence
        and (
            is_bent(cells, water.body)
            or _is_among_walls(cells, water, wet)
            or _is_overgrown(cells, water.body)
        )
        else water
        for water in found
    ]


def _is_among_walls(cells: CellGrid, water: Water, wet: NDArray[np.bool_]) -> bool:
    """Whether walls or crowns are around a water, and land behind them is at its level.

    A pond on a slope has lower land behind its dam, and flooded fields have dry ones beside, but
    for low bunds.
    """
    width, body = math.ceil(BANK * cells.metre / cells.lattice.cell), water.body.cells
    rim, land = around(cells.lattice, body, 1), around(cells.lattice, body, width + 1, 1)
    land = land[(cells.count.ravel()[land] > 0) & ~wet[land]]
    walls = cells.high.ravel()[rim] + cells.base - water.level.at(cells.centres(rim))
    rise = cells.low.ravel()[land] + cells.base - water.level.at(cells.centres(land))
    at_level = (rise > -DROP * cells.metre) & (rise < STEP * cells.metre)
    return bool(
        len(land) and (walls > WALL * cells.metre).mean() > WALLED and at_level.mean() > LOW_SHORE
    )


def _is_overgrown(cells: CellGrid, body: Body) -> bool:
    """Whether points lie far above most of a place."""
    some = body.cells[cells.count.ravel()[body.cells] > 0]
    above = cells.high.ravel()[some] - cells.low.ravel()[some]
    return bool(len(some) and (above > WALL * cells.metre).mean() > OVERGROWN)


def _sure(cells: CellGrid, found: Sequence[Water]) -> list[Water]:
    """Bodies that more than their level speaks for: squares, fields and cuttings are level, too.

    A body at the level of the nearest one that is sure is water, too: level ground is hardly ever
    at the very level of a lake near by, if both levels are known well; of many farther off one may
    be at any level. Any ground lies within the wide interval of a water that returned nothing.
    """
    sure = [water for water in found if not water.body.doubtful]
    doubtful = sorted((water for water in found if water.body.doubtful), key=_by_size)
    left_out = []
    for water, beside in zip(doubtful, _nearest(cells, sure, doubtful), strict=True):
        if beside and not beside.fall and _equal(water.level, beside.level, cells.metre):
            evidence = f"{water.body.evidence}, that of other water"
            sure.append(replace(water, body=replace(water.body, evidence=evidence)))
        else:
            left_out.append(water)
    if left_out:
        setting = setting_name("level_alone")
        log.warning(
            "points: %d level places are left out, as nothing else tells of water there: ice or "
            "bright water, a pool of a river, or a square, a field, a cutting; a terrain has there "
            "what the points have, unless it is given outlines of known water%s: %s",
            len(left_out),
            f"; the setting {setting} gives such places" if setting else "",
            listed(cells, left_out),
        )
    return sure


def _nearest(cells: CellGrid, found: Sequence[Water], to: Sequence[Water]) -> list[Water | None]:
    """The water found that is nearest to each of some others; none without any."""
    if not (found and to):
        return [None] * len(to)
    of = numbers_on(cells, [water.body for water in found])
    away, near = ndimage.distance_transform_edt(of < 0, return_indices=True)
    closest = [one.body.cells[np.argmin(away.ravel()[one.body.cells])] for one in to]
    at = np.unravel_index(closest, of.shape)
    return [found[k] for k in of[near[0][at], near[1][at]]]


def _uncovered(cells: CellGrid, water: Water) -> Water:
    """A water at the level of what is not covered of it; a river, which has none, as it is."""
    return water if water.fall else replace(water, level=under_cover(water.level, cells.metre))


def _on_top(water: Water) -> Water:
    """A water whose level is no surer than one of its returns, if these may be of what floats.

    Little came back, and no darker than land: of leaves and foam, which lie above the water.
    """
    body, level = water.body, water.level
    if not _is_seen_on_top(body, level):
        return water
    error = math.hypot(level.error, level.sigma)
    return replace(water, level=replace(level, error=error, freedom=math.inf))


def _is_seen_on_top(body: Body, level: Level) -> bool:
    """Whether few returns tell a level, which neither a class nor their brightness call water."""
    classed = "class" in body.evidence
    return level.basis == "water" and body.few and body.dark < DARK and not classed


def _alike(one: Level, other: Level, metre: float) -> bool:
    """Whether two levels may be the same."""
    least, most = SAME[0] * metre, SAME[1] * metre
    unsure = min(max(math.hypot(one.interval, other.interval), least), most)
    return abs(one.height - other.height) <= unsure


def _equal(one: Level, other: Level, metre: float) -> bool:
    """Whether two levels are the same as far as centimetres tell."""
    return max(one.interval, other.interval) <= KNOWN * metre and _alike(one, other, metre)


def _tell_nothing(cells: CellGrid, pour: Pour) -> None:
    """Log what was looked for, what came nearest to it, and what to try."""
    area = cells.area / cells.metre**2
    some, reason = pour.refused
    nearest = "no place is a hole or calm"
    if len(some):
        x, y = _centre(cells, some)
        size = len(some) * area
        nearest = (
            f"the largest place like that, {size:.0f} m2 at {x:.1f},{y:.1f}, is none: {reason}"
        )
    log.warning("points: no water was found of at least %.0f m2; %s", pour.fewest * area, nearest)
    setting = setting_name("water_classes")
    log.info(
        "water loses half of its pulses, or is level and dark, or at the level of such water and "
        "larger than %.0f m2, in cells of %.1f m%s",
        LARGE,
        cells.lattice.cell / cells.metre,
        f"; of a place that is water all the same name the class ({setting})" if setting else "",
    )


def _tell_sparse(cells: CellGrid, least_area: float) -> None:
    """Log that waters which are asked for are smaller than points can tell."""
    narrow, needed = NARROW * cells.lattice.cell, NEEDED / cells.density
    if narrow**2 > least_area:
        area = cells.metre**2
        log.warning(
            "points: land has %.2g points per m2, which are counted in cells of %.1f m: waters "
            "narrower than %.1f m are often lost, and most below %.0f m2, though the least area "
            "is %.0f m2",
            cells.density * area,
            cells.lattice.cell / cells.metre,
            narrow / cells.metre,
            needed / area,
            least_area / area,
        )


def _tell_above(cells: CellGrid, pour: Pour, found: Sequence[Water]) -> None:
    """Log level places from which water would run off, if they may be water all the same.

    They return few pulses or are dark, or meet a body along much of its shore, which then may be
    none: ice, floating plants, or a flight at another time.
    """
    wet = _wet(cells, found)
    told: list[Body] = []
    for place in sorted(pour.ran_off, key=lambda one: (-len(one.cells), one.cells[0])):
        if wet.ravel()[place.cells].mean() > OVERLAP:
            continue
        wet.ravel()[place.cells] = True  # the same place at another level is told once
        if not place.doubtful or _meets(cells, place, found):
            told.append(place)
    if told:
        log.warning(
            "points: %d level places are left out from which water would run off to lower ones: "
            "flights at other times, ice, plants, a pool above rapids or a weir, or land; a "
            "terrain has there what the points have, unless it is given outlines of known water, "
            "and where water meets such a place, its outline may be no shore: %s",
            len(told),
            some_of([_above(cells, one, found) for one in told]),
        )


def _tell_holes(cells: CellGrid, pour: Pour, found: Sequence[Water]) -> None:
    """Log holes of the data that are no water, though they are as large: their shore may mislead.

    Between walls or below crowns the lowest points beside a water tell a level above its banks.
    """
    holes = pour.no_water(_wet(cells, found))
    if holes:
        area = cells.area / cells.metre**2
        log.warning(
            "points: holes of the data of at least %.0f m2 that do not count as water: %d; water "
            "between walls or below crowns, beside which nothing is as low as its shore, or roofs, "
            "shadows and gaps; a terrain has there what lies around, unless it is given outlines "
            "of known water: %s",
            pour.fewest * area,
            len(holes),
            some_of([_hole(cells, *one) for one in holes]),
        )


def _hole(cells: CellGrid, some: Ints, reason: str) -> str:
    """Text on the size and the place of a hole, and why it is no water."""
    x, y = _centre(cells, some)
    return f"about {_area_of(cells, some):.0f} m2 at {x:.1f},{y:.1f}, refused because {reason}"


def _wet(cells: CellGrid, found: Sequence[Water]) -> NDArray[np.bool_]:
    """Which cells are of some waters, shape (rows, cols)."""
    return numbers_on(cells, [water.body for water in found]) >= 0


def _above(cells: CellGrid, place: Body, found: Sequence[Water]) -> str:
    """Text on a level place, what it is known by, and the water beside it."""
    text = f"{_place(cells, place.cells, place.level)}, known by {place.evidence}"
    near = around(cells.lattice, place.cells, BESIDE)
    beside = max(found, key=lambda one: _contact(near, place, one), default=None)
    if beside is None or not _contact(near, place, beside):
        return text
    up = (place.level - beside.level.height) / cells.metre
    x, y = place_of(cells, beside)
    return f"{text}, {up:+.2f} m from the water at {x:.1f},{y:.1f} beside it"


def listed(cells: CellGrid, waters: Sequence[Water]) -> str:
    """Text on size, place and level of the first of some waters, and how many more there are."""
    return some_of([_place(cells, one.body.cells, one.level.height) for one in waters])


def _place(cells: CellGrid, some: Ints, level: float) -> str:
    """Text on size, place and level of some cells."""
    x, y = _centre(cells, some)
    area = _area_of(cells, some)
    return f"about {area:.0f} m2 at {x:.1f},{y:.1f}, level {in_unit(cells, level, 2)}"


def _spot(cells: CellGrid, some: Ints) -> str:
    """Text on size and place of some cells."""
    x, y = _centre(cells, some)
    return f"about {_area_of(cells, some):.0f} m2 at {x:.1f},{y:.1f}"


def some_of(texts: Sequence[str]) -> str:
    """The first of some texts, and how many more there are."""
    more = [f"and {len(texts) - IN_A_WARNING} more"] if len(texts) > IN_A_WARNING else []
    return "; ".join([*texts[:IN_A_WARNING], *more])


def _tell_steps(cells: CellGrid, found: Sequence[Water]) -> None:
    """Log where waters are side by side at other levels: they make steps in a terrain."""
    steps = sorted(_steps(cells, found), key=lambda one: -one.height)
    if steps:
        log.warning(
            "points: waters at different levels meet, or come within %.1f m, in %d places: rapids, "
            "a weir, a lock, a dam or a dike. A terrain with level water has steps there: %s",
            APART * cells.lattice.cell / cells.metre,
            len(steps),
            "; ".join(_step(cells, one) for one in steps),
        )


class _Step(NamedTuple):
    """By how much an upper water is above a lower one where they meet, and where that is."""

    height: float
    place: tuple[float, float]
    upper: Water
    lower: Water


def _step(cells: CellGrid, step: _Step) -> str:
    """Text on the height and the place of a step, and on the levels on both sides."""
    x, y = step.place
    at = np.array([[x, y]])
    levels = (float(water.level.at(at)[0]) for water in (step.upper, step.lower))
    height, upper, lower = (in_unit(cells, z, 2) for z in (step.height, *levels))
    return f"{height} at {x:.1f},{y:.1f}, from {upper} down to {lower}"


def _steps(cells: CellGrid, found: Sequence[Water]) -> Iterator[_Step]:
    """Pairs of waters that nearly meet, where surfaces differ by what is told of flights."""
    of = numbers_on(cells, [water.body for water in found]).ravel()
    for k, water in enumerate(found):
        beside = around(cells.lattice, water.body.cells, APART)
        for other in np.unique(of[beside[of[beside] > k]]):
            x, y = _centre(cells, beside[of[beside] == other])
            one, two = (float(w.level.at(np.array([[x, y]]))[0]) for w in (water, found[other]))
            if abs(one - two) >= DAYS * cells.metre:
                upper, lower = (water, found[other]) if one > two else (found[other], water)
                yield _Step(abs(one - two), (x, y), upper, lower)


def _meets(cells: CellGrid, place: Body, found: Sequence[Water]) -> bool:
    """Whether a level place ends at a body in a step, along much of its shore: land has banks."""
    near = around(cells.lattice, place.cells, BESIDE)
    return any(
        _contact(near, place, water) >= CONTACT and _ends_abruptly(cells, near, place, water)
        for water in found
    )


def _ends_abruptly(cells: CellGrid, near: Ints, place: Body, water: Water) -> bool:
    """Whether the shore of a body is a step up to a level place, in the cells near that."""
    edge = np.intersect1d(around(cells.lattice, water.body.cells, 1), near)
    heights = cells.low.ravel()[np.setdiff1d(edge, water.body.cells)] + cells.base
    heights = heights[np.isfinite(heights)]
    step = place.level - water.level.height
    beside = len(heights) and np.median(heights) - water.level.height >= ABRUPT * step
    return bool(beside and 0 < step <= WEIR * cells.metre)


def _contact(near: Ints, place: Body, water: Water) -> float:
    """Length along which a place meets a body, over the root of the area of the smaller one.

    Parameters
    ----------
    near : the cells within BESIDE of the place
    """
    beside = np.intersect1d(near, water.body.cells, assume_unique=True)
    length = len(beside) / BESIDE
    return length / math.sqrt(min(len(place.cells), len(water.body.cells)))


def _by_size(water: Water) -> tuple[int, int]:
    return -len(water.body.cells), int(water.body.cells[0])


def _filled(cells: CellGrid, pour: Pour, found: Sequence[Water]) -> list[Water]:
    """Bodies extended to all cells below their levels; bodies that then overlap become one."""
    pour.empty()
    filled = []
    order = sorted(found, key=lambda one: (one.body.doubtful, one.fall == 0, _by_size(one)))
    for water in order:
        if (pour.state.ravel()[water.body.cells] == TAKEN).mean() <= 0.5:
            level, tilt = water.level, _tilt(cells, water)
            filled += [replace(water, body=body) for body in pour.again(water.body, level, tilt)]
    return filled


def _tilt(cells: CellGrid, water: Water) -> Tilt:
    """The tilt of a river, in rows and columns."""
    if not water.fall:
        return LEVEL
    lattice, (east, north) = cells.lattice, water.level.gradient
    row, col = lattice_place(cells, *water.level.centre)
    return Tilt(-north * lattice.cell, east * lattice.cell, float(row), float(col))


def place_of(cells: CellGrid, water: Water) -> tuple[float, float]:
    """Centre of a cell of a body, one in the middle of the list of its cells."""
    return _centre(cells, water.body.cells)


def _centre(cells: CellGrid, some: Ints) -> tuple[float, float]:
    middle = len(some) // 2
    ((x, y),) = cells.centres(some[middle : middle + 1])
    return float(x), float(y)


def name_of(cells: CellGrid, water: Water) -> str:
    """Text that names a body as tables do, by its number, with its area and a place on it.

    Before its outline is drawn the area is that of its cells, in two digits.
    """
    x, y = place_of(cells, water)
    square = cells.metre**2
    if water.number:
        size = water.area / square
        own = own_unit(size, cells.own, 2)
        return f"water body {water.number} ({size:.0f} m2{own}, at {x:.1f},{y:.1f})"
    return f"the water of about {_area_of(cells, water.body.cells):.0f} m2 at {x:.1f},{y:.1f}"


def _area_of(cells: CellGrid, some: Ints) -> float:
    """Area of cells in m2, in the digits that they tell."""
    return _digits(len(some) * cells.area / cells.metre**2)


def _digits(area: float) -> float:
    """An area in two digits, as cells do not tell more."""
    return float(f"{area:.2g}")


def sloping(cells: CellGrid, water: Water) -> str:
    """Text on the fall of a river, for messages."""
    east, north = water.level.gradient
    towards = math.degrees(math.atan2(-east, -north)) % 360
    return (
        f"{name_of(cells, water)} falls by {water.fall / cells.metre:.2f} m over "
        f"{water.length / cells.metre:.0f} m ({water.fall / water.length:.2%}) "
        f"towards {towards:.0f} degrees"
    )


def tell(cells: CellGrid, found: Sequence[Water]) -> None:
    """Log the bodies and their evidence; if there are many, the largest ones."""
    metre = cells.metre
    log.info(
        "%d water bodies in cells of %.2f m, of which narrower ones than %.1f m may be missing, as "
        "creeks and ditches; land has %.2g points per m2",
        len(found),
        cells.lattice.cell / metre,
        NARROW * cells.lattice.cell / metre,
        cells.density * metre**2,
    )
    for one in found[:LISTED]:
        log.info(
            "%s: level %.3f +- %s (95 %%), single points %.3f, from the %s; by %s: returns "
            "%.0f %% of those of its shore, intensities separate by %.2f (1 is fully)",
            name_of(cells, one),
            one.level.height,
            in_unit(cells, one.level.interval),
            one.level.sigma,
            one.level.basis,
            one.body.evidence,
            100 * one.body.lost,
            one.body.dark,
        )


def warn_of(cells: CellGrid, found: Sequence[Water]) -> None:
    """Log what is doubtful about bodies, of the largest ones if there are many."""
    metre = cells.metre
    for one in found[:LISTED]:
        if one.level.strips > DAYS * metre:
            log.warning(
                "points: %s has other levels in other strips: %s; they were flown at other "
                "times, or do not fit. Its level is the mean of its points, its shore that of each "
                "strip",
                name_of(cells, one),
                strip_levels(one.level),
            )
        if one.level.parts:
            log.warning(
                "points: %s stands at two levels side by side, %s and %s: flown at other "
                "times, strips that do not fit, or a step within a strip. Its level is the mean "
                "of its points; its interval holds both",
                name_of(cells, one),
                *(in_unit(cells, height) for height in one.level.parts.levels),
            )
        if one.level.cover and abs(np.subtract(*one.level.cover)) >= DAYS * metre:
            log.warning(
                "points: %s stands at %s where most pulses come back, or the brightest ones, "
                "and at %s elsewhere: floating plants or ice, returns that blind the scanner, or "
                "flights at other times. What covers water lies above it: a lake has the lower "
                "level, a river that of its points; its interval holds both",
                name_of(cells, one),
                *(in_unit(cells, height) for height in one.level.cover),
            )
        if _is_seen_on_top(one.body, one.level):
            log.warning(
                "points: little came back from %s, and no darker than land: it may be of leaves, "
                "foam or boats, with the water below. Its level is no surer than one return",
                name_of(cells, one),
            )
        if rise := _hidden(cells, one):
            log.warning(
                "points: too little came back from %s to tell its level, and half of its rim is "
                "%.1f m or more above its level: it may be a gap of the data, or its shore lies "
                "below crowns. Its interval holds levels that are as far below",
                name_of(cells, one),
                rise / metre,
            )
        elif len(some := shoreless(cells, one)) * cells.area >= LARGE * metre**2:
            log.warning(
                "points: about %.0f m2 of %s returned nothing, and all that is seen beside, of "
                "whatever class, is more than %g m above its level, as at %.1f,%.1f: crowns or "
                "decks that hide the ground, walls, a gap of the data, or a pool above a weir. It "
                "counts as water, but its outline may be no shore",
                _area_of(cells, some),
                name_of(cells, one),
                WALL,
                *_centre(cells, some),
            )
        if off := _off_banks(cells, one):
            log.warning(
                "points: too little came back from %s to tell its level, and the banks along a "
                "tenth of it or more tell levels that are %.2f m off the one it was given: pools "
                "above rapids or weirs, or walls, cliffs or crowns along a part of it. Its "
                "interval holds both",
                name_of(cells, one),
                off / metre,
            )
        if islands_hide(cells, one.body):
            log.warning(
                "points: %s has waves of %.2f m and is not much darker than its shore: islands "
                "of a cell or two cannot be told from waves, and its error counts both",
                name_of(cells, one),
                one.level.sigma / metre,
            )


def in_unit(cells: CellGrid, height: float, digits: int = 3) -> str:
    """A height or a difference of heights with the unit of the data."""
    return f"{height:.{digits}f} {cells.unit}".rstrip()


def with_hidden_shore(cells: CellGrid, water: Water) -> Water:
    """A water without returns with a larger error of its level if its shore does not tell that.

    The lowest beside a lake may be a crown or the edge of a gap; how far below that the water is
    nobody knows. The height of half of its rim is taken as the half width of the interval. Where
    the banks of a river tell other levels than that which was found, it is that far.
    """
    unsure = max(_hidden(cells, water), _off_banks(cells, water))
    error = math.hypot(water.level.error, unsure / NINETY_FIVE)
    return replace(water, level=replace(water.level, error=error))


def _hidden(cells: CellGrid, water: Water) -> float:
    """How high half of the rim of a lake without returns is, if that hides its shore; else 0."""
    rise = _rise(cells, water) if water.level.basis == "shore" else 0.0
    return rise if rise > WALL * cells.metre else 0.0


def _rise(cells: CellGrid, water: Water) -> float:
    """Median height of what is beside a lake above its level: little, where it has shores."""
    heights = cells.low.ravel()[around(cells.lattice, water.body.cells, 1)]
    heights = heights[np.isfinite(heights)]
    if water.fall or not len(heights):
        return 0.0
    return float(np.median(heights)) + cells.base - water.level.height


def _off_banks(cells: CellGrid, water: Water) -> float:
    """How far a tenth of a long water without returns is off its banks, if that is much; else 0."""
    some = water.body.cells
    if water.level.basis != "shore" or not is_long(cells, some):
        return 0.0
    laid = water.level.at(cells.centres(some)) - cells.base
    off = float(np.percentile(abs(along_banks(cells, some) - laid), OFF))
    return off if off > FALL * cells.metre else 0.0


def strip_levels(level: Level) -> str:
    """The strips that tell the level of a body, and the level of each."""
    return ", ".join(f"{number}: {height:.3f}" for number, height in level.of_strip)


def at_place(cells: CellGrid, found: Sequence[Water], place: Position) -> int:
    """Index of the body at a position.

    Raises
    ------
    DataError
        There is none.
    """
    lattice = cells.lattice
    r, c = (int(v[0]) for v in lattice.indices([place.x], [place.y]))
    away = []
    for one in found:
        rows, cols = one.body.cells // lattice.cols - r, one.body.cells % lattice.cols - c
        away.append(float(np.hypot(rows, cols).min()))
    nearest = int(np.argmin(away)) if away else -1
    if not away or away[nearest] > NEAR_PLACE:
        known = (
            f"the nearest is {name_of(cells, found[nearest])}, "
            f"{away[nearest] * lattice.cell / cells.metre:.0f} m away"
            if away
            else "there is no water body"
        )
        raise DataError(f"seed_point: no water body was found at {place}; {known}")
    return nearest
