"""How well a classification agrees with a reference, point by point.

References
----------
Sithole, G. and Vosselman, G. (2004). Experimental comparison of filter algorithms for bare-Earth
extraction from airborne laser scanning point clouds. ISPRS Journal 59(1-2), 85-101.
Cohen, J. (1960). A coefficient of agreement for nominal scales. Educational and Psychological
Measurement 20(1), 37-46.
Heipke, C. et al. (1997). Evaluation of automatic road extraction. IAPRS 32(3-2W3), 47-56:
correctness, completeness and quality.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Table
from toolbox.errors import DataError
from toolbox.spec import outputs, param, sink, source, tool
from toolbox.values import Attribute, ClassList

SAME = 1e-6  # coordinates that differ less than this differ by rounding only, in any unit
# Values of the attribute `error`, drawn in the colours of Şen and Bayaslı (2020).
CORRECT_POSITIVE, CORRECT_NEGATIVE, TYPE_1, TYPE_2, NO_REFERENCE = 0, 1, 2, 3, 4


@tool("compare.classes")
class CompareClasses:
    """Compare the classes of points with reference classes.

    The reference is either another cloud, whose points are found by their coordinates, or another
    attribute of the same cloud. `positive` names the class of interest, ground by default; points
    of all other classes count as objects. For labels where ground is 0, as in the ISPRS filter
    test, give `reference_positive` 0.

    Type I is the share of reference ground that was lost, Type II the share of reference objects
    that was taken for ground. Points without a counterpart are counted and reported.
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

    @outputs
    class Outputs:
        table: Table = sink("One row per measure: measure, value, unit, meaning")
        confusion: Table = sink("Full confusion matrix: a row per reference class")
        errors: PointCloud = sink("The points with the attribute `error`: see the table of values")
        type_1: float | None = sink("Reference ground that was lost, b / (a + b)", unit="%")
        type_2: float | None = sink("Reference objects taken for ground, c / (c + d)", unit="%")
        total_error: float = sink("Points on the wrong side, (b + c) / (a + b + c + d)", unit="%")
        kappa: float | None = sink("Agreement beyond chance (Cohen)", unit="1")
        unmatched: int = sink("Points without a counterpart in the reference", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """The reference must be something else than the points, and have its attribute."""
        where = self.reference or self.points
        if self.reference_attribute not in where:
            known, name = ", ".join(where.names) or "none", self.reference_attribute
            yield "reference_attribute", f"no attribute {name!r}; there are {known}"
        if self.reference is None and self.reference_attribute == self.attribute:
            yield "reference", "give reference points, or another reference_attribute"

    def halo(self) -> float:
        """A counterpart may lie this far outside a tile."""
        return self.max_distance or 0.0

    def run(self, ctx: Context = QUIET) -> CompareClasses.Outputs:
        """Match, count, and mark."""
        found = self._counterparts()
        matched = found >= 0
        if not matched.any():
            raise DataError("reference: no point has a counterpart; are these the same points?")
        if unmatched := int((~matched).sum()):
            log.warning("%d of %d points have no counterpart", unmatched, len(found))
        ctx.progress(0.5)
        said = self.points[self.attribute]
        true = (self.reference or self.points)[self.reference_attribute][found]
        is_said = np.isin(said, self.positive)
        is_true = np.isin(true, self.reference_positive or self.positive)
        counts = Counts.of(is_said[matched], is_true[matched])
        error = np.where(is_true, np.where(is_said, CORRECT_POSITIVE, TYPE_1), 0)
        error = np.where(is_true, error, np.where(is_said, TYPE_2, CORRECT_NEGATIVE))
        error = np.where(matched, error, NO_REFERENCE).astype(np.uint8)
        meaning = "0 and 1 correct, 2 Type I, 3 Type II"
        return self.Outputs(
            table=Table.from_rows(counts.rows(unmatched)),
            confusion=confusion_matrix(said[matched], true[matched]),
            errors=self.points.with_attributes({"error": error}, descriptions={"error": meaning}),
            type_1=counts.type_1,
            type_2=counts.type_2,
            total_error=counts.total_error,
            kappa=counts.kappa,
            unmatched=unmatched,
        )

    def _counterparts(self) -> NDArray[np.int64]:
        """Index of each point's counterpart in the reference, -1 where there is none."""
        if self.reference is None:
            return np.arange(len(self.points))
        return counterparts(self.points.xyz, self.reference.xyz, self.max_distance or SAME)


@dataclass(frozen=True)
class Counts:
    """The four counts of Sithole and Vosselman, and what follows from them.

    a: ground kept, b: ground lost, c: objects kept as ground, d: objects removed. A measure whose
    denominator is zero is None.
    """

    a: int
    b: int
    c: int
    d: int

    @classmethod
    def of(cls, said: NDArray[np.bool_], true: NDArray[np.bool_]) -> Counts:
        """Count from two arrays of shape (n,): positive as classified, and in truth."""
        a, said_count, true_count = int((said & true).sum()), int(said.sum()), int(true.sum())
        b, c = true_count - a, said_count - a
        return cls(a, b, c, len(said) - a - b - c)

    @property
    def total(self) -> int:
        return self.a + self.b + self.c + self.d

    @property
    def type_1(self) -> float | None:
        return _percent(self.b, self.a + self.b)

    @property
    def type_2(self) -> float | None:
        return _percent(self.c, self.c + self.d)

    @property
    def total_error(self) -> float:
        return 100 * (self.b + self.c) / self.total

    @property
    def kappa(self) -> float | None:
        """(observed - chance) / (1 - chance); None when only one class occurs."""
        a, b, c, d = self.a, self.b, self.c, self.d
        chance = ((a + b) * (a + c) + (c + d) * (b + d)) / self.total**2
        return (1 - (b + c) / self.total - chance) / (1 - chance) if chance < 1 else None

    @property
    def correctness(self) -> float | None:
        return _percent(self.a, self.a + self.c)

    @property
    def completeness(self) -> float | None:
        return _percent(self.a, self.a + self.b)

    @property
    def quality(self) -> float | None:
        return _percent(self.a, self.a + self.b + self.c)

    def rows(self, unmatched: int) -> Iterator[dict[str, Any]]:
        """One row per measure, in the order of the literature."""
        yield _row("a", self.a, "points", "positive in both")
        yield _row("b", self.b, "points", "positive in the reference only")
        yield _row("c", self.c, "points", "positive in the classification only")
        yield _row("d", self.d, "points", "positive in neither")
        yield _row("unmatched", unmatched, "points", "without a counterpart, not counted above")
        yield _row("Type I", self.type_1, "%", "b / (a + b)")
        yield _row("Type II", self.type_2, "%", "c / (c + d)")
        yield _row("total error", self.total_error, "%", "(b + c) / (a + b + c + d)")
        yield _row("kappa", self.kappa, "1", "agreement beyond chance")
        yield _row("correctness", self.correctness, "%", "a / (a + c)")
        yield _row("completeness", self.completeness, "%", "a / (a + b)")
        yield _row("quality", self.quality, "%", "a / (a + b + c)")


def _row(measure: str, value: float | None, unit: str, meaning: str) -> dict[str, Any]:
    return {"measure": measure, "value": value, "unit": unit, "meaning": meaning}


def _percent(part: int, whole: int) -> float | None:
    return 100 * part / whole if whole else None


def counterparts(
    xyz: NDArray[np.float64], reference: NDArray[np.float64], max_distance: float
) -> NDArray[np.int64]:
    """The reference point that belongs to each point.

    Points in the same order are recognised at once; others are matched with the nearest reference
    point, so that of several points at one place each finds one.

    Parameters
    ----------
    xyz, reference : arrays of shape (n, 3) and (m, 3), in the same unit
    max_distance : farthest counterpart, in that unit

    Returns
    -------
    array of shape (n,)
        Index into reference, -1 where none is near enough.
    """
    if xyz.shape == reference.shape and np.all(np.abs(xyz - reference) <= max_distance):
        return np.arange(len(xyz))
    if len(reference) == 0:
        return np.full(len(xyz), -1)
    distance, index = cKDTree(reference).query(xyz, distance_upper_bound=max_distance)
    return np.where(np.isfinite(distance), index, -1)


def confusion_matrix(said: NDArray[Any], true: NDArray[Any]) -> Table:
    """Points by reference class (rows) and given class (columns).

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
