"""Points sorted from west to east, to find the points in many polygons quickly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._evidence import PointFeatures
from algorithms.shared.polygons import Polygons

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class SortedPoints:
    """Points sorted by x, so that only those in the x range of a polygon are tested.

    Attributes
    ----------
    xy : array of shape (m, 2), x rising
    index : array of shape (m,), of each among all points
    """

    xy: Floats
    index: Ints

    @classmethod
    def of(cls, features: PointFeatures, some: NDArray[np.bool_]) -> SortedPoints:
        """The chosen ones of n points, sorted by x."""
        index = features.eastward[some[features.eastward]]
        return cls(features.xyz.take(index, axis=0)[:, :2], index)

    def within(self, shape: Any) -> Ints:
        """Indices of the points in a polygon, in rising order."""
        west, south, east, north = shape.bounds
        first, last = np.searchsorted(self.xy[:, 0], (west, np.nextafter(east, np.inf)))
        y = self.xy[first:last, 1]
        near = first + np.flatnonzero((y >= south) & (y <= north))
        held = Polygons.of(np.array([shape])).hold(self.xy[near])
        return np.sort(self.index[near[held]])
