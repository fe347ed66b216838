"""Supports from arcs of wires: where wires are held or end together, and the body there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._curves.network import Corridor, Piece, heading
from algorithms.corridor._curves.tracks import Alignment
from algorithms.corridor._settings import SETTINGS

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Hint:
    """An end of an arc, which hints at a support."""

    place: Floats
    way: Floats  # unit vector out of the wire
    slope: float  # upwards that way
    piece: int
    held: bool  # another arc of its alignment begins there
    sigma: float  # standard deviation of its place along the wire, metres; infinite if not held
    cut: tuple[int, int]  # its alignment, and which cut of that
    whole: int  # the same of all lines abreast that were one alignment


@dataclass(frozen=True)
class Support:
    """A tower or pole.

    Attributes
    ----------
    x, y : of its axis
    across : unit vector along its arms, from south-west to north-east
    reach : of its arms to the back and front of `across`, metres
    low, high : height of its lowest and highest wire
    ground : height of the terrain
    body : share of its height at which points show
    legs : offsets along `across` of its bodies: two of a frame
    sd_along : standard deviation of its place along the line, metres; infinite if not known
    cuts : alignment and number of the cuts at which it stands
    chance : logarithm of the probability that no more of it is seen, by what is seen of the others
        of its line; 0 where enough is seen, or where nothing tells how much should be
    """

    x: float
    y: float
    across: tuple[float, float]
    reach: tuple[float, float]
    low: float
    high: float
    ground: float
    body: float
    legs: tuple[float, ...] = (0.0,)
    sd_along: float = math.inf
    cuts: frozenset[tuple[int, int]] = frozenset()
    chance: float = 0.0


def hints_of(pieces: Sequence[Piece], alignments: Sequence[Alignment]) -> Iterator[Hint]:
    """Hints at supports: cuts between arcs, and ends of alignments."""
    whole = {
        number: alignment.along(np.vstack([p.ends for p in pieces if p.arc[0] == number]))[0]
        for number, alignment in enumerate(alignments)
        if any(p.arc[0] == number for p in pieces)
    }
    for number, piece in enumerate(pieces):
        alignment, arc = alignments[piece.arc[0]], piece.arc[1]
        reach, ends = whole[piece.arc[0]], alignment.along(piece.ends)[0]
        stops = [-np.inf, *alignment.cuts, np.inf][arc : arc + 2]
        for end in (0, 1):
            after = int(ends[end] > ends[1 - end])
            u, stop = ends[end], stops[after]
            held = bool(np.isfinite(stop))
            sigma = float(alignment.sigmas[arc + after - 1]) if held else math.inf
            if not held:
                stop = reach.max() if after else reach.min()
            if abs(stop - u) > SETTINGS.supports.along:
                continue
            at = np.array([piece.curve.length * end])
            if held:
                at, _ = piece.curve.along(alignment.places(np.array([stop])))
            rise = float(np.diff(piece.curve.height(at + np.array([-0.5, 0.5])))[0])
            yield Hint(
                piece.curve.points(at)[0],
                heading(piece, end),
                rise if end else -rise,
                number,
                held,
                sigma,
                (piece.arc[0], arc + after),
                alignment.whole,
            )


def supports_of(
    corridor: Corridor, pieces: Sequence[Piece], alignments: Sequence[Alignment]
) -> list[Support]:
    """Supports where wires are held or end together.

    Parameters
    ----------
    corridor : whose points around the curves are taken
    """
    corridor.free[:] = True
    corridor.take(piece.curve for piece in pieces)
    hints = list(hints_of(pieces, alignments))
    found = []
    for group in clusters(hints):
        found += abreast(corridor, pieces, of_arms(corridor, pieces, group))
    return sorted(found, key=lambda s: (s.x, s.y))


def of_arms(corridor: Corridor, pieces: Sequence[Piece], group: Sequence[Hint]) -> list[Hint]:
    """The hints of a group without short arcs far below its highest, where no support has arms.

    Bracing of a tower, and twigs beside it, lie in arcs as well. A line of low poles that passes a
    tower does too, but its arcs are as long as spans.
    """
    top = max(group, key=lambda hint: hint.place[2]).place
    height = max(float(top[2] - corridor.ground(top[0], top[1])), 0.0)
    low = top[2] - (1 - SETTINGS.supports.lowest_arm) * height
    return [
        hint
        for hint in group
        if hint.place[2] >= low or pieces[hint.piece].curve.length >= SETTINGS.arcs.shortest_span
    ]


def abreast(corridor: Corridor, pieces: Sequence[Piece], group: Sequence[Hint]) -> list[Support]:
    """The support at hints, or those of lines abreast if each shows a body of its own."""
    lines: dict[tuple[int, int], list[Hint]] = {}
    for hint in group:
        lines.setdefault((hint.whole, hint.cut[0]), []).append(hint)
    if len(lines) > len({whole for whole, _ in lines}):
        apart = one_after_another(list(lines.values()))
        if len(apart) > 1:
            return [one for hints in apart for one in abreast(corridor, pieces, hints)]
        own = [support_of(corridor, pieces, hints) for hints in lines.values()]
        seen = [one for one in own if one and one.body >= SETTINGS.supports.enough_body]
        place = np.array([(one.x, one.y) for one in seen]).reshape(-1, 2)
        away = np.hypot(*(place[:, None] - place[None]).T) + np.diag(np.full(len(seen), math.inf))
        if len(seen) == len(lines) and away.min() > SETTINGS.network.join_aside:
            return seen
    one = support_of(corridor, pieces, group)
    return [] if one is None else [one]


def one_after_another(lines: Sequence[list[Hint]]) -> list[list[Hint]]:
    """Hints at supports of lines side by side, apart where no cut may be moved to the other.

    Lines were cut apart since the supports of one are not where those of the other are.
    """
    way = lines[0][0].way
    place = [float(np.median([hint.place[:2] @ way for hint in hints])) for hints in lines]
    order = np.argsort(place, kind="stable").tolist()
    found = [list(lines[order[0]])]
    for before, k in itertools.pairwise(order):
        if place[k] - place[before] > SETTINGS.arcs.most_shift:
            found.append([])
        found[-1] += lines[k]
    return found


def clusters(hints: Sequence[Hint]) -> Iterator[list[Hint]]:
    """Groups of hints near each other; the limit along the wires is smaller than that across.

    Where the wires of a line are held at one chainage, the limit across grows with the distances
    between them: no tower of three phases is three poles.
    """
    if not hints:
        return
    place = np.array([hint.place for hint in hints])
    way = np.array([hint.way for hint in hints])
    step = place[None, :, :2] - place[:, None, :2]
    along = np.abs((step * way[:, None]).sum(axis=2))
    across = np.abs(step[..., 0] * way[:, None, 1] - step[..., 1] * way[:, None, 0])
    reach = np.full(len(hints), SETTINGS.supports.across)
    for cut in {hint.cut for hint in hints}:
        mine = np.array([hint.cut == cut for hint in hints])
        reach[mine] = max(
            SETTINGS.supports.across,
            SETTINGS.supports.alike_gaps * usual_gap(place[mine], way[mine]),
        )
    near = (along < SETTINGS.supports.along) & (across < reach[:, None])
    alike = np.abs(way @ way.T) > 0.7
    link = near & near.T & alike
    _, label = connected_components(coo_array(link), directed=False)
    for number in range(label.max() + 1):
        yield [hints[i] for i in np.flatnonzero(label == number).tolist()]


def usual_gap(place: Floats, way: Floats) -> float:
    """Median distance across between neighbouring wires, those of a bundle or column as one."""
    side = np.sort(place[:, 1] * way[0, 0] - place[:, 0] * way[0, 1])
    gaps = np.diff(side)
    gaps = gaps[gaps > SETTINGS.arcs.arm_aside]
    return float(np.median(gaps)) if len(gaps) else 0.0


def support_of(
    corridor: Corridor, pieces: Sequence[Piece], group: Sequence[Hint]
) -> Support | None:
    """The support at a group of hints, or None if the evidence is too weak."""
    group = at_bend(group)
    place = np.array([hint.place for hint in group])
    way = np.array([hint.way for hint in group])
    mean = axis_of(way)
    across = np.array([-mean[1], mean[0]])
    centre = place[:, :2].mean(axis=0)
    side = (place[:, :2] - centre) @ across
    forward = way @ mean > 0
    here, there = np.flatnonzero(forward), np.flatnonzero(~forward)
    pairs = list(pairs_of(place, way))
    bend = 0.0
    for i, j in pairs:
        turn = abs(way[i, 0] * way[j, 1] - way[i, 1] * way[j, 0])
        bend = max(bend, turn, group[i].slope + group[j].slope)
    mine = {hint.piece for hint in group}
    others = [piece for k, piece in enumerate(pieces) if k not in mine]
    passing = sum(passes(piece.curve, centre, across, side, place[:, 2]) for piece in others)
    if passing > len(mine):
        return None
    # The middle between opposite ends, or where the ends are.
    forth = (place[:, :2] - centre) @ mean
    if len(here) and len(there):
        middle = 0.5 * (np.median(forth[here]) + np.median(forth[there]))
    else:
        middle = float(np.median(forth))
    spot = centre + middle * mean
    low, high = float(place[:, 2].min()), float(place[:, 2].max())
    bottom = float(corridor.ground(spot[0], spot[1]))
    certain = any(hint.held for hint in group)
    slack = SETTINGS.supports.settled_slack if certain else SETTINGS.arcs.most_shift
    sigma = min(hint.sigma for hint in group)
    body, spot, seen = body_at(corridor, spot, mean, (side.min(), side.max()), high - bottom, slack)
    if certain and body < SETTINGS.supports.enough_body:
        body, spot, seen = pole_near(corridor, spot, mean, side, high - bottom) or (
            body,
            spot,
            seen,
        )
    certain |= len(pairs) >= 2 or (
        len(pairs) == 1
        and (body >= SETTINGS.supports.enough_body or bend > SETTINGS.supports.least_bend)
    )
    if not pairs and not certain:
        out = mean if len(here) else -mean
        ends = forth[here if len(here) else there]
        # The data goes on behind all the wires: one tree over its edge does not tell.
        gap = gap_by_chance([pieces[hint.piece] for hint in group])
        steps = (7.0, *np.arange(SETTINGS.supports.along, max(SETTINGS.supports.along, gap) + 1.0))
        beyond = all(corridor.seen(*(p[:2] + m * out)) for p in place for m in steps)
        certain = len(ends) >= 2 and np.ptp(ends) < 6 and beyond
        certain |= body >= much_body(high - bottom) and topped(corridor, spot, mean, side, high)
    if not certain:
        return None
    shift = (spot - centre) @ across
    side = side - shift
    return Support(
        float(spot[0]),
        float(spot[1]),
        (float(across[0]), float(across[1])),
        (float(side.min()), float(side.max())),
        low,
        high,
        float(corridor.ground(spot[0], spot[1])),
        body,
        sd_along=min(sigma, seen),
        cuts=frozenset(hint.cut for hint in group if hint.held),
    )


def gap_by_chance(pieces: Sequence[Piece]) -> float:
    """Metres that wires side by side go on without a point in one case of a hundred by chance.

    Points of all are a Poisson process, as dense as they were seen.
    """
    per_metre = sum(len(piece.points) / piece.curve.length for piece in pieces)
    return -math.log(SETTINGS.sparse.false_alarms) / per_metre


def axis_of(way: Floats) -> Floats:
    """The mean of directions that lead to and fro, a unit vector."""
    mean = (way * np.sign(way @ way[0] + 1e-12)[:, None]).mean(axis=0)
    return np.asarray(mean / np.hypot(*mean))


def pairs_of(place: Floats, way: Floats) -> Iterator[tuple[int, int]]:
    """Hints at one wire before a support and behind it, those that fit each other best."""
    mean = axis_of(way)
    spot = np.column_stack([place[:, 1] * mean[0] - place[:, 0] * mean[1], place[:, 2]])
    forward = way @ mean > 0
    here, there = np.flatnonzero(forward), np.flatnonzero(~forward)
    away = np.abs(spot[here, None] - spot[None, there])
    near = away.max(axis=2) < 3.0
    cost = np.where(near, away.sum(axis=2), 1e6)  # first as many pairs as there can be
    for i, j in zip(*linear_sum_assignment(cost), strict=True):
        if near[i, j]:
            yield int(here[i]), int(there[j])


def at_bend(group: Sequence[Hint]) -> Sequence[Hint]:
    """Hints where two legs of a line end, drawn on to where their wires cross in plan.

    Of a line that hardly turns nothing is known of that, and they stay as they are.
    """
    if any(hint.held for hint in group):
        return group
    place = np.array([hint.place for hint in group])
    way = np.array([hint.way for hint in group])
    pairs = np.array(list(pairs_of(place, way)), np.int64).reshape(-1, 2)
    mean = axis_of(way)
    forth = place[:, :2] @ mean
    one, other = pairs.T
    step = place[other, :2] - place[one, :2]
    turn = way[one, 0] * way[other, 1] - way[one, 1] * way[other, 0]
    ahead = step[:, 0] * way[other, 1] - step[:, 1] * way[other, 0]  # times the turn
    weight = float((turn**2).sum())
    if not weight:
        return group
    crossing = float((turn**2 * forth[one] + turn * ahead).sum()) / weight
    missed = turn * (forth[one] - crossing) + ahead  # by wires at the crossing of all, metres
    scatter = max(SETTINGS.arcs.meeting_sd, math.sqrt(0.5 * float((missed**2).mean())))
    sigma = scatter * math.sqrt(2 / weight)
    if sigma > SETTINGS.supports.settled_slack:
        return group
    gone = (crossing - forth) / (way @ mean)
    if np.abs(gone).max() > SETTINGS.supports.along:
        return group
    drawn = place + gone[:, None] * np.column_stack([way, [hint.slope for hint in group]])
    return [replace(hint, place=p, sigma=sigma) for hint, p in zip(group, drawn, strict=True)]


def topped(corridor: Corridor, spot: Floats, mean: Floats, side: Floats, high: float) -> bool:
    """Whether a body reaches the height of the highest wire, with points thin along the line."""
    near = corridor.air.within(spot, SETTINGS.supports.along + float(np.ptp(side)))
    near = near[corridor.free[near]]
    away = np.abs((corridor.air.xyz[near, :2] - spot) @ mean)
    z = corridor.air.xyz[near, 2]
    away = away[(z > high - 2) & (z < high + 4)]
    here = np.count_nonzero(away < SETTINGS.curves.clutter_radius)
    return bool(
        here >= 3
        and here
        > np.count_nonzero(
            (away > SETTINGS.curves.clutter_radius) & (away < 3 * SETTINGS.curves.clutter_radius)
        )
    )


def passes(curve: Catenary, centre: Floats, across: Floats, side: Floats, heights: Floats) -> bool:
    """Whether a wire passes a supposed support without being held there."""
    u, _ = curve.along(np.array([[*centre, 0.0]]))
    inner = SETTINGS.network.telling_length
    if not inner < u[0] < curve.length - inner:
        return False
    return within_reach(curve, u, centre, across, side, heights)


def within_reach(
    curve: Catenary, u: Floats, centre: Floats, across: Floats, side: Floats, heights: Floats
) -> bool:
    """Whether a wire at a chainage could be held by a support with arms there."""
    x, y, z = curve.points(u)[0]
    s = (np.array([x, y]) - centre) @ across
    half = SETTINGS.supports.across / 2
    beside = side.min() - half < s < side.max() + half
    return bool(beside and heights.min() - half < z < heights.max() + half)


def is_pole(height: float) -> bool:
    """Whether a support of this height in metres is a pole, which has no width, and no tower."""
    return height < SETTINGS.supports.tallest_pole


def much_body(height: float) -> float:
    """Share of the height at which a support shows where nothing else tells of it."""
    settings = SETTINGS.supports
    return settings.much_body_pole if is_pole(height) else settings.much_body_tower


def is_seen(support: Support) -> bool:
    """Whether so much of a support is seen that it is known without its wires, and its place."""
    much = support.body >= much_body(support.high - support.ground)
    return much and support.sd_along <= SETTINGS.supports.settled_slack


def may_hold(support: Support, curve: Catenary) -> bool:
    """Whether a wire passes a support, or ends near it, so that it could be held there."""
    place = np.array([support.x, support.y])
    u, _ = curve.along(np.array([[*place, 0.0]]))
    if not -SETTINGS.supports.along < u[0] < curve.length + SETTINGS.supports.along:
        return False
    heights = np.array([support.low, support.high])
    across, side = np.array(support.across), np.array(support.reach)
    return within_reach(curve, u, place, across, side, heights)


def arms_in_plan(support: Support) -> Floats:
    """Both ends of the arms of a support, array of shape (2, 2)."""
    foot = np.array([support.x, support.y])
    return np.asarray(foot + np.outer(support.reach, support.across))


def body_at(
    corridor: Corridor,
    spot: Floats,
    mean: Floats,
    sides: tuple[float, float],
    top: float,
    slack: float,
) -> tuple[float, Floats, float]:
    """Share of the height over which a vertical body has points, and its position in plan.

    With them comes the standard deviation of that position along the line, infinite if too little
    of a body is seen to tell it.
    """
    air = corridor.air
    reach = SETTINGS.supports.along + abs(sides[1] - sides[0])
    near = air.within(spot, reach)
    near = near[corridor.free[near]]
    if not len(near):
        return 0.0, spot, math.inf
    across = np.array([-mean[1], mean[0]])
    step = air.xyz[near, :2] - spot
    along, side, height = step @ mean, step @ across, corridor.height[near]
    keep = (np.abs(along) < 6) & (side > sides[0] - 2) & (side < sides[1] + 2)
    keep &= (height > 1) & (height < top)
    along, side, height = along[keep], side[keep], height[keep]
    half = 1.0 if top < SETTINGS.supports.tallest_pole else 2.5
    levels = max(1, int(top - 1))
    best, at, sigma = 0.0, spot, math.inf
    for a in np.arange(-slack, slack + 0.5, 1.0):
        for s in np.arange(math.floor(sides[0]) - 1, sides[1] + 2, 1.0):
            inside = (np.abs(along - a) < half) & (np.abs(side - s) < half)
            share = len(np.unique(height[inside].astype(np.int64))) / levels
            share -= 0.002 * math.hypot(a, s)
            if share > best:
                best = share
                at = spot + np.median(along[inside]) * mean + np.median(side[inside]) * across
                sigma = sd_of_median(along[inside])
    if best < SETTINGS.supports.enough_body:
        return best, spot, math.inf
    return min(best, 1.0), at, sigma


def pole_near(
    corridor: Corridor, spot: Floats, mean: Floats, side: Floats, top: float
) -> tuple[float, Floats, float] | None:
    """The pole nearby that a cut in a wrong place belongs to, as :func:`body_at` tells of one.

    It stands by itself below the wires: in a thin column are more points than around it, at enough
    of the metres, in its lower half as well. Of towers much more is seen, so they are not missed.
    """
    if not is_pole(top):
        return None
    room, reach = SETTINGS.curves.clutter_radius, SETTINGS.arcs.most_shift
    near = corridor.air.within(spot, reach + room + float(np.abs(side).max()))
    near = near[corridor.free[near] & (corridor.height[near] > 1) & (corridor.height[near] < top)]
    xy, height = corridor.air.xyz[near, :2], corridor.height[near]
    along, aside = (xy - spot) @ mean, (xy - spot) @ np.array([-mean[1], mean[0]])
    below = (np.abs(along) < reach) & (aside > side.min() - room) & (aside < side.max() + room)
    best = None
    for k in np.flatnonzero(below).tolist():
        away = np.hypot(*(xy - xy[k]).T)
        own = away < SETTINGS.towers.lattice_width
        share = len(np.unique(height[own].astype(np.int64))) / max(1, int(top - 1))
        stands = height[own].min() < top / 2
        stands &= 2 * np.count_nonzero(own) > np.count_nonzero(away < room)
        if stands and share >= max(SETTINGS.supports.enough_body, best[0] if best else 0.0):
            best = share, np.median(xy[own], axis=0), sd_of_median(along[own])
    return best


def sd_of_median(values: Floats) -> float:
    """Standard deviation of the median of values with normal errors; infinite for fewer than two.

    The variance of that of n is pi / 2 times that of the mean.
    """
    if len(values) < 2:
        return math.inf
    return float(values.std(ddof=1)) * math.sqrt(math.pi / 2 / len(values))
