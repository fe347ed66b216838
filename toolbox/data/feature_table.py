"""Features as CSV: points with columns x, y and z first, all others with a last column of WKT.

The table has no CRS. Points whose attributes are called x, y or z have WKT, too. Outlines are long,
so a spreadsheet shows attributes first.

References
----------
OGC 06-103r4, Simple feature access, part 1: well-known text (WKT) of a geometry.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from toolbox.context import log
from toolbox.data.axis_names import ambiguity, chosen
from toolbox.data.reading import errors_named
from toolbox.data.table import Table
from toolbox.errors import DataError

if TYPE_CHECKING:
    import geopandas
    import pandas as pd

SUFFIX = ".csv"
_AXES, _WKT = ("x", "y", "z"), "wkt"
_COMMA = r"[-+]?\d+,\d+"  # a number where commas stand before the decimals
_QUOTED = re.compile(r'"[^"]*"')  # texts, within which a mark parts no columns
_EXACT = 25  # decimals that are given where needed; with 18, small coordinates are not exact


def write(
    frame: geopandas.GeoDataFrame,
    path: Path,
    decimals: int | None = None,
    geometry_type: str = "Point",
) -> None:
    """Write features as a table; coordinates read back exactly unless they have `decimals`.

    Parameters
    ----------
    geometry_type : of an empty layer, whose table has the columns of one with such features

    Raises
    ------
    DataError
        An attribute is called as the column of the geometries.
    """
    import pandas as pd

    attributes = pd.DataFrame(frame.drop(columns=frame.geometry.name))
    named = {str(name).lower() for name in attributes}
    kind, *heights = geometry_type.split()
    points = ((frame.geom_type == "Point") & ~frame.is_empty).all()
    points = points and (len(frame) > 0 or kind in ("Point", "Unknown"))
    if points and not named & {*_AXES}:
        axes = _AXES if frame.has_z.any() or (heights and frame.empty) else _AXES[:2]
        xyz = shapely.get_coordinates(frame.geometry, include_z=True)
        xyz = xyz if decimals is None else xyz.round(decimals)
        parts = [pd.DataFrame(xyz[:, : len(axes)], columns=list(axes)), attributes]
    elif _WKT in named:
        raise DataError(f"{path}: the column of geometries is {_WKT}; rename the attribute")
    else:
        texts = shapely.to_wkt(
            frame.geometry.to_numpy(), rounding_precision=_EXACT if decimals is None else decimals
        )
        parts = [attributes, pd.DataFrame({_WKT: texts}, dtype=object)]
    Table(pd.concat(parts, axis=1)).save(path, overwrite=True)


def read(path: Path, names: Sequence[str] | None = None) -> geopandas.GeoDataFrame:
    """Read what :func:`write` has written, or any CSV with such columns.

    Parameters
    ----------
    names : of all columns, in place of the first line if that has no numbers

    Raises
    ------
    DataError
        It is no such table, or a row has no position.
    """
    import geopandas

    frame = _frame(path) if names is None else _named(path, names)
    columns = {str(name).lower(): str(name) for name in frame}
    if _WKT in columns:
        used = [columns[_WKT]]
        geometry: Any = shapely.from_wkt(frame[used[0]].fillna("").to_numpy(object))
    else:
        used = _coordinates(list(map(str, frame)), path, sure=names is not None)
        geometry = shapely.points(_positions(frame[used], path))
    return geopandas.GeoDataFrame(frame.drop(columns=used), geometry=geometry)


def _frame(path: Path) -> pd.DataFrame:
    """The rows of a CSV file, whose header has semicolons or tabs if it has no commas.

    Then commas may stand before the decimals of coordinates, and of all other numbers with them.
    """
    from toolbox.data import table_files  # and pandas, which only tables need

    with path.open(encoding="utf-8-sig", errors="replace") as file:
        marks = _marks(file.readline(), ",;\t")
    if not marks or marks[0] == ",":
        return Table.open(path).frame
    with errors_named(f"{path} cannot be read"):
        return _with_points(path, partial(table_files.read_csv, path, marks[0]))


def _marks(line: str, known: str) -> list[str]:
    """Which of some marks part the columns of a line, in their order."""
    return [mark for mark in known if mark in _QUOTED.sub("", line)]


def _named(path: Path, names: Sequence[str]) -> pd.DataFrame:
    """The rows of a CSV file whose columns have these names; a first line of numbers is a row."""
    from toolbox.data import table_files
    from toolbox.data.text import is_number

    with path.open(encoding="utf-8-sig", errors="replace") as file:
        line = file.readline().rstrip("\r\n")
    mark = [*_marks(line, ";\t,"), ","][0]
    cells = next(csv.reader([line], delimiter=mark), [])
    if len(cells) != len(names):
        raise DataError(f"{path}: {len(cells)} columns, and {len(names)} names for them")
    decimals = "." if mark == "," else ","
    header = not any(is_number(cell) or is_number(cell, decimals) for cell in cells)
    with errors_named(f"{path} cannot be read"):
        read = partial(table_files.read_csv, path, mark, names=names, header=header)
        return read() if mark == "," else _with_points(path, read)


def _with_points(path: Path, read: Callable[..., pd.DataFrame]) -> pd.DataFrame:
    """The rows of a file; read again where commas stand before the decimals of coordinates."""
    frame = read()
    places = frame[list(chosen(list(map(str, frame))).values())]
    if not any(places[name].astype(str).str.fullmatch(_COMMA).any() for name in places):
        return frame
    log.warning("%s: commas are read as decimal points", path.name)
    return read(decimal=",")


def _coordinates(names: list[str], path: Path, *, sure: bool) -> list[str]:
    """The columns of x, y and, if there is one, z; names that the user gave are sure.

    In tables that :func:`write` has made z is only what is called so: a height is an attribute.
    """
    if {*_AXES[:2]} <= {*names}:
        return [axis for axis in _AXES if axis in names]
    if not sure and (unclear := ambiguity(names)):
        named = "name all columns, e.g. columns=name,x,y,z"
        raise DataError(f"{path}: {unclear}; rename them to x (the easting), y and z, or {named}")
    found = chosen(names)
    if not {*_AXES[:2]} <= found.keys():
        from toolbox.data.text import is_number  # and pandas, which only tables need

        listed = ", ".join(names) or "none"
        if any(is_number(name) for name in names):
            raise DataError(
                f"{path}: its first line must name the columns, such as name,x,y,z, or they are "
                f"given, e.g. columns=name,x,y,z; it is {listed}"
            )
        raise DataError(f"{path}: features need columns x and y, or {_WKT}, and it has {listed}")
    return list(found.values())


def _positions(
    frame: pd.DataFrame, path: Path
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    try:
        found: np.ndarray[tuple[int, int], np.dtype[np.float64]] = frame.to_numpy(np.float64)
    except (ValueError, TypeError):
        raise DataError(f"{path}: {_no_number(frame)}") from None
    if bad := np.flatnonzero(~np.isfinite(found[:, :2]).all(axis=1)).tolist():
        raise DataError(f"{path}: row {bad[0] + 1} has no position")
    return found


def _no_number(frame: pd.DataFrame) -> str:
    """The first cell of some columns that is no number, and where it stands."""
    import pandas as pd

    for name in frame:
        wrong = pd.to_numeric(frame[name], errors="coerce").isna() & frame[name].notna()
        if wrong.any():
            number = int(np.flatnonzero(wrong)[0])
            cell = str(frame[name].iloc[number])
            comma = "; decimals must all have a point, or all a comma"
            hint = comma if re.fullmatch(_COMMA, cell) else ""
            return f"row {number + 1}, column {name}: {cell!r} is no number{hint}"
    return "coordinates must be numbers"
