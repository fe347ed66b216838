"""A wire between two places, as it hangs.

References
----------
A wire of constant weight under horizontal tension hangs as z = a + c (cosh((u - b) / c) - 1):
u runs horizontally from its first end, c is tension over weight, b and a locate the lowest point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from algorithms.samples._survey import EAST, NORTH, Floats


@dataclass(frozen=True)
class Catenary:
    """One wire of one span, in scene coordinates."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    c: float

    @property
    def span(self) -> float:
        """Horizontal length."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))

    @property
    def b(self) -> float:
        """Horizontal distance of the lowest point of the catenary from the start."""
        rise = self.end[2] - self.start[2]
        half = 2 * self.c * np.sinh(self.span / (2 * self.c))
        return float(self.span / 2 - self.c * np.arcsinh(rise / half))

    @property
    def a(self) -> float:
        """Height of the lowest point of the catenary, which may lie beyond an end."""
        return float(self.start[2] - self.c * (np.cosh(self.b / self.c) - 1))

    @property
    def length(self) -> float:
        """Length of the wire."""
        c, b = self.c, self.b
        return float(c * (np.sinh((self.span - b) / c) + np.sinh(b / c)))

    @property
    def sag(self) -> float:
        """Greatest vertical distance below the chord."""
        rise = (self.end[2] - self.start[2]) / self.span
        u = self.b + self.c * np.arcsinh(rise)
        wire = self.a + self.c * (np.cosh((u - self.b) / self.c) - 1)
        return float(self.start[2] + rise * u - wire)

    def points(self, step: float) -> Floats:
        """Positions along the wire at about `step` metres, array of shape (n, 3)."""
        share = np.linspace(0, 1, max(2, int(np.ceil(self.span / step)) + 1))
        xy = np.outer(1 - share, self.start[:2]) + np.outer(share, self.end[:2])
        z = self.a + self.c * (np.cosh((share * self.span - self.b) / self.c) - 1)
        return np.column_stack([xy, z])


def placed(points: Floats) -> shapely.LineString:
    """Scene coordinates of shape (n, 3) as a line in projected coordinates."""
    return shapely.LineString(np.round(points + np.array([EAST, NORTH, 0.0]), 4))
