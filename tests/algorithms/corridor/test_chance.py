"""How likely points lie along a curve by chance."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scenes.corridors import Floats, wire

from algorithms.corridor._curves.chance import chance, is_no_accident
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._curves.trace import Airborne
from algorithms.corridor._extraction.follow import Line, better
from algorithms.corridor._extraction.spans import Wire

CURVE, POINTS = wire((0, 0, 9), (60, 0, 9), 400, per_metre=0.5)


def corridor_of(*parts: Floats) -> Corridor:
    """Points that all may be wire."""
    air = Airborne.of(np.vstack(parts))
    count = len(air.xyz)
    return Corridor(
        air, np.full(count, 8.0), np.ones(count, bool), 0.25, lambda x, y: 0.0, lambda x, y: True
    )


def twigs(seed: int, count: int) -> Floats:
    """Points anywhere in a hedge around the wire, as in scene after scene."""
    return np.random.default_rng(seed).uniform((0, -3, 5), (60, 3, 11), (count, 3))


def of_curve(corridor: Corridor) -> float:
    return chance(corridor, CURVE, 0.25, np.zeros(len(corridor.air.xyz), bool))


@pytest.mark.parametrize("count", [30, 300, 3000])
def test_a_hundredth_of_curves_among_twigs_has_a_chance_of_a_hundredth(count: int) -> None:
    chances = [of_curve(corridor_of(twigs(seed, count))) for seed in range(200)]
    assert np.mean(np.array(chances) < math.log(0.01)) <= 0.02


def test_a_wire_in_empty_air_is_no_accident_and_one_among_leaves_may_be() -> None:
    free = corridor_of(POINTS)
    assert is_no_accident(free, [of_curve(free)])
    hidden = corridor_of(POINTS, twigs(0, 6000))
    assert not is_no_accident(hidden, [of_curve(hidden)])


def test_a_wire_in_leaves_along_half_of_its_way_is_known_by_the_other_half() -> None:
    leaves = twigs(0, 6000)
    half = corridor_of(POINTS, leaves[leaves[:, 0] < 30])
    assert is_no_accident(half, [of_curve(half)])


def test_points_that_may_be_no_wire_do_not_tell_of_one() -> None:
    """Those of another line are known to be of it; a curve across its wires had many of them."""
    free = corridor_of(POINTS)
    known = replace(free, may=np.arange(len(POINTS)) % 10 == 0)
    assert of_curve(known) > math.log(0.01) > of_curve(free)


def test_points_of_other_wires_are_not_around_one() -> None:
    curve, other = wire((0, 0.8, 9), (60, 0.8, 9), 400, per_metre=4)
    both = corridor_of(POINTS, other)
    assert chance(both, CURVE, 0.25, both.on([curve, CURVE])) < of_curve(both) - 20


def test_of_more_points_more_lie_so_by_chance() -> None:
    few, many = corridor_of(POINTS), corridor_of(POINTS, twigs(0, 10_000) + 100)
    limit = math.log(0.01 / len(POINTS)) - 0.1
    assert is_no_accident(few, [limit])
    assert not is_no_accident(many, [limit])


def test_each_of_several_curves_must_be_unlikelier_than_the_best_of_all_tried() -> None:
    free = corridor_of(POINTS)
    usual = -math.log(len(POINTS))
    assert not is_no_accident(free, [usual] * 20)
    assert is_no_accident(free, [usual - 3.0, usual - 3.0])


def line_of(*ends: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Line:
    """Wires of one span, without supports."""
    wires = []
    for first, last in ends:
        curve, _ = wire(first, last, 400)
        wires.append(Wire(curve, (-1, -1), (0.0, curve.length), 0.25, span=1))
    return Line(wires, [])


def test_what_only_the_other_tolerance_finds_is_kept() -> None:
    """Of the shorter line the wire that is on none of the longer, at either tolerance."""
    first, second, third = (((0, y, 9), (x, y, 9)) for x, y in ((60, 0), (40, 8), (60, 16)))
    farther = ((60, 0, 9), (120, 0, 9))
    points = [wire(*ends, 400, per_metre=1)[1] for ends in (first, second, third, farther)]
    corridor = corridor_of(*points)
    for narrow, wide in (
        (line_of(first, second), line_of(first, third, farther)),
        (line_of(first, third, farther), line_of(first, second)),
    ):
        found = better(corridor, [narrow], [wide])
        assert sorted(len(line.wires) for line in found) == [1, 3]
        (alone,) = (line for line in found if len(line.wires) == 1)
        assert alone.wires[0].curve.y == 8.0


def test_what_only_the_other_tolerance_finds_is_none_if_it_may_be_an_accident() -> None:
    first, second = (((0, y, 9), (60, y, 9)) for y in (0.0, 8.0))
    corridor = corridor_of(wire(*first, 400, per_metre=1)[1], twigs(0, 6000) + np.array([0, 8, 0]))
    assert len(better(corridor, [line_of(first, second)], [line_of(first, first, first)])) == 1


def test_each_span_is_taken_at_the_tolerance_at_which_more_of_it_is_found() -> None:
    """The larger finds more of the second span; of the first all is found at both."""
    first, second = (((x, 0, 9), (x + 60, 0, 9)) for x in (0.0, 60.0))
    part = ((60, 0, 9), (90, 0, 9))
    corridor = corridor_of(*(wire(*ends, 400, per_metre=1)[1] for ends in (first, second)))

    def line(*ends: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Line:
        spans = [replace(line_of(one).wires[0], span=k) for k, one in enumerate(ends)]
        return Line(spans, [])

    narrow, wide = line(first, part), line(first, second)
    found = better(corridor, [narrow], [wide])
    assert [one.wires[0] for one in found] == [narrow.wires[0], wide.wires[1]]
