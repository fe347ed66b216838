"""Buildings of which towers, spires and the like rise above the ridge that is told.

A ridge is that of the planes of a roof. A slender tower has none, and no figure of a building holds
its height. Chimneys, aerials and dormers cover less than a section of a roof.
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


def warn_of_towers(
    rows: Sequence[dict[str, Any]], features: PointFeatures, building: NDArray[np.bool_]
) -> None:
    """Tell buildings that have more than chimneys above their ridge.

    Parameters
    ----------
    rows : attributes and outlines of the buildings
    features : n points
    building : array of shape (n,), those that became building
    """
    metre, found = features.cloud.metre, []
    for row in rows:
        inside = features.xyz[features.within(row["geometry"], building)]
        high = inside[inside[:, 2] > row["ridge"] + ABOVE * metre]
        east, north = np.floor(high[:, :2].T / (CELL * metre)).astype(np.int64)
        area = len(distinct(east * 2**32 + north)) * CELL**2
        if area >= ROOF:
            found.append((float(high[:, 2].max()), area, row))
    if not found:
        return
    top, area, row = max(found, key=lambda one: one[0] - one[2]["ridge"])
    log.warning(
        "buildings that rise more than %g m above their ridge on %g m2 or more, as with a tower or "
        "spire: %d; their heights are those of the planes of their roofs. The most: %s, ridge "
        "%.2f, about %.0f m2 above it up to %.2f",
        ABOVE,
        ROOF,
        len(found),
        row["id"],
        row["ridge"],
        area,
        top,
    )
