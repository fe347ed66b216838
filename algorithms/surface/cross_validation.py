"""Cross-validation: errors of gridded surfaces at points that were left out.

What the figures mean, and what they are on real surveys: docs/explanation/gridding-gallery.md.

References
----------
Stone, M. (1974). Cross-validatory choice and assessment of statistical predictions. Journal of the
Royal Statistical Society B 36, 111-147.
Roberts, D. R. et al. (2017). Cross-validation strategies for data with temporal, spatial,
hierarchical, or phylogenetic structure. Ecography 40, 913-929: leaving out blocks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from algorithms.shared import parameters
from algorithms.shared.error_measures import measures
from algorithms.shared.ground import without_withheld
from algorithms.shared.selection import ReturnKind, choice_problems, chosen
from algorithms.surface._gridding import STATISTICS, grid
from algorithms.surface._samples import samples, why_none
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Raster, Table
from toolbox.data.crs import vertical_unit
from toolbox.declare import (
    Attribute,
    ClassList,
    Expression,
    outputs,
    param,
    show,
    sink,
    source,
    tool,
)
from toolbox.errors import DataError

Interpolation = Literal["linear", "natural", "cubic", "idw", "nearest"]
CellStatistic = Literal["min", "max", "mean", "median", "percentile"]  # that are values of points
LENGTHS = (
    "bias",
    "std",
    "rmse",
    "rmse_common",
    "mae",
    "median",
    "nmad",
    "le90",
    "le95",
    "min",
    "max",
)

Array = NDArray[np.float64]
Row = dict[str, Any]


@tool(
    "surface.cross_validation",
    title="Cross-validate a grid",
    tags=(
        "cross",
        "validation",
        "accuracy",
        "rmse",
        "interpolation",
        "idw",
        "tin",
        "error",
        "residual",
    ),
)
class SurfaceCrossValidation:
    """Grid a part of the points, and compare the raster with the points that were left out.

    The points are parted by chance into `folds`. Each fold in turn is left out, the others are
    gridded as surface.grid does it, with every method, and the raster is read bilinearly at the
    points left out, as compare.surfaces reads it at checkpoints. So the errors are those of the
    raster that is delivered, with what its cells and the noise of the points add to them.

    Single points are left out where there are others around them, which says little about gaps.
    With `block` all points of a square go at once: then the errors are those of surfaces that
    span gaps of that size. Points at one position are left out together.

    Errors are surface minus point. A method may know no value at a point: beyond the hull, farther
    than `max_gap`, or where one of the four cells around it is empty. These are counted as missing,
    and `rmse_common` is over the points at which all methods have a value, to compare them by.

    The table is in metres if heights are gridded, and in the unit of the attribute otherwise;
    the residuals are in the unit of the data.
    """

    points: PointCloud = source("Points to grid, and to compare with")
    methods: tuple[Interpolation | CellStatistic, ...] | None = param(
        "Methods to compare; all interpolations by default", default=None
    )
    cell: float = parameters.cell()
    attribute: Attribute = param("Attribute to grid", default=Attribute("z"), of="points")
    classes: ClassList | None = parameters.classes()
    returns: ReturnKind = parameters.returns()
    where: Expression | None = param(
        "Condition over attributes that must be met", default=None, of="points", label="Condition"
    )
    block: float | None = param(
        "Side of squares that are left out as a whole; single points by default",
        default=None,
        unit="m",
        gt=0,
        label="Side of squares left out",
    )
    folds: int = param(
        "Parts of the points, each left out once",
        default=10,
        unit="1",
        ge=2,
        label="Parts of the points",
    )
    rounds: int | None = param(
        "Parts to leave out, where all of them would take too long",
        default=None,
        unit="1",
        ge=1,
        label="Parts to leave out",
    )
    seed: int = parameters.seed()
    max_gap: float | None = param(
        "Leave empty what lies farther than this from any point",
        default=None,
        unit="m",
        gt=0,
        label="Widest gap to fill",
    )
    power: float = param(
        "Power of the distance, for idw",
        default=2.0,
        unit="1",
        gt=0,
        label="Power of the distance (IDW)",
    )
    neighbours: int = param("Points used per cell, for idw", default=12, unit="1", ge=1, le=1000)
    radius: float | None = param(
        "Farthest point used, for idw; any by default", default=None, unit="m", gt=0
    )
    smoothing: float = param(
        "Length that dulls the peaks at the points, for idw", default=0.0, unit="m", ge=0, le=1e6
    )
    percentile: float = param(
        "Share of the points below, for percentile", default=95.0, unit="%", ge=0, le=100
    )

    @outputs
    class Outputs:
        table: Table = sink("One row per method: counts, bias, RMSE, MAE and further measures")
        residuals: PointCloud = sink(
            "Points left out, with the error of each method",
            show=show.Values("error_*", length=True, centred=True),
            label="Points left out",
        )
        count: int = sink("Points left out", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """The methods and rounds are valid."""
        if len(set(self._methods)) < len(self._methods):
            yield "methods", f"names a method twice: {', '.join(self._methods)}"
        if self.rounds is not None and self.rounds > self.folds:
            yield "rounds", f"must be at most the number of folds, {self.folds}, got {self.rounds}"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The layer has what the selection of points needs."""
        yield from choice_problems(self.points, self.classes, self.returns)

    def halo(self) -> float:
        """Infinite, as folds are drawn from the whole."""
        return math.inf

    @property
    def _methods(self) -> tuple[Any, ...]:
        return self.methods or get_args(Interpolation)

    def run(self, ctx: Context = QUIET) -> SurfaceCrossValidation.Outputs:
        """Leave out fold by fold, and sum up the errors."""
        keep = chosen(self.points, self.classes, self.returns, self.where)
        keep = without_withheld(self.points, keep, ctx)
        if not keep.any():
            raise DataError(why_none(self.points, self.classes))
        xy, values = samples(self.points, self.attribute, keep)
        ctx.progress(0.02)
        fold = folds_of(xy, self.folds, self.block, self.seed)
        ctx.progress(0.05)
        out = fold < (self.rounds or self.folds)
        error = {m: np.full(len(xy), np.nan) for m in self._methods}
        for part in range(self.rounds or self.folds):
            self._leave_out(xy, values, fold == part, error, ctx.part(*self._span(part)))
        error = {method: found[out] for method, found in error.items()}
        is_height = self.attribute == "z"
        table = Table.from_rows(table_rows(error, self.points.metre if is_height else 1.0))
        return self.Outputs(
            table=table,
            residuals=self._residuals(np.flatnonzero(keep)[out], error),
            count=int(np.count_nonzero(out)),
        )

    def _span(self, part: int) -> tuple[float, float]:
        """Progress interval of one round."""
        share = 0.94 / (self.rounds or self.folds)
        return 0.05 + part * share, 0.05 + (part + 1) * share

    def _leave_out(
        self,
        xy: Array,
        values: Array,
        out: NDArray[np.bool_],
        error: Mapping[str, Array],
        ctx: Context,
    ) -> None:
        """Fill in the errors of each method at the points of one fold; arrays of shape (n,)."""
        lattice = around(xy, self.cell)
        for number, method in enumerate(self._methods):
            of_cells = method in STATISTICS
            surface = grid(
                xy[~out],
                values[~out],
                lattice,
                method=method,
                max_gap=None if of_cells else self.max_gap,
                power=self.power,
                neighbours=self.neighbours,
                radius=self.radius,
                smoothing=self.smoothing,
                percentile=self.percentile,
                ctx=ctx.part(number / len(error), (number + 1) / len(error)),
            ).surface
            found = Raster.from_lattice(surface, lattice, crs=None).sample(
                *xy[out].T, method="linear"
            )
            error[method][out] = found - values[out]

    def _residuals(self, index: NDArray[np.intp], error: Mapping[str, Array]) -> PointCloud:
        """Layer of the points that were left out, with their errors."""
        unit = vertical_unit(self.points.crs) if self.attribute == "z" else ""
        text = "surface minus point" + (f", {unit}" if unit else "")
        columns = {f"error_{method}": found.astype(np.float32) for method, found in error.items()}
        return self.points.select(index).with_attributes(
            columns, descriptions=dict.fromkeys(columns, text)
        )


def around(xy: Array, cell: float) -> Lattice:
    """Lattice whose cell centres surround all points of shape (n, 2)."""
    (west, south), (east, north) = xy.min(axis=0) - cell, xy.max(axis=0) + cell
    return Lattice.cover((west, south, east, north), cell)


def folds_of(xy: Array, folds: int, block: float | None, seed: int) -> NDArray[np.int64]:
    """Random folds of points of about equal size, by position or by block.

    Parameters
    ----------
    xy : array of shape (n, 2); points at one position get the same fold
    block : side of squares that get one fold; whole multiples of it are edges

    Returns
    -------
    array of shape (n,), numbers from 0

    Raises
    ------
    DataError
        There are fewer positions or blocks than folds.
    """
    units = xy if block is None else np.floor(xy / block)
    order = np.lexsort([units[:, 1], units[:, 0]])
    new = np.ones(len(xy), np.int64)
    new[1:] = (np.diff(units[order], axis=0) != 0).any(axis=1)
    number = np.empty(len(xy), np.int64)
    number[order] = np.cumsum(new) - 1
    count = int(new.sum())
    if count < folds:
        what = "places" if block is None else "blocks"
        raise DataError(f"points: lie in {count} {what}, fewer than the {folds} folds")
    return (np.random.default_rng(seed).permutation(count) % folds)[number]


def table_rows(error: Mapping[str, Array], metre: float) -> Iterator[Row]:
    """Table rows: one per method; lengths in metres.

    Parameters
    ----------
    error : for each method an array of shape (n,), NaN where it has no value
    metre : length of one metre in the unit of the errors
    """
    common = np.isfinite(list(error.values())).all(axis=0)
    for method, found in error.items():
        known = found[np.isfinite(found)] / metre
        row: Row = {"method": method, "count": len(known), "missing": len(found) - len(known)}
        if not len(known):
            log.warning("%s has no value at any of the points left out", method)
        sizes = measures(known) if len(known) else {}
        if common.any():
            sizes["rmse_common"] = float(np.sqrt(np.mean((found[common] / metre) ** 2)))
        yield row | {name: sizes.get(name) for name in LENGTHS}
