"""classify.buildings: known roofs, trees and bridges, outlines, heights, tiles, bad input."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from shapely import MultiPoint
from shapely.affinity import rotate

from algorithms.classify._bridges import between_ends
from algorithms.classify._crowns import crowns
from algorithms.classify._density import Lengths
from algorithms.classify._doubtful_heights import warn_of_doubtful_heights
from algorithms.classify._evidence import PointFeatures
from algorithms.classify._outlines import TOUCHING, margin, within_data
from algorithms.classify._refused import warn_of_lost
from algorithms.classify._squared import main_direction, squared
from algorithms.classify.buildings import ClassifyBuildings, confidences, on_planes
from algorithms.compare.areas import CompareAreas
from algorithms.ground.classify import GroundClassify
from algorithms.samples.scene import SamplesScene
from algorithms.shared.alpha_shape import alpha_shape
from toolbox.data import PointCloud, Vector
from toolbox.errors import DataError, NothingToDo, ParameterError

Floats = NDArray[np.float64]
UTM = CRS(32635)


def village(
    density: float = 8.0, *, seed: int = 0, several: bool = True, unit: float = 1.0
) -> PointCloud:
    """60 x 40 m of gentle slope: a gabled house, a flat shed of 9 m2, a tree, a low wall, truth."""
    rng = np.random.default_rng(seed)
    n = int(60 * 40 * density)
    x, y = rng.uniform((0, 0), (60, 40), (n, 2)).T
    ground = 0.02 * x + 100
    z, truth = ground + rng.normal(0, 0.02, n), np.full(n, 2)
    house = (abs(x - 15) < 6) & (abs(y - 12) < 4)
    z[house] = (106 + 0.5 * (4 - abs(y - 12)) + rng.normal(0, 0.02, n))[house]
    shed = (abs(x - 40) < 1.5) & (abs(y - 10) < 1.5)
    z[shed] = 104 + rng.normal(0, 0.02, shed.sum())
    truth[house | shed] = 6
    wall = (abs(y - 35) < 0.3) & (x < 30)
    z[wall] = ground[wall] + 1.5
    truth[wall] = 1
    tree = (np.hypot(x - 42, y - 27) < 5) & (rng.random(n) < 0.8)
    z[tree] += rng.uniform(2, 12, tree.sum())
    truth[tree] = 5
    count, number = np.ones(n, int), np.ones(n, int)
    count[tree] = 3 if several else 1
    number[tree] = rng.integers(1, 4, tree.sum()) if several else 1
    classes = np.where(truth == 2, 2, 1)
    xyz = np.column_stack([x + 500_000, y + 4_600_000, z]) * unit
    attributes = {
        "classification": classes.astype(np.uint8),
        "return_number": number.astype(np.uint8),
        "number_of_returns": count.astype(np.uint8),
        "truth": truth.astype(np.uint8),
    }
    return PointCloud(xyz, attributes, crs=UTM, name="village.laz")


def hall(side: float) -> PointCloud:
    """A square hall, 8 m high, with a point per square metre and 20 m of ground around."""
    x, y = np.indices((round(side) + 40,) * 2).reshape(2, -1).astype(float)
    roof = (abs(x - side / 2 - 20) < side / 2) & (abs(y - side / 2 - 20) < side / 2)
    z = 100 + 8.0 * roof + np.random.default_rng(1).normal(0, 0.02, len(x))
    classes = {"classification": np.where(roof, 1, 2).astype(np.uint8)}
    return PointCloud(np.column_stack([x, y, z]), classes, crs=UTM)


@pytest.mark.parametrize(("side", "whole"), [(150.0, True), (180.0, False)])
def test_the_middle_of_a_hall_is_building_or_told(
    side: float, whole: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Beyond 50 m from ground there were no heights, and a hole of 747 m2 in a hall of 135 m."""
    found = ClassifyBuildings(points=hall(side)).run()
    (outline,) = found.outlines.frame.geometry
    assert (len(outline.interiors) == 0) == whole
    assert ("points without a height" in caplog.text) == (not whole)


def test_the_confidence_of_an_outline_through_all_of_its_points_is_a_number() -> None:
    points = hall(10.0)
    features = PointFeatures(points, 1.0, 3.0, ground_classes=(2,))
    roof = points["classification"] == 1
    x, y = points.xyz[roof, :2].T
    flat = points.xyz[:, 2] > 0
    beside = shapely.box(x[0] + TOUCHING / 2, y[0] + TOUCHING / 2, x[0] + 0.5, y[0] + 0.5)
    (sure,) = confidences(np.array([beside]), features, flat)
    assert sure == 1.0


@pytest.mark.parametrize(("density", "told"), [(0.25, True), (0.5, False)])
def test_points_too_sparse_for_roofs_are_told(
    density: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    x, y = np.indices((60, 60)).reshape(2, -1) / density**0.5
    points = PointCloud(
        np.column_stack([x, y, 0 * x]), {"classification": np.full(3600, 2, "u1")}, crs=UTM
    )
    ClassifyBuildings(points=points).run()
    assert ("some 2.0 m apart, too sparse for many roofs" in caplog.text) == told


def agreement(out: Any) -> float:
    """IoU of the points found with the true ones."""
    found, true = out.classified["classification"] == 6, out.classified["truth"] == 6
    return float((found & true).sum() / (found | true).sum())


def test_a_house_is_found_with_its_outline_and_heights() -> None:
    out = ClassifyBuildings(points=village()).run()
    (row,) = out.outlines.frame.to_dict("records")
    house = shapely.box(500_009, 4_600_008, 500_021, 4_600_016)
    both = row["geometry"].intersection(house).area
    assert both / row["geometry"].union(house).area > 0.95
    assert row["squared"]
    assert [text.split()[0] for text in out.not_looked_at()] == ["Glass", "Containers", "A"]
    assert len(row["geometry"].exterior.coords) == 5
    assert row["area"] == pytest.approx(96, rel=0.04)
    assert row["ground"] == pytest.approx(100.3, abs=0.1)
    assert row["eave"] == pytest.approx(106, abs=0.3)
    assert row["ridge"] == pytest.approx(108, abs=0.1)
    assert row["mean"] == pytest.approx(107, abs=0.1)
    assert row["height"] == pytest.approx(7.7, abs=0.15)
    found = out.classified["classification"] == 6
    assert row["points"] <= found.sum() <= 1.05 * row["points"]
    assert out.building_share == found.mean()


@pytest.mark.parametrize(("size", "told"), [(4.0, True), (1.5, False)])
def test_what_rises_above_the_ridge_is_told(
    size: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """A gate with a tower of 26 m was 11.4 m high: its spire lies on no plane."""
    points = village()
    building = points["truth"] == 6
    xyz = points.xyz.copy()
    tower = building & (abs(xyz[:, :2] - (500_015, 4_600_012)) < size / 2).all(axis=1)
    xyz[tower, 2] += 15
    house = shapely.box(500_009, 4_600_008, 500_021, 4_600_016)
    rows = [{"id": "gate", "geometry": house, "ridge": 108.0}]
    warn_of_doubtful_heights(rows, PointFeatures(points.with_xyz(xyz), 1.0, 3.0), building)
    assert ("as with a tower or spire: 1; their" in caplog.text) == told
    assert ("The most: gate, ridge 108.00, about 16 m2" in caplog.text) == told


@pytest.mark.parametrize(("slope", "told"), [(0.15, True), (0.05, False)])
def test_ground_that_differs_from_side_to_side_is_told(
    slope: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """A part of a building was 3.8 m high, and its wall 4.9 m: its ground was that of the whole."""
    points = village()
    building, xyz = points["truth"] == 6, points.xyz.copy()
    xyz[:, 2] += slope * (xyz[:, 0] - 500_000)
    house = shapely.box(500_009, 4_600_008, 500_021, 4_600_016)
    rows = [{"id": "mill", "geometry": house, "ridge": 120.0, "ground": 102.5}]
    warn_of_doubtful_heights(rows, PointFeatures(points.with_xyz(xyz), 1.0, 3.0), building)
    found = re.findall(
        r"from side to side: 1; .*mill, ground 102.50, from (.*) to (.*)", caplog.text
    )
    assert bool(found) is told
    if told:
        assert [float(v) for v in found[0]] == pytest.approx([101.6, 103.5], abs=0.15)


def test_a_house_at_the_edge_of_the_data_is_cut() -> None:
    """Five of eight buildings of a tile were cut, with heights and forms as if they were whole."""
    points = village()
    half = points.select(points["x"] < 500_016)
    (whole,), (part,) = (
        ClassifyBuildings(points=cloud).run().outlines.frame.to_dict("records")
        for cloud in (points, half)
    )
    assert not whole["cut"]
    assert part["cut"]
    said = list(ClassifyBuildings(points=half).run().not_looked_at())
    assert said[0].startswith("Buildings that the edge of the data cuts: 1 of 1;")


def conifers(density: float = 5.0, seed: int = 0) -> PointCloud:
    """A stand of 80 x 80 m: crowns are cones of 65 to 83 degrees, into which pulses go."""
    rng = np.random.default_rng(seed)
    n = int(density * 6400)
    xy, trunks = rng.uniform(0, 80, (n, 2)), rng.uniform(0, 80, (90, 2))
    high, wide = rng.uniform(12, 22, 90), rng.uniform(2.5, 4, 90)
    away = np.hypot(*(xy[:, None] - trunks).transpose(2, 0, 1))
    z = np.max(high * (1 - away / wide), axis=1)
    crown = z > 1
    z = np.where(crown, z - rng.exponential(0.6, n), 0) + rng.normal(0, 0.02, n)
    attributes = {
        "classification": np.where(crown, 1, 2).astype(np.uint8),
        "return_number": np.ones(n, np.uint8),
        "number_of_returns": np.where(crown & (rng.random(n) < 0.3), 2, 1).astype(np.uint8),
    }
    xyz = np.column_stack([xy[:, 0] + 500_000, xy[:, 1] + 4_600_000, z + 100])
    return PointCloud(xyz, attributes, crs=UTM, name="conifers.laz")


def test_crowns_of_conifers_are_no_roofs(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    out = ClassifyBuildings(points=conifers()).run()
    assert len(out.outlines) == 0
    assert "as crowns of conifers" in caplog.text
    assert len(out.refused) > 3
    rows = out.refused.frame
    assert rows["height"].between(5, 22).all()
    assert (rows["area"] >= 10).all()
    said = next(out.not_looked_at())
    assert said.startswith("Regions that look like roofs, but are steep and torn")
    top = rows.sort_values("height").iloc[-1]
    place = top.geometry.representative_point()
    assert f"{len(rows)}, {rows['area'].sum():.0f} m² in all; the highest at {place.x:.1f}," in said


def test_a_gatehouse_with_spires_has_walls() -> None:
    """Steep and torn, but pulses reach the foot of its walls without going through it."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 60, (2, 8 * 3600))
    away = np.hypot(x - 30, y - 30)
    spire = away < 5
    z = np.where(spire, 8 + 3 * (5 - away), 0) + rng.normal(0, np.where(spire, 0.2, 0.02))
    turn, up = rng.uniform(0, 2 * np.pi, 900), rng.uniform(0, 8, 900)
    wide = 4.9 + rng.normal(0, 0.15, 900)
    walls = np.column_stack([30 + wide * np.cos(turn), 30 + wide * np.sin(turn), up])
    xyz = np.vstack([np.column_stack([x, y, z]), walls]) + np.array([500_000, 4_600_000, 100])
    count = np.ones(len(xyz), np.uint8)
    count[:200] = 2  # pulses have several returns somewhere
    attributes = {
        "classification": np.where(np.r_[spire, np.ones(900, bool)], 1, 2).astype(np.uint8),
        "return_number": np.ones(len(xyz), np.uint8),
        "number_of_returns": count,
    }
    out = ClassifyBuildings(points=PointCloud(xyz, attributes, crs=UTM), flat=0.1).run()
    assert len(out.refused) == 0
    assert len(out.outlines) == 1


def test_buildings_of_the_file_that_are_none_now_are_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    points = village()
    tree = (points["truth"] == 5).astype(bool)
    given = points.with_attributes({"classification": np.where(tree, 6, 2).astype(np.uint8)})
    ClassifyBuildings(points=points, given=given).run()
    assert "points that the file calls building are none now: " in caplog.text
    text = caplog.text.partition("the largest at ")[2]
    place, area = text.partition(" (")[0], float(text.partition(" (")[2].partition(" m2")[0])
    east, north = map(float, place.split(","))
    assert np.hypot(east - 500_042, north - 4_600_027) < 2
    assert area == pytest.approx(78, rel=0.15)
    caplog.clear()
    true = points.with_attributes({"classification": np.minimum(points["truth"], 6)})
    ClassifyBuildings(points=points, given=true).run()
    assert "none now" not in caplog.text
    with pytest.raises(DataError, match="given"):
        ClassifyBuildings(points=points, given=given.select(tree)).run()


@pytest.mark.parametrize(
    ("size", "kept", "west", "told"),
    [
        (5.0, 0.0, 20.0, True),
        (5.0, 0.6, 20.0, False),  # a building stands there
        (2.7, 0.0, 20.0, False),  # 7 m2
        (2.7, 0.0, 0.0, True),  # 7 m2 that the edge of the data cuts
    ],
)
def test_places_without_buildings_and_the_rest_add_up(
    size: float, kept: float, west: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """20 points beside a roof were an alarm, and 372 at the edge of the data told nowhere."""
    caplog.set_level("INFO", "toolbox")
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 60, (2, 36_000))
    house = (abs(x - west - size / 2) < size / 2) & (abs(y - 30) < size / 2)
    alone = np.zeros(len(x), bool)
    alone[[np.hypot(x - 50, y - k).argmin() for k in (10, 25, 45)]] = True
    still = house & (rng.uniform(size=len(x)) < kept)
    xyz = np.column_stack([x + 500_000, y + 4_600_000, np.zeros(len(x))])
    given, now = (
        PointCloud(xyz, {"classification": np.where(some, 6, 1).astype(np.uint8)}, crs=UTM)
        for some in (house | alone, still)
    )
    warn_of_lost(given, now, 10.0, Lengths.of(given, alpha=1.0))
    lost = int((house & ~still).sum())
    assert f"none now: {lost + 3}" in caplog.text
    assert ("at no place" in caplog.text) is not told
    if told:
        at, rest = map(int, re.findall(r"; (\d+) at", caplog.text))
        assert at + rest == lost + 3
        assert at == pytest.approx(lost, rel=0.1), "but for spikes"


def test_a_steep_roof_is_no_crown() -> None:
    """Of 60 degrees, with planes that hold nearly all of its points."""
    assert len(roofed(village(), lambda x, y, luck: 103 + 1.73 * (4 - y)).outlines) == 1


@pytest.mark.parametrize(
    ("sides", "degrees", "torn", "crown"),
    [(0.3, 55, 0.4, True), (0.2, 55, 0.4, False), (1, 45, 0.4, False), (1, 55, 0.3, False)],
)
@pytest.mark.parametrize(
    ("low", "through", "walls"), [(0.05, 0.1, False), (0.15, 0.15, False), (0.15, 0.1, True)]
)
def test_a_crown_is_steep_and_torn_and_has_no_walls(
    *,
    sides: float,
    degrees: float,
    torn: float,
    crown: bool,
    low: float,
    through: float,
    walls: bool,
) -> None:
    cloud = village().select(np.arange(1000))
    features = PointFeatures(cloud, 1.5, 4.0, ground_classes=(2,))
    planes = np.arange(1000) < 1000 * (1 - torn)
    upright = np.where(np.arange(1000) < sides * planes.sum(), np.cos(np.radians(degrees)), 1)
    normals = np.column_stack([np.zeros((1000, 2)), upright])
    vars(features).update(
        planes=(np.zeros(1000), normals),
        terrain=(np.zeros(1000, bool), np.where(np.arange(1000) < 1000 * low, 2.0, 9.0)),
        let_through=np.arange(1000) < 1000 * through,
        has_several_returns=True,
    )
    whole = np.array([shapely.box(499_000, 4_599_000, 501_000, 4_601_000)])
    assert crowns(whole, features, planes).tolist() == [crown and not walls]


@pytest.mark.parametrize(
    ("sides", "walls", "crown"), [(0.3, 0.0, True), (0.2, 0.3, True), (0.1, 0.3, False)]
)
def test_walls_are_no_sides_of_crowns(*, sides: float, walls: float, crown: bool) -> None:
    """Planes steeper than 75 degrees do not count: a quarter of the others are sides."""
    cloud = village().select(np.arange(1000))
    features = PointFeatures(cloud, 1.5, 4.0, ground_classes=(2,))
    number, rng = np.arange(1000) / 1000, np.random.default_rng(0)
    degrees = np.where(number < walls, 80.0, np.where(number < walls + sides, 70.0, 0.0))
    upright = np.cos(np.radians(rng.permutation(degrees)))
    vars(features).update(
        planes=(np.zeros(1000), np.column_stack([np.zeros((1000, 2)), upright])),
        terrain=(np.zeros(1000, bool), np.full(1000, 9.0)),
        let_through=np.ones(1000),
        has_several_returns=True,
    )
    whole = np.array([shapely.box(499_000, 4_599_000, 501_000, 4_601_000)])
    assert crowns(whole, features, rng.random(1000) < 0.6).tolist() == [crown]


def roofed(cloud: PointCloud, height: Callable[..., Floats]) -> ClassifyBuildings.Outputs:
    """Buildings of a village whose house has heights by the place from its middle, and luck."""
    x, y = abs((cloud.xyz - (500_015, 4_600_012, 0))[:, :2].T)
    z = height(x, y, np.random.default_rng(0).uniform(0, 1, len(x)))
    z = np.where((x < 6) & (y < 4), z, cloud.xyz[:, 2])
    return ClassifyBuildings(points=cloud.with_xyz(np.column_stack([cloud.xyz[:, :2], z]))).run()


def test_the_smallest_building_decides_about_the_shed() -> None:
    points = village()
    with_shed = ClassifyBuildings(points=points, smallest=5.0, outline="alpha").run()
    assert len(with_shed.outlines) == 2
    assert agreement(with_shed) > 0.99
    none_so_large = ClassifyBuildings(points=points, smallest=5.0, largest=50.0).run()
    assert len(none_so_large.outlines) == 1
    assert none_so_large.outlines.frame.area.max() < 12
    assert ClassifyBuildings(points=points, min_height=9.0).run().building_share == 0


@pytest.mark.parametrize(("deep", "apart", "count"), [(8.0, 5.4, 1), (13.0, 5.4, 3), (9.5, 3.6, 0)])
def test_a_roof_with_open_courts_hides_the_ground_but_in_them(
    deep: float, apart: float, count: int
) -> None:
    """In Williams a house of 205 m2 with two courts 2.5 m wide was lost, as the disc covers them.

    Where the courts cut it through, three houses of 3 m are left. Strips of 1.2 m are cut off: what
    is mostly such strips is no roof.
    """

    points = village()
    x, y = (points.xyz[:, :2] - [500_000, 4_600_000]).T
    inside = (abs(x - 15) < 9) & (abs(y - 12) < 6.5)
    roof = inside & ~((x % apart < 2.4) & (y > 18.5 - deep))
    heights = np.where(inside, 100 + 0.02 * x, points.xyz[:, 2])
    heights[roof] = 104 + np.random.default_rng(0).normal(0, 0.02, roof.sum())
    classes = np.where(inside, np.where(roof, 1, 2), points["classification"]).astype(np.uint8)
    made = points.with_xyz(np.column_stack([points.xyz[:, :2], heights]))
    out = ClassifyBuildings(points=made.with_attributes({"classification": classes})).run()
    assert (out.outlines.frame.geometry.area > 20).sum() == count
    if count:
        found = out.classified["classification"] == 6
        assert found[roof].mean() > 0.97
        assert found[inside & ~roof].mean() < 0.1


def test_a_hedge_at_the_wall_is_not_in_the_outline() -> None:
    points = village()
    x, y = (points.xyz[:, :2] - [500_000, 4_600_000]).T
    hedge = (x > 21) & (x < 25) & (y > 7) & (y < 17)
    rough = np.random.default_rng(2).uniform(2.2, 4.0, hedge.sum())
    xyz = points.xyz.copy()
    xyz[hedge, 2] = (100 + 0.02 * x)[hedge] + rough
    truth, classes = points["truth"].copy(), points["classification"].copy()
    truth[hedge], classes[hedge] = 5, 1
    made = points.with_xyz(xyz).with_attributes({"truth": truth, "classification": classes})
    out = ClassifyBuildings(points=made).run()
    house = shapely.box(500_009, 4_600_008, 500_021, 4_600_016)
    assert out.outlines.frame.geometry[0].difference(house).area < 3
    found = out.classified["classification"] == 6
    assert (found & hedge & (x > 23)).sum() == 0
    assert found[(truth == 6) & (x < 21)].mean() > 0.98


def test_a_gutter_belongs_to_the_roof_beside_it() -> None:
    points = village()
    x, y = (points.xyz[:, :2] - [500_000, 4_600_000]).T
    gutter = (x > 21) & (x < 21.9) & (abs(y - 12) < 4)
    xyz, classes = points.xyz.copy(), points["classification"].copy()
    rough = np.random.default_rng(2).uniform(-0.4, 0.4, gutter.sum())
    xyz[gutter, 2], classes[gutter] = 105.5 + rough, 1
    made = points.with_xyz(xyz).with_attributes({"classification": classes})
    out = ClassifyBuildings(points=made).run()
    assert (out.classified["classification"][gutter] == 6).mean() > 0.9


@pytest.mark.parametrize(("rise", "torn", "filled"), [(0, 0.05, 1), (0, 0.2, 0), (-6, 0.0, 0)])
def test_what_a_roof_encloses_is_roof_if_it_is_as_closed(
    rise: float, torn: float, filled: int
) -> None:
    """Panels on a flat roof, a tree in a court, and a court."""
    rng = np.random.default_rng(8)
    x, y = rng.uniform(0, 60, (2, 8 * 60 * 60))
    z = rng.normal(0, 0.02, len(x))
    roof, inner = (np.maximum(abs(x - 30), abs(y - 30)) < size for size in (14, 7))
    z[roof] += 6
    z[inner] += rise + (rng.uniform(0, 1.5, inner.sum()) if rise == 0 else 0)
    court = inner if rise else np.zeros(len(x), bool)
    count = 1 + (inner & (rng.random(len(x)) < torn))
    count[(x < 1) & ~roof] = 2  # pulses have several returns somewhere
    columns = {
        "classification": np.where(roof & ~court, 1, 2).astype(np.uint8),
        "return_number": np.ones(len(x), np.uint8),
        "number_of_returns": count.astype(np.uint8),
    }
    xyz = np.column_stack([x + 500_000, y + 4_600_000, z])
    out = ClassifyBuildings(points=PointCloud(xyz, columns, crs=UTM)).run()
    core = np.maximum(abs(x - 30), abs(y - 30)) < 4
    assert (out.classified["classification"][core] == 6).mean() == pytest.approx(filled, abs=0.02)
    (outline,) = out.outlines.frame.geometry
    assert len(outline.interiors) == 1 - filled


def test_points_lie_on_planes_near_them() -> None:
    roof = np.array([[x, y, 0.5 * y] for x in range(5) for y in range(5)], float)
    up = np.array([0, -1, 2]) / np.sqrt(5)
    places = np.array([[2.4, 2.4, 1.2], [5.3, 4, 2], [6, 4, 2], [2, 2, 1], [2, 2, 1]], float)
    places[3:] += np.outer([0.09, 0.11], up)
    cloud = PointCloud(np.vstack([roof, places]), crs=UTM)
    scene = PointFeatures(cloud, 1.5, 3.0, flat=0.05)
    off = np.r_[np.zeros(len(roof)), np.ones(len(places))]
    scene.__dict__["planes"] = (off, np.tile(up, (len(off), 1)))
    found = on_planes(scene, np.ones(len(off), bool))
    assert found[: len(roof)].all()
    assert found[len(roof) :].tolist() == [True, True, False, True, False]
    assert not on_planes(scene, off > 0).any()


def test_a_narrow_middle_does_not_hide_the_eaves() -> None:
    """Two high roofs joined by a passage: what lies a metre inside is in two parts."""
    points = village()
    x, y, z = (points.xyz - [500_000, 4_600_000, 0]).T
    houses = ((abs(x - 15) < 6) | (abs(x - 33) < 6)) & (abs(y - 12) < 4)
    passage = (x >= 21) & (x <= 27) & (abs(y - 12) < 0.95)
    made = np.where(houses, 106 + 1.5 * (4 - abs(y - 12)), np.where(passage, 107.9, z))
    classes = np.where(houses | passage, 1, points["classification"]).astype(np.uint8)
    cloud = points.with_xyz(np.column_stack([points.xyz[:, :2], made]))
    out = ClassifyBuildings(points=cloud.with_attributes({"classification": classes})).run()
    (row,) = out.outlines.frame.to_dict("records")
    assert row["geometry"].buffer(-1.3).geom_type == "MultiPolygon"
    assert row["eave"] == pytest.approx(106.2, abs=0.2)


def test_overhang_is_taken_off_the_outlines(caplog: pytest.LogCaptureFixture) -> None:
    points = village()
    roof = ClassifyBuildings(points=points).run()
    walls = ClassifyBuildings(points=points, overhang=0.5).run()
    (one,), (other,) = roof.outlines.frame.geometry, walls.outlines.frame.geometry
    assert other.area == pytest.approx(one.area - 0.5 * one.length + 4 * 0.25, rel=1e-6)
    assert walls.outlines.frame["area"][0] == pytest.approx(other.area)
    assert walls.building_share == roof.building_share
    with caplog.at_level(logging.WARNING, "toolbox"):
        shed = ClassifyBuildings(points=points, smallest=5.0, largest=50.0, overhang=2.0).run()
    assert "narrower than twice the overhang, drawn as they are: 1" in caplog.text
    assert len(shed.outlines) == 1
    assert shed.outlines.frame.area[0] > 7


@pytest.mark.parametrize(("density", "alpha"), [(4.0, 1.5), (16.0, 1.5), (16.0, 0.8)])
def test_outlines_are_as_large_as_roofs(density: float, alpha: float) -> None:
    rng = np.random.default_rng(0)
    roof = shapely.Polygon([(0, 0), (60, 0), (60, 40), (0, 40)])
    made = []
    for turn in (10, 25, 40):
        shape = shapely.affinity.rotate(roof, turn)
        cells = np.stack(np.meshgrid(*[np.arange(-30, 90, density**-0.5)] * 2), -1).reshape(-1, 2)
        xy = cells + rng.uniform(-0.5, 0.5, cells.shape) * density**-0.5
        xy = xy[shapely.contains_xy(shape, *xy.T)]
        found = shapely.union_all(alpha_shape(xy, alpha).polygons)
        assert margin(density, alpha) > 0
        made.append(found.buffer(margin(density, alpha), join_style="mitre").area - roof.area)
    assert abs(np.mean(made)) / roof.length < 0.25 * margin(density, alpha)


def test_points_given_twice_make_no_roof_of_a_tree() -> None:
    points = village()
    twice = PointCloud(
        np.vstack([points.xyz, points.xyz]),
        {name: np.concatenate([points[name]] * 2) for name in points.names},
        crs=UTM,
    )
    out, both = (ClassifyBuildings(points=p).run() for p in (points, twice))
    same = both.classified["classification"] == np.tile(out.classified["classification"], 2)
    assert same.mean() > 0.999
    assert len(both.outlines) == 1


def test_shifted_points_give_the_same() -> None:
    points = village()
    moved = points.with_xyz(points.xyz + np.array([300_000, -1_000_000, 0]))
    out, far = (ClassifyBuildings(points=p, outline="alpha").run() for p in (points, moved))
    np.testing.assert_array_equal(
        out.classified["classification"], far.classified["classification"]
    )
    one, other = (o.outlines.frame.iloc[0] for o in (out, far))
    assert one["points"] == other["points"]
    assert one["area"] == pytest.approx(other["area"], rel=1e-7)


def test_without_returns_planes_decide(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "toolbox"):
        out = ClassifyBuildings(points=village(several=False)).run()
    assert "no pulse has several returns" in caplog.text
    assert len(out.outlines) == 1
    assert agreement(out) > 0.9


def test_returns_that_nobody_has_recorded_are_told_from_single_ones(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Zeros stand for what is not known: nothing is said of the pulses."""
    points = village(several=False)
    zero = np.zeros(len(points), np.uint8)
    points = points.with_attributes({"return_number": zero, "number_of_returns": zero})
    with caplog.at_level(logging.WARNING, "toolbox"):
        ClassifyBuildings(points=points).run()
    assert "no return numbers are recorded: dense crowns" in caplog.text
    assert "no pulse has several returns" not in caplog.text


def test_other_classes_stay_and_old_buildings_go() -> None:
    points = village()
    old = points["classification"].copy()
    tree, wall = points["truth"] == 5, points["truth"] == 1
    old[tree], old[wall] = 6, 17
    out = ClassifyBuildings(points=points.with_attributes({"classification": old})).run()
    classes = out.classified["classification"]
    assert (classes[tree] == 1).mean() > 0.99
    assert (classes[wall] == 17).all()
    ignored = points.with_attributes({"classification": np.where(old == 1, 7, old)})
    assert ClassifyBuildings(points=ignored).run().building_share == 0


def test_branches_over_a_roof_are_no_building_but_walls_are() -> None:
    points = village()
    rng = np.random.default_rng(1)
    branch = rng.uniform((9, 8, 110), (12, 16, 114), (300, 3))
    wall = np.column_stack([np.full(80, 9.0), rng.uniform(8, 16, 80), rng.uniform(101, 106, 80)])
    more = np.vstack([branch, wall]) + np.array([500_000, 4_600_000, 0])
    attributes = {name: points[name] for name in points.names}
    for name, value in {"classification": 1, "return_number": 1, "number_of_returns": 3}.items():
        extra = np.full(len(more), value, np.uint8)
        if name != "classification":
            extra[len(branch) :] = 1
        attributes[name] = np.concatenate([attributes[name], extra])
    truth = np.r_[np.full(300, 5), np.full(80, 6)].astype(np.uint8)
    attributes["truth"] = np.concatenate([attributes["truth"], truth])
    cloud = PointCloud(np.vstack([points.xyz, more]), attributes, crs=UTM)
    classes = ClassifyBuildings(points=cloud).run().classified["classification"]
    assert (classes[-380:-80] != 6).mean() > 0.95
    assert (classes[-80:] == 6).mean() > 0.95


@pytest.mark.parametrize("rise", [0.0, 2.5])
def test_a_deck_between_two_banks_is_a_bridge(
    rise: float, caplog: pytest.LogCaptureFixture
) -> None:
    """Also if its middle is 2.5 m higher than its ends."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform((0, 0), (80, 40), (25_600, 2)).T
    ground = 100 - np.clip(20 - abs(x - 40), 0, 8)  # a cutting
    deck = abs(y - 20) < 4
    arch = rise * np.clip(1 - ((x - 40) / 20) ** 2, 0, 1)
    z = np.where(deck, 100.0 + arch, ground) + rng.normal(0, 0.02, len(x))
    classes = np.where(deck & (ground < 99.5), 1, 2).astype(np.uint8)
    points = PointCloud(np.column_stack([x, y, z]), {"classification": classes}, crs=UTM)
    with caplog.at_level(logging.INFO, "toolbox"):
        out = ClassifyBuildings(points=points).run()
    assert len(out.outlines) == 0
    assert "1 regions meet ground at both ends" in caplog.text
    raised = points.with_xyz(points.xyz + np.where(classes == 1, 3.0, 0.0)[:, None] * [0, 0, 1])
    assert len(ClassifyBuildings(points=raised).run().outlines) == 1


@pytest.mark.parametrize("length", [30, 50, 80])
def test_a_house_with_points_on_its_gables_is_no_bridge(length: float) -> None:
    """Its eaves are lower than its middle, as the ends of an arched deck are."""
    rng = np.random.default_rng(4)
    x, y = rng.uniform((-60, -20), (60, 20), (24_000, 2)).T
    house = (abs(x) < length / 2) & (abs(y) < 6)
    z = np.where(house, 103 + 2 * (1 - abs(y) / 6), 100)
    across, side = rng.uniform(-6, 6, 2000), rng.choice([-1, 1], 2000)
    wall = 100 + rng.random(2000) * (3 + 2 * (1 - abs(across) / 6))
    xyz = np.column_stack([np.r_[x, side * (length / 2 + 0.1)], np.r_[y, across], np.r_[z, wall]])
    classes = np.r_[np.where(house, 1, 2), np.ones(2000)].astype(np.uint8)
    xyz[:, 2] += rng.normal(0, 0.02, len(xyz))
    xyz += np.array([500_000, 4_600_000, 0])
    points = PointCloud(xyz, {"classification": classes}, crs=UTM)
    assert len(ClassifyBuildings(points=points).run().outlines) == 1


@pytest.mark.parametrize("turn", [0.0, 45.0])
@pytest.mark.parametrize("corner", [False, True])
def test_a_house_in_a_slope_is_no_bridge_in_any_direction(turn: float, corner: bool) -> None:
    """The ground at the level of its roof, behind it or around a corner, has a gap of 6 m."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-25, 25, (10_000, 2)).T
    house, uphill = (abs(x) < 12) & (abs(y) < 8), (y > 8) | (corner & (x > 12))
    z = np.where(house | uphill, 100, 95) + rng.normal(0, 0.02, len(x))
    hedge = (abs(x) < 3) & (y > 8) & (y < 12)
    attributes = {
        "classification": np.where(house, 1, 2).astype(np.uint8),
        "HeightAboveGround": np.where(house, 5.0, 0.0),
    }
    xy = shapely.get_coordinates(rotate(MultiPoint(np.column_stack([x, y])), turn, (0, 0)))
    xyz = np.column_stack([xy + np.array([500_000, 4_600_000]), z])
    points = PointCloud(xyz, attributes, crs=UTM).select(~hedge)
    assert len(ClassifyBuildings(points=points).run().outlines) == 1


@pytest.mark.parametrize("turn", [0.0, 30.0, 45.0])
def test_the_length_of_an_end_does_not_depend_on_its_direction(turn: float) -> None:
    deck = rotate(shapely.box(-10, -1, 10, 1), turn, (0, 0))
    across = np.linspace(-1, 1, 5)

    def has_ends(width: float) -> bool:
        rows = [np.column_stack([np.full(5, x), across * width / 2]) for x in (-10.5, 10.5)]
        points = rotate(MultiPoint(np.concatenate(rows)), turn, (0, 0))
        return between_ends(deck, shapely.get_coordinates(points), 1.0)

    assert has_ends(1.1)
    assert not has_ends(0.9)  # and 1 m around the points


def test_any_order_and_part_of_the_points_gives_the_same() -> None:
    points = village()
    whole = ClassifyBuildings(points=points).run()
    order = np.random.default_rng(3).permutation(len(points))
    mixed = ClassifyBuildings(points=points.select(order)).run()
    np.testing.assert_array_equal(
        mixed.classified["classification"], whole.classified["classification"][order]
    )
    assert shapely.equals_exact(
        mixed.outlines.frame.geometry[0].normalize(),
        whole.outlines.frame.geometry[0].normalize(),
        1e-6,
    )


def test_feet_give_the_house_of_metres() -> None:
    feet = village(unit=3937 / 1200).with_crs(CRS(2263))
    out, metres = (ClassifyBuildings(points=p).run() for p in (feet, village()))
    same = out.classified["classification"] == metres.classified["classification"]
    assert same.mean() > 0.999
    in_feet, in_metres = (o.outlines.frame.iloc[0] for o in (out, metres))
    assert in_feet.area == pytest.approx(in_metres.area * (3937 / 1200) ** 2, rel=1e-3)
    assert in_feet["height"] == pytest.approx(in_metres["height"] * 3937 / 1200, rel=1e-3)


def test_no_points_give_no_buildings() -> None:
    out = ClassifyBuildings(points=village().select([])).run()
    assert (len(out.classified), len(out.outlines)) == (0, 0)


def test_few_neighbours_on_the_ground_do_not_matter(caplog: pytest.LogCaptureFixture) -> None:
    """Roofs are judged by what is above the ground: it may be thinned."""
    points = village(16.0)
    ground = np.flatnonzero(points["classification"] == 2)
    rest = np.flatnonzero(points["classification"] != 2)
    thinned = points.select(np.sort(np.append(rest, ground[::12])))
    out = ClassifyBuildings(points=thinned).run()
    assert "lack neighbours" not in caplog.text
    assert len(out.outlines) == len(ClassifyBuildings(points=points).run().outlines)


def test_bad_input_is_named() -> None:
    points = village()
    with pytest.raises(ParameterError, match=r"largest: must be >= smallest \(20\), got 10"):
        ClassifyBuildings(points=points, smallest=20.0, largest=10.0)
    bare = PointCloud(points.xyz, crs=UTM, name="bare.laz")
    with pytest.raises(DataError, match=r"bare\.laz has no classification; classify ground"):
        ClassifyBuildings(points=bare).run()
    raw = points.with_attributes({"classification": np.ones(len(points), np.uint8)})
    with pytest.raises(
        NothingToDo, match="points: none is of class 2,9-11; classify ground"
    ) as error:
        ClassifyBuildings(points=raw).run()
    assert len(error.value.instead.outlines) == 0
    assert error.value.instead.building_share == 0


# Outlines ------------------------------------------------------------------------------------


def jagged(shape: Any, step: float = 0.5, by: float = 0.15) -> Any:
    """An outline as points have it: a corner every `step`, off by up to `by`."""
    rng = np.random.default_rng(0)
    ring = shape.exterior
    places = [ring.interpolate(s) for s in np.arange(0, ring.length - step, step)]
    return shapely.Polygon(
        [(p.x + rng.uniform(-by, by), p.y + rng.uniform(-by, by)) for p in places]
    )


@pytest.mark.parametrize("turn", [0, 17, 45, 80])
@pytest.mark.parametrize(
    "corners",
    [
        [(0, 0), (12, 0), (12, 8), (0, 8)],
        [(0, 0), (15, 0), (15, 6), (7, 6), (7, 12), (0, 12)],
        [(0, 0), (15, 0), (15, 6), (10, 6), (10, 9), (5, 9), (5, 6), (0, 6)],
    ],
)
def test_walls_get_their_right_angles_back(corners: list[tuple[float, float]], turn: float) -> None:
    shape = shapely.affinity.rotate(shapely.Polygon(corners), turn)
    shape = shapely.affinity.translate(shape, 500_000, 4_600_000)
    made, straight = squared(jagged(shape), 0.5)
    assert straight
    assert len(made.exterior.coords) == len(corners) + 1
    assert made.intersection(shape).area / made.union(shape).area > 0.95
    steps = np.diff(np.asarray(made.exterior.coords), axis=0)
    cosine = (steps[1:] * steps[:-1]).sum(axis=1) / np.prod(np.hypot(*steps.T[:, None])[:, :-1])
    assert np.abs(cosine).max() < 1e-6


def test_a_slanted_wall_stays_and_a_circle_is_left_alone() -> None:
    slanted = shapely.Polygon([(0, 0), (20, 0), (20, 6), (14, 12), (0, 12)])
    made, straight = squared(jagged(slanted), 0.5)
    assert straight
    assert made.intersection(slanted).area / made.union(slanted).area > 0.95
    silo = shapely.Point(0, 0).buffer(10)
    made, straight = squared(silo, 0.5)
    assert made.intersection(silo).area / made.union(silo).area > 0.85
    assert main_direction(shapely.box(0, 0, 9, 3)) == pytest.approx(0, abs=1e-9)


def test_a_long_wall_keeps_its_direction() -> None:
    bent = shapely.Polygon([(0, 0), (60, 0), (60, 10), (30, 10), (0, 18)])
    made, straight = squared(jagged(bent, by=0.05), 0.5)
    assert straight
    assert len(made.exterior.coords) == 6
    assert made.hausdorff_distance(bent) < 0.3


def test_walls_in_one_direction_stay_apart() -> None:
    """A front of three walls in one direction, each 0.9 m behind the one before."""
    front = [(0, 0), (12, 0), (14.8, 0.9), (26.8, 0.9), (29.6, 1.8), (41.6, 1.8)]
    shape = shapely.Polygon([*front, (41.6, 30), (0, 30)])
    made, straight = squared(shape, 0.5)
    assert straight
    assert made.hausdorff_distance(shape) < 0.8
    assert len(made.exterior.coords) == 9


def test_a_corner_cut_off_is_put_back() -> None:
    cut = shapely.Polygon([(0, 0), (12, 0), (12, 7), (11, 8), (0, 8)])
    made, straight = squared(cut, 0.3)
    assert straight
    assert len(made.exterior.coords) == 6
    made, straight = squared(cut, 0.5)
    assert straight
    assert shapely.equals_exact(made.normalize(), shapely.box(0, 0, 12, 8).normalize(), 1e-6)


@pytest.mark.parametrize("backwards", [False, True])
def test_an_inner_corner_is_put_back_though_a_disc_does_not_get_there(backwards: bool) -> None:
    shape = shapely.Polygon([(0, 0), (15, 0), (15, 6), (7, 6), (7, 12), (0, 12)])
    rolled = shape.buffer(3.0, join_style="mitre").buffer(-3.0)
    rolled = rolled.reverse() if backwards else rolled
    made, straight = squared(rolled, 0.5, 3.0)
    assert straight
    assert len(made.exterior.coords) == 7
    assert made.symmetric_difference(shape).area < 1.5
    without, _ = squared(rolled, 0.5)
    assert len(without.exterior.coords) > 7


def test_an_inner_corner_between_walls_of_their_own_direction_is_put_back() -> None:
    """The inner walls of two wings are 4 degrees off the outer ones, too far to be turned."""
    inner = shapely.affinity.rotate(shapely.box(12, 12, 60, 60), 4, origin=(12, 12))
    shape = shapely.box(0, 0, 40, 40) - inner
    corner = (12.0, 12.0)
    rolled = shape.buffer(1.5, join_style="mitre").buffer(-1.5)
    assert rolled.boundary.distance(shapely.Point(corner)) > 0.5
    made, straight = squared(rolled, 0.5, 1.5)
    assert straight
    assert shapely.MultiPoint(made.exterior.coords).distance(shapely.Point(corner)) < 0.1


def test_an_inner_corner_is_put_back_where_points_leave_more_of_it_out_than_the_disc() -> None:
    """Cut 1.95 m from the corner on both walls; a disc of 1.5 m touches them 1.5 m from it."""
    cut = shapely.Polygon([(0, 0), (20, 0), (20, 9), (10.95, 9), (9, 10.95), (9, 20), (0, 20)])
    made, straight = squared(cut, 0.5, 1.5)
    assert straight
    corners = [(0, 0), (20, 0), (20, 9), (9, 9), (9, 20), (0, 20)]
    assert shapely.equals_exact(made.normalize(), shapely.Polygon(corners).normalize(), 1e-6)


def test_an_arc_is_no_corner_that_was_cut_off() -> None:
    """An inner arc of two edges, of 2.0 and 2.2 m, between walls of 10 and 17 m."""
    first = np.array([20.0, 10.0]) + 2.0 * np.array([-np.cos(np.pi / 6), 0.5])
    second = first + 2.2 * np.array([-0.5, np.sin(np.pi / 3)])
    apse = shapely.Polygon(
        [(0, 0), (30, 0), (30, 10), (20, 10), first, second, (second[0], 30), (0, 30)]
    )
    made, straight = squared(apse, 0.2, 1.5)
    assert straight
    assert made.symmetric_difference(apse).area < 1e-6


@pytest.mark.slow
def test_a_synthetic_town_is_mapped() -> None:
    made = SamplesScene(kind="town", size=200.0, density=8.0).run()
    out = ClassifyBuildings(points=GroundClassify(points=made.points).run().classified).run()
    found, true = (c["classification"] == 6 for c in (out.classified, made.points))
    assert (found & true).sum() / (found | true).sum() > 0.98
    frame = made.features.frame
    houses = frame[frame.kind == "building"].copy()
    houses["geometry"] = shapely.force_2d(houses.geometry.to_numpy())
    scored = CompareAreas(areas=out.outlines, reference=Vector(houses), min_area=50.0).run()
    assert scored.completeness > 99
    assert scored.similarity > 99
    assert scored.object_completeness == scored.object_correctness == 100


@pytest.mark.slow
def test_roofs_of_a_real_city(data: Callable[[str], Path]) -> None:
    points = PointCloud.open(data("ign_urban_50m") / "77055_627755.laz")
    out = ClassifyBuildings(points=GroundClassify(points=points).run().classified).run()
    found, true = (c["classification"] == 6 for c in (out.classified, points))
    assert (found & true).sum() / (found | true).sum() > 0.95


@pytest.mark.parametrize("density", [16.0, 8.0])
def test_a_lamp_beside_a_wall_is_not_in_the_outline(density: float) -> None:
    """The disc reaches from a wall to a lamp 1.8 m off: ground is seen between them."""
    points = village(density)
    x, y = (points.xyz[:, :2] - [500_000, 4_600_000]).T
    lamp = (abs(x - 15) < 0.8) & (abs(y - 17.7) < 0.4)
    xyz, classes = points.xyz.copy(), points["classification"].copy()
    xyz[lamp, 2], classes[lamp] = 106, 1
    made = points.with_xyz(xyz).with_attributes({"classification": classes})
    (row,) = ClassifyBuildings(points=made).run().outlines.frame.to_dict("records")
    house = shapely.box(500_009, 4_600_008, 500_021, 4_600_016)
    assert row["geometry"].difference(house.buffer(0.5)).area < 0.2
    with_lamp = ClassifyBuildings(points=made, alpha=1.5).run().outlines.frame.geometry[0]
    assert with_lamp.difference(house.buffer(0.5)).area > 0.4, "without ground the disc decides"


@pytest.mark.parametrize(("between", "count"), [(2, 2), (1, 1)])
def test_houses_are_apart_where_ground_is_seen_between(between: int, count: int) -> None:
    """A passage of 2 m, which the disc covers, lost both; one is left where no ground is seen."""
    points = village()
    x, y = (points.xyz[:, :2] - [500_000, 4_600_000]).T
    passage = (abs(x - 15) < 1) & (abs(y - 12) < 4)
    xyz, classes = points.xyz.copy(), points["classification"].copy()
    xyz[passage, 2] = (100 + 0.02 * x)[passage]
    classes[passage] = between
    made = points.with_xyz(xyz).with_attributes({"classification": classes})
    assert len(ClassifyBuildings(points=made).run().outlines) == count


def test_no_corner_lies_beyond_the_data() -> None:
    """The corner of two walls that the edge of the data cuts off is not seen; a void is no edge."""
    points = village(30.0)
    x, y = (points.xyz[:, :2] - [500_000, 4_600_000]).T
    house = shapely.box(500_009, 4_600_008, 500_021, 4_600_016)
    made = points.select(x + y < 36)
    row = ClassifyBuildings(points=made).run().outlines.frame.iloc[0]
    assert row["cut"]
    assert not row["squared"]
    data = MultiPoint(made.xyz[:, :2]).convex_hull
    assert row["geometry"].difference(data.buffer(0.15)).area < 0.01
    assert row["geometry"].area == pytest.approx(house.area - 0.5, abs=1.5)
    around = np.maximum(abs(x - 15) - 6, abs(y - 12) - 4)
    row = ClassifyBuildings(points=points.select((around < 0) | (around > 5))).run().outlines.frame
    assert row["squared"].all()
    assert not row["cut"].any()


def test_what_is_parted_hides_the_ground_too() -> None:
    """A frame beside a house, of which a quarter shows the ground: with the house it hid it."""
    points = village(8.0)
    x, y = (points.xyz[:, :2] - [500_000, 4_600_000]).T
    house = (abs(x - 17) < 10) & (abs(y - 17) < 9)
    frame = (abs(x - 32) < 3) & (abs(y - 15) < 4)
    seen = frame & (np.random.default_rng(3).random(len(x)) < 0.25)
    heights = np.where((house | frame) & ~seen, 106 + 0 * x, 100 + 0.02 * x)
    heights += np.random.default_rng(4).normal(0, 0.02, len(x))
    classes = np.where((house | frame) & ~seen, 1, 2).astype(np.uint8)
    made = points.with_xyz(np.column_stack([points.xyz[:, :2], heights]))
    out = ClassifyBuildings(points=made.with_attributes({"classification": classes})).run()
    (row,) = out.outlines.frame.to_dict("records")
    assert row["area"] == pytest.approx(360, rel=0.03)
    assert row["confidence"] > 0.9


def test_what_lies_within_the_data_is_not_touched() -> None:
    points = village(30.0)
    some = PointFeatures(points, 1.0, 3.0, ground_classes=(2,))
    house = shapely.box(500_009, 4_600_008, 500_021, 4_600_016)
    assert within_data(house, some, 0.18, straight=True) == (house, True)


def test_the_largest_building_is_asked_of_what_is_parted() -> None:
    points = village()
    x, y = (points.xyz[:, :2] - [500_000, 4_600_000]).T
    passage = (abs(x - 15) < 1) & (abs(y - 12) < 4)
    xyz, classes = points.xyz.copy(), points["classification"].copy()
    xyz[passage, 2], classes[passage] = 100.3, 2
    made = points.with_xyz(xyz).with_attributes({"classification": classes})
    assert len(ClassifyBuildings(points=made, largest=60.0).run().outlines) == 2
