"""The elevation of a front as planes.openings draws it."""

from __future__ import annotations

from typing import Any

import geopandas
import numpy as np
import shapely

from toolbox.data import Vector
from toolbox.data.crs import parse_crs


def elevation(unit: str = "local", metre: float = 1.0) -> Vector:
    """A wall of 10 m by 6 m that looks south, with a door and two windows above each other."""
    holes = [(1, 0, 2, 2.1), (4, 1, 5.5, 2.5), (4, 4, 5.5, 5)]
    boxes = [shapely.box(*np.array(hole) * metre) for hole in holes]
    wall = shapely.box(0, 0, 10 * metre, 6 * metre).difference(shapely.union_all(boxes))
    sizes = [((e - w) * metre, (n - s) * metre, s * metre) for w, s, e, n in holes]
    corner = (500_000.0, 4_400_000.0, 100.0, 1, 0, 0, 0, 0, 1)
    names = [f"{name}_{axis}" for name in ("corner", "right", "up") for axis in "xyz"]
    rows: list[dict[str, Any]] = [
        {"kind": "facade", "front_id": 1, "opening_id": 0, **dict(zip(names, corner, strict=True))}
    ]
    for number, (width, height, sill) in enumerate(sizes, start=1):
        kind = "door" if number == 1 else "window"
        size = {"width": width, "height": height, "sill": sill}
        rows.append({"kind": kind, "front_id": 1, "opening_id": number, **size})
    frame = geopandas.GeoDataFrame(rows, geometry=[wall, *boxes], crs=parse_crs(unit))
    return Vector(frame, name="elevation")
