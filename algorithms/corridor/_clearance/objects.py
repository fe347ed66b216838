"""Objects from points that break a rule: trees, buildings and others."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtr

from algorithms.corridor._clearance.distances import (
    TREE,
    UNCLASSIFIED,
    Violations,
    clearance_sd,
    distances,
    fall_in,
    find_violations,
    nearest_wires,
)
from algorithms.corridor._clearance.rules import KINDS, SEVERITIES, Rule
from algorithms.corridor._clearance.surroundings import LineStates, Object, Surroundings
from algorithms.shared.clusters import dbscan
from toolbox.context import QUIET, Context

TOP_CELL = 1.0  # metres, of which the highest point may be the top of a tree
CROWN_RADIUS = 3.0  # metres: within this no tree has a higher neighbour at its top
LOWEST_TREE = 3.0  # metres
WIDEST_OBJECT = 15.0  # metres: a group that is wider is parted tree by tree
TREES = (TREE, UNCLASSIFIED)  # kinds of points that may be trees
FALLING = Rule(
    "falling",
    "height of the tree against the distance of its foot",
    "",
    "tree",
    "3-D",
    0.0,
    0.0,
    "watch",
    confirmed=True,
    note="A tree that falls towards the line reaches it",
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def objects_of(
    surroundings: Surroundings, found: Violations, rules: Sequence[Rule], *, gap: float, fewest: int
) -> tuple[list[Object], Ints]:
    """Objects grouped from violations, the most urgent first.

    Parameters
    ----------
    gap : points that are farther apart are of different objects, metres
    fewest : points of an object

    Returns
    -------
    objects, and indices of the points that are too few for one, the most urgent first
    """
    xyz, height = surroundings.xyz[found.point], surroundings.height[found.point]
    kind = surroundings.kind[found.point].astype(np.int64)
    may_part = np.isin(kind, TREES)
    tops = xyz[may_part][tree_tops(xyz[may_part], height[may_part])]
    group = parted(xyz, groups(xyz, kind, gap), may_part, tops)
    rank = np.array([SEVERITIES.index(rule.severity) for rule in rules])[found.rule]
    members = _members(group)
    made = [(worst, members[group[worst]]) for worst in _worst(xyz, group, rank, found.ratio)]
    objects = [
        _object(surroundings, found, worst, own) for worst, own in made if len(own) >= fewest
    ]
    lone = [found.point[own] for _, own in made if len(own) < fewest]
    return objects, np.concatenate([*lone, np.empty(0, np.int64)])


def objects_by(
    surroundings: Surroundings, found: Violations, group: Ints, rules: Sequence[Rule]
) -> list[Object]:
    """An object of each group of violations, the most urgent first; `group` has the shape (n,)."""
    group = np.unique(group, return_inverse=True)[1].reshape(-1)
    rank = np.array([SEVERITIES.index(rule.severity) for rule in rules])[found.rule]
    members = _members(group)
    worst = _worst(surroundings.xyz[found.point], group, rank, found.ratio)
    return [_object(surroundings, found, int(one), members[group[one]]) for one in worst]


def clump_of_each(surroundings: Surroundings, objects: Sequence[Object], *, gap: float) -> Ints:
    """The clump of each point of the kinds of some objects, -1 for others, array of shape (n,).

    Wide groups of trees are parted tree by tree, and of a tree only parts may be too close; a crew
    is sent to the clump. So what joins objects may be points that are not listed.

    Parameters
    ----------
    gap : as in `objects_of`
    """
    kind = np.maximum(surroundings.kind, surroundings.hanging).astype(np.int64)
    firsts = np.array([one.points[0] for one in objects], np.int64)
    like = np.flatnonzero(np.isin(kind, kind[firsts]))
    clump = np.full(len(kind), -1)
    clump[like] = groups(surroundings.xyz[like], kind[like], gap)
    return clump


def clumps_of(objects: Sequence[Object], clump: Ints) -> list[int]:
    """The clump of each object, from 1 by urgency: objects that touch are of one.

    Parameters
    ----------
    clump : see `clump_of_each`
    """
    numbers: dict[int, int] = {}
    return [numbers.setdefault(int(clump[one.points[0]]), len(numbers) + 1) for one in objects]


def of_their_clumps(
    surroundings: Surroundings, objects: Sequence[Object], others: Ints, clump: Ints
) -> list[Ints]:
    """Of some points those of the clump of each object, if they are nearest to it of all objects.

    They are its, as parts of a tree that are not listed, up to WIDEST_OBJECT from it: whole woods
    may be one clump.

    Parameters
    ----------
    others : indices of points that are of no object
    clump : see `clump_of_each`
    """
    own = np.concatenate([*(one.points for one in objects), np.empty(0, np.int64)])
    if not len(own) or not len(others):
        return [np.empty(0, np.int64)] * len(objects)
    owner = np.repeat(np.arange(len(objects)), [len(one.points) for one in objects])
    # Clumps lie so far from each other in a fourth direction that no other is nearest.
    places = np.column_stack([surroundings.xyz, 2 * WIDEST_OBJECT * clump])
    _, nearest = cKDTree(places[own]).query(places[others], distance_upper_bound=WIDEST_OBJECT)
    held = np.append(owner, -1)[nearest]
    return [others[held == number] for number in range(len(objects))]


def _worst(xyz: Floats, group: Ints, rank: Ints, ratio: Floats) -> Ints:
    """Index of the worst point of each group, sorted by urgency, independent of the point order."""
    worst = np.arange(len(group))
    for values in (rank, ratio):
        least = np.full(int(group.max(initial=-1)) + 1, np.inf)
        np.minimum.at(least, group[worst], values[worst])
        worst = worst[values[worst] == least[group[worst]]]
    order = worst[np.lexsort((*xyz[worst].T, ratio[worst], rank[worst]))]
    return np.asarray(order[np.sort(np.unique(group[order], return_index=True)[1])])


def _object(surroundings: Surroundings, found: Violations, worst: int, own: Ints) -> Object:
    """Object made of the violations `own`, with the measures of the worst of them."""
    points = found.point[own]
    heights = surroundings.height[points]
    known = heights[np.isfinite(heights)]
    return Object(
        points=points,
        nearest=int(found.point[worst]),
        kind=KINDS[surroundings.kind[found.point[worst]]],
        rule=int(found.rule[worst]),
        wire=int(found.wire[worst]),
        state=int(found.state[worst]),
        measure=float(found.measure[worst]),
        space=float(found.space[worst]),
        vertical=float(found.vertical[worst]),
        flat=float(found.flat[worst]),
        u=float(found.u[worst]),
        sd=float(found.sd[worst]),
        probability=float(found.probability[worst]),
        height=float(known.max()) if len(known) else math.nan,
        falls=math.nan,
    )


def _members(group: Ints) -> list[Ints]:
    """Indices of the members of each group."""
    order = np.argsort(group, kind="stable")
    edges = np.searchsorted(group[order], np.arange(1, int(group.max(initial=-1)) + 1))
    return np.split(order, edges) if len(group) else []


@dataclass(frozen=True)
class Falls:
    """Trees that reach a wire if they fall, those that reach farthest beyond it first.

    Attributes
    ----------
    points : of each of m trees
    left : array of shape (m,), see `fall_in`; of the point that reaches farthest
    state : array of shape (m,), in which that is so
    probability : array of shape (m,), that it reaches the wire
    """

    points: list[Ints]
    left: Floats
    state: Ints
    probability: Floats


def falling_trees(
    surroundings: Surroundings,
    line: LineStates,
    *,
    gap: float,
    fewest: int,
    point_sd: float,
    ctx: Context = QUIET,
) -> Falls:
    """Trees that reach a wire if they fall; a foot may be below any point, as none is seen.

    Parameters
    ----------
    gap, fewest : points that have fewer around them are no trees, metres; see `lonely`
    """
    plants = np.flatnonzero(np.isin(surroundings.kind, TREES))
    plants = plants[~lonely(surroundings.xyz[plants], gap, fewest)]
    xyz, height = surroundings.xyz[plants], _stems(surroundings.height[plants])
    if not height.any():
        return Falls([], np.empty(0), np.empty(0, np.int64), np.empty(0))
    kind = surroundings.kind[plants].astype(np.int64)
    tops = xyz[tree_tops(xyz, height)]
    tree = parted(xyz, groups(xyz, kind, gap), np.ones(len(plants), bool), tops)
    left, wire, state, u = fall_in(xyz, height, line.curves, ctx=ctx)
    worst = _worst(xyz, tree, np.zeros(len(plants), np.int64), left)
    worst = worst[left[worst] < 0]
    sd = clearance_sd(line.curves, state[worst], wire[worst], u[worst], point_sd)
    members = _members(tree)
    points = [plants[members[number]] for number in tree[worst]]
    return Falls(points, left[worst], state[worst], ndtr(-left[worst] / sd))


def _stems(height: Floats) -> Floats:
    """Heights of stems that may fall: 0 where it is not known, or less than that of a tree."""
    return np.where(height >= LOWEST_TREE, height, 0.0)


def with_falls(
    surroundings: Surroundings,
    line: LineStates,
    objects: Sequence[Object],
    found: Violations,
    falls: Falls,
    rules: Sequence[Rule],
    *,
    point_sd: float,
) -> tuple[list[Object], Violations]:
    """Objects with the clearance of their falling trees, and other falling trees as objects.

    Parameters
    ----------
    rules : the last is that of falling trees

    Returns
    -------
    objects, and violations of all rules, of which a point breaks one
    """
    least = np.full(len(objects), np.inf)
    alone = []
    for number, held in enumerate(_holders(surroundings, objects, falls)):
        least[held] = np.minimum(least[held], falls.left[number])
        if not len(held):
            alone.append(number)
    reaching = [
        replace(one, falls=float(left)) if left < 0 else one
        for one, left in zip(objects, least, strict=True)
    ]
    made, tree = _standing(surroundings, line, falls, alone, found, len(rules) - 1, point_sd)
    trees = [replace(one, falls=one.measure) for one in objects_by(surroundings, made, tree, rules)]
    trees.sort(key=lambda one: one.measure)
    rank = [SEVERITIES.index(rule.severity) for rule in rules]
    return sorted([*reaching, *trees], key=lambda one: rank[one.rule]), found.joined(made)


def _holders(surroundings: Surroundings, objects: Sequence[Object], falls: Falls) -> Iterator[Ints]:
    """The objects that hold points of each tree, else that within a crown of its top in plan."""
    number = np.repeat(np.arange(len(objects)), [len(one.points) for one in objects])
    points = np.concatenate([one.points for one in objects] or [np.empty(0, np.int64)])
    holder = np.full(len(surroundings.xyz), -1)
    holder[points] = number
    plants = points[np.isin(surroundings.kind[points], TREES)]
    near = (
        cKDTree(surroundings.xyz[plants, :2], compact_nodes=False, balanced_tree=False)
        if len(plants)
        else None
    )
    for own in falls.points:
        held = np.unique(holder[own])
        held = held[held >= 0]
        if not len(held) and near is not None:
            top = own[np.nanargmax(surroundings.height[own])]
            away, nearest = near.query(surroundings.xyz[top, :2])
            held = holder[plants[[nearest]]] if away <= CROWN_RADIUS else held
        yield held


def _standing(
    surroundings: Surroundings,
    line: LineStates,
    falls: Falls,
    alone: Sequence[int],
    found: Violations,
    rule: int,
    point_sd: float,
) -> tuple[Violations, Ints]:
    """Points of some trees that may fall, measured as they stand, and the tree of each.

    All points of a tree are measured from the wire that is nearest to one of them. Those that are
    listed already, as too close but too few for an object, are left out.
    """
    xyz, some = surroundings.xyz, [falls.points[number] for number in alone]
    tree = np.repeat(np.array(alone, np.int64), [len(own) for own in some])
    points = np.concatenate([*some, np.empty(0, np.int64)])
    state, wire = falls.state[tree], np.full(len(points), -1)
    measured = np.empty((len(points), 4))
    # A foot is nearer to the wire than its stem is high, so no stem is farther than twice that.
    reach = 2 * float(_stems(surroundings.height[points]).max(initial=0.0))
    for number in np.unique(state).tolist():
        own, curves = np.flatnonzero(state == number), line.curves[number]
        space, near = nearest_wires(
            xyz[points[own]], surroundings.kind[points[own]], curves, reach=reach
        )
        for group in np.split(np.arange(len(own)), np.flatnonzero(np.diff(tree[own])) + 1):
            here = own[group]
            wire[here] = near[group[space[group].argmin()]]
            measured[here] = distances(xyz[points[here]], curves[wire[here[0]]])
    space, vertical, flat, u = measured.T
    left = falls.left[tree]
    sd = clearance_sd(line.curves, state, wire, u, point_sd)
    made = Violations(
        points,
        wire,
        np.full(len(points), rule),
        state,
        left,
        space,  # the nearest of its points tells where an object is
        space,
        vertical,
        flat,
        u,
        sd,
        falls.probability[tree],
    )
    fresh = ~np.isin(points, found.point)
    return made.select(fresh), tree[fresh]


def rank_as_surveyed(
    surroundings: Surroundings,
    line: LineStates,
    rules: Sequence[Rule],
    found: Violations,
    objects: Sequence[Object],
    *,
    reach: float,
) -> Ints:
    """How severe points are with the wires as surveyed, of those that are listed in any state.

    Parameters
    ----------
    rules : also those that come without a distance, as of falling trees
    found : violations in all states, each in that in which it is worst
    reach : to the side of the wires, metres

    Returns
    -------
    array of shape (n,), for all points of the surroundings: index into SEVERITIES, one more for
        what is not listed as surveyed
    """
    severity = np.array([SEVERITIES.index(rule.severity) for rule in rules], np.int64)
    ranks = np.full(len(surroundings.xyz), len(SEVERITIES))
    calm = found.state == 0
    ranks[found.point[calm]] = severity[found.rule[calm]]
    falls = np.array([rule.id == FALLING.id for rule in rules], bool)[found.rule]
    others = found.point[(found.state != 0) & ~falls]
    numbers = [k for k, rule in enumerate(rules) if rule.id != FALLING.id]
    measured = [rules[k] for k in numbers]
    if len(others):
        xyz, kind = surroundings.xyz[others], surroundings.kind[others]
        now, _ = find_violations(xyz, kind, line.curves[:1], measured, reach=reach, point_sd=0.0)
        ranks[others[now.point]] = severity[numbers][now.rule]
    trees = [one.points for one in objects if one.state and rules[one.rule].id == FALLING.id]
    if trees:
        points = np.concatenate(trees)
        tree = np.repeat(np.arange(len(trees)), [len(own) for own in trees])
        height = _stems(surroundings.height[points])
        left, *_ = fall_in(surroundings.xyz[points], height, line.curves[:1])
        reaches = np.bincount(tree, left < 0) > 0
        ranks[points[reaches[tree]]] = SEVERITIES.index(FALLING.severity)
    return ranks


def lonely(xyz: Floats, gap: float, fewest: int) -> NDArray[np.bool_]:
    """True for points with fewer than `fewest` points in their cell and the cells around it.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    gap : size of a cell, metres
    """
    if not len(xyz):
        return np.empty(0, bool)
    cell = np.floor((xyz - xyz.min(axis=0)) / gap).astype(np.int64) + 1
    steps = np.cumprod(
        [1, *(cell.max(axis=0)[:2] + 2)]
    )  # no two neighbours of a cell have one number
    cells, own, count = np.unique(cell @ steps, return_inverse=True, return_counts=True)
    around = np.zeros(len(cells), np.int64)
    for step in itertools.product((-1, 0, 1), repeat=3):
        wanted = cells + np.array(step) @ steps
        index = np.minimum(np.searchsorted(cells, wanted), len(cells) - 1)
        around += np.where(cells[index] == wanted, count[index], 0)
    return np.asarray(around[own.reshape(-1)] < fewest)


def _numbers(cell: Ints) -> Ints:
    """Number of each cell, in the sorting order of the cells; `cell` has the shape (n, k)."""
    number = np.zeros(len(cell), np.int64)
    for column in cell.T:
        low, high = column.min(), column.max()
        number = number * (high - low + 1) + (column - low)
    return number


def tree_tops(xyz: Floats, height: Floats) -> Ints:
    """Indices of points that are highest within CROWN_RADIUS in plan, and as high as a tree.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    height : array of shape (n,), above the ground, metres; NaN where not known

    Returns
    -------
    array of indices
    """
    tall = np.flatnonzero(height >= LOWEST_TREE)
    if not len(tall):
        return tall
    (x, y), z = xyz[tall, :2].T, height[tall]
    number = _numbers(np.floor(xyz[tall, :2] / TOP_CELL).astype(np.int64))
    own = np.unique(number, return_inverse=True)[1].reshape(-1)
    best = np.full(own.max() + 1, -np.inf)
    np.maximum.at(best, own, z)
    high = np.flatnonzero(z == best[own])
    order = high[np.lexsort((y[high], x[high], -z[high]))]  # the highest first, and always the same
    tops = tall[order[np.sort(np.unique(own[order], return_index=True)[1])]]
    pairs = cKDTree(xyz[tops, :2]).query_pairs(CROWN_RADIUS, output_type="ndarray")
    beaten = np.zeros(len(tops), bool)
    beaten[pairs.max(axis=1)] = True  # the later of two is the lower
    return tops[~beaten]


def groups(xyz: Floats, kind: Ints, gap: float) -> Ints:
    """Object number of each point, from 0.

    Points of one kind are of one object if a chain of points of it, each no farther than a gap from
    the next, leads from one to the other.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    kind : array of shape (n,)
    gap : metres

    Returns
    -------
    array of shape (n,)
        Numbers follow the order of the kinds, then of the points in space.
    """
    found = np.zeros(len(xyz), np.int64)
    for value in np.unique(kind):
        own = kind == value
        found[own] = dbscan(xyz[own], gap, 1) + found.max(initial=0)
    return found - 1


def parted(xyz: Floats, group: Ints, may_part: NDArray[np.bool_], tops: Floats) -> Ints:
    """Group numbers in which wide groups are divided by the nearest tree top in plan.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    group : array of shape (n,)
    may_part : array of shape (n,), points that may be of trees
    tops : array of shape (m, 3)

    Returns
    -------
    array of shape (n,)
    """
    if not len(tops) or not len(group):
        return group
    wide = np.zeros(int(group.max()) + 1, bool)
    for values in xyz[:, :2].T:
        low, high = np.full(len(wide), np.inf), np.full(len(wide), -np.inf)
        np.minimum.at(low, group, values)
        np.maximum.at(high, group, values)
        wide |= high - low > WIDEST_OBJECT
    some = wide[group] & may_part
    nearest = np.zeros(len(group), np.int64)
    nearest[some] = 1 + cKDTree(tops[:, :2]).query(xyz[some, :2])[1]
    number = _numbers(np.column_stack([group, nearest]))
    return np.unique(number, return_inverse=True)[1].reshape(-1)
