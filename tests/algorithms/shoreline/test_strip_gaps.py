"""Gaps between strips that cross water are no water, and water that looks like them stays."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scenes.lakes import ORIGIN, UTM, columns

from algorithms.shoreline.extract import ShorelineExtract
from toolbox.data import PointCloud

Floats = NDArray[np.float64]
SIDE, WIDE, GAP = 400.0, 40.0, 50.0  # m, of the square, the river and the gap
TOLD = "gaps between strips that water runs into"


def valley(
    *,
    bank: float = 2.0,
    rise: float = 0.05,
    returned: float = 0.3,
    lean: float = 0.1,
    gap: float = GAP,
    wide: float = WIDE,
    bright: float = SIDE,
) -> tuple[PointCloud, Floats]:
    """A river from west to east at 100 m, and a gap across it that leans to the east.

    Parameters
    ----------
    bank : height of the banks, m
    rise : slope of the land behind them
    returned : share of the pulses that the river returns
    lean : how far the gap goes to the east, m for each metre to the north
    gap, wide : of the gap and the river, m
    bright : from the west so far it returns pulses, m

    Returns
    -------
    points, of 2 per m2
    how far each is to the east of the middle of the gap
    """
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, SIDE, (2, int(2 * SIDE**2)))
    away = abs(y - SIDE / 2) - wide / 2
    z = 100 + np.clip(away, 0, bank) + rise * np.clip(away - bank, 0, None)
    z += rng.normal(0, 0.03, len(x))
    east = x - SIDE / 2 - lean * (y - SIDE / 2)
    share = np.where(away > 0, 1, returned * (x < bright))
    kept = (rng.random(len(x)) < share) & (abs(east) > gap / 2)
    xyz = np.round(np.column_stack([x, y, z])[kept], 3) + ORIGIN
    wet = (away < 0)[kept]
    intensity = np.full(len(xyz), 900, np.uint16)
    return PointCloud(xyz, columns(intensity, wet), crs=UTM, name="valley"), east[kept]


def named(cloud: PointCloud, strip: NDArray[Any]) -> PointCloud:
    """Points with the numbers of their strips."""
    return cloud.with_attributes({"point_source_id": strip.astype(np.uint16)})


def found(cloud: PointCloud) -> Any:
    return ShorelineExtract(points=cloud, bodies="all", sloped=True).run().water.frame


def over_land(water: Any) -> float:
    """Area of waters outside of the river."""
    x, y = ORIGIN[:2]
    river = shapely.box(x, y + (SIDE - WIDE) / 2, x + SIDE, y + (SIDE + WIDE) / 2)
    return float(shapely.area(shapely.difference(water.geometry, river.buffer(4.0))).sum())


@pytest.mark.parametrize("lean", [0.0, 0.4])
def test_a_gap_in_uneven_land_is_no_water_and_its_edge_no_shore(lean: float, caplog: Any) -> None:
    cloud, _ = valley(lean=lean)
    with caplog.at_level(logging.WARNING, "toolbox"):
        water = found(cloud)
    assert f"{TOLD}, and that are left out of it: 2" in caplog.text
    assert over_land(water) < 0.06 * 2 * GAP * SIDE / 2
    assert water["area"].sum() == pytest.approx(SIDE * WIDE, rel=0.08)
    assert water["open_length"].sum() > 2 * WIDE + 1.5 * GAP  # ends of the river, and its mouths
    assert water["level"].to_numpy() == pytest.approx(100.0, abs=0.02)


def test_what_looks_like_a_gap_may_be_water_between_walls(caplog: Any) -> None:
    """In even land nothing but named strips tells a gap from water between walls of 4 m."""
    cloud, east = valley(bank=4.0, rise=0.0)
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert over_land(found(cloud)) > 0.8 * GAP * (SIDE - WIDE - 8)
        assert TOLD not in caplog.text
        assert "of whatever class, is more than 1 m above its level" in caplog.text
        assert over_land(found(named(cloud, 1 + (east > 0)))) < 0.06 * GAP * SIDE
    assert f"{TOLD}, and that are left out of it: 2" in caplog.text


def test_what_a_strip_covers_is_no_gap_between_strips(caplog: Any) -> None:
    """Each strip has points on both sides: it was flown there, and nothing came back."""
    cloud, _ = valley()
    strip = 1 + np.random.default_rng(0).integers(2, size=len(cloud))
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert over_land(found(named(cloud, strip))) > 0.8 * GAP * (SIDE - WIDE - 8)
    assert TOLD not in caplog.text


def basin(
    turn: float, length: float, returned: float = 0.3, arm: float = 0.0
) -> tuple[PointCloud, Floats, Floats]:
    """A basin of 40 m between walls of 2 m, of which the first 60 m return pulses.

    Parameters
    ----------
    turn : of its axis to the east, anticlockwise, radians
    length : m
    returned : share of the pulses that the first 60 m return
    arm : length of an arm of 50 m to its left, that returns nothing, m

    Returns
    -------
    points, of 2 per m2
    how far each is along the axis, and to the left of it
    """
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-SIDE / 2, SIDE / 2, (2, int(2 * SIDE**2)))
    along = x * np.cos(turn) + y * np.sin(turn)
    left = -x * np.sin(turn) + y * np.cos(turn)
    away = np.maximum(abs(along) - length / 2, abs(left) - 20)
    if arm:
        away = np.minimum(away, np.maximum(abs(along) - 25, abs(left - arm / 2) - arm / 2))
    z = np.where(away < 0, 100.0, 102 + 0.02 * away) + rng.normal(0, 0.03, len(x))
    bright = (along < 60 - min(length, SIDE) / 2) & (abs(left) < 20)
    kept = (away > 0) | ((rng.random(len(x)) < returned) & bright)
    xyz = np.round(np.column_stack([x, y, z])[kept], 3) + ORIGIN
    intensity = np.full(len(xyz), 900, np.uint16)
    cloud = PointCloud(xyz, columns(intensity, (away < 0)[kept]), crs=UTM, name="basin")
    return cloud, along[kept], left[kept]


@pytest.mark.parametrize(
    ("turn", "length", "returned"),
    [(0.0, 280.0, 0.3), (np.pi / 4, 280.0, 0.3), (0.0, 500.0, 0.15)],
)
def test_a_basin_or_canal_along_the_border_of_two_strips_is_no_gap(
    turn: float, length: float, returned: float
) -> None:
    """Each strip has points on one side of it alone, though they overlap by 10 m."""
    cloud, _, left = basin(turn, length, returned)
    both = 1 + np.arange(len(cloud)) % 2
    strips = named(cloud, np.where(abs(left) < 5, both, np.where(left > 0, 1, 2)))
    assert found(strips)["area"].sum() == pytest.approx(min(length, SIDE) * 40, rel=0.02)


def test_an_arm_of_a_basin_that_ends_on_land_is_no_gap() -> None:
    """It crosses the basin, along the border of two strips, and is walled."""
    cloud, along, _ = basin(np.pi / 4, 280.0, arm=150.0)
    area = found(named(cloud, 1 + (along > 0)))["area"].sum()
    assert area == pytest.approx(280 * 40 + 50 * 130, rel=0.04)


def test_a_gap_narrower_than_two_blocks_is_told_by_what_came_back() -> None:
    """Strips cover blocks of cells, so that they seem to cover it."""
    cloud, east = valley(gap=6.0)
    assert over_land(found(named(cloud, 1 + (east > 0)))) < 0.3 * 6 * (SIDE - WIDE)


def test_where_the_river_returns_nothing_either_a_gap_is_not_known(caplog: Any) -> None:
    """It counts as water, and is told, unless strips are named."""
    cloud, east = valley(returned=0.0)
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert over_land(found(cloud)) > 0.7 * GAP * (SIDE - WIDE - 8)
        assert TOLD not in caplog.text
        assert over_land(found(named(cloud, 1 + (east > 0)))) < 0.06 * GAP * SIDE
    assert TOLD in caplog.text


@pytest.mark.parametrize(("wide", "bright"), [(60.0, 200.0), (12.0, 80.0)])
def test_reaches_that_return_nothing_are_as_long_as_a_gap(
    wide: float, bright: float, caplog: Any
) -> None:
    """Half of a river is empty; of a small one most is, so that a gap may be as well."""
    cloud, _ = valley(wide=wide, bright=bright)
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert over_land(found(cloud)) > 0.6 * GAP * (SIDE - wide)
    assert TOLD not in caplog.text


def test_water_that_a_cliff_shades_is_no_gap(caplog: Any) -> None:
    """Nothing came back from 40 m of a lake below an uneven cliff, nor is its foot seen."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, SIDE, (2, int(2 * SIDE**2)))
    away = abs(y - 200) - 50
    z = 100 + np.clip(0.3 * away, 0, 3)
    z = np.where((away > 0) & (y > 249), 112 + 4 * np.sin(x / 40), z) + rng.normal(0, 0.03, len(x))
    kept = (away > 0) | ((y < 210) & (rng.random(len(x)) < 0.3))
    xyz = np.round(np.column_stack([x, y, z])[kept], 3) + ORIGIN
    intensity = np.full(len(xyz), 900, np.uint16)
    water = found(PointCloud(xyz, columns(intensity, (away < 0)[kept]), crs=UTM, name="cliff"))
    assert water["area"].sum() == pytest.approx(400 * 100, rel=0.05)
    assert "of whatever class, is more than 1 m above its level" in caplog.text


@pytest.mark.slow
def test_a_gap_that_crosses_a_river_in_a_valley(data: Callable[[str], Path], caplog: Any) -> None:
    """The river of site 5 goes on beside it, at levels of its own above and below a weir.

    Before, 65 ha at 285 m and 48 ha at 299 m covered its gravel pits at 251 m; then 9 ha of gap.
    """
    cloud = PointCloud.open(data("isprs_sites/FSite5_orig-utm.laz")).with_crs(UTM)
    water = found(cloud)
    assert "about 42000 m2" in caplog.text
    assert "about 32000 m2" in caplog.text
    above = water[shapely.contains_xy(water.geometry, 494_010.0, 5_420_180.0)]
    below = water[shapely.contains_xy(water.geometry, 494_850.0, 5_420_100.0)]
    assert float(above["level"].iloc[0]) == pytest.approx(252.44, abs=0.05)
    assert float(below["level"].iloc[0]) == pytest.approx(250.64, abs=0.05)
    assert water["area"].sum() == pytest.approx(79_600, rel=0.03)
