"""Gaps between the rows and columns of a scan, which are no gaps of the wall.

A scanner beside a front sees its far end in columns that lie far apart; one that turns about a
level axis does the same with rows. Such gaps are as wide at all heights, while openings are not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

SOME = 0.25  # quantile of the gaps along a column of squares: openings leave more than this of wall
WIDER = 1.5  # width of a gap of the scan over that quantile, at most
AROUND = 15  # columns whose widest gap counts, as the gaps of a scan change little from one to next

States = NDArray[np.int8]


def joined(states: States, empty: int, wall: int, widest: float) -> States:
    """States in which squares between columns or rows of a scan on a wall are wall, too.

    Parameters
    ----------
    states : array of shape (rows, columns)
    empty, wall : state of squares without points, and of those on the wall
    widest : of the gaps that are filled, in squares

    Examples
    --------
    Every third column holds points; an opening in the middle has none.

    >>> states = np.zeros((12, 22), np.int8)
    >>> states[:, ::3] = 1
    >>> states[3:8, 7:16] = 0
    >>> made = joined(states, 0, 1, 4)
    >>> bool((made[3:8, 7:15] == 0).all()), int((made[:3] == 0).sum())
    (True, 0)
    """
    across = _along(states, empty, wall, widest)
    return _along(across.T, empty, wall, widest).T


def _along(states: States, empty: int, wall: int, widest: float) -> States:
    """The same with the gaps of each row of squares."""
    rows, columns = np.arange(len(states))[:, None], np.arange(states.shape[1])
    seen = states != empty
    before = np.maximum.accumulate(np.where(seen, columns, -1), axis=1)
    after = np.flip(np.where(seen, columns, len(columns)), axis=1)
    after = np.flip(np.minimum.accumulate(after, axis=1), axis=1)
    closed = (before >= 0) & (after < len(columns))
    gap = np.where(seen, 0.0, np.where(closed, after - before - 1.0, np.inf))
    usual = np.quantile(gap, SOME, axis=0, method="lower")
    usual[usual * WIDER > widest] = 0.0
    usual = maximum_filter1d(usual, AROUND)
    left, right = (states[rows, np.clip(at, 0, len(columns) - 1)] == wall for at in (before, after))
    fill = ~seen & closed & (gap <= np.ceil(WIDER * usual)) & left & right
    return np.where(fill, wall, states).astype(np.int8)
