"""Levels from heights: modes, which neither banks above nor errors below can move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FEW = 0.05  # share of the heights that make a mode
FIRST_SIGMA = 0.05  # m: deviation of points on water, before it is known
LEAST_SIGMA, MOST_SIGMA = 0.01, 0.15  # m: of a calm lake, and of a windy one
FEWEST = 10  # points on the water that tell its level
ROUNDS = 10  # of narrowing down; it settles after few


def mode(heights: Floats, width: float) -> float:
    """Middle of the fullest interval of a width; of equally full ones the lowest."""
    h = np.sort(heights)
    ends = np.searchsorted(h, h + width, side="right")
    first = int(np.argmax(ends - np.arange(len(h))))
    return float(np.median(h[first : ends[first]]))


def lowest_mode(heights: Floats, width: float) -> float:
    """Middle of the lowest interval of a width that holds a share of FEW of the heights."""
    h = np.sort(heights)
    ends = np.searchsorted(h, h + width, side="right")
    many = ends - np.arange(len(h)) >= max(3, FEW * len(h))
    if not many.any():
        return float(h[0])
    first = int(np.argmax(many))
    return float(np.median(h[first : ends[first]]))


@dataclass(frozen=True)
class Level:
    """The surface of a water body: a plane, level in most cases.

    Attributes
    ----------
    height : at `centre`
    error : standard error of the height
    sigma : standard deviation of single points on the water
    points : number of points that it was found from
    gradient : rise eastwards and northwards
    centre : where the height is
    """

    height: float
    error: float
    sigma: float
    points: int
    gradient: tuple[float, float] = (0.0, 0.0)
    centre: tuple[float, float] = (0.0, 0.0)

    def at(self, xy: Floats) -> Floats:
        """Height at places of shape (n, 2)."""
        if self.gradient == (0.0, 0.0):
            return np.full(len(xy), self.height)
        return np.asarray(self.height + (xy - np.array(self.centre)) @ np.array(self.gradient))


def level_of(heights: Floats, start: float, block: NDArray[np.int64], metre: float) -> Level:
    """Level from heights of points on the water.

    Parameters
    ----------
    heights : array of shape (n,)
    start : a first estimate
    block : array of shape (n,), the square that each point lies in: waves and strips err alike
        within one, so that the standard error is that of the means of squares
    metre : length of one metre in the unit of the heights
    """
    middle, sigma = start, FIRST_SIGMA * metre
    for _ in range(ROUNDS):
        near = abs(heights - middle) <= 3 * sigma
        if near.sum() < FEWEST:
            return Level(start, FIRST_SIGMA * metre, FIRST_SIGMA * metre, int(near.sum()))
        middle = float(np.median(heights[near]))
        inner = np.median(abs(heights[near] - middle)) / 0.6745
        sigma = min(max(float(inner), LEAST_SIGMA * metre), MOST_SIGMA * metre)
    near = abs(heights - middle) <= 3 * sigma
    _, squares, counts = np.unique(block[near], return_inverse=True, return_counts=True)
    means = np.bincount(squares, heights[near]) / counts
    level = float(heights[near].mean())
    if len(means) > 1:
        weight = counts / counts.sum()
        error = float(np.sqrt((weight**2 * (means - level) ** 2).sum() / (1 - (weight**2).sum())))
    else:
        error = sigma
    floor = sigma / np.sqrt(near.sum())
    return Level(level, max(error, float(floor)), sigma, int(near.sum()))
