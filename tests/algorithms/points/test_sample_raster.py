"""points.sample_raster: known values, colours of 16 bits, names, and places without a value."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes.layers import NORTH, WEST, cloud, raster

from algorithms.points.sample_raster import PointsSampleRaster
from toolbox.data import PointCloud
from toolbox.errors import DataError, ParameterError

BAND = [[1, 2], [3, np.nan]]


def points(**more: Any) -> PointCloud:
    """In the middle of each of four cells, and beside them."""
    plan = [(0.5, -0.5), (1.5, -0.5), (0.5, -1.5), (1.5, -1.5), (9, 9)]
    return cloud([(WEST + x, NORTH + y, 5.0) for x, y in plan], **more)


def image(values: Any = None, **more: Any) -> Any:
    return raster(np.array(values if values is not None else [BAND], float), name="dtm.tif", **more)


def test_each_band_becomes_an_attribute() -> None:
    layer = image([BAND, np.multiply(BAND, 10)], descriptions=("height", ""), units=("metre", ""))
    out = PointsSampleRaster(points=points(), raster=layer).run()
    np.testing.assert_array_equal(out.sampled["height"], [1, 2, 3, np.nan, np.nan])
    np.testing.assert_array_equal(out.sampled["dtm_2"], [10, 20, 30, np.nan, np.nan])
    assert out.sampled["height"].dtype == np.float64  # as the raster
    assert out.sampled.descriptions["height"] == "of a raster, metre"
    assert out.without_value == 2


def test_between_centres() -> None:
    middle = cloud([(WEST + 1.0, NORTH - 0.5, 0.0), (WEST + 1.0, NORTH - 1.0, 0.0)])
    out = PointsSampleRaster(points=middle, raster=image(), method="linear", names=("v",)).run()
    np.testing.assert_array_equal(out.sampled["v"], [1.5, np.nan])  # one of four has no value


def test_chosen_bands_and_names(tmp_path: Path) -> None:
    layer = image([BAND, np.multiply(BAND, 10), np.multiply(BAND, 100)])
    out = PointsSampleRaster(points=points(), raster=layer, bands=(3, 1), names=("c", "a")).run()
    assert out.sampled["c"][0] == 100
    assert out.sampled["a"][0] == 1
    out.sampled.save(tmp_path / "a.laz")
    assert PointCloud.open(tmp_path / "a.laz")["c"][0] == 100


@pytest.mark.parametrize(("kind", "factor"), [(np.uint8, 257), (np.uint16, 1)])
def test_colours(kind: Any, factor: int) -> None:
    values = np.arange(16, dtype=kind).reshape(4, 2, 2)
    layer = raster(values, name="ortho.tif")
    before = points(red=np.full(5, 7, np.uint16))
    out = PointsSampleRaster(points=before, raster=layer, store="colour").run()
    assert out.sampled["red"].tolist() == [0, factor, 2 * factor, 3 * factor, 7]
    assert out.sampled["nir"].tolist() == [12 * factor, 13 * factor, 14 * factor, 15 * factor, 0]
    assert out.sampled["nir"].dtype == np.uint16
    assert out.without_value == 1


@pytest.mark.parametrize(
    ("how", "text"),
    [
        ({"bands": (2,)}, "bands: dtm.tif has bands 1 to 1, not 2"),
        ({"store": "colour"}, "bands: colours are three or four bands, and there are 1"),
        ({"store": "colour", "bands": (1, 1, 1)}, "raster: dtm.tif holds float64; colours have"),
        ({"names": ("a", "b")}, "names: 2 names for 1 bands"),
        ({"names": ("red",)}, "names: 'red' is an attribute of LAS"),
        ({"bands": (1, 1)}, "names: must differ"),
    ],
)
def test_what_is_refused(how: dict[str, Any], text: str) -> None:
    with pytest.raises(DataError, match=text):
        PointsSampleRaster(points=points(), raster=image(), **how)


def test_colours_have_names() -> None:
    with pytest.raises(ParameterError, match="names: are for attributes"):
        PointsSampleRaster(points=points(), raster=image(), store="colour", names=("a",))
