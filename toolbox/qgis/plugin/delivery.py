"""The folder of a set that is handed over: its layers are loaded, and its README is a result."""

from __future__ import annotations

import os
from typing import Any

from qgis.core import QgsProcessingContext, QgsProcessingOutputHtml, QgsProviderRegistry

from .layers import opens_points
from .styling import Styler

README = "_README"  # ends the name of the output by which the results viewer opens it


def folder_of(tool: dict[str, Any]) -> dict[str, Any] | None:
    """The field of the folder; None if the tool hands nothing over."""
    return next((field for field in tool["outputs"] if field["type"] == "folder"), None)


def readme(field: dict[str, Any]) -> Any:
    """The output of its README, which dialogs list among their results as they do with pages."""
    return QgsProcessingOutputHtml(field["name"].upper() + README, field["label"])


def names(field: dict[str, Any]) -> set[str]:
    """The outputs that are in the set: they need no temporary file besides."""
    return {layer["name"] for layer in field["layers"]} - {""}


def holds(path: str, layer: str) -> bool:
    """Whether a file has a layer, "" for that of its own; a set leaves out what would be empty."""
    found = QgsProviderRegistry.instance().querySublayers(path) if layer else ()
    return not layer or layer in {one.name() for one in found}


def load(
    field: dict[str, Any], folder: str, loaded: set[str], algorithm: Any, colours: Any, context: Any
) -> None:
    """Let QGIS load the layers of the set, but for outputs that have a file of their own, too.

    Parameters
    ----------
    field : of the folder
    loaded : the outputs that QGIS loads from elsewhere
    algorithm : its id, by which users choose styles
    """
    for layer in field["layers"]:
        path = os.path.join(folder, layer["file"])
        if layer["name"] in loaded or not os.path.isfile(path) or not holds(path, layer["layer"]):
            continue
        if layer["type"] == "pointcloud" and not opens_points(path):
            continue
        source = f"{path}|layername={layer['layer']}" if layer["layer"] else path
        name = layer["name"].upper()
        details = QgsProcessingContext.LayerDetails(layer["label"], context.project(), name)
        details.forceName = True  # else QGIS names layers by files, of which some hold several
        styler = Styler.of(colours, layer, (algorithm, name))
        styler.hidden = not name and layer["type"] == "raster"  # it would cover the results
        details.setPostProcessor(styler)
        context.addLayerToLoadOnCompletion(source, details)
