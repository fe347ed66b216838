"""The context of a run: progress, cancellation, log, and the window of the result."""

from __future__ import annotations

import functools
import hashlib
import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

from toolbox.errors import Cancelled

if TYPE_CHECKING:
    from numpy.typing import NDArray

log = logging.getLogger("toolbox")
Value = TypeVar("Value")
_NAMES: ContextVar[Mapping[str, str] | None] = ContextVar("names", default=None)


@dataclass(frozen=True)
class Context:
    """Takes the progress of a run, and says whether it should stop.

    Parameters
    ----------
    report : called with the fraction done, 0..1
    stop : returns True once the user has cancelled the run
    window : xmin, ymin, xmax, ymax in the unit of the coordinates; outside it the result is not
        needed. In a tile of a survey it is the extent of the points. A tool may ignore it.
    stage : called with a text when another step or tile is worked on
    kept : values that steps of one run share, by name, each with what it was made from, see
        :meth:`once`; None where nothing is kept

    Examples
    --------
    >>> seen = []
    >>> ctx = Context(report=seen.append)
    >>> ctx.progress(0.25)
    >>> ctx.part(0.5, 1.0).progress(0.5)
    >>> seen
    [0.25, 0.75]
    """

    report: Callable[[float], None] = lambda fraction: None
    stop: Callable[[], bool] = lambda: False
    window: tuple[float, float, float, float] | None = None
    stage: Callable[[str], None] = lambda text: None
    kept: dict[str, tuple[bytes, Any]] | None = None

    def progress(self, fraction: float) -> None:
        """Report the fraction done, 0..1, and stop here if the user has cancelled the run.

        Raises
        ------
        Cancelled
            The user asked the run to stop.
        """
        if self.stop():
            raise Cancelled
        self.report(fraction)

    def part(self, start: float, end: float) -> Context:
        """The context of one stage, whose progress 0..1 is that of the run from start to end."""
        return replace(self, report=lambda f: self.report(start + f * (end - start)))

    def keeping(self) -> Context:
        """The same, for a run of several steps that share what they need alike."""
        return self if self.kept is not None else replace(self, kept={})

    def once(self, name: str, inputs: tuple[Any, ...], make: Callable[[], Value]) -> Value:
        """A value that several steps of a run need, made by the first of them.

        The last value of each name is kept until the run ends: memory does not grow with the
        number of steps. Do not change it in place.

        Parameters
        ----------
        name : of the value
        inputs : all that it depends on, see :func:`digest`; of a large array that serves several
            values the digest is made once, see :class:`Digested`
        make : makes the value

        Examples
        --------
        >>> import numpy as np
        >>> ctx, made = Context().keeping(), []
        >>> for heights in (np.zeros(3), np.zeros(3), np.ones(3)):
        ...     top = ctx.once("top", (heights,), lambda: made.append("made") or heights.max())
        >>> made, top
        (['made', 'made'], np.float64(1.0))
        """
        if self.kept is None:
            return make()
        of = digest(*inputs)
        if name not in self.kept or self.kept[name][0] != of:
            self.kept.pop(name, None)  # before there is another, which may be as large
            self.kept[name] = of, make()
        value: Value = self.kept[name][1]
        return value


class Digested:
    """An array that nobody changes, and its digest, made when it is first asked for.

    Parameters
    ----------
    array : of any shape

    Examples
    --------
    >>> import numpy as np
    >>> digest(Digested(np.zeros(3))) == digest(Digested(np.zeros(3)))
    True
    """

    def __init__(self, array: NDArray[Any]) -> None:
        self.array = array

    @functools.cached_property
    def digest(self) -> bytes:
        """See the function of that name."""
        return digest(self.array)


def digest(*inputs: Any) -> bytes:
    """Digest of arrays by their content, and of values that their text tells apart, as numbers.

    Examples
    --------
    >>> import numpy as np
    >>> digest(np.zeros(3), 1.0) == digest(np.zeros(3), 1.0), digest(1) == digest(1.0)
    (True, False)
    """
    import numpy as np  # here, as lists and helps of tools need none

    made = hashlib.sha256()  # for which processors have instructions of their own
    for value in inputs:
        if isinstance(value, Digested):
            made.update(value.digest)
        elif isinstance(value, np.ndarray):
            made.update(f"{value.dtype.str}{value.shape}".encode())
            made.update(np.ascontiguousarray(value).data)
        else:
            made.update(f"{type(value).__name__} {value!r};".encode())
    return made.digest()


@contextmanager
def settings_named(names: Mapping[str, str]) -> Iterator[None]:
    """Say that a step of a model runs, whose settings the user gives by other names, or not at all.

    Parameters
    ----------
    names : inputs of the model by the setting of the step that each is handed on to

    Examples
    --------
    >>> with settings_named({"cell": "size"}):
    ...     setting_name("cell")
    'size'
    """
    outer = _NAMES.get()
    own = names if outer is None else {n: outer[m] for n, m in names.items() if m in outer}
    token = _NAMES.set(own)
    try:
        yield
    finally:
        _NAMES.reset(token)


def setting_name(setting: str) -> str | None:
    """The name by which the user gives a setting of the running tool; None where nobody can.

    A message that says what to do names no other settings.

    Examples
    --------
    >>> setting_name("classes")
    'classes'
    >>> with settings_named({"classes": "ground_classes"}):
    ...     setting_name("classes"), setting_name("level_alone")
    ('ground_classes', None)
    """
    names = _NAMES.get()
    return setting if names is None else names.get(setting)


@contextmanager
def listening(*, aloud: bool = True) -> Iterator[list[str]]:
    """The warnings that are logged meanwhile, which belong to the result.

    Where nothing else takes them, as in a script, they are printed on standard error. If they are
    not told `aloud`, nothing beyond the logger of the toolbox hears them.

    Examples
    --------
    >>> with listening() as warnings:
    ...     log.warning("the sea is at %s m", 0.2)
    >>> warnings
    ['the sea is at 0.2 m']
    """
    texts: list[str] = []
    # A handler, as the ear is one, silences the printing that logging does where there is none.
    last = logging.lastResort if aloud and not log.hasHandlers() else None

    def emit(record: logging.LogRecord) -> None:
        texts.append(record.getMessage())
        if last:
            last.handle(record)

    ear = logging.Handler(logging.WARNING)
    ear.emit = emit  # type: ignore[method-assign]
    log.addHandler(ear)
    before, log.propagate = log.propagate, log.propagate and aloud
    try:
        yield texts
    finally:
        log.removeHandler(ear)
        log.propagate = before


QUIET = Context()  # reports nothing, and is never cancelled
