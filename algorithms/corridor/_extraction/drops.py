"""Service drops: single wires from a pole to a house.

A drop is too short and too sparse to be followed, and no line goes on behind it. But where it
begins is known: at a pole, at about the height of the wires that this holds. So wires from there to
each point around that stands alone are tried, all that differ by more than points scatter. One is
taken if by chance a hundredth of one as unlikely is expected among all that were tried there.

References
----------
Desolneux, A., Moisan, L. and Morel, J.-M. (2000). Meaningful alignments. International Journal of
Computer Vision 40(1), 7-23: the number of false alarms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._curves.chance import chance
from algorithms.corridor._curves.network import Corridor, beside_of, is_on_roof, is_straight
from algorithms.corridor._curves.sparse import room
from algorithms.corridor._extraction import drops_kernels as kernels
from algorithms.corridor._extraction.missed import longest_by_chance
from algorithms.corridor._extraction.spans import Wire, on_any
from algorithms.corridor._extraction.supports import Support, is_pole
from algorithms.corridor._settings import SETTINGS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


def with_drops(
    corridor: Corridor, wires: Sequence[Wire], supports: Sequence[Support]
) -> list[Wire]:
    """The wires, and behind them the service drops from their poles, each a span of its own."""
    taken = np.zeros(len(corridor.air.xyz), bool)
    taken[on_any(corridor, wires)] = True
    clear = is_clear(corridor, wires)
    found = list(wires)
    for number, support in enumerate(supports):
        held = [wire for wire in wires if number in wire.supports]
        if not held or not is_pole(support.high - support.ground):
            continue
        own = around_pole(corridor, support, taken)
        ends = own[clear[own] & stand_alone(corridor, own, taken, held)]
        for curve in drops_of(corridor, support, held, own, ends, taken, clear):
            span, bundle, wire_id = (
                1 + max(getattr(wire, name) for wire in found)
                for name in ("span", "bundle", "wire")
            )
            found.append(
                Wire(
                    curve,
                    (number, -1),
                    (0.0, curve.length),
                    corridor.tolerance,
                    span,
                    bundle,
                    wire_id,
                    drop=True,
                )
            )
    return found


def around_pole(corridor: Corridor, support: Support, taken: Mask) -> Ints:
    """Indices of the points that may be of a drop from a pole: not of this, and on no wire."""
    place, air = np.array([support.x, support.y]), corridor.air
    near = air.within(place, SETTINGS.network.longest_missing)
    near = near[corridor.may[near] & ~taken[near]]
    away = np.hypot(*(air.xyz[near, :2] - place).T)
    own = (away > SETTINGS.arcs.arm_half_width) & (away < SETTINGS.network.longest_missing)
    return np.asarray(near[own])


def stand_alone(corridor: Corridor, own: Ints, taken: Mask, held: Sequence[Wire] = ()) -> Mask:
    """Which of some points have few others around them, those on wires not counted.

    Where the points are of a wire, it has as many on both sides of them as others of its pole, that
    is, of those that are `held`.
    """
    around = corridor.air.tree.query_ball_point(corridor.air.xyz[own], room())
    others = np.array([np.count_nonzero(~taken[near]) - 1 for near in around], np.int64)
    along = 2 * room() * max((wire.curve.count / wire.curve.length for wire in held), default=0.0)
    return others <= SETTINGS.sparse.company + along


def is_clear(corridor: Corridor, wires: Sequence[Wire]) -> Mask:
    """Which points above the ground are above or below no wire."""
    clear = np.ones(len(corridor.air.xyz), bool)
    for wire in wires:
        near = beside_of(corridor.air, wire.curve, corridor.own_radius)
        u, v, _ = wire.curve.residuals(corridor.air.xyz[near])
        below = (u >= 0) & (u <= wire.curve.length) & (np.abs(v) <= corridor.own_radius)
        clear[near[below]] = False
    return clear


def drops_of(
    corridor: Corridor,
    support: Support,
    held: Sequence[Wire],
    own: Ints,
    ends: Ints,
    taken: Mask,
    clear: Mask,
) -> list[Catenary]:
    """Service drops from a pole, the least accidental first; their points are taken.

    Parameters
    ----------
    held : the wires that the pole holds
    own : indices of the points that may be of a drop
    ends : of those to which wires are tried
    taken, clear : which points above the ground are on wires, and above or below none
    """
    radius, step = radius_of(held), SETTINGS.points.company_side / 2
    xyz, last = (np.ascontiguousarray(corridor.air.xyz[some]) for some in (own, ends))
    starts = np.arange(
        support.low - SETTINGS.arcs.arm_above,
        support.high + SETTINGS.arcs.arm_above + radius,
        radius,
    )
    shape = (
        radius,
        SETTINGS.arcs.arm_half_width,
        SETTINGS.towers.known_by_points * step,
        SETTINGS.trace.steepest,
        1 / SETTINGS.curves.smallest_c,
        SETTINGS.structures.bridge_sag,
        step,
    )
    filled, (start, bend) = np.zeros(len(last), np.int64), np.zeros((2, len(last)))
    tests = kernels.search(support.x, support.y, starts, xyz, last, shape, filled, start, bend)
    sure = math.log(SETTINGS.sparse.false_alarms) - math.log(max(1, tests))
    tried = []
    for i in np.flatnonzero(filled >= SETTINGS.towers.known_by_points).tolist():
        guess = between((support.x, support.y, start[i]), last[i], bend[i])
        drop = fitted(corridor, guess, radius, taken)
        if drop is not None:
            tried.append((chance(corridor, drop, radius, taken, step), i, drop))
    found = []
    for unlikely, _, drop in sorted(tried, key=lambda one: one[:2]):
        points, _ = corridor.air.around(drop, radius, SETTINGS.arcs.arm_half_width)  # not its pole
        if unlikely < sure and 2 * np.count_nonzero(clear[points] & ~taken[points]) > len(points):
            taken[corridor.air.around(drop, corridor.tolerance)[0]] = True
            found.append(drop)
    return found


def radius_of(held: Sequence[Wire]) -> float:
    """Metres around a drop within which its points are, as those of the wires of its pole are."""
    rms = max(SETTINGS.arcs.least_scatter, float(np.median([wire.curve.rms for wire in held])))
    return min(SETTINGS.spans.on_wire * rms, SETTINGS.lines.tolerances[0])


def between(start: tuple[float, float, float], end: Floats, bend: float) -> Catenary:
    """The wire of a curvature between two places."""
    dx, dy = float(end[0]) - start[0], float(end[1]) - start[1]
    length = math.hypot(dx, dy)
    ends = start[2], float(end[2])
    return Catenary(start[0], start[1], dx / length, dy / length, length, *ends, bend)


def fitted(corridor: Corridor, guess: Catenary, radius: float, taken: Mask) -> Catenary | None:
    """The catenary of a drop from the axis of its pole to what it ends at; None if it is no wire.

    Parameters
    ----------
    guess : from the axis to one of its points
    """
    air, beside = corridor.air, SETTINGS.arcs.arm_half_width
    near, _ = air.around(guess, radius + beside, 0.0, guess.length + radius)
    u, v, z = guess.residuals(air.xyz[near])
    room_aside = radius + beside * np.maximum(1 - u / guess.length, 0.0)
    own = near[(np.abs(z) < radius) & (np.abs(v) < room_aside) & ~taken[near]]
    count, curve, begin, end = -1, guess, 0.0, math.nan
    while len(own) > count:  # by the first curve others are found, near the pole and farther on
        count = len(own)
        known = guess.curvature if count <= SETTINGS.towers.known_by_points else None
        better = fit(
            air.xyz[own],
            spread=corridor.tolerance,
            curvature=known,
            scatter=radius / SETTINGS.spans.on_wire,
            sways=False,
        )
        if better is None:
            return None
        curve = better if better.ex * guess.ex + better.ey * guess.ey > 0 else turned(better)
        begin = float(curve.along(guess.ends[:1])[0][0])
        gap = gap_of(corridor, curve, own, begin)
        end = end_of(corridor, curve, radius, gap, SETTINGS.curves.clutter_radius / 2)
        own, _ = air.around(curve, radius, begin, curve.length + gap if math.isnan(end) else end)
        own = own[~taken[own]]
    rough = curve.rms > SETTINGS.curves.fine_rms * corridor.tolerance
    if rough or is_too_bent(curve) or is_straight(curve):
        return None
    if math.isnan(end):  # no wire ends in the air
        end = end_of(corridor, curve, radius, *known_ahead(curve))
    drop = curve.between(begin, curve.length if math.isnan(end) else end)
    return None if is_on_roof(corridor, drop) else drop


def is_too_bent(curve: Catenary) -> bool:
    """Whether a curve is surely tighter than any wire; a few points hardly tell."""
    slack = SETTINGS.curves.certain_sigmas * math.sqrt(curve.variance_of_curvature)
    return curve.curvature - slack > 1 / SETTINGS.curves.smallest_c


def turned(curve: Catenary) -> Catenary:
    """The same curve, which does not swing, from its other end."""
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    x, y, _ = curve.ends[1].tolist()
    return replace(
        curve,
        x=x,
        y=y,
        ex=-curve.ex,
        ey=-curve.ey,
        z_start=curve.z_end,
        z_end=curve.z_start,
        v0=0.0,
        covariance=None if curve.covariance is None else swap @ curve.covariance @ swap,
    )


def gap_of(corridor: Corridor, curve: Catenary, own: Ints, begin: float) -> float:
    """Metres beyond its last point in which a drop may go on without another.

    Parameters
    ----------
    own : indices of its points
    begin : where it begins along the curve
    """
    u, _ = curve.along(corridor.air.xyz[own])
    gaps = np.diff(np.sort(np.append(u, begin)))
    return min(longest_by_chance(gaps), SETTINGS.trace.seed_reach)


def known_ahead(curve: Catenary) -> tuple[float, float]:
    """Metres beyond its last point in which a drop is known to lead to bodies, and how near to it.

    What few points tell of its direction hardly counts beside what they tell of its height.
    """
    near = SETTINGS.curves.clutter_radius
    ahead = np.arange(
        0.0, SETTINGS.network.longest_missing - curve.length, SETTINGS.points.company_side / 2
    )
    off = SETTINGS.spans.on_wire * curve.height_sigma(curve.length + ahead)
    return float(ahead[off < near].max(initial=0.0)), near


def end_of(corridor: Corridor, curve: Catenary, radius: float, gap: float, reach: float) -> float:
    """Distance along a curve of the body at which it ends; NaN if none is within a gap ahead."""
    most = SETTINGS.towers.known_by_points
    near, away = corridor.air.around(curve, reach, 0.0, curve.length + gap)
    u, _ = curve.along(corridor.air.xyz[near])
    body = np.sort(u[(u > curve.length - reach) & ((away > radius) | (u > curve.length))])
    dense = np.flatnonzero(body[most - 1 :] - body[: len(body) - most + 1] < reach)
    # The first of them may be of the wire itself, a little beside the curve: the middle one tells.
    return float(body[dense[0] + most // 2]) if len(dense) else math.nan
