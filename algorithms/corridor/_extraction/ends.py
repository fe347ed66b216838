"""Wires behind the last support of a line, where the data end before the next one.

There a wire is too short to be followed. But it goes on from where it hangs, as do all that this
support holds, side by side and bent as before. So only one direction and one slope are not known,
and the points of all wires tell them. They are taken if by chance a hundredth of one as unlikely is
expected among all that were tried at the support.

References
----------
Desolneux, A., Moisan, L. and Morel, J.-M. (2000). Meaningful alignments. International Journal of
Computer Vision 40(1), 7-23: the number of false alarms.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtr

from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._curves.chance import chance
from algorithms.corridor._curves.network import Corridor, is_on_roof
from algorithms.corridor._extraction.continued import data_end, leads
from algorithms.corridor._extraction.drops import stand_alone, turned
from algorithms.corridor._extraction.spans import Wire, end_at, is_ahead, on_any, usual_curvature
from algorithms.corridor._extraction.supports import Support, axis_of
from algorithms.corridor._settings import SETTINGS

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


def with_ends(corridor: Corridor, wires: Sequence[Wire], supports: Sequence[Support]) -> list[Wire]:
    """The wires, and those that go on behind the last supports to where the data end."""
    if not wires:
        return []
    found = list(wires)
    taken = np.zeros(len(corridor.air.xyz), bool)
    taken[on_any(corridor, wires)] = True
    for number, support in enumerate(supports):
        own = [wire for wire in wires if number in wire.supports]
        if len({is_ahead(wire.curve, support) for wire in own}) != 1:
            continue
        held = list({wire.wire: wire for wire in own}.values())  # of two positions one
        span = 1 + max(wire.span for wire in found)
        more = [replace(one, span=span) for one in behind(corridor, number, support, held, taken)]
        if more:
            taken[on_any(corridor, more)] = True
            found += more
    return found


def behind(
    corridor: Corridor, number: int, support: Support, held: Sequence[Wire], taken: Mask
) -> list[Wire]:
    """The wires behind a support, of those that it holds at one side; none unless points tell."""
    begin = np.array([end_at(wire, number) for wire in held])
    mean = axis_of(np.array([outwards(wire, number) for wire in held]))
    longest = max(wire.curve.length for wire in held)
    bend, _ = usual_curvature(held)
    ahead = Shape(float(mean[0]), float(mean[1]), 0.0, bend)
    xyz = alone_ahead(corridor, begin, mean, longest, taken)
    clear = SETTINGS.towers.string_reach * (support.high - support.ground)
    radius = radius_of(begin, corridor.tolerance)
    tried = list(shapes_to(begin, xyz, ahead, clear))
    on_each = [one.on_wires(begin, xyz, clear, radius) for one in tried]
    best = max(on_each, key=len, default=np.zeros((0, 3)))
    shape = fit(np.vstack([best, np.zeros((1, 3))]), sways=False, curvature=bend)
    if shape is None:
        return []
    if shape.ex * mean[0] + shape.ey * mean[1] < 0:
        shape = turned(shape)
    made = going_on(
        list(along(corridor, number, held, begin, shape, longest, (clear, radius))), held
    )
    chances = [
        chance(corridor, wire.curve.between(clear, wire.curve.length), radius, taken)
        for wire in made
        if wire.curve.length > clear
    ]
    if (
        not made
        or not are_seen_on(made)
        or sum(chances) + math.log(len(tried)) >= math.log(SETTINGS.sparse.false_alarms)
    ):
        return []
    return [wire for wire in made if leads(wire) and not is_on_roof(corridor, wire.curve)]


@dataclass(frozen=True)
class Shape:
    """The one shape of all wires behind a support, from where they hang.

    Attributes
    ----------
    ex, ey : unit vector in plan
    slope : at the support, upwards
    bend : curvature, 1 / metre
    """

    ex: float
    ey: float
    slope: float
    bend: float

    def on_wires(self, begin: Floats, xyz: Floats, clear: float, radius: float) -> Floats:
        """The points on wires that begin at some places, each seen from the place of its wire."""
        step = xyz[:, None] - begin
        u = step[..., 0] * self.ex + step[..., 1] * self.ey
        v = step[..., 1] * self.ex - step[..., 0] * self.ey
        z = step[..., 2] - self.slope * u - self.bend * u * u / 2
        away = np.where(u > clear, np.hypot(v, z), math.inf)
        wire = away.argmin(axis=1)
        return np.asarray(step[np.arange(len(xyz)), wire][away.min(axis=1) < radius])


def shapes_to(begin: Floats, xyz: Floats, ahead: Shape, clear: float) -> Iterator[Shape]:
    """The shapes of wires that lead from each of some places to each of some points."""
    for start in begin:
        for dx, dy, dz in xyz - start:
            u = math.hypot(dx, dy)
            if u > clear and (dx * ahead.ex + dy * ahead.ey) > SETTINGS.spans.square * u:
                slope = dz / u - ahead.bend * u / 2
                if abs(slope) < SETTINGS.trace.steepest:
                    yield Shape(dx / u, dy / u, slope, ahead.bend)


def alone_ahead(
    corridor: Corridor, begin: Floats, mean: Floats, longest: float, taken: Mask
) -> Floats:
    """Points that stand alone, on no wire, ahead of a support: the nearest, shape (n, 3)."""
    middle = begin[:, :2].mean(axis=0)
    near = corridor.air.within(middle, longest)
    near = near[corridor.may[near] & ~taken[near]]
    step = corridor.air.xyz[near, :2] - middle
    near = near[(step @ mean > 0)]
    near = near[stand_alone(corridor, near, taken)]
    away = np.hypot(*(corridor.air.xyz[near, :2] - middle).T)
    order = np.argsort(away, kind="stable")[: SETTINGS.sparse.neighbours]
    return np.asarray(corridor.air.xyz[near[order]])


def radius_of(begin: Floats, tolerance: float) -> float:
    """Metres from a wire within which points are on it: nearer to it than to the next one."""
    away = np.linalg.norm(begin[:, None] - begin, axis=2) + np.diag(np.full(len(begin), math.inf))
    return min(tolerance, float(away.min()) / 2)


def along(
    corridor: Corridor,
    number: int,
    held: Sequence[Wire],
    begin: Floats,
    shape: Catenary,
    longest: float,
    reach: tuple[float, float],
) -> Iterator[Wire]:
    """The wires of one shape, from where they hang to where the data end.

    Parameters
    ----------
    reach : from where on along a wire, and how near to it, points are its own, metres
    """
    clear, radius = reach
    first = float(shape.along(np.zeros((1, 3)))[0][0])
    for wire, (x, y, z) in zip(held, begin.tolist(), strict=True):
        moved = replace(
            shape,
            x=shape.x + x,
            y=shape.y + y,
            z_start=shape.z_start + z,
            z_end=shape.z_end + z,
        )
        more = data_end(corridor, moved.between(first, first + 1.0), 1, longest)
        if more is None:
            continue
        curve = moved.between(first, first + 1.0 + more)
        own, _ = corridor.wires.around(curve, radius, clear, curve.length)
        u, _ = curve.along(corridor.wires.xyz[own])
        known = (float(u.min()), float(u.max())) if len(own) else (0.0, 0.0)
        yield replace(
            wire, curve=replace(curve, count=len(own)), supports=(number, -1), known=known
        )


def going_on(wires: Sequence[Wire], held: Sequence[Wire]) -> list[Wire]:
    """The wires of which not surely more points would be seen if they went on.

    The points are parted among them as they are among those on the other side of the support.
    """
    before = {wire.wire: wire.curve.count for wire in held}
    share = np.array([before[wire.wire] for wire in wires], float)
    seen = np.array([wire.curve.count for wire in wires])
    usual = seen.sum() * share / max(share.sum(), 1.0)
    surely_not = pdtr(seen, usual) < SETTINGS.sparse.false_alarms
    return [wire for wire, ends in zip(wires, surely_not.tolist(), strict=True) if not ends]


def are_seen_on(wires: Sequence[Wire]) -> bool:
    """Whether the points of no wire surely end before it does.

    Wires that are tauter than the others leave the common shape; then it is that of none. Of n
    points anywhere along a wire all are within a share of it with the n-th power of that.
    """
    unsure = 2 * SETTINGS.points.company_side  # the cell where the data end and the one before it
    lengths = [max(wire.known[1], wire.curve.length - unsure) for wire in wires]
    ends = [
        wire.curve.count * math.log(wire.known[1] / length)
        for wire, length in zip(wires, lengths, strict=True)
        if wire.known[1] > 0
    ]
    return min(ends, default=0.0) > math.log(SETTINGS.sparse.false_alarms / max(1, len(ends)))


def outwards(wire: Wire, number: int) -> Floats:
    """Unit vector in plan along a wire, out of it at a support."""
    way = np.array([wire.curve.ex, wire.curve.ey])
    return way if wire.supports[1] == number else -way
