"""Puts several files in their places, or none of them: after an error, and after a kill.

Each file is renamed over what stands there, which is atomic. No file system does so with several
files at a time; so while it is done, a second link keeps each file that is replaced or removed,
and a journal says what is to be undone. Removing the journal is what makes the moves final.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PREFIX = ".unfinished-"  # of the name of a hidden folder
NEW, OLD = "new", "old"  # in a hidden folder: files to put in their places, links to those there
_JOURNAL, _MAIN = "journal", "main"  # the moves; which of the hidden folders has the journal


@dataclass(frozen=True)
class Move:
    """A change of one file: what is put in its place, and how that is undone.

    Attributes
    ----------
    target : its path
    new : the file to put there; None if it is to be removed
    old : a second link to the file that stands there; None if there is none
    state : of the file that stands there after the move; None for no file
    """

    target: Path
    new: Path | None
    old: Path | None
    state: tuple[int, ...] | None

    @classmethod
    def of(cls, target: Path, new: Path | None, old: Path | None) -> Move:
        """The move to a target of a file that is whole."""
        return cls(target, new, old, _state(new) if new else None)

    def do(self, *, overwrite: bool) -> None:
        if self.new is None:
            self.target.unlink(missing_ok=True)
        elif overwrite or not _linked(self.new, self.target):
            self.new.replace(self.target)

    def undo(self) -> None:
        """Put back what was there; not if the move was not made, or somebody else wrote since."""
        if _state(self.target) != self.state:
            return
        if self.old:
            self.old.replace(self.target)
        else:
            self.target.unlink(missing_ok=True)


def prepared(folders: Mapping[Path, Path], own: Iterable[Path], *, overwrite: bool) -> list[Move]:
    """The moves of all new files of hidden folders, which are flushed to the disk.

    Parameters
    ----------
    folders : the hidden folders by the folders that the files belong in
    own : all paths that belong to the outputs; files there that are not written anew are removed
    overwrite : whether files may be replaced or removed

    Raises
    ------
    OSError
        The disk is full, or a file has appeared that may not be replaced.
    """
    made = [(parent, path) for parent, f in folders.items() for path in sorted((f / NEW).iterdir())]
    new = {parent / path.name: path for parent, path in made if path.is_file()}
    there = [path for path in dict.fromkeys([*new, *own]) if path.is_file()]
    if there and not overwrite:
        raise FileExistsError(f"{there[0]} has appeared meanwhile")
    paths = dict.fromkeys([*new, *there])
    alone = len(paths) == 1  # replaced at once, so that nothing needs to be undone
    old = {} if alone else {p: _kept(p, folders[p.parent] / OLD / p.name) for p in there}
    for path in new.keys() & set(there):
        shutil.copymode(path, new[path])
    for path in new.values():
        _flush(path)
    return [Move.of(path, new.get(path), old.get(path)) for path in paths]


def make(moves: Sequence[Move], folders: Mapping[Path, Path], *, overwrite: bool) -> None:
    """Make all moves, or none.

    Raises
    ------
    OSError
        One cannot be made; the others are undone.
    """
    if not moves:
        return
    main = next(iter(folders.values()))
    if len(moves) > 1:
        _note(moves, main, folders)
    try:
        for move in moves:
            move.do(overwrite=overwrite)
        for parent in folders:
            _flush(parent)
    except BaseException:
        for move in reversed(moves):
            move.undo()  # if that fails, the journal stays for the next run
        (main / _JOURNAL).unlink(missing_ok=True)
        raise
    (main / _JOURNAL).unlink(missing_ok=True)
    _flush(main)


def unsettled(folder: Path) -> bool:
    """Whether a hidden folder takes part in moves that are neither all made nor all undone."""
    return _journal_of(folder).exists()


def undo(folder: Path) -> None:
    """Undo the moves in which a hidden folder takes part, if they were not all made.

    Raises
    ------
    OSError
        A file cannot be put back.
    ValueError
        The journal is none that this module has written.
    """
    journal = _journal_of(folder)
    if not journal.exists():
        return
    entries = json.loads(journal.read_text(encoding="utf-8"))
    try:
        made = [_noted(journal, *entry) for entry in entries]
    except TypeError as err:
        raise ValueError(f"{journal} is damaged: {err}") from None
    for move in reversed(made):
        move.undo()
    journal.unlink(missing_ok=True)


def _noted(journal: Path, hidden: str, name: str, kept: bool, state: Iterable[int] | None) -> Move:
    """The move of an entry, if it is made beside a hidden folder that belongs to the journal.

    A hidden folder may come out of an archive of a stranger: what it says must not reach files
    where no hidden folder of the same run is.
    """
    folder = journal.parent / hidden
    inside = folder.name.startswith(PREFIX) and journal.parent.name.startswith(PREFIX)
    linked = folder.is_symlink() or (folder / OLD).is_symlink()
    if linked or not inside or Path(name).name != name or not _same(_journal_of(folder), journal):
        raise ValueError(f"{journal} names {folder.parent / name}, which is not its own")
    old = folder / OLD / name if kept else None
    return Move(folder.parent / name, None, old, tuple(state) if state else None)


def _same(one: Path, other: Path) -> bool:
    return one.exists() and one.samefile(other)


def _note(moves: Iterable[Move], main: Path, folders: Mapping[Path, Path]) -> None:
    """Write the journal, with paths as seen from its folder, which may be mounted elsewhere."""
    for folder in folders.values():
        _write(folder / _MAIN, os.path.relpath(main, folder))
    beside = {parent: os.path.relpath(folder, main) for parent, folder in folders.items()}
    entries: list[Any] = [
        [beside[m.target.parent], m.target.name, m.old is not None, m.state] for m in moves
    ]
    _write(main / f"{_JOURNAL}.draft", json.dumps(entries))
    for folder in folders.values():
        _flush(folder / OLD)
    (main / f"{_JOURNAL}.draft").replace(main / _JOURNAL)
    for folder in folders.values():
        _flush(folder)


def _journal_of(folder: Path) -> Path:
    main = folder / _MAIN
    return folder / (main.read_text(encoding="utf-8") if main.exists() else "") / _JOURNAL


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
    _flush(path)


def _state(path: Path) -> tuple[int, ...] | None:
    """What tells a file from others, also after it was renamed; None if there is none."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


def _kept(path: Path, link: Path) -> Path:
    """Make a second link to a file, or a copy where the file system has no links."""
    try:
        os.link(path, link)
    except OSError:
        shutil.copy2(path, link)
        _flush(link)
    return link


def _linked(new: Path, target: Path) -> bool:
    """Link a file to a path where none may be replaced; false where there are no links."""
    try:
        os.link(new, target)
    except FileExistsError:
        raise FileExistsError(f"{target} has appeared meanwhile") from None
    except OSError:
        return False
    return True


def _flush(path: Path) -> None:
    """Have the disk hold a file, or the names in a folder, also if the power fails."""
    if path.is_dir():
        with suppress(OSError):  # not every system can do so with a folder
            _synced(path, os.O_RDONLY)
    else:
        _synced(path, os.O_RDWR)


def _synced(path: Path, flags: int) -> None:
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
