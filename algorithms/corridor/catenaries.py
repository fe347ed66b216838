"""Catenaries from points that are known to be wire, one per conductor and span.

The vertical plane of a wire holds a catenary, z = z0 + c (cosh((u - u0) / c) - 1), which wind may
swing about the line between its ends.

References
----------
Chan, T. O. and Lichti, D. D. (2011). 3D catenary curve fitting for geometric calibration. ISPRS
Archives XXXVIII-5/W12, 259-264: equations 2 and 3.
Munir, N., Awrangjeb, M. and Stantic, B. (2019). Extraction of high-voltage power lines from LiDAR
data: individual wires of bundles by their cross-section.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from algorithms.corridor import _columns as columns
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._curves.trace import Airborne, uncrowded
from algorithms.corridor._extraction.errors import with_common_errors
from algorithms.corridor._extraction.follow import follow, tolerances
from algorithms.corridor._extraction.layers import wire_layer
from algorithms.corridor._extraction.missed import warn_of_missed, warn_of_scatter, with_gaps
from algorithms.corridor._extraction.swung import warn_of_swung
from algorithms.shared import parameters
from algorithms.shared.ground import is_withheld
from algorithms.shared.lowest import require_finite
from algorithms.shared.strips import strips_of
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Table, Vector
from toolbox.declare import ClassList, outputs, param, sink, source, tool

UNCROWDED_DENSITY = 100.0  # points per square metre: everything is uncrowded
GROUND_BELOW = 20.0  # metres under the lowest point, where the ground may be


@tool(
    "corridor.catenaries",
    title="Fit catenaries",
    tags=(
        "power",
        "line",
        "wire",
        "conductor",
        "sag",
        "span",
        "catenary",
    ),
)
class CorridorCatenaries:
    """Fit one catenary to every conductor of every span.

    The points of wires must be classified, by corridor.extract or otherwise; of a cloud without
    classes all points are taken. Subconductors of a bundle are told apart where the points allow
    it. Points of towers help to find the ends of spans, but are not needed.

    The lines run in three dimensions from support to support, and carry the horizontal tension
    over weight c, the lowest point, sag, length, the swing by wind, the scatter of the points and
    the covariance of the fit. The formula stands under "A wire from its columns" on the page of
    power lines.
    """

    points: PointCloud = source("Points with classified wires")
    wire_classes: ClassList = param("Classes that are wire", default=ClassList([13, 14]))
    tower_classes: ClassList = param("Classes that are tower", default=ClassList([15, 16]))
    wire_gap: float = parameters.wire_gap()
    wire_tolerance: float | None = parameters.wire_tolerance()

    @outputs
    class Outputs:
        wires: Vector = sink("One line per conductor and span", columns=columns.WIRES)
        spans: Table = sink("The same as a table, one row per conductor and span")
        span_count: int = sink("Spans found", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """No class is that of wires and of towers at once."""
        if both := set(self.wire_classes) & set(self.tower_classes):
            yield "tower_classes", f"must not be among wire_classes, got {ClassList(both)} in both"

    def halo(self) -> float:
        """Infinite, as spans may be of any length."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> CorridorCatenaries.Outputs:
        """Follow the wires, and fit them."""
        cloud = self.points
        use = ~is_withheld(cloud)
        tower = np.zeros(len(cloud), bool)
        if "classification" in cloud:
            tower = use & np.isin(cloud["classification"], self.tower_classes)
            use &= np.isin(cloud["classification"], self.wire_classes)
        require_finite(cloud.xyz)
        metre = cloud.metre
        origin = np.floor(cloud.xyz[use].min(axis=0)) if use.any() else np.zeros(3)
        ctx.progress(0.0)
        index = np.flatnonzero(use | tower)
        air = Airborne.of((cloud.xyz[index] - origin) / metre)
        may = use[index][air.order]
        _, voxel = uncrowded(air.select(may), UNCROWDED_DENSITY)
        lowest = float(air.xyz[:, 2].min(initial=0.0))
        height = air.xyz[:, 2] - lowest + GROUND_BELOW
        widths = tolerances(self.wire_tolerance, metre)
        corridor = Corridor(
            air,
            height,
            may,
            widths[0],
            lambda x, y: lowest - GROUND_BELOW,
            lambda x, y: False,
            strip=strips_of(cloud, index[air.order]),
        )
        found, _ = follow(corridor, voxel, self.wire_gap / metre, widths, ctx)
        if not found:
            log.warning("no wire was found among %d points", np.count_nonzero(use))
        ctx.progress(1.0)
        found = with_common_errors(corridor, found)
        layer = wire_layer(with_gaps(corridor, found), origin, metre, cloud.crs)
        warn_of_missed(layer)
        warn_of_scatter(layer)
        warn_of_swung(found)
        return self.Outputs(
            wires=layer,
            spans=Table(layer.frame.drop(columns="geometry")),
            span_count=len({wire.span for wire in found}),
        )
