"""Which wires of a power line were found: in full, in part, or not at all, and which are invented.

References
----------
Heipke, C. et al. (1997). Evaluation of automatic road extraction. IAPRS 32(3-2W3), 47-56: lines
are compared within a buffer around each other.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from toolbox.context import QUIET, Context
from toolbox.data import Table, Vector
from toolbox.spec import outputs, param, sink, source, tool

STEP = 1.0  # metres between the places that are compared
OVERRUN, OVERRUN_SHARE = 5.0, 0.1  # metres, and of a wire, by which it may go on

Floats = NDArray[np.float64]


@tool("compare.spans")
class CompareSpans:
    """Compare the wires of a power line with reference wires, span by span.

    Both are lines in three dimensions, one per conductor and span, as corridor.extract makes them.
    A reference wire is found in full if one wire lies within `max_distance` of it over the share
    `full` of its length, and does not go on for more than 5 m and a tenth; it is found in part if
    any wire covers some of it, and missed otherwise. A wire is invented if no more than half of it
    lies near a reference wire. A span counts as its worst wire, but is missed only if all are.

    Heights are compared at the same place in plan.
    """

    wires: Vector = source("Wires that were found")
    reference: Vector = source("True wires")
    span: str = param("Column of the reference with the number of the span", default="span_id")
    max_distance: float = param(
        "Farthest that a wire may lie from the true one", default=0.5, unit="m", gt=0, le=50
    )
    full: float = param(
        "Share of its length from which a wire is found in full", default=0.95, unit="1", gt=0,
        le=1,
    )  # fmt: skip

    @outputs
    class Outputs:
        table: Table = sink("One row per reference wire, and one per invented wire")
        spans: Table = sink("One row per reference span: its wires in full, in part, missed")
        in_full: int = sink("Spans found in full", unit="1")
        in_part: int = sink("Spans found in part", unit="1")
        missed: int = sink("Spans missed", unit="1")
        invented: int = sink("Wires that there are not", unit="1")
        height_rms: float | None = sink("Height of wires found over the true ones, RMS", unit="m")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """Both must be lines with heights."""
        for name in ("wires", "reference"):
            shapes = getattr(self, name).frame.geometry
            if not all(shape.geom_type == "LineString" and shape.has_z for shape in shapes):
                yield name, "must hold lines in three dimensions (LineString Z) alone"
        if self.span not in (columns := self.reference.frame.columns.drop("geometry")):
            yield "span", f"no column {self.span!r}; there are {', '.join(columns)}"

    def halo(self) -> float:
        """A wire is compared as a whole."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> CompareSpans.Outputs:
        """Compare every wire with those near it."""
        metre = self.reference.metre
        truth = self.reference.frame
        found = [_places(line, STEP * metre) for line in self.wires.frame.geometry]
        true = [_places(line, STEP * metre) for line in truth.geometry]
        rows, used = [], np.zeros(len(found))
        tree = shapely.STRtree([shapely.LineString(places) for places in found])
        for number, (places, line) in enumerate(zip(true, truth.geometry, strict=True)):
            ctx.progress(number / len(true))
            near = sorted(tree.query(line.buffer(self.max_distance)).tolist())
            row = {"span": truth[self.span].iloc[number], "length": line.length / metre}
            best: dict[str, Any] = {"found": "missed", "share": 0.0, "wire": None}
            squares: Floats = np.zeros(0)
            for k in near:
                here, height = _beside(places, found[k], self.max_distance)
                there, _ = _beside(found[k], places, self.max_distance)
                used[k] += there.mean()
                share = float(here.mean())
                over = len(found[k]) * (1 - float(there.mean())) * STEP
                if share > best["share"]:
                    runs_on = over > OVERRUN + OVERRUN_SHARE * row["length"]
                    state = "in full" if share >= self.full and not runs_on else "in part"
                    best = {"found": state, "share": share, "wire": int(k)}
                    squares = height[here] / metre
            rows.append(row | best | _heights(squares))
        for k in np.flatnonzero(used <= 0.5):
            length = self.wires.frame.geometry.iloc[k].length / metre
            rows.append({"length": length, "found": "invented", "wire": int(k)})
        ctx.progress(1.0)
        spans = _by_span(rows)
        states = [row["found"] for row in spans]
        errors = [row["rms"] ** 2 for row in rows if row.get("rms") is not None]
        return self.Outputs(
            table=Table.from_rows(rows),
            spans=Table.from_rows(spans),
            in_full=states.count("in full"),
            in_part=states.count("in part"),
            missed=states.count("missed"),
            invented=int((used <= 0.5).sum()),
            height_rms=math.sqrt(float(np.mean(errors))) * metre if errors else None,
        )


def _places(line: shapely.LineString, step: float) -> Floats:
    """Places along a line about a step apart, array of shape (n, 3)."""
    corners = shapely.get_coordinates(line, include_z=True)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners[:, :2], axis=0).T))])
    at = np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / step) + 1))
    return np.column_stack([np.interp(at, along, corners[:, k]) for k in range(3)])


def _beside(places: Floats, line: Floats, reach: float) -> tuple[NDArray[np.bool_], Floats]:
    """Whether a line is near each of several places, and how far above it there.

    Parameters
    ----------
    places : array of shape (n, 3)
    line : array of shape (m, 3), places along a line
    """
    plan = shapely.LineString(line[:, :2])
    along = shapely.line_locate_point(plan, shapely.points(places[:, :2]))
    steps = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
    height = np.interp(along, steps, line[:, 2]) - places[:, 2]
    away = shapely.distance(plan, shapely.points(places[:, :2]))
    return np.hypot(away, height) <= reach, height


def _heights(difference: Floats) -> dict[str, float | None]:
    if not len(difference):
        return {"bias": None, "rms": None, "largest": None}
    return {
        "bias": float(difference.mean()),
        "rms": float(np.sqrt((difference**2).mean())),
        "largest": float(np.abs(difference).max()),
    }


def _by_span(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Reference wires counted by span."""
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
