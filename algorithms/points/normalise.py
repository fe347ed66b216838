"""Heights above the ground as z, and back."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from algorithms.shared import parameters
from algorithms.shared.above_ground import height_above_ground
from algorithms.shared.ground import is_withheld
from algorithms.shared.heights import HEIGHT
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud
from toolbox.data.crs import vertical_unit
from toolbox.declare import ClassList, outputs, param, sink, source, tool
from toolbox.errors import DataError, NothingToDo

ELEVATION = "elevation"  # attribute that keeps what z was


@tool(
    "points.normalise",
    title="Normalise heights",
    tags=(
        "normalize",
        "height-above-ground",
        "hag",
        "flatten",
        "canopy",
        "lasheight",
    ),
)
class PointsNormalise:
    """Put the height above the ground in the place of z, as programs for forests want it.

    The height is the attribute HeightAboveGround if the points have it, else that above the
    triangulation of the ground points. What z was stays as the attribute `elevation`, and with
    `undo` comes back from it, bit for bit. Only z changes: the CRS still names its height system,
    which the new z is not measured in.
    """

    points: PointCloud = source("Points with classified ground, or normalised ones to undo")
    undo: bool = param("Bring the elevation back", default=False)
    ground_classes: ClassList = parameters.ground_classes()

    @outputs
    class Outputs:
        normalised: PointCloud = sink("The points with heights above ground as z, or as they were")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """There is what heights, or elevations, are taken from."""
        names = self.points.names
        if self.undo and ELEVATION not in names:
            yield "undo", f"{self.points.name} has no attribute {ELEVATION} to bring back"
        elif not self.undo and ELEVATION in names:
            yield "points", f"{self.points.name} has an {ELEVATION}; is it normalised already?"
        elif not self.undo and not {HEIGHT, "classification"} & set(names):
            yield "points", f"{self.points.name} has no classification; classify ground first"

    def halo(self) -> float:
        """Infinite, as triangles of the ground may be of any size."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> PointsNormalise.Outputs:
        """Exchange z."""
        cloud = self.points
        if self.undo:
            ctx.progress(1.0)
            made = cloud.with_xyz(np.column_stack([cloud.xyz[:, :2], cloud[ELEVATION]]))
            return self.Outputs(normalised=made.without_attributes([ELEVATION]))
        heights = self._heights(ctx)
        if unknown := np.count_nonzero(~np.isfinite(heights)):
            text = f"{unknown} of {len(heights)} points of {cloud.name} have no {HEIGHT}"
            raise DataError(f"points: {text}; give them one, or filter them out first")
        unit = f", {vertical_unit(cloud.crs)}" if cloud.crs else ""
        kept = cloud.with_attributes(
            {ELEVATION: cloud.xyz[:, 2]}, descriptions={ELEVATION: f"before normalising{unit}"}
        )
        made = kept.with_xyz(np.column_stack([cloud.xyz[:, :2], heights]))
        return self.Outputs(normalised=made)

    def _heights(self, ctx: Context) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Height of each point above the ground, in the unit of the data."""
        cloud = self.points
        if HEIGHT in cloud:
            ctx.progress(1.0)
            return np.asarray(cloud[HEIGHT], np.float64)
        ground = np.isin(cloud["classification"], self.ground_classes) & ~is_withheld(cloud)
        if not ground.any():
            text = f"points: none is of class {self.ground_classes}; classify them first"
            raise NothingToDo(text, instead=self.Outputs(normalised=cloud))
        return height_above_ground(cloud.xyz, cloud.xyz[ground], ctx=ctx)
