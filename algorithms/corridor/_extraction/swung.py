"""Conductors that wind swung between two flights, so that the points show them in two positions.

Wind turns a conductor about the line between its ends: these stay, and so does how far it hangs in
its own plane. Two conductors that meet at both ends, as cables at one bolt, hang by different
lengths or they would touch, and those of a bundle are as far apart at their ends as in the middle.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._extraction.spans import Wire, apart_wires, end_at, on_wire
from algorithms.corridor._settings import SETTINGS
from algorithms.shared.kernels.sorting import distinct
from toolbox.context import log


def seen_twice(corridor: Corridor, wires: Sequence[Wire]) -> list[tuple[int, int]]:
    """Pairs of wires that are one conductor in two positions; the nearest at their ends first.

    Where strips are known, most points of both wires are of different ones.
    """
    return in_two_positions(wires, [strip_of(corridor, wire) for wire in wires])


def in_two_positions(wires: Sequence[Wire], strip: Sequence[int]) -> list[tuple[int, int]]:
    """Pairs of wires, each of a strip, that are one conductor, as each strip shows it once.

    Where some of a span were seen twice the others were, too, though few points may not tell how
    they hang: those are pairs that end at the same places, or that are left where each strip shows
    as many.
    """
    found: list[tuple[int, int]] = []
    met: set[tuple[int, int]] = set()

    def pair(candidates: Iterable[tuple[float, int, int]]) -> None:
        for _, a, b in sorted(candidates):
            sides = {(a, strip[b]), (b, strip[a])}
            if (strip[a] != strip[b] or not strip[a]) and not sides & met:
                found.append((a, b))
                met.update(sides)

    pair(swings(wires))
    swung = {wires[a].span for a, _ in found}
    twice = swung & shown_alike(wires, strip)
    pair(
        (away, a, b)
        for away, a, b in beside(wires)
        if wires[a].span in twice
        or (wires[a].span in swung and away < SETTINGS.continued.same_wire)
    )
    return found


def shown_alike(wires: Sequence[Wire], strip: Sequence[int]) -> set[int]:
    """Spans of which two strips or more show as many wires each."""
    shown: dict[int, Counter[int]] = {}
    for wire, number in zip(wires, strip, strict=True):
        shown.setdefault(wire.span, Counter())[number] += 1
    return {span for span, own in shown.items() if len(own) > 1 == len({*own.values()})}


def strip_of(corridor: Corridor, wire: Wire) -> int:
    """The strip of most points on a wire; 0 where it is not known."""
    return int(np.bincount(corridor.strip[on_wire(corridor, wire)[0]], minlength=1).argmax())


def strips_disagree(corridor: Corridor, wires: Sequence[Wire]) -> bool:
    """Whether wind moved any conductor between strips, by the points of each on every wire.

    Conductors close to each other are mixed then: those of one strip lie where others of the next
    strip do, and wires were followed from one to the other. One strip cannot disagree.
    """
    if len(distinct(corridor.strip)) < 2:
        return False
    seen = [one for wire in wires for one in positions(corridor, wire)]
    return bool(in_two_positions([one for one, _ in seen], [number for _, number in seen]))


def positions(corridor: Corridor, wire: Wire) -> Iterator[tuple[Wire, int]]:
    """A wire as each strip shows it, with the number of the strip."""
    near = on_wire(corridor, wire)[0]
    for number in distinct(corridor.strip[near]).tolist():
        own = near[corridor.strip[near] == number]
        curve = fit(corridor.air.xyz[own], spread=corridor.own_radius)
        if curve is not None:
            ends = curve.along(wire.curve.ends)[0]
            held = wire.supports if ends[0] < ends[1] else wire.supports[::-1]
            yield replace(wire, curve=curve.between(ends.min(), ends.max()), supports=held), number


def swings(wires: Sequence[Wire]) -> Iterator[tuple[float, int, int]]:
    """Pairs of wires of one span of which one may be the other, turned about its ends.

    With them comes how far apart they are at supports, metres. Strings swing with their conductor,
    so its ends move, but by less than half as much as wind moves its middle against them. The
    lengths by which both hang differ by less than that, too: by the temperature, and their errors.
    """
    for ends, a, b in beside(wires):
        hangs = hang(wires[a].curve), hang(wires[b].curve)
        longer = abs(float(np.linalg.norm(hangs[0]) - np.linalg.norm(hangs[1])))
        if 2 * max(ends, longer) < np.linalg.norm(hangs[0] - hangs[1]):
            yield ends, a, b


def beside(wires: Sequence[Wire]) -> Iterator[tuple[float, int, int]]:
    """Pairs of wires of one span, and how far apart they are at the supports of both, metres."""
    for a, b in itertools.combinations(range(len(wires)), 2):
        one, other = wires[a], wires[b]
        held = [n for n in one.supports if n >= 0 and n in other.supports]
        if one.span == other.span and held:
            yield max(float(np.linalg.norm(end_at(one, n) - end_at(other, n))) for n in held), a, b


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
            "them between flights; each counts once, which is not sure where they hang close "
            "together, and clearances and sags hold for each position as it was seen",
            ", ".join(str(span) for span in sorted({span for span, _ in apart})),
            max(away for _, away in apart),
        )
