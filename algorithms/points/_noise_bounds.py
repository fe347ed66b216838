"""Which points may be noise: bounds of mean distances, from counts and sums over cells.

A search for the neighbours of each point takes long, and most points lie so plainly among others
that bounds tell: what a point is measured by is at most a few times what all around it are.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from algorithms.points import _noise_bounds_kernels as kernels
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import blocks
from algorithms.shared.neighbours import PointTree
from toolbox.context import QUIET, Context

PER_CELL = 0.35  # times k points in the usual cell, so that a window holds three times k
MOST_CELLS = 4  # per point
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


def lowest_around(
    tree: PointTree, k: int, reach: float, ratio: float, ctx: Context = QUIET
) -> Singles:
    """Lower bound of the mean distances of all points around, for points that may be far from all.

    Parameters
    ----------
    tree : of the points
    k : neighbours that a mean distance is of
    reach : a neighbour that is missing within it counts as being that far away
    ratio : times the lowest mean distance around it that a point is beyond doubt
    ctx : progress and cancellation

    Returns
    -------
    array of shape (2, n), in the order of the tree
        The bound, infinite for points without doubt, and how far around it holds for all points;
        zeros where cells of one size do not tell.
    """
    xyz = tree.xyz
    low, high = tree.boxes[1, :2], tree.boxes[1, 3:5]
    cell = _cell(tree, k)
    shape = (high - low) / cell if cell > 0 else np.full(2, np.inf)
    if (shape + 1).prod() > MOST_CELLS * len(xyz):
        return np.zeros((2, len(xyz)), np.float32)
    columns, rows = (math.floor(extent) + 1 for extent in shape)
    placed, order, edges = kernels.sort_into_cells(xyz, low[0], low[1], cell, columns, rows)
    ctx.progress(0.3)
    upper, least = np.empty(len(xyz), np.float32), np.empty(len(edges) - 1, np.float32)
    wide = np.zeros(len(least), np.uint8)
    side_by_side(
        kernels.bounds,
        blocks(rows, 1 + 20 * len(xyz) // rows),
        placed,
        edges,
        columns,
        cell,
        k,
        reach,
        upper,
        least,
        wide,
        ctx=ctx.part(0.4, 0.9),
    )
    around = np.empty((2, len(xyz)), np.float32)
    kernels.doubtful(order, edges, columns, cell, ratio, upper, least, wide, around[0], around[1])
    return around


def _cell(tree: PointTree, k: int) -> float:
    """Size of cells that hold PER_CELL times k points where points are as dense as is usual."""
    leaves = 1 << tree.depth
    box = tree.boxes[leaves:]
    area = float(np.median((box[:, 3] - box[:, 0]) * (box[:, 4] - box[:, 1])))
    return math.sqrt(area * PER_CELL * k * leaves / len(tree.xyz))
