"""Classification by a self-organising map that classify.som has trained."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from algorithms.classify import _evidence
from algorithms.classify._evidence import features_of, missing_feature, no_point_has_all
from algorithms.classify._feature_map import NO_NEURON, FeatureMap, with_classes
from algorithms.shared import parameters
from algorithms.shared.ground import taking_part
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Table
from toolbox.declare import ClassList, outputs, sink, source, tool
from toolbox.errors import DataError, NothingToDo

LARGEST_RADIUS, LARGEST_CONTEXT = 10.0, 20.0  # metres, as in classify.som


@tool(
    "classify.som_apply",
    title="Classify (trained map)",
    tags=(
        "som",
        "neural",
        "network",
        "kohonen",
        "predict",
    ),
)
class ClassifySomApply:
    """Classify points with a self-organising map that classify.som has trained.

    Each point gets the class of the neuron that is nearest in the features of the map, which are
    made here as they were for training. Features are not cut off where they are lower or higher
    than in training; `neuron_distance` tells the points that are unlike all in training. A map that
    was trained with x and y holds for its own area only. The map may be edited before: change its
    column `class` to name clusters by hand.
    """

    points: PointCloud = source("Points to classify")
    map: Table = source("Trained map, as classify.som gives it")
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        classified: PointCloud = sink(
            "The same points with classes, neuron, its distance and confidence",
            label="Classified points",
        )
        unclassified: int = sink("Points that lack a feature, now of class 1", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The table is a map, and the points have its features."""
        try:
            made = FeatureMap.of(self.map)
        except DataError as error:
            yield "map", str(error).removeprefix("map: ")
            return
        if text := missing_feature(made.names, self.points):
            yield "points", text
        if made.radius > LARGEST_RADIUS or made.context > LARGEST_CONTEXT:
            yield "map", f"its radius or context is above {LARGEST_RADIUS} or {LARGEST_CONTEXT} m"

    def halo(self) -> float:
        """Reach of the ground filter and of the neighbourhoods of the features."""
        return _evidence.HALO

    def run(self, ctx: Context = QUIET) -> ClassifySomApply.Outputs:
        """Compute the features of the map, and find the nearest neuron of each point."""
        cloud, made = self.points, FeatureMap.of(self.map)
        part = taking_part(cloud, self.ignore)
        if not part.any():
            none = np.zeros(0, np.int64)
            raise NothingToDo(
                "points: there are none to classify",
                instead=self._outputs(part, made, none, np.zeros(0)),
            )
        if {"x", "y"} & set(made.names):
            log.warning("the map was trained with x or y, so it holds for that area only")
        features = _evidence.PointFeatures(
            cloud if part.all() else cloud.select(part),
            made.radius * cloud.metre,
            made.context * cloud.metre,
            ctx.part(0.0, 0.9),
        )
        values = features_of(features, made.names)
        outputs = self._outputs(part, made, *made.neurons(values, ctx.part(0.9, 1.0)))
        if problem := no_point_has_all(made.names, values):
            raise NothingToDo(problem, instead=outputs)
        return outputs

    def _outputs(
        self,
        part: NDArray[np.bool_],
        made: FeatureMap,
        best: NDArray[np.int64],
        away: NDArray[np.float64],
    ) -> ClassifySomApply.Outputs:
        cloud = self.points
        lacking = np.zeros(len(cloud), bool)
        lacking[part] = best == NO_NEURON
        return self.Outputs(
            classified=with_classes(cloud, part, made, best, away),
            unclassified=int(np.count_nonzero(lacking & cloud.core)),
        )
