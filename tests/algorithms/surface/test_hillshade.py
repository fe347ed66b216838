"""surface.hillshade: light on planes and spheres, gdaldem's numbers, edges, holes and units."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import CRS
from scenes.layers import UTM, raster

from algorithms.surface import hillshade as module
from algorithms.surface.hillshade import SurfaceHillshade, from_one_side, hillshade, slopes
from toolbox.data import Raster
from toolbox.errors import DataError

FEET = CRS(2263)
ROUGH = np.array(
    [
        [7, 3, 8, 1, 9, 2],
        [4, 9, 2, 6, 5, 8],
        [1, 5, 7, 3, 8, 4],
        [6, 2, 9, 4, 1, 7],
        [3, 8, 5, 7, 2, 6.0],
    ]
)
# What gdaldem 3.6.2 makes of ROUGH with cells of 2 m, without the outermost cells.
GDAL = [[175, 99, 231, 227], [184, 165, 146, 116], [246, 208, 25, 160]]
GDAL_LOW_SUN = [[69, 151, 26, 40], [1, 115, 111, 47], [1, 76, 192, 50]]  # -az 100 -alt 20 -z 0.5
GDAL_MULTIDIRECTIONAL = [[198, 71, 230, 224], [231, 129, 148, 167], [236, 204, 13, 202]]
GDAL_EDGES = [  # the outermost rows and columns without the corners
    [237, 90, 206, 237],
    [253, 159, 102, 185],
    [68, 244, 231],
    [129, 159, 233],
]


def plane(east: float, north: float, cell: float = 1.0) -> Raster:
    row, col = np.mgrid[0:5, 0:5] * cell
    return raster(east * col - north * row, cell)


def shades(surface: Raster, **settings: Any) -> Any:
    return SurfaceHillshade(surface=surface, **settings).run().hillshade.values[0]


@pytest.mark.parametrize(
    ("east", "north", "settings", "light"),
    [
        (0, 0, {}, math.sin(math.radians(45))),
        (0, 0, {"altitude": 90.0}, 1),
        (1, 0, {"azimuth": 270.0}, 1),  # rises eastwards, faces the sun in the west
        (1, 0, {"azimuth": 90.0}, 0),
        (0, -1, {"azimuth": 0.0}, 1),  # rises southwards, faces the sun in the north
        (0, -1, {"azimuth": 360.0}, 1),
        (2, 0, {"azimuth": 90.0}, 0),  # turned away is as dark as can be
        (0.5, 0, {"azimuth": 270.0, "z_factor": 2.0}, 1),
        (1, 0, {"azimuth": 180.0, "altitude": 30.0}, 0.5 / math.sqrt(2)),
    ],
)
def test_light_on_planes(east: float, north: float, settings: dict[str, Any], light: float) -> None:
    for cell in (0.25, 3.0):
        found = shades(plane(east, north, cell), fraction=True, **settings)[1:-1, 1:-1]
        np.testing.assert_allclose(found, light, atol=1e-6)


def test_it_has_no_unit_of_heights(tmp_path: Path) -> None:
    """GDAL takes that of the CRS for a band without one."""
    heights = raster(np.ones((5, 5))).with_crs(CRS("EPSG:28992+5709"))
    SurfaceHillshade(surface=heights).run().hillshade.save(tmp_path / "a.tif")
    assert Raster.open(tmp_path / "a.tif").units == ("1",)


def test_four_lights_on_a_slope_to_the_west() -> None:
    """Of 225, 270, 315 and 360 degrees: weights 1/2, 0, 1/2, 1; falls 0.71, 1, 0.71, 0."""
    found = shades(plane(1, 0), multidirectional=True, fraction=True)[2, 2]
    oblique = (1 + math.sqrt(0.5)) / 2
    assert found == pytest.approx((oblique / 2 + oblique / 2 + 0.5) / 2, abs=1e-6)
    flat = shades(plane(0, 0), multidirectional=True, fraction=True)[2, 2]
    assert flat == pytest.approx(math.sqrt(0.5), abs=1e-6)


def test_a_sphere() -> None:
    """The upright on a sphere is its radius; the error falls with the square of the cell."""
    sun = np.array([-0.5, 0.5, math.sqrt(0.5)])  # from the north-west, 45 degrees high
    errors = []
    for cell in (2.0, 1.0):
        across = np.arange(-30, 30 + cell, cell)
        x, y = np.meshgrid(across, -across)
        z = np.sqrt(100**2 - x**2 - y**2)
        true = (x * sun[0] + y * sun[1] + z * sun[2]) / 100
        errors.append(np.nanmax(np.abs(hillshade(z, cell) - true)))
    assert errors[0] < 5e-4
    assert errors[1] < 0.27 * errors[0]


def test_gdaldem_gives_the_same_numbers() -> None:
    surface = raster(ROUGH, cell=2.0)
    inside = np.s_[1:-1, 1:-1]
    np.testing.assert_array_equal(shades(surface)[inside], GDAL)
    low = {"azimuth": 100.0, "altitude": 20.0, "z_factor": 0.5}
    np.testing.assert_array_equal(shades(surface, **low)[inside], GDAL_LOW_SUN)


def test_four_lights_weigh_what_gdaldem_leaves() -> None:
    """gdaldem weighs each light by 1 - Mark's weight; both together are the sum of the lights."""
    east, north = slopes(ROUGH, 2.0)
    lights = sum(from_one_side(east, north, azimuth, 45.0) for azimuth in (225, 270, 315, 360))
    ours = hillshade(ROUGH, 2.0, multidirectional=True)[1:-1, 1:-1]
    theirs = (np.array(GDAL_MULTIDIRECTIONAL) - 1) / 254
    np.testing.assert_allclose(ours + theirs, lights / 2, atol=0.51 / 254)


def test_edges_are_continued_straight_as_by_gdaldem() -> None:
    surface = raster(ROUGH, cell=2.0)
    found = shades(surface, edges=True)
    np.testing.assert_array_equal(found[1:-1, 1:-1], GDAL)
    beside = (found[0, 1:-1], found[-1, 1:-1], found[1:-1, 0], found[1:-1, -1])
    for here, there in zip(beside, GDAL_EDGES, strict=True):
        np.testing.assert_array_equal(here, there)
    light = math.sin(math.radians(45))
    tilted = shades(plane(0.3, -0.2), edges=True, fraction=True)
    assert np.ptp(tilted) < 1e-6  # corners too
    assert tilted[0, 0] != pytest.approx(light, abs=0.01)


@pytest.mark.parametrize("edges", [False, True])
def test_a_hole_empties_all_cells_around_it(edges: bool) -> None:
    values = np.zeros((9, 9))
    values[4, 4] = np.nan
    out = SurfaceHillshade(surface=raster(values), edges=edges).run()
    empty = out.hillshade.values[0] == 0
    assert out.hillshade.nodata == 0
    assert empty[3:6, 3:6].all()
    assert empty.sum() == 9 + (0 if edges else 32)
    assert out.filled_share == pytest.approx((81 - empty.sum()) / 81)
    fraction = shades(raster(values), edges=edges, fraction=True)
    np.testing.assert_array_equal(np.isnan(fraction), empty)
    assert fraction.dtype == np.float32


def test_a_cell_without_height_has_no_slope() -> None:
    """The formula would not look at it."""
    values = np.zeros((3, 3))
    values[1, 1] = np.nan
    assert np.isnan(slopes(values, 1.0)).all()


@pytest.mark.parametrize("shape", [(1, 5), (2, 2), (5, 1)])
@pytest.mark.parametrize("edges", [False, True])
def test_small_rasters(
    shape: tuple[int, int], edges: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """A single row has no slope across it, and two rows are all edge."""
    with caplog.at_level(logging.WARNING, "toolbox"):
        found = shades(raster(np.zeros(shape)), edges=edges)
    assert (found == (181 if edges and min(shape) > 1 else 0)).all()
    assert ("no cell has a shade" in caplog.text) == (not found.any())


def test_blocks_of_rows_are_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(0).normal(0, 1, (40, 6))
    whole = hillshade(values, 1.0)
    monkeypatch.setattr(module, "ROWS", 7)
    np.testing.assert_array_equal(hillshade(values, 1.0), whole)


def test_feet_are_as_good_as_metres() -> None:
    np.testing.assert_array_equal(
        shades(raster(ROUGH, 2.0, crs=FEET, units=("us-ft",))), shades(raster(ROUGH, 2.0))
    )


@pytest.mark.parametrize(
    ("surface", "text"),
    [
        (raster(ROUGH, crs=CRS(4326), name="a.tif"), "a.tif is in degrees"),
        (raster(ROUGH, crs=None, name="a.tif"), "a.tif has no CRS"),
        (raster(ROUGH, crs=FEET, units=("metre",), name="a.tif"), "a.tif holds values in metre"),
        (raster(ROUGH, units=("ft",), name="a.tif"), "a.tif holds values in ft, not in metre"),
    ],
)
def test_heights_in_another_unit_than_the_plane_are_refused(surface: Raster, text: str) -> None:
    with pytest.raises(DataError, match="surface: ") as error:
        SurfaceHillshade(surface=surface)
    assert text in str(error.value)


def test_several_bands_are_refused() -> None:
    bands = Raster(np.zeros((2, 3, 3)), plane(0, 0).transform, crs=UTM, name="rgb.tif")
    with pytest.raises(DataError, match=r"surface: rgb.tif has 2 bands"):
        SurfaceHillshade(surface=bands)
