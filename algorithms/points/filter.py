"""Selection of points by class, return, attribute expression and height above the lowest point."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.shared import parameters
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud
from toolbox.declare import ClassList, Expression, Range, Share, outputs, param, sink, source, tool
from toolbox.errors import NothingToDo

ROUNDING = 1e-6  # 5.2 - 5.0 is a little more than 0.2 in binary; files hold no finer coordinates
FEW = 0.001  # share of the points, below which a band begins at what may be an error
Returns = Literal["all", "first", "last", "only", "intermediate", "first_of_many", "last_of_many"]


@tool("points.filter")
class PointsFilter:
    """Keep the points that meet all of the given conditions.

    `returns` needs return numbers: "only" is the single return of a pulse, "first" and "last"
    include it, "first_of_many" and "last_of_many" do not. `where` is a condition over attributes,
    for example ``intensity > 40 and user_data in (1, 3)``. The band `elevation_above_lowest` is
    measured from the lowest of the points that meet the other conditions.
    """

    points: PointCloud = source("Points to choose from")
    classes: ClassList | None = parameters.classes()
    returns: Returns = param("Returns to keep", default="all")
    where: Expression | None = param("Condition to meet", default=None, of="points")
    elevation_above_lowest: Range | None = param(
        "Band of heights above the lowest point to keep, limits included", default=None, unit="m"
    )

    @outputs
    class Outputs:
        kept: PointCloud = sink("The points that meet all conditions, otherwise unchanged")
        removed_share: float = sink("Share of points removed", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points need what the conditions look at."""
        yield from choice_problems(self.points, self.classes, self.returns)

    def halo(self) -> float:
        """Each point is judged by itself, unless the lowest point of all decides."""
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
        """Points of the band above the lowest one that meets the other conditions."""
        lowest = self.points["z"][others].min()
        height = self.points["z"] - lowest
        band: NDArray[np.bool_] = (height >= low - ROUNDING) & (height <= high + ROUNDING)
        within, among = int((band & others).sum()), int(others.sum())
        if within < FEW * among:
            log.warning(
                "only %d of %d points lie in the band above the lowest, which is at %.2f: it may "
                "be an error below the ground, or lower ground elsewhere",
                within, among, lowest,
            )  # fmt: skip
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


def choice_problems(
    cloud: PointCloud, classes: ClassList | None, returns: Returns
) -> Iterator[tuple[str, str]]:
    """What the cloud lacks for a choice of points, by parameter."""
    if classes and "classification" not in cloud:
        yield "classes", f"{cloud.name} has no classification"
    if returns != "all" and not {"return_number", "number_of_returns"} <= {*cloud.names}:
        yield "returns", f"{cloud.name} has no return numbers"


def chosen(
    cloud: PointCloud, classes: ClassList | None, returns: Returns, where: Expression | None
) -> NDArray[np.bool_]:
    """True for the points that meet all three; array of shape (n,).

    Raises
    ------
    NothingToDo
        See :func:`return_mask`.
    """
    keep = np.ones(len(cloud), bool)
    if classes:
        keep &= np.isin(cloud["classification"], classes)
    if returns != "all":
        keep &= return_mask(cloud["return_number"], cloud["number_of_returns"], returns)
    if where:
        keep &= where.mask({name: cloud[name] for name in where.names}, len(cloud))
    return keep


def return_mask(number: NDArray[Any], count: NDArray[Any], returns: Returns) -> NDArray[np.bool_]:
    """True for the returns of one kind.

    Parameters
    ----------
    number, count : arrays of shape (n,), the return number and the number of returns of the pulse
    returns : see :class:`PointsFilter`

    Returns
    -------
    array of shape (n,)

    Raises
    ------
    NothingToDo
        No point has a valid return number (1 to the number of returns).
    """
    valid = (number >= 1) & (number <= count)
    if len(valid) and not valid.any():
        text = "points: no point has a valid return number, so returns cannot be chosen"
        raise NothingToDo(text)
    if not valid.all():
        log.warning("%d points have an invalid return number and are left out", (~valid).sum())
    first, last, single = number == 1, number == count, count == 1
    masks = {
        "all": valid,
        "first": first,
        "last": last,
        "only": single,
        "intermediate": ~first & ~last,
        "first_of_many": first & ~single,
        "last_of_many": last & ~single,
    }
    return np.asarray(valid & masks[returns])
