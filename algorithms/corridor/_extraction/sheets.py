"""Wires above each other between two supports, found together by the shape they have in common.

Where wires are closer to each other than they sag, and points are few, an arc through points of
two of them fits as well as one through those of one. But all hang alike. So of all shapes that hang
between the two supports the one is taken by which most points come to lie level with each other;
then each level is a wire.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._curves.network import Corridor, Piece, own_radius
from algorithms.corridor._extraction.supports import Support
from algorithms.corridor._settings import SETTINGS

MOST_POINTS = 2000  # of a span that are looked at for its shape; of more, every other or third is

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def levels_of(
    corridor: Corridor, pieces: Sequence[Piece], ends: tuple[Support, Support]
) -> list[Catenary]:
    """Catenaries of the wires in one vertical plane between two supports.

    Parameters
    ----------
    pieces : of some of these wires, in whose plane they are looked for
    """
    place = np.array([(support.x, support.y) for support in ends])
    length = float(np.hypot(*(place[1] - place[0])))
    if length < SETTINGS.network.telling_length:
        return []
    way = (place[1] - place[0]) / length
    points, u = in_plane(corridor, pieces, place[0], way, length)
    if len(points) < SETTINGS.spans.found_points:
        return []
    z = corridor.wires.xyz[points, 2]
    rise = ends[1].low - ends[0].low
    flat, bend = levelled(u, z - rise * u / length, length, corridor.tolerance)
    found = []
    for own in levels(flat, corridor.tolerance):
        curve = fit(corridor.wires.xyz[points[own]], spread=corridor.own_radius, curvature=bend)
        eighths = len(np.unique((8 * u[own] / length).astype(np.int64)))
        if curve is not None and eighths >= SETTINGS.spans.found_eighths:
            found.append(curve)
    return found


def in_plane(
    corridor: Corridor, pieces: Sequence[Piece], start: Floats, way: Floats, length: float
) -> tuple[Ints, Floats]:
    """The points in the vertical plane of pieces between two supports, and where along it."""
    air = corridor.wires
    mine = np.unique(np.concatenate([piece.points for piece in pieces]))
    spots = start + np.arange(0.0, length + 1.0)[:, None] * way
    reach = 2 * SETTINGS.arcs.arm_aside
    box = np.union1d(air.within(spots, reach), mine)
    step = air.xyz[box, :2] - start
    u, v = step @ way, step[:, 1] * way[0] - step[:, 0] * way[1]
    inside = (u > 0) & (u < length) & ~corridor.refused[box]
    own = np.isin(box, mine) & inside
    if np.count_nonzero(own) < SETTINGS.spans.found_points:
        return box[:0], u[:0]
    v = v - np.polyval(np.polyfit(u[own], v[own], 1), u)
    z = air.xyz[box, 2]
    keep = inside & (np.abs(v) < corridor.own_radius)
    keep &= (z > z[own].min() - SETTINGS.arcs.tree_below) & (
        z < z[own].max() + SETTINGS.arcs.tree_below
    )
    return box[keep], u[keep]


def levelled(u: Floats, z: Floats, length: float, tolerance: float) -> tuple[Floats, float]:
    """Heights less those of the shape by which most of them are level, and its curvature.

    A parabola serves: over the span of such wires it is within centimetres of the catenary.

    Parameters
    ----------
    u, z : of the points, metres along the span and up
    """
    sags = np.arange(tolerance, SETTINGS.structures.bridge_sag * length, tolerance / 2)
    rises = np.arange(-SETTINGS.curves.clutter_radius, SETTINGS.curves.clutter_radius, tolerance)
    thin = slice(None, None, -(-len(u) // MOST_POINTS))
    x, y = u[thin] / length, z[thin]
    best, least = (0.0, 0.0), -1
    for sag in sags.tolist():
        flat = np.sort(y - rises[:, None] * x + 4 * sag * x * (1 - x), axis=1)
        for rise, row in zip(rises.tolist(), flat, strict=True):
            level = int(np.searchsorted(row, row + tolerance).sum())
            if level > least:
                best, least = (sag, rise), level
    sag, rise = best
    share = u / length
    return z - rise * share + 4 * sag * share * (1 - share), 8 * sag / length**2


def levels(flat: Floats, tolerance: float) -> list[Ints]:
    """Indices of the points of each level, the fullest first."""
    order = np.argsort(flat, kind="stable")
    found = []
    while len(order):
        rows = flat[order]
        count = np.searchsorted(rows, rows + own_radius(tolerance), side="right") - np.arange(
            len(rows)
        )
        first = int(np.argmax(count))
        if count[first] < SETTINGS.spans.found_points:
            break
        found.append(np.sort(order[first : first + count[first]]))
        middle = float(np.median(rows[first : first + count[first]]))
        order = order[np.abs(rows - middle) > own_radius(tolerance)]
    return found
