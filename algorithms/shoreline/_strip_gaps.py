"""Gaps between strips that water runs into: nobody knows what is there, and it is not water.

A gap returns nothing, as water does, so that what is found of a river goes on in each gap that
crosses it. But beside a gap there is no shore: on both sides the ground is far above the water.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.special import betaincinv

from algorithms.shoreline._bodies import SURE_CELLS
from algorithms.shoreline._cells import BLOCK, REACH, CellGrid, around, connected, window
from algorithms.shoreline._evidence import LARGE, WALL, core_of
from algorithms.shoreline._level import even_blocks
from algorithms.shoreline._surfaces import Water

MOUTH = 1 / 3  # of the rim of a gap that is water at most: an arm has land along both of its sides
ASIDE = 0.5  # share of the water that lies beside the line of a gap at least, which crosses it
SEEN = 0.5  # share of cells with points beyond an end at most: strips bend, docks end on land
UNFLOWN = 0.5  # share of the middle of a gap at least that no flight covers: cells are coarse
ALONG = 10, 90  # per cent of the heights of the ground along a gap
UNEVEN = 2.0  # m that these differ by at least: twice what a wall is high
ROW = 0.25  # length of a row of cells along a gap at least, in that of the longest
SURE = 0.05  # chance that water returns as little by itself

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


class _Line(NamedTuple):
    """The line of a gap: rows of cells along it.

    Attributes
    ----------
    centre, along, across : in rows and columns of cells
    ends, sides : least and greatest distance of its cells from the centre, along and across
    """

    centre: Floats
    along: Floats
    across: Floats
    ends: tuple[float, float]
    sides: tuple[float, float]

    @classmethod
    def of(cls, cells: CellGrid, some: Ints) -> _Line:
        spots = _spots(cells, some).astype(float)
        centre = spots.mean(axis=0)
        across, along = np.linalg.eigh(np.cov(spots.T))[1].T
        t, s = (spots - centre) @ along, (spots - centre) @ across
        return cls(centre, along, across, (t.min(), t.max()), (s.min(), s.max()))

    @property
    def wide(self) -> float:
        """Width of the gap, in cells."""
        return self.sides[1] - self.sides[0]

    def row(self, cells: CellGrid, some: Ints) -> Ints:
        """Number of the row along the gap in which each of some cells lies."""
        away = _spots(cells, some) - self.centre
        return np.asarray(np.round(away @ self.across), np.int64)

    def holds(self, cells: CellGrid, some: Ints) -> Mask:
        """Which cells lie in the rows of the gap, however far along."""
        row, (first, last) = self.row(cells, some), np.round(self.sides)
        return np.asarray((row >= first) & (row <= last))

    def beyond(self, cells: CellGrid) -> Iterator[Ints]:
        """Cells in the middle half of its rows, beyond each end as far as the gap is wide."""
        (first, last), (left, right), wide = self.ends, self.sides, self.wide
        s = np.arange(left + wide / 4, right - wide / 4 + 1)
        for t in (np.arange(first - wide, first), np.arange(last + 1, last + wide + 1)):
            spots = self.centre + t[:, None, None] * self.along + s[:, None] * self.across
            r, c = np.round(spots).astype(np.int64).reshape(-1, 2).T
            rows, cols = cells.lattice.shape
            there = (r >= 0) & (r < rows) & (c >= 0) & (c < cols)
            yield r[there] * cols + c[there]


def _spots(cells: CellGrid, some: Ints) -> Ints:
    """Rows and columns of cells, shape (n, 2)."""
    return np.column_stack(np.divmod(some, cells.lattice.cols))


def strip_gaps(cells: CellGrid, found: Sequence[Water]) -> list[Ints]:
    """Cells of each gap between strips that counts as a part of some water.

    Such a part returned nothing and has 500 m2 or more, and all ground beside is more than 1 m
    above the water, along most of its rim. So has water between walls or below crowns. But a gap
    crosses the water, and goes on in its own line; and no flight covers it, or, where that is not
    known, it is too large to be without a return by chance, as the rest of the water has some.
    """
    least = max(LARGE * cells.metre**2 / cells.area, SURE_CELLS)
    gaps = []
    for water in found:
        some, rise = _rises(cells, water)
        hidden = some[rise > WALL * cells.metre]
        rest = np.setdiff1d(water.body.cells, hidden)
        for part in connected(cells.lattice, hidden, least):
            gap = _band(cells, part)
            beside = rise[np.isin(some, gap)]
            if _is_arm(cells, part, rest) and _is_gap(cells, gap, rest, beside):
                gaps.append(gap)
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


def _is_gap(cells: CellGrid, gap: Ints, rest: Ints, rise: Floats) -> bool:
    """Whether a part crosses the water and no flight covers it, or, if unknown, it returned less.

    Flights cover blocks of cells, so it must be as wide as two of them for that to be known.

    Parameters
    ----------
    gap, rest : cells of the part, and of the rest of the water
    rise : of the ground beside the part above the water
    """
    line, core = _Line.of(cells, gap), core_of(cells, gap)
    if not len(core) or not _crosses(cells, line, rest):  # too narrow to tell
        return False
    if cells.strips > 1 and line.wide >= 2 * BLOCK:
        return bool(1 - cells.flown.ravel()[core].mean() >= UNFLOWN)
    return _is_uneven(rise, cells.metre) and _returns_less(cells, line, core, rest)


def _crosses(cells: CellGrid, line: _Line, rest: Ints) -> bool:
    """Whether most of the water lies beside the line of a gap, which goes on without points.

    A canal goes on in its own line as water, a dock or an arm of it ends on land.
    """
    if line.holds(cells, rest).mean() > 1 - ASIDE:
        return False
    count = cells.count.ravel()
    return all((count[some] > 0).sum() <= SEEN * len(some) for some in line.beyond(cells))


def _is_uneven(rise: Floats, metre: float) -> bool:
    """Whether the ground beside a gap is no wall, bank or weir, which follow the water."""
    low, high = np.percentile(rise, ALONG)
    return bool(high - low > UNEVEN * metre)


def _band(cells: CellGrid, part: Ints) -> Ints:
    """Cells of a part of a water in rows along it, but for short rows.

    Strips are straight, so that the rows of a gap are about as long as it is; those of reaches
    between high banks that it meets are as long as the water is wide.
    """
    row = _Line.of(cells, part).row(cells, part)
    length = np.bincount(row - row.min())
    return np.asarray(part[length[row - row.min()] >= ROW * length.max()])


def _returns_less(cells: CellGrid, line: _Line, core: Ints, rest: Ints) -> bool:
    """Whether a gap is larger than what water leaves empty by itself.

    The rest of the water is cut into blocks of about 500 m2 and the share of those without points
    counted. A gap of k blocks must have more of them than the rest has empty ones, as these may
    all lie together; and its chance, the share to the power of k, must be small, even if that
    share is as high as it may be (the upper limit of Clopper and Pearson, 1934, Biometrika 26(4),
    404-413). Banks always return: cells near the edge do not count, nor do those where the gap
    crosses the water.

    Parameters
    ----------
    line, core : of the gap, and its cells that are not near its edge
    rest : cells of the water
    """
    open_rest = np.intersect1d(core_of(cells, rest), rest)
    open_rest = open_rest[~line.holds(cells, open_rest)]
    most = int(len(open_rest) * cells.area / (LARGE * cells.metre**2))
    if not most:
        return False
    blocks = even_blocks(_spots(cells, open_rest).astype(float), most)
    empty = sum(not cells.count.ravel()[open_rest[block]].any() for block in blocks)
    k = len(core) * len(blocks) / len(open_rest)
    seen = len(blocks) - empty
    highest = float(betaincinv(empty + 1, seen, 1 - SURE)) if seen else 1.0
    return k > empty and highest**k < SURE
