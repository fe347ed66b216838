"""Power lines along a route: where supports stand, how high, and the wires between them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Literal

import numpy as np

from algorithms.samples._corridor.catenary import Catenary
from algorithms.samples._corridor.heads import SINGLE, Bundle, Conductor, Head
from algorithms.samples._corridor.routes import Range, Route, drawn, straight
from algorithms.samples._corridor.site import Frame, Site, Support, Wire, rods
from algorithms.samples._corridor.supports import SUPPORTS, cross_arms
from algorithms.samples._survey import CONNECTOR, GUARD, TOWER, Floats

STRING_RADIUS = 0.1  # with half a footprint of the laser, m
GUARD_TAUTER = 1.3  # sag of guard wires, which must not touch conductors, is less by this factor


@dataclass(frozen=True)
class Line:
    """One power line; the seed chooses between the limits of each range.

    Attributes
    ----------
    support : name among SUPPORTS
    head : conductors, from the top of the support
    height : of the supports, metres; they become higher where the ground asks for it
    span : distance between supports, metres
    c : tension over weight, metres
    string : length of the insulators, metres; below 0 they stand on the arm
    bundle : subconductors of each phase
    offset : of the line to the left of the route, metres
    begins, ends : shares of the route; inside it the line has dead ends there
    dead_end : name among SUPPORTS of a support where the line ends, if it is another
    every : each how many supports wires are fixed (0 for bends and ends only)
    jumpers : wires hang in loops below the arms where they are fixed
    clear : lowest height of a wire above the ground, metres
    way : along the route of the scene, across it, or from one of its supports aside
    at, angle : share of the route where the line crosses or leaves it, and the angle, degrees
    reach : length of a line that crosses or leaves, metres
    posts : shares of the route at which supports stand, instead of `span`
    """

    support: str
    head: Head
    height: Range
    span: Range
    c: Range
    _: KW_ONLY
    string: float = 1.8
    bundle: Bundle = SINGLE
    offset: float = 0.0
    begins: float = 0.0
    ends: float = 1.0
    dead_end: str = ""
    every: int = 0
    jumpers: bool = False
    clear: float = 6.0
    way: Literal["along", "across", "aside"] = "along"
    at: float = 0.5
    angle: Range = (60.0, 90.0)
    reach: float = 250.0
    posts: tuple[float, ...] = ()


@dataclass(frozen=True)
class Course:
    """Where a line runs, and the chainages of its supports; some lie beyond the survey."""

    line: Line
    route: Route
    chainages: Floats
    fixed: frozenset[int]  # numbers of the supports at which wires are fixed


def courses(lines: Sequence[Line], route: Route, rng: np.random.Generator) -> list[Course]:
    """Routes and supports of lines; those that cross or leave go by the supports of the first."""
    made: list[Course] = []
    for line in lines:
        own = route.beside(line.offset)
        if line.way != "along":
            own = _elsewhere(line, made[0], rng)
        made.append(_course(line, own, rng))
    return made


def _elsewhere(line: Line, first: Course, rng: np.random.Generator) -> Route:
    """Route of a line that crosses the first one in the middle of a span, or leaves a support."""
    chainages, wanted = first.chainages, line.at * first.route.length
    turn = np.radians(float(rng.choice((-1, 1))) * drawn(rng, line.angle))
    if line.way == "across":
        middles = (chainages[1:] + chainages[:-1]) / 2
        place = float(middles[np.argmin(np.abs(middles - wanted))])
        hx, hy = first.route.heading(place)
        return straight(first.route.place(place), np.arctan2(hy, hx) + turn, line.reach)
    place = float(chainages[np.argmin(np.abs(chainages - wanted))])
    hx, hy = first.route.heading(place)
    start, heading = first.route.place(place), np.arctan2(hy, hx) + turn
    end = start + line.reach * np.array([np.cos(heading), np.sin(heading)])
    return Route(np.array([start, end]))


def _course(line: Line, route: Route, rng: np.random.Generator) -> Course:
    """Choose where the supports stand: at bends, and between them at about equal distances."""
    if line.posts:
        posts = np.array(line.posts) * route.length
        return Course(line, route, posts, frozenset({0, len(posts) - 1}))
    span = drawn(rng, line.span)
    first, last = _ends(line, route, span, rng)
    bends = [c for c in route.corners[1:-1] if first + 0.3 * span < c < last - 0.3 * span]
    chainages = [first]
    for start, end in itertools.pairwise([first, *bends, last]):
        count = max(1, round((end - start) / span))
        if line.way == "across":
            count += 1 - count % 2  # a span in the middle, and no support
        inner = start + (end - start) * np.arange(1, count) / count
        chainages += [*(inner + rng.uniform(-0.1, 0.1, count - 1) * (end - start) / count), end]
    fixed = {k for k, c in enumerate(chainages) if c in bends}
    if line.every:
        fixed |= set(range(0, len(chainages), line.every))
    return Course(line, route, np.array(chainages), frozenset(fixed | {0, len(chainages) - 1}))


def _ends(line: Line, route: Route, span: float, rng: np.random.Generator) -> tuple[float, float]:
    """Chainages of the first and last support: beyond the survey, or inside it at a dead end."""
    beyond = np.maximum(rng.uniform(0.2, 0.8, 2) * span, 12.0)
    first = line.begins * route.length if line.begins > 0 else -beyond[0]
    last = line.ends * route.length if line.ends < 1 else route.length + beyond[1]
    return (0.0 if line.way == "aside" else float(first)), float(last)


# --- supports ------------------------------------------------------------------------------


def build(site: Site, made: Sequence[Course]) -> None:
    """Build lines with their supports and wires."""
    first: list[Support] = []
    for number, course in enumerate(made, start=1):
        line = course.line
        c = drawn(site.rng, line.c)
        supports = _supports(site, course, c, first)
        first = first or supports
        for k, support in enumerate(supports):
            if k == 0 and line.way == "aside":
                cross_arms(_frame(site, support), line.head, support.height)
            else:
                _raise(site, course, support, at_end=k in (0, len(supports) - 1))
        _hang_all(site, course, supports, c, f"line {number}")


def _supports(site: Site, course: Course, c: float, shared: Sequence[Support]) -> list[Support]:
    """The supports of a line; one that leaves another line begins at a support of that."""
    line, route = course.line, course.route
    supports = []
    for k, chainage in enumerate(course.chainages):
        place, left = route.place(float(chainage)), route.left(float(chainage))
        if k == 0 and line.way == "aside":
            nearest = min(shared, key=lambda s: float(np.hypot(s.x - place[0], s.y - place[1])))
            supports.append(replace(nearest, left=left, tension=True))
            continue
        site.towers += 1
        x, y = place
        height = drawn(site.rng, line.height)
        tower, owner = site.towers, site.builder.new_object()
        fixed = k in course.fixed
        supports.append(Support(tower, owner, x, y, site.ground(place), height, left, fixed))
    return _high_enough(site, line, supports, c)


def _high_enough(site: Site, line: Line, supports: list[Support], c: float) -> list[Support]:
    """Raise supports by as much as their wires would come too near to the ground."""
    lift = np.zeros(len(supports))
    for k, ends in enumerate(itertools.pairwise(supports)):
        curves = [_curve(line, conductor, ends, c, (0.0, 0.0)) for conductor in line.head]
        places = np.concatenate([curve.points(1.0) for curve in curves])
        inside = places[site.covers(places)]
        if len(inside):
            ground = site.builder.terrain.at(inside[:, 0], inside[:, 1])
            short = line.clear - float((inside[:, 2] - ground).min())
            lift[k : k + 2] = np.maximum(lift[k : k + 2], short)
    return [replace(s, height=s.height + float(up)) for s, up in zip(supports, lift, strict=True)]


def _raise(site: Site, course: Course, support: Support, *, at_end: bool) -> None:
    """Draw a support, and tell of it if it stands in the survey."""
    line = course.line
    kind = line.dead_end if at_end and line.dead_end else line.support
    SUPPORTS[kind](_frame(site, support), line.head, support.height)
    if site.covers(np.array([[support.x, support.y]]))[0]:
        site.builder.claim(support.x, support.y, 0.0, a=1.5, b=1.5)
        site.tell_of_tower(support, kind)


def _frame(site: Site, support: Support) -> Frame:
    return Frame(
        site,
        support.x,
        support.y,
        support.ground,
        support.left,
        support.object_id,
        TOWER,
        support.tower_id,
    )


# --- wires ---------------------------------------------------------------------------------


def _hang_all(site: Site, course: Course, supports: Sequence[Support], c: float, name: str) -> None:
    """Hang all wires of a line, span by span; a wire keeps its number."""
    line = course.line
    ends = course.chainages[1:] / course.route.length
    before: dict[int, Wire] = {}
    number = site.wire_ids
    for k, (one, two) in enumerate(itertools.pairwise(supports)):
        site.spans += 1
        towers = one.tower_id, two.tower_id
        number, now = site.wire_ids, {}
        for conductor in line.head:
            tauter = GUARD_TAUTER if conductor.cls == GUARD else 1.0
            bundle = SINGLE if conductor.cls == GUARD else line.bundle
            for shift in bundle:
                number += 1
                if conductor.until < 1 and ends[k] > conductor.until:
                    continue
                curve = _curve(line, conductor, (one, two), c * tauter, shift)
                now[number] = site.hang(curve, conductor.cls, number, name, towers)
            if conductor.cls != GUARD and number in now:
                _strings(site, line, conductor, (one, two), first=k == 0)
        if line.jumpers and one.tension:
            for each in before.keys() & now.keys():
                if now[each].cls != GUARD:
                    _jumper(site, one, before[each].curve, now[each].curve, line.string)
        before = now
    site.wire_ids = number


def _tip(support: Support, conductor: Conductor) -> Floats:
    """Where a conductor is held at the arm."""
    x, y = np.array([support.x, support.y]) + conductor.aside * support.left
    return np.array([x, y, support.ground + support.height - conductor.below])


def _string(line: Line, conductor: Conductor, support: Support, way: Floats) -> Floats:
    """From the arm to the wire, along the string of insulators."""
    if conductor.cls == GUARD:
        return np.zeros(3)
    if support.tension:
        return np.asarray(abs(line.string) * way)
    return np.array([0.0, 0.0, -line.string])


def _curve(
    line: Line,
    conductor: Conductor,
    ends: tuple[Support, Support],
    c: float,
    shift: tuple[float, float],
) -> Catenary:
    """The wire of a conductor between two supports, moved aside and up in its bundle."""
    tips = [_tip(support, conductor) for support in ends]
    ahead = _ahead(tips)
    places = []
    for support, tip, way in zip(ends, tips, (ahead, -ahead), strict=True):
        aside = np.array([*(shift[0] * support.left), shift[1]])
        x, y, z = tip + _string(line, conductor, support, way) + aside
        places.append((float(x), float(y), float(z)))
    return Catenary(places[0], places[1], c)


def _ahead(tips: Sequence[Floats]) -> Floats:
    """Unit vector in plan from the first to the second."""
    step = (tips[1] - tips[0])[:2]
    return np.array([*(step / np.hypot(*step)), 0.0])


def _strings(
    site: Site, line: Line, conductor: Conductor, ends: tuple[Support, Support], *, first: bool
) -> None:
    """Insulators at both ends of a span; one from which wires hang serves two spans."""
    tips = [_tip(support, conductor) for support in ends]
    ahead = _ahead(tips)
    for k, (support, way) in enumerate(zip(ends, (ahead, -ahead), strict=True)):
        if k == 0 and not support.tension and not first:
            continue
        end = tips[k] + _string(line, conductor, support, way)
        site.rods.append(
            rods(
                np.array([end, tips[k]]),
                STRING_RADIUS,
                CONNECTOR,
                support.object_id,
                tower=support.tower_id,
            )
        )


def _jumper(site: Site, support: Support, one: Catenary, two: Catenary, string: float) -> None:
    """A loop below the arm, from the end of one string to that of the next."""
    a, b = np.array(one.end), np.array(two.start)
    t = np.linspace(0, 1, 13)[:, None]
    places = a + t * (b - a)
    places[:, 2] -= 0.9 * abs(string) * (1 - (2 * t[:, 0] - 1) ** 4)
    site.rods.append(rods(places, 0.06, CONNECTOR, support.object_id, tower=support.tower_id))
