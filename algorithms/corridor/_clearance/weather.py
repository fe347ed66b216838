"""Power of the sun on a wire, from place and time (IEEE 738).

References
----------
IEEE Std 738-2012. Calculating the current-temperature relationship of bare overhead conductors.
Section 4.4.6 and annex: total heat flux of a clear atmosphere, position of the sun.
Spencer, J. W. (1971). Fourier series representation of the position of the sun. Search 2(5), 172:
the equation of time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
from pyproj import Transformer
from pyproj.exceptions import CRSError, ProjError

from algorithms.corridor._curves.catenary import Catenary
from toolbox.data import Vector
from toolbox.data.crs import horizontal_crs
from toolbox.errors import DataError

# Of a polynomial in the altitude of the sun in degrees: W/m2 square to it, in a clear atmosphere.
CLEAR_SKY = (-42.2391, 63.8044, -1.9220, 3.46921e-2, -3.61118e-4, 1.94318e-6, -4.07608e-9)


def time_of(text: str) -> datetime:
    """Time of a text in the form of ISO 8601 with its offset from UTC.

    Raises
    ------
    ValueError
        It is no such time.

    Examples
    --------
    >>> time_of("2024-06-10T11:00+02:00").hour
    9
    """
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        time = None
    if time is None or time.tzinfo is None:
        raise ValueError(
            "must be date and time with the offset from UTC, as 2024-06-10T11:00+02:00, "
            f"got {text!r}"
        )
    return time.astimezone(UTC)


def place_of(layer: Vector) -> tuple[float, float]:
    """Longitude and latitude of the middle of a layer, degrees.

    Raises
    ------
    DataError
        Its CRS is not one of places on the Earth.
    """
    if layer.frame.crs is None:
        raise DataError(
            f"{layer.name}: survey_time needs its place on the Earth, and it has no CRS"
        )
    try:
        turned = Transformer.from_crs(horizontal_crs(layer.frame.crs), 4326, always_xy=True)
        west, south, east, north = layer.frame.total_bounds
        longitude, latitude = turned.transform((west + east) / 2, (south + north) / 2)
    except (ProjError, CRSError) as error:
        raise DataError(
            f"{layer.name}: survey_time needs its place on the Earth: {error}"
        ) from None
    return float(longitude), float(latitude)


def sun_at(time: datetime, longitude: float, latitude: float) -> tuple[float, float]:
    """Altitude of the sun and its azimuth from north by east, degrees; place in degrees."""
    day = time.timetuple().tm_yday
    year = 2 * math.pi * (day - 1) / 365
    ahead = 229.18 * (
        7.5e-5
        + 1.868e-3 * math.cos(year)
        - 3.2077e-2 * math.sin(year)
        - 1.4615e-2 * math.cos(2 * year)
        - 4.0849e-2 * math.sin(2 * year)
    )  # minutes of the sun before the clock
    minutes = 60 * time.hour + time.minute + time.second / 60 + 4 * longitude + ahead
    return position_of_sun(day, minutes / 60, latitude)


def position_of_sun(day: int, hour: float, latitude: float) -> tuple[float, float]:
    """Altitude and azimuth of the sun on a day of the year, at an hour of solar time, degrees."""
    north = math.radians(latitude)
    tilt = math.radians(23.46 * math.sin(2 * math.pi * (284 + day) / 365))
    turn = math.radians(15 * (hour - 12))
    up = math.cos(north) * math.cos(tilt) * math.cos(turn) + math.sin(north) * math.sin(tilt)
    east = -math.cos(tilt) * math.sin(turn)
    ahead = math.sin(tilt) * math.cos(north) - math.cos(tilt) * math.sin(north) * math.cos(turn)
    return math.degrees(math.asin(up)), math.degrees(math.atan2(east, ahead)) % 360


def clear_sky(altitude: float, height: float) -> float:
    """Power of the sun in a clear atmosphere on a surface square to it, W/m2; height in metres."""
    if altitude <= 0:
        return 0.0
    power = sum(factor * altitude**k for k, factor in enumerate(CLEAR_SKY))
    return max(power, 0.0) * (1 + 1.148e-4 * height - 1.108e-8 * height**2)


def sun_on(
    curves: Sequence[Catenary], time: datetime, longitude: float, latitude: float, height: float
) -> float:
    """Power of the sun square to wires, W/m2, in the mean of their lengths.

    Parameters
    ----------
    curves : whose axes point east by x and north by y
    longitude, latitude : degrees
    height : above the sea, metres
    """
    altitude, azimuth = sun_at(time, longitude, latitude)
    beam = clear_sky(altitude, height)
    flat = math.cos(math.radians(altitude))
    east, north = math.sin(math.radians(azimuth)), math.cos(math.radians(azimuth))
    along = np.array([flat * (curve.ex * east + curve.ey * north) for curve in curves])
    lengths = np.array([curve.length for curve in curves])
    return float(beam * np.average(np.sqrt(np.maximum(1 - along**2, 0.0)), weights=lengths))
