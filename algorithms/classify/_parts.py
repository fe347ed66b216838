"""Parts of a building at different heights, which tile its outline.

Sections of the roof, between the steps of its surface, are one part unless their mean heights
differ by 2 m or more. The outline is cut along straight lines, which are the walls of the parts
between the roofs; each piece goes to the part that most of its points belong to. So parts share
their borders, and leave no gap.

References
----------
Biljecki, F., Ledoux, H. and Stoter, J. (2016). An improved LOD specification for 3D building
models. Computers, Environment and Urban Systems 59, 25-37: LoD1.3, blocks of different heights in
one building.
Vosselman, G. and Dijkman, S. (2001). 3D building model reconstruction from point clouds and ground
plans. ISPRS Archives 34(3/W4), 37-44: an outline is cut by lines along the steps of the roof.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from algorithms.classify._outlines import without_spikes
from algorithms.classify._roofs import ROOF, Roof, sections
from algorithms.classify._squared import SHORT, rings

JUMP = 2.0  # metres between the mean heights of parts beside each other, at least
TOUCH = 1e-6  # of the unit: pieces that share less of their borders meet at a corner

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Shapes = NDArray[Any]


def levels(roof: Roof, spacing: float) -> Ints:
    """Number of the level of each point of a roof, from 0; -1 for points of none.

    Parameters
    ----------
    roof : n points that are no walls
    spacing : metres between the points

    Returns
    -------
    array of shape (n,)
        Sections of at least 10 m² that lie beside each other, and whose mean heights differ by
        less than 2 m, are one level. Smaller ones, such as dormers, are of none.
    """
    found = sections(roof, spacing)
    large = np.flatnonzero(found.areas >= ROOF)
    if len(large) < 2:
        return np.zeros(len(roof.xyz), np.int64)
    counted = np.full(len(found.areas) + 1, -1)  # the last for points below the surface
    counted[large] = np.arange(len(large))
    own = counted[found.of_points]
    height = np.array([roof.xyz[own == k, 2].mean() for k in range(len(large))])
    cells = counted[found.number]
    nearest = distance_transform_edt(cells < 0, return_distances=False, return_indices=True)
    level = merged(height, found.areas[large], _beside(cells[tuple(nearest)], len(large)))
    return np.where(own >= 0, level[own], -1)


def _beside(cells: Ints, count: int) -> Floats:
    """How many cells of one number lie beside those of another, array of shape (count, count)."""
    shared = np.zeros((count, count))
    for one, other in ((cells[:-1], cells[1:]), (cells[:, :-1], cells[:, 1:])):
        np.add.at(shared, (one.ravel(), other.ravel()), 1.0)
    return shared + shared.T


def merged(height: Floats, area: Floats, border: Floats) -> Ints:
    """Number of the part of each piece, where those too alike or too small are joined to others.

    Of the pieces beside each other that are less than 2 m apart in height, or one of which is
    smaller than 10 m², those nearest in height are joined first.

    Parameters
    ----------
    height : mean of each piece, array of shape (m,), metres
    area : of each, array of shape (m,), m²
    border : how much of their borders they share, array of shape (m, m)

    Returns
    -------
    array of shape (m,), from 0

    Examples
    --------
    >>> border = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]])
    >>> merged(np.array([5.0, 6.0, 9.0]), np.array([50.0, 50.0, 50.0]), border)
    array([0, 0, 1])
    """
    height, area, border = height.copy(), area.copy(), border.astype(np.float64)
    part = np.arange(len(height))
    while True:
        np.fill_diagonal(border, 0.0)
        small, apart = area < ROOF, np.abs(height[:, None] - height)
        join = (border > 0) & ((apart < JUMP) | small | small[:, None])
        if not join.any():
            return np.unique(part, return_inverse=True)[1]
        i, j = np.unravel_index(np.where(join, apart, np.inf).argmin(), apart.shape)
        height[i] = np.average(height[[i, j]], weights=np.maximum(area[[i, j]], TOUCH))
        area[i] += area[j]
        border[i] += border[j]
        border[:, i] += border[:, j]
        border[j] = border[:, j] = 0.0
        part[part == j] = i


class Part(NamedTuple):
    """A part of a building.

    Attributes
    ----------
    shape : shapely polygon
    own : array of shape (n,), which points of the roof of the building are those of its level
    """

    shape: Any
    own: Mask


def tiles(
    outline: Any,
    xyz: Floats,
    level: Ints,
    drawn: list[Any],
    *,
    tolerance: float,
    width: float,
    metre: float,
) -> list[Part]:
    """Parts of a building, the polygons of which share corners and together are its outline.

    Parameters
    ----------
    outline : shapely polygon
    xyz : points of the roof, array of shape (n, 3), in the unit of the outline
    level : of each, array of shape (n,), -1 for none
    drawn : outlines of the levels, the highest first
    tolerance : distance in which walls are one, and no wall beside that of the outline
    width : below which nothing is a part, or a piece of one
    metre : length of one metre in the unit
    """
    faces = _faces(outline, _walls(outline, drawn, tolerance))
    points = np.asarray(shapely.points(xyz[:, :2]))
    face = _holding(faces, points)
    voted = _of_wide(_voted(faces, face, points, level), faces, width)
    own = (face >= 0) & (level >= 0) & (level == voted[face])
    pieces = _joined(faces, voted)
    if len(pieces) == 1:
        return [Part(outline, own)]
    of_face = _holding(pieces, shapely.point_on_surface(faces))
    piece = np.where(own, of_face[face], -1)
    seen = np.bincount(piece[own], minlength=len(pieces)) > 0
    height = [float(xyz[piece == k, 2].mean()) if seen[k] else 0.0 for k in range(len(pieces))]
    area = np.where(seen, shapely.area(pieces) / metre**2, 0.0)
    part = merged(np.array(height) / metre, area, _shared(pieces))
    shapes = _joined(pieces, part)
    if len(shapes) == 1:
        return [Part(outline, own)]
    number = _holding(shapes, shapely.point_on_surface(pieces))  # while they are where they were
    shapes = shapely.coverage_simplify(shapes, 2 * tolerance, simplify_boundary=False)
    shapes = shapely.coverage_simplify(shapes, TOUCH)  # corners where lines met the outline
    return [Part(shape, own & (number[piece] == k)) for k, shape in enumerate(shapes)]


def _walls(outline: Any, drawn: list[Any], tolerance: float) -> list[Any]:
    """Straight lines through the outline: along walls between parts, and on from its own walls.

    Of walls in one line that of the highest part counts, and of its own the longest: where a roof
    ends is seen from above, but not what is below it.
    """
    inner = outline.buffer(-tolerance)
    lines: list[Any] = []
    for shape in drawn:
        for edge in _long_edges(shape, SHORT * tolerance):
            ends = np.asarray(shapely.points(edge))
            within = shapely.intersection(shapely.LineString(edge), inner).length
            known = any(shapely.distance(line, ends).max() <= tolerance for line in lines)
            if within >= SHORT * tolerance and not known:
                lines.append(_longer(edge, outline))
    for edge in _long_edges(outline.simplify(tolerance), SHORT * tolerance):
        far = shapely.get_coordinates(_longer(edge, outline))
        lines += [shapely.LineString([one, other]) for one, other in zip(edge, far, strict=True)]
    return lines


def _long_edges(polygon: Any, least: float) -> list[Floats]:
    """Edges of a polygon from a length on, the longest first, arrays of shape (2, 2)."""
    edges = [np.array(e) for ring in rings(polygon) for e in pairwise(ring.coords)]
    lengths = np.array([np.hypot(*(edge[1] - edge[0])) for edge in edges])
    order = np.argsort(-lengths, kind="stable")
    return [edges[k] for k in order if lengths[k] >= least]


def _longer(edge: Floats, outline: Any) -> Any:
    """The line of an edge through all of an outline."""
    xmin, ymin, xmax, ymax = outline.bounds
    step = edge[1] - edge[0]
    along = step / np.hypot(*step) * np.hypot(xmax - xmin, ymax - ymin)
    return shapely.LineString([edge[0] - along, edge[1] + along])


def _faces(outline: Any, lines: list[Any]) -> Shapes:
    """The polygons into which lines cut an outline."""
    network = shapely.union_all([outline.boundary, *lines])
    faces = shapely.get_parts(shapely.polygonize([network]))
    return np.asarray(faces[shapely.contains(outline, shapely.point_on_surface(faces))])


def _holding(shapes: Shapes, points: Shapes) -> Ints:
    """Number of the polygon that holds each point, -1 for none; on a border one of them."""
    point, shape = shapely.STRtree(shapes).query(points, predicate="intersects")
    found = np.full(len(points), -1)
    found[point] = shape
    return found


def _voted(faces: Shapes, face: Ints, points: Shapes, level: Ints) -> Ints:
    """Level of each face: that of most of its points, or of the nearest one to an empty face."""
    known = level >= 0
    votes = np.zeros((len(faces), int(level.max()) + 1))
    counted = known & (face >= 0)
    np.add.at(votes, (face[counted], level[counted]), 1)
    empty = ~votes.any(axis=1)
    nearest = shapely.STRtree(points[known]).nearest(shapely.point_on_surface(faces[empty]))
    voted = votes.argmax(axis=1)
    voted[empty] = level[known][nearest]
    return np.asarray(voted)


def _of_wide(voted: Ints, faces: Shapes, width: float) -> Ints:
    """Level of each face, where what is narrower than a width takes that of the face along it.

    Between the wall of a part and the outline beside it there may be a strip, which would join
    parts that have nothing in common.
    """
    wide = np.zeros(len(faces), bool)
    places = shapely.point_on_surface(faces)
    for k in np.unique(voted):
        of_level = without_spikes(_joined(faces[voted == k], voted[voted == k]), width)
        wide |= (voted == k) & shapely.intersects(shapely.union_all(of_level), places)
    along = _shared(faces)[:, wide]
    if not wide.any():
        return voted
    best = voted[wide][along.argmax(axis=1)]
    return np.where(wide | ~along.any(axis=1), voted, best)


def _joined(shapes: Shapes, number: Ints) -> Shapes:
    """Polygons of shapes that lie beside each other and have one number."""
    return np.concatenate(
        [shapely.get_parts(shapely.union_all(shapes[number == k])) for k in np.unique(number)]
    )


def _shared(shapes: Shapes) -> Floats:
    """Length of the borders that polygons share, array of shape (m, m)."""
    one, other = shapely.STRtree(shapes).query(shapes, predicate="touches")
    length = shapely.length(shapely.intersection(shapes[one], shapes[other]))
    border = np.zeros((len(shapes), len(shapes)))
    border[one, other] = np.where(length > TOUCH, length, 0.0)
    return border
