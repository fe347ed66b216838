"""Probabilities that neighbours share, without blurring what single points know better.

What kind of object a point belongs to is a matter of all points around it: a façade with a few
points like leaves is a façade. Whether it is ground is not, nor how high a plant is; to average
these would take the edge off every kerb and hedge. So ground stays as it is, and with it the edge
between ground and objects; all others share the chances of kinds, of which low, medium and high
vegetation are one.

References
----------
Schindler, K. (2012). An overview and comparison of smooth labeling methods for land-cover
classification. IEEE Transactions on Geoscience and Remote Sensing 50(11), 4534-4545: filters of
probabilities beside graph cuts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._evidence import means_around

GROUND = 2
VEGETATION = (3, 4, 5)  # differ by their height alone
CELLS = 3  # along a radius: 123 cells are nearly a ball
LARGEST = 10.0  # metres, of a radius

Floats = NDArray[np.float64]


def smoothed(chance: Floats, classes: NDArray[np.uint8], xyz: Floats, radius: float) -> Floats:
    """Probabilities whose kinds are means over the neighbours that are not ground.

    Each neighbour weighs as much as it is probably no ground. Points are counted in cells of a
    third of the radius, from the origin of the coordinates on, and sums are exact: so neither the
    order of the points matters nor those beyond the radius and a cell.

    Parameters
    ----------
    chance : of each class, array of shape (n, k)
    classes : codes, array of shape (k,)
    xyz : array of shape (n, 3)
    radius : in the unit of xyz

    Returns
    -------
    array of shape (n, k)

    Examples
    --------
    A point among three that are building; all are as probably ground as before:

    >>> chance = np.array([[0.1, 0.5, 0.4], *[[0.1, 0.1, 0.8]] * 3])
    >>> smoothed(chance, np.array([2, 5, 6], np.uint8), np.zeros((4, 3)), 1.0)[0].round(2).tolist()
    [0.1, 0.2, 0.7]
    """
    rest = classes != GROUND
    kind = np.where(np.isin(classes, VEGETATION), VEGETATION[0], classes)[rest]
    _, of_class, size = np.unique(kind, return_inverse=True, return_counts=True)
    own = np.column_stack([chance[:, rest][:, of_class == k].sum(axis=1) for k in range(len(size))])
    shared = means_around(xyz / (radius / CELLS), np.zeros(len(xyz), bool), own, CELLS)
    total = shared.sum(axis=1, keepdims=True)
    known, own_of_class = total[:, 0] > 0, own[:, of_class]
    share = np.tile(1.0 / size[of_class], (len(xyz), 1))  # of a class in its kind
    np.divide(chance[:, rest], own_of_class, out=share, where=own_of_class > 0)
    found, objects = chance.copy(), own.sum(axis=1, keepdims=True)[known]
    given = objects * share[known] * (shared / total.clip(1e-9))[known][:, of_class]
    found[np.ix_(known, rest)] = given
    return found
