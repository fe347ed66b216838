"""The folder of a set that is handed over: its layers are loaded, README and report are results."""

from __future__ import annotations

import os
from typing import Any

from qgis.core import QgsProcessingContext, QgsProcessingOutputHtml, QgsProviderRegistry

from .layers import is_missing, opens_points
from .styling import Styler

README, REPORT = "_README", "_REPORT"  # end the names by which the results viewer opens them


def folder_of(tool: dict[str, Any]) -> dict[str, Any] | None:
    """The field of the folder; None if the tool hands nothing over."""
    return next((field for field in tool["outputs"] if field["type"] == "folder"), None)


def decided(tool: dict[str, Any], parameters: dict[str, Any]) -> set[str]:
    """The inputs of which the dialog decides also where they have their defaults.

    A set has values of its own for them; but what is not ticked in a dialog is not wanted.
    """
    folder = folder_of(tool)
    given = folder and not is_missing(parameters.get(folder["name"].upper()))
    return set(folder["decided"]) if folder and given else set()


def pages(field: dict[str, Any]) -> Any:
    """The outputs of its README and report, which dialogs list among their results."""
    name, label = field["name"].upper(), field["label"]
    yield QgsProcessingOutputHtml(name + README, f"{label}: {field['readme']}")
    if field["report"]:
        yield QgsProcessingOutputHtml(name + REPORT, f"{label}: {field['report']}")


def pages_in(field: dict[str, Any], folder: str) -> dict[str, str]:
    """The paths of these, as far as they are there, by the names of the outputs."""
    name = field["name"].upper()
    files = {name + README: field["readme"], name + REPORT: field["report"]}
    paths = {output: os.path.join(folder, file) for output, file in files.items() if file}
    return {output: path for output, path in paths.items() if os.path.isfile(path)}


def names(field: dict[str, Any]) -> set[str]:
    """The outputs that are in the set: they need no temporary file besides."""
    return {layer["name"] for layer in field["layers"]} - {""}


def holds(path: str, layer: str) -> bool:
    """Whether a file has a layer, "" for that of its own; a set leaves out what would be empty."""
    found = QgsProviderRegistry.instance().querySublayers(path) if layer else ()
    return not layer or layer in {one.name() for one in found}


def load(
    field: dict[str, Any], folder: str, loaded: set[str], algorithm: Any, colours: Any, context: Any
) -> list[Styler]:
    """Let QGIS load the layers of the set, but for outputs that have a file of their own, too.

    Parameters
    ----------
    field : of the folder
    loaded : the outputs that QGIS loads from elsewhere
    algorithm : its id, by which users choose styles

    Returns
    -------
    list
        What gives each layer its colours.
    """
    made = []
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
        made.append(Styler.of(colours, layer, (algorithm, name)))
        details.setPostProcessor(made[-1])
        context.addLayerToLoadOnCompletion(source, details)
    return made
