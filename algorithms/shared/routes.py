"""Lines as segments: positions along them, and the nearest position on another line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shared.kernels.threads import in_blocks
from toolbox.context import QUIET, Context
from toolbox.errors import DataError

BLOCK = 20_000  # positions between two checks for cancellation
MOST_NODES = 20_000_000  # more are taken for a mistake in the step
AT_END = 1e-9  # share of a segment: a foot this close to its end is at the vertex

Array = NDArray[np.float64]
Shapes = NDArray[Any]  # of shapely geometries
Indices = NDArray[np.int64]


class Route(NamedTuple):
    """Lines of a layer as nodes; consecutive nodes of a line are joined by a segment.

    Attributes
    ----------
    nodes : array of shape (n, 3), x, y and z (NaN if not known)
    line : array of shape (n,), number of the line
    chainage : array of shape (n,), length along the line, in the plane
    closed : array of shape (lines,), whether each line ends where it begins

    Examples
    --------
    >>> route = Route.of([np.array([[0.0, 0, 5], [3, 4, 5], [3, 10, 5]])])
    >>> route.length, route.divided(1.0).nodes.shape
    (11.0, (12, 3))
    """

    nodes: Array
    line: Indices
    chainage: Array
    closed: NDArray[np.bool_]

    @classmethod
    def of(cls, lines: Sequence[Array]) -> Route:
        """Build from the vertices of lines, of shape (k, 3) each, no two consecutive ones equal."""
        nodes = np.vstack(lines)
        line = np.repeat(np.arange(len(lines)), [len(vertices) for vertices in lines])
        closed = np.array([(v[0, :2] == v[-1, :2]).all() for v in lines], bool)
        return cls(nodes, line, chainages(nodes, line), closed)

    @property
    def begins(self) -> Indices:
        """Index of the node at which each segment begins; it ends at the next node."""
        return np.flatnonzero(self.line[1:] == self.line[:-1])

    @property
    def lengths(self) -> Array:
        """Lengths of the segments, in the plane."""
        way = np.diff(self.nodes[:, :2], axis=0)[self.begins]
        return np.hypot(way[:, 0], way[:, 1])

    @property
    def length(self) -> float:
        """Total length of all lines."""
        return float(self.lengths.sum())

    def vertices(self, number: int) -> Array:
        """Vertices of one line, array of shape (k, 2)."""
        return self.nodes[self.line == number, :2]

    def divided(self, step: float) -> Route:
        """The same lines with nodes no farther apart than the step.

        Raises
        ------
        DataError
            That makes too many.
        """
        begins, lengths = self.begins, self.lengths
        count = np.maximum(np.ceil(lengths / step), 1)
        if count.sum() > MOST_NODES:
            raise DataError(
                f"spacing: makes {count.sum():,.0f} pieces, more than {MOST_NODES:,}; take a larger"
            )
        pieces = np.ones(len(self.nodes), np.int64)  # the last node of a line stands alone
        pieces[begins] = count.astype(np.int64)
        origin = np.repeat(np.arange(len(self.nodes)), pieces)
        number = np.arange(len(origin)) - (np.cumsum(pieces) - pieces)[origin]
        share = (number / pieces[origin])[:, None]
        way = np.zeros_like(self.nodes)
        way[begins] = self.nodes[begins + 1] - self.nodes[begins]
        nodes = self.nodes[origin] + share * way[origin]
        line = self.line[origin]
        return Route(nodes, line, chainages(nodes, line), self.closed)


def chainages(nodes: Array, line: Indices) -> Array:
    """Length along each line from its beginning to each node.

    Examples
    --------
    >>> chainages(np.array([[0.0, 0], [3, 4], [9, 9]]), np.array([0, 0, 1]))
    array([0., 5., 0.])
    """
    way = np.diff(nodes[:, :2], axis=0)
    step = np.where(line[1:] == line[:-1], np.hypot(way[:, 0], way[:, 1]), 0.0)
    total = np.concatenate([[0.0], np.cumsum(step)])
    first = np.searchsorted(line, line)  # lines are in a row, so numbers rise
    found: Array = total - total[first]
    return found


def routes(shapes: Shapes) -> list[Array]:
    """Vertices of shape (n, 3) of each line; lines are merged where one continues another.

    Lines that go on in the same direction where another ends are one; polygons have their inside
    on the left. Vertices in a row at one position are one.

    Examples
    --------
    >>> pieces = [shapely.LineString([(0, 0), (1, 0)]), shapely.LineString([(1, 0), (2, 0)])]
    >>> [len(line) for line in routes(np.array(pieces))]
    [3]
    """
    areas = shapely.get_dimensions(shapes) == 2
    outlines = shapely.boundary(shapely.orient_polygons(shapes[areas]))
    parts = shapely.get_parts(np.concatenate([shapes[~areas], outlines]))
    if len(parts) > 1:
        merged = shapely.line_merge(shapely.multilinestrings(parts), directed=True)
        parts = shapely.get_parts(merged)
    found = []
    for part in parts:
        vertices = shapely.get_coordinates(part, include_z=True)
        new = np.append(True, (np.diff(vertices[:, :2], axis=0) != 0).any(axis=1))
        found.append(vertices[new])
    return found


def within(lines: Sequence[Array], region: Any) -> list[Array]:
    """The parts of lines, of shape (n, 3) each, that lie in a region; they run as before.

    Segments are cut one by one: GEOS would part a line where it crosses itself, and turn parts. A
    closed line may begin anywhere.

    Examples
    --------
    >>> line = np.array([[0, 0, 5.0], [10, 0, 7.0]])
    >>> within([line], shapely.box(5, -1, 20, 1))
    [array([[ 5.,  0.,  6.],
           [10.,  0.,  7.]])]
    """
    shapely.prepare(region)
    return [part for line in lines for part in _cut(line, region)]


def _cut(line: Array, region: Any) -> list[Array]:
    starts, ways = line[:-1], np.diff(line, axis=0)
    segments = shapely.linestrings(np.stack([starts[:, :2], line[1:, :2]], axis=1))
    found, number = shapely.get_parts(shapely.intersection(segments, region), return_index=True)
    whole = (shapely.get_dimensions(found) == 1) & (shapely.length(found) > 0)
    found, number = found[whole], number[whole]  # no points where a segment only touches
    if not len(found):
        return []
    ends = np.stack(
        [shapely.get_coordinates(shapely.get_point(found, end)) for end in (0, -1)], axis=1
    )
    way = ways[number, None, :2]
    share = ((ends - starts[number, None, :2]) * way).sum(axis=2) / (way**2).sum(axis=2)
    share = np.sort(share, axis=1)
    share[share < AT_END], share[share > 1 - AT_END] = 0.0, 1.0
    order = np.lexsort((share[:, 0], number))
    number, share = number[order], share[order]
    follows = (share[1:, 0] == share[:-1, 1]) & (number[1:] == number[:-1])
    follows |= (share[:-1, 1] == 1) & (share[1:, 0] == 0) & (number[1:] == number[:-1] + 1)
    breaks = np.flatnonzero(~follows) + 1
    parts = []
    for numbers, shares in zip(np.split(number, breaks), np.split(share, breaks), strict=True):
        ends_there = starts[numbers] + shares[:, 1:] * ways[numbers]
        first = starts[numbers[0]] + shares[0, 0] * ways[numbers[0]]
        part = np.vstack([first, ends_there])
        part[1:][shares[:, 1] == 1] = line[numbers[shares[:, 1] == 1] + 1]  # without rounding
        parts.append(part)
    ring = (line[0, :2] == line[-1, :2]).all() and len(parts) > 1
    if ring and (parts[0][0, :2] == line[0, :2]).all() and (parts[-1][-1] == line[-1])[:2].all():
        parts[0] = np.vstack([parts.pop(), parts[0][1:]])
    return parts


class Feet(NamedTuple):
    """Nearest positions on a route (feet of perpendiculars); arrays of shape (n,).

    Attributes
    ----------
    segment : number of the segment
    share : of the segment up to the position
    distance : in the plane

    Examples
    --------
    >>> Feet(np.array([0]), np.array([0.25]), np.array([2.0])).distance
    array([2.])
    """

    segment: Indices
    share: Array
    distance: Array


class IndexedRoute:
    """A route with a spatial index of its segments, which finds the nearest position on it.

    Examples
    --------
    >>> line = IndexedRoute(Route.of([np.array([[0.0, 0, 1], [4, 0, 3]])]))
    >>> feet = line.feet(np.array([[1.0, 2.0]]))
    >>> feet.distance, line.at(feet)[2]  # and the height there
    (array([2.]), array([1.5]))
    """

    def __init__(self, route: Route) -> None:
        self.route = route
        self.begins = route.begins
        self.start = route.nodes[self.begins, :2]
        self.way = route.nodes[self.begins + 1, :2] - self.start
        ends = np.stack([self.start, self.start + self.way], axis=1)
        segments: Shapes = np.asarray(shapely.linestrings(ends))
        self._tree = shapely.STRtree(segments)

    def feet(self, places: Array, ctx: Context = QUIET) -> Feet:
        """The nearest position on the route for each of the positions of shape (n, 2)."""
        segment = np.empty(len(places), np.int64)

        def work(first: int, last: int) -> None:
            points = shapely.points(places[first:last])
            segment[first:last] = self._tree.query_nearest(points, all_matches=False)[1]

        in_blocks(work, len(places), BLOCK, ctx)
        share, distance = self.onto(places, segment)
        return Feet(segment, share, distance)

    def onto(self, places: Array, segment: Indices) -> tuple[Array, Array]:
        """The nearest position on given segments, as a share of the segment, and its distance."""
        away, way = places - self.start[segment], self.way[segment]
        share = np.clip((away * way).sum(axis=1) / (way**2).sum(axis=1), 0, 1)
        left = away - share[:, None] * way
        return share, np.hypot(left[:, 0], left[:, 1])

    def at(self, feet: Feet) -> tuple[Indices, Array, Array]:
        """Number of the line, chainage and height of positions on the route."""
        node = self.begins[feet.segment]
        chainage, z = self.route.chainage, self.route.nodes[:, 2]
        along = chainage[node] + feet.share * (chainage[node + 1] - chainage[node])
        return self.route.line[node], along, z[node] + feet.share * (z[node + 1] - z[node])

    def sides(self, places: Array, feet: Feet) -> tuple[Array, NDArray[np.bool_]]:
        """Side of the route on which positions lie, and whether they are abeam of it.

        At a vertex the side is that of the mean direction of its two segments, since one of them
        alone may have the position on its wrong side (Bærentzen and Aanæs 2005 for meshes).

        Returns
        -------
        array of shape (n,), 1 on the left, -1 on the right, 0 on the route
        array of shape (n,), False where a position lies beyond the end of a line
        """
        unit = self.way / np.hypot(*self.way.T)[:, None]
        before, after = self._neighbours()
        at_start, at_end = feet.share <= AT_END, feet.share >= 1 - AT_END
        beside = np.where(at_start, before[feet.segment], np.where(at_end, after[feet.segment], -1))
        vertex = (at_start | at_end) & (beside >= 0)
        direction = unit[feet.segment]
        direction[vertex] += unit[beside[vertex]]
        way = self.way[feet.segment]
        away = places - self.start[feet.segment] - feet.share[:, None] * way
        cross = direction[:, 0] * away[:, 1] - direction[:, 1] * away[:, 0]
        ahead = (away * way).sum(axis=1) / (way**2).sum(axis=1)  # 0 unless the foot is an end
        beyond = (np.abs(ahead) > AT_END) & (beside < 0)
        return np.sign(cross), ~beyond

    def _neighbours(self) -> tuple[Indices, Indices]:
        """Indices of the segments before and after each one; -1 where a line begins or ends."""
        count = len(self.begins)
        before, after = np.arange(count) - 1, np.arange(count) + 1
        line = self.route.line[self.begins]
        first = np.searchsorted(line, np.arange(len(self.route.closed)))
        last = np.append(first[1:], count) - 1
        closed = self.route.closed
        before[first] = np.where(closed, last, -1)
        after[last] = np.where(closed, first, -1)
        return before, after


def farthest(
    route: Route, feet: Feet, other: IndexedRoute, within: float, ctx: Context = QUIET
) -> float:
    """The largest distance of any point of a route from another: directed Hausdorff distance.

    The distance to one segment is convex along a straight piece, so it is nowhere larger than at
    the ends of the piece. Pieces that may hold a larger distance than the largest found are
    halved until none does by more than `within`.

    Parameters
    ----------
    feet : of the nodes of the route
    within : how far the answer may be too small

    Examples
    --------
    >>> one, other = (Route.of([np.array([[0.0, y, 0], [4, y, 0]])]) for y in (0.0, 3.0))
    >>> indexed = IndexedRoute(other)
    >>> farthest(one, indexed.feet(one.nodes[:, :2]), indexed, 0.01)
    3.0
    """
    begins = route.begins

    def of_ends(values: NDArray[Any]) -> NDArray[Any]:
        return np.stack([values[begins], values[begins + 1]], axis=1)

    ends, segment, distance = map(of_ends, (route.nodes[:, :2], feet.segment, feet.distance))
    best = float(feet.distance.max())
    while len(ends):
        ctx.progress(0.5)
        to_first = np.maximum(distance[:, 0], other.onto(ends[:, 1], segment[:, 0])[1])
        to_last = np.maximum(distance[:, 1], other.onto(ends[:, 0], segment[:, 1])[1])
        hopeful = np.minimum(to_first, to_last) > best + within
        ends, segment, distance = ends[hopeful], segment[hopeful], distance[hopeful]
        middle = ends.mean(axis=1)
        found = other.feet(middle)
        best = max(best, float(found.distance.max(initial=0.0)))
        ends = halved(ends, middle)
        segment, distance = halved(segment, found.segment), halved(distance, found.distance)
    return best


def halved(ends: NDArray[Any], middle: NDArray[Any]) -> NDArray[Any]:
    """Values at the ends of the halves of pieces, shape (2 n, 2, ...), from those of pieces.

    Examples
    --------
    >>> halved(np.array([[0.0, 4.0]]), np.array([2.0]))
    array([[0., 2.],
           [2., 4.]])
    """
    first, last = ends[:, 0], ends[:, 1]
    return np.concatenate([np.stack([first, middle], axis=1), np.stack([middle, last], axis=1)])
