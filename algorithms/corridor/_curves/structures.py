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
from algorithms.corridor._settings import SETTINGS

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
    count = max(1, round(curve.length / SETTINGS.structures.contact_step))
    depth, aside = SETTINGS.structures.contact_depth, SETTINGS.network.bundle_width
    near, _ = air.around(curve, depth + aside)
    u, v, z = curve.residuals(air.xyz[near])
    plane = (np.abs(v) < aside) & (np.abs(z) < depth)
    if not plane.any() or np.median(above[near][plane]) > SETTINGS.structures.messenger_height:
        return False
    step = np.clip((u[plane] / curve.length * count).astype(np.int64), 0, count - 1)
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, step, air.xyz[near, 2][plane])
    np.maximum.at(high, step, air.xyz[near, 2][plane])
    width, begins = count, range(1)
    if curve.length > SETTINGS.structures.contact_span:
        width = round(SETTINGS.curves.sure_length / SETTINGS.structures.contact_step)
        begins = range(0, count - width + 1, width // 2)
    along, points = u[plane] / curve.length * count, air.xyz[near, 2][plane]
    level = [_levelled(low[k : k + width], high[k : k + width], along - k, points) for k in begins]
    return float(np.mean(level)) > SETTINGS.structures.level_share


def _levelled(low: Floats, high: Floats, along: Floats, points: Floats) -> bool:
    """Whether of two wires at equal steps the lower one is straight and the upper one sags.

    Parameters
    ----------
    low, high : height of the lowest and of the highest point in each step, metres
    along, points : place from the first step on, in steps, and height of points in their plane
    """
    width = SETTINGS.lines.tolerances[0]
    both = (high - low > width) & (high - low < SETTINGS.structures.contact_depth)
    if np.count_nonzero(both) < max(
        SETTINGS.structures.fewest, SETTINGS.structures.filled * len(low)
    ):
        return False
    middle = np.flatnonzero(both).astype(np.float64) + 0.5
    lower, rough = _parabola(middle, low[both])
    upper, rougher = _parabola(middle, high[both])
    bends = [2 * float(shape[0]) / SETTINGS.structures.contact_step**2 for shape in (lower, upper)]
    thin = max(rough, rougher) < SETTINGS.arcs.smooth * width
    loaded = (
        SETTINGS.structures.messenger_least_c < 1 / max(bends[1], 1e-9) < SETTINGS.curves.largest_c
    )
    held = thin and loaded and abs(bends[0]) < SETTINGS.structures.contact_bend * bends[1]
    here = (along >= 0) & (along < len(low))
    return held and _empty_between(lower, upper, along[here], points[here])


def _empty_between(lower: Floats, upper: Floats, u: Floats, z: Floats) -> bool:
    """Whether points are on two parabolas, not as well between them as those of more wires.

    Between a contact wire and what it hangs from are droppers alone. Of three wires or more, at
    least a third of the points is in the middle half.
    """
    share = (z - np.polyval(lower, u)) / (np.polyval(upper, u) - np.polyval(lower, u))
    return float(np.mean(np.abs(share - 0.5) < 1 / 4)) < 1 / 6


def _parabola(u: Floats, z: Floats) -> tuple[Floats, float]:
    """A parabola through most of the points, and how far these are from it."""
    keep = np.ones(len(u), bool)
    for _ in range(3):
        shape = np.polyfit(u[keep], z[keep], 2)
        off = np.abs(z - np.polyval(shape, u))
        keep = off <= np.sort(off)[int(0.8 * (len(off) - 1))]
    return shape, float(np.sqrt(np.mean(off[keep] ** 2)))


def carriers(air: Airborne, height: Floats, curve: Catenary) -> int:
    """How many compact bodies hang in the air below a curve, as chairs and cabins do.

    Other wires below it are long, and trees stand on the ground.

    Parameters
    ----------
    height : of the points in the air above the ground
    """
    top, bottom = SETTINGS.structures.body_gap, SETTINGS.structures.carrier_bottom
    near, _ = air.around(curve, bottom + 2 * SETTINGS.structures.carrier_room)
    u, v, z = curve.residuals(air.xyz[near])
    below = (z < -top) & (
        np.abs(v) < SETTINGS.curves.clutter_radius + SETTINGS.structures.carrier_room
    )
    below &= (u > SETTINGS.arcs.most_shift) & (u < curve.length - SETTINGS.arcs.most_shift)
    near, u, v, z = near[below], u[below], v[below], z[below]
    own = np.flatnonzero((np.abs(v) < SETTINGS.curves.clutter_radius) & (z > -bottom))
    own = own[np.argsort(u[own], kind="stable")]
    found = 0
    for body in np.split(own, np.flatnonzero(np.diff(u[own]) > SETTINGS.structures.body_gap) + 1):
        if (
            len(body) < SETTINGS.structures.fewest
            or np.ptp(u[body]) > 2 * SETTINGS.structures.carrier_room
        ):
            continue
        room = (u > u[body].min() - SETTINGS.structures.carrier_room) & (
            u < u[body].max() + SETTINGS.structures.carrier_room
        )
        room &= z > z[body].min() - SETTINGS.structures.carrier_room
        alone = np.count_nonzero(room) == len(body)
        hangs = height[near[body]].min() > SETTINGS.structures.carrier_room
        found += bool(
            alone
            and hangs
            and max(np.ptp(v[body]), np.ptp(z[body])) > SETTINGS.network.bundle_width
        )
    return found


def carries_deck(air: Airborne, curve: Catenary) -> bool:
    """Whether a curve sags as the cable of a bridge does, down to a deck in the air."""
    if curve.sag < SETTINGS.structures.bridge_sag * curve.length:
        return False
    room, gap = 2 * SETTINGS.structures.carrier_room, SETTINGS.structures.body_gap
    low, high = max(curve.u0 - room, 0.0), min(curve.u0 + room, curve.length)
    near, _ = air.around(curve, 2 * room, low, high)
    u, v, z = curve.residuals(air.xyz[near])
    inside = (z > -room) & (z < -gap / 2) & (np.abs(v) < room)
    cells = np.floor(np.column_stack([u - low, v])[inside] / gap).astype(np.int64)
    filled = [len(np.unique(cells[side], axis=0)) for side in (cells[:, 1] < 0, cells[:, 1] >= 0)]
    return high > low and 2 * max(filled) * gap**2 > (high - low) * room


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
            not own and len(tying.crossings(c)) > 1 for c, own in zip(curves, tied, strict=True)
        ]
        tied = [own or new for own, new in zip(tied, more, strict=True)]
        fresh = [one for one, new in zip(curves, more, strict=True) if new]
        mesh = mesh + fresh
    return tied


def is_row_of_mesh(curve: Catenary, mesh: Sequence[Catenary]) -> bool:
    """Whether a curve runs on one of a mesh, or beside it and level with it, as rows of it do.

    Few of the wires that cross it may have been followed, and it may have been parted where they
    cross.
    """
    middle = curve.points(np.array([curve.length / 2]))
    for one in mesh:
        if abs(one.ex * curve.ex + one.ey * curve.ey) > SETTINGS.network.cos_parallel:
            u, v, z = (float(values[0]) for values in one.residuals(middle))
            beside = 0 <= u <= one.length and abs(v) < SETTINGS.structures.mesh_gap
            if beside and abs(z) < SETTINGS.structures.body_gap:
                return True
    return False


def _often(places: Sequence[float]) -> bool:
    """Whether there are several crossings one after another."""
    steps = np.diff(sorted(places))
    close = (steps > SETTINGS.structures.body_gap) & (steps < SETTINGS.structures.mesh_gap)
    return bool(np.count_nonzero(close) >= SETTINGS.structures.fewest - 1)


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
        """Where along a curve these cross it at its height and go on, metres.

        Wires that end at an arm cross it, and are not tied to it.
        """
        x, y, ex, ey, length = self.lines.T
        turn = one.ex * ey - one.ey * ex
        across = np.abs(turn) >= SETTINGS.structures.sin_mesh
        turn = np.where(across, turn, 1.0)
        dx, dy = x - one.ends[0, 0], y - one.ends[0, 1]
        u, w = (dx * ey - dy * ex) / turn, (dx * one.ey - dy * one.ex) / turn
        near, clear = SETTINGS.structures.body_gap, SETTINGS.curves.clutter_radius
        across &= (u > -near) & (u < one.length + near) & (w > clear) & (w < length - clear)
        return [
            float(u[k])
            for k in np.flatnonzero(across).tolist()
            if abs(one.height(u[k]) - self.curves[k].height(w[k])) < SETTINGS.structures.mesh_height
        ]
