"""The lowest points of an area on a lattice: what the ground filters start from."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from algorithms.shared import low_noise
from algorithms.shared.kernels import lowest as kernels
from toolbox.context import Context, log
from toolbox.data import Lattice
from toolbox.errors import DataError

OUTLIER_REACH, OUTLIER_CELL = 10.0, 2.0  # metres
OUTLIER_ROUNDS = 3
FEW_CELLS, MAX_CELLS_PER_POINT = 10_000_000, 1_000  # more, and stray points stretch the box
MAX_CELLS = 200_000_000  # a square of 7 km at 0.5 m, more than a tile ever needs
LARGEST = 1e12  # coordinate, in any unit; numbers of that size are already 0.0001 apart
BLOCK = 2_000_000  # nodes or points that are between two checks for cancellation

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


def require_finite(xyz: Floats, *, largest: float = LARGEST) -> None:
    """Raise an error for coordinates that are not finite, or not below `largest` in size.

    Raises
    ------
    DataError
        Names the first such point.

    Examples
    --------
    >>> require_finite(np.array([[0, 0, np.nan]]))
    Traceback (most recent call last):
    toolbox.errors.DataError: points: coordinates must be finite numbers, got z = nan at point 0
    """
    if not xyz.size or (xyz.min() > -largest and xyz.max() < largest):  # False for NaN
        return
    point, axis = np.argwhere(~(np.abs(xyz) < largest))[0]
    value = xyz[point, axis]
    rule = f"below {largest:g} in size" if np.isfinite(value) else "finite numbers"
    raise DataError(
        f"points: coordinates must be {rule}, got {'xyz'[axis]} = {value} at point {point}"
    )


def lattice_around(
    xyz: Floats,
    cell: float,
    *,
    bytes_per_cell: int = 8,
    count: int | None = None,
    parameter: str | None = None,
) -> Lattice:
    """Lattice over the points, with one more cell on each side.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    cell : in the unit of the points
    bytes_per_cell : memory that the caller is going to need, for the message
    count : points that there are, where `xyz` are but the corners of their box
    parameter : what sets the cell, for the message; None if the user cannot set it

    Raises
    ------
    DataError
        The bounding box of the points, which one stray point may stretch, has too many cells.

    Examples
    --------
    >>> lattice_around(np.array([[0.5, 0.5, 9], [2.5, 1.5, 9]]), 1.0).bounds
    (-1.0, -1.0, 4.0, 3.0)
    """
    low = np.array([xyz[:, axis].min() for axis in (0, 1)])  # much faster than along the points
    high = np.array([xyz[:, axis].max() for axis in (0, 1)])
    with np.errstate(over="ignore"):
        cells = float(np.prod((high - low) / cell + 3))
    count = len(xyz) if count is None else count
    if cells > min(MAX_CELLS, max(FEW_CELLS, MAX_CELLS_PER_POINT * count)):
        ways = ["remove stray points", "cut the data into tiles"]
        ways += [f"raise {parameter}"] if parameter else []
        raise DataError(
            f"points: their bounding box, x {low[0]:.2f} to {high[0]:.2f} and y {low[1]:.2f} to "
            f"{high[1]:.2f}, has {cells:,.0f} cells of {cell:g} "
            f"({cells * bytes_per_cell / 1e9:,.0f} GB); at most {MAX_CELLS:,}, and "
            f"{MAX_CELLS_PER_POINT:,} per point, are allowed: "
            f"{', '.join(ways[:-1])} or {ways[-1]}"
        )
    return Lattice.cover((*(low - cell), *(high + cell)), cell)


def tell_of_one_cell(lattice: Lattice, metre: float) -> None:
    """Warn where one cell holds all points, so that a raster of them says nothing of places.

    Parameters
    ----------
    metre : in the unit of the lattice

    Examples
    --------
    >>> tell_of_one_cell(Lattice.cover((0, 0, 50, 50), 10.0), 1.0)
    """
    if lattice.shape == (1, 1):
        log.warning(
            "one cell of %g m holds all points; is the cell size right?", lattice.cell / metre
        )


def outlier_reach(cell: float) -> float:
    """Metres within which other points decide whether a point is a low outlier.

    In each round it is compared with the lowest points of cells, and so are the points below it
    in its own cell. Scattered noise is left out before.

    Examples
    --------
    >>> round(outlier_reach(1.0), 1)
    58.3
    """
    cell = max(cell, OUTLIER_CELL)
    return low_noise.REACH + OUTLIER_ROUNDS * (
        max(OUTLIER_REACH, 2 * cell) + 2 * math.sqrt(2) * cell
    )


def without_low_outliers(xyz: Floats, cell: float, metre: float, ctx: Context) -> Mask:
    """False for low outliers: single points and small groups far below almost all around them.

    And for noise scattered below a surface, see :func:`low_noise.scattered_below`.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    cell : on which support is counted, in the unit of the points; at least OUTLIER_CELL metres
    metre : length of one metre in the unit of the points
    ctx : progress and cancellation

    Returns
    -------
    array of shape (n,)

    Notes
    -----
    What is left out may have hidden others, so the search is repeated where it found something,
    OUTLIER_ROUNDS times at most. Points farther away than :func:`outlier_reach` never count.

    Examples
    --------
    >>> from toolbox.context import QUIET
    >>> xyz = np.array([[x, y, 100.0] for x in range(30) for y in range(30)], float)
    >>> xyz[450, 2] = 60.0
    >>> np.flatnonzero(~without_low_outliers(xyz, 1.0, 1.0, QUIET))
    array([450])
    """
    lattice = lattice_around(xyz, max(cell, OUTLIER_CELL * metre))
    cells = np.empty(len(xyz), np.int32)
    for first, last in blocks(len(xyz)):
        cells[first:last] = cells_of(xyz[first:last], lattice)
        ctx.progress(0.1 * last / len(xyz))
    use = ~low_noise.scattered_below(xyz, metre)
    lowest = np.full(lattice.shape, -1)
    wanted = np.ones(lattice.shape, bool)
    for k in range(OUTLIER_ROUNDS):
        part = ctx.part(0.1 + 0.9 * k / OUTLIER_ROUNDS, 0.1 + 0.9 * (k + 1) / OUTLIER_ROUNDS)
        height = np.where(wanted, np.inf, -np.inf)
        for first, last in blocks(len(xyz)):
            kernels.enter_lowest(xyz, use, first, cells[first:last], height.ravel(), lowest.ravel())
            part.progress(0.3 * last / len(xyz))
        found = low_outliers(xyz, use, cells, lowest, lattice.cell, metre, part.part(0.3, 1.0))
        if not len(found):
            break
        use[found] = False
        wanted[:] = False
        wanted.ravel()[cells[found]] = True  # another point of the cell may take its place
        lowest[wanted] = -1
    return use


def low_outliers(
    xyz: Floats,
    use: Mask,
    cells: NDArray[np.int32],
    lowest: Ints,
    cell: float,
    metre: float,
    ctx: Context,
) -> Ints:
    """Indices of the low outliers among the points in use, judged by these points.

    Few cells are suspect by their lowest points alone; only what lies low there is looked at.

    Examples
    --------
    >>> from toolbox.context import QUIET
    >>> xyz = np.array([[x, y, 100.0] for x in range(30) for y in range(30)], float)
    >>> xyz[450, 2] = 60.0
    >>> use, lattice = np.ones(900, bool), lattice_around(xyz, 1.0)
    >>> lowest = lowest_points(xyz, use, lattice, QUIET)
    >>> low_outliers(xyz, use, cells_of(xyz, lattice), lowest, 1.0, 1.0, QUIET)
    array([450])
    """
    from scipy.ndimage import maximum_filter  # of which the other functions have no need

    reach = max(OUTLIER_REACH * metre, 2 * cell)
    tops = xyz[lowest]
    tops[lowest < 0] = np.inf
    ceiling = np.full(lowest.shape, -np.inf)
    for first, last in blocks(len(lowest), 10 * lowest.shape[1]):
        kernels.suspects(tops, first, last, cell, reach, metre, ceiling)
        ctx.progress(0.4 * last / len(lowest))
    places = np.argwhere(np.isfinite(ceiling))
    around = 2 * math.ceil(kernels.GROUP * metre / cell) + 1
    heights: Floats = maximum_filter(ceiling, around).ravel()
    found = []
    for first, last in blocks(len(xyz)):
        found.append(kernels.below(xyz, use, first, cells[first:last], heights))
        ctx.progress(0.4 + 0.4 * last / len(xyz))
    low = np.concatenate(found)
    low = low[np.lexsort((xyz[low, 1], xyz[low, 0], xyz[low, 2], cells[low]))]
    alone = np.zeros(len(low), bool)
    for first, last in blocks(len(places), 1000):
        kernels.judge(tops, places[first:last], xyz[low], cells[low], cell, reach, metre, alone)
        ctx.progress(0.8 + 0.2 * last / len(places))
    return low[alone]


def cells_of(xyz: Floats, lattice: Lattice) -> NDArray[np.int32]:
    """Index of the cell of each point, row by row; as :meth:`Lattice.indices`.

    Parameters
    ----------
    xyz : array of shape (n, 3), on the lattice
    lattice : in whole multiples of its cell

    Returns
    -------
    array of shape (n,)

    Examples
    --------
    >>> cells_of(np.array([[0.5, 0.5, 9], [1.5, 1.5, 9]]), Lattice(0, 2, 1.0, 2, 2))
    array([2, 1], dtype=int32)
    """
    left, top = round(lattice.west / lattice.cell), round(lattice.north / lattice.cell)
    found: NDArray[np.int32] = kernels.cells_of(xyz, left, top, lattice.cell, *lattice.shape)
    return found


def lowest_points(xyz: Floats, use: Mask, lattice: Lattice, ctx: Context) -> Ints:
    """Index of the lowest point in use of each cell; -1 where there is none.

    The lattice must be in whole multiples of its cell.

    Examples
    --------
    >>> from toolbox.context import QUIET
    >>> xyz = np.array([[0.5, 0.5, 9], [0.6, 0.5, 8], [1.5, 1.5, 7]])
    >>> lowest_points(xyz, np.ones(3, bool), Lattice(0, 2, 1.0, 2, 2), QUIET)
    array([[-1,  2],
           [ 1, -1]])
    """
    lowest = np.full(lattice.shape, -1)
    height = np.full(lattice.shape, np.inf)
    for first, last in blocks(len(xyz)):
        cells = cells_of(xyz[first:last], lattice)
        kernels.enter_lowest(xyz, use, first, cells, height.ravel(), lowest.ravel())
        ctx.progress(last / len(xyz))
    return lowest


def spread_to_empty(xyz: Floats, near: Ints, lattice: Lattice, ctx: Context) -> None:
    """Give each empty cell (-1) the index of the point nearest to its middle (in place).

    Examples
    --------
    >>> from toolbox.context import QUIET
    >>> xyz, lattice = np.array([[0.5, 0.5, 9], [1.4, 1.5, 7]]), Lattice(0, 2, 1.0, 2, 2)
    >>> near = lowest_points(xyz, np.ones(2, bool), lattice, QUIET)
    >>> spread_to_empty(xyz, near, lattice, QUIET)
    >>> near
    array([[1, 1],
           [0, 0]])
    """
    empty = near < 0
    down = [(first, last, 1) for first, last in blocks(lattice.rows, lattice.cols)]
    up = [(last - 1, first - 1, -1) for first, last, _ in reversed(down)]
    for k, rows in enumerate(down + up):
        kernels.spread_rows(xyz, near, empty, *lattice.centres(), *rows)
        ctx.progress((k + 1) / len(down + up))


def blocks(total: int, size: int = 1) -> list[tuple[int, int]]:
    """Cut `total` items of `size` nodes into blocks (first, last) of about BLOCK nodes.

    Examples
    --------
    >>> blocks(5, BLOCK // 2)
    [(0, 2), (2, 4), (4, 5)]
    """
    length = max(1, BLOCK // size)
    return [(first, min(first + length, total)) for first in range(0, total, length)]
