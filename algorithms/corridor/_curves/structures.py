"""Ropes and cables that hang in arcs as wires do, and carry something that no wire carries.

A messenger wire holds a contact wire level, a rope carries chairs or cabins, a cable carries the
deck of a bridge, and wires that are tied where they cross carry plants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._curves.trace import Airborne

CONTACT_DEPTH, CONTACT_ASIDE = 2.2, 0.5  # metres from a messenger wire to the contact wire it holds
CONTACT_STEP, CONTACT_GAP = 3.0, 0.25  # metres along them, and between them at least
CONTACT_SHARE = 0.6  # of the steps along which both are seen
CONTACT_SCATTER = 0.12  # metres of both from parabolas
CONTACT_BEND = 0.35  # of the curvature of the messenger wire: less than this
MESSENGER_C = (300.0, 1500.0)  # metres: tension over weight of a wire that holds another
MESSENGER_HEIGHT = 10.0  # metres above the rails, 6.5 of the contact wire, and what holds it
FEWEST_STEPS = 5
CONTACT_SPAN, CONTACT_PIECE = 70.0, 30.0  # metres: longest span, and piece of a longer curve
LEVEL_SHARE = 0.3  # of these pieces, of which some lie at masts

CARRIER_DEPTH = (0.8, 8.0)  # metres below a rope, of what it carries
CARRIER_HALF, CARRIER_LONG = 1.5, 4.0  # metres to each side of the rope, and along it
CARRIER_SIZE = 0.5  # metres, more than wires are thick
CARRIER_ROOM = 2.0  # metres of empty air around it
CARRIER_POINTS = 5
CARRIER_GAP = 1.0  # metres along the rope between points of one carrier
CARRIER_END = 6.0  # metres from the ends of a rope, where there are insulators and jumpers

BRIDGE_SPAN, BRIDGE_SAG = 50.0, 1 / 15  # metres; of the span: more than wires sag
DECK_BELOW, DECK_ASIDE = 4.0, 4.0  # metres from the lowest point of a cable to the deck
DECK_ALONG = 0.1  # of the span, to both sides of the lowest point
DECK_CELL, DECK_FILLED = 1.0, 0.6  # metres; share of such cells with points

MESH_HEIGHT, MESH_GAP = 0.4, 12.0  # metres between wires that are tied, and between their crossings
MESH_LEAST, MESH_CROSSINGS = 1.0, 5  # metres between two crossings; of a mesh
TIED_CROSSINGS = 2  # of curves that are in a mesh, for which another one is too
MESH_ANGLE = np.sin(np.radians(30.0))

Floats = NDArray[np.float64]


def holds_level(air: Airborne, above: Floats, curve: Catenary) -> bool:
    """Whether a curve is one of two wires in one plane, a level one held by one that sags.

    A wire that hangs by itself below another one sags as that does. So the lower one must be far
    straighter, and the upper one bent as much as a load makes it. A long curve may pass masts, so
    it is looked at piece by piece.

    Parameters
    ----------
    above : height of the points above the ground
    """
    count = max(1, round(curve.length / CONTACT_STEP))
    near, _ = air.around(curve, CONTACT_DEPTH + CONTACT_ASIDE)
    u, v, z = curve.residuals(air.xyz[near])
    plane = (np.abs(v) < CONTACT_ASIDE) & (np.abs(z) < CONTACT_DEPTH)
    if not plane.any() or np.median(above[near][plane]) > MESSENGER_HEIGHT:
        return False
    step = np.clip((u[plane] / curve.length * count).astype(np.int64), 0, count - 1)
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, step, air.xyz[near, 2][plane])
    np.maximum.at(high, step, air.xyz[near, 2][plane])
    width = round(CONTACT_PIECE / CONTACT_STEP)
    pieces = [slice(0, count)]
    if curve.length > CONTACT_SPAN:
        pieces = [slice(k, k + width) for k in range(0, count - width + 1, width // 2)]
    level = [_levelled(low[piece], high[piece]) for piece in pieces]
    return float(np.mean(level)) > LEVEL_SHARE


def _levelled(low: Floats, high: Floats) -> bool:
    """Whether of two wires at equal steps the lower one is straight and the upper one sags."""
    both = (high - low > CONTACT_GAP) & (high - low < CONTACT_DEPTH)
    if np.count_nonzero(both) < max(FEWEST_STEPS, CONTACT_SHARE * len(low)):
        return False
    middle = CONTACT_STEP * np.flatnonzero(both).astype(np.float64)
    lower, rough = _parabola(middle, low[both])
    upper, rougher = _parabola(middle, high[both])
    thin = max(rough, rougher) < CONTACT_SCATTER
    loaded = MESSENGER_C[0] < 1 / max(upper, 1e-9) < MESSENGER_C[1]
    return thin and loaded and abs(lower) < CONTACT_BEND * upper


def _parabola(u: Floats, z: Floats) -> tuple[float, float]:
    """Curvature of a parabola through most of the points, and how far these are from it."""
    keep = np.ones(len(u), bool)
    for _ in range(3):
        shape = np.polyfit(u[keep], z[keep], 2)
        off = np.abs(z - np.polyval(shape, u))
        keep = off <= np.sort(off)[int(0.8 * (len(off) - 1))]
    return 2 * float(shape[0]), float(np.sqrt(np.mean(off[keep] ** 2)))


def carriers(air: Airborne, height: Floats, curve: Catenary) -> int:
    """How many compact bodies hang in the air below a curve, as chairs and cabins do.

    Other wires below it are long, and trees stand on the ground.

    Parameters
    ----------
    height : of the points in the air above the ground
    """
    top, bottom = CARRIER_DEPTH
    near, _ = air.around(curve, bottom + 2 * CARRIER_ROOM)
    u, v, z = curve.residuals(air.xyz[near])
    below = (z < -top) & (np.abs(v) < CARRIER_HALF + CARRIER_ROOM)
    below &= (u > CARRIER_END) & (u < curve.length - CARRIER_END)
    near, u, v, z = near[below], u[below], v[below], z[below]
    own = np.flatnonzero((np.abs(v) < CARRIER_HALF) & (z > -bottom))
    own = own[np.argsort(u[own], kind="stable")]
    found = 0
    for body in np.split(own, np.flatnonzero(np.diff(u[own]) > CARRIER_GAP) + 1):
        if len(body) < CARRIER_POINTS or np.ptp(u[body]) > CARRIER_LONG:
            continue
        room = (u > u[body].min() - CARRIER_ROOM) & (u < u[body].max() + CARRIER_ROOM)
        room &= z > z[body].min() - CARRIER_ROOM
        alone = np.count_nonzero(room) == len(body)
        hangs = height[near[body]].min() > CARRIER_ROOM
        found += bool(alone and hangs and max(np.ptp(v[body]), np.ptp(z[body])) > CARRIER_SIZE)
    return found


def carries_deck(air: Airborne, curve: Catenary) -> bool:
    """Whether a curve sags as the cable of a bridge does, down to a deck in the air."""
    if curve.length < BRIDGE_SPAN or curve.sag < BRIDGE_SAG * curve.length:
        return False
    lowest = min(max(curve.u0, 0.0), curve.length)
    reach = DECK_ALONG * curve.length
    low, high = max(lowest - reach, 0.0), min(lowest + reach, curve.length)
    near, _ = air.around(curve, DECK_BELOW + DECK_ASIDE, low, high)
    u, v, z = curve.residuals(air.xyz[near])
    inside = (z > -DECK_BELOW - curve.sag * 0.1) & (z < -0.5) & (np.abs(v) < DECK_ASIDE)
    cells = np.floor(np.column_stack([u - low, v])[inside] / DECK_CELL).astype(np.int64)
    filled = [len(np.unique(cells[side], axis=0)) for side in (cells[:, 1] < 0, cells[:, 1] >= 0)]
    return max(filled) > DECK_FILLED * (high - low) * DECK_ASIDE / DECK_CELL**2


def in_mesh(curves: Sequence[Catenary], known: Sequence[Catenary]) -> list[bool]:
    """Which curves are tied to others that cross them, as in a trellis.

    Some are crossed at their own height at short distances, and so are those that cross these.
    Power lines that cross keep metres apart, and those that share a pole cross once a block.

    Parameters
    ----------
    known : other curves that are in a mesh
    """
    everything = Crossed.of([*curves, *known])
    tied = [_often(everything.crossings(one)) for one in curves]
    mesh = [one for one, own in zip(curves, tied, strict=True) if own] + list(known)
    fresh = mesh
    while fresh:
        tying = Crossed.of(mesh)
        more = [
            not own and len(tying.crossings(c)) >= TIED_CROSSINGS
            for c, own in zip(curves, tied, strict=True)
        ]
        tied = [own or new for own, new in zip(tied, more, strict=True)]
        fresh = [one for one, new in zip(curves, more, strict=True) if new]
        mesh = mesh + fresh
    return tied


def _often(places: Sequence[float]) -> bool:
    """Whether there are several crossings one after another."""
    steps = np.diff(sorted(places))
    close = np.count_nonzero((steps > MESH_LEAST) & (steps < MESH_GAP))
    return bool(close >= MESH_CROSSINGS - 1)


@dataclass(frozen=True)
class Crossed:
    """Curves that others may cross.

    Attributes
    ----------
    curves : n of them
    lines : array of shape (n, 5), in plan: first end, unit vector and length of each
    """

    curves: Sequence[Catenary]
    lines: Floats

    @classmethod
    def of(cls, curves: Sequence[Catenary]) -> Crossed:
        """The curves, with their lines in plan."""
        lines = [(*one.ends[0, :2], one.ex, one.ey, one.length) for one in curves]
        return cls(curves, np.array(lines).reshape(-1, 5))

    def crossings(self, one: Catenary) -> list[float]:
        """Where along a curve these cross it at its height, metres."""
        x, y, ex, ey, length = self.lines.T
        turn = one.ex * ey - one.ey * ex
        across = np.abs(turn) >= MESH_ANGLE
        turn = np.where(across, turn, 1.0)
        dx, dy = x - one.ends[0, 0], y - one.ends[0, 1]
        u, w = (dx * ey - dy * ex) / turn, (dx * one.ey - dy * one.ex) / turn
        across &= (u > -MESH_LEAST) & (u < one.length + MESH_LEAST)
        across &= (w > -MESH_LEAST) & (w < length + MESH_LEAST)
        return [
            float(u[k])
            for k in np.flatnonzero(across).tolist()
            if abs(one.height(u[k]) - self.curves[k].height(w[k])) < MESH_HEIGHT
        ]
