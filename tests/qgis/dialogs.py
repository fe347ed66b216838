"""Opens the dialog of each tool in QGIS, without a screen, and reads what it holds.

``dialogs.py PROFILE CLOUD RASTER FEATURES FOLDER`` prints JSON: by tool what differs from the
defaults. Into FOLDER go models of one tool each, as the model designer makes them of its untouched
dialog.
``dialogs.py PROFILE --picture FILE.png TOOL NAME=VALUE ...`` draws the dialog of one tool.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

PROFILE, *WORDS = sys.argv[1:]
PYTHON = os.environ.get("QGIS_PYTHON", "/usr/share/qgis/python")
sys.path[:0] = [PYTHON, f"{PYTHON}/plugins", str(Path(PROFILE) / "python" / "plugins")]

import qgis.utils  # noqa: E402
from qgis.core import (  # noqa: E402
    QgsApplication,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingModelAlgorithm,
)
from qgis.gui import QgsMapCanvas, QgsMessageBar  # noqa: E402
from qgis.PyQt.QtCore import QTimer  # noqa: E402
from qgis.PyQt.QtWidgets import QMainWindow  # noqa: E402

app = QgsApplication([], True)
app.initQgis()
window = QMainWindow()
canvas = QgsMapCanvas(window)


class Interface:
    """As much of the window of QGIS as the dialogs ask for."""

    def mainWindow(self) -> Any:
        return window

    def mapCanvas(self) -> Any:
        return canvas

    def messageBar(self) -> Any:
        return QgsMessageBar(window)

    def __getattr__(self, name: str) -> Any:
        return lambda *args, **more: None


qgis.utils.iface = Interface()

from lidar_toolbox import parameters  # noqa: E402
from lidar_toolbox.layers import is_missing  # noqa: E402
from lidar_toolbox.plugin import Provider  # noqa: E402
from lidar_toolbox.settings import OptionsFactory, base_python  # noqa: E402
from lidar_toolbox.values import UNSET, Reader  # noqa: E402
from lidar_toolbox.widgets import use  # noqa: E402
from processing.core.Processing import Processing  # noqa: E402
from processing.gui.AlgorithmDialog import AlgorithmDialog  # noqa: E402
from processing.gui.BatchAlgorithmDialog import BatchAlgorithmDialog  # noqa: E402
from processing.modeler.ModelerParametersDialog import ModelerParametersDialog  # noqa: E402

for module in list(sys.modules.values()):  # which have taken the window when there was none
    if getattr(module, "__name__", "").startswith("processing") and hasattr(module, "iface"):
        module.iface = qgis.utils.iface
Processing.initialize()
use()
provider = Provider()
QgsApplication.processingRegistry().addProvider(provider)


def differences(algorithm: Any, given: dict[str, str]) -> list[str]:
    """What an untouched dialog would send that is not the default."""
    dialog = AlgorithmDialog(algorithm, False, window)
    dialog.setParameters(given)
    values = dialog.createProcessingParameters()
    tool, feedback = algorithm.tool, QgsProcessingFeedback()
    ctx = QgsProcessingContext()
    read = Reader(algorithm, tool["inputs"], values, ctx, feedback)
    found = []
    for field in tool["inputs"]:
        value, default = read.input(field), field.get("default")
        if field["required"]:
            default = given[field["name"].upper()]
        if isinstance(value, list) and isinstance(default, str):
            value = ";".join(map(str, value))
        if value != (UNSET if default in (None, "") else default):
            found.append(f"{field['name']}: {value!r} and not {default!r}")
    for field in tool["outputs"]:
        if not parameters.is_value(field):
            written = not is_missing(values.get(field["name"].upper()))
            if written != bool(field.get("first")):
                found.append(f"{field['name']}: written {written}")
    return found


def check() -> None:
    cloud, raster, features, folder = WORDS
    layers = {"pointcloud": cloud, "raster": raster, "vector": features, "table": features}
    layers |= {"crs": "EPSG:32635"}
    found = {}
    for each in provider.algorithms():
        algorithm = each.create()
        needed = [field for field in algorithm.tool["inputs"] if field["required"]]
        given = {field["name"].upper(): layers[field["type"]] for field in needed}
        found[algorithm.tool["id"]] = differences(algorithm, given)
        BatchAlgorithmDialog(each.create(), window)
        design(each.create(), Path(folder) / f"{each.name()}.model3")
    found["settings page"] = settings_page()
    print("RESULT " + json.dumps(found), flush=True)
    os._exit(0)


def design(algorithm: Any, path: Path) -> None:
    """Write a model of one step."""
    model = QgsProcessingModelAlgorithm(algorithm.name(), "tests")
    model.setProvider(QgsApplication.processingRegistry().providerById("model"))
    model.addChildAlgorithm(ModelerParametersDialog(algorithm, model).createAlgorithm())
    assert model.toFile(str(path))


def settings_page() -> list[str]:
    """What is wrong with it: it must name the Python of the tools, and know what it has."""
    page = OptionsFactory().createWidget(window)
    named = page.found.text()
    page.test()
    wrong = [] if "lidar-toolbox " in page.found.text() else [page.found.text()]
    page.python.setFilePath("/no/python")
    page.test()
    wrong += [] if "No Python environment" in page.found.text() else [page.found.text()]
    page.python.setFilePath("")
    page.apply()
    wrong += [] if page.found.text() and "python" in named else [named]
    try:
        wrong += [] if os.access(base_python(), os.X_OK) else ["no Python for an environment"]
    except RuntimeError as err:  # there need not be one, but it says what to do
        wrong += [] if "install one" in str(err) else [str(err)]
    return wrong


def picture(place: str, tool: str, *values: str) -> None:
    algorithm = provider.algorithm(tool).create()
    dialog = AlgorithmDialog(algorithm, False, window)
    dialog.setParameters(dict(text.split("=", 1) for text in values))
    dialog.resize(860, 620)
    dialog.show()

    def save() -> None:
        dialog.grab().save(place)
        os._exit(0)

    QTimer.singleShot(1500, save)
    app.exec()


if WORDS[0] == "--picture":
    picture(*WORDS[1:])
else:
    check()
