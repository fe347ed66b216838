"""Bands of windows: glass that is wider than an opening, with wall above and below it.

Their planes are as large as those of walls. Taken for wall, they would hide doors and windows whose
panes lie in their depth, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

SLIM = 0.5  # height over the largest width of an opening, at most: 2 m, as between breast and head
PARTS = 10  # of its width
ALONG = 0.8  # share of them above and below which wall stands before it
HOLED = 0.05  # share of the openings in a wall at least, as at the back of a gallery
SPARSE = 0.5  # points of glass over those of wall on the same area, at most
OTHER = 3.0  # standard deviations of the logarithm of intensity: a frieze is within, as the wall
INNER = (0.02, 0.98)  # quantiles of its points that its sides are taken from

Floats = NDArray[np.float64]


class Part(Protocol):
    """A plane of a front: depth, width and height, intensity, holes, and places of its points."""

    @property
    def depth(self) -> float: ...
    @property
    def size(self) -> Floats: ...
    @property
    def shade(self) -> float: ...
    @property
    def shade_spread(self) -> float: ...
    @property
    def holes(self) -> float: ...
    @property
    def apart(self) -> float: ...
    @property
    def some(self) -> Floats: ...


def is_slim(width: float, height: float, widest: float) -> bool:
    """Whether something too wide for an opening is as low as a band of windows.

    Parameters
    ----------
    widest : the largest width of an opening

    Examples
    --------
    >>> [is_slim(width, height, 4.0) for width, height in ((9, 1.5), (9, 2.5), (3, 1.5))]
    [True, False, False]
    """
    return width > widest and height <= SLIM * widest


def is_band(part: Part, others: Sequence[Part], step: float, recess: float, widest: float) -> bool:
    """Whether a plane as large as a wall is what is seen in a band of windows.

    Parameters
    ----------
    others : the large planes of the front
    step : least depth behind the wall
    recess : farthest that a frieze stands back
    widest : the largest width of an opening
    """
    if not is_slim(float(part.size[0]), float(part.size[1]), widest) or part.holes >= HOLED:
        return False
    before = [other for other in others if other.depth < part.depth - step]
    sides = [_beside(part, before, step, SLIM * widest, up) for up in (-1, 1)]
    if not all(len(side) for side in sides):
        return False
    wall = max(before, key=lambda other: float(other.size.prod()))
    back = part.depth - max(float(np.median(side)) for side in sides)
    sparse = (wall.apart / part.apart) ** 2 <= SPARSE
    bright = abs(part.shade - wall.shade) > OTHER * wall.shade_spread  # False if not known
    return bool(back > recess or sparse or bright)


def _beside(part: Part, others: Sequence[Part], step: float, reach: float, up: int) -> Floats:
    """Depths of wall above (1) or below (-1) a plane; none unless along most of it.

    A blind ends above the lower side of its band: wall is no farther away than a band is high.
    """
    low, high = np.quantile(part.some[:, :2], INNER, axis=0)
    places = np.vstack([np.zeros((0, 3)), *(other.some for other in others)])
    away = up * (places[:, 1] - (high if up > 0 else low)[1])
    near = places[(away > 0) & (away < reach) & (places[:, 0] >= low[0]) & (places[:, 0] < high[0])]
    near = near[near[:, 2] < part.depth - step]
    held = np.unique(np.floor((near[:, 0] - low[0]) / (high[0] - low[0]) * PARTS))
    return np.asarray(near[:, 2] if len(held) >= ALONG * PARTS else near[:0, 2])
