"""Runs the plugin's own code under PyQt6, with stand-ins for QGIS: ``qt6_trial.py FOLDER``.

FOLDER has the plugin. It prints JSON: the version of Qt, how many tools and widgets were made, and
which dialogs were opened and closed. The classes of QGIS are stand-ins that take everything; those
of Qt are real, and refuse what Qt 6 does not know.
"""

from __future__ import annotations

import json
import sys
from importlib import import_module
from types import ModuleType
from typing import Any

from PyQt6 import QtCore, QtGui, QtWidgets

app = QtWidgets.QApplication([])


class Stub(type):
    """A class of QGIS: any attribute that begins with a capital is an enum, with any member."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        made = Stub(name, (), {}) if name[0].isupper() else (lambda *args, **more: Anything())
        setattr(cls, name, made)
        return made

    def __or__(cls, other: Any) -> Any:
        return cls


class Anything:
    """A value of QGIS of which nothing is known."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return lambda *args, **more: Anything()

    def __bool__(self) -> bool:
        return False

    def __iter__(self) -> Any:
        return iter(())

    def __str__(self) -> str:
        return ""

    def __or__(self, other: Any) -> Any:
        return self

    __ror__ = __and__ = __or__


class Definition(metaclass=Stub):
    """As much of the definition of a parameter as the plugin asks for."""

    def __init__(self, *args: Any) -> None:
        self.said = args

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return lambda *args, **more: Anything()

    def name(self) -> str:
        return str(self.said[0])

    def toolTip(self) -> str:
        return ""

    def options(self) -> Any:
        return self.said[2]


class Wrapper(QtCore.QObject):
    """As much of the widget wrapper of QGIS as the plugin asks for."""

    widgetValueHasChanged = QtCore.pyqtSignal(object)

    def __init__(self, parameter: Any) -> None:
        super().__init__()
        self.parameter, self.dialogType = parameter, 0

    def parameterDefinition(self) -> Any:
        return self.parameter


class FileWidget(QtWidgets.QLineEdit):
    """A box for a path."""

    def setFilePath(self, path: str) -> None:
        self.setText(path)

    def filePath(self) -> str:
        return self.text()

    def setFilter(self, text: str) -> None:
        assert text

    @staticmethod
    def splitFilePaths(text: str) -> list[str]:
        return [part for part in text.split('"') if part.strip()]


class CrsDialog(QtWidgets.QDialog):
    """A dialog in which no CRS is chosen."""

    def crs(self) -> Any:
        return Anything()


class Settings(metaclass=Stub):
    """Settings that are empty."""

    def value(self, name: str, default: Any = None, **more: Any) -> Any:
        return default

    def setValue(self, *args: Any) -> None:
        pass


class Library(ModuleType):
    """A module of QGIS: each name is a class."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        bases = (Definition,) if name.startswith("QgsProcessingParameter") else ()
        made = Stub(name, bases, {"__init__": Definition.__init__})
        setattr(self, name, made)
        return made


def library(name: str, **members: Any) -> None:
    made = sys.modules[name] = Library(name)
    made.__dict__.update(members | {"__path__": []})


library("qgis")
library("qgis.PyQt", QtCore=QtCore, QtGui=QtGui, QtWidgets=QtWidgets)
for each in (QtCore, QtGui, QtWidgets):
    sys.modules[each.__name__.replace("PyQt6", "qgis.PyQt")] = each
PATHS = {"qgisSettingsDirPath": staticmethod(lambda: sys.argv[1])}
Application = Stub("QgsApplication", (), PATHS | {"locale": staticmethod(lambda: "en")})
library("qgis.core", QgsSettings=Settings, QgsApplication=Application, NULL=None)
library("qgis.utils", iface=None)
library(
    "qgis.gui",
    QgsFileWidget=FileWidget,
    QgsOptionsPageWidget=QtWidgets.QWidget,
    QgsOptionsWidgetFactory=type("Factory", (), {"setTitle": lambda self, text: None}),
    QgsProjectionSelectionDialog=CrsDialog,
)
sys.modules["qgis"].core = sys.modules["qgis.core"]  # type: ignore[attr-defined]
sys.modules["qgis"].utils = sys.modules["qgis.utils"]  # type: ignore[attr-defined]
for name in ("processing", "processing.gui"):
    library(name)
library("processing.gui.wrappers", WidgetWrapper=Wrapper, DIALOG_MODELER=1)

sys.path.insert(0, sys.argv[1])
NAMES = ("algorithm", "bridge", "delivery", "language", "lasheader", "layers", "parameters")
NAMES += ("plugin", "rows", "settings", "styling", "tree", "values", "widgets")
code = {name: import_module(f"lidar_toolbox.{name}") for name in NAMES}
import_module("lidar_toolbox").classFactory(None)
code["widgets"].use()

pressed: list[str] = []


def press(what: str, work: Any) -> None:
    """Do what opens a window that waits, and close that window."""

    def close() -> None:
        window = QtWidgets.QApplication.activePopupWidget()
        window = window or QtWidgets.QApplication.activeModalWidget()
        if window is None:
            QtCore.QTimer.singleShot(20, close)
        else:
            pressed.append(what)
            window.close()

    QtCore.QTimer.singleShot(20, close)
    work()


def widget_of(made: Any) -> Any:
    wrapper = code["parameters"].WIDGETS[type(made)](made)
    row = wrapper.createWidget()
    row.show()
    if hasattr(wrapper, "postInitialize"):
        wrapper.postInitialize([])
    row.show_value(None)
    wrapper.value()
    return row


listed = code["plugin"].read_tools()
rows: dict[str, Any] = {}
count = 0
for tool in listed["tools"]:
    code["algorithm"].ToolAlgorithm(tool, listed["colours"])
    for field in tool["inputs"] + tool["outputs"]:
        made = code["parameters"].definition(field)
        if type(made) in code["parameters"].WIDGETS:
            row = widget_of(made)
            rows[type(row).__name__] = row
            count += 1
rows["ConditionRow"].names = lambda: {"intensity": "intensity"}
press("Classes", rows["ClassesRow"].pick)
press("Names", rows["NamesRow"].pick)
press("Attribute", rows["ConditionRow"].pick)
press("CRS", rows["CrsRow"].pick)
QtWidgets.QApplication.setAttribute(QtCore.Qt.ApplicationAttribute.AA_DontUseNativeDialogs)
press("Files", rows["PointsRow"].pick_files)
mime = QtCore.QMimeData()
mime.setUrls([QtCore.QUrl.fromLocalFile("/a.laz"), QtCore.QUrl.fromLocalFile("/b.laz")])
rows["PointsRow"].dropEvent(
    QtGui.QDropEvent(
        QtCore.QPointF(1, 1),
        QtCore.Qt.DropAction.CopyAction,
        mime,
        QtCore.Qt.MouseButton.LeftButton,
        QtCore.Qt.KeyboardModifier.NoModifier,
    )
)
assert rows["PointsRow"].shown() == ["/a.laz", "/b.laz"], rows["PointsRow"].shown()
page = code["settings"].OptionsPage(None)
page.show()
page.test()
pressed.append("settings" if page.found.text() else "")
says = {"qt": QtCore.QT_VERSION_STR, "tools": len(listed["tools"]), "widgets": count}
sys.stdout.write(json.dumps(says | {"pressed": pressed}))
