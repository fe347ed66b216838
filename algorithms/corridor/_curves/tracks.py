"""Tracks from curves: curves are grouped into lines, and those of one wire are joined."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.corridor._curves.catenary import fit
from algorithms.corridor._curves.network import (
    Corridor,
    Piece,
)
from algorithms.corridor._settings import SETTINGS

TRACK_BIN, MOST_TRACK_BINS = 1.0, 1000  # metres of an alignment looked at as one, and their number

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Alignment:
    """Curves of wires side by side, and the straight axis along them.

    Attributes
    ----------
    pieces : the curves
    x, y, ex, ey : origin and unit vector of the axis
    step, steps : length of a bin along the axis, metres, and number of bins
    cuts : chainages at which the wires are held, metres along the axis
    sigmas : standard deviations of these, metres
    whole : number of the alignment from which it was cut apart, as one of several lines abreast
    """

    pieces: Sequence[Piece]
    x: float
    y: float
    ex: float
    ey: float
    step: float
    steps: int
    cuts: Floats
    sigmas: Floats
    whole: int = -1

    @classmethod
    def of(cls, pieces: Sequence[Piece]) -> Alignment:
        ends = np.vstack([piece.ends for piece in pieces])
        first = max(pieces, key=lambda piece: piece.curve.length).curve
        ways = np.array([[p.curve.ex, p.curve.ey] for p in pieces])
        ways *= np.sign(ways @ (first.ex, first.ey))[:, None]
        ex, ey = (ways * [[p.curve.length] for p in pieces]).sum(axis=0)
        ex, ey = ex / math.hypot(ex, ey), ey / math.hypot(ex, ey)
        u = ends[:, 0] * ex + ends[:, 1] * ey
        v = ends[:, 1] * ex - ends[:, 0] * ey
        low, middle = u.min() - TRACK_BIN, float(np.median(v))
        length = np.ptp(u) + 2 * TRACK_BIN
        step = max(TRACK_BIN, length / MOST_TRACK_BINS)
        steps = min(math.ceil(length / TRACK_BIN), MOST_TRACK_BINS)
        x, y = low * ex - middle * ey, low * ey + middle * ex
        return cls(pieces, x, y, ex, ey, step, steps, np.zeros(0), np.zeros(0))

    def places(self, u: Floats) -> Floats:
        """Positions on the axis in plan at chainages u, array of shape (n, 2)."""
        return np.column_stack([self.x + u * self.ex, self.y + u * self.ey])

    def along(self, xyz: Floats) -> tuple[Floats, Floats]:
        """Distance along and to the left of the axis."""
        dx, dy = xyz[:, 0] - self.x, xyz[:, 1] - self.y
        return dx * self.ex + dy * self.ey, dy * self.ex - dx * self.ey

    def track(self, xyz: Floats) -> Floats:
        """Chainage, offset to the left of the axis, and height of points, array of shape (n, 3)."""
        return np.column_stack([*self.along(xyz), xyz[:, 2]])

    def tracks(self, corridor: Corridor) -> list[Floats]:
        """The tracks of all its curves."""
        return [self.track(corridor.wires.xyz[piece.points]) for piece in self.pieces]


def alignments_among(corridor: Corridor, curves: Sequence[Piece]) -> Iterator[Alignment]:
    """Alignments from curves, each with one track per wire."""
    tracks = [track for curve in curves for track in tracks_of(corridor, curve)]
    for pieces in alignments_of(tracks):
        alignment = Alignment.of(pieces)
        yield replace(alignment, pieces=chained(corridor, alignment))


def alignments_of(pieces: Sequence[Piece]) -> Iterator[list[Piece]]:
    """Groups of curves that lie side by side or continue each other."""
    ends = np.array([piece.ends for piece in pieces])
    way = np.array([[p.curve.ex, p.curve.ey] for p in pieces])
    length = np.array([p.curve.length for p in pieces])
    link = np.zeros((len(pieces), len(pieces)), bool)
    for i in range(len(pieces)):
        step = ends[:, :, :2] - ends[i, 0, :2]
        u = np.sort(step @ way[i], axis=1)
        gap = np.maximum(u[:, 0] - length[i], -u[:, 1])
        low, high = np.maximum(u[:, 0], 0.0), np.minimum(u[:, 1], length[i])
        middle = 0.5 * (low + high)
        begin, end = (step @ way[i]).T
        share = (middle - begin) / np.where(end == begin, 1.0, end - begin)
        place = ends[:, 0] + share[:, None] * (ends[:, 1] - ends[:, 0])
        own = ends[i, 0] + (middle / length[i])[:, None] * (ends[i, 1] - ends[i, 0])
        away = place - own
        v = away[:, 1] * way[i, 0] - away[:, 0] * way[i, 1]
        link[i] = np.abs(way @ way[i]) > SETTINGS.network.cos_parallel
        link[i] &= (
            (gap < SETTINGS.network.longest_missing)
            & (np.abs(v) < SETTINGS.network.line_width)
            & (np.abs(away[:, 2]) < SETTINGS.network.line_width)
        )
    _, label = connected_components(coo_array(link), directed=False)
    for number in range(label.max() + 1 if len(pieces) else 0):
        yield [pieces[i] for i in np.flatnonzero(label == number).tolist()]


def tracks_of(corridor: Corridor, piece: Piece) -> Iterator[Piece]:
    """Tracks from a curve and the points near it, split where it passes to another wire.

    A curve that is followed across supports leaves the wire there by as much as the wire kinks.
    Where it changes over, the heights jump.
    """
    near, _ = corridor.wires.around(piece.curve, 2.4 * corridor.tolerance)
    _, aside, _ = piece.curve.residuals(corridor.wires.xyz[near])
    points = np.union1d(piece.points, near[np.abs(aside) < corridor.tolerance])
    u, _, z = piece.curve.residuals(corridor.wires.xyz[points])
    order = np.argsort(u, kind="stable")
    points, u, z = points[order], u[order], z[order]
    edges, jump = [0], corridor.own_radius
    for k in (
        np.flatnonzero(
            (np.abs(np.diff(z)) > jump / 2) | (np.diff(u) > SETTINGS.points.company_side)
        )
        + 1
    ).tolist():
        before = np.arange(max(k - SETTINGS.tracks.end_points, edges[-1]), k)
        after = np.arange(k, min(k + SETTINGS.tracks.end_points, len(u)))
        before, after = (
            before[u[before] > u[k - 1] - SETTINGS.lanes.straight_gap],
            after[u[after] < u[k] + SETTINGS.lanes.straight_gap],
        )
        if min(len(before), len(after)) < 3:
            continue
        middle = 0.5 * (u[k - 1] + u[k])
        ends = [at_zero(u[i] - middle, z[i]) for i in (before, after)]
        if abs(ends[1] - ends[0]) > jump:
            edges.append(k)
    if len(edges) == 1:
        yield replace(piece, points=np.sort(points))
        return
    for low, high in itertools.pairwise([*edges, len(u)]):
        mine = np.sort(points[low:high])
        curve = fit(corridor.wires.xyz[mine], spread=2.0)
        if curve is not None:
            yield replace(piece, points=mine, curve=curve)


def chained(corridor: Corridor, alignment: Alignment) -> list[Piece]:
    """Tracks in which those of one wire are joined, whether they overlap or follow each other.

    Of a line of a single wire each track is one of it, also behind a long gap.
    """
    chains: list[tuple[Piece, Floats]] = []  # with chainages, offsets and heights
    tracks = list(zip(alignment.pieces, alignment.tracks(corridor), strict=True))
    single = not any(
        abreast(one, other) for (_, one), (_, other) in itertools.combinations(tracks, 2)
    )
    for piece, own in sorted(tracks, key=lambda track: float(track[1][:, 0].min())):
        best, least = -1, math.inf
        for k, (_, other) in enumerate(chains):
            end, begin = other[:, 0].max(), own[:, 0].min()
            gap = max(begin - end, 0.0)
            if gap > (SETTINGS.network.longest_missing if single else likely_gap(other, own)):
                continue
            middle = 0.5 * (begin + min(end, own[:, 0].max()))
            aside, up = np.abs(beside(other, middle) - beside(own, middle))
            near = (
                SETTINGS.tracks.chain_aside
                if begin > end - SETTINGS.lanes.straight_gap
                else SETTINGS.tracks.chain_overlap
            )
            near *= corridor.tolerance
            if single and gap and meet_below(other, own, near):
                up = 0.0
            if aside < near and up < near + SETTINGS.tracks.chain_rise * gap and aside + up < least:
                best, least = k, aside + up
        if best < 0:
            chains.append((piece, own))
            continue
        one, other = chains[best]
        points = np.union1d(one.points, piece.points)
        whole = replace(one, points=points, sure=one.sure or piece.sure)
        chains[best] = whole, np.vstack([other, own])
    return [piece for piece, _ in chains]


def meet_below(one: Floats, other: Floats, near: float) -> bool:
    """Whether a track and one behind it meet as wires at a support, from which both hang.

    Drawn on over the gap between them, each comes to lie above the other.

    Parameters
    ----------
    near : metres by which they may miss each other
    """
    gap = np.array([one[:, 0].max(), other[:, 0].min()])
    over = drawn_on(one, gap) - drawn_on(other, gap)
    return bool(over[0] < near and over[1] > -near)


def drawn_on(track: Floats, u: Floats) -> Floats:
    """Heights at chainages beyond an end of a track, of the parabola through what is near it."""
    away = np.abs(track[:, 0] - u.mean())
    own = track[away < away.min() + SETTINGS.network.longest_missing]
    order = min(2, len(np.unique(own[:, 0])) - 1)
    return np.asarray(np.polynomial.Polynomial.fit(own[:, 0], own[:, 2], order)(u))


def abreast(one: Floats, other: Floats) -> bool:
    """Whether two tracks overlap in chainage, and so belong to different wires."""
    overlap = min(one[:, 0].max(), other[:, 0].max()) - max(one[:, 0].min(), other[:, 0].min())
    return bool(overlap > SETTINGS.network.telling_length)


def likely_gap(one: Floats, other: Floats) -> float:
    """Metres without points that may be by chance on a wire with as many points as two tracks."""
    spacing = (np.ptp(one[:, 0]) + np.ptp(other[:, 0])) / (len(one) + len(other))
    by_chance = -math.log(SETTINGS.sparse.false_alarms) * float(spacing)
    return min(max(by_chance, SETTINGS.tracks.chain_gap), SETTINGS.network.longest_missing)


def beside(track: Floats, u: float) -> Floats:
    """Offset and height of a track at a chainage, from the points nearest to it."""
    near = track[np.argsort(np.abs(track[:, 0] - u), kind="stable")[: SETTINGS.tracks.end_points]]
    near = near[np.abs(near[:, 0] - u) < np.abs(near[0, 0] - u) + SETTINGS.lanes.straight_gap]
    if len(near) < 3:
        return np.asarray(near[:, 1:].mean(axis=0))
    return at_zero(near[:, 0] - u, near[:, 1:])


def at_zero(u: Floats, values: Floats) -> Floats:
    """Value at u = 0 of the line fitted to values of shape (n,) or (n, k) at u."""
    off = u - u.mean()
    slope = off @ values / max(off @ off, 1e-12)
    return np.asarray(values.mean(axis=0) - slope * u.mean())
