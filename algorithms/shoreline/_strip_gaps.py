"""Gaps between strips that water runs into: nobody knows what is there, and it is not water.

A gap returns nothing, as water does, so that what is found of a river goes on in each gap that
crosses it. But ground beside a gap has no shore: it is far above the water, on both sides, and it
is as likely as not to be where no flight has been.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.special import betaincinv

from algorithms.shoreline._bodies import SURE_CELLS
from algorithms.shoreline._cells import REACH, CellGrid, around, connected, window
from algorithms.shoreline._evidence import LARGE, WALL, core_of
from algorithms.shoreline._level import even_blocks
from algorithms.shoreline._surfaces import Water

MOUTH = 1 / 3  # of the rim of a gap that is water at most: an arm has land along both of its sides
UNFLOWN = 0.5  # share of the middle of a gap at least that no flight covers: cells are coarse
ALONG = 10, 90  # per cent of the heights of the ground along a gap
UNEVEN = 2.0  # m that these differ by at least: twice what a wall is high
ROW = 0.25  # length of a row of cells along a gap at least, in that of the longest
SURE = 0.05  # chance that water returns as little by itself

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def strip_gaps(cells: CellGrid, found: Sequence[Water]) -> list[Ints]:
    """Cells of each gap between strips that counts as a part of some water.

    Water between walls or below crowns is like that, too, but not all of these: a part that
    returned nothing, of 500 m2 or more, beside which all ground is more than 1 m above the water,
    with land along most of its rim; and either no flight covers it, or, where flights are not
    known, it is too large to be by chance without a return, as the rest of the water has some.
    """
    least = max(LARGE * cells.metre**2 / cells.area, SURE_CELLS)
    gaps = []
    for water in found:
        hidden = shoreless(cells, water)
        rest = np.setdiff1d(water.body.cells, hidden)
        for part in connected(cells.lattice, hidden, least):
            band = _band(cells, part)
            if _is_arm(cells, part, rest) and _is_not_flown(cells, water, band, rest):
                gaps.append(band)
    return gaps


def shoreless(cells: CellGrid, water: Water) -> Ints:
    """Cells of a water without points that are nearest to points far above its level."""
    some, rise = _rises(cells, water)
    return np.asarray(some[rise > WALL * cells.metre])


def _rises(cells: CellGrid, water: Water) -> tuple[Ints, Floats]:
    """Cells of a water without points, and by how much the nearest ground is above its level."""
    (top, left), wet = window(cells.lattice, water.body.cells, REACH)
    here = np.s_[top : top + wet.shape[0], left : left + wet.shape[1]]
    empty = cells.count[here] == 0
    unseen = empty | (ndimage.binary_fill_holes(wet) & ~wet)  # islands and boats are no bank
    near: Any = ndimage.distance_transform_edt(unseen, return_distances=False, return_indices=True)
    ground = ndimage.minimum_filter(cells.low[here], 2 * REACH + 1)[tuple(near)]
    r, c = np.nonzero(wet & empty)
    some = (r + top) * cells.lattice.cols + c + left
    return some, ground[r, c] + cells.base - water.level.at(cells.centres(some))


def _is_arm(cells: CellGrid, part: Ints, rest: Ints) -> bool:
    """Whether a part of a water has land along its sides, and the rest only at its mouth."""
    rim = around(cells.lattice, part, 1)
    return bool(np.isin(rim, rest).mean() <= MOUTH)


def _is_not_flown(cells: CellGrid, water: Water, part: Ints, rest: Ints) -> bool:
    """Whether no flight covers a part of a water; if flights are not known, by what they saw."""
    core = core_of(cells, part)
    if not len(core):  # too narrow to tell
        return False
    if cells.strips > 1:
        return bool(1 - cells.flown.ravel()[core].mean() >= UNFLOWN)
    return _is_uneven(cells, water, part) and _returns_less(cells, part, rest)


def _is_uneven(cells: CellGrid, water: Water, part: Ints) -> bool:
    """Whether the ground beside a part of a water is no wall, bank or weir, which follow water."""
    some, rise = _rises(cells, water)
    low, high = np.percentile(rise[np.isin(some, part)], ALONG)
    return bool(high - low > UNEVEN * cells.metre)


def _band(cells: CellGrid, part: Ints) -> Ints:
    """Cells of a gap in rows along it, but for short rows: those of reaches between high banks.

    Strips are straight, so that the rows of a gap are about as long as it is, while those of water
    which it meets are as long as that is wide.
    """
    row = _rows(cells, part, part)
    length = np.bincount(row - row.min())
    return np.asarray(part[length[row - row.min()] >= ROW * length.max()])


def _rows(cells: CellGrid, gap: Ints, some: Ints) -> Ints:
    """Number of the row along a gap in which each of some cells lies, shape (len(some),)."""
    spots, at = (np.column_stack(np.divmod(k, cells.lattice.cols)) for k in (gap, some))
    across = np.linalg.eigh(np.cov(spots.T))[1][:, 0]
    return np.asarray(np.round((at - spots.mean(axis=0)) @ across), np.int64)


def _returns_less(cells: CellGrid, part: Ints, rest: Ints) -> bool:
    """Whether a part without points is larger than water leaves empty by itself.

    The rest of the water is cut into blocks of about 500 m2 and the share of those without points
    counted. A part of k blocks must have more of them than the rest has empty ones, as these may
    all lie together; and its chance, the share to the power of k, must be small, even if that
    share is as high as it may be (the upper limit of Clopper and Pearson, 1934, Biometrika 26(4),
    404-413). Banks always return: cells near the edge do not count, nor do those where the gap
    crosses the water.
    """
    core, open_rest = core_of(cells, part), np.intersect1d(core_of(cells, rest), rest)
    row, in_line = _rows(cells, part, part), _rows(cells, part, open_rest)
    open_rest = open_rest[(in_line < row.min()) | (in_line > row.max())]
    spots = np.column_stack([open_rest // cells.lattice.cols, open_rest % cells.lattice.cols])
    most = int(len(open_rest) * cells.area / (LARGE * cells.metre**2))
    if not most:
        return False
    blocks = even_blocks(spots.astype(float), most)
    empty = sum(not cells.count.ravel()[open_rest[block]].any() for block in blocks)
    k = len(core) * len(blocks) / len(open_rest)
    seen = len(blocks) - empty
    highest = float(betaincinv(empty + 1, seen, 1 - SURE)) if seen else 1.0
    return k > empty and highest**k < SURE
