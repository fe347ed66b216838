"""CRS: reading, comparing, units."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from affine import Affine
from pyproj import CRS

from toolbox.data import Drawing, PointCloud, Raster, Vector
from toolbox.data.crs import (
    LOCAL,
    LOCALS,
    assumed,
    crs_conflict,
    crs_text,
    describe_crs,
    horizontal_crs,
    is_local,
    length_problem,
    metres_per_unit,
    parse_crs,
    same_crs,
    vertical_unit,
)
from toolbox.errors import DataError

DIALECTS = ["WKT2_2019", "WKT2_2015", "WKT1_GDAL", "WKT1_ESRI"]

# As older GeoTIFF and LAS files have it: other names, TOWGS84, a geoid grid.
OLD_UTM = (
    'COMPD_CS["UTM 10 + height",PROJCS["UTM 10",GEOGCS["NAD83",DATUM["North_American_Datum_1983",'
    'SPHEROID["GRS 1980",6378137,298.257222101],TOWGS84[0,0,0,0,0,0,0]],PRIMEM["Greenwich",0],'
    'UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
    'PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",-123],'
    'PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],'
    'PARAMETER["false_northing",0],UNIT["Meter",1]],'
    'VERT_CS["NAVD88",VERT_DATUM["North American Vertical Datum 1988",2005,'
    'EXTENSION["PROJ4_GRIDS","g2012a_conus.gtx"]],UNIT["Meter",1],AXIS["Up",UP]]]'
)


def parsed(text: str | None) -> CRS | None:
    return None if text is None else parse_crs(text)


@pytest.mark.parametrize(
    ("text", "description"),
    [
        ("EPSG:2154", "EPSG:2154 RGF93 v1 / Lambert-93"),
        (" epsg:2154 ", "EPSG:2154 RGF93 v1 / Lambert-93"),
        ("EPSG:2154+5720", "EPSG:2154+5720 RGF93 v1 / Lambert-93 + NGF-IGN69 height"),
        ("2154 + 5720", "EPSG:2154+5720 RGF93 v1 / Lambert-93 + NGF-IGN69 height"),
        ("EPSG:2154 + EPSG:5720", "EPSG:2154+5720 RGF93 v1 / Lambert-93 + NGF-IGN69 height"),
        ("EPSG:7415", "EPSG:28992+5709 Amersfoort / RD New + NAP height"),
        ("Local", "local coordinates in metres"),
        (CRS("EPSG:28992").to_wkt("WKT1_GDAL"), "EPSG:28992 Amersfoort / RD New"),
    ],
)
def test_text_is_read_and_described(text: str, description: str) -> None:
    assert describe_crs(parse_crs(text)) == description


def test_crs_without_a_code_is_described_by_its_name() -> None:
    own = CRS.from_wkt(CRS("EPSG:2154").to_wkt().replace("700000", "700001"))
    assert describe_crs(own) == "RGF93 v1 / Lambert-93"
    assert describe_crs(None) == "no CRS"


@pytest.mark.parametrize(
    "text",
    ["", "215", "Lambert-93", "+proj=utm +zone=31", "EPSG:999999", "EPSG:2154+", "PROJCS[", "a:b"],
)
def test_other_text_is_refused_with_the_forms_that_work(text: str) -> None:
    with pytest.raises(ValueError, match=r"is not a CRS.*'EPSG:2154\+5720'.*WKT.*'local'") as error:
        parse_crs(text)
    assert repr(text) in str(error.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("EPSG:2154+32635", "behind the + stands no height system but WGS 84 / UTM zone 35N"),
        ("EPSG:2154+EPSG:99999", "PROJ knows no height system EPSG:99999"),
        ("EPSG:5720+2154", "behind the + stands no height system but RGF93 v1 / Lambert-93"),
    ],
)
def test_the_part_that_is_no_height_system_is_named(text: str, says: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f"{text!r}: {says}; give")):
        parse_crs(text)


def test_heights_behind_a_code_of_esri_may_be_of_epsg() -> None:
    """ESRI has no 5703, so the digits alone were refused; its own heights stay its own."""
    assert parse_crs("ESRI:102008+5703") == parse_crs("ESRI:102008+EPSG:5703")
    assert parse_crs("ESRI:102008+115700") == CRS("ESRI:102008+115700")
    with pytest.raises(ValueError, match="PROJ knows no height system 99999"):
        parse_crs("ESRI:102008+99999")


def test_a_height_system_is_assumed_of_what_states_its_plane_alone() -> None:
    """Data with a CRS and without a datum of heights needed a run of its own to get one."""
    plane, whole = CRS(2154), CRS("EPSG:2154+5720")
    assert assumed(None, "EPSG:2154") == plane
    assert assumed(plane, whole) == whole
    assert assumed(plane, "EPSG:2154+ellipsoid") == parse_crs("EPSG:2154+ellipsoid")
    assert assumed(plane, "EPSG:2155+5720") == plane, "another plane is no mistake to repair"
    assert assumed(whole, "EPSG:2154+5717") == whole, "nor is another height system"
    assert assumed(parse_crs("local"), whole) == parse_crs("local")
    assert assumed(plane, None) == plane


def test_height_system_alone_is_refused() -> None:
    with pytest.raises(ValueError, match="'EPSG:5720' is a height system alone"):
        parse_crs("EPSG:5720")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("EPSG:2154", None),
        ("EPSG:2154+5720", None),
        ("EPSG:2227+6360", None),
        ("EPSG:2193", None),
        ("local", None),
        ("EPSG:4326", r"is in degrees \(EPSG:4326 WGS 84\); reproject it to a projected CRS first"),
        ("EPSG:4979", "is in degrees"),
        ("EPSG:4326+5773", "is in degrees"),
        ("EPSG:4978", "Geocentric CRS .*reproject"),
        ("EPSG:2227+5703", "horizontal US survey foot and vertical metre .*convert its heights"),
        ("EPSG:2992+6360", "horizontal foot and vertical US survey foot"),
        ("EPSG:32631+5831", "depths, not heights"),
    ],
)
def test_lengths_need_one_unit_of_length(text: str, problem: str | None) -> None:
    found = length_problem(parse_crs(text))
    if problem is None:
        assert found is None
    else:
        with pytest.raises(ValueError, match=problem):
            raise ValueError(found)


def test_unknown_crs_is_a_problem_that_says_what_to_do() -> None:
    text = length_problem(None)
    assert text is not None
    assert "assume_crs EPSG:..." in text
    assert "assume_crs local" in text
    unknown = CRS.from_wkt(
        LOCAL.to_wkt().replace('LENGTHUNIT["metre",1]', 'LENGTHUNIT["unknown",1]')
    )
    assert "unknown unit" in str(length_problem(unknown))


@pytest.mark.parametrize(
    ("text", "metres", "unit"),
    [
        ("EPSG:2154", 1.0, "metre"),
        ("EPSG:2227", 1200 / 3937, "US survey foot"),
        ("EPSG:2992", 0.3048, "foot"),
        ("EPSG:2227+5703", 1200 / 3937, "metre"),
        ("local", 1.0, "metre"),
        (OLD_UTM, 1.0, "metre"),
    ],
)
def test_units(text: str, metres: float, unit: str) -> None:
    crs = parse_crs(text)
    assert metres_per_unit(crs) == pytest.approx(metres, rel=1e-12)
    assert vertical_unit(crs) == unit


def test_units_that_are_not_lengths() -> None:
    with pytest.raises(DataError, match="EPSG:4326 WGS 84 is in degrees"):
        metres_per_unit(parse_crs("EPSG:4326"))
    assert metres_per_unit(None) == 1.0
    assert [vertical_unit(crs) for crs in (None, CRS(4326), CRS(4979))] == ["", "", "metre"]


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize(
    "text",
    ["EPSG:2154", "EPSG:2154+5720", "EPSG:2193", "EPSG:2227+6360", "EPSG:32631", "EPSG:7415"],
)
def test_dialect_makes_no_difference(text: str, dialect: str) -> None:
    crs = parse_crs(text)
    assert same_crs(crs, CRS.from_wkt(crs.to_wkt(dialect)))


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("EPSG:3067", "EPSG:5048"),  # axes listed in another order
        ("EPSG:7415", "EPSG:28992+5709"),
        ("EPSG:4326", "OGC:CRS84"),
        ("EPSG:26910+5703", OLD_UTM),
    ],
)
def test_same(a: str, b: str) -> None:
    assert same_crs(parse_crs(a), parse_crs(b))
    assert same_crs(parse_crs(b), parse_crs(a))


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("EPSG:2154", "EPSG:2154+5720"),  # one knows its heights
        ("EPSG:2154+5720", "EPSG:2154+5721"),  # vertical datum
        ("EPSG:26910+5703", "EPSG:26910+6360"),  # vertical unit
        ("EPSG:26910", OLD_UTM),
        ("EPSG:2154", "EPSG:9793"),  # RGF93 v1 and v2
        ("EPSG:25832", "EPSG:32632"),  # datum
        ("EPSG:25832", "EPSG:25833"),
        ("EPSG:26943", "EPSG:2227"),  # unit
        ("EPSG:2992", "EPSG:2994"),
        ("EPSG:2154", "local"),
        ("local", 'LOCAL_CS["other",UNIT["metre",1]]'),
        ("local", LOCAL.to_wkt().replace("Local coordinates", "Site coordinates")),
    ],
)
def test_different(a: str, b: str) -> None:
    assert not same_crs(parse_crs(a), parse_crs(b))
    assert not same_crs(parse_crs(b), parse_crs(a))


def test_no_crs_is_the_same_only_as_none() -> None:
    assert same_crs(None, None)
    assert same_crs(LOCAL, parse_crs("local"))
    assert not same_crs(None, LOCAL)
    assert not same_crs(CRS(2154), None)


@pytest.mark.parametrize(
    ("a", "b"),
    [
        (None, None),
        ("local", "local"),
        ("EPSG:7415", "EPSG:28992+5709"),
        ("EPSG:26910+5703", OLD_UTM),
    ],
)
def test_layers_in_the_same_crs_go_together(a: str | None, b: str | None) -> None:
    assert crs_conflict(parsed(a), parsed(b), heights=True) is None


@pytest.mark.parametrize(
    ("a", "b"),
    [("EPSG:2154", "EPSG:2154+5720"), ("EPSG:26910", OLD_UTM), ("EPSG:4326", "EPSG:4979")],
)
def test_heights_of_one_layer_alone_matter_only_where_heights_are_compared(a: str, b: str) -> None:
    flat, high = parse_crs(a), parse_crs(b)
    assert crs_conflict(flat, high, heights=False) is None
    assert crs_conflict(high, flat, heights=False) is None
    assert f"assign it the heights of {describe_crs(high)}" in str(
        crs_conflict(flat, high, heights=True)
    )
    assert f"assign its heights to {describe_crs(flat)}" in str(
        crs_conflict(high, flat, heights=True)
    )


@pytest.mark.parametrize("heights", [False, True])
@pytest.mark.parametrize(
    ("a", "b", "text"),
    [
        ("EPSG:2154", "EPSG:2192", "is in EPSG:2154 .*; reproject it to EPSG:2192 "),
        ("EPSG:25832+5783", "EPSG:32632", r"EPSG:25832\+5783 .*; reproject it to EPSG:32632 "),
        ("EPSG:4978", "EPSG:2154", "is in EPSG:4978 .*; reproject it to EPSG:2154 "),
        ("EPSG:2154+5720", "EPSG:2154+5721", r"5720 .*; bring its heights to EPSG:2154\+5721 "),
        ("EPSG:4979", "EPSG:4326+5773", "; bring its heights to EPSG:4326"),
        (None, "EPSG:2154", "has no CRS; state it with assume_crs, to go with EPSG:2154 "),
        (None, "local", "has no CRS; state it with assume_crs, to go with local coord"),
        ("EPSG:2154", None, "is in EPSG:2154 .*; state with assume_crs the missing CRS$"),
        ("local", "EPSG:2154", "is in local coordinates .*; it cannot be compared with EPSG:2154 "),
        ("EPSG:2154", "local", "is in EPSG:2154 .*; it cannot be compared with local coordinates"),
    ],
)
def test_layers_that_do_not_go_together(
    a: str | None, b: str | None, text: str, heights: bool
) -> None:
    found = crs_conflict(parsed(a), parsed(b), heights=heights)
    assert re.search(text, str(found))


def test_horizontal_crs() -> None:
    assert horizontal_crs(parse_crs("EPSG:2154+5720")) == CRS(2154)
    assert not horizontal_crs(CRS.from_wkt(OLD_UTM)).is_bound


def test_real_files_in_feet(data: Callable[[str], Path]) -> None:
    laspy = pytest.importorskip("laspy")
    found = {}
    for name in ("autzen_trim.laz", "nebraska_wkt_and_geotiff.las"):
        with laspy.open(data(f"feet/{name}")) as file:
            found[name] = file.header.parse_crs()
    assert [vertical_unit(crs) for crs in found.values()] == ["foot", "US survey foot"]
    assert [length_problem(crs) for crs in found.values()] == [None, None]
    assert same_crs(found["nebraska_wkt_and_geotiff.las"], CRS(6880))


def test_real_prj_file(data: Callable[[str], Path]) -> None:
    text = data("ign_buildings_bdtopo/bdtopo_buildings.prj").read_text()
    assert same_crs(parse_crs(text), CRS(2154))


@pytest.mark.parametrize(
    ("word", "metres", "unit"),
    [
        ("local", 1.0, "metre"),
        ("local:mm", 0.001, "millimetre"),
        ("local:cm", 0.01, "centimetre"),
        ("LOCAL:FT", 0.3048, "foot"),
    ],
)
def test_local_coordinates_have_a_unit(word: str, metres: float, unit: str) -> None:
    crs = parse_crs(word)
    assert metres_per_unit(crs) == pytest.approx(metres, rel=1e-15)
    assert vertical_unit(crs) == unit
    assert length_problem(crs) is None
    assert is_local(crs)
    assert describe_crs(crs) == "local coordinates in " + ("feet" if unit == "foot" else f"{unit}s")
    assert crs_text(crs) == word.lower()
    others = [other for name, other in LOCALS.items() if name != word.lower()]
    assert not any(same_crs(crs, other) for other in others)
    assert crs_conflict(crs, others[0], heights=True)
    assert not is_local(CRS(32635))


@pytest.mark.parametrize("given", ["EPSG:32635", "32635", 32635, CRS(32635)])
def test_layers_take_a_crs_as_it_is_said(given: CRS | str | int) -> None:
    """A text would be found only by a tool, which then dies of it."""
    import geopandas
    import shapely

    cloud = PointCloud([[0, 0, 0.0]], crs=given)
    raster = Raster(np.zeros((1, 1)), Affine(1, 0, 0, 0, -1, 1), crs=given)  # type: ignore[arg-type]
    point = Vector(geopandas.GeoDataFrame(geometry=[shapely.Point(0, 0)]))
    plan = Drawing("A", (), (), crs=given)  # type: ignore[arg-type]
    bare = PointCloud([[0, 0, 0.0]])
    layers = [cloud, raster, plan, point.with_crs(given), bare.with_crs(given)]
    layers.append(raster.with_crs(None).with_crs(given))
    assert [layer.crs for layer in layers] == [CRS(32635)] * 6
    with pytest.raises(DataError, match="crs: 'EPSG:1' is not a CRS that PROJ knows"):
        PointCloud([[0, 0, 0.0]], crs="EPSG:1")


def test_a_number_is_a_code_of_epsg() -> None:
    assert parse_crs("28992") == CRS(28992)
    assert parse_crs("28992+5709") == CRS("EPSG:28992+5709")
    with pytest.raises(ValueError, match="'2' is not a CRS; give"):
        parse_crs("2")
