"""Ground filter by hierarchic robust interpolation.

A smooth surface is laid through the lowest points of coarse cells. Points above it lose weight
and the surface is computed again, until it runs through the ground. Points near it go on to
the next finer cells.

References
----------
Kraus, K., Pfeifer, N. (1998). Determination of terrain models in wooded areas with airborne
laser scanner data. ISPRS Journal of Photogrammetry and Remote Sensing 53(4), 193-203.

Pfeifer, N., Stadler, P., Briese, C. (2001). Derivation of digital terrain models in the SCOP++
environment. OEEPE Workshop on Airborne Laserscanning and Interferometric SAR, Stockholm.

Where we depart from the papers, and why: docs/explanation/robust-interpolation.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.ground import _robust_interpolation_kernels as kernels
from algorithms.shared import parameters
from algorithms.shared.ground import NOWHERE, Candidates, Returns
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import (
    blocks,
    lattice_around,
    lowest_points,
    outlier_reach,
    require_finite,
    without_low_outliers,
)
from algorithms.shared.plausible import tell_of_ground
from algorithms.shared.strips import strips_of
from toolbox.context import QUIET, Context
from toolbox.data import Lattice, PointCloud, Raster
from toolbox.data.crs import vertical_unit
from toolbox.declare import ClassList, outputs, param, sink, source, tool
from toolbox.errors import DataError

COARSEST = 1 / 3  # of the widest building, so that its window reaches ground on both sides
VEGETATION_CELL = 5.0  # metres: smaller cells serve the vegetation strategy
DROP = 0.2  # a point that is lower than the surface by more than this times the cell is left out
OUTLIER_CELL = 1.0  # metres
ROUNDING = 1e-9  # so that feet give the levels of metres
BYTES_PER_CELL = 26

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Corner = tuple[int, int, float]


@tool(
    "ground.robust_interpolation",
    title="Classify ground (robust fit)",
    tags=(
        "ground",
        "filter",
        "dtm",
        "dem",
        "bare",
        "earth",
        "kraus",
        "pfeifer",
        "robust",
        "interpolation",
        "hierarchical",
        "smrf-like",
    ),
)
class GroundRobustInterpolation:
    """Classify ground by interpolation that takes weight from high points.

    Ground becomes class 2, all else class 1. Surfaces are laid from coarse cells to fine ones:
    the coarse ones remove buildings, the fine ones vegetation. Raise `building_size` for wider
    buildings and `relief` where hilltops, dams or terraces get lost; lower `relief` on flat land
    with low buildings. The surface also bridges gaps and can serve as a first terrain model.

    Points of water, rail and road (9 to 11) count like all others and keep their class; wires,
    towers, bridges and other structures (13 to 17, 19) keep theirs and take no part. Without
    `keep_classes` they become 2 or 1, too. Class 2 is decided anew, also if it is named there.
    """

    points: PointCloud = source("Points to classify")
    cell: float = parameters.cell()
    building_size: float = param(
        "Width of the widest building",
        default=48.0,
        unit="m",
        gt=0,
        le=2000,
        label="Widest building",
    )
    half_width: float = param(
        "Height above the ground at which a point has half its weight",
        default=0.1,
        unit="m",
        gt=0,
        label="Height of half weight",
    )
    relief: float = param(
        "Roughness of the terrain: half width and height_tolerance grow by it per metre of cell",
        default=0.15,
        unit="1",
        ge=0,
    )
    height_tolerance: float = param(
        "Greatest height above a coarse surface at which a point goes on to finer cells",
        default=0.5,
        unit="m",
        gt=0,
        label="Tolerance of heights",
    )
    iterations: int = param("Times that a surface is computed again", default=3, unit="1", ge=0)
    above: float = param(
        "Greatest height of a ground point above the surface",
        default=0.35,
        unit="m",
        gt=0,
        label="Ground reaches above by",
    )
    below: float = param(
        "Greatest depth of a ground point below the surface",
        default=1.0,
        unit="m",
        gt=0,
        label="Ground reaches below by",
    )
    returns: Returns = parameters.ground_returns()
    ignore: ClassList | None = parameters.ignore()
    keep_classes: ClassList | None = parameters.keep_classes()

    @outputs
    class Outputs:
        classified: PointCloud = parameters.labelled_points()
        ground: PointCloud = parameters.ground_points()
        surface: Raster = sink("Elevation of the surface through the ground")
        ground_share: float = parameters.ground_share()

    def halo(self) -> float:
        """Reach of all levels and of the search for outliers together."""
        return reach(self.cell, self.building_size)

    def run(self, ctx: Context = QUIET) -> GroundRobustInterpolation.Outputs:
        """Interpolate the surface, and compare the points with it."""
        cloud = self.points
        candidates = Candidates.of(cloud, self.returns, self.ignore, self.keep_classes)
        if not candidates.chosen.any():
            none = candidates.classified(NOWHERE)
            raise candidates.nothing_to_do(none, surface=None)
        xyz = candidates.xyz
        surface = robust_interpolation(
            xyz,
            cell=self.cell,
            building_size=self.building_size,
            half_width=self.half_width,
            relief=self.relief,
            height_tolerance=self.height_tolerance,
            iterations=self.iterations,
            below=self.below,
            metre=cloud.metre,
            ctx=ctx.part(0, 0.95),
        )
        ground = ground_mask(
            xyz, surface, above=self.above, below=self.below, ctx=ctx.part(0.95, 1)
        )
        tell_of_ground(xyz, ground, strips_of(cloud, candidates.chosen), cloud.metre)
        classified = candidates.classified(ground)
        return self.Outputs(
            classified=classified,
            surface=Raster.from_lattice(
                surface.heights.astype(np.float32),
                surface.lattice,
                crs=cloud.crs,
                descriptions=("surface",),
                units=(vertical_unit(cloud.crs),),
            ),
            ground=candidates.ground(classified, ground),
            ground_share=candidates.share(ground, classified),
        )


@dataclass(frozen=True)
class GroundRaster:
    """A surface through the ground, as a raster.

    Attributes
    ----------
    heights : array of shape (rows, cols), elevation in the middle of the cells; NaN far from
        all points
    lattice : the cells, in whole multiples of their size
    """

    heights: Floats
    lattice: Lattice

    @property
    def corner(self) -> Corner:
        """Position of the lattice, for the kernels."""
        return corner_of(self.lattice)


def corner_of(lattice: Lattice) -> Corner:
    """Position of a lattice: whole cells from the origin to its corner, and the size of a cell."""
    return round(lattice.west / lattice.cell), round(lattice.north / lattice.cell), lattice.cell


class Weights(NamedTuple):
    """Settings of the robust interpolation; lengths in the unit of the points."""

    half_width: float
    relief: float
    tolerance: float
    below: float
    iterations: int


def residuals(xyz: Floats, surface: GroundRaster) -> Floats:
    """Height of the points above the surface: z - surface.

    Positive on vegetation and roofs, around zero on the ground, negative below it.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    surface : bilinear between the middles of its cells

    Returns
    -------
    array of shape (n,), in the unit of the points; NaN beyond the surface

    Raises
    ------
    ValueError
        A coordinate is not a finite number.
    """
    require_finite(xyz)
    return residuals_and_rises(read_only(xyz), surface)[0]


def ground_mask(
    xyz: Floats,
    surface: GroundRaster,
    *,
    above: float = 0.35,
    below: float = 1.0,
    ctx: Context = QUIET,
) -> Mask:
    """True for points near the surface.

    Both thresholds grow by what the surface rises over one cell, because its height there is
    that uncertain.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    surface : made from the same points, or from those of their returns that may be ground
    above, below : greatest vertical distance, in the unit of the points
    ctx : progress and cancellation

    Returns
    -------
    array of shape (n,)

    Raises
    ------
    ValueError
        A coordinate is not a finite number.
    """
    require_finite(xyz)
    return near_surface(read_only(xyz), surface, above, below, ctx)


def robust_interpolation(
    xyz: Floats,
    *,
    cell: float = 1.0,
    building_size: float = 48.0,
    half_width: float = 0.1,
    relief: float = 0.15,
    height_tolerance: float = 0.5,
    iterations: int = 3,
    below: float = 1.0,
    metre: float = 1.0,
    ctx: Context = QUIET,
) -> GroundRaster:
    """The surface through the ground, interpolated from coarse cells to fine ones.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    cell : size of the finest cells, in the unit of the points as all lengths
    building_size : width of the widest building; sets the coarsest cells
    half_width : residual above the ground at which a point has half its weight
    relief : growth of `half_width` and `height_tolerance` per length of a cell
    height_tolerance : greatest residual of the points that go on to finer cells
    iterations : times that a surface is computed again with weights from its residuals
    below : residuals of less than -below are not ground; grows with the cells
    metre : length of one metre in the unit of the points
    ctx : progress and cancellation

    Returns
    -------
    GroundRaster
        On the cells of the points and one more on each side.

    Raises
    ------
    ValueError
        A coordinate is not a finite number.
    DataError
        There are no points, or their bounding box would need more than MAX_CELLS cells.

    Notes
    -----
    Memory is BYTES_PER_CELL for each of the finest cells and 4 bytes for each point. Time grows
    with the number of points and with that of the finest cells.
    """
    if not len(xyz):
        raise DataError("points: there are none to lay a surface through")
    require_finite(xyz)
    xyz = read_only(xyz)
    inner = lattice_around(xyz, cell, bytes_per_cell=BYTES_PER_CELL, parameter="cell")
    cells = cells_of_levels(cell, building_size, metre)
    weights = Weights(half_width, relief, height_tolerance, below, iterations)
    clean = without_low_outliers(xyz, max(cell, OUTLIER_CELL * metre), metre, ctx.part(0, 0.3))
    use, trend = clean, None
    for k, size in enumerate(cells):
        level = ctx.part(0.3 + 0.7 * k / len(cells), 0.3 + 0.7 * (k + 1) / len(cells))
        if trend:
            use = clean & tolerated(xyz, trend, weights, level.part(0, 0.2))
        lattice = widened(inner, sum(cells[k:-1]), size)
        trend = interpolated(xyz, use, lattice, trend, weights, level.part(0.2, 1))
    assert trend
    return trend


def read_only(array: Floats) -> Floats:
    """A read-only view; so kernels are not compiled for writable arrays too."""
    view = array.view()
    view.flags.writeable = False
    return view


def cells_of_levels(cell: float, building_size: float, metre: float = 1.0) -> list[float]:
    """Sizes of the cells of all levels, in the order of processing.

    The building strategy goes down from the coarsest cells. The vegetation strategy goes down
    twice: hilltops that its first pass reached only with its finest cells grow in the second.
    """
    down = [cell]
    while down[0] < building_size * COARSEST * (1 - ROUNDING):
        down.insert(0, 2 * down[0])
    return down + [size for size in down[1:] if size < VEGETATION_CELL * metre * (1 - ROUNDING)]


def reach(cell: float, building_size: float) -> float:
    """Distance in metres within which other points can change the label of a point."""
    cells = cells_of_levels(cell, building_size)
    window = kernels.WINDOW + 0.5  # cells from a node to the far side of the outermost cell
    bilinear = 1.0  # cells from a point to the nodes around it
    return (window + bilinear) * sum(cells) + outlier_reach(max(cell, OUTLIER_CELL))


def widened(lattice: Lattice, margin: float, cell: float) -> Lattice:
    """Lattice of cells of another size over the same area and a margin.

    With all finer cells as the margin, no height within the area depends on where it ends.
    """
    west, south, east, north = lattice.bounds
    return Lattice.cover((west - margin, south - margin, east + margin, north + margin), cell)


def near_surface(
    xyz: Floats, surface: GroundRaster, above: float, below: float, ctx: Context
) -> Mask:
    """True for points with residuals from -below to above, both widened on slopes."""
    near = np.empty(len(xyz), bool)
    for start, stop in blocks(len(xyz)):
        residual, rise = residuals_and_rises(xyz[start:stop], surface)
        near[start:stop] = (residual <= above + rise) & (residual >= -below - rise)
        ctx.progress(stop / len(xyz))
    return near


def residuals_and_rises(xyz: Floats, surface: GroundRaster) -> tuple[Floats, Floats]:
    """Heights of the points above the surface, and the rise of the surface over one cell."""
    residual, rise = np.empty(len(xyz)), np.empty(len(xyz))
    side_by_side(
        kernels.residuals,
        blocks(len(xyz), 10),
        xyz,
        surface.heights,
        surface.corner,
        residual,
        rise,
    )
    return residual, rise


def tolerated(xyz: Floats, surface: GroundRaster, weights: Weights, ctx: Context) -> Mask:
    """True for points that are used again at finer cells."""
    cell = surface.lattice.cell
    above = weights.tolerance + weights.relief * cell
    return near_surface(xyz, surface, above, weights.below + DROP * cell, ctx)


def interpolated(
    xyz: Floats,
    use: Mask,
    lattice: Lattice,
    trend: GroundRaster | None,
    weights: Weights,
    ctx: Context,
) -> GroundRaster:
    """The surface of one level, from the lowest point in use of each cell."""
    lowest = lowest_points(xyz, use, lattice, ctx.part(0, 0.2))
    below = trend or GroundRaster(read_only(np.empty((0, 0))), lattice)
    heights = np.empty(lattice.shape)
    offset = np.empty(lattice.shape)
    for first, last in blocks(lattice.rows, lattice.cols):
        some = lowest[first:last]
        points = read_only(xyz[some[some >= 0]])
        above = residuals_and_rises(points, trend)[0] if trend else points[:, 2]
        offset[first:last][some >= 0] = above
        ctx.progress(0.2 + 0.1 * last / lattice.rows)
    side_by_side(
        kernels.interpolate,
        blocks(lattice.rows, 20 * lattice.cols),
        xyz,
        lowest,
        offset,
        corner_of(lattice),
        below.heights,
        below.corner,
        weights.half_width,
        weights.relief,
        weights.below + DROP * lattice.cell,
        weights.iterations + 1,
        heights,
        ctx=ctx.part(0.3, 1.0),
    )
    return GroundRaster(read_only(heights), lattice)
