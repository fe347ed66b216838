"""What a running tool may talk to: progress, cancellation, log; and where its result is needed."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

from toolbox.errors import Cancelled

log = logging.getLogger("toolbox")


@dataclass(frozen=True)
class Context:
    """Where a run reports its progress and learns that it should stop.

    Parameters
    ----------
    report : called with the fraction done, 0..1
    stop : True once the user has cancelled
    window : xmin, ymin, xmax, ymax in the unit of the coordinates, beyond which nothing of the
        result is needed: in a tile of a survey, that of its points. A tool need not look at it.
    """

    report: Callable[[float], None] = lambda fraction: None
    stop: Callable[[], bool] = lambda: False
    window: tuple[float, float, float, float] | None = None

    def progress(self, fraction: float) -> None:
        """Report 0..1 and stop here if the user cancelled: one call, never forgotten.

        Raises
        ------
        Cancelled
            The user asked the run to stop.
        """
        if self.stop():
            raise Cancelled
        self.report(fraction)

    def part(self, start: float, end: float) -> Context:
        """The share of this context, from start to end, that one stage may report into."""
        return replace(self, report=lambda f: self.report(start + f * (end - start)))


QUIET = Context()  # nobody listens, nobody cancels
