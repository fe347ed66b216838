"""Points of towers and poles: what stands below, between and above the ends of the wires.

A body narrows from its foot to its lowest arm; around the arms there is nothing else in the air.
The ground and what lies on it, such as the blocks of the foundation, is not tower.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._network import Scene
from algorithms.corridor._spans import Wire
from algorithms.corridor._supports import Support

BASE_LATTICE, BASE_POLE = 1.0, 0.8  # metres above the ground that are left to it
SLIM = 0.7  # metres: half width from which a body is a lattice
SPLAY, SLACK = (0.12, 0.02), (0.4, 0.15)  # of lattice and pole: per metre downwards; metres
THIN = 0.2  # metres: half width of a pole of which little is seen
FOOT, LEG = 3.0, 1.0  # metres: height below which shrubs may grow inside, and width of a face
BOX = (0.12, 1.2, 5.0)  # half depth of the space of the arms: per metre of height, least, most
DROP = (0.08, 0.8, 4.0)  # how far below the lowest wire it begins
OUT = (0.1, 0.5, 4.0)  # how far it goes beyond the outermost wires
PEAK = (0.08, 1.0, 6.0)  # how far it goes above the highest wire
LOOP = (0.4, 4.0, 1.2)  # metres: a jumper hangs this far below and aside of its wire
STRING = (0.15, 0.0, 9.0)  # how far from the tower: per metre of height, least, most
LOOP_POINTS = 5
LOOP_WIDTH = 1.3  # of the part of a jumper that is clear of its wire, by its parabola

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Tower:
    """A support with its points.

    Attributes
    ----------
    points : indices among the points in the air
    top : height of its highest point
    width : half width of the body below its arms
    """

    support: Support
    points: Ints
    top: float
    width: float

    @property
    def lattice(self) -> bool:
        """Whether it is a lattice tower, not a pole."""
        return self.width > SLIM


def scaled(rule: tuple[float, float, float], height: float) -> float:
    """A length that grows with the height of a tower, between limits."""
    share, least, most = rule
    return min(max(share * height, least), most)


def insulators(scene: Scene, wires: Sequence[Wire], number: int, support: Support) -> float:
    """Length of the strings by which wires pull at a support, metres; 0 where they hang from it.

    Where wires end at both sides of a tower, a jumper leads the current around it, from the end of
    one string to the end of the other.
    """
    found = []
    reach = scaled(STRING, support.high - support.ground)
    for wire in wires:
        for end in (0, 1):
            if wire.supports[end] != number:
                continue
            near = scene.air.within(np.array([support.x, support.y]), 30.0)
            near = near[scene.free[near]]
            u, v, z = wire.curve.residuals(scene.air.xyz[near])
            along = wire.curve.length - u if end else u
            below, deepest, aside = LOOP
            loop = (z < -below) & (z > -deepest) & (np.abs(v) < aside)
            loop &= (along > 0.8) & (along < reach)
            if np.count_nonzero(loop) >= LOOP_POINTS:
                found.append(LOOP_WIDTH * float(np.quantile(along[loop], 0.9)))
    return float(np.median(found)) if len(found) >= 2 else 0.0


def tower_of(scene: Scene, support: Support) -> Tower:
    """The points of the body and the arms of a support, without those around wires."""
    air, x, y = scene.air, support.x, support.y
    across = np.array(support.across)
    along = np.array([across[1], -across[0]])
    height = support.high - support.ground
    depth, drop = scaled(BOX, height), scaled(DROP, height)
    out, peak = scaled(OUT, height), scaled(PEAK, height)
    reach = max(-support.reach[0], support.reach[1]) + out + depth
    near = air.within(np.array([x, y]), reach)
    near = near[scene.free[near]]
    step = air.xyz[near, :2] - (x, y)
    a, s, z = step @ along, step @ across, air.xyz[near, 2]
    above = scene.height[near]
    waist = support.low - drop
    middle = centre_of(a, s, z, waist, height)
    a, s = a - middle[0], s - middle[1]
    x, y = np.array([x, y]) + middle[0] * along + middle[1] * across
    left, right = (side - middle[1] for side in support.reach)
    support = replace(support, x=float(x), y=float(y), reach=(left, right))
    arms = (z > waist) & (z < support.high + peak) & (np.abs(a) < depth)
    arms &= (s > support.reach[0] - out) & (s < support.reach[1] + out)
    away = np.maximum(np.abs(a), np.abs(s))
    width = waist_of(away, z, waist, height)
    pole = int(width <= SLIM)
    body = (away < width + SLACK[pole] + SPLAY[pole] * np.maximum(waist - z, 0)) & (z <= waist)
    if width > SLIM:  # down there it is hollow
        shin = away[body & (above > FOOT) & (above < 2 * FOOT)]
        foot = float(np.quantile(shin, 0.9)) if len(shin) else width
        body &= (above > FOOT) | ((np.abs(away - foot) < LEG) & (above > BASE_LATTICE))
    body &= above > BASE_POLE
    mine = near[arms | body]
    top = float(np.quantile(air.xyz[mine, 2], 0.995)) if len(mine) else support.high
    return Tower(support, mine, top, width)


def centre_of(a: Floats, s: Floats, z: Floats, waist: float, height: float) -> tuple[float, float]:
    """Where the arms are along the line, and the body below them across it."""
    near = 0.1 * height
    arms = (z > waist) & (np.abs(a) < near)
    neck = (z > waist - 0.15 * height) & (z < waist) & (np.hypot(a, s) < near)
    along = float(np.median(a[arms])) if np.count_nonzero(arms) >= LOOP_POINTS else 0.0
    across = float(np.median(s[neck])) if np.count_nonzero(neck) >= LOOP_POINTS else 0.0
    return along, across


def waist_of(away: Floats, z: Floats, waist: float, height: float) -> float:
    """Half width of a body just below its arms."""
    near = (z < waist) & (z > waist - 0.25 * height) & (away < 0.1 * height)
    return float(np.quantile(away[near], 0.85)) if near.sum() >= LOOP_POINTS else THIN
