"""Points near the wires of a power line, seen from above."""

from __future__ import annotations

from collections.abc import Iterator

import shapely

from algorithms.shared.lowest import require_finite
from algorithms.shared.polygons import Polygons, geometries
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Vector
from toolbox.declare import Share, outputs, param, sink, source, tool

LINES = ("LineString", "MultiLineString")
ARC = 64  # edges of a quarter of a circle: within a ten-thousandth of its radius


@tool("corridor.surroundings")
class CorridorSurroundings:
    """Choose the points near the wires of a power line.

    Near is seen from above: heights do not matter. So what matters to a line is worked on without
    the rest of the survey: models.power_line_clearance tells trees from buildings only there.
    Where there is no wire, no point is near.
    """

    points: PointCloud = source("Points to choose from")
    wires: Vector = source("Lines in plan, as the wires of corridor.extract")
    reach: float = param(
        "Distance to the side of the wires; that from which a tree may fall on one by default",
        default=60.0,
        unit="m",
        gt=0.0,
        le=1000.0,
    )

    @outputs
    class Outputs:
        near: PointCloud = sink("The points near the wires, otherwise unchanged")
        removed_share: float = sink("Share of points removed", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The wires are lines."""
        others = set(self.wires.frame.geom_type.dropna()) - {*LINES}
        if others:
            yield "wires", f"must be lines, {self.wires.name} holds a {min(others)}"

    def halo(self) -> float:
        """Zero, as each point is judged by itself."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> CorridorSurroundings.Outputs:
        """Choose the points."""
        cloud = self.points
        require_finite(cloud.xyz)
        lines = shapely.force_2d(geometries(self.wires))
        strips = shapely.buffer(lines, self.reach, quad_segs=ARC)
        near = Polygons.of(shapely.get_parts(shapely.union_all(strips))).hold(cloud.xyz, ctx=ctx)
        if not near.any() and cloud.origin is None:  # a tile may well have none
            log.info("no point is near a wire")
        ctx.progress(1.0)
        return self.Outputs(
            near=cloud.select(near), removed_share=Share.of_points(~near, cloud.core)
        )
