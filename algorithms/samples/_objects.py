"""Houses, walls, cars and trees, and the scene in which they are placed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.samples._survey import (
    BLOCK,
    BUILDING,
    COLUMN,
    CONE,
    CROWN,
    EAST,
    NORTH,
    ROUND,
    UNCLASSIFIED,
    Features,
    Terrain,
    World,
    lift,
    rectangle,
)
from algorithms.shared.kernels.compiling import kernel

ROOF_SHADES = (12000, 16000, 21000, 30000)


@dataclass
class SceneBuilder:
    """A synthetic scene while it is built: its objects, and the cells that are taken."""

    terrain: Terrain
    cover: NDArray[np.uint8]
    level: NDArray[np.float32]
    taken: NDArray[np.bool_]  # 1 m cells from the south-west corner
    size: float
    rng: np.random.Generator
    blocks: list[tuple[Any, ...]] = field(default_factory=list)
    crowns: list[tuple[Any, ...]] = field(default_factory=list)
    features: Features = field(default_factory=list)
    objects: int = 0

    def world(self) -> World:
        """World of all objects built so far, to trace pulses in."""
        blocks, crowns = np.array(self.blocks, BLOCK), np.array(self.crowns, CROWN)
        return World(self.terrain, self.cover, self.level, blocks, crowns)

    planes: int = 0

    def new_object(self) -> int:
        self.objects += 1
        return self.objects

    def claim(
        self, x: float, y: float, turn: float, *, a: float, b: float, gap: float = 0.0
    ) -> bool:
        """Mark a rectangle with a gap around it as taken, if it is free and inside the scene."""
        return bool(_claim(self.taken, x, y, np.cos(turn), np.sin(turn), a + gap, b + gap))

    def block(
        self,
        x: float,
        y: float,
        turn: float,
        *,
        a: float,
        b: float,
        top: float,
        base: float,
        cls: int,
        owner: int,
        shade: float,
        slope: float = 0.0,
        hip: float = 0.0,
        plane: int = 0,
    ) -> None:
        """Add one block; see `_survey.BLOCK`."""
        ux, uy = np.cos(turn), np.sin(turn)
        self.blocks.append((x, y, ux, uy, a, b, top, slope, hip, base, cls, owner, plane, shade))


@dataclass(frozen=True)
class Wing:
    """A rectangular part of a building: centre relative to the building, half sides, roof."""

    x: float
    y: float
    a: float
    b: float
    quarter_turn: bool = False
    slope: float = 0.0
    hip: float = 0.0


def building(
    builder: SceneBuilder, x: float, y: float, turn: float, *, wings: list[Wing], storeys: int
) -> bool:
    """Add a building if there is room for it; True if it was added."""
    shape = shapely.unary_union([_outline(x, y, turn, w) for w in wings])
    reach = [_extent(w) for w in wings]
    a, b = (max(e[k] for e in reach) for k in (0, 1))
    if not builder.claim(x, y, turn, a=a, b=b, gap=1.5):
        return False
    corners = shapely.get_coordinates(shapely.segmentize(shape, 2.0))
    ground = builder.terrain.at(*(corners - (EAST, NORTH)).T)
    base, eave = float(ground.min()) - 0.5, round(float(ground.max()) + 0.4 + 2.8 * storeys, 2)
    owner, shade = builder.new_object(), float(builder.rng.choice(ROOF_SHADES))
    tops = []
    for wing in wings:
        top = eave + wing.slope * wing.b
        cx, cy = turned(x, y, wing.x, wing.y, turn)
        angle = turn + (np.pi / 2 if wing.quarter_turn else 0.0)
        builder.block(
            cx,
            cy,
            angle,
            a=wing.a,
            b=wing.b,
            top=top,
            base=base,
            cls=BUILDING,
            owner=owner,
            shade=shade,
            slope=wing.slope,
            hip=wing.hip,
            plane=builder.planes + 1,
        )
        builder.planes += 8  # two roof sides, two hips, four walls
        tops.append(top)
    low, high = float(ground.min()), round(max(tops), 3)
    properties = {
        "kind": "building",
        "object_id": owner,
        "height": round(high - low, 3),
        "ground_z": round(low, 3),
        "eave_z": eave,
        "ridge_z": high,
        "roof": roof_name(wings),
        "area": round(shape.area, 2),
    }
    builder.features.append((lift(shape, low), properties))
    return True


def roof_name(wings: list[Wing]) -> str:
    """Name of the roof shape: flat, gable or hip."""
    if wings[0].slope == 0:
        return "flat"
    return "hip" if wings[0].hip else "gable"


def _outline(x: float, y: float, turn: float, wing: Wing) -> shapely.Polygon:
    cx, cy = turned(x, y, wing.x, wing.y, turn)
    angle = turn + (np.pi / 2 if wing.quarter_turn else 0.0)
    return rectangle(cx, cy, angle, wing.a, wing.b)


def _extent(wing: Wing) -> tuple[float, float]:
    """Half sides of the bounding box of a wing around the building's centre, along its axes."""
    a, b = (wing.b, wing.a) if wing.quarter_turn else (wing.a, wing.b)
    return abs(wing.x) + a, abs(wing.y) + b


def turned(x: float, y: float, u: float, v: float, turn: float) -> tuple[float, float]:
    c, s = np.cos(turn), np.sin(turn)
    return float(x + u * c - v * s), float(y + u * s + v * c)


def barrier(
    builder: SceneBuilder,
    x: float,
    y: float,
    turn: float,
    *,
    a: float,
    b: float,
    height: float,
    cls: int,
    shade: float,
    kind: str,
) -> None:
    """Add a hedge or wall in pieces of 2 m that follow the ground."""
    if not builder.claim(x, y, turn, a=a, b=b, gap=0.3):
        return
    owner, ux, uy = builder.new_object(), np.cos(turn), np.sin(turn)
    for u in np.arange(-a + 1, a, 2.0):
        px, py = x + u * ux, y + u * uy
        ground = float(builder.terrain.at(px, py))
        builder.block(
            px,
            py,
            turn,
            a=1.0,
            b=b,
            top=ground + height,
            base=ground - 1,
            cls=cls,
            owner=owner,
            shade=shade,
        )
    shape = lift(rectangle(x, y, turn, a, b), float(builder.terrain.at(x, y)))
    builder.features.append((shape, {"kind": kind, "object_id": owner, "height": round(height, 3)}))


def car(builder: SceneBuilder, x: float, y: float, turn: float) -> None:
    """Add a car: a body and a cabin."""
    if not builder.claim(x, y, turn, a=2.2, b=0.9, gap=0.2):
        return
    ground, owner = float(builder.terrain.at(x, y)), builder.new_object()
    shade = float(builder.rng.uniform(4000, 40000))
    for a, b, height in ((2.2, 0.9, 0.9), (1.1, 0.75, 1.45)):
        builder.block(
            x,
            y,
            turn,
            a=a,
            b=b,
            top=ground + height,
            base=ground - 0.3,
            cls=UNCLASSIFIED,
            owner=owner,
            shade=shade,
        )
    shape = lift(rectangle(x, y, turn, 2.2, 0.9), ground)
    builder.features.append((shape, {"kind": "car", "object_id": owner, "height": 1.45}))


def tree(builder: SceneBuilder, x: float, y: float) -> None:
    """Add a tree of random shape, if there is room for its trunk and half of its crown."""
    rng = builder.rng
    shape = int(rng.choice((ROUND, CONE, COLUMN), p=(0.55, 0.25, 0.2)))
    height = float(rng.uniform(5, 20))
    width = {ROUND: (0.22, 0.32), CONE: (0.14, 0.2), COLUMN: (0.12, 0.17)}[shape]
    radius = height * float(rng.uniform(*width))
    if not builder.claim(x, y, 0.0, a=0.6 * radius, b=0.6 * radius, gap=0.2):
        return
    trunk = {ROUND: 0.3, CONE: 0.12, COLUMN: 0.2}[shape] * height
    crown(builder, x, y, trunk=trunk, height=height, radius=radius, shape=shape)


def shrub(builder: SceneBuilder, x: float, y: float) -> None:
    """Add a shrub down to the ground, if there is room for it."""
    height = float(builder.rng.uniform(0.8, 2.4))
    if builder.claim(x, y, 0.0, a=0.6 * height, b=0.6 * height):
        crown(builder, x, y, trunk=-0.1, height=height, radius=0.6 * height, shape=ROUND)


def crown(
    builder: SceneBuilder,
    x: float,
    y: float,
    *,
    trunk: float,
    height: float,
    radius: float,
    shape: int,
) -> None:
    """Add a crown between `trunk` and `height` metres above the ground."""
    ground, owner = float(builder.terrain.at(x, y)), builder.new_object()
    builder.crowns.append((x, y, ground + trunk, ground + height, radius, shape, owner))


@kernel
def _claim(taken, x, y, ux, uy, a, b):
    """Mark the 1 m cells of a rotated rectangle unless one is marked or outside; True if done."""
    rows, cols = taken.shape
    reach = np.hypot(a, b)
    rx, ry = abs(a * ux) + abs(b * uy), abs(a * uy) + abs(b * ux)
    if x - rx < 0 or y - ry < 0 or x + rx > cols or y + ry > rows:
        return False
    for mark in (False, True):
        for row in range(max(0, int(y - reach)), min(rows, int(y + reach) + 1)):
            for col in range(max(0, int(x - reach)), min(cols, int(x + reach) + 1)):
                dx, dy = col + 0.5 - x, row + 0.5 - y
                # Half a cell more, so that the mark covers the rectangle wholly.
                if abs(dx * ux + dy * uy) < a + 0.5 and abs(dy * ux - dx * uy) < b + 0.5:
                    if taken[row, col] and not mark:
                        return False
                    taken[row, col] = True if mark else taken[row, col]
    return True
