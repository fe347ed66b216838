"""Surveys of many kinds of water, and of dry land that looks like it, with known shores.

Nothing here is shared with `samples.scene`: the terrain is a sum of waves, shores are wobbly rings,
and pulses fall at random, so that a tool tuned on the one meets something else in the other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.data import PointCloud

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

UTM = CRS(32635)
ORIGIN = np.array([400_000.0, 5_000_000.0, 0.0])
MOST_POINTS = 100_000
SIDES = 110.0, 600.0  # m, of the square that is surveyed
RIM = 0.8  # m that the land around a water is higher than its level
GRASS, WOOD, ASPHALT, FLOAT = 0, 1, 2, 3  # what covers the land; FLOAT is on the water
BRIGHT = {GRASS: 7.0, WOOD: 6.6, ASPHALT: 5.3, FLOAT: 6.8}  # logarithm of the intensity
DARK = 5.0  # that of water


@dataclass(frozen=True)
class Water:
    """A water body: its true outline, its level, and how steep its bank is.

    Attributes
    ----------
    shape : polygon with its islands as holes, without the origin
    level : m
    bank : slope of the shore
    fall : by which the surface falls eastwards, m per m
    """

    shape: Any
    level: float
    bank: float = 0.3
    fall: float = 0.0


@dataclass
class Land:
    """What a scene is made of, to be changed by its kind.

    Attributes
    ----------
    side : of the square, m
    density : pulses per m2
    noise : standard deviation of points on water, m
    returned : share of the pulses that water returns
    contrast : logarithm of the intensity of land over that of water
    strips : shift of the water in each flight over it, m: level of that day, less the first
    mixed : whether flights lie over one another rather than side by side
    named : whether points tell their flight
    swell : length of the waves, m
    """

    rng: np.random.Generator
    side: float
    density: float
    noise: float
    returned: float
    contrast: float = 2.0
    strips: tuple[float, ...] = (0.0,)
    mixed: bool = False
    named: bool = True
    waters: list[Water] = field(default_factory=list)
    shape: Callable[[Floats, Floats, Floats], Floats] | None = None
    cover: Callable[[Floats, Floats, NDArray[np.int64]], None] | None = None
    above: Callable[[Floats, Floats, Mask], tuple[Floats, NDArray[np.int64]]] | None = None
    relief: float = 4.0
    swell: float | None = None


@dataclass(frozen=True)
class Survey:
    """Points of a scene, and the waters that are in them."""

    kind: str
    points: PointCloud
    waters: list[Water]
    land: Land

    @property
    def outlines(self) -> list[Any]:
        """True outlines within the data, where the points are."""
        square = shapely.box(0, 0, self.land.side, self.land.side)
        shapes = [water.shape.intersection(square) for water in self.waters]
        return [shapely.transform(shape, lambda xy: xy + ORIGIN[:2]) for shape in shapes]


def ring(rng: np.random.Generator, x: float, y: float, radius: float, wobble: float = 0.15) -> Any:
    """A wobbly ring about a centre."""
    angle = np.linspace(0, 2 * np.pi, 181)[:-1]
    away = np.ones_like(angle)
    for k in (2, 3, 5):
        away += wobble / k * 2 * np.sin(k * angle + rng.uniform(0, 2 * np.pi))
    away *= radius
    return shapely.Polygon(np.column_stack([x + away * np.cos(angle), y + away * np.sin(angle)]))


def survey(kind: str, seed: int, **fixed: Any) -> Survey:
    """A scene of a kind; the seed decides on all else that is not given.

    Parameters
    ----------
    kind : one of KINDS or OF_SEVERAL
    seed : the same seed gives the same scene
    fixed : density, noise, returned, contrast, strips, mixed, named, swell: see :class:`Land`
    """
    rng = np.random.default_rng([seed, *kind.encode()])
    density = fixed.get("density", float(np.exp(rng.uniform(np.log(0.3), np.log(20)))))
    side = float(np.clip(np.sqrt(MOST_POINTS / density), *SIDES))
    land = Land(
        rng,
        side,
        density,
        float(rng.uniform(0.02, 0.15)),
        float(rng.choice((0.0, 0.05, 0.3, 1.0), p=(0.15, 0.25, 0.3, 0.3))),
    )
    if kind == "rice_wet" and "density" not in fixed:  # bunds of 4 m are not to be seen by fewer
        land.density = max(land.density, 2.0)
        land.side = float(np.clip(np.sqrt(MOST_POINTS / land.density), *SIDES))
    (KINDS | OF_SEVERAL)[kind](land)
    for name, value in fixed.items():
        setattr(land, name, value)
    return Survey(kind, _pulses(land, kind), land.waters, land)


def _pulses(land: Land, kind: str) -> PointCloud:
    """Last returns of a scene."""
    rng = land.rng
    x, y = _scan(land)
    count = len(x)
    ground = _ground(land, x, y)
    wet, surface, z = np.zeros(count, bool), np.full(count, -np.inf), ground.copy()
    for water in land.waters:
        away = _signed(water.shape, x, y)
        level = water.level - water.fall * x
        near = away < RIM / water.bank + 20
        z[near] = np.clip(
            z[near],
            (level + np.minimum(water.bank * away, RIM))[near],
            (level + water.bank * away)[near],
        )
        wet |= away < 0
        surface[away < 0] = level[away < 0]
    cover = np.where(_patches(land, x, y) > 0.8, WOOD, GRASS)
    if land.cover:
        land.cover(x, y, cover)
    strip = _strip(land, x)
    shift = np.asarray(land.strips)[strip]
    noise = np.where(wet, land.noise * _swell(land, x, y), rng.normal(0, 0.025, count))
    z = np.where(wet, surface + shift, z) + noise
    on_water = wet.copy()
    if land.above:
        height, what = land.above(x, y, wet)
        hit = height > 0
        z[hit] += height[hit]
        cover[hit] = what[hit]
        on_water &= ~hit
    trunks = (cover == WOOD) & ~wet & (rng.random(count) < 0.5)
    z[trunks] += rng.uniform(0.5, 12, trunks.sum())
    kept = ~on_water | (rng.random(count) < land.returned)
    bright = np.array([BRIGHT[k] for k in range(4)])[cover] + 0.3 * _patches(land, x, y)
    bright = np.where(on_water, 7.0 - land.contrast, bright)
    intensity = rng.lognormal(bright, 0.25)
    ones = np.ones(int(kept.sum()), np.uint8)
    columns: dict[str, Any] = {
        "intensity": np.clip(intensity[kept], 1, 65535).astype(np.uint16),
        "return_number": ones,
        "number_of_returns": ones,
    }
    if land.named:
        columns["point_source_id"] = (strip[kept] + 1).astype(np.uint16)
    xyz = np.round(np.column_stack([x, y, z])[kept], 3) + ORIGIN
    return PointCloud(xyz, columns, crs=UTM, name=f"{kind}.laz")


def _scan(land: Land) -> tuple[Floats, Floats]:
    """Pulses in jittered lines, twice as far apart as pulses in a line; some are lost."""
    rng, step = land.rng, np.sqrt(0.9 / land.density)
    x, y = np.meshgrid(
        np.arange(0, land.side, step * np.sqrt(2)), np.arange(0, land.side, step / np.sqrt(2))
    )
    x, y = (v.ravel() + rng.normal(0, 0.3 * step, v.size) for v in (x, y))
    kept = (x >= 0) & (y >= 0) & (x < land.side) & (y < land.side) & (rng.random(len(x)) < 0.9)
    return x[kept], y[kept]


def _swell(land: Land, x: Floats, y: Floats) -> Floats:
    """Heights on water, of standard deviation 1: noise, and as much of waves of 3 to 20 m.

    They are no longer than a quarter of the smallest water.
    """
    angle, phase = land.rng.uniform(0, 2 * np.pi, 2)
    smallest = min((water.shape.area for water in land.waters), default=0.0)
    longest = float(np.clip(np.sqrt(smallest) / 4, 3, 20))
    wave = (x * np.cos(angle) + y * np.sin(angle)) / (land.swell or land.rng.uniform(3, longest))
    own = land.rng.normal(0, np.sqrt(0.5), len(x))
    return np.asarray(own + np.sin(2 * np.pi * wave + phase))


def _patches(land: Land, x: Floats, y: Floats) -> Floats:
    """Fields and woods: a pattern of about -1 to 1."""
    a, b, c = land.rng.uniform(0, 2 * np.pi, 3)
    return np.asarray((np.sin(x / 17 + a) + np.sin(y / 23 + b) + np.sin((x + y) / 40 + c)) / 2)


def _strip(land: Land, x: Floats) -> NDArray[np.int64]:
    """Flight of each pulse: side by side with an overlap of a tenth, or all over one another."""
    count = len(land.strips)
    if land.mixed:
        return np.asarray(land.rng.integers(0, count, len(x)))
    place = x / land.side * count + land.rng.uniform(-0.05, 0.05, len(x)) * count
    return np.asarray(np.clip(place, 0, count - 1e-9).astype(np.int64))


def _ground(land: Land, x: Floats, y: Floats) -> Floats:
    """Rolling land, or what the kind makes of it."""
    rng, z = land.rng, np.full(len(x), 100.0)
    for wave, share in ((1.3, 0.6), (0.6, 0.3), (0.2, 0.08), (0.06, 0.02)):
        angle, phase = rng.uniform(0, 2 * np.pi, 2)
        along = x * np.cos(angle) + y * np.sin(angle)
        z += land.relief * share * np.sin(2 * np.pi * along / (wave * land.side) + phase)
    return land.shape(x, y, z) if land.shape else z


def _signed(shape: shapely.Polygon, x: Floats, y: Floats) -> Floats:
    """Distance to the shore, negative on water."""
    shapely.prepare(shape)
    away = shapely.distance(shapely.points(x, y), shape.boundary)
    return np.asarray(np.where(shapely.contains_xy(shape, x, y), -away, away))


def _middle(land: Land, share: float = 0.28) -> Any:
    """The outline of one lake in the middle."""
    x, y = land.side * land.rng.uniform(0.42, 0.58, 2)
    return ring(land.rng, float(x), float(y), share * land.side)


# Waters.


def calm(land: Land) -> None:
    """A lake with points of 2 to 5 cm."""
    land.noise = float(land.rng.uniform(0.02, 0.05))
    land.waters.append(Water(_middle(land), 99.0, float(land.rng.uniform(0.1, 0.6))))


def waves(land: Land) -> None:
    """A lake with points of 7 to 15 cm."""
    land.noise = float(land.rng.uniform(0.07, 0.15))
    land.waters.append(Water(_middle(land), 99.0, float(land.rng.uniform(0.1, 0.6))))


def dim(land: Land) -> None:
    """A lake that is hardly darker than its shore and returns few pulses."""
    land.contrast, land.returned = 0.3, float(land.rng.choice((0.02, 0.1, 0.25)))
    land.waters.append(Water(_middle(land), 99.0))


def ponds(land: Land) -> None:
    """Four ponds at levels of their own."""
    for x, y in ((0.25, 0.25), (0.75, 0.3), (0.3, 0.75), (0.72, 0.72)):
        radius = max(0.08 * land.side, 8.0)
        shape = ring(land.rng, x * land.side, y * land.side, radius)
        land.waters.append(Water(shape, 99.0 + float(land.rng.uniform(-1, 1)), 0.5))


def mud(land: Land) -> None:
    """A lake with banks of 3 %."""
    land.waters.append(Water(_middle(land, 0.25), 99.0, 0.03))


def islands(land: Land) -> None:
    """A lake with three islands."""
    shape = _middle(land, 0.32)
    for _ in range(3):
        x, y = (
            shapely.get_coordinates(shape.centroid)[0]
            + land.rng.uniform(-0.18, 0.18, 2) * land.side
        )
        shape = shape.difference(ring(land.rng, x, y, max(0.03 * land.side, 5.0)))
    shape = max(shapely.get_parts(shape), key=lambda part: part.area)
    land.waters.append(Water(shape, 99.0, 0.4))


def reeds(land: Land) -> None:
    """A lake with reeds of 1.5 m along half of its shore."""
    shape, rng = _middle(land, 0.3), land.rng
    land.waters.append(Water(shape, 99.0, 0.15))

    def above(x: Floats, y: Floats, wet: Mask) -> tuple[Floats, NDArray[np.int64]]:
        here = wet & (_signed(shape, x, y) > -4) & (x > land.side / 2) & (rng.random(len(x)) < 0.7)
        return np.where(here, rng.uniform(0.05, 1.5, len(x)), 0), np.full(len(x), GRASS)

    land.above = above


def plants(land: Land) -> None:
    """A lake with bright floating leaves on a fifth of it, some centimetres high."""
    shape, rng = _middle(land, 0.3), land.rng
    land.waters.append(Water(shape, 99.0, 0.3))
    phase = rng.uniform(0, 2 * np.pi, 2)

    def above(x: Floats, y: Floats, wet: Mask) -> tuple[Floats, NDArray[np.int64]]:
        patch = np.sin(x / 7 + phase[0]) + np.sin(y / 9 + phase[1]) > 1.0
        return np.where(wet & patch, rng.uniform(0.01, 0.08, len(x)), 0), np.full(len(x), FLOAT)

    land.above = above


def boats(land: Land) -> None:
    """A lake with boats of 8 by 3 m, 1 to 3 m high."""
    shape, rng = _middle(land, 0.3), land.rng
    land.waters.append(Water(shape, 99.0, 0.5))
    places = rng.uniform(0.25, 0.75, (12, 2)) * land.side

    def above(x: Floats, y: Floats, wet: Mask) -> tuple[Floats, NDArray[np.int64]]:
        on = np.zeros(len(x), bool)
        for px, py in places:
            on |= (abs(x - px) < 4) & (abs(y - py) < 1.5)
        return np.where(wet & on, rng.uniform(1, 3, len(x)), 0), np.full(len(x), GRASS)

    land.above = above


def bridge(land: Land) -> None:
    """A lake below a bridge of 8 m, 5 m high."""
    shape = _middle(land, 0.3)
    land.waters.append(Water(shape, 99.0, 0.4))

    def above(x: Floats, y: Floats, wet: Mask) -> tuple[Floats, NDArray[np.int64]]:
        on = abs(x - land.side / 2 + 0.2 * (y - land.side / 2)) < 4
        return np.where(wet & on, 5.0, 0), np.full(len(x), ASPHALT)

    land.above = above
    deck = shapely.LineString([(land.side * 0.6, 0), (land.side * 0.4, land.side)]).buffer(4 * 1.02)
    parts = [p for p in shapely.get_parts(shape.difference(deck)) if p.area > 100]
    land.waters[:] = [Water(part, 99.0, 0.4) for part in parts]
    # Below the deck the ground is water, too, but no pulse gets there.
    land.shape = lambda x, y, z: np.where(
        shapely.contains_xy(shape, x, y)
        & (abs(x - land.side / 2 + 0.2 * (y - land.side / 2)) < 4.2),
        104.0,
        z,
    )


def dam(land: Land) -> None:
    """A reservoir behind a dam, with land 8 m lower below it."""
    shape = _middle(land, 0.3)
    line = 0.35 * land.side
    shape = shape.intersection(shapely.box(0, line, land.side, land.side))
    land.waters.append(Water(shape, 99.0, 0.4))

    def below(x: Floats, y: Floats, z: Floats) -> Floats:
        crest = 101.0 - np.maximum(line - 5 - y, 0) / 2
        return np.where(y < line, np.maximum(np.minimum(z, crest), z - 10), np.maximum(z, 99.5))

    land.shape = below


def ice(land: Land) -> None:
    """A frozen lake: level, as bright as land, every pulse comes back."""
    land.noise, land.returned, land.contrast = 0.015, 1.0, 0.0
    land.waters.append(Water(_middle(land), 99.0, 0.4))


def sandpit(land: Land) -> None:
    """A pit of 12 m with water in it, and bare level benches above."""
    shape = _middle(land, 0.2)
    land.waters.append(Water(shape, 90.0, 0.8))

    def pit(x: Floats, y: Floats, z: Floats) -> Floats:
        away = np.maximum(_signed(shape, x, y), 0)
        steps = np.floor(away / 12) * 4 + np.minimum((away % 12) * 1.0, 4)
        return np.asarray(np.minimum(z, 90.0 + np.minimum(steps, 40)))

    land.shape = pit


def trees(land: Land) -> None:
    """A lake below a wood, with crowns over its shore."""
    shape, rng = _middle(land), land.rng
    land.waters.append(Water(shape, 99.0, 0.4))

    def above(x: Floats, y: Floats, wet: Mask) -> tuple[Floats, NDArray[np.int64]]:
        here = wet & (_signed(shape, x, y) > -3) & (rng.random(len(x)) < 0.5)
        return np.where(here, rng.uniform(2, 10, len(x)), 0), np.full(len(x), WOOD)

    def wood(x: Floats, y: Floats, cover: NDArray[np.int64]) -> None:
        cover[_signed(shape, x, y) > 2] = WOOD

    land.above, land.cover = above, wood


def open_edge(land: Land) -> None:
    """A lake that the data cut."""
    shape = ring(land.rng, 0.05 * land.side, 0.5 * land.side, 0.3 * land.side)
    land.waters.append(Water(shape, 99.0, 0.4))


def river(land: Land) -> None:
    """A river that falls by 0.5 to 3 in 1000."""
    fall = float(land.rng.choice((0.0005, 0.001, 0.002, 0.003)))
    land.waters.append(Water(_bed(land), 97.0, 0.4, fall))


def _bed(land: Land) -> Any:
    """The outline of a river from west to east."""
    x = np.linspace(-10, land.side + 10, 60)
    bend = 0.5 * land.side + 0.1 * land.side * np.sin(
        2 * np.pi * x / land.side + land.rng.uniform(0, 6)
    )
    width = float(land.rng.uniform(0.08, 0.15)) * land.side
    return shapely.LineString(np.column_stack([x, bend])).buffer(width / 2 + 3)


def rapids(land: Land) -> None:
    """A river of two or three pools, with rapids of 0.25 to 0.9 m between them."""
    pools, step = int(land.rng.integers(2, 4)), float(land.rng.uniform(0.25, 0.9))
    side, bed, level, half = land.side, _bed(land), 97.0, 0.04 * land.side

    def reach(west: float, east: float, at: float, fall: float = 0.0) -> None:
        part = bed.intersection(shapely.box(west, -side, east, 2 * side))
        land.waters.append(Water(part, at + fall * west, 0.4, fall))

    for k in range(pools):
        west = k * side / pools + half if k else -20.0
        east = (k + 1) * side / pools - half if k < pools - 1 else side + 20
        reach(west, east, level - k * step)
        if k < pools - 1:
            reach(east, east + 2 * half, level - k * step, step / (2 * half))


def fish_ponds(land: Land) -> None:
    """Nine ponds at levels of their own, between dikes of 6 m that are 0.8 m high."""
    wide = 0.8 * land.side / 3
    for i in range(3):
        for j in range(3):
            x, y = 0.1 * land.side + i * wide, 0.1 * land.side + j * wide
            shape = shapely.box(x + 3, y + 3, x + wide - 3, y + wide - 3)
            land.waters.append(Water(shape, 99.0 + float(land.rng.uniform(-0.3, 0.3)), 0.5))


def lock(land: Land) -> None:
    """Two basins between walls, one 1.6 m above the other, with a gate of 4 m between them."""
    side, half = land.side, 0.06 * land.side
    for level, west, east in ((99.0, 0.1 * side, side / 2 - 2), (97.4, side / 2 + 2, 0.9 * side)):
        shape = shapely.box(west, side / 2 - half, east, side / 2 + half)
        land.waters.append(Water(shape, level, 10.0))


def leaves(land: Land) -> None:
    """A lake with leaves up to 25 cm high on two fifths of it, which return each pulse."""
    shape, rng = _middle(land, 0.3), land.rng
    land.returned = min(land.returned, 0.3)
    land.waters.append(Water(shape, 99.0, 0.3))
    phase = rng.uniform(0, 2 * np.pi, 2)

    def above(x: Floats, y: Floats, wet: Mask) -> tuple[Floats, NDArray[np.int64]]:
        patch = np.sin(x / 17 + phase[0]) + np.sin(y / 19 + phase[1]) > 0.35
        return np.where(wet & patch, rng.uniform(0.02, 0.25, len(x)), 0), np.full(len(x), FLOAT)

    land.above = above


def rice_wet(land: Land) -> None:
    """Flooded rice fields at levels of their own, between bunds of 0.3 m."""
    land.noise = float(land.rng.uniform(0.02, 0.04))
    cells, gap = 3, 2.0
    wide = 0.8 * land.side / cells
    for i in range(cells):
        for j in range(cells):
            x, y = 0.1 * land.side + i * wide, 0.1 * land.side + j * wide
            level = 98.0 + 0.4 * i + 0.15 * float(land.rng.integers(-1, 2))
            shape = shapely.box(x + gap, y + gap, x + wide - gap, y + wide - gap)
            land.waters.append(Water(shape, level, 0.8))
    land.shape = lambda x, y, z: 98.35 + 0.4 * np.clip((x - 0.1 * land.side) // wide, 0, 2)


def days(land: Land) -> None:
    """A lake flown on two days, whose level has changed by 3 to 20 cm; the points tell the day."""
    land.noise = float(land.rng.uniform(0.02, 0.05))
    land.strips = (0.0, float(land.rng.choice((-1, 1)) * land.rng.uniform(0.03, 0.20)))
    land.mixed = bool(land.rng.random() < 0.5)
    land.returned = float(land.rng.choice((0.1, 0.3, 1.0)))
    land.waters.append(Water(_middle(land), 99.0, 0.3))


def days_unnamed(land: Land) -> None:
    """The same, and the points do not tell."""
    days(land)
    land.named = False


def plain(land: Land) -> None:
    """A pit lake 4 m below a wide plain with a relief of 5 cm."""
    land.relief = 0.05
    land.waters.append(Water(_middle(land, 0.15), 96.0, 0.6))


# Dry land.


def carpark(land: Land) -> None:
    """A dark car park with a slope of 0.3 to 1.5 %, in a hollow, with cars."""
    _plate(land, ASPHALT, float(land.rng.uniform(0.003, 0.015)), crown=0.0)
    rng = land.rng

    def above(x: Floats, y: Floats, wet: Mask) -> tuple[Floats, NDArray[np.int64]]:
        car = (x % 6 < 4) & (y % 12 < 2) & (np.sin(x // 6 * 12.9 + y // 12 * 78.2) > 0)
        inside = (abs(x - land.side / 2) < 0.2 * land.side) & (
            abs(y - land.side / 2) < 0.2 * land.side
        )
        return np.where(car & inside, rng.uniform(0.8, 1.6, len(x)), 0), np.full(len(x), GRASS)

    land.above = above


def crowned(land: Land) -> None:
    """A dark car park in a hollow, with a crown, a dish, a fall or a twist of 0.1 to 0.4 %."""
    _plate(land, ASPHALT, 0.0, crown=0.0)
    side, rise, shape = land.side, land.rng.uniform(0.001, 0.004), int(land.rng.integers(5))
    base, half = land.shape, 0.2 * side

    def drained(x: Floats, y: Floats, z: Floats) -> Floats:
        u, v = (np.clip(w - side / 2, -half, half) for w in (x, y))
        shapes = -abs(v), -(u**2 + v**2) / (2 * half), abs(v), u, u * v / half
        return np.asarray((base(x, y, z) if base else z) + rise * shapes[shape])

    land.shape = drained


def road(land: Land) -> None:
    """A dark road or long yard in a cutting from edge to edge, which falls along and is drained."""
    rng, middle = land.rng, land.side / 2
    half, deep = float(rng.uniform(3.5, 15)), float(rng.uniform(1, 4))
    fall, across = float(rng.uniform(0.001, 0.02)), float(rng.uniform(0.015, 0.025))
    crown = bool(rng.random() < 0.5)

    def off(x: Floats, y: Floats) -> Floats:
        return np.asarray(y - middle - 0.05 * land.side * np.sin(2 * np.pi * x / land.side))

    def cut(x: Floats, y: Floats, z: Floats) -> Floats:
        away = off(x, y)
        drained = across * np.clip(-abs(away) if crown else away, -half, half)
        bank = 0.5 * np.clip(abs(away) - half, 0, None)
        floor = 98.0 - fall * x + drained
        return np.where(bank < 0.5 * half + deep, floor + np.minimum(bank, deep), z)

    def paved(x: Floats, y: Floats, cover: NDArray[np.int64]) -> None:
        cover[abs(off(x, y)) < half] = ASPHALT

    land.shape, land.cover = cut, paved


def sports(land: Land) -> None:
    """A sports ground with a crown of 0.3 to 0.8 %, lower than the banks around."""
    _plate(land, GRASS, 0.0, crown=float(land.rng.uniform(0.003, 0.008)))


def cutting(land: Land) -> None:
    """A level floor of gravel, 4 m below the land."""
    _plate(land, GRASS, 0.0, crown=0.0, deep=4.0)


def rice_dry(land: Land) -> None:
    """Dry rice fields between bunds, levelled by laser to 1.5 cm."""
    wide = 0.8 * land.side / 3

    def fields(x: Floats, y: Floats, z: Floats) -> Floats:
        i, j = (np.clip((v - 0.1 * land.side) // wide, 0, 2) for v in (x, y))
        u, v = ((w - 0.1 * land.side) % wide for w in (x, y))
        bund = (np.minimum(np.minimum(u, wide - u), np.minimum(v, wide - v)) < 1.0) * 0.3
        rough = 0.015 * np.sin(x / 9 + i) + 0.01 * np.sin(y / 13 + j)
        inside = (abs(x - land.side / 2) < 0.4 * land.side) & (
            abs(y - land.side / 2) < 0.4 * land.side
        )
        return np.where(inside, 98 + 0.4 * i + 0.15 * ((i + 2 * j) % 3) + bund + rough, 99.6)

    land.shape = fields
    land.cover = lambda x, y, cover: cover.fill(GRASS)


def hall(land: Land) -> None:
    """A flat roof with a parapet."""

    def roof(x: Floats, y: Floats, z: Floats) -> Floats:
        out = np.maximum(abs(x - land.side / 2), abs(y - land.side / 2)) - 0.2 * land.side
        return np.where(out < 0, 108.0 + 0.6 * (out > -1.0), z)

    def dark(x: Floats, y: Floats, cover: NDArray[np.int64]) -> None:
        out = np.maximum(abs(x - land.side / 2), abs(y - land.side / 2)) - 0.2 * land.side
        cover[out < 0] = ASPHALT

    land.shape, land.cover = roof, dark


def flat(land: Land) -> None:
    """Fields with a relief of 0.3 m."""
    land.relief = 0.3


def bare_edge(land: Land) -> None:
    """A bare terrace at the edge of the data, lower than all land beside it."""

    def terrace(x: Floats, y: Floats, z: Floats) -> Floats:
        low = 0.12 * land.side
        return np.where(x < low, 95.0, np.minimum(z, 95.0 + 0.5 * (x - low)))

    land.shape = terrace


def hills(land: Land) -> None:
    """Wooded hills with hollows."""
    land.relief = 10.0

    def wood(x: Floats, y: Floats, cover: NDArray[np.int64]) -> None:
        cover[np.sin(x / 30) + np.sin(y / 40) > 0] = WOOD

    land.cover = wood


def _plate(land: Land, what: int, slope: float, *, crown: float, deep: float = 1.0) -> None:
    """A plane square in the middle, lower than the land around."""

    def plate(x: Floats, y: Floats, z: Floats) -> Floats:
        out = np.maximum(abs(x - land.side / 2), abs(y - land.side / 2)) - 0.2 * land.side
        level = 98.0 + slope * (x - land.side / 2) - crown * abs(y - land.side / 2)
        bank = level + np.clip(out, 0, deep)
        return np.where(out < 0, level, np.maximum(np.minimum(z, level + 0.5 * out + deep), bank))

    def paved(x: Floats, y: Floats, cover: NDArray[np.int64]) -> None:
        out = np.maximum(abs(x - land.side / 2), abs(y - land.side / 2)) - 0.2 * land.side
        cover[out < 0] = what

    land.shape, land.cover = plate, paved


WET = (
    calm,
    waves,
    dim,
    ponds,
    mud,
    islands,
    reeds,
    plants,
    boats,
    bridge,
    dam,
    sandpit,
    trees,
    open_edge,
    river,
    fish_ponds,
    lock,
    leaves,
    rice_wet,
    ice,
    days,
    days_unnamed,
    plain,
)
DRY = (carpark, crowned, road, sports, cutting, rice_dry, hall, flat, bare_edge, hills)
KINDS: dict[str, Callable[[Land], None]] = {make.__name__: make for make in (*WET, *DRY)}
OF_SEVERAL = {"rapids": rapids}  # waters that touch
