"""Vector layers from wires and towers, and catenaries from the layer of wires."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import geopandas
import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._extraction.missed import conductor_counts
from algorithms.corridor._extraction.spans import Wire
from algorithms.corridor._extraction.towers import Tower
from toolbox.data import Vector

CHORD_ERROR = 0.005  # metres that a drawn line may be off the curve

# Columns that no curve needs, and layers of before do not have: of the service drops, of swings.
DROP, SWING_SD = "drop", "sd_swing"

Floats = NDArray[np.float64]
COVARIANCES = {
    "var_start": (0, 0),
    "var_end": (1, 1),
    "var_curv": (2, 2),
    "cov_start_end": (0, 1),
    "cov_start_curv": (0, 2),
    "cov_end_curv": (1, 2),
}
WIRE_COLUMNS = (
    "wire_id",
    "span_id",
    "bundle_id",
    "from_tower",
    "to_tower",
    "azimuth",
    "x0",
    "y0",
    "span",
    "c",
    "u0",
    "z0",
    "v0",
    "v1",
    "swing",
    "sag",
    "length",
    "rms",
    "points",
    "seen_from",
    "seen_to",
    "seen_share",
    "longest_gap",
    "conductors",
    "expected",
    "z_start",
    "z_end",
    "curvature",
    *COVARIANCES,
    "sd_c",
    "sd_u0",
    "sd_z0",
    "sd_sag",
)
TOWER_COLUMNS = (
    "tower_id",
    "kind",
    "height",
    "top",
    "low_wire",
    "high_wire",
    "azimuth",
    "width",
    "arms",
    "string",
    "body",
    "points",
    "sd_along",
    "certain",
)


def wire_layer(wires: Sequence[Wire], origin: Floats, metre: float, crs: CRS | None) -> Vector:
    """Vector layer with one line per conductor and span.

    Parameters
    ----------
    wires : in metres from the origin
    origin : array of shape (3,), in the unit of the data
    metre : length of one metre in that unit
    """
    counts = conductor_counts(wires)
    rows = [wire_row(wire, origin, metre) | _counted(*counts[wire.span]) for wire in wires]
    lines = [shapely.LineString(vertices(wire.curve) * metre + origin) for wire in wires]
    layer = _layer(rows, lines, (*WIRE_COLUMNS, DROP), crs, "LineString Z")
    frame = layer.frame.copy()
    frame.insert(WIRE_COLUMNS.index("swing") + 1, SWING_SD, swing_sigmas(layer))
    return Vector(frame, geometry_type="LineString Z")


def vertices(curve: Catenary) -> Floats:
    """Positions along a curve whose chords are within CHORD_ERROR of it, array of shape (n, 3)."""
    step = math.sqrt(8 * CHORD_ERROR * curve.c)
    count = max(8, math.ceil(curve.length / step)) + 1
    return curve.points(np.linspace(0.0, curve.length, count))


def wire_row(wire: Wire, origin: Floats, metre: float) -> dict[str, Any]:
    """The columns of one conductor in one span; see `docs/explanation/power-lines.md`."""
    curve, sigma = wire.curve, wire.curve.sigmas()
    covariance = np.full((3, 3), np.nan) if curve.covariance is None else curve.covariance
    return {
        "wire_id": wire.wire,
        "span_id": wire.span,
        "bundle_id": wire.bundle,
        "from_tower": wire.supports[0] + 1,
        "to_tower": wire.supports[1] + 1,
        "azimuth": math.degrees(math.atan2(curve.ex, curve.ey)) % 360,
        "x0": origin[0] + metre * curve.x,
        "y0": origin[1] + metre * curve.y,
        "span": curve.length,
        "c": curve.c,
        "u0": curve.u0,
        "z0": origin[2] + metre * curve.z0,
        "v0": curve.v0,
        "v1": curve.v1,
        "swing": math.degrees(math.atan(curve.swing)) if curve.swing else math.nan,
        "sag": curve.sag,
        "length": curve.arc,
        "rms": curve.rms,
        "points": curve.count,
        "seen_from": wire.known[0],
        "seen_to": wire.known[1],
        "seen_share": wire.seen_share,
        "longest_gap": wire.longest_gap,
        "z_start": origin[2] + metre * curve.z_start,
        "z_end": origin[2] + metre * curve.z_end,
        "curvature": curve.curvature,
        **{name: float(covariance[entry]) for name, entry in COVARIANCES.items()},
        **{f"sd_{name}": value for name, value in sigma.items()},
        DROP: int(wire.drop),
    }


def _counted(found: int, expected: int | None) -> dict[str, float]:
    """The columns on the conductors of a span."""
    return {"conductors": found, "expected": math.nan if expected is None else expected}


def missing_columns(layer: Vector) -> str:
    """The problem with a layer that lacks columns of wires; empty if it has all."""
    missing = [name for name in WIRE_COLUMNS if name not in layer.names]
    if not missing:
        return ""
    shown = ", ".join(missing[:5]) + (", ..." if len(missing) > 5 else "")
    return f"no column {shown}; take the wires of corridor.extract"


def catenaries_of(layer: Vector, origin: Floats) -> list[Catenary]:
    """The catenaries in a layer made by :func:`wire_layer`, in metres from an origin.

    Parameters
    ----------
    layer : with the columns WIRE_COLUMNS; the covariance may be missing
    origin : array of shape (3,), in the unit of the layer
    """
    metre = layer.metre
    found = []
    for row in layer.frame.to_dict("records"):
        turn = math.radians(row["azimuth"])
        covariance = np.empty((3, 3))
        for name, (i, j) in COVARIANCES.items():
            covariance[i, j] = covariance[j, i] = row[name]
        found.append(
            Catenary(
                (row["x0"] - origin[0]) / metre,
                (row["y0"] - origin[1]) / metre,
                math.sin(turn),
                math.cos(turn),
                row["span"],
                (row["z_start"] - origin[2]) / metre,
                (row["z_end"] - origin[2]) / metre,
                row["curvature"],
                row["v0"],
                row["v1"],
                0.0 if pd.isna(row["swing"]) else math.tan(math.radians(row["swing"])),
                row["rms"],
                int(row["points"]),
                covariance if np.isfinite(covariance).all() else None,
            )
        )
    return found


def swing_sigmas(layer: Vector) -> Floats:
    """Standard deviation of the swing of each wire, degrees, array of shape (m,).

    A swing bows a wire in plan, so that its tangent is 2 c times the second coefficient of a
    parabola. The formula is that of such a coefficient for points that stand evenly on what was
    seen of the wire, times how far the wires of the span disagree that were seen in one wind. NaN
    where the swing is not known.
    """
    frame = layer.frame
    noise = frame["rms"] / math.sqrt(2.0)  # of the two directions square to the wire, one
    reach = frame["seen_to"] - frame["seen_from"]
    bow = noise * np.sqrt(180.0 / frame["points"]) / reach**2
    swing = frame["swing"].to_numpy(float)
    tangent = np.tan(np.radians(swing))
    alone: Floats = np.asarray(np.degrees(2 * bow / frame["curvature"] / (1 + tangent**2)), float)
    winds = winds_of(layer)
    factors = {k: disagreement_of(swing[winds == k], alone[winds == k]) for k in np.unique(winds)}
    return np.asarray(alone * np.array([factors[wind] for wind in winds], float), float)


def winds_of(layer: Vector) -> NDArray[np.int64]:
    """A number for the span and the wind in which each wire was seen, array of shape (m,).

    Where conductors of a span were seen in two positions there were two winds, and between the
    swings of one and of the other is the widest gap.
    """
    frame = layer.frame
    swing, later = frame["swing"].to_numpy(float), np.zeros(len(frame), bool)
    for _, own in frame.reset_index(drop=True).groupby("span_id"):
        known = np.sort(own["swing"].dropna())
        if own["wire_id"].duplicated().any() and len(known) > 1:
            widest = int(np.diff(known).argmax())
            later[own.index] = swing[own.index] > known[widest]
    return np.asarray(2 * frame["span_id"].to_numpy(np.int64) + later, np.int64)


def disagreement_of(values: Floats, sigmas: Floats) -> float:
    """How many times farther the values of wires are apart than their errors say, at least 1.

    One wind swings all wires of a span, so their swings differ by their errors. This is the Birge
    ratio, the root of chi-square over the degrees of freedom; values without an error are left out.

    Parameters
    ----------
    values, sigmas : arrays of shape (m,), and their standard deviations, in the same unit
    """
    known = sigmas > 0  # not NaN
    if known.sum() < 2:
        return 1.0
    values, weights = values[known], sigmas[known] ** -2.0
    squares = weights * (values - np.average(values, weights=weights)) ** 2
    return max(1.0, math.sqrt(squares.sum() / (len(values) - 1)))


def tower_layer(
    towers: Sequence[Tower],
    wires: Sequence[Wire],
    strings: Sequence[float],
    origin: Floats,
    metre: float,
    crs: CRS | None,
) -> Vector:
    """Vector layer with one point per tower or pole, at its foot."""
    rows, points = [], []
    held = _held(wires)
    for number, (tower, string) in enumerate(zip(towers, strings, strict=True)):
        support = tower.support
        ends = held.get(number, [support.low, support.high])
        azimuth = math.degrees(math.atan2(*support.across)) % 180
        rows.append(
            {
                "tower_id": number + 1,
                "kind": "tower" if tower.lattice else "pole",
                "height": tower.top - support.ground,
                "top": origin[2] + metre * tower.top,
                "low_wire": origin[2] + metre * min(ends),
                "high_wire": origin[2] + metre * max(ends),
                "azimuth": azimuth,
                "width": 2 * tower.width,
                "arms": support.reach[1] - support.reach[0],
                "string": string or math.nan,
                "body": support.body,
                "points": len(tower.points),
                "sd_along": support.sd_along if math.isfinite(support.sd_along) else math.nan,
                "certain": int(tower.is_certain),
            }
        )
        foot = np.array([support.x, support.y, support.ground]) * metre + origin
        points.append(shapely.Point(foot))
    return _layer(rows, points, TOWER_COLUMNS, crs, "Point Z")


def _held(wires: Sequence[Wire]) -> dict[int, list[float]]:
    """Heights of the ends of wires at each tower, by its number from 0."""
    held: dict[int, list[float]] = {}
    for wire in wires:
        heights = (wire.curve.z_start, wire.curve.z_end)
        for number, height in zip(wire.supports, heights, strict=True):
            held.setdefault(number, []).append(height)
    return held


def _layer(
    rows: Sequence[dict[str, Any]],
    shapes: Iterable[shapely.Geometry],
    columns: Sequence[str],
    crs: CRS | None,
    geometry_type: str,
) -> Vector:
    frame = geopandas.GeoDataFrame(list(rows), columns=columns, geometry=list(shapes), crs=crs)
    return Vector(frame, geometry_type=geometry_type)
