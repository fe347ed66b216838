"""Points brought to another CRS.

Which operation is taken, and what is refused: docs/explanation/reference-systems.md.
"""

from __future__ import annotations

from pyproj import CRS

from algorithms.shared import parameters
from algorithms.shared.reprojection import chosen, operation_table
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Table, reprojecting
from toolbox.data.operation import MissingGrid
from toolbox.declare import DataFile, outputs, sink, source, tool


@tool(
    "points.reproject",
    title="Reproject points",
    tags=(
        "reproject",
        "crs",
        "transform",
        "warp",
        "feet",
        "geoid",
        "epsg",
    ),
)
class PointsReproject:
    """Reproject points.

    The best operation that PROJ knows for the place is taken, and its name and accuracy are told.
    If a grid that it needs is not installed, that is an error which names the grid, unless
    `missing_grid` allows the next best. Heights follow the vertical part of the CRS: from one
    height system to another, by a grid or by a `geoid` of your own; where the target states none,
    heights keep theirs; where no CRS says more, they are in the unit of the plan and change with
    it, so that feet become metres.

    LAS holds the new coordinates in steps of a power of ten, at most half of those before and at
    most 1 mm. All attributes stay; those that are heights by their description change the unit.
    """

    points: PointCloud = source("Points to reproject", any_crs=True)
    crs: CRS = parameters.target_crs()
    geoid: DataFile | None = parameters.geoid()
    epoch: float | None = parameters.epoch()
    missing_grid: MissingGrid = parameters.missing_grid()

    @outputs
    class Outputs:
        reprojected: PointCloud = sink("The points in the new CRS")
        operation: Table = sink("What was done: property, value, unit")

    def halo(self) -> float:
        """Zero, as each point moves by itself."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> PointsReproject.Outputs:
        """Choose the operation, and move the points."""
        cloud = self.points
        ctx.progress(0.0)
        way = chosen(
            "points",
            cloud,
            self.crs,
            heights=True,
            geoid=self.geoid,
            epoch=self.epoch,
            missing_grid=self.missing_grid,
        )
        moved = reprojecting.points(cloud, way, ctx=ctx.part(0.1, 1.0))
        return self.Outputs(reprojected=moved, operation=operation_table(way, self.geoid))
