"""Height of points above the ground below them.

References
----------
Shepard, D. (1968). A two-dimensional interpolation function for irregularly-spaced data. ACM
National Conference, 517-524: inverse distance weighting.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.shared.delaunay import triangulate
from algorithms.shared.lowest import require_finite
from algorithms.shared.places import averaged
from toolbox.context import QUIET, Context, log
from toolbox.errors import DataError

BLOCK = 200_000  # points between two checks for cancellation

Method = Literal["tin", "nearest"]
Floats = NDArray[np.float64]


def height_above_ground(
    xyz: Floats,
    ground_xyz: Floats,
    *,
    method: Method = "tin",
    count: int = 1,
    max_distance: float | None = None,
    ctx: Context = QUIET,
) -> Floats:
    """Height of points above the ground.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    ground_xyz : array of shape (m, 3); points at one position are averaged
    method : "tin" for the plane of the Delaunay triangle, and the nearest ground point outside of
        all triangles; "nearest" for the nearest ground points in plan
    count : ground points used with "nearest", weighted by the inverse of their distance
    max_distance : NaN where no ground point is within this distance in plan, in the unit of xyz
    ctx : progress and cancellation

    Returns
    -------
    array of shape (n,)
        In the unit of xyz, below zero under the ground; the same for any order of the points.

    Raises
    ------
    DataError
        There is no ground point.
    ValueError
        A coordinate is not a finite number.

    Examples
    --------
    >>> ground = np.array([[0.0, 0, 5], [9, 0, 5], [0, 9, 5]])
    >>> height_above_ground(np.array([[2.0, 2.0, 7.5]]), ground)
    array([2.5])
    """
    for points in (xyz, ground_xyz):
        require_finite(points)
    if not len(ground_xyz):
        raise DataError("points: there is no ground to measure heights from")
    # Measured from near by, sums and products of coordinates keep all their digits.
    origin = np.floor(ground_xyz[:, :2].min(axis=0))
    places = xyz[:, :2] - origin
    ground, elevation = averaged(ground_xyz[:, :2] - origin, ground_xyz[:, 2])
    ctx.progress(0.1)
    below = np.full(len(xyz), np.nan)
    if method == "tin":
        below = _on_facets(ground, elevation, places, ctx.part(0.1, 0.8))
    tree = cKDTree(ground)
    for some in _blocks(np.flatnonzero(np.isnan(below)), ctx.part(0.8, 0.9)):
        below[some] = _from_nearest(tree, elevation, places[some], count)
    if max_distance is not None:
        for some in _blocks(np.arange(len(xyz)), ctx.part(0.9, 1.0)):
            near, _ = tree.query(places[some])
            below[some[near > max_distance]] = np.nan
    ctx.progress(1.0)
    return np.asarray(xyz[:, 2] - below)


def _on_facets(ground: Floats, elevation: Floats, places: Floats, ctx: Context) -> Floats:
    """Elevation at positions in the Delaunay triangulation of the ground, NaN outside of it."""
    try:
        mesh = triangulate(ground, ctx=ctx.part(0.0, 0.5))
    except DataError:  # fewer than three ground points, or all of them on a line
        log.info("the ground spans no triangle; heights are from the nearest ground point")
        return np.full(len(places), np.nan)
    return mesh.interpolate(elevation, places, ctx=ctx.part(0.5, 1.0))


def _from_nearest(tree: cKDTree, elevation: Floats, places: Floats, count: int) -> Floats:
    """Elevation at positions: inverse-distance mean of the nearest `count` points of the tree."""
    count = min(count, tree.n)
    distance, index = (np.asarray(a) for a in tree.query(places, range(1, count + 2)))
    for row in np.flatnonzero(distance[:, count] == distance[:, count - 1]):
        # Which of equally near points the tree finds depends on all others; take the first.
        reach = distance[row, count] * (1 + 1e-12)
        near = np.sort(tree.query_ball_point(places[row], reach))
        away = np.hypot(*(tree.data[near] - places[row]).T)
        order = np.argsort(away.round(9), kind="stable")[:count]
        distance[row, :count], index[row, :count] = away[order], near[order]
    distance, index = distance[:, :count], index[:, :count]
    exact = distance[:, 0] == 0
    distance[exact] = np.where(distance[exact] == 0, 1, np.inf)
    weight = distance[:, :1] / distance  # relative, so that nothing overflows
    return np.asarray((weight * elevation[index]).sum(axis=1) / weight.sum(axis=1))


def _blocks(indices: NDArray[np.int64], ctx: Context) -> Iterator[NDArray[np.int64]]:
    """Blocks of BLOCK indices, with progress after each."""
    for start in range(0, len(indices), BLOCK):
        yield indices[start : start + BLOCK]
        ctx.progress(min(1.0, (start + BLOCK) / len(indices)))
