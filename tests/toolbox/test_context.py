"""What the steps of a run share: made once for the same inputs, anew for others, never too long."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest

from toolbox import context
from toolbox.context import QUIET, Context, Digested, listening, log

HEIGHTS = np.arange(6.0)


def kept(*runs: tuple[Any, ...], ctx: Context) -> list[tuple[Any, ...]]:
    """The inputs for which a value was made."""
    made: list[tuple[Any, ...]] = []
    for inputs in runs:
        ctx.once("top", inputs, lambda inputs=inputs: made.append(inputs))
    return made


def test_equal_content_is_made_once() -> None:
    ctx = Context().keeping()
    assert len(kept((HEIGHTS, 1.0), (HEIGHTS.copy(), 1.0), ctx=ctx)) == 1
    later = ctx.part(0.5, 1.0).keeping()  # a model within a model shares with it
    assert kept((HEIGHTS, 1.0), ctx=later) == []


@pytest.mark.parametrize(
    "other",
    [
        (np.nextafter(HEIGHTS, 9.0), 1.0),
        (HEIGHTS[::-1], 1.0),
        (HEIGHTS.reshape(2, 3), 1.0),
        (HEIGHTS.view(np.int64), 1.0),
        (HEIGHTS, 1),
        (HEIGHTS, 2.0),
        (HEIGHTS,),
    ],
)
def test_other_inputs_are_told_apart(other: tuple[Any, ...]) -> None:
    assert len(kept((HEIGHTS, 1.0), other, (HEIGHTS, 1.0), ctx=Context().keeping())) == 3


def test_the_digest_of_a_large_array_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    whole = context.digest
    monkeypatch.setattr(context, "digest", lambda *given: made.append(given) or whole(*given))
    ctx, heights = Context().keeping(), Digested(HEIGHTS)
    for name in ("top", "edge"):
        ctx.once(name, (heights, 1.0), lambda: None)
    assert sum(given[0] is HEIGHTS for given in made) == 1
    assert (
        len(kept((heights,), (Digested(HEIGHTS.copy()),), (Digested(HEIGHTS + 1),), ctx=ctx)) == 2
    )
    QUIET.once("top", (other := Digested(HEIGHTS),), lambda: None)
    assert "digest" not in vars(other)  # where nothing is kept, nobody asks


def test_only_the_last_of_a_name_is_kept() -> None:
    ctx = Context().keeping()
    ctx.once("planes", (1,), lambda: "planes of 1")
    kept((1,), (2,), ctx=ctx)
    assert sorted(ctx.kept or ()) == ["planes", "top"]


def test_nothing_is_kept_where_no_steps_share() -> None:
    assert len(kept((1,), (1,), ctx=QUIET)) == 2
    assert QUIET.kept is None


@pytest.mark.parametrize("someone_listens", [False, True])
def test_warnings_of_a_script_are_printed_once(
    someone_listens: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(log, "propagate", False)
    monkeypatch.setattr(log, "handlers", [logging.NullHandler()] if someone_listens else [])
    with listening() as model, listening() as step:  # steps run within models
        log.warning("the sea is at %s m", 0.2)
    assert model == step == ["the sea is at 0.2 m"]
    assert capsys.readouterr().err == ("" if someone_listens else "the sea is at 0.2 m\n")


def test_warnings_that_are_not_told_aloud_are_heard_here_alone(
    caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    with listening(aloud=False) as worker:
        log.warning("the sea is at %s m", 0.2)
    assert worker == ["the sea is at 0.2 m"]
    assert not caplog.messages
    assert capsys.readouterr().err == ""
    log.warning("the sea is at 0.3 m")
    assert caplog.messages == ["the sea is at 0.3 m"]
