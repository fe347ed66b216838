"""What a person does in the window of QGIS, with the mouse and the keyboard.

QGIS runs it (``qgis --code person.py``) with TOOLBOX_PERSON naming a JSON file: the folder for
pictures and results, the data, and the scenarios to play. Each scenario is a generator that yields
what to wait for: a function that becomes true. So windows that wait for an answer do not stop it.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import processing
from qgis.core import QgsApplication, QgsProject
from qgis.PyQt.QtCore import QPoint, Qt, QTimer
from qgis.PyQt.QtTest import QTest
from qgis.PyQt.QtWidgets import (
    QAbstractButton,
    QApplication,
    QDialog,
    QDockWidget,
    QFileDialog,
    QLineEdit,
    QMessageBox,
    QScrollArea,
    QTabWidget,
    QToolButton,
    QTreeView,
    QWidget,
)
from qgis.utils import iface

SAYS = json.loads(Path(os.environ["TOOLBOX_PERSON"]).read_text("utf-8"))
FOLDER = Path(SAYS["folder"])
PATIENCE = 90.0  # seconds for one step
DIALOG = (860, 760)  # pixels of the dialog that the docs show
Wait = Callable[[], Any]
Play = Iterator[Wait]


# Hands and eyes ----------------------------------------------------------------------------------


def picture(name: str, widget: QWidget | None = None, height: int = 0) -> None:
    """Keep a picture of a window, or of its upper part."""
    seen = (widget or iface.mainWindow()).grab()
    seen = seen.copy(0, 0, seen.width(), height or seen.height())
    seen.save(str(FOLDER / f"{name}.png"))


def windows(kind: type) -> list[Any]:
    return [w for w in QApplication.topLevelWidgets() if isinstance(w, kind) and w.isVisible()]


def named(kind: str) -> Any:
    """The open dialog whose class has this name."""
    return next((w for w in windows(QDialog) if type(w).__name__ == kind), None)


def click(button: QWidget) -> None:
    assert button is not None, "there is no such button"  # QTest would end QGIS
    QTest.mouseClick(button, Qt.MouseButton.LeftButton)


def click_later(button: QWidget) -> None:
    """Click what opens a window that waits."""
    QTimer.singleShot(0, lambda: click(button))


def button(within: QWidget, text: str) -> Any:
    found = [b for b in within.findChildren(QAbstractButton) if text in b.text().replace("&", "")]
    return next((b for b in found if b.isVisible()), None)


def write(line: QLineEdit, text: str) -> None:
    line.setFocus()
    line.selectAll()
    if text.isascii():
        QTest.keyClicks(line, text)
    else:  # as from the clipboard: QTest has no such keys
        line.insert(text)
    QTest.keyClick(line, Qt.Key.Key_Tab)


def toolbox() -> Any:
    dock = iface.mainWindow().findChild(QDockWidget, "ProcessingToolbox")
    dock.setUserVisible(True)
    return dock


def search(text: str) -> Play:
    """Search in the Processing toolbox."""
    dock = toolbox()
    dock.resize(420, 700)
    write(dock.searchBox, text)
    yield lambda: dock.searchBox.value() == text
    end = time.monotonic() + 1.0
    yield lambda: time.monotonic() > end


def found() -> list[tuple[str, str, Any]]:
    """The group, title and place of what the toolbox shows of ours."""
    tree: QTreeView = toolbox().algorithmTree
    model = tree.model()
    rows = []

    def walk(parent: Any, groups: list[str]) -> None:
        for row in range(model.rowCount(parent)):
            index = model.index(row, 0, parent)
            if model.rowCount(index):
                walk(index, [*groups, index.data()])
            elif groups[:1] == ["LiDAR Toolbox"]:
                rows.append((groups[-1], index.data(), index))

    walk(tree.rootIndex(), [])
    return rows


def opened(title: str, by: str = "") -> Play:
    """Open the dialog of a tool with a double click."""
    yield from search(by or title)
    index = next(place for _, name, place in found() if name == title)
    tree: QTreeView = toolbox().algorithmTree
    tree.scrollTo(index)
    spot = tree.visualRect(index).center()
    QTest.mouseClick(tree.viewport(), Qt.MouseButton.LeftButton, pos=spot)
    QTimer.singleShot(
        0, lambda: QTest.mouseDClick(tree.viewport(), Qt.MouseButton.LeftButton, pos=QPoint(spot))
    )
    yield lambda: named("AlgorithmDialog")


def row_of(dialog: Any, name: str) -> Any:
    """The widget of a parameter."""
    wrapper = dialog.mainWidget().wrappers[name]
    return getattr(wrapper, "widget", None) or wrapper.wrappedWidget()


def pick(dialog: Any, files: list[str], shows: list[str]) -> Play:
    """Choose files in a file dialog, after a look at what its filter shows."""
    yield lambda: windows(QFileDialog)
    chooser = windows(QFileDialog)[0]
    chooser.setDirectory(str(Path(files[0]).parent))
    view = chooser.findChild(QTreeView, "treeView")

    def seen() -> list[str]:
        root = view.rootIndex()
        model = view.model()
        return [model.index(n, 0, root).data() for n in range(model.rowCount(root))]

    yield lambda: set(shows) <= set(seen())
    picture("file dialog", chooser)
    text = " ".join(f'"{Path(file).name}"' for file in files) if len(files) > 1 else files[0]
    line = chooser.findChild(QLineEdit, "fileNameEdit")
    write(line, text)
    QTimer.singleShot(0, lambda: QTest.keyClick(line, Qt.Key.Key_Return))
    yield lambda: not windows(QFileDialog)


def run(dialog: Any) -> Play:
    """Press Run and wait until the tool has ended."""
    click_later(dialog.runButton())
    yield (
        lambda: (
            (ended(dialog) and dialog.runButton().isEnabled())
            or windows(QMessageBox)
            or bar(dialog)
        )
    )


def ended(dialog: Any) -> bool:
    text = log(dialog)
    return text.rstrip().endswith("finished") or "HTML output" in text


def log(dialog: Any) -> str:
    from qgis.PyQt.QtWidgets import QTextEdit

    return "\n".join(edit.toPlainText() for edit in dialog.findChildren(QTextEdit))


def bar(dialog: Any) -> str:
    item = dialog.messageBar().currentItem()
    return item.text() if item else ""


def layers() -> dict[str, Any]:
    """The layers of the project by the names that the tree shows."""
    return {layer.name(): layer for layer in QgsProject.instance().mapLayers().values()}


def look(dialog: Any, tab: int) -> None:
    tabs = dialog.findChild(QTabWidget)
    tabs.setCurrentIndex(tab)


def over(dialog: Any) -> Play:
    dialog.close()
    dialog.deleteLater()
    yield lambda: not windows(QDialog)


# Scenarios ---------------------------------------------------------------------------------------


def play_first_raster() -> Play:
    """Search "dtm", open the dialog, choose a LAZ by the filter, run, see the layer."""
    yield from search("dtm")
    titles = [title for _, title, _ in found()]
    assert "Terrain and surface models" in titles, titles
    assert "Grid points to a raster" in titles, titles
    picture("search dtm")
    picture("toolbox", toolbox(), height=340)  # docs/images/qgis-toolbox.png
    yield from opened("Grid points to a raster", "dtm")
    dialog = named("AlgorithmDialog")
    points = row_of(dialog, "POINTS")
    click_later(button(points, "Files"))
    yield from pick(dialog, [SAYS["cloud"]], [Path(SAYS["cloud"]).name])
    assert dialog.mainWidget().wrappers["POINTS"].widgetValue() == SAYS["cloud"]
    picture("dialog", dialog)
    yield from run(dialog)
    look(dialog, 1)
    picture("log", dialog)
    assert "Execution completed" in log(dialog), log(dialog)
    assert "HTML output" not in log(dialog)
    (layer,) = layers().values()
    assert layer.isValid()
    assert layer.renderer().type() == "singlebandpseudocolor", layer.renderer().type()
    yield from over(dialog)
    iface.mapCanvas().zoomToFullExtent()
    yield lambda: not iface.mapCanvas().isDrawing()
    end = time.monotonic() + 2
    yield lambda: time.monotonic() > end
    picture("canvas")
    SAYS.setdefault("notes", {})["first raster"] = layer.name()


def play_save_dialog() -> Play:
    """The dialog in which a result is saved offers what it can be written as."""
    yield from opened("Alpha shapes", "hull")
    dialog = named("AlgorithmDialog")
    place = row_of(dialog, "OUTLINES").findChild(QToolButton)
    place.menu().aboutToShow.emit()
    action = next(a for a in place.menu().actions() if "Save to File" in a.text())
    QTimer.singleShot(0, action.trigger)
    yield lambda: windows(QFileDialog)
    chooser = windows(QFileDialog)[0]
    picture("save dialog", chooser)
    filters = chooser.nameFilters()
    assert any("*.dxf" in text for text in filters), filters
    assert not any("*.json" in text for text in filters), filters
    QTimer.singleShot(0, chooser.reject)
    yield lambda: not windows(QFileDialog)
    yield from over(dialog)


def play_scan_without_crs() -> Play:
    """A scan without a CRS: the message names the widget beside the points, which helps."""
    yield from opened("Remove noise", "outlier")
    dialog = named("AlgorithmDialog")
    write(row_of(dialog, "POINTS").box.lineEdit(), SAYS["scan"])
    yield from run(dialog)
    assert "Execution failed" in log(dialog), log(dialog)
    assert "“CRS, if the file states none”" in log(dialog), log(dialog)
    assert "--assume-crs" not in log(dialog).split("has no CRS")[1].split("\n")[0]
    look(dialog, 1)
    picture("scan without crs, message", dialog)
    look(dialog, 0)
    box = row_of(dialog, "ASSUME_CRS").box
    box.setFocus()
    box.setCurrentIndex(box.findData("local:mm"))
    picture("scan without crs, dialog", dialog)
    yield from again(dialog)
    yield from run(dialog)
    assert "Execution completed" in log(dialog), log(dialog)
    yield from over(dialog)


def again(dialog: Any) -> Play:
    """Wait until Run can be pressed, and clear the log."""
    yield dialog.runButton().isEnabled
    from qgis.PyQt.QtWidgets import QTextEdit

    for edit in dialog.findChildren(QTextEdit):
        edit.clear()


def play_folder_and_several_files() -> Play:
    yield from opened("Information about points", "density")
    dialog = named("AlgorithmDialog")
    points = row_of(dialog, "POINTS")
    click_later(button(points, "Folder"))
    yield lambda: windows(QFileDialog)
    chooser = windows(QFileDialog)[0]
    write(chooser.findChild(QLineEdit, "fileNameEdit"), SAYS["survey"])
    QTimer.singleShot(0, lambda: click(button(chooser, "Choose")))
    yield lambda: not windows(QFileDialog)
    yield lambda: dialog.mainWidget().wrappers["POINTS"].widgetValue() == SAYS["survey"]
    yield from run(dialog)
    assert "Execution completed" in log(dialog), log(dialog)
    picture("folder", dialog)
    yield from over(dialog)
    yield from opened("Merge points", "merge")
    dialog = named("AlgorithmDialog")
    click_later(button(row_of(dialog, "POINTS"), "Files"))
    yield from pick(dialog, SAYS["tiles"], [Path(tile).name for tile in SAYS["tiles"]])
    yield lambda: dialog.mainWidget().wrappers["POINTS"].widgetValue() == SAYS["tiles"]
    look(dialog, 0)
    picture("several files", dialog)
    yield from run(dialog)
    assert "Execution completed" in log(dialog), log(dialog)
    yield from over(dialog)


def play_classes_by_name() -> Play:
    """Classes are ticked in a list; one that has no name, typed before, stays."""
    yield from opened("Grid points to a raster", "idw")
    dialog = named("AlgorithmDialog")
    write(row_of(dialog, "POINTS").box.lineEdit(), SAYS["cloud"])
    classes = row_of(dialog, "CLASSES")
    write(classes.box.lineEdit(), "6,70-71")
    click_later(button(classes, "Choose"))
    yield lambda: named("TickDialog")
    chooser = named("TickDialog")
    picture("classes", chooser)
    assert chooser.ticked() == [6, 70, 71], chooser.ticked()
    names = [chooser.list.item(n).text() for n in range(chooser.list.count())]
    ground = chooser.list.item(names.index("2  Ground"))
    ground.setCheckState(Qt.CheckState.Checked)
    QTimer.singleShot(0, lambda: click(button(chooser, "OK")))
    yield lambda: not named("TickDialog")
    assert dialog.mainWidget().wrappers["CLASSES"].widgetValue() == "2,6,70,71"
    yield from run(dialog)
    assert "Execution completed" in log(dialog), log(dialog)
    yield from over(dialog)


def play_cancel() -> Play:
    yield from opened("Make a sample survey", "sample")
    dialog = named("AlgorithmDialog")
    dialog.setParameters({"KIND": "town", "DENSITY": 60.0, "SIZE": 800.0})
    click_later(dialog.runButton())
    began = time.monotonic()
    yield lambda: time.monotonic() > began + 4
    asked = time.monotonic()
    click(dialog.cancelButton())
    yield lambda: ended(dialog)
    SAYS.setdefault("notes", {})["cancel took"] = round(time.monotonic() - asked, 1)
    look(dialog, 1)
    picture("cancelled", dialog)
    assert "Cancelled" in log(dialog), log(dialog)
    assert "exit code" not in log(dialog)
    yield from over(dialog)


def play_model_of_four() -> Play:
    """A model of the toolbox: all its rasters are loaded, named and coloured."""
    before = set(QgsProject.instance().mapLayers())
    yield from opened("Terrain and surface models", "dtm")
    dialog = named("AlgorithmDialog")
    points = row_of(dialog, "POINTS").box.lineEdit()
    write(points, "/data/town.laz")
    dialog.resize(*DIALOG)
    yield lambda: dialog.width() == DIALOG[0]
    picture("model dialog", dialog)  # docs/images/qgis-dialog.png
    write(points, SAYS["cloud"])
    yield from run(dialog)
    assert "Execution completed" in log(dialog), log(dialog)
    made = {i: lay for i, lay in QgsProject.instance().mapLayers().items() if i not in before}
    names = sorted(layer.name() for layer in made.values())
    SAYS.setdefault("notes", {})["model of four"] = names
    assert len(names) == 4, names
    styles = {lay.name(): lay.renderer().type() for lay in made.values()}
    assert "singlebandgray" in styles.values(), styles
    assert list(styles.values()).count("singlebandpseudocolor") == 3, styles
    nodes = [QgsProject.instance().layerTreeRoot().findLayer(one) for one in made]
    assert [node.name() for node in nodes if node.isVisible()] == ["Terrain (DTM): punkte"]
    (group,) = {node.parent().name() for node in nodes}
    assert group == "Terrain and surface models: punkte", group
    order = [node.name().partition(" ")[0] for node in nodes[0].parent().findLayers()]
    assert order == ["Terrain", "Surface", "Object", "Intensity:"], order
    yield from over(dialog)
    end = time.monotonic() + 2
    yield lambda: time.monotonic() > end
    picture("model canvas")


def play_exported_model() -> Play:
    """The same as a model of the designer: all four rasters, with short names and colours."""
    from qgis.core import QgsProcessingModelAlgorithm

    before = set(QgsProject.instance().mapLayers())
    model = QgsProcessingModelAlgorithm()
    assert model.fromFile(SAYS["model"])
    model.setProvider(QgsApplication.processingRegistry().providerById("model"))
    dialog = processing.createAlgorithmDialog(model, {"POINTS": SAYS["cloud"], "CELL": 2.0})
    dialog.show()
    yield from run(dialog)
    assert "Execution completed" in log(dialog), log(dialog)
    picture("exported model", dialog)
    made = [lay for i, lay in QgsProject.instance().mapLayers().items() if i not in before]
    names = sorted(layer.name() for layer in made)
    SAYS.setdefault("notes", {})["exported model"] = names
    assert len(names) == 4, names
    assert all(len(name) <= 30 for name in names), names
    kinds = [layer.renderer().type() for layer in made]
    assert kinds.count("singlebandpseudocolor") == 3, kinds
    yield from over(dialog)


def play_batch_of_three() -> Play:
    """Three files in a table; each has its own result."""
    from processing.gui.BatchAlgorithmDialog import BatchAlgorithmDialog

    algorithm = QgsApplication.processingRegistry().createAlgorithmById("lidartoolbox:surfacegrid")
    dialog = BatchAlgorithmDialog(algorithm, iface.mainWindow())
    dialog.show()
    panel = dialog.mainWidget()
    files = [SAYS["cloud"], *SAYS["tiles"]]
    for _ in files[1:]:
        panel.addRow()
    for row, file in enumerate(files):
        write(panel.wrappers[row][0].widget.box.lineEdit(), file)
        column = panel.tblParameters.columnCount() - 4  # before the plot, the report and counts
        place = str(FOLDER / f"batch {row}.tif")
        panel.tblParameters.cellWidget(row + 1, column).setValue(place)
    picture("batch", dialog)
    click_later(dialog.runButton())
    yield lambda: "Batch execution completed" in log(dialog)
    picture("batch log", dialog)
    assert all((FOLDER / f"batch {row}.tif").exists() for row in range(3)), log(dialog)
    yield from over(dialog)


def play_tiles() -> Play:
    """A survey in tiles from the dialog, which tells how many are done."""
    yield from opened("Grid points to a raster", "tile")
    dialog = named("AlgorithmDialog")
    given = {"POINTS": SAYS["survey"], "TILE": "30", "MAX_GAP": 5.0, "WORKERS": 1}
    dialog.setParameters(given)
    said = set()
    click_later(dialog.runButton())

    def done() -> bool:
        said.add(dialog.progressBar().format() if hasattr(dialog, "progressBar") else "")
        return ended(dialog)

    yield done
    look(dialog, 1)
    picture("tiles", dialog)
    assert "Execution completed" in log(dialog), log(dialog)
    assert "Tiles: " in log(dialog), log(dialog)
    yield from over(dialog)


def play_page_of_results() -> Play:
    """A report is announced where there is one, and the viewer of results has it."""
    from processing.core.ProcessingResults import resultsList

    before = len(resultsList.getResults())
    yield from opened("Information about points", "density")
    dialog = named("AlgorithmDialog")
    dialog.setParameters({"POINTS": SAYS["cloud"], "PAGE": str(FOLDER / "page.html")})
    yield from run(dialog)
    assert "HTML output has been generated" in log(dialog), log(dialog)
    assert len(resultsList.getResults()) == before + 1
    yield from over(dialog)


def play_set_that_is_handed_over() -> Play:
    """A folder for the set: its layers are loaded, and the viewer of results has its README."""
    from processing.core.ProcessingResults import resultsList

    before, folder = set(QgsProject.instance().mapLayers()), FOLDER / "set of the terrain"
    shutil.rmtree(folder, ignore_errors=True)
    yield from opened("Terrain and surface models", "dtm")
    dialog = named("AlgorithmDialog")
    dialog.setParameters({"POINTS": SAYS["cloud"], "CELL": 2.0})
    write(row_of(dialog, "TITLE"), "Hill of Delft")
    line = row_of(dialog, "DELIVER").findChild(QLineEdit)
    write(line, str(folder))
    dialog.findChild(QScrollArea).ensureWidgetVisible(line)
    picture("set dialog", dialog)
    yield from run(dialog)
    look(dialog, 1)
    picture("set log", dialog)
    assert "Execution completed" in log(dialog), log(dialog)
    viewed = [Path(one.filename).name for one in resultsList.getResults()[-2:]]
    assert viewed == ["README.txt", "report.html"], viewed
    assert (folder / "README.txt").read_text("utf-8").startswith("Hill of Delft\n")
    made = [lay for i, lay in QgsProject.instance().mapLayers().items() if i not in before]
    sources = [Path(layer.source().split("|")[0]) for layer in made]
    assert {path.parent for path in sources} == {folder}, sources
    SAYS.setdefault("notes", {})["set"] = sorted(layer.name() for layer in made)
    assert len(made) >= 8, made
    tree = QgsProject.instance().layerTreeRoot()
    nodes = tree.findGroup("Terrain and surface models: punkte").findLayers()
    shown = [(node.name(), node.isVisible()) for node in nodes]
    assert shown[:3] == [("Contours", True), ("Terrain (DTM)", True), ("Surface (DSM)", False)], (
        shown
    )
    assert not any(seen for _, seen in shown[2:]), shown
    lines = next(layer for layer in made if layer.name() == "Contours")
    assert lines.attributeDisplayName(lines.fields().indexOf("elevation")) == "Elevation [m]"
    yield from over(dialog)
    end = time.monotonic() + 2
    yield lambda: time.monotonic() > end
    picture("set canvas")


def play_set_with_an_edited_file() -> Play:
    """What somebody has changed in the folder of a set stays, and the log says why and what to do.

    The layers of that set are open, which is no change.
    """
    folder = FOLDER / "set of the terrain"
    yield from opened("Terrain and surface models", "dtm")
    dialog = named("AlgorithmDialog")
    given = {"POINTS": SAYS["cloud"], "CELL": 2.0, "DELIVER": str(folder)}
    with (folder / "contours.dxf").open("a") as drawing:
        drawing.write("999\nmine\n")
    dialog.setParameters(given)
    yield from run(dialog)
    look(dialog, 1)
    picture("set with an edited file", dialog)
    assert "contours.dxf in" in log(dialog), log(dialog)
    assert "move it elsewhere, or name a new or an empty folder" in log(dialog), log(dialog)
    assert (folder / "contours.dxf").read_text().endswith("999\nmine\n")
    yield from over(dialog)


def play_names_in_layers() -> Play:
    """Attributes and bands are picked among those of the layer that is given."""
    yield from opened("Filter points", "filter")
    dialog = named("AlgorithmDialog")
    write(row_of(dialog, "POINTS").box.lineEdit(), SAYS["cloud"])
    where = row_of(dialog, "WHERE")
    click_later(button(where, "Attribute"))
    yield QApplication.activePopupWidget
    menu = QApplication.activePopupWidget()
    picture("attributes", menu)
    names = [action.text() for action in menu.actions()]
    assert "intensity" in names, names
    spot = menu.actionGeometry(menu.actions()[names.index("intensity")]).center()
    QTimer.singleShot(
        0, lambda: QTest.mouseClick(menu, Qt.MouseButton.LeftButton, pos=QPoint(spot))
    )
    yield lambda: QApplication.activePopupWidget() is None
    where.box.lineEdit().insert(" > 500")
    assert dialog.mainWidget().wrappers["WHERE"].widgetValue() == "intensity > 500"
    yield from run(dialog)
    assert "Execution completed" in log(dialog), log(dialog)
    yield from over(dialog)
    yield from opened("Sample raster at points", "sample")
    dialog = named("AlgorithmDialog")
    dialog.setParameters({"POINTS": SAYS["cloud"], "RASTER": str(FOLDER / "batch 0.tif")})
    bands = row_of(dialog, "BANDS")
    click_later(button(bands, "Choose"))
    yield lambda: named("TickDialog")
    chooser = named("TickDialog")
    picture("bands", chooser)
    chooser.list.item(0).setCheckState(Qt.CheckState.Checked)
    QTimer.singleShot(0, lambda: click(button(chooser, "OK")))
    yield lambda: not named("TickDialog")
    assert dialog.mainWidget().wrappers["BANDS"].widgetValue() == "1"
    yield from run(dialog)
    assert "Execution completed" in log(dialog), log(dialog)
    yield from over(dialog)


def play_ended_by_the_system() -> Play:
    """A tool that the system has ended for want of memory: the message says what to do."""
    program = FOLDER / "python that is ended"
    program.write_text("#!/bin/sh\nread line\nkill -9 $$\n")
    program.chmod(0o755)
    yield from opened("Information about points", "density")
    dialog = named("AlgorithmDialog")
    dialog.setParameters({"POINTS": SAYS["cloud"]})
    os.environ["LIDAR_TOOLBOX_PYTHON"] = str(program)
    yield from run(dialog)
    del os.environ["LIDAR_TOOLBOX_PYTHON"]
    look(dialog, 1)
    picture("ended by the system", dialog)
    assert "memory runs out" in log(dialog), log(dialog)
    assert "tile size" in log(dialog), log(dialog)
    yield from over(dialog)


def play_style_of_the_user() -> Play:
    """A style file beside the result stays as it is."""
    from qgis.core import QgsRasterLayer

    place = FOLDER / "styled.tif"
    before = set(QgsProject.instance().mapLayers())
    yield from opened("Grid points to a raster", "dtm")
    dialog = named("AlgorithmDialog")
    dialog.setParameters({"POINTS": SAYS["cloud"], "SURFACE": str(place)})
    yield from run(dialog)
    (layer,) = [lay for i, lay in QgsProject.instance().mapLayers().items() if i not in before]
    plain = QgsRasterLayer(str(place), "plain")
    plain.saveNamedStyle(str(place.with_suffix(".qml")))
    QgsProject.instance().removeMapLayer(layer)
    yield from again(dialog)
    yield from run(dialog)
    (layer,) = [lay for i, lay in QgsProject.instance().mapLayers().items() if i not in before]
    assert layer.renderer().type() == "singlebandgray", layer.renderer().type()
    yield from over(dialog)


def play_model_in_the_designer() -> Play:
    """The steps of an exported model keep their points when they are opened and closed again."""
    from processing.modeler.ModelerParametersDialog import ModelerParametersDialog
    from qgis.core import QgsProcessingModelAlgorithm

    model = QgsProcessingModelAlgorithm()
    assert model.fromFile(SAYS["model"])
    model.setProvider(QgsApplication.processingRegistry().providerById("model"))
    looked: list[list[str]] = []
    red = {name: model.validateChildAlgorithm(name) for name in model.childAlgorithms()}
    assert all(valid for valid, _ in red.values()), red
    for name in model.childAlgorithms():
        child = model.childAlgorithm(name)
        dialog = ModelerParametersDialog(child.algorithm(), model, name)
        dialog.setPreviousValues()
        dialog.show()
        picture(f"designer {name}", dialog)
        after, was = dialog.createAlgorithm().parameterSources(), child.parameterSources()
        lost = {n: was[n] for n in was if after.get(n) != was[n]}
        assert not lost, (name, {n: (was[n], after.get(n)) for n in lost})
        points = dialog.widget.widget.wrappers.get("POINTS")
        if points is not None:  # plots and reports are files, and no points
            offered = [points.row.box.itemText(n) for n in range(points.row.box.count())]
            assert not [one for one in offered if re.match(r"(Plot|Report|Counts)\b", one)], offered
            looked.append(offered)
        dialog.close()
        yield lambda: True
    assert any(any("from" in one for one in offered) for offered in looked), looked


def main() -> None:
    results = {}
    wanted = SAYS["scenarios"] or [n[5:] for n in globals() if n.startswith("play_")]

    def plays() -> Iterator[Any]:
        for name in wanted:
            results[name] = "not ended"
            yield name, globals()[f"play_{name}"]()

    queue = plays()
    now: dict[str, Any] = {"play": None}

    def step() -> None:
        try:
            if now["play"] is None:
                now["name"], now["play"] = next(queue)
                now["wait"], now["until"] = (lambda: True), time.monotonic() + PATIENCE
            if time.monotonic() > now["until"]:
                raise TimeoutError(f"waited {PATIENCE:g} s")
            if now["wait"]():
                now["wait"], now["until"] = next(now["play"]), time.monotonic() + PATIENCE
        except StopIteration:
            if now["play"] is None:
                finish()
            results[now["name"]], now["play"] = "", None
        except Exception:  # noqa: BLE001  the next scenario is played all the same
            results[now["name"]], now["play"] = traceback.format_exc(), None
            frames = traceback.format_exc()
            picture(f"failed {now['name']}")
            for number, window in enumerate(windows(QDialog)):
                picture(f"failed {now['name']} {number}", window)
                results[now["name"]] = frames + (log(window)[-1500:])
                window.close()
        says = {"results": results, "notes": SAYS.get("notes", {})}
        (FOLDER / "results.json").write_text(json.dumps(says, indent=1), "utf-8")
        QTimer.singleShot(50, step)

    def finish() -> None:
        os._exit(0)

    QTimer.singleShot(1000, step)


iface.mainWindow().resize(1400, 900)
if QgsApplication.processingRegistry().providerById("lidartoolbox") is None:
    raise RuntimeError("the plugin is not loaded")
main()
