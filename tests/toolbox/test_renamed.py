"""Old names of tools and parameters go on working, with a warning."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

import toolbox
from toolbox import catalog, renamed
from toolbox.cli.main import main
from toolbox.data import PointCloud
from toolbox.errors import ParameterError

UNTIL = "2099-01"
TABLE = {
    "tools": {"points.pick": {"now": "points.filter", "until": UNTIL}},
    "parameters": {
        "points.filter": {
            "categories": {"now": "classes", "until": UNTIL},
            "cloud_in": {"now": "points", "until": UNTIL},
            "result": {"now": "kept", "until": UNTIL},
        }
    },
}
MODEL = """
id: models.old
title: Old names
summary: A model from before the names changed
help: It goes on working.
inputs:
  points: {type: PointCloud, help: Points}
steps:
  pick: {tool: points.pick, cloud_in: {from: inputs.points}, categories: 2}
outputs:
  kept: {from: pick.kept, help: Points of ground}
"""


@pytest.fixture(autouse=True)
def old_names(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(renamed, "table", lambda: TABLE)
    return


@pytest.fixture
def points(tmp_path: Path) -> Path:
    columns = {"classification": np.array([2, 5, 2], np.uint8)}
    path = tmp_path / "a.laz"
    PointCloud(np.zeros((3, 3)), columns, crs=CRS(32635)).save(path)
    return path


def test_old_names_work_on_the_command_line_and_are_warned_of(
    points: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "b.laz"
    argv = ["run", "points.pick", "--cloud-in", str(points), "--categories=2"]
    assert main([*argv, "--kept", str(out)]) == 0
    assert len(PointCloud.open(out)) == 2
    said = capsys.readouterr().err
    assert f"points.pick is now called points.filter; the old name works until {UNTIL}" in said
    assert "points.filter: categories is now called classes" in said


def test_old_names_work_in_python_and_are_warned_of(
    points: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "toolbox"):
        kept = toolbox.run("points.pick", {"cloud_in": points, "categories": "2"})["kept"]
    assert len(kept) == 2
    assert "points.filter: cloud_in is now called points" in caplog.text


def test_old_names_work_in_models(points: Path, tmp_path: Path) -> None:
    model = tmp_path / "old.yaml"
    model.write_text(MODEL)
    assert len(toolbox.run(str(model), {"points": points})["kept"]) == 2


def test_an_old_and_a_new_name_together_are_an_error(points: Path) -> None:
    with pytest.raises(ParameterError, match="categories: is the old name of classes, which"):
        toolbox.run("points.filter", {"points": points, "classes": "2", "categories": "2"})


def test_options_of_a_layer_keep_their_names() -> None:
    said = ["--cloud_in.columns=x,y,z", "--where", "z > 2"]
    assert renamed.words("points.filter", said) == ["--points.columns=x,y,z", "--where", "z > 2"]


def test_the_table_that_is_shipped_leads_to_names_that_are_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.undo()
    table = renamed.table()
    ids = catalog.own_ids()
    for old, entry in table["tools"].items():
        assert old not in ids
        assert entry["now"] in ids
    for id, names in table["parameters"].items():
        spec = catalog.load(id)
        assert {
            entry["now"] for entry in names.values()
        } <= spec.inputs.keys() | spec.outputs.keys()
        assert not names.keys() & (spec.inputs.keys() | spec.outputs.keys())
    entries = [
        *table["tools"].values(),
        *(e for n in table["parameters"].values() for e in n.values()),
    ]
    assert all(re.fullmatch(r"\d{4}-\d{2}", entry["until"]) for entry in entries)
