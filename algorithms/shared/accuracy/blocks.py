"""Intervals of measures by drawing blocks of ground with replacement.

Errors of neighbouring points come together, in whole roofs and hedges, so a million points say less
than their number. Blocks that are larger than such clumps are nearly independent of each other:
as many of them as there are, drawn again and again, show how far a measure would differ had other
ground been surveyed.

No block is larger than all clumps. What clumps that run on from block to block add to the variance
is in proportion to the edges of the blocks, so that it halves where their sides double: from the
variance V of blocks and that of squares of four of them, the one without edges is
2 V(four) - V(one).

References
----------
Künsch, H. R. (1989). The jackknife and the bootstrap for general stationary observations. Annals of
Statistics 17(3), 1217-1241: blocks in place of single observations.
Politis, D. N. and Romano, J. P. (1995). Bias-corrected nonparametric spectral estimation. Journal
of Time Series Analysis 16(1), 67-103: section 2, twice the longer window less the shorter one.
Efron, B. and Tibshirani, R. J. (1993). An introduction to the bootstrap: section 13.3, percentiles.
Hesterberg, T. C. (2015). What teachers should know about the bootstrap. The American Statistician
69(4), 371-386: section 4.1.1, percentiles of few observations must lie farther out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from toolbox.errors import DataError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Counts = NDArray[np.int64] | NDArray[np.float64]
Measure = Callable[[Floats], Mapping[str, Floats]]

WANTED = 100  # blocks, if nothing is said of their size: some 25 squares of four
MOST = 10_000  # blocks
LEAST = 8  # blocks below which less than 0.9 of the intervals hold the truth even where errors are
# spread evenly, as rates of an exponential distribution (`tests.bench accuracy`)
DRAWS = 2000  # of which two lie beyond the limits that are farthest out
CHUNK = 1 << 22  # numbers of matrices held at a time
SURE = 0.95  # share of intervals that should hold the truth
FEW_CLUMPS = 10  # of errors, below which intervals hold the truth less often


@dataclass(frozen=True)
class Blocks:
    """Square blocks of ground that hold positions.

    Attributes
    ----------
    number : block of each position, array of shape (n,), without gaps
    square : number of the square of four blocks in which each block lies, array of shape (b,)
    side : of the blocks, in the unit of the positions
    """

    number: Ints
    square: Ints
    side: float

    def __len__(self) -> int:
        return len(self.square)


@dataclass(frozen=True)
class Tallies:
    """Confusion matrices of blocks.

    Attributes
    ----------
    counts : array of shape (b, ..., k, k)
    square : as in :class:`Blocks`
    """

    counts: Counts
    square: Ints

    def joined(self) -> Counts:
        """The matrices of the squares of four blocks."""
        held, own = np.unique(self.square, return_inverse=True)
        found = np.zeros((len(held), *self.counts.shape[1:]), self.counts.dtype)
        np.add.at(found, own, self.counts)
        return found


def blocks(xy: Floats, side: float | None) -> Blocks:
    """Square blocks around positions.

    Parameters
    ----------
    xy : array of shape (n, 2), n > 0
    side : in the unit of xy; None for one at which some WANTED blocks hold points

    Returns
    -------
    Blocks
        They are numbered from the lowest coordinates on, so that the order of the points does not
        matter.

    Raises
    ------
    DataError
        There would be more than MOST blocks.

    Examples
    --------
    >>> found = blocks(np.array([[0, 0], [3, 0], [7, 0], [21, 8.0]]), 5.0)
    >>> found.number.tolist(), found.square.tolist()
    ([0, 0, 1, 2], [0, 0, 1])
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
    square = np.zeros(len(keys), np.int64)
    square[number] = _occupied(xy, low, 2 * side)[1]
    return Blocks(number, square, side)


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


def intervals(tallies: Tallies, measure: Measure, seed: int) -> dict[str, tuple[Floats, Floats]]:
    """Limits of the 95 % interval of each measure; NaN where the blocks tell none.

    That is so with fewer than LEAST blocks, and where all draws have the same value: blocks of
    which none has an error do not say how rare errors are.

    Parameters and results are those of :func:`spread`.
    """
    found = spread(tallies, measure, seed)
    return {
        name: (np.where(low < high, low, np.nan), np.where(low < high, high, np.nan))
        for name, (low, high) in found.items()
    }


def spread(tallies: Tallies, measure: Measure, seed: int) -> dict[str, tuple[Floats, Floats]]:
    """Limits of the 95 % interval of each measure; both the same where all draws are alike.

    Squares of four blocks are drawn, or the blocks themselves where there are fewer than LEAST
    squares.

    Parameters
    ----------
    tallies : of b blocks
    measure : computes measures of a stack of matrices, by name; each of shape (m, ...)
    seed : of the draws

    Returns
    -------
    dict of pairs of arrays of shape (...)
        Draws in which a measure is not defined are left out. NaN with fewer than LEAST blocks.
    """
    counts, joined = tallies.counts, tallies.joined()
    of_blocks = _values(counts, measure, seed)
    if len(counts) < LEAST:
        return {name: (np.full(v.shape[1:], np.nan),) * 2 for name, v in of_blocks.items()}
    if len(joined) < LEAST:
        out = percentile(len(counts), len(counts) - 1)
        return {name: _limits(v, np.full(v.shape[1:], out)) for name, v in of_blocks.items()}
    found, free = {}, freedom(len(counts), len(joined))
    for name, values in _values(joined, measure, seed).items():
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = _variance(of_blocks[name], len(counts)) / _variance(values, len(joined))
        found[name] = _limits(values, percentile(len(joined), free, _wider(ratio)))
    return found


def _values(counts: Counts, measure: Measure, seed: int) -> dict[str, Floats]:
    """Measures of the draws of some matrices."""
    found = [measure(stack) for stack in drawn(counts, seed)]
    return {name: np.concatenate([f[name] for f in found]) for name in found[0]}


def _variance(values: Floats, count: int) -> Floats:
    """Variance along the first axis of draws of some blocks; draws differ by too little."""
    defined = np.isfinite(values)
    shown = np.where(defined, values, 0.0)
    times = np.maximum(defined.sum(axis=0), 1)
    mean = shown.sum(axis=0) / times
    squares = np.where(defined, (values - mean) ** 2, 0.0)
    return np.asarray(squares.sum(axis=0) / times * count / (count - 1))


def _wider(ratio: Floats) -> Floats:
    """Standard deviation without edges of blocks, of that of squares of four; 1 if not known.

    Parameters
    ----------
    ratio : variance of blocks, of that of squares of four
    """
    return np.asarray(np.sqrt(2 - np.where(np.isfinite(ratio), np.minimum(ratio, 1.0), 1.0)))


def freedom(blocks: int, squares: int) -> float:
    """Degrees of freedom of 2 V(four) - V(one), as of a variance of so many independent values.

    Relative variances of both are 2 / (n - 1), and their covariance is that of V(one), as squares
    are sums of blocks.

    Examples
    --------
    >>> round(freedom(100, 25), 1)
    7.3
    """
    return 1 / (4 / (squares - 1) - 3 / (blocks - 1))


def percentile(count: int, free: float, wider: Any = 1.0) -> Any:
    """The percentile of the draws of some blocks that is the lower limit of an interval of 95 %.

    Draws of n blocks differ by too little, by the root of (n - 1) / n, and their spread is itself
    estimated from n blocks: percentiles are taken as far out as Student's distribution has them.

    Parameters
    ----------
    count : of the blocks that are drawn
    free : degrees of freedom of the variance
    wider : standard deviation of the measure, of that of the draws; number or array

    Examples
    --------
    >>> [round(float(percentile(n, n - 1)), 1) for n in (1000, 100, 20, 5)]
    [2.5, 2.3, 1.6, 0.1]
    """
    from scipy.special import ndtr, stdtrit  # scipy.stats would take half a second to import

    out = stdtrit(free, (1 + SURE) / 2) * np.sqrt(count / (count - 1))
    return 100 * ndtr(-out * wider)


def _limits(values: Floats, low: Floats) -> tuple[Floats, Floats]:
    """Limits along the first axis at percentiles of the shape of the others."""
    flat, out = values.reshape(len(values), -1), np.ravel(low)
    pairs = np.full((flat.shape[1], 2), np.nan)
    for k, (column, percent) in enumerate(zip(flat.T, out, strict=True)):
        known = column[np.isfinite(column)]
        if len(known):
            pairs[k] = np.percentile(known, (percent, 100 - percent))
    first, last = pairs.T.reshape(2, *values.shape[1:])
    return first, last


class Clumping(NamedTuple):
    """How errors come together.

    Attributes
    ----------
    growth : variance of the share of errors by squares of four blocks, of that by blocks; 1 where
        blocks do not resemble their neighbours
    wide : whether that is more than chance makes of it (two standard deviations)
    clumps : as many errors that are independent vary by as much; NaN without an error
    """

    growth: float
    wide: bool
    clumps: float

    @classmethod
    def of(cls, tallies: Tallies) -> Clumping | None:
        """From matrices of shape (b, k, k); None with fewer than LEAST squares of four blocks."""
        joined = tallies.joined()
        if len(joined) < LEAST:
            return None
        share, one = _share_wrong(tallies.counts)
        _, four = _share_wrong(joined)
        if one == 0:
            return cls(1.0, False, np.nan)
        n, m = len(tallies.counts), len(joined)
        variance = max(2 * four - one, four, one)
        by_chance = 1 + 2 * np.sqrt(2 / (m - 1) - 2 / (n - 1))
        clumps = share**2 * (1 - share) / variance
        return cls(four / one, bool(four > one * by_chance), float(clumps))

    @property
    def few(self) -> bool:
        """Whether there are too few errors for an interval that holds in 95 of 100 cases."""
        return self.clumps < FEW_CLUMPS


def _share_wrong(counts: Counts) -> tuple[float, float]:
    """Share of errors, and its variance between matrices of shape (b, k, k)."""
    total = counts.sum(axis=(1, 2)).astype(float)
    wrong = total - np.trace(counts, axis1=1, axis2=2)
    share = wrong.sum() / total.sum()
    off = ((wrong - share * total) ** 2).sum() / total.sum() ** 2
    return float(share), float(off * len(counts) / (len(counts) - 1))
