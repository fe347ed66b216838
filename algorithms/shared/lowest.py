"""The lowest points of an area on a lattice: what the ground filters start from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algorithms.shared import _lowest_kernels as kernels
from toolbox.context import Context
from toolbox.data import Lattice
from toolbox.errors import DataError

OUTLIER_REACH, OUTLIER_STEP = 10.0, 1.0  # metres
OUTLIER_SLOPE, OUTLIER_SUPPORT = 0.3, 5
MAX_CELLS = 200_000_000  # a square of 7 km at 0.5 m, more than a tile ever needs
BLOCK = 2_000_000  # nodes or points that are worked on between two looks at the context

Floats = NDArray[np.float64]


def require_finite(xyz: Floats) -> None:
    """Refuse coordinates that are not finite numbers."""
    if np.isfinite(xyz).all():
        return
    point, axis = np.argwhere(~np.isfinite(xyz))[0]
    raise ValueError(
        f"xyz: coordinates must be finite numbers, got {'xyz'[axis]} = {xyz[point, axis]} "
        f"at point {point}"
    )


def lattice_around(
    xyz: Floats, cell: float, *, bytes_per_cell: int = 33, parameter: str = "cloth_resolution"
) -> Lattice:
    """The cells of the points and one more on each side.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    cell : in the unit of the points
    bytes_per_cell : memory that the caller is going to need, for the message
    parameter : what sets the cell, for the message

    Raises
    ------
    DataError
        The bounding box of the points, which one stray point may stretch, has too many cells.
    """
    low, high = xyz[:, :2].min(axis=0), xyz[:, :2].max(axis=0)
    with np.errstate(over="ignore"):
        cells = float(np.prod((high - low) / cell + 3))
    if cells > MAX_CELLS:
        raise DataError(
            f"points: their bounding box, x {low[0]:.2f} to {high[0]:.2f} and y {low[1]:.2f} to "
            f"{high[1]:.2f}, has {cells:,.0f} cells of {cell:g} "
            f"({cells * bytes_per_cell / 1e9:,.0f} GB); at most {MAX_CELLS:,} are allowed: "
            f"remove stray points, cut the data into tiles or raise {parameter}"
        )
    return Lattice.cover((*(low - cell), *(high + cell)), cell)


def without_low_outliers(xyz: Floats, cell: float, metre: float, ctx: Context) -> NDArray[np.bool_]:
    """False for points far below almost all others around them, judged on cells of `cell`."""
    lattice = lattice_around(xyz, cell)
    reach = max(2, round(OUTLIER_REACH * metre / cell))
    step, rise = OUTLIER_STEP * metre, OUTLIER_SLOPE * cell
    use = np.ones(len(xyz), bool)
    done = 0.0
    while True:
        half = ctx.part(done, (1 + done) / 2)  # how many rounds there will be, nobody knows
        lowest = lowest_points(xyz, use, lattice, half.part(0.0, 0.2))
        found = np.zeros(lowest.shape, bool)
        for rows in blocks(lattice.rows, 10 * lattice.cols):
            kernels.alone_below(xyz[:, 2], lowest, *rows, reach, step, rise, OUTLIER_SUPPORT, found)
            half.progress(0.2 + 0.8 * rows[1] / lattice.rows)
        if not found.any():
            return use
        use[lowest[found]] = False  # another point of the cell may take its place
        done = (1 + done) / 2


def lowest_points(
    xyz: Floats, use: NDArray[np.bool_], lattice: Lattice, ctx: Context
) -> NDArray[np.int64]:
    """Index of the lowest point in use of each cell; -1 where there is none."""
    lowest = np.full(lattice.shape, -1)
    for start, stop in blocks(len(xyz)):
        cells = lattice.indices(xyz[start:stop, 0], xyz[start:stop, 1])
        kernels.lowest_points(xyz, use, start, *cells, lowest)
        ctx.progress(stop / len(xyz))
    return lowest


def spread_to_empty(xyz: Floats, near: NDArray[np.int64], lattice: Lattice, ctx: Context) -> None:
    """Give each empty cell (-1) the index of the point nearest to its middle (in place)."""
    empty = near < 0
    down = [(first, last, 1) for first, last in blocks(lattice.rows, lattice.cols)]
    up = [(last - 1, first - 1, -1) for first, last, _ in reversed(down)]
    for k, rows in enumerate(down + up):
        kernels.spread_rows(xyz, near, empty, *lattice.centres(), *rows)
        ctx.progress((k + 1) / len(down + up))


def blocks(total: int, size: int = 1) -> list[tuple[int, int]]:
    """Cut `total` items of `size` nodes into runs (first, last) of about BLOCK nodes."""
    length = max(1, BLOCK // size)
    return [(first, min(first + length, total)) for first in range(0, total, length)]
