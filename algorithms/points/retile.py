"""Points cut into square files, with an index of them."""

from __future__ import annotations

from collections.abc import Iterator

from toolbox.context import QUIET, Context
from toolbox.data import Survey
from toolbox.data.retiled import MOST, Retiled, count_of, pattern_problem
from toolbox.declare import outputs, param, sink, source, tool


@tool(
    "points.retile",
    title="Retile points",
    tags=(
        "tile",
        "split",
        "cut",
        "grid",
        "buffer",
        "overlap",
        "vpc",
        "copc",
    ),
)
class PointsRetile:
    """Cut points into square files of one size, and write an index of them.

    The tiles stand beside the index, a virtual point cloud (VPC), and are replaced with it. They
    begin at whole multiples of `side` in the CRS; a point on an edge is in the tile east or north
    of it. Each tile has the layout that joins all files, as points.merge makes it.

    With an `overlap` a tile holds the points around it too, whose attribute tile_margin is 1: keep
    those where it is 0 once the work is done. Points so marked in the input are left out.

    `pattern` names the files, by the lower left corner (x, y) or by column and row; x=254000 makes
    0254000 of {x:07}. Names that end in .copc.laz make COPC files.
    """

    points: Survey = source("Files to cut: a folder, a pattern or a list")
    side: float = param("Side of a tile", default=1000.0, unit="m", gt=0)
    overlap: float = param("Width of the margin around a tile", default=0.0, unit="m", ge=0)
    pattern: str = param(
        "Names of the files, with x and y, or column and row", default="tile_{x}_{y}.laz"
    )

    @outputs
    class Outputs:
        tiles: Survey = sink("Index of the tiles, which are written beside it")

    def check(self) -> Iterator[tuple[str, str]]:
        """The margin is narrower than a tile, and names tell tiles apart."""
        if self.overlap >= self.side:
            yield "overlap", f"must be less than the side, {self.side:g}, got {self.overlap:g}"
        if text := pattern_problem(self.pattern):
            yield "pattern", text

    def check_data(self) -> Iterator[tuple[str, str]]:
        """There are points, and not too many tiles."""
        if not self.points.count:
            yield "points", f"{self.points.name} has no points"
            return
        xmin, ymin, _, xmax, ymax, _ = self.points.bounds
        count = count_of((xmin, ymin, xmax, ymax), self.side)
        if count > MOST:
            metres = self.side / self.points.metre
            yield "side", f"{metres:g} m would make up to {count:,} files, more than {MOST:,}"

    def halo(self) -> float:
        """Zero, as each point is looked at by itself."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> PointsRetile.Outputs:
        """Say how to cut; it is done where the tiles are written."""
        ctx.progress(1.0)
        tiles = Retiled(
            self.points.files,
            self.points.name,
            side=self.side,
            overlap=self.overlap,
            pattern=self.pattern,
        )
        return self.Outputs(tiles=tiles)
