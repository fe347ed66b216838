"""Rivers of pools and rapids: waters whose surface is neither one level nor one plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from algorithms.shared.otsu import otsu_threshold
from algorithms.shoreline._bodies import WEIR
from algorithms.shoreline._cells import LEVEL, CellGrid, around, connected, fit, window
from algorithms.shoreline._evidence import COMPACT, SPARSE, Body, core_of, smoothed
from algorithms.shoreline._level import BLOCKS, FEW

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.int64]
ENDS = 10, 90  # per cent: between them the heights of a surface differ by what it falls


def reaches(cells: CellGrid, body: Body, least: int, most: float) -> list[Body]:
    """The upper and lower parts of a water whose surface is no plane.

    A river falls from its upper to its lower end, so what is higher than some height is in few
    large pieces, and what is lower, too. Waves, banks and plants do not lie so. Heights are means
    over a share of the whole water, which no handful of points moves.

    Parameters
    ----------
    cells : see :class:`CellGrid`
    body : a water that returns pulses
    least : cells of a part
    most : by which the heights may differ from a plane, in the unit of the data

    Returns
    -------
    list of Body
        The body itself if its surface is a plane, level or not.
    """
    core = core_of(cells, body.cells)
    core = core[np.isfinite(cells.middle.ravel()[core])]
    if len(core) < 2 * least:
        return [body]
    heights = smoothed(cells, core, cells.middle.ravel()[core])
    if _from_plane(cells, core, heights) <= most:
        return [body]
    upper = heights >= otsu_threshold(heights)
    if _stands_above(cells, core, heights, upper):
        return [body]
    parts = [
        some for part in (upper, ~upper) for some in connected(cells.lattice, core[part], least)
    ]
    if sum(len(part) for part in parts) < COMPACT * len(core):
        return [body]
    return [_reach(cells, body, part) for part in _nearest(cells, body.cells, parts)]


def along_banks(cells: CellGrid, some: Ints) -> Floats:
    """How high the surface of a long water may be at its cells, by its banks.

    Its banks are cut along it into pieces with equally many cells. The lowest of a piece is at the
    water at the lower end of the piece, or above it at walls, at cliffs and below crowns. But water
    does not rise on its way: it is nowhere above the lowest of the banks upstream.

    Returns
    -------
    array of shape (n,)
        Heights that are counted from `cells.base`; NaN if there are too few banks.
    """
    cols, low = cells.lattice.cols, cells.low.ravel()
    banks = np.union1d(some, around(cells.lattice, some, 1))
    banks = banks[np.isfinite(low[banks])]
    if len(banks) < BLOCKS:
        return np.full(len(some), np.nan)
    spots, beside = (np.column_stack([c // cols, c % cols]).astype(float) for c in (some, banks))
    axis = np.linalg.eigh(np.cov(spots.T))[1][:, 1]
    along = beside @ axis
    pieces = np.array_split(np.argsort(along, kind="stable"), BLOCKS)
    lows = np.array([np.quantile(low[banks[piece]], FEW) for piece in pieces])
    downwards = 1 if lows[: BLOCKS // 2].min() >= lows[BLOCKS // 2 :].min() else -1
    surface = np.minimum.accumulate(lows[::downwards])[::downwards]
    lower_ends = [along[piece[-1 if downwards > 0 else 0]] for piece in pieces]
    return np.asarray(np.interp(spots @ axis, lower_ends, surface))


def _stands_above(cells: CellGrid, core: Ints, heights: Floats, upper: NDArray[np.bool_]) -> bool:
    """Whether what is much higher is no water but a pier or boats: few of its cells have points.

    The others are amid a hole, and only near such points. Still pools above rapids return few, too,
    but are not so high.
    """
    filled = cells.count.ravel()[core] > 0
    sparse = filled[upper].mean() < SPARSE * filled[~upper].mean()
    rise = np.median(heights[upper]) - np.median(heights[~upper])
    return bool(sparse and rise > WEIR * cells.metre)


def _from_plane(cells: CellGrid, core: Ints, heights: Floats) -> float:
    """By how much heights at cells differ from a plane."""
    level, tilt = fit(cells, core, heights)
    off = heights - level - tilt.at(core // cells.lattice.cols, core % cells.lattice.cols)
    return float(np.ptp(np.percentile(off, ENDS)))


def _nearest(cells: CellGrid, every: Ints, parts: Sequence[Ints]) -> list[Ints]:
    """All cells of a water, with the part that each is nearest to."""
    (top, left), wet = window(cells.lattice, every, 0)
    label = np.zeros(wet.shape, np.int32)
    for number, part in enumerate(parts, 1):
        label[part // cells.lattice.cols - top, part % cells.lattice.cols - left] = number
    near = ndimage.distance_transform_edt(label == 0, return_distances=False, return_indices=True)
    of = label[tuple(near)][every // cells.lattice.cols - top, every % cells.lattice.cols - left]
    return [every[of == number] for number in range(1, len(parts) + 1)]


def _reach(cells: CellGrid, body: Body, part: Ints) -> Body:
    """A part of a body as a body, at the median of its own heights."""
    heights = cells.middle.ravel()[part]
    level = float(np.nanmedian(heights)) + cells.base
    return replace(body, cells=part, level=level, tilt=LEVEL, waves=np.inf)
