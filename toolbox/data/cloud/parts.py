"""Point clouds taken apart and put together, as data frames, and compared in words."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from toolbox.data import differences
from toolbox.data.crs import crs_from_json, crs_to_json
from toolbox.data.las.write import metadata_bytes, metadata_of

if TYPE_CHECKING:
    import pandas as pd

    from toolbox.data.pointcloud import PointCloud


def apart(cloud: PointCloud) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """See :meth:`PointCloud.apart`."""
    origin = {} if cloud._origin is None else {"origin": cloud._origin}
    rest: dict[str, Any] = {
        "name": cloud.name,
        "crs": crs_to_json(cloud.crs),
        "columns": list(cloud._columns),
        "descriptions": cloud._descriptions,
        "moved": cloud._moved,
        "steps": cloud._steps,
        "box": np.reshape(cloud.bounds, (2, 3)).tolist(),
    }
    if cloud._metadata is not None:
        rest["las"] = base64.b64encode(metadata_bytes(cloud._metadata)).decode()
        rest["las_crs"] = crs_to_json(cloud._metadata.crs)
        rest["packets"] = cloud._metadata.packets and str(cloud._metadata.packets)
    return cloud.arrays() | origin, rest


def joined(
    cls: type[PointCloud], arrays: Mapping[str, NDArray[Any]], rest: Mapping[str, Any]
) -> PointCloud:
    """See :meth:`PointCloud.of_parts`."""
    crs, empty = crs_from_json(rest["crs"]), np.empty((0, 3))
    cloud = cls(empty, crs=crs, name=rest["name"], descriptions=rest["descriptions"])
    if "las" in rest:
        metadata = metadata_of(base64.b64decode(rest["las"]))
        packets = rest["packets"] and Path(rest["packets"])
        cloud._metadata = replace(metadata, crs=crs_from_json(rest["las_crs"]), packets=packets)
    cloud._moved = rest["moved"]
    cloud._steps = rest["steps"] and tuple(map(tuple, rest["steps"]))
    cloud._columns = dict.fromkeys(rest["columns"], np.empty(0))
    origin = arrays.get("origin")
    points = {name: values for name, values in arrays.items() if name != "origin"}
    return cloud.with_arrays(points).with_origin(origin)


def dataframe(cloud: PointCloud) -> pd.DataFrame:
    """See :meth:`PointCloud.to_dataframe`."""
    import pandas as pd

    columns: dict[str, NDArray[Any]] = {axis: cloud[axis] for axis in cloud.axes}
    for name in cloud.names:
        values = cloud[name]
        if values.ndim == 1:
            columns[name] = values
        else:
            columns |= {f"{name}_{k}": values[:, k] for k in range(values.shape[1])}
    frame = pd.DataFrame(columns)
    frame.attrs["crs"] = crs_to_json(cloud.crs)
    return frame


def differing(cloud: PointCloud, now: PointCloud) -> Iterator[str]:
    """See :meth:`PointCloud.differences`."""
    if len(cloud) != len(now):
        yield f"{len(cloud)} points, now {len(now)}"
        return
    names = [*cloud.axes, *(name for name in cloud.names if name in now)]
    arrays = ({n: one[n] for n in names} for one in (cloud, now))
    yield from differences.of_arrays(next(arrays), next(arrays), "points")
    yield from differences.of_names(cloud.names, now.names)
