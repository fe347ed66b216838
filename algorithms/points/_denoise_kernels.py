"""Compiled loops of :mod:`algorithms.points.denoise`."""

from __future__ import annotations

import numpy as np
from numba import njit

from algorithms.shared.kernels import neighbours as tree
from algorithms.shared.kernels.compiling import helper
from algorithms.shared.kernels.sorting import median

LOW, HIGH, ISOLATED = 7, 18, 1  # verdicts: ASPRS classes of noise, 1 to be decided; 0 is no noise
MAD = 1.4826  # standard deviation of a normal distribution over its median absolute deviation


@njit(cache=True, nogil=True)
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


@helper
def _lowest_around(box, depth, leaf, reach, lowest, held):
    """Lower bound of the mean distances of neighbours within `reach` of the points of a leaf."""
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


@njit(cache=True, nogil=True)
def judge(first_leaf, last_leaf, xyz, box, depth, mean, farthest, lowest, k, reach, rule, verdict):
    """Fill in the verdicts on the points of the leaves first_leaf..last_leaf.

    `rule` holds the threshold, the least deviation as a share of what is usual, the least number of
    neighbours, and the height of plants; `k` is the number of neighbours near by and around, see
    the tool.
    """
    n = len(xyz)
    threshold, share, fewest, plants = rule
    few, few_far = np.empty(k[0], np.int64), np.empty(k[0])
    near, far, values = np.empty(k[1], np.int64), np.empty(k[1]), np.empty(k[1])
    held, held_away = np.empty(tree.DEEPEST, np.int64), np.empty(tree.DEEPEST)
    for leaf in range(first_leaf, last_leaf):
        start, stop = tree.first(leaf, depth, n), tree.first(leaf + 1, depth, n)
        widest = 0.0
        for own in range(start, stop):
            widest = max(widest, farthest[own])
        low = _lowest_around(box, depth, leaf, widest, lowest, held)
        for own in range(start, stop):
            # No point is noise below this; for most the lowest value around them decides.
            least = mean[own] / (1.0 + threshold * share)
            if farthest[own] < reach and least <= low:
                continue
            found = tree.nearest(xyz, box, depth, leaf, own, reach, few, few_far, held, held_away)
            for j in range(found):
                values[j] = mean[few[j]]
            near_by = median(values[:found]) if found > 0 else 0.0
            if farthest[own] < reach and least <= near_by:
                continue
            found = tree.nearest(xyz, box, depth, leaf, own, reach, near, far, held, held_away)
            if found < fewest:
                verdict[own] = ISOLATED
                continue
            for j in range(found):
                values[j] = mean[near[j]]
            middle = median(values[:found])
            for j in range(found):
                values[j] = abs(mean[near[j]] - middle)
            usual = max(middle, near_by)
            deviation = max(MAD * median(values[:found]), share * usual)
            if mean[own] - usual > threshold * deviation:
                verdict[own] = _side(xyz, own, near, values, found, plants)


@njit(cache=True, nogil=True)
def sides(first, last, xyz, box, depth, noise, k, verdict):
    """Fill in whether the noise points first..last, in the order of the tree, are low or high."""
    n = len(xyz)
    near, far, values = np.empty(k, np.int64), np.empty(k), np.empty(k)
    held, held_away = np.empty(tree.DEEPEST, np.int64), np.empty(tree.DEEPEST)
    for i in range(first, last):
        own = noise[i]
        leaf = (((own + 1) << depth) - 1) // n  # the last that begins at or before the point
        found = tree.nearest(xyz, box, depth, leaf, own, np.inf, near, far, held, held_away)
        verdict[own] = _side(xyz, own, near, values, found, 0.0)
