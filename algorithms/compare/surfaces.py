"""How well the heights of a raster agree with another raster, or with points of known height.

What each figure means, and when to trust it: docs/explanation/accuracy.md.

References
----------
ASPRS (2024). Positional Accuracy Standards for Digital Geospatial Data, Edition 2, Version 2:
RMSE of vertical errors, apart for ground without and with vegetation, of at least 30 checkpoints.
Freedman, D. and Diaconis, P. (1981). On the histogram as a density estimator: L2 theory.
Zeitschrift für Wahrscheinlichkeitstheorie 57, 453-476: width of bins.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.compare._heights import far_apart, height_mismatch
from algorithms.compare._shapes import areas_at
from algorithms.compare._spread import Quarters, spread
from algorithms.compare._statement import FEWEST, WET, horizontal, statement
from algorithms.compare._unseen import warn_absent
from algorithms.shared import parameters
from algorithms.shared.alignment import apart, difference, misfit
from algorithms.shared.error_measures import COUNTS, MEANING, measures
from algorithms.shared.ground import GROUND, without_withheld
from algorithms.shared.heights import heights_problem
from algorithms.shared.lowest import require_finite
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Raster, Table, Vector
from toolbox.data.crs import crs_conflict, unit_of_heights
from toolbox.data.layer import extents
from toolbox.data.report import Column
from toolbox.declare import ClassList, outputs, param, show, sink, source, tool
from toolbox.errors import DataError

REFERENCES = ("reference", "checkpoints", "points")
ROWS = 512  # resampled between two checks for cancellation
MOST_COVERS = 256
STATED = "RMSEH"
CONFIDENCE = 1.959963984540054  # standard deviations of a normal distribution that hold 95 %
MOST_BINS = 80
NAMED = 5  # checkpoints without a counterpart that a warning names
LONGEST_NAME = 40  # characters of a checkpoint in a warning
BLUNDER = 0.1  # metres: no blunder is smaller, whatever the scatter of the others
LAID, LAND = "water laid level", "land"  # covers of places in the polygons of water, and others
WINDOW = 5  # cells along a side: no surveyed ground has one height to the bit in 25 cells
UNKNOWN = "not known"  # land cover of a position that no class or polygon covers

Array = NDArray[np.float64]
Row = dict[str, Any]


COVERS = {
    "cover": Column("Land cover"),
    "count": Column("Compared"),
    "bias": Column("Mean", "m", 3),
    "std": Column("Standard deviation", "m", 3),
    "rmse": Column("RMSE", "m", 3),
    "mae": Column("Mean size", "m", 3),
    "median": Column("Median", "m", 3),
    "mad": Column("MAD", "m", 3),
    "nmad": Column("NMAD", "m", 3),
    "le90": Column("LE90", "m", 3),
    "le95": Column("LE95", "m", 3),
    "min": Column("Lowest", "m", 3),
    **{f"p{n}": Column(f"{n} % are lower", "m", 3) for n in (5, 25, 75, 95)},
    "max": Column("Highest", "m", 3),
    "far": Column("Farther than 3 NMAD"),
    "emptiest_quarter": Column("In the emptiest quarter", "%", 0, 100.0),
}


@tool(
    "compare.surfaces",
    title="Accuracy of heights",
    tags=(
        "accuracy",
        "rmse",
        "checkpoint",
        "gcp",
        "vertical",
        "nmad",
        "le95",
        "asprs",
        "dtm",
        "dsm",
        "dem",
        "validation",
        "error",
    ),
)
class CompareSurfaces:
    """Compare the heights of a raster with another raster or with points of known height.

    Give one of three: a reference raster on the same cells (or `resample`, which takes it
    bilinearly at the cell centres), checkpoints with Z, or a point cloud (also a text file of
    checkpoints). At points the surface is bilinear between the four nearest cell centres; points
    where one of these has no value are counted as missing. What the reference has and the surface
    has not is `absent`: cells of a reference raster, or the missing points. Errors are surface
    minus reference, so a surface that is too high has a positive bias. Nothing is left out as an
    outlier.

    The land cover comes from a raster of classes, from polygons, or from an attribute of the
    polygons, checkpoints or points. The covers named in `vegetated` make up the vegetated
    vertical accuracy (VVA), all others the non-vegetated one (NVA).

    For points there is a report after the ASPRS standards, Edition 2, Version 2 (2024): RMSE of the
    fit to the checkpoints, with their own error as root of the sum of squares, for NVA and VVA; how
    many there are of the 30 that are needed; whether they are spread over the area, with a fifth of
    them in each quarter, and not crowded; and whether the NVA meets `accuracy_class`. VVA is
    reported as found and fails nothing. A statement says so in words. Horizontal accuracy is not
    tested; `horizontal_rmse` is what its maker states. `covers` has the share in the emptiest
    quarter too.

    Places in `water`, whose level was laid, are a land cover of their own, and neither NVA nor VVA.
    Without it, a warning tells how many points lie where the surface is exactly level.

    Tables are in metres, layers in the unit of the data.
    """

    surface: Raster = source("Raster of heights to judge")
    reference: Raster | None = source("Raster of true heights", default=None)
    checkpoints: Vector | None = source(
        "Points with true heights (Z)", default=None, shapes="point"
    )
    points: PointCloud | None = source("Point cloud with true heights", default=None)
    cover: Raster | None = source(
        "Raster of classes of land cover", default=None, label="Land cover (raster)"
    )
    areas: Vector | None = source("Polygons of land cover", default=None, shapes="polygon")
    water: Vector | None = source(
        "Polygons of water that was laid level in the surface: no terrain, and counted apart",
        default=None,
        shapes="polygon",
        label="Water laid level",
    )
    resample: bool = param(
        "Take a reference on other cells bilinearly at the cell centres",
        default=False,
        label="Resample the reference",
    )
    classes: ClassList | None = parameters.classes()
    cover_attribute: str | None = param(
        "Attribute of polygons, checkpoints or points that is the land cover",
        default=None,
        of="areas",
        label="Land cover (attribute)",
    )
    vegetated: tuple[str, ...] | None = param(
        "Land covers that are vegetated; all others are not",
        default=None,
        label="Vegetated land covers",
    )
    checkpoint_rmse: float | None = param(
        "RMSE of the heights of the checkpoints themselves",
        default=None,
        unit="m",
        ge=0,
        label="RMSE of the checkpoints",
    )
    accuracy_class: float | None = param(
        "RMSE that the surface is to meet, for the report",
        default=None,
        unit="m",
        gt=0,
        label="RMSE to be met",
    )
    horizontal_rmse: float | None = param(
        "Horizontal RMSE that the maker of the surface states, for the report",
        default=None,
        unit="m",
        gt=0,
        label="Horizontal RMSE",
    )
    largest_errors: int = param(
        "Number of the largest errors to mark",
        default=100,
        unit="1",
        ge=0,
        label="Largest errors to mark",
    )

    @outputs
    class Outputs:
        table: Table = sink("One row per measure: measure, value, unit, meaning")
        covers: Table = sink(
            "One row per land cover, with the same measures", label="Land covers", columns=COVERS
        )
        report: Table | None = sink("Report after ASPRS 2024, for points")
        difference: Raster | None = sink("Surface minus reference raster")
        errors: Vector = sink(
            "The largest errors, the largest first",
            show=show.Values("error", length=True, centred=True),
            columns={
                "rank": Column("Rank"),
                "error": Column("Error", "unit", 3),
                "surface": Column("Height of the surface", "unit", 3),
                "reference": Column("True height", "unit", 3),
                "cover": Column("Land cover"),
            },
        )
        histogram: Table = sink(
            "Number of errors by size: low, high, count, unit",
            show=show.Histogram("low", "high", "count", unit_in="unit"),
        )
        count: int = sink("Cells or points compared", unit="1")
        missing: int = sink("Cells of the surface, or points, without a counterpart", unit="1")
        absent: int = sink("Cells or points of the reference without a counterpart", unit="1")
        bias: float = sink("Mean of surface minus reference", unit="m")
        rmse: float = sink("Root mean square error", unit="m")
        nmad: float = sink("Median absolute deviation times 1.4826", unit="m", label="NMAD")
        le95: float = sink("Error that 95 % of the errors do not exceed", unit="m", label="LE95")

        def in_words(self) -> str:
            """The statement of accuracy, or how well two rasters agree."""
            if self.report is None:
                return (
                    f"Surface less reference: mean {self.bias:.3f} m, RMSE {self.rmse:.3f} m, "
                    f"NMAD {self.nmad:.3f} m, at {self.count} cells."
                )
            return "\n".join(statement(self.report.frame, unit_of_heights(self.errors.crs)))

        def not_looked_at(self) -> Iterator[str]:
            """What heights do not tell."""
            if self.report is not None:
                items = self.report.frame.set_index("item")["value"]
                yield horizontal(items.get(STATED))
            if self.missing:
                yield f"Places without a counterpart: {self.missing}."
            if self.report is None and self.absent:
                yield f"Cells of the reference that are absent from the surface: {self.absent}."

    def check(self) -> Iterator[tuple[str, str]]:
        """No land cover is named twice."""
        if self.vegetated and len(set(self.vegetated)) < len(self.vegetated):
            yield "vegetated", f"names a land cover twice: {', '.join(self.vegetated)}"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """There are one reference, at most one land cover, and comparable heights."""
        given = [name for name in REFERENCES if getattr(self, name) is not None]
        if len(given) != 1:
            there = " and ".join(given) or "none"
            yield "reference", f"give one of reference, checkpoints and points, got {there}"
        if text := heights_problem(self.surface):
            yield "surface", f"{_named(self.surface)} {text}"
        if self.resample and self.reference is None:
            yield "resample", "is for a reference raster"
        for name in ("checkpoint_rmse", "accuracy_class", "horizontal_rmse"):
            if self.reference is not None and getattr(self, name) is not None:
                yield name, "is for the report on points, not for a reference raster"
        yield from self._reference_problems()
        yield from self._cover_problems()

    def _reference_problems(self) -> Iterator[tuple[str, str]]:
        one, other = self.surface, self.reference
        if other is not None:
            if text := heights_problem(other):
                yield "reference", f"{_named(other)} {text}"
            elif text := crs_conflict(other.crs, one.crs, heights=True, tools="surface"):
                yield "reference", f"{_named(other)} {text} of {_named(one)}"
            elif apart(Lattice.of(one), Lattice.of(other)):
                yield "reference", f"{_named(other)} lies nowhere on the area of {_named(one)}"
            elif not self.resample and (text := misfit(Lattice.of(one), Lattice.of(other))):
                yield (
                    "reference",
                    f"{_named(other)} {text} of {_named(one)}; give resample to take it bilinearly",
                )
        if self.checkpoints is not None and (text := _points_problem(self.checkpoints)):
            yield "checkpoints", f"{self.checkpoints.name} {text}"
        if self.classes and (self.points is None or "classification" not in self.points):
            yield "classes", "there are no points with a classification"

    def _cover_problems(self) -> Iterator[tuple[str, str]]:
        if self.cover is not None and (self.areas is not None or self.cover_attribute):
            yield "cover", "give the land cover once: as a raster, polygons or an attribute"
        if self.cover is not None and len(self.cover.values) != 1:
            yield "cover", f"{_named(self.cover)} has {len(self.cover.values)} bands; give one"
        if self.areas is not None and not self.cover_attribute:
            yield "cover_attribute", "name the attribute of the polygons that is the land cover"
        if self.areas is not None and (text := _areas_problem(self.areas)):
            yield "areas", f"{self.areas.name} {text}"
        if self.vegetated and not (self.cover or self.cover_attribute):
            yield "vegetated", "there is no land cover; give cover, areas or cover_attribute"
        if self.cover_attribute:
            known = self._attributes()
            if self.cover_attribute not in known:
                listed = ", ".join(known) or "none"
                text = f"no attribute {self.cover_attribute!r}; there are {listed}"
                yield "cover_attribute", text

    def _attributes(self) -> list[str]:
        """Names of the attributes that `cover_attribute` may name."""
        layer = self.areas if self.areas is not None else self.checkpoints
        if layer is not None:
            frame = layer.frame
            return [str(name) for name in frame.columns if name != frame.geometry.name]
        return list(self.points.names) if self.points is not None else []

    def halo(self) -> float:
        """Infinite, as quantiles and the largest errors are those of the whole."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> CompareSurfaces.Outputs:
        """Compute the errors, and their statistics."""
        raster, found = self._found(ctx.part(0.0, 0.4))
        if not len(found.error):
            name = next(n for n in REFERENCES if getattr(self, n) is not None)
            where = extents(surface=self.surface, **{name: getattr(self, name)})
            raise DataError(f"{name}: no cell or point has a height in both: {where}")
        if found.missing:
            self._tell_missing(found)
        absent = self._absent(len(found.error)) if raster else found.missing
        metre = self.surface.metre
        if text := height_mismatch(found.error, found.surface, metre):
            log.warning("%s %s", _named(self.surface), text)
        if not raster and self.water is None:
            self._tell_level(found)
        label, names = self._covers(found, ctx.part(0.4, 0.7))
        quarters = None if raster else Quarters.of(self.surface)
        ctx.progress(0.7)
        whole = measures(found.error)
        if self.checkpoints is not None:
            self._tell_far(found, whole)
        ctx.progress(0.8)
        covers = Table.from_rows(
            cover_rows(found, label, names, quarters, metre, ctx.part(0.8, 0.9))
        )
        errors = self._largest(found, label, names)
        ctx.progress(0.95)
        return self.Outputs(
            table=Table.from_rows(in_metres(table_rows(whole), metre)),
            covers=covers,
            report=self._report(found, label, names, quarters) if quarters else None,
            difference=raster,
            errors=errors,
            histogram=Table.from_rows(histogram(found.error / metre)),
            count=len(found.error),
            missing=found.missing,
            absent=absent,
            bias=whole["bias"],
            rmse=whole["rmse"],
            nmad=whole["nmad"],
            le95=whole["le95"],
        )

    def _found(self, ctx: Context) -> tuple[Raster | None, ErrorsAtPlaces]:
        """The difference raster, if there is one, and all errors with their positions."""
        if self.reference is None:
            return None, self._at_points()
        one, other = self.surface, self.reference
        if misfit(Lattice.of(one), Lattice.of(other)):
            values = one.band() - resampled(other, Lattice.of(one), ctx)
        else:
            values = difference(one, other, ctx)
        raster = Raster.from_lattice(
            values.astype(np.float32),
            Lattice.of(one),
            crs=one.crs,
            descriptions=("difference, surface minus reference",),
            units=one.units,
        )
        row, col = np.nonzero(np.isfinite(values))
        x, y = Lattice.of(one).centres()
        surface = one.band()
        return raster, ErrorsAtPlaces(
            np.column_stack([x[col], y[row]]),
            values[row, col],
            surface[row, col],
            np.arange(len(row)),
            int(np.isfinite(surface).sum()) - len(row),
        )

    def _absent(self, compared: int) -> int:
        """Number of cells of the reference raster without a surface, which a warning tells."""
        one, other = self.surface, self.reference
        assert other is not None
        known = np.isfinite(other.band())
        if misfit(Lattice.of(one), Lattice.of(other)):
            absent = int(np.count_nonzero(known & ~covered(one, Lattice.of(other))))
        else:
            absent = int(np.count_nonzero(known)) - compared
        warn_absent(absent, int(np.count_nonzero(known)), "cells")
        return absent

    def _at_points(self) -> ErrorsAtPlaces:
        """Errors at the checkpoints, or at the points of the cloud that take part."""
        if self.checkpoints is not None:
            import shapely

            shapes = self.checkpoints.frame.geometry.to_numpy()
            xyz, number = shapely.get_coordinates(shapes, include_z=True), np.arange(len(shapes))
        else:
            assert self.points is not None
            keep = np.ones(len(self.points), bool)
            if self.classes:
                keep = np.isin(self.points["classification"], self.classes)
            number = np.flatnonzero(without_withheld(self.points, keep))
            xyz = self.points.xyz[number]
            require_finite(xyz)
        heights = self.surface.sample(xyz[:, 0], xyz[:, 1], method="linear")
        known = np.isfinite(heights)
        return ErrorsAtPlaces(
            xyz[known, :2],
            heights[known] - xyz[known, 2],
            heights[known],
            number[known],
            int((~known).sum()),
        )

    def _tell_missing(self, found: ErrorsAtPlaces) -> None:
        """Warn of cells or points that the other layer lacks; of checkpoints by their names."""
        if self.checkpoints is None:
            log.warning("%d cells or points have no counterpart", found.missing)
            return
        shapes = self.checkpoints.frame.geometry
        without = np.setdiff1d(np.arange(len(shapes)), found.number)
        places = [
            f"{self._name_of(k)}{shapes.iloc[k].x:.10g},{shapes.iloc[k].y:.10g}"
            for k in without[:NAMED].tolist()
        ]
        more = " ..." if len(without) > NAMED else ""
        log.warning(
            "%d of %d checkpoints have no height of the surface below them: %s%s",
            len(without),
            len(shapes),
            "; ".join(places),
            more,
        )

    def _name_of(self, number: int) -> str:
        """The first attribute of a checkpoint, by which its surveyor finds it, before its place."""
        import pandas as pd

        frame = self.checkpoints.frame if self.checkpoints is not None else None
        if frame is None or len(frame.columns) < 2:
            return ""
        name = frame.drop(columns=frame.geometry.name).iloc[number, 0]
        text = "" if pd.isna(name) else " ".join(str(name).split())
        printable = "".join(letter for letter in text if letter.isprintable())
        return f"{printable[:LONGEST_NAME]} at " if printable else ""

    def _tell_far(self, found: ErrorsAtPlaces, whole: Mapping[str, Any]) -> None:
        """Warn of checkpoints that may be blunders, and of what the RMSE is without them."""
        metre = self.surface.metre
        far = far_apart(found.error, whole["median"], whole["nmad"], BLUNDER * metre)
        if not len(far):
            return
        rest = np.delete(found.error, far)
        log.warning(
            "%d of %d checkpoints are ten times the scatter from the others, the worst by %.3f m: "
            "%s%.10g,%.10g: blunders, or places where the surface is wrong; look there. The RMSE "
            "of the others is %.3f m",
            len(far),
            len(found.error),
            found.error[far[0]] / metre,
            self._name_of(int(found.number[far[0]])),
            *found.xy[far[0]],
            float(np.sqrt(np.mean(rest**2))) / metre,
        )

    def _covers(self, found: ErrorsAtPlaces, ctx: Context) -> tuple[NDArray[np.int64], list[str]]:
        """Number of the land cover of each error, and the names of the numbers.

        Raises
        ------
        DataError
            There are more than `MOST_COVERS`, or one in `vegetated` does not occur.
        """
        values: NDArray[Any]
        if not (self.cover or self.cover_attribute):
            values = np.full(len(found.error), LAND if self.water is not None else "all", object)
        elif self.cover is not None:
            values = self.cover.sample(*found.xy.T)
        elif self.areas is not None:
            of_areas = texts([*self.areas.frame[self.cover_attribute], None])
            values = of_areas[areas_at(self.areas, found.xy, ctx)]  # the last one for no polygon
        elif self.checkpoints is not None:
            values = texts(self.checkpoints.frame[self.cover_attribute])[found.number]
        else:
            assert self.points is not None
            values = self.points[str(self.cover_attribute)][found.number]
        label, names = numbered(values)
        if self.water is not None:
            label = np.where(self._in_water(found, ctx), len(names), label)
            used, label = np.unique(label, return_inverse=True)
            names = [[*names, LAID][number] for number in used]
        if len(names) > MOST_COVERS:
            raise DataError(
                f"there are {len(names)} land covers, at most {MOST_COVERS} are allowed"
            )
        if lacking := [name for name in self.vegetated or () if name not in names]:
            raise DataError(
                f"vegetated: no land cover {lacking[0]!r} was met; there are {', '.join(names)}"
            )
        return label, names

    def _in_water(self, found: ErrorsAtPlaces, ctx: Context) -> NDArray[np.bool_]:
        """Which places lie in the polygons of water; how many points of ground do is told."""
        assert self.water is not None
        wet = areas_at(self.water, found.xy, ctx) >= 0
        if self.points is not None and "classification" in self.points:
            ground = int(
                np.count_nonzero(self.points["classification"][found.number[wet]] == GROUND)
            )
            if ground:
                log.warning(
                    "%d points of class 2 (ground) lie in water that was laid level", ground
                )
        return wet

    def _tell_level(self, found: ErrorsAtPlaces) -> None:
        """Warn of points on water that may have been laid level, unless most of it all is level."""
        level = int(np.count_nonzero(on_level(self.surface, found.xy)))
        if 0 < level < len(found.error) / 2:
            log.warning(
                "%d of %d points lie where the surface is exactly level, as laid water is, and are "
                "counted as terrain; if it is water, give its outlines (water)",
                level,
                len(found.error),
            )

    def _report(
        self,
        found: ErrorsAtPlaces,
        label: NDArray[np.int64],
        names: Sequence[str],
        quarters: Quarters,
    ) -> Table:
        """Report on checkpoints, in metres."""
        green = self.vegetated or ()
        is_green = np.isin(label, [code for code, name in enumerate(names) if name in green])
        is_wet = np.isin(label, [code for code, name in enumerate(names) if name == LAID])
        rows: list[Row] = []
        kinds = ("NVA", ~is_green & ~is_wet), ("VVA", is_green & ~is_wet)
        for kind, which in kinds[: 2 if green else 1]:
            wanted = self.accuracy_class if kind == "NVA" else None
            rows += report(kind, found.error[which], self.checkpoint_rmse, wanted)
            rows += spread(kind, found.xy[which], quarters)
        if is_wet.any():
            note = "on water that was laid level: no terrain, neither NVA nor VVA"
            rows.append({"item": WET, "value": int(is_wet.sum()), "unit": "1", "note": note})
        if self.horizontal_rmse is not None:
            note = "stated by the maker of the surface, not tested"
            rows.append({"item": STATED, "value": self.horizontal_rmse, "unit": "m", "note": note})
        return Table.from_rows(in_metres(rows, self.surface.metre))

    def _largest(
        self, found: ErrorsAtPlaces, label: NDArray[np.int64], names: Sequence[str]
    ) -> Vector:
        """Layer of points at the largest errors, with the Z of the surface."""
        import geopandas
        import shapely

        few = largest(found.error, found.xy, self.largest_errors)
        frame = geopandas.GeoDataFrame(
            {
                "rank": np.arange(1, len(few) + 1),
                "error": found.error[few],
                "surface": found.surface[few],
                "reference": found.surface[few] - found.error[few],
                "cover": [names[code] for code in label[few]],
            },
            geometry=shapely.points(np.column_stack([found.xy[few], found.surface[few]])),
            crs=self.surface.crs,
        )
        if self.checkpoints is not None:  # their names, by which they are found again
            own = self.checkpoints.frame.drop(columns=self.checkpoints.frame.geometry.name)
            named = own.iloc[found.number[few]].reset_index(drop=True)
            kept = [name for name in named if name not in frame]
            frame = frame.join(named[kept])
        return Vector(frame, geometry_type="Point Z")


class ErrorsAtPlaces(NamedTuple):
    """Errors of the cells or points that have a height in both data sets.

    Attributes
    ----------
    xy : array of shape (n, 2)
    error, surface : arrays of shape (n,), surface minus reference, and the surface
    number : array of shape (n,), of each point among all of them
    missing : how many have no counterpart
    """

    xy: Array
    error: Array
    surface: Array
    number: NDArray[np.int64]
    missing: int


def on_level(raster: Raster, xy: Array) -> NDArray[np.bool_]:
    """Whether all cells around places have one height, array of shape (n,); not at the edge."""
    heights, lattice = raster.band(), Lattice.of(raster)
    rows, cols = lattice.indices(*xy.T)
    half = WINDOW // 2
    inside = (rows >= half) & (cols >= half)
    inside &= (rows < lattice.rows - half) & (cols < lattice.cols - half)
    found = inside.copy()
    rows, cols = rows[inside], cols[inside]
    same = np.ones(len(rows), bool)
    for down, right in np.ndindex(WINDOW, WINDOW):
        same &= heights[rows + down - half, cols + right - half] == heights[rows, cols]
    found[inside] = same
    return found


def covered(raster: Raster, lattice: Lattice) -> NDArray[np.bool_]:
    """Whether a raster has a value at the cell centres of another lattice, array of its shape."""
    sample, (x, y) = raster.sampler(), lattice.centres()
    return np.array([np.isfinite(sample(x, np.full(len(x), north))) for north in y])


def _named(raster: Raster) -> str:
    return raster.name or "the raster"


def _points_problem(layer: Vector) -> str | None:
    """The problem of a layer that holds no usable checkpoints; continues a sentence."""
    import shapely

    shapes = layer.frame.geometry.to_numpy()
    if not len(shapes):
        return "holds no points"
    types = {shape.geom_type if shape else "feature without a place" for shape in shapes}
    if others := sorted(types - {"Point"}):
        return f"holds a {others[0]}; checkpoints are points"
    if not np.isfinite(shapely.get_coordinates(shapes, include_z=True)).all():
        named = [str(name) for name in layer.frame if name != layer.frame.geometry.name]
        hint = f"; of a CSV it is the column z, and there are {', '.join(named)}" if named else ""
        return f"holds a point without a height (Z){hint}"
    return None


def _areas_problem(layer: Vector) -> str | None:
    """The problem of a layer that holds no valid polygons; continues a sentence."""
    shapes = layer.frame.geometry
    types = {shape.geom_type for shape in shapes if shape}
    if others := sorted(types - {"Polygon", "MultiPolygon"}):
        return f"holds a {others[0]}; areas are polygons"
    return None if shapes.dropna().is_valid.all() else "holds a polygon that is not valid"


def resampled(raster: Raster, lattice: Lattice, ctx: Context = QUIET) -> Array:
    """Values of a raster at the cell centres of another lattice, bilinear; NaN without data.

    Returns
    -------
    array of the shape of the lattice
    """
    own, (x, y) = Lattice.of(raster), lattice.centres()
    found = np.full(lattice.shape, np.nan)
    for top in range(0, lattice.rows, ROWS):
        ctx.progress(top / lattice.rows)
        some = y[top : top + ROWS]
        rows, _ = own.indices([own.west, own.west], [some[0], some[-1]])
        needed = slice(max(int(rows[0]) - 1, 0), min(int(rows[1]) + 2, own.rows))
        if needed.start < needed.stop:
            part = raster.window(needed, slice(None))
            found[top : top + ROWS] = part.sample(*np.meshgrid(x, some), method="linear")
    return found


def texts(values: Iterable[Any]) -> NDArray[Any]:
    """Values of land cover as texts; None where missing."""
    import pandas as pd

    return np.array([None if pd.isna(value) else _text(value) for value in values], object)


def _text(value: Any) -> str:
    return f"{value:.15g}" if isinstance(value, float) else str(value)


def numbered(values: NDArray[Any]) -> tuple[NDArray[np.int64], list[str]]:
    """Number of each value in sorted order, and names of the numbers; missing values come last.

    Returns
    -------
    array of shape (n,), and the name of each number in it
    """
    import pandas as pd

    label, found = pd.factorize(values, sort=True)  # -1 for None and NaN
    names = [_text(value) for value in found.tolist()]
    if (missing := label < 0).any():
        return np.where(missing, len(names), label), [*names, UNKNOWN]
    return label, names


def table_rows(whole: Mapping[str, Any]) -> Iterator[Row]:
    """Table rows: one per measure."""
    for name, value in whole.items():
        unit = "1" if name in COUNTS else "m"
        yield {"measure": name, "value": value, "unit": unit, "meaning": MEANING[name]}


def cover_rows(
    found: ErrorsAtPlaces,
    label: NDArray[np.int64],
    names: Sequence[str],
    quarters: Quarters | None,
    metre: float,
    ctx: Context,
) -> Iterator[Row]:
    """Table rows: one per land cover, in metres; for points with the emptiest quarter."""
    for code, name in enumerate(names):
        ctx.progress(code / len(names))
        here = label == code
        row: Row = {"cover": name} | measures(found.error[here] / metre)
        if quarters:
            row["emptiest_quarter"] = float(quarters.shares(found.xy[here]).min())
        yield row


def in_metres(rows: Iterable[Row], metre: float) -> Iterator[Row]:
    """Table rows with lengths converted to metres."""
    for row in rows:
        is_length = row["unit"] == "m" and row["value"] is not None
        yield row | ({"value": row["value"] / metre} if is_length else {})


def report(kind: str, error: Array, own: float | None, wanted: float | None) -> Iterator[Row]:
    """Rows of the ASPRS report on non-vegetated (NVA) or vegetated (VVA) checkpoints.

    Parameters
    ----------
    kind : "NVA" or "VVA"
    error : array of shape (n,), surface minus checkpoint
    own : RMSE of the checkpoints themselves, if known
    wanted : RMSE to meet, if any
    """

    def row(item: str, value: float | None, note: str, unit: str = "m") -> Row:
        return {"item": f"{kind} {item}", "value": value, "unit": unit, "note": note}

    enough = "enough" if len(error) >= FEWEST else "TOO FEW"
    yield row("checkpoints", len(error), f"{enough}: at least {FEWEST} are needed", "1")
    if not len(error):
        return
    fit = measures(error)
    yield row("mean error", fit["bias"], "surface minus checkpoint")
    yield row("standard deviation", fit["std"], "")
    yield row("RMSEV1", fit["rmse"], "fit of the surface to the checkpoints")
    yield row("RMSEV2", own, _own_note(own, wanted))
    total = math.hypot(fit["rmse"], own or 0.0)
    if kind == "VVA":
        yield row("RMSEV", total, "root of RMSEV1² + RMSEV2²; reported as found, no pass or fail")
        yield row("95th percentile", fit["le95"], "vegetated accuracy of Edition 1 (2014)")
        return
    yield row("RMSEV", total, "root of RMSEV1² + RMSEV2²")
    yield row("1.96 RMSEV1", CONFIDENCE * fit["rmse"], "accuracy at 95 % of Edition 1 (2014)")
    if wanted is not None:
        verdict = "met" if total <= wanted else "NOT MET"
        if len(error) < FEWEST:
            verdict += f", by fewer than {FEWEST} checkpoints"
        yield row("accuracy class", wanted, verdict)


def _own_note(own: float | None, wanted: float | None) -> str:
    if own is None:
        return "of the checkpoints themselves: not given, taken as 0"
    if wanted is not None and own > wanted / 2:
        return "of the checkpoints themselves: MORE THAN HALF of the class to meet"
    return "of the checkpoints themselves"


def largest(error: Array, xy: Array, count: int) -> NDArray[np.int64]:
    """Indices of the largest errors by size; equal ones from west to east, south to north.

    Parameters
    ----------
    error : array of shape (n,)
    xy : array of shape (n, 2)
    """
    size = np.abs(error)
    least = np.partition(size, -count)[-count] if count < len(size) else 0.0
    some = np.flatnonzero(size >= least)
    order = np.lexsort([xy[some, 1], xy[some, 0], -size[some]])
    return some[order][:count]


def histogram(error: Array) -> Iterator[Row]:
    """Table rows: bins of a histogram with low, high, count and unit; outermost bins are open.

    The others lie between the outermost half percents, whole multiples of a round width apart.

    Parameters
    ----------
    error : array of shape (n,), metres
    """
    first, low, high, last = np.quantile(error, (0.005, 0.25, 0.75, 0.995))
    width = max(2 * (high - low) / np.cbrt(len(error)), (last - first) / MOST_BINS, 1e-6)
    width = rounded_up(float(width))
    edges = width * np.arange(math.floor(first / width), math.ceil(last / width) + 1)
    if len(edges) == 1:  # all errors are one multiple of the width
        edges = np.append(edges, edges[0] + width)
    place = np.searchsorted(edges, error, side="right")
    ends: list[float | None] = [None, *(float(f"{edge:.9g}") for edge in edges), None]
    for number, count in enumerate(np.bincount(place, minlength=len(edges) + 1)):
        yield {"low": ends[number], "high": ends[number + 1], "count": int(count), "unit": "m"}


def rounded_up(length: float) -> float:
    """A length rounded up to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(length))
    return next(f for f in (1, 2, 5, 10) if f * power >= length * (1 - 1e-9)) * power
