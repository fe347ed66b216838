"""Synthetic surveys agree with the truth that they hand out."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.samples.scene import KINDS, SceneData, scene
from toolbox.context import Context
from toolbox.errors import Cancelled, ParameterError

SIZES = {
    "town": (200, 5),
    "corridor": (300, 15),
    "power_lines": (300, 15),
    "reservoir": (200, 5),
    "facade": (20, 300),
}
AIRBORNE = ("town", "corridor", "power_lines", "reservoir")


@cache
def survey(kind: str, seed: int = 1) -> SceneData:
    size, density = SIZES[kind]
    return scene(kind, size=size, density=density, seed=seed)


def bilinear(
    data: SceneData, x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Elevation of the truth raster, NaN outside the cell centres."""
    values, west, north, cell = data.terrain
    u, v = (x - west) / cell - 0.5, (north - y) / cell - 0.5
    col, row = np.floor(u).astype(int), np.floor(v).astype(int)
    inside = (col >= 0) & (row >= 0) & (col < values.shape[1] - 1) & (row < values.shape[0] - 1)
    col, row = np.where(inside, col, 0), np.where(inside, row, 0)
    u, v = u - col, v - row
    z = values.astype(float)
    upper = z[row, col] * (1 - u) + z[row, col + 1] * u
    lower = z[row + 1, col] * (1 - u) + z[row + 1, col + 1] * u
    return np.where(inside, upper * (1 - v) + lower * v, np.nan)


def of_class(data: SceneData, *classes: int) -> NDArray[np.bool_]:
    return np.isin(data.attributes["classification"], classes)


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_scene(kind: str) -> None:
    first, second, other = (scene(kind, size=50, density=10, seed=seed) for seed in (3, 3, 4))
    assert np.array_equal(first.xyz, second.xyz)
    assert np.array_equal(first.terrain[0], second.terrain[0])
    assert first.attributes.keys() == second.attributes.keys()
    assert all(np.array_equal(v, second.attributes[k]) for k, v in first.attributes.items())
    assert [p for _, p in first.features] == [p for _, p in second.features]
    assert not np.array_equal(first.xyz[:100], other.xyz[:100])


@pytest.mark.parametrize("kind", AIRBORNE)
def test_density_is_near_the_request(kind: str) -> None:
    size, density = SIZES[kind]
    area = size * (min(size, 120.0) if kind in ("corridor", "power_lines") else size)
    assert len(survey(kind).xyz) / area == pytest.approx(density, rel=0.2)


@pytest.mark.parametrize(("size", "density"), [(20, 0.1), (20, 100), (50, 20), (130, 2)])
@pytest.mark.parametrize("kind", KINDS)
def test_small_and_thin_scenes_are_whole(kind: str, size: float, density: float) -> None:
    data = scene(kind, size=size, density=density, seed=1)
    assert len(data.xyz) > 0
    assert all(len(values) == len(data.xyz) for values in data.attributes.values())
    assert np.isfinite(data.xyz).all()
    assert np.isfinite(data.terrain[0]).all()
    assert np.array_equal(data.xyz, np.round(data.xyz, 3))
    assert all(shape.has_z and "kind" in p for shape, p in data.features)
    if kind in ("town", "reservoir"):  # elsewhere shapes stand upright: nothing is left in plan
        assert all(shape.is_valid for shape, _ in data.features)


@pytest.mark.parametrize("kind", AIRBORNE)
def test_returns_of_a_pulse_belong_together(kind: str) -> None:
    a, z = survey(kind).attributes, survey(kind).xyz[:, 2]
    key = np.stack([a["point_source_id"], a["gps_time"]])
    order = np.lexsort((a["return_number"], *key))
    same = (np.diff(key[:, order]) == 0).all(axis=0)
    number, count = a["return_number"][order].astype(int), a["number_of_returns"][order]
    assert np.array_equal(number[1:][same], number[:-1][same] + 1)
    assert np.array_equal(count[1:][same], count[:-1][same])
    assert (number[1:][~same] == 1).all()
    last = np.append(~same, True)
    assert np.array_equal(last, number == count)
    # Lower and lower: two returns are half a metre apart, noise and leaves of grass aside.
    assert (np.diff(z[order])[same] < 0).mean() > 0.99
    assert count.max() <= 5
    assert np.abs(a["scan_angle"] * 0.006).max() < 35


@pytest.mark.parametrize("kind", KINDS)
def test_ground_points_lie_on_the_terrain(kind: str) -> None:
    data = survey(kind)
    xyz = data.xyz[of_class(data, 2)]
    away = xyz[:, 2] - bilinear(data, xyz[:, 0], xyz[:, 1])
    away = away[np.isfinite(away)]
    assert len(away) > 0.9 * len(xyz)
    noise = 0.001 if kind == "facade" else 0.02
    assert np.median(np.abs(away)) < 1.2 * noise
    assert np.abs(away).max() < 0.25
    assert abs(np.median(away)) < 0.1 * noise


def test_terrain_covers_every_ground_point_of_a_house() -> None:
    data = survey("facade")
    xyz = data.xyz[of_class(data, 2)]
    assert np.isfinite(bilinear(data, xyz[:, 0], xyz[:, 1])).all()


@pytest.mark.parametrize(
    ("kind", "shares"),
    [
        (
            "town",
            {
                2: (0.5, 0.9),
                5: (0.02, 0.2),
                6: (0.03, 0.3),
                9: (1e-4, 0.02),
                17: (1e-3, 0.03),
                7: (1e-4, 1e-3),
                18: (1e-4, 1e-3),
                3: (1e-3, 0.1),
                1: (1e-4, 0.02),
            },
        ),
        (
            "corridor",
            {
                2: (0.4, 0.8),
                5: (0.1, 0.5),
                13: (5e-4, 0.01),
                14: (5e-3, 0.05),
                15: (1e-3, 0.03),
                16: (1e-5, 0.01),
                6: (1e-4, 0.02),
            },
        ),
        ("reservoir", {2: (0.5, 0.9), 9: (0.01, 0.2), 7: (1e-4, 5e-3), 4: (5e-3, 0.2)}),
        ("facade", {6: (0.2, 0.9), 2: (0.05, 0.7), 1: (0.01, 0.2)}),
    ],
)
def test_class_shares(kind: str, shares: dict[int, tuple[float, float]]) -> None:
    for cls, (low, high) in shares.items():
        share = of_class(survey(kind), cls).mean()
        assert low < share < high, f"class {cls}: {share}"


def test_town_has_what_a_surveyor_expects() -> None:
    data = survey("town")
    buildings = [(s, p) for s, p in data.features if p["kind"] == "building"]
    assert {"flat", "gable", "hip"} >= {p["roof"] for _, p in buildings}
    assert any(len(s.interiors) == 1 for s, _ in buildings), "courtyard"
    sides = [
        max(np.hypot(*np.diff(s.minimum_rotated_rectangle.exterior.coords, axis=0)[:2].T[:2]))
        for s, _ in buildings
    ]
    assert max(sides) > 60, "hall"
    assert {p["kind"] for _, p in data.features} >= {"tree", "bridge", "water", "car"}
    values, _, _, cell = data.terrain
    slope = np.hypot(*np.gradient(values.astype(float), cell))
    assert 0.8 < slope.max() < 1.5
    assert {s.geom_type for s, _ in data.features} == {"Polygon"}


def test_building_points_lie_in_their_footprints() -> None:
    data = survey("town")
    buildings = {p["object_id"]: (s, p) for s, p in data.features if p["kind"] == "building"}
    points = of_class(data, 6)
    owner, xyz = data.attributes["object_id"][points], data.xyz[points]
    assert set(np.unique(owner)) == set(buildings)
    for number, (shape, properties) in buildings.items():
        own = xyz[owner == number]
        assert shapely.distance(shape, shapely.points(own[:, :2])).max() < 0.1
        assert own[:, 2].max() < properties["ridge_z"] + 0.1
        assert own[:, 2].max() > properties["ridge_z"] - 0.6


def test_roof_planes_are_planes() -> None:
    data = survey("town")
    plane = data.attributes["plane_id"]
    roofs = [
        k for k, n in zip(*np.unique(plane[plane > 0], return_counts=True), strict=True) if n > 200
    ]
    assert len(roofs) > 8
    for number in roofs:
        xyz = data.xyz[plane == number]
        spread = np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)[2] / np.sqrt(len(xyz))
        assert 0.01 < spread < 0.03


def test_trees_let_some_light_through() -> None:
    data = survey("town")
    trees = shapely.union_all([s for s, p in data.features if p["kind"] == "tree"])
    ground = data.xyz[of_class(data, 2)]
    below = shapely.contains_xy(trees, ground[:, 0], ground[:, 1]).sum()
    assert 0.2 < below / trees.area < 4


def test_wire_points_lie_on_their_catenary() -> None:
    data = survey("corridor")
    a = data.attributes
    wires = [(s, p) for s, p in data.features if p["kind"] == "wire"]
    assert {p["wire_id"] for _, p in wires} == set(range(1, 12))
    seen = 0
    for shape, p in wires:
        own = data.xyz[(a["wire_id"] == p["wire_id"]) & (a["span_id"] == p["span_id"])]
        start, end = np.array(shape.coords)[[0, -1]]
        along = (end - start)[:2] / p["span"]
        assert np.hypot(*(end - start)[:2]) == pytest.approx(p["span"], abs=0.001)
        offset = own[:, :2] - start[:2]
        u, v = offset @ along, offset @ np.array([-along[1], along[0]])
        z = p["a"] + p["c"] * (np.cosh((u - p["b"]) / p["c"]) - 1)
        assert np.abs(v).max() < 0.2
        assert np.abs(own[:, 2] - z).max() < 0.12
        assert np.median(np.abs(own[:, 2] - z)) < 0.025
        seen += len(own)
    assert seen == (a["wire_id"] > 0).sum() == of_class(data, 13, 14).sum()


def test_tower_points_belong_to_their_tower() -> None:
    data = survey("corridor")
    towers = {p["tower_id"]: (s, p) for s, p in data.features if p["kind"] == "tower"}
    ids = data.attributes["tower_id"]
    assert set(np.unique(ids)) == {0, *towers}
    for number, (shape, p) in towers.items():
        own = data.xyz[(ids == number) & of_class(data, 15)]
        x, y, ground = shape.coords[0]
        assert shape.coords[1][2] - ground == pytest.approx(p["height"], abs=0.001)
        assert np.hypot(own[:, 0] - x, own[:, 1] - y).max() < 8
        top, reach = ground + p["height"], {"transmission": 1.0, "distribution": 2.0}[p["system"]]
        assert top - reach < own[:, 2].max() < top + 0.2


def test_sag_and_length_are_those_of_the_drawn_wire() -> None:
    for shape, p in survey("corridor").features:
        if p["kind"] == "wire":
            xyz = np.array(shape.coords)
            share = np.linspace(0, 1, len(xyz))
            chord = xyz[0, 2] + share * (xyz[-1, 2] - xyz[0, 2])
            assert (chord - xyz[:, 2]).max() == pytest.approx(p["sag"], abs=0.01)
            steps = np.linalg.norm(np.diff(xyz, axis=0), axis=1)
            assert steps.sum() == pytest.approx(p["length"], abs=0.01)


def test_some_trees_stand_too_near_and_say_so() -> None:
    data = survey("corridor")
    lines = shapely.MultiLineString([s for s, p in data.features if p["kind"] == "wire"])
    wires = cKDTree(shapely.get_coordinates(shapely.segmentize(lines, 0.2), include_z=True))
    near = [(s, p) for s, p in data.features if p.get("clearance", 9.0) < 3.0]
    assert len(near) >= 4
    for shape, p in near:
        own = data.xyz[data.attributes["object_id"] == p["object_id"]]
        gap = wires.query(own)[0].min()
        assert p["clearance"] - 0.3 < gap < p["clearance"] + 1.5
        assert shape.length == 0.0  # vertical: no length in plan


def test_water_is_level_and_mostly_dark() -> None:
    data = survey("reservoir")
    water = [(s, p) for s, p in data.features if p["kind"] == "water" and p["body"] != "puddle"]
    assert [p["body"] for _, p in water] == ["reservoir", "pond", "pond"]
    assert len({p["level"] for _, p in water}) == 3
    assert len(water[0][0].interiors) >= 2, "islands"
    points = data.xyz[of_class(data, 9)]
    for shape, p in water:
        own = points[shapely.contains_xy(shape, points[:, 0], points[:, 1])]
        assert len(own) > 0
        assert np.abs(own[:, 2] - p["level"]).max() < 0.12
    assert len(points) < 0.4 * 5 * sum(shape.area for shape, _ in water)
    ground = data.xyz[of_class(data, 2)]
    for shape, _ in water:
        core = shape.buffer(-0.5)
        assert shapely.contains_xy(core, ground[:, 0], ground[:, 1]).sum() == 0


def test_noise_below_the_water_is_one_point_in_a_hundred() -> None:
    data = survey("reservoir")
    shape, p = next((s, p) for s, p in data.features if "storage" in p)
    inside = shapely.contains_xy(shape, data.xyz[:, 0], data.xyz[:, 1])
    low, water = data.xyz[inside & of_class(data, 7), 2], (inside & of_class(data, 9)).sum()
    assert 0.004 < len(low) / water < 0.03
    assert low.max() < p["level"] - 0.2


def test_the_storage_curve_ends_at_the_true_area() -> None:
    shape, p = next((s, p) for s, p in survey("reservoir").features if "storage" in p)
    storage = json.loads(p["storage"])
    level, area, volume = storage[-1]
    assert level == p["level"]
    assert area == pytest.approx(shape.area, rel=0.01)
    levels, areas, volumes = np.array(storage).T
    assert (np.diff(levels) > 0).all()
    assert (np.diff(areas) > 0).all()
    trapezoids = np.sum((areas[1:] + areas[:-1]) / 2 * np.diff(levels))
    assert volume - volumes[0] == pytest.approx(trapezoids, rel=0.02)


@cache
def palace() -> SceneData:
    return scene("facade", size=29, density=300, seed=1, relief=0.4)


@pytest.mark.parametrize("data", [survey("facade"), palace()])
def test_facade_points_lie_on_their_planes(data: SceneData) -> None:
    planes = {p["plane_id"]: (s, p) for s, p in data.features if "plane_id" in p}
    ids = data.attributes["plane_id"]
    assert set(np.unique(ids)) <= set(planes)
    for number, (shape, p) in planes.items():
        own = data.xyz[ids == number]
        if len(own) == 0:
            continue
        normal = np.array([p["normal_x"], p["normal_y"], p["normal_z"]])
        assert np.linalg.norm(normal) == pytest.approx(1)
        assert np.abs(own @ normal - p["offset"]).max() < 0.025
        corners = shapely.get_coordinates(shape, include_z=True)
        assert np.abs(corners @ normal - p["offset"]).max() < 0.001
        assert (own >= corners.min(axis=0) - 0.03).all()
        assert (own <= corners.max(axis=0) + 0.03).all()


def test_a_front_with_relief() -> None:
    """Pilasters as far before the wall as was asked, arches, panes that send nothing back."""
    data = palace()
    faces = [p for _, p in data.features if "plane_id" in p]
    offset = {kind: [p["offset"] for p in faces if p["kind"] == kind] for kind in ("wall", "door")}
    first = [p for p in faces if p["kind"] == "pilaster"][::5]  # the first of five faces
    away = [abs(p["offset"] - offset["wall"][0]) for p in first]
    assert away == pytest.approx([0.4] * 9, abs=0.005)
    assert abs(offset["wall"][1] - offset["wall"][0]) == pytest.approx(0.16)  # stands back
    openings = [(s, p) for s, p in data.features if p["kind"] == "opening"]
    assert len(openings) == 3 * 8
    ids = data.attributes["opening_id"]
    kinds = {p["plane_id"]: p["kind"] for p in faces}
    of_point = np.array([kinds[k] for k in data.attributes["plane_id"]])
    reflecting = [p["opening_id"] for _, p in openings if p["type"] == "reflecting window"]
    assert reflecting
    assert set(of_point[np.isin(ids, reflecting)]) == {"reveal"}
    assert {"shutter", "balcony", "clutter", "cable", "course"} <= set(of_point)
    arch = max((s for s, _ in openings), key=lambda s: len(s.exterior.coords))
    assert len(arch.exterior.coords) > 10
    doors = [(s, p) for s, p in openings if p["type"] == "door" and len(s.exterior.coords) > 10]
    for shape, p in doors:
        corners = shapely.get_coordinates(shape, include_z=True)
        own = data.xyz[(ids == p["opening_id"]) & (of_point == "door")]
        upper = own[own[:, 2] > corners[:, 2].max() - 0.2]
        middle = corners.mean(axis=0)
        assert np.hypot(*(upper - middle)[:, :2].T).max() < 0.8  # of 0.9: the arch narrows


def test_nothing_is_seen_in_a_dark_room() -> None:
    data = survey("facade")
    xy = data.xyz[of_class(data, 2), :2] - (500_000, 4_400_000)
    c, s = np.cos(np.radians(17)), np.sin(np.radians(17))
    x, y = xy @ (c, s), xy @ (-s, c)
    inside = (y > 0.05) & (x > 0.05) & (x < 18)  # further right one sees past the corner
    assert inside.sum() == 0
    assert (y > 0.05).sum() > 0  # but beside the house
    west = next(p["plane_id"] for _, p in data.features if p["kind"] == "side wall")
    assert west not in data.attributes["plane_id"]  # both stations stand east of it


def test_the_wall_has_its_density_and_its_holes() -> None:
    data = survey("facade")
    wall = next(s for s, p in data.features if p["kind"] == "wall")
    number = next(p["plane_id"] for _, p in data.features if p["kind"] == "wall")
    own = data.xyz[data.attributes["plane_id"] == number]
    upper = own[(own[:, 2] > 155.0) & (own[:, 2] < 155.5)]  # above windows and shadows
    assert len(upper) / (20 * 0.5) == pytest.approx(300, rel=0.35)
    openings = [(s, p) for s, p in data.features if p["kind"] == "opening"]
    assert len(openings) == len(wall.interiors) == 10
    start = np.array(wall.exterior.coords)[0]
    along = np.array([np.cos(np.radians(17)), np.sin(np.radians(17))])
    u, z = (own[:, :2] - start[:2]) @ along, own[:, 2]
    for shape, _ in openings:
        corners = np.array(shape.exterior.coords)
        cu, cz = (corners[:, :2] - start[:2]) @ along, corners[:, 2]
        within = (u > cu.min() + 0.03) & (u < cu.max() - 0.03)
        within &= (z > cz.min() + 0.03) & (z < cz.max() - 0.03)
        assert within.sum() == 0


def test_an_unknown_kind_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ParameterError, match="town, corridor, power_lines, reservoir, facade"):
        scene("village", size=50, density=10, seed=1)


@pytest.mark.parametrize("kind", KINDS)
def test_progress_rises_and_cancel_stops(kind: str) -> None:
    seen: list[float] = []
    scene(kind, size=50, density=10, seed=1, ctx=Context(seen.append))
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert min(seen) >= 0
    with pytest.raises(Cancelled):
        scene(kind, size=50, density=10, seed=1, ctx=Context(stop=lambda: True))


def test_a_long_front_has_a_bay_a_bush_and_the_noise_that_is_asked_for() -> None:
    spread = []
    for noise in (0.0, 0.01):
        data = scene("facade", size=30, density=100, seed=1, noise=noise)
        kinds = {p["plane_id"]: p for _, p in data.features if "plane_id" in p}
        seen = {kinds[k]["kind"] for k in np.unique(data.attributes["plane_id"])}
        assert seen >= {"bay", "clutter", "wall", "curtain", "glass", "roof", "ground"}
        wall = next(p for p in kinds.values() if p["kind"] == "wall")
        own = data.xyz[data.attributes["plane_id"] == wall["plane_id"]]
        spread.append(np.std(own @ [wall[f"normal_{axis}"] for axis in "xyz"] - wall["offset"]))
    assert spread[0] < 0.0005  # coordinates are whole millimetres
    assert 0.006 < spread[1] < 0.01  # along the beam, which is not square to the wall


def test_noise_of_water_is_that_of_water_only() -> None:
    calm, rough = (
        scene("reservoir", size=100, density=5, seed=1, water_noise=noise) for noise in (0.02, 0.1)
    )
    wet = of_class(calm, 9)
    assert np.array_equal(calm.xyz[~wet], rough.xyz[~wet])
    assert np.array_equal(calm.xyz[:, :2], rough.xyz[:, :2])
    away = [data.xyz[wet, 2] - 500 for data in (calm, rough)]
    spread = [float(np.median(abs(z))) / 0.6745 for z in away]
    assert spread == pytest.approx([0.02, 0.1], rel=0.15)
