"""A point cloud and a raster from plain numbers, which most tests begin with."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyproj import CRS

from toolbox.data import Lattice, PointCloud, Raster

UTM = CRS(32635)
WEST, NORTH = 500_000.0, 4_600_000.0


def cloud(
    xyz: Any, classes: Any = None, *, crs: CRS | None = UTM, name: str = "a.laz", **attributes: Any
) -> PointCloud:
    """Points, with one class for all or one for each."""
    xyz = np.asarray(xyz, float).reshape(-1, 3)
    if classes is not None:
        attributes["classification"] = np.broadcast_to(np.asarray(classes, np.uint8), len(xyz))
    return PointCloud(xyz, attributes, crs=crs, name=name)


def raster(
    values: Any,
    cell: float = 1.0,
    *,
    west: float = WEST,
    north: float = NORTH,
    crs: CRS | None = UTM,
    **more: Any,
) -> Raster:
    """Cells from the north-western corner on; lists of numbers are floats."""
    values = values if isinstance(values, np.ndarray) else np.asarray(values, float)
    lattice = Lattice(west, north, cell, *values.shape[-2:])
    return Raster(values, lattice.transform, crs=crs, **more)
