"""How a survey is to be run in tiles, as a user says it."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from toolbox.errors import ParameterError

UNITS = {"": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9, "kib": 2**10, "mib": 2**20, "gib": 2**30}

LEAST, MOST = 5 * 10**8, 10**15  # bytes for a worker: what its libraries need, and a mistake
MOST_WORKERS = 1024


@dataclass(frozen=True)
class Tiling:
    """How a survey is cut, and who works on it.

    Attributes
    ----------
    size : of a tile, metres; None for one that suits the memory
    workers : processes
    memory : bytes that each of them may use; None for an equal share of what there is
    scheduler : address of a Dask scheduler to use instead of processes of our own
    """

    size: float | None
    workers: int
    memory: int | None = None
    scheduler: str | None = None

    @classmethod
    def parse(cls, given: Mapping[str, Any]) -> Tiling | None:
        """The options tile, workers, memory and scheduler; None unless tiles are asked for.

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
        workers = _number("workers", given.get("workers") or os.cpu_count(), problems)
        memory = _memory(given.get("memory"), problems)
        if workers is not None and not (workers.is_integer() and workers <= MOST_WORKERS):
            text = f"must be a whole number up to {MOST_WORKERS}, got {given['workers']}"
            problems["workers"] = text
        if problems:
            raise ParameterError("run", problems)
        assert workers is not None
        return cls(size, int(workers), memory, given.get("scheduler"))


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


def _memory(value: Any, problems: dict[str, str]) -> int | None:
    """Bytes, from a text such as 4GB."""
    if value is None:
        return None
    match = re.fullmatch(r"\s*([\d.]+)\s*([a-z]*)\s*", str(value).lower())
    try:
        found = float(match[1]) * UNITS[match[2]] if match else 0
    except (ValueError, KeyError):
        found = 0
    if not LEAST <= found <= MOST:
        problems["memory"] = f"must be at least 500 MB, such as 4GB, got {str(value)[:40]!r}"
        return None
    return int(found)
