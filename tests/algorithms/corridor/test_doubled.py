"""A support that is known twice, and one of which only ends of wires tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scenes.corridors import Floats, wire

from algorithms.corridor._curves.catenary import fit
from algorithms.corridor._curves.network import Corridor, Piece
from algorithms.corridor._curves.trace import Airborne
from algorithms.corridor._extraction.doubled import without_doubled
from algorithms.corridor._extraction.spans import Wire
from algorithms.corridor._extraction.supports import Hint, Support, support_of

PHASES = (-1.0, 0.0, 1.0)


def support_at(x: float, sd_along: float, y: float = 0.0, body: float = 0.0) -> Support:
    """One that holds three wires 9 m up."""
    cuts = frozenset([(0, 1)])
    return Support(x, y, (0.0, 1.0), (-1.0, 1.0), 9, 9, 0, body, sd_along=sd_along, cuts=cuts)


def span(number: int, start: float, end: float, held: tuple[int, int], c: float) -> list[Wire]:
    """Three wires, each fitted to the points of a survey, as far as their supports."""
    found = []
    for k, y in enumerate(PHASES):
        _, points = wire((start, y, 9), (end, y, 9), c, 0.5, number)
        curve = fit(points, spread=0.5)
        assert curve is not None
        low = float(curve.along(np.array([[start, y, 9.0]]))[0][0])
        curve = curve.between(low, low + end - start)
        found.append(Wire(curve, held, (0.0, curve.length), 0.25, span=number, wire=3 * number + k))
    return found


def two_spans(
    places: tuple[float, float], sds: tuple[float, float], c: float = 400.0
) -> tuple[list[Wire], list[Support]]:
    """Spans of 60 m to both sides of x = 0, of which each has a support there of its own."""
    wires = [
        replace(one, curve=one.curve.between(*ends))
        for one, ends in [
            *((one, (0.0, 60.0 + places[0])) for one in span(0, -60.0, 0.0, (0, 1), c)),
            *((one, (places[1], 60.0)) for one in span(1, 0.0, 60.0, (2, 3), c)),
        ]
    ]
    x = (-60.0, *places, 60.0)
    sd = (0.1, *sds, 0.1)
    return wires, [support_at(*one) for one in zip(x, sd, strict=True)]


@pytest.mark.parametrize(
    ("places", "sds"),
    [((2.0, -3.0), (2.0, 2.0)), ((-4.0, 3.0), (2.0, 2.0)), ((-1.0, 7.5), (2.0, 1.0))],
    ids=["spans that overlap", "with a gap", "the surer place is the wrong one"],
)
def test_a_support_that_each_span_puts_elsewhere_is_where_the_wires_meet(
    places: tuple[float, float], sds: tuple[float, float]
) -> None:
    wires, supports = without_doubled(*two_spans(places, sds))
    assert [round(one.x) for one in supports] == [-60, 0, 60]
    assert abs(supports[1].x) < 0.5
    assert abs(supports[1].x) < 3 * supports[1].sd_along < 1.5
    assert {wire.supports for wire in wires} == {(0, 1), (1, 2)}


def test_where_wires_hardly_bend_it_is_at_the_mean_of_both_places() -> None:
    """One is known twice as well, so it has four times the weight; both are off by too much."""
    _, supports = without_doubled(*two_spans((5.0, -4.0), (1.0, 2.0), c=4e5))
    assert supports[1].x == pytest.approx(3.2, abs=0.3)
    assert supports[1].sd_along == pytest.approx(2 / math.sqrt(5) * 9 / math.sqrt(5), rel=0.2)


@pytest.mark.parametrize(
    "places", [(-6.0, 6.0), (6.0, -6.0)], ids=["far before", "far behind each other"]
)
def test_supports_farther_apart_than_one_reaches_are_two(places: tuple[float, float]) -> None:
    assert len(without_doubled(*two_spans(places, (2.0, 2.0)))[1]) == 4


def test_two_poles_that_are_seen_are_two() -> None:
    wires, supports = two_spans((2.0, -3.0), (0.1, 0.1))
    seen = [*supports[:1], *(support_at(one.x, 0.1, body=0.9) for one in supports[1:3])]
    assert len(without_doubled(wires, [*seen, supports[3]])[1]) == 4


def test_legs_of_a_frame_are_not_one_by_their_wires() -> None:
    """Which of them stand for one frame is known once each was moved to its middle."""
    wires, supports = two_spans((2.0, -3.0), (2.0, 2.0))
    legs = [replace(supports[1], y=-2.0), replace(supports[2], y=2.0)]
    assert len(without_doubled(wires, [supports[0], *legs, supports[3]])[1]) == 4


def test_a_support_that_holds_another_span_too_is_not_one_of_two() -> None:
    wires, supports = two_spans((2.0, -3.0), (2.0, 2.0))
    branch = span(2, 0.0, 40.0, (1, 3), 400.0)[:1]
    assert len(without_doubled([*wires, *branch], supports)[1]) == 4


def test_a_support_of_one_wire_that_meets_is_not_that_of_three() -> None:
    wires, supports = two_spans((2.0, -3.0), (2.0, 2.0))
    assert len(without_doubled(wires[:4], supports)[1]) == 4


def test_wires_that_leave_to_one_side_are_of_two_supports() -> None:
    wires = [*span(0, 0.0, 60.0, (0, 1), 400.0), *span(1, 4.0, 64.0, (2, 3), 400.0)]
    supports = [support_at(x, 2.0) for x in (0.0, 60.0, 4.0, 64.0)]
    assert len(without_doubled(wires, supports)[1]) == 4


def test_both_ends_of_a_short_span_are_two_supports() -> None:
    wires = span(0, 0.0, 8.0, (0, 1), 400.0)
    assert len(without_doubled(wires, [support_at(x, 2.0) for x in (0.0, 8.0)])[1]) == 2


def test_a_support_is_one_with_the_nearest_alone() -> None:
    """The others hold the same wires of two spans, which no support can."""
    wires, supports = two_spans((2.0, -3.0), (2.0, 2.0))
    again = [replace(one, span=2, supports=(4, 5)) for one in wires[3:]]
    supports += [support_at(-4.0, 2.0), support_at(60.0, 0.1)]
    assert len(without_doubled([*wires, *again], supports)[1]) == 5


def ended(per_metre: float, behind: float) -> Support | None:
    """The support at which three wires end together, with data so far behind it."""
    pieces, hints = [], []
    clouds: list[Floats] = []
    for k, y in enumerate(PHASES):
        curve, points = wire((-60, y, 9), (0, y, 9), 400, per_metre)
        pieces.append(Piece(np.arange(len(points)), curve, arc=(0, 0)))
        place = np.array([0.0, y, 9.0])
        hints.append(Hint(place, np.array([1.0, 0.0]), 0.1, k, False, math.inf, (0, 1), 0))
        clouds.append(points)
    return found_among(clouds, pieces, hints, behind)


def found_among(
    clouds: Sequence[Floats], pieces: Sequence[Piece], hints: Sequence[Hint], behind: float
) -> Support | None:
    air = Airborne.of(np.vstack(clouds))
    yes = np.ones(len(air.xyz), bool)
    corridor = Corridor(
        air, air.xyz[:, 2], yes, 0.25, lambda x, y: 0.0, lambda x, y: bool(x < behind)
    )
    return support_of(corridor, pieces, hints)


@pytest.mark.parametrize(
    ("per_metre", "behind", "held"),
    [
        (1.0, 12.0, True),
        (0.1, 12.0, False),  # three wires that go on leave no point in 12 m in 3 cases of 100
        (0.1, 20.0, True),  # and in 20 m in 2 of 1000
    ],
)
def test_wires_end_at_a_support_where_a_gap_as_long_is_no_accident(
    per_metre: float, behind: float, held: bool
) -> None:
    assert (ended(per_metre, behind) is not None) is held
