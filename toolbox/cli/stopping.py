"""Runs a job so that Ctrl-C, SIGTERM or the end of a pipe stops it within a second.

The job runs in a thread of its own while the main thread waits, because Python delivers signals to
the main thread only, and only between two Python instructions. So a compiled library that releases
the interpreter lock does not delay Ctrl-C. One that holds the lock does, and tools call such
libraries in blocks of a fraction of a second.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import IO, Generic, TypeVar

from toolbox import files
from toolbox.context import Context
from toolbox.errors import Cancelled

T = TypeVar("T")
GRACE = 0.7  # seconds that a job has to stop before the process ends


class _Job(threading.Thread, Generic[T]):
    """A thread that keeps the result or the error of its work."""

    def __init__(self, work: Callable[[], T]) -> None:
        super().__init__(daemon=True)
        self.work = work
        self.result: T
        self.error: BaseException | None = None

    def run(self) -> None:
        try:
            self.result = self.work()
        except BaseException as err:  # noqa: BLE001  handed to the main thread, which raises it
            self.error = err


def stoppable(
    work: Callable[[Context], T],
    report: Callable[[float], None],
    pipe: IO[bytes] | None = None,
    farewell: Callable[[], object] = lambda: None,
    stage: Callable[[str], None] = lambda text: None,
) -> T:
    """Return the result of work(ctx), or stop it.

    Parameters
    ----------
    work : runs in another thread, with a context that says when to stop
    report : called with the fraction done
    pipe : its end stops the job; for programs that keep our standard input open
    farewell : called before the process ends because a job does not stop
    stage : called with a text when another step or tile is worked on

    Raises
    ------
    Cancelled
        The job was stopped and has removed its temporary files. If it does not stop within
        `GRACE` seconds, these are removed here, and the process ends with exit code 130.
    """
    stop = threading.Event()
    if pipe:
        threading.Thread(target=_wait_for_end, args=(pipe, stop), daemon=True).start()
    job = _Job(lambda: work(Context(report, stop.is_set, stage=stage)))
    with _signals_set(stop):
        job.start()
        asked: float | None = None
        while job.is_alive():
            job.join(0.05)
            if stop.is_set():
                asked = asked or time.monotonic()
                if time.monotonic() - asked > GRACE:
                    files.discard_unfinished()
                    _within(0.2, farewell)  # nobody may read what it prints
                    os._exit(Cancelled.exit_code)
    if job.error:
        raise job.error
    return job.result


def _within(seconds: float, work: Callable[[], object]) -> None:
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(seconds)


def _wait_for_end(pipe: IO[bytes], stop: threading.Event) -> None:
    # Past Python's buffer, whose lock would be held when the interpreter ends.
    while os.read(pipe.fileno(), 4096):
        pass
    stop.set()


@contextmanager
def _signals_set(stop: threading.Event) -> Iterator[None]:
    """Let Ctrl-C, SIGTERM and a closed terminal set the event; restore the handlers afterwards."""

    def ask(number: int, frame: FrameType | None) -> None:
        stop.set()

    names = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    old = {number: signal.signal(number, ask) for number in map(signal.Signals.__getitem__, names)}
    try:
        yield
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)
