"""What a file holds, whatever its format: the verb `info` of the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from toolbox.context import QUIET, Context
from toolbox.data import Raster, Table, Vector
from toolbox.data.crs import describe_crs
from toolbox.errors import DataError
from toolbox.execute import run

RASTERS = (".tif", ".tiff", ".vrt", ".img", ".asc")
VECTORS = (".gpkg", ".geojson", ".fgb", ".shp", ".kml", ".gml", ".dxf")


def describe_file(path: Path, ctx: Context = QUIET) -> Table:
    """Properties of a point cloud, raster, vector or table: rows of property, value and unit.

    Raises
    ------
    DataError
        The file is missing or cannot be read.
    """
    if not path.exists():
        raise DataError(f"there is no file {path}")
    suffix = path.suffix.lower()
    if suffix in RASTERS:
        return _table(_raster(Raster.open(path)))
    if suffix in VECTORS:
        return _table(_vector(Vector.open(path)))
    if suffix in (".parquet", ".json"):
        return _table(_frame(Table.open(path).frame))
    made: Table = run("points.info", {"points": path}, ctx=ctx)["table"]
    return made


def _table(rows: dict[str, Any]) -> Table:
    return Table.from_rows({"property": name, "value": value} for name, value in rows.items())


def _crs(layer: Any) -> str | None:
    return describe_crs(layer.crs) if layer.crs else None


def _raster(raster: Raster) -> dict[str, Any]:
    rows, cols = raster.shape
    found: dict[str, Any] = {
        "file": raster.name,
        "crs": _crs(raster),
        "rows": rows,
        "columns": cols,
    }
    found["cell"] = raster.cell
    found |= dict(zip(("xmin", "ymin", "xmax", "ymax"), raster.bounds, strict=True))
    for band in range(1, len(raster.values) + 1):
        values = raster.band(band)
        known = values[np.isfinite(values)]
        found[f"band {band}"] = raster.descriptions[band - 1] if raster.descriptions else ""
        found[f"band {band} cells without data"] = values.size - known.size
        if known.size:
            found[f"band {band} minimum"] = float(known.min())
            found[f"band {band} mean"] = float(known.mean())
            found[f"band {band} maximum"] = float(known.max())
    return found


def _vector(vector: Vector) -> dict[str, Any]:
    found: dict[str, Any] = {"file": vector.name, "crs": _crs(vector), "features": len(vector)}
    found["geometry"] = ", ".join(sorted(set(vector.frame.geom_type.dropna())))
    if len(vector):
        found |= dict(zip(("xmin", "ymin", "xmax", "ymax"), vector.frame.total_bounds, strict=True))
    attributes = vector.frame.drop(columns=vector.frame.geometry.name)
    return found | _frame(attributes)


def _frame(frame: Any) -> dict[str, Any]:
    return {"rows": len(frame)} | {f"column {name}": str(frame[name].dtype) for name in frame}
