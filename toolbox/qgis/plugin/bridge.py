"""Finds the Python of the tools, and runs a tool with it.

The tool reads its values from standard input, as one line of JSON. The input stays open; its end
stops the tool, also if QGIS crashes. The tool prints one JSON object per line.
"""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from qgis.core import QgsApplication, QgsProcessingException, QgsSettings
from qgis.PyQt.QtCore import QCoreApplication, QThread

from . import language

HERE = Path(__file__).parent
PROVIDER = "lidartoolbox"
PYTHON, ROOT = "LIDAR_TOOLBOX_PYTHON", "LIDAR_TOOLBOX_ROOT"
SETTING = "lidar_toolbox/python"
INSTALLED = HERE / "environment.json"  # written by `python -m toolbox qgis install`
# Variables that QGIS sets for its own libraries, and that would break ours.
FOREIGN = ("PYTHON", "GDAL_", "PROJ_", "CPL_", "QT_", "OSGEO4W", "GRASS", "GISBASE")
FOREIGN_EXACT = {
    "LD_LIBRARY_PATH",
    "LD_PRELOAD",
    "DYLD_LIBRARY_PATH",
    "DYLD_FALLBACK_LIBRARY_PATH",
    "DYLD_INSERT_LIBRARIES",
    "GEOTIFF_CSV",
    "PDAL_DRIVER_PATH",
    "VIRTUAL_ENV",
    "CONDA_PREFIX",
    "__PYVENV_LAUNCHER__",
    "SSL_CERT_FILE",
}
OURS = {"GDAL_CACHEMAX", "GDAL_NUM_THREADS", "PROJ_NETWORK", "CPL_TMPDIR"}
COMPLETE = "complete.txt"  # of an environment that was created to the end
GRACE = 5.0  # seconds that a tool has to stop before it is killed
POLL = 0.05
TAIL = 60  # lines of standard error that are kept
CHECK = "from toolbox.qgis.tools import listing; print('lidar-toolbox', listing()['toolbox'])"


def find_python() -> str | None:
    """The path of the Python of the tools; not that of QGIS, which lacks their libraries."""
    if said := _named():
        return said if os.path.isfile(said) else None
    usual = [str(_installed().get("python", ""))]
    if (own_environment() / COMPLETE).is_file():  # else its creation was cut off
        usual.append(str(python_of(own_environment())))
    return next((path for path in usual if os.path.isfile(path)), None)


def _named() -> str:
    """The Python that the variable or the settings page names, if any."""
    return str(os.environ.get(PYTHON) or QgsSettings().value(SETTING, "") or "")


def missing() -> str:
    """The message if no Python was found, and how to choose one."""
    ways = language.text(
        "Choose or create one in Settings > Options > LiDAR Toolbox, run 'python -m toolbox qgis "
        "install', or set {variable}."
    ).format(variable=PYTHON)
    if said := _named():
        what = language.text("No Python environment for the LiDAR Toolbox was found at {path}.")
        return f"{what.format(path=said)} {ways}"
    return f"{language.text('No Python environment for the LiDAR Toolbox was found.')} {ways}"


def own_environment() -> Path:
    """The folder of the environment that the settings page creates."""
    return Path(QgsApplication.qgisSettingsDirPath()) / "lidar_toolbox_env"


def python_of(environment: Path) -> Path:
    return environment / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def _installed() -> dict[str, Any]:
    try:
        return dict(json.loads(INSTALLED.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return {}


def _root() -> str:
    """The folder of a checkout that is not installed; empty if there is none."""
    return os.environ.get(ROOT) or str(_installed().get("root", ""))


def clean_environment() -> dict[str, str]:
    """The environment variables of QGIS without those of its own Python and libraries."""
    env = {
        name: value
        for name, value in os.environ.items()
        if name in OURS or not (name in FOREIGN_EXACT or name.upper().startswith(FOREIGN))
    }
    if os.name == "nt":  # the folders of QGIS come first there, with libraries of the same names
        top = os.path.dirname(os.path.dirname(_plain_path(QgsApplication.prefixPath())))
        folders = env.get("PATH", "").split(os.pathsep)
        env["PATH"] = os.pathsep.join(f for f in folders if not _plain_path(f).startswith(top))
    env |= {"PYTHONNOUSERSITE": "1", "PYTHONSAFEPATH": "1"}  # nothing from where QGIS works
    env[language.VARIABLE] = language.chosen()
    if root := _root():
        env["PYTHONPATH"] = root
    return env


def _plain_path(path: str) -> str:
    """Normalise a path for comparison, without short names such as PROGRA~1."""
    return os.path.normcase(os.path.realpath(path))


def command(*words: str) -> list[str]:
    """The command that starts the toolbox.

    Raises
    ------
    QgsProcessingException
        There is no Python for it.
    """
    python = find_python()
    if python is None:
        raise QgsProcessingException(missing())
    return [python, "-s", "-X", "utf8", "-u", *words]


def hidden() -> dict[str, Any]:
    """Options of a process: no console window on Windows, no Ctrl-C from a terminal elsewhere."""
    return {"creationflags": 0x08000000} if os.name == "nt" else {"start_new_session": True}


def said(words: list[str]) -> str:
    """Run a command and give what it prints.

    Raises
    ------
    RuntimeError
        It failed; with the last lines that it printed.
    """
    done = subprocess.run(
        words,
        env=clean_environment(),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        check=False,
        **hidden(),
    )
    if done.returncode:
        last = "\n".join((done.stderr or done.stdout).strip().splitlines()[-5:])
        raise RuntimeError(f"{os.path.basename(words[0])} failed:\n{last}")
    return done.stdout.strip()


def run(
    tool: str,
    options: list[str],
    values: dict[str, Any],
    feedback: Any,
    words: Callable[[str], str] = str,
) -> dict[str, Any]:
    """Run one tool and return its outputs.

    Parameters
    ----------
    tool : its id
    options : words of the command line
    values : its inputs and paths of outputs
    feedback : takes progress and messages, and may cancel the run
    words : puts the messages of the tool into other words

    Raises
    ------
    QgsProcessingException
        It failed, with the message of the tool.
    Cancelled
        It was cancelled.
    """
    line = command("-m", "toolbox", "run", tool, "--params", "-", "--events", "jsonl", *options)
    feedback.pushInfo(language.text("The same on the command line:"))
    feedback.pushCommandInfo(repeated(line[0], tool, options, values))
    try:
        child = _Child(line, feedback, words)
    except OSError as err:
        raise QgsProcessingException(
            language.text("Cannot start {program}: {why}").format(program=line[0], why=err)
        ) from None
    try:
        child.say(values)
        child.wait()
    finally:
        child.close()
    if child.result is None and child.stop_at is None:
        _tell_of_another_version(feedback)
    return child.outputs()


def repeated(python: str, tool: str, options: list[str], values: dict[str, Any]) -> str:
    """The command that does the same without QGIS, for a terminal of this system."""
    words = [python, "-m", "toolbox", "run", tool]
    for name, value in values.items():
        if isinstance(value, dict):  # a layer of a file
            words += [f"--{name}", value["path"], f"--{name}.layer", value["layer"]]
        elif isinstance(value, (list, tuple)):
            numbers = all(isinstance(item, (int, float)) for item in value)
            several = [",".join(map(str, value))] if numbers else list(map(str, value))
            words += [f"--{name}={several[0]}"] if numbers else [f"--{name}", *several]
        else:
            words += [f"--{name}={value}"] if str(value)[:1] == "-" else [f"--{name}", str(value)]
    words += options
    return subprocess.list2cmdline(words) if os.name == "nt" else shlex.join(words)


def _ended(code: int) -> str:
    """What the end of a process without a word means, and what to do."""
    if code in (-9, 137):
        return language.text(
            "The system ended the tool (signal 9), as it does when memory runs out. Give a tile "
            "size under Advanced, such as auto, or work on a part of the data."
        )
    return language.text(
        "The tool ended with exit code {code} and without a message. If memory was short, give a "
        "tile size under Advanced, such as auto."
    ).format(code=code)


def _tell_of_another_version(feedback: Any) -> None:
    """Warn if the Python of the tools has another version than the plugin."""
    try:
        there = said(command("-m", "toolbox", "--version")).rpartition(" ")[2]
    except (OSError, RuntimeError):  # it has told already what is wrong
        return
    here = json.loads((HERE / "tools.json").read_text(encoding="utf-8"))["toolbox"]
    if there != here:
        text = language.text(
            "The Python of the tools has version {there}, and this plugin is of {here}. "
            "Run 'python -m toolbox qgis install' there."
        )
        feedback.pushWarning(text.format(there=there, here=here))


class Cancelled(QgsProcessingException):
    """The user has stopped the run."""


class _Child:
    """A running tool. Only the thread that made this object uses the feedback."""

    def __init__(self, line: list[str], feedback: Any, words: Callable[[str], str]) -> None:
        self.feedback, self.words = feedback, words
        self.lines: deque[str] = deque()
        self.tail: deque[str] = deque(maxlen=TAIL)
        self.error: str | None = None
        self.result: dict[str, Any] | None = None
        self.stop_at: float | None = None
        pipe = subprocess.PIPE
        self.process: Any = subprocess.Popen(
            line,
            stdin=pipe,
            stdout=pipe,
            stderr=pipe,
            env=clean_environment(),
            encoding="utf-8",
            errors="replace",
            **hidden(),
        )
        pairs = ((self.process.stdout, self.lines), (self.process.stderr, self.tail))
        self.readers = [threading.Thread(target=_read, args=pair, daemon=True) for pair in pairs]
        for reader in self.readers:
            reader.start()

    def say(self, values: dict[str, Any]) -> None:
        try:
            self.process.stdin.write(json.dumps(values) + "\n")
            self.process.stdin.flush()
        except OSError:  # it has ended already, and its output says why
            pass

    def wait(self) -> None:
        while self.process.poll() is None:
            self._show()
            _let_qt_work()
            self._stop_if_asked()
            time.sleep(POLL)
        for reader in self.readers:
            reader.join(2)
        self._show()

    def _stop_if_asked(self) -> None:
        if self.stop_at is None:
            if self.feedback.isCanceled():
                self.stop_at = time.monotonic() + GRACE
                self._end_input()
        elif time.monotonic() > self.stop_at:
            self.process.kill()

    def _end_input(self) -> None:
        try:
            self.process.stdin.close()
        except OSError:
            pass

    def _show(self) -> None:
        while self.lines:
            self._take(self.lines.popleft())

    def _take(self, line: str) -> None:
        try:
            self._follow(json.loads(line))
        except (ValueError, KeyError, TypeError):  # a library that prints
            if line.strip():
                self.feedback.pushConsoleInfo(line.rstrip())

    def _follow(self, event: dict[str, Any]) -> None:
        kind = event["event"]
        if kind == "progress":
            self.feedback.setProgress(float(event["value"]))
        elif kind == "stage":
            self.feedback.setProgressText(event["text"])
        elif kind == "log":
            self._log(event["level"], self.words(event["message"]))
        elif kind == "error":
            self.error = event["message"]
        elif kind == "result":
            self.result = event["outputs"]

    def _log(self, level: str, text: str) -> None:
        if level == "debug":
            self.feedback.pushDebugInfo(text)
        elif level == "info":
            self.feedback.pushInfo(text)
        else:
            self.feedback.pushWarning(text)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self._end_input()
        for reader in self.readers:
            reader.join(2)
        for stream in (self.process.stdout, self.process.stderr):
            stream.close()

    def outputs(self) -> dict[str, Any]:
        if self.stop_at is not None and self.result is None:  # else it came too late
            raise Cancelled("Cancelled.")
        said = "\n".join(self.tail)
        if self.error is not None:
            self.feedback.pushDebugInfo(said)
            raise QgsProcessingException(self.error)
        if self.result is None:
            raise QgsProcessingException(f"{_ended(self.process.returncode)}\n{said}".strip())
        return self.result


def _read(stream: Any, into: deque[str]) -> None:
    for line in stream:
        into.append(line)


def _let_qt_work() -> None:
    """Process the events of Qt, through which Ctrl-C of qgis_process reaches the main thread."""
    app = QCoreApplication.instance()
    if app is not None and QThread.currentThread() == app.thread():
        app.processEvents()
