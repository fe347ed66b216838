"""Rasters of heights that the tools of surfaces take."""

from __future__ import annotations

import numpy as np
import pytest
from scenes.layers import raster

from algorithms.compare.surfaces import CompareSurfaces
from algorithms.surface.contours import SurfaceContours
from algorithms.surface.difference import SurfaceDifference
from algorithms.surface.hillshade import SurfaceHillshade
from toolbox.errors import DataError


def test_infinite_heights_are_refused_by_name() -> None:
    """NaN is no data, and taken."""
    for value in (np.inf, -np.inf):
        bad = raster([[1, value], [2, 3]], name="bad.tif")
        good = raster([[1, np.nan], [2, 3]], name="good.tif")
        for tool in (SurfaceContours, SurfaceHillshade):
            with pytest.raises(DataError, match=r"surface: bad\.tif holds infinite values"):
                tool(surface=bad)
            tool(surface=good)
        with pytest.raises(DataError, match=r"base: bad\.tif holds infinite values"):
            SurfaceDifference(surface=good, base=bad)
        with pytest.raises(DataError, match=r"reference: bad\.tif holds infinite values"):
            CompareSurfaces(surface=good, reference=bad)
