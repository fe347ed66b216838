"""The surfaces of water bodies: their levels, or planes of rivers, from the points on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.lowest import cells_of
from algorithms.shared.water_surface import MOST_SIGMA, WIDEST
from algorithms.shoreline._bodies import open_water
from algorithms.shoreline._cells import CellGrid, around
from algorithms.shoreline._cover import covered
from algorithms.shoreline._evidence import DROP, VERY_DARK, Body, core_of
from algorithms.shoreline._level import (
    FEWEST,
    Level,
    edge_level,
    even_blocks,
    holding,
    level_of,
    side_by_side,
    two_levels_fit,
)
from algorithms.shoreline._returns import Returns
from toolbox.context import QUIET, Context

FOR_PLANE = 30  # points that a slope is found from
MOST_SAMPLES = 500_000  # points that tell the level of one body
FALL = 0.15  # m, from end to end of a body that is no lake
STRAIGHT = 0.5  # share of the variance of its surface that a plane explains

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Water:
    """A water body with its level.

    Attributes
    ----------
    body : its cells
    level : its surface
    fall, length : of its surface from end to end, in the unit of the data; 0 for a lake
    number, area : of its outline in layers and tables, in square units of the data; 0 before it
        is drawn
    """

    body: Body
    level: Level
    fall: float = 0.0
    length: float = 0.0
    number: int = 0
    area: float = 0.0


def lattice_place(cells: CellGrid, x: Any, y: Any) -> tuple[Any, Any]:
    """Fractional rows and columns of positions; cell centres have whole numbers."""
    lattice = cells.lattice
    return (lattice.north - y) / lattice.cell - 0.5, (x - lattice.west) / lattice.cell - 0.5


def with_levels(
    points: Returns,
    cells: CellGrid,
    bodies: Sequence[Body],
    ctx: Context = QUIET,
    *,
    two_days: bool = False,
) -> list[Water]:
    """Bodies with their levels, from the points on them.

    With `two_days` two levels side by side are looked for among all points on a lake, not only
    among those near its level.
    """
    label = np.zeros(cells.low.shape, np.int32)
    for number, body in enumerate(bodies, 1):
        label.ravel()[_sampled(cells, body)] = number
        if two_days:
            label.ravel()[_thinned(cells, core_of(cells, body.cells))] = number
    found, of, strip = [np.zeros((0, 3))], [np.zeros(0, np.int32)], [np.zeros(0, np.uint16)]
    for some in points.blocks():
        xyz = points.xyz(some)
        here = label.ravel()[cells_of(xyz, cells.lattice)]
        found.append(xyz[here > 0])
        of.append(here[here > 0])
        strip.append(points.strip[some][here > 0])
        ctx.progress(some.stop / len(points))
    xyz, which = np.concatenate(found), np.concatenate(of)
    order = np.lexsort((xyz[:, 1], xyz[:, 0], xyz[:, 2], which))
    xyz, strips = xyz[order], np.concatenate(strip)[order].astype(np.int64)
    ends = np.searchsorted(which[order], np.arange(len(bodies) + 2))
    of_body = [slice(*ends[k : k + 2]) for k in range(1, len(bodies) + 1)]
    each = zip(bodies, of_body, strict=True)
    return [
        _surface(cells, body, xyz[k], strips[k], points.step, two_days=two_days) for body, k in each
    ]


def _sampled(cells: CellGrid, body: Body) -> Ints:
    """Cells of a body whose points give its level: not at its edge, no more than needed."""
    if not _tells_level(cells, body):
        return np.union1d(body.cells, around(cells.lattice, body.cells, 1))
    return _thinned(cells, open_water(cells, body, 0.0, bright=True))


def _thinned(cells: CellGrid, some: Ints) -> Ints:
    """Some of the cells, evenly spread, if they hold more points than are needed."""
    step = max(1, math.ceil(cells.count.ravel()[some].sum() / MOST_SAMPLES))
    return np.asarray(some[(some // cells.lattice.cols + some % cells.lattice.cols) % step == 0])


def _tells_level(cells: CellGrid, body: Body) -> bool:
    """Whether enough came back from open water: boats, crowns and wires are far above its level.

    What is far below it counts: ground there tells that the level is none.
    """
    core = open_water(cells, body)
    above = cells.low.ravel()[core] + cells.base - body.level
    above -= body.tilt.at(*np.divmod(core, cells.lattice.cols))
    wet = above <= WIDEST * MOST_SIGMA * cells.metre
    return bool(cells.count.ravel()[core][wet].sum() >= FEWEST)


def _surface(
    cells: CellGrid, body: Body, xyz: Floats, strip: Ints, step: float, *, two_days: bool
) -> Water:
    """A body with its level, or with the plane of a river."""
    lattice, metre = cells.lattice, cells.metre
    centre = cells.centres(body.cells).mean(axis=0)
    flat = xyz.copy()
    flat[:, 2] -= body.tilt.at(*lattice_place(cells, xyz[:, 0], xyz[:, 1]))
    cell, core = cells_of(xyz, lattice), open_water(cells, body)
    if not _tells_level(cells, body):
        amid = np.isin(cell, body.cells)
        level = edge_level(flat, amid, body.level, metre, step)
    else:
        deep = np.isin(cell, core)
        level = level_of(flat, strip, deep, body.level, metre, step)
        if two_days and not level.strips:
            every = np.isin(cell, core_of(cells, body.cells))
            level = side_by_side(flat[every], level, DROP * metre, metre)
        if islands_hide(cells, body):
            low = np.isin(cell, open_water(cells, body, crests=False))
            troughs = level_of(flat, strip, low, body.level, metre)
            error = math.hypot(level.error, (level.height - troughs.height) / 2)
            level = replace(level, error=error)
        if parts := covered(flat, strip, cell, core, cells, level):
            level = replace(holding(level, parts), cover=parts)
    shift = level.shift(xyz[:, :2], strip)
    flat[:, 2] -= shift
    xyz = np.column_stack([xyz[:, :2], xyz[:, 2] - shift])
    near = abs(flat[:, 2] - level.height) <= max(3 * level.sigma, FALL * metre)
    if near.sum() < FOR_PLANE:
        return Water(body, level)
    d = xyz[near, :2] - centre
    design = np.column_stack([np.ones(len(d)), d])
    (_, east, north), *_ = np.linalg.lstsq(design, xyz[near, 2], rcond=None)
    slope = math.hypot(east, north)
    along = d @ (np.array([east, north]) / max(slope, 1e-12))
    length = float(np.subtract(*np.percentile(along, (99, 1))))
    if slope * length <= FALL * metre or level.parts or not is_plane(xyz[near]):
        return Water(body, level)
    flat[:, 2] = xyz[:, 2] - (xyz[:, :2] - centre) @ np.array([east, north])
    height = float(np.median(flat[near, 2]))
    tilted = replace(level, height=height, gradient=(east, north), centre=(centre[0], centre[1]))
    return Water(body, tilted, slope * length, length)


def is_plane(xyz: Floats) -> bool:
    """Whether a plane explains a surface, and better than two levels do.

    Points scatter by waves, which may be as high as a river falls: means of blocks are compared.
    """
    blocks = even_blocks(xyz[:, :2])
    means = np.array([xyz[some].mean(axis=0) for some in blocks])
    z = means[:, 2] - means[:, 2].mean()
    design = np.column_stack([np.ones(len(z)), means[:, :2] - means[:, :2].mean(axis=0)])
    plane = design @ np.linalg.lstsq(design, z, rcond=None)[0]
    return bool(plane.var() > STRAIGHT * z.var() and not two_levels_fit(z, plane))


def islands_hide(cells: CellGrid, body: Body) -> bool:
    """Whether islands of a cell or two may be among the waves, and not even brightness tells."""
    return body.rough(cells.metre) and body.dark < VERY_DARK
