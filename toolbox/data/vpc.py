"""Virtual point clouds: an index of files of points, as QGIS and PDAL read it.

References
----------
PDAL (2023). Virtual point cloud (VPC), draft specification: a STAC item collection.
STAC extensions pointcloud 1.0.0 and projection 1.1.0.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pyproj import CRS, Transformer

from toolbox.data.crs import is_local
from toolbox.data.operation import plane
from toolbox.data.remote.address import Address

if TYPE_CHECKING:
    from toolbox.data.survey import SurveyFile

SUFFIX = ".vpc"
_OWN = "lidar_toolbox:files_belong_to_index"
_MOST = 2**28  # bytes of an index that is asked for its own files
_EXTENSIONS = [
    "https://stac-extensions.github.io/pointcloud/v1.0.0/schema.json",
    "https://stac-extensions.github.io/projection/v1.1.0/schema.json",
]
_KINDS = {"f": "floating", "i": "signed", "u": "unsigned", "b": "unsigned"}


def text_of(
    files: Sequence[SurveyFile], place: Path, *, own: bool = False, overview: Path | None = None
) -> str:
    """The text of a virtual point cloud.

    Parameters
    ----------
    files : what their headers say
    place : path of the virtual point cloud, to which the paths of the files are relative
    own : whether the files, which stand beside it, were made with it; see :func:`own_files`
    overview : COPC file of a part of all points, which QGIS shows from afar; each item names it
    """
    ids = _ids([file.path.name for file in files])
    items = [_item(file, id, place.parent) for file, id in zip(files, ids, strict=True)]
    if overview is not None:
        asset = {"href": _href(overview, place.parent), "roles": ["overview"]}
        for item in items:
            item["assets"]["overview"] = asset
    head: dict[str, Any] = {"type": "FeatureCollection"} | ({_OWN: True} if own else {})
    return json.dumps({**head, "features": items}, indent=1) + "\n"


def own_files(path: Path) -> list[Path]:
    """The files beside a virtual point cloud that were made with it, and so are replaced with it.

    None of an index of files that were there before.
    """
    try:
        if path.stat().st_size > _MOST:
            return []
        found = json.loads(path.read_text(encoding="utf-8"))
        if found.get(_OWN) is not True:
            return []
        links = [item["assets"]["data"]["href"].removeprefix("./") for item in found["features"]]
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return []  # no index of ours
    return [path.with_name(link) for link in links if Path(link).name == link]


def _ids(names: Sequence[str]) -> list[str]:
    """Names without endings, also that of COPC; numbered where several are the same."""
    stems = [Path(name.removesuffix(".gz")).stem.removesuffix(".copc") for name in names]
    seen: Counter[str] = Counter()
    found = []
    for stem in stems:
        seen[stem] += 1
        found.append(stem if seen[stem] == 1 else f"{stem}_{seen[stem]}")
    return found


def _item(file: SurveyFile, id: str, folder: Path) -> dict[str, Any]:
    properties: dict[str, Any] = {
        "datetime": f"{file.date}T00:00:00Z" if file.date else None,
        "pc:count": file.count,
        "pc:type": "lidar",
        "pc:encoding": file.path.suffix[1:].lower(),
        "pc:schemas": list(map(_schema, [*_COORDINATES, *file.attributes])),
    }
    made: dict[str, Any] = {
        "type": "Feature",
        "stac_version": "1.0.0",
        "stac_extensions": _EXTENSIONS,
        "id": id,
        "geometry": None,
        "properties": properties,
        "links": [],
        "assets": {"data": {"href": _href(file.path, folder), "roles": ["data"]}},
    }
    if file.count:
        properties["proj:bbox"] = list(file.bounds)
        made |= _outline(file.crs, file.bounds)
    if file.crs is not None and not is_local(file.crs):
        properties["proj:wkt2"] = file.crs.to_wkt()
        properties["proj:projjson"] = file.crs.to_json_dict()
        properties["proj:epsg"] = file.crs.to_epsg()
    return made


_COORDINATES = [(axis, "<f8", ()) for axis in "XYZ"]


def _schema(attribute: tuple[str, str, tuple[int, ...]]) -> dict[str, Any]:
    name, kind, _ = attribute
    dtype = np.dtype(kind)
    return {"name": name, "size": dtype.itemsize, "type": _KINDS[dtype.kind]}


def _href(path: Path, folder: Path) -> str:
    """The relative path, as QGIS has it; a URL where none leads there, as to another drive."""
    if isinstance(path, Address):
        return str(path)
    try:
        return f"./{Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()}"
    except ValueError:
        return path.resolve().as_uri()


def _outline(crs: CRS | None, bounds: Sequence[float]) -> dict[str, Any]:
    """The rectangle and bounds in longitude and latitude; nothing without a CRS of the Earth."""
    if crs is None or is_local(crs):
        return {}
    xmin, ymin, zmin, xmax, ymax, zmax = bounds
    to_degrees = Transformer.from_crs(plane(crs), CRS(4326), always_xy=True)
    x, y = [xmin, xmax, xmax, xmin, xmin], [ymin, ymin, ymax, ymax, ymin]
    east, north = (np.asarray(values) for values in to_degrees.transform(x, y))
    if not (np.isfinite(east).all() and np.isfinite(north).all()):
        return {}
    ring = np.column_stack([east, north]).tolist()
    low, high = [east.min(), north.min(), zmin], [east.max(), north.max(), zmax]
    return {
        "geometry": {"type": "Polygon", "coordinates": [ring]},
        "bbox": [float(value) for value in (*low, *high)],
    }
