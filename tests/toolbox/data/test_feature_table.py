"""Features as CSV: points by their coordinates, others by WKT, exactly."""

from __future__ import annotations

from pathlib import Path

import geopandas
import pytest
import shapely

from toolbox.data.vector import Vector

SHAPES = {
    "points": [shapely.Point(700000.1 + 0.2, 1 / 3), shapely.Point(-1e-9, 5)],
    "points with heights": [shapely.Point(1, 2, 0.1 + 0.2), shapely.Point(1, 2, -3)],
    "areas": [shapely.Point(1 / 3, 2).buffer(1), shapely.MultiPolygon()],
    "lines": [shapely.LineString([(0, 0, 1 / 3), (1e6, 1, 2)]), shapely.Point(1, 2)],
}


@pytest.mark.parametrize("shapes", SHAPES)
def test_round_trip(tmp_path: Path, shapes: str) -> None:
    columns = {"id": [1, 2], "share": [0.1 + 0.2, None], "text": ["é,", "b"]}
    frame = geopandas.GeoDataFrame(columns, geometry=SHAPES[shapes])
    Vector(frame).save(tmp_path / "a.csv")
    found = Vector.open(tmp_path / "a.csv")
    assert found.frame.geometry.to_wkb().tolist() == frame.geometry.to_wkb().tolist()
    assert found.frame.drop(columns="geometry").to_dict("list").items() >= {"id": [1, 2]}.items()
    assert found.names == ("id", "share", "text")
    assert found.crs is None
    assert Vector.layers(tmp_path / "a.csv") == ("a",)


def test_points_are_columns_that_a_spreadsheet_shows(tmp_path: Path) -> None:
    places = geopandas.GeoDataFrame({"id": [7]}, geometry=[shapely.Point(1.5, 2, 3)])
    Vector(places).save(tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text() == "x,y,z,id\n1.5,2.0,3.0,7\n"
    Vector(places.assign(Z=9)).save(tmp_path / "a.csv", overwrite=True)
    assert (tmp_path / "a.csv").read_text() == "id,Z,wkt\n7,9,POINT Z (1.5 2 3)\n"


def test_nothing(tmp_path: Path) -> None:
    Vector(geopandas.GeoDataFrame({"id": []}, geometry=[])).save(tmp_path / "a.csv")
    assert len(Vector.open(tmp_path / "a.csv")) == 0


@pytest.mark.parametrize(
    ("kind", "header"),
    [("Point Z", "x,y,z,id"), ("Point", "x,y,id"), ("Unknown", "x,y,id"), ("Polygon", "id,wkt")],
)
def test_an_empty_table_has_the_columns_of_a_full_one(
    tmp_path: Path, kind: str, header: str
) -> None:
    """A program that read the objects of two surveys found other columns where there were none."""
    frame = geopandas.GeoDataFrame({"id": []}, geometry=[])
    Vector(frame, geometry_type=kind).save(tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text() == f"{header}\n"


@pytest.mark.parametrize("names", [None, ["name; note", "x", "y"]])
@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_marks_within_quotes_part_no_columns(
    names: list[str] | None, mark: str, tmp_path: Path
) -> None:
    """In such a line the mark within the quotes had been taken for that of the columns."""
    quoted = '"name; note, remark"'
    rows = [[quoted, "x", "y"], ["a", "1", "2"]]
    (tmp_path / "a.csv").write_text("".join(f"{mark.join(row)}\n" for row in rows))
    layer = Vector.open(tmp_path / "a.csv", columns=names)
    assert shapely.get_coordinates(layer.frame.geometry).tolist() == [[1.0, 2.0]]
