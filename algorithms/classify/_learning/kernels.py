"""Compiled loops of :mod:`algorithms.classify._learning.model`."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, nogil=True)
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
