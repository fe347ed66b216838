"""What the layers of QGIS and the values of its dialogs are: files, names, attributes."""

from __future__ import annotations

import os
from typing import Any

import qgis.core
from qgis.core import (
    NULL,
    QgsCsException,
    QgsProcessingException,
    QgsProject,
    QgsRasterLayer,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QUrl

from . import language
from .lasheader import las_attributes

SAME_PLACE = 1e-9  # of coordinates: millimetres in those of a map


def is_path(value: Any) -> bool:
    """Whether a value is the path of a file or folder that exists, or a pattern of paths."""
    if not isinstance(value, str) or not value:
        return False
    path = value.partition("|layername=")[0]
    return os.path.exists(path) or (any(c in path for c in "*?[") and os.path.isabs(path))


def is_missing(value: Any) -> bool:
    """Whether a value is empty; QGIS has NULL for it."""
    return value is None or value == NULL or (isinstance(value, str) and value == "") or value == []


def is_plain(value: Any) -> bool:
    """Whether a value is a text or number, or several of these, which a tool reads itself."""
    if isinstance(value, (list, tuple)):
        return bool(value) and all(map(is_plain, value))
    return isinstance(value, (str, int, float)) and value != ""


def layer_path(value: str) -> Any:
    path, _, layer = value.partition("|layername=")
    return {"path": path, "layer": layer} if layer else path


def source_of(layer: Any) -> Any:
    """The file behind a layer, or the file and the name of the layer in it.

    Raises
    ------
    QgsProcessingException
        There is none, as for a layer of a server, or the layer is filtered.
    """
    path, *more = layer.source().split("|")
    path = path.removeprefix("vpc://")
    if path.startswith("file:"):
        path = QUrl(path).toLocalFile()
    if not os.path.exists(path):
        raise QgsProcessingException(
            language.text(
                "Layer '{name}' is no file on this computer; save it to a file first."
            ).format(name=layer.name())
        )
    if hasattr(layer, "subsetString") and layer.subsetString():
        raise QgsProcessingException(
            language.text(
                "Layer '{name}' is filtered, which its file is not; save it to a file first."
            ).format(name=layer.name())
        )
    names = [item[len("layername=") :] for item in more if item.startswith("layername=")]
    return {"path": path, "layer": names[0]} if names else path


def is_layer(value: Any) -> bool:
    """Whether a value is a layer of a file, and not the file."""
    return isinstance(value, dict)


def moves(way: Any, extent: Any) -> bool:
    """Whether a transformation changes coordinates; one between names of one CRS does not."""
    if way.isShortCircuited() or extent.isNull():
        return False
    corners = [(extent.xMinimum(), extent.yMinimum()), (extent.xMaximum(), extent.yMaximum())]
    try:
        there = [way.transform(x, y) for x, y in corners]
    except QgsCsException:  # outside of where it holds; the tool says which CRS there are
        return False
    size = max(1.0, *(abs(number) for corner in corners for number in corner))
    far = [(abs(p.x() - x), abs(p.y() - y)) for p, (x, y) in zip(there, corners)]
    return max(max(pair) for pair in far) > SAME_PLACE * size


def suggestions(value: Any, raster: bool = False) -> dict[str, str]:
    """The names of the attributes of a layer or file by how they are shown.

    Of a raster they are the numbers of its bands. There are none if they cannot be told.
    """
    first = value[0] if isinstance(value, (list, tuple)) and value else value
    if is_missing(first):
        return {}
    layer = QgsProject.instance().mapLayer(str(first))
    if layer is None and is_path(first):
        if names := las_attributes(str(first)):
            return dict(zip(names, names))
        kind, provider = (QgsRasterLayer, "gdal") if raster else (QgsVectorLayer, "ogr")
        layer = kind(str(first), "", provider)
    if isinstance(layer, QgsRasterLayer):
        return {layer.bandName(n): str(n) for n in range(1, layer.bandCount() + 1)}
    if isinstance(layer, QgsVectorLayer):
        names = [field.name() for field in layer.fields()] if layer.isValid() else []
    elif layer is None or not hasattr(layer, "attributes"):
        names = []
    else:
        known = las_attributes(layer.source())
        names = known or [a.name() for a in layer.attributes().attributes()]
    return dict(zip(names, names))


def opens_points(path: str = "") -> bool:
    """Whether this QGIS can show a LAS file: it needs PDAL, but for COPC (since 3.26)."""
    there = qgis.core.QgsProviderRegistry.instance().providerList()
    return "pdal" in there or ("copc" in there and path.lower().endswith(".copc.laz"))
