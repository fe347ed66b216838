"""Models with real QGIS: .model3 files by path, and algorithms of QGIS as steps of ours."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from qgis_program import Qgis

from toolbox import catalog
from toolbox.cli.main import main
from toolbox.data import Raster, Vector
from toolbox.models.model import Model

MIXED = """
id: my.mixed
title: Slope and buffered contours
inputs:
  points: {type: PointCloud, help: Points}
  distance: {type: number, default: 1.5, unit: m, help: Distance}
steps:
  grid: {tool: surface.grid, points: {from: inputs.points}, classes: 2, cell: 2.0}
  slope: {tool: "qgis:native:slope", input: {from: grid.surface}, z_factor: 2}
  lines: {tool: surface.contours, surface: {from: grid.surface}, interval: 0.5}
  buffer:
    tool: qgis:native:buffer
    input: {from: lines.contours}
    distance: {from: inputs.distance}
    end_cap_style: Flat
    dissolve: true
outputs:
  slope: {from: slope.output, help: Slope}
  around: {from: buffer.output, help: Around the contours}
"""
# Reads a model as the designer does, and writes it as QGIS writes it.
AGAIN = """
import sys
from qgis.core import QgsApplication, QgsProcessingModelAlgorithm
app = QgsApplication([], False)
app.initQgis()
model = QgsProcessingModelAlgorithm()
assert model.fromFile(sys.argv[1])
assert model.toFile(sys.argv[2])
"""


@pytest.fixture
def mixed(qgis: Qgis, tmp_path: Path) -> Path:
    path = tmp_path / "gemischt ä.yaml"
    path.write_text(MIXED, "utf-8")
    return path


def test_a_mixed_model_gives_the_same_here_and_in_qgis(
    qgis: Qgis, mixed: Path, cloud: Path, tmp_path: Path
) -> None:
    ours = tmp_path / "slope.tif", tmp_path / "around.gpkg"
    argv = ["run", str(mixed), "--points", str(cloud), "--slope", str(ours[0])]
    assert main([*argv, "--around", str(ours[1])]) == 0
    exported = mixed.with_suffix(".model3")
    assert main(["model", "to-qgis", str(mixed)]) == 0
    theirs = tmp_path / "q slope.tif", tmp_path / "q around.gpkg"
    # the default of the model, which is not that of the step
    values = [f"POINTS={cloud}", f"slope:SLOPE={theirs[0]}", f"buffer:AROUND={theirs[1]}"]
    done = qgis("run", exported, "--json", "--", *values)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["results"]["slope:SLOPE"] == str(theirs[0])
    slopes = [Raster.open(path).values for path in (ours[0], theirs[0])]
    np.testing.assert_array_equal(*slopes)
    assert np.isfinite(slopes[0]).any()
    areas = [Vector.open(path).frame.geometry.area.sum() for path in (ours[1], theirs[1])]
    assert areas[0] == pytest.approx(areas[1])
    assert areas[0] > 10


def test_a_model_that_qgis_wrote_comes_back(qgis: Qgis, mixed: Path, tmp_path: Path) -> None:
    exported, again = mixed.with_suffix(".model3"), tmp_path / "again.model3"
    assert main(["model", "to-qgis", str(mixed)]) == 0
    script = tmp_path / "again.py"
    script.write_text(AGAIN)
    done = qgis.python(script, exported, again)
    assert again.exists(), done.stderr
    assert again.read_text("utf-8") != exported.read_text("utf-8")
    assert main(["model", "from-qgis", str(again)]) == 0
    one, two = catalog.load(str(mixed)), catalog.load(str(again.with_suffix(".yaml")))
    assert isinstance(one, Model)
    assert isinstance(two, Model)
    assert two.returns == one.returns
    for name, step in one.steps.items():
        assert two.steps[name].spec.id == step.spec.id
        assert dict(two.steps[name].settings) == dict(step.settings)
        assert dict(two.steps[name].links) == dict(step.links)


def test_a_shipped_model_as_a_file_of_qgis(qgis: Qgis, cloud: Path, tmp_path: Path) -> None:
    path, dtm = tmp_path / "t.model3", tmp_path / "dtm.tif"
    assert main(["model", "to-qgis", "models.terrain", str(path)]) == 0
    values = [f"POINTS={cloud}", "CELL=2", f"bottom:DTM={dtm}"]
    values += [f"top:DSM={tmp_path / 's.tif'}", f"ground:CLASSIFIED={tmp_path / 'c.laz'}"]
    done = qgis("run", path, "--", *values)
    assert done.returncode == 0, done.stderr
    plain = tmp_path / "plain.tif"
    argv = ["run", "models.terrain", "--points", str(cloud), "--cell", "2"]
    assert main([*argv, "--dtm", str(plain)]) == 0
    np.testing.assert_array_equal(Raster.open(dtm).values, Raster.open(plain).values)


def test_algorithms_of_qgis_are_checked_as_tools_are(
    qgis: Qgis, mixed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = MIXED.replace("Flat", "Flt").replace("native:slope", "native:slpe")
    mixed.write_text(text.replace("z_factor: 2", "z_factor: x"), "utf-8")
    assert main(["model", "check", str(mixed)]) == 2
    error = capsys.readouterr().err
    assert "buffer.end_cap_style: must be one of Round, Flat, Square, got 'Flt'" in error
    assert "Algorithm native:slpe not found" in error


def test_a_choice_of_qgis_is_no_input_of_its_model(
    qgis: Qgis, mixed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = MIXED.replace("end_cap_style: Flat", "end_cap_style: {from: inputs.caps}")
    choice = "  caps: {type: choice, choices: [Round, Flat, Square], help: Caps}\nsteps:"
    mixed.write_text(text.replace("steps:", choice), "utf-8")
    assert main(["model", "to-qgis", str(mixed)]) == 2
    assert "buffer.end_cap_style: is a choice that QGIS takes by" in capsys.readouterr().err


def test_a_failing_algorithm_of_qgis_says_why(
    qgis: Qgis, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.gpkg"
    path.write_bytes(b"no package")
    argv = ["run", "qgis:native:buffer", "--input", str(path), "--output", str(tmp_path / "b.gpkg")]
    assert main(argv) == 3
    assert "bad.gpkg" in capsys.readouterr().err


def test_without_qgis_a_step_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("QGIS_PROCESS", "/no/program")
    path = tmp_path / "m.yaml"
    path.write_text(MIXED.replace("native:slope", "native:aspect"), "utf-8")
    assert main(["model", "check", str(path)]) == 2
    assert "QGIS was not found" in capsys.readouterr().err
