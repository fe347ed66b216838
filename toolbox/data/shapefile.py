"""Shapefiles: the files that one consists of, and what becomes of names and values it cannot hold.

The name of a field has at most ten bytes, and may differ from others not only in upper and lower
case. Names that fit stay. Each other attribute gets, in the order of the columns, the first ten
bytes of its name; if these are taken, as many as leave room for `_1`, or else `_2`, and so on. The
side table `<name>.fields.csv` has a line `field,attribute` for each of them, with which the names
are read back.

Numbers have 15 decimals, times become ISO 8601 texts, and an empty text is a missing one. Whole
numbers of more than 18 characters, infinity, and texts of more than 254 bytes are refused.

References
----------
ESRI (1998). ESRI Shapefile Technical Description. White paper.
"""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox.context import log
from toolbox.errors import DataError

if TYPE_CHECKING:
    import geopandas
    import pandas as pd

SUFFIX = ".shp"
FIELDS = ".fields.csv"
_READ = (".shx", ".dbf", ".prj", ".cpg", FIELDS)  # with the file itself
_INDEXES = (".qpj", ".qix", ".sbn", ".sbx", ".idm", ".ind")  # of other programs
_HEADER = ["field", "attribute"]
_LONGEST = 10  # bytes of a name
_LARGEST, _LEAST = 10**18, -(10**17)  # a number of more than 18 characters is read back rounded
_SMALLEST = 1e-8  # of a smaller number, 15 decimals are fewer digits than the 7 of a float32


def own_files(path: Path) -> tuple[Path, ...]:
    """All files that may belong to a Shapefile, the .shp itself first."""
    return path, *(path.with_suffix(ending) for ending in (*_READ, *_INDEXES))


def parts(path: Path) -> list[Path]:
    """The files of a Shapefile that are there and say what is read."""
    return [path, *(p for ending in _READ if (p := path.with_suffix(ending)).is_file())]


def field_names(names: Iterable[str]) -> dict[str, str]:
    """The name of the field for each attribute, by the rule of this module.

    Examples
    --------
    >>> field_names(["height_above_ground", "height_abo", "span"])
    {'height_abo': 'height_abo', 'span': 'span', 'height_above_ground': 'height_a_1'}
    """
    found: dict[str, str] = {}
    taken: set[str] = set()
    for name in sorted(names, key=lambda name: _cut(name, _LONGEST) != name):
        found[name] = next(field for field in _candidates(name) if field.lower() not in taken)
        taken.add(found[name].lower())
    return found


def _candidates(name: str) -> Iterator[str]:
    yield _cut(name, _LONGEST)
    for number in itertools.count(1):
        yield _cut(name, _LONGEST - len(f"_{number}")) + f"_{number}"


def _cut(name: str, size: int) -> str:
    """The first bytes of a name that are whole characters; a field has no blanks at its end."""
    return name.encode()[:size].decode(errors="ignore").rstrip()


def with_fields(frame: geopandas.GeoDataFrame, path: Path) -> geopandas.GeoDataFrame:
    """The features as a Shapefile holds them; the side table is written where it is needed.

    Raises
    ------
    DataError
        A number is too large.
    """
    attributes = frame.columns.drop(frame.geometry.name)
    frame = frame.assign(**{name: _held(frame[name], path) for name in attributes})
    names = field_names(map(str, attributes))
    shortened = [(field, name) for name, field in names.items() if field != name]
    if shortened:
        side_table = path.with_suffix(FIELDS)
        with side_table.open("w", encoding="utf-8", newline="") as stream:
            csv.writer(stream, lineterminator="\n").writerows([_HEADER, *shortened])
        text = "%s: names of more than %d bytes are cut, and stand in %s"
        log.info(text, path.name, _LONGEST, side_table.name)
    return frame.rename(columns=names)


def attribute_names(path: Path) -> dict[str, str]:
    """The name of the attribute for each field of a Shapefile that the side table names.

    Raises
    ------
    DataError
        The side table is damaged.
    """
    side_table = path.with_suffix(FIELDS)
    if not side_table.is_file():
        return {}
    try:
        with side_table.open(encoding="utf-8-sig", newline="") as stream:
            header, *rows = csv.reader(stream, strict=True)
        found = {field: name for field, name in rows}  # noqa: C416  each row must have two cells
    except (ValueError, csv.Error) as error:
        raise DataError(f"{side_table} is no table of fields: {error}") from error
    if header != _HEADER or len({*found.values()}) < len(rows):
        text = f"must have the columns {','.join(_HEADER)}, and each name once"
        raise DataError(f"{side_table} {text}")
    return found


def _held(column: pd.Series[Any], path: Path) -> pd.Series[Any]:
    """An attribute as a Shapefile holds it."""
    kind = getattr(column.dtype, "kind", "O")
    if kind == "M":
        log.warning("%s: a Shapefile has no times; %s is text", path.name, column.name)
        texts = column.astype(object).map(lambda time: time.isoformat(), na_action="ignore")
        return texts.where(column.notna(), None)
    if kind not in "iuf":
        return column
    if kind in "iu" and ((column >= _LARGEST) | (column <= _LEAST)).any():
        _refuse(column, path, "whole numbers of more than 18 characters")
    size = np.abs(column.dropna().to_numpy(np.float64))
    if np.isinf(size).any():
        _refuse(column, path, "infinity")
    if ((size > 0) & (size < _SMALLEST)).any():
        text = "%s: %s has numbers below %g, of which a Shapefile keeps 15 decimals"
        log.warning(text, path.name, column.name, _SMALLEST)
    return column


def _refuse(column: pd.Series[Any], path: Path, what: str) -> None:
    text = f"a Shapefile cannot hold {what}, as {column.name} has; write a GeoPackage (.gpkg)"
    raise DataError(f"{path}: {text}")
