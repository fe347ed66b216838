"""Tilted ground with flat-roofed boxes on it, far from the origin, for the ground filters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Box = tuple[float, float, float, float]  # x from, x to, y from, y to, in metres from the corner
EAST, NORTH = 700_000, 5_200_000  # of the corner


def jittered(side: float, spacing: float, jitter: float = 0.5) -> tuple[Floats, Floats]:
    """x and y of points near the nodes of a lattice, up to `jitter` east and north of them."""
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.arange(0.0, side, spacing), np.arange(0.0, side, spacing))
    x = (x + rng.uniform(0, jitter, x.shape)).ravel()
    return x, (y + rng.uniform(0, jitter, y.shape)).ravel()


def terrain(x: Any, y: Any, tilt: float = 0.05) -> Any:
    """Height of the ground, which rises to the east by `tilt`."""
    return 300 + tilt * x + 0.03 * y


def plane(side: float, spacing: float = 0.7, *, jitter: float = 0.5, tilt: float = 0.05) -> Floats:
    """Points on the ground."""
    x, y = jittered(side, spacing, jitter)
    return np.column_stack([x + EAST, y + NORTH, terrain(x, y, tilt)])


def inside(xyz: Floats, box: Box) -> Mask:
    """True within the box, seen from above."""
    x, y = xyz[:, 0] - EAST, xyz[:, 1] - NORTH
    west, east, south, north = box
    return (x > west) & (x < east) & (y > south) & (y < north)


def town(xyz: Floats, boxes: Mapping[Box, float]) -> tuple[Floats, Mask]:
    """Points, those in boxes lifted by their heights and with no ground below; what is roof."""
    xyz, roof = xyz.copy(), np.zeros(len(xyz), bool)
    for box, height in boxes.items():
        within = inside(xyz, box)
        xyz[within, 2] += height
        roof |= within
    return xyz, roof


def isprs(path: Path) -> tuple[Floats, Mask]:
    """Points of a sample of the ISPRS filter test, and which of them are ground."""
    table = np.loadtxt(path)
    return np.ascontiguousarray(table[:, :3]), table[:, 3] == 0
