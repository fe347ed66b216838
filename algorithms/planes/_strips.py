"""Strips of a front that a post, a trunk or a mast hides over its whole height.

What stands upright before an upright wall casts a shadow of one width on it, wherever the scanner
is. No opening is as high; but the shadow parts the openings that it crosses.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects, label

STRAY = 0.02  # share of the rows of the front in which a strip may hold points, as of the ground
BESIDE = 3  # squares beside a strip that tell what is there
SHARED = 0.5  # share of the rows with points on one of its sides that have some on the other, too

States = NDArray[np.int8]
Mask = NDArray[np.bool_]


class Strip(NamedTuple):
    """Columns and rows of squares without points: the first, and those after the last."""

    left: int
    right: int
    bottom: int
    top: int


def strips(seen: Mask, highest: float, narrowest: float, widest: float) -> list[Strip]:
    """Strips from the foot of a front in which nothing is seen, higher than any opening.

    Where the front is lower than an opening may be, they reach to its top.

    Parameters
    ----------
    seen : array of shape (rows, columns), from below: squares with wall or what is behind it
    highest : height of an opening, in squares
    narrowest, widest : a strip is wider, and no wider, in squares

    Examples
    --------
    A wall with a door and a strip.

    >>> seen = np.ones((20, 30), bool)
    >>> seen[:12, 5:10] = False
    >>> seen[:, 20:23] = False
    >>> strips(seen, 15, 2, 8)
    [Strip(left=20, right=23, bottom=0, top=20)]
    """
    stray = seen.cumsum(axis=0) > max(1.0, STRAY * len(seen))
    clear = np.where(stray[-1], stray.argmax(axis=0), len(seen))
    found = []
    for (place,) in find_objects(label(clear >= min(highest, len(seen)))[0]):
        left, right = place.start, place.stop
        sides = seen[:, max(left - BESIDE, 0) : left], seen[:, right : right + BESIDE]
        on_left, on_right = (side.any(axis=1) for side in sides)
        both = np.flatnonzero(on_left & on_right)
        if not narrowest < right - left <= widest or len(both) <= SHARED * max(
            on_left.sum(), on_right.sum()
        ):
            continue
        top = min(int(both[-1]) + 1, int(clear[left:right].min()))
        found.append(Strip(left, right, int(both[0]), top))
    return found


def filled(states: States, found: Sequence[Strip], wall: int, behind: int, widest: float) -> States:
    """States in which a strip is what it lies between: an opening it crosses, or else wall.

    Parameters
    ----------
    wall, behind : the states of squares that tell
    widest : of a strip that parts an opening, in squares: in a wider one there may be wall as well

    Examples
    --------
    A window of which the middle is hidden; 1 is wall, 2 is behind it.

    >>> states = np.array([[1, 1, 0, 0, 1, 1], [1, 2, 0, 0, 2, 1], [1, 2, 0, 0, 1, 1]], np.int8)
    >>> filled(states, [Strip(2, 4, 0, 3)], 1, 2, 2).tolist()
    [[1, 1, 1, 1, 1, 1], [1, 2, 2, 2, 2, 1], [1, 2, 1, 1, 1, 1]]
    """
    made = states.copy()
    for left, right, bottom, top in found:
        before = states[bottom:top, max(left - BESIDE, 0) : left]
        after = states[bottom:top, right : right + BESIDE]
        sides = [_nearest(side, (wall, behind)) for side in (before[:, ::-1], after)]
        through = (sides[0] == behind) & (sides[1] == behind) & (right - left <= widest)
        known = (sides[0] > 0) & (sides[1] > 0)
        value = np.where(through, behind, wall)[:, None]
        part = made[bottom:top, left:right]
        bare = known[:, None] & ~np.isin(part, (wall, behind))
        made[bottom:top, left:right] = np.where(bare, value, part)
    return made


def _nearest(states: States, some: tuple[int, int]) -> States:
    """The first state of each row that is one of some; 0 where none is."""
    told = np.isin(states, some)
    first = states[np.arange(len(states)), told.argmax(axis=1)]
    return np.where(told.any(axis=1), first, 0).astype(np.int8)
