"""Ground filter without scene parameters: points near the terrain are ground.

How the terrain is found, with sources: :mod:`algorithms.shared.terrain`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algorithms.shared import parameters
from algorithms.shared.ground import NOWHERE, Candidates, Mask, Returns
from algorithms.shared.heights import HEIGHT
from algorithms.shared.lowest import cells_of
from algorithms.shared.plausible import tell_of_ground
from algorithms.shared.sections import LOOKED_AT, WIDEST, tell_of_wide
from algorithms.shared.strips import strips_of
from algorithms.shared.terrain import BEYOND, Terrain, find_terrain, height_above, verdict
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Raster
from toolbox.data.crs import vertical_unit
from toolbox.declare import ClassList, Memory, outputs, param, sink, source, tool

Singles = NDArray[np.float32]


@tool(
    "ground.classify",
    title="Classify ground",
    tags=(
        "ground",
        "filter",
        "dtm",
        "dem",
        "bare",
        "earth",
        "smrf-like",
        "smrf",
        "pmf",
        "terrain",
    ),
)
class GroundClassify:
    """Classify ground without having to know the scene: the filter to try first.

    Ground becomes class 2, all else class 1. Nothing has to be set: the filter takes sparse and
    dense data, cities, forests, slopes and quarries alike. Only halls longer than 140 m need
    `longest_building`; a warning says where there may be some. The attribute `confidence` says
    from 0 to 1 how far a point is from the other verdict, so that the doubtful ones can be looked
    at.

    Points of water, rail and road (9 to 11) count like all others and keep their class; wires,
    towers, bridges and other structures (13 to 17, 19) keep theirs and take no part. Without
    `keep_classes` they become 2 or 1, too. Class 2 is decided anew, also if it is named there.

    Takes 115 bytes per square metre of the bounding box and 30 bytes per point.
    """

    points: PointCloud = source("Points to classify")
    returns: Returns = parameters.ground_returns()
    ignore: ClassList | None = parameters.ignore()
    keep_classes: ClassList | None = parameters.keep_classes()
    longest_building: float = param(
        "Longest hall along the axes; islands between cliffs up to it are no ground, either",
        default=float(WIDEST),
        unit="m",
        ge=WIDEST,
        le=LOOKED_AT,
        label="Longest building",
    )
    heights: bool = param(
        "Also give the attribute HeightAboveGround, measured from the terrain",
        default=False,
        label="Height above ground too",
    )

    memory = Memory(point=200.0, area=100.0)  # measured: 135, 72

    @outputs
    class Outputs:
        classified: PointCloud = sink(
            "The same points, class 2 on ground, 1 elsewhere, confidence", label="Classified points"
        )
        ground: PointCloud = parameters.ground_points()
        surface: Raster = sink(
            "Elevation of the terrain, smoothed, empty 80 m and more from ground"
        )
        ground_share: float = parameters.ground_share()

        def in_words(self) -> str:
            """How much is ground, and that water is not looked for here."""
            return (
                "The ground filter, which does not look for water, found "
                f"{100 * self.ground_share:.1f} % of the points to be ground (class 2)."
            )

    def halo(self) -> float:
        """Distance beyond which the terrain does not change labels; measured, see the page."""
        return self.longest_building + BEYOND

    def run(self, ctx: Context = QUIET) -> GroundClassify.Outputs:
        """Find the terrain, and compare the points with it."""
        cloud = self.points
        candidates = Candidates.of(cloud, self.returns, self.ignore, self.keep_classes)
        if not candidates.chosen.any():
            none = self._classified(candidates, NOWHERE, np.zeros(0, np.float32), None)
            raise candidates.nothing_to_do(none, surface=None)
        longest, metre = self.longest_building / cloud.metre, cloud.metre
        terrain = find_terrain(candidates.xyz, widest=longest, metre=metre, ctx=ctx.part(0, 0.95))
        ground, clear = verdict(candidates.xyz, terrain)
        tell_of_ground(candidates.xyz, ground, strips_of(cloud, candidates.chosen), metre)
        inner = candidates.xyz[ground & cloud.core[candidates.chosen]]
        _tell_of_wide(inner, terrain, longest)
        classified = self._classified(candidates, ground, clear, terrain)
        ctx.progress(1.0)
        return self.Outputs(
            classified=classified,
            surface=Raster.from_lattice(
                (terrain.heights * cloud.metre).astype(np.float32),
                terrain.lattice,
                crs=cloud.crs,
                descriptions=("terrain",),
                units=(vertical_unit(cloud.crs),),
            ),
            ground=candidates.ground(classified, ground),
            ground_share=candidates.share(ground, classified),
        )

    def _classified(
        self, candidates: Candidates, ground: Mask, clear: Singles, terrain: Terrain | None
    ) -> PointCloud:
        """The cloud with classes, confidence and, if asked for, heights above the ground."""
        cloud = candidates.cloud
        confidence = candidates.part.astype(np.float32)
        confidence[candidates.chosen] = clear
        made = {"confidence": confidence}
        told = {"confidence": "0 doubtful to 1 clear; 0 where a point took no part"}
        if self.heights:
            above = np.full(len(cloud), np.nan)
            if terrain is not None:
                above = height_above(cloud.xyz, terrain) * cloud.metre
            made[HEIGHT] = above.astype(np.float32)
            told[HEIGHT] = (
                f"above ground, {vertical_unit(cloud.crs)}" if cloud.crs else "above ground"
            )
        labelled = candidates.classified(ground)
        return labelled.with_attributes(made, descriptions=told)


def _tell_of_wide(ground: NDArray[np.float64], terrain: Terrain, widest: float) -> None:
    """Warn of ground, of shape (n, 3), in places that may be wide roofs."""
    if terrain.wide.any():
        there = np.zeros(terrain.wide.size, bool)
        there[cells_of(ground, terrain.lattice)] = True
        seen = terrain.wide * there.reshape(terrain.wide.shape)
        tell_of_wide(seen, terrain.lattice, widest)
