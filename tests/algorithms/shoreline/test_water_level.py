"""shoreline.water_level: known levels under errors below and banks above."""

from __future__ import annotations

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS
from scenes import waters
from scenes.lakes import LEVEL, ORIGIN, RADIUS, lake, river, slope

from algorithms.samples.scene import scene
from algorithms.shoreline._level import edge_level, even_blocks, level_of, lowest_mode, mode
from algorithms.shoreline.extract import ShorelineExtract
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
    assert found.level_interval is not None
    assert found.level_interval > 1.96 * found.level_error


@pytest.mark.parametrize(
    ("noise", "density"), [(0.02, 0.5), (0.01, 8.0), (0.08, 2.0), (0.12, 2.0), (0.15, 8.0)]
)
def test_level_of_rough_water_is_not_biased(noise: float, density: float) -> None:
    """Scenes of other seeds than those that anything was chosen on."""
    ratio, intervals = [], []
    for seed in range(700, 706):
        made = scene("reservoir", size=200, density=density, seed=seed, water_noise=noise)
        points = PointCloud(made.xyz, made.attributes, crs=CRS(32635))
        row = ShorelineWaterLevel(points=points).run().levels.rows()[0]
        assert row["area"] > 3000
        intervals.append(row["interval"])
        ratio.append((row["level"] - 500.0) / row["standard_error"])
    assert np.median(intervals) < 0.4 * noise
    assert abs(np.mean(ratio)) < 3 / np.sqrt(len(ratio))
    assert max(map(abs, ratio)) < 4.5


def test_water_of_15_cm_that_loses_no_pulses_is_found() -> None:
    found = ShorelineWaterLevel(points=lake(noise=0.15, returned=0.7)).run()
    assert found.level == pytest.approx(LEVEL, abs=0.02)


def test_both_tools_tell_the_same_level() -> None:
    cloud = lake(noise=0.08)
    one, other = ShorelineWaterLevel(points=cloud).run(), ShorelineExtract(points=cloud).run()
    assert (one.level, one.level_error) == (other.level, other.level_error)
    assert one.level_interval == other.level_interval


def test_strips_that_differ_make_the_level_less_sure() -> None:
    cloud = lake(returned=0.3)
    east = cloud["x"] > ORIGIN[0] + 50
    strips = {"point_source_id": np.where(east, 2, 1).astype(np.uint16)}
    shifted = cloud.with_xyz(cloud.xyz + np.where(east, 0.05, 0.0)[:, None] * (0, 0, 1))
    same, apart, unknown = (
        ShorelineWaterLevel(points=points).run().levels.rows()[0]
        for points in (cloud.with_attributes(strips), shifted.with_attributes(strips), shifted)
    )
    assert same["strip_difference"] < 0.005
    assert apart["strip_difference"] == pytest.approx(0.05, abs=0.005)
    assert apart["standard_error"] == pytest.approx(0.025, abs=0.005)
    assert same["interval"] < unknown["interval"] < 0.1 * apart["interval"]


def test_the_level_of_each_day_is_told(caplog: pytest.LogCaptureFixture) -> None:
    made = waters.survey("days", 2, density=4.0, noise=0.03, strips=(0.0, 0.12), mixed=False)
    (row,) = ShorelineWaterLevel(points=made.points).run().levels.rows()
    days = dict(pair.split(": ") for pair in row["strip_levels"].split(", "))
    assert float(days["1"]) == pytest.approx(99.0, abs=0.01)
    assert float(days["2"]) == pytest.approx(99.12, abs=0.01)
    assert row["fall"] == 0
    assert f"other levels in other strips: {row['strip_levels']}" in caplog.text


def test_both_levels_of_a_known_lake_are_told(caplog: pytest.LogCaptureFixture) -> None:
    """Half of it lay 0.19 m higher, and the level of the other half was given, ± 0.012 m."""
    made = waters.survey("days_unnamed", 735)
    known = Vector(geopandas.GeoDataFrame(geometry=made.outlines, crs=waters.UTM))
    with caplog.at_level("WARNING", "toolbox"):
        found = ShorelineWaterLevel(points=made.points, water=known).run()
    assert found.level is not None
    assert found.level_interval is not None
    for level in made.waters[0].level + np.array(made.land.strips):
        assert abs(found.level - level) < found.level_interval
    assert "water body 1 (" in caplog.text
    assert "stands at two levels side by side" in caplog.text


def test_ice_is_left_out_unless_it_is_asked_for() -> None:
    points = waters.survey("ice", 0).points
    assert ShorelineWaterLevel(points=points).run().level is None
    found = ShorelineWaterLevel(points=points, level_alone=True).run()
    assert found.level == pytest.approx(99.0, abs=0.005)


@pytest.mark.parametrize("step", [0.05, 0.1, 0.25])
def test_rounded_heights_make_the_level_less_sure(step: float) -> None:
    """The noise of 2 cm does not average their rounding out, and the interval holds the truth."""
    for level in LEVEL + np.linspace(0.0, 0.9, 4) * step:
        cloud = lake(level=level)
        rounded = cloud.xyz.copy()
        rounded[:, 2] = np.round(rounded[:, 2] / step) * step
        found = ShorelineWaterLevel(points=cloud.with_xyz(rounded)).run()
        assert found.level is not None
        assert found.level_interval is not None
        assert abs(found.level - level) <= found.level_interval < step


def test_noise_averages_the_rounding_of_heights_out() -> None:
    rng = np.random.default_rng(0)
    for noise, error in ((0.001, 0.1 / np.sqrt(12)), (0.1, 0.0)):
        xyz = np.column_stack([rng.uniform(0, 100, (4000, 2)), rng.normal(0.03, noise, 4000)])
        xyz[:, 2] = xyz[:, 2].round(1)
        yes = np.ones(4000, bool)
        told, plain = (level_of(xyz, yes * 0, yes, 0.0, 1.0, step) for step in (0.1, 0.0))
        assert told.error == pytest.approx(np.hypot(plain.error, error), rel=0.01)


def test_water_does_not_run_off_across_the_edge_of_the_data() -> None:
    """Two waters with a dam between, which the survey leaves before its end, turned on the map."""
    rng = np.random.default_rng(2)
    xy = rng.uniform((0, 0), (200, 120), (96_000, 2))
    x, y = xy.T
    wet, dam = (y < 100) & (abs(x - 140) > 10), abs(x - 140) <= 10
    z = np.select([y >= 100, dam, x < 140], [1.5, 2.0, 0.0], -0.8) + rng.normal(0, 0.02, len(x))
    kept = (~wet | (rng.random(len(x)) < 0.1)) & ((abs(x - 130) > 55) | (y > 25))
    for turn in np.radians([0, 45, 60]):
        c, s = np.cos(turn), np.sin(turn)
        xyz = np.column_stack([c * x - s * y, s * x + c * y, z])[kept]
        rows = ShorelineWaterLevel(points=PointCloud(xyz, crs=CRS(32635))).run().levels.rows()
        assert sorted(row["level"] for row in rows) == pytest.approx([-0.8, 0.0], abs=0.02)
        assert min(row["area"] for row in rows) > 3000


def test_a_gap_in_the_data_is_told_from_a_lake(caplog: pytest.LogCaptureFixture) -> None:
    rng = np.random.default_rng(3)
    xy = rng.uniform(0, 100, (40_000, 2))
    xy = xy[np.hypot(*(xy - 50).T) > 25]
    x, y = abs(xy - 50).T
    valley = np.column_stack([xy, 0.5 * np.maximum(x - 10, 0) + 0.1 * np.maximum(y - 20, 0)])
    ShorelineWaterLevel(points=PointCloud(valley, crs=CRS(32635))).run()
    assert "it may be a gap of the data" in caplog.text
    caplog.clear()
    ShorelineWaterLevel(points=lake(returned=0.0)).run()
    assert "gap" not in caplog.text


def test_error_of_long_waves_is_that_of_blocks() -> None:
    """Waves of 15 m on 100 m of water: neighbouring points are wrong together."""
    rng = np.random.default_rng(1)
    levels = []
    for phase in rng.uniform(0, 2 * np.pi, 40):
        xyz = np.column_stack([rng.uniform(0, 100, (4000, 2)), rng.normal(0, 0.01, 4000)])
        xyz[:, 2] += 0.05 * np.sin(xyz[:, 0] / 15 + phase)
        levels.append(level_of(xyz, np.zeros(4000, int), np.ones(4000, bool), 0.0, 1.0))
    held = np.mean([abs(level.height) <= level.interval for level in levels])
    assert held > 0.85
    assert np.median([level.error for level in levels]) > 5 * 0.037 / np.sqrt(4000)


def held(lakes: list[tuple[np.ndarray, np.ndarray]]) -> float:
    """Share of lakes at 0 m, from points and their strips, whose intervals hold it."""
    levels = [level_of(xyz, strip, np.ones(len(xyz), bool), 0.0, 1.0) for xyz, strip in lakes]
    return float(np.mean([abs(level.height) <= level.interval for level in levels]))


def noisy(rng: np.random.Generator, count: int, noise: float) -> np.ndarray:
    return np.column_stack([rng.uniform(0, 50, (count, 2)), rng.normal(0, noise, count)])


def test_error_is_that_of_blocks_less_a_degree_of_freedom_for_each_strip() -> None:
    """Of a mean within three standard deviations, each block moves by 0.973 of what it should."""
    xyz = noisy(np.random.default_rng(5), 192, 0.05)
    xyz[:, 2] = np.clip(xyz[:, 2], -0.1, 0.1)
    one = level_of(xyz, np.zeros(192, int), np.ones(192, bool), 0.0, 1.0)
    means = [xyz[some, 2].mean() for some in even_blocks(xyz[:, :2])]
    assert one.freedom == 15
    assert one.error == pytest.approx(np.std(means, ddof=1) / 4 / 0.9734, rel=1e-3)
    halves = np.argsort(np.argsort(xyz[:, 0])) // 96
    for k in (0, 1):
        xyz[halves == k, 2] -= xyz[halves == k, 2].mean()
    two = level_of(xyz, halves, np.ones(192, bool), 0.0, 1.0)
    assert two.freedom == 14


def test_intervals_hold() -> None:
    rng = np.random.default_rng(5)
    lakes = [(noisy(rng, 200, 0.05), np.zeros(200, int)) for _ in range(1000)]
    assert held(lakes) == pytest.approx(0.95, abs=0.015)


def test_intervals_of_few_points_hold() -> None:
    """The median deviation of few points is too small, and more so when points beyond it go."""
    rng = np.random.default_rng(6)
    lakes = [(noisy(rng, 12, 0.05), np.zeros(12, int)) for _ in range(2000)]
    assert held(lakes) > 0.915


def test_shifts_of_strips_that_are_nearly_alike_count() -> None:
    rng = np.random.default_rng(7)
    lakes = []
    for shifts in rng.normal(0, 0.03, (1000, 2)):
        xyz, strip = noisy(rng, 300, 0.05), np.repeat((0, 1), 150)
        xyz[:, 2] += shifts[strip]
        lakes.append((xyz, strip))
    assert held(lakes) > 0.83


def test_a_strip_that_is_far_off_is_not_left_out() -> None:
    """Twelve centimetres are six standard deviations of the points of the other strip."""
    xyz, strip = noisy(np.random.default_rng(8), 400, 0.02), (np.arange(400) % 4 == 0).astype(int)
    xyz[:, 2] += 0.12 * strip
    level = level_of(xyz, strip, np.ones(400, bool), 0.0, 1.0)
    assert level.strips == pytest.approx(0.12, abs=0.01)
    assert level.height == pytest.approx(0.03, abs=0.005)
    assert level.interval > 0.12


def nobody(xyz: np.ndarray) -> np.ndarray:
    """False for all points: none lies within the body."""
    return np.zeros(len(xyz), bool)


def test_waves_at_the_shore_widen_the_interval() -> None:
    """Eight returns from waves of 0.1 m among those of a bank: the heights begin in a trough."""
    rng = np.random.default_rng(9)
    ratios = []
    for _ in range(200):
        z = np.concatenate([rng.normal(0, 0.1, 8), rng.uniform(0, 0.4, 14)])
        xyz = np.column_stack([rng.uniform(0, 10, (len(z), 2)), z])
        level = edge_level(xyz, nobody(xyz), float(np.quantile(z, 0.1)), 1.0)
        ratios.append(abs(level.height) / level.interval)
    assert np.mean(np.array(ratios) <= 1) > 0.93


def rough_lake_with_islands(*, dark: bool) -> ShorelineWaterLevel.Outputs:
    made = scene("reservoir", size=100, density=0.5, seed=6091, water_noise=0.15)
    columns = dict(made.attributes)
    if not dark:
        columns["intensity"] = np.zeros_like(columns["intensity"])
    points = PointCloud(made.xyz, columns, crs=CRS(32635))
    return ShorelineWaterLevel(points=points).run()


def test_a_ledge_above_the_water_is_not_taken_for_its_shore() -> None:
    """Three sides of a pond are banks from its level on; most points lie on the fourth."""
    rng = np.random.default_rng(1)
    ledge, bank = rng.normal(0.25, 0.02, 400), rng.uniform(0, 0.6, 300)
    xyz = np.column_stack([np.zeros((700, 2)), np.concatenate([ledge, bank])])
    level = edge_level(xyz, nobody(xyz), 0.25, 1.0)
    assert level.height > 0.15
    assert abs(level.height) <= level.interval


@pytest.mark.parametrize("ledge", [0.5, 0.7])
def test_water_does_not_stand_above_ground_that_is_seen_in_it(ledge: float) -> None:
    """Poured up to a bund all round, whose inner bank has a tenth of the points."""
    rng = np.random.default_rng(2)
    bund, bank = rng.normal(ledge, 0.02, 540), rng.uniform(0, ledge, 60)
    xyz = np.column_stack([np.zeros((600, 2)), np.concatenate([bund, bank])])
    amid = np.arange(600) >= 540
    level = edge_level(xyz, amid, ledge, 1.0)
    assert abs(level.height) < 0.15
    assert abs(level.height) <= level.interval
    assert edge_level(xyz, nobody(xyz), ledge, 1.0).height > ledge - 0.1


def test_small_islands_are_told_from_waves_by_brightness(caplog: pytest.LogCaptureFixture) -> None:
    """Islands of a cell or two and waves of 0.15 m: by their heights alone 0.26 m too high."""
    row = rough_lake_with_islands(dark=True).levels.rows()[0]
    assert abs(row["level"] - 500.0) < 0.06
    assert abs(row["level"] - 500.0) < row["interval"]
    assert "cannot be told from waves" not in caplog.text


def test_islands_that_nothing_tells_from_waves_are_warned_of(
    caplog: pytest.LogCaptureFixture,
) -> None:
    row = rough_lake_with_islands(dark=False).levels.rows()[0]
    assert abs(row["level"] - 500.0) < row["interval"]
    assert "islands of a cell or two cannot be told from waves" in caplog.text


def test_blocks_are_compact_and_hold_equally_many() -> None:
    xy = np.random.default_rng(0).uniform(0, (200, 50), (1000, 2))
    blocks = even_blocks(xy)
    assert sorted(np.concatenate(blocks)) == list(range(1000))
    assert {len(some) for some in blocks} == {62, 63}
    assert max(np.ptp(xy[some], axis=0).max() for some in blocks) < 40
    assert len(even_blocks(xy[:6])) == 4


def test_points_that_scatter_more_than_water_tell_no_level() -> None:
    rng = np.random.default_rng(0)
    xyz = np.column_stack([rng.uniform(0, 50, (500, 2)), rng.uniform(-1, 1, 500)])
    level = level_of(xyz, np.zeros(500, int), np.ones(500, bool), 0.0, 1.0)
    assert level.error == pytest.approx(0.25)


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
    row = found.levels.rows()[0]
    assert row["basis"] == "shore"
    assert abs(row["level"] - LEVEL) < row["interval"]


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


def test_no_water_tells_what_was_looked_for(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", logger="toolbox")
    found = ShorelineWaterLevel(points=slope()).run()
    assert found.level is None
    assert len(found.levels) == 0
    assert "no water was found of at least 100 m2; the largest place like that" in caplog.text
    assert "name the class (water_classes)" in caplog.text
    (warned,) = [one.getMessage() for one in caplog.records if one.levelname == "WARNING"]
    assert "is none: " in warned
    assert len(warned) < 200, "it stands in reports of land without water"


def test_modes() -> None:
    heights = np.array([1.0, 1.01, 1.02, 5.0, 5.01, 5.02, 5.03, -3.0])
    assert mode(heights, 0.1) == pytest.approx(5.015)
    assert lowest_mode(heights, 0.1) == pytest.approx(1.01)
    assert lowest_mode(np.array([3.0, 1.0]), 0.1) == 1.0


def test_level_ignores_what_is_above_and_below() -> None:
    rng = np.random.default_rng(0)
    z = np.concatenate([rng.normal(7, 0.03, 5000), rng.uniform(2, 7, 50), rng.uniform(7, 9, 1000)])
    xyz = np.column_stack([rng.uniform(0, 100, (len(z), 2)), z])
    level = level_of(xyz, np.zeros(len(z), int), np.ones(len(z), bool), 7.1, 1.0)
    assert level.height == pytest.approx(7.0, abs=0.003)
    assert level.sigma == pytest.approx(0.03, rel=0.2)
