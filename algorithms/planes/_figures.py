"""Measures of a plane: where it lies, and how well points fit it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.plane_fit import Plane

LEVEL = 1e-9  # radians; planes that lean less have no direction
UP = np.array([1e-18, 1e-9, 1.0])  # upright normals look north, or else east

Floats = NDArray[np.float64]


class Figures(NamedTuple):
    """Measures of a plane; see the outputs of :class:`PlanesFit`."""

    normal_x: float
    normal_y: float
    normal_z: float
    offset: float
    height: float
    tilt: float
    azimuth: float
    rms: float
    standard_error: float


def figures(plane: Plane, away: Floats) -> Figures:
    """Measures of a plane, from it and the distances of its points, array of shape (m,)."""
    east, north, up = plane.normal.tolist()
    level, side = math.hypot(east, north), math.copysign(1.0, up)
    azimuth = math.degrees(math.atan2(side * east, side * north)) % 360.0
    squares, free = math.fsum((away * away).tolist()), len(away) - 3
    return Figures(
        normal_x=east,
        normal_y=north,
        normal_z=up,
        offset=plane.offset,
        height=float(plane.centre[2] + plane.origin[2]),
        tilt=math.degrees(math.atan2(level, abs(up))),
        azimuth=azimuth if level > LEVEL else math.nan,
        rms=math.sqrt(squares / len(away)),
        standard_error=math.sqrt(squares / free) if free else math.nan,
    )
