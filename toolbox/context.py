"""The context of a run: progress, cancellation, log, and the window of the result."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from toolbox.errors import Cancelled

log = logging.getLogger("toolbox")


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


@contextmanager
def listening() -> Iterator[list[str]]:
    """The warnings that are logged meanwhile, which belong to the result.

    Examples
    --------
    >>> with listening() as warnings:
    ...     log.warning("the sea is at %s m", 0.2)
    >>> warnings
    ['the sea is at 0.2 m']
    """
    texts: list[str] = []
    ear = logging.Handler(logging.WARNING)
    ear.emit = lambda record: texts.append(record.getMessage())  # type: ignore[method-assign]
    log.addHandler(ear)
    try:
        yield texts
    finally:
        log.removeHandler(ear)


QUIET = Context()  # reports nothing, and is never cancelled
