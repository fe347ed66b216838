"""Statistics of the points in each cell of a raster."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels.compiling import kernel
from algorithms.shared.kernels.sorting import sort_few
from algorithms.shared.kernels.threads import in_blocks
from toolbox.context import QUIET, Context
from toolbox.data import Lattice

Statistic = Literal["min", "max", "mean", "median", "count", "std", "percentile"]
BLOCK = 500_000  # points or cells between two checks for cancellation
MEAN, DEVIATION, COUNT, QUANTILE = range(4)

Array = NDArray[np.float64]


def per_cell(
    xy: Array,
    values: Array,
    lattice: Lattice,
    statistic: Statistic,
    *,
    percentile: float = 95.0,
    ctx: Context = QUIET,
) -> tuple[Array, NDArray[np.int32]]:
    """Raster of a statistic of the points in each cell, and the number of these points.

    Parameters
    ----------
    xy : array of shape (n, 2)
    values : array of shape (n,)
    lattice : the cells; a cell holds its west and south edge
    statistic : std is that of the points themselves (divided by their number), percentiles lie
        between two points in proportion
    percentile : 0 to 100, for the statistic of that name

    Returns
    -------
    surface : array of shape (rows, cols), NaN (count: 0) in cells without points
    used : array of shape (rows, cols), number of points
    """
    cells = _cells(xy, lattice, ctx.part(0.0, 0.5))
    if statistic in ("min", "max"):  # for which nothing has to be sorted
        ends, used = np.full(lattice.shape, np.nan), np.zeros(lattice.shape, np.int32)
        _extremes(cells, values, statistic == "max", ends.reshape(-1), used.reshape(-1))
        ctx.progress(1.0)
        return ends, used
    starts = np.zeros(lattice.rows * lattice.cols + 1, np.int64)
    _count(cells, starts)
    sorted_values = _gather(cells, values, starts)
    ctx.progress(0.7)
    surface = np.empty(lattice.shape)
    kinds = {"mean": MEAN, "std": DEVIATION, "count": COUNT}
    share = 0.5 if statistic == "median" else percentile / 100
    kind = kinds.get(statistic, QUANTILE)
    in_blocks(
        lambda first, last: _summarise(
            sorted_values, starts, first, last, kind, share, surface.reshape(-1)
        ),
        surface.size,
        BLOCK,
        ctx.part(0.7, 1),
    )
    return surface, np.diff(starts).astype(np.int32).reshape(lattice.shape)


def _cells(xy: Array, lattice: Lattice, ctx: Context) -> NDArray[np.int32]:
    """Number of the cell of each point, row by row; -1 outside of the raster."""
    cells = np.empty(len(xy), np.int32)
    for first in range(0, len(xy), BLOCK):
        some = slice(first, first + BLOCK)
        row, col = lattice.indices(xy[some, 0], xy[some, 1])
        here = (row >= 0) & (row < lattice.rows) & (col >= 0) & (col < lattice.cols)
        cells[some] = np.where(here, row * lattice.cols + col, -1)
        ctx.progress(first / len(xy))
    return cells


@kernel
def _extremes(cells, values, highest, surface, used):
    """Highest or lowest value of each cell, NaN before, and the number of its points."""
    for i in range(len(cells)):
        cell, value = cells[i], values[i]
        if cell >= 0:
            used[cell] += 1
            kept = surface[cell]
            if not (kept >= value if highest else kept <= value):  # false for NaN
                surface[cell] = value


@kernel
def _count(cells, starts):
    """Fill in the start of the points of each cell; cell number -1 means outside of the raster."""
    for i in range(len(cells)):
        if cells[i] >= 0:
            starts[cells[i] + 1] += 1
    for cell in range(len(starts) - 1):
        starts[cell + 1] += starts[cell]


@kernel
def _gather(cells, values, starts):
    """Values sorted by cell."""
    found, free = np.empty(starts[-1]), starts[:-1].copy()
    for i in range(len(cells)):
        if cells[i] >= 0:
            found[free[cells[i]]] = values[i]
            free[cells[i]] += 1
    return found


@kernel
def _summarise(values, starts, first, last, kind, share, surface):
    """Fill in the cells first..last; sorts the values of each, so that sums have a fixed order."""
    for cell in range(first, last):
        here = values[starts[cell] : starts[cell + 1]]
        n = len(here)
        if kind == COUNT:
            surface[cell] = n
        elif n == 0:
            surface[cell] = np.nan
        else:
            _sort(here)
            surface[cell] = _quantile(here, share) if kind == QUANTILE else _moment(here, kind)


@kernel
def _sort(values):
    if len(values) > 32:
        values.sort()
    else:
        sort_few(values)


@kernel
def _quantile(values, share):
    """Quantile of sorted values, interpolated linearly between two of them."""
    place = share * (len(values) - 1)
    i = int(place)
    if i + 1 >= len(values):
        return values[-1]
    return values[i] + (place - i) * (values[i + 1] - values[i])


@kernel
def _moment(values, kind):
    """Mean or standard deviation of sorted values, computed from the lowest for precision."""
    low, total, squares = values[0], 0.0, 0.0
    for value in values:
        total += value - low
    mean = total / len(values)
    for value in values:
        squares += (value - low - mean) ** 2
    return low + mean if kind == MEAN else np.sqrt(squares / len(values))
