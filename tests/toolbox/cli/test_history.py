"""The history of runs: complete, also of several processes, and never in the way."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

from toolbox.cli import history
from toolbox.cli.main import main
from toolbox.data import PointCloud, Raster
from toolbox.data.record import read_record

DESCRIBED = {"id": "a.b", "inputs": {}, "outputs": {}}
ADD = (
    "import sys; from toolbox.cli import history\n"
    "for number in range(200):\n"
    "    history.add('a.b', {'id': 'a.b', 'inputs': {}, 'outputs': {}},\n"
    "                {'n': number, 'who': sys.argv[1], 'long': 'x' * 3000},\n"
    "                {}, seconds=1, code=0)\n"
)


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of the history, of which neither it nor its folder is there yet."""
    path = tmp_path / "state" / "history.jsonl"
    monkeypatch.setenv(history.VARIABLE, str(path))
    return path


@pytest.fixture
def points(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cloud in the current folder."""
    monkeypatch.chdir(tmp_path)
    xyz = np.random.default_rng(1).uniform(0, 20, (500, 3)).round(2)
    PointCloud(xyz, crs=CRS(32635)).save("a.laz")
    return tmp_path / "a.laz"


def add(count: int = 1, **values: object) -> None:
    for _ in range(count):
        history.add("a.b", DESCRIBED, values, {}, seconds=0.123, code=0)


@pytest.mark.skipif(os.name == "nt", reason="has no such permissions")
def test_nobody_else_may_read_it(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "FULL", 1)
    before = os.umask(0)
    try:
        add(2)
        kept.chmod(0o644)  # as an earlier version has made it
        add()
    finally:
        os.umask(before)
    assert kept.parent.stat().st_mode & 0o777 == 0o700
    assert {path.stat().st_mode & 0o777 for path in kept.parent.iterdir()} == {0o600}


def test_a_run_on_the_command_line(kept: Path, points: Path) -> None:
    said = ["run", "points.filter", "--points", "a.laz", "--where", "z < 9", "--kept", "b.laz"]
    assert main([*said, "--assume-crs", "EPSG:32635", "--picture", "c.png", "--quiet"]) == 0
    assert main([*said, "--quiet"]) == 2  # the output exists
    worked, failed = history.entries()
    assert worked["id"] == "points.filter"
    assert worked["values"] == {
        "points": str(points),
        "where": "z < 9",
        "kept": str(points.parent / "b.laz"),
        "assume_crs": "EPSG:32635",
        "picture": str(points.parent / "c.png"),
    }
    assert worked["outputs"]["kept"] == str(points.parent / "b.laz")
    assert worked["time"].endswith("Z")
    assert (worked["exit"], failed["exit"]) == (0, 2)
    assert failed["outputs"] == {}
    assert kept.read_bytes().count(b"\n") == 2


def test_options_of_layers_and_models_become_absolute(kept: Path, points: Path) -> None:
    layer = {"schema": {"type": "string", "contentMediaType": "application/vnd.laszip"}}
    several = {"schema": {"type": "array", "items": layer["schema"]}}
    described = {"id": "my.model", "inputs": {"one": layer, "many": several}, "outputs": {}}
    described |= {"between": {"low.kept": {}}}
    values = {"one": {"path": "a.laz", "columns": "x,y,z"}, "many": ["a.laz", "b.laz"]}
    history.add(
        "m.yaml", described, values | {"low.kept": "c.laz", "cell": 1}, {}, seconds=1, code=0
    )
    (entry,) = history.entries()
    here = points.parent
    assert entry["id"] == str(here / "m.yaml")
    assert entry["values"] == {
        "one": {"path": str(here / "a.laz"), "columns": "x,y,z"},
        "many": [str(here / "a.laz"), str(here / "b.laz")],
        "low.kept": str(here / "c.laz"),
        "cell": 1,
    }


def test_how_it_was_run_in_tiles_is_kept(
    kept: Path, points: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Else the line could not be given again."""
    words = ["--tile", "50", "--workers", "1", "--memory", "2GB"]
    thinned = str(points.with_name("thin.laz"))
    given = ["run", "points.thin", "--points", str(points), "--cell", "5", "--thinned", thinned]
    assert main([*given, *words]) == 0
    capsys.readouterr()
    assert main(["history"]) == 0
    told = capsys.readouterr().out
    assert all(
        f"{name} {value}" in told for name, value in zip(words[::2], words[1::2], strict=True)
    )


def test_several_processes_lose_no_run(kept: Path) -> None:
    jobs = [subprocess.Popen([sys.executable, "-c", ADD, str(k)]) for k in range(4)]
    assert [job.wait() for job in jobs] == [0] * 4
    values = [entry["values"] for entry in history.entries()]
    for who in "0123":
        assert [value["n"] for value in values if value["who"] == who] == list(range(200))
    assert len(list(kept.parent.iterdir())) == 1


def test_several_processes_begin_anew(kept: Path) -> None:
    code = f"import toolbox.cli.history as h; h.FULL, h.KEPT = 100_000, 100\n{ADD}"
    jobs = [subprocess.Popen([sys.executable, "-c", code, str(k)]) for k in range(4)]
    assert [job.wait() for job in jobs] == [0] * 4
    assert len(list(history.entries())) == 800
    assert len(list(kept.parent.iterdir())) > 10


def test_a_full_file_is_put_aside(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "FULL", 1000)
    for number in range(100):
        add(n=number)
    files = sorted(kept.parent.iterdir())
    assert len(files) == history.KEPT + 1
    assert all(file.stat().st_size < 1500 for file in files)
    numbers = [entry["values"]["n"] for entry in history.entries()]
    assert numbers == list(range(numbers[0], 100))


def test_an_empty_variable_turns_it_off(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(history.VARIABLE, "")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    add()
    assert list(history.entries()) == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform != "linux", reason="folders of another system")
def test_the_state_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(history.VARIABLE)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    add()
    assert (tmp_path / "lidar-toolbox" / "history.jsonl").exists()


def test_it_never_fails_a_run(
    points: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(history.VARIABLE, str(points / "below a file"))
    assert main(["run", "points.filter", "--points", "a.laz", "--where", "z < 9"]) == 0
    assert "warning: the run is not kept in the history" in capsys.readouterr().err


def test_a_line_that_was_cut_off_spoils_no_other(kept: Path) -> None:
    add(n=1)
    with kept.open("ab") as file:
        file.write(b'{"id": "cut')
    add(n=2)
    assert [entry["values"]["n"] for entry in history.entries()] == [1, 2]


def test_the_verb(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["history"]) == 0
    assert capsys.readouterr().out == ""
    for number in range(30):
        add(n=number)
    history.add("a.b", DESCRIBED, {"points": {"path": "x.txt"}}, {}, seconds=61, code=3)
    main(["history"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 40
    assert lines[-2].endswith("61 s  (exit code 3)")
    assert lines[-1] == "  a.b --points x.txt"
    main(["history", "--json", "--limit", "2"])
    assert [entry["exit"] for entry in json.loads(capsys.readouterr().out)] == [0, 3]
    assert main(["history", "--limit", "-1"]) == 2


def test_provenance_and_replay(points: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = ["run", "surface.grid", "--points", "a.laz", "--cell", "2", "--method", "nearest"]
    assert main([*said, "--surface", "b.tif", "--quiet"]) == 0
    assert main(["provenance", "a.laz"]) == main(["replay", "a.laz"]) == 3
    assert "a.laz carries no record" in capsys.readouterr().err
    assert main(["provenance", "b.tif"]) == 0
    assert capsys.readouterr().out.startswith("surface of surface.grid: ")
    assert main(["provenance", "b.tif", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["parameters"]["cell"] == 2
    assert main(["replay", "b.tif"]) == 0
    assert capsys.readouterr().out == "b.tif: the same\n"
    raster = Raster.open("b.tif")
    Raster(raster.values + 1, raster.transform, crs=raster.crs).save(
        "b.tif", overwrite=True, record=read_record("b.tif")
    )
    assert main(["replay", "b.tif"]) == 3
    error = capsys.readouterr().err
    assert "b.tif is not what its record makes now:\n  band 1: " in error
    assert main(["replay", "b.tif", "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["same"] is False
    Path("a.laz").rename("sub.laz")
    assert main(["replay", "b.tif", "--inputs", "."]) == 3
    assert "there is no file a.laz in" in capsys.readouterr().err


def test_nothing_is_said_of_runs_that_are_kept(
    kept: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.DEBUG):
        add()
    assert caplog.text == ""
    assert len(list(history.entries())) == 1
