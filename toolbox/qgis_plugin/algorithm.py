"""One algorithm class for all tools."""

from __future__ import annotations

import os
from typing import Any

from qgis.core import QgsProcessingAlgorithm, QgsProcessingOutputMultipleLayers
from qgis.PyQt.QtCore import QUrl
from qgis.PyQt.QtGui import QIcon

from . import bridge
from .parameters import TYPES, UNSET, Reader, definition, is_missing, is_value
from .styling import Styler

SIGNS = {"gt": float.__gt__, "ge": float.__ge__, "lt": float.__lt__, "le": float.__le__}
FILES = "_FILES"  # ends the name of the output that lists several layers


class ToolAlgorithm(QgsProcessingAlgorithm):
    """A tool as tools.json describes it.

    Parameters
    ----------
    tool : its entry
    colours : what layers are drawn in
    """

    def __init__(self, tool: dict[str, Any], colours: dict[str, Any]) -> None:
        super().__init__()
        self.tool, self.colours = tool, colours

    def createInstance(self) -> ToolAlgorithm:
        return ToolAlgorithm(self.tool, self.colours)

    def name(self) -> str:
        return str(self.tool["algorithm"])

    def displayName(self) -> str:
        return str(self.tool["title"])

    def group(self) -> str:
        return str(self.tool["group"])

    def groupId(self) -> str:
        return self.group().lower()

    def tags(self) -> list[str]:
        return list(self.tool["tags"])

    def shortDescription(self) -> str:
        return str(self.tool["summary"])

    def shortHelpString(self) -> str:
        return str(self.tool["help"])

    def helpUrl(self) -> str:
        page = bridge.HERE / "help" / f"{self.tool['id']}.html"
        return str(QUrl.fromLocalFile(str(page)).toString()) if page.is_file() else ""

    def icon(self) -> Any:
        return QIcon(self.svgIconPath())

    def svgIconPath(self) -> str:
        return str(bridge.HERE / "icon.svg")

    def initAlgorithm(self, config: Any = None) -> None:
        for field in self.tool["inputs"] + self.tool["outputs"]:
            made = definition(field)
            if is_value(field):
                self.addOutput(made)
                continue
            self.addParameter(made)
            if "suffixes" in field and field["many"]:
                name, label = field["name"].upper() + FILES, f"{field['label']}, files"
                self.addOutput(QgsProcessingOutputMultipleLayers(name, label))

    def canExecute(self) -> tuple[bool, str]:
        return (True, "") if bridge.find_python() else (False, bridge.MISSING)

    def checkParameterValues(self, parameters: Any, context: Any) -> tuple[bool, str]:
        """Unknown names and numbers outside their limits, in the words of the tool.

        QGIS would pass over the former. What it finds itself comes after.
        """
        known = {definition.name() for definition in self.parameterDefinitions()}
        found = {name.lower(): "unknown parameter" for name in sorted(parameters.keys() - known)}
        for field in self.tool["inputs"]:
            value = _plain_number(parameters.get(field["name"].upper()))
            if value is not None and any(
                not SIGNS[key](value, float(field[key])) for key in SIGNS if key in field
            ):
                shown = int(value) if field["type"] == "integer" and value.is_integer() else value
                found[field["name"]] = f"must be {field['rule']}, got {shown!r}"
        if found:
            lines = [f"  {name}: {text}" for name, text in found.items()]
            return False, "\n".join([f"{self.tool['id']}: {len(lines)} problem(s)", *lines])
        ok, text = super().checkParameterValues(parameters, context)
        return bool(ok), str(text)

    def processAlgorithm(self, parameters: Any, context: Any, feedback: Any) -> dict[str, Any]:
        read = Reader(self, self.tool["inputs"], parameters, context, feedback)
        inputs = [(field, read.input(field)) for field in self.tool["inputs"]]
        writes = [field for field in self.tool["outputs"] if not is_value(field)]
        given = [(f, v) for f, v in [*inputs, *((f, read.output(f)) for f in writes)]]
        given = [(field, value) for field, value in given if value is not UNSET]
        values = {field["name"]: value for field, value in given if not field.get("option")}
        options = ["--overwrite"]  # the dialog has asked
        for field, value in given:
            if field.get("option") and value is not None:
                options += [f"--{field['option'].replace('_', '-')}", str(value)]
        result = bridge.run(self.tool["id"], options, values, feedback)
        result |= {f["name"]: _path(v) for f, v in given if f.get("option") and "suffixes" in f}
        self._keep_what_was_made(result, context)
        return dict(self._results(result, {f["name"]: v for f, v in given}))

    def _results(self, result: dict[str, Any], given: dict[str, Any]) -> Any:
        """What the tool gave, by the names of QGIS; no rows of a table that was not written."""
        for field in self.tool["outputs"]:
            name, value = field["name"].upper(), result.get(field["name"])
            if value is None or (not is_value(field) and field["name"] not in given):
                continue
            if is_value(field):
                yield name, "; ".join(map(str, value)) if isinstance(value, list) else value
            elif field["many"]:
                yield name, os.path.dirname(given[field["name"]])
                yield name + FILES, value if isinstance(value, list) else [value]
            else:
                yield name, value

    def _keep_what_was_made(self, result: dict[str, Any], context: Any) -> None:
        """Load no layer that the tool did not make, and give the others their colours."""
        made = {_same(result.get(f["name"])): f for f in self.tool["outputs"] if f["type"] in TYPES}
        loads = context.layersToLoadOnCompletion()
        kept = {place: details for place, details in loads.items() if _same(place) in made}
        context.setLayersToLoadOnCompletion(kept)
        for place in kept:
            styler = Styler.of(self.colours)
            context.layerToLoadOnCompletionDetails(place).setPostProcessor(styler)


def _same(place: Any) -> str:
    """A path as the tool and QGIS both write it."""
    if not isinstance(place, str):
        return ""
    path = place.removeprefix("ogr:dbname='").partition("' table=")[0]
    return os.path.normcase(os.path.realpath(path))


def _path(value: Any) -> Any:
    return value["path"] if isinstance(value, dict) else value


def _plain_number(value: Any) -> float | None:
    """A number as it was given; None for nothing, and for what QGIS is still to work out."""
    if is_missing(value) or isinstance(value, bool):
        return None
    try:
        return float(value)
    except (TypeError, ValueError):
        return None
