"""Which regions that look like roofs are crowns of conifers: their sides are planes, but steep.

On which data the limits were chosen, and how well they do on other: the page urban-classes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._evidence import FOOT, LET_THROUGH, PointFeatures
from algorithms.classify._roofs import STEEPEST

STEEP = 50.0  # degrees: sides of crowns are steeper, and most roofs flatter
SIDES = 0.25  # share of the points on planes, but for walls, that lie on such sides
TORN = 1 / 3  # share of all points that lie on no plane: on a spire or a steep roof few do
CLOSED = LET_THROUGH / 2  # share of pulses that go on after edges of a roof; more in trees
LOW = 0.25  # of the height of a region: what is lower is the foot of its walls
WALLS = 0.1  # share of the points that lie so low, though hardly a pulse went on: they are of walls

Mask = NDArray[np.bool_]


def crowns(shapes: NDArray[Any], features: PointFeatures, planes: Mask) -> Mask:
    """True for regions that are crowns, array of shape (m,).

    What has walls is none, though it is steep and torn as a gatehouse with spires is: pulses reach
    the foot of a crown through it, and that of a wall beside it, so that none went on.

    Parameters
    ----------
    shapes : array of shape (m,), polygons
    features : n points
    planes : array of shape (n,), those that look like a roof and lie on planes
    """
    above = features.terrain[1] > FOOT
    least, wall = np.cos(np.radians(STEEP)), np.cos(STEEPEST)
    found = []
    for shape in shapes:
        inside = features.within(shape, above)
        upright = abs(features.planes[1][inside[planes[inside]], 2])
        upright = upright[upright >= wall]
        sides = np.mean(upright < least) if len(upright) else 0.0
        steep = sides >= SIDES and 1 - planes[inside].mean() >= TORN
        found.append(steep and not has_walls(features, inside))
    return np.asarray(found, bool)


def has_walls(features: PointFeatures, inside: NDArray[np.int64]) -> bool:
    """Whether points of a region reach down to its foot, though hardly a pulse went on.

    Parameters
    ----------
    inside : indices of its points, of which there is one
    """
    if not features.has_several_returns:
        return False
    height = features.terrain[1][inside]
    low = np.mean(height <= LOW * height.max())
    return bool(low >= WALLS and features.let_through[inside].mean() <= CLOSED)
