"""toolbox.run: paths in, layers or paths out, and every problem in one error."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pytest
import shapely
from affine import Affine
from pyproj import CRS
from scenes import layers

import toolbox
from algorithms.ground.csf import GroundCsf
from algorithms.shoreline.alpha_shape import ShorelineAlphaShape
from toolbox import PointCloud, Raster, Vector, catalog, execute
from toolbox.context import QUIET, Context
from toolbox.data.crs import crs_text, parse_crs
from toolbox.declare.spec import REGISTRY, outputs, sink, source, tool
from toolbox.errors import Cancelled, DataError, ParameterError


@tool("toy.together")
class ToyTogether:
    """Count the points of several clouds.

    Each counts as often as it is given.
    """

    clouds: tuple[PointCloud, ...] = source("Clouds")
    extra: PointCloud | None = source("One more", default=None)

    @outputs
    class Outputs:
        count: int = sink("Number of points", unit="1")

    def halo(self) -> float:
        return 0.0

    def run(self, ctx: Context = QUIET) -> ToyTogether.Outputs:
        """Count."""
        return self.Outputs(count=sum(map(len, self.clouds)) + len(self.extra or ()))


TOGETHER = REGISTRY.pop("toy.together")


@pytest.fixture
def together(monkeypatch: pytest.MonkeyPatch) -> str:
    """Make the test's own tool known while a test runs."""
    monkeypatch.setattr("toolbox.catalog.load", lambda id: TOGETHER)
    return TOGETHER.id


@pytest.fixture
def text(tmp_path: Path) -> Path:
    """Five points without names or CRS."""
    path = tmp_path / "five.txt"
    np.savetxt(path, np.column_stack([np.eye(5, 3) * 9, np.arange(5)]), fmt="%.2f")
    return path


def cloud(crs: CRS | None = CRS(32635)) -> PointCloud:  # noqa: B008
    return PointCloud(np.eye(4, 3) * 9, crs=crs, name="four.laz")


def test_a_layer_in_and_layers_out() -> None:
    result = toolbox.run("surface.grid", {"points": cloud(), "method": "nearest", "cell": "3"})
    assert isinstance(result["surface"], Raster)
    assert result["surface"].cell == 3
    assert result["filled_share"] == 1


def test_a_path_in_and_a_path_out(text: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.tif"
    values = {"points": str(text), "method": "nearest", "surface": str(out)}
    result = toolbox.run("surface.grid", values, assume_crs="EPSG:2154+5720")
    assert result["surface"] == out
    assert Raster.open(out).crs == CRS("EPSG:2154+5720")


def test_a_source_may_say_how_to_read_it(text: Path) -> None:
    points = {"path": text, "columns": "x,y,z,intensity", "bounds": [0, 0, 5, 9]}
    result = toolbox.run("points.filter", {"points": points, "where": "intensity > 0"})
    assert list(result["kept"]["intensity"]) == [1, 2, 3, 4]


def test_bounds_without_points_are_told(text: Path, caplog: pytest.LogCaptureFixture) -> None:
    points = {"path": text, "columns": "x,y,z,intensity", "bounds": [0, 0, 5, 9]}
    toolbox.run("points.info", {"points": points})
    assert "within bounds" not in caplog.text
    toolbox.run("points.info", {"points": points | {"bounds": [90, 0, 95, 9]}})
    assert "no point lies within bounds; info says where they are" in caplog.text


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ({"path": "FILE", "colums": "x,y,z"}, "no option 'colums'; there are columns"),
        ({"path": "FILE", "bounds": "1,2,3"}, "option bounds: needs 4 numbers, got 3"),
        ({"path": "FILE", "ctx": 1}, "no option 'ctx'"),
        ({"columns": "x,y,z"}, "must be a path or a PointCloud"),
        (["FILE", "FILE"], "is given twice"),
        ([{"path": "FILE", "columns": "x,y,z"}, "FILE"], "with the same options"),
        ([], "takes one PointCloud, got 0"),
        (["FILE", 5], "must be a path or a PointCloud"),
        ("none*.laz", r"there is no file none\*.laz"),
        (5, "must be a path or a PointCloud, got 5"),
        (np.zeros((2, 3)), r"got ndarray; PointCloud\(xyz, crs=...\) or .* makes one"),
        (None, "must be a path or a PointCloud, got None"),
        ("", "must be a path or a PointCloud, got ''"),
        ("no" * 200, "File name too long"),
        ("FOLDER", "holds no files of points"),
    ],
)
def test_sources_that_cannot_be_opened(
    points: Any, message: str, text: Path, tmp_path: Path
) -> None:
    if isinstance(points, dict) and "path" in points:
        points = points | {"path": text}
    elif isinstance(points, list):
        points = [text if item == "FILE" else item for item in points]
    elif isinstance(points, str) and points == "FOLDER":
        points = tmp_path / "folder"
        points.mkdir()
    with pytest.raises((ParameterError, DataError), match=message) as caught:
        toolbox.run("points.info", {"points": points})
    assert caught.value.problems.keys() == {"points"}


def test_a_source_of_several_files_is_one_layer(text: Path) -> None:
    other = text.with_name("u.txt")
    other.write_text(text.read_text())
    how = {"columns": "x,y,z,intensity", "bounds": [0, 0, 5, 9]}
    one = len(toolbox.run("points.filter", {"points": {"path": text, **how}})["kept"])
    for points in (
        {"path": [text, other], **how},
        [{"path": text, **how}, {"path": str(other), **how}],
        {"path": text.parent, **how},
    ):
        kept = toolbox.run("points.filter", {"points": points})["kept"]
        assert len(kept) == 2 * one
    assert len(toolbox.run("points.filter", {"points": [text]})["kept"]) == 5


def test_a_list_for_a_source_of_several_layers_stays_one(together: str, text: Path) -> None:
    text.with_name("u.txt").write_text(text.read_text())
    values: dict[str, Any] = {"clouds": [text, text.parent, text], "extra": [text]}
    assert toolbox.run(together, values) == {"count": 25}
    with pytest.raises(ParameterError, match="takes at least one PointCloud, got 0"):
        toolbox.run(together, {"clouds": []})


def test_a_crs_is_assumed_before_the_files_are_compared(tmp_path: Path) -> None:
    cloud().save(tmp_path / "a.las")
    cloud(crs=None).save(tmp_path / "b.las")
    with pytest.raises(DataError, match=r"b\.las has no CRS; state it with assume_crs"):
        toolbox.run("points.filter", {"points": tmp_path})
    kept = toolbox.run("points.filter", {"points": tmp_path}, assume_crs="EPSG:32635")["kept"]
    assert (len(kept), kept.crs) == (8, CRS(32635))
    survey = toolbox.run("points.info", {"points": tmp_path}, assume_crs="EPSG:32635")
    assert survey["count"] == 8


def test_a_missing_crs_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    spots = Vector(gpd.GeoDataFrame(geometry=[shapely.Point(0.5, 0.5, 1.0)]))
    values = {"surface": layers.raster([[1.0, 2.0]]), "checkpoints": spots}
    with pytest.raises(DataError, match="has no CRS; state it with assume_crs, to go with"):
        toolbox.run("compare.surfaces", values)
    assert "has no CRS" not in caplog.text


def test_several_sources_of_a_kind(together: str, text: Path) -> None:
    crs = "EPSG:32635"
    values = {"clouds": [str(text), cloud(), {"path": text}], "extra": text}
    assert toolbox.run(together, values, assume_crs=crs) == {"count": 19}
    assert toolbox.run(together, {"clouds": text, "extra": None}) == {"count": 5}


def test_several_sources_must_share_their_crs(together: str) -> None:
    with pytest.raises(DataError, match=r"clouds: .*32636.*32635"):
        toolbox.run(together, {"clouds": [cloud(), cloud(CRS(32636))]})


def test_assumed_crs_does_not_replace_a_known_one(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("WARNING", "toolbox"):
        result = toolbox.run("points.filter", {"points": cloud()}, assume_crs="EPSG:2154")
    assert result["kept"].crs == CRS(32635)
    assert "four.laz states its CRS" in caplog.text


@pytest.mark.parametrize(("word", "metre"), [("local", 1), ("local:mm", 1000)])
@pytest.mark.parametrize("suffix", [".laz", ".las", ".ply"])
def test_a_local_crs_is_stated_once_for_a_chain(
    suffix: str, word: str, metre: int, tmp_path: Path
) -> None:
    xyz = np.random.default_rng(1).uniform(0, 90 * metre, (300, 3)).round()
    PointCloud(xyz, {"classification": np.full(300, 2, np.uint8)}).save(tmp_path / "a.laz")
    chosen, grid, shapes = (tmp_path / name for name in (f"b{suffix}", "c.tif", "d.gpkg"))
    values = {"points": tmp_path / "a.laz", "where": "z > 1", "kept": chosen}
    toolbox.run("points.filter", values, assume_crs=word)
    again = tmp_path / "e.laz"
    toolbox.run("points.filter", {"points": chosen, "where": "z > 2", "kept": again})
    toolbox.run("surface.grid", {"points": chosen, "cell": 1, "surface": grid})
    toolbox.run(
        "surface.difference", {"surface": grid, "base": grid, "difference": tmp_path / "f.tif"}
    )
    toolbox.run("shoreline.alpha_shape", {"points": again, "alpha": 2000, "shapes": shapes})
    layers = (PointCloud.open(again), Raster.open(tmp_path / "f.tif"), Vector.open(shapes))
    assert [crs_text(layer.crs) for layer in layers] == [word] * 3


def test_several_files_must_agree_in_their_local_crs(tmp_path: Path) -> None:
    for name, word in (("a", "local"), ("b", "local:mm")):
        cloud(parse_crs(word)).save(tmp_path / f"{name}.laz")
    with pytest.raises(DataError, match="cannot be compared with local coordinates in metres"):
        toolbox.run("points.filter", {"points": tmp_path})


def test_a_picture_of_nothing_does_not_spoil_a_run(tmp_path: Path) -> None:
    values = {"points": cloud(), "where": "z < -1", "kept": tmp_path / "a.laz"}
    result = toolbox.run("points.filter", values, picture=tmp_path / "a.png")
    assert "picture" not in result
    assert [p.name for p in tmp_path.iterdir()] == ["a.laz"]


def test_an_output_may_say_how_to_write_it(tmp_path: Path) -> None:
    target = {"path": tmp_path / "a.tif", "cog": True}
    values = {"points": cloud(), "method": "nearest", "surface": target}
    assert toolbox.run("surface.grid", values)["surface"] == tmp_path / "a.tif"
    assert b"LAYOUT=IFDS_BEFORE_DATA" in (tmp_path / "a.tif").read_bytes()[:400]
    with pytest.raises(ParameterError, match="surface: no option 'zip'; there are cog"):
        toolbox.run("surface.grid", values | {"surface": {"path": "b.tif", "zip": 1}})


@pytest.mark.parametrize("kind", ["symbolic", "broken"])
def test_outputs_behind_links_do_not_hit_inputs(kind: str, tmp_path: Path) -> None:
    """A link named like an input in another folder: the input stays as it is."""
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    source, link = tmp_path / "b" / "out.laz", tmp_path / "a" / "out.laz"
    cloud().save(source)
    before = source.read_bytes()
    behind = tmp_path / "b" / "real.laz"
    if kind == "symbolic":
        cloud().save(behind)
    link.symlink_to(behind)
    toolbox.run("points.filter", {"points": source, "where": "z > 1", "kept": link}, overwrite=True)
    assert source.read_bytes() == before
    assert len(PointCloud.open(behind)) == 1


def test_links_that_cannot_be_written_are_refused_before_the_run(tmp_path: Path) -> None:
    for name, behind in {"text": "a.xyz", "gone": "no/a.laz", "loop": "loop.laz"}.items():
        (tmp_path / f"{name}.laz").symlink_to(tmp_path / behind)
    for name, why in {"gone": "no folder", "loop": "no usable path"}.items():
        with pytest.raises(ParameterError, match=why):
            toolbox.run("points.filter", {"points": cloud(), "kept": tmp_path / f"{name}.laz"})
    toolbox.run("points.filter", {"points": cloud(), "kept": tmp_path / "text.laz"})
    assert (tmp_path / "a.xyz").read_text().startswith("x y z")


@pytest.mark.parametrize(
    ("values", "how", "text"),
    [
        ({"kept": "k\0.laz"}, {}, "kept: "),
        ({}, {"picture": "q\0.png"}, "picture: "),
        ({}, {"assume_crs": 5}, "assume_crs: "),
    ],
)
def test_values_of_no_use(values: dict[str, Any], how: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        toolbox.run("points.filter", {"points": cloud()} | values, **how)


def test_all_problems_of_names_values_and_paths_together(tmp_path: Path) -> None:
    values = {"points": tmp_path / "no.laz", "cell": 0, "celll": 1, "surface": tmp_path / "a.jpg"}
    with pytest.raises(ParameterError) as caught:
        toolbox.run("surface.grid", values, picture=tmp_path / "no" / "a.png")
    assert caught.value.problems.keys() == {"points", "cell", "celll", "surface", "picture"}


def test_rules_between_values_are_checked_before_data_is_read(tmp_path: Path) -> None:
    (tmp_path / "bad.laz").write_bytes(b"no points")
    values = {"points": tmp_path / "bad.laz", "minimum": 9, "maximum": 5}
    with pytest.raises(ParameterError, match="minimum: must be <= maximum"):
        toolbox.run("points.filter_intensity", values)


def test_a_raster_without_a_single_value_is_told_before_all_else(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    some = layers.raster(np.ones((3, 3)))
    none = layers.raster(np.full((3, 3), np.nan))
    values = {"surface": some, "page": tmp_path / "page.html"}
    toolbox.run("surface.difference", {**values, "base": some}, overwrite=True)
    assert "not a single cell" not in caplog.text
    toolbox.run("surface.difference", {**values, "base": none}, overwrite=True)
    said = "not a single cell has a value in: difference (Difference)"
    assert said in caplog.text
    page = (tmp_path / "page.html").read_text()
    assert 0 < page.index(said[1:]) < page.index("o cell has a value in both rasters")


def test_inputs_beside_the_dict_are_told_where_they_belong() -> None:
    """Python named a keyword of its own, or an attribute that a text has not."""
    call: Any = toolbox.run
    told = 'give inputs and outputs in one dict, as run("points.info", {"points": "a.laz"}); got '
    with pytest.raises(TypeError, match=re.escape(f"{told}points=..., cell=...")):
        call("points.info", points="a.laz", cell=1)
    with pytest.raises(TypeError, match=re.escape(f"{told}'a.laz'")):
        call("points.info", "a.laz")
    with pytest.raises(TypeError, match=re.escape("got overwrit=...; did you mean 'overwrite'?")):
        call("points.info", {"points": "a.laz"}, overwrit=True)
    with pytest.raises(ParameterError, match="points: missing"):
        call("points.info")


def test_options_within_the_dict_are_told_where_they_belong() -> None:
    options = {"overwrite": True, "assume_crs": "local", "points.columns": "x,y,z"}
    with pytest.raises(ParameterError) as caught:
        toolbox.run("points.info", {"points": "a.laz", **options})
    told = str(caught.value)
    assert "overwrite: is an option of the run and no input: in Python overwrite=... " in told
    assert "assume_crs: is an option of the run and no input" in told
    with pytest.raises(ParameterError, match=r"points\.bogus: unknown parameter"):
        toolbox.run("points.info", {"points": "a.laz", "points.bogus": 1})
    assert "--points.columns, in Python {'points': {'path': ..., 'columns': ...}}" in told


def test_unknown_tool_is_named() -> None:
    with pytest.raises(ParameterError, match=r"no tool called 'ground.cfs'; did you mean"):
        toolbox.run("ground.cfs", {})


@pytest.mark.parametrize("after", [0, 1, 2, 3])
def test_cancelled_run_leaves_nothing(after: int, text: Path, tmp_path: Path) -> None:
    steps = iter(range(1000))
    stop = Context(stop=lambda: next(steps) >= after)
    values = {"points": text, "kept": tmp_path / "out.laz"}
    with pytest.raises(Cancelled):
        toolbox.run("points.filter", values, ctx=stop)
    assert [p.name for p in tmp_path.iterdir()] == ["five.txt"]


def test_one_output_that_cannot_be_written_takes_the_others_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Raster, "save", full)
    values = {"points": cloud(), "classified": tmp_path / "a.laz", "cloth": tmp_path / "b.tif"}
    with pytest.raises(DataError, match="No space left"):
        toolbox.run("ground.csf", values)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".geojson", ".kml"])
def test_formats_that_need_a_crs_are_refused_before_the_run(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not after it, when all outputs would be lost with this one."""
    xyz = np.random.default_rng(1).uniform(0, 9, (50, 3))
    PointCloud(xyz).save(tmp_path / "a.laz")
    values = {"points": tmp_path / "a.laz", "alpha": 2.0, "shapes": tmp_path / f"a{suffix}"}
    monkeypatch.setattr(ShorelineAlphaShape, "run", None)
    with pytest.raises(DataError, match="needs a CRS of the Earth, and the data have local coord"):
        toolbox.run("shoreline.alpha_shape", values, assume_crs="local")


@pytest.mark.parametrize(
    ("output", "file", "library"),
    [
        ("classified", "a.ply", "plyfile"),
        ("classified", "a.parquet", "pyarrow"),
        ("page", "a.pdf", "weasyprint"),
    ],
)
def test_formats_whose_library_is_missing_are_refused_before_the_run(
    output: str,
    file: str,
    library: str,
    text: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("toolbox.data.extras.find_spec", lambda name: None)
    monkeypatch.setattr(GroundCsf, "run", None)
    with pytest.raises(ParameterError, match=f"pip install {library}$"):
        toolbox.run("ground.csf", {"points": text, output: tmp_path / file})


def test_an_input_that_changes_before_it_is_hashed_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The record would have the hash of another file than the one that was read."""
    low, high = (
        Raster(np.full((2, 2), z, np.float32), Affine(1, 0, 0, 0, -1, 2), crs=CRS(32635))
        for z in (1, 2)
    )
    for name, raster in (("a.tif", low), ("b.tif", high)):
        raster.save(tmp_path / name)
        os.utime(tmp_path / name, (1000, 1000))
    real = execute.record_of

    def changing(*arguments: Any, **how: Any) -> Any:
        high.save(tmp_path / "a.tif", overwrite=True)
        return real(*arguments, **how)

    monkeypatch.setattr(execute, "record_of", changing)
    values = {"surface": tmp_path / "b.tif", "base": tmp_path / "a.tif"}
    with pytest.raises(DataError, match=r"a\.tif changed while the run was reading"):
        toolbox.run("surface.difference", {**values, "difference": tmp_path / "c.tif"})
    assert not (tmp_path / "c.tif").exists()


def test_a_folder_that_is_removed_during_the_run_is_named(text: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()

    def remove(fraction: float) -> None:
        if fraction > 0.5 and folder.exists():
            folder.rmdir()

    values = {"points": text, "kept": folder / "k.laz"}
    with pytest.raises(DataError, match=f"kept: cannot write: .*No such file.*: '{folder}"):
        toolbox.run("points.filter", values, ctx=Context(remove))


def test_progress_rises_over_reading_running_and_writing(text: Path, tmp_path: Path) -> None:
    seen: list[float] = []
    values = {"points": text, "kept": tmp_path / "out.laz"}
    toolbox.run("points.filter", values, ctx=Context(seen.append))
    assert seen == sorted(seen)
    assert seen[-1] == 1


@pytest.mark.parametrize(("suffix", "content"), [(".ifc", "fronts"), (".city.json", "buildings")])
def test_formats_of_certain_layers_are_told_before_the_run(
    tmp_path: Path, suffix: str, content: str
) -> None:
    """Contours are no fronts; what only passes features on may well have them."""
    surface, never = layers.raster(np.arange(12.0).reshape(3, 4)), Context(stop=lambda: True)
    with pytest.raises(ParameterError, match=rf"contours: \{suffix} holds {content}.*\.gpkg"):
        toolbox.run(
            "surface.contours", {"surface": surface, "contours": tmp_path / f"a{suffix}"}, ctx=never
        )
    merged = catalog.load("vectors.merge").results["merged"]
    assert suffix in merged.suffixes
    assert suffix not in catalog.load("surface.contours").results["contours"].suffixes
