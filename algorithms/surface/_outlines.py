"""Lines and polygons that shape a surface: breaklines, exclusions and boundaries."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shared.polygons import geometries
from toolbox.context import QUIET, Context
from toolbox.data import Lattice, Vector
from toolbox.errors import DataError

BLOCK = 200_000  # points or cells between two checks for cancellation

Array = NDArray[np.float64]
Shapes = NDArray[Any]  # of shapely geometries


def lines(layer: Vector, name: str) -> Shapes:
    """Lines of a layer, and the boundaries of its polygons as lines.

    Raises
    ------
    DataError
        One has no heights, or not everywhere, or is no line; names the parameter.
    """
    shapes = shapely.get_parts(geometries(layer))
    others = {shape.geom_type for shape in shapes} - {"Polygon", "LineString", "LinearRing"}
    if others:
        raise DataError(f"{name}: must be lines, {layer.name} holds a {sorted(others)[0]}")
    if not shapely.has_z(shapes).all():
        raise DataError(f"{name}: a line of {layer.name} has no heights (Z)")
    require_heights(shapes, layer, name)
    return outlines(shapes)


def require_heights(shapes: Shapes, layer: Vector, name: str) -> None:
    """Raise an error if a vertex of shapes with heights has none.

    Raises
    ------
    DataError
        One has none; names the parameter.
    """
    vertices = shapely.get_coordinates(shapes, include_z=True)
    if (bad := ~np.isfinite(vertices).all(axis=1)).any():
        x, y, _ = vertices[bad][0]
        raise DataError(f"{name}: a vertex of {layer.name} has no height, at {x:.10g}, {y:.10g}")


def outlines(shapes: Shapes) -> Shapes:
    """Shapes with each polygon replaced by its rings: the outer one and those of its holes."""
    areas = np.array([shape.geom_type == "Polygon" for shape in shapes], bool)
    rings: Shapes = shapely.get_parts(shapely.boundary(shapes[areas]))
    return np.concatenate([shapes[~areas], rings])


def with_heights(shapes: Shapes) -> NDArray[np.bool_]:
    """True for shapes that have heights (Z)."""
    return np.asarray(shapely.has_z(shapes))


def holds(shapes: Shapes, xy: Array, *, ctx: Context = QUIET) -> NDArray[np.bool_]:
    """True for positions of shape (n, 2) that lie in the polygons or on their boundary."""
    area = shapely.union_all(shapes)
    shapely.prepare(area)
    inside = np.empty(len(xy), bool)
    for first in range(0, len(xy), BLOCK):
        some = slice(first, first + BLOCK)
        inside[some] = shapely.intersects_xy(area, xy[some, 0], xy[some, 1])
        ctx.progress(first / len(xy))
    return inside


def cells_in(shapes: Shapes, lattice: Lattice, *, ctx: Context = QUIET) -> NDArray[np.bool_]:
    """True for cells, shape (rows, cols), with the centre in the polygons or on their boundary."""
    area = shapely.union_all(shapes)
    shapely.prepare(area)
    inside = np.zeros(lattice.shape, bool)
    if area.is_empty:
        return inside
    x, y = lattice.centres()
    west, south, east, north = shapely.bounds(area)
    cols = np.flatnonzero((x >= west) & (x <= east))
    for row in np.flatnonzero((y >= south) & (y <= north)):
        inside[row, cols] = shapely.intersects_xy(area, x[cols], y[row])
        ctx.progress(row / len(y))
    return inside


def steps_at_crossings(shapes: Shapes) -> tuple[Array, Array]:
    """Positions where lines with heights meet, and the difference of their heights there.

    Returns
    -------
    positions of shape (n, 2), and differences of shape (n,)
    """
    one, other = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    pair = one < other
    one, other = shapes[one[pair]], shapes[other[pair]]
    xy, which = shapely.get_coordinates(shapely.intersection(one, other), return_index=True)
    places = shapely.points(xy)
    low, high = (
        shapely.get_z(shapely.line_interpolate_point(s, shapely.line_locate_point(s, places)))
        for s in (one[which], other[which])
    )
    return xy, np.abs(high - low)


def with_breaklines(
    xy: Array, values: Array, shapes: Shapes, spacing: float
) -> tuple[Array, Array]:
    """Points with vertices along breaklines added, dense enough that no triangle crosses a line.

    The lines are cut into pieces no longer than the spacing. Points within half of it from the
    middle of a piece are left out: so no point is in the circle around a piece, and each piece is
    an edge of the Delaunay triangulation.

    Parameters
    ----------
    xy : array of shape (n, 2)
    values : array of shape (n,), heights
    shapes : lines with heights
    spacing : in the unit of xy

    Returns
    -------
    positions of shape (m, 2) and their heights of shape (m,)
    """
    from scipy.spatial import cKDTree  # of which most grids have no need

    ends, middles = _pieces(shapes, spacing)
    if not len(middles):
        return xy, values
    away, _ = cKDTree(middles).query(xy, distance_upper_bound=spacing / 2)
    keep = np.isinf(away)
    return np.vstack([xy[keep], ends[:, :2]]), np.concatenate([values[keep], ends[:, 2]])


def _pieces(shapes: Shapes, spacing: float) -> tuple[Array, Array]:
    """Ends of shape (m, 3) and middles of shape (k, 2) of the pieces into which lines are cut."""
    vertices, line = shapely.get_coordinates(shapes, include_z=True, return_index=True)
    first = np.flatnonzero(line[1:] == line[:-1])
    begin, way = vertices[first], vertices[first + 1] - vertices[first]
    count = np.ceil(np.hypot(way[:, 0], way[:, 1]) / spacing).astype(np.int64)
    segment = np.repeat(np.arange(len(first)), count)
    number = np.arange(len(segment)) - (np.cumsum(count) - count)[segment]
    share = (number / count[segment])[:, None]
    half = (0.5 / count[segment])[:, None]
    ends = np.vstack([begin[segment] + share * way[segment], vertices])
    middles = begin[segment] + (share + half) * way[segment]
    return ends, middles[:, :2]


def levels(shapes: Shapes) -> list[tuple[Shapes, float]]:
    """Polygons whose vertices all have the same height, each with that height."""
    found = []
    for shape in shapes[with_heights(shapes)]:
        heights = shapely.get_coordinates(shape, include_z=True)[:, 2]
        if (heights == heights[0]).all():
            found.append((np.array([shape]), float(heights[0])))
    return found
