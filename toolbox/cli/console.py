"""Prints progress, messages, results and errors, for people or for programs."""

from __future__ import annotations

import logging
import os
import re
import shutil
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from toolbox import language
from toolbox.errors import DataError, ToolboxError
from toolbox.json_text import json_text
from toolbox.shown import DELIVER, README

_COLOURS = {"warning": "33", "error": "1;31"}  # yellow, bold red
_MOST_ROWS = 30  # of a table that are printed, about a screen
_SMALL = 0.01  # m, of which millimetres would be one digit or none
_LARGE = 100.0  # m2 or m3, of which a whole one is at most a hundredth
_BAR = 60  # characters of the progress bar with its time
_AS_OPTIONS = (  # what errors call by its name in Python, and how the command line writes it
    (re.compile(r"(?<![-\w])assume_crs\b(?!:)"), "--assume-crs"),
    (re.compile(r"\boverwrite=True\b"), "--overwrite"),
    (re.compile(r"(?m)^(  (\w+): .*)the option reproject="), r"\1--\2.reproject "),
)
LEVELS = {"quiet": logging.ERROR, "normal": logging.INFO, "verbose": logging.DEBUG}


class Unwritable(ToolboxError):
    """What the run has to say cannot be written."""

    exit_code = DataError.exit_code

    @classmethod
    def of(cls, err: OSError) -> Unwritable:
        return cls(f"standard output cannot be written: {err.strerror or err}")


class Console:
    """Prints for people: the result on standard output, all else on standard error.

    Parameters
    ----------
    level : "quiet", "normal" or "verbose"; quiet prints errors only, and the result if it is
        asked for as JSON
    as_json : print the result as one JSON object
    """

    def __init__(self, level: str = "normal", *, as_json: bool = False) -> None:
        self.level, self.as_json = level, as_json
        self._told: Callable[[str], None] = lambda text: None
        log = logging.getLogger("toolbox")
        log.handlers = [_Handler(self.message)]
        log.handlers[0].setLevel(LEVELS[level])
        log.setLevel(min(LEVELS[level], logging.WARNING))  # reports hold warnings also when quiet
        log.propagate = False

    @contextmanager
    def progress(self) -> Iterator[Callable[[float], None]]:
        """Show a progress bar on a terminal, and nothing elsewhere."""
        if self.level == "quiet" or not sys.stderr.isatty():
            yield lambda fraction: None
            return
        from rich.console import Console as RichConsole
        from rich.progress import Progress

        with Progress(console=RichConsole(stderr=True), transient=True) as bar:
            task = bar.add_task("", total=1.0)
            self._told = lambda text: bar.update(task, description=_short(text))
            try:
                yield lambda fraction: bar.update(task, completed=fraction)
            finally:
                self._told = lambda text: None

    def stage(self, text: str) -> None:
        """Name the step or tile that is worked on beside the progress bar."""
        self._told(text)

    def message(self, level: str, text: str) -> None:
        text = as_options(language.told(text))
        word = language.text(level)
        _warn(text if level == "info" else f"{_coloured(f'{word}:', level)} {text}")

    def result(self, description: Mapping[str, Any], outputs: Mapping[str, Any]) -> None:
        """Print the results of a tool: paths, layers and values; of several tables the first."""
        if self.as_json:
            values = {name: as_json(value) for name, value in outputs.items()}
            print(json_text({"id": description["id"]} | values_by_kind(values, outputs), indent=2))
            return
        if self.level == "quiet":
            return
        from toolbox.reports.words import is_share  # pandas comes with it, which errors need not

        tables = [name for name, value in outputs.items() if hasattr(value, "rows")]
        folded = set(tables[1:]) if self.level != "verbose" else set()
        folder = outputs.get(DELIVER)
        counted = getattr(outputs, "counted", lambda name: "")  # of the results of a run
        for name, value in outputs.items():
            if folder is not None and type(value).__name__ == "Report":
                continue  # what it holds is on the page of the set
            if name in folded:
                text = language.text("{name}: table, not printed (--{name} PATH, or --verbose)")
                print(text.format(name=name))
                continue
            said = description["outputs"].get(name, {})
            if isinstance(value, Path) and (words := counted(name)):
                print(f"{name}: {value}  ({words})")
                continue
            help, unit = said.get("description", ""), _unit(said)
            shown, unit = (100 * value, "%") if is_share(value, unit, help) else (value, unit)
            self._print_value(name, shown, f" {unit}" if unit != "1" else "", language.text(help))

        if isinstance(folder, Path):
            known = {one["file"] for one in description.get("deliver", ())} | {README}
            files = ", ".join(sorted(p.name for p in folder.iterdir() if p.name in known))
            print(language.text("in {folder}: {files}").format(folder=folder, files=files))

    def _print_value(self, name: str, value: Any, unit: str, help: str) -> None:
        if isinstance(value, tuple):  # from a repeated step
            for number, item in enumerate(value, start=1):
                self._print_value(f"{name} {number}", item, unit, help)
        elif hasattr(value, "rows"):
            from toolbox.cli.tables import fitted

            print(f"{name}:")
            print(fitted(value.frame.head(_MOST_ROWS), shutil.get_terminal_size().columns))
            if (more := len(value.frame) - _MOST_ROWS) > 0:
                print(
                    language.text("... {more} more rows (all: --{name} PATH)").format(
                        more=more, name=name
                    )
                )
        elif hasattr(value, "save"):
            kind = _kind(value)
            print(
                language.text("{name}: {kind}, not saved (--{name} PATH)").format(
                    name=name, kind=kind
                )
            )
        elif isinstance(value, float):
            print(_explained(f"{name}: {_figure(value, unit)}{unit}", help))
        elif value is None:
            print(f"{name}: none")
        else:
            is_count = isinstance(value, int)
            line = f"{name}: {value}{unit if is_count else ''}"
            print(_explained(line, help if is_count else ""))

    def error(self, err: BaseException) -> int:
        """Print an error and return its exit code."""
        code = exit_code(err)
        self._report(code, as_options(language.told(_error_text(err))))
        if (not isinstance(err, ToolboxError) or err.__cause__) and self.level == "verbose":
            _warn("".join(traceback.format_exception(err)))
        return code

    def _report(self, code: int, text: str) -> None:
        word = language.text("error")
        _warn(f"{_coloured(f'{word}:', 'error')} {text}" if code != 130 else text)


class Events(Console):
    """Prints for a calling program: one JSON object per line on standard output."""

    def __init__(self, level: str = "normal") -> None:
        super().__init__(level)
        self._lock = threading.Lock()  # the job's thread and the main thread both write

    def _event(self, event: str, **content: Any) -> None:
        with self._lock:
            try:
                print(json_text({"event": event} | content), flush=True)
            except BrokenPipeError:
                raise
            except OSError as err:  # which a reader of files would take for an error of its own
                raise Unwritable.of(err) from err

    @contextmanager
    def progress(self) -> Iterator[Callable[[float], None]]:
        """Print whole percents, each once."""
        last = -1

        def report(fraction: float) -> None:
            nonlocal last
            if (percent := int(100 * fraction)) > last:
                last = percent
                self._event("progress", value=percent)

        yield report

    def stage(self, text: str) -> None:
        self._event("stage", text=text)

    def message(self, level: str, text: str) -> None:
        self._event("log", level=level, message=as_options(language.told(text)))

    def result(self, description: Mapping[str, Any], outputs: Mapping[str, Any]) -> None:
        self._event("result", outputs={name: as_json(value) for name, value in outputs.items()})

    def _report(self, code: int, text: str) -> None:
        self._event("error", code=code, message=text)


class _Handler(logging.Handler):
    """Passes log messages of the library to a console."""

    def __init__(self, message: Callable[[str, str], None]) -> None:
        super().__init__()
        self._message = message

    def emit(self, record: logging.LogRecord) -> None:
        self._message(record.levelname.lower(), record.getMessage())


def exit_code(err: BaseException) -> int:
    """The exit code for an error; what the system refuses, such as a full disk, is no mistake."""
    if isinstance(err, ToolboxError):
        return err.exit_code
    return DataError.exit_code if isinstance(err, OSError) else 1


def _coloured(word: str, level: str) -> str:
    """A word in the colour of warnings or errors, on a terminal that shows colours.

    Reference: https://no-color.org, by which a NO_COLOR that is not empty asks for none.
    """
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    if plain or level not in _COLOURS or not sys.stderr.isatty():
        return word
    return f"\033[{_COLOURS[level]}m{word}\033[0m"


def _short(text: str) -> str:
    """A text that leaves room for the progress bar beside it; brackets are no markup."""
    from rich.markup import escape

    most = max(shutil.get_terminal_size().columns - _BAR, _BAR // 2)
    return escape(text if len(text) <= most else f"{text[: most - 1]}…")


def _warn(text: str) -> None:
    """Print to standard error, unless nothing can be written there: then nobody can be told."""
    with suppress(OSError):
        print(text, file=sys.stderr, flush=True)


def as_json(value: Any) -> Any:
    """Convert a result to JSON: paths to texts, tables to lists of rows, other layers to null.

    The results of a repeated step become a list.
    """
    if isinstance(value, tuple):
        return [as_json(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "rows"):
        return value.rows()
    if hasattr(value, "save"):
        return None
    return value.item() if hasattr(value, "item") else value


def values_by_kind(values: Mapping[str, Any], outputs: Mapping[str, Any]) -> dict[str, Any]:
    """Sort results: files and layers under "outputs", numbers and texts under "statistics"."""
    layers = {name for name, value in outputs.items() if _is_layer(value)}
    return {
        "outputs": {name: value for name, value in values.items() if name in layers},
        "statistics": {name: value for name, value in values.items() if name not in layers},
    }


def _is_layer(value: Any) -> bool:
    """Whether a result is a layer or a written file, or several of these."""
    if isinstance(value, tuple):
        return any(map(_is_layer, value))
    return isinstance(value, Path) or hasattr(value, "save")


def _kind(layer: Any) -> str:
    size = f"{len(layer)} points" if hasattr(layer, "xyz") else type(layer).__name__
    return language.told(size.lower())


def _explained(line: str, help: str) -> str:
    """A figure with what it is, as far as both go into a line of the terminal."""
    told = f"{line}  ({language.uncapitalised(help)})"
    return told if help and len(told) <= shutil.get_terminal_size().columns else line


def _figure(value: float, unit: str) -> str:
    """A figure with the digits that its unit can bear: millimetres, whole square metres.

    Examples
    --------
    >>> _figure(-0.259705, " m"), _figure(0.00034142, " m"), _figure(1282049.7, " m3")
    ('-0.260', '0.00034', '1282050')
    >>> _figure(2.54321, " m2"), _figure(0.123456789, "")
    ('2.54321', '0.123457')
    """
    if unit == " m":
        return f"{value:.2g}" if abs(value) < _SMALL else f"{value:.3f}"
    return f"{value:.0f}" if unit in (" m2", " m3") and abs(value) >= _LARGE else f"{value:.6g}"


def _unit(described: Mapping[str, Any]) -> str:
    units = [m["value"] for m in described.get("metadata", []) if m["role"] == "unit"]
    return str(units[0]) if units else "1"


def as_options(text: str) -> str:
    """A message with the options of the command line, where it speaks of parameters in Python.

    Examples
    --------
    >>> as_options("a.laz has no CRS; state it with assume_crs EPSG:...")
    'a.laz has no CRS; state it with --assume-crs EPSG:...'
    >>> as_options("a.laz exists; allow it with overwrite=True")
    'a.laz exists; allow it with --overwrite'
    """
    for known, option in _AS_OPTIONS:
        text = known.sub(option, text)
    return text


def _error_text(err: BaseException) -> str:
    if isinstance(err, ToolboxError):
        return str(err)
    if isinstance(err, OSError):
        what = err.filename or language.text("cannot read or write")
        return f"{what}: {err.strerror or err}"
    asked = language.text(
        "This is a mistake in the toolbox. Run it again with --verbose and report what it prints."
    )
    return f"{type(err).__name__}: {err}\n{asked}"
