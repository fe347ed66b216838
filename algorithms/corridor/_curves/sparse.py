"""Wires with a few points each, found together where so many on parallel arcs are no accident.

Where a wire has a point in several metres, none can be followed. But its points lie on an arc in a
vertical plane, the points of the wires beside it on the same arc moved, and there is little else in
the air. So for each point that stands alone, arcs from it to others around are tried. How many
points would lie by chance on the arc, and on groups beside it, is known from how many there are
around: an arc is taken if by chance a hundredth of one as unlikely is expected among all that were
tried, which is called a contrario (Desolneux, Moisan and Morel 2000). How many points suffice
follows from that.

References
----------
Desolneux, A., Moisan, L. and Morel, J.-M. (2000). Meaningful alignments. International Journal of
Computer Vision 40(1), 7-23: the number of false alarms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.corridor._curves import sparse_kernels as kernels
from algorithms.corridor._curves.catenary import fit
from algorithms.corridor._curves.network import Corridor, Piece
from algorithms.corridor._settings import SETTINGS
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import blocks
from toolbox.context import Context

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


def sparse_wires(corridor: Corridor, pieces: Sequence[Piece], ctx: Context) -> list[Piece]:
    """Pieces of wires that are too sparse to be followed, in the order of how sure they are.

    Parameters
    ----------
    pieces : of wires that were followed, whose points are left out
    """
    free = np.ones(len(corridor.wires.xyz), bool)
    for piece in pieces:
        free[corridor.wires.around(piece.curve, corridor.own_radius)[0]] = False
    own = np.flatnonzero(free)
    return wires_of(corridor, own[lonely(corridor, own, SETTINGS.sparse.company)], ctx)


def stacked_wires(corridor: Corridor, ctx: Context) -> list[Piece]:
    """The same of wires above each other, which tell where stacks of such wires are."""
    own = np.arange(len(corridor.wires.xyz))
    own = own[lonely(corridor, own, SETTINGS.sparse.stack_company)]
    own = own[in_sheets(corridor, own)]
    return wires_of(corridor, own, ctx)


def wires_of(corridor: Corridor, own: Ints, ctx: Context) -> list[Piece]:
    """Pieces of wires among some of the points that may be wire."""
    if len(own) < 3:
        return []
    xyz = np.ascontiguousarray(corridor.wires.xyz[own])
    near = cKDTree(xyz).query(xyz, k=range(2, min(SETTINGS.sparse.neighbours, len(xyz)) + 1))[1]
    near = np.ascontiguousarray(near)
    found = []
    for points, bend, sure in groups(xyz, near, corridor.tolerance, ctx):
        curve = fit(xyz[points], spread=corridor.own_radius, curvature=bend)
        if curve is not None:
            corridor.proven[corridor.wires.order[own[points]]] = True
            found.append(Piece(np.sort(own[points]), curve, sure))
    return found


def room() -> float:
    """Metres around a point, in which what stands alone has few others."""
    return SETTINGS.points.company_side


def lonely(corridor: Corridor, own: Ints, company: int) -> Mask:
    """Which of some points that may be wire have at most so many others in the air around them."""
    others = company + 2  # itself, and one more
    if len(corridor.air.xyz) < others:
        return np.ones(len(own), bool)
    away = corridor.air.tree.query(corridor.wires.xyz[own], k=[others])[0]
    return np.asarray(away)[:, 0] > room()


def in_sheets(corridor: Corridor, own: Ints) -> Mask:
    """Which of some points lie with those around them in one vertical plane, but not on one wire.

    So lie those of wires above each other, and none of a crown.
    """
    if len(own) < 3:
        return np.zeros(len(own), bool)
    xyz = corridor.wires.xyz[own]
    most = min(SETTINGS.sparse.stack_company + 1, len(own))
    away, near = cKDTree(xyz).query(xyz, k=range(1, most + 1))
    weight = (np.asarray(away) < room()).astype(np.float64)[..., None]
    count = weight.sum(axis=1)
    step = weight * (xyz[np.asarray(near)] - xyz[:, None])
    step -= weight * (step.sum(axis=1) / count)[:, None]
    spread = np.einsum("nki,nkj->nij", step, step) / count[..., None]
    across = np.linalg.eigvalsh(spread[:, :2, :2])[:, 0]
    up = np.linalg.eigvalsh(spread)[:, 1]
    return np.asarray((across < corridor.tolerance**2) & (up > corridor.tolerance**2))


def groups(xyz: Floats, near: Ints, radius: float, ctx: Context) -> list[tuple[Ints, float, bool]]:
    """Points of each wire, its curvature, and whether it is sure by itself.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    near : array of shape (n, k), the points around each
    radius : how far a point may be from its wire, metres
    """
    reach, steps = SETTINGS.sparse.reach, SETTINGS.sparse.steps
    ring, inner = SETTINGS.sparse.ring * radius, SETTINGS.sparse.ring**-2
    shape = (
        radius,
        reach,
        ring,
        inner,
        SETTINGS.trace.shortest_curve,
        SETTINGS.trace.steepest,
        SETTINGS.structures.bridge_sag,
        1 / SETTINGS.curves.largest_c,
        1 / SETTINGS.curves.smallest_c,
    )
    count = len(xyz)
    used = np.zeros(count, bool)
    score, bend = np.zeros(count), np.zeros(count)
    other, tests = np.full(count, -1), np.zeros(count, np.int64)
    made = (xyz, near, used, shape, steps, score, other, bend, tests)
    side_by_side(kernels.search, blocks(count, 200), np.arange(count), *made, ctx=ctx)
    sure = math.log(SETTINGS.sparse.false_alarms)
    enough = sure - math.log(max(1, int(tests.sum())))
    u, v, w = (np.empty(near.shape[1] + 1) for _ in range(3))
    index, taken = (np.empty(near.shape[1] + 1, np.int64) for _ in range(2))
    proof = np.zeros(kernels.MOST_WIRES)
    found = []
    for seed in np.lexsort((np.arange(count), score)).tolist():
        if score[seed] > enough:
            break
        if used[seed]:
            continue
        if used[other[seed]]:
            side_by_side(kernels.search, [(0, 1)], np.array([seed]), *made)
            if score[seed] > enough:
                continue
        n, length = kernels.moved(
            seed, other[seed], bend[seed], near[seed], xyz, used, reach, u, v, w, index
        )
        around = (radius, reach, ring, inner, steps)
        if kernels.evidence(v, w, u, n, length, *around, taken, proof) > enough:
            continue
        for number in range(1, int(taken[:n].max()) + 1):
            points = index[:n][taken[:n] == number]
            used[points] = True
            found.append((points, float(bend[seed]), number == 1 or proof[number - 1] < sure))
    return found
