"""Labels for all points of a cloud or tile, from those of points that were chosen from it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from algorithms.corridor._extraction.labels import (
    LABEL_NUMBERS,
    POINT_NUMBER,
    classes_of,
    labelled,
)
from algorithms.shared import parameters
from algorithms.shared.ground import taking_part
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud
from toolbox.declare import ClassList, outputs, sink, source, tool
from toolbox.errors import DataError


@tool(
    "corridor.label",
    title="Label points of power lines",
    tags=(
        "power",
        "line",
        "wire",
        "tower",
        "classify",
        "label",
    ),
)
class CorridorLabel:
    """Label the points of a power line that was found among chosen points.

    `points` are those that corridor.candidates chose from, `line` what corridor.extract made of
    the chosen ones. The result is what corridor.extract gives of all points. Points of `line` give
    their class, too, so the chosen ones may be classified further before: trees, for example.
    """

    points: PointCloud = source("All points")
    line: PointCloud = source("Chosen points with wire_id, tower_id and their point_number")
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        classified: PointCloud = sink(
            "The same points with classes 14 and 15 and their numbers", label="Classified points"
        )

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points of the line have valid labels and unique point numbers."""
        line, needed = self.line, (POINT_NUMBER, *LABEL_NUMBERS, "confidence")
        if missing := [name for name in needed if name not in line]:
            yield "line", f"{line.name} has no attribute {', '.join(missing)}"
            return
        if unknown := [name for name in needed if not np.all(line[name] >= 0)]:
            yield "line", f"{line.name} has values of {', '.join(unknown)} that are not 0 or more"
        number = np.sort(line[POINT_NUMBER])
        if len(twice := number[1:][number[1:] == number[:-1]]):
            yield "line", f"{line.name} has more than one point of {POINT_NUMBER} {twice[0]}"

    def halo(self) -> float:
        """Zero, as each point is labelled by itself."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> CorridorLabel.Outputs:
        """Label the points of the line, found by their numbers."""
        cloud, line = self.points, self.line
        number = cloud.number  # rises: the points of a tile are in the order of the survey
        index = np.searchsorted(number, line[POINT_NUMBER])
        here = index < len(number)
        here[here] = number[index[here]] == line[POINT_NUMBER][here]
        index = index[here]
        # A tile has but some points of a line that is there as a whole.
        complete = here.all() or (cloud.origin is not None and line.origin is None)
        if not (complete and np.array_equal(cloud.xyz[index], line.xyz[here])):
            raise DataError(f"line: {line.name} was not chosen from {cloud.name}")
        if "classification" in line:
            classes = np.array(classes_of(cloud))
            classes[index] = line["classification"][here]
            cloud = cloud.with_attributes({"classification": classes})
        names = (*LABEL_NUMBERS, "confidence")
        labels = {name: line[name][here] for name in names}
        ctx.progress(1.0)
        return self.Outputs(
            classified=labelled(cloud, taking_part(cloud, self.ignore), index, labels)
        )
