"""Low, medium and high vegetation by height."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LOW, MEDIUM, HIGH = np.uint8(3), np.uint8(4), np.uint8(5)  # ASPRS classes
PLANTS = (3, 4, 5)


def by_height(height: NDArray[np.float64], low: float, high: float) -> NDArray[np.uint8]:
    """Low, medium or high vegetation for each height; high where the height is not known (NaN).

    Parameters
    ----------
    height : above the ground, array of shape (n,)
    low, high : low vegetation is below `low`, high vegetation from `high` on
    """
    found = np.full(len(height), HIGH)
    found[height < high] = MEDIUM
    found[height < low] = LOW
    return found
