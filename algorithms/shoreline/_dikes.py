"""Waters that are one in cells, but have a dike between: it is narrower than cells are wide."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from algorithms.shoreline._cells import CellGrid, window
from algorithms.shoreline._evidence import SIGMAS, STEP, Body
from algorithms.shoreline._level import NINETY_FIVE

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.int64]


def apart(cells: CellGrid, body: Body, least: int, highest: float = -np.inf) -> list[Body]:
    """The parts of a body that rows of cells with points above its waves part from one another.

    Parameters
    ----------
    cells : see :class:`CellGrid`
    body : a water as it was filled
    least : cells of a part; smaller ones go to the part next to them, as do the rows between
    highest : of two levels side by side, above which a dike is; the step between them is none

    Returns
    -------
    list of Body
        The body itself if nothing parts it.
    """
    (top, left), wet = window(cells.lattice, body.cells, 1)
    here = np.s_[top : top + wet.shape[0], left : left + wet.shape[1]]
    with np.errstate(invalid="ignore"):
        above = cells.high[here] - np.maximum(cells.middle[here], highest - cells.base)
        dry = above > max(_crest(above[wet]), STEP * cells.metre)
    label, _ = ndimage.label(wet & ~dry)
    sizes = np.bincount(label.ravel())
    large = np.flatnonzero(sizes >= least)
    large = large[large > 0]
    if len(large) < 2:
        return [body]
    label[~np.isin(label, large)] = 0
    near = ndimage.distance_transform_edt(label == 0, return_distances=False, return_indices=True)
    label = np.where(wet, label[tuple(near)], 0)
    parts = []
    for number in large:
        r, c = np.nonzero(label == number)
        parts.append(replace(body, cells=(r + top) * cells.lattice.cols + c + left))
    return parts


def _crest(above: Floats) -> float:
    """How far waves and noise reach, from the highest points of cells above their surroundings.

    All but one of 40 cells of water are lower, by the median and the span between 20 and 80 % of
    all: dikes, and what stands in water, are fewer. So few cells make no row across a water.
    """
    known = above[np.isfinite(above)]
    if not len(known):  # nothing came back
        return 0.0
    low, middle, high = np.percentile(known, (20, 50, 80))
    return float(middle + NINETY_FIVE * (high - low) / SIGMAS)
