"""Workers for a run in tiles: processes of this computer, or a Dask cluster of the user.

The processes of this computer hear of their tasks through pipes that only this process holds. They
listen nowhere, so that no other account of the computer can give them any.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any, Protocol

import psutil

from toolbox.allocation import give_back, keep_memory
from toolbox.errors import DataError, ParameterError
from toolbox.tiles.tiling import Tiling, memory_of

CONNECT = 10  # seconds
PULSE = 0.1  # seconds between two looks at the memory of a worker
PATIENCE = 5.0  # seconds for handing memory back: a loop over millions of points may hold it up
TRIES = 2  # of a task: its input may be on a disk that is away for a moment
DIED = "its worker died, perhaps for want of memory; take smaller tiles or more memory"
WARNINGS = "PYTHONWARNINGS"


class Workers(Protocol):
    """What a run in tiles asks of its workers."""

    def share(self, value: Any) -> Any:
        """Hand a value to all workers, once; what is given back stands for it in `submit`."""

    def submit(self, task: Callable[..., Any], shared: Any, *args: Any) -> Any:
        """Have a worker run task(value, *args), and once more if that fails; gives a future."""

    def cancel(self, futures: Iterable[Any]) -> None:
        """Stop tasks, also those that run."""


@contextmanager
def workers_of(tiling: Tiling) -> Iterator[Workers]:
    """Give processes of this computer, or the workers of the scheduler that the user names."""
    if tiling.scheduler is None:
        with processes(tiling.workers, memory_of(tiling)) as made:
            yield made
        return
    from distributed import Client

    try:
        client = Client(tiling.scheduler, timeout=CONNECT)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as err:
        text = f"cannot reach a Dask scheduler at {tiling.scheduler}: {err}"
        raise ParameterError("run", {"scheduler": text}) from None
    with client:
        yield _Cluster(client)


class _Cluster:
    """The workers of a Dask scheduler."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def share(self, value: Any) -> Any:
        return self._client.submit(_same, value, pure=False)

    def submit(self, task: Callable[..., Any], shared: Any, *args: Any) -> Any:
        return self._client.submit(task, shared, *args, pure=False, retries=TRIES - 1)

    def cancel(self, futures: Iterable[Any]) -> None:
        self._client.cancel(list(futures), force=True)


def _same(value: Any) -> Any:
    return value


# Processes of this computer -----------------------------------------------------------------------


@contextmanager
def processes(count: int, memory: int) -> Iterator[Workers]:
    """Start worker processes; they end with the block, or when this process is killed.

    Parameters
    ----------
    memory : bytes that each may use; one that uses more, freed memory not counted, is stopped

    Raises
    ------
    DataError
        They cannot be started.
    """
    threads = max(1, (os.cpu_count() or 1) // count)  # of kernels, so that all cores are busy
    made = [_Process(memory, threads) for _ in range(count)]
    _start_resource_tracker()
    with ExitStack() as stack:
        for process in made:
            process.start()
            stack.callback(process.stop)
        for process in made:
            process.wait()
        pool = stack.enter_context(ThreadPoolExecutor(count))
        yield _Processes(made, pool)


class _Processes:
    """Gives each task to a process that has nothing to do."""

    def __init__(self, made: list[_Process], pool: ThreadPoolExecutor) -> None:
        self._all, self._pool = made, pool
        self._idle: queue.SimpleQueue[_Process] = queue.SimpleQueue()
        for process in made:
            self._idle.put(process)
        self._stopping = threading.Event()

    def share(self, value: Any) -> Any:
        return pickle.dumps(value, protocol=5)

    def submit(self, task: Callable[..., Any], shared: Any, *args: Any) -> Future[Any]:
        return self._pool.submit(self._run, task, shared, args)

    def cancel(self, futures: Iterable[Any]) -> None:
        futures = list(futures)
        self._stopping.set()
        for future in futures:
            future.cancel()
        for process in self._all:
            process.stop()
        wait(futures)
        self._stopping.clear()

    def _run(self, task: Callable[..., Any], shared: bytes, args: tuple[Any, ...]) -> Any:
        process = self._idle.get()
        try:
            for left in reversed(range(TRIES)):
                try:
                    return process.run(task, shared, args)
                except Exception:
                    if self._stopping.is_set():
                        raise CancelledError from None
                    if not left:
                        raise
        finally:
            self._idle.put(process)


class _Process:
    """A process that runs one task at a time; after its death another takes its place."""

    def __init__(self, memory: int, threads: int) -> None:
        self._memory, self._threads = memory, threads
        self._known: bytes | None = None  # the shared value that it has
        self._asked: float | None = None  # when it was asked to hand back memory
        self._lock = threading.Lock()  # held by whoever starts or ends it

    def start(self) -> None:
        """Start it; `wait` waits until it is there."""
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe()
        self._request, request = context.Pipe()
        with self._lock, _ignoring_interrupts():
            args = other, request, self._threads
            self._process = context.Process(target=_serve, args=args, daemon=True)
            self._process.start()
        self._known, self._asked = None, None
        other.close()
        request.close()

    def wait(self) -> None:
        """Wait until it is there.

        Raises
        ------
        DataError
            It has died while it started.
        """
        try:
            self._pipe.recv()
        except (EOFError, OSError):
            raise DataError("the workers cannot be started") from None

    def stop(self) -> None:
        """End it, whatever it does."""
        with self._lock:
            self._process.kill()

    def run(self, task: Callable[..., Any], shared: bytes, args: tuple[Any, ...]) -> Any:
        """Run task(value, *args) in it.

        Raises
        ------
        DataError
            It has died, or needed too much memory.
        Exception
            What the task has raised.
        """
        if not self._process.is_alive():
            self.start()
            self.wait()
        try:
            self._pipe.send((None if shared is self._known else shared, task, args))
            self._known = shared
            while not self._pipe.poll(PULSE):
                self._check_memory()
            found, error = self._pipe.recv()
        except (EOFError, OSError):
            self._process.join()
            raise DataError(DIED) from None
        if error is not None:
            raise error
        return found

    def _check_memory(self) -> None:
        """Have it hand back what it keeps if it uses too much; end it if that is not enough."""
        answered = self._request.poll()
        waited = self._asked is not None and time.monotonic() - self._asked > PATIENCE
        too_much = _used(self._process.pid) > self._memory  # after the answer, if there is one
        if answered:
            self._request.recv()
            self._asked = None
        if too_much and (answered or waited):
            self.stop()
        elif too_much and self._asked is None:
            self._request.send(None)
            self._asked = time.monotonic()


def _used(process: int | None) -> int:
    """Bytes that are a process's own: pages of files that it has mapped can be dropped any time."""
    with suppress(psutil.NoSuchProcess):
        info = psutil.Process(process).memory_info()
        return int(info.rss - getattr(info, "shared", 0))
    return 0


def _serve(pipe: Connection, request: Connection, threads: int) -> None:
    """Run tasks until the pipe ends; the life of a worker process."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    threading.Thread(target=_give_back, args=(request,), daemon=True).start()
    keep_memory()
    os.environ["NUMBA_NUM_THREADS"] = str(threads)
    pipe.send(None)
    value: Any = None
    answer: tuple[Any, Exception | None]
    while True:
        try:
            shared, task, args = pipe.recv()
            value = value if shared is None else pickle.loads(shared)
            answer = task(value, *args), None
        except EOFError:
            return
        except Exception as err:  # noqa: BLE001  raised again where the task was given
            answer = None, err
        try:
            pipe.send(answer)
        except Exception as err:  # noqa: BLE001  what cannot be sent, can be told
            pipe.send((None, RuntimeError(f"{answer[1]!r}: {err}")))


def _give_back(request: Connection) -> None:
    """Hand back freed memory whenever that is asked for."""
    with suppress(EOFError, OSError):
        while True:
            request.recv()
            give_back()
            request.send(None)


def _end_with_parent() -> None:
    """End this process as soon as that is gone which has started it, also if that was killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _start_resource_tracker() -> None:
    """Start Python's resource tracker, and tell it not to warn of what a hard exit leaves over."""
    from multiprocessing import resource_tracker

    before = {name: value for name, value in os.environ.items() if name == WARNINGS}
    os.environ[WARNINGS] = "ignore:resource_tracker"
    resource_tracker.ensure_running()
    del os.environ[WARNINGS]
    os.environ.update(before)


@contextmanager
def _ignoring_interrupts() -> Iterator[None]:
    """Keep Ctrl-C, which a terminal sends to all processes, from those that are started here.

    This process stops them. They inherit the signal mask of the thread that starts them.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
