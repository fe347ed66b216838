"""The point cloud files that a path, folder, pattern, VPC or list of these stands for.

References
----------
PDAL (2023). Virtual point cloud (VPC), draft specification: a STAC item collection that names
files of points, as QGIS and PDAL write it.
"""

from __future__ import annotations

import glob
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

from toolbox.context import QUIET, Context
from toolbox.data import ept
from toolbox.data.reading import errors_named
from toolbox.data.remote.address import Address, as_path, is_remote
from toolbox.data.remote.stream import whole
from toolbox.errors import DataError

Paths = str | Path | Sequence[str | Path]
"""One path, folder, pattern or VPC, or several of them."""

LAS = (".las", ".laz")
TEXT = (".xyz", ".txt", ".csv", ".pts", ".asc")
READABLE = (
    *LAS,
    *TEXT,
    *(f"{suffix}.gz" for suffix in TEXT),
    ".ply",
    ".ply.gz",
    ".pcd",
    ".e57",
    ".ptx",
)
VPC = ".vpc"
COPC = ".copc.laz"
_OF_SEVERAL = (".shp", ".tab", ".mif")
_DATA = "data"  # name and role of what holds the points in an item of a VPC


def suffix_of(path: Path) -> str:
    """The suffix of a path in lower case; of "a.xyz.gz" it is ".xyz"."""
    name = path.name.lower()
    return Path(name.removesuffix(".gz")).suffix


def is_copc(path: Path) -> bool:
    """Whether the name of a file is that of a COPC file."""
    return path.name.lower().endswith(COPC)


@dataclass(frozen=True)
class PointFiles:
    """The point cloud files that paths stand for: found once, and handed on to who reads them.

    Attributes
    ----------
    paths : of the files, sorted
    name : that messages give to the points
    remarks : which files are left out
    """

    paths: tuple[Path, ...]
    name: str
    remarks: tuple[str, ...] = ()

    @classmethod
    def of(cls, paths: Paths | PointFiles, bounds: Sequence[float] | None = None) -> PointFiles:
        """Find the files.

        Parameters
        ----------
        paths : a file; a folder, which stands for the files of points directly in it that are not
            hidden: LAS and LAZ if there are any, else those of all other formats; a pattern such
            as ``tiles/*.laz`` or ``survey/**/*.las`` (where ** searches nested folders); a virtual
            point cloud (.vpc) or entwine point tiles (ept.json); or a list of these
        bounds : (xmin, ymin, xmax, ymax) outside which no points are wanted; entwine point tiles
            leave out the files that do not touch it

        Raises
        ------
        DataError
            A path does not exist or holds no files of points, a file of a VPC is missing or
            remote, a file is of another format or empty, or is named twice; tells all that is
            wrong.
        """
        if isinstance(paths, PointFiles):
            return paths
        items = [paths] if isinstance(paths, str | Path) else list(paths)
        if not items:
            raise DataError("no files of points are given")
        found: list[Path] = []
        problems: list[str] = []
        remarks: list[str] = []
        for item in items:
            try:
                found += _files(item, remarks, bounds)
            except DataError as error:
                problems.append(str(error))
        problems += [text for path in found if (text := _problem(path))]
        problems += [] if problems else _twice(found)
        if problems:
            raise DataError("\n    ".join(problems))
        first = as_path(items[0]).resolve().name
        name = f"{first} and {len(items) - 1} more" if len(items) > 1 else first
        return cls(tuple(sorted(found)), name, tuple(remarks))


def missing(paths: Paths) -> list[str]:
    """The paths that do not exist, and the patterns that no file matches, as they were given.

    Raises
    ------
    OSError
        A server does not answer, or refuses.
    """
    items = [paths] if isinstance(paths, str | Path) else paths
    return [str(as_path(item)) for item in items if not _is_there(item)]


def _is_there(item: str | Path) -> bool:
    return as_path(item).exists() or (not is_remote(item) and _matches(str(item)))


def local(path: str | Path, ctx: Context = QUIET) -> Path:
    """The path of a file on this computer; of one on the web, that of a copy.

    Raises
    ------
    DataError
        It cannot be had, or consists of several files.
    """
    found = as_path(path)
    if not isinstance(found, Address):
        return found
    if found.suffix.lower() in _OF_SEVERAL:
        raise DataError(f"{found} is one of several files of a layer; download all of them first")
    try:
        return whole(found, ctx)
    except OSError as error:
        raise DataError(f"{found} cannot be read: {error.strerror or error}") from error


@contextmanager
def named_as_given(path: str | Path) -> Iterator[None]:
    """Name an address in the messages of errors, and not the copy that was read.

    Raises
    ------
    DataError
        As the code within does.
    """
    try:
        yield
    except DataError as error:
        found = as_path(path)
        if not isinstance(found, Address):
            raise
        text = re.sub(rf"\S*{re.escape(found.name)}", lambda _: str(found), str(error), count=1)
        raise DataError(text) from error


def _matches(pattern: str) -> bool:
    return glob.has_magic(pattern) and any(glob.iglob(pattern, recursive=True))


def _files(item: str | Path, remarks: list[str], bounds: Sequence[float] | None) -> list[Path]:
    if not str(item):
        raise DataError("an empty path names no file")
    path = as_path(item)
    try:
        if path.is_dir():
            return _in_folder(path, remarks)
        if path.exists():
            if ept.is_ept(path):
                return ept.files_of(path, bounds)
            return _in_vpc(path) if suffix_of(path) == VPC else [path]
        if not is_remote(item) and glob.has_magic(str(item)):
            return _matching(str(item), remarks)
    except OSError as error:
        raise DataError(f"{item} cannot be read: {error.strerror or error}") from error
    return [path]


def _problem(path: Path) -> str | None:
    """Say why a path is no file of points; None if it is one."""
    try:
        size = path.stat().st_size
    except (FileNotFoundError, ValueError):  # no file has a name with a zero byte
        return f"there is no file {path}"
    except OSError as error:
        return f"{path} cannot be read: {error.strerror or error}"
    if path.is_dir():
        return f"{path} is a folder, not a file of points"
    if not path.name.lower().endswith(READABLE):
        readable = ", ".join(READABLE)
        return f"{path}: points are read from {readable}, not {suffix_of(path)!r}"
    return f"{path} is empty (0 bytes)" if size == 0 else None


def _in_folder(folder: Path, remarks: list[str]) -> list[Path]:
    inside = (path for path in folder.iterdir() if not path.name.startswith("."))
    found = _of_points(inside, str(folder), remarks)
    if not found:
        raise DataError(
            f"{folder} holds no files of points ({', '.join(READABLE)}); folders in it are not "
            f"searched, but the pattern {folder / '**' / '*.laz'} does so"
        )
    return found


def _matching(pattern: str, remarks: list[str]) -> list[Path]:
    found = _of_points(map(Path, glob.iglob(pattern, recursive=True)), pattern, remarks)
    if not found:
        raise DataError(f"there is no file of points that matches {pattern}")
    return found


def _of_points(paths: Iterable[Path], where: str, remarks: list[str]) -> list[Path]:
    """The LAS and LAZ files among paths; if there are none, the files of other point formats.

    A link to a file that is gone counts as one: its points would be missing without a word.
    """
    files = sorted(path for path in paths if path.is_file() or not path.exists())
    readable = [path for path in files if path.name.lower().endswith(READABLE)]
    chosen = [path for path in readable if path.name.lower().endswith(LAS)] or readable
    if left := [path.name for path in readable if path not in chosen]:
        remarks.append(f"{where}: only its LAS and LAZ files are read, not {', '.join(left)}")
    return chosen


def _in_vpc(path: Path) -> list[Path]:
    with errors_named(f"{path} is no virtual point cloud (a STAC item collection)"):
        features = json.loads(path.read_text(encoding="utf-8-sig"))["features"]
        links = [link for feature in features for link in _links(feature)]
    if not links:
        raise DataError(f"{path} names no files of points")
    if isinstance(path, Address):
        if inside := [link for link in links if _scheme(link) == "file"]:
            raise DataError(f"{path} is on the web, and names files of this computer: {inside[0]}")
        return [path.joined(link) for link in links]
    found = [Address(link) if is_remote(link) else _target(path.parent, link) for link in links]
    here = [target for target in found if not isinstance(target, Address)]
    if missing := [str(target) for target in here if not target.exists()]:
        raise DataError(f"{path} names files that are not there: {', '.join(missing)}")
    return found


def _links(feature: Any) -> Iterator[str]:
    """The links to points in a STAC item, which may also name overviews and images."""
    assets = feature["assets"]
    for name, asset in assets.items():
        roles = asset.get("roles", [])
        if _DATA in roles or (not roles and (name == _DATA or len(assets) == 1)):
            yield str(asset["href"])


def _target(folder: Path, link: str) -> Path:
    return folder / (url2pathname(urlsplit(link).path) if _scheme(link) == "file" else link)


def _scheme(link: str) -> str:
    """The scheme of a URL; "" of a path, also with the letter of a drive."""
    scheme = urlsplit(link).scheme
    return scheme if len(scheme) > 1 else ""


def _twice(paths: Sequence[Path]) -> Iterator[str]:
    """Say which files are given more than once, also under another name."""
    seen: dict[tuple[int, int], Path] = {}
    for path in paths:
        status = path.stat()
        first = seen.setdefault((status.st_dev, status.st_ino), path)
        if first is not path:
            same = "" if first == path else f" (as {first})"
            yield f"{path} is given twice{same}"
