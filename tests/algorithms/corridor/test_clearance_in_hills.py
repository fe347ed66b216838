"""corridor.clearance in slopes: all that it measures against a search among places on the wires.

The wires are sampled every two centimetres: the nearest of these places, of all wires in all
states, is as far away as the wire, to within a millimetre from a distance of 5 cm on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from pyproj import CRS
from scipy.spatial import cKDTree

import toolbox
from algorithms.corridor._clearance.rest import extremes
from algorithms.corridor._clearance.sag import State, all_conductors, conductor_of, in_state
from algorithms.corridor._clearance.weather import (
    clear_sky,
    place_of,
    position_of_sun,
    sun_at,
    time_of,
)
from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._extraction.layers import wire_layer
from algorithms.corridor._extraction.spans import Wire
from toolbox.data import PointCloud, Table, Vector
from toolbox.errors import DataError, ParameterError

Floats = NDArray[np.float64]
ORIGIN = np.array([500_000.0, 4_600_000.0, 0.0])
DRAKE = conductor_of("Drake")
PLANTS_ALONE = {"falling": False, "free_air": 0.0}  # scattered points hang in mid-air
HOT = {"conductor": "Drake", "survey_temperature": 15.0, "temperature": 80.0}
CENTIMETRE = 0.01
STEP = 0.02  # metres between the places that are searched
TREE, HOUSE, GROUND = 5, 6, 2


@dataclass(frozen=True)
class Hill:
    """A slope with wires, across it and along it, turned in plan."""

    across: float
    along: float
    turn: float = 0.0

    def level(self, xy: Floats) -> Floats:
        return np.asarray(self.along * xy[:, 0] + self.across * xy[:, 1])

    def stand(self, xy: Floats, height: Any) -> Floats:
        """Places above the ground, before they are turned."""
        return np.column_stack([xy, self.level(xy) + height])

    def turned(self, xyz: Floats) -> Floats:
        c, s = math.cos(self.turn), math.sin(self.turn)
        x, y, z = xyz.T
        return np.column_stack([c * x - s * y, s * x + c * y, z])

    def wire(self, start: Sequence[float], end: Sequence[float], c: float) -> Catenary:
        """A wire between places in plan, at heights above the ground."""
        ends = self.stand(np.array([start[:2], end[:2]], float), [start[2], end[2]])
        (x, y, low), (x2, y2, high) = self.turned(ends).tolist()
        length = math.hypot(x2 - x, y2 - y)
        covariance = np.diag([4e-4, 4e-4, 1e-14])
        return Catenary(
            x, y, (x2 - x) / length, (y2 - y) / length, length, low, high, 1 / c,
            covariance=covariance,
        )  # fmt: skip


HILLS = [Hill(0.6, 0.0), Hill(-0.05, 0.6, 0.6), Hill(-0.45, -0.4, 2.5)]
each_hill = pytest.mark.parametrize("hill", HILLS)


def wires_of(curves: Sequence[Catenary], towers: Sequence[tuple[int, int]]) -> Vector:
    """A layer of conductors, each in a span of its own."""
    wires = [
        Wire(curve, (a - 1, b - 1), (0.0, curve.length), 0.25, n, n, n)
        for n, (curve, (a, b)) in enumerate(zip(curves, towers, strict=True), start=1)
    ]
    return wire_layer(wires, ORIGIN, 1.0, CRS(32635))


def line_on(hill: Hill) -> list[Catenary]:
    """Two spans of a line along x."""
    return [
        hill.wire((0, 0, 24), (240, 0, 24), 900.0),
        hill.wire((240, 0, 24), (420, 8, 28), 700.0),
    ]


TOWERS = [(1, 2), (2, 3)]


def cloud(hill: Hill, *parts: tuple[Floats, int, Any]) -> PointCloud:
    """A cloud of parts with their classes and heights above the ground."""
    xyz = hill.turned(np.vstack([xyz for xyz, _, _ in parts]))
    classes = np.repeat([code for _, code, _ in parts], [len(p) for p, _, _ in parts])
    heights = np.concatenate([np.broadcast_to(h, len(p)) for p, _, h in parts])
    columns: dict[str, Any] = {
        "classification": classes.astype(np.uint8),
        "HeightAboveGround": heights.astype(np.float32),
    }
    return PointCloud(xyz + ORIGIN, columns, crs=CRS(32635), name="hill.laz")


def scattered(hill: Hill, count: int = 2000, seed: int = 3) -> PointCloud:
    """Ground, vegetation and roofs around the line."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform((-20, -45), (440, 45), (3 * count, 2))
    bare, leaves, roofs = np.split(xy, 3)
    tall, low = rng.uniform(2.1, 26.0, count), rng.uniform(3.0, 9.0, count)
    return cloud(
        hill,
        (hill.stand(bare, 0.0), GROUND, 0.0),
        (hill.stand(leaves, tall), TREE, tall),
        (hill.stand(roofs, low), HOUSE, low),
    )


def places(curve: Catenary) -> Floats:
    """Places on a wire, STEP apart along its axis."""
    return curve.points(np.linspace(0.0, curve.length, math.ceil(curve.length / STEP) + 1))


def searched(xyz: Floats, curve: Catenary) -> tuple[Floats, Floats, Floats]:
    """Distance in space, and vertical and horizontal distance where the wire is nearest in plan."""
    line = places(curve)
    space, _ = cKDTree(line).query(xyz)
    flat, nearest = map(np.asarray, cKDTree(line[:, :2]).query(xyz[:, :2]))
    return np.asarray(space), line[nearest, 2] - xyz[:, 2], flat


def hot(curve: Catenary, state: State) -> Catenary:
    return in_state(curve, DRAKE, state, surveyed=15.0, surveyed_sd=5.0)


STATES = [
    State("survey"),
    State("80 C", 80.0),
    *(State(n, None, w) for n, w in (("l", 25.0), ("r", -25.0))),
]


def test_the_scene_has_slopes_of_60_percent() -> None:
    assert max(math.hypot(hill.across, hill.along) for hill in HILLS) > 0.6


@each_hill
def test_points_and_spans_in_all_states(hill: Hill) -> None:
    points, curves = scattered(hill), line_on(hill)
    found = toolbox.run(
        "corridor.clearance",
        {"points": points, "wires": wires_of(curves, TOWERS), "distance": 9.0, **PLANTS_ALONE,
         "wind": 25.0, "min_points": 1, **HOT},
    )  # fmt: skip
    xyz, code = points.xyz - ORIGIN, points["classification"]
    kinds = {"tree": code == TREE, "building": code == HOUSE, "ground": code == GROUND}
    least = np.full(len(xyz), np.inf)
    spans = found["spans"].frame
    assert len(spans) == len(curves) * len(STATES)
    for state in STATES:
        blown = [f"blown {'left' if state.wind > 0 else 'right'}"] if state.wind else [state.name]
        rows = spans[spans.state.isin(blown)]
        for curve, (_, row) in zip(curves, rows.iterrows(), strict=True):
            wire = hot(curve, state) if state.name != "survey" else curve
            space, _, flat = searched(xyz, wire)
            least = np.minimum(least, space)
            for kind, own in kinds.items():
                near = space[own & (flat <= 10.0)].min(initial=np.inf)
                assert row[kind] == pytest.approx(near, abs=CENTIMETRE), (state, kind)
    broken = (least < 9.0) & (code != GROUND)
    violations = found["violations"]
    listed = np.asarray(cKDTree(violations.xyz).query(points.xyz)[0]) < 1e-6
    sure = broken & (least < 9.0 - 1e-3)
    assert listed[sure].all()
    assert not listed[(least > 9.0 + 1e-3) & (code != GROUND)].any()
    assert sure.sum() > 100
    _, same = cKDTree(points.xyz).query(violations.xyz)
    objects = violations["classification"] != GROUND
    np.testing.assert_allclose(
        violations["clearance"][objects], least[same][objects], atol=CENTIMETRE
    )


@each_hill
def test_points_of_the_study_are_counted_per_span_and_in_all(hill: Hill) -> None:
    points, curves = scattered(hill), line_on(hill)
    wires = wires_of(curves, TOWERS)
    values: dict[str, Any] = {"points": points, "wires": wires, **PLANTS_ALONE}
    found = toolbox.run("corridor.clearance", {**values, "distance": 1.0})
    objects = points["classification"] != GROUND
    space = np.array([searched((points.xyz - ORIGIN)[objects], curve)[0] for curve in curves])
    nearest, near = space.argmin(axis=0), space.min(axis=0)
    wanted = [
        [int(((nearest == k) & (near >= low) & (near < high)).sum()) for k in range(len(curves))]
        for low, high in ((0, 20), (20, 30))
    ]
    table = found["spans"].frame
    same = int((np.ptp(space, axis=0) < CENTIMETRE).sum())  # nearest to the tower between
    for name, counts in zip(("points_0_20", "points_20_30"), wanted, strict=True):
        assert table[name].sum() == sum(counts)
        assert abs(table[name] - counts).max() <= same < 0.05 * sum(counts)
    assert (found["points_0_20"], found["points_20_30"]) == (sum(wanted[0]), sum(wanted[1]))
    page = found["report"]
    (block,) = next(s.blocks for s in page.sections if s.title == "Points near the wires")
    assert block.cells[-1] == ["all", *(str(sum(zone)) for zone in wanted)]
    other = toolbox.run("corridor.clearance", {**values, "rules": "thesis"})
    assert other["points_20_30"] == found["points_20_30"]


@each_hill
def test_a_tree_falls_as_far_as_it_is_high_whatever_the_slope(hill: Hill) -> None:
    """Uphill of the line its foot is higher, and it reaches farther down to the wires."""
    rng = np.random.default_rng(8)
    xy = np.column_stack(
        [np.arange(10.0, 410.0, 12.0), rng.choice([-1, 1], 34) * rng.uniform(12, 40, 34)]
    )
    tall = rng.uniform(12.0, 42.0, len(xy))
    stems = [
        hill.stand(np.tile(at, (12, 1)), np.linspace(0.7, 1, 12) * top)
        for at, top in zip(xy, tall, strict=True)
    ]
    heights = [np.linspace(0.7, 1, 12) * top for top in tall]
    trees = np.vstack(stems), TREE, np.concatenate(heights)
    curves = line_on(hill)
    points = cloud(
        hill, trees, (hill.stand(rng.uniform((0, -50), (420, 50), (500, 2)), 0.0), GROUND, 0.0)
    )
    found = toolbox.run(
        "corridor.clearance",
        {"points": points, "wires": wires_of(curves, TOWERS), "distance": 0.5},
    )
    feet = hill.turned(hill.stand(xy, 0.0))
    tops = hill.turned(hill.stand(xy, tall))
    left = np.min([searched(feet, curve)[0] for curve in curves], axis=0) - tall
    frame = found["objects"].frame
    falling = frame[frame.rule == "falling"]
    assert 5 < len(falling) < len(xy)
    at = np.column_stack([falling.geometry.x, falling.geometry.y]) - ORIGIN[:2]
    away, number = map(np.asarray, cKDTree(tops[:, :2]).query(at))
    assert away.max() < CENTIMETRE
    assert set(number) == set(np.flatnonzero(left < 0))
    np.testing.assert_allclose(falling.falls, left[number], atol=CENTIMETRE)


def test_a_tree_uphill_reaches_a_wire_that_one_downhill_does_not() -> None:
    hill = Hill(0.6, 0.0)
    tall = np.full(12, 26.0) * np.linspace(0.7, 1, 12)
    for side, falls in ((20.0, 1), (-20.0, 0)):
        tree = hill.stand(np.tile([120.0, side], (12, 1)), tall)
        points = cloud(
            hill, (tree, TREE, tall), (hill.stand(np.array([[0.0, 0.0]]), 0.0), GROUND, 0.0)
        )
        found = toolbox.run(
            "corridor.clearance",
            {"points": points, "wires": wires_of(line_on(hill), TOWERS), "distance": 0.5},
        )
        assert found["object_count"] + found["watch_count"] == falls, side


def crossing_line(hill: Hill, above: float) -> Catenary:
    """A wire on towers of its own that crosses the first span."""
    return hill.wire((70, -60, above), (150, 60, above + 4), 800.0)


@each_hill
@pytest.mark.parametrize("above", [30.0, 9.0])
def test_crossing_lines_are_measured_from_each_other(hill: Hill, above: float) -> None:
    curves = [*line_on(hill), crossing_line(hill, above)]
    layer = wires_of(curves, [*TOWERS, (4, 5)])
    values = {"points": scattered(hill, 50), "wires": layer, **PLANTS_ALONE, **HOT}
    found = toolbox.run("corridor.clearance", {**values, "distance": 0.1})
    warm = [[curve, hot(curve, State("80 C", 80.0))] for curve in curves]
    gaps = {
        (a, b): float(np.min(cKDTree(places(warm[0][a])).query(places(warm[2][b]))[0]))
        for a in (0, 1)
        for b in (0, 1)
    }
    rows = found["crossings"].frame
    (row,) = [one for one in rows.itertuples() if {one.span_id, one.other_span} == {1, 3}]
    names = ("survey", "80 C")
    assert row.distance == pytest.approx(min(gaps.values()), abs=CENTIMETRE)
    assert gaps[names.index(row.state), names.index(row.other_state)] == min(gaps.values())
    assert row.geometry.length > 0
    (listed,) = [s.blocks for s in found["report"].sections if s.title == "Crossing lines"]
    assert "80 C is that of conductors of 80 °C" in listed[0].caption
    lines = found["spans"].frame.set_index(["span_id", "state"])["line"]
    for state, name in enumerate(names):
        nearest = min(gaps[state, other] for other in (0, 1))
        assert lines[1, name] == pytest.approx(nearest, abs=CENTIMETRE)
        nearest = min(gaps[other, state] for other in (0, 1))
        assert lines[3, name] == pytest.approx(nearest, abs=CENTIMETRE)


@pytest.mark.parametrize(("towers", "count"), [((1, 2), 0), ((4, 5), 1)])
def test_circuits_on_the_same_towers_are_one_line(towers: tuple[int, int], count: int) -> None:
    hill = Hill(0.3, 0.3)
    curves = [hill.wire((0, y, 24), (240, y, 24), 900.0) for y in (0, 4)]
    found = toolbox.run(
        "corridor.clearance",
        {
            "points": scattered(hill, 50),
            "wires": wires_of(curves, [(1, 2), towers]),
            "distance": 5.0,
        },
    )
    assert found["crossing_count"] == count


def test_wires_of_one_line_and_those_that_hang_on_do_not_cross() -> None:
    """Spans with a tower in common are one line; where both end, a tower was not found."""
    hill = Hill(0.3, 0.3)
    curves = line_on(hill)
    for towers in (TOWERS, [(1, 0), (0, 3)]):
        found = toolbox.run(
            "corridor.clearance",
            {
                "points": scattered(hill, 50),
                "wires": wires_of(curves, towers),
                **PLANTS_ALONE,
                "rules": "thesis",
            },
        )
        assert len(found["crossings"]) == 0
        assert found["spans"].frame.line.isna().all()


@pytest.mark.parametrize(
    ("threshold", "direction", "within", "severity", "count"),
    [
        (40.0, "3-D", None, "critical", 1),
        (60.0, "vertical", 1.0, "warning", 1),
        (0.1, "3-D", None, "kept", 0),
    ],
)
def test_rules_for_lines_hold_for_lines_alone(
    threshold: float, direction: str, within: float | None, severity: str, count: int
) -> None:
    hill = Hill(0.6, 0.0)
    layer = wires_of([*line_on(hill), crossing_line(hill, 60.0)], [*TOWERS, (4, 5)])
    row = {
        "id": "lines", "source": "us", "date": "2024", "unit": "m", "kind": "line",
        "within": within, "direction": direction, "threshold": threshold, "confirmed": True,
        "severity": severity if count else "critical",
    }  # fmt: skip
    tree = {**row, "id": "trees", "kind": "tree", "threshold": 0.1, "direction": "3-D"}
    table = Table(pd.DataFrame([row, tree]))
    found = toolbox.run(
        "corridor.clearance",
        {"points": scattered(hill, 50), "wires": layer, **PLANTS_ALONE, "rule_table": table},
    )
    near = found["crossings"].frame
    near = near[near.span_id + near.other_span == 4]
    assert found["crossing_count"] == count
    if count:
        assert near.severity.to_list() == [severity]
        assert near.rule.to_list() == ["lines"]
        assert near.required.to_list() == [threshold]
        space, vertical, flat = near[["distance", "vertical", "horizontal"]].to_numpy()[0]
        assert flat == pytest.approx(0.0, abs=CENTIMETRE)
        assert near.clearance[0] == pytest.approx(space if direction == "3-D" else abs(vertical))
        titles = [section.title for section in found["report"].sections]
        assert "Crossing lines" in titles


def test_lines_that_cross_have_no_rule_in_the_sets_of_the_toolbox() -> None:
    hill = Hill(0.6, 0.0)
    low = crossing_line(hill, 21.0)
    layer = wires_of([*line_on(hill), low], [*TOWERS, (4, 5)])
    found = toolbox.run(
        "corridor.clearance",
        {"points": scattered(hill, 50), "wires": layer, "rules": "thesis", **PLANTS_ALONE},
    )
    frame = found["crossings"].frame
    assert frame.severity.to_list() == ["no rule"]
    assert frame.required.isna().all()
    assert found["crossing_count"] == 1


@each_hill
def test_intervals_hold_all_clearances_between_the_coldest_and_the_hottest(hill: Hill) -> None:
    """The temperature of the survey and the conductor are not known: steps through all of them."""
    points, curves = scattered(hill, 400), line_on(hill)
    values = {"points": points, "wires": wires_of(curves, TOWERS), **PLANTS_ALONE}
    found = toolbox.run("corridor.clearance", {**values, "distance": 7.0, "min_points": 1})
    spans, objects = found["spans"].frame, found["objects"].frame
    xyz, code = points.xyz - ORIGIN, points["classification"]
    band = (-80.0, 80.0)
    for number, curve in enumerate(curves):
        ends = [
            wire.curvature
            for conductor in all_conductors()
            for warmer in band
            for wire in extremes(curve, [conductor], (min(warmer, 0), max(warmer, 0)))
        ]
        steps = [replace(curve, curvature=k) for k in np.linspace(min(ends), max(ends), 13)]
        reached = [searched(xyz, step) for step in steps]
        now = searched(xyz, curve)
        for name, own in (("clearance", code != GROUND), ("ground", code == GROUND)):
            near = [space[own & (flat <= 10)].min() for space, _, flat in [*reached, now]]
            row = spans.iloc[number]
            coarse = (
                max(abs(np.diff([step.sag for step in steps])))
                if name == "clearance"
                else CENTIMETRE
            )
            assert row[f"{name}_low"] <= min(near) + CENTIMETRE
            assert row[f"{name}_low"] >= min(near) - coarse
            worst = max(near[0], near[12], near[-1])
            assert row[f"{name}_high"] == pytest.approx(worst, abs=CENTIMETRE)
        members = found["violations"]
        for one in objects[objects.wire_id == number + 1].itertuples():
            mine = members.xyz[members["object_id"] == one.object_id] - ORIGIN
            near = [searched(mine, step)[0].min() for step in [*steps[::4], curve]]
            assert one.clearance_low <= min(near) + CENTIMETRE
            assert one.clearance_high >= max(near[0], near[-2], near[-1]) - CENTIMETRE
            assert one.clearance_low <= one.clearance <= one.clearance_high
    assert len(objects) > 5


def test_a_wire_that_may_sag_into_a_tree_has_an_interval_down_to_nothing() -> None:
    hill = Hill(0.6, 0.0)
    (wire, _) = line_on(hill)
    below = wire.points(np.array([120.0])) - [0.0, 0.0, 1.5]
    tree = np.repeat(below, 5, axis=0)
    height = np.full(5, 15.0)
    points = cloud(hill, (tree, TREE, height))
    values = {"points": points, "wires": wires_of([wire], [(1, 2)]), **PLANTS_ALONE}
    found = toolbox.run("corridor.clearance", {**values, "distance": 2.0})
    (one,) = found["objects"].frame.itertuples()
    assert one.clearance == pytest.approx(1.5, abs=CENTIMETRE)
    assert one.clearance_low == pytest.approx(0.0, abs=CENTIMETRE)
    assert one.clearance_high > 3.0
    (row,) = found["spans"].frame.itertuples()
    assert (row.clearance_low, row.clearance_high) == pytest.approx(
        (one.clearance_low, one.clearance_high), abs=CENTIMETRE
    )
    safe = toolbox.run("corridor.clearance", {**values, "distance": 0.3})
    assert safe["object_count"] == 0
    assert "may break one at another temperature of the wires: tree 5" in (safe["report"].html())
    known = {**values, "distance": 2.0, "conductor": "Drake", "survey_temperature_sd": 0.0}
    widths = []
    for survey, lowest, highest in ((30.0, 29.0, 31.0), (30.0, 0.0, 80.0), (None, 0.0, 80.0)):
        limits = {"lowest_temperature": lowest, "highest_temperature": highest}
        given = {**known, **limits, "survey_temperature": survey}
        frame = toolbox.run("corridor.clearance", given)["objects"].frame
        widths.append(frame.clearance_high[0] - frame.clearance_low[0])
    assert widths[0] < 0.2 < widths[1] < widths[2]


def test_the_interval_of_an_object_holds_the_rest_of_its_tree() -> None:
    """Of a real tree 3 points broke the rule, and others came 0.9 m nearer to the hot wire."""
    hill = Hill(0.0, 0.0)
    (wire, _) = line_on(hill)
    lows = []
    for beside in (0.0, 0.5, 40.0):  # m from the tip to what else there is, along the wire
        tip = wire.points(np.array([120.0])) - [0.0, 0.0, 1.2]
        rest = wire.points(np.array([120.0 + beside])) - [0.0, 0.0, 2.1]
        tree = np.concatenate([np.repeat(tip, 5, axis=0), np.repeat(rest, 5, axis=0)])
        tree[:5, :2] += 1.5 * np.array([-wire.ey, wire.ex])  # m aside, also when the wire sinks
        points = cloud(hill, (tree, TREE, np.full(10, 15.0)))
        values = {"points": points, "wires": wires_of([wire], [(1, 2)]), **PLANTS_ALONE}
        frame = toolbox.run("corridor.clearance", {**values, "distance": 2.0})["objects"].frame
        assert frame.points.tolist() == [5], "as surveyed only the tip is too close"
        lows.append(float(frame.clearance_low[0]))
    assert lows[:2] == pytest.approx([0.0, 0.0], abs=0.05), "the rest is right below the wire"
    assert lows[2] == pytest.approx(1.5, abs=0.05), "what is 40 m away is no part of it"


def test_the_known_temperature_bounds_the_interval_by_the_states_themselves() -> None:
    hill = Hill(0.3, 0.5)
    curves = line_on(hill)
    values = {"points": scattered(hill), "wires": wires_of(curves, TOWERS), **PLANTS_ALONE}
    values["rules"] = "thesis"
    given = {**values, **HOT, "survey_temperature_sd": 0.0, "distance": 3.0}
    spans = toolbox.run("corridor.clearance", given)["spans"].frame.set_index(["span_id", "state"])
    for span in (1, 2):
        row = spans.loc[span, "survey"]
        assert row.ground_low == pytest.approx(spans.loc[(span, "80 C"), "ground"], abs=1e-6)
        assert row.ground_low < row.ground < row.ground_high
        assert pd.isna(spans.loc[(span, "80 C"), "ground_low"])
        wire = places(curves[span - 1])
        points = values["points"].xyz[values["points"]["classification"] == GROUND] - ORIGIN
        away, nearest = map(np.asarray, cKDTree(wire).query(points))
        at = nearest[away.argmin()] * curves[span - 1].length / (len(wire) - 1)
        assert row.ground_at == pytest.approx(at, abs=STEP)


def test_an_unsure_temperature_of_the_survey_widens_the_range_by_two_deviations() -> None:
    hill = Hill(0.3, 0.5)
    wires = wires_of(line_on(hill), TOWERS)
    values = {"points": scattered(hill, 50), "wires": wires, **PLANTS_ALONE, "distance": 1.0}
    limits = {"conductor": "Drake", "lowest_temperature": 10.0, "highest_temperature": 40.0}
    for survey, sd, told in (
        (20.0, 0.0, "20 degrees more or 10"),
        (20.0, 5.0, "30 degrees more or 20"),
    ):
        given = {"survey_temperature": survey, "survey_temperature_sd": sd}
        found = toolbox.run("corridor.clearance", {**values, **limits, **given})
        page = found["report"].html()
        assert f"so up to {told} less than in the survey" in page
        low, high = survey - 2 * sd, survey + 2 * sd
        assert f"it is taken to be from {low:g} to {high:g} °C" in page, "of which the range is"
    air = {"survey_air_temperature": 25.0}
    page = toolbox.run("corridor.clearance", {**values, **limits, **air})["report"].html()
    assert "from 25 to 40 °C. At other times" in page
    assert "so up to 15 degrees more or 30 less" in page


def test_grass_is_no_object_and_what_is_left_out_is_told() -> None:
    """On the slope the wires are nearer to the grass beside them than to that below."""
    hill = Hill(0.6, 0.0)
    curves = line_on(hill)
    xy = np.array([[60.0, 12.0], [120.0, 14.0], [180.0, 13.0]])
    grass = [hill.stand(np.tile(at, (6, 1)), np.linspace(0.5, 1.9, 6)) for at in xy]
    bush = hill.stand(np.tile([150.0, 12.0], (6, 1)), np.linspace(2.1, 3.0, 6))
    for code in (TREE, 1):
        points = cloud(
            hill,
            (np.vstack(grass), code, np.tile(np.linspace(0.5, 1.9, 6), 3)),
            (bush, code, np.linspace(2.1, 3.0, 6)),
            (hill.stand(np.array([[0.0, -40.0]]), 0.0), GROUND, 0.0),
        )
        values = {
            "points": points,
            "wires": wires_of(curves, TOWERS),
            **PLANTS_ALONE,
            "distance": 20.0,
        }
        found = toolbox.run("corridor.clearance", values)
        assert (found["object_count"], found["low_object_count"]) == (1, 3)
        low = "Lower than the lowest object, which else would be listed: 3 critical."
        assert low in found["report"].summary
        assert found["points_0_20"] == 6
        unseen = found["report"].head.unseen
        setting = 'the setting "Lowest object"'
        assert f"Plants, or what may be, lower than 2 m, {setting}: 18 points." in unseen
        assert "Of these, would break a rule or be near; in 3 objects: 18 points." in unseen
        every = toolbox.run("corridor.clearance", {**values, "min_object_height": 0.0})
        assert (every["object_count"], every["low_object_count"]) == (4, 0)
        assert "lower than" not in every["report"].html()
    house = cloud(hill, (np.vstack(grass), HOUSE, np.tile(np.linspace(0.5, 1.9, 6), 3)))
    assert toolbox.run("corridor.clearance", {**values, "points": house})["object_count"] == 3


def test_the_part_of_a_tree_below_the_least_height_is_no_object_left_out() -> None:
    hill = Hill(0.6, 0.0)
    tall = np.linspace(0.5, 6.0, 12)
    tree = hill.stand(np.tile([120.0, 14.0], (12, 1)), tall)
    found = toolbox.run(
        "corridor.clearance",
        {"points": cloud(hill, (tree, TREE, tall)), "wires": wires_of(line_on(hill), TOWERS),
         "falling": False, "distance": 20.0},
    )  # fmt: skip
    assert (found["object_count"], found["low_object_count"]) == (1, 0)


def test_that_low_plants_break_no_rule_is_said() -> None:
    """That 77,609 points were left out stood alone, and nobody knew whether one mattered."""
    hill = Hill(0.6, 0.0)
    grass = hill.stand(np.array([[120.0, 14.0]]), 0.5)
    points = cloud(hill, (grass, TREE, 0.5))
    values = {"points": points, "wires": wires_of(line_on(hill), TOWERS), "falling": False}
    found = toolbox.run("corridor.clearance", {**values, "distance": 1.0})
    assert "Of these, would break a rule or be near: 0 points." in found["report"].head.unseen
    assert "lowest object" not in found["report"].summary


def test_sun_and_heat_of_the_example_of_ieee_738() -> None:
    """30 degrees north, 10 June at 11 h, wires from west to east: 1027 W/m2, and 22.44 W/m."""
    altitude, azimuth = position_of_sun(161, 11.0, 30.0)
    assert (altitude, azimuth) == pytest.approx((74.8, 114.0), abs=0.1)
    beam = clear_sky(altitude, 0.0)
    assert beam == pytest.approx(1027.0, abs=1.0)
    along = math.cos(math.radians(altitude)) * math.cos(math.radians(azimuth - 90))
    assert 0.8 * beam * math.sqrt(1 - along**2) * 0.02812 == pytest.approx(22.44, abs=0.02)
    assert clear_sky(-3.0, 0.0) == 0.0
    assert clear_sky(60.0, 2000.0) / clear_sky(60.0, 0.0) == pytest.approx(1.185, abs=0.001)


@pytest.mark.parametrize(
    ("text", "longitude", "latitude", "altitude", "azimuth"),
    [
        ("2024-06-21T10:06:00+00:00", 29.0, 41.0, 72.44, 180.0),  # noon of the sun
        ("2024-06-21T13:06+03:00", 29.0, 41.0, 72.44, 180.0),
        ("2024-12-21T12:00+00:00", 0.0, 51.48, 15.08, 180.5),  # Greenwich
        ("2024-03-20T06:00+00:00", 0.0, 0.0, -1.8, 90.0),
    ],
)
def test_the_sun_stands_where_almanacs_have_it(
    text: str, longitude: float, latitude: float, altitude: float, azimuth: float
) -> None:
    found = sun_at(time_of(text), longitude, latitude)
    assert found[0] == pytest.approx(altitude, abs=0.3)
    assert found[1] == pytest.approx(azimuth, abs=1.0)


WEATHER = {
    "survey_air_temperature": 20.0,
    "survey_breeze": 0.61,
    "survey_time": "2024-06-10T11:00-00:00",
}


def test_the_temperature_of_the_survey_is_computed_from_load_and_weather() -> None:
    """The hot state then hangs as if that temperature had been given."""
    hill = Hill(0.2, 0.2)
    curves = line_on(hill)
    values = {"points": scattered(hill, 300), "wires": wires_of(curves, TOWERS), **PLANTS_ALONE}
    values["rules"] = "thesis"
    drake = {"conductor": "Drake", "temperature": 80.0, "distance": 1.0}
    load = {"survey_current": 600.0, **WEATHER}
    found = toolbox.run("corridor.clearance", {**values, **drake, **load})
    page = found["report"].html()
    assert "computed from current and weather (IEEE 738)" in page
    warm = float(page.split("In the survey the wires had ")[1].split()[0])
    assert 30.0 < warm < 60.0
    given = toolbox.run("corridor.clearance", {**values, **drake, "survey_temperature": warm})
    for one, other in zip(found["spans"].frame.sag, given["spans"].frame.sag, strict=True):
        assert one == pytest.approx(other, abs=0.005)
    calm = {**load, "survey_time": None, "survey_sun": 0.0, "survey_current": 0.0}
    cold = toolbox.run("corridor.clearance", {**values, **drake, **calm})["report"].html()
    assert "In the survey the wires had 20.0 °C" in cold


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"survey_current": 1.0}, "conductor: is needed for survey_current"),
        ({"survey_current": 1.0, "conductor": "Drake"}, "survey_air_temperature: is needed"),
        ({**WEATHER}, "survey_time: is for survey_current, and none is given"),
        ({"survey_current": 1.0, **WEATHER, "survey_sun": 9.0}, "survey_sun: is needed for"),
        ({"survey_current": 1.0, **WEATHER, "survey_temperature": 9.0}, "give one of both"),
        ({"survey_current": 1.0, **WEATHER, "survey_time": "June"}, "survey_time: must be date"),
        ({"survey_current": 1.0, **WEATHER, "survey_time": "2024-06-10T11:00"}, "offset from UTC"),
        ({"lowest_temperature": 20.0, "highest_temperature": 20.0}, "must be below highest"),
    ],
)  # fmt: skip
def test_wrong_weather_is_named(settings: dict[str, Any], message: str) -> None:
    hill = Hill(0.0, 0.0)
    values = {"points": scattered(hill, 5), "wires": wires_of(line_on(hill), TOWERS)}
    values["rules"] = "thesis"
    with pytest.raises((ParameterError, DataError), match=message):
        toolbox.run("corridor.clearance", {**values, **settings})


def test_the_sun_needs_a_place_on_the_earth() -> None:
    local = CRS.from_wkt('LOCAL_CS["here",UNIT["metre",1],AXIS["x",EAST],AXIS["y",NORTH]]')
    wires = wires_of(line_on(Hill(0.0, 0.0)), TOWERS)
    layer = Vector(wires.frame.set_crs(local, allow_override=True), name="wires.gpkg")
    with pytest.raises(DataError, match=r"wires\.gpkg: survey_time needs its place on the Earth"):
        place_of(layer)


def test_profiles_show_the_ground_right_below_the_wires() -> None:
    """In a side slope the ground to the side is as high as the wires."""
    hill = Hill(0.6, 0.0)
    values = {"wires": wires_of(line_on(hill), TOWERS), **PLANTS_ALONE, "distance": 1.0}
    for aside, shown in ((0.9, True), (1.1, False)):
        xy = np.column_stack([np.arange(0.0, 240.0, 2.0), np.full(120, aside)])
        points = cloud(hill, (hill.stand(xy, 0.0), GROUND, 0.0))
        page = toolbox.run("corridor.clearance", {**values, "points": points})["report"]
        (profiles,) = [s.blocks for s in page.sections if s.title == "Profiles"]
        assert (b"below a wire" in profiles[0].content) == shown
