"""Points in PTX files of terrestrial scanners (Leica); read only.

A file holds scans one after the other. Each begins with ten lines: columns, rows, place of the
scanner, its three axes, and the four lines of a matrix: a point as a row vector, times this matrix,
is in the common system. A line per point follows: x, y, z, intensity from 0 to 1, and often red,
green, blue. A pulse without a return is 0 0 0.

References
----------
Leica Geosystems: PTX, the format of Cyclone for scans with columns and rows.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from toolbox.context import QUIET, Context, log
from toolbox.data.reading import Reading, errors_named, opened, unpacked
from toolbox.errors import DataError

SUFFIX = ".ptx"
_FULL = 65535  # 16 bit, as LAS has intensities
_COLOUR = 257  # by which 255 becomes that
_HEAD = 10  # lines
_SHORTEST = 6  # bytes of the line of a point, "0 0 0" and its end
_BLOCK = 1_000_000  # points that are read at a time
_RIGID = 1e-3  # by which axes may miss being of length one and at right angles
_NAMES = {4: ("intensity",), 7: ("intensity", "red", "green", "blue")}

Floats = NDArray[np.float64]


def read_ptx(
    path: Path, reading: Reading | None = None, ctx: Context = QUIET
) -> tuple[Floats, dict[str, NDArray[Any]]]:
    """Read all scans of a file, each brought to the common system by its matrix.

    Pulses without a return are left out. `point_source_id` tells the scans apart: 1, 2, ...

    Returns
    -------
    xyz : of shape (n, 3)
    attributes : point_source_id, intensity, and red, green, blue if all scans have them; 16 bit

    Raises
    ------
    DataError
        Names the scan that is damaged or cut off.
    """
    scans: list[tuple[Floats, NDArray[np.uint16]]] = []
    size = path.stat().st_size
    with (
        errors_named(f"{path} cannot be read as a PTX file"),
        opened(path, reading, ctx) as file,
        io.TextIOWrapper(unpacked(file, path, lines=True), encoding="utf-8-sig") as lines,
    ):
        while first := _line(lines):
            scans.append(_scan(lines, first, len(scans) + 1, size, ctx))
    if not scans:
        raise DataError(f"{path} has no scans")
    widths = {columns.shape[1] for _, columns in scans}
    if len(widths) > 1:
        log.warning("%s: not all scans have colours; left out", path.name)
    names = _NAMES[min(widths) + 3]
    columns = np.concatenate([found[:, : len(names)] for _, found in scans])
    numbers = np.repeat(np.arange(1, len(scans) + 1), [len(xyz) for xyz, _ in scans])
    attributes: dict[str, NDArray[Any]] = {"point_source_id": numbers.astype(np.uint16)}
    attributes |= {name: columns[:, index] for index, name in enumerate(names)}
    return np.concatenate([xyz for xyz, _ in scans]), attributes


def _line(lines: io.TextIOWrapper) -> str:
    """The next line that is not empty; "" at the end."""
    while line := lines.readline():
        if line.strip():
            return line
    return ""


def _scan(
    lines: io.TextIOWrapper, first: str, number: int, size: int, ctx: Context
) -> tuple[Floats, NDArray[np.uint16]]:
    """Coordinates of a scan in the common system, and its other columns."""
    head = [first.split(), *(_line(lines).split() for _ in range(_HEAD - 1))]
    if [len(words) for words in head] != [1, 1, 3, 3, 3, 3, 4, 4, 4, 4]:
        raise ValueError(f"scan {number} does not begin with the ten lines of a scan")
    count = int(head[0][0]) * int(head[1][0])
    if not 0 <= count <= max(size, 2**26) // _SHORTEST * 100:
        raise ValueError(f"scan {number} promises {count} points in {size} bytes")
    matrix = np.array(head[6:], float)
    axes = matrix[:3, :3]
    if not np.allclose(axes @ axes.T, np.eye(3), atol=_RIGID):
        raise ValueError(f"the matrix of scan {number} is no turn and shift: {matrix.tolist()}")
    found: list[Floats] = []
    done = 0
    while done < count:
        ctx.progress(0.9 * done / count if number == 1 else 0.9)
        block = _block(lines, min(_BLOCK, count - done), number)
        done += len(block)
        found.append(block[(block[:, :3] != 0).any(axis=1)])
    rows = np.concatenate(found) if found else np.empty((0, 4))
    if len(rows) < count:
        log.info("scan %d: %d of %d pulses have no return", number, count - len(rows), count)
    scaled = rows[:, 3:] * ([_FULL] + [_COLOUR] * (rows.shape[1] - 4))
    if len(scaled) and not (scaled.min() >= 0 and scaled.max() <= _FULL):
        raise ValueError(f"scan {number} has intensities beyond 0 to 1, or colours beyond 255")
    return rows[:, :3] @ axes + matrix[3, :3], np.rint(scaled).astype(np.uint16)


def _block(lines: io.TextIOWrapper, count: int, number: int) -> Floats:
    """The next points; fewer are an error."""
    text = io.StringIO("".join(lines.readline() for _ in range(count)))
    try:
        rows = pd.read_csv(text, sep=r"\s+", header=None, dtype=np.float64).to_numpy()
    except (ValueError, pd.errors.ParserError) as error:
        raise ValueError(f"scan {number}: {error}") from error
    if len(rows) < count:
        raise ValueError(f"scan {number} is cut off")
    if rows.shape[1] not in _NAMES or not np.isfinite(rows).all():
        raise ValueError(f"scan {number} has lines of other than 4 or 7 numbers")
    return rows
