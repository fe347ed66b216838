"""Land cover: the class of most points that look down on each cell."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shared import parameters
from algorithms.shared.ground import taking_part, without_withheld
from algorithms.shared.lowest import tell_of_one_cell
from algorithms.shared.polygons import cells_within, polygons
from algorithms.shared.windows import closed, filled
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Raster, Table, Vector
from toolbox.data.asprs import class_label, within_sentence
from toolbox.data.crs import crs_conflict
from toolbox.data.report import Column
from toolbox.declare import ClassList, outputs, param, sink, source, tool
from toolbox.errors import NothingToDo

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
CODES = 256  # that a class of LAS may have
NONE = 0  # value of cells without a class
WATER = 9


@tool(
    "surface.land_cover",
    title="Land cover",
    tags=("land-cover", "classification", "raster", "map", "classes", "majority"),
)
class SurfaceLandCover:
    """Give each cell the class of most of its first returns.

    First returns show what is seen from above: the crown of a tree, not the grass below. Of classes
    with as many points the one with the higher number counts. The values are the classes of LAS
    (2 ground, 3 to 5 vegetation, 6 building, 9 water), 0 for none; the table has the area of each.
    Points of class 0, never classified, take no part. The file has the colours of the classes, and
    the file beside it that ends in .aux.xml their names, so that a GIS shows both.

    Water often swallows the pulses: with `water`, cells in it without points are water. Other cells
    without points take the class of the nearest cell in gaps between cells with points, into which
    no circle of the radius `max_gap` fits. Wider gaps, and what lies beyond the edge of the data,
    stay empty.
    """

    points: PointCloud = source("Classified points")
    water: Vector | None = source(
        "Polygons of water, as of shoreline.extract", default=None, shapes="polygon"
    )
    cell: float = parameters.cell()
    max_gap: float = param(
        "Radius of a circle that does not fit into gaps to fill; wider ones stay empty",
        default=2.0,
        unit="m",
        ge=0,
        label="Widest gap to fill",
    )
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        cover: Raster = sink("Class of each cell, 0 for none", label="Land cover")
        areas: Table = sink(
            "Area and share of each class",
            columns={
                "class": Column("Class"),
                "name": Column("Land cover"),
                "area_m2": Column("Area", "m²", 1),
                "share": Column("Share", "%", 1, 100.0),
            },
        )

        def in_words(self) -> str:
            """The shares of the classes."""
            rows = sorted(self.areas.rows(), key=lambda row: -row["share"])
            parts = [
                f"{within_sentence(row['name'])} {row['area_m2']:.0f} m² "
                f"({100 * row['share']:.1f} %)"
                for row in rows
            ]
            return (
                "Of the area by cells, as seen from above (crowns and bridges hide what is below "
                "them; outlines have other areas; cells without points are water within its "
                "outlines, have the class beside them in narrow gaps, and do not count else): "
                f"{', '.join(parts)}."
            )

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have classes, and the water has their CRS."""
        name = self.points.name
        if "classification" not in self.points:
            yield "points", f"{name} has no classification; classify them first"
        if self.water is not None and (
            text := crs_conflict(self.water.crs, self.points.crs, heights=False)
        ):
            yield "water", f"{self.water.name or 'the layer'} {text} of {name}"

    def halo(self) -> float:
        """Infinite, as the table is of the whole."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> SurfaceLandCover.Outputs:
        """Count classes by cell, and fill water and small gaps."""
        ctx.progress(0.0)
        cloud = self.points
        classes = cloud["classification"].astype(np.int64)
        taken = taking_part(cloud, self.ignore)
        without_withheld(cloud, np.ones(len(cloud), bool), ctx)  # tells their number
        if "return_number" in cloud:
            taken &= cloud["return_number"] <= 1
        if not taken.any():
            raise NothingToDo("points: none takes part")
        without = taken & (classes == NONE)
        taken &= ~without
        if not taken.any():
            raise NothingToDo("points: all are of class 0, never classified; classify them first")
        if without.any():
            log.warning("%d points of class 0, never classified, take no part", without.sum())
        xy = cloud.xyz[taken, :2]
        lattice = Lattice.cover((*xy.min(axis=0), *xy.max(axis=0)), self.cell)
        tell_of_one_cell(lattice, cloud.metre)
        row, col = lattice.indices(*xy.T)
        found = most_frequent(row * lattice.cols + col, classes[taken], lattice.rows * lattice.cols)
        ctx.progress(0.6)
        cover = found.reshape(lattice.shape)
        for shape in polygons(self.water, "water") if self.water is not None else ():
            rows, cols = cells_within(shapely.force_2d(shape), lattice)
            empty = cover[rows, cols] == NONE
            cover[rows[empty], cols[empty]] = WATER
        reach = self.max_gap / lattice.cell
        gaps = closed(cover != NONE, reach) & (cover == NONE)
        cover = np.where(gaps, filled(cover, cover == NONE, reach), cover)
        raster = Raster(
            cover.astype(np.uint8),
            lattice.transform,
            crs=cloud.crs,
            nodata=float(NONE),
            descriptions=("land cover",),
            units=("1",),
            classes=True,
        )
        sizes = shares_within(lattice, xy) * (lattice.cell / cloud.metre) ** 2
        return self.Outputs(cover=raster, areas=areas(cover, sizes))


def most_frequent(place: Ints, classes: Ints, size: int) -> Ints:
    """The most frequent class of each cell, the higher one of several; 0 without points.

    Examples
    --------
    >>> most_frequent(np.array([0, 0, 0, 2, 2]), np.array([2, 6, 6, 5, 3]), 3).tolist()
    [6, 0, 5]
    """
    keys, counts = np.unique(place * CODES + classes, return_counts=True)
    order = np.argsort(counts, kind="stable")  # of equal ones the higher class stays the last
    made = np.full(size, NONE, np.int64)
    made[keys[order] // CODES] = keys[order] % CODES
    return made


def shares_within(lattice: Lattice, xy: Floats) -> Floats:
    """Which share of each cell lies within the box around points, of shape (n, 2).

    In a direction in which they lie in one row or column of cells, these count whole.

    Examples
    --------
    >>> xy = np.array([[0.0, 0.5], [1.5, 2.0]])
    >>> shares_within(Lattice.cover((0.0, 0.5, 1.5, 2.0), 1.0), xy).tolist()
    [[1.0, 0.5], [0.5, 0.25]]
    """
    inner = []
    edges = (lattice.west + lattice.cell * np.arange(lattice.cols + 1), xy[:, 0])
    north = (-lattice.north + lattice.cell * np.arange(lattice.rows + 1), -xy[:, 1])
    for borders, places in (north, edges):
        one = len(borders) == 2
        reach = np.clip(borders, places.min(), places.max())
        inner.append(np.ones(1) if one else np.diff(reach) / lattice.cell)
    return np.outer(*inner)


def areas(cover: Ints, sizes: Floats) -> Table:
    """Area, and share, of each class of cells whose areas in square metres are given."""
    numbers = np.unique(cover[cover != NONE])
    whole = float(sizes[cover != NONE].sum())
    found = [(int(number), float(sizes[cover == number].sum())) for number in numbers]
    return Table.from_rows(
        {
            "class": number,
            "name": class_label(number),
            "area_m2": round(area, 2),
            "share": round(area / whole, 4) if whole else 0.0,
        }
        for number, area in found
    )
