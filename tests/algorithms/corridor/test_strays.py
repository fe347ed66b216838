"""What is of a line although it is far from its wires, or beyond its arms; trees are not."""

from __future__ import annotations

import numpy as np
import pytest
from scenes.corridors import CORNER, bar, in_hills, tree

from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._curves.trace import Airborne
from algorithms.corridor._extraction.spans import Wire
from algorithms.corridor._extraction.strays import strays_of
from algorithms.corridor._extraction.supports import Support
from algorithms.corridor._extraction.towers import tower_of, with_overhang
from algorithms.corridor.clearance import CorridorClearance
from algorithms.corridor.extract import CorridorExtract

WIRE = Wire(Catenary(0.0, 0.0, 1.0, 0.0, 100.0, 20.0, 20.0, 1e-6), (0, 1), (0.0, 100.0), 0.625)
PAIR = ((0.0, 0.0), (0.45, 0.0))


def corridor_of(points: object) -> Corridor:
    """Points in the air over flat ground, in the order of the corridor."""
    air = Airborne.of(np.array(points, float))
    may = np.ones(len(air.xyz), bool)
    return Corridor(air, air.xyz[:, 2], may, 0.625, lambda x, y: 0.0, lambda x, y: True)


@pytest.mark.parametrize(
    ("points", "of_wire"),
    [
        ([(50, 0, 20.9)], 1),
        ([(50, 0.1, 19.1), (51, 0, 20.9)], 2),
        ([(50, 0, 19.2), (51, 0, 19.3), (52, 0, 19.1)], 0),
        ([(50, 0, 19.2), (50, 0, 17.7)], 0),
        ([(50, 0, 19.2), (50, 0, 17.1)], 1),
        ([(50, 0, 18.7)], 0),
    ],
    ids=["above", "two", "three are something", "held from below", "by itself", "too far"],
)
def test_what_is_alone_beside_a_wire_is_of_it(points: list[object], of_wire: int) -> None:
    corridor = corridor_of(points)
    found = strays_of(corridor, [WIRE], np.zeros(len(points), bool))
    assert np.count_nonzero(found == 0) == of_wire


def test_points_of_the_line_hold_nothing() -> None:
    corridor = corridor_of([(50, 0, 19.2), (50, 0, 18.3)])
    found = strays_of(corridor, [WIRE], corridor.air.xyz[:, 2] < 19)
    assert found.max() == 0


def test_strays_of_two_wires_are_counted_apart() -> None:
    beside = Wire(Catenary(0.0, 0.5, 1.0, 0.0, 100.0, 20.0, 20.0, 1e-6), (0, 1), (0, 100), 0.625)
    points = [(50, 0, 20.8), (51, 0, 20.8), (50.5, 0.5, 20.8), (51.5, 0.5, 20.8)]
    found = strays_of(corridor_of(points), [WIRE, beside], np.zeros(4, bool))
    assert sorted(found.tolist()) == [0, 0, 1, 1]


def at_tower(*more: object, lowest: float = 30.0) -> tuple[int, int]:
    """Points of a lattice tower at x = 50 by its arms alone, and with what hangs on to them."""
    legs = [bar((50 + i, j, 0), (50 + i, j, 32), 4, 0.02) for i in (-2, 2) for j in (-2, 2)]
    arms = bar((50, -13, 31), (50, 13, 31), 10, 0.05)
    corridor = corridor_of(np.vstack([*legs, arms, *more]))
    support = Support(50.0, 0.0, (0.0, 1.0), (-13.0, 13.0), lowest, 30.0, 0.0, 0.9)
    tower = tower_of(corridor, support)
    return len(tower.points), len(with_overhang(corridor, tower).points)


def test_peaks_beyond_the_arms_are_of_the_tower() -> None:
    before, after = at_tower(bar((50, 13, 31), (50, 19, 34), 3, 0.0))
    assert after - before >= 6


def test_a_tree_that_reaches_up_beside_the_arms_is_not_of_the_tower() -> None:
    rng = np.random.default_rng(0)
    crown = rng.uniform((48, 16.7, 5), (52, 19, 33), (600, 3))
    before, after = at_tower(crown)
    assert after == before


def test_a_crown_above_the_lowest_wire_is_not_of_the_tower() -> None:
    """Of a line whose lowest wires hang far below its arms."""
    crown = np.random.default_rng(0).uniform((48, 14.2, 10), (52, 19, 29), (2000, 3))
    before, after = at_tower(crown, lowest=9.0)
    assert after == before


def test_a_tree_that_reaches_into_noisy_wires_is_still_too_close() -> None:
    """As if the class of plants were known for it, as in files that have it."""
    free = in_hills(PAIR, 0.18, 2.0, 0.0)
    wires = free.xyz[free["truth"] == 14] - CORNER
    low = wires[np.abs(wires[:, 0] - 200) < 5, 2].min()
    parts = [tree(200, y, low + 0.6, 3.0, 300, seed=int(y) + 20) for y in (-13, 0, 13)]
    points = in_hills(PAIR, 0.18, 2.0, 0.0, beside=parts)
    leaves = np.arange(len(points)) >= len(points) - 900
    result = CorridorExtract(points=points).run()
    said = result.classified["classification"]
    said = np.where(leaves & (said == 1), 5, np.where(points["truth"] == 2, 2, said))
    classified = result.classified.with_attributes({"classification": said.astype(np.uint8)})
    objects = CorridorClearance(
        points=classified, wires=result.wires, towers=result.towers, distance=2.0, falling=False
    ).run()
    close = objects.objects.frame[objects.objects.frame["kind"] == "tree"]
    assert len(close) == 3
    assert (close["clearance"] < 1.0).all()
    assert (said[leaves] == 5).mean() > 0.95
