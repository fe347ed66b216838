"""Sections of a raster of heights that are bounded by steps down: roofs, also wide and low ones.

A roof is one section without steps, or several with steps between them, as a saw-tooth roof and one
with skylights. It ends in steps down all around.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label, maximum_filter

from algorithms.shared.kernels import sections as kernels
from toolbox.context import log
from toolbox.data import Lattice

LEVEL = 0.3  # metres by which heights differ at most from cell to cell of a section
DROP = 1.0  # metres of a step down, beyond the slope
ALL_ROUND, MOST_ROUND = 0.7, 0.4  # share of the seen and of the whole border that are steps
ACROSS, GAPS = 0.1, 2  # share of what lies at the end of the data, and cells, that may be opposite
SMALLEST = 10  # cells of a section
LOOKED_AT = 500  # cells from end to end of a section that may be a hall, and is told of
WIDEST = 140  # cells from end to end: the halo of a tile holds it, and 100 m more
LARGEST_CUT = 5000  # cells of a section that the end of the data cuts: more may be a terrace

Cells = NDArray[np.float32]
Mask = NDArray[np.bool_]
Sides = NDArray[np.int32]


def raised_sections(z: Cells, slope: float, lattice: Lattice) -> Mask:
    """True for cells of sections that are bounded by steps down.

    Nearly all of the border of a roof that is seen is a step down; of terraces some of it leads on
    or up. What leads to edges of the data on opposite sides, as a quay or a causeway does, is no
    roof. A part of a roof below another, which is raised, ends beyond that. Those that are too wide
    for a tile, and wide ones that the end of the data cuts, are no roofs either, which is told.

    Sections are looked for twice: with cells of about one height, which hedges and cars do not join
    to the ground, and with all between which there is no step, as roofs of several heights.

    Parameters
    ----------
    z : array of shape (rows, cols), heights of cells of a metre, in metres, NaN without data
    slope : height per distance up to which cells are no step
    lattice : of the cells

    Returns
    -------
    array of shape (rows, cols)

    Examples
    --------
    >>> z = np.zeros((40, 40), np.float32)
    >>> z[10:30, 10:30] = 5.0
    >>> int(raised_sections(z, 0.8, Lattice(0.0, 40.0, 1.0, 40, 40)).sum())
    400
    """
    raised, told = np.zeros(z.shape, bool), np.zeros(z.shape, bool)
    for rise in (LEVEL, slope + DROP):
        found, unsure = _bounded_by_steps(z, rise, slope)
        raised |= found
        told |= unsure
    _tell_of(told & ~raised, lattice)
    return raised


def _bounded_by_steps(z: Cells, rise: float, slope: float) -> tuple[Mask, Mask]:
    """Cells of raised sections, and of those that are so wide that they are not called raised.

    A section is cells beside each other whose heights differ by at most `rise`.
    """
    parent = np.empty(z.size, np.int32)
    kernels.sections(z, rise, parent)
    there = parent >= 0
    size = np.bincount(parent[there], minlength=z.size)
    first = np.flatnonzero(size >= SMALLEST)
    number = np.full(z.size, -1, np.int32)
    number[first] = np.arange(len(first))
    box = np.empty((len(first), 4), np.int32)
    kernels.boxes(parent, z.shape[1], number, box)
    extent = (box[:, 2:] - box[:, :2]).max(axis=1, initial=0) + 1
    number[first[extent > LOOKED_AT]] = -1
    raised, sides = np.zeros(z.size, bool), np.empty((len(first), 8), np.int32)
    found = np.ones(1, bool)
    while found.any():
        kernels.borders(z, parent, number, raised, slope, DROP, sides)
        cut = (sides[:, 4:].sum(axis=1) > GAPS) & (size[first] > LARGEST_CUT)
        bounded = falls_off(sides)
        found = bounded & (extent <= WIDEST) & ~cut
        raised[first[found]] = True
        number[first[found]] = -1
    unsure = np.zeros(z.size, bool)
    unsure[first[bounded]] = True
    owner, there = parent.reshape(z.shape), there.reshape(z.shape)
    return there & raised[owner], there & unsure[owner]


def falls_off(sides: Sides) -> Mask:
    """Which sections are bounded by steps down, by the sides of their borders.

    Parameters
    ----------
    sides : array of shape (sections, 8), see :func:`kernels.borders`

    Examples
    --------
    >>> falls_off(np.array([[80, 80, 80, 0, 0, 0, 0, 0], [80, 80, 40, 0, 0, 0, 0, 0]], np.int32))
    array([ True, False])
    """
    border, seen, falls, carried = sides[:, :4].T
    south, north, east, west = sides[:, 4:].T
    opposite = np.minimum(south, north) + np.minimum(east, west)
    unseen = south + north + east + west
    carried = np.where(unseen <= GAPS, carried, 0)  # or the end of the data makes roofs of terraces
    return np.asarray(
        (falls > 0)
        & (falls >= ALL_ROUND * (seen - carried))
        & (falls >= MOST_ROUND * (border - carried))
        & (opposite <= np.maximum(GAPS, ACROSS * unseen))
    )


def _tell_of(cells: Mask, lattice: Lattice) -> None:
    """Warn of sections that end in steps down, but are taken for ground."""
    if not cells.any():
        return
    number, count = label(maximum_filter(cells, 3))  # cells without data part no place
    size = np.bincount(number[cells])[1:]
    row, col = np.argwhere(number == size.argmax() + 1).mean(axis=0)
    log.warning(
        "places that end in steps down on all sides that are seen, but are wider than %d m or cut "
        "by the end of the data, are taken for ground: %d, the largest of about %d m2 at %.0f, "
        "%.0f. They are halls or terraces; give points of halls a class that takes no part",
        WIDEST,
        count,
        size.max(),
        lattice.west + (col + 0.5) * lattice.cell,
        lattice.north - (row + 0.5) * lattice.cell,
    )
