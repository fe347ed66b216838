"""Ground filter by cloth simulation.

The point cloud is turned upside down and a cloth is let fall on it. The cloth comes to rest
on the former ground and spans the pits that the buildings and trees have become; points
near the cloth are ground.

References
----------
Zhang, W. et al. (2016). An easy-to-use airborne LiDAR data filtering method based on cloth
simulation. Remote Sensing 8(6), 501.

Where we depart from the paper, why, and what that gained: docs/explanation/cloth-simulation.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from algorithms.ground import _csf_kernels as kernels
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Raster
from toolbox.data.crs import vertical_unit
from toolbox.errors import DataError
from toolbox.spec import outputs, param, sink, source, tool
from toolbox.values import ClassList

GRAVITY = 0.24  # metres per square of the time step, for particles 1 metre apart
DRAG = 0.325  # share of the speed lost in a step, per metre between particles (small ones)
HALO = 100.0  # metres of data that a tile needs around it, 2 START_REACH
START_GAP = 0.05  # metres
START_REACH = 50.0  # metres: half the width of the widest object
AT_REST = 0.02  # of the way that gravity alone moves a particle in a step; tiles agree from here on
SLOPE_STEP = 0.3  # metres, h_cp in section 3.4 of the paper
OUTLIER_CELL, OUTLIER_REACH, OUTLIER_STEP = 1.0, 10.0, 1.0  # metres
OUTLIER_SLOPE, OUTLIER_SUPPORT = 0.3, 5
BYTES_PER_PARTICLE = 33
MAX_PARTICLES = 200_000_000  # 6.6 GB: a square of 7 km at 0.5 m, more than a tile ever needs
CHECK_EVERY = 10  # steps between two looks at which tiles still move
FEW_TILES = 16  # not worth waking threads
BLOCK = 2_000_000  # nodes or points that are worked on between two looks at the context

GROUND, OTHER = 2, 1  # ASPRS classes

Floats = NDArray[np.float64]


@tool("ground.csf")
class GroundCsf:
    """Classify ground with a cloth that falls on the points turned upside down.

    Ground becomes class 2, all else class 1. Choose `rigidness` by terrain: 3 flat, 2 gentle
    slopes with buildings, 1 steep slopes. Turn on `smooth_slopes` where banks and ditches lose
    points; it also lets the cloth climb low roofs, so leave it off among large buildings on flat
    ground. With the defaults the cloth sags onto halls wider than some 30 m; a smaller `time_step`
    spans wider ones. The cloth covers gaps and can serve as a first terrain model.
    """

    points: PointCloud = source("Points to classify")
    cloth_resolution: float = param("Distance of the cloth particles", default=0.5, unit="m", gt=0)
    rigidness: Literal[1, 2, 3] = param(
        "Stiffness of the cloth: 1 steep slopes, 2 gentle slopes, 3 flat terrain", default=3
    )
    smooth_slopes: bool = param("Let the cloth down on steep slopes afterwards", default=False)
    class_threshold: float = param(
        "Greatest distance of a ground point from the cloth", default=0.5, unit="m", gt=0
    )
    time_step: float = param(
        "Time step of the simulation; gravity acts with its square",
        default=0.65,
        unit="1",
        gt=0,
        le=2,
    )
    iterations: int = param("Most steps until the cloth rests", default=500, unit="1", ge=1)
    ignore: ClassList | None = param(
        "Classes that take no part and stay as they are, such as noise 7,18", default=None
    )
    keep_classes: bool = param(
        "Let points that are not ground keep their class, unless it was 2", default=False
    )

    @outputs
    class Outputs:
        classified: PointCloud = sink("The same points, class 2 on ground and 1 elsewhere")
        cloth: Raster = sink("Elevation of the cloth at rest")
        ground_share: float = sink("Share of points that became ground", unit="1")

    def halo(self) -> float:
        """The lid from which the cloth starts looks this far; the cloth itself less."""
        return HALO

    def run(self, ctx: Context = QUIET) -> GroundCsf.Outputs:
        """Simulate, and compare points and cloth."""
        cloud = self.points
        old = cloud["classification"] if "classification" in cloud else np.zeros(len(cloud), "u1")
        use = ~np.isin(old, self.ignore or ())
        xyz = cloud.xyz if use.all() else cloud.xyz[use]
        cloth = cloth_simulation(
            xyz,
            cloth_resolution=self.cloth_resolution,
            rigidness=self.rigidness,
            smooth_slopes=self.smooth_slopes,
            time_step=self.time_step,
            iterations=self.iterations,
            metre=cloud.metre,
            ctx=ctx.part(0, 0.95),
        )
        if not cloth.settled:
            log.warning("the cloth did not come to rest in %d iterations", self.iterations)
        ground = np.zeros(len(cloud), bool)
        ground[use] = ground_mask(xyz, cloth, class_threshold=self.class_threshold)
        classes = np.where(ground, GROUND, OTHER)
        if self.keep_classes:
            classes = np.where(ground | (old == GROUND), classes, old)
        classes = np.where(use, classes, old).astype(np.uint8)
        ctx.progress(1.0)
        return self.Outputs(
            classified=cloud.with_attributes({"classification": classes}),
            cloth=Raster.from_lattice(
                cloth.heights.astype(np.float32),
                cloth.lattice,
                crs=cloud.crs,
                descriptions=("cloth",),
                units=(vertical_unit(cloud.crs) if cloud.crs else "",),
            ),
            ground_share=float(np.count_nonzero(ground) / len(ground)),
        )


@dataclass(frozen=True)
class Cloth:
    """The cloth at rest, turned upright again: a terrain model without holes.

    Attributes
    ----------
    heights : array of shape (rows, cols), elevation of the particles
    lattice : cells with a particle in the middle of each, in whole multiples of their size
    settled : whether the cloth came to rest within the iterations
    """

    heights: Floats
    lattice: Lattice
    settled: bool


def ground_mask(xyz: Floats, cloth: Cloth, *, class_threshold: float = 0.5) -> NDArray[np.bool_]:
    """True where a point is near the cloth.

    The vertical distance may be `class_threshold`, and more where the cloth is steep: its
    elevation there is uncertain by slope times cell, since a particle took the height of a
    point that may lie anywhere in its cell. Beyond its edge the cloth goes on level.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    cloth : made from the same points, or from those of their returns that may be ground
    class_threshold : in the unit of the points, h_cc in the paper

    Returns
    -------
    array of shape (n,)

    Raises
    ------
    ValueError
        A coordinate is not a finite number.
    """
    require_finite(xyz)
    cell = cloth.lattice.cell
    # Counted in whole cells from the origin of the coordinates, a place is the same in all tiles.
    left, top = round(cloth.lattice.west / cell), round(cloth.lattice.north / cell)
    near: NDArray[np.bool_] = kernels.near_surface(
        cloth.heights, left, top, cell, xyz, class_threshold
    )
    return near


def cloth_simulation(
    xyz: Floats,
    *,
    cloth_resolution: float = 0.5,
    rigidness: int = 3,
    smooth_slopes: bool = False,
    time_step: float = 0.65,
    iterations: int = 500,
    metre: float = 1.0,
    ctx: Context = QUIET,
) -> Cloth:
    """Let a cloth fall on the points turned upside down.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    cloth_resolution : distance of the particles, in the unit of the points
    rigidness : passes of the springs per step; 3 for flat, 2 for gentle, 1 for steep terrain
    smooth_slopes : let the cloth down on steep slopes where it lies against resting parts
        (section 3.4 of the paper)
    time_step : of the simulation; gravity moves the cloth by its square
    iterations : most steps that the cloth may take to come to rest
    metre : length of one metre in the unit of the points
    ctx : progress and cancellation

    Returns
    -------
    Cloth
        On a lattice one cell wider than the points on all sides.

    Raises
    ------
    ValueError
        A coordinate is not a finite number.
    DataError
        There are no points, or their bounding box would need more than MAX_PARTICLES particles.

    Notes
    -----
    Memory is BYTES_PER_PARTICLE for each particle and 1 byte for each point.
    """
    if not len(xyz):
        raise DataError("points: there are none to lay a cloth on")
    require_finite(xyz)
    lattice = lattice_around(xyz, cloth_resolution)
    obstacle = obstacle_of(xyz, lattice, metre, ctx.part(0.0, 0.2))
    start = lid_over(obstacle, START_REACH * metre / cloth_resolution, ctx.part(0.2, 0.25))
    start += START_GAP * metre
    spacing = cloth_resolution / metre
    height, settled = let_fall(
        start,
        obstacle,
        drop=GRAVITY * (time_step * spacing) ** 2 * metre,
        drag=1.0 - math.exp(-DRAG * spacing),
        passes=rigidness,
        iterations=iterations,
        ctx=ctx.part(0.25, 1.0),
    )
    if smooth_slopes:
        kernels.settle_slopes(height, obstacle, SLOPE_STEP * metre)
    heights = np.negative(height, out=height)
    heights.flags.writeable = False
    ctx.progress(1.0)
    return Cloth(heights, lattice, settled)


def require_finite(xyz: Floats) -> None:
    """Refuse coordinates that are not finite numbers."""
    if np.isfinite(xyz).all():
        return
    point, axis = np.argwhere(~np.isfinite(xyz))[0]
    raise ValueError(
        f"xyz: coordinates must be finite numbers, got {'xyz'[axis]} = {xyz[point, axis]} "
        f"at point {point}"
    )


def lattice_around(xyz: Floats, cell: float) -> Lattice:
    """The cells of the points and one more on each side."""
    low, high = xyz[:, :2].min(axis=0), xyz[:, :2].max(axis=0)
    with np.errstate(over="ignore"):
        particles = float(np.prod((high - low) / cell + 3))
    if particles > MAX_PARTICLES:
        raise DataError(
            f"points: a cloth of {cell:g} over their bounding box, x {low[0]:.2f} to "
            f"{high[0]:.2f} and y {low[1]:.2f} to {high[1]:.2f}, would need "
            f"{particles:,.0f} particles ({particles * BYTES_PER_PARTICLE / 1e9:,.0f} GB); "
            f"at most {MAX_PARTICLES:,} are allowed: remove stray points, "
            "cut the data into tiles or raise cloth_resolution"
        )
    return Lattice.cover((*(low - cell), *(high + cell)), cell)


def obstacle_of(xyz: Floats, lattice: Lattice, metre: float, ctx: Context) -> Floats:
    """What the cloth falls on: the height of each particle's point, upside down."""
    coarse = max(lattice.cell, OUTLIER_CELL * metre)
    use = without_low_outliers(xyz, coarse, metre, ctx.part(0, 0.6))
    point = lowest_points(xyz, use, lattice, ctx.part(0.6, 0.8))
    spread_to_empty(xyz, point, lattice, ctx.part(0.8, 1.0))
    obstacle: Floats = xyz[:, 2][point]
    return np.negative(obstacle, out=obstacle)


def without_low_outliers(xyz: Floats, cell: float, metre: float, ctx: Context) -> NDArray[np.bool_]:
    """False for points far below almost all others around them, judged on cells of `cell`."""
    lattice = lattice_around(xyz, cell)
    reach = max(2, round(OUTLIER_REACH * metre / cell))
    step, rise = OUTLIER_STEP * metre, OUTLIER_SLOPE * cell
    use = np.ones(len(xyz), bool)
    done = 0.0
    while True:
        half = ctx.part(done, (1 + done) / 2)  # how many rounds there will be, nobody knows
        lowest = lowest_points(xyz, use, lattice, half.part(0.0, 0.2))
        found = np.zeros(lowest.shape, bool)
        for rows in blocks(lattice.rows, 10 * lattice.cols):
            kernels.alone_below(xyz[:, 2], lowest, *rows, reach, step, rise, OUTLIER_SUPPORT, found)
            half.progress(0.2 + 0.8 * rows[1] / lattice.rows)
        if not found.any():
            return use
        use[lowest[found]] = False  # another point of the cell may take its place
        done = (1 + done) / 2


def lowest_points(
    xyz: Floats, use: NDArray[np.bool_], lattice: Lattice, ctx: Context
) -> NDArray[np.int64]:
    """Index of the lowest point in use of each cell; -1 where there is none."""
    lowest = np.full(lattice.shape, -1)
    for start, stop in blocks(len(xyz)):
        cells = lattice.indices(xyz[start:stop, 0], xyz[start:stop, 1])
        kernels.lowest_points(xyz, use, start, *cells, lowest)
        ctx.progress(stop / len(xyz))
    return lowest


def spread_to_empty(xyz: Floats, near: NDArray[np.int64], lattice: Lattice, ctx: Context) -> None:
    """Give each empty cell (-1) the index of the point nearest to its middle (in place)."""
    empty = near < 0
    down = [(first, last, 1) for first, last in blocks(lattice.rows, lattice.cols)]
    up = [(last - 1, first - 1, -1) for first, last, _ in reversed(down)]
    for k, rows in enumerate(down + up):
        kernels.spread_rows(xyz, near, empty, *lattice.centres(), *rows)
        ctx.progress((k + 1) / len(down + up))


def lid_over(obstacle: Floats, reach: float, ctx: Context) -> Floats:
    """Grey closing with a square of half width `reach` nodes: bridges what is narrower."""
    window = 2 * max(1, round(reach)) + 1
    lid = obstacle.copy()
    steps = [
        (extreme, view) for extreme in (maximum_filter1d, minimum_filter1d) for view in (lid, lid.T)
    ]
    for k, (extreme, view) in enumerate(steps):
        for first, last in blocks(*view.shape):
            view[first:last] = extreme(view[first:last], window, axis=1)
            ctx.progress((k + last / len(view)) / len(steps))
    return lid


def let_fall(
    start: Floats,
    obstacle: Floats,
    *,
    drop: float,
    drag: float,
    passes: int,
    iterations: int,
    ctx: Context,
) -> tuple[Floats, bool]:
    """Move the cloth from `start` until it rests; its heights and whether it came to rest.

    `drop` is the way of a free particle in the first step, `drag` the share of speed lost.
    """
    before = start
    height = np.maximum(start - drop, obstacle)
    following = height.copy()
    every = kernels.tiles_of(*height.shape)
    awake = np.ones(len(every), bool)
    for k in range(iterations):
        if k % CHECK_EVERY == 0:
            # A tile at rest is worked on for one more round: then all arrays agree on it.
            was_awake, awake = awake, kernels.movable(every, height, obstacle)
            tiles = every[awake | was_awake]
        step = kernels.step_serial if len(tiles) < FEW_TILES else kernels.step
        moved = step(tiles, height, following, before, obstacle, passes, drag, drop)
        height, following = following, height
        ctx.progress((k + 1) / iterations)
        if moved.max(initial=0.0) < AT_REST * drop:
            return before, True
    return before, False


def blocks(total: int, size: int = 1) -> list[tuple[int, int]]:
    """Cut `total` items of `size` nodes into runs (first, last) of about BLOCK nodes."""
    length = max(1, BLOCK // size)
    return [(first, min(first + length, total)) for first in range(0, total, length)]
