"""Points of wires that scatter farther than all others, and so hang alone in the air beside them.

Of points that scatter by the normal law one in a hundred is farther off than those that are taken
for a wire's, and errors of surveys are larger still. What else is so near a wire, a plant above
all, holds on to others of its kind.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.corridor._curves.network import Corridor, own_radius
from algorithms.corridor._extraction.spans import Wire
from algorithms.corridor._settings import SETTINGS
from algorithms.shared.clusters import dbscan

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def strays_of(corridor: Corridor, wires: Sequence[Wire], of_line: NDArray[np.bool_]) -> Ints:
    """The wire of each of the n points in the air that is alone beside one; -1 for all others.

    Alone is what has no others in its company but those of the line, and fewer strays than would
    tell of something that is there. It is within the radius that is the wire's own.

    Parameters
    ----------
    of_line : array of shape (n,), which points are known to be of wires and towers
    """
    gap = SETTINGS.points.company_side
    nearest, away = np.full(len(of_line), -1), np.full(len(of_line), np.inf)
    around = np.zeros(len(of_line), bool)
    for number, wire in enumerate(wires):
        own = own_radius(wire.tolerance)
        near, distance = corridor.air.around(wire.curve, own + gap)
        around[near] = True
        nearer = (distance < own) & (distance < away[near])
        nearest[near[nearer]], away[near[nearer]] = number, distance[nearer]
    around &= ~of_line
    close = np.flatnonzero(around & (nearest >= 0))
    others = corridor.air.xyz[around & (nearest < 0)]
    which = np.full(len(of_line), -1)
    if len(close):
        chain = dbscan(corridor.air.xyz[close], gap, 1)
        of_wire = np.zeros((chain.max() + 1, len(wires)), np.int64)
        np.add.at(of_wire, (chain, nearest[close]), 1)
        many = of_wire.max(axis=1) >= SETTINGS.sparse.company
        held = within(corridor.air.xyz[close], others, gap)
        alone = ~many & (np.bincount(chain, held) == 0)
        which[close[alone[chain]]] = nearest[close[alone[chain]]]
    return which


def within(xyz: Floats, others: Floats, gap: float) -> NDArray[np.bool_]:
    """Which of n points have one of the others within a gap."""
    if not len(others):
        return np.zeros(len(xyz), bool)
    return np.asarray(cKDTree(others).query(xyz, distance_upper_bound=gap)[0] < gap)
