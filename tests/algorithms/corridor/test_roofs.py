"""Rows of points on roofs, and edges of these, are told from wires by what is seen below them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes.corridors import Floats, wire

from algorithms.corridor._curves.chance import chance
from algorithms.corridor._curves.network import Corridor, is_on_roof
from algorithms.corridor._curves.trace import Airborne

HEIGHT = 6.0  # metres of the curve above the ground
CURVE, POINTS = wire((0, 0, HEIGHT), (40, 0, HEIGHT), 1500, per_metre=1.0)
BARE = np.zeros((0, 3))


def grid(south: float, north: float, z: float, step: float = 1.0, slope: float = 0.0) -> Floats:
    """Points of a surface along the curve, `step` metres from one to the next."""
    x, y = np.meshgrid(np.arange(-20, 60, step), np.arange(south + step / 2, north, step))
    return np.column_stack([x.ravel(), y.ravel(), z + slope * abs(y).ravel()])


def on_roof(
    air: Floats, floor: Floats, *, tolerance: float = 0.25, step: float = 1.0, land: bool = True
) -> bool:
    points = Airborne.of(np.vstack([POINTS, air]))
    corridor = Corridor(
        points,
        points.xyz[:, 2],
        np.ones(len(points.xyz), bool),
        tolerance,
        lambda x, y: 0.0,
        lambda x, y: land,
        Airborne.of(floor),
        1 / step**2,
    )
    return is_on_roof(corridor, CURVE)


GROUND = grid(-20, 20, 0.0)
SOUTH = GROUND[GROUND[:, 1] < 0]


@pytest.mark.parametrize(
    ("what", "air", "floor", "roof"),
    [
        ("wire", BARE, GROUND, False),
        ("row on a flat roof", grid(-9, 9, HEIGHT - 0.3), BARE, True),
        ("ridge", grid(-9, 9, HEIGHT, slope=-0.8), BARE, True),
        ("eaves with a few points", grid(0, 9, HEIGHT, slope=0.5)[::2], SOUTH, True),
        ("wire over a roof", grid(-9, 9, HEIGHT - 5.5), BARE, False),
        ("wire below the eaves of a house", grid(0, 9, HEIGHT + 6), SOUTH, False),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_below_a_wire_the_beam_goes_on_at_both_sides(
    what: str, air: Floats, floor: Floats, roof: bool
) -> None:
    assert on_roof(air, floor) == roof


def test_the_ground_is_below_a_low_wire_however_far_aside() -> None:
    """At a tolerance of 0.625 m a roof of any slope 2.4 m aside may be 6 m below a curve."""
    assert not on_roof(BARE, grid(-20, 20, 0.0, step=1.5), tolerance=0.625, step=1.5)


def test_where_points_are_few_one_looks_farther_aside() -> None:
    """The rows beside that of the curve are 2.5 m away."""
    rows = grid(-10, 10, HEIGHT - 0.1, step=2.5)
    assert on_roof(rows[abs(rows[:, 1]) > 1.3] + np.array([0, 1.25, 0]), BARE, step=2.5)


@pytest.mark.parametrize("land", [True, False], ids=["roof", "water"])
def test_nothing_is_seen_below_a_line_over_water(land: bool) -> None:
    _, other = wire((0, 1, HEIGHT), (40, 1, HEIGHT), 1500, per_metre=1.0)
    assert on_roof(np.vstack([other, other - np.array([0, 2, 0])]), BARE, land=land) == land


def test_what_lies_farther_from_a_curve_than_its_tolerance_is_around_it() -> None:
    """Else at the larger tolerance hardly anything was: the edge of a balcony was a wire."""
    rng = np.random.default_rng(0)
    turn, away = rng.uniform(0, 2 * math.pi, 400), rng.uniform(0.7, 1.2, 400)
    beside = np.column_stack(
        [rng.uniform(0, 40, 400), away * np.cos(turn), HEIGHT + away * np.sin(turn)]
    )
    air = Airborne.of(np.vstack([POINTS, beside]))
    count = len(air.xyz)
    corridor = Corridor(
        air, air.xyz[:, 2], np.ones(count, bool), 0.625, lambda x, y: 0.0, lambda x, y: True
    )
    assert chance(corridor, CURVE, 0.625, corridor.on([CURVE])) > math.log(0.01)
