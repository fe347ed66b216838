"""Points with one number each that says what they are, for programs that design power lines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from algorithms.shared import parameters
from algorithms.shared.ground import taking_part
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Table
from toolbox.data.asprs import class_label
from toolbox.data.report import Column
from toolbox.declare import ClassList, outputs, sink, source, tool
from toolbox.errors import DataError

CLASS, CODE, TEXT = "classification", "code", "description"  # columns of a table of codes
MOST = 65_535  # a code is a whole number of 16 bits


@tool(
    "points.feature_codes",
    title="Feature codes",
    tags=("feature", "code", "xyz", "pls-cadd", "export", "classification"),
)
class PointsFeatureCodes:
    """Give each point a feature code, and list what the codes mean.

    Programs for the design of power lines, such as PLS-CADD, read points as a text: x, y, z and a
    feature code, which they look up in a table. Write the points as .xyz with the option columns
    x,y,z,code and the codes as .csv. A code is the class of the point, as LAS numbers it (2
    ground, 5 high vegetation, 14 conductor, 15 tower), unless a table of your own says otherwise;
    then points of classes that it does not have are left out, and their number is told.
    """

    points: PointCloud = source("Classified points")
    code_table: Table | None = source(
        "Table of your own: classification, code and description", default=None
    )
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        coded: PointCloud = sink("The points with attribute code")
        codes: Table = sink(
            "What the codes mean, and how many points have each",
            columns={
                CODE: Column("Feature code"),
                CLASS: Column("Class of LAS"),
                TEXT: Column("Description"),
            },
        )
        left_out: int = sink("Points of classes without a code", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have classes, and the table the columns and codes that it needs."""
        if CLASS not in self.points.names:
            yield "points", f"{self.points.name} has no classification; classify them first"
        if self.code_table is None:
            return
        if missing := [n for n in (CLASS, CODE, TEXT) if n not in self.code_table.names]:
            yield "code_table", f"has no column {', '.join(missing)}"

    def halo(self) -> float:
        """Zero, as each point is coded by itself."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> PointsFeatureCodes.Outputs:
        """Look the codes up."""
        ctx.progress(0.0)
        classes = self.points[CLASS].astype(np.int64)
        taken = taking_part(self.points, self.ignore)
        codes, texts = self._codes(np.unique(classes[taken]))
        kept = taken & np.isin(classes, list(codes))
        look_up = np.zeros(256, np.uint16)
        look_up[list(codes)] = list(codes.values())
        made = self.points.select(kept).with_attributes({CODE: look_up[classes[kept]]})
        left_out = int(np.count_nonzero(taken & ~kept))
        if left_out:
            log.warning("%d points are of classes without a code, and left out", left_out)
        counts = np.bincount(classes[kept], minlength=256)
        rows = [
            {CODE: code, CLASS: number, TEXT: texts[number], "points": int(counts[number])}
            for number, code in sorted(codes.items(), key=lambda pair: (pair[1], pair[0]))
        ]
        return self.Outputs(coded=made, codes=Table.from_rows(rows), left_out=left_out)

    def _codes(self, there: NDArray[np.int64]) -> tuple[dict[int, int], dict[int, str]]:
        """Code and description by class: of the table, or the classes that there are."""
        if self.code_table is None:
            numbers = there.tolist()
            return {n: n for n in numbers}, {n: class_label(n) for n in numbers}
        rows = self.code_table.rows()
        wrong = [r for r in rows if not (_is_whole(r[CLASS], 255) and _is_whole(r[CODE], MOST))]
        if wrong:
            raise DataError(
                "points.feature_codes",
                {"code_table": f"classes are 0 to 255, codes 0 to {MOST}, got {wrong[0]}"},
            )
        numbers = [int(r[CLASS]) for r in rows]
        if twice := [number for number in numbers if numbers.count(number) > 1]:
            raise DataError(
                "points.feature_codes",
                {"code_table": f"must have each class once, has class {twice[0]} more often"},
            )
        return (
            {int(r[CLASS]): int(r[CODE]) for r in rows},
            {int(r[CLASS]): str(r[TEXT] or "") for r in rows},
        )


def _is_whole(value: object, most: int) -> bool:
    return isinstance(value, int | float) and float(value).is_integer() and 0 <= value <= most
