"""surface.difference: known answers, cells that do not fit, units and CRS."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from pyproj import CRS
from scenes import layers
from scenes.layers import UTM

from algorithms.shared.alignment import misfit
from algorithms.surface.difference import SurfaceDifference
from toolbox.data import Lattice, Raster
from toolbox.errors import DataError

raster = functools.partial(layers.raster, cell=0.5, north=100.0)


def test_known_answer_on_the_cells_of_the_first() -> None:
    """The base begins one cell to the east and south, and has a hole."""
    surface = raster([[1, 2, 3], [4, 5, 6], [7, 8, 9.0]], descriptions=("dsm",), units=("metre",))
    base = raster([[1, np.nan, 5], [1, 1, 5]], west=500_000.5, north=99.5, descriptions=("dtm",))
    out = SurfaceDifference(surface=surface, base=base).run()
    nan = math.nan
    np.testing.assert_array_equal(
        out.difference.values[0], [[nan, nan, nan], [nan, 4, nan], [nan, 7, 8]]
    )
    assert out.difference.bounds == surface.bounds
    assert out.difference.descriptions == ("dsm minus dtm",)
    assert out.difference.units == ("metre",)
    assert (out.mean, out.lowest, out.highest) == (pytest.approx(19 / 3), 4, 8)
    assert out.std == pytest.approx(np.std([4, 7, 8]))
    assert out.filled_share == pytest.approx(3 / 9)


def test_integers_with_nodata_and_type_of_the_result() -> None:
    one = raster(np.array([[5, 0]], np.uint8), nodata=0)
    two = raster(np.array([[7, 7]], np.uint8))
    out = SurfaceDifference(surface=one, base=two).run()
    np.testing.assert_array_equal(out.difference.values[0], [[-2, np.nan]])
    assert out.difference.values.dtype == np.float32
    long = SurfaceDifference(surface=raster([[1e9 + 0.25]]), base=raster([[1e9]])).run()
    assert long.mean == 0.25


def test_big_rasters_are_done_in_blocks() -> None:
    values = np.arange(3000.0 * 2).reshape(3000, 2)
    out = SurfaceDifference(
        surface=raster(values), base=raster(values[1000:] - 1, north=-400)
    ).run()
    assert np.isnan(out.difference.values[0, :1000]).all()
    assert (out.difference.values[0, 1000:] == 1).all()


def test_nothing_in_common_is_no_number() -> None:
    out = SurfaceDifference(surface=raster([[np.nan, 1]]), base=raster([[1, np.nan]])).run()
    assert (out.mean, out.std, out.lowest, out.highest, out.filled_share) == (None,) * 4 + (0,)


@pytest.mark.parametrize(
    ("base", "text"),
    [
        (raster([[1.0]], cell=1.0, name="b.tif"), "b.tif has cells of 1, not the 0.5 of a.tif"),
        (
            raster([[1.0]], west=500_000.1, name="b.tif"),
            "b.tif lies 0.2 of a cell beside the cells",
        ),
        (raster([[1.0]], west=600_000, name="b.tif"), "b.tif lies nowhere on the area of a.tif"),
        (raster([[1.0]], crs=CRS(32636), name="b.tif"), "reproject it to EPSG:32635"),
        (raster([[1.0]], crs=CRS("EPSG:32635+5773"), name="b.tif"), "a.tif"),
        (raster([[1.0]], units=("foot",), name="b.tif"), "b.tif is in foot, a.tif in metre"),
    ],
)
def test_rasters_that_do_not_fit_are_refused_by_name(base: Raster, text: str) -> None:
    surface = raster([[1.0]], units=("metre",), name="a.tif")
    with pytest.raises(DataError, match="base: ") as error:
        SurfaceDifference(surface=surface, base=base)
    assert text in str(error.value)


def test_several_bands_are_refused() -> None:
    bands = Raster(np.zeros((2, 1, 1)), raster([[1.0]]).transform, crs=UTM, name="rgb.tif")
    with pytest.raises(DataError, match=r"surface: rgb.tif has 2 bands"):
        SurfaceDifference(surface=bands, base=raster([[1.0]]))


def test_rounding_of_corners_is_no_misfit() -> None:
    """Corners of real files are off by a few bits."""
    one = Lattice(500_000.0, 100.0, 0.1, 10, 10)
    assert misfit(one, Lattice(500_000.3 + 1e-9, 99.9, 0.1, 10, 10)) is None
    assert misfit(one, Lattice(500_000.33, 99.9, 0.1, 10, 10))
