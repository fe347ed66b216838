"""Surfaces over the Delaunay triangulation of points: linear, natural and cubic."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.delaunay import Mesh, triangulate
from algorithms.shared.kernels.threads import in_blocks
from algorithms.surface import _tin_kernels as kernels
from toolbox.context import QUIET, Context
from toolbox.data import Lattice

BLOCK = 100_000  # triangles or vertices between two checks for cancellation
COLUMNS = 16  # of cells that one thread takes: their points, sorted by x, are near in memory
STEPS = 18  # of the gradients; each divides their error by 3.7
COUPLING = 0.5  # of a gradient to those of its neighbours, at most, whatever the points

Array = NDArray[np.float64]


class Tin:
    """A Delaunay triangulation, and the triangle of each cell centre.

    Parameters
    ----------
    xy : array of shape (n, 2), each position once, in the order of x, then y
    lattice : the cells
    limit : triangles whose circle, in which there is no point, has a larger radius are gaps
    ctx : progress and cancellation

    Raises
    ------
    DataError
        The points do not span a triangle.
    """

    def __init__(
        self, xy: Array, lattice: Lattice, limit: float = math.inf, *, ctx: Context = QUIET
    ) -> None:
        self.lattice, self.limit = lattice, limit
        self.mesh: Mesh = triangulate(xy, ctx=ctx.part(0, 0.8))
        self.facet = np.full(lattice.shape, -1, np.int32)
        where = (limit, *lattice.centres(), lattice.cell, self.facet)
        in_blocks(
            lambda first, last: kernels.draw(
                self.mesh.xy, self.mesh.triangles, first, last, *where
            ),
            len(self.mesh.triangles),
            BLOCK,
            ctx.part(0.8, 1),
        )

    def linear(self, values: Array, *, ctx: Context = QUIET) -> Array:
        """Linear interpolation: the height of the plane of the triangle around each cell centre.

        Parameters
        ----------
        values : array of shape (n,)

        Returns
        -------
        array of shape (rows, cols)
            NaN where there is no triangle.
        """
        surface = np.full(self.lattice.shape, np.nan)
        mesh, (x, y) = self.mesh, self.lattice.centres()
        self._by_columns(
            lambda first, last: kernels.linear(
                mesh.xy, values, mesh.triangles, self.facet, first, last, x, y, surface
            ),
            ctx,
        )
        return surface

    def natural(self, values: Array, *, ctx: Context = QUIET) -> tuple[Array, NDArray[np.int32]]:
        """Natural neighbour interpolation: means of the neighbours, weighted by Voronoi area.

        Returns
        -------
        surface : array of shape (rows, cols), NaN where there is no triangle, and where the
            Voronoi cell of the centre reaches farther than the limit
        used : array of shape (rows, cols), number of neighbours
        """
        surface, used = np.full(self.lattice.shape, np.nan), np.zeros(self.lattice.shape, np.int32)
        mesh, (x, y) = self.mesh, self.lattice.centres()
        facets = (mesh.triangles, mesh.neighbours, self.limit, self.facet)
        self._by_columns(
            lambda first, last: kernels.natural(
                mesh.xy, values, *facets, first, last, x, y, surface, used
            ),
            ctx,
        )
        return surface, used

    def cubic(self, values: Array, *, ctx: Context = QUIET) -> Array:
        """Cubic interpolation: a smooth surface through the points; see :meth:`linear`."""
        surface = np.full(self.lattice.shape, np.nan)
        mesh, (x, y) = self.mesh, self.lattice.centres()
        gradients = self.gradients(values, ctx=ctx.part(0, 0.7))
        facets = (mesh.triangles, mesh.neighbours, self.limit, self.facet)
        self._by_columns(
            lambda first, last: kernels.cubic(
                mesh.xy, values, gradients, *facets, first, last, x, y, surface
            ),
            ctx.part(0.7, 1),
        )
        return surface

    def gradients(self, values: Array, *, ctx: Context = QUIET) -> Array:
        """Gradients at the vertices that minimise the bending of all edges together (Nielson 1983).

        Each depends on those at the other ends of its edges, by half as much at most. STEPS steps
        of Chebyshev's iteration, all vertices at once, leave a negligible error and a finite reach:
        a gradient depends on vertices no farther than STEPS + 1 edges.

        Returns
        -------
        array of shape (n, 2), rise along x and along y
        """
        mesh, size = self.mesh, len(values)
        starts = np.zeros(size + 1, np.int64)
        ends = kernels.edges(mesh.xy, mesh.triangles, mesh.neighbours, self.limit, starts)
        ways, inverse, plane = np.empty((len(ends), 2)), np.zeros((size, 3)), np.zeros((size, 2))
        stages = np.linspace(0.2, 1.0, STEPS + 2)
        in_blocks(
            lambda first, last: kernels.planes(
                mesh.xy, values, starts, ends, first, last, ways, inverse, plane
            ),
            size,
            BLOCK,
            ctx.part(*stages[:2]),
        )
        before, now, weight = np.zeros((size, 2)), plane.copy(), 1.0
        for step in range(STEPS):
            state = (weight, now, before)
            in_blocks(
                lambda first, last, state=state: kernels.relax(  # type: ignore[misc]
                    starts, ends, ways, inverse, plane, first, last, *state
                ),
                size,
                BLOCK,
                ctx.part(*stages[step + 1 : step + 3]),
            )
            before, now = now, before
            weight = 1 / (1 - COUPLING**2 * weight / (4 if step else 2))
        return now

    def left_out(self, values: Array, *, ctx: Context = QUIET) -> Array:
        """Squared leave-one-out error: value of each vertex against the plane there without it.

        Returns
        -------
        array of shape (n,)
            NaN at the hull and at gaps.
        """
        mesh, squares = self.mesh, np.empty(len(values))
        of_each = kernels.triangle_of_each(mesh.triangles, len(values))
        facets = (mesh.triangles, mesh.neighbours, self.limit, of_each)
        in_blocks(
            lambda first, last: kernels.left_out(mesh.xy, values, *facets, first, last, squares),
            len(values),
            BLOCK,
            ctx,
        )
        return squares

    def _by_columns(self, work: Callable[[int, int], object], ctx: Context) -> None:
        in_blocks(work, self.lattice.cols, COLUMNS, ctx)
