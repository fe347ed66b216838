"""The options of a run in tiles: size, workers, memory and scheduler."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from toolbox.errors import ParameterError

BYTES = {"": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9, "tb": 10**12}
BYTES |= {"kib": 2**10, "mib": 2**20, "gib": 2**30, "tib": 2**40}
MEMORY_SHARE = 0.8  # of the memory of this computer, for all workers together

LEAST = 5 * 10**8  # bytes for each worker: what its libraries and a small tile need
MOST = 10**15  # bytes: more are taken for a mistake
MOST_WORKERS = 1024


@dataclass(frozen=True)
class Tiling:
    """The size of the tiles of a survey, and the workers that process them.

    Attributes
    ----------
    size : side of a tile, metres; None to choose one that suits the memory
    workers : number of processes
    memory : bytes for all workers together; None for most of the memory of this computer
    scheduler : address of a Dask scheduler to use instead of local processes
    """

    size: float | None
    workers: int
    memory: int | None = None
    scheduler: str | None = None

    @classmethod
    def parse(cls, given: Mapping[str, Any]) -> Tiling | None:
        """Read the options tile, workers, memory and scheduler; None without the option tile.

        Raises
        ------
        ParameterError
            A value has no meaning, or is given without `tile`.
        """
        problems: dict[str, str] = {}
        if given.get("tile") is None:
            for name in ("workers", "memory", "scheduler"):
                if given.get(name) is not None:
                    problems[name] = "is for runs in tiles; say --tile too"
            if problems:
                raise ParameterError("run", problems)
            return None
        size = _number("tile", given["tile"], problems, auto=True)
        memory = _memory(given.get("memory"), problems)
        workers = _number("workers", given.get("workers") or _usual(memory), problems)
        if workers is not None and not (workers.is_integer() and workers <= MOST_WORKERS):
            text = f"must be a whole number up to {MOST_WORKERS}, got {given['workers']}"
            problems["workers"] = text
        elif workers is not None and memory is not None and memory < workers * LEAST:
            problems["memory"] = _too_little(int(workers), given["memory"])
        if size is None and given.get("scheduler") and not given.get("workers"):
            problems.setdefault(
                "workers", "say how many the scheduler has: with --tile auto they share the memory"
            )
        if problems:
            raise ParameterError("run", problems)
        assert workers is not None
        return cls(size, int(workers), memory, given.get("scheduler"))


def memory_of(tiling: Tiling) -> int:
    """Bytes that one worker may use: its share of those of the option, or of this computer's.

    Raises
    ------
    ParameterError
        It is less than a worker needs.
    """
    memory = tiling.memory or _of_computer()
    if memory < tiling.workers * LEAST:
        text = _too_little(tiling.workers, f"{memory / 1e9:.1f} GB")
        raise ParameterError("run", {"memory": text})
    return memory // tiling.workers


def _of_computer() -> int:
    """Bytes of this computer that all workers may use together."""
    from distributed.system import MEMORY_LIMIT

    return int(MEMORY_SHARE * MEMORY_LIMIT)


def _too_little(workers: int, memory: str) -> str:
    return f"must be at least 500 MB for each worker, and {workers} share {memory}"


def _number(name: str, value: Any, problems: dict[str, str], *, auto: bool = False) -> float | None:
    if auto and str(value) == "auto":
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = float("nan")
    if not 0 < number < float("inf"):
        problems[name] = f"must be a number > 0{' or auto' if auto else ''}, got {value!r}"
        return None
    return number


def _usual(memory: int | None) -> int:
    """One worker for each core, but no more than the memory is enough for."""
    return max(1, min(os.cpu_count() or 1, (memory or _of_computer()) // LEAST))


def _memory(value: Any, problems: dict[str, str]) -> int | None:
    """Read a number of bytes from a text such as 4GB."""
    if value is None:
        return None
    match = re.fullmatch(r"\s*([\d.]+)\s*([a-z]*)\s*", str(value).lower())
    try:
        found = float(match[1]) * BYTES[match[2]] if match else 0
    except (ValueError, KeyError):
        found = 0
    if not LEAST <= found <= MOST:
        problems["memory"] = f"must be 500MB to 1000TB, such as 4GB, got {str(value)[:40]!r}"
        return None
    return int(found)
