"""Sums of a raster in Gaussian windows, for blocks of its cells."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Floats = NDArray[np.float64]


def window_sums(values: NDArray[np.generic], block: int, sigma: float) -> Floats:
    """Sum of the values in a Gaussian window around each block of cells.

    The weight of the window is 1 in the middle of the block, so sums of ones are counts.

    Parameters
    ----------
    values : array of shape (rows, cols), both multiples of `block`; finite
    block : cells on a side of a block
    sigma : standard deviation of the window, in cells; it ends at three of them

    Returns
    -------
    array of shape (rows / block, cols / block)

    Examples
    --------
    >>> one = np.zeros((64, 64))
    >>> one[33, 33] = 5.0
    >>> window_sums(one, 8, 16.0)[4, 4:6].round(1)  # in the middle, and half a window beside it
    array([5. , 4.4])
    """
    rows, cols = values.shape
    sums = values.reshape(rows // block, block, cols // block, block).sum(axis=(1, 3), dtype=float)
    wide = sigma / block
    mean: Floats = gaussian_filter(sums, wide, mode="constant", truncate=3.0)
    return mean * (math.tau * wide * wide)


def spread(values: Floats, block: int) -> Floats:
    """A value for each cell from one for each block.

    Examples
    --------
    >>> spread(np.array([[1.0, 2.0]]), 2)
    array([[1., 1., 2., 2.],
           [1., 1., 2., 2.]])
    """
    return values.repeat(block, axis=0).repeat(block, axis=1)
