"""Writes output files safely: checks their paths, and replaces files only when all are complete."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from toolbox import moves
from toolbox.context import log

if sys.platform == "win32":
    fcntl = None
else:
    import fcntl

if TYPE_CHECKING:
    from filelock import FileLock

OwnFiles = Callable[[Path], tuple[Path, ...]]  # all files that belong to a path, itself included

GEOTIFF = {".tif", ".tiff"}  # endings of rasters
LOCK = "lock"  # file in a temporary folder, locked while the process lives that made it
OTHERS_WRITE = 0o022  # of the mode of a folder
FULL = 2**20  # bytes; a disk with less space than this is full
_unfinished: dict[Path, FileLock] = {}  # temporary folders of this process, removed at a hard exit
_made: set[Path] = set()  # folders for outputs, removed at a hard exit if nothing is in them
_moving = threading.Lock()  # held while outputs are moved to their paths


def itself(path: Path) -> tuple[Path, ...]:
    """The files that belong to a path where nothing does but its own."""
    return (path,)


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
        try:
            recover(path.parent)
            files = own_files[name](path)
            text = _wrong_format(path, suffixes[name]) or _wrong_place(files, overwrite=overwrite)
            text = text or _clash(name, files, targets, reads)
        except (OSError, ValueError) as err:
            text = f"{path} cannot be a file: {getattr(err, 'strerror', err)}"
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
    if name.endswith(suffixes) and name not in suffixes:
        return None
    text = f"cannot write {path.suffix or 'a file without ending'}; use {', '.join(suffixes)}"
    if path.suffix and set(suffixes) == GEOTIFF:
        made = f"{path.stem}.tif {path.name}"
        return f"{text}, of which a GIS makes other formats: gdal_translate {made}"
    return text


def _wrong_place(files: tuple[Path, ...], *, overwrite: bool) -> str | None:
    if text := folder_problem(files[0].parent):
        return text
    there = [own for own in files if own.exists()]
    if folders := [own for own in there if own.is_dir()]:
        return f"{folders[0]} is a folder"
    if there and not overwrite:
        return f"{there[0]} exists; allow it with overwrite=True"
    return None


def folder_problem(folder: Path) -> str | None:
    """Why nothing can be written in a folder; None if something can, which is tried.

    Permissions alone do not tell: a drive may be there for reading only, or its server refuse.
    """
    try:
        there = next(path for path in (folder, *folder.parents) if path.exists())
        if not there.is_dir():
            return f"{there} is a file, not a folder"
        if there != folder:
            return f"there is no folder {folder}"
        trial = Path(tempfile.mkdtemp(prefix=moves.PREFIX, dir=folder))
        with suppress(FileNotFoundError):  # another run has taken it for left behind
            trial.rmdir()
    except PermissionError:
        return f"no permission to write in folder {folder}"
    except OSError as err:
        return f"nothing can be written in folder {folder}: {err.strerror}"
    return None


def _same(one: Path, other: Path) -> bool:
    if one.exists() and other.exists():
        return one.samefile(other)
    return one.resolve() == other.resolve()


@contextmanager
def staged(targets: Mapping[Path, OwnFiles], *, overwrite: bool) -> Iterator[dict[Path, Path]]:
    """Give a path to write to for each target; at the end put all in their places, or none.

    The files are written in a hidden folder beside the target, flushed to the disk, and then
    renamed, see `toolbox.moves`. A new file has the permissions of the one that it replaces.

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
        for parent in dict.fromkeys(target.parent for target in targets):
            recover(parent)
            folders[parent] = _new_folder(parent)
            for inside in (moves.NEW, moves.OLD):
                (folders[parent] / inside).mkdir()
        yield {target: folders[target.parent] / moves.NEW / target.name for target in targets}
        own = [part for target, own_files in targets.items() for part in own_files(target)]
        with _alone_in(folders):
            prepared = moves.prepared(folders, own, overwrite=overwrite)
            with _moving:
                moves.make(prepared, folders, overwrite=overwrite)
    finally:
        for folder in folders.values():
            _discard(folder)


@contextmanager
def _alone_in(folders: Iterable[Path]) -> Iterator[None]:
    """Wait until no other run moves files in these folders, or two outputs of one name would mix.

    The folders themselves are locked, in an order that is the same for all runs. Where that cannot
    be done, as on Windows and on some network drives, nobody waits.
    """
    with ExitStack() as stack:
        if fcntl is not None:
            for folder in sorted({folder.resolve() for folder in folders}):
                descriptor = os.open(folder, os.O_RDONLY)
                stack.callback(os.close, descriptor)
                with suppress(OSError):
                    fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield


@contextmanager
def scratch() -> Iterator[Path]:
    """Make a folder for temporary files, and remove it afterwards, also at a hard exit."""
    parent = Path(tempfile.gettempdir())
    recover(parent)
    folder = _new_folder(parent)
    try:
        yield folder
    finally:
        _discard(folder)


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make a folder for outputs; after an error or a hard exit it goes if nothing is in it."""
    folder.mkdir()
    _made.add(folder)
    try:
        yield
    except BaseException:
        with suppress(OSError):  # it holds what --resume needs
            folder.rmdir()
        raise
    finally:
        _made.discard(folder)


def recover(parent: Path) -> None:
    """Undo the moves that killed runs have left half made in a folder, and remove what they hid.

    A run that is alive holds a lock, on whichever computer and in whichever container it is. What
    belongs to another user is left to that user.
    """
    from filelock import Timeout

    for folder in parent.glob(f"{moves.PREFIX}*"):
        try:
            if folder.is_symlink() or not _is_mine(folder):
                continue
            with _lock_of(folder):
                moves.undo(folder)
                shutil.rmtree(folder, ignore_errors=True)
        except Timeout:
            continue
        except (OSError, ValueError) as err:
            if folder.exists():  # or its run has ended meanwhile, and removed it
                log.warning("%s, which a killed run has left, stays: %s", folder, err)


def _new_folder(parent: Path) -> Path:
    """Make a hidden folder that is locked as long as this process lives."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=moves.PREFIX, dir=parent))
        lock = _lock_of(folder)
        try:
            lock.acquire(blocking=True)
        except OSError:
            if not folder.is_dir():
                continue  # another run has taken it for left behind, and removed it
            # else a file system without locks, where nobody takes it for left behind
        break
    folder.chmod(0o700)
    _unfinished[folder] = lock
    return folder


def _lock_of(folder: Path) -> FileLock:
    from filelock import FileLock

    return FileLock(folder / LOCK, blocking=False, thread_local=False)


def _is_mine(folder: Path) -> bool:
    return not hasattr(os, "getuid") or folder.lstat().st_uid == os.getuid()


def is_private(folder: Path) -> bool:
    """Whether a folder belongs to this user, and nobody else may write in it."""
    if not hasattr(os, "getuid"):
        return True
    link, there = folder.lstat(), folder.stat()
    return link.st_uid == there.st_uid == os.getuid() and not there.st_mode & OTHERS_WRITE


def is_full(folder: Path) -> bool:
    """Whether the disk of a folder is full, or nearly so; not if the folder is gone."""
    try:
        return shutil.disk_usage(folder).free < FULL
    except OSError:
        return False


def discard_unfinished() -> None:
    """Remove the temporary folders of this process, before a hard exit."""
    with _moving:
        for folder in list(_unfinished):
            _discard(folder)
        for folder in list(_made):
            with suppress(OSError):  # outputs are in it
                folder.rmdir()


def _discard(folder: Path) -> None:
    if lock := _unfinished.pop(folder, None):
        lock.release()  # before it is removed, as Windows needs it
    if not moves.unsettled(folder):
        shutil.rmtree(folder, ignore_errors=True)
