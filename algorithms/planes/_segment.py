"""All planes of a cloud, and to which of them each point belongs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.planes import _search_kernels as kernels
from algorithms.planes._cells import ROUNDING, Cells, sort_into_cells
from algorithms.planes._search import Patch, Rules, Search, plane_of
from algorithms.shared.lowest import require_finite
from algorithms.shared.plane_fit import Plane, is_line
from toolbox.context import QUIET, Context
from toolbox.errors import DataError

GAPS = 4.0  # widest gap of a plane over the distance of neighbours
NOISES = 3.3  # tolerance over the noise: 99.9 % of the points of a plane
FEW = 5_000  # points that tell how wide a plane is
NEAR = 3.0  # distance of planes over the tolerance, if one may be the noise of the other
PASSES = 4  # searches among the points that are left
LOOK = 100_000  # points that tell whether there is more than a line

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Segments:
    """Planes, the one with the most points first, and which of them each point is on.

    Attributes
    ----------
    ids : array of shape (n,), from 1; 0 of no plane
    planes : one less than the largest number
    rules : with the tolerance and the gap that were used
    noise : standard deviation of the points about small planes, in the unit of the points
    trials : draws that were made
    """

    ids: NDArray[np.int32]
    planes: list[Plane]
    rules: Rules
    noise: float
    trials: int


def segment(xyz: Floats, rules: Rules, *, ctx: Context = QUIET) -> Segments:
    """Find planes one after the other, and give each point to the nearest that it may belong to.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    rules : what makes a plane; a tolerance of 0 takes NOISES times the noise, a gap of 0 GAPS
        times the distance of neighbours
    ctx : progress and cancellation

    Returns
    -------
    the same for any order of the points

    Raises
    ------
    DataError
        There are fewer than three points, or all are on a line.
    """
    return segment_cells(cells_of(xyz, ctx=ctx.part(0.0, 0.2)), rules, ctx=ctx.part(0.2, 1.0))


def cells_of(xyz: Floats, *, ctx: Context = QUIET) -> Cells:
    """Points that can lie on a plane, sorted into cells; see :func:`segment`."""
    require_finite(xyz)
    if len(xyz) < 3:
        raise DataError(f"points: a plane needs 3 points, there are {len(xyz)}")
    if is_line(xyz[:: -(-len(xyz) // LOOK)]) and is_line(xyz):
        raise DataError(f"points: all {len(xyz)} are on a line or at one place, not on a plane")
    return sort_into_cells(xyz, ctx=ctx)


def segment_cells(cells: Cells, rules: Rules, *, ctx: Context = QUIET) -> Segments:
    """The planes of points that are sorted into cells; see :func:`segment`."""
    least = ROUNDING * cells.size  # of points without noise
    rules = replace(
        rules,
        tolerance=rules.tolerance or max(NOISES * cells.noise, least),
        gap=rules.gap or max(GAPS * cells.apart, 4 * least),
    )
    patches, trials = _patches(cells, rules, ctx.part(0.0, 0.7))
    owner = _owners(cells, patches, rules, ctx.part(0.7, 1.0))
    ids = np.empty(len(owner), np.int32)
    ids[cells.order] = owner
    planes = _fitted(cells, owner, patches)
    ctx.progress(1.0)
    return Segments(ids, planes, rules, cells.noise, trials)


def _patches(cells: Cells, rules: Rules, ctx: Context) -> tuple[list[Patch], int]:
    """Patches of the points, then of those that are left in cells of their own, and so on."""
    found: list[Patch] = []
    trials, part = 0, cells
    for number in range(PASSES):
        search = Search(part, rules)
        made = search.patches(ctx.part(number / PASSES, (number + 1) / PASSES))
        trials += search.trials
        found += made
        left = search.free
        if not made or np.count_nonzero(left) < rules.min_points:
            break
        part = sort_into_cells(part.xyz[left], origin=np.zeros(3))
    return found, trials


def _owners(cells: Cells, patches: list[Patch], rules: Rules, ctx: Context) -> NDArray[np.int32]:
    """The number of the plane of each sorted point; patches are put in that order.

    Those that lose points to others until they are too small are left out, and those that lie in
    the noise of a larger one.
    """
    while True:
        owner = _nearest(cells, patches, rules, ctx)
        sizes = np.bincount(owner, minlength=len(patches) + 1)[1:]
        order = np.argsort(-sizes, kind="stable")
        parts = parts_of(owner, len(patches))
        keep: list[int] = []
        for number in order.tolist():
            xyz, patch = cells.xyz[parts[number]], patches[number]
            if (
                len(xyz) < rules.min_points
                or _width(xyz[:: 1 + len(xyz) // FEW] @ patch.axes.T) < rules.min_extent
            ):
                continue
            others = (patches[k] for k in keep)
            if not any(_is_noise(patch, xyz, other, rules) for other in others):
                keep.append(number)
        patches[:] = [patches[number] for number in keep]
        if len(keep) == len(sizes):
            ranks = np.zeros(len(keep) + 1, np.int32)
            ranks[order + 1] = np.arange(1, len(keep) + 1)
            return np.asarray(ranks[owner])


def _nearest(cells: Cells, patches: list[Patch], rules: Rules, ctx: Context) -> NDArray[np.int32]:
    """The number of the patch, from 1, whose plane is nearest to each point; 0 of none."""
    group, cosine = kernels.boxes(cells.reach), math.cos(rules.angle)
    nearest = np.full(len(cells.xyz), np.inf, np.float32)
    owner = np.zeros(len(cells.xyz), np.int32)
    for number, patch in enumerate(patches):
        kernels.assign(
            patch.plane, patch.axes, rules.tolerance, rules.gap, patch.wider, cosine,
            number + 1, cells.xyz, cells.starts, cells.reach, group, cells.centres, cells.normals,
            cells.flat, nearest, owner,
        )  # fmt: skip
        ctx.progress(number / len(patches))
    return owner


def parts_of(owner: NDArray[np.int32], count: int) -> list[Ints]:
    """The places of the points of each patch."""
    order = np.argsort(owner, kind="stable")
    return np.split(order, np.cumsum(np.bincount(owner, minlength=count + 1))[:-1])[1:]


def _width(uv: Floats) -> float:
    """The shorter side of the smallest rectangle around places of shape (n, 2)."""
    hull = shapely.get_coordinates(shapely.convex_hull(shapely.linestrings(uv)))
    sides = np.diff(hull, axis=0)
    long = np.hypot(*sides.T)
    if not len(sides) or not (long > 0).all():
        return 0.0
    turned = hull @ np.column_stack([sides[:, 1], -sides[:, 0]]).T / long
    return float(np.ptp(turned, axis=0).min())


def _is_noise(patch: Patch, xyz: Floats, other: Patch, rules: Rules) -> bool:
    """Whether a patch lies over another one, so close that both cannot have been seen."""
    if abs(patch.plane[:3] @ other.plane[:3]) < math.cos(rules.angle):
        return False
    away = np.median(np.abs(xyz @ other.plane[:3] - other.plane[3]))
    return bool(away < NEAR * rules.tolerance) and other.under(xyz, rules.gap) > 0.5


def _fitted(cells: Cells, owner: NDArray[np.int32], patches: list[Patch]) -> list[Plane]:
    """The plane of least squares of each number."""
    planes = []
    for patch, part in zip(patches, parts_of(owner, len(patches)), strict=True):
        xyz = cells.xyz[part]
        centre = np.array([xyz[:, axis].mean() for axis in range(3)])
        near = xyz - centre
        second = (near.T @ near)[np.triu_indices(3)]
        sums = np.array([len(xyz), 0.0, 0.0, 0.0, *second])
        plane = plane_of(sums, centre, patch.plane[:3])
        normal = patch.plane[:3] if plane is None else plane[:3]
        planes.append(Plane(normal, centre, cells.origin))
    return planes
