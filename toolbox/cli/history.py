"""The history of a user: a file with one line of JSON for each run on this computer.

Unlike the provenance record of a product (`toolbox.runs.provenance`), it has full paths and times,
and also the runs that failed; so only the user may read it. The file is in the user's state folder,
or where the environment variable TOOLBOX_HISTORY says; if that is empty, there is no history.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from toolbox import __version__
from toolbox.context import log
from toolbox.json_text import json_text
from toolbox.shown import SHOWN

VARIABLE = "TOOLBOX_HISTORY"
FULL = 10_000_000  # bytes after which a new file is begun
OWN = 0o600  # permissions: only the user may read and write
KEPT = 5  # full files, of which older ones are deleted

Entry = dict[str, Any]


def file() -> Path | None:
    """The path of the history; None if the user wants none."""
    given = os.environ.get(VARIABLE)
    if given is not None:
        return Path(given) if given else None
    from platformdirs import user_state_path

    return user_state_path("lidar-toolbox", appauthor=False) / "history.jsonl"


def add(
    tool: str,
    described: Mapping[str, Any],
    values: Mapping[str, Any],
    outputs: Mapping[str, Any],
    *,
    seconds: float,
    code: int,
) -> None:
    """Add one run to the history; a failure to do so is logged and does not stop anything.

    Parameters
    ----------
    tool : id, or path of a model file
    described : process description of the tool
    values : inputs and paths of outputs; paths become absolute
    outputs : results; layers that were not written are left out
    seconds : duration of the run
    code : exit code
    """
    entry = {
        "time": datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
        "id": _absolute(tool) if tool != described["id"] else tool,
        "values": {n: _absolute(v) if _is_layer(described, n) else v for n, v in values.items()},
        "outputs": {n: v for n, v in map(_written, outputs, outputs.values()) if v is not None},
        "seconds": round(seconds, 2),
        "exit": code,
        "version": __version__,
    }
    path = file()
    if path is None:
        return
    try:
        line = json_text(entry, default=str)
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with contextlib.suppress(FileNotFoundError):  # none yet, or put aside by another process
            path.chmod(OWN)  # if somebody has opened it to others
        _begin_anew_if_full(path)
        _append(path, line.encode())
    except (OSError, ValueError) as error:
        log.warning("the run is not kept in the history %s: %s", path, error)


def entries() -> Iterator[Entry]:
    """Read all runs, the oldest first; damaged lines are left out.

    Raises
    ------
    OSError
        A file cannot be read.
    """
    path = file()
    if path is None:
        return
    for each in (*_full_ones(path), *([path] if path.exists() else [])):
        with each.open("rb") as lines:
            for line in lines:
                if (entry := _entry(line)) is not None:
                    yield entry


def text(entry: Entry) -> str:
    """The text of one run, for people."""
    code = entry.get("exit")
    result = "" if code == 0 else f"  (exit code {code})"
    words = [f"--{name} {_word(value)}" for name, value in dict(entry.get("values", {})).items()]
    head = f"{entry.get('time', '')}  {entry.get('seconds', 0):g} s{result}"
    return f"{head}\n  {' '.join([str(entry.get('id', '')), *words])}"


def _entry(line: bytes) -> Entry | None:
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _word(value: Any) -> str:
    if isinstance(value, Mapping):
        return str(value.get("path", "")) or json.dumps(value)
    return ",".join(map(_word, value)) if isinstance(value, list) else str(value)


def _is_layer(described: Mapping[str, Any], name: str) -> bool:
    """Whether a value is the path of a layer."""
    if name in {*SHOWN, *described["outputs"], *described.get("between", {})}:
        return True
    schema = described["inputs"].get(name, {}).get("schema", {})
    return "contentMediaType" in {**schema, **schema.get("items", {})}


def _absolute(value: Any) -> Any:
    """Make relative paths absolute."""
    if isinstance(value, Mapping):
        return dict(value) | ({"path": _absolute(value["path"])} if "path" in value else {})
    if isinstance(value, list | tuple):
        return [_absolute(item) for item in value]
    return os.path.abspath(value) if isinstance(value, str | Path) and str(value) else value


def _written(name: str, value: Any) -> tuple[str, Any]:
    """The name of a result and its path or value; None for a layer that was not written."""
    if isinstance(value, tuple):
        return name, [_written(name, item)[1] for item in value]
    if isinstance(value, Path):
        return name, os.path.abspath(value)
    value = value.item() if hasattr(value, "item") else value
    return name, value if isinstance(value, str | int | float) else None


def _append(path: Path, line: bytes) -> None:
    """Add a line in one write, so that several processes may add lines at the same time.

    A line that was cut off, as by a full disk, is ended first, or it would spoil this one, too.
    """
    with open(path, "ab+", buffering=0, opener=_opened) as file:
        size = file.seek(0, os.SEEK_END)
        if size:
            file.seek(size - 1)
            line = line if file.read(1) == b"\n" else b"\n" + line
        if file.write(line + b"\n") != len(line) + 1:
            raise OSError("the disk is full")


def _opened(path: str, flags: int) -> int:
    return os.open(path, flags, OWN)


def _begin_anew_if_full(path: Path) -> None:
    """Rename a full file to a unique name, since another process may do the same."""
    try:
        if path.stat().st_size < FULL:
            return
        path.rename(path.with_name(f"{path.stem}.{time.time_ns()}-{os.getpid()}{path.suffix}"))
    except FileNotFoundError:  # there is none yet, or another process was faster
        return
    for old in _full_ones(path)[:-KEPT]:
        old.unlink(missing_ok=True)


def _full_ones(path: Path) -> list[Path]:
    """The full files that were renamed, the oldest first."""
    return sorted(path.parent.glob(f"{path.stem}.*-*{path.suffix}"))
