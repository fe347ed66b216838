"""Optional libraries: what is said where one of them, or of the system, is not there."""

import pytest

from toolbox.data import extras
from toolbox.data.extras import Extra


def test_a_library_of_the_system_that_is_not_there_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def loads(name: str) -> None:
        print(f"{name} explains at length")  # noqa: T201
        raise OSError("cannot load library 'libpango-1.0-0'")

    monkeypatch.setattr(extras, "import_module", loads)
    paper = Extra("Paper", "json", "Pango, of the system: install it")
    assert paper.missing() == "Paper needs Pango, of the system: install it"
    assert Extra("Paper", "json").missing() is None, "which needs nothing of the system"
    assert capsys.readouterr().out == ""


def test_a_library_that_is_not_there_is_told() -> None:
    text = "Paper needs no_such_library: pip install no_such_library"
    assert Extra("Paper", "no_such_library", "Pango").missing() == text
