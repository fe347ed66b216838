"""Features as CSV: points with columns x, y and z, all others with a column of WKT.

The table has no CRS. Points whose attributes are called x, y or z have WKT, too.

References
----------
OGC 06-103r4, Simple feature access, part 1: well-known text (WKT) of a geometry.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from toolbox.data.table import Table
from toolbox.errors import DataError

if TYPE_CHECKING:
    import geopandas
    import pandas as pd

SUFFIX = ".csv"
_AXES, _WKT = ("x", "y", "z"), "wkt"
_EXACT = 25  # decimals that are given where needed; with 18, small coordinates are not exact


def write(frame: geopandas.GeoDataFrame, path: Path) -> None:
    """Write features as a table; coordinates read back exactly.

    Raises
    ------
    DataError
        An attribute is called as the column of the geometries.
    """
    import pandas as pd

    attributes = pd.DataFrame(frame.drop(columns=frame.geometry.name))
    named = {str(name).lower() for name in attributes}
    points = (frame.geom_type == "Point") & ~frame.is_empty
    if points.all() and not named & {*_AXES}:
        axes = _AXES if frame.has_z.any() else _AXES[:2]
        xyz = shapely.get_coordinates(frame.geometry, include_z=True)
        position = pd.DataFrame(xyz[:, : len(axes)], columns=list(axes))
    elif _WKT in named:
        raise DataError(f"{path}: the column of geometries is {_WKT}; rename the attribute")
    else:
        texts = shapely.to_wkt(frame.geometry.to_numpy(), rounding_precision=_EXACT)
        position = pd.DataFrame({_WKT: texts}, dtype=object)
    Table(pd.concat([position, attributes], axis=1)).save(path)


def read(path: Path) -> geopandas.GeoDataFrame:
    """Read what :func:`write` has written, or any CSV with such columns.

    Raises
    ------
    DataError
        It is no such table, or a row has no position.
    """
    import geopandas

    frame = Table.open(path).frame
    columns = {str(name).lower(): name for name in frame}
    if _WKT in columns:
        used = [columns[_WKT]]
        geometry: Any = shapely.from_wkt(frame[used[0]].fillna("").to_numpy(object))
    elif {*_AXES[:2]} <= columns.keys():
        used = [columns[axis] for axis in _AXES if axis in columns]
        geometry = shapely.points(_positions(frame[used], path))
    else:
        listed = ", ".join(map(str, frame)) or "none"
        raise DataError(f"{path}: features need columns x and y, or {_WKT}, and it has {listed}")
    return geopandas.GeoDataFrame(frame.drop(columns=used), geometry=geometry)


def _positions(
    frame: pd.DataFrame, path: Path
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    try:
        found: np.ndarray[tuple[int, int], np.dtype[np.float64]] = frame.to_numpy(np.float64)
    except (ValueError, TypeError) as error:
        raise DataError(f"{path}: coordinates must be numbers: {error}") from error
    if bad := np.flatnonzero(~np.isfinite(found[:, :2]).all(axis=1)).tolist():
        raise DataError(f"{path}: row {bad[0] + 1} has no position")
    return found
