"""Points as surfaces take them: each place once, in the order of x, then y."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from toolbox.context import QUIET, Context, log

Array = NDArray[np.float64]


def averaged(xy: Array, values: Array, *, ctx: Context = QUIET) -> tuple[Array, Array]:
    """Each place of shape (n, 2) once, sorted, with the mean of its values of shape (n,)."""
    order = np.argsort(xy[:, 0])
    ctx.progress(0.3)
    xy, values = xy[order], values[order]
    ctx.progress(0.6)
    count = _settle(xy, values)
    if count < len(xy):
        log.info("%d points share their place with another; averaged", len(xy) - count)
    ctx.progress(1.0)
    return xy[:count], values[:count]


@njit(cache=True, nogil=True)
def _settle(xy, values):  # type: ignore[no-untyped-def]
    """Sort runs of equal x by y and value, and average places, all in place; how many there are."""
    count, start = 0, 0
    while start < len(xy):
        end = start + 1
        while end < len(xy) and xy[end, 0] == xy[start, 0]:
            end += 1
        if end > start + 1:
            _sort(xy[start:end, 1], values[start:end])
        while start < end:
            x, y, low = xy[start, 0], xy[start, 1], values[start]
            above, size = 0.0, 0
            while start < end and xy[start, 1] == y:
                above += values[start] - low  # from the lowest, to keep the digits
                size += 1
                start += 1
            xy[count, 0], xy[count, 1], values[count] = x, y, low + above / size
            count += 1
    return count


@njit(cache=True, nogil=True)
def _sort(y, values):  # type: ignore[no-untyped-def]
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
