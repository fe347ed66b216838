"""Points as GeoParquet, for programs of tables: a row per point, with its attributes as columns.

References
----------
OGC (2024). GeoParquet specification 1.1.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from toolbox.context import QUIET, Context
from toolbox.data.crs import is_local
from toolbox.data.extras import PARQUET
from toolbox.data.reading import errors_named

if TYPE_CHECKING:
    from toolbox.data.pointcloud import PointCloud

_BLOCK = 1_000_000  # points of a row group, the arrays of which are made at a time
_WKB = np.dtype([("order", "u1"), ("kind", "<u4"), ("x", "<f8"), ("y", "<f8"), ("z", "<f8")])
_POINT_Z = 1001  # in ISO WKB


def write_geoparquet(path: Path, cloud: PointCloud, *, ctx: Context = QUIET) -> None:
    """Write points with the geometry Point Z, and each attribute in its own type.

    An attribute of k elements becomes the columns `name_0` to `name_{k-1}`.

    Raises
    ------
    DataError
        pyarrow is not installed, or the file cannot be written.
    """
    PARQUET.need()
    import pyarrow as pa
    import pyarrow.parquet

    first = _table(cloud.select([]))
    schema = first.schema.with_metadata({"geo": json.dumps(_about(cloud))})
    with (
        errors_named(f"{path} cannot be written"),
        pyarrow.parquet.ParquetWriter(path, schema, compression="zstd") as writer,
    ):
        for start in range(0, len(cloud), _BLOCK):
            ctx.progress(start / len(cloud))
            part = cloud.select(np.arange(start, min(start + _BLOCK, len(cloud))))
            writer.write_table(pa.table(_table(part).columns, schema=schema))
    ctx.progress(1.0)


def _table(cloud: PointCloud) -> Any:
    import pyarrow as pa

    columns: dict[str, Any] = {"geometry": _geometry(cloud.xyz)}
    for name in cloud.names:
        values = cloud[name]
        if values.ndim == 1:
            columns[name] = pa.array(values)
        else:
            columns |= {f"{name}_{k}": pa.array(values[:, k]) for k in range(values.shape[1])}
    return pa.table(columns)


def _geometry(xyz: NDArray[np.float64]) -> Any:
    """Well-known binary of points of shape (n, 3), as an array of pyarrow."""
    import pyarrow as pa

    made = np.empty(len(xyz), _WKB)
    made["order"], made["kind"] = 1, _POINT_Z
    made["x"], made["y"], made["z"] = xyz.T
    ends = np.arange(len(xyz) + 1, dtype=np.int32) * np.int32(_WKB.itemsize)
    buffers = [None, pa.py_buffer(ends.tobytes()), pa.py_buffer(made.tobytes())]
    return pa.Array.from_buffers(pa.binary(), len(xyz), buffers)


def _about(cloud: PointCloud) -> dict[str, Any]:
    """The metadata by which the column of points is known."""
    column: dict[str, Any] = {"encoding": "WKB", "geometry_types": ["Point Z"]}
    if cloud.crs is None or is_local(cloud.crs):
        column["crs"] = None
    else:
        column["crs"] = cloud.crs.to_json_dict()
    if len(cloud):
        column["bbox"] = list(cloud.bounds)
    return {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}
