"""Features brought to another CRS.

Which operation is taken, and what is refused: docs/explanation/reference-systems.md.
"""

from __future__ import annotations

import shapely
from pyproj import CRS

from algorithms.shared import parameters
from algorithms.shared.reprojection import chosen, operation_table
from toolbox.context import QUIET, Context
from toolbox.data import Table, Vector, reprojecting
from toolbox.data.crs import is_local
from toolbox.data.operation import MissingGrid
from toolbox.data.reprojecting import unit_of_plan
from toolbox.declare import DataFile, outputs, param, sink, source, tool


@tool(
    "vectors.reproject",
    title="Reproject features",
    tags=(
        "reproject",
        "crs",
        "transform",
        "kml",
        "epsg",
    ),
)
class VectorsReproject:
    """Reproject features.

    The operation is chosen as in points.reproject. Vertices are moved, and edges stay straight
    between them: with `max_edge`, vertices are put into long edges first, so that these follow the
    curve which a straight line of the one CRS is in the other. Z is moved where features have it;
    without it, they need no height system.
    """

    features: Vector = source("Features to reproject", any_crs=True)
    crs: CRS = parameters.target_crs()
    max_edge: float | None = param(
        "Longest edge; longer ones get vertices first", default=None, unit="m", gt=0
    )
    geoid: DataFile | None = parameters.geoid()
    epoch: float | None = parameters.epoch()
    missing_grid: MissingGrid = parameters.missing_grid()

    @outputs
    class Outputs:
        reprojected: Vector = sink("The features in the new CRS", also=(".city.json", ".ifc"))
        operation: Table = sink("What was done: property, value, unit")

    def halo(self) -> float:
        """Zero, as each feature moves by itself."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> VectorsReproject.Outputs:
        """Choose the operation, and move the vertices."""
        layer = self.features
        ctx.progress(0.0)
        way = chosen(
            "features",
            layer,
            self.crs,
            heights=bool(layer.frame.has_z.any()),
            geoid=self.geoid,
            epoch=self.epoch,
            missing_grid=self.missing_grid,
        )
        if self.max_edge is not None and layer.crs is not None:
            degrees = layer.crs.is_geographic and not is_local(layer.crs)
            longest = self.max_edge / (unit_of_plan(layer.crs) if degrees else 1.0)
            frame = layer.frame
            shapes = shapely.segmentize(frame.geometry.to_numpy(), longest)
            layer = Vector(frame.set_geometry(shapes, crs=layer.crs), name=layer.name)
        moved = reprojecting.features(layer, way)
        ctx.progress(1.0)
        return self.Outputs(reprojected=moved, operation=operation_table(way, self.geoid))
