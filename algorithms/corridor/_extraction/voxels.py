"""Power lines by voxels, step by step as in Muş (2019); method `thesis` of `corridor.extract`.

Points high above the ground are put into voxels. Those of little (or much) variance of height hold
straight lines, found by random samples, and grow together where their lines agree. Where much
stands above one place is a pylon. Where the text leaves a step open, or cannot work as printed, the
notes of the functions say what is done.

References
----------
Muş, F. (2019). Power line corridors from laser scanning. MSc thesis, Karadeniz Technical
University, Trabzon.
Otsu, N. (1979). A threshold selection method from gray-level histograms. IEEE Transactions on
Systems, Man and Cybernetics 9(1), 62-66.
Fischler, M. A. and Bolles, R. C. (1981). Random sample consensus. CACM 24(6), 381-395.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from toolbox.context import Context

CERTAINTY, OUTLIERS, SAMPLE = 0.99, 0.6, 2  # of the random samples: p, share of outliers, points
NEAR_LINE = 0.3  # metres
ANGLE = math.radians(45.0)  # a difference of slopes of 1, for lines in any direction
LEAST_VOXELS = 5  # of a piece of line
BINS = 256  # of the histogram
SPACING = 30.0  # metres between pylons
HOLES = 0.05  # of the concave hull: 0 as tight as can be, 1 convex

Variance = Literal["low", "high"]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Settings:
    """What the thesis sets: keep points from this height, voxels of this size, gaps (metres)."""

    height: float
    voxel: float
    variance: Variance
    gap: float
    seed: int


def voxel_lines(xyz: Floats, height: Floats, settings: Settings, ctx: Context) -> tuple[Mask, Ints]:
    """Which points are wire, and the number of the pylon that each belongs to.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    height : array of shape (n,), above the ground
    settings : see :class:`Settings`
    ctx : progress and cancellation

    Returns
    -------
    wire : array of shape (n,)
    pylon : array of shape (n,), from 1, 0 for none
    """
    wire, pylon = np.zeros(len(xyz), bool), np.zeros(len(xyz), np.int64)
    high = np.flatnonzero(height > settings.height)
    if len(high) < SAMPLE:
        return wire, pylon
    place = np.floor(xyz[high] / settings.voxel).astype(np.int64)
    _, voxel, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
    voxel = voxel.ravel()
    centroid = np.column_stack([np.bincount(voxel, xyz[high, k]) / count for k in range(3)])
    spread = np.bincount(voxel, xyz[high, 2] ** 2) / count - centroid[:, 2] ** 2
    filled = count > SAMPLE
    limit = otsu(spread[filled])
    chosen = filled & ((spread <= limit) if settings.variance == "low" else (spread > limit))
    ctx.progress(0.2)
    direction = directions(xyz[high], voxel, np.flatnonzero(chosen), settings.seed, ctx)
    grown = grow(centroid, direction, chosen, settings)
    column, total = np.unique(place[:, :2], axis=0, return_inverse=True)[1].ravel(), count[voxel]
    density = np.bincount(column)
    tall = density > otsu(density.astype(float))
    pylon[high] = clusters(xyz[high], tall[column] & grown_near(centroid, grown, settings)[voxel])
    bounds = boxes(xyz, pylon)
    for number, (low, top) in enumerate(bounds, start=1):
        pylon[((xyz[:, :2] >= low) & (xyz[:, :2] <= top)).all(axis=1)] = number
    ctx.progress(0.9)
    lines = high[grown[voxel] & (total > 0)]
    lines = lines[pylon[lines] == 0]
    wire[high[inside_hulls(xyz[high], xyz[lines], settings)]] = True
    wire &= pylon == 0
    return wire, pylon


def otsu(values: Floats) -> float:
    """The threshold that separates two groups with the least variance within them."""
    if not len(values):
        return 0.0
    count, edges = np.histogram(values, BINS)
    middle = (edges[:-1] + edges[1:]) / 2
    below, above = np.cumsum(count), len(values) - np.cumsum(count)
    total = np.cumsum(count * middle)
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = total / below - (total[-1] - total) / above
    between = np.nan_to_num(below * above * gap**2)
    best = np.flatnonzero(between == between.max())  # several, where no value lies between
    return float(edges[1 + best].mean())


def directions(xyz: Floats, voxel: Ints, chosen: Ints, seed: int, ctx: Context) -> Floats:
    """Unit vectors of lines through the points of voxels, by random samples.

    Lines are fitted in plan and in both vertical planes; here that is one line in space, which has
    a direction also where a slope would be infinite.
    """
    rng = np.random.default_rng(seed)
    tries = math.ceil(math.log(1 - CERTAINTY) / math.log(1 - (1 - OUTLIERS) ** SAMPLE))
    order = np.argsort(voxel, kind="stable")
    start = np.searchsorted(voxel[order], np.arange(voxel.max() + 2))
    result = np.zeros((voxel.max() + 1, 3))
    for number, which in enumerate(chosen):
        if number % 200 == 0:
            ctx.progress(0.2 + 0.5 * number / len(chosen))
        points = xyz[order[start[which] : start[which + 1]]]
        pairs = rng.integers(0, len(points), (tries, SAMPLE))
        step = points[pairs[:, 1]] - points[pairs[:, 0]]
        size = np.linalg.norm(step, axis=1)
        step, first = step[size > 0] / size[size > 0, None], points[pairs[size > 0, 0]]
        if not len(step):
            continue
        away = np.linalg.norm(np.cross(points[None] - first[:, None], step[:, None]), axis=2)
        result[which] = step[int((away < NEAR_LINE).sum(axis=1).argmax())]
    return result


def grow(centroid: Floats, direction: Floats, chosen: Mask, settings: Settings) -> Mask:
    """Voxels that hang together: near each other, with lines of one direction.

    As printed, voxels among the 26 neighbours must be nearer than 20 m, which all of them are; so
    any voxel within the gap may follow if its line agrees, and lies in the direction of both.
    """
    some = np.flatnonzero(chosen & (np.abs(direction).sum(axis=1) > 0))
    grown = np.zeros(len(centroid), bool)
    if len(some) < LEAST_VOXELS:
        return grown
    pairs = cKDTree(centroid[some]).query_pairs(settings.gap, output_type="ndarray")
    one, other = some[pairs[:, 0]], some[pairs[:, 1]]
    step = centroid[other] - centroid[one]
    size = np.linalg.norm(step, axis=1)
    next_to = size < math.sqrt(3) * settings.voxel * 1.5
    step /= np.maximum(size, 1e-9)[:, None]
    alike = np.abs((direction[one] * direction[other]).sum(axis=1)) > math.cos(ANGLE)
    ahead = np.abs((step * direction[one]).sum(axis=1)) > math.cos(ANGLE / 3)
    linked = pairs[alike & (next_to | ahead)]
    graph = coo_array((np.ones(len(linked)), linked.T), shape=(len(some), len(some)))
    _, label = connected_components(graph, directed=False)
    grown[some] = np.bincount(label)[label] >= LEAST_VOXELS
    return grown


def grown_near(centroid: Floats, grown: Mask, settings: Settings) -> Mask:
    """Voxels near those that grew: a pylon stands at its wires."""
    if not grown.any():
        return np.zeros(len(centroid), bool)
    away, _ = cKDTree(centroid[grown, :2]).query(centroid[:, :2])
    return np.asarray(away < 2 * settings.voxel)


def clusters(xyz: Floats, tall: Mask) -> Ints:
    """Number of the pylon of each point; pylons are farther apart than SPACING."""
    number = np.zeros(len(xyz), np.int64)
    if not tall.any():
        return number
    cells, cell = np.unique(np.floor(xyz[tall, :2]), axis=0, return_inverse=True)
    pairs = cKDTree(cells).query_pairs(SPACING, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(cells), len(cells)))
    number[tall] = 1 + connected_components(graph, directed=False)[1][cell.ravel()]
    return number


def boxes(xyz: Floats, pylon: Ints) -> list[tuple[Floats, Floats]]:
    """Bounds in plan of each pylon."""
    found = []
    for number in range(1, int(pylon.max(initial=0)) + 1):
        plan = xyz[pylon == number, :2]
        found.append((plan.min(axis=0), plan.max(axis=0)))
    return found


def inside_hulls(xyz: Floats, lines: Floats, settings: Settings) -> Mask:
    """Points within the concave hull of the wires in plan, and near their heights there."""
    if len(lines) < 4:
        return np.zeros(len(xyz), bool)
    hull = shapely.concave_hull(shapely.MultiPoint(lines[:, :2]), HOLES).buffer(NEAR_LINE)
    shapely.prepare(hull)
    inside = shapely.contains_xy(hull, xyz[:, 0], xyz[:, 1])
    away, near = cKDTree(lines).query(xyz, distance_upper_bound=settings.voxel)
    return np.asarray(inside & (away < settings.voxel / 2) & (near < len(lines)))
