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

import numpy as np
from numpy.typing import NDArray

from algorithms.shared import parameters
from algorithms.shared.above_ground import Method, height_above_ground
from algorithms.shared.ground import is_withheld
from algorithms.shared.heights import HEIGHT
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud
from toolbox.data.crs import vertical_unit
from toolbox.declare import ClassList, outputs, param, sink, source, tool
from toolbox.errors import NothingToDo


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

    def _outputs(self, heights: NDArray[np.float64]) -> PointsHeightAboveGround.Outputs:
        cloud = self.points
        unit = f", {vertical_unit(cloud.crs)}" if cloud.crs else ""
        return self.Outputs(
            heights=cloud.with_attributes(
                {HEIGHT: heights.astype(np.float32)}, descriptions={HEIGHT: f"above ground{unit}"}
            ),
            without_height=int(np.count_nonzero(np.isnan(heights) & cloud.core)),
        )
