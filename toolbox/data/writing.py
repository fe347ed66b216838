"""Where a layer is saved: links are followed, and files are replaced only where that is allowed."""

from __future__ import annotations

from pathlib import Path

from toolbox.data.reading import errors_named
from toolbox.errors import ParameterError
from toolbox.files import OwnFiles


def followed(path: str | Path) -> Path:
    """The path of the file to write: the one given or, if that is a link, where it leads.

    Raises
    ------
    DataError
        The path is a circular link, or no file can be there.
    """
    path = Path(path)
    with errors_named(f"{path} cannot be written"):
        resolved = path.resolve()
        return resolved if path.is_symlink() else path


def refuse_to_replace(path: Path, own_files: OwnFiles, *, overwrite: bool) -> None:
    """Raise an error if one of the files of a path is there, and may not be replaced.

    Raises
    ------
    ParameterError
        Names the file and the option.
    DataError
        No file can be there.
    """
    if overwrite:
        return
    with errors_named(f"{path} cannot be written"):
        there = next((own for own in own_files(path) if own.exists()), None)
    if there:
        raise ParameterError(f"{there} exists; allow it with overwrite=True")
