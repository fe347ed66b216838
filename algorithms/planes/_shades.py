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
    ranks of intensities are looked at, as a few may be far brighter than all others.

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
    beside = float(np.mean((ranks - ranks[nearest]) ** 2)) / 2
    # Pairs that are each other's nearest count twice, so half as many tell.
    return beside >= float(np.var(ranks)) * (1 - SIGMAS * math.sqrt(2 / len(xyz)))
