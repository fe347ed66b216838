"""A town: rolling ground with a terrace, an embanked road, a cut with a bridge, houses, trees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from algorithms.samples._objects import (
    SceneBuilder,
    Wing,
    barrier,
    building,
    car,
    shrub,
    tree,
    turned,
)
from algorithms.samples._survey import (
    ASPHALT,
    BRIDGE,
    GRASS,
    HEDGE,
    MEADOW,
    UNCLASSIFIED,
    Floats,
    SceneData,
    Terrain,
    below_level,
    blank_terrain,
    crown_features,
    graded,
    lift,
    parallel_lines,
    rectangle,
    rolling,
    smoothstep,
    survey,
)
from toolbox.context import QUIET, Context

QUARTER = 90.0  # smallest side of a quarter between two streets, m
FIRST_QUARTERS = ("hall", "court", "park", "houses")  # in every town that has room for four
OTHER_QUARTERS = ("houses", "slabs", "court", "park", "hall")
OTHER_SHARES = (0.62, 0.14, 0.1, 0.1, 0.04)
OUTLIERS = 0.0005


def town(*, size: float, density: float, seed: int, ctx: Context = QUIET) -> SceneData:
    """A square of `size` metres with about `density` points per square metre; see `scene`."""
    rng = np.random.default_rng(seed)
    builder = landscape(size, rng)
    build(builder, ctx)
    plant(builder, ctx)
    world = builder.world()
    lines = parallel_lines(size, float(builder.terrain.values.mean()))
    overlap = 1.3 - 0.3 / len(lines)
    spacing = float(np.sqrt(overlap * 1.06 / density))
    xyz, attributes = survey(
        world,
        lines,
        spacing,
        rng,
        inside=lambda x, y: (x >= 0) & (y >= 0) & (x < size) & (y < size),
        truth=("plane_id",),
        outliers=OUTLIERS,
        ctx=ctx.part(0.4, 1.0),
    )
    features = [*builder.features, *crown_features(builder.terrain, world.crowns)]
    return SceneData(xyz, attributes, builder.terrain.placed(), features)


# --- ground --------------------------------------------------------------------------------


def landscape(size: float, rng: np.random.Generator) -> SceneBuilder:
    """Scene with the ground, earthworks, streets, and the bridge where road and cut cross."""
    terrain = blank_terrain(0, 0, size, size)
    x, y = terrain.centres()
    count = max(1, int(size // QUARTER))
    pitch = size / count
    z = 120 + rolling(rng, x, y, ((2.5, 420), (2.0, 290), (1.0, 170), (0.15, 31), (0.08, 17)))
    bank = {1: 2 * size, 2: 0.9 * size}.get(count, size - pitch + 6.0)
    edge = bank + rolling(rng, x, 0 * x, ((2.0, 150),))
    z += 5.0 * smoothstep((y - edge) / 8.0)  # the terrace: a bank of up to 43 degrees

    road_y = pitch if count > 1 else 0.12 * size
    road = float(np.median(terrain_row(z, terrain, road_y))) + 1.8
    worked = graded(z, road, np.abs(y - road_y) - 4.0, 1 / 1.5)
    cut_x = (count - 1) * pitch if count > 1 else np.inf
    worked = graded(worked, road - 6.5, np.abs(x - cut_x) - 3.0, 1.0)
    cover = np.where(_street(x, y, pitch, count), ASPHALT, GRASS)
    cover[np.abs(worked - z) > 0.05] = GRASS
    cover[(np.abs(y - road_y) < 3.5) & (np.abs(x - cut_x) > 3.0)] = ASPHALT
    meadow = rolling(rng, x, y, ((1, 60), (1, 45), (1, 28))) > 1.3
    cover[(cover == GRASS) & meadow] = MEADOW

    terrain = replace(terrain, values=worked.astype(np.float32))
    level = np.full(z.shape, -np.inf, np.float32)
    builder = SceneBuilder(
        terrain, cover.astype(np.uint8), level, np.zeros((1, 1), bool), size, rng
    )
    built = (np.abs(worked - z) > 0.05) | (cover == ASPHALT) | (np.abs(y - edge - 4) < 6)
    side = int(np.ceil(size))
    south_west = np.arange(side) + 0.5
    builder.taken = built[terrain.index(south_west[None, :], south_west[:, None])]
    if count > 1:
        _bridge(builder, cut_x, road_y, road)
    return builder


def terrain_row(z: Floats, terrain: Terrain, y: float) -> Floats:
    """Elevations along the line of constant y."""
    return np.asarray(z[min(int((terrain.north - y) / terrain.cell), len(z) - 1)])


def _street(x: Floats, y: Floats, pitch: float, count: int) -> NDArray[np.bool_]:
    """True for cells of streets between the quarters."""
    lines = np.arange(1, count) * pitch
    near_x, near_y = ((np.abs(v[..., None] - lines) < 2.75).any(axis=-1) for v in (x, y))
    return np.asarray(near_x | near_y)


def _bridge(builder: SceneBuilder, x: float, y: float, road: float) -> None:
    """Build a bridge deck over the cut, with a parapet on both sides."""
    owner, half, width = builder.new_object(), 11.5, 4.5
    builder.block(
        x, y, 0, a=half, b=width, top=road, base=road - 0.9, cls=BRIDGE, owner=owner, shade=11000
    )
    for side in (-1, 1):
        edge = y + side * (width - 0.15)
        builder.block(
            x,
            edge,
            0,
            a=half,
            b=0.15,
            top=road + 1.0,
            base=road,
            cls=BRIDGE,
            owner=owner,
            shade=15000,
        )
    deck = lift(rectangle(x, y, 0, half, width), road)
    builder.features.append(
        (deck, {"kind": "bridge", "object_id": owner, "height": 6.5, "z": road})
    )


def pond(builder: SceneBuilder, x: float, y: float, radius: float) -> None:
    """Dig a pond whose level lies just below the lowest part of its rim."""
    part, near = builder.terrain.window(x, y, 1.5 * radius)
    cx, cy = near.centres()
    angle, away = np.arctan2(cy - y, cx - x), np.hypot(cx - x, cy - y)
    shore = radius * (1 + 0.15 * np.sin(2 * angle + 1) + 0.08 * np.sin(3 * angle))
    level = round(float(near.values[away < 1.4 * radius].min()) - 0.2, 2)
    bed = level - 1.8 * (1 - np.clip(away / shore, 0, 1) ** 2)
    bowl = np.where(away < shore, bed, level + (away - shore) / 1.5)
    near.values[:] = np.minimum(near.values, bowl)
    builder.level[part][away < 1.4 * radius] = level
    water = below_level(near, away < 1.4 * radius, level)
    owner = builder.new_object()
    for shape in water.geoms:
        properties = {"kind": "water", "object_id": owner, "level": level}
        properties |= {"area": round(shape.area, 2)}
        builder.features.append((lift(shape, level), properties))


# --- buildings -----------------------------------------------------------------------------


def build(builder: SceneBuilder, ctx: Context) -> None:
    """Build the quarters between the streets."""
    rng = builder.rng
    count = max(1, int(builder.size // QUARTER))
    pitch = builder.size / count
    kinds = list(rng.choice(OTHER_QUARTERS, count * count, p=OTHER_SHARES))
    if count == 1:
        kinds = ["hamlet"]
    else:
        kinds[:4] = FIRST_QUARTERS
        rng.shuffle(kinds)
    for number, kind in enumerate(kinds):
        ctx.progress(0.2 * number / len(kinds))
        x, y = (number % count + 0.5) * pitch, (number // count + 0.5) * pitch
        QUARTERS[kind](builder, x, y, pitch, float(rng.uniform(-0.15, 0.15)))


def _houses(builder: SceneBuilder, x: float, y: float, pitch: float, turn: float) -> None:
    """Build detached houses of all roof shapes, with hedges, walls and cars."""
    rng = builder.rng
    side = max(2, int((pitch - 12) // 25))
    step = (pitch - 12) / side
    for i in range(side * side):
        u = (i % side - (side - 1) / 2) * step + rng.uniform(-2, 2)
        v = (i // side - (side - 1) / 2) * step + rng.uniform(-2, 2)
        hx, hy = turned(x, y, u, v, turn)
        house = [_flat, _gabled, _gabled, _hipped, _l_shaped][rng.integers(5)](rng)
        angle = turn + rng.integers(2) * np.pi / 2
        if building(builder, hx, hy, angle, wings=house, storeys=int(rng.integers(1, 3))):
            _garden(builder, hx, hy, angle)


def _hamlet(builder: SceneBuilder, x: float, y: float, pitch: float, turn: float) -> None:
    """Build the houses of a town of a single quarter, north of its road."""
    _houses(builder, x, y + 0.08 * pitch, 0.9 * pitch, 0.3 * turn)


def _hall(builder: SceneBuilder, x: float, y: float, pitch: float, turn: float) -> None:
    """Build a hall of more than 60 m with a roof of 5 degrees, and its car park."""
    wings = [Wing(0, 0, 32.0, 13.5, slope=float(np.tan(np.radians(5))))]
    if not building(builder, x, y + 4, 0.4 * turn, wings=wings, storeys=3):
        building(builder, x, y, 0.0, wings=wings, storeys=3)
    for i in range(12):
        car(builder, x - 27 + 5 * i, y - 0.5 * pitch + 14, np.pi / 2)


def _court(builder: SceneBuilder, x: float, y: float, pitch: float, turn: float) -> None:
    """Build four wings around a courtyard."""
    half, width = 20.0, 5.0
    slope = 0.7
    long = [Wing(0, s * (half - width), half, width, slope=slope, hip=slope) for s in (-1, 1)]
    short = [Wing(s * (half - width), 0, half, width, True, slope, slope) for s in (-1, 1)]
    building(builder, x, y, 0.6 * turn, wings=[*long, *short], storeys=4)
    _trees(builder, x, y, 8.0, 3)


def _slabs(builder: SceneBuilder, x: float, y: float, pitch: float, turn: float) -> None:
    """Build tall flat-roofed blocks, whose far sides the laser does not reach."""
    for v in (-22.0, 22.0):
        slab = [Wing(0, 0, 24.0, 6.0)]
        storeys = int(builder.rng.integers(6, 11))
        building(builder, *turned(x, y, 0.0, v, turn), turn, wings=slab, storeys=storeys)
    for i in range(6):
        car(builder, *turned(x, y, -15 + 6 * i, 0.0, turn), turn)


def _park(builder: SceneBuilder, x: float, y: float, pitch: float, turn: float) -> None:
    """Plant trees around a pond."""
    if builder.claim(x, y, 0.0, a=17, b=17):
        pond(builder, x, y, 12.0)
    _trees(builder, x, y, 0.42 * pitch, int(pitch * pitch / 130))


QUARTERS = {
    "houses": _houses,
    "hamlet": _hamlet,
    "hall": _hall,
    "court": _court,
    "slabs": _slabs,
    "park": _park,
}


def _flat(rng: np.random.Generator) -> list[Wing]:
    return [Wing(0, 0, rng.uniform(5, 8), rng.uniform(4, 6))]


def _gabled(rng: np.random.Generator) -> list[Wing]:
    a = rng.uniform(5, 8)
    return [Wing(0, 0, a, rng.uniform(3.5, min(a, 6)), slope=rng.uniform(0.5, 1.0))]


def _hipped(rng: np.random.Generator) -> list[Wing]:
    a, slope = rng.uniform(6, 8), rng.uniform(0.4, 0.8)
    return [Wing(0, 0, a, rng.uniform(4, 5.5), slope=slope, hip=slope)]


def _l_shaped(rng: np.random.Generator) -> list[Wing]:
    a, b, slope = rng.uniform(6.5, 8), rng.uniform(3, 3.8), rng.uniform(0.6, 0.9)
    short = rng.uniform(4.5, 6)
    side = Wing(a - b * 0.9, short * 0.75, short, b * 0.9, quarter_turn=True, slope=slope)
    return [Wing(0, -b, a, b, slope=slope), replace(side, y=side.y - b)]


# --- gardens, streets, trees ---------------------------------------------------------------


def _garden(builder: SceneBuilder, x: float, y: float, turn: float) -> None:
    """Build a hedge or a wall along one side of the lot, and perhaps a car beside it."""
    rng = builder.rng
    u, v = turned(x, y, 0.0, 11.2, turn)
    if rng.random() < 0.5:
        height = rng.uniform(1.3, 2.4)
        barrier(
            builder, u, v, turn, a=6.0, b=0.5, height=height, cls=HEDGE, shade=20000, kind="hedge"
        )
    elif rng.random() < 0.6:
        height = rng.uniform(1.0, 2.0)
        barrier(
            builder,
            u,
            v,
            turn,
            a=7.0,
            b=0.15,
            height=height,
            cls=UNCLASSIFIED,
            shade=16000,
            kind="wall",
        )
    if rng.random() < 0.5:
        car(builder, *turned(x, y, 11.0, -4.0, turn), turn + np.pi / 2)


def plant(builder: SceneBuilder, ctx: Context) -> None:
    """Plant trees and shrubs where there is room left."""
    spots = builder.rng.uniform(0, builder.size, (int(builder.size**2 / 220), 4))
    for number, (x1, y1, x2, y2) in enumerate(spots):
        if number % 1000 == 0:
            ctx.progress(0.2 + 0.2 * number / len(spots))
        tree(builder, x1, y1)
        shrub(builder, x2, y2)


def _trees(builder: SceneBuilder, x: float, y: float, radius: float, count: int) -> None:
    for u, v in builder.rng.uniform(-radius, radius, (count, 2)):
        tree(builder, x + u, y + v)
