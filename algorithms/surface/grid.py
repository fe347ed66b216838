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
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import CloughTocher2DInterpolator
from scipy.spatial import Delaunay, QhullError, cKDTree

from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Raster
from toolbox.data.crs import vertical_unit
from toolbox.errors import DataError
from toolbox.spec import outputs, param, sink, source, tool
from toolbox.values import Attribute, ClassList

Method = Literal["linear", "idw", "nearest", "cubic"]
Array = NDArray[np.float64]
BLOCK = 200_000  # cells or triangles between two looks at whether the user cancelled
EDGE = 1e-9  # cells: a centre this close to an edge lies on it, so that no cell falls between two


@tool("surface.grid")
class SurfaceGrid:
    """Turn points into a raster by interpolation at the cell centres.

    `linear` is the facets of the Delaunay triangulation, `cubic` a smooth surface over the same
    triangles; both leave cells outside the convex hull empty. `nearest` takes the closest point,
    `idw` weights the closest `neighbours` by their distance. Points at the same place are averaged.
    Cells are whole multiples of the cell size, so that rasters of neighbouring surveys fit, or
    those of a template raster.

    Heights, and attributes whose type fits into it, become 32-bit floats, which round heights by
    less than 0.0003 up to 8000. Attributes of more digits, such as gps_time, become 64-bit floats.

    Memory grows by some 850 bytes per point for linear and cubic, 150 for the others, and 12 bytes
    per cell.
    """

    points: PointCloud = source("Points to grid")
    template: Raster | None = source(
        "Raster whose cells to fill, instead of cells of the given size", default=None
    )
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
        """Interpolate at the centres of cells."""
        xy, values = self._samples(ctx.part(0.0, 0.1))
        lattice = (
            Lattice.of(self.template)
            if self.template
            else Lattice.cover((*xy.min(axis=0), *xy.max(axis=0)), self.cell)
        )
        surface = grid(
            xy,
            values,
            lattice,
            method=self.method,
            power=self.power,
            neighbours=self.neighbours,
            max_gap=self.max_gap,
            ctx=ctx.part(0.1, 1.0),
        )
        return self._packed(surface, lattice)

    def _samples(self, ctx: Context) -> tuple[Array, Array]:
        """Places of shape (n, 2) and values of shape (n,) of the chosen points."""
        cloud = self.points
        if self.classes:
            cloud = cloud.select(np.isin(cloud["classification"], self.classes))
            if len(cloud) == 0:
                raise DataError(f"points: none is of class {self.classes}; classify them first")
        if len(cloud) == 0:
            raise DataError("points: there are none to grid")
        ctx.progress(0.3)
        values = np.asarray(cloud[self.attribute], np.float64)
        if not np.isfinite(values).all():
            raise DataError(
                f"points: attribute {self.attribute!r} holds values that are not finite"
            )
        ctx.progress(0.6)
        xy = cloud.xyz[:, :2]
        ctx.progress(1.0)
        return xy, values

    def _packed(self, surface: Array, lattice: Lattice) -> SurfaceGrid.Outputs:
        """The raster, in the smallest type that holds the attribute; see the class."""
        points, is_height = self.points, self.attribute == "z"
        fits = is_height or np.can_cast(points[self.attribute].dtype, np.float32)
        raster = Raster.from_lattice(
            surface.astype(np.float32) if fits else surface,
            lattice,
            crs=points.crs,
            descriptions=(f"{self.attribute} ({self.method})",),
            units=(vertical_unit(points.crs) if is_height else "",),
        )
        filled = float(np.isfinite(surface).mean())
        if not filled:
            log.warning(
                "no cell has a value; is the cell larger than the data, or max_gap too small?"
            )
        return self.Outputs(surface=raster, filled_share=filled)


def grid(
    xy: Array,
    values: Array,
    lattice: Lattice,
    *,
    method: Method = "linear",
    power: float = 2.0,
    neighbours: int = 12,
    max_gap: float | None = None,
    ctx: Context = QUIET,
) -> Array:
    """Values at the centres of cells from points anywhere, NaN where there is no data.

    Parameters
    ----------
    xy : array of shape (n, 2); points at one place are averaged
    values : array of shape (n,), finite
    lattice : the cells
    method, power, neighbours : see :class:`SurfaceGrid`
    max_gap : NaN where no point is nearer, in the unit of xy
    ctx : progress and cancellation

    Returns
    -------
    array of shape (rows, cols), independent of the order of the points

    Raises
    ------
    DataError
        The points do not span a triangle, which linear and cubic need.
    """
    xy, values = averaged(xy, values)
    ctx.progress(0.1)
    surface = interpolate(
        xy,
        values,
        lattice,
        method=method,
        power=power,
        neighbours=neighbours,
        ctx=ctx.part(0.1, 0.8),
    )
    if max_gap is not None:
        tree = cKDTree(xy)
        near = per_block(
            lambda cells: np.asarray(tree.query(cells, distance_upper_bound=max_gap)[0]),
            lattice,
            ctx.part(0.8, 1.0),
        )
        surface[np.isinf(near)] = np.nan
    ctx.progress(1.0)
    return surface


def averaged(xy: Array, values: Array) -> tuple[Array, Array]:
    """Each place of shape (n, 2) once, sorted, with the mean of its values of shape (n,)."""
    order = np.lexsort((values, xy[:, 1], xy[:, 0]))  # values too: sums depend on the order
    xy, values = xy[order], values[order]
    starts = np.flatnonzero(np.r_[True, (xy[1:] != xy[:-1]).any(axis=1)])
    if len(starts) < len(xy):
        log.info("%d points share their place with another; averaged", len(xy) - len(starts))
    return xy[starts], np.add.reduceat(values, starts) / np.diff(starts, append=len(xy))


def interpolate(
    xy: Array,
    values: Array,
    lattice: Lattice,
    *,
    method: Method,
    power: float = 2.0,
    neighbours: int = 12,
    ctx: Context = QUIET,
) -> Array:
    """Values at the centres of cells, NaN where the method has none.

    Parameters
    ----------
    xy : array of shape (n, 2), no place twice
    values : array of shape (n,)
    lattice : the cells
    method, power, neighbours : see :class:`SurfaceGrid`

    Returns
    -------
    array of shape (rows, cols)

    Raises
    ------
    DataError
        The points do not span a triangle, which linear and cubic need.
    """
    if method in ("nearest", "idw"):
        return per_block(by_distance(xy, values, power, neighbours, method), lattice, ctx)
    # Qhull works with absolute numbers: coordinates of millions of metres would cost it digits.
    origin = xy.mean(axis=0)
    try:
        mesh = Delaunay(xy - origin)
    except (QhullError, ValueError) as err:
        raise DataError(
            f"points: {len(xy)} place(s) do not span a triangle, which {method} needs; use nearest"
        ) from err
    if method == "cubic":
        smooth = CloughTocher2DInterpolator(mesh, values)
        return per_block(lambda cells: np.asarray(smooth(cells - origin)), lattice, ctx)
    return facets(xy, values, mesh.simplices, lattice, ctx)


def per_block(at: Callable[[Array], Array], lattice: Lattice, ctx: Context) -> Array:
    """Ask a function of places of shape (m, 2) for its values at all cell centres."""
    grid = np.empty(lattice.shape)
    x, y = lattice.centres()
    rows = max(1, BLOCK // len(x))
    for top in range(0, len(y), rows):
        ctx.progress(top / len(y))
        block = slice(top, top + rows)
        cells = np.column_stack([g.ravel() for g in np.meshgrid(x, y[block])])
        grid[block] = at(cells).reshape(-1, len(x))
    return grid


def by_distance(
    xy: Array, values: Array, power: float, neighbours: int, method: Method
) -> Callable[[Array], Array]:
    """A function that weights the nearest points with their distance to the power of -power."""
    tree = cKDTree(xy)
    count = 1 if method == "nearest" else min(neighbours, len(xy))

    def at(places: Array) -> Array:
        distance, index = (np.asarray(a) for a in tree.query(places, k=range(1, count + 1)))
        exact = distance[:, 0] == 0
        distance[exact] = np.where(distance[exact] == 0, 1, np.inf)
        weight = (distance / distance[:, :1]) ** -power  # relative, so that no power overflows
        return np.asarray((weight * values[index]).sum(axis=1) / weight.sum(axis=1))

    return at


def facets(
    xy: Array, values: Array, triangles: NDArray[np.int32], lattice: Lattice, ctx: Context
) -> Array:
    """Draw the plane of each triangle of shape (t, 3) into the cells whose centres it covers."""
    grid = np.full(lattice.shape, np.nan)
    # In numbers of cells from the first centre, so that all centres are whole numbers.
    u = (xy[:, 0] - lattice.west) / lattice.cell - 0.5
    v = (lattice.north - xy[:, 1]) / lattice.cell - 0.5
    for start in range(0, len(triangles), BLOCK):
        ctx.progress(start / len(triangles))
        draw_triangles(u, v, values, triangles[start : start + BLOCK], grid)
    return grid


@njit(cache=True, nogil=True)
def draw_triangles(u, v, values, triangles, grid):  # type: ignore[no-untyped-def]
    """Fill rows of cells between the edges of each triangle.

    Along a row each barycentric coordinate is a*col + b, and the triangle is where all three are
    positive: no cell outside is ever looked at, however long and thin the triangle.
    """
    rows, cols = grid.shape
    for t in range(len(triangles)):
        i, j, k = triangles[t]
        area = (u[j] - u[i]) * (v[k] - v[i]) - (u[k] - u[i]) * (v[j] - v[i])
        if area == 0.0:
            continue
        slope_j, slope_k = (v[k] - v[i]) / area, (v[i] - v[j]) / area
        first = max(0, math.ceil(min(v[i], v[j], v[k]) - EDGE))
        last = min(rows - 1, math.floor(max(v[i], v[j], v[k]) + EDGE))
        for row in range(first, last + 1):
            at_j = ((u[i] - u[k]) * (row - v[i]) - (v[k] - v[i]) * u[i]) / area
            at_k = ((u[j] - u[i]) * (row - v[i]) + (v[j] - v[i]) * u[i]) / area
            low, high = 0.0, cols - 1.0
            low, high = narrowed(low, high, slope_j, at_j)
            low, high = narrowed(low, high, slope_k, at_k)
            low, high = narrowed(low, high, -slope_j - slope_k, 1.0 - at_j - at_k)
            for col in range(math.ceil(low - EDGE), math.floor(high + EDGE) + 1):
                if 0 <= col < cols:
                    w_j, w_k = slope_j * col + at_j, slope_k * col + at_k
                    grid[row, col] = (
                        (1.0 - w_j - w_k) * values[i] + w_j * values[j] + w_k * values[k]
                    )


@njit(cache=True, nogil=True)
def narrowed(low, high, slope, at):  # type: ignore[no-untyped-def]
    """The part of low..high where slope * x + at is not negative."""
    if slope > 0:
        return max(low, -at / slope), high
    if slope < 0:
        return low, min(high, -at / slope)
    return (low, high) if at >= -EDGE else (1.0, 0.0)
