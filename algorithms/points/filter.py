"""Selection of points by class, return, attribute expression and height above the lowest point."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from algorithms.shared import parameters
from algorithms.shared.ground import is_withheld
from algorithms.shared.selection import ReturnKind, choice_problems, chosen
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud
from toolbox.declare import ClassList, Expression, Range, Share, outputs, param, sink, source, tool
from toolbox.errors import NothingToDo

ROUNDING = 1e-6  # 5.2 - 5.0 is a little more than 0.2 in binary; files hold no finer coordinates
FEW = 0.001  # share of the points, below which a band begins at what may be an error


@tool(
    "points.filter",
    title="Filter points",
    tags=(
        "filter",
        "select",
        "query",
        "expression",
        "class",
        "return",
        "subset",
    ),
)
class PointsFilter:
    """Keep the points that meet all of the given conditions.

    `returns` needs return numbers: "only" is the single return of a pulse, "first" and "last"
    include it, "first_of_many" and "last_of_many" do not. `where` is a condition over attributes,
    for example ``intensity > 40 and user_data in (1, 3)``. The band `elevation_above_lowest` is
    measured from the lowest of the points that meet the other conditions.
    """

    points: PointCloud = source("Points to choose from")
    classes: ClassList | None = parameters.classes()
    returns: ReturnKind = parameters.returns()
    where: Expression | None = param(
        "Condition over attributes that must be met", default=None, of="points", label="Condition"
    )
    elevation_above_lowest: Range | None = param(
        "Band of heights above the lowest point to keep, limits included",
        default=None,
        unit="m",
        label="Heights above the lowest point",
    )

    @outputs
    class Outputs:
        kept: PointCloud = sink(
            "The points that meet all conditions, otherwise unchanged", label="Points kept"
        )
        removed_share: float = sink("Share of points removed", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have the attributes of the conditions."""
        yield from choice_problems(self.points, self.classes, self.returns)

    def halo(self) -> float:
        """Zero, as each point is judged by itself; infinite if all points decide on the lowest."""
        return math.inf if self.elevation_above_lowest else 0.0

    def run(self, ctx: Context = QUIET) -> PointsFilter.Outputs:
        """Keep the points."""
        keep = self._chosen()
        if self.elevation_above_lowest and keep.any():
            keep &= self._in_band(keep, *self.elevation_above_lowest)
        if not keep.any():
            log.warning("no point meets all conditions")
        ctx.progress(1.0)
        return self._outputs(keep)

    def _in_band(self, others: NDArray[np.bool_], low: float, high: float) -> NDArray[np.bool_]:
        """True for points in a height band above the lowest one that meets the other conditions."""
        firm = others & ~is_withheld(self.points)
        lowest = self.points["z"][firm if firm.any() else others].min()
        height = self.points["z"] - lowest
        band: NDArray[np.bool_] = (height >= low - ROUNDING) & (height <= high + ROUNDING)
        within, among = int((band & others).sum()), int(others.sum())
        if within < FEW * among:
            log.warning(
                "only %d of %d points lie in the band above the lowest, which is at %.2f: it may "
                "be an error below the ground, or lower ground elsewhere",
                within,
                among,
                lowest,
            )
        return np.asarray(band)

    def _chosen(self) -> NDArray[np.bool_]:
        try:
            return chosen(self.points, self.classes, self.returns, self.where)
        except NothingToDo as err:
            err.instead = self._outputs(np.zeros(len(self.points), bool))
            raise

    def _outputs(self, keep: NDArray[np.bool_]) -> PointsFilter.Outputs:
        kept = self.points.select(keep)
        return self.Outputs(kept=kept, removed_share=Share.of_points(~keep, self.points.core))
