"""What lies around the cells of a raster: sums in windows, the nearest known cell, known cells."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Number = TypeVar("Number", bound=np.generic)


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


def filled(values: NDArray[Number], empty: Mask, reach: float) -> NDArray[Number]:
    """Values with those of empty cells from the nearest other cell within reach.

    Parameters
    ----------
    values : array of shape (..., rows, cols)
    empty : array of shape (rows, cols)
    reach : cells

    Examples
    --------
    >>> known = np.array([[7, 0, 0, 0]])
    >>> filled(known, known == 0, 2.0)
    array([[7, 7, 7, 0]])
    """
    if not empty.any() or empty.all():
        return values
    distance, (row, col) = distance_transform_edt(empty, return_indices=True)
    return np.where(distance <= reach, values[..., row, col], values)


def closed(there: Mask, reach: float) -> Mask:
    """Which cells hold data, or lie in gaps into which no disc fits: a closing, without a rim.

    Parameters
    ----------
    there : array of shape (rows, cols)
    reach : radius of the disc, in cells

    Examples
    --------
    >>> there = np.array([[1, 1, 1, 1], [1, 0, 1, 1], [1, 1, 1, 0]], bool)
    >>> closed(there, 1.0).astype(int)
    array([[1, 1, 1, 1],
           [1, 1, 1, 1],
           [1, 1, 1, 0]])
    """
    around = math.ceil(reach) + 1  # beyond the cells there are none
    near = distance_transform_edt(~np.pad(there, around)) <= reach
    inner = slice(around, -around)
    return there | (distance_transform_edt(near) > reach)[inner, inner]


def between(there: Mask, axis: int) -> Mask:
    """Which cells hold data, or lie between cells that do along an axis.

    Examples
    --------
    >>> between(np.array([[False, True, False, True, False]]), 1)
    array([[False,  True,  True,  True, False]])
    """
    before = np.logical_or.accumulate(there, axis=axis)
    after = np.flip(np.logical_or.accumulate(np.flip(there, axis), axis=axis), axis)
    return np.asarray(before & after)
