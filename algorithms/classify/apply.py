"""Classification by a model that classify.train has made."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.classify import _evidence
from algorithms.classify._learning import drift
from algorithms.classify._learning import features as names_of
from algorithms.classify._learning.model import Trained, problems
from algorithms.classify._learning.smoothing import LARGEST, smoothed
from algorithms.shared import parameters
from algorithms.shared.ground import taking_part
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Table
from toolbox.data.report import Column
from toolbox.declare import ClassList, Share, outputs, param, sink, source, tool
from toolbox.errors import DataError, NothingToDo

UNKNOWN = 1  # class of points of which the model is not sure enough
MILLION = 1_000_000  # steps in which probabilities are summed up, so that sums are exact
DENSITIES = 4.0  # times denser or sparser than in training
MOST = 0.5  # share of points beyond the training above which one class everywhere is no answer


@tool(
    "classify.apply",
    title="Classify (trained model)",
    tags=("classify", "predict", "machine-learning", "random", "forest", "model"),
)
class ClassifyApply:
    """Classify points with a model that classify.train has made.

    The features are made as for training. Each point gets the most probable class, `probability`
    says how probable, and `second_class` which comes next. Points below `min_probability` become
    class 1; probabilities are honest for points like those of the training, and for no others.

    How unlike the training the points are stands in `drift`, a row per feature: the share outside
    of all that was seen, and the population stability index within classes, of which more than 0.25
    is a major change, beside the largest that folds of the training have (`usual`). Points with a
    feature outside of all that was seen are counted in `outside`. `expected` is the mean
    probability of the classes given. Of all this it follows the accuracy on another survey best;
    it knows nothing of objects that no training has shown. A cloud that lacks a feature, or is
    four times as dense or as sparse as the training, is refused; with `any_density` it is
    classified with a warning. In tiles there is no table of drift, but a warning of each tile.
    Points that take no part keep their class.

    With `smooth` points within that radius share what kind of object they are: the chances of all
    points that are not ground are averaged, so that a façade is not half a hedge. How probably a
    point is ground stays its own, and so does which height of vegetation it is (3 to 5), so that
    edges at the ground stay where they are. It is not for objects thinner than the radius, as
    wires.
    """

    points: PointCloud = source("Points to classify")
    model: Table = source("Trained model, as classify.train gives it")
    min_probability: float = param(
        "Probability below which a point becomes class 1", default=0.0, unit="1", ge=0, le=1
    )
    smooth: float | None = param(
        "Radius in which points share what kind of object they are; none to leave it",
        default=None,
        unit="m",
        gt=0,
        le=LARGEST,
    )
    any_density: bool = param(
        "Classify points of a density far from that of the training, too", default=False
    )
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        classified: PointCloud = sink("The same points with classes, probability and second_class")
        drift: Table = sink(
            "How unlike the training the features are, the most unlike first",
            columns={
                "outside": Column("Points outside of the training", "%", 2),
                "missing": Column("Points without it", "%", 2),
            },
        )
        outside: float = sink("Share of points with a feature beyond all of the training", unit="1")
        expected: float = sink(
            "Share of the points that is right, as far as their probabilities can tell", unit="1"
        )
        unknown: int = sink("Points that are not probable enough, now of class 1", unit="1")

        def not_looked_at(self) -> Iterator[str]:
            """What neither the drift nor the probabilities tell."""
            yield (
                "How many classes are wrong: on tiles of other places than the training, what was "
                "expected was up to 23 % too high, and no figure of the drift said by how much. "
                "Compare a part whose classes are known."
            )

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The table is a model, and the points have its features."""
        yield from problems(self.model, self.points)

    def halo(self) -> float:
        """Reach of the ground filter and of the neighbourhoods of the features."""
        return _evidence.HALO + 2 * (self.smooth or 0.0)

    def run(self, ctx: Context = QUIET) -> ClassifyApply.Outputs:
        """Compute the features of the model, and the probabilities of its classes."""
        cloud, made = self.points, Trained.of(self.model)
        part = taking_part(cloud, self.ignore)
        if not part.any():
            nothing = np.zeros((0, len(made.features)), np.float32)
            raise NothingToDo(
                "points: there are none to classify", instead=self._outputs(part, made, nothing)
            )
        chosen = cloud if part.all() else cloud.select(part)
        self._check_density(made, chosen)
        data = names_of.described(chosen, made.features, ctx=ctx.part(0.0, 0.7))
        return self._outputs(part, made, data, ctx.part(0.7, 0.9))

    def _check_density(self, made: Trained, chosen: PointCloud) -> None:
        """Refuse points of a density far from that of the training."""
        found, trained = names_of.density(chosen.xyz / chosen.metre), float(made.about["density"])
        if trained / DENSITIES <= found <= trained * DENSITIES:
            return
        text = (
            f"{chosen.name or 'the cloud'} has {found:.3g} points per m2 where there are any, the "
            f"model was trained with {trained:.3g}"
        )
        if not self.any_density:
            raise DataError(f"points: {text}; train a model on such points, or give any_density")
        log.warning("%s", text)

    def _outputs(
        self,
        part: NDArray[np.bool_],
        made: Trained,
        data: NDArray[np.float32],
        ctx: Context = QUIET,
    ) -> ClassifyApply.Outputs:
        cloud, count = self.points, len(part)
        chance = made.probabilities(data, ctx)
        if self.smooth:
            chance = smoothed(chance, made.classes, cloud.xyz[part], self.smooth)
        order = np.argsort(-chance, axis=1, kind="stable")[:, :2]
        best = np.take_along_axis(chance, order[:, :1], axis=1)[:, 0]
        unsure = best < self.min_probability
        given = np.where(unsure, UNKNOWN, made.classes[order[:, 0]])
        kept = cloud["classification"] if "classification" in cloud else np.zeros(count, np.uint8)
        classes, second = kept.astype(np.uint8), np.zeros(count, np.uint8)
        probability, unknown = np.full(count, np.nan, np.float32), np.zeros(count, bool)
        classes[part], second[part] = given, made.classes[order[:, 1]]
        probability[part], unknown[part] = best, unsure
        own = cloud.core[part]
        rows = list(drift.rows(made, data[own], order[own, 0]))
        if strange := [row["feature"] for row in rows if row["verdict"] != "alike"]:
            text = (
                "%d of %d features are unlike the training, most of all %s: that says that the "
                "accuracy of the training need not hold, not how many classes are wrong"
            )
            log.warning(text, len(strange), len(rows), ", ".join(strange[:3]))
        outside = np.zeros(count, bool)
        outside[part] = drift.beyond(made, data)
        _tell_of_void(made, data[own], given[own], outside[part][own])
        added: dict[str, NDArray[Any]] = {
            "classification": classes,
            "probability": probability,
            "second_class": second,
        }
        texts = {"probability": "of the class", "second_class": "the next most probable class"}
        return self.Outputs(
            classified=cloud.with_attributes(added, descriptions=texts),
            drift=Table.from_rows(rows),
            outside=Share.of_points(outside, cloud.core & part),
            expected=Share(
                int(np.rint(best[own] * MILLION).sum()), MILLION * int(np.count_nonzero(own))
            ),
            unknown=int(np.count_nonzero(unknown & cloud.core)),
        )


def _tell_of_void(
    made: Trained, data: NDArray[np.float32], given: NDArray[Any], outside: NDArray[np.bool_]
) -> None:
    """Warn where the probabilities, and so what is expected, say nothing of these points.

    Parameters
    ----------
    data, given, outside : features and class of the points, and whether one is beyond the training
    """
    if not outside.any():
        return
    for name, value in drift.stuck(made, data):
        log.warning(
            "%s is %g in all points, beyond all of the training: it tells nothing", name, value
        )
    if outside.mean() > MOST and (given == given[0]).all():
        log.warning(
            "all points become class %d, while %.0f %% of them have a feature beyond all of the "
            "training: their probabilities, and what is expected of them, say nothing",
            given[0],
            100 * outside.mean(),
        )
