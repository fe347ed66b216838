"""The table of types: how values of each type are read, checked and described."""

from __future__ import annotations

import contextlib
import inspect
import math
import numbers
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from pyproj import CRS

from toolbox import files
from toolbox.context import QUIET, Context
from toolbox.data import Drawing, PointCloud, Raster, Report, Survey, Table, Vector
from toolbox.data.crs import parse_crs
from toolbox.data.extras import Extra
from toolbox.data.las.versions import VERSIONS
from toolbox.data.paths import Paths, PointFiles
from toolbox.data.reading import Reading
from toolbox.declare.expression import Expression
from toolbox.declare.values import (
    Attribute,
    ClassList,
    DataFile,
    Direction,
    Extent,
    Position,
    Range,
    whole,
)

TRUE, FALSE = ("true", "yes", "on", "1"), ("false", "no", "off", "0")


@dataclass(frozen=True)
class Kind:
    """A row of the table: one type of value.

    Attributes
    ----------
    word : the name of the type in help, errors and descriptions
    schema : JSON schema of one value
    accepts : whether a Python value is of this type
    parse : reads one from a text or a JSON value; raises ValueError
    to_json : converts a value to JSON
    plain : whether the word alone says what a text must look like, so that errors need no more
    open : reads a layer from a path; only `toolbox.runs.source` calls it
    coordinates : what the numbers of a value are and in which CRS, if they are coordinates
    suffixes : endings of the files that it can be written to; empty if it is no layer
    special : endings of those of them that hold layers of a certain content alone, and which
    needs : optional libraries that files with some endings need
    open_options, save_options : names in `OPTIONS` that a source or target may have
    own_files : all files that a layer written to a path consists of
    several : whether one value may be read from many files: a folder, a pattern or a list
    is_gridded, in_blocks : of a layer, see :class:`toolbox.data.layer.Layer`
    """

    word: str
    schema: Mapping[str, Any]
    accepts: Callable[[Any], bool]
    parse: Callable[[Any], Any]
    to_json: Callable[[Any], Any] = field(default=lambda value: value)
    plain: bool = False
    open: Callable[..., Any] | None = None
    coordinates: str = ""
    suffixes: tuple[str, ...] = ()
    special: Mapping[str, str] = field(default_factory=dict)
    needs: Mapping[str, Extra] = field(default_factory=dict)
    open_options: tuple[str, ...] = ()
    save_options: tuple[str, ...] = ()
    own_files: Callable[[Path], tuple[Path, ...]] = files.itself
    several: bool = False
    is_gridded: bool = False
    in_blocks: bool = False

    @property
    def is_layer(self) -> bool:
        """Whether values are read from files and written to files."""
        return bool(self.suffixes)


def find(hint: Any) -> Kind:
    """The row of a type.

    Raises
    ------
    TypeError
        A declaration uses a type that is not in the table.
    """
    if hint in KINDS:
        return KINDS[hint]
    raise TypeError(f"{hint!r} cannot be declared; there are {[k.word for k in KINDS.values()]}")


@dataclass(frozen=True)
class Option:
    """How a layer is read or written, where its file does not say so."""

    help: str
    parse: Callable[[Any], Any]


def _number(value: Any) -> float:
    number = float(value) if isinstance(value, str) else value
    if not _is_number(number):
        raise ValueError
    return float(number)


def _boolean(value: Any) -> bool:
    text = str(value).lower()
    if text not in TRUE + FALSE:
        raise ValueError
    return text in TRUE


def _is_number(value: Any) -> bool:
    real = isinstance(value, numbers.Real) and not isinstance(value, bool)
    try:
        return real and math.isfinite(value)
    except OverflowError:  # an integer beyond all floats
        return False


def _is_integer(value: Any) -> bool:
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError
    return value


def _file(value: Any) -> DataFile:
    return DataFile(_text(str(value) if isinstance(value, Path) else value))


def _is(*types: type) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, types)


OF_SEVERAL = {
    Extent: "xmin, ymin, xmax, ymax in the CRS and unit of the data, easting first",
    Position: "x, y in the CRS and unit of the data, easting first",
}
"""What the numbers of such values are, for process descriptions."""


def _several(cls: Any) -> Kind:
    """The kind of a value that consists of several numbers."""
    count = len(cls._fields)
    schema = {"type": "array", "items": {"type": "number"}, "minItems": count, "maxItems": count}
    coordinates = OF_SEVERAL.get(cls, "")
    return Kind(cls.__name__.lower(), schema, _is(cls), cls.parse, list, coordinates=coordinates)


def _scalars() -> dict[Any, Kind]:
    text = {"type": "string"}
    classes = text | {"pattern": r"^\d+(-\d+)?(,\d+(-\d+)?)*$"}
    return {
        float: Kind("number", {"type": "number"}, _is_number, _number, plain=True),
        int: Kind("integer", {"type": "integer"}, _is_integer, whole, plain=True),
        bool: Kind("boolean", {"type": "boolean"}, _is(bool), _boolean, plain=True),
        str: Kind("text", text, _is(str), _text, plain=True),
        ClassList: Kind("class list", classes, _is(ClassList), ClassList.parse, str),
        **{cls: _several(cls) for cls in (Range, Position, Direction, Extent)},
        CRS: Kind("CRS", text, _is(CRS), parse_crs, lambda crs: crs.to_string()),
        Attribute: Kind("attribute", text, _is(Attribute), lambda v: Attribute(_text(v)), str),
        DataFile: Kind("file", text, _is(DataFile), _file, str, plain=True),
        Expression: Kind(
            "expression",
            text,
            _is(Expression),
            lambda v: Expression(_text(v)),
            str,
            coordinates="heights and all attributes in the units of the data",
        ),
    }


def _columns(value: Any) -> list[str]:
    names = re.split(r"[,;\s]+", value.strip()) if isinstance(value, str) else list(value)
    if not all(isinstance(name, str) and name for name in names):
        raise ValueError(f"needs names, got {value!r}")
    return names


def _version(value: Any) -> str:
    if str(value) not in VERSIONS:
        raise ValueError(f"must be one of {', '.join(VERSIONS)}, got {value!r}")
    return str(value)


def _format(value: Any) -> int:
    number = whole(value)
    if not 0 <= number <= 10:
        raise ValueError(f"must be 0 to 10, got {number}")
    return number


def _crs_text(value: Any) -> str:
    """The text of a CRS, which records keep, if it can be read."""
    parse_crs(_text(value))
    return str(value)


def _fields(value: Any) -> dict[str, str]:
    """Names and texts, from a mapping or from texts such as "Contract=2026-17"."""
    if isinstance(value, Mapping):
        return {str(name): str(text) for name, text in value.items()}
    texts = [value] if isinstance(value, str) else list(value)
    pairs = [str(text).partition("=") for text in texts]
    if wrong := [name for name, sign, _ in pairs if not (sign and name.strip())]:
        raise ValueError(f"is written Name=text, got {wrong[0]!r}")
    return {name.strip(): text.strip() for name, _, text in pairs}


_ORDERS = ("%Y-%m-%d", "%Y/%m/%d", "%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y", "%d-%m-%Y", "%Y-%m", "%Y")

_SURE = ("%Y/%m/%d", "%d.%m.%Y", "%d-%m-%Y")  # of them, in which all people read the same day


def _date(value: Any) -> str:
    """A date as other dates of a report are, year first; words are kept, and dates with slashes.

    Which of their numbers is the month depends on who reads them.

    >>> _date("14.11.2026"), _date("mid-November 2026"), _date("03/04/2026")
    ('2026-11-14', 'mid-November 2026', '03/04/2026')
    """
    text = _text(value).strip()
    if any(map(str.isalpha, text)):
        return text
    for order in _ORDERS:
        with contextlib.suppress(ValueError):
            found = datetime.strptime(text, order)
            return found.strftime("%Y-%m-%d") if order in _SURE else text
    raise ValueError(f"must be a date, such as 2026-11-14 or 14 November 2026, got {value!r}")


def _path(value: Any) -> Path:
    if not isinstance(value, str | Path) or not Path(value).is_file():
        raise ValueError(f"there is no file {value}")
    return Path(value)


OPTIONS: Mapping[str, Option] = {
    "columns": Option(
        "Names of the columns of a text file, such as x,y,z,intensity",
        _columns,
    ),
    "separator": Option("What stands between the columns of a text file", _text),
    "bounds": Option("Read only xmin,ymin,xmax,ymax", Extent.parse),
    "layer": Option("Name of the layer in the file", _text),
    "reproject": Option("Bring it to this CRS as it is read, such as EPSG:32635", _crs_text),
    "assume_crs": Option("CRS of this layer, if its file states none", _crs_text),
    "band": Option("Number of the band to read, counted from 1", whole),
    "version": Option("Version of LAS to write, 1.0 to 1.4; that of the data by default", _version),
    "format": Option("Point format of LAS to write, 0 to 10; that of the data by default", _format),
    "cog": Option("Write a cloud-optimised GeoTIFF", _boolean),
    "head": Option(
        "What a drawing says of its project, such as title=Town hall client=City", _fields
    ),
    "rounded": Option("Write numbers with the digits that a survey knows", _boolean),
    "title": Option("Title of the report", _text),
    "client": Option("For whom the report is made", _text),
    "fields": Option("More of the head of the report, such as Contract=2026-17", _fields),
    "date": Option("Date of the report; today if it is not given", _date),
    "style": Option("CSS file whose rules come after those of the toolbox", _path),
    "logo": Option("Image for the head of the report: PNG, SVG or JPEG", _path),
}


def _layer(
    cls: Any,
    media_type: str,
    *,
    types: tuple[type, ...] = (),
    open: Callable[..., Any] | None = None,
    several: bool = False,
) -> Kind:
    """A layer, which is opened from a path and written to one.

    Parameters
    ----------
    types : of the layers, if others than `cls` too
    open : reads a layer, in place of that of `cls`
    several : whether `open` takes several files, a CRS to assume for those that state none, and
        where to note their hashes
    """
    reader = open or cls.open

    schema = {"type": "string", "format": "uri-reference", "contentMediaType": media_type}
    return Kind(
        cls.__name__,
        schema,
        _is(*(types or (cls,))),
        lambda value: value,
        open=reader,
        suffixes=cls.SUFFIXES,
        special=getattr(cls, "SPECIAL", {}),
        needs=cls.NEEDS,
        open_options=_options_of(reader),
        save_options=_options_of(cls.save),
        own_files=getattr(cls, "own_files", files.itself),
        several=several,
        is_gridded=cls.is_gridded,
        in_blocks=cls.in_blocks,
    )


def _cloud_or_survey(
    paths: Paths | PointFiles,
    *,
    columns: Sequence[str] | None = None,
    separator: str | None = None,
    bounds: Sequence[float] | None = None,
    assume_crs: CRS | str | None = None,
    reading: Reading | None = None,
    ctx: Context = QUIET,
) -> PointCloud | Survey:
    """Several files as a survey, whose headers say enough; a single one, or a part, as a cloud."""
    how: dict[str, Any] = {"columns": columns, "separator": separator, "assume_crs": assume_crs}
    files = PointFiles.of(paths, bounds)
    if bounds is not None or len(files.paths) == 1:
        return PointCloud.open(files, bounds=bounds, reading=reading, ctx=ctx, **how)
    return Survey.open(files, ctx=ctx, **how)


def _survey(
    paths: Paths | PointFiles,
    *,
    columns: Sequence[str] | None = None,
    separator: str | None = None,
    assume_crs: CRS | str | None = None,
    reading: Reading | None = None,
    ctx: Context = QUIET,
) -> Survey:
    """Files as a survey, also a single one; hashes are taken later, as nothing is read whole."""
    return Survey.open(paths, columns=columns, separator=separator, assume_crs=assume_crs, ctx=ctx)


def _options_of(method: Callable[..., Any]) -> tuple[str, ...]:
    return tuple(name for name in inspect.signature(method).parameters if name in OPTIONS)


def parsed_options(given: Mapping[str, Any], known: tuple[str, ...]) -> dict[str, Any]:
    """Texts or JSON values of options as their methods take them.

    Raises
    ------
    ValueError
        An option is unknown or cannot be read.
    """
    if unknown := sorted(given.keys() - set(known)):
        raise ValueError(f"no option {unknown[0]!r}; there are {', '.join(known) or 'none'}")
    found = {}
    for name, value in given.items():
        try:
            found[name] = OPTIONS[name].parse(value)
        except (ValueError, TypeError) as err:
            raise ValueError(f"option {name}: {err or f'cannot be {value!r}'}") from None
    return found


CHOICE = Kind("choice", {}, lambda value: False, lambda value: value)
"""A word or number out of a list; the list stands in the field, which does the checking."""

_LASZIP = "application/vnd.laszip"

KINDS: Mapping[Any, Kind] = _scalars() | {
    PointCloud | Survey: _layer(
        PointCloud, _LASZIP, types=(PointCloud, Survey), open=_cloud_or_survey, several=True
    ),
    Survey: _layer(Survey, "application/geo+json", open=_survey, several=True),
    PointCloud: _layer(PointCloud, _LASZIP, several=True),  # last: the word alone means this one
    Raster: _layer(Raster, "image/tiff; application=geotiff"),
    Vector: _layer(Vector, "application/geopackage+sqlite3"),
    Table: _layer(Table, "text/csv"),
    Report: _layer(Report, "text/html"),
    Drawing: _layer(Drawing, "application/pdf"),
}
