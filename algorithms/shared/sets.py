"""Disjoint sets within kernels: each member leads, by way of others, to the name of its set."""

from __future__ import annotations

from algorithms.shared.kernels.compiling import helper


@helper
def root(parent, i):
    """The number of the set that i is in; shortens the way for those who ask next."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i
