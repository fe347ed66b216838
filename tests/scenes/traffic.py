"""A street with buses, trams, lorries, cars and containers among houses, garages and hedges."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyproj import CRS

from algorithms.samples._objects import SceneBuilder, Wing, barrier, building, tree, turned
from algorithms.samples._survey import (
    ASPHALT,
    GRASS,
    HEDGE,
    UNCLASSIFIED,
    blank_terrain,
    parallel_lines,
    rolling,
    survey,
)
from toolbox.data import PointCloud

SIDE, HALF_STREET = 140.0, 9.0  # metres
VEHICLE = 64  # class of their points in the attribute `truth`: those that a user may define
LARGE = ("bus", "articulated bus", "tram", "double-decker", "lorry", "container")

Box = tuple[float, float, float, float]  # middle along, half length, half width, height; metres


def bodies(kind: str, rng: np.random.Generator) -> list[Box]:
    """The boxes that a vehicle consists of; sizes as roads and rails allow them."""
    width = rng.uniform(2.45, 2.55) / 2
    made: dict[str, list[Box]] = {
        "bus": [(0, 6.0, width, 3.0), (rng.uniform(-3, 3), 1.2, 0.8, 3.3)],
        "articulated bus": [
            (-3.7, 5.2, width, 3.05),
            (1.7, 0.4, 1.1, 2.9),
            (5.5, 3.6, width, 3.05),
        ],
        "tram": [(5.4 * k - 10.8, 2.55, 1.2, 3.4) for k in range(5)]
        + [(5.4 * k - 10.8, 1.5, 0.8, 3.75) for k in (0, 2, 4)],
        "double-decker": [(0, 5.4, width, 4.3)],
        "lorry": [(-6.9, 1.1, 1.2, rng.uniform(2.8, 3.6)), (1.2, 6.6, width, 4.0)],
        "container": [(0, rng.choice([3.03, 6.06]), 1.22, 2.6)],
        "van": [(0.5, 2.2, 0.95, rng.uniform(2.2, 2.7)), (-2.2, 0.6, 0.9, 1.3)],
        "car": [(0, 2.2, 0.9, 0.9), (rng.uniform(-0.3, 0.5), 1.1, 0.75, rng.uniform(1.4, 1.7))],
    }
    return made[kind]


def vehicle(builder: SceneBuilder, kind: str, x: float, y: float, turn: float) -> None:
    """Put a vehicle on the ground."""
    ground, owner = float(builder.terrain.at(x, y)), builder.new_object()
    for along, a, b, height in bodies(kind, builder.rng):
        u, v = turned(x, y, along, 0.0, turn)
        builder.block(
            u,
            v,
            turn,
            a=a,
            b=b,
            top=ground + height,
            base=ground + 0.25,
            cls=UNCLASSIFIED,
            owner=owner,
            shade=float(builder.rng.uniform(4000, 40000)),
        )


def street(seed: int = 0, density: float = 8.0, *, traffic: bool = True) -> PointCloud:
    """A street of 140 m from west to east; attribute `truth` is the class, VEHICLE of vehicles.

    Houses, garages and sheds stand north and south of it. Vehicles drive, stand in rows half a
    metre to a metre apart, and park a good metre from walls.
    """
    rng = np.random.default_rng(seed)
    terrain = blank_terrain(0, 0, SIDE, SIDE)
    x, y = terrain.centres()
    terrain.values[:] = 50 + rolling(rng, x, y, ((1.0, 300), (0.5, 120), (0.05, 20)))
    cover = np.where(np.abs(y - SIDE / 2) + 0 * x < HALF_STREET, ASPHALT, GRASS).astype(np.uint8)
    builder = SceneBuilder(
        terrain,
        cover,
        np.full(terrain.values.shape, -np.inf, np.float32),
        np.zeros((int(SIDE), int(SIDE)), bool),
        SIDE,
        rng,
    )
    houses(builder)
    built = builder.objects
    if traffic:
        drive(builder)
    moved = builder.objects
    for east, north in rng.uniform(0, SIDE, (60, 2)):
        if abs(north - SIDE / 2) > HALF_STREET + 12:
            tree(builder, float(east), float(north))
    xyz, attributes = survey(
        builder.world(),
        parallel_lines(SIDE, 50.0),
        float(np.sqrt(1.15 * 1.06 / density)),
        rng,
        inside=lambda x, y: (x >= 0) & (y >= 0) & (x < SIDE) & (y < SIDE),
        truth=(),
        outliers=0.0,
    )
    owner = attributes["object_id"]
    truth = np.where((owner > built) & (owner <= moved), VEHICLE, attributes["classification"])
    attributes["truth"] = truth.astype(np.uint8)
    return PointCloud(xyz, attributes, crs=CRS(32635))


def houses(builder: SceneBuilder) -> None:
    """Build houses of two to four storeys, garages, sheds and hedges on both sides."""
    rng, middle = builder.rng, SIDE / 2
    for side in (-1, 1):
        for k in range(5):
            x, y = 16 + 27 * k + rng.uniform(-2, 2), middle + side * (HALF_STREET + 9)
            slope = float(rng.choice([0.0, 0.6, 0.9]))
            wing = [Wing(0, 0, rng.uniform(5, 8), rng.uniform(4, 5.5), slope=slope)]
            building(builder, x, y, 0.0, wings=wing, storeys=int(rng.integers(1, 4)))
            back = middle + side * (HALF_STREET + 26)
            rows = int(rng.integers(1, 5))  # garages side by side, each 3 m wide
            shed = [Wing(0, 0, 1.55 * rows, rng.uniform(2.8, 3.2))]
            building(builder, x + 3, back, rng.uniform(-0.2, 0.2), wings=shed, storeys=1)
            barrier(
                builder,
                x,
                middle + side * (HALF_STREET + 40),
                0.1,
                a=8.0,
                b=rng.uniform(0.4, 0.7),
                height=rng.uniform(1.0, 2.2),
                cls=HEDGE,
                shade=20000,
                kind="hedge",
            )


def drive(builder: SceneBuilder) -> None:
    """Put vehicles on the lanes, at the kerbs, and in rows on two yards behind the houses."""
    rng, middle = builder.rng, SIDE / 2
    for lane, kinds in zip((-3.2, 3.2), rng.permutation(LARGE).reshape(2, 3), strict=True):
        for k, kind in enumerate(kinds):
            vehicle(builder, str(kind), 25 + 45 * k + rng.uniform(-4, 4), middle + lane, 0.0)
    for side in (-1, 1):  # parked at the kerb, half a metre to a metre and a half apart
        x = 4.0
        while x < SIDE - 6:
            kind = str(rng.choice(["car", "car", "car", "van"]))
            if rng.random() < 0.7:
                vehicle(builder, kind, x, middle + side * (HALF_STREET - 1.3), 0.0)
            x += 5.0 + rng.uniform(0.3, 1.5)
    for k, kind in enumerate(rng.choice(["bus", "tram", "lorry", "container"], 2)):
        for row in range(4):  # side by side
            place = (35 + 70 * k, middle + 55 + row * rng.uniform(3.2, 3.5))
            vehicle(builder, str(kind), *place, 0.0)
    for k in range(8):  # a car park, one beside the other
        vehicle(builder, "car", 20 + 2.7 * k, middle - 58, np.pi / 2)


def confusion(found: Any, truth: Any) -> dict[str, float]:
    """Shares of the points of vehicles that became what, and IoU of buildings."""
    own = truth == VEHICLE
    one, other = found == 6, truth == 6
    return {
        "building": float((one & own).sum() / max(1, own.sum())),
        "plant": float((np.isin(found, (3, 4, 5)) & own).sum() / max(1, own.sum())),
        "rest": float(((found == 1) & own).sum() / max(1, own.sum())),
        "of buildings": float((one & own).sum() / max(1, one.sum())),
        "iou": float((one & other).sum() / max(1, (one | other).sum())),
    }
