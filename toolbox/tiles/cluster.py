"""Who does the work of a run in tiles: processes of our own, or a Dask cluster of the user."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from toolbox import files
from toolbox.errors import DataError, ParameterError
from toolbox.tiles.tiling import Tiling

SHARE = 0.8  # of the memory that all workers together may use
CONNECT = 10  # seconds
WARNINGS = "PYTHONWARNINGS"
DASK = {
    "distributed.scheduler.allowed-failures": 1,
    "distributed.scheduler.worker-ttl": None,
    "distributed.worker.memory.spill": False,
    "distributed.comm.timeouts.connect": "10s",
}


def memory_of(tiling: Tiling) -> int:
    """Bytes that a worker may use: most of what this computer or container has, unless said."""
    from distributed.system import MEMORY_LIMIT

    return tiling.memory or int(SHARE * MEMORY_LIMIT / tiling.workers)


@contextmanager
def cluster(workers: int, memory: int) -> Iterator[str]:
    """Processes of our own that wait for work; gives the address of their scheduler.

    Parameters
    ----------
    memory : bytes that each may use
    """
    import dask
    from distributed import LocalCluster

    threads = max(1, (os.cpu_count() or 1) // workers)  # of kernels, so that all cores are busy
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(DASK))
        folder = stack.enter_context(files.scratch())
        with _deaf_children(), _starting():
            made = stack.enter_context(
                LocalCluster(  # type: ignore[no-untyped-call]
                    n_workers=workers,
                    threads_per_worker=1,
                    memory_limit=memory,
                    dashboard_address=None,
                    scheduler_kwargs={"dashboard_address": ":0"},  # of a server there is anyway
                    local_directory=folder,
                    env={"NUMBA_NUM_THREADS": str(threads)},
                    silence_logs=logging.CRITICAL,
                )
            )
        yield str(made.scheduler_address)


@contextmanager
def client_of(tiling: Tiling) -> Iterator[Any]:
    """Who gives work to processes of our own, or to those of the user's scheduler."""
    from distributed import Client

    with ExitStack() as stack:
        address = tiling.scheduler
        if address is None:
            address = stack.enter_context(cluster(tiling.workers, memory_of(tiling)))
        try:
            client = Client(address, timeout=CONNECT)  # type: ignore[no-untyped-call]
        except (OSError, ValueError) as err:
            text = f"cannot reach a Dask scheduler at {address}: {err}"
            raise ParameterError("run", {"scheduler": text}) from None
        yield stack.enter_context(client)


@contextmanager
def _starting() -> Iterator[None]:
    """Tell a user, and not of a mistake in the toolbox, if processes die while they start."""
    try:
        yield
    except RuntimeError as err:
        raise DataError(f"the workers cannot be started: {err}") from err


@contextmanager
def _deaf_children() -> Iterator[None]:
    """Let processes that are started here not hear Ctrl-C, which a terminal sends to all.

    It is for us to stop them. They inherit the mask of signals of the thread that starts them.
    The process of Python that looks after semaphores is started here too, told not to complain of
    those that it clears away after a hard exit.
    """
    from multiprocessing import resource_tracker

    before = {name: value for name, value in os.environ.items() if name == WARNINGS}
    os.environ[WARNINGS] = "ignore:resource_tracker"
    resource_tracker.ensure_running()  # first, for it lets the signal through again
    del os.environ[WARNINGS]
    os.environ.update(before)
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
