"""What the intensity of points tells: nothing, where it is by chance.

References
----------
von Neumann, J. (1941). Distribution of the ratio of the mean square successive difference to the
variance. Annals of Mathematical Statistics 12(4), 367-395.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

SAMPLE = 20_000  # points that tell it
SIGMAS = 3.0  # standard errors by which neighbours are more alike than any two points, at least

Floats = NDArray[np.float64]


def by_chance(shades: Floats, xyz: Floats) -> bool:
    """Whether points side by side differ in their intensity as much as any two do.

    Walls, panes and goods each send back their own share of the light, so neighbours are alike. The
    ranks of intensities are looked at, as a few may be far brighter than all others. An intensity
    that all points share tells nothing either, but not by chance.

    Parameters
    ----------
    shades : array of shape (n,)
    xyz : array of shape (n, 3)

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> xyz = rng.random((2000, 3)) * [10, 0.1, 5]
    >>> panes = 1.0 * (xyz[:, 0] % 2 > 1) + rng.normal(0, 1, 2000)
    >>> by_chance(panes, xyz), by_chance(rng.permutation(panes), xyz)
    (False, True)
    """
    each = 1 + len(xyz) // SAMPLE
    shades, xyz = shades[::each], xyz[::each]
    if len(xyz) < 2:
        return False
    ranks = np.searchsorted(np.sort(shades), shades).astype(float)
    nearest = np.asarray(KDTree(xyz).query(xyz, k=[2])[1])[:, 0]  # the first is the point itself
    beside, any_two = (ranks - ranks[nearest]) ** 2 / 2, float(np.var(ranks))
    # Pairs that are each other's nearest count twice, so half as many tell.
    error = float(np.std(beside)) * math.sqrt(2 / len(xyz))
    return any_two > 0 and float(np.mean(beside)) >= any_two - SIGMAS * error
