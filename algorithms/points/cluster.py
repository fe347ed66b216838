"""Objects among points: clusters in space, each with its box, hull and height."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shared import parameters
from algorithms.shared.clusters import dbscan, hdbscan
from algorithms.shared.ground import taking_part
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Vector
from toolbox.data.report import Column
from toolbox.declare import ClassList, Share, outputs, param, show, sink, source, tool

Method = Literal["dbscan", "hdbscan"]
MOST = 50_000  # points for hdbscan, whose time grows with their square: some minutes
RADIUS = 1.0  # metres, between the neighbours of dbscan unless told otherwise
EDGE = 0.01  # metres around points that lie on one line or at one place, so that they have an area
ID = "cluster_id"
COLUMNS = {
    ID: Column("Cluster"),
    "points": Column("Points"),
    "low": Column("Lowest elevation", "unit", 2),
    "high": Column("Highest elevation", "unit", 2),
    "height": Column("Height", "unit", 2),
    "length": Column("Length of the box", "unit", 2),
    "width": Column("Width of the box", "unit", 2),
    "direction": Column("Direction of the box, from north", "°", 1),
    "area": Column("Area of the hull", "unit²", 2),
    "volume": Column("Volume of the box", "unit³", 2),
}

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@tool(
    "points.cluster",
    title="Cluster points",
    tags=("cluster", "dbscan", "hdbscan", "segment", "object", "instance", "connected"),
)
class PointsCluster:
    """Find objects among points: groups that are dense and apart from each other.

    `dbscan`: points with at least `min_points` points within `radius`, themselves among them, are
    cores; cores within the radius of each other are of one cluster, and other points within the
    radius of a core belong to that of the nearest one. With `min_points` 1 all points closer than
    the radius are connected. `hdbscan` needs no radius and finds clusters of different densities,
    of at least `min_points`; it takes up to 50,000 points. Clusters of fewer than `min_size` points
    are none.

    Give the `classes` that hold the objects, as 5 for trees that stand apart, or leave the ground
    out: objects that the ground connects are one. Each point gets `cluster_id`, from 1, 0 for
    none; ids follow the place of the clusters. `clusters` holds the convex hull of each in plan,
    with the upright box of least area around it: length, width, direction of the length in degrees
    from north, height (highest less lowest point) and volume, in the unit of the data.
    """

    points: PointCloud = source("Points to group")
    method: Method = param(
        "How clusters are found",
        default="dbscan",
        words={"dbscan": "Dense and connected", "hdbscan": "Of different densities"},
    )
    radius: float | None = param(
        "Points nearer than this are neighbours, for dbscan; 1 m unless given",
        default=None,
        unit="m",
        gt=0,
        le=1000,
    )
    min_points: int = param(
        "Points around a core with itself (dbscan), or of a cluster (hdbscan)",
        default=5,
        unit="1",
        ge=1,
        le=100_000,
    )
    min_size: int = param("Smallest cluster", default=10, unit="1", ge=1, le=100_000_000)
    classes: ClassList | None = param(
        "Classes whose points are grouped; none for all", default=None, label="Classes grouped"
    )
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        clustered: PointCloud = sink(
            "The same points with cluster_id, 0 for none", show=show.Values(ID)
        )
        clusters: Vector = sink("Hull of each cluster, with its box and height", columns=COLUMNS)
        count: int = sink("Number of clusters", unit="1")
        apart: float = sink("Share of the points grouped that are of no cluster", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """Every setting that is given is used; HDBSCAN knows no clusters of one point."""
        if self.method == "hdbscan" and self.radius is not None:
            yield "radius", "is for method dbscan, not for hdbscan"
        if self.method == "hdbscan" and self.min_points < 2:
            yield "min_points", "must be at least 2 for hdbscan"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """Classes can be told, and HDBSCAN can bear the points."""
        if self.classes is not None and "classification" not in self.points:
            yield "classes", f"{self.points.name or 'the cloud'} has no classification"
        elif self.method == "hdbscan" and (count := int(self._part().sum())) > MOST:
            yield "method", f"hdbscan takes up to {MOST:,} points, got {count:,}; take dbscan"

    def halo(self) -> float:
        """A cluster may reach through the whole survey."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> PointsCluster.Outputs:
        """Group the points, and describe each group."""
        cloud, part = self.points, self._part()
        xyz = cloud.xyz[part]
        if self.method == "dbscan":
            radius = RADIUS * cloud.metre if self.radius is None else self.radius
            label = dbscan(xyz, radius, self.min_points, ctx=ctx.part(0.0, 0.7))
        else:
            label = hdbscan(xyz, self.min_points)
        label = without_small(label, self.min_size)
        number = np.zeros(len(cloud), np.int32)
        number[part] = label
        if not label.any():
            log.warning("points: no cluster of %d points was found", self.min_size)
        rows = list(described(xyz, label, EDGE * cloud.metre, ctx.part(0.7, 1.0)))
        ctx.progress(1.0)
        return self.Outputs(
            clustered=cloud.with_attributes({ID: number}, descriptions={ID: "0 is of none"}),
            clusters=self._layer(rows),
            count=len(rows),
            apart=Share.of_points(number == 0, part),
        )

    def _part(self) -> NDArray[np.bool_]:
        """True for the points that are grouped."""
        part = taking_part(self.points, self.ignore)
        if self.classes is not None:
            part = part & np.isin(self.points["classification"], self.classes)
        return np.asarray(part)

    def _layer(self, rows: list[Mapping[str, Any]]) -> Vector:
        import geopandas

        frame = geopandas.GeoDataFrame(
            rows, columns=[*COLUMNS, "geometry"], geometry="geometry", crs=self.points.crs
        )
        return Vector(frame, geometry_type="Polygon")


def without_small(label: Ints, least: int) -> Ints:
    """Labels from 1 of clusters of at least so many points, 0 for all others.

    >>> without_small(np.array([1, 2, 2, 0, 3, 3]), 2).tolist()
    [0, 1, 1, 0, 2, 2]
    """
    large = np.bincount(label, minlength=1) >= least
    large[0] = False
    return np.where(large, np.cumsum(large), 0)[label]


def described(
    xyz: Floats, label: Ints, edge: float, ctx: Context = QUIET
) -> Iterator[Mapping[str, Any]]:
    """Hull, box and height of each cluster of points of shape (n, 3).

    Parameters
    ----------
    label : from 1; 0 for points of none, array of shape (n,)
    edge : put around hulls without an area, in the unit of xyz
    """
    order = np.argsort(label, kind="stable")
    ends = np.cumsum(np.bincount(label, minlength=1))
    for number in range(1, len(ends)):
        ctx.progress(number / len(ends))
        own = xyz[order[ends[number - 1] : ends[number]]]
        hull = shapely.convex_hull(shapely.MultiPoint(own[:, :2]))
        if hull.geom_type != "Polygon":
            hull = shapely.buffer(hull, edge, quad_segs=2)
        length, width, direction = box_of(hull)
        low, high = float(own[:, 2].min()), float(own[:, 2].max())
        row: dict[str, Any] = {ID: number, "points": len(own), "low": low, "high": high}
        row |= {"height": high - low, "length": length, "width": width, "direction": direction}
        yield row | {
            "area": hull.area,
            "volume": length * width * (high - low),
            "geometry": hull,
        }


def box_of(hull: Any) -> tuple[float, float, float]:
    """Length and width of the rectangle of least area around a polygon, and its direction.

    Returns
    -------
    length, width, and degrees of the length from north to the east, from 0 up to 180

    Examples
    --------
    >>> box_of(shapely.box(0, 0, 5, 2))
    (5.0, 2.0, 90.0)
    """
    corners = np.asarray(shapely.minimum_rotated_rectangle(hull).exterior.coords)
    one, other = np.diff(corners, axis=0)[:2]
    if np.hypot(*other) > np.hypot(*one):
        one, other = other, one
    direction = float(np.degrees(np.arctan2(one[0], one[1])) % 180)
    return float(np.hypot(*one)), float(np.hypot(*other)), direction
