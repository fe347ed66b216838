"""Disjoint sets (union-find) for kernels: each member points to its root, directly or not."""

from __future__ import annotations

from algorithms.shared.kernels.compiling import helper


@helper
def root(parent, i):
    """Root of the set of i; halves the path on the way."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i
