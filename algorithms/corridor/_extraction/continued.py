"""Wires with few points, completed from the wires of the neighbouring spans.

Where a wire hangs from a support it goes on behind it, beside the others of the line as it was
before. So both ends of a wire that has too few points to be followed are known, and so is its
curvature, from the spans around and from the wires beside it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._extraction.spans import (
    Wire,
    apart_wires,
    end_at,
    numbered,
    to_supports,
    usual_curvature,
)
from algorithms.corridor._extraction.supports import Support
from algorithms.corridor._settings import SETTINGS

Floats = NDArray[np.float64]


def completed(corridor: Corridor, wires: Sequence[Wire], supports: Sequence[Support]) -> list[Wire]:
    """The wires numbered, with those added that the neighbouring spans imply."""
    found = numbered(carried_on(corridor, wires, supports), supports)
    chains: dict[int, list[Wire]] = {}
    for wire in found:
        chains.setdefault(wire.wire, []).append(wire)
    better = found
    if corridor.tolerance > SETTINGS.sparse.stack_tolerance:  # else all of a span are known as one
        better = [stiffened(corridor, wire, chains, found, supports) for wire in found]
    return [wire for wire in (as_far(corridor, wire, better) for wire in better) if leads(wire)]


def same_wire(corridor: Corridor) -> float:
    """Metres between two wires at a support that are one; wires above each other are closer."""
    return min(SETTINGS.continued.same_wire, corridor.own_radius)


def leads(wire: Wire) -> bool:
    """Whether both ends of a wire are well known, and its swing is possible."""
    ends = wire.curve.height_sigma(np.array([0.0, wire.curve.length]))
    return bool(
        ends.max() < SETTINGS.continued.lost_end
        and abs(wire.curve.swing) < SETTINGS.curves.largest_swing
    )


# --- wires that were not found in a span ---------------------------------------------------


def carried_on(
    corridor: Corridor, wires: Sequence[Wire], supports: Sequence[Support]
) -> list[Wire]:
    """The wires, with those added that a wire of a neighbouring span must continue in."""
    found = list(wires)
    fresh = True
    while fresh:
        fresh = False
        for span in sorted({wire.span for wire in found}):
            for number, place in missing(found, span, same_wire(corridor)):
                wire = expected(corridor, found, span, number, place, supports)
                if wire is not None:
                    found.append(wire)
                    fresh = True
    return found


def missing(wires: Sequence[Wire], span: int, same: float) -> Iterator[tuple[int, Floats]]:
    """Supports, and attachment points there that wires of another span have, but not this one."""
    own = [wire for wire in wires if wire.span == span]
    for number in sorted({n for wire in own for n in wire.supports if n >= 0}):
        mine = [end_at(wire, number) for wire in own if number in wire.supports]
        for other in sorted({w.span for w in wires if number in w.supports} - {span}):
            theirs = [end_at(w, number) for w in wires if w.span == other and number in w.supports]
            away = np.linalg.norm(np.array(theirs)[:, None] - np.array(mine)[None], axis=2)
            if away.min() < same:  # else another line ends there
                met = set(linear_sum_assignment(away)[0].tolist())
                yield from ((number, p) for k, p in enumerate(theirs) if k not in met)


def expected(
    corridor: Corridor,
    wires: Sequence[Wire],
    span: int,
    number: int,
    place: Floats,
    supports: Sequence[Support],
) -> Wire | None:
    """The wire of a span from a given attachment point, if points lie where it must be."""
    same = same_wire(corridor)
    own = [wire for wire in wires if wire.span == span and number in wire.supports]
    near = min(own, key=lambda wire: float(np.linalg.norm(end_at(wire, number) - place)))
    if np.linalg.norm(end_at(near, number) - place) < same:
        return None
    far, known = other_end(wires, near, number, place, supports, same)
    places = np.array([place, far] if near.supports[0] == number else [far, place])
    bend = known_curvature(own, wires)
    if bend is None:
        return None
    guess = hung(places, replace(near.curve, curvature=bend))
    if any(apart_wires(guess, wire.curve) < same for wire in own):
        return None
    xyz = points_of(corridor, guess, 6 * SETTINGS.lanes.wander, own)
    inner = xyz[guess.away(xyz) < same]
    usual = float(np.median([wire.curve.count for wire in own]))
    few = len(inner) < max(
        SETTINGS.continued.share * usual, 0 if known else SETTINGS.continued.points
    )
    if few or 2 * len(inner) < len(xyz):
        return None
    curve = (
        fit(
            np.vstack([places, inner]),
            spread=same,
            curvature=guess.curvature,
        )
        or guess
    )
    along, _ = curve.along(inner)
    seen = (float(along.min()), float(along.max())) if len(inner) else (0.0, 0.0)
    made = replace(near, curve=replace(curve, count=len(inner)), known=seen)
    return replace(turned(made, near), bundle=max(wire.bundle for wire in wires) + 1)


def known_curvature(*wires: Sequence[Wire]) -> float | None:
    """The curvature of the first of several groups of wires that tells it; None if none does."""
    for some in wires:
        mean, sigma = usual_curvature(some)
        if sigma <= SETTINGS.fit.known_curvature * mean:
            return mean
    return None


def other_end(
    wires: Sequence[Wire],
    near: Wire,
    number: int,
    place: Floats,
    supports: Sequence[Support],
    same: float,
) -> tuple[Floats, bool]:
    """Far end of a wire by the wire next to it, and whether wires of other spans meet it there."""
    first = near.supports[0] == number
    step = place - end_at(near, number)
    other = near.supports[1 if first else 0]
    here = np.array(supports[number].across)
    there = np.array(supports[other].across) if other >= 0 else here
    aside = float(step[:2] @ here) * there * np.sign(there @ here)
    far = near.curve.ends[1 if first else 0] + np.append(aside, step[2])
    places = [end_at(w, other) for w in wires if w.span != near.span and other in w.supports]
    close = [p for p in places if other >= 0 and np.linalg.norm(p - far) < 2 * same]
    if not close:
        return far, False
    return min(close, key=lambda p: float(np.linalg.norm(p - far))), True


def points_of(corridor: Corridor, curve: Catenary, radius: float, others: Sequence[Wire]) -> Floats:
    """Points within a radius of a curve that are nearer to it than to other wires, shape (n, 3)."""
    xyz = corridor.wires.xyz[corridor.wires.around(curve, radius)[0]]
    for other in others:
        xyz = xyz[other.curve.away(xyz) > curve.away(xyz)]
    return xyz


def hung(ends: Floats, like: Catenary) -> Catenary:
    """A catenary between two positions with the curvature of another one."""
    step = ends[1] - ends[0]
    length = math.hypot(step[0], step[1])
    return Catenary(
        float(ends[0, 0]),
        float(ends[0, 1]),
        float(step[0] / length),
        float(step[1] / length),
        length,
        float(ends[0, 2]),
        float(ends[1, 2]),
        like.curvature,
        rms=like.rms,
        covariance=like.covariance,
    )


def turned(wire: Wire, like: Wire) -> Wire:
    """A wire whose supports are swapped if its curve runs against that of another wire."""
    same = wire.curve.ex * like.curve.ex + wire.curve.ey * like.curve.ey > 0
    return replace(wire, supports=like.supports if same else like.supports[::-1])


# --- wires of which little is known --------------------------------------------------------


def stiffened(
    corridor: Corridor,
    wire: Wire,
    chains: dict[int, list[Wire]],
    wires: Sequence[Wire],
    supports: Sequence[Support],
) -> Wire:
    """A wire; if it is vague, fitted again with ends and curvature of the neighbouring spans.

    If these are as vague, the curvature is that of the wires beside it.
    """
    beside = [other for other in wires if other.span == wire.span and other is not wire]
    mean, sigma = usual_curvature(chains[wire.wire])
    if sigma > SETTINGS.fit.known_curvature * mean:
        numbers = {other.wire for other in (wire, *beside)}
        mean, sigma = usual_curvature([w for number in sorted(numbers) for w in chains[number]])
    ends = wire.curve.height_sigma(np.array([0.0, wire.curve.length]))
    clear = (
        ends.max() < SETTINGS.continued.loose_end
        and wire.curve.variance_of_curvature < (SETTINGS.fit.known_curvature * mean) ** 2
    )
    if clear or sigma > SETTINGS.fit.known_curvature * mean:
        return wire
    xyz = points_of(corridor, wire.curve, SETTINGS.continued.same_wire, beside)
    anchors = [
        end_at(other, number)
        for other in chains[wire.wire]
        for number in wire.supports
        if other is not wire and number >= 0 and number in other.supports
    ]
    curve = fit(np.vstack([xyz, *anchors]), spread=corridor.own_radius, curvature=mean)
    if curve is None:
        return wire
    made = turned(replace(wire, curve=curve, known=(0.0, curve.length)), wire)
    return to_supports(made, supports)


def as_far(corridor: Corridor, wire: Wire, wires: Sequence[Wire]) -> Wire:
    """A wire extended or cut, at ends without a support, to where the data end.

    No wire ends in the air. Where data are all around its end, it ends with the farthest of those
    beside it.
    """
    if min(wire.supports) >= 0:
        return wire
    ends = [
        other.curve.ends[end]
        for other in wires
        for end in (0, 1)
        if other.span == wire.span and other.supports[end] < 0
    ]
    u, _ = wire.curve.along(np.array(ends))  # its own among them
    low, high = 0.0, wire.curve.length
    if wire.supports[0] < 0:
        low = -more_data(corridor, wire, 0, -float(u.min()))
    if wire.supports[1] < 0:
        high += more_data(corridor, wire, 1, float(u.max()) - high)
    known = (wire.known[0] - low, wire.known[1] - low)
    return replace(wire, curve=wire.curve.between(low, high), known=known)


def more_data(corridor: Corridor, wire: Wire, end: int, usual: float) -> float:
    """Metres from an end of a wire on to where the data end, or as far as usual if they do not."""
    end_of_data = data_end(corridor, wire.curve, end, max(usual, 0.0) + SETTINGS.supports.along)
    return min(usual, SETTINGS.supports.along) if end_of_data is None else end_of_data


def data_end(corridor: Corridor, curve: Catenary, end: int, reach: float) -> float | None:
    """Metres from an end of a curve on to where the data end; None if they go on to a reach."""
    side = SETTINGS.points.company_side
    steps = np.arange(0.0, reach + 2 * side, side / 4)
    beyond = curve.points(curve.length + steps if end else -steps)[:, :2]
    unseen = [step for step, spot in zip(steps, beyond, strict=True) if not corridor.seen(*spot)]
    if not unseen:
        return None
    return max(float(unseen[0]) - side, 0.0)  # points were seen in a cell beside the last one
