"""Many files of points merged into one, without points that overlapping files share.

What is reconciled and what is refused: docs/explanation/preparing-points.md.
"""

from __future__ import annotations

import itertools
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.points import _merge_kernels as kernels
from algorithms.points._groups import cells, grouped
from algorithms.shared.lowest import blocks, require_finite
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud
from toolbox.declare import outputs, param, sink, source, tool
from toolbox.errors import DataError

ROUNDING = 1e-6  # share by which a tolerance is widened; more than rounding moves
SAME = ("gps_time", "return_number")  # of a pulse that two files hold
MOST_FILES = 65_535  # that LAS has numbers for

Bools = NDArray[np.bool_]


@tool(
    "points.merge",
    title="Merge points",
    tags=(
        "merge",
        "join",
        "combine",
        "duplicates",
        "tile",
        "mosaic",
        "seam",
        "overlap",
    ),
)
class PointsMerge:
    """Join the files of a survey to one, and drop what overlapping files have in common.

    Point formats, scales and extra bytes may differ: the result has the attributes of all, the
    finest scale, and header and records of the first file; what a file lacks is 0 in its points.
    Files in different CRS, units or height systems are refused: reproject them first.

    With `duplicates` drop, a point goes that is also in an earlier file (in the order of the sorted
    paths): at the same position, with the same GPS time and return number if there are any. Files
    of different scales round differently: then give a `max_difference` of half the coarser step.
    Points that share their place within one file stay; points.thin removes them.

    `numbering` writes the number of the file, from 1, into the attribute file_id, or into
    point_source_id, in place of the flight line that may be there.
    """

    points: PointCloud = source("Files to merge: a folder, a pattern or a list")
    duplicates: Literal["keep", "drop"] = param(
        "What to do with points that are in several files",
        default="keep",
        label="Points in several files",
        words={"keep": "Keep them", "drop": "Keep one of them"},
    )
    max_difference: float = param(
        "Largest difference in x, y and z between two records of one point",
        default=0.0,
        unit="m",
        ge=0,
        le=0.1,
        label="Largest difference",
    )
    numbering: Literal["none", "file_id", "point_source_id"] = param(
        "Attribute to write the number of the file into",
        default="none",
        label="Write the number of the file to",
        words={
            "none": "No attribute",
            "file_id": "A new attribute, file_id",
            "point_source_id": "Point source ID",
        },
    )

    @outputs
    class Outputs:
        merged: PointCloud = sink("All points, in the order of the files", label="Merged points")
        dropped: int = sink("Points that were in an earlier file, too", unit="1")

    def halo(self) -> float:
        """The largest difference of duplicates, which may lie on two sides of a tile edge."""
        return self.max_difference * (1 + ROUNDING) if self.duplicates == "drop" else 0.0

    def run(self, ctx: Context = QUIET) -> PointsMerge.Outputs:
        """Number the files, and drop duplicates."""
        cloud, number = self.points, self.points.file
        if self.numbering != "none":
            if len(number) and number.max() >= MOST_FILES:
                text = f"numbering: LAS numbers up to {MOST_FILES} files, got {number.max() + 1}"
                raise DataError(text)
            cloud = cloud.with_attributes(
                {str(self.numbering): (number + 1).astype(np.uint16)},
                descriptions={"file_id": "number of the file"},
            )
        ctx.progress(0.1)
        twice = np.zeros(len(cloud), bool)
        if self.duplicates == "drop":
            agree = [self.points[name] for name in SAME if name in self.points]
            twice = in_earlier_file(
                self.points.xyz, number, agree, self.max_difference, ctx=ctx.part(0.1, 1.0)
            )
        dropped = int(np.count_nonzero(twice & cloud.core))
        ctx.progress(1.0)
        return self.Outputs(merged=cloud.select(~twice) if twice.any() else cloud, dropped=dropped)


def in_earlier_file(
    xyz: NDArray[np.float64],
    file: NDArray[np.int32],
    agree: list[NDArray[Any]],
    tolerance: float = 0.0,
    *,
    ctx: Context = QUIET,
) -> Bools:
    """True for points that also occur in an earlier file.

    That a point goes does not depend on whether the other stays, so that each can be judged by
    what is near it. Two points within the tolerance are in the same cell of one of eight lattices
    of four times its size, which are shifted by half a cell against each other.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    file : array of shape (n,), number of the file
    agree : arrays of shape (n,), what must be exactly the same
    tolerance : largest difference in x, in y and in z, in the unit of xyz
    ctx : progress and cancellation

    Returns
    -------
    array of shape (n,)
    """
    require_finite(xyz)
    marks = np.zeros(len(xyz), bool)
    if not len(xyz) or file.min() == file.max():
        return marks
    exact = [np.asarray(values, np.float64) + 0.0 for values in agree]  # + 0.0: no -0.0
    shifts = list(itertools.product((0.0, 0.5), repeat=3)) if tolerance else [(0.0, 0.0, 0.0)]
    for done, shift in enumerate(shifts):
        part = ctx.part(done / len(shifts), (done + 1) / len(shifts))
        if tolerance:
            size = 4 * tolerance
            place = cells(xyz + np.array(shift) * size, size)
        else:
            place = (xyz + 0.0).view(np.int64)
        codes = np.column_stack([place, *(values.view(np.int64) for values in exact)])
        groups, count = grouped(codes, ctx=part.part(0.0, 0.5))
        order = np.argsort(groups, kind="stable")
        starts = np.searchsorted(groups[order], np.arange(count + 1))
        for first, last in blocks(count):
            near = tolerance * (1 + ROUNDING)
            kernels.mark(first, last, order, starts, xyz, file, near, marks)
            part.progress(0.5 + 0.5 * last / count)
    return marks
