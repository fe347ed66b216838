"""Rasters brought to another CRS, each new cell taking its value from where its centre was.

Which operation is taken, and what is refused: docs/explanation/reference-systems.md.
"""

from __future__ import annotations

from collections.abc import Iterator

from pyproj import CRS

from algorithms.shared import parameters
from algorithms.shared.reprojection import chosen, operation_table
from toolbox.context import QUIET, Context
from toolbox.data import Raster, Table
from toolbox.data.crs import length_problem
from toolbox.data.operation import MissingGrid, Operation
from toolbox.data.reprojecting import unit_of_plan
from toolbox.data.resampling import Meaning, Method, cells_of, resampled
from toolbox.declare import DataFile, outputs, param, sink, source, tool
from toolbox.errors import DataError


@tool(
    "surface.reproject",
    title="Reproject raster",
    tags=(
        "reproject",
        "warp",
        "crs",
        "resample",
        "gdalwarp",
        "geoid",
        "epsg",
    ),
)
class SurfaceReproject:
    """Reproject a raster.

    The centre of each new cell is brought back to the raster, where `linear` takes the mean of the
    four cells around it by their distance, and `nearest` the cell that holds it, which keeps
    classes and integers as they are. Nothing is averaged over more cells: make a raster coarser
    before. New cells lie on whole multiples of their size.

    The operation is chosen as in points.reproject. Where it changes heights, say what the `values`
    are: elevations are moved, lengths (as heights of objects) change their unit alone, others stay.
    """

    surface: Raster = source("Raster to reproject", any_crs=True)
    crs: CRS = parameters.target_crs()
    cell: float | None = param(
        "Size of a new cell; without it, that of the old ones",
        default=None,
        unit="m",
        gt=0,
        le=10_000,
        label="Cell size",
    )
    method: Method = param("How a new cell gets its value", default="linear")
    values: Meaning | None = param("What the values are, if heights change", default=None)
    geoid: DataFile | None = parameters.geoid()
    epoch: float | None = parameters.epoch()
    missing_grid: MissingGrid = parameters.missing_grid()

    @outputs
    class Outputs:
        reprojected: Raster = sink("The raster in the new CRS")
        operation: Table = sink("What was done: property, value, unit")

    def check(self) -> Iterator[tuple[str, str]]:
        """A geoid is for elevations."""
        if self.geoid and self.values not in (None, "elevations"):
            yield "geoid", f"is for elevations, and values are {self.values}"

    def halo(self) -> float:
        """Zero; a raster comes whole."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> SurfaceReproject.Outputs:
        """Choose the operation, lay the new cells, and fill them."""
        ctx.progress(0.0)
        raster = self.surface
        way = chosen(
            "surface",
            raster,
            self.crs,
            heights=self.values != "other",
            geoid=self.geoid,
            epoch=self.epoch,
            missing_grid=self.missing_grid,
        )
        if way.moves_heights and self.values is None:
            raise DataError(
                "values: heights change by this operation; say whether the values are elevations, "
                "lengths or other, so that they are not left wrong"
            )
        lattice = cells_of(raster, way, self._cell(raster, way))
        found = resampled(raster, way, lattice, self.method, self.values, ctx=ctx.part(0.1, 1.0))
        return self.Outputs(reprojected=found, operation=operation_table(way, self.geoid))

    def _cell(self, raster: Raster, way: Operation) -> float | None:
        """The size that is asked for, in the unit of the target."""
        if self.cell is None:
            return None
        metric = length_problem(raster.crs) is None
        return self.cell / (raster.metre if metric else 1.0) / unit_of_plan(way.target)
