"""Power lines in a raw cloud: points of wires and towers, and the wires as curves.

A wire is what stands alone in the air and hangs in an arc. Straight pieces of such points are
followed along parabolas, across gaps. All wires of a line are cut into arcs at the same places,
where its supports are; between two supports each conductor is a catenary, and what lies on it is
wire. What stands under and around the ends of the wires is tower.

How it works, what it reaches and where it fails: docs/explanation/power-lines.md.

References
----------
Jwa, Y. and Sohn, G. (2012). A piecewise catenary curve model growing for 3D power line
reconstruction. PE&RS 78(11), 1227-1240: wires grow from straight pieces, curve by curve.
Chan, T. O. and Lichti, D. D. (2011). 3D catenary curve fitting for geometric calibration. ISPRS
Archives XXXVIII-5/W12, 259-264: the catenary in the vertical plane of a wire.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.corridor._curves.network import Scene
from algorithms.corridor._curves.trace import Airborne, uncrowded
from algorithms.corridor._extraction.candidates import (
    OFF_GROUND,
    STANDS_FOR,
    candidates,
    given_heights,
)
from algorithms.corridor._extraction.follow import follow
from algorithms.corridor._extraction.labels import NUMBERS, classes_of, labelled
from algorithms.corridor._extraction.layers import tower_layer, wire_layer
from algorithms.corridor._extraction.spans import Wire, to_supports
from algorithms.corridor._extraction.supports import Support
from algorithms.corridor._extraction.towers import Tower, centred, strings_of, tower_of
from algorithms.corridor._extraction.voxels import Settings, Variance, voxel_lines
from algorithms.ground.classify import HEIGHT, find_terrain, height_above
from algorithms.shared import parameters
from algorithms.shared.ground import may_be_ground, taking_part
from algorithms.shared.lowest import lattice_around
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Vector
from toolbox.declare import ClassList, outputs, param, sink, source, tool
from toolbox.errors import DataError

COMPANY, ALMOST_ALL = (2.0, 2.0, 1.0), 0.9  # metres, and share of the points with others so near
SEEN_CELL, SHIFTS = 2.0, (0.0, 1.0)  # metres, in whole cells of candidates
AROUND = 8  # points of the ground through which the plane under a support is laid
STEPS = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]  # to the cells around one
BESIDE, AREA = 6, 0.35  # neighbours of a cell within an area, and the share of such cells
FEWEST_CELLS, FEWEST_OF_CELL = 50, 1.5  # of which, and how many points in each, an area is judged
TUBE, TUBE_LEAST, TUBE_MOST = 2.6, 0.12, 0.45  # of the scatter of a wire; metres

Method = Literal["catenary", "thesis"]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@tool("corridor.extract")
class CorridorExtract:
    """Find the wires and towers of power lines in a raw point cloud.

    Conductors become class 14, towers and poles with their insulators class 15; points that had a
    class of a line (13 to 16) and are not found become 1, all others keep their class. The
    attributes wire_id, span_id and tower_id say to which they belong, 0 for none; a wire keeps its
    number from span to span. Nothing but coordinates is needed, and lines of any voltage are found
    together: the ground is found first, or taken from the classes given. Of points that have
    HeightAboveGround that is the height, unless classes are given.

    `wires` has one catenary per conductor and span, as a line in three dimensions; `towers` one
    point per tower, at its foot. A span needs the whole of its wires, so the tool looks at the
    whole cloud; corridor.candidates chooses the points that it needs of a large one.

    Method `thesis` follows a published chain of voxels, to compare with. Its pylons hold all points
    in their bounds, and it finds no wires below `thesis_height`.
    """

    points: PointCloud = source("Points of a corridor, with the ground below the line")
    ground_classes: ClassList | None = param(
        "Classes that are ground; without them the ground is found", default=None
    )
    min_height: float = param(
        "Lowest conductor above the ground", default=4.0, unit="m", ge=1.0, le=50.0
    )
    max_gap: float = param(
        "Longest piece of a wire that may be missing", default=60.0, unit="m", ge=0.0, le=500.0
    )
    tolerance: float = param(
        "Farthest that a point may lie from the wire that is followed",
        default=0.25,
        unit="m",
        ge=0.05,
        le=2.0,
    )
    method: Method = param(
        "How to find wires: catenary, or voxels as in the thesis of Muş (2019)", default="catenary"
    )
    thesis_height: float = param(
        "Method thesis: keep points this far above the ground", default=20.0, unit="m", ge=1.0
    )
    thesis_voxel: float = param("Method thesis: size of the voxels", default=3.0, unit="m", ge=0.5)
    thesis_variance: Variance = param(
        "Method thesis: variance of height of voxels to keep; high as printed, low works",
        default="low",
    )
    thesis_gap: float = param(
        "Method thesis: farthest voxel that may go on a line", default=20.0, unit="m", gt=0
    )
    seed: int = parameters.seed()
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        classified: PointCloud = sink("The same points with classes 14 and 15 and their numbers")
        towers: Vector = sink("Feet of towers and poles, with height, arms and width")
        wires: Vector = sink("One catenary per conductor and span, with its covariance")
        span_count: int = sink("Spans found", unit="1")
        tower_count: int = sink("Towers and poles found", unit="1")

    def halo(self) -> float:
        """A span is one whatever its length, and so is the line that it is part of."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> CorridorExtract.Outputs:
        """Find the line, and label the points on it."""
        cloud, part = self.points, taking_part(self.points, self.ignore)
        height = self._heights(part, ctx.part(0.0, 0.4))
        index, stands_for = self._candidates(part, height)
        line = find_line(
            cloud.xyz[index],
            height[index],
            stands_for,
            metre=cloud.metre,
            min_height=self.min_height / cloud.metre,
            max_gap=self.max_gap / cloud.metre,
            tolerance=self.tolerance / cloud.metre,
            thesis=self._thesis() if self.method == "thesis" else None,
            ctx=ctx.part(0.4, 1.0),
        )
        if not line.wires:
            unknown = len(height) > 0 and np.isnan(height).all()
            why = ": no height above the ground is known" if unknown else ""
            log.warning("no power line was found%s", why)
        return self.Outputs(
            classified=labelled(cloud, part, index, line.labels),
            towers=tower_layer(line.towers, line.strings, line.origin, cloud.metre, cloud.crs),
            wires=wire_layer(line.wires, line.origin, cloud.metre, cloud.crs),
            span_count=len({wire.span for wire in line.wires}),
            tower_count=len(line.towers),
        )

    def _heights(self, part: NDArray[np.bool_], ctx: Context) -> Floats:
        """Metres of points above the ground, array of shape (n,); NaN where not known."""
        cloud = self.points
        if HEIGHT in cloud and self.ground_classes is None:
            return given_heights(cloud)
        ground = part & may_be_ground(cloud, "last")
        if self.ground_classes is not None:
            ground = part & np.isin(classes_of(cloud), self.ground_classes)
            if part.any() and not ground.any():
                raise DataError(f"points: none is of the ground_classes {self.ground_classes}")
        if not ground.any():
            return np.full(len(cloud), np.nan)
        ground &= accompanied(cloud.xyz, cloud.metre)
        known = self.ground_classes is not None
        terrain = find_terrain(_frozen(cloud.xyz[ground]), known=known, metre=cloud.metre, ctx=ctx)
        return height_above(cloud.xyz, terrain)

    def _candidates(
        self, part: NDArray[np.bool_], height: Floats
    ) -> tuple[Ints, NDArray[np.uint32]]:
        """The points to look at, and how many each stands for."""
        cloud = self.points
        if STANDS_FOR not in cloud:
            return candidates(cloud.xyz, height, part, metre=cloud.metre)
        index = np.flatnonzero(part)
        return index, cloud[STANDS_FOR][index]

    def _thesis(self) -> Settings:
        metre = self.points.metre
        return Settings(
            self.thesis_height / metre, self.thesis_voxel / metre, self.thesis_variance,
            self.thesis_gap / metre, self.seed,
        )  # fmt: skip


@dataclass(frozen=True)
class Line:
    """The power lines among n points, and which of these are theirs.

    Attributes
    ----------
    wires, towers : in metres from the origin
    strings : length of the insulators by which wires pull at each tower, metres
    origin : array of shape (3,), in the unit of the cloud
    labels : of the points: wire_id, span_id and tower_id from 1, 0 for none, and confidence
    """

    origin: Floats
    labels: Mapping[str, NDArray[Any]]
    wires: Sequence[Wire] = ()
    towers: Sequence[Tower] = ()
    strings: Sequence[float] = ()

    @classmethod
    def none(cls, count: int, origin: Floats) -> Line:
        """No line among some points."""
        labels: dict[str, NDArray[Any]] = {name: np.zeros(count, np.uint32) for name in NUMBERS}
        return cls(origin, labels | {"confidence": np.ones(count, np.float32)})


def find_line(
    xyz: Floats,
    height: Floats,
    stands_for: NDArray[np.uint32],
    *,
    metre: float = 1.0,
    min_height: float = 4.0,
    max_gap: float = 60.0,
    tolerance: float = 0.25,
    thesis: Settings | None = None,
    ctx: Context = QUIET,
) -> Line:
    """Wires and towers among points.

    Parameters
    ----------
    xyz : array of shape (n, 3), as :func:`candidates` chooses them
    height : array of shape (n,), above the ground, metres; NaN where not known
    stands_for : array of shape (n,), how many points each is of
    metre : length of one metre in the unit of the points
    thesis : settings of that method; None for the other
    min_height, max_gap, tolerance : see :class:`CorridorExtract`, metres
    ctx : progress and cancellation

    Returns
    -------
    Line

    Raises
    ------
    DataError
        The points lie along lines, without ground, or one is too far from the others.
    """
    ctx.progress(0.0)
    if not len(xyz):
        return Line.none(0, np.zeros(3))
    lattice_around(xyz, SEEN_CELL * metre)  # which says so if a stray point is too far away
    origin = np.floor(xyz.min(axis=0) / (SEEN_CELL * metre)) * SEEN_CELL * metre
    line = Line.none(len(xyz), origin)
    places = (xyz - origin) / metre
    seen, density = footprint(places[:, :2], stands_for)
    if not np.isfinite(height).any():
        return line
    index = np.flatnonzero(height > OFF_GROUND)
    air = Airborne.of(places[index])
    own = index[air.order]
    if thesis is not None:
        return by_thesis(line, own, air, height[own], thesis, tolerance, max_gap, ctx)
    may = height[own] > min_height
    alone, voxel = uncrowded(air.select(may), density)
    may[may] = alone
    ctx.progress(0.1)
    ground = elevation(places, height)
    scene = Scene(air, height[own], may, tolerance, ground, seen)
    wires, supports = follow(scene, voxel[alone], max_gap, ctx.part(0.1, 0.9))
    if not wires:
        return line
    wires, towers, strings = dressed(scene, wires, supports)
    label_points(line, scene, own, wires, towers)
    ctx.progress(1.0)
    return replace(line, wires=wires, towers=towers, strings=strings)


def label_points(
    line: Line, scene: Scene, own: Ints, wires: Sequence[Wire], towers: Sequence[Tower]
) -> None:
    """Enter which points are of wires and towers; `own` are those in the air."""
    wire, span, tower, confidence = (line.labels[name] for name in (*NUMBERS, "confidence"))
    for one in wires:
        near, away, radius = on_wire(scene, one)
        points = own[near]
        wire[points], span[points] = one.wire, one.span
        confidence[points] = 1 - 0.5 * (away / radius) ** 2
    for number, one_tower in enumerate(towers, start=1):
        points = own[one_tower.points]
        points = points[wire[points] == 0]
        tower[points] = number
        confidence[points] = 0.5 + 0.5 * one_tower.support.body


def by_thesis(
    line: Line, own: Ints, air: Airborne, height: Floats, settings: Settings,
    tolerance: float, max_gap: float, ctx: Context,
) -> Line:  # fmt: skip
    """Wires and pylons by voxels, and catenaries through the wires found."""
    wire, span, tower = (line.labels[name] for name in NUMBERS)
    high, pylon = voxel_lines(air.xyz, height, settings, ctx.part(0.1, 0.9))
    tower[own] = pylon
    wire[own[high]] = 1
    scene = Scene(air, height, high, tolerance, lambda x, y: 0.0, lambda x, y: False)
    _, voxel = uncrowded(scene.wires, 1.0)
    wires, _ = follow(scene, voxel, max_gap, ctx.part(0.9, 1.0))
    for one in wires:
        near, _, _ = on_wire(scene, one)
        points = own[near[high[near]]]
        wire[points], span[points] = one.wire, one.span
    return replace(line, wires=wires)


def accompanied(xyz: Floats, metre: float) -> NDArray[np.bool_]:
    """False for points with no other near them, if most have one: many low ones sink the terrain.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    metre : length of one metre in the unit of the points
    """
    cell = np.floor((xyz - xyz.min(axis=0)) / (np.array(COMPANY) * metre)).astype(np.int64)
    size = cell.max(axis=0) + 1
    _, which, count = np.unique(
        (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2],
        return_inverse=True, return_counts=True,
    )  # fmt: skip
    found = count[which] > 1
    return found if found.mean() > ALMOST_ALL else np.ones(len(xyz), bool)


def _frozen(xyz: Floats) -> Floats:
    """Kernels would be compiled for writable arrays once more."""
    xyz.flags.writeable = False
    return xyz


def elevation(places: Floats, height: Floats) -> Callable[[float, float], float]:
    """Elevation of the ground at a place, by the plane through what is known of it near by.

    Parameters
    ----------
    places : array of shape (n, 3), metres
    height : array of shape (n,), above the ground, metres; NaN where not known
    """
    low = np.flatnonzero(height <= OFF_GROUND)
    low = low if len(low) else np.flatnonzero(np.isfinite(height))
    xy, ground = places[low, :2], places[low, 2] - height[low]
    tree = cKDTree(xy)

    def at(x: float, y: float) -> float:
        near = np.asarray(tree.query((x, y), k=range(1, min(AROUND, len(low)) + 1))[1])
        middle = xy[near].mean(axis=0)
        sides = np.column_stack([xy[near] - middle, np.ones(len(near))])
        slope = np.linalg.lstsq(sides, ground[near], rcond=0.01)[0]
        return float(np.append((x, y) - middle, 1.0) @ slope)

    return at


def footprint(
    xy: Floats, stands_for: NDArray[np.uint32]
) -> tuple[Callable[[float, float], bool], float]:
    """Whether there are points around a place, and points per square metre where there are any.

    The points must not lie along lines only, as wires without ground do, the lowest of which would
    be taken for it. Seen from above, cells with ground have others around them; those with wires
    have others before and behind. Points that are few, or so sparse that most cells of ground have
    one, cannot be judged.

    Parameters
    ----------
    xy : array of shape (n, 2), metres, none below 0
    stands_for : array of shape (n,), how many points each is of

    Raises
    ------
    DataError
        They lie along lines.
    """
    table = occupied(xy)
    of_cell = float(stands_for.sum()) / np.count_nonzero(table)
    enough = np.count_nonzero(table) >= FEWEST_CELLS and of_cell >= FEWEST_OF_CELL
    if enough and min(share_beside(occupied(xy + shift)) for shift in SHIFTS) < AREA:
        raise DataError(
            "points: lie along lines, as wires do, without the ground from which heights are "
            "measured; give the ground too, or fit the wires with corridor.catenaries"
        )

    def seen(x: float, y: float) -> bool:
        i, j = int(x // SEEN_CELL) + 1, int(y // SEEN_CELL) + 1
        return bool(table[max(i - 1, 0) : max(i + 2, 0), max(j - 1, 0) : max(j + 2, 0)].any())

    return seen, of_cell / SEEN_CELL**2


def occupied(xy: Floats) -> NDArray[np.bool_]:
    """Which cells have points, with an empty one all around; places are not below 0."""
    cell = np.floor(xy / SEEN_CELL).astype(np.int64) + 1
    table = np.zeros(cell.max(axis=0) + 2, bool)
    table[cell[:, 0], cell[:, 1]] = True
    return table


def share_beside(table: NDArray[np.bool_]) -> float:
    """Share of the cells with points that have enough of them around."""
    beside = sum(np.roll(table, step, (0, 1))[table].astype(np.uint8) for step in STEPS)
    return float(np.mean(np.asarray(beside) >= BESIDE))


def dressed(
    scene: Scene, wires: Sequence[Wire], supports: Sequence[Support]
) -> tuple[list[Wire], list[Tower], list[float]]:
    """Wires that end at their insulators, towers, and the length of the insulators of each."""
    take(scene, wires)
    supports = [centred(scene, support) for support in supports]
    wires = [to_supports(wire, supports) for wire in wires]
    strings = strings_of(scene, wires, supports)
    ended = [without_strings(wire, *own) for wire, own in zip(wires, strings, strict=True)]
    take(scene, ended)
    held = np.array([wire.supports for wire in wires])
    longest = [float(strings[held == number].max()) for number in range(len(supports))]
    return ended, [tower_of(scene, support) for support in supports], longest


def take(scene: Scene, wires: Sequence[Wire]) -> None:
    """Leave the points that do not lie on wires free."""
    scene.free[:] = True
    for wire in wires:
        scene.free[on_wire(scene, wire)[0]] = False


def without_strings(wire: Wire, low: float, high: float) -> Wire:
    """A wire that begins and ends at its insulators, of these lengths."""
    if 3 * (low + high) >= wire.curve.length:
        return wire
    curve = wire.curve.between(low, wire.curve.length - high)
    known = (max(wire.known[0] - low, 0.0), min(wire.known[1] - low, curve.length))
    return replace(wire, curve=curve, known=known)


def on_wire(scene: Scene, wire: Wire) -> tuple[Ints, Floats, float]:
    """The points in the air that lie on a wire, how far from it, and how far that may be."""
    radius = min(max(TUBE * wire.curve.rms, TUBE_LEAST), TUBE_MOST)
    return *scene.air.around(wire.curve, radius), radius
