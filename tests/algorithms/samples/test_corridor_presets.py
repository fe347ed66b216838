"""Presets of corridors: the truth agrees with the points, and each preset is what it says."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any, get_args

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist, squareform

from algorithms.samples._corridor.land import Plants
from algorithms.samples._corridor.preset_scene import built, preset_scene, told_apart, truth
from algorithms.samples._corridor.presets import PRESETS, Name
from algorithms.samples._corridor.site import OVERHEAD, Site
from algorithms.samples._survey import EAST, NORTH, Features, SceneData
from algorithms.samples.scene import SamplesScene, scene
from toolbox.errors import ParameterError

LINES = (13, 14, 15, 16)
BARE = Plants(0, shrubs=0)
NO_LINES = [name for name in PRESETS if name.startswith("no_line")]


@cache
def thin(name: Name, density: float = 3.0, **flight: Any) -> SceneData:
    """The scene of a preset without woods, flown with fewer pulses, which is quick."""
    preset = PRESETS[name]
    settings = replace(preset.flight, density=density, **flight)
    return preset_scene(replace(preset, plants=BARE, flight=settings), 0)


@cache
def site(name: Name, seed: int = 0) -> Site:
    """The land of a preset and what stands on it, not yet flown."""
    return built(replace(PRESETS[name], plants=BARE), np.random.default_rng(seed))[0]


@cache
def told(name: Name, seed: int = 0) -> Features:
    """The truth of a preset."""
    return truth(site(name, seed))


def of(features: Features, kind: str) -> list[tuple[Any, dict[str, Any]]]:
    return [(shape, p) for shape, p in features if p["kind"] == kind]


def lines_of(features: Features) -> dict[str, NDArray[np.float64]]:
    """Places along the true wires of each line, half a metre apart, arrays of shape (n, 3)."""
    places: dict[str, list[NDArray[np.float64]]] = {}
    for shape, p in of(features, "wire"):
        dense = shapely.segmentize(shape, 0.5)
        places.setdefault(p["line"], []).append(shapely.get_coordinates(dense, include_z=True))
    return {name: np.concatenate(parts) for name, parts in places.items()}


def test_the_names_are_those_of_the_table() -> None:
    assert get_args(Name) == tuple(PRESETS)
    assert len(PRESETS) - len(NO_LINES) >= 30


def test_the_same_seed_gives_the_same_scene() -> None:
    first, again, other = (
        scene("corridor", preset="wood_poles_sparse", seed=seed) for seed in (3, 3, 4)
    )
    assert np.array_equal(first.xyz, again.xyz)
    assert all(np.array_equal(v, again.attributes[k]) for k, v in first.attributes.items())
    assert not np.array_equal(first.xyz[:100], other.xyz[:100])


def test_a_preset_is_of_a_corridor_and_has_its_own_size() -> None:
    with pytest.raises(ParameterError, match="preset: is for the kind 'corridor', got kind 'town'"):
        SamplesScene(preset="wind")
    with pytest.raises(ParameterError, match=r"size: is that of the preset.*got 300"):
        SamplesScene(kind="corridor", preset="wind", size=300.0)
    with pytest.raises(ParameterError, match="density: is that of the preset"):
        SamplesScene(kind="corridor", preset="wind", density=5.0)


@pytest.mark.parametrize("name", ["branch_poles", "mountain_across", "upright_bundles"])
def test_points_of_wires_lie_on_the_true_wires(name: Name) -> None:
    data = thin(name, noise=0.03, wander=0.0)
    a = data.attributes
    seen = 0
    for shape, p in of(data.features, "wire"):
        own = data.xyz[(a["wire_id"] == p["wire_id"]) & (a["span_id"] == p["span_id"])]
        tree = cKDTree(shapely.get_coordinates(shapely.segmentize(shape, 0.05), include_z=True))
        away = tree.query(own)[0] if len(own) else np.zeros(1)
        assert away.max() < 0.35  # half a footprint, noise, and the chords of the drawn line
        seen += len(own)
    wires = np.isin(a["classification"], (13, 14))
    assert wires.sum() > 200
    assert seen == pytest.approx(wires.sum(), abs=10)  # what is shorter than 5 m is no feature


@pytest.mark.parametrize(
    ("name", "count", "gap"),
    [("cat_heads", 2, 0.4), ("barrel_bundles", 3, 0.4), ("square_bundles", 4, 0.45)],
)
def test_subconductors_are_apart_by_the_gap(name: Name, count: int, gap: float) -> None:
    wires = [(shape, p) for shape, p in of(told(name), "wire") if p["classification"] == 14]
    wires = [pair for pair in wires if pair[1]["span_id"] == wires[0][1]["span_id"]]
    middles = np.array([shape.coords[len(shape.coords) // 2] for shape, _ in wires])
    bundles = connected_components(squareform(pdist(middles)) < 1.0)[1]
    assert (np.bincount(bundles) == count).all()
    near = cKDTree(middles).query(middles, k=2)[0][:, 1]
    assert near == pytest.approx(np.full(len(wires), gap), abs=0.02)


def test_wires_have_the_points_that_the_preset_asks_for() -> None:
    data = thin("tubes", density=8.0, on_wire=20.0)
    length = sum(shape.length for shape, _ in of(data.features, "wire"))
    points = np.isin(data.attributes["classification"], (13, 14)).sum()
    assert 17 < 100 * points / length < 32  # strips of two legs overlap, and wires are nearer


def test_towers_stand_where_the_truth_says() -> None:
    data = thin("sharp_bends", density=12.0)
    a = data.attributes
    assert {p["type"] for _, p in of(data.features, "tower")} == {"lattice"}
    for shape, p in of(data.features, "tower"):
        foot, top = shapely.get_coordinates(shape, include_z=True)
        own = data.xyz[(a["tower_id"] == p["tower_id"]) & (a["classification"] == 15)]
        assert len(own) > 50
        assert np.hypot(*(own[:, :2] - foot[:2]).T).max() < 8
        assert top[2] - 3 < own[:, 2].max() < top[2] + 0.3
        assert own[:, 2].min() < foot[2] + 4


def test_attachments_are_the_ends_of_wires() -> None:
    features = told("dead_end")
    ends = {
        (p["wire_id"], p["span_id"]): shapely.get_coordinates(shape, include_z=True)[[0, -1]]
        for shape, p in of(features, "wire")
    }
    attached = of(features, "attachment")
    assert len(attached) > len(ends)
    towers = {p["tower_id"] for _, p in of(features, "tower")}
    for shape, p in attached:
        here = shapely.get_coordinates(shape, include_z=True)
        away = np.linalg.norm(ends[p["wire_id"], p["span_id"]] - here, axis=1)
        assert away.min() < 0.001
        assert p["tower_id"] in towers


@pytest.mark.parametrize("name", ["wood_poles_steep", "mountain", "valley_span"])
def test_wires_keep_their_height_above_the_ground(name: Name) -> None:
    terrain = site(name).builder.terrain
    places = np.concatenate(list(lines_of(told(name)).values()))
    above = places[:, 2] - terrain.at(places[:, 0] - EAST, places[:, 1] - NORTH)
    assert above.min() > PRESETS[name].lines[0].clear - 0.5  # between the places looked at
    assert np.ptp(terrain.values) > 40


@pytest.mark.parametrize("name", ["crossing_over_poles", "crossing_lattice", "line_and_chairlift"])
@pytest.mark.parametrize("seed", range(2))
def test_lines_cross_above_each_other(name: Name, seed: int) -> None:
    one, two = lines_of(told(name, seed)).values()
    if name.startswith("crossing"):
        assert cKDTree(one[:, :2]).query(two[:, :2])[0].min() < 0.5
    assert cKDTree(one).query(two)[0].min() > 1.5


def test_a_chairlift_passes_between_the_lines() -> None:
    here = site("line_and_chairlift")
    rope = np.concatenate([rod for rod in here.rods if (rod["cls"] == OVERHEAD).all()])
    ropes = np.column_stack([rope["x1"], rope["y1"], rope["z1"]])
    wires = np.concatenate(list(lines_of(told("line_and_chairlift")).values()))
    assert cKDTree(wires - (EAST, NORTH, 0)).query(ropes)[0].min() > 1.0


def test_a_branch_begins_at_a_tower_of_the_main_line() -> None:
    wires = [p for _, p in of(told("branch_lattice"), "wire")]
    main = {p["from_tower"] for p in wires if p["line"] == "line 1"}
    assert {p["from_tower"] for p in wires if p["line"] == "line 2"} & main


def test_half_of_the_wires_leave() -> None:
    wires = [p for _, p in of(told("circuit_leaves"), "wire")]
    spans = sorted({p["span_id"] for p in wires})
    counts = [sum(p["span_id"] == span for p in wires) for span in spans]
    assert counts[0] == 7
    assert counts[-1] == 4


def test_strips_lie_at_different_heights() -> None:
    data = thin("shifted_strips", noise=0.03, wander=0.0)
    values, west, north, cell = data.terrain
    ground = data.attributes["classification"] == 2
    xyz, strip = data.xyz[ground], data.attributes["point_source_id"][ground]
    row, col = ((north - xyz[:, 1]) / cell).astype(int), ((xyz[:, 0] - west) / cell).astype(int)
    above = xyz[:, 2] - values[row, col]
    means = np.array([above[strip == k].mean() for k in range(1, 5)])
    steps = np.abs(np.diff(means))
    assert (steps > 0.04).all()
    assert (steps < 0.22).all()
    assert abs(means.mean()) < 0.02


def test_wind_blows_wires_aside_otherwise_in_each_strip() -> None:
    """The truth of the longest wire has its position in each strip, and the points lie there."""
    data = thin("wind", density=12.0)
    a, wires = data.attributes, of(data.features, "wire")
    _, p = max(wires, key=lambda pair: pair[0].length)
    own = (a["wire_id"] == p["wire_id"]) & (a["span_id"] == p["span_id"])
    same = [(q["wire_id"], q["span_id"]) == (p["wire_id"], p["span_id"]) for _, q in wires]
    positions = [wire for wire, mine in zip(wires, same, strict=True) if mine]
    assert len({q["swing"] for _, q in positions}) == len(positions) == 2
    trees = [
        cKDTree(shapely.get_coordinates(shapely.segmentize(shape, 0.1), include_z=True))
        for shape, _ in positions
    ]
    middle = data.xyz[own].mean(axis=0)  # where the positions are farthest apart
    near = own & (np.hypot(*(data.xyz[:, :2] - middle[:2]).T) < 20.0)
    away = np.array([tree.query(data.xyz[near])[0] for tree in trees])
    for number in (1, 2):
        strip = away[:, a["point_source_id"][near] == number].mean(axis=1)
        assert strip[number - 1] < 0.1
        assert strip[2 - number] > 0.2


@pytest.mark.parametrize(
    ("degrees", "sag", "expected"),
    [
        ((10.0, 20.0), 8.0, [10.0, 20.0]),
        ((20.6, 20.7), 8.0, [20.65]),  # 1.4 cm apart: who finds one finds both
        ((10.0, 16.0), 0.9, [13.0]),  # 9 cm
        ((10.0, 17.0), 0.9, [10.0, 17.0]),  # 11 cm
        ((10.0, 20.0, 10.1), 8.0, [10.05, 20.0]),
    ],
)
def test_positions_next_to_each_other_are_one_in_the_truth(
    degrees: tuple[float, ...], sag: float, expected: list[float]
) -> None:
    """Each was asked for a curve of its own: no span of two winds 0.06 degrees apart was found."""
    found = told_apart([math.radians(each) for each in degrees], sag)
    assert np.degrees(found) == pytest.approx(expected)


def test_wires_have_one_position_in_still_air() -> None:
    wires = [(p["wire_id"], p["span_id"]) for _, p in of(told("wood_poles"), "wire")]
    assert len(set(wires)) == len(wires) > 0


def test_noise_is_that_of_the_preset() -> None:
    data = thin("no_line_hop_garden", noise=0.15, wander=0.0)
    values, west, north, cell = data.terrain
    xyz = data.xyz[data.attributes["classification"] == 2]
    u, v = (xyz[:, 0] - west) / cell - 0.5, (north - xyz[:, 1]) / cell - 0.5
    level = values[v.round().astype(int), u.round().astype(int)]
    assert np.std(xyz[:, 2] - level) == pytest.approx(0.15, rel=0.1)


def test_drops_go_from_poles_to_houses() -> None:
    features = told("service_drops")
    drops = [(shape, p) for shape, p in of(features, "wire") if p["line"] == "service drop"]
    houses = shapely.union_all([shape for shape, _ in of(features, "building")])
    feet = {p["tower_id"]: np.array(shape.coords[0])[:2] for shape, p in of(features, "tower")}
    assert len(drops) > 5
    for shape, p in drops:
        assert p["to_tower"] == 0
        assert np.hypot(*(np.array(shape.coords[0])[:2] - feet[p["from_tower"]])) < 0.01
        assert shapely.distance(shapely.Point(shape.coords[-1]), houses) < 0.1


@pytest.mark.parametrize("name", NO_LINES)
def test_what_is_no_line_is_none_in_the_truth(name: Name) -> None:
    assert not any(p["kind"] in ("wire", "tower", "attachment") for _, p in told(name))
    assert len([p for _, p in told(name) if p["kind"] not in ("building", "car")]) > 0
    made = np.concatenate(site(name).rods)
    assert not np.isin(made["cls"], LINES).any()
    assert not any(made[key].any() for key in ("wire_id", "span_id", "tower_id"))


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_is_a_whole_survey(name: Name) -> None:
    """With a quarter of the pulses, which is quicker; as many hit the wires."""
    preset = PRESETS[name]
    flight = replace(preset.flight, density=preset.flight.density / 4)
    data = preset_scene(replace(preset, flight=flight), 1)
    assert 2.5e4 < len(data.xyz) < 5e5
    assert np.isfinite(data.xyz).all()
    assert np.isfinite(data.terrain[0]).all()
    assert all(shape.has_z and "kind" in p for shape, p in data.features)
    if name not in NO_LINES:
        assert np.isin(data.attributes["classification"], (13, 14)).sum() > 40
        assert len(of(data.features, "tower")) >= 2
        assert len(of(data.features, "wire")) >= 3
