"""Fréchet distance of two lines.

It is the length of the shortest leash for a man and a dog who walk along one line each, without
ever going back.

References
----------
Alt, H. and Godau, M. (1995). Computing the Fréchet distance between two polygonal curves.
International Journal of Computational Geometry and Applications 5, 75-91: the free space diagram.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels.compiling import kernel
from toolbox.context import QUIET, Context

BLOCK = 2_000_000  # cells of the diagram between two checks for cancellation
GROWTH = 1.1  # from one leash that is too short to the next one

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def frechet(
    one: Array, other: Array, least: float, within: float, step: float, ctx: Context = QUIET
) -> tuple[float, bool]:
    """Fréchet distance of two lines, the second one taken in the better of its directions.

    Of closed lines it is that from the best starting position, looked for every `step` along the
    second one: the answer may be too large by half a step, and says the least where it is exact.

    Parameters
    ----------
    one, other : arrays of shape (n, 2) and (m, 2)
    least : a lower bound, such as the Hausdorff distance
    within : how far the answer may be wrong, beyond that of closed lines
    step : between positions at which a closed line may begin

    Returns
    -------
    float
        Distance.
    bool
        Whether the second line is walked backwards.
    """
    is_closed = bool((one[0] == one[-1]).all() and (other[0] == other[-1]).all())
    origin = one.mean(axis=0)  # squares of small numbers keep their digits
    one, other = one - origin, other - origin
    ways = [other, other[::-1].copy()]
    starts = [places_along(way, step) if is_closed else None for way in ways]

    def walks(leash: float) -> int | None:
        """Index of the direction in which the leash is long enough; None if there is none."""
        for number, (way, start) in enumerate(zip(ways, starts, strict=True)):
            for begun in [way] if start is None else begun_at(way, *start, leash, one[0]):
                if can_walk(one, begun, leash, ctx):
                    return number
        return None

    low = bound = least if is_closed else max(least, min(_apart(one, way) for way in ways))
    high = bound + within
    while (found := walks(high)) is None:
        low, high = high, high * GROWTH
    if low == bound:
        return bound, found == 1
    while high - low > within:
        middle = (low + high) / 2
        if (shorter := walks(middle)) is None:
            low = middle
        else:
            high, found = middle, shorter
    return high, found == 1


def _apart(one: Array, other: Array) -> float:
    """The larger of the distances between the two starts and between the two ends."""
    return max(math.dist(one[0], other[0]), math.dist(one[-1], other[-1]))


def places_along(ring: Array, step: float) -> tuple[Indices, Array]:
    """Positions of shape (n, 2) along a closed line, at most a step apart, and their segments."""
    way = np.diff(ring, axis=0)
    count = np.ceil(np.hypot(way[:, 0], way[:, 1]) / step).astype(np.int64)
    segment = np.repeat(np.arange(len(way)), count)
    number = np.arange(len(segment)) - (np.cumsum(count) - count)[segment]
    return segment, ring[segment] + (number / count[segment])[:, None] * way[segment]


def begun_at(
    ring: Array, segment: Indices, places: Array, leash: float, end: Array
) -> Iterator[Array]:
    """The closed line, begun at each position within the leash of `end`, the nearest one first.

    Parameters
    ----------
    segment, places : see :func:`places_along`
    end : of the leash, array of shape (2,)
    """
    away = np.hypot(*(places - end).T)
    near = np.flatnonzero(away <= leash)
    for number in near[np.argsort(away[near], kind="stable")]:
        place, first = places[number : number + 1], segment[number]
        before = ring[: first + 1]
        if (ring[first] == place[0]).all():
            before = ring[:first]
        yield np.concatenate([place, ring[first + 1 : -1], before, place])


def can_walk(one: Array, other: Array, leash: float, ctx: Context = QUIET) -> bool:
    """Whether a leash is long enough for two lines that are walked from start to end.

    Time and memory go with the part of the free space diagram that can be reached, row by row: for
    lines close to each other with their lengths, at worst with the product of their nodes.

    Parameters
    ----------
    one, other : arrays of shape (n, 2) and (m, 2)
    """
    if _apart(one, other) > leash:
        return False
    rows = max(1, BLOCK // len(other))
    now, then = (np.full((len(other) - 1, 2), np.nan) for _ in range(2))
    # From the begin the first line waits while the second one is walked, as far as that goes.
    reach = first_row(one[0], other, leash, now)
    bottom = np.zeros(1)  # how the second line may wait while the first one is walked
    for start in range(0, len(one) - 1, rows):
        ctx.progress(0.5)
        end = min(start + rows, len(one) - 1)
        reach = walk_rows(one, other, leash, start, end, now, then, reach, bottom)
        if reach[0] > reach[1]:
            return False
    return bool(reach[1] == len(other) - 2 and now[-1, 1] >= 1)


@kernel
def free(x, y, ax, ay, bx, by, leash):
    """Range of shares of a segment within the leash of a position; NaN if there is none."""
    wx, wy, ux, uy = bx - ax, by - ay, x - ax, y - ay
    length = wx * wx + wy * wy
    along = (ux * wx + uy * wy) / length
    across = (ux * wy - uy * wx) ** 2 / length
    room = leash * leash - across
    if room < 0:
        return np.nan, np.nan
    half = math.sqrt(room / length)
    low, high = along - half, along + half
    # Ends are looked at by themselves, so that rounding does not close what is open.
    if ux * ux + uy * uy <= leash * leash:
        low = 0.0
    if (x - bx) ** 2 + (y - by) ** 2 <= leash * leash:
        high = 1.0
    if high < 0 or low > 1:
        return np.nan, np.nan
    return max(low, 0.0), min(high, 1.0)


@kernel
def first_row(place, other, leash, now):
    """Fill in what is reached while the first line waits at its start; first and last segment."""
    last = -1
    for j in range(len(other) - 1):
        low, high = free(
            place[0], place[1], other[j, 0], other[j, 1], other[j + 1, 0], other[j + 1, 1], leash
        )
        if not low <= 0:
            break
        now[j, 0], now[j, 1] = low, high
        last = j
        if high < 1:
            break
    return 0, last


@kernel
def walk_rows(  # noqa: PLR0912
    one, other, leash, start, end, now, then, reach, bottom
):
    """Advance over the segments start..end of the first line; first and last segment reached.

    Parameters
    ----------
    now : array of shape (m - 1, 2), what can be reached of each segment of the second line when
        the first one is at its node `start`; holds that of node `end` afterwards
    then : array of the same shape, for the node after
    reach : first and last segment of `now` that can be reached
    bottom : array of shape (1,), 0 as long as the second line may wait at its begin, else 1
    """
    low_j, high_j = reach
    m = len(other) - 1
    for i in range(start, end):
        px, py, qx, qy = one[i, 0], one[i, 1], one[i + 1, 0], one[i + 1, 1]
        below, above = np.nan, np.nan  # reached on the edge to the segment before
        if bottom[0] == 0:
            below, above = free(other[0, 0], other[0, 1], px, py, qx, qy, leash)
            if not below <= 0:
                below, above = np.nan, np.nan
            if not above >= 1:
                bottom[0] = 1
        new_low, new_high = m, -1
        j = 0 if not np.isnan(below) else low_j
        while j < m and (j <= high_j or not np.isnan(below)):
            left = low_j <= j <= high_j and not np.isnan(now[j, 0])
            under = not np.isnan(below)
            if left or under:
                low, high = free(
                    qx, qy, other[j, 0], other[j, 1], other[j + 1, 0], other[j + 1, 1], leash
                )
                if not under:
                    low = max(low, now[j, 0])
                if low <= high:
                    then[j, 0], then[j, 1] = low, high
                    new_low, new_high = min(new_low, j), j
                else:
                    then[j, 0] = np.nan
                low, high = free(other[j + 1, 0], other[j + 1, 1], px, py, qx, qy, leash)
                if not left:
                    low = max(low, below)
                if low <= high:
                    below, above = low, high
                else:
                    below, above = np.nan, np.nan
            else:
                then[j, 0] = np.nan
            j += 1
        low_j, high_j = new_low, new_high
        if high_j < 0:
            break
        now[low_j : high_j + 1] = then[low_j : high_j + 1]
    return low_j, high_j
