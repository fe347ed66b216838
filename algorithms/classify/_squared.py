"""Outlines of buildings with straight walls that meet at right angles where they nearly do.

The walls follow two main directions, square to each other, that the longest edges agree on. An edge
near one of them is turned into it unless that would move its ends too far: long walls keep the
direction that they have. A wall lies where its points are on average.

References
----------
Douglas, D. and Peucker, T. (1973). Algorithms for the reduction of the number of points required to
represent a digitized line. Cartographica 10(2), 112-122.
Sampath, A. and Shan, J. (2007). Building boundary tracing and regularization from airborne lidar
point clouds. Photogrammetric Engineering and Remote Sensing 73(7), 805-812: walls in two
directions.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.polygon import orient

NEAR = np.radians(25)  # edges that are turned into a main direction by at most this
AGREE = np.radians(10)  # edges at a larger angle do not speak for the same direction
SHORT = 4.0  # times the tolerance: slanted edges that are shorter are corners cut off, no walls
ROUND = 2.2  # times the radius of the disc: the same in inner corners, into which it does not get
ALONG, ACROSS, SLANTED = range(3)  # kinds of edges, by the main direction
PARALLEL = 1e-9  # sine of the angle between walls that meet nowhere

Floats = NDArray[np.float64]


class WallLimits(NamedTuple):
    """Distance of walls from an outline, and lengths below which edges only cut corners off."""

    tolerance: float
    outer: float
    inner: float

    @property
    def far(self) -> float:
        """Farthest a right-angled corner may be from the middle of the edge that cuts it off."""
        return self.inner / 2


class Wall(NamedTuple):
    """A straight wall.

    Attributes
    ----------
    kind : ALONG, ACROSS or SLANTED
    chain : array of shape (n, 2), the part of the outline that it stands for
    normal : array of shape (2,), square to the wall, of length 1
    away : how far from the origin it lies, along the normal
    """

    kind: int
    chain: Floats
    normal: Floats
    away: float

    @classmethod
    def of(cls, chain: Floats, kind: int) -> Wall:
        """The wall at the mean position of a piece of the outline, slanted ones as it lies."""
        middle, length = (chain[1:] + chain[:-1]) / 2, np.hypot(*np.diff(chain, axis=0).T)
        if kind == SLANTED:
            normal = _normal(chain)
        else:
            normal = np.array([0.0, 1.0] if kind == ALONG else [1.0, 0.0])
        return cls(kind, chain, normal, float(np.average(middle @ normal, weights=length)))

    def nearest(self, point: Floats) -> Floats:
        """The point on the line of a wall that is nearest to a point."""
        return np.asarray(point + (self.away - point @ self.normal) * self.normal)


def _normal(chain: Floats) -> Floats:
    """Square to the direction in which a piece of an outline is spread most, of length 1."""
    step = np.diff(chain, axis=0)
    length = np.hypot(*step.T)
    off = (chain[1:] + chain[:-1]) / 2
    off = off - np.average(off, axis=0, weights=length)
    spread = (off * length[:, None]).T @ off + (step * length[:, None]).T @ step / 12
    east, north = np.linalg.eigh(spread)[1][:, -1]
    return np.array([-north, east])


def squared(
    outline: Any, tolerance: float, disc: float = 0.0, angle: float | None = None
) -> tuple[Any, bool]:
    """An outline with straight walls and right angles; only simplified where these do not fit.

    Parameters
    ----------
    outline : shapely polygon
    tolerance : how far walls may be turned away from the outline, in its unit
    disc : radius of the disc that rolled around it, and cut inner corners off by up to 1.4 of that
    angle : of the main direction in radians; its own unless given

    Returns
    -------
    shapely polygon, valid; and whether its walls were squared
        Nothing of it is farther from the outline than a corner that was cut off.
    """
    outline = orient(outline)
    plain = outline.simplify(tolerance)
    if plain.is_empty or not plain.is_valid or plain.geom_type != "Polygon":
        return outline, False
    angle = main_direction(plain) if angle is None else angle
    limits = WallLimits(tolerance, SHORT * tolerance, max(SHORT * tolerance, ROUND * disc))
    made = [
        wall_corners(corners(ring), corners(few), angle, limits)
        for ring, few in zip(rings(outline), rings(plain), strict=True)
    ]
    if min(map(len, made)) < 3:
        return plain, False
    found = shapely.Polygon(made[0], made[1:])
    if not found.is_valid or found.hausdorff_distance(outline) > limits.far:
        return plain, False
    return found, True


def rings(polygon: Any) -> list[Any]:
    """The exterior and the holes of a polygon."""
    return [polygon.exterior, *polygon.interiors]


def corners(ring: Any) -> Floats:
    """Corners of a ring, each once, array of shape (n, 2)."""
    return np.asarray(ring.coords)[:-1]


def main_direction(polygon: Any) -> float:
    """Main direction of the edges by their lengths: radians, from 0 to 90 degrees."""
    steps = [np.diff(np.asarray(ring.coords), axis=0) for ring in rings(polygon)]
    edge = np.concatenate(steps) @ [1, 1j]
    length = np.abs(edge)
    turned = (edge / np.where(length > 0, length, 1)) ** 4  # equal for directions 90 degrees apart
    off = np.abs(np.angle(turned[:, None] / turned)) / 4
    agree = np.maximum(0, 1 - off / AGREE)
    best = agree[(agree @ length).argmax()]
    return float(np.angle((best * length * turned).sum()) / 4 % (np.pi / 2))


def wall_corners(ring: Floats, few: Floats, angle: float, limits: WallLimits) -> Floats:
    """Corners of a ring whose walls follow the main direction.

    Parameters
    ----------
    ring : corners of the outline, array of shape (n, 2), the building on the left
    few : those between which it is nearly straight, in the same order, array of shape (m, 2)
    angle : of the main direction, in radians
    limits : how far walls may be from the outline

    Returns
    -------
    array of shape (k, 2)
    """
    origin = ring.mean(axis=0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    edges = [(chain - origin) @ turn for chain in _chains(ring, few)]
    walls = _walls(edges, limits)
    found = [
        corner
        for one, other in zip(walls, walls[1:] + walls[:1], strict=True)
        for corner in _corners_between(one, other, limits.far)
    ]
    return np.asarray(np.array(found).reshape(-1, 2) @ turn.T + origin)


def _chains(ring: Floats, few: Floats) -> list[Floats]:
    """Pieces of a ring between consecutive ones of some of its corners, both included."""
    at = {tuple(corner): number for number, corner in enumerate(ring)}
    begins = [at[tuple(corner)] for corner in few]
    ends = [*begins[1:], begins[0]]
    count = len(ring)
    return [
        ring[np.arange(i, i + (j - i) % count + 1) % count]
        for i, j in zip(begins, ends, strict=True)
    ]


def _walls(edges: list[Floats], limits: WallLimits) -> list[Wall]:
    """Walls of a ring; edges in one line are joined, and those that cut corners left out."""
    kinds = [_kind(edge[-1] - edge[0], limits.tolerance) for edge in edges]
    walls: list[Wall] = []
    for k in _from_a_corner(kinds):
        if _cuts_a_corner(k, edges, kinds, limits):
            continue
        wall = Wall.of(edges[k], kinds[k])
        if walls and in_line(walls[-1], wall, limits.tolerance):
            walls[-1] = Wall.of(np.concatenate([walls[-1].chain, wall.chain]), wall.kind)
        else:
            walls.append(wall)
    return walls


def _cuts_a_corner(k: int, edges: list[Floats], kinds: list[int], limits: WallLimits) -> bool:
    """Whether an edge is no wall, but lies across the corner of the walls before and after it.

    Between square walls any slanted edge does that is near to their corner. Beside a slanted wall
    it has to turn the same way at both ends, and both walls have to be longer than it and than any
    cut: the edges of an arc are not.
    """
    others = k - 1, (k + 1) % len(edges)
    before, step, after = (edges[i][-1] - edges[i][0] for i in (others[0], k, others[1]))
    turns = _turn(before, step), _turn(step, after)
    limit = limits.outer if np.linalg.det([before, after]) > 0 else limits.inner
    length = np.hypot(*step)
    are_square = SLANTED not in (kinds[others[0]], kinds[others[1]])
    if are_square and kinds[others[0]] == kinds[others[1]]:
        return bool(kinds[k] == SLANTED and length < limit)
    meeting = _meeting(*(Wall.of(edges[i], kinds[i]) for i in others))
    if meeting is None or _from_chord(meeting, edges[k]) >= limit / 2:
        return False
    if are_square:
        return kinds[k] == SLANTED
    walls = min(np.hypot(*before), np.hypot(*after))
    return bool(turns[0] * turns[1] > 0 and walls > max(length, limit))


def _turn(step: Floats, after: Floats) -> float:
    """Angle by which an edge turns from the one before, to the left, in radians."""
    return float(np.arctan2(np.linalg.det([step, after]), step @ after))


def in_line(one: Wall, other: Wall, tolerance: float) -> bool:
    """Whether two walls have one direction and are within the tolerance of one line."""
    alike = one.kind == other.kind != SLANTED
    return alike and abs(one.away - other.away) <= tolerance


def _kind(step: Floats, tolerance: float) -> int:
    """Kind of an edge: ALONG the main direction, ACROSS it, or SLANTED."""
    off = abs(np.arctan2(step[1], step[0]))
    for kind, turned in ((ALONG, min(off, np.pi - off)), (ACROSS, abs(off - np.pi / 2))):
        if turned <= NEAR and np.hypot(*step) / 2 * np.sin(turned) <= tolerance:
            return kind
    return SLANTED


def _from_a_corner(kinds: list[int]) -> list[int]:
    """Indices of the edges of a ring, starting at one whose kind differs from that before it."""
    count = len(kinds)
    first = next((k for k in range(count) if kinds[k] != kinds[k - 1]), 0)
    return [k % count for k in range(first, first + count)]


def _corners_between(one: Wall, other: Wall, far: float) -> list[Floats]:
    """The corner where two walls meet; two corners, a step, if that is far from their ends."""
    ends = np.array([one.chain[-1], other.chain[0]])
    meeting = _meeting(one, other)
    if meeting is not None and _from_chord(meeting, ends) <= far:
        return [meeting]
    middle = ends.mean(axis=0)
    return [one.nearest(middle), other.nearest(middle)]


def _from_chord(place: Floats, chain: Floats) -> float:
    """Distance of a place from the straight line between the ends of a piece of an outline."""
    return float(shapely.distance(shapely.Point(place), shapely.LineString(chain[[0, -1]])))


def _meeting(one: Wall, other: Wall) -> Floats | None:
    """Where the lines of two walls meet, unless they are parallel."""
    both = np.array([one.normal, other.normal])
    if abs(np.linalg.det(both)) <= PARALLEL:
        return None
    return np.asarray(np.linalg.solve(both, [one.away, other.away]))
