"""Tables: rows of numbers, texts and yes/no values without a geometry."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from toolbox.context import QUIET, Context
from toolbox.data import differences, geopackage, rounding
from toolbox.data.extras import PARQUET, Extra
from toolbox.data.layer import Inside, Layer, text_array
from toolbox.data.measures import unit_column
from toolbox.data.paths import local, named_as_given
from toolbox.data.reading import errors_named
from toolbox.data.record import own_side_car, side_car, write_beside, write_into_geopackage
from toolbox.data.remote.address import as_path
from toolbox.data.writing import followed
from toolbox.errors import DataError

if TYPE_CHECKING:  # of which most tools have no need; it takes long to import
    import pandas as pd

    from toolbox.data.report import Column, Section


_NULLABLE = {"Int64": np.dtype("int64"), "boolean": np.dtype("bool")}  # as pandas names them


class Table(Layer):
    """Rows of named columns without geometry.

    Parameters
    ----------
    frame : the rows; the table keeps its own copy
    name : of the file, for messages

    Examples
    --------
    >>> table = Table.from_rows([{"class": 2, "points": 40}, {"class": 6, "points": 2}])
    >>> len(table), table.rows()[1]
    (2, {'class': 6, 'points': 2})
    >>> table
    <Table in memory: 2 rows, 2 columns>
    """

    SUFFIXES: ClassVar[tuple[str, ...]] = (".csv", ".json", ".parquet", ".gpkg")
    numbers_in: ClassVar[str] = "take .frame, a DataFrame of pandas"
    NEEDS: ClassVar[Mapping[str, Extra]] = MappingProxyType({".parquet": PARQUET})
    crs: ClassVar[None] = None
    metre: ClassVar[float] = 1.0
    name: str

    def __init__(self, frame: pd.DataFrame, *, name: str = "") -> None:
        self._frame, self.name = frame.reset_index(drop=True), name

    @classmethod
    def own_files(cls, path: str | Path) -> tuple[Path, ...]:
        """The file at a path, and what belongs to it: journals of SQLite, or a record beside it."""
        path = Path(path)
        if path.suffix.lower() == geopackage.SUFFIX:
            return geopackage.own_files(path)
        return path, *own_side_car(path)

    @property
    def frame(self) -> pd.DataFrame:
        """The rows, as a copy that may be changed (made when it is)."""
        return self._frame.copy(deep=False)

    def __len__(self) -> int:
        return len(self._frame)

    def __repr__(self) -> str:
        size = f"{len(self)} rows, {len(self.names)} columns"
        return f"<Table {self.name or 'in memory'}: {size}>"

    @classmethod
    def from_rows(cls, rows: Iterable[Mapping[str, Any]], *, name: str = "") -> Table:
        """A table from one mapping per row; None or an absent key is a missing value.

        Whole numbers stay whole numbers where values are missing.
        """
        import pandas as pd

        rows = list(rows)
        columns = list(dict.fromkeys(column for row in rows for column in row))
        frame = pd.DataFrame({c: pd.array([row.get(c) for row in rows]) for c in columns})
        return cls(plain(frame), name=name)

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
        with errors_named(f"{path} cannot be read as a GeoPackage"):
            return tuple(geopackage.tables(path))

    @classmethod
    def open(cls, path: str | Path, *, layer: str | None = None, ctx: Context = QUIET) -> Table:
        """Read .csv (comma, UTF-8, a header line), .json (a list of records), .parquet or .gpkg.

        An empty cell of a CSV file is a missing value; no other text is. An apostrophe before what
        a spreadsheet would take for a formula is taken off.

        Parameters
        ----------
        layer : name of the table in a GeoPackage; may be left out where there is one
        ctx : where to report progress

        Raises
        ------
        DataError
            The file is missing, has another suffix, or does not hold a table.
        """
        from toolbox.data import table_files

        path = as_path(path)
        if path.suffix.lower() not in cls.SUFFIXES:
            raise DataError(f"{path}: tables are read from {', '.join(cls.SUFFIXES)}")
        here = local(path, ctx)
        if not here.exists():
            raise DataError(f"{path}: no such file")
        with named_as_given(path), errors_named(f"{here} cannot be read as a table"):
            table = cls(plain(table_files.read(here, layer)), name=path.name)
        ctx.progress(1.0)
        return table

    def save(
        self,
        path: str | Path,
        *,
        layer: str | None = None,
        add: bool = False,
        rounded: bool | None = None,
        overwrite: bool = False,
        record: str = "",
        ctx: Context = QUIET,
    ) -> None:
        """Write .csv, .json, .parquet or .gpkg; numbers read back exactly unless they are rounded.

        A table of measures, which is for people, is rounded in .csv unless it is said not to be.

        In .csv an apostrophe is put before texts that a spreadsheet would take for a formula.

        Parameters
        ----------
        path : ends in one of SUFFIXES
        layer : name of the table in a GeoPackage; the stem of the file name unless given
        add : keep the other layers of a GeoPackage
        rounded : write numbers with the digits that a survey knows, see `toolbox.data.rounding`
        overwrite : whether files at the path, or with `add` a layer of this name, may be replaced
        record : how the file was made, as JSON text (see `toolbox.runs.provenance`)
        ctx : where to report progress

        Raises
        ------
        ParameterError
            A file is there that may not be replaced.
        DataError
            The suffix is another, the format cannot hold a value (JSON has no infinity), or the
            file cannot be written.
        """
        from toolbox.data import table_files

        path = followed(path)
        if path.suffix.lower() not in self.SUFFIXES:
            raise DataError(f"{path}: tables are written as {', '.join(self.SUFFIXES)}")
        name = geopackage.name_to_write(path, layer, self.own_files, add=add, overwrite=overwrite)
        if rounded is None:
            rounded = path.suffix.lower() == ".csv" and unit_column(self.frame) is not None
        table = Table(rounding.rounded(self.frame)) if rounded else self
        try:
            table_files.write(table, path, name, add=add)
            if side_car(path):
                write_beside(path, record)
            elif record:
                write_into_geopackage(path, record, geopackage.WRITTEN)
        except (ValueError, TypeError, OSError) as error:
            raise DataError(f"{path} cannot be written: {error}") from error
        ctx.progress(1.0)

    def rows(self) -> list[dict[str, Any]]:
        """The rows as values that JSON knows, None where a value is missing.

        Dates and times are ISO 8601 texts. Infinity stays what it is, which JSON does not know.
        """
        frame = self._frame.astype(object)
        rows = frame.where(frame.notna(), None).to_dict("records")
        return [{str(name): _json_ready(value) for name, value in row.items()} for row in rows]

    # What every layer answers, see toolbox.data.layer ---------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(map(str, self._frame.columns))

    def size(self, inside: Inside | None = None) -> int | None:
        """Number of rows; of none is known in which tile it is."""
        return len(self) if inside is None else None

    def contents(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """The rows as a text."""
        yield "table", text_array(self.frame.to_csv(index=False))

    def page_sections(
        self, title: str, help: str, columns: Mapping[str, Column] = MappingProxyType({})
    ) -> tuple[Section, ...]:
        """The first rows."""
        from toolbox.data.report import Rows, Section

        return (Section(title, [Rows(self, help, columns=columns)]),)

    def differences(self, now: Table) -> Iterator[str]:
        """What differs in another table, in words."""
        return differences.of_frames(self.frame, now.frame)

    def text(self) -> str:
        """The table as aligned plain text: numbers to the right, "-" if missing."""
        columns = [_aligned(str(name), column) for name, column in self._frame.items()]
        return "\n".join("  ".join(cells).rstrip() for cells in zip(*columns, strict=True))


def plain(frame: pd.DataFrame) -> pd.DataFrame:
    """The frame with numpy types, but for whole numbers and yes/no with missing values."""
    import pandas as pd

    return pd.DataFrame({name: _plain_column(column) for name, column in frame.items()})


def _plain_column(column: pd.Series[Any]) -> pd.Series[Any]:
    if column.dtype.kind == "f":
        return column.astype("float64")
    if column.hasnans or column.dtype.name not in _NULLABLE:
        return column
    return column.astype(_NULLABLE[column.dtype.name])


def _json_ready(value: Any) -> Any:
    if hasattr(value, "isoformat"):  # dates, times and spans of time
        return value.isoformat()
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value


def _aligned(name: str, column: pd.Series[Any]) -> list[str]:
    """The header and cells of a column as texts of one width."""
    cells = [name, *cell_texts(column, missing="-")]
    width = max(len(cell) for cell in cells)
    number = is_number(column)
    return [cell.rjust(width) if number else cell.ljust(width) for cell in cells]


def is_number(column: pd.Series[Any]) -> bool:
    """Whether a column holds numbers; yes and no are none."""
    return column.dtype.kind in "iuf"


def cell_texts(column: pd.Series[Any], *, missing: str) -> list[str]:
    """The values of a column as people read them."""
    pairs = zip(column, column.isna(), strict=True)
    return [missing if absent else cell_text(value) for value, absent in pairs]


def cell_text(value: object) -> str:
    """Six digits of a small number, millimetres of a coordinate."""
    if not isinstance(value, float):
        return str(value)
    if 1000 <= abs(value) < 1e15:
        return f"{value:.3f}".rstrip("0").rstrip(".")
    return f"{value:.6g}"
