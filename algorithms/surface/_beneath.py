"""Where water goes on without being seen: below bridges and sluices, beside the water found.

Of the ground there a few points are known at best, which may be on the water, and a terrain that
spans them lies below the water beside it. Nothing else tells such places from land that is lower,
as that behind a dike or below a dam, of which points are as many as of other ground.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from algorithms.shared.water_surface import Surface

SPARSE = 0.5  # of the cells with ground on land: as few are water where pulses are lost
REACH = 2  # cells on each side that are looked at together: single ones are empty by chance
EIGHT = np.ones((3, 3), bool)

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


class Wet(NamedTuple):
    """A water with its surface, the scatter of returns from it, and its cells."""

    at: Surface
    scatter: float
    rows: Ints
    cols: Ints


class Beneath(NamedTuple):
    """Cells on which water goes on, with its level on each, and the scatter of returns from it."""

    rows: Ints
    cols: Ints
    level: Array
    scatter: float


def unseen(count: Array, wet: Mask) -> Mask:
    """Cells around which, but for water, less than half as many hold ground as on land.

    Parameters
    ----------
    count : points of the ground in each cell, shape (rows, cols)
    wet : cells of water
    """
    there = (np.nan_to_num(count) > 0) & ~wet
    found, dry = (
        ndimage.uniform_filter(some.astype(np.float32), 2 * REACH + 1, mode="constant")
        for some in (there, ~wet)
    )
    around = found / np.maximum(dry, 1e-9)
    few = around < SPARSE * (np.median(around[there]) if there.any() else 0.0)
    beside = ndimage.binary_dilation(few, EIGHT, REACH)  # land is among the cells around these
    return np.asarray(few | (beside & ~there))


def beneath(
    heights: Array, few: Mask, waters: Sequence[Wet], axes: tuple[Array, Array]
) -> Iterator[Beneath]:
    """Places that waters are joined to over lower cells, of which ground is not seen.

    Where several waters are joined to one place, as on both sides of a sluice, its level is the
    lowest of theirs.

    Parameters
    ----------
    heights : of the terrain, shape (rows, cols), NaN where not known
    few : cells of which ground is not seen
    axes : of the centres of the cells, eastwards and northwards
    """
    east, north = axes
    wet = np.zeros(heights.shape, bool)
    for water in waters:
        wet[water.rows, water.cols] = True
    free, _ = ndimage.label(few & ~wet & np.isfinite(heights), EIGHT)
    boxes = ndimage.find_objects(free)
    joined = np.zeros(heights.shape, bool)
    reached: list[tuple[Wet, tuple[Ints, Ints]]] = []
    for water in waters:
        edge = _with_edge(water, heights.shape)
        of_edge = free[edge]
        for number in np.unique(of_edge[of_edge > 0]):
            box = boxes[number - 1]
            level = water.at(east[box[1]][None, :], north[box[0]][:, None])
            lower = (free[box] == number) & (heights[box] < level)
            start = np.zeros(lower.shape, bool)
            start[
                tuple(k[of_edge == number] - side.start for k, side in zip(edge, box, strict=True))
            ] = True
            some = ndimage.binary_propagation(start & lower, EIGHT, lower)
            joined[box] |= some
            rows, cols = np.nonzero(some)
            reached.append((water, (rows + box[0].start, cols + box[1].start)))
    places, _ = ndimage.label(joined, EIGHT)
    for number, box in enumerate(ndimage.find_objects(places), 1):
        rows, cols = np.nonzero(places[box] == number)
        rows, cols = rows + box[0].start, cols + box[1].start
        beside = [water for water, at in reached if (places[at] == number).any()]
        levels = np.array([water.at(east[cols], north[rows]) for water in beside])
        level, lowest = levels.min(axis=0), beside[int(levels.mean(axis=1).argmin())]
        yield Beneath(rows, cols, level, lowest.scatter)


def _with_edge(water: Wet, shape: tuple[int, ...]) -> tuple[Ints, Ints]:
    """Rows and columns of the cells of a water and of those beside it."""
    steps = [(south, east) for south in (-1, 0, 1) for east in (-1, 0, 1)]
    rows, cols = (
        np.concatenate([line + step[k] for step in steps])
        for k, line in enumerate((water.rows, water.cols))
    )
    inside = (rows >= 0) & (rows < shape[0]) & (cols >= 0) & (cols < shape[1])
    rows, cols = np.divmod(np.unique(rows[inside] * shape[1] + cols[inside]), shape[1])
    return rows, cols
