"""Which supports hold a wire, which of them are one, and what a span finds at a tolerance."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from scenes.corridors import Floats, bar, cloud, ground, line, unlabelled, wire
from scipy.spatial import cKDTree

from algorithms.corridor._curves.arcs import cuts_of, is_certain
from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._curves.network import Corridor, Piece
from algorithms.corridor._curves.structures import is_row_of_mesh
from algorithms.corridor._curves.trace import Airborne
from algorithms.corridor._curves.tracks import TRACK_BIN, Alignment
from algorithms.corridor._extraction import follow
from algorithms.corridor._extraction.follow import (
    Line,
    Tried,
    better,
    evidence,
    is_held,
    near_poles,
    same_spans,
    seen_supports,
    together,
)
from algorithms.corridor._extraction.spans import Wire, cut, on_wire
from algorithms.corridor._extraction.supports import (
    Hint,
    Support,
    abreast,
    pole_near,
    support_of,
    supports_of,
)
from algorithms.corridor._extraction.towers import compared, top_of
from algorithms.corridor._settings import SETTINGS
from algorithms.corridor.extract import CorridorExtract
from algorithms.samples.scene import SamplesScene
from toolbox.context import QUIET
from toolbox.data import PointCloud


def corridor_of(*parts: Floats) -> Corridor:
    """Points above flat ground that all may be wire."""
    air = Airborne.of(np.vstack(parts))
    yes = np.ones(len(air.xyz), bool)
    return Corridor(air, air.xyz[:, 2], yes, 0.25, lambda x, y: 0.0, lambda x, y: True)


def spans(*ends: tuple[float, float]) -> Line:
    """A wire along the x axis, 9 m up, with spans from one place to another."""
    curves = [wire((a, 0, 9), (b, 0, 9), 400)[0] for a, b in ends]
    return Line(
        [Wire(c, (-1, -1), (0.0, c.length), 0.25, span=k) for k, c in enumerate(curves)], []
    )


WIRE = wire((0, 0, 9), (60, 0, 9), 4000)[1], wire((60, 0, 9), (120, 0, 9), 4000)[1]


def lengths(narrow: Line, wide: Line) -> list[float]:
    found = better(corridor_of(*WIRE), [narrow], [wide])
    return sorted(round(w.curve.length) for line in found for w in line.wires)


def test_a_span_does_not_find_more_by_reaching_over_its_support() -> None:
    """The wider tolerance has the support at 85 m: what it has more is part of the next span."""
    straight = [replace(w, curve=_hung(w.curve)) for w in spans((0, 60), (60, 120)).wires]
    over = [replace(w, curve=_hung(w.curve)) for w in spans((0, 85), (85, 120)).wires]
    assert lengths(Line(straight, []), Line(over, [])) == [60, 60]


def test_a_span_of_one_tolerance_is_kept_though_its_supports_hardly_show() -> None:
    doubtful = replace(support_at(0), chance=-1e6)
    seen = Line([replace(w, supports=(0, -1)) for w in spans((0, 60)).wires], [doubtful])
    corridor = corridor_of(WIRE[0][::40])
    for narrow, wide in (([seen], []), ([], [seen])):
        assert len(better(corridor, narrow, wide)) == 1


def _hung(curve: Catenary) -> Catenary:
    """A curve so flat that points of both spans lie on it."""
    return replace(curve, curvature=1 / 4000)


def test_supports_in_wrong_places_are_not_taken_for_the_sake_of_more_wire() -> None:
    """Of the right spans the ends are not known; arcs to a support 6 m off lie 0.2 m off."""
    right = [replace(w, known=(5.0, 55.0)) for w in spans((0, 60), (60, 120)).wires]
    wrong = [raised(w, 0.2) for w in spans((0, 66), (66, 120)).wires]
    assert (
        lengths(narrow := Line([raised(w, 0.01) for w in right], []), Line(wrong, [])) == [60] * 2
    )
    assert narrow.length < 0.9 * sum(w.seen_length for w in wrong)
    bare = replace(support_at(60), chance=-1000.0)
    held = [replace(raised(w, 0.01), supports=(0, -1)) for w in spans((0, 60), (60, 120)).wires]
    assert lengths(Line(held, [bare]), Line(wrong, [])) == [54, 66]


def raised(one: Wire, up: float) -> Wire:
    """A wire so much above its points, which it says to be its scatter."""
    curve = _hung(one.curve)
    higher = replace(curve, z_start=curve.z_start + up, z_end=curve.z_end + up, rms=up)
    return replace(one, curve=higher)


def test_a_point_on_two_wires_tells_once_for_the_one_that_explains_it_best() -> None:
    corridor = corridor_of(*WIRE)
    clean, rough = spans((0, 60)), spans((0, 60))
    clean.wires[0] = raised(clean.wires[0], 0.01)
    rough.wires[0] = raised(rough.wires[0], 0.2)
    alone = evidence(corridor, [clean])
    assert evidence(corridor, [rough]) < alone
    # With it comes what only the rough one reaches, farther from the wire.
    assert alone <= evidence(corridor, [rough, clean]) < 1.05 * alone


def test_a_support_of_two_spans_tells_against_them_once_however_much_lies_elsewhere() -> None:
    corridor = corridor_of(*WIRE)
    doubtful = replace(support_at(60), chance=-50.0)
    one, other = (
        Line([replace(raised(w, 0.01), supports=ends)], [doubtful])
        for w, ends in zip(spans((0, 60), (60, 120)).wires, ((-1, 0), (0, -1)), strict=True)
    )
    bare = [replace(span, supports=[]) for span in (one, other)]
    assert evidence(corridor, [one, other]) == pytest.approx(evidence(corridor, bare) - 50)
    everything = np.arange(len(corridor.air.xyz))
    assert evidence(corridor, [one, other], everything) == -50 - 2 * one.wires[0].curve.parameters


def test_what_is_on_the_next_span_of_the_other_tolerance_is_told_by_its_points() -> None:
    """The wide span goes on for 20 m along the next narrow one: these points count nothing."""
    corridor = corridor_of(*WIRE)
    narrow = [Line([replace(w, curve=_hung(w.curve))], []) for w in spans((0, 60), (60, 120)).wires]
    (wide,) = (Line([replace(w, curve=_hung(w.curve))], []) for w in spans((0, 80)).wires)
    (beside,) = (points for _, other, points in same_spans(corridor, narrow, [wide]) if other)
    x = corridor.air.xyz[beside, 0]
    assert 60 <= x.min() < 62
    assert 78 < x.max() <= 80
    assert 0 < evidence(corridor, [wide], beside) < evidence(corridor, [wide])


def test_of_spans_that_fit_alike_those_with_fewer_parameters_are_taken() -> None:
    """A support between the two halves gains nothing."""
    (whole,) = (raised(w, 0.01) for w in spans((0, 60)).wires)
    halves = [
        replace(whole, curve=whole.curve.between(a, a + 30), known=(0.0, 30.0), span=k)
        for k, a in enumerate((0.0, 30.0))
    ]
    one, two = Line([whole], []), Line(halves, [])
    assert lengths(one, two) == lengths(two, one) == [60]
    assert whole.curve.parameters == 5
    assert replace(whole.curve, swing=0.1).parameters == 6


def test_a_support_is_in_doubt_if_less_is_seen_of_it_than_of_the_others() -> None:
    poles = [bar((x, 0.0, 0.0), (x, 0.0, 9.0), 1.0) for x in (0.0, 30.0, 60.0)]
    supports = [support_at(x) for x in (0, 30, 60, 90)]
    *seen, bare = compared(corridor_of(*poles), [], supports)
    assert [one.chance for one in seen] == [0.0] * 3
    assert -12 < bare.chance < -6  # 8 or 9 points are seen of the others, and log P(0) = -8 or -9
    assert compared(corridor_of(*poles), [], supports[3:])[0].chance == 0.0  # there are no others


def test_points_are_on_a_wire_by_its_scatter_however_wide_it_was_followed() -> None:
    """A twig 0.2 m off is none of a clean wire's."""
    points = WIRE[0] + np.array([0.0, 0.0, 0.2])
    wide = replace(spans((0, 60)).wires[0], tolerance=0.625)
    one = replace(wide, curve=replace(_hung(wide.curve), rms=0.03))
    assert len(on_wire(corridor_of(points), one)[0]) < 0.05 * len(points)
    rough = replace(one, curve=replace(one.curve, rms=0.1))
    assert len(on_wire(corridor_of(points), rough)[0]) > 0.9 * len(points)


def piece_of(points: Floats, arc: tuple[int, int]) -> tuple[Corridor, Piece]:
    corridor = corridor_of(points)
    curve = wire((0, 0, 9), (60, 0, 9), 400)[0]
    return corridor, Piece(np.arange(len(points)), curve, arc=arc)


@pytest.mark.parametrize(("cuts", "held"), [((0, 1), True), ((1, 1), False), ((0, 4), False)])
def test_a_wire_is_held_where_its_line_is_cut_though_none_saw_it_there(
    cuts: tuple[int, int], held: bool
) -> None:
    """The arms were seen to the other wire only, 8 m aside."""
    corridor, piece = piece_of(wire((0, 0, 9), (48, 0, 9), 400)[1], (0, 0))
    support = Support(60, 12, (0.0, 1.0), (-4.0, 0.0), 9, 9, 0, 1.0, cuts=frozenset([cuts]))
    (one,) = cut(corridor, piece, [support])
    assert (0 in one[1]) == held


def test_two_legs_of_a_frame_that_two_lines_found_are_one_support() -> None:
    """The support on one leg holds the span before it, that on the other the span behind it."""
    offsets = (-4.0, 0.0, 4.0)
    points = [wire((a, y, 12), (a + 50, y, 12), 400)[1] for a in (0, 50) for y in offsets]
    frame = [bar((50, y, 0), (50, y, 13.5), 15) for y in (-5, 5)]
    frame.append(bar((50, -5, 13.5), (50, 5, 13.5), 15))
    lines = []
    for first, leg in ((0.0, -5.0), (50.0, 5.0)):
        curves = [wire((first, y, 12), (first + 50, y, 12), 400)[0] for y in offsets]
        ends = (-1, 0) if first == 0 else (0, -1)
        wires = [Wire(c, ends, (0.0, 50.0), 0.25, span=1, wire=k) for k, c in enumerate(curves)]
        sides = (-4 - leg, 0 - leg) if leg < 0 else (0 - leg, 4 - leg)
        lines.append(Line(wires, [Support(50, leg, (0.0, 1.0), sides, 12, 12, 0, 1.0)]))
    wires, (support,) = together(corridor_of(*points, *frame), lines)
    np.testing.assert_allclose((support.x, support.y), (50, 0), atol=0.3)
    assert len({wire.wire for wire in wires}) == 3
    assert all(0 in wire.supports for wire in wires)


@pytest.mark.parametrize("seen", [True, False], ids=["two poles", "one pole"])
def test_lines_abreast_have_a_support_each_if_each_shows_a_body(seen: bool) -> None:
    """Two lines 8 m apart that were one alignment, and are cut at the same chainage."""
    lines = [0.0, 8.0]
    poles = [bar((50, y, 0), (50, y, 12), 15) for y in lines[: 1 + seen]]
    hints = [
        Hint(np.array([50, y, 11.0]), np.array([way, 0.0]), 0.1, k, True, 0.1, (k, 1), 0)
        for k, y in enumerate(lines)
        for way in (1.0, -1.0)
    ]
    corridor = corridor_of(*poles)
    assert len(abreast(corridor, [], hints)) == 1 + seen
    apart = [replace(hint, whole=hint.cut[0]) for hint in hints]
    assert len(abreast(corridor, [], apart)) == 1


@pytest.mark.parametrize(
    ("turn", "known"), [(20.0, True), (-20.0, True), (10.0, True), (5.0, False), (0.0, False)]
)
def test_a_support_stands_where_wires_of_two_legs_cross(turn: float, known: bool) -> None:
    """Wires end 2 m before and 8 m behind it, and it had been in the middle, 3 m off.

    Where the line turns by less, they cross anywhere: then nothing tells the place.
    """
    angle = np.radians(turn)
    behind = np.array([np.cos(angle), np.sin(angle)])
    hints = [
        Hint(np.array([*place, 9.0]), way, 0.1, k, False, np.inf, (k, 0), k)
        for k, (place, way) in enumerate(
            [(np.array([-2.0, 0.0]), np.array([1.0, 0.0])), (8.0 * behind, -behind)]
        )
    ]
    found = support_of(corridor_of(*WIRE), [], hints)
    assert found is not None
    assert bool(np.hypot(found.x, found.y) < 0.1) is known
    assert (found.sd_along < 1.0) is known


@pytest.mark.parametrize(("apart", "count"), [(6.0, 2), (4.0, 1)])
def test_lines_cut_apart_have_supports_one_after_the_other(apart: float, count: int) -> None:
    """Two lines 8 m beside each other, of whose poles nothing is seen."""
    hints = [
        Hint(np.array([50 + k * apart, y, 9.0]), np.array([way, 0.0]), 0.1, k, True, 0.1, (k, 1), 0)
        for k, y in enumerate((0.0, 8.0))
        for way in (1.0, -1.0)
    ]
    found = abreast(corridor_of(*WIRE), [], hints)
    places = {1: [(52.0, 4.0)], 2: [(50.0, 0.0), (56.0, 8.0)]}[count]
    np.testing.assert_allclose([(one.x, one.y) for one in found], places)


@pytest.mark.parametrize(
    ("low", "length", "held"),
    [
        (8.0, 10.0, 40.0),  # twigs, or bracing
        (11.0, 10.0, 11.0),  # more than a quarter of the way up
        (8.0, 30.0, 8.0),  # as long as a span
    ],
)
def test_short_arcs_far_below_the_wires_of_a_tower_are_not_held_by_it(
    low: float, length: float, held: float
) -> None:
    """Wires 40 m up end at a tower, and so do arcs further down."""
    ends = [(a, b, z) for a, b in ((-200, 0), (0, 200)) for z in (40.0, 42.0)]
    ends += [(-length, 0.0, low), (0.0, length, low)]
    pieces, alignments = [], []
    for number, heights in enumerate(((40.0, 42.0), (low,))):
        own = [wire((a, 0, z), (b, 0, z), 400)[0] for a, b, z in ends if z in heights]
        arcs = [
            Piece(np.zeros(400, np.int64), curve, arc=(number, int(curve.x >= 0))) for curve in own
        ]
        one = Alignment.of(arcs)
        cut = np.array([-min(curve.x for curve in own) + TRACK_BIN])
        alignments.append(replace(one, cuts=cut, sigmas=np.array([0.1])))
        pieces += arcs
    inner = [one for one in supports_of(corridor_of(*WIRE), pieces, alignments) if abs(one.x) < 1.0]
    assert [(one.low, one.high) for one in inner] == [(held, 42.0)]


def support_at(x: float, body: float = 0.9, sd_along: float = 0.1) -> Support:
    cut = frozenset([(0, 1)])
    return Support(x, 0, (0.0, 1.0), (-1.0, 1.0), 8, 9, 0, body, sd_along=sd_along, cuts=cut)


def tried(*supports: Support) -> Tried:
    """A span of 120 m, and supports that were tried at the same tolerance."""
    held = [one for one in supports if one.x in (0, 120)]
    return Tried(corridor_of(*WIRE), [], [Line(spans((0, 120)).wires, held)], supports)


def test_poles_are_seen_once_and_only_where_much_of_them_is() -> None:
    nothing, unsure = support_at(30, body=0.45), support_at(90, sd_along=1.5)
    loose = replace(support_at(40), cuts=frozenset())
    tower = replace(support_at(50), high=16)  # which may be 8 m off at another tolerance
    found = seen_supports([support_at(60), nothing, unsure, support_at(62), loose, tower])
    assert [one.x for one in found] == [60]


@pytest.mark.parametrize(
    ("aside", "up", "turn", "row"),
    [
        (0.0, 0.0, 0.0, True),  # on it, parted where others cross
        (6.0, 0.6, 0.0, True),
        (6.0, 3.0, 0.0, False),  # a line above it
        (14.0, 0.0, 0.0, False),
        (0.0, 0.0, 12.0, False),
    ],
)
def test_a_wire_beside_those_of_a_trellis_is_one_of_its_rows(
    aside: float, up: float, turn: float, row: bool
) -> None:
    """No wire that crosses it was followed."""
    mesh = [wire((0, 0, 7), (60, 0, 7), 3000)[0]]
    one = wire((20, aside, 7 + up), (44, aside + turn, 7 + up), 3000)[0]
    assert is_row_of_mesh(one, mesh) == row
    assert not is_row_of_mesh(wire((70, 0, 7), (94, 0, 7), 3000)[0], mesh)
    corridor = corridor_of(*WIRE)
    corridor.tied[:] = mesh
    assert Line([Wire(one, (-1, -1), (0.0, one.length), 0.25)], []).is_structure(corridor) == row


@pytest.mark.parametrize(
    ("seen", "own", "again"),
    [
        (support_at(60), (), True),  # passed
        (support_at(126), (), True),  # the wire ends before it
        (support_at(131), (), False),
        (replace(support_at(60), y=9), (), False),  # of a line beside it
        (support_at(122), (support_at(120),), False),
        (support_at(122), (support_at(120, body=0.2),), True),  # which is not seen where it is
        (support_at(120.5), (support_at(120, body=0.2),), False),
    ],
)
def test_a_line_is_sought_again_where_another_tolerance_sees_a_support(
    seen: Support, own: tuple[Support, ...], again: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, known = tried(*own), []

    def lines_among(corridor: Corridor, *_: object) -> tuple[list[Line], list[Support]]:
        known.append(corridor.arms)
        return [], []

    monkeypatch.setattr(follow, "lines_among", lines_among)
    assert (not one.knowing([seen], 50.0, QUIET)) == again
    assert [arms.tolist() for arms in known] == again * [[[[seen.x, -1.0], [seen.x, 1.0]]]]


POLE = np.array(
    [(x, 0.2, z) for x, z in zip((53, 53.1, 53.2, 53), (2.5, 4.5, 6.5, 8.1), strict=True)]
)


def moved(points: Floats, *step: float) -> Floats:
    return points + np.array(step)


@pytest.mark.parametrize(
    ("pole", "beside", "top", "found"),
    [
        (POLE, (), 9.0, True),
        (moved(POLE, 3, 0, 0), (), 9.0, False),  # farther off than a cut may be moved
        (moved(POLE, 0, 3, 0), (), 9.0, False),  # beside the wires
        (POLE[:2], (), 9.0, False),
        (POLE[1:], (moved(POLE[1:], 0, 0, -1),), 9.0, True),
        (POLE[2:], (moved(POLE[2:], 0, 0, -1),), 9.0, False),  # hangs from the wires
        (POLE, (moved(POLE, 1, 0, 0), moved(POLE, 0, -1, 0)), 9.0, False),  # a trunk
        (POLE, tuple(moved(POLE, 0, 0, k) for k in range(1, 9)), 17.0, False),  # a tower shows more
    ],
)
def test_a_pole_is_found_near_a_cut_in_a_wrong_place(
    pole: Floats, beside: tuple[Floats, ...], top: float, found: bool
) -> None:
    corridor = corridor_of(*WIRE, pole, *beside)
    corridor.free[corridor.air.xyz[:, 2] > 8.5] = top > 9
    one = pole_near(corridor, np.array([50.0, 0.0]), np.array([1.0, 0.0]), np.zeros(2), top)
    assert (one is not None) == found
    if one is not None:
        np.testing.assert_allclose(one[1], (53.05, 0.2), atol=0.1)
        assert one[0] >= SETTINGS.supports.enough_body
        assert one[2] < 0.2


@pytest.mark.parametrize("tolerance", [0.1, 0.25])
@pytest.mark.parametrize(("noise", "certain"), [(0.08, True), (0.2, False)])
def test_a_track_tells_of_supports_by_the_noise_of_surveys_at_a_smaller_tolerance_too(
    tolerance: float, noise: float, certain: bool
) -> None:
    curve, points = wire((0, 0, 9), (60, 0, 9), 400, noise=noise)
    corridor = replace(corridor_of(points), tolerance=tolerance)
    piece = Piece(np.arange(len(points)), curve)
    assert is_certain(corridor, Alignment.of([piece]), piece) == certain


def test_wires_are_cut_at_a_support_that_is_known() -> None:
    """At 60 m they bend by a 25th of what they do between level spans: too little to tell."""
    level = float(Catenary(0, 0, 1, 0, 120, 9, 9, 1 / 700).height(np.array(60.0)))
    middle = level + 0.05 * (9 - level)
    track = np.vstack(
        [wire((0, 0, 9), (60, 0, middle), 700)[1], wire((60, 0, middle), (120, 0, 9), 700)[1]]
    )
    curve = fit(track)
    assert curve is not None
    corridor = corridor_of(track)
    alignment = Alignment.of([Piece(np.arange(len(track)), curve)])
    assert not len(cuts_of(corridor, alignment, alignment.tracks(corridor))[0])
    for aside, cuts in ((0.5, [60.0]), (6.0, [])):
        known = replace(corridor, arms=np.array([[(60.0, aside - 1), (60.0, aside + 1)]]))
        found = alignment.places(cuts_of(known, alignment, alignment.tracks(known))[0])
        np.testing.assert_allclose(found[:, 0], cuts, atol=SETTINGS.arcs.arm_half_width)


@pytest.mark.parametrize(("middle", "found"), [(9.0, True), (None, False)])
def test_a_support_seen_elsewhere_at_which_the_wires_surely_do_not_bend_is_a_tree(
    middle: float | None, found: bool
) -> None:
    """Two wires from 0 to 120 m, or held at 60 m as well, where one is said to stand."""
    ends = [0.0, 120.0] if middle is None else [0.0, 60.0, 120.0]
    height = {0.0: 9.0, 60.0: middle, 120.0: 9.0}
    tracks = [
        np.vstack(
            [
                wire((a, y, height[a]), (b, y, height[b]), 700, seed=int(a) + k)[1]
                for a, b in itertools.pairwise(ends)
            ]
        )
        for k, y in enumerate((-1.0, 1.0))
    ]
    known = np.array([[(60.0, -1.2), (60.0, 1.2)]])
    corridor = replace(corridor_of(*tracks), arms=known)
    pieces = []
    for track in tracks:
        points = np.flatnonzero(cKDTree(track).query(corridor.wires.xyz)[0] == 0)
        curve = fit(track)
        assert curve is not None
        pieces.append(Piece(points, curve))
    alignment = Alignment.of(pieces)
    cuts = alignment.places(cuts_of(corridor, alignment, alignment.tracks(corridor))[0])[:, 0]
    np.testing.assert_allclose(cuts, [60.0] if found else [], atol=1.0)


def test_braces_of_a_support_are_no_mesh_that_its_wires_are_in() -> None:
    """Each wire crosses two braces at its end; in a hop garden it would all along."""
    own = spans((0, 60))
    corridor = corridor_of(*WIRE)

    def brace(x: float) -> Catenary:
        z = float(own.wires[0].curve.height(np.array([x]))[0])
        return wire((x, -3, z), (x, 3, z), 400)[0]

    held = Line([replace(own.wires[0], supports=(0, 1))], [])
    corridor.tied[:] = [brace(58.8), brace(59.5)]
    assert not held.is_structure(corridor)
    corridor.tied[:] = [brace(20.0), brace(31.0)]
    assert held.is_structure(corridor)


@pytest.mark.parametrize("hidden", [False, True])
def test_an_end_of_a_span_without_a_support_is_told(
    hidden: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """The wires are seen up to 20 to 40 m before their pole, which is not seen either."""
    _, wires, poles = line([20, 80, 140], [-1, 0, 1], 9, 400)
    last = [100, 110, 120, *[100, 110, 120], 100] if hidden else [200] * 7
    parts = [part[part[:, 0] < x] for part, x in zip((*wires, poles), last, strict=True)]
    CorridorExtract(points=cloud(ground(200, 60, 8), *parts)).run()
    assert ("support not seen" in caplog.text) == hidden


def test_frames_are_found_the_same_wherever_cells_begin() -> None:
    """Of portals, a leg is found first, of which body and arms tell the middle."""
    made = SamplesScene(kind="corridor", preset="portal_frames", seed=100).run()
    truth = made.features.frame
    true = np.array([g.coords[0][:2] for g in truth[truth.kind == "tower"].geometry])
    for shift in ((0.0, 0.0), (123.4, -56.7)):
        xyz = made.points.xyz + np.append(shift, 0.0)
        result = CorridorExtract(points=PointCloud(xyz, {}, crs=made.points.crs)).run()
        feet = shapely.get_coordinates(result.towers.frame.geometry) - shift
        away = np.hypot(*(feet[:, None] - true[None]).transpose(2, 0, 1))
        assert len(feet) == len(true)
        assert away.min(axis=1).max() < 0.5
        wires = truth[truth.kind == "wire"]
        assert result.span_count == len(wires) / 3  # the data end behind the first and the last


@pytest.mark.parametrize("birds", [0, 2])
def test_the_top_of_a_dense_tower_is_that_of_its_peak(birds: int) -> None:
    """A peak of the guard wire holds few of thousands of points; two birds sit above it."""
    body, peak = np.linspace(2.0, 44.0, 4000), [44.67, 45.14, 45.43]  # as a real one has it
    assert top_of(np.concatenate([body, peak, np.full(birds, 48.0)])) == 45.43
    assert top_of(np.concatenate([body, np.full(birds, 45.1)])) == 44.0
    assert top_of(np.array([7.0, 5.0])) == 5.0


def a_support(x: float, *, height: float = 8.0, body: float = 0.0) -> Support:
    """A pole or tower on the x axis, whose body may show."""
    return Support(x, 0.0, (0.0, 1.0), (-1.0, 1.0), height, height, 0.0, body, sd_along=0.2)


@pytest.mark.parametrize(("height", "count"), [(8.0, 2), (40.0, 0)])
def test_points_near_spans_on_poles_are_looked_at_again(height: float, count: int) -> None:
    """Those of lines on towers are many, and nothing more is found among them."""
    places = np.array([(20.0, 0.0, 9.0), (20.0, 59.0, 5.0), (20.0, 61.0, 5.0)])
    found = spans((0.0, 40.0))
    wires = [replace(one, supports=(0, -1)) for one in found.wires]
    near = near_poles(corridor_of(places), [Line(wires, [a_support(0.0, height=height)])])
    assert near.tolist() == [k < count for k in range(3)]
    assert not near_poles(corridor_of(places), []).any()


def test_a_span_of_the_tolerance_between_is_held_by_what_is_seen_or_known() -> None:
    span = replace(spans((0.0, 40.0)), supports=[a_support(0.0), a_support(40.0)])
    assert not is_held(span, [])
    assert not is_held(span, [a_support(45.0)])
    assert is_held(span, [a_support(42.0)])
    assert is_held(replace(span, supports=[a_support(0.0), a_support(40.0, body=0.9)]), [])


def test_a_crane_beside_a_line_is_no_span_of_its_own() -> None:
    """With what 0.35 m alone finds, held by nothing that is seen, it had two towers and wires."""
    made = SamplesScene(kind="corridor", preset="line_and_cranes", seed=388).run()
    found = CorridorExtract(points=unlabelled(made.points)).run()
    assert found.tower_count == np.count_nonzero(made.features.frame.kind == "tower")
    assert found.span_count == 3


def test_wires_of_a_noisy_town_are_found_between_tolerances(data: Callable[[str], Path]) -> None:
    """At 0.25 and 0.625 m 63 % of this draw is found: too rough, and too crowded."""
    town = PointCloud.open(data("line_williams_town/west.laz"))
    xyz = town.xyz.copy()
    xyz[:, 2] += np.random.default_rng(12).normal(0, 0.05, len(xyz))
    wires = CorridorExtract(points=town.with_xyz(xyz)).run().wires
    assert wires.frame.geometry.length.sum() > 400  # metres of wire; 320 without
