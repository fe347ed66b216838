"""The verbs for models: check, show, new."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

from toolbox.cli.main import main
from toolbox.data import PointCloud, Raster
from toolbox.models import documents

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def _no_history(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TOOLBOX_HISTORY", "")


@pytest.fixture
def many(tmp_path: Path) -> Path:
    """A model of twenty steps, an optional and a repeated one among them."""
    lines = ["id: my.many", "title: Many", "inputs:", "  points: {type: PointCloud, help: P}"]
    lines += ["  flag: {type: boolean, default: true, help: F}", "steps:"]
    lines += ["  a0: {tool: points.filter, points: {from: inputs.points}}"]
    for i in range(1, 15):
        before = f"{{from: a{(i - 1) // 2}.kept}}"
        lines.append(f"  a{i}: {{tool: points.filter, points: {before}, classes: {i}}}")
    lines.append("  opt: {tool: points.filter, when: {from: inputs.flag}, points: {from: a3.kept}}")
    lines.append("  alt: {tool: points.filter, points: {from: [opt.kept, a4.kept]}}")
    lines.append(
        "  each: {tool: points.filter, repeat: classes, classes: [1, 2], points: {from: alt.kept}}"
    )
    lines.append("  top: {tool: surface.grid, points: {from: a13.kept}, method: max}")
    lines.append(
        "  low: {tool: surface.grid, points: {from: a14.kept}, template: "
        "{from: top.surface}, where: 'z < 100 and intensity > 5'}"
    )
    lines += ["outputs:", "  r: {from: low.surface}", "  all: {from: each.kept}"]
    path = tmp_path / "many.yaml"
    path.write_text("\n".join(lines), "utf-8")
    return path


def test_check_says_what_each_step_reaches(capsys: Capture, many: Path) -> None:
    assert main(["model", "check", str(many)]) == 0
    told = capsys.readouterr().out
    assert "my.many is fine, 20 steps" in told
    assert re.search(r"a0 +points.filter, looks 0 m around", told)
    assert re.search(r"low +surface.grid, needs the whole survey", told)


def test_check_tells_all_mistakes(capsys: Capture, many: Path) -> None:
    many.write_text(many.read_text("utf-8").replace("a13.kept", "a13.kpt").replace("max}", "mox}"))
    assert main(["model", "check", str(many)]) == 2
    error = capsys.readouterr().err
    assert "2 problems" in error
    assert "top.points: nothing called 'a13.kpt'; did you mean 'a13.kept'?" in error
    assert "top.method: must be one of" in error
    assert main(["model", "check", "ground.csf"]) == 2
    assert "no model file" in capsys.readouterr().err
    assert main(["model", "check", "no.yaml"]) == 2
    assert "No such file" in capsys.readouterr().err


def test_new_gives_a_model_that_passes_and_runs(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "first.yaml"
    assert main(["model", "new", str(path)]) == 0
    assert main(["model", "check", str(path)]) == 0
    assert "my.first is fine" in capsys.readouterr().out
    xyz = np.random.default_rng(1).uniform(0, 40, (4000, 3)) * [1, 1, 0.01]
    PointCloud(xyz, crs=CRS(32635)).save(tmp_path / "a.laz")
    argv = ["run", str(path), "--points", str(tmp_path / "a.laz"), "--denoise"]
    assert main([*argv, "--terrain", str(tmp_path / "t.tif")]) == 0
    assert np.isfinite(Raster.open(tmp_path / "t.tif").values).mean() > 0.9
    assert "ground_share: " in capsys.readouterr().out
    assert main(["model", "new", str(path)]) == 2
    assert "exists" in capsys.readouterr().err
    assert main(["model", "new", str(tmp_path / "a.txt")]) == 2
    assert "use .yaml, .yml" in capsys.readouterr().err
    assert main(["model", "new"]) == 0
    assert documents.mapping(capsys.readouterr().out)["id"] == "my.model"


def test_show_prints_mermaid(many: Path, capsys: Capture) -> None:
    assert main(["model", "show", str(many)]) == 0
    text = capsys.readouterr().out
    assert text.startswith("flowchart TD\n")
    assert '    s_opt["<b>opt</b><br/>points.filter<br/>if inputs.flag"]' in text
    assert '    s_each[["<b>each</b><br/>points.filter<br/>for each classes' in text
    assert '    s_opt -->|"kept"| s_alt\n    s_a4 -.->|"kept"| s_alt' in text
    assert "where: z #lt; 100 and intensity #gt; 5" in text
    assert "style s_opt stroke-dasharray" in text
    nodes = [line for line in text.splitlines() if "<b>" in line]
    arrows = [line for line in text.splitlines() if "--> " in line or "->|" in line]
    assert len(nodes) == 1 + 20 + 2
    assert len(arrows) == 24
    assert main(["model", "show", "ground.csf"]) == 2
    assert "ground.csf is a tool, no model" in capsys.readouterr().err
    assert main(["model", "show", "models.terrain"]) == 0
    assert 'i_points(["<b>points</b><br/>PointCloud"])' in capsys.readouterr().out


def test_show_writes_mermaid_or_markdown(many: Path, tmp_path: Path, capsys: Capture) -> None:
    assert main(["model", "show", str(many)]) == 0
    text = capsys.readouterr().out
    argv = ["model", "show", str(many), "--picture"]
    assert main([*argv, str(tmp_path / "many.mmd")]) == 0
    assert (tmp_path / "many.mmd").read_text("utf-8") == text
    assert main([*argv, str(tmp_path / "many.md")]) == 0
    assert (tmp_path / "many.md").read_text("utf-8") == f"```mermaid\n{text}```\n"
    capsys.readouterr()
    assert main([*argv, str(tmp_path / "many.md")]) == 2
    assert "exists; allow it with --overwrite" in capsys.readouterr().err
    assert main([*argv, str(tmp_path / "many.md"), "--overwrite"]) == 0
    assert main([*argv, str(tmp_path / "many.svg")]) == 2
    assert "picture: cannot write .svg; use .mmd, .md" in capsys.readouterr().err
    assert not (tmp_path / "many.svg").exists()


def test_results_of_a_repeated_step_are_printed_one_by_one(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For people, as one JSON object, and as an event."""
    path = tmp_path / "pyramid.yaml"
    path.write_text(
        "id: my.pyramid\ntitle: P\ninputs:\n  points: {type: PointCloud, help: P}\nsteps:\n"
        "  grid: {tool: surface.grid, repeat: cell, cell: [5, 9], points: {from: inputs.points}}\n"
        "outputs:\n  dtm: {from: grid.surface}\n  share: {from: grid.filled_share}\n"
    )
    xyz = np.random.default_rng(1).uniform(0, 40, (400, 3)) * [1, 1, 0.01]
    PointCloud(xyz, crs=CRS(32635)).save(tmp_path / "a.laz")
    argv = ["run", str(path), "--points", str(tmp_path / "a.laz"), "--overwrite"]
    argv += ["--dtm", str(tmp_path / "d.tif")]
    assert main(argv) == 0
    assert f"dtm 2: {tmp_path / 'd_2.tif'}\nshare 1: " in capsys.readouterr().out
    files = [str(tmp_path / f"d_{number}.tif") for number in (1, 2)]
    assert main([*argv, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["outputs"] == {"dtm": files}
    assert len(said["statistics"]["share"]) == 2
    monkeypatch.setattr("sys.stdin", None)
    assert main([*argv, "--events", "jsonl"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["outputs"]["dtm"] == files
