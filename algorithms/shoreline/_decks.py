"""Where outlines of water end at bridges and the like that the file names: water goes on below."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shoreline._cells import CellGrid, patches
from algorithms.shoreline._outline import Outline
from algorithms.shoreline._water import some_of

BESIDE = 2.0  # cells: an outline runs between points, and half a cell is lost on each side
LEAST = 10.0  # m2: what is smaller is a jetty, or single points

EIGHT = np.ones((3, 3), bool)


class Deck(NamedTuple):
    """A bridge or the like at which outlines end.

    Attributes
    ----------
    bodies : numbers of the waters
    area : in the unit of the data
    place : on it
    """

    bodies: list[int]
    area: float
    place: shapely.Point


def decks(xy: NDArray[np.float64], outlines: Sequence[Outline], cells: CellGrid) -> Iterator[Deck]:
    """What hides the ends of waters.

    Parameters
    ----------
    xy : points of them, shape (n, 2)
    outlines : of the waters
    cells : in which they were found
    """
    if not len(xy):
        return
    lattice = cells.lattice
    there = np.zeros(lattice.shape, bool)
    rows, cols = lattice.indices(*xy.T)
    inside = (rows >= 0) & (rows < lattice.rows) & (cols >= 0) & (cols < lattice.cols)
    there[rows[inside], cols[inside]] = True
    waters = {one.number: shapely.MultiPolygon(one.polygons) for one in outlines}
    half, reach = lattice.cell / 2, BESIDE * lattice.cell
    for some in patches(there, math.ceil(LEAST * cells.metre**2 / cells.area), EIGHT):
        x, y = cells.centres(some).T
        shape = shapely.union_all(shapely.box(x - half, y - half, x + half, y + half))
        if met := [k for k, water in waters.items() if water.distance(shape) <= reach]:
            yield Deck(met, shape.area, shape.representative_point())


def decks_in_words(found: Sequence[Deck], metre: float) -> str:
    """Text on bodies, size and place of each."""
    ordered = sorted(found, key=lambda one: -one.area)
    return some_of(
        [
            f"water body {' and '.join(map(str, one.bodies))} at {one.place.x:.1f},"
            f"{one.place.y:.1f} ({one.area / metre**2:.0f} m2)"
            for one in ordered
        ]
    )
