"""Conductors that wind swung between two flights, so that the points show them in two positions.

Wind turns a conductor about the line between its ends: these stay, and so does how far it hangs in
its own plane. Two conductors that meet at both ends, as cables at one bolt, hang by different
lengths or they would touch, and those of a bundle are as far apart at their ends as in the middle.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._extraction.spans import Wire, apart_wires, end_at, on_wire
from toolbox.context import log


def seen_twice(corridor: Corridor, wires: Sequence[Wire]) -> list[tuple[int, int]]:
    """Pairs of wires that are one conductor in two positions; the nearest at their ends first.

    Each strip shows a conductor in one position. Where strips are known, most points of both wires
    are of different ones.
    """
    strip = [strip_of(corridor, wire) for wire in wires]
    found: list[tuple[int, int]] = []
    met: set[tuple[int, int]] = set()
    for _, a, b in sorted(swings(wires)):
        sides = {(a, strip[b]), (b, strip[a])}
        if (strip[a] != strip[b] or not strip[a]) and not sides & met:
            found.append((a, b))
            met |= sides
    return found


def strip_of(corridor: Corridor, wire: Wire) -> int:
    """The strip of most points on a wire; 0 where it is not known."""
    return int(np.bincount(corridor.strip[on_wire(corridor, wire)[0]], minlength=1).argmax())


def swings(wires: Sequence[Wire]) -> Iterator[tuple[float, int, int]]:
    """Pairs of wires of one span of which one may be the other, turned about its ends.

    With them comes how far apart they are at supports, metres. Strings swing with their conductor,
    so its ends move, but by less than half as much as wind moves its middle against them. The
    lengths by which both hang differ by less than that, too: by the temperature, and their errors.
    """
    for a, b in itertools.combinations(range(len(wires)), 2):
        one, other = wires[a], wires[b]
        held = [n for n in one.supports if n >= 0 and n in other.supports]
        if one.span != other.span or not held:
            continue
        ends = max(float(np.linalg.norm(end_at(one, n) - end_at(other, n))) for n in held)
        hangs = hang(one.curve), hang(other.curve)
        longer = abs(float(np.linalg.norm(hangs[0]) - np.linalg.norm(hangs[1])))
        if 2 * max(ends, longer) < np.linalg.norm(hangs[0] - hangs[1]):
            yield ends, a, b


def hang(curve: Catenary) -> NDArray[np.float64]:
    """From the middle of the chord of a curve to the middle of the curve, metres."""
    middle = curve.points(np.array([0.5 * curve.length]))[0]
    return np.asarray(middle - curve.ends.mean(axis=0))


def warn_of_swung(wires: Sequence[Wire]) -> None:
    """Log which spans have conductors in two positions, and how far wind moved them."""
    apart = [
        (wires[a].span, apart_wires(wires[a].curve, wires[b].curve))
        for _, a, b in swings(wires)
        if wires[a].wire == wires[b].wire
    ]
    if apart:
        log.warning(
            "span %s: conductors were seen in two positions, up to %.1f m apart, as wind swung "
            "them between flights; each counts once, and clearances and sags hold for each "
            "position as it was seen",
            ", ".join(str(span) for span in sorted({span for span, _ in apart})),
            max(away for _, away in apart),
        )
