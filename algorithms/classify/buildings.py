"""Buildings: classified points, and outlines with heights.

A roof stands above the ground, lies on planes, and lets no pulse through. Points for which this
holds, judged by what is around them, are joined to regions; what lies in a region, up to the roof,
is building. Outlines are drawn around those that lie on planes themselves.

References
----------
Demir, N. and Acar, U.: buildings after the ground, with a smallest size, in TerraScan.
Zhang, K., Yan, J. and Chen, S.-C. (2006). Automatic construction of building footprints from
airborne LIDAR data. IEEE Transactions on Geoscience and Remote Sensing 44(9), 2523-2533: roofs by
planes, footprints, main directions.
Rottensteiner, F. and Briese, C. (2002). A new method for building extraction in urban areas from
high-resolution LIDAR data. ISPRS Archives 34(3A), 295-301: height, roughness, then size.
Rényi, A. and Sulanke, R. (1963). Über die konvexe Hülle von n zufällig gewählten Punkten.
Zeitschrift für Wahrscheinlichkeitstheorie 2, 75-84: how far inside of an edge hulls of points stay.

How well it does, and what it takes for a building: docs/explanation/urban-classes.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from algorithms.classify import _buildings_kernels as kernels
from algorithms.classify import _evidence
from algorithms.classify._bridges import bridges
from algorithms.classify._evidence import FOOT, solid
from algorithms.classify._sorted_points import SortedPoints
from algorithms.classify._squared import squared
from algorithms.shared import parameters
from algorithms.shared.alpha_shape import alpha_shape
from algorithms.shared.ground import among, taking_part
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import blocks
from algorithms.shared.neighbours import PointTree
from algorithms.shared.parameters import STRUCTURES
from algorithms.shared.polygons import Polygons
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Vector
from toolbox.declare import ClassList, Share, outputs, param, sink, source, tool
from toolbox.errors import DataError, NothingToDo

BUILDING, OTHER = np.uint8(_evidence.BUILDING), np.uint8(1)
EAVES = 0.4  # metres beyond the outline in which points of the roof may lie
THICK = 2.0  # standard deviations from a plane near by within which a point lies on it
BESIDE_PLANES = 1.0  # metres from the planes of a roof up to which what is joined to it is building
TOUCHING = 0.01  # metres, so that points on an outline are inside whatever the rounding
PER_POINT = 100  # how much longer than others a point takes in which planes are looked for
TOP = 1.0  # metres, cells in which the highest point of a roof is looked for
SIMPLE = 0.5  # metres that squared walls may be from the points
HALO = _evidence.HALO + 25.0  # metres, for holes and for regions that are too small
COLUMNS = ("area", "perimeter", "points", "ground", "eave", "ridge", "mean", "height", "squared")

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Shapes = NDArray[Any]


@tool("classify.buildings")
class ClassifyBuildings:
    """Classify buildings, and draw their outlines with heights.

    Classify the ground first. Of the points at least `min_height` above it, roofs are those around
    which at least `planarity` of the points lie on planes, and less than twice that share lets the
    pulse through. Those on planes are joined to regions as an alpha shape; what is narrower than
    `alpha` is cut off, and regions from `smallest` to `largest` are buildings. Up to a metre beside
    them, all that looks like a roof belongs to it. Points there become class 6 up to the roof,
    walls and dormers as well, but neither ground nor branches above. Without returns planarity
    alone decides, and twice as much is asked for.

    What meets ground at roof level at two ends is a bridge, and is left out.

    Outlines are `squared`: straight walls, at right angles where they nearly are; or `alpha`, as
    the points have it. Both lie where edges of roofs are on average when points lie inside. Maps
    often show walls: take the `overhang` of the roofs off. Attributes of outlines are area,
    perimeter, number of points on planes of the roof, elevations of ground, eave, ridge and mean
    roof, height of the ridge above the ground, in the unit of the data, and whether the walls were
    squared.

    Other points keep their class, and become 1 if it was 6. Heights are HeightAboveGround if points
    have it.
    """

    points: PointCloud = source("Points with classified ground")
    min_height: float = param("Lowest roof above ground", default=2.0, unit="m", gt=0, le=20)
    smallest: float = param("Smallest building", default=10.0, unit="m2", gt=0, le=100)
    largest: float | None = param("Largest building", default=None, unit="m2", gt=0)
    planarity: float = param(
        "Least share of points on planes around what is no vegetation",
        default=0.1,
        unit="1",
        ge=0,
        le=1,
    )
    flat: float = param(
        "How far from a plane its points may be, as standard deviation",
        default=_evidence.FLAT,
        unit="m",
        gt=0,
        le=1,
    )
    radius: float = parameters.plane_radius()
    context: float = parameters.context()
    alpha: float = param(
        "Radius of the disc that rolls around a roof; gaps of twice that are closed",
        default=1.5,
        unit="m",
        gt=0,
        le=20,
    )
    outline: Literal["squared", "alpha"] = param("How outlines are drawn", default="squared")
    ground_classes: ClassList = parameters.ground_classes()
    overhang: float = param(
        "Roof beyond the walls, taken off the outlines; 0 shows roofs",
        default=0.0,
        unit="m",
        ge=0,
        le=2,
    )
    ignore: ClassList | None = parameters.ignore()
    keep_classes: ClassList | None = parameters.keep_classes()

    @outputs
    class Outputs:
        classified: PointCloud = sink("The same points with buildings as class 6")
        outlines: Vector = sink("Outlines of roofs with heights")
        building_share: float = sink("Share of points that became building", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """The size limits are in order."""
        if self.largest is not None and self.largest < self.smallest:
            yield "largest", f"must be >= smallest ({self.smallest:g}), got {self.largest:g}"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have a classification."""
        if "classification" not in self.points:
            yield "points", f"{self.points.name} has no classification; classify ground first"

    def halo(self) -> float:
        """Distance beyond which points change no class; outlines twice as long may be cut."""
        return HALO

    def run(self, ctx: Context = QUIET) -> ClassifyBuildings.Outputs:
        """Find roof points, join them to buildings, and classify the points of these."""
        cloud, metre = self.points, self.points.metre
        part = taking_part(cloud, self.ignore, among(self.keep_classes, STRUCTURES))
        if not len(cloud):
            return self._packed(part, part, [])
        features = self._features(part, ctx.part(0.0, 0.6))
        roof = self._roof(features)
        planes = on_planes(features, roof, ctx.part(0.6, 0.65))
        shapes = self._buildings(features, planes, ctx.part(0.65, 0.75))
        joined = self._regions(features, roof, ctx.part(0.75, 0.85))
        found = np.zeros(len(cloud), bool)
        found[part] = up_to_the_roof(
            features, roof, with_what_is_joined(shapes, joined, metre), metre
        )
        ctx.progress(0.9)
        rows = self._rows(features, planes, shapes, ctx.part(0.9, 1.0))
        ctx.progress(1.0)
        return self._packed(found, part, rows)

    def _features(self, part: Mask, ctx: Context) -> _evidence.PointFeatures:
        """The points that take part, with their features."""
        cloud = self.points if part.all() else self.points.select(part)
        if not np.isin(cloud["classification"], self.ground_classes).any():
            raise NothingToDo(
                f"points: none is of class {self.ground_classes}; classify ground first",
                instead=self._packed(np.zeros(len(part), bool), part, []),
            )
        features = _evidence.PointFeatures(
            cloud,
            self.radius,
            self.context,
            ctx,
            flat=self.flat / cloud.metre,
            ground_classes=self.ground_classes,
        )
        if not features.has_several_returns:
            log.warning("no pulse has several returns: dense crowns may be taken for roofs")
        return features

    def _roof(self, features: _evidence.PointFeatures) -> Mask:
        """True for points that look like a roof."""
        ground, height = features.terrain
        least = self.planarity * (1 if features.has_several_returns else 2)
        flat = features.around["planarity"] >= least
        return ~ground & (height >= self.min_height / features.cloud.metre) & flat & solid(features)

    def _regions(self, features: _evidence.PointFeatures, some: Mask, ctx: Context) -> Shapes:
        """Polygons around roof points, at least of the smallest size of a building."""
        try:
            shape = alpha_shape(
                features.xyz[some, :2],
                self.alpha,
                hole_threshold=self.smallest,
                region_threshold=self.smallest,
                ctx=ctx,
            )
        except DataError:  # no roof point, or hardly any
            return np.empty(0, object)
        shapes = without_spikes(shape.polygons, self.alpha)
        return shapes[shapely.area(shapes) >= self.smallest]

    def _buildings(self, features: _evidence.PointFeatures, planes: Mask, ctx: Context) -> Shapes:
        """Polygons around the planes of roofs of an allowed size, without bridges."""
        shapes = self._regions(features, planes, ctx)
        if self.largest is not None:
            shapes = shapes[shapely.area(shapes) <= self.largest]
        return shapes[~bridges(features, planes, shapes)]

    def _rows(
        self, features: _evidence.PointFeatures, planes: Mask, shapes: Shapes, ctx: Context
    ) -> list[dict[str, Any]]:
        """Attributes and outline of each building; several where only the overhang joins them."""
        rows, narrow, roofs = [], 0, SortedPoints.of(features.xyz, planes)
        for done, shape in enumerate(shapes):
            ctx.progress(done / len(shapes))
            inside = roofs.within(shape.buffer(TOUCHING * features.cloud.metre))
            roof, straight = self._drawn(shape, len(inside) / shape.area)
            walls = roof.buffer(-self.overhang, join_style="mitre")
            narrow += walls.is_empty
            rows += [
                {"area": drawn.area, "perimeter": drawn.length, "points": len(inside)}
                | heights(features, inside, shape)
                | {"squared": straight, "geometry": drawn}
                for drawn in shapely.get_parts(roof if walls.is_empty else walls)
            ]
        if narrow:
            log.warning("roofs narrower than twice the overhang, drawn as they are: %d", narrow)
        return rows

    def _drawn(self, shape: Any, density: float) -> tuple[Any, bool]:
        """The outline of a roof, and whether it was squared."""
        roof = shape.buffer(margin(density, self.alpha), join_style="mitre")
        if self.outline == "alpha":
            return roof, False
        return squared(roof, SIMPLE * self.points.metre, self.alpha)

    def _packed(
        self, found: Mask, part: Mask, rows: list[dict[str, Any]]
    ) -> ClassifyBuildings.Outputs:
        import geopandas

        cloud = self.points
        frame = geopandas.GeoDataFrame(
            rows, columns=[*COLUMNS, "geometry"], geometry="geometry", crs=cloud.crs
        )
        old = cloud["classification"]
        free = part & ~np.isin(old, self.keep_classes or ())
        classes = np.where(free & (old == BUILDING), OTHER, old)
        classes = np.where(free & found, BUILDING, classes).astype(np.uint8)
        return self.Outputs(
            classified=cloud.with_attributes({"classification": classes}),
            outlines=Vector(frame, geometry_type="Polygon"),
            building_share=Share.of_points(free & found, cloud.core),
        )


def without_spikes(shapes: Shapes, width: float) -> Shapes:
    """Polygons without what is narrower than a width, such as branches and fences beside a roof."""
    core = shapely.buffer(shapes, -width / 2, join_style="mitre")
    return np.asarray(shapely.get_parts(shapely.buffer(core, width / 2, join_style="mitre")))


def on_planes(features: _evidence.PointFeatures, roof: Mask, ctx: Context = QUIET) -> Mask:
    """True for roof points on a plane: their own, or that of another roof point within the radius.

    What stands beside a roof looks like one to :class:`_evidence.PointFeatures`, which judges by
    all that is around; but it does not lie on the planes of the roof.

    Returns
    -------
    array of shape (n,)
    """
    off_plane, normal = features.planes
    own = roof & (off_plane <= features.flat) & np.isfinite(normal).all(axis=1)
    others = np.flatnonzero(roof & ~own)
    found = own.copy()
    if not own.any() or not len(others):
        return found
    tree = PointTree.of(features.xyz[own], ctx=ctx.part(0.0, 0.3))
    near = np.zeros(len(others), bool)
    side_by_side(
        kernels.on_planes,
        blocks(len(others), PER_POINT),
        features.xyz[others],
        tree.xyz,
        normal[own][tree.order],
        tree.boxes,
        tree.depth,
        features.radius,
        THICK * features.flat * features.cloud.metre,
        near,
        ctx=ctx.part(0.3, 1.0),
    )
    found[others] = near
    return found


def with_what_is_joined(shapes: Shapes, joined: Shapes, metre: float) -> Shapes:
    """Polygons of roofs with what is joined to them near their planes: gutters, dormers, walls.

    Parameters
    ----------
    shapes : polygons around the planes of roofs
    joined : polygons around all that looks like a roof
    metre : length of one metre in the unit of the data
    """
    near = shapely.union_all(shapely.buffer(shapes, BESIDE_PLANES * metre))
    found = shapely.union_all([*shapes, *shapely.intersection(joined, near)])
    parts = shapely.get_parts(found)
    return np.asarray(parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON])


def margin(density: float, alpha: float) -> float:
    """Mean distance by which a straight edge lies outside the alpha shape of points along it.

    Between two points that it touches, a disc of radius r sinks in by h = l^2 / (8 r) for a chord
    of length l. Where one point is expected in the area l h, no other is in the way: so
    h = (density sqrt(8 r))^(-2/3), as it is with convex hulls (Rényi and Sulanke 1963).

    Parameters
    ----------
    density : points per area
    alpha : radius of the disc
    """
    return float((density * np.sqrt(8 * alpha)) ** (-2 / 3))


def up_to_the_roof(
    features: _evidence.PointFeatures, roof: Mask, shapes: Shapes, metre: float
) -> Mask:
    """True for points in outlines below the roof, and for roof points just outside of them.

    Parameters
    ----------
    features : n points
    roof : array of shape (n,), those that look like a roof
    shapes : polygons around them
    metre : length of one metre in the unit of the points

    Returns
    -------
    array of shape (n,)
    """
    xyz = features.xyz
    if not len(shapes):
        return np.zeros(len(xyz), bool)
    ground, height = features.terrain
    inside = Polygons.of(shapes).hold(xyz)
    wider = shapely.get_parts(shapely.union_all(shapely.buffer(shapes, EAVES * metre)))
    beside = Polygons.of(wider).hold(xyz)
    below = xyz[:, 2] <= highest_around(xyz, roof & inside, TOP * metre)
    return np.asarray(~ground & (height > FOOT) & ((inside & below) | (beside & solid(features))))


def highest_around(xyz: Floats, some: Mask, cell: float) -> Floats:
    """Highest of some points in the 3 x 3 cells around each point; -inf where there is none."""
    lattice = Lattice.cover((*xyz[:, :2].min(axis=0), *xyz[:, :2].max(axis=0)), cell)
    row, col = lattice.indices(xyz[:, 0], xyz[:, 1])
    top = np.full(lattice.shape, -np.inf)
    np.maximum.at(top, (row[some], col[some]), xyz[some, 2])
    return np.asarray(maximum_filter(top, 3, mode="constant", cval=-np.inf)[row, col])


def heights(
    features: _evidence.PointFeatures, inside: NDArray[np.int64], shape: Any
) -> dict[str, float]:
    """Elevations of the ground, eave, ridge and mean roof, and the height of the ridge.

    The eave is the tenth percentile of the roof points near the outline, the ridge the highest
    hundredth of all, so that neither a gutter nor a chimney decides.
    """
    z, metre = features.xyz[inside, 2], features.cloud.metre
    ground = float(np.median(z - features.terrain[1][inside] * metre))
    middle = shapely.get_parts(shape.buffer(-metre))
    edge = ~Polygons.of(middle).hold(features.xyz[inside])
    ridge = float(np.percentile(z, 99))
    return {
        "ground": ground,
        "eave": float(np.percentile(z[edge] if edge.any() else z, 10)),
        "ridge": ridge,
        "mean": float(z.mean()),
        "height": ridge - ground,
    }
