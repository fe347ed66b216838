"""Wires close above each other, found all at once by the shape in which they hang.

Where wires sag by more than they are apart, and points are few, one that is followed changes over
to the next, and where its supports are cannot be told. But all of a stack hang alike, at constant
distances. These show first: pairs of points next to each other along the line differ in height by
one distance, two, and so on. Then the stack is one shape, an arc from each support to the next. Of
all ways to hang it the one is taken for which most points are likely on its wires, at a price for
each span, by dynamic programming (Bellman 1961): every place may be a support, at any height.

References
----------
Bellman, R. (1961). On the approximation of curves by line segments using dynamic programming.
CACM 4(6), 284.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.corridor._curves import stacks_kernels as kernels
from algorithms.corridor._curves.arcs import bends_tried, settled_at
from algorithms.corridor._curves.catenary import fit
from algorithms.corridor._curves.network import Corridor, Piece
from algorithms.corridor._curves.tracks import Alignment, abreast, alignments_among, beside
from algorithms.corridor._settings import SETTINGS
from toolbox.context import Context

COARSE, FINE = 2.0, 1.0  # metres between the places of supports that are tried
FINER = 1.1  # ratio of curvatures that are tried near the best of the coarse ones
SLOTS = 2  # heights for which a likelihood is kept, in one scatter

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Span = tuple[float, float, float, float]  # chainage and height of both ends, metres


@dataclass(frozen=True)
class Stack:
    """The points around the wires of a stack, and how far these are apart.

    Attributes
    ----------
    axis, start : an axis along the stack, and the chainage on it at which the stack begins
    points : indices of n points that may be wire, along the line
    u, z : their chainages from the beginning of the stack, and heights, metres
    middle : height in the middle of the points at each metre
    scatter : of points about their wire, metres
    spacing, count : distance between two wires, metres, and number of wires
    """

    axis: Alignment
    start: float
    points: Ints
    u: Floats
    z: Floats
    middle: Floats
    scatter: float
    spacing: float
    count: int

    @property
    def levels(self) -> Floats:
        """Heights of the wires above the middle one, the lowest first, metres."""
        return np.asarray(self.spacing * (np.arange(self.count) - (self.count - 1) / 2))


def stacks_among(
    corridor: Corridor, pieces: Sequence[Piece], ctx: Context
) -> tuple[list[Piece], list[Alignment]]:
    """Arcs of the wires of all stacks between their supports, and alignments with these cuts.

    Parameters
    ----------
    pieces : of some of the wires, which tell in which vertical planes they are looked for
    """
    arcs: list[Piece] = []
    cut: list[Alignment] = []
    known = np.zeros(len(corridor.wires.xyz), bool)
    for alignment in alignments_among(corridor, pieces):
        tracks = [alignment.track(corridor.wires.xyz[piece.points]) for piece in alignment.pieces]
        for own in planes(tracks, corridor.own_radius):
            if known[np.concatenate([alignment.pieces[k].points for k in own])].mean() > 0.5:
                continue
            stack = stack_in(corridor, alignment, np.vstack([tracks[k] for k in own]))
            found = hung(corridor, stack, ctx) if stack is not None else None
            if found is not None:
                line, bend = found
                for piece in line.pieces:
                    arcs += cut_up(corridor, line, piece, bend, len(cut))
                    known[piece.points] = True
                cut.append(line)
    return arcs, cut


def planes(tracks: Sequence[Floats], radius: float) -> Iterator[list[int]]:
    """Indices of the tracks in each vertical plane in which some are above each other."""
    link = np.zeros((len(tracks), len(tracks)), bool)
    for i, j in itertools.combinations(range(len(tracks)), 2):
        link[i, j] = are_in_one_plane(tracks[i], tracks[j], radius)
    _, label = connected_components(coo_array(link), directed=False)
    for number in range(label.max() + 1 if len(tracks) else 0):
        own = np.flatnonzero(label == number).tolist()
        if any(abreast(tracks[i], tracks[j]) for i, j in itertools.combinations(own, 2)):
            yield own


def are_in_one_plane(one: Floats, other: Floats, radius: float) -> bool:
    """Whether two tracks have one offset where they are beside or near each other."""
    begin = max(one[:, 0].min(), other[:, 0].min())
    end = min(one[:, 0].max(), other[:, 0].max())
    if begin - end > SETTINGS.arcs.shortest_span:
        return False
    middle = 0.5 * (begin + end)
    return bool(abs(beside(one, middle)[0] - beside(other, middle)[0]) < radius)


def stack_in(corridor: Corridor, alignment: Alignment, track: Floats) -> Stack | None:
    """The stack in the vertical plane of tracks; None if distances of wires do not show.

    Parameters
    ----------
    track : array of shape (n, 3), chainage, offset and height of the points of the tracks, metres
    """
    reach, beyond = SETTINGS.arcs.shortest_span / 2, SETTINGS.network.longest_missing
    start = track[:, 0].min() - beyond
    at = np.arange(0.0, track[:, 0].max() + beyond - start + 1.0)
    aside, middle = (running(track[:, 0] - start, track[:, k], at, reach) for k in (1, 2))
    spots = alignment.places(start + at) + aside[:, None] * (-alignment.ey, alignment.ex)
    near = corridor.wires.within(spots, reach)
    u, v, z = alignment.track(corridor.wires.xyz[near]).T
    u -= start
    inside = (u > 0) & (u < at[-1]) & ~corridor.refused[near]
    inside &= np.abs(v - np.interp(u, at, aside)) < corridor.own_radius
    inside &= np.abs(z - np.interp(u, at, middle)) < tall_of_stack() / 2
    order = np.flatnonzero(inside)[np.argsort(u[inside], kind="stable")]
    points, u, z = near[order], u[order], z[order]
    if not len(points):
        return None
    middle = running(u, z, at, reach)
    slope = slopes(u, z, at, reach)
    scatter = corridor.tolerance / 2
    apart = distances_of_pairs(u, z, np.interp(u, at, slope))
    spacing, count = spacing_of(apart, scatter, SETTINGS.stacks.closest)
    if count < 2:
        return None
    return Stack(alignment, start, points, u, z, middle, scatter, spacing, count)


def running(u: Floats, values: Floats, at: Floats, reach: float) -> Floats:
    """Medians of values at u within a reach of each place, interpolated where there are none."""
    order = np.argsort(u, kind="stable")
    u, values = u[order], values[order]
    low, high = np.searchsorted(u, at - reach), np.searchsorted(u, at + reach)
    known = np.flatnonzero(high > low)
    medians = [np.median(values[low[k] : high[k]]) for k in known.tolist()]
    return np.asarray(np.interp(at, at[known], medians))


def slopes(u: Floats, z: Floats, at: Floats, reach: float) -> Floats:
    """Slopes of the lines fitted to heights within a reach of each place; 0 of fewer than three."""
    low, high = np.searchsorted(u, at - reach), np.searchsorted(u, at + reach)
    found = np.zeros(len(at))
    for k in np.flatnonzero(high - low > 2).tolist():
        off = u[low[k] : high[k]] - u[low[k] : high[k]].mean()
        found[k] = off @ z[low[k] : high[k]] / max(off @ off, 1e-9)
    return found


def distances_of_pairs(u: Floats, z: Floats, slope: Floats) -> Floats:
    """Differences in height of points next to each other along the line, less its slope there.

    Each point counts with the next two alone, or the many of a pole would outweigh the wires.
    """
    found = []
    for k in (1, 2):
        step = u[k:] - u[:-k]
        near = step < SETTINGS.stacks.pair
        found.append(np.abs(z[k:] - z[:-k] - slope[k:] * step)[near])
    return np.concatenate(found)


def spacing_of(apart: Floats, scatter: float, least: float) -> tuple[float, int]:
    """Distance between two wires above each other, and their number; 1 if there surely are no two.

    Of all k^2 ways in which two points lie on k wires, in 2 (k - m) these are m wires apart. That
    must be so much likelier than one wire, or than points anywhere within any height, that chance
    has one as good in a hundredth of all tries.

    Parameters
    ----------
    apart : differences in height of n pairs of points, metres
    scatter : of points about their wire, metres
    least : distance between two wires that is tried, metres
    """
    most = SETTINGS.curves.clutter_radius
    tall = tall_of_stack()
    tried = [
        (spacing, count)
        for spacing in np.arange(least, most, scatter / 5).tolist()
        for count in range(2, 2 + int(2 * most / spacing))
    ]
    told = [told_by(apart, spacing, count, scatter) for spacing, count in tried]
    heights = np.arange(least, tall, least)[:, None]
    spread = 2 * np.maximum(heights - apart, 0.0) / heights**2
    other = max(told_by(apart, 0.0, 1, scatter), float(gain(spread, tall).sum(axis=1).max()))
    best = int(np.argmax(told))
    enough = math.log(len(tried) / SETTINGS.sparse.false_alarms)
    return tried[best] if told[best] > other + enough else (0.0, 1)


def told_by(apart: Floats, spacing: float, count: int, scatter: float) -> float:
    """Logarithm of how much likelier pairs of points are on wires of a stack than anywhere."""
    steps = np.arange(count)
    share = 2 * (count - steps) / count**2  # of differences, which have no sign
    likely = normal(apart[:, None] - steps * spacing, math.sqrt(2) * scatter) @ share
    return float(gain(likely, tall_of_stack()).sum())


def tall_of_stack() -> float:
    """Height in which the points of a stack are looked for, metres."""
    return 4 * SETTINGS.curves.clutter_radius


def normal(off: Floats, scatter: float) -> Floats:
    """Density of normal errors, 1 / metre."""
    return np.asarray(np.exp(-0.5 * (off / scatter) ** 2) / (scatter * math.sqrt(2 * math.pi)))


def gain(likely: Floats, tall: float) -> Floats:
    """Logarithm of how much likelier something is on wires, some of it astray, than anywhere.

    Parameters
    ----------
    likely : densities on the wires, 1 / metre
    tall : height anywhere in which it might be as well, metres
    """
    astray = SETTINGS.stacks.astray
    return np.asarray(np.log(astray + (1 - astray) * tall * likely))


def hung(corridor: Corridor, stack: Stack, ctx: Context) -> tuple[Alignment, float] | None:
    """The wires of a stack with the chainages at which they are held, and their curvature.

    None if none hang there, or need not be looked for together: wires that sag by less than they
    are apart, such as those of a bundle, whose spans are longer than are tried.
    """
    bend = best_bend(stack, bends_tried(), ctx)
    stack = grown(corridor, stack, bend)
    bend, spans = best_spans(stack, bend, ctx)
    if bend / 8 * np.median([(b - a) ** 2 for a, _, b, _ in spans] or [0.0]) < stack.spacing:
        return None
    pieces = list(wires_on(corridor, stack, bend, spans))
    if not pieces:
        return None
    line = Alignment.of(pieces)
    held = np.unique([place for a, _, b, _ in spans for place in (a, b)])
    places = stack.axis.places(held + stack.start)
    cuts, sigmas = settled_at(corridor, line, np.sort(line.along(places)[0]), bend)
    return replace(line, cuts=cuts, sigmas=sigmas), bend


def grown(corridor: Corridor, stack: Stack, bend: float) -> Stack:
    """The stack as far as spans of it follow each other.

    Where no track is known for a while it would end in a span, and so would the one behind.
    """
    while True:
        spans = spans_of(stack, bend, COARSE)[1]
        points = stack.points[levels_on(corridor, stack, bend, spans) >= 0]
        track = stack.axis.track(corridor.wires.xyz[points])
        wider = stack_in(corridor, stack.axis, track) if len(track) else None
        if wider is None or len(wider.middle) < len(stack.middle) + SETTINGS.arcs.shortest_span:
            return stack
        stack = wider


def best_spans(stack: Stack, about: float, ctx: Context) -> tuple[float, list[Span]]:
    """The curvature about one, 1 / metre, by which most points are likely on wires, and spans."""
    bend = best_bend(stack, [about * FINER**k for k in (-2, -1, 0, 1, 2)], ctx)
    return bend, spans_of(stack, bend, FINE)[1]


def best_bend(stack: Stack, bends: Sequence[float], ctx: Context) -> float:
    """That of some curvatures, 1 / metre, by which most points are likely on wires."""

    def told(bend: float) -> float:
        ctx.progress(0.0)  # which ends it if it is to be cancelled
        return spans_of(stack, bend, COARSE)[0]

    return max(bends, key=told)


def spans_of(stack: Stack, bend: float, step: float) -> tuple[float, list[Span]]:
    """The spans of one curvature by which most points are likely on wires, and how likely that is.

    A span costs the logarithm of how many begin at one place: one of them may fit by chance.
    """
    tall, slot = tall_of_stack(), stack.scatter / SLOTS
    below = slot * np.arange(-round(tall / slot), round(tall / slot) + 1)
    likely = normal(below[:, None] - stack.levels, stack.scatter).mean(axis=1)
    places = np.arange(0.0, len(stack.middle) - 1.0, step)
    middle = np.interp(places, np.arange(len(stack.middle)), stack.middle)
    high = SETTINGS.curves.clutter_radius
    lifts = np.arange(-high, high, stack.spacing / 4)
    least = round(SETTINGS.arcs.shortest_span / step)
    most = round(SETTINGS.network.longest_missing / step)
    total = np.empty((len(places), len(lifts)))
    before = np.empty(total.shape, np.int64)
    kernels.hang(
        stack.u,
        stack.z,
        np.searchsorted(stack.u, places),
        middle,
        lifts,
        step,
        gain(likely, tall),
        slot,
        bend,
        math.log((most - least + 1) * len(lifts)),
        least,
        most,
        total,
        before,
    )
    found: list[Span] = []
    b, up = most_of(total)
    while before[b, up] >= 0:
        a, low = divmod(int(before[b, up]), len(lifts))
        ends = places[a], middle[a] + lifts[low], places[b], middle[b] + lifts[up]
        found.append((float(ends[0]), float(ends[1]), float(ends[2]), float(ends[3])))
        b, up = a, low
        if before[b, up] < 0 and b and total[:b].max() > 0:  # begun behind a stretch left out
            b, up = most_of(total[:b])
    return float(total.max()), found[::-1]


def most_of(total: Floats) -> tuple[int, int]:
    """Row and column of the largest value, the first if several are."""
    row, column = divmod(int(np.argmax(total)), total.shape[1])
    return row, column


def wires_on(
    corridor: Corridor, stack: Stack, bend: float, spans: Sequence[Span]
) -> Iterator[Piece]:
    """A piece along all spans for each wire of a stack, of the points that are on it."""
    level = levels_on(corridor, stack, bend, spans)
    for k in range(stack.count):
        points = np.sort(stack.points[level == k])
        curve = fit(corridor.wires.xyz[points], spread=math.inf)  # of many spans: where it leads
        if curve is not None:
            yield Piece(points, curve)


def levels_on(corridor: Corridor, stack: Stack, bend: float, spans: Sequence[Span]) -> Ints:
    """On which wire of a stack each of its points is, from the lowest; -1 for none."""
    level = np.full(len(stack.u), -1)
    for a, z_a, b, z_b in spans:
        own = np.flatnonzero((stack.u >= a) & (stack.u < b))
        x = stack.u[own] - a
        shape = z_a + (z_b - z_a) * x / (b - a) - 0.5 * bend * x * (b - a - x)
        away = np.abs((stack.z[own] - shape)[:, None] - stack.levels)
        on_it = away.min(axis=1) < min(corridor.own_radius, stack.spacing / 2)
        level[own] = np.where(on_it, away.argmin(axis=1), -1)
    return level


def cut_up(
    corridor: Corridor, line: Alignment, piece: Piece, bend: float, number: int
) -> Iterator[Piece]:
    """The arcs of one wire of a stack, which surely is one, few as its points may be."""
    arc = np.searchsorted(line.cuts, line.along(corridor.wires.xyz[piece.points])[0])
    for k in np.unique(arc).tolist():
        points = piece.points[arc == k]
        curve = fit(corridor.wires.xyz[points], spread=corridor.own_radius, curvature=bend)
        if curve is not None and curve.length > SETTINGS.network.telling_length:
            corridor.proven[corridor.wires.order[points]] = True
            yield replace(piece, points=points, curve=curve, arc=(number, k))
