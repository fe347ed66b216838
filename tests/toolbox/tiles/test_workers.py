"""Workers of a run in tiles: they listen nowhere, die one at a time, and end with us."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from multiprocessing.context import SpawnProcess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import psutil
import pytest
from scenes.layers import cloud

import toolbox
from toolbox.context import Context
from toolbox.errors import DataError, ParameterError
from toolbox.tiles.tiling import Tiling
from toolbox.tiles.workers import PATIENCE, Workers, _Process, processes, workers_of

GIB = 2**30


@pytest.fixture(scope="module")
def workers() -> Iterator[Workers]:
    with processes(2, GIB) as made:
        yield made


def scaled(factor: int, value: int) -> int:
    return factor * value


def process_of(shared: Any, *args: Any) -> tuple[int, int]:
    return os.getpid(), id(shared)


def fails(path: Path, times: int) -> str:
    """Fail so many times, counted in a file."""
    with path.open("a") as file:
        file.write("x")
    if len(path.read_text()) <= times:
        raise OSError("the disk is away")
    return "done"


def dies(shared: Any) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def needs(size: int) -> None:
    array = np.ones(size, np.uint8)
    time.sleep(60)
    del array


def cleared(size: int) -> int:
    """The pages that the system hands out for the last of three arrays of so many bytes."""
    import resource

    faults = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        np.full(size, 1, np.uint8)
        faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
    return faults[-1]


def frees(size: int) -> int:
    """Leave holes of a quarter of so many bytes, which no array fits in, and use a half."""
    pieces = [np.ones(2**20, np.uint8) for _ in range(size // 2 // 2**20)]
    del pieces[::2]
    array = np.ones(size // 2, np.uint8)
    time.sleep(1)
    return len(array) + len(pieces)


def maps(path: Path) -> int:
    """Look at all bytes of a file for a while."""
    mapped = np.memmap(path, np.uint8, "r")
    total = int(mapped.sum())
    time.sleep(1)
    return total


def sleeps(path: Path) -> None:
    path.touch()
    time.sleep(60)


def cannot_be_sent(shared: Any) -> Any:
    return threading.Lock()


def test_tasks_are_shared_among_processes(workers: Workers) -> None:
    factor = workers.share(3)
    assert [workers.submit(scaled, factor, k).result() for k in range(5)] == [0, 3, 6, 9, 12]
    large = workers.share(list(range(10_000)))
    found = {workers.submit(process_of, large).result() for _ in range(20)}
    assert os.getpid() not in dict(found)
    assert len(found) == len(dict(found)) <= 2  # each has unpacked the shared value once


@pytest.mark.skipif(sys.platform != "linux", reason="other C libraries cannot be told so")
def test_workers_keep_memory_for_the_next_array(workers: Workers) -> None:
    """More than 32 MB would be mapped anew each time, in pages of 4 kB to 2 MB that are cleared."""
    size = 100 * 2**20
    assert workers.submit(cleared, workers.share(size)).result() < 10


def test_a_run_in_tiles_listens_nowhere(tmp_path: Path) -> None:
    """A task is code: whoever could give one to a worker, could do all that the user can."""
    cloud(np.random.default_rng(1).uniform(0, 50, (500, 3))).save(tmp_path / "a.laz")
    seen: list[tuple[int, list[Any]]] = []

    def look(fraction: float) -> None:
        ours = [psutil.Process(), *psutil.Process().children(recursive=True)]
        sockets = [one for process in ours for one in process.net_connections()]
        seen.append((len(ours), [one for one in sockets if one.status == psutil.CONN_LISTEN]))

    values = {"points": tmp_path / "a.laz", "where": "z < 20", "kept": tmp_path / "b.laz"}
    how = {"tiling": Tiling(30.0, 2, 4 * GIB), "assume_crs": "EPSG:32635"}
    toolbox.run("points.filter", values, ctx=Context(look), **how)
    assert max(count for count, _ in seen) >= 3
    assert [sockets for _, sockets in seen if sockets] == []


def test_a_task_is_tried_twice(workers: Workers, tmp_path: Path) -> None:
    once, twice = (workers.share(tmp_path / name) for name in "ab")
    assert workers.submit(fails, once, 1).result() == "done"
    with pytest.raises(OSError, match="the disk is away"):
        workers.submit(fails, twice, 2).result()


def test_a_worker_that_dies_is_replaced(workers: Workers) -> None:
    deaths = [workers.submit(dies, workers.share(None)) for _ in range(3)]
    others = [workers.submit(scaled, workers.share(2), k) for k in range(6)]
    for future in deaths:
        with pytest.raises(DataError, match="its worker died, perhaps for want of memory"):
            future.result()
    assert [future.result() for future in others] == [0, 2, 4, 6, 8, 10]


def test_a_worker_that_needs_too_much_memory_is_stopped() -> None:
    problem = "take smaller tiles or more memory"
    with processes(1, 4 * 10**8) as workers, pytest.raises(DataError, match=problem):
        workers.submit(needs, workers.share(5 * 10**8)).result()


@pytest.mark.skipif(sys.platform != "linux", reason="memory is kept there only")
def test_memory_that_a_worker_has_freed_or_mapped_is_no_reason_to_stop_it(tmp_path: Path) -> None:
    """Of 800 MB and the libraries it has freed 200, and could drop 900 MB of a file any time."""
    size = 800 * 2**20
    with (tmp_path / "file").open("wb") as file:
        file.truncate(900 * 2**20)
    with processes(1, 800 * 2**20) as workers:
        assert workers.submit(frees, workers.share(size)).result() == size // 2 + size // 2**22
        assert workers.submit(maps, workers.share(tmp_path / "file")).result() == 0


def test_a_worker_that_hands_no_memory_back_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    """A loop may keep the thread from running that hands it back, and answers."""
    clock = [100.0]
    watch = SimpleNamespace(monotonic=lambda: clock[0])
    monkeypatch.setattr("toolbox.tiles.workers.time", watch)
    monkeypatch.setattr("toolbox.tiles.workers._used", lambda pid: GIB + 1)
    process = _Process(GIB, 1)
    process._request, _other_end = multiprocessing.Pipe()
    process._process = SimpleNamespace(pid=0)  # type: ignore[assignment]
    stops: list[float] = []
    monkeypatch.setattr(process, "stop", lambda: stops.append(clock[0]))
    for clock[0] in (100.0, 100.0 + PATIENCE - 0.1, 100.0 + PATIENCE + 0.1):
        process._check_memory()
    assert stops == [100.0 + PATIENCE + 0.1]


def test_what_cannot_be_sent_is_told(workers: Workers) -> None:
    with pytest.raises(RuntimeError, match="cannot pickle"):
        workers.submit(cannot_be_sent, workers.share(None)).result()


def test_tasks_are_stopped_at_once(workers: Workers, tmp_path: Path) -> None:
    paths = [tmp_path / str(k) for k in range(4)]
    futures = [workers.submit(sleeps, workers.share(path)) for path in paths]
    while not (paths[0].exists() and paths[1].exists()):
        time.sleep(0.01)
    workers.cancel(futures)
    for future in futures:
        with pytest.raises(CancelledError):
            future.result()
    assert [path.exists() for path in paths] == [True, True, False, False]
    assert workers.submit(scaled, workers.share(2), 2).result() == 4


SCRIPT = """
import os, sys, time
from toolbox.tiles.workers import processes

def sleeps(shared):
    print(os.getpid(), flush=True)
    time.sleep(60)

if __name__ == "__main__":
    with processes(1, 2**30) as workers:
        workers.submit(sleeps, workers.share(None)).result()
"""


@pytest.mark.slow
def test_workers_end_with_a_process_that_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE) as run:
        assert run.stdout is not None
        worker = psutil.Process(int(run.stdout.readline()))
        run.kill()
        assert worker.wait(10) is None or not worker.is_running()


@pytest.mark.slow
def test_a_script_that_starts_itself_again_is_told_so(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.replace('if __name__ == "__main__":', "if True:"))
    run = subprocess.run([sys.executable, script], check=False, capture_output=True, text=True)
    assert "DataError: the workers cannot be started" in run.stderr


@pytest.mark.slow
def test_a_cluster_of_the_user() -> None:
    from distributed import LocalCluster

    with (
        LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=1,
            threads_per_worker=1,
            dashboard_address=None,
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
        ) as cluster,
        workers_of(Tiling(None, 1, scheduler=cluster.scheduler_address)) as workers,
    ):
        factor = workers.share(3)
        assert [workers.submit(scaled, factor, k).result() for k in range(3)] == [0, 3, 6]
        workers.cancel([workers.submit(time.sleep, 60)])


@pytest.mark.slow
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense"])
def test_a_scheduler_that_is_not_there(address: str) -> None:
    with (
        pytest.raises(ParameterError, match="scheduler: cannot reach a Dask scheduler"),
        workers_of(Tiling(None, 1, scheduler=address)),
    ):
        pass


def test_a_process_may_be_stopped_while_it_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """As when a run is cancelled right after a worker has died."""
    begun, go = threading.Event(), threading.Event()
    start = SpawnProcess.start

    def slowly(self: SpawnProcess) -> None:
        begun.set()
        go.wait(10)
        start(self)

    monkeypatch.setattr(SpawnProcess, "start", slowly)
    process = _Process(10**9, 1)
    threads = [threading.Thread(target=process.start), threading.Thread(target=process.stop)]
    threads[0].start()
    begun.wait(10)
    threads[1].start()
    go.set()
    for thread in threads:
        thread.join(20)
    process._process.join(20)
    assert not process._process.is_alive()
