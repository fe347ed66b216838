"""Table files: CSV, JSON, Parquet and GeoPackage, read into data frames and written from them."""

from __future__ import annotations

import csv
import json
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from toolbox.context import log
from toolbox.data import geopackage
from toolbox.data.extras import PARQUET
from toolbox.data.layer import refuse_zero_bytes
from toolbox.data.table import Table

_BEGINS = tuple("=+-@\t\r")  # of what a spreadsheet takes for a formula


def read(path: Path, layer: str | None) -> pd.DataFrame:
    """Read the rows of a file; ValueError if it does not hold a table."""
    if path.suffix.lower() == geopackage.SUFFIX:
        return _read_geopackage(path, layer)
    readers = {".csv": read_csv, ".json": _read_json, ".parquet": _read_parquet}
    return readers[path.suffix.lower()](path)


def write(table: Table, path: Path, layer: str, *, add: bool) -> None:
    """Write a table to a file; ValueError if its format cannot hold a value."""
    if path.suffix.lower() == geopackage.SUFFIX:
        _write_geopackage(table.frame, path, layer, add=add)
        return
    writers = {".csv": _write_csv, ".json": _write_json, ".parquet": _write_parquet}
    writers[path.suffix.lower()](table, path)


def read_csv(
    path: Path,
    separator: str = ",",
    *,
    decimal: str = ".",
    names: Sequence[str] | None = None,
    header: bool = True,
) -> pd.DataFrame:
    """Read the rows of a CSV file; ValueError if it does not hold a table.

    Parameters
    ----------
    decimal : the mark before the decimals of numbers
    names : of all columns, in place of those in the file
    header : whether the first line names the columns
    """
    how = {
        "sep": separator,
        "decimal": decimal,
        "dtype_backend": "numpy_nullable",
        "keep_default_na": False,
        "na_values": [""],
        "names": names,
        "header": 0 if header else None,
    }
    frame: pd.DataFrame = pd.read_csv(path, **how)  # type: ignore[call-overload]
    if not isinstance(frame.index, pd.RangeIndex):  # pandas takes the first cells for an index
        raise ValueError("its rows have more cells than its header")
    return _mapped(frame, _without_apostrophe)


def _read_json(path: Path) -> pd.DataFrame:
    rows = json.loads(path.read_text(encoding="utf-8"))
    if not (isinstance(rows, list) and all(isinstance(row, dict) for row in rows)):
        raise ValueError("a list of records is needed: [{...}, {...}]")
    return Table.from_rows(rows).frame


def _read_parquet(path: Path) -> pd.DataFrame:
    PARQUET.need()
    return pd.read_parquet(path, dtype_backend="numpy_nullable")


def _write_csv(table: Table, path: Path) -> None:
    texts = [text for name, column in table.frame.items() for text in _texts(str(name), column)]
    if formulas := [text for text in texts if _is_formula(text)]:
        log.warning(
            "%s: an apostrophe stands before texts that spreadsheets would take for formulas: %r%s",
            path.name,
            formulas[0][:60],
            f" and {len(formulas) - 1} more" if len(formulas) > 1 else "",
        )
    # Of the ends of lines within a cell pandas puts only that of the file into quotation marks.
    quoting: Literal[0, 2] = (
        csv.QUOTE_NONNUMERIC if any("\r" in text for text in texts) else csv.QUOTE_MINIMAL
    )
    frame = _mapped(table.frame, _with_apostrophe)
    frame.to_csv(path, index=False, lineterminator="\n", quoting=quoting)


def _is_formula(text: str) -> bool:
    """Whether a spreadsheet would take a text, without apostrophes before it, for a formula.

    It might send data away or start a program. Numbers are none.
    """
    bare = text.lstrip("'")
    try:
        float(text)
    except ValueError:
        return bare.startswith(_BEGINS) and len(bare) > 1
    return False


def _with_apostrophe(text: str) -> str:
    return f"'{text}" if _is_formula(text) else text


def _without_apostrophe(text: str) -> str:
    return text[1:] if text.startswith("'") and _is_formula(text[1:]) else text


def _texts(name: str, column: pd.Series[Any]) -> Iterator[str]:
    """The name of a column, and the texts in it."""
    yield name
    if column.dtype.kind == "O":
        yield from (value for value in column if isinstance(value, str))


def _mapped(frame: pd.DataFrame, change: Callable[[str], str]) -> pd.DataFrame:
    """The frame with all texts, also the names of columns, changed."""
    changed = frame.rename(columns=lambda name: change(str(name)))
    for place, (_, column) in enumerate(frame.items()):
        if any(change(text) != text for text in _texts("", column)):
            made = column.map(lambda value: change(value) if isinstance(value, str) else value)
            changed.isetitem(place, made.astype(column.dtype).array)
    return changed


def _write_json(table: Table, path: Path) -> None:
    """Write one JSON object per line; the writer of pandas would cut floats to 15 digits."""
    lines = [json.dumps(row, ensure_ascii=False, allow_nan=False) for row in table.rows()]
    path.write_text("[\n" + ",\n".join(lines) + "\n]\n", encoding="utf-8")


def _write_parquet(table: Table, path: Path) -> None:
    PARQUET.need()
    frame = table.frame
    texts = {name: column.map(_text) for name, column in frame.items() if column.dtype == object}
    frame.assign(**{str(n): c for n, c in texts.items()}).to_parquet(path, index=False)


def _write_geopackage(frame: pd.DataFrame, path: Path, layer: str, *, add: bool) -> None:
    import pyogrio

    refuse_zero_bytes(frame, path)
    for old in () if add else geopackage.own_files(path):
        old.unlink(missing_ok=True)
    with geopackage.same_date(), _library_errors():
        pyogrio.write_dataframe(frame, path, layer=layer, driver="GPKG", **geopackage.OPTIONS)


def _read_geopackage(path: Path, layer: str | None) -> pd.DataFrame:
    """Read a table of a GeoPackage without GDAL, which makes floats of integers with gaps."""
    names = geopackage.tables(path)
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
        if (layer not in names) if layer else len(names) != 1:
            raise ValueError(f"its tables are {', '.join(names) or 'none'}; name one as layer")
        table = '"' + (layer or names[0]).replace('"', '""') + '"'
        columns = database.execute(f"PRAGMA table_info({table})").fetchall()
        yes_no = [name for _, name, kind, *_ in columns if kind == "BOOLEAN"]
        frame = pd.read_sql_query(
            f"SELECT * FROM {table}", database, dtype_backend="numpy_nullable"
        )
    key = [name for _, name, *_, is_key in columns if is_key]
    return frame.drop(columns=key).astype(dict.fromkeys(yes_no, "boolean"))


@contextmanager
def _library_errors() -> Iterator[None]:
    """Turn what pyogrio raises into a ValueError."""
    from pyogrio import errors

    try:
        yield
    except (errors.DataSourceError, errors.DataLayerError, errors.FieldError) as error:
        raise ValueError(str(error)) from error


def _text(value: Any) -> str | None:
    """The text of a cell in a column of mixed types, which Parquet does not have."""
    return None if pd.isna(value) else str(value)
