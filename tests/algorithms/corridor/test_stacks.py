"""Wires close above each other, found all at once by the shape in which they hang."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scenes.corridors import Floats, unlabelled, wire

from algorithms.corridor._curves.arcs import bends_tried
from algorithms.corridor._curves.network import Corridor, Piece
from algorithms.corridor._curves.stacks import (
    Stack,
    best_bend,
    best_spans,
    distances_of_pairs,
    gain,
    planes,
    running,
    slopes,
    spacing_of,
    spans_of,
    stack_in,
    stacks_among,
)
from algorithms.corridor._curves.trace import Airborne
from algorithms.corridor._curves.tracks import Alignment
from algorithms.corridor._settings import changed
from algorithms.corridor.extract import CorridorExtract
from algorithms.samples.scene import SamplesScene
from toolbox.context import QUIET

POLES = (0.0, 34.0, 66.0, 102.0, 135.0)  # along the street, metres
HEIGHTS = (8.0, 7.6, 8.5, 9.4, 9.0)  # of the highest wire at these
C = 130.0  # metres: they sag by 1.1 m over 34 m


def street(
    spacing: float,
    count: int,
    *,
    per_metre: float = 0.3,
    c: float = C,
) -> list[list[tuple[object, Floats]]]:
    """The curves and points of the wires, for each wire those of its spans."""
    spans = list(itertools.pairwise(zip(POLES, HEIGHTS, strict=True)))
    return [
        [
            wire(
                (a, 0, z_a - k * spacing), (b, 0, z_b - k * spacing), c, per_metre, seed=10 * k + n
            )
            for n, ((a, z_a), (b, z_b)) in enumerate(spans)
        ]
        for k in range(count)
    ]


def points_of(made: list[list[tuple[object, Floats]]]) -> Floats:
    return np.vstack([points for wires in made for _, points in wires])


def corridor_of(xyz: Floats) -> Corridor:
    """Points above flat ground that all may be wire, at the tolerance of stacks."""
    air, yes = Airborne.of(xyz), np.ones(len(xyz), bool)
    return Corridor(air, air.xyz[:, 2], yes, 0.1, lambda x, y: 0.0, lambda x, y: True)


def pieces_of(made: list[tuple[object, Floats]]) -> list[Piece]:
    """The curves with their points, by the order of these in a corridor of all."""
    row = np.argsort(corridor_of(np.vstack([points for _, points in made])).air.order)
    ends = np.cumsum([0, *(len(points) for _, points in made)])
    return [
        Piece(np.sort(row[low:high]), curve)  # type: ignore[arg-type]
        for (curve, _), low, high in zip(made, ends, ends[1:], strict=False)
    ]


def stack_of(spacing: float, count: int, **how: float) -> Stack:
    """A stack along x whose points, places and number of wires are known."""
    made = street(spacing, count, **how)  # type: ignore[arg-type]
    xyz = points_of(made)
    xyz = xyz[np.argsort(xyz[:, 0])]
    axis = Alignment.of([Piece(np.zeros(0, np.int64), made[0][0][0])])  # type: ignore[arg-type]
    at = np.arange(0.0, POLES[-1] + 1.0)
    middle = running(xyz[:, 0], xyz[:, 2], at, 10.0)
    order = np.arange(len(xyz))
    return Stack(axis, 0.0, order, xyz[:, 0], xyz[:, 2], middle, 0.05, spacing, count)


@pytest.mark.parametrize(
    ("spacing", "count", "per_metre"),
    [(0.35, 4, 0.3), (0.35, 2, 0.8), (0.5, 3, 0.3), (0.8, 3, 0.3)],
)
def test_how_far_wires_are_apart_shows_in_pairs_of_points(
    spacing: float, count: int, per_metre: float
) -> None:
    stack = stack_of(spacing, count, per_metre=per_metre)
    at = np.arange(len(stack.middle), dtype=float)
    slope = np.interp(stack.u, at, slopes(stack.u, stack.z, at, 10.0))
    apart = distances_of_pairs(stack.u, stack.z, slope)
    told, number = spacing_of(apart, 0.05, 0.3)
    assert (told, number) == (pytest.approx(spacing, abs=0.03), count)


def test_points_anywhere_in_a_plane_tell_of_no_wires() -> None:
    rng = np.random.default_rng(1)
    u, z = np.sort(rng.uniform(0, 100, 120)), rng.uniform(6, 8, 120)
    assert spacing_of(distances_of_pairs(u, z, np.zeros(120)), 0.05, 0.3) == (0.0, 1)


def test_one_wire_is_no_stack() -> None:
    rng = np.random.default_rng(1)
    u, z = np.sort(rng.uniform(0, 100, 120)), rng.normal(8, 0.03, 120)
    assert spacing_of(distances_of_pairs(u, z, np.zeros(120)), 0.05, 0.3)[1] == 1


def test_a_stack_is_held_at_its_poles() -> None:
    stack = stack_of(0.35, 4)
    bend, spans = best_spans(stack, best_bend(stack, bends_tried(), QUIET), QUIET)
    assert bend == pytest.approx(1 / C, rel=0.15)
    ends = np.unique([place for a, _, b, _ in spans for place in (a, b)])
    for pole in POLES[1:-1]:
        assert np.abs(ends - pole).min() <= 2.0
    assert len(spans) == len(POLES) - 1
    for (_, _, _, one), (_, other, _, _) in itertools.pairwise(spans):
        assert one == other  # held at one height


def test_a_stretch_without_points_is_left_out() -> None:
    whole = stack_of(0.35, 4)
    seen = (whole.u < POLES[1]) | (whole.u > POLES[3])
    part = Stack(
        whole.axis,
        0.0,
        whole.points[seen],
        whole.u[seen],
        whole.z[seen],
        whole.middle,
        0.05,
        0.35,
        4,
    )
    _, spans = spans_of(part, 1 / C, 1.0)
    covered = sum(
        min(b, POLES[3]) - max(a, POLES[1]) for a, _, b, _ in spans if b > POLES[1] and a < POLES[3]
    )
    assert covered < 10.0
    assert spans[0][0] < 5.0
    assert spans[-1][2] > POLES[-1] - 5.0


def test_points_astray_do_not_hide_a_wire() -> None:
    """A point anywhere tells against the wires no more than that a fifth of all are astray."""
    told = gain(np.array([0.0]), 6.0)[0]
    assert told == pytest.approx(math.log(0.2))
    with changed("stacks.astray", 0.01):
        assert gain(np.array([0.0]), 6.0)[0] < told


def test_tracks_of_one_plane_are_told_by_where_they_meet() -> None:
    """Behind a bend of the street offsets differ, though one follows the other."""
    u = np.arange(0.0, 40.0)
    lines = [
        np.column_stack([u, 0.05 * u, 8 + 0 * u]),
        np.column_stack([u, 0.05 * u, 7.6 + 0 * u]),
        np.column_stack([u + 42, 0.05 * (u + 42), 8 + 0 * u]),
        np.column_stack([u, 0.05 * u + 3, 8 + 0 * u]),  # beside them, and alone
    ]
    assert list(planes(lines, 0.2)) == [[0, 1, 2]]


@pytest.mark.parametrize(("c", "found"), [(C, True), (2000.0, False)])
def test_wires_that_hardly_sag_are_followed_one_by_one(c: float, found: bool) -> None:
    """As the subconductors of a bundle: cut into spans that are none, they were."""
    made = street(0.35, 4, c=c)
    corridor = corridor_of(points_of(made))
    pieces = pieces_of(list(itertools.chain.from_iterable(made)))
    arcs, alignments = stacks_among(corridor, pieces, QUIET)
    assert bool(arcs) == found
    if found:
        cuts = alignments[0].places(alignments[0].cuts)[:, 0]
        assert all(np.abs(cuts - pole).min() < 1.0 for pole in POLES[1:-1])
        assert {arc.arc[1] for arc in arcs} == set(range(len(POLES) - 1))


def test_wires_nearer_than_points_can_tell_are_no_stack() -> None:
    """A bundle of two 0.4 m above each other was three wires 0.2 m apart."""
    xyz = points_of(street(0.2, 3, per_metre=1.0))
    corridor = corridor_of(xyz)
    axis = Alignment.of([Piece(np.arange(len(xyz)), wire((0, 0, 8), (135, 0, 8), C)[0])])
    track = axis.track(corridor.wires.xyz)
    assert stack_in(corridor, axis, track) is None
    with changed("stacks.closest", 0.15):
        assert stack_in(corridor, axis, track) is not None


def test_a_stack_is_found_whatever_hills_its_street_crosses() -> None:
    """A curve along all spans was fitted as if one wire hung there, and in hills there is none."""
    poles, heights = np.arange(0.0, 300.0, 36.0), (7.0, 6.0, 16.0, 13.0, 9.0, 15.0, 9.0, 11.0, 11.0)
    spans = list(itertools.pairwise(zip(poles, heights, strict=True)))
    made = [
        wire((a, 0, y - 0.35 * k), (b, 0, z - 0.35 * k), C, 0.3, seed=n)
        for k in range(4)
        for n, ((a, y), (b, z)) in enumerate(spans)
    ]
    corridor = corridor_of(np.vstack([points for _, points in made]))
    arcs, alignments = stacks_among(corridor, pieces_of(made), QUIET)
    assert len(arcs) == 4 * (len(alignments[0].cuts) + 1), "all wires in all spans"
    cuts, sigmas = alignments[0].places(alignments[0].cuts)[:, 0], alignments[0].sigmas
    assert len(cuts) == len(poles) - 3, "at the pole between 13 and 15 m no wire bends"
    away = np.abs(cuts[:, None] - poles).min(axis=1)
    assert (away < 2 * sigmas).all()


@pytest.mark.parametrize("known", [(0,), (0, 7), (3,)])
def test_a_stack_goes_on_where_no_track_is_known(known: tuple[int, ...]) -> None:
    """Each of two parts of one stack ended 60 m beyond its tracks, in the middle of a span."""
    poles = np.arange(0.0, 300.0, 36.0)
    made = [
        [wire((a, 0, 8 - 0.35 * k), (b, 0, 8 - 0.35 * k), C, 0.3, seed=8 * k + n) for k in range(4)]
        for n, (a, b) in enumerate(itertools.pairwise(poles.tolist()))
    ]
    pieces = pieces_of(list(itertools.chain.from_iterable(made)))
    corridor = corridor_of(points_of(made))  # type: ignore[arg-type]
    tracks = [piece for n in known for piece in pieces[4 * n : 4 * n + 4]]
    arcs, alignments = stacks_among(corridor, tracks, QUIET)
    assert len(alignments) == 1
    cuts = alignments[0].places(alignments[0].cuts)[:, 0]
    assert np.abs(np.sort(cuts) - poles[1:-1]).max() < 1.0
    assert len(arcs) == 4 * (len(poles) - 1)


def test_a_street_with_a_line_on_each_side_is_found() -> None:
    """Wires that changed over were in spans of the other line: 12 of 23 poles were found."""
    made = SamplesScene(kind="corridor", preset="street_both", seed=301).run()
    truth = made.points["classification"]
    found = CorridorExtract(points=unlabelled(made.points)).run()
    on_wire = found.classified["classification"] == 14
    assert np.mean(on_wire[truth == 14]) > 0.9
    assert np.mean(truth[on_wire] == 14) > 0.98
    assert abs(found.tower_count - np.count_nonzero(made.features.frame.kind == "tower")) <= 2
