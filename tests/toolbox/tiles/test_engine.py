"""Surveys in tiles: the same products as of the whole, whatever the tiles and the failures."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import laspy
import numpy as np
import pytest
from affine import Affine
from filelock import FileLock
from pyproj import CRS

import toolbox
from toolbox import PointCloud, Raster, Survey, Vector, catalog
from toolbox.context import Context
from toolbox.data import Lattice
from toolbox.errors import Cancelled, DataError, ParameterError
from toolbox.tiles import engine, plan
from toolbox.tiles import tiling as options
from toolbox.tiles.plan import TilePlan, as_model
from toolbox.tiles.tiling import LEAST, Tiling, memory_of
from toolbox.tiles.workers import processes

GIB = 2**30
MODEL = """
id: models.testing
title: A chain for tests
inputs:
  points: {type: PointCloud, help: Points}
  gap: {type: number, default: 8, unit: m, help: Gap}
steps:
  clean: {tool: points.denoise, points: {from: inputs.points}, reach: 3}
  low: {tool: points.filter, points: {from: clean.clean}, where: classification == 2}
  terrain:
    tool: surface.grid
    points: {from: low.kept}
    max_gap: {from: inputs.gap}
  top: {tool: surface.grid, points: {from: clean.clean}, method: max}
  heights: {tool: surface.difference, surface: {from: top.surface}, base: {from: terrain.surface}}
  whole: {tool: surface.grid, points: {from: low.kept}, cell: 2}
outputs:
  clean: {from: clean.clean}
  noise: {from: clean.high_noise}
  removed: {from: low.removed_share}
  dtm: {from: terrain.surface}
  dsm: {from: top.surface}
  ndsm: {from: heights.difference}
  hull: {from: whole.surface}
"""


@pytest.fixture(scope="module")
def tiling() -> Iterator[Tiling]:
    """Tiles of 37 m on two workers that all tests share."""
    with processes(2, 4 * GIB) as workers, pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "workers_of", lambda tiling: nullcontext(workers))
        yield Tiling(37.0, 2, 4 * GIB)


def ground(rng: np.random.Generator, west: float, south: float, crs: CRS | None) -> PointCloud:
    """60 x 60 m of slope with a block and a bird."""
    n = 4000
    x, y = rng.uniform(0, 60, (2, n))
    z = 0.05 * x + rng.normal(0, 0.03, n)
    block = (abs(x - 55) < 9) & (abs(y - 30) < 12)
    z[block] += 6
    z[:3] += 60
    classes = np.where(block, 6, 2).astype(np.uint8)
    xyz = np.column_stack([x + west, y + south, z]).round(3)
    columns = {"classification": classes, "intensity": rng.integers(0, 900, n).astype("u2")}
    return PointCloud(xyz, columns, crs=crs)


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three files around a missing one; the first two overlap by 5 m."""
    folder = tmp_path_factory.mktemp("survey")
    rng, crs = np.random.default_rng(3), CRS(32635)
    for name, west, south in [("a", 0, 0), ("b", 55, 0), ("c", 0, 60)]:
        path = folder / f"{name}.laz"
        ground(rng, 500_000 + west, 4_600_000 + south, crs).save(path)
        content = bytearray(path.read_bytes())
        content[8:24] = uuid.UUID(int=ord(name)).bytes_le
        path.write_bytes(content)
    return folder


@pytest.fixture
def model(tmp_path: Path) -> str:
    path = tmp_path / "testing.yaml"
    path.write_text(MODEL)
    return str(path)


def header(path: Path) -> laspy.LasHeader:
    with laspy.open(path) as stream:
        return stream.header


def files(folder: Path) -> dict[str, str]:
    """The names of the files of a folder, with what tells their contents from others."""
    paths = sorted(folder.iterdir())
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


@pytest.mark.parametrize("before", [(plan, "surveys_of"), (engine, "Crew")])  # headers, points
def test_an_input_that_changes_during_the_run_is_an_error(
    before: tuple[ModuleType, str],
    survey: Path,
    tiling: Tiling,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Not a mixture, with the hash of the old file in its record."""
    folder = tmp_path / "survey"
    shutil.copytree(survey, folder)
    real = getattr(*before)

    def changing(*arguments: Any) -> Any:
        shutil.copy(folder / "a.laz", folder / "c.laz")
        return real(*arguments)

    monkeypatch.setattr(*before, changing)
    values = {"points": folder, "where": "z > 1", "kept": tmp_path / "k.laz"}
    with pytest.raises(DataError, match=r"c\.laz changed while the run was reading"):
        toolbox.run("points.filter", values, tiling=tiling)
    assert not (tmp_path / "k.laz").exists()
    assert not list(tmp_path.glob(".tiles-*/points/points_2_*"))  # nothing that --resume could take


@pytest.mark.slow
@pytest.mark.parametrize("size", [37.0, 130.0, 400.0])
def test_a_model_in_tiles_gives_the_files_of_the_whole(
    size: float, model: str, survey: Path, tiling: Tiling, tmp_path: Path
) -> None:
    """Points, rasters, numbers, results in between, and steps that need the whole cloud."""
    results = {}
    for how in (None, replace(tiling, size=size)):
        out = tmp_path / ("tiles" if how else "whole")
        out.mkdir()
        names = {
            "clean": "c.laz",
            "dtm": "t.tif",
            "dsm": "s.tif",
            "ndsm": "n.tif",
            "hull": "h.tif",
            "low.kept": "k.las",
        }
        values = {name: out / file for name, file in names.items()}
        result = toolbox.run(model, {"points": survey, **values}, tiling=how)
        results[out.name] = {"noise": result["noise"], "removed": result["removed"]}
    assert results["tiles"] == results["whole"]
    assert results["whole"]["noise"] >= 9
    whole, tiles = files(tmp_path / "whole"), files(tmp_path / "tiles")
    assert whole.keys() == tiles.keys()
    for name in whole:
        if name.endswith(".tif"):
            one, other = (
                Raster.open(tmp_path / "whole" / name),
                Raster.open(tmp_path / "tiles" / name),
            )
            assert one.bounds == other.bounds
            np.testing.assert_array_equal(one.values, other.values)
        assert whole[name] == tiles[name], name


def test_a_folder_gets_a_file_for_each_file_with_its_own_header(
    survey: Path, tiling: Tiling, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    values = {"points": survey, "where": "classification == 2", "kept": f"{out}/"}
    assert toolbox.run("points.filter", values, tiling=tiling)["kept"] == out
    assert sorted(files(out)) == ["a.laz", "b.laz", "c.laz"]
    for path in sorted(survey.iterdir()):
        alone = toolbox.run("points.filter", {**values, "points": path, "kept": None})["kept"]
        found = PointCloud.open(out / path.name)
        np.testing.assert_array_equal(found.xyz, alone.xyz)
        np.testing.assert_array_equal(found["intensity"], alone["intensity"])
        assert header(out / path.name).uuid == header(path).uuid
    with pytest.raises(ParameterError, match="exists; allow it with overwrite=True"):
        toolbox.run("points.filter", values, tiling=tiling)


@pytest.mark.slow
def test_other_formats_and_feet(tiling: Tiling, tmp_path: Path) -> None:
    """A text file has no header; lengths are metres whatever the unit."""
    cloud = ground(np.random.default_rng(1), 0, 0, None)
    cloud.with_xyz(cloud.xyz * 3).save(tmp_path / "a.csv")
    values = {"points": tmp_path / "a.csv", "method": "max", "cell": 2}
    found = {}
    for how in (None, replace(tiling, size=11.0)):
        out = tmp_path / f"{how is None}.tif"
        toolbox.run("surface.grid", {**values, "surface": out}, assume_crs="EPSG:2263", tiling=how)
        found[how is None] = Raster.open(out)
    np.testing.assert_array_equal(found[True].values, found[False].values)
    assert found[True].bounds == found[False].bounds


def test_mixed_formats_and_empty_files(survey: Path, tiling: Tiling, tmp_path: Path) -> None:
    mixed = tmp_path / "mixed"
    mixed.mkdir()
    for path in survey.iterdir():
        cloud = PointCloud.open(path)
        more = {"red": np.arange(len(cloud), dtype=np.uint16)} if path.stem == "b" else {}
        cloud.with_attributes(more).save(mixed / path.name)
    cloud.select([]).save(mixed / "empty.laz")
    values = {"points": mixed, "where": "z < 20"}
    for name, how in [("whole.laz", None), ("tiles.laz", tiling)]:
        toolbox.run("points.filter", values | {"kept": tmp_path / name}, tiling=how)
    assert (tmp_path / "whole.laz").read_bytes() == (tmp_path / "tiles.laz").read_bytes()


def test_a_part_of_a_survey(survey: Path, tiling: Tiling, tmp_path: Path) -> None:
    part = {"path": survey, "bounds": [500_010, 4_600_010, 500_030.5, 4_600_100]}
    whole = toolbox.run("points.filter", {"points": part, "where": "z < 20"})
    out = tmp_path / "kept.laz"
    toolbox.run("points.filter", {"points": part, "where": "z < 20", "kept": out}, tiling=tiling)
    np.testing.assert_array_equal(PointCloud.open(out).xyz, whole["kept"].xyz)


@pytest.mark.parametrize("bounds", [None, [770_505, 6_277_505, 770_525, 6_277_545]])
def test_copc_in_tiles(
    bounds: list[float] | None, data: Callable[[str], Path], tiling: Tiling, tmp_path: Path
) -> None:
    path = data("copc/ign_77050_627755_ground.copc.laz")
    points = {"path": path} | ({"bounds": bounds} if bounds else {})
    whole = toolbox.run(
        "points.filter", {"points": points, "where": "z < 99"}, assume_crs="EPSG:2154"
    )
    out = tmp_path / "kept.laz"
    values = {"points": points, "where": "z < 99", "kept": out}
    how = replace(tiling, size=13.0)
    toolbox.run("points.filter", values, assume_crs="EPSG:2154", tiling=how)
    np.testing.assert_array_equal(PointCloud.open(out).xyz, whole["kept"].xyz)


@pytest.mark.slow
def test_a_tile_with_nothing_to_do(survey: Path, tiling: Tiling, tmp_path: Path) -> None:
    """Far from all ground lie points that no step after the filter has any use for."""
    path = tmp_path / "chain.yaml"
    path.write_text(
        MODEL.replace("gap: {type: number, default: 8", "gap: {type: number, default: 2")
    )
    folder = tmp_path / "far"
    folder.mkdir()
    for file in survey.iterdir():
        shutil.copy(file, folder)
    cloud = ground(np.random.default_rng(5), 500_400, 4_600_000, CRS(32635))
    cloud.with_attributes({"classification": np.full(len(cloud), 9, "u1")}).save(folder / "z.laz")
    names = {"dtm": "t.tif", "ndsm": "n.tif"}
    for how in (None, tiling):
        targets = {name: tmp_path / f"{how is None}_{file}" for name, file in names.items()}
        toolbox.run(str(path), {"points": folder, **targets}, tiling=how)
    for file in names.values():
        whole, tiles = (Raster.open(tmp_path / f"{how}_{file}") for how in (True, False))
        x, y = np.meshgrid(*Lattice.of(whole).centres())  # tiles end where nothing more is known
        np.testing.assert_array_equal(whole.band(), tiles.sample(x, y))


def test_a_raster_that_no_tile_has_data_for_says_why(
    survey: Path, tiling: Tiling, tmp_path: Path
) -> None:
    given = {"points": survey, "classes": [99], "max_gap": 8, "surface": tmp_path / "terrain.tif"}
    why = r"surface: no tile has data for it \(surface.grid: points: none is of class 99"
    with pytest.raises(DataError, match=why):
        toolbox.run("surface.grid", given, tiling=tiling)
    assert not (tmp_path / "terrain.tif").exists()


def test_a_corrupt_file_among_good_ones(survey: Path, tiling: Tiling, tmp_path: Path) -> None:
    """Tiles near it fail by name, the files of others are there, and the run says what to do."""
    bad = tmp_path / "bad"
    bad.mkdir()
    for path in survey.iterdir():
        content = path.read_bytes()
        broken = content[: len(content) // 2] + bytes(200) + content[len(content) // 2 + 200 :]
        (bad / path.name).write_bytes(broken if path.name == "c.laz" else content)
    values = {"points": bad, "where": "z < 20", "kept": f"{tmp_path}/out/"}
    with pytest.raises(DataError) as caught:
        toolbox.run("points.filter", values, tiling=replace(tiling, size=20.0))
    assert re.search(r"tile 230003_25000 \(500000, 4600060, .*c.laz is damaged", str(caught.value))
    assert "--resume" in str(caught.value)
    assert "b.laz" in files(tmp_path / "out")
    assert "c.laz" not in files(tmp_path / "out")
    kept = tmp_path / "kept.laz"
    with pytest.raises(DataError, match="damaged"):
        toolbox.run("points.filter", values | {"kept": kept}, tiling=tiling)
    assert not kept.exists()


@pytest.mark.parametrize(
    ("id", "values", "message"),
    [
        ("surface.grid", {"surface": "o.tif"}, "tile: the whole cloud is needed .*without max_gap"),
        ("points.filter", {"where": "z > 1", "kept": "a.laz"}, "also an input"),
        ("points.filter", {"where": "z > 1", "kept": "x.shp"}, "cannot write .shp"),
    ],
)
def test_what_cannot_be_run_in_tiles(
    id: str, values: dict[str, Any], message: str, survey: Path, tiling: Tiling
) -> None:
    paths = {n: survey / v if "." in str(v) and n != "where" else v for n, v in values.items()}
    before = files(survey)
    with pytest.raises(ParameterError, match=message):
        toolbox.run(id, {"points": survey, **paths}, tiling=tiling, overwrite=True)
    assert files(survey) == before


def test_a_raster_without_a_single_value_is_told(
    survey: Path, tiling: Tiling, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    values = {"points": survey, "surface": tmp_path / "s.tif", "cell": 1, "method": "nearest"}
    for max_gap, told in ((2.0, False), (1e-6, True)):
        toolbox.run("surface.grid", values | {"max_gap": max_gap}, tiling=tiling, overwrite=True)
        assert ("not a single cell has a value in: surface" in caplog.text) == told


def test_files_of_one_name_are_not_written_over_each_other(
    survey: Path, tiling: Tiling, tmp_path: Path
) -> None:
    twin = tmp_path / "a.laz"
    shutil.copy(survey / "b.laz", twin)
    values = {"points": [survey / "a.laz", twin], "where": "z < 20"}
    with pytest.raises(ParameterError, match=r"a\.laz and .*a\.laz would both become"):
        toolbox.run("points.filter", {**values, "kept": f"{tmp_path}/out/"}, tiling=tiling)
    with pytest.raises(ParameterError, match="there is no folder"):
        toolbox.run("points.filter", {**values, "kept": f"{tmp_path}/no/out/"}, tiling=tiling)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_points_on_the_edge_of_tiles_count_once(tiling: Tiling, tmp_path: Path) -> None:
    xy = np.mgrid[0:12, 0:12].reshape(2, -1).T + np.array([500_000.0, 4_600_000])
    PointCloud(np.column_stack([xy, xy[:, 0]]), crs=CRS(32635)).save(tmp_path / "a.laz")
    values = {"points": tmp_path / "a.laz", "returns": "all"}
    for size in (1.0, 2.0, 3.7):
        how = replace(tiling, size=size)
        assert toolbox.run("points.info", {"points": values["points"]}, tiling=how)["count"] == 144


PASSES = """
id: my.passes
title: Local, whole, local, whole
inputs: {points: {type: PointCloud, help: Points}}
steps:
  low: {tool: points.filter, points: {from: inputs.points}, where: classification == 2}
  hull: {tool: shoreline.alpha_shape, points: {from: low.kept}, alpha: 5}
  inside: {tool: points.clip, points: {from: inputs.points}, polygons: {from: hull.shapes}}
  within: {tool: points.clip, points: {from: low.kept}, polygons: {from: hull.shapes}}
  top: {tool: surface.grid, points: {from: within.clipped}, max_gap: 8}
  again: {tool: shoreline.alpha_shape, points: {from: within.clipped}, alpha: 4}
outputs:
  inside: {from: inside.clipped}
  removed: {from: within.removed_share}
  dtm: {from: top.surface}
  shapes: {from: hull.shapes}
  again: {from: again.shapes}
  area: {from: again.area}
"""


@pytest.mark.slow
@pytest.mark.parametrize("size", [37.0, 400.0])
def test_steps_that_wait_for_the_whole_run_on_tiles_in_another_pass(
    size: float, survey: Path, tiling: Tiling, tmp_path: Path
) -> None:
    path = tmp_path / "passes.yaml"
    path.write_text(PASSES)
    names = {"inside": "i.laz", "dtm": "d.tif", "shapes": "s.gpkg", "again": "a.gpkg"}
    files = {name: tmp_path / file for name, file in names.items()}
    found = toolbox.run(str(path), {"points": survey, **files}, tiling=replace(tiling, size=size))
    whole = toolbox.run(str(path), {"points": survey})
    assert found["area"] == whole["area"]
    assert found["removed"] == pytest.approx(whole["removed"])
    inside = PointCloud.open(files["inside"])
    np.testing.assert_array_equal(inside.xyz, whole["inside"].xyz)
    assert 0 < len(inside) < Survey.open(survey).count
    np.testing.assert_array_equal(Raster.open(files["dtm"]).values, whole["dtm"].values)
    for name in ("shapes", "again"):
        assert Vector.open(files[name]).frame.geometry.equals(whole[name].frame.geometry)


@pytest.mark.slow
def test_steps_on_the_whole_are_run_again_where_a_run_goes_on(
    survey: Path, tiling: Tiling, tmp_path: Path
) -> None:
    """What they need of earlier parts is kept: their shapes were empty."""
    path = tmp_path / "passes.yaml"
    path.write_text(PASSES)
    files = {"dtm": tmp_path / "d.tif", "shapes": tmp_path / "s.gpkg", "again": tmp_path / "a.gpkg"}
    values = {"points": survey, **files}
    seen = [0.0]
    ctx = Context(seen.append, lambda: seen[-1] > 0.95)  # while products are written
    with pytest.raises(Cancelled):
        toolbox.run(str(path), values, tiling=tiling, ctx=ctx)
    assert list(tmp_path.glob(".tiles-*/1/tiles/*"))
    found = toolbox.run(str(path), values, tiling=tiling, resume=True)
    whole = toolbox.run(str(path), {"points": survey})
    assert found["area"] == whole["area"]
    np.testing.assert_array_equal(Raster.open(files["dtm"]).values, whole["dtm"].values)
    for name in ("shapes", "again"):
        assert Vector.open(files[name]).frame.geometry.equals(whole[name].frame.geometry)


def test_repeated_steps_are_not_cut(survey: Path, tiling: Tiling, tmp_path: Path) -> None:
    path = tmp_path / "repeated.yaml"
    path.write_text(
        "{id: my.repeated, title: Two sizes, inputs: {points: {type: PointCloud, help: Points}},"
        "steps: {low: {tool: points.filter, points: {from: inputs.points}, where: z < 20},"
        "grid: {tool: surface.grid, repeat: cell, cell: [1, 2], method: max,"
        "points: {from: low.kept}}}, outputs: {dsm: {from: grid.surface}}}"
    )
    values = {"points": survey, "dsm": tmp_path / "d.tif"}
    found = toolbox.run(str(path), values, tiling=tiling)["dsm"]
    whole = toolbox.run(str(path), {"points": survey})["dsm"]
    assert [file.name for file in found] == ["d_1.tif", "d_2.tif"]
    for file, raster in zip(found, whole, strict=True):
        np.testing.assert_array_equal(Raster.open(file).values, raster.values)


def test_resume_begins_anew_if_another_layer_has_changed(
    survey: Path, tiling: Tiling, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """What a killed run has left belongs to the contents of all files."""
    template = toolbox.run("surface.grid", {"points": survey, "method": "max", "cell": 2})
    out, other = tmp_path / "o.tif", tmp_path / "template.tif"
    values = {"points": survey, "method": "max", "template": other, "surface": out}
    raster = template["surface"]
    raster.save(other)
    with pytest.raises(DataError, match="must be that of the template"):
        toolbox.run("surface.grid", values, tiling=tiling)
    shutil.rmtree(next(tmp_path.glob(".tiles-*")))
    values["cell"] = 2
    for number, shift in enumerate((0.0, 1.0)):
        moved = raster.transform @ Affine.translation(shift / 2, 0)
        replace(raster, transform=moved).save(other, overwrite=True)
        begun = lambda before=number: len(list(tmp_path.glob(".tiles-*"))) > before  # noqa: E731
        ctx = Context(lambda fraction: None, begun)
        with pytest.raises(Cancelled):
            toolbox.run("surface.grid", values, tiling=tiling, resume=True, ctx=ctx)
        said = "stopped; --resume goes on from here, with what is kept in"
        assert f"{said} {tmp_path}{os.sep}.tiles-" in caplog.text
    toolbox.run("surface.grid", values, tiling=tiling, resume=True)
    whole = toolbox.run("surface.grid", values | {"surface": None})["surface"]
    np.testing.assert_array_equal(Raster.open(out).values, whole.values)


@pytest.mark.slow
def test_what_runs_with_other_tiles_have_left_is_told(
    survey: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A run with another size of tiles cannot go on from there, and does not remove it."""
    values = {"points": survey, "method": "max", "cell": 2, "surface": tmp_path / "o.tif"}
    begun = Context(lambda fraction: None, lambda: bool(list(tmp_path.glob(".tiles-*"))))
    with pytest.raises(Cancelled):
        toolbox.run("surface.grid", values, tiling=Tiling(37.0, 1), ctx=begun)
    (left,) = tmp_path.glob(".tiles-*")
    assert "have left" not in caplog.text
    toolbox.run("surface.grid", values, tiling=Tiling(60.0, 1), resume=True)
    assert "nothing to go on with for these settings and data" in caplog.text
    assert f"stopped runs with others have left {left.name}" in caplog.text
    caplog.clear()
    with FileLock(left / "lock"):  # it is at work
        toolbox.run("surface.grid", values, tiling=Tiling(60.0, 1), overwrite=True)
    assert "have left" not in caplog.text
    assert list(tmp_path.glob(".tiles-*")) == [left]
    toolbox.run("surface.grid", values, tiling=Tiling(37.0, 1), overwrite=True, resume=True)
    assert "have left" not in caplog.text
    assert not list(tmp_path.glob(".tiles-*"))


def test_another_layer_that_changes_between_tiles_is_an_error(
    survey: Path, tiling: Tiling, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each worker reads it anew."""
    other = tmp_path / "template.tif"
    grid = {"points": survey, "method": "max", "cell": 2}
    toolbox.run("surface.grid", grid | {"surface": other})
    os.utime(other, (1000, 1000))
    real = engine.Crew.run_pass

    def changing(*arguments: Any) -> None:
        real(*arguments)
        shutil.copy(other, tmp_path / "copy.tif")
        (tmp_path / "copy.tif").replace(other)

    monkeypatch.setattr(engine.Crew, "run_pass", changing)
    with pytest.raises(DataError, match=r"template\.tif changed while the run was reading"):
        toolbox.run(
            "surface.grid", grid | {"template": other, "surface": tmp_path / "o.tif"}, tiling=tiling
        )
    assert not (tmp_path / "o.tif").exists()


def test_points_in_memory_and_without_metres(survey: Path, tiling: Tiling, tmp_path: Path) -> None:
    cloud = ground(np.random.default_rng(1), 0, 0, None)
    cloud.save(tmp_path / "a.laz")
    values: dict[str, Any] = {"where": "z > 1"}
    with pytest.raises(DataError, match="no survey in files"):
        toolbox.run("points.filter", values | {"points": cloud}, tiling=tiling)
    with pytest.raises(DataError, match="CRS"):
        toolbox.run("points.filter", values | {"points": tmp_path / "a.laz"}, tiling=tiling)


def test_cancel_stops_and_leaves_no_product(survey: Path, tiling: Tiling, tmp_path: Path) -> None:
    seen: list[float] = []
    ctx = Context(seen.append, lambda: len(seen) > 5)
    values = {"points": survey, "where": "z < 20", "kept": tmp_path / "k.laz"}
    with pytest.raises(Cancelled):
        toolbox.run("points.filter", values, tiling=tiling, ctx=ctx)
    assert not (tmp_path / "k.laz").exists()
    assert seen == sorted(seen)


def test_what_is_removed_when_a_run_is_killed_is_not_gone_on_from(
    survey: Path, tiling: Tiling, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tile was taken for done whose points had been removed, and they were missing."""
    out = tmp_path / "out"
    out.mkdir()
    values = {"points": survey, "where": "z < 20", "kept": out / "k.laz"}
    remove = shutil.rmtree

    def killed(folder: Path, **how: Any) -> None:
        pieces = sorted(folder.rglob("*.kept"))
        remove(pieces[0] if pieces else folder, **how)
        if pieces:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "rmtree", killed)
        with pytest.raises(KeyboardInterrupt):
            toolbox.run("points.filter", values, tiling=tiling)
    whole = hashlib.sha256((out / "k.laz").read_bytes()).hexdigest()
    toolbox.run("points.filter", values, tiling=tiling, overwrite=True, resume=True)
    assert files(out) == {"k.laz": whole}


@pytest.mark.slow
def test_kill_and_resume_give_the_same_files(model: str, survey: Path, tmp_path: Path) -> None:
    """Killed without warning at any moment, a run goes on from there."""
    out = tmp_path / "out"
    out.mkdir()
    targets = {"clean": out / "c.laz", "dtm": out / "t.tif"}
    toolbox.run(model, {"points": survey, **targets})
    whole = files(out)
    options = [f"--{name}={path}" for name, path in targets.items()]
    command = [sys.executable, "-m", "toolbox", "run", model, f"--points={survey}", *options]
    command += ["--overwrite", "--tile=30", "--workers=2", "--resume"]
    for seconds in (3.0, 5.0):
        run = subprocess.Popen(command, start_new_session=True, stderr=subprocess.DEVNULL)
        time.sleep(seconds)
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
    done = subprocess.run(command, check=False, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    assert files(out) == whole  # and no working folder


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"tile": "-1"}, "tile: must be a number > 0 or auto, got '-1'"),
        ({"tile": "x"}, "tile: must be"),
        ({"tile": "5", "workers": "1.5"}, "workers: must be a whole number"),
        ({"tile": "5", "memory": "4 apples"}, "memory: must be 500MB to 1000TB, such as 4GB"),
        ({"tile": "5", "memory": "1001TB"}, "memory: must be 500MB to 1000TB"),
        (
            {"tile": "5", "memory": "1.4GB", "workers": 3},
            "500 MB for each worker, and 3 share 1.4GB",
        ),
        (
            {"tile": "auto", "scheduler": "tcp://localhost:1"},
            "workers: say how many the scheduler has",
        ),
        ({"workers": "2"}, "workers: is for runs in tiles"),
    ],
)
def test_options_that_mean_nothing(given: dict[str, Any], problem: str) -> None:
    with pytest.raises(ParameterError, match=problem):
        Tiling.parse(given)


def test_options() -> None:
    assert Tiling.parse({}) is None
    made = Tiling.parse({"tile": "auto", "workers": "3", "memory": "1.5GB"})
    assert made == Tiling(None, 3, 1_500_000_000)
    assert memory_of(made) == 500_000_000  # of each worker
    much = Tiling.parse({"tile": "5", "memory": "10TB", "workers": 2})
    assert much == Tiling(5.0, 2, 10**13)
    little = Tiling.parse({"tile": "auto", "memory": "500MB"})
    assert little == Tiling(None, 1, 500_000_000)  # however many cores there are


@pytest.mark.parametrize("size", [None, 50.0])
def test_each_worker_has_500_mb_of_this_computer_too(
    size: float | None, survey: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(options, "_of_computer", lambda: 1_400_000_000)
    values = {"points": survey, "where": "z < 20", "kept": tmp_path / "k.laz"}
    problem = "memory: must be at least 500 MB for each worker, and 3 share 1.4 GB"
    with pytest.raises(ParameterError, match=problem):
        toolbox.run("points.filter", values, tiling=Tiling(size, 3))
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    assert Tiling.parse({"tile": "auto"}) == Tiling(None, 2)


def _of_extent(*sizes: float, count: int) -> Any:
    """What the choice of a tile asks of a survey that begins at 0, 0, 0."""
    file = SimpleNamespace(bounds=np.array([(0, 0, 0), sizes]), count=count)
    return SimpleNamespace(files=[file], count=count, metre=1.0)


def test_a_tile_leaves_the_memory_that_libraries_need() -> None:
    """A worker without points uses 117 MB of its 500."""
    plan = TilePlan.of(as_model(catalog.load("points.denoise")), {"reach": 3}, ["clean"])
    (need,) = [step.spec.memory.per_area(100.0) for step in plan.model.steps.values()]
    size = engine.suitable_size(
        _of_extent(1e4, 1e4, 10, count=10**10), plan, Tiling(None, 1, LEAST)
    )
    tile = need * (size + 2 * plan.halo) ** 2
    assert 300_000_000 < tile < LEAST - 117_000_000


@pytest.mark.parametrize("xyz", [[(5, 5, 5)], [(5, 5, 5), (5, 5, 9)], [(5, 5, 5), (95, 5, 5)]])
def test_points_in_a_line_have_the_least_tiles(
    xyz: list[tuple[float, ...]], tiling: Tiling, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """They cover no area, in which their density could be reckoned."""
    PointCloud(np.array(xyz, float), {}, crs=CRS(32635)).save(tmp_path / "a.laz")
    values = {"points": tmp_path / "a.laz", "where": "z < 7", "kept": tmp_path / "b.laz"}
    with caplog.at_level("INFO", "toolbox"):
        toolbox.run("points.filter", values, tiling=replace(tiling, size=None))
    assert "tiles of 50 m" in caplog.text
    assert len(PointCloud.open(tmp_path / "b.laz")) == sum(z < 7 for _, _, z in xyz)


def test_what_a_run_leaves_is_arrays_and_json(survey: Path, tiling: Tiling, tmp_path: Path) -> None:
    """Others may know where it is: nothing there may be code, and it must be ours."""
    values = {"points": survey, "method": "max", "surface": tmp_path / "o.tif"}
    seen = [0.0]
    ctx = Context(seen.append, lambda: seen[-1] > 0.3)  # when some tiles are done
    with pytest.raises(Cancelled):
        toolbox.run("surface.grid", values, tiling=tiling, ctx=ctx)
    (work,) = tmp_path.glob(".tiles-*")
    assert work.stat().st_mode & 0o077 == 0
    assert {path.suffix for path in work.rglob("*.*") if path.is_file()} == {".npy", ".json"}
    work.chmod(0o770)
    for resume in (True, False):
        with pytest.raises(DataError, match="must be a folder in which only you may write"):
            toolbox.run("surface.grid", values, tiling=tiling, resume=resume)
    work.chmod(0o700)
    toolbox.run("surface.grid", values, tiling=tiling, resume=True)
    assert not work.exists()
