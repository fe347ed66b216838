"""The verb that compiles ahead: which runs it does, and what it leaves."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from toolbox import catalog, execute
from toolbox.cli.main import main
from toolbox.context import Context, log
from toolbox.errors import DataError

Run = tuple[str, Mapping[str, Any]]


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[Run]:
    """The runs that are asked for, of which none is done."""
    found: list[Run] = []

    def run(id: str, values: Mapping[str, Any], *, ctx: Context) -> None:
        found.append((id, values))
        ctx.progress(1.0)

    monkeypatch.setattr(execute, "run", run)
    return found


def test_every_shipped_model_and_learning_is_run(
    runs: list[Run], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["warm"]) == 0
    assert capsys.readouterr().out.startswith("compiled in ")
    shipped = {id for id, path in catalog.own_files().items() if path.suffix == catalog.MODEL[0]}
    assert shipped | {"classify.train", "classify.apply"} <= {id for id, _ in runs}


def test_each_run_has_what_it_reads_and_leaves_nothing(runs: list[Run]) -> None:
    assert main(["warm", "--json"]) == 0
    made: set[Path] = set()
    for id, values in runs:
        spec = catalog.load(id)
        settings = {name: v for name, v in values.items() if name not in spec.outputs}
        present = settings.keys() & spec.sources.keys()
        parameters = {name: v for name, v in settings.items() if name not in present}
        assert not spec.parse(parameters, present=present)[1]
        assert {values[name] for name in present} <= made
        made |= {values[name] for name in values.keys() & spec.outputs.keys()}
    assert len({path.parent for path in made}) == 1
    assert not any(path.parent.exists() for path in made)


def test_messages_of_later_runs_are_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    levels = []

    def run(*_: Any, **__: Any) -> None:
        levels.append(log.level)
        raise DataError("no room")

    monkeypatch.setattr(execute, "run", run)
    assert main(["warm"]) == DataError.exit_code
    assert log.level < levels[0] == logging.ERROR
