"""Memory that a command keeps; what that does is tested with workers."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import NoReturn

import pytest

from toolbox import __main__


class Kept(Exception):
    """Memory is kept."""


def test_a_command_keeps_its_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def kept() -> NoReturn:
        raise Kept

    monkeypatch.setattr(__main__, "keep_memory", kept)
    with pytest.raises(Kept):
        __main__.run()


def test_what_a_command_loads_is_not_searched_for_circles() -> None:
    code = """
import gc
from toolbox.allocation import keep_memory
keep_memory()
before = gc.get_stats()[0]["collections"]
kept = [[] for _ in range(200_000)]
print(gc.get_stats()[0]["collections"] - before)
"""
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "0\n"


def test_a_command_ends_without_a_search_for_circles() -> None:
    code = """
import atexit, gc, sys
atexit.register(lambda: print(gc.get_freeze_count() > 0))
sys.argv[1:] = ["list"]
from toolbox.__main__ import run
run()
"""
    said = subprocess.check_output([sys.executable, "-c", code], text=True).splitlines()
    assert said[-1] == "True"


def test_linear_algebra_of_a_command_starts_no_threads() -> None:
    code = """
import os, sys
import toolbox.__main__
print("numpy" in sys.modules, os.environ["OPENBLAS_NUM_THREADS"])
"""
    others = {name: v for name, v in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    said = subprocess.check_output([sys.executable, "-c", code], text=True, env=others)
    assert said == "False 1\n"
