"""What may be missing of a line where clearances are measured: then they come out too large.

Beside what the layer of wires tells, points that are no wire are followed as wires are: what hangs
beside the line in the shape of one may be a conductor that was not found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._clearance.distances import WireLattice
from algorithms.corridor._clearance.rules import OBJECTS
from algorithms.corridor._clearance.surroundings import LineStates, Object, Surroundings
from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._curves.network import (
    Corridor,
    Piece,
    curves_of,
    runs_beside,
    wires_among,
)
from algorithms.corridor._curves.trace import Airborne, trace_all, uncrowded
from algorithms.corridor._extraction.missed import missed
from algorithms.corridor._settings import SETTINGS
from algorithms.shared import parameters
from toolbox.context import QUIET, Context, log
from toolbox.data import Section, Vector

DENSITY = 100.0  # points per square metre, for which the most points around a wire are allowed
MOSTLY = 0.5  # share of the points of an object in the shape of a wire, from which it may be one
SPAN_COLUMNS = ("conductors", "expected", "seen_share", "wire_like")
ADVICE = (
    "No clearance is measured from a wire that was not found, so those of these spans may be too "
    "large. Look at the points there, or extract the wires from denser data."
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class WireLike:
    """Points in the shape of wires that are no wires.

    Attributes
    ----------
    on_it : array of shape (n,), which of the points near the line are such, or as near to a wire
        as a subconductor of its bundle
    lengths : metres of such shapes in each span
    """

    on_it: NDArray[np.bool_]
    lengths: Mapping[int, float]

    def holds(self, one: Object) -> bool:
        """Whether an object consists mostly of such points."""
        return bool(self.on_it[one.points].mean() >= MOSTLY)


def wire_like(surroundings: Surroundings, line: LineStates, ctx: Context = QUIET) -> WireLike:
    """Find curves among the points beside the line that look like wires."""
    height = surroundings.height
    kind = np.maximum(surroundings.kind, surroundings.hanging)
    on_it = np.zeros(len(kind), bool)
    near = np.flatnonzero((kind >= 0) & (kind < len(OBJECTS)))
    if len(near):
        beside = WireLattice.of(line.curves[:1], SETTINGS.network.line_width)
        near = near[beside.has(surroundings.xyz[near, :2])]
    if not len(near):
        return WireLike(on_it, {})
    air = Airborne.of(surroundings.xyz[near])
    tolerance = SETTINGS.lines.tolerances[0]  # a wider one takes branches for wires
    may = ~(height[near][air.order] <= parameters.MIN_HEIGHT)  # where it is not known, it may be
    alone, voxel = uncrowded(air.select(may), DENSITY)
    may[may] = alone
    corridor = Corridor(air, height[near][air.order], may, tolerance, _nowhere, _unseen)
    curves = trace_all(
        corridor.wires, voxel[alone], tolerance=tolerance, max_gap=parameters.WIRE_GAP, ctx=ctx
    )
    known = [Piece(np.empty(0, np.int64), curve) for curve in line.curves[0]]
    pieces = [
        replace(one, sure=one.sure or is_beside(one, known)) for one in curves_of(corridor, curves)
    ]
    for wire in line.curves[0]:
        on_it[near[air.order[air.around(wire, SETTINGS.network.bundle_width)[0]]]] = True
    lengths: dict[int, float] = {}
    for piece in wires_among(corridor, pieces):
        on_it[near[air.order[air.around(piece.curve, tolerance)[0]]]] = True
        span = nearest_span(piece.curve, line)
        lengths[span] = lengths.get(span, 0.0) + piece.curve.length
    return WireLike(on_it, lengths)


def is_beside(piece: Piece, known: Sequence[Piece]) -> bool:
    """Whether a piece is long enough to be a wire where it runs beside a known one."""
    return piece.curve.length >= SETTINGS.curves.fine_length and any(
        runs_beside(wire, piece) for wire in known
    )


def _nowhere(x: float, y: float) -> float:
    return float("nan")


def _unseen(x: float, y: float) -> bool:
    return False


def nearest_span(curve: Catenary, line: LineStates) -> int:
    """Number of the span that a curve is nearest to, in its middle."""
    middle = curve.points(np.array([0.5 * curve.length]))
    away = []
    for wire in line.curves[0]:
        u, v, z = (float(values[0]) for values in wire.residuals(middle))
        away.append(np.hypot(max(-u, u - wire.length, 0.0), np.hypot(v, z)))
    return int(line.span[int(np.argmin(away))])


def columns_of(wires: Vector, like: WireLike) -> dict[int, dict[str, float]]:
    """The columns SPAN_COLUMNS of each span: its least seen conductor, and metres of the shape."""
    found = wires.frame.groupby("span_id").agg(
        {"conductors": "max", "expected": "max", "seen_share": "min"}
    )
    return {
        int(span): {**row, "wire_like": like.lengths.get(int(span), 0.0)}
        for span, row in found.to_dict("index").items()
    }


def texts_of(wires: Vector, like: WireLike) -> list[str]:
    """What may be missing, span by span."""
    shaped = [
        f"span {span}: along {length:.0f} m points hang beside it in the shape of a wire, which "
        "are none"
        for span, length in sorted(like.lengths.items())
    ]
    return [*missed(wires), *shaped]


def section(texts: Sequence[str]) -> Section:
    """The section of the report; without a block if nothing may be missing."""
    lines = [f"{text[0].upper()}{text[1:]}." for text in texts]
    return Section("Wires that may be missing", ["\n".join([ADVICE, *lines])] if lines else [])


def warn_of_wire_like(like: WireLike) -> None:
    """Log the spans beside which points have the shape of a wire."""
    if like.lengths:
        spans = ", ".join(map(str, sorted(like.lengths)))
        log.warning(
            "points in the shape of a wire, which are none, hang beside spans %s: look at them; "
            "in denser data they may be found as wires",
            spans,
        )
