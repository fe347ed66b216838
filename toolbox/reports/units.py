"""Tables, charts and texts of reports in the unit of the data, where that is not the metre."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox import language
from toolbox.data import Rows, Section, Table
from toolbox.data.crs import Unit, own_number, unit_of_lengths
from toolbox.data.layer import Layer, crs_of
from toolbox.data.measures import UNIT, VALUE, unit_column
from toolbox.data.report import Block, Column, column_of
from toolbox.declare.show import Axis, Curve, Show
from toolbox.pictures.draw import Shown

if TYPE_CHECKING:
    import pandas as pd

_POWERS = {"m": 1, "m2": 2, "m²": 2, "m3": 3, "m³": 3, "1/m2": -2, "1/m²": -2}
_RAISED = {1: "{}", 2: "{}²", 3: "{}³", -2: "1/{}²"}
_MORE = {-2: 1}  # digits that densities need in feet, of which there are ten to the square metre
_SIZE = r"[-+\u2212]?\d+(?:\.\d+)?"
_BETWEEN = r" of | to | - "  # a part and its whole, the ends of a range; the last in Turkish
# Metres in a text, a part or a range of them: no power of ten, and not what defines another unit.
_SAID = rf"(?<![\w.,:/^+\u2212-])({_SIZE})(?:({_BETWEEN})({_SIZE}))? (m[23²³]?)(?![\w/²³]| =)"
_EXACT = (3, 2)  # digits after the point of exact metres, and the least of them in another unit
_ROUND = re.compile(r"[1-9]\d+00")  # from a thousand on: a size that is told in hundreds
_IN_METRES = "_m"  # end of the name of a column that holds in metres what another does


def unit_of_data(layers: Iterable[Layer]) -> Unit | None:
    """The unit of lengths and heights of the first layer with a place; None of metres."""
    return unit_of_lengths(crs_of(layers))


def converted(value: Any, unit: str, own: Unit | None) -> tuple[Any, str]:
    """A number of a unit in that of the data, and its unit there; others as they are.

    Examples
    --------
    >>> value, unit = converted(9.290304, "m2", ("ft", 0.3048))
    >>> round(value, 9), unit
    (100.0, 'ft²')
    >>> converted(0.5, "1", ("ft", 0.3048)), converted(2.0, "m", None)
    ((0.5, '1'), (2.0, 'm'))
    """
    power, number = _POWERS.get(unit), isinstance(value, int | float | np.number)
    if own is None or power is None or not number or isinstance(value, bool):
        return value, unit
    return float(value) / own[1] ** power, _RAISED[power].format(own[0])


def in_both(text: str, own: Unit | None) -> str:
    """A text in the language of the user, its sizes in the unit of the data in brackets, too.

    Examples
    --------
    >>> in_both("216 of 491 m of its outline of 20 m2 (215 ft²)", ("ft", 0.3048))
    '216 of 491 m (709 of 1611 ft) of its outline of 20 m2 (215 ft²)'
    >>> in_both("-0.305 m at 3.1 to 12.5 m", ("ft", 0.3048))
    '-0.305 m (-1.00 ft) at 3.1 to 12.5 m (10.2 to 41.0 ft)'
    >>> in_both("about 61000 m2 of 61034 m2", ("ft", 0.3048))
    'about 61000 m2 (657000 ft²) of 61034 m2 (656965 ft²)'
    """
    if own is None:
        return text
    told = rf" \((?:{_SIZE}(?:{_BETWEEN}))?{_SIZE}[ /]*{re.escape(own[0])}"
    alone = rf"{_SAID}(?!{told})"
    return re.sub(alone, lambda found: found[0] + _in_brackets(found, own), language.told(text))


def _in_brackets(found: re.Match[str], own: Unit) -> str:
    """A size, or a part of one, or both ends of a range, in the unit of the data."""
    low, between, high, unit = found.groups()
    power = _POWERS[unit]
    ends = [
        _as_round(own_number(float(end.replace("\u2212", "-")), own, power, least=_least(end)), end)
        for end in (low, high)
        if end
    ]
    return f" ({(between or '').join(ends)} {_RAISED[power].format(own[0])})"


def _as_round(text: str, size: str) -> str:
    """A whole number with three digits that tell, where its size is as round."""
    if not (_ROUND.fullmatch(size) and text.lstrip("-").isdigit()):
        return text
    return f"{float(f'{int(text):.3g}'):.0f}"


def _least(size: str) -> int:
    exact, least = _EXACT
    return least if len(size.partition(".")[2]) >= exact else 0


def drawn_in(table: Table, shows: Sequence[Show], own: Unit | None) -> Shown:
    """A table and how it is drawn, in the unit of the data."""
    if own is None:
        return table, tuple(shows)
    if _is_in_metres(table.frame):
        table = Table(_from_metres(table.frame, own))
    return table, tuple(_axes(show, own) for show in shows)


def _axes(show: Show, own: Unit) -> Show:
    if not isinstance(show, Curve):
        return show
    lines = tuple(_axis(axis, own) for axis in show.lines)
    return replace(show, over=_axis(show.over, own), lines=lines)


def _axis(axis: Axis, own: Unit) -> Axis:
    factor, unit = (0.01, "m") if axis.unit == "cm" else (1.0, axis.unit)
    power = _POWERS.get(unit)
    if power is None:
        return axis
    unit = _RAISED[power].format(own[0])
    return replace(axis, unit=unit, factor=axis.factor * factor / own[1] ** power)


def _is_in_metres(frame: pd.DataFrame) -> bool:
    """Whether a table states in each row that its lengths are in metres, as bins of errors do."""
    return UNIT in frame and bool((frame[UNIT] == "m").all())


def _from_metres(frame: pd.DataFrame, own: Unit) -> pd.DataFrame:
    """Such a table in another unit."""
    name, metres = own
    lengths = {n: v / metres for n, v in frame.items() if v.dtype.kind == "f"}
    return frame.assign(**{str(n): v for n, v in lengths.items()}, **{UNIT: name})


def in_unit(sections: Sequence[Section], own: Unit | None) -> list[Section]:
    """Sections with their tables in the unit of the data; as they are for data in metres."""
    if own is None:
        return list(sections)
    return [replace(section, **_blocks(section, own)) for section in sections]


def _blocks(section: Section, own: Unit) -> dict[str, Any]:
    made: dict[str, Any] = {"blocks": [_block(block, own) for block in section.blocks]}
    if section.printed is not None:
        made["printed"] = [_block(block, own) for block in section.printed]
    return made


def _block(block: Block, own: Unit) -> Block:
    if not isinstance(block, Rows):
        return block
    frame = block.table.frame
    if (units := unit_column(frame)) is not None:
        return replace(block, table=Table(_measures(frame, units, own)))
    if _is_in_metres(frame):
        return replace(block, table=Table(_from_metres(frame, own)))
    columns = dict(block.columns) | dict(_columns(frame, block.columns, own))
    declared = block.columns.keys() & set(frame)  # people's own names may mean anything
    twice = [str(name) for name in frame if f"{name}{_IN_METRES}" in declared]
    columns |= {name: replace(columns[name + _IN_METRES], factor=1.0) for name in twice}
    without = [name + _IN_METRES for name in twice] + [UNIT for name in twice if UNIT in frame][:1]
    return replace(block, table=Table(frame.drop(columns=without)), columns=columns)


def _columns(
    frame: pd.DataFrame, declared: Mapping[str, Column], own: Unit
) -> Iterator[tuple[str, Column]]:
    """The columns that hold metres, in the unit of the data."""
    name, metres = own
    for label, values in frame.items():
        how = column_of(str(label), values, declared)
        power = _POWERS.get(how.unit)
        if power is None or values.dtype.kind != "f":  # whole numbers are shown as they are
            continue
        digits = declared[str(label)].digits if str(label) in declared else None
        more = _MORE.get(power, 0)
        yield (
            str(label),
            replace(
                how,
                unit=_RAISED[power].format(name),
                factor=how.factor / metres**power,
                digits=None if digits is None else digits + more,
            ),
        )


def _measures(frame: pd.DataFrame, units: Any, own: Unit) -> pd.DataFrame:
    """A table of measures, of which each row has its unit; texts, as settings are, stay."""
    import pandas as pd

    rows = [str(unit) for unit in frame[units]]
    both = {
        label: [converted(value, unit, own) for value, unit in zip(values, rows, strict=True)]
        for label, values in frame.items()
    }
    measured = next(pairs for label, pairs in both.items() if str(label).lower() == VALUE)
    made = {
        label: pd.Series([value for value, _ in pairs], frame.index, _type_of(frame[label]))
        for label, pairs in both.items()
    }
    made[units] = pd.Series([unit for _, unit in measured], frame.index)
    return pd.DataFrame(made)


def _type_of(values: pd.Series[Any]) -> Any:
    """The type of a column of numbers in another unit: whole ones need not be whole there."""
    return None if values.dtype.kind in "iu" else values.dtype
