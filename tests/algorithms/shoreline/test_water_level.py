"""shoreline.water_level: known levels under errors below and banks above."""

from __future__ import annotations

import geopandas
import numpy as np
import pytest
import shapely
from scenes.lakes import LEVEL, ORIGIN, RADIUS, lake, river, slope

from algorithms.shoreline._level import level_of, lowest_mode, mode
from algorithms.shoreline.water_level import ShorelineWaterLevel
from toolbox.data import PointCloud, Vector

CENTRE = ORIGIN[:2] + 50


def polygon(radius: float, centre: tuple[float, float] = (0.0, 0.0)) -> Vector:
    shape = shapely.Point(CENTRE + centre).buffer(radius)
    return Vector(geopandas.GeoDataFrame(geometry=[shape], crs=32635), name="map.gpkg")


def test_level_and_its_error() -> None:
    found = ShorelineWaterLevel(points=lake()).run()
    assert found.level == pytest.approx(LEVEL, abs=0.005)
    assert found.level_error is not None
    assert abs(found.level - LEVEL) < 4 * found.level_error < 0.02


def test_low_outliers_hardly_move_it() -> None:
    """One per cent of all points lies up to 5 m too low; the minimum is off by metres."""
    clean, bad = lake(seed=4), lake(seed=4, errors=0.01)
    assert bad.xyz[:, 2].min() < LEVEL - 1
    levels = [ShorelineWaterLevel(points=cloud).run().level for cloud in (clean, bad)]
    assert levels[0] == pytest.approx(levels[1], abs=0.002)


@pytest.mark.parametrize("bank", [0.05, 0.2, 1.0])
def test_without_water_returns_it_is_the_foot_of_the_bank(bank: float) -> None:
    found = ShorelineWaterLevel(points=lake(returned=0.0, bank=bank)).run()
    assert found.level == pytest.approx(LEVEL, abs=0.02)


def test_several_waters_have_several_levels() -> None:
    east = lake(seed=1, level=110.0)
    both = PointCloud.concat([lake(), east.with_xyz(east.xyz + np.array([100.0, 0, 0]))])
    rows = ShorelineWaterLevel(points=both).run().levels.rows()
    assert sorted(round(row["level"], 1) for row in rows) == [110.0, 120.0]
    assert [row["body"] for row in rows] == [1, 2]


@pytest.mark.parametrize("radius", [RADIUS - 5, RADIUS, RADIUS + 5])
def test_polygons_of_a_map_need_not_fit(radius: float) -> None:
    found = ShorelineWaterLevel(points=lake(), water=polygon(radius)).run()
    assert found.level == pytest.approx(LEVEL, abs=0.005)


def test_a_polygon_without_points_is_told(caplog: pytest.LogCaptureFixture) -> None:
    found = ShorelineWaterLevel(points=lake(), water=polygon(5.0, (500.0, 0.0))).run()
    assert found.level is None
    assert "there are no points on the polygon" in caplog.text


def test_a_river_is_told_by_its_fall() -> None:
    (row,) = ShorelineWaterLevel(points=river()).run().levels.rows()
    assert row["slope"] == pytest.approx(0.004, rel=0.02)
    assert row["fall"] == pytest.approx(1.56, abs=0.05)


def test_no_water() -> None:
    found = ShorelineWaterLevel(points=slope()).run()
    assert found.level is None
    assert len(found.levels) == 0


def test_modes() -> None:
    heights = np.array([1.0, 1.01, 1.02, 5.0, 5.01, 5.02, 5.03, -3.0])
    assert mode(heights, 0.1) == pytest.approx(5.015)
    assert lowest_mode(heights, 0.1) == pytest.approx(1.01)
    assert lowest_mode(np.array([3.0, 1.0]), 0.1) == 1.0


def test_level_ignores_what_is_above_and_below() -> None:
    rng = np.random.default_rng(0)
    z = np.concatenate([rng.normal(7, 0.03, 5000), rng.uniform(2, 7, 50), rng.uniform(7, 9, 1000)])
    xyz = np.column_stack([rng.uniform(0, 100, (len(z), 2)), z])
    level = level_of(xyz, np.ones(len(z), bool), 7.1, 1.0)
    assert level.height == pytest.approx(7.0, abs=0.003)
    assert level.sigma == pytest.approx(0.03, rel=0.2)
