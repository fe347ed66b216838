"""An index of files of points, which programs open as one cloud."""

from __future__ import annotations

from toolbox.context import QUIET, Context
from toolbox.data import Survey
from toolbox.declare import outputs, sink, source, tool


@tool(
    "points.index",
    title="Index of point cloud files",
    tags=(
        "vpc",
        "virtual-point-cloud",
        "stac",
        "tile-index",
        "catalog",
        "mosaic",
    ),
)
class PointsIndex:
    """Make a virtual point cloud (VPC) of files of points.

    Only headers are read. QGIS, PDAL and this toolbox open the index as one cloud. The files stay
    where they are, and are named relative to it: move them together. COPC files (.copc.laz) show
    at once in QGIS, others as outlines.
    """

    points: Survey = source("Files to index: a folder, a pattern or a list")

    @outputs
    class Outputs:
        index: Survey = sink("The index, one item per file")
        count: int = sink("Number of points of all files", unit="1")

    def halo(self) -> float:
        """Zero, as no point is read."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> PointsIndex.Outputs:
        """Give the headers on."""
        ctx.progress(1.0)
        return self.Outputs(index=self.points, count=self.points.count)
