"""Wires from traced curves: which curves are wires, and which are continuations of each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves import trace_kernels as kernels
from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._curves.chance import by_step
from algorithms.corridor._curves.structures import carries_deck, holds_level, in_mesh
from algorithms.corridor._curves.trace import PLAN_CELL, Airborne
from algorithms.corridor._settings import SETTINGS
from algorithms.shared.kernels.sorting import distinct

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Piece:
    """A traced piece of a wire: its points, and the catenary through them.

    Attributes
    ----------
    sure : whether it is a wire by itself, not only beside another one
    arc : of which alignment it is, and which arc of that
    """

    points: Ints
    curve: Catenary
    sure: bool = True
    arc: tuple[int, int] = (0, 0)

    @property
    def ends(self) -> Floats:
        """First and last position, array of shape (2, 3)."""
        return self.curve.ends


def own_radius(tolerance: float) -> float:
    """Metres around a wire, followed at a tolerance in metres, that are its own."""
    return SETTINGS.lines.own_radius * tolerance


@dataclass
class Corridor:
    """The points above the ground of a corridor, the terrain, and which points are still free.

    Attributes
    ----------
    air : points above the ground
    height : of each of them above the terrain
    may : which of them may be wire
    tolerance : farthest that a point may lie from the wire that is followed, metres
    ground : elevation of the terrain at a position in plan
    seen : whether there are points around a position in plan
    floor : points of the ground, None if it is not known
    density : points per square metre of the survey
    tied : curves that are no wires of a line, but of a mesh
    left_out : curves that hang as wires do, and are none since something is tied to them
    wires : the points that may be wire
    free : which points above the ground lie on no wire that was found
    refused : which of the points that may be wire lie on or at what surely is none
    proven : which points above the ground are of arcs that are no accident, few as they may be
    strip : of each point above the ground, by point_source_id; all 0 where it is not known
    arms : array of shape (k, 2, 2), both ends in plan of the arms of supports that are known
    """

    air: Airborne
    height: Floats
    may: NDArray[np.bool_]
    tolerance: float
    ground: Callable[[float, float], float]
    seen: Callable[[float, float], bool]
    floor: Airborne | None = None
    density: float = math.inf
    tied: list[Catenary] = field(default_factory=list)
    left_out: list[Catenary] = field(default_factory=list)
    strip: NDArray[np.uint16] = field(default_factory=lambda: np.zeros(0, np.uint16))
    arms: Floats = field(default_factory=lambda: np.zeros((0, 2, 2)))
    wires: Airborne = field(init=False)
    free: NDArray[np.bool_] = field(init=False)
    refused: NDArray[np.bool_] = field(init=False)
    proven: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.wires = self.air.select(self.may)
        if not len(self.strip):
            self.strip = np.zeros(len(self.air.xyz), np.uint16)
        self.free = np.ones(len(self.air.xyz), bool)
        self.refused = np.zeros(len(self.wires.xyz), bool)
        self.proven = np.zeros(len(self.air.xyz), bool)

    @property
    def own_radius(self) -> float:
        """Metres around a wire that are its own."""
        return own_radius(self.tolerance)

    def refuse(self, pieces: Iterable[Piece]) -> None:
        """Mark the points on and around pieces that are certain, but no wires."""
        for piece in pieces:
            if piece.sure:
                self.refused[self.wires.around(piece.curve, SETTINGS.curves.clutter_radius)[0]] = (
                    True
                )

    def without_refused(self, tolerance: float) -> Corridor:
        """The same at another tolerance, without points of what surely is no wire.

        Parameters
        ----------
        tolerance : farthest that a point may lie from the wire that is followed, metres
        """
        may = self.may.copy()
        may[may] = ~self.refused
        return replace(self, may=may, tolerance=tolerance)

    def of_strip(self, number: int) -> Corridor:
        """The same as one strip shows it: without the points of others that may be wire."""
        own = ~self.may | (self.strip == number)
        return replace(
            self,
            air=self.air.select(own),
            height=self.height[own],
            may=self.may[own],
            strip=self.strip[own],
            tied=[],
            left_out=[],
        )

    def on(self, curves: Iterable[Catenary]) -> NDArray[np.bool_]:
        """Which points above the ground are within the tolerance of one of some wires."""
        found = np.zeros(len(self.air.xyz), bool)
        radius = max(self.tolerance, SETTINGS.lines.tolerances[0])
        for curve in curves:
            found[self.air.around(curve, radius)[0]] = True
        return found

    def take(self, curves: Iterable[Catenary]) -> None:
        """Mark the points of wires as used."""
        self.free &= ~self.on(curves)


def curves_of(corridor: Corridor, curves: Sequence[tuple[Floats, Ints]]) -> list[Piece]:
    """Pieces with catenaries, from the traced curves that stand out from their surroundings."""
    found: list[Piece] = []
    for curve, points in curves:
        length = curve[kernels.CURVE_HIGH] - curve[kernels.CURVE_LOW]
        clear = clearness(corridor, curve, len(points))
        slope = abs(curve[kernels.CURVE_Z + 1]) / curve[kernels.CURVE_HALF]
        if (
            clear < SETTINGS.curves.clear_share
            or slope > SETTINGS.trace.steepest
            or len(points) < SETTINGS.curves.fewest_points
        ):
            continue
        catenary = fit(corridor.wires.xyz[points], spread=corridor.own_radius)
        if catenary is not None and not is_on_roof(corridor, catenary):
            fine = (
                curve[kernels.CURVE_RMS] < SETTINGS.curves.fine_rms * corridor.tolerance
                and len(points) >= SETTINGS.curves.isolated_points
                and clear >= 0.9
            )
            enough = SETTINGS.curves.fine_length if fine else SETTINGS.curves.sure_length
            found.append(Piece(points, catenary, bool(length >= enough)))
    return isolated(corridor, untied(corridor, found))


def untied(corridor: Corridor, pieces: Sequence[Piece]) -> list[Piece]:
    """The pieces that are in no mesh of wires; the points of those that are may be no wire."""
    tied = in_mesh([piece.curve for piece in pieces], corridor.tied)
    for piece, in_it in zip(pieces, tied, strict=True):
        if in_it:
            corridor.refused[piece.points] = True
            corridor.tied.append(piece.curve)
    return [piece for piece, in_it in zip(pieces, tied, strict=True) if not in_it]


def is_on_roof(corridor: Corridor, curve: Catenary) -> bool:
    """Whether at one side of a curve little of what is seen is below it, as beside an edge.

    Below a wire the beam goes on, and so it does at both sides of it. It does not at a row of
    points on a roof, nor at the inner side of the ridge, the edge of a roof or a balcony. One looks
    so far aside that squares as wide hardly ever lack points. What lies beside the curve
    on a roof of any slope is not below, the ground is. Where nothing is seen beside the line, there
    is water.
    """
    if corridor.floor is None:
        return False
    wide = math.sqrt(-math.log(SETTINGS.sparse.false_alarms) / corridor.density)
    reach = max(SETTINGS.points.company_side, wide)
    parts = [
        points.xyz[beside_of(points, curve, reach)] for points in (corridor.air, corridor.floor)
    ]
    ground = np.repeat([False, True], [len(part) for part in parts])
    u, v, z = curve.residuals(np.concatenate(parts))
    inside = (u >= 0) & (u < curve.length) & (np.abs(v) < reach)
    u, v, z, ground = u[inside], v[inside], z[inside], ground[inside]
    steps = max(1, round(curve.length / SETTINGS.points.company_side))
    at = (u / curve.length * steps).astype(np.int64)
    on_it = np.hypot(v, z) <= corridor.tolerance
    own = np.bincount(at[on_it], minlength=steps) > 0
    water = np.zeros(steps, bool)
    water[own] = on_water(corridor, curve, (np.flatnonzero(own) + 0.5) * curve.length / steps)
    slack = SETTINGS.roofs.slope * np.abs(v) + corridor.own_radius
    beside = own[at] & ~on_it & (z <= slack)
    under = beside & (ground | (z < -slack) | water[at])
    seen, below = (cells_by_side(u[those], v[those]) for those in (beside, under))
    return bool((below < SETTINGS.structures.filled * seen).any())


def cells_by_side(u: Floats, v: Floats) -> Ints:
    """Number of square metres with points at each side of a curve, along and aside of it."""
    along, aside = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    least = aside.min(initial=0)
    wide = aside.max(initial=0) - least + 1
    right = distinct(along * wide + aside - least) % wide < -least
    return np.bincount(right.astype(np.int64), minlength=2)


def on_water(corridor: Corridor, curve: Catenary, at: Floats) -> list[bool]:
    """Whether nothing is seen beside the line at distances along a curve."""
    aside = SETTINGS.network.line_width * np.array([-curve.ey, curve.ex])
    spots = curve.points(at)[:, :2]
    return [not any(corridor.seen(*(spot + side)) for side in (aside, -aside)) for spot in spots]


def beside_of(points: Airborne, curve: Catenary, reach: float) -> Ints:
    """Indices of the points in the cells around a curve in plan."""
    spots = curve.points(np.arange(0.0, curve.length + PLAN_CELL, PLAN_CELL))[:, :2]
    return points.within(spots, reach + PLAN_CELL / 2)


def isolated(corridor: Corridor, pieces: Sequence[Piece]) -> list[Piece]:
    """The pieces, of which those are sure too that have nothing but each other around them."""
    taken = np.zeros(len(corridor.air.xyz), bool)
    for piece in pieces:
        taken[corridor.wires.order[piece.points]] = True
    found = []
    for piece in pieces:
        on_it, beside = by_step(
            corridor, piece.curve, taken, SETTINGS.points.company_side, corridor.tolerance
        )
        clear = np.mean((on_it > 0) & (beside == 0)) > SETTINGS.structures.filled
        sure = piece.sure or (bool(clear) and len(piece.points) >= SETTINGS.curves.isolated_points)
        found.append(replace(piece, sure=sure))
    return found


def wires_among(corridor: Corridor, arcs: Sequence[Piece]) -> list[Piece]:
    """Wires from the arcs that look like wires, with the pieces of one wire joined."""
    straight = [arc for arc in arcs if is_straight(arc.curve)]
    bent = [arc for arc in arcs if not is_straight(arc.curve)]
    bent = [
        arc
        for arc in bent
        if arc.curve.c > SETTINGS.curves.smallest_c
        and arc.curve.rms < SETTINGS.curves.roughest * corridor.tolerance
    ]
    bent = [arc for arc in bent if abs(arc.curve.swing) < SETTINGS.curves.largest_swing]
    found = connected([a for a in bent if a.sure], [a for a in bent if not a.sure])
    found = joined(corridor, found)
    found = [one for one in found if not any(lies_on(corridor, one, other) for other in found)]
    corridor.take(arc.curve for arc in found)
    found = [
        arc
        for arc in found
        if arc.curve.rms < SETTINGS.curves.fine_rms * corridor.tolerance
        or alone(corridor, arc.curve, ~corridor.free) >= SETTINGS.curves.alone_share
        or 2 * np.count_nonzero(corridor.proven[corridor.wires.order[arc.points]]) > len(arc.points)
    ]
    below = [other.curve for other in straight]
    carriers = [
        arc
        for arc in found
        if carries(corridor, arc.curve, below)
        or holds_level(corridor.air, corridor.height, arc.curve)
        or carries_deck(corridor.air, arc.curve)
    ]
    clean = [
        arc for arc in straight if arc.curve.rms < SETTINGS.curves.roughest * corridor.tolerance
    ]
    corridor.refuse([*clean, *carriers])
    corridor.left_out += [arc.curve for arc in carriers if arc.sure]
    return [arc for arc in found if all(arc is not other for other in carriers)]


def lies_on(corridor: Corridor, one: Piece, other: Piece) -> bool:
    """Whether a piece lies on a longer one: the same wire, traced twice."""
    length = other.curve.length
    if one.curve.length >= length:
        return False
    u, _ = other.curve.along(one.ends)
    if u.min() < -corridor.tolerance or u.max() > length + corridor.tolerance:
        return False
    return bool(
        np.median(other.curve.away(corridor.wires.xyz[one.points])) < corridor.tolerance / 2
    )


def clearness(corridor: Corridor, curve: Floats, count: int) -> float:
    """Share of the length of a curve with points on it and few points just around it."""
    length = curve[kernels.CURVE_HIGH] - curve[kernels.CURVE_LOW]
    bins = max(1, int(length / max(2.0, 3 * length / count)))
    tubed, shelled = np.zeros(bins, np.int64), np.zeros(bins, np.int64)
    air = corridor.air
    kernels.profile(curve, length / bins, corridor.tolerance, air.cells, tubed, shelled)
    return float(np.mean((tubed > 0) & (2 * tubed >= shelled)))


def is_straight(curve: Catenary) -> bool:
    """Whether a curve surely sags less than any wire, as rails, bars and ties do."""
    return curve.sag + SETTINGS.curves.certain_sigmas * curve.sigma("sag") < curve.length**2 / (
        8 * SETTINGS.curves.largest_c
    )


def alone(corridor: Corridor, curve: Catenary, taken: NDArray[np.bool_]) -> float:
    """Share of a curve with more points on it than around it, those that are taken not counted.

    Twigs that happen to lie along an arc have others around them everywhere.
    """
    on_it, beside = by_step(
        corridor, curve, taken, 2 * SETTINGS.points.company_side, corridor.tolerance
    )
    return float(np.mean((on_it > beside)[on_it + beside > 0] if on_it.any() else 0.0))


def carries(corridor: Corridor, curve: Catenary, straight: Sequence[Catenary]) -> bool:
    """Whether something hangs from a curve all along, as from a cable of a bridge or railway.

    It is a straight wire below it in its plane, or hangers: points at all depths in its plane and
    not beside that. Another wire below is at one depth.
    """
    width, depth, step = (
        SETTINGS.arcs.arm_half_width,
        SETTINGS.curves.hanger_depth,
        SETTINGS.curves.hanger_depth,
    )
    for other in straight:
        u, _ = curve.along(other.points(np.array([0.0, other.length])))
        shared = min(u.max(), curve.length) - max(u.min(), 0.0)
        if shared > 0.5 * curve.length:
            at = curve.points(np.linspace(max(u.min(), 0.0), min(u.max(), curve.length), 9))
            _, v, z = other.residuals(at)
            if np.abs(v).max() < width and 0.2 < np.median(z) < depth:
                return True
    near, _ = corridor.air.around(curve, depth + width)
    near = near[corridor.free[near]]
    u, v, z = curve.residuals(corridor.air.xyz[near])
    below = (z < -corridor.own_radius) & (z > -depth)
    bins = max(1, round(curve.length / step))
    step_of = np.clip((u / curve.length * bins).astype(np.int64), 0, bins - 1)
    blade = below & (np.abs(v) < width)
    for k in range(bins):  # what is at one depth is another wire
        here = np.flatnonzero(blade & (step_of == k))
        if len(here):
            blade[here[np.abs(z[here] - np.median(z[here])) < width]] = False
    hung = np.bincount(step_of[blade], minlength=bins)
    beside = below & (np.abs(v) > 2 * width) & (np.abs(v) < 4 * width)
    around = np.bincount(step_of[beside], minlength=bins)
    return bool(np.mean((hung >= 2) & (hung > around)) > SETTINGS.curves.hanger_share)


def connected(strong: list[Piece], weak: list[Piece]) -> list[Piece]:
    """The strong pieces, and the weak ones that meet one at a support or continue one."""
    found = list(strong)
    queue = list(strong)
    while queue and weak:
        one = queue.pop()
        near = [
            piece
            for piece in weak
            if goes_on(one, piece) or continues(one, piece, SETTINGS.network.bundle_width)
        ]
        weak = [piece for piece in weak if not any(piece is other for other in near)]
        found += near
        queue += near
    return found


def goes_on(one: Piece, other: Piece) -> bool:
    """Whether two curves come from opposite sides and meet, as wires do at a support."""
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        a, b = heading(one, i), heading(other, j)
        step = other.ends[j] - one.ends[i]
        if a @ b > -0.5 or np.hypot(*step[:2]) > SETTINGS.network.join_gap:
            continue
        axis = (a - b) / np.hypot(*(a - b))
        aside = abs(axis[0] * step[1] - axis[1] * step[0])
        halfway = one.ends[i] + 0.5 * step
        meet = [p.curve.height(p.curve.along(halfway[None])[0])[0] for p in (one, other)]
        if (
            aside < SETTINGS.network.join_aside
            and abs(meet[1] - meet[0]) < SETTINGS.network.join_aside / 2
        ):
            return True
    return False


def runs_beside(one: Piece, other: Piece) -> bool:
    """Whether the middle of one curve lies beside another of the same heading."""
    a, b = heading(one, 1), heading(other, 1)
    if abs(a @ b) < SETTINGS.network.cos_parallel:
        return False
    middle = other.curve.points(np.array([0.5 * other.curve.length]))
    u, v, z = (float(values[0]) for values in one.curve.residuals(middle))
    length = one.curve.length
    return (
        0 <= u <= length
        and abs(v) < SETTINGS.network.line_width
        and abs(z) < SETTINGS.network.line_width
        and (math.hypot(v, z) > SETTINGS.lines.tolerances[0])
    )


def heading(piece: Piece, end: int) -> Floats:
    """Unit vector in plan that points outwards at the first (0) or last (1) end of a curve."""
    way = 1.0 if end else -1.0
    return way * np.array([piece.curve.ex, piece.curve.ey])


def continues(one: Piece, other: Piece, near: float) -> bool:
    """Whether two curves are of one wire or bundle: side by side, or one after the other."""
    if abs(heading(one, 1) @ heading(other, 1)) < SETTINGS.network.cos_parallel:
        return False
    u, _ = one.curve.along(other.ends)
    gap = max(u.min() - one.curve.length, -u.max())
    if gap > 0:
        reach = min(SETTINGS.network.longest_missing, one.curve.length + other.curve.length)
        return gap < reach and apart(one, other) < near and apart(other, one) < near
    return apart(one, other) < near


def apart(one: Piece, other: Piece) -> float:
    """Median distance of two curves where they overlap, or in the middle of the gap."""
    a = one.curve
    u, _ = a.along(other.ends)
    low, high = max(0.0, u.min()), min(a.length, u.max())
    if low > high:  # one goes on where the other ends
        low = high = 0.5 * (low + high)
    at = a.points(np.linspace(low, high, 5))
    return float(np.median(other.curve.away(at)))


def joined(corridor: Corridor, pieces: Sequence[Piece]) -> list[Piece]:
    """Pieces in which those of one wire are joined, where a single arc fits them all."""
    order = sorted(pieces, key=lambda p: (-p.curve.length, p.curve.x, p.curve.y))
    found: list[Piece] = []
    for piece in order:
        for k, one in enumerate(found):
            if one.arc != piece.arc or not continues(one, piece, SETTINGS.network.bundle_width / 2):
                continue
            both = np.union1d(one.points, piece.points)
            curve = fit(corridor.wires.xyz[both], spread=2.0)
            if curve is None or not agrees(corridor, curve, (one, piece)):
                continue
            found[k] = replace(one, points=both, curve=curve)
            break
        else:
            found.append(piece)
    return found if len(found) == len(pieces) else joined(corridor, found)


def agrees(corridor: Corridor, curve: Catenary, pieces: Sequence[Piece]) -> bool:
    """Whether a common curve fits all pieces as well as their own curves do."""
    for piece in pieces:
        xyz = corridor.wires.xyz[piece.points]
        own, common = (c.away(xyz) for c in (piece.curve, curve))
        if np.median(common) > 2 * np.median(own) + 0.05:
            return False
    return True
