"""How many points are how near to the wires, and which plants are too low to be objects.

Muş (2019) counts the points of a corridor at less than 20 m and at 20 to 30 m from the wires. Here
that is done for points of objects, whatever the rules.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._clearance.distances import (
    TAKES_NO_PART,
    Violations,
    find_violations,
    nearest_wires,
)
from algorithms.corridor._clearance.objects import groups
from algorithms.corridor._clearance.rules import KINDS, OBJECTS, SEVERITIES, Rule
from algorithms.corridor._clearance.surroundings import LineStates, Surroundings
from toolbox.context import QUIET, Context

ZONES = (20.0, 30.0)  # metres, where the two risk zones of the study end
ZONE_COLUMNS = ("points_0_20", "points_20_30")

Ints = NDArray[np.int64]


def count_in_zones(
    surroundings: Surroundings, line: LineStates, ctx: Context = QUIET
) -> NDArray[np.int64]:
    """Number of points of objects in each zone, array of shape (states, wires, kinds, zones).

    Each point counts once, at the wire that is nearest to it in space.
    """
    kind = surroundings.kind
    objects = np.where(kind < len(OBJECTS), kind, TAKES_NO_PART)
    shape = (len(line.wire), len(KINDS), len(ZONES))
    counts = np.zeros((len(line.states), *shape), np.int64)
    for number, curves in enumerate(line.curves if line.spans else []):
        part = ctx.part(number / len(line.curves), (number + 1) / len(line.curves))
        space, wire = nearest_wires(surroundings.xyz, objects, curves, reach=ZONES[-1], ctx=part)
        near = np.flatnonzero(space < ZONES[-1])
        zone = np.searchsorted(ZONES, space[near], side="right")
        cell = np.ravel_multi_index((wire[near], kind[near], zone), shape)
        counts[number] = np.bincount(cell, minlength=counts[number].size).reshape(shape)
    return counts


def too_low(
    surroundings: Surroundings,
    line: LineStates,
    rules: Sequence[Rule],
    found: Violations,
    *,
    reach: float,
    gap: float,
    fewest: int,
    ctx: Context = QUIET,
) -> tuple[list[str], int]:
    """Severities of objects, and number of points, that would be listed if they were not low.

    Parameters
    ----------
    found : what the other points break
    reach : as in `find_violations`, metres
    gap, fewest : as in `objects_of`
    """
    low = np.flatnonzero(surroundings.low >= 0)
    if not len(low) or not line.spans:
        return [], 0
    xyz, kind = surroundings.xyz, surroundings.low
    more, _ = find_violations(
        xyz[low], kind[low], line.curves, rules, reach=reach, point_sd=0.0, ctx=ctx
    )
    mine = low[more.point]
    points = np.concatenate([mine, found.point])
    kinds = np.concatenate([kind[mine], surroundings.kind[found.point]]).astype(np.int64)
    group = groups(xyz[points], kinds, gap)
    size = np.bincount(group)
    other = np.bincount(group[len(mine) :], minlength=len(size))
    worst = np.full(len(size), len(SEVERITIES))
    rank = np.array([SEVERITIES.index(rule.severity) for rule in rules], np.int64)[more.rule]
    np.minimum.at(worst, group[: len(mine)], rank)
    alone = worst[(other == 0) & (size >= fewest)]
    return [SEVERITIES[k] for k in alone], len(mine)
