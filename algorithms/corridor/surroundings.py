"""Points near the wires of a power line, seen from above."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.corridor._clearance.distances import TAKES_NO_PART, UNCLASSIFIED, own_points
from algorithms.corridor._clearance.surroundings import KIND_CLASSES, line_of
from algorithms.corridor._extraction.labels import classes_of
from algorithms.corridor._extraction.layers import missing_columns
from algorithms.shared import parameters
from algorithms.shared.lowest import require_finite
from algorithms.shared.polygons import Polygons, geometries
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Vector
from toolbox.declare import Share, outputs, param, sink, source, tool

ARC = 64  # edges of a quarter of a circle: within a ten-thousandth of its radius


@tool(
    "corridor.surroundings",
    title="Points near power lines",
    tags=(
        "power",
        "line",
        "corridor",
        "buffer",
        "subset",
    ),
)
class CorridorSurroundings:
    """Choose the points near the wires of a power line.

    Near is seen from above: heights do not matter. So what matters to a line is worked on without
    the rest of the survey: models.power_line_clearance tells trees from buildings only there.
    Where there is no wire, no point is near. Points without a class that are so near to a wire, or
    to its end, that corridor.clearance takes them for a part of the line, are left out.
    """

    points: PointCloud = source("Points to choose from")
    wires: Vector = source("Catenaries of the conductors", shapes="line")
    to_side: float = param(
        "Distance to the side of the wires; that from which a tree may fall on one by default",
        default=60.0,
        unit="m",
        gt=0.0,
        le=1000.0,
        label="Distance to the side",
    )
    wire_radius: float = parameters.wire_radius()
    attachment: float = parameters.attachment()

    @outputs
    class Outputs:
        near: PointCloud = sink(
            "The points near the wires, otherwise unchanged", label="Points near wires"
        )
        removed_share: float = sink("Share of points removed", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The wires have the columns of catenaries."""
        if problem := missing_columns(self.wires):
            yield "wires", problem

    def halo(self) -> float:
        """Zero, as each point is judged by itself."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> CorridorSurroundings.Outputs:
        """Choose the points."""
        cloud = self.points
        require_finite(cloud.xyz)
        lines = shapely.force_2d(geometries(self.wires))
        strips = shapely.buffer(lines, self.to_side, quad_segs=ARC)
        near = Polygons.of(shapely.get_parts(shapely.union_all(strips))).hold(cloud.xyz, ctx=ctx)
        near[near] = ~self._of_the_line(cloud.select(near))
        if not near.any() and cloud.origin is None:  # a tile may well have none
            log.info("no point is near a wire")
        ctx.progress(1.0)
        return self.Outputs(
            near=cloud.select(near), removed_share=Share.of_points(~near, cloud.core)
        )

    def _of_the_line(self, near: PointCloud) -> NDArray[np.bool_]:
        """True for points without a class on a wire or at an end of one."""
        line, metre = line_of(self.wires), near.metre
        if not line.spans:
            return np.zeros(len(near), bool)
        without = np.isin(classes_of(near), KIND_CLASSES["unclassified"])
        return own_points(
            np.ascontiguousarray((near.xyz - line.origin) / metre),
            np.where(without, np.int8(UNCLASSIFIED), TAKES_NO_PART),
            line.curves[0],
            radius=self.wire_radius / metre,
            attachment=self.attachment / metre,
        )
