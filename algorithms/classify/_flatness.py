"""How far points on a plane are from it: no less than the noise of the survey, learned from it.

Most ground is smooth within a metre: streets, lawns, fields. What its points scatter by there is
the noise of the survey, which the points of roofs have, too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FLAT = 0.06  # metres from a plane (standard deviation) up to which points lie on it, at least
WINDOW = 50.0  # metres; what is learned holds for the middle one of three times three
REACH = 2 * WINDOW  # metres, of ground that a point learns from
BIN, BINS = 0.005, 60  # metres, the classes of scatter; all above the last are in it
SMOOTH = 0.25  # share of the ground that is smooth: the quantile of its scatter that is noise
USUAL = 0.03  # metres of noise that `least` allows for: more than surveys of today have
MOST = 0.2  # metres: about what leaves scatter by, so that nothing is told beyond
FEWEST = 50  # points on the ground around that can tell the noise: one in four is asked

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


def by_noise(xy: Floats, scatter: Floats, ground: Mask, least: float, metre: float) -> Floats:
    """Metres from a plane up to which the points around lie on it, for each point.

    What makes points leave a plane adds up in squares: what roofs are rough by, and noise.
    The lattice of windows begins at the origin of the coordinates, so that any part of the points,
    with enough around, gets what the whole gets.

    Parameters
    ----------
    xy : array of shape (n, 2)
    scatter : array of shape (n,), metres from the planes around the points; NaN where unknown
    ground : array of shape (n,)
    least : metres, the result where the ground scatters little, or there is none
    metre : length of one metre in the unit of the points

    Returns
    -------
    array of shape (n,)

    Examples
    --------
    >>> xy = np.random.default_rng(0).uniform(0, 50, (1000, 2))
    >>> by_noise(xy, np.full(1000, 0.081), np.ones(1000, bool), 0.06, 1.0)[:3].round(3)
    array([0.096, 0.096, 0.096])
    """
    if not len(xy):
        return np.zeros(0)
    import pandas

    col, row = (np.floor(xy[:, axis] / (WINDOW * metre)) for axis in (0, 1))
    row -= row.min() - 1
    cols = int(np.ptp(col)) + 3  # an empty window between two rows
    # Far fewer windows than points: hashing them is faster than sorting.
    place, own = pandas.factorize((row * cols + (col - col.min() + 1)).astype(np.int64), sort=True)
    told = np.flatnonzero(ground & np.isfinite(scatter))
    classes = np.minimum(scatter[told] / BIN, BINS - 1).astype(np.int64)
    counts = np.bincount(place[told] * BINS + classes, minlength=len(own) * BINS)
    counts = counts.reshape(len(own), BINS)
    noise = _quantiles(_around(own, counts, cols), SMOOTH)
    more = np.nan_to_num(np.maximum(noise**2 - USUAL**2, 0.0))
    found = np.where(more > 0, np.minimum(np.sqrt(least**2 + more), max(MOST, least)), least)
    return np.asarray(found[place])


def _around(own: NDArray[np.int64], counts: NDArray[np.int64], cols: int) -> NDArray[np.int64]:
    """Sums of the counts of each window and the eight around it; windows are sorted by number."""
    total = np.zeros_like(counts)
    for away in (north * cols + east for north in (-1, 0, 1) for east in (-1, 0, 1)):
        at = np.minimum(np.searchsorted(own, own + away), len(own) - 1)
        there = own[at] == own + away
        total[there] += counts[at[there]]
    return total


def _quantiles(counts: NDArray[np.int64], share: float) -> Floats:
    """Scatter in metres that a share of the points does not exceed; NaN where they are few."""
    total = counts.cumsum(axis=1)
    wanted = share * total[:, -1:]
    last = np.argmax(total >= wanted, axis=1)
    row = np.arange(len(counts))
    before = total[row, last] - counts[row, last]
    within = (wanted[:, 0] - before) / np.maximum(counts[row, last], 1)
    return np.where(total[:, -1] < FEWEST, np.nan, BIN * (last + within))
