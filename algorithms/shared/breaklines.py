"""Points of the ground beyond its bends: edges of terraces, ridges, tops of banks.

A smooth surface that gives little weight to what lies above it cuts such edges off. But there a
point lies on the continuation of the ground on one of its sides, which points of plants and roofs
do by chance only. Whether more lie there than chance puts there is learned from the points around.

The idea of testing a point against the surface on the far side of a break is that of the mirrored
points of Axelsson (2000); planes on one side of a point are those of edge-preserving filters
(Kuwahara et al. 1976).

References
----------
Axelsson, P. (2000). DEM generation from laser scanner data using adaptive TIN models.
International Archives of Photogrammetry and Remote Sensing 33(B4/1), 110-117.
Kuwahara, M. et al. (1976). Processing of RI-angiocardiographic images. Digital Processing of
Biomedical Images, 187-202.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels import breaklines as kernels
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import blocks
from algorithms.shared.windows import spread, window_sums
from toolbox.context import QUIET, Context

HALF_DISC = 10  # cells of ground that a half disc holds if all of its points are ground
RADIUS = (3.0, 8.0)  # metres between which it has to be
LEAST, STIFF = 4, 0.006  # cells in a half disc; share of the square of its radius
STEPS = (0.15, 0.3, 0.45, 0.6, 0.9)  # metres off the continuation that are tried
HALF, QUARTER = 4, 2  # octants of a half disc, and of one that no wall through its point enters
MORE = (1 / 2, 5 / 9)  # share of points within a step from which on it counts in part, and in full
TOP = (2 / 3, 3 / 4)  # the same at the top of steps: of a quarter disc chance may give 3 of 5
FEW = 20  # points that have to be outnumbered there besides
AROUND = 40.0  # metres, standard deviation of the window in which it is learned what is ground
BLOCK = 16  # metres of the blocks in which that is counted
REACHED = 100  # cells that one half disc looks at, about, as a measure of work
ROUNDS = 3  # times that points are taken back, each time from farther beyond the bend

Floats = NDArray[np.float64]
Cells = NDArray[np.float32]
Ints = NDArray[np.signedinteger]
Mask = NDArray[np.bool_]


def taken_back(z: Cells, ground: Mask, asked: Mask, share: Floats, ctx: Context) -> Mask:
    """True for cells that continue the ground on one of their sides.

    Parameters
    ----------
    z : array of shape (rows, cols), heights in metres, in cells of a metre; NaN where there is none
    ground : array of the same shape, cells of the ground
    asked : array of the same shape, cells that are no ground so far and may be
    share : array of shape (rows / 8, cols / 8), share of the cells that hold points
    ctx : progress and cancellation

    Returns
    -------
    array of shape (rows, cols)

    Examples
    --------
    >>> z = np.zeros((64, 64), np.float32)
    >>> z[:, 32:] = 4.0  # a terrace, of which a smooth surface lost the edge
    >>> edge = np.zeros(z.shape, bool)
    >>> edge[:, 32:34] = True
    >>> found = taken_back(z, ~edge, edge, np.ones((8, 8)), Context())
    >>> bool(found[edge].all())
    True
    """
    ground, left = ground.copy(), np.flatnonzero(asked)
    found = np.zeros_like(ground)
    allowed = None
    for k in range(ROUNDS):
        part = ctx.part(k / ROUNDS, (k + 1) / ROUNDS)
        off = off_continuations(left, z.ravel()[left], z, ground, share, part)
        if allowed is None:
            allowed = spread(learned(off, left, z.shape), BLOCK).ravel()
        new = np.abs(off) <= allowed[left]
        if not new.any():
            break
        ground.ravel()[left[new]] = found.ravel()[left[new]] = True
        left = left[~new]
    ctx.progress(1.0)
    return found


def off_tops(cells: Ints, heights: Cells, z: Cells, ground: Mask, share: Floats) -> Floats:
    """How far points are off the top of a step, such as an upright wall, that parts their cell.

    Such a cell has its lowest point at the foot of the step; what is at its top continues the
    ground in a quarter disc beside it.

    Parameters
    ----------
    cells, heights : arrays of shape (n,), cell of each point, counted row by row; height in metres
    z, ground, share : as in :func:`taken_back`

    Returns
    -------
    array of shape (n,)
        In parts of what is allowed: at most 1 for points of the ground.

    Examples
    --------
    >>> z = np.zeros((64, 64), np.float32)
    >>> z[:, 32:] = 4.0  # the step is in cells of column 31, whose lowest points are at its foot
    >>> cells, heights = np.arange(31, 4096, 64).repeat(9), np.full(576, 4.1, np.float32)
    >>> heights[8] = 3.0  # a bush
    >>> off_tops(cells, heights, z, np.ones(z.shape, bool), np.ones((8, 8)))[7:10].round(1)
    array([0.7, 6.7, 0.7])
    """
    off = off_continuations(cells, heights, z, ground, share, QUIET, wide=QUARTER)
    allowed = STEPS[0] * within_step(off, cells, z.shape, STEPS[0], TOP, FEW)
    return np.abs(off) / np.maximum(spread(allowed, BLOCK).ravel()[cells], 1e-9)


def off_continuations(
    cells: Ints,
    heights: Cells,
    z: Cells,
    ground: Mask,
    share: Floats,
    ctx: Context,
    *,
    wide: int = HALF,
) -> Cells:
    """Heights above the continuation of the ground on the side that fits best, in metres.

    Parameters
    ----------
    cells, heights : arrays of shape (n,), at which this is asked: cells counted row by row
    z, ground, share, ctx : as in :func:`taken_back`
    wide : octants of the part of a disc that has to hold the ground

    Returns
    -------
    array of shape (n,), infinite where there is too little ground on all sides

    Examples
    --------
    >>> z = np.tile(np.arange(16, dtype=np.float32), (16, 1))  # a slope of 1
    >>> cells, heights = np.array([4 * 16 + 10, 8 * 16 + 8]), np.array([10, 10], np.float32)
    >>> others = np.ones(z.shape, bool)
    >>> others[8, 8] = False
    >>> off_continuations(cells, heights, z, others, np.full((2, 2), 0.25), Context()).round(1)
    array([-0. ,  1.8], dtype=float32)
    """
    off = np.empty(len(cells), np.float32)
    side_by_side(
        kernels.off_continuations,
        blocks(len(cells), REACHED),
        cells,
        heights,
        z,
        ground,
        np.clip(np.sqrt(2 * HALF_DISC / (math.pi * share)), *RADIUS),
        octants(),
        wide,
        LEAST,
        STIFF,
        off,
        ctx=ctx,
    )
    return off


@functools.cache
def octants() -> NDArray[np.int64]:
    """Octant of each offset (rows down, columns right) within the greatest radius; 8 for none.

    Examples
    --------
    >>> octants()[8, 6:11]  # two to the left, the cell itself, two to the right
    array([3, 3, 8, 7, 7])
    """
    far = math.ceil(RADIUS[1])
    down, right = np.mgrid[-far : far + 1, -far : far + 1]
    angle = np.arctan2(down, right) / math.tau
    octant: NDArray[np.int64] = np.floor(8 * ((angle + 1 - 1e-9) % 1)).astype(np.int64)
    octant[far, far] = 8
    return octant


def learned(off: Cells, cells: Ints, shape: tuple[int, ...]) -> Floats:
    """How far off the continuation of the ground a point of the ground may be, by blocks.

    Ground is dense about its continuation, and plants and roofs are not. So from the least step on
    each is allowed as long as more points lie within it than from there to twice as far above.
    Where they are little more, part of it is allowed, so that no single point far away decides.

    Parameters
    ----------
    off, cells : arrays of shape (n,), see :func:`off_continuations`
    shape : rows and columns of the cells

    Returns
    -------
    array of shape (rows / BLOCK, cols / BLOCK), metres; 0 where not even the least is allowed

    Examples
    --------
    >>> off = np.resize(np.array([0.1, 0.8], np.float32), 1024)  # as many plants as ground
    >>> learned(off, np.arange(1024), (32, 32))[0]
    array([0.3, 0.3])
    """
    rows, cols = (side // BLOCK for side in shape)
    allowed = np.zeros((rows, cols))
    possible, last = np.ones(allowed.shape), 0.0
    for step in STEPS:
        possible = np.minimum(possible, within_step(off, cells, shape, step, MORE, 1))
        allowed += (step - last) * possible
        last = step
    return allowed


def within_step(
    off: Cells,
    cells: Ints,
    shape: tuple[int, ...],
    step: float,
    more: tuple[float, float],
    few: int,
) -> Floats:
    """How far more points lie within a step of the continuation than from there to twice above.

    Parameters
    ----------
    off, cells, shape : as in :func:`learned`
    step : metres
    more : share of those within from which on it counts in part, and in full
    few : points that are counted with those beyond

    Returns
    -------
    array of shape (rows / BLOCK, cols / BLOCK), 0 to 1

    Examples
    --------
    >>> off = np.resize(np.array([0.1, 0.1, 0.2], np.float32), 1024)
    >>> within_step(off, np.arange(1024), (32, 32), 0.15, (0.5, 0.75), 1)[0].round(1)
    array([0.7, 0.7])
    """
    rows, cols = (side // BLOCK for side in shape)
    block = cells // shape[1] // BLOCK * cols + cells % shape[1] // BLOCK
    within, beyond = (
        window_sums(
            np.bincount(block[those], minlength=rows * cols).reshape(rows, cols), 1, AROUND / BLOCK
        )
        for those in (np.abs(off) <= step, (off > step) & (off <= 2 * step))
    )
    share: Floats = within / (within + beyond + few)
    return np.clip((share - more[0]) / (more[1] - more[0]), 0, 1)
