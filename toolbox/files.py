"""Writes output files safely: checks their paths, and replaces files only when all are complete."""

from __future__ import annotations

import os
import platform
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

OwnFiles = Callable[[Path], tuple[Path, ...]]  # all files that belong to a path, itself included

PREFIX = ".unfinished-"
FULL = 2**20  # bytes; a disk with less space than this is full
_unfinished: set[Path] = set()  # temporary folders of this process, to remove at a hard exit
_moving = threading.Lock()  # held while outputs are moved to their paths


def problems(
    targets: Mapping[str, Path],
    suffixes: Mapping[str, tuple[str, ...]],
    own_files: Mapping[str, OwnFiles],
    inputs: Iterable[Path],
    *,
    overwrite: bool,
) -> dict[str, str]:
    """The problems of the paths of outputs, by output name.

    Parameters
    ----------
    targets : path of each output
    suffixes : file name endings that each output can be written with
    own_files : which files belong to the path of each output
    inputs : files that the run reads
    """
    reads = list(inputs)
    found: dict[str, str] = {}
    for name, path in targets.items():
        files = own_files[name](path)
        text = _wrong_format(path, suffixes[name]) or _wrong_place(files, overwrite=overwrite)
        text = text or _clash(name, files, targets, reads)
        if text:
            found[name] = text
    return found


def _clash(
    name: str, files: tuple[Path, ...], targets: Mapping[str, Path], reads: list[Path]
) -> str | None:
    """Say whether a file of this output is also an input or another output."""
    used = [own for own in files if any(_same(own, read) for read in reads)]
    if used:
        return f"{used[0]} is also an input; choose another name"
    twin = next((n for n, p in targets.items() if n != name and _same(p, files[0])), None)
    return f"{files[0]} is also the path of {twin}" if twin else None


def _wrong_format(path: Path, suffixes: tuple[str, ...]) -> str | None:
    name = path.name.lower()
    if name.endswith(".copc.laz"):
        return "cannot write COPC; use .laz"
    if name.endswith(suffixes) and name not in suffixes:
        return None
    return f"cannot write {path.suffix or 'a file without ending'}; use {', '.join(suffixes)}"


def _wrong_place(files: tuple[Path, ...], *, overwrite: bool) -> str | None:
    path, folder = files[0], files[0].parent
    try:
        there = [own for own in files if own.exists()]
    except (OSError, ValueError) as err:
        return f"{path} cannot be a file: {getattr(err, 'strerror', err)}"
    if not folder.is_dir():
        return f"there is no folder {folder}"
    if not os.access(folder, os.W_OK | os.X_OK):
        return f"no permission to write in folder {folder}"
    if folders := [own for own in there if own.is_dir()]:
        return f"{folders[0]} is a folder"
    if there and not overwrite:
        return f"{there[0]} exists; allow it with --overwrite"
    return None


def _same(one: Path, other: Path) -> bool:
    if one.exists() and other.exists():
        return one.samefile(other)
    return one.resolve() == other.resolve()


@contextmanager
def staged(targets: Mapping[Path, OwnFiles], *, overwrite: bool) -> Iterator[dict[Path, Path]]:
    """Give a path beside each target to write to; at the end move all to their targets, or none.

    Each output is written under its own name in a hidden folder beside the target, because some
    formats write several files, and is then renamed, which is atomic within a file system. What
    was there before, also files that the new output does not have, is kept until all is moved.

    Parameters
    ----------
    targets : files to write, links already followed, with what belongs to each
    overwrite : whether they may replace files

    Raises
    ------
    OSError
        A folder cannot be written, or a file has appeared that may not be replaced.
    """
    folders: dict[Path, Path] = {}
    try:
        for parent in {target.parent for target in targets}:
            _sweep(parent)
        for target in targets:
            folders[target] = _new_folder(target.parent)
        yield {target: folder / target.name for target, folder in folders.items()}
        with _moving:
            _move_all([(folders[t], own_files(t), overwrite) for t, own_files in targets.items()])
    finally:
        for folder in folders.values():
            _discard(folder)


@contextmanager
def scratch() -> Iterator[Path]:
    """Make a folder for temporary files, and remove it afterwards, also at a hard exit."""
    parent = Path(tempfile.gettempdir())
    _sweep(parent)
    folder = _new_folder(parent)
    try:
        yield folder
    finally:
        _discard(folder)


def _new_folder(parent: Path) -> Path:
    """Make a hidden folder whose name has computer and process, to find those left by a crash."""
    owner = f"{PREFIX}{platform.node()}-{os.getpid()}-"
    folder = Path(tempfile.mkdtemp(prefix=owner, dir=parent))
    _unfinished.add(folder)
    return folder


def _sweep(parent: Path) -> None:
    """Remove the temporary folders of processes of this computer that no longer run."""
    import psutil

    own = f"{PREFIX}{platform.node()}-"
    for folder in parent.glob(f"{own}*"):
        process = folder.name.removeprefix(own).partition("-")[0]
        if process.isdigit() and not psutil.pid_exists(int(process)):
            shutil.rmtree(folder, ignore_errors=True)


def _move_all(moves: Iterable[tuple[Path, tuple[Path, ...], bool]]) -> None:
    """Move the files of each folder to its parent; undo all moves if one fails."""
    undo: list[tuple[Path, Path]] = []
    try:
        for folder, old_parts, overwrite in moves:
            new = sorted(path for path in folder.iterdir() if path.is_file())
            old = {*old_parts, *(folder.parent / path.name for path in new)}
            kept = folder / "replaced"
            kept.mkdir()
            for path in sorted(path for path in old if path.is_file()):
                if not overwrite:
                    raise FileExistsError(f"{path} has appeared meanwhile")
                undo.append((path.replace(kept / path.name), path))
            for path in new:
                undo.append((path.replace(folder.parent / path.name), path))
    except OSError:
        for now, before in reversed(undo):
            now.replace(before)
        raise


def is_full(folder: Path) -> bool:
    """Whether the disk of a folder is full, or nearly so."""
    return shutil.disk_usage(folder).free < FULL


def discard_unfinished() -> None:
    """Remove the temporary folders of this process, before a hard exit."""
    with _moving:
        for folder in list(_unfinished):
            _discard(folder)


def _discard(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    _unfinished.discard(folder)
