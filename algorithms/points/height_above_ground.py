"""Height of every point above the ground below it.

The ground is the Delaunay triangulation of the ground points, or those of them that are nearest.

References
----------
Shepard, D. (1968). A two-dimensional interpolation function for irregularly-spaced data. ACM
National Conference, 517-524: inverse distance weighting.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.shared import parameters
from algorithms.shared.delaunay import triangulate
from algorithms.shared.ground import is_withheld
from algorithms.shared.heights import HEIGHT
from algorithms.shared.lowest import require_finite
from algorithms.shared.places import averaged
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud
from toolbox.data.crs import vertical_unit
from toolbox.declare import ClassList, outputs, param, sink, source, tool
from toolbox.errors import DataError, NothingToDo

BLOCK = 200_000  # points between two checks for cancellation

Method = Literal["tin", "nearest"]
Floats = NDArray[np.float64]


@tool(
    "points.height_above_ground",
    title="Height above ground",
    tags=(
        "hag",
        "normalise",
        "normalize",
        "height",
        "above",
        "ground",
        "agl",
        "ndsm",
        "chm",
    ),
)
class PointsHeightAboveGround:
    """Add the attribute HeightAboveGround, the height of each point above the ground below it.

    `tin` takes the ground from the Delaunay triangulation of the ground points, and outside of it
    from the nearest ground point. `nearest` takes the nearest ground point in plan, or with
    `count` several of them weighted by their inverse distance. Ground points at one position are
    averaged, all others are used. Classify the ground first.

    The height is in the unit of the data, and not a number (NaN) beyond `max_distance`.
    """

    points: PointCloud = source("Points with classified ground")
    method: Method = param(
        "How to find the ground below a point",
        default="tin",
        words={"tin": "Triangulation (TIN)", "nearest": "Nearest ground point"},
    )
    ground_classes: ClassList = parameters.ground_classes()
    count: int = param(
        "Ground points used for each point, for nearest", default=1, unit="1", ge=1, le=1000
    )
    max_distance: float | None = param(
        "Farthest ground point in plan that is used; any by default",
        default=None,
        unit="m",
        gt=0,
        label="Farthest ground point",
    )

    @outputs
    class Outputs:
        heights: PointCloud = sink(
            "The same points with the attribute HeightAboveGround", label="Points with heights"
        )
        without_height: int = sink("Points too far from the ground to have a height", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """The count of ground points is 1 for method tin."""
        if self.method == "tin" and self.count != 1:
            yield "count", f"is for method nearest; must be 1 with tin, got {self.count}"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have classes."""
        if "classification" not in self.points:
            yield "points", f"{self.points.name} has no classification; classify ground first"

    def halo(self) -> float:
        """Infinite, as triangles may be of any size; with method nearest the maximum distance."""
        return self.max_distance if self.method == "nearest" and self.max_distance else math.inf

    def run(self, ctx: Context = QUIET) -> PointsHeightAboveGround.Outputs:
        """Measure each point from the ground."""
        cloud = self.points
        of_class = np.isin(cloud["classification"], self.ground_classes)
        ground = of_class & ~is_withheld(cloud)
        if not ground.any():
            which = f"of class {self.ground_classes}"
            withheld = f"all {np.count_nonzero(of_class)} points {which} are withheld"
            missing = f"none is {which}; classify them first"
            raise NothingToDo(
                f"points: {withheld if of_class.any() else missing}",
                instead=self._outputs(np.full(len(cloud), np.nan)),
            )
        heights = height_above_ground(
            cloud.xyz,
            cloud.xyz[ground],
            method=self.method,
            count=self.count,
            max_distance=self.max_distance,
            ctx=ctx,
        )
        unknown = int(np.isnan(heights).sum())
        if unknown:
            log.warning("%d of %d points are too far from the ground", unknown, len(heights))
        return self._outputs(heights)

    def _outputs(self, heights: Floats) -> PointsHeightAboveGround.Outputs:
        cloud = self.points
        unit = f", {vertical_unit(cloud.crs)}" if cloud.crs else ""
        return self.Outputs(
            heights=cloud.with_attributes(
                {HEIGHT: heights.astype(np.float32)}, descriptions={HEIGHT: f"above ground{unit}"}
            ),
            without_height=int(np.count_nonzero(np.isnan(heights) & cloud.core)),
        )


def height_above_ground(
    xyz: Floats,
    ground_xyz: Floats,
    *,
    method: Method = "tin",
    count: int = 1,
    max_distance: float | None = None,
    ctx: Context = QUIET,
) -> Floats:
    """Height of points above the ground.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    ground_xyz : array of shape (m, 3); points at one position are averaged
    method : "tin" for the plane of the Delaunay triangle, and the nearest ground point outside of
        all triangles; "nearest" for the nearest ground points in plan
    count : ground points used with "nearest", weighted by the inverse of their distance
    max_distance : NaN where no ground point is within this distance in plan, in the unit of xyz
    ctx : progress and cancellation

    Returns
    -------
    array of shape (n,)
        In the unit of xyz, below zero under the ground; the same for any order of the points.

    Raises
    ------
    DataError
        There is no ground point.
    ValueError
        A coordinate is not a finite number.
    """
    for points in (xyz, ground_xyz):
        require_finite(points)
    if not len(ground_xyz):
        raise DataError("points: there is no ground to measure heights from")
    # Measured from near by, sums and products of coordinates keep all their digits.
    origin = np.floor(ground_xyz[:, :2].min(axis=0))
    places = xyz[:, :2] - origin
    ground, elevation = averaged(ground_xyz[:, :2] - origin, ground_xyz[:, 2])
    ctx.progress(0.1)
    below = np.full(len(xyz), np.nan)
    if method == "tin":
        below = _on_facets(ground, elevation, places, ctx.part(0.1, 0.8))
    tree = cKDTree(ground)
    for some in _blocks(np.flatnonzero(np.isnan(below)), ctx.part(0.8, 0.9)):
        below[some] = _from_nearest(tree, elevation, places[some], count)
    if max_distance is not None:
        for some in _blocks(np.arange(len(xyz)), ctx.part(0.9, 1.0)):
            near, _ = tree.query(places[some])
            below[some[near > max_distance]] = np.nan
    ctx.progress(1.0)
    return np.asarray(xyz[:, 2] - below)


def _on_facets(ground: Floats, elevation: Floats, places: Floats, ctx: Context) -> Floats:
    """Elevation at positions in the Delaunay triangulation of the ground, NaN outside of it."""
    try:
        mesh = triangulate(ground, ctx=ctx.part(0.0, 0.5))
    except DataError:  # fewer than three ground points, or all of them on a line
        log.info("the ground spans no triangle; heights are from the nearest ground point")
        return np.full(len(places), np.nan)
    return mesh.interpolate(elevation, places, ctx=ctx.part(0.5, 1.0))


def _from_nearest(tree: cKDTree, elevation: Floats, places: Floats, count: int) -> Floats:
    """Elevation at positions: inverse-distance mean of the nearest `count` points of the tree."""
    count = min(count, tree.n)
    distance, index = (np.asarray(a) for a in tree.query(places, range(1, count + 2)))
    for row in np.flatnonzero(distance[:, count] == distance[:, count - 1]):
        # Which of equally near points the tree finds depends on all others; take the first.
        reach = distance[row, count] * (1 + 1e-12)
        near = np.sort(tree.query_ball_point(places[row], reach))
        away = np.hypot(*(tree.data[near] - places[row]).T)
        order = np.argsort(away.round(9), kind="stable")[:count]
        distance[row, :count], index[row, :count] = away[order], near[order]
    distance, index = distance[:, :count], index[:, :count]
    exact = distance[:, 0] == 0
    distance[exact] = np.where(distance[exact] == 0, 1, np.inf)
    weight = distance[:, :1] / distance  # relative, so that nothing overflows
    return np.asarray((weight * elevation[index]).sum(axis=1) / weight.sum(axis=1))


def _blocks(indices: NDArray[np.int64], ctx: Context) -> Iterator[NDArray[np.int64]]:
    """Blocks of BLOCK indices, with progress after each."""
    for start in range(0, len(indices), BLOCK):
        yield indices[start : start + BLOCK]
        ctx.progress(min(1.0, (start + BLOCK) / len(indices)))
