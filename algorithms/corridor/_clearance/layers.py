"""Layers from the results of a clearance analysis: objects, points, and the table of spans."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import geopandas
import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from algorithms.corridor._clearance.counted import ZONE_COLUMNS
from algorithms.corridor._clearance.distances import UNCLASSIFIED, Least, Violations, distances
from algorithms.corridor._clearance.missed import SPAN_COLUMNS as MISSED_COLUMNS
from algorithms.corridor._clearance.missed import WireLike
from algorithms.corridor._clearance.objects import FALLING
from algorithms.corridor._clearance.rest import Band, clearance_as_surveyed, interval_of
from algorithms.corridor._clearance.rules import (
    BROKEN,
    KINDS,
    NO_RULE,
    OBJECTS,
    SEVERITIES,
    UNSURE,
    Rule,
)
from algorithms.corridor._clearance.surroundings import LineStates, Object, Surroundings
from toolbox.data import PointCloud, Table, Vector

# Degrees, of the standard deviation. Twice as much is what 8 m/s make of a Drake, a wind in which
# nobody surveys: a swing so unsure tells nothing.
SURE_SWING = 2.0
SPAN_COLUMNS = (
    "span_id",
    "state",
    "temperature",
    "wind",
    "from_tower",
    "to_tower",
    "wires",
    *MISSED_COLUMNS,
    "length",
    "sag",
    "swing",
    "swing_sd",
    "clearance",
    "clearance_sd",
    "clearance_low",
    "clearance_high",
    *KINDS,
    "ground_at",
    "ground_low",
    "ground_high",
    *ZONE_COLUMNS,
    "objects",
    "watched",
    "no_rule",
)
OBJECT_COLUMNS = (
    "object_id",
    "clump",
    "severity",
    "rule",
    "kind",
    "clearance",
    "clearance_low",
    "clearance_high",
    "required",
    "direction",
    "sd",
    "probability",
    "falls",
    "span_id",
    "wire_id",
    "state",
    "as_surveyed",
    "severity_surveyed",
    "clearance_surveyed",
    "distance",
    "vertical",
    "horizontal",
    "chainage",
    "height",
    "points",
    "may_be_wire",
    "may_touch",
    "confirmed",
    "source",
)
UNSURE_COLUMNS = (
    "object_id",
    "severity",
    "span_id",
    "wire_id",
    "state",
    "distance",
    "vertical",
    "horizontal",
    "chainage",
    "height",
    "points",
    "may_be_wire",
    "source",
)
VIOLATION_DESCRIPTIONS = {
    "clearance": "by the rule, or as it stands, m",
    "clearance_sd": "standard deviation, m",
    "probability": "that the rule is broken",
    "distance": "in space from the wire, m",
    "vertical": "below the wire, m",
    "horizontal": "beside the wire, m",
    "severity": "1 crit 2 warn 3 none 4 watch 5 ?",
    "rule": "its place in the report",
    "state": "0 survey, others see report",
    "as_surveyed": "1 as severe as surveyed, 0 less",
    "wire_id": "conductor",
    "span_id": "between two towers",
    "object_id": "0 for none",
}

GROUND = KINDS.index("ground")

Ints = NDArray[np.int64]


def object_layer(
    cloud: PointCloud,
    surroundings: Surroundings,
    line: LineStates,
    rules: Sequence[Rule],
    objects: Sequence[Object],
    clumps: Sequence[int],
    like: WireLike,
    others: Sequence[Ints],
    ranks: Ints,
    wire_radius: float,
) -> Vector:
    """Vector layer of the objects: one point per object, where it is closest to the wire.

    Parameters
    ----------
    others : of each object the points that may break a rule at another temperature, of its tree
    ranks : how severe points are with the wires as surveyed, see `rank_as_surveyed`
    wire_radius : metres, see `may_touch`
    """
    rows: list[dict[str, Any]] = []
    for number, (one, clump) in enumerate(zip(objects, clumps, strict=True), start=1):
        rule = rules[one.rule]
        ruled = rule.severity not in (NO_RULE, UNSURE)
        falls = rule.id == FALLING.id
        surveyed = one.state == 0  # the interval is of the wire as surveyed, colder or warmer
        rest = others[number - 1] if rule.severity in BROKEN else one.points[:0]
        whole = replace(one, points=np.concatenate([one.points, rest]))
        low, high = interval_of(whole, rule, surroundings, line) if surveyed else (math.nan,) * 2
        now = int(ranks[one.points].min())
        rows.append(
            {
                "object_id": number,
                "clump": clump,
                "severity": rule.severity,
                "rule": rule.id,
                "kind": one.kind,
                "clearance": one.space if falls else one.measure,
                "clearance_low": low,
                "clearance_high": high,
                "required": rule.threshold if ruled and not falls else math.nan,
                "direction": rule.direction,
                "sd": one.sd,
                "probability": one.probability if ruled else math.nan,
                "falls": one.falls,
                "span_id": int(line.span[one.wire]),
                "wire_id": int(line.wire[one.wire]),
                "state": line.states[one.state].name,
                "as_surveyed": now <= SEVERITIES.index(rule.severity),
                "severity_surveyed": SEVERITIES[now] if now < len(SEVERITIES) else "",
                "clearance_surveyed": clearance_as_surveyed(one, rule, surroundings, line),
                "distance": one.space,
                "vertical": one.vertical,
                "horizontal": one.flat,
                "chainage": line.chainage(one.wire, one.u, one.state),
                "height": one.height,
                "points": len(one.points),
                "may_be_wire": like.holds(one),
                "may_touch": may_touch(one, surroundings, line, wire_radius),
                "confirmed": rule.confirmed,
                "source": rule.source if ruled else rule.note,
            }
        )
    places = shapely.points(cloud.xyz[surroundings.index[[one.nearest for one in objects]]])
    frame = geopandas.GeoDataFrame(rows, columns=OBJECT_COLUMNS, geometry=places, crs=cloud.crs)
    return Vector(frame, geometry_type="Point Z")


def may_touch(
    one: Object, surroundings: Surroundings, line: LineStates, wire_radius: float
) -> bool:
    """Whether nothing that is farther from its wire than that parts an object from touching it.

    Points on a wire count as of it, whatever they are of: those without a class up to
    `wire_radius`, in metres, from it; others are within that, too. Where none is left in between,
    the next point of an object without a class may be as far away again.
    """
    point = surroundings.xyz[[one.nearest]]
    space = distances(point, line.curves[0][one.wire])[0, 0]
    return bool(space <= wire_radius * (2 if one.kind == KINDS[UNCLASSIFIED] else 1))


def apart(layer: Vector) -> tuple[Vector, Vector]:
    """The layer of objects without what may be of the line, and that in a layer of its own."""
    unsure = (layer.frame["severity"] == UNSURE).to_numpy()
    others = layer.frame.loc[unsure, [*UNSURE_COLUMNS, "geometry"]].reset_index(drop=True)
    return (
        Vector(layer.frame[~unsure].reset_index(drop=True), geometry_type="Point Z"),
        Vector(others, geometry_type="Point Z"),
    )


def violation_cloud(
    cloud: PointCloud,
    surroundings: Surroundings,
    line: LineStates,
    rules: Sequence[Rule],
    found: Violations,
    objects: Sequence[Object],
    ranks: Ints,
) -> PointCloud:
    """Point cloud of the points that break a rule or have none, in their original order."""
    order = np.argsort(found.point, kind="stable")
    number = np.zeros(len(surroundings.index), np.uint32)
    for k, one in enumerate(objects, start=1):
        number[one.points] = k
    severity = np.array([SEVERITIES.index(rule.severity) + 1 for rule in rules], np.uint8)
    unruled = (NO_RULE, UNSURE)
    ruled = np.array([r.severity not in unruled for r in rules], bool)[found.rule[order]]
    probability = np.where(ruled, found.probability[order], np.nan)
    falls = np.array([rule.id == FALLING.id for rule in rules], bool)[found.rule]
    clearance = np.where(falls, found.space, found.measure)
    wire = found.wire[order]
    return cloud.select(surroundings.index[found.point[order]]).with_attributes(
        {
            "clearance": clearance[order].astype(np.float32),
            "clearance_sd": found.sd[order].astype(np.float32),
            "probability": probability.astype(np.float32),
            "distance": found.space[order].astype(np.float32),
            "vertical": found.vertical[order].astype(np.float32),
            "horizontal": found.flat[order].astype(np.float32),
            "severity": severity[found.rule[order]],
            "rule": (found.rule[order] + 1).astype(np.uint16),
            "state": found.state[order].astype(np.uint8),
            "as_surveyed": (ranks[found.point] < severity[found.rule])[order].astype(np.uint8),
            "wire_id": line.wire[wire].astype(np.uint32),
            "span_id": line.span[wire].astype(np.uint32),
            "object_id": number[found.point[order]],
        },
        descriptions=VIOLATION_DESCRIPTIONS,
    )


def span_table(
    surroundings: Surroundings,
    line: LineStates,
    rules: Sequence[Rule],
    least: Least,
    objects: Sequence[Object],
    point_sd: float,
    band: Band,
    zones: NDArray[np.int64],
    missed: Mapping[int, Mapping[str, float]],
) -> Table:
    """Table of one row per span and state; clearances in space, in metres.

    Parameters
    ----------
    zones : numbers of points, see `count_in_zones`
    missed : columns of each span on what may be missing of it
    """
    rows = []
    for span in line.spans:
        own = np.flatnonzero(line.span == span)
        for number, state in enumerate(line.states):
            curves = [line.curves[number][k] for k in own]
            swung = max(own, key=lambda k: abs(line.curves[number][k].swing))
            swing = math.degrees(math.atan(line.curves[number][swung].swing))
            swing_sd = math.nan if number else float(line.swing_sd[swung])
            unknown = number == 0 and (not swing or swing_sd > SURE_SWING)
            rows.append(
                {
                    "span_id": span,
                    "state": state.name,
                    "temperature": state.temperature,
                    "wind": state.wind,
                    "from_tower": int(line.start[own[0]]),
                    "to_tower": int(line.end[own[0]]),
                    "wires": len(own),
                    **missed[span],
                    "length": max(curve.length for curve in curves),
                    "sag": max(curve.sag for curve in curves),
                    "swing": None if unknown else swing,
                    "swing_sd": None if number or unknown else swing_sd,
                    **_least_of(line, least, own, number, surroundings, point_sd),
                    **(_interval_of(band, own) if number == 0 else {}),
                    **dict(
                        zip(ZONE_COLUMNS, zones[number, own].sum(axis=(0, 1)).tolist(), strict=True)
                    ),
                    **_counted(
                        [
                            rules[one.rule].severity
                            for one in objects
                            if one.state == number and line.span[one.wire] == span
                        ]
                    ),
                }
            )
    return Table(pd.DataFrame(rows, columns=SPAN_COLUMNS), name="spans")


def _counted(severities: Sequence[str]) -> dict[str, int]:
    """How many objects are too close, to be watched, and near without a rule."""
    return {
        "objects": sum(severity in BROKEN for severity in severities),
        "watched": severities.count("watch"),
        "no_rule": severities.count(NO_RULE),
    }


def _least_of(
    line: LineStates,
    least: Least,
    own: Ints,
    state: int,
    surroundings: Surroundings,
    point_sd: float,
) -> dict[str, float | None]:
    """Least clearance of a span, its standard deviation, and the least clearance for each kind."""
    table = least.distance[state, own]
    wire, kind = np.unravel_index(table[:, : len(OBJECTS)].argmin(), (len(own), len(OBJECTS)))
    row: dict[str, float | None] = {"clearance": None, "clearance_sd": None}
    if math.isfinite(table[wire, kind]):
        curve = line.curves[state][own[wire]]
        point = surroundings.xyz[[least.point[state, own[wire], kind]]]
        sigma = float(curve.height_sigma(distances(point, curve)[:, 3])[0])
        row["clearance"] = float(table[wire, kind])
        row["clearance_sd"] = math.hypot(point_sd, sigma) if math.isfinite(sigma) else point_sd
    bare = least.point[state, own, GROUND]
    wire = int(table[:, GROUND].argmin())
    row["ground_at"] = None
    if bare[wire] >= 0:
        point = surroundings.xyz[bare[[wire]]]
        u = float(distances(point, line.curves[state][own[wire]])[0, 3])
        row["ground_at"] = line.chainage(int(own[wire]), u, state)
    return row | dict(zip(KINDS, map(_if_any, table.min(axis=0)), strict=True))


def _interval_of(band: Band, own: Ints) -> dict[str, float | None]:
    """Between which values the least distances of a span from objects and the ground lie."""
    kinds = {"clearance": slice(len(OBJECTS)), "ground": slice(GROUND, GROUND + 1)}
    return {
        f"{name}_{end}": _if_any(values[own, some].min())
        for name, some in kinds.items()
        for end, values in (("low", band.low), ("high", band.high))
    }


def _if_any(distance: float) -> float | None:
    return float(distance) if math.isfinite(distance) else None
