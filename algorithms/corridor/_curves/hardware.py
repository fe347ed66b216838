"""What tells of a support besides the bend of its wires: arms among them, and a pole below.

Both are evidence in squares of sigmas: twice the logarithm of the ratio of the likelihoods of two
Poisson distributions, of as many points as there are and of as many as are usual around.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, uniform_filter1d

from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._curves.tracks import Alignment
from algorithms.corridor._settings import SETTINGS

STEM_CELLS = 3  # along and across, of the width in which a pole shows

Floats = NDArray[np.float64]
Track = tuple[Floats, Floats, Floats]  # chainages, offsets and heights of one wire


@dataclass(frozen=True)
class Beside:
    """Points around the wires of an alignment, and where these are at the same chainage.

    Attributes
    ----------
    u, v, z, height : chainage, offset, height, and height above the ground of n points
    left, right, low, high : offset and height of the outermost wires at their chainage
    """

    u: Floats
    v: Floats
    z: Floats
    height: Floats
    left: Floats
    right: Floats
    low: Floats
    high: Floats

    @classmethod
    def of(
        cls, corridor: Corridor, alignment: Alignment, tracks: Sequence[Track], chainages: Floats
    ) -> Beside:
        """The points around the wires of an alignment, of which some are known."""
        shape = np.full((4, len(chainages)), np.nan)  # left, right, low, high
        for u, v, z in tracks:
            cover = (chainages >= u[0]) & (chainages <= u[-1])
            for row, which, own in zip(range(4), (np.fmin, np.fmax) * 2, (v, v, z, z), strict=True):
                shape[row, cover] = which(shape[row, cover], np.interp(chainages[cover], u, own))
        known = np.flatnonzero(~np.isnan(shape[0]))
        ring = SETTINGS.arcs.ring_outer
        reach = float(np.nanmax(np.abs(shape[:2]))) + SETTINGS.arcs.arm_aside + ring
        spots = alignment.places(np.arange(chainages[0], chainages[-1] + ring, ring))
        box = corridor.air.within(spots, reach)
        xyz = corridor.air.xyz[box]
        u, v = alignment.along(xyz)
        sides = [np.interp(u, chainages[known], own[known]) for own in shape]
        return cls(u, v, xyz[:, 2], corridor.height[box], *sides)

    @property
    def among(self) -> NDArray[np.bool_]:
        """Which points are not farther aside than arms reach."""
        return (self.v > self.left - SETTINGS.arcs.arm_aside) & (
            self.v < self.right + SETTINGS.arcs.arm_aside
        )


def hardware(
    corridor: Corridor, alignment: Alignment, tracks: Sequence[Track], chainages: Floats
) -> tuple[Floats, Floats]:
    """Evidence for arms, and for a pole, at each chainage of an alignment, in squares of sigmas.

    Parameters
    ----------
    tracks : of the wires, at rising chainages
    """
    if not any(np.any((chainages >= u[0]) & (chainages <= u[-1])) for u, _, _ in tracks):
        return np.zeros(len(chainages)), np.zeros(len(chainages))
    beside = Beside.of(corridor, alignment, tracks, chainages)
    return arms(beside, tracks, chainages, corridor.tolerance), stems(beside, chainages)


def arms(beside: Beside, tracks: Sequence[Track], chainages: Floats, tolerance: float) -> Floats:
    """Evidence for an arm at each chainage.

    An arm is points among the wires that lie on none of them. It reaches across, so columns with
    points are counted, and is thin: a little way before and behind, a tree that comes up from
    below has as many.
    """
    u, v, z = beside.u, beside.v, beside.z
    stray = (
        beside.among
        & (z > beside.low - SETTINGS.arcs.tree_below)
        & (z < beside.high + SETTINGS.arcs.arm_above)
    )
    for along, aside, up in tracks:
        off = np.hypot(v - np.interp(u, along, aside), z - np.interp(u, along, up))
        stray &= (
            (off > SETTINGS.arcs.off_wires * tolerance) | (u < along[0] - 1) | (u > along[-1] + 1)
        )
    around, among = (
        columns(u[rows], v[rows])
        for rows in (stray, stray & (z > beside.low - SETTINGS.arcs.arm_half_width))
    )

    def count(u: Floats, a: float, b: float) -> Floats:
        within = np.searchsorted(u, chainages + b) - np.searchsorted(u, chainages + a)
        return np.asarray(within, float)

    here, usual = (
        count(among, -SETTINGS.arcs.arm_half_width, SETTINGS.arcs.arm_half_width),
        np.full(len(chainages), SETTINGS.arcs.least_usual),
    )
    for u, a, b in (
        (around, SETTINGS.arcs.ring_inner, SETTINGS.curves.clutter_radius),
        (among, SETTINGS.curves.clutter_radius, SETTINGS.arcs.ring_outer),
    ):
        most = np.maximum(count(u, -b, -a), count(u, a, b))
        usual = np.maximum(usual, most * 2 * SETTINGS.arcs.arm_half_width / (b - a))
    more = evidence(here, usual)
    spread = max(1.0, float(np.median(more)) / 0.4549)  # more than by chance
    return np.where(here > usual, more / spread, 0.0)


def evidence(here: Floats, usual: Floats) -> Floats:
    """Evidence for more than is usual where so many are, in squares of sigmas."""
    return np.asarray(2 * (here * np.log(np.maximum(here, 1.0) / usual) - (here - usual)))


def columns(u: Floats, v: Floats) -> Floats:
    """Chainages of the vertical columns that hold points; what hangs from a wire is one column."""
    cell = np.floor(np.column_stack([u, v]) / SETTINGS.arcs.column_width)
    _, which, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    return np.sort(np.bincount(which.ravel(), u, len(count)) / count)


def stem_cell() -> float:
    """Side of the cells in which a pole shows, metres; a pole is as thin as an arm."""
    return 2 * SETTINGS.arcs.arm_half_width / STEM_CELLS


def stems(beside: Beside, chainages: Floats) -> Floats:
    """Evidence for a pole below the wires at each chainage.

    A pole shows at many of the metres from the wires down, reaches up to them, and shows in the
    lower half as well; a drop hangs from a wire. It is thin: around a trunk there is a crown.
    """
    below = beside.low - beside.z
    own = beside.among & (below > SETTINGS.arcs.arm_half_width)
    own &= (beside.height > 2 * SETTINGS.points.off_ground) & (
        beside.height + below < SETTINGS.supports.tallest_pole
    )
    found = np.zeros(len(chainages))
    if not own.any():
        return found
    plan, size = np.column_stack([beside.u[own] - chainages[0], beside.v[own]]), stem_cell()
    cell = np.floor(plan / size).astype(np.int64)
    room = round(SETTINGS.curves.clutter_radius / size)
    low = cell.min(axis=0) - 2 * room
    shape = (*(cell.max(axis=0) - low + 2 * room + 1), int(SETTINGS.supports.tallest_pole) + 1)
    filled = np.zeros(shape, bool)
    filled[(*(cell - low).T, below[own].astype(np.int64))] = True
    thick = maximum_filter(filled, (STEM_CELLS, STEM_CELLS, 1))
    levels = thick.sum(axis=2).astype(np.float64)
    ring = [
        np.roll(levels, step, (0, 1)) for step in ((room, 0), (-room, 0), (0, room), (0, -room))
    ]
    around = 2 * round(SETTINGS.arcs.ring_outer / size) + 1
    usual = np.maximum(
        np.mean(ring, axis=0), uniform_filter1d(levels.mean(axis=1), around)[:, None]
    )
    tried = around * levels.shape[1] / STEM_CELLS**2  # any of these might be a pole by chance
    more = evidence(levels, np.maximum(usual, 1e-9)) - 2 * math.log(tried)
    stands = np.zeros(shape[:2], bool)
    lower = (beside.height < below)[own]
    stands[tuple((cell - low)[lower].T)] = True
    reaches = thick[:, :, : round(SETTINGS.arcs.tree_below)].any(axis=2)
    reaches &= maximum_filter(stands, STEM_CELLS)
    best = np.where(reaches & (levels > usual), np.maximum(more, 0.0), 0.0).max(axis=1)
    at = np.floor((chainages - chainages[0]) / size).astype(np.int64) - low[0]
    inside = (at >= 0) & (at < len(best))
    found[inside] = best[at[inside]]
    return found
