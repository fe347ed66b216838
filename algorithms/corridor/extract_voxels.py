"""Wires and towers from a raw cloud by voxels, step by step as in Muş (2019).

Points high above the ground are put into voxels. Those of little (or much) variance of height hold
straight lines, found by random samples, and grow together where their lines agree. A column of many
points above each other is a tower. Where the text leaves a step open, or cannot work as printed,
the notes of the functions say what is done.

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
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._curves.trace import uncrowded
from algorithms.corridor._extraction.follow import follow, tolerances
from algorithms.corridor._extraction.labels import LABEL_NUMBERS, labelled, none_labelled
from algorithms.corridor._extraction.layers import wire_layer
from algorithms.corridor._extraction.points import CorridorPoints
from algorithms.corridor._extraction.spans import on_wire
from algorithms.shared import parameters
from algorithms.shared.ground import taking_part
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Vector
from toolbox.declare import ClassList, outputs, param, sink, source, tool

CERTAINTY = 0.99  # that one of the random samples has no outlier
OUTLIER_SHARE, SAMPLE_POINTS = 0.6, 2
NEAR_LINE = 0.3  # metres
LARGEST_ANGLE = math.radians(45.0)  # a difference of slopes of 1, for lines in any direction
LEAST_VOXELS = 5  # of a piece of line
HISTOGRAM_BINS = 256  # of the histogram
TOWER_SPACING = 30.0  # metres between towers
HULL_TIGHTNESS = 0.05  # of the concave hull: 0 as tight as can be, 1 convex

Variance = Literal["low", "high"]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@tool("corridor.extract_voxels")
class CorridorExtractVoxels:
    """Find wires and towers in a raw point cloud by voxels, as a thesis published it.

    The method of Muş (2019), to compare corridor.extract with. Points high above the ground are put
    into voxels; those of little variance of height hold lines, which grow together where they
    agree. Wires become class 14 and towers class 15, as corridor.extract classifies. A tower holds
    all points in its bounds in plan, and no wires are found below `height`.

    `wires` has the catenaries that are fitted to the points of wires; a point on one of them has
    its wire_id and span_id, any other point of a wire has wire_id 1 and span_id 0.
    """

    points: PointCloud = source("Points of a corridor, with the ground below the line")
    ground_classes: ClassList | None = param(
        "Classes that are ground; without them the ground is found", default=None
    )
    height: float = param(
        "Lowest points that are kept, above the ground", default=20.0, unit="m", ge=1.0
    )
    voxel: float = param("Size of the voxels", default=3.0, unit="m", ge=0.5)
    variance: Variance = param(
        "Voxels to keep, by their variance of height: high as printed, low works", default="low"
    )
    voxel_gap: float = param(
        "Farthest voxel in which a line may go on", default=20.0, unit="m", gt=0
    )
    seed: int = parameters.seed()
    wire_gap: float = parameters.wire_gap()
    wire_tolerance: float | None = parameters.wire_tolerance()
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        classified: PointCloud = sink("The same points with classes 14 and 15 and their numbers")
        wires: Vector = sink("One catenary per conductor and span, with its covariance")
        span_count: int = sink("Spans found", unit="1")

    def halo(self) -> float:
        """Infinite, as spans and lines may be of any length."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> CorridorExtractVoxels.Outputs:
        """Find wires and towers by voxels, and catenaries through the wires."""
        cloud, use = self.points, taking_part(self.points, self.ignore)
        metre = cloud.metre
        points = CorridorPoints.of(cloud, use, self.ground_classes, ctx.part(0.0, 0.4))
        air, height = points.air, points.height[points.own]
        high, tower = voxel_lines(
            air.xyz,
            height,
            height=self.height / metre,
            voxel=self.voxel / metre,
            variance=self.variance,
            voxel_gap=self.voxel_gap / metre,
            seed=self.seed,
            ctx=ctx.part(0.4, 0.9),
        )
        labels = none_labelled(len(points.index))
        wire_id, span_id, tower_id = (labels[name] for name in LABEL_NUMBERS)
        tower_id[points.own] = tower
        wire_id[points.own[high]] = 1
        widths = tolerances(self.wire_tolerance, metre)
        corridor = Corridor(air, height, high, widths[0], lambda x, y: 0.0, lambda x, y: False)
        _, voxel = uncrowded(corridor.wires, 1.0)
        wires, _ = follow(corridor, voxel, self.wire_gap / metre, widths, ctx.part(0.9, 1.0))
        for wire in wires:
            near, _, _ = on_wire(corridor, wire)
            mine = points.own[near[high[near]]]
            wire_id[mine], span_id[mine] = wire.wire, wire.span
        if not wires:
            points.warn_of_no_line()
        ctx.progress(1.0)
        return self.Outputs(
            classified=labelled(cloud, use, points.index, labels),
            wires=wire_layer(wires, points.origin, metre, cloud.crs),
            span_count=len({wire.span for wire in wires}),
        )


def voxel_lines(
    xyz: Floats,
    heights: Floats,
    *,
    height: float,
    voxel: float,
    variance: Variance,
    voxel_gap: float,
    seed: int,
    ctx: Context,
) -> tuple[Mask, Ints]:
    """True for points of wires, and the tower number of each point.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    heights : array of shape (n,), above the ground, metres
    height, voxel, variance, voxel_gap, seed : see :class:`CorridorExtractVoxels`, metres
    ctx : progress and cancellation

    Returns
    -------
    wire : array of shape (n,)
    tower : array of shape (n,), from 1, 0 for none
    """
    wire, tower = np.zeros(len(xyz), bool), np.zeros(len(xyz), np.int64)
    high = np.flatnonzero(heights > height)
    if len(high) < SAMPLE_POINTS:
        return wire, tower
    cell = np.floor(xyz[high] / voxel).astype(np.int64)
    _, of_voxel, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    of_voxel = of_voxel.ravel()
    centroid = np.column_stack([np.bincount(of_voxel, xyz[high, k]) / count for k in range(3)])
    spread = np.bincount(of_voxel, xyz[high, 2] ** 2) / count - centroid[:, 2] ** 2
    filled = count > SAMPLE_POINTS
    limit = otsu(spread[filled])
    chosen = filled & ((spread <= limit) if variance == "low" else (spread > limit))
    ctx.progress(0.2)
    direction = directions(xyz[high], of_voxel, np.flatnonzero(chosen), seed, ctx)
    grown = grow(centroid, direction, chosen, voxel, voxel_gap)
    column = np.unique(cell[:, :2], axis=0, return_inverse=True)[1].ravel()
    density = np.bincount(column)
    tall = density > otsu(density.astype(float))
    tower[high] = clusters(xyz[high], tall[column] & grown_near(centroid, grown, voxel)[of_voxel])
    bounds = boxes(xyz, tower)
    for number, (low, top) in enumerate(bounds, start=1):
        tower[((xyz[:, :2] >= low) & (xyz[:, :2] <= top)).all(axis=1)] = number
    ctx.progress(0.9)
    lines = high[grown[of_voxel]]
    lines = lines[tower[lines] == 0]
    wire[high[inside_hulls(xyz[high], xyz[lines], voxel)]] = True
    wire &= tower == 0
    return wire, tower


def otsu(values: Floats) -> float:
    """The threshold that separates two groups with the least variance within them."""
    if not len(values):
        return 0.0
    count, edges = np.histogram(values, HISTOGRAM_BINS)
    middle = (edges[:-1] + edges[1:]) / 2
    below, above = np.cumsum(count), len(values) - np.cumsum(count)
    total = np.cumsum(count * middle)
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = total / below - (total[-1] - total) / above
    between = np.nan_to_num(below * above * gap**2)
    best = np.flatnonzero(between == between.max())  # several, where no value lies between
    return float(edges[1 + best].mean())


def directions(xyz: Floats, voxel: Ints, chosen: Ints, seed: int, ctx: Context) -> Floats:
    """Direction of the line through the points of each voxel, found by RANSAC; unit vectors.

    Lines are fitted in plan and in both vertical planes; here that is one line in space, which has
    a direction also where a slope would be infinite.
    """
    rng = np.random.default_rng(seed)
    tries = math.ceil(math.log(1 - CERTAINTY) / math.log(1 - (1 - OUTLIER_SHARE) ** SAMPLE_POINTS))
    order = np.argsort(voxel, kind="stable")
    start = np.searchsorted(voxel[order], np.arange(voxel.max() + 2))
    result = np.zeros((voxel.max() + 1, 3))
    for number, which in enumerate(chosen):
        if number % 200 == 0:
            ctx.progress(0.2 + 0.5 * number / len(chosen))
        points = xyz[order[start[which] : start[which + 1]]]
        pairs = rng.integers(0, len(points), (tries, SAMPLE_POINTS))
        step = points[pairs[:, 1]] - points[pairs[:, 0]]
        size = np.linalg.norm(step, axis=1)
        step, first = step[size > 0] / size[size > 0, None], points[pairs[size > 0, 0]]
        if not len(step):
            continue
        away = np.linalg.norm(np.cross(points[None] - first[:, None], step[:, None]), axis=2)
        result[which] = step[int((away < NEAR_LINE).sum(axis=1).argmax())]
    return result


def grow(centroid: Floats, direction: Floats, chosen: Mask, voxel: float, gap: float) -> Mask:
    """Voxels in connected groups: near each other, with lines of the same direction.

    As printed, voxels among the 26 neighbours must be nearer than 20 m, which all of them are; so
    any voxel within the gap may follow if its line agrees, and lies in the direction of both.
    """
    some = np.flatnonzero(chosen & (np.abs(direction).sum(axis=1) > 0))
    grown = np.zeros(len(centroid), bool)
    if len(some) < LEAST_VOXELS:
        return grown
    pairs = cKDTree(centroid[some]).query_pairs(gap, output_type="ndarray")
    one, other = some[pairs[:, 0]], some[pairs[:, 1]]
    step = centroid[other] - centroid[one]
    size = np.linalg.norm(step, axis=1)
    next_to = size < math.sqrt(3) * voxel * 1.5
    step /= np.maximum(size, 1e-9)[:, None]
    alike = np.abs((direction[one] * direction[other]).sum(axis=1)) > math.cos(LARGEST_ANGLE)
    ahead = np.abs((step * direction[one]).sum(axis=1)) > math.cos(LARGEST_ANGLE / 3)
    linked = pairs[alike & (next_to | ahead)]
    graph = coo_array((np.ones(len(linked)), linked.T), shape=(len(some), len(some)))
    _, label = connected_components(graph, directed=False)
    grown[some] = np.bincount(label)[label] >= LEAST_VOXELS
    return grown


def grown_near(centroid: Floats, grown: Mask, voxel: float) -> Mask:
    """Voxels near those of the wires in plan, where towers may stand."""
    if not grown.any():
        return np.zeros(len(centroid), bool)
    away, _ = cKDTree(centroid[grown, :2]).query(centroid[:, :2])
    return np.asarray(away < 2 * voxel)


def clusters(xyz: Floats, tall: Mask) -> Ints:
    """Tower number of each point; towers are more than TOWER_SPACING apart."""
    number = np.zeros(len(xyz), np.int64)
    if not tall.any():
        return number
    cells, cell = np.unique(np.floor(xyz[tall, :2]), axis=0, return_inverse=True)
    pairs = cKDTree(cells).query_pairs(TOWER_SPACING, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(cells), len(cells)))
    number[tall] = 1 + connected_components(graph, directed=False)[1][cell.ravel()]
    return number


def boxes(xyz: Floats, tower: Ints) -> list[tuple[Floats, Floats]]:
    """Bounding box of each tower in plan."""
    found = []
    for number in range(1, int(tower.max(initial=0)) + 1):
        plan = xyz[tower == number, :2]
        found.append((plan.min(axis=0), plan.max(axis=0)))
    return found


def inside_hulls(xyz: Floats, lines: Floats, voxel: float) -> Mask:
    """True for points within the concave hull of the wires in plan, and near them in space."""
    if len(lines) < 4:
        return np.zeros(len(xyz), bool)
    hull = shapely.concave_hull(shapely.MultiPoint(lines[:, :2]), HULL_TIGHTNESS).buffer(NEAR_LINE)
    shapely.prepare(hull)
    inside = shapely.contains_xy(hull, xyz[:, 0], xyz[:, 1])
    away, near = cKDTree(lines).query(xyz, distance_upper_bound=voxel)
    return np.asarray(inside & (away < voxel / 2) & (near < len(lines)))
