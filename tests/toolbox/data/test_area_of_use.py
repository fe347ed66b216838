"""Coordinates that cannot be in the CRS which they are said to be in."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from pyproj import CRS

from toolbox.data import PointCloud
from toolbox.data.area_of_use import centre_in_degrees, misplaced
from toolbox.data.crs import LOCAL, parse_crs
from toolbox.data.operation import operation

HERE = (500_000, 4_600_000, 501_000, 4_601_000)
ISTANBUL = (29.01, 41.0, 29.02, 41.01)
NO_CODE = CRS.from_wkt(CRS(32635).to_wkt().replace('ID["EPSG",32635]', 'ID["OWN",1]'))
MOVED, DEGREES, FAR, NO_DEGREES = (
    "degrees or metres from a local",
    "look like degrees,",
    "far outside",
    "are no degrees",
)


@pytest.mark.parametrize(
    ("crs", "bounds", "text"),
    [
        ("EPSG:32635", HERE, None),
        ("EPSG:32635", ISTANBUL, DEGREES),
        ("EPSG:32635+5773", (29.01, 41.0, 80, 29.02, 41.01, 120), DEGREES),
        ("EPSG:2154", (0, 0, 2.1, 0.1), MOVED),
        ("EPSG:2154", (0, 0, 900_000, 6_600_000), None),  # one stray point at 0, 0
        ("EPSG:2154", (6_600_000, 900_000, 6_601_000, 901_000), FAR),  # northing first
        ("EPSG:2154", (1e30, 1e30, 2e30, 2e30), FAR),
        ("EPSG:32635", (900_000, 4_600_000, 901_000, 4_601_000), None),  # 1.8 degrees beyond
        ("EPSG:32635", (1_200_000, 4_600_000, 1_201_000, 4_601_000), FAR),  # 5.4 degrees beyond
        ("EPSG:28992", (200_000, 650_000, 201_000, 651_000), None),
        ("EPSG:2263", HERE, FAR),  # metres, and no feet of New York
        ("EPSG:2994", (635_000, 848_000, 640_000, 853_000), None),
        ("EPSG:3857", (10, 10, 50, 50), None),  # where degrees would be, and in the area of use
        ("EPSG:3460", (2_000_000, 3_900_000, 2_001_000, 3_901_000), None),  # Fiji, at 180 degrees
        ("EPSG:3460", (1_400_000, 3_900_000, 1_401_000, 3_901_000), FAR),
        ("EPSG:4326", ISTANBUL, None),
        ("EPSG:4326", (-180.4, -90.4, 180.4, 90.4), None),
        ("EPSG:4326", (0, -80, 359.5, 80), None),
        ("EPSG:4326", HERE, NO_DEGREES),
        ("EPSG:4326", (10, 200, 20, 300), NO_DEGREES),
        ("local", ISTANBUL, None),
        ("EPSG:4978", HERE, None),
        ("EPSG:2154", (float("nan"),) * 6, None),
    ],
)
def test_where_coordinates_may_be(crs: str, bounds: tuple[float, ...], text: str | None) -> None:
    found = misplaced(parse_crs(crs), bounds)
    assert (found is None) == (text is None), found
    if found:
        assert str(text) in found.text
        assert found.in_other_unit == (text in (DEGREES, NO_DEGREES))


def test_a_crs_without_an_area() -> None:
    """UTM by its definition is known; a projection of one's own may be anywhere."""
    found = misplaced(NO_CODE, ISTANBUL)
    assert found is not None
    assert DEGREES in found.text
    own = CRS.from_proj4("+proj=tmerc +lat_0=41 +lon_0=29 +k=1 +x_0=0 +y_0=0 +ellps=GRS80")
    assert misplaced(own, ISTANBUL) is None
    assert misplaced(None, ISTANBUL) is misplaced(LOCAL, ISTANBUL) is None


@pytest.mark.parametrize(
    "name",
    ["isprs_sites/CSite2_orig-utm.laz", "feet/autzen_trim.laz", "ign_urban_50m/77050_627755.laz"],
)
def test_real_files_are_in_their_place(name: str, data: Callable[[str], Path]) -> None:
    cloud = PointCloud.open(data(name))
    assert cloud.crs is not None
    assert misplaced(cloud.crs, cloud.bounds) is None


@pytest.mark.parametrize(
    ("target", "bounds", "share"),
    [
        (32635, (24, 40, 30, 45), None),  # its own zone
        (32635, (21.5, 40, 32.5, 45), None),  # and half a zone on either side
        (32635, (24, 40, 48, 45), "about 62 % of it"),
        (3857, (-180, -85, 180, 85), None),
        (3857, (-180, -90, 180, 90), "about 10 % of it"),
        (4326, (-180, -90, 180, 90), None),
    ],
)
def test_what_reaches_beyond_a_projection_is_told(
    target: int, bounds: tuple[float, ...], share: str | None, caplog: pytest.LogCaptureFixture
) -> None:
    operation(CRS(4326), CRS(target), bounds)
    assert ("outside the area of use" in caplog.text) == (share is not None)
    assert (share or "") in caplog.text


def test_other_celestial_bodies_have_no_place_on_the_earth() -> None:
    """points.info is run first, and failed on them."""
    assert centre_in_degrees(CRS("IAU_2015:49910"), (0, 0, 10, 10)) is None
