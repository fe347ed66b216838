"""The curve of a wire at another temperature or in wind, from its surveyed curve.

Its length without tension is that of the survey, longer by its thermal expansion. The tension in
the new state is the one at which the catenary has just that length, stretched elastically: the
state-change equation. Wind swings the wire about the line between its ends, and pulls at it.

References
----------
Kiessling, F. et al. (2003). Overhead Power Lines. Springer, chapter 14: the change of state.
IEEE Std 738-2012. Calculating the current-temperature relationship of bare overhead conductors.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from algorithms.corridor._curves.catenary import Catenary
from toolbox.data import Table
from toolbox.errors import DataError, nearest

CONDUCTORS_FILE = Path(__file__).parents[1] / "conductors.csv"
GRAVITY = 9.80665  # m/s2
AIR_DENSITY, DRAG = 1.225, 1.0  # kg/m3 at sea level and 15 degrees; of a cylinder of wires
STEFAN = 5.6704e-8  # W/m2/K4
NEEDED_CONDUCTOR_COLUMNS = (
    "name",
    "diameter_mm",
    "area_mm2",
    "mass_kg_per_m",
    "modulus_gpa",
    "expansion_1e_6_per_k",
)
LEAST_C, MOST_C = 2.0, 1e6  # metres of tension over weight that are looked for


@dataclass(frozen=True)
class Conductor:
    """Properties of a conductor in SI units.

    Attributes
    ----------
    diameter : m
    weight : N/m
    stiffness : modulus of elasticity times area, N
    expansion : 1/K
    resistance : ohm/m at 25 and 75 degrees C; NaN where not known
    source, confirmed, note : where the numbers are from
    """

    name: str
    diameter: float
    weight: float
    stiffness: float
    expansion: float
    resistance: tuple[float, float] = (math.nan, math.nan)
    source: str = ""
    confirmed: bool = True
    note: str = ""


def shipped_conductors() -> tuple[str, ...]:
    """Names of the conductors of the toolbox."""
    with CONDUCTORS_FILE.open(encoding="utf-8", newline="") as file:
        return tuple(row["name"] for row in csv.DictReader(file))


def conductor_of(name: str, table: Table | None = None) -> Conductor:
    """Conductor of a given name, from a table or from that of the toolbox.

    Raises
    ------
    DataError
        The table does not have it, or one of its values is missing or not above zero.
    """
    table = Table.open(CONDUCTORS_FILE) if table is None else table
    if missing := [
        column for column in NEEDED_CONDUCTOR_COLUMNS if column not in table.frame.columns
    ]:
        raise DataError(f"{table.name}: no column {', '.join(missing)}; a conductor needs them")
    rows = {str(row["name"]).lower(): row for row in table.frame.to_dict("records")}
    row = rows.get(name.lower())
    if row is None:
        names = [str(known) for known in table.frame["name"]]
        raise DataError(
            f"{table.name}: no conductor {name!r}; there are {', '.join(names)}"
            f"{nearest(name, names)}"
        )
    values = {column: _positive(table.name, row, column) for column in NEEDED_CONDUCTOR_COLUMNS[1:]}
    low, high = (row.get(f"resistance_{t}_ohm_per_km") for t in (25, 75))
    return Conductor(
        name=str(row["name"]),
        diameter=values["diameter_mm"] / 1e3,
        weight=values["mass_kg_per_m"] * GRAVITY,
        stiffness=values["modulus_gpa"] * 1e9 * values["area_mm2"] / 1e6,
        expansion=values["expansion_1e_6_per_k"] / 1e6,
        resistance=(_or_nan(low) / 1e3, _or_nan(high) / 1e3),
        source=_text(row.get("source")),
        confirmed=str(row.get("confirmed", True)).lower() == "true",
        note=_text(row.get("note")),
    )


def all_conductors(table: Table | None = None) -> list[Conductor]:
    """All conductors of a table, or of that of the toolbox."""
    table = Table.open(CONDUCTORS_FILE) if table is None else table
    return [conductor_of(str(name), table) for name in table.frame["name"]]


def _positive(table: str, row: Mapping[Any, Any], column: str) -> float:
    value = row[column]
    good = not pd.isna(value) and not isinstance(value, str) and 0 < value < math.inf
    if not good:
        raise DataError(f"{table}: {row['name']}: {column} must be a number above 0, got {value!r}")
    return float(value)


def _or_nan(value: Any) -> float:
    return math.nan if value is None or pd.isna(value) else float(value)


def _text(value: Any) -> str:
    return "" if value is None or pd.isna(value) else str(value)


@dataclass(frozen=True)
class State:
    """A state of the wires in which clearances are determined.

    Attributes
    ----------
    name : shown in tables and reports
    temperature : of the conductors, degrees C; None as in the survey
    wind : m/s square to the span, above zero where it swings the wires to their left
    """

    name: str
    temperature: float | None = None
    wind: float = 0.0


def wind_load(conductor: Conductor, wind: float) -> float:
    """Wind load per length of wire, N/m, with the sign of the wind; wind in m/s."""
    return 0.5 * AIR_DENSITY * DRAG * conductor.diameter * wind * abs(wind)


def in_state(
    curve: Catenary,
    conductor: Conductor,
    state: State,
    *,
    surveyed: float,
    surveyed_sd: float = 0.0,
    ruling_span: float | None = None,
) -> Catenary:
    """Catenary of a wire in another state, between the same ends.

    Parameters
    ----------
    curve : as surveyed, metres
    conductor : what it is made of
    state : to bring it to
    surveyed, surveyed_sd : temperature of the wire in the survey and its standard deviation, C
    ruling_span : metres: the tension is that of a level span of this length, as in a section of
        spans with hanging insulators; by default that of the span alone

    Returns
    -------
    Catenary
        Its covariance has the uncertainty of the curve surveyed, none if that is not known, and
        that of the temperature.
    """
    warm = surveyed if state.temperature is None else state.temperature

    def bent(curvature: float, degrees: float) -> float:
        return _curvature(
            replace(curve, curvature=curvature), conductor, warm - degrees, state.wind, ruling_span
        )

    curvature = bent(curve.curvature, surveyed)
    step = 1e-3 * curve.curvature
    by_curve = (bent(curve.curvature + step, surveyed) - curvature) / step
    by_degree = curvature - bent(curve.curvature, surveyed + 1.0)
    turn = np.diag([1.0, 1.0, by_curve])
    known = np.zeros((3, 3)) if curve.covariance is None else curve.covariance
    covariance = turn @ known @ turn
    covariance[2, 2] += (by_degree * surveyed_sd) ** 2
    swing = wind_load(conductor, state.wind) / conductor.weight
    return replace(curve, curvature=curvature, swing=swing, covariance=covariance)


def curvature_when(
    curve: Catenary, conductor: Conductor, warmer: float, ruling_span: float | None = None
) -> float:
    """Curvature of a wire `warmer` degrees above its surveyed temperature, in the same wind."""
    load = abs(curve.swing) * conductor.weight
    wind = math.sqrt(load / (0.5 * AIR_DENSITY * DRAG * conductor.diameter))
    return _curvature(curve, conductor, warmer, math.copysign(wind, curve.swing), ruling_span)


def _curvature(
    curve: Catenary, conductor: Conductor, warmer: float, wind: float, ruling_span: float | None
) -> float:
    """Vertical curvature of a wire `warmer` degrees above its surveyed temperature, in wind."""
    span, rise = curve.length, curve.z_end - curve.z_start
    weight, load = conductor.weight, math.hypot(conductor.weight, wind_load(conductor, wind))
    tilt = wind_load(conductor, wind) / weight
    swung, blown = _in_plane(span, rise, curve.swing), _in_plane(span, rise, tilt)
    before, after = (swung, blown) if not ruling_span else ((ruling_span, 0.0),) * 2
    # Tension across the load, which may be tilted in the survey too; of it, the part that points
    # along the span makes the curvature seen from the side.
    start = weight / curve.curvature * swung[0] / span
    loaded = weight * math.hypot(1.0, 0.0 if ruling_span else curve.swing)
    rest = _length(start / loaded, *before) - _stretch(start, loaded, *before, conductor.stiffness)
    rest *= 1 + conductor.expansion * warmer

    def misfit(tension: float) -> float:
        stretch = _stretch(tension, load, *after, conductor.stiffness)
        return _length(tension / load, *after) - stretch - rest

    low = max(LEAST_C, after[0] / 20) * load
    high = MOST_C * load
    if misfit(low) < 0 or misfit(high) > 0:
        raise DataError(
            f"wires: a span of {span:.1f} m with {curve.sag:.2f} m of sag has no state that is "
            f"{warmer:+g} degrees warmer with this conductor"
        )
    tension = float(brentq(misfit, low, high, xtol=1e-6))
    return weight / tension * blown[0] / span


def _in_plane(span: float, rise: float, swing: float) -> tuple[float, float]:
    """Chord of a swung wire, as its extent perpendicular to and along the load."""
    cosine = 1 / math.hypot(1.0, swing)
    return math.sqrt(span**2 + rise**2 * (1 - cosine**2)), rise * cosine


def _length(c: float, span: float, rise: float) -> float:
    """Length of a catenary from its parameter c and the extent of its chord."""
    return math.hypot(2 * c * math.sinh(span / (2 * c)), rise)


def _stretch(tension: float, load: float, span: float, rise: float, stiffness: float) -> float:
    """Elastic elongation of a wire: the integral of the tension along it over the stiffness."""
    c = tension / load
    left = span / 2 - c * math.asinh(rise / (2 * c * math.sinh(span / (2 * c))))
    ends = math.sinh(2 * (span - left) / c) + math.sinh(2 * left / c)
    return tension / stiffness * (span / 2 + c / 4 * ends)


def conductor_temperature(
    conductor: Conductor,
    *,
    current: float,
    air: float,
    wind: float,
    sun: float,
    height: float = 0.0,
    emissivity: float = 0.8,
    absorptivity: float = 0.8,
) -> float:
    """Steady temperature of a wire that carries a current (IEEE 738), degrees C.

    Parameters
    ----------
    conductor : with resistances
    current : A
    air : temperature, degrees C
    wind : m/s square to the wire
    sun : power of the sun on a surface square to it, W/m2
    height : above the sea, metres
    emissivity, absorptivity : of its surface; 0.8 for one that has weathered

    Raises
    ------
    DataError
        The resistance of the conductor is not known, or there is no balance below 400 degrees.
    """
    if not all(map(math.isfinite, conductor.resistance)):
        raise DataError(
            f"conductor {conductor.name}: its resistance is not known, needed for current"
        )
    cold, hot = conductor.resistance
    heat_of_sun = absorptivity * sun * conductor.diameter

    def balance(temperature: float) -> float:
        resistance = cold + (hot - cold) * (temperature - 25) / 50
        lost = cooling(conductor.diameter, temperature, air, wind, height)
        lost += radiation(conductor.diameter, temperature, air, emissivity)
        return lost - current**2 * resistance - heat_of_sun

    if balance(400.0) < 0:
        raise DataError(f"current: {current:g} A heats {conductor.name} beyond 400 degrees")
    return float(brentq(balance, air, 400.0, xtol=1e-6))


def cooling(diameter: float, surface: float, air: float, wind: float, height: float) -> float:
    """Convective heat loss per metre of wire, W/m (IEEE 738-2012, section 4.4.3)."""
    film = (surface + air) / 2
    viscosity = 1.458e-6 * (film + 273) ** 1.5 / (film + 383.4)
    density = (1.293 - 1.525e-4 * height + 6.379e-9 * height**2) / (1 + 0.00367 * film)
    conductivity = 2.424e-2 + 7.477e-5 * film - 4.407e-9 * film**2
    reynolds = diameter * density * wind / viscosity
    warmer = surface - air
    still = 3.645 * math.sqrt(density) * diameter**0.75 * max(warmer, 0.0) ** 1.25
    slow = (1.01 + 1.35 * reynolds**0.52) * conductivity * warmer
    fast = 0.754 * reynolds**0.6 * conductivity * warmer
    return float(max(still, slow, fast))


def radiation(diameter: float, surface: float, air: float, emissivity: float) -> float:
    """Radiated heat loss per metre of wire, W/m."""
    warm = (surface + 273.15) ** 4 - (air + 273.15) ** 4
    return math.pi * STEFAN * diameter * emissivity * warm
