"""How well a classification agrees with a reference, point by point.

References
----------
Sithole, G. and Vosselman, G. (2004). Experimental comparison of filter algorithms for bare-Earth
extraction from airborne laser scanning point clouds. ISPRS Journal 59(1-2), 85-101.
Cohen, J. (1960). A coefficient of agreement for nominal scales. Educational and Psychological
Measurement 20(1), 37-46.
Heipke, C. et al. (1997). Evaluation of automatic road extraction. IAPRS 32(3-2W3), 47-56:
correctness, completeness and quality.
Wilson, E. B. (1927). Probable inference, the law of succession, and statistical inference. Journal
of the American Statistical Association 22(158), 209-212: intervals of shares.
Fleiss, J. L., Cohen, J. and Everitt, B. S. (1969). Large sample standard errors of kappa and
weighted kappa. Psychological Bulletin 72(5), 323-327.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.compare._counterparts import Columns, counterparts
from algorithms.compare._outcomes import (
    CORRECT_NEGATIVE,
    CORRECT_POSITIVE,
    NO_REFERENCE,
    OUTCOMES,
    TYPE_1,
    TYPE_2,
)
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Table
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
SIXTEEN_BIT = 257  # from 0..255 to 0..65535
MOST_STRATA = 256
ROUNDING = 1e-12  # what is left of a difference of shares that is zero
CONFIDENCE = 1.959963984540054  # standard deviations of a normal distribution that hold 95 %


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
    attribute of the same cloud. `positive` names the class of interest, ground by default; points
    of all other classes count as objects. For labels where ground is 0, as in the ISPRS filter
    test, give `reference_positive` 0.

    Type I is the share of reference ground that was lost, Type II the share of reference objects
    that was taken for ground. Points without a counterpart are counted and reported.

    Coordinates are the same if they agree to 0.000001 units (0.000000001 where none exceeds 360,
    as degrees). Several points at one position are told apart by the attributes that both clouds
    have, GPS time and return number first, and where all those are equal in favour of the
    classification; each takes one reference point. With `max_distance`, points left over take the
    nearest reference point, which may then serve several.

    The tables give 95 % intervals: of Wilson for shares, of Fleiss, Cohen and Everitt for kappa.
    They hold for points whose errors are independent; errors of neighbours seldom are, so take
    them as the least uncertainty. `stratum` counts the errors apart for each value of an
    attribute, such as return_number or the number of a test area.
    """

    points: PointCloud = source("Classified points")
    reference: PointCloud | None = source(
        "Reference points; leave out to use the same points", default=None
    )
    attribute: Attribute = param(
        "Attribute that holds the class", default=Attribute("classification"), of="points"
    )
    reference_attribute: Attribute = param(
        "Attribute that holds the reference class", default=Attribute("classification")
    )
    positive: ClassList = param("Classes of interest", default=ClassList([2]))
    reference_positive: ClassList | None = param(
        "Classes of interest in the reference, if they differ", default=None
    )
    max_distance: float | None = param(
        "Farthest counterpart in the other cloud; the same coordinates by default",
        default=None,
        unit="m",
        gt=0,
    )
    stratum: Attribute | None = param(
        "Attribute by whose values errors are also counted apart", default=None, of="points"
    )
    colours: bool = param(
        "Give the points the colours of their errors as red, green and blue", default=False
    )

    @outputs
    class Outputs:
        table: Table = sink("One row per measure: measure, value, low, high, unit, meaning")
        strata: Table = sink("One row per value of the stratum, or one for all")
        confusion: Table = sink("Full confusion matrix: a row per reference class")
        errors: PointCloud = sink(
            "The points with the attribute `error`: see the table of values",
            show=show.Classes("error", OUTCOMES),
        )
        type_1: float | None = sink("Reference ground that was lost, b / (a + b)", unit="%")
        type_2: float | None = sink("Reference objects taken for ground, c / (c + d)", unit="%")
        total_error: float | None = sink(
            "Points on the wrong side, (b + c) / (a + b + c + d)", unit="%"
        )
        kappa: float | None = sink("Agreement beyond chance (Cohen)", unit="1")
        unmatched: int = sink("Points without a counterpart in the reference", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The reference differs from the points, and has its attribute."""
        where = self.reference or self.points
        if self.reference_attribute not in where:
            known, name = ", ".join(where.names) or "none", self.reference_attribute
            yield "reference_attribute", f"no attribute {name!r}; there are {known}"
        if self.reference is None and self.reference_attribute == self.attribute:
            yield "reference", "give reference points, or another reference_attribute"

    def halo(self) -> float:
        """Largest distance of a counterpart outside a tile."""
        return self.max_distance or 0.0

    def run(self, ctx: Context = QUIET) -> CompareClasses.Outputs:
        """Match the points, count the errors, and mark them."""
        found = self._counterparts(ctx.part(0.0, 0.8))
        matched = found >= 0
        if not matched.any():
            raise DataError("reference: no point has a counterpart; are these the same points?")
        if unmatched := int((~matched).sum()):
            log.warning("%d of %d points have no counterpart", unmatched, len(found))
        ctx.progress(0.8)
        said = self.points[self.attribute]
        true = (self.reference or self.points)[self.reference_attribute][found]
        is_said = np.isin(said, self.positive)
        is_true = np.isin(true, self.reference_positive or self.positive)
        counts = Counts.of(is_said[matched], is_true[matched])
        error = np.where(is_true, np.where(is_said, CORRECT_POSITIVE, TYPE_1), 0)
        error = np.where(is_true, error, np.where(is_said, TYPE_2, CORRECT_NEGATIVE))
        error = np.where(matched, error, NO_REFERENCE).astype(np.uint8)
        names = {"error": error}
        if self.colours:
            table = np.array(COLOURS, np.uint16)
            shown = (table * SIXTEEN_BIT)[error].T
            names |= dict(zip(("red", "green", "blue"), shown, strict=True))
        meaning = "0 and 1 correct, 2 Type I, 3 Type II"
        return self.Outputs(
            table=Table.from_rows(counts.rows(unmatched)),
            strata=Table.from_rows(self._strata(is_said, is_true, matched)),
            confusion=confusion_matrix(said[matched], true[matched]),
            errors=self.points.with_attributes(names, descriptions={"error": meaning}),
            type_1=counts.type_1,
            type_2=counts.type_2,
            total_error=counts.total_error,
            kappa=counts.kappa,
            unmatched=int(np.count_nonzero(~matched & self.points.core)),
        )

    def _strata(
        self, said: NDArray[np.bool_], true: NDArray[np.bool_], matched: NDArray[np.bool_]
    ) -> Iterator[dict[str, Any]]:
        """Table rows: one for each value of the stratum, in rising order."""
        name = self.stratum
        group = self.points[name] if name else np.zeros(len(matched), np.uint8)
        values, number = np.unique(group, return_inverse=True)
        if len(values) > MOST_STRATA:
            raise DataError(
                f"stratum: {name!r} has {len(values):,} values, at most {MOST_STRATA} are allowed"
            )
        for k, value in enumerate(values):
            inside = number == k
            some = inside & matched
            row = {"stratum": f"{name} {value}" if name else "all"}
            yield row | Counts.of(said[some], true[some]).row(int((inside & ~matched).sum()))

    def _counterparts(self, ctx: Context) -> NDArray[np.int64]:
        """Index of each point's counterpart in the reference, -1 where there is none."""
        points, reference = self.points, self.reference
        if reference is None:
            return np.arange(len(points))
        compared = (self.attribute, self.reference_attribute)
        shared = [name for name in points.names if name in reference and name not in compared]
        shared.sort(key=lambda name: (name not in RECORDED, (*RECORDED, name).index(name), name))
        truth = self.reference_positive or self.positive
        return counterparts(
            points.xyz,
            reference.xyz,
            lambda few: ties(points.select(few), shared, self.attribute, self.positive),
            lambda few: ties(reference.select(few), shared, self.reference_attribute, truth),
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


@dataclass(frozen=True)
class Counts:
    """Counts of points by class and reference (Sithole and Vosselman), and measures from them.

    a: ground kept, b: ground lost, c: objects kept as ground, d: objects removed. A measure whose
    denominator is zero is None.
    """

    a: int
    b: int
    c: int
    d: int

    @classmethod
    def of(cls, said: NDArray[np.bool_], true: NDArray[np.bool_]) -> Counts:
        """Count from two arrays of shape (n,): positive as classified, and in the reference."""
        a, said_count, true_count = int((said & true).sum()), int(said.sum()), int(true.sum())
        b, c = true_count - a, said_count - a
        return cls(a, b, c, len(said) - a - b - c)

    @property
    def total(self) -> int:
        return self.a + self.b + self.c + self.d

    @property
    def type_1(self) -> float | None:
        return self._shares["type_1"][1].percent

    @property
    def type_2(self) -> float | None:
        return self._shares["type_2"][1].percent

    @property
    def total_error(self) -> float | None:
        return self._shares["total_error"][1].percent

    @property
    def correctness(self) -> float | None:
        return self._shares["correctness"][1].percent

    @property
    def completeness(self) -> float | None:
        return self._shares["completeness"][1].percent

    @property
    def quality(self) -> float | None:
        return self._shares["quality"][1].percent

    @property
    def kappa(self) -> float | None:
        """(observed - chance) / (1 - chance); None when only one class occurs."""
        if not self.total or (chance := self._chance) == 1:
            return None
        return (1 - (self.b + self.c) / self.total - chance) / (1 - chance)

    @property
    def kappa_interval(self) -> tuple[float | None, float | None]:
        """Limits of the 95 % confidence interval (Fleiss, Cohen and Everitt 1969, equation 13)."""
        if (kappa := self.kappa) is None:
            return None, None
        cells = np.array([[self.a, self.b], [self.c, self.d]]) / self.total
        rows, columns, chance = cells.sum(axis=1), cells.sum(axis=0), self._chance
        left = 1 - (self.b + self.c) / self.total
        beside = np.add.outer(columns, rows)  # of cell i, j: column i and row j
        same = np.diag(cells) * ((1 - chance) - np.diag(beside) * (1 - left)) ** 2
        mixed = cells * beside**2
        spread = same.sum() + (1 - left) ** 2 * (mixed.sum() - np.trace(mixed))
        spread -= (left * chance - 2 * chance + left) ** 2
        spread = spread if spread > ROUNDING else 0.0
        error = math.sqrt(spread / self.total) / (1 - chance) ** 2
        return max(kappa - CONFIDENCE * error, -1.0), min(kappa + CONFIDENCE * error, 1.0)

    @property
    def _chance(self) -> float:
        """Agreement by chance of two independent classifications with these totals."""
        a, b, c, d = self.a, self.b, self.c, self.d
        return ((a + b) * (a + c) + (c + d) * (b + d)) / self.total**2

    @property
    def _shares(self) -> dict[str, tuple[str, Proportion, str]]:
        """Measures that are shares, by name: label, proportion and formula."""
        a, b, c, d = self.a, self.b, self.c, self.d
        return {
            "type_1": ("Type I", Proportion(b, a + b), "b / (a + b)"),
            "type_2": ("Type II", Proportion(c, c + d), "c / (c + d)"),
            "total_error": (
                "total error",
                Proportion(b + c, self.total),
                "(b + c) / (a + b + c + d)",
            ),
            "correctness": ("correctness", Proportion(a, a + c), "a / (a + c)"),
            "completeness": ("completeness", Proportion(a, a + b), "a / (a + b)"),
            "quality": ("quality", Proportion(a, a + b + c), "a / (a + b + c)"),
        }

    def rows(self, unmatched: int) -> Iterator[dict[str, Any]]:
        """One row per measure, in the order of the literature."""
        yield _row("a", self.a, (None, None), "points", "positive in both")
        yield _row("b", self.b, (None, None), "points", "positive in the reference only")
        yield _row("c", self.c, (None, None), "points", "positive in the classification only")
        yield _row("d", self.d, (None, None), "points", "positive in neither")
        meaning = "without a counterpart, not counted above"
        yield _row("unmatched", unmatched, (None, None), "points", meaning)
        for measure, share, meaning in self._shares.values():
            if measure == "correctness":
                meant = "agreement beyond chance"
                yield _row("kappa", self.kappa, self.kappa_interval, "1", meant)
            yield _row(measure, share.percent, share.interval, "%", meaning)

    def row(self, unmatched: int) -> dict[str, Any]:
        """Row with all measures side by side, shares in percent."""
        found: dict[str, Any] = {"points": self.total, "unmatched": unmatched}
        found |= {"a": self.a, "b": self.b, "c": self.c, "d": self.d}
        for name, (_, share, _) in self._shares.items():
            found |= _with_limits(name, share.percent, share.interval)
        return found | _with_limits("kappa", self.kappa, self.kappa_interval)


@dataclass(frozen=True)
class Proportion:
    """A counted share of a whole."""

    part: int
    whole: int

    @property
    def percent(self) -> float | None:
        """The share in percent; None if the whole is zero."""
        return 100 * self.part / self.whole if self.whole else None

    @property
    def interval(self) -> tuple[float | None, float | None]:
        """Limits of the 95 % confidence interval in percent (Wilson 1927)."""
        if not self.whole:
            return None, None
        n, p, z = self.whole, self.part / self.whole, CONFIDENCE
        middle = (p + z * z / (2 * n)) / (1 + z * z / n)
        half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
        # All or nothing found: the limit is exact, and must not miss it by a rounding.
        low = 0.0 if self.part == 0 else 100 * (middle - half)
        high = 100.0 if self.part == self.whole else 100 * (middle + half)
        return low, high


def _row(
    measure: str,
    value: float | None,
    interval: tuple[float | None, float | None],
    unit: str,
    meaning: str,
) -> dict[str, Any]:
    low, high = interval
    limits = {"value": value, "low": low, "high": high}
    return {"measure": measure} | limits | {"unit": unit, "meaning": meaning}


def _with_limits(
    name: str, value: float | None, interval: tuple[float | None, float | None]
) -> dict[str, Any]:
    return {name: value, f"{name}_low": interval[0], f"{name}_high": interval[1]}


def confusion_matrix(said: NDArray[Any], true: NDArray[Any]) -> Table:
    """Table of the number of points by reference class (rows) and given class (columns).

    Parameters
    ----------
    said, true : arrays of shape (n,)
    """
    rows_of, columns_of = np.unique(true), np.unique(said)
    row, column = np.searchsorted(rows_of, true), np.searchsorted(columns_of, said)
    counts = np.bincount(row * len(columns_of) + column, minlength=len(rows_of) * len(columns_of))
    rows = []
    for label, line in zip(rows_of, counts.reshape(len(rows_of), -1), strict=True):
        given = {f"class {c}": int(n) for c, n in zip(columns_of, line, strict=True)}
        rows.append({"reference": f"class {label}"} | given | {"total": int(line.sum())})
    return Table.from_rows(rows)
