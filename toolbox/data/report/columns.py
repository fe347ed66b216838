"""Columns of tables as people read them: headings in words, units, digits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox.data.table import cell_text, is_number

if TYPE_CHECKING:
    import pandas as pd

_UNITS = {"1": "", "m2": "m²", "m3": "m³", "1/m2": "1/m²", "degC": "°C", "deg": "°"}
_UNITS |= {"ft2": "ft²", "ft3": "ft³", "W/m2": "W/m²"}
_SUFFIXES = {"_m2": "m²", "_m3": "m³", "_m": "m", "_deg": "°", "_kv": "kV", "_%": "%"}
LIMITS = {
    "_block_low": "lower limit by blocks (95 %)",
    "_block_high": "upper limit by blocks (95 %)",
    "_low": "lower limit (95 %)",
    "_high": "upper limit (95 %)",
}
_MOST_DIGITS = 4
_WHOLE = 1000  # numbers from this on have no digits after the point, unless they are said
_YES = {True: "yes", False: "no"}


@dataclass(frozen=True)
class Column:
    """How a column of a table is shown to people.

    Attributes
    ----------
    heading : in words; "" for a column that reports leave out, and files hold
    unit : behind the heading, such as "m"; "unit" and "unit²" stand for that of the data, as
        heights and areas of features have; of a share that is shown as percent "%"
    digits : after the decimal point; by the size of the numbers unless given
    factor : that makes numbers in this unit of those in the table
    meaning : what files say of a column whose heading says too little, or that has none
    names : what is shown in place of words that files hold
    never_zero : whether it is more than nothing however small, as an uncertainty is
    circa : of other columns with lists of words, those words that make a number a guess, see
        `guessed`
    as_is : whether its texts are names, which are the same in all languages

    Examples
    --------
    >>> Column("Length of the span", "m", 1).text(284.6253)
    '284.6'
    >>> Column("Kind", names={"omission": "only in the reference"}).text("omission")
    'only in the reference'
    >>> Column("Standard error", "m", 3, never_zero=True).text(0.00012)
    '< 0.001'
    """

    heading: str
    unit: str = ""
    digits: int | None = None
    factor: float = 1.0
    meaning: str = ""
    names: Mapping[str, str] = field(default_factory=dict)
    never_zero: bool = False
    circa: Mapping[str, frozenset[str]] = field(default_factory=dict)
    as_is: bool = False

    def text(self, value: Any, digits: int | None = None) -> str:
        """A value of the column as it is shown, with its own digits unless others are given.

        What is rounded to nothing has no sign, and nothing at all no row of zeros.
        """
        digits = self.digits if digits is None else digits
        if isinstance(value, bool | np.bool_):
            return _YES[bool(value)]
        if not isinstance(value, float | np.floating) or digits is None:
            return cell_text(self.names.get(value, value))
        if not math.isfinite(value):
            return ""
        if value == 0 and digits > _MOST_DIGITS and not self.never_zero:
            return "0"
        text = f"{float(value) * self.factor:.{digits}f}"
        if self.never_zero and float(text) == 0:
            return f"< {10.0**-digits:.{digits}f}"
        return text.lstrip("-") if float(text) == 0 else text

    def is_guess(self, row: Mapping[Any, Any]) -> bool:
        """Whether the number in a row of a table is a guess, by what the row says elsewhere.

        >>> width = Column("Width", "m", 2, circa={"unsure": frozenset({"left", "right"})})
        >>> width.is_guess({"unsure": "left, top"}), width.is_guess({"unsure": "top"})
        (True, False)
        """
        said = ((row.get(name), words) for name, words in self.circa.items())
        return any(isinstance(t, str) and not words.isdisjoint(t.split(", ")) for t, words in said)


def guessed(number: str) -> str:
    """A number that is a guess, as people read it; files have the number alone."""
    return f"ca. {number}"


COMMON: Mapping[str, Column] = {
    **{name: Column(name, "", 2) for name in ("x", "y", "z")},
    **{name: Column(name.capitalize(), "", 2) for name in ("easting", "northing", "elevation")},
    "latitude": Column("Latitude", "°", 6),
    "longitude": Column("Longitude", "°", 6),
    "id": Column("Number"),
    "span_id": Column("Span"),
    "wire_id": Column("Wire"),
    "object_id": Column("Object"),
    "plane_id": Column("Plane"),
    "front_id": Column("Front"),
    "tower_id": Column("Tower"),
    "points": Column("Points"),
    "kind": Column("Kind"),
    "rms": Column("Root mean square error", "", 3),
    "sd": Column("Standard deviation", "", 3),
}
"""What several tools call the same; a tool declares its own columns with its sink."""


def unit_text(unit: str | None) -> str:
    """A unit with its raised numbers; "" of a ratio or count."""
    return _UNITS.get(unit or "", unit or "")


def column_of(name: str, values: pd.Series[Any], declared: Mapping[str, Column]) -> Column:
    """How a column is shown: as declared, else by its name and its numbers."""
    found = declared.get(name) or COMMON.get(name) or _limit(name, declared) or _by_name(name)
    if found.digits is None and is_number(values) and values.dtype.kind == "f":
        return replace(found, digits=_digits(values, found.factor))
    return found


def _limit(name: str, declared: Mapping[str, Column]) -> Column | None:
    """How a limit of a declared column is shown, with its unit and digits; None if it is none."""
    for suffix, words in LIMITS.items():
        if name.endswith(suffix) and (column := declared.get(name.removesuffix(suffix))):
            return replace(column, heading=f"{column.heading}, {words}")
    return None


def _by_name(name: str) -> Column:
    """A heading out of the name of a column, and its unit where the name ends with one."""
    stem, unit = name, ""
    for suffix, text in _SUFFIXES.items():
        if name.lower().endswith(suffix):
            stem, unit = name[: -len(suffix)], text
            break
    words = stem.replace("_", " ").strip() or name
    return Column(words[0].upper() + words[1:], unit)


def _digits(values: pd.Series[Any], factor: float) -> int:
    """So many that the largest number has four digits that tell something; none of whole numbers.

    Whole numbers are floats where one is missing.
    """
    known = values.dropna()
    if len(known) < len(values) and (known % 1 == 0).all():
        return 0
    sizes = np.abs(values.to_numpy(float)) * factor
    largest = float(np.max(sizes, where=np.isfinite(sizes), initial=0.0))
    if largest == 0 or largest >= _WHOLE:
        return 0 if largest >= 100 * _WHOLE or largest == 0 else 1
    return min(max(3 - math.floor(math.log10(largest)), 0), _MOST_DIGITS)
