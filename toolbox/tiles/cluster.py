"""Workers for a run in tiles: local processes, or a Dask cluster of the user."""

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

MEMORY_SHARE = 0.8  # of the memory of this computer, for all workers together
CONNECT = 10  # seconds
WARNINGS = "PYTHONWARNINGS"
DASK = {
    "distributed.scheduler.allowed-failures": 1,
    "distributed.scheduler.worker-ttl": None,
    "distributed.worker.memory.spill": False,
    "distributed.comm.timeouts.connect": "10s",
}


def memory_of(tiling: Tiling) -> int:
    """Bytes that a worker may use: those of the option, or its share of this computer's memory."""
    from distributed.system import MEMORY_LIMIT

    return tiling.memory or int(MEMORY_SHARE * MEMORY_LIMIT / tiling.workers)


@contextmanager
def cluster(workers: int, memory: int) -> Iterator[str]:
    """Start local worker processes, and give the address of their scheduler.

    Parameters
    ----------
    memory : bytes per worker
    """
    import dask
    from distributed import LocalCluster

    threads = max(1, (os.cpu_count() or 1) // workers)  # of kernels, so that all cores are busy
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(DASK))
        folder = stack.enter_context(files.scratch())
        with _ignoring_interrupts(), _starting():
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
    """Give a Dask client of local processes, or of the scheduler that the user names."""
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
    """Report processes that die while they start as an error of data, not as a mistake of ours."""
    try:
        yield
    except RuntimeError as err:
        raise DataError(f"the workers cannot be started: {err}") from err


@contextmanager
def _ignoring_interrupts() -> Iterator[None]:
    """Keep Ctrl-C, which a terminal sends to all processes, from those that are started here.

    This process stops them. They inherit the signal mask of the thread that starts them. Python's
    resource tracker is started here too, and told not to warn of semaphores that are left over
    after a hard exit.
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
