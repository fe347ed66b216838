"""Service drops: single wires of a few points from a pole to a house."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest
import shapely
from scenes.corridors import CORNER, Floats, bar, cloud, ground, tree, unlabelled

from algorithms.compare.spans import CompareSpans
from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._curves.trace import Airborne
from algorithms.corridor._extraction.drops import turned, with_drops
from algorithms.corridor._extraction.spans import Wire
from algorithms.corridor._extraction.supports import Support
from algorithms.corridor._settings import changed
from algorithms.corridor.clearance import CorridorClearance
from algorithms.corridor.extract import CorridorExtract
from algorithms.samples.scene import SamplesScene
from toolbox.data import Vector

POLES = (0.0, 35.0, 70.0, 105.0)  # along x, metres
TOPS = (7.0, 7.4, 7.8)  # heights of the wires, metres
DROP = Catenary(35.0, 0.0, 0.28, 0.96, 15.0, 7.2, 5.0, 1 / 100)  # from the second pole
U = (2.1, 4.2, 6.4, 9.1, 11.3, 13.6)  # along it, of its points, metres


def span(number: int) -> list[Wire]:
    """The wires of one of the spans, at the poles of that number and the next."""
    a, b = POLES[number : number + 2]
    curves = (Catenary(a, 0.0, 1.0, 0.0, b - a, top, top, 1 / 130, rms=0.03) for top in TOPS)
    ends = (number, number + 1)
    return [Wire(one, ends, (0.0, b - a), 0.25, number + 1, k, k) for k, one in enumerate(curves)]


WIRES = [wire for number in range(3) for wire in span(number)]
SUPPORTS = [Support(x, 0.0, (0.0, 1.0), (0.0, 0.0), 7.0, 7.8, 0.0, 1.0) for x in POLES]


def house(seed: int = 0) -> Floats:
    """Roof and front wall of a house, to which the drop leads: its eave is at 5.3 m."""
    rng = np.random.default_rng(seed)
    roof, wall = rng.uniform(0, 1, (600, 2)), rng.uniform(0, 1, (40, 2))
    x, y, _ = DROP.ends[1]
    return np.vstack(
        [
            np.column_stack([x - 4 + 8 * roof[:, 0], y + 7 * roof[:, 1], 5.3 + 2 * roof[:, 1]]),
            np.column_stack([x - 4 + 8 * wall[:, 0], np.full(40, y), 5.3 * wall[:, 1]]),
        ]
    )


def scatter(xyz: Floats, noise: float = 0.02, seed: int = 0) -> Floats:
    """Points with the errors of a survey."""
    return xyz + np.random.default_rng(seed).normal(0, noise, xyz.shape)


def drops(*parts: Floats) -> list[Catenary]:
    """What is found among points, beside wires of which none is seen."""
    air = Airborne.of(np.vstack(parts))
    may = air.xyz[:, 2] > 4.0
    corridor = Corridor(air, air.xyz[:, 2], may, 0.25, lambda x, y: 0.0, lambda x, y: True)
    found = with_drops(corridor, WIRES, SUPPORTS)
    assert found[: len(WIRES)] == WIRES
    assert all(wire.drop and wire.supports[1] == -1 for wire in found[len(WIRES) :])
    return [wire.curve for wire in found[len(WIRES) :]]


def test_a_drop_of_six_points_leads_from_its_pole_to_the_house() -> None:
    (found,) = drops(scatter(DROP.points(np.array(U))), house())
    assert np.linalg.norm(found.ends - DROP.ends, axis=1).max() < 0.3
    assert np.abs(found.height(np.array(U)) - DROP.height(np.array(U))).max() < 0.06


def test_where_no_house_is_seen_a_drop_ends_at_its_last_point() -> None:
    (found,) = drops(scatter(DROP.points(np.array(U))))
    assert found.length == pytest.approx(U[-1], abs=0.1)


@pytest.mark.parametrize("seed", [6, 14, 15, 23])  # of forty, those with the largest errors
def test_a_few_points_scatter_as_those_of_the_wires_of_the_pole(seed: int) -> None:
    """Of five some lie on a curve by chance: by their scatter another one is no point of it."""
    few = DROP.points(np.array([2.1, 4.2, 6.4, 11.3, 13.6]))
    (found,) = drops(scatter(few, 0.03, seed), house())
    assert np.linalg.norm(found.ends - DROP.ends, axis=1).max() < 1.0


@pytest.mark.parametrize("seed", [16, 20, 27, 35])  # of forty, those that seem bent most
def test_a_few_points_near_the_pole_hardly_tell_how_a_drop_is_bent(seed: int) -> None:
    near = Catenary(35.0, 0.0, 0.28, 0.96, 7.0, 7.2, 5.0, 1 / 75)
    assert len(drops(scatter(near.points(np.array([1.2, 1.9, 2.6, 3.4, 4.3, 4.9])), 0.03, seed)))


@pytest.mark.parametrize("per_metre", [0.5, 1.2, 3.0])
def test_a_drop_may_have_as_many_points_as_the_wires_of_its_pole(
    per_metre: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = [replace(w.curve, count=round(per_metre * w.curve.length)) for w in WIRES]
    wires = [replace(wire, curve=curve) for wire, curve in zip(WIRES, seen, strict=True)]
    monkeypatch.setitem(globals(), "WIRES", wires)
    points = DROP.points(np.arange(1.0, 14.5, 1 / per_metre))
    assert len(drops(scatter(points, 0.03), house())) == 1


def test_points_in_three_metres_are_no_drop() -> None:
    assert not drops(scatter(DROP.points(np.array([6.4, 9.1, 11.3]))), house())


def test_a_row_that_leads_to_no_pole_is_no_drop() -> None:
    aside = np.array([8.0, 0.0, 0.0])
    assert not drops(scatter(DROP.points(np.array(U)) + aside), house())


def test_a_row_far_below_the_wires_is_no_drop() -> None:
    assert not drops(scatter(DROP.points(np.array(U))) - (0.0, 0.0, 2.9), house())


def test_what_hangs_below_the_wires_of_a_span_is_no_drop() -> None:
    along = Catenary(35.0, 0.0, 1.0, 0.0, 20.0, 6.5, 6.0, 1 / 100)
    assert not drops(scatter(along.points(np.arange(2.0, 19.0, 2.0))))


@pytest.mark.parametrize("seed", range(4))
def test_points_beside_what_hangs_below_the_wires_make_no_drop_of_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    below = Catenary(35.0, 0.0, 1.0, 0.0, 34.0, 6.8, 6.6, 1 / 200)
    u, aside = rng.uniform(0.5, 34.0, 30), rng.uniform(0.5, 0.8, 5)
    beside = below.points(rng.uniform(12.0, 25.0, 5)) + np.outer(aside, (0.0, 1.0, 0.0))
    assert not drops(scatter(below.points(u)), beside)


def test_a_drop_beside_the_line_is_known_by_its_points_below_the_wires_as_well() -> None:
    beside = Catenary(35.0, 0.0, 0.98, 0.2, 15.0, 7.2, 5.0, 1 / 100)
    row = scatter(beside.points(np.array([0.9, 1.7, 2.2, 5.3, 7.1, 9.4, 11.2])))
    (found,) = drops(row)
    assert found.length == pytest.approx(11.2, abs=0.1)


def test_a_drop_is_known_by_its_points_beside_the_pole_as_well() -> None:
    near = scatter(DROP.points(np.array([0.9, 1.1, 1.6, 2.4, 5.8, 7.4])))
    (found,) = drops(near, bar((35, 0, 0), (35, 0, 8.2), 10, 0.04))
    assert found.length == pytest.approx(7.4, abs=0.1)


def test_a_drop_goes_on_to_the_house_that_it_leads_to() -> None:
    near = scatter(DROP.points(np.array([1.2, 2.1, 3.3, 4.2, 5.6, 6.4, 7.4])))
    (found,) = drops(near, house())
    assert found.length == pytest.approx(DROP.length, abs=0.8)


def test_a_drop_ends_at_the_house_though_points_of_it_lie_beside_its_curve() -> None:
    """Of few points the direction is not well known: the last ones seem to be of a body."""
    near = scatter(DROP.points(np.array([1.2, 2.1, 3.3, 4.2, 5.6, 6.4, 7.4, 9.0])))
    last = DROP.points(np.array([13.9, 14.4])) + np.array([0.12, 0.0, 0.05])
    (found,) = drops(near, last, house())
    assert found.length == pytest.approx(DROP.length, abs=0.4)


def test_a_drop_may_lead_up_to_a_house() -> None:
    up = Catenary(35.0, 0.0, 0.28, 0.96, 15.0, 7.2, 11.0, 1 / 100)
    (found,) = drops(scatter(up.points(np.array(U))))
    assert found.length == pytest.approx(U[-1], abs=0.1)


@pytest.mark.parametrize("seed", range(6))
def test_twigs_around_a_pole_are_no_drops(seed: int) -> None:
    crowns = [
        tree(35.0 + x, y, 8.5, 2.5, count, seed)
        for (x, y), count in zip([(4, 4), (-5, 3), (2, -6)], (40, 150, 400), strict=True)
    ]
    assert not drops(*crowns)


def test_nearly_straight_and_bent_rows_are_tried_alike() -> None:
    for c in (45.0, 400.0):
        curve = Catenary(35.0, 0.0, 0.28, 0.96, 15.0, 7.2, 5.0, 1 / c)
        assert len(drops(scatter(curve.points(np.array(U))), house())) == 1


def test_points_farther_off_than_a_drop_is_long_do_not_tell() -> None:
    with changed("network.longest_missing", 6.0):
        assert not drops(scatter(DROP.points(np.array(U))))


def test_points_among_many_others_do_not_tell() -> None:
    steps = np.array([(0.9 * k, 0.3 * k, -0.3 * (k > 0)) for k in range(7)])
    rows = [DROP.points(np.array(U)) + step for step in steps]
    xyz = scatter(np.vstack(rows))
    with changed("sparse.company", 1000):
        assert drops(xyz)
    with changed("sparse.company", 0):
        assert not drops(xyz)


def test_a_turned_curve_is_the_same() -> None:
    covariance = np.diag([1.0, 2.0, 3.0])
    curve = Catenary(1.0, 2.0, 0.6, 0.8, 20.0, 9.0, 6.0, 1 / 80, covariance=covariance)
    other = turned(curve)
    assert np.allclose(other.ends, curve.ends[::-1])
    u = np.linspace(0, 20, 9)
    assert np.allclose(other.points(20 - u), curve.points(u))
    assert np.allclose(other.height_sigma(20 - u), curve.height_sigma(u))


def street() -> list[Floats]:
    """Ground, three wires on four poles, a drop and its house."""
    rng = np.random.default_rng(1)
    parts = [ground(105, 60, 6)]
    for wire in WIRES:
        u = np.sort(rng.uniform(0, wire.curve.length, int(1.2 * wire.curve.length)))
        parts.append(scatter(wire.curve.points(u), seed=len(parts)))
    parts += [bar((x, 0, 0), (x, 0, 8.2), 4, 0.04, seed=int(x)) for x in POLES]
    return [*parts, scatter(DROP.points(np.array(U)), seed=3), house()]


def test_a_drop_of_a_street_is_a_span_of_its_own(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "toolbox"):
        found = CorridorExtract(points=cloud(*street())).run()
    wires = found.wires.frame
    drop = wires[wires["drop"] == 1]
    assert len(drop) == 1
    assert (wires.groupby("span_id")["drop"].nunique() == 1).all()
    truth = Vector(
        wires.iloc[:1].assign(
            span_id=1, geometry=[shapely.LineString(DROP.points(np.linspace(0, 15, 30)) + CORNER)]
        )
    )
    assert CompareSpans(wires=Vector(drop), reference=truth).run().in_full == 1
    near = found.classified["wire_id"] == drop["wire_id"].item()
    assert len(U) <= near.sum() <= len(U) + 3  # and at most a few of the eave
    assert (found.classified["classification"][near] == 14).all()
    told = [record.getMessage() for record in caplog.records]
    number = str(drop["span_id"].item())
    assert any(f"service drops: span {number} leads" in text for text in told)
    assert not any("support not seen" in text and f"span {number} " in text for text in told)

    with caplog.at_level(logging.WARNING, "toolbox"):
        clear = CorridorClearance(
            points=found.classified, wires=found.wires, rules="thesis", ground_classes=[1]
        ).run()
    assert drop["span_id"].item() not in clear.spans.frame["span_id"].to_numpy()
    assert f"nothing was measured from span {number}" in caplog.text


def test_drops_of_a_made_street_are_found() -> None:
    """On this one nothing was chosen; 7 of its 22 drops have points in four metres or more."""
    made = SamplesScene(kind="corridor", preset="service_drops", seed=321).run()
    truth = made.points["classification"]
    found = CorridorExtract(points=unlabelled(made.points)).run()
    lines = made.features.frame
    lines = lines[(lines.kind == "wire") & (lines.line == "service drop")]
    drop = found.wires.frame[found.wires.frame["drop"] == 1]
    spans = CompareSpans(wires=Vector(drop), reference=Vector(lines)).run()
    assert spans.in_full >= 3
    assert spans.invented == 0
    assert np.mean((found.classified["classification"] == 14)[truth == 14]) > 0.88
