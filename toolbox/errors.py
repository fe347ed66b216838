"""The errors of the toolbox: one exception per cause, with an exit code of the command line."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Self


class ToolboxError(Exception):
    """Base of all errors that a user can correct; the text says all without a traceback.

    Examples
    --------
    >>> print(ToolboxError("ground.csf", {"cell": "must be > 0 m, got -1"}))
    ground.csf: 1 problem
      cell: must be > 0 m, got -1
    """

    exit_code = 1

    def __init__(self, where: str, problems: Mapping[str, str] | None = None) -> None:
        self.where, self.problems = where, dict(problems or {})
        super().__init__(where, self.problems)

    def named(self, where: str) -> Self:
        """The same error under the name of a tool, or of a step of a model."""
        if self.problems:
            return type(self)(where, self.problems)
        return type(self)(f"{where}: {self.where}")

    def __str__(self) -> str:
        """The name of the tool or file, and all problems, one per line."""
        if not self.problems:
            return self.where
        lines = [f"  {name}: {text}" for name, text in self.problems.items()]
        many = "problem" if len(lines) == 1 else "problems"
        return "\n".join([f"{self.where}: {len(lines)} {many}", *lines])


class ParameterError(ToolboxError, ValueError):
    """One or more values do not fit a tool's declaration.

    Examples
    --------
    >>> raise ParameterError("ground.csf: unknown parameter 'cel'")
    Traceback (most recent call last):
    toolbox.errors.ParameterError: ground.csf: unknown parameter 'cel'
    """

    exit_code = 2


class DataError(ToolboxError, ValueError):
    """A file cannot be read, or holds what a tool cannot use.

    Examples
    --------
    >>> print(DataError("there is no ground").named("surface.grid"))
    surface.grid: there is no ground
    """

    exit_code = 3


class UnknownResult(ToolboxError, KeyError, AttributeError):
    """A run has no result of that name.

    Examples
    --------
    >>> print(UnknownResult("surface.grid has no result 'dtm', only 'surface'"))
    surface.grid has no result 'dtm', only 'surface'
    """


class NothingToDo(DataError):
    """The data contain nothing that the tool can process.

    For a whole survey this is an error. For a tile, which may lie in a lake, the result is
    `instead`; with None there is no layer.

    Examples
    --------
    >>> NothingToDo("all points are ignored", instead="an empty layer").instead
    'an empty layer'
    """

    def __init__(
        self, where: str, problems: Mapping[str, str] | None = None, *, instead: Any = None
    ) -> None:
        super().__init__(where, problems)
        self.instead = instead

    def named(self, where: str) -> Self:
        made = super().named(where)
        made.instead = self.instead
        return made


class MemoryShort(DataError, MemoryError):
    """A run needs more memory than there is.

    Examples
    --------
    >>> print(MemoryShort("the cells need 40 GB").named("surface.grid"))
    surface.grid: the cells need 40 GB
    """


class Cancelled(ToolboxError):
    """The user asked the run to stop.

    Examples
    --------
    >>> raise Cancelled
    Traceback (most recent call last):
    toolbox.errors.Cancelled: cancelled
    """

    exit_code = 130

    def __init__(self, where: str = "cancelled", problems: Mapping[str, str] | None = None) -> None:
        super().__init__(where, problems)


@contextmanager
def memory_named() -> Iterator[None]:
    """Turn the error of a library that got no memory into one that says what may help.

    Raises
    ------
    MemoryShort
        Of another MemoryError inside this context.

    Examples
    --------
    >>> with memory_named():
    ...     raise MemoryError
    Traceback (most recent call last):
    toolbox.errors.MemoryShort: not enough memory; use a larger cell, tiles, or a part of the data
    """
    try:
        yield
    except ToolboxError:
        raise
    except MemoryError as error:
        said = f" ({error})" if str(error) else ""
        text = f"not enough memory{said}; use a larger cell, tiles, or a part of the data"
        raise MemoryShort(text) from error


def nearest(name: str, known: Iterable[Any]) -> str:
    """Say '; did you mean ...?' with the known name that is closest, or nothing.

    Examples
    --------
    >>> nearest("cel", ["cell", "slope"])
    "; did you mean 'cell'?"
    """
    close = difflib.get_close_matches(name, [str(k) for k in known], n=1)
    return f"; did you mean {close[0]!r}?" if close else ""
