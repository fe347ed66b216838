"""Tables: rows of numbers, texts and yes/no values without a place."""

from __future__ import annotations

import datetime as dt
import json
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from toolbox.context import QUIET, Context
from toolbox.data import geopackage
from toolbox.data.record import own_side_car, side_car, write_beside, write_into_geopackage
from toolbox.errors import DataError


class Table:
    """Rows and named columns.

    Parameters
    ----------
    frame : the rows; the table keeps its own copy
    name : of the file, for messages
    """

    SUFFIXES: ClassVar[tuple[str, ...]] = (".csv", ".json", ".parquet", ".gpkg")
    crs: ClassVar[None] = None
    metre: ClassVar[float] = 1.0

    def __init__(self, frame: pd.DataFrame, *, name: str = "") -> None:
        self._frame, self.name = frame.reset_index(drop=True), name

    @classmethod
    def parts(cls, path: str | Path) -> tuple[Path, ...]:
        """The file itself, and all that would be written with it."""
        path = Path(path)
        if path.suffix.lower() == geopackage.SUFFIX:
            return geopackage.parts(path)
        return path, *own_side_car(path)

    @property
    def frame(self) -> pd.DataFrame:
        """The rows, as a copy that may be changed (made when it is)."""
        return self._frame.copy(deep=False)

    def __len__(self) -> int:
        return len(self._frame)

    @classmethod
    def from_rows(cls, rows: Iterable[Mapping[str, Any]], *, name: str = "") -> Table:
        """A table from one mapping per row; None or an absent key is a missing value.

        Whole numbers stay whole numbers where values are missing.
        """
        rows = list(rows)
        columns = list(dict.fromkeys(column for row in rows for column in row))
        frame = pd.DataFrame({c: pd.array([row.get(c) for row in rows]) for c in columns})
        return cls(_plain(frame), name=name)

    @staticmethod
    def layers(path: str | Path) -> tuple[str, ...]:
        """Names of the tables without geometry in a GeoPackage; of none in other files.

        Raises
        ------
        DataError
            The file cannot be read.
        """
        path = Path(path)
        if path.suffix.lower() != geopackage.SUFFIX:
            return ()
        try:
            return tuple(_tables(path))
        except ValueError as error:
            raise DataError(f"{path} cannot be read as a GeoPackage: {error}") from error

    @classmethod
    def open(cls, path: str | Path, *, layer: str | None = None, ctx: Context = QUIET) -> Table:
        """Read .csv (comma, UTF-8, a header line), .json (a list of records), .parquet or .gpkg.

        An empty cell of a CSV file is a missing value; no other text is.

        Parameters
        ----------
        layer : name of the table in a GeoPackage; may be left out where there is one
        ctx : where to report progress

        Raises
        ------
        DataError
            The file is missing, has another suffix, or does not hold a table.
        """
        path = Path(path)
        readers: dict[str, Callable[[Path], pd.DataFrame]] = {
            ".csv": _read_csv,
            ".json": _read_json,
            ".parquet": _read_parquet,
            ".gpkg": lambda path: _read_geopackage(path, layer),
        }
        if path.suffix.lower() not in readers:
            raise DataError(f"{path}: tables are read from {', '.join(cls.SUFFIXES)}")
        if not path.exists():
            raise DataError(f"{path}: no such file")
        try:
            table = cls(_plain(readers[path.suffix.lower()](path)), name=path.name)
        except (ValueError, OSError) as error:
            raise DataError(f"{path} cannot be read as a table: {error}") from error
        ctx.progress(1.0)
        return table

    def save(
        self,
        path: str | Path,
        *,
        layer: str | None = None,
        add: bool = False,
        record: str = "",
        ctx: Context = QUIET,
    ) -> None:
        """Write .csv, .json, .parquet or .gpkg; numbers read back exactly.

        Parameters
        ----------
        path : ends in one of SUFFIXES
        layer : name of the table in a GeoPackage; the stem of the file name unless given
        add : keep the other layers of a GeoPackage
        record : how the file was made, as JSON text (see `toolbox.provenance`)
        ctx : where to report progress

        Raises
        ------
        DataError
            The suffix is another, the format cannot hold a value (JSON has no infinity), or the
            file cannot be written.
        """
        path = Path(path)
        writers: dict[str, Callable[[pd.DataFrame, Path], None]] = {
            ".csv": _write_csv,
            ".json": _write_json,
            ".parquet": _write_parquet,
            ".gpkg": lambda frame, path: _write_geopackage(frame, path, layer, add=add),
        }
        if path.suffix.lower() not in writers:
            raise DataError(f"{path}: tables are written as {', '.join(self.SUFFIXES)}")
        try:
            writers[path.suffix.lower()](self._frame, path)
            if side_car(path):
                write_beside(path, record)
            elif record:
                write_into_geopackage(path, record, geopackage.WRITTEN)
        except (ValueError, TypeError, OSError) as error:
            raise DataError(f"{path} cannot be written: {error}") from error
        ctx.progress(1.0)

    def records(self) -> list[dict[str, Any]]:
        """The rows as values that JSON knows, None where a value is missing.

        Dates and times are ISO 8601 texts. Infinity stays what it is, which JSON does not know.
        """
        frame = self._frame.astype(object)
        rows = frame.where(frame.notna(), None).to_dict("records")
        return [{str(name): _json_ready(value) for name, value in row.items()} for row in rows]

    def text(self) -> str:
        """The table as aligned plain text: numbers to the right, "-" if missing."""
        columns = [_aligned(str(name), column) for name, column in self._frame.items()]
        return "\n".join("  ".join(cells).rstrip() for cells in zip(*columns, strict=True))


def need_pyarrow() -> None:
    """Make sure that Parquet can be read and written.

    Raises
    ------
    DataError
        The optional package pyarrow is not installed; says how to get it.
    """
    if find_spec("pyarrow") is None:
        raise DataError("Parquet needs pyarrow: pip install lidar-toolbox[parquet]")


def _plain(frame: pd.DataFrame) -> pd.DataFrame:
    """Columns as numpy types, but for whole numbers and yes/no with missing values."""
    return pd.DataFrame({name: _plain_column(column) for name, column in frame.items()})


def _plain_column(column: pd.Series[Any]) -> pd.Series[Any]:
    if pd.api.types.is_float_dtype(column):
        return column.astype("float64")
    if column.hasnans or not isinstance(column.dtype, (pd.Int64Dtype, pd.BooleanDtype)):
        return column
    return column.astype("int64" if isinstance(column.dtype, pd.Int64Dtype) else "bool")


def _read_csv(path: Path) -> pd.DataFrame:
    how = {"dtype_backend": "numpy_nullable", "keep_default_na": False, "na_values": [""]}
    frame: pd.DataFrame = pd.read_csv(path, **how)  # type: ignore[call-overload]
    if not isinstance(frame.index, pd.RangeIndex):  # pandas takes the first cells for an index
        raise ValueError("its rows have more cells than its header")
    return frame


def _read_json(path: Path) -> pd.DataFrame:
    rows = json.loads(path.read_text(encoding="utf-8"))
    if not (isinstance(rows, list) and all(isinstance(row, dict) for row in rows)):
        raise ValueError("a list of records is needed: [{...}, {...}]")
    return Table.from_rows(rows).frame


def _read_parquet(path: Path) -> pd.DataFrame:
    need_pyarrow()
    return pd.read_parquet(path, dtype_backend="numpy_nullable")


def _write_csv(frame: pd.DataFrame, path: Path) -> None:
    frame.to_csv(path, index=False, lineterminator="\n")


def _json_ready(value: Any) -> Any:
    if isinstance(value, (dt.date, dt.time, pd.Timedelta)):
        return value.isoformat()
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value


def _write_json(frame: pd.DataFrame, path: Path) -> None:
    """One record per line; pandas' own writer cuts floats to 15 digits."""
    lines = [json.dumps(row, ensure_ascii=False, allow_nan=False) for row in Table(frame).records()]
    path.write_text("[\n" + ",\n".join(lines) + "\n]\n", encoding="utf-8")


def _write_parquet(frame: pd.DataFrame, path: Path) -> None:
    need_pyarrow()
    texts = {name: column.map(_text) for name, column in frame.items() if column.dtype == object}
    frame.assign(**{str(name): column for name, column in texts.items()}).to_parquet(
        path, index=False
    )


def _write_geopackage(frame: pd.DataFrame, path: Path, layer: str | None, *, add: bool) -> None:
    import pyogrio

    for part in () if add else geopackage.parts(path):
        part.unlink(missing_ok=True)
    with geopackage.same_date(), _library_errors():
        pyogrio.write_dataframe(
            frame, path, layer=layer or path.stem, driver="GPKG", **geopackage.OPTIONS
        )


def _tables(path: Path) -> list[str]:
    """Names of the tables without geometry in a GeoPackage."""
    query = "SELECT table_name FROM gpkg_contents WHERE data_type = 'attributes'"
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
        try:
            return [str(name) for (name,) in database.execute(query)]
        except sqlite3.Error as error:
            raise ValueError(str(error)) from error


def _read_geopackage(path: Path, layer: str | None) -> pd.DataFrame:
    """Not through GDAL, which makes floats of whole numbers where one is missing."""
    names = _tables(path)
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
    """A cell of a column of mixed types, which Parquet does not have."""
    return None if pd.isna(value) else str(value)


def _aligned(name: str, column: pd.Series[Any]) -> list[str]:
    """A header and one text per row, all of one width."""
    cells = [name, *("-" if pd.isna(value) else cell_text(value) for value in column)]
    width = max(len(cell) for cell in cells)
    number = pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column)
    return [cell.rjust(width) if number else cell.ljust(width) for cell in cells]


def cell_text(value: object) -> str:
    """Six digits of a small number, millimetres of a coordinate."""
    if not isinstance(value, float):
        return str(value)
    if 1000 <= abs(value) < 1e15:
        return f"{value:.3f}".rstrip("0").rstrip(".")
    return f"{value:.6g}"
