"""Points in PLY files (Stanford polygon format)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.context import log
from toolbox.data.crs import crs_text, is_local, local_crs
from toolbox.data.extras import PLY
from toolbox.data.reading import Reading, errors_named, opened, room, unpacked
from toolbox.data.text import Points, standard_names
from toolbox.errors import DataError

COLOURS = ("red", "green", "blue")
_LOCAL = "crs "  # begins the comment that names a local CRS
_TYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
_SIZES = {"char": 1, "short": 2, "int": 4, "float": 4, "double": 8} | {
    f"{kind}{bits}": bits // 8 for kind in ("int", "float") for bits in (8, 16, 32, 64)
}  # bytes of a number; those without a sign have a "u" before
_HEADER = 2**20  # bytes, more than any header has


def read_ply(
    path: Path, reading: Reading | None = None
) -> tuple[NDArray[np.float64], dict[str, NDArray[Any]], CRS | None]:
    """Read coordinates and attributes of the vertices of a .ply or .ply.gz file.

    Faces and other elements are left out, and the log says so.

    Colours of 8 bit become 16 bit, as LAS has them.

    Parameters
    ----------
    reading : where the hash of the file is noted

    Returns
    -------
    xyz : of shape (n, 3)
    attributes : the other properties of the vertices
    crs : local, if a comment of ours says so

    Raises
    ------
    DataError
        plyfile is not installed, or the file is damaged or has no vertices with x, y and z.
    """
    PLY.need()
    import plyfile

    with errors_named(f"{path} cannot be read as a PLY file"), opened(path, reading) as stream:
        _check_counts(unpacked(stream, path), room(path))
        stream.seek(0)
        file = plyfile.PlyData.read(unpacked(stream, path), mmap=False)
    others = [element.name for element in file if element.name != "vertex"]
    if "vertex" not in file:
        raise DataError(f"{path} has no vertices, only {', '.join(others) or 'nothing'}")
    if others:
        log.warning("%s: only its vertices are read, not its %s", path.name, ", ".join(others))
    data = file["vertex"].data
    said = [text.removeprefix(_LOCAL) for text in file.comments if text.startswith(_LOCAL)]
    crs = local_crs(said[0]) if said else None
    return *split({name: data[name] for name in data.dtype.names or ()}, path), crs


def _check_counts(content: BinaryIO, size: int) -> None:
    """Raise a ValueError if the header promises more than a file of this size can hold."""
    header, end, _ = content.read(_HEADER).partition(b"end_header")
    if not end:
        raise ValueError(f"its header does not end within {_HEADER} bytes")
    text = header.decode("ascii", "replace")
    is_text = re.search(r"^format\s+ascii", text, re.MULTILINE) is not None
    for element in re.split(r"^element\s", text, flags=re.MULTILINE)[1:]:
        name, count = [*element.split(maxsplit=2), "", ""][:2]
        kinds = re.findall(r"^property\s+(?:list\s+)?u?(\w+)", element, re.MULTILINE)
        least = sum(2 if is_text else _SIZES.get(kind, 1) for kind in kinds)  # a digit, a blank
        if count.isdecimal() and int(count) * max(least, 1) > size + 1:
            raise ValueError(f"its header promises {count} of {name!r}, and it has {size} bytes")


def split(
    fields: Mapping[str, NDArray[Any]], path: Path
) -> tuple[NDArray[np.float64], dict[str, NDArray[Any]]]:
    """Split named columns into coordinates and attributes with LAS names.

    Raises
    ------
    DataError
        A coordinate is missing or not finite.
    """
    columns = dict(zip(standard_names(list(fields)), fields.values(), strict=True))
    if missing := [name for name in "xyz" if name not in columns]:
        raise DataError(f"{path} has no {', '.join(missing)}, only {', '.join(columns)}")
    xyz = np.column_stack([columns.pop(name).astype(np.float64) for name in "xyz"])
    bad = ~np.isfinite(xyz).all(axis=1)
    if bad.any():
        raise DataError(f"{path}: point {int(np.argmax(bad))} has the coordinates {xyz[bad][0]}")
    lists = [name for name, values in columns.items() if values.dtype.kind == "O"]
    if lists:
        log.warning("%s: lists are not read (%s)", path.name, ", ".join(lists))
    plain = {name: values for name, values in columns.items() if name not in lists}
    return xyz, {name: _colour(name, values) for name, values in plain.items()}


def _colour(name: str, values: NDArray[Any]) -> NDArray[Any]:
    """8-bit colours as 16 bit: 255 becomes 65535."""
    if name in COLOURS and values.dtype == np.uint8:
        return values.astype(np.uint16) * np.uint16(257)
    return values.astype(values.dtype.newbyteorder("="))


def write_ply(path: Path, cloud: Points) -> None:
    """Write points to a binary little-endian PLY file with double coordinates.

    Colours that come from 8 bit are written with 8 bit, as other programs expect them.

    Raises
    ------
    DataError
        plyfile is not installed, or PLY has no type for an attribute, or its name is no word.
    """
    PLY.need()
    import plyfile

    columns = {name: _typed(path, name, cloud[name]) for name in cloud.names}
    if set(COLOURS) <= columns.keys() and all((columns[c] % 257 == 0).all() for c in COLOURS):
        columns |= {colour: (columns[colour] // 257).astype("u1") for colour in COLOURS}
    kinds = [(name, "f8") for name in "xyz"]
    kinds += [(name, values.dtype.str) for name, values in columns.items()]
    vertices = np.empty(len(cloud.xyz), kinds)
    for axis, name in enumerate("xyz"):
        vertices[name] = cloud.xyz[:, axis]
    for name, values in columns.items():
        vertices[name] = values
    element = plyfile.PlyElement.describe(vertices, "vertex")
    local = cloud.crs is not None and is_local(cloud.crs)
    comments = [_LOCAL + crs_text(cloud.crs)] if local else []
    plyfile.PlyData([element], byte_order="<", comments=comments).write(str(path))


def _typed(path: Path, name: str, values: NDArray[Any]) -> NDArray[Any]:
    if not re.fullmatch(r"[!-~]+", name):
        raise DataError(f"{path}: {name!r} cannot be the name of a PLY property; rename it")
    if values.ndim > 1:
        raise DataError(f"{path}: {name!r} has several values per point, which is not written")
    if values.dtype.kind == "b":
        return values.astype("u1")
    if values.dtype.kind in "iu" and values.dtype.itemsize == 8:
        small = values.astype("i4")
        if (small == values).all():
            return small
    if values.dtype.newbyteorder("=") not in [np.dtype(kind) for kind in _TYPES]:
        raise DataError(f"{path}: {name!r} is of type {values.dtype}, which PLY cannot hold")
    return values
