"""Levels of water bodies, each from all of its points.

How exact it is: docs/explanation/shoreline.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from algorithms.shared import parameters
from algorithms.shared.polygons import cells_within, polygons
from algorithms.shoreline._cells import LEVEL, CellGrid, grid
from algorithms.shoreline._evidence import STEP, Body
from algorithms.shoreline._level import lowest_mode
from algorithms.shoreline._returns import Returns
from algorithms.shoreline._surfaces import Water, with_levels
from algorithms.shoreline._water import (
    find_water,
    place_of,
    strip_levels,
    tell,
    warn_of,
    with_hidden_shore,
)
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Survey, Table, Vector
from toolbox.declare import ClassList, outputs, param, sink, source, tool


@tool(
    "shoreline.water_level",
    title="Water levels",
    tags=(
        "water",
        "level",
        "lake",
        "reservoir",
        "gauge",
    ),
)
class ShorelineWaterLevel:
    """Find the level of each water body from all of its points together.

    The water is found as by shoreline.extract, or given as polygons, such as a map. The level is
    the mean of the last returns far from the shore, within three standard deviations of their
    median: banks, boats and reeds above hardly move it, nor do errors below, however deep. Where
    too few pulses came back from the water, it is that of the foot of the bank: `basis` shore.

    One row per body tells the level, its standard error, the half width of its 95 % interval and
    the deviation of single points, all in the unit of the data. The interval covers noise and
    waves, and differences between strips (`strip_difference`, `strip_levels`) if the points name
    their strips (point_source_id), as of flights on different days. It does not cover what all
    points have in common: errors of positioning and of the height system. A surface that is no
    level is told by its slope and fall: a river. What only its level speaks for, as for ice or a
    square, is left out unless `level_alone` is set: see shoreline.extract.
    """

    points: PointCloud | Survey = source("Points of the survey, classified or not")
    water: Vector | None = source(
        "Polygons of water, instead of finding it", default=None, shapes="polygon"
    )
    min_area: float = param(
        "Smallest body to find", default=100.0, unit="m2", gt=0, label="Smallest body of water"
    )
    level_alone: bool = param(
        "Give bodies, too, that are known by their level alone, as ice may be",
        default=False,
        label="Bodies known by their level alone",
    )
    water_classes: ClassList | None = param("Classes that are water, if known", default=None)
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        levels: Table = sink("One row per body, the largest first", label="Water levels")
        level: float | None = sink("Level of the largest body", unit="m")
        level_error: float | None = sink("Its standard error within the survey", unit="m")
        level_interval: float | None = sink(
            "Uncertainty of the level within the survey (95 %)", unit="m"
        )

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have a classification if classes are used."""
        if self.water_classes and "classification" not in self.points.names:
            yield "water_classes", f"{self.points.name} has no classification"

    def halo(self) -> float:
        """Infinite, as a body may be of any size."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> ShorelineWaterLevel.Outputs:
        """Find the bodies and their levels."""
        points = Returns.of(self.points, self.ignore, self.water_classes, ctx.part(0.0, 0.4))
        found: list[Water] = []
        cells = None
        if not len(points):
            log.warning("points: there are none, and no water")
        elif self.water is None:
            cells, found = find_water(
                points, self.min_area, level_alone=self.level_alone, ctx=ctx.part(0.4, 1.0)
            )
            found = _numbered(cells, found)
            tell(cells, found)
            warn_of(cells, found)
        else:
            cells = grid(points, ctx.part(0.4, 0.7))
            bodies = list(on_polygons(cells, polygons(self.water, "water")))
            levels = with_levels(points, cells, bodies, ctx.part(0.7, 1.0), two_days=True)
            found = _numbered(cells, [with_hidden_shore(cells, one) for one in levels])
            warn_of(cells, found)
        rows = [row_of(cells, number, one) for number, one in enumerate(found, 1) if cells]
        return self.Outputs(
            levels=Table.from_rows(rows),
            level=found[0].level.height if found else None,
            level_error=found[0].level.error if found else None,
            level_interval=found[0].level.interval if found else None,
        )


def _numbered(cells: CellGrid, found: Sequence[Water]) -> list[Water]:
    """Waters with the numbers and the areas that the table has."""
    return [
        replace(one, number=number, area=len(one.body.cells) * cells.area)
        for number, one in enumerate(found, 1)
    ]


def on_polygons(cells: CellGrid, shapes: Any) -> Iterator[Body]:
    """Bodies from the cells on each polygon and at its edge, the largest polygon first.

    Parameters
    ----------
    cells : see :func:`algorithms.shoreline._bodies.grid`
    shapes : polygons
    """
    for k in np.argsort(-shapely.area(shapes), kind="stable"):
        rows, cols = cells_within(shapes[k].buffer(cells.lattice.cell), cells.lattice)
        some = rows * cells.lattice.cols + cols
        heights = cells.low.ravel()[some]
        heights = heights[np.isfinite(heights)]
        if not len(heights):
            log.warning("water: there are no points on the polygon at %s", shapes[k].centroid.wkt)
            continue
        level = cells.base + lowest_mode(heights, STEP * cells.metre)
        yield Body(some, level, LEVEL, math.nan, math.nan, "polygon")


def row_of(cells: CellGrid, number: int, water: Water) -> dict[str, Any]:
    """Table row of a body."""
    level, metre = water.level, cells.metre
    x, y = place_of(cells, water)
    return {
        "body": number,
        "x": round(x, 2),
        "y": round(y, 2),
        "area": round(len(water.body.cells) * cells.area / metre**2, 1),
        "level": round(level.height, 4),
        "standard_error": round(level.error, 4),
        "interval": round(level.interval, 4),
        "strip_difference": round(level.strips, 4),
        "strip_levels": strip_levels(level),
        "deviation": round(level.sigma, 4),
        "points": level.points,
        "basis": level.basis,
        "slope": round(float(np.hypot(*level.gradient)), 6),
        "fall": round(water.fall / metre, 3),
        "evidence": water.body.evidence,
    }
