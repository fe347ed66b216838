"""Ticks of axes in the language of the user."""

from __future__ import annotations

from typing import Any

from matplotlib.ticker import Formatter

from toolbox import language


class Said(Formatter):
    """The texts of another formatter, with the words and decimal sign of the user.

    Examples
    --------
    >>> from matplotlib.ticker import StrMethodFormatter
    >>> with language.speaking("tr"):
    ...     Said(StrMethodFormatter("{x}"))(2.5)
    '2,5'
    """

    def __init__(self, other: Formatter) -> None:
        self._other = other
        self.axis = other.axis

    def __call__(self, x: float, pos: int | None = None) -> str:
        return language.label(self._other(x, pos))

    def set_axis(self, axis: Any) -> None:
        super().set_axis(axis)
        self._other.set_axis(axis)

    def set_locs(self, locs: list[float]) -> None:
        self._other.set_locs(locs)

    def get_offset(self) -> str:
        return language.label(self._other.get_offset())
