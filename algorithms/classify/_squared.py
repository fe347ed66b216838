"""Outlines of buildings with straight walls that meet at right angles where they nearly do.

The walls follow two main directions, square to each other, that the longest edges agree on. Edges
near them are turned into them, and neighbours of one direction become one wall; others stay as they
are. A wall lies where its points are on average.

References
----------
Douglas, D. and Peucker, T. (1973). Algorithms for the reduction of the number of points required to
represent a digitized line. Cartographica 10(2), 112-122.
Sampath, A. and Shan, J. (2007). Building boundary tracing and regularization from airborne lidar
point clouds. Photogrammetric Engineering and Remote Sensing 73(7), 805-812: walls in two
directions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

NEAR = np.radians(25)  # edges that are turned into a main direction by at most this
ALIKE = 0.85  # IoU with the outline below which it is left as it was
SHORT = 4.0  # times the tolerance: slanted edges that are shorter are no walls
SLANTED, CUT = 2, 3  # kinds of edges beside 0, along the main direction, and 1, across it
PARALLEL = 1e-3  # sine of the angle between walls that meet nowhere near

Floats = NDArray[np.float64]


def squared(outline: Any, tolerance: float) -> tuple[Any, bool]:
    """An outline with straight walls, or without unnecessary corners if that does not fit.

    Parameters
    ----------
    outline : shapely polygon
    tolerance : how far the walls may be from the outline, roughly, in its unit

    Returns
    -------
    shapely polygon, valid; and whether its walls were squared
    """
    plain = outline.simplify(tolerance)
    if plain.is_empty or not plain.is_valid or plain.geom_type != "Polygon":
        return outline, False
    angle = main_direction(plain)
    short = SHORT * tolerance
    shells = [wall_corners(np.asarray(ring.coords)[:-1], angle, short) for ring in rings(plain)]
    if shells[0] is None:
        return plain, False
    made = shapely.Polygon(shells[0], [hole for hole in shells[1:] if hole is not None])
    if not made.is_valid:
        return plain, False
    shared = made.intersection(outline).area
    alike = shared / (made.area + outline.area - shared)
    return (made, True) if alike >= ALIKE else (plain, False)


def rings(polygon: Any) -> list[Any]:
    """The outer ring, and the holes."""
    return [polygon.exterior, *polygon.interiors]


def main_direction(polygon: Any) -> float:
    """Angle in radians, from 0 to 90 degrees, that the edges agree on best, by their lengths."""
    steps = [np.diff(np.asarray(ring.coords), axis=0) for ring in rings(polygon)]
    edge = np.concatenate(steps) @ [1, 1j]
    length = np.abs(edge)
    turned = (edge / np.where(length > 0, length, 1)) ** 4  # equal for directions 90 degrees apart
    return float(np.angle((length * turned).sum()) / 4 % (np.pi / 2))


def wall_corners(corners: Floats, angle: float, short: float = 0.0) -> Floats | None:
    """Corners of a ring whose walls follow the main direction; None if no ring is left.

    Parameters
    ----------
    corners : array of shape (n, 2), each once
    angle : of the main direction, in radians
    short : slanted edges below this length are corners cut off, or steps between parallel walls
    """
    origin = corners.mean(axis=0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    start = (corners - origin) @ turn
    edge = np.roll(start, -1, axis=0) - start
    kinds = _without_cut_corners([_kind(step) for step in edge], np.hypot(*edge.T) < short)
    kept = np.flatnonzero(np.array(kinds) != CUT)
    start, edge, kinds = start[kept], edge[kept], [kinds[k] for k in kept]
    walls = [_wall(start[run], edge[run], kinds[run[0]]) for run in _runs(kinds)]
    if len(walls) < 4:
        return None
    found = []
    for (normal, away), (other, farther) in zip(walls, walls[1:] + walls[:1], strict=True):
        both = np.array([normal, other])
        if abs(np.linalg.det(both)) < PARALLEL:
            return None
        found.append(np.linalg.solve(both, [away, farther]))
    return np.asarray(np.array(found) @ turn.T + origin)


def _without_cut_corners(kinds: list[int], is_short: NDArray[np.bool_]) -> list[int]:
    """Short slanted edges between two walls go, or become the step from one to the other."""
    made = list(kinds)
    for k in np.flatnonzero(is_short):
        before, after = kinds[k - 1], kinds[(k + 1) % len(kinds)]
        if kinds[k] == SLANTED and SLANTED not in (before, after):
            made[k] = CUT if before != after else 1 - before
    return made


def _kind(step: Floats) -> int:
    """0 along the main direction, 1 across it, or SLANTED."""
    off = abs(np.arctan2(step[1], step[0]))
    if min(off, np.pi - off) <= NEAR:
        return 0
    return 1 if abs(off - np.pi / 2) <= NEAR else SLANTED


def _runs(kinds: list[int]) -> list[list[int]]:
    """Numbers of edges that make one wall: neighbours in one main direction."""
    count = len(kinds)
    begins = [i for i in range(count) if kinds[i] == SLANTED or kinds[i] != kinds[i - 1]]
    if not begins:
        return []
    ends = [*begins[1:], begins[0] + count]
    return [[k % count for k in range(i, j)] for i, j in zip(begins, ends, strict=True)]


def _wall(start: Floats, edge: Floats, kind: int) -> tuple[Floats, float]:
    """Normal of a wall, and how far from the origin it lies, where its edges are on average."""
    length = np.hypot(*edge.T)
    if kind == SLANTED:
        normal = np.array([-edge[0, 1], edge[0, 0]]) / length[0]
    else:
        normal = np.array([0.0, 1.0] if kind == 0 else [1.0, 0.0])
    middle = start + edge / 2
    return normal, float(np.average(middle @ normal, weights=length))
