"""Strips of a front that a post, a trunk or a mast hides over its whole height.

What stands upright before an upright wall casts a shadow of one width on it, wherever the scanner
is. No opening is as high; but the shadow parts the openings that it crosses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects, label

from algorithms.planes._gaps import BRIDGE, SAME, Gap, gaps
from algorithms.planes._relief import BEHIND, EMPTY, WALL, Relief
from algorithms.planes._rows import joined

STRAY = 0.02  # share of the rows of the front in which a strip may hold points, as of the ground
BESIDE = 3  # squares beside a strip that tell what is there
SHARED = 0.5  # share of the rows with points on one of its sides that have some on the other, too
SHADOW = 0.5  # width of a strip that is told over that of the largest opening, at most: 2 m
POST = 0.25  # the same of a strip that parts one: 1 m
AS_WIDE = 0.2  # of a width, within which another opening is as wide: more than edges are off

Floats = NDArray[np.float64]
States = NDArray[np.int8]
Mask = NDArray[np.bool_]


class Strip(NamedTuple):
    """Columns and rows of squares without points: the first, and those after the last."""

    left: int
    right: int
    bottom: int
    top: int


def across_strips(
    front: Relief, limits: Mapping[str, float], recess: float
) -> tuple[list[tuple[Gap, Relief, bool]], Floats]:
    """Gaps of a front, and the left and right ends of strips in the shadow of posts.

    Beside a strip there may be one opening or two, with a pier in between that nobody sees. Other
    openings of the front tell by their widths: it is one if the whole is as wide as one of them and
    the parts are not, and two the other way round. Else the parts stay, in doubt.

    Returns
    -------
    list of gaps, each with the front in which it is seen and whether it is in doubt; array of shape
    (m, 2)
    """
    side = front.side
    states = joined(front.states, EMPTY, WALL, limits["min_width"] / side)
    seen = np.isin(states, (WALL, BEHIND))
    widest = SHADOW * limits["max_width"] / side
    found = strips(seen, limits["tallest"] / side, BRIDGE, widest)
    parted, whole = (
        front._replace(states=filled(states, found, WALL, BEHIND, POST * width / side))
        for width in (0.0, limits["max_width"])
    )
    shadows = side * np.array([(one.left, one.right) for one in found], float).reshape(-1, 2)
    parts = gaps(parted, **limits, recess=recess)
    if not found:
        return [(gap, parted, False) for gap in parts], shadows
    others = [
        _width(gap.shape)
        for gap in parts
        if not (gap.dropped or _ends_at(gap.shape, shadows, side).any())
    ]
    made = {id(gap): (gap, parted, False) for gap in parts}
    for gap in gaps(whole, **limits, recess=recess):
        if gap.dropped or not crossed(gap.shape, shadows).any():
            continue
        own = [part for part in parts if part.shape.intersection(gap.shape).area > 0]
        is_one, kept = _as_wide(gap, others), [part for part in own if not part.dropped]
        are_two = bool(kept) and all(_as_wide(part, others) for part in kept)
        if is_one and not are_two:
            for part in own:
                made.pop(id(part), None)
            made[id(gap)] = (gap, whole, False)
        elif is_one == are_two:
            made |= {id(part): (part, parted, True) for part in own if id(part) in made}
    return sorted(made.values(), key=lambda one: one[0].shape.bounds[0]), shadows


def _width(shape: Any) -> float:
    """How wide a shape is."""
    left, _, right, _ = shape.bounds
    return float(right - left)


def _as_wide(gap: Gap, widths: list[float]) -> bool:
    """Whether a gap is as wide as one of others."""
    width = _width(gap.shape)
    return any(abs(width - other) <= AS_WIDE * other for other in widths)


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


def crossed(shape: Any, shadows: Floats) -> Mask:
    """Which strips an opening crosses, from one side to the other; array of shape (n,)."""
    left, _, right, _ = shape.bounds
    return np.asarray((left < shadows[:, 0]) & (shadows[:, 1] < right))


def may_be_part(shape: Any, shadows: Floats, square: float) -> bool:
    """Whether an opening crosses a strip, or ends at one in which more of it may lie than is seen.

    What crosses a strip may be two, with a pier in it.

    Parameters
    ----------
    shadows : array of shape (n, 2), left and right end of each strip
    square : side of the squares of the front

    Examples
    --------
    >>> import shapely
    >>> window, strips = shapely.box(1, 1, 2, 2), [(1.2, 1.6), (2.0, 2.8), (-0.2, 0.95), (3, 5)]
    >>> [may_be_part(window, np.array([strip]), 0.07) for strip in strips]
    [True, False, True, False]
    """
    wider = shadows[:, 1] - shadows[:, 0] >= _width(shape)
    return bool((crossed(shape, shadows) | (_ends_at(shape, shadows, square) & wider)).any())


def _ends_at(shape: Any, shadows: Floats, square: float) -> Mask:
    """At which strips an opening ends, for the parameters of `may_be_part`."""
    left, _, right, _ = shape.bounds
    near, (first, last) = SAME * square, shadows.T
    ends = [(first - near <= side) & (side <= last + near) for side in (left, right)]
    return np.asarray(ends[0] | ends[1])
