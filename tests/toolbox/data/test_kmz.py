"""KMZ: one well-formed KML with styles, in WGS 84, whose wires hang in the air."""

from __future__ import annotations

import zipfile
from pathlib import Path
from xml.etree import ElementTree

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS, Transformer

from toolbox.data import Vector
from toolbox.data.report import Column

SPACE = "{http://www.opengis.net/kml/2.2}"


def line(crs: str = "EPSG:32635+5773") -> geopandas.GeoDataFrame:
    """Two wires and a tower, heights in the unit of the CRS."""
    xyz = [[500_000, 4_500_000, 120], [500_100, 4_500_000, 110], [500_200, 4_500_000, 120]]
    shapes = [
        shapely.LineString(xyz),
        shapely.LineString(np.add(xyz, [0, 10, 0])),
        shapely.Point(500_000, 4_500_005, 100),
    ]
    columns = {"layer": ["wire", "wire", "tower & mast"], "wire_id": [1, 2, 0]}
    return geopandas.GeoDataFrame(columns, geometry=shapes, crs=CRS(crs))


def opened(path: Path) -> ElementTree.Element:
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        assert archive.namelist() == ["doc.kml", "files/dot.png"]
        document = ElementTree.fromstring(archive.read("doc.kml"))[0]
    assert document.tag == f"{SPACE}Document"
    return document


def test_styles_come_first_and_each_is_there(tmp_path: Path) -> None:
    """The order of the elements of a Document in the schema: styles, columns, features."""
    Vector(line()).save(tmp_path / "a.kmz")
    document = opened(tmp_path / "a.kmz")
    tags = [child.tag.removeprefix(SPACE) for child in document]
    assert tags == ["Style"] * 2 + ["Schema"] * 2 + ["Folder"] * 2
    styles = {f"#{style.get('id')}" for style in document.iter(f"{SPACE}Style")}
    used = [place.findtext(f"{SPACE}styleUrl") for place in document.iter(f"{SPACE}Placemark")]
    assert len(used) == 3
    assert set(used) == styles
    schemas = {f"#{schema.get('id')}" for schema in document.iter(f"{SPACE}Schema")}
    assert {data.get("schemaUrl") for data in document.iter(f"{SPACE}SchemaData")} <= schemas
    assert document.findtext(f"{SPACE}Folder[2]/{SPACE}name") == "tower & mast"


def test_wires_hang_at_their_heights_in_wgs_84(tmp_path: Path) -> None:
    Vector(line()).save(tmp_path / "a.kmz")
    document = opened(tmp_path / "a.kmz")
    wire = next(document.iter(f"{SPACE}LineString"))
    assert wire.findtext(f"{SPACE}altitudeMode") == "absolute"
    text = wire.findtext(f"{SPACE}coordinates") or ""
    found = np.array([list(map(float, triple.split(","))) for triple in text.split()])
    to_degrees = Transformer.from_crs(32635, 4326, always_xy=True)
    x, y, z = np.array(line().geometry[0].coords).T
    np.testing.assert_allclose(found, np.column_stack([*to_degrees.transform(x, y), z]), atol=1e-9)


def test_heights_in_feet_become_metres(tmp_path: Path) -> None:
    Vector(line("EPSG:32635+6360")).save(tmp_path / "a.kmz")  # NAVD88 in US survey feet
    text = next(opened(tmp_path / "a.kmz").iter(f"{SPACE}coordinates")).text or ""
    assert float(text.split()[0].split(",")[2]) == pytest.approx(120 * 1200 / 3937)


def test_heights_above_the_ellipsoid_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    Vector(line()).save(tmp_path / "a.kmz")
    assert not caplog.text
    Vector(line().set_crs(CRS(32635).to_3d(), allow_override=True)).save(tmp_path / "b.kmz")
    assert "b.kmz: its heights are above the ellipsoid" in caplog.text


def test_heights_that_are_not_stated_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    Vector(line("EPSG:32635")).save(tmp_path / "a.kmz")
    assert "a.kmz: the data do not state what heights refer to" in caplog.text


def test_objects_have_a_folder_and_a_colour_for_each_severity(tmp_path: Path) -> None:
    rows = {
        "layer": ["objects"] * 3,
        "severity": ["watch", "critical", None],
        "kind": ["tree", "building", None],
        "object_id": [1, 2, 3],
    }
    places = [shapely.Point(500_000 + k, 4_500_000, 5) for k in range(3)]
    Vector(geopandas.GeoDataFrame(rows, geometry=places, crs="EPSG:32635+5773")).save(
        tmp_path / "a.kmz"
    )
    document = opened(tmp_path / "a.kmz")
    folders = [folder.findtext(f"{SPACE}name") for folder in document.iter(f"{SPACE}Folder")]
    assert folders == ["objects, critical", "objects, watch", "objects"]
    names = [place.findtext(f"{SPACE}name") for place in document.iter(f"{SPACE}Placemark")]
    assert names == ["building 2", "tree 1", "objects 3"]
    colours = [
        style.findtext(f"{SPACE}LineStyle/{SPACE}color") for style in document.iter(f"{SPACE}Style")
    ]
    assert colours[:2] == ["ff0000d7", "ff00d7ff"]
    icons = {href.text for href in document.iter(f"{SPACE}href")}
    assert icons == {"files/dot.png"}, "nothing comes from a network"


COLUMNS = {
    "clearance": Column("Clearance", "m", 2),
    "seen": Column("Seen", "%", 0, 100.0),
    "rule": Column("Rule"),
    "own": Column(""),
    "found": Column("Found"),
}


def told(path: Path) -> list[str]:
    places = opened(path).iter(f"{SPACE}Placemark")
    return [place.findtext(f"{SPACE}description") or "" for place in places]


def test_balloons_have_headings_units_and_no_more_than_fits(tmp_path: Path) -> None:
    rows: dict[str, list[object]] = {
        "object_id": [7.0, float("nan")],
        "rule": ["a < b", None],
        "clearance": [0.2179, 3.0],
        "seen": [0.5, 1.0],
        "own": [1, 2],
        "code": [3, 4],
        "found": [True, False],
    }
    places = [shapely.Point(500_000 + k, 4_500_000, 5) for k in range(2)]
    layer = Vector(geopandas.GeoDataFrame(rows, geometry=places, crs="EPSG:32635+5773"))
    layer.save(tmp_path / "a.kmz", headings={"": COLUMNS})
    first, second = told(tmp_path / "a.kmz")
    assert "<td>Clearance</td><td>0.22 m</td>" in first
    assert "<td>Object</td><td>7</td>" in first, "whole, though another layer has none"
    assert "<td>Seen</td><td>50 %</td>" in first
    assert "<td>Rule</td><td>a &lt; b</td>" in first
    assert "<td>Found</td><td>yes</td>" in first
    assert "Rule" not in second, "nothing is known"
    assert "code" not in first
    assert "own" not in first, "left out of reports"
    assert first.index("Object") < first.index("Clearance") < first.index("Rule"), "as declared"
    many = {f"n{k}": Column(f"N {k}") for k in range(30)}
    frame = layer.frame.assign(**dict.fromkeys(many, 1))
    Vector(frame).save(tmp_path / "b.kmz", headings={"": many})
    assert told(tmp_path / "b.kmz")[0].count("<tr>") == 10


def test_balloons_of_joined_layers_have_the_headings_of_each(tmp_path: Path) -> None:
    layer = Vector(line().assign(height=[1.0, 2.0, 3.0]))
    wires, towers = ({"height": Column(text, "m", 1)} for text in ("Sag", "Top"))
    layer.save(tmp_path / "a.kmz", headings={"wire": wires, "tower & mast": towers})
    found = [("Sag" in text, "Top" in text) for text in told(tmp_path / "a.kmz")]
    assert found == [(True, False), (True, False), (False, True)]


def test_kml_has_a_name_a_style_and_words_and_is_read_again(tmp_path: Path) -> None:
    shape = shapely.box(500_000, 4_500_000, 500_900, 4_500_900)
    rows = {"body": [1], "level": [499.998], "kind": [None]}
    frame = geopandas.GeoDataFrame(rows, geometry=[shape], crs="EPSG:32635")
    columns = {"level": Column("Level of the water", "m", 2)}
    Vector(frame).save(tmp_path / "water.kml", headings={"": columns})
    document = ElementTree.parse(tmp_path / "water.kml").getroot()[0]
    (place,) = document.iter(f"{SPACE}Placemark")
    assert place.findtext(f"{SPACE}name") == "water 1"
    assert "<td>Level of the water</td><td>500.00 m</td>" in str(
        place.findtext(f"{SPACE}description")
    )
    tags = [child.tag.removeprefix(SPACE) for child in place]
    assert tags == ["name", "description", "styleUrl", "ExtendedData", "Polygon"], "as the schema"
    (style,) = document.findall(f"{SPACE}Style")
    assert place.findtext(f"{SPACE}styleUrl") == f"#{style.get('id')}"
    alpha, blue, green, red = bytes.fromhex(style.findtext(f"{SPACE}PolyStyle/{SPACE}color") or "")
    assert 0x40 < alpha < 0xC0, "what lies below is seen"
    assert blue > green > red
    again = Vector.open(tmp_path / "water.kml")
    assert again.frame["level"].tolist() == [499.998]


def test_kml_colours_severities_in_one_layer(tmp_path: Path) -> None:
    places = [shapely.Point(500_000 + k, 4_500_000) for k in range(3)]
    rows = {"severity": ["watch", "critical", "watch"], "object_id": [1, 2, 3]}
    Vector(geopandas.GeoDataFrame(rows, geometry=places, crs=32635)).save(tmp_path / "a.kml")
    document = ElementTree.parse(tmp_path / "a.kml").getroot()[0]
    used = [place.findtext(f"{SPACE}styleUrl") for place in document.iter(f"{SPACE}Placemark")]
    assert used == ["#style0", "#style1", "#style0"]
    colours = [
        style.findtext(f"{SPACE}IconStyle/{SPACE}color") for style in document.iter(f"{SPACE}Style")
    ]
    assert colours == ["ff00d7ff", "ff0000d7"]
    assert not list(document.iter(f"{SPACE}href")), "a KML alone has no pictures with it"
    assert Vector.layers(tmp_path / "a.kml") == ("a",)
