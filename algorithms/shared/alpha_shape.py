"""Alpha shapes of points in the plane, as polygons.

A triangle of the Delaunay triangulation belongs to the shape if the circle around it, in which
there is no point, has a radius of at most alpha. So a disc of radius alpha that holds no point
can roll up to the outline of the shape from outside, and nowhere into it. Edges and points that
belong to the shape without a triangle have no area, and are left out.

References
----------
Edelsbrunner, H., Kirkpatrick, D. G. & Seidel, R. (1983). On the shape of a set of points in the
plane. IEEE Transactions on Information Theory 29(4), 551-559.
Edelsbrunner, H. & Mücke, E. P. (1994). Three-dimensional alpha shapes. ACM Transactions on
Graphics 13(1), 43-72: the shape as a part of the Delaunay triangulation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.delaunay import Mesh, triangulate
from algorithms.shared.kernels import alpha_shape as kernels
from algorithms.shared.kernels.threads import in_blocks
from toolbox.context import QUIET, Context
from toolbox.errors import DataError

BLOCK = 500_000  # triangles between two checks for cancellation
ROUNDING = 1e-9  # share of a radius; circles that differ by less are taken for equal

Rule = Literal["auto", "all_points"]
Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Mask = NDArray[np.bool_]


class AlphaShape(NamedTuple):
    """The regions of an alpha shape, the largest first.

    Attributes
    ----------
    polygons : array of shape (r,), shapely polygons; valid, and they meet in single points at most
    points : array of shape (r,), how many points each holds, those at one position counted each;
        one in which regions meet counts for the larger
    alpha : that the shape was made with
    least : radius of the smallest circle around a triangle; below it there is no shape

    Examples
    --------
    >>> shape = alpha_shape(np.array([[0, 0], [3, 0], [0, 4.0]]), np.inf)
    >>> shape.polygons[0].area, shape.least
    (6.0, 2.5)
    """

    polygons: NDArray[Any]
    points: NDArray[np.int64]
    alpha: float
    least: float


class Gaps(NamedTuple):
    """Where no triangle may bridge a gap between points.

    Attributes
    ----------
    radius : only triangles with larger circles around them are asked, in the unit of the points
    are_open : of the middles of these, array of shape (m, 2), which lie in a gap: shape (m,)

    Examples
    --------
    >>> xy = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [9, 0], [9, 1.0]])
    >>> gaps = Gaps(1.0, lambda middles: middles[:, 0] > 2)
    >>> [polygon.area for polygon in alpha_shape(xy, 9.0, gaps=gaps).polygons]
    [1.0]
    """

    radius: float
    are_open: Callable[[Floats], Mask]


def alpha_shape(
    xy: Floats | Mesh,
    alpha: float | Rule,
    *,
    gaps: Gaps | None = None,
    hole_threshold: float = 0.0,
    region_threshold: float = 0.0,
    ctx: Context = QUIET,
) -> AlphaShape:
    """Alpha shape of points.

    Parameters
    ----------
    xy : array of shape (n, 2), or its triangulation, which several shapes may share
    alpha : largest radius of an empty circle within the shape, in the unit of xy; infinity gives
        the convex hull. "all_points" is the least for which every point is part of a region,
        "auto" the least for which there is one region besides. (A still larger one may have
        more, since a triangle may come up in the middle of a hole.)
    gaps : where triangles that alpha allows are left out
    hole_threshold : patches without triangles, closed in on all sides, of a smaller area are
        filled. What lies within becomes part of the region around it.
    region_threshold : regions of a smaller area, after that, are dropped
    ctx : progress and cancellation

    Returns
    -------
    AlphaShape
        The same for any order of the points. Regions are joined by edges: where two touch in a
        point they are two polygons.

    Raises
    ------
    DataError
        There are fewer than three points, or all lie on one line.
    ValueError
        See :func:`algorithms.shared.delaunay.triangulate`.

    Examples
    --------
    >>> xy = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [9, 9.0]])
    >>> shape = alpha_shape(xy, 1.0)
    >>> [polygon.area for polygon in shape.polygons], shape.points.tolist()
    ([1.0], [4])
    """
    mesh = xy if isinstance(xy, Mesh) else triangulate(xy, ctx=ctx.part(0, 0.7))
    radii = circumradii(mesh, ctx=ctx.part(0.7, 0.75))
    chosen = critical_alpha(mesh, radii, alpha) if isinstance(alpha, str) else float(alpha)
    ctx.progress(0.85)
    kept = radii <= chosen * (1 + ROUNDING)
    if gaps is not None:
        asked = np.flatnonzero(kept & (radii > gaps.radius))
        kept[asked] = ~gaps.are_open(mesh.xy[mesh.triangles[asked]].mean(axis=1))
    kept = _trimmed(mesh, kept, hole_threshold, region_threshold)
    ctx.progress(0.95)
    polygons, points, _ = _outlined(mesh, kept)
    ctx.progress(1.0)
    return AlphaShape(polygons, points, chosen, float(radii.min()))


def alpha_shapes_of_groups(
    xy: Floats, group: NDArray[np.int64], alpha: float, *, ctx: Context = QUIET
) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Alpha shapes of many groups of points, each without its holes, by one triangulation.

    The groups are laid out so far apart that no disc of radius alpha reaches two of them: so each
    has the shape that :func:`alpha_shape` gives it alone, without the cost of a call.

    Parameters
    ----------
    xy : array of shape (n, 2)
    group : array of shape (n,), the group of each point, 0, 1, ...
    alpha : as for :func:`alpha_shape`; a finite number
    ctx : progress and cancellation

    Returns
    -------
    polygons : array of shape (r,), the regions of all groups, the largest first
    groups : array of shape (r,), the group of each. One whose points are too few, on one line or
        too far apart has none.

    Raises
    ------
    ValueError
        See :func:`algorithms.shared.delaunay.triangulate`.

    Examples
    --------
    >>> xy = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [2, 0], [0, 2.0]])
    >>> polygons, groups = alpha_shapes_of_groups(xy, np.array([0, 0, 0, 1, 1, 1]), 2.0)
    >>> [polygon.area for polygon in polygons], groups.tolist()
    ([2.0, 0.5], [1, 0])
    """
    try:
        mesh = triangulate(_laid_out(xy, group, 3 * alpha), ctx=ctx.part(0, 0.7))
    except DataError:  # hardly any points
        return np.empty(0, object), np.empty(0, np.int64)
    inside = circumradii(mesh, ctx=ctx.part(0.7, 0.75)) <= alpha * (1 + ROUNDING)
    kept = _trimmed(mesh, inside, np.inf, 0.0)
    polygons, _, corners = _outlined(replace(mesh, xy=xy), kept)  # drawn where they were
    ctx.progress(1.0)
    return polygons, group[corners]


def _laid_out(xy: Floats, group: NDArray[np.int64], apart: float) -> Floats:
    """The points with each group in a square of its own, the squares in rows, so far apart."""
    count = int(group.max()) + 1
    low = np.full((count, 2), np.inf)
    np.minimum.at(low, group, xy)
    moved = xy - low[group]
    number = np.arange(count)
    across = int(np.ceil(np.sqrt(count)))
    places = np.column_stack([number % across, number // across])
    return np.asarray(moved + (moved.max() + apart) * places[group])


def critical_alpha(mesh: Mesh, radii: Floats, rule: Rule) -> float:
    """The least alpha by a rule: all points are kept, with "auto" in one region; see `alpha_shape`.

    Examples
    --------
    >>> mesh = triangulate(np.array([[0, 0], [3, 0], [0, 4.0]]))
    >>> round(critical_alpha(mesh, circumradii(mesh), "all_points"), 6)
    2.5
    """
    everywhere = np.full(len(mesh.xy), np.inf)
    cover = float(kernels.covering_radius(mesh.triangles, radii, everywhere))
    kept = radii <= cover * (1 + ROUNDING)
    node, nodes = kernels.patches(mesh.neighbours, kept)
    pieces = len(np.unique(node[kept]))
    if rule == "all_points" or pieces == 1:
        return cover
    others = np.flatnonzero(~kept)
    node[others] = -1
    order = others[np.argsort(radii[others])]
    return float(kernels.one_piece(mesh.neighbours, radii, order, node, nodes, pieces, ROUNDING))


def circumradii(mesh: Mesh, *, ctx: Context = QUIET) -> Floats:
    """Circumradius of each triangle.

    Examples
    --------
    >>> circumradii(triangulate(np.array([[0, 0], [3, 0], [0, 4.0]])))
    array([2.5])
    """
    return _of_triangles(kernels.radii_block, mesh, ctx)


def _of_triangles(kernel: Callable[..., Any], mesh: Mesh, ctx: Context) -> Floats:
    """The value that a kernel computes for each triangle."""
    found = np.empty(len(mesh.triangles))
    in_blocks(
        lambda first, last: kernel(mesh.xy, mesh.triangles, first, last, found),
        len(found),
        BLOCK,
        ctx,
    )
    return found


def _trimmed(mesh: Mesh, kept: Mask, hole_threshold: float, region_threshold: float) -> Mask:
    """Mask of kept triangles, with small holes filled and then small regions dropped."""
    if hole_threshold > 0:
        small, rim = _small_patches(mesh, kept, hole_threshold)
        kept = kept | (small & ~rim)
    if region_threshold > 0:
        small, _ = _small_patches(mesh, kept, region_threshold)
        kept = kept & ~small
    return kept


def _small_patches(mesh: Mesh, kept: Mask, threshold: float) -> tuple[Mask, Mask]:
    """True for triangles in patches below an area, and for those in patches at the convex hull."""
    patch, count = kernels.patches(mesh.neighbours, kept)
    small = np.ones(count, bool)
    if np.isfinite(threshold):
        areas = _of_triangles(kernels.areas_block, mesh, QUIET)
        small = np.bincount(patch, areas, minlength=count) < threshold
    rim = np.zeros(count, bool)
    rim[patch[np.nonzero(mesh.neighbours < 0)[0]]] = True
    return small[patch], rim[patch]


def _outlined(mesh: Mesh, kept: Mask) -> tuple[NDArray[Any], NDArray[np.int64], Ints]:
    """Polygons around the kept triangles, the largest first; the points in each, and a corner."""
    import shapely

    if not kept.any():
        return np.empty(0, object), np.empty(0, np.int64), np.empty(0, np.int32)
    patch, count = kernels.patches(mesh.neighbours, kept)
    corners, ends, facets, twice = kernels.trace(
        mesh.xy, mesh.triangles, mesh.neighbours, kept, kernels.count_rim(mesh.neighbours, kept)
    )
    lengths = np.diff(ends, prepend=0)
    rings = shapely.linearrings(mesh.xy[corners], indices=np.repeat(np.arange(len(ends)), lengths))
    region = patch[facets]
    x, y = mesh.xy[corners[ends - lengths]].T
    # The ring with the largest area, seen counter-clockwise, is the one around a region.
    is_hole = np.ones(len(ends), bool)
    by_area = np.lexsort((-twice, region))
    is_hole[by_area[np.unique(region[by_area], return_index=True)[1]]] = False
    order = np.lexsort((y, x, is_hole, region))
    patches, number = np.unique(region[order], return_inverse=True)
    polygons = shapely.polygons(rings[order], indices=number)
    shell = order[~is_hole[order]]
    largest = np.lexsort((y[shell], x[shell], -shapely.area(polygons)))
    rank = np.full(count, -1, np.int32)
    rank[patches[largest]] = np.arange(len(patches))
    points = _points_in(mesh, rank[patch], len(patches))
    return polygons[largest], points, corners[(ends - lengths)[shell[largest]]]


def _points_in(mesh: Mesh, rank: Ints, count: int) -> NDArray[np.int64]:
    """Number of points at the triangles of each rank."""
    owner = np.full(len(mesh.xy), count, np.int32)
    kernels.owners(mesh.triangles, rank, owner)
    return np.bincount(owner[mesh.duplicate_of], minlength=count + 1)[:count]
