"""Widgets of the dialogs for what those of QGIS do not offer.

Points are a layer, a file, several files or a folder, of which QGIS itself need not be able to open
any. A CRS may be one that is none, for scans. Choices are shown in words and kept by their names.
Names of attributes and bands are offered, and may be typed. Classes are ticked in a list.
"""

from __future__ import annotations

import os
import re
from typing import Any

import qgis.core
from processing.gui.wrappers import DIALOG_MODELER, WidgetWrapper
from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsMapLayerType,
    QgsProcessingModelChildParameterSource,
    QgsProcessingParameterDefinition,
    QgsProject,
    QgsSettings,
)
from qgis.gui import QgsFileWidget, QgsProjectionSelectionDialog
from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtWidgets import (
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QHBoxLayout,
    QListWidget,
    QListWidgetItem,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from .parameters import (
    WIDGETS,
    AnyCrs,
    Choice,
    Classes,
    PointCloud,
    Suggested,
    is_missing,
    suggestions,
)

LAST_FOLDER = "/Processing/LastInputPath"  # as the dialogs of QGIS remember it
SCANS = (
    ("local", "None: a scan in metres (local)"),
    ("local:mm", "None: a scan in millimetres (local:mm)"),
    ("local:cm", "None: a scan in centimetres (local:cm)"),
    ("local:ft", "None: a scan in feet (local:ft)"),
)
EMPTY = "A file, several, a folder or a layer; files can be dropped here"


class _Row(QWidget):
    """A box and buttons beside it."""

    changed = pyqtSignal()

    def __init__(self, box: QComboBox) -> None:
        super().__init__()
        self.box = box
        box.setEditable(True)
        box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        box.setMinimumContentsLength(12)
        self.row = QHBoxLayout(self)
        self.row.setContentsMargins(0, 0, 0, 0)
        self.row.addWidget(box, 1)
        box.currentTextChanged.connect(lambda text: self.changed.emit())

    def button(self, text: str, tip: str, work: Any) -> None:
        made = QPushButton(text)
        made.setToolTip(tip)
        made.setAutoDefault(False)
        made.clicked.connect(lambda checked: work())
        self.row.addWidget(made)

    def shown(self) -> Any:
        """The value of the item that is shown, or the text if it is none of them."""
        number = self.box.findText(self.box.currentText())
        return self.box.itemData(number) if number >= 0 else self.box.currentText().strip()

    def show_value(self, value: Any) -> None:
        number = self.box.findData(value)
        self.box.setCurrentIndex(number)
        if number < 0:
            self.box.setEditText("" if is_missing(value) else str(value))


class PointsRow(_Row):
    """Picks points: files and folders by dialogs, layers from the list, or all by typing."""

    def __init__(self, filters: str) -> None:
        super().__init__(QComboBox())
        self.filters = filters
        self.setAcceptDrops(True)
        self.box.lineEdit().setAcceptDrops(False)  # it would take the text of the first
        self.box.lineEdit().setPlaceholderText(EMPTY)
        self.button("Files…", "One file, or several that are one survey", self.pick_files)
        self.button("Folder…", "All files of points in a folder, as one survey", self.pick_folder)

    def list_layers(self) -> None:
        for layer in QgsProject.instance().mapLayers().values():
            if layer.type() == QgsMapLayerType.PointCloudLayer:
                self.box.addItem(f"{layer.name()} [{layer.crs().authid()}]", layer.id())
        self.box.setCurrentIndex(0 if self.box.count() else -1)

    def pick_files(self) -> None:
        paths, _ = QFileDialog.getOpenFileNames(self, "Points", self._folder(), self.filters)
        self._take(paths)

    def pick_folder(self) -> None:
        path = QFileDialog.getExistingDirectory(self, "Folder of points", self._folder())
        self._take([path] if path else [])

    def _folder(self) -> str:
        return str(QgsSettings().value(LAST_FOLDER, "") or os.path.expanduser("~"))

    def _take(self, paths: list[str]) -> None:
        if paths:
            QgsSettings().setValue(LAST_FOLDER, os.path.dirname(paths[0]))
            self.show_value(paths)

    def dragEnterEvent(self, event: Any) -> None:
        if event.mimeData().hasUrls():
            event.acceptProposedAction()

    def dropEvent(self, event: Any) -> None:
        self.show_value([url.toLocalFile() for url in event.mimeData().urls()])
        event.acceptProposedAction()

    def show_value(self, value: Any) -> None:
        several = list(value) if isinstance(value, (list, tuple)) else [value]
        quoted = " ".join(f'"{path}"' for path in several)
        super().show_value(quoted if len(several) > 1 else several[0] if several else None)

    def shown(self) -> Any:
        value = super().shown()
        if isinstance(value, str) and value.startswith('"'):
            paths = QgsFileWidget.splitFilePaths(value)
            return paths if len(paths) > 1 else paths[0]
        return value


class CrsRow(_Row):
    """Picks a CRS, or what stands for none."""

    def __init__(self) -> None:
        super().__init__(QComboBox())
        self.box.addItem("As the file states", None)
        project = QgsProject.instance().crs()
        if project.isValid():
            self.box.addItem(f"Project: {_named(project)}", _code(project))
        for value, words in SCANS:
            self.box.addItem(words, value)
        self.button("Choose…", "Choose a CRS", self.pick)

    def pick(self) -> None:
        dialog = QgsProjectionSelectionDialog(self)
        if dialog.exec() and dialog.crs().isValid():
            if self.box.findData(_code(dialog.crs())) < 0:
                self.box.addItem(_named(dialog.crs()), _code(dialog.crs()))
            self.show_value(_code(dialog.crs()))

    def show_value(self, value: Any) -> None:
        valid = isinstance(value, QgsCoordinateReferenceSystem)
        super().show_value(_code(value) if valid else None if is_missing(value) else value)

    def shown(self) -> Any:
        return super().shown() or None


class ClassesRow(_Row):
    """Classes of points as a text, or ticked in a list of their names."""

    def __init__(self, known: list[tuple[int, str]]) -> None:
        super().__init__(QComboBox())
        self.known = dict(known)
        self.box.lineEdit().setClearButtonEnabled(True)
        self.button("Choose…", "Tick classes by their names", self.pick)

    def pick(self) -> None:
        dialog = ClassesDialog(self, self.known, codes_in(self.box.currentText()))
        if dialog.exec():
            self.box.setEditText(",".join(map(str, dialog.ticked())))


class ClassesDialog(QDialog):
    """A list of classes to tick; it also has those that are given and have no name."""

    def __init__(self, parent: QWidget, known: dict[int, str], given: set[int]) -> None:
        super().__init__(parent)
        self.setWindowTitle("Classes")
        self.list = QListWidget()
        for code in sorted({*known, *given}):
            item = QListWidgetItem(f"{code}  {known.get(code, 'of the user')}", self.list)
            item.setData(Qt.ItemDataRole.UserRole, code)
            item.setCheckState(Qt.CheckState.Checked if code in given else Qt.CheckState.Unchecked)
        ok, cancel = QDialogButtonBox.StandardButton.Ok, QDialogButtonBox.StandardButton.Cancel
        buttons = QDialogButtonBox(ok | cancel)
        buttons.accepted.connect(self.accept)
        buttons.rejected.connect(self.reject)
        within = QVBoxLayout(self)
        within.addWidget(self.list)
        within.addWidget(buttons)
        self.resize(360, 520)

    def ticked(self) -> list[int]:
        items = map(self.list.item, range(self.list.count()))
        role, ticked = Qt.ItemDataRole.UserRole, Qt.CheckState.Checked
        return [item.data(role) for item in items if item.checkState() == ticked]


def codes_in(text: str) -> set[int]:
    """The classes in a text such as 2,9,14-16; what is no class is passed over."""
    found: set[int] = set()
    for first, last in re.findall(r"(\d{1,3})(?:\s*-\s*(\d{1,3}))?", text):
        found.update(range(int(first), int(last or first) + 1))
    return found


def _named(crs: Any) -> str:
    return f"{crs.authid()} - {crs.description()}" if crs.authid() else str(crs.description())


def _code(crs: Any) -> str:
    return str(crs.authid() or crs.toWkt(QgsCoordinateReferenceSystem.WKT_PREFERRED))


class _Wrapper(WidgetWrapper):
    """What the dialogs of QGIS ask of the widget of a parameter.

    In the model designer its list also has the inputs and results of the model that it may take.
    """

    inputs: tuple[Any, ...] = ()  # classes of inputs of a model that it takes
    results: tuple[Any, ...] = ()  # and of results of other steps

    def createWidget(self, **more: Any) -> Any:
        self.row = self.made(self.parameterDefinition())
        self.row.setToolTip(self.parameterDefinition().toolTip())
        self.row.changed.connect(lambda: self.widgetValueHasChanged.emit(self))
        if self.dialogType == DIALOG_MODELER:
            for source in self.dialog.getAvailableValuesOfType(self.inputs, self.results):
                self.row.box.addItem(self.dialog.resolveValueDescription(source), source)
        return self.row

    def made(self, parameter: Any) -> Any:
        raise NotImplementedError

    def setValue(self, value: Any) -> None:
        each = value if isinstance(value, list) else [value]
        if each and all(isinstance(one, QgsProcessingModelChildParameterSource) for one in each):
            self._show_source(value if len(each) > 1 else each[0])
        else:
            self.row.show_value(value)

    def _show_source(self, source: Any) -> None:
        """Show where a step of a model has its value from, also if it is an expression."""
        box = self.row.box
        known = [n for n in range(box.count()) if box.itemData(n) == source]
        if not known:
            several = isinstance(source, list)
            named = [] if several else [source.expression(), source.expressionText()]
            box.addItem(next(filter(None, named), "From several steps"), source)
        box.setCurrentIndex(known[0] if known else box.count() - 1)

    def value(self) -> Any:
        return self.row.shown()


class PointsWidget(_Wrapper):
    """Points: a layer, files or a folder."""

    inputs = (
        qgis.core.QgsProcessingParameterPointCloudLayer,
        qgis.core.QgsProcessingParameterMultipleLayers,
        qgis.core.QgsProcessingParameterFile,
        qgis.core.QgsProcessingParameterString,
    )
    results = tuple(
        getattr(qgis.core, f"QgsProcessingOutput{word}")
        for word in ("PointCloudLayer", "File", "Folder", "String")
        if hasattr(qgis.core, f"QgsProcessingOutput{word}")  # the first is of QGIS 3.24
    )

    def made(self, parameter: Any) -> Any:
        row = PointsRow(parameter.createFileFilter())
        row.list_layers()
        return row

    def value(self) -> Any:
        return self.row.shown() or None


class CrsWidget(_Wrapper):
    """A CRS, also one that is none."""

    inputs = (qgis.core.QgsProcessingParameterCrs, qgis.core.QgsProcessingParameterString)

    def made(self, parameter: Any) -> Any:
        return CrsRow()


class ChoiceWidget(_Wrapper):
    """One of several words."""

    inputs = (qgis.core.QgsProcessingParameterEnum, qgis.core.QgsProcessingParameterString)

    def made(self, parameter: Any) -> Any:
        row = _Row(QComboBox())
        row.box.setEditable(False)
        if parameter.flags() & QgsProcessingParameterDefinition.FlagOptional:
            row.box.addItem("", None)
        for word, name in zip(parameter.shown, parameter.options()):
            row.box.addItem(word, name)
        return row


class ClassesWidget(_Wrapper):
    """Classes of points."""

    inputs = (qgis.core.QgsProcessingParameterString,)

    def made(self, parameter: Any) -> Any:
        return ClassesRow(parameter.known)

    def value(self) -> Any:
        return self.row.shown() or None


class SuggestedWidget(_Wrapper):
    """A text, for which names in the layer are offered."""

    inputs = (qgis.core.QgsProcessingParameterString, qgis.core.QgsProcessingParameterField)

    def made(self, parameter: Any) -> Any:
        row = _Row(QComboBox())
        row.box.lineEdit().setClearButtonEnabled(True)
        for text in parameter.offers:
            row.box.addItem(text, text)
        row.box.setCurrentIndex(-1)
        return row

    def postInitialize(self, wrappers: Any) -> None:
        """Offer the names of the layer that is chosen, now and later."""
        for wrapper in wrappers:
            if wrapper.parameterDefinition().name() == self.parameterDefinition().source:
                wrapper.widgetValueHasChanged.connect(self._offer)
                self._offer(wrapper)

    def _offer(self, source: Any) -> None:
        said = self.row.box.currentText()
        self.row.box.blockSignals(True)
        self.row.box.clear()
        for name in suggestions(source.parameterValue()):
            self.row.box.addItem(name, name)
        self.row.box.setCurrentIndex(-1)
        self.row.box.setEditText(said)
        self.row.box.blockSignals(False)

    def value(self) -> Any:
        return self.row.shown() or None


def use() -> None:
    """Let the dialogs show these widgets."""
    WIDGETS.update(
        {
            PointCloud: PointsWidget,
            AnyCrs: CrsWidget,
            Choice: ChoiceWidget,
            Classes: ClassesWidget,
            Suggested: SuggestedWidget,
        }
    )
