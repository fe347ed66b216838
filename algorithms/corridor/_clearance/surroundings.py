"""Input of a clearance analysis from layers: wires in several states, and the points near them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.corridor._clearance.distances import (
    MEASURED_BLOCK,
    TAKES_NO_PART,
    UNCLASSIFIED,
    WireLattice,
    own_points,
)
from algorithms.corridor._clearance.rules import KINDS, OBJECTS
from algorithms.corridor._clearance.sag import State
from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._extraction.labels import LINE_CLASSES
from algorithms.corridor._extraction.layers import catenaries_of, swing_sigmas
from algorithms.shared.ground import is_withheld
from algorithms.shared.heights import HEIGHT, given_heights
from algorithms.shared.lowest import require_finite
from algorithms.shared.terrain import find_terrain, height_above
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Vector

KIND_CLASSES = {
    "unclassified": (0, 1),
    "water": (9,),
    "rail": (10,),
    "road": (11,),
}  # kinds and classes
BESIDE_TOWER = 1.0  # metres around the body of a tower
PLANTS = (KINDS.index("tree"), KINDS.index("unclassified"))  # kinds that are plants, or may be

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


LOW_LISTED = "Of these, would break a rule or be near"  # said of low plants, also if none would
OF_LINE = "Of the line (classes 13 to 16)"  # why points take no part, as those of the wires


@dataclass(frozen=True)
class LineStates:
    """Wires in all states, in metres from an origin.

    Attributes
    ----------
    origin : array of shape (3,), in the unit of the data
    states : of the wires
    curves : for each state those of the m wires
    rest : the m wires at their highest and at their lowest, of all temperatures that they may have
    wire, span, start, end : arrays of shape (m,), numbers of the conductor, span and towers
    swing_sd : array of shape (m,), of the swing as surveyed, degrees; NaN where none was fitted
    """

    origin: Floats
    states: list[State]
    curves: list[list[Catenary]]
    wire: Ints
    span: Ints
    start: Ints
    end: Ints
    rest: tuple[list[Catenary], list[Catenary]]
    swing_sd: Floats

    @property
    def spans(self) -> list[int]:
        """Numbers of the spans."""
        return [int(number) for number in np.unique(self.span)]

    def axis(self, span: int) -> Catenary:
        """The longest wire of a span, from the start of which places along the span are told."""
        own = np.flatnonzero(self.span == span)
        return max((self.curves[0][wire] for wire in own), key=lambda curve: curve.length)

    def chainage(self, wire: int, u: float, state: int = 0) -> float:
        """Distance along its span of the place u on a wire, metres: wires may begin apart."""
        place = self.curves[state][wire].points(np.array([u]))
        return float(self.axis(int(self.span[wire])).along(place)[0][0])

    @property
    def elevation(self) -> float:
        """Mean height of the ends of the wires, metres, from 0 to that of the highest mountain."""
        ends = [height for c in self.curves[0] for height in (c.z_start, c.z_end)]
        return float(np.clip(np.mean(ends), 0.0, 9000.0)) if ends else 0.0

    @property
    def highest(self) -> float:
        """Height of the highest end of a wire, metres; below all others if there is none."""
        ends = (height for c in self.curves[0] for height in (c.z_start, c.z_end))
        return max(ends, default=-math.inf)

    @property
    def open_spans(self) -> list[int]:
        """Numbers of the spans that end where the data end, not at a tower."""
        open_ended = (self.start == 0) | (self.end == 0)
        return [int(number) for number in np.unique(self.span[open_ended])]

    @cached_property
    def towers(self) -> dict[int, Floats]:
        """Where each tower holds its wires as surveyed: the mean of their ends, by its number."""
        held: dict[int, list[Floats]] = {}
        for curve, *numbers in zip(self.curves[0], self.start, self.end, strict=True):
            ends = curve.points(np.array([0.0, curve.length]))
            for tower, end in zip(map(int, numbers), ends, strict=True):
                held.setdefault(tower, []).append(end)
        return {tower: np.mean(ends, axis=0) for tower, ends in sorted(held.items()) if tower}


@dataclass(frozen=True)
class Surroundings:
    """Points around the line, in metres from its origin.

    Attributes
    ----------
    index : array of shape (n,), of the points in the cloud
    xyz : array of shape (n, 3)
    kind : array of shape (n,), index into KINDS, -1 for points that take no part
    height : array of shape (n,), above the ground
    low, hanging : arrays of shape (n,), index into KINDS of plants too low to be objects, and of
        what hangs in mid-air and may be of the line; -1 for all others
    left_out : how many points take no part, and why
    """

    index: Ints
    xyz: Floats
    kind: NDArray[np.int8]
    height: Floats
    low: NDArray[np.int8]
    hanging: NDArray[np.int8]
    left_out: dict[str, int]


@dataclass(frozen=True)
class Object:
    """Points that form one object, with the measures of the worst violation among them, in metres.

    `falls` is what is left between its trees and a wire if they fall, at the worst; NaN if no tree
    of it reaches one. The others are as in `Violations`.
    """

    points: Ints
    nearest: int
    kind: str
    rule: int
    wire: int
    state: int
    measure: float
    space: float
    vertical: float
    flat: float
    u: float
    sd: float
    probability: float
    height: float
    falls: float


def line_of(wires: Vector) -> LineStates:
    """Wires of a layer as surveyed, in metres from an origin near them."""
    frame, metre = wires.frame, wires.metre
    # Whole metres: the same position whatever the unit.
    corner = np.floor(frame[["x0", "y0"]].min() / metre) if len(frame) else (0.0, 0.0)
    origin = np.array([*corner, 0.0]) * metre
    columns = ("wire_id", "span_id", "from_tower", "to_tower")
    wire, span, start, end = (frame[name].to_numpy(np.int64) for name in columns)
    curves = catenaries_of(wires, origin)
    states, rest = [State("survey")], (curves, curves)
    return LineStates(origin, states, [curves], wire, span, start, end, rest, swing_sigmas(wires))


def surroundings_of(
    cloud: PointCloud,
    line: LineStates,
    *,
    classes: Mapping[str, Sequence[int]],
    ignore: Sequence[int],
    reach: float,
    wire_radius: float,
    attachment: float,
    lowest: float,
    towers: Vector | None = None,
    ctx: Context = QUIET,
) -> Surroundings:
    """Points near the wires, in metres, with their kinds and their heights above the ground.

    Parameters
    ----------
    classes : of trees, buildings and ground, by kind
    ignore : classes that take no part
    reach : to the side of the wires, metres
    wire_radius, attachment : points without a class that are as near to a wire or to its end are
        of the line, metres
    lowest : plants that are lower above the ground take no part, metres
    towers : points without a class around their bodies are of them, unless `attachment` is 0
    """
    require_finite(cloud.xyz)
    if not line.spans:
        none = np.empty(0, np.int8)
        return Surroundings(
            np.empty(0, np.int64), np.empty((0, 3)), none, np.empty(0), none, none, {}
        )
    index = near_wires(cloud, line, reach)
    kind, left_out = kinds_of(cloud, classes, ignore)
    kind = kind[index]
    height = _heights(cloud, index, kind >= len(OBJECTS), ctx.part(0.0, 0.5))
    xyz = cloud.xyz[index]
    xyz -= line.origin
    xyz /= cloud.metre
    mine = own_points(
        xyz, kind, line.curves[0], radius=wire_radius, attachment=attachment, ctx=ctx.part(0.5, 1.0)
    )
    if attachment > 0:
        mine |= (kind == UNCLASSIFIED) & at_towers(xyz, towers, line.origin)
    kind[mine] = TAKES_NO_PART
    left_out["Without a class, on a wire or at a support"] = int(mine.sum())
    low = np.where(np.isin(kind, PLANTS) & (height < lowest), kind, TAKES_NO_PART)
    kind[low >= 0] = TAKES_NO_PART
    if lowest:
        why = f'Plants, or what may be, lower than {lowest:g} m, the setting "Lowest object"'
        left_out[why] = int((low >= 0).sum())
    hanging = np.full_like(kind, TAKES_NO_PART)
    return Surroundings(index, xyz, kind, height, low, hanging, left_out)


def near_wires(cloud: PointCloud, line: LineStates, reach: float) -> Ints:
    """Indices of the points that are near the wires in plan."""
    cells = WireLattice.of(line.curves, reach)
    found = [np.empty(0, np.int64)]
    for first in range(0, len(cloud), MEASURED_BLOCK):
        xy = (cloud.xyz[first : first + MEASURED_BLOCK, :2] - line.origin[:2]) / cloud.metre
        found.append(first + np.flatnonzero(cells.has(xy)))
    return np.concatenate(found)


def kinds_of(
    cloud: PointCloud, classes: Mapping[str, Sequence[int]], ignore: Sequence[int]
) -> tuple[NDArray[np.int8], dict[str, int]]:
    """Index into KINDS of each point, and numbers of excluded points by reason."""
    given = np.asarray(cloud["classification"])
    kind = np.full(len(cloud), KINDS.index("other"), np.int8)
    for name, codes in (*KIND_CLASSES.items(), *classes.items()):
        kind[np.isin(given, codes)] = KINDS.index(name)
    withheld, noise, of_line = (
        is_withheld(cloud),
        np.isin(given, ignore),
        np.isin(given, LINE_CLASSES),
    )
    kind[withheld | noise | of_line] = TAKES_NO_PART
    ignored = ", ".join(map(str, ignore))
    left_out = {
        "Withheld": int(withheld.sum()),
        f"Of ignored classes ({ignored})": int((noise & ~withheld).sum()),
        OF_LINE: int((of_line & ~noise & ~withheld).sum()),
    }
    return kind, left_out


def _heights(cloud: PointCloud, index: Ints, ground: NDArray[np.bool_], ctx: Context) -> Floats:
    """Heights of some points above the ground, metres; NaN where not known."""
    if HEIGHT in cloud:
        return given_heights(cloud)[index]
    if not ground.any():
        log.warning("no point is ground: heights are not known, falling trees not looked for")
        return np.full(len(index), np.nan)
    places = cloud.xyz[index]
    bare = places[ground]
    bare.flags.writeable = places.flags.writeable = False  # as the kernels are compiled for
    return height_above(places, find_terrain(bare, known=True, metre=cloud.metre, ctx=ctx))


def at_towers(xyz: Floats, towers: Vector | None, origin: Floats) -> NDArray[np.bool_]:
    """True for points at the body of a tower, in plan."""
    if towers is None or not len(towers):
        return np.zeros(len(xyz), bool)
    feet = (shapely.get_coordinates(towers.frame.geometry.to_numpy()) - origin[:2]) / towers.metre
    radius = towers.frame["width"].to_numpy(float) / 2 + BESIDE_TOWER
    radius = np.append(np.nan_to_num(radius, nan=BESIDE_TOWER), 0.0)  # the last for none near
    away, nearest = cKDTree(feet).query(xyz[:, :2], distance_upper_bound=2 * radius.max())
    return np.asarray(away <= radius[nearest])
