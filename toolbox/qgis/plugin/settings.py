"""The page in Settings > Options: chooses the Python of the tools, or creates an environment."""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path
from typing import Any

from qgis.core import QgsApplication, QgsMessageLog, QgsSettings, QgsTask
from qgis.gui import QgsFileWidget, QgsOptionsPageWidget, QgsOptionsWidgetFactory
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import QFormLayout, QLabel, QPushButton, QVBoxLayout

from . import bridge, language

BUNDLED = bridge.HERE / "wheel"  # with one wheel, its hash, and what it needs with hashes
HASHES, NEEDS = "SHA256", "requirements.txt"
NO_WHEEL = language.text(
    "Choose the wheel of the toolbox (.whl), or the folder of its code; names are not taken."
)
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
        self.wheel = QgsFileWidget()
        self.wheel.setFilter("Python wheel (*.whl)")
        self.wheel.setFilePath(str(bundled() or ""))
        self.wheel.setToolTip(
            f"{NO_WHEEL} {language.text('A name could be that of a package of anybody.')}"
        )
        self.found = QLabel()
        self.found.setWordWrap(True)
        self.task: Any = None
        form = QFormLayout()
        form.addRow(language.text("Python of the tools"), self.python)
        form.addRow("", self._button(language.text("Test"), self.test))
        form.addRow(language.text("Wheel to install"), self.wheel)
        form.addRow(
            "", self._button(language.text("Create an environment of its own"), self.create)
        )
        layout = QVBoxLayout(self)
        layout.addLayout(form)
        layout.addWidget(self.found)
        layout.addStretch()
        self.found.setText(
            language.text("Used now: {python}").format(python=bridge.find_python() or "-")
        )

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
        self.found.setText(language.text("Creating the environment ..."))
        self.task = QgsTask.fromFunction(
            "LiDAR Toolbox: create environment",
            create_environment,
            on_finished=self._created,
            wheel=self.wheel.filePath(),
        )
        QgsApplication.taskManager().addTask(self.task)

    def _created(self, error: Any, python: Any = None) -> None:
        if error is None:
            QgsSettings().setValue(bridge.SETTING, python)
        text = str(error or language.text("{python} runs the tools now").format(python=python))
        try:
            self.python.setFilePath(python or self.python.filePath())
            self.found.setText(text)
        except RuntimeError:  # the page was closed meanwhile
            QgsMessageLog.logMessage(text, "LiDAR Toolbox")


def bundled() -> Path | None:
    """The wheel that the plugin brings along, if it does."""
    return next(iter(sorted(BUNDLED.glob("*.whl"))), None)


def create_environment(task: Any, wheel: str = "") -> str:
    """Create an environment with the toolbox in the profile, and return its Python.

    The toolbox is installed from a file, since anybody may own its name on a package index; what it
    needs comes from there, by hashes if the plugin brings a list of them along. An environment that
    is not whole is removed.

    Parameters
    ----------
    wheel : file, or folder of the code

    Raises
    ------
    RuntimeError
        There is no suitable Python or no such file, the bundled wheel is not what was packed, or
        something cannot be installed.
    """
    source = Path(wheel)
    if not (source.suffix == ".whl" and source.is_file()) and not _is_code(source):
        raise RuntimeError(
            f"{language.text('{file} is no wheel.').format(file=wheel or '-')} {NO_WHEEL}"
        )
    needs = _checked(source) if source == bundled() else None
    folder, base = bridge.own_environment(), base_python()
    python = str(bridge.python_of(folder))
    (folder / bridge.COMPLETE).unlink(missing_ok=True)
    try:
        bridge.said([base, "-m", "venv", "--clear", str(folder)])
        pip = [python, "-m", "pip", "install", "--disable-pip-version-check"]
        if needs:
            bridge.said([*pip, "--require-hashes", "-r", str(needs)])
        bridge.said([*pip, *["--no-deps"] * bool(needs), str(source)])
        said = bridge.said([python, "-s", "-c", bridge.CHECK])
        (folder / bridge.COMPLETE).write_text(said, encoding="utf-8")
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return python


def _is_code(folder: Path) -> bool:
    return folder.is_absolute() and (folder / "pyproject.toml").is_file()


def _checked(wheel: Path) -> Path | None:
    """Compare the bundled wheel with its hash; return the list of what it needs, if there is one.

    Raises
    ------
    RuntimeError
        It is another.
    """
    said = (BUNDLED / HASHES).read_text(encoding="utf-8").split()[0]
    found = hashlib.sha256(wheel.read_bytes()).hexdigest()
    if found != said:
        raise RuntimeError(
            language.text("{file} is damaged: its hash is {found}, and should be {said}").format(
                file=wheel.name, found=found, said=said
            )
        )
    needs = BUNDLED / NEEDS
    return needs if needs.is_file() else None


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
    raise RuntimeError(
        language.text("No Python 3.11 or later with venv was found; install one first.")
    )
