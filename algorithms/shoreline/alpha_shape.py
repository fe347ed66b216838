"""Alpha shapes: polygons around the area that points cover.

How alpha is chosen, how exact and how fast it is: docs/explanation/alpha-shapes.md.

References
----------
Edelsbrunner, H., Kirkpatrick, D. G. & Seidel, R. (1983). On the shape of a set of points in the
plane. IEEE Transactions on Information Theory 29(4), 551-559.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.shared import parameters
from algorithms.shared.alpha_shape import AlphaShape, alpha_shape
from algorithms.shared.ground import without_withheld
from algorithms.shared.lowest import require_finite
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Vector
from toolbox.declare import Attribute, ClassList, Share, outputs, param, show, sink, source, tool
from toolbox.errors import DataError, NothingToDo

if TYPE_CHECKING:
    import geopandas

OWN = ("area", "perimeter", "alpha", "points", "geometry")  # columns of the polygons


@tool(
    "shoreline.alpha_shape",
    title="Alpha shapes",
    tags=(
        "alpha",
        "shape",
        "concave",
        "hull",
        "boundary",
        "outline",
        "footprint",
    ),
)
class ShorelineAlphaShape:
    """Draw polygons around points, with bays, holes and islands.

    The alpha shape is what remains of the convex hull when a disc of radius `alpha` has rolled
    over all places that it reaches without covering a point. A small alpha follows bays and leaves
    holes, a large one bridges them. Points that lie farther apart than twice alpha are not joined.

    With `auto` alpha is the smallest for which all points lie in one region, with `all_points` the
    smallest for which every point is part of some region. One stray point makes both large: remove
    noise first, or give a length of a few point spacings.

    A hole is a patch without area that is closed in on all sides. Those smaller than
    `hole_threshold` are filled, with any islands in them; then regions smaller than
    `region_threshold` are dropped. Each polygon is one region: where two touch in a point, they
    stay two.

    With `group` each value of an attribute, such as an object number, has a shape of its own.
    Groups that do not span a triangle have none.

    The attributes area and perimeter, without holes and with their edges, and alpha are in the unit
    of the data.
    """

    points: PointCloud = source("Points to draw around")
    alpha: float | Literal["auto", "all_points"] = param(
        "Radius of the disc, or how to choose it",
        default="auto",
        unit="m",
        gt=0,
        label="Radius of the disc (alpha)",
    )
    hole_threshold: float = param(
        "Fill holes smaller than this", default=0.0, unit="m2", ge=0, label="Smallest hole"
    )
    region_threshold: float = param(
        "Drop regions smaller than this", default=0.0, unit="m2", ge=0, label="Smallest region"
    )
    classes: ClassList | None = parameters.classes()
    group: Attribute | None = param(
        "Attribute whose values each have a shape of their own",
        default=None,
        of="points",
        label="One shape for each",
    )

    @outputs
    class Outputs:
        shapes: Vector = sink("Polygons with area, perimeter, alpha, number of points and group")
        outlines: Vector = sink(
            "Their rings as lines, with the number of the polygon and kind",
            show=show.Classes("kind"),
        )
        alpha_used: float = sink("Radius of the disc; with groups the largest", unit="m")
        regions: int = sink("Number of polygons", unit="1")
        area: float = sink("Area of all polygons", unit="m2")
        outside_share: float = sink("Share of the points that are in no polygon", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have the classes, and the group has a free name."""
        if self.classes and "classification" not in self.points:
            yield "classes", f"{self.points.name} has no classification"
        if self.group in OWN:
            yield "group", f"{self.group} is what an attribute of the polygons is called; rename it"

    def halo(self) -> float:
        """Infinite, as a region may run through the whole survey."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> ShorelineAlphaShape.Outputs:
        """Draw one shape, or one for each group."""
        cloud, keep = self.points, np.ones(len(self.points), bool)
        if self.classes:
            keep = np.isin(cloud["classification"], self.classes)
            if len(keep) and not keep.any():
                raise NothingToDo(f"points: none is of class {self.classes}; classify them first")
        keep = without_withheld(cloud, keep, ctx)
        xy = cloud.xyz[keep, :2]
        require_finite(xy)
        made = list(self._shapes(xy, keep, ctx))
        used = max(shape.alpha for _, shape in made)
        frame = self._frame(made)
        if frame.empty:
            least = min(shape.least for _, shape in made) / cloud.metre
            log.warning(
                "there is no area: it begins at an alpha of %.3g m, without thresholds", least
            )
        inside = int(frame["points"].sum())
        return self.Outputs(
            shapes=Vector(frame, geometry_type="Polygon"),
            outlines=Vector(_rings(frame), geometry_type="LineString"),
            alpha_used=used,
            regions=len(frame),
            area=float(frame["area"].sum()),
            outside_share=Share(len(xy) - inside, len(xy)),
        )

    def _shapes(
        self, xy: NDArray[np.float64], keep: NDArray[np.bool_], ctx: Context
    ) -> Iterator[tuple[Any, AlphaShape]]:
        """Value of each group (None without groups) and its alpha shape."""
        shape = partial(
            alpha_shape,
            alpha=self.alpha,
            hole_threshold=self.hole_threshold,
            region_threshold=self.region_threshold,
        )
        if self.group is None:
            yield None, shape(xy, ctx=ctx)
            return
        values = self.points[self.group][keep]
        if values.dtype.kind == "f" and np.isnan(values).any():
            raise DataError(f"group: {self.group} is not a number (NaN) for some points")
        order = np.argsort(values, kind="stable")
        groups, firsts = np.unique(values[order], return_index=True)
        lasts = [*firsts[1:], len(order)]
        without = 0
        for value, first, last in zip(groups.tolist(), firsts, lasts, strict=True):
            part = ctx.part(first / len(order), last / len(order))
            part.progress(0.0)
            try:
                yield value, shape(xy[order[first:last]], ctx=part)
            except DataError:
                without += 1
        if without == len(groups):
            raise NothingToDo(f"points: no {self.group} has points that span a triangle")
        if without:
            log.warning("%d of %d groups do not span a triangle", without, len(groups))

    def _frame(self, made: list[tuple[Any, AlphaShape]]) -> geopandas.GeoDataFrame:
        """Polygons with their attributes, one row each."""
        import geopandas
        import shapely

        counts = [len(shape.polygons) for _, shape in made]
        polygons = np.concatenate([shape.polygons for _, shape in made])
        columns: dict[str, Any] = {
            "area": shapely.area(polygons),
            "perimeter": shapely.length(polygons),
            "alpha": np.repeat([shape.alpha for _, shape in made], counts),
            "points": np.concatenate([shape.points for _, shape in made]),
        }
        if self.group is not None:
            columns = {str(self.group): np.repeat([value for value, _ in made], counts)} | columns
        return geopandas.GeoDataFrame(columns, geometry=polygons, crs=self.points.crs)


def _rings(frame: geopandas.GeoDataFrame) -> geopandas.GeoDataFrame:
    """Outer rings and holes as lines; polygons are numbered from 1."""
    import geopandas
    import shapely

    rows = [
        {"polygon": number, "kind": kind, "length": ring.length, "geometry": ring}
        for number, polygon in enumerate(frame.geometry, start=1)
        for kind, rings in (("outer", [polygon.exterior]), ("hole", polygon.interiors))
        for ring in map(shapely.LineString, rings)
    ]
    columns = ["polygon", "kind", "length", "geometry"]
    return geopandas.GeoDataFrame(rows, columns=columns, geometry="geometry", crs=frame.crs)
