"""The terrain below a point cloud whose ground is not known.

A building or a tree drops to the ground on all sides, and does so in a step. A hill, a terrace or
an embankment drops on one side, on two, or gradually. So each cell of a raster of lowest points
looks in eight directions; what is raised all round is taken out, and a robust surface is laid
through what remains. Points near that surface are ground.

The ideas and their sources, and what they gained: docs/explanation/ground-classification.md.

References
----------
Meng, X. et al. (2009). A multi-directional ground filtering algorithm for airborne LIDAR. ISPRS
Journal 64(1), 117-124: neighbours in several directions decide.
Knutsson, H. and Westin, C.-F. (1993). Normalized and differential convolution. CVPR, 515-523:
planes fitted to irregular data by convolutions.
Kraus, K. and Pfeifer, N. (1998). Determination of terrain models in wooded areas with airborne
laser scanner data. ISPRS Journal 53(4), 193-203: weights that depend on the residual and its sign.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import (
    distance_transform_edt,
    maximum_filter,
    minimum_filter,
    uniform_filter,
)

from algorithms.shared.breaklines import off_tops, taken_back
from algorithms.shared.kernels import terrain as kernels
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import (
    blocks,
    cells_of,
    lattice_around,
    lowest_points,
    require_finite,
    without_low_outliers,
)
from algorithms.shared.sections import WIDEST, raised_sections
from algorithms.shared.tolerance import share_with_points, tolerances
from toolbox.context import QUIET, Context
from toolbox.data import Lattice
from toolbox.errors import DataError

CELL = 1.0  # metres, of the raster of lowest points; all kernels assume it
LEVELS = 4  # resolutions at which a cell looks around: to 8 m at 1 m, ..., to 64 m at 8 m
LOOK = 8  # cells, at each of them
ALL_SECTORS = np.uint8(255)  # a bit for each of eight
STEP_REACH, STEP_SLOPE = 3, 0.8  # metres; what is steeper is a step
STEP, STEP_SHARE = 0.3, 0.2  # metres, and of the whole fall: how much of it must be in one step
FALL = 0.2  # metres below which the terrain must be, beyond what the slope explains
FIRST_SLOPE, FIRST_SHARE = 0.5, 5 / 8  # for the first look, before the terrain is known
SLOPE, SLOPE_GAIN = 0.2, 1.0  # what counts as a fall, on level ground and per slope of the terrain
RELIEF = 50  # metres: half the window of the relief; as far a plane reaches that is the hillside
PLANE_LEVEL = 3  # cells of 8 m for that plane, a sixth of its reach
# An edge of a terrace falls off in half of the sectors, so that on hillsides five of the eight must
# do so; rough ground has falls of its own.
SHARE_LEVEL, SHARE_HILLSIDE, SHARE_ROUGH = 0.45, 5 / 8, 0.7
LITTLE, MUCH = 0.02, 0.045  # mean slopes beside that plane, of even and of rough terrain
# Slope of that plane from which the ground behind a house hides it, a metre in 10 m; level is half
# of it: terraces of 3 m are 60 m wide there.
HILLSIDE = 0.1
UPHILL = 4  # sectors in which the ground behind a house hides it: the uphill half of them
ANY, SIDES = (-1,), (0, 1, 2, 3)  # ways of a step down: whichever; south, north, east or west
WIDE = 3  # cells; what is narrower, as a shrub, makes no step for what lies above it
# Cells on one plane are judged alike: metres, metres per metre, cells, rounds.
SAME_STEP, SAME_SLOPE, SAME_REACH, SAME_ROUNDS = 0.2, 0.2, 4, 3
COARSE = ((4, 2.0), (3, 3.0), (2, 3.0))  # level and window of a surface, in cells of that level
FINE = (*COARSE, (1, 3.0), (0, 3.0), (0, 1.5))
BENDING = ((0, 3.0), (0, 1.5), (0, 1.0))  # what follows the edges that are known by then
ENOUGH = 2.0  # points in a window
# How much a plane resists to tilt: that of a hillside hardly, so that points in a line have one.
STIFF_PLANE, STIFF_COARSE, STIFF = 0.001, 0.25, 1.0
ROUNDS, ROUNDS_KNOWN = 5, 2  # the latter where the points are known to be ground
# Known ground has mistakes where more than this share of the cells within RELIEF stands out by so
# many metres, each with ground in less than half of the cells around. Towns with right classes have
# no such place, and are such places all over with a two-hundredth of all points called ground.
MISTAKEN, OUT_OF_LINE = 0.003, 1.0
SCATTERED = 5, 0.5  # cells, side of the window around one; share of them
TOLERANCE, SLOPE_TOLERANCE, BELOW = 0.3, 1.0, 3.0  # metres; metres per slope; points below: times
BEYOND = 100.0  # metres; so far from a hall that the edge of a tile parts, labels are right
KNOWN_HALO = 200.0  # metres, of ground that is known
BYTES_PER_CELL = 115  # at most at one time; sections of cells and their borders take most
FAR = 10.0  # metres beyond half of the longest building: so far from any ground the surface ends

Floats = NDArray[np.float64]
Cells = NDArray[np.float32]
Levels = tuple[tuple[int, float], ...]


@dataclass(frozen=True)
class Terrain:
    """The terrain as a raster of heights.

    Attributes
    ----------
    heights : array of shape (rows, cols), in metres, NaN too far from any ground
    bend : array of the same shape, how far they follow edges off a smooth surface, in metres
    tolerance : array of shape (2, rows / 8, cols / 8), how far ground may lie above the terrain:
        metres on level ground, and metres more per slope; the most where all points are ground
    lowest : array of shape (rows, cols), height of the lowest point of each cell, in metres
    ground : array of the same shape, where that is a point of the ground
    wide : array of the same shape, how long buildings must be, in metres, for ground that ends in
        steps down to be roofs, 0 elsewhere
    lattice : cells of a metre, in the unit of the coordinates
    metre : length of one metre in that unit

    Examples
    --------
    >>> xyz = np.array([[x, y, 100 + 0.1 * x] for x in range(30) for y in range(30)])
    >>> terrain = find_terrain(xyz)
    >>> terrain.heights.shape == terrain.lattice.shape
    True
    """

    heights: Floats
    bend: Floats
    tolerance: Floats
    lowest: Cells
    ground: NDArray[np.bool_]
    wide: Cells
    lattice: Lattice
    metre: float


def find_terrain(
    xyz: Floats,
    *,
    known: bool = False,
    mistakes: bool = False,
    widest: float = WIDEST,
    metre: float = 1.0,
    ctx: Context = QUIET,
) -> Terrain:
    """The terrain: a robust surface through the lowest points that are not raised on all sides.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    known : whether all of them are ground, so that none stands out, which takes a fifth of the time
    mistakes : whether some of known ground may be none, as where classes are wrong; where many
        stand out, it is looked for as if it were not known
    widest : metres from end to end of the widest building
    metre : length of one metre in the unit of the points
    ctx : progress and cancellation

    Returns
    -------
    Terrain

    Raises
    ------
    ValueError
        A coordinate is not a finite number.
    DataError
        There are no points, or their bounding box is too large for a raster.

    Examples
    --------
    >>> xyz = np.array([[x, y, 100 + 0.1 * x] for x in range(30) for y in range(30)])
    >>> xyz[(abs(xyz[:, :2] - 15) < 4).all(axis=1), 2] += 6.0  # a house
    >>> round(float(np.nanmax(find_terrain(xyz).heights)), 1)
    103.5
    """
    if not len(xyz):
        raise DataError("points: there are none that could be ground")
    require_finite(xyz)
    lattice = aligned_lattice(xyz, metre)
    use = without_low_outliers(xyz, CELL * metre, metre, ctx.part(0.0, 0.1))
    lowest = lowest_points(xyz, use, lattice, ctx.part(0.1, 0.15))
    z = np.where(lowest >= 0, xyz[:, 2][lowest] / metre, np.nan).astype(np.float32)
    candidates, wide, heights = _through_ground(
        z, ctx.part(0.15, 0.9), known=known, mistakes=mistakes, widest=widest
    )
    share = share_with_points(z)
    ground = near_surface(z, candidates, heights)
    ground |= taken_back(z, ground, candidates & ~ground, share, ctx.part(0.9, 0.95))
    bend = np.zeros_like(heights)
    add_planes(bend, z - heights, ground.astype(np.float32), BENDING, STIFF, ctx.part(0.95, 1.0))
    heights += bend
    heights[distance_transform_edt(~candidates) > widest / 2 + FAR] = np.nan
    tolerance = np.empty((2, *share.shape))
    tolerance[0], tolerance[1] = TOLERANCE, SLOPE_TOLERANCE
    terrain = Terrain(heights, bend, tolerance, z, ground, wide, lattice, metre)
    if not known:
        learned = tolerances(height_above(xyz, terrain), blocks_of(xyz, lattice), share)
        terrain = replace(terrain, tolerance=learned)
    for array in (heights, bend, terrain.tolerance, z, ground, wide):
        array.flags.writeable = False
    return terrain


def _through_ground(
    z: Cells, ctx: Context, *, known: bool, mistakes: bool, widest: float
) -> tuple[NDArray[np.bool_], Cells, Floats]:
    """The cells whose lowest point may be ground, wide places among them, and a robust surface.

    Parameters
    ----------
    z : lowest height of each cell, NaN where there is none
    known, mistakes, widest : see :func:`find_terrain`
    """
    has = doubted = np.isfinite(z)
    rounds = ROUNDS_KNOWN if known and not mistakes else ROUNDS
    if known:
        heights = robust_surface(z, has, FINE, STIFF, ctx.part(0.0, 0.25), rounds=rounds)
        if not mistakes or not (doubted := among_mistaken(z, heights)).any():
            return has, np.zeros_like(z), heights
    ground = ground_cells(z, ctx.part(0.25 if known else 0.0, 0.75))
    raised, wide = raised_sections(z, STEP_SLOPE, widest)
    candidates = has & (ground & ~raised | ~doubted)
    surface = robust_surface(z, candidates, FINE, STIFF, ctx.part(0.75, 1.0), rounds=rounds)
    return candidates, candidates * wide, surface


def among_mistaken(z: Cells, surface: Floats) -> NDArray[np.bool_]:
    """True for cells of known ground with many around that stand out of the surface through all.

    A mound or a quay stands out, too, but has ground in all its cells: it is none of a mistake.

    >>> z = np.full((300, 200), np.nan, np.float32)
    >>> z[::3], z[:150:6] = 0.0, 4.0
    >>> among_mistaken(z, np.zeros(z.shape))[[0, -3], 0].tolist()
    [True, False]
    """
    has, out = np.isfinite(z), z - surface > OUT_OF_LINE
    if not out.any():
        return out
    side, full = SCATTERED
    out &= _share_around(has, side) < full
    return has & (
        _share_around(out, 2 * RELIEF + 1) > MISTAKEN * _share_around(has, 2 * RELIEF + 1)
    )


def _share_around(cells: NDArray[np.bool_], side: int) -> Floats:
    """Share of the cells in the window around each that are true; there are none beyond the end."""
    return np.asarray(uniform_filter(cells.astype(np.float64), side, mode="constant"))


def blocks_of(xyz: Floats, lattice: Lattice) -> NDArray[np.int64]:
    """The block of 8 x 8 cells of each point, counted row by row."""
    found = np.empty(len(xyz), np.int64)
    kernels.blocks_of(cells_of(xyz, lattice), lattice.cols, found)
    return found


def verdict(xyz: Floats, terrain: Terrain) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """True for points near the terrain, and the confidence of that.

    Ground may lie above the terrain by the tolerance, which follows the scatter of the ground and
    grows with slope, and below it by three times that and a metre. What continues the ground at the
    top of an upright step, whose foot is in the same cell, is ground, too.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    terrain : of the same area

    Returns
    -------
    arrays of shape (n,)
        The confidence goes from 0 at the limit to 1 on the terrain, and to 1 as far above the
        limit, or 0.3 m if that is more. Ground is the less sure the farther the terrain had to
        bend to it, as at edges of terraces. Where there is no terrain, there is no ground.

    Raises
    ------
    ValueError
        A coordinate is not a finite number.

    Examples
    --------
    >>> xyz = np.array([[x, y, 100 + 0.1 * x] for x in range(30) for y in range(30)])
    >>> ground, confidence = verdict(xyz + np.array([0, 0, 5.0]), find_terrain(xyz))
    >>> ground.any()
    np.False_
    """
    require_finite(xyz)
    ground, confidence = np.empty(len(xyz), bool), np.empty(len(xyz), np.float32)
    beside = np.empty(len(xyz), np.int32)
    at_ground = np.where(terrain.ground, terrain.lowest, np.float32(-np.inf))
    highest = np.where(terrain.ground, maximum_filter(at_ground, 3, mode="nearest"), -np.inf)
    side_by_side(
        kernels.verdicts,
        blocks(len(xyz), 10),
        *_placed(xyz, terrain),
        terrain.bend,
        terrain.tolerance,
        TOLERANCE,
        BELOW,
        highest,
        ground,
        confidence,
        beside,
    )
    asked = np.flatnonzero(beside >= 0)
    off = off_tops(
        beside[asked],
        (xyz[asked, 2] / terrain.metre).astype(np.float32),
        *(terrain.lowest, terrain.ground, share_with_points(terrain.lowest)),
    )
    tops = asked[off <= 1]
    ground[tops], confidence[tops] = True, 1 - off[off <= 1]
    return ground, confidence


def height_above(xyz: Floats, terrain: Terrain) -> Floats:
    """Heights of points above the terrain, in metres.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    terrain : of the same area

    Returns
    -------
    array of shape (n,), NaN where there is no terrain

    Raises
    ------
    ValueError
        A coordinate is not a finite number.

    Examples
    --------
    >>> xyz = np.array([[x, y, 100 + 0.1 * x] for x in range(30) for y in range(30)])
    >>> height = height_above(xyz + np.array([0, 0, 5.0]), find_terrain(xyz))
    >>> round(float(np.median(height)))
    5
    """
    require_finite(xyz)
    height = np.empty(len(xyz))
    side_by_side(kernels.heights_above, blocks(len(xyz), 10), *_placed(xyz, terrain), height)
    return height


def _placed(xyz: Floats, terrain: Terrain) -> tuple[Any, ...]:
    """What kernels need to find the height of the terrain at points."""
    left, top = terrain.lattice.west, terrain.lattice.north
    cell = terrain.lattice.cell
    return xyz, terrain.metre, round(left / cell), round(top / cell), terrain.heights


def aligned_lattice(xyz: Floats, metre: float) -> Lattice:
    """Lattice of one-metre cells around points, aligned so that coarser levels are aligned too.

    Examples
    --------
    >>> aligned_lattice(np.array([[500_003.5, 4_600_001.5, 9.0]]), 1.0).cell
    1.0
    """
    lattice_around(xyz, CELL * metre, bytes_per_cell=BYTES_PER_CELL)
    size = 2 ** max(level for level, _ in FINE)
    coarse = lattice_around(xyz, size * metre)
    return Lattice(coarse.west, coarse.north, metre, coarse.rows * size, coarse.cols * size)


def ground_cells(z: Cells, ctx: Context) -> NDArray[np.bool_]:
    """True for cells whose lowest point is not raised above its surroundings on all sides.

    The first look takes any slope below FIRST_SLOPE for terrain. It yields a coarse surface,
    which tells the second look what a fall is here. In the third, what was taken out is no longer
    in the way of what it hid.
    """
    has, opened = np.isfinite(z), without_thin(z)
    thin = z - opened > STEP
    step = steps_down(z, opened, ANY, ctx.part(0.0, 0.1))
    slope = np.full(z.shape, FIRST_SLOPE, np.float32)
    votes = raised_share(z, has, slope, thin, step, ctx.part(0.1, 0.4))
    coarse = robust_surface(
        z, has & (votes < FIRST_SHARE), COARSE, STIFF_COARSE, ctx.part(0.4, 0.45)
    )
    hill = hillside_of(coarse, ctx.part(0.45, 0.5))
    by_sides = None
    if hill.hidden.any():
        by_sides = steps_down(z, opened, SIDES, ctx.part(0.5, 0.6))
    ground = _looked_twice(z, hill, thin, step, by_sides, ctx.part(0.6, 0.95))
    ctx.progress(1.0)
    return ground


@dataclass(frozen=True)
class Hillside:
    """The plane on which a place of the terrain lies, and how rough the terrain is beside it.

    Attributes
    ----------
    plane : array of shape (rows, cols), height of the plane through the surroundings, in metres
    hidden : bits of the sectors uphill, where the ground may hide that a house falls off
    fall, fall_above : slope that is no fall, for heights and for heights above the plane
    share : of the sectors that must fall off from what is no ground

    Examples
    --------
    >>> hillside_of(np.zeros((96, 300))).share.shape
    (96, 300)
    """

    plane: Cells
    hidden: NDArray[np.uint8]
    fall: Cells
    fall_above: Cells
    share: Cells


def hillside_of(surface: Floats, ctx: Context = QUIET) -> Hillside:
    """The hillside on which each cell lies.

    On a hillside the ground behind a house is as high as its roof within a few metres, so that no
    sector uphill speaks for a fall; above the plane of the hillside the house falls off there, too.
    Where the slope of the terrain departs much from that of the plane, banks and edges of terraces
    do so as well: there the same slope is no fall for heights above the plane as for heights.

    Parameters
    ----------
    surface : array of shape (rows, cols) with cells of a metre, NaN where nothing is known
    ctx : progress and cancellation

    Returns
    -------
    Hillside

    Examples
    --------
    >>> hill = hillside_of(0.3 * np.tile(np.arange(300.0), (96, 1)))
    >>> f"{hill.hidden[48, 150]:b}", round(float(hill.share[48, 150]), 3)
    ('11000011', 0.625)
    >>> [round(float(fall[48, 150]), 2) for fall in (hill.fall, hill.fall_above)]
    [0.5, 0.2]
    """
    known = np.isfinite(surface)
    level = ((PLANE_LEVEL, RELIEF / 2**PLANE_LEVEL),)
    plane = planes_through(surface, known.astype(np.float32), level, STIFF_PLANE, ctx)
    own, uphill = _gradient(np.where(known, surface, plane)), _gradient(plane)
    slope, beside, tilt = np.hypot(*own), np.hypot(*(own - uphill)), np.hypot(*uphill)
    rough = _between(LITTLE, MUCH, uniform_filter(beside, 2 * RELIEF + 1, mode="nearest"))
    share = np.maximum(
        (SHARE_HILLSIDE - SHARE_LEVEL) * _between(HILLSIDE / 2, HILLSIDE, tilt),
        (SHARE_ROUGH - SHARE_LEVEL) * rough,
    )
    hidden, inclined = np.zeros(tilt.shape, np.uint8), tilt > HILLSIDE
    hidden[inclined] = _sectors_towards(*uphill[:, inclined])
    return Hillside(
        plane=plane.astype(np.float32),
        hidden=hidden,
        fall=_no_fall(slope),
        fall_above=_no_fall(beside + (slope - beside) * rough),
        share=(SHARE_LEVEL + share).astype(np.float32),
    )


def _between(low: float, high: float, slope: Cells) -> Cells:
    """From 0 where a slope is low to 1 where it is high."""
    share: Cells = np.clip((slope - np.float32(low)) / np.float32(high - low), 0, 1)
    return share


def _gradient(surface: Floats) -> Cells:
    """Slope to the south and to the east, of shape (2, rows, cols), 0 where there is none."""
    return np.nan_to_num(np.asarray(np.gradient(surface), np.float32), copy=False)


def _no_fall(slope: Cells) -> Cells:
    """The slope that is no fall where the terrain has this slope."""
    fall: Cells = np.minimum(SLOPE + SLOPE_GAIN * slope, 1.0).astype(np.float32)
    return fall


def _sectors_towards(south: Cells, east: Cells) -> NDArray[np.uint8]:
    """Bits of the sectors, as many as UPHILL, around a direction."""
    octant = np.float32(math.pi / 4)
    first = np.round(np.arctan2(south, east) / octant).astype(np.int8) - UPHILL // 2
    bits = [sum(1 << (k + i) % 8 for i in range(UPHILL)) for k in range(8)]
    return np.array(bits, np.uint8)[first % 8]


def _looked_twice(
    z: Cells,
    hill: Hillside,
    thin: NDArray[np.bool_],
    step: Cells,
    step_by_sides: Cells | None,
    ctx: Context,
) -> NDArray[np.bool_]:
    """True for cells that fall off in less than a share of the sectors, in the second of two looks.

    On hillsides sectors uphill without a fall are asked again, with heights above the plane; only
    that needs the steps by sides. For `thin` and `step` see :func:`raised_share`.
    """
    has, asked = np.isfinite(z), np.full(z.shape, ALL_SECTORS)
    ground = has
    for k in range(2):
        part = ctx.part(0.5 * k, 0.5 + 0.5 * k)
        votes = raised_share(z, ground, hill.fall, thin, step, part.part(0, 0.4), asked)
        if step_by_sides is not None:
            looks = hill.fall_above, thin, step_by_sides, part.part(0.4, 0.8)
            votes += raised_share(z - hill.plane, ground, *looks, hill.hidden & ~asked)
        ground = has & (votes_of_planes(z, votes, part.part(0.8, 1)) < hill.share)
    return ground


def without_thin(z: Cells) -> Cells:
    """Heights without what is thin, of the same shape.

    A bank with shrubs falls off gradually, and that these do so in steps says nothing of its top.
    Only for what is thin itself, as crowns are, all steps count.

    References
    ----------
    Zhang, K. et al. (2003). A progressive morphological filter for removing nonground measurements
    from airborne LIDAR data. IEEE TGRS 41(4), 872-882: opening takes out what is narrow.
    """
    has = np.isfinite(z)
    low = minimum_filter(np.where(has, z, np.float32(np.inf)), WIDE)
    opened = maximum_filter(np.where(np.isfinite(low), low, np.float32(-np.inf)), WIDE)
    opened[~has] = np.nan
    return opened


def steps_down(z: Cells, opened: Cells, ways: tuple[int, ...], ctx: Context) -> Cells:
    """The largest steps down within STEP_REACH of each 2 x 2 cells.

    Parameters
    ----------
    z : array of shape (rows, cols)
    opened : the same without what is thin
    ways : ANY or SIDES; on a terrace the wall above leads down to it, but not away from its edge

    Returns
    -------
    array of shape (2, ways, rows / 2, cols / 2): steps without what is thin, and of all cells
    """
    found = np.empty((2, len(ways), z.shape[0] // 2, z.shape[1] // 2), np.float32)
    step = np.empty_like(z)
    for k, heights in enumerate((opened, z)):
        for m, way in enumerate(ways):
            for first, last in blocks(len(z), z.shape[1]):
                kernels.steps(heights, first, last, STEP_REACH, STEP_SLOPE, way, step)
            found[k, m] = of_four(np.maximum, maximum_filter(step, 3))
            ctx.progress((k * len(ways) + m + 1) / (2 * len(ways)))
    return found


def of_four(either: np.ufunc, cells: Cells) -> Cells:
    """The lowest or the highest of each 2 x 2 cells, far faster than by the ends of axes.

    Parameters
    ----------
    either : np.minimum or np.maximum
    cells : array of shape (rows, cols), both even

    Returns
    -------
    array of shape (rows / 2, cols / 2)

    Examples
    --------
    >>> of_four(np.minimum, np.arange(8.0).reshape(2, 4))
    array([[0., 2.]])
    """
    rows = either(cells[::2], cells[1::2])
    return np.asarray(either(rows[:, ::2], rows[:, 1::2]))


def raised_share(
    z: Cells,
    ground: NDArray[np.bool_],
    slope: Cells,
    thin: NDArray[np.bool_],
    step: Cells,
    ctx: Context,
    asked: NDArray[np.uint8] | None = None,
) -> Cells:
    """Share of the eight sectors in which each cell drops abruptly to cells of `ground`.

    `thin` is what stands more than STEP above the surface without it; of `step`, see
    :func:`steps_down`, those down the way count, if they are told by sides. `asked`, of shape
    (rows, cols), are bits of the sectors in which there may be a fall, all by default. It receives
    those in which there is one: where part of the ground is taken out there is none elsewhere, as
    long as nothing else changes.
    """
    asked = np.full(z.shape, ALL_SECTORS) if asked is None else asked
    low = np.where(ground, z, np.float32(np.inf))
    lows = []
    for _ in range(LEVELS):
        lows.append(np.pad(low, LOOK, constant_values=np.inf))
        low = of_four(np.minimum, low)
    share = np.empty_like(z)
    side_by_side(
        kernels.raised,
        blocks(len(z), 20 * z.shape[1]),
        z,
        tuple(lows),
        LOOK,
        *sectors(),
        slope,
        thin,
        step,
        FALL,
        STEP,
        STEP_SHARE,
        asked,
        share,
        ctx=ctx,
    )
    return share


@functools.cache
def sectors() -> tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]:
    """Offsets at which a cell looks, sector by sector, and how far away they are.

    Returns
    -------
    offsets : array of shape (levels, k, 3), rows down, columns right, sector 0 to 7; the coarser
        levels begin where the finer ones end, so they skip the middle, and end in zeros
    starts : array of shape (levels, 9), the first offset of each sector, and their number
    away : array of shape (levels, size, size, k), metres from a place in a cell of a level, rows
        and columns from its first, to the middle of the cell at each offset
    nearest : array of shape (levels, size, size, 8), the least of them in each sector
    """
    size = 1 << (LEVELS - 1)
    offsets = np.zeros((LEVELS, (2 * LOOK + 1) ** 2, 3), np.int64)
    starts = np.zeros((LEVELS, 9), np.int64)
    away = np.zeros((LEVELS, size, size, offsets.shape[1]))
    nearest = np.zeros((LEVELS, size, size, 8))
    for level in range(LEVELS):
        near, size = LOOK / 2 if level else 0, 1 << level
        ring = [
            (int(8 * ((math.atan2(down, right) / math.tau + 1.0 - 1e-9) % 1.0)), down, right)
            for down in range(-LOOK, LOOK + 1)
            for right in range(-LOOK, LOOK + 1)
            if near < math.hypot(down, right) <= LOOK
        ]
        for k, (sector, down, right) in enumerate(sorted(ring)):
            offsets[level, k] = down, right, sector
            starts[level, sector + 1 :] = k + 1
        south, east = (
            offsets[level, :, axis] * size + 0.5 * (size - 1) - np.arange(size)[:, None]
            for axis in (0, 1)
        )
        away[level, :size, :size] = np.sqrt(south[:, None] ** 2 + east**2)
        count = starts[level, 8]
        nearest[level] = np.minimum.reduceat(away[level, ..., :count], starts[level, :8], axis=-1)
    return offsets, starts, away, nearest


def votes_of_planes(z: Cells, votes: Cells, ctx: Context) -> Cells:
    """Votes averaged over cells on one plane, so that a roof or terrace is judged as a whole."""
    runs = blocks(len(z), 10 * z.shape[1])
    for k in range(SAME_ROUNDS):
        mean = np.empty_like(votes)
        part = ctx.part(k / SAME_ROUNDS, (k + 1) / SAME_ROUNDS)
        side_by_side(
            kernels.levelled, runs, votes, z, SAME_REACH, SAME_STEP, SAME_SLOPE, mean, ctx=part
        )
        votes = mean
    return votes


def robust_surface(
    z: Cells,
    candidates: NDArray[np.bool_],
    levels: Levels,
    stiff: float,
    ctx: Context,
    *,
    rounds: int = ROUNDS,
) -> Floats:
    """Robust surface through candidates: those far from it lose weight.

    Coarse planes first, finer ones through what they leave; then points far above get little
    weight, and all starts again.

    Parameters
    ----------
    z : array of shape (rows, cols), NaN where there is no point
    candidates : array of the same shape
    levels, stiff : see COARSE and STIFF
    rounds : how often the weights are found anew

    Returns
    -------
    array of shape (rows, cols), NaN far from any candidate
    """
    weight = candidates.astype(np.float32)
    for k in range(rounds + 1):
        surface = planes_through(
            z, weight, levels, stiff, ctx.part(k / (rounds + 1), (k + 1) / (rounds + 1))
        )
        if k < rounds:
            kernels.reweighted(z, candidates, surface, TOLERANCE, SLOPE_TOLERANCE, BELOW, weight)
    return surface


def planes_through(
    z: Floats | Cells, weight: Cells, levels: Levels, stiff: float, ctx: Context
) -> Floats:
    """Surface summed up from planes in windows of falling size, each fitted to the residuals."""
    surface = np.zeros(z.shape)
    add_planes(surface, z, weight, levels, stiff, ctx, everywhere=True)
    return surface


def add_planes(
    surface: Floats,
    z: Floats | Cells,
    weight: Cells,
    levels: Levels,
    stiff: float,
    ctx: Context,
    *,
    everywhere: bool = False,
) -> None:
    """Add planes in windows of falling size to a surface, each fitted to what it leaves.

    With `everywhere` the first is used however few points there are.
    """
    for k, (level, sigma) in enumerate(levels):
        rows, cols = z.shape[0] >> level, z.shape[1] >> level
        weights, residuals = np.empty((rows, cols)), np.empty((rows, cols))
        kernels.gathered(z, surface, weight, level, weights, residuals)
        heights = np.empty((rows, cols))
        first = everywhere and not k
        side_by_side(
            kernels.planes,
            blocks(rows, 10 * cols),
            weights,
            residuals,
            sigma,
            1e-9 if first else ENOUGH,
            stiff,
            heights,
            ctx=ctx.part(k / len(levels), (k + 1) / len(levels)),
        )
        if not first:
            np.nan_to_num(heights, copy=False)
        if level:
            kernels.add_bilinear(surface, heights, level)
        else:
            surface += heights


def near_surface(z: Cells, candidates: NDArray[np.bool_], surface: Floats) -> NDArray[np.bool_]:
    """True for candidates that have at least half their weight: they are within the tolerance."""
    weight = np.empty_like(z)
    kernels.reweighted(z, candidates, surface, TOLERANCE, SLOPE_TOLERANCE, BELOW, weight)
    return np.asarray(weight >= 0.5)
