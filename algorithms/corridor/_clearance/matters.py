"""The few points of a cloud or survey that decide the clearances of a line.

Most points are ground. Of these count only those that break a rule, or are the nearest of all to a
wire; a few more show in drawings where the ground is. So the points of a long line fit in memory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._clearance.distances import TAKES_NO_PART, find_violations
from algorithms.corridor._clearance.rest import sweep
from algorithms.corridor._clearance.rules import OBJECTS, Rule
from algorithms.corridor._clearance.surroundings import LineStates, kinds_of, near_wires
from algorithms.shared.lowest import lattice_around, lowest_points
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Survey

SURVEY_BLOCK = 1_000_000  # points that are processed at a time
SHOWN_CELL = 1.0  # metres; the lowest point of the ground in each is shown

Ints = NDArray[np.int64]


def what_matters(
    points: PointCloud | Survey,
    line: LineStates,
    rules: Sequence[Rule],
    *,
    classes: Mapping[str, Sequence[int]],
    ignore: Sequence[int],
    reach: float,
    measured: float,
    ctx: Context = QUIET,
) -> PointCloud:
    """Points that give the same clearances as all points do, in their original order.

    Parameters
    ----------
    points : with HeightAboveGround; a survey is read batch by batch
    classes, ignore, reach : see `surroundings_of`
    measured : to the side of the wires up to which clearances are measured, metres
    """

    def matters(cloud: PointCloud, ctx: Context = QUIET) -> PointCloud:
        """Points of a batch near the wires, those that are only counted, and ground as needed."""
        kind, _ = kinds_of(cloud, classes, ignore)
        keep = kind == TAKES_NO_PART
        near = near_wires(cloud, line, reach)
        low = kind[near] >= len(OBJECTS)
        keep[near[~low]] = True
        ground = near[low]
        keep[ground[_telling(cloud, line, rules, ground, kind[ground], measured, ctx)]] = True
        return cloud.select(keep)

    if isinstance(points, PointCloud):
        return matters(points, ctx)
    chosen = [matters(batch) for batch in points.batches(SURVEY_BLOCK, ctx=ctx.part(0.0, 0.9))]
    return matters(points.template.filled(chosen, sum(map(len, chosen))), ctx.part(0.9, 1.0))


def _telling(
    cloud: PointCloud,
    line: LineStates,
    rules: Sequence[Rule],
    ground: Ints,
    kind: NDArray[np.int8],
    measured: float,
    ctx: Context,
) -> Ints:
    """Indices of ground points that break a rule, are the nearest to a wire, or are drawn."""
    if not len(ground):
        return ground
    places = cloud.xyz[ground]
    xyz = (places - line.origin) / cloud.metre
    states = [*line.curves, *line.rest]
    found, least = find_violations(xyz, kind, states, rules, reach=measured, point_sd=0.0, ctx=ctx)
    between = np.flatnonzero(np.isfinite(sweep(xyz, kind, line.rest, reach=measured)[1]))
    use = np.ones(len(ground), bool)
    shown = lowest_points(places, use, lattice_around(places, SHOWN_CELL * cloud.metre), QUIET)
    nearest = least.point[least.point >= 0]
    return np.concatenate([found.point, nearest, between, shown[shown >= 0]])
