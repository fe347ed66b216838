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
from algorithms.shared.ground import Returns, classified, may_be_ground, taking_part
from algorithms.shared.lowest import (
    blocks,
    lattice_around,
    lowest_points,
    require_finite,
    spread_to_empty,
    without_low_outliers,
)
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
OUTLIER_CELL = 1.0  # metres
BYTES_PER_PARTICLE = 33
CHECK_EVERY = 10  # steps between two looks at which tiles still move
FEW_TILES = 16  # not worth waking threads

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
    returns: Returns = param(
        "Returns that can be ground; points without return numbers always can", default="last"
    )
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
        part = taking_part(cloud, self.ignore)
        chosen = part & may_be_ground(cloud, self.returns)
        xyz = cloud.xyz if chosen.all() else cloud.xyz[chosen]
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
        ground[chosen] = ground_mask(xyz, cloth, class_threshold=self.class_threshold)
        ctx.progress(1.0)
        return self.Outputs(
            classified=classified(cloud, ground, part, keep_classes=self.keep_classes),
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
        There are no points, or their bounding box would need more than MAX_CELLS particles.

    Notes
    -----
    Memory is BYTES_PER_PARTICLE for each particle and 1 byte for each point.
    """
    if not len(xyz):
        raise DataError("points: there are none to lay a cloth on")
    require_finite(xyz)
    lattice = lattice_around(xyz, cloth_resolution, bytes_per_cell=BYTES_PER_PARTICLE)
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


def obstacle_of(xyz: Floats, lattice: Lattice, metre: float, ctx: Context) -> Floats:
    """What the cloth falls on: the height of each particle's point, upside down."""
    coarse = max(lattice.cell, OUTLIER_CELL * metre)
    use = without_low_outliers(xyz, coarse, metre, ctx.part(0, 0.6))
    point = lowest_points(xyz, use, lattice, ctx.part(0.6, 0.8))
    spread_to_empty(xyz, point, lattice, ctx.part(0.8, 1.0))
    obstacle: Floats = xyz[:, 2][point]
    return np.negative(obstacle, out=obstacle)


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
