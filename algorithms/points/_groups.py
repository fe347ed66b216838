"""Points in groups: those of one cell, or those that have the same values."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algorithms.points import _thin_kernels as kernels
from algorithms.shared.lowest import blocks
from toolbox.context import QUIET, Context

ROUNDING = 1e-6  # cells: positions this near to the next cell are in it; more than rounding errors

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


def cells(places: Floats, cell: float) -> Indices:
    """Cell numbers of positions along each axis, from floor division; both arrays of shape (n, k).

    A position on the edge of two cells is in the higher one, also if it is there but for rounding.

    Examples
    --------
    >>> cells(np.array([[0.29, 0.3, -0.1]]), 0.1).tolist()
    [[2, 3, -1]]
    """
    return np.floor(places / cell + ROUNDING).astype(np.int64)


def grouped(codes: Indices, *, ctx: Context = QUIET) -> tuple[Indices, int]:
    """Group number of each point, from 0, and the number of groups.

    Parameters
    ----------
    codes : array of shape (n, k); points are of one group if all k are the same
    ctx : progress and cancellation
    """
    groups, size = np.empty(len(codes), np.int64), np.zeros(1, np.int64)
    table = np.full(1 << (2 * len(codes)).bit_length(), -1, np.int64)
    for first, last in blocks(len(codes)):
        kernels.number(first, last, codes, table, groups, size)
        ctx.progress(last / len(codes))
    ctx.progress(1.0)
    return groups, int(size[0])
