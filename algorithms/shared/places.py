"""Points at one position: found, left out, or averaged for gridding."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from algorithms.shared.chance import random_keys
from algorithms.shared.kernels.compiling import kernel
from algorithms.shared.kernels.threads import in_blocks
from toolbox.context import QUIET, Context, log

RUN = 200_000  # points that one thread takes at a time
WIDER = 1.001  # times a reach, so that rounding puts no neighbour two cells away
MOST = 4096  # cells along an axis; wider ones are taken beyond that
MARKS = 16  # for each point at least: so many that few points share one by chance

Array = NDArray[np.float64]


def once_each(xyz: Array) -> Array:
    """The distinct positions of points of shape (n, 3), in the order in which they come first.

    Examples
    --------
    >>> once_each(np.array([[7, 0, 0], [5, 0, 0], [7, 0, 0], [7, 0, 1.0]]))[:, 0]
    array([7., 5., 7.])
    """
    keys = random_keys(xyz, 0)
    # Sorting all points takes far longer than sorting those that may share their place.
    some = np.flatnonzero(_may_share(keys, np.zeros(_bytes_for(len(keys)), np.uint8)))
    some = some[np.argsort(keys[some], kind="stable")]
    again = np.zeros(len(some), bool)
    again[1:] = (xyz[some[1:]] == xyz[some[:-1]]).all(axis=1)
    if not again.any():
        return xyz
    kept = np.ones(len(xyz), bool)
    kept[some[again]] = False
    return xyz.compress(kept, axis=0)


def _bytes_for(points: int) -> int:
    """Bytes that hold MARKS marks of two bits for each point; a power of two."""
    return 1 << (max(1, points) * MARKS // 4 - 1).bit_length()


@kernel
def _may_share(keys, marks):
    """True for points whose mark is that of another point, as it is for all of equal keys.

    A byte holds four marks: a bit for one that some point has, and a bit for two or more.
    """
    last = np.uint64(len(marks) - 1)
    for key in keys:
        byte, bit = key & last, np.uint8(1) << np.uint8(key >> np.uint64(62))
        marks[byte] |= (marks[byte] & bit) << np.uint8(4) | bit
    found = np.empty(len(keys), np.bool_)
    for i in range(len(keys)):
        bit = np.uint8(16) << np.uint8(keys[i] >> np.uint64(62))
        found[i] = marks[keys[i] & last] & bit != 0
    return found


def may_be_near(xy: Array, places: Array, reach: float) -> NDArray[np.bool_]:
    """True for points near enough to some place that a search has to look at them.

    All points within reach of a place are among them, and few that are more than thrice as far.

    Parameters
    ----------
    xy, places : arrays of shape (n, 2) and (m, 2)
    reach : in their unit

    Examples
    --------
    >>> may_be_near(np.array([[0, 0.9], [0, 9.0]]), np.zeros((1, 2)), 1.0)
    array([ True, False])
    """
    if not len(places):
        return np.zeros(len(xy), bool)
    low, extent = places.min(axis=0), float(np.ptp(places, axis=0).max())
    cell = max(reach * WIDER, extent / MOST)
    held = np.floor((places - low) / cell).astype(np.int64) + 1
    marked = np.zeros(held.max(axis=0) + 2, bool)
    marked[tuple(held.T)] = True
    return np.asarray(_in_marked(xy, low, cell, binary_dilation(marked, np.ones((3, 3), bool))))


@kernel
def _in_marked(xy, low, cell, marked):
    """Which points lie in marked cells; `low` is the corner of cell 1, 1."""
    found = np.zeros(len(xy), np.bool_)
    for i in range(len(xy)):
        a = np.floor((xy[i, 0] - low[0]) / cell) + 1.0
        b = np.floor((xy[i, 1] - low[1]) / cell) + 1.0
        if 0.0 <= a < marked.shape[0] and 0.0 <= b < marked.shape[1]:
            found[i] = marked[int(a), int(b)]
    return found


def averaged(xy: Array, values: Array, *, ctx: Context = QUIET) -> tuple[Array, Array]:
    """Distinct positions of points of shape (n, 2), sorted, with the mean values, shape (k,).

    Examples
    --------
    >>> xy, means = averaged(np.array([[1, 0], [0, 0], [1, 0.0]]), np.array([2, 5, 4.0]))
    >>> xy.tolist(), means.tolist()
    ([[0.0, 0.0], [1.0, 0.0]], [5.0, 3.0])
    """
    order = np.argsort(xy[:, 0])
    ctx.progress(0.3)
    places, means = np.empty((len(xy), 2)), np.empty(len(xy))
    parts: list[tuple[int, int]] = []

    def work(first: int, last: int) -> None:
        parts.append(_settle(xy, values, order, first, last, places, means))

    in_blocks(work, len(xy), RUN, ctx.part(0.3, 0.9))
    total = 0
    for begin, count in sorted(parts):
        if begin > total:  # close the gap that points at one position have left
            places[total : total + count] = places[begin : begin + count]
            means[total : total + count] = means[begin : begin + count]
        total += count
    if total < len(xy):
        log.info("%d points share their place with another; averaged", len(xy) - total)
    ctx.progress(1.0)
    return places[:total], means[:total]


@kernel
def _settle(xy, values, order, first, last, places, means):
    """Average points of equal position in first..last of the order by x, and sort by x, y.

    Returns
    -------
    begin : where the first of them is written
    count : how many there are
    """
    while 0 < first < last and xy[order[first], 0] == xy[order[first - 1], 0]:
        first += 1
    count = start = first
    while start < last:
        x, end = xy[order[start], 0], start
        while end < len(order) and xy[order[end], 0] == x:
            places[end, 1], means[end] = xy[order[end], 1], values[order[end]]
            end += 1
        if end > start + 1:
            _sort(places[start:end, 1], means[start:end])
        while start < end:
            y, low = places[start, 1], means[start]
            above, size = 0.0, 0
            while start < end and places[start, 1] == y:
                above += means[start] - low  # from the lowest, to keep the digits
                size += 1
                start += 1
            places[count, 0], places[count, 1], means[count] = x, y, low + above / size
            count += 1
    return first, count - first


@kernel
def _sort(y, values):
    """Sort pairs by y, then value, in place (Shell 1959)."""
    gap = 1
    while gap < len(y) // 9:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, len(y)):
            key, value, j = y[i], values[i], i
            while j >= gap and (
                y[j - gap] > key or (y[j - gap] == key and values[j - gap] > value)
            ):
                y[j], values[j] = y[j - gap], values[j - gap]
                j -= gap
            y[j], values[j] = key, value
        gap //= 3
