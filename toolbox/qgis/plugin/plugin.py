"""The plugin and its provider, which reads the list of tools from tools.json."""

from __future__ import annotations

import json
import traceback
from pathlib import Path
from typing import Any

from qgis.core import Qgis, QgsApplication, QgsMessageLog, QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon

from . import bridge, language
from .algorithm import ToolAlgorithm
from .parameters import definition

HERE = Path(__file__).parent
NAME = "LiDAR Toolbox"
SCHEMA = 1  # of tools.json


class Plugin:
    """The class that QGIS loads; qgis_process calls only `initProcessing`."""

    def __init__(self, iface: Any) -> None:
        self.iface = iface
        self.provider: Any = None
        self.options: Any = None

    def initProcessing(self) -> None:
        self.provider = Provider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self) -> None:
        from .settings import OptionsFactory

        try:
            from .widgets import use

            use()
        except ImportError as err:  # a QGIS whose dialogs take no widgets of Python
            say(f"The dialogs show the widgets of QGIS: {err}")
        self.options = OptionsFactory()
        self.iface.registerOptionsWidgetFactory(self.options)
        self.initProcessing()

    def unload(self) -> None:
        if self.provider is not None:
            QgsApplication.processingRegistry().removeProvider(self.provider)
        if self.options is not None:
            self.iface.unregisterOptionsWidgetFactory(self.options)


class Provider(QgsProcessingProvider):
    """The provider of all tools in tools.json. It starts no other program."""

    def __init__(self) -> None:
        super().__init__()
        self.listed = read_tools()

    def id(self) -> str:
        return bridge.PROVIDER

    def name(self) -> str:
        return NAME

    def longName(self) -> str:
        return f"{NAME} {self.versionInfo()}"

    def versionInfo(self) -> str:
        return str(self.listed["toolbox"])

    def icon(self) -> Any:
        return QIcon(self.svgIconPath())

    def svgIconPath(self) -> str:
        return str(HERE / "icon.svg")

    def supportsNonFileBasedOutput(self) -> bool:
        return False

    def defaultVectorFileExtension(self, hasGeometry: bool = True) -> str:
        return "gpkg"

    def defaultRasterFileExtension(self) -> str:
        return "tif"

    def defaultPointCloudFileExtension(self) -> str:
        return "laz"

    def supportedOutputVectorLayerExtensions(self) -> list[str]:
        return self._suffixes("vector", "gpkg") + self._suffixes("table", "csv")

    def supportedOutputTableExtensions(self) -> list[str]:
        return self._suffixes("table", "gpkg")

    def supportedOutputRasterLayerExtensions(self) -> list[str]:
        return self._suffixes("raster", "tif")

    def supportedOutputPointCloudLayerExtensions(self) -> list[str]:
        return self._suffixes("pointcloud", "laz")

    def _suffixes(self, type: str, first: str) -> list[str]:
        """The file endings of all outputs of a type, without the dot; the usual one first."""
        outputs = [out for tool in self.listed["tools"] for out in tool["outputs"]]
        found = [s[1:] for out in outputs if out["type"] == type for s in out["suffixes"]]
        return list(dict.fromkeys([first, *found]))

    def loadAlgorithms(self) -> None:
        words = words_of(self.listed["tools"])
        for tool in self.listed["tools"]:
            try:  # an error within initAlgorithm would end QGIS; here one tool is left out
                for field in tool["inputs"] + tool["outputs"]:
                    definition(field)
                self.addAlgorithm(ToolAlgorithm(tool, self.listed["colours"], words))
            except Exception:
                say(f"{tool.get('id')} is left out\n{traceback.format_exc()}")


def words_of(tools: list[dict[str, Any]]) -> dict[str, str]:
    """The title of each tool by its id, and the label of each name that has one everywhere.

    Names that are a word of a sentence, too, such as "points", are left out.
    """
    labels: dict[str, set[str]] = {}
    for field in (field for tool in tools for field in tool["inputs"] + tool["outputs"]):
        labels.setdefault(field["name"], set()).add(field["label"])
    sure = {name: label for name, (label, *more) in labels.items() if "_" in name and not more}
    return sure | {tool["id"]: tool["title"] for tool in tools}


def read_tools() -> dict[str, Any]:
    """Read the list of tools; if it cannot be used, log a message and give an empty one."""
    nothing: dict[str, Any] = {"toolbox": "", "colours": {}, "tools": []}
    try:
        listed: dict[str, Any] = json.loads(
            language.file("tools", ".json").read_text(encoding="utf-8")
        )
    except (OSError, ValueError) as err:
        say(f"tools.json cannot be read: {err}; run: python -m toolbox qgis install")
        return nothing
    if listed.get("schema") != SCHEMA:
        say("tools.json is of another version; run: python -m toolbox qgis install")
        return nothing
    return listed


def say(text: str) -> None:
    QgsMessageLog.logMessage(text, NAME, Qgis.MessageLevel.Critical)
