"""Towers, masts and poles, drawn as bars in the axes of their foot.

A support is drawn for its head: arms reach as far as the conductors, at their heights. Legs reach
the ground where it is, so that they are unequal on a slope.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from algorithms.samples._corridor.heads import Head
from algorithms.samples._corridor.site import Frame
from algorithms.samples._survey import GUARD, Floats

CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def lattice(frame: Frame, head: Head, height: float) -> None:
    """A square body of four legs with crossed braces, and tapered arms."""
    waist = height - _lowest(head)
    levels, half = _body(height, waist, base=0.08 * height, top=0.35 + 0.008 * height)
    braced(frame, levels, half)
    for aside, h in _tips(head, height):
        _tapered_arm(frame, aside, h, float(np.interp(h, levels, half)))
    _earth_peaks(frame, head, height)


def slim_lattice(frame: Frame, head: Head, height: float) -> None:
    """A narrow lattice mast with single bars for arms, as medium-voltage lines have."""
    levels = np.linspace(0, height, max(4, int(height / 1.5)))
    braced(frame, levels, np.linspace(0.035 * height, 0.15, len(levels)))
    cross_arms(frame, head, height)


def cat_head(frame: Frame, head: Head, height: float) -> None:
    """A waist with two limbs that carry a beam, the middle phase in the window between them."""
    tips = _tips(head, height)
    beam = max(h for _, h in tips)
    reach = max(abs(aside) for aside, _ in tips)
    waist = 0.55 * beam
    levels, half = _body(waist, waist, base=0.09 * height, top=0.9)
    braced(frame, levels, half)
    for side in (-1, 1):
        for v in (-0.7, 0.7):
            knee = frame.at(side * 0.55 * reach, v, 0.9 * beam)
            frame.bar(frame.at(side * 0.9, v, waist), knee, frame.at(side * 0.4 * reach, v, beam))
            frame.bar(frame.at(side * 0.2, v, waist), knee)
        frame.bar(frame.at(side * 0.5 * reach, 0, beam), frame.at(side * 0.55 * reach, 0, height))
    _beam(frame, -reach, reach, beam, deep=1.2)


def tube(frame: Frame, head: Head, height: float) -> None:
    """A steel tube with bare arms."""
    for low, high, radius in ((0, 0.5, 0.4), (0.5, 1, 0.25)):
        frame.bar(frame.at(0, 0, low * height), frame.at(0, 0, high * height), radius=radius)
    for aside, h in _tips(head, height):
        frame.bar(frame.at(0, 0, h - 0.15 * abs(aside)), frame.at(aside, 0, h), radius=0.15)


def pole(frame: Frame, head: Head, height: float) -> None:
    """A pole of wood or concrete with its cross arms."""
    frame.bar(frame.foot(0, 0), frame.at(0, 0, height), radius=0.16)
    cross_arms(frame, head, height)


def a_pole(frame: Frame, head: Head, height: float) -> None:
    """Two poles that lean against each other along the line."""
    for v in (-0.1 * height, 0.1 * height):
        frame.bar(frame.foot(0, v), frame.at(0, 0, height), radius=0.16)
    frame.bar(frame.at(0, -0.06 * height, 0.4 * height), frame.at(0, 0.06 * height, 0.4 * height))
    cross_arms(frame, head, height)


def stayed_pole(frame: Frame, head: Head, height: float) -> None:
    """A pole that a slanting wire holds against the pull of a bend."""
    pole(frame, head, height)
    side = float(frame.site.rng.choice((-1, 1)))
    frame.bar(frame.foot(side * 0.5 * height, 0), frame.at(0, 0, 0.92 * height), radius=0.04)


def h_frame(frame: Frame, head: Head, height: float) -> None:
    """Two poles with a beam on them and a cross between them."""
    tips = _tips(head, height)
    beam = max(h for _, h in tips)
    reach = max(abs(aside) for aside, _ in tips)
    apart = 0.5 * reach
    for side in (-1, 1):
        frame.bar(frame.foot(side * apart, 0), frame.at(side * apart, 0, height), radius=0.18)
        frame.bar(frame.at(side * apart, 0, 0.8 * beam), frame.at(-side * apart, 0, 0.5 * beam))
    frame.bar(frame.at(-reach, 0, beam), frame.at(reach, 0, beam), radius=0.15)


def portal(frame: Frame, head: Head, height: float) -> None:
    """Two lattice columns below a lattice beam."""
    tips = _tips(head, height)
    beam = max(h for _, h in tips)
    reach = max(abs(aside) for aside, _ in tips) + 1.5
    for side in (-1, 1):
        levels = np.linspace(0, height, max(4, int(height / 2)))
        braced(frame, levels, np.linspace(0.9, 0.4, len(levels)), side * reach)
    _beam(frame, -reach, reach, beam, deep=0.8)


def guyed_v(frame: Frame, head: Head, height: float) -> None:
    """Two masts from one foot to the ends of a beam, held by four ropes."""
    tips = _tips(head, height)
    beam = max(h for _, h in tips)
    reach = max(abs(aside) for aside, _ in tips)
    for side in (-1, 1):
        for a, b in CORNERS:
            foot, top = (
                frame.at(0.2 * a, 0.2 * b, 0),
                frame.at(side * 0.6 * reach + a * 0.4, b * 0.4, beam),
            )
            frame.bar(foot, top)
        frame.bar(frame.at(side * 0.6 * reach, 0, beam), frame.at(side * 0.6 * reach, 0, height))
        for v in (-1, 1):
            anchor = frame.foot(side * 0.5 * height, v * 0.35 * height)
            frame.bar(anchor, frame.at(side * 0.6 * reach, 0, beam), radius=0.03)
    _beam(frame, -reach, reach, beam, deep=0.8)


def guyed_mast(frame: Frame, head: Head, height: float) -> None:
    """One slender lattice mast, held by four ropes."""
    levels = np.linspace(0, height, max(4, int(height / 2)))
    braced(frame, levels, np.full(len(levels), 0.3))
    cross_arms(frame, head, height)
    for u, v in CORNERS:
        anchor = frame.foot(u * 0.35 * height, v * 0.35 * height)
        frame.bar(anchor, frame.at(0, 0, 0.85 * height), radius=0.03)


SUPPORTS: dict[str, Callable[[Frame, Head, float], None]] = {
    one.__name__: one
    for one in (
        lattice,
        slim_lattice,
        cat_head,
        tube,
        pole,
        a_pole,
        stayed_pole,
        h_frame,
        portal,
        guyed_v,
        guyed_mast,
    )
}


def _tips(head: Head, height: float) -> list[tuple[float, float]]:
    """Outermost conductors of each side and height: aside, and above the foot."""
    outer: dict[tuple[float, float], float] = {}
    for conductor in head:
        if conductor.cls != GUARD:
            key = (np.sign(conductor.aside), conductor.below)
            outer[key] = max(outer.get(key, 0.0), abs(conductor.aside))
    return [(side * reach, height - below) for (side, below), reach in outer.items()]


def _lowest(head: Head) -> float:
    return max(conductor.below for conductor in head)


def _body(height: float, waist: float, base: float, top: float) -> tuple[Floats, Floats]:
    """Levels of the braces, and half the width of the body there."""
    levels = np.unique(
        np.concatenate(
            [
                np.linspace(0, waist, max(3, round(waist / 5)) + 1),
                np.linspace(waist, height, max(2, round((height - waist) / 3)) + 1),
            ]
        )
    )
    return levels, np.interp(levels, (0, waist, height), (base, max(0.3 * base, top), top))


def braced(frame: Frame, levels: Floats, half: Floats, aside: float = 0.0) -> None:
    """Four legs with crossed braces between the levels, each leg down to the ground."""
    rings = [
        [frame.at(aside + w * u, w * v, h) for h, w in zip(levels, half, strict=True)]
        for u, v in CORNERS
    ]
    for i, here in enumerate(rings):
        there = rings[(i + 1) % 4]
        u, v = CORNERS[i]
        frame.bar(frame.foot(aside + half[0] * u, half[0] * v), *here)
        for k in range(len(levels) - 1):
            frame.bar(here[k], there[k + 1])
            frame.bar(there[k], here[k + 1])


def _tapered_arm(frame: Frame, aside: float, h: float, half: float) -> None:
    """Four bars from the body to the tip of an arm."""
    side = np.sign(aside)
    for v in (-half, half):
        for rise in (0.0, min(2.2, 0.25 * abs(aside) + 0.6)):
            frame.bar(frame.at(side * half, v, h + rise), frame.at(aside, 0, h))


def _earth_peaks(frame: Frame, head: Head, height: float) -> None:
    """Bars from the top of the body to guard wires beside it."""
    for conductor in head:
        if conductor.cls == GUARD and abs(conductor.aside) > 1:
            tip = frame.at(conductor.aside, 0, height - conductor.below)
            for v in (-0.4, 0.4):
                frame.bar(frame.at(0, v, height - conductor.below - 1.5), tip)


def cross_arms(frame: Frame, head: Head, height: float) -> None:
    """Arms of a pole: one bar at each height, from the farthest conductor to the farthest."""
    for h, left, right in _rows(head, height):
        if right - left > 0.3:
            frame.bar(frame.at(left, 0, h), frame.at(right, 0, h), radius=0.1)


def _rows(head: Head, height: float) -> Iterator[tuple[float, float, float]]:
    """Heights of conductors above the foot, and what they reach from and to, the pole included."""
    for below in sorted({conductor.below for conductor in head}):
        row = [conductor.aside for conductor in head if conductor.below == below]
        yield height - below, min(0.0, *row), max(0.0, *row)


def _beam(frame: Frame, left: float, right: float, h: float, deep: float) -> None:
    """A lattice beam square to the line: four chords with zigzag bars between them."""
    count = max(2, round((right - left) / 2.5))
    u = np.linspace(left, right, count + 1)
    for v in (-deep / 2, deep / 2):
        frame.bar(frame.at(left, v, h), frame.at(right, v, h))
        frame.bar(frame.at(left, v, h + deep), frame.at(right, v, h + deep))
        zigzag = [frame.at(x, v, h + deep * (k % 2)) for k, x in enumerate(u)]
        frame.bar(*zigzag)
