"""Curves from points in the air: each one is traced along a parabola from a seed.

References
----------
Jwa, Y. and Sohn, G. (2012). A piecewise catenary curve model growing for 3D power line
reconstruction. PE&RS 78(11), 1227-1240: wires grow from straight pieces, curve by curve.
Beaton, A. E. and Tukey, J. W. (1974). The fitting of power series, meaning polynomials,
illustrated on band-spectroscopic data. Technometrics 16(2), 147-185: the weights.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.corridor._curves import trace_kernels as kernels
from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._settings import SETTINGS
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import blocks
from toolbox.context import Context

PLAN_CELL = 4.0  # metres, of the plan index
MOST_POINTS_OF_WIRE = 200_000  # points of one wire

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Airborne:
    """Points above the ground, sorted by square cells in plan.

    Attributes
    ----------
    xyz : array of shape (n, 3), metres from an origin near by
    order : array of shape (n,), which of the points given each is
    start : where each cell begins
    west, south, rows, cols : of the cells
    """

    xyz: Floats
    order: Ints
    start: Ints
    west: float
    south: float
    rows: int
    cols: int

    @classmethod
    def of(cls, xyz: Floats) -> Airborne:
        """Sort points of shape (n, 3) by cell, then x, y, z, whatever their order."""
        low = np.floor(xyz[:, :2].min(axis=0) / PLAN_CELL) * PLAN_CELL if len(xyz) else np.zeros(2)
        west, south = float(low[0]), float(low[1])
        col = ((xyz[:, 0] - west) / PLAN_CELL).astype(np.int64)
        row = ((xyz[:, 1] - south) / PLAN_CELL).astype(np.int64)
        rows, cols = int(row.max(initial=0)) + 1, int(col.max(initial=0)) + 1
        cell = row * cols + col
        start = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=rows * cols))])
        order = np.empty(len(xyz), np.int64)
        kernels.in_cells(xyz, np.argsort(xyz[:, 0]), cell, start[:-1].copy(), start, order)
        return cls(np.ascontiguousarray(xyz[order]), order, start, west, south, rows, cols)

    @property
    def cells(self) -> kernels.Cells:
        """The points and cells in the form in which the kernels take them."""
        return kernels.Cells(
            self.xyz, self.start, self.west, self.south, PLAN_CELL, self.rows, self.cols
        )

    def select(self, which: Mask) -> Airborne:
        """Some of the points in the same cells."""
        before = np.concatenate([[0], np.cumsum(which)])
        start = before[self.start]
        return Airborne(
            self.xyz[which],
            np.flatnonzero(which),
            start,
            self.west,
            self.south,
            self.rows,
            self.cols,
        )

    def around(
        self, curve: Catenary, radius: float, low: float = 0.0, high: float | None = None
    ) -> tuple[Ints, Floats]:
        """Indices and distances of the points within a radius of a wire, from u = low to high."""
        high = curve.length if high is None else high
        slope = (curve.z_end - curve.z_start) / curve.length
        shape = (
            curve.x,
            curve.y,
            curve.ex,
            curve.ey,
            curve.u0,
            curve.z0,
            curve.curvature,
            curve.z_start,
            slope,
            curve.v0,
            curve.v1,
            curve.swing,
        )
        found, away = self._scratch
        count = kernels.tube(shape, float(low), float(high), float(radius), self.cells, found, away)
        order = np.argsort(found[:count])
        return found[:count][order], away[:count][order]

    def within(self, spots: Floats, reach: float) -> Ints:
        """Indices, rising, of the points in the cells that meet squares around some positions.

        Parameters
        ----------
        spots : array of shape (n, 2), or (2,)
        reach : half of the side of a square, metres
        """
        corner = np.array([self.west, self.south])
        low, high = (
            ((np.atleast_2d(spots) + d - corner) // PLAN_CELL).astype(np.int64)
            for d in (-reach, reach)
        )
        low, high = np.maximum(low, 0), np.minimum(high, [self.cols - 1, self.rows - 1])
        here = (low <= high).all(axis=1)
        if not here.any():
            return np.zeros(0, np.int64)
        first = low[here].min(axis=0)
        met = np.zeros((high[here].max(axis=0) - first + 1)[::-1], bool)
        for (c0, r0), (c1, r1) in zip(low[here] - first, high[here] - first, strict=True):
            met[r0 : r1 + 1, c0 : c1 + 1] = True
        row, col = np.nonzero(met)
        cell = (row + first[1]) * self.cols + col + first[0]
        begin, count = self.start[cell], self.start[cell + 1] - self.start[cell]
        end = np.cumsum(count)
        return np.asarray(np.arange(end[-1]) + np.repeat(begin - end + count, count))

    @functools.cached_property
    def tree(self) -> cKDTree:
        """The points in a search tree, which the searches at all tolerances share."""
        return cKDTree(self.xyz)

    @functools.cached_property
    def _scratch(self) -> tuple[Ints, Floats]:
        """Buffers for the indices and distances that a kernel fills in."""
        return np.empty(len(self.xyz), np.int64), np.empty(len(self.xyz))


def uncrowded(points: Airborne, density: float) -> tuple[Mask, Ints]:
    """Which points have as little around them as wires leave, and the index of the voxel of each.

    Parameters
    ----------
    points : n points above the ground
    density : points per square metre of the whole cloud

    Returns
    -------
    arrays of shape (n,)
    """
    if not len(points.xyz):
        return np.zeros(0, bool), np.zeros(0, np.int64)
    halves = np.floor(
        (points.xyz - points.xyz.min(axis=0)) / SETTINGS.points.company_side * 4
    ).astype(np.int64)
    x, y, z = (halves // 2 + SETTINGS.trace.crowd_reach).T
    bit = halves[:, 0] % 2 + 2 * (halves[:, 1] % 2) + 4 * (halves[:, 2] % 2)
    tall, wide = (
        int(z.max()) + SETTINGS.trace.crowd_reach + 1,
        int(y.max()) + SETTINGS.trace.crowd_reach + 1,
    )
    eighths, of_eighth = np.unique(((x * wide + y) * tall + z) * 8 + bit, return_inverse=True)
    keys, of_voxel, masks = np.unique(eighths // 8, return_inverse=True, return_counts=True)
    voxel = of_voxel[of_eighth]
    steps = range(-SETTINGS.trace.crowd_reach, SETTINGS.trace.crowd_reach + 1)
    columns = np.array([(i * wide + j) * tall for i in steps for j in steps])
    offsets = np.column_stack(
        [columns - SETTINGS.trace.crowd_reach, columns + SETTINGS.trace.crowd_reach]
    )
    crowd = np.zeros(len(keys), np.int64)
    ranges = blocks(len(keys), 50)
    side_by_side(
        lambda first, last: kernels.crowding(keys, masks, offsets, first, last, crowd), ranges
    )
    most = float(
        np.clip(
            SETTINGS.trace.eighths_per_density * density,
            SETTINGS.trace.least_eighths,
            2 * SETTINGS.trace.least_eighths,
        )
    )
    return (crowd <= most)[voxel], voxel


def seeds(points: Airborne, voxel: Ints, tolerance: float, ctx: Context) -> tuple[Ints, Floats]:
    """Points at which wires may begin and the directions there, the best aligned first.

    One point of each voxel is looked at.
    """
    _, first = np.unique(voxel, return_index=True)
    score, heading = np.zeros(len(first)), np.zeros((len(first), 3))
    side_by_side(
        *(kernels.straightness, blocks(len(first), 2000), first, points.cells),
        SETTINGS.trace.seed_reach,
        tolerance,
        SETTINGS.trace.steepest,
        score,
        heading,
        ctx=ctx,
    )
    good = np.flatnonzero(score >= SETTINGS.trace.least_seed)
    good = good[np.lexsort((first[good], -score[good].round(6)))]
    return first[good], heading[good]


def following() -> kernels.Following:
    """The numbers by which wires are followed, for the kernels."""
    return kernels.Following(
        SETTINGS.trace.look_share,
        SETTINGS.trace.seed_reach / 2,
        2 * SETTINGS.trace.seed_reach,
        0.5 / SETTINGS.curves.largest_c,
        SETTINGS.trace.usual_sag,
        SETTINGS.trace.least_rms,
        SETTINGS.trace.widest,
        SETTINGS.trace.resuming_share,
    )


def trace_all(
    points: Airborne, voxel: Ints, *, tolerance: float, max_gap: float, ctx: Context
) -> list[tuple[Floats, Ints]]:
    """Curves traced from all seeds that lie on no earlier curve, and the points of each.

    Parameters
    ----------
    points : those that may be wire
    """
    begin, headings = seeds(points, voxel, tolerance, ctx.part(0, 0.5))
    used = np.zeros(len(points.xyz), bool)
    found, curve = np.empty(MOST_POINTS_OF_WIRE, np.int64), np.empty(kernels.CURVE_SIZE)
    curves = []
    for number, (seed, heading) in enumerate(zip(begin, headings, strict=True)):
        if number % 100 == 0:
            ctx.progress(0.5 + 0.5 * number / len(begin))
        if used[seed]:
            continue
        count = kernels.trace(
            *(following(), seed, heading, points.cells, SETTINGS.trace.seed_reach),
            *(tolerance, max_gap, curve, found),
        )
        used[seed] = True
        mine = found[:count].copy()
        fresh = mine[~used[mine]]
        if (
            count
            and curve[kernels.CURVE_HIGH] - curve[kernels.CURVE_LOW]
            >= SETTINGS.trace.shortest_curve
            and 2 * len(fresh) > count
        ):
            used[mine] = True
            curves.append((curve.copy(), np.sort(fresh)))
    return curves
