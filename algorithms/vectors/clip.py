"""Features cut at a rectangle or at polygons."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shared.polygons import polygons
from toolbox.context import QUIET, Context, log
from toolbox.data import Vector
from toolbox.declare import Extent, outputs, param, sink, source, tool

BLOCK = 1000  # features between two reports of progress


@tool(
    "vectors.clip",
    title="Clip features",
    tags=(
        "clip",
        "cut",
        "intersection",
        "erase",
        "extent",
        "mask",
    ),
)
class VectorsClip:
    """Cut features at a rectangle or polygons, and keep what is inside, or outside.

    Inside is what lies in any of the polygons, and where an `extent` is given too, in both. A
    feature that is cut keeps its attributes, which may no longer hold, such as an area; what is cut
    into several pieces is one feature of several parts. Where a feature only touches the edge
    nothing is left of it. New vertices get their heights from the edge that they lie on.

    Two layers that are clipped alike can be compared on a reach of them alone.
    """

    features: Vector = source("Features to cut")
    polygons: Vector | None = source("Polygons to clip by", default=None, shapes="polygon")
    extent: Extent | None = param("Rectangle to work in; that of the data by default", default=None)
    keep: Literal["inside", "outside"] = param("Which part to keep", default="inside")

    @outputs
    class Outputs:
        clipped: Vector = sink("What is left of the features", also=(".city.json", ".ifc"))
        removed: int = sink("Features of which nothing is left", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """An extent or polygons are given."""
        if self.polygons is None and self.extent is None:
            yield "extent", "neither a rectangle nor polygons are given; give one of both"
        if self.polygons is not None and not len(self.polygons):
            yield "polygons", f"{self.polygons.name} is empty"

    def halo(self) -> float:
        """Zero, as each feature is cut by itself."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> VectorsClip.Outputs:
        """Cut them."""
        area = None
        if self.polygons is not None:
            area = shapely.union_all(polygons(self.polygons, "polygons"))
        if self.extent is not None:
            box = shapely.box(*self.extent)
            area = box if area is None else shapely.intersection(area, box)
        frame = self.features.frame
        shapes = cut(np.array(frame.geometry.array), area, keep=self.keep, ctx=ctx)
        left = np.array([shape is not None and not shape.is_empty for shape in shapes], bool)
        made = frame.set_geometry(shapes, crs=self.features.crs)[left]
        if len(frame) and not left.any():
            log.warning("nothing of %s is %s", self.features.name, self.keep)
        kept = Vector(made, name=self.features.name, geometry_type=self.features.geometry_type)
        return self.Outputs(clipped=kept, removed=int(np.count_nonzero(~left)))


def cut(
    shapes: NDArray[Any], area: Any, *, keep: Literal["inside", "outside"], ctx: Context = QUIET
) -> NDArray[Any]:
    """The parts of geometries inside an area or outside of it, of no lower dimension than they.

    Examples
    --------
    >>> line = np.array([shapely.LineString([(0, 0), (4, 0)])])
    >>> cut(line, shapely.box(1, -1, 2, 1), keep="inside")[0].wkt
    'LINESTRING (1 0, 2 0)'
    """
    shapely.prepare(area)
    found = shapes.copy()
    for start in range(0, len(shapes), BLOCK):
        block = shapes[start : start + BLOCK]
        whole, apart = shapely.contains_properly(area, block), ~shapely.intersects(area, block)
        untouched, gone = (whole, apart) if keep == "inside" else (apart, whole)
        part = block.copy()
        part[gone] = None
        at_edge = ~(untouched | gone)
        work = shapely.intersection if keep == "inside" else shapely.difference
        part[at_edge] = [
            _of_dimension(made, shapely.get_dimensions(shape))
            for made, shape in zip(work(block[at_edge], area), block[at_edge], strict=True)
        ]
        found[start : start + BLOCK] = part
        ctx.progress(min(1.0, (start + BLOCK) / len(shapes)))
    ctx.progress(1.0)
    return found


def _of_dimension(shape: Any, dimension: int) -> Any:
    """The parts of a geometry that have a dimension: no points where lines only touch."""
    if shape is None or shape.geom_type != "GeometryCollection":
        return shape if shape is None or shapely.get_dimensions(shape) == dimension else None
    parts = [part for part in shape.geoms if shapely.get_dimensions(part) == dimension]
    if not parts:
        return None
    kinds = (shapely.MultiPoint, shapely.MultiLineString, shapely.MultiPolygon)
    return parts[0] if len(parts) == 1 else kinds[dimension](shapely.get_parts(parts).tolist())
