"""Points sorted into squares, to find the points in many polygons quickly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels.sorting import firsts, stable
from algorithms.shared.kernels.squares import numbered
from algorithms.shared.polygons import Polygons

SIDE = 4.0  # metres, of a square: a car is in a few of them, and few points are beside it

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class SortedPoints:
    """Points sorted into squares, row by row, so that only those near a polygon are tested.

    Attributes
    ----------
    order : array of shape (n,), indices of the points, square by square
    number : array of shape (m,), numbers of the squares that hold points, rising
    start : array of shape (m + 1,), where in `order` each of them begins
    cols : how far the numbers of two rows are apart
    side : of a square, in the unit of the points
    corner : column and row of the first square, counted from the origin of the coordinates
    """

    order: Ints
    number: Ints
    start: Ints
    cols: int
    side: float
    corner: tuple[int, int]

    @classmethod
    def of(cls, xyz: Floats, metre: float) -> SortedPoints:
        """Sort points of shape (n, 3); `metre` is the length of one in their unit."""
        side = SIDE * metre
        square, cols = numbered(xyz, side, 0)
        order, square = stable(square)
        first = np.flatnonzero(firsts(square))
        corner = int(np.floor(xyz[:, 0].min() / side)), int(np.floor(xyz[:, 1].min() / side))
        return cls(order, square[first], np.append(first, len(order)), int(cols), side, corner)

    def within(self, shape: Any, xyz: Floats, some: NDArray[np.bool_] | None = None) -> Ints:
        """Indices of the points in a polygon, or of some of them, in rising order.

        Parameters
        ----------
        shape : shapely polygon
        xyz : all points, array of shape (n, 3)
        some : array of shape (n,), those that count; None for all
        """
        if shape.is_empty:
            return np.zeros(0, np.int64)
        ends = np.floor(np.array(shape.bounds) / self.side).astype(np.int64)
        west, south, east, north = ends - [*self.corner, *self.corner]
        rows = np.arange(max(south, 0), north + 1) * self.cols
        columns = max(west, 0), min(east + 1, self.cols)
        first, last = (self.start[np.searchsorted(self.number, rows + col)] for col in columns)
        runs = [self.order[a:b] for a, b in zip(first, last, strict=True)]
        near = np.concatenate([self.order[:0], *runs])
        near = near if some is None else near[some[near]]
        return np.sort(near[Polygons.of(np.array([shape])).hold(xyz.take(near, axis=0))])
