"""Classification that is learnt from points whose classes are known.

What it does and how well: docs/explanation/learning-classes.md.

References
----------
Weinmann, M. et al. (2015). Semantic point cloud interpretation based on optimal neighborhoods,
relevant features and efficient classifiers. ISPRS Journal 105, 286-304.
Roberts, D. R. et al. (2017). Cross-validation strategies for data with temporal, spatial,
hierarchical, or phylogenetic structure. Ecography 40(8), 913-929.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._learning import drift, reports
from algorithms.classify._learning import features as names_of
from algorithms.classify._learning.training import (
    Kind,
    Labelled,
    Settings,
    binned,
    folds_of,
    kept_back,
    temperature,
    trained,
)
from algorithms.shared import parameters
from algorithms.shared.accuracy.blocks import Clumping, blocks
from algorithms.shared.accuracy.certainty import warn_blocks, warn_clumps
from algorithms.shared.accuracy.columns import OF_CLASSES, shown
from algorithms.shared.chance import random_keys
from algorithms.shared.ground import taking_part
from algorithms.shared.polygons import Polygons, polygons
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Table, Vector
from toolbox.data.crs import crs_conflict
from toolbox.declare import Attribute, ClassList, outputs, param, show, sink, source, tool
from toolbox.errors import DataError

FEWEST = 20  # points of a class
NO_LABEL = -1
FINE = 0.001  # metres

Ints = NDArray[np.int64]


@tool(
    "classify.train",
    title="Train a classifier",
    tags=("classify", "train", "learn", "machine-learning", "random", "forest", "model"),
)
class ClassifyTrain:
    """Learn classes from points that have them, or that lie in polygons with classes.

    The classes are those of `labels`; with `areas` only points in these polygons teach, such as
    the patches of classify.suggest, and with `class_attribute` their class is that of the
    polygon. The features of a point see all others, labelled or not: do not cut the patches out
    of the cloud. `leave_out` names labels that are none, as 0 and 1. Features are named: an
    attribute; a feature of classify.som, as height_above_ground; or a feature of features.local
    within a radius in metres, as planarity@2. Without names there are all that suit, in the
    `radii`.

    Accuracies are those at blocks of ground that a model has seen nothing of: the area is cut into
    squares (`block`), these into `folds`, and each fold is classified by a model of all others.
    Neighbouring points are nearly the same point, so that points drawn at random would flatter. The
    same scores make the probabilities honest (temperature scaling). `report` says whether the
    labels suffice: points and blocks of each class, what twice as many blocks brought (`learning`),
    and how far probabilities miss. `importance` is the accuracy lost where the values of a feature
    are exchanged between points; features that say the same share it.

    `model` holds numbers and JSON alone, for classify.apply: reading it runs nothing. It holds for
    surveys like this one, as to density, sensor and what there is.
    """

    points: PointCloud = source("Points with classes to learn from")
    areas: Vector | None = source(
        "Polygons whose points teach, all of them by default", default=None, shapes="polygon"
    )
    labels: Attribute = param(
        "Attribute that holds the class to learn", default=Attribute("classification")
    )
    class_attribute: str | None = param(
        "Attribute of polygons or points that is the true class", default=None, of="areas"
    )
    leave_out: ClassList | None = parameters.leave_out()
    features: tuple[str, ...] | None = param(
        "Names of features, such as intensity or planarity@2; by default all that suit",
        default=None,
        of="points",
        offers=names_of.OFFERED,
    )
    radii: tuple[float, ...] = param(
        "Radii of the features, if none are named", default=names_of.RADII, unit="m", gt=0, le=10
    )
    learner: Kind = param(
        "Boosted trees, a random forest or logistic regression", default="boosting"
    )
    trees: int = param("Trees of each class, or of the forest", default=50, unit="1", ge=1, le=1000)
    balanced: bool = param("All classes weigh the same, whatever their size", default=False)
    per_class: int = param(
        "Points of each class that are learnt from at most, chosen by their places",
        default=50_000,
        unit="1",
        ge=FEWEST,
        le=10_000_000,
    )
    folds: int = param(
        "Parts of the blocks that are kept back in turn", default=5, unit="1", ge=2, le=50
    )
    block: float | None = parameters.block()
    seed: int = parameters.seed()
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        model: Table = sink("The trained model, for classify.apply")
        report: Table = sink("Whether the labels suffice: one row for each thing looked at")
        accuracy: Table = sink("One row per measure of all classes, at blocks kept back")
        by_class: Table = sink(
            "One row per class: its accuracies with intervals", columns=OF_CLASSES
        )
        confusion: Table = sink(
            "Full confusion matrix: a row per reference class",
            show=show.Matrix("reference", ("total",)),
        )
        importance: Table = sink("Accuracy that is lost without each feature, the largest first")
        learning: Table = sink(
            "Accuracy by the number of blocks that are learnt from",
            show=show.Curve(
                show.Axis("points", "points learnt from"),
                (show.Axis("overall_accuracy", "overall accuracy", "%", from_zero=False),),
                dots=True,
            ),
            columns=shown("overall_accuracy", "mean_f1"),
        )
        overall_accuracy: float = sink("Points of the right class, at blocks kept back", unit="%")
        mean_f1: float = sink("Mean F1 of the classes, at blocks kept back", unit="%")
        learnt: int = sink("Points that were learnt from", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """There are names or radii, each once."""
        if self.features is not None and not self.features:
            yield "features", "give at least one name"
        if self.features and len(set(self.features)) < len(self.features):
            yield "features", "a name is given twice"
        if not self.radii:
            yield "radii", "give at least one"
        if self.areas is None and self.class_attribute is not None:
            yield "class_attribute", "is an attribute of areas; give them, too"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have the features and labels."""
        if text := names_of.problem(self.features or (), self.points):
            yield "features", text
        if self.class_attribute is None and self.labels not in self.points:
            known = ", ".join(self.points.names) or "none"
            yield "labels", f"no attribute {self.labels!r}; there are {known}"
        if self.areas is not None:
            if text := crs_conflict(self.areas.crs, self.points.crs, heights=False) or "":
                yield (
                    "areas",
                    f"{self.areas.name or 'the layer'} {text}, which is that of the points",
                )
            if self.class_attribute not in (None, *self.areas.names):
                known = ", ".join(self.areas.names) or "none"
                yield "class_attribute", f"no attribute {self.class_attribute!r}; there are {known}"

    def halo(self) -> float:
        """Infinite, as all points train the model; classify.apply applies it to tiles."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> ClassifyTrain.Outputs:
        """Describe the points, learn, and check at blocks that were kept back."""
        part = taking_part(self.points, self.ignore)
        cloud = self.points if part.all() else self.points.select(part)
        codes, chosen, points, names = self._learnt(cloud, ctx.part(0.0, 0.2))
        how = self._settings(codes, names, cloud)
        points = binned(points, how)
        folds = folds_of(points.block, self.folds)
        scores, models = kept_back(points, folds, how, ctx.part(0.2, 0.7))
        heat = temperature(scores, points)
        made = trained(points, how)
        ctx.progress(0.85)
        by_block = reports.matrices(points, scores.argmax(axis=1), len(codes))
        warn_clumps(Clumping.of(by_block))
        by_class = list(reports.class_rows(by_block, codes, self.seed))
        own, kept = (points.some(which) for which in folds[0])
        learning = list(reports.learning_rows(own, kept, models[0], how, ctx.part(0.85, 0.95)))
        importance = reports.importance_rows(models[0], kept, self.seed, ctx.part(0.95, 1.0))
        missed = reports.reliability(scores, heat, points)
        report = list(reports.verdict_rows(by_class, by_block.counts.sum(axis=0), learning, missed))
        for row in report:
            if row["verdict"] != "ok":
                log.warning("%s", reports.in_words(row))
        accuracy = list(reports.accuracy_rows(by_block, self.seed))
        value = {row["measure"]: row["value"] for row in accuracy}
        record: dict[str, Any] = {
            "accuracy": {n: value[n] for n in ("overall_accuracy", "mean_f1", "kappa")}
        }
        record |= {"points": len(chosen), "blocks": len(by_block.counts), "temperature": heat}
        record |= drift.learnt(points, folds, len(codes))
        return self.Outputs(
            model=dataclasses.replace(made, about={**made.about, **record}).table(),
            report=Table.from_rows(report),
            accuracy=Table.from_rows(accuracy),
            by_class=Table.from_rows(by_class),
            confusion=Table.from_rows(reports.matrix_rows(by_block, codes)),
            importance=Table.from_rows(importance),
            learning=Table.from_rows(learning),
            overall_accuracy=value["overall_accuracy"] or 0.0,
            mean_f1=value["mean_f1"] or 0.0,
            learnt=len(chosen),
        )

    def _learnt(
        self, cloud: PointCloud, ctx: Context
    ) -> tuple[list[int], Ints, Labelled, tuple[str, ...]]:
        """Codes of the classes, indices and data of the points learnt from, names of features."""
        label = self._labels(cloud)
        codes = sorted({int(code) for code in np.unique(label)} - {NO_LABEL})
        if len(codes) < 2:
            raise DataError(f"labels: the points must be of two classes at least, got {codes}")
        for code in codes:
            if (count := np.count_nonzero(label == code)) < FEWEST:
                raise DataError(
                    f"labels: class {code} has {count} points, at least {FEWEST} are needed; "
                    "leave it out"
                )
        radii = [round(radius / cloud.metre, 6) for radius in self.radii]  # names are in metres
        names = self.features or names_of.usual(cloud, radii)
        places = np.rint(cloud.xyz / cloud.metre / FINE)  # so that rounding does not draw others
        chosen, weight = drawn(places, label, codes, self.per_class, self.seed)
        ground = blocks(cloud.xyz[chosen, :2], self.block)
        if len(ground) < 2 * self.folds:
            raise DataError(
                f"block: {len(ground)} blocks hold labels, {2 * self.folds} are needed for "
                f"{self.folds} folds; lower block or folds"
            )
        warn_blocks(ground, "points")
        data = names_of.described(cloud, names, ctx=ctx)[chosen]
        for name, column in zip(names, data.T, strict=True):
            if not np.isfinite(column).any():
                log.warning("no point has the feature %s, which tells nothing", name)
        place = np.searchsorted(codes, label[chosen])
        points = Labelled(data, place, weight, ground.number, square=ground.square)
        return codes, chosen, points, names

    def _labels(self, cloud: PointCloud) -> Ints:
        """Class of each point, NO_LABEL where it has none."""
        if self.areas is not None and self.class_attribute is not None:
            label = self._of_areas(cloud, self.areas)
        else:
            given = cloud[self.labels]
            if (
                not np.isin(given % 1, 0).all()
                or given.min(initial=0) < 0
                or given.max(initial=0) > 255
            ):
                raise DataError(f"labels: {self.labels} must hold classes from 0 to 255")
            label = given.astype(np.int64)
            if self.areas is not None:
                label[~self._inside(cloud, self.areas)] = NO_LABEL
        label[np.isin(label, self.leave_out or ())] = NO_LABEL
        return label

    @staticmethod
    def _inside(cloud: PointCloud, areas: Vector) -> NDArray[np.bool_]:
        """True for points in any of the polygons."""
        inside = Polygons.of(polygons(areas, "areas")).hold(cloud.xyz[:, :2])
        if not inside.any():
            raise DataError("areas: no point lies in the polygons")
        return inside

    def _of_areas(self, cloud: PointCloud, areas: Vector) -> Ints:
        """Class of the polygons in which points lie; none where polygons of two classes overlap."""
        filled = areas.frame[areas.frame[self.class_attribute].notna()]
        if empty := len(areas.frame) - len(filled):
            text = "%d polygons have no %s, and teach nothing"
            log.warning(text, empty, self.class_attribute)
        shapes, column = filled.geometry, filled[self.class_attribute]
        try:
            codes = column.to_numpy(float)
            if not ((codes % 1 == 0) & (codes >= 0) & (codes <= 255)).all():
                raise ValueError
        except (ValueError, TypeError):
            text = f"{self.class_attribute} must hold classes from 0 to 255"
            raise DataError(f"class_attribute: {text}") from None
        polygons(areas, "areas")  # all of them are valid
        label, count = np.full(len(cloud), NO_LABEL), np.zeros(len(cloud), np.int64)
        for code in np.unique(codes):
            inside = Polygons.of(shapes[codes == code].to_numpy()).hold(cloud.xyz[:, :2])
            label[inside], count = int(code), count + inside
        if several := int((count > 1).sum()):
            log.warning("%d points lie in polygons of two classes, and teach nothing", several)
        label[count > 1] = NO_LABEL
        if missing := sorted({int(code) for code in codes} - set(label.tolist())):
            raise DataError(f"areas: no point lies in polygons of class {missing[0]} alone")
        return label

    def _settings(self, codes: list[int], names: tuple[str, ...], cloud: PointCloud) -> Settings:
        import sklearn

        about: dict[str, Any] = {"kind": self.learner, "classes": codes, "features": list(names)}
        about["density"] = names_of.density(cloud.xyz / cloud.metre)
        about["versions"] = {"scikit-learn": sklearn.__version__, "numpy": np.__version__}
        return Settings(self.learner, self.trees, self.balanced, self.seed, about)


def drawn(
    xyz: NDArray[np.float64], label: Ints, codes: list[int], count: int, seed: int
) -> tuple[Ints, NDArray[np.float64]]:
    """At most so many points of each class, by their places alone, and what each stands for.

    They are sorted by place, so that neither the order of the points matters nor other points.
    """
    keys = random_keys(xyz, seed)
    chosen, weight = [], []
    for code in codes:
        own = np.flatnonzero(label == code)
        order = own[np.lexsort([*xyz[own].T, keys[own]])][:count]
        chosen.append(order)
        weight.append(np.full(len(order), len(own) / len(order)))
    return np.concatenate(chosen), np.concatenate(weight)
