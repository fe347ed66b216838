"""Wires and towers from an unclassified cloud: classes of their points, and catenaries.

A wire is what stands alone in the air and hangs in an arc. Straight pieces of such points are
followed along parabolas, across gaps. All wires of a line are cut into arcs at the same chainages,
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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor import _columns as columns
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._curves.trace import Airborne, uncrowded
from algorithms.corridor._extraction.drops import with_drops
from algorithms.corridor._extraction.errors import with_common_errors
from algorithms.corridor._extraction.follow import follow, tolerances
from algorithms.corridor._extraction.ground import elevation
from algorithms.corridor._extraction.labels import DOUBTFUL, labelled, none_labelled
from algorithms.corridor._extraction.layers import tower_layer, wire_layer
from algorithms.corridor._extraction.missed import (
    warn_of_bodiless_supports,
    warn_of_edges,
    warn_of_left_out,
    warn_of_missed,
    warn_of_open_ends,
    warn_of_scatter,
    warn_of_unseen_supports,
    warn_of_unsure_places,
    with_gaps,
)
from algorithms.corridor._extraction.points import CorridorPoints
from algorithms.corridor._extraction.spans import Wire, nearest_wires
from algorithms.corridor._extraction.strays import strays_of
from algorithms.corridor._extraction.supports import Support
from algorithms.corridor._extraction.swung import warn_of_swung
from algorithms.corridor._extraction.towers import Tower, dressed
from algorithms.corridor._settings import SETTINGS
from algorithms.shared import parameters
from algorithms.shared.ground import taking_part
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Vector
from toolbox.declare import ClassList, outputs, param, show, sink, source, tool


@tool(
    "corridor.extract",
    title="Find power lines",
    tags=(
        "power",
        "line",
        "wire",
        "tower",
        "pylon",
        "conductor",
        "corridor",
        "extract",
    ),
)
class CorridorExtract:
    """Find the wires and towers of power lines in a raw point cloud.

    Conductors become class 14, towers and poles with their insulators class 15; points that had a
    class of a line (13 to 16) and are not found become 1, all others keep their class. The
    attributes wire_id, span_id and tower_id say to which they belong, 0 for none; a wire keeps its
    number from span to span. A conductor that wind swung between two flights has one number and two
    curves, one for each position. Nothing but coordinates is needed, and lines of any voltage are
    found together: the ground is found first, or taken from the classes given. Of points that have
    HeightAboveGround that is the height, unless classes are given.

    `wires` has one catenary per conductor and span, as a line in three dimensions and, under "A
    wire from its columns" on the page of power lines, as a formula; `towers` one point per tower,
    at its foot. A point near several wires, as of a bundle, belongs to the nearest. A span needs
    the whole of its wires, so the tool looks at the whole cloud; corridor.candidates chooses the
    points that it needs of a large one.
    """

    points: PointCloud = source("Points of a corridor, with the ground below the line")
    ground_classes: ClassList | None = param(
        "Classes that are ground; without them the ground is found", default=None
    )
    min_height: float = param(
        "Lowest conductor above the ground",
        default=parameters.MIN_HEIGHT,
        unit="m",
        ge=1.0,
        le=50.0,
        label="Lowest conductor",
    )
    wire_gap: float = parameters.wire_gap()
    wire_tolerance: float | None = parameters.wire_tolerance()
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        classified: PointCloud = sink(
            "The same points with classes 14 and 15 and their numbers", label="Classified points"
        )
        towers: Vector = sink(
            "Feet of towers and poles, with height, arms and width",
            show=show.Classes("kind"),
            columns=columns.TOWERS,
        )
        wires: Vector = sink(
            "One catenary per conductor and span, with its covariance", columns=columns.WIRES
        )
        span_count: int = sink("Spans found", unit="1")
        tower_count: int = sink("Towers and poles found", unit="1")

    def halo(self) -> float:
        """Infinite, as spans and lines may be of any length."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> CorridorExtract.Outputs:
        """Find the power lines, and label their points."""
        cloud, use = self.points, taking_part(self.points, self.ignore)
        points = CorridorPoints.of(cloud, use, self.ground_classes, ctx.part(0.0, 0.4))
        found = followed(
            points,
            min_height=self.min_height / cloud.metre,
            max_gap=self.wire_gap / cloud.metre,
            tolerances=tolerances(self.wire_tolerance, cloud.metre),
            ctx=ctx.part(0.4, 0.95),
        )
        line, corridor = finished(points, *found), found[0]
        ctx.progress(1.0)
        if not line.wires:
            points.warn_of_no_line()
        wires = wire_layer(line.wires, points.origin, cloud.metre, cloud.crs)
        warn_of_missed(wires)
        warn_of_swung(line.wires)
        warn_of_left_out([*corridor.left_out, *corridor.tied], points.origin, cloud.metre)
        towers = tower_layer(
            line.towers, line.wires, line.strings, points.origin, cloud.metre, cloud.crs
        )
        warn_of_unseen_supports(towers)
        warn_of_unsure_places(towers)
        warn_of_bodiless_supports(towers)
        warn_of_scatter(wires)
        warn_of_open_ends(line.wires, points.seen, points.origin, cloud.metre)
        warn_of_edges(points, line.labels)
        return self.Outputs(
            classified=labelled(cloud, use, points.index, line.labels),
            towers=towers,
            wires=wires,
            span_count=len({wire.span for wire in line.wires}),
            tower_count=len(line.towers),
        )


@dataclass(frozen=True)
class PowerLine:
    """Power lines found among n points, with the labels of their points.

    Attributes
    ----------
    labels : of the points: wire_id, span_id and tower_id from 1, 0 for none, and confidence
    wires, towers : in metres from the origin of the points
    strings : length of the insulators by which wires pull at each tower, metres
    """

    labels: Mapping[str, NDArray[Any]]
    wires: Sequence[Wire] = ()
    towers: Sequence[Tower] = ()
    strings: Sequence[float] = ()


def followed(
    points: CorridorPoints,
    *,
    min_height: float = parameters.MIN_HEIGHT,
    max_gap: float = parameters.WIRE_GAP,
    tolerances: Sequence[float] | None = None,
    ctx: Context = QUIET,
) -> tuple[Corridor, list[Wire], list[Support]]:
    """The corridor of points, and the wires and supports of power lines in it.

    Parameters
    ----------
    min_height, max_gap : `min_height` and `wire_gap` of :class:`CorridorExtract`, metres
    tolerances : at each of which wires are followed, metres
    ctx : progress and cancellation
    """
    ctx.progress(0.0)
    air, height = points.air, points.height[points.own]
    may = height > min_height
    alone, voxel = uncrowded(air.select(may), points.density)
    may[may] = alone
    ctx.progress(0.1)
    ground = elevation(points.xyz, points.height)
    floor = Airborne.of(points.xyz[points.height <= SETTINGS.points.off_ground])
    widths = tolerances or SETTINGS.lines.tolerances
    corridor = Corridor(
        air,
        height,
        may,
        widths[0],
        ground,
        points.seen,
        floor,
        points.density,
        strip=points.strip,
    )
    return corridor, *follow(corridor, voxel[alone], max_gap, widths, ctx.part(0.1, 0.9))


def finished(
    points: CorridorPoints, corridor: Corridor, wires: Sequence[Wire], supports: Sequence[Support]
) -> PowerLine:
    """The power lines of the wires and supports that were found among points."""
    line = PowerLine(none_labelled(len(points.index)))
    if not wires:
        return line
    wires, towers, strings = dressed(corridor, wires, supports)
    wires = with_drops(corridor, wires, supports)
    wires = with_common_errors(corridor, wires)
    line = replace(line, wires=with_gaps(corridor, wires), towers=towers, strings=strings)
    label_points(line, corridor, points.own)
    return line


def label_points(line: PowerLine, corridor: Corridor, own: NDArray[np.int64]) -> None:
    """Enter the labels of the points of wires and towers; `own` are the points in the air."""
    tower, confidence = line.labels["tower_id"], line.labels["confidence"]
    which, share = nearest_wires(corridor, line.wires)
    label_wires(line, own, which, 1 - 0.5 * share**2)
    for number, one_tower in enumerate(line.towers, start=1):
        points = own[one_tower.points]
        points = points[line.labels["wire_id"][points] == 0]
        tower[points] = number
        confidence[points] = 0.5 + 0.5 * one_tower.support.body
    stray = strays_of(corridor, line.wires, (which >= 0) | (tower[own] > 0))
    label_wires(line, own, stray, np.full(len(own), DOUBTFUL))


def label_wires(
    line: PowerLine, own: NDArray[np.int64], which: NDArray[np.int64], sure: NDArray[np.float64]
) -> None:
    """Enter the labels of the points of wires: `which` wire each is of, -1 for none."""
    on_it = which >= 0
    points, which = own[on_it], which[on_it]
    line.labels["wire_id"][points] = np.array([one.wire for one in line.wires])[which]
    line.labels["span_id"][points] = np.array([one.span for one in line.wires])[which]
    line.labels["confidence"][points] = sure[on_it]
