"""Gridding: from points to a raster of heights, intensities or any other attribute.

References
----------
Shepard, D. (1968). A two-dimensional interpolation function for irregularly-spaced data. ACM
National Conference, 517-524: inverse distance weighting.
Alfeld, P. (1984). A trivariate Clough-Tocher scheme for tetrahedral data. Computer Aided Geometric
Design 1, 169-181: the C1 surface behind `cubic`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CloughTocher2DInterpolator, LinearNDInterpolator
from scipy.spatial import Delaunay, QhullError, cKDTree

from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Raster
from toolbox.data.crs import vertical_unit
from toolbox.errors import DataError
from toolbox.spec import outputs, param, sink, source, tool
from toolbox.values import Attribute, ClassList

Method = Literal["linear", "idw", "nearest", "cubic"]
Array = NDArray[np.float64]
BLOCK = 200_000  # cells between two looks at whether the user cancelled


@tool("surface.grid")
class SurfaceGrid:
    """Turn points into a raster by interpolation at the cell centres.

    `linear` is the facets of the Delaunay triangulation, `cubic` a smooth surface over the same
    triangles; both leave cells outside the convex hull empty. `nearest` takes the closest point,
    `idw` weights the closest `neighbours` by their distance. Points at the same place are averaged.
    Cells are whole multiples of the cell size, so that rasters of neighbouring surveys fit.
    """

    points: PointCloud = source("Points to grid")
    method: Method = param("How to interpolate", default="linear")
    cell: float = param("Cell size", default=1.0, unit="m", gt=0)
    attribute: Attribute = param("Attribute to grid", default=Attribute("z"), of="points")
    classes: ClassList | None = param("Classes to use; all by default", default=None)
    power: float = param("Power of the distance, for idw", default=2.0, unit="1", gt=0)
    neighbours: int = param("Points used per cell, for idw", default=12, unit="1", ge=1)
    max_gap: float | None = param(
        "Leave cells empty that lie farther than this from any point", default=None, unit="m", gt=0
    )

    @outputs
    class Outputs:
        surface: Raster = sink("The interpolated attribute, empty where there is no data")
        filled_share: float = sink("Share of cells with a value", unit="1")

    def halo(self) -> float:
        """Triangles and neighbours reach across gaps of any size; the nearest point does not."""
        return self.max_gap if self.method == "nearest" and self.max_gap else math.inf

    def run(self, ctx: Context = QUIET) -> SurfaceGrid.Outputs:
        """Interpolate."""
        xy, values = self._samples()
        lattice = Lattice.cover((*xy.min(axis=0), *xy.max(axis=0)), self.cell)
        at = interpolator(
            xy, values, method=self.method, power=self.power, neighbours=self.neighbours
        )
        gap = self.max_gap
        tree = cKDTree(xy) if gap else None
        grid = np.empty(lattice.shape)
        x, y = lattice.centres()
        rows = max(1, BLOCK // len(x))
        for top in range(0, len(y), rows):
            ctx.progress(0.5 + 0.5 * top / len(y))
            block = slice(top, top + rows)
            cells = np.column_stack([g.ravel() for g in np.meshgrid(x, y[block])])
            grid[block] = at(cells).reshape(-1, len(x))
            if gap and tree:
                distance, _ = tree.query(cells, distance_upper_bound=gap)
                grid[block][np.isinf(distance).reshape(-1, len(x))] = np.nan
        unit = vertical_unit(self.points.crs) if self.attribute == "z" and self.points.crs else ""
        surface = Raster.from_lattice(
            grid.astype(np.float32),
            lattice,
            crs=self.points.crs,
            descriptions=(f"{self.attribute} ({self.method})",),
            units=(unit,),
        )
        return self.Outputs(surface=surface, filled_share=float(np.isfinite(grid).mean()))

    def _samples(self) -> tuple[Array, Array]:
        """Places and values of the chosen points, each place once, in an order of their own."""
        cloud = self.points
        if self.classes:
            cloud = cloud.select(np.isin(cloud["classification"], self.classes))
            if len(cloud) == 0:
                raise DataError(f"points: none is of class {self.classes}; classify them first")
        if len(cloud) == 0:
            raise DataError("points: there are none to grid")
        values = np.asarray(cloud[self.attribute], np.float64)
        if not np.isfinite(values).all():
            raise DataError(
                f"points: attribute {self.attribute!r} holds values that are not finite"
            )
        xy, which, count = np.unique(
            cloud.xyz[:, :2], axis=0, return_inverse=True, return_counts=True
        )
        if len(xy) < len(cloud):
            log.info("%d points share their place with another; averaged", len(cloud) - len(xy))
        return xy, np.bincount(which.ravel(), values) / count


def interpolator(
    xy: Array, values: Array, *, method: Method, power: float = 2.0, neighbours: int = 12
) -> Callable[[Array], Array]:
    """A function that gives values at other places, NaN where the method has none.

    Parameters
    ----------
    xy : array of shape (n, 2), no place twice
    values : array of shape (n,)
    method, power, neighbours : see :class:`SurfaceGrid`

    Returns
    -------
    callable
        Takes places as an array of shape (m, 2), gives an array of shape (m,).

    Raises
    ------
    DataError
        The points do not span a triangle, which linear and cubic need.
    """
    if method in ("nearest", "idw"):
        return _by_distance(xy, values, power, 1 if method == "nearest" else neighbours)
    # Qhull works with absolute numbers: coordinates of millions of metres would cost it digits.
    origin = xy.mean(axis=0)
    try:
        mesh = Delaunay(xy - origin)
    except (QhullError, ValueError) as err:
        raise DataError(
            f"points: {len(xy)} place(s) do not span a triangle, which {method} needs; use nearest"
        ) from err
    cls: Any = LinearNDInterpolator if method == "linear" else CloughTocher2DInterpolator
    surface = cls(mesh, values)
    return lambda places: np.asarray(surface(places - origin))


def _by_distance(
    xy: Array, values: Array, power: float, neighbours: int
) -> Callable[[Array], Array]:
    tree = cKDTree(xy)
    count = min(neighbours, len(xy))

    def at(places: Array) -> Array:
        distance, index = (np.asarray(a) for a in tree.query(places, k=range(1, count + 1)))
        exact = distance[:, 0] == 0
        distance[exact] = np.where(distance[exact] == 0, 1, np.inf)
        weight = (distance / distance[:, :1]) ** -power  # relative, so that no power overflows
        return np.asarray((weight * values[index]).sum(axis=1) / weight.sum(axis=1))

    return at
