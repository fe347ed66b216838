"""Running kernels in several threads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numba

from toolbox.context import QUIET, Context


def side_by_side(
    kernel: Callable[..., object],
    runs: Sequence[tuple[int, int]],
    *arguments: Any,
    ctx: Context = QUIET,
) -> None:
    """Call ``kernel(first, last, *arguments)`` for all runs in threads, as many as numba may use.

    Numba's own way, `parallel`, makes a kernel take several times as long to compile.

    Parameters
    ----------
    kernel : compiled with `nogil`; runs must neither depend on each other nor write to the same
        places, so that the answer is the same for any number of threads
    runs : see :func:`algorithms.shared.lowest.blocks`
    arguments : what else the kernel takes
    ctx : progress and cancellation, after each run
    """
    threads = min(numba.get_num_threads(), len(runs))
    if threads <= 1:  # starting a thread takes longer than most single runs
        for done, run in enumerate(runs):
            kernel(*run, *arguments)
            ctx.progress((done + 1) / len(runs))
        return
    pool = ThreadPoolExecutor(threads)
    try:
        for done, _ in enumerate(pool.map(lambda run: kernel(*run, *arguments), runs)):
            ctx.progress((done + 1) / len(runs))
    finally:
        pool.shutdown(cancel_futures=True)


def in_blocks(
    work: Callable[[int, int], object], total: int, length: int, ctx: Context = QUIET
) -> None:
    """Call work(first, last) in threads, for runs of `length` out of `total` items."""
    length = max(1, length)
    runs = [(first, min(first + length, total)) for first in range(0, total, length)]
    side_by_side(work, runs, ctx=ctx)
