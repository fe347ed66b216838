"""A reservoir: a valley behind a dam, islands, a peninsula, two ponds, reeds and wet mud."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from algorithms.samples._objects import SceneBuilder, tree
from algorithms.samples._survey import (
    ASPHALT,
    FOREST,
    GRASS,
    MUD,
    NOISE,
    REED,
    Features,
    Floats,
    SceneData,
    Terrain,
    below_level,
    blank_terrain,
    lift,
    parallel_lines,
    rolling,
    survey,
)
from toolbox.context import QUIET, Context

LEVEL = 500.0
POND_LEVELS = (500.12, 499.93)  # nearly that of the reservoir: the pond is still its own
DAM = 0.25  # of the size, from the south
SUNKEN = 0.01  # share of water points that lie below the water
OUTLIERS = 0.0003


def reservoir(
    *, size: float, density: float, seed: int, water_noise: float = NOISE, ctx: Context = QUIET
) -> SceneData:
    """A square of `size` metres; see `scene`."""
    rng = np.random.default_rng(seed)
    terrain, level = _valley(size, rng)
    cover = _cover(terrain, level, size, rng)
    builder = SceneBuilder(terrain, cover, level, _claimed(terrain, level, size), size, rng)
    for number, (x, y) in enumerate(rng.uniform(0, size, (int(size * size / 400), 2))):
        if number % 1000 == 0:
            ctx.progress(0.0)
        tree(builder, x, y)
    features = [
        feature
        for body, height in enumerate((LEVEL, *POND_LEVELS))
        for feature in _water(builder, np.isclose(level, height), height, body)
    ]
    wet = float((terrain.values < level).mean())
    spacing = np.sqrt(1.15 * 1.08 * (1 - 0.87 * wet) / density)
    xyz, attributes = survey(
        builder.world(),
        parallel_lines(size, float(terrain.values.mean())),
        float(spacing),
        rng,
        inside=lambda x, y: (x >= 0) & (y >= 0) & (x < size) & (y < size),
        truth=(),
        outliers=OUTLIERS,
        sunken=SUNKEN,
        water_noise=water_noise,
        ctx=ctx.part(0.1, 1.0),
    )
    return SceneData(xyz, attributes, terrain.placed(), features)


def _valley(size: float, rng: np.random.Generator) -> tuple[Terrain, NDArray[np.float32]]:
    """Terrain including the bed, and the water level of each cell."""
    terrain = blank_terrain(0, 0, size, size)
    x, y = terrain.centres()
    depth, dam = min(14.0, 0.07 * size), DAM * size
    middle = size * (0.47 + 0.05 * np.sin(3.5 * y / size))
    side = np.abs(x - middle) / (0.3 * size)
    z = LEVEL - depth + depth * side**1.6 + depth * (y - dam) / (0.7 * size)
    waves = ((0.05, 0.3 * size), (0.03, 0.12 * size), (0.006, 0.03 * size))
    z = z + depth * rolling(rng, x, y, waves)
    for u, v, radius in ((0.5, 0.42, 0.035), (0.4, 0.6, 0.025)):
        z = np.maximum(z, _hill(np.hypot(x - u * size, y - v * size), radius * size, 2.5))
    along = np.clip(x, 0, 0.36 * size)  # the spine of the peninsula
    z = np.maximum(z, _hill(np.hypot(x - along, y - 0.5 * size), 0.022 * size, 1.8))
    crest, crest_width = LEVEL + min(3.0, 0.25 * depth), min(3.0, 0.02 * size)
    z = np.maximum(z, crest - np.maximum(np.abs(y - dam) - crest_width, 0) / 2)
    level = np.where(y > dam, LEVEL, -np.inf) + np.zeros_like(z)
    for height, v in zip(POND_LEVELS, (0.44, 0.68), strict=True):
        z = _pond(z, level, terrain, y=v * size, radius=0.035 * size, height=height)
    return replace(terrain, values=z.astype(np.float32)), level.astype(np.float32)


def _hill(away: Floats, radius: float, height: float) -> Floats:
    """Height of a hill above the water, whose shore lies at a radius."""
    return LEVEL + min(height, 0.3 * radius) * (1 - (away / radius) ** 2)


def _pond(
    z: Floats, level: Floats, terrain: Terrain, *, y: float, radius: float, height: float
) -> Floats:
    """Terrain with a pond dug into the eastern shore, behind a rim; its level enters `level`."""
    row = z[min(int((terrain.north - y) / terrain.cell), len(z) - 1)]
    wet = np.flatnonzero(row < LEVEL)
    shore = terrain.west + (wet.max() + 1) * terrain.cell if len(wet) else 0.0
    cx, cy = terrain.centres()
    x = min(shore + 1.9 * radius, terrain.west + cx.size * terrain.cell - 1.7 * radius)
    away = np.hypot((cx - x) / 1.2, cy - y) / radius
    out = np.maximum(away - 1, 0) * radius
    bowl = height - min(2.0, 0.3 * radius) * np.maximum(1 - away**2, 0) + out / 1.5
    rim = height + min(1.0, 0.2 * radius) - np.maximum(out - 0.5 * radius, 0) / 2
    z = np.minimum(np.maximum(z, rim), bowl)
    level[away < 1.4] = height
    return z


def _cover(
    terrain: Terrain, level: NDArray[np.float32], size: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Ground cover: woods on the slopes, mud and reeds along the shore, a road on the dam."""
    x, y = terrain.centres()
    above = np.where(np.isfinite(level), terrain.values - level, np.inf)
    cover = np.where(terrain.values > LEVEL + 4, FOREST, GRASS)
    cover[(above > -0.5) & (above < 0.4)] = MUD
    patches = rolling(rng, x, y, ((1, 0.2 * size), (1, 0.13 * size), (1, 0.07 * size))) > 0.5
    cover[(above > -0.5) & (above < 0.3) & patches] = REED
    crest = (np.abs(y - DAM * size) < min(2.0, 0.015 * size)) & (terrain.values > LEVEL)
    cover[crest & (np.abs(x - 0.47 * size) < 0.32 * size)] = ASPHALT
    return cover.astype(np.uint8)


def _claimed(terrain: Terrain, level: NDArray[np.float32], size: float) -> NDArray[np.bool_]:
    """True where no tree grows: on the dam, in the water and on its shore."""
    x = np.arange(int(np.ceil(size))) + 0.5
    index = terrain.index(x[None, :], x[:, None])
    near_dam = np.abs(x[:, None] - DAM * size) < 0.08 * size
    return np.asarray(((terrain.values - level)[index] < 1.0) | near_dam)


def _water(builder: SceneBuilder, zone: NDArray[np.bool_], level: float, body: int) -> Features:
    """Features of one water body: its true outlines, and the storage curve of the reservoir."""
    shapes = sorted(below_level(builder.terrain, zone, level).geoms, key=lambda part: -part.area)
    features: Features = []
    for rank, shape in enumerate(shapes):
        kind = "puddle" if rank else ("reservoir" if body == 0 else "pond")
        properties: dict[str, Any] = {
            "kind": "water",
            "body": kind,
            "object_id": builder.new_object(),
            "level": level,
            "area": round(shape.area, 2),
        }
        if kind == "reservoir":
            # Text, because few vector formats hold lists.
            properties["storage"] = json.dumps(_storage(builder.terrain, zone, level))
        features.append((lift(shape, level), properties))
    return features


def _storage(
    terrain: Terrain, zone: NDArray[np.bool_], level: float
) -> list[tuple[float, float, float]]:
    """Storage curve: level, area and volume in ten steps up to the level, from terrain cells."""
    bodies, _ = ndimage.label(zone & (terrain.values < level))
    largest = bodies == 1 + np.argmax(np.bincount(bodies.ravel())[1:])
    bed = terrain.values[largest].astype(float)
    curve = []
    for height in np.linspace(float(bed.min()), level, 11)[1:]:
        depth = np.maximum(height - bed, 0)
        area, volume = (depth > 0).sum() * terrain.cell**2, depth.sum() * terrain.cell**2
        curve.append((round(float(height), 3), round(float(area), 2), round(float(volume), 2)))
    return curve
