"""What a run gives to Python: a dict that shows what is in it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from textwrap import shorten
from types import MappingProxyType
from typing import Any

from toolbox import language
from toolbox.data.report import unit_text
from toolbox.declare.fields import Spec
from toolbox.errors import UnknownResult, nearest
from toolbox.reports.words import value_text

_LONGEST = 80  # characters of a text that is a result
_COUNTED = {
    "PointCloud": lambda: language.text("points: {count}"),
    "Vector": lambda: language.text("features: {count}"),
}
NO_SIZES: Mapping[str, int | None] = MappingProxyType({})
_SHOWN = 3  # results of a repeated step


class Results(dict[str, Any]):
    """The results of a run by name, which may also be read as attributes.

    It is a dict like any other, and shows one line for each result. A name that is no word, such as
    that of the output of a step (``ground.classified``), or that of a method of dict, is read with
    brackets.

    Parameters
    ----------
    values : the results by name
    tool : the id of what was run
    units : of numbers, by name
    help : what each result is, by name
    counts : of the layers that are written, their points or features in words, by name

    Raises
    ------
    UnknownResult
        There is no result of that name: a KeyError, and an AttributeError.

    Examples
    --------
    >>> made = Results({"kept": 40, "share": 0.8}, tool="points.filter", units={"share": "1"})
    >>> made
    <Results of points.filter>
      kept: 40
      share: 0.8
    >>> made.kept == made["kept"]
    True
    >>> made["shares"]
    Traceback (most recent call last):
    toolbox.errors.UnknownResult: points.filter has no result 'shares', only kept, share; did you \
mean 'share'?
    """

    __slots__ = ("_counts", "_help", "_tool", "_units")

    def __init__(
        self,
        values: Mapping[str, Any] | Iterable[tuple[str, Any]] = (),
        *,
        tool: str = "",
        units: Mapping[str, str] | None = None,
        help: Mapping[str, str] | None = None,
        counts: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(values)
        self._counts = dict(counts or {})
        self._tool, self._units, self._help = tool, dict(units or {}), dict(help or {})

    @classmethod
    def of(
        cls, spec: Spec, values: Mapping[str, Any], sizes: Mapping[str, int | None] = NO_SIZES
    ) -> Results:
        """The results of a tool or model, with the units and the help of its declaration.

        Parameters
        ----------
        sizes : of the layers, also of those whose result is the path of a file, by name
        """
        fields = {name: spec.results[name] for name in values if name in spec.results}
        units = {name: field.unit for name, field in fields.items() if field.unit}
        counts = {
            name: _COUNTED[field.kind.word]().format(count=sizes[name])
            for name, field in fields.items()
            if field.kind.word in _COUNTED and sizes.get(name) is not None
        }
        help = {name: field.help for name, field in fields.items()}
        return cls(values, tool=spec.id, units=units, help=help, counts=counts)

    def counted(self, name: str) -> str:
        """The points or features of a layer in words, also if it is in a file; "" if not known."""
        return self._counts.get(name, "")

    def __missing__(self, name: str) -> Any:
        raise UnknownResult(self._unknown(name))

    def __getattr__(self, name: str) -> Any:
        """A result; called for what is no attribute of a dict."""
        if name.startswith("_"):  # asked for by copy, pickle and notebooks
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return self[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *filter(str.isidentifier, self)]

    def _unknown(self, name: str) -> str:
        listed = ", ".join(self) or "none"
        return f"{self._tool} has no result {name!r}, only {listed}{nearest(str(name), self)}"

    def __repr__(self) -> str:
        lines = [f"  {name}: {self._text(name)}" for name in self]
        return "\n".join([f"<Results of {self._tool}>", *lines])

    def _text(self, name: str) -> str:
        """A result in one line, with its unit."""
        return _text(self[name], self._units.get(name))

    def _repr_html_(self) -> str:
        """What a notebook shows: a small table of the results."""
        rows = "".join(
            f"<tr><th>{escape(name)}</th><td>{escape(self._text(name))}</td>"
            f"<td>{escape(self._help.get(name, ''))}</td></tr>"
            for name in self
        )
        return f"<table><caption>{escape(self._tool)}</caption>{rows}</table>"


def _text(value: Any, unit: str | None) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value_text(value, unit)} {unit_text(unit)}".rstrip()
    if isinstance(value, tuple):  # from a repeated step
        texts = [_text(item, unit) for item in value[:_SHOWN]]
        more = [f"and {len(value) - _SHOWN} more"] if len(value) > _SHOWN else []
        return ", ".join([*texts, *more]) or "none"
    return shorten(str(value), _LONGEST, placeholder=" ...")
