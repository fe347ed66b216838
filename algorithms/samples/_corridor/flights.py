"""How a scene of a preset is surveyed: strips, the wind between them, and errors of heights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from algorithms.samples._corridor.routes import Range, Route, drawn
from algorithms.samples._corridor.site import Site
from algorithms.samples._survey import (
    NOISE,
    ROD,
    FlightLine,
    Floats,
    survey,
)
from toolbox.context import QUIET, Context

LOWEST_FLIGHT = 120.0  # above the highest ground, m
THICKEST = 0.15  # radius at which a wire is met at most, with half a footprint of the laser, m
EVEN = 0.4  # scatter of pulses by which no wire stays between two columns of them
SPEED = 60.0  # of the aircraft, m/s


@dataclass(frozen=True)
class Flight:
    """Settings of a survey.

    Attributes
    ----------
    density : pulses per square metre, of all strips together
    strips : flown along each leg
    on_wire : points of one wire per 100 m, of all strips together
    noise : standard deviation of heights, metres; two fifths of it aside
    wander : standard deviation of heights that changes over tens of metres, metres
    shift : height differences from strip to strip, metres
    wind : angles by which wires are blown aside, degrees; another one in each strip
    hidden : share of each wire of which no point is recorded, in stretches
    half : width of the survey to both sides of a line, metres
    outliers : share of single returns that are low noise, and as many high noise
    """

    density: float = 12.0
    strips: int = 2
    on_wire: float = 40.0
    noise: float = 0.03
    wander: float = 0.02
    shift: Range = (0.0, 0.0)
    wind: Range = (0.0, 0.0)
    hidden: float = 0.0
    half: float = 35.0
    outliers: float = 0.0002


@dataclass(frozen=True)
class Strip:
    """One flight line, by how much it lies too high, and how the wires hang meanwhile."""

    line: FlightLine
    shift: float
    swing: float  # radians, to the left of each wire


def strips(
    routes: Sequence[Route], flight: Flight, heights: Range, rng: np.random.Generator
) -> list[Strip]:
    """Strips along all legs, there and back in turn, beside each other.

    Parameters
    ----------
    heights : lowest and highest ground, metres
    """
    count = flight.strips
    shifts = np.cumsum([drawn(rng, flight.shift) * rng.choice((-1, 1)) for _ in range(count)])
    side = float(rng.choice((-1, 1)))
    swings = np.radians([side * drawn(rng, flight.wind) for _ in range(count)])
    made = []
    for route in routes:
        for start, end in zip(route.vertices[:-1], route.vertices[1:], strict=True):
            for k, aside in enumerate(np.linspace(-0.3, 0.3, count) if count > 1 else [0.0]):
                line = _flight_line(start, end, aside * flight.half, k % 2 == 1, flight, heights)
                made.append(Strip(line, float(shifts[k] - shifts.mean()), float(swings[k])))
    return made


def _flight_line(
    start: Floats, end: Floats, aside: float, back: bool, flight: Flight, heights: Range
) -> FlightLine:
    """A flight line so high that it sees its whole width also on the highest ground."""
    heading = (end - start) / np.hypot(*(end - start))
    left = np.array([-heading[1], heading[0]])
    first, last = start - flight.half * heading, end + flight.half * heading
    first, last = first + aside * left, last + aside * left
    if back:
        first, last, heading = last, first, -heading
    low, high = heights
    above = max(LOWEST_FLIGHT, 1.5 * (high - low))
    tangent = 1.32 * flight.half / above
    length = float(np.hypot(*(last - first)))
    middle = (low + high) / 2
    x, y = first
    return FlightLine(
        (float(x), float(y)),
        (float(heading[0]), float(heading[1])),
        length,
        tangent * (high + above - middle),
        middle,
        steepest=tangent,
        jitter=EVEN,
    )


def flown(
    site: Site, flight: Flight, all_strips: Sequence[Strip], ctx: Context = QUIET
) -> tuple[Floats, dict[str, NDArray[Any]]]:
    """Points and attributes of a survey of a site."""
    rng = site.rng
    spacing = float(np.sqrt(flight.strips / flight.density))
    radius = min(flight.on_wire / 100 / (2 * flight.density), THICKEST)
    world = site.builder.world()
    shapely.prepare(site.area)

    def inside(x: Floats, y: Floats) -> NDArray[np.bool_]:
        return np.asarray(shapely.contains_xy(site.area, x, y))

    parts = []
    for number, strip in enumerate(all_strips, start=1):
        wires = [rod for wire in site.wires for rod in wire.rods(radius, strip.swing)]
        rods = np.concatenate([np.empty(0, ROD), *site.rods, *wires])
        xyz, columns = survey(
            replace(world, rods=rods),
            [strip.line],
            spacing,
            rng,
            inside=inside,
            truth=("wire_id", "span_id", "tower_id"),
            outliers=flight.outliers,
            first=number,
            ctx=ctx.part((number - 1) / len(all_strips), number / len(all_strips)),
        )
        parts.append((_measured(xyz, columns["gps_time"], flight, strip.shift, rng), columns))
    columns = {name: np.concatenate([part[name] for _, part in parts]) for name in parts[0][1]}
    return np.concatenate([xyz for xyz, _ in parts]), columns


def _measured(
    xyz: Floats, time: Floats, flight: Flight, shift: float, rng: np.random.Generator
) -> Floats:
    """Points of a strip with its errors."""
    more = np.sqrt(max(flight.noise**2 - NOISE**2, 0.0))
    error = rng.normal(0, 1, xyz.shape) * (0.4 * more, 0.4 * more, more)
    error[:, 2] += shift + _wander(time, flight.wander, rng)
    return np.asarray(np.round(xyz + error, 3))


def _wander(time: Floats, size: float, rng: np.random.Generator) -> Floats:
    """An error that changes slowly along the flight: white noise, smoothed over 15 to 40 m."""
    if not len(time):
        return np.zeros(0)
    step, first = 0.02, float(time.min())
    moments = first + step * np.arange(int((time.max() - first) / step) + 3)
    white = rng.normal(0, 1, len(moments))
    smooth = gaussian_filter1d(white, drawn(rng, (15, 40)) / SPEED / step, mode="wrap")
    smooth *= size / float(smooth.std())
    return np.asarray(np.interp(time, moments, smooth), np.float64)
