"""A surface made as smooth as it can be within a tolerance, so that its contours are calm.

Contours of a surface never cross, whatever was done to the surface; lines that are smoothed one by
one may. So it is the surface that is smoothed: heights spread to their neighbours, round by round,
and are put back to the limit of the tolerance wherever they have left it. That is the projected
descent for the smoothest surface between two others.

Water that was laid level stays as it is. Lines at its own height would else wander across it, as
its heights moved by next to nothing.

References
----------
Bertsekas, D. P. (1976). On the Goldstein-Levitin-Polyak gradient projection method. IEEE
Transactions on Automatic Control 21(2), 174-184.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox.context import QUIET, Context

Array = NDArray[np.float64]
CALM = 0.02  # of the tolerance: smaller changes in a round do not move lines that are drawn
MOST_ROUNDS = 300  # a bump as wide as some twenty cells is gone by then


def smoothed(heights: Array, tolerance: float, *, ctx: Context = QUIET) -> Array:
    """Smooth a surface so that no height changes by more than a tolerance, and level places stay.

    Parameters
    ----------
    heights : array of shape (rows, cols), NaN where not known, which stays so
    tolerance : in the unit of the heights

    Examples
    --------
    >>> rough = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 0.0]])
    >>> float(smoothed(rough, 0.25)[1, 1])
    0.75
    """
    known = np.isfinite(heights)
    made = np.where(known, heights, 0.0)
    free = tolerance * ~level(heights)
    low, high = made - free, made + free
    for number in range(MOST_ROUNDS):
        ctx.progress(number / MOST_ROUNDS)
        new = np.clip(_spread(made, known), low, high)
        change = float(np.max(np.abs(new - made), initial=0.0, where=known))
        made = new
        if change <= CALM * tolerance:
            break
    ctx.progress(1.0)
    return np.where(known, made, np.nan)


def level(heights: Array) -> NDArray[np.bool_]:
    """The cells of places that are level to the last digit, such as water that was laid level.

    A place is level where a cell and its eight neighbours have one height; measured ground, with
    its noise, has none of that.

    Examples
    --------
    >>> pond = np.array([[1, 5, 5, 5, 2], [3, 5, 5, 5, 4], [6, 5, 5, 5, 7.0]])
    >>> level(pond).astype(int).tolist()
    [[0, 1, 1, 1, 0], [0, 1, 1, 1, 0], [0, 1, 1, 1, 0]]
    """
    from scipy.ndimage import binary_dilation, maximum_filter, minimum_filter

    known = np.isfinite(heights)
    filled = np.where(known, heights, np.inf)
    same = (maximum_filter(filled, 3) == minimum_filter(filled, 3)) & known
    same[[0, -1]] = same[:, [0, -1]] = False
    return np.asarray(binary_dilation(same, np.ones((3, 3), bool)))


def _spread(values: Array, known: NDArray[np.bool_]) -> Array:
    """The mean of each cell, twice, and its neighbours, along columns and then along rows."""
    for axis in (0, 1):
        total = 2.0 * values * known
        weight = 2.0 * known
        for shift in (1, -1):
            near, there = _shifted(values, shift, axis), _shifted(known, shift, axis)
            total = total + near * there
            weight = weight + there
        values = np.divide(total, weight, out=values.copy(), where=known)
    return values


def _shifted(values: NDArray[Any], by: int, axis: int) -> NDArray[Any]:
    """An array moved by one along an axis, with zeros at the free edge."""
    made = np.zeros_like(values)
    here, there = [slice(None)] * 2, [slice(None)] * 2
    first, last = slice(1, None), slice(None, -1)
    here[axis], there[axis] = (first, last) if by > 0 else (last, first)
    made[tuple(here)] = values[tuple(there)]
    return made
