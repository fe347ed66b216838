"""The set that a model hands over: all files or none, with a README that names each."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import sqlite3
import zipfile
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pyproj import CRS
from pyproj.crs import CompoundCRS

import toolbox
from toolbox import catalog, language
from toolbox.cli.main import main
from toolbox.cli.replay import replay
from toolbox.context import Context
from toolbox.data import PointCloud, Raster, Table, Vector
from toolbox.data.crs import assumed, crs_text, parse_crs
from toolbox.errors import DataError, ParameterError
from toolbox.models.model import Model, ModelRun, run_tool
from toolbox.runs import delivery, sealed
from toolbox.tiles.tiling import Tiling

MODEL = """
id: toy.hills
title: Hills
inputs:
  points: {type: PointCloud, help: Points}
  cell: {type: number, default: 2.0, feet: 3, unit: m, gt: 0, help: Size of the cells}
  interval: {type: number, default: 1.0, feet: 2, unit: m, gt: 0, help: Height between two lines}
  shortest: {type: number, default: 9.0, feet: 20, unit: m, help: Length, label: Shortest line}
steps:
  top: {tool: surface.grid, points: {from: inputs.points}, method: max, cell: {from: inputs.cell}}
outputs:
  surface: {from: top.surface, help: Highest points}
  share: {from: top.filled_share, help: Share of cells with a value}
deliver:
  steps:
    lines: {tool: surface.contours, surface: {from: top.surface}, interval: {from: inputs.interval},
      min_length: {from: inputs.shortest}}
    named: {tool: vectors.merge, layers: [{from: lines.contours}], layer_names: [contours]}
  files:
    - {file: report.html, from: page, help: The report}
    - {file: tables.xlsx, from: page, help: Its tables}
    - {file: top.tif, from: surface, cog: true, help: Highest points}
    - {file: lines.gpkg, from: lines.contours, layer: contours, help: Lines}
    - {file: lines.kmz, from: named.merged, help: Lines for Google Earth}
    - {file: lines.dxf, from: named.merged, help: Lines for CAD}
"""
FILES = {
    *("README.txt", "report.html", "tables.xlsx", "top.tif"),
    *("lines.gpkg", "lines.kmz", "lines.dxf"),
}


def hill(crs: str = "EPSG:32635") -> PointCloud:
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 40, 1.0), np.arange(0, 40, 1.0)))
    xyz = np.column_stack(
        [x + 5e5, y + 4.4e6, 100 + 8 * np.exp(-((x - 20) ** 2 + (y - 20) ** 2) / 99)]
    )
    return PointCloud(xyz, crs=parse_crs(crs), name="hill.laz")


@pytest.fixture
def model(tmp_path: Path) -> str:
    path = tmp_path / "hills.yaml"
    path.write_text(MODEL)
    return str(path)


@pytest.fixture
def points(tmp_path: Path) -> Path:
    hill().save(tmp_path / "hill.laz")
    return tmp_path / "hill.laz"


def names(folder: Path) -> set[str]:
    """The files of a folder, without the records beside those that hold none."""
    return {
        path.name
        for path in folder.iterdir()
        if not path.name.endswith((".kmz.json", ".xlsx.json", ".dxf.json"))
    }


def test_the_set_is_written_and_named_in_words(model: str, points: Path, tmp_path: Path) -> None:
    head = {"title": "Hill of Delft", "client": "City", "fields": {"Contract": "2026-17"}}
    found = toolbox.run(model, {"points": points, "deliver": {"path": tmp_path / "out", **head}})
    assert names(tmp_path / "out") == FILES
    assert found["deliver"] == tmp_path / "out"
    assert set(found) == {"surface", "share", "deliver"}, "results of its own steps are not given"
    text = (tmp_path / "out" / "README.txt").read_text()
    for file in FILES - {"README.txt"}:
        assert f"\n{file}  (" in text
    for words in (
        "Hill of Delft",
        "City",
        "2026-17",
        "WGS 84 / UTM zone 35N",
        "hill.laz",
        "Lines [number of lines: 7]",
    ):
        assert words in text
    assert "Hill of Delft" in (tmp_path / "out" / "report.html").read_text()
    assert "\nlines.gpkg, contours\n    elevation  Elevation [m]\n" in text
    drawing = text.partition("\nDrawings\n")[2].partition("\nColumns\n")[0]
    assert "lines.dxf: in metres; layer, colour (its number in CAD) [entities]" in drawing
    assert (
        "    contours        dark orange (34) [6]\n    contours_index  brown (22) [1]\n" in drawing
    )
    joined = "lines.kmz and lines.dxf: the columns of the layers above that they join"
    assert joined in text
    assert "\nlines.kmz\n    " not in text, "columns are told once"


FOOT = 1200 / 3937


def test_defaults_of_data_in_feet_are_round_in_feet(
    model: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Cells of a metre were 3.28 ft wide, and contours 3.28 ft apart."""
    feet, out = tmp_path / "feet.laz", tmp_path / "out"
    hill("EPSG:2263").save(feet)
    with caplog.at_level("INFO", "toolbox"):
        toolbox.run(model, {"points": feet, "deliver": out})
    assert "cell 0.914402 m = 3 us-ft, interval 0.60960" in caplog.text
    assert Raster.open(out / "top.tif").cell == 3.0
    levels = Vector.open(out / "lines.gpkg").frame["elevation"]
    assert sorted(levels.unique()) == [102.0, 104.0, 106.0]
    text = " ".join((out / "README.txt").read_text().split())
    assert "Cell size 3 US ft (0.9144 m); Height between lines 2 US ft (0.6096 m)" in text
    assert "Shortest line" not in text, "a default is no choice"
    caplog.clear()
    for name in ("top.tif", "lines.gpkg"):
        assert replay(out / name, inputs=tmp_path) == []
    assert "is not used" not in caplog.text, "nobody has set what no step of theirs uses"
    tiling = Tiling(size=6.0, workers=1)
    toolbox.run(model, {"points": feet, "surface": tmp_path / "tiles.tif"}, tiling=tiling)
    assert Raster.open(tmp_path / "tiles.tif").cell == 3.0


def test_the_default_in_metres_is_a_choice_of_data_in_feet(model: str, tmp_path: Path) -> None:
    feet, out = tmp_path / "feet.laz", tmp_path / "out"
    hill("EPSG:2263").save(feet)
    toolbox.run(model, {"points": feet, "shortest": 9.0, "deliver": out})
    assert "Shortest line 9 m (29.53 US ft)" in " ".join((out / "README.txt").read_text().split())


REPROJECTING = """
id: toy.metric
title: Hills in metres
inputs:
  points: {type: PointCloud, help: Points}
  cell: {type: number, default: 1.0, feet: 3, unit: m, gt: 0, help: Size of the cells}
steps:
  metric: {tool: points.reproject, points: {from: inputs.points}, crs: "EPSG:26918"}
  top: {tool: surface.grid, points: {from: metric.reprojected}, cell: {from: inputs.cell}}
outputs:
  surface: {from: top.surface, help: Heights}
"""


@pytest.mark.parametrize(("given", "cell"), [({}, 3 * FOOT), ({"cell": 1.0}, 1.0)])
def test_products_in_metres_of_data_in_feet_are_made_again(
    given: dict[str, Any], cell: float, tmp_path: Path
) -> None:
    """Given cells of 1 m were taken for the default, and made again of 3 ft."""
    feet, made, model = tmp_path / "feet.laz", tmp_path / "made.tif", tmp_path / "metric.yaml"
    model.write_text(REPROJECTING)
    points = hill("EPSG:2263")
    points.with_xyz(points.xyz + np.array([5e5, -4.2e6, 0])).save(feet)
    toolbox.run(str(model), {"points": feet, **given, "surface": made})
    assert Raster.open(made).cell == pytest.approx(cell)
    assert replay(made, inputs=tmp_path) == []


def test_defaults_in_feet_are_those_of_models_in_python_too(model: str) -> None:
    spec = catalog.load(model)
    assert spec.build({"points": hill("EPSG:2263")}).run().surface.cell == 3.0
    assert spec.build({"points": hill("EPSG:2263"), "cell": 2.0}).run().surface.cell != 3.0
    assert spec.build({"points": hill()}).run().surface.cell == 2.0


def test_settings_that_are_given_stay_metres_of_data_in_feet(model: str, tmp_path: Path) -> None:
    feet, made = tmp_path / "feet.laz", tmp_path / "made.tif"
    hill("EPSG:2263").save(feet)
    toolbox.run(model, {"points": feet, "cell": 2.0, "surface": made})
    assert Raster.open(made).cell == pytest.approx(2 / FOOT)
    assert replay(made, inputs=tmp_path) == []
    metres = tmp_path / "metres.tif"
    hill().save(tmp_path / "metres.laz")
    toolbox.run(model, {"points": tmp_path / "metres.laz", "cell": "3us-ft", "surface": metres})
    assert Raster.open(metres).cell == pytest.approx(3 * FOOT)
    assert replay(metres, inputs=tmp_path) == []


def test_options_of_a_file_are_those_of_its_format(
    model: str, points: Path, tmp_path: Path
) -> None:
    toolbox.run(model, {"points": points, "deliver": tmp_path / "out"})
    import rasterio

    with rasterio.open(tmp_path / "out" / "top.tif") as made:
        assert made.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"


def test_a_geopackage_has_styles_and_reads_as_without(
    model: str, points: Path, tmp_path: Path
) -> None:
    """QGIS draws contours as contours; nobody else takes the styles for data."""
    import pyogrio

    toolbox.run(model, {"points": points, "deliver": tmp_path / "out"})
    path = tmp_path / "out" / "lines.gpkg"
    with closing(sqlite3.connect(path)) as database:
        rows = database.execute(
            "SELECT f_table_name, f_geometry_column, useAsDefault, styleQML FROM layer_styles"
        ).fetchall()
    assert [row[:3] for row in rows] == [("contours", "geom", 1)]
    assert 'attr="is_index"' in rows[0][3]
    assert Vector.layers(path) == ("contours",)
    assert Table.layers(path) == ()
    assert pyogrio.list_layers(path)[0, 0] == "contours"
    assert len(pyogrio.read_dataframe(path, layer="contours")) == len(Vector.open(path)) == 7


def test_its_steps_run_only_when_asked_for(model: str, points: Path, tmp_path: Path) -> None:
    spec = catalog.load(model)
    assert isinstance(spec, Model)
    assert spec.extra == {"lines", "named"}
    assert set(spec.wanting([]).steps) == {"top"}
    assert set(spec.wanting(["lines.contours"]).steps) == {"top", "lines"}
    toolbox.run(
        model, {"points": points, "surface": tmp_path / "a.tif", "counts": tmp_path / "n.csv"}
    )
    assert set(pd.read_csv(tmp_path / "n.csv")["step"]) == {"top"}
    toolbox.run(model, {"points": points, "lines.contours": tmp_path / "b.gpkg"})
    assert (tmp_path / "b.gpkg").exists()


@pytest.mark.parametrize(("keep", "ran"), [((), ["top"]), (("lines.contours",), ["top", "lines"])])
def test_its_steps_stay_out_of_a_run_from_code(
    model: str, keep: tuple[str, ...], ran: list[str]
) -> None:
    """A ModelRun that is made and run without the files around it runs what is kept alone."""
    spec = catalog.load(model)
    assert isinstance(spec, Model)
    names: list[str] = []

    def noted(name: str, job: Any, ctx: Context) -> Any:
        names.append(name)
        return run_tool(name, job, ctx)

    job = spec.build({"points": hill()})
    found = dataclasses.replace(job, keep=frozenset(keep), runner=noted).run()
    assert names == ran
    assert set(vars(found)) == {"surface", "share", *keep}


def test_replay_does_not_warn_of_defaults_that_no_step_uses(
    model: str, points: Path, caplog: pytest.LogCaptureFixture
) -> None:
    made = points.with_name("made.tif")
    toolbox.run(model, {"points": points, "surface": made})
    assert replay(made, inputs=Path(model).parent) == []
    assert "is not used" not in caplog.text


def test_a_setting_of_its_steps_alone_is_told_to_be_idle(
    model: str, points: Path, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    toolbox.run(model, {"points": points, "interval": 2.0})
    assert "interval: is not used by any step that runs; it is for: Contours" in caplog.text
    caplog.clear()
    toolbox.run(model, {"points": points, "interval": 2.0, "deliver": tmp_path / "out"})
    assert "interval" not in caplog.text


def test_all_or_nothing(
    model: str, points: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise DataError("the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(Raster, "save", fail)
        with pytest.raises(DataError, match="the disk is full"):
            toolbox.run(model, {"points": points, "deliver": tmp_path / "out"})
    assert not (tmp_path / "out").exists()


def tree(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_set_goes_only_into_an_empty_folder_or_where_its_last_one_was(
    overwrite: bool, model: str, points: Path, tmp_path: Path
) -> None:
    """Files of other people were replaced where they had the name of one of the set."""
    out = tmp_path / "out"
    values = {"points": points, "deliver": out}
    out.mkdir()
    (out / ".DS_Store").write_text("of the system")
    (out / "top.tif").write_text("mine")
    (out / "README.txt").write_text("mine\n")
    before = tree(out)
    says = "deliver: .*out holds other files, such as README.txt, and no set of this toolbox: name"
    with pytest.raises(ParameterError, match=says):
        toolbox.run(model, values, overwrite=overwrite)
    assert tree(out) == before
    for name in ("top.tif", "README.txt"):
        (out / name).unlink()
    toolbox.run(model, values, overwrite=overwrite)


def test_a_set_replaces_the_files_of_its_last_one_alone(
    model: str, points: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    values: dict[str, Any] = {"points": points, "deliver": out}
    toolbox.run(model, values)
    sums = {f"{hashlib.sha256(content).hexdigest()}  {name}" for name, content in tree(out).items()}
    missing = sums - {*(out / "README.txt").read_text().splitlines()}
    assert [line.partition("  ")[2] for line in missing] == ["README.txt"]
    with pytest.raises(
        ParameterError, match=r"deliver: .* exist in .*; allow it with overwrite=True"
    ):
        toolbox.run(model, values)
    (out / "notes.txt").write_text("stay")
    (out / "top.tif.aux.xml").write_text("what a GIS has made to show it")
    before = tree(out)
    toolbox.run(model, {**values, "cell": 4.0}, overwrite=True)
    assert names(out) == FILES | {"notes.txt"}
    assert tree(out)["top.tif"] != before["top.tif"]
    text = Path(model).read_text().replace("file: top.tif", "file: highest.tif")
    Path(model).write_text(text)
    toolbox.run(model, values, overwrite=True)
    assert names(out) == (FILES - {"top.tif"}) | {"notes.txt", "highest.tif"}, "listed once"


@pytest.mark.parametrize(
    ("file", "says"),
    [
        ("lines.dxf", "lines.dxf in .*out was changed after the set had been written: move it"),
        (
            "README.txt",
            "README.txt in .*out was changed after the set had been written: name a new",
        ),
        ("lines.gpkg-wal", "lines.gpkg-wal in .*out is not of the set there: move it elsewhere"),
    ],
)
def test_files_of_a_set_that_somebody_has_changed_stay(
    file: str, says: str, model: str, points: Path, tmp_path: Path
) -> None:
    values = {"points": points, "deliver": tmp_path / "out"}
    toolbox.run(model, values)
    with (tmp_path / "out" / file).open("ab+") as there:
        there.seek(0)
        content = there.read()
        there.truncate(0)
        there.write(b"mine\n" + content)
    before = tree(tmp_path / "out")
    with pytest.raises(ParameterError, match=says):
        toolbox.run(model, values, overwrite=True)
    assert tree(tmp_path / "out") == before
    (tmp_path / "out" / file).rename(tmp_path / file)
    if file == "README.txt":
        return  # without it, nobody knows whose the others are
    toolbox.run(model, values, overwrite=True)
    assert names(tmp_path / "out") == FILES


def test_statistics_that_a_gis_adds_to_a_set_are_no_change(tmp_path: Path) -> None:
    """QGIS writes those of a raster into .aux.xml, which sets of older versions list."""
    raster, beside = tmp_path / "dtm.tif", tmp_path / "dtm.tif.aux.xml"
    raster.write_bytes(b"raster")
    beside.write_text("<PAMDataset/>")
    assert list(sealed.sums([beside, raster])) == ["dtm.tif"]
    lines = (f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.name}\n" for p in (raster, beside))
    text = sealed.sealed("".join(lines), "models.terrain")
    (tmp_path / "README.txt").write_text(text, newline="\n")
    beside.write_text("<PAMDataset><Statistics/></PAMDataset>")
    assert sealed.problem(tmp_path, "models.terrain", [raster, beside]) is None
    assert {*sealed.files_of(tmp_path)} == {raster, beside}, "both go with the set"
    raster.write_bytes(b"mine")
    assert "dtm.tif in" in (sealed.problem(tmp_path, "models.terrain", [raster]) or "")


def test_a_set_does_not_replace_that_of_another_tool(
    model: str, points: Path, tmp_path: Path
) -> None:
    values = {"points": points, "deliver": tmp_path / "out"}
    toolbox.run(model, values)
    Path(model).write_text(MODEL.replace("toy.hills", "toy.valleys"))
    with pytest.raises(ParameterError, match=r"out holds the set of toy\.hills: name a new or an"):
        toolbox.run(model, values, overwrite=True)


def test_files_that_appear_while_a_set_is_made_stay(
    model: str, points: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = ModelRun.run

    def meanwhile(self: ModelRun, *args: Any) -> Any:
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "top.tif").write_text("mine")
        return run(self, *args)

    monkeypatch.setattr(ModelRun, "run", meanwhile)
    with pytest.raises(DataError, match=r"such as top\.tif, and no set of this toolbox"):
        toolbox.run(model, {"points": points, "deliver": tmp_path / "out"}, overwrite=True)
    assert tree(tmp_path / "out") == {"top.tif": b"mine"}


def test_what_would_be_empty_is_left_out_and_takes_an_earlier_one_with_it(
    model: str, points: Path, tmp_path: Path
) -> None:
    values: dict[str, Any] = {"points": points, "deliver": tmp_path / "out"}
    toolbox.run(model, values)
    toolbox.run(model, {**values, "interval": 500.0}, overwrite=True)
    assert names(tmp_path / "out") == FILES - {"lines.gpkg", "lines.kmz", "lines.dxf"}
    text = (tmp_path / "out" / "README.txt").read_text()
    assert "- lines.gpkg, contours (Lines): it would be empty" in " ".join(text.split())


def test_a_set_does_not_go_into_a_folder_that_is_read(
    model: str, points: Path, tmp_path: Path
) -> None:
    """The next run would read its points, too; a folder of other files is none for a set."""
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.laz").hardlink_to(points)
    with pytest.raises(ParameterError, match=r"deliver: .*in is a folder of the inputs"):
        toolbox.run(model, {"points": tmp_path / "in", "deliver": tmp_path / "in"})
    with pytest.raises(
        ParameterError, match=r"deliver: .*in holds .* as a.laz, and no set of this"
    ):
        toolbox.run(model, {"points": tmp_path / "in" / "a.laz", "deliver": tmp_path / "in"})


@pytest.mark.parametrize(
    ("folder", "says"),
    [
        ("no/where/out", "there is no folder"),
        ("hill.laz", "is a file, not a folder"),
        ("hill.laz/out", r"hill\.laz is a file, not a folder"),
        ("", "path of a folder"),
    ],
)
def test_bad_folders(model: str, points: Path, tmp_path: Path, folder: str, says: str) -> None:
    path = tmp_path / folder if folder else ""
    with pytest.raises(ParameterError, match=says):
        toolbox.run(model, {"points": points, "deliver": path})


def test_tools_without_a_set_say_so(points: Path, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="declares no set of files"):
        toolbox.run("surface.grid", {"points": points, "deliver": tmp_path / "out"})


def test_what_needs_a_place_on_the_earth_is_left_out(model: str, tmp_path: Path) -> None:
    hill("local").save(tmp_path / "hill.laz")
    toolbox.run(
        model, {"points": tmp_path / "hill.laz", "deliver": tmp_path / "out"}, assume_crs="local"
    )
    assert names(tmp_path / "out") == FILES - {"lines.kmz"}
    text = (tmp_path / "out" / "README.txt").read_text()
    assert "- lines.kmz (Lines for Google Earth): the data have no CRS of the Earth" in text


def test_a_client_is_not_told_what_to_install(
    model: str,
    points: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Who runs it is told before the work; the set only says that the file was not made."""
    paper = "    - {file: a.pdf, from: page, help: Paper}\n"
    Path(model).write_text(MODEL + paper)
    monkeypatch.setattr("toolbox.data.extras.find_spec", lambda name: None)
    seen: list[str] = []
    ctx = Context(report=lambda share: seen.append(caplog.text))
    with caplog.at_level("INFO", "toolbox"):
        toolbox.run(model, {"points": points, "deliver": tmp_path / "out"}, ctx=ctx)
    told = "a.pdf will be left out: PDF needs weasyprint: pip install weasyprint"
    assert told in seen[0], "before anything is read"
    assert names(tmp_path / "out") == FILES
    text = (tmp_path / "out" / "README.txt").read_text()
    assert "- a.pdf (Paper): it was not made on this computer" in text
    for file in ("README.txt", "report.html"):
        assert "pip install" not in (tmp_path / "out" / file).read_text()


QUALITY = """
    quality: {tool: points.survey_quality, points: {from: inputs.points}}
    ground: {tool: ground.classify, points: {from: inputs.points}}
"""
"""A step on the whole survey and one on each tile, which both say something in words."""


def test_the_same_in_tiles(points: Path, tmp_path: Path) -> None:
    from toolbox.tiles.tiling import Tiling

    path = tmp_path / "hills.yaml"
    text = MODEL.replace("\n    named:", QUALITY + "    named:")
    for result in ("quality.density", "ground.ground"):
        suffix = "tif" if result == "quality.density" else "laz"
        text += f"    - {{file: {result}.{suffix}, from: {result}, help: More}}\n"
    path.write_text(text)
    values = {"points": points, "page": tmp_path / "a.html"}
    tiling = Tiling.parse({"tile": 20, "workers": 1})
    found = toolbox.run(str(path), {**values, "deliver": tmp_path / "tiled"}, tiling=tiling)
    expected = toolbox.run(str(path), {"points": points, "deliver": tmp_path / "whole"})
    assert list(expected) == ["surface", "share", "deliver"]
    assert list(found) == ["surface", "page", "deliver"], "a share is not known from tiles"
    more = {"quality.density.tif", "ground.ground.laz"}
    assert names(tmp_path / "tiled") == names(tmp_path / "whole") == FILES | more
    tiled, whole = (
        " ".join((tmp_path / name / "README.txt").read_text().split())
        for name in ("tiled", "whole")
    )
    for said in (
        "Coordinates EPSG:32635 WGS 84 / UTM zone 35N",
        "Date of the survey not known",
        "pulses per square metre",
        "voids, be they water or not.",
        "How far all heights are off was not tested, as no checkpoints were given: compare",
        "The ground filter, which does not look for water, found ",
    ):
        assert said in tiled
        assert said in whole
    assert "tile by tile" not in tiled
    bands = [Raster.open(tmp_path / name / "top.tif").band() for name in ("tiled", "whole")]
    assert np.array_equal(*bands, equal_nan=True)


@pytest.mark.parametrize("tiled", [False, True])
def test_a_layer_of_a_step_that_is_off_is_not_said_to_be_there(
    tiled: bool, model: str, points: Path, tmp_path: Path
) -> None:
    """The README of a town in tiles named a layer of water that nobody had looked for."""
    from toolbox.tiles.tiling import Tiling

    more = "    more: {tool: surface.contours, when: {from: inputs.more}, "
    more += "surface: {from: top.surface}}"
    text = MODEL.replace("    named:", f"{more}\n    named:")
    text = text.replace(
        "steps:\n  top", "  more: {type: boolean, default: false, help: More}\nsteps:\n  top"
    )
    text += "    - {file: lines.gpkg, from: more.contours, layer: more, help: More lines}\n"
    Path(model).write_text(text)
    tiling = Tiling.parse({"tile": 20, "workers": 1}) if tiled else None
    toolbox.run(model, {"points": points, "deliver": tmp_path / "out"}, tiling=tiling)
    files, _, left_out = (tmp_path / "out" / "README.txt").read_text().partition("Left out\n")
    assert "contours: Lines [number of lines: 7]" in files
    assert "More lines" not in files
    why = " ".join(left_out.split())
    assert "lines.gpkg, more (More lines): nothing of this kind was asked for or found" in why


def test_the_same_bytes_again_and_by_replay(
    model: str, points: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    for folder in ("a", "b"):
        toolbox.run(model, {"points": points, "deliver": tmp_path / folder})
    for file in FILES:
        one, other = ((tmp_path / folder / file).read_bytes() for folder in ("a", "b"))
        assert one == other, file
    lines = Vector.open(tmp_path / "a" / "lines.gpkg").frame
    assert (lines["elevation"] == lines["elevation"].round(3)).all()
    for file in ("top.tif", "lines.gpkg"):
        assert replay(tmp_path / "a" / file, inputs=tmp_path) == []


def test_kmz_has_folders_and_styles(model: str, points: Path, tmp_path: Path) -> None:
    toolbox.run(model, {"points": points, "deliver": tmp_path / "out"})
    with zipfile.ZipFile(tmp_path / "out" / "lines.kmz") as archive:
        assert archive.namelist() == ["doc.kml", "files/dot.png"]
        text = archive.read("doc.kml").decode()
    assert "<name>contours</name>" in text
    assert text.count("#style0") == text.count("<Placemark") == 7


def test_command_line_and_help(
    model: str, points: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = os.fspath(tmp_path / "out")
    assert main(["run", model, "--points", str(points), "--deliver", out, "--title", "A hill"]) == 0
    told = capsys.readouterr().out
    assert (tmp_path / "out" / "README.txt").read_text().startswith("A hill\n======\n")
    assert f"deliver: {out}" in told
    (tmp_path / "out" / "mine.laz").write_text("was there")
    assert main(["run", model, "--points", str(points), "--deliver", out, "--overwrite"]) == 0
    assert "mine.laz" not in capsys.readouterr().out
    files = ", ".join(sorted(FILES))
    assert f"in {out}: {files}\n" in told
    assert "README.txt" in files
    assert main(["describe", model]) == 0
    assert "report.html, tables.xlsx, top.tif" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("file: top.tif", "file: top.gpkg", "'top.gpkg' cannot hold a Raster"),
        ("from: surface,", "from: nothing,", "nothing called 'nothing'"),
        ("cog: true", "layer: a", "no option 'layer'"),
        ("cog: true", "colour: red", "unknown word"),
        ("file: lines.kmz", "file: report.html", "cannot hold"),
        ("file: tables.xlsx", "file: report.html", "'report.html' is declared twice"),
        ("{from: top.filled_share", "{from: lines.levels", "made only where it is handed over"),
        ("    lines: {", "    top: {", "is the name of another step too"),
    ],
)
def test_mistakes_in_a_model(tmp_path: Path, old: str, new: str, says: str) -> None:
    path = tmp_path / "hills.yaml"
    assert old in MODEL
    path.write_text(MODEL.replace(old, new))
    with pytest.raises(ParameterError, match=says):
        catalog.load(str(path))


def test_the_readme_says_how_many_points_were_taken_out(points: Path, tmp_path: Path) -> None:
    path = tmp_path / "hills.yaml"
    low = "    low: {tool: points.filter, points: {from: inputs.points}, where: z < 101}\n"
    all_of = "    every: {tool: points.filter, points: {from: inputs.points}, where: z < 999}\n"
    text = MODEL.replace("    named:", f"{low}{all_of}    named:")
    for step in ("low", "every"):
        text += f"    - {{file: {step}.laz, from: {step}.kept, help: Points {step}}}\n"
    path.write_text(text)
    toolbox.run(str(path), {"points": points, "deliver": tmp_path / "out"})
    kept = len(PointCloud.open(tmp_path / "out" / "low.laz"))
    said = (tmp_path / "out" / "README.txt").read_text()
    told = f"Points low [{kept:,}]; {1600 - kept:,} of the points that were read are not in it"
    assert told in said
    assert "Points every [1,600]\n" in said


@pytest.mark.parametrize("asked", [False, True])
def test_what_asks_for_it_is_in_the_report_of_the_set(
    asked: bool, model: str, points: Path, tmp_path: Path
) -> None:
    line = "layer: contours, help: Lines}"
    text = MODEL.replace(line, f"in_report: {str(asked).lower()}, {line}")
    assert text != MODEL
    Path(model).write_text(text)
    toolbox.run(model, {"points": points, "deliver": tmp_path / "out"})
    report = (tmp_path / "out" / "report.html").read_text()
    assert ("<h2>Contours</h2>" in report) == asked


def test_a_set_that_would_say_nothing_is_not_handed_over(
    model: str, points: Path, tmp_path: Path
) -> None:
    """A terrain without a cell, and clearances of a survey without a wire, were whole sets."""
    Path(model).write_text(
        MODEL.replace("layer: contours, help", "layer: contours, needed: true, help")
    )
    values = {"points": points, "deliver": tmp_path / "out"}
    with pytest.raises(
        DataError, match=r"nothing to hand over: lines.gpkg would be empty \(Lines\)"
    ):
        toolbox.run(model, {**values, "interval": 1000.0})
    assert not (tmp_path / "out").exists()
    toolbox.run(model, values)


def test_whether_it_is_in_the_report_is_true_or_false(model: str) -> None:
    Path(model).write_text(MODEL.replace("help: Lines}", "help: Lines, in_report: once}"))
    with pytest.raises(ParameterError, match="in_report must be true or false, got 'once'"):
        catalog.load(model)


def test_an_input_may_have_another_value_for_the_set_unless_it_is_given(
    model: str, points: Path, tmp_path: Path
) -> None:
    def cells(name: str, **given: Any) -> int:
        path = Path(model).with_name(f"{name}.yaml")
        text = Path(model).read_text().replace("deliver:\n", "deliver:\n  values: {cell: 5}\n")
        path.write_text(text)
        asked = {"deliver": tmp_path / name} if name != "alone" else {}
        toolbox.run(
            str(path), {"points": points, "surface": tmp_path / f"{name}.tif"} | asked | given
        )
        return Raster.open(tmp_path / f"{name}.tif").shape[0]

    assert [cells("alone"), cells("set"), cells("given", cell=4.0)] == [20, 8, 10]
    wrong = Path(model).with_name("wrong.yaml")
    wrong.write_text(MODEL.replace("deliver:\n", "deliver:\n  values: {cel: 5, interval: -1}\n"))
    with pytest.raises(ParameterError) as told:
        toolbox.run(str(wrong), {"points": points})
    assert set(told.value.problems) == {"deliver.values.cel", "deliver.values.interval"}


def test_heights_of_a_set_that_are_measured_from_nothing_known_are_told(
    model: str, points: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A level that no gauge can be compared with was handed over without a word."""
    caplog.set_level("INFO", "toolbox")
    toolbox.run(model, {"points": points, "deliver": tmp_path / "a"})
    assert "the data state no height system" in caplog.text
    assert "assume_crs EPSG:32635+EPSG:CODE" in caplog.text
    papers = [(tmp_path / "a" / name).read_text() for name in ("README.txt", "report.html")]
    for text in papers:
        assert "state no height system" in text
        assert "EPSG:CODE" not in text, "how to run it again is not for a client"
    caplog.clear()
    said = {"assume_crs": "EPSG:32635+5773"}
    toolbox.run(model, {"points": points, "deliver": tmp_path / "b"}, **said)
    assert "no height system" not in caplog.text
    assert "EGM96 height" in (tmp_path / "b" / "README.txt").read_text()
    caplog.clear()
    toolbox.run(model, {"points": points, "surface": tmp_path / "s.tif"})
    assert "no height system" not in caplog.text, "nothing is handed over"


@pytest.mark.parametrize(
    ("crs", "advice"),
    [
        (CRS("ESRI:102008"), "assume_crs ESRI:102008+EPSG:CODE"),
        (CRS("+proj=tmerc +lon_0=33.3 +x_0=500000"), "assume_crs 'COMPOUNDCRS[...]' (WKT)"),
    ],
)
def test_the_advice_on_heights_fits_the_crs(
    crs: CRS, advice: str, caplog: pytest.LogCaptureFixture
) -> None:
    """CRS without a code were told one that had nothing to do with them."""
    caplog.set_level("INFO", "toolbox")
    delivery.tell_heights(crs)
    assert advice in caplog.text
    wkt = CompoundCRS("with heights", [crs, CRS("EPSG:5703")]).to_wkt()
    followed = f"{crs_text(crs)}+EPSG:5703" if "CODE" in advice else wkt
    caplog.clear()
    delivery.tell_heights(assumed(crs, followed))
    assert caplog.text == ""


def test_drawings_have_the_title_of_the_model_in_the_language_of_the_user() -> None:
    """The title block of a Turkish set said "Survey of façades" where no title was given."""
    spec = catalog.load("models.facade")
    with language.speaking("tr"):
        assert delivery._said(spec, {})["title"] == "Cephe rölövesi"
        assert delivery._said(spec, {"title": "Town hall"})["title"] == "Town hall"
    assert delivery._said(spec, {})["title"] == spec.title
