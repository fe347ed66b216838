"""Which regions that look like roofs are crowns of conifers: their sides are planes, but steep.

On which data the limits were chosen, and how well they do on other: the page urban-classes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._evidence import FOOT, PointFeatures

STEEP = 50.0  # degrees: sides of crowns are steeper, and most roofs flatter
SIDES = 0.25  # share of the points on planes that lie on such sides
TORN = 1 / 3  # share of all points that lie on no plane: on a spire or a steep roof few do

Mask = NDArray[np.bool_]


def crowns(shapes: NDArray[Any], features: PointFeatures, planes: Mask) -> Mask:
    """True for regions that are crowns, array of shape (m,).

    Parameters
    ----------
    shapes : array of shape (m,), polygons
    features : n points
    planes : array of shape (n,), those that look like a roof and lie on planes
    """
    above = features.terrain[1] > FOOT
    least = np.cos(np.radians(STEEP))
    found = []
    for shape in shapes:
        inside = features.within(shape, above)
        upright = abs(features.planes[1][inside[planes[inside]], 2])
        sides = np.mean(upright < least) if len(upright) else 0.0
        found.append(sides >= SIDES and 1 - planes[inside].mean() >= TORN)
    return np.asarray(found, bool)
