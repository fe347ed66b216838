"""How well planes found in a cloud agree with reference planes, by their points and as planes.

References
----------
Çömert, R. and Avdan, U. (RANSAC façade planes from terrestrial scans, compared with hand-picked
ones): the sets O and E, their intersection and differences, and the share of E that was found.
Heipke, C. et al. (1997). Evaluation of automatic road extraction. IAPRS 32(3-2W3), 47-56:
correctness, completeness and quality, which is intersection over union.
Hoover, A. et al. (1996). An experimental comparison of range image segmentation algorithms. IEEE
Transactions on Pattern Analysis and Machine Intelligence 18(7), 673-689: planes found, missed,
invented, split and merged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.compare._counterparts import counterparts
from algorithms.compare._outcomes import (
    DIFFERENCES,
    FOUND_ALONE,
    IN_BOTH,
    IN_NEITHER,
    NO_REFERENCE,
    REFERENCE_ALONE,
)
from algorithms.shared.accuracy.columns import shown
from algorithms.shared.ground import without_withheld
from algorithms.shared.plane_numbers import number_of_none, plane_numbers
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Table
from toolbox.data.report import Column
from toolbox.declare import Attribute, outputs, param, show, sink, source, tool
from toolbox.errors import DataError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Row = dict[str, Any]

COLUMNS = {
    "reference": Column("Reference plane"),
    "plane": Column("Found plane"),
    "o": Column("Points found"),
    "e": Column("Points of the reference"),
    "intersection": Column("Points of both"),
    "o_without_e": Column("Points found alone"),
    "e_without_o": Column("Points of the reference alone"),
    **shown("correctness", "completeness", "iou"),
    "pieces": Column("Pieces"),
    "angle": Column("Angle between both", "°", 2),
    "offset": Column("Distance of both", "unit", 3),
}


@tool(
    "compare.planes",
    title="Compare planes",
    tags=(
        "accuracy",
        "validation",
        "facade",
        "plane",
    ),
)
class ComparePlanes:
    """Compare the planes of points with reference planes, such as hand-picked ones.

    Both are numbers at the points: in two attributes of one cloud, or of two clouds that hold the
    same points. Points of no plane have the number `none_id`, which may differ between the two; if
    it is not given, a negative number means none, as in Open3D and scikit-learn, or else 0. What
    was read is told. O are the points of a plane that was found, E those of its reference. A
    reference plane and a found one make a pair if their intersection over union is at least
    `min_overlap`; each is in at most one pair, those with the highest come first.

    The table has a row for all planes together, in which a point is in the intersection if it is
    in a pair, one for each reference plane, and one for each found plane without a pair (invented).
    Correctness is the intersection over O, completeness (S2's share of E) the intersection over E.
    `pieces` are the found planes with at least half of their points on the reference plane: more
    than one is a split. The angle is that between the planes of least squares through both sets,
    the offset how far they are apart at the mean of E.

    Planes of fewer than `min_points` are not judged; their points still count in the other sets.

    The attribute `difference` of the differences is 0 in both, 1 in neither, 2 in E alone, 3 in O
    alone or in two planes that are no pair, 4 without a reference point.
    """

    points: PointCloud = source("Points with the planes to judge")
    reference: PointCloud | None = source(
        "The same points with reference planes; leave out to use another attribute", default=None
    )
    attribute: Attribute = param(
        "Attribute with the number of the plane", default=Attribute("plane_id"), of="points"
    )
    reference_attribute: Attribute = param(
        "Attribute with the number of the reference plane",
        default=Attribute("plane_id"),
        label="Attribute of the reference",
    )
    min_overlap: float = param(
        "Least intersection over union of a pair, or share of its area that must be covered",
        default=0.5,
        unit="1",
        gt=0,
        le=1,
        label="Least overlap",
    )
    min_points: int = param(
        "Fewest points of a plane that is judged", default=3, unit="1", ge=3, label="Fewest points"
    )
    none_id: int | None = param(
        "Number of points of no plane; by default the negative number, or else 0",
        default=None,
        unit="1",
        label="Number for no plane",
    )
    reference_none_id: int | None = param(
        "The same of the reference; by default the negative number, or else 0",
        default=None,
        unit="1",
        label="Number for no plane (reference)",
    )

    @outputs
    class Outputs:
        table: Table = sink(
            "All planes, each reference plane, and each invented one", columns=COLUMNS
        )
        differences: PointCloud = sink(
            "The points with the attribute difference",
            show=show.Classes("difference", DIFFERENCES, front_of="plane_id"),
            label="Points with differences",
        )
        correctness: float | None = sink("Points of pairs over those of found planes", unit="%")
        completeness: float | None = sink(
            "Points of pairs over those of reference planes", unit="%"
        )
        iou: float | None = sink("Points of pairs over those of any plane", unit="%")
        found: int = sink("Reference planes with a pair", unit="1")
        missed: int = sink("Reference planes without a pair", unit="1")
        invented: int = sink("Found planes without a pair", unit="1", label="Planes without a pair")
        split: int = sink("Reference planes with several pieces", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The reference differs from the points, and has the number of planes."""
        where = self.reference if self.reference is not None else self.points
        if self.reference_attribute not in where:
            known = ", ".join(where.names) or "none"
            text = f"no attribute {str(self.reference_attribute)!r}; there are {known}"
            yield "reference_attribute", text
        if self.reference is None and self.reference_attribute == self.attribute:
            yield "reference", "give reference points, or another reference_attribute"

    def halo(self) -> float:
        """Infinite, as planes are of any size."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> ComparePlanes.Outputs:
        """Match the points, pair the planes, and count."""
        match = self._counterparts(ctx.part(0.0, 0.5))
        known = match >= 0
        if not known.any():
            raise DataError("reference: no point has a counterpart; are these the same points?")
        if not known.all():
            log.warning("%d of %d points have no counterpart", np.sum(~known), len(known))
        known = without_withheld(self.points, known, ctx)
        other = self.reference if self.reference is not None else self.points
        said, nothing = _numbered(self.points, self.attribute, self.none_id, "none_id")
        true, none = _numbered(
            other, self.reference_attribute, self.reference_none_id, "reference_none_id"
        )
        true = true[match]
        xyz = self.points.xyz[known]
        ctx.progress(0.6)
        made = compare(
            xyz,
            said[known],
            true[known],
            none=(nothing, none),
            overlap=self.min_overlap,
            fewest=self.min_points,
        )
        ctx.progress(0.9)
        difference = np.full(len(said), NO_REFERENCE, np.uint8)
        difference[known] = made.difference
        rows, metre = made.rows, self.points.metre
        for row in rows:
            row["offset"] = None if row["offset"] is None else row["offset"] / metre
        whole = rows[0]
        ctx.progress(1.0)
        return self.Outputs(
            table=Table.from_rows(rows),
            differences=self.points.with_attributes(
                {"difference": difference},
                descriptions={"difference": "2 in E alone, 3 in O alone"},
            ),
            correctness=whole["correctness"],
            completeness=whole["completeness"],
            iou=whole["iou"],
            found=sum(row["kind"] == "found" for row in rows),
            missed=sum(row["kind"] == "missed" for row in rows),
            invented=sum(row["kind"] == "invented" for row in rows),
            split=sum((row["pieces"] or 0) > 1 for row in rows),
        )

    def _counterparts(self, ctx: Context) -> Ints:
        """Index of each point's counterpart in the reference; -1 if there is none."""
        if self.reference is None:
            return np.arange(len(self.points))
        return counterparts(self.points.xyz, self.reference.xyz, ctx=ctx)


def _numbered(
    cloud: PointCloud, attribute: str, none_id: int | None, parameter: str
) -> tuple[Ints, int]:
    """The number of the plane of each point, and the one that means none, which is logged."""
    numbers = plane_numbers(cloud, attribute)
    none = number_of_none(numbers, attribute, parameter) if none_id is None else none_id
    count, others = int(np.sum(numbers == none)), np.unique(numbers[numbers != none])
    said = f"{attribute}: {len(others)} planes; {none} is none, at {count} of {len(numbers)} points"
    if len(others) and (none < 0 or others[0] < 0):
        log.warning("%s; the planes begin at number %d (%s)", said, others[0], parameter)
    else:
        log.info(said)
    return numbers, none


class Sets(NamedTuple):
    """Numbers of points: of the found plane (O), of the reference plane (E), and of both.

    Examples
    --------
    >>> front = Sets(213_672, 210_872, 208_320)  # cloud 1 of Çömert and Avdan, table 2
    >>> front.o_alone, front.e_alone, round(front.completeness, 2), round(front.iou, 2)
    (5352, 2552, 98.79, 96.34)
    """

    o: int
    e: int
    both: int

    @property
    def o_alone(self) -> int:
        """Number of points of O without E: commission."""
        return self.o - self.both

    @property
    def e_alone(self) -> int:
        """Number of points of E without O: omission."""
        return self.e - self.both

    @property
    def correctness(self) -> float | None:
        """Percentage of O that is in E."""
        return 100 * self.both / self.o if self.o else None

    @property
    def completeness(self) -> float | None:
        """Percentage of E that was found."""
        return 100 * self.both / self.e if self.e else None

    @property
    def iou(self) -> float | None:
        """Intersection over union of O and E, in percent."""
        union = self.o + self.e - self.both
        return 100 * self.both / union if union else None

    def row(self) -> Row:
        """Row of all counts and shares."""
        return {
            "o": self.o,
            "e": self.e,
            "intersection": self.both,
            "o_without_e": self.o_alone,
            "e_without_o": self.e_alone,
            "correctness": self.correctness,
            "completeness": self.completeness,
            "iou": self.iou,
        }


class Compared(NamedTuple):
    """Rows of the table, and the difference of each point; offsets in the unit of the points."""

    rows: list[Row]
    difference: NDArray[np.uint8]


def compare(
    xyz: Floats,
    said: Ints,
    true: Ints,
    *,
    none: tuple[int, int] = (0, 0),
    overlap: float = 0.5,
    fewest: int = 3,
) -> Compared:
    """Compare found planes with reference planes by their points.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    said, true : arrays of shape (n,), numbers of planes
    none : number that means no plane, of the found planes and of the reference
    overlap : least intersection over union of a pair
    fewest : points of a plane that is judged
    """
    found, said = np.unique(np.append(said, none[0]), return_inverse=True)
    known, true = np.unique(np.append(true, none[1]), return_inverse=True)
    nothing, nowhere = int(said[-1]), int(true[-1])
    said, true = said[:-1], true[:-1]
    both = np.bincount(said * len(known) + true, minlength=len(found) * len(known))
    both = both.reshape(len(found), len(known))
    o, e = both.sum(axis=1), both.sum(axis=0)
    judged_o = (o >= fewest) & (np.arange(len(found)) != nothing)
    judged_e = (e >= fewest) & (np.arange(len(known)) != nowhere)
    pair = _pairs(both, o, e, judged_o, judged_e, overlap)
    paired = np.full(len(known), -1)
    paired[pair[pair >= 0]] = np.flatnonzero(pair >= 0)
    in_pair = pair[said] == true
    rows: list[Row] = [
        _row("all", None, None, Sets(*_totals(said, true, nothing, nowhere, in_pair)))
    ]
    mostly = (2 * both >= o[:, None]) & judged_o[:, None]
    for k in np.flatnonzero(judged_e):
        mate = int(paired[k])
        sets = (
            Sets(int(o[mate]), int(e[k]), int(both[mate, k]))
            if mate >= 0
            else Sets(0, int(e[k]), 0)
        )
        row = _row(
            "found" if mate >= 0 else "missed", found[mate] if mate >= 0 else None, known[k], sets
        )
        row["pieces"] = int(mostly[:, k].sum())
        if mate >= 0:
            row["angle"], row["offset"] = between(xyz[said == mate], xyz[true == k])
        rows.append(row)
    for k in np.flatnonzero(judged_o & (pair < 0)):
        rows.append(_row("invented", found[k], None, Sets(int(o[k]), 0, 0)))
    wrong = np.where(said == nothing, REFERENCE_ALONE, FOUND_ALONE)
    wrong = np.where((said == nothing) & (true == nowhere), IN_NEITHER, wrong)
    return Compared(rows, np.where(in_pair, IN_BOTH, wrong).astype(np.uint8))


def _totals(said: Ints, true: Ints, nothing: int, none: int, both: NDArray[np.bool_]) -> Any:
    return int((said != nothing).sum()), int((true != none).sum()), int(both.sum())


def _row(kind: str, plane: Any, reference: Any, sets: Sets) -> Row:
    names = {
        "kind": kind,
        "reference": None if reference is None else int(reference),
        "plane": None if plane is None else int(plane),
    }
    return names | sets.row() | {"pieces": None, "angle": None, "offset": None}


def _pairs(
    both: Ints,
    o: Ints,
    e: Ints,
    judged_o: NDArray[np.bool_],
    judged_e: NDArray[np.bool_],
    overlap: float,
) -> Ints:
    """Index of the reference plane paired with each found plane by falling IoU, -1 for none."""
    first, second = np.nonzero(both * judged_o[:, None] * judged_e)
    iou = both[first, second] / (o[first] + e[second] - both[first, second])
    pair = np.full(len(o), -1)
    taken = np.zeros(len(e), bool)
    for k in np.lexsort((second, first, -iou)):
        if iou[k] >= overlap and pair[first[k]] < 0 and not taken[second[k]]:
            pair[first[k]] = second[k]
            taken[second[k]] = True
    return pair


def between(xyz: Floats, reference: Floats) -> tuple[float, float]:
    """Angle in degrees between the least-squares planes of two sets of points, and their distance.

    The second is the distance of the mean of the reference from the plane of the first.
    """
    origin = reference[0]  # so that no digits are lost
    normals, middle = [], []
    for points in (xyz - origin, reference - origin):
        centre = points.mean(axis=0)
        normals.append(np.linalg.eigh(np.cov((points - centre).T))[1][:, 0])
        middle.append(centre)
    sine = float(np.linalg.norm(np.cross(normals[0], normals[1])))
    angle = math.degrees(math.atan2(sine, abs(float(normals[0] @ normals[1]))))
    return angle, abs(float(normals[0] @ (middle[0] - middle[1])))
