"""How conductors are arranged at the top of a support, and subconductors in a bundle."""

from __future__ import annotations

from dataclasses import dataclass

from algorithms.samples._survey import GUARD, WIRE


@dataclass(frozen=True)
class Conductor:
    """One phase or one guard wire.

    Attributes
    ----------
    aside : to the left of the axis of the support, metres
    below : the top of the support, metres
    until : share of the line at which it ends
    """

    aside: float
    below: float
    cls: int = WIRE
    until: float = 1.0


Head = tuple[Conductor, ...]
Bundle = tuple[tuple[float, float], ...]
"""Subconductors: aside and up from the middle, metres."""


def phases(*places: tuple[float, float], until: float = 1.0) -> Head:
    """Conductors at places (aside, below), metres."""
    return tuple(Conductor(aside, below, until=until) for aside, below in places)


def both_sides(*places: tuple[float, float]) -> Head:
    """Conductors at places (aside, below) and as far on the other side."""
    return phases(*((side * aside, below) for aside, below in places for side in (-1, 1)))


def earth(*places: tuple[float, float]) -> Head:
    """Guard wires at places (aside, below), metres."""
    return tuple(Conductor(aside, below, GUARD) for aside, below in places)


SINGLE: Bundle = ((0.0, 0.0),)


def pair(gap: float) -> Bundle:
    """Two subconductors side by side."""
    return ((-gap / 2, 0.0), (gap / 2, 0.0))


def upright(gap: float) -> Bundle:
    """Two subconductors above each other."""
    return ((0.0, -gap / 2), (0.0, gap / 2))


def triangle(gap: float) -> Bundle:
    """Two subconductors above, one below."""
    return ((-gap / 2, 0.289 * gap), (gap / 2, 0.289 * gap), (0.0, -0.577 * gap))


def square(gap: float) -> Bundle:
    """Two above two."""
    return tuple((a * gap / 2, b * gap / 2) for a in (-1, 1) for b in (-1, 1))


# --- heads that lines have, as (aside, below the top), metres ------------------------------

FLAT_ARM = phases((-1.1, 0.15), (-0.35, 0.15), (1.1, 0.15))
POLE_TRIANGLE = phases((0.0, 0.0), (-0.9, 0.8), (0.9, 0.8))
TWO_ON_AN_ARM = phases((-0.6, 0.1), (0.6, 0.1))
ONE_WIRE = phases((0.0, 0.0))
ABOVE_EACH_OTHER = phases((0.2, 0.3), (0.2, 0.65), (0.2, 1.0), (0.2, 1.35))
H_FLAT = phases((-4.5, 1.5), (0.0, 1.5), (4.5, 1.5)) + earth((-2.25, 0.0), (2.25, 0.0))
WIDE_FLAT = phases((-8.5, 3.0), (0.0, 3.0), (8.5, 3.0)) + earth((-4.7, 0.0), (4.7, 0.0))
BARE_FLAT = phases((-4.0, 0.5), (0.0, 0.5), (4.0, 0.5))
DELTA = phases((-6.0, 5.0), (0.0, 2.5), (6.0, 5.0)) + earth((-3.5, 0.0), (3.5, 0.0))
LATTICE_TRIANGLE = phases((-3.2, 3.5), (3.6, 5.5), (-4.2, 7.5)) + earth((0.0, 0.0))
BARREL = both_sides((3.4, 4.0), (4.8, 8.0), (3.8, 12.0)) + earth((0.0, 0.0))
BIG_BARREL = both_sides((6.5, 7.0), (9.0, 16.0), (7.2, 25.0)) + earth((0.0, 0.0))
DANUBE = both_sides((6.0, 6.0), (4.5, 13.0), (9.0, 13.0)) + earth((0.0, 0.0))
ONE_LEVEL = both_sides((4.0, 4.5), (7.5, 4.5), (11.0, 4.5)) + earth((0.0, 0.0))
DAVIT = phases((2.6, 3.0), (2.9, 6.5), (2.6, 10.0)) + earth((0.0, 0.0))
DOUBLE_DAVIT = both_sides((2.8, 3.5), (3.2, 7.0), (2.8, 10.5)) + earth((0.0, 0.0))
POST_DELTA = phases((1.2, 1.5), (-1.2, 3.0), (1.2, 4.5)) + earth((0.0, 0.0))
FOUR_CIRCUITS = both_sides(
    (8.0, 7.0), (6.0, 15.0), (11.5, 15.0), (4.5, 23.0), (8.5, 23.0), (12.5, 23.0)
) + earth((0.0, 0.0))
EIGHT_CIRCUITS = both_sides(
    *((5.0, 8.0), (9.5, 8.0), (5.0, 16.0), (10.0, 16.0), (15.0, 16.0)),
    *((5.0, 24.5), (10.0, 24.5), (15.0, 24.5), (4.5, 32.0), (8.5, 32.0)),
    *((4.5, 37.0), (8.5, 37.0)),
) + earth((-2.5, 0.0), (2.5, 0.0))
HALF_LEAVES = (
    phases((-3.4, 4.0), (-4.8, 8.0), (-3.8, 12.0))
    + phases((3.4, 4.0), (4.8, 8.0), (3.8, 12.0), until=0.5)
    + earth((0.0, 0.0))
)
