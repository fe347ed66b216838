"""Numbers, units and names as people read them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from toolbox import language
from toolbox.data.crs import Unit, own_number, own_unit, short_height_unit
from toolbox.data.layer import Layer
from toolbox.data.report import Column, unit_text
from toolbox.declare.fields import Field, Spec
from toolbox.labels import in_words

_FOLDERS = re.compile(r"(?<![\w:/.\\])(?:[A-Za-z]:[\\/]|/(?=[^\s/]+/))(?:[^\s/\\:;,]+[\\/])+")
_WHOLE = 100  # square and cubic metres from which on parts of one tell nothing
_MILLIMETRE = 0.001  # metres, the last digit of a length
_LEAST = 5e-7  # metres: what is less, as the rounding of numbers leaves it, is nothing
_DIGITS = 4  # of a length that was set, in another unit than its own
_SHARE = re.compile(r"\bshare\b", re.I)


def value_text(value: Any, unit: str | None) -> str:
    """A number with the digits that tell something: millimetres of lengths, whole square metres.

    >>> value_text(0.25, "m"), value_text(0.00018, "m"), value_text(-5e-7, "m")
    ('0.250', '0.00018', '0.000')
    """
    if isinstance(value, tuple):
        return ", ".join(value_text(item, unit) for item in value)
    if not isinstance(value, float):
        return str(value)
    if unit == "m":
        small = _LEAST < abs(value) < _MILLIMETRE / 2
        return f"{value:.6f}".rstrip("0") if small else f"{value:z.3f}"
    if unit in ("m2", "m3") and abs(value) >= _WHOLE:
        return f"{value:.0f}"
    return f"{value:.4g}" if abs(value) < 1000 else f"{value:.1f}"


def result_value(
    value: Any, unit: str | None, help: str, *, exact: bool = False
) -> tuple[Any, str]:
    """A result as a table holds it, and its unit there: numbers as numbers, shares in percent.

    Parameters
    ----------
    exact : keep the decimals of areas, as of those that will be told in another unit

    Examples
    --------
    >>> result_value(0.5, "1", "Share of points that are ground")
    (50.0, '%')
    >>> result_value(1234.5, "m2", "Area"), result_value(1234.5, "m2", "Area", exact=True)
    ((1234, 'm2'), (1234.5, 'm2'))
    """
    if is_share(value, unit, help):
        return value * 100, "%"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value_text(value, unit), unit or ""
    whole = unit in ("m2", "m3") and isinstance(value, float) and _WHOLE <= abs(value) < math.inf
    return round(value) if whole and not exact else value, unit or ""


def is_share(value: Any, unit: str | None, help: str) -> bool:
    """Whether a result is a share of one, which people are told in percent."""
    return unit == "1" and isinstance(value, float) and bool(_SHARE.search(help))


def result_text(value: Any, unit: str | None, help: str) -> tuple[str, str]:
    """A result and its unit as they are shown; shares in percent.

    Examples
    --------
    >>> result_text(0.3773, "1", "Share of points that are ground")
    ('37.7', '%')
    """
    if is_share(value, unit, help):
        return f"{value * 100:.1f}", "%"
    return value_text(value, unit), unit_text(unit)


def setting_text(value: Any) -> str:
    """The value of a setting, from its JSON; coordinates keep all of their digits.

    Examples
    --------
    >>> setting_text([273371.9, 5274430.7]), setting_text(0.05), setting_text(2.0)
    ('273371.9, 5274430.7', '0.05', '2')
    """
    if value is None:
        return "not given"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(setting_text(item) for item in value)
    return f"{value:.15g}" if isinstance(value, float) else str(value)


def setting_of(field: Field, value: Any) -> str:
    """The value of a setting; a word that says too little after what it is called.

    Examples
    --------
    >>> from toolbox import catalog
    >>> thin = catalog.load("points.thin").inputs
    >>> setting_of(thin["dimensions"], 2), setting_of(thin["cell"], 2.0)
    ('Columns (2)', '2')
    """
    called = field.words.get(value) if isinstance(value, str | int) else None
    return f"{language.text(called)} ({value})" if called else setting_text(value)


def length_text(size: float, unit: Unit | None) -> str:
    """A length that was set, in metres and in the unit of the data; the one that is round first.

    Examples
    --------
    >>> feet = ("ft", 0.3048)
    >>> length_text(1.0, None), length_text(30.0, feet), length_text(0.9144, feet)
    ('1 m', '30 m (98.43 ft)', '3 ft (0.9144 m)')
    """
    if unit and is_round(size, unit):
        return f"{own_unit(size, unit, digits=_DIGITS)[2:-1]} ({size:.{_DIGITS}g} m)"
    return f"{setting_text(size)} m{own_unit(size, unit, digits=_DIGITS)}"


def setting_in(field: Field, value: Any, unit: Unit | None) -> tuple[str, str]:
    """The value of a setting and its unit: that of the data for a length that is round in it.

    Examples
    --------
    >>> from toolbox import catalog
    >>> cell = catalog.load("points.thin").inputs["cell"]
    >>> setting_in(cell, 0.9144, ("ft", 0.3048)), setting_in(cell, 0.9144, None)
    (('3', 'ft'), ('0.9144', 'm'))
    >>> setting_in(cell, None, None)
    ('not given', '')
    """
    if value is None:
        return setting_text(value), ""
    length = field.unit == "m" and isinstance(value, int | float)
    if unit and length and is_round(value, unit):
        return own_number(value, unit, digits=_DIGITS), unit[0]
    return setting_of(field, value), unit_text(field.unit)


def is_round(size: float, unit: Unit) -> bool:
    """Whether a length in metres has few digits in another unit."""
    own = size / unit[1]
    return math.isclose(own, float(f"{own:.{_DIGITS}g}"), rel_tol=1e-9)


def title_of(name: str) -> str:
    """The name of an output as a heading.

    Examples
    --------
    >>> title_of("tree_tops"), title_of("ground.classified")
    ('Tree tops', 'Ground: classified')
    """
    first, *others = (in_words(part) for part in name.split("."))
    return ": ".join([first, *(other[:1].lower() + other[1:] for other in others)])


def titled(declared: Field) -> str:
    """The heading of a result: its label, else its name in words."""
    return declared.label or title_of(declared.name)


def without_folders(text: str) -> str:
    """A text in which files have their names alone, as others have no such folders.

    Examples
    --------
    >>> without_folders("/data/new/a.laz: 2 m/s; see https://a.org/b/c and C:\\\\data\\\\b.laz")
    'a.laz: 2 m/s; see https://a.org/b/c and b.laz'
    """
    return _FOLDERS.sub("", text)


def anchor_of(name: str) -> str:
    """The name of a layer in links."""
    return re.sub(r"[^A-Za-z0-9]+", "_", name)


def columns_in(columns: Mapping[str, Column], layer: Layer) -> dict[str, Column]:
    """Columns in the unit of a layer where they say "unit" or "unit²"."""
    unit = short_height_unit(layer.crs)
    own = {"unit": unit, "unit²": f"{unit}²" if unit else ""}
    return {n: replace(c, unit=own.get(c.unit, c.unit)) for n, c in columns.items()}


def generic(spec: Spec, found: Mapping[str, Any]) -> str:
    """A sentence made of the numbers that a tool gave, for one that says none itself."""
    parts = []
    for name, value in found.items():
        field = spec.results[name]
        if field.kind.is_layer or value is None:
            continue
        text, unit = result_text(value, field.unit, field.help)
        help = language.text(field.help)
        help = language.uncapitalised(help) if help == field.help else help
        parts.append(f"{help}: {text} {unit}".rstrip())
    if not parts:
        return f"{spec.title}: the results are on the map and in the tables below."
    said = "; ".join(parts)
    return f"{language.capitalised(said)}."
