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

from collections.abc import Callable, Iterator, Sequence
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

# Coordinates are the same if they agree to this: 0.1 mm on the ground in degrees, or 1 micrometre.
SAME_IN_DEGREES, SAME = 1e-9, 1e-6
DEGREES = 360.0  # larger numbers are no degrees; smaller ones have digits enough for 1e-9
# Borders between two roundings lie at this share of a step, where no decimal number lies.
BORDER = 0.685
BLOCK = 200_000  # points between two looks at whether the user cancelled
# Attributes that the sensor gave, in the order in which they tell points at one place apart.
RECORDED = (
    *("gps_time", "return_number", "number_of_returns", "point_source_id", "scanner_channel"),
    *("scan_angle", "scan_angle_rank", "intensity", "red", "green", "blue", "nir"),
)
# Values of the attribute `error`, drawn in the colours of Şen and Bayaslı (2020).
CORRECT_POSITIVE, CORRECT_NEGATIVE, TYPE_1, TYPE_2, NO_REFERENCE = 0, 1, 2, 3, 4

Columns = Sequence[NDArray[Any]]
# Of some points: what they must share with their counterpart, and what only sorts them.
Ties = Callable[[NDArray[np.int64]], tuple[Columns, Columns]]


@tool("compare.classes")
class CompareClasses:
    """Compare the classes of points with reference classes.

    The reference is either another cloud, whose points are found by their coordinates, or another
    attribute of the same cloud. `positive` names the class of interest, ground by default; points
    of all other classes count as objects. For labels where ground is 0, as in the ISPRS filter
    test, give `reference_positive` 0.

    Type I is the share of reference ground that was lost, Type II the share of reference objects
    that was taken for ground. Points without a counterpart are counted and reported.

    Coordinates are the same if they agree to 0.000001 units (0.000000001 where none exceeds 360,
    as degrees). Several points at one place are told apart by the attributes that both clouds
    have, GPS time and return number first, and where all those are equal in favour of the
    classification; each takes one reference point. With `max_distance`, points left over take the
    nearest reference point, which may then serve several.
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

    def check_data(self) -> Iterator[tuple[str, str]]:
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
    """What tells points at one place apart, and whether they are of the class of interest."""
    given = cloud[attribute]
    columns = [column for name in shared if (column := cloud[name]).ndim == 1]
    return columns, [np.isin(given, positive), given]


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
    xyz: NDArray[np.float64],
    reference: NDArray[np.float64],
    ties: Ties = lambda few: ((), ()),
    reference_ties: Ties = lambda few: ((), ()),
    *,
    max_distance: float | None = None,
    ctx: Context = QUIET,
) -> NDArray[np.int64]:
    """The reference point that belongs to each point, whatever the order of both.

    Of several points at one place, those that are alike in all shared attributes belong together;
    of the others the k-th belongs to the k-th of the reference points there. Points left over may
    take the nearest reference point, several of them the same one.

    Parameters
    ----------
    xyz, reference : arrays of shape (n, 3) and (m, 3), in the same unit
    ties, reference_ties : give for an array of indices the columns by which points at one place
        are told apart, the weightiest first, and those by which they are sorted after that
    max_distance : farthest counterpart of points left over, in that unit; None to leave them
    ctx : progress and cancellation

    Returns
    -------
    array of shape (n,)
        Index into reference, -1 where there is none.
    """
    place, reference_place = shared_places(xyz, reference)
    ctx.progress(0.4)
    finer, reference_finer = told_apart(place, reference_place, ties, reference_ties)
    found = paired(finer, reference_finer, lambda i: ties(i)[1], lambda i: reference_ties(i)[1])
    free = np.ones(len(reference), bool)
    free[found[found >= 0]] = False
    rest, free_rest = np.flatnonzero(found < 0), np.flatnonzero(free)
    second = paired(
        place[rest],
        reference_place[free_rest],
        lambda i: [c for columns in ties(rest[i]) for c in columns],
        lambda i: [c for columns in reference_ties(free_rest[i]) for c in columns],
    )
    found[rest] = np.where(second >= 0, np.append(free_rest, -1)[second], -1)
    ctx.progress(0.5)
    if max_distance is not None and len(reference):
        # The tree is built in a sorted order, which decides between equally near points.
        columns = [c for part in reference_ties(np.arange(len(reference))) for c in part]
        order = np.lexsort([*reversed(columns), *reference.T])
        _take_nearest(found, xyz, reference, order, max_distance, ctx.part(0.5, 1.0))
    return found


def told_apart(
    place: NDArray[np.int64], reference_place: NDArray[np.int64], ties: Ties, reference_ties: Ties
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Give points at one place that differ in a shared attribute places of their own."""
    size = max(place.max(initial=-1), reference_place.max(initial=-1)) + 1
    several = np.bincount(place, minlength=size) > 1
    several |= np.bincount(reference_place, minlength=size) > 1
    few, reference_few = np.flatnonzero(several[place]), np.flatnonzero(several[reference_place])
    pairs = zip(
        [place[few], *ties(few)[0]],
        [reference_place[reference_few], *reference_ties(reference_few)[0]],
        strict=True,
    )
    number = size + numbered([np.concatenate(pair).astype(np.float64) for pair in pairs])
    finer, reference_finer = place.copy(), reference_place.copy()
    finer[few], reference_finer[reference_few] = number[: len(few)], number[len(few) :]
    return finer, reference_finer


def paired(
    place: NDArray[np.int64],
    reference_place: NDArray[np.int64],
    order_by: Callable[[NDArray[np.int64]], Columns],
    reference_order_by: Callable[[NDArray[np.int64]], Columns],
) -> NDArray[np.int64]:
    """For the k-th point of each place the k-th reference point there, -1 where there is none."""
    rank = rank_in_place(place, order_by)
    reference_rank = rank_in_place(reference_place, reference_order_by)
    count = np.bincount(reference_place, minlength=place.max(initial=-1) + 1)
    first = np.cumsum(count) - count
    order = np.empty(len(reference_place), np.int64)
    order[first[reference_place] + reference_rank] = np.arange(len(reference_place))
    matched = rank < count[place]
    found = np.full(len(place), -1)
    found[matched] = order[first[place[matched]] + rank[matched]]
    return found


def _take_nearest(
    found: NDArray[np.int64],
    xyz: NDArray[np.float64],
    reference: NDArray[np.float64],
    order: NDArray[np.int64],
    max_distance: float,
    ctx: Context,
) -> None:
    """Give points without counterpart (-1) the nearest reference point (in place)."""
    tree, left_over = cKDTree(reference[order]), np.flatnonzero(found < 0)
    for start in range(0, len(left_over), BLOCK):
        ctx.progress(start / len(left_over))
        block = left_over[start : start + BLOCK]
        distance, index = tree.query(xyz[block], distance_upper_bound=max_distance)
        found[block] = np.where(np.isfinite(distance), order[index % len(order)], -1)


def shared_places(
    xyz: NDArray[np.float64], reference: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number of the place of each point and reference point: equal for equal coordinates.

    Parameters
    ----------
    xyz, reference : arrays of shape (n, 3) and (m, 3)

    Returns
    -------
    arrays of shape (n,) and (m,)
    """
    largest = max(np.abs(part[:, :2]).max(initial=0.0) for part in (xyz, reference))
    step = SAME_IN_DEGREES if largest <= DEGREES else SAME
    columns, reference_columns = (
        [np.floor(part[:, axis] / step + 1 - BORDER) for axis in range(3)]
        for part in (xyz, reference)
    )
    if all(map(np.array_equal, columns, reference_columns)):  # in the same order: half the work
        place = numbered(columns)
        return place, place
    place = numbered(
        [np.concatenate(pair) for pair in zip(columns, reference_columns, strict=True)]
    )
    return place[: len(xyz)], place[len(xyz) :]


def numbered(columns: Sequence[NDArray[np.float64]]) -> NDArray[np.int64]:
    """Number equal rows of columns of shape (n,) alike, from 0, in their sorted order."""
    order = np.lexsort(columns)
    another = np.zeros(len(order), bool)
    for column in columns:
        another[1:] |= np.diff(column[order]) != 0
    number = np.empty(len(order), np.int64)
    number[order] = np.cumsum(another)
    return number


def rank_in_place(
    place: NDArray[np.int64], order_by: Callable[[NDArray[np.int64]], Columns]
) -> NDArray[np.int64]:
    """0, 1, 2, ... for the points at one place.

    Parameters
    ----------
    place : array of shape (n,), numbers from 0
    order_by : gives the columns by which some of the points are sorted, the weightiest first

    Returns
    -------
    array of shape (n,)
    """
    rank = np.zeros(len(place), np.int64)
    crowded = np.flatnonzero(np.bincount(place)[place] > 1)  # few, and only these need sorting
    order = crowded[np.lexsort([*reversed(order_by(crowded)), place[crowded]])]
    starts = np.flatnonzero(np.diff(place[order], prepend=-1))
    rank[order] = np.arange(len(order)) - np.repeat(starts, np.diff(starts, append=len(order)))
    return rank


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
