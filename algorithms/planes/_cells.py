"""Cells of an octree from points, each with its centre and normal.

The search for planes looks at cells, not at points, of which there are some thirty times as many.

References
----------
Schnabel, R., Wahl, R. and Klein, R. (2007). Efficient RANSAC for point-cloud shape detection.
Computer Graphics Forum 26(2), 214-226: samples from the cells of an octree.
Morton, G. M. (1966). A computer oriented geodetic data base. IBM: the order of the cells.
von Neumann, J. (1941). Distribution of the ratio of the mean square successive difference to the
variance. Annals of Mathematical Statistics 12(4), 367-395: what neighbours have in common.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.planes import _cells_kernels as kernels
from algorithms.shared.kernels.threads import in_blocks
from toolbox.context import QUIET, Context

MOST = 32  # points of a cell that is not split
UP = 3  # levels above a cell in which a normal is looked for
BLOCK, LEAVES = 500_000, 5_000  # points and cells between two checks for cancellation
THIN = 12.0  # least side of a cell over the noise, so that its normal is worth something
THICK = 0.1  # least variance over the middle one, above which points are no plane
SAME = 1.5  # variance about a plane in a large piece over that in a small one, at most
ROUNDING = 1e-9  # of coordinates, as a share of the largest
LARGER = [MOST * 4**k for k in range(1, 5)]  # most points of cells that tell the noise
CLEARLY = 1.1  # share of cells that are planes over that of smaller cells, to be taken
CHANCE = 2.0  # standard errors of both shares by which it is larger then: one draw in forty
ENOUGH = 0.5  # share of cells that are planes, with which no larger ones are looked at
MOSTLY = 0.75  # share of cells that are flat: larger ones only join what lies side by side
LOOKED_AT = 5_000  # cells that tell the noise
NOISY, SPARSE = 0.9, 0.95  # shares of them with less noise, and with closer points

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Cells:
    """Points sorted into cells of an octree, and what describes each cell.

    Attributes
    ----------
    xyz : array of shape (n, 3), sorted, from the origin
    order : array of shape (n,), index of each among the points given
    origin : array of shape (3,)
    starts : array of shape (m + 1,), where the points of each cell begin
    centres, normals : arrays of shape (m, 3); NaN is no normal
    spread : array of shape (m, 2), middle and least variance around the plane of the normal
    reach : array of shape (m, 6), lowest and highest coordinates
    keys : array of shape (m,), of the first point of each cell
    levels : array of shape (m,), of the cells in the octree
    noise : standard deviation of the points about their planes, where it is large
    apart : distance of neighbours, where it is large
    """

    xyz: Floats
    order: Ints
    origin: Floats
    starts: Ints
    centres: Floats
    normals: Floats
    spread: Floats
    reach: Floats
    keys: NDArray[np.uint64]
    levels: Ints
    noise: float
    apart: float

    @property
    def size(self) -> float:
        """The largest coordinate, measured from the origin."""
        return float(self.reach[:, 3:].max())

    @property
    def counts(self) -> Ints:
        """Points in each cell."""
        return np.diff(self.starts)

    @property
    def flat(self) -> NDArray[np.bool_]:
        """True for cells whose points lie on a plane."""
        return self.spread[:, 1] < THICK * self.spread[:, 0]


def sort_into_cells(
    xyz: Floats,
    *,
    origin: Floats | None = None,
    noise: float | None = None,
    ctx: Context = QUIET,
) -> Cells:
    """Sort points of shape (n, 3) into cells of at most MOST points, not below the noise in size.

    Parameters
    ----------
    xyz : finite coordinates
    origin : taken off the coordinates; by default the lowest ones
    noise : that is known; by default it is found
    ctx : progress and cancellation

    Returns
    -------
    the same cells for any order of the points
    """
    # Much faster than along the points.
    low = np.array([xyz[:, axis].min() for axis in range(3)])
    high = np.array([xyz[:, axis].max() for axis in range(3)])
    side = max(float((high - low).max()), np.finfo(float).tiny) * (1 + 1e-9)
    found = np.empty(len(xyz), np.uint64)
    points = np.ascontiguousarray(xyz)

    def number(first: int, last: int) -> None:
        kernels.keys(first, last, points, low, side, found)

    in_blocks(number, len(xyz), BLOCK, ctx.part(0.0, 0.2))
    order, keys = _sorted(found, points)
    near = points[order]
    origin = low if origin is None else origin
    near -= origin
    ctx.progress(0.5)
    noise, gap = _scales(*_once_each(near, keys), side) if noise is None else (noise, 0.0)
    deepest = kernels.LEVELS
    if noise > 0:
        deepest = min(max(0, math.floor(math.log2(side / (THIN * noise)))), deepest)
    starts, levels = _leaves(keys, MOST, deepest)
    ctx.progress(0.6)
    count = len(levels)
    centres, normals = np.empty((count, 3)), np.empty((count, 3))
    spread, reach = np.empty((count, 2)), np.empty((count, 6))

    def describe(first: int, last: int) -> None:
        made = (centres, normals, spread, reach)
        kernels.describe(first, last, near, keys, starts, levels, UP, *made)

    in_blocks(describe, count, LEAVES, ctx.part(0.6, 1.0))
    return Cells(
        near,
        order,
        origin,
        starts,
        centres,
        normals,
        spread,
        reach,
        keys[starts[:-1]],
        levels,
        noise,
        gap,
    )


def _leaves(keys: NDArray[np.uint64], most: int, deepest: int) -> tuple[Ints, Ints]:
    """Index of the first point of each leaf, and the level of the leaf; see the kernel."""
    starts, levels = np.empty(len(keys) + 1, np.int64), np.empty(len(keys), np.int64)
    count = kernels.leaves(keys, most, deepest, starts, levels)
    starts[count] = len(keys)
    return starts[: count + 1].copy(), levels[:count].copy()


def _once_each(xyz: Floats, keys: NDArray[np.uint64]) -> tuple[Floats, NDArray[np.uint64]]:
    """Sorted points and their keys without repeated points, which make no scan denser."""
    tied = 1 + np.flatnonzero(keys[1:] == keys[:-1])
    again = tied[(xyz[tied] == xyz[tied - 1]).all(axis=1)]
    if not len(again):
        return xyz, keys
    return np.delete(xyz, again, axis=0), np.delete(keys, again)


def _scales(xyz: Floats, keys: NDArray[np.uint64], side: float) -> tuple[float, float]:
    """Noise of the points about planes, and distance of neighbours; 0 where nothing is flat.

    In a dense scan small cells are no larger than the noise. Larger ones are looked at until half
    are planes, or most of them flat, and taken if clearly more of them are planes.
    """
    best, flat, noise, apart = _scale(xyz, keys, side, MOST)
    for most in LARGER:
        if best.mean >= ENOUGH or flat >= MOSTLY:
            break
        wider, flat, *scales = _scale(xyz, keys, side, most)
        if wider.clearly_over(best):
            best, (noise, apart) = wider, scales
    return noise, apart


class _Share(NamedTuple):
    """Share of cells that are planes, and how many cells were counted."""

    mean: float
    cells: int

    def clearly_over(self, other: _Share) -> bool:
        """Whether it is larger than another one, by more than the chance of few cells tells.

        Of a hundred cells ten or fifteen may be planes by chance.
        """
        chance = CHANCE * math.hypot(self.error, other.error)
        return self.mean > CLEARLY * other.mean and self.mean - other.mean >= chance

    @property
    def error(self) -> float:
        """Standard error of the share (binomial)."""
        return math.sqrt(self.mean * (1 - self.mean) / max(self.cells, 1))


def _scale(
    xyz: Floats, keys: NDArray[np.uint64], side: float, most: int
) -> tuple[_Share, float, float, float]:
    """Shares of cells that are planes and that are flat, their noise, distance of neighbours.

    The points of a plane lie as close to it in a large piece as in a small one. Where they do not,
    the surface is bent, or is none, or is two: a wall and the panes in it. So it is where
    neighbours have much of their distance from the plane in common.
    """
    starts, levels = _leaves(keys, most, kernels.LEVELS)
    some = np.linspace(0, len(levels) - 1, min(len(levels), LOOKED_AT)).astype(np.int64)
    found = np.empty((len(some), 6))
    piece = max(MOST, most // 16) if most > MOST else 0  # a quarter as wide, but for the first
    kernels.at_scales(some, xyz, keys, starts, levels, piece, found)
    middle, least, middle_above, least_above, within, between = found.T
    flat = (least < THICK * middle) & (least_above < THICK * middle_above)
    rounding = (ROUNDING * side) ** 2
    plane = flat & (least_above <= SAME * least + rounding) & (least <= SAME * within + rounding)
    plane &= least_above <= SAME * between + rounding
    count = np.diff(starts)[some]
    if not flat.any():
        return _Share(0.0, len(some)), 0.0, 0.0, 0.0
    # Where all is bent, the flattest quarter tells most.
    noise = (
        np.quantile(least_above[plane], NOISY) if plane.any() else np.quantile(least[flat], 0.25)
    )
    apart = np.sqrt(12 * middle[flat] / count[flat])  # evenly spread over a square
    share = _Share(float(plane.mean()), len(some))
    return share, float(flat.mean()), math.sqrt(noise), float(np.quantile(apart, SPARSE))


def _sorted(found: NDArray[np.uint64], xyz: Floats) -> tuple[Ints, NDArray[np.uint64]]:
    """The order of points by key, then x, y, z; and the keys in this order."""
    order = np.argsort(found, kind="stable")
    keys = found[order]
    same = keys[1:] == keys[:-1]
    tied = np.flatnonzero(np.append(same, False) | np.insert(same, 0, False))
    if len(tied):
        some = order[tied]
        order[tied] = some[np.lexsort((*xyz[some].T[::-1], keys[tied]))]
    return order, keys
