"""Quality of a survey from the air: density, voids, overlap of strips and how well they agree.

References
----------
USGS (2024). Lidar Base Specification 2024 rev. A: density of first returns, voids wider than four
times the spacing of pulses, and differences of strips on open ground with slopes below 10 degrees
by single returns, at most 0.08 m (RMSDz) at quality levels 1 and 2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.points._groups import grouped
from algorithms.shared import parameters
from algorithms.shared.ground import taking_part, without_withheld
from algorithms.shared.windows import between
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Raster, Table
from toolbox.data.crs import own_unit, unit_of_heights, unit_of_lengths, vertical_unit
from toolbox.data.report import Column
from toolbox.declare import ClassList, outputs, param, sink, source, tool
from toolbox.errors import NothingToDo

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
STRIP, GROUND = "point_source_id", 2
SPACINGS = 4.0  # of pulses, in a void by the specification
FLATTEST = math.tan(math.radians(10.0))  # steepest ground on which strips are compared
FEWEST = 3  # points of a strip in a cell, for a mean height
LARGEST_RMS = 0.08  # metres: RMSDz where strips overlap, quality levels 1 and 2 (USGS 2024)
ONE_SIDED = 0.1  # share of cells with ground of one strip alone; 0 to 0.07 in clean surveys
FEWEST_COMPARED = 30  # cells with two strips, for an RMS: as of checkpoints (ASPRS 2024)
FEWEST_CELLS = 10  # of them that are told
ROUNDING = 1e-9  # of a number of steps: 19.6 / 0.7 is a little more than 28
COPIES = 0.01  # share of points at the place of another that is told; rounding makes a few


@tool(
    "points.survey_quality",
    title="Quality of a survey",
    tags=("qa", "quality", "density", "overlap", "strip", "void", "nps", "interswath"),
)
class PointsSurveyQuality:
    """Tell how dense a survey is, where it has voids, and how well its strips agree.

    The density counts first returns, one per pulse; the spacing of pulses is one by its root.
    Cells are four spacings wide unless a `cell` is given, so one without first returns is a void,
    which water also makes. Strips are told by point_source_id, the flight line. Where strips
    overlap, the mean heights of single returns are compared in cells with at least three points
    of each, whose heights do not differ by more than on a slope of 10 degrees: roads and fields,
    not bushes. Where the points have classes, those of ground (2) are compared alone, since two
    strips may see a roof and the street below it in one cell. A strip that lies higher than
    another everywhere shows as a mean difference.

    Noise, what else is in `ignore`, and withheld points take no part. Cells count that lie within
    the outline of the data: between the first and the last cell with points of their row and of
    their column. The mean density and thin cells leave out those at the edge, which the data covers
    in part alone.
    """

    points: PointCloud = source("Points of a survey")
    cell: float | Literal["auto"] = param(
        "Size of the cells; by the density with auto",
        default="auto",
        unit="m",
        gt=0,
        le=100,
        label="Cell size",
    )
    multiple_of: float | None = param(
        "Size of the cells of another raster, of which those of auto are a whole number wide",
        default=None,
        unit="m",
        gt=0,
        le=10_000,
        label="Multiple of",
    )
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        density: Raster = sink(
            "First returns of each cell per square metre of it, also of data in feet",
            label="Density of the survey",
        )
        strips: Raster = sink("Number of strips in each cell; 0 for a void")
        strip_difference: Raster = sink(
            "Highest less lowest mean height of strips on flat ground, where they overlap",
            label="Difference of strips",
        )
        by_strip: Table = sink(
            "First returns, density, spacing and voids of the survey and of each strip",
            label="Density by strip",
            columns={
                "strip": Column("Strip"),
                "first_returns": Column("First returns"),
                "area_m2": Column("Area with points", "m²", 0),
                "per_m2": Column(
                    "First returns per covered area",
                    "1/m²",
                    2,
                    meaning="Mean of the cells that no edge of the data cuts: not the number of "
                    "returns over the area, which hold cut cells, too",
                ),
                "spacing_m": Column("Spacing of pulses", "m", 2),
                "thin_share": Column("Cells with less than half of the mean", "%", 1, 100.0),
                "void_share": Column("Voids", "%", 2, 100.0),
            },
        )
        pairs: Table = sink(
            "One row per pair of strips: cells, mean, RMS and largest difference",
            label="Pairs of strips",
            columns={
                "first": Column("Strip"),
                "second": Column("Strip compared"),
                "cells": Column("Cells"),
                "mean_m": Column("Mean of second less first", "m", 3),
                "rms_m": Column("Root mean square difference", "m", 3),
                "largest_m": Column("Largest difference", "m", 3),
            },
        )
        mean_density: float = sink(
            "First returns per area that the data cover, voids included", unit="1/m2"
        )
        spacing: float = sink("Spacing of pulses", unit="m", label="Spacing of pulses")
        thin_share: float = sink(
            "Share of cells with less than half of the mean density", unit="1", label="Thin share"
        )
        void_share: float = sink("Share of cells without a point", unit="1", label="Share of voids")
        strip_count: int = sink("Strips", unit="1", label="Number of strips")
        overlap_share: float = sink(
            "Share of cells with points of more than one strip", unit="1", label="Overlap"
        )
        strip_rms: float | None = sink(
            "Root mean square difference of strips on flat ground", unit="m", label="RMS of strips"
        )

        def in_words(self) -> str:
            """Density, voids and strips."""
            unit = unit_of_lengths(self.density.crs)
            density = own_unit(self.mean_density, unit, -2)
            spacing = own_unit(self.spacing, unit)
            return (
                f"The survey has {self.mean_density:.1f} pulses per square metre{density}, "
                f"{self.spacing:.2f} m{spacing} apart; {100 * self.void_share:.2f} % of it are "
                f"voids, be they water or not. {self._strips_in_words()}"
            )

        def _strips_in_words(self) -> str:
            if self.strip_count < 2:
                return "There is one strip, or the points do not tell."
            if not self.overlap_share:
                return f"{self.strip_count} strips overlap nowhere."
            share = 100 * self.overlap_share
            said = f"{share:.0f}" if share >= 1 else f"{share:.1g}"
            unit = unit_of_heights(self.density.crs)
            if self.strip_rms is None:
                return f"{self.strip_count} strips overlap on {said} % of it."
            cells = int(self.pairs.frame["cells"].sum())
            if cells < FEWEST_COMPARED:
                return (
                    f"{self.strip_count} strips overlap on {said} % of it. How far they differ is "
                    f"not known: of flat ground there are {cells} cells with both, fewer than "
                    f"{FEWEST_COMPARED}."
                )
            return (
                f"{self.strip_count} strips overlap on {said} % of it, and differ there by "
                f"{self.strip_rms:.3f} m{own_unit(self.strip_rms, unit)} (RMS of all pairs "
                "together) on flat ground."
            )

        def not_looked_at(self) -> Iterator[str]:
            """How far heights are off in all, and what figures of strips do not say."""
            yield (
                "How far all heights are off was not tested, as no checkpoints were given: "
                "compare.surfaces compares the terrain with checkpoints, at least 30, and tells "
                "its accuracy. That strips agree, and intervals within the survey, do not."
            )
            if self.strip_count > 1 and self.strip_rms is None:
                yield "Strips were not compared: nowhere is flat ground seen from two of them."

    def halo(self) -> float:
        """Infinite, as the spacing of pulses is that of the whole survey."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> PointsSurveyQuality.Outputs:
        """Count by cell, then compare strips by cell."""
        ctx.progress(0.0)
        cloud, metre = self.points, self.points.metre
        taken = self._taken(ctx)
        lattice = self._lattice(taken)
        row, col = lattice.indices(taken.xyz[:, 0], taken.xyz[:, 1])
        place = row.astype(np.int64) * lattice.cols + col
        ctx.progress(0.3)
        area = (lattice.cell / metre) ** 2
        whole = Density.of(row, col, taken.first, area, lattice.shape)
        if whole.is_narrow:
            size = lattice.cell / metre
            log.warning("no cell of %.3g m is within the data: densities are too low", size)
        inside = whole.inside
        numbers = strips_in(place, taken.strip, inside.size).reshape(inside.shape)
        ctx.progress(0.6)
        means = taken.flat_means(place, lattice.cell * FLATTEST)
        differences, pairs = compared(means, metre)
        ctx.progress(0.9)
        spread = np.full(lattice.shape, np.nan)
        spread.flat[differences.index] = differences.to_numpy()
        rms = pairs.attrs["rms"]
        warn_of_strips(rms and rms / metre)
        warn_of_copies(taken.xyz)
        density = np.where(inside, whole.density, np.nan)
        strips = np.where(inside, numbers, np.nan)
        apart = "difference of strips"
        return self.Outputs(
            density=_raster(density, lattice, cloud, "density", "1/m2"),
            strips=_raster(strips, lattice, cloud, "strips", "1"),
            strip_difference=_raster(spread, lattice, cloud, apart, vertical_unit(cloud.crs)),
            pairs=Table(pairs),
            by_strip=Table.from_rows(rows_by_strip(taken, row, col, whole)),
            mean_density=whole.mean / metre**2,
            spacing=metre * whole.spacing,
            thin_share=whole.thin_share,
            void_share=whole.void_share,
            strip_count=len(np.unique(taken.strip)),
            overlap_share=float((numbers[inside] > 1).mean()),
            strip_rms=rms,
        )

    def _taken(self, ctx: Context) -> Taken:
        """The points that take part.

        Raises
        ------
        NothingToDo
            There are none, no first return among them, or they cover no area.
        """
        cloud = self.points
        taken = taking_part(cloud, self.ignore)
        without_withheld(cloud, np.ones(len(cloud), bool), ctx)  # tells their number
        found = Taken(
            cloud.xyz[taken],
            _attribute(cloud, "return_number", taken, 1) <= 1,
            _attribute(cloud, "number_of_returns", taken, 1) <= 1,
            _attribute(cloud, STRIP, taken, 0),
            _attribute(cloud, "classification", taken, 0) == GROUND,
        )
        if not found.first.any():
            raise NothingToDo("points: there are none")
        if not np.ptp(found.xyz[:, :2], axis=0).all():
            raise NothingToDo("points: all lie on one line, or at one place, so have no density")
        return found

    def _lattice(self, taken: Taken) -> Lattice:
        """The cells in which points are counted."""
        metre, xyz = self.points.metre, taken.xyz
        cell = self.cell
        if cell == "auto":
            cell = suitable_cell(xyz[taken.first] / metre) * metre
            if step := self.multiple_of:
                cell = step * math.ceil(cell / step * (1 - ROUNDING))
        return Lattice.cover((*xyz[:, :2].min(axis=0), *xyz[:, :2].max(axis=0)), float(cell))


class Taken(NamedTuple):
    """The n points of a survey that take part.

    Attributes
    ----------
    xyz : array of shape (n, 3)
    first, single, ground : arrays of shape (n,), whether each is a first or a single return, and
        of class 2
    strip : array of shape (n,), number of the strip of each
    """

    xyz: Array
    first: NDArray[np.bool_]
    single: NDArray[np.bool_]
    strip: Ints
    ground: NDArray[np.bool_]

    def flat_means(self, place: Ints, largest: float) -> pd.DataFrame:
        """Mean height of the single returns of each strip in flat cells, of ground if any is.

        Parameters
        ----------
        place : array of shape (n,), cell of each point
        largest : difference of heights within a strip and cell that counts as flat
        """
        of_all = self._means(self.single, place, largest)
        if not self.ground.any():
            return of_all
        means = self._means(self.single & self.ground, place, largest)
        warn_of_ground_of_one(means, of_all)
        return means

    def _means(self, some: NDArray[np.bool_], place: Ints, largest: float) -> pd.DataFrame:
        return flat_means(place[some], self.strip[some], self.xyz[some, 2], largest)


@dataclass(frozen=True)
class Density:
    """How many pulses lie in each cell of a survey, or of a strip of it.

    Attributes
    ----------
    counts : array of shape (rows, cols), first returns in each cell
    there : array of shape (rows, cols), whether a cell has points
    inside : array of shape (rows, cols), whether a cell lies within the data
    area : of a cell, in square metres
    """

    counts: Ints
    there: NDArray[np.bool_]
    inside: NDArray[np.bool_]
    area: float

    @classmethod
    def of(
        cls, row: Ints, col: Ints, first: NDArray[np.bool_], area: float, shape: tuple[int, int]
    ) -> Density:
        """Count points by cell.

        Parameters
        ----------
        row, col : arrays of shape (n,), cell of each point
        first : array of shape (n,), whether it is a first return
        area : of a cell, in square metres
        shape : numbers of rows and columns
        """
        place, size = row.astype(np.int64) * shape[1] + col, shape[0] * shape[1]
        counts = np.bincount(place[first], minlength=size).reshape(shape)
        there = np.bincount(place, minlength=size).reshape(shape) > 0
        return cls(counts, there, within_data(there), area)

    @classmethod
    def around(cls, row: Ints, col: Ints, first: NDArray[np.bool_], area: float) -> Density:
        """As :meth:`of`, in the cells around the points alone: a strip is a part of a survey."""
        row, col = row - row.min(), col - col.min()
        return cls.of(row, col, first, area, (int(row.max()) + 1, int(col.max()) + 1))

    @property
    def is_narrow(self) -> bool:
        """Whether the data covers all cells in part alone."""
        return not self._surrounded.any()

    @cached_property
    def _surrounded(self) -> NDArray[np.bool_]:
        return surrounded(self.inside)

    @cached_property
    def density(self) -> Array:
        """First returns per square metre, array of shape (rows, cols)."""
        return self.counts / self.area

    @cached_property
    def full(self) -> Array:
        """The densities of the cells that the data covers, or of all if there are none."""
        return self.density[self.inside if self.is_narrow else self._surrounded]

    @property
    def mean(self) -> float:
        """First returns per square metre."""
        return float(self.full.mean())

    @property
    def spacing(self) -> float:
        """Spacing of pulses in metres; infinite without any."""
        return 1 / math.sqrt(self.mean) if self.mean else math.inf

    @property
    def thin_share(self) -> float:
        """Share of cells with less than half of the mean density."""
        return float((self.full < self.mean / 2).mean())

    @property
    def void_share(self) -> float:
        """Share of cells within the data without a first return."""
        return float((self.counts[self.inside] == 0).mean())

    def told(self) -> dict[str, float]:
        """A row of the table of densities."""
        return {
            "first_returns": int(self.counts.sum()),
            "area_m2": float(self.there.sum()) * self.area,
            "per_m2": self.mean,
            "spacing_m": self.spacing,
            "thin_share": self.thin_share,
            "void_share": self.void_share,
        }


def rows_by_strip(
    taken: Taken, row: Ints, col: Ints, whole: Density
) -> list[dict[str, str | float]]:
    """Rows of the table of densities: of the survey, and of each strip if there are several.

    Parameters
    ----------
    row, col : arrays of shape (n,), cell of each point
    """
    rows: list[dict[str, str | float]] = [{"strip": "all", **whole.told()}]
    strips = list(rows_of(taken.strip))
    if len(strips) < 2:
        log.warning("all points have one number of their strip: strips are not told apart")
        return rows
    for number, own in strips:
        alone = Density.around(row[own], col[own], taken.first[own], whole.area)
        rows.append({"strip": str(number), **alone.told()})
    return rows


def warn_of_strips(rms: float | None) -> None:
    """Warn of strips that differ more than surveys may; `rms` is in metres."""
    if rms is not None and rms > LARGEST_RMS:
        log.warning(
            "strips differ by %.2f m (RMS) on flat ground, more than the %.2f m that USGS allows "
            "at quality levels 1 and 2: see pairs for strips that lie too high, or saw other "
            "ground at another time",
            rms,
            LARGEST_RMS,
        )


def warn_of_ground_of_one(ground: pd.DataFrame, whole: pd.DataFrame) -> None:
    """Warn where, in many flat cells, points of one strip are ground and those of another are not.

    Then a filter may have taken the lower of two strips alone, and the others agree by choice.

    Parameters
    ----------
    ground, whole : mean heights of strips in flat cells, by points of ground and by all of them
    """
    has_ground = whole["place"].isin(ground["place"])
    both = whole[has_ground].groupby("place")["strip"].nunique()
    cells = whole[has_ground & whole["place"].isin(both.index[both > 1])]
    known = ground.set_index(["place", "strip"]).index
    lacking = ~cells.set_index(["place", "strip"]).index.isin(known)
    count, total = cells["place"][lacking].nunique(), cells["place"].nunique()
    if count >= FEWEST_CELLS and count > ONE_SIDED * total:
        log.warning(
            "in %d of %d flat cells where strips overlap, one has points of ground and another "
            "none: these are not compared, and strips may differ more than it seems; try the "
            "points without classes",
            count,
            total,
        )


def warn_of_copies(xyz: Array) -> None:
    """Warn where many points of shape (n, 3) lie at the place of another."""
    places = np.ascontiguousarray(xyz + 0.0).view(np.int64)  # + 0.0 turns -0.0 into 0.0
    copies = len(xyz) - grouped(places)[1]
    if copies > COPIES * len(xyz):
        log.warning(
            "%d of %d points lie at the place (x, y, z) of another: if they are copies, densities "
            "count them twice; points.thin removes duplicates",
            copies,
            len(xyz),
        )


def _attribute(cloud: PointCloud, name: str, taken: NDArray[np.bool_], default: int) -> Ints:
    """An attribute of the points that take part, or one value for all."""
    if name not in cloud:
        return np.full(int(taken.sum()), default, np.int64)
    return cloud[name][taken].astype(np.int64)


def _raster(values: Array, lattice: Lattice, cloud: PointCloud, says: str, unit: str) -> Raster:
    return Raster.from_lattice(
        values.astype(np.float32), lattice, crs=cloud.crs, descriptions=(says,), units=(unit,)
    )


def suitable_cell(xyz: Array) -> float:
    """Four times the spacing of points in the cells of 10 by 10 spacings that hold any.

    Parameters
    ----------
    xyz : array of shape (n, 3), first returns
    """
    side = np.ptp(xyz[:, :2], axis=0)
    spacing = math.sqrt(max(float(side[0] * side[1]), 1e-6) / len(xyz))
    cells = np.unique(np.floor(xyz[:, :2] / (10 * spacing)), axis=0)
    spacing = math.sqrt(len(cells) * (10 * spacing) ** 2 / len(xyz))
    return float(f"{SPACINGS * spacing:.2g}")


def within_data(there: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The cells between the first and last cells with points of their row and of their column."""
    return between(there, 0) & between(there, 1)


def surrounded(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The cells with eight neighbours within the data, which covers others in part alone."""
    wide = np.pad(inside, 1)
    for axis in (0, 1):
        wide = wide & np.roll(wide, 1, axis) & np.roll(wide, -1, axis)
    return wide[1:-1, 1:-1]


def rows_of(strip: Ints) -> Iterator[tuple[int, Ints]]:
    """Each number of a strip, in order, and the indices of its points."""
    order = np.argsort(strip, kind="stable")
    numbers, begins = np.unique(strip[order], return_index=True)
    yield from zip(numbers.tolist(), np.split(order, begins[1:]), strict=True)


def strips_in(place: Ints, strip: Ints, size: int) -> Ints:
    """Number of strips in each cell, array of shape (size,)."""
    pairs = np.unique(np.column_stack([place, strip]), axis=0)
    return np.bincount(pairs[:, 0], minlength=size)


def flat_means(place: Ints, strip: Ints, z: Array, largest: float) -> pd.DataFrame:
    """Mean height of each strip in cells that are flat.

    Parameters
    ----------
    place, strip : arrays of shape (n,), cell and strip of each point
    z : array of shape (n,)
    largest : difference of heights within a strip and cell that counts as flat
    """
    import pandas as pd

    groups = pd.DataFrame({"place": place, "strip": strip, "z": z}).groupby(["place", "strip"])["z"]
    found = groups.agg(["count", "mean", "min", "max"]).reset_index()
    flat = (found["max"] - found["min"] <= largest) & (found["count"] >= FEWEST)
    return found.loc[flat, ["place", "strip", "mean"]]


def compared(means: pd.DataFrame, metre: float) -> tuple[pd.Series[float], pd.DataFrame]:
    """Highest less lowest mean by cell, and a table of all pairs of strips.

    The attribute "rms" of the table is that of all differences, in the unit of the heights; None
    without any.
    """
    import pandas as pd

    both = means.merge(means, on="place", suffixes=("_1", "_2"))
    both = both[both["strip_1"] < both["strip_2"]]
    both["difference"] = both["mean_2"] - both["mean_1"]
    widest = both["difference"].abs().groupby(both["place"]).max()
    groups: Any = both.groupby(["strip_1", "strip_2"])["difference"]
    rows = [
        {
            "first": int(first),
            "second": int(second),
            "cells": len(d),
            "mean_m": float(d.mean()) / metre,
            "rms_m": float(np.sqrt((d**2).mean())) / metre,
            "largest_m": float(d.abs().max()) / metre,
        }
        for (first, second), d in groups
    ]
    names = ["first", "second", "cells", "mean_m", "rms_m", "largest_m"]
    made = pd.DataFrame(rows, columns=names)
    squares = both["difference"] ** 2
    made.attrs["rms"] = float(np.sqrt(squares.mean())) if len(both) else None  # in the unit of z
    return widest, made
