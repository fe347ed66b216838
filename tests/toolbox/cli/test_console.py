"""What people see on a terminal: tables of its width, colours, the step that is worked on."""

from __future__ import annotations

import os
import pty
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pandas as pd
import pytest

from toolbox import language
from toolbox.cli.console import Console
from toolbox.cli.tables import fitted
from toolbox.context import log
from toolbox.data import Table

WIDTH = 60


@contextmanager
def terminal(**environment: str) -> Iterator[list[str]]:
    """Standard error as a terminal; the list holds what was written there, once it is closed."""
    ours, theirs = pty.openpty()
    pieces: list[bytes] = []
    text: list[str] = []

    def read() -> None:
        with suppress(OSError):  # that nobody writes there any more
            while piece := os.read(ours, 1000):
                pieces.append(piece)

    reader = threading.Thread(target=read)
    reader.start()
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("NO_COLOR", raising=False)
        for name, value in {"TERM": "xterm", **environment}.items():
            patch.setenv(name, value)
        with os.fdopen(theirs, "w", buffering=1) as stream:
            patch.setattr(sys, "stderr", stream)
            yield text
    reader.join()
    os.close(ours)
    text.append(b"".join(pieces).decode().replace("\r\n", "\n"))


def test_warnings_and_errors_have_colours_on_a_terminal() -> None:
    with terminal() as shown:
        console = Console()
        log.warning("the lake is dark")
        log.info("five lakes")
        console.error(ValueError("no lake"))
    assert "\x1b[33mwarning:\x1b[0m the lake is dark" in shown[0]
    assert "\x1b[1;31merror:\x1b[0m ValueError: no lake" in shown[0]
    assert "\nfive lakes" in shown[0]


@pytest.mark.parametrize("environment", [{"NO_COLOR": "1"}, {"TERM": "dumb"}])
def test_colours_are_left_out_where_nobody_wants_them(environment: dict[str, str]) -> None:
    with terminal(**environment) as shown:
        Console().message("warning", "the lake is dark")
    assert shown[0].strip() == "warning: the lake is dark"


def test_a_file_gets_no_colours(capsys: pytest.CaptureFixture[str]) -> None:
    Console().message("warning", "the lake is dark")
    assert capsys.readouterr().err == "warning: the lake is dark\n"


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (KeyError("x"), "KeyError: 'x'\nBu, araç kutusundaki bir hatad\u0131r. --verbose ile"),
        (
            OSError(28, "No space left"),
            "okunam\u0131yor ya da yaz\u0131lam\u0131yor: No space left",
        ),
    ],
)
def test_a_mistake_of_the_toolbox_is_told_in_the_language_of_the_user(
    error: Exception, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was English for all."""
    with language.speaking("tr"):
        Console().error(error)
    assert told in capsys.readouterr().err
    Console().error(error)
    told = capsys.readouterr().err
    assert ("This is a mistake in the toolbox." in told) != ("cannot read or write: " in told)


def test_the_progress_bar_names_the_step() -> None:
    with terminal(COLUMNS="120") as shown:
        console = Console()
        with console.progress() as report:
            console.stage("Step ground: Classify ground [fast]")
            report(0.5)
    assert "Step ground: Classify ground [fast]" in shown[0]


def wide() -> pd.DataFrame:
    numbers = {f"measure_{k}": [k + 0.25, k + 0.5] for k in range(9)}
    frame = pd.DataFrame({"class": ["ground", "water"], **numbers})
    frame["measure_0_low"], frame["measure_0_high"] = [0.2, 0.4], [0.3, float("nan")]
    return frame.assign(meaning="a text so long that it must go on in another line of the terminal")


def test_tables_fit_the_width_of_a_terminal() -> None:
    lines = fitted(wide(), WIDTH).splitlines()
    assert max(map(len, lines)) <= WIDTH
    assert sum(line.startswith("class") for line in lines) == 3
    assert any("0.25 (0.2 to 0.3)" in line for line in lines)
    words = " ".join(fitted(wide(), WIDTH).split())
    for k in range(9):
        assert f"measure_{k} " in words
    assert "_low" not in words
    assert "so long that" in words


def test_limits_by_blocks_are_told_from_others() -> None:
    frame = pd.DataFrame({"kappa": [0.7], "kappa_low": [0.6], "kappa_high": [0.8]})
    frame = frame.assign(right=[81.0], right_block_low=[75.0], right_block_high=[87.0])
    text = fitted(frame, WIDTH)
    assert "0.7 (0.6 to 0.8)" in text
    assert "81 (75 to 87 by blocks)" in text


def test_a_wide_row_is_shown_upright() -> None:
    lines = fitted(wide().iloc[:1], WIDTH).splitlines()
    assert lines[0].split() == ["class", "ground"]
    assert lines[2].split() == ["measure_1", "1.25"]


def test_a_table_that_fits_stays_in_one_piece() -> None:
    frame = pd.DataFrame({"level": [1.5, 2.5], "area": [10, 200]})
    assert fitted(frame, WIDTH).splitlines() == ["level  area", "  1.5    10", "  2.5   200"]


@pytest.mark.parametrize("level", ["normal", "verbose"])
def test_of_several_tables_the_first_is_printed(
    level: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Comparisons printed four tables, and the figures of the first once more among them."""
    table = Table(pd.DataFrame({"measure": ["bias", "rmse"], "value": [0.1, 0.2]}))
    Console(level).result({"id": "a.b", "outputs": {}}, {"table": table, "covers": table, "n": 2})
    said = capsys.readouterr().out
    assert said.startswith("table:\nmeasure  value\nbias       0.1\n")
    line = "covers: table, not printed (--covers PATH, or --verbose)\nn: 2\n"
    assert said.endswith(line) == (level == "normal")
    assert said.count("bias") == (1 if level == "normal" else 2)


def test_limits_that_are_not_known_are_not_printed() -> None:
    """A class without a limit ended compare.classes with a message of Python."""
    frame = pd.DataFrame({"f1": [1.0, 0.5], "f1_low": [None, 0.4], "f1_high": [None, 0.6]})
    assert fitted(frame.astype(object), WIDTH).splitlines()[1:] == [
        "1",
        "0.5 (0.4 to 0.6)",
    ]


def test_a_long_table_is_cut_and_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(pd.DataFrame({"row": range(33)}))
    Console().result({"id": "a.b", "outputs": {}}, {"histogram": table})
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2:] == [" 29", "... 3 more rows (all: --histogram PATH)"]
    Console(as_json=True).result({"id": "a.b", "outputs": {}}, {"histogram": table})
    assert '"row": 32' in capsys.readouterr().out
