"""Conductors that wind swung between two flights, so that the points show them in two positions.

Wind turns a conductor about the line between its ends: these stay, and so does how far it hangs in
its own plane. Two conductors that meet at both ends, as cables at one bolt, hang by different
lengths or they would touch, and those of a bundle are as far apart at their ends as in the middle.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._extraction.spans import (
    Wire,
    apart_wires,
    end_at,
    nearest_wires,
    on_wire,
)
from algorithms.corridor._settings import SETTINGS
from algorithms.shared.kernels.sorting import distinct
from toolbox.context import log

Floats = NDArray[np.float64]


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


# --- positions so near that they were followed as one ----------------------------------------


def parted(
    corridor: Corridor, wires: Sequence[Wire], strip: Sequence[int]
) -> tuple[list[Wire], list[int]]:
    """Wires, each in every position in which strips show it, and the strip of each.

    Parameters
    ----------
    strip : of each wire, that of most of its points
    """
    if len(distinct(corridor.strip)) < 2:
        return list(wires), list(strip)
    twice = {k for pair in in_two_positions(wires, strip) for k in pair}
    found: dict[int, list[tuple[Wire, int]]] = {
        k: [(wire, strip[k])] for k, wire in enumerate(wires)
    }
    nearest, _ = nearest_wires(corridor, wires)
    sights = [
        Sighted.of(corridor, wire, np.flatnonzero(nearest == k)) for k, wire in enumerate(wires)
    ]
    for span in {wire.span for wire in wires}:
        own = [k for k, wire in enumerate(wires) if wire.span == span and k not in twice]
        if own and (shape := Swung.of([sights[k] for k in own])) is not None:
            found |= {own[n]: positions for n, positions in shape.parted().items()}
    both = [one for k in range(len(wires)) for one in found[k]]
    return [wire for wire, _ in both], [number for _, number in both]


@dataclass(frozen=True)
class Sighted:
    """A wire, and its points.

    Attributes
    ----------
    xyz : array of shape (n, 3)
    strip : of each point, array of shape (n,)
    along, aside : of each point, metres along its axis, and to the left of it
    hang : of the wire there, below the line between its ends, metres
    """

    wire: Wire
    xyz: Floats
    strip: NDArray[np.uint16]
    along: Floats
    aside: Floats
    hang: Floats

    @classmethod
    def of(cls, corridor: Corridor, wire: Wire, points: NDArray[np.int64]) -> Sighted:
        """A wire with its points, indices of those in the air."""
        curve, xyz = wire.curve, corridor.air.xyz[points]
        u, v = curve.along(xyz)
        chord = curve.z_start + (curve.z_end - curve.z_start) * u / curve.length
        return cls(wire, xyz, corridor.strip[points], u, v, chord - curve.height(u))


@dataclass(frozen=True)
class Swung:
    """How the wires of a span hang in each of some strips, or groups of strips with one wind.

    Wind swings all wires of a span by about as much more in one strip than in another, and a strip
    may lie aside of others. Each wire has a line in plan, and a swing of its own besides.

    Attributes
    ----------
    sights : the wires
    groups : numbers of strips
    lines : of each wire: offset at its start and rise of it along its axis, and swing, in the first
        group, array of shape (m, 3)
    shift, swing : of each group against the first, metres, and the tangent of the angle by which it
        lifts wires further to the left of the first wire
    variance : of differences of swings, array of shape (g, g)
    scatter : of points aside of their wires, metres
    """

    sights: Sequence[Sighted]
    groups: Sequence[Sequence[int]]
    lines: Floats
    shift: Floats
    swing: Floats
    variance: Floats
    scatter: float

    @classmethod
    def of(cls, sights: Sequence[Sighted]) -> Swung | None:
        """The positions in which strips surely show the wires of a span; None for one position.

        Strips that show few points, or an end of the span alone, are left out: they do not tell.
        """
        strip = np.concatenate([sight.strip for sight in sights])
        parts = [
            facing(one, sights[0]) * (one.along / one.wire.curve.length - 0.5) for one in sights
        ]
        share = np.concatenate(parts)
        groups = [
            [number]
            for number in distinct(strip).tolist()
            if np.count_nonzero(strip == number) >= SETTINGS.curves.fewest_points
            and 8 * np.ptp(share[strip == number]) > SETTINGS.spans.found_eighths
        ]
        deepest = max((float(sight.hang.max(initial=0.0)) for sight in sights), default=0.0)
        while len(groups) > 1:
            shape = cls.fitted(sights, groups)
            order = np.argsort(shape.swing, kind="stable").tolist()
            gaps = [(shape.apart(a, b, deepest), a, b) for a, b in itertools.pairwise(order)]
            least, *nearest = min(gaps)
            if least > SETTINGS.curves.certain_sigmas:
                return shape
            kept, more = sorted(nearest)
            groups[kept] += groups.pop(more)
        return None

    @classmethod
    def fitted(cls, sights: Sequence[Sighted], groups: Sequence[Sequence[int]]) -> Swung:
        """By least squares, from the offsets of the points of these strips."""
        m, g = len(sights), len(groups)
        rows, aside = [], []
        for k, sight in enumerate(sights):
            of_group = np.column_stack([np.isin(sight.strip, group) for group in groups])
            some = np.flatnonzero(of_group.any(axis=1))
            side = facing(sight, sights[0])
            row = np.zeros((len(sight.xyz), 3 * m + 2 * (g - 1)))
            row[:, 3 * k] = 1.0
            row[:, 3 * k + 1] = sight.along
            row[:, 3 * k + 2] = sight.hang
            row[:, 3 * m : 3 * m + g - 1] = side * of_group[:, 1:]
            row[:, 3 * m + g - 1 :] = side * of_group[:, 1:] * sight.hang[:, None]
            rows.append(row[some])
            aside.append(sight.aside[some])
        matrix, offset = np.concatenate(rows), np.concatenate(aside)
        inverse = np.linalg.pinv(matrix.T @ matrix, hermitian=True)
        result = inverse @ (matrix.T @ offset)
        left = float(((offset - matrix @ result) ** 2).sum())
        scatter = math.sqrt(left / max(len(offset) - len(result), 1))
        scatter = max(scatter, SETTINGS.arcs.least_wander)
        shift, swing = (np.append(0.0, part) for part in np.split(result[3 * m :], 2))
        sure = np.zeros((g, g))
        sure[1:, 1:] = scatter**2 * inverse[3 * m + g - 1 :, 3 * m + g - 1 :]
        variance = np.add.outer(np.diag(sure), np.diag(sure)) - 2 * sure
        lines = result[: 3 * m].reshape(m, 3)
        return cls(sights, groups, lines, shift, swing, variance, scatter)

    def apart(self, one: int, other: int, deepest: float) -> float:
        """How far positions of a wire are apart: in the scatter of points, or in what is unsure.

        Parameters
        ----------
        deepest : how far the wire hangs, metres
        """
        swings = abs(float(self.swing[one] - self.swing[other]))
        scatter = max(self.scatter, SETTINGS.arcs.least_scatter)
        unsure = math.sqrt(max(float(self.variance[one, other]), 0.0))
        return min(swings * deepest / scatter, swings / unsure)

    def parted(self) -> dict[int, list[tuple[Wire, int]]]:
        """Wires, by number, in each position that points show, with a strip of each.

        Together they lie nearer to their points, also in height, which had no part in it.
        """
        found = {k: own for k in range(len(self.sights)) if len(own := self._positions(k)) > 1}
        before = after = 0.0
        for k, own in found.items():
            sight = self.sights[k]
            for one, group in own:
                xyz = sight.xyz[np.isin(sight.strip, self.groups[group])]
                before += float((sight.wire.curve.away(xyz) ** 2).sum())
                after += float((one.curve.away(xyz) ** 2).sum())
        if after >= before:
            return {}
        return {k: [(one, self.groups[g][0]) for one, g in own] for k, own in found.items()}

    def _positions(self, number: int) -> list[tuple[Wire, int]]:
        """A wire in each position that points show, and the group of strips; none if it has one."""
        sight = self.sights[number]
        own = [np.isin(sight.strip, group) for group in self.groups]
        shown = [g for g, mine in enumerate(own) if mine.sum() >= SETTINGS.continued.points]
        shown.sort(key=lambda g: float(self.swing[g]))
        deepest = float(sight.hang.max(initial=0.0))
        apart = [self.apart(a, b, deepest) for a, b in itertools.pairwise(shown)]
        if min(apart, default=0.0) <= SETTINGS.curves.certain_sigmas:
            return []
        return [(self._position(number, g, own), g) for g in sorted(shown)]

    def _position(self, number: int, group: int, own: Sequence[NDArray[np.bool_]]) -> Wire:
        """A wire in one of its positions; it hangs as deep in each, and so in their mean.

        Parameters
        ----------
        own : which of its points are of each position, arrays of shape (n,)
        """
        sight, side = self.sights[number], facing(self.sights[number], self.sights[0])
        wire, (v0, v1, swing) = sight.wire, self.lines[number].tolist()
        xyz, upright = sight.xyz[own[group]], 1 / np.sqrt(1 + (swing + side * self.swing) ** 2)
        mean = np.average(upright, weights=[mine.sum() for mine in own])
        curve = replace(
            wire.curve,
            curvature=wire.curve.curvature * float(upright[group] / mean),
            v0=v0 + side * float(self.shift[group]),
            v1=v1,
            swing=swing + side * float(self.swing[group]),
            count=len(xyz),
        )
        rms, covariance = math.sqrt(float((curve.away(xyz) ** 2).mean())), curve.covariance
        if covariance is not None:
            covariance = covariance * (len(sight.xyz) / len(xyz))
        return replace(wire, curve=replace(curve, rms=rms, covariance=covariance))


def facing(one: Sighted, other: Sighted) -> float:
    """Whether the axes of two wires of a span run the same way (1) or not (-1)."""
    a, b = one.wire.curve, other.wire.curve
    return math.copysign(1.0, a.ex * b.ex + a.ey * b.ey)


# --- what is one conductor -------------------------------------------------------------------


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
