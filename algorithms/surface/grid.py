"""Gridding: from points to a raster of heights, intensities or any other attribute.

How the methods differ, how exact and how fast they are: docs/explanation/gridding.md.

References
----------
Sibson, R. (1981). A brief description of natural neighbour interpolation. In: Interpreting
Multivariate Data, Wiley, 21-36.
Alfeld, P. (1984). A trivariate Clough-Tocher scheme for tetrahedral data. Computer Aided Geometric
Design 1, 169-181: the C1 surface behind `cubic`.
Shepard, D. (1968). A two-dimensional interpolation function for irregularly-spaced data. ACM
National Conference, 517-524: inverse distance weighting.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from algorithms.shared import parameters
from algorithms.shared.ground import without_withheld
from algorithms.shared.lowest import tell_of_one_cell
from algorithms.shared.polygons import polygons
from algorithms.shared.selection import ReturnKind, choice_problems, chosen
from algorithms.surface import _outlines as shapes
from algorithms.surface._gridding import ROUNDING, STATISTICS, TRIANGLES, Bands, Method, grid
from algorithms.surface._samples import samples, why_none
from algorithms.surface._tin import STEPS
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Raster, Vector
from toolbox.data.crs import vertical_unit
from toolbox.declare import (
    Attribute,
    ClassList,
    Expression,
    Extent,
    Memory,
    outputs,
    param,
    sink,
    source,
    tool,
)
from toolbox.errors import DataError, NothingToDo

STEP = 0.01  # metres: a step between lines that meet which is more than rounding
PIECE = 0.5  # cells: the longest piece of a breakline

Array = NDArray[np.float64]


@tool(
    "surface.grid",
    title="Grid points to a raster",
    tags=(
        "rasterize",
        "rasterise",
        "grid",
        "interpolate",
        "dtm",
        "dsm",
        "dem",
        "chm",
        "idw",
        "tin",
        "linear",
        "nearest",
        "natural",
        "neighbour",
        "density",
        "intensity",
        "mean",
        "max",
        "min",
        "tile",
    ),
)
class SurfaceGrid:
    """Turn points into a raster of values at the cell centres, or of statistics of the cells.

    `linear` is the facets of the Delaunay triangulation, `natural` the mean of the natural
    neighbours, `cubic` a smooth surface over the triangles; all three pass through the points and
    leave cells outside the convex hull empty. `idw` weights the closest `neighbours` by their
    distance, `nearest` takes the closest. Points at one position are averaged. The others are
    statistics of the points within a cell; cells without points stay empty.

    Cells are whole multiples of the cell size, so that rasters of neighbouring surveys fit, or
    those of a template raster.

    `max_gap` leaves cells empty that are farther from any point. With triangles it is the radius
    of the largest circle without points: triangles with a larger one are left out, so that no
    surface spans a lake or a bay. Where a largest gap is given (for idw: a radius), tiles of a
    survey give the same cells as the whole.

    Breaklines and outlines of exclusions are followed to a quarter of a cell, by points every half
    cell that take the place of those beside them. An exclusion of one level is filled with it.

    `support` adds the number of points that made a cell and the distance to the nearest point;
    `uncertainty` the error at the points used when each is left out and found from its
    neighbours (root mean square, weighted as the points are; by triangles for cubic). It is empty
    at the edge of the data.

    Heights, and attributes whose type fits into it, become 32-bit floats, which round heights by
    less than 0.0003 up to 8000. Attributes of more digits, such as gps_time, become 64-bit floats.
    """

    points: PointCloud = source("Points to grid")
    template: Raster | None = source(
        "Raster whose cells to fill, instead of cells of the given size",
        default=None,
        label="Use the cells of",
    )
    breaklines: Vector | None = source(
        "Lines with heights that edges follow, linear", default=None, shapes=("line", "polygon")
    )
    exclusions: Vector | None = source(
        "Polygons whose points are left out; outlines with heights become breaklines",
        default=None,
        label="Areas left out",
        shapes="polygon",
    )
    clip: Vector | None = source(
        "Polygons outside of which cells stay empty",
        default=None,
        label="Clip to polygons",
        shapes="polygon",
    )
    method: Method = param(
        "How to interpolate, or what of each cell to take",
        default="linear",
        words={
            "linear": "Linear (TIN)",
            "natural": "Natural neighbours",
            "cubic": "Cubic",
            "idw": "Inverse distance (IDW)",
            "nearest": "Nearest point",
            "min": "Lowest",
            "max": "Highest",
            "count": "Number of points",
            "std": "Standard deviation",
        },
    )
    cell: float = parameters.cell()
    extent: Extent | None = param("Rectangle to work in; that of the data by default", default=None)
    attribute: Attribute = param("Attribute to grid", default=Attribute("z"), of="points")
    classes: ClassList | None = parameters.classes()
    returns: ReturnKind = parameters.returns()
    where: Expression | None = param(
        "Condition over attributes that must be met", default=None, of="points", label="Condition"
    )
    max_gap: float | None = param(
        "Leave empty what lies farther than this from any point",
        default=None,
        unit="m",
        gt=0,
        label="Widest gap to fill",
    )
    power: float = param(
        "Power of the distance, for idw",
        default=2.0,
        unit="1",
        gt=0,
        label="Power of the distance (IDW)",
    )
    neighbours: int = param("Points used per cell, for idw", default=12, unit="1", ge=1, le=1000)
    radius: float | None = param(
        "Farthest point used, for idw; any by default", default=None, unit="m", gt=0
    )
    smoothing: float = param(
        "Length that dulls the peaks at the points, for idw", default=0.0, unit="m", ge=0, le=1e6
    )
    percentile: float = param(
        "Share of the points below, for percentile", default=95.0, unit="%", ge=0, le=100
    )
    support: bool = param(
        "Add points used and distance to the nearest point",
        default=False,
        label="Add points used and distance",
    )
    uncertainty: bool = param(
        "Add the error of leaving points out", default=False, label="Add the error"
    )

    memory = Memory(point=200.0, area=200.0)  # measured in a chain: 146, 145

    @outputs
    class Outputs:
        surface: Raster = sink("The gridded attribute, empty where there is no data")
        filled_share: float = sink("Share of cells with a value", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """Every setting that is given is used by the method."""
        if self.method in STATISTICS:
            if self.max_gap is not None:
                yield "max_gap", f"is for interpolation; {self.method} has no cells without points"
            if self.uncertainty:
                yield "uncertainty", f"is for interpolation, not for {self.method}"
        if self.method != "idw":
            if self.radius is not None:
                yield "radius", f"is for method idw, not for {self.method}"
            if self.smoothing:
                yield "smoothing", f"is for method idw, not for {self.method}"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The layer has what the selection of points needs, and the settings fit each other."""
        yield from choice_problems(self.points, self.classes, self.returns)
        if self.template and self.method in STATISTICS and self.points.origin is not None:
            size = self.template.cell / self.template.metre
            if self.cell < size * (1 - ROUNDING):  # halo() knows no layers
                yield "cell", f"in tiles, must be that of the template ({size:g} m) too"
        if self.extent and self.template:
            yield "extent", "a template has its own; give one of both"
        for name in ("breaklines", "exclusions"):
            if getattr(self, name) and (self.method != "linear" or self.attribute != "z"):
                yield (
                    name,
                    f"are for heights and method linear, not {self.attribute}, {self.method}",
                )

    def halo(self) -> float:
        """Infinite without max_gap or, for idw, radius; else the reach of triangles and cells."""
        if self.method in STATISTICS:
            half = math.sqrt(0.5) if self.support else 0.5  # the nearest is in the cell
            return half * self.cell * (1 + 10 * ROUNDING)
        limit = self.radius if self.method == "idw" else self.max_gap
        if limit is None:
            return math.inf
        reach = limit * (1 + ROUNDING)
        if self.method not in TRIANGLES:
            return 2 * reach if self.uncertainty else reach
        # Points on an empty circle around the centre; theirs; for gradients those of all steps.
        circles = STEPS + 3 if self.method == "cubic" else 2 if self.uncertainty else 1
        return 2 * circles * reach

    def run(self, ctx: Context = QUIET) -> SurfaceGrid.Outputs:
        """Grid the chosen points."""
        xy, values = self._samples(ctx.part(0.0, 0.1))
        if not len(xy):
            cells = self.template or self.extent  # which are there, though all of them are empty
            raise NothingToDo(
                why_none(self.points, self.classes),
                instead=self._gridded(xy, values, ctx) if cells else None,
            )
        return self._gridded(xy, values, ctx)

    def _gridded(self, xy: Array, values: Array, ctx: Context) -> SurfaceGrid.Outputs:
        lattice = self._lattice(xy)
        tell_of_one_cell(lattice, self.points.metre)
        if ctx.window:
            near_tile = lattice.near(ctx.window)
            if near_tile is None:
                raise NothingToDo("points: no cell of the raster is near them")
            lattice = near_tile
        excluded = self._excluded()
        xy, values = self._shaped(xy, values, lattice, excluded)
        if len(excluded) and not len(xy) and self.max_gap is None:
            raise DataError("exclusions: hold all points; give max_gap to leave the rest empty")
        bands = grid(
            xy,
            values,
            lattice,
            method=self.method,
            max_gap=self.max_gap,
            power=self.power,
            neighbours=self.neighbours,
            radius=self.radius,
            smoothing=self.smoothing,
            percentile=self.percentile,
            support=self.support,
            uncertainty=self.uncertainty,
            ctx=ctx.part(0.1, 0.95),
        )
        for polygon, level in shapes.levels(excluded):
            bands.surface[shapes.cells_in(polygon, lattice)] = level
        if self.clip:
            inside = shapes.cells_in(polygons(self.clip, "clip"), lattice, ctx=ctx.part(0.95, 1.0))
            for band in bands:
                if band is not None:
                    band[~inside] = np.nan
        if self.method in STATISTICS and not ctx.window:
            _tell_sparse(
                bands.surface != 0 if self.method == "count" else np.isfinite(bands.surface)
            )
        return self._packed(bands, lattice)

    def _samples(self, ctx: Context) -> tuple[Array, Array]:
        """Positions of shape (n, 2) and values of shape (n,) of the chosen points."""
        ctx.progress(0.0)
        keep = chosen(self.points, self.classes, self.returns, self.where)
        keep = without_withheld(self.points, keep, ctx)
        ctx.progress(0.5)
        xy, values = samples(self.points, self.attribute, keep)
        ctx.progress(1.0)
        return xy, values

    def _lattice(self, xy: Array) -> Lattice:
        """Lattice of the template, of the extent or around the points."""
        if self.template:
            return Lattice.of(self.template)
        if self.extent:
            return Lattice.cover(self.extent, self.cell)
        bounds = (*(xy[:, k].min() for k in (0, 1)), *(xy[:, k].max() for k in (0, 1)))
        return Lattice.cover(bounds, self.cell)

    def _excluded(self) -> shapes.Shapes:
        """Polygons of the exclusions, or None."""
        if not self.exclusions:
            return np.array([])
        found = polygons(self.exclusions, "exclusions")
        shapes.require_heights(found[shapes.with_heights(found)], self.exclusions, "exclusions")
        return found

    def _shaped(
        self, xy: Array, values: Array, lattice: Lattice, excluded: shapes.Shapes
    ) -> tuple[Array, Array]:
        """Points near the cells, without those in exclusions and with those along breaklines."""
        reach, (west, south, east, north) = self.halo(), lattice.bounds
        x, y = xy.T  # much faster than both at once
        keep = (x >= west - reach) & (x <= east + reach)
        keep &= (y >= south - reach) & (y <= north + reach)
        if len(excluded):
            keep &= ~shapes.holds(excluded, xy)
        if not keep.all():
            xy, values = xy[keep], values[keep]
        found = [shapes.outlines(excluded[shapes.with_heights(excluded)])] if len(excluded) else []
        if self.breaklines:
            found.append(shapes.lines(self.breaklines, "breaklines"))
        self._warn_of_steps(found)
        for some in found:
            xy, values = shapes.with_breaklines(xy, values, some, PIECE * lattice.cell)
        return xy, values

    def _warn_of_steps(self, found: list[shapes.Shapes]) -> None:
        """Warn where breaklines cross at different heights, which makes a spike in the surface."""
        if not found:
            return
        xy, steps = shapes.steps_at_crossings(np.concatenate(found))
        if (large := steps > STEP * self.points.metre).any():
            (x, y), step = xy[steps.argmax()], steps.max() / self.points.metre
            log.warning(
                "breaklines meet at different heights in %d places, by %.3g m at %.10g, %.10g",
                np.count_nonzero(large),
                step,
                x,
                y,
            )

    def _packed(self, bands: Bands, lattice: Lattice) -> SurfaceGrid.Outputs:
        """Raster of the bands, in the smallest type that holds the attribute; see the class."""
        points, name = self.points, str(self.attribute)
        is_height, is_count = name == "z", self.method == "count"
        fits = is_height or is_count or np.can_cast(points[name].dtype, np.float32)
        height = vertical_unit(points.crs) if is_height else ""
        own = height or ("1" if name == "intensity" else "")  # GDAL takes none for that of heights
        across = points.crs.axis_info[0].unit_name if points.crs else ""
        texts = (
            ("points per cell", "1") if is_count else (f"{name} ({self.method})", own),
            ("points used", "1"),
            ("distance to the nearest point", across),
            ("error without the points used", height),
        )
        there = [(band, *text) for band, text in zip(bands, texts, strict=True) if band is not None]
        layers, descriptions, units = zip(*there, strict=True)
        dtype = np.float32 if fits else np.float64
        raster = Raster.from_lattice(
            np.stack([band.astype(dtype) for band in layers]),
            lattice,
            crs=points.crs,
            descriptions=descriptions,
            units=units,
        )
        filled = float(np.isfinite(bands.surface).mean())
        if not filled:
            log.warning(
                "no cell has a value; look at where the cells and the clip lie, and at the size of "
                "cell, max_gap and radius"
            )
        return self.Outputs(surface=raster, filled_share=filled)


def _tell_sparse(filled: NDArray[np.bool_]) -> None:
    """Warn where cells are too small for the points: beside one with a value most have none."""
    pairs = ((filled[:, :-1], filled[:, 1:]), (filled[:-1], filled[1:]))
    beside = sum(int(np.count_nonzero(one)) for one, _ in pairs)
    both = sum(int(np.count_nonzero(one & other)) for one, other in pairs)
    if both < beside / 2:
        log.warning(
            "beside most cells with points are empty ones: choose larger cells, which hold a few "
            "points each"
        )
