"""Ground filter by cloth simulation.

The point cloud is turned upside down and a cloth is let fall on it. The cloth comes to rest
on the former ground and spans the pits that the buildings and trees have become; points
near the cloth are ground.

References
----------
Zhang, W. et al. (2016). An easy-to-use airborne LiDAR data filtering method based on cloth
simulation. Remote Sensing 8(6), 501.

Notes
-----
The steps are those of section 3.3 of the paper. Where it leaves a choice, or where we depart
from it:

- *Gravity* acts once per step, with the square of the time step. It also grows with the
  square of the cloth resolution, so that a coarse and a fine cloth sag alike. The paper gives
  no value; GRAVITY and DRAG are one setting for all terrain, chosen on ISPRS samples.
- *Springs.* A particle is tied to its 8 neighbours and to the 8 two nodes away. In each of
  the `rigidness` passes every movable particle goes half way to the mean of them, which
  leaves 1/2, 1/4, 1/8 of a difference, as in the paper. All read the heights before the
  pass, so the result does not depend on an order of visits or on the number of threads.
- *Obstacle.* A node takes the lowest point of its cell (the paper: the nearest point), and
  in an empty cell the point nearest to its middle in plan.
- *Start.* The paper starts a level cloth above the highest point of all the data. Here it
  starts as a lid on the upturned terrain, its grey closing with a square of twice
  START_REACH. Then far points have no say, tiles agree, and the way down is short.
- *Low outliers* would hold the cloth up like tent poles. On cells of OUTLIER_CELL, a point
  is left out of the cloth if fewer than OUTLIER_SUPPORT other cells within OUTLIER_REACH
  reach below a cone that opens upwards with OUTLIER_SLOPE from OUTLIER_STEP above the point,
  and at least twice as many stay above it. On level ground that takes 4 m of depth. A hill
  side supports its points from along the contour. Such a point is labelled like any other.
- *Distance* from point to cloth is vertical, to the bilinearly interpolated cloth; the
  threshold grows by slope times cloth resolution.
- *Rest.* The cloth rests once no particle moves by more than AT_REST of a free step.

How far the cloth sags: a width W in metres, long in the other direction, by
W^2 GRAVITY time_step^2 / (15/4 rigidness), about half of that over a square. Where that
exceeds the height of a building the cloth lies on the roof: with the defaults from 30 m
width at 8 m height. A larger `rigidness` or a smaller `time_step` spans wider halls.

How far the cloth looks: the lid depends on points up to twice START_REACH away, HALO, and the
cloth on its supports around the widest object, which is narrower. Labels of 30 to 120 m tiles
of five urban and forest scenes differed from those of the whole in at most 0.13 % of the points
with a halo of 25 m, 0.007 % with 50 m, 0.004 % with 75 m and none with 100 m.
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
AT_REST = 0.2  # of the way that gravity alone moves a particle in a step
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
        if not use.any():
            raise DataError("points: there are none to classify")
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
            cloth=self._raster(cloth),
            ground_share=float(np.count_nonzero(ground) / len(ground)),
        )

    def _raster(self, cloth: Cloth) -> Raster:
        lattice = Lattice(cloth.west, cloth.north, cloth.cell, *cloth.heights.shape)
        crs = self.points.crs
        return Raster.from_lattice(
            cloth.heights.astype(np.float32),
            lattice,
            crs=crs,
            descriptions=("cloth",),
            units=(vertical_unit(crs) if crs else "",),
        )


@dataclass(frozen=True)
class Cloth:
    """The cloth at rest, turned upright again: a terrain model without holes.

    Attributes
    ----------
    heights : array of shape (rows, cols), elevation of the particles; the first row is the
        northernmost, the first column the westernmost
    left, top : number of the first column and row, counted in cells from the origin of the
        coordinates, eastwards and northwards
    cell : distance of the particles
    settled : whether the cloth came to rest within the iterations

    A particle stands in the middle of its cell, at x = west + (col + 1/2) cell and
    y = north - (row + 1/2) cell. All lengths are in the unit of the points.
    """

    heights: Floats
    left: int
    top: int
    cell: float
    settled: bool

    @property
    def west(self) -> float:
        """Outer edge of the first column."""
        return self.left * self.cell

    @property
    def north(self) -> float:
        """Outer edge of the first row."""
        return (self.top + 1) * self.cell


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
        A coordinate is not a finite number, or there are points but an empty cloth.
    """
    require_finite(xyz)
    if not len(xyz):
        return np.empty(0, bool)
    if not cloth.heights.size:
        raise ValueError("cloth: made from no points, so it has no elevation")
    lattice = (cloth.heights, cloth.left, cloth.top, cloth.cell)
    near: NDArray[np.bool_] = kernels.near_surface(*lattice, xyz, class_threshold)
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
        On a lattice of whole multiples of `cloth_resolution`, one cell wider than the points
        on all sides; of shape (0, 0) if there are no points.

    Raises
    ------
    ValueError
        A coordinate is not a finite number.
    DataError
        The bounding box of the points would need more than MAX_PARTICLES particles.

    Notes
    -----
    Memory is BYTES_PER_PARTICLE for each particle and 1 byte for each point.
    """
    require_finite(xyz)
    if not len(xyz):
        return Cloth(np.empty((0, 0)), 0, 0, cloth_resolution, settled=True)
    grid = Grid.around(xyz, cloth_resolution)
    obstacle = obstacle_of(xyz, grid, metre, ctx.part(0.0, 0.2))
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
    return Cloth(heights, grid.left, grid.top, cloth_resolution, settled)


def require_finite(xyz: Floats) -> None:
    """Refuse coordinates that are not finite numbers."""
    if np.isfinite(xyz).all():
        return
    point, axis = np.argwhere(~np.isfinite(xyz))[0]
    raise ValueError(
        f"xyz: coordinates must be finite numbers, got {'xyz'[axis]} = {xyz[point, axis]} "
        f"at point {point}"
    )


@dataclass(frozen=True)
class Grid:
    """Cells counted from the origin of the coordinates: `left` eastwards, `top` northwards."""

    left: int
    top: int
    rows: int
    cols: int
    cell: float

    @classmethod
    def around(cls, xyz: Floats, cell: float) -> Grid:
        """The cells of the points and one more on each side."""
        low, high = xyz[:, :2].min(axis=0), xyz[:, :2].max(axis=0)
        (left, bottom), (right, top) = np.floor(low / cell) - 1, np.floor(high / cell) + 1
        rows, cols = int(top - bottom) + 1, int(right - left) + 1
        if rows * cols > MAX_PARTICLES:
            raise DataError(
                f"points: a cloth of {cell:g} over their bounding box, x {low[0]:.2f} to "
                f"{high[0]:.2f} and y {low[1]:.2f} to {high[1]:.2f}, would need "
                f"{rows * cols:,} particles ({rows * cols * BYTES_PER_PARTICLE / 1e9:,.0f} GB); "
                f"at most {MAX_PARTICLES:,} are allowed: remove stray points, "
                "cut the data into tiles or raise cloth_resolution"
            )
        return cls(int(left), int(top), rows, cols, cell)


def obstacle_of(xyz: Floats, grid: Grid, metre: float, ctx: Context) -> Floats:
    """What the cloth falls on: the height of each particle's point, upside down."""
    use = without_low_outliers(xyz, max(grid.cell, OUTLIER_CELL * metre), metre, ctx.part(0, 0.6))
    point = lowest_points(xyz, use, grid, ctx.part(0.6, 0.8))
    spread_to_empty(xyz, point, grid, ctx.part(0.8, 1.0))
    obstacle: Floats = xyz[:, 2][point]
    return np.negative(obstacle, out=obstacle)


def without_low_outliers(xyz: Floats, cell: float, metre: float, ctx: Context) -> NDArray[np.bool_]:
    """False for points far below almost all others around them, judged on cells of `cell`."""
    grid = Grid.around(xyz, cell)
    reach = max(2, round(OUTLIER_REACH * metre / cell))
    step, rise = OUTLIER_STEP * metre, OUTLIER_SLOPE * cell
    use = np.ones(len(xyz), bool)
    done = 0.0
    while True:
        half = ctx.part(done, (1 + done) / 2)  # how many rounds there will be, nobody knows
        lowest = lowest_points(xyz, use, grid, half.part(0.0, 0.2))
        found = np.zeros(lowest.shape, bool)
        for rows in blocks(grid.rows, 10 * grid.cols):
            kernels.alone_below(xyz[:, 2], lowest, *rows, reach, step, rise, OUTLIER_SUPPORT, found)
            half.progress(0.2 + 0.8 * rows[1] / grid.rows)
        if not found.any():
            return use
        use[lowest[found]] = False  # another point of the cell may take its place
        done = (1 + done) / 2


def lowest_points(
    xyz: Floats, use: NDArray[np.bool_], grid: Grid, ctx: Context
) -> NDArray[np.int64]:
    """Index of the lowest point in use of each cell; -1 where there is none."""
    lowest = np.full((grid.rows, grid.cols), -1)
    for start, stop in blocks(len(xyz)):
        kernels.lowest_points(xyz, use, start, stop, grid.left, grid.top, grid.cell, lowest)
        ctx.progress(stop / len(xyz))
    return lowest


def spread_to_empty(xyz: Floats, near: NDArray[np.int64], grid: Grid, ctx: Context) -> None:
    """Give each empty cell (-1) the index of the point nearest to its middle (in place)."""
    empty = near < 0
    down = [(first, last, 1) for first, last in blocks(grid.rows, grid.cols)]
    up = [(last - 1, first - 1, -1) for first, last, _ in reversed(down)]
    for k, rows in enumerate(down + up):
        kernels.spread_rows(xyz, near, empty, grid.left, grid.top, grid.cell, *rows)
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
