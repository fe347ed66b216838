"""Candidates from a cloud: the few points among which a power line is looked for."""

from __future__ import annotations

from collections.abc import Iterator

from algorithms.corridor._extraction.candidates import GROUND_CELL, STANDS_FOR, candidates
from algorithms.corridor._extraction.labels import POINT_NUMBER
from algorithms.shared import parameters
from algorithms.shared.ground import taking_part
from algorithms.shared.heights import HEIGHT, given_heights
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud
from toolbox.declare import ClassList, outputs, sink, source, tool


@tool(
    "corridor.candidates",
    title="Find candidates of wires",
    tags=(
        "power",
        "line",
        "wire",
        "conductor",
        "prefilter",
    ),
)
class CorridorCandidates:
    """Choose the points that may be of a power line.

    These are all that are off the ground, and of the others one per square metre, which tells how
    many it stands for. corridor.extract finds the same line among them as among all points; then
    corridor.label labels these. So a line of any length can be worked on in tiles, as
    models.power_line_clearance does.
    """

    points: PointCloud = source("Points with HeightAboveGround, as ground.classify gives it")
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        candidates: PointCloud = sink("The chosen points with stands_for and point_number")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have heights above the ground."""
        if HEIGHT not in self.points:
            yield "points", f"{self.points.name} has no {HEIGHT}; see heights of ground.classify"

    def halo(self) -> float:
        """One and a half cells, as a cell of the ground may lie across the edge of a tile."""
        return 1.5 * GROUND_CELL

    def run(self, ctx: Context = QUIET) -> CorridorCandidates.Outputs:
        """Choose the points, and number them."""
        cloud = self.points
        index, stands_for = candidates(
            cloud.xyz,
            given_heights(cloud),
            taking_part(cloud, self.ignore),
            metre=cloud.metre,
            ctx=ctx,
        )
        ctx.progress(1.0)
        return self.Outputs(
            candidates=cloud.select(index).with_attributes(
                {STANDS_FOR: stands_for, POINT_NUMBER: cloud.number[index]},
                descriptions={
                    STANDS_FOR: "points that are represented",
                    POINT_NUMBER: "place of the point in the survey",
                },
            )
        )
