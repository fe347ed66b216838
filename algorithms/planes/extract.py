"""Planes of a cloud, such as the walls of a house front scanned from the street.

The search: algorithms/planes/_search.py. What it does and how good it is:
docs/explanation/planes.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Literal

import geopandas
import numpy as np
from numpy.typing import NDArray

from algorithms.planes import _columns as columns
from algorithms.planes import _parameters as options
from algorithms.planes._fronts import (
    FRONT_COLUMNS,
    STOREY,
    Front,
    elevation,
    front_numbers,
    fronts_of,
    outlines,
)
from algorithms.planes._outlines import drawn
from algorithms.planes._regular import regular
from algorithms.planes._search import Orientation, Rules, steepness
from algorithms.planes._segment import segment
from algorithms.shared import parameters
from algorithms.shared.ground import is_withheld
from toolbox.context import QUIET, Context, log, setting_name
from toolbox.data import PointCloud, Vector
from toolbox.data.crs import local_like
from toolbox.declare import Share, outputs, param, show, sink, source, tool

NAME, FRONT = "plane_id", "front_id"
TALLEST = 1000.0  # metres: no building is as high; the tallest is 828 m
BELOW = 2.0  # tolerance over the noise below which planes fall to pieces


@tool(
    "planes.extract",
    title="Extract planes",
    tags=(
        "plane",
        "ransac",
        "segmentation",
        "facade",
        "roof",
        "wall",
    ),
)
class PlanesExtract:
    """Find all planes of a cloud, one after the other (sequential RANSAC), and their outlines.

    Points are sorted into the cells of an octree, each with the plane of its points. Three cells
    that lie near each other are drawn; the plane through them must agree with their normals, and
    is scored by all cells within `tolerance` whose normal is within `max_angle` of its own. The
    number of draws follows from the share of draws that would hit the best plane so far,
    N = log(1 - confidence) / log(1 - share), worked out anew with each better plane. The plane is
    fitted to its points by least squares, they are taken out, and the next is looked for.

    A plane is one patch, without gaps wider than about `plane_gap`, unless `connected` is off. Then
    each point goes to the plane within the tolerance of which it is, and to which it is nearest for
    the spread of that plane, or to none. The last fit leaves out points along edges with other
    planes, and lets those that are far away count less. Planes are numbered by their points, the
    one with the most is 1.

    A tolerance of auto is 3.3 times the noise of the scan, the standard deviation of the points
    about small planes. It is in the outputs, and a warning says when a tolerance is so small that
    planes fall to pieces. A gap of auto is four times the distance of neighbours where it is large,
    and at least three tolerances.

    With `regularise` planes that are parallel, or square to each other, but for `regular_angle` are
    made so, the larger one leading, as far as the root mean square distance of their points stays
    below half the tolerance. Those of one direction that lie within the tolerance of each other
    become one, however far apart. Points keep the plane that they were given.

    A front is an upright plane, at least 2.5 m wide and high, with all planes parallel to it within
    `front_depth`: pilasters, cornices, balconies and storeys that stand back. Its reference is the
    largest of them, for how much its points scatter, and `relief` is how far a plane stands before
    that, towards the side from which it was seen, or behind it (below 0).

    Outlines leave out what a circle of the diameter `plane_gap` without points covers. The
    elevation shows them in the coordinates of the largest upright plane, to the right and upwards
    from its lower left corner: that plane, and those that face the same way with their distance
    from it.

    A cloud without CRS has to be given its unit: --assume-crs local for metres, local:mm for
    millimetres.
    """

    points: PointCloud = source("Points of a scan, or of several put together")
    tolerance: float | Literal["auto"] = param(
        "Farthest point that belongs to a plane; auto by the noise", default="auto", unit="m", gt=0
    )
    max_angle: float = options.max_angle()
    min_points: int = options.min_points()
    min_extent: float = options.min_extent()
    plane_gap: float | Literal["auto"] = options.plane_gap()
    connected: bool = param("Split planes at gaps", default=True, label="Split planes at gaps")
    orientation: Orientation = options.orientation()
    orientation_angle: float = options.orientation_angle()
    regularise: bool = param(
        "Make planes parallel, perpendicular or coplanar where they almost are",
        default=False,
        label="Regularise planes",
    )
    regular_angle: float = param(
        "Angle by which such planes are off at most",
        default=2.0,
        unit="deg",
        gt=0,
        le=20,
        label="Angle of regular planes",
    )
    front_depth: float = options.front_depth()
    confidence: float = param(
        "Probability that the best plane is among those drawn", default=0.99, unit="1", gt=0, lt=1
    )
    max_trials: int = param("Draws at most", default=1_000_000, unit="1", ge=1, label="Most trials")
    seed: int = parameters.seed()

    @outputs
    class Outputs:
        segmented: PointCloud = sink(
            "The points with plane_id and front_id, 0 for none",
            show=show.Planes(NAME),
            label="Points with planes",
        )
        planes: Vector = sink(
            "Outline of each plane in space, with its numbers", columns=columns.PLANES
        )
        fronts: Vector = sink(
            "Outline of each front in space, with its size and relief", columns=columns.FRONTS
        )
        elevation: Vector = sink(
            "Outlines seen square to the largest upright plane, in its plane",
            show=show.Classes("kind", columns.LOOKS, apart=True),
            columns=columns.PLANES,
        )
        count: int = sink("Planes", unit="1")
        front_count: int = sink("Fronts", unit="1")
        share: float = sink("Share of points on planes", unit="1")
        noise: float = sink("Standard deviation of points about small planes", unit="m")
        used_tolerance: float = sink("Farthest point that belongs to a plane", unit="m")
        used_gap: float = sink("Widest gap within a plane", unit="m")
        trials: int = sink("Draws that were made", unit="1")

        def in_words(self) -> str:
            """How many planes, and how much lies on them."""
            return (
                f"{self.count} planes hold {100 * self.share:.1f} % of the points; fronts, "
                f"{STOREY:g} m wide and high or more: {self.front_count}. Points lie within "
                f"{self.used_tolerance:.3f} m of their plane; their noise is {self.noise:.3f} m."
            )

        def not_looked_at(self) -> Iterator[str]:
            """Points on no plane."""
            if self.share < 1:
                yield f"{100 * (1 - self.share):.1f} % of the points lie on no plane."

    def halo(self) -> float:
        """Infinite, as planes are of any size."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> PlanesExtract.Outputs:
        """Find the planes and draw their outlines."""
        cloud, used = self.points, ~is_withheld(self.points)
        xyz = cloud.xyz if used.all() else cloud.xyz[used]
        found = segment(xyz, self._rules(), ctx=ctx.part(0.0, 0.7))
        tolerance, gap = found.rules.tolerance, found.rules.gap
        if tolerance < BELOW * found.noise:
            log.warning(
                "tolerance: %.3g m is less than %g times the noise of the scan, %.3g m; "
                "planes fall to pieces",
                tolerance / cloud.metre,
                BELOW,
                found.noise / cloud.metre,
            )
        if not found.planes:
            wanted = ("min_points", "min_extent", "plane_gap", "orientation")
            settings = [name for name in map(setting_name, wanted) if name]
            log.warning(
                "no plane was found; look at %s", ", ".join([*settings, "the unit of the points"])
            )
        if self.regularise:
            found = regular(xyz, found, math.radians(self.regular_angle))
        ids = np.zeros(len(cloud), np.int32)
        ids[used] = found.ids
        planes = drawn(cloud.xyz, ids, found.planes, gap / 2, ctx.part(0.7, 1.0))
        fronts = fronts_of(cloud.xyz, ids, found.planes, depth=self.front_depth, metre=cloud.metre)
        of_plane, relief = front_numbers(fronts, len(found.planes))
        self._warn_of_unit(np.append(0, of_plane)[ids] > 0)
        planes["front_id"], planes["relief"] = of_plane, relief
        shown = elevation(planes, found.planes, cloud.xyz, ids, cloud.metre)
        ctx.progress(1.0)
        return self.Outputs(
            segmented=cloud.with_attributes(
                {NAME: ids, FRONT: np.append(0, of_plane).astype(np.int32)[ids]},
                descriptions={NAME: "0 of none", FRONT: "0 of none"},
            ),
            planes=Vector(planes.set_crs(cloud.crs), name="planes", geometry_type="Polygon Z"),
            fronts=self._fronts(fronts, list(planes.geometry)),
            elevation=Vector(
                shown.set_crs(local_like(cloud.crs)), name="elevation", geometry_type="Polygon"
            ),
            count=len(found.planes),
            front_count=len(fronts),
            share=Share.of_points(ids > 0, cloud.core),
            noise=found.noise,
            used_tolerance=tolerance,
            used_gap=gap,
            trials=found.trials,
        )

    def _warn_of_unit(self, on_front: NDArray[np.bool_]) -> None:
        """Say so where points on fronts, a mask of shape (n,), reach higher than any building."""
        cloud = self.points
        high = float(np.ptp(cloud.xyz[on_front, 2])) / cloud.metre if on_front.any() else 0.0
        if high > TALLEST:
            log.warning(
                "the fronts are %.0f m high, more than any building: are the points in "
                "millimetres? They are read as %s; divide them by 1000, or give them a CRS with "
                "their unit",
                high,
                "metres" if cloud.metre == 1 else f"units of which {cloud.metre:g} are a metre",
            )

    def _fronts(self, fronts: list[Front], shapes: list[Any]) -> Vector:
        """Layer of the fronts."""
        rows = list(outlines(fronts, shapes))
        layer = geopandas.GeoDataFrame(
            [row for row, _ in rows],
            columns=FRONT_COLUMNS,
            geometry=[shape for _, shape in rows],
            crs=self.points.crs,
        )
        return Vector(layer, name="fronts", geometry_type="Polygon Z")

    def _rules(self) -> Rules:
        return Rules(
            tolerance=0.0 if self.tolerance == "auto" else self.tolerance,
            angle=math.radians(self.max_angle),
            gap=0.0 if self.plane_gap == "auto" else self.plane_gap,
            min_points=self.min_points,
            min_extent=self.min_extent,
            steep=steepness(self.orientation, self.orientation_angle),
            connected=self.connected,
            confidence=self.confidence,
            max_trials=self.max_trials,
            seed=self.seed,
        )
