"""Buildings on ground that is not at one height: theirs are from the middle of it.

A building and its parts stand on one ground, so that they fit together as solids. On a slope, or
between a street and a quay, a wall is higher on the low side than the building is said to be.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._evidence import PointFeatures
from toolbox.context import log

UNEVEN = 1.0  # metres between low and high ground of a building: a third of a storey
SIDES = 5, 95  # per cent of its points that have lower ground below them than these


def warn_of_uneven_ground(
    rows: Sequence[dict[str, Any]], features: PointFeatures, building: NDArray[np.bool_]
) -> None:
    """Tell buildings whose ground differs from side to side.

    Parameters
    ----------
    rows : attributes and outlines of the buildings
    features : n points
    building : array of shape (n,), those that became building
    """
    metre, found = features.cloud.metre, []
    for row in rows:
        inside = features.within(row["geometry"], building)
        if len(inside):
            ground = features.xyz[inside, 2] - features.terrain[1][inside] * metre
            low, high = np.percentile(ground, SIDES)
            if high - low > UNEVEN * metre:
                found.append((high - low, low, high, row))
    if not found:
        return
    _, low, high, row = max(found, key=lambda one: one[0])
    log.warning(
        "buildings with ground that differs by more than %g m from side to side: %d; their heights "
        "and those of their parts are from one ground, the median below them, so walls may be "
        "higher or lower than that. The most: %s, ground %.2f, from %.2f to %.2f",
        UNEVEN,
        len(found),
        row["id"],
        row["ground"],
        low,
        high,
    )
