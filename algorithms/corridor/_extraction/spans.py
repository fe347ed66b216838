"""Spans from pieces of wires: the wires between two supports as catenaries, subconductors apart.

All wires of a span have nearly the same shape. So once one of them is known, others that were too
sparse to follow show as groups of points at one offset and height along it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, maximum_filter
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._curves.chance import chance, is_no_accident
from algorithms.corridor._curves.network import (
    Corridor,
    Piece,
    alone,
    apart,
    goes_on,
    heading,
    is_on_roof,
    own_radius,
    runs_beside,
)
from algorithms.corridor._extraction.sheets import levels_of
from algorithms.corridor._extraction.supports import Support
from algorithms.corridor._settings import SETTINGS
from algorithms.shared.kernels.sorting import distinct

SECTION_BIN = 0.05  # metres, of the cross-section of a bundle

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Wire:
    """A conductor between two supports.

    Attributes
    ----------
    curve : from one end to the other, at the support where there is one
    supports : indices of those at u = 0 and at the end, -1 where there is none in the data
    known : from where to where along it there are points
    tolerance : how far points may lie from it, as it was followed, metres
    span, bundle, wire : numbers
    seen_share, longest_gap : share of its length with points, and metres without; NaN if not known
    sure : whether it is known by itself, not only beside or behind another one
    drop : whether it leads from a pole to a house
    """

    curve: Catenary
    supports: tuple[int, int]
    known: tuple[float, float]
    tolerance: float
    span: int = -1
    bundle: int = -1
    wire: int = -1
    seen_share: float = math.nan
    longest_gap: float = math.nan
    sure: bool = True
    drop: bool = False

    @property
    def seen_length(self) -> float:
        """Metres along it from its first to its last point."""
        return self.known[1] - self.known[0]


def on_wire(corridor: Corridor, wire: Wire) -> tuple[Ints, Floats, float]:
    """Indices of the points on a wire, their distances, and the largest distance allowed."""
    least, most = (
        SETTINGS.arcs.smooth * min(wire.tolerance, SETTINGS.lines.tolerances[0]),
        SETTINGS.spans.on_wire_most * wire.tolerance,
    )
    radius = min(max(SETTINGS.spans.on_wire * wire.curve.rms, least), most)
    return *corridor.air.around(wire.curve, radius), radius


def nearest_wires(corridor: Corridor, wires: Sequence[Wire]) -> tuple[Ints, Floats]:
    """The wire of each of the n points in the air: the nearest of those that it is on.

    Subconductors are nearer to each other than points scatter, so many are on two.

    Returns
    -------
    array of shape (n,), indices of wires, -1 for none
    array of shape (n,), distance from it as a share of the largest allowed, 0 for none
    """
    which = np.full(len(corridor.air.xyz), -1)
    least, share = np.full(len(which), np.inf), np.zeros(len(which))
    for number, wire in enumerate(wires):
        near, away, radius = on_wire(corridor, wire)
        nearer = away < least[near]
        near, away = near[nearer], away[nearer]
        which[near], least[near], share[near] = number, away, away / radius
    return which, share


# --- spans ---------------------------------------------------------------------------------


def spans_of(
    corridor: Corridor, pieces: Sequence[Piece], supports: Sequence[Support]
) -> list[Wire]:
    """Wires of each span: pieces cut at the supports, joined, fitted again, bundles split."""
    spans = list(bundles_of(corridor, pieces, supports))
    parted = [conductors_of(corridor, wires) for wires in without_doubles(corridor, spans)]
    found: list[Wire] = []
    bundle = 0
    for span, conductors in enumerate(upheld(corridor, parted), start=1):
        found += [
            replace(to_supports(wire, supports), span=span, bundle=bundle + k)
            for wire, k in conductors
        ]
        bundle += 1 + max(k for _, k in conductors)
    return found


def conductors_of(corridor: Corridor, wires: Sequence[Wire]) -> list[tuple[Wire, int]]:
    """The conductors of a span, and numbers that are the same for those of one bundle.

    Where two wires were followed as one, they are parted as subconductors are, and may be too far
    from each other to be some.
    """
    parted = [(one, k) for k, wire in enumerate(wires) for one in subconductors(corridor, wire)]
    found = once(parted)
    if not found:
        return []
    link = [
        [k == n and apart_wires(a.curve, b.curve) < SETTINGS.network.bundle_width for b, n in found]
        for a, k in found
    ]
    _, bundle = connected_components(coo_array(np.array(link)), directed=False)
    return [(wire, int(k)) for (wire, _), k in zip(found, bundle, strict=True)]


def upheld(
    corridor: Corridor, spans: Sequence[list[tuple[Wire, int]]]
) -> list[list[tuple[Wire, int]]]:
    """The spans that surely are of wires, and those that go on behind a support of one of these.

    A short span may have too few points to tell that its wires sag; between others it is known.
    """
    wires = [[wire for wire, _ in conductors] for conductors in spans]
    taken = corridor.on(wire.curve for own in wires for wire in own)
    kept = {k for k, own in enumerate(wires) if are_wires(corridor, own, taken)}
    may = {k for k, own in enumerate(wires) if may_be_wires(own, corridor.tolerance)} - kept
    certain = {k for k in may if are_no_accident(corridor, wires[k], taken)}
    while fresh := {k for k in may if any(meet(wires[k], wires[j], k in certain) for j in kept)}:
        kept |= fresh
        may -= fresh
    return [spans[k] for k in sorted(kept)]


def meet(one: Sequence[Wire], other: Sequence[Wire], certain: bool) -> bool:
    """Whether two spans have a support in common, or meet where one is, if the first is certain."""
    held = {number for wire in one for number in wire.supports if number >= 0}
    if any(number in held for wire in other for number in wire.supports):
        return True
    return certain and any(
        goes_on(*(Piece(np.zeros(0, np.int64), wire.curve) for wire in pair))
        for pair in itertools.product(one, other)
    )


def without_doubles(corridor: Corridor, spans: Sequence[Sequence[Wire]]) -> list[list[Wire]]:
    """Spans without the wires that repeat those of another span with more points."""
    taken = np.zeros(len(corridor.wires.xyz), bool)
    kept: dict[int, list[Wire]] = {}
    by_points = sorted(range(len(spans)), key=lambda k: -sum(w.curve.count for w in spans[k]))
    for k in by_points:
        near = [
            corridor.wires.around(w.curve, 2.5 * corridor.tolerance, 0.0, w.curve.length)[0]
            for w in spans[k]
        ]
        pairs = zip(spans[k], near, strict=True)
        kept[k] = [wire for wire, own in pairs if not 2 * np.count_nonzero(taken[own]) > len(own)]
        for own in near:
            taken[own] = True
    return [kept[k] for k in range(len(spans))]


def are_wires(corridor: Corridor, wires: Sequence[Wire], taken: NDArray[np.bool_]) -> bool:
    """Whether the curves of a span surely sag and are thin, as wires are.

    Curves without a support at both ends must be known by themselves, and be no accident.
    """
    if not may_be_wires(wires, corridor.tolerance):
        return False
    mean, sigma = usual_curvature(wires)
    if mean <= SETTINGS.curves.certain_sigmas * sigma:
        return False
    if any(min(wire.supports) >= 0 for wire in wires):
        return True
    return any(wire.sure for wire in wires) and are_no_accident(corridor, wires, taken)


def are_no_accident(corridor: Corridor, wires: Sequence[Wire], taken: NDArray[np.bool_]) -> bool:
    """Whether points would hardly lie so along all of these by chance, or are known not to."""
    own = on_any(corridor, wires)
    if 2 * np.count_nonzero(corridor.proven[own]) > len(own):
        return True
    return is_no_accident(
        corridor, [chance(corridor, wire.curve, wire.tolerance, taken) for wire in wires]
    )


def on_any(corridor: Corridor, wires: Sequence[Wire]) -> NDArray[np.int64]:
    """Indices of the points on wires, rising."""
    return distinct(np.concatenate([on_wire(corridor, wire)[0] for wire in wires]))


def may_be_wires(wires: Sequence[Wire], tolerance: float) -> bool:
    """Whether the curves of a span are thin and may sag, as far as their points tell."""
    if not wires:
        return False
    mean, sigma = usual_curvature(wires)
    rough = [wire.curve.rms for wire in wires]
    thin = float(np.median(rough)) < SETTINGS.curves.roughest * tolerance
    return thin and mean + SETTINGS.curves.certain_sigmas * sigma > 1 / SETTINGS.curves.largest_c


def usual_curvature(wires: Sequence[Wire]) -> tuple[float, float]:
    """The mean curvature of wires, and its standard deviation."""
    weight = np.array([1 / wire.curve.variance_of_curvature for wire in wires])
    curvature = np.array([wire.curve.curvature for wire in wires])
    return float(weight @ curvature / weight.sum()), 1 / math.sqrt(weight.sum())


def with_supports(
    wires: Sequence[Wire], supports: Sequence[Support]
) -> tuple[list[Wire], list[Support]]:
    """The wires, and only the supports that hold one of them, with new indices."""
    held = sorted({number for wire in wires for number in wire.supports if number >= 0})
    new = {-1: -1} | {number: k for k, number in enumerate(held)}
    renamed = [
        replace(wire, supports=(new[wire.supports[0]], new[wire.supports[1]])) for wire in wires
    ]
    return renamed, [supports[number] for number in held]


def bundles_of(
    corridor: Corridor, pieces: Sequence[Piece], supports: Sequence[Support]
) -> Iterator[list[Wire]]:
    """The wires of each span; a bundle counts as one wire."""
    cuts = [one for piece in pieces for one in cut(corridor, piece, supports)]
    groups: dict[tuple[int, int], list[Piece]] = {}
    for piece, between in cuts:
        groups.setdefault((min(between), max(between)), []).append(piece)
    for key in sorted(groups):
        for together in of_one_span(groups[key], key, supports):
            wires = wires_of(corridor, together, key, supports)
            if wires:
                yield wires


def cut(
    corridor: Corridor, piece: Piece, supports: Sequence[Support]
) -> Iterator[tuple[Piece, tuple[int, int]]]:
    """Pieces of a wire between the supports that it passes, with the indices of these supports.

    Where the others of its line are cut, a wire that is not seen near that support is held as well.
    """
    curve = piece.curve
    alignment, arc = piece.arc
    ends = {(alignment, arc), (alignment, arc + 1)}
    stops = []
    for number, support in enumerate(supports):
        u, _ = curve.along(np.array([[support.x, support.y, 0.0]]))
        gap = max(-u[0], u[0] - curve.length, 0.0)
        if gap > SETTINGS.network.longest_missing:
            continue
        turn = abs(support.across[0] * curve.ex + support.across[1] * curve.ey)
        left = curve.points(u)[0, :2] - (support.x, support.y)
        side = float(left @ np.array(support.across))
        z = float(curve.height(u)[0])
        slack = 3.0 + 0.05 * gap
        aside = SETTINGS.supports.across if support.cuts & ends else slack
        fits = support.reach[0] - aside < side < support.reach[1] + aside
        fits &= support.low - slack < z < support.high + slack
        if turn < 0.7 and fits:
            stops.append((float(u[0]), number))
    stops.sort()
    u, _ = curve.along(corridor.wires.xyz[piece.points])
    edges = [(-math.inf, -1), *stops, (math.inf, -1)]
    for (low, before), (high, after) in itertools.pairwise(edges):
        mine = piece.points[(u > low) & (u <= high)]
        if len(mine) < 4:
            continue
        own = fit(corridor.wires.xyz[mine], spread=corridor.own_radius)
        if own is None or own.length < 4.0:
            continue
        same = own.ex * curve.ex + own.ey * curve.ey > 0
        yield Piece(mine, own), (before, after) if same else (after, before)


def of_one_span(
    pieces: list[Piece], key: tuple[int, int], supports: Sequence[Support]
) -> list[list[Piece]]:
    """Groups of pieces in one span: all if both supports are known, else those side by side."""
    if key[0] >= 0:
        return [pieces]
    link = np.zeros((len(pieces), len(pieces)), bool)
    for i, one in enumerate(pieces):
        for j, other in enumerate(pieces):
            if i < j and abs(heading(one, 1) @ heading(other, 1)) > SETTINGS.network.cos_parallel:
                link[i, j] = runs_beside(one, other) or runs_beside(other, one)
                link[i, j] |= apart(one, other) < SETTINGS.network.bundle_width
                if key[1] >= 0:
                    sides = [is_ahead(p.curve, supports[key[1]]) for p in (one, other)]
                    link[i, j] = sides[0] == sides[1]
    count, label = connected_components(coo_array(link), directed=False)
    return [[pieces[i] for i in np.flatnonzero(label == k)] for k in range(count)]


def is_ahead(curve: Catenary, support: Support) -> bool:
    """Whether the middle of a curve lies on the forward side of a support's arms."""
    middle = curve.points(np.array([0.5 * curve.length]))[0, :2]
    step = middle - (support.x, support.y)
    return bool(support.across[0] * step[1] - support.across[1] * step[0] > 0)


def wires_of(
    corridor: Corridor, pieces: list[Piece], key: tuple[int, int], supports: Sequence[Support]
) -> list[Wire]:
    """Wires of a span: pieces of one wire joined and fitted, or found above each other."""
    found = beside_each_other(corridor, pieces, key, supports)
    if corridor.tolerance > SETTINGS.sparse.stack_tolerance or min(key) < 0:
        return found
    above = above_each_other(corridor, pieces, key, supports)
    points = [np.count_nonzero(near_any(corridor, wires)) for wires in (found, above)]
    return above if points[1] > points[0] else found


def near_any(corridor: Corridor, wires: Sequence[Wire]) -> NDArray[np.bool_]:
    """Which points above the ground lie within the tolerance of one of several wires."""
    found = np.zeros(len(corridor.air.xyz), bool)
    for wire in wires:
        found[corridor.air.around(wire.curve, corridor.tolerance)[0]] = True
    return found


def above_each_other(
    corridor: Corridor, pieces: list[Piece], key: tuple[int, int], supports: Sequence[Support]
) -> list[Wire]:
    """Wires of a span that lie in one vertical plane, by the shape that they have in common."""
    sure = any(piece.sure for piece in pieces)
    made = [
        Wire(
            curve,
            ordered(curve, key, supports),
            (0.0, curve.length),
            corridor.tolerance,
            sure=sure,
        )
        for curve in levels_of(corridor, pieces, (supports[key[0]], supports[key[1]]))
    ]
    taken = corridor.on(wire.curve for wire in made)
    return [to_supports(wire, supports) for wire in made if stands_alone(corridor, wire, taken)]


def beside_each_other(
    corridor: Corridor, pieces: list[Piece], key: tuple[int, int], supports: Sequence[Support]
) -> list[Wire]:
    """Wires of a span from pieces, and those too sparse to be traced beside them.

    What is known of a wire only along a short way is looked for along the whole span, beside the
    wire that is known best.
    """
    link = np.array(
        [
            [i < j and apart(a, b) < one_wire(corridor.tolerance) for j, b in enumerate(pieces)]
            for i, a in enumerate(pieces)
        ]
    )
    count, label = connected_components(coo_array(link), directed=False)
    found = []
    for number in range(count):
        mine = distinct(np.concatenate([pieces[i].points for i in np.flatnonzero(label == number)]))
        curve = fit(corridor.wires.xyz[mine], spread=2.0)
        if curve is not None:
            wire = Wire(
                curve,
                ordered(curve, key, supports),
                (0.0, curve.length),
                corridor.tolerance,
                sure=any(pieces[i].sure for i in np.flatnonzero(label == number)),
            )
            found.append(to_supports(wire, supports))
    longest = max((wire.seen_length for wire in found), default=0.0)
    short = [wire for wire in found if wire.seen_length < SETTINGS.spans.short_share * longest]
    found = alike(
        [wire for wire in found if all(wire is not other for other in short)], corridor.tolerance
    )
    found += recovered(corridor, found)
    return alike([*found, *short], corridor.tolerance)


def alike(wires: list[Wire], tolerance: float) -> list[Wire]:
    """Wires of one span, without duplicates and short pieces unlike the best wire in shape."""
    order = sorted(wires, key=lambda w: -w.curve.count * w.seen_length)
    found: list[Wire] = []
    for wire in order:
        curve, best = wire.curve, (found or order)[0].curve
        short = wire.seen_length < 0.5 * best.length
        off = abs(curve.curvature / best.curvature - 1) * best.sag
        odd = off > SETTINGS.arcs.curvature_spread * best.sag + 3 * curve.sigma("sag")
        if short and (odd or curve.rms > roughest(best, tolerance)):
            continue
        if short and any(apart_wires(curve, other.curve) < one_wire(tolerance) for other in found):
            continue
        found.append(wire)
    return found


def one_wire(tolerance: float) -> float:
    """Metres between two curves that are of one wire, as they were found at a tolerance."""
    return min(SETTINGS.network.bundle_width / 2, own_radius(tolerance))


def roughest(best: Catenary, tolerance: float) -> float:
    """Scatter that a wire beside the best known one may have, metres."""
    return min(
        max(SETTINGS.arcs.smooth * tolerance, 1.5 * best.rms), SETTINGS.curves.roughest * tolerance
    )


def end_at(wire: Wire, number: int) -> Floats:
    """Position where a wire is attached to a support."""
    return np.asarray(wire.curve.ends[wire.supports.index(number)])


def apart_wires(one: Catenary, other: Catenary) -> float:
    """Distance of the middle of one curve from another curve."""
    return float(other.away(one.points(np.array([0.5 * one.length])))[0])


def to_supports(wire: Wire, supports: Sequence[Support]) -> Wire:
    """A wire extended or cut to the positions of its supports."""
    curve = wire.curve
    ends = [0.0, curve.length]
    for k, number in enumerate(wire.supports):
        if number >= 0:
            support = supports[number]
            normal = np.array([-support.across[1], support.across[0]])
            if (
                abs(normal @ (curve.ex, curve.ey)) < SETTINGS.spans.square
            ):  # of a line that branches off
                normal = np.array([curve.ex, curve.ey])
            step = float(np.array([support.x - curve.x, support.y - curve.y]) @ normal)
            forward = float(normal @ np.array([curve.ex, curve.ey]))
            aside = float(normal @ np.array([-curve.ey, curve.ex]))
            for _ in range(3):  # the plan curve hardly bends
                ends[k] = (step - float(curve.offset(np.array(ends[k]))) * aside) / forward
    if ends[1] - ends[0] < 2.0:
        return wire
    low, high = wire.known
    return replace(wire, curve=curve.between(*ends), known=(low - ends[0], high - ends[0]))


def recovered(corridor: Corridor, wires: list[Wire]) -> list[Wire]:
    """Wires too sparse to be traced, found parallel to the best known wire of a span."""
    if not wires:
        return []
    best = max(wires, key=lambda w: w.curve.count * w.seen_length)
    curve = best.curve
    if curve.length < 15:
        return []
    air = corridor.wires
    radius = SETTINGS.spans.group_radius * corridor.tolerance
    taken = corridor.refused.copy()
    for wire in wires:
        taken[air.around(wire.curve, corridor.own_radius, -2.0, wire.curve.length + 2)[0]] = True
    middles = curve.points(
        np.arange(0.0, curve.length + SETTINGS.network.line_width, SETTINGS.network.line_width)
    )
    box = air.within(middles[:, :2], SETTINGS.network.line_width)
    u, v, z = curve.residuals(air.xyz[box])
    margin = min(3.0, 0.1 * curve.length)
    keep = (u > margin) & (u < curve.length - margin) & ~taken[box]
    is_stack = corridor.tolerance <= SETTINGS.sparse.stack_tolerance  # others stand beside it
    aside = SETTINGS.arcs.arm_aside if is_stack else SETTINGS.network.line_width
    keep &= (np.abs(v) < aside) & (np.abs(z) < SETTINGS.network.line_width)
    box, u, v, z = box[keep], u[keep], v[keep], z[keep]
    found: list[Wire] = []
    free = np.ones(len(box), bool)
    for _ in range(20):
        group = densest_group(v, z, free, radius)
        if group is None:
            break
        away = np.hypot(v - group[0], z - group[1])
        made = fit(
            air.xyz[box[free & (away < 2 * radius)]],
            spread=2 * radius,
            curvature=curve.curvature,
        )
        free &= away > corridor.own_radius
        if made is None:
            continue
        _, dv, dz = made.residuals(air.xyz[box])
        off = np.hypot(dv, dz)
        inner = off < radius
        # Above and below: at the sides there may be other wires.
        ring = 2 * np.count_nonzero((off > radius) & (off < 3 * radius) & (np.abs(dz) > np.abs(dv)))
        eighths = len(np.unique((8 * u[inner] / curve.length).astype(np.int64)))
        spare = SETTINGS.arcs.curvature_spread * curve.sag + 3 * made.sigma("sag")
        same_shape = abs(made.curvature * curve.c - 1) * curve.sag < spare
        same_shape &= made.rms < roughest(curve, corridor.tolerance)
        enough = max(SETTINGS.spans.found_points, SETTINGS.spans.found_share * curve.count)
        if (
            inner.sum() >= enough
            and eighths >= SETTINGS.spans.found_eighths
            and ring <= inner.sum()
            and same_shape
        ):
            same = made.ex * curve.ex + made.ey * curve.ey > 0
            ends = best.supports if same else best.supports[::-1]
            found.append(Wire(made, ends, (0.0, made.length), corridor.tolerance, sure=False))
            free &= off > corridor.own_radius
    if not found:
        return []
    on_wires = corridor.on(one.curve for one in (*wires, *found))
    return [one for one in found if stands_alone(corridor, one, on_wires)]


def stands_alone(corridor: Corridor, wire: Wire, taken: NDArray[np.bool_]) -> bool:
    """Whether there is little around a wire but what is taken, and it is no edge of a roof."""
    return (
        alone(corridor, wire.curve, taken) >= SETTINGS.curves.alone_share
        and chance(corridor, wire.curve, wire.tolerance, taken)
        < math.log(SETTINGS.sparse.false_alarms)
        and not is_on_roof(corridor, wire.curve)
    )


def densest_group(
    v: Floats, z: Floats, free: NDArray[np.bool_], radius: float
) -> tuple[float, float] | None:
    """Offset and height of the densest group of free points; None if it is too small."""
    if np.count_nonzero(free) < SETTINGS.spans.found_points:
        return None
    cells = np.floor(np.column_stack([v[free], z[free]]) / radius).astype(np.int64)
    low = cells.min(axis=0)
    table = np.zeros(
        cells.max(axis=0) - low + 2, np.int64
    )  # none beyond the width of a line: it is small
    np.add.at(table, tuple((cells - low).T), 1)
    totals = table[:-1, :-1] + table[1:, :-1] + table[:-1, 1:] + table[1:, 1:]
    totals[table[:-1, :-1] == 0] = 0
    at = np.array(np.unravel_index(totals.argmax(), totals.shape))
    if totals[tuple(at)] < SETTINGS.spans.found_points:
        return None
    right, upper = (at + low + 1) * radius
    return float(right), float(upper)


# --- conductors of a bundle ----------------------------------------------------------------


def subconductors(corridor: Corridor, wire: Wire) -> list[Wire]:
    """The subconductors of a bundle, each with a catenary; the wire itself if it is single."""
    if corridor.tolerance <= SETTINGS.sparse.stack_tolerance:
        return [wire]  # those beside it were found by themselves
    low, high = wire.known
    points, _ = corridor.wires.around(
        wire.curve, SETTINGS.network.bundle_width, low - 0.5, high + 0.5
    )
    xyz = corridor.wires.xyz[points]
    _, v, z = wire.curve.residuals(xyz)
    peaks = peaks_of(v, z)
    nearest = np.hypot(v[:, None] - peaks[:, 0], z[:, None] - peaks[:, 1]).argmin(axis=1)
    found = []
    for k in range(len(peaks)):
        curve = fit(xyz[nearest == k], spread=corridor.own_radius)
        if curve is None or curve.length < 0.5 * (high - low):
            return [wire]
        same = curve.ex * wire.curve.ex + curve.ey * wire.curve.ey > 0
        ends = wire.supports if same else wire.supports[::-1]
        found.append(Wire(curve, ends, (0.0, curve.length), corridor.tolerance, sure=wire.sure))
    return found


def once(conductors: Sequence[tuple[Wire, int]]) -> list[tuple[Wire, int]]:
    """Conductors without duplicates, which two wires led to; the better known one is kept."""
    kept: list[tuple[Wire, int]] = []
    for wire, bundle in sorted(conductors, key=lambda c: -c[0].curve.count * c[0].curve.length):
        if all(
            apart_wires(wire.curve, other.curve) > SETTINGS.spans.subconductor_gap
            for other, _ in kept
        ):
            kept.append((wire, bundle))
    return kept


def peaks_of(v: Floats, z: Floats) -> Floats:
    """Offsets and heights of the density peaks of points in cross-section, shape (k, 2)."""
    middle = np.array([[np.median(v), np.median(z)]]) if len(v) else np.zeros((1, 2))
    if len(v) < SETTINGS.spans.section_points:
        return middle
    edges = np.arange(
        -SETTINGS.network.bundle_width - SECTION_BIN / 2,
        SETTINGS.network.bundle_width + SECTION_BIN,
        SECTION_BIN,
    )
    smooth = gaussian_filter(
        np.histogram2d(v, z, (edges, edges))[0], SETTINGS.spans.section_blur / SECTION_BIN
    )
    size = 2 * round(SETTINGS.spans.subconductor_gap / SECTION_BIN / 2) + 1
    top = (smooth == maximum_filter(smooth, size)) & (
        smooth > SETTINGS.spans.section_peak * smooth.max()
    )
    peaks = np.argwhere(top)[np.argsort(-smooth[top], kind="stable")]
    kept: list[NDArray[np.int64]] = []
    for peak in peaks:
        if all(valley(smooth, peak, other) for other in kept):
            kept.append(peak)
    return np.asarray(edges[0] + (np.array(kept) + 0.5) * SECTION_BIN)


def valley(smooth: Floats, one: NDArray[np.int64], other: NDArray[np.int64]) -> bool:
    """Whether the density drops enough between two peaks, and by more than by chance."""
    share = np.linspace(0, 1, 11)[:, None]
    path = np.round(one + share * (other - one)).astype(np.int64)
    lowest, lower = (
        smooth[path[:, 0], path[:, 1]].min(),
        min(smooth[tuple(one)], smooth[tuple(other)]),
    )
    # A Gaussian counts the points of an area of 4 pi times its variance; Poisson's law for these.
    area = 4 * math.pi * (SETTINGS.spans.section_blur / SECTION_BIN) ** 2
    surely = (lower - lowest) * area > SETTINGS.spans.valley_sigmas * math.sqrt(
        (lower + lowest) * area
    )
    return bool(surely and lowest < SETTINGS.spans.section_valley * lower)


# --- numbers -------------------------------------------------------------------------------


def numbered(
    wires: Sequence[Wire],
    supports: Sequence[Support],
    same: Sequence[tuple[int, int]] = (),
    strip: Sequence[int] = (),
) -> list[Wire]:
    """Wires with conductor and bundle numbers that are the same in all spans.

    Parameters
    ----------
    strip : of each wire, that of most of its points; without it any wires may be one
    same : pairs of wires that are one conductor in two positions; the second goes on in other spans
        only where one begins at its end, as where it was not found another conductor would follow,
        and in no wire of a span with such pairs that is in none: it was not followed well
    """
    if not wires:
        return []
    every, again = set(range(len(wires))), {b for _, b in same}
    swung = {wires[b].span for b in again}
    may = again | {k for k in every if wires[k].span not in swung}
    pairs = list(same)
    for number in range(len(supports)):
        met = list(meeting(wires, every - again, number, SETTINGS.network.join_aside))
        left = may - {k for pair in met for k in pair}
        more = meeting(wires, left, number, SETTINGS.continued.same_wire)
        pairs += [*met, *(pair for pair in more if again & {*pair})]
    chain = in_order(chained(wires, pairs, same, strip or range(len(wires))))
    link = chain[:, None] == chain
    for own in {wire.bundle for wire in wires}:
        mine = [k for k, wire in enumerate(wires) if wire.bundle == own]
        link[mine[0], mine[1:]] = True
    for a, b in twins(wires):
        link[a, b] = True
    bundle = in_order(connected_components(coo_array(link), directed=False)[1])
    return [
        replace(wire, wire=int(chain[k]) + 1, bundle=int(bundle[k]) + 1)
        for k, wire in enumerate(wires)
    ]


def chained(
    wires: Sequence[Wire],
    pairs: Iterable[tuple[int, int]],
    same: Sequence[tuple[int, int]],
    strip: Sequence[int],
) -> NDArray[np.int32]:
    """Number of the chain of each wire, array of shape (n,), of pairs that are joined in turn.

    A chain holds one wire of a span and strip: a pair that would join two is left out, or one
    wrong pair made two conductors one along all of a line.

    Parameters
    ----------
    pairs : the surest first
    same : those of one span that are one conductor in two positions, whatever their strips
    strip : of each wire
    """
    alike = {*same} | {(b, a) for a, b in same}

    def may_be_one(a: int, b: int) -> bool:
        return wires[a].span != wires[b].span or strip[a] != strip[b] or (a, b) in alike

    chain = [{k} for k in range(len(wires))]
    for one, other in pairs:
        rest = chain[other] - chain[one]
        if all(may_be_one(a, b) for a in chain[one] for b in rest):
            joint = chain[one] | chain[other]
            for k in joint:
                chain[k] = joint
    return np.array([min(own) for own in chain], np.int32)


def twins(wires: Sequence[Wire]) -> Iterator[tuple[int, int]]:
    """Pairs of wires that were followed apart, and are as near as subconductors of their span are.

    Where one conductor of a span is a bundle, so are the others: they are of one kind. Where none
    is, wires above each other may be as near, and each is one.
    """
    of_span: dict[int, list[int]] = {}
    for k, wire in enumerate(wires):
        of_span.setdefault(wire.span, []).append(k)
    for own in of_span.values():
        if len({wires[k].bundle for k in own}) < len(own):
            for a, b in itertools.combinations(own, 2):
                if apart_wires(wires[a].curve, wires[b].curve) < SETTINGS.network.bundle_width:
                    yield a, b


def in_order(label: NDArray[np.int32]) -> Ints:
    """Labels renumbered from 0 in the order in which they occur."""
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[inverse])


def meeting(
    wires: Sequence[Wire], some: AbstractSet[int], number: int, reach: float
) -> Iterator[tuple[int, int]]:
    """Pairs of some of the wires that continue each other at a support, from span to span."""
    ends = [(k, e) for k in sorted(some) for e in (0, 1) if wires[k].supports[e] == number]
    for one, other in itertools.combinations(sorted({wires[k].span for k, _ in ends}), 2):
        here = [(k, e) for k, e in ends if wires[k].span == one]
        there = [(k, e) for k, e in ends if wires[k].span == other]
        yield from matched(wires, here, there, reach)


def matched(
    wires: Sequence[Wire],
    here: Sequence[tuple[int, int]],
    there: Sequence[tuple[int, int]],
    reach: float,
) -> Iterator[tuple[int, int]]:
    """Pairs of wires of two spans whose ends are within a distance of each other, in metres."""
    a, b = (np.array([wires[k].curve.ends[e] for k, e in side]) for side in (here, there))
    away = np.linalg.norm(a[:, None] - b[None], axis=2)
    rows, columns = linear_sum_assignment(np.minimum(away, 10 * reach))
    for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
        if away[i, j] < reach:
            yield here[i][0], there[j][0]


def ordered(curve: Catenary, key: tuple[int, int], supports: Sequence[Support]) -> tuple[int, int]:
    """Index of the support at the start of a curve, and of that at its end."""
    ends = [-1, -1]
    for number in key:
        if number >= 0:
            support = supports[number]
            u, _ = curve.along(np.array([[support.x, support.y, 0.0]]))
            ends[int(u[0] > 0.5 * curve.length)] = number
    return ends[0], ends[1]
