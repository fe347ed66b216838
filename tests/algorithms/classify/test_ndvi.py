"""classify.ndvi: numpy's numbers for all types, bands by any name, bad input."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.classify._ndvi import ndvi
from algorithms.classify.ndvi import ClassifyNdvi
from toolbox.data import Raster
from toolbox.errors import DataError, ParameterError

UTM = CRS(32635)
TYPES = ["uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64"]


def image(values: Any, *names: str, **more: Any) -> Raster:
    """Bands of cells of a metre; `values` of shape (bands, rows, cols)."""
    transform = Affine(1, 0, 500_000, 0, -1, 4_600_000)
    return Raster(np.asarray(values), transform, crs=UTM, descriptions=names, **more)


def chequered(dtype: str) -> NDArray[Any]:
    """Near infrared and red of leaves and roofs in turn, as bright as the type allows."""
    top = np.iinfo(dtype).max if dtype[0] in "iu" else 10_000
    top = min(top, 2**52)  # whole numbers of float64
    leaf = np.indices((6, 8)).sum(axis=0) % 2 == 0
    nir, red = np.where(leaf, top, top // 2), np.where(leaf, top // 5, top - top // 3)
    return np.stack([nir, red]).astype(dtype)


@pytest.mark.parametrize("dtype", TYPES)
def test_any_type_gives_what_numpy_gives_in_doubles(dtype: str) -> None:
    values = chequered(dtype)
    nir, red = values.astype(np.float64)
    wanted = (nir - red) / (nir + red)
    np.testing.assert_array_equal(ndvi(*values), wanted)
    out = ClassifyNdvi(image=image(values), nir="1", red="2", threshold=0.2).run()
    np.testing.assert_array_equal(out.ndvi.values[0], wanted.astype(np.float32))
    np.testing.assert_array_equal(out.mask.values[0], wanted >= 0.2)
    assert out.vegetation_share == 0.5


@given(
    st.lists(st.tuples(st.integers(0, 255), st.integers(0, 255)), min_size=1, max_size=20),
)
def test_ndvi_lies_between_its_limits(pairs: list[tuple[int, int]]) -> None:
    nir, red = np.array(pairs, np.uint8).T
    found = ndvi(nir, red)
    assert (np.isnan(found) == (nir.astype(int) + red == 0)).all()
    assert (np.abs(found[np.isfinite(found)]) <= 1).all()
    np.testing.assert_array_equal(found, -ndvi(red, nir))


@pytest.mark.parametrize(
    ("names", "how"),
    [
        (("B4 red", "B8 NIR"), {}),
        (("Red", "Near-Infrared"), {}),
        (("red edge", "red", "near infra-red"), {}),
        (("B04", "B08"), {"nir": "b08", "red": "B04"}),
        (("", "", "", ""), {"nir": "4", "red": "1"}),
    ],
)
def test_bands_are_found_by_number_and_by_name(names: tuple[str, ...], how: dict[str, str]) -> None:
    nir, red = chequered("uint8")
    is_red = {name for name in names if name in ("B4 red", "Red", "red", "B04")}
    values = [red if name in is_red else nir for name in names]
    if not any(names):
        values = [red, red // 2, red // 3, nir]
    out = ClassifyNdvi(image=image(np.stack(values), *names), **how).run()
    np.testing.assert_array_equal(out.ndvi.values[0], ndvi(nir, red).astype(np.float32))


@pytest.mark.parametrize(
    ("names", "how", "text"),
    [
        (("", ""), {}, r"nir: no band of a\.tif says which it is: 1 '', 2 ''; give its number"),
        (("NIR", "green"), {}, r"red: no band of a\.tif says which it is"),
        (("NIR", "NIR 2"), {"red": "2"}, r"nir: no band of a\.tif alone says"),
        (("NIR", "red"), {"nir": "5"}, r"nir: must be from 1 to 2, the bands of a\.tif, got 5"),
        (("NIR", "red"), {"nir": "nri"}, "no band of a.tif says 'nri'"),
        (("NIR", "red"), {"nir": "1", "red": "nir"}, "must be another band than nir"),
        (("NIR", "red"), {"nir": "2", "red": "2"}, "red: must be another band than nir"),
        (("NIR", "red"), {"nir": "2", "red": "1"}, "'red' and 'NIR'; are nir and red swapped"),
    ],
)
def test_wrong_bands_are_named(names: tuple[str, ...], how: dict[str, str], text: str) -> None:
    with pytest.raises((DataError, ParameterError), match=text):
        ClassifyNdvi(image=image(chequered("uint8"), *names, name="a.tif"), **how).run()


def test_red_may_be_in_another_file_on_the_same_cells() -> None:
    nir, red = chequered("uint16")
    out = ClassifyNdvi(image=image(nir), red_image=image(red)).run()
    np.testing.assert_array_equal(out.ndvi.values[0], ndvi(nir, red).astype(np.float32))
    with pytest.raises(DataError, match=r"red_image: .* covers another area than that of"):
        ClassifyNdvi(image=image(nir), red_image=image(red[:-1])).run()
    beside = Raster(red, Affine(1, 0, 500_002, 0, -1, 4_600_000), crs=UTM, name="beside.tif")
    with pytest.raises(DataError, match=r"beside\.tif covers another area than that of"):
        ClassifyNdvi(image=image(nir), red_image=beside).run()
    moved = Raster(red, Affine(1, 0, 500_000.5, 0, -1, 4_600_000), crs=UTM, name="moved.tif")
    with pytest.raises(DataError, match=r"moved\.tif lies 0\.5 of a cell beside"):
        ClassifyNdvi(image=image(nir), red_image=moved).run()
    with pytest.raises(DataError, match=r"red_image: .*is in EPSG:2154"):
        ClassifyNdvi(image=image(nir), red_image=image(red).with_crs(CRS(2154))).run()


def test_cells_without_data_stay_without() -> None:
    values = chequered("uint8")
    values[0, 0, 0], values[1, 2, 3] = 255, 255
    values[:, 5, 5] = 0
    out = ClassifyNdvi(image=image(values, nodata=255), nir="1", red="2", threshold=0.0).run()
    missing = np.zeros((6, 8), bool)
    missing[values[0] == 255] = missing[values[1] == 255] = missing[5, 5] = True
    np.testing.assert_array_equal(np.isnan(out.ndvi.values[0]), missing)
    np.testing.assert_array_equal(out.mask.values[0] == 255, missing)
    assert out.filled_share == pytest.approx(1 - missing.mean())
    again = ClassifyNdvi(
        image=image(values, nodata=255), nir="1", red="2", nodata_is_valid=True
    ).run()
    assert np.isnan(again.ndvi.values[0]).sum() == 1


def test_offset_of_scaled_reflectance_counts() -> None:
    values = np.array([[[5000, 1100]], [[2000, 900]]], np.uint16)  # Sentinel-2, offset -1000
    out = ClassifyNdvi(
        image=image(values), nir="1", red="2", scale=1e-4, offset=-0.1, threshold=0.3
    ).run()
    np.testing.assert_allclose(out.ndvi.values[0, 0], [3 / 5, np.nan], rtol=1e-6)


def test_otsu_finds_the_gap_between_roofs_and_leaves() -> None:
    out = ClassifyNdvi(image=image(chequered("uint16")), nir="1", red="2").run()
    assert out.threshold_used == pytest.approx(2 / 3, abs=1e-3)
    with pytest.raises(DataError, match="image: all NDVI are 0, which cannot be split"):
        ClassifyNdvi(image=image(np.ones((2, 3, 3))), nir="1", red="2").run()


def test_an_image_below_zero_is_doubted(caplog: pytest.LogCaptureFixture) -> None:
    leaves = np.stack([np.full((3, 3), 9), np.full((3, 3), 40)])
    with caplog.at_level(logging.WARNING, "toolbox"):
        ClassifyNdvi(image=image(leaves), nir="1", red="2", threshold=0.1).run()
    assert "are the bands swapped?" in caplog.text


def test_an_image_without_any_data(caplog: pytest.LogCaptureFixture) -> None:
    out = ClassifyNdvi(image=image(np.full((2, 3, 3), np.nan)), nir="1", red="2").run()
    assert out.threshold_used is None
    assert out.filled_share == 0
    assert "no cell has NDVI" in caplog.text


def test_real_reflectances_give_what_numpy_gives(data: Callable[[str], Path]) -> None:
    source = Raster.open(data("multispectral_rasters") / "s2a_l2a_fishbourne.tif")
    out = ClassifyNdvi(image=source, nir="4", red="3").run()
    red, nir = source.values[2:4].astype(np.float64)
    there = nir + red > 0  # a third is empty, without a nodata value
    wanted = (nir[there] - red[there]) / (nir[there] + red[there])
    np.testing.assert_array_equal(out.ndvi.values[0][there], wanted.astype(np.float32))
    assert np.isnan(out.ndvi.values[0][~there]).all()
    assert out.filled_share == pytest.approx(0.6706, abs=1e-4)
