"""Distances between the conductors of different lines, in all states of both.

Two spans are of one line if towers join them. A line may be hot while the other is cold, as each
has its own load; so every state of one is compared with every state of the other. Wind blows on
both: of two lines in wind one is taken to be in the lull, which brings them nearer.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import geopandas
import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.corridor._clearance.distances import Least, distances
from algorithms.corridor._clearance.rules import (
    KINDS,
    LINE,
    NO_RULE,
    SEVERITIES,
    Rule,
    is_broken,
)
from algorithms.corridor._clearance.surroundings import LineStates
from algorithms.corridor._curves.catenary import Catenary
from toolbox.context import QUIET, Context
from toolbox.data import Vector

STEP = 1.0  # metres along a wire between the places from which the nearest is looked for
FINEST_STEP = 0.005  # metres, of the narrowest steps around it
KEPT = "kept"  # severity of what breaks no rule
CROSSING_COLUMNS = (
    "crossing_id",
    "severity",
    "rule",
    "clearance",
    "required",
    "direction",
    "clearance_low",
    "clearance_high",
    "distance",
    "vertical",
    "horizontal",
    "span_id",
    "wire_id",
    "state",
    "chainage",
    "other_span",
    "other_wire",
    "other_state",
    "other_chainage",
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Crossing:
    """Where two spans of different lines are closest, or break their rule worst; metres.

    Attributes
    ----------
    wires, states : indices of the two wires, and of their states
    places : array of shape (2, 3), on the one and the other wire
    u : of both places along the wires
    space, vertical, flat : distances, the vertical one above zero where the first wire is lower
    rule : index of the rule, -1 if all are kept
    low, high : between which values the distance in space lies at the temperatures of `rest`
    """

    wires: tuple[int, int]
    states: tuple[int, int]
    places: Floats
    u: tuple[float, float]
    space: float
    vertical: float
    flat: float
    rule: int
    low: float
    high: float


def lines_of(line: LineStates) -> Ints:
    """Number of the line of each wire: spans are of one line if they have a tower in common."""
    spans, own = np.unique(line.span, return_inverse=True)
    own = own.reshape(-1)
    ends = np.column_stack([np.tile(own, 2), np.concatenate([line.start, line.end])])
    ends = ends[ends[:, 1] > 0]  # 0 where the data end
    size = len(spans) + int(ends[:, 1].max(initial=0)) + 1
    links = coo_array((np.ones(len(ends)), (ends[:, 0], len(spans) + ends[:, 1])), (size, size))
    return np.asarray(connected_components(links, directed=False)[1][own], np.int64)


def crossings_of(
    line: LineStates,
    rules: Sequence[Rule],
    *,
    reach: float,
    attachment: float,
    ctx: Context = QUIET,
) -> tuple[list[Crossing], Floats]:
    """Pairs of spans of different lines that come near each other, the most urgent first.

    Parameters
    ----------
    reach : to the side of each other up to which wires are looked at, metres
    attachment : wires that are nearest where both end, to within this, hang on: a tower between
        them was not found

    Returns
    -------
    crossings
    least : array of shape (states, m), least distance of each wire from another line in each of its
        states, metres; infinite if none is near
    """
    own = lines_of(line)
    least = np.full((len(line.states), len(own)), np.inf)
    worst: dict[tuple[int, int], Crossing] = {}
    pairs = list(_near(line, own, reach))
    for number, (i, j) in enumerate(pairs):
        ctx.progress(number / len(pairs))
        for found in _of_pair(line, rules, i, j, reach, attachment):
            for wire, state in zip(found.wires, found.states, strict=True):
                least[state, wire] = min(least[state, wire], found.space)
            spans = int(line.span[i]), int(line.span[j])
            before = worst.get(spans)
            if before is None or _urgency(found, rules) < _urgency(before, rules):
                worst[spans] = found
    return sorted(worst.values(), key=lambda one: _urgency(one, rules)), least


def with_lines(least: Least, from_lines: Floats) -> Least:
    """Least distances in which those from other lines are entered."""
    distance = least.distance.copy()
    distance[:, :, KINDS.index(LINE)] = from_lines
    return Least(distance, least.point)


def _near(line: LineStates, own: Ints, reach: float) -> Iterator[tuple[int, int]]:
    """Pairs of wires of different lines that are near each other in plan, each once."""
    if len(np.unique(own)) < 2:
        return
    shapes = [
        shapely.MultiLineString([c.points(np.linspace(0.0, c.length, 30))[:, :2] for c in states])
        for states in zip(*line.curves, strict=True)
    ]
    tree = shapely.STRtree(shapes)
    first, second = tree.query(shapes, predicate="dwithin", distance=reach)
    order = (first < second) & (own[first] != own[second])
    yield from zip(first[order].tolist(), second[order].tolist(), strict=True)


def _of_pair(
    line: LineStates, rules: Sequence[Rule], i: int, j: int, reach: float, attachment: float
) -> Iterator[Crossing]:
    """The crossings of two wires, in all states of both."""
    calm = [not state.wind for state in line.states]
    rest = [[line.curves[0][k], *(ends[k] for ends in line.rest)] for k in (i, j)]
    gaps = [_closest(one, other)[0] for one, other in itertools.product(*rest)]
    low, high = min(gap[0] for gap in gaps), max(gap[0] for gap in gaps)
    if len({gap[1] > 0 for gap in gaps}) > 1:  # they may pass each other
        low = min(low, *(gap[2] for gap in gaps))
    for a, b in itertools.product(range(len(line.states)), repeat=2):
        if not (calm[a] or calm[b]):
            continue
        one, other = line.curves[a][i], line.curves[b][j]
        (space, vertical, flat), u, places = _closest(one, other)
        if flat > reach or _hang_on(one, other, u, attachment):
            continue
        rule = _broken(rules, space, abs(vertical), flat)
        yield Crossing((i, j), (a, b), places, u, space, vertical, flat, rule, low, high)


def _hang_on(one: Catenary, other: Catenary, u: tuple[float, float], attachment: float) -> bool:
    """Whether two wires are nearest where both end, and the one does not run beside the other."""
    if not (_at_end(one, u[0], attachment) and _at_end(other, u[1], attachment)):
        return False
    along = np.linspace(0.0, one.length, math.ceil(one.length / STEP) + 1)
    nearest = distances(one.points(along), other)[:, 3]
    return bool((np.abs(nearest - u[1]) <= attachment).all())


def _at_end(curve: Catenary, u: float, attachment: float) -> bool:
    return min(u, curve.length - u) <= attachment


def _closest(
    one: Catenary, other: Catenary
) -> tuple[tuple[float, float, float], tuple[float, float], Floats]:
    """Distances of two wires, u of the places where they are nearest in space, and these places.

    The distances are that in space, and the vertical and horizontal ones where the wires are
    nearest in plan.
    """
    at, (space, _, _, there) = _least(one, other, 0)
    _, (_, vertical, flat, _) = _least(one, other, 2)
    places = np.vstack([one.points(np.array([at])), other.points(np.array([there]))])
    return (space, vertical, flat), (at, there), places


def _least(one: Catenary, other: Catenary, column: int) -> tuple[float, tuple[float, ...]]:
    """The u of a wire at which a column of `distances` to another is least, and all of them there.

    Around the nearest of places a step apart, ever narrower steps are looked at: as the distance
    is flat at its least, steps of millimetres are enough for a distance to within microns.
    """
    low, high, step = 0.0, one.length, STEP
    while True:
        u = np.linspace(low, high, math.ceil((high - low) / step) + 1)
        found = distances(one.points(u), other)
        best = int(found[:, column].argmin())
        if step < FINEST_STEP:
            return float(u[best]), tuple(found[best].tolist())
        low, high = max(u[best] - step, 0.0), min(u[best] + step, one.length)
        step /= 25


def _broken(rules: Sequence[Rule], space: float, tall: float, flat: float) -> int:
    """Index of the severest rule for lines that is broken; -1 if none is."""
    broken = [
        (SEVERITIES.index(rule.severity), number)
        for number, rule in enumerate(rules)
        if rule.kind == LINE and is_broken(rule, space, tall, flat)
    ]
    return min(broken)[1] if broken else -1


def _urgency(one: Crossing, rules: Sequence[Rule]) -> tuple[float, float, tuple[int, int]]:
    rank = SEVERITIES.index(rules[one.rule].severity) if one.rule >= 0 else len(SEVERITIES)
    return rank, one.space, one.wires


def crossing_layer(
    crossings: Sequence[Crossing],
    line: LineStates,
    rules: Sequence[Rule],
    crs: CRS | None,
    metre: float,
) -> Vector:
    """Vector layer with a line from wire to wire where two lines are closest."""
    rows: list[dict[str, Any]] = []
    for number, one in enumerate(crossings, start=1):
        rule = rules[one.rule] if one.rule >= 0 else None
        ruled = rule is not None and rule.severity != NO_RULE
        direction = rule.direction if rule is not None else "3-D"
        measures = {"3-D": one.space, "vertical": abs(one.vertical), "horizontal": one.flat}
        (i, j), (a, b) = one.wires, one.states
        rows.append(
            {
                "crossing_id": number,
                "severity": rule.severity if rule is not None else KEPT,
                "rule": rule.id if rule is not None else "",
                "clearance": measures[direction],
                "required": rule.threshold if rule is not None and ruled else math.nan,
                "direction": direction,
                "clearance_low": one.low,
                "clearance_high": one.high,
                "distance": one.space,
                "vertical": one.vertical,
                "horizontal": one.flat,
                "span_id": int(line.span[i]),
                "wire_id": int(line.wire[i]),
                "state": line.states[a].name,
                "chainage": line.chainage(i, one.u[0], a),
                "other_span": int(line.span[j]),
                "other_wire": int(line.wire[j]),
                "other_state": line.states[b].name,
                "other_chainage": line.chainage(j, one.u[1], b),
            }
        )
    shapes = [shapely.LineString(one.places * metre + line.origin) for one in crossings]
    frame = geopandas.GeoDataFrame(rows, columns=CROSSING_COLUMNS, geometry=shapes, crs=crs)
    return Vector(frame, geometry_type="LineString Z")
