"""What hangs as wires do and is no line tells of more that is none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes.corridors import Floats, wire

from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._curves.network import Corridor, Piece
from algorithms.corridor._curves.structures import holds_level, in_mesh
from algorithms.corridor._curves.trace import Airborne
from algorithms.corridor._extraction import follow as following
from algorithms.corridor._extraction.follow import (
    Line,
    follow,
    without_contact_lines,
    without_structures,
)
from algorithms.corridor._extraction.spans import Wire
from toolbox.context import QUIET


def corridor_of(points: Floats) -> Corridor:
    """Points that all may be wire, 6 m above the ground."""
    air = Airborne.of(points)
    count = len(air.xyz)
    yes = np.ones(count, bool)
    return Corridor(air, np.full(count, 6.0), yes, 0.25, lambda x, y: 0.0, lambda x, y: True)


def test_rows_of_a_mesh_tell_of_those_beside_them() -> None:
    """Of four rows 10 m apart the first is tied; the next is 40 m from the last of these."""
    sides = (0.0, 10.0, 20.0, 60.0)
    made = [wire((0, y, 6), (40, y, 6), 400, per_metre=1.0) for y in (-10.0, *sides)]
    corridor = corridor_of(np.vstack([points for _, points in made]))
    corridor.tied.append(made[0][0])
    lines = [Line([Wire(curve, (-1, -1), (0.0, 40.0), 0.25)], []) for curve, _ in made[1:]]
    assert without_structures(corridor, lines) == lines[-1:]
    assert [curve.y for curve in corridor.left_out] == [0.0, 10.0, 20.0]


@pytest.mark.parametrize("place", [0.5, 20.0])
def test_an_arm_that_wires_end_at_is_no_row_of_a_mesh(place: float) -> None:
    """At the last tower of a line its arms were followed, and all its wires were left out."""
    rows = [wire((0, y, 6), (40, y, 6), 4000)[0] for y in range(0, 24, 4)]
    arms = [wire((x, -2, 6), (x, 22, 6), 5000)[0] for x in (place, place + 1.0)]
    tied = in_mesh([*arms, *rows], [])
    assert tied == [place == 20.0] * (len(arms) + len(rows))


def test_points_of_contact_lines_are_no_wires_above_each_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[int] = []

    def refusing(corridor: Corridor, *_: Any) -> list[Any]:
        corridor.refused[: len(corridor.refused) // 2] = True
        return []

    def above(corridor: Corridor, _: Any) -> list[Any]:
        seen.append(len(corridor.wires.xyz))
        return []

    monkeypatch.setattr(following, "followed", refusing)
    monkeypatch.setattr(following, "stacked_wires", above)
    points = wire((0, 0, 6), (40, 0, 6), 400, per_metre=1.0)[1]
    corridor = corridor_of(points)
    follow(corridor, np.arange(len(points)), 30.0, (0.25, 0.625), QUIET)
    assert seen == [len(points) - len(points) // 2]


def test_what_goes_on_along_a_contact_line_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first of four is seen to be one, the next two overlap by 40 %, the last is beside it."""
    places = ((0.0, 40.0, 0.0), (24.0, 64.0, 0.0), (48.0, 88.0, 0.0), (24.0, 64.0, 10.0))
    made = [wire((a, y, 6), (b, y, 6), 4000, per_metre=2.0) for a, b, y in places]
    count = [len(points) for _, points in made]
    ends = np.cumsum([0, *count])
    corridor = corridor_of(np.vstack([points for _, points in made]))
    row = np.argsort(corridor.air.order)  # of each of the points in the order of the corridor
    pieces = [
        Piece(np.sort(row[low:high]), curve)
        for (curve, _), low, high in zip(made, ends, ends[1:], strict=False)
    ]

    def is_first(air: Airborne, height: Floats, curve: Catenary) -> bool:
        return curve is made[0][0]

    monkeypatch.setattr(following, "holds_level", is_first)
    assert without_contact_lines(corridor, pieces) == pieces[-1:]
    assert not corridor.refused[pieces[-1].points].any()
    assert len(corridor.left_out) == 3


@pytest.mark.parametrize("between", [0, 1, 2])
def test_between_a_contact_wire_and_what_it_hangs_from_is_no_other_wire(between: int) -> None:
    """Points of wires above each other, of which the lowest seems straight."""
    upper, points = wire((0, 0, 7.5), (60, 0, 7.5), 500, per_metre=1.5)
    _, level = wire((0, 0, 6), (60, 0, 6), 4000, per_metre=1.5)
    heights = np.linspace(6, 7.5, between + 2)[1:-1]
    others = [wire((0, 0, z), (60, 0, z), 900, per_metre=1.5)[1] for z in heights]
    air = Airborne.of(np.vstack([points, level, *others]))
    held = holds_level(air, np.full(len(air.xyz), 6.0), upper)
    assert held == (between == 0)
