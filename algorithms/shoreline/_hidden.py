"""Where crowns hide a shore: the water may go on below them as far as to the first ground."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from algorithms.shoreline._cells import CellGrid, around, window
from algorithms.shoreline._evidence import WALL
from algorithms.shoreline._level import Level

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Squares = NDArray[np.object_]

REACH = 10.0  # m that a crown hangs over a shore at most: those of trees that stand free are 20 m
ABOVE = 2.0  # m over the water from which what returned may hang over it; banks begin below


def hidden(cells: CellGrid, body: Ints, of_body: NDArray[Any], level: Level) -> Squares:
    """Cells beside a water that crowns hide, as far as to the first ground, as squares.

    A crown shows as returns high above the water and of many heights; a roof or a deck is even.
    Ground below crowns returns something here and there, and water seldom does.

    Parameters
    ----------
    cells : see :class:`CellGrid`
    body : indices of the cells of the water
    of_body : for each cell the number of the body that it belongs to, 0 for none
    level : of the water

    Returns
    -------
    squares of the cells
    """
    reach = REACH * cells.metre
    band = around(cells.lattice, body, math.ceil(reach / cells.lattice.cell))
    band = band[(of_body[band] == 0) & cells.inside.ravel()[band]]
    spots, beside = cells.centres(band), around(cells.lattice, body, 1)
    low = cells.low.ravel()[band] + cells.base
    high = low > level.at(spots) + ABOVE * cells.metre
    rough = high & (cells.spread.ravel()[band] > WALL * cells.metre)
    seen = np.isfinite(low)
    away = np.asarray(cKDTree(cells.centres(beside)).query(spots)[0])
    behind = np.full(len(band), np.inf)
    behind[rough] = _behind(spots, away, low, seen & ~rough, rough, reach)
    hung = rough & (low > behind + ABOVE * cells.metre)
    if not hung.any():
        return np.zeros(0, object)
    amid = ~seen & np.isin(band, around(cells.lattice, band[hung], 1))
    ground = seen & ~hung & ~(rough & np.isinf(behind))
    wide = away + cKDTree(spots[ground]).query(spots)[0]
    maybe = band[(hung | amid) & (wide <= reach)]
    if not len(maybe):
        return np.zeros(0, object)
    (top, left), mask = window(cells.lattice, maybe, 0)
    part = ndimage.label(mask)[0][
        maybe // cells.lattice.cols - top, maybe % cells.lattice.cols - left
    ]
    joined = np.isin(part, part[np.isin(maybe, beside)])
    x, y = cells.centres(maybe[joined]).T
    half = cells.lattice.cell / 2
    return np.asarray(shapely.box(x - half, y - half, x + half, y + half))


def _behind(
    spots: Floats, away: Floats, low: Floats, ground: Mask, rough: Mask, reach: float
) -> Floats:
    """Height of the nearest ground within reach that is farther from the water; inf without one.

    Parameters
    ----------
    spots : array of shape (n, 2)
    away : from the water, in the unit of the data
    low : lowest heights
    ground : which spots are of ground
    rough : which spots it is looked for from
    reach : in the unit of the data
    """
    own = np.flatnonzero(ground)
    tree = cKDTree(spots[own])
    height = np.full(int(rough.sum()), np.inf)
    for k, spot in enumerate(np.flatnonzero(rough).tolist()):
        near = own[tree.query_ball_point(spots[spot], reach)]
        near = near[away[near] > away[spot]]
        if len(near):
            height[k] = low[near[np.hypot(*(spots[near] - spots[spot]).T).argmin()]]
    return height
