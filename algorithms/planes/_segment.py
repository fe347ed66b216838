"""All planes of a cloud, and to which of them each point belongs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from algorithms.planes import _search_kernels as kernels
from algorithms.planes._cells import Cells, sort_into_cells
from algorithms.planes._search import Patch, Rules, Search, plane_of
from algorithms.shared.lowest import require_finite
from algorithms.shared.plane_fit import Plane, is_line
from toolbox.context import QUIET, Context
from toolbox.errors import DataError

NOISES = 3.0  # tolerance over the noise: 99.7 % of the points of a plane
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
    noise : standard deviation of the points about small planes, in the unit of the points
    tolerance : that was used
    trials : draws that were made
    """

    ids: NDArray[np.int32]
    planes: list[Plane]
    noise: float
    tolerance: float
    trials: int


def segment(xyz: Floats, rules: Rules, *, ctx: Context = QUIET) -> Segments:
    """Find planes one after the other, and give each point to the nearest that it may belong to.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    rules : what makes a plane; a tolerance of 0 takes NOISES times the noise of the points
    ctx : progress and cancellation

    Returns
    -------
    the same for any order of the points

    Raises
    ------
    DataError
        There are fewer than three points, or all are on a line.
    """
    require_finite(xyz)
    if len(xyz) < 3:
        raise DataError(f"points: a plane needs 3 points, there are {len(xyz)}")
    if is_line(xyz[:: -(-len(xyz) // LOOK)]) and is_line(xyz):
        raise DataError(f"points: all {len(xyz)} are on a line or at one place, not on a plane")
    cells = sort_into_cells(xyz, ctx=ctx.part(0.0, 0.2))
    noise = cells.noise()
    least = 1e-9 * float(np.abs(cells.xyz).max())  # of points without noise
    rules = replace(rules, tolerance=rules.tolerance or max(NOISES * noise, least))
    patches, trials = _patches(cells, rules, ctx.part(0.2, 0.8))
    owner = _owners(cells, patches, rules, ctx.part(0.8, 1.0))
    ids = np.empty(len(xyz), np.int32)
    ids[cells.order] = owner
    planes = _fitted(cells, owner, patches)
    ctx.progress(1.0)
    return Segments(ids, planes, noise, rules.tolerance, trials)


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
    """The number of the plane of each sorted point; planes by size, none of them too small."""
    group = kernels.boxes(cells.reach)
    cosine = math.cos(rules.angle)
    keep = list(range(len(patches)))
    while True:
        nearest = np.full(len(cells.xyz), np.inf, np.float32)
        owner = np.zeros(len(cells.xyz), np.int32)
        for rank, number in enumerate(keep):
            patch = patches[number]
            kernels.assign(
                patch.plane, patch.axes, rules.tolerance, rules.gap, patch.squares, cosine,
                rank + 1, cells.xyz, cells.starts, cells.reach, group, cells.centres, cells.normals,
                cells.flat, nearest, owner,
            )  # fmt: skip
            ctx.progress(rank / len(keep))
        sizes = np.bincount(owner, minlength=len(keep) + 1)[1:]
        good = [
            number for number, size in zip(keep, sizes, strict=True) if size >= rules.min_points
        ]
        if len(good) == len(keep):
            break
        keep = good
    order = np.argsort(-sizes, kind="stable")
    rank = np.zeros(len(keep) + 1, np.int32)
    rank[order + 1] = np.arange(1, len(keep) + 1)
    patches[:] = [patches[keep[place]] for place in order]
    return rank[owner]


def _fitted(cells: Cells, owner: NDArray[np.int32], patches: list[Patch]) -> list[Plane]:
    """The plane of least squares of each number."""
    planes = []
    order = np.argsort(owner, kind="stable")
    ends = np.cumsum(np.bincount(owner, minlength=len(patches) + 1))
    for patch, start, stop in zip(patches, ends[:-1], ends[1:], strict=True):
        xyz = cells.xyz[order[start:stop]]
        centre = xyz.mean(axis=0)
        near = xyz - centre
        second = (near.T @ near)[np.triu_indices(3)]
        sums = np.array([len(xyz), 0.0, 0.0, 0.0, *second])
        plane = plane_of(sums, centre, patch.plane[:3])
        normal = patch.plane[:3] if plane is None else plane[:3]
        planes.append(Plane(normal, centre, cells.origin))
    return planes
