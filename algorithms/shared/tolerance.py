"""How far above the terrain a point may be and still be ground, learned from the points.

Where the points of the ground lie close together, as on streets of a dense survey, what is 0.2 m
higher is a plant; where they scatter, as on ploughed land or by the noise of a scanner, it may be
ground. And the farther apart the points are, the less is known of what a slope does between them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from algorithms.shared.kernels.squares import shared_by_two
from algorithms.shared.windows import window_sums

BLOCK = 8  # metres, of the blocks for which this is learned
BIN, REACH = 0.02, 0.5  # metres: the classes of heights about the terrain, and where they end
PEAK = 8  # power of the counts by which classes of heights have a say where most points lie
AROUND = 15.0  # metres, standard deviation of the window from which points count
LEAST, SPREAD = 0.05, 3.0  # metres; standard deviations of the points above the densest height
MOST, MOST_SLOPE = 0.3, 1.0  # metres above the densest height; metres per slope
FEW = 20.0  # points, of which half of the knowledge comes; without any, MOST is taken
NEAR, RARE = 8.0, 0.02  # metres, the window of the share of cells with points; the least share

Floats = NDArray[np.float64]
Cells = NDArray[np.float32]
Ints = NDArray[np.int64]


def share_with_points(z: Cells) -> Floats:
    """Share of the cells of a metre around each block that hold points, at least RARE.

    Examples
    --------
    >>> z = np.full((32, 32), np.nan, np.float32)
    >>> z[::2, ::2] = 9.0
    >>> share_with_points(z)[1, 1].round(2)
    np.float64(0.25)
    """
    there = window_sums(np.isfinite(z), BLOCK, NEAR)
    share: Floats = np.maximum(there / window_sums(np.ones(z.shape), BLOCK, NEAR), RARE)
    return share


def tolerances(above: Floats, blocks: Ints, share: Floats) -> Floats:
    """Heights above the terrain up to which points are ground, by blocks.

    The height at which most points lie is that of the ground. What is below scatters as the
    ground does, while above it there are plants, too.

    Parameters
    ----------
    above : array of shape (n,), heights of points above the terrain, in metres; NaN for unknown
    blocks : array of shape (n,), the block of each, counted row by row
    share : see :func:`share_with_points`

    Returns
    -------
    array of shape (2, rows / BLOCK, cols / BLOCK)
        Metres on level ground, and metres more per slope: half the distance between points.

    Examples
    --------
    >>> above = np.random.default_rng(1).normal(0.05, 0.03, 4000)
    >>> tolerances(above, np.full(4000, 5), np.ones((3, 3)))[:, 1, 1].round(1)
    array([0.2, 0.5])
    """
    counts = histograms(above, blocks, share.shape)
    height = BIN * (np.arange(counts.shape[2], dtype=np.float64) + 0.5) - REACH
    densest = densest_heights(counts, height)
    below = densest[..., None] - height
    lower = counts * np.clip(below / BIN + 0.5, 0, 1)
    square = (lower * below**2).sum(axis=2)
    spread = np.sqrt(square / np.maximum(lower.sum(axis=2), 1e-9))
    level = densest + np.minimum(LEAST + SPREAD * spread, MOST)
    known = counts.sum(axis=2)
    level = (known * level + FEW * MOST) / (known + FEW)
    slope = np.minimum(0.5 / np.sqrt(share), MOST_SLOPE)
    return np.stack([level, slope])


def densest_heights(counts: Floats, height: Floats) -> Floats:
    """Height at which most points lie: a mean in which the fullest classes count by far the most.

    The fullest class alone would leap to another one for a single point more.

    Examples
    --------
    >>> densest_heights(np.array([0.0, 9, 9, 0, 0, 0, 5, 0]), np.arange(8.0)).round(2)
    np.float64(1.48)
    """
    smooth = gaussian_filter(counts, (*(0,) * (counts.ndim - 1), 1))
    fullest = smooth.max(axis=-1, keepdims=True)
    share = (smooth / np.maximum(fullest, 1e-9)) ** PEAK
    densest: Floats = (share * height).sum(axis=-1) / np.maximum(share.sum(axis=-1), 1e-9)
    return densest


def histograms(above: Floats, blocks: Ints, shape: tuple[int, ...]) -> Floats:
    """Points of each class of heights in the window around each block, array of shape (*shape, k).

    Examples
    --------
    >>> histograms(np.array([0.01, 0.03, 9.0]), np.zeros(3, int), (1, 1))[0, 0, 24:28].round(1)
    array([0., 1., 1., 0.])
    """
    classes = round(2 * REACH / BIN)
    lower, upper = np.zeros((2, math.prod(shape), classes))
    # a point between the middles of two classes is of both
    shared_by_two(above, blocks, REACH, BIN, lower, upper)
    lower += upper
    wide = AROUND / BLOCK
    mean: Floats = gaussian_filter(
        lower.reshape(*shape, classes), (wide, wide, 0), mode="constant", truncate=3
    )
    return mean * (math.tau * wide * wide)
