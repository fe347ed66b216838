"""Spans of catenaries from points that may be wire: the steps that extraction and fitting share."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, depth_first_order
from scipy.spatial import cKDTree

from algorithms.corridor._curves.arcs import arcs_of
from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._curves.lanes import followed_together
from algorithms.corridor._curves.network import (
    Corridor,
    Piece,
    curves_of,
    is_on_roof,
    is_straight,
    wires_among,
)
from algorithms.corridor._curves.sparse import sparse_wires, stacked_wires
from algorithms.corridor._curves.stacks import stacks_among
from algorithms.corridor._curves.structures import (
    carriers,
    holds_level,
    in_mesh,
    is_row_of_mesh,
)
from algorithms.corridor._curves.trace import trace_all
from algorithms.corridor._curves.tracks import Alignment, alignments_among
from algorithms.corridor._extraction.continued import completed
from algorithms.corridor._extraction.doubled import without_doubled
from algorithms.corridor._extraction.ends import with_ends
from algorithms.corridor._extraction.spans import (
    Wire,
    are_no_accident,
    is_ahead,
    numbered,
    on_any,
    on_wire,
    spans_of,
    to_supports,
    with_supports,
)
from algorithms.corridor._extraction.supports import (
    Support,
    arms_in_plan,
    is_pole,
    is_seen,
    may_hold,
    supports_of,
)
from algorithms.corridor._extraction.swung import (
    in_two_positions,
    parted,
    seen_twice,
    strip_of,
    strips_disagree,
)
from algorithms.corridor._extraction.towers import all_centred, compared
from algorithms.corridor._settings import SETTINGS
from algorithms.shared.kernels.sorting import distinct
from toolbox.context import Context

NUMBERS = ("span", "bundle", "wire")


def tolerances(given: float | None, metre: float) -> tuple[float, ...]:
    """At which tolerances wires are followed: the one given, or several.

    Parameters
    ----------
    given : in the unit of the data
    metre : length of one metre in that unit
    """
    return SETTINGS.lines.tolerances if given is None else (given / metre,)


def follow(
    corridor: Corridor,
    voxel: NDArray[np.int64],
    max_gap: float,
    tolerances: Sequence[float],
    ctx: Context,
) -> tuple[list[Wire], list[Support]]:
    """The conductors of all spans, and the supports between them.

    Where wind moved conductors between two strips, those of one lie on others of the next, and
    wires are followed in each strip by itself, too. Spans so found are taken where their points
    tell more of them.

    Parameters
    ----------
    corridor : points, and those of them that may be wire, at the first tolerance
    voxel : of each of these; one of a voxel may be the beginning of a wire
    max_gap : longest piece of a wire that may be missing, metres
    tolerances : how far a point may lie from the wire that is followed, ascending, metres
    """
    lines = at_tolerances(corridor, voxel, max_gap, tolerances, ctx)
    wires, supports = together(corridor, lines)
    if not strips_disagree(corridor, wires):
        return to_data_ends(corridor, wires, supports)
    strip = corridor.strip[corridor.wires.order]
    arms = np.array([arms_in_plan(one) for one in seen_supports(supports)]).reshape(-1, 2, 2)
    apart: list[Line] = []
    for number in distinct(strip).tolist():
        own, part = replace(corridor.of_strip(number), arms=arms), ctx.part(1.0, 1.0)
        apart += at_tolerances(own, voxel[strip == number], max_gap, tolerances, part)
    swung = strip_by_strip(corridor, apart)
    lines = better(corridor, unbundled(corridor, lines, swung), swung)
    return to_data_ends(corridor, *together(corridor, lines))


def strip_by_strip(corridor: Corridor, lines: Sequence[Line]) -> list[Line]:
    """Lines that were found in each strip by itself as one, of spans that wind swung."""
    wires, supports = numbered_anew(lines)
    spans: dict[tuple[int, int, bool], list[Wire]] = {}
    for wire in wires:
        low, high = sorted(wire.supports)
        if high >= 0:
            side = low < 0 and is_ahead(wire.curve, supports[high])
            spans.setdefault((low, high, side), []).append(wire)
    both = [
        replace(to_supports(wire, supports), span=span)
        for span, own in enumerate(spans.values(), start=1)
        for wire in own
    ]
    lines = lines_of(both, supports)
    return [line for line in lines if 4 * len(seen_twice(corridor, line.wires)) > len(line.wires)]


def unbundled(corridor: Corridor, lines: Sequence[Line], swung: Sequence[Line]) -> list[Line]:
    """Lines without bundles where wind swung them: their conductors may be positions of one."""
    taken = corridor.on(wire.curve for line in swung for wire in line.wires)
    return [
        replace(line, wires=[replace(wire, bundle=wire.wire) for wire in line.wires])
        if 2 * len(rest_of(corridor, line, taken)) < len(line.wires)
        else line
        for line in lines
    ]


def at_tolerances(
    corridor: Corridor,
    voxel: NDArray[np.int64],
    max_gap: float,
    tolerances: Sequence[float],
    ctx: Context,
) -> list[Line]:
    """The lines of a corridor, each span at the best of several tolerances; see :func:`follow`.

    How far points lie off their wires depends on the scanner, and on whether the conductors are
    bundles. So wires are followed at each of several tolerances, and each span is taken at that
    for which its points tell most. See :func:`looked_again`, too.
    """
    tried: list[Tried] = []
    for k, tolerance in enumerate(tolerances):
        part = ctx.part(k / len(tolerances), (k + 1) / len(tolerances))
        if k:
            voxel, corridor = voxel[~corridor.refused], corridor.without_refused(tolerance)
        pieces = followed(corridor, voxel, max_gap, part)
        if not k:  # contact lines are known now, whose wires are above each other, too
            tried += stacked(corridor, part.part(0.7, 0.7))
            pieces = without_stacks(corridor, pieces, tried)
        tried.append(Tried(corridor, pieces, *lines_among(corridor, pieces, max_gap, part)))
    seen = seen_supports(support for one in tried for support in one.supports)
    lines: list[Line] = []
    for one in tried:
        lines = better(one.corridor, lines, one.knowing(seen, max_gap, ctx.part(1.0, 1.0)))
    if len(tolerances) == 1:
        return lines
    return looked_again(corridor, voxel, lines, seen, max_gap, ctx.part(1.0, 1.0))


def looked_again(
    corridor: Corridor,
    voxel: NDArray[np.int64],
    lines: Sequence[Line],
    seen: Sequence[Support],
    max_gap: float,
    ctx: Context,
) -> list[Line]:
    """The lines, those on poles with spans at one more tolerance, where their points tell more.

    Thin wires in pairs scatter too much for the smaller tolerance, and at the larger one twigs and
    roofs crowd them. What is found between alone may be of a crane, so it must hang at a support
    that is seen or known.

    Parameters
    ----------
    corridor, voxel : at the last of the other tolerances
    seen : poles that are seen at any of these
    """
    near = near_poles(corridor, lines) & ~corridor.refused
    if not near.any():
        return list(lines)
    may = corridor.may.copy()
    may[may] = near
    between = replace(corridor, may=may, tolerance=SETTINGS.lines.between)
    pieces = followed(between, voxel[near], max_gap, ctx)
    found = Tried(between, pieces, *lines_among(between, pieces, max_gap, ctx))
    known = [*seen, *(support for line in lines for support in line.supports)]
    more = found.knowing(seen, max_gap, ctx)
    return better(between, lines, more, alone=lambda span: is_held(span, known))


def near_poles(corridor: Corridor, lines: Sequence[Line]) -> NDArray[np.bool_]:
    """Which points that may be wire are near, in plan, to spans that no tower holds."""
    wires = [
        wire.curve.points(np.arange(0.0, wire.curve.length, SETTINGS.curves.hanger_depth))[:, :2]
        for line in lines
        if all(is_pole(support.high - support.ground) for support in line.supports)
        for wire in line.wires
    ]
    if not wires:
        return np.zeros(len(corridor.wires.xyz), bool)
    reach = SETTINGS.network.longest_missing
    tree = cKDTree(np.concatenate(wires))
    away, _ = tree.query(corridor.wires.xyz[:, :2], distance_upper_bound=reach)
    return np.asarray(away < reach)


def is_held(span: Line, known: Sequence[Support]) -> bool:
    """Whether a support of a span is seen, or is one that is known."""
    near = SETTINGS.network.join_aside
    pairs = itertools.product(span.supports, known)
    return any(map(is_seen, span.supports)) or any(apart(one, other) < near for one, other in pairs)


@dataclass(frozen=True)
class Tried:
    """What was found at one tolerance: pieces of what may be wires, lines among them, supports.

    There are no pieces of stacks, whose wires are not sought again.
    """

    corridor: Corridor
    pieces: Sequence[Piece] | None
    lines: Sequence[Line]
    supports: Sequence[Support]

    def knowing(self, seen: Sequence[Support], max_gap: float, ctx: Context) -> Sequence[Line]:
        """The lines, sought again where supports are seen at another tolerance that hold none."""
        own = [support for line in self.lines for support in line.supports]
        wires = [wire for line in self.lines for wire in line.wires]
        missed = [
            one
            for one in seen
            if not any(is_known_by(one, other) for other in own)
            and any(may_hold(one, wire.curve) for wire in wires)
        ]
        if not missed or self.pieces is None:
            return self.lines
        arms = [*self.corridor.arms, *(arms_in_plan(one) for one in missed)]
        corridor = replace(self.corridor, arms=np.array(arms))
        return lines_among(corridor, self.pieces, max_gap, ctx)[0]


def seen_supports(supports: Iterable[Support]) -> list[Support]:
    """The poles that hold wires and of which much of a body is seen, each once.

    Towers are metres wide: at another tolerance the place of one differs, and it would be two.
    """
    found: list[Support] = []
    for support in supports:
        seen = bool(support.cuts) and is_pole(support.high - support.ground) and is_seen(support)
        if seen and all(apart(support, one) >= SETTINGS.network.join_aside for one in found):
            found.append(support)
    return found


def is_known_by(support: Support, other: Support) -> bool:
    """Whether another support is the same, as near as can be told."""
    near = SETTINGS.network.join_aside if is_seen(other) else SETTINGS.supports.settled_slack
    return apart(support, other) < near


def apart(one: Support, other: Support) -> float:
    """Metres between two supports in plan."""
    return math.hypot(one.x - other.x, one.y - other.y)


def followed(
    corridor: Corridor, voxel: NDArray[np.int64], max_gap: float, ctx: Context
) -> list[Piece]:
    """Pieces of what may be wires, followed from point to point or found where points are few."""
    curves = trace_all(
        corridor.wires,
        voxel,
        tolerance=corridor.tolerance,
        max_gap=max_gap,
        ctx=ctx.part(0.0, 0.7),
    )
    pieces = without_contact_lines(corridor, curves_of(corridor, curves))
    return pieces + sparse_wires(corridor, pieces, ctx.part(0.7, 0.7))


def without_contact_lines(corridor: Corridor, pieces: Sequence[Piece]) -> list[Piece]:
    """The pieces without those of contact lines of a railway, whose points may be no wire.

    Left among the others, these would share supports and spans with a line beside the railway, and
    that would be no line as most of its wires were straight. What goes on along a contact line
    is one as well: where the upper wire rises to a mast and falls behind it, it is not told by its
    shape.
    """
    kept, least = list(pieces), SETTINGS.structures.level_share
    contact = [one for one in kept if holds_level(corridor.air, corridor.height, one.curve)]
    while True:
        corridor.refuse(contact)
        corridor.left_out += [piece.curve for piece in contact if piece.sure]
        kept = [piece for piece in kept if all(piece is not one for one in contact)]
        share = [corridor.refused[piece.points].mean() for piece in kept]
        contact = [one for one, own in zip(kept, share, strict=True) if own > least]
        if not contact:
            return kept


def stacked(corridor: Corridor, ctx: Context) -> list[Tried]:
    """Lines of wires so close above each other that one followed would change over to the next."""
    if SETTINGS.sparse.stack_tolerance >= corridor.tolerance:
        return []
    close = corridor.without_refused(SETTINGS.sparse.stack_tolerance)
    arcs, alignments = stacks_among(close, stacked_wires(close, ctx), ctx)
    wires, supports = wires_between(close, arcs, alignments)
    return [Tried(close, None, lines_from(close, wires, supports), supports)] if wires else []


def without_stacks(
    corridor: Corridor, pieces: Sequence[Piece], tried: Sequence[Tried]
) -> list[Piece]:
    """The pieces that are no wires of a stack, whose points may be no other wire.

    Else one that changed over between them would be a wire of a line beside the stack.
    """
    for one in tried:
        for curve in (wire.curve for line in one.lines for wire in line.wires):
            corridor.refused[corridor.wires.around(curve, one.corridor.own_radius)[0]] = True
    least = SETTINGS.structures.level_share
    return [piece for piece in pieces if corridor.refused[piece.points].mean() <= least]


def lines_among(
    corridor: Corridor, pieces: Sequence[Piece], max_gap: float, ctx: Context
) -> tuple[list[Line], Sequence[Support]]:
    """The lines among pieces of what may be wires, without structures and accidents.

    With them come all supports that were tried.
    """
    pieces = [piece for piece in pieces if not is_on_roof(corridor, piece.curve)]
    wires, supports = hung(corridor, pieces, max_gap, ctx.part(0.7, 1.0))
    return lines_from(corridor, wires, supports), supports


def lines_from(
    corridor: Corridor, wires: Sequence[Wire], supports: Sequence[Support]
) -> list[Line]:
    """The lines of wires and supports, without structures and accidents."""
    here = [line for line in lines_of(wires, supports) if line.is_no_accident(corridor)]
    kept = without_structures(corridor, here)
    return [replace(line, supports=compared(corridor, line.wires, line.supports)) for line in kept]


def without_structures(corridor: Corridor, lines: Sequence[Line]) -> list[Line]:
    """The lines that carry nothing but themselves; the wires of others are left out.

    Rows of a mesh tell of those beside them, in which too few ties were seen.
    """
    kept = list(lines)
    while found := [line for line in kept if line.is_structure(corridor)]:
        kept = [line for line in kept if all(line is not one for one in found)]
        for wires in ([wire.curve for wire in line.wires] for line in found):
            corridor.left_out += wires
            if any(is_row_of_mesh(curve, corridor.tied) for curve in wires):
                corridor.tied += wires
    return kept


def hung(
    corridor: Corridor, traced: Sequence[Piece], max_gap: float, ctx: Context
) -> tuple[list[Wire], Sequence[Support]]:
    """The conductors of all spans, and their supports, at the tolerance of the corridor."""
    found = [
        followed_together(corridor, one, max_gap, ctx.part(0.0, 0.0))
        for one in alignments_among(corridor, traced)
    ]
    arcs, alignments = arcs_of(corridor, found)
    pieces = wires_among(corridor, arcs)
    ctx.progress(0.5)
    return wires_between(corridor, pieces, alignments)


def wires_between(
    corridor: Corridor, pieces: Sequence[Piece], alignments: Sequence[Alignment]
) -> tuple[list[Wire], Sequence[Support]]:
    """The conductors of all spans between the supports that their pieces tell."""
    if not pieces:
        return [], []
    supports = supports_of(corridor, pieces, alignments)
    wires = completed(corridor, sagging(spans_of(corridor, pieces, supports)), supports)
    bent = [wire for wire in sagging(wires) if not is_on_roof(corridor, wire.curve)]
    return (numbered(bent, supports) if len(bent) < len(wires) else bent), supports


def is_arm(wire: Wire, supports: Sequence[Support]) -> bool:
    """Whether a wire does not leave the arms of a support that holds it: it is a part of one."""
    slack = SETTINGS.network.join_aside
    for support in (supports[number] for number in wire.supports if number >= 0):
        step = wire.curve.ends[:, :2] - (support.x, support.y)
        aside = step @ support.across
        along = step @ (-support.across[1], support.across[0])
        low, high = support.reach[0] - slack, support.reach[1] + slack
        if (np.abs(along) < slack).all() and (aside > low).all() and (aside < high).all():
            return True
    return False


def without_bars(
    wires: Sequence[Wire], supports: Sequence[Support]
) -> tuple[list[Wire], list[Support]]:
    """The wires but for bars of towers, and the supports as high as the wires that they hold.

    Bars of tall lattices are as long as spans may be, straight, and beside each other. They do not
    leave the tower, which is as wide as at the corners of its foot. Wires that end in it are its.
    """
    place = np.array([(one.x, one.y) for one in supports]).reshape(-1, 1, 1, 2)
    height = np.array([one.high - one.ground for one in supports])
    ends = np.array([wire.curve.ends[:, :2] for wire in wires]).reshape(-1, 2, 2)
    corner = math.sqrt(2) * SETTINGS.towers.splay_lattice * height
    amid = np.hypot(*np.moveaxis(ends - place, 3, 0)) < corner[:, None, None]
    bars = amid.all(axis=2).any(axis=0)
    if not bars.any():
        return list(wires), list(supports)
    towers = amid.all(axis=2).any(axis=1)
    kept: list[Wire] = []
    held: dict[int, list[float]] = {number: [] for number in np.flatnonzero(towers).tolist()}
    for k in np.flatnonzero(~bars).tolist():
        own = list(wires[k].supports)
        for end, number in itertools.product((0, 1), held):
            if own[end] == -1 and amid[number, k, end]:
                own[end] = number
            if own[end] == number:
                held[number].append(wires[k].curve.ends[end, 2])
        kept.append(replace(wires[k], supports=(own[0], own[1])))
    return kept, [
        replace(one, low=min(held[k]), high=max(held[k])) if held.get(k) else one
        for k, one in enumerate(supports)
    ]


def is_guy(wire: Wire, supports: Sequence[Support]) -> bool:
    """Whether an end of a wire is so near to the ground that it is tied there, as of a mast."""
    ends = zip(wire.supports, wire.curve.ends[:, 2], strict=True)
    heights = [z - supports[number].ground for number, z in ends if number >= 0]
    return min(heights, default=math.inf) < SETTINGS.towers.foot_height


def sagging(wires: Sequence[Wire]) -> list[Wire]:
    """The wires without those that are surely straight.

    All wires of a span have nearly one shape, so where most are straight none is a wire.
    """
    spans: dict[int, list[Wire]] = {}
    for wire in wires:
        spans.setdefault(wire.span, []).append(wire)
    found = []
    for own in spans.values():
        bent = [wire for wire in own if not is_straight(wire.curve)]
        if 2 * len(bent) > len(own):
            found += bent
    return found


@dataclass(frozen=True)
class Line:
    """Wires that hang together by spans and supports."""

    wires: Sequence[Wire]
    supports: Sequence[Support]

    @property
    def length(self) -> float:
        """Metres of conductor along which points are known."""
        return sum(wire.seen_length for wire in self.wires)

    def is_no_accident(self, corridor: Corridor) -> bool:
        """Whether points that happen to lie so would not look like it."""
        taken = corridor.on(wire.curve for wire in self.wires)
        return are_no_accident(corridor, self.wires, taken)

    def is_structure(self, corridor: Corridor) -> bool:
        """Whether chairs hang below its wires, or much of them holds a contact wire or a mesh."""
        bodies = sum(carriers(corridor.air, corridor.height, w.curve) for w in self.wires)
        if bodies >= max(
            SETTINGS.lines.fewest_carriers, SETTINGS.lines.carriers_per_wire * len(self.wires)
        ):
            return True
        tied = in_mesh([clear_of_supports(wire) for wire in self.wires], corridor.tied)
        held = [
            wire.seen_length
            for wire, in_it in zip(self.wires, tied, strict=True)
            if in_it
            or is_row_of_mesh(wire.curve, corridor.tied)
            or holds_level(corridor.air, corridor.height, wire.curve)
        ]
        return sum(held) > SETTINGS.structures.level_share * self.length


def clear_of_supports(wire: Wire) -> Catenary:
    """A wire without its ends at supports, whose braces cross as the wires of a mesh do."""
    length = wire.curve.length
    low, high = (
        min(SETTINGS.curves.clutter_radius, length / 4) * (number >= 0) for number in wire.supports
    )
    return wire.curve.between(low, length - high)


def lines_of(wires: Sequence[Wire], supports: Sequence[Support]) -> list[Line]:
    """The lines among wires, in the order of their first wires."""
    if not wires:
        return []
    nodes = [[("span", w.span), *(("support", n) for n in w.supports if n >= 0)] for w in wires]
    names = {node: k for k, node in enumerate(dict.fromkeys(itertools.chain(*nodes)))}
    pairs = np.array([(names[own[0]], names[node]) for own in nodes for node in own]).reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(names), len(names)))
    _, label = connected_components(graph, directed=False)
    of_line: dict[int, list[Wire]] = {}
    for wire, own in zip(wires, nodes, strict=True):
        of_line.setdefault(int(label[names[own[0]]]), []).append(wire)
    return [Line(*with_supports(own, supports)) for own in of_line.values()]


def better(
    corridor: Corridor,
    narrow: Sequence[Line],
    wide: Sequence[Line],
    alone: Callable[[Line], bool] = lambda span: True,
) -> list[Line]:
    """Of spans at a smaller and a larger tolerance, those for which the points tell more.

    Spans that share most of their points are compared. A span has no more by reaching over a
    support, along what the other tolerance finds as the next span. Where a support is in a wrong
    place, the points lie farther from the arcs, and so tell less though they may be more. Wires
    that only the others find are kept.

    Parameters
    ----------
    alone : whether a span that only the larger tolerance finds may be one
    """
    spans = [[one for line in lines for one in spans_apart(line)] for lines in (narrow, wide)]
    chosen, spare = [], []
    for same, found_there, beside in same_spans(corridor, *spans):
        other = found_there if same else list(filter(alone, found_there))
        more = not same or bool(
            other and evidence(corridor, other, beside) > evidence(corridor, same)
        )
        chosen += other if more else same
        spare += same if more else other
    taken = np.zeros(len(corridor.air.xyz), bool)
    found: list[Line] = []
    for one in sorted(chosen, key=lambda line: -line.length):
        rest = rest_of(corridor, one, taken)
        found += [one] if len(rest) == len(one.wires) else lines_of(rest, one.supports)
        taken |= corridor.on(wire.curve for wire in rest)
    for one in spare:
        rest = rest_of(corridor, one, taken)
        certain = [line for line in lines_of(rest, one.supports) if line.is_no_accident(corridor)]
        found += certain
        taken |= corridor.on(wire.curve for line in certain for wire in line.wires)
    return found


def spans_apart(line: Line) -> list[Line]:
    """The spans of a line, each by itself."""
    own: dict[int, list[Wire]] = {}
    for wire in line.wires:
        own.setdefault(wire.span, []).append(wire)
    return [Line(*with_supports(wires, line.supports)) for wires in own.values()]


def evidence(
    corridor: Corridor, spans: Sequence[Line], beside: NDArray[np.int64] | Sequence[int] = ()
) -> float:
    """Logarithm of how much likelier the points lie on the wires of spans than by chance.

    On a wire they scatter as normal errors do, by its root mean square; by chance they lie
    anywhere in the disc in which a wire stands alone. What chance explains better counts nothing.
    A point is of one wire, that which explains it best. Each support of which unlikely few points
    are seen tells against them, once. More wires fit any points better, so each costs as much as
    its parameters gain by chance (Akaike 1974).

    Parameters
    ----------
    beside : indices of points that count nothing, rising

    References
    ----------
    Akaike, H. (1974). A new look at the statistical model identification. IEEE Transactions on
    Automatic Control 19(6), 716-723.
    """
    wires = [wire for span in spans for wire in span.wires]
    on_each = [on_wire(corridor, wire)[:2] for wire in wires]
    points = np.concatenate([own for own, _ in on_each])
    gain = np.concatenate(
        [gains(away, wire.curve.rms) for wire, (_, away) in zip(wires, on_each, strict=True)]
    )
    once, which = np.unique(points, return_inverse=True)
    best = np.zeros(len(once))
    np.maximum.at(best, which, gain)
    best[np.isin(once, beside)] = 0.0
    supports = dict.fromkeys(support for span in spans for support in span.supports)
    against = sum(support.chance for support in supports)
    return float(best.sum()) + against - sum(wire.curve.parameters for wire in wires)


def gains(away: NDArray[np.float64], rms: float) -> NDArray[np.float64]:
    """How much likelier points at distances from a wire are on it than by chance, logarithms."""
    scatter = max(rms, SETTINGS.arcs.least_scatter)
    likelier = 2 * math.log(SETTINGS.curves.clutter_radius / scatter) - (away / scatter) ** 2
    return np.asarray(np.maximum(likelier, 0.0))


def same_spans(
    corridor: Corridor, narrow: Sequence[Line], wide: Sequence[Line]
) -> Iterator[tuple[list[Line], list[Line], NDArray[np.int64]]]:
    """Groups of spans at both tolerances that have most of the points of one in common.

    With them come the points of the wide ones that are on narrow ones of other groups.
    """
    points = [[on_any(corridor, span.wires) for span in spans] for spans in (narrow, wide)]
    of_span = np.full(len(corridor.air.xyz), -1)
    for k, own in enumerate(points[0]):
        of_span[own] = k
    count = len(narrow) + len(wide)
    link = np.zeros((count, count), bool)
    for j, own in enumerate(points[1]):
        shared = np.bincount(of_span[own] + 1, minlength=len(narrow) + 1)[1:]
        least = np.minimum([len(one) for one in points[0]], len(own))
        link[len(narrow) + j, : len(narrow)] = 2 * shared > least
    _, label = connected_components(coo_array(link), directed=False)
    of_group = np.append(label[: len(narrow)], -1)[of_span]
    for number in range(label.max() + 1 if count else 0):
        here = np.flatnonzero(label == number).tolist()
        other = [k - len(narrow) for k in here if k >= len(narrow)]
        own = np.concatenate([np.zeros(0, np.int64), *(points[1][k] for k in other)])
        elsewhere = own[(of_group[own] >= 0) & (of_group[own] != number)]
        yield (
            [narrow[k] for k in here if k < len(narrow)],
            [wide[k] for k in other],
            distinct(elsewhere),
        )


def rest_of(corridor: Corridor, line: Line, taken: NDArray[np.bool_]) -> list[Wire]:
    """The wires of a line without those of which most points are taken."""
    own = [(wire, taken[on_wire(corridor, wire)[0]]) for wire in line.wires]
    return [wire for wire, on_others in own if 2 * np.count_nonzero(on_others) <= len(on_others)]


def together(corridor: Corridor, lines: Sequence[Line]) -> tuple[list[Wire], list[Support]]:
    """The wires and supports of several lines, numbered anew.

    Two lines may each have found another leg of a support, so that it is known to be one only when
    each was moved to the middle of its body.
    """
    wires, supports = without_doubled(*numbered_anew(lines))
    wires, supports = shared(wires, all_centred(corridor, wires, supports))
    wires = [w for w in wires if not (is_arm(w, supports) or is_guy(w, supports))]
    wires, supports = along_the_line(*without_bars(wires, supports))
    wires = [to_supports(wire, supports) for wire in wires]
    wires, strip = parted(corridor, wires, [strip_of(corridor, wire) for wire in wires])
    return numbered(wires, supports, in_two_positions(wires, strip), strip), supports


def numbered_anew(lines: Sequence[Line]) -> tuple[list[Wire], list[Support]]:
    """The wires and supports of several lines; supports at one place are one."""
    wires: list[Wire] = []
    supports: list[Support] = []
    for line in lines:
        new = {name: in_a_row(line.wires, wires, name) for name in NUMBERS}
        for wire in line.wires:
            span, bundle, number = (new[name][getattr(wire, name)] for name in NUMBERS)
            low, high = (n + len(supports) if n >= 0 else -1 for n in wire.supports)
            wires.append(replace(wire, supports=(low, high), span=span, bundle=bundle, wire=number))
        supports += line.supports
    return shared(wires, supports)


def to_data_ends(
    corridor: Corridor, wires: Sequence[Wire], supports: Sequence[Support]
) -> tuple[list[Wire], list[Support]]:
    """The wires and supports, with what goes on behind the last of these to where the data end."""
    return along_the_line(with_ends(corridor, wires, supports), supports)


def along_the_line(
    wires: Sequence[Wire], supports: Sequence[Support]
) -> tuple[list[Wire], list[Support]]:
    """Spans and supports in the order in which one meets them who walks along a line."""
    if not wires:
        return [], []
    row = {span: len(supports) + k for k, span in enumerate(sorted({w.span for w in wires}))}
    place = np.zeros((len(supports) + len(row), 2))
    for k, support in enumerate(supports):
        place[k] = support.x, support.y
    for wire in wires:
        place[row[wire.span]] = wire.curve.ends[:, :2].mean(axis=0)
    pairs = {(row[wire.span], n) for wire in wires for n in wire.supports if n >= 0}
    met = walked(place, sorted(pairs), [row[wire.span] for wire in wires])
    held = [n for n in met if n < len(supports)]
    new = {-1: -1} | {n: k for k, n in enumerate(held)}
    span = {n: k for k, n in enumerate((n for n in met if n >= len(supports)), 1)}
    renamed = [
        replace(
            wire,
            span=span[row[wire.span]],
            supports=(new[wire.supports[0]], new[wire.supports[1]]),
        )
        for wire in wires
    ]
    return sorted(renamed, key=lambda wire: wire.span), [supports[n] for n in held]


def walked(
    place: NDArray[np.float64], pairs: Sequence[tuple[int, int]], begin: Sequence[int]
) -> list[int]:
    """Numbers of places, joined by pairs, in the order of a walk along each line of them.

    Each line is walked from the westernmost of its ends; lines follow in the order of `begin`.
    """
    ends = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), ends.T), shape=(len(place), len(place))).tocsr()
    _, line = connected_components(graph, directed=False)
    branches = np.bincount(ends.ravel(), minlength=len(place))
    met: list[int] = []
    for number in dict.fromkeys(line[list(begin)].tolist()):
        own = np.flatnonzero(line == number)
        own = own[branches[own] == branches[own].min()]
        west = own[np.lexsort((place[own, 1], place[own, 0]))[0]]
        met += depth_first_order(graph, west, directed=False)[0].tolist()
    return met


def in_a_row(wires: Sequence[Wire], before: Sequence[Wire], name: str) -> dict[int, int]:
    """New numbers for those of wires, without gaps, behind the numbers of others."""
    first = max((getattr(wire, name) for wire in before), default=0) + 1
    old = sorted({getattr(wire, name) for wire in wires})
    return {number: k for k, number in enumerate(old, first)}


def shared(wires: Sequence[Wire], supports: Sequence[Support]) -> tuple[list[Wire], list[Support]]:
    """The wires, and the supports, of which those at one place are one that several lines share."""
    if not supports:
        return list(wires), []
    place = np.array([(support.x, support.y) for support in supports])
    near = np.hypot(*(place[:, None] - place[None]).T) < SETTINGS.network.join_aside
    count, label = connected_components(coo_array(near), directed=False)
    found = []
    for number in range(count):
        own = [supports[k] for k in np.flatnonzero(label == number).tolist()]
        widest = max(own, key=lambda support: support.reach[1] - support.reach[0])
        low, high = min(support.low for support in own), max(support.high for support in own)
        found.append(replace(widest, low=low, high=high))
    new = np.append(label, -1)  # of none
    held = [(int(new[low]), int(new[high])) for low, high in (wire.supports for wire in wires)]
    renamed = [replace(wire, supports=ends) for wire, ends in zip(wires, held, strict=True)]
    return renamed, found
