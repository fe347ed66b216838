"""The CRS of points stated, where their file does not do so."""

from __future__ import annotations

from collections.abc import Iterator

from pyproj import CRS

from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud
from toolbox.data.area_of_use import misplaced
from toolbox.data.crs import adds_heights, describe_crs, same_crs
from toolbox.declare import outputs, param, sink, source, tool


@tool(
    "points.assign_crs",
    title="Assign CRS to points",
    tags=(
        "crs",
        "projection",
        "epsg",
        "define-projection",
        "coordinate-system",
    ),
)
class PointsAssignCrs:
    """State the CRS of points.

    No coordinate changes; points.reproject does that. A CRS that the file states stays, unless
    `replace` says that it is wrong; a height system may be added to it at any time. Coordinates
    that cannot be in the CRS are refused, and those far outside its area of use are warned of.
    """

    points: PointCloud = source("Points whose CRS is known to you", any_crs=True)
    crs: CRS = param("CRS in which the coordinates are, such as EPSG:32635 or EPSG:2154+5720")
    replace: bool = param("Replace another CRS, which the file states wrongly", default=False)

    @outputs
    class Outputs:
        assigned: PointCloud = sink("The same points, which state their CRS")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points state no other CRS, and may be in this one."""
        cloud, crs = self.points, self.crs
        stated = cloud.crs
        fits = stated is None or same_crs(stated, crs) or adds_heights(stated, crs)
        if not (fits or self.replace):
            yield (
                "crs",
                f"{cloud.name} states {describe_crs(stated)}; points.reproject --crs brings it to "
                "another CRS, and --replace true says that the statement is wrong",
            )
        elif (found := misplaced(crs, cloud.extent)) and found.in_other_unit:
            yield "crs", f"{cloud.name} {found.text}"

    def halo(self) -> float:
        """Zero, as no point is moved."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> PointsAssignCrs.Outputs:
        """State it."""
        if found := misplaced(self.crs, self.points.extent):  # refused if it cannot be at all
            log.warning("%s %s", self.points.name or "points", found.text)
        ctx.progress(1.0)
        return self.Outputs(assigned=self.points.with_crs(self.crs))
