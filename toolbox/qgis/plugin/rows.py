"""Boxes with buttons beside them, and the lists that these open: what dialogs show of a value."""

from __future__ import annotations

import os
import re
from typing import Any

from qgis.core import QgsCoordinateReferenceSystem, QgsMapLayerType, QgsProject, QgsSettings
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
    QMenu,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from . import language
from .layers import is_missing

LAST_FOLDER = "/Processing/LastInputPath"  # as the dialogs of QGIS remember it
SCANS = (
    ("local", language.text("None: a scan in metres (local)")),
    ("local:mm", language.text("None: a scan in millimetres (local:mm)")),
    ("local:cm", language.text("None: a scan in centimetres (local:cm)")),
    ("local:ft", language.text("None: a scan in feet (local:ft)")),
)
CONDITION = language.text("such as intensity > 40 and classification in (2, 9)")
EMPTY = language.text("A file, several, a folder or a layer; files can be dropped here")


class Row(QWidget):
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


class PointsRow(Row):
    """Picks points: files and folders by dialogs, layers from the list, or all by typing."""

    def __init__(self, filters: str) -> None:
        super().__init__(QComboBox())
        self.filters = filters
        self.setAcceptDrops(True)
        self.box.lineEdit().setAcceptDrops(False)  # it would take the text of the first
        self.box.lineEdit().setPlaceholderText(EMPTY)
        self.button(
            language.text("Files…"),
            language.text("One file, or several that are one survey"),
            self.pick_files,
        )
        self.button(
            language.text("Folder…"),
            language.text("All files of points in a folder, as one survey"),
            self.pick_folder,
        )

    def list_layers(self) -> None:
        for layer in QgsProject.instance().mapLayers().values():
            if layer.type() == QgsMapLayerType.PointCloudLayer:
                self.box.addItem(f"{layer.name()} [{layer.crs().authid()}]", layer.id())
        self.box.setCurrentIndex(0 if self.box.count() else -1)

    def pick_files(self) -> None:
        paths, _ = QFileDialog.getOpenFileNames(
            self, language.text("Points"), self._folder(), self.filters
        )
        self._take(paths)

    def pick_folder(self) -> None:
        path = QFileDialog.getExistingDirectory(
            self, language.text("Folder of points"), self._folder()
        )
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


class CrsRow(Row):
    """Picks a CRS, or what stands for none."""

    def __init__(self) -> None:
        super().__init__(QComboBox())
        self.box.addItem(language.text("As the file states"), None)
        project = QgsProject.instance().crs()
        if project.isValid():
            self.box.addItem(f"{language.text('Project')}: {_named(project)}", _code(project))
        for value, words in SCANS:
            self.box.addItem(words, value)
        self.button(language.text("Choose…"), language.text("Choose a CRS"), self.pick)

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


class ClassesRow(Row):
    """Classes of points as a text, or ticked in a list of their names."""

    def __init__(self, known: list[tuple[int, str]]) -> None:
        super().__init__(QComboBox())
        self.known = dict(known)
        self.box.lineEdit().setClearButtonEnabled(True)
        self.button(
            language.text("Choose…"), language.text("Tick classes by their names"), self.pick
        )

    def pick(self) -> None:
        given = codes_in(self.box.currentText())
        codes = sorted({*self.known, *given})
        own = language.text("of the user")
        words = {code: f"{code}  {self.known.get(code, own)}" for code in codes}
        dialog = TickDialog(self, language.text("Classes"), words, given)
        if dialog.exec():
            self.box.setEditText(",".join(map(str, dialog.ticked())))


class NamesRow(Row):
    """Several names with ; between, which can be ticked among those that are offered."""

    def __init__(self) -> None:
        super().__init__(QComboBox())
        self.button(language.text("Choose…"), language.text("Tick them in a list"), self.pick)

    def pick(self) -> None:
        known = {self.box.itemData(n): self.box.itemText(n) for n in range(self.box.count())}
        known = {name: shown for name, shown in known.items() if isinstance(name, str)}
        said = self.shown()
        given = [name.strip() for name in said.split(";")] if isinstance(said, str) else []
        given = [name for name in given if name]
        known.update({name: name for name in given if name not in known})
        dialog = TickDialog(self, language.text("Names"), known, given)
        if dialog.exec():
            self.box.setEditText(";".join(map(str, dialog.ticked())))


class ConditionRow(Row):
    """A condition as a text, into which names of attributes are put from a menu."""

    def __init__(self, names: Any) -> None:
        super().__init__(QComboBox())
        self.names = names
        self.box.lineEdit().setPlaceholderText(CONDITION)
        self.box.lineEdit().setClearButtonEnabled(True)
        self.button(
            language.text("Attribute…"),
            language.text("Put the name of an attribute into the condition"),
            self.pick,
        )

    def pick(self) -> None:
        menu = QMenu(self)
        for name in self.names():
            menu.addAction(name)
        if menu.isEmpty():
            menu.addAction(language.text("Choose the layer first")).setEnabled(False)
        action = menu.exec(self.mapToGlobal(self.rect().bottomRight()))
        if action is not None:
            self.box.lineEdit().insert(action.text())


class TickDialog(QDialog):
    """A list of values with words, to tick."""

    def __init__(self, parent: QWidget, title: str, known: dict[Any, str], given: Any) -> None:
        super().__init__(parent)
        self.setWindowTitle(title)
        self.list = QListWidget()
        for value, words in known.items():
            item = QListWidgetItem(words, self.list)
            item.setData(Qt.ItemDataRole.UserRole, value)
            ticked = Qt.CheckState.Checked if value in given else Qt.CheckState.Unchecked
            item.setCheckState(ticked)
        ok, cancel = QDialogButtonBox.StandardButton.Ok, QDialogButtonBox.StandardButton.Cancel
        buttons = QDialogButtonBox(ok | cancel)
        buttons.accepted.connect(self.accept)
        buttons.rejected.connect(self.reject)
        within = QVBoxLayout(self)
        within.addWidget(self.list)
        within.addWidget(buttons)
        self.resize(360, 520)

    def ticked(self) -> list[Any]:
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
