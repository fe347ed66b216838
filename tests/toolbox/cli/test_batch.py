"""batch: one run per row, a table of results, failures that do not stop the rest."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import CRS

from toolbox import catalog
from toolbox.cli import batch
from toolbox.cli.main import main
from toolbox.context import Context
from toolbox.data import PointCloud, Raster
from toolbox.errors import Cancelled, ParameterError

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def _history(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TOOLBOX_HISTORY", str(tmp_path / "history.jsonl"))
    monkeypatch.chdir(tmp_path)
    for name, size in (("a.laz", 100), ("b.laz", 200)):
        xyz = np.random.default_rng(size).uniform(0, 10, (size, 3))
        classes = {"classification": np.resize(np.array([1, 2], np.uint8), size)}
        PointCloud(xyz, classes, crs=CRS(32635)).save(tmp_path / name)


def table(text: str) -> str:
    Path("table.csv").write_text(text, "utf-8")
    return "table.csv"


def rows(path: str = "out.csv") -> list[dict[str, str]]:
    with Path(path).open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_run_per_row(capsys: Capture) -> None:
    name = table("points,cell,surface\na.laz,2,a.tif\nb.laz,,b.tif\n\n")
    assert main(["batch", "surface.grid", name, "--method", "mean", "--result", "out.csv"]) == 0
    assert [Raster.open(p).cell for p in ("a.tif", "b.tif")] == [2.0, 1.0]
    first, second = rows()
    assert list(first)[:6] == ["points", "cell", "surface", "status", "message", "seconds"]
    assert (first["points"], first["status"], first["message"]) == ("a.laz", "done", "")
    assert float(first["filled_share"]) == 0.92
    assert second["cell"] == ""
    assert float(second["seconds"]) >= 0
    told = capsys.readouterr()
    assert "result: out.csv" in told.out
    assert "row 2 of 2: done" in told.err
    runs = [json.loads(line) for line in Path("history.jsonl").read_text().splitlines()]
    assert [run["id"] for run in runs] == ["surface.grid"] * 2


def test_a_row_that_fails_does_not_stop_the_rest(capsys: Capture) -> None:
    Path("bad.laz").write_bytes(b"nothing")
    name = table("points,cell,classes\nno.laz,1,\nbad.laz,1,\na.laz,-1,\na.laz,1,9\na.laz,1,2\n")
    assert main(["batch", "surface.grid", name, "--result", "out.csv"]) == 3
    found = rows()
    assert [row["status"] for row in found] == ["failed"] * 4 + ["done"]
    for row, text in zip(
        found,
        [
            "there is no file no.laz",
            "bad.laz",
            "cell: must be > 0 and <= 10000 m, got -1.0",
            "none is",
            "",
        ],
        strict=True,
    ):
        assert text in row["message"]
        assert "\n" not in row["message"]
    assert "failed: 4" in capsys.readouterr().out


def test_mistakes_of_ours_are_a_message_too(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = made("points\na.laz", lambda values, ctx: 1 / 0)
    runs.go(Context())
    assert runs.done[0]["message"] == "ZeroDivisionError: division by zero"
    assert runs.failed == 1


def made(text: str, run: Any = None, **more: Any) -> batch.Batch:
    described = catalog.describe("surface.grid")
    file = Path(table(text))
    return batch.Batch("surface.grid", described, file, {}, run or (lambda v, c: {}), **more)


@pytest.mark.parametrize(
    ("text", "options", "problem"),
    [
        ("pints,cell\na.laz,1", [], "pints: is no column; did you mean 'points'?"),
        ("points,points.colums\na.laz,x", [], "points.colums: is no column; did you mean"),
        ("points,filled_share\na.laz,1", [], "filled_share: is no column"),
        ("points,surface\na.laz,s.tif\nb.laz,./s.tif", [], "rows: 2 of them write"),
        ("points,cell\na.laz,1", ["--cell", "2"], "cell: stands in the table and in the command"),
        ("points\na.laz\nb.laz", ["--surface", "s.tif"], "surface: would be written by each row"),
        ("points,points\na,b", [], "column 'points' is empty or twice"),
        ("points,\na,b", [], "column '' is empty or twice"),
        ("points\na,b", [], "['a', 'b'] has more cells than the 1 column"),
        ("points\n", [], "table.csv has no rows"),
        ("", [], "table.csv has no rows"),
        ('points\n"a', [], "table.csv cannot be read: unexpected end of data"),
        ("points\na.laz", ["--result", "table.csv", "--overwrite"], "is also an input"),
        ("points\na.laz", ["--result", "a.laz"], "result: cannot write .laz"),
        ("points\na.laz", ["--result", "no/r.csv"], "result: there is no folder"),
        ("points\na.laz", ["--page", "p.html"], "page: would be written by each row"),
        ("points\na.laz", ["--cel", "2"], "cel: unknown parameter; did you mean 'cell'?"),
    ],
)
def test_what_is_wrong_is_said_before_anything_runs(
    text: str, options: list[str], problem: str, capsys: Capture
) -> None:
    code = main(["batch", "surface.grid", table(text), *options])
    told = "".join(capsys.readouterr())
    assert problem in told
    assert code == 2
    assert not Path("history.jsonl").exists()
    assert Path("table.csv").read_text() == text


def test_tables_that_cannot_be_read(capsys: Capture) -> None:
    assert main(["batch", "surface.grid", "no.csv"]) == 2
    Path("binary.csv").write_bytes(b"\xff\xfe")
    assert main(["batch", "surface.grid", "binary.csv"]) == 2
    assert main(["batch", "surface.grid"]) == 2
    assert main(["batch"]) == 2
    told = capsys.readouterr().err
    for text in (
        "no.csv cannot be read",
        "binary.csv cannot be read",
        "which table?",
        "which tool?",
    ):
        assert text in told


def test_semicolons_between_cells_and_several_values_in_one() -> None:
    name = table('﻿points;cell\n"a.laz;b.laz";5\n')
    assert batch.read_rows(Path(name)) == [{"points": "a.laz;b.laz", "cell": "5"}]
    assert main(["batch", "points.info", table("points\na.laz; b.laz"), "--result", "out.csv"]) == 0
    assert rows()[0]["count"] == "300"


def test_options_of_layers_are_columns() -> None:
    name = table("points,points.bounds,kept\na.laz,'',k.laz\n".replace("''", '"0,0,5,5"'))
    assert main(["batch", "points.filter", name]) == 0
    assert 0 < len(PointCloud.open("k.laz")) < 60


def test_the_result_holds_the_rows_before_a_cancel() -> None:
    def stop_at_second(values: Any, ctx: Context) -> dict[str, Any]:
        if values["points"] == "b.laz":
            raise Cancelled
        return {"filled_share": 0.5}

    runs = made("points\na.laz\nb.laz\nc.laz", stop_at_second, result=Path("out.csv"))
    with pytest.raises(Cancelled):
        runs.go(Context())
    assert [(row["points"], row["status"]) for row in rows()] == [("a.laz", "done")]
    assert sorted(p.name for p in Path().glob(".*")) == []


def test_json_and_an_existing_result(capsys: Capture) -> None:
    name = table("points\na.laz\n")
    assert main(["batch", "points.info", name, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["outputs"]["result"][0]["count"] == 100
    Path("out.csv").write_text("mine")
    argv = ["batch", "points.info", name, "--result", "out.csv"]
    assert main(argv) == 2
    assert Path("out.csv").read_text() == "mine"
    assert main([*argv, "--overwrite"]) == 0
    assert rows()[0]["count"] == "100"


def test_columns_are_checked_without_a_run() -> None:
    with pytest.raises(ParameterError, match="is no column"):
        made("points,sell\na.laz,1").check(overwrite=False)
