"""Which points may be noise: bounds of mean distances, from counts and sums over cells.

A search for the neighbours of each point takes long, and most points lie so plainly among others
that bounds tell: what a point is measured by is at most a few times what all around it are.

References
----------
Morton, G. M. (1966). A computer oriented geodetic data base and a new technique in file
sequencing. IBM, Ottawa: cells near each other have numbers near each other.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from algorithms.points import _noise_bounds_kernels as kernels
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import blocks
from algorithms.shared.neighbours import PointTree
from toolbox.context import QUIET, Context

PER_CELL = 0.35  # times k points in the usual cell, so that a window holds three times k
PER_SQUARE = 32  # points in squares that tell how dense points are
MOST_CELLS = 4  # per point
MOST_IN_DOUBT = 1 / 6  # of the points: with more, closer looks take longer than they save
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Bits = NDArray[np.int64]


def lowest_around(
    xyz: Floats, k: int, reach: float, ratio: float, few: int, ctx: Context = QUIET
) -> tuple[PointTree, Singles]:
    """Lower bound of the mean distances of all points around, for points that may be far from all.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    k : neighbours that a mean distance is of
    reach : a neighbour that is missing within it counts as being that far away
    ratio : times the median of the mean distances of its nearest that a point is beyond doubt
    few : how many nearest these are
    ctx : progress and cancellation

    Returns
    -------
    tree of the points : one that is fast to make where few points are in doubt, else one that is
        fast to search
    array of shape (2, n), in the order of the tree
        The bound, infinite for points without doubt, and how far around it holds for all points;
        zeros where cells of one size do not tell.
    """
    low = np.array([xyz[:, axis].min() for axis in (0, 1)])  # much faster than along the points
    extent = np.array([xyz[:, axis].max() for axis in (0, 1)]) - low
    cell = _cell(xyz, low, extent, k)
    shape = extent / cell if cell > 0 else np.full(2, np.inf)
    if (shape + 1).prod() > MOST_CELLS * len(xyz):
        return PointTree.of(xyz, ctx=ctx), np.zeros((2, len(xyz)), np.float32)
    cells = _along_a_curve(*(math.floor(side) + 1 for side in shape))
    placed, order, edges = kernels.sort_into_cells(xyz, low[0], low[1], cell, *cells)
    if _crowded(edges, k) > len(xyz):
        return PointTree.of(xyz, ctx=ctx), np.zeros((2, len(xyz)), np.float32)
    ctx.progress(0.3)
    around = np.empty((2, len(xyz)), np.float32)
    upper, least = np.empty(len(xyz), np.float32), np.empty(len(edges) - 1, np.float32)
    wide = np.zeros(len(least), np.uint8)
    rows = blocks(len(cells[1]), 1 + 20 * len(xyz) // len(cells[1]))
    grid = edges, *cells, cell
    side_by_side(
        kernels.bounds, rows, placed, *grid, k, reach, upper, least, wide, ctx=ctx.part(0.3, 0.6)
    )
    side_by_side(kernels.doubtful, rows, *grid, ratio, upper, least, wide, *around)
    if np.count_nonzero(np.isfinite(around[0])) > MOST_IN_DOUBT * len(xyz):
        tree = PointTree.of(placed, ctx=ctx.part(0.6, 1.0))
        return replace(tree, order=order[tree.order]), around[:, tree.order]
    side_by_side(
        kernels.closer,
        rows,
        placed,
        *grid,
        k,
        reach,
        ratio,
        few,
        wide,
        *around,
        ctx=ctx.part(0.6, 1.0),
    )
    return PointTree.along(placed, order), around


def _cell(xyz: Floats, low: Floats, extent: Floats, k: int) -> float:
    """Size of cells that hold PER_CELL times k points where points are as dense as is usual."""
    size = math.sqrt(extent.prod() * PER_SQUARE / len(xyz))
    if not size > 0:
        return 0.0
    columns, rows = (math.floor(side) + 1 for side in extent / size)
    counts = kernels.counts(xyz, low[0], low[1], size, columns, rows)
    return float(size * math.sqrt(PER_CELL * k / np.median(counts[counts > 0])))


def _crowded(edges: Bits, k: int) -> float:
    """How many points a search takes as long for as for those of cells too full for a window.

    There all points of a cell are compared with each other, as no curve parts them.
    """
    held = np.diff(edges).astype(np.float64)
    full = held[held > kernels.MOST * k]
    return float((full**2).sum() / (kernels.MOST * k))


def _along_a_curve(columns: int, rows: int) -> tuple[Bits, Bits]:
    """Bits of the number of a cell along the curve, for each column and for each row."""
    lines = np.arange(columns), np.arange(rows)
    found = np.zeros_like(lines[0]), np.zeros_like(lines[1])
    at = 0
    for bit in range((max(columns, rows) - 1).bit_length()):
        for line, bits in zip(lines, found, strict=True):
            if (len(line) - 1) >> bit:
                np.bitwise_or(bits, ((line >> bit) & 1) << at, out=bits)
                at += 1
    return found
