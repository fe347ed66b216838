"""Polygons in space as triangles, in PLY files for viewers and 3-D programs.

Each polygon is cut into triangles within its own plane (constrained Delaunay), its holes stay open.
Every face knows its feature, counted from 0, and the numbers among the attributes of that.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from toolbox.data.extras import PLY
from toolbox.errors import DataError

if TYPE_CHECKING:
    import geopandas

FEATURE = "feature"

Floats = NDArray[np.float64]


def write(frame: geopandas.GeoDataFrame, path: Path) -> None:
    """Write polygons as triangles to a binary little-endian PLY file with double coordinates.

    Raises
    ------
    DataError
        plyfile is not installed, or a feature is no polygon with heights.
    """
    PLY.need()
    import plyfile

    vertices, faces, owners, count = [], [], [], 0
    for number, geometry in enumerate(frame.geometry):
        for piece in shapely.get_parts(geometry):
            if piece.geom_type != "Polygon" or not piece.has_z:
                raise DataError(f"{path}: a PLY mesh is made of polygons with heights")
            xyz, triangles = triangulated(piece)
            vertices.append(xyz)
            faces.append(triangles + count)
            owners.append(np.full(len(triangles), number))
            count += len(xyz)
    corners = np.concatenate([np.empty((0, 3)), *vertices])
    made = np.empty(count, [(axis, "f8") for axis in "xyz"])
    for axis, name in enumerate("xyz"):
        made[name] = corners[:, axis]
    owner = np.concatenate([np.empty(0, np.int64), *owners])
    columns = _numbers(frame)
    kinds: list[Any] = [("vertex_indices", "i4", (3,)), (FEATURE, "i4")]
    table = np.empty(len(owner), [*kinds, *((n, v.dtype.str) for n, v in columns.items())])
    table["vertex_indices"] = np.concatenate([np.empty((0, 3), np.int64), *faces])
    table[FEATURE] = owner
    for name, values in columns.items():
        table[name] = values[owner]
    elements = [
        plyfile.PlyElement.describe(made, "vertex"),
        plyfile.PlyElement.describe(table, "face"),
    ]
    plyfile.PlyData(elements, byte_order="<").write(str(path))


def triangulated(polygon: Any) -> tuple[Floats, NDArray[np.int64]]:
    """Triangulate a polygon in space; gives corners (n, 3), and triangles (m, 3) of indices."""
    rings = [polygon.exterior, *polygon.interiors]
    sides = [shapely.get_coordinates(ring, include_z=True)[:-1] for ring in rings]
    xyz = np.concatenate(sides)
    near = xyz - xyz[0]
    axes = np.linalg.svd(near - near.mean(axis=0), full_matrices=False)[2][:2]
    uv = near @ axes.T
    ends = np.cumsum([len(side) for side in sides])
    shell, *holes = np.split(uv, ends[:-1])
    cut = shapely.constrained_delaunay_triangles(shapely.Polygon(shell, holes))
    triangles = shapely.get_coordinates(shapely.get_parts(cut)).reshape(-1, 4, 2)[:, :3]
    index = {tuple(corner): number for number, corner in enumerate(uv.tolist())}
    found = [index[tuple(corner)] for corner in triangles.reshape(-1, 2).tolist()]
    return xyz, np.array(found, np.int64).reshape(-1, 3)


def _numbers(frame: geopandas.GeoDataFrame) -> dict[str, NDArray[Any]]:
    """The attributes that PLY can hold: numbers with a plain name."""
    columns = {}
    for name, values in frame.drop(columns=frame.geometry.name).items():
        if values.dtype.kind not in "biuf" or not re.fullmatch(r"[!-~]+", str(name)):
            continue
        whole = values.dtype.kind in "iu" and values.abs().max() < 2**31
        columns[str(name)] = values.to_numpy("i4" if whole and not values.hasnans else "f8")
    return {name: values for name, values in columns.items() if name != FEATURE}
