"""Tables of measures: a quantity in each row, with a value, often its interval, and its unit."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

VALUE, UNIT = "value", "unit"
_DIGITS = {"m": 3, "ft": 3, "m2": 2, "ft2": 2, "m3": 1, "ft3": 1, "%": 2, "deg": 4, "points": 0}
_DIGITS |= {"ft²": 2, "ft³": 1, "US ft": 3, "US ft²": 2, "US ft³": 1}
ROUNDED = "m2", "m3"  # units of results that are rounded where they are large
TENTHS = 100  # from there on
TELLING = 4  # digits of numbers in other units, and of ratios
_OF_INTERVAL = 2  # digits of the width of an interval, so that its limits differ
_MOST = 8  # digits after the point: a double has no more of a coordinate


def unit_column(frame: pd.DataFrame) -> Any:
    """The name of the column with the unit of each row; None of a table that is none of measures.

    Examples
    --------
    >>> import pandas as pd
    >>> unit_column(pd.DataFrame({"measure": ["bias"], "value": [0.1], "unit": ["m"]}))
    'unit'
    >>> unit_column(pd.DataFrame({"level": [500.0], "unit": ["metre"]})) is None
    True
    """
    names = {str(name).lower(): name for name in frame}
    return names.get(UNIT) if VALUE in names else None


def row_digits(frame: pd.DataFrame) -> list[int] | None:
    """Digits after the point for the numbers of each row of a table of measures; None for others.

    They follow the unit of the row, and are no fewer than its interval needs. Counts, which are
    whole numbers of the unit "1", have none.
    """
    units = unit_column(frame)
    if units is None:
        return None
    rows = frame.drop(columns=units).to_numpy(object)
    return [digits_of(_numbers(row), unit) for row, unit in zip(rows, frame[units], strict=True)]


def _numbers(cells: Iterable[Any]) -> list[float]:
    return [
        float(cell)
        for cell in cells
        if isinstance(cell, float | np.floating) and math.isfinite(cell)
    ]


def digits_of(values: list[float], unit: object) -> int:
    """Digits after the point for a value and the limits of its intervals, all in one unit.

    Examples
    --------
    >>> digits_of([0.0353], "m"), digits_of([40.0], "1"), digits_of([0.4695, 0.41, 0.53], "1")
    (3, 0, 4)
    >>> digits_of([0.00042, 0.00040, 0.00044], "m")
    6

    A large area or volume that was rounded has none:

    >>> digits_of([5043.0], "m2"), digits_of([5042.73], "m2"), digits_of([0.0], "m2")
    (0, 2, 2)
    """
    if not values:
        return 0
    usual = _DIGITS.get(str(unit))
    whole = all(value == round(value) for value in values)
    if whole and unit in ROUNDED and max(map(abs, values)) >= TENTHS:
        usual = 0
    if usual is None:
        usual = 0 if whole else telling(max(map(abs, values)), TELLING)
    width = max(values) - min(values)
    needed = telling(width, _OF_INTERVAL) if width else 0
    return min(max(usual, needed), _MOST)


def telling(size: float, digits: int) -> int:
    """Digits after the point so that a number of this size has so many that tell something."""
    return max(digits - 1 - math.floor(math.log10(size)), 0) if size else 0
