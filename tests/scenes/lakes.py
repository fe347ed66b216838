"""Waters with known shores, for the tests of this group."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.data import PointCloud

UTM = CRS(32635)
ORIGIN = np.array([500_000.0, 4_600_000.0, 0.0])
LEVEL, RADIUS, SIDE = 120.0, 30.0, 100.0


def lake(
    *,
    seed: int = 0,
    density: float = 4.0,
    returned: float = 0.1,
    bank: float = 0.2,
    centre: tuple[float, float] = (50.0, 50.0),
    island: float = 0.0,
    pond: float = 0.0,
    level: float = LEVEL,
    errors: float = 0.0,
    dark: bool = True,
    noise: float = 0.02,
    crs: CRS | None = UTM,
) -> PointCloud:
    """A square of 100 m with a round lake in a bowl.

    Parameters
    ----------
    returned : share of pulses that the water returns
    bank : slope of the shore
    island : radius of an island in the middle
    pond : radius of a pond at the same level, in the south-western corner
    errors : share of points that lie up to 5 m too low
    dark : whether water returns less intensity than land
    noise : standard deviation of points on the water
    """
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, SIDE, (int(density * SIDE**2), 2))
    away = np.hypot(*(xy - centre).T)
    above = bank * (away - RADIUS)
    if island:
        above = np.maximum(above, bank * (island - away))
    if pond:
        above = np.minimum(above, bank * (np.hypot(*(xy - 10).T) - pond))
    wet = above < 0
    z = level + np.maximum(above, 0) + rng.normal(0, 1, len(xy)) * np.where(wet, noise, 0.02)
    z[rng.random(len(z)) < errors] -= 5 * rng.random()
    intensity = rng.lognormal(np.where(wet & dark, 5.0, 7.0), 0.2).astype(np.uint16)
    kept = ~wet | (rng.random(len(xy)) < returned)
    xyz = np.round(np.column_stack([xy, z])[kept], 3) + ORIGIN
    return PointCloud(xyz, columns(intensity[kept], wet[kept]), crs=crs, name="lake.laz")


def columns(intensity: NDArray[Any], wet: NDArray[np.bool_]) -> dict[str, Any]:
    """Attributes of single returns."""
    ones = np.ones(len(intensity), np.uint8)
    return {
        "intensity": intensity,
        "return_number": ones,
        "number_of_returns": ones,
        "classification": np.where(wet, 9, 2).astype(np.uint8),
    }


def slope(*, seed: int = 0, density: float = 4.0, rise: float = 0.1) -> PointCloud:
    """A square of 100 m of bare slope without water."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, SIDE, (int(density * SIDE**2), 2))
    z = 100 + rise * xy[:, 0] + rng.normal(0, 0.02, len(xy))
    xyz = np.round(np.column_stack([xy, z]), 3) + ORIGIN
    intensity = rng.lognormal(7.0, 0.2, len(xy)).astype(np.uint16)
    return PointCloud(xyz, columns(intensity, np.zeros(len(xy), bool)), crs=UTM, name="slope.laz")


def river(*, seed: int = 0, fall: float = 0.004, returned: float = 0.3) -> PointCloud:
    """400 x 60 m with a river of 20 m that falls eastwards."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 1, (96_000, 2)) * (400, 60)
    above = 0.4 * (abs(xy[:, 1] - 30) - 10)
    wet = above < 0
    z = 120 - fall * xy[:, 0] + np.maximum(above, 0) + rng.normal(0, 0.02, len(xy))
    kept = ~wet | (rng.random(len(xy)) < returned)
    intensity = rng.lognormal(np.where(wet, 5.0, 7.0), 0.2).astype(np.uint16)
    xyz = np.round(np.column_stack([xy, z])[kept], 3) + ORIGIN
    return PointCloud(xyz, columns(intensity[kept], wet[kept]), crs=UTM, name="river.laz")


def floor(*, seed: int = 0, density: float = 2.0, rise: float = 0.02) -> PointCloud:
    """Level ground that one flight covers, beside ground that rises and two cover; no water.

    Parameters
    ----------
    density : of points where one flight covers the ground
    rise : slope of the ground in the east
    """
    rng = np.random.default_rng(seed)
    side = 1.5 * SIDE
    xy = rng.uniform(0, side, (int(2 * density * side**2), 2))
    x, y = xy.T
    kept = (x > 60) | (rng.random(len(x)) < 0.5)
    border = 60 + 8 * np.sin(y / 25)
    z = (
        100
        + np.clip(rise * (x - border), 0, 3)
        + rng.normal(0, 0.025, len(x))
        + 0.02 * np.sin(x / 15)
    )
    xyz = np.round(np.column_stack([xy, z])[kept], 3) + ORIGIN
    intensity = rng.lognormal(7.0, 0.25, len(xyz)).astype(np.uint16)
    return PointCloud(xyz, columns(intensity, np.zeros(len(xyz), bool)), crs=UTM, name="floor.laz")
