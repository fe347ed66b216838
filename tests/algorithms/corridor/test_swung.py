"""Conductors that wind swung between two flights are one each, seen in two positions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scenes.corridors import Floats, cloud, ground, pole, wire

from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._curves.trace import Airborne
from algorithms.corridor._extraction.spans import Wire, chained, numbered, on_wire
from algorithms.corridor._extraction.supports import Support
from algorithms.corridor._extraction.swung import (
    in_two_positions,
    parted,
    seen_twice,
    strips_disagree,
)
from algorithms.corridor.extract import CorridorExtract
from toolbox.data import PointCloud

POLES, HEIGHT = (0, 160, 320, 480), 24.0
OFFSETS = (-4.0, 0.0, 4.0)


def swung(points: Floats, degrees: float) -> Floats:
    """Points of a level wire along x, turned about its chord."""
    turn, hang = math.radians(degrees), HEIGHT - points[:, 2]
    aside = np.column_stack([0 * hang, hang * math.sin(turn), hang * (1 - math.cos(turn))])
    return np.asarray(points + aside)


def flown(winds: Sequence[float], offsets: Sequence[float] = OFFSETS) -> PointCloud:
    """Three spans, flown once in each wind, which swings all wires by an angle in degrees."""
    parts, strips = [ground(480, 60, 6)], [1]
    for strip, degrees in enumerate(winds, start=1):
        for (a, b), y in itertools.product(itertools.pairwise(POLES), offsets):
            points = wire((a, y, HEIGHT), (b, y, HEIGHT), 400, 1.0, seed=7919 * strip)[1]
            parts.append(swung(points, degrees))
            strips.append(strip)
    parts += [pole(x, 0.0, HEIGHT + 0.5, half=4.5) for x in POLES]
    strips += [1] * len(POLES)
    source = np.repeat(strips, [len(part) for part in parts]).astype(np.uint16)
    return cloud(*parts).with_attributes({"point_source_id": source})


def test_a_conductor_seen_in_two_positions_is_one(caplog: pytest.LogCaptureFixture) -> None:
    """A made line in a wind of 8 and of 23 degrees had twice its conductors, and no warning."""
    result = CorridorExtract(points=flown((8.0, 23.0))).run()
    frame = result.wires.frame
    assert len(frame) == 18  # clearance looks at both positions
    assert (frame.groupby(["span_id", "wire_id"]).size() == 2).all()
    assert (frame.conductors == 3).all()
    assert frame.wire_id.nunique() == frame.bundle_id.nunique() == 3
    assert set(result.classified["wire_id"]) == {0, 1, 2, 3}
    assert "span 1, 2, 3: conductors were seen in two positions" in caplog.text
    assert "up to 2.1 m apart" in caplog.text  # 2 x 8 m x sin(7.5 degrees)
    assert (frame.sd_swing < 0.6).all()  # each wind swings the wires by one angle


def on_poles(winds: Sequence[float]) -> PointCloud:
    """Six short spans of three wires so close that one strip shows one where another hung."""
    places, top, offsets = range(0, 385, 64), 12.0, (-0.75, 0.0, 1.4)
    parts, strips = [ground(384, 30, 6)], [1]
    for strip, degrees in enumerate(winds, start=1):
        for (a, b), y in itertools.product(itertools.pairwise(places), offsets):
            points = wire((a, y, top), (b, y, top), 350, 0.5, seed=7919 * strip)[1]
            turn, hang = math.radians(degrees), top - points[:, 2]
            aside = [0 * hang, hang * math.sin(turn), hang * (1 - math.cos(turn))]
            parts.append(points + np.column_stack(aside))
            strips.append(strip)
    parts += [pole(x, 0.0, top + 0.5, half=1.5) for x in places]
    strips += [1] * len(places)
    source = np.repeat(strips, [len(part) for part in parts]).astype(np.uint16)
    return cloud(*parts).with_attributes({"point_source_id": source})


def test_close_wires_are_followed_in_each_strip_by_itself() -> None:
    """Followed in both at once they were mixed: 1 or 2 conductors of 3 were counted."""
    frame = CorridorExtract(points=on_poles((8.0, 23.0))).run().wires.frame
    assert (frame.conductors == 3).all()
    assert frame.wire_id.nunique() == 3
    assert (frame.groupby(["span_id", "wire_id"]).size() == 2).all()
    assert frame.rms.median() < 0.05  # metres; points scatter by 0.03


@pytest.mark.parametrize(("winds", "times"), [((8.0, 16.0), 2), ((8.0, 10.0), 1)])
def test_positions_next_to_each_other_are_told_apart_by_strips(
    winds: tuple[float, float], times: int
) -> None:
    """Positions 0.14 m apart, of points that scatter by 0.03, were one curve between them.

    Those 0.04 m apart are one.
    """
    frame = CorridorExtract(points=on_poles(winds)).run().wires.frame
    assert (frame.conductors == 3).all()
    assert frame.wire_id.nunique() == 3
    assert (frame.groupby(["span_id", "wire_id"]).size() == times).all()
    if times == 2:
        swings = frame.assign(swing=frame.swing.abs()).groupby(["span_id", "wire_id"]).swing
        assert swings.min().median() == pytest.approx(8.0, abs=1.0)
        assert swings.max().median() == pytest.approx(16.0, abs=1.0)


def hung_in(
    winds: Sequence[float], aside: Sequence[float], points: int = 40
) -> tuple[Corridor, list[Wire]]:
    """A wire of a span, and points of it in strips with these winds, which lie so far aside."""
    rng = np.random.default_rng(5)
    parts = []
    for degrees, off in zip(winds, aside, strict=True):
        xyz = hung(degrees).curve.points(np.linspace(0.0, 160.0, points))
        parts.append(xyz + rng.normal(0, (0, 0.012, 0.03), xyz.shape) + (0, off, 0))
    air = Airborne.of(np.vstack(parts))
    yes, strip = np.ones(len(air.xyz), bool), np.repeat(np.arange(len(winds)) + 1, points)
    strip = strip.astype(np.uint16)[air.order]
    corridor = Corridor(
        air, air.xyz[:, 2], yes, 0.25, lambda x, y: 0.0, lambda x, y: True, strip=strip
    )
    curve = fit(air.xyz)
    assert curve is not None
    return corridor, [replace(hung(), curve=curve)]


@pytest.mark.parametrize(
    ("winds", "aside", "expected"),
    [
        ((18.0, 20.0), (0.0, 0.0), [18.0, 20.0]),  # 0.28 m apart
        ((18.0, 18.0), (0.0, 0.0), []),
        ((18.0, 18.3), (0.0, 0.0), []),  # 0.04 m apart: surely, but less than points scatter
        ((18.0, 18.0), (0.0, 0.2), []),  # a strip that lies aside of the other
        ((18.0, 20.0), (0.0, 0.2), [18.0, 20.0]),
        ((18.0, 20.0, 18.0), (0.0, 0.0, 0.0), [18.0, 20.0]),  # two strips in one wind
        ((18.0, 20.0, 22.0), (0.0, 0.0, 0.0), [18.0, 20.0, 22.0]),
    ],
)
def test_a_wire_is_parted_where_wind_moved_it_farther_than_points_scatter(
    winds: Sequence[float], aside: Sequence[float], expected: list[float]
) -> None:
    corridor, wires = hung_in(winds, aside)
    found, strip = parted(corridor, wires, [1])
    if not expected:
        assert (found, strip) == (wires, [1])
        return
    assert len(set(strip)) == len(strip) == len(expected)
    assert sum(one.curve.count for one in found) == len(on_wire(corridor, wires[0])[0])
    told = [abs(math.degrees(math.atan(one.curve.swing))) for one in found]
    assert told == pytest.approx(expected, abs=0.3)
    for one, number, degrees in zip(found, strip, expected, strict=True):
        middle = hung(degrees).curve.points(np.array([80.0]))
        middle[:, 1] += aside[number - 1]
        assert one.curve.away(middle)[0] < 0.05
        assert one.curve.covariance is not None
        assert wires[0].curve.covariance is not None
        more = one.curve.covariance[0, 0] / wires[0].curve.covariance[0, 0]
        assert len(winds) > 2 or more == pytest.approx(2.0, rel=0.1)  # one strip tells half as much


def test_few_points_are_parted_as_the_others_of_their_span() -> None:
    """Three points of a strip tell of no position, but other wires in the same wind do."""
    corridor, wires = hung_in((18.0, 18.8), (0.0, 0.0))
    few = corridor.air.xyz[corridor.strip == 2][[5, 18, 30]] + (0.0, 4.0, 0.0)
    many = corridor.air.xyz[corridor.strip == 1] + (0.0, 4.0, 0.0)
    air = Airborne.of(np.vstack([corridor.air.xyz, many, few]))
    strip = np.concatenate([corridor.strip, np.repeat([1, 2], [len(many), 3])])[air.order]
    yes, strip = np.ones(len(air.xyz), bool), strip.astype(np.uint16)
    both = replace(corridor, air=air, height=air.xyz[:, 2], may=yes, strip=strip)
    second = fit(np.vstack([many, few]))
    assert second is not None
    found, number = parted(both, [*wires, replace(wires[0], curve=second)], [1, 1])
    assert number == [1, 2, 1, 2]
    assert found[3].curve.swing == pytest.approx(found[1].curve.swing, abs=0.01)


@pytest.mark.parametrize(("to", "number"), [(160.0, [1, 2]), (55.0, [1])])
def test_a_strip_that_shows_an_end_of_a_span_parts_no_wire(to: float, number: list[int]) -> None:
    """Beside a bend of the line 28 points of the next leg did, by how they err together."""
    corridor, wires = hung_in((18.0, 19.0), (0.0, 0.0), points=300)
    kept = (corridor.strip == 1) | (corridor.air.xyz[:, 0] < to)
    air = Airborne.of(corridor.air.xyz[kept])
    yes, strip = np.ones(len(air.xyz), bool), corridor.strip[kept][air.order]
    some = replace(corridor, air=air, height=air.xyz[:, 2], may=yes, strip=strip)
    curve = fit(air.xyz)
    assert curve is not None
    assert parted(some, [replace(wires[0], curve=curve)], [1])[1] == number


def test_what_hardly_hangs_has_one_position_also_beside_swung_wires() -> None:
    corridor, wires = hung_in((18.0, 20.0), (0.0, 0.0))
    rng = np.random.default_rng(6)
    piece = Catenary(0.0, 9.0, 1.0, 0.0, 80.0, HEIGHT, HEIGHT, 1 / 800)  # hangs by 1 m
    xyz = piece.points(np.linspace(0.0, 80.0, 60)) + rng.normal(0, (0, 0.012, 0.03), (60, 3))
    air = Airborne.of(np.vstack([corridor.air.xyz, xyz]))
    strip = np.concatenate([corridor.strip, np.tile([1, 2], 30)])[air.order].astype(np.uint16)
    yes, curve = np.ones(len(air.xyz), bool), fit(xyz)
    assert curve is not None
    both = replace(corridor, air=air, height=air.xyz[:, 2], may=yes, strip=strip)
    assert parted(both, [*wires, replace(wires[0], curve=curve)], [1, 1])[1] == [1, 2, 1]


@pytest.mark.parametrize(
    ("seed", "radius", "few"),
    [
        (174, 0.3, 8),  # as about a drop of a town, said to be lifted by 54 degrees
        (5, 0.05, 7),  # 0.15 m apart by their swings, by no more than two standard deviations
    ],
)
def test_points_that_lie_aside_by_chance_part_no_wire(seed: int, radius: float, few: int) -> None:
    rng = np.random.default_rng(seed)
    drop = Catenary(0.0, 0.0, 1.0, 0.0, 20.0, 6.0, 6.0, 0.017)
    parts = []
    for count in (22, few):
        xyz = drop.points(rng.uniform(0, 20, count))
        xyz[:, 1:] += rng.uniform(-radius, radius, (count, 2))
        parts.append(xyz)
    air = Airborne.of(np.vstack(parts))
    strip = np.repeat([1, 2], [22, few]).astype(np.uint16)[air.order]
    yes, still = np.ones(len(air.xyz), bool), lambda x, y: 0.0
    corridor = Corridor(air, air.xyz[:, 2], yes, 0.25, still, lambda x, y: True, strip=strip)
    curve = fit(air.xyz, spread=corridor.own_radius)
    assert curve is not None
    wires = [Wire(curve, (0, -1), (0.0, 20.0), 0.25, span=0, bundle=0)]
    assert parted(corridor, wires, [1]) == (wires, [1])


def test_strips_disagree_only_where_there_are_two() -> None:
    both = [hung(8.0), hung(23.0)]
    assert strips_disagree(surveyed(both, (1, 2)), both)
    assert not strips_disagree(surveyed(both, (0, 0)), both)  # not known
    assert not strips_disagree(surveyed([hung(8.0), hung(8.0)], (1, 2)), [hung(8.0)])


def test_the_conductors_of_a_bundle_stay_two_in_any_wind(caplog: pytest.LogCaptureFixture) -> None:
    """Each strip has points on both, whose ends are as far apart as their middles."""
    twins = [y + shift for y in OFFSETS for shift in (0.0, 0.4)]
    frame = CorridorExtract(points=flown((8.0, 8.0), twins)).run().wires.frame
    assert (frame.groupby("span_id").wire_id.nunique() == 6).all()
    assert (frame.conductors == 3).all()
    assert "two positions" not in caplog.text


def hung(
    degrees: float = 0.0,
    *,
    aside: float = 0.0,
    c: float = 400.0,
    start: float = 0.0,
    supports: tuple[int, int] = (0, 1),
) -> Wire:
    """A wire of 160 m that hangs 8 m deep in its plane, which wind turned by an angle."""
    turn = math.radians(degrees)
    curve = Catenary(
        start, aside, 1.0, 0.0, 160.0, HEIGHT, HEIGHT, math.cos(turn) / c, swing=math.tan(turn)
    )
    return Wire(curve, supports, (0.0, 160.0), 0.25, span=int(start), bundle=0)


def surveyed(wires: Sequence[Wire], strips: Sequence[int]) -> Corridor:
    """A corridor with points on each wire, all of one strip; 0 is not known."""
    parts = [one.curve.points(np.linspace(0.0, 160.0, 200)) for one in wires]
    air = Airborne.of(np.vstack(parts))
    yes, strip = np.ones(len(air.xyz), bool), np.repeat(strips, 200).astype(np.uint16)
    ground, seen = (lambda x, y: 0.0), (lambda x, y: True)
    return Corridor(air, air.xyz[:, 2], yes, 0.25, ground, seen, strip=strip[air.order])


@pytest.mark.parametrize(
    ("other", "strips", "one"),
    [
        (hung(23.0), (1, 2), True),
        (hung(23.0), (0, 0), True),  # strips are not known
        (hung(23.0), (1, 1), False),  # in one strip a conductor has one position
        (hung(23.0, supports=(0, -1)), (1, 2), True),  # the other end is beyond the data
        (hung(23.0, aside=0.6), (1, 2), True),  # by its string, which swings with it
        (hung(23.0, aside=1.5), (1, 2), False),  # the next conductor
        (hung(8.0, aside=0.4), (1, 2), False),  # of a bundle
        (hung(8.0, c=300.0), (1, 2), False),  # another cable at the same bolts, which hangs deeper
        (hung(23.0, c=300.0), (1, 2), False),
        (hung(23.0, supports=(2, 3)), (1, 2), False),  # no support in common
        (replace(hung(23.0), span=7), (1, 2), False),  # of another span
    ],
)
def test_what_is_one_conductor_in_two_positions(
    other: Wire, strips: tuple[int, int], one: bool
) -> None:
    wires = [hung(8.0), other]
    assert seen_twice(surveyed(wires, strips), wires) == [(0, 1)] * one


def test_a_position_is_of_the_conductor_that_it_is_nearest_to_at_the_ends() -> None:
    wires = [hung(8.0), hung(8.0, aside=0.7), hung(23.0, aside=0.7), hung(23.0)]
    assert sorted(seen_twice(surveyed(wires, (1, 1, 2, 2)), wires)) == [(0, 3), (1, 2)]


def test_three_strips_show_a_conductor_in_three_positions() -> None:
    wires = [hung(8.0), hung(23.0), hung(40.0)]
    assert seen_twice(surveyed(wires, (1, 2, 3)), wires) == [(0, 1), (0, 2), (1, 2)]


def test_a_position_that_is_left_over_goes_on_as_no_other_conductor() -> None:
    """Of one conductor both positions were found in the first span, of the next in the second."""
    first = [hung(8.0), hung(23.0), hung(8.0, aside=2.0)]
    second = [
        hung(degrees, aside=aside, start=160.0, supports=(1, 2))
        for degrees, aside in ((8.0, 0.0), (8.0, 2.0), (23.0, 2.0))
    ]
    wires = [*first, *second]
    wires = [replace(wire, bundle=k) for k, wire in enumerate(wires)]
    support = Support(0.0, 0.0, (0.0, 1.0), (-3.0, 3.0), HEIGHT, HEIGHT, 0.0, 1.0)
    found = numbered(wires, [support] * 3, [(0, 1), (4, 5)])
    assert [wire.wire for wire in found] == [1, 1, 2, 1, 2, 2]
    assert [wire.bundle for wire in found] == [1, 1, 2, 1, 2, 2]


def test_a_position_goes_on_where_a_piece_hardly_sags() -> None:
    """Behind the last tower a piece of a span was seen: its swing tells nothing, its end does."""
    first = [hung(8.0), hung(23.0), hung(8.0, aside=4.0)]
    piece = [hung(start=160.0, aside=aside, supports=(1, -1)) for aside in (0.0, 0.1, 4.0)]
    wires = [replace(wire, bundle=k) for k, wire in enumerate([*first, *piece])]
    support = Support(0.0, 0.0, (0.0, 1.0), (-3.0, 5.0), HEIGHT, HEIGHT, 0.0, 1.0)
    found = numbered(wires, [support] * 2, [(0, 1)])
    assert [wire.wire for wire in found] == [1, 1, 2, 1, 1, 2]


def test_of_a_swung_span_wires_that_end_at_the_same_places_are_one() -> None:
    """Where five points do not tell how a wire swings, its conductor was counted twice."""
    odd = [hung(8.0, aside=5.0), hung(8.0, aside=5.2)]
    wires = [hung(8.0), hung(23.0), *odd]
    assert in_two_positions(wires, (1, 2, 1, 2)) == [(0, 1), (2, 3)]
    assert in_two_positions([hung(8.0), hung(8.0, aside=0.2)], (1, 2)) == []  # of a still span
    far = [*wires[:2], hung(8.0, aside=5.0), hung(8.0, aside=5.5), hung(8.0, aside=9.0)]
    assert in_two_positions(far, (1, 2, 1, 2, 2)) == [(0, 1)]


def test_what_is_left_of_a_swung_span_is_one_where_each_strip_shows_as_many() -> None:
    """The ends of a wire of few points may be half a metre off: 4 conductors were told for 3."""
    wires = [hung(8.0), hung(23.0), hung(8.0, aside=5.0), hung(8.0, aside=5.5)]
    assert in_two_positions(wires, (1, 2, 1, 2)) == [(0, 1), (2, 3)]


def test_one_wrong_pair_makes_no_two_conductors_one() -> None:
    """Wires of one strip and span are conductors of their own, whatever joins them elsewhere."""
    wires = [hung(aside=aside) for aside in (0.0, 0.5)]
    wires += [hung(aside=aside, start=160.0, supports=(1, 2)) for aside in (0.0, 0.5)]
    pairs = [(0, 2), (1, 3), (1, 2)]
    assert chained(wires, pairs, [], (1, 1, 1, 1)).tolist() == [0, 1, 0, 1]
    assert chained(wires, pairs, [], (1, 2, 1, 2)).tolist() == [0, 0, 0, 0]
    assert chained(wires, pairs, [(0, 1), (2, 3)], (0, 0, 0, 0)).tolist() == [0, 0, 0, 0]


def test_a_wire_without_a_second_position_beside_such_goes_on_in_none() -> None:
    """One that changed over from one conductor to the next made both one in the whole line."""
    first = [hung(8.0), hung(23.0), hung(8.0, aside=4.0), hung(8.0, aside=4.3)]
    second = [
        hung(degrees, aside=aside, start=160.0, supports=(1, 2))
        for degrees, aside in ((8.0, 0.0), (8.0, 4.0), (23.0, 4.3))
    ]
    wires = [replace(wire, bundle=k) for k, wire in enumerate([*first, *second])]
    support = Support(0.0, 0.0, (0.0, 1.0), (-3.0, 5.0), HEIGHT, HEIGHT, 0.0, 1.0)
    found = numbered(wires, [support] * 3, [(0, 1), (5, 6)])
    assert [wire.wire for wire in found] == [1, 1, 2, 3, 1, 2, 2]
