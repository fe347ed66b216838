"""The runs of this user on this computer: one line of JSON each, in a file that only grows.

Other than the record that a product carries (`toolbox.runs.provenance`) this is about where and
when: full paths, times, and also what has failed. It is kept in the user's state folder, or in the
file that the environment variable TOOLBOX_HISTORY names; if that is empty, nothing is kept.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from toolbox import __version__
from toolbox.context import log
from toolbox.shown import SHOWN

VARIABLE = "TOOLBOX_HISTORY"
FULL = 10_000_000  # bytes after which a new file is begun
KEPT = 5  # full files that are kept

Entry = dict[str, Any]


def place() -> Path | None:
    """The file to which runs are added; None if the user wants none."""
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
    """Keep one run; whatever goes wrong is logged, and does no harm.

    Parameters
    ----------
    tool : its id, or the path of a model file, as it was given
    described : the process description of the tool
    values : that it was given; paths of layers become absolute
    outputs : that it gave; layers that were not written are left out
    seconds : that the run took
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
    path = place()
    if path is None:
        return
    try:
        line = json.dumps(entry, default=str)
        path.parent.mkdir(parents=True, exist_ok=True)
        _begin_anew_if_full(path)
        _append(path, line.encode())
    except (OSError, ValueError) as error:
        log.warning("the run is not kept in the history %s: %s", path, error)


def entries() -> Iterator[Entry]:
    """All runs that are kept, the oldest first; lines that are damaged are left out.

    Raises
    ------
    OSError
        A file cannot be read.
    """
    path = place()
    if path is None:
        return
    for file in (*_full_ones(path), *([path] if path.exists() else [])):
        with file.open("rb") as lines:
            for line in lines:
                if (entry := _entry(line)) is not None:
                    yield entry


def text(entry: Entry) -> str:
    """One run in a few words, for people."""
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
    """Paths from wherever the run was started as paths from everywhere."""
    if isinstance(value, Mapping):
        return dict(value) | ({"path": _absolute(value["path"])} if "path" in value else {})
    if isinstance(value, list | tuple):
        return [_absolute(item) for item in value]
    return os.path.abspath(value) if isinstance(value, str | Path) and str(value) else value


def _written(name: str, value: Any) -> tuple[str, Any]:
    """Paths and numbers; None for a layer that was not written."""
    if isinstance(value, tuple):
        return name, [_written(name, item)[1] for item in value]
    if isinstance(value, Path):
        return name, os.path.abspath(value)
    value = value.item() if hasattr(value, "item") else value
    return name, value if isinstance(value, str | int | float) else None


def _append(path: Path, line: bytes) -> None:
    """Add a line in one piece, so that several processes may do so at a time.

    A line that was cut off, as by a full disk, is ended first, or it would spoil this one too.
    """
    with path.open("ab+", buffering=0) as file:
        size = file.seek(0, os.SEEK_END)
        if size:
            file.seek(size - 1)
            line = line if file.read(1) == b"\n" else b"\n" + line
        if file.write(line + b"\n") != len(line) + 1:
            raise OSError("the disk is full")


def _begin_anew_if_full(path: Path) -> None:
    """Put a full file aside, under a name of its own: another process may do so at once too."""
    try:
        if path.stat().st_size < FULL:
            return
        path.rename(path.with_name(f"{path.stem}.{time.time_ns()}-{os.getpid()}{path.suffix}"))
    except FileNotFoundError:  # there is none yet, or another process was faster
        return
    for old in _full_ones(path)[:-KEPT]:
        old.unlink(missing_ok=True)


def _full_ones(path: Path) -> list[Path]:
    """Files that were put aside, the oldest first."""
    return sorted(path.parent.glob(f"{path.stem}.*-*{path.suffix}"))
