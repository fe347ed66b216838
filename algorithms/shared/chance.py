"""Pseudorandom numbers from coordinates, so that a sample depends on the points alone.

References
----------
Steele, G. L., Lea, D. and Flood, C. H. (2014). Fast splittable pseudorandom number generators.
OOPSLA 2014, 453-472: the mixing function (SplitMix64).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels.compiling import helper, kernel


def random_keys(xyz: NDArray[np.float64], seed: int) -> NDArray[np.uint64]:
    """Pseudorandom number of each point of shape (n, 3), by its coordinates and the seed alone.

    The points with the lowest numbers are a random sample. Points at one position have the same
    number.

    Examples
    --------
    >>> first, second, third = random_keys(np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0.0]]), seed=1)
    >>> first == third, first == second
    (np.True_, np.False_)
    """
    return np.asarray(_keys(np.ascontiguousarray(xyz).view(np.uint64), np.uint64(seed)))


@kernel
def _keys(bits, seed):
    keys = np.empty(len(bits), np.uint64)
    for i in range(len(bits)):
        key = _mixed(seed)
        for axis in range(3):
            key = _mixed(key ^ bits[i, axis])
        keys[i] = key
    return keys


@helper
def _mixed(key):
    key += np.uint64(0x9E3779B97F4A7C15)
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return key ^ (key >> np.uint64(31))
