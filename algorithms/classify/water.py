"""Returns from water, by polygons that tell its surface.

References
----------
USGS (2024). Lidar Base Specification 2024 rev. A, classification: points on water are class 9.
LAS 1.4 R15 (ASPRS 2019), table 17: the classes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.ground import GROUND, OTHER, taking_part
from algorithms.shared.polygons import Polygons
from algorithms.shared.returns import SAME_PLACE, let_through
from algorithms.shared.water_surface import WaterSurface, surfaces
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Vector
from toolbox.declare import Share, outputs, sink, source, tool

WATER = np.uint8(9)
UNNAMED = [0, int(OTHER), int(GROUND)]  # classes of points that nobody has named otherwise

Mask = NDArray[np.bool_]


@tool(
    "classify.water",
    title="Classify water",
    tags=("water", "lake", "river", "hydro-flattening", "breakline", "polygon"),
)
class ClassifyWater:
    """Classify returns from water, by polygons of it that tell its surface.

    Last and single returns in the polygons become water (9) if they are no higher above its surface
    than returns from it scatter: three times the attribute `scatter`, as of shoreline.extract, or
    0.75 m, as on rough water, where a polygon has none. Below the surface, where there are neither
    banks nor boats, 0.75 m is the limit for all waters. The surface is that of
    surface.flatten_water: the attribute `level`, or between the heights of the vertices where
    `slope` is not 0, or no level is given.

    Only points that are not classified or ground (0, 1 and 2) become water. All other classes stay,
    and so do boats, reeds and bridges above the water. Ground (2) that lies deeper below it than
    the limit becomes 1, and is told: the terrain is level there. Nothing moves, and no terrain
    changes that was made before. The attribute confidence, where points have it, is
    1 on water.
    """

    points: PointCloud = source("Points to classify")
    water: Vector = source("Polygons of water, with level or heights", shapes="polygon")
    beneath: Vector | None = source(
        "Further polygons of water, as below bridges, with level or heights",
        shapes="polygon",
        default=None,
        label="Water below bridges",
    )

    @outputs
    class Outputs:
        classified: PointCloud = sink(
            "The same points, class 9 on water", label="Classified points"
        )
        became: int = sink("Points that became water (9)", unit="1", label="Points on water")
        ground_share: float = sink(
            "Share of points that are ground, without those on water", unit="1"
        )

        def in_words(self) -> str:
            """How many points became water, and how much is ground then."""
            if not self.became:
                return "No point became class 9 (water)."
            return (
                f"{self.became} points, last returns from the water, became class 9 (water); "
                f"{100 * self.ground_share:.1f} % of the points are ground in the end."
            )

    def halo(self) -> float:
        """As far as two returns are from each other that are one; see `let_through`."""
        return SAME_PLACE

    def run(self, ctx: Context = QUIET) -> ClassifyWater.Outputs:
        """Compare the last returns with the water below them."""
        cloud = self.points
        old = cloud["classification"] if "classification" in cloud else np.zeros(len(cloud), "u1")
        may = taking_part(cloud) & np.isin(old, UNNAMED)
        wet, sunk = np.zeros((2, len(cloud)), bool)
        wet[may], sunk[may] = self._on_water(cloud.xyz[may], ctx)
        wet &= ~let_through(cloud)
        sunk &= old == GROUND
        if sunk.any():
            log.warning(
                "%d points of ground lie deep below the water that they are in, which is no "
                "ground that was seen: they became 1",
                np.count_nonzero(sunk & cloud.core),
            )
        classes = np.where(wet, WATER, np.where(sunk, OTHER, old)).astype(np.uint8)
        made = {"classification": classes}
        if "confidence" in cloud:
            made["confidence"] = np.where(wet, 1, cloud["confidence"]).astype(np.float32)
        ctx.progress(1.0)
        return self.Outputs(
            classified=cloud.with_attributes(made),
            became=int(np.count_nonzero(wet & cloud.core)),
            ground_share=Share.of_points(classes == GROUND, cloud.core),
        )

    def _on_water(self, xyz: NDArray[np.float64], ctx: Context) -> tuple[Mask, Mask]:
        """True for positions near the surface of a water that they are in, and deep below one."""
        near, deep = np.zeros((2, len(xyz)), bool)
        layers = {"water": self.water} | ({"beneath": self.beneath} if self.beneath else {})
        every = [one for name, layer in layers.items() for one in surfaces(layer, name)]
        if not (every and len(xyz)):
            return near, deep
        inside = np.flatnonzero(Polygons.of(np.array([w.shape for w in every])).hold(xyz))
        for done, water in enumerate(every):
            ctx.progress(done / len(every))
            here = inside[_within_bounds(xyz[inside], water)]
            here = here[Polygons.of(np.array([water.shape])).hold(xyz[here])]
            above = xyz[here, 2] - water.at(xyz[here, 0], xyz[here, 1])
            on_it = water.holds(above, self.points.metre)
            near[here] |= on_it
            deep[here] |= ~on_it & (above < 0)
        return near, deep & ~near


def _within_bounds(xyz: NDArray[np.float64], water: WaterSurface) -> Mask:
    """True for positions in the rectangle around a water, shape (n,)."""
    west, south, east, north = water.shape.bounds
    x, y = xyz[:, 0], xyz[:, 1]
    return np.asarray((x >= west) & (x <= east) & (y >= south) & (y <= north))
