"""Clusters of points in space: what is dense and connected, or dense for its surroundings.

References
----------
Ester, M., Kriegel, H.-P., Sander, J. and Xu, X. (1996). A density-based algorithm for discovering
clusters in large spatial databases with noise. KDD, 226-231: DBSCAN.
Campello, R., Moulavi, D. and Sander, J. (2013). Density-based clustering based on hierarchical
density estimates. PAKDD, 160-172: HDBSCAN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.cells import SortedCells
from algorithms.shared.kernels import clusters as kernels
from algorithms.shared.kernels.threads import side_by_side
from toolbox.context import QUIET, Context

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def dbscan(xyz: Floats, radius: float, enough: int, *, ctx: Context = QUIET) -> Ints:
    """Number of the cluster of each point, from 1; 0 for points of none.

    Core points have at least `enough` points, themselves among them, no farther than `radius`; core
    points within the radius of each other are of one cluster. Other points within the radius of a
    core point belong to the cluster of the nearest one, so that the order of the points does not
    matter (Ester et al. give them to the cluster that is found first).

    Parameters
    ----------
    xyz : array of shape (n, 3)
    radius : in the unit of xyz
    enough : with 1 all points within the radius of each other are of one cluster

    Returns
    -------
    array of shape (n,)
        Numbers follow the first core point of each cluster by x, y, z.

    Examples
    --------
    >>> xyz = np.array([[9, 0, 0], [0, 0, 0], [0.5, 0, 0], [1, 0, 0.0]])
    >>> dbscan(xyz, 0.6, 2).tolist()
    [0, 1, 1, 1]
    """
    cells = SortedCells.of(xyz, radius)
    layout = (cells.xyz, cells.key, cells.start, cells.stride, radius)
    is_core, nearest = np.zeros(len(xyz), bool), np.empty(len(xyz), np.int64)
    side_by_side(kernels.dense, cells.runs, *layout, enough, is_core, ctx=ctx.part(0.0, 0.4))
    parent = np.arange(len(xyz))
    kernels.join(*layout, is_core, parent)
    ctx.progress(0.8)
    side_by_side(kernels.border, cells.runs, *layout, is_core, nearest, ctx=ctx.part(0.8, 1.0))
    root = np.where(is_core, parent, np.where(nearest < 0, -1, parent[nearest]))
    found = np.empty(len(xyz), np.int64)
    found[cells.order] = root
    core = np.empty(len(xyz), bool)
    core[cells.order] = is_core
    return _in_order(xyz, found, core)


def hdbscan(xyz: Floats, enough: int) -> Ints:
    """The same by HDBSCAN of scikit-learn, for clusters of different densities.

    Its time grows with the square of the number of points. Points are sorted beforehand, so that
    their order does not matter.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    enough : points of the smallest cluster, at least 2

    Examples
    --------
    >>> two = np.add.outer(np.array([0.0, 50.0]), np.linspace(0, 1, 20) ** 2).reshape(-1, 1)
    >>> np.unique(hdbscan(np.hstack([two, two, two]), 5)[[0, 1, 20, 21]]).tolist()
    [1, 2]
    """
    from sklearn.cluster import HDBSCAN

    if len(xyz) < max(enough, 2):
        return np.zeros(len(xyz), np.int64)
    order = np.lexsort(xyz.T[::-1])
    made = HDBSCAN(min_cluster_size=enough, copy=True).fit(xyz[order] - xyz[order[0]])
    label = np.empty(len(xyz), np.int64)
    label[order] = made.labels_
    return _in_order(xyz, label, label >= 0)


def _in_order(xyz: Floats, label: Ints, counted: NDArray[np.bool_]) -> Ints:
    """Numbers from 1 in the order of the first counted point of each; 0 for labels below 0."""
    index = np.flatnonzero(counted)
    index = index[np.lexsort(xyz[index].T[::-1])]
    names, first = np.unique(label[index], return_index=True)
    number = np.zeros(int(label.max(initial=0)) + 2, np.int64)
    number[names[np.argsort(first)]] = np.arange(1, len(names) + 1)
    return np.where(label >= 0, number[label], 0)
