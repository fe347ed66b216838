"""Levels from heights: modes, which neither banks above nor errors below can move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FEW = 0.05  # share of the heights that make a mode


def mode(heights: Floats, width: float) -> float:
    """Middle of the fullest interval of a width; of equally full ones the lowest."""
    h = np.sort(heights)
    ends = np.searchsorted(h, h + width, side="right")
    first = int(np.argmax(ends - np.arange(len(h))))
    return float(np.median(h[first : ends[first]]))


def lowest_mode(heights: Floats, width: float) -> float:
    """Middle of the lowest interval of a width that holds a share of FEW of the heights."""
    h = np.sort(heights)
    ends = np.searchsorted(h, h + width, side="right")
    many = ends - np.arange(len(h)) >= max(3, FEW * len(h))
    if not many.any():
        return float(h[0])
    first = int(np.argmax(many))
    return float(np.median(h[first : ends[first]]))
