"""What the tools that reproject layers have in common."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from pyproj import CRS

from toolbox.context import log
from toolbox.data import PointCloud, Raster, Table, Vector
from toolbox.data.crs import describe_crs, same_crs
from toolbox.data.operation import MissingGrid, Operation, operation
from toolbox.errors import DataError


def chosen(
    name: str,
    layer: PointCloud | Raster | Vector,
    crs: CRS,
    *,
    heights: bool,
    geoid: str | None,
    epoch: float | None,
    missing_grid: MissingGrid,
) -> Operation:
    """The operation for a layer, which is told in the log.

    Parameters
    ----------
    name : of the source of the tool, for messages
    heights : whether the layer has heights

    Raises
    ------
    DataError
        There is none; see :func:`toolbox.data.operation.operation`.

    Examples
    --------
    >>> import numpy as np
    >>> cloud = PointCloud(np.array([[5e5, 0.0, 0.0]]), {}, crs=CRS(32631))
    >>> way = chosen(
    ...     "points",
    ...     cloud,
    ...     CRS(4326),
    ...     heights=False,
    ...     geoid=None,
    ...     epoch=None,
    ...     missing_grid="refuse",
    ... )
    >>> way.accuracy
    0.0
    """
    bounds = layer.extent if isinstance(layer, PointCloud) else layer.bounds
    try:
        way = operation(
            layer.crs,
            crs,
            bounds,
            heights=heights,
            geoid=geoid,
            epoch=epoch,
            missing_grid=missing_grid,
        )
    except DataError as error:
        raise DataError(f"{name}: {layer.name or 'the layer'}: {error}") from error
    if getattr(layer, "origin", None) is None:  # said once, and not for each tile
        if same_crs(layer.crs, way.target):
            log.warning("%s is in %s already", layer.name, describe_crs(way.target))
        log.info("%s: %s", layer.name, way)
    return way


def operation_table(way: Operation, geoid: str | None) -> Table:
    """One row per property of an operation.

    Examples
    --------
    >>> way = operation(CRS(32631), CRS(32632), (5e5, 0.0, 5e5, 0.0), heights=False)
    >>> operation_table(way, None).frame["property"].tolist()
    ['from', 'to', 'operation', 'accuracy', 'heights']
    """
    rows: list[dict[str, Any]] = [
        {"property": "from", "value": describe_crs(way.source), "unit": ""},
        {"property": "to", "value": describe_crs(way.target), "unit": ""},
        {"property": "operation", "value": way.name, "unit": ""},
        {
            "property": "accuracy",
            "value": "not known" if way.accuracy is None else way.accuracy,
            "unit": "" if way.accuracy is None else "metre",
        },
        {"property": "heights", "value": "moved" if way.moves_heights else "kept", "unit": ""},
    ]
    if geoid:
        digest = hashlib.sha256(Path(geoid).read_bytes()).hexdigest()
        rows.append({"property": "SHA-256 of the geoid", "value": digest, "unit": ""})
    return Table.from_rows(rows)
