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
from toolbox.context import Context

HALF_DISC = 10  # cells of ground that a half disc holds if all of its points are ground
RADIUS = (3.0, 8.0)  # metres between which it has to be
LEAST, STIFF = 4, 0.006  # cells in a half disc; share of the square of its radius
STEPS = (0.15, 0.3, 0.45, 0.6, 0.9)  # metres off the continuation that are tried
MORE = (1 / 2, 5 / 9)  # share of points within a step from which on it counts in part, and in full
AROUND = 40.0  # metres, standard deviation of the window in which it is learned what is ground
BLOCK = 16  # metres of the blocks in which that is counted
ROUNDS = 3  # times that points are taken back, each time from farther beyond the bend

Floats = NDArray[np.float64]
Cells = NDArray[np.float32]
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
    reach = np.clip(np.sqrt(2 * HALF_DISC / (math.pi * share)), *RADIUS)
    ground, asked = ground.copy(), asked.copy()
    found = np.zeros_like(ground)
    allowed = None
    for k in range(ROUNDS):
        part = ctx.part(k / ROUNDS, (k + 1) / ROUNDS)
        off = off_continuations(z, ground, asked, reach, part)
        if allowed is None:
            allowed = spread(learned(off), BLOCK)
        new = np.abs(off) <= allowed
        if not new.any():
            break
        ground |= new
        found |= new
        asked &= ~new
    ctx.progress(1.0)
    return found


def off_continuations(z: Cells, ground: Mask, asked: Mask, reach: Floats, ctx: Context) -> Cells:
    """Heights above the continuation of the ground on the side that fits best, in metres.

    Infinite for what is not asked for, or has too little ground on all sides. `reach` is the
    radius of the half discs for blocks of 8 x 8 cells, the others are those of `taken_back`.

    Examples
    --------
    >>> z = np.tile(np.arange(16, dtype=np.float32), (16, 1))  # a slope of 1
    >>> z[8, 8] += 2.0
    >>> asked = z == 10.0
    >>> off = off_continuations(z, ~asked, asked, np.full((2, 2), 5.0), Context())
    >>> off[8, 8].round(1), off[4, 10].round(1)
    (np.float32(1.9), np.float32(-0.0))
    """
    off = np.empty_like(z)
    side_by_side(
        kernels.off_continuations,
        blocks(len(z), 10 * z.shape[1]),
        z,
        ground,
        asked,
        reach,
        octants(),
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


def learned(off: Cells) -> Floats:
    """How far off the continuation of the ground a point of the ground may be, by blocks.

    Ground is dense about its continuation, and plants and roofs are not. So from the least step on
    each is allowed as long as more points lie within it than from there to twice as far above.
    Where they are little more, part of it is allowed, so that no single point far away decides.

    Returns
    -------
    array of shape (rows / BLOCK, cols / BLOCK), metres; 0 where not even the least is allowed

    Examples
    --------
    >>> off = np.full((32, 32), np.inf, np.float32)
    >>> off[::4], off[2::4] = 0.1, 0.8  # as many plants as points of the ground
    >>> learned(off)[0]
    array([0.3, 0.3])
    """
    allowed = np.zeros((len(off) // BLOCK, off.shape[1] // BLOCK))
    possible, last = np.ones(allowed.shape), 0.0
    for step in STEPS:
        within = window_sums(np.abs(off) <= step, BLOCK, AROUND)
        beyond = window_sums((off > step) & (off <= 2 * step), BLOCK, AROUND) + 1
        more = np.clip((within / (within + beyond) - MORE[0]) / (MORE[1] - MORE[0]), 0, 1)
        possible = np.minimum(possible, more)
        allowed += (step - last) * possible
        last = step
    return allowed
