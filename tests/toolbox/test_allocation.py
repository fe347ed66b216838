"""Memory that a command keeps; what that does is tested with workers."""

from __future__ import annotations

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
kept = [[] for _ in range(50_000)]
print(gc.get_stats()[0]["collections"] - before)
"""
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "0\n"
