"""What all measurements share: clocks, commands, the folder of data."""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("TOOLBOX_TEST_DATA", ROOT.parent / "shared" / "data"))
ROUNDS = 7
FEW = int(os.environ.get("LIDAR_ROUNDS", "3"))  # of what takes minutes
# Peak of this process in KiB; ru_maxrss would hand on the peak of the parent.
PEAK = "next(int(l.split()[1]) for l in open('/proc/self/status') if l.startswith('VmHWM'))"


def say(text: str) -> None:
    sys.stdout.write(text + "\n")


def timed(work: Callable[[], Any], clock: Callable[[], float] = time.perf_counter) -> float:
    start = clock()
    work()
    return clock() - start


def alternately(
    ours: Callable[[], Any],
    theirs: Callable[[], Any],
    rounds: int = ROUNDS,
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[float, float]:
    """Medians of both, after one round that is not counted."""
    pairs = [(timed(ours, clock), timed(theirs, clock)) for _ in range(rounds + 1)][1:]
    return tuple(statistics.median(column) for column in zip(*pairs, strict=True))  # type: ignore[return-value]


@contextmanager
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def toolbox(*arguments: Any) -> dict[str, Any]:
    """Run the command line in a process of its own; the result as JSON, the seconds and MiB."""
    command = [sys.executable, "-m", "toolbox", *map(str, arguments)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    seconds = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    found: dict[str, Any] = {"code": done.returncode, "error": done.stderr, "seconds": seconds}
    found["cpu"] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return found | (json.loads(done.stdout) if done.stdout.startswith("{") else {})


def command_seconds(command: list[Any]) -> float:
    """Processor time of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(list(map(str, command)), check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
