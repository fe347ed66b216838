"""The verb `info` recognises what a file holds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pyogrio
import pytest
import shapely
from affine import Affine
from scenes.layers import cloud

from toolbox.cli.info import describe_file
from toolbox.cli.main import main
from toolbox.data import PointCloud, Raster, Table, Vector
from toolbox.errors import DataError, ParameterError


def rows(path: Path) -> dict[str, Any]:
    """Value of each property; all sorts of file have the same three columns."""
    table = describe_file(path)
    assert list(table.frame) == ["property", "value", "unit"]
    return {row["property"]: row["value"] for row in table.rows()}


def outlines(*shapes: Any) -> Vector:
    columns = {"n": np.arange(len(shapes)), "text": ["é"] * len(shapes)}
    return Vector(geopandas.GeoDataFrame(columns, geometry=list(shapes), crs=2154))


@pytest.mark.parametrize("suffix", Table.SUFFIXES)
def test_tables(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    Table.from_rows([{"measure": "mean x", "value": 0.5, "n": 3}]).save(path)
    assert rows(path) == {
        "file": f"a{suffix}",
        "rows": 1,
        "column measure": "string",
        "column value": "float64",
        "column n": "int64",
    }


def test_layers_and_tables_of_a_geopackage(tmp_path: Path) -> None:
    path = tmp_path / "a.gpkg"
    outlines(shapely.Point(1, 2)).save(path, layer="spots")
    Table.from_rows([{"n": 1}, {"n": 2}]).save(path, layer="counts", add=True)
    found = rows(path)
    assert found["layers"] == 2
    assert (found["layer spots features"], found["table counts rows"]) == (1, 2)


@pytest.mark.parametrize(
    "suffix", [suffix for suffix in PointCloud.SUFFIXES if suffix not in (".ply", ".parquet")]
)
def test_point_clouds(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    PointCloud(np.arange(6.0).reshape(2, 3), {"intensity": np.array([1, 2], np.uint16)}).save(path)
    found = rows(path)
    assert (found["points"], found["xmin"], found["zmax"]) == (2, 0.0, 5.0)


@pytest.mark.parametrize(
    ("text", "points"),
    [
        ("1,2,3\n4,5,6\n", True),
        ("Easting;Northing;Height\n1;2;3\n", True),
        ("//X Y Z\n1 2 3\n", True),
        ("# made on Monday\n1 2 3\n", True),
        ("x,y,height,count\n1,2,3,4\n", True),
        ("x,y,count\n1,2,3\n", False),
        ("class,2,6\nground,1,0\n", False),
    ],
)
def test_text_with_coordinates_is_a_cloud(tmp_path: Path, text: str, points: bool) -> None:
    (tmp_path / "a.csv").write_text(text)
    assert ("points" in rows(tmp_path / "a.csv")) == points


@pytest.mark.parametrize("suffix", [".gpkg", ".geojson", ".fgb", ".shp", ".parquet"])
def test_vector_layers(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    outlines(shapely.box(1, 2, 3, 4), shapely.box(5, 2, 6, 4)).save(path)
    found = rows(path)
    assert found["crs"] == "EPSG:2154 RGF93 v1 / Lambert-93"
    assert (found["features"], found["geometry"]) == (2, "Polygon")
    assert [found[name] for name in ("xmin", "ymin", "xmax", "ymax")] == [1, 2, 6, 4]
    assert (found["column n"][:3], found["column text"]) == ("int", "str")
    assert "column geometry" not in found


def test_several_layers_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "a.gpkg"
    outlines(shapely.box(1, 2, 3, 4)).save(path, layer="roofs")
    trees = outlines(shapely.Point(1, 2), shapely.Point(3, 4)).frame
    pyogrio.write_dataframe(trees.set_crs(32631, allow_override=True), path, layer="trees")
    assert rows(path) == {
        "file": "a.gpkg",
        "layers": 2,
        "layer roofs": "Polygon",
        "layer roofs crs": "EPSG:2154 RGF93 v1 / Lambert-93",
        "layer roofs features": 1,
        "layer trees": "Point",
        "layer trees crs": "EPSG:32631 WGS 84 / UTM zone 31N",
        "layer trees features": 2,
    }


def test_empty_layers(tmp_path: Path) -> None:
    empty = geopandas.GeoDataFrame({"n": []}, geometry=[], crs=2154)
    Vector(empty, geometry_type="Polygon Z").save(tmp_path / "a.gpkg")
    found = rows(tmp_path / "a.gpkg")
    assert (found["features"], found["geometry"]) == (0, "Polygon Z")
    assert "xmin" not in found


def test_rasters(tmp_path: Path) -> None:
    values = np.array([[[1, np.nan], [3, 5]], [[np.nan] * 2] * 2], np.float32)
    raster = Raster(
        values,
        Affine(0.5, 0, 100, 0, -0.5, 200),
        descriptions=("Elevation", ""),
        units=("metre", ""),
    )
    raster.save(tmp_path / "a.tif")
    found = rows(tmp_path / "a.tif")
    assert (found["rows"], found["columns"], found["cell"], found["crs"]) == (2, 2, 0.5, None)
    assert [found[name] for name in ("xmin", "ymin", "xmax", "ymax")] == [100, 199, 101, 200]
    assert (found["band 1"], found["band 1 type"]) == ("Elevation", "float32")
    measures = ("cells without data", "minimum", "mean", "maximum")
    assert [found[f"band 1 {measure}"] for measure in measures] == [1, 1, 3, 5]
    assert found["band 2 cells without data"] == 4
    assert "band 2 mean" not in found
    units = {row["property"]: row["unit"] for row in describe_file(tmp_path / "a.tif").rows()}
    assert (units["band 1 mean"], units["rows"]) == ("metre", "")


def test_what_cannot_be_described(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"there is no file .*none\.csv"):
        describe_file(tmp_path / "none.csv")
    (tmp_path / "a.csv").write_text("")
    with pytest.raises(DataError, match=r"a\.csv is empty"):
        describe_file(tmp_path / "a.csv")
    for name in ("a.parquet", "a.json", "a.gpkg", "a.tif"):
        (tmp_path / name).write_text("nothing")
        with pytest.raises(DataError, match=name):
            describe_file(tmp_path / name)


def test_real_map_of_several_layers(data: Callable[[str], Path]) -> None:
    found = rows(data("ahn3_delft_bgt/bgt_east_cropped_2.gpkg"))
    assert found["layers"] == 7
    assert found["layer pand"] == "Polygon"
    assert found["layer pand features"] == 28
    assert found["layer pand crs"] == "EPSG:28992 Amersfoort / RD New"


@pytest.mark.parametrize("width", [40, 79])
def test_information_fits_the_terminal(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    width: int,
) -> None:
    """All of it is there, and programs that read a pipe find each property in one line."""
    PointCloud([[0, 0, 5.0], [1, 2, 6.0]]).save(tmp_path / "a.las")
    monkeypatch.delenv("COLUMNS", raising=False)
    assert main(["info", str(tmp_path / "a.las")]) == 0
    piped = capsys.readouterr().out
    assert max(map(len, piped.splitlines())) > 100
    monkeypatch.setenv("COLUMNS", str(width))
    assert main(["info", str(tmp_path / "a.las")]) == 0
    fitted = capsys.readouterr().out
    assert max(map(len, fitted.splitlines())) <= width
    rows = piped.partition("\n")[2]  # without the names of the columns
    assert sorted(fitted.split()) == sorted(rows.split())


def test_files_that_are_no_survey_are_described_one_by_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """To see that a delivery is mixed is what one looks for."""
    files = [str(tmp_path / name) for name in ("a.laz", "b.laz")]
    for file, crs in zip(files, ("EPSG:32635", "EPSG:32636+5773"), strict=True):
        cloud([[0, 0, 0], [1, 1, 1]]).with_crs(crs).save(file)
    assert main(["info", *files]) == 0
    said = capsys.readouterr()
    first, second = said.out.split("\n\n")
    assert "EPSG:32635" in first
    assert "not stated by the data" in first
    assert "EPSG:32636" in second
    assert "EGM96 height" in second
    assert "described one by one" in said.err
    assert main(["info", str(tmp_path)]) == 0
    assert capsys.readouterr().out == said.out
    Path(files[1]).write_bytes(b"no LAS")
    assert main(["info", *files]) == 3
    assert main(["info", str(tmp_path)]) == 3


def test_sentences_are_in_the_language_of_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cloud([[0.0, 0.0, 1.0], [1.0, 1.0, 1.0]]).save(tmp_path / "a.laz")
    monkeypatch.setenv("TOOLBOX_LANG", "tr")
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["info", str(tmp_path / "a.laz")]) == 0
    assert "veride belirtilmemiş" in capsys.readouterr().out


def test_a_crs_that_files_lack_may_be_stated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.csv").write_text("x,y,z\n500001,4500002,3\n")
    frame = outlines(shapely.box(5e5, 45e5, 5.1e5, 45.1e5)).frame.set_crs(None, allow_override=True)
    Vector(frame).save(tmp_path / "b.gpkg")
    for name in ("a.csv", "b.gpkg"):
        assert main(["info", str(tmp_path / name), "--assume-crs", "EPSG:32635"]) == 0
        assert "EPSG:32635 WGS 84 / UTM zone 35N" in capsys.readouterr().out
    assert main(["info", str(tmp_path / "a.csv"), "--assume-crs", "nonsense"]) == 2
    assert "assume_crs: 'nonsense' is not a CRS" in capsys.readouterr().err
