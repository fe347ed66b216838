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
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._follow import follow
from algorithms.corridor._lines import tower_layer, wire_layer
from algorithms.corridor._network import Scene
from algorithms.corridor._spans import Wire
from algorithms.corridor._supports import Support
from algorithms.corridor._thesis import Settings, Variance, voxel_lines
from algorithms.corridor._towers import Tower, strings_of, tower_of
from algorithms.corridor._trace import Airborne, uncrowded
from algorithms.ground.classify import Terrain, find_terrain, height_above
from algorithms.shared.ground import may_be_ground, taking_part
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Vector
from toolbox.errors import DataError
from toolbox.spec import outputs, param, sink, source, tool
from toolbox.values import ClassList

WIRE, TOWER, OTHER = np.uint8(14), np.uint8(15), np.uint8(1)  # ASPRS classes
LINE_CLASSES = (13, 14, 15, 16)  # given anew: wire guard, conductor, tower, connector
OFF_GROUND = 0.4  # metres, from which a point can be of a tower
COMPANY, ALMOST_ALL = (2.0, 2.0, 1.0), 0.9  # metres, and share of the points with others so near
SEEN_CELL = 2.0  # metres
AREA_CELL = 2.0  # metres
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
    together: the ground is found first, or taken from the classes given.

    `wires` has one catenary per conductor and span, as a line in three dimensions; `towers` one
    point per tower, at its foot. A span needs the whole of its wires, so the tool looks at the
    whole cloud.

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
    seed: int = param("Method thesis: seed of the random samples", default=0, unit="1", ge=0)
    ignore: ClassList | None = param(
        "Classes that take no part and stay as they are, such as noise 7,18", default=None
    )

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
        cloud = self.points
        part = taking_part(cloud, self.ignore)
        ground = part & may_be_ground(cloud, "last")
        if self.ground_classes is not None:
            ground = part & np.isin(_classes(cloud), self.ground_classes)
            if part.any() and not ground.any():
                raise DataError(f"points: none is of the ground_classes {self.ground_classes}")
        line = find_line(
            cloud.xyz,
            part,
            ground,
            known=self.ground_classes is not None,
            metre=cloud.metre,
            min_height=self.min_height / cloud.metre,
            max_gap=self.max_gap / cloud.metre,
            tolerance=self.tolerance / cloud.metre,
            thesis=self._thesis() if self.method == "thesis" else None,
            ctx=ctx,
        )
        if not line.wires:
            log.warning("no power line was found")
        spans = {wire.span for wire in line.wires}
        return self.Outputs(
            classified=self._classified(line),
            towers=tower_layer(line.towers, line.strings, line.origin, cloud.metre, cloud.crs),
            wires=wire_layer(line.wires, line.origin, cloud.metre, cloud.crs),
            span_count=len(spans),
            tower_count=len(line.towers),
        )

    def _thesis(self) -> Settings:
        metre = self.points.metre
        return Settings(
            self.thesis_height / metre, self.thesis_voxel / metre, self.thesis_variance,
            self.thesis_gap / metre, self.seed,
        )  # fmt: skip

    def _classified(self, line: Line) -> PointCloud:
        old = _classes(self.points)
        classes = np.where(np.isin(old, LINE_CLASSES) & line.part, OTHER, old)
        classes = np.where(line.wire > 0, WIRE, np.where(line.tower > 0, TOWER, classes))
        return self.points.with_attributes(
            {
                "classification": classes.astype(np.uint8),
                "wire_id": line.wire,
                "span_id": line.span,
                "tower_id": line.tower,
                "confidence": line.confidence,
            },
            descriptions={
                "wire_id": "conductor, the same from span to span",
                "span_id": "between two towers",
                "tower_id": "tower or pole",
                "confidence": "0 doubtful to 1 clear",
            },
        )


def _classes(cloud: PointCloud) -> NDArray[np.uint8]:
    if "classification" in cloud:
        return np.asarray(cloud["classification"], np.uint8)
    return np.full(len(cloud), OTHER)


@dataclass(frozen=True)
class Line:
    """The power lines of a cloud of n points, and which points are theirs.

    Attributes
    ----------
    wires, towers : in metres from the origin
    strings : length of the insulators by which wires pull at each tower, metres
    origin : array of shape (3,), in the unit of the cloud
    part : array of shape (n,), the points that took part
    wire, span, tower : arrays of shape (n,), numbers from 1, 0 for none
    confidence : array of shape (n,)
    """

    wires: Sequence[Wire]
    towers: Sequence[Tower]
    strings: Sequence[float]
    origin: Floats
    part: NDArray[np.bool_]
    wire: NDArray[np.uint32]
    span: NDArray[np.uint32]
    tower: NDArray[np.uint32]
    confidence: NDArray[np.float32]


def find_line(
    xyz: Floats,
    part: NDArray[np.bool_],
    ground: NDArray[np.bool_],
    *,
    known: bool = False,
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
    xyz : array of shape (n, 3)
    part : array of shape (n,), points that take part
    ground : array of shape (n,), points that may be ground
    known : whether they are
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
        The points lie along lines, without ground.
    """
    n = len(xyz)
    wire, span, tower = (np.zeros(n, np.uint32) for _ in range(3))
    confidence = np.where(part, 1.0, 0.0).astype(np.float32)
    origin = np.floor(xyz[part].min(axis=0)) if part.any() else np.zeros(3)
    nothing = Line([], [], [], origin, part, wire, span, tower, confidence)
    ctx.progress(0.0)
    if not ground.any():
        return nothing
    require_ground((xyz[part, :2] - origin[:2]) / metre)
    ground = ground & accompanied(xyz, metre)
    terrain = find_terrain(_frozen(xyz[ground]), known=known, metre=metre, ctx=ctx.part(0.0, 0.4))
    above = height_above(xyz, terrain)
    index = np.flatnonzero(part & (above > OFF_GROUND))
    air = Airborne.of((xyz[index] - origin) / metre)
    height = above[index][air.order]
    seen, density = footprint((xyz[part, :2] - origin[:2]) / metre)
    if thesis is not None:
        return by_thesis(nothing, xyz, index, air, height, thesis, tolerance, max_gap, ctx)
    high = air.select(height > min_height)
    alone, voxel = uncrowded(high, density)
    ctx.progress(0.45)
    scene = Scene(air, height, high.select(alone), tolerance, _elevation(terrain, origin), seen)
    wires, supports = follow(scene, voxel[alone], max_gap, ctx.part(0.45, 0.9))
    if not wires:
        return nothing
    wires, towers, strings = dressed(scene, wires, supports)
    own = index[air.order]
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
    ctx.progress(1.0)
    return Line(wires, towers, strings, origin, part, wire, span, tower, confidence)


def by_thesis(
    nothing: Line, xyz: Floats, index: Ints, air: Airborne, height: Floats, settings: Settings,
    tolerance: float, max_gap: float, ctx: Context,
) -> Line:  # fmt: skip
    """Wires and pylons by voxels, and catenaries through the wires found."""
    high, pylon = voxel_lines(air.xyz, height, settings, ctx.part(0.45, 0.9))
    own = index[air.order]
    nothing.tower[own] = pylon
    nothing.wire[own[high]] = 1
    scene = Scene(air, height, air.select(high), tolerance, lambda x, y: 0.0, lambda x, y: False)
    _, voxel = uncrowded(scene.wires, 1.0)
    wires, _ = follow(scene, voxel, max_gap, ctx.part(0.9, 1.0))
    for one in wires:
        near, _, _ = on_wire(scene, one)
        points = own[near[high[near]]]
        nothing.wire[points], nothing.span[points] = one.wire, one.span
    return replace(nothing, wires=wires)


def require_ground(xy: Floats) -> None:
    """Refuse points, of shape (n, 2) in metres, that lie along lines only: wires without ground.

    The lowest wires would be taken for ground. Seen from above, cells with ground have others
    around them; those with wires have others before and behind. Points that are few, or so sparse
    that most cells of ground have one, cannot be judged.

    Raises
    ------
    DataError
    """
    cell = np.floor((xy - xy.min(axis=0)) / AREA_CELL).astype(np.int64) + 1
    width = int(cell[:, 1].max()) + 2
    keys, count = np.unique(cell @ [width, 1], return_counts=True)
    steps = (width - 1, width, width + 1, 1, -1, 1 - width, -width, -1 - width)
    beside = sum(np.isin(keys + step, keys, assume_unique=True).astype(int) for step in steps)
    enough = len(keys) >= FEWEST_CELLS and count.mean() >= FEWEST_OF_CELL
    if enough and np.mean(beside >= BESIDE) < AREA:
        raise DataError(
            "points: lie along lines, as wires do, without the ground from which heights are "
            "measured; give the ground too, or fit the wires with corridor.catenaries"
        )


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


def _elevation(terrain: Terrain, origin: Floats) -> Callable[[float, float], float]:
    """Elevation of the terrain at a place, all in metres from the origin."""

    def at(x: float, y: float) -> float:
        place = np.array([[x, y, 0.0]]) * terrain.metre + origin
        return -float(height_above(_frozen(place), terrain)[0])

    return at


def footprint(xy: Floats) -> tuple[Callable[[float, float], bool], float]:
    """Whether there are points around a place, and points per square metre where there are any.

    Parameters
    ----------
    xy : array of shape (n, 2), metres, none below 0
    """
    cell = np.floor(xy / SEEN_CELL).astype(np.int64) + 1
    shape = cell.max(axis=0) + 2
    count = np.bincount(cell[:, 0] * shape[1] + cell[:, 1], minlength=int(shape.prod()))
    table = count.reshape(shape) > 0

    def seen(x: float, y: float) -> bool:
        i, j = int(x // SEEN_CELL) + 1, int(y // SEEN_CELL) + 1
        return bool(table[max(i - 1, 0) : max(i + 2, 0), max(j - 1, 0) : max(j + 2, 0)].any())

    return seen, len(xy) / (SEEN_CELL**2 * max(int(table.sum()), 1))


def dressed(
    scene: Scene, wires: Sequence[Wire], supports: Sequence[Support]
) -> tuple[list[Wire], list[Tower], list[float]]:
    """Wires that end at their insulators, towers, and the length of the insulators of each."""
    take(scene, wires)
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
