"""Points in PCD files (Point Cloud Library); read only."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from toolbox.context import log
from toolbox.data.ply import COLOURS, split
from toolbox.data.reading import Reading, errors_named, opened
from toolbox.errors import DataError

_LINES = 10  # of a header, as pypcd4 reads it
_LONGEST = 2**16  # bytes of one of them
_LZF = 88  # to one: LZF packs at most 264 bytes into 3
_PADDING = "#$%&~~"  # how pypcd4 names the field "_"


def read_pcd(
    path: Path, reading: Reading | None = None
) -> tuple[NDArray[np.float64], dict[str, NDArray[Any]]]:
    """Read coordinates and attributes of a PCD file; "rgb" becomes 16-bit red, green and blue.

    Points whose coordinates are NaN are cells of an organised scan where nothing was measured:
    they are left out, and the log says how many.

    Parameters
    ----------
    reading : where the hash of the file is noted

    Returns
    -------
    xyz : of shape (n, 3)
    attributes : the other fields

    Raises
    ------
    DataError
        The file is damaged, or has no x, y and z.
    """
    from pypcd4.pypcd4 import PointCloud

    with errors_named(f"{path} cannot be read as a PCD file"), opened(path, reading) as stream:
        _check_counts(stream, path.stat().st_size)
        stream.seek(0)
        file = PointCloud.from_fileobj(stream)
    data: NDArray[Any] = np.atleast_1d(file.pc_data)
    if len(data) != file.metadata.points:
        raise DataError(f"{path} promises {file.metadata.points} points, and {len(data)} are there")
    names = data.dtype.names or ()
    fields = {name: data[name] for name in names if not name.startswith(_PADDING)}
    for name in ("rgb", "rgba"):
        if name in fields:
            fields |= _colours(fields.pop(name))
    return split(_measured(fields, path.name), path)


def _check_counts(stream: BinaryIO, size: int) -> None:
    """Raise a ValueError if the header promises more than a file of this size can hold."""
    from pypcd4.pypcd4 import Encoding, MetaData

    lines: list[str] = []
    while len(lines) < _LINES and not (lines and lines[-1].startswith("DATA")):
        raw = stream.readline(_LONGEST)
        if not raw.endswith(b"\n"):
            raise ValueError("its header does not end")
        line = raw.decode().strip()
        lines += [line] if line and not line.startswith("#") else []
    header = MetaData.parse_header(lines)
    text = header.data == Encoding.ASCII
    each = sum(n if text else n * of for n, of in zip(header.count, header.size, strict=True))
    packed = header.data not in (Encoding.ASCII, Encoding.BINARY)
    unpacks = struct.unpack("II", stream.read(8))[1] if packed and header.points else 0
    most = size * _LZF if packed else size
    if max(each * max(header.points, 1), unpacks) > most:
        raise ValueError(
            f"its header promises {header.points} points of {each} "
            f"{'numbers' if text else 'bytes'}, and it has {size} bytes"
        )


def _colours(packed: NDArray[Any]) -> dict[str, NDArray[np.uint8]]:
    """Split 32-bit colours, which may be stored as floats, into 16-bit red, green and blue."""
    bits = np.ascontiguousarray(packed).view(np.uint32)
    shifts = zip(COLOURS, (16, 8, 0), strict=True)
    return {name: (bits >> shift & 0xFF).astype(np.uint8) for name, shift in shifts}


def _measured(fields: dict[str, NDArray[Any]], name: str) -> dict[str, NDArray[Any]]:
    """The points without those whose coordinates are NaN."""
    empty = np.zeros(len(next(iter(fields.values()), ())), bool)
    for axis in "xyz":
        if axis in fields:
            empty |= np.isnan(fields[axis])
    if not empty.any():
        return fields
    log.warning("%s: %s places without a point are left out", name, empty.sum())
    return {field: values[~empty] for field, values in fields.items()}
