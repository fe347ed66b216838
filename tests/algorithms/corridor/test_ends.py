"""Wires behind the last support of a line, where the data end before the next one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scenes.corridors import Floats, cloud, ground, line, wire

from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._curves.trace import Airborne
from algorithms.corridor._extraction.ends import with_ends
from algorithms.corridor._extraction.spans import Wire
from algorithms.corridor._extraction.supports import Support
from algorithms.corridor.extract import CorridorExtract

ASIDE = (-1.2, 0.0, 1.2)  # of the wires, metres
END = 72.0  # x where the data end; the last pole stands at 60
SUPPORTS = [Support(x, 0.0, (0.0, 1.0), (-1.2, 1.2), 9.0, 9.0, 0.0, 1.0) for x in (0.0, 60.0)]
SLOPE = -0.1  # of the wires behind the last pole, upwards


def held(aside: float, number: int) -> Wire:
    """A wire between the two poles, of which 30 points are seen."""
    covariance = np.diag([1e-4, 1e-4, 1e-9])
    curve = Catenary(
        0.0, aside, 1.0, 0.0, 60.0, 9.0, 9.0, 1 / 400, rms=0.03, count=30, covariance=covariance
    )
    return Wire(curve, (0, 1), (0.0, 60.0), 0.25, 1, number, number)


WIRES = [held(aside, number) for number, aside in enumerate(ASIDE, 1)]


def behind(
    aside: float, turn: float, places: tuple[float, ...] = (2.5, 5.0, 7.5, 10.0, 11.5)
) -> Floats:
    """Points of a wire that goes on behind the last pole, at distances from it."""
    u = np.array(places)
    x, y = 60 + u * math.cos(turn), aside + u * math.sin(turn)
    xyz = np.column_stack([x, y, 9 + SLOPE * u + u * u / 800])
    return xyz + np.random.default_rng(int(10 * aside + 50)).normal(0, 0.03, xyz.shape)


def corridor_of(*parts: Floats, end: float = END) -> Corridor:
    """Points above flat ground that all may be wire, with data up to an x."""
    between = [one.curve.points(np.arange(1.0, 60.0, 2.0)) for one in WIRES]
    air = Airborne.of(np.vstack([*between, *parts]))
    yes = np.ones(len(air.xyz), bool)
    return Corridor(air, air.xyz[:, 2], yes, 0.25, lambda x, y: 0.0, lambda x, y: x < end)


def more(*parts: Floats, end: float = END) -> list[Wire]:
    """The wires that are found behind the last pole."""
    return with_ends(corridor_of(*parts, end=end), WIRES, SUPPORTS)[len(WIRES) :]


@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_wires_of_a_few_points_go_on_behind_the_last_pole(turn: float) -> None:
    found = more(*(behind(aside, turn) for aside in ASIDE))
    assert [(one.wire, one.span, one.supports) for one in found] == [
        (number, 2, (1, -1)) for number in (1, 2, 3)
    ]
    for one, aside in zip(found, ASIDE, strict=True):
        true = behind(aside, turn, (0.0, 4.0, 8.0, 12.0 / math.cos(turn) - 1))
        assert one.curve.away(true).max() < 0.2
        assert one.curve.ends[1, 0] == pytest.approx(END, abs=2.5)


def test_a_wire_without_points_goes_on_beside_the_others() -> None:
    few = (3.0, 6.0, 9.0, 11.0)
    assert [one.wire for one in more(behind(-1.2, 0.0, few), behind(0.0, 0.0, few))] == [1, 2, 3]


def test_points_at_the_pole_are_of_no_wire() -> None:
    """Arms and insulators are there: six points on a wire that end within a metre tell nothing."""
    few, arm = (3.0, 6.0, 9.0, 11.0), behind(1.2, 0.0, (0.4, 0.5, 0.6, 0.7, 0.8, 0.9))
    found = more(behind(-1.2, 0.0, few), behind(0.0, 0.0, few), arm)
    assert [one.wire for one in found] == [1, 2, 3]
    assert found[2].curve.count == 0


def test_a_wire_of_which_surely_points_would_be_seen_does_not_go_on() -> None:
    many = tuple(np.arange(2.0, 11.6, 1.25))
    assert [one.wire for one in more(behind(-1.2, 0.0, many), behind(0.0, 0.0, many))] == [1, 2]


def test_no_wire_goes_on_that_leaves_the_shape_of_the_others() -> None:
    """Near the pole its points are on that shape still."""
    near = (2.0, 2.1, 2.2, 2.3, 2.4, 2.5, 2.6, 2.7)
    assert not more(behind(-1.2, 0.0), behind(0.0, 0.0), behind(1.2, 0.0, near))


def test_nothing_goes_on_where_the_data_do() -> None:
    """It is no end of the data: what stands there may be the last pole of the line."""
    points = [behind(aside, 0.0) for aside in ASIDE]
    assert more(*points)
    assert not more(*points, end=200.0)


@pytest.mark.parametrize("seed", range(5))
def test_points_anywhere_are_no_wires(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert not more(rng.uniform((61, -6, 5), (72, 6, 11), (40, 3)))


def test_no_wire_goes_on_where_the_line_does() -> None:
    """The pole holds the same wires at the other side."""
    span = [
        replace(one, curve=replace(one.curve, x=60.0), supports=(1, -1), span=2) for one in WIRES
    ]
    corridor = corridor_of(*(behind(aside, 0.4) for aside in ASIDE))
    for beyond in (span, [replace(span[0], wire=4, curve=replace(span[0].curve, y=0.6))]):
        wires = [*beyond, *WIRES]
        assert with_ends(corridor, wires, SUPPORTS) == wires


def test_wires_go_on_at_the_other_end_as_well() -> None:
    """A curve is fitted from west to east, but the wires go on westwards."""
    points = np.vstack([behind(aside, 0.0) for aside in ASIDE]) * [-1, 1, 1] + [60, 0, 0]
    corridor = replace(corridor_of(points), seen=lambda x, y: x > 60 - END)
    found = with_ends(corridor, WIRES, SUPPORTS)[len(WIRES) :]
    assert [one.supports for one in found] == [(0, -1)] * 3
    assert max(one.curve.ends[1, 0] for one in found) == pytest.approx(60 - END, abs=2.5)


def test_there_is_nothing_without_wires() -> None:
    assert with_ends(corridor_of(), [], SUPPORTS) == []


def test_a_line_goes_on_to_the_ends_of_the_data() -> None:
    """By few points in 20 m at both ends, which are too short to be followed."""
    _, wires, poles = line([0, 60, 120], ASIDE, 9, 400)
    stubs = [
        wire((a, aside, 9), (b, aside, 8.5), 400, 0.4)[1]
        for a, b in ((0, -19), (120, 139))
        for aside in ASIDE
    ]
    result = CorridorExtract(points=cloud(ground(120, 60, 8), *wires, poles, *stubs)).run()
    assert (result.span_count, result.tower_count) == (4, 3)
    assert result.wires.frame.length.min() > 17
    assert (result.wires.frame.groupby("wire_id").size() == 4).all()
