"""The verb list: groups, a search, the width of the terminal; what no verb at all says."""

from __future__ import annotations

import json

import pytest

from toolbox.cli import listing
from toolbox.cli.main import main


def test_tools_stand_below_their_group(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert rows.index("surface") < next(k for k, row in enumerate(rows) if "surface.grid" in row)
    assert [row for row in rows if row and not row.startswith(" ")] == sorted(
        row for row in rows if row and not row.startswith(" ")
    )


def test_a_search_gives_what_speaks_of_all_words(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "DTM"]) == 0
    out = capsys.readouterr().out
    assert "models.terrain" in out
    assert "corridor.extract" not in out
    assert main(["list", "storage", "lake", "--json"]) == 0
    found = [tool["id"] for tool in json.loads(capsys.readouterr().out)]
    assert "models.reservoir_storage" in found
    assert "surface.grid" not in found


def test_one_and_several_are_the_same_word_which_begins_a_word() -> None:
    tools = [
        {"id": "a.b", "title": title, "description": "X.", "keywords": []}
        for title in ("Single tree", "All trees", "Streets", "Ağaç", "Length")
    ]
    for word, found in [
        ("trees", 2),
        ("tree", 2),
        ("ağaçlar", 1),
        ("street", 1),
        ("reet", 0),
        ("lens", 0),
    ]:
        assert len(listing.matching(tools, [word])) == found, word


def test_a_search_without_an_answer_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "submarine"]) == 2
    assert "no tool speaks of 'submarine'" in capsys.readouterr().err


def test_lines_fit_into_the_terminal() -> None:
    tool = {"id": "a.b", "title": "T", "description": "word " * 40, "keywords": []}
    told = list(listing.lines([tool], 80))
    assert max(map(len, told)) <= 80 < len(" ".join(told))
    assert " ".join(" ".join(told).split()).endswith(tool["description"].strip())
    assert max(map(len, listing.lines([tool], None))) > 100


def test_no_verb_says_how_to_begin(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    out = capsys.readouterr().out
    assert "python -m toolbox list" in out
    assert "models.terrain" in out
