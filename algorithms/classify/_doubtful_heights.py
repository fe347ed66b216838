"""Buildings of which the height that is told is not all: with towers, or on uneven ground.

A ridge is that of the planes of a roof. A slender tower has none, and no figure of a building holds
its height. Chimneys, aerials and dormers cover less than a section of a roof.

A building and its parts stand on one ground, so that they fit together as solids. On a slope, or
between a street and a quay, a wall is higher on the low side than the building is said to be.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._evidence import PointFeatures
from algorithms.classify._roofs import ROOF
from algorithms.shared.kernels.sorting import distinct
from toolbox.context import log

ABOVE = 1.0  # metres from the ridge, which a hundredth of the roof is above
CELL = 1.0  # metres, of the cells that points are counted in
UNEVEN = 1.0  # metres between low and high ground of a building: a third of a storey
SIDES = 5, 95  # per cent of its points that have lower ground below them than these


def warn_of_doubtful_heights(
    rows: Sequence[dict[str, Any]], features: PointFeatures, building: NDArray[np.bool_]
) -> None:
    """Tell buildings that have more than chimneys above their ridge, and those on uneven ground.

    Parameters
    ----------
    rows : attributes and outlines of the buildings
    features : n points
    building : array of shape (n,), those that became building
    """
    towers, uneven = [], []
    for row in rows:
        inside = features.within(row["geometry"], building)
        top, area = above_the_ridge(row, features, inside)
        if area >= ROOF:
            towers.append((top - row["ridge"], top, area, row))
        low, high = np.percentile(features.ground_below(inside), SIDES) if len(inside) else (0, 0)
        if high - low > UNEVEN * features.cloud.metre:
            uneven.append((high - low, low, high, row))
    if towers:
        _, top, area, row = max(towers, key=lambda one: one[0])
        log.warning(
            "buildings that rise more than %g m above their ridge on %g m2 or more, as with a "
            "tower or spire: %d; their heights are those of the planes of their roofs. The most: "
            "%s, ridge %.2f, about %.0f m2 above it up to %.2f",
            ABOVE,
            ROOF,
            len(towers),
            row["id"],
            row["ridge"],
            area,
            top,
        )
    if uneven:
        _, low, high, row = max(uneven, key=lambda one: one[0])
        log.warning(
            "buildings with ground that differs by more than %g m from side to side: %d; their "
            "heights and those of their parts are from one ground, the median below them, so walls "
            "may be higher or lower than that. The most: %s, ground %.2f, from %.2f to %.2f",
            UNEVEN,
            len(uneven),
            row["id"],
            row["ground"],
            low,
            high,
        )


def above_the_ridge(
    row: dict[str, Any], features: PointFeatures, inside: NDArray[np.int64]
) -> tuple[float, float]:
    """Elevation of the highest point above a ridge, and area of what is, square metres."""
    metre, xyz = features.cloud.metre, features.xyz[inside]
    high = xyz[xyz[:, 2] > row["ridge"] + ABOVE * metre]
    east, north = np.floor(high[:, :2].T / (CELL * metre)).astype(np.int64)
    area = len(distinct(east * 2**32 + north)) * CELL**2
    return float(high[:, 2].max(initial=-np.inf)), area
