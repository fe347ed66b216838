"""Noise scattered below a surface: too many points to be single ones, too few to be a surface."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels.sorting import counted
from algorithms.shared.kernels.squares import add_slices, numbered, slice_ends

SQUARE = 4.0  # metres: so far from a point its like are looked for, beyond its own square
SLICE, BAND = 0.5, 3  # metres of height, finer leaves less noise; slices of a band: 1.5 m
SHARE = 0.2  # of the points of a square that a surface has; crowns and steep slopes have fewer
TIMES = 10  # points of a surface in a square, for each at the height of a point in all nine
FEWEST = 4  # points, so that a surface has 40 in a square; of fewer (2.5 per m2) nothing is said
DEEPEST = 100_000  # slices from the middle, 50 km, so that stray heights overflow no number

REACH = 2 * math.sqrt(2) * SQUARE  # metres, of points that decide on another one

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


def scattered_below(xyz: Floats, metre: float) -> Mask:
    """True for points that are too few at their height, beside those of a surface above them.

    A surface, be it the ground of a thick wood, a pit or a court, has points at its height in the
    squares around, too. Noise that is spread in height has few at any one height. So a point is
    noise below a surface: a band of 1.5 m above it that has SHARE of the points of its square of
    4 m, and TIMES the points about its own height in this and the eight squares around.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    metre : length of one metre in the unit of the points

    Returns
    -------
    array of shape (n,)

    Examples
    --------
    >>> xyz = np.array([[x / 4, y / 4, 100.0] for x in range(80) for y in range(80)])
    >>> xyz[::400, 2] -= np.arange(3, 19)
    >>> np.flatnonzero(scattered_below(xyz, 1.0)[:1201])
    array([   0,  400,  800, 1200])
    """
    if not len(xyz):
        return np.zeros(0, bool)
    own, row, span = _numbered(xyz, metre)
    keys, counts = counted(own)
    densest = _densest_above(keys, counts, span)
    below = np.flatnonzero(densest >= TIMES * FEWEST)
    few = TIMES * _around(keys, counts, keys[below], row, span) <= densest[below]
    found = keys[below[few]]
    here = np.zeros(int(keys[-1]) // span + 1, bool)
    here[found // span] = True
    noise = here[own // span]
    noise[noise] = np.isin(own[noise], found)
    return noise


def _numbered(xyz: Floats, metre: float) -> tuple[Ints, int, int]:
    """Number of the slice of each point, square by square, row by row.

    And how far the numbers of rows and those of squares are apart. An empty slice lies between two
    squares and an empty square between two rows, so that what is next to a number is beside it.
    """
    own, cols = numbered(xyz, SQUARE * metre, 1)
    lowest, highest = slice_ends(xyz, SLICE * metre)
    if highest - lowest > DEEPEST:  # else none is so far from the middle
        middle = np.median(np.floor(xyz[:, 2] / (SLICE * metre)))
        lowest, highest = max(lowest, middle - DEEPEST), min(highest, middle + DEEPEST)
    span = int(highest - lowest) + 3
    add_slices(own, xyz, SLICE * metre, lowest, highest, span)
    return own, int(cols) * span, span


def _densest_above(keys: Ints, counts: Ints, span: int) -> Ints:
    """Points of the fullest surface in the square of each key, two slices above it or higher.

    A surface is a band with SHARE of the points of the square; the crowns of a wood are none.
    """
    total, squares = np.r_[0, np.cumsum(counts)], keys // span
    ends = np.minimum(keys + BAND - 1, squares * span + span - 1)
    bands = total[np.searchsorted(keys, ends, "right")] - total[:-1]
    parts = np.add.reduceat(counts, first := np.flatnonzero(np.diff(squares, prepend=-1)))
    bands[bands < SHARE * np.repeat(parts, np.diff(first, append=len(keys)))] = 0
    # a running maximum from above, in which each square begins higher than the one before it
    offset = (squares[-1] - squares) * (bands.max() + 1)
    most = np.maximum.accumulate((offset + bands)[::-1])[::-1]
    above = np.minimum(np.searchsorted(keys, keys + 2), len(keys) - 1)
    there = (squares[above] == squares) & (keys[above] >= keys + 2)
    return np.where(there, most[above] - offset, 0)


def _around(keys: Ints, counts: Ints, chosen: Ints, row: int, square: int) -> Floats:
    """Points at the heights of the chosen keys, a slice more or less, in nine squares.

    Where squares are empty, as beyond the edge of the data, as many as in the mean of the others.
    """
    total = np.r_[0, np.cumsum(counts)]
    points, there = np.zeros(len(chosen), np.int64), np.zeros(len(chosen), np.int64)
    squares = chosen // square * square
    for away in (down + right for down in (-row, 0, row) for right in (-square, 0, square)):
        points += total[np.searchsorted(keys, chosen + away + 1, "right")]
        points -= total[np.searchsorted(keys, chosen + away - 1, "left")]
        first = np.searchsorted(keys, squares + away)
        there += np.r_[keys, -1][first] // square == (squares + away) // square
    return points * (9 / there)
