"""The page in Settings > Options: chooses the Python of the tools, or creates an environment."""

from __future__ import annotations

import os
import shutil
from typing import Any

from qgis.core import QgsApplication, QgsMessageLog, QgsSettings, QgsTask
from qgis.gui import QgsFileWidget, QgsOptionsPageWidget, QgsOptionsWidgetFactory
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import QFormLayout, QLabel, QLineEdit, QPushButton, QVBoxLayout

from . import bridge

PACKAGE = "lidar-toolbox"
PYTHONS = ("python3.14", "python3.13", "python3.12", "python3.11", "python3", "python", "py")
# Of Python on macOS, where a program not started from a terminal has a short search path.
FOLDERS = ("/opt/homebrew/bin", "/usr/local/bin")
# The launcher "py" of Windows is no Python itself.
NEEDED = "import sys, venv, ensurepip; assert sys.version_info >= (3, 11); print(sys.executable)"


class OptionsFactory(QgsOptionsWidgetFactory):
    """Makes the page when the dialog is opened."""

    def __init__(self) -> None:
        super().__init__()
        self.setTitle("LiDAR Toolbox")

    def icon(self) -> Any:
        return QIcon(str(bridge.HERE / "icon.svg"))

    def createWidget(self, parent: Any) -> Any:
        return OptionsPage(parent)


class OptionsPage(QgsOptionsPageWidget):
    """Picks a Python, tests it, or creates an environment."""

    def __init__(self, parent: Any) -> None:
        super().__init__(parent)
        self.python = QgsFileWidget()
        self.python.setFilePath(str(QgsSettings().value(bridge.SETTING, "")))
        self.package = QLineEdit(PACKAGE)
        self.package.setToolTip("Name of the package, or the path of a checkout or wheel")
        self.found = QLabel()
        self.found.setWordWrap(True)
        self.task: Any = None
        form = QFormLayout()
        form.addRow("Python of the tools", self.python)
        form.addRow("", self._button("Test", self.test))
        form.addRow("Package to install", self.package)
        form.addRow("", self._button("Create an environment of its own", self.create))
        layout = QVBoxLayout(self)
        layout.addLayout(form)
        layout.addWidget(self.found)
        layout.addStretch()
        self.found.setText(f"Used now: {bridge.find_python() or 'none'}")

    def _button(self, text: str, work: Any) -> Any:
        button = QPushButton(text)
        button.clicked.connect(lambda checked: work())
        return button

    def apply(self) -> None:
        QgsSettings().setValue(bridge.SETTING, self.python.filePath())

    def test(self) -> None:
        """Show the version of the toolbox in the chosen Python."""
        self.apply()
        try:
            words = bridge.command("-c", bridge.CHECK)
            self.found.setText(f"{words[0]}: {bridge.said(words)}")
        except Exception as err:
            self.found.setText(str(err))

    def create(self) -> None:
        """Create an environment in the profile, in the background: it takes a minute or two."""
        self.found.setText("Creating the environment ...")
        self.task = QgsTask.fromFunction(
            "LiDAR Toolbox: create environment",
            create_environment,
            on_finished=self._created,
            package=self.package.text() or PACKAGE,
        )
        QgsApplication.taskManager().addTask(self.task)

    def _created(self, error: Any, python: Any = None) -> None:
        if error is None:
            QgsSettings().setValue(bridge.SETTING, python)
        text = str(error or f"{python} runs the tools now")
        try:
            self.python.setFilePath(python or self.python.filePath())
            self.found.setText(text)
        except RuntimeError:  # the page was closed meanwhile
            QgsMessageLog.logMessage(text, "LiDAR Toolbox")


def create_environment(task: Any, package: str = PACKAGE) -> str:
    """Create an environment with the toolbox in the profile, and return its Python.

    Raises
    ------
    RuntimeError
        There is no suitable Python, or the package cannot be installed.
    """
    folder = bridge.own_environment()
    python = str(bridge.python_of(folder))
    bridge.said([base_python(), "-m", "venv", "--clear", str(folder)])
    bridge.said([python, "-m", "pip", "install", "--disable-pip-version-check", package])
    return python


def base_python() -> str:
    """Find a Python 3.11 or later that is not that of QGIS.

    Raises
    ------
    RuntimeError
        There is none.
    """
    folders = os.pathsep.join([bridge.clean_environment().get("PATH", os.defpath), *FOLDERS])
    for path in filter(None, (shutil.which(name, path=folders) for name in PYTHONS)):
        try:
            return bridge.said([path, "-c", NEEDED])
        except (OSError, RuntimeError):  # an older one, or one without venv
            continue
    raise RuntimeError("No Python 3.11 or later with venv was found; install one first.")
