"""An index of files of points, which programs open as one cloud."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from toolbox.context import QUIET, Context
from toolbox.data import Survey
from toolbox.data.paths import is_copc
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

    From afar QGIS shows the `overview`, where there is one: a COPC file of a part of the points,
    such as points.thin makes of the index.
    """

    points: Survey = source("Files to index: a folder, a pattern or a list")
    overview: Survey | None = source(
        "COPC file of a part of the points, shown from afar", default=None
    )

    @outputs
    class Outputs:
        index: Survey = sink("The index, one item per file")
        count: int = sink("Number of points of all files", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The overview is one COPC file."""
        if self.overview is not None:
            files = self.overview.files
            names = ", ".join(file.path.name for file in files)
            if len(files) != 1 or not is_copc(files[0].path):
                yield "overview", f"must be one COPC file (.copc.laz), got {names}"
            elif not files[0].copc:
                yield "overview", f"{names} is no COPC file by its content; write it as one"

    def halo(self) -> float:
        """Zero, as no point is read."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> PointsIndex.Outputs:
        """Give the headers on."""
        ctx.progress(1.0)
        overview = self.overview.paths[0] if self.overview else None
        index = dataclasses.replace(self.points, overview=overview)
        return self.Outputs(index=index, count=self.points.count)
