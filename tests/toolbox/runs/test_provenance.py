"""Every product says how it was made, and can be made again from that."""

from __future__ import annotations

import dataclasses
import functools
import gc
import hashlib
import json
import shutil
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pandas as pd
import pytest
import shapely
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st

import toolbox
from toolbox import catalog
from toolbox.cli import replay as replaying
from toolbox.cli.replay import COMPARE, FIND, replay
from toolbox.context import Context
from toolbox.data import PointCloud, Raster, Table, Vector
from toolbox.data.crs import LOCAL, crs_text, parse_crs, same_crs
from toolbox.data.reading import Reading
from toolbox.data.record import read_record
from toolbox.data.survey import Survey
from toolbox.errors import Cancelled, DataError, ParameterError
from toolbox.runs import lineage, origins
from toolbox.runs.lineage import describe_inputs
from toolbox.runs.provenance import Count, Input, Record, read
from toolbox.runs.source import of_run
from toolbox.tiles.tiling import Tiling

CRS = parse_crs("EPSG:2154+5720")


def cloud(seed: int = 1, size: int = 4000) -> PointCloud:
    """A slope with a roof, in two classes."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 60, (2, size))
    z = x / 10 + rng.normal(0, 0.02, size)
    roof = (abs(x - 30) < 6) & (abs(y - 30) < 6)
    z[roof] += 7
    xyz = np.column_stack([x + 700_000, y + 6_600_000, z]).round(2)
    attributes = {"classification": np.where(roof, 6, 2), "intensity": rng.integers(0, 500, size)}
    return PointCloud(xyz, attributes, crs=CRS)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with points, in which products are made."""
    cloud().save(tmp_path / "a.laz")
    return tmp_path


def grid(folder: Path, name: str = "dtm.tif", **more: Any) -> Path:
    values = {"points": folder / "a.laz", "cell": 2, "method": "nearest", "surface": folder / name}
    toolbox.run("surface.grid", values | more, overwrite=True)
    return folder / name


def record_of(path: Path) -> Record:
    found = read(path)
    assert found is not None
    return found


def test_what_a_record_says(folder: Path) -> None:
    record = record_of(grid(folder))
    content = (folder / "a.laz").read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    assert (record.tool, record.version) == ("surface.grid", toolbox.__version__)
    assert record.inputs == {"points": (Input("a.laz", digest, len(content)),)}
    spec = catalog.load("surface.grid")
    assert record.parameters.keys() == spec.inputs.keys() - spec.sources.keys()
    assert (record.parameters["cell"], record.parameters["method"]) == (2, "nearest")
    assert record.parameters["power"] == spec.inputs["power"].default == 2
    assert (record.output, record.crs, record.ancestors) == ("surface", "EPSG:2154+5720", {})
    cells = int(np.isfinite(Raster.open(folder / "dtm.tif").band()).sum())
    assert Count("surface.grid", "points", 4000) in record.counts
    assert Count("surface.grid", "surface", cells) in record.counts
    assert "surface of surface.grid" in record.text()
    assert "a.laz" in record.text()


def test_a_record_does_not_depend_on_where_and_when(folder: Path, tmp_path: Path) -> None:
    """No folder, time, user, order of arguments or name of the product."""
    first = read_record(grid(folder))
    elsewhere = tmp_path / "else where"
    elsewhere.mkdir()
    shutil.copy(folder / "a.laz", elsewhere)
    values = {"surface": elsewhere / "b.tif", "method": "nearest", "cell": "2"}
    values["points"] = {"path": str(elsewhere / "a.laz")}
    toolbox.run("surface.grid", values, picture=elsewhere / "b.png")
    assert read_record(elsewhere / "b.tif") == first
    assert str(folder) not in first
    assert (elsewhere / "b.tif").read_bytes() == (folder / "dtm.tif").read_bytes()


@pytest.mark.parametrize(
    ("tool", "values", "name"),
    [
        ("points.filter", {"where": "intensity > 40"}, "kept.laz"),
        ("points.filter", {"where": "intensity > 40"}, "kept.csv"),
        ("surface.grid", {"method": "nearest"}, "surface.tif"),
        ("surface.grid", {"method": "nearest"}, {"path": "surface.tif", "cog": True}),
        ("ground.csf", {}, "classified.laz"),
        ("points.info", {}, "table.csv"),
        ("compare.classes", {"reference": "a.laz"}, "confusion.json"),
        ("points.height_above_ground", {}, "heights.laz"),
        ("samples.scene", {"size": 50, "density": 2, "seed": 7}, "points.laz"),
    ],
    ids=str,
)
def test_runs_agree_byte_for_byte_and_can_be_replayed(
    tool: str, values: dict[str, Any], name: Any, folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    how = name if isinstance(name, dict) else {"path": name}
    output = how["path"].partition(".")[0]
    spec = catalog.load(tool)
    files = {n: folder / v if n == "reference" else v for n, v in values.items()}
    files |= {"points": folder / "a.laz"} if "points" in spec.sources else {}
    made = []
    for run in ("first", "second"):
        (folder / run).mkdir()
        target = how | {"path": folder / run / how["path"]}
        toolbox.run(tool, files | {output: target}, picture=folder / run / "map.png")
        made.append({path.name: path.read_bytes() for path in (folder / run).iterdir()})
    assert made[0] == made[1]
    for product in (folder / "first" / how["path"], folder / "first" / "map.png"):
        if not product.exists():  # a table is not drawn
            continue
        caplog.clear()
        with caplog.at_level("INFO", "toolbox"):
            assert replay(product, inputs=folder) == []
        assert "the same, byte for byte" in caplog.text


def test_a_changed_product_is_told_from_the_run(folder: Path) -> None:
    path = grid(folder)
    record = read_record(path)
    raster = Raster.open(path)
    values = raster.values.copy()
    values[0, 3, 4:6] += [0.25, 1.5]
    dataclasses.replace(raster, values=values).save(path, record=record, overwrite=True)
    assert replay(path) == ["band 1: 2 of 900 cells differ by up to 1.5"]
    dataclasses.replace(raster, values=values[:, 1:]).save(path, record=record, overwrite=True)
    assert replay(path)[0].startswith("(1, 29, 30) cells of 2 from")


def test_changed_points_are_told_from_the_run(folder: Path) -> None:
    values = {"points": folder / "a.laz", "where": "intensity > 40", "kept": folder / "b.laz"}
    toolbox.run("points.filter", values)
    points, record = PointCloud.open(folder / "b.laz"), read_record(folder / "b.laz")
    labels = points["classification"].copy()
    labels[[5, 9, 11]] = 1
    moved = points.xyz.copy()
    moved[7, 2] += 0.5
    changed = points.with_attributes({"classification": labels, "more": labels}).with_xyz(moved)
    changed.save(folder / "b.laz", record=record, overwrite=True)
    count = len(points)
    z, classes, more = replay(folder / "b.laz")
    assert z == f"z: 1 of {count} points differ by up to 0.5"
    assert classes.startswith(f"classification: 3 of {count} points differ by up to ")
    assert more == "more: is missing"
    points.select(labels != 1).save(folder / "b.laz", record=record, overwrite=True)
    assert replay(folder / "b.laz") == [f"{count - 3} points, now {count}"]


def test_changed_tables_are_told_from_the_run(folder: Path) -> None:
    toolbox.run("points.info", {"points": folder / "a.laz", "table": folder / "b.csv"})
    record = read_record(folder / "b.csv")
    frame = Table.open(folder / "b.csv").frame
    Table(frame.iloc[1:]).save(folder / "b.csv", record=record, overwrite=True)
    assert replay(folder / "b.csv") == [f"{len(frame) - 1} rows, now {len(frame)}"]
    frame.loc[2, "value"] = "other"
    Table(frame).save(folder / "b.csv", record=record, overwrite=True)
    assert replay(folder / "b.csv") == [f"value: 1 of {len(frame)} rows differ"]


def test_another_version_is_told(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = grid(folder)
    assert replay(path) == []
    assert "was made by version" not in caplog.text
    old = dataclasses.replace(record_of(path), version="0.0.1")
    Raster.open(path).save(path, record=old.to_json(), overwrite=True)
    assert replay(path) == []
    assert f"was made by version 0.0.1; this is {toolbox.__version__}" in caplog.text


def test_the_same_content_in_other_bytes(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = grid(folder)
    record = read_record(path)
    Raster.open(path).save(path, cog=True, overwrite=True, record=record)
    with caplog.at_level("INFO", "toolbox"):
        assert replay(path) == []
    assert "the content is the same, but not every byte" in caplog.text


def test_inputs_that_are_missing_or_have_changed_are_named(folder: Path) -> None:
    cloud().save(folder / "truth.laz")
    values = {"points": folder / "a.laz", "reference": folder / "truth.laz"}
    toolbox.run("compare.classes", values | {"confusion": folder / "b.csv"})
    (folder / "truth.laz").unlink()
    cloud(3).save(folder / "a.laz", overwrite=True)
    with pytest.raises(DataError) as caught:
        replay(folder / "b.csv")
    assert caught.value.problems.keys() == {"points", "reference"}
    assert "a.laz in" in caught.value.problems["points"]
    assert "has changed since" in caught.value.problems["points"]
    assert "there is no file truth.laz" in caught.value.problems["reference"]


def test_inputs_are_found_below_a_folder_by_their_content(folder: Path) -> None:
    path = grid(folder)
    (folder / "x" / "y").mkdir(parents=True)
    shutil.move(folder / "a.laz", folder / "x" / "y" / "a.laz")
    cloud(3).save(folder / "x" / "a.laz")  # another one of the same name
    assert replay(path, inputs=folder / "x") == []
    for lost in (folder / "z", folder / "x" / "a.laz"):
        with pytest.raises(ParameterError, match=f"inputs: there is no folder {lost}"):
            replay(path, inputs=[folder / "x", lost])
    with pytest.raises(DataError, match=r"no file a\.laz in"):
        replay(path)


def test_how_an_input_was_opened(folder: Path) -> None:
    points = cloud().xyz
    np.savetxt(folder / "a.txt", np.column_stack([points, np.arange(4000)]), fmt="%.2f")
    how = {"path": folder / "a.txt", "columns": "x,y,z,intensity"}
    how["bounds"] = "700000,6600000,700030,6600030"
    values = {"points": how, "method": "nearest", "surface": folder / "b.tif"}
    toolbox.run("surface.grid", values, assume_crs="EPSG:2154")
    record = record_of(folder / "b.tif")
    assert record.inputs["points"][0].options == {
        "columns": ["x", "y", "z", "intensity"],
        "bounds": [700000.0, 6600000.0, 700030.0, 6600030.0],
    }
    assert (record.assume_crs, record.crs) == ("EPSG:2154", "EPSG:2154")
    assert replay(folder / "b.tif") == []


def test_a_product_of_a_product_has_ancestors(folder: Path) -> None:
    values = {"points": folder / "a.laz", "where": "z < 20", "kept": folder / "b.laz"}
    toolbox.run("points.filter", values)
    toolbox.run("ground.csf", {"points": folder / "b.laz", "classified": folder / "c.laz"})
    values = {"points": folder / "c.laz", "method": "nearest", "surface": folder / "d.tif"}
    toolbox.run("surface.grid", values)
    record = record_of(folder / "d.tif")
    hashes = [hashlib.sha256((folder / f).read_bytes()).hexdigest() for f in ("c.laz", "b.laz")]
    assert list(record.ancestors) == hashes
    assert [entry["tool"] for entry in record.ancestors.values()] == ["ground.csf", "points.filter"]
    assert record.ancestors[hashes[0]]["inputs"]["points"][0]["sha256"] == hashes[1]
    assert "c.laz: classified of ground.csf" in record.text()
    assert "b.laz: kept of points.filter" in record.text()
    for product in ("b.laz", "c.laz", "d.tif"):
        assert replay(folder / product) == []


def test_several_files_of_a_survey(folder: Path) -> None:
    (folder / "tiles").mkdir()
    for number in range(3):
        cloud(number).save(folder / "tiles" / f"{number}.laz")
    grid(folder, points=folder / "tiles")
    record = record_of(folder / "dtm.tif")
    assert [item.file for item in record.inputs["points"]] == ["0.laz", "1.laz", "2.laz"]
    assert replay(folder / "dtm.tif", inputs=folder / "tiles") == []


@pytest.mark.slow
def test_one_of_a_folder_of_files(folder: Path) -> None:
    """Its record says for which file of the survey it was made, in whatever tiles."""
    (folder / "tiles").mkdir()
    for number in range(2):
        cloud(number).save(folder / "tiles" / f"{number}.laz")
    values = {"points": folder / "tiles", "kept": f"{folder / 'out'}/", "where": "z < 3"}
    tiling = Tiling.parse({"tile": 20, "workers": 1})
    toolbox.run("points.filter", values, tiling=tiling)
    record = record_of(folder / "out" / "1.laz")
    assert (record.output, record.file) == ("kept", "1.laz")
    assert replay(folder / "out" / "1.laz", inputs=folder / "tiles") == []
    points = PointCloud.open(folder / "out" / "1.laz")
    points.select(np.arange(9)).save(
        folder / "out" / "1.laz", record=record.to_json(), overwrite=True
    )
    (text,) = replay(folder / "out" / "1.laz", inputs=folder / "tiles")
    assert text == f"9 points, now {len(points)}"


@pytest.mark.slow
def test_a_run_in_tiles_has_the_same_record(folder: Path) -> None:
    values = {"points": folder / "a.laz", "where": "z < 3"}
    toolbox.run("points.filter", values | {"kept": folder / "whole.laz"})
    tiling = Tiling.parse({"tile": 20, "workers": 1})
    toolbox.run("points.filter", values | {"kept": folder / "tiled.laz"}, tiling=tiling)
    assert (folder / "whole.laz").read_bytes() == (folder / "tiled.laz").read_bytes()


def test_very_many_files_are_one_line(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lineage, "MANY", 2)
    (folder / "tiles").mkdir()
    for number in range(3):
        cloud(number).save(folder / "tiles" / f"{number}.laz")
    grid(folder, points=folder / "tiles")
    (item,) = record_of(folder / "dtm.tif").inputs["points"]
    lines = "".join(
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n"
        for path in sorted((folder / "tiles").iterdir())
    )
    digest = hashlib.sha256(lines.encode()).hexdigest()
    assert (item.file, item.files, item.sha256) == ("*.laz", 3, digest)
    assert replay(folder / "dtm.tif", inputs=folder / "tiles") == []
    cloud(4).save(folder / "tiles" / "3.laz", overwrite=True)
    with pytest.raises(DataError, match="has changed since"):
        replay(folder / "dtm.tif", inputs=folder / "tiles")


def test_a_model_and_its_steps(folder: Path) -> None:
    path = folder / "lowest.yaml"
    path.write_text(
        "id: my.lowest\ntitle: Grid of what is low\n"
        "inputs:\n  points: {type: PointCloud, help: Points}\n"
        "steps:\n  low:\n    tool: points.filter\n    points: {from: inputs.points}\n"
        "    where: z < 3\n  dtm:\n    tool: surface.grid\n    points: {from: low.kept}\n"
        "    method: nearest\noutputs:\n  dtm: {from: dtm.surface}\n"
    )
    values = {"points": folder / "a.laz", "dtm": folder / "dtm.tif", "low.kept": folder / "b.laz"}
    toolbox.run(str(path), values)
    record = record_of(folder / "dtm.tif")
    assert record.tool == "my.lowest"
    assert record.model == lineage.describe_files([path])
    low = len(PointCloud.open(folder / "b.laz"))
    assert Count("low", "points", 4000) in record.counts
    assert Count("dtm", "points", low) in record.counts
    assert replay(folder / "dtm.tif") == replay(folder / "b.laz") == []
    for name, place in [("a.laz", "survey"), ("lowest.yaml", "models"), ("dtm.tif", "made")]:
        (folder / place).mkdir()
        shutil.copy(folder / name, folder / place / name)
    product = folder / "made" / "dtm.tif"
    assert replay(product, inputs=[folder / "survey", folder / "models"]) == []
    with pytest.raises(DataError, match=r"no file lowest\.yaml in .*made and in .*survey or below"):
        replay(product, inputs=folder / "survey")
    path.write_text(path.read_text().replace("z < 3", "z < 4"))
    with pytest.raises(DataError, match=r"model: lowest\.yaml .* has changed since"):
        replay(folder / "dtm.tif")


LAYERS = {
    "points": cloud(),
    "raster": Raster(np.arange(6.0).reshape(2, 3), Affine(1, 0, 0, 0, -1, 0), crs=CRS),
    "vector": Vector(geopandas.GeoDataFrame({"n": [1]}, geometry=[shapely.Point(1, 2)], crs=2154)),
    "table": Table(pd.DataFrame({"n": [1, 2]})),
}


def test_layers_in_memory_are_known_by_their_content(folder: Path) -> None:
    grid(folder, points=cloud())
    (item,) = record_of(folder / "dtm.tif").inputs["points"]
    assert (item.file, item.bytes, item.in_memory) == ("in memory", None, True)
    for points, same in [
        (cloud(), True),
        (cloud().with_attributes({"intensity": np.zeros(4000, int)}), False),
        (cloud().with_crs(LOCAL), False),
        (cloud(2), False),
    ]:
        grid(folder, "other.tif", points=points)
        (other,) = record_of(folder / "other.tif").inputs["points"]
        assert (other == item) is same
    with pytest.raises(DataError, match="points: was a layer in memory"):
        replay(folder / "dtm.tif")


def test_a_chain_in_memory_says_its_steps_and_is_run_again(folder: Path) -> None:
    thin = toolbox.run("points.thin", {"points": folder / "a.laz", "cell": 1})
    low = toolbox.run("points.filter", {"points": thin.thinned, "classes": (2,)})
    path = grid(folder, points=low.kept)
    record = record_of(path)
    near, far = record.ancestors.values()
    assert (near["tool"], near["output"]) == ("points.filter", "kept")
    assert near["parameters"]["classes"] == "2"
    assert near["counts"][1] == {"step": "points.filter", "name": "kept", "count": len(low.kept)}
    (item,) = far["inputs"]["points"]
    digest = lineage.describe_files([folder / "a.laz"]).sha256
    assert (far["tool"], item["file"], item["sha256"]) == ("points.thin", "a.laz", digest)
    assert "in memory: kept of points.filter" in record.text()
    assert replay(path) == []
    cloud(2).save(folder / "a.laz", overwrite=True)
    with pytest.raises(DataError) as caught:
        replay(path)
    (name,) = caught.value.problems
    assert name == "points, ..., points.thin.points"


def low_points(folder: Path) -> PointCloud:
    made = toolbox.run("points.filter", {"points": folder / "a.laz", "classes": (2,)}).kept
    assert isinstance(made, PointCloud)
    return made


def test_a_replay_of_a_chain_shows_its_progress_and_stops(folder: Path) -> None:
    path = grid(folder, points=low_points(folder))
    seen: list[float] = [0]
    assert replay(path, ctx=Context(seen.append)) == []
    assert seen == sorted(seen)
    first = (FIND, (FIND + COMPARE) / 2)  # of two runs
    assert any(first[0] < fraction < first[1] for fraction in seen)
    del seen[1:]
    with pytest.raises(Cancelled):
        replay(path, ctx=Context(seen.append, lambda: seen[-1] > FIND))
    assert seen[-1] < first[1]


def test_a_step_that_several_need_is_run_again_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    low = low_points(folder)
    values = {"points": low, "reference": low, "confusion": folder / "b.csv"}
    toolbox.run("compare.classes", values)
    ran = []

    def noted(tool: str, *values: Any, **how: Any) -> Any:
        ran.append(tool)
        return toolbox.run(tool, *values, **how)

    monkeypatch.setattr(replaying, "run", noted)
    assert replay(folder / "b.csv") == []
    assert ran == ["points.filter", "compare.classes"]


def test_of_several_layers_the_one_that_was_handed_on_is_made_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(replaying, "run", lambda *_, **__: {"kept": ("one", "two")})
    record = dataclasses.replace(with_ancestors(0), output="kept", number=2)
    assert replaying._Step(record, "points.filter", {}).run({}, Context()) == "two"


@pytest.mark.parametrize(
    ("sha256", "omitted", "text"),
    [
        ("f" * 64, 0, "which no run of the toolbox made"),
        ("f" * 64, 305, "its record had no room: at least 305 were left out"),
        ("", 305, "what it was made of had changed"),
    ],
)
def test_why_a_layer_in_memory_is_not_made_again(
    sha256: str, omitted: int, text: str, tmp_path: Path
) -> None:
    inputs = {"points": (Input("in memory", sha256, None),)}
    record = dataclasses.replace(with_ancestors(0), inputs=inputs, omitted=omitted)
    Table(pd.DataFrame({"n": [1]})).save(tmp_path / "a.csv", record=record.to_json())
    with pytest.raises(DataError, match=text):
        replay(tmp_path / "a.csv")


def test_what_was_changed_in_python_is_not_of_the_tool(folder: Path) -> None:
    thinned = toolbox.run("points.thin", {"points": folder / "a.laz", "cell": 1}).thinned
    path = grid(folder, points=thinned.select(thinned["classification"] == 2))
    assert record_of(path).ancestors == {}
    with pytest.raises(DataError, match="points: was a layer in memory, which no run"):
        replay(path)


def test_a_file_that_changed_before_the_product_was_made_is_told(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    thinned = toolbox.run("points.thin", {"points": folder / "a.laz", "cell": 1}).thinned
    cloud(2, 3000).save(folder / "a.laz", overwrite=True)
    assert record_of(grid(folder, points=thinned)).ancestors == {}
    assert "a.laz changed after a run had read it; how a layer in memory was" in caplog.text


def test_a_layer_whose_file_changed_before_the_product_was_made_is_told(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    survey = Survey.open(folder / "a.laz")
    known = origins.of(survey)
    assert origins.of(survey) is known
    cloud(2, 3000).save(folder / "a.laz", overwrite=True)
    assert known.sha256 == ""
    assert "a.laz changed after a run had read it" in caplog.text
    assert len(origins.of(survey).sha256) == 64


def test_an_unknown_layer_has_no_hash_in_the_text() -> None:
    inputs = {"points": (Input("in memory", "", None),)}
    text = dataclasses.replace(with_ancestors(0), inputs=inputs).text()
    assert "points: in memory, made of what has changed since" in text
    assert "sha256" not in text


def test_layers_in_memory_are_hashed_when_a_record_is_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hashed: list[Any] = []
    content_hash = origins.content_hash
    monkeypatch.setattr(
        origins, "content_hash", lambda *given: hashed.append(given) or content_hash(*given)
    )
    points, survey = cloud(), Survey.open(folder / "a.laz")
    for _ in range(2):
        low = toolbox.run("points.filter", {"points": points, "classes": (2,)}).kept
    known = origins.of(survey)
    del survey
    assert known.held
    assert not hashed
    grid(folder, points=low)
    assert len(hashed) == 1


def test_a_layer_that_is_gone_is_known_by_its_content(folder: Path) -> None:
    points = cloud()
    expected = origins.of(cloud()).sha256
    low = toolbox.run("points.filter", {"points": points, "classes": (2,)}).kept
    known = origins.of(points)
    del points
    gc.collect()
    assert known.held is None
    (near,) = record_of(grid(folder, points=low)).ancestors.values()
    assert near["inputs"]["points"][0]["sha256"] == expected


def test_layers_are_forgotten_when_they_go() -> None:
    points = cloud(size=40)
    origins.of(points)
    identity = id(points)
    assert identity in origins._known
    del points
    gc.collect()
    assert identity not in origins._known


def test_a_layer_that_is_handed_through_keeps_the_run_that_made_it() -> None:
    points, first = cloud(size=40), origins.Origin()
    origins.remember(points, first)
    origins.remember(points, origins.Origin())
    assert origins.of(points) is first


def test_ancestors_without_room_are_left_out_at_once() -> None:
    def step(before: origins.Origin) -> origins.Origin:
        def describe() -> Record:
            inputs = {"points": (Input("in memory", before.sha256, None),)}
            ancestors, omitted = lineage._ancestors([], [before], Reading())
            record = dataclasses.replace(with_ancestors(0), inputs=inputs, ancestors=ancestors)
            return dataclasses.replace(record, omitted=omitted)

        return origins.Origin(describe, (before,))

    last = functools.reduce(lambda one, _: step(one), range(300), origins.Origin())
    record = last.record
    assert record is not None
    assert len(json.dumps(dict(record.ancestors), separators=(",", ":"))) <= 60_000
    assert 50 < len(record.ancestors) < 250
    assert record.omitted == 299 - len(record.ancestors)


def test_a_chain_in_memory_holds_none_of_its_layers(folder: Path) -> None:
    points = cloud(size=40)
    first = weakref.ref(points)
    for _ in range(2):
        points = toolbox.run("points.filter", {"points": points, "classes": (2, 6)}).kept
    gc.collect()
    assert first() is None
    assert len(record_of(grid(folder, points=points)).ancestors) == 2


def test_a_chain_in_memory_may_be_long() -> None:
    def step(before: origins.Origin) -> origins.Origin:
        def describe() -> Record:
            inputs = {"points": (Input("in memory", before.sha256, None),)}
            return Record(version="1", tool="a.b", title="", parameters={}, inputs=inputs)

        return origins.Origin(describe, (before,))

    last = functools.reduce(lambda one, _: step(one), range(1000), origins.Origin())
    assert len(last.sha256) == 64


def test_content_of_every_kind_of_layer() -> None:
    hashes = {name: origins.content_hash(layer, Reading()) for name, layer in LAYERS.items()}
    assert len(set(hashes.values())) == len(LAYERS)
    assert hashes == {name: origins.of(layer).sha256 for name, layer in LAYERS.items()}
    other = Vector(LAYERS["vector"].frame.assign(n=2))
    assert origins.content_hash(other, Reading()) != hashes["vector"]


def test_a_shapefile_is_all_its_parts(tmp_path: Path) -> None:
    path = tmp_path / "a.shp"
    LAYERS["vector"].save(path)
    before = lineage.describe_files([path])
    assert (before.file, before.files) == ("a.shp", 5)
    (tmp_path / "a.qix").write_text("an index that a GIS has added")
    assert lineage.describe_files([path]) == before
    frame = LAYERS["vector"].frame.assign(n=2)
    Vector(frame).save(path, overwrite=True)
    assert lineage.describe_files([path]) != before


def test_nothing_is_hashed_where_nothing_is_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: Any) -> None:
        raise AssertionError

    toolbox.run("points.info", {"points": folder / "a.laz"})  # kernels are hashed when compiled
    monkeypatch.setattr(hashlib, "sha256", never)
    assert toolbox.run("points.info", {"points": folder / "a.laz"})["table"]


def test_files_that_cannot_be_read_are_named_by_source(folder: Path) -> None:
    values = {"points": cloud(), "template": folder, "surface": folder / "b.tif"}
    with pytest.raises(DataError) as caught:
        toolbox.run("surface.grid", values)
    assert caught.value.problems.keys() == {"template"}


def test_hashing_reports_progress_and_stops(tmp_path: Path) -> None:
    path = tmp_path / "big.laz"
    path.write_bytes(bytes(20_000_000))
    seen: list[float] = []
    spec = catalog.load("points.filter")
    sources = of_run({"points": path}, spec)
    describe_inputs(spec, sources, Reading(), Context(seen.append))
    assert seen == sorted(seen)
    assert len(seen) > 4
    with pytest.raises(Cancelled):
        describe_inputs(spec, sources, Reading(), Context(stop=lambda: len(seen) > 4))


def with_ancestors(count: int) -> Record:
    entry = Record(version="1", tool="a.b", title="A", parameters={}, inputs={}).entry()
    ancestors = {f"{number:064x}": entry for number in range(count)}
    return Record(
        version="1", tool="a.b", title="A", parameters={}, inputs={}, ancestors=ancestors, omitted=2
    )


def test_the_oldest_ancestors_make_room() -> None:
    assert Record.from_json(with_ancestors(50).to_json()) == with_ancestors(50)
    text = with_ancestors(1000).to_json()
    assert 59_000 < len(text.encode()) <= 60_000
    found = Record.from_json(text)
    kept = len(found.ancestors)
    assert found.omitted == 1000 - kept + 2
    assert list(found.ancestors) == list(with_ancestors(kept).ancestors)
    assert f"and at least {found.omitted} files before" in found.text()


@given(
    st.dictionaries(
        st.text(max_size=5),
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    )
)
def test_every_parameter_comes_back(parameters: dict[str, Any]) -> None:
    record = dataclasses.replace(with_ancestors(1), parameters=parameters)
    assert Record.from_json(record.to_json()) == record
    record.to_json().encode("ascii")  # a text chunk of a PNG holds no more


def test_damaged_records_are_refused(tmp_path: Path) -> None:
    Table(pd.DataFrame({"n": [1]})).save(tmp_path / "a.csv", record='{"lidar-toolbox": 1}')
    for attempt in (read, replay):
        with pytest.raises(DataError, match=r"a\.csv: the record is damaged"):
            attempt(tmp_path / "a.csv")
    Table(pd.DataFrame({"n": [1]})).save(tmp_path / "a.csv", overwrite=True)
    assert read(tmp_path / "a.csv") is None
    with pytest.raises(DataError, match="carries no record"):
        replay(tmp_path / "a.csv")


def test_a_forged_record_does_no_harm(folder: Path) -> None:
    """It names another file to write, or one elsewhere to read."""
    path = grid(folder)
    entry = json.loads(read_record(path))
    parameters = entry["parameters"] | {"surface": str(folder / "harm.tif")}
    (folder / "sub").mkdir()
    inside = {"file": "sub/../a.laz"}
    for forged, message in [
        ({"parameters": parameters, "output": "picture"}, "does not fit surface.grid"),
        ({"output": "cell"}, "does not fit surface.grid"),
        ({"inputs": {"points": [entry["inputs"]["points"][0] | inside]}}, "no file"),
    ]:
        Raster.open(path).save(path, record=json.dumps(entry | forged), overwrite=True)
        with pytest.raises(DataError, match=message):
            replay(path)
    assert not (folder / "harm.tif").exists()


def test_a_forged_record_that_is_its_own_source_is_refused(folder: Path) -> None:
    """It was followed until Python gave up."""
    path = grid(folder, points=toolbox.run("points.thin", {"points": folder / "a.laz"}).thinned)
    entry = json.loads(read_record(path))
    (thinned,) = entry["ancestors"].values()
    thinned["inputs"] = entry["inputs"]
    Raster.open(path).save(path, record=json.dumps(entry), overwrite=True)
    with pytest.raises(DataError, match="points: is made of itself"):
        replay(path)


@pytest.mark.parametrize(
    "text", ["", "EPSG:2154", "EPSG:2154+5720", "local", "EPSG:4326", "ESRI:102100"]
)
def test_crs_as_text(text: str) -> None:
    crs = parse_crs(text) if text else None
    assert crs_text(crs) == text
    assert same_crs(parse_crs(crs_text(crs)) if text else None, crs)


def test_a_crs_that_only_looks_like_its_code_is_given_as_wkt() -> None:
    crs = parse_crs(parse_crs("EPSG:2154").to_wkt().replace("700000", "700001"))
    assert crs_text(crs).startswith("PROJCRS[")
    assert same_crs(parse_crs(crs_text(crs)), crs)


@pytest.mark.slow
def test_real_points(data: Callable[[str], Path], tmp_path: Path) -> None:
    source = next(iter(sorted(data("isprs_samples_labelled_laz").glob("*.laz"))))
    values = {"points": source, "classified": tmp_path / "b.laz"}
    toolbox.run("ground.csf", values, assume_crs="local")
    assert replay(tmp_path / "b.laz", inputs=source.parent) == []


def test_side_cars_of_others_are_not_replaced(folder: Path) -> None:
    (folder / "b.csv.json").write_text("{}")
    values = {"points": folder / "a.laz", "table": folder / "b.csv"}
    with pytest.raises(ParameterError, match=r"b\.csv\.json stands where its record"):
        toolbox.run("points.info", values, overwrite=True)
    (folder / "b.csv.json").unlink()
    for run in range(2):
        toolbox.run("points.info", values, overwrite=bool(run))
    assert record_of(folder / "b.csv").tool == "points.info"


@pytest.mark.slow
def test_several_outputs_in_one_geopackage(folder: Path) -> None:
    cloud(seed=2).save(folder / "b.laz", overwrite=True)
    values = {"points": folder / "a.laz", "reference": folder / "b.laz", "max_distance": 5.0}
    place = folder / "all.gpkg"
    targets = {"table": {"path": place, "layer": "rates"}, "strata": place}
    written = toolbox.run("compare.classes", {**values, "positive": "2", **targets})
    assert written["table"] == written["strata"] == place
    record = read(place)
    assert record is not None
    assert (record.output, record.options) == ("table", {"layer": "rates"})
    assert record.layers == {"strata": {"layer": "strata"}}
    assert len(Table.open(place, layer="rates")) > 5
    assert replay(place) == []
    rows = Table.open(place, layer="strata")
    Table(rows.frame.assign(points=0)).save(place, layer="strata", add=True, overwrite=True)
    assert [text.partition(":")[0] for text in replay(place)] == ["strata, points"]


def test_two_outputs_cannot_be_one_layer(folder: Path) -> None:
    place = {"path": folder / "all.gpkg", "layer": "rates"}
    values = {"points": folder / "a.laz", "reference": folder / "a.laz", "positive": "2"}
    with pytest.raises(ParameterError, match=r"strata: layer RATES of .*all.gpkg is also that of"):
        toolbox.run(
            "compare.classes", {**values, "table": place, "strata": {**place, "layer": "RATES"}}
        )
    styles = {"path": folder / "all.gpkg", "layer": "Layer_Styles"}
    with pytest.raises(
        ParameterError, match=r"QGIS keeps styles in the layer Layer_Styles; choose"
    ):
        toolbox.run("compare.classes", {**values, "strata": styles})
    with pytest.raises(ParameterError, match=r"errors: cannot write .gpkg"):
        toolbox.run("compare.classes", {**values, "table": place, "errors": folder / "all.gpkg"})
