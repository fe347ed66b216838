"""Compiled loops of :mod:`algorithms.points.denoise`."""

from __future__ import annotations

import numpy as np

from algorithms.shared.error_measures import NORMAL
from algorithms.shared.kernels import neighbours as tree
from algorithms.shared.kernels.compiling import helper, kernel
from algorithms.shared.kernels.sorting import median

LOW, HIGH, ISOLATED = 7, 18, 1  # verdicts: ASPRS classes of noise, 1 to be decided; 0 is no noise


@kernel
def lowest_means(mean, depth):
    """Lowest mean distance among the points of each node of the tree, shape (2**(depth + 1),)."""
    n = len(mean)
    lowest = np.full(2 << depth, np.inf)
    for leaf in range(1 << depth):
        for i in range(tree.first(leaf, depth, n), tree.first(leaf + 1, depth, n)):
            lowest[(1 << depth) + leaf] = min(lowest[(1 << depth) + leaf], mean[i])
    for node in range((1 << depth) - 1, 0, -1):
        lowest[node] = min(lowest[2 * node], lowest[2 * node + 1])
    return lowest


@kernel
def lowest_around(first_leaf, last_leaf, box, depth, lowest, farthest, around):
    """Fill in lower bounds of the mean distances of all neighbours of the points of some leaves."""
    n, held = len(around), np.empty(tree.DEEPEST, np.int64)
    for leaf in range(first_leaf, last_leaf):
        start, stop = tree.first(leaf, depth, n), tree.first(leaf + 1, depth, n)
        around[start:stop] = _lowest_in(box, depth, leaf, farthest[start:stop].max(), lowest, held)


@helper
def _lowest_in(box, depth, leaf, reach, lowest, held):
    """The lowest mean distance in leaves within `reach` of a leaf."""
    own = box[(1 << depth) + leaf]
    held[0], waiting, low = 1, 1, np.inf
    while waiting > 0:
        waiting -= 1
        here = held[waiting]
        gap = 0.0
        for a in range(3):
            gap += max(box[here, a] - own[3 + a], 0.0, own[a] - box[here, 3 + a]) ** 2
        if lowest[here] >= low or gap > reach * reach:
            continue
        if here >> depth:
            low = lowest[here]
        else:
            held[waiting], held[waiting + 1] = 2 * here, 2 * here + 1
            waiting += 2
    return low


@helper
def _side(xyz, own, near, values, found, plants):
    """Low or high noise, or none where a plant may be: by the median height of the neighbours."""
    for j in range(found):
        values[j] = xyz[near[j], 2]
    above = xyz[own, 2] - median(values[:found])
    if 0.0 < above <= plants:
        return 0
    return HIGH if above > 0.0 else LOW


@kernel
def judge(first, last, xyz, box, depth, points, around, mean, farthest, k, reach, rule, verdict):
    """Fill in the verdicts on the points first..last of those that are in doubt.

    `mean` and `farthest` hold the distances to the k[0] nearest, NaN where these are still to be
    found. `around` has two rows: a number below the mean distances of all points within a distance,
    and that distance. `rule` holds the threshold, the least deviation as a share of what is usual,
    the least number of neighbours, and the height of plants; `k` is the number of neighbours that
    means are of, of those near by, and of those around, see the tool.
    """
    threshold, share, fewest, plants = rule
    to_far, few, few_far = np.empty(k[0]), np.empty(k[1], np.int64), np.empty(k[1])
    near, far, values = np.empty(k[2], np.int64), np.empty(k[2]), np.empty(k[2])
    held, held_away = np.empty(tree.DEEPEST, np.int64), np.empty(tree.DEEPEST)
    search = xyz, box, depth, reach, to_far, held, held_away
    for i in range(first, last):
        own = points[i]
        leaf = tree.leaf_of(own, depth, len(xyz))
        before = points[i - 1] if i > first else own
        fresh = np.isnan(mean[own])
        # No point is noise below this; for most the lowest value around them decides.
        least = _mean(own, before, search, mean, farthest) / (1.0 + threshold * share)
        beyond = farthest[own] >= reach
        reached = np.sqrt(to_far[k[0] - k[1]]) if fresh else farthest[own]
        if not beyond and reached <= around[1, i] and least <= around[0, i]:
            continue
        # The mean distance of a neighbour differs from that of the point by no more than what is
        # between them.
        if fresh and not beyond and least <= mean[own] - np.sqrt(to_far[k[0] - k[1] // 2 - 1]):
            continue
        found = tree.nearest(xyz, box, depth, leaf, own, reach, few, few_far, held, held_away)
        for j in range(found):
            values[j] = _mean(few[j], own, search, mean, farthest)
        near_by = median(values[:found]) if found > 0 else 0.0
        if not beyond and least <= near_by:
            continue
        found = tree.nearest(xyz, box, depth, leaf, own, reach, near, far, held, held_away)
        if found < fewest:
            verdict[own] = ISOLATED
            continue
        for j in range(found):
            values[j] = _mean(near[j], own, search, mean, farthest)
        middle = median(values[:found])
        for j in range(found):
            values[j] = abs(mean[near[j]] - middle)
        usual = max(middle, near_by)
        deviation = max(NORMAL * median(values[:found]), share * usual)
        if mean[own] - usual > threshold * deviation:
            verdict[own] = _side(xyz, own, near, values, found, plants)


@helper
def _mean(own, other, search, mean, farthest):
    """Mean distance of a point to its nearest, found when it is first asked for.

    The farthest of these is kept as well. `other` is a point near by whose mean may be known.
    Two threads that need the mean of one point find the same.
    """
    if np.isnan(mean[own]):
        xyz, box, depth, reach, far, held, held_away = search
        known = -1 if other == own or np.isnan(mean[other]) else other
        leaf = tree.leaf_of(own, depth, len(xyz))
        mean[own], farthest[own] = tree.mean_distance(
            xyz, box, depth, leaf, own, known, farthest, reach, far, held, held_away
        )
    return mean[own]


@kernel
def sides(first, last, xyz, box, depth, noise, k, verdict):
    """Fill in whether the noise points first..last, in the order of the tree, are low or high."""
    n = len(xyz)
    near, far, values = np.empty(k, np.int64), np.empty(k), np.empty(k)
    held, held_away = np.empty(tree.DEEPEST, np.int64), np.empty(tree.DEEPEST)
    for i in range(first, last):
        own = noise[i]
        leaf = tree.leaf_of(own, depth, n)
        found = tree.nearest(xyz, box, depth, leaf, own, np.inf, near, far, held, held_away)
        verdict[own] = _side(xyz, own, near, values, found, 0.0)
