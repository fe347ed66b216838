"""What a run reads: taken apart once, and what is wrong with it."""

from __future__ import annotations

import hashlib
import pickle
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pyproj import CRS
from scenes.layers import cloud, raster

import toolbox
from toolbox import catalog
from toolbox.context import Context
from toolbox.data import PointCloud, Raster, Survey, Table
from toolbox.data import paths as data_paths
from toolbox.data.las import header
from toolbox.data.las import read as las_read
from toolbox.data.paths import PointFiles
from toolbox.data.reading import Reading
from toolbox.declare.kinds import find
from toolbox.errors import Cancelled, DataError
from toolbox.runs import provenance
from toolbox.runs.source import Source, of_run, opened, paths, problems
from toolbox.tiles.tiling import Tiling

POINTS, EITHER, RASTER = find(PointCloud), find(PointCloud | Survey), find(Raster)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("a.laz", "b.laz"):
        shift = 100 * (name == "b.laz")
        cloud([[x + shift, y, 0] for x in range(5) for y in range(5)]).save(tmp_path / name)
    (tmp_path / "a.txt").write_text("1;2;3;4\n5;6;7;8\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("value", "given", "files", "options"),
    [
        ("a.laz", ("a.laz",), ["a.laz"], {}),
        (Path("a.laz"), (Path("a.laz"),), ["a.laz"], {}),
        (["a.laz", "b.laz"], ("a.laz", "b.laz"), ["a.laz", "b.laz"], {}),
        ({"path": ["b.laz", "a.laz"]}, ("b.laz", "a.laz"), ["a.laz", "b.laz"], {}),
        ([{"path": "a.laz"}, "b.laz"], ("a.laz", "b.laz"), ["a.laz", "b.laz"], {}),
        (".", (".",), ["a.laz", "b.laz"], {}),
        ("*.laz", ("*.laz",), ["a.laz", "b.laz"], {}),
        (
            {"path": "a.txt", "columns": "x,y,z,i", "separator": ";", "bounds": "0,0,9,9"},
            ("a.txt",),
            ["a.txt"],
            {"columns": ["x", "y", "z", "i"], "separator": ";", "bounds": (0, 0, 9, 9)},
        ),
    ],
)
@pytest.mark.usefixtures("folder")
def test_a_value_is_taken_apart(
    value: Any, given: tuple[Any, ...], files: list[str], options: dict[str, Any]
) -> None:
    source = Source.of(POINTS, value)
    assert source.problem is None
    assert source.layer is None
    assert source.paths == given
    assert [path.name for path in source.files] == files
    assert source.options == options
    count = {"a.txt": 2}.get(files[0], 25 * len(files))
    assert len(source.open(POINTS)) == count


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        (None, "must be a path or a PointCloud, got None"),
        ("", "must be a path or a PointCloud, got ''"),
        (3, "must be a path or a PointCloud, got 3"),
        ([], "takes one PointCloud, got 0"),
        ("c.laz", "there is no file c.laz"),
        (["c.laz", "a.laz", "d*.laz"], "there is no file c.laz, d*.laz"),
        (
            {"path": "a.laz", "layer": "b"},
            "no option 'layer'; there are columns",
        ),
        ([{"path": "a.laz", "bounds": "0,0,1,1"}, "b.laz"], "with the same options"),
        ("a" * 5000, "a cannot be read: File name too long"),
    ],
)
@pytest.mark.usefixtures("folder")
def test_what_is_wrong_is_known_before_anything_is_opened(value: Any, problem: str) -> None:
    assert problem in (Source.of(POINTS, value).problem or "")


@pytest.mark.usefixtures("folder")
def test_one_raster_is_one_file(folder: Path) -> None:
    raster([[1.0]]).save(folder / "a.tif")
    assert Source.of(RASTER, ["a.tif", "a.tif"]).problem == "takes one Raster, got 2"
    assert Source.of(RASTER, "*.tif").problem == "there is no file *.tif"
    assert Source.of(RASTER, {"path": "a.tif", "band": "1"}).open(RASTER).shape == (1, 1)


def test_a_layer_in_memory_stays_as_it_is() -> None:
    points = cloud([[0, 0, 0]])
    source = Source.of(POINTS, points)
    assert (source.problem, source.files) == (None, ())
    assert source.open(POINTS) is points
    assert source.absolute().open(POINTS) is points


def test_all_problems_and_paths_of_a_run(folder: Path) -> None:
    spec = catalog.load("points.filter")
    clouds = replace(spec.inputs["points"], name="clouds", many=True)
    spec = replace(spec, inputs={"clouds": clouds})
    empty = {"clouds": "takes at least one PointCloud, got 0"}
    assert problems(of_run({"clouds": []}, spec), spec) == empty
    found = of_run({"clouds": ["a.laz", cloud([[0, 0, 0]]), "c.laz", ["d.laz", "b.laz"]]}, spec)
    assert problems(found, spec) == {"clouds": "there is no file c.laz"}
    assert [path.name for path in paths(found)] == ["a.laz"]
    spec = catalog.load("surface.grid")
    assert of_run({"points": None, "template": None}, spec).keys() == {"points"}
    broken = folder / "broken.laz"
    broken.write_bytes(b"no LAS")
    found = of_run({"points": broken, "template": broken}, spec)
    with pytest.raises(DataError) as caught:
        opened(spec, found, None, Reading(), Context())
    assert caught.value.problems.keys() == {"points", "template"}


def test_it_goes_to_other_processes(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sent = pickle.dumps(Source.of(POINTS, {"path": "a.laz", "bounds": [0, 0, 1, 1]}).absolute())
    monkeypatch.chdir(folder.parent)
    source: Source = pickle.loads(sent)
    assert source.files == (folder / "a.laz",)
    assert len(source.open(POINTS)) == 4


@pytest.mark.usefixtures("folder")
def test_a_survey_takes_what_is_assumed_too(caplog: pytest.LogCaptureFixture) -> None:
    source = Source.of(EITHER, ["a.laz", "b.laz"])
    assert isinstance(source.open(EITHER), Survey)
    assert source.open(EITHER, CRS(32633)).crs == cloud([[0, 0, 0]]).crs
    spec = catalog.load("points.info")
    opened(spec, {"points": (source,)}, CRS(32633), None, Context())
    assert "is not assumed" in caplog.text


def test_a_file_is_found_parsed_and_read_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its places, its header and its bytes; what is written is not counted."""
    found: list[str] = []

    def counted(module: Any, name: str, inside: Any = None) -> None:
        plain = getattr(module, name)

        def counting(*args: Any, **how: Any) -> Any:
            found.append(name)
            return plain(*args, **how)

        monkeypatch.setattr(module, name, counting)

    counted(data_paths, "_files")
    counted(las_read, "parse_metadata")
    counted(las_read, "opened")
    counted(header, "_raw_header")
    counted(provenance, "read_record")
    monkeypatch.setattr("toolbox.data.reading.file_hash", lambda *_: 1 / 0)
    toolbox.run("points.filter", {"points": "a.laz", "kept": "c.laz"})
    assert sorted(found) == ["_files", "_raw_header", "opened", "parse_metadata"]
    record = provenance.read("c.laz")
    assert record is not None
    assert record.inputs["points"][0].sha256 == sha256(folder / "a.laz")


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_the_record_is_of_what_was_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that is replaced after the points were read does not lend its hash to them."""
    before, size = sha256(folder / "a.laz"), (folder / "a.laz").stat().st_size
    plain = las_read.parse_metadata

    def replacing(stream: Any, *rest: Any) -> Any:
        found = plain(stream, *rest)
        cloud([[9, 9, 9]]).save(folder / "new.laz")
        (folder / "new.laz").replace(folder / "a.laz")
        return found

    monkeypatch.setattr(las_read, "parse_metadata", replacing)
    toolbox.run("points.filter", {"points": "a.laz", "kept": "c.laz"})
    record = provenance.read("c.laz")
    assert record is not None
    (source,) = record.inputs["points"]
    assert source.sha256 == before != sha256(folder / "a.laz")
    assert source.bytes == size != (folder / "a.laz").stat().st_size
    assert len(PointCloud.open("c.laz")) == 25


@pytest.mark.parametrize("tiling", [None, Tiling(size=5.0, workers=1)])
def test_files_that_vanish_do_not_surprise(
    folder: Path, tiling: Tiling | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was read to the end is known; what is still needed is named."""
    plain = las_read.parse_metadata

    def vanishing(stream: Any, *rest: Any) -> Any:
        (folder / "a.laz").unlink(missing_ok=True)
        return plain(stream, *rest)

    monkeypatch.setattr(las_read, "parse_metadata", vanishing)
    with pytest.raises(DataError, match=r"a\.laz") if tiling else nullcontext():
        toolbox.run("points.filter", {"points": "a.laz", "kept": "c.laz"}, tiling=tiling)
    assert (folder / "c.laz").exists() == (tiling is None)


def test_how_an_input_was_made_is_known_from_its_points(folder: Path) -> None:
    toolbox.run("points.filter", {"points": "a.laz", "kept": "c.laz"})
    toolbox.run("points.filter", {"points": ["c.laz", "b.laz"], "kept": "d.laz"})
    record = provenance.read("d.laz")
    assert record is not None
    assert record.ancestors.keys() == {sha256(folder / "c.laz")}


def test_progress_rises_and_stops_while_files_are_read(folder: Path) -> None:
    table = folder / "t.csv"
    table.write_text("a\n1\n")
    seen: list[float] = []
    values = {"points": ["a.laz", "b.laz"], "kept": "c.laz"}
    toolbox.run("points.filter", values, ctx=Context(seen.append))
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    steps = len(seen)
    for number in range(0, steps, max(steps // 8, 1)):
        left = iter(range(number))
        stop = Context(stop=lambda left=left: next(left, None) is None)
        with pytest.raises(Cancelled):
            toolbox.run("points.filter", values, overwrite=True, ctx=stop)
    assert Source.of(find(Table), table).open(find(Table)).frame["a"].tolist() == [1]


@pytest.mark.usefixtures("folder")
def test_files_that_are_left_out_are_named_once(caplog: pytest.LogCaptureFixture) -> None:
    found = PointFiles.of(".")
    assert PointFiles.of(found) is found
    assert found.remarks == (".: only its LAS and LAZ files are read, not a.txt",)
    toolbox.run("points.filter", {"points": ".", "kept": "c.laz"})
    assert caplog.text.count("only its LAS") == 1


def test_degrees_in_a_crs_of_metres_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """An error where the CRS is only assumed, a warning where a file states it."""
    path, degrees = tmp_path / "a.txt", [[29.01, 41.0, 80], [29.02, 41.01, 90]]
    path.write_text("x y z\n29.01 41.0 80\n29.02 41.01 90\n")
    said = r"a.txt has x from 29\.01 to 29\.02 and y from 41 to 41\.01, which look like degrees"
    for values in ({"points": path}, {"points": cloud(degrees, crs=None, name="a.txt")}):
        with pytest.raises(DataError, match=said):
            toolbox.run("points.filter", values, assume_crs="EPSG:32635")
    how, values = Tiling(size=100, workers=1), {"points": path, "kept": tmp_path / "b.laz"}
    with pytest.raises(DataError, match=said):
        toolbox.run("points.filter", values, assume_crs="EPSG:32635", tiling=how)
    assert "look like degrees" not in caplog.text
    toolbox.run("points.filter", {"points": cloud(degrees)})
    assert "a.laz has x from 29.01 to 29.02" in caplog.text
    caplog.clear()
    toolbox.run("points.filter", {"points": cloud(degrees, crs=None)}, assume_crs="local")
    toolbox.run("points.filter", {"points": cloud([])})
    assert "degrees" not in caplog.text


def test_rasters_and_features_far_from_their_crs_are_told(caplog: pytest.LogCaptureFixture) -> None:
    far = raster([[1.0]], west=6.6e6, north=9e5)
    toolbox.run("surface.hillshade", {"surface": far})
    assert "far outside the area of use of EPSG:32635" in caplog.text


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("own", [True, False])
def test_what_is_assumed_is_reprojected(own: bool, caplog: pytest.LogCaptureFixture) -> None:
    """A table of check points in a CRS that it cannot state, other than that of the surface."""
    raster([[1.0, 2.0]], crs=CRS(32635)).save("a.tif")
    Path("a.csv").write_text("x,y,z\n500000,4600000,5\n")
    table = {"path": "a.csv", "reproject": "EPSG:32635"}
    spec = catalog.load("compare.surfaces")
    assumed = {"assume_crs": "EPSG:32636"} if own else {}
    found = of_run({"surface": "a.tif", "checkpoints": table | assumed}, spec)
    assert not problems(found, spec)
    with caplog.at_level("WARNING", "toolbox"):
        made = opened(spec, found, None if own else CRS(32636), Reading(), Context())
    assert made["checkpoints"].crs == CRS(32635)
    assert made["checkpoints"].bounds[0] == pytest.approx(995_000, abs=10_000)
    assert "is not assumed" not in caplog.text, "it was taken by the table"


@pytest.mark.parametrize("kind", [POINTS, EITHER])
def test_heights_are_assumed_of_points_that_state_none(
    kind: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for name in ("a.laz", "b.laz"):
        cloud([[500_000, 4_600_000, 0]]).save(tmp_path / name)
    whole = CRS("EPSG:32635+5773")
    paths = [str(tmp_path / "a.laz"), str(tmp_path / "b.laz")]
    source = Source.of(kind, paths if kind is EITHER else paths[0])
    made = source.open(kind, whole)
    assert made.crs == whole
    held = source.open(kind)
    assert Source.of(kind, held).open(kind, whole).crs == whole, "of a layer in memory, too"
    assert "is not assumed" not in caplog.text
