"""Wires of which a few points tell, and as few points that are no wires."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import shapely
from scenes.corridors import CORNER, Floats, cloud, ground, pole, tree, wire
from scipy.spatial import cKDTree

from algorithms.corridor._curves.arcs import (
    Binned,
    cut_together,
    cuts_of,
    lines_with_cuts,
    tracks_at,
)
from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._curves.lanes import (
    Lanes,
    fit_anything,
    followed_together,
    in_order,
    pieces_in,
)
from algorithms.corridor._curves.network import Corridor, Piece
from algorithms.corridor._curves.sparse import groups, in_sheets, lonely
from algorithms.corridor._curves.trace import Airborne
from algorithms.corridor._curves.tracks import Alignment, chained, meet_below
from algorithms.corridor._settings import SETTINGS
from algorithms.corridor.extract import CorridorExtract
from toolbox.context import QUIET

GROUND = ground(200, 60, 8)
SPAN = ((0.0, 0.0, 9.0), (80.0, 0.0, 9.5))
C = 500.0  # metres


def three_wires(per_metre: float, seed: int = 0) -> list[Floats]:
    """Wires 0.9 m apart over one span of 80 m."""
    aside = np.array([0.0, 0.9, 0.0])
    ends = [np.array(end) for end in SPAN]
    return [
        wire(*(tuple(end + k * aside) for end in ends), C, per_metre, seed=seed + k)[1]
        for k in (-1, 0, 1)
    ]


def searched(xyz: Floats, radius: float = 0.25) -> list[tuple[np.ndarray, float, bool]]:
    """What is found among points that all stand alone."""
    near = cKDTree(xyz).query(xyz, k=range(2, min(SETTINGS.sparse.neighbours, len(xyz)) + 1))[1]
    return groups(xyz, np.ascontiguousarray(near), radius, QUIET)


@pytest.mark.parametrize("seed", range(3))
def test_wires_with_a_point_in_seven_metres_are_found(seed: int) -> None:
    wires = three_wires(0.15, 10 * seed)
    result = CorridorExtract(points=cloud(GROUND, *wires)).run()
    said = result.classified["classification"] == 14
    assert said[len(GROUND) :].mean() > 0.8
    assert not said[: len(GROUND)].any()
    assert abs(result.wires.frame.c - C).median() < 0.2 * C


def scattered(seed: int, count: int = 400) -> Floats:
    """Points anywhere in the air."""
    return np.random.default_rng(seed).uniform([0, -40, 4], [300, 40, 14], (count, 3))


def test_points_anywhere_are_no_wires() -> None:
    alarms = [len(searched(scattered(seed))) for seed in range(12)]
    assert sum(alarms) <= 3  # of each scene less than one is expected


def test_wires_are_found_among_points_anywhere() -> None:
    wires = np.vstack(three_wires(0.2))
    found = searched(np.vstack([wires, scattered(1, 100)]))
    own = np.concatenate([points for points, _, _ in found])
    assert (own < len(wires)).mean() > 0.9
    assert len(own) > 0.7 * len(wires)


def test_what_three_wires_show_one_does_not() -> None:
    """Evidence adds: of seven points each, three wires are no accident, and one alone may be."""
    three = three_wires(0.09)
    assert len(searched(np.vstack([*three, scattered(2, 200)]))) > 0
    assert not searched(np.vstack([three[1], scattered(2, 200)]))


def test_points_with_company_do_not_stand_alone() -> None:
    wires = three_wires(0.1)
    crown = tree(40.0, 12.0, 10.0, 4.0, 800)
    air = Airborne.of(np.vstack([*wires, crown]))
    height = air.xyz[:, 2]
    corridor = Corridor(
        air, height, height > 4, 0.25, ground=lambda x, y: 0.0, seen=lambda x, y: True
    )
    own = np.arange(len(corridor.wires.xyz))
    own = own[lonely(corridor, own, SETTINGS.sparse.company)]
    on_wire = corridor.wires.xyz[own, 1] < 2
    assert on_wire.sum() > 0.9 * sum(map(len, wires))
    assert (~on_wire).sum() < 0.1 * len(crown)


def stack(per_metre: float, seed: int) -> list[Floats]:
    """Four wires 0.35 m above each other over two spans of 38 m, which sag by more than that."""
    return [
        wire((x, 0.0, 8 + 0.35 * k), (x + 38.0, 0.0, 8.2 + 0.35 * k), 140.0, per_metre, seed + k)[1]
        for x in (0.0, 38.0)
        for k in range(4)
    ]


@pytest.mark.parametrize("seed", [0, 2])
def test_wires_close_above_each_other_are_told_apart(seed: int) -> None:
    wires = stack(0.6, 10 * seed)
    result = CorridorExtract(points=cloud(GROUND, *wires, pole(38.0, 0.0, 9.5))).run()
    said = result.classified["classification"] == 14
    on_wire = slice(len(GROUND), len(GROUND) + sum(map(len, wires)))
    assert said[on_wire].mean() > 0.85
    assert not said[: len(GROUND)].any()
    assert result.span_count == 2
    assert len(result.wires.frame) == 8
    assert abs(result.wires.frame.c - 140.0).median() < 14.0


def test_points_of_a_crown_and_of_one_wire_are_in_no_sheet() -> None:
    crown = tree(40.0, 12.0, 10.0, 4.0, 150)
    single = wire((0.0, -20.0, 9.0), (80.0, -20.0, 9.0), 500.0, 0.6)[1]
    air = Airborne.of(np.vstack([*stack(0.45, 0), crown, single]))
    height = air.xyz[:, 2]
    corridor = Corridor(air, height, height > 4, 0.1, lambda x, y: 0.0, lambda x, y: True)
    own = np.arange(len(corridor.wires.xyz))
    kept, y = in_sheets(corridor, own), corridor.wires.xyz[:, 1]
    assert kept[np.abs(y) < 2].mean() > 0.8
    assert kept[y > 2].mean() < 0.1
    assert kept[y < -2].mean() < 0.1


def test_a_wire_that_is_seen_far_off_alone_does_not_count_at_a_cut() -> None:
    """Of two, one is not seen for 150 m."""
    weight = np.ones((200, 2))
    weight[25:175, 1] = 0.0
    zeros = np.zeros(weight.shape)
    count = tracks_at(Binned(1.0, weight, weight, zeros, zeros, zeros))
    assert count[[0, 20, 100, 200]].tolist() == [0, 2, 1, 0]


@pytest.mark.parametrize(
    ("wires", "spacing", "tracks"),
    [(1, 2.0, 1), (2, 2.0, 4), (2, 8.0, 2)],
    ids=["a single wire", "two", "two with few points"],
)
def test_what_follows_behind_a_gap_is_the_same_wire(
    wires: int, spacing: float, tracks: int
) -> None:
    """The gap is 30 m long; of two wires seen every 2 m it may part different ones."""
    all_of = [
        wire((x, 6.0 * k, 9.0), (x + 160.0, 6.0 * k, 9.0), 5000.0)[0].points(
            np.arange(0.0, 161.0, spacing)
        )
        for k in range(wires)
        for x in (0.0, 190.0)
    ]
    air = Airborne.of(np.vstack(all_of))
    height = air.xyz[:, 2]
    corridor = Corridor(air, height, height > 4, 0.25, lambda x, y: 0.0, lambda x, y: True)
    x, y, _ = corridor.wires.xyz.T
    own = [
        np.flatnonzero((np.abs(y - 6 * k) < 1) & ((x > 175) == far))
        for k in range(wires)
        for far in (False, True)
    ]
    curves = [fit(corridor.wires.xyz[points]) for points in own]
    pieces = [Piece(points, curve) for points, curve in zip(own, curves, strict=True) if curve]
    assert len(pieces) == 2 * wires
    assert len(chained(corridor, Alignment.of(pieces))) == tracks


def test_a_single_wire_is_one_behind_a_gap_with_a_support() -> None:
    """15 points per 100 m, none for 20 m; its support stands at the beginning of the gap.

    Drawn on to the middle, its ends were 3 m apart, and no support was found between them.
    """
    ends = ((0.0, 0.0, 19.0), (152.0, 0.0, 24.0)), ((152.0, 0.0, 24.0), (320.0, 0.0, 19.0))
    xyz = np.vstack([wire(*span, 300.0, 0.15, seed=k)[1] for k, span in enumerate(ends)])
    air = Airborne.of(xyz[np.abs(xyz[:, 0] - 160.0) > 10.0])
    height = air.xyz[:, 2]
    corridor = Corridor(air, height, height > 4, 0.25, lambda x, y: 0.0, lambda x, y: True)
    own = [np.flatnonzero((corridor.wires.xyz[:, 0] > 160.0) == far) for far in (False, True)]
    curves = [fit(corridor.wires.xyz[points]) for points in own]
    pieces = [Piece(points, curve) for points, curve in zip(own, curves, strict=True) if curve]
    assert len(pieces) == 2
    assert len(chained(corridor, Alignment.of(pieces))) == 1


@pytest.mark.parametrize(
    ("slopes", "up", "meet"),
    [
        ((0.1, -0.1), 0.0, True),
        ((0.1, -0.1), 0.6, True),  # nearer to the end of the gap
        ((0.1, -0.1), 3.0, False),  # beyond it
        ((-0.1, 0.1), 0.0, False),  # a valley: no support holds wires down
        ((0.0, 0.0), 0.3, True),
        ((0.0, 0.0), 0.5, False),
    ],
)
def test_wires_meet_at_a_support_that_is_between_them(
    slopes: tuple[float, float], up: float, meet: bool
) -> None:
    """The gap goes from -10 to 10 m; the wires cross in its middle, or are `up` apart there."""
    u = np.arange(10.0, 60.0, 5.0)
    one, other = (
        np.column_stack([side * u, 0 * u, slope * side * u])
        for side, slope in zip((-1, 1), slopes, strict=True)
    )
    assert meet_below(one, other + np.array([0.0, 0.0, up]), 0.4) is meet


def test_an_alignment_reaches_as_far_as_its_wires() -> None:
    """Of two wires of no lane one was put together from two pieces, and has the curve of the first.

    Through the three points of the other no curve is fitted anew, so it keeps its own.
    """
    wires = [
        wire((0.0, y, 9.0), (200.0, y, 9.0), 2000.0, 0.3, seed=seed)[1]
        for seed, y in enumerate((0.0, 0.9))
    ]
    other = wire((0.0, 9.0, 9.0), (400.0, 9.0, 9.0), 2000.0, 0.3, seed=2)[1]
    air = Airborne.of(np.vstack([*wires, other]))
    height = air.xyz[:, 2]
    corridor = Corridor(air, height, height > 4, 0.25, lambda x, y: 0.0, lambda x, y: True)
    xyz = corridor.wires.xyz
    own = [np.flatnonzero(np.abs(xyz[:, 1] - y) < 0.4) for y in (0.0, 0.9, 9.0)]
    first = own[2][xyz[own[2], 0] < 200]
    curves = [fit(xyz[points]) for points in (*own[:2], first)]
    pieces = [Piece(points, curve) for points, curve in zip(own, curves, strict=True) if curve]
    pieces += [replace(pieces[2], points=own[2][:3])]
    alignment = Alignment.of(pieces)
    lanes = Lanes.of([in_order(alignment.track(xyz[piece.points])) for piece in pieces[:2]])
    assert lanes is not None
    whole = Alignment.of(pieces_in(corridor, alignment, lanes, 30.0, QUIET))
    assert len(whole.pieces) == 4
    along, _ = whole.along(xyz)
    assert along.min() > 0
    assert along.max() < whole.step * whole.steps


POLES = (0.0, 62.0, 130.0, 190.0, 258.0, 320.0)  # metres along a line


def sparse_line(seed: int) -> list[Floats]:
    """Three wires 0.9 m apart with a point in twelve metres each, held at `POLES`."""
    return [
        np.vstack(
            [
                wire((a, y, 9.0), (b, y, 9.0), 600.0, 0.08, noise=0.08, seed=seed + int(a + y))[1]
                for a, b in itertools.pairwise(POLES)
            ]
        )
        for y in (9.1, 10.0, 10.9)
    ]


def aligned(wires: Sequence[Floats], until: float = POLES[-1]) -> tuple[Corridor, Alignment]:
    """A corridor of wires, and what is known of them up to a chainage."""
    air = Airborne.of(np.vstack(wires))
    height = air.xyz[:, 2]
    corridor = Corridor(air, height, height > 4, 0.25, lambda x, y: 0.0, lambda x, y: True)
    of_wire = np.repeat(np.arange(len(wires)), [len(own) for own in wires])[air.order]
    pieces = []
    for k in range(len(wires)):
        points = np.flatnonzero((of_wire == k) & (air.xyz[:, 0] < until))
        y = float(np.median(air.xyz[points, 1]))
        pieces.append(Piece(points, Catenary(0.0, y, 1.0, 0.0, until, 9.0, 9.0, 1 / 3000)))
    return corridor, Alignment.of(pieces)


@pytest.mark.parametrize("seed", range(1000, 1005))
def test_sparse_wires_tell_together_where_they_are_held(seed: int) -> None:
    """Through the points of each, an arc over two spans fits as well."""
    corridor, alignment = aligned(sparse_line(seed))
    assert fit_anything(alignment.tracks(corridor))
    alone = cuts_of(corridor, alignment, alignment.tracks(corridor))[0]
    (line,) = lines_with_cuts(corridor, alignment)
    assert len(alone) < 4
    np.testing.assert_allclose(line.places(line.cuts)[:, 0], POLES[1:-1], atol=5.0)


def test_wires_with_enough_points_tell_each_for_itself_where_they_are_held() -> None:
    corridor, alignment = aligned([np.vstack([own] * 3) for own in sparse_line(1000)])
    assert not fit_anything(alignment.tracks(corridor))
    assert cut_together(corridor, alignment, alignment, np.zeros(0)) is None
    assert cut_together(corridor, alignment, alignment, np.array(POLES[1:-1])) is None


def test_sparse_wires_are_followed_together_over_their_supports() -> None:
    """Of each two spans of five are known, two fifths of the points.

    Fewer are found where points must be as near as those of a single wire, and none where points
    are too few to be followed one after the other.
    """
    shares = []
    for seed in range(1000, 1010):
        corridor, alignment = aligned(sparse_line(seed), until=130.0)
        found = followed_together(corridor, alignment, 30.0, QUIET)
        points = np.unique(np.concatenate([piece.points for piece in found.pieces]))
        shares.append(len(points) / len(corridor.air.xyz))
    assert np.mean(shares) > 0.62


@pytest.mark.parametrize("gap", [60.0, 110.0])
def test_no_support_is_made_up_in_a_gap(gap: float) -> None:
    """Wires are not seen between 180 m and as far behind it as the gap is long."""
    wires = [
        wire((x, y, 12.0), (x + 90.0, y, 12.0), 600.0, 0.25, seed=int(x + 10 * y))[1]
        for x in (0.0, 90.0, 180.0 + gap, 270.0 + gap)
        for y in (0.0, 1.5, 3.0)
    ]
    ground_of = ground(400.0 + gap, 40.0, 4.0)
    result = CorridorExtract(points=cloud(ground_of, *wires)).run()
    middle = CORNER[0] + 180.0 + gap / 2
    places = shapely.get_coordinates(result.towers.frame.geometry)[:, 0]
    assert np.abs(places - middle).min() > 0.4 * gap
    assert not result.wires.frame.intersects(shapely.box(middle - 5, -1e9, middle + 5, 1e9)).any()
