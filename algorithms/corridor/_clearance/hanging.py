"""Points in mid-air on a wire or a tower, or by themselves, which may be no plants.

Files often give points of wires and towers the class of vegetation. What a tree is holds on to the
ground, or to other points of plants; what hangs free, with empty air below, is rather a part of the
line that was not recognised. Nobody can be sure, so it is told apart and neither a tree nor gone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.corridor._clearance.distances import (
    TAKES_NO_PART,
    Violations,
    clearance_sd,
    distances,
    find_violations,
    nearest_wires,
)
from algorithms.corridor._clearance.objects import FALLING, TREES, groups, objects_by
from algorithms.corridor._clearance.rules import OBJECTS, UNSURE, Rule
from algorithms.corridor._clearance.surroundings import LineStates, Object, Surroundings
from toolbox.context import QUIET, Context, log

HANGING = Rule(
    "may be wire",
    "hangs in mid-air on a wire, a tower or by itself",
    "",
    UNSURE,
    "3-D",
    0.0,
    0.0,
    UNSURE,
    confirmed=True,
    note="Has the class of plants or none, and may be a wire or a tower: look at it",
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def parted_from_hanging(
    surroundings: Surroundings,
    line: LineStates,
    at_tower: NDArray[np.bool_],
    of_line: NDArray[np.bool_],
    *,
    gap: float,
    fewest: int,
    attachment: float,
    free_air: float,
    ctx: Context = QUIET,
) -> Surroundings:
    """Surroundings in which what hangs in mid-air is no plant; its kinds are in `hanging`.

    A chain of points no farther apart than `gap` hangs if most of it is within `gap` of a wire or
    of a point of the line, at the end of a wire or at a tower, or if it has fewer points than an
    object; and if nothing else is within `free_air` to its side that reaches higher than `free_air`
    below it, nor the ground.

    Parameters
    ----------
    at_tower, of_line : arrays of shape (n,), points at the body of a tower, and those that have
        the class of a line
    gap, fewest : see `objects_of`, metres
    attachment : points nearer to the end of a wire may be of its support, metres
    free_air : metres to the side and below in which nothing is that could hold a plant; 0: no
        point hangs
    """
    xyz, kind, height = surroundings.xyz, surroundings.kind, surroundings.height
    plants = np.flatnonzero(np.isin(kind, TREES))
    if not free_air or not len(plants) or not line.spans:
        return surroundings
    group = groups(xyz[plants], np.zeros(len(plants), np.int64), gap)
    held = at_tower[plants] | near_line(
        xyz[plants], kind[plants], line, xyz[of_line], gap=gap, attachment=attachment, ctx=ctx
    )
    count = np.bincount(group)
    slender = (2 * np.bincount(group, held) > count) | (count < fewest)
    may = np.zeros(len(kind), bool)
    may[plants] = slender[group]
    low = surroundings.low >= 0  # too low to be objects, but others may grow from them
    solid = np.flatnonzero(((kind >= 0) & (kind < len(OBJECTS)) & ~may) | low)
    free = np.zeros(len(kind), bool)
    some = np.flatnonzero(may & (height >= free_air))
    free[some] = ~near_others(xyz[some], xyz[solid], free_air)
    hangs = slender & (np.bincount(group, ~free[plants]) == 0)
    mine = np.zeros(len(kind), bool)
    mine[plants] = hangs[group]
    return replace(
        surroundings,
        kind=np.where(mine, TAKES_NO_PART, kind),
        hanging=np.where(mine, kind, TAKES_NO_PART),
    )


def near_line(
    xyz: Floats,
    kind: NDArray[np.int8],
    line: LineStates,
    labelled: Floats,
    *,
    gap: float,
    attachment: float,
    ctx: Context,
) -> NDArray[np.bool_]:
    """True for points within `gap` of a wire or a labelled point, or near the end of a wire."""
    curves = line.curves[0]
    space, _ = nearest_wires(xyz, kind, curves, reach=max(gap, attachment), ctx=ctx)
    ends = cKDTree(np.concatenate([c.points(np.array([0.0, c.length])) for c in curves]))
    close = space <= attachment
    close[close] = ends.query(xyz[close])[0] <= attachment
    close |= space <= gap
    if len(labelled):
        close |= cKDTree(labelled).query(xyz, distance_upper_bound=gap)[0] <= gap
    return np.asarray(close)


def near_others(xyz: Floats, others: Floats, free_air: float) -> NDArray[np.bool_]:
    """True for points with others within `free_air` in plan, less than that below, or above.

    What is above counts, however high it is: below a crown hang branches.
    """
    near = np.zeros(len(xyz), bool)
    if not len(others) or not len(xyz):
        return near
    found = cKDTree(others[:, :2]).query_ball_point(xyz[:, :2], free_air)
    for number, own in enumerate(found):
        near[number] = bool((others[own, 2] > xyz[number, 2] - free_air).any())
    return near


def above_wires(
    surroundings: Surroundings, line: LineStates, beside: float, fewest: int
) -> dict[int, Ints]:
    """What hangs in mid-air above all wires of a span, by spans: a guard wire may be missing.

    Parameters
    ----------
    beside : metres to the side of a wire of the span
    fewest : points in all, of which less tell nothing: birds

    Returns
    -------
    indices of points by the number of the span
    """
    found = dict(_above_spans(surroundings, line, beside))
    points = {int(point) for own in found.values() for point in own}
    return found if len(points) >= fewest else {}


def _above_spans(
    surroundings: Surroundings, line: LineStates, beside: float
) -> Iterator[tuple[int, Ints]]:
    """The spans that have points above all their wires, and these."""
    some = np.flatnonzero(surroundings.hanging >= 0)
    for span in line.spans:
        above, near = np.ones(len(some), bool), np.zeros(len(some), bool)
        for curve, own in zip(line.curves[0], line.span, strict=True):
            if own == span and len(some):
                _, below, aside, u = distances(surroundings.xyz[some], curve).T
                above &= below < 0
                near |= (aside <= beside) & (u > 0) & (u < curve.length)
        if (above & near).any():
            yield span, some[above & near]


def warn_of_what_is_above(
    surroundings: Surroundings, line: LineStates, above: Mapping[int, Ints], metre: float
) -> None:
    """Tell of points in mid-air above all wires of a span.

    Parameters
    ----------
    above : see `above_wires`
    metre : length of one metre in the unit of the data
    """
    if not above:
        return
    points = np.unique(np.concatenate(list(above.values())))
    x, y, _ = surroundings.xyz[points[0]] * metre + line.origin
    log.warning(
        "%d points hang in mid-air above all wires of spans %s, the first at %.10g, %.10g: if they "
        "are no birds, a guard wire was not found, and it goes on over the spans beside them",
        len(points),
        ", ".join(map(str, above)),
        x,
        y,
    )


def from_wires_below(
    surroundings: Surroundings, line: LineStates, above: Mapping[int, Ints], *, point_sd: float
) -> Violations:
    """What hangs above all wires of a span, from the nearest of them as surveyed, however far.

    Parameters
    ----------
    above : see `above_wires`
    point_sd : standard deviation of a point, metres
    """
    found = Violations.none()
    for span, own in above.items():
        points = own[~np.isin(own, found.point)]  # where spans meet it may be above both
        wires = np.array([wire for wire, of in enumerate(line.span) if of == span])
        measured = np.array([distances(surroundings.xyz[points], line.curves[0][w]) for w in wires])
        nearest = measured[:, :, 0].argmin(axis=0)
        space, vertical, flat, u = measured[nearest, np.arange(len(points))].T
        wire, zero = wires[nearest], np.zeros(len(points), np.int64)
        sd = clearance_sd(line.curves, zero, wire, u, point_sd)
        unknown = np.full(len(points), np.nan)
        found = found.joined(
            Violations(
                points, wire, zero, zero, space, space, space, vertical, flat, u, sd, unknown
            )
        )
    return found


def hanging_elsewhere(
    surroundings: Surroundings, line: LineStates, listed: Violations
) -> dict[str, int]:
    """Number of points that hang in mid-air and are not listed, as they would break no rule.

    Returns
    -------
    the number by what it is of, with the distance of the nearest from a wire; empty for none
    """
    rest = np.setdiff1d(np.flatnonzero(surroundings.hanging >= 0), listed.point)
    if not len(rest):
        return {}
    some = surroundings.xyz[rest]
    nearest = min(float(distances(some, curve)[:, 0].min()) for curve in line.curves[0])
    text = (
        "Hang in mid-air, may be of the line, and would break no rule; the nearest is "
        f"{nearest:.1f} m from a wire"
    )
    return {text: len(rest)}


def hanging_objects(
    surroundings: Surroundings,
    line: LineStates,
    rules: Sequence[Rule],
    above: Mapping[int, Ints],
    *,
    reach: float,
    point_sd: float,
    ctx: Context = QUIET,
) -> tuple[list[Object], Violations]:
    """What would break a rule, or be near without one, if what hangs in mid-air were plants.

    That is told. What may be a guard wire that was not found is among it, at any distance.

    Parameters
    ----------
    rules : of which HANGING will be the next
    above : see `above_wires`
    reach, point_sd : see `find_violations`, metres

    Returns
    -------
    an object for each wire that has such points, and these points
    """
    kind = surroundings.hanging
    some = np.flatnonzero(kind >= 0)
    if not len(some):
        return [], Violations.none()
    found, _ = find_violations(
        surroundings.xyz[some],
        kind[some],
        line.curves,
        [one for one in rules if one is not FALLING],
        reach=reach,
        point_sd=point_sd,
        ctx=ctx,
    )
    if len(found):
        log.warning(
            "%d points hang in mid-air on a wire, a tower or by themselves: not sure whether "
            "they are plants or parts of the line",
            len(found),
        )
    found = replace(found, point=some[found.point])
    higher = from_wires_below(surroundings, line, above, point_sd=point_sd)
    found = found.joined(higher.select(~np.isin(higher.point, found.point)))
    found = replace(
        found,
        rule=np.full(len(found), len(rules)),
        measure=found.space,
        ratio=found.space,
        probability=np.full(len(found), np.nan),
    )
    own = replace(surroundings, kind=kind)
    objects = objects_by(own, found, found.wire, [*rules, HANGING])
    return [replace(one, kind=UNSURE) for one in objects], found
