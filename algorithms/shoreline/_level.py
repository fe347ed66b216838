"""Levels of water from heights, by modes: neither banks above nor errors below affect them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FEW = 0.05  # share of the heights that make a mode
FIRST_SIGMA = 0.05  # m: deviation of points on water, before it is known
LEAST_SIGMA, MOST_SIGMA = 0.01, 0.15  # m: of a calm lake, and of a windy one
FEWEST = 10  # points on the water that tell its level
SQUARE = 20.0  # m
BIN, EDGE = 0.05, 0.3  # m: heights that are counted together, and that belong to an edge
ROUNDS = 10  # of narrowing down; it settles after few


def mode(heights: NDArray[np.floating[Any]], width: float) -> float:
    """Median of the heights in the fullest interval of a width, the lowest of equally full ones."""
    h = np.sort(heights)
    ends = np.searchsorted(h, h + width, side="right")
    first = int(np.argmax(ends - np.arange(len(h))))
    return float(np.median(h[first : ends[first]]))


def lowest_mode(heights: NDArray[np.floating[Any]], width: float) -> float:
    """Median of the heights in the lowest interval of a width that holds a share of FEW of them."""
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
        """Heights of the surface at positions of shape (n, 2)."""
        if self.gradient == (0.0, 0.0):
            return np.full(len(xy), self.height)
        return np.asarray(self.height + (xy - np.array(self.centre)) @ np.array(self.gradient))


def level_of(xyz: Floats, core: NDArray[np.bool_], start: float, metre: float) -> Level:
    """Level of a water body from points on the water.

    Banks, boats and reeds above and errors below hardly move it: of the points within three
    standard deviations of their own median the mean is taken.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    core : array of shape (n,), points far from the shore, which tell the level
    start : a first estimate
    metre : length of one metre in the unit of the points

    Notes
    -----
    Errors by waves and strips are alike within a square, so the standard error is that of the means
    of squares.
    """
    every, xyz = xyz[:, 2], xyz[core]
    heights, middle, sigma = xyz[:, 2], start, FIRST_SIGMA * metre
    for _ in range(ROUNDS):
        near = abs(heights - middle) <= 3 * sigma
        if near.sum() < FEWEST:
            return Level(start, FIRST_SIGMA * metre, FIRST_SIGMA * metre, int(near.sum()))
        middle = float(np.median(heights[near]))
        inner = float(np.median(abs(heights[near] - middle))) / 0.6745
        sigma = min(max(inner, LEAST_SIGMA * metre), MOST_SIGMA * metre)
    near = abs(heights - middle) <= 3 * sigma
    square = np.floor(xyz[near, :2] / (SQUARE * metre)).astype(np.int64)
    _, block, counts = np.unique(square, axis=0, return_inverse=True, return_counts=True)
    means = np.bincount(block.ravel(), heights[near]) / counts
    level, share = float(heights[near].mean()), counts / counts.sum()
    free = 1 - (share**2).sum()
    scatter = np.sqrt((share**2 * (means - level) ** 2).sum() / free) if len(means) > 1 else sigma
    least = sigma / np.sqrt(near.sum())
    below = level - every[(every < level) & (every > level - MOST_SIGMA * 3 * metre)]
    if len(below) >= FEWEST:  # nearer to the shore waves may be higher; banks are never below
        sigma = max(sigma, min(float(np.median(below)) / 0.6745, MOST_SIGMA * metre))
    return Level(level, float(max(scatter, least)), sigma, int(near.sum()))


def edge_level(xyz: Floats, start: float, metre: float) -> Level:
    """Level of a water body without returns, from points on its shore.

    The lowest points on a bank lie between the level and a spacing up the slope: their heights
    begin at the level. That is where their number per height reaches half of its most.

    Parameters
    ----------
    xyz, start, metre : see :func:`level_of`
    """
    heights = np.sort(xyz[:, 2])
    width = BIN * metre
    heights = heights[abs(heights - start) <= EDGE * metre]
    if len(heights) < FEWEST:
        return Level(start, FIRST_SIGMA * metre, FIRST_SIGMA * metre, len(heights))
    at = np.arange(heights[0], start + width, width / 10)
    many = np.searchsorted(heights, at + width) - np.searchsorted(heights, at)
    first = int(np.argmax(many >= many.max() / 2))
    error = width / np.sqrt(max(many[first], 1))
    level = float(at[first] + width / 2)
    return Level(level, float(max(error, LEAST_SIGMA * metre)), width, int(many.max()))
