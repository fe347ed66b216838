"""Points put together to objects: trees, buildings and whatever else comes too near to a wire."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

TOP_CELL = 1.0  # metres, of which the highest point may be the top of a tree
CROWN = 3.0  # metres: within this no tree has a higher neighbour at its top
LOWEST_TREE = 3.0  # metres
WIDEST = 15.0  # metres: a group that is wider is parted tree by tree

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def tree_tops(xyz: Floats, height: Floats) -> Ints:
    """Points that are the highest within CROWN in plan, and high enough for a tree.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    height : array of shape (n,), above the ground, metres; NaN where not known

    Returns
    -------
    array of indices
    """
    tall = np.flatnonzero(height >= LOWEST_TREE)
    order = tall[np.lexsort((xyz[tall, 1], xyz[tall, 0], -height[tall]))]
    cell = np.floor(xyz[order, :2] / TOP_CELL).astype(np.int64)
    best = np.sort(np.unique(cell, axis=0, return_index=True)[1])  # of each cell the first
    tops = order[best]
    rank = np.arange(len(tops))  # the first is the highest
    pairs = cKDTree(xyz[tops, :2]).query_pairs(CROWN, output_type="ndarray")
    beaten = np.zeros(len(tops), bool)
    beaten[np.maximum(rank[pairs[:, 0]], rank[pairs[:, 1]])] = True
    return tops[~beaten]


def groups(xyz: Floats, kind: Ints, gap: float) -> Ints:
    """Number of the object that each point is of, from 0.

    Points of one kind are of one object if a chain of cells of half a gap, each with points of it
    and no farther than a gap from the next, leads from one to the other.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    kind : array of shape (n,)
    gap : metres

    Returns
    -------
    array of shape (n,)
        Numbers follow the order of the cells in space, whatever that of the points.
    """
    if not len(xyz):
        return np.empty(0, np.int64)
    cell = np.floor(xyz / (gap / 2)).astype(np.int64)
    cells, own = np.unique(np.column_stack([kind, cell]), axis=0, return_inverse=True)
    apart = cells.astype(float)
    apart[:, 0] *= 10.0  # kinds never meet
    pairs = cKDTree(apart).query_pairs(2.0, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(cells),) * 2)
    label = connected_components(links, directed=False)[1]
    return np.asarray(label[own.reshape(-1)], np.int64)


def parted(xyz: Floats, group: Ints, may_part: NDArray[np.bool_], tops: Floats) -> Ints:
    """Wide groups parted by the nearest top of a tree in plan.

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
    count = int(group.max()) + 1
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, group, xyz[:, :2])
    np.maximum.at(high, group, xyz[:, :2])
    wide = (high - low).max(axis=1) > WIDEST
    some = wide[group] & may_part
    nearest = np.zeros(len(group), np.int64)
    nearest[some] = 1 + cKDTree(tops[:, :2]).query(xyz[some, :2])[1]
    return np.unique(np.column_stack([group, nearest]), axis=0, return_inverse=True)[1].reshape(-1)
