"""Objects from points that break a rule: trees, buildings and others."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

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


def clumps_of(surroundings: Surroundings, objects: Sequence[Object], *, gap: float) -> list[int]:
    """The clump of each object, from 1 by urgency: objects whose points touch are of one.

    Wide groups of trees are parted tree by tree, and a crew is sent to the clump.

    Parameters
    ----------
    gap : as in `objects_of`
    """
    if not objects:
        return []
    points = np.concatenate([one.points for one in objects])
    group = groups(surroundings.xyz[points], surroundings.kind[points].astype(np.int64), gap)
    firsts = np.cumsum([0, *(len(one.points) for one in objects[:-1])])
    numbers: dict[int, int] = {}
    return [numbers.setdefault(int(own), len(numbers) + 1) for own in group[firsts]]


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


def falling_trees(
    surroundings: Surroundings,
    line: LineStates,
    *,
    rule: int,
    gap: float,
    fewest: int,
    point_sd: float,
    ctx: Context = QUIET,
) -> Violations:
    """Violations by the tops of trees that reach a wire if they fall; distances as they stand.

    Parameters
    ----------
    gap, fewest : points that have fewer around them are no trees, metres; see `lonely`
    """
    trees = np.flatnonzero(np.isin(surroundings.kind, TREES) & (surroundings.height >= LOWEST_TREE))
    trees = trees[~lonely(surroundings.xyz[trees], gap, fewest)]
    tops = trees[tree_tops(surroundings.xyz[trees], surroundings.height[trees])]
    if not len(tops):
        return Violations.none()
    left, wire, state, u = fall_in(
        np.ascontiguousarray(surroundings.xyz[tops]),
        surroundings.height[tops],
        line.curves,
        ctx=ctx,
    )
    hit = np.flatnonzero(left < 0)
    sd = clearance_sd(line.curves, state[hit], wire[hit], u[hit], point_sd)
    standing = [
        distances(surroundings.xyz[[tops[k]]], line.curves[state[k]][wire[k]])[0] for k in hit
    ]
    space, vertical, flat, _ = np.reshape(standing, (-1, 4)).T
    return Violations(
        tops[hit],
        wire[hit],
        np.full(len(hit), rule),
        state[hit],
        left[hit],
        left[hit],
        space,
        vertical,
        flat,
        u[hit],
        sd,
        ndtr(-left[hit] / sd),
    )


def with_falls(
    surroundings: Surroundings,
    objects: Sequence[Object],
    found: Violations,
    falls: Violations,
    rules: Sequence[Rule],
) -> tuple[list[Object], Violations]:
    """Objects with the clearance of their falling trees, and other falling trees as objects.

    Returns
    -------
    objects, and violations of all rules, of which a point breaks one
    """
    number = np.repeat(np.arange(len(objects)), [len(one.points) for one in objects])
    points = np.concatenate([one.points for one in objects] or [np.empty(0, np.int64)])
    may_fall = np.isin(surroundings.kind[points], TREES)
    owner = np.full(len(falls), -1)
    if may_fall.any() and len(falls):
        tree = cKDTree(
            surroundings.xyz[points[may_fall], :2], compact_nodes=False, balanced_tree=False
        )
        near = tree.query(surroundings.xyz[falls.point, :2])
        owner = np.where(near[0] <= CROWN_RADIUS, number[may_fall][near[1]], -1)
    least = np.full(len(objects), np.inf)
    np.minimum.at(least, owner[owner >= 0], falls.measure[owner >= 0])
    reaching = [
        replace(one, falls=float(left)) if left < 0 else one
        for one, left in zip(objects, least, strict=True)
    ]
    alone = falls.select(owner < 0)
    order = np.lexsort((*surroundings.xyz[alone.point].T, alone.measure))
    trees = [_object(surroundings, alone, k, np.array([k])) for k in order]
    trees = [replace(one, falls=one.measure) for one in trees]
    known = found.joined(alone.select(~np.isin(alone.point, found.point)))
    rank = [SEVERITIES.index(rule.severity) for rule in rules]
    return sorted([*reaching, *trees], key=lambda one: rank[one.rule]), known


def rank_as_surveyed(
    surroundings: Surroundings,
    line: LineStates,
    rules: Sequence[Rule],
    found: Violations,
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
    trees = found.point[(found.state != 0) & falls]
    others = found.point[(found.state != 0) & ~falls]
    numbers = [k for k, rule in enumerate(rules) if rule.id != FALLING.id]
    measured = [rules[k] for k in numbers]
    if len(others):
        xyz, kind = surroundings.xyz[others], surroundings.kind[others]
        now, _ = find_violations(xyz, kind, line.curves[:1], measured, reach=reach, point_sd=0.0)
        ranks[others[now.point]] = severity[numbers][now.rule]
    if len(trees):
        left, *_ = fall_in(surroundings.xyz[trees], surroundings.height[trees], line.curves[:1])
        ranks[trees[left < 0]] = SEVERITIES.index(FALLING.severity)
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
