"""Points of a known front are at their places on its image."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import CRS
from scenes.fronts import elevation

from algorithms.planes.orthophoto import PlanesOrthophoto
from toolbox.data import PointCloud

UTM = CRS(32635)


def test_an_image_shows_points_where_they_are_on_the_elevation() -> None:
    u, v = (a.ravel() for a in np.meshgrid(np.arange(0.05, 10, 0.1), np.arange(0.05, 6, 0.1)))
    bright = (u > 4) & (u < 5.5) & (v > 4) & (v < 5)
    xyz = np.column_stack([500_000 + u, np.full(len(u), 4_400_000.02), 100 + v])
    behind = xyz[:200] + np.array([0, 3, 0])  # too far behind to be shown
    shade = np.concatenate([np.where(bright, 900, 100), np.full(200, 5000)]).astype(np.uint16)
    points = PointCloud(np.vstack([xyz, behind]), {"intensity": shade}, crs=UTM)
    found = PlanesOrthophoto(points=points, elevation=elevation(), cell=0.1).run()
    band = found.image.band()
    assert band.shape == (60, 100)
    assert found.filled_share == 1.0
    window = band[10:20, 40:55]
    assert window.min() > band[30:].max()


def test_withheld_points_are_not_shown() -> None:
    u, v = (a.ravel() for a in np.meshgrid(np.arange(0.05, 10, 0.1), np.arange(0.05, 6, 0.1)))
    xyz = np.column_stack([500_000 + u, np.full(len(u), 4_400_000.02), 100 + v])
    points = PointCloud(xyz, {"intensity": np.ones(len(u)), "withheld": u > 5}, crs=UTM)
    found = PlanesOrthophoto(points=points, elevation=elevation(), cell=0.1, fill_cells=0).run()
    assert found.filled_share == 0.5


def test_empty_cells_take_the_nearest_within_reach() -> None:
    u, v = (a.ravel() for a in np.meshgrid(np.arange(0.05, 10, 0.3), np.arange(0.05, 6, 0.3)))
    xyz = np.column_stack([500_000 + u, np.full(len(u), 4_400_000.0), 100 + v])
    points = PointCloud(xyz, {"intensity": np.arange(len(u)).astype(np.uint16)}, crs=UTM)
    shares = [
        PlanesOrthophoto(points=points, elevation=elevation(), cell=0.1, fill_cells=n)
        .run()
        .filled_share
        for n in (0, 2)
    ]
    assert shares[0] == pytest.approx(1 / 9, abs=0.02)
    assert shares[1] > 0.95


def test_points_without_brightness_show_what_stands_out(caplog: pytest.LogCaptureFixture) -> None:
    u, v = (a.ravel() for a in np.meshgrid(np.arange(0.05, 10, 0.1), np.arange(0.05, 6, 0.1)))
    cornice = v > 5
    y = 4_400_000 - np.where(cornice, 0.3, 0.0) + 0.002 * np.sin(7 * u)
    points = PointCloud(np.column_stack([500_000 + u, y, 100 + v]), crs=UTM)
    found = PlanesOrthophoto(points=points, elevation=elevation(), cell=0.1).run()
    band = found.image.band()
    assert band[:9].min() > band[11:].max()
    assert band[11:].min() >= 1
    assert found.image.descriptions == ("relief",)
    assert "neither colours nor intensity" in caplog.text
