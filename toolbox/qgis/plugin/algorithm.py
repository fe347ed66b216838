"""The algorithm class of QGIS for all tools."""

from __future__ import annotations

import os
from typing import Any

from qgis.core import QgsProcessingAlgorithm, QgsProcessingOutputMultipleLayers
from qgis.PyQt.QtCore import QUrl
from qgis.PyQt.QtGui import QIcon

from . import bridge
from .parameters import TYPES, UNSET, Reader, definition, is_plain, is_value
from .styling import Styler

FILES = "_FILES"  # ends the name of the output that lists several layers


class ToolAlgorithm(QgsProcessingAlgorithm):
    """A tool of tools.json as an algorithm of QGIS.

    Parameters
    ----------
    tool : entry of the tool
    colours : of layers
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
        return str(self.tool["group_id"])

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
        of_group = bridge.HERE / "icons" / f"{self.groupId()}.svg"
        return str(of_group if of_group.is_file() else bridge.HERE / "icon.svg")

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
        return (True, "") if bridge.find_python() else (False, bridge.missing())

    def checkParameterValues(self, parameters: Any, context: Any) -> tuple[bool, str]:
        """Refuse unknown names, which QGIS would ignore, and values of a wrong type.

        The tool checks texts and numbers, and says what is wrong.
        """
        definitions = {made.name(): made for made in self.parameterDefinitions()}
        if unknown := sorted(parameters.keys() - definitions.keys()):
            lines = [f"  {name.lower()}: unknown parameter" for name in unknown]
            return False, "\n".join([f"{self.tool['id']}: {len(lines)} problem(s)", *lines])
        for name, made in definitions.items():
            value = parameters.get(name)
            if not is_plain(value) and not made.checkValueIsAcceptable(value, context):
                return False, f"Incorrect parameter value for {made.description()}"
        return True, ""

    def processAlgorithm(self, parameters: Any, context: Any, feedback: Any) -> dict[str, Any]:
        read = Reader(self, self.tool["inputs"], parameters, context, feedback)
        inputs = [(field, read.input(field)) for field in self.tool["inputs"]]
        writes = [field for field in self.tool["outputs"] if not is_value(field)]
        given = [(f, v) for f, v in [*inputs, *((f, read.output(f)) for f in writes)]]
        given = [(field, value) for field, value in given if value is not UNSET]
        values = {field["name"]: value for field, value in given if not field.get("option")}
        options = ["--overwrite"]  # the dialog has asked
        for field, value in given:
            options += option_words(field, value) if field.get("option") else []
        result = bridge.run(self.tool["id"], options, values, feedback)
        shown = {f["name"]: _path(v) for f, v in given if f.get("option") and "suffixes" in f}
        result |= {name: path for name, path in shown.items() if os.path.exists(path)}
        places = {f["name"]: v for f, v in given}
        self._drop_what_was_not_made(result, places, context)
        return dict(self._results(result, places))

    def _results(self, result: dict[str, Any], given: dict[str, Any]) -> Any:
        """The results of a tool by the names of QGIS, without tables that were not written."""
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

    def _drop_what_was_not_made(
        self, result: dict[str, Any], places: dict[str, Any], context: Any
    ) -> None:
        """Load no layer of ours that was not written, and set the colours of the others.

        The list of layers to load is that of a whole model, with those of its other steps, which
        stay as they are.
        """
        outputs = [f for f in self.tool["outputs"] if f["type"] in TYPES]
        planned = {_same(_path(places.get(f["name"]))): f for f in outputs}
        made = {_same(result.get(f["name"])) for f in outputs}
        loads = context.layersToLoadOnCompletion()
        lost = [path for path in loads if _same(path) in planned.keys() - made]
        context.setLayersToLoadOnCompletion({p: loads[p] for p in loads if p not in lost})
        for path in loads.keys() - lost:
            if field := planned.get(_same(path)):
                styler = Styler.of(self.colours, field.get("classes"))
                context.layerToLoadOnCompletionDetails(path).setPostProcessor(styler)


def option_words(field: dict[str, Any], value: Any) -> list[str]:
    """The words of the command line for an option of a run."""
    word = f"--{field['option'].replace('_', '-')}"
    if field["type"] == "boolean":
        return [word] if str(value).lower() in ("true", "yes", "1") else []
    return [] if value is None else [word, str(value)]


def _same(source: Any) -> str:
    """Normalise the path of a layer, so that those of the tool and of QGIS are equal."""
    if not isinstance(source, str):
        return ""
    path = source.removeprefix("ogr:dbname='").partition("' table=")[0]
    return os.path.normcase(os.path.realpath(path))


def _path(value: Any) -> Any:
    return value["path"] if isinstance(value, dict) else value
