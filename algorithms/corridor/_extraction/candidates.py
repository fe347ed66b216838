"""From a cloud, the points that may belong to a power line, and a thinned ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._settings import SETTINGS
from algorithms.shared.lowest import cells_of, lattice_around, lowest_points
from toolbox.context import QUIET, Context

STANDS_FOR = "stands_for"
GROUND_CELL = 1.0  # metres; of the other points in one, the lowest stands for all

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def candidates(
    xyz: Floats,
    height: Floats,
    use: NDArray[np.bool_],
    *,
    metre: float = 1.0,
    ctx: Context = QUIET,
) -> tuple[Ints, NDArray[np.uint32]]:
    """Indices of all points off the ground, and of the lowest other point of each cell.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    height : array of shape (n,), above the ground, metres; NaN where not known
    use : array of shape (n,), points that take part
    metre : length of one metre in the unit of the points

    Returns
    -------
    indices, and the number of points that each stands for
    """
    off = use & (height > SETTINGS.points.off_ground)
    low = use & ~off
    if not low.any():
        index = np.flatnonzero(off)
        return index, np.ones(len(index), np.uint32)
    lattice = lattice_around(
        xyz, GROUND_CELL * metre
    )  # of whole multiples of its cells, also in tiles
    lowest = lowest_points(xyz, low, lattice, ctx).ravel()
    count = np.bincount(cells_of(xyz, lattice)[low], minlength=len(lowest))
    taken = lowest >= 0
    index = np.concatenate([np.flatnonzero(off), lowest[taken]])
    stands_for = np.concatenate([np.ones(np.count_nonzero(off), int), count[taken]])
    order = np.argsort(index)
    return index[order], stands_for[order].astype(np.uint32)
