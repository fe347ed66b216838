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
from scipy.ndimage import convolve, grey_closing, maximum_filter

from algorithms.ground import _csf_kernels as kernels
from algorithms.shared import parameters
from algorithms.shared.ground import NOWHERE, Candidates, Returns
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import (
    blocks,
    lattice_around,
    lowest_points,
    require_finite,
    spread_to_empty,
    without_low_outliers,
)
from algorithms.shared.plausible import tell_of_ground
from algorithms.shared.strips import strips_of
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Raster
from toolbox.data.crs import vertical_unit
from toolbox.declare import ClassList, outputs, param, sink, source, tool
from toolbox.errors import DataError

GRAVITY = 0.24  # metres per square of the time step, for particles 1 metre apart, rigidness 1
DRAG = 0.2  # share of the speed lost in a step, per metre between particles (small ones)
HALO = 100.0  # metres of data that the cloth of a tile needs around it
AT_REST = 0.005  # of the way that gravity alone moves a particle; tiles agree from here on
COARSEST, FEW_NODES = 8.0, 16  # the cloth begins with particles 8 metres apart, 16 along a side
START_REACH = 50.0  # metres: half the width of the pits that the coarsest cloth starts above
SLOPE_STEP = 0.3  # metres, h_cp in section 3.4 of the paper
BYTES_PER_PARTICLE = 70
AT_ONCE = 10  # steps between two checks of which tiles still move; even

# How rigidness "auto" reads the terrain: the rise of a first cloth over 2 LAG, averaged by BLOCK.
STIFF = 3.0
LAG, BLOCK = 20.0, 100.0  # metres
SLOPES, RIGIDNESS = (0.06, 0.12), (3.0, 1.5)  # 3 on gentler slopes, 1.5 on steeper ones
STEEP = 0.09  # slope from which on the cloth is let down: the middle between the two
AUTO_HALO = 250.0  # metres, 2.5 BLOCK

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


@tool(
    "ground.csf",
    title="Classify ground (cloth, CSF)",
    tags=(
        "ground",
        "filter",
        "dtm",
        "dem",
        "bare",
        "earth",
        "csf",
        "cloth",
        "simulation",
        "smrf-like",
    ),
)
class GroundCsf:
    """Classify ground with a cloth that falls on the points turned upside down.

    Ground becomes class 2, all else class 1. `rigidness` auto stiffens the cloth where the terrain
    is flat, so that it spans large roofs, and softens it and lets it down on slopes, so that it
    reaches ridges and banks. Or set it by terrain: 3 flat, 2 gentle slopes with buildings, 1 steep
    slopes. `smooth_slopes` lets the cloth down everywhere; it then climbs low roofs too, so leave
    it off among large buildings. A smaller `time_step` spans halls wider than some 30 m. The cloth
    covers gaps and can serve as a first terrain model.

    Points of water, rail and road (9 to 11) count like all others and keep their class; wires,
    towers, bridges and other structures (13 to 17, 19) keep theirs and take no part. Without
    `keep_classes` they become 2 or 1, too. Class 2 is decided anew, also if it is named there.
    """

    points: PointCloud = source("Points to classify")
    cloth_resolution: float = param("Distance of the cloth particles", default=0.5, unit="m", gt=0)
    rigidness: Literal["auto", 1, 2, 3] = param(
        "Stiffness of the cloth: 1 steep slopes, 2 gentle slopes, 3 flat terrain, auto by slope",
        default="auto",
        words={
            "auto": "By the slope",
            1: "1: steep slopes",
            2: "2: gentle slopes",
            3: "3: flat terrain",
        },
    )
    smooth_slopes: bool = param(
        "Let the cloth down on all slopes afterwards; auto does so on steep terrain",
        default=False,
        label="Let the cloth down on slopes",
    )
    class_threshold: float = param(
        "Greatest distance of a ground point from the cloth",
        default=0.5,
        unit="m",
        gt=0,
        label="Distance of ground from the cloth",
    )
    time_step: float = param(
        "Time step of the simulation; gravity acts with its square",
        default=0.65,
        unit="1",
        gt=0,
        le=2,
    )
    iterations: int = param("Most steps until the cloth rests", default=500, unit="1", ge=1)
    returns: Returns = parameters.ground_returns()
    ignore: ClassList | None = parameters.ignore()
    keep_classes: ClassList | None = parameters.keep_classes()

    @outputs
    class Outputs:
        classified: PointCloud = parameters.labelled_points()
        ground: PointCloud = parameters.ground_points()
        cloth: Raster = sink("Elevation of the cloth at rest; its rigidness as second band")
        mean_rigidness: float = sink("Rigidness of the cloth, chosen or given, mean", unit="1")
        ground_share: float = parameters.ground_share()

    def halo(self) -> float:
        """Distance beyond which points move the cloth by millimetres; auto adds blocks."""
        return AUTO_HALO if self.rigidness == "auto" else HALO

    def run(self, ctx: Context = QUIET) -> GroundCsf.Outputs:
        """Simulate the cloth, and compare the points with it."""
        cloud = self.points
        candidates = Candidates.of(cloud, self.returns, self.ignore, self.keep_classes)
        if not candidates.chosen.any():
            none = candidates.classified(NOWHERE)
            raise candidates.nothing_to_do(none, cloth=None, mean_rigidness=math.nan)
        xyz = candidates.xyz
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
        softer = float(np.mean(cloth.rigidness < STIFF))
        mean = float(np.mean(cloth.rigidness, dtype=float))
        if self.rigidness == "auto":
            log.info("rigidness: %.2f on average, below 3 on %.0f %%", mean, 100 * softer)
        ground = ground_mask(xyz, cloth, class_threshold=self.class_threshold)
        ctx.progress(1.0)
        tell_of_ground(xyz, ground, strips_of(cloud, candidates.chosen), cloud.metre)
        classified = candidates.classified(ground)
        return self.Outputs(
            classified=classified,
            cloth=Raster.from_lattice(
                np.stack([cloth.heights.astype(np.float32), cloth.rigidness]),
                cloth.lattice,
                crs=cloud.crs,
                descriptions=("cloth", "rigidness"),
                units=(vertical_unit(cloud.crs), "1"),
            ),
            mean_rigidness=mean,
            ground=candidates.ground(classified, ground),
            ground_share=candidates.share(ground, classified),
        )


@dataclass(frozen=True)
class Cloth:
    """The cloth at rest, turned upright again: a terrain model without holes.

    Attributes
    ----------
    heights : array of shape (rows, cols), elevation of the particles
    lattice : cells with a particle in the middle of each, in whole multiples of their size
    rigidness : array of shape (rows, cols), what was given or chosen for the particles
    settled : whether the cloth came to rest within the iterations
    """

    heights: Floats
    lattice: Lattice
    rigidness: Singles
    settled: bool


def ground_mask(xyz: Floats, cloth: Cloth, *, class_threshold: float = 0.5) -> NDArray[np.bool_]:
    """True for points near the cloth.

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
    # Counted in whole cells from the origin of the coordinates, positions agree in all tiles.
    left, top = round(cloth.lattice.west / cell), round(cloth.lattice.north / cell)
    near = np.empty(len(xyz), bool)
    side_by_side(
        kernels.near_surface,
        blocks(len(xyz), 10),
        xyz,
        cloth.heights,
        left,
        top,
        cell,
        class_threshold,
        near,
    )
    return near


def cloth_simulation(
    xyz: Floats,
    *,
    cloth_resolution: float = 0.5,
    rigidness: Literal["auto"] | float = "auto",
    smooth_slopes: bool = False,
    time_step: float = 0.65,
    iterations: int = 500,
    metre: float = 1.0,
    ctx: Context = QUIET,
) -> Cloth:
    """The cloth at rest after falling on the points turned upside down.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    cloth_resolution : distance of the particles, in the unit of the points
    rigidness : strength of the springs, 3 for flat, 2 for gentle, 1 for steep terrain; "auto"
        chooses it by the slope of the terrain around, and smooths the slopes where it is steep
    smooth_slopes : let the cloth down everywhere where it lies against resting parts (section 3.4
        of the paper)
    time_step : of the simulation; gravity moves the cloth by its square
    iterations : most steps that the cloth may take to come to rest, at each resolution
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
    lattice = lattice_around(
        xyz, cloth_resolution, bytes_per_cell=BYTES_PER_PARTICLE, parameter="cloth_resolution"
    )
    obstacle = obstacle_of(xyz, lattice, metre, ctx.part(0.0, 0.4))
    spacing = cloth_resolution / metre
    weight = GRAVITY * (time_step * spacing) ** 2 * metre
    given = STIFF if rigidness == "auto" else rigidness
    chosen = np.full(lattice.shape, given, np.float32)
    height, settled = come_to_rest(
        obstacle, weight / chosen, spacing, iterations, ctx.part(0.4, 0.8)
    )
    resting, steep = height <= obstacle, np.full(lattice.shape, smooth_slopes)
    if rigidness == "auto":
        slope = terrain_slope(height, lattice, metre)
        chosen = np.interp(slope, SLOPES, RIGIDNESS).astype(np.float32)
        steep |= slope > STEEP
        height, still_settled = let_fall(
            height, obstacle, weight / chosen, spacing, iterations, ctx.part(0.8, 1.0)
        )
        settled &= still_settled
    # On slopes the cloth is let down from where it rested when stiff: not from sunken roofs.
    waiting = np.empty(np.count_nonzero(~resting), np.int64)
    kernels.settle_slopes(height, obstacle, resting, steep, SLOPE_STEP * metre, waiting)
    heights = np.negative(height, out=height)
    heights.flags.writeable = chosen.flags.writeable = False
    ctx.progress(1.0)
    return Cloth(heights, lattice, chosen, settled)


def obstacle_of(xyz: Floats, lattice: Lattice, metre: float, ctx: Context) -> Floats:
    """Obstacle of the cloth: the height of the point of each particle, upside down."""
    use = without_low_outliers(xyz, lattice.cell, metre, ctx.part(0.0, 0.5))
    point = lowest_points(xyz, use, lattice, ctx.part(0.5, 0.8))
    spread_to_empty(xyz, point, lattice, ctx.part(0.8, 1.0))
    obstacle: Floats = xyz[:, 2][point]
    return np.negative(obstacle, out=obstacle)


def terrain_slope(height: Floats, lattice: Lattice, metre: float) -> Singles:
    """Slope of the terrain around each node, from the cloth over 2 LAG, averaged by blocks.

    Blocks are in whole multiples from the origin of the coordinates, so that all tiles share them.
    """
    cell = lattice.cell
    lag = max(1, round(LAG * metre / cell))
    eastward, southward = rise_per_row(height.T, lag).T, rise_per_row(height, lag)
    slope = np.hypot(eastward, southward, out=eastward)
    slope /= cell
    size = max(1, round(BLOCK * metre / cell))
    west, south = round(lattice.west / cell), round(lattice.north / cell) - lattice.rows
    mean = block_means(slope[::-1], south, west, size)
    return between_blocks(mean, (south, west), lattice.shape, size)[::-1]


def rise_per_row(height: Floats, lag: int) -> Floats:
    """Rise per row, measured over `lag` rows to each side, fewer at the edges."""
    row = np.arange(len(height))
    first, last = np.maximum(row - lag, 0), np.minimum(row + lag, len(row) - 1)
    rise: Floats = (height[last] - height[first]) / (last - first)[:, None]
    return rise


def block_means(values: Floats, first_row: int, first_col: int, size: int) -> Floats:
    """Mean of the nodes in the 3 x 3 blocks around each block of the lattice."""
    sums, counts = values, np.ones((1, 1))
    for axis, first in ((0, first_row), (1, first_col)):
        block = np.arange(first, first + values.shape[axis]) // size
        starts = np.flatnonzero(np.diff(block, prepend=block[0] - 1))
        sums = np.add.reduceat(sums, starts, axis=axis)
        lengths = np.diff(starts, append=len(block))
        counts = counts * np.expand_dims(lengths, 1 - axis)
    around = np.ones((3, 3))
    mean: Floats = convolve(sums, around, mode="constant") / convolve(
        counts, around, mode="constant"
    )
    return mean


def between_blocks(
    mean: Floats, first: tuple[int, int], shape: tuple[int, int], size: int
) -> Singles:
    """Bilinear interpolation between the centres of blocks, constant beyond the outermost."""
    for axis in (0, 1):
        at = (np.arange(first[axis], first[axis] + shape[axis]) + 0.5) / size - 0.5
        at = np.clip(at - first[axis] // size, 0, mean.shape[axis] - 1)
        low = at.astype(int)
        share = np.expand_dims(at - low, 1 - axis)
        high = np.minimum(low + 1, mean.shape[axis] - 1)
        mean = mean.take(low, axis) * (1 - share) + mean.take(high, axis) * share
    return mean.astype(np.float32)


def come_to_rest(
    obstacle: Floats, drop: Singles, spacing: float, iterations: int, ctx: Context
) -> tuple[Floats, bool]:
    """Heights of the cloth at rest, and whether it came to rest; coarse resolutions come first.

    Where the cloth rests does not depend on its start, so the coarse ones only save time.
    """
    levels = [obstacle]
    while spacing * 2 ** len(levels) <= COARSEST and min(levels[-1].shape) > FEW_NODES:
        levels.append(coarser(levels[-1]))
    last = len(levels) - 1
    start, settled = lid_over(levels[last], START_REACH / (spacing * 2**last)), False
    for k in range(last, -1, -1):
        weight = drop[:: 2**k, :: 2**k] * np.float32(4**k)  # so that all of them sag alike
        part = ctx.part(0.5 ** (k + 1), 0.5**k)
        start, settled = let_fall(start, levels[k], weight, spacing * 2**k, iterations, part)
        if k:
            rows, cols = levels[k - 1].shape
            start = start.repeat(2, axis=0).repeat(2, axis=1)[:rows, :cols]
    return start, settled


def coarser(obstacle: Floats) -> Floats:
    """The highest of every 2 x 2 nodes, as a lattice of half the resolution."""
    rows, cols = obstacle.shape
    even = np.pad(obstacle, ((0, rows % 2), (0, cols % 2)), mode="edge")
    made: Floats = np.maximum(
        np.maximum(even[::2, ::2], even[1::2, ::2]), np.maximum(even[::2, 1::2], even[1::2, 1::2])
    )
    return made


def lid_over(obstacle: Floats, reach: float) -> Floats:
    """Grey closing of the obstacle with a square of half width `reach`: bridges narrow gaps."""
    window = 2 * max(1, round(reach)) + 1
    lid: Floats = grey_closing(obstacle, (window, window))
    return lid


def let_fall(
    start: Floats,
    obstacle: Floats,
    drop: Singles,
    spacing: float,
    iterations: int,
    ctx: Context,
) -> tuple[Floats, bool]:
    """Heights of the cloth that falls from `start`, and whether it came to rest.

    `drop` is the way of a free particle in the first step, `spacing` of the particles in metres.
    """
    inertia = math.exp(-DRAG * spacing)
    height = np.pad(np.maximum(start, obstacle), kernels.REACH, mode="edge")
    before = height.copy()
    own = (slice(kernels.REACH, -kernels.REACH),) * 2
    still = AT_REST * float(drop.min())
    shape = tuple(-(-length // kernels.TILE) for length in obstacle.shape)
    awake, moving = np.ones(shape, bool), np.empty(shape, bool)
    bands = [(k, k + 1) for k in range(-(-obstacle.shape[1] // kernels.BAND))]
    for k in range(0, iterations, AT_ONCE):
        steps = min(AT_ONCE, iterations - k)
        arrays = (awake, height, before, obstacle, drop, inertia)
        side_by_side(kernels.fall, bands, -kernels.REACH, steps, *arrays)
        side_by_side(kernels.fall, bands[1:], kernels.REACH, steps, *arrays)
        ctx.progress((k + steps) / iterations)
        if steps == AT_ONCE:  # an even number, so `height` has the newest
            rows = blocks(shape[0], kernels.TILE * obstacle.shape[1])
            side_by_side(kernels.movement, rows, awake, height, before, still, moving)
            if not moving.any():
                return height[own].copy(), True
            was_awake, awake = awake, maximum_filter(moving, 3)
            for row, col in np.argwhere(was_awake & ~awake) * kernels.TILE:
                tile = np.s_[row : row + kernels.TILE, col : col + kernels.TILE]
                before[own][tile] = height[own][tile]  # both arrays agree on what is at rest
    newest = before if iterations % 2 else height
    return newest[own].copy(), False
