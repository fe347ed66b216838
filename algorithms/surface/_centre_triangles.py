"""Linear surfaces over a Delaunay triangulation of which only what is needed is made.

Where there are many points to a cell, few of the triangles lie over a cell centre. The one that
does is found by itself: it is the triangle whose circle is empty. Where that circle is large, as
beside buildings, water and the rim, the points around gaps are triangulated. These are all that can
be corners there: a large empty circle holds empty squares, and its corners are near these. So the
surface is that of the triangulation of all points, to the last bit.

References
----------
Brown, K. Q. (1979). Voronoi diagrams from convex hulls. Information Processing Letters 9(5),
223-228. Raised by their squared distances, the points have a lower hull of which the triangles are
the facets: the one at a position is the answer to a linear program of three unknowns.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from algorithms.shared.kernels.threads import in_blocks
from algorithms.shared.places import averaged
from algorithms.surface import _centre_triangles_kernels as kernels
from algorithms.surface._near import Buckets, buckets
from algorithms.surface._tin import Tin
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice

MANY = 1.5  # points per cell; where there are 1.1, making all triangles takes as long
MOST = 0.5  # of the points beside gaps; where there are more, nothing is gained
BLOCK = 20_000  # cells between two checks for cancellation

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def linear(
    xy: Array, values: Array, lattice: Lattice, limit: float = math.inf, *, ctx: Context = QUIET
) -> Array:
    """Linear interpolation at cell centres, as that of a :class:`Tin` of the averaged points.

    Parameters
    ----------
    xy : array of shape (n, 2)
    values : array of shape (n,), averaged where points share a position
    lattice : the cells
    limit : triangles whose circle, in which there is no point, has a larger radius are gaps
    ctx : progress and cancellation

    Returns
    -------
    array of shape (rows, cols)
        NaN where there is no triangle.

    Raises
    ------
    DataError
        The points do not span a triangle.
    """
    surface = np.full(lattice.shape, np.nan)
    if len(xy) >= MANY * surface.size:
        there = buckets(xy, surface.size, ctx=ctx.part(0.0, 0.2))
        xy, values, starts = _settled(there, values)
        beside = _beside_gaps(there, starts)
        chosen = np.repeat(beside.ravel(), np.diff(starts))
        if limit >= kernels.WINDOW * there.size and np.count_nonzero(chosen) < MOST * len(xy):
            _fill(there, xy, values, starts, lattice, surface, ctx.part(0.3, 0.7))
            beside |= _around(there, lattice, np.isnan(surface))
            chosen = np.repeat(beside.ravel(), np.diff(starts))
            xy, values = xy[chosen], values[chosen]
    xy, values = averaged(xy, values, ctx=ctx.part(0.7, 0.75))
    tin = Tin(xy, lattice, limit, ctx=ctx.part(0.75, 0.95))
    return np.where(np.isnan(surface), tin.linear(values, ctx=ctx.part(0.95, 1.0)), surface)


def _settled(there: Buckets, values: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Distinct positions square by square, their mean values, and where each square begins."""
    xy, values, starts = there.xy, values[there.order], there.starts.copy()
    count = kernels.settle(xy, values, starts)
    if count < len(xy):
        log.info("%d points share their place with another; averaged", len(xy) - count)
    return xy[:count], values[:count], starts


def _fill(
    there: Buckets,
    xy: Array,
    values: Array,
    starts: NDArray[np.int64],
    lattice: Lattice,
    surface: Array,
    ctx: Context,
) -> None:
    """Fill in the cells whose triangle is small enough to be found by itself."""
    squares = there.west, there.south, there.size, there.rows, there.cols
    in_blocks(
        lambda first, last: kernels.fill(
            first, last, xy, values, starts, *squares, *lattice.centres(), surface
        ),
        lattice.rows,
        BLOCK // lattice.cols,
        ctx,
    )


def _beside_gaps(there: Buckets, starts: NDArray[np.int64]) -> Mask:
    """Squares whose points may be corners of large triangles: those near 2 x 2 empty ones."""
    edge = kernels.SPREAD + 1  # beyond the points all is empty
    empty = np.pad(
        (np.diff(starts) == 0).reshape(there.rows, there.cols), edge, constant_values=True
    )
    four = empty[1:, 1:] & empty[1:, :-1] & empty[:-1, 1:] & empty[:-1, :-1]
    # The squares of such four, and SPREAD more on each side, `four` being the first of them.
    near = maximum_filter(np.pad(four, ((0, 1), (0, 1))), 2 * edge)
    return np.asarray(near[edge:-edge, edge:-edge])


def _around(there: Buckets, lattice: Lattice, open_cells: Mask) -> Mask:
    """Squares within WINDOW of the centres of some cells, for small triangles that were not found.

    A cell has none in view where one quarter around its centre is empty, or where the triangle is
    so flat that its circle is not known well.
    """
    x, y = lattice.centres()
    row, col = np.nonzero(open_cells)
    up, right = (y[row] - there.south) / there.size, (x[col] - there.west) / there.size
    inside = (up >= 0) & (up < there.rows) & (right >= 0) & (right < there.cols)
    held = np.zeros((there.rows, there.cols), bool)
    held[up[inside].astype(np.int64), right[inside].astype(np.int64)] = True
    return np.asarray(maximum_filter(held, 2 * kernels.WINDOW + 1, mode="constant"))
