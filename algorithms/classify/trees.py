"""Trees: their tops and crowns, from classified points.

The highest points of the vegetation make a raster of hills, one for each crown. A dip between two
tops that is less deep than crowns are rough parts branches, not trees.

References
----------
Chazal, F., Guibas, L., Oudot, S. and Skraba, P. (2013). Persistence-based clustering in Riemannian
manifolds. Journal of the ACM 60(6), 41: hills, joined where the lower top is not prominent.
Hyyppä, J. et al. (2001). A segmentation-based method to retrieve stem volume estimates from 3-D
tree height models produced by laser scanners. IEEE Transactions on Geoscience and Remote Sensing
39(5), 969-975: a smoothed raster of the canopy, and its tops.

How well it does: docs/explanation/urban-classes.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from algorithms.classify import _columns as columns
from algorithms.classify import _evidence
from algorithms.classify import _trees_kernels as kernels
from algorithms.classify._density import SPARSE, Lengths
from algorithms.classify._outlines import Shapes, margin, name_of
from algorithms.classify._refused import unlike
from algorithms.shared import parameters
from algorithms.shared.alpha_shape import alpha_shapes_of_groups
from algorithms.shared.data_edge import cut
from algorithms.shared.ground import without_withheld
from algorithms.shared.heights import HEIGHT
from algorithms.shared.kernels.sorting import grouped, stable
from algorithms.shared.selection import of_classes
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Vector
from toolbox.declare import ClassList, outputs, param, show, sink, source, tool
from toolbox.errors import NothingToDo

CELL, BY_SPACING = 0.5, np.sqrt(2.0)  # metres, and times the spacing where points are sparse:
# two points in a cell, so that hardly any is empty
SMOOTH = 0.5  # metres, standard deviation of the Gaussian: branches are not looked at
COLUMNS = ("id", "height", "elevation", "crown_area", "crown_diameter", "points", "cut")

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@tool(
    "classify.trees",
    title="Find single trees",
    tags=(
        "tree",
        "crown",
        "treetop",
        "segmentation",
        "its",
        "forestry",
        "canopy",
        "chm",
        "height",
    ),
)
class ClassifyTrees:
    """Find single trees in classified points: tops, and crowns with heights.

    Classify first, as models.urban_classes does. Points of `classes` at least `min_height` above
    the ground are put into cells of half a metre, or larger ones where points are sparse. Each
    highest place among them is a tree, if between it and any higher one the canopy dips
    by at least `prominence`; the cells that lead up to it are its crown. Crowns of less than
    `min_crown` are no trees.

    Attributes of both layers: id, made of the whole easting and northing of a place within the
    crown; height of the highest point above the ground and its elevation, area of the crown,
    diameter of a circle of that area, in the unit of the data; the number of points; and whether
    the edge of the data cuts the crown.

    Where most points of a crown are building in `given`, the same points as the file had them, it
    is the top of a building, such as a spire: no tree, and told.

    Crowns that grow into one another without a dip are one tree. Trees below others are not seen.
    Heights are HeightAboveGround if points have it.
    """

    points: PointCloud = source("Classified points")
    given: PointCloud | None = source(
        "The same points with the classes of the file: what most are building of is no tree",
        default=None,
        label="Points with the classes of the file",
    )
    classes: ClassList = param(
        "Classes that are trees", default=ClassList([5]), label="Tree classes"
    )
    min_height: float = param(
        "Lowest tree", default=3.0, unit="m", gt=0, le=50, label="Lowest tree"
    )
    prominence: float = param(
        "Least depth of the dip between two tops",
        default=1.0,
        unit="m",
        ge=0,
        le=20,
        label="Depth of dips between trees",
    )
    min_crown: float = param(
        "Smallest crown", default=1.0, unit="m2", ge=0, le=1000, label="Smallest crown"
    )
    ground_classes: ClassList = parameters.ground_classes()

    @outputs
    class Outputs:
        tops: Vector = sink(
            "Point of each tree that is highest above the ground, with heights",
            show=show.OfClass(5),
            label="Tree tops",
            columns=columns.TREES,
        )
        crowns: Vector = sink(
            "Outline of each crown, with the same attributes",
            show=show.OfClass(5),
            label="Tree crowns",
            columns=columns.TREES,
            listed=False,
        )
        count: int = sink("Number of trees", unit="1")

        def in_words(self) -> str:
            """How many trees, and how high."""
            if not len(self.tops):
                return "No single trees were found."
            frame, metre = self.tops.frame, self.tops.metre
            heights, area = frame["height"] / metre, frame["crown_area"].sum() / metre**2
            span = f"{heights.min():.1f} to {heights.max():.1f} m"
            return (
                f"Single trees: {len(frame)}, {span} high, crowns of {area:.0f} m² in all, both "
                "counted where two overlap."
            )

        def not_looked_at(self) -> Iterator[str]:
            """Crowns that were cut, and trees that are not seen or are none."""
            if not len(self.crowns):
                return
            whole = len(self.crowns)
            if parts := int(self.crowns.frame["cut"].astype(bool).sum()):
                yield (
                    f"Crowns that the edge of the data cuts: {parts} of {whole}; their area and "
                    "height are of the part that was seen (column cut)."
                )
            yield (
                "Trees below others and species were not looked at; crowns that grow into one "
                "another without a dip count as one tree, and those of a few square metres may be "
                "hedges, posts or parts of other crowns."
            )

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have a classification."""
        if "classification" not in self.points:
            yield "points", f"{self.points.name} has no classification; classify them first"
        yield from unlike(self.given, self.points)

    def halo(self) -> float:
        """Reach of the terrain, and of a crown."""
        return _evidence.HALO

    def run(self, ctx: Context = QUIET) -> ClassifyTrees.Outputs:
        """Find the hills of the canopy, and draw the crowns."""
        cloud = self.points
        if not len(cloud):
            return self._packed([])
        is_ground = of_classes(cloud["classification"], self.ground_classes)
        if not is_ground.any() and HEIGHT not in cloud:
            raise NothingToDo(
                f"points: none is of class {self.ground_classes}; classify ground first",
                instead=self._packed([]),
            )
        lengths = Lengths.of(cloud, ctx=ctx)
        features = _evidence.PointFeatures(
            cloud, lengths.radius, lengths.context, ctx, ground_classes=self.ground_classes
        )
        height = features.terrain[1]
        some = of_classes(cloud["classification"], self.classes) & (
            height * cloud.metre >= self.min_height
        )
        some = without_withheld(cloud, some, ctx)
        if not some.any():
            log.warning(
                "no point of class %s is %g m high; classify vegetation first, as "
                "models.urban_classes does, which finds trees, too",
                self.classes,
                self.min_height / cloud.metre,
            )
            return self._packed([])
        if lengths.spacing > SPARSE * cloud.metre:
            log.warning(
                "points are some %.1f m apart, too sparse for single trees: expect half of them or "
                "more to be missing, small ones first, or to be one with their neighbours",
                lengths.spacing / cloud.metre,
            )
        tree = trees(
            cloud.xyz[some],
            height[some] * cloud.metre,
            cell=max(CELL * cloud.metre, float(BY_SPACING * lengths.spacing)),
            smooth=SMOOTH * cloud.metre,
            prominence=self.prominence,
        )
        ctx.progress(0.8)
        rows = list(self._rows(np.flatnonzero(some), tree, height, lengths, ctx.part(0.8, 1.0)))
        rows = self._without_spires(rows)
        crowns = [row["crown"] for row in rows]
        at_edge = cut(crowns, cloud.places, lengths.spacing, cloud.metre, ctx=ctx)
        rows = [row | {"cut": bool(there)} for row, there in zip(rows, at_edge, strict=True)]
        ctx.progress(1.0)
        return self._packed(rows)

    def _rows(
        self, some: Ints, tree: Ints, height: Floats, lengths: Lengths, ctx: Context
    ) -> Iterator[dict[str, Any]]:
        """Attributes, top and crown of each tree."""
        cloud, core = self.points, self.points.core  # of all points, which takes time to make
        metre = cloud.metre
        number = grouped(tree)[1]
        crowns = outlines(cloud.xyz[some, :2], number, lengths.alpha, ctx)
        ends = np.cumsum(np.bincount(number))[:-1]
        for crown, own in zip(crowns, np.split(some[stable(number)[0]], ends), strict=True):
            if crown is None or crown.area < self.min_crown:
                continue
            top = own[height[own].argmax()]
            x, y, z = cloud.xyz[top]
            yield {
                "id": name_of(crown),
                "height": float(height[top]) * metre,
                "elevation": float(z),
                "crown_area": crown.area,
                "crown_diameter": float(2 * np.sqrt(crown.area / np.pi)),
                "points": len(own),
                "own": own,
                "top": shapely.Point(x, y),
                "crown": crown,
                "core": bool(core[top]),
            }

    def _without_spires(self, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """The trees without what the file calls building, which is told."""
        if self.given is None or "classification" not in self.given:
            return rows
        roof = self.given["classification"] == _evidence.BUILDING
        is_spire = [2 * np.count_nonzero(roof[row["own"]]) > len(row["own"]) for row in rows]
        if spires := [row for row, out in zip(rows, is_spire, strict=True) if out]:
            highest = max(spires, key=lambda row: row["height"])
            log.warning(
                "crowns of which the file calls most points building: %d; they are left out of the "
                "trees, as they may be spires or chimneys, but are classed as vegetation and count "
                "in no height of a building; the highest, %.1f m, at %.1f,%.1f",
                len(spires),
                highest["height"] / self.points.metre,
                highest["top"].x,
                highest["top"].y,
            )
        return [row for row, out in zip(rows, is_spire, strict=True) if not out]

    def _packed(self, rows: list[dict[str, Any]]) -> ClassifyTrees.Outputs:
        import geopandas

        def layer(name: str, kind: str) -> Vector:
            table = [{k: row[k] for k in COLUMNS} | {"geometry": row[name]} for row in rows]
            frame = geopandas.GeoDataFrame(
                table, columns=[*COLUMNS, "geometry"], geometry="geometry", crs=self.points.crs
            )
            return Vector(frame, geometry_type=kind)

        return self.Outputs(
            tops=layer("top", "Point"),
            crowns=layer("crown", "Polygon"),
            count=sum(row["core"] for row in rows),  # each once, also where tiles overlap
        )


def trees(xyz: Floats, height: Floats, *, cell: float, smooth: float, prominence: float) -> Ints:
    """Number of the tree of each point.

    Parameters
    ----------
    xyz : points of vegetation, array of shape (n, 3)
    height : above the ground, array of shape (n,), in the same unit
    cell : size of the cells of the canopy
    smooth : standard deviation of the Gaussian that it is smoothed with; empty cells do not count
    prominence : least depth of the dip between two tops

    Returns
    -------
    array of shape (n,)
        The same number for points of one tree; numbers are not consecutive.
    """
    x, y = xyz[:, 0], xyz[:, 1]
    lattice = Lattice.cover((x.min(), y.min(), x.max(), y.max()), cell)
    row, col = (place + 1 for place in lattice.indices(x, y))  # within an empty border
    canopy = np.full((lattice.rows + 2, lattice.cols + 2), -np.inf)
    np.maximum.at(canopy, (row, col), height)
    there = np.isfinite(canopy)
    total = gaussian_filter(np.where(there, canopy, 0.0), smooth / cell, mode="constant")
    weight = gaussian_filter(there.astype(float), smooth / cell, mode="constant")
    surface = np.where(there, total / np.where(there, weight, 1.0), -np.inf).ravel()
    order = np.argsort(-surface, kind="stable")[: np.count_nonzero(there)]
    parent = np.full(surface.size, -1, np.int64)
    kernels.hills(surface, order, canopy.shape[1], prominence, parent)
    return np.asarray(parent[row * canopy.shape[1] + col])


def outlines(xy: Floats, tree: Ints, alpha: float, ctx: Context = QUIET) -> Shapes:
    """Outline of each crown: none if its points are too few.

    It runs as far outside of the largest region of their alpha shape as edges do on average.

    Parameters
    ----------
    xy : array of shape (n, 2)
    tree : the tree of each point, array of shape (n,), 0, 1, ...
    alpha : of the alpha shapes
    ctx : progress and cancellation
    """
    count = np.bincount(tree)
    crowns = np.full(len(count), None, object)
    shapes, groups = alpha_shapes_of_groups(xy, tree, alpha, ctx=ctx)
    some, largest = np.unique(groups, return_index=True)
    density = count[some] / shapely.area(shapes[largest])
    crowns[some] = shapely.buffer(shapes[largest], margin(density, alpha), quad_segs=2)
    return crowns
