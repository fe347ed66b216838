"""What lies on a water: parts that return more or brighter pulses, at a level of their own.

Floating plants, ice and flooded reeds return their pulses, and the water beside them does not. So
most points on such a water may be on what covers it, and their mean is no level of water.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from algorithms.shared.otsu import otsu_threshold
from algorithms.shoreline._cells import CellGrid, window
from algorithms.shoreline._level import Level, level_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Index = NDArray[np.integer[Any]]

PATCH = 5  # cells that are looked at together: single ones return by chance


def covered(
    xyz: Floats, strip: Ints, cell_of: Index, core: Ints, cells: CellGrid, level: Level
) -> tuple[float, float] | None:
    """Levels of the part of a water that returns most and of the rest, if they surely differ.

    Parameters
    ----------
    xyz, strip : points on the water and their flights, see :func:`level_of`
    cell_of : array of shape (n,), the cell of each point
    core : the cells whose points tell the level
    cells : see :class:`CellGrid`
    level : of all points

    Returns
    -------
    tuple of float or None
        Parts differ if their intervals say so and they are as far apart as other flights may be.
    """
    for thick in _parts(cells, core):
        parts = [
            level_of(xyz, strip, np.isin(cell_of, some), level.height, cells.metre)
            for some in (thick, np.setdiff1d(core, thick))
        ]
        apart = abs(parts[0].height - parts[1].height)
        if apart >= math.hypot(parts[0].interval, parts[1].interval):
            return parts[0].height, parts[1].height
    return None


def _parts(cells: CellGrid, core: Ints) -> list[Ints]:
    """Cells of a core around which more pulses come back, and around which they are brighter."""
    count = cells.count.ravel()[core].astype(float)
    light = np.nan_to_num(cells.bright.ravel()[core]) * count
    (top, left), inside = window(cells.lattice, core, PATCH)
    spot = core // cells.lattice.cols - top, core % cells.lattice.cols - left

    def around(values: Any) -> Floats:
        held = np.zeros(inside.shape)
        held[spot] = values
        return np.asarray(ndimage.uniform_filter(held, PATCH)[spot])

    many = around(count)
    found = [many / around(1.0), around(light) / np.maximum(many, 1e-9)]
    return [core[v >= otsu_threshold(v)] for v in found if np.ptp(v) > 0]
