"""Voxels of points, their attributes, and the straight line in each of them.

References
----------
Otsu, N. (1979). A threshold selection method from gray-level histograms. IEEE Transactions on
Systems, Man and Cybernetics 9(1), 62-66.
Fischler, M. A. and Bolles, R. C. (1981). Random sample consensus. CACM 24(6), 381-395.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from toolbox.context import QUIET, Context

SAMPLE_POINTS = 2  # that a line needs; a voxel with no more says nothing about its line

Variance = Literal["low", "high"]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Voxels:
    """The v occupied voxels of n points.

    Attributes
    ----------
    size : of their edges, metres
    cell : array of shape (v, 3), column, row and layer of each
    of_point : array of shape (n,), the voxel of each point
    count : array of shape (v,), points
    centroid : array of shape (v, 3), of their points, metres
    variance : array of shape (v,), of the elevations of their points, square metres
    """

    size: float
    cell: Ints
    of_point: Ints
    count: Ints
    centroid: Floats
    variance: Floats

    @classmethod
    def of(cls, xyz: Floats, size: float) -> Voxels:
        """The voxels of points of shape (n, 3), metres; they begin at multiples of their size.

        Examples
        --------
        >>> voxels = Voxels.of(np.array([[0.0, 0, 1], [1, 0, 2], [4, 0, 0]]), 3.0)
        >>> voxels.count.tolist(), voxels.variance.tolist()
        ([2, 1], [0.25, 0.0])
        """
        cell, of_point, count = np.unique(
            np.floor(xyz / size).astype(np.int64), axis=0, return_inverse=True, return_counts=True
        )
        of_point = of_point.ravel()
        centroid = np.column_stack([np.bincount(of_point, axis) / count for axis in xyz.T])
        off = xyz[:, 2] - centroid[of_point, 2]
        return cls(size, cell, of_point, count, centroid, np.bincount(of_point, off**2) / count)

    @property
    def density(self) -> Floats:
        """Points per cubic metre, array of shape (v,)."""
        return self.count / self.size**3

    def of_variance(self, variance: Variance) -> NDArray[np.bool_]:
        """True for voxels whose variance is at most Otsu's threshold, or above it.

        The thesis prints that voxels of little variance are dropped. But a wire of slope s rises
        by 3 s in a voxel of 3 m, a variance of 0.75 s squared, and a crown that fills one has 0.75:
        wires are those of little variance. Voxels with too few points for a line are not taken.
        """
        enough = self.count > SAMPLE_POINTS
        low = self.variance <= otsu(self.variance[enough])
        return enough & (low if variance == "low" else ~low)


def otsu(values: Floats | Ints) -> float:
    """The threshold that parts numbers of shape (n,) in two with the least variance within each.

    It is found among all gaps between the numbers, which is Otsu's threshold for a histogram of
    bins as narrow as can be. Of numbers that are all the same it is that number.

    Examples
    --------
    >>> otsu(np.array([1.0, 2.0, 9.0, 10.0]))
    5.5
    """
    if not len(values):
        return 0.0
    ordered = np.sort(values.astype(float))
    below = np.arange(1, len(ordered))
    above = len(ordered) - below
    total = np.cumsum(ordered)
    between = below * above * (total[:-1] / below - (total[-1] - total[:-1]) / above) ** 2
    between[np.diff(ordered) == 0] = 0
    if not between.any():
        return float(ordered[-1])
    best = int(between.argmax())
    return float((ordered[best] + ordered[best + 1]) / 2)


def trials(certainty: float, outlier_share: float) -> int:
    """How many random lines are tried, so that one of them surely has no outlier.

    Examples
    --------
    >>> trials(0.99, 0.6)
    27
    """
    all_good = (1 - outlier_share) ** SAMPLE_POINTS
    if all_good == 1:
        return 1
    return max(1, math.ceil(math.log(1 - certainty) / math.log(1 - all_good)))


def lines_in(
    xyz: Floats, voxels: Voxels, *, tolerance: float, tries: int, seed: int, ctx: Context = QUIET
) -> tuple[Floats, Floats]:
    """The line through the points of each voxel that most of them are near to (RANSAC).

    The study fits lines in plan and in both vertical planes. Here that is one line in space, whose
    projections these are, and which has a direction also where a slope would be infinite.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    tolerance : farthest that a point of the line may be off it, metres
    tries : how many lines through two points are tried in each voxel

    Returns
    -------
    direction : array of shape (v, 3), unit vectors; 0 in voxels whose points are all in one place
    share : array of shape (v,), of the points of a voxel that are near its line
    """
    rng = np.random.default_rng(seed)
    order = np.argsort(voxels.of_point, kind="stable")
    points, own, count = xyz[order], voxels.of_point[order], voxels.count
    start = np.cumsum(count) - count
    most, direction = np.zeros(len(count)), np.zeros((len(count), 3))
    for k in range(tries):
        ctx.progress(k / tries)
        one, other = rng.random((2, len(count)))
        first = (one * count).astype(np.int64)
        second = (first + 1 + (other * (count - 1)).astype(np.int64)) % count
        position = points[start + first]
        step = points[start + second] - position
        length = np.linalg.norm(step, axis=1)
        step /= np.where(length > 0, length, 1)[:, None]
        away = np.linalg.norm(np.cross(points - position[own], step[own]), axis=1)
        near = np.where(length > 0, np.bincount(own, away < tolerance), 0)
        better = near > most
        most[better], direction[better] = near[better], step[better]
    return direction, most / count
