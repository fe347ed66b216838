"""Power lines of known shape, and what looks like a power line but is none."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from pyproj import CRS
from scenes.corridors import (
    CORNER,
    Floats,
    bar,
    cloud,
    ground,
    in_hills,
    line,
    pole,
    quality,
    tree,
    unlabelled,
    wire,
)

from algorithms.corridor._curves.arcs import (
    Binned,
    agreed,
    all_settled,
    arcs_of,
    bending,
    binned,
    held_within,
    misfits,
    mostly_apart,
    solved,
    wander_of,
)
from algorithms.corridor._curves.catenary import fit
from algorithms.corridor._curves.network import Corridor, Piece
from algorithms.corridor._curves.trace import PLAN_CELL, Airborne
from algorithms.corridor._curves.tracks import Alignment, alignments_among
from algorithms.corridor._extraction.follow import is_arm, is_guy, without_bars
from algorithms.corridor._extraction.labels import none_labelled
from algorithms.corridor._extraction.missed import (
    conductor_counts,
    seen_share,
    warn_of_edges,
    warn_of_missed,
)
from algorithms.corridor._extraction.spans import (
    Wire,
    conductors_of,
    numbered,
    on_wire,
    recovered,
    stands_alone,
    upheld,
)
from algorithms.corridor._extraction.supports import Support
from algorithms.corridor._extraction.towers import between_masts, centred
from algorithms.corridor._settings import SETTINGS
from algorithms.corridor.extract import CorridorExtract, PowerLine, label_points
from algorithms.samples.scene import SamplesScene
from toolbox.data import PointCloud, Vector
from toolbox.declare import ClassList
from toolbox.errors import DataError

DATA = Path(os.environ.get("TOOLBOX_TEST_DATA", "/nowhere"))
GROUND = ground(200, 60, 8)
FACES = (-1, 3), (1, 9)  # metres aside of the middle of a tower, and points per metre of its legs
RNG = np.random.default_rng(1)


def found(*parts: Floats) -> CorridorExtract.Outputs:
    return CorridorExtract(points=cloud(*parts)).run()


@pytest.fixture(scope="module")
def three_spans() -> tuple[CorridorExtract.Outputs, list[object]]:
    curves, wires, poles = line([0, 60, 120, 180], [-1, 0, 1], 9, 400)
    points = cloud(GROUND, *wires, poles, classes=[2, *[14] * 9, 15])
    return CorridorExtract(points=points).run(), list(curves)


def test_a_distribution_line_is_found_point_by_point(three_spans) -> None:
    result, _ = three_spans
    said, true = result.classified["classification"], result.classified["truth"]
    assert result.span_count == 3
    assert result.tower_count == 4
    assert quality(said == 14, true == 14) > 0.98
    assert quality(said == 15, true == 15) > 0.8  # of a pole much is hidden in the grass


def test_curves_are_within_two_centimetres(three_spans) -> None:
    result, curves = three_spans
    frame = result.wires.frame
    assert len(frame) == 9
    for curve in curves:
        u = np.linspace(0.5, curve.length - 0.5, 50)
        true = curve.points(u) + CORNER
        away = [np.abs(_height(shape, true) - true[:, 2]).max() for shape in frame.geometry]
        assert min(away) < 0.04
    assert frame.c.between(380, 420).all()
    assert (abs(frame.c - 400) < 4 * frame.sd_c).all()
    assert frame.span.between(59, 61).all()


def _height(shape, places: Floats) -> Floats:
    """Height of a line along x at places near it, far away elsewhere."""
    corners = np.array(shape.coords)
    corners = corners[np.argsort(corners[:, 0])]
    near = abs(np.interp(places[:, 0], *corners[:, :2].T) - places[:, 1]) < 0.3
    inside = (places[:, 0] > corners[0, 0] - 2) & (places[:, 0] < corners[-1, 0] + 2)
    return np.where(near & inside, np.interp(places[:, 0], *corners[:, ::2].T), 1e3)


def test_a_wire_keeps_its_number_across_the_poles(three_spans) -> None:
    result, _ = three_spans
    frame = result.wires.frame
    assert frame.wire_id.nunique() == 3
    assert (frame.groupby("wire_id").span_id.nunique() == 3).all()
    points = result.classified
    on_wire = points["classification"] == 14
    assert set(points["wire_id"][on_wire]) == set(frame.wire_id)
    assert not points["wire_id"][~on_wire].any()
    assert set(points["tower_id"][points["classification"] == 15]) <= {1, 2, 3, 4}
    ends = sorted(zip(frame.from_tower, frame.to_tower, strict=True))
    assert {tuple(sorted(pair)) for pair in ends} == {(1, 2), (2, 3), (3, 4)}
    west = frame.groupby("span_id").geometry.agg(lambda own: own.iloc[0].centroid.x)
    assert west.is_monotonic_increasing  # spans are numbered along the line


def test_conductors_of_a_bundle_are_told_apart() -> None:
    _, wires, towers = line([0, 180], [-4, 4], 25, 1200)
    twins = [part + np.array([0, 0.4, 0]) for part in wires]
    frame = found(GROUND, *wires, *twins, towers).wires.frame
    assert len(frame) == 4
    assert frame.bundle_id.nunique() == 2
    assert frame.c.between(1150, 1250).all()


def valley(heights: Sequence[float], per_metre: float) -> tuple[list[Floats], Floats]:
    """Four wires over poles 45 m apart, whose tops are at these heights."""
    wires, poles = [], []
    for k, (a, b) in enumerate(itertools.pairwise(heights)):
        for y in (-1.0, -0.33, 0.33, 1.0):
            ends = (45.0 * k, y, a), (45.0 * k + 45, y, b)
            wires.append(wire(*ends, 400, per_metre, seed=k)[1])
    for k, top in enumerate(heights):
        poles.append(pole(45.0 * k, 0.0, top + 0.5))
    return wires, np.vstack(poles)


def places_of(result: CorridorExtract.Outputs) -> Floats:
    """Where along the x axis the supports are, sorted."""
    return np.sort(result.towers.frame.geometry.x.to_numpy() - CORNER[0])


@pytest.mark.parametrize("per_metre", [4.0, 0.6], ids=["dense", "sparse"])
def test_poles_in_a_valley_are_found_although_the_wires_hardly_bend(per_metre: float) -> None:
    wires, poles = valley([14.0, 10.6, 9.0, 10.6, 14.0], per_metre)
    result = found(GROUND, *wires, poles)
    assert result.span_count == 4
    np.testing.assert_allclose(places_of(result), [0, 45, 90, 135, 180], atol=1.5)


@pytest.mark.parametrize(("shown", "places"), [(True, [0, 45, 90, 135]), (False, [0, 135])])
def test_arms_part_spans_whose_wires_do_not_bend_at_them(shown: bool, places: list[int]) -> None:
    """All poles stand on the arc of the wires; where none is seen, a tree comes up to them."""
    arc = wire((0, 0, 16), (135, 0, 16), 400)[0]
    wires = [wire((0, y, 16), (135, y, 16), 400)[1] for y in (-1, 0, 1)]
    seen = [0.0, 45.0, 90.0, 135.0] if shown else [0.0, 135.0]
    poles = [pole(x, 0.0, float(arc.height(np.array(x))) + 0.5) for x in seen]
    trees = [tree(70.0, 0.0, 11.0, 1.5, 600)]
    result = found(GROUND, *wires, *poles, *trees)
    np.testing.assert_allclose(places_of(result), places, atol=1.0)


def test_curves_that_are_no_wires_for_certain_do_not_vote_on_supports() -> None:
    wires, _ = valley([14.0, 10.6, 9.0, 10.6, 14.0], 0.6)
    twigs = [bar((84, 6 + k, 12), (96, 6 + k, 12), 2.0, seed=k) for k in range(6)]
    air = Airborne.of(np.vstack([*wires, *twigs]))
    corridor = Corridor(
        air, air.xyz[:, 2], np.ones(len(air.xyz), bool), 0.25, lambda x, y: 0.0, lambda x, y: True
    )
    pieces = []
    for way, low, high in (((-1.0, -0.33, 0.33, 1.0), 0, 180), (range(6, 12), 84, 96)):
        for y in way:
            line_of = (abs(air.xyz[:, 1] - y) < 0.2) & (air.xyz[:, 0] > low)
            line_of &= (air.xyz[:, 0] < high) & (air.xyz[:, 2] > 8.5)
            points = np.flatnonzero(line_of)
            curve = fit(air.xyz[points], spread=2.0)
            assert curve is not None
            pieces.append(Piece(points, curve, sure=high == 180))
    _, alignments = arcs_of(corridor, list(alignments_among(corridor, pieces)))
    assert len(alignments) == 1
    inner = alignments[0].cuts[(alignments[0].cuts > 10) & (alignments[0].cuts < 170)]
    np.testing.assert_allclose(inner, [45, 90, 135], atol=3)


@pytest.mark.parametrize("together", [1, 3])
def test_a_line_of_any_length_has_a_whole_number_of_bins(together: int) -> None:
    """One in forty lengths over 1 km is a little more than a thousand of its thousandths."""
    nothing = np.zeros((0, 3))
    corridor = Corridor(
        Airborne.of(nothing), np.zeros(0), np.zeros(0, bool), 0.25, lambda x, y: 0.0, bool
    )
    for length in np.random.default_rng(0).uniform(100, 3000, 400).tolist():
        along = wire((0, 0, 16), (length, 0, 16), 400, per_metre=0)[0]
        alignment = Alignment.of([Piece(np.zeros(0, np.int64), along)])
        assert alignment.steps <= 1000
        assert alignment.step * alignment.steps >= length + 2 - 1e-9  # a metre beyond both ends
        assert len(binned(corridor, alignment, [], together, 0.0).u) == math.ceil(
            alignment.steps / together
        )


def test_close_wires_that_are_no_bundle_are_found_once() -> None:
    _, wires, poles = line([0, 45, 90, 135], [-1, -0.33, 0.33, 1], 9, 400, per_metre=12)
    assert len(found(GROUND, *wires, poles).wires.frame) == 12


def test_a_wire_known_along_a_short_way_is_followed_by_the_shape_of_the_others() -> None:
    _, wires, poles = line([0, 60, 120], [-1, 0, 1], 9, 400)
    x = wires[0][:, 0]
    few = (x < 12) | (np.arange(len(x)) % 16 == 0)  # one point in four metres
    result = found(GROUND, wires[0][few], *wires[1:], poles)
    frame = result.wires.frame
    assert len(frame) == 6
    true = wire((0, -1, 9), (60, -1, 9), 400)[0].points(np.linspace(1, 59, 30)) + CORNER
    away = [np.abs(_height(shape, true) - true[:, 2]).max() for shape in frame.geometry]
    assert min(away) < 0.1


def test_a_wire_with_a_point_in_four_metres_is_followed_together_with_those_beside_it() -> None:
    curves, wires, poles = line([0, 45, 90, 135, 180], [-1, 0, 1], 9, 400, per_metre=0.25)
    shapes = found(GROUND, *wires, poles).wires.frame.geometry
    assert len(shapes) == 12
    for curve in curves:
        true = curve.points(np.linspace(1, 44, 20)) + CORNER
        assert min(np.abs(_height(shape, true) - true[:, 2]).max() for shape in shapes) < 0.15


def test_a_wire_of_three_points_goes_on_from_the_next_spans() -> None:
    curves, wires, poles = line([0, 45, 90, 135], [-1, 0, 1], 9, 400, per_metre=0.6)
    wires[4] = wires[4][[4, 12, 20]]
    shapes = found(GROUND, *wires, poles).wires.frame.geometry
    assert len(shapes) == 9
    true = curves[4].points(np.linspace(1, 44, 20)) + CORNER
    assert min(np.abs(_height(shape, true) - true[:, 2]).max() for shape in shapes) < 0.15


def test_wires_go_on_as_far_as_those_beside_them_where_no_pole_is_seen() -> None:
    _, wires, poles = line([0, 45, 90], [-1, 0, 1], 9, 400)
    poles = poles[poles[:, 0] < 80]
    wires[3] = wires[3][wires[3][:, 0] < 84]
    ends = [max(shape.coords)[0] for shape in found(GROUND, *wires, poles).wires.frame.geometry]
    assert sum(end > CORNER[0] + 89 for end in ends) == 3


@pytest.mark.parametrize("unseen", [0.0, 6.0], ids=["seen", "last metres not seen"])
def test_each_wire_goes_on_to_where_the_data_end(unseen: float) -> None:
    """They end obliquely, so no wire ends where the one beside it does."""
    _, wires, towers = line([0, 120, 240], [-6, 0, 6], 25, 900)
    towers = towers[towers[:, 0] < 200]
    edge = 180.0

    def within(part: Floats, back: float) -> Floats:
        return part[part[:, 0] + part[:, 1] < edge - back]

    inside = [within(part, unseen) for part in wires]
    result = found(within(ground(240, 60, 4), 0.0), *(part for part in inside if len(part)), towers)
    ends = np.array([max(shape.coords)[:2] for shape in result.wires.frame.geometry]) - CORNER[:2]
    ends = ends[ends[:, 0] > 130]
    assert len(ends) == 3
    beyond = ends.sum(axis=1) - edge
    assert beyond.min() > -0.5
    assert beyond.max() < 5.0  # data are seen in cells of 2 m and beside them


def test_a_tree_over_the_edge_of_the_data_does_not_make_it_a_support() -> None:
    _, wires, towers = line([0, 120, 240], [-4, 0, 4], 25, 900)
    towers = towers[towers[:, 0] < 200]
    inside = [part[part[:, 0] < 180] for part in (ground(240, 60, 4), *wires)]
    crown = tree(183, 4, 16, 7, 3000)
    result = found(*inside, towers, crown)
    np.testing.assert_allclose(places_of(result), [0, 120], atol=1.0)


def test_a_wire_that_ends_at_a_pole_does_not_go_on() -> None:
    _, wires, poles = line([0, 45, 90, 135], [-1, 0, 1], 9, 400, per_metre=2)
    assert len(found(GROUND, *wires[:-1], poles).wires.frame) == 8


def test_a_bundle_whose_towers_are_not_in_the_data_is_found() -> None:
    _, wires, _ = line([0, 180], [-4, 4], 25, 1200)
    twins = [part + np.array([0, 0.4, 0]) for part in wires]
    assert len(found(GROUND, *wires, *twins).wires.frame) == 4


def test_many_low_points_do_not_make_grass_a_tower() -> None:
    _, wires, poles = line([0, 60, 120, 180], [-1, 0, 1], 9, 400)
    rng = np.random.default_rng(5)
    plan = rng.uniform((30, -20), (90, 20), (140_000, 2))
    grass = np.column_stack([plan, np.sin(plan[:, 0] / 40) + rng.normal(0, 0.03, len(plan))])
    grass[::7, 2] += rng.uniform(0, 0.6, 20_000)
    low = rng.uniform((30, -20, -13), (90, 20, -3), (400, 3))
    points = cloud(GROUND, grass, *wires, poles, low, classes=[2, 3, *[14] * 9, 15, 7])
    result = CorridorExtract(points=points).run().classified
    assert quality(result["classification"] == 15, points["truth"] == 15) > 0.85


@pytest.mark.parametrize(("string", "arm"), [(0.3, 9.0), (0.0, 9.4)], ids=["pull", "hang"])
def test_arms_are_of_the_pole_and_wires_below_them_are_not(string: float, arm: float) -> None:
    """Wires pull at arms of their own height, by insulators in line with them, or hang below."""
    positions, offsets = (0.0, 60.0, 120.0), (-1.0, 0.0, 1.0)
    wires = [
        wire((a + string, y, 9), (b - string, y, 9), 400, seed=int(a))[1]
        for a, b in itertools.pairwise(positions)
        for y in offsets
    ]
    poles = np.vstack([pole(x, 0, arm + 0.4, half=1.3) for x in positions])
    points = cloud(GROUND, *wires, poles, classes=[2, *[14] * 6, 15])
    result = CorridorExtract(points=points).run()
    said, true = result.classified["classification"], points["truth"]
    arms = (true == 15) & (abs(points.xyz[:, 2] - CORNER[2] - arm) < 0.3)
    ends = (true == 14) & (abs((points.xyz[:, 0] - CORNER[0] + 30) % 60 - 30) < 0.25)
    assert (said[arms] == 15).all()
    assert (said[ends] == 14).sum() >= 0.9 * ends.sum()
    assert quality(said == 14, true == 14) > 0.98
    if string:
        assert (result.towers.frame.string > 0).all()
    else:
        assert result.towers.frame.string.isna().all()  # how long hanging ones are is not seen
    assert result.wires.frame.span.between(59, 60.1).all()


def moved(points: Floats, support: Support, slope: float = 0.0) -> Support:
    """A support moved to points, on ground that rises along x by a slope from x = 20."""
    air, may = Airborne.of(points), np.ones(len(points), bool)
    corridor = Corridor(
        air, air.xyz[:, 2], may, 0.25, lambda x, y: slope * (x - 20.0), lambda x, y: True
    )
    return centred(corridor, support)


def test_the_foot_of_a_support_is_on_the_ground_where_it_was_moved_to() -> None:
    """It had the elevation of the place it was moved from, 0.46 m off on a slope of 13 %."""
    found = moved(
        pole(21.2, 20.0, 10.0), Support(20.0, 20.0, (0.0, 1.0), (-1, 1), 9.6, 9.6, 0.0, 0.0), 0.13
    )
    assert found.ground == pytest.approx(0.13 * (found.x - 20.0))
    assert found.x == pytest.approx(21.2, abs=0.1)


@pytest.mark.parametrize("turn", [0, 1])
def test_a_support_is_moved_to_its_arms_along_the_line_and_to_its_pole_across(turn: int) -> None:
    points = pole(21.2, 20.3, 10.0)[:, [1, 0, 2] if turn else [0, 1, 2]]
    across = (1.0, 0.0) if turn else (0.0, 1.0)
    found = moved(points, Support(20.0, 20.0, across, (-1.0, 1.0), 9.6, 9.6, 0.0, 0.0))
    place = (found.y, found.x) if turn else (found.x, found.y)
    np.testing.assert_allclose(place, (21.2, 20.3), atol=0.1)
    np.testing.assert_allclose(found.reach, (-1.3, 0.7), atol=0.1)


def test_the_middle_of_a_hollow_body_is_between_its_faces_however_many_points_they_have() -> None:
    legs = [
        bar((20 + x, 20.5 + y, 0), (20 + x, 20.5 + y, 36), n) for x in (-1, 1) for y, n in FACES
    ]
    found = moved(np.vstack(legs), Support(20.0, 20.0, (0.0, 1.0), (-5, 5), 32.0, 40.0, 0.0, 1.0))
    np.testing.assert_allclose((found.x, found.y), (20.0, 20.5), atol=0.2)


@pytest.mark.parametrize("beam", [True, False])
def test_a_frame_stands_on_two_legs_and_two_poles_are_none(beam: bool) -> None:
    """A support at the left one of two posts, with wires between them."""
    posts = [bar((20, 20 + y, 0), (20, 20 + y, 14), 6) for y in (0, 10)]
    arms = [
        bar((20, 20 + y, 14), (20, 20 + y + reach, 14), 6)
        for y, reach in ([(0, 10)] if beam else [(0, 2), (10, -2)])
    ]
    support = Support(20.0, 20.0, (0.0, 1.0), (1.0, 9.0), 12.5, 12.5, 0.0, 1.0)
    found = moved(np.vstack([*posts, *arms]), support)
    np.testing.assert_allclose((found.x, found.y), (20.0, 25.0 if beam else 20.0), atol=0.3)
    np.testing.assert_allclose(found.legs, (-5.0, 5.0) if beam else (0.0,), atol=0.3)


def test_a_v_of_two_masts_stands_where_they_meet() -> None:
    masts = [bar((20, 20, 0), (20, 20 + y, 35), 2) for y in (-5, 5)]
    support = Support(20.0, 24.0, (0.0, 1.0), (-12.5, 4.5), 35.0, 35.0, 0.0, 1.0)
    found = moved(np.vstack(masts), support)
    np.testing.assert_allclose((found.x, found.y), (20.0, 20.0), atol=0.5)


def test_the_points_of_a_frame_are_of_its_tower() -> None:
    _, wires, _ = line([0, 180], [-4, 0, 4], 14, 1200)
    frames = [
        bar(*ends, 12)
        for x in (0, 180)
        for ends in (
            ((x, -5.5, 0.9), (x, -5.5, 15.5)),
            ((x, 5.5, 0.9), (x, 5.5, 15.5)),
            ((x, -5.5, 15.0), (x, 5.5, 15.0)),
        )
    ]
    points = cloud(GROUND, *wires, *frames, classes=[2, *[14] * 3, *[15] * 6])
    result = CorridorExtract(points=points).run()
    feet = np.column_stack([result.towers.frame.geometry.x, result.towers.frame.geometry.y])
    np.testing.assert_allclose(feet - CORNER[:2], [[0, 0], [180, 0]], atol=0.7)
    assert np.mean(result.classified["classification"][points["truth"] == 15] == 15) > 0.9


def test_the_feet_of_a_slim_lattice_tower_are_its_own() -> None:
    _, wires, arms = line([0, 180], [-4, 0, 4], 25, 1200)
    corners = [(i, j) for i in (-1, 1) for j in (-1, 1)]
    legs = [
        bar((x + 1.5 * i, 1.5 * j, 1.6), (x + 0.3 * i, 0.3 * j, 25), 8)
        for x in (0, 180)
        for i, j in corners
    ]
    points = cloud(GROUND, *wires, arms, *legs, classes=[2, *[14] * 3, 0, *[15] * 8])
    result = CorridorExtract(points=points).run()
    assert list(result.towers.frame.kind) == ["tower", "tower"]
    wires = result.wires.frame
    for tower in result.towers.frame.itertuples():  # it was where wires had been followed to
        ends = [*wires.z_start[wires.from_tower == tower.tower_id]]
        ends += [*wires.z_end[wires.to_tower == tower.tower_id]]
        assert (tower.low_wire, tower.high_wire) == pytest.approx((min(ends), max(ends)))
    assert np.mean(result.classified["classification"][points["truth"] == 15] == 15) > 0.95


def test_a_tree_around_a_pole_is_no_tower() -> None:
    _, wires, poles = line([0, 60, 120], [-1, 0, 1], 9, 400)
    around = tree(60, 0, 8.0, 2.5, 600)
    points = cloud(GROUND, *wires, poles, around, classes=[2, *[14] * 6, 15, 5])
    result = CorridorExtract(points=points).run()
    said = result.classified["classification"]
    assert result.tower_count == 3
    assert np.mean(said[points["truth"] == 5] == 15) < 0.1
    assert np.mean(said[points["truth"] == 15] == 15) > 0.8


def arcs_of_tracks(heights: Floats) -> Binned:
    """Tracks with a point each metre, whose heights are the columns of an array."""
    u = np.broadcast_to(np.arange(len(heights))[:, None] + 0.5, heights.shape).copy()
    sure = np.full(heights.shape, 400.0)
    return Binned(1.0, sure, sure, u, heights, np.zeros(heights.shape))


@pytest.mark.parametrize(
    ("c", "sigma", "expected"),
    [(2000, 0.2, [[300, 320], [600, 600]]), (100, 0.02, [[300, 300], [320, 320], [600, 600]])],
    ids=["strings of noisy bundles", "a short span of low wires"],
)
def test_two_cuts_are_of_one_support_where_no_span_is_known_between_them(
    c: float, sigma: float, expected: list[list[float]]
) -> None:
    """Strings of a bundle pull it level: it is cut at both of their ends."""
    edges = np.array([0, 300, 320, 600, 900])
    arcs = [np.arange(b - a) + 0.5 - (b - a) / 2 for a, b in itertools.pairwise(edges)]
    bins = arcs_of_tracks(np.column_stack([0.5 * np.concatenate(arcs) ** 2 / c] * 4))
    bins = replace(bins, tall=np.full(bins.u.shape, 1 / sigma**2))
    assert held_within(bins, edges, 1 / c).tolist() == expected


def test_lines_have_supports_apart_only_where_these_cannot_be_the_same() -> None:
    strings, one = np.array([[295.0, 315.0]]), np.array([[306.0, 306.0]])
    assert not mostly_apart(strings, one)
    assert not mostly_apart(one, strings)
    assert mostly_apart(strings + 40, one)
    assert mostly_apart(one, strings - 40)


def test_a_catenary_is_no_parabola_where_spans_are_long_and_steep() -> None:
    """On 600 m with a slope of 0.3 they differ by 25 cm."""
    curve, _ = wire((0, 0, 0), (600, 0, 180), 1400, per_metre=0)
    heights = curve.height(np.arange(600) + 0.5)[:, None]
    off = misfits(arcs_of_tracks(heights), np.array([0]), np.array([600]), 1 / 1400)
    assert off[0, 0] < 1.0  # squares of sigmas of 5 cm


def test_how_far_wires_wander_is_learned() -> None:
    rng = np.random.default_rng(3)
    for wander in (0.0, 0.05):
        stray = np.repeat(rng.normal(0, wander, (40, 3)), 25, axis=0)
        heights = 1500 * np.cosh((np.arange(1000)[:, None] - 499.5) / 1500) + stray
        noise = rng.normal(0, 0.05, heights.shape)
        learned = wander_of(arcs_of_tracks(heights + noise), np.array([0, 1000]), 1 / 1500)
        assert learned == pytest.approx(np.hypot(wander, 0.05 / 5), rel=0.25)


@pytest.mark.parametrize(
    ("bare", "weight", "arm", "kept"),
    [
        (True, 400.0, 0.0, False),
        (False, 400.0, 0.0, False),
        (False, 400.0, 60.0, True),
        (True, 0.01, 0.0, False),
        (False, 0.01, 0.0, True),
    ],
    ids=["nothing seen", "known as a tree is", "a sure arm", "nothing seen, noisy", "known, noisy"],
)
def test_no_support_is_where_wires_do_not_bend_unless_an_arm_is_seen_and_this_is_unsure(
    bare: bool, weight: float, arm: float, kept: bool
) -> None:
    u = np.arange(900) + 0.5
    heights = np.column_stack([0.5 * (u % 300 - 150) ** 2 / 1500] * 3)
    bins, edges = arcs_of_tracks(heights), np.array([0, 150, 300, 600, 900])
    bins = replace(bins, tall=np.full(heights.shape, weight))
    found = bending(bins, edges, 1 / 1500, np.full(901, bare), np.full(901, arm)).tolist()
    assert found == (edges.tolist() if kept else [0, 300, 600, 900])


@pytest.mark.parametrize(
    ("supports", "tree", "share", "bare", "kept"),
    [
        ((0, 60, 120, 180), 80, 0.1, True, False),
        ((0, 60, 120, 180), 80, math.nan, True, False),
        ((0, 60, 120, 180), 80, 0.1, False, True),
        ((0, 60, 120, 180), 80, 0.6, True, True),
        ((0, 40, 100, 140), 60, 0.1, True, True),
    ],
    ids=["as others", "not known", "seen as trees are", "bent", "longer than others"],
)
def test_a_span_as_long_as_others_is_parted_only_where_its_wires_rather_bend_than_not(
    supports: tuple[int, ...], tree: int, share: float, bare: bool, kept: bool
) -> None:
    """Noisy wires of a span bend by a share of what they do at supports, or are not seen."""
    bend, u = 1 / 400, np.arange(supports[-1]) + 0.5
    arcs = [np.arange(b - a) + 0.5 - (b - a) / 2 for a, b in itertools.pairwise(supports)]
    heights = 0.5 * bend * np.concatenate(arcs) ** 2
    if not math.isnan(share):
        heights -= share * 0.5 * 60 * bend * np.clip(u - tree, 0, None)
    bins = arcs_of_tracks(np.column_stack([heights] * 3))
    bins = replace(bins, tall=np.full(bins.u.shape, 2.0))
    if math.isnan(share):
        bins.tall[tree : tree + 40] = 0.0
    every, edges = np.full(len(u) + 1, bare), np.array(sorted((*supports, tree)))
    found = bending(bins, edges, bend, every, np.zeros(len(u) + 1))
    assert found.tolist() == (edges.tolist() if kept else list(supports))


@pytest.mark.parametrize("edges", [[0, 97, 118, 200], [0, 82, 103, 200]])
def test_cuts_that_come_nearer_than_two_supports_can_be_are_one(edges: list[int]) -> None:
    """Of three wires with a support at 100 m; the cut in the span makes an arc of its own."""
    u = np.arange(200) + 0.5
    bins = arcs_of_tracks(np.column_stack([0.5 * (u % 100 - 50) ** 2 / 400] * 3))
    chainages = np.arange(0.0, 200.25, 0.25)
    cuts, _ = all_settled(bins, np.array(edges), 1 / 400, chainages, np.zeros(len(chainages)))
    np.testing.assert_allclose(cuts, [100], atol=1.0)


@pytest.mark.parametrize("edge", [90, 110])
def test_a_support_may_be_anywhere_where_its_wires_are_not_seen(edge: int) -> None:
    u = np.arange(200) + 0.5
    bins = arcs_of_tracks(np.column_stack([0.5 * (u % 100 - 50) ** 2 / 400] * 3))
    bins.tall[88:112] = bins.flat[88:112] = 0.0
    chainages = np.arange(0.0, 200.25, 0.25)
    edges = np.array([0, edge, 200])
    cuts, _ = all_settled(bins, edges, 1 / 400, chainages, np.zeros(len(chainages)))
    np.testing.assert_allclose(cuts, [100], atol=1.0)


@pytest.mark.parametrize("places", [(20, 80, 140), (0, 60, 120, 180)], ids=["apart", "abreast"])
def test_lines_side_by_side_have_supports_where_each_of_them_is_held(
    places: tuple[float, ...],
) -> None:
    lines = (0.0, 60.0, 120.0, 180.0), places
    parts = [GROUND]
    for y, xs in zip((-8.0, 8.0), lines, strict=True):
        _, wires, poles = line(xs, [-1.5, 0, 1.5], 9, 400)
        parts += [part + np.array([0, y, 0]) for part in (*wires, poles)]
    frame = found(*parts).towers.frame
    feet = np.column_stack([frame.geometry.x, frame.geometry.y]) - CORNER[:2]
    for y, xs in zip((-8.0, 8.0), lines, strict=True):
        own = np.sort(feet[np.abs(feet[:, 1] - y) < 2, 0])
        np.testing.assert_allclose(own, xs, atol=1.0)


def test_a_single_track_that_changes_over_to_another_wire_makes_no_support() -> None:
    u = np.arange(100) + 0.5
    own = 10 + 0.5 * (u % 50 - 25) ** 2 / 400
    heights = np.column_stack([own] * 4)
    heights[30:, 3] += 0.8
    price = np.full(101, 34.0)
    bins = arcs_of_tracks(heights)
    edges = solved(bins, 1 / 400, price)[1]
    assert agreed(bins, edges, 1 / 400, price, price).tolist() == [0, 50, 100]


def test_the_curvature_of_the_line_parts_what_a_straight_arc_would_join() -> None:
    """Arcs that meet so that their sum is nearly straight, with a point in seven metres."""
    u = np.arange(42) + 0.5
    own = 0.5 * ((u % 21 - 10.5) ** 2 - 0.9 * (u - 21) ** 2) / 300
    bins = arcs_of_tracks(np.column_stack([own] * 3))
    bins.tall[np.arange(42) % 7 != 3] = bins.flat[np.arange(42) % 7 != 3] = 0.0
    edges = solved(bins, 1 / 300, np.full(43, 28.0))[1]
    assert len(edges) == 3
    assert abs(edges[1] - 21) <= 4


@pytest.mark.parametrize("turn", [0, 1])
def test_one_span_parallel_to_an_axis(turn: int) -> None:
    _, wires, towers = line([0, 180], [-4, 0, 4], 25, 1200)
    parts = [part[:, [1, 0, 2]] if turn else part for part in (GROUND, *wires, towers)]
    result = found(*parts)
    assert (result.span_count, result.tower_count, len(result.wires)) == (1, 2, 3)


def test_lines_that_cross_keep_apart() -> None:
    _, low, poles = line([0, 180], [-1, 0, 1], 9, 1500)
    _, high, towers = line([-90, 90], [-3, 0, 3], 22, 900)
    plan = np.random.default_rng(2).uniform((-20, -100), (200, 100), (120_000, 2))
    flat = np.column_stack([plan, np.sin(plan[:, 0] / 40)])
    across = [np.column_stack([p[:, 1] + 80, p[:, 0], p[:, 2]]) for p in (*high, towers)]
    frame = found(flat, *low, poles, *across).wires.frame
    assert sorted(frame.groupby("span_id").size()) == [3, 3]


def test_a_gap_is_bridged_and_vertical_drops_do_no_harm() -> None:
    _, wires, poles = line([0, 60, 120, 180], [-1, 0, 1], 9, 400)
    gappy = [p[(abs(p[:, 0] - 92) > 8)] for p in wires]
    drops = [bar((x, y, 5), (x, y, 9), 6, 0.02) for x in (30.0, 90.0) for y in (-1.0, 1.0)]
    result = found(GROUND, *gappy, poles, *drops)
    assert result.span_count == 3
    assert len(result.wires) == 9


def sheet(low: float, high: float) -> Floats:
    """A vertical sheet along the x axis."""
    x = RNG.uniform(0, 200, 4000)
    z = np.sin(x / 40) + RNG.uniform(low, high, len(x))
    return np.column_stack([x, 3 + RNG.normal(0, 0.03, len(x)), z])


def gable(ridge: bool) -> Floats:
    x, y = RNG.uniform(60, 120, 20_000), RNG.uniform(-6, 6, 20_000)
    roof = np.column_stack([x, y, 9 - 0.66 * abs(y) + RNG.normal(0, 0.03, len(x))])
    return np.vstack([roof, bar((60, 0, 9.3), (120, 0, 9.3), 6, 0.04)]) if ridge else roof


def eaves() -> Floats:
    """A slope of a roof that sags, as it does in heights above a ground that bulges below it."""
    x, y = RNG.uniform(60, 120, 1440), RNG.uniform(-6, 0, 1440)
    z = 8 - 0.5 * y - 1.2 * (1 - ((x - 90) / 30) ** 2)
    return np.column_stack([x, y, z + RNG.normal(0, 0.04, len(x))])


def trees(count: int) -> Floats:
    heights = RNG.uniform(8, 14, 30)
    return np.vstack([tree(7 * k, 2, h, 0.28 * h, count, k) for k, h in enumerate(heights)])


def twigs() -> Floats:
    """A chain of twigs along an arc, and three times as many around it."""
    rng = np.random.default_rng(1)
    curve, chain = wire((60, 0, 9), (120, 0, 10), 150, per_metre=1.0, noise=0.07)
    away, turn = np.sqrt(rng.uniform(0.3**2, 1.5**2, 180)), rng.uniform(0, 2 * np.pi, 180)
    aside = np.column_stack([np.zeros(180), away * np.cos(turn), away * np.sin(turn)])
    return np.vstack([chain, curve.points(rng.uniform(0, 60, 180)) + aside])


def tower_crane(per_metre: float) -> Floats:
    bars = [bar((60 + dx, dy, 0), (60 + dx, dy, 42), per_metre) for dx in (0, 2) for dy in (0, 2)]
    chords = [(0, 40), (2, 40), (1, 41.6)]
    bars += [bar((60, y, z), (120, y, z), per_metre) for y, z in chords]
    bars += [
        bar((60 + 2 * k, 2 * (k % 2), 40), (62 + 2 * k, 1, 41.6), per_metre) for k in range(30)
    ]
    ties = [(100, 41.6), (118, 41.6)]
    bars += [bar((60, 1, 50), (x, 1, z), per_metre, 0.03) for x, z in ties]
    return np.vstack(bars)


def railway(per_metre: float) -> Floats:
    """Contact wires held level by droppers from a messenger wire that sags."""
    parts = []
    for a in (0, 60, 120):
        parts.append(bar((a, 0, 6.5), (a + 60, 0, 6.5), per_metre, 0.02))
        curve, points = wire((a, 0, 8.0), (a + 60, 0, 8.0), 600, per_metre)
        parts.append(points)
        for k in range(5, 60, 6):
            top = float(curve.height(np.array(k)))
            parts.append(bar((a + k, 0, 6.5), (a + k, 0, top), per_metre, 0.02))
    for a in (0, 60, 120, 180):
        parts += [bar((a, -3, 0), (a, -3, 8.5), 10), bar((a, -3, 8), (a, 0, 8), 8)]
    return np.vstack(parts)


def bridge() -> Floats:
    """Two main cables with hangers to a deck."""
    parts = []
    for y in (-6, 6):
        curve, points = wire((40, y, 40), (160, y, 40), 64, 8, noise=0.12)
        parts.append(points)
        for k in range(5, 120, 5):
            top = float(curve.height(np.array(k)))
            parts.append(bar((40 + k, y, 10), (40 + k, y, top), 8, 0.04))
        parts += [bar((x, y, 0), (x, y, 41), 20, 0.6) for x in (40, 160)]
        parts += [bar((x, y, 10), (near, y, 40), 8, 0.12) for x, near in ((0, 40), (200, 160))]
    deck = RNG.uniform((0, -7), (200, 7), (22_000, 2))
    return np.vstack([*parts, np.column_stack([deck, RNG.normal(10, 0.03, len(deck))])])


def ropeway() -> Floats:
    """Two ropes on masts, and a chair below each of them every 18 m."""
    parts = []
    for a in (0, 90):
        for y in (-2.6, 2.6):
            curve, points = wire((a, y, 14), (a + 90, y, 14), 900, 3)
            parts.append(points)
            for k in range(9, 90, 18):
                low = float(curve.height(np.array(k))) - 2.5
                chair = RNG.uniform((a + k - 0.5, y - 0.5, low - 0.3), (a + k + 0.5, y + 0.5, low))
                parts.append(np.array([chair + RNG.uniform(-0.4, 0.4, 3) for _ in range(14)]))
    for x in (0, 90, 180):
        parts += [bar((x, 0, 0), (x, 0, 14), 10, 0.1), bar((x, -2.8, 14), (x, 2.8, 14), 8)]
    return np.vstack(parts)


def trellis() -> Floats:
    """A hop garden: wires over poles in both directions, tied where they cross."""
    rows = [wire((20, y, 6.5), (76, y, 6.5), 400, 3)[1] for y in range(-21, 22, 6)]
    columns = [bar((x, -21, 6.0), (x, 21, 6.0), 3, 0.03) for x in range(24, 76, 8)]
    return np.vstack([*rows, *columns])


def hung_roadway() -> Floats:
    """The cables of a bridge, that sag by a ninth of their span, and its deck; no hangers seen."""
    cables = [wire((30, y, 30), (150, y, 30), 150, 8)[1] for y in (-4.2, 4.2)]
    posts = [bar((x, y, 0), (x, y, 30), 20, 0.5) for x in (30, 150) for y in (-4.2, 4.2)]
    deck = RNG.uniform((0, -4, 15.5), (190, 4, 15.5), (20_000, 3))
    return np.vstack([*cables, *posts, deck + RNG.normal(0, 0.03, deck.shape)])


@pytest.mark.parametrize(
    ("what", "parts"),
    [
        ("ropeway", [ropeway()]),
        ("trellis", [trellis()]),
        ("deck on cables", [hung_roadway()]),
        ("fence", [sheet(0, 2.5)]),
        ("high wall", [sheet(0, 5.5)]),
        ("handrail on a wall", [sheet(0, 4.5), bar((0, 3, 5.6), (200, 3, 5.6), 4, 0.03)]),
        ("row of trees", [trees(600)]),
        ("sparse row of trees", [trees(60)]),
        ("chain of twigs", [twigs()]),
        ("gable", [gable(ridge=False)]),
        ("gable with a ridge cap", [gable(ridge=True)]),
        ("gable that sags", [eaves()]),
        ("tower crane", [tower_crane(6)]),
        ("sparse tower crane", [tower_crane(2)]),
        ("railway", [railway(4)]),
        ("sparse railway", [railway(1.5)]),
        ("bridge", [bridge()]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_no_power_line(what: str, parts: list[Floats]) -> None:
    below = np.ones(len(GROUND), bool)
    if "gable" in what:  # nothing is seen below a roof
        below = ~((abs(GROUND[:, 0] - 90) < 30) & (abs(GROUND[:, 1]) < 6))
    result = found(GROUND[below], *parts)
    assert len(result.wires) == 0
    assert not np.isin(result.classified["classification"], (14, 15)).any()


def roofs_in_rows(step: float) -> Floats:
    """Ground and two roofs that sag, in rows along them: points 1 m apart along, `step` across."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(-20, 220, 1.0), np.arange(-60, 60, step))
    xy = np.column_stack([x.ravel(), y.ravel()]) + rng.normal(0, 0.05, (x.size, 2))
    z = np.zeros(len(xy))
    for west, east, middle in ((0, 60, 12), (80, 150, 17)):
        on = (xy[:, 0] > west) & (xy[:, 0] < east) & (abs(xy[:, 1] - middle) < 7)
        away = (xy[on, 0] - (west + east) / 2) / ((east - west) / 2)
        z[on] = 7 + 0.5 * (7 - abs(xy[on, 1] - middle)) + 0.35 * away**2
    return np.column_stack([xy, z + rng.normal(0, 0.03, len(xy))])


@pytest.mark.parametrize("step", [1.05, 2.1])
def test_rows_of_sparse_points_on_roofs_are_no_wires(step: float) -> None:
    """They stand as alone as wires do, but nothing is seen below."""
    result = found(roofs_in_rows(step))
    assert (len(result.wires), result.tower_count) == (0, 0)


def test_a_line_over_water_is_found() -> None:
    """Nothing is seen below, but nothing is beside it either."""
    _, wires, poles = line([0, 60, 120, 180], [-1, 0, 1], 9, 400)
    land = GROUND[abs((GROUND[:, 0] + 30) % 60 - 30) < 8]  # around the poles
    result = found(land, *wires, poles)
    assert len(result.wires) == 9
    assert result.span_count == 3


@pytest.mark.parametrize("seen", [True, False], ids=["seen", "not seen"])
def test_supports_that_only_their_wires_tell_of_are_said(
    seen: bool, caplog: pytest.LogCaptureFixture
) -> None:
    _, wires, poles = line([0, 60, 120, 180], [-1, 0, 1], 9, 400)
    shown = poles if seen else poles[abs(poles[:, 0] - 60) > 5]
    result = found(GROUND, *wires, shown)
    assert result.tower_count == 4
    text = "1 of 4 towers show fewer than 4 points of their own (tower_id 2)"
    assert (text in caplog.text) == (not seen)
    assert ("of their own" in caplog.text) == (not seen)


@pytest.mark.parametrize(("noise", "told"), [(0.03, False), (0.18, True)])
def test_wires_that_scatter_as_bundles_do_are_told(
    noise: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Nobody said that points lie 0.2 m about the wires of which clearances are measured."""
    wires = [
        wire((a, y, 9.0), (a + 60.0, y, 9.0), 400.0, noise=noise, seed=k)[1]
        for k, (a, y) in enumerate((a, y) for a in (0.0, 60.0, 120.0) for y in (-3.0, 0.0, 3.0))
    ]
    poles = line([0, 60, 120, 180], [-3, 0, 3], 9, 400)[2]
    result = found(GROUND, *wires, poles)
    assert len(result.wires) == 9
    assert ("of 9 wires lie 0.15 m and more from them (rms, up to 0." in caplog.text) is told


def test_a_pole_of_which_the_foot_alone_shows_is_as_high_as_its_wires() -> None:
    _, wires, poles = line([0, 60, 120], [-1, 0, 1], 9, 400)
    hidden = (abs(poles[:, 0] - 60) < 5) & (poles[:, 2] > 3.0)
    towers = found(GROUND, *wires, poles[~hidden]).towers.frame
    assert len(towers) == 3
    assert (towers["height"] > 7.9).all()  # the ground is up to 1 m high


@pytest.mark.parametrize("body", [True, False])
def test_a_pole_of_which_no_body_is_seen_is_not_certain(
    body: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """What is level with the wires may be twigs."""
    _, wires, poles = line([0, 60, 120, 180], [-1, 0, 1], 9, 400)
    hidden = (abs(poles[:, 0] - 60) < 5) & (poles[:, 2] < 8.4)
    towers = found(GROUND, *wires, poles if body else poles[~hidden]).towers.frame
    assert (towers["points"] >= 4).all()
    assert (towers["sd_along"] < 1.0).all()
    assert towers["certain"].tolist() == [1, int(body), 1, 1]
    text = "tower_id 2: there are points level with the wires, but none of a body below them"
    assert (text in caplog.text) == (not body)


@pytest.mark.parametrize("count", [10, 400])
def test_a_pole_with_as_many_points_around_it_is_not_certain(
    count: int, caplog: pytest.LogCaptureFixture
) -> None:
    """In woods trees at the wires were told to be certain poles, metres from where one stands."""
    _, wires, poles = line([0, 60, 120, 180], [-1, 0, 1], 9, 400)
    rng = np.random.default_rng(8)
    crown = rng.uniform((58.7, -1.3, 1.5), (61.3, 1.3, 7.5), (count, 3))
    towers = found(GROUND, *wires, poles, crown).towers.frame
    assert towers["certain"].tolist() == [1, int(count < 100), 1, 1]
    assert ("tower_id 2: there are points level with the wires" in caplog.text) == (count > 100)


@pytest.mark.parametrize(
    ("per_metre", "noise", "told"), [(8, 0.03, False), (1, 0.2, True)], ids=["many", "few"]
)
def test_how_well_the_place_of_a_support_along_the_line_is_known_is_said(
    per_metre: float, noise: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Wires tell of the inner ones alone; where they have few points, a place is hardly known."""
    _, wires, poles = line([0, 60, 120, 180], [-1, 1], 9, 700, per_metre=per_metre)
    rng = np.random.default_rng(1)
    wires = [part + rng.normal(0, noise, part.shape) * (0, 0, 1) for part in wires]
    ends = poles[abs(poles[:, 0] - 90) > 80]
    towers = found(GROUND, *wires, ends).towers.frame
    inner = towers[towers.geometry.x.sub(CORNER[0]).between(30, 150)]
    assert len(inner) == 2
    assert (inner["sd_along"] > 1.0).any() == told
    assert towers["certain"].sum() == len(towers) - len(inner)  # those with a body
    assert (inner["sd_along"] > 0.05).all()
    off = abs(inner.geometry.x - CORNER[0] - np.array([60, 120]))
    assert (off < 2.5 * inner["sd_along"]).all()
    said = "place along the line has a standard deviation" in caplog.text
    assert said == told


@pytest.mark.parametrize(
    ("tracks", "feet"),
    [(2, (20, 80, 140, 200)), (1, (10, 62, 112, 170, 205))],
    ids=["two tracks", "other spans"],
)
def test_a_line_beside_a_railway_is_found_without_the_railway(
    tracks: int, feet: Sequence[float], caplog: pytest.LogCaptureFixture
) -> None:
    """Its poles stand at other places than the masts, so what they share would be wrong."""
    _, wires, poles = line(list(feet), [-1, 0, 1], 9, 400)
    beside = [part + np.array([-10.0, 12.0, 0.0]) for part in (*wires, poles)]
    rails = [railway(4) - np.array([0.0, 4.5 * k, 0.0]) for k in range(tracks)]
    classes = [2, *[19] * tracks, *[14] * len(wires), 15]
    points = cloud(GROUND, *rails, *beside, classes=classes)
    result = CorridorExtract(points=points).run()
    said, true = result.classified["classification"], points["truth"]
    assert (result.span_count, result.tower_count) == (len(feet) - 1, len(feet))
    assert quality(said == 14, true == 14) > 0.97
    assert not (said[true == 19] == 14).any()
    assert "m of wires between" in caplog.text
    assert "a railway" in caplog.text


PAIR = (-0.22, 0.0), (0.22, 0.0)
SQUARE = (-0.22, -0.22), (0.22, -0.22), (-0.22, 0.22), (0.22, 0.22)


@pytest.mark.parametrize(
    ("bundle", "noise", "per_metre", "slope"),
    [
        (PAIR, 0.18, 1.7, 0.2),
        (PAIR, 0.1, 1.7, 0.5),
        (SQUARE, 0.03, 1.7, 0.2),
        (((0.0, 0.0),), 0.2, 3.0, 0.3),
    ],
    ids=["noisy pair", "steep pair", "four", "noisy single"],
)
def test_bundles_and_noisy_wires_in_hills_are_found_whole(
    bundle: Sequence[tuple[float, float]], noise: float, per_metre: float, slope: float
) -> None:
    """Phases 13 m apart on three long spans: one tower each, and no other."""
    points = in_hills(bundle, noise, per_metre, slope)
    result = CorridorExtract(points=points).run()
    said, true = result.classified["classification"], points["truth"]
    assert result.span_count == 3
    assert len(result.wires.frame) == 9 * len(bundle)
    assert quality(said == 14, true == 14) > 0.96
    own = result.classified["wire_id"], result.classified["span_id"]
    for row in result.wires.frame.itertuples():
        carried = np.count_nonzero((own[0] == row.wire_id) & (own[1] == row.span_id))
        assert carried == pytest.approx(row.points, rel=0.15)
    feet = np.sort(result.towers.frame.geometry.x - CORNER[0])
    for place in (430, 850):
        assert np.abs(feet - place).min() < 2
    assert len(feet) <= 4  # those at the ends of the data among them
    held = (true == 15) & (abs(points.xyz[:, 0] - CORNER[0] - 640) < 300)
    assert (said[held] == 15).mean() > 0.85  # with arms above their strings


def test_wires_that_wander_from_their_arcs_have_no_more_supports() -> None:
    points = in_hills(((0.0, 0.0),), 0.03, 1.7, 0.2)
    result = CorridorExtract(points=points).run()
    assert result.span_count == 3
    assert result.tower_count <= 4


def test_each_line_is_followed_at_a_tolerance_of_its_own() -> None:
    """Wires a metre above each other beside bundles that scatter as much."""
    low = [wire((200, 60, z), (280, 60, z), 500, 4, noise=0.02)[1] for z in (64.0, 65.0, 66.0)]
    poles = [bar((x, 60, 54), (x, 60, 66.5), 8, 0.05) for x in (200, 280)]
    points = in_hills(PAIR, 0.18, 1.7, 0.2, beside=(*low, *poles))
    frame = CorridorExtract(points=points).run().wires.frame
    assert np.count_nonzero(frame.span < 90) == 3
    assert np.count_nonzero(frame.span > 400) == 18


def test_short_wires_that_stand_alone_are_found() -> None:
    """As those from a pole to a house, of too few points to be sure by their number."""
    drops = [wire((90, 3 + k, 7.5), (112, -6 + k, 6.0), 90, 1.0, noise=0.1)[1] for k in (0, 2)]
    result = found(GROUND, *drops)
    assert len(result.wires.frame) == 2
    assert result.wires.frame.points.sum() > 0.8 * sum(map(len, drops))


def test_a_span_too_short_to_tell_that_it_sags_is_one_where_others_hold_it() -> None:
    def span(supports: tuple[int, int], points: Floats) -> list[tuple[Wire, int]]:
        curve = fit(points, spread=1.0)
        assert curve is not None
        return [(Wire(curve, supports, (0.0, curve.length), 0.25), 0)]

    sure = span((0, 1), wire((0, 0, 9), (60, 0, 9), 400)[1])
    few = wire((60, 0, 9), (80, 0, 9), 2000, per_metre=0.5)[1]
    beside, away = span((1, 2), few), span((3, 4), few + np.array([0, 50, 0]))
    straight = span((1, 5), bar((60, 0, 9), (120, 0, 9), 8, 0.02))
    air = Airborne.of(
        np.vstack([wire((0, 0, 9), (60, 0, 9), 400)[1], few, few + np.array([0, 50, 0])])
    )
    corridor = in_free_air(air)
    assert upheld(corridor, [sure, beside, away, straight]) == [sure, beside]


def in_free_air(air: Airborne) -> Corridor:
    """Points that all may be wire, 8 m above the ground."""
    count = len(air.xyz)
    return Corridor(
        air, np.full(count, 8.0), np.ones(count, bool), 0.25, lambda x, y: 0.0, lambda x, y: True
    )


@pytest.mark.parametrize("leaves", [0, 6000])
def test_a_wire_that_no_support_is_seen_to_hold_is_one_if_it_is_no_accident(leaves: int) -> None:
    """As thin or thick as it may be: its points scatter by 0.15 m."""
    _, points = wire((0, 0, 9), (30, 0, 9), 100, per_metre=1, noise=0.15)
    hedge = np.random.default_rng(3).uniform((0, -3, 5), (30, 3, 11), (leaves, 3))
    corridor = in_free_air(Airborne.of(np.vstack([points, hedge])))
    made = fit(points, spread=1.0)
    assert made is not None
    one = [(Wire(made, (-1, -1), (0.0, made.length), 0.25), 0)]
    assert bool(upheld(corridor, [one])) == (leaves == 0)


def test_an_axis_is_between_masts_that_lean_apart() -> None:
    """Ropes on one side had drawn it 4 m off, to one of the masts."""
    one, ropes = np.linspace(-0.5, 0.5, 14), np.array([-11.0, -10.5, -9.8])
    found = between_masts(np.concatenate([one, one + 7.8, ropes]), 3.7, 14.0)
    assert found == pytest.approx(3.9, abs=0.1)
    assert between_masts(one, 3.7, 14.0) is None, "one mast"
    assert between_masts(one, 0.1, 14.0) is None, "a pole"
    assert between_masts(np.concatenate([one, one + 7.8]), 1.5, 14.0) is None, "wires elsewhere"
    assert between_masts(np.array([0.0, 7.8]), 3.9, 14.0) is None, "few points"


@pytest.mark.parametrize(("tolerance", "found"), [(0.25, 1), (0.1, 0)])
def test_what_hangs_beside_a_stack_is_of_another_line(tolerance: float, found: int) -> None:
    """Wires of a street's other side were taken for some of a stack, and then lost there."""
    curve, points = wire((0, 0, 9), (40, 0, 9), 130, per_metre=1.0)
    _, other = wire((0, 9, 9), (40, 9, 9), 130, per_metre=1.0, seed=1)
    air = Airborne.of(np.vstack([points, other]))
    corridor = replace(in_free_air(air), tolerance=tolerance)
    wires = [Wire(curve, (0, 1), (0.0, 40.0), tolerance)]
    assert len(recovered(corridor, wires)) == found


@pytest.mark.parametrize("leaves", [0, 2000])
def test_a_wire_found_beside_others_stands_alone(leaves: int) -> None:
    """Among leaves there are points along any curve."""
    curve, points = wire((0, 0, 9), (60, 0, 9), 400, per_metre=0.5)
    rng = np.random.default_rng(3)
    hedge = rng.uniform((0, -3, 5), (60, 3, 11), (leaves, 3))
    corridor = in_free_air(Airborne.of(np.vstack([points, hedge])))
    one = Wire(curve, (-1, -1), (0.0, 60.0), 0.25)
    assert stands_alone(corridor, one, corridor.on([curve])) == (leaves == 0)


@pytest.mark.parametrize("turned", [1, -1])
def test_a_point_on_both_subconductors_of_a_bundle_is_of_the_nearer_one(turned: int) -> None:
    """They hang 0.45 m apart, and points scatter by 0.2 m: in whatever order they come."""
    made = [wire((0, aside, 9), (90, aside, 14), 900, noise=0.2) for aside in (0.0, 0.45)]
    corridor = in_free_air(Airborne.of(np.vstack([points for _, points in made])))
    curves = [replace(curve, rms=0.28) for curve, _ in made][::turned]
    wires = [
        Wire(curve, (-1, -1), (0.0, 90.0), 0.625, span=7, wire=k)
        for k, curve in enumerate(curves, 1)
    ]
    line = PowerLine(none_labelled(len(corridor.air.xyz)), wires)
    label_points(line, corridor, np.arange(len(corridor.air.xyz)))
    reached = [np.isin(np.arange(len(corridor.air.xyz)), on_wire(corridor, w)[0]) for w in wires]
    said, nearer = (
        line.labels["wire_id"],
        1 + np.argmin([curve.away(corridor.air.xyz) for curve in curves], axis=0),
    )
    both, any_of_them = np.all(reached, axis=0), np.any(reached, axis=0)
    assert both.mean() > 0.5
    np.testing.assert_array_equal(said, np.where(any_of_them, nearer, 0))
    np.testing.assert_array_equal(line.labels["span_id"], np.where(any_of_them, 7, 0))
    away = np.min([curve.away(corridor.air.xyz) for curve in curves], axis=0)[any_of_them]
    radius = on_wire(corridor, wires[0])[2]
    clear = line.labels["confidence"][any_of_them]
    np.testing.assert_allclose(clear, 1 - 0.5 * (away / radius) ** 2, rtol=1e-6)


def test_a_pole_at_which_a_line_branches_off_is_one() -> None:
    _, wires, poles = line([0, 50, 100, 150], [-0.8, 0.8], 9, 400)
    branch = [
        wire((100 + v, -0.5 - 45 * k, 8.6), (100 + v, -45.5 - 45 * k, 8.6), 300)[1]
        for k in range(2)
        for v in (-0.4, 0.4)
    ]
    post = [pole(100.0, -45.0 * k, 9.2) for k in (1, 2)]
    floor = ground(200, 220, 4)
    result = found(floor, *wires, poles, *branch, *post)
    assert len(result.wires.frame) == 10
    feet = np.column_stack([result.towers.frame.geometry.x, result.towers.frame.geometry.y])
    for place in [(50, 0), (100, 0), (100, -45)]:
        assert np.count_nonzero(np.hypot(*(feet - CORNER[:2] - place).T) < 5) == 1
    assert len(feet) == 6


def test_no_line_is_an_empty_result_that_says_so(caplog: pytest.LogCaptureFixture) -> None:
    result = found(GROUND)
    assert (result.span_count, result.tower_count) == (0, 0)
    assert "no power line was found" in caplog.text
    assert {"wire_id", "sag", "geometry"} <= set(result.wires.frame.columns)


def test_wires_without_ground_are_refused() -> None:
    _, wires, _ = line([0, 180], [-4, 0, 4], 25, 1200)
    with pytest.raises(DataError, match="along lines, as wires do, without the ground"):
        found(*wires)
    _, wires, poles = line([0, 60, 120], [-1, 1], 9, 400)
    with pytest.raises(DataError, match="without the ground"):
        found(*wires, poles)


def test_ground_classes_must_occur() -> None:
    points = cloud(GROUND).with_attributes({"classification": np.ones(len(GROUND), np.uint8)})
    with pytest.raises(DataError, match="none is of the ground_classes 2"):
        CorridorExtract(points=points, ground_classes=ClassList([2])).run()


def test_classes_given_come_before_heights_given() -> None:
    """Heights that are all wrong, and classes that are right."""
    _, wires, poles = line([0, 60], [-1, 1], 9, 400)
    truth = [2, 1, 1, 1]
    points = cloud(GROUND, *wires, poles, classes=truth)
    points = points.with_attributes(
        {"classification": points["truth"], "HeightAboveGround": np.zeros(len(points), np.float32)}
    )
    assert CorridorExtract(points=points).run().span_count == 0
    assert CorridorExtract(points=points, ground_classes=ClassList([2])).run().span_count == 1


def test_a_stray_point_among_candidates_is_named() -> None:
    """Those of a survey in tiles, which may be as far apart as its tiles."""
    points = cloud(GROUND, np.zeros((1, 3)) - CORNER)
    made = {
        "HeightAboveGround": np.zeros(len(points), np.float32),
        "stands_for": np.ones(len(points), np.uint32),
    }
    with pytest.raises(DataError, match="remove stray points"):
        CorridorExtract(points=points.with_attributes(made)).run()


def test_it_is_said_why_there_is_no_line(caplog: pytest.LogCaptureFixture) -> None:
    for height, text in ((0.0, "found"), (np.nan, "found: no height above the ground is known")):
        made = {"HeightAboveGround": np.full(len(GROUND), height, np.float32)}
        CorridorExtract(points=cloud(GROUND).with_attributes(made)).run()
        assert caplog.messages[-1] == f"no power line was {text}"


def test_feet_give_the_lines_of_metres() -> None:
    _, wires, poles = line([0, 60, 120], [-1, 1], 9, 400)
    points = cloud(GROUND, *wires, poles)
    foot = 1200 / 3937
    feet = PointCloud(points.xyz / foot, {"truth": points["truth"]}, crs=CRS(2263))
    metres, other = (CorridorExtract(points=p).run() for p in (points, feet))
    assert len(metres.wires) == len(other.wires) == 4
    np.testing.assert_allclose(metres.wires.frame.c, other.wires.frame.c, rtol=0.01)
    np.testing.assert_allclose(metres.wires.frame.z0, other.wires.frame.z0 * foot, atol=0.05)
    same = metres.classified["classification"] == other.classified["classification"]
    assert same.mean() > 0.999


@pytest.mark.slow
def test_braces_of_a_tower_on_a_steep_slope_are_no_wires() -> None:
    """Two of three towers were found: the last stood 3 m off, in the middle of its bracing."""
    made = SamplesScene(kind="corridor", preset="mountain", seed=316).run()
    features = made.features.frame
    result = CorridorExtract(points=unlabelled(made.points)).run()
    feet = shapely.get_coordinates(result.towers.frame.geometry)
    shapes = features[features.kind == "tower"].geometry
    true = np.array([shapely.get_coordinates(shape)[0] for shape in shapes])
    np.testing.assert_allclose(feet[np.argsort(feet[:, 0])], true[np.argsort(true[:, 0])], atol=1)
    assert len(result.wires) == 15


def test_a_pole_alone_is_none() -> None:
    assert found(GROUND, pole(50, 0, 10)).tower_count == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tile", "corner"),
    [
        ("12AN2_20", (47.3, 40.8)),
        ("12AN2_20", (50.0, 50.0)),
        ("12BZ1_21", (42.7, 35.4)),
        ("12BZ1_21", (50.0, 50.0)),
    ],
)
def test_a_real_transmission_line(tile: str, corner: tuple[float, float]) -> None:
    """Wherever cells begin: a point far off the line moves them all."""
    path = DATA / f"powerline_ahn4/{tile}_as_published.laz"
    if not path.exists():
        pytest.skip("needs powerline_ahn4")
    line = PointCloud.open(path).with_crs(CRS(28992))
    far = line.select([0]).with_xyz(line.xyz.min(axis=0, keepdims=True) - [[*corner, 0.0]])
    points = PointCloud.concat([line, far])
    result = CorridorExtract(points=points).run()
    said, true = result.classified["classification"] == 14, points["classification"] == 14
    assert (said & true).sum() / said.sum() > 0.98
    assert (said & true).sum() / true.sum() > 0.97
    assert quality(said, true) > 0.95
    assert (result.span_count, result.tower_count) == (2, 1)


@pytest.mark.parametrize(("degrees", "there"), [(0, 1), (45, 0), (45, 1)])
def test_a_real_line_in_hills(degrees: int, there: int) -> None:
    """Turned about its middle, and moved to the origin, it is the same line, and no other."""
    path = DATA / "line_quebec_hills/west.laz"
    if not path.is_file():
        pytest.skip("needs TOOLBOX_TEST_DATA")
    points = PointCloud.open(path)
    middle = points.xyz.mean(axis=0)
    x, y, z = (points.xyz - middle).T
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turned = np.column_stack([c * x - s * y, s * x + c * y, z]) + there * middle
    points = PointCloud(turned, {"reference": points["reference"]}, crs=points.crs)
    result = CorridorExtract(points=points).run()
    said, true = result.classified["classification"] == 14, points["reference"] == 1
    assert (said & true).sum() > 0.94 * true.sum()
    assert (said & true).sum() > 0.96 * said.sum()
    assert result.span_count == 6
    assert result.tower_count == 4
    towers = points.xyz[points["reference"] == 2]
    for foot in result.towers.frame.geometry:
        body = towers[np.hypot(*(towers[:, :2] - (foot.x, foot.y)).T) < 12, :2]
        centre = np.quantile(body, (0.02, 0.98), axis=0).mean(axis=0)
        assert np.hypot(*(centre - (foot.x, foot.y))) < 2


def test_a_turned_or_moved_scene_has_the_same_line() -> None:
    """Spans, wires and towers within 5 cm, wherever cells begin and however they lie."""
    made = SamplesScene(kind="corridor", preset="lattice_triangle", seed=100).run().points
    middle = np.append(made.xyz.mean(axis=0)[:2].round(), 0.0)
    wanted = None
    for degrees, east in ((0.0, 0.0), (62.0, 0.0), (232.0, 0.0), (0.0, 271.3)):
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        moved = middle + np.array([east, 0, 0])
        xyz = (made.xyz - middle) @ turn.T + moved
        result = CorridorExtract(points=PointCloud(xyz, {}, crs=made.crs)).run()
        feet = np.array([(p.x, p.y, 0.0) for p in result.towers.frame.geometry])
        feet = (feet - moved) @ turn
        own = result.span_count, len(result.wires), feet[np.argsort(feet[:, 0])]
        wanted = wanted or own
        assert own[:2] == wanted[:2]
        np.testing.assert_allclose(own[2], wanted[2], atol=0.05)


def test_points_are_in_the_order_of_cells_and_places_whatever_theirs() -> None:
    rng = np.random.default_rng(0)
    xyz = rng.integers(0, 12, (4000, 3)) / np.array([1.0, 2.0, 3.0])  # many share their x, or all
    cell = (xyz[:, 1] // PLAN_CELL).astype(int) * 3 + (xyz[:, 0] // PLAN_CELL).astype(int)
    air = Airborne.of(xyz)
    wanted = xyz[np.lexsort((xyz[:, 2], xyz[:, 1], xyz[:, 0], cell))]
    np.testing.assert_array_equal(air.xyz, wanted)
    np.testing.assert_array_equal(air.xyz, xyz[air.order])
    np.testing.assert_array_equal(np.diff(air.start), np.bincount(cell, minlength=6))


# What may be missing -------------------------------------------------------------------------


def four_spans(per_metre: float) -> tuple[list[Floats], Floats]:
    """Points of three conductors in each of four spans, span by span, and what else there is."""
    _, wires, poles = line([0, 80, 160, 240, 320], [-3, 0, 3], 13, 500, per_metre)
    return wires, np.vstack([ground(320, 40, 6), poles])


@pytest.mark.parametrize("per_metre", [0.7, 4.0])
def test_of_a_line_that_is_whole_nothing_is_told(
    per_metre: float, caplog: pytest.LogCaptureFixture
) -> None:
    wires, rest = four_spans(per_metre)
    frame = found(rest, *wires).wires.frame
    assert len(frame) == 12
    assert (frame.conductors == 3).all()
    assert (frame.expected == 3).all()
    assert frame.seen_share.min() > 0.9
    assert not caplog.text


@pytest.mark.parametrize("per_metre", [0.7, 4.0])
def test_a_conductor_that_a_span_lacks_is_told(
    per_metre: float, caplog: pytest.LogCaptureFixture
) -> None:
    wires, rest = four_spans(per_metre)
    frame = found(rest, *wires[:4], *wires[5:]).wires.frame
    (lacking,) = frame[frame.conductors < frame.expected].span_id.unique()
    assert frame[frame.span_id == lacking].conductors.tolist() == [2, 2]
    assert f"span {lacking}: 2 conductors, where its neighbours have 3; look at it" in caplog.text
    assert "data end" not in caplog.text


def test_where_the_data_end_it_is_not_known_whether_a_conductor_is_missing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    wires, rest = four_spans(4.0)
    kept = [part[part[:, 0] < 290] for part in (rest, *wires[:-1])]
    found(*kept)
    assert "2 conductors, where its neighbours have 3 (it ends where the data end: not known" in (
        caplog.text
    )


@pytest.mark.parametrize(("per_metre", "kept"), [(0.7, 0.0), (4.0, 0.0), (8.0, 0.08)])
def test_a_conductor_seen_along_half_a_span_is_told(
    per_metre: float, kept: float, caplog: pytest.LogCaptureFixture
) -> None:
    """Without points on the other half, or with so few that the others do not explain it."""
    wires, rest = four_spans(per_metre)
    thin = (wires[4][:, 0] > 120) & (np.random.default_rng(0).random(len(wires[4])) >= kept)
    wires[4] = wires[4][~thin]
    frame = found(rest, *wires).wires.frame
    (half,) = frame[frame.seen_share < 0.75].itertuples()
    assert half.seen_share == pytest.approx(0.5, abs=0.15 if kept else 0.1)
    assert half.longest_gap > (4 if kept else 35)
    assert f"conductor {half.wire_id} was seen along {100 * half.seen_share:.0f} % only" in (
        caplog.text
    )


@pytest.mark.parametrize(("per_metre", "told"), [(0.1, True), (0.7, False)])
def test_points_too_few_to_see_all_wires_are_told(
    per_metre: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Nothing tells of wires that are not found but the few points on the others."""
    wires, rest = four_spans(0.7)
    layer = found(rest, *wires).wires
    frame = layer.frame.copy()
    frame["points"] = (per_metre * frame["length"]).round().astype(int)
    caplog.clear()
    warn_of_missed(Vector(frame))
    text = "the points are too few to see all wires: those found have 10 per 100 m, and below 20"
    assert (text in caplog.text) == told
    warn_of_missed(Vector(frame[:0]))


@pytest.mark.parametrize(
    ("aside", "share", "told"), [(1.0, 0.8, True), (1.0, 0.4, False), (2.0, 1.0, False)]
)
def test_a_span_beside_other_things_all_along_is_told(
    aside: float, share: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Two wires of 50 m, a metre apart; a wall goes along with them, so far aside."""
    along = np.arange(0.0, 50.0, 0.5)
    wires = [np.column_stack([along, 0 * along + y, 0 * along + 9]) for y in (0, 1)]
    wall = np.column_stack([along, 0 * along - aside, 0 * along + 9])[: round(share * len(along))]
    both = np.column_stack([along, 0 * along + 1 + aside, 0 * along + 9])[: len(wall)]
    span = np.repeat([1, 1, 0, 0], [len(along), len(along), len(wall), len(both)])
    xyz = np.concatenate([*wires, wall, both])
    points: Any = SimpleNamespace(air=SimpleNamespace(xyz=xyz), own=np.arange(len(xyz)))
    warn_of_edges(points, {"span_id": span, "tower_id": 0 * span})
    assert ("span 1: nearly all along" in caplog.text) == told


def test_gaps_that_chance_explains_are_seen() -> None:
    """Of points at random, whatever their number; three times fewer along a half do not matter."""
    rng = np.random.default_rng(3)
    unseen = []
    for _ in range(400):
        u = np.sort(rng.uniform(0, 300, rng.integers(60, 1500)))
        unseen.append(seen_share(u, 300.0, (True, True))[0] < 1)
        fewer = u[(u < 150) | (rng.random(len(u)) < 1 / 3)]
        assert seen_share(fewer, 300.0, (True, True))[0] > 0.75
    assert (
        np.mean(unseen) < 8 * SETTINGS.sparse.false_alarms
    )  # the spacing is not known, but estimated


def test_what_lies_beyond_the_data_is_not_unseen() -> None:
    u = np.arange(0.0, 60.0, 0.5)
    assert seen_share(u, 100.0, (True, True))[0] == pytest.approx(0.6, abs=0.02)
    assert seen_share(u, 100.0, (True, False))[0] == 1
    for few in (u[:1], u[[3, 3]]):
        assert seen_share(few, 100.0, (False, False)) == (0.0, 100.0)


@pytest.mark.parametrize(
    ("counts", "lacking"),
    [
        ([3, 3, 2, 3, 3], [2]),
        ([3, 2, 2, 3], [1, 2]),
        ([3, 2], [1]),
        ([2, 3, 3], [0]),
        ([6, 6, 6, 3, 3, 3], []),  # half of the line leaves at a tower
        ([3], []),
    ],
)
def test_how_many_conductors_the_neighbours_lead_one_to_expect(
    counts: Sequence[int], lacking: Sequence[int]
) -> None:
    curve = wire((0, 0, 10), (50, 0, 10), 300)[0]
    wires = [
        Wire(curve, (span, span + 1), (0.0, 50.0), 0.25, span=span, bundle=k)
        for span, count in enumerate(counts)
        for k in (*range(count), 0)  # the first is a bundle of two
    ]
    told = conductor_counts(wires)
    assert [count for count, _ in told.values()] == list(counts)
    assert [s for s, (n, usual) in told.items() if usual is not None and n < usual] == lacking


@pytest.mark.parametrize(
    ("end", "supports", "is_one"),
    [
        ((0, 12, 10), (0, -1), True),  # three metres beyond the outermost wire is arm
        ((0, 40, 10), (0, -1), False),  # leaves it: another line
        ((60, 2, 10), (0, -1), False),
        ((0, 12, 10), (-1, -1), False),  # held by none
    ],
)
def test_a_part_of_an_arm_is_no_wire(
    end: tuple[float, float, float], supports: tuple[int, int], is_one: bool
) -> None:
    """The chords of the arms of a lattice tower were eleven wires in four spans."""
    curve = wire((0, 2, 10), end, 300)[0]
    tower = Support(0.0, 0.0, (0.0, 1.0), (-10.0, 10.0), 9.0, 11.0, 0.0, 1.0)
    assert is_arm(Wire(curve, supports, (0.0, curve.length), 0.25), [tower]) == is_one


@pytest.mark.parametrize(("corner", "is_bar"), [(16.9, True), (17.1, False)])
def test_bars_of_a_tower_are_no_wires_and_those_that_end_in_it_are_its(
    corner: float, is_bar: bool
) -> None:
    """A lattice of 182 m had 80 of them, and its wires ended in the air (mountain, seed 375)."""
    ends = [((-9, 9, 40), (corner, 0, 42)), ((300, 0, 95), (2, 0, 99)), ((300, 5, 95), (20, 5, 98))]
    curves = [wire(*some, 2000)[0] for some in ends]
    wires = [
        Wire(curve, (-1, -1), (0.0, curve.length), 0.25, span=k) for k, curve in enumerate(curves)
    ]
    tower = Support(0.0, 0.0, (0.0, 1.0), (-10.0, 10.0), 40.0, 100.0, 0.0, 1.0)
    kept, (support,) = without_bars(wires, [tower])
    if is_bar:
        assert [(one.span, one.supports) for one in kept] == [(1, (-1, 0)), (2, (-1, -1))]
        assert (support.low, support.high) == pytest.approx((99, 99))
    else:
        assert kept == wires
        assert support == tower


@pytest.mark.parametrize(
    ("low", "supports", "is_one"),
    [(2.5, (-1, 0), True), (3.5, (-1, 0), False), (1.5, (0, -1), False), (1.5, (-1, -1), False)],
)
def test_what_is_tied_near_the_ground_is_no_wire(
    low: float, supports: tuple[int, int], is_one: bool
) -> None:
    """A rope of a radio mast was a wire, between two certain poles (no_line_radio_masts, 355)."""
    curve = wire((0, 0, 20), (30, 0, low), 300)[0]
    pole = Support(0.0, 0.0, (0.0, 1.0), (0.0, 0.0), 9.0, 11.0, 0.0, 1.0)
    assert is_guy(Wire(curve, supports, (0.0, curve.length), 0.25), [pole]) == is_one


@pytest.mark.parametrize(("first", "bundles"), [([0, 0], 2), ([0, 1], 4)])
def test_twins_that_were_followed_apart_are_a_bundle_where_others_are(
    first: Sequence[int], bundles: int
) -> None:
    """Of six conductors of 12AN2_20 two were counted twice; of streets each wire is one."""
    offsets = (0.0, 0.4, 6.0, 6.4)
    curves = [wire((0, y, 10), (50, y, 10), 300)[0] for y in offsets]
    numbers = [*first, 2, 3]
    wires = [
        Wire(curve, (0, 1), (0.0, 50.0), 0.25, span=1, bundle=k)
        for curve, k in zip(curves, numbers, strict=True)
    ]
    assert len({one.bundle for one in numbered(wires, [])}) == bundles


@pytest.mark.parametrize(("aside", "bundles"), [(0.45, 1), (0.8, 2)])
def test_wires_that_were_followed_as_one_are_a_bundle_where_they_are_near(
    aside: float, bundles: int
) -> None:
    """On poles with wires 0.7 m apart two were followed as one, and counted as one conductor."""
    points = [wire((0, y, 10), (50, y, 10), 300, noise=0.02)[1] for y in (0.0, aside)]
    corridor = replace(in_free_air(Airborne.of(np.vstack(points))), tolerance=0.625)
    between = wire((0, aside / 2, 10), (50, aside / 2, 10), 300)[0]
    parts = conductors_of(corridor, [Wire(between, (0, 1), (0.0, 50.0), 0.625)])
    assert len(parts) == 2
    assert len({number for _, number in parts}) == bundles


@pytest.mark.skipif(not DATA.is_dir(), reason="the real data are not there")
@pytest.mark.parametrize("tile", ["12AN2_20", "12BZ1_21"])
def test_of_a_real_line_that_is_whole_nothing_is_told(
    tile: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = DATA / "powerline_ahn4" / f"{tile}_as_published.laz"
    frame = CorridorExtract(points=PointCloud.open(path, assume_crs=CRS(28992))).run().wires.frame
    assert (frame.conductors == 8).all()  # two circuits of twin bundles, and two guard wires
    assert (frame.expected == 8).all()
    assert frame.seen_share.min() > 0.9
    assert not caplog.text
