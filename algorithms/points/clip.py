"""Points within a rectangle or within polygons, or outside of them.

How inside is told from outside: algorithms/shared/polygons.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.lowest import require_finite
from algorithms.shared.polygons import Polygons, Shapes, geometries, polygons
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Vector
from toolbox.declare import Expression, Extent, Share, outputs, param, sink, source, tool
from toolbox.errors import DataError


@tool(
    "points.clip",
    title="Clip points",
    tags=(
        "clip",
        "crop",
        "cut",
        "subset",
        "extent",
        "polygon",
        "mask",
    ),
)
class PointsClip:
    """Keep the points inside a rectangle or polygons, or those outside.

    Inside is what lies in any of the polygons, and where an `extent` is given too, in both. Edges
    and corners belong to the inside, also those of holes. Every other point is outside: none is in
    both parts, and none is lost. Heights do not matter.

    The polygons must be in the CRS of the points; if they are not, reproject them first. Those that
    cross themselves are refused. With `where` only polygons are used whose attributes meet a
    condition, such as ``id in (3, 7)``.
    """

    points: PointCloud = source("Points to choose from")
    polygons: Vector | None = source("Polygons to clip by", default=None, shapes="polygon")
    extent: Extent | None = param("Rectangle to work in; that of the data by default", default=None)
    keep: Literal["inside", "outside"] = param(
        "Which points to keep", default="inside", label="Points to keep"
    )
    where: Expression | None = param(
        "Condition over attributes that must be met", default=None, of="polygons", label="Condition"
    )

    @outputs
    class Outputs:
        clipped: PointCloud = sink("The chosen points, otherwise unchanged", label="Clipped points")
        removed_share: float = sink("Share of points removed", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """An extent or polygons are given, and the polygons fit the condition."""
        if self.polygons is None and self.extent is None:
            yield "extent", "neither a rectangle nor polygons are given; give one of both"
        if self.polygons is None and self.where:
            yield "where", "is a condition for polygons, and none are given"
        if self.polygons is not None and not len(self.polygons):
            yield "polygons", f"{self.polygons.name} is empty"
        if self.polygons is not None and self.where:
            frame = self.polygons.frame
            for name in sorted(self.where.names):
                if frame[name].dtype.kind not in "biuf":
                    yield "where", f"attribute {name!r} of {self.polygons.name} is no number"

    def halo(self) -> float:
        """Zero, as each point is judged by itself."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> PointsClip.Outputs:
        """Keep the points."""
        cloud = self.points
        chosen = self._chosen() if self.polygons else None
        keep = within(cloud.xyz, self.extent, chosen, ctx=ctx)
        if self.keep == "outside":
            keep = ~keep
        if not keep.any() and cloud.origin is None:  # a tile may well have none
            log.warning("no point is %s", self.keep)
        return self.Outputs(
            clipped=cloud.select(keep), removed_share=Share.of_points(~keep, cloud.core)
        )

    def _chosen(self) -> Shapes:
        """Polygons that meet the condition, as single polygons."""
        layer = self.polygons
        assert layer is not None
        if self.where:
            columns = {name: layer.frame[name].to_numpy() for name in self.where.names}
            meets = self.where.mask(columns, len(layer))
            layer = Vector(layer.frame[meets], name=layer.name)
        found = polygons(layer, "polygons")
        missing = len(layer) - len(geometries(layer))
        if missing and self.points.origin is None:  # said once, and not for each tile
            log.warning("polygons: %d of %s have no geometry and are left out", missing, layer.name)
        if not len(found):
            which = f"meets {self.where}" if self.where else "has a geometry"
            raise DataError(f"polygons: none of {layer.name} {which}")
        return found


def within(
    xyz: NDArray[np.float64],
    extent: Extent | None = None,
    shapes: Shapes | None = None,
    *,
    ctx: Context = QUIET,
) -> NDArray[np.bool_]:
    """True for points inside a rectangle or polygons, or on their boundary.

    Parameters
    ----------
    xyz : array of shape (n, 3), or (n, 2)
    extent : in the same coordinates; anywhere by default
    shapes : valid polygons, which may overlap; anywhere by default
    ctx : progress and cancellation

    Returns
    -------
    array of shape (n,)

    Raises
    ------
    DataError
        A coordinate is not a finite number.

    Examples
    --------
    >>> import shapely
    >>> corner = shapely.Polygon([(0, 0), (2, 0), (0, 2)])
    >>> within(np.array([[0.5, 0.5], [1, 1], [1.5, 1.5]]), shapes=np.array([corner]))
    array([ True,  True, False])
    """
    require_finite(xyz)
    ctx.progress(0.1)
    if shapes is None:
        inside = np.ones(len(xyz), bool)
    else:
        inside = Polygons.of(shapes).hold(xyz, ctx=ctx.part(0.1, 0.9))
    if extent is not None:
        x, y = xyz[:, 0], xyz[:, 1]
        inside &= (x >= extent.xmin) & (x <= extent.xmax)
        inside &= (y >= extent.ymin) & (y <= extent.ymax)
    ctx.progress(1.0)
    return inside
