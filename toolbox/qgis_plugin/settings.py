"""The page in Settings > Options: which Python runs the tools, or a new one for them."""

from __future__ import annotations

import os
import shutil
import subprocess
from typing import Any

from qgis.core import QgsApplication, QgsSettings, QgsTask
from qgis.gui import QgsFileWidget, QgsOptionsPageWidget, QgsOptionsWidgetFactory
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import QFormLayout, QLabel, QLineEdit, QPushButton, QVBoxLayout

from . import bridge

PACKAGE = "lidar-toolbox"
PYTHONS = ("python3.13", "python3.12", "python3.11", "python3", "python")
NEEDED = "import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))"


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
        """Say which toolbox the chosen Python has."""
        self.apply()
        try:
            words = bridge.command("--version")
            self.found.setText(f"{words[0]}: {_said(words)}")
        except Exception as err:
            self.found.setText(str(err))

    def create(self) -> None:
        """Make an environment in the profile, in the background: it takes a minute or two."""
        self.found.setText("Creating the environment ...")
        self.task = QgsTask.fromFunction(
            "LiDAR Toolbox: create environment",
            create_environment,
            on_finished=self._created,
            package=self.package.text() or PACKAGE,
        )
        QgsApplication.taskManager().addTask(self.task)

    def _created(self, error: Any, python: Any = None) -> None:
        if error is not None:
            self.found.setText(str(error))
            return
        self.python.setFilePath(python)
        self.test()


def create_environment(task: Any, package: str = PACKAGE) -> str:
    """Make an environment with the toolbox in the profile and return its Python.

    Raises
    ------
    RuntimeError
        There is no suitable Python, or the package cannot be installed.
    """
    home = bridge.own_environment()
    python = str(bridge.python_of(home))
    _said([base_python(), "-m", "venv", "--clear", str(home)])
    _said([python, "-m", "pip", "install", "--disable-pip-version-check", package])
    return python


def base_python() -> str:
    """A Python 3.11 or later on the search path: never that of QGIS.

    Raises
    ------
    RuntimeError
        There is none.
    """
    env = bridge.clean_environment()
    for name in PYTHONS:
        path = shutil.which(name, path=env.get("PATH"))
        if path:
            words = [path, "-c", NEEDED]
            done = subprocess.run(
                words, env=env, capture_output=True, check=False, **bridge.hidden()
            )
            if done.returncode == 0:
                return path
    raise RuntimeError(
        "No Python 3.11 or later with venv was found; install one, or choose it here."
    )


def _said(words: list[str]) -> str:
    """What a command prints; RuntimeError with its last lines if it fails."""
    done = subprocess.run(
        words, env=bridge.clean_environment(), stdin=subprocess.DEVNULL, capture_output=True,
        encoding="utf-8", errors="replace", check=False, **bridge.hidden(),
    )  # fmt: skip
    if done.returncode:
        last = "\n".join((done.stderr or done.stdout).strip().splitlines()[-5:])
        raise RuntimeError(f"{os.path.basename(words[0])} failed:\n{last}")
    return done.stdout.strip()
