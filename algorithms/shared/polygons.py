"""Point in polygon tests, exact and faster than reading the points.

References
----------
Hormann, K. and Agathos, A. (2001). The point in polygon problem for arbitrary polygons.
Computational Geometry 20(3), 131-144: winding numbers.
Edelsbrunner, H. and Mücke, E. P. (1990). Simulation of simplicity: a technique to cope with
degenerate cases in geometric algorithms. ACM Transactions on Graphics 9(1), 66-104.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shared.kernels import polygons as kernels
from algorithms.shared.kernels.threads import in_blocks
from toolbox.context import QUIET, Context
from toolbox.data import Lattice, Vector
from toolbox.errors import DataError

BLOCK = 500_000  # points between two checks for cancellation
CELLS_PER_EDGE, FEWEST, MOST = 4, 1 << 12, 1 << 22  # of the grid
ULPS = 2.0**-46  # share of a coordinate that rounding may move it by, amply

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Shapes = NDArray[Any]  # of shapely geometries


def polygons(layer: Vector, name: str) -> Shapes:
    """The single polygons of a layer.

    Raises
    ------
    DataError
        One is of another type, or crosses itself; names the parameter.

    Examples
    --------
    >>> import geopandas
    >>> two = shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(5, 0, 6, 1)])
    >>> len(polygons(Vector(geopandas.GeoDataFrame(geometry=[two])), "clip"))
    2
    """
    shapes = shapely.get_parts(geometries(layer))
    others = {shape.geom_type for shape in shapes} - {"Polygon"}
    if others:
        raise DataError(f"{name}: must be polygons, {layer.name} holds a {sorted(others)[0]}")
    if not shapely.is_valid(shapes).all():
        reason = shapely.is_valid_reason(shapes[~shapely.is_valid(shapes)][0])
        raise DataError(f"{name}: a polygon of {layer.name} is not valid ({reason})")
    return shapes


def geometries(layer: Vector) -> Shapes:
    """The geometries of a layer, without missing and empty ones.

    Examples
    --------
    >>> import geopandas
    >>> len(geometries(Vector(geopandas.GeoDataFrame(geometry=[shapely.Point(0, 0), None]))))
    1
    """
    shapes = layer.frame.geometry.to_numpy()
    there: Shapes = shapes[~(shapely.is_missing(shapes) | shapely.is_empty(shapes))]
    return there


def cells_within(shape: shapely.Polygon, lattice: Lattice) -> tuple[Ints, Ints]:
    """Rows and columns, row by row, of the cells whose centre is in a polygon.

    Examples
    --------
    >>> lattice = Lattice.cover((0.0, 0.0, 3.0, 2.0), 1.0)
    >>> cells_within(shapely.box(0.0, 1.0, 2.0, 2.0), lattice)  # the first row is the northern one
    (array([0, 0]), array([0, 1]))
    """
    east, north = lattice.centres()
    west, south, right, top = shape.bounds
    cols = np.flatnonzero((east >= west) & (east <= right))
    rows = np.flatnonzero((north >= south) & (north <= top))
    shapely.prepare(shape)
    row, col = np.nonzero(shapely.contains_xy(shape, east[cols][None, :], north[rows][:, None]))
    return rows[row], cols[col]


@dataclass(frozen=True)
class Polygons:
    """Polygons with a grid of cells: edges of each cell, and winding number of its corner.

    Attributes
    ----------
    edges : array of shape (m, 4), directed: shells counter-clockwise, holes clockwise
    listed, starts : numbers of the edges that may touch a cell, and where those of each begin
    winding : array of shape (rows * cols,), in how many polygons the lower left corner is
    frame : west, south, cell, rows, cols; one row or column of cells around everything is empty

    Examples
    --------
    >>> yard = Polygons.of(np.array([shapely.box(0, 0, 2, 2)]))
    >>> yard.hold(np.array([[1, 1], [2, 1], [3, 1.0]]))
    array([ True,  True, False])
    """

    edges: Array
    listed: NDArray[np.int32]
    starts: NDArray[np.int64]
    winding: NDArray[np.int32]
    frame: tuple[float, float, float, int, int]

    @classmethod
    def of(cls, shapes: Shapes) -> Polygons:
        """Build the grid of valid polygons or multipolygons, which may overlap each other."""
        edges = _edges(shapely.get_parts(shapes))
        if not len(edges):
            nothing = np.zeros(0, np.int32)
            return cls(edges, nothing, np.zeros(1, np.int64), nothing, (0.0, 0.0, 1.0, 0, 0))
        low, high = (f(edges.reshape(-1, 2), axis=0) for f in (np.min, np.max))
        wide, far = float((high - low).max()), float(np.abs(edges).max())
        cells = min(max(CELLS_PER_EDGE * len(edges), FEWEST), MOST)
        cell = max(math.sqrt(np.prod(high - low) / cells), wide / cells, 1e3 * ULPS * far)
        margin = 1e-6 * cell + ULPS * far
        west, south = (low - cell).tolist()
        cols, rows = (np.floor((high - low) / cell).astype(int) + 3).tolist()
        grid = (west, south, cell)
        starts = kernels.count(edges, *grid, margin, rows, cols)
        listed = kernels.fill(edges, *grid, margin, rows, cols, starts)
        winding = kernels.corners(edges, listed, starts, *grid, rows, cols)
        return cls(edges, listed, starts, winding, (*grid, rows, cols))

    def hold(self, xy: Array, *, ctx: Context = QUIET) -> NDArray[np.bool_]:
        """True for points in a polygon or on its edge, exactly; on the edge of a hole is inside.

        Parameters
        ----------
        xy : array of shape (n, 2) or (n, 3), in the coordinates of the polygons
        ctx : progress and cancellation

        Returns
        -------
        array of shape (n,)
        """
        found = np.zeros(len(xy), bool)
        points = np.ascontiguousarray(xy, np.float64).view()
        points.flags.writeable = False  # the kernel is compiled for such arrays alone

        def look(first: int, last: int) -> None:
            kernels.inside(
                first,
                last,
                points,
                self.edges,
                self.listed,
                self.starts,
                self.winding,
                self.frame,
                found,
            )

        if len(self.edges):
            in_blocks(look, len(points), BLOCK, ctx)
        ctx.progress(1.0)
        return found


def _edges(shapes: Shapes) -> Array:
    """The directed edges of polygons, array of shape (m, 4); see :class:`Polygons`."""
    rings, polygon = shapely.get_rings(shapes, return_index=True)
    if not len(rings):
        return np.zeros((0, 4))
    is_shell = np.diff(polygon, prepend=-1) > 0  # the first ring of each
    turned = shapely.is_ccw(rings) != is_shell
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    begin = np.flatnonzero((ring[1:] == ring[:-1]) & (xy[1:] != xy[:-1]).any(axis=1))
    edges = np.hstack([xy[begin], xy[begin + 1]])
    back = turned[ring[begin]]
    edges[back] = edges[back][:, [2, 3, 0, 1]]
    return edges
