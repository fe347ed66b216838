"""Vector layers come back as they went, or are refused."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import geopandas
import numpy as np
import pyogrio
import pytest
import shapely
from pyproj import CRS

from toolbox.data.crs import LOCAL, LOCALS, describe_crs, parse_crs, same_crs
from toolbox.data.vector import Vector
from toolbox.errors import DataError

X, Y = 700000.0, 6600000.0
# A mesh and CityJSON hold polygons alone.
FLAT = [suffix for suffix in Vector.SUFFIXES if suffix not in (".ply", ".city.json", ".ifc")]
KEEPING = [
    suffix for suffix in FLAT if suffix not in (".kml", ".kmz", ".dxf", ".csv")
]  # other CRS, and none


def points(crs: CRS | str | None = "EPSG:2154+5720") -> geopandas.GeoDataFrame:
    return geopandas.GeoDataFrame(
        {"n": [1, 2], "share": [0.1 + 0.2, 1e-9], "text": ["é", "b"], "good": [True, False]},
        geometry=[shapely.Point(X, Y, 3.25), shapely.Point(X + 1, Y, 4)],
        crs=parse_crs(crs) if isinstance(crs, str) else crs,
    )


def sorted_by_n(frame: geopandas.GeoDataFrame) -> geopandas.GeoDataFrame:
    """FlatGeobuf sorts features in space."""
    return frame.sort_values("n").reset_index(drop=True)


@pytest.mark.parametrize("suffix", KEEPING)
@pytest.mark.parametrize("crs", ["EPSG:2154", "EPSG:2154+5720", "EPSG:2227+6360", "EPSG:4326"])
def test_round_trip(tmp_path: Path, suffix: str, crs: str) -> None:
    frame = points(crs)
    Vector(frame).save(tmp_path / f"a{suffix}")
    found = Vector.open(tmp_path / f"a{suffix}")
    assert same_crs(found.crs, frame.crs)
    assert found.name == f"a{suffix}"
    assert len(found) == 2
    back = sorted_by_n(found.frame)
    assert back.geometry.to_wkb().equals(frame.geometry.to_wkb())
    for column in ("n", "text", "good"):
        assert back[column].tolist() == frame[column].tolist()
    rounded = 1e-14 if suffix in (".geojson", ".shp") else 0  # GDAL writes these as decimal text
    assert back["share"].tolist() == pytest.approx([0.1 + 0.2, 1e-9], rel=rounded, abs=0)
    assert found.frame["good"].dtype == bool


def test_geopackage_as_older_qgis_wants_it(tmp_path: Path) -> None:
    Vector(points()).save(tmp_path / "roofs.gpkg")
    assert pyogrio.list_layers(tmp_path / "roofs.gpkg").tolist() == [["roofs", "Point Z"]]
    version = int.from_bytes((tmp_path / "roofs.gpkg").read_bytes()[60:64], "big")
    assert version == 10300  # the user_version of its SQLite header
    Vector(points()).save(tmp_path / "roofs.gpkg", layer="other", overwrite=True)
    assert pyogrio.list_layers(tmp_path / "roofs.gpkg").tolist() == [["other", "Point Z"]]


@pytest.mark.parametrize("suffix", FLAT)
def test_same_bytes_on_every_run(tmp_path: Path, suffix: str) -> None:
    """No file says when it was written: GDAL would write the time or the day into two of them."""
    files = []
    for run in ("first", "second"):
        (tmp_path / run).mkdir()
        Vector(points("EPSG:2154")).save(tmp_path / run / f"a{suffix}")
        files.append({p.name: p.read_bytes() for p in (tmp_path / run).iterdir()})
    assert files[0] == files[1]
    if suffix == ".gpkg":
        assert b"2000-01-01T00:00:00.000Z" in files[0]["a.gpkg"]
    assert files[0].get("a.dbf", b"\3\x64\1\1")[1:4] == bytes([100, 1, 1])  # 2000-01-01
    assert pyogrio.get_gdal_config_option("OGR_CURRENT_DATE") is None


def test_stale_parts_are_removed(tmp_path: Path) -> None:
    """A .prj of another layer would give a layer without CRS the CRS of that one."""
    path = tmp_path / "a.shp"
    Vector(points("EPSG:32631")).save(path)
    (tmp_path / "a.sbn").write_text("index of other features")
    assert set(tmp_path.iterdir()) <= set(Vector.own_files(path))
    Vector(points(None)).save(path, overwrite=True)
    assert Vector.open(path).crs is None
    endings = sorted(part.suffix for part in tmp_path.iterdir())
    assert endings == [".cpg", ".dbf", ".shp", ".shx"]


def test_parts_of_one_file_formats() -> None:
    assert Vector.own_files("b/a.geojson") == (Path("b/a.geojson"),)
    assert Vector.own_files("b/a.gpkg")[:2] == (Path("b/a.gpkg"), Path("b/a.gpkg-wal"))


def test_kml_draws_lines_at_their_heights_and_areas_on_the_ground(tmp_path: Path) -> None:
    """Without an altitudeMode, a wire would be drawn on the ground."""
    line = shapely.LineString([(500_000, 4_000_000, 90), (500_100, 4_000_000, 80)])
    area = shapely.force_3d(line.buffer(5), 85.0)
    for shape, heights in ((line, True), (area, False), (shapely.force_2d(line), False)):
        frame = geopandas.GeoDataFrame(geometry=[shape], crs=32635)
        Vector(frame).save(tmp_path / "a.kml", overwrite=True)
        text = (tmp_path / "a.kml").read_text()
        assert ("<altitudeMode>absolute</altitudeMode>" in text) == heights


def test_kml_is_in_wgs84_with_the_heights_kept(tmp_path: Path) -> None:
    Vector(points()).save(tmp_path / "a.kml")
    found = Vector.open(tmp_path / "a.kml")
    assert describe_crs(found.crs) == "EPSG:4326 WGS 84"
    longitude, latitude, height = shapely.get_coordinates(found.frame.geometry, include_z=True)[0]
    assert (longitude, latitude) == pytest.approx((3.0, 46.5), abs=1e-7)
    assert height == 3.25


@pytest.mark.parametrize(
    ("crs", "metres"),
    [("EPSG:2227", 1200 / 3937), ("EPSG:2227+5703", 1.0), ("EPSG:2154+6360", 1200 / 3937)],
)
def test_kml_has_heights_in_metres(tmp_path: Path, crs: str, metres: float) -> None:
    Vector(points(crs)).save(tmp_path / "a.kml")
    found = Vector.open(tmp_path / "a.kml").frame.geometry
    assert [place.z for place in found] == pytest.approx([3.25 * metres, 4 * metres])


@pytest.mark.parametrize("crs", [None, *LOCALS.values()])
@pytest.mark.parametrize("suffix", [".gpkg", ".fgb", ".shp", ".parquet", ".csv"])
def test_a_local_crs_is_kept_where_the_format_can_hold_it(
    tmp_path: Path, suffix: str, crs: CRS | None, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    Vector(points(crs)).save(tmp_path / f"a{suffix}")
    holds = suffix in (".gpkg", ".parquet")
    assert same_crs(Vector.open(tmp_path / f"a{suffix}").crs, crs if holds else None)
    told = f"a{suffix}: the format holds no CRS ({describe_crs(crs)})" in caplog.messages
    assert told == (not holds and crs is not None)


def test_layers_of_a_geopackage_have_each_their_local_crs(tmp_path: Path) -> None:
    path = tmp_path / "a.gpkg"
    Vector(points(LOCALS["local:mm"])).save(path, layer="wall")
    Vector(points(CRS(2154))).save(path, layer="ground", add=True)
    Vector(points(None)).save(path, layer="sketch", add=True)
    found = [Vector.open(path, layer=name).crs for name in ("wall", "ground", "sketch")]
    assert [describe_crs(crs)[:10] for crs in found] == ["local coor", "EPSG:2154 ", "no CRS"]
    assert not pyogrio.read_info(path, layer="wall")["crs"]


@pytest.mark.parametrize("geometry_type", ["Point", "Polygon Z"])
@pytest.mark.parametrize("suffix", [".gpkg", ".fgb", ".shp"])
def test_empty_layer_keeps_columns_and_geometry_type(
    tmp_path: Path, suffix: str, geometry_type: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.ERROR)
    columns = {"n": np.array([], np.int64), "share": np.array([])}
    frame = geopandas.GeoDataFrame(columns, geometry=[], crs=2154)
    Vector(frame, geometry_type=geometry_type).save(tmp_path / f"a{suffix}")
    found = Vector.open(tmp_path / f"a{suffix}")
    assert (len(found), found.geometry_type) == (0, geometry_type)
    assert found.frame.dtypes.astype(str).tolist() == ["int64", "float64", "geometry"]
    assert found.crs == CRS(2154)


@pytest.mark.parametrize("suffix", [".geojson", ".parquet"])
def test_empty_layer_of_other_formats(tmp_path: Path, suffix: str) -> None:
    Vector(geopandas.GeoDataFrame({"n": []}, geometry=[], crs=2154)).save(tmp_path / f"a{suffix}")
    found = Vector.open(tmp_path / f"a{suffix}")
    assert (len(found), found.crs) == (0, CRS(2154))


@pytest.mark.parametrize("suffix", [".gpkg", ".geojson", ".fgb", ".parquet"])
def test_mixed_geometry_types(tmp_path: Path, suffix: str) -> None:
    line = shapely.LineString([(X, Y), (X + 1, Y)])
    shapes = [shapely.Point(X, Y), line, line.buffer(1)]
    frame = geopandas.GeoDataFrame({"n": [1, 2, 3]}, geometry=shapes, crs=2154)
    Vector(frame).save(tmp_path / f"a{suffix}")
    back = sorted_by_n(Vector.open(tmp_path / f"a{suffix}").frame)
    assert back.geom_type.tolist() == ["Point", "LineString", "Polygon"]


CUSTOM = CRS.from_wkt(
    CRS(2154).to_wkt().replace("700000", "700001").split(',ID["EPSG",2154]')[0] + "]"
)
LINE = geopandas.GeoSeries([shapely.Point(0, 0), shapely.LineString([(0, 0), (1, 1)])], crs=2154)


@pytest.mark.parametrize(
    ("frame", "suffix", "problem"),
    [
        (points(), ".dwg", "vector layers are written as .gpkg, .geojson"),
        (points().assign(text="a\0b"), ".gpkg", r"'text' has a zero byte in 'a\\x00b'"),
        (points().assign(text="a\0b"), ".geojson", "has a zero byte"),
        (points().rename(columns={"text": "a\0b"}), ".shp", "has a zero byte"),
        (points().assign(n=[1, 10**18]), ".shp", "numbers of more than 18 characters, as n has"),
        (points().assign(n=[1, -(10**17)]), ".shp", "numbers of more than 18 characters, as n has"),
        (points().assign(share=[1.0, np.inf]), ".shp", "cannot hold infinity, as share has"),
        (points().set_geometry(LINE).rename(columns={"n": "WKT"}), ".csv", "is wkt; rename"),
        (points().assign(text="x" * 300), ".shp", "cannot hold the layer: .*truncated to 254"),
        (points().set_geometry(LINE), ".shp", "cannot be written: .*non-point"),
        (points(None), ".geojson", r"cannot hold the CRS of the layer \(no CRS\) .*EPSG:4979"),
        (points(LOCAL), ".geojson", "cannot hold the CRS of the layer"),
        (points(CUSTOM), ".geojson", r"cannot hold the CRS .*RGF93.*write a GeoPackage"),
        (points(None), ".kml", "the layer has no CRS to transform it from"),
    ],
)
def test_what_a_format_cannot_hold(
    tmp_path: Path, frame: geopandas.GeoDataFrame, suffix: str, problem: str
) -> None:
    path = tmp_path / f"a{suffix}"
    with pytest.raises(DataError, match=problem) as error:
        Vector(frame).save(path)
    assert str(error.value).startswith(str(path))


def test_folder_is_missing(tmp_path: Path) -> None:
    for suffix in FLAT:
        with pytest.raises(DataError, match="cannot be written"):
            Vector(points("EPSG:2154")).save(tmp_path / "none" / f"a{suffix}")


def test_parquet_needs_pyarrow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("toolbox.data.extras.find_spec", lambda name: None)
    with pytest.raises(DataError, match="pip install pyarrow"):
        Vector(points()).save(tmp_path / "a.parquet")


def test_frame_handed_out_may_be_changed() -> None:
    vector = Vector(points())
    frame = vector.frame
    frame.loc[0, "n"] = 99
    frame.geometry = [shapely.Point(0, 0)] * 2
    assert vector.frame["n"].tolist() == [1, 2]
    assert vector.frame.geometry[0] == shapely.Point(X, Y, 3.25)


def test_another_crs_is_said_not_made() -> None:
    vector = Vector(points(None), name="a.shp")
    found = vector.with_crs(CRS(2992))
    assert vector.crs is None
    assert vector.metre == 1.0
    assert found.metre == pytest.approx(1 / 0.3048)
    assert found.frame.geometry[0] == vector.frame.geometry[0]
    assert found.name == "a.shp"


def test_what_is_no_vector_layer(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"none\.gpkg: no such file"):
        Vector.open(tmp_path / "none.gpkg")
    for text, problem in (
        ("a,b\n1,2\n", "features need columns x and y, or wkt, and it has a, b"),
        ("x,y\n1,2\n3,\n", "row 2 has no position"),
        ("x,y\n1,2\n3,north\n", "row 2, column y: 'north' is no number$"),
        ("id;x;y\nA;1;2\nB;3,5;1.O25\n", "row 2, column y: '1.O25' is no number$"),
        ('x,y\n1,2\n3,"2,5"\n', "'2,5' is no number; decimals must all have a point"),
        ("A1,1,2,3\nA2,1,2,3\n", "its first line must name the columns, such as name,x,y,z"),
        ("n,wkt\n1,POINT (1\n", "cannot be read as a vector layer"),
    ):
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(DataError, match=problem):
            Vector.open(tmp_path / "a.csv")
    (tmp_path / "a.txt").write_text("x,y\n1,2\n")
    with pytest.raises(
        DataError, match=r"layers are read from \.gpkg, .*, not \.txt; save it as \.csv"
    ):
        Vector.open(tmp_path / "a.txt")
    for name in ("a.gpkg", "a.geojson", "a.shp", "a.parquet"):
        (tmp_path / name).write_text("no layer")
        with pytest.raises(DataError, match=f"{name} cannot be read as a vector layer"):
            Vector.open(tmp_path / name)


def test_a_damaged_crs_of_a_shapefile_is_an_error(tmp_path: Path) -> None:
    Vector(points()).save(tmp_path / "a.shp")
    text = (tmp_path / "a.prj").read_text(encoding="latin-1")
    (tmp_path / "a.prj").write_text(text.replace('PROJCS["', 'PROJCS["{}'), encoding="latin-1")
    with pytest.raises(DataError, match=r"a\.shp cannot be read as a vector layer"):
        Vector.open(tmp_path / "a.shp")


def test_styles_in_a_geopackage_are_no_layer(tmp_path: Path) -> None:
    """QGIS keeps styles in a table without geometry."""
    import pandas

    Vector(points()).save(tmp_path / "a.gpkg")
    styles = pandas.DataFrame({"styleName": ["x"]})
    pyogrio.write_dataframe(styles, tmp_path / "a.gpkg", layer="layer_styles")
    assert len(Vector.open(tmp_path / "a.gpkg")) == 2


def test_measured_geometry_is_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.ERROR)  # the library tells by the root logger too
    frame = geopandas.GeoDataFrame({"n": np.array([], int)}, geometry=[], crs=2154)
    Vector(frame, geometry_type="Polygon Z").save(tmp_path / "a.shp")
    caplog.set_level(logging.WARNING)
    Vector.open(tmp_path / "a.shp")
    assert any("a.shp: Measured (M) geometry" in message for message in caplog.messages)


def test_layers_of_a_file(tmp_path: Path) -> None:
    Vector(points()).save(tmp_path / "a.gpkg", layer="roofs")
    Vector(points()).save(tmp_path / "a.parquet")
    points().drop(columns="geometry").to_parquet(tmp_path / "table.parquet")
    assert Vector.layers(tmp_path / "a.gpkg") == ("roofs",)
    assert Vector.layers(tmp_path / "a.parquet") == ("a",)
    assert Vector.layers(tmp_path / "table.parquet") == ()
    (tmp_path / "no.parquet").write_text("no layer")
    for name in ("none.gpkg", "no.parquet"):
        with pytest.raises(DataError, match=name):
            Vector.layers(tmp_path / name)


def test_map_of_several_layers(data: Callable[[str], Path]) -> None:
    path = data("ahn3_delft_bgt/bgt_east_cropped_2.gpkg")
    with pytest.raises(DataError, match="has 7 vector layers; name one: pand, waterdeel, "):
        Vector.open(path)
    with pytest.raises(DataError, match="has no vector layer 'roofs', only pand, waterdeel"):
        Vector.open(path, layer="roofs")
    buildings = Vector.open(path, layer="pand")
    assert (len(buildings), buildings.geometry_type) == (28, "Polygon")
    assert describe_crs(buildings.crs) == "EPSG:28992 Amersfoort / RD New"


def test_shapefile_of_buildings(data: Callable[[str], Path], tmp_path: Path) -> None:
    buildings = Vector.open(data("ign_buildings_bdtopo/bdtopo_buildings.shp"))
    assert (len(buildings), describe_crs(buildings.crs)[:9]) == (40, "EPSG:2154")
    buildings.save(tmp_path / "a.gpkg")
    back = Vector.open(tmp_path / "a.gpkg").frame
    assert back.geometry.to_wkb().equals(buildings.frame.geometry.to_wkb())
    assert back.drop(columns="geometry").equals(buildings.frame.drop(columns="geometry"))


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_points_of_surveyors_are_read_from_csv(tmp_path: Path, separator: str) -> None:
    """Columns in the words of surveyors; the names of the points stay."""
    rows = ["Nokta,Rechtswert,Hochwert,Höhe", "P1,500010.5,4500020.5,12.25"]
    path = tmp_path / "points.csv"
    path.write_text("\n".join(rows).replace(",", separator), encoding="utf-8")
    frame = Vector.open(path).frame
    assert shapely.get_coordinates(frame.geometry, include_z=True).tolist() == [
        [500010.5, 4500020.5, 12.25]
    ]
    assert frame["Nokta"].tolist() == ["P1"]
    assert list(frame) == ["Nokta", "geometry"]


@pytest.mark.parametrize(
    "text",
    [
        "P1,10.5,20.5,3\nP2,11,21,4\n",
        "Nr,Hoch,Rechts,H\nP1,10.5,20.5,3\nP2,11,21,4\n",
        "P1;10,5;20,5;3\nP2;11;21;4\n",
    ],
)
def test_columns_of_a_csv_can_be_named(text: str, tmp_path: Path) -> None:
    """Checkpoints without a first line of names, or with other words, as point clouds can."""
    (tmp_path / "a.csv").write_text(text)
    names = ["name", "y", "x", "z"]
    frame = Vector.open(tmp_path / "a.csv", columns=names).frame
    assert shapely.get_coordinates(frame.geometry, include_z=True).tolist() == [
        [20.5, 10.5, 3],
        [21, 11, 4],
    ]
    assert frame["name"].tolist() == ["P1", "P2"]
    with pytest.raises(DataError, match="4 columns, and 3 names for them"):
        Vector.open(tmp_path / "a.csv", columns=names[1:])
    Vector(frame.set_crs(32635)).save(tmp_path / "a.gpkg")
    with pytest.raises(DataError, match=r"columns are for CSV files, not for \.gpkg"):
        Vector.open(tmp_path / "a.gpkg", columns=names)


def test_columns_that_may_be_either_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("No,Y,X,Kot\n1,500010.5,4500020.5,12\n")
    with pytest.raises(DataError, match=r"columns Y, X stand in this order.*rename them to x"):
        Vector.open(path)
    path.write_text("No;East;North;Kot\n1;500010,5;4500020,5;12,5\n2;1.5;2.5;3\n")
    with pytest.raises(DataError, match="decimals must all have a point, or all a comma"):
        Vector.open(path)


def test_decimals_of_spreadsheets_may_have_commas(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "points.csv"
    path.write_text("No;East;North;Kot;sd;classes\nP1;500010,5;4500020;12,5;0,25;2,9\n")
    frame = Vector.open(path).frame
    assert frame.geometry[0].wkt == "POINT Z (500010.5 4500020 12.5)"
    assert frame["sd"][0] == 0.25
    assert "commas are read as decimal points" in caplog.text
    caplog.clear()
    path.write_text("No;East;North;classes\nP1;500010.5;4500020;2,9\n")
    assert Vector.open(path).frame["classes"][0] == "2,9"  # is left as it is
    assert not caplog.text


def test_heights_in_our_own_tables_stay_attributes(tmp_path: Path) -> None:
    """The height of a tree is no elevation of its top."""
    frame = geopandas.GeoDataFrame({"height": [9.5]}, geometry=[shapely.Point(1, 2)])
    Vector(frame).save(tmp_path / "tops.csv")
    found = Vector.open(tmp_path / "tops.csv").frame
    assert found["height"].tolist() == [9.5]
    assert not found.geometry.has_z.any()


@pytest.mark.parametrize("number", [0, -1])
def test_an_undefined_crs_of_a_geopackage_is_none(tmp_path: Path, number: int) -> None:
    """QGIS writes a layer in memory without a CRS so; nobody could say which one it has."""
    path = tmp_path / "a.gpkg"
    Vector(points()).save(path)
    with closing(sqlite3.connect(path)) as file:
        for table in ("gpkg_contents", "gpkg_geometry_columns"):
            file.execute(f"UPDATE {table} SET srs_id = ?", (number,))
        file.commit()
    assert Vector.open(path).crs is None
    assert Vector.open(path, assume_crs=2992).crs == CRS(2992)
