"""Voxels with lines that agree grow together to wires."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from algorithms.corridor._voxels.voxels import Voxels

GrowTo = Literal["6", "18", "26", "gap"]
SlopeTest = Literal["direction", "slopes"]
# Squared distance of cells, between those of the neighbours named and the next farther ones.
BEYOND = {"6": 1.5, "18": 2.5, "26": 3.5}
PLANES = ((0, 1), (0, 2), (1, 2))  # plan and both vertical planes, by their axes

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


def grown(
    voxels: Voxels,
    direction: Floats,
    kept: Mask,
    *,
    grow_to: GrowTo,
    gap: float,
    slope_test: SlopeTest,
    slope_limit: float,
    fewest: int,
) -> Ints:
    """Group of each of v voxels, from 1 on; 0 for voxels of none.

    The study grows groups from seeds until no voxel is left. As two voxels accept each other
    whichever of them comes first, that gives the connected groups, whatever the seeds.

    Parameters
    ----------
    direction : array of shape (v, 3), of the line in each; 0 where there is none
    kept : array of shape (v,), voxels that may be of a wire
    grow_to : how many of the voxels around one may follow; "gap" for all within the gap through
        which the line of the one runs, and whose own line runs through it
    gap : farthest that the next voxel may be, from centroid to centroid, metres
    slope_test : see :func:`agree`
    fewest : voxels of a group
    """
    some = np.flatnonzero(kept & direction.any(axis=1))
    group = np.zeros(len(kept), np.int64)
    if not len(some):
        return group
    centroid = voxels.centroid[some]
    if grow_to == "gap":
        pairs = cKDTree(centroid).query_pairs(gap, output_type="ndarray")
    else:
        reach = math.sqrt(BEYOND[grow_to])
        pairs = cKDTree(voxels.cell[some]).query_pairs(reach, output_type="ndarray")
    step = centroid[pairs[:, 1]] - centroid[pairs[:, 0]]
    one, other = (direction[some[side]] for side in pairs.T)
    linked = (np.linalg.norm(step, axis=1) < gap) & agree(one, other, slope_test, slope_limit)
    if grow_to == "gap":
        for line in (one, other):
            linked &= np.linalg.norm(np.cross(step, line), axis=1) < voxels.size
    label = components(len(some), pairs[linked])
    enough = np.bincount(label)[label] >= fewest
    group[some[enough]] = 1 + np.unique(label[enough], return_inverse=True)[1]
    return group


def agree(one: Floats, other: Floats, test: SlopeTest, limit: float) -> Mask:
    """Whether lines of n voxels go on in those of n others.

    Parameters
    ----------
    one, other : arrays of shape (n, 3), directions
    test : "slopes" compares the slopes in plan and in both vertical planes, as printed. They grow
        without bound for wires along an axis, where no two agree. "direction" takes the angle
        between the lines instead, in whatever direction they run.
    limit : largest difference of slopes; the tangent of the largest angle
    """
    if test == "direction":
        return np.asarray(np.abs((one * other).sum(axis=1)) > math.cos(math.atan(limit)))
    same = np.ones(len(one), bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        for run, rise in PLANES:
            difference = one[:, rise] / one[:, run] - other[:, rise] / other[:, run]
            same &= np.abs(difference) < limit
    return same


def components(count: int, pairs: Ints) -> Ints:
    """Number, from 0, of the connected group of each of `count` things; pairs of shape (m, 2)."""
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def seeds_of(group: Ints, share: Floats, count: Ints) -> Mask:
    """True for one voxel of each group, from which it may have grown: that with the best line.

    That is the one with the largest share of points near its line, of these with the most points.
    The arguments have the shape (v,).
    """
    order = np.lexsort((-count, -share, group))
    first = np.r_[True, np.diff(group[order]) != 0] if len(order) else np.zeros(0, bool)
    chosen = np.zeros(len(group), bool)
    chosen[order[first]] = True
    return chosen & (group > 0)
