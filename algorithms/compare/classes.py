"""How well a classification agrees with a reference, point by point.

What each figure means, and when to trust it: docs/explanation/accuracy-of-classes.md.

References
----------
Şen, A. and Bayaslı, B. (2020): the matrix of three classes and the filter errors together.
Olofsson, P. et al. (2014). Good practices for estimating area and assessing accuracy of land
change. Remote Sensing of Environment 148, 42-57.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.compare import _accuracy
from algorithms.compare._counterparts import Columns, counterparts
from algorithms.compare._counts import Counts
from algorithms.compare._legend import NONE, Legend, codes_in, map_problem, names_of, numbers
from algorithms.compare._outcomes import (
    CORRECT_NEGATIVE,
    CORRECT_POSITIVE,
    NO_REFERENCE,
    OTHER_CLASS,
    OUTCOMES,
    TYPE_1,
    TYPE_2,
)
from algorithms.compare._paired import paired_rows
from algorithms.compare._unseen import (
    no_limits,
    not_compared,
    warn_absent,
    warn_few,
    warn_not_known,
)
from algorithms.shared import parameters
from algorithms.shared.accuracy.blocks import Blocks, Clumping, Tallies, blocks
from algorithms.shared.accuracy.certainty import warn_blocks, warn_clumps
from algorithms.shared.accuracy.columns import COUNTS, OF_CLASSES, shown
from algorithms.shared.ground import without_withheld
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Table
from toolbox.data.crs import length_problem
from toolbox.declare import Attribute, ClassList, outputs, param, show, sink, source, tool
from toolbox.errors import DataError

# Attributes that the sensor gave, in the order in which they tell points at one position apart.
RECORDED = (
    "gps_time",
    "return_number",
    "number_of_returns",
    "point_source_id",
    "scanner_channel",
    "scan_angle",
    "scan_angle_rank",
    "intensity",
    "red",
    "green",
    "blue",
    "nir",
)
# Red, green and blue of the values of `error`, from 0 to 255.
COLOURS = [tuple(bytes.fromhex(colour.removeprefix("#"))) for _, colour in OUTCOMES.values()]
MEANING = "0 1 right 2 3 Type I II 5 other"  # no more than 32 characters fit into a LAS file
SIXTEEN_BIT = 257  # from 0..255 to 0..65535
MOST_STRATA = 256
UNCLASSIFIED = 1
STRATA = shown(
    *("type_1", "type_2", "total_error", "correctness", "completeness", "quality", "kappa"),
    *("overall_accuracy", "mean_f1", "mean_iou", "kappa_of_classes"),
)
OF_INTEREST, OTHERS = "of interest", "all others"  # names of the only two classes

Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]


@tool(
    "compare.classes",
    title="Accuracy of classes",
    tags=(
        "accuracy",
        "kappa",
        "confusion",
        "matrix",
        "error",
        "validation",
        "f1",
        "completeness",
        "correctness",
    ),
)
class CompareClasses:
    """Compare the classes of points with reference classes.

    The reference is either another cloud, whose points are found by their coordinates, or another
    attribute of the same cloud. `map` merges and names classes of both, as in `3,4,5=vegetation
    6=building`; `reference_map` is for a reference with other codes. Points whose reference class
    is in `leave_out` (such as those without a label) are counted, and compared with nothing.

    Of all classes there are the confusion matrix, overall accuracy, kappa (also weighted, for
    classes that have an order), MCC, quantity and allocation disagreement, and for each class
    producer's and user's accuracy, F1 and IoU. Errors of neighbouring points come together;
    therefore the 95 % intervals are made by drawing square blocks of ground with replacement
    (`block`). `stratum` counts apart for each value of an attribute, such as return_number.
    In `strata` these limits are called block; those beside them take each point for itself, and
    are too narrow.

    For ground filters `positive` names the class of interest, ground by default; points of all
    other classes count as objects. For labels where ground is 0, as in the ISPRS filter test, give
    `reference_positive` 0: where it shares no code with `positive`, and no map names the classes,
    these are the only two. Type I is the share of reference ground that was lost, Type II the share
    of reference objects that was taken for ground. The first pair of limits in `table` is that of
    Wilson for shares, of Fleiss, Cohen and Everitt for kappa, which holds for independent points
    and is the least uncertainty; the second pair is that of the blocks.

    The attribute `error` is 0 where a class of interest is right, 1 where another one is, 2 for
    Type I, 3 for Type II, 4 without a reference class or left out, and 5 for any other difference
    of classes. What a ground filter left unclassified (1) counts as right there, unless `map` names
    class 1.

    With `other_attribute`, or another cloud as `other`, a second classification of the same points
    is compared, and `difference` tells whether it differs by more than luck. If the points are a
    sample that was drawn class by class from a map, give the `mapped_area` of each class: then
    `areas` has accuracies and areas after Olofsson et al. (2014).

    Coordinates are the same if they agree to 0.000001 units (0.000000001 where none exceeds 360,
    as degrees). Several points at one position are told apart by the attributes that both clouds
    have, GPS time and return number first, and where all those are equal in favour of the
    classification; each takes one reference point. With `max_distance`, points left over take the
    nearest reference point, which may then serve several. Points without a counterpart are counted
    and reported, and so are reference points that are nobody's counterpart (`absent`).
    """

    points: PointCloud = source("Classified points")
    reference: PointCloud | None = source(
        "Reference points; leave out to use the same points", default=None
    )
    other: PointCloud | None = source("The same points with another classification", default=None)
    attribute: Attribute = param(
        "Attribute that holds the class", default=Attribute("classification"), of="points"
    )
    reference_attribute: Attribute = param(
        "Attribute that holds the reference class",
        default=Attribute("classification"),
        label="Attribute of the reference",
    )
    other_attribute: Attribute | None = param(
        "Attribute that holds another class, of the points or of the other cloud", default=None
    )
    map: tuple[str, ...] | None = parameters.map()
    reference_map: tuple[str, ...] | None = parameters.reference_map()
    leave_out: ClassList | None = parameters.leave_out()
    positive: ClassList = param(
        "Classes of interest", default=ClassList([2]), label="Classes of interest"
    )
    reference_positive: ClassList | None = param(
        "Classes of interest in the reference, if they differ",
        default=None,
        label="Classes of interest in the reference",
    )
    max_distance: float | None = param(
        "Farthest counterpart in the other cloud; the same coordinates by default",
        default=None,
        unit="m",
        gt=0,
        label="Farthest counterpart",
    )
    stratum: Attribute | None = param(
        "Attribute by whose values errors are also counted apart",
        default=None,
        of="points",
        label="Count errors apart by",
    )
    mapped_area: tuple[str, ...] | None = param(
        "Mapped area of each class, such as vegetation=1200, if points are a sample drawn by class",
        default=None,
    )
    block: float | None = parameters.block()
    seed: int = parameters.seed()
    colours: bool = param(
        "Give the points the colours of their errors as red, green and blue",
        default=False,
        label="Colour points by error",
    )

    @outputs
    class Outputs:
        table: Table = sink("One row per measure of the class of interest, with intervals")
        accuracy: Table = sink("One row per measure of all classes, with intervals")
        classes: Table = sink(
            "One row per class: its accuracies with intervals",
            label="Accuracy of each class",
            columns=COUNTS | OF_CLASSES,
        )
        confusion: Table = sink(
            "Full confusion matrix: a row per reference class",
            show=show.Matrix("reference", ("total",)),
            label="Confusion matrix",
        )
        strata: Table = sink("One row per value of the stratum, or one for all", columns=STRATA)
        difference: Table | None = sink("One row per measure of two classifications")
        areas: Table | None = sink(
            "Accuracy and area of each class, from a sample drawn by class",
            columns=shown("users_accuracy", "producers_accuracy", "overall_accuracy"),
        )
        errors: PointCloud = sink(
            "The points with the attribute `error`, whose values the help explains",
            show=show.Classes("error", OUTCOMES),
        )
        overall_accuracy: float = sink("Points of the class of the reference", unit="%")
        kappa_of_classes: float | None = sink("Agreement of all classes beyond chance", unit="1")
        type_1: float | None = sink(
            "Reference ground that was lost, b / (a + b)", unit="%", label="Type I error"
        )
        type_2: float | None = sink(
            "Reference objects taken for ground, c / (c + d)", unit="%", label="Type II error"
        )
        total_error: float | None = sink(
            "Points on the wrong side, (b + c) / (a + b + c + d)", unit="%"
        )
        kappa: float | None = sink("Agreement beyond chance (Cohen)", unit="1")
        unmatched: int = sink("Points without a counterpart in the reference", unit="1")
        absent: int = sink("Points of the reference without a counterpart", unit="1")
        left_out: int = sink("Points whose reference class is left out", unit="1")

        def not_looked_at(self) -> Iterator[str]:
            """What the figures say nothing of."""
            counted = sum(row["total"] for row in self.confusion.rows())
            if self.unmatched:
                yield f"Points without a counterpart in the reference: {self.unmatched}."
            yield from not_compared(counted, self.absent, "points")
            yield from no_limits(self.accuracy.rows())

    def check(self) -> Iterator[tuple[str, str]]:
        """Classes are named once."""
        for name in ("map", "reference_map"):
            if text := map_problem(getattr(self, name)):
                yield name, text
        if text := _accuracy.area_problem(self.mapped_area):
            yield "mapped_area", text

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The reference and the other classification differ from the points, and have classes."""
        where = self.reference or self.points
        if self.reference_attribute not in where:
            known, name = ", ".join(where.names) or "none", self.reference_attribute
            yield "reference_attribute", f"no attribute {name!r}; there are {known}"
        if self.reference is None and self.reference_attribute == self.attribute:
            yield "reference", "give reference points, or another reference_attribute"
        if (second := self._other_attribute) is None:
            return
        if second not in (there := self.other or self.points):
            known = ", ".join(there.names) or "none"
            yield "other_attribute", f"no attribute {second!r}; there are {known}"
        if self.other is None and second == self.attribute:
            yield "other_attribute", f"{second!r} is the attribute that it is to be compared with"

    @property
    def _other_attribute(self) -> Attribute | None:
        """Where the other classification is; that of the points in another cloud, if not said."""
        return self.other_attribute or (self.attribute if self.other is not None else None)

    def halo(self) -> float:
        """Largest distance of a counterpart outside a tile."""
        return self.max_distance or 0.0

    def run(self, ctx: Context = QUIET) -> CompareClasses.Outputs:
        """Match the points, count the errors, and mark them."""
        said, true, matched, absent = self._classes(ctx.part(0.0, 0.6))
        of_class = matched & np.isin(true, self.leave_out or ())
        counted = without_withheld(self.points, matched & ~of_class, ctx)
        if not counted.any():
            raise DataError(
                "leave_out: no point is left that has a reference class and is not withheld"
            )
        warn_few(int(np.count_nonzero(counted)), "points")
        ground, side = self._blocks(counted)
        ctx.progress(0.65)
        is_said = np.isin(said, self.positive)
        is_true = np.isin(true, self._truth)
        of_interest = bool(is_said[counted].any() or is_true[counted].any())
        if not of_interest:
            self._tell_of_no_interest()
        legend = self._legend(said[counted], true[counted])
        by_block = legend.tally(said[counted], true[counted], ground.number, ground.square)
        warn_clumps(Clumping.of(by_block))
        confusion = legend.confusion(by_block)
        warn_not_known(confusion)
        summary = confusion.measures()
        ctx.progress(0.8)
        filtered = _by_block(is_said[counted], is_true[counted], ground)
        counts = Counts.of(is_said[counted], is_true[counted])
        missing = int((~matched).sum())
        outputs = self.Outputs(
            table=Table.from_rows(
                _accuracy.filter_rows(counts, missing, absent, filtered, self.seed)
            ),
            accuracy=Table.from_rows(_accuracy.rows(confusion, by_block, side, self.seed)),
            classes=Table.from_rows(_accuracy.class_rows(confusion, by_block, self.seed)),
            confusion=Table.from_rows(_accuracy.matrix_rows(confusion)),
            strata=Table.from_rows(self._strata(said, true, matched, counted, ground, legend)),
            difference=self._difference(said, true, counted, ground, ctx.part(0.8, 0.95)),
            areas=self._areas(confusion),
            errors=self._marked(
                is_said, is_true, counted, self._differ(said, true, legend, counted)
            ),
            overall_accuracy=summary["overall_accuracy"] or 0.0,
            kappa_of_classes=summary["kappa"],
            type_1=counts.type_1,
            type_2=counts.type_2,
            total_error=counts.total_error if of_interest else None,
            kappa=counts.kappa,
            unmatched=int(np.count_nonzero(~matched & self.points.core)),
            absent=absent,
            left_out=int(np.count_nonzero(of_class & self.points.core)),
        )
        ctx.progress(1.0)
        return outputs

    def _classes(self, ctx: Context) -> tuple[NDArray[Any], NDArray[Any], Mask, int]:
        """Class of each point, that of its counterpart, whether it has one, and what is absent."""
        where = self.reference
        found = self._counterparts(where, self.reference_attribute, self._truth, ctx)
        matched = found >= 0
        if not matched.any():
            raise DataError("reference: no point has a counterpart; are these the same points?")
        if unmatched := int((~matched).sum()):
            log.warning("%d of %d points have no counterpart", unmatched, len(found))
        true = (where or self.points)[self.reference_attribute][found]
        return self.points[self.attribute], true, matched, self._absent(found[matched])

    def _absent(self, found: Ints) -> int:
        """Number of reference points that are nobody's counterpart, which a warning tells.

        Those that the comparison leaves out by their class are nothing that could be absent.
        """
        if self.reference is None:
            return 0
        asked = self.reference.core & ~np.isin(
            self.reference[self.reference_attribute], self.leave_out or ()
        )
        total = int(np.count_nonzero(asked))
        asked[found] = False
        absent = int(np.count_nonzero(asked))
        warn_absent(absent, total, "points")
        return absent

    @property
    def _truth(self) -> ClassList:
        return self.reference_positive or self.positive

    def _blocks(self, counted: Mask) -> tuple[Blocks, float | None]:
        """Blocks of the points that are counted, and the side of the blocks in metres.

        The side is None for points in degrees, in which no block can be asked for.
        """
        in_degrees = self.block is None and length_problem(self.points.crs) is not None
        metre = np.nan if in_degrees else self.points.metre
        ground = blocks(self.points.xyz[counted, :2], self.block)
        warn_blocks(ground, "points")
        return ground, None if in_degrees else ground.side / metre

    def _legend(self, said: NDArray[Any], true: NDArray[Any]) -> Legend:
        codes = codes_in(said, "attribute"), codes_in(true, "reference_attribute")
        return Legend.of(*codes, *self._names(*codes))

    def _names(self, said: Ints, true: Ints) -> tuple[dict[int, str], dict[int, str]]:
        """Name of each code that has one, in the classification and in the reference.

        Where the reference has codes of its own, and nobody names them, all that is known of them
        is whether they are of interest: 0 and 1 against 2 and 1 would otherwise all be errors.
        """
        own_codes = {*self._truth}.isdisjoint(self.positive)
        if own_codes and self.map is None and self.reference_map is None:
            sides = (said, self.positive), (true, self._truth)
            one, other = (
                {int(code): OF_INTEREST if code in interest else OTHERS for code in codes}
                for codes, interest in sides
            )
            return one, other
        reference = self.reference_map if self.reference_map is not None else self.map
        return names_of(self.map or ()), names_of(reference or ())

    def _tell_of_no_interest(self) -> None:
        """Warn that no point is of the classes of interest: 0 % would be wrong otherwise."""
        log.warning(
            "positive: no point is of class %s, and none of the reference of class %s: nothing is "
            "known of its errors",
            self.positive,
            self._truth,
        )

    def _differ(
        self, said: NDArray[Any], true: NDArray[Any], legend: Legend, counted: Mask
    ) -> Mask:
        """Which points have another class than in the reference, array of shape (n,).

        A ground filter leaves objects unclassified (1): unless `map` names that, it is no answer.
        """
        differ = np.zeros(len(said), bool)
        answers = counted & ((said != UNCLASSIFIED) | (UNCLASSIFIED in names_of(self.map or ())))
        differ[answers] = numbers(said[answers], legend.said) != numbers(true[answers], legend.true)
        return differ

    def _marked(self, is_said: Mask, is_true: Mask, counted: Mask, differ: Mask) -> PointCloud:
        """The points with their errors, and with colours if asked for."""
        error = np.where(is_true, np.where(is_said, CORRECT_POSITIVE, TYPE_1), 0)
        error = np.where(is_true, error, np.where(is_said, TYPE_2, CORRECT_NEGATIVE))
        error = np.where(differ & (is_said == is_true), OTHER_CLASS, error)
        error = np.where(counted, error, NO_REFERENCE).astype(np.uint8)
        names = {"error": error}
        if self.colours:
            table = np.array(COLOURS, np.uint16)
            shown = (table * SIXTEEN_BIT)[error].T
            names |= dict(zip(("red", "green", "blue"), shown, strict=True))
        return self.points.with_attributes(names, descriptions={"error": MEANING})

    def _strata(
        self,
        said: NDArray[Any],
        true: NDArray[Any],
        matched: Mask,
        counted: Mask,
        ground: Blocks,
        legend: Legend,
    ) -> Iterator[dict[str, Any]]:
        """Table rows: one for each value of the stratum, in rising order."""
        name = self.stratum
        group = self.points[name] if name else np.zeros(len(matched), np.uint8)
        values, place = np.unique(group, return_inverse=True)
        if len(values) > MOST_STRATA:
            raise DataError(
                f"stratum: {name!r} has {len(values):,} values, at most {MOST_STRATA} are allowed"
            )
        block = np.full(len(matched), NONE)
        block[counted] = ground.number
        for k, value in enumerate(values):
            inside = place == k
            some = np.flatnonzero(inside & counted)
            row = {"stratum": f"{name} {value}" if name else "all"}
            two = np.isin(said[some], self.positive), np.isin(true[some], self._truth)
            row |= Counts.of(*two).row(int((inside & ~matched).sum()))
            held, own = np.unique(block[some], return_inverse=True)
            by_block = legend.tally(said[some], true[some], own, ground.square[held])
            yield row | _accuracy.stratum_row(legend.confusion(by_block), by_block, self.seed)

    def _difference(
        self, said: NDArray[Any], true: NDArray[Any], counted: Mask, ground: Blocks, ctx: Context
    ) -> Table | None:
        """The other classification against the first, of the points that are in all three."""
        name = self._other_attribute
        if name is None:
            return None
        found = self._counterparts(self.other, name, self.positive, ctx)
        both = counted & (found >= 0)
        if not both.any():
            raise DataError("other: no point has a counterpart; are these the same points?")
        if lacking := int(np.count_nonzero(counted & ~both)):
            log.warning("%d points have no counterpart in the other cloud", lacking)
        second = (self.other or self.points)[name][found[both]]
        said, true = said[both], true[both]
        codes = np.union1d(codes_in(said, "attribute"), codes_in(second, "other_attribute"))
        true_codes = codes_in(true, "reference_attribute")
        legend = Legend.of(codes, true_codes, *self._names(codes, true_codes))
        held, own = np.unique(ground.number[both[counted]], return_inverse=True)
        one, two = (legend.tally(of, true, own, ground.square[held]) for of in (said, second))
        truth = numbers(true, legend.true)
        hit, other = (numbers(of, legend.said) == truth for of in (said, second))
        outcomes = hit & other, hit & ~other, other & ~hit, ~hit & ~other
        right = [int(np.count_nonzero(which)) for which in outcomes]
        return Table.from_rows(paired_rows(legend.labels, one, two, right, self.seed))

    def _areas(self, confusion: Any) -> Table | None:
        if self.mapped_area is None:
            return None
        mapped = _accuracy.mapped_areas(self.mapped_area, confusion.labels)
        return Table.from_rows(_accuracy.area_rows(confusion, mapped))

    def _counterparts(
        self, reference: PointCloud | None, attribute: Attribute, truth: ClassList, ctx: Context
    ) -> Ints:
        """Index of each point's counterpart in another cloud, -1 where there is none."""
        points = self.points
        if reference is None:
            return np.arange(len(points))
        compared = (self.attribute, attribute)
        shared = [name for name in points.names if name in reference and name not in compared]
        shared.sort(key=lambda name: (name not in RECORDED, (*RECORDED, name).index(name), name))
        return counterparts(
            points.xyz,
            reference.xyz,
            lambda few: ties(points.select(few), shared, self.attribute, self.positive),
            lambda few: ties(reference.select(few), shared, attribute, truth),
            max_distance=self.max_distance,
            ctx=ctx,
        )


def ties(
    cloud: PointCloud, shared: Sequence[str], attribute: str, positive: ClassList
) -> tuple[Columns, Columns]:
    """Columns that distinguish points at one position, and columns on their class."""
    given = cloud[attribute]
    columns = [column for name in shared if (column := cloud[name]).ndim == 1]
    return columns, [np.isin(given, positive), given]


def _by_block(is_said: Mask, is_true: Mask, ground: Blocks) -> Tallies:
    """Matrix of the class of interest and of objects of each block."""
    cell = ground.number * 4 + ~is_true * 2 + ~is_said
    counts = np.bincount(cell, minlength=4 * len(ground)).reshape(-1, 2, 2)
    return Tallies(counts, ground.square)
