"""corridor.clearance: distances with known answers, rules, states of the wires, objects."""

from __future__ import annotations

import importlib.util
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import ezdxf
import geopandas
import numpy as np
import pandas as pd
import pytest
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from scipy.optimize import brentq, root

import toolbox
from algorithms.corridor._clearance import matters
from algorithms.corridor._clearance.coverage import approach, stand_ins
from algorithms.corridor._clearance.distances import distances, fall_in, find_violations
from algorithms.corridor._clearance.matters import what_matters
from algorithms.corridor._clearance.objects import groups, tree_tops
from algorithms.corridor._clearance.report import _in_clumps, too_high
from algorithms.corridor._clearance.rules import (
    KINDS,
    Rule,
    rule_set,
    rules_of,
    shipped,
    why_none,
)
from algorithms.corridor._clearance.sag import (
    CONDUCTORS_FILE,
    Conductor,
    State,
    conductor_of,
    conductor_temperature,
    cooling,
    in_state,
    wind_load,
)
from algorithms.corridor._clearance.surroundings import line_of, surroundings_of
from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._extraction.layers import catenaries_of, swing_sigmas, wire_layer
from algorithms.corridor._extraction.spans import Wire
from toolbox import language
from toolbox.data import PointCloud, Report, Rows, Survey, Table, Vector
from toolbox.errors import DataError, ParameterError

EAST, NORTH = 500_000.0, 4_600_000.0
LEVEL = Catenary(0.0, 0.0, 1.0, 0.0, 300.0, 30.0, 30.0, 1 / 1100.0)
COVARIANCE = np.diag([4e-4, 4e-4, 1e-14])
LEVEL_SURE = replace(LEVEL, covariance=COVARIANCE)
SLOPING = Catenary(10.0, 20.0, 0.6, 0.8, 320.0, 40.0, 52.0, 1 / 900.0, v0=0.1, v1=0.002, swing=0.2)
SLACK = Catenary(0.0, 0.0, 0.0, 1.0, 60.0, 12.0, 9.0, 1 / 25.0, swing=0.3)
DRAKE = conductor_of("Drake")


def layer(*curves: Catenary, crs: int = 32635, metre: float = 1.0) -> Vector:
    """Wires of spans 1, 2, ... near EAST, NORTH, in the unit of the CRS."""
    wires = [
        Wire(replace(c, covariance=COVARIANCE), (-1, -1), (0.0, c.length), 0.25, n, n, n)
        for n, c in enumerate(curves, start=1)
    ]
    return wire_layer(wires, np.array([EAST, NORTH, 0.0]) * metre, metre, CRS(crs))


def cloud(xyz: Any, classes: Any, **columns: Any) -> PointCloud:
    xyz = np.asarray(xyz, float).reshape(-1, 3) + np.array([EAST, NORTH, 0.0])
    classes = np.broadcast_to(np.asarray(classes, np.uint8), len(xyz))
    return PointCloud(xyz, {"classification": classes, **columns}, crs=CRS(32635), name="a.laz")


def blob(x: float, y: float, z: float, count: int = 5) -> list[tuple[float, float, float]]:
    """Points of which the first is the highest."""
    return [(x, y, z - 0.1 * k) for k in range(count)]


def flat() -> list[tuple[float, float, float]]:
    """Ground at height 0 below LEVEL."""
    x, y = np.meshgrid(np.arange(-20.0, 321.0, 1.0), np.arange(-45.0, 46.0, 1.0))
    return [*zip(x.ravel(), y.ravel(), np.zeros(x.size), strict=True)]


def run(points: PointCloud | Survey, *curves: Catenary, **settings: Any) -> dict[str, Any]:
    sources = {"points": points, "wires": layer(*(curves or (LEVEL,)))}
    return dict(toolbox.run("corridor.clearance", sources | settings))


def rule(**changes: Any) -> Rule:
    made = Rule("r", "s", "d", "any", "3-D", 5.0, 5.0, "critical", confirmed=True)
    return replace(made, **changes)


def beside(offset: float, down: float, seed: int = 0) -> Any:
    """Points of a conductor that hangs beside LEVEL, four to a metre."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(0, LEVEL.length, int(4 * LEVEL.length))
    return LEVEL.points(u) + np.array([0, offset, -down]) + rng.normal(0, 0.03, (len(u), 3))


def leaves(x: float, y: float, z: float, size: Any, count: int = 2000) -> Any:
    """A box full of leaves."""
    middle = np.array([x, y, z])
    return middle + np.random.default_rng(5).uniform(-0.5, 0.5, (count, 3)) * size


@pytest.mark.parametrize("kind", [1, 5, 6])
@pytest.mark.parametrize("seed", [0, 7])
def test_points_in_the_shape_of_a_wire_are_told(
    kind: int, seed: int, caplog: pytest.LogCaptureFixture
) -> None:
    """But a tree and a hedge along the line are not."""
    tree, hedge = leaves(80, 0, 15, (6, 6, 8)), leaves(200, 4, 12, (90, 2, 2), 9000)
    shape = beside(4.0, 0.0, seed)
    xyz = np.vstack([shape, tree, hedge])
    classes = np.repeat([kind, 5], [len(shape), len(xyz) - len(shape)])
    height = xyz[:, 2].astype(np.float32)
    found = run(cloud(xyz, classes, HeightAboveGround=height), distance=12.0, falling=False)
    frame = found["objects"].frame
    flagged = frame[frame.may_be_wire]
    assert len(flagged)
    assert set(flagged.clearance.round(0)) <= {4.0, 5.0}
    assert frame[~frame.may_be_wire].points.sum() > 2000
    (row,) = found["spans"].frame.itertuples()
    assert row.wire_like == pytest.approx(300, abs=15)
    assert "hang beside spans 1: look at them" in caplog.text
    first = found["report"].sections[0]
    assert first.title == "Wires that may be missing"
    assert "Span 1: along" in first.blocks[0]


@pytest.mark.parametrize(("away", "told"), [(0.5, True), (0.8, False)])
def test_what_is_as_near_to_a_wire_as_a_subconductor_may_be_one(away: float, told: bool) -> None:
    places = LEVEL.points(np.linspace(100, 101, 5)) + np.array([0, away, 0])
    points = cloud(places, 5, HeightAboveGround=places[:, 2].astype(np.float32))
    found = run(points, distance=5.0, falling=False)
    assert found["unsure"].frame.may_be_wire.tolist() == [told]


def hung(*parts: Any) -> PointCloud:
    """Points of the class of trees with their heights above flat ground."""
    xyz = np.vstack(parts)
    return cloud(xyz, 5, HeightAboveGround=xyz[:, 2].astype(np.float32))


def bits(x: float, down: float, count: int = 4) -> Any:
    """A few points in a row along LEVEL, below it."""
    return LEVEL.points(x + np.linspace(0.0, 1.0, count)) - np.array([0.0, 0.0, down])


def test_what_hangs_in_mid_air_on_a_wire_or_tower_is_not_sure_to_be_a_tree(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Bits of the wire, the tip of an arm, and two points by themselves."""
    tip = LEVEL.points(np.array([2.0, 2.5, 3.0])) + np.array([0.0, 3.5, 1.0])
    points = hung(bits(60.0, 0.6), bits(150.0, 1.5), bits(220.0, 4.0, 2), tip)
    found = run(points, distance=5.0)
    frame = found["unsure"].frame
    assert frame.severity.tolist() == ["not sure"]
    assert frame.points.tolist() == [len(points)]
    assert frame["distance"].tolist() == pytest.approx([0.6], abs=0.01)
    assert not len(found["objects"]), "it stands among what is too close"
    assert found["objects"].crs == found["unsure"].crs == points.crs
    assert found["spans"].frame.objects.tolist() == [0]
    listed = {s.title: s.blocks for s in found["report"].sections}
    assert listed["Objects, the most urgent first"][0].startswith("None")
    assert len(listed["Not sure: plants or parts of the line"][0].table) == 1
    assert (found["object_count"], found["critical_count"], found["unsure_count"]) == (0, 0, 1)
    assert "0 to be watched. Not sure whether of the line: 1." in found["report"].html(), (
        "below its profile"
    )
    assert set(found["violations"]["severity"]) == {5}
    assert found["spans"].frame["tree"].isna().all()
    assert f"{len(points)} points hang in mid-air" in caplog.text
    assert "Not sure: points near 1 wires hang in mid-air" in found["report"].summary


@pytest.mark.parametrize("above_crown", [None, 1.0])
def test_a_tree_that_reaches_a_wire_is_one_however_thin_its_tip_is(
    above_crown: float | None,
) -> None:
    """Also if its lower part is too low to be an object; the tip is farther than a gap above it."""
    x, top = 150.0, float(LEVEL.height(np.array(150.0)))
    crown = leaves(x, 0.0, top - 7.0, (6.0, 6.0, 7.6), 4000)
    tip = np.array([[x, 0.0, top - 0.3], [x + 0.5, 0.0, top - 0.4]])
    low = 0.0 if above_crown is None else top - 3.2 + above_crown
    set_to = {"distance": 1.0, "falling": False, "min_points": 1, "min_object_height": low}
    found = run(hung(crown, tip), **set_to)
    assert (found["critical_count"], found["unsure_count"]) == (1, 0)
    far_above = hung(crown - np.array([0.0, 0.0, 6.0]), tip)
    assert run(far_above, **set_to)["unsure_count"] == 1


def test_a_crown_without_a_trunk_beside_a_wire_is_a_tree() -> None:
    top = float(LEVEL.height(np.array(150.0)))
    crown = leaves(150.0, 3.0, top, (5.0, 5.0, 4.0), 500)
    found = run(hung(crown), distance=5.0, falling=False)
    assert (found["critical_count"], found["unsure_count"]) == (1, 0)


def test_what_hangs_mostly_on_the_line_is_not_sure_to_be_a_tree() -> None:
    """Seven points within a gap of the wire, and three of the same arm that reach farther."""
    arm = bits(150.0, 0.0, 10) + np.outer(np.arange(10), [0.0, 0.25, 0.0])
    found = run(hung(arm), distance=5.0)
    assert (found["object_count"], found["unsure_count"]) == (0, 1)
    farther = arm + np.array([0.0, 1.2, 0.0])  # half of them are within a gap, which is not most
    found = run(hung(farther), distance=5.0)
    assert (found["object_count"], found["unsure_count"]) == (1, 0)


def test_distances_that_nobody_confirmed_are_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    table = Table(pd.DataFrame([row(confirmed=False)]))
    run(hung(bits(150.0, 9.0, 3)), rule_table=table)
    told = "by the engineer in charge: the distances required (tree 5 m 3-D)"
    assert told in caplog.text


@pytest.mark.parametrize(("altitude", "told"), [(None, False), (100, False), (30, True)])
def test_distances_that_do_not_hold_so_high_above_the_sea_are_told(
    caplog: pytest.LogCaptureFixture, altitude: float | None, told: bool
) -> None:
    """As those of NERC, which grow with altitude. The ends of the wire are 40 and 52 m high."""
    table = Table(pd.DataFrame([row(altitude=altitude)]))
    found = run(hung(bits(150.0, 9.0, 3)), SLOPING, rule_table=table, growth=1.0)
    text = "(tree 5 m 3-D) hold up to 30 m above the sea"
    assert (text in caplog.text) == told
    blocks = next(s.blocks for s in found["report"].sections if s.title == "Distances required")
    unsure = "The wires reach 52 m above the sea, if the heights of the data are above the sea, whi"
    assert any(unsure in str(block) for block in blocks) == told


def test_wires_are_above_the_sea_where_the_data_say_so() -> None:
    told = too_high([rule(altitude=30.0)], line_of(layer(SLOPING)), CRS("EPSG:32635+5773"))
    assert "the wires reach 52 m above the sea, and the distances" in told


def test_a_swing_that_was_not_looked_for_is_empty() -> None:
    wires = layer(LEVEL, SLOPING)
    swing = math.degrees(math.atan(SLOPING.swing))
    assert wires.frame["swing"].tolist() == pytest.approx([math.nan, swing], nan_ok=True)
    again = catenaries_of(wires, np.zeros(3))
    assert [curve.swing for curve in again] == pytest.approx([0.0, SLOPING.swing])
    spans = run(cloud(flat(), 2), LEVEL, SLOPING)["spans"].frame
    assert spans["swing"].tolist() == pytest.approx([math.nan, swing], nan_ok=True)


@pytest.mark.parametrize("other", [-14.5, -14.0, -11.8, -11.5, -0.3])
def test_wires_of_a_span_that_disagree_make_its_swing_less_sure(other: float) -> None:
    """At -14.5 and -0.3 degrees, each known to 1.5, it was told, though the wind is one."""
    wires = []
    for n, swing in enumerate((-14.5, other)):
        curve = replace(LEVEL, swing=math.tan(math.radians(swing)), x=8.0 * n, rms=0.1, count=80)
        seen = replace(curve, covariance=COVARIANCE)
        wires.append(Wire(seen, (-1, -1), (0.0, 90.0), 0.25, 1, n + 1, n + 1))
    found = wire_layer(wires, np.array([EAST, NORTH, 0.0]), 1.0, CRS.from_epsg(32635))
    (alone,) = swing_sigmas(Vector(found.frame[:1]))
    points = cloud(flat(), 2)
    spans = toolbox.run("corridor.clearance", {"points": points, "wires": found})["spans"].frame
    assert 1.5 < alone < 1.6
    sd = max(alone, abs(other + 14.5) / math.sqrt(2.0))
    assert found.frame["sd_swing"][0] == pytest.approx(sd, rel=0.05), (
        "beside the swing that is told"
    )
    told = [-14.5, sd] if sd < 2.0 else [math.nan, math.nan]
    columns = spans[["swing", "swing_sd"]].astype(float).iloc[0].tolist()
    assert columns == pytest.approx(told, rel=0.05, nan_ok=True)


def test_the_distances_of_nerc_hold_at_sea_level() -> None:
    assert {rule.altitude for rule in rules_of(rule_set("nerc_fac_003"), 345.0)} == {0.0}


def signed(report: Report) -> bool:
    """Whether a report has a place to sign for the distances required."""
    blocks = next(s.blocks for s in report.sections if s.title == "Distances required")
    return any("Signature" in block for block in blocks if isinstance(block, str))


def test_distances_to_be_confirmed_have_a_place_to_sign() -> None:
    points = cloud(blob(150, 0, float(LEVEL.height(np.array(150.0))) - 1.0), 5)
    for name, voltage, wanted in (
        ("en_50341", 380.0, True),
        ("en_50341", 22.0, True),  # from a secondary text
        ("nerc_fac_003", 345.0, True),  # from two
        ("cpuc_go95", 345.0, False),
    ):
        found = run(points, rules=name, voltage=voltage, falling=False)["report"]
        assert signed(found) == wanted, (name, voltage)
        blocks = next(s.blocks for s in found.sections if s.title == "Distances required")
        assert any("national annex" in str(block) for block in blocks) == (name == "en_50341")


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"distance": 5.0}, "given for this report"),
        ({"distance": 5.0, "growth": 1.0}, "given for this report"),
        ({"rule_table": Table(pd.DataFrame([{"confirmed": True}]))}, "given for this report"),
        ({"rule_table": Table(pd.DataFrame([{"confirmed": False}]))}, "to be confirmed"),
        ({"rules": "thesis"}, "read in the source"),
        ({"rules": "nerc_fac_003", "voltage": 345.0}, "to be confirmed"),
    ],
)
def test_the_report_says_who_vouches_for_a_distance(settings: dict[str, Any], told: str) -> None:
    if "rule_table" in settings:
        (more,) = settings["rule_table"].frame.to_dict("records")
        settings = {"rule_table": Table(pd.DataFrame([row(**more)]))}
    found = run(hung(bits(150.0, 9.0, 3)), falling=False, **settings)["report"]
    (table, *_) = next(s.blocks for s in found.sections if s.title == "Distances required")
    assert set(table.table.frame.confirmed.dropna()) == {told}


def test_that_nothing_is_too_near_is_said_with_the_kinds_that_have_no_rule() -> None:
    points = cloud(blob(150, 0, float(LEVEL.height(np.array(150.0))) - 9.0), 5)
    for settings, told in (
        ({"distance": 5.0}, "ground, water, rail, road, line"),
        ({"rule_table": Table(pd.DataFrame([row()]))}, "building, other, ground, water, rail, "),
    ):
        summary = run(points, falling=False, **settings)["report"].summary
        wanted = "No object is nearer to the conductors than is required; there is no rule for: "
        assert summary.startswith(wanted + told)
        assert "Least distances in space: tree 9.00 m (span 1)." in summary


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"rules": "thesis"}, "risk classes of a study, Muş (2019); they are no regulation"),
        (
            {"rules": "en_50341", "voltage": 22.0},
            "EN 50341 and EN 50423 for a voltage of 22 kV, as tabulated by this program; the "
            "regulation in force and its national annex decide",
        ),
        (
            {"rules": "nerc_fac_003", "voltage": 345.0},
            "NERC FAC-003-4 for a voltage of 345 kV, as tabulated by this program; the regulation "
            "in force decides.",
        ),
        (
            {"distance": 5.0},
            "5 m from all objects, as given for this report; no rule set was applied",
        ),
    ],
)
def test_the_summary_begins_with_the_finding_and_says_whose_rules_these_are(
    settings: dict[str, Any], told: str
) -> None:
    points = cloud(blob(150, 0, float(LEVEL.height(np.array(150.0))) - 1.0), 5)
    summary = run(points, falling=False, **settings)["report"].summary
    assert summary.startswith("1 objects are nearer to the conductors than is required (1 crit")
    assert "The worst is 1.00 m from a wire of span 1 where " in summary
    assert told in summary
    assert "\n" not in summary
    assert summary.endswith(
        "Looked at: 1 spans of 300 m in all, with the wires as surveyed; hotter, in wind or under "
        "ice they were not held to the rules. No point is ground: heights are not known, and "
        "falling trees not looked for."
    )


@pytest.mark.parametrize(
    ("settings", "warned"),
    [({}, True), ({"rules": "en_50341", "voltage": 22.0}, False), ({"distance": 5.0}, False)],
)
def test_rules_of_a_study_are_told_to_be_no_regulation(
    settings: dict[str, Any], warned: bool, caplog: pytest.LogCaptureFixture
) -> None:
    run(cloud(blob(150, 0, 9), 5), falling=False, **settings)
    assert ("are the risk classes of a study, Muş (2019), and no regul" in caplog.text) == warned


def test_the_rule_tables_hold_no_notes_of_their_makers_to_themselves() -> None:
    for name in shipped():
        assert not rule_set(name).frame.note.str.contains("ecalled|ook it|ours", na=False).any()


@pytest.mark.parametrize(("count", "up", "told"), [(3, 9.0, True), (2, 9.0, False), (3, -9, False)])
def test_what_hangs_above_all_wires_may_be_an_earth_wire(
    count: int, up: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Of a line in hills 14 points were seen of the guard wires, and nothing said so."""
    found = run(hung(*(bits(150.0 + 9 * k, -up, 1) for k in range(count))), distance=2.0)
    text = f"3 points hang in mid-air above all wires of spans 1, the first at {EAST + 150:.10g}"
    assert (text in caplog.text) == told
    assert ("a guard wire was not found, and it goes on over the spans" in caplog.text) == told
    assert found["unsure"].frame.points.tolist() == ([count] if told else [])
    assert found["unsure"].frame["distance"].tolist() == pytest.approx(
        [up] if told else [], abs=0.01
    )
    assert "3 points hang in mid-air on a wire" not in caplog.text, "told twice"
    assert len(found["violations"]) == (count if told else 0)


def test_what_hangs_far_from_all_rules_is_told() -> None:
    found = run(hung(bits(150.0, 9.0, 2)), distance=2.0)
    assert found["unsure_count"] == 0
    unseen = found["report"].head.unseen
    told = "Hang in mid-air, may be of the line, and would break no rule; the nearest is 9.0 m from"
    assert f"{told} a wire: 2 points." in unseen


def test_trees_alone_are_no_wires(caplog: pytest.LogCaptureFixture) -> None:
    xyz = np.vstack([leaves(80, 0, 15, (6, 6, 8)), leaves(200, 4, 12, (90, 2, 2), 9000)])
    points = cloud(xyz, 5, HeightAboveGround=xyz[:, 2].astype(np.float32))
    found = run(points, distance=12.0, falling=False)
    assert len(found["objects"])
    assert not found["objects"].frame.may_be_wire.any()
    assert found["spans"].frame.wire_like.tolist() == [0.0]
    assert "shape of a wire" not in caplog.text
    assert found["report"].sections[0].title != "Wires that may be missing"


@pytest.mark.parametrize(
    ("kind", "away", "told"),
    [(5, 0.3, True), (5, 0.6, False), (26, 0.3, True), (1, 0.6, True), (1, 1.1, False)],
)
def test_what_is_as_near_as_points_of_the_wire_may_touch_it(
    kind: int, away: float, told: bool
) -> None:
    """A tree in the wire was told to be 0.22 m away: all that is nearer is labelled as wire."""
    tree = np.vstack([LEVEL.points(np.full(20, 150.0)) - (0, away, 0)] * 2)
    tree[:, 1] -= np.repeat(np.linspace(0, 1, 20), 2)
    found = run(cloud(tree, kind), distance=5.0, free_air=0.0, min_object_height=0.0, falling=False)
    assert found["objects"].frame.may_touch.tolist() == [told]
    assert ("Objects that may touch a wire as surveyed: 1;" in found["report"].summary) == told


def test_kinds_that_no_point_has_the_class_of_are_told() -> None:
    """No road was too close, as nothing said where roads are."""
    told = "No point near the wires has the class of: water, rail. What"
    ground, road = [(150.0, 4.0, 0.0)], [(150.0, 5.0, 0.0)]
    found = run(cloud([*ground, *road], [2, 11]), rules="en_50341", voltage=220.0)
    assert [told in text for text in found["report"].head.unseen].count(True) == 1


def test_trees_of_high_voltage_are_taken_for_such_that_can_be_climbed() -> None:
    """At 110 kV less had been asked for than at 20 kV."""
    asked = []
    for voltage in (20.0, 110.0, 220.0, 380.0):
        tree = np.vstack([LEVEL.points(np.full(5, 150.0)) - (0, 0.9, 0)] * 2)
        found = run(
            cloud(tree, 5),
            rules="en_50341",
            voltage=voltage,
            free_air=0.0,
            min_object_height=0.0,
            falling=False,
        )
        asked += found["objects"].frame.required.tolist()
    assert asked == [2.1, 2.5, 3.2, 4.3]


def test_what_the_layer_of_wires_lacks_is_in_table_and_report() -> None:
    """Span 2 has fewer conductors than its neighbours, and was seen along a half."""
    wires = layer(LEVEL, replace(LEVEL, y=40.0))
    frame = wires.frame.assign(
        conductors=[3, 2], expected=[3, 3], seen_share=[1.0, 0.5], longest_gap=[1.0, 150.0],
        from_tower=1, to_tower=2,
    )  # fmt: skip
    sources = {"points": cloud(flat(), 2), "wires": Vector(frame, geometry_type="LineString Z")}
    found = toolbox.run("corridor.clearance", {**sources, "falling": False})
    table = found["spans"].frame
    assert table[["conductors", "expected", "seen_share"]].to_numpy().tolist() == [
        [3, 3, 1.0],
        [2, 3, 0.5],
    ]
    (text,) = found["report"].sections[0].blocks
    assert "Span 2: 2 conductors, where its neighbours have 3.\n" in text
    assert "Span 2: conductor 2 was seen along 50 % only, with a gap of 150 m." in text


@pytest.mark.parametrize("curve", [LEVEL, SLOPING, SLACK])
def test_distances_are_those_of_a_dense_search(curve: Catenary) -> None:
    """Every millimetre of the wire is looked at in place of solving."""
    rng = np.random.default_rng(1)
    u = rng.uniform(-0.1, 1.1, 40) * curve.length
    near = curve.points(np.clip(u, 0, curve.length)) + rng.normal(0, 12, (40, 3))
    # Far above a slack wire, places on both sides of its lowest are nearest.
    above = curve.points(np.array([0.4, 0.6]) * curve.length) + np.array([0, 0, 70])
    xyz = np.vstack([near, above])
    found = distances(xyz, curve)
    line = curve.points(np.linspace(0, curve.length, 300_001))
    for point, (space, vertical, plan, _) in zip(xyz, found, strict=True):
        away = np.linalg.norm(line - point, axis=1)
        assert space == pytest.approx(away.min(), abs=1e-5)
        beside = np.linalg.norm(line[:, :2] - point[:2], axis=1)
        assert plan == pytest.approx(beside.min(), abs=1e-5)
        assert vertical == pytest.approx(line[beside.argmin(), 2] - point[2], abs=2e-3)


def test_distance_below_the_lowest_point_is_the_height_difference() -> None:
    low = LEVEL.height(np.array(150.0))
    ((space, vertical, plan, u),) = distances(np.array([[150.0, 0.0, low - 7.25]]), LEVEL)
    assert (space, vertical, plan, u) == pytest.approx((7.25, 7.25, 0.0, 150.0), abs=1e-6)


def test_beyond_the_end_the_end_is_nearest() -> None:
    ((space, _, plan, u),) = distances(np.array([[304.0, 3.0, 30.0]]), LEVEL)
    assert (space, plan, u) == pytest.approx((5.0, 5.0, 300.0))


def test_the_severest_rule_wins_then_the_one_broken_worst() -> None:
    rules = [
        rule(id="far", threshold=20.0, severity="warning"),
        rule(id="near", threshold=6.0),
        rule(id="nearer", threshold=8.0),
    ]
    low = float(LEVEL.height(np.array(150.0)))
    xyz = np.array([[150.0, 0, low - d] for d in (5.0, 7.0, 12.0, 25.0)])
    kind = np.full(4, KINDS.index("tree"), np.int8)
    found, least = find_violations(xyz, kind, [[LEVEL]], rules, reach=20, point_sd=0.05)
    assert [rules[r].id for r in found.rule] == ["nearer", "nearer", "far"]
    np.testing.assert_allclose(found.measure, [5.0, 7.0, 12.0], atol=1e-9)
    assert least.distance[0, 0, KINDS.index("tree")] == pytest.approx(5.0)


def test_vertical_and_horizontal_rules_look_in_their_strip_alone() -> None:
    rules = [
        rule(id="v", direction="vertical", threshold=6.0, within=2.0),
        rule(id="h", direction="horizontal", threshold=3.0, within=1.0),
    ]
    low = float(LEVEL.height(np.array(150.0)))
    places = [(150, 1.9, low - 5), (150, 2.1, low - 5), (150, 2.5, low - 0.5), (150, 2.5, low - 2)]
    kind = np.full(4, KINDS.index("building"), np.int8)
    found, _ = find_violations(np.array(places, float), kind, [[LEVEL]], rules, reach=9, point_sd=0)
    assert [(int(p), rules[r].id) for p, r in zip(found.point, found.rule, strict=True)] == [
        (0, "v"),
        (2, "h"),
    ]
    np.testing.assert_allclose(found.measure, [5.0, 2.5], atol=0.002)


def test_no_point_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every point against every wire, rule and state, one by one."""
    monkeypatch.setattr("algorithms.corridor._clearance.distances.MEASURED_BLOCK", 700)
    rng = np.random.default_rng(4)
    blown = [replace(c, swing=0.4) for c in (LEVEL, SLOPING)]
    curves = [[LEVEL, SLOPING], blown]
    places = [c.points(rng.uniform(0, c.length, 1000)) for wires in curves for c in wires]
    xyz = np.concatenate(places) + rng.normal(0, 9, (4000, 3))
    kind = rng.integers(0, 3, 4000).astype(np.int8)
    rules = [
        rule(id="a", kind="tree", threshold=9.0, severity="warning"),
        rule(id="b", kind="building", direction="vertical", threshold=12.0, within=4.0),
        rule(id="c", kind="any", direction="horizontal", threshold=3.0, within=7.0),
    ]
    wanted: dict[int, tuple[Any, ...]] = {}
    for state, wires in enumerate(curves):
        for wire, curve in enumerate(wires):
            for i, (space, vertical, plan, _) in enumerate(distances(xyz, curve)):
                name = KINDS[kind[i]]
                options = (
                    (1, "a", space / 9, name == "tree"),
                    (0, "b", max(abs(vertical) / 12, plan / 4), name == "building"),
                    (0, "c", max(plan / 3, abs(vertical) / 7), True),
                )
                for rank, one, ratio, holds in options:
                    if holds and ratio < 1:
                        key = (rank, ratio, one, wire, state)
                        wanted[i] = min(wanted.get(i, key), key)
    found, least = find_violations(xyz, kind, curves, rules, reach=12.0, point_sd=0.1)
    assert 100 < len(found) < 3000
    assert {
        int(p): (rules[r].id, int(w), int(s))
        for p, r, w, s in zip(found.point, found.rule, found.wire, found.state, strict=True)
    } == {i: key[2:] for i, key in wanted.items()}
    for number in range(3):
        brute = distances(xyz, blown[1])[:, 0] + np.where(kind == number, 0.0, np.inf)
        assert least.distance[1, 1, number] == pytest.approx(brute.min(), abs=1e-9)
        assert least.point[1, 1, number] == brute.argmin()


def test_the_wire_and_rule_that_are_worst_are_found_among_many() -> None:
    """Wires that cannot be worse are not measured; with all of them measured it is the same."""
    rng = np.random.default_rng(5)
    wires = [replace(LEVEL, y=3.0 * k, z_start=30.0 + 2 * k, z_end=90.0 - 9 * k) for k in range(9)]
    xyz = np.column_stack(
        [*rng.uniform((0, -10), (300, 35), (6000, 2)).T, rng.uniform(0, 90, 6000)]
    )
    rules = [
        rule(id="a", threshold=9.0, severity="warning"),
        rule(id="b", threshold=4.0),
        rule(id="c", threshold=7.0),
    ]
    bare = rng.random(len(xyz)) < 0.3  # of the ground, which rules do not look at
    xyz[bare, 2] -= 40.0
    space, _, plan, _ = np.moveaxis([distances(xyz, wire) for wire in wires], 2, 0)
    nearest = np.where(bare, np.inf, space.min(axis=0))
    kind = np.where(bare, KINDS.index("ground"), KINDS.index("tree")).astype(np.int8)
    found, least = find_violations(xyz, kind, [wires], rules, reach=12.0, point_sd=0.1)
    np.testing.assert_array_equal(found.point, np.flatnonzero(nearest < 9))
    np.testing.assert_array_equal(found.wire, space.argmin(axis=0)[found.point])
    np.testing.assert_array_equal(found.rule, np.where(nearest < 7, 2, 0)[found.point])
    np.testing.assert_allclose(found.measure, nearest[found.point])
    for number in np.unique(kind):
        seen = np.where((kind == number) & (plan <= 12), space, np.inf)
        np.testing.assert_allclose(least.distance[0, :, number], seen.min(axis=1))


def test_probability_is_one_half_at_the_limit_and_follows_the_normal_law() -> None:
    low = float(LEVEL.height(np.array(150.0)))
    sure = replace(LEVEL, covariance=np.zeros((3, 3)))
    xyz = np.array([[150.0, 0, low - d] for d in (5.0 - 1e-9, 4.9)])
    kind = np.zeros(2, np.int8)
    found, _ = find_violations(xyz, kind, [[sure]], [rule()], reach=9, point_sd=0.1)
    np.testing.assert_allclose(found.sd, 0.1)
    np.testing.assert_allclose(found.probability, [0.5, 0.841345], atol=1e-5)


def test_uncertainty_of_the_wire_is_part_of_that_of_the_clearance() -> None:
    loose = replace(LEVEL, covariance=np.diag([0.04, 0.04, 0.0]))  # both ends: 0.2 m
    low = float(LEVEL.height(np.array(150.0)))
    found, _ = find_violations(
        np.array([[150.0, 0, low - 4]]),
        np.zeros(1, np.int8),
        [[loose]],
        [rule()],
        reach=9,
        point_sd=0.1,
    )
    assert found.sd[0] == pytest.approx(math.sqrt(0.04 / 2 + 0.01), rel=1e-3)


def test_re_sag_of_the_worked_case() -> None:
    """320 m, 9.2 m of sag, 15 to 100 degrees: 2.7 m more (DEM handbook, chapter 33)."""
    curve = Catenary(0, 0, 1, 0, 320.0, 40.0, 40.0, 1 / 1392.835)
    assert curve.sag == pytest.approx(9.2, abs=1e-4)
    hot = in_state(curve, DRAKE, State("hot", 100.0), surveyed=15.0)
    assert hot.sag - curve.sag == pytest.approx(2.7, abs=0.1)
    same = in_state(curve, DRAKE, State("same", 15.0), surveyed=15.0)
    assert same.curvature == pytest.approx(curve.curvature, rel=1e-9)


def test_a_wire_that_cannot_stretch_keeps_its_heated_length() -> None:
    stiff = Conductor("stiff", 0.03, 15.0, 1e15, 2e-5)
    hot = in_state(SLOPING_CALM, stiff, State("hot", 65.0), surveyed=15.0)
    assert hot.arc == pytest.approx(SLOPING_CALM.arc * 1.001, rel=1e-9)
    assert (hot.z_start, hot.z_end) == (SLOPING_CALM.z_start, SLOPING_CALM.z_end)


def test_the_length_without_tension_grows_with_temperature_alone() -> None:
    """Tension is summed along the wire, in place of the formula."""

    def rest(curve: Catenary) -> float:
        u = np.linspace(0.0, curve.length, 100_001)
        line = curve.points(u)
        pieces = np.linalg.norm(np.diff(line, axis=0), axis=1)
        tension = DRAKE.weight * (line[:, 2] - curve.z0 + curve.c)
        pull = float((pieces * (tension[1:] + tension[:-1]) / 2).sum())
        return float(pieces.sum()) - pull / DRAKE.stiffness

    hot = in_state(SLOPING_CALM, DRAKE, State("hot", 80.0), surveyed=10.0)
    grown = rest(hot) / rest(SLOPING_CALM) - 1
    assert grown == pytest.approx(70 * DRAKE.expansion, rel=1e-5)


SLOPING_CALM = replace(SLOPING, swing=0.0, v1=0.0, v0=0.0)


def test_wind_swings_by_load_over_weight_and_keeps_the_length_of_a_stiff_wire() -> None:
    stiff = Conductor("stiff", 0.028, 15.0, 1e15, 0.0)
    blown = in_state(LEVEL, stiff, State("wind", None, 15.0), surveyed=15.0)
    load = 0.5 * 1.225 * 0.028 * 225
    assert blown.swing == pytest.approx(load / 15.0)
    line = blown.points(np.linspace(0, 300, 20_001))
    length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    assert length == pytest.approx(LEVEL.arc, abs=2e-3)
    other = in_state(LEVEL, stiff, State("wind", None, -15.0), surveyed=15.0)
    assert other.offset(np.array(150.0)) == pytest.approx(-blown.offset(np.array(150.0)))
    assert blown.offset(np.array(150.0)) > 2


def test_uncertain_temperature_makes_the_sag_uncertain() -> None:
    exact = replace(LEVEL, covariance=np.zeros((3, 3)))
    warm = [
        in_state(exact, DRAKE, State("hot", 80.0), surveyed=t, surveyed_sd=5.0)
        for t in (10, 15, 20)
    ]
    sd = float(warm[1].height_sigma(np.array([150.0]))[0])
    assert sd == pytest.approx((warm[0].sag - warm[2].sag) / 2, rel=0.05)


def test_ruling_span_shares_the_tension() -> None:
    hot = State("hot", 90.0)
    alone = in_state(LEVEL, DRAKE, hot, surveyed=15.0)
    same = in_state(LEVEL, DRAKE, hot, surveyed=15.0, ruling_span=300.0)
    longer = in_state(LEVEL, DRAKE, hot, surveyed=15.0, ruling_span=400.0)
    assert same.curvature == pytest.approx(alone.curvature, rel=1e-9)
    assert longer.sag < alone.sag  # longer spans lose less of their tension


def test_ieee_738_heats_drake_to_100_degrees() -> None:
    """The example of the standard: 1025 A at 40 degrees, 0.61 m/s."""
    wire = Conductor("Drake", 0.02812, 16.0, 1.0, 1.0, (7.283e-5, 8.688e-5))
    assert cooling(0.02812, 100.7, 40.0, 0.61, 0.0) == pytest.approx(83.061, abs=0.5)
    assert cooling(0.02812, 100.0, 40.0, 0.0, 0.0) == pytest.approx(42.4, abs=0.1)
    reynolds = 0.02812 * 1.029 * 5.0 / 2.043e-5  # air at 70 degrees, from the tables
    fast = 0.754 * reynolds**0.6 * 0.0295 * 60.0
    assert cooling(0.02812, 100.0, 40.0, 5.0, 0.0) == pytest.approx(fast, rel=0.005)
    sun = 22.44 / (0.8 * 0.02812)  # W/m of the example
    found = conductor_temperature(wire, current=1025, air=40, wind=0.61, sun=sun)
    assert found == pytest.approx(100.0, abs=0.5)
    with pytest.raises(DataError, match="resistance is not known"):
        conductor_temperature(conductor_of("Aster 600"), current=1, air=0, wind=0, sun=0)


def test_a_falling_tree_reaches_as_far_as_it_is_high() -> None:
    low = float(LEVEL.height(np.array(150.0)))
    for height, hits in (
        (math.hypot(15.0, low) + 0.01, True),
        (math.hypot(15.0, low) - 0.01, False),
    ):
        left, wire, _, u = fall_in(np.array([[150.0, 15.0, height]]), np.array([height]), [[LEVEL]])
        assert (left[0] < 0) == hits
        assert abs(left[0]) == pytest.approx(0.01, abs=1e-6)
        assert (wire[0], u[0]) == (0, pytest.approx(150.0))


def test_tops_are_local_and_high() -> None:
    xyz = np.array([[0, 0, 9.0], [2, 0, 8.0], [6, 0, 7.0], [20, 0, 2.0]])
    assert tree_tops(xyz, xyz[:, 2]).tolist() == [0, 2]
    assert tree_tops(xyz, np.full(4, np.nan)).tolist() == []


def test_groups_are_chains_of_one_kind() -> None:
    xyz = np.array([[0, 0, 0], [0.9, 0, 0], [1.8, 0, 0], [9, 0, 0], [9.1, 0, 0]])
    found = groups(xyz, np.array([0, 0, 0, 0, 1]), 1.0)
    assert len(set(found[:3])) == 1
    assert len(set(found)) == 3


def test_points_farther_apart_than_the_gap_are_two_objects() -> None:
    """Wherever they lie; in cells of half a gap those 1.2 gaps apart were one, or two."""
    for start in np.arange(0, 1, 0.1):
        xyz = np.array([[start, 0, 0], [start + 0.99, 0, 0], [start + 2.19, 0, 0]])
        assert groups(xyz, np.zeros(3, int), 1.0).tolist() == [0, 0, 1]


def test_objects_with_their_distance_rule_and_height() -> None:
    low = float(LEVEL.height(np.array(150.0)))
    trees = [*blob(150, 0, low - 4.0), *blob(80, 3.0, float(LEVEL.height(np.array(80.0))))]
    ground = flat()
    result = run(cloud([*trees, *ground], [5] * 10 + [2] * len(ground)), distance=5.0)
    frame = result["objects"].frame
    assert frame.clearance.to_list() == pytest.approx([3.0, 4.0], abs=0.01)
    tall = [float(LEVEL.height(np.array(80.0))), low - 4.0]
    assert frame.height.to_list() == pytest.approx(tall, abs=0.02)
    assert frame.rule.to_list() == ["given distance"] * 2
    assert frame.severity.to_list() == ["critical"] * 2
    assert frame.geometry.x.to_list() == pytest.approx([EAST + 80, EAST + 150], abs=0.01)
    assert result["least_clearance"] == pytest.approx(3.0, abs=0.01)
    assert (result["object_count"], result["critical_count"]) == (2, 2)
    found = result["violations"]
    assert len(found) == 10
    assert set(found["object_id"]) == {1, 2}
    assert found["distance"].min() == pytest.approx(3.0, abs=0.01)
    assert set(found["rule"]) == {1}
    sigma = LEVEL_SURE.height_sigma(np.array([80.0]))[0]
    assert result["spans"].frame.clearance_sd[0] == pytest.approx(math.hypot(0.05, sigma), rel=1e-3)
    spans = result["spans"].frame
    assert spans.tree.to_list() == pytest.approx([3.0], abs=0.01)
    assert spans.ground.to_list() == pytest.approx([low], abs=0.05)
    assert spans.sag.to_list() == pytest.approx([LEVEL.sag])


def test_what_is_of_the_line_or_noise_is_no_violation_and_told() -> None:
    low = float(LEVEL.height(np.array(150.0)))
    near = blob(150, 0, low - 1.0)
    for code in (7, 13, 14, 15, 16, 18):
        result = run(cloud(near, code), distance=5.0)
        assert result["object_count"] == 0
        assert result["report"].summary.startswith("No object is nearer")
    withheld = run(cloud(near, 5, withheld=np.ones(len(near), np.uint8)), distance=5.0)
    assert withheld["object_count"] == 0
    assert no_part(withheld["report"]) == {"Withheld": 5}
    on_wire, at_end = blob(150, 0, low + 0.3), blob(299, 0, 28.0)
    assert run(cloud(on_wire + at_end, 1), distance=5.0)["object_count"] == 0
    report = run(cloud(on_wire + at_end, 1), distance=5.0)["report"]
    assert no_part(report) == {"Without a class, on a wire or at a support": 10}
    assert run(cloud(on_wire + at_end, 5), distance=5.0)["object_count"] == 2


def no_part(report: Report) -> dict[str, int]:
    """Numbers of the points that are measured from no wire, by reason."""
    (block,) = next(s.blocks for s in report.sections if s.title == "Points that take no part")
    assert isinstance(block, Rows)
    return dict(block.table.frame.to_numpy().tolist())


def test_too_few_points_are_no_object_but_violations_and_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    low = float(LEVEL.height(np.array(150.0)))
    for count, objects in ((2, 0), (3, 1)):
        result = run(cloud(blob(150, 0, low - 3.0, count), 5), distance=5.0)
        assert result["object_count"] == objects
        assert result["violations"]["object_id"].tolist() == [objects] * count
        told = "2 points are too close, but too few for an object" in caplog.text
        assert told == (objects == 0)
        assert (
            not told or f"the most urgent at {result['violations'].xyz[0, 0]:.10g}" in caplog.text
        )
        caplog.clear()


def test_points_without_a_class_keep_the_rules_for_trees_and_buildings() -> None:
    table = Table(pd.DataFrame([row(kind="building"), row(id="b", kind="ground")]))
    low = float(LEVEL.height(np.array(150.0)))
    for code, count in ((1, 1), (6, 1), (5, 0), (2, 1)):
        made = run(cloud(blob(150, 0, low - 2), code), rule_table=table, falling=False)
        assert made["object_count"] == count, code


def test_hot_and_windy_wires_come_nearer() -> None:
    low = float(LEVEL.height(np.array(150.0)))
    below, beside = blob(150, 0, low - 6.0), blob(150, 6.0, low + 1.0)
    points = cloud(below + beside, 5)
    calm = run(points, distance=5.0)
    assert calm["object_count"] == 0
    states = {"conductor": "Drake", "survey_temperature": 15.0, "temperature": 90.0, "wind": 20.0}
    result = run(points, distance=5.0, **states)
    frame = result["objects"].frame
    assert set(frame.state) == {"90 C", "blown left"}
    assert len(result["spans"]) == 4
    by_state = result["spans"].frame.set_index("state")
    assert by_state.sag["90 C"] > by_state.sag["survey"] + 1.5
    assert by_state.clearance["90 C"] < by_state.clearance["survey"] - 1.5
    assert by_state.clearance_sd["90 C"] > by_state.clearance_sd["survey"]


def test_what_is_listed_only_with_hot_or_windy_wires_is_told_apart() -> None:
    """At 150 m too near when hot alone, at 60 m always."""
    low = [float(LEVEL.height(np.array(x))) for x in (60.0, 150.0)]
    near, hot = blob(60, 0, low[0] - 4.0), blob(150, 0, low[1] - 6.0)
    points = cloud([*near, *hot], 5)
    states = {"conductor": "Drake", "survey_temperature": 15.0, "temperature": 90.0}
    found = run(points, distance=5.0, falling=False, **states)
    frame = found["objects"].frame
    assert dict(zip(frame.chainage.round(-1), frame.as_surveyed, strict=True)) == {
        60.0: True,
        150.0: False,
    }
    assert set(frame.state) == {"90 C"}, "each in the state in which it is worst"
    assert found["violations"]["as_surveyed"].tolist() == [1] * 5 + [0] * 5
    assert frame[["clearance_low", "clearance_high"]].isna().all(axis=None), "of the survey alone"
    told = "Too near only when the wires are hot or in wind: 1 (90 C)."
    assert told in found["report"].summary
    calm = run(points, distance=5.0, falling=False)
    assert calm["objects"].frame.as_surveyed.tolist() == [True]
    assert "Not as surveyed" not in calm["report"].summary


HOT = {"conductor": "Drake", "survey_temperature": 15.0, "temperature": 90.0}


def test_what_is_less_severe_as_surveyed_says_so() -> None:
    """Trees that broke a rule with hot wires alone were "listed also as surveyed", as watched."""
    low = float(LEVEL.height(np.array(150.0)))
    points = cloud(blob(150, 0, low - 6.0), 5)
    found = run(points, distance=5.0, growth=2.0, falling=False, **HOT)
    (one,) = found["objects"].frame.to_dict("records")
    assert (one["severity"], one["state"]) == ("critical", "90 C")
    assert (one["severity_surveyed"], one["as_surveyed"]) == ("watch", False)
    assert one["clearance_surveyed"] == pytest.approx(6.0, abs=0.01)
    assert not found["violations"]["as_surveyed"].any()
    summary = found["report"].summary
    assert "That is only with the conductors at 90 °C; as surveyed it is 6.00 m." in summary
    assert "Too near only when the wires are hot or in wind: 1 (90 C)." in summary
    page = found["report"].html()
    assert "Severity as surveyed" in page
    assert "Severity as surveyed" not in run(points, distance=7.0, falling=False)["report"].html()


def test_what_breaks_a_rule_also_as_surveyed_is_not_told_to_do_so_only_when_hot() -> None:
    """Critical when hot, and a warning as surveyed."""
    low = float(LEVEL.height(np.array(150.0)))
    table = Table(pd.DataFrame([row(), row(id="w", threshold=7.0, severity="warning")]))
    found = run(cloud(blob(150, 0, low - 6.0), 5), rule_table=table, falling=False, **HOT)
    (one,) = found["objects"].frame.to_dict("records")
    assert (one["severity_surveyed"], one["as_surveyed"]) == ("warning", False)
    summary = found["report"].summary
    assert "That is with the conductors at 90 °C; as surveyed it is 6.00 m." in summary
    assert "Too near only when" not in summary


def test_the_worst_in_wind_is_told_with_the_wind() -> None:
    low = float(LEVEL.height(np.array(150.0)))
    points = cloud(blob(150, 6.0, low + 1.0), 5)
    calm = {"conductor": "Drake", "survey_temperature": 15.0}
    summary = run(points, distance=5.0, falling=False, wind=20.0, **calm)["report"].summary
    assert "That is only with the wires blown left by 20 m/s; as surveyed it is 6.0" in summary
    assert "That is" not in run(points, distance=7.0, falling=False)["report"].summary


def test_a_tree_that_falls_on_hot_wires_alone_is_told_apart() -> None:
    ground = flat()
    away = float(LEVEL.height(np.array(150.0)))
    for top, surveyed in ((0.5, True), (-0.5, False)):
        tall = math.hypot(15.0, away) + top
        points = cloud([*blob(150, 15, tall), *ground], [5] * 5 + [2] * len(ground))
        states = {"conductor": "Drake", "survey_temperature": 15.0, "temperature": 90.0}
        (one,) = run(points, distance=1.0, **states)["objects"].frame.to_dict("records")
        assert (one["rule"], one["state"], one["as_surveyed"]) == ("falling", "90 C", surveyed)


@pytest.mark.parametrize(("towers", "told"), [((1, 2), False), ((1, 0), True)])
def test_spans_that_end_without_a_tower_are_named_if_they_hang_otherwise(
    towers: tuple[int, int], told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    wires = Vector(layer(LEVEL).frame.assign(from_tower=towers[0], to_tower=towers[1]))
    hot = {"conductor": "Drake", "survey_temperature": 15.0, "temperature": 90.0}
    sources = {"points": cloud(blob(150, 0, 9), 5), "wires": wires, "distance": 5.0}
    page = toolbox.run("corridor.clearance", sources | hot)["report"].html()
    assert ("Spans 1 end without a tower" in page) == told
    assert ("1 spans end without a tower" in caplog.text) == told
    assert "without a tower" not in toolbox.run("corridor.clearance", sources)["report"].html()


def test_places_along_a_span_are_told_from_where_its_longest_wire_begins() -> None:
    """Of a span that the data cut they were told from each wire's own start, 9 m apart."""
    short = replace(LEVEL.between(20.0, 300.0), y=8.0)
    wires = layer(LEVEL, short)
    wires = Vector(wires.frame.assign(span_id=1))
    ground = np.array(flat())
    ground[:, 2] += 12.0 * (np.hypot(ground[:, 0] - 150.0, ground[:, 1] - 9.0) < 3.0)
    points = cloud([*blob(150, 9, 25.0), *ground], [5] * 5 + [2] * len(ground))
    found = toolbox.run("corridor.clearance", {"points": points, "wires": wires, "distance": 5.0})
    assert found["objects"].frame.wire_id.tolist() == [2], "of the short one"
    assert found["objects"].frame.chainage.tolist() == pytest.approx([150.0], abs=0.5)
    assert found["spans"].frame.ground_at.tolist() == pytest.approx([150.0], abs=4.0)


def test_falling_trees_are_watched_unless_they_are_too_near_already() -> None:
    ground = flat()
    tall = [*blob(150, 15, 34.0), *blob(60, -16, 15.0), *blob(200, 1.0, 18.0)]
    points = cloud([*tall, *ground], [5] * 15 + [2] * len(ground))
    result = run(points, distance=5.0)
    frame = result["objects"].frame
    assert frame.rule.to_list() == ["given distance", "falling"]
    (rules,) = next(
        part.blocks for part in result["report"].sections if part.title == "Distances required"
    )
    told = rules.table.frame.set_index("rule").confirmed
    assert told["given distance"] == "given for this report"
    assert pd.isna(told["falling"])
    low = LEVEL.height(np.array(150.0))
    assert frame.falls[1] == pytest.approx(math.hypot(15, low) - 34.0, abs=0.1)
    assert np.isnan(frame.required[1]), "no rule asks for a distance of a tree that stands"
    assert frame.severity[1] == "watch"
    # As it stands: no nearer than its crown is to the side, and above the wire.
    assert frame["distance"][1] == pytest.approx(math.hypot(15, 34.0 - low), abs=0.6)
    assert frame.clearance[1] == frame["distance"][1]
    assert 0 < frame.clearance_low[1] <= frame.clearance[1] <= frame.clearance_high[1]
    among = result["violations"]["object_id"] == frame.object_id[1]
    assert result["violations"]["clearance"][among].min() == pytest.approx(frame.clearance[1])
    assert frame.vertical[1] == pytest.approx(low - 34.0, abs=0.6)
    assert frame.horizontal[1] == pytest.approx(15, abs=0.6)
    assert run(points, distance=5.0, falling=False)["object_count"] == 1


def test_a_falling_tree_is_all_its_points_and_stands_where_it_is_closest() -> None:
    """Its top alone was measured, and told 19.76 m of a tree whose branches were 6.8 m away."""
    ground, crown = flat(), leaves(150.0, 15.0, 22.0, (10.0, 10.0, 24.0))
    points = cloud([*crown, *ground], [5] * len(crown) + [2] * len(ground))
    result = run(points, distance=5.0)
    (one,) = result["objects"].frame.to_dict("records")
    away = distances(crown, LEVEL)[:, 0]
    assert (one["rule"], one["severity"], one["points"]) == ("falling", "watch", len(crown))
    assert one["clearance"] == one["distance"] == pytest.approx(away.min(), abs=0.01)
    assert one["clearance_surveyed"] == pytest.approx(one["clearance"])
    place = crown[away.argmin()] + np.array([EAST, NORTH, 0.0])
    assert shapely.get_coordinates(one["geometry"], include_z=True)[0] == pytest.approx(place)
    assert one["height"] == pytest.approx(crown[:, 2].max(), abs=0.01)
    feet = crown * np.array([1.0, 1.0, 0.0])
    reach = distances(feet, LEVEL)[:, 0] - crown[:, 2]
    assert one["falls"] == pytest.approx(reach.min(), abs=0.01)
    assert reach.min() < reach[crown[:, 2].argmax()] - 0.5, "not the top reaches farthest"
    listed = result["violations"]
    assert listed["object_id"].tolist() == [1] * len(crown)
    assert set(listed["severity"]) == {4}
    assert listed["distance"].min() == pytest.approx(one["distance"], abs=1e-4)
    counts = [result[f"{word}_count"] for word in ("object", "critical", "warning", "watch")]
    assert counts == [0, 0, 0, 1]


def test_a_tree_with_a_branch_too_close_is_no_falling_tree_besides() -> None:
    """The top is farther than a crown from the branch, and still of the same tree."""
    ground, crown = flat(), leaves(150.0, 13.0, 22.0, (8.0, 8.0, 24.0))
    branch = np.array([[150.0, 9.0 - k / 2, 21.0] for k in range(13)])
    points = cloud([*crown, *branch, *ground], [5] * (len(crown) + 13) + [2] * len(ground))
    result = run(points, distance=5.0)
    (one,) = result["objects"].frame.to_dict("records")
    assert (one["severity"], result["watch_count"]) == ("critical", 0)
    assert one["falls"] < 0
    assert len(result["violations"]) == one["points"] < 13


def test_severities_are_counted_apart() -> None:
    ground = flat()
    tall = [*blob(150, 15, 34.0), *blob(60, -16, 15.0), *blob(200, 1.0, 18.0)]
    result = run(cloud([*tall, *ground], [5] * 15 + [2] * len(ground)), distance=5.0)
    counts = [result[f"{word}_count"] for word in ("object", "critical", "warning", "watch")]
    assert counts == [1, 1, 0, 1]


def test_trees_of_one_clump_carry_its_number() -> None:
    """A row of crowns 40 m long is parted tree by tree; a tree apart is a clump of its own."""
    low = float(LEVEL.height(np.array(150.0)))
    row = [p for k in range(9) for p in blob(130 + 5 * k, 0, low - 3.0 - 2 * (k % 2), 40)]
    between = [(130 + k / 2, 0.0, low - 6.0) for k in range(80)]
    alone = blob(60, 0, float(LEVEL.height(np.array(60.0))) - 4.0)
    ground = flat()
    trees = [*row, *between, *alone]
    classes = [5] * len(trees) + [2] * len(ground)
    result = run(cloud([*trees, *ground], classes), distance=8.0, falling=False)
    frame = result["objects"].frame
    assert len(frame) > 2
    assert sorted(frame["clump"].unique()) == [1, 2]
    assert (frame["clump"] == frame["clump"].mode()[0]).sum() == len(frame) - 1
    assert "They stand in 2 clumps." in result["report"].summary
    listed = pd.DataFrame({"severity": ["critical", "critical", "watch"], "clump": [1, 1, 2]})
    assert _in_clumps(listed) == "They stand in 1 clumps.", "of those that are too near"


@pytest.mark.parametrize(("step", "clumps"), [(0.5, 1), (2.5, 2)])
def test_parts_of_one_tree_at_wires_above_each_other_are_of_one_clump(
    step: float, clumps: int
) -> None:
    """Points between them that are not too close join them, if no gap is wider than that."""
    low = float(LEVEL.height(np.array(150.0)))
    upper = replace(LEVEL, z_start=38.0, z_end=38.0)
    parts = [blob(150.0, 1.0, low), blob(150.0, 1.0, low + 8.0)]
    between = [(150.0, 1.0, low + z) for z in np.arange(step, 8.0, step)]
    trees = [*parts[0], *parts[1], *between]
    result = run(cloud(trees, 5), LEVEL, upper, distance=2.0, falling=False)
    frame = result["objects"].frame
    assert frame["clump"].tolist() == [1, clumps]
    summary = result["report"].summary
    assert "2 objects are nearer" in summary
    assert ("They stand in 1 clumps." in summary) == (clumps == 1)


def test_trees_that_will_grow_too_close_are_watched() -> None:
    low = float(LEVEL.height(np.array(150.0)))
    trees = [*blob(150, 0, low - 6.0), *blob(80, 0, low - 1.0), *blob(220, 0, low - 8.5)]
    frame = run(cloud(trees, 5), distance=5.0, growth=2.0)["objects"].frame
    assert frame.rule.to_list() == ["given distance", "given distance+2m"]
    assert frame.severity.to_list() == ["critical", "watch"]
    assert frame.clearance[1] == pytest.approx(6.0, abs=0.02)
    house = cloud(blob(150, 0, low - 6.0), 6)
    assert run(house, distance=5.0, growth=2.0)["object_count"] == 0


def test_feet_and_metres_agree() -> None:
    foot = 1200 / 3937
    low = float(LEVEL.height(np.array(150.0)))
    metres = cloud(blob(150, 0, low - 4.0), 5)
    columns = {
        "classification": metres["classification"],
        "HeightAboveGround": np.full(len(metres), 12.0 / foot),
    }
    feet = PointCloud(metres.xyz / foot, columns, crs=CRS(2263))
    wires = layer(LEVEL, crs=2263, metre=1 / foot)
    result = toolbox.run("corridor.clearance", {"points": feet, "wires": wires, "distance": 5.0})
    assert result["least_clearance"] == pytest.approx(4.0, abs=1e-6)
    assert result["objects"].frame.clearance[0] == pytest.approx(4.0, abs=1e-6)
    assert result["objects"].frame.height[0] == pytest.approx(12.0)
    same = run(metres, distance=5.0)["objects"].frame
    assert result["objects"].frame.sd[0] == pytest.approx(same.sd[0], rel=1e-6)
    profiles = [profile_of(found) for found in (result, run(metres, distance=5.0))]
    assert [unit for unit in ("US ft", "m") for svg in profiles if f"height [{unit}]" in svg] == [
        "US ft",
        "m",
    ]
    longest = [max(map(float, re.findall(r">(\d+)</text>", svg))) for svg in profiles]
    assert longest[0] > 2.5 * longest[1], "the ticks are feet, too"


def profile_of(found: Any) -> str:
    """The first profile of a report."""
    (section,) = (part for part in found["report"].sections if part.title == "Profiles")
    content: bytes = section.blocks[0].content
    return content.decode()


def test_no_wires_is_an_empty_answer() -> None:
    result = toolbox.run(
        "corridor.clearance",
        {
            "points": cloud(blob(0, 0, 9), 5),
            "wires": wire_layer([], np.zeros(3), 1.0, CRS(32635)),
            "rules": "thesis",
        },
    )
    assert (len(result["violations"]), len(result["objects"]), len(result["spans"])) == (0, 0, 0)
    assert result["least_clearance"] is None
    assert "no clearance was measured" in result["report"].summary
    assert "no distance was measured" in result["report"].head.unseen[0]


def row(**changes: Any) -> dict[str, Any]:
    """A rule as it stands in a table."""
    made = {
        "id": "a",
        "source": "us",
        "date": "2024",
        "unit": "m",
        "voltage_min": None,
        "voltage_max": None,
        "kind": "tree",
        "direction": "3-D",
        "threshold": 5.0,
        "within": None,
        "severity": "critical",
        "confirmed": True,
    }
    return made | changes


@pytest.mark.parametrize("name", shipped())
def test_tables_of_the_toolbox_are_sound(name: str) -> None:
    table = rule_set(name)
    frame = table.frame
    voltages = pd.concat([frame.voltage_min, frame.voltage_max]).dropna()
    for voltage in [None] if voltages.empty else voltages:
        rules = rules_of(table, voltage)
        assert all(r.source and r.threshold > 0 for r in rules)


def test_values_of_known_rules() -> None:
    (mvcd,) = rules_of(rule_set("nerc_fac_003"), 345)
    assert mvcd.threshold == pytest.approx(1.31064)
    assert not mvcd.confirmed, "two secondary texts agree on it; the standard was not read"
    by_id = {r.id: r for r in rules_of(rule_set("ch_lev"), 220)}
    assert by_id["lev-38-direct"].threshold == pytest.approx(4.7)
    assert by_id["lev-102-rail"].threshold == pytest.approx(9.2)
    assert by_id["lev-40-water"].threshold == pytest.approx(6.2)
    go95 = {r.id: r for r in rules_of(rule_set("cpuc_go95"), 115)}
    assert go95["go95-37-rail-20"].threshold == pytest.approx(34 * 0.3048)
    assert go95["go95-37-roof-20"].threshold == pytest.approx(12 * 0.3048)
    assert [r.threshold for r in rules_of(rule_set("thesis"), None)] == [20.0, 30.0]
    feet = row(unit="ft", threshold=10.0, per_kv=0.01, within=5.0, voltage_max=200.0)
    (long,) = rules_of(Table(pd.DataFrame([feet])), 100.0)
    assert (long.threshold, long.within) == pytest.approx((11 * 0.3048, 5 * 0.3048))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"source": None}, "source is empty"),
        ({"unit": "cm"}, "unit must be one of m, ft"),
        ({"direction": "up"}, "direction must be one of"),
        ({"kind": "cow"}, "kind must be one of"),
        ({"severity": "bad"}, "severity must be one of"),
        ({"severity": "no rule"}, "severity must be one of critical, warning, watch, got"),
        ({"threshold": -1.0}, "threshold must be"),
        ({"threshold": 0.0}, "threshold must be above 0"),
        ({"voltage_min": 9.0, "voltage_max": 1.0}, "voltage_min 9.0 is above"),
        ({"confirmed": "perhaps"}, "confirmed must be true or false"),
    ],
)
def test_wrong_rows_are_named(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(DataError, match=f"row 1: {message}"):
        rules_of(Table(pd.DataFrame([row(**changes)])), None)


def test_wrong_tables_are_named() -> None:
    with pytest.raises(DataError, match="no column source"):
        rules_of(Table(pd.DataFrame([row()]).drop(columns="source")), None)
    with pytest.raises(DataError, match="id 'a' is there twice"):
        rules_of(Table(pd.DataFrame([row(), row()])), None)
    with pytest.raises(DataError, match="give voltage"):
        rules_of(rule_set("ekaty"), None)
    with pytest.raises(DataError, match="no rule holds for 5000 kV"):
        rules_of(rule_set("ekaty"), 5000)


def test_empty_tables_are_not_replaced_by_those_of_the_toolbox() -> None:
    points, none = cloud(blob(0, 0, 9), 5), Table(pd.DataFrame([row()]).iloc[:0], name="my.csv")
    with pytest.raises(DataError, match=r"rule_table: my\.csv: there are no rules"):
        run(points, rule_table=none)
    no_wire = Table(pd.read_csv(CONDUCTORS_FILE).iloc[:0], name="wires.csv")
    with pytest.raises(DataError, match=r"conductor: wires\.csv: no conductor 'Drake'; there are"):
        run(points, conductor="Drake", conductor_table=no_wire)


def test_wrong_settings_are_named() -> None:
    points = cloud(blob(0, 0, 9), 5)
    for settings, message in (
        ({"rules": "nerc"}, "no rule set 'nerc'"),
        ({"rules": "ekaty"}, "give voltage"),
        ({"temperature": 80.0}, "conductor: is needed"),
        ({"temperature": 80.0, "conductor": "Drake"}, "survey_temperature: is needed"),
        ({"wind_temperature": 20.0}, "wind_temperature: is for wind"),
        ({"conductor": "Duck"}, "no conductor 'Duck'"),
    ):
        with pytest.raises((ParameterError, DataError), match=message):
            run(points, **settings)
    bare = PointCloud(points.xyz, {}, crs=points.crs, name="bare.laz")
    with pytest.raises(DataError, match="no classification"):
        run(bare)
    lines = Vector(layer(LEVEL).frame[["wire_id", "geometry"]], name="lines.kml")
    with pytest.raises(DataError, match="wires: no column span_id"):
        toolbox.run("corridor.clearance", {"points": points, "wires": lines, "rules": "thesis"})


CODES = {"tree": 5, "building": 6, "other": 26, "ground": 2, "water": 9, "rail": 10, "road": 11}


@pytest.mark.parametrize("kind", [kind for kind in CODES if kind != "tree"])
def test_what_is_near_and_has_no_rule_is_listed_counted_and_told(
    kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    """NERC FAC-003 is for trees alone: a crane at 2.0 m has no rule, whatever its class is."""
    low = float(LEVEL.height(np.array(150.0)))
    points = cloud(blob(150, 0, low - 2.0, 4), CODES[kind])
    result = run(points, rules="nerc_fac_003", voltage=345.0)
    (one,) = result["objects"].frame.to_dict("records")
    assert (one["severity"], one["rule"], one["kind"], one["points"]) == ("no rule",) * 2 + (
        kind,
        4,
    )
    assert (one["clearance"], one["distance"]) == pytest.approx((2.0, 2.0), abs=0.01)
    assert math.isnan(one["required"])
    assert math.isnan(one["probability"])
    counts = [result[f"{name}_count"] for name in ("object", "critical", "no_rule")]
    assert counts == [0, 0, 1]
    assert result["least_clearance"] == pytest.approx(2.0, abs=0.01)
    assert result["violations"]["severity"].tolist() == [3] * 4
    assert np.isnan(result["violations"]["probability"]).all()
    told = (
        f"{kind}: objects 1, points 4, the nearest at 2.00 m; "
        f"no rule: the table of NERC FAC-003-4 used here has none for {kind}"
    )
    assert f"near a wire: {told}" in caplog.text
    page = result["report"]
    assert "Objects that are near and have no rule: 1." in page.summary
    kinds = page.sections[0].blocks[0].table.frame.set_index("kind")
    assert kinds.loc[kind, ["nearest", "too close", "near, no rule"]].to_list() == [2.0, 0, 1]


def test_two_points_without_a_rule_are_no_object_but_told(caplog: pytest.LogCaptureFixture) -> None:
    low = float(LEVEL.height(np.array(150.0)))
    result = run(cloud(blob(150, 0, low - 2.0, 2), 26), rules="nerc_fac_003", voltage=345.0)
    assert (result["no_rule_count"], len(result["violations"])) == (0, 2)
    assert "other: objects 0, points 2, the nearest at 2.00 m" in caplog.text


def test_unclassified_objects_are_held_to_the_strictest_rule_and_to_those_that_miss() -> None:
    """345 kV: 1.31 m from trees; 6.10 m where it may be a building, for which there is no rule."""
    low = float(LEVEL.height(np.array(150.0)))
    for below, severity, told in ((1.2, "critical", "fac-003-345"), (2.0, "no rule", "no rule")):
        found = run(cloud(blob(150, 0, low - below), 1), rules="nerc_fac_003", voltage=345.0)
        (one,) = found["objects"].frame.to_dict("records")
        assert (one["kind"], one["severity"], one["rule"]) == ("unclassified", severity, told)
        kinds = found["report"].sections[0].blocks[0].table.frame.set_index("kind")
        assert kinds.rule["unclassified"].startswith(
            "fac-003-345; no rule if it is building or other"
        )
    full = run(cloud(blob(150, 0, low - 2.0), 1), rules="en_50341", voltage=22.0, falling=False)
    kinds = full["report"].sections[0].blocks[0].table.frame.set_index("kind")
    wanted = "held to the strictest of cz-mv-tree, cz-mv-roof, cz-mv-wall, cz-mv-mast"
    assert kinds.rule["unclassified"] == wanted
    assert kinds.rule["tree"] == "cz-mv-tree"


def test_near_is_what_cranes_must_keep_or_what_the_rules_ask_of_others() -> None:
    """29 CFR 1926.1408, table A: the voltages are the highest for which a distance holds.

    That is for rules of the USA, and above 380 kV; others have DIN VDE 0105-100.
    """
    feet = ((0.4, 10), (50, 10), (50.1, 15), (200, 15), (345, 20), (380, 25), (765, 45), (1500, 45))
    for voltage, far in feet:
        assert approach(voltage, american=True)[0] == pytest.approx(far * 0.3048)
    metres = ((0.4, 1.0), (22, 3.0), (110, 3.0), (150, 4.0), (380, 5.0), (420, 25 * 0.3048))
    for voltage, far in metres:
        assert approach(voltage, american=False)[0] == pytest.approx(far)
    assert approach(None, american=True)[0] == approach(None, american=False)[0] == 5.0
    rules = [
        rule(kind="tree", threshold=2.0),
        rule(kind="tree", threshold=9.0),
        rule(kind="building", threshold=7.0),
        rule(kind="road", threshold=12.0),
        rule(kind="rail", threshold=8.0),
        rule(kind="rail", threshold=14.0, severity="warning"),
    ]
    made = stand_ins(rules, dict.fromkeys(KINDS, ""), 20.0)
    assert [(r.kind, r.threshold) for r in made] == [
        ("other", 9.0),
        ("ground", 12.0),
        ("water", 12.0),
        ("line", 3.0),
    ]
    far = stand_ins([], dict.fromkeys(KINDS, ""), None)
    assert [(r.kind, r.threshold) for r in far] == [(kind, 5.0) for kind in (*CODES, "line")]
    low = float(LEVEL.height(np.array(150.0)))
    for below, count in ((6.08, 1), (6.11, 0)):
        points = cloud(blob(150, 0, low - below), 26)
        found = run(points, rules="nerc_fac_003", voltage=345.0, min_points=1)
        assert found["no_rule_count"] == count


def test_a_kind_whose_rules_are_for_other_voltages_has_none_and_the_voltages_are_told() -> None:
    rows = [
        row(id="low", kind="building", voltage_min=1.0, voltage_max=36.0),
        row(id="mid", kind="building", voltage_min=36.001, voltage_max=72.5),
        row(id="high", kind="building", voltage_min=400.0),
        row(id="all", kind="tree", voltage_max=420.0),
    ]
    table = Table(pd.DataFrame(rows), name="my.csv")
    why = why_none(table, 380.0)
    assert why["building"] == (
        "the table of my.csv used here has none for building at 380 kV, only for 1-72.5 kV and "
        "above 400 kV"
    )
    assert why["road"] == "the table of my.csv used here has none for road"
    low = float(LEVEL.height(np.array(150.0)))
    house = cloud(blob(150, 0, low - 4.0), 6)
    for voltage, severity in ((36.0, "critical"), (380.0, "no rule"), (400.0, "critical")):
        frame = run(house, rule_table=table, voltage=voltage)["objects"].frame
        assert frame.severity.to_list() == [severity]


def test_water_rail_and_road_keep_rules_of_their_own() -> None:
    """ČSN EN 50423-1 at 22 kV: 5.6 m above ground, 6.6 m above roads and rails, none for water."""
    low = float(LEVEL.height(np.array(150.0)))
    for code, rules, severities in (
        (2, [], []),
        (11, ["cz-mv-road"], ["critical"]),
        (10, ["cz-mv-rail"], ["critical"]),
        (9, [], []),
    ):
        points = cloud(blob(150, 0, low - 6.0), code)
        frame = run(points, rules="en_50341", voltage=22.0)["objects"].frame
        assert (frame.rule.to_list(), frame.severity.to_list()) == (rules, severities), code
    pond = run(cloud(blob(150, 0, low - 5.1), 9), rules="en_50341", voltage=22.0)
    assert pond["objects"].frame.rule.to_list() == ["no rule"]  # nearer than a field may be


def test_what_is_beside_a_wire_has_no_rule_where_all_rules_are_vertical(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """22 kV: the ground must be 5.6 m below; a slope 2 m beside the wire is near within 3 m."""
    low = float(LEVEL.height(np.array(150.0)))
    for beside, below, told in (
        (2.0, 0.5, ["no rule"]),
        (3.1, 0.5, []),
        (0.0, 5.7, []),
        (0.0, 2.0, ["cz-mv-ground"]),
    ):
        slope = cloud(blob(150, beside, low - below), 2)
        found = run(slope, rules="en_50341", voltage=22.0)
        assert found["objects"].frame.rule.to_list() == told
        kinds = found["report"].sections[0].blocks[0].table.frame.set_index("kind")
        assert kinds.rule["ground"] == (
            "cz-mv-ground; nothing is asked for what is beside the wire; listed within 3.00 m"
        )
        if told == ["no rule"]:
            assert "(DIN VDE 0105-100, by DGUV Regel" in caplog.text
            assert "29 CFR" not in found["report"].html()
    upright, level = (
        rule(kind=kind, direction=direction, threshold=far)
        for kind, direction, far in (("road", "vertical", 2.5), ("building", "horizontal", 4.0))
    )
    made = {
        r.kind: r.threshold for r in stand_ins([upright, level], dict.fromkeys(KINDS, ""), 20.0)
    }
    assert made["road"] == 2.5  # what is farther below keeps its rule
    assert made["building"] == 3.0
    both = [replace(level, direction="vertical"), level]
    assert "building" not in {r.kind for r in stand_ins(both, dict.fromkeys(KINDS, ""), 20.0)}


def test_objects_without_a_rule_are_drawn_and_written_for_cad(tmp_path: Path) -> None:
    low = float(LEVEL.height(np.array(150.0)))
    points = cloud(blob(150, 0, low - 2.0), 26)
    file = tmp_path / "objects.dxf"
    found = run(points, rules="nerc_fac_003", voltage=345.0, falling=False, objects=file)
    (marked,) = ezdxf.readfile(file).modelspace()
    assert marked.dxf.layer == "other_no_rule"
    assert "severity=no rule" in [text for _, text in marked.get_xdata("LIDAR-TOOLBOX")[1:]]
    sections = {section.title: section.blocks for section in found["report"].sections}
    for title in ("Map with numbers", "Profiles"):
        assert b'fill="#d01c8b"' in sections[title][0].content
    rules = sections["Distances required"][0].table.frame.set_index("kind")
    assert rules.confirmed["tree"] == "to be confirmed"
    assert pd.isna(rules.confirmed["other"])


def test_the_page_of_rules_is_that_of_the_tables() -> None:
    """`python docs/make_clearance_rules.py` writes it."""
    script = Path(__file__).parents[3] / "docs" / "make_clearance_rules.py"
    spec = importlib.util.spec_from_file_location("make_clearance_rules", script)
    assert spec
    assert spec.loader
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    assert made.PAGE.read_text("utf-8") == made.page()


def elastic_chain(curve: Catenary, unstretched: float, load: Any, pull: Any) -> NDArray[np.float64]:
    """A wire under a load per metre, piece by piece, from a guess of the pull at its start."""

    def line(pull: NDArray[np.float64]) -> NDArray[np.float64]:
        middle = (np.arange(2000) + 0.5) * unstretched / 2000
        tension = pull - np.outer(middle, load)
        size = np.linalg.norm(tension, axis=1)
        steps = tension * ((1 / size + 1 / DRAKE.stiffness) * unstretched / 2000)[:, None]
        return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])

    end = np.array([curve.length, 0.0, curve.z_end - curve.z_start])

    def missed(pull: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(line(pull)[-1] - end)

    return line(root(missed, pull, tol=1e-9).x)


@pytest.mark.parametrize("rise", [0.0, 60.0, 100.0])
def test_a_steep_wire_in_wind_hangs_as_a_chain_of_small_pieces(rise: float) -> None:
    curve = Catenary(0, 0, 1, 0, 300.0, 40.0, 40.0 + rise, 1 / 900)
    calm = np.array([0.0, 0.0, -DRAKE.weight])
    weight = DRAKE.weight * 900
    pull = np.array([weight, 0.0, -weight * math.sinh(curve.u0 / 900)])

    def sag(line: NDArray[np.float64]) -> float:
        return float((rise * line[:, 0] / 300 - line[:, 2]).max())

    def too_slack(size: float) -> float:
        return sag(elastic_chain(curve, size, calm, pull)) - curve.sag

    stretch = 1 - weight / DRAKE.stiffness
    low, high = curve.arc * (stretch - 4e-4), curve.arc * (stretch + 2e-4)
    unstretched = brentq(too_slack, low, high, xtol=1e-7)
    load = calm + np.array([0.0, wind_load(DRAKE, 30.0), 0.0])
    line = elastic_chain(curve, unstretched, load, pull + np.array([0.0, 10.0, 0.0]))
    blown = in_state(curve, DRAKE, State("wind", None, 30.0), surveyed=15.0)
    assert blown.sag == pytest.approx(sag(line), abs=0.02)
    offsets = blown.offset(np.linspace(0, 300, 1001))
    assert offsets.max() == pytest.approx(line[:, 1].max(), abs=0.02)


def test_wires_that_were_surveyed_in_wind_stay_as_they_are_in_the_same_wind() -> None:
    steep = Catenary(0, 0, 1, 0, 300.0, 40.0, 140.0, 1 / 900)
    blown = in_state(steep, DRAKE, State("wind", None, 30.0), surveyed=15.0)
    again = in_state(blown, DRAKE, State("wind", None, 30.0), surveyed=15.0)
    assert again.curvature == pytest.approx(blown.curvature, rel=1e-9)
    calm = in_state(blown, DRAKE, State("calm", None, 0.0), surveyed=15.0)
    assert calm.curvature == pytest.approx(steep.curvature, rel=1e-9)


def test_an_uncertain_temperature_counts_where_the_fit_is_of_unknown_quality() -> None:
    frame = layer(LEVEL).frame.assign(var_start=np.nan)
    (curve,) = catenaries_of(Vector(frame), np.array([EAST, NORTH, 0.0]))
    assert curve.covariance is None
    hot = in_state(curve, DRAKE, State("hot", 80.0), surveyed=15.0, surveyed_sd=5.0)
    sure = replace(curve, covariance=np.zeros((3, 3)))
    other = in_state(sure, DRAKE, State("hot", 80.0), surveyed=15.0, surveyed_sd=5.0)
    middle = np.array([150.0])
    assert hot.height_sigma(middle) == pytest.approx(other.height_sigma(middle))
    assert hot.height_sigma(middle)[0] > 0.1


def test_lone_points_in_the_air_are_no_falling_trees_and_hide_none() -> None:
    ground, noise = flat(), [(150.0, 16.0, 39.0), (60.0, -15.0, 40.0), (62.0, -40.0, 35.0)]
    points = cloud([*blob(150, 15, 34.0), *noise, *ground], [1] * 8 + [2] * len(ground))
    frame = run(points, distance=5.0)["objects"].frame
    assert frame.rule.to_list() == ["falling"]
    assert frame.height.to_list() == pytest.approx([34.0], abs=0.05)


def test_a_tree_that_is_too_near_also_tells_whether_it_may_fall_on_the_wire() -> None:
    ground = flat()
    trees = [*blob(150, 15, 34.0), *blob(60, -16, 9.0)]
    points = cloud([*trees, *ground], [5] * 10 + [2] * len(ground))
    result = run(points, rules="thesis")
    frame = result["objects"].frame.sort_values("chainage")
    assert frame.rule.to_list() == ["thesis-30"] * 2
    low = float(LEVEL.height(np.array(150.0)))
    assert frame.falls.isna().to_list() == [True, False]
    assert frame.falls.iloc[1] == pytest.approx(math.hypot(15, low) - 34.0, abs=0.1)
    assert len(result["violations"]) == 10


@pytest.mark.parametrize(("aside", "objects"), [(2.5, 1), (3.5, 2)])
def test_a_top_is_of_the_object_that_is_no_farther_than_a_crown(aside: float, objects: int) -> None:
    low, ground = float(LEVEL.height(np.array(150.0))), flat()
    crown, top = blob(150, 4.0, low + 1.0), blob(150, 4.0 + aside, low + 6.0)
    points = cloud([*crown, *top, *ground], [5] * 10 + [2] * len(ground))
    frame = run(points, distance=5.0)["objects"].frame
    assert frame.rule.to_list() == ["given distance", "falling"][:objects]
    assert frame.falls.to_numpy()[-1] == pytest.approx(-5.0, abs=0.5)


def test_least_clearances_of_a_span_are_those_of_what_is_not_far_to_the_side() -> None:
    """What is farther may be there without having been looked at."""
    low = float(LEVEL.height(np.array(150.0)))
    for beside, seen in ((9.9, True), (10.1, False)):
        (tree,) = run(cloud(blob(150, beside, low), 5), distance=5.0)["spans"].frame.tree
        assert tree == pytest.approx(9.9, abs=0.01) if seen else pd.isna(tree)


def test_the_least_clearance_is_that_in_space_whatever_the_rule() -> None:
    low = float(LEVEL.height(np.array(150.0)))
    points = [(150.0, 2.9, low), (150.0, 1.0, low - 3.5), (150.0, 1.0, low - 3.6)]
    table = Table(
        pd.DataFrame([row(kind="building", direction="horizontal", threshold=3.0, within=5.0)])
    )
    result = run(cloud(points, 6), rule_table=table, object_gap=6.0)
    assert result["objects"].frame.clearance.to_list() == pytest.approx([1.0], abs=0.01)
    assert result["least_clearance"] == pytest.approx(2.9, abs=0.01)


def test_towers_keep_what_is_around_their_bodies_alone() -> None:
    foot = {"arms": [24.0], "width": [4.0]}
    place = [shapely.Point(EAST + 150, NORTH + 10, 0)]
    towers = Vector(geopandas.GeoDataFrame(foot, geometry=place, crs=32635))
    low = float(LEVEL.height(np.array(150.0)))
    for y, count in ((0.0, 1), (6.9, 1), (7.1, 0)):  # half the width, and 1 m
        result = run(cloud(blob(150, y, low - 3.0), 1), distance=9.0, towers=towers)
        assert result["object_count"] == count
    areas = Vector(towers.frame.set_geometry(towers.frame.buffer(2.0)))
    with pytest.raises(DataError, match="towers: must be points, "):
        run(cloud(blob(150, 0, low), 1), towers=areas)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("points", math.nan, "points must be a number, got nan"),
        ("curvature", 50.0, "curvature must be above 0 and below 0.2, got 50.0"),
        ("span", 0.0, "span must be above 0, got 0.0"),
        ("swing", 90.0, "swing must be above -90 and below 90, got 90.0"),
        ("span_id", 1.5, "span_id must be a whole number, got 1.5"),
        ("var_curv", -1.0, "var_curv must be at least 0, got -1.0"),
    ],
)
def test_wrong_wires_are_named(column: str, value: float, message: str) -> None:
    wires = Vector(layer(LEVEL).frame.assign(**{column: value}))
    with pytest.raises(DataError, match=f"wires: row 1: {message}"):
        toolbox.run(
            "corridor.clearance",
            {"points": cloud(blob(0, 0, 9), 5), "wires": wires, "distance": 5.0},
        )


def test_the_page_shows_a_long_line_in_sheets_and_every_span() -> None:
    curves = [replace(LEVEL, x=300.0 * k) for k in range(12)]
    page = run(cloud(blob(3150, 0, 20), 5), *curves, distance=5.0)["report"]
    blocks = {section.title: section.blocks for section in page.sections}
    captions = [block.caption for block in blocks["Map with numbers"]]
    assert [text[-40:] for text in captions] == [
        f"This is sheet {k} of 5, from west to east." for k in range(1, 6)
    ]
    assert len(blocks["Profiles"]) == 12
    assert blocks["Profiles"][0].caption.startswith(
        "Span 11, 300 m, 1 wires, 1 objects too close, 0 to be watched."
    )


def test_towers_have_the_same_numbers_on_map_profiles_and_in_tables() -> None:
    """Tables named towers by numbers that stood on no map."""
    wires = layer(*(replace(LEVEL, x=300.0 * k) for k in range(3)))
    wires = Vector(wires.frame.assign(from_tower=[0, 7, 9], to_tower=[7, 9, 0]))
    found = toolbox.run("corridor.clearance", {"points": cloud(flat(), 2), "wires": wires})
    assert found["spans"].frame["to_tower"].tolist() == [7, 9, 0]
    blocks = {section.title: section.blocks for section in found["report"].sections}
    shown = [
        [set(re.findall(r">(tower \d+)<", block.content.decode())) for block in blocks[title]]
        for title in ("Map with numbers", "Profiles")
    ]
    assert shown[0] == [{"tower 7"}, {"tower 9"}], "two sheets"
    assert shown[1] == [{"tower 7"}, {"tower 7", "tower 9"}, {"tower 9"}]


def test_a_profile_shows_whole_what_stands_at_its_edge() -> None:
    """Marks of towers and of objects were cut where they were beyond the ends of the wires."""
    wires = layer(LEVEL)
    wires = Vector(wires.frame.assign(from_tower=[7], to_tower=[9]))
    high = float(LEVEL.points(np.array([0.0]))[0, 2]) + 2.0
    points = cloud([*blob(-8, 0, high), *flat()], [5] * 5 + [2] * len(flat()))
    found = toolbox.run("corridor.clearance", {"points": points, "wires": wires, "distance": 12.0})
    (figure,) = next(s.blocks for s in found["report"].sections if s.title == "Profiles")
    marks = re.findall(rb'class="mark" cx="([-\d.]+)" cy="([-\d.]+)" r="3"', figure.content)
    assert len(marks) == 1, "an object"
    assert all(4 < float(x) < 876 and 4 < float(y) < 346 for x, y in marks)
    axes = re.findall(rb'stroke="#8a2be2"[^>]* points="([-\d.]+),\S+ ([-\d.]+),', figure.content)
    assert len(axes) == 2, "of towers"
    assert all(4 < float(x) == float(same) < 876 for x, same in axes)


def test_captions_and_the_basis_are_said_in_turkish() -> None:
    """Parts of them stayed English where one of their values was empty."""
    low = float(LEVEL.height(np.array(150.0)))
    points = cloud(blob(150, 0, low - 1.0), 5)
    report = run(points, rules="en_50341", voltage=22.0, falling=False)["report"]
    blocks = {section.title: section.blocks for section in report.sections}
    captions = [b.caption for b in (*blocks["Map with numbers"], *blocks["Profiles"])]
    with language.speaking("tr"):
        for text in (*captions, report.summary):
            said = language.for_people(text)
            assert not re.search(r"\b(and|the|at|for|of|objects|wires|Points|numbers)\b", said), (
                said
            )


def test_a_kind_that_is_not_looked_at_as_falling_has_no_count() -> None:
    """Cranes that are higher than their distance read "0"."""
    kinds = run(cloud(blob(150, 0, 5.0), 26))["report"].sections[0].blocks[0].table.frame
    assert kinds[kinds["may fall"].notna()].kind.tolist() == ["tree", "unclassified"]


def test_counts_of_kinds_are_those_of_the_summary() -> None:
    """Trees that will be too near when they have grown were counted as too close."""
    low = float(LEVEL.height(np.array(150.0)))
    points = cloud([*blob(150, 0, low - 1.0), *blob(100, 0, low - 6.0)], 5)
    found = run(points, distance=5.0, growth=4.0, falling=False)
    kinds = found["report"].sections[0].blocks[0].table.frame.set_index("kind")
    assert kinds.loc["tree", ["too close", "watched"]].tolist() == [1, 1]
    assert kinds["may fall"].isna().all()
    assert (found["critical_count"], found["watch_count"]) == (1, 1)
    assert found["object_count"] == 1, "too close, as in the summary"
    (spans,) = found["spans"].frame.to_dict("records")
    assert (spans["objects"], spans["watched"]) == (1, 1)
    (figure,) = next(s.blocks for s in found["report"].sections if s.title == "Profiles")
    assert "1 objects too close, 1 to be watched" in figure.caption


def test_the_temperature_of_a_state_is_told_to_be_that_of_the_conductors() -> None:
    """Tables of crossings said "80 C" of wires, and nobody what of them had it."""
    hot = {"conductor": "Drake", "survey_temperature": 20.0, "temperature": 80.0}
    found = run(cloud(flat(), 2), wind=20.0, wind_temperature=10.0, **hot)
    told = "80 C (conductors of 80 °C), blown left by 20 m/s (conductors of 10 °C)"
    assert f"wires: as surveyed, {told}" in found["report"].summary
    blocks = {section.title: section.blocks for section in found["report"].sections}
    assert f"States of the wires: survey, {told}" in blocks["States of the wires"][0]


def scattered() -> PointCloud:
    """Hummocky ground, trees on it, noise and points of the wire; with heights, in no order."""
    rng = np.random.default_rng(4)
    ground = np.column_stack([rng.uniform(-20, 320, 30_000), rng.uniform(-70, 70, 30_000)])
    level = 6 * np.sin(ground[:, 0] / 25) * np.cos(ground[:, 1] / 20)
    some = rng.integers(0, len(ground), 3000)
    above = rng.uniform(0.5, 14.0, len(some))
    trees = np.column_stack([ground[some], level[some] + above])
    wire = LEVEL.points(np.linspace(0, 300, 200))
    parts = [np.column_stack([ground, level]), trees, trees[::50] + np.array([0, 0, 9]), wire]
    classes = np.repeat([2, 5, 7, 14], [len(part) for part in parts])
    known = np.zeros(len(ground)), above, above[::50] + 9, np.full(len(wire), 20.0)
    order = rng.permutation(len(classes))
    heights = np.concatenate(known).astype(np.float32)
    return cloud(np.vstack(parts)[order], classes[order], HeightAboveGround=heights[order])


ON_GROUND = {
    "rule_table": Table(
        pd.DataFrame(
            [
                {
                    "id": kind,
                    "source": "s",
                    "date": "d",
                    "unit": "m",
                    "kind": kind,
                    "direction": "3-D",
                    "threshold": far,
                    "severity": "critical",
                    "confirmed": True,
                }
                for kind, far in (("ground", 15.0), ("tree", 9.0))
            ]
        )
    )
}


def test_a_survey_that_is_read_in_parts_gives_what_its_cloud_gives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = scattered()
    for k, name in enumerate("abc"):
        points.select(np.arange(k, len(points), 3)).save(tmp_path / f"{name}.laz")
    survey = Survey.open(tmp_path)
    monkeypatch.setattr(matters, "SURVEY_BLOCK", 5000)
    whole, parts = (run(p, **ON_GROUND, growth=1.0) for p in (survey.read(), survey))
    for name in ("objects", "spans"):
        pd.testing.assert_frame_equal(whole[name].frame, parts[name].frame)
    np.testing.assert_array_equal(whole["violations"].xyz, parts["violations"].xyz)
    np.testing.assert_array_equal(whole["violations"]["rule"], parts["violations"]["rule"])
    assert whole["report"].html() == parts["report"].html()
    assert set(np.unique(whole["violations"]["classification"])) == {2, 5}


@pytest.mark.parametrize("kinds", [("ground", "tree"), ("tree",)])
def test_few_points_of_the_ground_matter_but_all_that_tell_something(
    kinds: tuple[str, ...],
) -> None:
    points = scattered()
    wires = layer(LEVEL)
    line = line_of(wires)
    rules = [rule for rule in rules_of(ON_GROUND["rule_table"], None) if rule.kind in kinds]
    settings: Any = {
        "classes": {"tree": [5], "building": [6], "ground": [2]},
        "ignore": [7],
        "reach": 60.0,
    }
    few = what_matters(points, line, rules, measured=15.0, **settings)
    assert len(few) < 0.75 * len(points)
    full, part = (
        surroundings_of(p, line, wire_radius=0.5, attachment=5.0, lowest=0.0, **settings)
        for p in (points, few)
    )
    assert full.left_out == part.left_out
    found = [
        find_violations(s.xyz, s.kind, line.curves, rules, reach=15.0, point_sd=0.05)
        for s in (full, part)
    ]
    for name in ("measure", "ratio", "u"):
        one, other = (np.sort(getattr(violations, name)) for violations, _ in found)
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(found[0][1].distance, found[1][1].distance)
    again = what_matters(few, line, rules, measured=15.0, **settings)
    np.testing.assert_array_equal(again.xyz, few.xyz)
