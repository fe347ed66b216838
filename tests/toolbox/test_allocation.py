"""Memory that a command keeps; what that does is tested with workers."""

from __future__ import annotations

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
