"""Edges in a raster by the Canny operator, one cell wide.

References
----------
Canny, J. (1986). A computational approach to edge detection. IEEE Transactions on Pattern Analysis
and Machine Intelligence 8(6), 679-698.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter, sobel

TRUNCATE = 4.0  # standard deviations after which the Gaussian ends
SOBEL = 8.0  # weight of the Sobel kernel, so that gradients are differences per cell
SQUARE = np.ones((3, 3), bool)
AROUND = np.array([(0, 1), (1, 1), (1, 0), (1, -1)])  # row, column: east, south-east, south, ...

Floats = NDArray[np.float64]


def canny(values: Floats, sigma: float, low: float, high: float, reach: int) -> NDArray[np.bool_]:
    """True for the cells on edges of a raster, by the Canny operator.

    Smooth by a Gaussian, take the gradient, keep the cells in which it is larger than in both
    neighbours across the edge, and of those the strong ones and weak ones that go on from them.

    Parameters
    ----------
    values : array of shape (rows, cols), finite
    sigma : of the Gaussian, in cells
    low, high : gradient per cell of weak and of strong edges
    reach : cells that weak edges may go on from a strong one; so an edge depends on what is near

    Returns
    -------
    array of shape (rows, cols)
    """
    smooth = gaussian_filter(values, sigma, mode="nearest", truncate=TRUNCATE)
    south, east = (sobel(smooth, axis=axis, mode="nearest") / SOBEL for axis in (0, 1))
    gradient = np.hypot(south, east)
    thin = gradient >= _across(gradient, south, east)
    weak = thin & (gradient >= low)
    strong = weak & (gradient >= high)
    return np.asarray(binary_dilation(strong, SQUARE, iterations=reach, mask=weak))


def _across(gradient: Floats, south: Floats, east: Floats) -> Floats:
    """The larger gradient of the two neighbours of each cell in the direction of its gradient."""
    eighth = np.rint(np.arctan2(south, east) / (np.pi / 4)).astype(np.int64) % 4
    padded = np.pad(gradient, 1)
    row, col = np.indices(gradient.shape) + 1
    down, right = AROUND[eighth].transpose(2, 0, 1)
    return np.asarray(np.maximum(padded[row + down, col + right], padded[row - down, col - right]))
