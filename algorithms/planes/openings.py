"""Windows and doors of a facade, and the points seen through them.

How openings are told from shadows, and how exact their edges are: docs/explanation/planes.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import geopandas
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import KDTree

from algorithms.planes._fronts import UPRIGHT
from algorithms.planes._outlines import View, drawn, outline
from algorithms.planes._segment import parts_of
from algorithms.shared.alpha_shape import alpha_shape
from algorithms.shared.plane_fit import Plane
from algorithms.shared.plane_numbers import plane_numbers
from algorithms.shared.polygons import Polygons
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Vector
from toolbox.declare import Attribute, outputs, param, show, sink, source, tool
from toolbox.errors import DataError

MIDDLE = 0.8  # share of a side along which its edge is looked for, away from the corners
EDGE = 0.95  # share of the rows of points that end before the edge
FEWEST_ROWS = 5
COLUMNS = (
    "kind",
    "width",
    "height",
    "area",
    "sill",
    "set_back",
    "seen",
    "edge_seen",
    "hidden",
    "rectangle",
)
BEHIND = 2 / 3  # depth over the distance of neighbours, beyond which a point is behind the wall
SIDES = ("left", "bottom", "right", "top")
BESIDE = 4.0  # distance of a point from an edge that is seen, over that of neighbours
EMPTY = 1.5  # the same behind the opening: one in thirty random half circles has none
FULL = 0.8  # area of a gap over that of the rectangle around it, if it is one
DOOR_HEIGHT, DOOR_SILL = 1.8, 0.3  # metres: least height, and most above the foot of the wall

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@tool("planes.openings")
class PlanesOpenings:
    """Find the windows and doors of a plane, and the points seen through them.

    The points are those of planes.extract, with plane_id. The facade is the upright plane with
    the most points, unless `plane` names another. Gaps of its points, at least `min_width` wide and
    high, are openings if at least `min_points` lie behind them: a pane, a door, a curtain. A gap
    with nothing behind is a shadow of what stands in front; so is a dark room behind a pane that
    sends nothing back, and openings of that kind are not found.

    A gap that fills most of a level rectangle becomes one; each of its edges is where 95 of
    100 rows of points on the wall end. Others keep their outline.

    Where something stands in front, such as a balcony, the gap ends at its shadow. An edge is seen
    where points lie on both sides: on the wall outside, and behind it inside, no farther away than
    `recess` or what their density tells. `edge_seen` is the share of the outline that is, and
    `hidden` names the sides of a rectangle of which less than half is. They may be elsewhere.

    Points farther behind the facade than `recess` and within its outline were seen through an
    opening. They get the number of the nearest in opening_id, and `behind` 1; planes of which they
    are more than half, such as curtains, are given up: plane_id becomes 0. Points of panes, doors
    and reveals have opening_id, and keep their plane. The front is the side with more points.

    The elevation shows the facade and its openings in its own coordinates, to the right and upwards
    from its lower left corner.
    """

    points: PointCloud = source("Points with the number of their plane")
    attribute: Attribute = param(
        "Attribute with the number of the plane", default=Attribute("plane_id"), of="points"
    )
    plane: int | None = param(
        "Number of the facade; the upright plane with the most points unless given",
        default=None,
        unit="1",
        ge=1,
    )
    min_width: float = param("Least width and height of an opening", default=0.4, unit="m", gt=0)
    max_width: float = param("Largest width of an opening", default=4.0, unit="m", gt=0)
    min_points: int = param("Fewest points behind an opening", default=5, unit="1", ge=1)
    recess: float = param(
        "Farthest that panes and doors lie behind the facade", default=0.25, unit="m", gt=0
    )
    depth: float = param("Farthest behind that is looked at", default=5.0, unit="m", gt=0)

    @outputs
    class Outputs:
        cleaned: PointCloud = sink(
            "The points with plane_id, opening_id and behind", show=show.Planes("plane_id")
        )
        openings: Vector = sink(
            "Outline of each opening in space, with its size and what it is",
            show=show.Classes("kind"),
        )
        elevation: Vector = sink(
            "The facade and its openings, in its own coordinates", show=show.Classes("kind")
        )
        planes: Vector = sink("Outlines of the planes that are left")
        count: int = sink("Openings", unit="1")
        behind: int = sink("Points seen through openings", unit="1")
        given_up: int = sink("Planes that were seen through openings", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """The width limits are in order."""
        if self.max_width < self.min_width:
            yield "max_width", f"is below min_width, {self.min_width:g}"

    def halo(self) -> float:
        """Infinite, as a facade is of any size."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> PlanesOpenings.Outputs:
        """Find the gaps of the facade, look for points behind them, and mark these."""
        cloud = self.points
        ids = plane_numbers(cloud, self.attribute)
        if negative := int(np.sum(ids < 0)):
            raise DataError(
                f"points: {self.attribute} is below 0 at {negative} points; planes must be "
                "numbered from 1, with 0 for none, as by planes.extract"
            )
        number = self._facade(cloud.xyz, ids, ctx.part(0.0, 0.1))
        front = facade_of(cloud.xyz, ids == number)
        made = openings(
            front,
            min_width=self.min_width,
            max_width=self.max_width,
            fewest=self.min_points,
            recess=self.recess,
            depth=self.depth,
            ctx=ctx.part(0.1, 0.6),
        )
        if not made.shapes:
            log.warning("plane %d has no openings; look at min_width and min_points", number)
        opening, behind = marked(front, made, self.recess, self.depth)
        lost = np.unique(ids[behind & (ids > 0)])
        sizes = {k: int((ids == k).sum()) for k in lost.tolist()}
        given_up = [k for k, size in sizes.items() if 2 * int((behind & (ids == k)).sum()) > size]
        kept = np.where(behind | np.isin(ids, given_up), 0, ids).astype(np.int32)
        ctx.progress(0.7)
        columns: dict[str, NDArray[Any]] = {
            str(self.attribute): kept,
            "opening_id": opening.astype(np.int32),
            "behind": behind.astype(np.uint8),
        }
        notes = {"opening_id": "0 of none", "behind": "1 seen through an opening"}
        cleaned = cloud.with_attributes(columns, descriptions=notes)
        layer, elevation = self._layers(front, made, number)
        del front, made, opening, ids  # outlines need much memory
        planes = self._planes(kept, ctx.part(0.7, 1.0))
        ctx.progress(1.0)
        return self.Outputs(
            cleaned=cleaned,
            openings=layer,
            elevation=elevation,
            planes=planes,
            count=len(layer),
            behind=int((behind & cloud.core).sum()),
            given_up=len(given_up),
        )

    def _facade(self, xyz: Floats, ids: Ints, ctx: Context) -> int:
        """Number of the plane that is the facade."""
        numbers, counts = np.unique(ids[ids > 0], return_counts=True)
        if self.plane is not None:
            if self.plane not in numbers:
                raise DataError(f"points: none is on plane {self.plane} by {self.attribute}")
            return self.plane
        for k in numbers[np.argsort(-counts, kind="stable")].tolist():
            ctx.progress(0.0)
            if (ids == k).sum() >= 3 and abs(fitted(xyz[ids == k]).normal[2]) <= UPRIGHT:
                return int(k)
        raise DataError(f"points: {self.attribute} has no upright plane; name one with plane")

    def _layers(self, front: Facade, made: Openings, number: int) -> tuple[Vector, Vector]:
        """Layer of the openings in space, and layer of facade and openings in its coordinates."""
        metre = self.points.metre
        rows = [{"opening_id": k} | row for k, row in enumerate(made.rows(front, metre), start=1)]
        columns = ["opening_id", *COLUMNS]
        flat = list(made.shapes)
        solid = geopandas.GeoDataFrame(
            rows,
            columns=columns,
            geometry=[front.view.raised(s) for s in flat],
            crs=self.points.crs,
        )
        wall = shapely.difference(made.wall, shapely.union_all(flat)) if flat else made.wall
        shown = [{"opening_id": 0, "kind": "facade", "plane_id": number}, *rows]
        elevation = geopandas.GeoDataFrame(shown, geometry=[wall, *flat])
        return (
            Vector(solid, name="openings", geometry_type="Polygon Z"),
            Vector(elevation, name="elevation", geometry_type="Polygon"),
        )

    def _planes(self, ids: NDArray[np.int32], ctx: Context) -> Vector:
        """Outlines of the remaining planes, which keep their numbers."""
        xyz = self.points.xyz
        numbers, rank = np.unique(np.append(ids, 0), return_inverse=True)
        ranks = np.asarray(rank[:-1], np.int32)
        planes = [fitted(xyz[part]) for part in parts_of(ranks, len(numbers) - 1)]
        frame = drawn(xyz, ranks, planes, self.min_width / 2, ctx)
        frame["plane_id"] = numbers[1:]
        return Vector(frame.set_crs(self.points.crs), name="planes", geometry_type="Polygon Z")


class Facade(NamedTuple):
    """A wall, and all points in its coordinates.

    Attributes
    ----------
    view : coordinates on the wall, seen from the front
    uv : array of shape (n, 2), of all points
    behind : array of shape (n,), how far points lie behind the wall
    own : array of shape (n,), which are on it
    apart : distance of neighbours on it
    """

    view: View
    uv: Floats
    behind: Floats
    own: NDArray[np.bool_]
    apart: float


class Openings(NamedTuple):
    """Gaps of a wall through which something is seen.

    Attributes
    ----------
    wall : outline of the wall, gaps filled
    shapes : polygons, from left to right
    seen : points behind each
    set_back : how far what is in each lies behind the wall, the median
    edges : share of each outline that is seen, and the names of sides that are not
    """

    wall: Any
    shapes: list[Any]
    seen: list[int]
    set_back: list[float]
    edges: list[tuple[float, str]]

    def rows(self, front: Facade, metre: float) -> Iterator[dict[str, Any]]:
        """Attributes of each opening; lengths in the unit of the data."""
        known = zip(self.shapes, self.seen, self.set_back, self.edges, strict=True)
        for shape, seen, back, (edge_seen, hidden) in known:
            left, bottom, right, top = shape.bounds
            beside = (front.uv[:, 0] > left - 1 * metre) & (front.uv[:, 0] < right + 1 * metre)
            sill = bottom - float(front.uv[front.own & beside, 1].min(initial=bottom))
            door = top - bottom >= DOOR_HEIGHT * metre and sill <= DOOR_SILL * metre
            yield {
                "kind": "door" if door else "window",
                "width": right - left,
                "height": top - bottom,
                "area": shape.area,
                "sill": sill,
                "set_back": back,
                "seen": seen,
                "edge_seen": edge_seen,
                "hidden": hidden,
                "rectangle": len(shape.exterior.coords) == 5,
            }


def fitted(xyz: Floats) -> Plane:
    """Least-squares plane through points of shape (n, 3)."""
    origin = xyz[0].copy()
    near = xyz - origin
    centre = near.mean(axis=0)
    near -= centre
    return Plane(np.linalg.eigh(near.T @ near)[1][:, 0], centre, origin)


def facade_of(xyz: Floats, own: NDArray[np.bool_]) -> Facade:
    """The wall through the points `own`; its front is the side with more points."""
    plane = fitted(xyz[own])
    away = plane.distances(xyz)
    if np.median(away) < 0:
        plane, away = Plane(-plane.normal, plane.centre, plane.origin), -away
    view = View.of(plane, xyz[own])
    uv = view.flat(xyz)
    round_trip = np.append(uv[own], uv[own][:1], axis=0)  # a line, also through a single point
    area = float(shapely.area(shapely.convex_hull(shapely.linestrings(round_trip))))
    return Facade(view, uv, -away, own, math.sqrt(area / own.sum()))


def openings(
    front: Facade,
    *,
    min_width: float,
    max_width: float,
    fewest: int,
    recess: float,
    depth: float,
    ctx: Context = QUIET,
) -> Openings:
    """Gaps of a wall with points behind them; for the settings see :class:`PlanesOpenings`.

    Lengths are in the unit of the points.
    """
    uv = front.uv[front.own]
    parts = shapely.union_all(list(alpha_shape(uv, min_width / 2, ctx=ctx.part(0.0, 0.4)).polygons))
    # A few points of the ground or of a side wall, in line with the wall, are no part of it.
    firm = shapely.buffer(shapely.buffer(parts, -min_width / 4), min_width / 4 + front.apart)
    held = Polygons.of(shapely.get_parts(firm)).hold(uv)
    wall = outline(uv[held] if held.any() else uv, max_width, ctx=ctx.part(0.4, 0.8))
    gaps = shapely.get_parts(shapely.difference(wall, parts))
    # Narrow necks between gaps, where points lie a little farther apart, do not join them.
    gaps = shapely.get_parts(shapely.buffer(shapely.buffer(gaps, -min_width / 4), min_width / 4))
    shapes, seen, backs, edges = [], [], [], []
    here = np.flatnonzero(~front.own & (front.behind > 0) & (front.behind <= depth))
    for gap in sorted(gaps, key=lambda gap: gap.bounds):
        ctx.progress(0.8)
        left, bottom, right, top = gap.bounds
        if not (min_width <= right - left <= max_width and top - bottom >= min_width):
            continue
        inside = here[Polygons.of(np.array([gap])).hold(front.uv[here])]
        inside = inside[front.behind[inside] > BEHIND * front.apart]
        if len(inside) < fewest:
            continue
        shape = _rectangle(gap, uv, front.apart) or gap
        shapes.append(shape)
        seen.append(len(inside))
        edges.append(_edge_seen(shape, front, inside, recess))
        near = front.behind[inside] <= recess
        backs.append(float(np.median(front.behind[inside[near]])) if near.any() else math.nan)
    ctx.progress(1.0)
    return Openings(wall, shapes, seen, backs, edges)


def _edge_seen(shape: Any, front: Facade, inside: Ints, recess: float) -> tuple[float, str]:
    """Share of an outline that is seen, and names of the sides that mostly are not.

    Parameters
    ----------
    inside : points behind the opening
    """
    left, bottom, right, top = shape.bounds
    rim = BESIDE * front.apart
    u, v = front.uv.T
    beside = (u > left - rim) & (u < right + rim) & (v > bottom - rim) & (v < top + rim)
    beside &= (front.behind >= -recess) & (front.behind <= BEHIND * front.apart)
    around = front.uv[beside]
    around = around[~Polygons.of(np.array([shape])).hold(around)]
    ring = shape.exterior
    steps = np.arange(front.apart / 2, ring.length, front.apart)
    places = shapely.get_coordinates(shapely.line_interpolate_point(ring, steps))
    reach = max(recess, EMPTY * math.sqrt(shape.area / len(inside)))
    seen = np.zeros(len(places), bool)
    if len(around):
        seen |= KDTree(around).query(places)[0] <= rim
        seen &= KDTree(front.uv[inside]).query(places)[0] <= reach
    hidden = []
    for side, name in enumerate(SIDES):
        on = np.abs(places[:, side % 2] - shape.bounds[side]) < front.apart / 4
        if len(ring.coords) == 5 and seen[on].mean() < 0.5:
            hidden.append(name)
    return float(seen.mean()), ", ".join(hidden)


def _rectangle(gap: Any, uv: Floats, apart: float) -> Any:
    """Rectangle of a gap, between the ends of the rows of points around it; None if it has none."""
    left, bottom, right, top = gap.bounds
    box = shapely.box(left, bottom, right, top)
    if gap.area < FULL * box.area:
        return None
    sides = [left, bottom, right, top]
    for axis in (0, 1):
        low, high = sides[1 - axis], sides[3 - axis]
        rim = (1 - MIDDLE) / 2 * (high - low)
        along = (uv[:, 1 - axis] > low + rim) & (uv[:, 1 - axis] < high - rim)
        near = uv[along]
        row = np.floor(near[:, 1 - axis] / (2 * apart)).astype(np.int64)
        middle = (gap.bounds[axis] + gap.bounds[2 + axis]) / 2
        for end, sign in ((axis, 1.0), (2 + axis, -1.0)):
            reach = sign * (near[:, axis] - gap.bounds[end])
            close = (reach > -4 * apart) & (sign * (near[:, axis] - middle) < 0)
            edge = _edge(sign * near[close, axis], row[close])
            if edge is not None:
                sides[end] = sign * edge
    if sides[0] >= sides[2] or sides[1] >= sides[3]:
        return None
    return shapely.box(*sides)


def _edge(ends: Floats, row: Ints) -> float | None:
    """The position of an edge, beyond which 5 % of the rows of points reach; None for few rows."""
    rows, number = np.unique(row, return_inverse=True)
    if len(rows) < FEWEST_ROWS:
        return None
    last = np.full(len(rows), -np.inf)
    np.maximum.at(last, number, ends)
    return float(np.quantile(last, EDGE))


def marked(
    front: Facade, made: Openings, recess: float, depth: float
) -> tuple[Ints, NDArray[np.bool_]]:
    """Number of the opening of each point, 0 for none, and which points were seen through it.

    A point beyond the recess is within the outline of the wall; the opening is the nearest one, as
    the way of the ray is not known.
    """
    opening = np.zeros(len(front.uv), np.int64)
    behind = np.zeros(len(front.uv), bool)
    if not made.shapes:
        return opening, behind
    some = np.flatnonzero((front.behind > 0) & (front.behind <= depth) & ~front.own)
    within = shapely.buffer(made.wall, -2 * front.apart)  # not what stands at its edge
    some = some[Polygons.of(shapely.get_parts(within)).hold(front.uv[some])]
    tree = shapely.STRtree(made.shapes)
    places = shapely.points(front.uv[some])
    nearest = np.asarray(tree.nearest(places))
    away = shapely.distance(places, np.array(made.shapes)[nearest])
    deep = front.behind[some] > recess
    in_it = deep | (away <= 2 * front.apart)
    opening[some[in_it]] = nearest[in_it] + 1
    behind[some[deep]] = True
    return opening, behind
