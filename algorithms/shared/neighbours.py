"""A k-d tree of points, in which compiled loops find the nearest neighbours of every point.

The answer is exact in clouds of any and of changing density. Of points equally far from a point,
those that come first by x, then y, then z are taken, so that it does not depend on the order of the
points; which of several points at one position is taken is not defined.

References
----------
Friedman, J. H., Bentley, J. L. and Finkel, R. A. (1977). An algorithm for finding best matches
in logarithmic expected time. ACM Transactions on Mathematical Software 3(3), 209-226: the k-d
tree. It is balanced here, so that it needs no pointers, and its boxes are those of the points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels import neighbours as kernels
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import blocks, require_finite
from toolbox.context import QUIET, Context

LEAF = 16  # points at most; from 8 to 32 the time hardly differs

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PointTree:
    """A balanced k-d tree: points sorted so that neighbours are close, and the boxes of its nodes.

    Attributes
    ----------
    xyz : array of shape (n, 3), reordered
    order : array of shape (n,), index of each among the points given
    boxes : array of shape (2**(depth + 1), 6), lowest and highest x, y, z of every node
    depth : level of the leaves

    Examples
    --------
    >>> tree = PointTree.of(np.array([[0, 0, 0], [3, 0, 0], [4, 0, 0.0]]))
    >>> mean, largest = tree.mean_distances(2)
    >>> mean.tolist()  # in the order of the tree, here that of the points
    [3.5, 2.0, 2.5]
    """

    xyz: Floats
    order: NDArray[np.int64]
    boxes: Floats
    depth: int

    @classmethod
    def of(cls, xyz: Floats, *, ctx: Context = QUIET) -> PointTree:
        """Sort points of shape (n, 3) into a tree.

        Raises
        ------
        ValueError
            A coordinate is not a finite number.
        """
        require_finite(xyz)
        depth = _depth(len(xyz))
        sorted_xyz, order = np.array(xyz, order="C"), np.arange(len(xyz))
        for level in range(depth):
            part = ctx.part(level / (depth + 1), (level + 1) / (depth + 1))
            runs = blocks(1 << level, 20 * len(xyz) >> level)
            side_by_side(kernels.split, runs, sorted_xyz, order, level, ctx=part)
        return cls(sorted_xyz, order, kernels.boxes(sorted_xyz, depth), depth)

    @classmethod
    def along(cls, xyz: Floats, order: NDArray[np.int64]) -> PointTree:
        """A tree of points that are sorted along a curve already, of shape (n, 3); they are kept.

        It is made in a tenth of the time, and a search in it takes half as long again.
        """
        depth = _depth(len(xyz))
        return cls(xyz, order, kernels.boxes(xyz, depth), depth)

    @property
    def leaves(self) -> list[tuple[int, int]]:
        """Blocks of leaves (first, last) of some 20,000 points each, to work on in threads."""
        return blocks(1 << self.depth, 1 + (100 * len(self.xyz) >> self.depth))

    def mean_distances(
        self, k: int, *, max_distance: float = np.inf, ctx: Context = QUIET
    ) -> tuple[Floats, Floats]:
        """Mean and largest distance of each point to its k nearest others.

        Parameters
        ----------
        k : 1 or more
        max_distance : a neighbour that is missing within it counts as being that far away

        Returns
        -------
        two arrays of shape (n,), in the order of the tree
        """
        mean, farthest = np.empty(len(self.xyz)), np.empty(len(self.xyz))
        side_by_side(
            kernels.mean_distances,
            self.leaves,
            self.xyz,
            self.boxes,
            self.depth,
            k,
            max_distance,
            mean,
            farthest,
            ctx=ctx,
        )
        return mean, farthest


def _depth(count: int) -> int:
    """Level of the leaves of a tree of so many points."""
    return max(0, (count - 1) // LEAF).bit_length()
