"""Rasters of heights that the tools of surfaces take."""

from __future__ import annotations

import numpy as np
import pytest
from affine import Affine
from pyproj import CRS

from algorithms.compare.surfaces import CompareSurfaces
from algorithms.surface.contours import SurfaceContours
from algorithms.surface.difference import SurfaceDifference
from algorithms.surface.hillshade import SurfaceHillshade
from toolbox.data import Raster
from toolbox.errors import DataError


def raster(value: float, name: str) -> Raster:
    values = np.array([[1.0, value], [2.0, 3.0]])
    return Raster(values, Affine(1, 0, 0, 0, -1, 9), crs=CRS(32635), name=name)


def test_infinite_heights_are_refused_by_name() -> None:
    """NaN is no data, and taken."""
    for value in (np.inf, -np.inf):
        bad, good = raster(value, "bad.tif"), raster(np.nan, "good.tif")
        for tool in (SurfaceContours, SurfaceHillshade):
            with pytest.raises(DataError, match=r"surface: bad\.tif holds infinite values"):
                tool(surface=bad)
            tool(surface=good)
        with pytest.raises(DataError, match=r"base: bad\.tif holds infinite values"):
            SurfaceDifference(surface=good, base=bad)
        with pytest.raises(DataError, match=r"reference: bad\.tif holds infinite values"):
            CompareSurfaces(surface=good, reference=bad)
