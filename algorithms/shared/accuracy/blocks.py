"""Intervals of measures by drawing blocks of ground with replacement.

Errors of neighbouring points come together, in whole roofs and hedges, so a million points say less
than their number. Blocks that are larger than such clumps are nearly independent of each other:
as many of them as there are, drawn again and again, show how far a measure would differ had other
ground been surveyed.

References
----------
Künsch, H. R. (1989). The jackknife and the bootstrap for general stationary observations. Annals of
Statistics 17(3), 1217-1241: blocks in place of single observations.
Efron, B. and Tibshirani, R. J. (1993). An introduction to the bootstrap: section 13.3, percentiles.
Hesterberg, T. C. (2015). What teachers should know about the bootstrap. The American Statistician
69(4), 371-386: section 4.1.1, percentiles of few observations must lie farther out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from toolbox.errors import DataError

Floats = NDArray[np.float64]
Counts = NDArray[np.int64] | NDArray[np.float64]
Measure = Callable[[Floats], Mapping[str, Floats]]

WANTED = 100  # blocks, if nothing is said of their size: percentiles need dozens
MOST = 10_000  # blocks
FEWEST = 20  # blocks below which intervals come out too narrow
LEAST = 8  # blocks below which less than 0.9 of the intervals hold the truth even where errors are
# spread evenly, as rates of an exponential distribution (`tests.bench accuracy`)
DRAWS = 1000  # of which 25 lie beyond each limit
CHUNK = 1 << 22  # numbers of matrices held at a time
SURE = 0.95  # share of intervals that should hold the truth


def blocks(xy: Floats, side: float | None) -> tuple[NDArray[np.int64], float]:
    """Number of the square block of each position, and the side of the blocks.

    Parameters
    ----------
    xy : array of shape (n, 2), n > 0
    side : in the unit of xy; None for one at which some WANTED blocks hold points

    Returns
    -------
    array of shape (n,), and a number
        Blocks are numbered from 0 without gaps, from the lowest coordinates on, so that the order
        of the points does not matter.

    Raises
    ------
    DataError
        There would be more than MOST blocks.

    Examples
    --------
    >>> number, side = blocks(np.array([[0, 0], [3, 0], [4, 0], [21, 8.0]]), 5.0)
    >>> number.tolist()
    [0, 0, 0, 1]
    """
    low, extent = xy.min(axis=0), np.ptp(xy, axis=0)
    if side is None:
        side = float(
            np.sqrt(max(extent[0], extent[1] / WANTED) * max(extent[1], extent[0] / WANTED))
        )
        side = side / np.sqrt(WANTED) or 1.0
        for _ in range(3):  # gaps and slanted outlines leave some of the blocks without points
            held = len(_occupied(xy, low, side)[0])
            side *= float(np.sqrt(min(held / WANTED, 1.0)))
    keys, number = _occupied(xy, low, side)
    if len(keys) > MOST:
        raise DataError(f"block: {len(keys):,} blocks hold points, at most {MOST:,} may; raise it")
    return number, side


def _occupied(xy: Floats, low: Floats, side: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Keys of the blocks that hold positions, and the number of the block of each."""
    column, row = np.floor((xy - low) / side).astype(np.int64).T
    keys, number = np.unique(column * (row.max() + 1) + row, return_inverse=True)
    return keys, number


def drawn(by_block: Counts, seed: int) -> Iterator[Floats]:
    """Matrices of as many blocks as there are, drawn with replacement; DRAWS of them, in stacks.

    Parameters
    ----------
    by_block : array of shape (b, k, k), the matrix of each block
    seed : two calls with one seed and one number of blocks draw the same ones

    Yields
    ------
    arrays of shape (m, k, k)
    """
    count, *shape = by_block.shape
    flat = by_block.reshape(count, -1).astype(float)
    times = np.random.default_rng(seed).multinomial(count, np.full(count, 1 / count), DRAWS)
    step = max(1, CHUNK // flat.shape[1])
    for first in range(0, DRAWS, step):
        yield (times[first : first + step].astype(float) @ flat).reshape(-1, *shape)


def intervals(by_block: Counts, measure: Measure, seed: int) -> dict[str, tuple[Floats, Floats]]:
    """Limits of the 95 % interval of each measure; NaN where the blocks tell none.

    That is so with fewer than LEAST blocks, and where all draws have the same value: blocks of
    which none has an error do not say how rare errors are.

    Parameters
    ----------
    by_block : array of shape (b, k, k)
    measure : computes measures of a stack of matrices, by name; each of shape (m, ...)
    seed : of the draws

    Returns
    -------
    dict of pairs of arrays of shape (...)
        Draws in which a measure is not defined are left out.
    """
    found = [measure(stack) for stack in drawn(by_block, seed)]
    spread: dict[str, tuple[Floats, Floats]] = {}
    for name in found[0]:
        low, high = limits(np.concatenate([f[name] for f in found]), by_block)
        spread[name] = np.where(low < high, low, np.nan), np.where(low < high, high, np.nan)
    return spread


def percentiles(count: int) -> tuple[float, float]:
    """The percentiles of the draws of some blocks that are the limits of an interval of 95 %.

    Draws of n blocks differ by too little, by the root of (n - 1) / n, and their spread is itself
    estimated from n blocks: percentiles are taken as far out as Student's distribution has them.

    Examples
    --------
    >>> [round(percentiles(n)[0], 1) for n in (1000, 100, 20, 5)]
    [2.5, 2.3, 1.6, 0.1]
    """
    from scipy.special import ndtr, stdtrit  # scipy.stats would take half a second to import

    out = stdtrit(count - 1, (1 + SURE) / 2) * np.sqrt(count / (count - 1))
    low = 100 * float(ndtr(-out))
    return low, 100 - low


def limits(values: Floats, by_block: Counts) -> tuple[Floats, Floats]:
    """The limits of the intervals of the values along the first axis, drawn from some blocks."""
    if len(by_block) < LEAST:
        return np.full(values.shape[1:], np.nan), np.full(values.shape[1:], np.nan)
    defined = np.isfinite(values).any(axis=0)
    shown = np.where(defined, values, 0.0)
    low, high = (
        np.where(defined, v, np.nan)
        for v in np.nanpercentile(shown, percentiles(len(by_block)), axis=0)
    )
    return low, high
