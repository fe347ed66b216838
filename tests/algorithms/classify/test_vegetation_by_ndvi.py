"""classify.vegetation_by_ndvi: greenness from images and attributes, heights, bad input."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from affine import Affine
from pyproj import CRS

from algorithms.classify.ndvi import ClassifyNdvi
from algorithms.classify.vegetation_by_ndvi import ClassifyVegetationByNdvi
from algorithms.points.height_above_ground import PointsHeightAboveGround
from toolbox.data import PointCloud, Raster
from toolbox.declare import Attribute
from toolbox.errors import DataError, ParameterError

UTM = CRS(32635)
HEIGHTS = np.array([0.0, 0.3, 1.0, 8.0, 8.0, 8.0, 8.0, np.nan])
NDVI = np.array([0.5, 0.5, 0.5, 0.5, -0.1, 0.5, np.nan, 0.5])
CLASSES = np.array([2, 1, 1, 1, 5, 18, 4, 1], np.uint8)


def cloud(**attributes: Any) -> PointCloud:
    """Eight points in a row, a metre apart."""
    xyz = np.column_stack([500_000.5 + np.arange(8), np.full(8, 4_599_999.5), np.arange(8)])
    return PointCloud(xyz, {"classification": CLASSES} | attributes, crs=UTM, name="row.laz")


def image(values: Any = NDVI, **more: Any) -> Raster:
    """A row of cells below the points."""
    values = np.asarray(values)[None]
    transform = Affine(1, 0, 500_000, 0, -1, 4_600_000)
    return Raster(values, transform, **{"crs": UTM, "name": "ndvi.tif"} | more)


def test_green_points_get_a_class_by_height() -> None:
    points = cloud(HeightAboveGround=HEIGHTS)
    out = ClassifyVegetationByNdvi(points=points, image=image()).run()
    assert out.classified["classification"].tolist() == [2, 3, 4, 5, 1, 18, 4, 5]
    np.testing.assert_allclose(out.classified["NDVI"], NDVI, rtol=1e-6)
    assert out.vegetation_share == 4 / 8
    assert out.covered_share == 7 / 8


def test_without_heights_all_that_is_green_is_vegetation() -> None:
    out = ClassifyVegetationByNdvi(points=cloud(), image=image()).run()
    assert out.classified["classification"].tolist() == [5, 5, 5, 5, 1, 18, 4, 5]


def test_points_may_bring_their_own_colours() -> None:
    nir, red = np.full(8, 60_000, np.uint16), np.full(8, 20_000, np.uint16)  # sums beyond 16 bit
    nir[4] = 15_000
    out = ClassifyVegetationByNdvi(points=cloud(nir=nir, red=red)).run()
    assert out.classified["NDVI"][0] == pytest.approx(0.5)
    assert out.classified["classification"].tolist() == [5, 5, 5, 5, 1, 18, 5, 5]
    named = ClassifyVegetationByNdvi(
        points=cloud(infra=nir, r=red), nir=Attribute("infra"), red=Attribute("r")
    ).run()
    np.testing.assert_array_equal(named.classified["NDVI"], out.classified["NDVI"])


def test_otsu_splits_the_points() -> None:
    out = ClassifyVegetationByNdvi(points=cloud(), image=image(), threshold="otsu").run()
    assert out.threshold_used == 0.5
    assert ClassifyVegetationByNdvi(points=cloud(), image=image(), threshold="otsu").halo() > 1e9
    assert ClassifyVegetationByNdvi(points=cloud(), image=image()).halo() == 0


def test_no_source_of_ndvi_is_an_error() -> None:
    with pytest.raises(DataError, match=r"nir: row\.laz has no nir; name the attribute, or"):
        ClassifyVegetationByNdvi(points=cloud()).run()
    zeros = np.zeros(8, np.uint16)
    with pytest.raises(DataError, match="points: nir and red are 0 at all points"):
        ClassifyVegetationByNdvi(points=cloud(nir=zeros, red=zeros)).run()


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"image": image(crs=CRS(2154))}, r"image: ndvi\.tif is in EPSG:2154"),
        ({"image": image(100 * NDVI)}, "must be NDVI, from -1 to 1; make it with classify.ndvi"),
        (
            {"image": Raster(np.zeros((2, 1, 8)), Affine(1, 0, 0, 0, -1, 0), crs=UTM)},
            "must be NDVI, of one band, got 2",
        ),
        ({"image": image(), "low": 3.0}, r"low: must be <= high \(1\.5\), got 3"),
    ],
)
def test_wrong_input_is_refused(wrong: dict[str, Any], text: str) -> None:
    with pytest.raises((DataError, ParameterError), match=text):
        ClassifyVegetationByNdvi(points=cloud(), **wrong).run()


def test_an_image_elsewhere_covers_nothing(caplog: pytest.LogCaptureFixture) -> None:
    far = Raster(NDVI[None], Affine(1, 0, 0, 0, -1, 0), crs=UTM, name="far.tif")
    with caplog.at_level(logging.WARNING, "toolbox"):
        out = ClassifyVegetationByNdvi(points=cloud(), image=far).run()
    assert out.covered_share == 0
    assert "100 % of the points have no NDVI in far.tif" in caplog.text
    assert out.classified["classification"].tolist() == CLASSES.tolist()


def test_pulses_through_leaves_betray_swapped_bands(caplog: pytest.LogCaptureFixture) -> None:
    rng = np.random.default_rng(0)
    several = rng.random(1000) < 0.4
    leaf, roof = rng.integers(100, 200, 1000), rng.integers(40, 90, 1000)
    red, nir = np.where(several, leaf, roof), np.where(several, roof, leaf)
    points = PointCloud(
        rng.uniform(0, 10, (1000, 3)),
        {"nir": nir, "red": red, "number_of_returns": 1 + several},
        crs=UTM,
    )
    with caplog.at_level(logging.WARNING, "toolbox"):
        ClassifyVegetationByNdvi(points=points).run()
    assert "are nir and red swapped?" in caplog.text
    caplog.clear()
    ClassifyVegetationByNdvi(points=points, nir=Attribute("red"), red=Attribute("nir")).run()
    assert not caplog.text


@pytest.mark.slow
def test_heights_rule_out_lawns_on_a_real_tile(data: Callable[[str], Path]) -> None:
    folder = data("cir_ign_20cm")
    points = PointCloud.open(folder / "split_west.laz")
    made = ClassifyNdvi(image=Raster.open(folder / "split_west_irc.tif"), nir="1", red="2").run()
    with_heights = PointsHeightAboveGround(points=points).run().heights
    plant, other = (np.isin(points["classification"], k) for k in ((3, 4, 5), (2, 6)))
    rates = []
    for layer in (points, with_heights):
        out = ClassifyVegetationByNdvi(points=layer, image=made.ndvi, threshold=0.0).run()
        found = np.isin(out.classified["classification"], (3, 4, 5))
        rates.append((found[plant].mean(), found[other].mean()))
    assert rates[0][0] > 0.8
    assert rates[1][0] > rates[0][0] - 0.03
    assert rates[1][1] < 0.1 * rates[0][1]
