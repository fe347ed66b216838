"""Wires of which a few points tell, and as few points that are no wires."""

from __future__ import annotations

import numpy as np
import pytest
from scenes.corridors import Floats, cloud, ground, pole, tree, wire
from scipy.spatial import cKDTree

from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._curves.sparse import groups, in_sheets, lonely
from algorithms.corridor._curves.trace import Airborne
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
