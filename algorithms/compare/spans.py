"""Wires found in full, in part or not at all, compared with reference wires span by span.

References
----------
Heipke, C. et al. (1997). Evaluation of automatic road extraction. IAPRS 32(3-2W3), 47-56: lines
are compared within a buffer around each other.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from toolbox.context import QUIET, Context, log
from toolbox.data import Table, Vector
from toolbox.data.report import Column
from toolbox.declare import outputs, param, sink, source, tool

STEP = 1.0  # metres between the positions that are compared
OVERRUN, OVERRUN_SHARE = 5.0, 0.1  # metres, and of a wire, by which it may go on

Floats = NDArray[np.float64]

COLUMNS = {
    "length": Column("Length", "m", 1),
    "share": Column("Found of its length", "%", 1, 100.0),
    "bias": Column("Mean height above it", "m", 3),
    "rms": Column("Root mean square of heights", "m", 3),
    "largest": Column("Largest height above or below", "m", 3),
}


@tool(
    "compare.spans",
    title="Compare spans of a power line",
    tags=(
        "accuracy",
        "validation",
        "wire",
        "conductor",
        "span",
    ),
)
class CompareSpans:
    """Compare the wires of a power line with reference wires, span by span.

    Both are lines in three dimensions, one per conductor and span, as corridor.extract makes them.
    Each wire is given to one reference wire, so that they agree best. A reference wire is found in
    full if its wire lies within `max_distance` of it over the share `full` of its length, and does
    not go on for more than 5 m and a tenth; it is found in part if any wire covers some of it, and
    missed otherwise. A wire is invented if no more than half of it lies near reference wires, and
    doubled if more than half of it lies near those that other wires have found in full. A span
    counts as its worst wire, but is missed only if all are. Lines of the reference that have no
    span, such as towers, are left out.

    Heights are compared at the same position in plan.
    """

    wires: Vector = source("Wires that were found", shapes="line")
    reference: Vector = source("True wires", shapes="line")
    span: str = param(
        "Column of the reference with the number of the span", default="span_id", of="reference"
    )
    max_distance: float = param(
        "Farthest that a wire may lie from the true one",
        default=0.5,
        unit="m",
        gt=0,
        le=50,
        label="Farthest wire",
    )
    full: float = param(
        "Share of its length from which a wire is found in full", default=0.95, unit="1", gt=0, le=1
    )

    @outputs
    class Outputs:
        table: Table = sink(
            "One row per reference wire, and one per invented or doubled wire", columns=COLUMNS
        )
        spans: Table = sink("One row per reference span: its wires in full, in part, missed")
        in_full: int = sink("Spans found in full", unit="1")
        in_part: int = sink("Spans found in part", unit="1")
        missed: int = sink("Spans missed", unit="1")
        invented: int = sink(
            "Found wires that are not in the reference",
            unit="1",
            label="Wires not in the reference",
        )
        doubled: int = sink("Wires found a second time", unit="1")
        height_rms: float | None = sink("Height of wires found over the true ones, RMS", unit="m")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """Both layers hold lines with heights."""
        for name in ("wires", "reference"):
            shapes = getattr(self, name).frame.geometry
            if not ((shapes.geom_type == "LineString") & shapes.has_z).all():
                yield name, "must hold lines in three dimensions (LineString Z) alone"
        if self.span not in (columns := self.reference.frame.columns.drop("geometry")):
            yield "span", f"no column {self.span!r}; there are {', '.join(columns)}"

    def halo(self) -> float:
        """Infinite, as a wire is compared as a whole."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> CompareSpans.Outputs:
        """Compare every wire with those near it."""
        metre = self.reference.metre
        reference = self.reference.frame.dropna(subset=self.span)
        if left_out := len(self.reference) - len(reference):
            log.warning("%d lines of the reference have no %s: left out", left_out, self.span)
        found = [_places(line, STEP * metre) for line in self.wires.frame.geometry]
        true = [_places(line, STEP * metre) for line in reference.geometry]
        pairs = _pairs(true, found, self.max_distance, ctx)
        chosen = _one_to_one(pairs, len(found))
        rows = []
        names = reference[self.span]
        for number, (name, places, own) in enumerate(zip(names, true, pairs, strict=True)):
            mine = chosen.get(number, max(own, key=lambda k: own[k].share, default=None))
            row: dict[str, Any] = {"span": name, "length": _length(places) / metre}
            row |= {"found": "missed", "share": 0.0, "wire": None} | _heights(np.zeros(0))
            if mine is not None:
                pair, overrun = own[mine], OVERRUN + OVERRUN_SHARE * row["length"]
                whole = number in chosen and pair.share >= self.full and pair.over <= overrun
                row |= {"found": "in full" if whole else "in part", "share": pair.share}
                row |= {"wire": mine} | _heights(pair.height / metre)
            rows.append(row)
        spans = _by_span(rows)
        in_full = [row["found"] == "in full" for row in rows]
        more = _unwanted(pairs, in_full, chosen, found)
        rows += [{"length": _length(found[k]) / metre, "found": more[k], "wire": k} for k in more]
        states = [row["found"] for row in spans]
        errors = [row["rms"] ** 2 for row in rows if row.get("rms") is not None]
        return self.Outputs(
            table=Table.from_rows(rows),
            spans=Table.from_rows(spans),
            in_full=states.count("in full"),
            in_part=states.count("in part"),
            missed=states.count("missed"),
            invented=list(more.values()).count("invented"),
            doubled=list(more.values()).count("doubled"),
            height_rms=math.sqrt(float(np.mean(errors))) * metre if errors else None,
        )


@dataclass(frozen=True)
class _Pair:
    """How a found wire agrees with a reference wire near it.

    Attributes
    ----------
    share : of the true wire that lies near the other
    agreement : the same, but a position counts the less the farther it is
    over : metres by which the other goes on
    height : of the other above the true wire, where it is near
    beside : array of shape (m,), which positions on the other lie near the true wire
    """

    share: float
    agreement: float
    over: float
    height: Floats
    beside: NDArray[np.bool_]


def _pairs(
    true: Sequence[Floats], found: Sequence[Floats], reach: float, ctx: Context
) -> list[dict[int, _Pair]]:
    """For each reference wire, the wires near it by number, with their agreement."""
    pairs: list[dict[int, _Pair]] = [{} for _ in true]
    tree = shapely.STRtree([shapely.LineString(places) for places in found])
    for i, places in enumerate(true):
        ctx.progress(i / len(true))
        for k in sorted(tree.query(shapely.LineString(places).buffer(reach)).tolist()):
            away, height = _beside(places, found[k])
            beside = _beside(found[k], places)[0] <= reach
            here = away <= reach
            if here.any():
                agreement = float(np.clip(1 - away / reach, 1e-6, 1)[here].sum() / len(here))
                over = float((~beside).sum()) * STEP
                pairs[i][k] = _Pair(float(here.mean()), agreement, over, height[here], beside)
    ctx.progress(1.0)
    return pairs


def _one_to_one(pairs: Sequence[Mapping[int, _Pair]], found: int) -> dict[int, int]:
    """Assignment of wires to reference wires with the best total agreement."""
    agreement = np.zeros((len(pairs), found))
    for i, own in enumerate(pairs):
        for k, pair in own.items():
            agreement[i, k] = pair.agreement
    chosen = zip(*linear_sum_assignment(agreement, maximize=True), strict=True)
    return {int(i): int(k) for i, k in chosen if agreement[i, k] > 0}


def _unwanted(
    pairs: Sequence[Mapping[int, _Pair]],
    in_full: Sequence[bool],
    chosen: Mapping[int, int],
    found: Sequence[Floats],
) -> dict[int, str]:
    """Numbers of the wires that are invented or doubled, and which of both they are."""
    near = [np.zeros(len(places), bool) for places in found]
    again = [np.zeros(len(places), bool) for places in found]
    for own, whole in zip(pairs, in_full, strict=True):
        for k, pair in own.items():
            near[k] |= pair.beside
            if whole:
                again[k] |= pair.beside
    taken = set(chosen.values())
    invented = {k: "invented" for k in range(len(found)) if near[k].mean() <= 0.5}
    others = (k for k in range(len(found)) if k not in invented and k not in taken)
    return invented | {k: "doubled" for k in others if again[k].mean() > 0.5}


def _length(places: Floats) -> float:
    """Length of a line in plan."""
    return float(np.hypot(*np.diff(places[:, :2], axis=0).T).sum())


def _places(line: shapely.LineString, step: float) -> Floats:
    """Positions along a line, about a step apart, array of shape (n, 3)."""
    corners = shapely.get_coordinates(line, include_z=True)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners[:, :2], axis=0).T))])
    at = np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / step) + 1))
    return np.column_stack([np.interp(at, along, corners[:, k]) for k in range(3)])


def _beside(places: Floats, line: Floats) -> tuple[Floats, Floats]:
    """Distance of a line from each of several positions, and its height above them.

    Parameters
    ----------
    places : array of shape (n, 3)
    line : array of shape (m, 3), places along a line
    """
    plan = shapely.LineString(line[:, :2])
    along = shapely.line_locate_point(plan, shapely.points(places[:, :2]))
    steps = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
    height = np.interp(along, steps, line[:, 2]) - places[:, 2]
    return np.hypot(shapely.distance(plan, shapely.points(places[:, :2])), height), height


def _heights(difference: Floats) -> dict[str, float | None]:
    if not len(difference):
        return {"bias": None, "rms": None, "largest": None}
    return {
        "bias": float(difference.mean()),
        "rms": float(np.sqrt((difference**2).mean())),
        "largest": float(np.abs(difference).max()),
    }


def _by_span(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Table rows: outcomes of the reference wires of each span."""
    spans: dict[Any, list[str]] = {}
    for row in rows:
        if "span" in row:
            spans.setdefault(row["span"], []).append(row["found"])
    result = []
    for span, states in spans.items():
        count = {state: states.count(state) for state in ("in full", "in part", "missed")}
        worst = "in full" if count["in full"] == len(states) else "in part"
        found = "missed" if count["missed"] == len(states) else worst
        result.append({"span": span, "found": found, "wires": len(states)} | count)
    return result
