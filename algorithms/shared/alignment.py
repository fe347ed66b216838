"""Two rasters on a common lattice: whether their cells coincide, and their difference."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from toolbox.context import QUIET, Context
from toolbox.data import Lattice, Raster

ROWS = 512  # subtracted between two checks for cancellation
ALIGNED = 1e-4  # cells: corners that are this close to whole cells apart lie on one lattice

Array = NDArray[np.float64]


def misfit(one: Lattice, other: Lattice) -> str | None:
    """The problem if cells of two lattices do not coincide, or None; continues a sentence.

    Examples
    --------
    >>> misfit(Lattice(0, 9, 1.0, 9, 9), Lattice(2, 7, 1.0, 3, 3)) is None
    True
    """
    if apart(one, other):
        return "lies nowhere on the area"
    if abs(other.cell - one.cell) * max(one.shape) > ALIGNED * one.cell:
        return f"has cells of {other.cell:g}, not the {one.cell:g}"
    for steps in ((other.west - one.west) / one.cell, (other.north - one.north) / one.cell):
        if abs(steps - round(steps)) > ALIGNED:
            return f"lies {abs(steps - round(steps)):.3g} of a cell beside the cells"
    return None


def not_on(one: Lattice, other: Lattice) -> str | None:
    """The problem if another lattice does not have the very cells of one, or None; as `misfit`.

    Examples
    --------
    >>> not_on(Lattice(0, 9, 1.0, 9, 9), Lattice(2, 9, 1.0, 9, 9))
    'covers another area than that'
    """
    if text := misfit(one, other):
        return text
    same = one.shape == other.shape and offset(one, other) == (0, 0)
    return None if same else "covers another area than that"


def apart(one: Lattice, other: Lattice) -> bool:
    """Whether two lattices have no area in common.

    Examples
    --------
    >>> apart(Lattice(0, 9, 1.0, 9, 9), Lattice(9, 9, 2.0, 3, 3))
    True
    """
    west, south, east, north = one.bounds
    xmin, ymin, xmax, ymax = other.bounds
    near = ALIGNED * min(one.cell, other.cell)
    wide = min(east, xmax) - max(west, xmin), min(north, ymax) - max(south, ymin)
    return min(wide) <= near


def offset(one: Lattice, other: Lattice) -> tuple[int, int]:
    """Row and column of the first lattice at which the other one begins.

    Examples
    --------
    >>> offset(Lattice(0, 9, 1.0, 9, 9), Lattice(2, 8, 1.0, 3, 3))
    (1, 2)
    """
    down = round((one.north - other.north) / one.cell)
    return down, round((other.west - one.west) / one.cell)


def difference(one: Raster, other: Raster, ctx: Context = QUIET) -> Array:
    """The first raster minus the other, on the cells of the first.

    Parameters
    ----------
    one, other : of one band, on aligned cells of one size (see :func:`misfit`)

    Returns
    -------
    array of shape (rows, cols) of the first, NaN where one of the two has no value

    Examples
    --------
    >>> surface = Raster.from_lattice(np.array([[7.0, 8.0]]), Lattice(0, 1, 1.0, 1, 2), crs=None)
    >>> base = Raster.from_lattice(np.array([[5.0]]), Lattice(1, 1, 1.0, 1, 1), crs=None)
    >>> difference(surface, base)
    array([[nan,  3.]])
    """
    first, second = one.band(), other.band()
    down, right = offset(Lattice.of(one), Lattice.of(other))
    rows, cols = first.shape
    top, bottom = max(0, down), min(rows, down + second.shape[0])
    west, east = max(0, right), min(cols, right + second.shape[1])
    found = np.full(first.shape, np.nan)
    for row in range(top, bottom, ROWS):
        ctx.progress((row - top) / (bottom - top))
        block = slice(row, min(row + ROWS, bottom)), slice(west, east)
        beside = slice(row - down, block[0].stop - down), slice(west - right, east - right)
        found[block] = first[block] - second[beside]
    return found
