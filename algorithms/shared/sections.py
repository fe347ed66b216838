"""Sections of a raster of heights that are bounded by steps down: roofs, also wide and low ones.

A roof is one section without steps, or several with steps between them, as a saw-tooth roof and one
with skylights. It ends in steps down all around.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, find_objects, label

from algorithms.shared.kernels import sections as kernels
from toolbox.context import log
from toolbox.data import Lattice

# Metres by which heights differ at most from cell to cell: roofs as steep as 1 in 3, and no hedge.
LEVEL = 0.3
DROP = 1.0  # metres of a step down, beyond the slope: more than plants, kerbs and low walls
# Shares of the seen and of the whole border that are steps: trees and higher parts of a building
# stand on some sides of a roof, and the end of the data hides two of four where it cuts a corner.
ALL_ROUND, MOST_ROUND = 0.7, 0.4
ACROSS, GAPS = 0.1, 2  # what may lie opposite at the end of the data: a share of that, and cells
SMALLEST = 10  # cells of a section: what is smaller falls off for all other looks
WIDE, STOREY = 1000, 3.0  # cells; metres: a wide roof stands so high, parcels and quays 2 m
WIDEST = 140  # cells from end to end, if nothing else is said: the surroundings of a tile hold it
CUT = 0.25  # share of the widest square that the end of the data cuts: more may be a terrace
LOOKED_AT = 500  # cells from end to end of a section that is told of: longer ones are land

Cells = NDArray[np.float32]
Mask = NDArray[np.bool_]
Sides = NDArray[np.int32]


def raised_sections(z: Cells, slope: float, widest: float = WIDEST) -> tuple[Mask, Cells]:
    """Cells of sections that are bounded by steps down, and of those that are too wide for that.

    Nearly all of the border of a roof that is seen is a step down; of terraces some of it leads on
    or up. What leads to edges of the data on opposite sides, as a quay or a causeway does, is no
    roof. A part of a roof below another, which is raised, ends beyond that. Those that are wider
    than buildings, and wide ones that the end of the data cuts, may be roofs or not.

    Sections are looked for twice: with cells of about one height, which hedges and cars do not join
    to the ground, and with all between which there is no step, as roofs of several heights.

    Parameters
    ----------
    z : array of shape (rows, cols), heights of cells of a metre, in metres, NaN without data
    slope : height per distance up to which cells are no step
    widest : cells from end to end of a roof, along rows or columns

    Returns
    -------
    arrays of shape (rows, cols): true in sections that are raised; and in those that are too wide
    for it the cells of `widest` that would take them for raised, 0 elsewhere

    Examples
    --------
    >>> z = np.zeros((40, 40), np.float32)
    >>> z[10:30, 10:30] = 5.0
    >>> raised, wide = raised_sections(z, 0.8)
    >>> int(raised.sum()), bool(wide.any())
    (400, False)
    """
    raised, needed = np.zeros(z.shape, bool), np.zeros(z.shape, np.float32)
    for rise in (LEVEL, slope + DROP):
        found, too_wide = _bounded_by_steps(z, rise, slope, widest)
        raised |= found
        needed = np.maximum(needed, too_wide)
    return raised, np.where(raised, np.float32(0), needed)


def _bounded_by_steps(z: Cells, rise: float, slope: float, widest: float) -> tuple[Mask, Cells]:
    """Cells of sections that are raised, and how wide roofs must be for too wide ones to be so.

    A section is cells beside each other whose heights differ by at most `rise`.
    """
    parent = np.empty(z.size, np.int32)  # of each cell the first one of its section
    kernels.sections(z, rise, parent)
    there = parent >= 0
    size = np.bincount(parent[there], minlength=z.size)
    first = np.flatnonzero(size >= SMALLEST)  # of each section that is asked
    number = np.full(z.size, -1, np.int32)
    number[first] = np.arange(len(first))
    places = find_objects(np.where(there, number[parent] + 1, 0).reshape(z.shape))
    extent = np.array([max(r.stop - r.start, c.stop - c.start) for r, c in places])
    number[first[extent > LOOKED_AT]] = -1
    raised, sides = np.zeros(z.size, bool), np.empty((len(first), 8), np.int32)
    depth, needed = np.empty(len(first)), np.zeros(z.size, np.float32)
    for wide in (False, True):  # and then what would follow from those that are too wide
        found, sure = np.ones(1, bool), raised.copy()
        while found.any():
            kernels.borders(z, parent, number, raised, slope, DROP, sides, depth)
            cut = sides[:, 4:].sum(axis=1) > GAPS
            must = np.maximum(extent, np.where(cut, np.sqrt(size[first] / CUT), 0))
            low = (size[first] > WIDE) & (depth < STOREY * sides[:, 2])
            found = falls_off(sides) & ~low & (wide | (must <= widest))
            raised[first[found]] = True
            number[first[found]] = -1
            needed[first[found]] = np.ceil(must[found])
    needed[sure] = 0
    owner, there = parent.reshape(z.shape), there.reshape(z.shape)
    return there & sure[owner], np.where(there, needed[owner], 0)


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


def tell_of_wide(needed: Cells, lattice: Lattice, widest: float = WIDEST) -> None:
    """Warn of ground in sections that end in steps down, and are too wide to be called raised.

    Parameters
    ----------
    needed : array of shape (rows, cols), the metres that roofs must be wide where such ground is,
        see :func:`raised_sections`, 0 elsewhere
    lattice : of the cells
    widest : metres from end to end of what was looked for

    Examples
    --------
    >>> tell_of_wide(np.zeros((40, 40), np.float32), Lattice(0.0, 40.0, 1.0, 40, 40))
    """
    if not needed.any():
        return
    # Over empty cells, too.
    places = binary_closing(np.pad(needed > 0, 2), np.ones((5, 5), bool))[2:-2, 2:-2]
    number, count = label(places)
    size = np.bincount(number[places])[1:]
    spots = np.argwhere(number == size.argmax() + 1)
    row, col = spots[np.hypot(*(spots - spots.mean(axis=0)).T).argmin()]
    log.warning(
        "places that end in steps down on all sides that are seen, but are wider than %d m or cut "
        "by the end of the data, are taken for ground: %d, the largest of about %d m2 at %.0f, "
        "%.0f. They are halls or terraces. With a longest_building of %d m none of these is "
        "ground, and it may be %d at most; in tiles more may be needed",
        widest,
        count,
        size.max(),
        lattice.west + (col + 0.5) * lattice.cell,
        lattice.north - (row + 0.5) * lattice.cell,
        needed.max(),
        LOOKED_AT,
    )
