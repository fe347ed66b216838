"""shoreline.extract: lakes with known shores, what is no water, rivers, edges of the data."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from pyproj import CRS
from scenes import waters
from scenes.lakes import LEVEL, ORIGIN, RADIUS, SIDE, UTM, columns, floor, lake, river, slope

from algorithms.samples.scene import scene
from algorithms.shoreline import _water
from algorithms.shoreline._bodies import Pour
from algorithms.shoreline._cells import Tilt, grid, median_of_counts
from algorithms.shoreline._dikes import _crest
from algorithms.shoreline._evidence import Body, _along_a_line, _drained
from algorithms.shoreline._kernels import TAKEN, spread
from algorithms.shoreline._level import Level, Sides, _parts, side_by_side, under_cover
from algorithms.shoreline._outline import detail_of
from algorithms.shoreline._reaches import along_banks
from algorithms.shoreline._returns import Returns
from algorithms.shoreline._surfaces import Water, is_plane
from algorithms.shoreline.extract import ShorelineExtract, open_edges
from toolbox.data import PointCloud, Survey
from toolbox.declare import ClassList, Position
from toolbox.errors import DataError
from toolbox.reports.units import in_both

FOOT = ("ft", 0.3048)
MIDDLE = Position(ORIGIN[0] + 50, ORIGIN[1] + 50)
ORIGIN_OF_SCENES = waters.ORIGIN[:2]
CIRCLE = shapely.Point(MIDDLE).buffer(RADIUS, quad_segs=90)


def extract(points: PointCloud, **settings: Any) -> ShorelineExtract.Outputs:
    return ShorelineExtract(points=points, **settings).run()


def only(found: ShorelineExtract.Outputs) -> Any:
    """The one polygon and its attributes."""
    (row,) = [row for _, row in found.water.frame.iterrows()]
    return row


def iou(one: shapely.Geometry, other: shapely.Geometry) -> float:
    return float(one.intersection(other).area / one.union(other).area)


@pytest.mark.parametrize("returned", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("dark", [True, False])
def test_a_lake_is_found_whether_it_returns_pulses_or_is_dark(returned: float, dark: bool) -> None:
    bright = returned == 1.0 and not dark
    found = extract(lake(returned=returned, dark=dark), level_alone=bright)
    assert iou(only(found).geometry, CIRCLE) > 0.98
    assert found.level == pytest.approx(LEVEL, abs=0.005 if returned else 0.02)
    assert found.area == pytest.approx(CIRCLE.area, rel=0.01)


@pytest.mark.parametrize(("density", "bar"), [(1.0, 0.96), (4.0, 0.98), (20.0, 0.985)])
def test_shore_lies_between_the_points(density: float, bar: float) -> None:
    found = extract(lake(density=density, seed=3))
    shore = only(found).geometry
    assert iou(shore, CIRCLE) > bar
    corners = shapely.get_coordinates(shore.exterior)
    off = np.hypot(*(corners - MIDDLE).T) - RADIUS
    assert np.sqrt((off**2).mean()) < max(
        0.5 / math.sqrt(density), 0.2
    )  # half a spacing, or the noise


def test_stated_uncertainty_is_that_of_the_corners() -> None:
    found = extract(lake(density=4.0, returned=0.3))
    corners = found.vertices.frame
    xy = shapely.get_coordinates(corners.geometry)
    off = np.hypot(*(xy - MIDDLE).T) - RADIUS
    ratio = np.sqrt((off**2).mean() / (corners["sigma"] ** 2).mean())
    assert 0.4 < ratio < 1.6
    assert only(found).uncertainty == pytest.approx(corners["sigma"].mean(), rel=0.5)


def test_polygon_line_and_corners_agree_and_lie_at_the_level() -> None:
    found = extract(lake(island=6.0))
    row, lines = only(found), found.shoreline.frame
    assert found.water.geometry_type == "Polygon Z"
    assert row.islands == 1
    assert list(lines["kind"]) == ["shore", "island"]
    assert lines.length.sum() == pytest.approx(row.geometry.length)
    assert lines.length.sum() == pytest.approx(row.perimeter, abs=0.01)
    assert row.area == pytest.approx(row.geometry.area, abs=0.01)
    z = shapely.get_coordinates(row.geometry, include_z=True)[:, 2]
    np.testing.assert_allclose(z, found.level)
    assert len(found.vertices) == len(shapely.get_coordinates(row.geometry)) - 2
    assert found.water.crs == CRS(32635)
    assert row.geometry.is_valid


def test_the_log_has_the_numbers_and_areas_of_the_table(caplog: pytest.LogCaptureFixture) -> None:
    """Those of cells were up to 18 % off, and it was not to be seen which row was meant."""
    caplog.set_level("INFO", "toolbox")
    water = extract(lake(pond=7.0), bodies="all").water.frame
    for row in water.itertuples():
        assert f"water body {row.body} ({row.area:.0f} m2, at " in caplog.text
    assert "of about" not in caplog.text


def test_what_bridges_hide_is_told_where_there_is_water() -> None:
    """A set gave outlines 5 m short of a quay, as crowns hung over a canal, and did not say so."""
    assert any("below bridges" in text for text in extract(lake()).not_looked_at())
    assert not any("bridges, decks" in text for text in extract(hillside(0, 0.06)).not_looked_at())


def test_waters_that_look_like_pavement_are_counted() -> None:
    """A dark car park that falls by 1.5 cm was water, and nothing said so (crowned, seed 732)."""
    for kind, returned, told in (("calm", 1.0, "1 of 1"), ("calm", 0.1, ""), ("hills", 1.0, "")):
        some = waters.survey(kind, 3, density=3.0, returned=returned)
        said = [
            one for one in extract(some.points).not_looked_at() if "level and dark alone" in one
        ]
        assert [told in one for one in said] == ([True] if told else [])


def test_paved_ground_with_a_flat_middle_is_no_water(caplog: pytest.LogCaptureFixture) -> None:
    """It was found by its middle, and grew to a twist of 0.1 m in the corners (crowned, 757)."""
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert extract(waters.survey("crowned", 757).points).water.frame.empty
    assert "1 level places are left out" in caplog.text


def test_waters_of_which_plants_alone_may_have_come_back_are_counted() -> None:
    """Of lakes only floating leaves returned: 0.044 m too high, ± 0.001 m, and 0.135, ± 0.002."""
    for kind, seed, told in (
        ("plants", 734, "1 of 1"),
        ("leaves", 742, "1 of 1"),
        ("plants", 733, ""),
    ):
        made = waters.survey(kind, seed)
        found = extract(made.points)
        assert abs(found.level - made.waters[0].level) < found.level_interval
        said = [one for one in found.not_looked_at() if "as bright as land" in one]
        assert [told in one for one in said] == ([True] if told else [])


def test_few_bright_returns_of_a_class_of_water_are_of_water() -> None:
    made = waters.survey("plants", 734)
    wet = shapely.contains_xy(made.outlines[0], *made.points.xyz[:, :2].T)
    classes = {"classification": np.where(wet, 9, 2).astype(np.uint8)}
    found = extract(made.points.with_attributes(classes), water_classes=ClassList([9]))
    assert only(found).evidence.endswith("class")
    assert found.level_interval < 0.01
    assert not any("as bright as land" in one for one in found.not_looked_at())


def test_the_least_area_and_width_of_waters_are_told_whether_any_is_found() -> None:
    """A piece of 78 m2 of a canal between a bridge and a house was water nowhere, in silence."""
    for points in (lake(), hillside(0, 0.06)):
        found = extract(points, min_area=250.0)
        assert found.narrowest
        (text,) = [one for one in found.not_looked_at() if "not looked for" in one]
        assert "Waters of less than 250 m²" in text
        assert f"narrower than {found.narrowest:.1f} m" in text
    assert extract(lake()).narrowest == pytest.approx(4, rel=0.03), "4 cells of 2 spacings, 0.5 m"


def test_where_a_bridge_ends_an_outline_is_told(caplog: pytest.LogCaptureFixture) -> None:
    """151 m2 of a canal under a bridge were in no area, and a terrain had a mound there."""
    points = lake()
    x, y = (points.xyz[:, :2] - MIDDLE).T
    for away, told in ((RADIUS + 1, True), (RADIUS + 8, False)):
        deck = (x > away) & (x < away + 10) & (abs(y) < 2)
        classes = np.where(deck, 17, 2).astype(np.uint8)
        caplog.clear()
        found = extract(points.with_attributes({"classification": classes}))
        assert found.count == 1
        assert ("outlines of water end at bridges" in caplog.text) == told
        if told:
            (text,) = re.findall(r"water body 1 at [\d.,]+ \((\d+) m2\)", caplog.text)
            assert float(text) == pytest.approx(40, abs=20), "10 by 4 m, in cells of 1 m"


def test_islands_stay_and_small_ones_are_a_choice() -> None:
    cloud = lake(island=4.0)
    (island,) = only(extract(cloud)).geometry.interiors
    assert shapely.Polygon(island).area == pytest.approx(math.pi * 16, rel=0.15)
    assert not only(extract(cloud, min_island=100.0)).geometry.interiors


def test_a_pond_at_the_same_level_is_another_body(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "toolbox")
    cloud = lake(pond=7.0)
    lake_alone = extract(cloud)
    assert iou(only(lake_alone).geometry, CIRCLE) > 0.98
    told = (
        "points: other water bodies: 1, given apart; they do not count in area and level: "
        "water body 2 ("
    )
    (warning,) = [one.getMessage() for one in caplog.records if told in one.getMessage()]
    assert "seed_point" not in warning, "it goes into papers of people who run nothing"
    assert "seed_point takes the water at a place" in caplog.text
    assert "bodies all gives every one" in caplog.text
    caplog.clear()
    every = extract(cloud, bodies="all")
    both = every.water.frame
    assert "which are given apart" not in caplog.text
    assert every.other_waters.frame.empty
    (outline,) = lake_alone.other_waters.frame.itertuples()
    assert len(lake_alone.other_bodies.frame) == 1, "a polygon is given, too"
    assert (outline.body, outline.kind) == (2, "shore")
    assert shapely.Polygon(outline.geometry).equals_exact(both.geometry[1], 1e-9)
    assert f"water body 2 ({both['area'][1]:.0f} m2, at " in warning, "as in tables, not by cells"
    assert f"level {both['level'][1]:.3f} m" in warning, "as in tables"
    (body,) = lake_alone.other_bodies.frame.itertuples()
    assert body.geometry.equals_exact(both.geometry[1], 1e-9)
    assert (body.body, body.area) == (2, both["area"][1])
    assert list(both["body"]) == [1, 2]
    assert both.geometry[1].area == pytest.approx(math.pi * 49, rel=0.1)
    at = Position(ORIGIN[0] + 10, ORIGIN[1] + 10)
    assert only(extract(cloud, seed_point=at)).geometry.area < 200
    assert len(extract(cloud, bodies="all", min_area=500.0).water) == 1


def test_a_place_without_water_is_told_with_the_nearest_body() -> None:
    with pytest.raises(DataError, match=r"seed_point: no water body .* nearest .* m2 .* m away"):
        extract(lake(), seed_point=Position(ORIGIN[0] + 2, ORIGIN[1] + 2))
    with pytest.raises(DataError, match="there is no water body"):
        extract(slope(), seed_point=MIDDLE)


@pytest.mark.parametrize("rise", [0.001, 0.01, 0.1])
def test_dry_land_gives_nothing_and_says_so(rise: float, caplog: Any) -> None:
    with caplog.at_level(logging.WARNING, "toolbox"):
        found = extract(slope(rise=rise))
    assert len(found.water) == len(found.shoreline) == len(found.vertices) == 0
    assert found.level is None
    assert found.area == 0
    assert "no water was found" in caplog.text


def terrace() -> PointCloud:
    """A terrace of 20 x 40 m that falls by 1.2 %, with fewer points than the slopes around it.

    A hedge stands around it, through which the ground is seen.
    """
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, 1, (60_000, 2)) * (100, 80)
    outside = np.max(abs(xy - (50, 40)) - (10, 20), axis=1)  # m from its edge
    z = 120 + 0.012 * (xy[:, 0] - 50) - 0.3 * np.maximum(outside, 0)
    z += rng.normal(0, 0.02, len(xy))
    hedge = (abs(outside) < 1) & (rng.random(len(xy)) < 0.8)
    z[hedge] += rng.uniform(0.5, 1.5, hedge.sum())
    kept = (outside > 0) | (rng.random(len(xy)) < 0.45)
    xyz = np.round(np.column_stack([xy, z])[kept], 3) + ORIGIN
    intensity = rng.lognormal(7.0, 0.2, len(xyz)).astype(np.uint16)
    land = np.zeros(len(xyz), bool)
    return PointCloud(xyz, columns(intensity, land), crs=UTM, name="terrace.laz")


def test_thin_points_on_a_terrace_behind_a_hedge_are_no_pond() -> None:
    """A river bank with half of the points around it was a pond 3 ft above all ground beside."""
    assert extract(terrace(), bodies="all", sloped=True).count == 0


def hillside(seed: int, rise: float) -> PointCloud:
    """A slope of 300 x 200 m, less at its foot: the data end in a notch, a dark road beside it."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 300, 30_000), rng.uniform(0, 200, 30_000)
    z = rise * x + 0.0008 * np.maximum(y - 30, 0) ** 2 + rng.normal(0, 0.03, len(x))
    intensity = np.where((y > 39) & (y < 50), rng.normal(120, 20, len(x)), 300).astype(np.uint16)
    kept = (x < 50) | (x > 250) | (y > 40)
    xyz = np.round(np.column_stack([x, y, z])[kept], 3) + ORIGIN
    single = np.zeros(len(xyz), bool)
    return PointCloud(xyz, columns(intensity[kept], single), crs=UTM, name="hillside.laz")


@pytest.mark.parametrize("rise", [0.002, 0.005, 0.02, 0.06, 0.12])
def test_a_notch_of_the_data_on_a_hillside_is_no_river(
    rise: float, caplog: pytest.LogCaptureFixture
) -> None:
    """Below it the ground is as bright as beside it, and returns as much."""
    caplog.set_level(logging.INFO)
    assert extract(hillside(0, rise), bodies="all", sloped=True).count == 0
    assert "gaps of the data that are left out" in caplog.text


def bay(seed: int) -> PointCloud:
    """Water at 0.8 m south of a bank, with a hole in which there are points on a pier alone."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 300, (2, 36_000))
    wet = y < 180
    z = 0.8 + np.clip(0.5 * (y - 180), 0, 6) + rng.normal(0, 0.04, len(x))
    hole = (abs(x - 60) < 55) & (y > 60) & (y < 170)
    kept = ~wet | ((rng.random(len(x)) < 0.4) & ~hole)
    pier = np.column_stack([rng.uniform(57, 63, 24), rng.uniform(80, 150, 24), np.full(24, 6.6)])
    intensity = np.concatenate([np.where(wet, 100, 300)[kept], np.full(24, 250)])
    xyz = np.round(np.vstack([np.column_stack([x, y, z])[kept], pier]), 3) + ORIGIN
    single = np.zeros(len(xyz), bool)
    return PointCloud(xyz, columns(intensity.astype(np.uint16), single), crs=UTM, name="bay.laz")


def test_a_pier_is_no_reach_of_a_river() -> None:
    assert only(extract(bay(0), bodies="all", sloped=True)).level == pytest.approx(0.8, abs=0.01)


def canal(crowns: int) -> PointCloud:
    """A canal of 12 m that returned nothing, between streets 0.2 m above the foot of its quays.

    Parameters
    ----------
    crowns : returns from crowns over the middle of the canal
    """
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 80, (2, 40_000))
    away = np.maximum(abs(y - 40) - 6, abs(x - 40) - 30)  # from the edge of the canal
    z = np.select([away < 0.5, away < 12], [120.0, 120.2 + 0.01 * away], 121.5) + rng.normal(
        0, 0.02, len(x)
    )
    kept = away > 0
    over = np.column_stack([rng.uniform(36, 44, crowns), rng.uniform(38, 42, crowns)])
    over = np.column_stack([over, rng.uniform(123, 125, crowns)])
    xyz = np.round(np.vstack([np.column_stack([x, y, z])[kept], over]), 3) + ORIGIN
    single = np.zeros(len(xyz), bool)
    return PointCloud(
        xyz, columns(np.full(len(xyz), 900, np.uint16), single), crs=UTM, name="canal"
    )


@pytest.mark.parametrize("crowns", [0, 20])
def test_crowns_over_a_canal_tell_no_level_and_streets_beside_it_are_dry(crowns: int) -> None:
    """In Delft a street of 90 m2 was water: crowns counted as returns from a canal without any."""
    water = only(extract(canal(crowns), bodies="all"))
    assert water.level == pytest.approx(120.0, abs=0.05)
    assert water.geometry.area == pytest.approx(61 * 13, rel=0.08)  # with the foot of the quays


def quay(wide: float, low: float, high: float, behind: float = 0.0) -> PointCloud:
    """A canal of 24 m that returned nothing, between quays of 1.5 m, below crowns along one.

    Parameters
    ----------
    wide : how far the crowns hang over the canal, m; they stand as far behind the quay
    low, high : between which heights above the quay they return
    behind : how much higher it is behind the quay at which they hang, m
    """
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 80, (2, 60_000))
    z = np.where(y > 52, 121.5 + behind, 121.5) + rng.normal(0, 0.02, len(x))
    in_canal = (abs(y - 40) < 12) & (abs(x - 40) < 30)
    foot = in_canal & ((abs(y - 40) > 11.5) & (y < 40) | (abs(x - 40) > 29.5))
    z[foot] = 120.0
    crown = (
        (abs(y - 52) < wide) & (abs(x - 40) < 29.5) & (in_canal | (rng.uniform(size=len(x)) < 0.6))
    )
    z[crown] = 121.5 + rng.uniform(low, high, crown.sum())
    kept = crown | foot | ~in_canal
    xyz = np.round(np.column_stack([x, y, z])[kept], 3) + ORIGIN
    single = np.zeros(len(xyz), bool)
    return PointCloud(xyz, columns(np.full(len(xyz), 900, np.uint16), single), crs=UTM, name="quay")


def test_errors_of_areas_hold_water_that_crowns_hide() -> None:
    """In Delft 368 of 2,749 m2 of a canal were missing below trees, with an interval of 125 m2."""
    made = extract(quay(6.0, 4.0, 12.0), bodies="all")
    water = only(made)
    assert water.hidden_area == pytest.approx(60 * 6, rel=0.1)
    assert water.geometry.area < 60 * 19
    assert water.geometry.area + 1.96 * water.area_error > 60 * 24
    assert any("below crowns" in text for text in made.not_looked_at())


@pytest.mark.parametrize(
    ("wide", "low", "high", "behind", "most"),
    [
        pytest.param(6.0, 6.0, 6.1, 0.0, 10.0, id="a roof is even"),
        pytest.param(6.0, -1.2, 0.4, 0.0, 10.0, id="reeds are lower"),
        pytest.param(12.0, 4.0, 12.0, 0.0, 200.0, id="no crown is so wide, but at both ends"),
        pytest.param(6.0, 4.0, 12.0, 11.0, 120.0, id="a slope is not lower, but at both ends"),
    ],
)
def test_what_is_no_crown_hides_nothing(
    wide: float, low: float, high: float, behind: float, most: float
) -> None:
    water = only(extract(quay(wide, low, high, behind), bodies="all"))
    assert water.hidden_area < most


@pytest.mark.parametrize(("rise", "count"), [(0.3, 1), (1.0, 0)])
def test_between_two_pieces_of_data_water_must_have_a_shore(rise: float, count: int) -> None:
    """Two banks 600 m apart, and nothing north and south of them; the steep one hides its shore."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 200, 40_000), rng.uniform(0, 100, 40_000)
    z = rise * abs(x - 100) + rng.normal(0, 0.02, len(x))
    xyz = np.column_stack([x + 600 * (x > 100), y, z]) + ORIGIN
    intensity, single = np.full(len(x), 1000, np.uint16), np.zeros(len(x), bool)
    cloud = PointCloud(np.round(xyz, 3), columns(intensity, single), crs=UTM, name="banks.laz")
    assert extract(cloud, bodies="all").count == count


def pools(length: float, above: Callable[[Any], Any], returned: Callable[[Any], Any]) -> PointCloud:
    """A river of 30 m between banks, with heights and shares of returns by the way along it."""
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0, 1, (2, int(400 * length))) * [[length], [100]]
    bank = abs(y - 50) - 15
    z = 100 + above(x) + np.clip(0.5 * bank, 0, 4) + rng.normal(0, 0.03, len(x))
    kept = rng.random(len(x)) < np.where(bank > 0, 1, returned(x))
    xyz = np.round(np.column_stack([x, y, z])[kept], 3) + ORIGIN
    wet = (bank < 0)[kept]
    return PointCloud(xyz, columns(np.full(len(xyz), 900, np.uint16), wet), crs=UTM, name="pools")


def test_a_still_pool_above_a_rough_one_is_a_reach_of_its_own() -> None:
    cloud = pools(600, lambda x: 0.8 * (x > 300), lambda x: np.where(x > 300, 0.05, 0.3))
    levels = extract(cloud, bodies="all", sloped=True).water.frame["level"]
    assert sorted(levels) == pytest.approx([100.0, 100.8], abs=0.02)


@pytest.mark.parametrize("gap", [True, False])
def test_a_gap_between_strips_that_a_river_runs_into_is_told(gap: bool, caplog: Any) -> None:
    """It counts as water, as nothing came back from it, but lies 4 m below the ground beside."""
    cloud = pools(400, lambda x: 0 * x, lambda x: 0.3 + 0 * x)
    x = cloud["x"] - ORIGIN[0]
    with caplog.at_level(logging.WARNING, "toolbox"):
        extract(cloud.select((x < 180) | (x > 220) | (not gap)))
    assert ("of whatever class, is more than 1 m above its level" in caplog.text) is gap


def test_a_torrent_of_a_class_of_water_is_water() -> None:
    cloud = pools(200, lambda x: 0.05 * x, lambda x: 0.25 + 0 * x)
    assert extract(cloud, sloped=True).count == 0
    row = only(extract(cloud, sloped=True, water_classes=ClassList((9,))))
    assert row.slope == pytest.approx(0.05, rel=0.02)
    told = extract(cloud, sloped=True, water_classes=ClassList((9,))).in_words()
    pattern = r"The surface of the largest falls from (\d+\.\d+) to (\d+\.\d+) m; the"
    ((high, low),) = re.findall(pattern, told)
    assert [float(low), float(high)] == pytest.approx([100.0, 110.0], abs=0.3)


def test_a_river_that_returns_nothing_and_falls_evenly_is_not_off_its_banks(
    caplog: pytest.LogCaptureFixture,
) -> None:
    row = only(extract(pools(1000, lambda x: 0.006 * x, lambda x: 0 * x), sloped=True))
    assert row.slope == pytest.approx(0.006, rel=0.02)
    assert "the banks along a tenth" not in caplog.text


def test_a_steep_river_is_one() -> None:
    row = only(extract(river(fall=0.025, returned=0.3), sloped=True))
    assert row.slope == pytest.approx(0.025, rel=0.02)


def test_what_would_run_off_is_no_water() -> None:
    """A level roof that returns few pulses, with lower ground around three sides of it."""
    ground = slope(rise=0.5)
    x, y = (ground.xyz - ORIGIN)[:, :2].T
    roof = (abs(x - 32.5) < 27.5) & (abs(y - 50) < 45)
    xyz = ground.xyz.copy()
    xyz[roof, 2] = 131 + np.random.default_rng(0).normal(0, 0.02, roof.sum())
    kept = ~roof | (np.random.default_rng(1).random(len(x)) < 0.1)
    assert extract(ground.with_xyz(xyz).select(kept)).count == 0


def test_layers_without_features_have_their_attributes() -> None:
    none, some = extract(slope()), extract(lake())
    for name in ("water", "shoreline", "vertices"):
        empty, filled = getattr(none, name).frame, getattr(some, name).frame
        assert not len(empty)
        assert list(empty.columns) == list(filled.columns)
        assert empty.dtypes.to_dict() == filled.dtypes.to_dict()


def test_level_land_may_be_all_water_but_has_no_shore(caplog: Any) -> None:
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert extract(slope(rise=0.0)).count == 0
        assert "1 level places are left out" in caplog.text
        row = only(extract(slope(rise=0.0), level_alone=True))
    assert row.open_length == pytest.approx(row.perimeter)
    assert "is the edge of the data, not a shore" in caplog.text


@pytest.mark.parametrize("centre", [(0.0, 50.0), (0.0, 0.0)])
def test_water_at_the_edge_of_the_data_is_open(centre: tuple[float, float], caplog: Any) -> None:
    with caplog.at_level(logging.WARNING, "toolbox"):
        found = extract(lake(centre=centre))
    row, lines = only(found), found.shoreline.frame
    assert row.open_length == pytest.approx(2 * RADIUS, rel=0.08)
    assert set(lines["kind"]) == {"shore", "data edge"}
    square = shapely.box(*ORIGIN[:2], *(ORIGIN[:2] + SIDE))
    truth = shapely.Point(ORIGIN[:2] + centre).buffer(RADIUS, quad_segs=90).intersection(square)
    assert iou(row.geometry, truth) > 0.96
    assert "is the edge of the data" in caplog.text


@pytest.mark.parametrize("returned", [0.3, 0.02, 0.0])
def test_a_river_is_an_error_that_names_its_slope(returned: float) -> None:
    with pytest.raises(DataError, match=r"falls by 1\.5\d m over 39\d m \(0\.40%\)"):
        extract(river(returned=returned))


def test_a_river_among_all_bodies_is_left_out_and_told(caplog: Any) -> None:
    assert extract(river(), bodies="all").count == 0
    assert "falls by" in caplog.text
    assert "left out" in caplog.text


def test_a_river_may_slope() -> None:
    row = only(extract(river(), sloped=True))
    assert row.slope == pytest.approx(0.004, rel=0.02)
    assert row.area == pytest.approx(8000, rel=0.02)
    x, _, z = shapely.get_coordinates(row.geometry, include_z=True).T
    np.testing.assert_allclose(z, 120 - 0.004 * (x - ORIGIN[0]), atol=0.02)


def test_errors_below_do_not_move_the_shore() -> None:
    found = extract(lake(errors=0.01))
    assert found.level == pytest.approx(LEVEL, abs=0.005)
    assert iou(only(found).geometry, CIRCLE) > 0.98


def test_scale_of_intensity_does_not_matter() -> None:
    cloud = lake()
    eight = cloud.with_attributes({"intensity": (cloud["intensity"] // 16).astype(np.uint8)})
    none = cloud.with_attributes({"intensity": np.zeros(len(cloud), np.uint16)})
    row = only(extract(cloud))
    assert row.evidence == "few returns, level, dark"
    assert only(extract(eight)).geometry.equals(row.geometry)
    assert only(extract(none)).geometry.equals(row.geometry)
    assert only(extract(none)).darkness == 0


def test_classes_count_if_they_are_named() -> None:
    """A lake too small and bright to be known by anything else."""
    cloud = lake(returned=1.0, dark=False, centre=(10.0, 50.0))
    small = cloud.select(cloud["x"] < ORIGIN[0] + 40)
    rough = small.xyz.copy()
    rough[:, 2] += np.random.default_rng(0).normal(0, 0.2, len(rough))
    small = small.with_xyz(rough)
    assert extract(small).count == 0
    found = extract(small, water_classes=ClassList([9]))
    assert found.count == 1
    assert "class" in only(found).evidence


def test_feet_give_the_lake_of_metres() -> None:
    foot = 1200 / 3937
    metres = lake(island=6.0)
    feet = PointCloud(
        metres.xyz / foot, {n: metres[n] for n in metres.names}, crs=CRS(2263), name="feet.laz"
    )
    here, there = extract(feet), extract(metres)
    assert here.level == pytest.approx(there.level, abs=1e-3)
    assert here.area == pytest.approx(there.area, rel=1e-3)
    assert only(here).perimeter == pytest.approx(only(there).perimeter, rel=1e-2)
    assert only(here).level == pytest.approx(LEVEL / foot, abs=0.02)


def test_order_of_points_and_large_coordinates_do_not_matter() -> None:
    """Elsewhere the cells fall otherwise among the points: a thousandth of the area on average."""
    changes = []
    for seed in (5, 6, 7):
        cloud = lake(seed=seed, island=6.0)
        order = np.random.default_rng(1).permutation(len(cloud))
        row = only(extract(cloud))
        assert only(extract(cloud.select(order))).geometry.equals(row.geometry)
        far = np.array([4_000_000.0, 3_000_000.0, 2_000.0])
        changes.append(only(extract(cloud.with_xyz(cloud.xyz + far))).area / row.area - 1)
    assert np.abs(changes).mean() < 1e-3


def test_several_files_give_the_lake_of_one(tmp_path: Path) -> None:
    cloud = lake(island=6.0)
    west = cloud["x"] < ORIGIN[0] + 45
    for name, part in (("west", west), ("east", ~west)):
        cloud.select(part).save(tmp_path / f"{name}.laz")
    whole = only(extract(cloud))
    found = ShorelineExtract(points=Survey.open(tmp_path)).run()
    assert iou(only(found).geometry, whole.geometry) > 0.999
    assert found.level == pytest.approx(whole.level, abs=1e-3)


def test_no_points_no_water(caplog: Any) -> None:
    assert extract(lake().select([])).count == 0
    assert "there are none" in caplog.text


@pytest.mark.parametrize("count", [1, 2, 40])
def test_few_points_tell_no_water_and_say_so(count: int, caplog: Any) -> None:
    points = lake(density=0.3).select(np.arange(count) * 5)
    found = extract(points, bodies="all")
    assert found.count == 0
    assert found.level is None
    assert f"only {count} take part, too few to tell water" in caplog.text
    assert "per m2" not in caplog.text  # so few do not tell how dense they are


def thinned(cloud: PointCloud, share: float, seed: int) -> PointCloud:
    return cloud.select(np.random.default_rng(seed).random(len(cloud)) < share)


@pytest.mark.parametrize("seed", range(4))
def test_hills_with_a_point_in_some_cells_are_no_water(
    seed: int, data: Callable[[str], Path], caplog: Any
) -> None:
    """Cells with a single point seemed dense: up to 39 000 m2 of hills were water in 17 bodies."""
    cloud = PointCloud.open(data("lidr_topography/Topography.laz"))
    assert extract(thinned(cloud, 0.02, seed), bodies="all").count == 0
    (area,) = re.findall(r"most below (\d+) m2, though the least area is 100 m2", caplog.text)
    assert 4000 < float(area) < 10_000  # points are 7 to 9 m apart


def test_few_cells_at_the_edge_of_sparse_data_are_no_water(data: Callable[[str], Path]) -> None:
    """One of 667 m2 was found, 17 m above the land around it."""
    cloud = PointCloud.open(data("lidr_topography/Topography.laz"))
    water = extract(thinned(cloud, 0.078, 102), bodies="all").water.frame
    assert len(water) == 2
    assert water["area"].min() > 2000


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_sea_dam_of_which_two_points_in_a_hundred_are_left(
    seed: int, data: Callable[[str], Path]
) -> None:
    cloud = PointCloud.open(data("water_denoever_ahn3/AHN3.laz")).with_crs(CRS(28992))
    whole, thin = (
        extract(one, bodies="all").water.frame for one in (cloud, thinned(cloud, 0.02, seed))
    )
    assert len(whole) == len(thin) == 2
    for k in range(2):
        assert iou(whole.geometry.iloc[k], thin.geometry.iloc[k]) > 0.88
        assert thin["level"].iloc[k] == pytest.approx(whole["level"].iloc[k], abs=0.02)


def test_a_wide_gap_beside_hills_is_no_lake(caplog: pytest.LogCaptureFixture) -> None:
    """A missing strip was a lake of 6 ha, with an interval of 175 m. One point on 12 m2."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform((0, 0), (900, 500), (36_000, 2)).T
    z = 280 + 100 * np.sin(x / 150) + 0.05 * (y - 250) + rng.normal(0, 0.05, len(x))
    seen = abs(y - 250 - 5 * np.sin(x / 90)) > 45
    xyz = np.column_stack([x, y, z])[seen] + (500_000, 5_000_000, 0)
    single = np.zeros(len(xyz), bool)
    points = PointCloud(xyz, columns(np.full(len(xyz), 500, np.uint16), single), crs=UTM)
    assert extract(points, bodies="all", sloped=True).count == 0
    assert "more than 25 m above their lowest shore: about" in caplog.text


@pytest.mark.parametrize(("wall", "count"), [(24.0, 1), (26.5, 0)])
def test_a_quarry_lake_with_a_beach_has_walls_that_are_lower_than_hillsides(
    wall: float, count: int
) -> None:
    """A lake of 1.1 ha that returns nothing; an eighth of its shore is a beach."""
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-150, 150, (180_000, 2)).T
    land = np.hypot(x, y) > 60
    beach = (abs(np.arctan2(y, x)) < np.pi / 8) & (np.hypot(x, y) < 65)
    z = np.where(beach, 100.1 + 0.2 * (np.hypot(x, y) - 60), 100 + wall) + rng.normal(
        0, 0.03, len(x)
    )
    xyz = np.column_stack([x, y, z])[land] + (500_000, 5_000_000, 0)
    single = np.zeros(len(xyz), bool)
    points = PointCloud(xyz, columns(np.full(len(xyz), 500, np.uint16), single), crs=UTM)
    assert extract(points, bodies="all").count == count


def test_what_is_not_seen_amid_a_river_tells_nothing_of_its_slopes() -> None:
    cells = grid(Returns.of(slope(rise=0.0), None, None))
    assert _drained(cells, np.zeros(0, np.int64)) == math.inf


def test_a_hole_is_held_by_dikes_that_are_narrower_than_cells() -> None:
    """Their lowest points are at the level of the water; holes had no height, and were left out."""
    cells = grid(Returns.of(slope(rise=0.0), None, None))
    for name in ("low", "high", "middle"):
        getattr(cells, name)[:] = 8.5
    dike, hole = np.s_[39:61, 39:61], np.s_[40:60, 40:60]
    cells.low[dike], cells.high[dike] = 10.0, 10.7
    cells.count[hole], cells.known[hole] = 0, 0
    cells.low[hole], cells.high[hole], cells.middle[hole] = math.inf, -math.inf, 10.0
    places = np.arange(cells.low.size).reshape(cells.low.shape)[hole].ravel()
    (body,) = Pour(cells, 100.0).on(places, 10.0, Tilt())
    assert (body.cells == places).all()


@pytest.mark.parametrize(("east", "told"), [(92.0, True), (78.0, False), (110.0, False)])
def test_holes_that_are_no_water_are_told_beside_water(
    east: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """They were told only where there was no water at all; not so narrow ones, and open ones."""
    points = lake(centre=(35.0, 35.0))
    x, y = (points.xyz - ORIGIN)[:, :2].T
    hole = (x > 75) & (x < east) & (abs(y - 83) < 8)
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert extract(points.select(~hole), bodies="all").count == 1
    assert ("holes of the data of at least 101 m2 that do not count" in caplog.text) is told
    assert ("500086.8,4600083.1, refused because water would run off" in caplog.text) is told


@pytest.mark.parametrize("seed", [100, 108])
def test_flat_ponds_of_few_cells_have_no_shape(seed: int) -> None:
    """Medians of cells that share their heights bend: 7 of 40 ponds at 2 points/m2 were paved."""
    made = scene("reservoir", size=200.0, density=2.0, seed=seed)
    points = PointCloud(made.xyz, made.attributes, crs=CRS(32635))
    shapes = shapely.force_2d(extract(points, bodies="all").water.frame.geometry.to_numpy())
    true = [shapely.force_2d(shape) for shape, _ in made.features]
    assert min(max(iou(one, s) for s in shapes) for one in true if one.area >= 100) > 0.9


@pytest.mark.parametrize(("rise", "wet"), [(0.0, True), (0.003, False)])
def test_a_small_very_dark_place_that_falls_is_paved(rise: float, wet: bool) -> None:
    """20 x 15 m in a hollow, of 75 cells of points with a noise of 2 cm; it returns all pulses."""
    rng = np.random.default_rng(1)
    xy = rng.uniform(0, 100, (20000, 2))
    away = np.max(abs(xy - 50) - (10.0, 7.5), axis=1)
    z = np.where(away < 0, rise * (xy[:, 0] - 50), 0.5 + 0.2 * away) + rng.normal(0, 0.02, len(xy))
    intensity = rng.lognormal(np.where(away < 0, 5.0, 7.0), 0.2).astype(np.uint16)
    xyz = np.round(np.column_stack([xy, z]), 3) + ORIGIN
    points = PointCloud(xyz, columns(intensity, np.zeros(len(xy), bool)), crs=UTM, name="paved.laz")
    assert (extract(points, bodies="all").count == 1) is wet


@pytest.mark.parametrize("near", [2.0, 7.0])
def test_a_gap_on_the_bank_of_a_lake_does_not_take_it_away(
    near: float, caplog: pytest.LogCaptureFixture
) -> None:
    """A gap of 16 x 36 m was a river that fell by 20 %, ran into the lake, and was left out."""
    points = lake(centre=(35.0, 35.0))
    x, y = (points.xyz - ORIGIN)[:, :2].T
    gap = (x > 65 + near) & (x < 81 + near) & (abs(y - 35) < 18)
    with caplog.at_level(logging.WARNING, "toolbox"):
        whole, found = (only(extract(some, bodies="all")) for some in (points, points.select(~gap)))
    assert iou(whole.geometry, found.geometry) > 0.998
    assert found.level == pytest.approx(whole.level, abs=0.002)
    told = re.findall(r"left out: 1; .*: about ([0-9]+) m2 at ([0-9.]+),([0-9.]+)", caplog.text)
    area, east, north = (float(v) for v in told[0])
    assert 500 < area < 800  # with the edge of the ground below
    assert abs(east - ORIGIN[0] - 73 - near) < 8
    assert abs(north - ORIGIN[1] - 35) < 18


@pytest.mark.parametrize("seed", [691, 720])
def test_basins_are_no_higher_than_what_is_seen_of_the_walls_around_them(seed: int) -> None:
    """All that is frequent beside them is land: one was 1.26 m too high, +- 0.009 m, three lost."""
    made = waters.survey("lock", seed)
    found, water = scored(made)
    assert min(found) > 0.95
    levels = water.sort_values("level", ascending=False)
    for known, (_, basin) in zip(made.waters, levels.iterrows(), strict=True):
        assert abs(basin.level - known.level) <= basin.level_interval


def test_a_hole_outside_of_all_points_holds_no_water_and_does_not_stop_the_run() -> None:
    """South of a corridor that bends; water that was poured there stopped the run."""
    made = scene("power_lines", size=300, density=1.5, seed=901)
    points = PointCloud(made.xyz, made.attributes, crs=CRS(32635))
    assert extract(points, bodies="all", sloped=True).count == 0


def score(kind_seed: int, size: float, density: float) -> list[tuple[float, float, int, int]]:
    """IoU, error of the level, islands found and true, of each body of a synthetic reservoir."""
    made = scene("reservoir", size=size, density=density, seed=kind_seed)
    points = PointCloud(made.xyz, made.attributes, crs=CRS(32635))
    water = extract(points, bodies="all").water.frame
    found = []
    for shape, known in made.features:
        truth = shapely.force_2d(shape)
        if truth.area < 100:
            continue
        shared = [truth.intersection(g).area for g in water.geometry]
        best = int(np.argmax(shared))
        row = water.iloc[best]
        islands = sum(shapely.Polygon(ring).area > 20 for ring in truth.interiors)
        found.append(
            (iou(truth, row.geometry), row["level"] - known["level"], row.islands, islands)
        )
    assert len(water) == len(found)
    return found


def test_a_reservoir_with_reeds_islands_and_ponds() -> None:
    lake_, *ponds = score(2, 300, 4)
    assert lake_[0] > 0.985
    assert all(pond[0] > 0.92 for pond in ponds)
    for _, error, islands, truth in (lake_, *ponds):
        assert abs(error) < 0.01
        assert islands == truth


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 120))
@pytest.mark.parametrize(("density", "bar"), [(8.0, 0.985), (2.0, 0.97)])
def test_twenty_reservoirs(seed: int, density: float, bar: float) -> None:
    """No pond is joined or lost, and no island."""
    lake_, *ponds = score(seed, 400, density)
    assert lake_[0] > bar
    assert len(ponds) == 2
    for _, error, islands, truth in (lake_, *ponds):
        assert abs(error) < 0.01
        assert islands == truth


@pytest.mark.slow
def test_a_sea_dam_without_its_classes(data: Callable[[str], Path]) -> None:
    cloud = PointCloud.open(data("water_denoever_ahn3/AHN3.laz")).with_crs(CRS(28992))
    water = shapely.union_all(extract(cloud, bodies="all").water.frame.geometry.to_numpy())
    shapely.prepare(water)
    place, of = np.unique(np.floor(cloud.xyz[:, :2]), axis=0, return_inverse=True)
    truth = np.bincount(of.ravel(), cloud["classification"] == 9) > 0
    ours = shapely.contains_xy(water, place + 0.5)
    assert (ours & truth).sum() / (ours | truth).sum() > 0.96


def test_level_ground_at_the_level_of_a_field_far_off_is_no_water() -> None:
    """Two places of 0.06 ha at the level of the ninth field, beside others at their own."""
    made = waters.survey("rice_wet", 746)
    found, water = scored(made)
    assert min(found) > 0.97
    assert len(water) == len(made.waters)


def test_lakes_in_a_forest_that_are_as_bright_as_land(data: Callable[[str], Path]) -> None:
    cloud = PointCloud.open(data("lidr_topography/Topography.laz"))
    water = extract(cloud, bodies="all").water.frame
    assert len(water) == 5
    assert "level, that of other water" in list(water["evidence"])  # as bright, and no pulse lost
    at_lake = water[abs(water["level"] - 805.8) < 0.03]
    assert len(at_lake) == 2
    assert "dark" not in at_lake.iloc[0].evidence
    # No outline goes over the bank: points on it lie no farther inside than the next point does.
    x, y, z = cloud.xyz[cloud["classification"] == 2].T
    for shape, level in zip(water.geometry, water["level"], strict=True):
        flat = shapely.force_2d(shape)
        dry = shapely.points(x, y)[shapely.contains_xy(flat, x, y) & (z > level + 0.3)]
        inside = shapely.distance(dry, flat.boundary)
        assert inside.max(initial=0.0) * math.sqrt(water["density"].iloc[0]) < 1.0


def test_what_is_lowest_on_a_steep_rough_bank_stands_on_it() -> None:
    """Rejected as plants, all of a bank, the outline went over it: IoU 0.797 of the last pond."""
    found, _ = scored(waters.survey("ponds", 722))
    assert min(found) > 0.95


def scored(made: waters.Survey, **settings: Any) -> tuple[list[float], Any]:
    """IoU of each true body with the best of those found, and the layer of these."""
    water = extract(made.points, bodies="all", sloped=True, **settings).water.frame
    shapes = shapely.force_2d(water.geometry.to_numpy())
    return [max((iou(truth, s) for s in shapes), default=0.0) for truth in made.outlines], water


@pytest.mark.parametrize("kind", ["reeds", "trees"])
def test_waves_longer_than_cells_are_water(kind: str) -> None:
    """All pulses come back, from waves of 18 m: levels of neighbouring cells differ."""
    made = waters.survey(kind, 0, density=3.0, returned=1.0, noise=0.1, swell=18.0)
    found, water = scored(made)
    assert found[0] > 0.9
    assert len(water) == 1


def test_water_runs_off_to_lower_water_beside_it() -> None:
    """A plain at 4 m around a pool at 0 m; one at 3.5 m may be below a weir."""
    plain = np.full((7, 7), 4.0, np.float32)
    state = np.zeros((7, 7), np.uint8)
    state[2:5, 2:5] = TAKEN
    for pool, lower in ((0.0, 1), (3.5, 0)):
        middle, found = plain.copy(), state.copy()
        middle[2:5, 2:5] = pool
        stack = np.zeros(49, np.int32)
        over = plain, plain, np.float32(np.inf), middle, 4.1, 3.75, 3.0, 0
        _, met = spread(*over, np.array([0]), found, stack)
        assert (met > 0) == lower


def test_points_above_a_dike_hold_water_in_cells_that_are_as_wide() -> None:
    low, high = np.zeros((2, 5, 7), np.float32)
    high[:, 3] = 1.0
    for dike, reached in ((0.5, 15), (np.inf, 35)):
        state, stack = np.zeros((5, 7), np.uint8), np.zeros(35, np.int32)
        over = low, high, np.float32(dike), low, 0.1, -0.25, -1.0, 0
        assert spread(*over, np.array([0]), state, stack) == (reached, 0)


def test_land_around_a_pit_lake_is_no_water() -> None:
    for seed in range(2):
        found, water = scored(waters.survey("plain", seed), level_alone=True)
        assert found[0] > 0.97
        assert len(water) == 1


@pytest.mark.parametrize(
    "made", [waters.crowned, waters.cutting, waters.rice_dry, waters.bare_edge]
)
def test_what_is_known_by_its_level_alone_is_left_out_and_told(
    made: Callable[[waters.Land], None], caplog: Any
) -> None:
    dry = waters.survey(made.__name__, 0, density=3.0)
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert extract(dry.points, bodies="all").count == 0
    (count,) = re.findall(r"points: (\d+) level places are left out", caplog.text)
    places = re.findall(r"about \d+ m2 at [0-9.]+,[0-9.]+, level [0-9.]+ m", caplog.text)
    assert len(places) == int(count), "each with its level"
    assert "the setting level_alone gives such places" in caplog.text
    assert set(extract(dry.points, bodies="all", level_alone=True).water.frame["evidence"]) == {
        "level"
    }


@pytest.mark.parametrize(("returned", "count"), [(0.6, 1), (0.9, 0)])
def test_level_water_that_returns_fewer_pulses_than_land_is_found(
    returned: float, count: int, caplog: Any
) -> None:
    """A pool of a river of which 52 % of the pulses came back was left out: half was the limit."""
    bright = waters.survey("calm", 3, density=3.0, returned=returned, contrast=0.0)
    found = extract(bright.points, bodies="all")
    assert found.count == count
    if count:
        assert set(found.water.frame["evidence"]) == {"fewer returns, level"}
        assert any("fewer pulses alone: 1 of 1" in text for text in found.not_looked_at())
    else:
        assert "1 level places are left out" in caplog.text


@pytest.mark.parametrize("rise", [0.005, 0.02, 0.1])
@pytest.mark.parametrize("density", [1.0, 4.0])
def test_level_ground_that_one_flight_covers_beside_two_is_no_water(
    density: float, rise: float
) -> None:
    """It has fewer points than the ground beside it, but no banks: 0.6 to 1 ha were water."""
    points = floor(density=density, rise=rise)
    assert extract(points, bodies="all", sloped=True).count == 0
    assert extract(points, level_alone=True).area > 5000  # level it is


def pit(seed: int, *, returned: float = 1.0) -> PointCloud:
    """A pit with a level floor, along the gap between two flights where a third one is alone."""
    rng = np.random.default_rng(seed)
    density, depth = rng.choice([1.0, 3.0, 6.0]), rng.choice([0.6, 1.5, 4.0])
    west, wide, long = 120.0, rng.uniform(25, 60), rng.uniform(60, 180)
    xy = rng.uniform(0, 300, (rng.poisson(2 * density * 300**2), 2))
    other = rng.random(len(xy)) < 0.5
    kept = ~other | (xy[:, 0] < west) | (xy[:, 0] > west + wide)
    middle, half = np.array([west + wide / 2, 150]), np.array([wide + rng.uniform(-8, 4), long]) / 2
    outside = np.max(abs(xy - middle) - half, axis=1)
    rise = np.where(outside > 0, rng.choice([0.0, 0.01, 0.04]) * np.hypot(*(xy - middle).T), 0.0)
    z = np.clip(outside / 2, 0, depth) + rise + rng.normal(0, 0.03, len(xy))
    kept &= (outside > 0) | (rng.random(len(xy)) < returned)
    intensity = rng.normal(np.where(outside < 0, 280, 300), 50).clip(1).astype(np.uint16)[kept]
    attributes = columns(intensity, np.zeros(len(intensity), bool))
    attributes["point_source_id"] = (1 + other[kept]).astype(np.uint16)
    xyz = np.round(np.column_stack([xy, z])[kept], 3) + ORIGIN
    return PointCloud(xyz, attributes, crs=UTM, name="pit.laz")


@pytest.mark.parametrize("seed", [0, 5, 7])
def test_a_pit_that_one_flight_covers_beside_two_is_no_water(seed: int) -> None:
    """It has banks all around and half of their points: more than half of such were water."""
    assert extract(pit(seed), bodies="all", sloped=True).count == 0
    assert extract(pit(seed, returned=0.35), bodies="all").count == 1


def test_sizes_in_feet_are_those_of_tables_and_not_of_whole_metres(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The edge of 208.4 m, 684 ft in the table, was 682 ft in the text: those of 208 m."""
    rows = [{"body": 1, "open_length": 208.4, "perimeter": 1893.4}]
    said = in_both(open_edges(rows, FOOT), FOOT)
    assert "208 m (684 ft) of 1893 m (6212 ft) of its outline" in said
    cells: Any = SimpleNamespace(metre=1 / FOOT[1], own=FOOT)
    water: Any = SimpleNamespace(number=4, area=39231.5)
    monkeypatch.setattr(_water, "place_of", lambda *_: (1.0, 2.0))
    assert _water.name_of(cells, water) == "water body 4 (3645 m2 (39232 ft²), at 1.0,2.0)"


def test_waters_that_the_data_cut_are_told_in_one_line() -> None:
    rows = [
        {"body": k, "open_length": 10.0 * (k != 2), "perimeter": 90.0}
        for k in (1, 2, 3, 4, 5, 6, 7, 8)
    ]
    assert open_edges(rows) == (
        "7 water bodies meet the edge of the data, where their outlines are no shore: body 1, "
        "10 m of 90 m; body 3, 10 m of 90 m; body 4, 10 m of 90 m; body 5, 10 m of 90 m; body 6, "
        "10 m of 90 m; and 2 more"
    )
    assert open_edges(rows[1:2]) == ""
    both = [rows[0], {"body": 1, "open_length": 5.0, "perimeter": 20.0}]
    assert open_edges(both).startswith("water body 1: 15 m of 110 m of its outline"), "of two parts"


@pytest.mark.parametrize("shape", [(-1, 0), (0, 1), (0.7, 0.7)])
def test_a_dark_surface_that_bends_or_tilts_is_no_water(shape: tuple[float, float]) -> None:
    """It returns all pulses; strips of a survey fit to centimetres, so a lake may bend by one."""
    flat = lake(returned=1.0, noise=0.01)
    u, v = (flat.xyz[:, :2] - ORIGIN[:2] - 50).T / RADIUS
    wet = np.hypot(u, v) < 1
    bend = np.where(wet, shape[0] * (u**2 + v**2) + shape[1] * u, 0.0)
    found = [
        extract(flat.with_xyz(flat.xyz + np.outer(rise * bend, (0, 0, 1)))).count
        for rise in (0.008, 0.05)
    ]
    assert found == [1, 0]


def test_a_river_of_which_all_pulses_come_back_may_fall() -> None:
    row = only(extract(river(fall=0.0004, returned=1.0), sloped=True))
    assert row.area == pytest.approx(8000, rel=0.02)


def test_a_step_between_flights_bends_no_water() -> None:
    """All pulses come back from a dark lake, half of which was flown at a level 8 cm higher."""
    flat = lake(returned=1.0)
    later = (np.hypot(*(flat.xyz[:, :2] - ORIGIN[:2] - 50).T) < RADIUS) & (
        flat["x"] > ORIGIN[0] + 50
    )
    assert extract(flat.with_xyz(flat.xyz + np.outer(0.08 * later, (0, 0, 1)))).count == 1


def test_a_run_says_how_wide_waters_must_be(caplog: Any) -> None:
    """Cells hold four points of land, so they are 1 m wide; four of them are the least."""
    with caplog.at_level(logging.INFO, "toolbox"):
        extract(lake(density=4.0))
    (told,) = re.findall(r"narrower ones than (\d+\.\d) m may be missing", caplog.text)
    assert float(told) == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize(
    ("kind", "seed"),
    [("rice_wet", 300), ("fish_ponds", 105), ("days_unnamed", 105), ("river", 106)],
)
def test_waters_that_are_hard_to_tell_are_found(kind: str, seed: int) -> None:
    """Fields with water all around, dikes as wide as cells, two days, a river.

    The dikes lie between ponds whose levels differ by 3 cm; the river is dark and loses no pulses.
    """
    found, _ = scored(waters.survey(kind, seed))
    assert min(found) > 0.9


def test_waves_across_a_river_are_no_dikes() -> None:
    """Of 9 cm, they made three waters of it, whose levels differ as it falls by 6 cm."""
    (found,), water = scored(waters.survey("river", 101))
    assert found > 0.95
    assert len(water) == 1


def test_waves_hide_no_fall() -> None:
    """Waves of 18 cm, on a lake and on a river that falls by 40 cm from end to end."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, 1, (3000, 2)) * [200, 40]
    waves = 0.13 * rng.normal(0, 1, len(xy)) + 0.18 * np.sin(xy[:, 0] / 1.5)
    for fall, plane in ((0.4, True), (0.0, False)):
        assert is_plane(np.column_stack([xy, waves - fall * xy[:, 0] / 200])) is plane


def test_a_river_with_high_waves_is_not_laid_level() -> None:
    """It was, and ran over into a dry valley."""
    found, water = scored(waters.survey("river", 705))
    assert found[0] > 0.97
    assert len(water) == 1
    assert water.slope[0] == pytest.approx(0.002, abs=1e-4)


def test_waves_of_a_water_that_returns_nothing_are_not_known() -> None:
    assert _crest(np.array([np.nan, np.inf])) == 0.0


def test_a_hole_that_slopes_is_no_lake_though_a_few_cells_at_its_lower_end_are_level() -> None:
    """A river that returns nothing from 0.3 points per m2, and falls by 1.7 m."""
    made = waters.survey("river", 712)
    (found,), water = scored(made)
    assert found > 0.97
    assert abs(water.slope[0] - made.waters[0].fall) < 0.0003
    truth = made.waters[0].level - made.waters[0].fall * made.land.side / 2
    assert abs(water.level[0] - truth) < water.level_interval[0]


def test_holes_of_a_cell_or_a_row_are_measured_without_a_warning() -> None:
    """By rounding the variance across a slanted row of cells is below 0."""
    south = np.arange(7)
    assert not _along_a_line(np.array([3]), np.array([4]))
    for east in (np.full(7, 3), 2 * south, 3 * south, -7 * south):
        assert _along_a_line(south, east)
    assert not _along_a_line(*np.divmod(np.arange(25), 5))


@pytest.mark.parametrize("seed", [4, 5])
def test_fields_that_return_nothing_are_level_and_no_higher_than_their_banks(seed: int) -> None:
    """The bund of the terrace above is higher: neither a slope nor the bund is the water's."""
    made = waters.survey("rice_wet", seed, returned=0.0, density=4.0)
    water = extract(made.points, bodies="all", sloped=True).water.frame
    shapes = shapely.force_2d(water.geometry.to_numpy())
    for outline, known in zip(made.outlines, made.waters, strict=True):
        field = water.iloc[int(np.argmax(shapely.area(shapes & outline)))]
        assert field.slope == 0
        assert abs(field.level - known.level) < max(0.1, field.level_interval)


@pytest.mark.slow
def test_fields_on_terraces_are_found_and_ground_beside_them_is_none() -> None:
    """Nothing comes back from them, and the bund above each is higher than the one below.

    Ground of 0.2 ha at the edge is within the wide intervals of their levels, but at none of them.
    """
    made = waters.survey("rice_wet", 701)
    found, water = scored(made)
    assert min(found) > 0.9
    assert len(water) == len(made.waters)
    assert (abs(np.sort(water["level"]) - sorted(w.level for w in made.waters)) < 0.1).all()


def test_dikes_and_land_over_which_ponds_were_filled_are_no_reaches() -> None:
    """Seven bodies of 684 to 3230 m2 were cut from ponds that waves and wide cells had joined."""
    made = waters.survey("fish_ponds", 712)
    ponds = shapely.union_all([outline.buffer(6) for outline in made.outlines])
    _, water = scored(made)
    off = [one.difference(ponds).area / one.area for one in water.geometry]
    assert max(off) < 0.3


@pytest.mark.parametrize("seed", [407, 420])
def test_a_dark_road_in_a_cutting_is_no_river(seed: int) -> None:
    """One falls by 0.5 %, the other by 1.3 %, and its crown is 10 cm high."""
    assert not extract(waters.survey("road", seed).points, bodies="all", sloped=True).count


def test_leaves_that_lift_a_level_by_less_than_days_do_are_within_its_interval(caplog: Any) -> None:
    made = waters.survey("plants", 106)
    with caplog.at_level(logging.WARNING, "toolbox"):
        found = extract(made.points)
    assert abs(found.level - made.waters[0].level) <= found.level_interval
    assert "where most pulses come back" not in caplog.text


@pytest.mark.parametrize(("density", "told"), [(0.4, True), (4.0, False)])
def test_points_too_sparse_for_the_waters_asked_for_are_told(
    density: float, told: bool, caplog: Any
) -> None:
    with caplog.at_level(logging.WARNING, "toolbox"):
        extract(lake(density=density))
    assert ("though the least area is 100 m2" in caplog.text) == told


def test_who_points_at_ice_gets_it() -> None:
    made = waters.survey("ice", 0)
    spot = made.outlines[0].centroid
    found = extract(made.points, seed_point=Position(spot.x, spot.y))
    assert iou(only(found).geometry, made.outlines[0]) > 0.98
    assert extract(made.points).count == 0


def test_a_flat_dark_roof_is_no_water() -> None:
    assert scored(waters.survey("hall", 1))[1].empty


def test_cells_that_the_edge_of_the_data_cuts_lose_no_pulses() -> None:
    """A hollow of 148 m2 at the edge, whose cells hold half as many points for that alone."""
    assert len(scored(waters.survey("dim", 3))[1]) == 1


@pytest.mark.parametrize("kind", ["days", "days_unnamed"])
@pytest.mark.parametrize("apart", [0.08, 0.12, 0.2])
@pytest.mark.parametrize("mixed", [True, False])
def test_flights_on_two_days_are_one_lake(kind: str, apart: float, mixed: bool) -> None:
    made = waters.survey(
        kind, 2, density=4.0, noise=0.03, strips=(0.0, apart), mixed=mixed, returned=0.6
    )
    found, water = scored(made)
    assert found[0] > 0.95
    assert len(water) == 1


@pytest.mark.parametrize(("step", "upper"), [(0.2, 10.2), (0.35, None)])
def test_levels_farther_apart_than_of_two_days_are_two_waters(step: float, upper: Any) -> None:
    """The pools above and below a weir are no lake of two days."""
    rng = np.random.default_rng(6)
    xy = rng.uniform(0, 300, (20_000, 2))
    z = rng.normal(10.0, 0.03, len(xy)) + step * (xy[:, 0] > 180)
    level = Level(10.0, 0.001, 15.0, 0.03, 12_000, of_strip=((0, 10.0),))
    found = side_by_side(np.column_stack([xy, z]), level, 0.25, 1.0)
    assert (found.parts and found.parts.upper) == pytest.approx(upper, abs=0.005)
    assert (found == level) == (upper is None)


@pytest.mark.parametrize(("seed", "least"), [(734, 0.99), (735, 0.97), (808, 0.98)])
def test_a_lake_of_two_days_is_whole_though_one_level_is_found_first(
    seed: int, least: float, caplog: Any
) -> None:
    """Half of it was left out, or filled with the other's level: 0.09 m off, ± 0.005, unsaid."""
    made = waters.survey("days_unnamed", seed)
    low, high = sorted(made.waters[0].level + np.array(made.land.strips))
    with caplog.at_level(logging.WARNING, "toolbox"):
        found, water = scored(made)
    assert found[0] > least
    assert len(water) == 1
    assert water["level"][0] - water["level_interval"][0] < low
    assert water["level"][0] + water["level_interval"][0] > high
    assert "stands at two levels side by side" in caplog.text


def test_a_flat_bank_of_mud_is_no_water() -> None:
    """Within the noise of water only all points around tell mud from it: 3.6 % too large before."""
    made = waters.survey("mud", 1)
    _, water = scored(made)
    assert water["area"].iloc[0] == pytest.approx(made.outlines[0].area, rel=0.01)


@pytest.mark.parametrize(("kind", "seed"), [("waves", 0), ("dim", 0), ("islands", 0)])
def test_the_error_of_the_area_holds_what_all_of_the_shore_has_in_common(
    kind: str, seed: int
) -> None:
    """The areas were 4.6, 6.7 and 5.3 errors off as each 20 m of shore were taken by themselves."""
    made = waters.survey(kind, seed)
    _, water = scored(made)
    assert abs(water["area"].iloc[0] - made.outlines[0].area) < 2 * water["area_error"].iloc[0]


def test_bodies_do_not_overlap() -> None:
    """Flooded fields between bunds of a cell or two: their shores run close to one another."""
    _, water = scored(waters.survey("rice_wet", 2))
    shapes = list(shapely.force_2d(water.geometry.to_numpy()))
    assert len(shapes) == 9
    shared = [a.intersection(b).area for k, a in enumerate(shapes) for b in shapes[:k]]
    assert max(shared) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(("apart", "told"), [(0.0, False), (0.4, True)])
def test_a_part_of_a_lake_that_stands_higher_is_told(apart: float, told: bool, caplog: Any) -> None:
    """Of another day, or ice: its water would run off to the rest, and its edge is no shore."""
    made = waters.survey("calm", 5, strips=(0.0, apart), returned=0.5, density=2.0)
    with caplog.at_level(logging.WARNING, "toolbox"):
        extract(made.points, bodies="all")
    assert ("from which water would run off" in caplog.text) == told
    if told:
        (step,) = re.findall(r"([-+][0-9.]+) m from the water at", caplog.text)
        assert float(step) == pytest.approx(apart, abs=0.03)  # of cells, by their lowest points


@pytest.mark.parametrize(
    ("kind", "noise", "returned"), [("fish_ponds", 0.1, 0.15), ("lock", 0.12, 0.4)]
)
def test_waters_with_a_dike_or_a_wall_between_have_levels_of_their_own(
    kind: str, noise: float, returned: float
) -> None:
    """It is hardly wider than the cells in which water is looked for."""
    made = waters.survey(kind, 1, density=0.4, noise=noise, returned=returned)
    water = extract(made.points, bodies="all").water.frame
    for outline, known in zip(made.outlines, made.waters, strict=True):
        found = water.loc[shapely.area(shapely.intersection(water.geometry, outline)).argmax()]
        assert iou(outline, found.geometry) > 0.85
        assert abs(found.level - known.level) <= max(found.level_interval, 0.01)


@pytest.mark.parametrize(("kind", "told"), [("leaves", True), ("calm", False)])
def test_what_covers_a_water_is_told_and_within_its_interval(
    kind: str, told: bool, caplog: Any
) -> None:
    """Leaves return each pulse, and most points are on them."""
    made = waters.survey(kind, 1, density=0.6, noise=0.08, returned=0.3)
    with caplog.at_level(logging.WARNING, "toolbox"):
        found = extract(made.points)
    assert ("where most pulses come back" in caplog.text) == told
    assert abs(found.level - made.waters[0].level) <= min(found.level_interval, 0.02)


@pytest.mark.parametrize(("apart", "named"), [(0.12, False), (0.12, True), (0.0, False)])
def test_two_levels_of_unnamed_flights_are_told_and_within_the_interval(
    apart: float, named: bool, caplog: Any
) -> None:
    made = waters.survey(
        "calm", 5, strips=(0.0, apart), named=named, returned=0.5, density=2.0, noise=0.03
    )
    with caplog.at_level(logging.WARNING, "toolbox"):
        found = extract(made.points, bodies="all")
    told = "stands at two levels side by side" in caplog.text
    assert told == (apart > 0 and not named)
    assert (found.level_interval > 0.06) == (apart > 0)
    for level in made.waters[0].level + np.array([0.0, apart]):
        assert abs(level - found.level) <= max(found.level_interval, 0.005)


def test_a_seed_point_outside_of_the_points_is_told_before_the_work() -> None:
    with pytest.raises(DataError, match=r"seed_point: 1\.0,2\.0 is outside of"):
        ShorelineExtract(points=lake(), seed_point=Position(1.0, 2.0))


def test_only_of_the_bodies_that_are_given_out_is_warned(monkeypatch: pytest.MonkeyPatch) -> None:
    warned: list[int] = []
    monkeypatch.setattr(_water, "warn_of", lambda cells, some: warned.append(len(some)))
    points = waters.survey("ponds", 3, density=4.0, noise=0.03, returned=0.3).points
    count = extract(points, bodies="all").count
    extract(points, bodies="largest")
    assert count > 1
    assert warned == [count, 1]


def test_a_surface_that_falls_evenly_has_no_two_levels() -> None:
    """A step explains three quarters of a slope, nearly all of two levels."""
    rng = np.random.default_rng(6)
    xy = rng.uniform(0, 300, (20_000, 2))
    noise = rng.normal(0, 0.03, len(xy))
    for surface, parts in (
        (0.12 * xy[:, 0] / 300, None),
        (0.06 * np.sin(xy[:, 0] / 24), None),
        (0.12 * (xy @ [0.8, 0.6] > 200), pytest.approx((0.0, 0.12), abs=0.003)),
        (0.04 * (xy @ [0.8, 0.6] > 200), None),
    ):
        sides = _parts(np.column_stack([xy, surface + noise]), 1.0)
        assert (sides and (sides.lower, sides.upper)) == parts


def test_outlines_are_known_to_two_spacings_of_points_and_at_best_to_a_metre() -> None:
    for density, metre, detail in ((0.25, 1.0, 4.0), (100.0, 1.0, 1.0), (100.0, 0.001, 0.2)):
        cells: Any = SimpleNamespace(density=density, metre=metre)
        assert detail_of(cells) == pytest.approx(detail)


def test_a_median_of_counts_does_not_jump() -> None:
    """One of five or of six cells after the other changes by one point."""
    for many in (5, 6):
        of_fours = [np.where(np.arange(many) < fours, 4, 3) for fours in range(many + 1)]
        counts = [median_of_counts(some) for some in of_fours]
        assert (counts[0], counts[-1]) == (3, 4)
        assert 0 < np.diff(counts).min() <= np.diff(counts).max() < 0.34


@pytest.mark.parametrize("dark", [True, False])
def test_a_few_cells_do_not_make_a_water_of_bright_land_beside_them(dark: bool) -> None:
    """A hole of a few cells is water; the level land around it is, if that is dark or lost."""
    cells = grid(Returns.of(lake(returned=1.0, dark=dark), None, None))
    pour, level = Pour(cells, 100.0), Level(LEVEL, 0.01, 9.0, 0.02, 100)
    rows, cols = (np.abs(np.arange(n) - n // 2) <= 5 for n in cells.low.shape)
    hole = np.flatnonzero((rows[:, None] & cols).ravel())
    body = Body(hole, LEVEL, Tilt(), 0.1, 0.9, "few returns, dark")
    (found,) = pour.again(body, level, Tilt())
    assert (len(found.cells) > 10 * len(hole)) == dark


@pytest.mark.parametrize("seed", [2, 3])
def test_a_lake_below_crowns_that_returns_nothing_is_as_unsure_as_they_are_high(seed: int) -> None:
    """Its level was that of the lowest crowns, 2 m too high, with 0.17 m as its interval."""
    (water,) = extract(waters.survey("trees", seed, returned=0.0).points).water.frame.itertuples()
    assert 1.5 < water.level - 99.0 < water.level_interval < 4.0


@pytest.mark.parametrize("seed", [2, 13])
def test_a_river_of_pools_and_rapids_is_no_level_water(seed: int, caplog: Any) -> None:
    """It was a single level at the height of the upper pool, 0.6 m above the lower one."""
    made = waters.survey("rapids", seed, returned=0.05, density=1.0)
    with caplog.at_level(logging.WARNING, "toolbox"):
        water = extract(made.points, bodies="all", sloped=True).water.frame
    upper, lower = made.waters[0], made.waters[-1]
    for known in (upper, lower):
        outline = shapely.transform(known.shape, lambda xy: xy + ORIGIN_OF_SCENES)
        best = water.loc[shapely.area(shapely.intersection(water.geometry, outline)).argmax()]
        assert abs(best.level - known.level) < 0.1
    assert "waters at different levels meet" in caplog.text
    told = re.findall(r"([0-9.]+) m at [0-9.,]+, from ([0-9.]+) m down to ([0-9.]+) m", caplog.text)
    steps = [[float(number) for number in one] for one in told]
    assert max(height for height, _, _ in steps) > 0.3, "each step is told, with its levels"
    assert all(abs(high - low - height) < 0.011 for height, high, low in steps)


@pytest.mark.parametrize(("between", "told"), [(0, True), (6, True), (7, False)])
def test_steps_of_waters_are_told_that_no_water_can_lie_between(between: int, told: bool) -> None:
    """Larger steps across a dike of five cells were not told, beside a small one that was."""
    cells = grid(Returns.of(lake(returned=1.0), None, None))
    places = np.arange(cells.low.size).reshape(cells.low.shape)
    sides = (places[20:40, 10:20], places[20:40, 20 + between : 30 + between])
    waters_found = [
        Water(
            Body(side.ravel(), level, Tilt(), 0.1, 0.9, "few returns"),
            Level(level, 0.01, 9.0, 0.02, 100),
        )
        for side, level in zip(sides, (LEVEL, LEVEL + 0.4), strict=True)
    ]
    steps = list(_water._steps(cells, waters_found))
    assert [one.height for one in steps] == ([pytest.approx(0.4)] if told else [])


def test_ponds_far_from_one_another_have_no_step(caplog: Any) -> None:
    made = waters.survey("ponds", 3, density=4.0, noise=0.03, returned=0.3)
    with caplog.at_level(logging.WARNING, "toolbox"):
        extract(made.points, bodies="all")
    assert "waters at different levels meet" not in caplog.text


@pytest.mark.parametrize(("seed", "told"), [(42, True), (45, False)])
def test_a_river_without_returns_is_as_unsure_as_its_banks_say(
    seed: int, told: bool, caplog: Any
) -> None:
    """Pools of seed 42 were laid at the lowest, 0.5 m too low with an interval of 0.14 m."""
    kind = "rapids" if told else "river"
    made = waters.survey(kind, seed, returned=0.0, density=4.0)
    with caplog.at_level(logging.WARNING, "toolbox"):
        water = only(extract(made.points, bodies="all", sloped=True))
    highest = made.waters[0].level
    laid = shapely.get_coordinates(water.geometry, include_z=True)[:, 2].mean()
    if told:
        assert highest - laid > 0.3
        assert water.level_interval == pytest.approx(highest - laid, abs=0.05)
    assert ("the banks along a tenth of it or more tell levels" in caplog.text) is told
    assert "nothing came back" not in caplog.text, "a tenth of the pulses may"


def test_water_is_nowhere_above_the_banks_upstream_of_it() -> None:
    """A pool at 11 m, whose eastern end is below cliffs of 5 m, and one at 10 m."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 200, (2, 40_000)) * [[1], [0.15]]
    pool = np.where(x < 100, 11.0, 10.0)
    cliff = np.where((x > 60) & (x < 110), 5.0, 0.0)
    bank = abs(y - 15) > 5
    xyz = np.column_stack([x, y, pool + cliff])[bank]
    cells = grid(Returns.of(PointCloud(xyz, {}, crs=CRS(32635), name="banks"), None, None))
    xs, ys = cells.lattice.centres()
    rows, cols = np.nonzero((abs(ys - 15) < 5)[:, None] & np.ones(len(xs), bool))
    heights = along_banks(cells, rows * cells.lattice.cols + cols) + cells.base
    assert heights[xs[cols] < 50] == pytest.approx(11.0)
    assert heights[(xs[cols] > 75) & (xs[cols] < 98)] == pytest.approx(11.0)  # not the cliff
    assert heights[xs[cols] > 113] == pytest.approx(10.0)


def test_the_scatter_of_returns_holds_strips_and_parts_that_lie_apart() -> None:
    """It is at most half of what they differ by, as each return is of one of them."""
    level = Level(10.0, 0.01, 5.0, 0.03, 100)
    assert level.scatter == 0.03
    assert replace(level, strips=0.08).scatter == pytest.approx(0.05)
    assert replace(level, parts=Sides(9.98, 10.06, (1.0, 0.0), 0.0)).scatter == pytest.approx(0.05)
    assert replace(level, cover=(10.04, 9.98)).scatter == pytest.approx(0.05)
    assert math.isnan(replace(level, basis="shore").scatter), "no return tells it"


def test_covered_water_has_the_lower_level_and_an_interval_up_to_the_other() -> None:
    """A canal of which a part blinded the scanner stood 1.4 ft above its next reach."""
    level = Level(10.05, math.hypot(0.003, 0.35), 5.0, 0.03, 100, of_strip=((1, 10.05),))
    found = under_cover(replace(level, cover=(10.08, 9.7)), metre=1.0)
    assert found.height == 9.7
    assert found.interval == pytest.approx(0.38, abs=0.01)
    assert found.highest == 10.05, "the shore is where it was seen"
    assert found.scatter >= 0.38
    near = replace(level, cover=(10.06, 10.02))
    assert under_cover(near, metre=1.0) == near, "as flights on one day differ"


def test_land_at_the_level_of_a_lake_far_off_does_not_hide_it() -> None:
    """A hollow behind its bank is at its level, too, from where water would run off."""
    made = waters.survey("reeds", 752)
    water = only(extract(made.points, bodies="all"))
    assert water.level == pytest.approx(made.waters[0].level, abs=water.level_interval)


def square(wall: float, sunk: float = 0.0) -> PointCloud:
    """A dark and level square of 28 m, a wall of 12 m around it, and land at its level beyond.

    Parameters
    ----------
    wall : its height, m
    sunk : how much lower the square is, m
    """
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 100, (2, 20_000))
    away = np.maximum(abs(x - 50), abs(y - 50))
    z = np.where(away < 26, 100 + wall, 99.4 + 0.01 * x)
    z = np.where(away < 14, 100 - sunk, z) + rng.normal(0, 0.02, len(x))
    intensity = rng.normal(np.where(away < 14, 200, 1000), 60).astype(np.uint16)
    xyz = np.round(np.column_stack([x, y, z]), 3) + ORIGIN
    return PointCloud(xyz, columns(intensity, np.zeros(len(x), bool)), crs=UTM, name="square")


def test_a_square_among_houses_is_as_low_as_the_street_behind_them(caplog: Any) -> None:
    """In a French town one of 470 m2 was water: level, and darker than the roofs around it."""
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert extract(square(wall=8.0)).count == 0
    assert "level places are left out, as nothing else tells of water there" in caplog.text


@pytest.mark.parametrize(("wall", "sunk"), [(8.0, 1.0), (0.3, 0.0)])
def test_a_pool_among_houses_and_a_flooded_field_among_dry_ones_are_water(
    wall: float, sunk: float
) -> None:
    """The one is lower than the streets around; between the others is a bund, and no wall."""
    assert only(extract(square(wall, sunk))).geometry.area == pytest.approx(28**2, rel=0.1)


def test_the_level_ground_of_a_wood_is_darker_than_fields_but_no_water() -> None:
    """Crowns take their share of each pulse. One of 703 m2 had been water beside flooded fields."""
    made = waters.survey("rice_wet", 21)
    water = extract(made.points, bodies="all").water.frame
    true = shapely.union_all(list(made.outlines))
    assert len(water) == len(made.outlines)
    assert shapely.area(shapely.difference(water.geometry, true)).max() < 100
