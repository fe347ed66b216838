"""Tracks of sparse wires, which are followed all at once where single ones have too few points.

Between two supports the wires of a line run beside each other at about constant distances, and go
on so behind the next. Moved by these distances onto one of them, the points of all make one wire,
as many times denser, which is followed as any other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._curves.network import Corridor, Piece, curves_of
from algorithms.corridor._curves.sparse import sparse_wires
from algorithms.corridor._curves.trace import Airborne, trace_all, uncrowded
from algorithms.corridor._curves.tracks import Alignment, abreast, chained
from algorithms.corridor._settings import SETTINGS
from toolbox.context import Context

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Lanes:
    """Lanes: the parallel wires of an alignment, with their distances from the first.

    Attributes
    ----------
    aside, up : arrays of shape (k,), of each lane from the first
    own : for each lane, which of the pieces of the alignment are its tracks
    u, v : where the first lane goes
    """

    aside: Floats
    up: Floats
    own: Sequence[Sequence[int]]
    u: Floats
    v: Floats

    @classmethod
    def of(cls, tracks: Sequence[Floats]) -> Lanes | None:
        """The lanes of tracks; None unless at least two of these are seen beside each other."""
        place = placed(tracks)
        spots: list[Floats] = []
        own: list[list[int]] = []
        for j, spot in place.items():
            for k, other in enumerate(spots):
                near = np.abs(spot - other).max() <= SETTINGS.lanes.same
                if near and not any(abreast(tracks[i], tracks[j]) for i in own[k]):
                    own[k].append(j)
                    break
            else:
                spots.append(spot)
                own.append([j])
        if len(spots) < 2:
            return None
        known = np.vstack([tracks[j][:, :2] - [0.0, spot[0]] for j, spot in place.items()])
        pieces = np.array_split(
            in_order(known), max(2, int(np.ptp(known[:, 0]) / SETTINGS.lanes.offset_step))
        )
        u, v = np.array([np.median(piece, axis=0) for piece in pieces]).T
        aside, up = np.array(spots).T
        return cls(aside, up, own, u, v)

    def as_one(self, tracks: Sequence[Floats]) -> list[Floats]:
        """The tracks of which these are the lanes, those of lanes as one, moved to the first."""
        places = zip(self.aside, self.up, self.own, strict=True)
        moved = [tracks[j] - [0.0, aside, up] for aside, up, own in places for j in own]
        grouped = {j for own in self.own for j in own}
        return [np.vstack(moved), *(one for j, one in enumerate(tracks) if j not in grouped)]

    def middle(self, u: Floats) -> Floats:
        """Offset of the first lane from the axis at chainages, extrapolated beyond its ends."""
        offset = np.interp(u, self.u, self.v)
        for end, way in ((0, -1), (-1, 1)):
            beyond = (u - self.u[end]) * way > 0
            leg = np.abs(self.u - self.u[end]) < SETTINGS.network.longest_missing
            slope = np.polyfit(self.u[leg], self.v[leg], 1)[0] if np.count_nonzero(leg) > 1 else 0
            offset[beyond] = self.v[end] + slope * (u[beyond] - self.u[end])
        return offset


def followed_together(
    corridor: Corridor, alignment: Alignment, max_gap: float, ctx: Context
) -> Alignment:
    """The alignment with tracks that were found by following all its wires at once."""
    for _ in range(SETTINGS.lanes.rounds):
        lanes = lanes_of(corridor, alignment.tracks(corridor))
        if lanes is None:
            break
        alignment = Alignment.of(pieces_in(corridor, alignment, lanes, max_gap, ctx))
    return replace(alignment, pieces=chained(corridor, alignment))


def lanes_of(corridor: Corridor, tracks: Sequence[Floats]) -> Lanes | None:
    """The lanes of tracks with few points; None if these have more, or change over in stacks."""
    if corridor.tolerance <= SETTINGS.sparse.stack_tolerance:
        return None
    if points_per_metre(tracks) >= SETTINGS.lanes.sparse:
        return None
    return Lanes.of([in_order(track) for track in tracks])


def fit_anything(tracks: Sequence[Floats]) -> bool:
    """Whether tracks have fewer than three points on the shortest span, as many as arcs need."""
    return points_per_metre(tracks) * SETTINGS.arcs.shortest_span < 3


def points_per_metre(tracks: Sequence[Floats]) -> float:
    """Points of tracks along their length; infinite without any length."""
    length = sum(float(np.ptp(track[:, 0])) for track in tracks)
    return sum(map(len, tracks)) / length if length else math.inf


def in_order(track: Floats) -> Floats:
    """A track in the order of its chainages."""
    return np.asarray(track[np.argsort(track[:, 0], kind="stable")])


def placed(tracks: Sequence[Floats]) -> dict[int, Floats]:
    """Position of each track relative to the first, of the largest group linked side by side."""
    best: dict[int, Floats] = {}
    left = set(range(len(tracks)))
    while left:
        first = min(left)
        place = {first: np.zeros(2)}
        queue = [first]
        while queue:
            k = queue.pop(0)
            for j in sorted(left - place.keys()):
                step = beside(tracks[k], tracks[j])
                if step is not None:
                    place[j] = place[k] + step
                    queue.append(j)
        left -= place.keys()
        best = max(best, place, key=lambda some: sum(len(tracks[k]) for k in some))
    return best


def beside(one: Floats, other: Floats) -> Floats | None:
    """Offset and height of one track relative to another; None if not known or not constant."""
    after = np.searchsorted(one[:, 0], other[:, 0])
    inner = (after > 0) & (after < len(one))
    after = after[inner]
    own = other[inner][one[after, 0] - one[after - 1, 0] < SETTINGS.lanes.straight_gap]
    if len(own) < 3 or np.ptp(own[:, 0]) < SETTINGS.network.telling_length:
        return None
    step = np.column_stack([own[:, k] - np.interp(own[:, 0], one[:, 0], one[:, k]) for k in (1, 2)])
    middle = np.median(step, axis=0)
    if np.median(np.abs(step - middle), axis=0).max() > SETTINGS.lanes.wander:
        return None
    return np.asarray(middle)


def pieces_in(
    corridor: Corridor, alignment: Alignment, lanes: Lanes, max_gap: float, ctx: Context
) -> list[Piece]:
    """One piece for each lane, and the pieces of the alignment that are of no lane."""
    lane_of = np.full(len(corridor.wires.xyz), -1)
    for k, own in enumerate(lanes.own):
        for j in own:
            lane_of[alignment.pieces[j].points] = k
    for points, lane in followed(corridor, alignment, lanes, max_gap, ctx):
        fresh = lane_of[points] < 0
        lane_of[points[fresh]] = lane[fresh]

    def fitted(points: Ints) -> Catenary | None:
        return fit(corridor.wires.xyz[points], sways=False, spread=SETTINGS.lanes.ahead)

    found = []
    for k, own in enumerate(lanes.own):
        points = np.flatnonzero(lane_of == k)
        curve = fitted(points)
        if curve is not None:
            found.append(Piece(points, curve, any(alignment.pieces[j].sure for j in own)))
    grouped = {j for own in lanes.own for j in own}
    for piece in (piece for j, piece in enumerate(alignment.pieces) if j not in grouped):
        points = piece.points[lane_of[piece.points] < 0]
        if 2 * len(points) > len(piece.points):
            found.append(replace(piece, points=points, curve=fitted(points) or piece.curve))
    return found


def followed(
    corridor: Corridor, alignment: Alignment, lanes: Lanes, max_gap: float, ctx: Context
) -> list[tuple[Ints, Ints]]:
    """Points of the wires that were followed along all lanes together, and the lane of each."""
    source, lane, places = moved(corridor, alignment, lanes)
    air = Airborne.of(places)
    source, lane = source[air.order], lane[air.order]
    half_width = 2 * SETTINGS.lanes.wander
    may = corridor.may[source] & (np.abs(air.xyz[:, 1]) < half_width)
    few, wide = fit_anything(alignment.tracks(corridor)), corridor.tolerance
    if few:  # all are needed: points scatter, and wires wander
        wide = math.hypot(wide, half_width)
    one = Corridor(air, corridor.height[source], may, wide, corridor.ground, corridor.seen)
    wire, lane = (np.cumsum(corridor.may) - 1)[source[may]], lane[may]
    _, voxel = uncrowded(one.wires, SETTINGS.lanes.sparse)
    curves = trace_all(one.wires, voxel, tolerance=wide, max_gap=max_gap, ctx=ctx)
    pieces = curves_of(one, curves)
    pieces = [p for p in pieces if p.sure or p.curve.length > SETTINGS.curves.sure_length]
    pieces += sparse_wires(one, pieces, ctx) if few else []
    taken = np.zeros(len(corridor.wires.xyz), bool)
    found = []
    for piece in sorted(pieces, key=lambda p: -len(p.points)):
        points = wire[piece.points]
        if 2 * np.count_nonzero(taken[points]) > len(points):
            continue  # the same wires, one of them taken for that above it
        taken[points] = True
        found.append((points, lane[piece.points]))
    return found


def moved(corridor: Corridor, alignment: Alignment, lanes: Lanes) -> tuple[Ints, Ints, Floats]:
    """Points in the air near lanes, their lanes, and their positions moved to the first lane."""
    u, v = alignment.along(corridor.air.xyz)
    near = (u > lanes.u[0] - SETTINGS.lanes.ahead) & (u < lanes.u[-1] + SETTINGS.lanes.ahead)
    box = np.flatnonzero(near & (np.abs(v - np.median(lanes.v)) < 4 * SETTINGS.network.line_width))
    u, z = u[box], corridor.air.xyz[box, 2]
    v = v[box] - lanes.middle(u)
    away = np.abs(v[:, None] - lanes.aside)
    point, lane = np.nonzero(
        (away < 6 * SETTINGS.lanes.wander) & (away < away.min(axis=1)[:, None] + SETTINGS.lanes.tie)
    )
    places = np.column_stack([u[point], v[point] - lanes.aside[lane], z[point] - lanes.up[lane]])
    return box[point], lane, places
