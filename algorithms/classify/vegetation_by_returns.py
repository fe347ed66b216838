"""Vegetation by first and last returns, without the edges of buildings.

References
----------
Demir, N. and Acar, U.: more than 4 m between the first and the last pulse is vegetation; what lies
on edges that the Canny operator finds in a raster of the buildings is not.
Canny, J. (1986). A computational approach to edge detection. IEEE Transactions on Pattern Analysis
and Machine Intelligence 8(6), 679-698.

What it can see, and how well: docs/explanation/urban-classes.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from algorithms.classify._canny import TRUNCATE, canny
from algorithms.classify._heights import PLANTS, by_height
from algorithms.classify._pulses import How, pulses
from algorithms.shared import parameters
from algorithms.shared.ground import GROUND, taking_part
from algorithms.shared.heights import HEIGHT
from algorithms.shared.returns import NAMES as RETURNS
from toolbox.context import QUIET, Context
from toolbox.data import Lattice, PointCloud
from toolbox.declare import ClassList, Share, outputs, param, sink, source, tool
from toolbox.errors import NothingToDo

REACH = 20  # cells that a weak edge may go on
PULSE = 50.0  # metres between the returns of a pulse, in plan

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@tool(
    "classify.vegetation_by_returns",
    title="Classify vegetation (returns)",
    tags=(
        "vegetation",
        "tree",
        "canopy",
        "penetration",
        "multiple",
        "returns",
        "pulse",
    ),
)
class ClassifyVegetationByReturns:
    """Classify as vegetation what lets pulses through, but not the edges of buildings.

    Where the first return of a pulse is more than `difference` above its last, all its returns but
    the last become vegetation. At the edge of a roof, too, a pulse has one return from the roof and
    one from the ground. So the points of `building_classes` are put into a raster, and returns
    within `edge_reach` of the edges that the Canny operator finds in it, and in space of a point of
    the building, are left out. Classify the buildings first.

    That sees tall plants only, and only where a pulse got through. With `spread` points that are
    neither ground nor building become vegetation if they are so near to one that is.

    The class is low (3), medium (4) or high vegetation (5) by HeightAboveGround if points have it,
    or else by the height above the last return. Other points keep their class, and become 1
    if that was vegetation.

    Returns belong to one pulse if their GPS time, flight line and channel agree; in files without
    times, if they follow each other, or all first returns come before all last ones in the same
    order: `pairs` order. If neither is so they are paired by their places, with a warning.
    """

    points: PointCloud = source("Points with classified buildings")
    difference: float = param(
        "How far the first return is above the last at least", default=4.0, unit="m", gt=0
    )
    pairs: How = param(
        "How returns of one pulse are found",
        default="gps_time",
        label="Returns of a pulse are found by",
        words={"gps_time": "GPS time", "order": "Order in the file"},
    )
    building_classes: ClassList | None = param("Classes that are buildings", default=ClassList([6]))
    edge_reach: float = param(
        "Reach of an edge: footprint of the laser and error of its position",
        default=1.0,
        unit="m",
        ge=0,
        le=10,
        label="Reach of an edge",
    )
    cell: float = param("Size of the cells", default=0.5, unit="m", gt=0, le=5, label="Cell size")
    sigma: float = param(
        "Canny: standard deviation of the Gaussian, in cells",
        default=1.0,
        unit="1",
        gt=0,
        le=10,
        label="Smoothing (Canny)",
    )
    weak: float = param(
        "Canny: step per cell of weak edges, as a share of difference",
        default=0.1,
        unit="1",
        gt=0,
        label="Weak edges (Canny)",
    )
    strong: float = param(
        "Canny: step per cell of strong edges, as a share of difference",
        default=0.2,
        unit="1",
        gt=0,
        label="Strong edges (Canny)",
    )
    spread: float = param(
        "Points this near to vegetation are vegetation; 0 for returns of such pulses alone",
        default=0.0,
        unit="m",
        ge=0,
        le=10,
    )
    low: float = parameters.low_ends()
    high: float = parameters.high_begins()
    ignore: ClassList | None = parameters.ignore()
    keep_classes: ClassList | None = parameters.keep_classes()

    @outputs
    class Outputs:
        classified: PointCloud = sink("The same points with vegetation", label="Classified points")
        vegetation_share: float = sink("Share of points that became vegetation", unit="1")
        candidates: int = sink("Points with returns far enough below them", unit="1")
        removed: int = sink("Of these, points on edges of buildings", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """The limits are in order."""
        if self.weak > self.strong:
            yield "weak", f"must be <= strong ({self.strong:g}), got {self.weak:g}"
        if self.low > self.high:
            yield "low", f"must be <= high ({self.high:g}), got {self.low:g}"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have return numbers, GPS times to pair them by time, and classes."""
        cloud, name = self.points, self.points.name or "the cloud"
        if lacking := [wanted for wanted in RETURNS if wanted not in cloud]:
            yield "points", f"{name} has no {' and '.join(lacking)}"
        if self.pairs == "gps_time" and "gps_time" not in cloud:
            yield "pairs", f"{name} has no gps_time; use order if the points are as scanned"
        if self.building_classes and "classification" not in cloud:
            yield "building_classes", f"{name} has no classification; classify buildings first"

    def halo(self) -> float:
        """Reach of the returns of a pulse, of edges, and of the spread."""
        if self.pairs == "order":
            return math.inf  # a tile has not all points between two
        cells = REACH + TRUNCATE * self.sigma + 3
        return PULSE + cells * self.cell + self.edge_reach + self.spread

    def run(self, ctx: Context = QUIET) -> ClassifyVegetationByReturns.Outputs:
        """Find candidates, leave out those on edges of buildings, and spread."""
        cloud = self.points
        part = taking_part(cloud, self.ignore, self.keep_classes)
        chosen = cloud if part.all() else cloud.select(part)
        candidate, above = self._candidates(part)
        candidate, above = candidate[part], above[part]
        ctx.progress(0.3)
        removed = candidate & self._on_edges(chosen, candidate)
        ctx.progress(0.7)
        plant, above = self._spread(chosen, candidate & ~removed, above)
        ctx.progress(0.9)
        found, height = np.zeros(len(cloud), bool), np.full(len(cloud), np.nan)
        found[part], height[part] = plant, above
        made = self._packed(part, found, height)
        ctx.progress(1.0)
        core = chosen.core
        return self.Outputs(
            classified=made,
            vegetation_share=Share.of_points(found, cloud.core),
            candidates=int(np.count_nonzero(candidate & core)),
            removed=int(np.count_nonzero(removed & core)),
        )

    def _candidates(self, part: Mask) -> tuple[Mask, Floats]:
        """True for returns far enough above the last one of their pulse, and their height above it.

        Pulses are looked for among all points, and those with a return that takes no part are left.

        Raises
        ------
        NothingToDo
            There are no pulses with a first and a last return.
        """
        cloud = self.points
        members, first, last = pulses(cloud, self.pairs)
        own = part[members] & part[first] & part[last]
        members, first, last = members[own], first[own], last[own]
        if not len(members):
            none = np.zeros(len(cloud), bool)
            raise NothingToDo(
                "points: no pulse has both its first and its last return",
                instead=self.Outputs(
                    classified=self._packed(none, none, np.full(len(cloud), np.nan)),
                    vegetation_share=Share.of_points(none, cloud.core),
                    candidates=0,
                    removed=0,
                ),
            )
        z = cloud.xyz[:, 2]
        far = (z[first] - z[last] > self.difference) & (members != last)
        candidate, above = np.zeros(len(cloud), bool), np.full(len(cloud), np.nan)
        candidate[members[far]] = True
        above[members] = z[members] - z[last]
        return candidate, above

    def _on_edges(self, cloud: PointCloud, candidate: Mask) -> Mask:
        """True for candidates near an edge of a building in plan, and near its points in space."""
        on_edge = np.zeros(len(cloud), bool)
        if not self.building_classes:
            return on_edge
        built = np.isin(cloud["classification"], self.building_classes)
        if not built.any():
            return on_edge
        xyz = cloud.xyz
        lattice = Lattice.cover((*xyz[:, :2].min(axis=0), *xyz[:, :2].max(axis=0)), self.cell)
        row, col = lattice.indices(xyz[:, 0], xyz[:, 1])
        lowest, top = np.full(lattice.shape, np.inf), np.full(lattice.shape, -np.inf)
        np.minimum.at(lowest, (row, col), xyz[:, 2])
        np.maximum.at(top, (row[built], col[built]), xyz[built, 2])
        surface = filled(np.where(top > -np.inf, top, lowest)) / self.difference
        edges = canny(surface, self.sigma, self.weak, self.strong, REACH)
        near = distance_transform_edt(~edges) * self.cell <= self.edge_reach + self.cell / 2
        some = np.flatnonzero(candidate)
        some = some[near[row[some], col[some]]]
        away, _ = cKDTree(xyz[built]).query(xyz[some])
        on_edge[some] = away <= self.edge_reach
        return on_edge

    def _spread(self, cloud: PointCloud, plant: Mask, above: Floats) -> tuple[Mask, Floats]:
        """True for vegetation and the points near it, and the heights of both."""
        if HEIGHT in cloud:
            above = cloud[HEIGHT].astype(np.float64)
        if not (self.spread and plant.any() and "classification" in cloud):
            return plant, above
        fixed = np.isin(cloud["classification"], (GROUND, *(self.building_classes or ())))
        others = np.flatnonzero(~plant & ~fixed)
        tree = cKDTree(cloud.xyz[plant])
        away, _ = tree.query(cloud.xyz[others], distance_upper_bound=self.spread)
        plant = plant.copy()
        plant[others[np.isfinite(away)]] = True
        return plant, above

    def _packed(self, part: Mask, found: Mask, height: Floats) -> PointCloud:
        cloud = self.points
        old = cloud["classification"] if "classification" in cloud else np.ones(len(cloud), "u1")
        classes = np.where(part & np.isin(old, PLANTS), 1, old).astype(np.uint8)
        classes[found] = by_height(height[found], self.low, self.high)
        return cloud.with_attributes({"classification": classes})


def filled(values: Floats) -> Floats:
    """A raster in which infinite cells have the value of the nearest finite one."""
    index = distance_transform_edt(np.isinf(values), return_distances=False, return_indices=True)
    return np.asarray(values[tuple(index)])
