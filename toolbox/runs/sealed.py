"""Tells the set that an earlier run has handed over from files of other people.

Its README ends with the checksums of its files, of itself and the name of the tool. A later run of
that tool replaces files that are as they were written, and no others: nobody asks again, neither
the command line after --overwrite nor the dialog of QGIS.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from toolbox.shown import README

OF_SYSTEMS = ("thumbs.db", "desktop.ini")  # a folder with these and hidden files is empty
DERIVED = (".aux.xml", ".ovr", ".qix", "-shm")  # what a GIS makes beside a file by reading it
_FILE = re.compile(r"(?m)^([0-9a-f]{64})  ([^/\\\n]+)$")
_TEXT = re.compile(r"(\S+): ([0-9a-f]{64})\n\Z")
_CHANGED = "was changed after the set had been written"
_ELSE = "name a new or an empty folder"


def sums(paths: Iterable[Path]) -> dict[str, str]:
    """The SHA-256 of each file by its name, in the order of names.

    Files that a GIS writes anew as it reads the others, as QGIS does with statistics, have none.
    """
    return {path.name: _sum(path) for path in sorted(paths) if not path.name.endswith(DERIVED)}


def sealed(text: str, tool: str) -> str:
    """The text of a README with its own checksum, by which an edited one is known."""
    return f"{text}{tool}: {hashlib.sha256(text.encode()).hexdigest()}\n"


def files_of(folder: Path) -> list[Path]:
    """The files of the set in a folder that has no `problem`, and what a GIS has made of them."""
    names = (n + end for n in _listed(_text(folder / README)) for end in ("", *DERIVED))
    return [folder / name for name in names if (folder / name).is_file()]


def problem(folder: Path, tool: str, replaces: Iterable[Path]) -> str | None:
    """Why a set may not be written into a folder that exists; None if nothing would be lost.

    Parameters
    ----------
    folder : links followed
    tool : id of the tool that writes the set
    replaces : the paths that the run writes or removes in it
    """
    there = sorted(path.name for path in folder.iterdir() if not _is_of_system(path.name))
    if not there:
        return None
    text = _text(folder / README)
    seal = _TEXT.search(text)
    if not seal:
        holds = f"{folder} holds other files, such as {there[0]}, and no set of this toolbox"
        return f"{holds}: {_ELSE}"
    if seal[1] != tool:
        return f"{folder} holds the set of {seal[1]}: {_ELSE}"
    if sealed(text[: seal.start()], tool) != text:
        return f"{README} in {folder} {_CHANGED}: {_ELSE}"
    listed = _listed(text)
    own = next((path for path in replaces if _is_foreign(path, {*listed, README})), None)
    if own:
        return f"{own.name} in {folder} is not of the set there: move it elsewhere, or {_ELSE}"
    return next(map(_moved, _differing(folder, listed)), None)


def _listed(text: str) -> dict[str, str]:
    return {name: found for found, name in _FILE.findall(text)}


def _moved(path: Path) -> str:
    return f"{path.name} in {path.parent} {_CHANGED}: move it elsewhere, or {_ELSE}"


def _differing(folder: Path, listed: Mapping[str, str]) -> Iterable[Path]:
    fixed = (name for name in listed if not name.endswith(DERIVED))  # older sets list all
    there = (folder / name for name in fixed if (folder / name).exists())
    return (path for path in there if path.is_dir() or _sum(path) != listed[path.name])


def _is_foreign(path: Path, names: Iterable[str]) -> bool:
    """Whether a file that would be replaced is none of the set, nor made from one by reading it."""
    if path.name in names or path.name.endswith(DERIVED) or not path.exists():
        return False
    return path.is_dir() or path.stat().st_size > 0  # SQLite leaves empty journals


def _is_of_system(name: str) -> bool:
    return name.startswith(".") or name.lower() in OF_SYSTEMS


def _text(path: Path) -> str:
    try:
        return path.read_bytes().decode("utf-8")  # read_text would make the ends of lines alike
    except (OSError, ValueError):
        return ""


def _sum(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
