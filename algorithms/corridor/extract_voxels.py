"""Wires and towers from a raw cloud by voxels, step by step as in Muş (2019).

Points high above the ground are put into voxels. Those of little (or much) variance of height hold
straight lines, found by random samples, and grow together where their lines agree. A column of many
points above each other is a tower, and holds all points in its bounds. All points in the hull of
the wires are wire. Where the text leaves a step open, or cannot work as printed, the notes of the
functions in `_voxels` say what is done; docs/explanation/power-lines.md has all of it in a table.

References
----------
Muş, Elif (2019). MSc thesis on power line corridors in laser scans (in Turkish), Karadeniz
Technical University, Trabzon.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._curves.trace import uncrowded
from algorithms.corridor._extraction.follow import follow, tolerances
from algorithms.corridor._extraction.labels import LABEL_NUMBERS, labelled, none_labelled
from algorithms.corridor._extraction.layers import wire_layer
from algorithms.corridor._extraction.points import CorridorPoints
from algorithms.corridor._extraction.spans import Wire, nearest_wires
from algorithms.corridor._settings import SETTINGS
from algorithms.corridor._voxels.growing import GrowTo, SlopeTest, grown
from algorithms.corridor._voxels.hull import Hull
from algorithms.corridor._voxels.layers import (
    Found,
    Frame,
    hull_layer,
    tower_box_layer,
    voxel_layer,
)
from algorithms.corridor._voxels.towers import bounds_of, nearest, towers_among, within
from algorithms.corridor._voxels.voxels import Variance, Voxels, lines_in, trials
from algorithms.shared import parameters
from algorithms.shared.ground import taking_part
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Vector
from toolbox.declare import ClassList, outputs, param, show, sink, source, tool

TowerThreshold = Literal["repeated", "once"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@tool(
    "corridor.extract_voxels",
    title="Find power lines (voxels)",
    tags=(
        "power",
        "line",
        "wire",
        "tower",
        "pylon",
        "conductor",
        "voxel",
    ),
)
class CorridorExtractVoxels:
    """Find wires and towers in a raw point cloud by voxels, as a thesis published it.

    The method of Elif Muş (2019), to compare corridor.extract with. Points high above the ground
    are put into voxels; those of little variance of height hold lines, which grow together where
    they agree. Dense columns among them are towers, which hold all points in their bounds. Wires
    are all points in the hull of what has grown. Wires become class 14 and towers class 15, as
    corridor.extract classifies.

    Every number is a parameter with the value of the thesis; where it prints none, the help says
    so. `height` must be below the lowest wire, and above trees and roofs near the line: what hangs
    lower is not looked at. For the ground as in the thesis run ground.csf first, and give
    `ground_classes` 2.

    `wires` has the catenaries that are fitted to the points of wires, which the thesis does not do;
    a point on one of them has its wire_id and span_id, any other point of a wire has wire_id 1 and
    span_id 0. In `voxels`, density is in points per cubic metre and variance in square metres,
    whatever the unit of the data; so are volumes of `hull` in cubic metres.
    """

    points: PointCloud = source("Points of a corridor, with the ground below the line")
    ground_classes: ClassList | None = param(
        "Classes that are ground; without them the ground is found", default=None
    )
    height: float = param(
        "Shortest distance to the ground of points that are kept", default=20.0, unit="m", ge=1.0
    )
    voxel: float = param("Size of the voxels", default=3.0, unit="m", ge=0.5)
    variance: Variance = param(
        "Voxels to keep, by their variance of height: high as printed, low works",
        default="low",
        words={"low": "Low (works)", "high": "High (as printed)"},
    )
    line_tolerance: float = param(
        "Farthest that a point may be off the line of its voxel, or from the hull (not printed)",
        default=0.3,
        unit="m",
        gt=0,
        le=5,
    )
    certainty: float = param(
        "Probability that a random line of a voxel has no outlier (not printed)",
        default=0.99,
        unit="1",
        gt=0,
        lt=1,
    )
    outlier_share: float = param(
        "Share of the points of a voxel that may be off its line", default=0.6, unit="1", ge=0, lt=1
    )
    seed: int = parameters.seed()
    grow_to: GrowTo = param(
        "Voxels in which a line may go on: neighbours, or all ahead of it within voxel_gap",
        default="26",
        words={
            "6": "6 neighbours",
            "18": "18 neighbours",
            "26": "26 neighbours",
            "gap": "All ahead within the gap",
        },
    )
    voxel_gap: float = param(
        "Farthest voxel in which a line may go on; neighbours are nearer at the size printed",
        default=20.0,
        unit="m",
        gt=0,
    )
    slope_test: SlopeTest = param(
        "How lines are compared: by slopes as printed, or by the angle between them, which works",
        default="direction",
        words={"direction": "The angle between them", "slopes": "Slopes, as printed"},
    )
    slope_limit: float = param(
        "Largest difference of slopes, or tangent of the angle, of lines that agree",
        default=1.0,
        unit="1",
        gt=0,
    )
    group_voxels: int = param(
        "Fewest voxels that grow together to a wire (not printed)", default=5, unit="1", ge=1
    )
    tower_threshold: TowerThreshold = param(
        "Whether dense columns longer than tower_spacing are parted again, or once as printed",
        default="repeated",
        words={"repeated": "Again and again", "once": "Once, as printed"},
    )
    tower_spacing: float = param(
        "Shortest distance between two towers (not printed)", default=30.0, unit="m", gt=0
    )
    tower_ground: bool = param(
        "Whether the ground in the bounds of a tower is tower too, as printed", default=True
    )
    hull_radius: float | None = param(
        "Radius of the ball that cannot enter the concave hull (not printed); convex without it",
        default=20.0,
        unit="m",
        gt=0,
    )
    wire_gap: float = parameters.wire_gap()
    wire_tolerance: float | None = parameters.wire_tolerance()
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        classified: PointCloud = sink(
            "The same points with classes 14 and 15 and their numbers", label="Classified points"
        )
        voxels: Vector = sink(
            "Centroids of the voxels with their attributes, group and tower",
            show=show.Values("variance"),
        )
        hull: Vector = sink(
            "Faces of the hull of the wires, one feature per connected part",
            label="Hull of the wires",
        )
        towers: Vector = sink("Bounds of the towers, with their points and elevations")
        wires: Vector = sink("One catenary per conductor and span, with its covariance")
        span_count: int = sink("Spans found", unit="1")
        tower_count: int = sink("Towers found", unit="1")

    def halo(self) -> float:
        """Infinite, as spans and lines may be of any length."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> CorridorExtractVoxels.Outputs:
        """Find wires and towers by voxels, and catenaries through the wires."""
        cloud, use = self.points, taking_part(self.points, self.ignore)
        metre, index = cloud.metre, np.flatnonzero(use)
        points = CorridorPoints.of(cloud, use, self.ground_classes, ctx.part(0.0, 0.4))
        # Voxels begin at multiples of their size, wherever the points begin.
        frame = Frame(np.floor(points.origin / self.voxel) * self.voxel, metre, cloud.crs)
        xyz = (cloud.xyz[index] - frame.corner) / metre
        of_air = np.searchsorted(index, points.index[points.own])
        far = distance_to_ground(points, self.height / metre)
        high = far > self.height / metre
        found = self._found(xyz[of_air[high]], metre, ctx.part(0.4, 0.7))
        self._warn(points, found, far[high])

        labels = none_labelled(len(index))
        wire_id, span_id, tower_id = (labels[name] for name in LABEL_NUMBERS)
        tower = within(found.bounds, xyz)
        if not self.tower_ground:
            tower[np.isin(np.arange(len(index)), of_air, invert=True)] = 0
        tower_id[:] = tower
        wire_id[found.hull.hold(xyz, self.line_tolerance / metre) & (tower == 0)] = 1
        wires = self._catenaries(points, wire_id[of_air] > 0, metre, ctx.part(0.7, 1.0))
        for number, (wire, own) in enumerate(wires):
            wire_id[of_air[own]], span_id[of_air[own]] = wire.wire, wire.span
            ends = wire.curve.ends + (points.origin - frame.corner) / metre
            towers = nearest(found.bounds, ends, self.tower_spacing / metre / 2) - 1
            wires[number] = replace(wire, supports=(int(towers[0]), int(towers[1]))), own
        ctx.progress(1.0)
        return self.Outputs(
            classified=labelled(cloud, use, index, labels),
            voxels=voxel_layer(found, frame),
            hull=hull_layer(found.hull, frame),
            towers=tower_box_layer(found.bounds, xyz, tower, frame),
            wires=wire_layer([wire for wire, _ in wires], points.origin, metre, cloud.crs),
            span_count=len({wire.span for wire, _ in wires}),
            tower_count=len(found.bounds),
        )

    def _found(self, xyz: Floats, metre: float, ctx: Context) -> Found:
        """What the voxels of high points hold; xyz of shape (n, 3), metres."""
        voxels = Voxels.of(xyz, self.voxel / metre)
        kept = voxels.of_variance(self.variance)
        direction, share = lines_in(
            xyz,
            voxels,
            tolerance=self.line_tolerance / metre,
            tries=trials(self.certainty, self.outlier_share),
            seed=self.seed,
            ctx=ctx,
        )
        group = grown(
            voxels,
            direction,
            kept,
            grow_to=self.grow_to,
            gap=self.voxel_gap / metre,
            slope_test=self.slope_test,
            slope_limit=self.slope_limit,
            fewest=self.group_voxels,
        )
        tower = towers_among(
            voxels,
            group,
            spacing=self.tower_spacing / metre,
            repeated=self.tower_threshold == "repeated",
        )
        bounds = bounds_of(xyz, tower[voxels.of_point])
        wires = xyz[(group > 0)[voxels.of_point]]
        hull = Hull.of(
            wires[within(bounds, wires) == 0],
            None if self.hull_radius is None else self.hull_radius / metre,
            self.line_tolerance / metre,
        )
        return Found(voxels, kept, direction, share, group, tower, bounds, hull)

    def _catenaries(
        self, points: CorridorPoints, wire: Mask, metre: float, ctx: Context
    ) -> list[tuple[Wire, Ints]]:
        """Catenaries among the points of wires, with the points off the ground on each."""
        widths, height = tolerances(self.wire_tolerance, metre), points.height[points.own]
        corridor = Corridor(
            points.air,
            height,
            wire,
            widths[0],
            lambda x, y: 0.0,
            lambda x, y: False,
            strip=points.strip,
        )
        _, voxel = uncrowded(corridor.wires, 1.0)
        wires, _ = follow(corridor, voxel, self.wire_gap / metre, widths, ctx)
        if wire.any() and not wires:
            log.warning("no catenary was found among %d points of wires", np.count_nonzero(wire))
        which, _ = nearest_wires(corridor, wires)
        return [(one, np.flatnonzero(wire & (which == k))) for k, one in enumerate(wires)]

    def _warn(self, points: CorridorPoints, found: Found, far: Floats) -> None:
        """Log why no line was found, or that it seems to go on below the height.

        Parameters
        ----------
        far : distance to the ground of the points in voxels, metres
        """
        metre = self.points.metre
        height = self.height / metre
        if not len(points.height) or np.isnan(points.height).all():
            points.warn_of_no_line()
        elif not len(far):
            log.warning("no power line was found: no point is %g m from the ground", height)
        elif not found.group.any():
            log.warning(
                "no power line was found: of %d voxels with points %g m from the ground, no %d "
                "whose lines agree are next to each other",
                *(len(found.group), height, self.group_voxels),
            )
        elif cut := found.wires_down_to(height + self.line_tolerance / metre, far):
            log.warning(
                "%d of %d voxels of wires reach down to the height of %g m; what hangs below it "
                "was not looked at",
                *(cut, np.count_nonzero(found.group), height),
            )


def distance_to_ground(points: CorridorPoints, least: float) -> Floats:
    """Distance in space to the ground of the n points in the air, shape (n,), metres.

    That is the distance to the nearest point of the ground, as in the thesis; at most the height,
    as there may be no such point below a roof or a wood. Below a height of `least`, as of points
    without a height, it is the height itself, as the distance is no larger.
    """
    far = points.height[points.own].copy()
    ground = points.xyz[np.abs(points.height) <= SETTINGS.points.off_ground]
    high = np.flatnonzero(far > least)
    if len(ground) and len(high):
        away, _ = cKDTree(ground).query(points.air.xyz[high])
        far[high] = np.minimum(far[high], away)
    return far
