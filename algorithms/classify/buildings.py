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

How well it does, and what it takes for a building: docs/explanation/urban-classes.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from algorithms.classify import _buildings_kernels as kernels
from algorithms.classify import _columns as columns
from algorithms.classify import _evidence
from algorithms.classify._bridges import bridges
from algorithms.classify._crowns import CLOSED, crowns
from algorithms.classify._density import ALPHA, SPARSE, Lengths
from algorithms.classify._doubtful_heights import warn_of_doubtful_heights
from algorithms.classify._evidence import FOOT, solid
from algorithms.classify._outlines import (
    TOUCHING,
    is_ground_around,
    margin,
    name_of,
    within_data,
    without_spikes,
)
from algorithms.classify._parts import levels, tiles
from algorithms.classify._refused import refused_in_words, steep_regions, unlike, warn_of_lost
from algorithms.classify._roofs import Roof, form, main_section
from algorithms.classify._squared import main_direction, squared
from algorithms.classify._vehicles import (
    SEEN,
    as_narrow_and_low,
    ground_seen,
    in_rows,
    large_vehicles,
)
from algorithms.shared import parameters
from algorithms.shared.alpha_shape import Gaps, alpha_shape
from algorithms.shared.data_edge import cut
from algorithms.shared.delaunay import Mesh, triangulate
from algorithms.shared.ground import among, taking_part
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import blocks
from algorithms.shared.neighbours import PointTree
from algorithms.shared.parameters import NAMED_STRUCTURES
from algorithms.shared.polygons import Polygons
from algorithms.shared.selection import of_classes
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Vector
from toolbox.declare import ClassList, Share, outputs, param, show, sink, source, tool
from toolbox.errors import DataError, NothingToDo

BUILDING, OTHER = np.uint8(_evidence.BUILDING), np.uint8(1)
EAVES = 0.4  # metres beyond the outline in which points of the roof may lie
THICK = 2.0  # standard deviations from a plane near by within which a point lies on it
BESIDE_PLANES = 1.0  # metres from the planes of a roof up to which what is joined to it is building
PER_POINT = 100  # how much longer than others a point takes in which planes are looked for
TOP = 1.0  # metres, cells in which the highest point of a roof is looked for
SIMPLE = 0.5  # metres that squared walls may be from the outline of the points
SIMPLE_BY_SPACING = 1.4  # times the spacing of points: the same where that is more
ROUNDING = 1e-9  # of a length: in feet the same one may come out a little shorter
BELOW_DISC = 1.58  # times the spacing of points: least radius of a disc, with eight of them below
MOST = 0.5  # share of a region that is left without the ground in it, if there are roofs in it:
# what is mostly cut off was joined by accident, as crowns at Autzen are
HALF_AS_DENSE = 0.5**0.5  # times as far apart are twice as many points per area
HALO = _evidence.HALO + 25.0  # metres, for holes and for regions that are too small

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Shapes = NDArray[Any]
Rows = list[dict[str, Any]]


@tool(
    "classify.buildings",
    title="Classify buildings",
    tags=(
        "building",
        "house",
        "roof",
        "footprint",
        "outline",
        "eaves",
        "lod1",
    ),
)
class ClassifyBuildings:
    """Classify buildings, and draw their outlines with heights.

    Classify the ground first. Of the points at least `min_height` above it, roofs are those around
    which at least `planarity` of the points lie on planes, and less than twice that share lets the
    pulse through. Those on planes are joined to regions as an alpha shape; what is narrower than
    `alpha` is cut off, and regions from `smallest` to `largest` are buildings. Where `alpha` is not
    given they are parted where most points in a gap, as between houses, are ground. Up to a metre
    beside them, all that looks like a roof belongs to it, and so does what it encloses, such as
    solar panels, if it is as high, hides the ground and lets hardly a pulse through. Points there
    become class 6 up to the roof, walls and dormers as well, but neither ground nor branches above.
    Without returns planarity alone decides, and twice as much is asked for.

    What is as narrow and low as vehicles and stands free, with ground also between it and a wall
    close by, is a bus, a tram, a lorry or a container.
    What has ground in between hides none, and is no roof; where points are sparse and `alpha` is
    not given, smaller discs part it first. Nor is what is steep, with a third of its points on no
    plane, as crowns of conifers, unless it has walls: points down to its foot, though hardly a
    pulse went on. Such regions are the layer `refused`. What meets ground at roof level at two ends
    is a bridge. All these are left out. Where `given`, the same points, has buildings, of
    `smallest` or more, and none is now, that is told with the place.

    Outlines are `squared`: straight walls, at right angles where they nearly are; or `alpha`, as
    the points have it. Both lie where edges of roofs are on average when points lie inside. Maps
    often show walls: take the `overhang` of the roofs off.

    Attributes of outlines: id, made of the whole easting and northing of a place within; area,
    perimeter, number of points on planes of the roof, to which those of the parts add up;
    elevations of ground, of the eave of the main roof, of the ridge and mean of all the roof, and
    height of the ridge above the ground, in the unit of the data; form of the main roof (flat,
    monopitch, gable, hip, other); confidence, the share of its points that lie on planes, less
    where ground is seen within; whether the walls were squared; and sections, the parts of 10 m² or
    more into which steps of its surface divide the roof. Houses that touch are one building, since
    points from above do not show the walls between them: sections hint at it where their roofs
    differ in height. What the edge of the data cuts has the attribute cut: all of its figures are
    those of the part that was seen.

    `parts` are the blocks of a city model: sections of 10 m² or more that lie beside each other and
    whose mean heights differ by 2 m or more, as a tower and a low wing. Straight walls part them,
    and together they are the outlines, without gaps; a roof at one height is one part. The ground
    is that of the building, the attribute building its id, and building_height its height. The
    other heights of a part are those of its own sections of 10 m² or more: a smaller one, such as a
    dormer, counts for the building alone, which may be higher than its highest part. A part is cut
    where the edge of the data meets the part itself. As CityJSON they are LoD1.3, the outlines
    alone LoD1.2.

    `radius`, `context` and `alpha` follow the density of the points unless they are given, and
    `flat` the noise of points on the ground where pulses have several returns; much noise is told.
    Other points keep their class, and become 1 if it was 6. Heights are HeightAboveGround if points
    have it.
    """

    points: PointCloud = source("Points with classified ground")
    given: PointCloud | None = source(
        "The same points with the classes of the file: buildings that are none now are told",
        default=None,
        label="Points with the classes of the file",
    )
    min_height: float = param(
        "Lowest roof above ground", default=2.0, unit="m", gt=0, le=20, label="Lowest roof"
    )
    smallest: float = param(
        "Smallest building", default=10.0, unit="m2", gt=0, le=100, label="Smallest building"
    )
    largest: float | None = param(
        "Largest building", default=None, unit="m2", gt=0, label="Largest building"
    )
    planarity: float = parameters.planarity()
    flat: float | None = parameters.flat_by_noise()
    radius: float | None = parameters.radius_by_density()
    context: float | None = parameters.context_by_density()
    alpha: float | None = param(
        "Radius of the disc that rolls around a roof; without it, by the density: 1.5 m or more",
        default=None,
        unit="m",
        gt=0,
        le=20,
        label="Radius of the disc (alpha)",
    )
    outline: Literal["squared", "alpha"] = param(
        "How outlines are drawn",
        default="squared",
        label="Outlines are drawn",
        words={"squared": "With right angles", "alpha": "As the points lie (alpha shape)"},
    )
    ground_classes: ClassList = parameters.ground_classes()
    overhang: float = param(
        "Roof beyond the walls, taken off the outlines; 0 shows roofs",
        default=0.0,
        unit="m",
        ge=0,
        le=2,
        label="Overhang of roofs",
    )
    ignore: ClassList | None = parameters.ignore()
    keep_classes: ClassList | None = parameters.keep_classes()

    @outputs
    class Outputs:
        classified: PointCloud = sink(
            "The same points with buildings as class 6", label="Classified points"
        )
        outlines: Vector = sink(
            "Outlines of roofs with heights; confidence: share of points on planes, less where "
            "ground is seen",
            show=show.OfClass(6),
            columns=columns.BUILDINGS,
            also=(".city.json",),
        )
        parts: Vector = sink(
            "Parts of buildings at different heights, which tile the outlines",
            show=show.Values("height", label="Ridge above the ground", length=True),
            columns=columns.PARTS,
            also=(".city.json",),
        )
        refused: Vector = sink(
            "Regions that look like roofs, but are steep and torn as crowns of conifers",
            show=show.OfClass(5),
            label="Steep regions that are no buildings",
            columns=columns.REFUSED,
        )
        building_share: float = sink("Share of points that became building", unit="1")

        def in_words(self) -> str:
            """How many buildings, and how high."""
            frame, metre = self.outlines.frame, self.outlines.metre
            if frame.empty:
                return "No buildings were found."
            heights = frame["height"] / metre
            span = f"{heights.min():.1f} to {heights.max():.1f} m"
            several = int((frame["parts"] > 1).sum())
            return (
                f"Buildings: {len(frame)}, {frame['area'].sum() / metre**2:.0f} m² in all, {span} "
                "high, counted by roof. An outline is that of a connected roof, not a plot or a "
                "unit of a land register: houses that touch, as in a terrace, are one. With parts "
                f"of different heights: {several}; in all {len(self.parts)} parts."
            )

        def not_looked_at(self) -> Iterator[str]:
            """What was cut, what looks like a roof and is none, and roofs that do not look so."""
            if parts := int(self.outlines.frame["cut"].astype(bool).sum()):
                yield (
                    f"Buildings that the edge of the data cuts: {parts} of "
                    f"{len(self.outlines)}; their area, height and form are of the part that was "
                    "seen (column cut)."
                )
            if len(self.refused):
                yield refused_in_words(self.refused)
            yield "Glass lets pulses through, and greenhouses may be missing."
            if not len(self.outlines):
                return
            yield (
                "Containers side by side or in stacks look like flat roofs, and may be among the "
                "buildings."
            )
            yield (
                "A van or lorry so close to a wall that no ground is seen between, and vehicles "
                "side by side where points are 1 m apart or more, look like flat roofs: they may "
                "be among the buildings or be parts of one."
            )

    def check(self) -> Iterator[tuple[str, str]]:
        """The size limits are in order."""
        if self.largest is not None and self.largest < self.smallest:
            yield "largest", f"must be >= smallest ({self.smallest:g}), got {self.largest:g}"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have a classification."""
        if "classification" not in self.points:
            yield "points", f"{self.points.name} has no classification; classify ground first"
        yield from unlike(self.given, self.points)

    def halo(self) -> float:
        """Distance beyond which points change no class; outlines twice as long may be cut."""
        return HALO

    def run(self, ctx: Context = QUIET) -> ClassifyBuildings.Outputs:
        """Find roof points, join them to buildings, and classify the points of these."""
        cloud, metre = self.points, self.points.metre
        part = taking_part(cloud, self.ignore, among(self.keep_classes, NAMED_STRUCTURES))
        if not len(cloud):
            return self._packed(part, part, [], [], [])
        given = self.radius, self.context, self.alpha
        lengths = Lengths.of(cloud, self.flat, *given, ctx=ctx)
        if lengths.spacing > SPARSE * metre:
            log.warning(
                "points are some %.1f m apart, too sparse for many roofs: expect buildings to be "
                "missing, small ones first",
                lengths.spacing / metre,
            )
        features = self._features(part, lengths, ctx.part(0.0, 0.55))
        self._warn_of_no_height(features, lengths)
        roof = self._roof(features, lengths, ctx.part(0.55, 0.6))
        planes = on_planes(features, roof, ctx.part(0.6, 0.65))
        shapes, trees = self._buildings(features, planes, lengths, ctx.part(0.65, 0.75))
        joined = self._regions(features.xyz[roof, :2], lengths, ctx=ctx.part(0.75, 0.85))
        shapes, rough = without_holes(shapes, features, self.min_height)
        roof |= rough
        found = np.zeros(len(cloud), bool)
        found[part] = up_to_the_roof(
            features, roof, with_what_is_joined(shapes, joined, metre), metre
        )
        ctx.progress(0.9)
        rows, parts = self._rows(features, planes, shapes, lengths, ctx.part(0.9, 1.0))
        warn_of_doubtful_heights(rows, features, found[part])
        ctx.progress(1.0)
        steep = steep_regions(trees, cloud, features, lengths)
        result = self._packed(found, part, rows, parts, steep)
        if self.given is not None:
            warn_of_lost(self.given, result.classified, self.smallest, lengths)
        return result

    def _features(self, part: Mask, lengths: Lengths, ctx: Context) -> _evidence.PointFeatures:
        """The points that take part, with their features."""
        cloud = self.points if part.all() else self.points.select(part)
        if not of_classes(cloud["classification"], self.ground_classes).any():
            raise NothingToDo(
                f"points: none is of class {self.ground_classes}; classify ground first",
                instead=self._packed(np.zeros(len(part), bool), part, [], [], []),
            )
        features = _evidence.PointFeatures(
            cloud,
            lengths.radius,
            lengths.context,
            ctx,
            flat=lengths.flat,
            by_noise=lengths.by_noise,
            ground_classes=self.ground_classes,
        )
        features.warn_without_returns("dense crowns may be taken for roofs")
        return features

    def _warn_of_no_height(self, features: _evidence.PointFeatures, lengths: Lengths) -> None:
        """Tell that points too far from any ground are no building, as the middle of a hall."""
        ground, height = features.terrain
        lost = np.flatnonzero(~ground & np.isnan(height))
        if len(lost) * lengths.spacing**2 >= self.smallest:
            x, y, _ = features.xyz[lost[len(lost) // 2]]
            log.warning(
                "points without a height, as no ground is known near them, so that none is "
                "building: %d, one at %.1f, %.1f; the middle of a hall, a wood, or water",
                len(lost),
                x,
                y,
            )

    def _roof(self, features: _evidence.PointFeatures, lengths: Lengths, ctx: Context) -> Mask:
        """True for points that look like a roof, and are of no vehicle."""
        (ground, height), metre = features.terrain, features.cloud.metre
        least = self.planarity * (1 if features.has_several_returns else 2)
        flat = features.around["planarity"] >= least
        roof = ~ground & (height >= self.min_height / metre) & flat & solid(features)
        return roof & ~large_vehicles(features, roof, lengths.spacing, self.smallest, ctx)

    def _regions(
        self, xy: Floats | Mesh, lengths: Lengths, gaps: Gaps | None = None, ctx: Context = QUIET
    ) -> Shapes:
        """Polygons around roof points, at least of the smallest size of a building."""
        try:
            shape = alpha_shape(
                xy,
                lengths.alpha,
                gaps=gaps,
                hole_threshold=self.smallest,
                region_threshold=self.smallest,
                ctx=ctx,
            )
        except DataError:  # no roof point, or hardly any
            return np.empty(0, object)
        shapes = without_spikes(shape.polygons, lengths.alpha)
        return shapes[shapely.area(shapes) >= self.smallest]

    def _buildings(
        self, features: _evidence.PointFeatures, planes: Mask, lengths: Lengths, ctx: Context
    ) -> tuple[Shapes, Shapes]:
        """Polygons around the planes of roofs of an allowed size, and of crowns like them."""
        try:
            mesh = triangulate(features.xyz[planes, :2], ctx=ctx)
        except DataError:  # no roof point, or hardly any
            return np.empty(0, object), np.empty(0, object)
        shapes = self._regions(mesh, lengths, ctx=ctx.part(1.0, 1.0))
        shapes = shapes[~bridges(features, planes, shapes)]
        parted = self._parted(features, planes, mesh, shapes, lengths, ctx.part(1.0, 1.0))
        kept = np.unique(shapely.STRtree(shapes).query(parted, "intersects")[1])
        if gone := len(shapes) - len(kept):
            log.info("%d regions have ground in between: no roofs", gone)
        shapes = parted
        if self.largest is not None:
            shapes = shapes[shapely.area(shapes) <= self.largest]
        trees = crowns(shapes, features, planes)
        if trees.any():
            log.info(
                "%d regions are steep and torn, as crowns of conifers: no roofs",
                np.count_nonzero(trees),
            )
        return shapes[~trees], shapes[trees]

    def _parted(
        self,
        features: _evidence.PointFeatures,
        planes: Mask,
        mesh: Mesh,
        shapes: Shapes,
        lengths: Lengths,
        ctx: Context,
    ) -> Shapes:
        """What hides the ground of regions, without the gaps in which it is seen.

        Whether they hide it is asked of whole regions first: of what is left of a row of vehicles,
        some of which are parted, too little ground is seen.
        """
        open_below = ground_seen(shapes, features) > SEEN
        if self.alpha is not None:
            return shapes[~open_below]
        drawn = self._regions(mesh, lengths, _gaps(features, lengths), ctx)
        middles = shapely.point_on_surface(drawn)
        drawn = drawn[np.unique(shapely.STRtree(shapes[~open_below]).query(middles, "within")[0])]
        closed, still_open = _told(drawn, features, lengths.spacing)
        again = np.concatenate([shapes[open_below], still_open])
        others = self._without_ground(features, planes, again, lengths, ctx)
        return np.concatenate([closed, others])

    def _without_ground(
        self,
        features: _evidence.PointFeatures,
        planes: Mask,
        shapes: Shapes,
        lengths: Lengths,
        ctx: Context,
    ) -> Shapes:
        """What hides the ground of regions that do not.

        The disc is wider than courts, and where points are sparse than gardens, and joins roofs
        across them: what has ground in between is drawn again with the disc for twice as many
        points per area, as long as several points lie below it. What is as narrow and low as a
        vehicle then was one of a row. A disc smaller than for dense points also parts what only
        looks like a roof: then most of a region must be left.
        """
        smaller = lengths._replace(alpha=lengths.alpha * HALF_AS_DENSE)
        dense = (1 - ROUNDING) * ALPHA * features.cloud.metre
        if not len(shapes) or smaller.alpha < min(dense, BELOW_DISC * lengths.spacing):
            return shapes[:0]
        around = shapely.buffer(shapes, TOUCHING * features.cloud.metre)
        again = planes & Polygons.of(around).hold(features.xyz)  # their corners are points, too
        gaps = _gaps(features, lengths)
        parts = self._regions(features.xyz[again, :2], smaller, gaps, ctx)
        parts = parts[~as_narrow_and_low(parts, features)]
        closed, still_open = _told(parts, features, lengths.spacing)
        others = self._without_ground(features, planes, still_open, smaller, ctx)
        parts = np.concatenate([closed, others])
        return _most_of(parts, shapes) if smaller.alpha < dense else parts

    def _rows(
        self,
        features: _evidence.PointFeatures,
        planes: Mask,
        shapes: Shapes,
        lengths: Lengths,
        ctx: Context,
    ) -> tuple[Rows, Rows]:
        """Attributes and outline of each building and part of one.

        There are several of a roof where only its overhang joins them.
        """
        rows: Rows = []
        parts: Rows = []
        narrow = 0
        sure = confidences(shapes, features, planes)
        places, metre = self.points.places, self.points.metre
        at_edge = cut(list(shapes), places, lengths.spacing, metre, ctx=ctx)
        for done, shape in enumerate(shapes):
            ctx.progress(done / len(shapes))
            inside = features.within(shape.buffer(TOUCHING * metre), planes)
            roof, straight = self._drawn(shape, len(inside) / shape.area, lengths)
            if at_edge[done]:
                roof, straight = within_data(roof, features, lengths.spacing, straight=straight)
            walls = roof.buffer(-self.overhang, join_style="mitre")
            narrow += walls.is_empty
            of_roof = heights(features, inside, shape, lengths)
            for drawn in shapely.get_parts(roof if walls.is_empty else walls):
                row = {"id": name_of(drawn), "area": drawn.area, "perimeter": drawn.length}
                row |= {"points": len(inside), **of_roof, "confidence": sure[done]}
                found = self._parts(features, inside, drawn, lengths)
                row |= {"squared": straight, "parts": len(found), "geometry": drawn}
                held = np.bincount(
                    nearest([part for part, _ in found], features.xyz[inside]), minlength=len(found)
                )
                own = [
                    part_row(row, features, *part, lengths) | {"points": int(count)}
                    for part, count in zip(found, held, strict=True)
                ]
                rows.append(row | highest(row, own))
                parts += [part | {"building_height": rows[-1]["height"]} for part in own]
        outlined = [row["geometry"] for row in rows + parts]
        at_edge = cut(outlined, places, lengths.spacing, metre, ctx=ctx)
        for row, there in zip(rows + parts, at_edge, strict=True):
            row["cut"] = bool(there)
        if narrow:
            log.warning("roofs narrower than twice the overhang, drawn as they are: %d", narrow)
        return rows, parts

    def _drawn(self, shape: Any, density: float, lengths: Lengths) -> tuple[Any, bool]:
        """The outline of a roof, and whether it was squared."""
        roof = shape.buffer(margin(density, lengths.alpha), join_style="mitre")
        if self.outline == "alpha":
            return roof, False
        return squared(roof, self._tolerance(lengths), lengths.alpha)

    def _tolerance(self, lengths: Lengths) -> float:
        """How far squared walls may be from the outline of the points, in their unit."""
        return max(SIMPLE * self.points.metre, SIMPLE_BY_SPACING * lengths.spacing)

    def _parts(
        self, features: _evidence.PointFeatures, inside: Ints, outline: Any, lengths: Lengths
    ) -> list[tuple[Any, Ints]]:
        """Parts of a building by height: their outlines, and the points of the roof of each."""
        metre = self.points.metre
        roof = Roof(features.xyz[inside] / metre, features.planes[1][inside])
        inside = inside[roof.no_walls]
        level = levels(roof.without_walls(), lengths.spacing / metre)
        if not level.any():
            return [(outline, inside)]
        tolerance, angle = self._tolerance(lengths), main_direction(outline)
        height = [-features.xyz[inside[level == k], 2].mean() for k in range(level.max() + 1)]
        drawn = [
            squared(
                shape.buffer(margin(len(inside) / outline.area, lengths.alpha), join_style="mitre"),
                tolerance,
                lengths.alpha,
                angle,
            )[0]
            for k in np.argsort(height)
            for shape in self._regions(features.xyz[inside[level == k], :2], lengths)
        ]
        found = tiles(
            outline,
            features.xyz[inside],
            level,
            drawn,
            tolerance=tolerance,
            width=lengths.alpha,
            metre=metre,
        )
        return [(part.shape, inside[part.own]) for part in found]

    def _packed(
        self, found: Mask, part: Mask, rows: Rows, parts: Rows, refused: Rows
    ) -> ClassifyBuildings.Outputs:
        cloud = self.points
        old = cloud["classification"]
        free = part & ~of_classes(old, self.keep_classes or ())
        classes = np.where(free & (old == BUILDING), OTHER, old)
        classes = np.where(free & found, BUILDING, classes).astype(np.uint8)
        return self.Outputs(
            classified=cloud.with_attributes({"classification": classes}),
            outlines=self._layer(rows, columns.BUILDINGS),
            parts=self._layer(parts, columns.PARTS),
            refused=self._layer(refused, columns.REFUSED),
            building_share=Share.of_points(free & found, cloud.core),
        )

    def _layer(self, rows: Rows, names: Iterable[str]) -> Vector:
        import geopandas

        frame = geopandas.GeoDataFrame(
            rows, columns=[*names, "geometry"], geometry="geometry", crs=self.points.crs
        )
        return Vector(frame, geometry_type="Polygon")


def _gaps(features: _evidence.PointFeatures, lengths: Lengths) -> Gaps:
    """Gaps between roof points in which ground is seen: between houses, or a wall and a lamp."""
    radius = BELOW_DISC * lengths.spacing
    return Gaps(radius, partial(is_ground_around, features, radius))


def _told(
    shapes: Shapes, features: _evidence.PointFeatures, spacing: float
) -> tuple[Shapes, Shapes]:
    """Those that hide the ground, and those that do not; without vehicles side by side."""
    seen = ground_seen(shapes, features)
    left = ~in_rows(shapes, seen, features, spacing)
    return shapes[left & (seen <= SEEN)], shapes[left & (seen > SEEN)]


def _most_of(parts: Shapes, regions: Shapes) -> Shapes:
    """Parts of the regions of which most is left."""
    part, region = shapely.STRtree(regions).query(parts, "intersects")
    shared = shapely.area(shapely.intersection(parts[part], regions[region]))
    left = np.bincount(region, shared, minlength=len(regions)) >= MOST * shapely.area(regions)
    return np.asarray(parts[np.unique(part[left[region]])])


def on_planes(features: _evidence.PointFeatures, roof: Mask, ctx: Context = QUIET) -> Mask:
    """True for roof points on a plane: their own, or that of another roof point within the radius.

    What stands beside a roof looks like one to :class:`_evidence.PointFeatures`, which judges by
    all that is around; but it does not lie on the planes of the roof.

    Returns
    -------
    array of shape (n,)
    """
    off_plane, normal = features.planes
    own = roof & (off_plane <= features.flatness) & np.isfinite(normal).all(axis=1)
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
        THICK * features.flatness[others] * features.cloud.metre,
        near,
        ctx=ctx.part(0.3, 1.0),
    )
    found[others] = near
    return found


def without_holes(
    shapes: Shapes, features: _evidence.PointFeatures, lowest: float
) -> tuple[Shapes, Mask]:
    """Roofs with their holes filled in which nothing but roof is seen, and the points in these.

    Solar panels, air conditioning and skylights lie on no plane of the roof. Courts show ground,
    and trees in them let pulses through. Where no pulse has several returns, holes stay.

    Parameters
    ----------
    shapes : polygons around the planes of roofs
    features : n points
    lowest : height of a roof, metres

    Returns
    -------
    polygons, and array of shape (n,)
    """
    ground, height = features.terrain
    rough = np.zeros(len(ground), bool)
    rings, owner = shapely.get_rings(shapes, return_index=True)
    inner = np.concatenate([[False], owner[1:] == owner[:-1]])  # the first is the outer one
    if not features.has_several_returns or not inner.any():
        return shapes, rough
    holes = shapely.polygons(rings[inner])
    filled: dict[int, list[Any]] = {}
    for hole, number in zip(holes, owner[inner].tolist(), strict=True):
        inside = features.within(hole)
        high = inside[height[inside] >= lowest]
        if not len(high) or np.count_nonzero(ground[inside]) > SEEN * len(inside):
            continue
        if features.let_through[high].mean() <= CLOSED:
            filled.setdefault(number, []).append(hole)
            rough[high] = True
    whole = shapes.copy()
    for number, some in filled.items():
        whole[number] = shapely.union_all([shapes[number], *some])
    return whole, rough


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
    below = inside.copy()
    below[inside] = xyz[inside, 2] <= highest_around(xyz[inside], roof[inside], TOP * metre)
    return np.asarray(~ground & (height > FOOT) & (below | (beside & solid(features))))


def highest_around(xyz: Floats, some: Mask, cell: float) -> Floats:
    """Highest of some points in the 3 x 3 cells around each point; -inf where there is none."""
    if not some.any():
        return np.full(len(xyz), -np.inf)
    lattice = Lattice.cover((*xyz[:, :2].min(axis=0), *xyz[:, :2].max(axis=0)), cell)
    row, col = lattice.indices(xyz[:, 0], xyz[:, 1])
    top = np.full(lattice.shape, -np.inf)
    np.maximum.at(top, (row[some], col[some]), xyz[some, 2])
    return np.asarray(maximum_filter(top, 3, mode="constant", cval=-np.inf)[row, col])


def heights(
    features: _evidence.PointFeatures, inside: NDArray[np.int64], shape: Any, lengths: Lengths
) -> dict[str, Any]:
    """Elevations of ground, eave, ridge and mean roof, height of the ridge, form and sections.

    Points on walls do not count. The ridge is the highest hundredth, so that no chimney decides.
    """
    metre = features.cloud.metre
    roof = Roof(features.xyz[inside] / metre, features.planes[1][inside]).without_walls()
    section = main_section(roof, lengths.spacing / metre)
    ground = float(np.median(features.ground_below(inside)))
    ridge = float(np.percentile(roof.xyz[:, 2], 99)) * metre
    return {
        "ground": ground,
        "eave": section.eave * metre,
        "ridge": ridge,
        "mean": float(roof.xyz[:, 2].mean()) * metre,
        "height": ridge - ground,
        "form": form(section.roof, shape),
        "sections": section.parts,
    }


def part_row(
    row: dict[str, Any],
    features: _evidence.PointFeatures,
    shape: Any,
    inside: Ints,
    lengths: Lengths,
) -> dict[str, Any]:
    """Attributes and outline of a part of a building, the ground of which is that of the whole.

    Parameters
    ----------
    row : attributes of the building
    shape : outline of the part
    inside : its points on planes that are no walls
    """
    found = heights(features, inside, shape, lengths) if row["parts"] > 1 else dict(row)
    made = {"id": name_of(shape), "building": row["id"], "area": shape.area}
    height = found["ridge"] - row["ground"]
    return found | made | {"ground": row["ground"], "height": height, "geometry": shape}


def nearest(shapes: list[Any], xyz: Floats) -> Ints:
    """Number of the shape that holds each point, or is the nearest, array of shape (n,)."""
    return np.asarray(shapely.STRtree(shapes).nearest(shapely.points(xyz[:, :2])), np.int64)


def highest(row: dict[str, Any], parts: Rows) -> dict[str, float]:
    """Ridge and height of a building, at least those of its highest part.

    A part that is small beside its building has more than a hundredth of it above the ridge.
    """
    ridge = max(row["ridge"], *(part["ridge"] for part in parts))
    return {"ridge": ridge, "height": ridge - row["ground"]}


def confidences(shapes: Shapes, features: _evidence.PointFeatures, planes: Mask) -> Floats:
    """How sure it is that regions are roofs, from 0 to 1, array of shape (m,).

    The share of the points above the ground that lie on planes of the roof; less where ground is
    seen in between, and 0 at the limit of that.
    """
    seen = ground_seen(shapes, features) / SEEN
    above = features.terrain[1] > FOOT
    # The corners of outlines are points, too.
    around = shapely.buffer(shapes, TOUCHING * features.cloud.metre)
    flat = [planes[features.within(shape, above)].mean() for shape in around]
    return np.asarray(flat) * (1 - seen)
