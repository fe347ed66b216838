"""Runs side by side: all of them, their errors, and their end."""

from __future__ import annotations

import threading
import time
from typing import Any

import numba
import numpy as np
import pytest

from algorithms.shared.kernels.threads import side_by_side
from toolbox.context import Context
from toolbox.errors import Cancelled

RUNS = [(0, 3), (3, 4), (4, 10)]


def test_every_run_gets_its_turn() -> None:
    counts, seen = np.zeros(10), []

    def add(first: int, last: int, height: float) -> None:
        counts[first:last] += height

    side_by_side(add, RUNS, 2.5, ctx=Context(seen.append))
    np.testing.assert_array_equal(counts, 2.5)
    assert seen == [1 / 3, 2 / 3, 1]
    side_by_side(add, [], 2.5)


def test_a_single_run_needs_no_thread() -> None:
    seen: list[Any] = []
    side_by_side(lambda *_: seen.append(threading.current_thread()), RUNS[:1])
    assert seen == [threading.current_thread()]


@pytest.mark.skipif(numba.get_num_threads() < 2, reason="one thread only")
def test_runs_do_not_wait_for_each_other() -> None:
    meeting = threading.Barrier(2)
    side_by_side(lambda *_: meeting.wait(10) and None, [(0, 1), (1, 2)])


def test_an_error_ends_it() -> None:
    done = []

    def fail_at_first(first: int, last: int) -> None:
        if first == 0:
            raise ZeroDivisionError
        time.sleep(0.001)
        done.append(first)

    with pytest.raises(ZeroDivisionError):
        side_by_side(fail_at_first, [(k, k + 1) for k in range(1000)])
    assert len(done) < 500


def test_cancelling_ends_it() -> None:
    done = []

    def work(first: int, last: int) -> None:
        time.sleep(0.001)
        done.append(first)

    with pytest.raises(Cancelled):
        side_by_side(work, [(k, k + 1) for k in range(1000)], ctx=Context(stop=lambda: True))
    assert 0 < len(done) < 500
