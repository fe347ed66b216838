"""Distances of points from catenaries: the rules they break, by how much, and how probably."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtr

from algorithms.corridor._clearance import distances_kernels as kernels
from algorithms.corridor._clearance.rules import DIRECTIONS, KINDS, SEVERITIES, Rule, reach_of
from algorithms.corridor._curves.catenary import Catenary
from algorithms.shared.kernels.sorting import distinct
from algorithms.shared.kernels.threads import in_blocks
from toolbox.context import QUIET, Context

MEASURED_BLOCK = 100_000  # points between two checks for cancellation
LATTICE_STEP = 5.0  # metres between the positions on a wire that are entered in a lattice
LATTICE_CELL, MOST_LATTICE_CELLS = 10.0, 4_000_000  # of the lattice: metres; number
UNCLASSIFIED, TREE = KINDS.index("unclassified"), KINDS.index("tree")
TAKES_NO_PART = np.int8(-1)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Kinds = NDArray[np.int8]


@dataclass(frozen=True)
class WireLattice:
    """A lattice in plan with the wires that are near each cell.

    Attributes
    ----------
    lattice : west, south, size of a cell, columns and rows
    starts, candidates : the wires of cell i are candidates[starts[i]:starts[i + 1]]
    """

    lattice: Floats
    starts: Ints
    candidates: Ints

    @classmethod
    def of(cls, curves: Sequence[Sequence[Catenary]], reach: float) -> WireLattice:
        """Lattice of wires, each of which has one curve per state."""
        places, owners = [], []
        for states in zip(*curves, strict=True):
            for curve in states:
                count = max(2, math.ceil(curve.length / LATTICE_STEP) + 1)
                places.append(curve.points(np.linspace(0.0, curve.length, count))[:, :2])
            owners.append(sum(map(len, places[-len(states) :])))
        xy = np.concatenate(places)
        reach += LATTICE_STEP
        west, south = xy.min(axis=0) - reach
        width, height = np.ptp(xy, axis=0) + 2 * reach
        cell = max(LATTICE_CELL, reach / 2, math.sqrt(width * height / MOST_LATTICE_CELLS))
        columns, rows = int(width // cell) + 1, int(height // cell) + 1
        wire = np.repeat(np.arange(len(owners)), owners)
        around = math.ceil(reach / cell)
        pairs = []
        column, row = ((xy - (west, south)) // cell).astype(np.int64).T
        for down in range(-around, around + 1):
            for right in range(-around, around + 1):
                i, j = row + down, column + right
                inside = (i >= 0) & (j >= 0) & (i < rows) & (j < columns)
                pairs.append(np.unique((i * columns + j)[inside] * len(owners) + wire[inside]))
        found = distinct(np.concatenate(pairs))
        starts = np.searchsorted(found // len(owners), np.arange(rows * columns + 1))
        lattice = np.array([west, south, cell, columns, rows])
        return cls(lattice, starts.astype(np.int64), found % len(owners))

    def has(self, xy: Floats) -> NDArray[np.bool_]:
        """True for positions of shape (n, 2) that have a wire near them."""
        west, south, cell, columns, rows = self.lattice
        column, row = np.floor((xy[:, 0] - west) / cell), np.floor((xy[:, 1] - south) / cell)
        inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        own = np.where(inside, row * columns + column, 0).astype(np.int64)
        return np.asarray(inside & (self.starts[own + 1] > self.starts[own]))


@dataclass(frozen=True)
class Violations:
    """Points that break a rule; one array of shape (n,) per property.

    Attributes
    ----------
    point : index
    wire, rule, state : indices; the state is that in which the rule is broken worst
    measure : distance in the direction of the rule, metres
    ratio : of it to the threshold, or of the other distance to `within` if that is larger: 0 is
        worst, 1 the limit
    space, vertical, flat, u : other distances from that wire in that state, and where it is nearest
    sd : standard deviation of the distance, metres
    probability : that the rule is broken
    """

    point: Ints
    wire: Ints
    rule: Ints
    state: Ints
    measure: Floats
    ratio: Floats
    space: Floats
    vertical: Floats
    flat: Floats
    u: Floats
    sd: Floats
    probability: Floats

    def __len__(self) -> int:
        return len(self.point)

    @classmethod
    def none(cls) -> Violations:
        """No violations: arrays of length 0."""
        whole, real = np.empty(0, np.int64), np.empty(0)
        return cls(whole, whole, whole, whole, *([real] * 8))

    def select(self, chosen: NDArray[np.bool_]) -> Violations:
        """The violations for which an array of shape (n,) is true."""
        return Violations(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def joined(self, other: Violations) -> Violations:
        """These violations followed by others."""
        return Violations(
            *(
                np.concatenate([getattr(self, field.name), getattr(other, field.name)])
                for field in fields(self)
            )
        )


@dataclass(frozen=True)
class Least:
    """The points nearest in space to each wire, of those near it in plan; (states, wires, kinds).

    Attributes
    ----------
    distance : in space, metres; infinite where there is none near
    point : its index, -1 for none
    """

    distance: Floats
    point: Ints

    @classmethod
    def none(cls, states: int, wires: int = 0) -> Least:
        """No points: infinite distances and the index -1."""
        shape = (states, wires, len(KINDS))
        return cls(np.full(shape, np.inf), np.full(shape, -1, np.int64))


def rows_of(curves: Sequence[Catenary]) -> Floats:
    """Wires as rows of numbers for the compiled loops, array of shape (m, 19).

    The last columns are: the lowest height and that of the higher end; the largest second
    derivative of the height; by how much the fourth term of the series of the height may be too
    small, per fourth power of the distance from the lowest point; the share of its square that a
    distance to the axis has at least, in plan and in space.
    """
    return np.array([_row_of(curve) for curve in curves], float).reshape(-1, 19)


def _row_of(c: Catenary) -> tuple[float, ...]:
    slopes = [math.sinh(c.curvature * (u - c.u0)) for u in (0.0, c.length)]
    chord, steep = (c.z_end - c.z_start) / c.length, max(map(abs, slopes))
    aside = max(abs(c.v1 + c.swing * (chord - slope)) for slope in slopes)
    lowest = float(c.height(np.clip(c.u0, 0.0, c.length)))
    longest = math.hypot(1.0, steep)  # cosh where sinh is the slope
    return (
        c.x,
        c.y,
        c.ex,
        c.ey,
        c.length,
        c.z_start,
        chord,
        c.curvature,
        c.u0,
        c.z0,
        c.v0,
        c.v1,
        c.swing,
        lowest,
        max(c.z_start, c.z_end),
        c.curvature * longest,
        c.curvature**3 / 24 * (longest - 1),
        1 / (1 + aside**2),
        1 / (1 + aside**2 + steep**2),
    )


def distances(xyz: Floats, curve: Catenary) -> Floats:
    """Distances of points from a wire: in space, vertical and horizontal.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres

    Returns
    -------
    array of shape (n, 4)
        In space; vertical, above zero under the wire, and horizontal where the wire is nearest in
        plan; u of the nearest position on the wire.
    """
    result = np.empty((len(xyz), 4))
    kernels.distances(0, len(xyz), np.ascontiguousarray(xyz, float), rows_of([curve])[0], result)
    return result


def own_points(
    xyz: Floats,
    kind: Kinds,
    curves: Sequence[Catenary],
    *,
    radius: float,
    attachment: float,
    ctx: Context = QUIET,
) -> NDArray[np.bool_]:
    """True for points without a class that belong to the line: on a wire, or at an end of one.

    Parameters
    ----------
    radius : farthest from a wire, metres
    attachment : farthest from the end of a wire, metres
    """
    mine = np.zeros(len(xyz), bool)
    some = np.where(kind == UNCLASSIFIED, kind, TAKES_NO_PART)
    reach = max(radius, attachment)
    if not (some >= 0).any() or reach <= 0:
        return mine
    space, _ = nearest_wires(xyz, some, curves, reach=reach, ctx=ctx)
    ends = cKDTree(np.concatenate([c.points(np.array([0.0, c.length])) for c in curves]))
    close = np.flatnonzero(space <= attachment)
    mine[close[ends.query(xyz[close])[0] <= attachment]] = True
    return mine | (space <= radius)


def nearest_wires(
    xyz: Floats, kind: Kinds, curves: Sequence[Catenary], *, reach: float, ctx: Context = QUIET
) -> tuple[Floats, Ints]:
    """Distance in space of each point from the nearest wire, and the index of that wire.

    Infinite and -1 for points that take no part, or have no wire within `reach`, metres.
    """
    near, wires = WireLattice.of([curves], reach), rows_of(curves)
    far = np.full((len(KINDS), 2), (reach * 1.001, 0.0))
    space, wire = np.full(len(xyz), np.inf), np.full(len(xyz), -1)

    def work(first: int, last: int) -> None:
        own, real = np.empty((last - first, 2), np.int64), np.empty((last - first, 6))
        kernels.check(
            0,
            last - first,
            xyz[first:last],
            kind[first:last],
            near.lattice,
            near.starts,
            near.candidates,
            wires,
            np.empty((0, 4)),
            np.empty(0, np.int64),
            far,
            reach,
            own,
            real,
            np.zeros((len(wires), len(KINDS))),
            np.empty((0, 0), np.int64),
        )
        space[first:last], wire[first:last] = real[:, 2], own[:, 0]

    in_blocks(work, len(xyz), MEASURED_BLOCK, ctx)
    beyond = space > reach
    space[beyond], wire[beyond] = np.inf, -1
    return space, wire


def find_violations(
    xyz: Floats,
    kind: Kinds,
    curves: Sequence[Sequence[Catenary]],
    rules: Sequence[Rule],
    *,
    reach: float,
    point_sd: float,
    ctx: Context = QUIET,
) -> tuple[Violations, Least]:
    """Points that break a rule in any of several states of the wires, and the nearest points.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    kind : array of shape (n,), index into KINDS; points below zero take no part
    curves : the wires in each state, metres
    rules : of which each point breaks the severest, and of these the one that it breaks worst
    reach : to the side of the wires up to which points are looked at, metres
    point_sd : standard deviation of a point, metres
    ctx : progress and cancellation
    """
    near, wires = WireLattice.of(curves, reach), [rows_of(state) for state in curves]
    numbers = np.array(
        [
            (DIRECTIONS.index(r.direction), r.threshold, r.within, SEVERITIES.index(r.severity))
            for r in rules
        ],
        float,
    ).reshape(-1, 4)
    masks = np.array(
        [sum(r.holds_for(name) << k for k, name in enumerate(KINDS)) for r in rules], np.int64
    )
    far = np.array([_farthest(rules, kind) for kind in KINDS])
    found: dict[int, tuple[Ints, Ints, Floats]] = {}
    nearest: dict[int, Least] = {}

    def work(first: int, last: int) -> None:
        size = last - first
        worst = np.full((size, 3), -1, np.int64)  # wire, rule, state
        measures = np.full((size, 6), np.inf)
        seen = Least.none(len(curves), len(curves[0]))
        for state, rows in enumerate(wires):
            own, real = np.empty((size, 2), np.int64), np.empty((size, 6))
            kernels.check(
                0,
                size,
                xyz[first:last],
                kind[first:last],
                near.lattice,
                near.starts,
                near.candidates,
                rows,
                numbers,
                masks,
                far,
                reach,
                own,
                real,
                seen.distance[state],
                seen.point[state],
            )
            _keep_worse(worst, measures, own, real, numbers[:, 3], state)
        seen.point[seen.point >= 0] += first
        bad = np.flatnonzero(worst[:, 1] >= 0)
        found[first], nearest[first] = (bad + first, worst[bad], measures[bad]), seen

    in_blocks(work, len(xyz), MEASURED_BLOCK, ctx)
    least = Least.none(len(curves), len(curves[0]))
    for first in sorted(nearest):
        less = nearest[first].distance < least.distance
        least.distance[less] = nearest[first].distance[less]
        least.point[less] = nearest[first].point[less]
    return _violations([found[first] for first in sorted(found)], curves, numbers, point_sd), least


def _keep_worse(
    worst: Ints, measures: Floats, own: Ints, real: Floats, rank: Floats, state: int
) -> None:
    """Enter broken rules of one state where they are worse than those of the states before."""
    broken = np.flatnonzero(own[:, 1] >= 0)
    fresh, before = rank[own[broken, 1]], worst[broken, 1]
    old = np.where(before >= 0, rank[before], np.inf)
    worse = (fresh < old) | ((fresh == old) & (real[broken, 1] < measures[broken, 1]))
    chosen = broken[worse]
    worst[chosen, :2], worst[chosen, 2] = own[chosen], state
    measures[chosen] = real[chosen]


def _violations(
    blocks: Sequence[tuple[Ints, Ints, Floats]],
    curves: Sequence[Sequence[Catenary]],
    numbers: Floats,
    point_sd: float,
) -> Violations:
    """Violations of all blocks, with their probabilities."""
    none = (np.empty(0, np.int64), np.empty((0, 3), np.int64), np.empty((0, 6)))
    point, worst, real = map(np.concatenate, zip(none, *blocks, strict=True))
    wire, rule, state = worst.T
    measure, ratio, space, vertical, flat, u = real.T
    sd = clearance_sd(curves, state, wire, u, point_sd)
    probability = np.asarray(ndtr((numbers[rule, 1] - measure) / sd))
    return Violations(
        point, wire, rule, state, measure, ratio, space, vertical, flat, u, sd, probability
    )


def _farthest(rules: Sequence[Rule], kind: str) -> tuple[float, float]:
    """Distances in space and in plan beyond which no rule can be broken by points of a kind."""
    own = [rule for rule in rules if rule.holds_for(kind)]
    return (
        max((r.threshold for r in own if r.direction == "3-D"), default=0.0),
        reach_of([r for r in own if r.direction != "3-D"]) * 1.001,
    )


def clearance_sd(
    curves: Sequence[Sequence[Catenary]], state: Ints, wire: Ints, u: Floats, point_sd: float
) -> Floats:
    """Standard deviation of distances from wires at u, from those of wire heights and points.

    A wire whose uncertainty is not known counts as exact.
    """
    square = np.full(len(u), max(point_sd, 1e-6) ** 2)
    number = state * len(curves[0]) + wire
    for one in distinct(number).tolist():
        here = number == one
        curve = curves[one // len(curves[0])][one % len(curves[0])]
        sigma = curve.height_sigma(u[here])
        square[here] += np.where(np.isfinite(sigma), sigma, 0.0) ** 2
    return np.asarray(np.sqrt(square))


def fall_in(
    tops: Floats, height: Floats, curves: Sequence[Sequence[Catenary]], *, ctx: Context = QUIET
) -> tuple[Floats, Ints, Ints, Floats]:
    """Distance from each tree to the wires if it falls towards them; below zero if it reaches one.

    A tree falls about its foot, right below its top, so its top sweeps a circle as wide as it is
    high.

    Parameters
    ----------
    tops : array of shape (n, 3), metres
    height : array of shape (n,), metres

    Returns
    -------
    arrays of shape (n,)
        Distance of the nearest wire from the foot less the height, its index and state, and u.
        Infinite and -1 where no wire is as near as the highest of the trees is high.
    """
    near = WireLattice.of(curves, float(height.max(initial=0.0)))
    foot = np.ascontiguousarray(tops[:, 2] - height)
    left, u = np.full(len(tops), np.inf), np.zeros(len(tops))
    wire, state = np.full(len(tops), -1, np.int64), np.zeros(len(tops), np.int64)
    for number, wires in enumerate(map(rows_of, curves)):
        own, real = np.empty(len(tops), np.int64), np.empty((len(tops), 2))

        def work(
            first: int, last: int, wires: Floats = wires, own: Ints = own, real: Floats = real
        ) -> None:
            kernels.falls(
                first,
                last,
                tops,
                foot,
                near.lattice,
                near.starts,
                near.candidates,
                wires,
                own,
                real,
            )

        in_blocks(
            work,
            len(tops),
            MEASURED_BLOCK,
            ctx.part(number / len(curves), (number + 1) / len(curves)),
        )
        less = real[:, 0] - height < left
        left[less], wire[less] = (real[:, 0] - height)[less], own[less]
        state[less], u[less] = number, real[less, 1]
    return left, wire, state, u
