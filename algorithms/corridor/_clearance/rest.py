"""Between which values clearances lie at the temperatures that the wires may have.

A survey sees the wires at one temperature, which often nobody knows. At another time they hang
higher or lower. The range of temperatures, and of conductors where that is not known, gives each
wire a highest and a lowest position; between them it sweeps a sheet, which is measured from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._clearance import distances_kernels as kernels
from algorithms.corridor._clearance.distances import (
    MEASURED_BLOCK,
    Least,
    WireLattice,
    distances,
    find_violations,
    rows_of,
)
from algorithms.corridor._clearance.rules import DIRECTIONS, KINDS, NO_RULE, SEVERITIES, Rule
from algorithms.corridor._clearance.sag import Conductor, curvature_when
from algorithms.corridor._clearance.surroundings import LineStates, Object, Surroundings
from algorithms.corridor._curves.catenary import Catenary
from algorithms.shared.kernels.threads import in_blocks
from toolbox.context import QUIET, Context
from toolbox.errors import DataError

SURE = 2.0  # standard deviations of a known temperature that its range is wide to either side

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Temperatures:
    """Temperatures of the wires, degrees C.

    Attributes
    ----------
    surveyed : lowest and highest that they may have had in the survey
    lowest, highest : that they may have at other times
    """

    surveyed: tuple[float, float]
    lowest: float
    highest: float

    @property
    def change(self) -> tuple[float, float]:
        """By how many degrees they may be colder, below zero, and warmer than in the survey."""
        return min(self.lowest - self.surveyed[1], 0.0), max(self.highest - self.surveyed[0], 0.0)


@dataclass(frozen=True)
class AtRest:
    """What a report tells of the range of temperatures.

    Attributes
    ----------
    temperatures : of the wires
    surveyed : their temperature in the survey, degrees C; None if it is not known
    computed : whether it was computed from current and weather
    may_break : indices of points that keep the rules as surveyed, and may not at another time
    """

    temperatures: Temperatures
    surveyed: float | None
    computed: bool
    may_break: Ints


def extremes(
    curve: Catenary,
    conductors: Sequence[Conductor],
    change: tuple[float, float],
    ruling_span: float | None = None,
) -> tuple[Catenary, Catenary]:
    """Highest and lowest position of a wire, of all conductors that it may be.

    It hangs in the plane in which it was surveyed. A conductor for which there is no such state,
    as it would be slack, is passed over; the surveyed position is one of those looked at.

    Parameters
    ----------
    change : degrees, colder and warmer than in the survey
    ruling_span : see `in_state`
    """
    bent = [curve.curvature]
    for conductor in conductors:
        for warmer in change:
            try:
                bent.append(curvature_when(curve, conductor, warmer, ruling_span))
            except DataError:
                continue
    return replace(curve, curvature=min(bent)), replace(curve, curvature=max(bent))


@dataclass(frozen=True)
class Band:
    """What the wires come near while they move between their coldest and hottest position.

    Attributes
    ----------
    low, high : arrays of shape (m, kinds), least and greatest value of the least distance in space
        of each wire from each kind, metres; infinite where nothing is near
    may_break : indices of points that keep the rules as surveyed, and may not at another time
    """

    low: Floats
    high: Floats
    may_break: Ints


def band_of(
    surroundings: Surroundings,
    line: LineStates,
    rules: Sequence[Rule],
    broken: Ints,
    least: Least,
    *,
    reach: float,
    ctx: Context = QUIET,
) -> Band:
    """Distances from the sheets that the wires sweep; `broken`: points that are listed anyway."""
    if not line.spans:
        none = np.empty((0, len(KINDS)))
        return Band(none, none, np.empty(0, np.int64))
    xyz, kind = surroundings.xyz, surroundings.kind
    ruled = [rule for rule in rules if SEVERITIES.index(rule.severity) < SEVERITIES.index(NO_RULE)]
    found, ends = find_violations(
        xyz, kind, line.rest, ruled, reach=reach, point_sd=0.0, ctx=ctx.part(0.0, 0.8)
    )
    swept, beside = sweep(xyz, kind, line.rest, reach=reach, ctx=ctx.part(0.8, 1.0))
    widest = np.array([_widest(ruled, name) for name in KINDS])
    inside = np.flatnonzero((kind >= 0) & (beside < widest[kind]))
    now = least.distance[0]
    states = np.stack([ends.distance[0], now, ends.distance[1]])
    return Band(
        low=np.minimum(states.min(axis=0), swept),
        high=states.max(axis=0),
        may_break=np.setdiff1d(np.concatenate([found.point, inside]), broken),
    )


def _widest(rules: Sequence[Rule], kind: str) -> float:
    """Distance to the side from which a wire at the height of a point breaks no rule, metres."""
    own = [rule for rule in rules if rule.holds_for(kind)]
    aside = [r.within if r.direction == "vertical" else r.threshold for r in own]
    return max(aside, default=0.0)


def sweep(
    xyz: Floats,
    kind: NDArray[np.int8],
    ends: Sequence[Sequence[Catenary]],
    *,
    reach: float,
    ctx: Context = QUIET,
) -> tuple[Floats, Floats]:
    """Distances from the sheets between two positions of each wire, for points at their heights.

    Parameters
    ----------
    xyz, kind : n points and their kinds; those below zero take no part
    ends : the wires at their highest and at their lowest
    reach : to the side of the wires, metres

    Returns
    -------
    least : array of shape (m, kinds), least distance of each wire; infinite if there is none
    beside : array of shape (n,), least distance of each point; infinite above and below the sheets
    """
    near, (high, low) = WireLattice.of(ends, reach), map(rows_of, ends)
    least, beside = np.full((len(high), len(KINDS)), np.inf), np.full(len(xyz), np.inf)
    parts: dict[int, Floats] = {}

    def work(first: int, last: int) -> None:
        own = np.full_like(least, np.inf)
        kernels.sweep(
            first,
            last,
            xyz,
            kind,
            near.lattice,
            near.starts,
            near.candidates,
            high,
            low,
            reach,
            own,
            beside,
        )
        parts[first] = own

    in_blocks(work, len(xyz), MEASURED_BLOCK, ctx)
    return np.minimum.reduce([least, *parts.values()]), beside


def interval_of(
    one: Object, rule: Rule, surroundings: Surroundings, line: LineStates
) -> tuple[float, float]:
    """Between which values the clearance of an object lies, from the wire that it is listed with.

    For a falling tree that is its distance as it stands.
    """
    wires = [line.curves[0][one.wire], *(curves[one.wire] for curves in line.rest)]
    points = surroundings.xyz[one.points]
    values = [_measured(points, wire, rule) for wire in wires]
    known = [value for value in values if math.isfinite(value)]
    kind = np.zeros(len(points), np.int8)
    _, beside = sweep(points, kind, [[wires[1]], [wires[2]]], reach=max(rule.threshold, 1.0))
    inside = float(beside.min())
    if rule.direction == "vertical":
        inside = 0.0 if inside <= rule.within else math.inf
    return min([*known, inside], default=math.nan), max(known, default=math.nan)


def clearance_as_surveyed(
    one: Object, rule: Rule, surroundings: Surroundings, line: LineStates
) -> float:
    """Clearance of an object as surveyed from the wire that it is listed with; NaN for none."""
    value = _measured(surroundings.xyz[one.points], line.curves[0][one.wire], rule)
    return value if math.isfinite(value) else math.nan


def _measured(points: Floats, wire: Catenary, rule: Rule) -> float:
    """Least distance of points from a wire in the direction of a rule; infinite if it has none."""
    found = np.abs(distances(points, wire))
    value = found[:, DIRECTIONS.index(rule.direction)]
    if rule.direction != "3-D":
        other = found[:, 2 if rule.direction == "vertical" else 1]
        value = value[other <= rule.within]
    return float(value.min(initial=math.inf))
