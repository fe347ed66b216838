"""Where the data end: what lies there is cut, and its size is that of the part that was seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shared.windows import closed
from toolbox.context import QUIET, Context, Digested
from toolbox.data import Lattice

CELL = 1.0  # metres
BY_SPACING = 2.0  # distances of points, where that is more: no cell between points is empty
GAP = 25.0  # metres: narrower gaps, as canals and yards in shadow, are within the data
BESIDE = 2  # cells from the last points: an outline runs between points, and half a cell is lost


def cut(
    shapes: Sequence[Any],
    places: Digested,
    spacing: float,
    metre: float,
    *,
    ctx: Context = QUIET,
) -> NDArray[np.bool_]:
    """Which shapes lie at the edge of the data.

    The data are the cells with points, and gaps between them into which no disc of `GAP` fits.
    Steps of a model that look at the same points share them.

    Parameters
    ----------
    shapes : polygons
    places : all points, of shape (n, 2) or (n, 3)
    spacing : distance of points, in their unit
    metre : in their unit
    ctx : keeps the edge

    Returns
    -------
    array of shape (len(shapes),)

    Examples
    --------
    >>> xy = np.stack(np.meshgrid(np.arange(0, 50, 0.5), np.arange(0, 50, 0.5)), -1).reshape(-1, 2)
    >>> cut([shapely.box(20, 20, 30, 30), shapely.box(45, 20, 49, 30)], Digested(xy), 0.5, 1.0)
    array([False,  True])
    """
    if not len(shapes):
        return np.zeros(0, bool)
    cell = max(CELL * metre, BY_SPACING * spacing)
    gap = GAP * metre / cell
    lattice, edge = ctx.once("edge", (places, cell, gap), lambda: _edge(places.array, cell, gap))
    lines = shapely.segmentize(np.asarray(shapes, object), cell)
    drawn, owner = shapely.get_coordinates(lines, return_index=True)
    met = owner[edge[lattice.indices(*drawn.T)]]
    return np.bincount(met, minlength=len(shapes)) > 0


def _edge(xyz: NDArray[np.float64], cell: float, gap: float) -> tuple[Lattice, NDArray[np.bool_]]:
    """Cells, and which of them lie at the edge of the data or beyond; `gap` is in cells."""
    from scipy.ndimage import distance_transform_edt

    around = math.ceil(gap) + BESIDE
    axes = xyz[:, 0], xyz[:, 1]  # axis by axis, which takes a tenth of the time
    low = [axis.min() - around * cell for axis in axes]
    high = [axis.max() + around * cell for axis in axes]
    lattice = Lattice.cover((*low, *high), cell)
    there = np.zeros(lattice.shape, bool)
    there[lattice.indices(*axes)] = True
    return lattice, distance_transform_edt(closed(there, gap)) <= BESIDE
