"""Vehicles among houses: classify.buildings and classify.urban on streets."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from scenes.layers import cloud
from scenes.traffic import VEHICLE, confusion, street

from algorithms.classify._evidence import PointFeatures
from algorithms.classify._vehicles import (
    as_narrow_and_low,
    bodies,
    ground_seen,
    in_rows,
    large_vehicles,
    standing_free,
    vehicles,
)
from algorithms.classify.buildings import ClassifyBuildings
from algorithms.classify.urban import ClassifyUrban
from algorithms.ground.classify import GroundClassify
from toolbox.data import PointCloud

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float, float]  # x from, x to, y from, y to, height

BUS = (10.0, 22.0, 10.0, 12.5, 3.0)
HOUSE = (10.0, 22.0, 16.0, 26.0, 6.0)


def yard(*boxes: Box, density: float = 10.0, side: float = 40.0, seed: int = 0) -> PointCloud:
    """Level ground with boxes on it."""
    rng = np.random.default_rng(seed)
    count = int(side**2 * density)
    x, y = rng.uniform(0, side, (count, 2)).T
    z = rng.normal(0, 0.02, count)
    for west, east, south, north, height in boxes:
        z[(x > west) & (x < east) & (y > south) & (y < north)] += height
    columns = {name: np.ones(count, np.uint8) for name in ("return_number", "number_of_returns")}
    columns["number_of_returns"][0] = 2
    xyz = np.column_stack([x + 500_000, y + 4_600_000, z + 50])
    return cloud(xyz, np.where(z < 0.5, 2, 1), **columns)


def outlines(points: PointCloud, **settings: Any) -> list[float]:
    """Areas of the buildings found, in whole square metres."""
    frame = ClassifyBuildings(points=points, **settings).run().outlines.frame
    return sorted(round(area) for area in frame["area"])


def features(points: PointCloud) -> PointFeatures:
    return PointFeatures(points, 1.0, 3.0, ground_classes=(2,))


def test_a_bus_is_no_building_and_a_garage_is() -> None:
    assert outlines(yard(BUS)) == []
    (garage,) = outlines(yard((10, 16, 10, 13.1, 2.6)))
    assert garage == pytest.approx(18.6, rel=0.1)
    assert outlines(yard((10, 22, 10, 12.5, 7.0)))  # no vehicle is as high


def test_a_lorry_beside_a_wall_goes_and_an_annexe_stays() -> None:
    """The lorry stands 1.3 m from the wall; the annexe is as narrow, and leans on it."""
    (house,) = outlines(yard(HOUSE))
    assert house == pytest.approx(120, rel=0.05)
    lorry = (10.0, 20.0, 12.2, 14.7, 3.5)
    (alone,) = outlines(yard(HOUSE, lorry))
    assert alone == pytest.approx(house, rel=0.05)
    annexe = (10.0, 20.0, 13.5, 16.0, 3.5)
    (both,) = outlines(yard(HOUSE, annexe))
    assert both == pytest.approx(house + 25, rel=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_a_van_at_a_wall_goes_and_a_porch_stays(seed: int) -> None:
    """The van stands 0.6 m from the wall, which is less than points of one roof may be apart.

    The porch is as narrow, leans on the wall with its short side, and has ground at all others.
    """
    van = (12.0, 17.0, 13.2, 15.4, 2.8)
    (alone,) = outlines(yard(HOUSE, van, seed=seed))
    assert alone == pytest.approx(120, rel=0.05)
    porch = (14.0, 16.4, 10.0, 16.0, 2.8)
    (both,) = outlines(yard(HOUSE, porch, seed=seed))
    assert both == pytest.approx(120 + 14.4, rel=0.05)
    lean_to = (12.0, 17.0, 13.8, 16.0, 2.8)
    (both,) = outlines(yard(HOUSE, lean_to, seed=seed))
    assert both == pytest.approx(120 + 11, rel=0.05)


def test_no_lorry_is_taken_out_of_a_row_that_a_crown_joins() -> None:
    """Of the rest too little ground was seen: it became a building of 105 m2."""
    points = street(seed=52, density=16.0)
    truth = points["truth"] == VEHICLE
    ground = points.with_attributes({"classification": np.where(points["truth"] == 2, 2, 1)})
    classes = ClassifyBuildings(points=ground).run().classified["classification"]
    assert (classes[truth] == 6).mean() < 0.01


@pytest.mark.parametrize("seed", range(3))
def test_two_lorries_side_by_side_are_no_building(seed: int) -> None:
    """Between them is a line of ground in which no disc has room: 0.06 to 0.09 of all points."""
    two: list[Box] = [(10, 26, 10, 12.5, 3.5), (10, 26, 12.85, 15.35, 3.5)]
    assert outlines(yard(*two, density=16.0, seed=seed)) == []
    assert len(outlines(yard((10, 26, 10, 15.35, 3.5), density=16.0, seed=seed))) == 1


@pytest.mark.parametrize("size", [(12.0, 3.2), (12.0, 8.0), (25.0, 20.0)])
@pytest.mark.parametrize("density", [16.0, 8.0, 4.0])
def test_a_low_roof_through_which_some_pulses_pass_is_one(
    size: tuple[float, float], density: float
) -> None:
    """Ground that is scattered parts nothing; a row is parted by lines of it."""
    points = yard((8, 8 + size[0], 10, 10 + size[1], 3.5), density=density)
    xyz, classes = points.xyz.copy(), points["classification"].copy()
    some = np.flatnonzero(xyz[:, 2] > 52)[::15]
    xyz[some, 2], classes[some] = 50, 2
    made = points.with_xyz(xyz).with_attributes({"classification": classes})
    assert len(outlines(made)) == 1


@pytest.mark.parametrize("degrees", [-2.0, 0.0, 2.0])
def test_a_row_is_parted_though_its_outline_is_a_little_turned(degrees: float) -> None:
    """Over 16 m the ends of a line are 0.56 m off then, which is more than the gap."""
    some = features(yard((10, 26, 10, 12.5, 3.5), (10, 26, 12.9, 15.4, 3.5), density=8.0))
    around = shapely.box(500_010, 4_600_010, 500_026, 4_600_015.4)
    turned = np.array([shapely.affinity.rotate(around, degrees)])
    assert in_rows(turned, ground_seen(turned, some), some, 0.35).tolist() == [True]
    hall = features(yard((10, 26, 10, 15.4, 3.5), density=8.0))
    assert in_rows(turned, ground_seen(turned, hall), hall, 0.35).tolist() == [False]


@pytest.mark.parametrize(("begin", "parted"), [(0.0, True), (6.9, True), (7.0, False)])
def test_a_few_points_of_ground_at_an_eave_part_no_roof(begin: float, parted: bool) -> None:
    """Points at the corners of a raster: between its columns there is nothing but the ground."""
    x, y = np.indices((121, 121)).reshape(2, -1) / 10
    roof = (x < 6) & (y < 8)
    gaps = np.column_stack(
        [np.repeat([2.05, 4.05], 100), np.tile(np.linspace(begin, 7.95, 100), 2)]
    )
    xyz = np.column_stack([np.vstack([np.column_stack([x, y]), gaps]), np.zeros(len(x) + 200)])
    xyz[: len(x)][roof, 2] = 3.5
    once = np.ones(len(xyz), np.uint8)
    columns = {"return_number": once, "number_of_returns": once}
    some = features(cloud(xyz, np.where(xyz[:, 2] == 0, 2, 1), **columns))
    shape = np.array([shapely.box(0, 0, 5.95, 7.95)])
    assert in_rows(shape, np.array([0.05]), some, 0.1).tolist() == [parted]


def test_ground_between_tells_a_row_of_trams_from_a_hall() -> None:
    """At 3 points per square metre gaps of 0.8 m are not seen between neighbours."""
    row: list[Box] = [(5, 33, 10 + 3.3 * k, 12.5 + 3.3 * k, 3.5) for k in range(4)]
    assert outlines(yard(*row, density=3.0)) == []
    assert len(outlines(yard((5, 33, 10, 22.4, 3.5), density=3.0))) == 1


def test_share_of_ground_is_that_well_inside() -> None:
    points = yard(HOUSE)
    xy = points.xyz[:, :2] - (500_000, 4_600_000)
    below = np.flatnonzero((abs(xy - (16, 21)) < 1).all(axis=1))
    xyz = points.xyz.copy()
    xyz[below, 2] = 50
    classes = points["classification"].copy()
    classes[below] = 2
    seen = features(points.with_xyz(xyz).with_attributes({"classification": classes}))
    shape = shapely.box(500_010, 4_600_016, 500_022, 4_600_026)
    (share,) = ground_seen(np.array([shape]), seen)
    core = (abs(xy - (16, 21)) <= (5.25, 4.25)).all(axis=1)
    assert share == len(below) / core.sum()
    assert ground_seen(np.array([shape]), features(points)).tolist() == [0.0]


@pytest.mark.parametrize("turn", [0.0, 30.0])
@pytest.mark.parametrize("metre", [1.0, 3937 / 1200])
def test_bodies_are_measured_in_any_direction_and_unit(turn: float, metre: float) -> None:
    points = yard(BUS)
    shapes = shapely.MultiPoint(points.xyz[:, :2])
    turned = shapely.get_coordinates(shapely.affinity.rotate(shapes, turn, (500_020, 4_600_020)))
    xyz = np.column_stack([turned, points.xyz[:, 2]]) * metre
    made = PointCloud(
        xyz,
        {name: points[name] for name in points.names},
        crs=points.crs if metre == 1 else CRS(2263),
    )
    some = features(made)
    (body,) = bodies(some, some.terrain[1] > 2, 0.35 * metre)
    assert body.width == pytest.approx(2.5, abs=0.15)
    assert body.length == pytest.approx(12.0, abs=0.3)
    assert body.top == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize("seed", range(24))
def test_a_long_bus_is_told_by_its_sides_where_points_are_sparse(seed: int) -> None:
    """Points a metre apart in rows; a disc within said 3.0 m for two of these."""
    rng = np.random.default_rng(seed)
    places = np.mgrid[0:40.0, 0:40.0] + rng.uniform(0, 1, (2, 1, 1))
    xy = places.reshape(2, -1).T + rng.uniform(-0.35, 0.35, (1600, 2))
    bus = (abs(xy - (16.0, 11.25)) < (6.0, 1.275)).all(axis=1)
    z = 50 + 3.0 * bus + rng.normal(0, 0.02, len(xy))
    columns = {name: np.ones(len(xy), np.uint8) for name in ("return_number", "number_of_returns")}
    columns["number_of_returns"][0] = 2
    xyz = np.column_stack([xy + np.array([500_000, 4_600_000]), z])
    points = cloud(xyz, np.where(bus, 1, 2), **columns)
    assert large_vehicles(features(points), bus, 1.0, 10.0)[bus].all()


def test_a_square_hut_is_a_building_if_it_is_large_enough() -> None:
    points = yard((10, 12.6, 10, 12.6, 2.5))
    some = features(points)
    roof = some.terrain[1] > 2
    assert large_vehicles(some, roof, 0.35, 10.0)[roof].mean() > 0.9
    assert not large_vehicles(some, roof, 0.35, 4.0).any()


@pytest.mark.parametrize(
    ("box", "let_through", "is_car"),
    [
        ((10, 14.4, 10, 11.8, 1.5), 0.1, True),
        ((10, 14.4, 10, 11.8, 0.8), 0.1, False),  # too low
        ((10, 14.4, 10, 11.8, 1.5), 0.6, False),  # a shrub: pulses pass
        ((10, 12.4, 10, 12.2, 1.5), 0.1, False),  # no oblong
        ((10, 22.0, 10, 11.1, 1.5), 0.1, False),  # a hedge
        ((10, 22.0, 10, 11.9, 1.5), 0.1, True),  # a row of cars
        ((10, 14.4, 10, 13.3, 1.5), 0.1, False),  # too wide
    ],
)
def test_cars_are_low_oblongs(box: Box, let_through: float, is_car: bool) -> None:
    points = yard(box, density=16.0)
    above = points["classification"] == 1
    count = points["number_of_returns"].copy()
    count[above & (np.random.default_rng(1).random(len(points)) < let_through)] = 2
    some = features(points.with_attributes({"number_of_returns": count}))
    found = vehicles(some, above, 0.25)
    assert found[above].mean() == (pytest.approx(1, abs=0.05) if is_car else 0)
    assert not found[~above].any()


def test_a_crooked_shrub_is_no_car_and_grass_around_one_does_not_hide_it() -> None:
    crooked = yard((10, 15, 10, 11.5, 1.5), (10, 11.5, 10, 15, 1.5), density=16.0)
    above = crooked["classification"] == 1
    assert not vehicles(features(crooked), above, 0.25).any()
    points = yard((10, 14.4, 10, 11.8, 1.5), density=16.0)
    car = points["classification"] == 1
    grass = ~car & (np.arange(len(points)) % 2 == 0)
    xyz = points.xyz + np.where(grass, 0.2, 0.0)[:, None] * [0, 0, 1]
    found = vehicles(features(points.with_xyz(xyz)), car | grass, 0.25)
    assert found[car].all()
    assert not found[grass].any()


def wires(
    points: PointCloud, *norths: float, height: float = 20.0, east: float = 35.0
) -> PointCloud:
    """Level ground with wires from west to east above it, six points along a metre."""
    x, y = (one.ravel() for one in np.meshgrid(np.arange(5, east, 1 / 6), norths))
    wire = np.column_stack([x + 500_000, y + 4_600_000, np.full(len(x), 50 + height)])
    columns = {name: np.ones(len(points) + len(x), np.uint8) for name in ("return_number",)}
    columns["number_of_returns"] = np.append(points["number_of_returns"], np.ones(len(x), np.uint8))
    classes = np.append(points["classification"], np.ones(len(x), np.uint8))
    return cloud(np.vstack([points.xyz, wire]), classes, **columns)


@pytest.mark.parametrize("wide", [1.2, 1.4])  # less than the edges of roofs at both sides
def test_wires_side_by_side_are_no_roof(wide: float) -> None:
    """Four wires lie on a plane, in a strip that is too narrow to have an inside."""
    some = wires(yard(), *np.linspace(20, 20 + wide, 4))
    strip = np.array([shapely.box(500_005, 4_600_020, 500_035, 4_600_020 + wide)])
    (share,) = ground_seen(strip, features(some))
    assert 1 / 3 < share < 0.6
    assert outlines(some) == []


def test_a_narrow_roof_above_few_points_on_the_ground_hides_it() -> None:
    """A fifth of the points in the outline are at the foot of its wall."""
    points = yard((10, 22, 10, 11.4, 3), density=20.0)
    strip = np.array([shapely.box(500_010, 4_600_009.7, 500_022, 4_600_011.1)])
    some = features(points)
    assert 0.05 < some.terrain[0][some.within(strip[0])].mean() < 1 / 3
    assert ground_seen(strip, some) == [0]


def test_houses_apart_by_less_than_the_disc_of_sparse_points_are_found() -> None:
    """The disc of 4.5 m joins houses across gardens of 7 m: most had ground in between."""
    places = np.arange(12.0, 60.0, 16.0)
    houses = [(x, x + 9, y, y + 9, 7.0) for x in places for y in places]
    points = yard(*houses, density=0.3, side=72.0)
    found = outlines(points)
    assert len(found) >= len(houses) - 1
    assert sum(found) > 81 * len(houses) / 2
    assert len(outlines(points, alpha=4.5)) < len(houses) / 2


def test_what_is_drawn_again_as_narrow_and_as_low_as_a_bus_is_none() -> None:
    some = features(yard(BUS, (10, 22, 20, 23.0, 3.0), (10, 22, 30, 32.5, 6.0)))
    shapes = shapely.box([10.0] * 3, [10.0, 20.0, 30.0], [22.0] * 3, [12.5, 23.0, 32.5])
    shapes = shapely.transform(shapes, lambda xy: xy + np.array([500_000, 4_600_000]))
    assert as_narrow_and_low(shapes, some).tolist() == [True, False, False]
    crowned = shapely.union(shapes[0], shapely.buffer(shapely.centroid(shapes[0]), 2.0))
    hall = shapely.union(shapes[0], shapely.buffer(shapely.centroid(shapes[0]), 4.5))
    assert as_narrow_and_low(np.array([crowned, hall]), some).tolist() == [True, False]
    bare = street(seed=2, density=1.0)
    ground = bare.with_attributes({"classification": np.where(bare["truth"] == 2, 2, 1)})
    found = ClassifyBuildings(points=ground).run().classified["classification"]
    assert confusion(found, bare["truth"])["of buildings"] == 0


def test_what_stands_free_has_ground_beside_it() -> None:
    shape = np.array([shapely.box(0, 0, 10, 2)])
    places = np.stack(np.meshgrid(np.arange(-6, 17, 0.5), np.arange(-6, 9, 0.5)), -1).reshape(-1, 2)
    away = shapely.distance(shapely.points(places), shape[0])
    assert standing_free(shape, places[away > 0], 1.0) == [1]
    assert standing_free(shape, places[away >= 2.5], 1.0) == [1]
    assert standing_free(shape, places[away >= 3.5], 1.0) == [0]
    (half,) = standing_free(shape, places[(away > 0) & (places[:, 1] < 1)], 1.0)
    assert half == pytest.approx(0.55, abs=0.1)
    assert standing_free(shape, places[:0], 1.0) == [0]


def test_what_leans_on_something_is_no_vehicle() -> None:
    """The terraces at its long sides are a metre high."""
    some = features(yard(BUS, (10, 22, 5, 10, 1.0), (10, 22, 12.5, 17.5, 1.0)))
    assert not large_vehicles(some, some.terrain[1] > 2, 0.35, 10.0).any()
    alone = features(yard(BUS))
    assert large_vehicles(alone, alone.terrain[1] > 2, 0.35, 10.0).any()


def test_traffic_is_neither_building_nor_plant() -> None:
    points = street(seed=20, density=8.0)
    bare = points.with_attributes({"classification": np.zeros(len(points), np.uint8)})
    ground = GroundClassify(points=bare).run().classified
    made = ClassifyBuildings(points=ground).run()
    classes = ClassifyUrban(points=made.classified).run().classified["classification"]
    found = confusion(classes, points["truth"])
    assert found["of buildings"] < 0.02
    assert found["plant"] < 0.1
    assert found["iou"] > 0.98
    assert (classes[np.isin(points["truth"], (4, 5))] != 1).mean() > 0.8
