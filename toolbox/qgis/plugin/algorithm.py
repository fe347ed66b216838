"""The algorithm class of QGIS for all tools."""

from __future__ import annotations

import os
import re
import weakref
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import qgis.utils
from qgis.core import (
    QgsProcessingAlgorithm,
    QgsProcessingException,
    QgsProcessingOutputMultipleLayers,
    QgsProcessingUtils,
)
from qgis.PyQt.QtCore import QUrl
from qgis.PyQt.QtGui import QIcon

from . import bridge, delivery, language
from .layers import is_missing, is_plain, opens_points
from .parameters import TYPES, definition, is_value
from .styling import Styler
from .tree import arrange
from .values import UNSET, Reader

NONE: Mapping[str, str] = MappingProxyType({})
HEAD = ("title", "client")  # options of what reports say of a project
Given = list[tuple[dict[str, Any], Any]]
FILES = "_FILES"  # ends the name of the output that lists several layers


class ToolAlgorithm(QgsProcessingAlgorithm):
    """A tool of tools.json as an algorithm of QGIS.

    Parameters
    ----------
    tool : entry of the tool
    colours : of layers
    words : titles of all tools by id, and labels of boxes of other tools by name
    """

    def __init__(
        self, tool: dict[str, Any], colours: dict[str, Any], words: Mapping[str, str] = NONE
    ) -> None:
        super().__init__()
        self.tool, self.colours, self.words = tool, colours, words
        self.maker: Any = None  # the algorithm of the dialog, of which QGIS runs a copy
        self.has_page = False

    def createInstance(self) -> ToolAlgorithm:
        made = ToolAlgorithm(self.tool, self.colours, self.words)
        made.maker = weakref.ref(self)
        return made

    def hasHtmlOutputs(self) -> bool:
        """Whether the last run has written a page, which the dialog then points to."""
        return self.has_page

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
        page = language.file(f"help/{self.tool['id']}", ".html")
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
            if field["type"] == "folder":
                for page in delivery.pages(field):
                    self.addOutput(page)
            if "suffixes" in field and field["many"]:
                name, label = (
                    field["name"].upper() + FILES,
                    language.text("{label}, files").format(label=field["label"]),
                )
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
            many = "problem" if len(lines) == 1 else "problems"
            return False, "\n".join([f"{self.tool['id']}: {len(lines)} {many}", *lines])
        for name, made in definitions.items():
            value = parameters.get(name)
            if not is_plain(value) and not made.checkValueIsAcceptable(value, context):
                return False, (language.text("Incorrect value: {label}")).format(
                    label=made.description()
                )
        return True, ""

    def processAlgorithm(self, parameters: Any, context: Any, feedback: Any) -> dict[str, Any]:
        read = Reader(self, self.tool["inputs"], parameters, context, feedback)
        given = [(field, read.input(field)) for field in self.tool["inputs"]]
        given += self._written(read, {field["name"]: value for field, value in given})
        kept = delivery.decided(self.tool, parameters)
        given = [
            (f, v)
            for f, v in given
            if v is not UNSET and (f["name"] in kept or not self._is_default(f, v, read))
        ]
        given = self._without_idle_head(given, feedback)
        values = {field["name"]: value for field, value in given if not field.get("option")}
        options = ["--overwrite"]  # the dialog has asked
        for field, value in given:
            options += option_words(field, value) if field.get("option") else []
        places = {f["name"]: v for f, v in given}
        try:
            # Without a window the words are those of the command line.
            words = self.in_words_of_the_dialog if qgis.utils.iface else str
            result = bridge.run(self.tool["id"], options, values, feedback, words)
        except QgsProcessingException as err:
            self._drop_what_was_not_made({}, places, context)
            return self._without_result(err, feedback)
        shown = {f["name"]: _path(v) for f, v in given if f.get("option") and "suffixes" in f}
        shown = {name: path for name, path in shown.items() if os.path.exists(path)}
        result |= shown
        made_from = _stem(values, self.tool["inputs"])
        stylers = self._drop_what_was_not_made(result, places, context, made_from)
        self._tell(result, feedback)
        handed_over, more = self._handed_over(result, places, context)
        arrange([*stylers, *more], ": ".join(filter(None, (self.displayName(), made_from))))
        found = dict(self._results(result, places)) | handed_over
        pages = [name for name, path in found.items() if str(path).endswith(".html")]
        self.has_page = bool(pages) or any(name.endswith(delivery.README) for name in found)
        if dialog := self.maker and self.maker():
            dialog.has_page = self.has_page
        return found

    def _written(self, read: Reader, values: dict[str, Any]) -> list[tuple[dict[str, Any], Any]]:
        """The outputs and their places.

        What is handed over has no temporary file besides, nor has what an input that was not given
        is needed for: the dialog asks for all results of a model, and its user for none of these.
        """
        writes = [field for field in self.tool["outputs"] if not is_value(field)]
        folder = delivery.folder_of(self.tool)
        handed = folder and not is_missing(read.parameters.get(folder["name"].upper()))
        inside = delivery.names(folder) if folder and handed else set()
        inside |= {field["name"] for field in writes if not self._is_made(field, values)}
        skipped = {name for name in inside if read.is_temporary(name.upper())}
        return [(f, read.output(f)) for f in writes if f["name"] not in skipped]

    def _without_idle_head(self, given: Given, feedback: Any) -> Given:
        """What is given, without title and client where no report is written to say them."""
        if any(_holds_report(field) for field, _ in given):
            return given
        idle = [field for field, _ in given if field.get("option") in HEAD]
        for field in idle:
            text = language.text("{label}: not used, as no report is written")
            feedback.pushInfo(text.format(label=field["label"]))
        return [(field, value) for field, value in given if field not in idle]

    def _is_made(self, field: dict[str, Any], values: dict[str, Any]) -> bool:
        """Whether a run with these inputs makes an output."""
        defaults = {f["name"]: f.get("default") for f in self.tool["inputs"]}
        known = defaults | {name: v for name, v in values.items() if v is not UNSET}
        conditions = field.get("made_if")
        return conditions is None or any(_holds(one, known[one["input"]]) for one in conditions)

    def _handed_over(
        self, result: dict[str, Any], places: dict[str, Any], context: Any
    ) -> tuple[dict[str, Any], list[Styler]]:
        """The files of the set that is handed over by the names of QGIS; its layers are loaded."""
        field = delivery.folder_of(self.tool)
        if field is None or field["name"] not in result:
            return {}, []
        folder, inside = result[field["name"]], delivery.names(field)
        id = f"{bridge.PROVIDER}:{self.name()}"
        made = delivery.load(field, folder, inside & places.keys(), id, self.colours, context)
        found = {n.upper(): result[n] for n in inside - places.keys() if result.get(n)}
        return found | delivery.pages_in(field, folder), made

    def _is_default(self, field: dict[str, Any], value: Any, read: Reader) -> bool:
        """Whether a value is that of the tool itself: nobody has set it, and nothing is told of it.

        The dialog hands on all of its boxes, those too that were not touched.
        """
        default = field.get("default", UNSET)
        if default is UNSET or field.get("option"):
            return False
        own = {field["name"].upper(): default}
        again = Reader(self, self.tool["inputs"], own, read.context, read.feedback)
        return bool(value == again.input(field))

    def _tell(self, result: dict[str, Any], feedback: Any) -> None:
        """Say each number with its unit, and where points are that this QGIS cannot show."""
        for field in self.tool["outputs"]:
            value = result.get(field["name"])
            if value is None:
                continue
            if is_value(field):
                shown = f"{value:.6g}" if isinstance(value, float) else value
                shown = f"{100 * value:.4g} %" if field.get("share") else shown
                feedback.pushInfo(f"{field['label']}: {shown}")
            elif field["type"] == "pointcloud" and not opens_points(str(value)):
                text = language.text(
                    "{label}: written to {path}. This QGIS was built without PDAL and cannot show "
                    "points; the tools read them."
                )
                feedback.pushInfo(text.format(label=field["label"], path=value))

    def _without_result(self, err: QgsProcessingException, feedback: Any) -> dict[str, Any]:
        """Say in the words of the dialog why there is no result; one that was stopped is no error.

        Without a window the words are those of the command line, and an empty result would count
        as success.
        """
        if qgis.utils.iface is None:
            raise err
        if isinstance(err, bridge.Cancelled):
            feedback.pushInfo(language.text("Cancelled: no result was written."))
            return {}
        raise QgsProcessingException(self.in_words_of_the_dialog(str(err))) from None

    def in_words_of_the_dialog(self, text: str) -> str:
        """Put the labels of the dialog for the options and names of the command line.

        Names of boxes of other tools, as of the steps of a model, have their labels there.
        """
        own = {f["name"]: f["label"] for f in self.tool["inputs"] + self.tool["outputs"]}
        labels = {name: f"“{label}”" for name, label in {**self.words, **own}.items()}

        def label(found: re.Match[str]) -> str:
            return labels.get(found[2].replace("-", "_"), found[0])

        text = re.sub(r"(--)([a-z][a-z_-]*[a-z])", label, text)
        crs = labels.get("assume_crs", "")
        text = text.replace(f"state it with {crs}", f"choose it in {crs}:")
        text = text.replace(f", or {crs} local", ", or local")
        text = re.sub(r"(`)([a-z_0-9.]+)`", label, text)
        first = r"(?m)(^  (?=\w+[.:])|^(?=\w+:))([a-z_0-9]+)"  # of a line
        text = re.sub(first, lambda m: m[1] + label(m).lstrip(), text)
        # A name of two words, or the id of a tool, is no word of a sentence; in a path it stays.
        name = r"(?<![\w./\\-])()([a-z]+(?:[._][a-z0-9]+)+)(?![\w./\\-]*[\w/\\])"
        return re.sub(name, label, text)

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
        self, result: dict[str, Any], places: dict[str, Any], context: Any, made_from: str = ""
    ) -> list[Styler]:
        """Load no layer of ours that was not written, and give what colours the others, in order.

        Those without a name of the user are called after what they were made from. The list of
        layers to load is that of a whole model, with those of its other steps, which stay as they
        are.
        """
        outputs = [f for f in self.tool["outputs"] if f["type"] in TYPES]
        planned = {_same(_path(places.get(f["name"]))): f for f in outputs}
        made = {_same(result.get(f["name"])) for f in outputs}
        loads = context.layersToLoadOnCompletion()
        lost = [path for path in loads if _same(path) in planned.keys() - made]
        context.setLayersToLoadOnCompletion({p: loads[p] for p in loads if p not in lost})
        stylers = {}
        for path in loads.keys() - lost:
            if field := planned.get(_same(path)):
                details = context.layerToLoadOnCompletionDetails(path)
                if made_from and details.name == field["label"]:
                    details.name = f"{details.name}: {made_from}"
                mine = (f"{bridge.PROVIDER}:{self.name()}", field["name"].upper())
                stylers[field["name"]] = Styler.of(self.colours, field, mine)
                details.setPostProcessor(stylers[field["name"]])
        return [stylers[f["name"]] for f in outputs if f["name"] in stylers]


def _holds(condition: dict[str, Any], value: Any) -> bool:
    """Whether an input has the word that a step waits for, or is on or given."""
    if condition["is"] is not None:
        return bool(value == condition["is"])
    return value is not None and value is not False


def _holds_report(field: dict[str, Any]) -> bool:
    """Whether a result is a report, or a set with one."""
    return field["type"] == "folder" or ".html" in field.get("suffixes", ())


def option_words(field: dict[str, Any], value: Any) -> list[str]:
    """The words of the command line for an option of a run."""
    word = f"--{field['option'].replace('_', '-')}"
    if field["type"] == "boolean":
        return [word] if str(value).lower() in ("true", "yes", "1") else []
    return [] if value is None else [word, str(value)]


def _stem(values: dict[str, Any], inputs: list[dict[str, Any]]) -> str:
    """The name of the file, or the first one, that a run reads; empty for temporary ones."""
    given = (values.get(field["name"]) for field in inputs if field["type"] in TYPES)
    first = next((value for value in given if value), "")
    first = _path(first[0] if isinstance(first, list) else first)
    temporary = os.path.realpath(QgsProcessingUtils.tempFolder())
    if not first or os.path.realpath(first).startswith(temporary):
        return ""
    return os.path.basename(os.path.normpath(first)).partition(".")[0]


def _same(source: Any) -> str:
    """Normalise the path of a layer, so that those of the tool and of QGIS are equal."""
    if not isinstance(source, str):
        return ""
    path = source.removeprefix("ogr:dbname='").partition("' table=")[0]
    return os.path.normcase(os.path.realpath(path))


def _path(value: Any) -> Any:
    return value["path"] if isinstance(value, dict) else value
