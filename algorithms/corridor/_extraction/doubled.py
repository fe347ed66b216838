"""Supports that stand in two places, as the spans on both sides are known at two tolerances."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._extraction.spans import Wire
from algorithms.corridor._extraction.supports import Support, is_seen, pairs_of
from algorithms.corridor._settings import SETTINGS

STEP = 0.05  # metres between places that are tried for a support

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Side:
    """The wires that a support holds, all of one span and so at one side of it.

    Attributes
    ----------
    span : number
    curves : of n wires
    ends : theirs at the support, array of shape (n, 3), metres
    ways : unit vectors in plan out of the wires, array of shape (n, 2)
    """

    span: int
    curves: Sequence[Catenary]
    ends: Floats
    ways: Floats


def without_doubled(
    wires: Sequence[Wire], supports: Sequence[Support]
) -> tuple[list[Wire], list[Support]]:
    """The wires, and the supports, of which two that hold the same wires at one side each are one.

    Each span is taken at the tolerance at which its points tell most. So the support between two of
    them may be known twice, farther apart along the line than two places of one support are.
    """
    sides = [side_of(wires, number) for number in range(len(supports))]
    pairs = sorted(
        (math.hypot(supports[a].x - supports[b].x, supports[a].y - supports[b].y), a, b)
        for a, b in itertools.combinations(range(len(supports)), 2)
        if may_be_one(supports[a], supports[b]) and meeting(sides[a], sides[b])
    )
    found, same = list(supports), np.arange(len(supports))
    for _, a, b in pairs:
        if np.count_nonzero((same == same[a]) | (same == same[b])) == 2:  # neither is one of two
            found[a] = between(supports[a], supports[b], meeting(sides[a], sides[b]))
            same[b] = a
    kept, new = np.unique(same, return_inverse=True)
    number = np.append(new, -1)  # of none
    held = [(int(number[low]), int(number[high])) for low, high in (w.supports for w in wires)]
    renamed = [replace(wire, supports=ends) for wire, ends in zip(wires, held, strict=True)]
    return renamed, [found[k] for k in kept.tolist()]


def may_be_one(one: Support, other: Support) -> bool:
    """Whether two supports are not both seen, nor beside each other as the legs of a frame."""
    step = (other.x - one.x, other.y - one.y)
    aside = abs(float(np.array(one.across) @ step))
    return aside < SETTINGS.network.join_aside and not (is_seen(one) and is_seen(other))


def side_of(wires: Sequence[Wire], number: int) -> Side | None:
    """What a support holds; None if it is not of one span."""
    own = [(wire, wire.supports.index(number)) for wire in wires if number in wire.supports]
    spans = {wire.span for wire, _ in own}
    if len(spans) != 1:
        return None
    curves = [wire.curve for wire, _ in own]
    outward = np.array([1.0 if end else -1.0 for _, end in own])
    ways = outward[:, None] * np.array([(curve.ex, curve.ey) for curve in curves])
    ends = np.array([wire.curve.ends[end] for wire, end in own])
    return Side(spans.pop(), curves, ends, ways)


def meeting(one: Side | None, other: Side | None) -> list[tuple[Catenary, Catenary]]:
    """Wires of two spans that come from opposite sides and end where one support is.

    None are told where they are no more than half of the wires of either span.
    """
    if one is None or other is None or one.span == other.span:
        return []
    way = one.ways.mean(axis=0)
    step = other.ends.mean(axis=0) - one.ends.mean(axis=0)
    if abs(step[:2] @ way) > SETTINGS.supports.along:
        return []
    ends, ways = (np.vstack(both) for both in ((one.ends, other.ends), (one.ways, other.ways)))
    curves = [*one.curves, *other.curves]
    met = [(curves[i], curves[j]) for i, j in pairs_of(ends, ways)]
    return met if 2 * len(met) > max(len(one.curves), len(other.curves)) else []


def between(one: Support, other: Support, wires: Sequence[tuple[Catenary, Catenary]]) -> Support:
    """The support that two are, where the wires of both sides meet.

    Each of the two places comes from one span at its own tolerance and from the next at that, too,
    so both count. Where they differ by more than their standard deviations, these are too small and
    grow by that factor (Birge 1932).

    References
    ----------
    Birge, R. T. (1932). The calculation of errors by the method of least squares. Physical Review
    40(2), 207-227.
    """
    places = np.array([(one.x, one.y), (other.x, other.y)])
    away = float(np.hypot(*(places[1] - places[0])))
    way = (places[1] - places[0]) / max(away, STEP)
    sigmas = np.maximum([one.sd_along, other.sd_along], STEP)
    weights = 1 / sigmas**2
    off = max(1.0, away / math.hypot(*sigmas))
    steps = np.arange(-SETTINGS.arcs.most_shift, away + SETTINGS.arcs.most_shift, STEP)
    known = weights.sum()  # 0 if both deviations are infinite
    usual = away * weights[1] / known if known else away / 2
    cost = known / off**2 * (steps - usual) ** 2
    spots = np.column_stack([places[0] + steps[:, None] * way, np.zeros(len(steps))])
    for curves in wires:
        (low, low_sigma), (high, high_sigma) = (height_at(curve, spots) for curve in curves)
        variance = low_sigma**2 + high_sigma**2 + SETTINGS.arcs.meeting_sd**2
        cost += (low - high) ** 2 / variance
    best = int(np.argmin(cost))
    x, y = (places[0] + steps[best] * way).tolist()
    near = steps[cost < cost[best] + 1]  # one standard deviation to each side
    return replace(
        one if weights[0] >= weights[1] else other,
        x=x,
        y=y,
        low=min(one.low, other.low),
        high=max(one.high, other.high),
        body=max(one.body, other.body),
        sd_along=float(np.ptp(near) + STEP) / 2,
    )


def height_at(curve: Catenary, spots: Floats) -> tuple[Floats, Floats]:
    """Heights of a wire at places in plan, and their standard deviations."""
    u, _ = curve.along(spots)
    return curve.height(u), curve.height_sigma(u)
