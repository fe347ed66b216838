"""Compiled loops of :mod:`algorithms.classify._learning.model`.

References
----------
Lucchese, C. et al. (2015). QuickScorer: a fast algorithm to rank documents with additive ensembles
of regression trees. SIGIR, 73-82: leaves that cannot be reached as bits.
"""

from __future__ import annotations

import math

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel

MOST_LEAVES = 32  # of a tree whose leaves are the bits of a number
EVERY_LEAF = np.uint32(0xFFFFFFFF)
AT_ONCE = 4  # branches that are asked before the leaves that remain are written down
FEW = 16  # points whose features are rounded together
TOGETHER = 256  # points that take each branch together, so that their features stay at hand


@kernel
def scores(
    first, last, data, roots, column, feature, threshold, left, right, missing, values, found
):
    """Add to found[first:last] the values of the leaves that points reach, one in each tree.

    Tree by tree, whose nodes stay at hand; column is the only class that it speaks about, or -1.
    """
    for tree in range(len(roots)):
        for i in range(first, last):
            node = roots[tree]
            while feature[node] >= 0:
                x = data[i, feature[node]]
                goes_left = missing[node] if math.isnan(x) else x <= threshold[node]
                node = left[node] if goes_left else right[node]
            if column[tree] >= 0:
                found[i, column[tree]] += values[node, column[tree]]
            else:
                for k in range(values.shape[1]):
                    found[i, k] += values[node, k]


@kernel
def scores_of_small(first, last, data, row, threshold, kept, begin, leaf, column, values, found):
    """The same as :func:`scores`, for trees of at most MOST_LEAVES leaves.

    A point to the right of a branch cannot reach the leaves to its left. All branches are asked,
    for many points at once and without a jump, and the first leaf that remains is the one reached.

    Parameters
    ----------
    row, threshold, kept : of each branch, those of a tree after each other: feature (plus the
        number of features if points without it go right), its limit, and the leaves that points
        to the right may reach, as bits; AT_ONCE times a whole number for each tree
    begin : first branch of each tree, and their number
    leaf, column : first leaf of each tree in `values`, and its class
    values : of all leaves from left to right
    """
    count, classes = data.shape[1], found.shape[1]
    asked = np.empty((2 * count, TOGETHER), np.float32)
    sums = np.empty((classes, TOGETHER))
    may = np.empty(TOGETHER, np.uint32)
    lowest = np.empty(TOGETHER, np.float32)
    bits = lowest.view(np.uint32)
    for start in range(first, last, TOGETHER):
        size = min(TOGETHER, last - start)
        for f in range(count):
            for i in range(size):
                x = data[start + i, f]
                asked[f, i] = x
                asked[count + f, i] = np.float32(np.inf) if math.isnan(x) else x
        for i in range(size):
            for c in range(classes):
                sums[c, i] = found[start + i, c]
        for t in range(len(leaf)):
            may[:] = EVERY_LEAF
            for branch in range(begin[t], begin[t + 1], AT_ONCE):
                _leave(asked, row, threshold, kept, branch, may)
            for i in range(TOGETHER):
                left = np.int32(may[i])
                lowest[i] = np.float32(np.int32(left & -left))
            own, reached = sums[column[t]], values[leaf[t] : leaf[t] + MOST_LEAVES]
            for i in range(TOGETHER):  # a power of two as a float has its exponent from bit 23 on
                own[i] += reached[((bits[i] >> np.uint32(23)) - np.uint32(127)) & np.uint32(31)]
        for i in range(size):
            for c in range(classes):
                found[start + i, c] = sums[c, i]


@helper
def _leave(asked, row, threshold, kept, branch, may):
    """Drop the leaves that points cannot reach any more, by AT_ONCE branches.

    One by one, most of the time would go by reading and writing `may`.
    """
    x0, limit0, kept0 = asked[row[branch]], threshold[branch], kept[branch]
    x1, limit1, kept1 = asked[row[branch + 1]], threshold[branch + 1], kept[branch + 1]
    x2, limit2, kept2 = asked[row[branch + 2]], threshold[branch + 2], kept[branch + 2]
    x3, limit3, kept3 = asked[row[branch + 3]], threshold[branch + 3], kept[branch + 3]
    for i in range(TOGETHER):
        one = (kept0 if x0[i] > limit0 else EVERY_LEAF) & (kept1 if x1[i] > limit1 else EVERY_LEAF)
        two = (kept2 if x2[i] > limit2 else EVERY_LEAF) & (kept3 if x3[i] > limit3 else EVERY_LEAF)
        may[i] &= one & two


@kernel
def leaves(feature, left, right, held, before):
    """Fill in the number of leaves below each node, and how many are to the left in its tree.

    Nodes come after those that lead to them; `before` is 0 for roots.
    """
    for node in range(len(feature) - 1, -1, -1):
        held[node] = 1 if feature[node] < 0 else held[left[node]] + held[right[node]]
    for node in range(len(feature)):
        if feature[node] >= 0:
            before[left[node]] = before[node]
            before[right[node]] = before[node] + held[left[node]]


# Sums of a cell.
COUNT, GROUND, ABOVE, PASSING, HEIGHT, HEIGHTS, LIGHT, LIGHTS, BENT, HIGH, FLAT = range(11)
SUMS = 11


@kernel
def columns(place, cols, rows, z, height, ground, passing, light, bent, high, flat, found):
    """Fill in what sums of columns tell, as :mod:`algorithms.classify._learning.columns` names it.

    `place` is the number of the cell of each point, row after row, with an empty cell at each side.
    """
    sums = np.zeros((rows * cols, SUMS), np.int64)
    highest = np.full(rows * cols, -np.inf)
    top = np.full(rows * cols, -(1 << 40), np.int64)
    for i in range(len(place)):
        own, p = sums[place[i]], place[i]
        highest[p] = max(highest[p], z[i])
        top[p] = max(top[p], height[i])
        own[COUNT] += 1
        own[LIGHT] += light[i]
        own[LIGHTS] += light[i] * light[i]
        if ground[i]:
            own[GROUND] += 1
        else:
            own[ABOVE] += 1
            own[PASSING] += passing[i]
            own[HEIGHT] += height[i]
            own[HEIGHTS] += height[i] * height[i]
            own[BENT] += bent[i]
            if high[i]:
                own[HIGH] += 1
                own[FLAT] += flat[i]
    around = np.full((rows * cols, len(found)), np.nan, np.float32)
    total = np.empty(SUMS, np.int64)
    for p in range(cols + 1, rows * cols - cols - 1):
        if sums[p, COUNT] > 0:
            _column(p, cols, sums, top, total, around[p])
    for k in range(len(found)):
        for i in range(len(place)):
            found[k, i] = around[place[i], k]
    for i in range(len(place)):
        p = place[i]
        found[6, i] = height[i] - around[p, 4]
        found[11, i] = highest[p] - z[i]


@helper
def _column(p, cols, sums, top, total, row):
    """Fill in the row of what nine cells have in common."""
    total[:] = 0
    most, cells, first, second = -(1 << 40), 0, 0, 0
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            q = p + dy * cols + dx
            if sums[q, COUNT] == 0:
                continue
            most, cells = max(most, top[q]), cells + 1
            first, second = first + top[q], second + top[q] * top[q]
            for k in range(SUMS):
                total[k] += sums[q, k]
    row[0], row[1] = most, _spread(cells, first, second)
    row[2] = total[GROUND] / total[COUNT]
    if total[ABOVE] > 0:
        row[3] = total[PASSING] / total[ABOVE]
        row[4] = total[HEIGHT] / total[ABOVE]
        row[5] = _spread(total[ABOVE], total[HEIGHT], total[HEIGHTS])
        row[9] = total[BENT] / total[ABOVE]
    if total[HIGH] > 0:
        row[10] = total[FLAT] / total[HIGH]
    row[7] = total[LIGHT] / total[COUNT]
    row[8] = _spread(total[COUNT], total[LIGHT], total[LIGHTS])


@helper
def _spread(count, first, second):
    """Standard deviation from a count, a sum and a sum of squares."""
    mean = first / count
    return math.sqrt(max(second / count - mean * mean, 0.0))


@kernel
def in_voxels(xyz, border, side, steps, index, inside):
    """Fill in the voxel of each point along each axis, and how many steps it is inside of it."""
    for i in range(len(xyz)):
        for axis in range(3):
            place = (xyz[i, axis] + border) / side
            first = math.floor(place)
            index[axis, i], inside[axis, i] = first, np.rint((place - first) * steps)


@kernel
def add_up(number, values, sums):
    """Add values of points, shape (k, n), to the sums of their groups, shape (k, groups)."""
    for k in range(len(values)):
        for i in range(len(number)):
            sums[k, number[i]] += values[k, i]


@kernel
def rounded_rows(first, last, columns, steps, rows):
    """Fill in rows first..last, each a point, from columns of numbers; rounded to 1 / `steps`.

    A few points at a time: rounded side by side, so that several are at once, then written as rows.
    """
    one, near = np.float32(steps), np.empty((len(columns), FEW), np.float32)
    for begin in range(first, last, FEW):
        count = min(FEW, last - begin)
        for k in range(len(columns)):
            for i in range(count):
                near[k, i] = np.rint(columns[k, begin + i] * one) / one
        for i in range(count):
            for k in range(len(columns)):
                rows[begin + i, k] = near[k, i]
