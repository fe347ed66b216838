"""The shoreline of a water body, interpolated between its points.

Points in a band along the edge of the body become a triangulation. Land points tell by their height
how far above the water they are, and a plane through those nearest to a position on water tells how
deep the ground should be there. Where a side of a triangle goes from land to water, the shore
crosses it where the ground reaches the level: neither the last point on land nor the first one on
water, between which there may be metres.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from algorithms.shared.delaunay import triangulate
from algorithms.shoreline._cells import CellGrid, window
from algorithms.shoreline._level import Level
from toolbox.context import Context

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

BAND = 4  # cells outside of the edge of a body
INSIDE = 12  # and inside: so far the cells of a flat bank may be taken for water
NEAR = 20  # points around one that tell whether it stands on the ground
FIRM = 0.6  # share of those above the water that must lie on one plane with it
ROUGH = 0.1  # m off the plane
AROUND = 0.9  # mean of the directions to near points of water, where it is on more than one side
CONES = (0.1, 0.2)  # slopes of the ground to a point without a plane there, and elsewhere
BLOCK = 50_000  # positions that are processed at a time
HIDDEN = 4.0  # mean spacings from the last point of water to the farthest shore
BEHIND = 100  # nearest points among which those behind one are: twice as many as lie that near
FINEST = 0.25  # of the spacing of points, to which a shore can be told at best
LAND_REACH = 6.0  # mean spacings from a position on water to land that tells how deep it is
ALONE = (2, 8)  # a point on land has more than so many others on land among the nearest ones
PLANE = 4.0  # m2, the land whose points a plane is put through: banks are narrow
PLANE_POINTS = (8, 32)  # but at least so many of them, and no more
TURNS = 3  # of which each takes more points low on the bank for land
SURE = 2.5  # standard deviations of water points above which there is land
ISLAND = 5.0  # the same, that an island must reach: waves do not
LEAST_STEP = 0.05  # m, of that height
WATER, LAND, HOLE, OUTSIDE = 0, 1, 2, 3  # what a place of the band is


@dataclass(frozen=True)
class Places:
    """Points and empty cell centres in the band along the edge of a body.

    Attributes
    ----------
    xy : array of shape (n, 2)
    height : array of shape (n,), above the level; negative where ground is expected below water
    kind : array of shape (n,), WATER, LAND, HOLE or OUTSIDE
    slope : array of shape (n,), of the bank near by; NaN where it is not known
    other : array of shape (n,), whether it is on other water
    """

    xy: Floats
    height: Floats
    kind: NDArray[np.uint8]
    slope: Floats
    other: Mask


@dataclass(frozen=True)
class Shore:
    """The outline of a body as rings with standard deviations.

    Attributes
    ----------
    rings : arrays of shape (k, 2), closed (the first vertex is not repeated), water on the left
    sigma : of each ring an array of shape (k,), standard deviation across the shore
    open : of each ring an array of shape (k,), whether the data end there and not the water
    """

    rings: list[Floats]
    sigma: list[Floats]
    open: list[Mask]


def shore(
    xyz: Floats,
    cells: CellGrid,
    cell_of: Ints,
    body: Ints,
    of_body: NDArray[np.int32],
    level: Level,
    ctx: Context,
) -> Shore:
    """Find the shoreline of a body.

    Parameters
    ----------
    xyz : array of shape (n, 3), last returns, sorted by cell
    cells : their cells
    cell_of : array of shape (n,), the cell of each point, rising
    body : cells of the body
    of_body : array of shape (cells,), a number for each body, 0 on land
    level : of the body
    ctx : progress and cancellation
    """
    where = places(xyz, cells, cell_of, body, of_body, level, ctx.part(0.0, 0.7))
    return outline(where, level, cells, ctx.part(0.7, 1.0))


def places(
    xyz: Floats,
    cells: CellGrid,
    cell_of: Ints,
    body: Ints,
    of_body: NDArray[np.int32],
    level: Level,
    ctx: Context,
) -> Places:
    """Points in the band along the edge of the body, and middles of its cells without points."""
    lattice, metre = cells.lattice, cells.metre
    (top, left), wet = window(lattice, body, BAND + 1)
    square = np.ones((3, 3), bool)
    near = ndimage.binary_dilation(wet, square, iterations=BAND)
    amid = ndimage.binary_erosion(wet, square, iterations=INSIDE, border_value=1)
    band = near & ~amid
    touched = ndimage.binary_dilation(wet, square)
    r, c = np.nonzero(band | (amid & ndimage.binary_dilation(band, square)))
    index = (r + top) * lattice.cols + c + left
    xs, ys = lattice.centres()
    middle = np.column_stack([xs[c + left], ys[r + top]])

    at = _in_cells(cell_of, index)
    points = xyz[at]
    points = points[np.lexsort((points[:, 2], points[:, 1], points[:, 0]))]
    pr, pc = lattice.indices(points[:, 0], points[:, 1])
    height = points[:, 2] - level.at(points[:, :2])
    step = sure_step(level, metre)
    low = height <= step
    number = of_body[pr * lattice.cols + pc]
    foreign_water = (number > 0) & (number != of_body[body[0]])
    foreign = low & (~touched[pr - top, pc - left] | foreign_water)
    hole = amid[r, c] | (wet[r, c] & (cells.count.ravel()[index] == 0))
    open_ = np.concatenate([points[low & ~foreign, :2], middle[hole]])
    stands = _stands(points, ~low, metre, ctx.part(0.0, 0.4))
    stands |= _on_banks(points, ~low, stands, open_, cells, ctx.part(0.4, 0.5))
    kept = foreign | low | _among_others(points, ~low, stands)
    points, height, low, foreign, foreign_water = (
        v[kept] for v in (points, height, low, foreign, foreign_water)
    )
    height[foreign] = step  # lower ground elsewhere, or other water: not of this body
    kind = np.where(low & ~foreign, WATER, LAND)

    beyond = ~cells.inside.ravel()[index] & ndimage.binary_dilation(wet, square)[r, c]
    low_corner, high_corner = middle.min(axis=0), middle.max(axis=0)
    margin = 10 * (high_corner - low_corner).max()
    west, south = low_corner - margin
    east, north = high_corner + margin
    far = np.array([(west, south), (east, south), (east, north), (west, north)])
    outside = np.concatenate([middle[beyond], far])  # no water at the hull: all rings close
    xy = np.concatenate([points[:, :2], middle[hole], outside])
    kind = np.concatenate([kind, np.full(hole.sum(), HOLE), np.full(len(outside), OUTSIDE)]).astype(
        np.uint8
    )
    height = np.concatenate([height, np.zeros(hole.sum()), np.full(len(outside), step)])
    slope = np.full(len(xy), np.nan)
    _expect_ground(xy, height, kind, slope, step, cells, ctx.part(0.5, 1.0))
    other = np.concatenate([low & foreign_water, np.zeros(len(xy) - len(low), bool)])
    return Places(xy, height, kind, slope, other)


def sure_step(level: Level, metre: float) -> float:
    """Height above the level from which points are surely on land."""
    return max(SURE * level.sigma, LEAST_STEP * metre)


def _in_cells(cell_of: Ints, some: Ints) -> Ints:
    """Indices of the points in some cells, from points sorted by cell."""
    first = np.searchsorted(cell_of, some, side="left")
    count = np.searchsorted(cell_of, some, side="right") - first
    ends = np.cumsum(count)
    return np.repeat(first - (ends - count), count) + np.arange(ends[-1] if len(ends) else 0)


def _stands(points: Floats, high: Mask, metre: float, ctx: Context) -> Mask:
    """True for points on firm ground; false for those on reeds and branches, which are rough.

    A point stands if it and most of its high neighbours lie on a plane, or if nothing around is
    lower than the ground may be.
    """
    stands = np.ones(len(points), bool)
    if len(points) <= NEAR:
        return stands
    tree = cKDTree(points[:, :2])
    for some in _blocks(np.flatnonzero(high), ctx):
        away, near = (np.asarray(a) for a in tree.query(points[some, :2], NEAR + 1))
        d = points[near] - points[some][:, None]
        on_land = high[near].astype(float)
        cone = np.where(_amid_water(d, 1 - on_land), *CONES)[:, None]
        lowest = (d[..., 2] >= -(ROUGH * metre + cone * away)).all(axis=1)
        off = abs(d[..., 2] - (fit_planes(d, on_land)[:, None, :] * _design(d)).sum(axis=2))
        on_plane = off <= ROUGH * metre
        most = (on_plane * on_land).sum(axis=1) >= FIRM * on_land.sum(axis=1)
        stands[some] = lowest | (on_plane[:, 0] & most)
    return stands


def _on_banks(
    points: Floats, high: Mask, stands: Mask, water: Floats, cells: CellGrid, ctx: Context
) -> Mask:
    """True for high points behind which no ground is lower, among others that stand.

    Behind what stands on the water the ground comes up from the level, lower than it. A steep or
    rough bank only rises: what is lowest there lies on it. So do a few stalks by chance, alone.

    Parameters
    ----------
    points : in the band
    high : those surely above the water
    stands : those that stand on firm ground
    water : array of shape (n, 2), positions on the water
    """
    on_bank = np.zeros(len(points), bool)
    land, some = np.flatnonzero(high), np.flatnonzero(high & ~stands)
    if not len(water) or len(land) <= ALONE[1]:
        return on_bank
    offshore = np.asarray(cKDTree(water).query(points[:, :2])[0])
    tree, reach = cKDTree(points[:, :2]), HIDDEN / np.sqrt(cells.density)
    for at in _blocks(some, ctx):
        _, near = map(np.asarray, tree.query(points[at, :2], BEHIND, distance_upper_bound=reach))
        near = np.where(near < len(points), near, at[:, None])
        behind = offshore[near] > offshore[at][:, None]
        lower = points[near, 2] < points[at, 2][:, None] - ROUGH * cells.metre
        on_bank[at] = behind.any(axis=1) & ~(behind & lower).any(axis=1)
    _, beside = map(np.asarray, cKDTree(points[land, :2]).query(points[some, :2], ALONE[1] + 1))
    on_bank[some] &= (stands | on_bank)[land][beside[:, 1:]].sum(axis=1) > ALONE[0]
    return on_bank


def _among_others(points: Floats, high: Mask, stands: Mask) -> Mask:
    """Which points that stand have others on land near by, if they are high."""
    kept, some = np.flatnonzero(stands), np.flatnonzero(stands & high)
    if len(kept) > ALONE[1]:
        _, beside = cKDTree(points[kept, :2]).query(points[some, :2], ALONE[1] + 1)
        stands = stands.copy()
        stands[some] = high[kept][beside].sum(axis=1) > ALONE[0]
    return stands


def _amid_water(d: Floats, water: Floats) -> Mask:
    """Whether the nearest water points lie on more than one side; d of shape (n, k, 3)."""
    unit = d[..., :2] / np.maximum(np.hypot(d[..., 0], d[..., 1]), 1e-9)[..., None]
    pull = np.hypot(*(unit * water[..., None]).sum(axis=1).T)
    return np.asarray(pull < AROUND * water.sum(axis=1))


def _blocks(some: Ints, ctx: Context) -> Iterator[Ints]:
    """Blocks of indices to work on one after the other."""
    for first in range(0, len(some), BLOCK):
        ctx.progress(first / len(some))
        yield some[first : first + BLOCK]


def _design(d: Floats) -> Floats:
    return np.concatenate([np.ones((*d.shape[:2], 1)), d[..., :2]], axis=2)


def fit_planes(d: Floats, weight: Floats) -> Floats:
    """Least-squares planes through many small sets of points.

    Parameters
    ----------
    d : array of shape (n, k, 3)
    weight : array of shape (n, k)

    Returns
    -------
    array of shape (n, 3)
        Height at the origin and rise along x and y; sets that span no plane get a level one.
    """
    total = np.maximum(weight.sum(axis=1), 1e-9)
    centre = (d * weight[..., None]).sum(axis=1) / total[:, None]
    e = d - centre[:, None]
    x, y, z = e[..., 0], e[..., 1], e[..., 2]
    sxx, syy, sxy, sxz, syz = (
        (weight * u * v).sum(axis=1) for u, v in ((x, x), (y, y), (x, y), (x, z), (y, z))
    )
    det = sxx * syy - sxy**2
    spans = det > 1e-3 * (sxx + syy) ** 2
    det = np.where(spans, det, 1.0)
    gx = np.where(spans, (sxz * syy - syz * sxy) / det, 0.0)
    gy = np.where(spans, (syz * sxx - sxz * sxy) / det, 0.0)
    at = centre[:, 2] - gx * centre[:, 0] - gy * centre[:, 1]
    return np.column_stack([at, gx, gy])


def _expect_ground(
    xy: Floats,
    height: Floats,
    kind: NDArray[np.uint8],
    slope: Floats,
    step: float,
    cells: CellGrid,
    ctx: Context,
) -> None:
    """Extrapolate the ground below water positions from the land near by (in place)."""
    wet = np.flatnonzero((kind != LAND) & (kind != OUTSIDE))
    count = int(np.clip(PLANE * cells.metre**2 * cells.density, *PLANE_POINTS))
    land = _high_ground(xy, height, kind, step, count // 2)
    if land.sum() < count:
        height[wet] = -step
        return
    seen, high = kind[wet] == WATER, land[wet]
    water = np.flatnonzero(seen)
    tree, most = cKDTree(xy[wet[water]]), min(2 * count, len(water))
    reach = LAND_REACH / np.sqrt(cells.density)
    for turn in range(TURNS):
        part = ctx.part(turn / TURNS, (turn + 1) / TURNS)
        bank = np.flatnonzero(land)
        beside = cKDTree(xy[bank])
        away = beside.query(xy[wet], distance_upper_bound=2 * reach)[0]
        at = np.flatnonzero(away <= reach)  # only they need a plane
        around = np.zeros((len(at), 0), np.int64)
        if most:
            around = water[np.asarray(tree.query(xy[wet[at]], range(1, most + 1))[1])]
        some = np.union1d(at, around)
        there, steep, above = np.full((3, len(wet)), np.nan)
        there[some], steep[some] = _planes(beside, height[bank], xy[wet[some]], count, part)
        above[at] = _nearer_the_plane(height[wet][around], there[around])
        near = np.zeros(len(wet), bool)
        near[at] = steep[at] > 0
        known = near & ((there < 0) | (above > np.where(high, -step / SURE, 0.0)))
        land[wet] = seen & near & (there > 0) & (above > step / SURE)  # low on the bank
    # As far below the level as the nearest land is above: with it, the shore is half way.
    deep = -np.maximum(height[bank[beside.query(xy[wet])[1]]], step)
    expected = np.where(known, there, deep)
    expected = np.where(seen, expected, np.minimum(expected, deep / 10))
    height[wet], slope[wet] = expected, np.where(known, steep, np.nan)


def _high_ground(
    xy: Floats, height: Floats, kind: NDArray[np.uint8], step: float, count: int
) -> Mask:
    """Points of which most of the nearest ones are surely above the water.

    Single points would be chosen for their errors, and a plane through these is too flat.
    """
    some = np.flatnonzero((kind == LAND) | (kind == WATER))
    land = np.zeros(len(xy), bool)
    if len(some) >= count:
        _, near = cKDTree(xy[some]).query(xy[some], range(1, count + 1))
        land[some] = np.median(height[some][near], axis=1) >= step
    return land


def _planes(
    land: cKDTree, height: Floats, at: Floats, count: int, ctx: Context
) -> tuple[Floats, Floats]:
    """Heights and slopes of planes through the `count` points of land next to each position.

    Parameters
    ----------
    land : tree of the points of land
    height : of these
    at : positions, array of shape (n, 2)
    """
    there, steep = np.empty((2, len(at)))
    for some in _blocks(np.arange(len(at)), ctx):
        far, near = (np.asarray(a) for a in land.query(at[some], count))
        away = np.asarray(land.data)[near] - at[some][:, None]
        d = np.concatenate([away, height[near][..., None]], axis=2)
        there[some], east, north = fit_planes(d, _nearer(far)).T
        steep[some] = np.hypot(east, north)
    return there, steep


def _nearer(away: Floats) -> Floats:
    """Weights by rising distances, from one to nearly none: banks are steepest at the water."""
    first, last = away[:, :1], away[:, -1:]
    return np.asarray(1.001 - ((away - first) / np.maximum(last - first, 1e-9)) ** 2)


def _nearer_the_plane(height: Floats, there: Floats) -> Floats:
    """By how much the points around a position are nearer to the plane of the land than to water.

    All of them tell together, where the plane is above the water: single points scatter, and where
    the plane comes down to the water they would tell nothing.

    Parameters
    ----------
    height, there : of the points around each position and of the plane there, of shape (n, k)

    Returns
    -------
    array of shape (n,)
        Positive for the plane; it scatters as a single point on the water does.
    """
    plane = np.maximum(there, 0.0)
    sums = (plane * (height - plane / 2)).sum(axis=1)
    return np.asarray(sums / np.maximum(np.sqrt((plane**2).sum(axis=1)), 1e-9))


def outline(where: Places, level: Level, cells: CellGrid, ctx: Context) -> Shore:
    """Shoreline rings between water and land, from the triangulation of the positions."""
    origin = np.floor(where.xy.min(axis=0))
    mesh = triangulate(where.xy - origin, ctx=ctx)
    wet = where.height < 0
    corners = mesh.triangles
    mixed = corners[(wet[corners].any(axis=1)) & (~wet[corners]).any(axis=1)].astype(np.int64)
    # A triangle has one corner on the other side: turn it to the front; it stays anticlockwise.
    alone = wet[mixed] == (wet[mixed].sum(axis=1) == 1)[:, None]
    first = np.argmax(alone, axis=1)
    a, b, c = (np.take_along_axis(mixed, (first[:, None] + k) % 3, 1)[:, 0] for k in range(3))
    one, two = np.stack([a, b], 1), np.stack([a, c], 1)
    lone = wet[a]  # with the lone corner wet, the shore runs from ab to ac with water on the left
    start = np.where(lone[:, None], one, two)
    end = np.where(lone[:, None], two, one)
    n = len(where.xy)
    keys = [np.sort(side, axis=1) @ np.array([n, 1]) for side in (start, end)]
    sides, number = np.unique(np.concatenate(keys), return_inverse=True)
    begin, then = number[: len(start)], number[len(start) :]
    follow = np.full(len(sides), -1)
    follow[begin] = then
    xy, sigma, is_open = _crossings(where, sides // n, sides % n, wet, level, cells)
    rings = _rings(follow)
    rings = [
        ring
        for ring, kept in zip(rings, _no_waves(where, [xy[r] for r in rings], level), strict=True)
        if kept
    ]
    return Shore([xy[r] for r in rings], [sigma[r] for r in rings], [is_open[r] for r in rings])


def _no_waves(where: Places, rings: list[Floats], level: Level) -> Mask:
    """True for outer rings, and for islands higher than waves, or with other water in them."""
    kept = np.array([area_of(ring) >= 0 for ring in rings], bool)
    islands, land = np.flatnonzero(~kept), np.flatnonzero(where.kind == LAND)
    shapes = np.array([shapely.Polygon(rings[k]) for k in islands], object)
    tree = shapely.STRtree(np.asarray(shapely.points(where.xy[land])))
    of, point = tree.query(shapes, "contains")
    top = np.full(len(islands), -np.inf)
    reach = np.where(where.other, np.inf, where.height)
    np.maximum.at(top, of, reach[land[point]])
    kept[islands] = top > ISLAND * level.sigma
    return kept


def _crossings(
    where: Places, i: Ints, j: Ints, wet: Mask, level: Level, cells: CellGrid
) -> tuple[Floats, Floats, Mask]:
    """Shoreline points on sides of triangles, their standard deviations, and where the data end."""
    water, land = np.where(wet[i], i, j), np.where(wet[i], j, i)
    length = np.hypot(*(where.xy[land] - where.xy[water]).T)
    share = where.height[land] / (where.height[land] - where.height[water])
    spacing = 1 / np.sqrt(cells.density)
    is_open = where.kind[land] == OUTSIDE
    guess = np.isnan(where.slope[water]) & (where.kind[water] == HOLE)
    share[guess] = np.minimum(0.5, 0.5 * spacing / length[guess])
    seen = where.kind[water] == WATER  # plants may hide a shore, but not for ever
    share[seen] = np.maximum(share[seen], 1 - HIDDEN * spacing / length[seen])
    share[is_open] = np.maximum(0.5, 1 - 0.5 * cells.lattice.cell / length[is_open])
    xy = where.xy[land] + share[:, None] * (where.xy[water] - where.xy[land])
    length[is_open] = np.minimum(length[is_open], cells.lattice.cell)
    slope = np.nan_to_num(where.slope[water])
    error = np.hypot(level.sigma, level.error)
    # On a flat bank the points that may be water or land reach farther than to the next one.
    reach = np.minimum(
        sure_step(level, cells.metre) / np.maximum(slope, 1e-9), LAND_REACH * spacing
    )
    span = np.where(slope > 0, np.maximum(length, reach), length)
    sigma = np.hypot(FINEST * spacing, 1 / np.sqrt(12 / span**2 + (slope / error) ** 2))
    return xy, sigma, is_open


def _rings(follow: Ints) -> list[Ints]:
    """Closed rings of sides, from the side that follows each."""
    rings, left = [], follow.copy()
    for start in range(len(left)):
        ring, at = [], start
        while left[at] >= 0:
            ring.append(at)
            left[at], at = -1, left[at]
        if len(ring) > 2 and at == start:
            rings.append(np.array(ring))
    return rings


def area_of(ring: Floats) -> float:
    """Signed area of a ring, positive if it runs anticlockwise."""
    x, y = (ring - ring[0]).T
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2
