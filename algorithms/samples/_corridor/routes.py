"""Where a line runs in plan: straight legs, along which everything is placed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely

from algorithms.samples._survey import Floats

Range = tuple[float, float]
"""Lowest and highest value between which the seed chooses."""


def drawn(rng: np.random.Generator, limits: Range) -> float:
    """A value between two limits."""
    return float(rng.uniform(*limits))


@dataclass(frozen=True)
class Route:
    """Straight legs between vertices; chainages run along them, offsets to their left.

    The first and the last leg go on beyond the ends.

    Attributes
    ----------
    vertices : array of shape (n, 2), metres
    """

    vertices: Floats

    @property
    def corners(self) -> Floats:
        """Chainages of the vertices."""
        steps = np.hypot(*np.diff(self.vertices, axis=0).T)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length(self) -> float:
        return float(self.corners[-1])

    @property
    def line(self) -> shapely.LineString:
        return shapely.LineString(self.vertices)

    def heading(self, chainage: float) -> Floats:
        """Unit vector along the leg at a chainage; of the leg that begins there at a vertex."""
        leg = int(np.searchsorted(self.corners[1:-1], chainage, side="right"))
        step = self.vertices[leg + 1] - self.vertices[leg]
        return np.asarray(step / np.hypot(*step))

    def left(self, chainage: float) -> Floats:
        """Unit vector to the left; on the bisector of the legs at a vertex."""
        both = self.heading(chainage - 1e-6) + self.heading(chainage + 1e-6)
        return np.asarray(np.array([-both[1], both[0]]) / np.hypot(*both))

    def place(self, chainage: float, offset: float = 0.0) -> Floats:
        """Position of a chainage, moved to the left."""
        leg = int(np.searchsorted(self.corners[1:-1], chainage, side="right"))
        along = chainage - self.corners[leg]
        here = self.vertices[leg] + along * self.heading(chainage)
        return np.asarray(here + offset * self.left(chainage))

    def beside(self, offset: float) -> Route:
        """A route at a constant distance to the left."""
        moved = []
        for vertex, chainage in zip(self.vertices, self.corners, strict=True):
            left = self.left(chainage)
            ahead = self.heading(chainage)
            cosine = float(left @ np.array([-ahead[1], ahead[0]]))
            moved.append(vertex + left * offset / cosine)
        return Route(np.array(moved))

    def moved(self, step: Floats) -> Route:
        return replace(self, vertices=self.vertices + step)

    def area(self, half: float) -> shapely.Polygon:
        """What lies within a distance of the legs, cut off square at the ends."""
        return self.line.buffer(half, cap_style="flat", join_style="mitre")


def winding(rng: np.random.Generator, length: float, legs: int, bends: Range) -> Route:
    """A route of a length in any direction; its bends, in degrees, go either way."""
    heading = float(rng.uniform(0, 360))
    parts = rng.uniform(0.7, 1.3, legs)
    vertices = [np.zeros(2)]
    for number, part in enumerate(parts / parts.sum() * length):
        if number:
            heading += float(rng.choice((-1, 1))) * drawn(rng, bends)
        turn = np.radians(heading)
        vertices.append(vertices[-1] + part * np.array([np.cos(turn), np.sin(turn)]))
    return Route(np.array(vertices))


def straight(middle: Floats, heading: float, length: float) -> Route:
    """A route of one leg through a place; `heading` in radians."""
    half = 0.5 * length * np.array([np.cos(heading), np.sin(heading)])
    return Route(np.array([middle - half, middle + half]))
