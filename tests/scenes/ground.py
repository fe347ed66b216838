"""Ground that is hard to find: bridges, banks, dams, terraces, ramps, steep woods, hillsides.

Nothing here is shared with `samples.scene`. Each kind is drawn anew for each seed: sizes, slopes,
density and direction differ. What is ground is known for each point.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
SIDE = 200.0  # metres of the square that is surveyed
CORNER = np.array([400_000.0, 5_000_000.0, 0.0])
NOISE = 0.03  # metres


class Survey(NamedTuple):
    """Points of a scene, which of them are ground, and the height of the ground below each."""

    xyz: Floats
    ground: Mask
    terrain: Floats


class Site(NamedTuple):
    """Pulses of a survey before anything stands on the ground: along and across a direction."""

    rng: np.random.Generator
    along: Floats
    across: Floats
    rolling: Floats


def draw(kind: str, seed: int) -> Survey:
    """The scene of a kind.

    Parameters
    ----------
    kind : one of KINDS
    seed : of the random numbers

    Returns
    -------
    Survey
    """
    rng = np.random.default_rng([seed, *kind.encode()])
    count = round(SIDE * SIDE * np.exp(rng.uniform(np.log(1.0), np.log(12.0))))
    x, y = rng.uniform(0, SIDE, (2, count))
    angle = rng.uniform(0, np.pi)
    east, north = x - SIDE / 2, y - SIDE / 2
    waves = [
        rng.uniform(0.3, 1.5) * np.sin(x / 40 + k * y / 55 + rng.uniform(0, 6)) for k in (-1, 2)
    ]
    site = Site(
        rng,
        east * np.cos(angle) + north * np.sin(angle),
        north * np.cos(angle) - east * np.sin(angle),
        100 + sum(waves),
    )
    terrain, above = KINDS[kind](site)
    z = terrain + above + rng.normal(0, NOISE, count)
    return Survey(np.column_stack([x, y, z]) + CORNER, above < 1e-9, terrain)


def shrubs(site: Site, where: Mask, share: float, low: float, high: float) -> Floats:
    """Heights of a share of the pulses where plants grow, 0 elsewhere."""
    plant = where & (site.rng.random(len(where)) < share)
    return np.where(plant, site.rng.uniform(low, high, len(where)), 0.0)


def bridge(site: Site) -> tuple[Floats, Floats]:
    """A deck that goes on with a road over a valley, and hides what is below."""
    rng = site.rng
    depth, bottom, slope = rng.uniform(5, 9), rng.uniform(4, 15), rng.uniform(0.5, 1.0)
    cut = np.clip(depth - slope * np.maximum(np.abs(site.across) - bottom, 0), 0, depth)
    road = np.abs(site.along) < rng.uniform(4, 7)
    level = 101.0
    terrain = np.where(road, level, site.rolling) - cut
    return terrain, np.where(road & (cut > 0), cut, 0.0)


def embankment(site: Site) -> tuple[Floats, Floats]:
    """A railway on a bank, with shrubs on its flanks."""
    rng = site.rng
    height, top = rng.uniform(3, 7), rng.uniform(3, 6)
    fall = (np.abs(site.across) - top) / rng.uniform(1.3, 1.8)
    terrain = np.maximum(site.rolling, 100 + height - np.maximum(fall, 0))
    flank = (fall > 0) & (terrain > site.rolling)
    return terrain, shrubs(site, flank, rng.uniform(0.05, 0.3), 0.4, 3)


def dam(site: Site) -> tuple[Floats, Floats]:
    """A dam across a valley; shrubs on the side of the air."""
    rng = site.rng
    height, crest = rng.uniform(8, 20), rng.uniform(2, 4)
    valley = np.maximum(np.abs(site.along) - 40, 0) * rng.uniform(0.3, 0.5)
    fall = (np.abs(site.across) - crest) / rng.uniform(1.5, 2.2)
    terrain = np.maximum(site.rolling + valley, 100 + height - np.maximum(fall, 0))
    return terrain, shrubs(site, site.across > crest, rng.uniform(0.05, 0.2), 0.4, 4)


def terraces(site: Site) -> tuple[Floats, Floats]:
    """Terraces with upright walls on a slope, and rows of vines."""
    rng = site.rng
    width, wall = rng.uniform(7, 15), rng.uniform(1.2, 3.0)
    step = np.floor((site.across + 5 * np.sin(site.along / 30)) / width)
    terrain = site.rolling + wall * step
    row = (site.across % 2.0) < 0.4
    return terrain, shrubs(site, row, 0.7, 0.5, 1.8)


def ramps(site: Site) -> tuple[Floats, Floats]:
    """A ramp between walls up to the forecourt of a hall, which stands beside it."""
    rng = site.rng
    height, width = rng.uniform(3, 6), rng.uniform(5, 9)
    ramp = (np.abs(site.across) < width) & (np.abs(site.along) < 40)
    court = (site.along >= 40) & (np.abs(site.across) < 60)
    rise = height * np.clip((site.along + 40) / 80, 0, 1)
    terrain = site.rolling + np.where(ramp, rise, np.where(court, height, 0.0))
    hall = (np.abs(site.along - 5) < 30) & (np.abs(site.across - width - 25) < 20)
    return terrain, np.where(hall, rng.uniform(6, 12), 0.0)


def steep_forest(site: Site) -> tuple[Floats, Floats]:
    """A wooded slope of 25 to 42 degrees, of which few pulses reach the ground."""
    rng = site.rng
    terrain = site.rolling + np.tan(np.radians(rng.uniform(25, 42))) * site.across
    crown = shrubs(site, site.along > -60, rng.uniform(0.5, 0.85), 2.5, 25)
    low = shrubs(site, crown == 0, 0.1, 0.4, 1.5)
    return terrain, crown + low


def hillside(site: Site) -> tuple[Floats, Floats]:
    """Houses and trees on a slope of 15 to 32 degrees; roofs are near the ground above them."""
    rng = site.rng
    slope = np.tan(np.radians(rng.uniform(15, 32)))
    terrain = site.rolling + slope * site.across
    wide, deep = rng.uniform(22, 30), rng.uniform(18, 26)  # of a plot
    length, width, eave = rng.uniform(9, 14), rng.uniform(7, 10), rng.uniform(3.5, 6.0)
    column, row = np.floor(site.along / wide), np.floor(site.across / deep)
    u, v = site.along - (column + 0.5) * wide, site.across - (row + 0.5) * deep
    house = (np.abs(u) < length / 2) & (np.abs(v) < width / 2) & ((column + 2 * row) % 5 > 0)
    roof = eave + 0.6 * (width / 2 - np.abs(v)) - slope * v  # above the ground below it
    above = np.where(house, np.maximum(roof, 0.5), 0.0)
    trees = shrubs(site, ~house & (np.sin(u / 2.5) + np.sin(v / 3.0) > 0.9), 0.7, 0.5, 9)
    return terrain, above + trees


KINDS: dict[str, Callable[[Site], tuple[Floats, Floats]]] = {
    kind.__name__: kind
    for kind in (bridge, embankment, dam, terraces, ramps, steep_forest, hillside)
}
