"""Points in text files: one line per point, with or without a header line."""

from __future__ import annotations

import gzip
import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import IO, Any, BinaryIO, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pandas.io.parsers import TextFileReader
from pyproj import CRS

from toolbox.context import QUIET, Context, log
from toolbox.data.axis_names import AXES, ambiguity, axes_of, chosen, plain
from toolbox.data.las.header import fields
from toolbox.data.reading import Reading, errors_named, opened, unpacked
from toolbox.errors import DataError

_BLOCK = 250_000  # lines between two reports of progress
_COMMENTS = ("#", "//")
_SEPARATORS = ("\t", ";", ",", None)  # None: blanks, as in str.split
_DECIMALS = (".", ",")
_UNMARKED = 1000  # lines that are searched for decimals where the first has whole numbers alone
_ALIASES = {
    "intensity": "intensity,i,scalarintensity",
    "return_number": "returnnumber,returnno,returnnr,scalarreturnnumber",
    "number_of_returns": "numberofreturns,numreturns,nreturns,scalarnumberofreturns",
    "classification": "classification,class,scalarclassification",
    "scan_direction_flag": "scandirectionflag,scalarscandirectionflag",
    "edge_of_flight_line": "edgeofflightline,scalaredgeofflightline",
    "scan_angle_rank": "scananglerank,scalarscananglerank",
    "scan_angle": "scanangle",
    "user_data": "userdata,scalaruserdata",
    "point_source_id": "pointsourceid,pointsource,scalarpointsourceid",
    "scanner_channel": "scannerchannel,scanchannel",
    "gps_time": "gpstime,time,scalargpstime",
    "red": "red,r",
    "green": "green,g",
    "blue": "blue,b",
    "nir": "nir,infrared,nearinfrared",
    "synthetic": "synthetic",
    "key_point": "keypoint",
    "withheld": "withheld",
    "overlap": "overlap",
}
_NAMES = {alias: name for name, aliases in _ALIASES.items() for alias in aliases.split(",")}
_LETTERS = {"r", "g", "b"}
_PTS = {4: "i", 6: "rgb", 7: "irgb"}  # what a .pts line holds after x y z
_FIELDS = {name: kind for number in (3, 8) for name, kind in fields(number).items()}
_FLOAT = re.compile(r"[-+]?\d+,\d+")


class Points(Protocol):
    """What writers of points need of a point cloud."""

    @property
    def crs(self) -> CRS | None: ...
    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def decimals(self) -> tuple[int | None, int | None, int | None]: ...
    @property
    def xyz(self) -> NDArray[np.float64]: ...
    def __getitem__(self, name: str) -> NDArray[Any]: ...


@dataclass(frozen=True)
class _Table:
    """How the lines of a file are to be read.

    Parameters
    ----------
    names : of the columns
    separator : None for blanks
    skip : number of lines before the first point
    comment : the character that begins a comment
    count : number of points that the file promises, or None
    empty : whether there is no point
    unclear : what is not clear about the names of coordinates in the file
    texts : places of columns that hold texts, such as the names of points, and are left out
    decimal : the mark before the decimals, a point or a comma
    """

    names: list[str]
    separator: str | None
    skip: int = 0
    comment: str = "#"
    count: int | None = None
    empty: bool = False
    unclear: str = ""
    texts: frozenset[int] = frozenset()
    decimal: str = "."

    @property
    def numbers(self) -> list[int]:
        """Places of the columns that hold numbers."""
        return [place for place in range(len(self.names)) if place not in self.texts]


def standard_names(texts: Sequence[str]) -> list[str]:
    """The LAS names of columns or properties: "Easting" is x, "ReturnNumber" return_number.

    Case, accents, blanks, underscores and a unit in brackets make no difference. A name that is
    not known is kept, and so is a second one for the same, such as "height" beside "z".
    """
    words = [plain(text) for text in texts]
    axes = axes_of(texts)
    lonely = set() if set(words) >= _LETTERS else _LETTERS  # b alone may be anything
    names = [
        axes[text] if text in axes else text if word in lonely else _NAMES.get(word, text)
        for word, text in zip(words, texts, strict=True)
    ]
    exact = {name for word, name in zip(words, names, strict=True) if word == _plain(name)}
    taken: set[str] = set()
    for index, (word, text) in enumerate(zip(words, texts, strict=True)):
        name = names[index]
        if word != _plain(name) and (name in exact or name in taken):
            names[index] = text
        taken.add(names[index])
    return names


def _plain(name: str) -> str:
    return name.replace("_", "")


def read_text(
    path: Path,
    *,
    columns: Sequence[str] | None = None,
    separator: str | None = None,
    reading: Reading | None = None,
    ctx: Context = QUIET,
) -> tuple[NDArray[np.float64], dict[str, NDArray[Any]]]:
    """Read coordinates and attributes of a text file.

    Comments begin with # or //. The first line may hold names, also as a comment; without names
    the first three columns are x, y and z, and the others column4, column5, ... A .pts file may
    begin with the number of its points. Whole numbers become integers. Where commas do not separate
    the columns they may stand before the decimals, as spreadsheets of many countries write them.

    Parameters
    ----------
    path : of an existing file; .gz is unpacked
    columns : names of all columns, with x, y and z among them; instead of those in the file
    separator : one character; tab, semicolon, comma or blanks are found out
    reading : where the hash of the file is noted

    Returns
    -------
    xyz : of shape (n, 3)
    attributes : the other columns

    Raises
    ------
    DataError
        Names the line where the file is not such a table.
    """
    if separator is not None and len(separator) != 1:
        raise DataError(f"{path}: the separator must be one character, got {separator!r}")
    separator = None if separator == " " else separator  # blanks are found out
    with errors_named(f"{path} cannot be read as a text file of points"):
        table = _table(path, columns, separator)
        frame = _read(path, table, reading, ctx)
    if table.texts:
        left = ", ".join(table.names[place] for place in sorted(table.texts))
        log.warning("%s: texts are left out of points: %s", path.name, left)
    if table.decimal == ",":
        log.warning("%s: commas are read as decimal points", path.name)
    if table.count not in (None, len(frame)):
        raise DataError(f"{path} promises {table.count} points, and {len(frame)} are there")
    xyz = frame[["x", "y", "z"]].to_numpy(np.float64)
    others = [str(name) for name in frame if name not in ("x", "y", "z")]
    return xyz, {name: _compact(name, frame[name].to_numpy()) for name in others}


@contextmanager
def _text(path: Path) -> Iterator[IO[str]]:
    with path.open("rb") as file, unpacked(file, path, lines=True) as content:
        yield io.TextIOWrapper(content, encoding="utf-8-sig")


def _table(path: Path, columns: Sequence[str] | None, separator: str | None) -> _Table:
    """Find names, separator and first line of the points in a text file."""
    comment, count = "", None
    content: list[tuple[int, str]] = []  # the first two lines that are not comments
    with _text(path) as lines:
        for number, line in enumerate(lines):
            text = line.strip()
            if number == 0 and text.isdecimal() and _suffix(path) == ".pts":
                count = int(text)
            elif text.startswith(_COMMENTS):
                comment = text if not content else comment
            elif text:
                content.append((number, text))
            if len(content) == 2:
                break
    if not content and count != 0:
        raise DataError(f"{path} holds no points")
    if content and content[0][1].lower().startswith("ncols"):
        raise DataError(f"{path} is a raster (ESRI ASCII grid), not a file of points")
    table = _begin(path, content, comment, separator)
    if columns:
        table = replace(table, names=standard_names(columns), unclear="")
    elif not table.names:
        table = replace(table, names=_default_names(path, table, comment, content))
    _check_names(path, table, content)
    table = replace(table, comment="/" if comment.startswith("//") else "#", count=count)
    return table if table.empty else replace(table, decimal=_decimal(path, table))


def _decimal(path: Path, table: _Table) -> str:
    """The mark before decimals; spreadsheets write whole numbers without, so of the first such."""
    if table.separator == ",":
        return "."
    with _text(path) as lines:
        for line in islice(lines, table.skip, table.skip + _UNMARKED):
            cells = _cells(line.split(table.comment)[0], table.separator)
            numbers = [cells[place] for place in table.numbers if place < len(cells)]
            if any(map(_FLOAT.fullmatch, numbers)):
                return ","
            if any("." in cell for cell in numbers):
                return "."
    return "."


def _begin(
    path: Path, content: list[tuple[int, str]], comment: str, separator: str | None
) -> _Table:
    """Find the header line among the first lines; without one the names stay empty."""
    for index, (number, text) in enumerate(content):
        header = content[0][1] if index == 1 else ""
        found = _marks(text, separator) or _beside_texts(header, text, separator)
        if found is None:
            continue
        between, decimal = found
        names = _cells(header, between) if header else []
        cells = enumerate(_cells(text, between))
        texts = frozenset(place for place, cell in cells if not is_number(cell, decimal))
        unclear = ambiguity(names)
        return _Table(standard_names(names), between, number, unclear=unclear, texts=texts)
    if len(content) == 1 and not any(is_number(cell) for cell in _split(content[0][1])):
        names = _split(content[0][1], separator)  # a line of names without points
        return _Table(standard_names(names), separator, empty=True)
    if not content:
        return _Table(["x", "y", "z"], separator, empty=True)
    number, text = content[-1]
    hint = ""
    if any(_FLOAT.fullmatch(cell) for cell in re.split(r"[;\s]+", text)):
        hint = "; decimals must all have a point, or all a comma"
    elif sum(map(is_number, text.split())) >= 3:  # names of points, and no header
        hint = "; columns of texts need a first line with the names of all, such as id x y z"
    raise DataError(f"{path}, line {number + 1}: {text[:60]!r} is not a line of numbers{hint}")


def _candidates(separator: str | None) -> Iterator[tuple[str | None, str]]:
    """Marks between columns and before decimals, in the order in which they are tried."""
    for decimal in _DECIMALS:
        for between in (separator,) if separator else _SEPARATORS:
            if between != decimal:
                yield between, decimal


def _marks(text: str, separator: str | None) -> tuple[str | None, str] | None:
    """What makes three numbers or more of a line: marks between columns and before decimals."""
    for between, decimal in _candidates(separator):
        cells = _cells(text, between)
        if len(cells) >= 3 and all(is_number(cell, decimal) for cell in cells):
            return between, decimal
    return None


def _beside_texts(header: str, text: str, separator: str | None) -> tuple[str | None, str] | None:
    """The marks of a line whose header names x, y and z, in columns of numbers; or None.

    The other columns may hold texts, such as the names and codes that surveyors give to points.
    """
    for between, decimal in _candidates(separator):
        names, cells = _cells(header, between), _cells(text, between)
        taken = set(chosen(names).values())
        pairs = zip(names, cells, strict=False)
        numbers = {name for name, cell in pairs if is_number(cell, decimal)}
        if len(names) == len(cells) and len(taken) == len(AXES) and taken <= numbers:
            return between, decimal
    return None


def _cells(text: str, separator: str | None) -> list[str]:
    return [cell.strip().strip("\"'") for cell in text.split(separator)]


def _split(text: str, separator: str | None = None) -> list[str]:
    """The cells of a header line, whatever separates them."""
    return _cells(text, separator) if separator else re.split(r"\s*[,;\t]\s*|\s+", text.strip())


def is_number(cell: str, decimal: str = ".") -> bool:
    """Whether a cell of a text file is a number, with this mark before its decimals."""
    if decimal == ",":
        if "." in cell:
            return False
        cell = cell.replace(",", ".")
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def _default_names(
    path: Path, table: _Table, comment: str, content: list[tuple[int, str]]
) -> list[str]:
    """Names from the comment before the points, if it has them, or by position."""
    width = len(_cells(content[0][1], table.separator))
    named = standard_names(_split(comment.lstrip("#/ ")))
    if len(named) == width and {"x", "y", "z"} <= set(named):
        return named
    others = [f"column{number}" for number in range(4, width + 1)]
    if _suffix(path) == ".pts" and width in _PTS:
        others = standard_names(list(_PTS[width]))
    return ["x", "y", "z", *others]


def _check_names(path: Path, table: _Table, content: list[tuple[int, str]]) -> None:
    names = table.names
    if table.unclear:
        raise DataError(f"{path}: {table.unclear}; name all columns, e.g. columns=name,x,y,z")
    if missing := [name for name in "xyz" if name not in names]:
        raise DataError(
            f"{path} has no column {', '.join(missing)}, only {', '.join(names)}; "
            "name all columns, e.g. columns=x,y,z,label"
        )
    if len(set(names)) < len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise DataError(f"{path} has several columns {', '.join(twice)}")
    width = len(names) if table.empty else len(_cells(dict(content)[table.skip], table.separator))
    if width != len(names):
        twice_as_many = table.separator == "," and width == 2 * len(names)
        hint = "; where decimals have commas, semicolons must separate columns"
        raise DataError(
            f"{path}, line {table.skip + 1}: {width} values for the {len(names)} columns "
            f"{', '.join(names)}{hint if twice_as_many else ''}"
        )


def _suffix(path: Path) -> str:
    return Path(path.name.lower().removesuffix(".gz")).suffix


def _read(path: Path, table: _Table, reading: Reading | None, ctx: Context) -> pd.DataFrame:
    if table.empty:
        return pd.DataFrame({name: np.empty(0) for name in table.names})
    done, frames = 0, []
    try:
        with (
            opened(path, reading, ctx) as file,
            _blocks(unpacked(file, path, lines=True), table) as blocks,
        ):
            for block in blocks:
                ctx.progress(1 - 1 / (1 + done / 1e7))  # the number of lines is not known
                numbers = block.drop(columns=list(table.texts))
                _check_block(numbers)
                frames.append(numbers)
                done += len(block)
    except ValueError:
        _explain(path, table)
        raise
    frame = pd.concat(frames, ignore_index=True)
    frame.columns = pd.Index([table.names[place] for place in table.numbers])
    coordinates = frame[["x", "y", "z"]].to_numpy(float)
    if not np.isfinite(coordinates).all() or frame.isna().to_numpy().any():
        _explain(path, table)
    return frame


def _blocks(file: BinaryIO, table: _Table) -> TextFileReader:
    return pd.read_csv(
        file,
        sep=table.separator or r"\s+",
        decimal=table.decimal,
        header=None,
        dtype=dict.fromkeys(table.texts, str),
        skiprows=table.skip,
        comment=table.comment,
        skipinitialspace=True,
        keep_default_na=False,
        na_values=["nan", "NaN", "NAN"],
        low_memory=False,
        chunksize=_BLOCK,
        encoding="utf-8-sig",
    )


def _check_block(block: pd.DataFrame) -> None:
    if any(dtype.kind not in "iuf" for dtype in block.dtypes):
        raise ValueError("some lines are not numbers")


def _explain(path: Path, table: _Table) -> None:
    """Raise a DataError that names the first bad line; NaN is allowed in attributes."""
    with _text(path) as lines:
        for number, line in enumerate(lines):
            text = line.split(table.comment)[0].strip()
            if number < table.skip or not text:
                continue
            cells = _cells(text, table.separator)
            if len(cells) != len(table.names):
                raise DataError(
                    f"{path}, line {number + 1}: {len(cells)} values instead of {len(table.names)}"
                )
            for place in table.numbers:
                where = f"{path}, line {number + 1}"
                _check_cell(where, table.names[place], cells[place], table.decimal)


def _check_cell(where: str, name: str, cell: str, decimal: str) -> None:
    if not is_number(cell, decimal):
        hint = ""
        if decimal == "." and _FLOAT.fullmatch(cell):
            hint = "; decimals must have a point, as further above"
        elif decimal == "," and is_number(cell):
            hint = "; decimals must have a comma, as further above"
        raise DataError(f"{where}: {name} is {cell!r}, which is not a number{hint}")
    if name in ("x", "y", "z") and not np.isfinite(float(cell.replace(",", "."))):
        raise DataError(f"{where}: {name} is {cell}")


def _compact(name: str, values: NDArray[Any]) -> NDArray[Any]:
    """Whole numbers as integers: of the LAS type if there is one, or of 32 bits if they fit."""
    wanted = np.dtype(_FIELDS.get(name, np.int32))
    if wanted.kind == "f":
        return values.astype(np.float64)
    if values.dtype.kind == "f":
        if not (np.isfinite(values) & (np.abs(values) < 2**53) & (values == np.rint(values))).all():
            return values
        values = values.astype(np.int64)
    limits = np.iinfo(wanted)
    fits = len(values) == 0 or (values.min() >= limits.min and values.max() <= limits.max)
    return values.astype(wanted) if fits else values


def write_text(
    path: Path, cloud: Points, *, wanted: Sequence[str] | None = None, ctx: Context = QUIET
) -> None:
    """Write points to a text file: a header line, and a line per point.

    Coordinates have the decimals that their LAS scale needs; other numbers the fewest digits that
    give the same number back. Commas separate the columns of .csv, blanks those of other files.

    Parameters
    ----------
    wanted : columns to write, x, y and z first; all unless given

    Raises
    ------
    DataError
        The name of an attribute cannot be the name of a column, or one that is wanted is none.
    """
    separator = "," if _suffix(path) == ".csv" else " "
    columns = dict(_named_columns(cloud))
    if wanted is not None:
        columns = _chosen(path, columns, wanted)
    for name in columns:
        if not re.fullmatch(r"(?![=+@-])[^\t\n\r,;#\"'/]+", name) or is_number(name):
            raise DataError(f"{path}: {name!r} cannot be the name of a column; rename it")
        if separator in name:
            raise DataError(f"{path}: {name!r} has a blank, which separates columns; write .csv")
    forms = ["%r" if count is None else f"%.{count}f" for count in cloud.decimals]
    form = separator.join([*forms, *("%s" for _ in columns)]) + "\n"
    with _sink(path) as sink:
        sink.write((separator.join(["x", "y", "z", *columns]) + "\n").encode())
        xyz = cloud.xyz
        for start in range(0, len(xyz), _BLOCK):
            ctx.progress(start / len(xyz))
            block = slice(start, start + _BLOCK)
            cells = [
                *xyz[block].T.tolist(),
                *(_texts(values[block]) for values in columns.values()),
            ]
            sink.write("".join([form % row for row in zip(*cells, strict=True)]).encode())


def _chosen(
    path: Path, columns: dict[str, NDArray[Any]], wanted: Sequence[str]
) -> dict[str, NDArray[Any]]:
    """The columns beside x, y and z that are wanted, in their order."""
    if list(wanted[:3]) != ["x", "y", "z"]:
        raise DataError(f"{path}: columns begin with x,y,z, got {','.join(wanted)}")
    if missing := [name for name in wanted[3:] if name not in columns]:
        raise DataError(f"{path}: there is no column {missing[0]!r}, only {', '.join(columns)}")
    return {name: columns[name] for name in wanted[3:]}


def _named_columns(cloud: Points) -> Iterator[tuple[str, NDArray[Any]]]:
    for name in cloud.names:
        values = cloud[name]
        if values.ndim == 1:
            yield name, values
        else:
            yield from ((f"{name}_{k + 1}", values[:, k]) for k in range(values.shape[1]))


def _texts(values: NDArray[Any]) -> list[Any]:
    """Python numbers whose text is as short as possible."""
    if values.dtype == np.float32:
        return [str(value) for value in values]
    return list((values.view("u1") if values.dtype.kind == "b" else values).tolist())


@contextmanager
def _sink(path: Path) -> Iterator[IO[bytes]]:
    with path.open("wb") as file:
        if path.suffix.lower() != ".gz":
            yield file
            return
        # without name and time, so that the same points give the same file
        with gzip.GzipFile(filename="", mode="wb", fileobj=file, mtime=0) as packed:
            yield packed  # type: ignore[misc]
