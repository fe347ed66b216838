"""All planes of a cloud, and the plane of each point.

References
----------
Beaton, A. E. and Tukey, J. W. (1974). The fitting of power series, meaning polynomials, illustrated
on band-spectroscopic data. Technometrics 16(2), 147-185: the weights of the last fit (biweight).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.planes import _search_kernels as kernels
from algorithms.planes._cells import ROUNDING, SAME, Cells, sort_into_cells
from algorithms.planes._cells_kernels import between_neighbours, steps_across
from algorithms.planes._search import Patch, Rules, Search, plane_of
from algorithms.shared.error_measures import NORMAL
from algorithms.shared.lowest import require_finite
from algorithms.shared.plane_fit import Plane, is_line
from toolbox.context import QUIET, Context
from toolbox.errors import DataError

GAPS = 4.0  # widest gap of a plane over the distance of neighbours
STRIP = 3.0  # the same over the tolerance
NOISES = 3.3  # tolerance over the noise: 99.9 % of the points of a plane
FINEST = 2.0  # the same, if a wider one joins surfaces: with less, planes fall to pieces
CENTRES = 0.5  # distance of a cell's centre over that of a point: slants through both are outdone
FILLED = 0.4  # spread over the tolerance: 0.30 of noise alone, 0.58 of points evenly within it
MUCH = 0.5  # share of the points that are on joined surfaces
FEW = 5_000  # points that tell how wide a plane is
NEAR = 3.0  # distance of planes over the tolerance, if one may be the noise of the other
ROUNDS = 20  # of a robust fit
MOSTLY = 0.3  # share of the mean square of steps that is noise at least: with panes it is 0.5
BIWEIGHT = 4.685  # standard deviations beyond which points do not count: 95 % efficient
SETTLED = 0.01  # change of distances over their spread, with which a fit is done
PASSES = 4  # searches among the points that are left
LOOK = 100_000  # points that tell whether there is more than a line

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Segments:
    """Planes, the one with the most points first, and the number of the plane of each point.

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
    """Find planes one after the other, and assign each point to the nearest suitable plane.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    rules : what makes a plane; a tolerance of 0 takes NOISES times the noise, or less where that
        joins surfaces; a gap of 0 takes GAPS times the distance of neighbours, but no less than
        STRIP times the tolerance
    ctx : progress and cancellation

    Returns
    -------
    the same for any order of the points

    Raises
    ------
    DataError
        There are fewer than three points, or all are on a line; the tolerance or the gap is too
        small for floats.
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
    for name, given, lowest in (
        ("tolerance", rules.tolerance, least),
        ("plane_gap", rules.gap, 4 * least),
    ):
        if 0 < given < lowest:
            raise DataError(
                f"{name}: {given:g} is too small for points that reach over {cells.size:g}; "
                f"at least {lowest:g} in their unit"
            )
    tolerance = rules.tolerance or max(NOISES * cells.noise, least)
    # A plane that is found later lacks the strip along its edges that the one before has taken.
    gap = rules.gap or max(GAPS * cells.apart, STRIP * tolerance, 4 * least)
    asked = rules
    rules = replace(asked, tolerance=tolerance, gap=gap)
    patches, trials = _patches(cells, rules, ctx.part(0.0, 0.5))
    owner = _owners(cells, patches, rules, ctx.part(0.5, 0.7))
    finer = 0.0 if asked.tolerance else _if_joined(cells, patches, owner, tolerance)
    if finer > least:
        left = asked.max_trials - trials
        finely = replace(asked, tolerance=FINEST * finer, centres=CENTRES, max_trials=left)
        made = segment_cells(replace(cells, noise=finer), finely, ctx=ctx.part(0.7, 1.0))
        return replace(made, trials=made.trials + trials)
    ids = np.empty(len(owner), np.int32)
    ids[cells.order] = owner
    planes = [
        Plane(patch.plane[:3], _on(patch.plane, cells.xyz[part]), cells.origin)
        for patch, part in zip(patches, parts_of(owner, len(patches)), strict=True)
    ]
    ctx.progress(1.0)
    return Segments(ids, planes, rules, cells.noise, trials)


def _if_joined(
    cells: Cells, patches: list[Patch], owner: NDArray[np.int32], tolerance: float
) -> float:
    """The noise, if planes are several surfaces joined into one by a tolerance too wide; else 0.

    The points of such a plane fill the tolerance, and neighbours have much of their distance from
    the plane in common, which they do not in noise: a wall, and the panes not far behind it. Most
    neighbours are on one surface: the median of their differences is noise, which the steps from
    the wall to a pane do not change, nor the slant of a plane that cuts through both. A median far
    below their mean square is none: of points of one sweep that share their error it is far less.
    """
    joined = []
    sizes = np.bincount(owner, minlength=len(patches) + 1)[1:]
    for patch, part in zip(patches, parts_of(owner, len(patches)), strict=True):
        some = cells.xyz[part[:: 1 + len(part) // FEW]]
        variance = float(np.var(some @ patch.plane[:3]))
        if variance > (FILLED * tolerance) ** 2:
            between = between_neighbours(some, *patch.plane[:3])
            if variance > SAME * between:
                step = np.median(np.abs(steps_across(cells.xyz[part], *patch.plane[:3])))
                least = (NORMAL * float(step)) ** 2 / 2
                joined.append((least if least > MOSTLY * between else between, len(part)))
    variances, counts = np.array(joined).reshape(-1, 2).T
    if counts.sum() <= MUCH * sizes.sum():
        return 0.0
    return math.sqrt(np.average(variances, weights=counts))


def _patches(cells: Cells, rules: Rules, ctx: Context) -> tuple[list[Patch], int]:
    """Patches of the points, then of the remaining points in cells of their own, and so on."""
    found: list[Patch] = []
    trials, part = 0, cells
    for number in range(PASSES):
        left = replace(rules, max_trials=rules.max_trials - trials)
        search = Search(part, left, whole=number == 0)
        made = search.patches(ctx.part(number / PASSES, (number + 1) / PASSES))
        trials += search.trials
        found += made
        free = search.free
        if not made or np.count_nonzero(free) < rules.min_points:
            break
        noise = min(cells.noise, rules.tolerance / NOISES)
        part = sort_into_cells(part.xyz[free], origin=np.zeros(3), noise=noise)
    return found, trials


def _owners(cells: Cells, patches: list[Patch], rules: Rules, ctx: Context) -> NDArray[np.int32]:
    """Number of the plane of each sorted point, after the patches were fitted to their points.

    Those that lose points to others until they are too small are left out, and those that lie in
    the noise of a larger one.
    """
    steps = _halves(ctx)
    while True:
        owner = _nearest(cells, patches, rules, next(steps))
        patches[:] = _all_fitted(cells, patches, owner, rules)
        owner = _nearest(cells, patches, rules, next(steps))
        sizes = np.bincount(owner, minlength=len(patches) + 1)[1:]
        order = np.argsort(-sizes, kind="stable")
        parts = parts_of(owner, len(patches))
        keep: list[int] = []
        for number in order.tolist():
            part, patch = parts[number], patches[number]
            some = cells.xyz[part[:: 1 + len(part) // FEW]]
            if len(part) < rules.min_points or _width(some @ patch.axes.T) < rules.min_extent:
                continue
            if not any(
                _is_noise(patch, some, patches[k], rules)
                and (
                    rules.centres < 1.0  # at twice the noise many points of a wall are left out
                    or patch.over(cells.xyz[parts[k]], rules.gap).sum() > len(part)
                )
                for k in keep
            ):
                keep.append(number)
        if len(keep) == len(sizes):
            ranks = np.zeros(len(keep) + 1, np.int32)
            ranks[order + 1] = np.arange(1, len(keep) + 1)
            made = _all_fitted(cells, patches, owner, rules)
            patches[:] = [made[k] for k in keep]
            return np.asarray(ranks[owner])
        patches[:] = [patches[number] for number in keep]


def _halves(ctx: Context) -> Iterator[Context]:
    """Contexts for an unknown number of steps, each with half of the remaining progress."""
    done = 0.0
    while True:
        yield ctx.part(done, (1 + done) / 2)
        done = (1 + done) / 2


def _nearest(cells: Cells, patches: list[Patch], rules: Rules, ctx: Context) -> NDArray[np.int32]:
    """Number from 1 of the patch nearest to each point, in units of its spread; 0 for none."""
    group = kernels.boxes(cells.reach)
    nearest = np.full(len(cells.xyz), np.inf, np.float32)
    owner = np.zeros(len(cells.xyz), np.int32)
    for number, patch in enumerate(patches):
        kernels.assign(
            patch.plane,
            patch.axes,
            rules.tolerance,
            patch.spread,
            rules.gap,
            patch.wider,
            number + 1,
            cells.xyz,
            cells.starts,
            cells.reach,
            group,
            nearest,
            owner,
        )
        ctx.progress(number / len(patches))
    return owner


def parts_of(owner: NDArray[np.int32], count: int) -> list[Ints]:
    """Indices of the points of each patch."""
    order = np.argsort(owner, kind="stable")
    return np.split(order, np.cumsum(np.bincount(owner, minlength=count + 1))[:-1])[1:]


def _width(uv: Floats) -> float:
    """Width of the smallest rectangle around points of shape (n, 2)."""
    hull = shapely.get_coordinates(shapely.convex_hull(shapely.linestrings(uv)))
    sides = np.diff(hull, axis=0)
    long = np.hypot(*sides.T)
    if not len(sides) or not (long > 0).all():
        return 0.0
    turned = hull @ np.column_stack([sides[:, 1], -sides[:, 0]]).T / long
    return float(np.ptp(turned, axis=0).min())


def _on(plane: Floats, xyz: Floats) -> Floats:
    """The mean of points of shape (n, 3), projected onto a plane."""
    mean = np.array([xyz[:, axis].mean() for axis in range(3)])
    return np.asarray(mean - (plane[:3] @ mean - plane[3]) * plane[:3])


def _is_noise(patch: Patch, xyz: Floats, other: Patch, rules: Rules) -> bool:
    """Whether a patch lies over another one so closely that it must be noise of that one."""
    if abs(patch.plane[:3] @ other.plane[:3]) < math.cos(rules.angle):
        return False
    away = np.median(np.abs(xyz @ other.plane[:3] - other.plane[3]))
    return bool(away < NEAR * rules.tolerance) and other.over(xyz, rules.gap).mean() > 0.5


def _all_fitted(
    cells: Cells, patches: list[Patch], owner: NDArray[np.int32], rules: Rules
) -> list[Patch]:
    """The patches fitted to their points, but for points along edges with other patches."""
    edge = np.zeros(len(owner), np.bool_)
    group, cosine = kernels.boxes(cells.reach), math.cos(rules.angle)
    planes = np.array([patch.plane for patch in patches]).reshape(-1, 4)
    for number, patch in enumerate(patches):
        kernels.near_edges(
            patch.plane,
            patch.axes,
            rules.tolerance,
            rules.gap,
            patch.wider,
            cosine,
            number + 1,
            planes,
            cells.xyz,
            cells.starts,
            cells.reach,
            group,
            owner,
            edge,
        )
    made = []
    for patch, part in zip(patches, parts_of(owner, len(patches)), strict=True):
        inner = part[~edge[part]]
        some = inner if 2 * len(inner) >= len(part) else part
        made.append(_fitted(cells.xyz, some, patch, ROUNDING * cells.size) if len(some) else patch)
    return made


def _fitted(xyz: Floats, part: Ints, patch: Patch, least: float) -> Patch:
    """A patch refitted to some points, with their spread about it.

    Points count less the farther they are from the plane in relation to its spread (biweight). The
    tolerance is the same for all planes, so that those with little noise hold points of others.
    """
    some = xyz[part[:: 1 + len(part) // FEW]]
    plane, middle, sums = patch.plane, some.mean(axis=0), np.empty(10)
    away = some @ plane[:3] - plane[3]
    for _ in range(ROUNDS):
        spread = max(NORMAL * float(np.median(np.abs(away))), least)
        kernels.weighted(xyz, part, plane, middle, BIWEIGHT * spread, sums)
        better = plane_of(sums, middle, plane[:3])
        if better is None:
            break
        before, plane = away, better
        away = some @ plane[:3] - plane[3]
        if np.abs(away - before).max() < SETTLED * spread:
            break
    return patch.moved(plane, spread)
