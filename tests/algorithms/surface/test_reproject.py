"""surface.reproject: values and places that are known, kinds of values, types of cells."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pyproj import CRS, Transformer
from scenes.layers import raster

from algorithms.surface.reproject import SurfaceReproject
from toolbox.data import Lattice
from toolbox.declare import DataFile
from toolbox.errors import DataError, ParameterError


def ramp(**more: Any) -> Any:
    """A plane that rises by 0.1 per metre eastwards and 0.05 northwards."""
    x, y = np.meshgrid(np.arange(60) + 0.5, np.arange(50) + 0.5)
    return raster(0.1 * x - 0.05 * y, **more)


def plane(x: Any, y: Any) -> Any:
    return 0.1 * (x - 500_000) + 0.05 * (y - 4_600_000)


@pytest.mark.parametrize("crs", [32636, 4326])
def test_a_plane_stays_a_plane(crs: int) -> None:
    """Bilinear means of a plane are exact, wherever the new centres lie."""
    out = SurfaceReproject(surface=ramp(), crs=CRS(crs)).run().reprojected
    x, y = np.meshgrid(*Lattice.of(out).centres())
    back = Transformer.from_crs(crs, 32635, always_xy=True).transform(x, y)
    known = ~np.isnan(out.band())
    assert known.sum() > 2500
    np.testing.assert_allclose(out.band()[known], plane(*back)[known], rtol=0, atol=1e-6)


def test_cells_keep_their_size_on_the_ground() -> None:
    assert SurfaceReproject(surface=ramp(), crs=CRS(32636)).run().reprojected.cell == 1.0
    degrees = SurfaceReproject(surface=ramp(), crs=CRS(4326)).run().reprojected.cell
    assert 0.95 < degrees * 111_320 * np.sqrt(np.cos(np.radians(41.55))) < 1.05
    asked = SurfaceReproject(surface=ramp(), crs=CRS(32636), cell=2.5).run().reprojected
    assert asked.cell == 2.5
    west, north = asked.transform.c / 2.5, asked.transform.f / 2.5
    assert west == round(west)
    assert north == round(north)


def test_classes_stay_classes_and_holes_get_a_mark() -> None:
    classes = np.add.outer(np.arange(50), np.arange(60)).astype(np.uint8) % 7
    out = SurfaceReproject(surface=raster(classes), crs=CRS(32636), method="nearest").run()
    made = out.reprojected
    assert made.values.dtype == np.uint8
    assert made.nodata == 255
    assert set(np.unique(made.values)) == {*range(7), 255}
    every = np.arange(3000, dtype=np.uint8).reshape(50, 60)
    full = SurfaceReproject(surface=raster(every), crs=CRS(32636), method="nearest").run()
    assert full.reprojected.values.dtype == np.float32
    assert np.isnan(full.reprojected.values).any()


def test_elevations_change_where_heights_do() -> None:
    feet = ramp(crs=CRS(2263), west=1e6, north=2e5, units=("US survey foot",))
    with pytest.raises(DataError, match=r"values: heights change .*elevations, lengths or other"):
        SurfaceReproject(surface=feet, crs=CRS(26918)).run()
    out = SurfaceReproject(surface=feet, crs=CRS(26918), values="elevations").run().reprojected
    assert out.units == ("metre",)
    assert out.cell == pytest.approx(1200 / 3937)
    assert np.nanmax(out.band()) == pytest.approx(np.nanmax(feet.band()) * 1200 / 3937, rel=0.02)
    other = SurfaceReproject(surface=feet, crs=CRS(26918), values="other").run().reprojected
    assert np.nanmax(other.band()) == pytest.approx(np.nanmax(feet.band()), rel=0.02)
    assert other.units == ("US survey foot",)
    lengths = SurfaceReproject(surface=feet, crs=CRS(26918), values="lengths").run().reprojected
    np.testing.assert_allclose(lengths.band(), other.band() * 1200 / 3937, rtol=1e-9)
    assert lengths.units == ("metre",)


def test_a_geoid_is_for_elevations() -> None:
    with pytest.raises(ParameterError, match="geoid: is for elevations"):
        SurfaceReproject(surface=ramp(), crs=CRS(4326), geoid=DataFile("a.tif"), values="other")
