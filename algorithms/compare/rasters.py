"""How well a map of classes agrees with another map, with polygons or with a sample of points.

What each figure means, and when to trust it: docs/explanation/accuracy-of-classes.md.

References
----------
Pontius, R. G. and Millones, M. (2011). Death to kappa: birth of quantity disagreement and
allocation disagreement for accuracy assessment. International Journal of Remote Sensing 32(15),
4407-4429.
Olofsson, P. et al. (2014). Good practices for estimating area and assessing accuracy of land
change. Remote Sensing of Environment 148, 42-57.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.compare import _accuracy
from algorithms.compare._legend import NONE, Legend, codes_in, map_problem, names_of, numbers
from algorithms.compare._shapes import AREAS, areas_at, layer_problem
from algorithms.compare._unseen import (
    no_limits,
    not_compared,
    warn_absent,
    warn_few,
)
from algorithms.shared import parameters
from algorithms.shared.accuracy.blocks import Blocks, Clumping, blocks
from algorithms.shared.accuracy.certainty import warn_blocks, warn_clumps
from algorithms.shared.accuracy.columns import COUNTS, OF_CLASSES
from algorithms.shared.accuracy.confusion import Confusion
from algorithms.shared.alignment import misfit, offset
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, Raster, Table, Vector
from toolbox.data.crs import crs_conflict, length_problem
from toolbox.data.layer import extents
from toolbox.declare import ClassList, outputs, param, show, sink, source, tool
from toolbox.errors import DataError

SAME, DIFFERENT, NOT_COMPARED = 0, 1, 255
POINTS = ("Point",)
TEXTS = 1 << 16  # codes from here on stand for classes that are texts

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Pairs(NamedTuple):
    """Cells, or points of a sample, with both classes: where, as mapped, in the reference.

    Attributes
    ----------
    cell : rows and columns of the map
    missing : cells of the map, or points, that have no counterpart
    absent, known : cells or points of the reference without a class in the map, and all of them,
        without classes that are left out
    """

    xy: Array
    said: Ints
    true: Ints
    cell: tuple[Ints, Ints]
    missing: int
    absent: int
    known: int


@tool(
    "compare.rasters",
    title="Accuracy of a raster",
    tags=("accuracy", "kappa", "confusion", "raster", "landcover", "validation", "iou"),
)
class CompareRasters:
    """Compare a raster of classes with a reference: a raster, polygons or points with classes.

    A reference raster lies on the same cells. Of polygons, `class_attribute` holds the class
    of all cells whose centres they hold. Of points it holds what was seen there; each is compared
    with the cell that it lies in. Classes of the attribute are codes, or names as of `map`, which
    merges and names codes, as in `3,4,5=vegetation 6=building`.

    There are the confusion matrix, overall accuracy, kappa, quantity disagreement (the classes are
    not of the right size) and allocation disagreement (they are elsewhere), and for each class
    producer's and user's accuracy, F1 and IoU, with 95 % intervals by drawing square blocks with
    replacement (`block`). Cells without a value in both are not compared, but counted: those of the
    map are `missing`, those of the reference `absent`, with what polygons hold beyond the map.

    If points were drawn class by class from the map, `stratified` weights them by the area that
    each class has on the map, after Olofsson et al. (2014): `areas` has the accuracies and
    the area of each class, corrected for the errors of the map, with 95 % intervals.
    """

    classes: Raster = source("Raster of classes to judge", label="Classes to judge")
    reference: Raster | None = source("Raster of true classes", default=None)
    areas: Vector | None = source("Polygons with true classes", default=None, shapes="polygon")
    checkpoints: Vector | None = source("Points with true classes", default=None, shapes="point")
    class_attribute: str | None = param(
        "Attribute of polygons or points that is the true class", default=None, of="areas"
    )
    map: tuple[str, ...] | None = parameters.map()
    reference_map: tuple[str, ...] | None = parameters.reference_map()
    leave_out: ClassList | None = parameters.leave_out()
    stratified: bool = param(
        "Points were drawn class by class from the map, and count for its area", default=False
    )
    block: float | None = parameters.block()
    seed: int = parameters.seed()

    @outputs
    class Outputs:
        accuracy: Table = sink("One row per measure of all classes, with intervals")
        by_class: Table = sink(
            "One row per class: its accuracies with intervals", columns=COUNTS | OF_CLASSES
        )
        confusion: Table = sink(
            "Full confusion matrix: a row per reference class",
            show=show.Matrix("reference", ("total",)),
            label="Confusion matrix",
        )
        class_areas: Table | None = sink(
            "Accuracy and area of each class, from a stratified sample"
        )
        difference: Raster | None = sink("Cells with 0 where classes are the same, 1 where not")
        overall_accuracy: float = sink("Cells or points of the class of the reference", unit="%")
        kappa: float | None = sink("Agreement beyond chance (Cohen)", unit="1")
        quantity_disagreement: float = sink("Classes are of other sizes than they should", unit="%")
        allocation_disagreement: float = sink("Classes of the right size are elsewhere", unit="%")
        count: int = sink("Cells or points compared", unit="1")
        missing: int = sink("Cells of the map, or points, without a counterpart", unit="1")
        absent: int = sink("Cells or points of the reference without a counterpart", unit="1")

        def not_looked_at(self) -> Iterator[str]:
            """What the figures say nothing of."""
            if self.missing:
                yield f"Cells or points without a counterpart: {self.missing}."
            yield from not_compared(self.count, self.absent, "cells or points")
            yield from no_limits(self.accuracy.rows())

    def check(self) -> Iterator[tuple[str, str]]:
        """Classes are named once."""
        for name in ("map", "reference_map"):
            if text := map_problem(getattr(self, name)):
                yield name, text

    def check_data(self) -> Iterator[tuple[str, str]]:
        """There is one reference, in the CRS and on the cells of the map."""
        given = [n for n in ("reference", "areas", "checkpoints") if getattr(self, n) is not None]
        if len(given) != 1:
            there = " and ".join(given) or "none"
            yield "reference", f"give one of reference, areas and checkpoints, got {there}"
        for name in ("classes", "reference"):
            raster: Raster | None = getattr(self, name)
            if raster is not None and len(raster.values) != 1:
                yield name, f"{_named(raster)} has {len(raster.values)} bands; give one"
        if self.stratified and self.checkpoints is None:
            yield "stratified", "is for checkpoints that were drawn class by class"
        if self.reference is not None:
            yield from self._raster_problems(self.reference)
        for name, types, word in (("areas", AREAS, "polygons"), ("checkpoints", POINTS, "points")):
            layer: Vector | None = getattr(self, name)
            if layer is not None:
                yield from self._layer_problems(name, layer, types, word)

    def _raster_problems(self, other: Raster) -> Iterator[tuple[str, str]]:
        text = crs_conflict(other.crs, self.classes.crs, heights=False)
        text = text or misfit(Lattice.of(self.classes), Lattice.of(other))
        if text:
            yield "reference", f"{_named(other)} {text} of {_named(self.classes)}"
        if self.class_attribute is not None:
            yield "class_attribute", "is for polygons or points, not for a reference raster"

    def _layer_problems(
        self, name: str, layer: Vector, types: tuple[str, ...], word: str
    ) -> Iterator[tuple[str, str]]:
        if text := layer_problem(layer, types, word):
            yield name, text
        elif text := crs_conflict(layer.crs, self.classes.crs, heights=False):
            yield name, f"{layer.name} {text} of {_named(self.classes)}"
        if self.class_attribute not in layer.names:
            known = ", ".join(layer.names) or "none"
            yield "class_attribute", f"no attribute {self.class_attribute!r}; there are {known}"

    def halo(self) -> float:
        """Infinite, as the figures are those of the whole."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> CompareRasters.Outputs:
        """Pair the cells, count them by block, and sum up."""
        names = names_of(self.map or ())
        true_names = names_of(
            self.reference_map if self.reference_map is not None else self.map or ()
        )
        sampled = self.checkpoints is not None
        pairs, texts = self._at_points() if sampled else self._of_cells(ctx.part(0.0, 0.6))
        if pairs.missing:
            log.warning(
                "%d cells or points are not compared: one of both has no class", pairs.missing
            )
        what = "points" if sampled else "cells"
        if not sampled:  # of points, missing has told it
            warn_absent(pairs.absent, pairs.known, what)
        if not len(pairs.said):
            known = {name: getattr(self, name) for name in ("reference", "areas", "checkpoints")}
            where = extents(classes=self.classes, **{n: v for n, v in known.items() if v})
            raise DataError(f"classes: no cell or point has a class in both: {where}")
        codes = codes_in(pairs.said, "classes"), codes_in(pairs.true, "reference")
        legend = Legend.of(*codes, names, true_names | texts, self.leave_out or ())
        truth = numbers(pairs.true, legend.true)
        counted = truth != NONE
        if not counted.any():
            raise DataError("leave_out: no cell is left that has a reference class")
        warn_few(int(np.count_nonzero(counted)), what)
        ground, side = self._blocks(pairs.xy[counted])
        ctx.progress(0.7)
        number = _spread(ground.number, counted)
        by_block = legend.tally(pairs.said, pairs.true, number, ground.square)
        warn_clumps(Clumping.of(by_block))
        confusion = legend.confusion(by_block)
        found = confusion.measures()
        ctx.progress(0.9)
        return self.Outputs(
            accuracy=Table.from_rows(_accuracy.rows(confusion, by_block, side, self.seed)),
            by_class=Table.from_rows(_accuracy.class_rows(confusion, by_block, self.seed)),
            confusion=Table.from_rows(_accuracy.matrix_rows(confusion)),
            class_areas=self._class_areas(confusion, legend, names) if self.stratified else None,
            difference=self._difference(pairs, legend, truth),
            overall_accuracy=found["overall_accuracy"] or 0.0,
            kappa=found["kappa"],
            quantity_disagreement=found["quantity_disagreement"] or 0.0,
            allocation_disagreement=found["allocation_disagreement"] or 0.0,
            count=int(np.count_nonzero(counted)),
            missing=pairs.missing,
            absent=pairs.absent,
        )

    def _at_points(self) -> tuple[Pairs, dict[int, str]]:
        """Both classes at the points of a sample, and the names of classes that are texts."""
        assert self.checkpoints is not None
        true, texts = _codes_of(self.checkpoints, self.class_attribute)
        shapes = self.checkpoints.frame.geometry
        xy = np.column_stack([shapes.x, shapes.y])
        said = self.classes.sample(*xy.T)
        known = np.isfinite(said) & np.isfinite(true)
        cell = Lattice.of(self.classes).indices(*xy[known].T)
        asked = self._asked(true)
        pairs = Pairs(
            xy[known],
            _whole(said[known]),
            _whole(true[known]),
            cell,
            missing=int((~known).sum()),
            absent=int(np.count_nonzero(asked & ~known)),
            known=int(np.count_nonzero(asked)),
        )
        return pairs, texts

    def _of_cells(self, ctx: Context) -> tuple[Pairs, dict[int, str]]:
        """Both classes of the cells, and the names of classes that are texts."""
        mapped, texts = self.classes.band(), dict[int, str]()
        x, y = Lattice.of(self.classes).centres()
        if self.areas is not None:
            codes, texts = _codes_of(self.areas, self.class_attribute)
            rows, cols = (part.ravel() for part in np.indices(mapped.shape))
            found = areas_at(self.areas, np.column_stack([x[cols], y[rows]]), ctx)
            truth = np.append(codes, np.nan)[found].reshape(mapped.shape)  # the last: no polygon
            beyond = self._cells_beyond(self.areas, self._asked(codes))
        else:
            truth = self._on_cells(self.reference, mapped.shape)
            assert self.reference is not None
            every = int(np.count_nonzero(self._asked(self.reference.band())))
            beyond = every - int(np.count_nonzero(self._asked(truth)))
        known = np.isfinite(mapped) & np.isfinite(truth)
        rows, cols = np.nonzero(known)
        asked = self._asked(truth)
        pairs = Pairs(
            np.column_stack([x[cols], y[rows]]),
            _whole(mapped[known]),
            _whole(truth[known]),
            (rows, cols),
            missing=int(np.count_nonzero(np.isfinite(mapped) & ~known)),
            absent=int(np.count_nonzero(asked & ~known)) + beyond,
            known=int(np.count_nonzero(asked)) + beyond,
        )
        return pairs, texts

    def _asked(self, truth: Array) -> NDArray[np.bool_]:
        """Whether there is a class of the reference, and none that is left out."""
        return np.isfinite(truth) & ~np.isin(truth, self.leave_out or ())

    def _cells_beyond(self, areas: Vector, asked: NDArray[np.bool_]) -> int:
        """Area of some polygons beyond the edges of the map, in cells."""
        shapes = areas.frame.geometry[asked].to_numpy()
        inside = shapely.clip_by_rect(shapes, *self.classes.bounds)
        beyond = shapely.area(shapes).sum() - shapely.area(inside).sum()
        return round(float(beyond) / self.classes.cell**2)

    def _on_cells(self, other: Raster | None, shape: tuple[int, ...]) -> Array:
        """Classes of the reference on the cells of the map, NaN beyond it."""
        assert other is not None
        found = np.full(shape, np.nan)
        down, right = offset(Lattice.of(self.classes), Lattice.of(other))
        values = other.band()
        own = [slice(max(d, 0), d + n) for d, n in zip((down, right), values.shape, strict=True)]
        part = found[own[0], own[1]]
        top, left = max(-down, 0), max(-right, 0)
        part[:] = values[top : top + part.shape[0], left : left + part.shape[1]]
        return found

    def _blocks(self, xy: Array) -> tuple[Blocks, float | None]:
        """Blocks of the cells or points, and the side of the blocks in metres, None in degrees."""
        in_degrees = self.block is None and length_problem(self.classes.crs) is not None
        metre = np.nan if in_degrees else self.classes.metre
        ground = blocks(xy, self.block)
        warn_blocks(ground, "cells")
        return ground, None if in_degrees else ground.side / metre

    def _class_areas(self, confusion: Confusion, legend: Legend, names: Mapping[int, str]) -> Table:
        """Areas by the sample, with those of all cells of the map as weights of the classes."""
        mapped = self.classes.band()
        codes, cells = np.unique(mapped[np.isfinite(mapped)], return_counts=True)
        area = (self.classes.cell / self.classes.metre) ** 2
        areas = dict.fromkeys(confusion.labels, 0.0)
        for code, count in zip(codes, cells, strict=True):
            label = names.get(int(code), f"class {int(code)}")
            if label not in areas:
                text = "the map has %s, of which there is no sample; areas leave it out"
                log.warning(text, label)
                continue
            areas[label] += float(count * area)
        return Table.from_rows(_accuracy.area_rows(confusion, np.array([*areas.values()])))

    def _difference(self, pairs: Pairs, legend: Legend, truth: Ints) -> Raster | None:
        if self.checkpoints is not None:
            return None
        values = np.full(self.classes.shape, NOT_COMPARED, np.uint8)
        differs = np.where(numbers(pairs.said, legend.said) == truth, SAME, DIFFERENT)
        values[pairs.cell] = np.where(truth == NONE, NOT_COMPARED, differs)
        return Raster.from_lattice(
            values,
            Lattice.of(self.classes),
            crs=self.classes.crs,
            nodata=NOT_COMPARED,
            descriptions=("difference of classes, 1 where they differ",),
        )


def _spread(number: Ints, counted: NDArray[np.bool_]) -> Ints:
    """Block of every cell; 0 of those that are not counted, which no matrix takes."""
    found = np.zeros(len(counted), np.int64)
    found[counted] = number
    return found


def _codes_of(layer: Vector, attribute: str | None) -> tuple[Array, dict[int, str]]:
    """Code of each feature, NaN where there is none, and the names of codes that are texts."""
    column = layer.frame[attribute]
    try:
        return column.to_numpy(float, na_value=np.nan), {}
    except (ValueError, TypeError):
        names = sorted({str(value) for value in column.dropna()})
        number = {name: float(TEXTS + k) for k, name in enumerate(names)}
        codes = column.astype(str).where(column.notna()).map(number)
        return codes.to_numpy(float), {int(code): name for name, code in number.items()}


def _whole(codes: Array) -> Ints:
    """Codes as integers.

    Raises
    ------
    DataError
        One is not whole.
    """
    if (odd := codes % 1 != 0).any():
        raise DataError(f"classes: classes must be whole numbers, got {codes[odd][0]:g}")
    return codes.astype(np.int64)


def _named(raster: Raster) -> str:
    return raster.name or "the raster"
