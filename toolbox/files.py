"""Output files: refused when they would do harm, whole or not there at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

_unfinished: set[Path] = set()  # folders of this process that a crash must not leave behind


def problems(
    targets: Mapping[str, Path],
    suffixes: Mapping[str, tuple[str, ...]],
    inputs: Iterable[Path],
    *,
    overwrite: bool,
) -> dict[str, str]:
    """What is wrong with the paths of outputs, by output name.

    Parameters
    ----------
    targets : path of each output
    suffixes : file name endings that each output can be written with
    inputs : files that the run reads
    """
    reads = list(inputs)
    found: dict[str, str] = {}
    for name, path in targets.items():
        text = _wrong_format(path, suffixes[name]) or _wrong_place(path, overwrite=overwrite)
        if not text and any(_same(path, read) for read in reads):
            text = f"{path} is also an input; choose another name"
        twin = next((n for n, p in targets.items() if n != name and _same(p, path)), None)
        if not text and twin:
            text = f"{path} is also the path of {twin}"
        if text:
            found[name] = text
    return found


def _wrong_format(path: Path, suffixes: tuple[str, ...]) -> str | None:
    if path.name.lower().endswith(suffixes):
        return None
    return f"cannot write {path.suffix or 'a file without ending'}; use {', '.join(suffixes)}"


def _wrong_place(path: Path, *, overwrite: bool) -> str | None:
    folder = path.parent
    if not folder.is_dir():
        return f"there is no folder {folder}"
    if not os.access(folder, os.W_OK | os.X_OK):
        return f"no permission to write in folder {folder}"
    if path.is_dir():
        return f"{path} is a folder"
    if path.exists() and not overwrite:
        return f"{path} exists; allow it with --overwrite"
    return None


def _same(one: Path, other: Path) -> bool:
    if one.exists() and other.exists():
        return one.samefile(other)
    return one.resolve() == other.resolve()


@contextmanager
def staged(targets: Iterable[Path]) -> Iterator[dict[Path, Path]]:
    """Give a place beside each target to write to; move all there at the end, or none.

    Each output is written under its own name in a hidden folder beside the target, because some
    formats write several files, and is then renamed, which is atomic within a file system.

    Raises
    ------
    OSError
        A folder cannot be written.
    """
    folders: dict[Path, Path] = {}
    try:
        for target in targets:
            folder = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=target.resolve().parent))
            _unfinished.add(folder)
            folders[target] = folder
        yield {target: folder / target.name for target, folder in folders.items()}
        for target, folder in folders.items():
            for part in sorted(folder.iterdir()):
                part.replace(target.resolve().parent / part.name)
    finally:
        for folder in folders.values():
            _discard(folder)


def discard_unfinished() -> None:
    """Remove what unfinished runs of this process have written, before a hard exit."""
    for folder in list(_unfinished):
        _discard(folder)


def _discard(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    _unfinished.discard(folder)
