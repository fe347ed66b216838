"""Ground filter by progressive densification of a triangulation.

A sparse surface through the lowest points of large cells grows round by round: points that are
near enough to its facets, by distance and by angle, become vertices. Points near the finished
surface are ground.

References
----------
Axelsson, P. (2000). DEM generation from laser scanner data using adaptive TIN models.
International Archives of Photogrammetry and Remote Sensing 33(B4/1), 110-117.

Where we depart from the paper, why, and what that gained: docs/explanation/tin-densification.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.ground import _ptd_kernels as kernels
from algorithms.shared import parameters
from algorithms.shared.delaunay import LiveMesh
from algorithms.shared.ground import NOWHERE, Candidates, Returns
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import (
    blocks,
    cells_of,
    lattice_around,
    lowest_points,
    require_finite,
    without_low_outliers,
)
from algorithms.shared.plausible import tell_of_ground
from algorithms.shared.strips import strips_of
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Raster
from toolbox.data.crs import vertical_unit
from toolbox.declare import ClassList, outputs, param, sink, source, tool
from toolbox.errors import DataError

CELL = 1.0  # metres: of each cell the lowest point may become a vertex
FINEST = 5.0  # metres: seed grids are halved until they are at most this wide
BREAK_RISE = 0.2  # facets at least this steep are looked at as breaks
GENTLE = 1.2  # rise of terrain that a surface goes on with beyond a break or the data; not walls
COARSE_ANGLE = 2.0  # times the angle on seed grids, whose points are low
WALL_MEAN = 0.8  # rise per length of all walls of a patch
WALL_STEP, WALL_RISE, WALL_SHARE = 1.0, 0.3, 0.8  # metres, rise per length, share going down
PATCH = 5 / 3  # widest patch that is taken for a building, in building sizes
RING = 10.0  # metres between the vertices around the data
SLOPE_STEP = 0.5  # metres of tolerance per rise of the facet
SIDE = 32  # cells
BLOCK = 200_000  # points that are between two checks for cancellation
HALO = 2.25  # metres of data that a tile needs around it, in building sizes

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Thresholds = Literal["facets", "median"]


@tool(
    "ground.ptd",
    title="Classify ground (TIN, PTD)",
    tags=(
        "ground",
        "filter",
        "dtm",
        "dem",
        "bare",
        "earth",
        "tin",
        "densification",
        "axelsson",
        "ptd",
        "smrf-like",
    ),
)
class GroundPtd:
    """Classify ground by growing a triangulated surface from the lowest points upwards.

    Ground becomes class 2, all else class 1. The defaults fit towns and forests alike. Set
    `max_building_size` a little above the widest building. Lower `iteration_angle` on flat ground
    with low plants, raise it in rough terrain.

    Points of water, rail and road (9 to 11) count like all others and keep their class; wires,
    towers, bridges and other structures (13 to 17, 19) keep theirs and take no part. Without
    `keep_classes` they become 2 or 1, too. Class 2 is decided anew, also if it is named there.
    """

    points: PointCloud = source("Points to classify")
    max_building_size: float = param(
        "Cell of the first seeds: wider than any building",
        default=60.0,
        unit="m",
        ge=10,
        label="Widest building",
    )
    terrain_angle: float = param(
        "Steepest rise of the terrain",
        default=88.0,
        unit="deg",
        gt=0,
        lt=90,
        label="Steepest terrain",
    )
    iteration_angle: float = param(
        "Greatest angle of a new point, seen from the corners of its facet",
        default=10.0,
        unit="deg",
        gt=0,
        lt=90,
        label="Angle at the facet",
    )
    iteration_distance: float = param(
        "Greatest distance of a new point from its facet",
        default=1.5,
        unit="m",
        gt=0,
        label="Distance from the facet",
    )
    thresholds: Thresholds = param(
        "What lowers these limits: small facets, or medians of points above the surface, by rounds",
        default="facets",
        label="What lowers the limits",
        words={"facets": "Small facets", "median": "Medians, round by round"},
    )
    reduce_angle_below: float = param(
        "Facets with shorter edges lower the angle in proportion; 0 for never",
        default=5.0,
        unit="m",
        ge=0,
        label="Edges that lower the angle",
    )
    stop_edge: float = param(
        "Facets whose edges are all shorter take no more points",
        default=2.0,
        unit="m",
        ge=0,
        label="Shortest edge",
    )
    mirror: bool = param(
        "Mirror points at breaks, so that edges of terraces enter",
        default=True,
        label="Mirror points at breaks",
    )
    class_distance: float = param(
        "Greatest height of a ground point above or below the surface",
        default=0.4,
        unit="m",
        gt=0,
        label="Distance of ground from the surface",
    )
    cell: float = parameters.cell()
    returns: Returns = parameters.ground_returns()
    ignore: ClassList | None = parameters.ignore()
    keep_classes: ClassList | None = parameters.keep_classes()

    @outputs
    class Outputs:
        classified: PointCloud = parameters.labelled_points()
        ground: PointCloud = parameters.ground_points()
        surface: Raster = sink("Elevation of the triangulated surface at the cell centres")
        ground_share: float = parameters.ground_share()

    def halo(self) -> float:
        """Reach of the seeds and of the test for raised patches: about two building sizes.

        Medians look everywhere.
        """
        return math.inf if self.thresholds == "median" else HALO * self.max_building_size

    def run(self, ctx: Context = QUIET) -> GroundPtd.Outputs:
        """Grow the surface, and compare the points with it."""
        cloud = self.points
        candidates = Candidates.of(cloud, self.returns, self.ignore, self.keep_classes)
        if not candidates.chosen.any():
            none = candidates.classified(NOWHERE)
            raise candidates.nothing_to_do(none, surface=None)
        xyz = candidates.xyz
        require_finite(xyz)
        ctx.progress(0.0)
        lattice_around(xyz, self.cell, bytes_per_cell=4, parameter="cell")  # refuses stray points
        lattice = Lattice.cover(box_of(xyz), self.cell)
        surface = densified(
            xyz,
            max_building_size=self.max_building_size,
            terrain_angle=self.terrain_angle,
            iteration_angle=self.iteration_angle,
            iteration_distance=self.iteration_distance,
            thresholds=self.thresholds,
            reduce_angle_below=self.reduce_angle_below,
            stop_edge=self.stop_edge,
            mirror=self.mirror,
            metre=cloud.metre,
            ctx=ctx.part(0, 0.9),
        )
        log.info("the surface has %d vertices after %d rounds", surface.vertices, surface.rounds)
        ground = ground_mask(
            xyz,
            surface,
            class_distance=self.class_distance,
            metre=cloud.metre,
            ctx=ctx.part(0.9, 0.95),
        )
        heights = heights_on(surface, lattice, ctx=ctx.part(0.95, 1))
        tell_of_ground(xyz, ground, strips_of(cloud, candidates.chosen), cloud.metre)
        classified = candidates.classified(ground)
        return self.Outputs(
            classified=classified,
            surface=Raster.from_lattice(
                heights,
                lattice,
                crs=cloud.crs,
                descriptions=("surface",),
                units=(vertical_unit(cloud.crs),),
            ),
            ground=candidates.ground(classified, ground),
            ground_share=candidates.share(ground, classified),
        )


@dataclass(frozen=True)
class GroundMesh:
    """The finished triangulation of the ground.

    Attributes
    ----------
    mesh : the triangulation; some of its points never became vertices
    z : array of shape (n,), heights of the points of the mesh
    facet : array of shape (n,), where to begin to look for the triangle at each point
    lowest : array of shape (rows, cols), the point of each cell of the lattice; -1 for none
    lattice : cells of the points
    vertices : how many points became vertices
    rounds : how many rounds there were
    """

    mesh: LiveMesh
    z: Floats
    facet: Ints
    lowest: Ints
    lattice: Lattice
    vertices: int
    rounds: int


def ground_mask(
    xyz: Floats,
    surface: GroundMesh,
    *,
    class_distance: float = 0.4,
    metre: float = 1.0,
    ctx: Context = QUIET,
) -> Mask:
    """True for points near the surface.

    The vertical distance may be `class_distance`, and more where the facet is steep, since its
    corners are the lowest points of their cells.

    Parameters
    ----------
    xyz : array of shape (n, 3), the points that the surface was made from
    surface : made by :func:`densified`
    class_distance : in the unit of the points
    metre : length of one metre in the unit of the points
    ctx : progress and cancellation

    Returns
    -------
    array of shape (n,)
    """
    near = np.zeros(len(xyz), bool)

    def compare(first: int, last: int) -> None:
        kernels.near_surface(
            xyz,
            first,
            cells_of(xyz[first:last], surface.lattice),
            surface.lowest.ravel(),
            surface.facet,
            surface.mesh.arrays,
            surface.z,
            class_distance,
            SLOPE_STEP * metre,
            near,
        )

    side_by_side(compare, blocks(len(xyz), 10), ctx=ctx)
    return near


def heights_on(
    surface: GroundMesh, lattice: Lattice, *, ctx: Context = QUIET
) -> NDArray[np.float32]:
    """Heights of the surface at the centres of cells.

    Returns
    -------
    array of shape (rows, cols)
        NaN beyond the surface, which ends some 10 to 20 m outside the points.
    """
    heights = np.full(lattice.shape, np.nan, np.float32)
    x, y = lattice.centres()
    step = max(1, BLOCK // lattice.cols)
    for first in range(0, lattice.rows, step):
        across, down = np.meshgrid(x, y[first : first + step])
        places = np.column_stack([across.ravel(), down.ravel()])
        facets = surface.mesh.locate(places)
        inside = facets >= 0
        corners = surface.mesh.triangles[facets[inside]]
        found = plane_at(surface.mesh.arrays.xy[corners], surface.z[corners], places[inside])
        heights[first : first + step].reshape(-1)[inside] = found
        ctx.progress(min(1.0, (first + step) / lattice.rows))
    return heights


def densified(
    xyz: Floats,
    *,
    max_building_size: float = 60.0,
    terrain_angle: float = 88.0,
    iteration_angle: float = 10.0,
    iteration_distance: float = 1.5,
    thresholds: Thresholds = "facets",
    reduce_angle_below: float = 5.0,
    stop_edge: float = 2.0,
    mirror: bool = True,
    metre: float = 1.0,
    ctx: Context = QUIET,
) -> GroundMesh:
    """The triangulated surface of the ground, grown from the lowest points of large cells.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    max_building_size : cell of the first seeds, in the unit of the points like all lengths
    terrain_angle : steepest rise from a corner of the facet to a new point, degrees
    iteration_angle : greatest angle between the facet and the line to a corner, degrees
    iteration_distance : greatest distance from the plane of the facet
    thresholds : "facets" lowers the angle by `reduce_angle_below`; "median" lowers angle and
        distance by :meth:`Growth.lowered` instead
    reduce_angle_below : shorter facets lower the angle in proportion; 0 for never
    stop_edge : facets whose edges are all shorter take no more points
    mirror : test points at breaks on the other side of the break, too
    metre : length of one metre in the unit of the points
    ctx : progress and cancellation

    Raises
    ------
    ValueError
        A coordinate is not a finite number.
    DataError
        There are no points, or their bounding box is too large.
    """
    if not len(xyz):
        raise DataError("points: there are none to make a surface of")
    require_finite(xyz)
    lattice = lattice_around(xyz, CELL * metre, bytes_per_cell=8)
    ctx.progress(0.0)
    use = without_low_outliers(xyz, CELL * metre, metre, ctx.part(0, 0.3))
    lowest = lowest_points(xyz, use, lattice, ctx.part(0.3, 0.35))
    cells = by_blocks(lowest)
    points = xyz[lowest[cells]]
    lowest[cells] = np.arange(len(points))
    ctx.progress(0.35)
    fine = kernels.PointLimits(
        angle=iteration_angle,
        distance=iteration_distance,
        steepest=math.tan(math.radians(terrain_angle)),
        stop=stop_edge,
        reduce=reduce_angle_below if thresholds == "facets" else 0.0,
        mirror=mirror,
        gentle=GENTLE,
    )
    growth = Growth(points, metre, thresholds)
    ctx.progress(0.35)
    growth.start(np.flatnonzero(lowest_of_cells(points, max_building_size)), ctx.part(0.35, 0.36))
    done = 0.36
    size = max_building_size
    while size > FINEST * metre:
        size /= 2
        coarse = fine._replace(angle=min(COARSE_ANGLE * iteration_angle, 89.0), mirror=False)
        ids = np.flatnonzero(lowest_of_cells(points, size))
        growth.grow(ids, coarse, ctx.part(done, done + 0.03))
        done += 0.03 if done < 0.5 else 0.0
    growth.grow(np.arange(len(points)), fine, ctx.part(done, 0.85))
    done = 0.85
    while True:
        part = ctx.part(done, (1 + done) / 2)  # the number of rounds is not known
        raised = growth.raised(PATCH * max_building_size, part.part(0, 0.5))
        log.debug("%d vertices are on raised patches", np.count_nonzero(raised))
        if not raised.any():
            break
        growth.settle(growth.take_out(raised), fine, part.part(0.5, 1))
        done = (1 + done) / 2
    ctx.progress(1.0)
    return growth.surface(lowest, lattice)


def by_blocks(lowest: Ints) -> tuple[Ints, Ints]:
    """Rows and columns of the cells with a point, block by block of SIDE x SIDE cells.

    What is near on the ground is then near in memory, however wide the data are.
    """
    row, col = np.nonzero(lowest >= 0)
    order = np.argsort((row // SIDE) * (lowest.shape[1] // SIDE + 1) + col // SIDE, kind="stable")
    return row[order], col[order]


def lowest_of_cells(points: Floats, cell: float) -> Mask:
    """True for the lowest point of each cell of a lattice in whole multiples of `cell`."""
    lattice = lattice_around(points, cell)
    found = lowest_points(points, np.ones(len(points), bool), lattice, QUIET)
    low = np.zeros(len(points), bool)
    low[found[found >= 0]] = True
    return low


def box_of(points: Floats) -> tuple[float, float, float, float]:
    """West, south, east and north end of the points."""
    x, y = points[:, 0], points[:, 1]  # much faster than along the points
    return x.min(), y.min(), x.max(), y.max()


def ring_around(points: Floats, step: float) -> Floats:
    """Vertices of a ring outside the points, at multiples of `step`, array of shape (m, 2)."""
    box = np.array(box_of(points)) / step
    west, south = np.floor(box[:2]) - 1
    east, north = np.floor(box[2:]) + 2
    columns, rows = np.arange(west, east + 1), np.arange(south + 1, north)
    sides = [(columns, south), (columns, north), (west, rows), (east, rows)]
    places = [np.column_stack(np.broadcast_arrays(x, y)) for x, y in sides]
    return np.concatenate(places) * step


def plane_at(xy: Floats, z: Floats, places: Floats) -> Floats:
    """Heights at positions (m, 2) of the planes through corners (m, 3, 2) with heights (m, 3)."""
    (ux, uy), (vx, vy) = (xy[:, 1] - xy[:, 0]).T, (xy[:, 2] - xy[:, 0]).T
    x, y = (places - xy[:, 0]).T
    area = ux * vy - uy * vx
    second, third = (x * vy - y * vx) / area, (ux * y - uy * x) / area
    height: Floats = z[:, 0] + second * (z[:, 1] - z[:, 0]) + third * (z[:, 2] - z[:, 0])
    return height


class Growth:
    """The surface while it grows, with the points that wait to enter it.

    A ring of vertices around the points saves the rim from special rules. Their heights go on
    with the surface, set anew whenever it has come to rest.

    Each point that is no vertex is on the list of its facet, `head` and `following`, so that
    only points whose facets have changed are looked at again. What is taken out is on no list.
    """

    def __init__(self, points: Floats, metre: float, thresholds: Thresholds = "facets") -> None:
        self.real = len(points)
        self.metre = metre
        self.thresholds = thresholds
        self.xy = np.vstack([points[:, :2], ring_around(points, RING * metre)])
        self.z = np.append(points[:, 2], np.zeros(len(self.xy) - self.real))
        west, south, east, north = box_of(self.xy)
        x, y = points[:, 0], points[:, 1]
        self.inwards = np.minimum(np.minimum(x - west, east - x), np.minimum(y - south, north - y))
        self.mesh = LiveMesh(self.xy)
        self.entered = np.zeros(len(self.xy), bool)
        self.entered[self.real :] = True
        capacity = 2 * len(self.xy) + 2
        self.facet = np.full(len(self.xy), -1)
        self.head, self.following = np.full(capacity, -1), np.empty(self.real, np.int64)
        self.waiting = np.empty(self.real, np.int64)
        self.best, self.lowest = np.full(capacity, -1), np.empty(capacity)
        self.chosen = np.empty(capacity, np.int64)
        self.rounds = 0

    def start(self, seeds: Ints, ctx: Context) -> None:
        """Triangulate the given points and the ring."""
        self.entered[seeds] = True
        self.mesh.insert(np.flatnonzero(self.entered), ctx=ctx)
        self.lift_ring()

    def lift_ring(self) -> Ints:
        """Set the heights of the ring: the surface continued, or those of nearest vertices.

        The surface is mirrored at the nearest vertex, in plan and height. Returns the points
        whose facets have moved with the ring.
        """
        nearest = self.nearest_to_ring()
        base = self.z[nearest]
        mesh = self.mesh.arrays
        places = 2 * self.xy[nearest] - self.xy[self.real :]
        facets = self.mesh.locate(places)
        corners = mesh.triangles[facets]
        inside = (facets >= 0) & (corners < self.real).all(axis=1)
        corners = corners[inside]
        height = plane_at(self.xy[corners], self.z[corners], places[inside])
        away = np.hypot(*(places[inside] - self.xy[nearest[inside]]).T)
        rise = base[inside] - height
        rise[np.abs(rise) > GENTLE * away] = 0.0
        self.z[self.real :] = base
        self.z[self.real + np.flatnonzero(inside)] += rise
        count = kernels.points_at_rim(mesh, self.real, self.head, self.following, self.waiting)
        return self.waiting[:count]

    def nearest_to_ring(self) -> Ints:
        """Index of the vertex nearest to each vertex of the ring."""
        ring, vertices = self.xy[self.real :], self.entered[: self.real]
        reach = 4 * RING * self.metre
        while True:  # what is farther inwards than the nearest one found cannot be nearer
            some = np.flatnonzero(vertices & (self.inwards <= reach))
            if len(some):
                tree = cKDTree(self.xy[some], balanced_tree=False, compact_nodes=False)
                distance, nearest = tree.query(ring)
                if np.max(distance) <= reach or reach > self.inwards.max():
                    found: Ints = some[nearest]
                    return found
            reach *= 2

    def grow(self, points: Ints, limits: kernels.PointLimits, ctx: Context) -> None:
        """Let points enter that were not tested so far, or were tested with other limits."""
        self.head[:] = -1
        self.settle(points, limits, ctx)

    def settle(self, waiting: Ints, limits: kernels.PointLimits, ctx: Context) -> None:
        """Let points enter in rounds until no further one may."""
        again, done, now = False, 0.0, limits
        while True:
            half = ctx.part(done, (1 + done) / 2)  # the number of rounds is not known
            if self.thresholds == "median":
                waiting = self.all_waiting(waiting)
                now = self.lowered(limits, waiting, half.part(0, 0.3))
            chosen = self.look(waiting, now, half.part(0.3, 0.7))
            if len(chosen):
                waiting, again = self.enter(chosen, half.part(0.7, 1)), False
            elif again:
                return
            else:
                waiting, again = self.lift_ring(), True
            done = (1 + done) / 2

    def all_waiting(self, waiting: Ints) -> Ints:
        """The given points and all on lists, to be tested again after limits have changed."""
        waiting = waiting[~self.entered[waiting]]  # a copy: it may have been a view of the next
        facets = np.arange(self.mesh.arrays.size[0])
        count = kernels.points_of(facets, self.head, self.following, self.waiting)
        return np.concatenate([waiting, self.waiting[:count]])

    def lowered(
        self, limits: kernels.PointLimits, points: Ints, ctx: Context
    ) -> kernels.PointLimits:
        """Limits lowered to the median angle and distance of the points above the surface."""
        seen = np.empty((2, len(points)))
        for first in range(0, len(points), BLOCK):
            some = slice(first, first + BLOCK)
            kernels.against_facets(
                self.mesh.arrays, self.z, points[some], self.facet, seen[:, some]
            )
            ctx.progress(min(1.0, (first + BLOCK) / len(points)))
        seen = seen[:, seen[1] >= 0]  # what is below enters in any case
        if not seen.size:
            return limits
        angle, distance = np.median(seen, axis=1).tolist()
        return limits._replace(
            angle=min(limits.angle, angle), distance=min(limits.distance, distance)
        )

    def look(self, points: Ints, limits: kernels.PointLimits, ctx: Context) -> Ints:
        """The facets that a point may enter; `best` has the lowest such point of each."""
        count = 0
        for first in range(0, len(points), BLOCK):
            count = kernels.best_of_facets(
                self.mesh.arrays,
                self.z,
                points[first : first + BLOCK],
                self.entered,
                limits,
                BREAK_RISE,
                self.facet,
                self.head,
                self.following,
                self.best,
                self.lowest,
                self.chosen,
                count,
            )
            ctx.progress(min(1.0, (first + BLOCK) / len(points)))
        return self.chosen[:count]

    def enter(self, facets: Ints, ctx: Context) -> Ints:
        """Insert the points found for facets; the points whose facets have changed."""
        points = self.best[facets]
        self.best[facets] = -1
        self.entered[points] = True
        changed = self.mesh.insert(points, ctx=ctx)
        self.rounds += 1
        count = kernels.points_of(changed, self.head, self.following, self.waiting)
        return self.waiting[:count]

    def raised(self, extent: float, ctx: Context) -> Mask:
        """True for vertices on patches narrower than `extent` that drop on all sides: roofs.

        Patches are what is left of the surface when it is cut at its walls. Nearly all walls
        around go down; what goes on beyond the data is at most a third of the outline. The walls
        must be steep in the mean, or the tops of steep hills would be patches.
        """
        patch, boxes, edges = self.patches(ctx)
        rim = edges[:, 1] >= self.real
        cut = np.bincount(patch[edges[rim, 0]], minlength=self.real)
        low, high = edges[~rim].T
        around = patch[low] != patch[high]
        low, high = low[around], high[around]
        below, above = patch[low], patch[high]
        down = np.bincount(above, minlength=self.real)
        walls = down + np.bincount(below, minlength=self.real)
        drop = np.bincount(above, self.z[high] - self.z[low], self.real)
        length = np.bincount(above, np.hypot(*(self.xy[high] - self.xy[low]).T), self.real)
        narrow = (-boxes[:, 2:] - boxes[:, :2]).max(axis=1) < extent
        drops = (down > 2 * cut) & (down >= WALL_SHARE * walls) & (drop > WALL_MEAN * length)
        found: Mask = (narrow & drops)[patch] & self.entered[: self.real]
        return found

    def patches(self, ctx: Context) -> tuple[Ints, Floats, Ints]:
        """Patches of the surface, cut at its walls.

        Returns the patch of each point, named by one of its vertices; the box of each patch
        (west, south, -east, -north); and edges: walls from foot to top, and edges to the ring.
        """
        mesh, wall = self.mesh.arrays, (WALL_STEP * self.metre, WALL_RISE)
        patch, boxes = np.arange(self.real), np.full((self.real, 4), np.inf)
        edges, count = np.empty((3 * len(self.xy), 2), np.int64), 0  # that many can there be
        size = int(mesh.size[0])
        for first, last in blocks(size, 10):
            count = kernels.join_patches(
                mesh, self.z, self.real, *wall, first, last, patch, edges, count
            )
            ctx.progress(0.7 * last / size)
        for first, last in blocks(self.real, 10):
            kernels.patches_of(mesh, first, last, patch, boxes)
            ctx.progress(0.7 + 0.3 * last / self.real)
        return patch, boxes, edges[:count]

    def take_out(self, gone: Mask) -> Ints:
        """Remove vertices for good; the points whose facets have changed."""
        gone = np.append(gone, np.zeros(len(self.xy) - self.real, bool))
        self.entered[gone] = False
        count = kernels.take_out(
            self.mesh.arrays, gone, self.facet, self.head, self.following, self.waiting
        )
        changed = self.waiting[:count].copy()
        return np.concatenate([changed, self.lift_ring()])

    def surface(self, lowest: Ints, lattice: Lattice) -> GroundMesh:
        """The present surface."""
        vertices = int(np.count_nonzero(self.entered[: self.real]))
        return GroundMesh(self.mesh, self.z, self.facet, lowest, lattice, vertices, self.rounds)
