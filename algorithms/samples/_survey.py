"""Simulation of airborne surveys: terrain, objects, flight lines, and the tracing of pulses.

A pulse is a straight ray that only ever goes down, so the height z is its parameter:
x = x0 + sx * z and y = y0 + sy * z. The first thing that a pulse meets is the highest one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.samples import _survey_kernels as kernels
from toolbox.context import QUIET, Context

Floats = NDArray[np.float64]
Records = NDArray[np.void]
Features = list[tuple[shapely.Geometry, dict[str, Any]]]

EAST, NORTH = 500_000.0, 4_400_000.0  # the scene's south-west corner
NOISE = 0.02  # standard deviation of an airborne point, along the beam and across it, m
STEEPEST = np.tan(np.radians(20.0))  # half opening angle of the scanner
WATER_CHANCE = (0.75, 0.04)  # share of pulses that water returns at nadir, and aside
BLOCK_OF_PULSES = 400_000  # bounds the memory, and the time between two checks for cancellation

UNCLASSIFIED, GROUND, LOW, MEDIUM, HIGH, BUILDING = 1, 2, 3, 4, 5, 6
LOW_NOISE, WATER, GUARD, WIRE, TOWER, CONNECTOR, BRIDGE, HIGH_NOISE = 7, 9, 13, 14, 15, 16, 17, 18
HEDGE = 200  # internal: a block that becomes 3, 4 or 5 by its height above ground

# What a pulse met; `item` counts within the kind.
ON_GROUND, ON_WATER, ON_BLOCK, ON_CROWN, ON_ROD = range(5)

# Ground cover, with the brightness of the bare ground (16-bit intensity).
GRASS, ASPHALT, MEADOW, MUD, REED, FOREST = range(6)
COVER_SHADE = np.array([26000, 7000, 24000, 4500, 17000, 15000], np.float32)
COVER_PLANTS = np.array([0.01, 0.0, 0.3, 0.0, 0.85, 0.2], np.float32)  # share hit above ground
COVER_HEIGHT = np.array([0.2, 0.0, 0.5, 0.0, 2.2, 0.9], np.float32)  # of those plants at most

BLOCK = np.dtype(
    [(name, "f8") for name in ("x", "y", "ux", "uy", "a", "b", "top", "slope", "hip", "base")]
    + [("cls", "u1"), ("object_id", "u4"), ("plane_id", "u4"), ("shade", "f4")]
)
CROWN = np.dtype(
    [(name, "f8") for name in ("x", "y", "base", "top", "radius")]
    + [("shape", "u1"), ("object_id", "u4")]
)
ROUND, CONE, COLUMN = range(3)
ROD = np.dtype(
    [(name, "f8") for name in ("x1", "y1", "z1", "x2", "y2", "z2", "radius")]
    + [("cls", "u1"), ("object_id", "u4"), ("wire_id", "u2"), ("span_id", "u2"), ("tower_id", "u2")]
)


@dataclass(frozen=True)
class SceneData:
    """A survey and its ground truth.

    Attributes
    ----------
    xyz : array of shape (n, 3), projected coordinates in metres, rounded to 0.001
    attributes : LAS attributes and truth attributes, each of shape (n,)
    terrain : (values of shape (rows, cols) float32, west, north, cell), ground without noise
    features : 3-D shapes with their properties; each has a `kind`
    """

    xyz: Floats
    attributes: dict[str, NDArray[Any]]
    terrain: tuple[NDArray[np.float32], float, float, float]
    features: Features


@dataclass(frozen=True)
class Terrain:
    """Elevations at cell centres, in scene coordinates; bilinear in between."""

    values: NDArray[np.float32]  # row 0 in the north
    west: float
    north: float
    cell: float

    def centres(self) -> tuple[Floats, Floats]:
        """Coordinates of all cell centres, x of shape (1, cols) and y of shape (rows, 1)."""
        rows, cols = self.values.shape
        x = np.asarray(self.west + (np.arange(cols) + 0.5) * self.cell, np.float64)
        y = np.asarray(self.north - (np.arange(rows) + 0.5) * self.cell, np.float64)
        return x[None, :], y[:, None]

    def at(self, x: Any, y: Any) -> Floats:
        """Elevation at positions; constant in the outermost half cell."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        z = kernels.bilinear(self.values, self.west, self.north, self.cell, x.ravel(), y.ravel())
        return np.asarray(z).reshape(x.shape)

    def index(self, x: Any, y: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of the nearest cell."""
        rows, cols = self.values.shape
        row = np.clip((self.north - y) / self.cell, 0, rows - 1).astype(np.int64)
        col = np.clip((x - self.west) / self.cell, 0, cols - 1).astype(np.int64)
        return row, col

    def window(self, x: float, y: float, radius: float) -> tuple[tuple[slice, slice], Terrain]:
        """Rows and columns around a position, and the terrain there, which shares its values."""
        (low, high), (left, right) = self.index(
            np.array([x - radius, x + radius]), np.array([y + radius, y - radius])
        )
        part = (slice(int(low), int(high) + 1), slice(int(left), int(right) + 1))
        west, north = self.west + left * self.cell, self.north - low * self.cell
        return part, Terrain(self.values[part], float(west), float(north), self.cell)

    def placed(self) -> tuple[NDArray[np.float32], float, float, float]:
        """Raster values with west, north and cell in projected coordinates."""
        return self.values, EAST + self.west, NORTH + self.north, self.cell


@dataclass(frozen=True)
class FlightLine:
    """A straight flight line, scanned `half` metres to both sides."""

    start: tuple[float, float]
    heading: tuple[float, float]
    length: float
    half: float
    ground: float  # mean elevation below
    steepest: float = STEEPEST  # tangent of half the opening angle of the scanner
    jitter: float = 0.2  # of the angles of pulses, as a share of that between two

    @property
    def altitude(self) -> float:
        """Elevation of the scanner."""
        return float(self.ground + self.half / self.steepest)


@dataclass(frozen=True)
class Pulses:
    """A block of pulses as rays, in the order in which they were sent."""

    x0: Floats
    y0: Floats
    sx: Floats
    sy: Floats
    angle: NDArray[np.float32]  # degrees, negative to the left
    time: Floats
    edge: NDArray[np.bool_]  # first or last of its scan line

    def __len__(self) -> int:
        return len(self.x0)


@dataclass(frozen=True)
class World:
    """The terrain, water and objects that pulses may hit."""

    terrain: Terrain
    cover: NDArray[np.uint8]  # ground cover per terrain cell
    level: NDArray[np.float32]  # water level per terrain cell, -inf far from water
    blocks: Records = field(default_factory=lambda: np.empty(0, BLOCK))
    crowns: Records = field(default_factory=lambda: np.empty(0, CROWN))
    rods: Records = field(default_factory=lambda: np.empty(0, ROD))


@dataclass(frozen=True)
class Echoes:
    """Returns of a block of pulses, before they become points."""

    pulse: NDArray[np.int64]
    z: Floats
    source: NDArray[np.uint8]
    item: NDArray[np.int64]
    facet: NDArray[np.uint8]

    def take(self, which: NDArray[Any]) -> Echoes:
        return Echoes(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


# --- terrain -------------------------------------------------------------------------------


def blank_terrain(west: float, south: float, east: float, north: float) -> Terrain:
    """Level terrain on whole multiples of a cell that keeps the raster under 2000 cells wide."""
    extent = max(east - west, north - south)
    cell = next(c for c in (0.5, 1.0, 2.0, 2.5, 5.0) if extent <= 2002 * c)
    left, low = np.floor(west / cell), np.floor(south / cell)
    shape = (int(np.ceil(north / cell) - low), int(np.ceil(east / cell) - left))
    return Terrain(np.zeros(shape, np.float32), left * cell, (low + shape[0]) * cell, cell)


def rolling(
    rng: np.random.Generator, x: Floats, y: Floats, waves: Sequence[tuple[float, float]]
) -> Floats:
    """Elevations: a sum of plane waves (height, length in metres) of random direction and phase."""
    z = np.zeros(np.broadcast_shapes(x.shape, y.shape))
    for height, length in waves:
        angle, phase = rng.uniform(0, 2 * np.pi, 2)
        k = 2 * np.pi / length
        z += height * np.sin(k * (x * np.cos(angle) + y * np.sin(angle)) + phase)
    return z


def smoothstep(t: Floats) -> Floats:
    """Smooth step: 0 below 0, 1 above 1, a cubic in between."""
    t = np.clip(t, 0, 1)
    return t * t * (3 - 2 * t)


def graded(z: Floats, level: Any, away: Floats, batter: float) -> Floats:
    """Elevations of an earthwork: `level` where `away` is 0, then slopes of `batter` to meet z."""
    rise = np.maximum(away, 0) * batter
    return np.clip(z, level - rise, level + rise)


# --- pulses --------------------------------------------------------------------------------


def parallel_lines(size: float, ground: float, widest: float = 400.0) -> list[FlightLine]:
    """Parallel flight lines over a square, in turn to the north and back, with overlap."""
    count = max(2, int(np.ceil(size / widest)))
    step = size / count
    lines = []
    for i in range(count):
        x, half = (i + 0.5) * step, 0.65 * step
        north = i % 2 == 0
        start, heading = ((x, 0.0), (0.0, 1.0)) if north else ((x, size), (0.0, -1.0))
        lines.append(FlightLine(start, heading, size, half, ground))
    return lines


def fire(
    line: FlightLine, spacing: float, start: float, rng: np.random.Generator
) -> Iterator[Pulses]:
    """Pulses of a rotating mirror, in blocks of whole scan lines; `start` is GPS time."""
    rows = int(np.ceil(line.length / spacing))
    cols = max(2, int(np.ceil(2 * line.half / spacing)))
    hx, hy = line.heading
    period = spacing / 60.0  # the aircraft flies 60 m/s
    angles = np.linspace(-1, 1, cols) * np.arctan(line.steepest)
    step = max(1, BLOCK_OF_PULSES // cols)
    for first in range(0, rows, step):
        shape = (min(first + step, rows) - first, cols)
        row = first + np.arange(shape[0])[:, None]
        tangent = np.tan(angles + rng.normal(0, line.jitter, shape) * (angles[1] - angles[0]))
        # The aircraft moves on while the mirror turns, and it is never quite steady.
        along = (row + np.linspace(0, 1, cols) + rng.normal(0, 0.15, shape)) * spacing
        across = line.altitude * tangent
        yield Pulses(
            x0=(line.start[0] + hx * along + hy * across).ravel(),
            y0=(line.start[1] + hy * along - hx * across).ravel(),
            sx=(-hy * tangent).ravel(),
            sy=(hx * tangent).ravel(),
            angle=np.degrees(np.arctan(tangent)).astype(np.float32).ravel(),
            time=(start + (row + 0.9 * np.linspace(0, 1, cols)) * period).ravel(),
            edge=np.broadcast_to(np.abs(np.linspace(-1, 1, cols)) == 1, shape).ravel(),
        )


# --- tracing -------------------------------------------------------------------------------


class Index(NamedTuple):
    """The objects that a pulse may hit, by the cell in which it reaches the ground."""

    start: NDArray[np.int64]
    items: NDArray[np.int64]
    west: float
    south: float
    cell: float
    rows: int
    cols: int


def _index(terrain: Terrain, boxes: Floats, cell: float = 4.0) -> Index:
    """Index of boxes (n, 4) of xmin, ymin, xmax, ymax by the cells of a terrain."""
    rows, cols = (int(np.ceil(n * terrain.cell / cell)) for n in terrain.values.shape)
    south = terrain.north - terrain.values.shape[0] * terrain.cell
    low = np.floor((boxes[:, :2] - (terrain.west, south)) / cell)
    high = np.floor((boxes[:, 2:] - (terrain.west, south)) / cell)
    limit = (cols - 1, rows - 1)
    low, high = np.clip(low, 0, limit).astype(np.int64), np.clip(high, 0, limit).astype(np.int64)
    start, items = kernels.bucket(low, high, rows, cols)
    return Index(start, items, terrain.west, south, cell, rows, cols)


def index_objects(terrain: Terrain, world: World, lines: Sequence[FlightLine]) -> list[Index]:
    """Indices of the blocks, crowns and rods of a world, by cell.

    A pulse passes an object of height h and reaches the ground up to h tan(angle) aside of it,
    square to the track; 8 m more allow for ground that falls away.
    """
    hx, hy = np.abs([line.heading for line in lines]).max(axis=0)
    steepest = max(line.steepest for line in lines)
    spread = np.array([hy, hx, hy, hx]) * (-1, -1, 1, 1) * 1.3 * steepest
    blocks, crowns, rods = world.blocks, world.crowns, world.rods
    half = np.hypot(blocks["a"], blocks["b"])
    crown_height = crowns["top"] - terrain.at(crowns["x"], crowns["y"])
    x, y = np.stack([rods["x1"], rods["x2"]]), np.stack([rods["y1"], rods["y2"]])
    rod_height = np.maximum(rods["z1"], rods["z2"]) - terrain.at(x.mean(axis=0), y.mean(axis=0))
    boxes = (
        (_square(blocks, half), blocks["top"] - blocks["base"]),
        (_square(crowns, crowns["radius"]), crown_height),
        (np.stack([x.min(axis=0), y.min(axis=0), x.max(axis=0), y.max(axis=0)]), rod_height),
    )
    return [_index(terrain, box.T + np.outer(height + 8.0, spread)) for box, height in boxes]


def _square(objects: Records, half: Floats) -> Floats:
    x, y = objects["x"], objects["y"]
    return np.stack([x - half, y - half, x + half, y + half])


def trace(world: World, blocks: Index, pulses: Pulses) -> Echoes:
    """First solid hit of each pulse: a block, water or the ground."""
    terrain = world.terrain
    z, source, item, facet = kernels.first_hits(
        pulses.x0,
        pulses.y0,
        pulses.sx,
        pulses.sy,
        terrain.values,
        world.level,
        terrain.west,
        terrain.north,
        terrain.cell,
        world.blocks,
        blocks,
    )
    return Echoes(np.arange(len(pulses)), z, source, item, facet)


def crown_echoes(
    world: World, crowns: Index, pulses: Pulses, ground: Floats, rng: np.random.Generator
) -> tuple[Echoes, NDArray[np.int64]]:
    """Returns from inside tree crowns, and the pulses that end there.

    A pulse travels on through leaves for an exponentially distributed length, as light does in
    a turbid medium (Beer-Lambert law); two returns are at least one pulse length apart.
    """
    top, bottom, item = kernels.chords(
        pulses.x0, pulses.y0, pulses.sx, pulses.sy, ground, world.crowns, crowns
    )
    pulse = np.flatnonzero(item >= 0)
    path = rng.exponential((0.7, 1.2, 1.5), (len(pulse), 3)) + np.array([0.0, 1.0, 1.0])
    z = top[pulse, None] - np.cumsum(path, axis=1)
    inside = z > bottom[pulse, None]
    goes_on = rng.random((len(pulse), 3)) > (0.35, 0.5, 0.6)
    alive = np.cumprod(np.column_stack([np.ones(len(pulse), bool), goes_on[:, :2]]), axis=1) > 0
    met = inside & alive
    row, _ = np.nonzero(met)
    ended = pulse[(met & ~goes_on).any(axis=1)]
    which = pulse[row]
    return _echoes(which, z[met], ON_CROWN, item[which]), ended


def rod_echoes(
    world: World, rods: Index, pulses: Pulses, ground: Floats, rng: np.random.Generator
) -> tuple[Echoes, NDArray[np.int64]]:
    """Returns from wires and lattice bars.

    They are thin, so that most of the light goes on.
    """
    pulse, z, item = kernels.strikes(
        pulses.x0, pulses.y0, pulses.sx, pulses.sy, ground, world.rods, rods
    )
    order = np.lexsort((-z, pulse))
    pulse, z, item = pulse[order], z[order], item[order]
    ended = np.unique(pulse[rng.random(len(pulse)) < 0.25])
    return _echoes(pulse, z, ON_ROD, item), ended


def _echoes(pulse: NDArray[np.int64], z: Floats, source: int, item: NDArray[np.int64]) -> Echoes:
    n = len(pulse)
    return Echoes(pulse, z, np.full(n, source, np.uint8), item, np.zeros(n, np.uint8))


def merge(parts: Sequence[Echoes], ended: Sequence[NDArray[np.int64]], solid: Echoes) -> Echoes:
    """Returns of all kinds, sorted by pulse and height, without those behind the end of a pulse.

    `solid` stops every pulse; `ended` are pulses that stop at the lowest of their thin returns.
    """
    stopped = np.zeros(len(solid.pulse), bool)
    above = []
    for part, ends in zip(parts, ended, strict=True):
        seen = part.take(part.z > solid.z[part.pulse] + 0.3)
        above.append(seen)
        stopped[np.intersect1d(ends, seen.pulse)] = True
    both = [*above, solid.take(~stopped)]
    names = Echoes.__dataclass_fields__
    every = Echoes(*(np.concatenate([getattr(part, name) for part in both]) for name in names))
    every = every.take(np.lexsort((-every.z, every.pulse)))
    # A receiver separates two returns only when they lie half a metre apart, and keeps five.
    close = np.zeros(len(every.pulse), bool)
    close[1:] = (every.pulse[1:] == every.pulse[:-1]) & (every.z[:-1] - every.z[1:] < 0.5)
    every = every.take(~close)
    number, _ = _return_numbers(every.pulse)
    return every.take(number <= 5)


def survey(
    world: World,
    lines: Sequence[FlightLine],
    spacing: float,
    rng: np.random.Generator,
    *,
    inside: Any,
    truth: Sequence[str],
    outliers: float,
    sunken: float = 0.0,
    water_noise: float = NOISE,
    first: int = 1,
    ctx: Context = QUIET,
) -> tuple[Floats, dict[str, NDArray[Any]]]:
    """Points and LAS attributes of a survey of a world along flight lines.

    Parameters
    ----------
    spacing : distance between pulses and between scan lines, metres
    inside : function (x, y) -> mask of points that belong to the scene
    truth : names among plane_id, wire_id, span_id, tower_id to hand out beside object_id
    outliers : share of single returns to replace by low noise, and as many by high noise
    sunken : share of water points to replace by low noise below the water
    water_noise : standard deviation of points on water along the beam, with its waves, metres
    first : number of the first flight line, which point_source_id and gps_time tell
    """
    blocks, crowns, rods = index_objects(world.terrain, world, lines)
    parts = []
    for number, line in enumerate(lines, start=first):
        sent = 0.0
        total = line.length / spacing * 2 * line.half / spacing
        for pulses in fire(line, spacing, 3.0e8 + 600.0 * number, rng):
            ctx.progress((number - first + min(sent / total, 1.0)) / len(lines))
            sent += len(pulses)
            solid = trace(world, blocks, pulses)
            thin = [
                crown_echoes(world, crowns, pulses, solid.z, rng),
                rod_echoes(world, rods, pulses, solid.z, rng),
            ]
            lost = _lost_in_water(world, solid, pulses, rng)
            merged = merge([e for e, _ in thin], [stop for _, stop in thin], solid)
            merged = merged.take(~(lost[merged.pulse] & (merged.source == ON_WATER)))
            points = _points(
                world,
                pulses,
                merged,
                rng,
                line=number,
                inside=inside,
                truth=truth,
                outliers=outliers,
                sunken=sunken,
                water_noise=water_noise,
            )
            parts.append(points)
    names = tuple(parts[0][1])
    xyz = np.concatenate([xyz for xyz, _ in parts])
    columns = {}
    for name in names:
        columns[name] = np.concatenate([attributes.pop(name) for _, attributes in parts])
    ctx.progress(1.0)
    return xyz, columns


def _lost_in_water(
    world: World, solid: Echoes, pulses: Pulses, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """True for pulses on water that give no return.

    Water reflects near infrared like a mirror: there are returns below the aircraft, and few to
    its sides.
    """
    near, far = WATER_CHANCE
    chance = far + (near - far) * np.exp(-((pulses.angle / 3.0) ** 2))
    x, y = pulses.x0 + pulses.sx * solid.z, pulses.y0 + pulses.sy * solid.z
    chance[world.cover[world.terrain.index(x, y)] == REED] = 1.0
    return np.asarray((rng.random(len(pulses)) > chance) & (solid.source == ON_WATER))


def _points(
    world: World,
    pulses: Pulses,
    echoes: Echoes,
    rng: np.random.Generator,
    *,
    line: int,
    inside: Any,
    truth: Sequence[str],
    outliers: float,
    sunken: float,
    water_noise: float,
) -> tuple[Floats, dict[str, NDArray[Any]]]:
    """Points of a block of pulses: positions with noise, classes, identifiers, return numbers."""
    x, y = _position(pulses, echoes.pulse, echoes.z)
    # Pulses of which a return falls outside are left out as a whole: no pulse is cut in half.
    whole = np.ones(len(pulses), bool)
    whole[echoes.pulse[~inside(x, y)]] = False
    within = whole[echoes.pulse]
    echoes, x, y = echoes.take(within), x[within], y[within]
    p = echoes.pulse
    number, count = _return_numbers(p)

    cover = world.cover[world.terrain.index(x, y)]
    plants = _plants(world, echoes, cover, rng)
    z = echoes.z + plants
    cls = _classes(world, echoes, z - world.terrain.at(x, y), plants > 0)
    shade = _shades(world, echoes, cover)
    columns = {name: _truth(world, echoes, name) for name in ("object_id", *truth)}

    single, dice = (count == 1) & (echoes.source <= ON_BLOCK), rng.random(len(z))
    low, high = single & (dice < outliers), single & (dice > 1 - outliers)
    sunk = (cls == WATER) & (rng.random(len(z)) < sunken)
    z[low] -= rng.uniform(2, 12, low.sum())
    z[high] += rng.uniform(25, 120, high.sum())
    z[sunk] -= rng.uniform(0.3, 4, sunk.sum())
    cls[low | sunk], cls[high] = LOW_NOISE, HIGH_NOISE
    for values in columns.values():
        values[low | high] = 0
    x, y = _position(pulses, p, z)
    keep = inside(x, y) | ~(low | high | sunk)

    along, aside = rng.normal(0, NOISE, (2, len(z)))
    along[cls == WATER] *= water_noise / NOISE
    turn = rng.uniform(0, 2 * np.pi, len(z))
    x, y, z = EAST + x + aside * np.cos(turn), NORTH + y + aside * np.sin(turn), z + along
    columns = {
        "classification": cls,
        "intensity": (shade / count * rng.lognormal(0, 0.12, len(z))).clip(1, 65535).astype("u2"),
        "return_number": number,
        "number_of_returns": count,
        "gps_time": pulses.time[p],
        "scan_angle": np.round(pulses.angle[p] / 0.006).astype("i2"),
        "edge_of_flight_line": pulses.edge[p].astype("u1"),
        "point_source_id": np.full(len(z), line, "u2"),
        **columns,
    }
    xyz = np.round(np.stack([x, y, z], axis=1), 3)
    return xyz[keep], {name: values[keep] for name, values in columns.items()}


def _position(pulses: Pulses, p: NDArray[np.int64], z: Floats) -> tuple[Floats, Floats]:
    """Horizontal position of pulses p at heights z."""
    return pulses.x0[p] + pulses.sx[p] * z, pulses.y0[p] + pulses.sy[p] * z


def _return_numbers(pulse: NDArray[np.int64]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return number and number of returns, for returns sorted by pulse and from top to bottom."""
    _, first, count = np.unique(pulse, return_index=True, return_counts=True)
    number = np.arange(len(pulse)) - np.repeat(first, count) + 1
    return number.astype("u1"), np.repeat(count, count).astype("u1")


def _plants(
    world: World, echoes: Echoes, cover: NDArray[np.uint8], rng: np.random.Generator
) -> Floats:
    """Height of the grass or reeds that a pulse hit, above the ground or the water."""
    n = len(cover)
    grown = (echoes.source == ON_GROUND) & (rng.random(n) < COVER_PLANTS[cover])
    grown |= (echoes.source == ON_WATER) & (cover == REED) & (rng.random(n) < 0.85)
    height = np.where(grown, rng.uniform(0.15, 1.0, n) * COVER_HEIGHT[cover], 0.0)
    hedge = echoes.source == ON_BLOCK
    hedge[hedge] = world.blocks["cls"][echoes.item[hedge]] == HEDGE
    height[hedge] = rng.normal(-0.12, 0.08, hedge.sum())
    return height


def _classes(
    world: World, echoes: Echoes, height: Floats, grown: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """True ASPRS classes; vegetation by its height above the ground (0.5 m and 2 m)."""
    cls = np.full(len(height), GROUND, np.uint8)
    cls[echoes.source == ON_WATER] = WATER
    for source, table in ((ON_BLOCK, world.blocks), (ON_ROD, world.rods)):
        met = echoes.source == source
        cls[met] = table["cls"][echoes.item[met]]
    plants = grown | (cls == HEDGE) | (echoes.source == ON_CROWN)
    cls[plants] = np.digitize(height[plants], (0.5, 2.0)) + LOW
    return cls


def _truth(world: World, echoes: Echoes, name: str) -> NDArray[Any]:
    """Identifier of the object that each return came from, 0 where there is none."""
    tables = {ON_BLOCK: world.blocks, ON_CROWN: world.crowns, ON_ROD: world.rods}
    dtype = "u2" if name in ("wire_id", "span_id", "tower_id") else "u4"
    values = np.zeros(len(echoes.pulse), dtype)
    for source, table in tables.items():
        if name not in (table.dtype.names or ()):
            continue
        met = echoes.source == source
        values[met] = table[name][echoes.item[met]]
        if name == "plane_id":
            planar = values[met] > 0
            values[met] += np.where(planar, echoes.facet[met], 0).astype(dtype)
    return values


def _shades(world: World, echoes: Echoes, cover: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Mean intensity of the material of each return, as for a pulse with a single return."""
    shade = COVER_SHADE[cover]
    shade[echoes.source == ON_WATER] = 2500
    shade[echoes.source == ON_CROWN] = 21000
    shade[echoes.source == ON_ROD] = 9000
    met = echoes.source == ON_BLOCK
    shade[met] = world.blocks["shade"][echoes.item[met]]
    return shade


# --- shapes --------------------------------------------------------------------------------


def crown_widths(shape: int, t: Floats) -> Floats:
    """Radius of a crown of unit radius at fractions t of its height, shape (k,)."""
    return np.array([kernels.crown_width(shape, share) for share in t])


def rectangle(x: float, y: float, turn: float, a: float, b: float) -> shapely.Polygon:
    """Rectangle with half sides a along `turn` and b across, in projected coordinates."""
    ux, uy = np.cos(turn), np.sin(turn)
    corners = [(x + s * a * ux - t * b * uy, y + s * a * uy + t * b * ux) for s, t in _CORNERS]
    return shapely.Polygon([(EAST + px, NORTH + py) for px, py in corners])


_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def crown_features(terrain: Terrain, crowns: Records) -> Features:
    """Features of crowns: polygons of 24 corners at ground level."""
    x, y = crowns["x"], crowns["y"]
    ground = terrain.at(x, y)
    angle = np.linspace(0, 2 * np.pi, 25)
    ring_x = EAST + x[:, None] + crowns["radius"][:, None] * np.cos(angle)
    ring_y = NORTH + y[:, None] + crowns["radius"][:, None] * np.sin(angle)
    ring_z = np.broadcast_to(ground[:, None], ring_x.shape)
    rings = np.round(np.stack([ring_x, ring_y, ring_z], axis=2), 3)
    shapes = np.asarray(shapely.polygons(rings), object)
    features: Features = []
    for shape, crown, z in zip(shapes, crowns, ground, strict=True):
        properties = {
            "kind": "shrub" if crown["base"] < z else "tree",
            "object_id": int(crown["object_id"]),
            "height": round(float(crown["top"] - z), 3),
            "crown_base": round(float(crown["base"] - z), 3),
            "crown_radius": round(float(crown["radius"]), 3),
            "shape": ("round", "cone", "column")[crown["shape"]],
        }
        features.append((shape, properties))
    return features


def lift(shape: shapely.Geometry, z: float) -> shapely.Geometry:
    """The shape in three dimensions at height z, rounded to millimetres."""
    return shapely.force_3d(shapely.transform(shape, lambda xy: np.round(xy, 3)), round(z, 3))


def below_level(terrain: Terrain, where: NDArray[np.bool_], level: float) -> shapely.MultiPolygon:
    """Area below a level, as polygons with holes, in projected coordinates.

    Parameters
    ----------
    where : cells to look at, shape of the terrain; the rest counts as dry

    Notes
    -----
    Each square of four cell centres is cut into two triangles, so that no case is ambiguous; in
    a triangle with wet and dry corners the shore is one straight segment.
    """
    depth = np.where(where, level - terrain.values.astype(float), -1.0)
    depth = np.where(depth == 0, 1e-9, depth)  # no shore runs through a corner
    depth = np.pad(depth, 1, constant_values=-1.0).ravel()
    rows, cols = (n + 2 for n in terrain.values.shape)
    x = np.tile(EAST + terrain.west + (np.arange(cols) - 0.5) * terrain.cell, rows)
    y = np.repeat(NORTH + terrain.north - (np.arange(rows) - 0.5) * terrain.cell, cols)
    square = np.arange(rows * cols).reshape(rows, cols)[:-1, :-1].ravel()
    halves = np.array([(0, 1, cols + 1), (0, cols + 1, cols)])
    corners = (square[:, None, None] + halves).reshape(-1, 3)
    wet = depth[corners] > 0
    mixed = wet.any(axis=1) & ~wet.all(axis=1)
    # Every side as (lower, higher) node: neighbours then compute the same crossing to the bit.
    sides = np.sort(corners[mixed][:, [(0, 1), (1, 2), (0, 2)]], axis=2)
    crossed = (depth[sides] > 0).sum(axis=2) == 1
    ends = sides[crossed].reshape(-1, 2, 2)
    share = depth[ends[..., 0]] / (depth[ends[..., 0]] - depth[ends[..., 1]])
    px, py = (v[ends[..., 0]] + share * (v[ends[..., 1]] - v[ends[..., 0]]) for v in (x, y))
    shore = np.asarray(shapely.linestrings(np.stack([px, py], axis=2)), object)
    faces = shapely.get_parts(shapely.polygonize(shore))
    spot = shapely.get_coordinates(shapely.point_on_surface(faces))
    inner = terrain.at(spot[:, 0] - EAST, spot[:, 1] - NORTH) < level
    return shapely.MultiPolygon(list(faces[inner]))
