"""Models to QGIS and back, without QGIS: nothing is lost, and what cannot be said is reported."""

from __future__ import annotations

from pathlib import Path

import pytest

from toolbox import catalog
from toolbox.cli.main import main
from toolbox.models import documents
from toolbox.models.model import Model
from toolbox.qgis import model3
from toolbox.qgis.model import from_qgis, to_qgis

Capture = pytest.CaptureFixture[str]

EVERYTHING = """
id: my.everything
title: Values of every type
help: |
  Two lines
  of help.
inputs:
  points: {type: PointCloud, help: Points}
  areas: {type: Vector, optional: true, help: Areas}
  cell: {type: number, default: 0.5, unit: m, gt: 0, help: Cell size}
  classes: {type: class list, default: "2,9", help: Classes}
  method: {type: choice, choices: [min, max], default: max, help: Method}
  band: {type: range, default: null, unit: m, help: Band of heights}
  box: {type: extent, help: Extent}
  seed: {type: position, default: [5.5, 6], help: Place}
  names: {type: attribute, many: true, default: [intensity, red], help: Attributes}
  flag: {type: boolean, default: true, help: Switch}
steps:
  joined: {tool: points.merge, points: {from: grid_points.kept}}
  grid_points:
    tool: points.filter
    points: {from: inputs.points}
    classes: {from: inputs.classes}
    where: "z < 100 and intensity > 5"
    returns: first
    elevation_above_lowest: {from: inputs.band}
  thin:
    tool: points.thin
    method: duplicates
    points: {from: inputs.points}
    agree: {from: inputs.names}
  clean: {tool: points.denoise, points: {from: thin.thinned}, height_gap: null, ignore: "7"}
  plane: {tool: planes.fit, points: {from: clean.clean}, reference: [0, 0, 1], max_distance: 0.25}
  top:
    tool: surface.grid
    points: {from: joined.merged}
    clip: {from: inputs.areas}
    cell: {from: inputs.cell}
    method: {from: inputs.method}
    extent: {from: inputs.box}
    support: {from: inputs.flag}
  water: {tool: shoreline.extract, points: {from: inputs.points}, seed_point: {from: inputs.seed}}
  part: {tool: points.clip, points: {from: inputs.points}, extent: [0, -5.25, 10, 1e6]}
outputs:
  surface: {from: top.surface, help: Highest points}
  part: {from: part.clipped, help: A part}
  water: {from: water.water, help: Water}
  plane: {from: plane.inliers, help: Plane}
"""


def load(path: Path) -> Model:
    found = catalog.load(str(path))
    assert isinstance(found, Model)
    return found


def test_round_trip(tmp_path: Path, capsys: Capture) -> None:
    first, between, second = (tmp_path / n for n in ("a.yaml", "ä b.model3", "ä b.yaml"))
    first.write_text(EVERYTHING, "utf-8")
    assert main(["model", "to-qgis", str(first), str(between)]) == 0
    children = model3.value(between.read_text("utf-8"))["children"]
    assert children["part"]["alg_id"] == "lidartoolbox:pointsclip"
    plain = {step: children[step]["params"] for step in ("part", "plane", "clean")}
    extent = plain["part"]["EXTENT"]  # QGIS says both x first
    assert extent == [{"source": 2, "static_value": "0.0,10.0,-5.25,1000000.0"}]
    assert plain["clean"]["IGNORE"][0]["static_value"] == "7"
    # QGIS hands no default of a model to its steps
    assert children["top"]["params"]["CELL"] == [
        {"source": 3, "expression": "coalesce(@CELL, 0.5)"}
    ]
    assert children["top"]["params"]["EXTENT"] == [{"source": 0, "parameter_name": "BOX"}]
    assert plain["clean"]["HEIGHT_GAP"][0]["static_value"] is None
    assert main(["model", "from-qgis", str(between)]) == 0
    assert main(["model", "check", str(second)]) == 0, capsys.readouterr()
    one, two = load(first), load(second)
    assert two.title == one.title
    assert two.help == one.help
    assert two.steps.keys() == one.steps.keys()
    for name, step in one.steps.items():
        again = two.steps[name]
        assert again.spec.id == step.spec.id
        assert dict(again.settings) == dict(step.settings), name
        assert dict(again.links) == dict(step.links), name
    assert two.returns == one.returns
    for name, field in one.inputs.items():
        again_field = two.inputs[name]
        assert again_field.kind is field.kind, name
        assert (again_field.default, again_field.many) == (field.default, field.many), name
        assert (again_field.unit, again_field.help) == (field.unit, field.help), name
        assert again_field.optional == field.optional, name
    assert main(["model", "from-qgis", str(between)]) == 2
    assert "exists" in capsys.readouterr().err
    says = model3.value(between.read_text("utf-8"))
    says["parameterDefinitions"]["CELL"]["default"] = 0.25  # somebody did so in the designer
    made, notes = from_qgis(model3.text(says), "a.model3")
    assert made["inputs"]["cell"]["default"] == 0.25
    assert "cell is 0.25 by default, although a step says coalesce(@CELL, 0.5)" in notes


def test_what_designer_files_hold_reads_back() -> None:
    values = {"a": 1, "b": -1.5, "c": "x\n<&>é", "d": True, "e": None, "f": [1, "a"], "g": ["a"]}
    values |= {"h": {"i": {}}, "j": 2**40}
    assert model3.value(model3.text(values)) == values
    crs = '<Option type="QgsCoordinateReferenceSystem"><spatialrefsys><authid>EPSG:2154</authid>'
    assert model3.value(crs + "</spatialrefsys></Option>") == "EPSG:2154"
    assert model3.value('<Option type="QgsProperty"/>') == model3.Foreign("QgsProperty")
    with pytest.raises(ValueError, match="syntax"):
        model3.value("no xml")


def test_conditions_are_settled_when_the_model_is_written(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "r.model3"
    assert main(["model", "to-qgis", "models.reservoir_shoreline", str(path)]) == 0
    told = capsys.readouterr().out
    assert "preset is fixed to default" in told
    assert "reference and the steps that need it are left out" in told
    assert "level is a value" in told
    children = model3.value(path.read_text("utf-8"))["children"]
    assert set(children) == {"body"}
    argv = ["model", "to-qgis", "models.reservoir_shoreline", str(path), "--overwrite"]
    assert main([*argv, "--set", "preset=thesis", "--with", "reference"]) == 0
    says = model3.value(path.read_text("utf-8"))
    assert "comparison" in says["children"]
    assert "body" not in says["children"]
    assert says["parameterDefinitions"]["REFERENCE"]["flags"] == 0
    assert main([*argv, "--set", "preset=thesiss", "--with", "nothing"]) == 2
    error = capsys.readouterr().err
    assert "did you mean 'thesis'" in error
    assert "nothing: is no optional layer" in error
    assert main(["model", "to-qgis", "ground.csf", str(path)]) == 2


def test_a_switch_without_a_value_is_asked_for(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(
        "id: my.m\ntitle: M\ninputs:\n  points: {type: PointCloud, help: P}\n"
        "  clean: {type: boolean, help: C}\nsteps:\n"
        "  a: {tool: points.denoise, when: {from: inputs.clean}, points: {from: inputs.points}}\n"
        "  b: {tool: points.filter, points: {from: [a.clean, inputs.points]}}\n"
        "outputs:\n  kept: {from: b.kept}\n"
    )
    argv = ["model", "to-qgis", str(path), str(tmp_path / "m.model3")]
    assert main(argv) == 2
    assert "clean: is fixed in QGIS; say its value, --set clean=VALUE" in capsys.readouterr().err
    assert main([*argv, "--set", "clean=false"]) == 0
    assert "clean is fixed to False" in capsys.readouterr().out


def test_values_are_on_a_page_and_defaults_that_differ_are_told(
    tmp_path: Path, capsys: Capture
) -> None:
    path = tmp_path / "v.yaml"
    path.write_text(
        "id: my.v\ntitle: V\ninputs:\n  points: {type: PointCloud, help: P}\n"
        "  box: {type: extent, default: [0, 1, 2, 3], help: B}\n"
        "  gap: {type: number, unit: m, default: 5, optional: true, help: G}\nsteps:\n"
        "  grid: {tool: surface.grid, points: {from: inputs.points}, extent: {from: inputs.box},\n"
        "    max_gap: {from: inputs.gap}}\n"
        "outputs:\n  dtm: {from: grid.surface}\n  share: {from: grid.filled_share}\n"
    )
    assert main(["model", "to-qgis", str(path)]) == 0
    told = capsys.readouterr().out
    assert "share is a value: it is in the report of step grid, grid:PAGE" in told
    assert "box has no default in QGIS: state it, here it is 0.0,1.0,2.0,3.0" in told
    assert "gap left empty means its default, 5, not none" in told
    exported = path.with_suffix(".model3")
    says = model3.value(exported.read_text("utf-8"))
    assert says["children"]["grid"]["outputs"]["PAGE"]["output_name"] == "PAGE"
    assert says["parameterDefinitions"]["BOX"]["default"] is None
    assert says["parameterDefinitions"]["BOX"]["flags"] == 0
    assert main(["model", "from-qgis", str(exported), str(tmp_path / "again.yaml")]) == 0
    assert "output grid.page is left out" in capsys.readouterr().out
    assert list(load(tmp_path / "again.yaml").outputs) == ["dtm"]


def test_points_as_layers_or_files() -> None:
    model = catalog.load("models.terrain")
    assert isinstance(model, Model)
    for layers, type in ((True, "pointcloud"), (False, "file")):
        says = model3.value(to_qgis(model, point_layers=layers)[0])
        assert says["parameterDefinitions"]["POINTS"]["parameter_type"] == type
        assert "internal_version" not in says
    # a surface that another step waits for must not be skipped in QGIS
    assert says["children"]["top"]["outputs"]["DSM"]["mandatory"] is True
    assert says["children"]["heights"]["outputs"]["NDSM"]["mandatory"] is False


def test_steps_say_their_defaults_or_the_designer_draws_them_red() -> None:
    model = catalog.load("models.terrain")
    assert isinstance(model, Model)
    says = model3.value(to_qgis(model)[0])
    step = says["children"]["ground"]["params"]
    assert step["RETURNS"] == [{"source": 2, "static_value": "last"}]
    for f in catalog.load("ground.classify").inputs.values():
        stated = f.role != "param" or f.required or f.default is None or f.name.upper() in step
        assert stated, f.name


def test_repeated_steps_are_refused(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(
        "id: my.p\ntitle: P\ninputs:\n  points: {type: PointCloud, help: P}\nsteps:\n"
        "  grid: {tool: surface.grid, repeat: cell, cell: [1, 2], points: {from: inputs.points}}\n"
        "outputs:\n  dtm: {from: grid.surface}\n"
    )
    assert main(["model", "to-qgis", str(path)]) == 2
    assert "grid: is repeated" in capsys.readouterr().err
    assert not path.with_suffix(".model3").exists()


def child(alg: str, params: dict[str, object], **more: object) -> dict[str, object]:
    sources = {name: [value] for name, value in params.items()}
    return {"alg_id": alg, "active": True, "params": sources, "outputs": {}} | more


def test_all_that_cannot_be_converted_is_said_at_once(tmp_path: Path, capsys: Capture) -> None:
    points = {"source": 0, "parameter_name": "p"}
    grid = {
        "POINTS": points,
        "CELL": {"source": 3, "expression": "@p_width / 100"},
        "METHOD": {"source": 2, "static_value": "maximum"},
        "SUPPORT": {"source": 3, "expression": "coalesce(@p, true)"},
        "POWER": {"source": 3, "expression": "coalesce(@d, 1) + (2)"},
        "CLIP": {"source": 2, "static_value": "/data/areas.gpkg"},
        "TILE": {"source": 2, "static_value": "500"},
        "ASSUME_CRS": {"source": 2, "static_value": None},
    }
    branch = [{"child_id": "x", "conditional_branch": "yes"}]
    children = {
        "lidartoolbox:surfacegrid_1": child("lidartoolbox:surfacegrid", grid),
        "lidartoolbox:gone_1": child("lidartoolbox:gone", {}),
        "filter": child(
            "lidartoolbox:pointsfilter",
            {"POINTS": points, "RETURNS": {"source": 2, "static_value": 99}},
            dependencies=branch,
        ),
        "off": child("native:buffer", {}) | {"active": False},
    }
    says = {"model_name": "M", "children": children}
    says |= {"parameterDefinitions": {"p": {"description": "P", "flags": 0}, "q": {}}}
    says["parameterDefinitions"]["d"] = {"default": 1}
    path = tmp_path / "m.model3"
    path.write_text(model3.text(says), "utf-8")
    assert main(["model", "from-qgis", str(path)]) == 2
    error = capsys.readouterr().err
    for text in (
        "surfacegrid_1.cell: is an expression of QGIS, '@p_width / 100'",
        "surfacegrid_1.method: must be one of",
        "surfacegrid_1.clip: is the file '/data/areas.gpkg'",
        "surfacegrid_1.tile: is no parameter",
        "gone_1: lidartoolbox:gone is no tool of ours",
        "filter: runs on a condition",
        "filter.returns: must be one of",
        "surfacegrid_1.support: is an expression of QGIS, 'coalesce(@p, true)'",
        "surfacegrid_1.power: is an expression of QGIS, 'coalesce(@d, 1) + (2)'",
        "9 problems",
    ):
        assert text in error, text
    assert not path.with_suffix(".yaml").exists()
    for name in list(children)[1:3]:
        del children[name]
    del says["parameterDefinitions"]["d"]
    for name in ("CELL", "METHOD", "SUPPORT", "POWER", "CLIP", "TILE"):
        del grid[name]
    (child_id,) = [name for name in children if name != "off"]
    children[child_id] = child(
        "lidartoolbox:surfacegrid",
        grid
        | {
            "CELL": {"source": 3, "expression": " @q "},
        },
    ) | {"outputs": {"DTM": {"child_id": child_id, "output_name": "SURFACE"}}}
    made, notes = from_qgis(model3.text(says), "m.model3")
    assert made["steps"] == {
        "surfacegrid_1": {
            "tool": "surface.grid",
            "points": {"from": "inputs.p"},
            "cell": {"from": "inputs.q"},
        }
    }
    assert made["outputs"] == {"dtm": {"from": "surfacegrid_1.surface", "help": "DTM"}}
    assert notes == ["step off is switched off and left out"]
    del children[child_id]["alg_id"]
    for text in ("", "<a", model3.text({"a": 1}), model3.text(says)):
        path.write_text(text)
        assert main(["model", "from-qgis", str(path)]) == 2
    assert "is damaged: KeyError('alg_id')" in capsys.readouterr().err
    assert main(["model", "from-qgis", str(tmp_path / "none.model3")]) == 2


def test_yaml_that_we_write_we_read() -> None:
    values = {
        "a": "no",
        "b": "012",
        "c": "2,9",
        "d": "one\ntwo",
        "e": [1.5, None, True],
        "f": "1:2",
    }
    assert documents.mapping(documents.text(values)) == values
