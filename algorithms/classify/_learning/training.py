"""Training with scikit-learn, checks on blocks of ground that were kept back, and calibration.

References
----------
Roberts, D. R. et al. (2017). Cross-validation strategies for data with temporal, spatial,
hierarchical, or phylogenetic structure. Ecography 40(8), 913-929: blocks instead of single points.
Guo, C. et al. (2017). On calibration of modern neural networks. ICML, 1321-1330: the temperature.
Friedman, J. H. (2001). Greedy function approximation: a gradient boosting machine. Annals of
Statistics 29(5), 1189-1232. Breiman, L. (2001). Random forests. Machine Learning 45, 5-32:
permutation importance.
Chen, T. and Guestrin, C. (2016). XGBoost: a scalable tree boosting system. KDD, 785-794: a
penalty of leaves (equation 5).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._learning.bins import Bins
from algorithms.classify._learning.model import FORMAT, LEAF, Trained, softmax
from toolbox.context import QUIET, Context

Kind = Literal["boosting", "forest", "logistic"]
PENALTY = (
    1.0  # points of doubt in each leaf (lambda of Chen and Guestrin 2016): without any, leaves
)
# of points that are nearly certain get values beyond all bounds, and later rounds chase them
COOLEST, HOTTEST = 0.2, 10.0  # temperatures

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Rows = NDArray[np.float32]


@dataclass(frozen=True)
class Labelled:
    """Points that are learnt from.

    Attributes
    ----------
    data : features, array of shape (n, f)
    label : number of the class, array of shape (n,)
    weight : how many points of the data each stands for
    block : number of the block of ground
    bins : in which features are looked at; None to make them of these points
    square : number of the square of four blocks in which each block lies; None for one of all
    """

    data: Rows
    label: Ints
    weight: Floats
    block: Ints
    bins: Bins | None = None
    square: Ints | None = None

    def some(self, which: NDArray[Any]) -> Labelled:
        """A part of the points, in the bins of all of them."""
        bins = self.bins and Bins(self.bins.edges, self.bins.number[which])
        own = self.data[which], self.label[which], self.weight[which], self.block[which]
        return Labelled(*own, bins, self.square)


@dataclass(frozen=True)
class Settings:
    """How to learn: see the parameters of classify.train."""

    kind: Kind
    trees: int
    balanced: bool
    seed: int
    about: Mapping[str, Any]


def trained(points: Labelled, how: Settings) -> Trained:
    """A model of points of all classes; its temperature is 1."""
    weight = weights(points, how)
    learn = {"boosting": _boosting, "forest": _forest, "logistic": _logistic}[how.kind]
    return learn(points, weight, how)


def weights(points: Labelled, how: Settings) -> Floats:
    """What each point counts for in a training, 1 as mean."""
    weight = points.weight / points.weight.mean()
    if how.balanced:
        total = np.bincount(points.label, weight)
        weight = weight / total[points.label] * total.sum() / np.count_nonzero(total)
    return np.asarray(weight)


def binned(points: Labelled, how: Settings) -> Labelled:
    """The same points with bins for boosting, so that all models of a training share them."""
    if how.kind != "boosting":
        return points
    return dataclasses.replace(points, bins=Bins.of(points.data, weights(points, how)))


def _boosting(points: Labelled, weight: Floats, how: Settings) -> Trained:
    """Histogram gradient boosting: trees that mend the errors of those before them.

    Its loops are short, and several threads would spend more time on waiting for each other.
    """
    from sklearn.ensemble import HistGradientBoostingClassifier
    from threadpoolctl import threadpool_limits

    bins = points.bins or Bins.of(points.data, weight)
    with threadpool_limits(1, user_api="openmp"):
        made = HistGradientBoostingClassifier(
            max_iter=how.trees,
            l2_regularization=PENALTY,
            early_stopping=False,
            max_features=share_asked(points.data.shape[1]),
            random_state=how.seed,
        ).fit(_without_void(bins.number), points.label, weight)
    k = len(how.about["classes"])
    columns = [int(c) for c in made.classes_]
    if len(columns) == 2:
        columns = columns[1:]  # one tree for both, whose score is that of the second
    baseline = np.full(k, -50.0)
    baseline[made.classes_] = 0.0
    baseline[columns] = np.ravel(made._baseline_prediction)
    parts = []
    for trees in made._predictors:
        for column, tree in zip(columns, trees, strict=True):
            nodes = tree.nodes
            leaf = nodes["is_leaf"] > 0
            values = np.zeros((len(nodes), k))
            values[leaf, column] = nodes["value"][leaf]
            feature = np.where(leaf, LEAF, nodes["feature_idx"])
            threshold = bins.threshold(feature, nodes["num_threshold"])
            part = feature, threshold, nodes["left"], nodes["right"]
            parts.append((*part, nodes["missing_go_to_left"] > 0, values))
    return _of_trees(parts, baseline, how)


def _without_void(data: Rows) -> Rows:
    """The same features, those that no point has 0, as libraries need a value."""
    return np.where(np.isnan(data).all(axis=0), np.float32(0), data)


def share_asked(features: int) -> float:
    """Share of the features among which each branch chooses, drawn anew: the root of their number.

    A forest does so, too (Breiman 2001); else a few features that tell the towns of the training
    from each other hide those that hold elsewhere.

    >>> round(100 * share_asked(100))
    10
    """
    return float(1 / np.sqrt(features))


def _forest(points: Labelled, weight: Floats, how: Settings) -> Trained:
    """Random forest: the mean of trees that each saw other points and features."""
    from sklearn.ensemble import RandomForestClassifier

    made = RandomForestClassifier(
        how.trees, min_samples_leaf=5, random_state=how.seed, max_depth=20
    ).fit(points.data, points.label, weight)
    k, parts = len(how.about["classes"]), []
    for tree in (estimator.tree_ for estimator in made.estimators_):
        leaf = tree.children_left < 0
        share = tree.value[:, 0] / tree.value[:, 0].sum(axis=1, keepdims=True)
        values = np.zeros((len(leaf), k))
        values[:, made.classes_] = np.where(leaf[:, None], share, 0.0)
        feature = np.where(leaf, LEAF, tree.feature)
        part = feature, tree.threshold, tree.children_left, tree.children_right
        parts.append((*part, tree.missing_go_to_left > 0, values))
    return _of_trees(parts, np.zeros(k), how)


def _of_trees(parts: list[tuple[Any, ...]], baseline: Floats, how: Settings) -> Trained:
    """The nodes of all trees in a row."""
    sizes = [len(part[0]) for part in parts]
    start = np.repeat(np.cumsum(sizes) - sizes, sizes)
    feature, threshold, left, right, missing, values = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    inner = feature != LEAF
    return Trained(
        {"format": FORMAT, "baseline": baseline.tolist(), "temperature": 1.0, **how.about},
        np.repeat(np.arange(len(parts)), sizes),
        feature.astype(np.int64),
        np.where(inner, np.minimum(threshold.astype(float), 1e300), 0.0),
        np.where(inner, left.astype(np.int64) + start, LEAF),
        np.where(inner, right.astype(np.int64) + start, LEAF),
        missing,
        values,
    )


def _logistic(points: Labelled, weight: Floats, how: Settings) -> Trained:
    """Logistic regression of features that are centred and scaled."""
    from sklearn.linear_model import LogisticRegression

    data = _without_void(points.data)
    middle = np.nanmedian(data, axis=0).astype(float)
    data = np.where(np.isnan(data), middle, data)
    scale = data.std(axis=0)
    scale[scale == 0] = 1.0
    made = LogisticRegression(max_iter=500).fit((data - middle) / scale, points.label, weight)
    k = len(how.about["classes"])
    values, baseline = np.zeros((data.shape[1], k)), np.full(k, -50.0)
    columns = made.classes_
    baseline[columns] = 0.0
    columns = columns[1:] if len(columns) == 2 else columns
    values[:, columns], baseline[columns] = made.coef_.T, made.intercept_
    nothing = np.full(data.shape[1], LEAF)
    about = {"middle": middle.tolist(), "scale": scale.tolist(), "baseline": baseline.tolist()}
    return Trained(
        {"format": FORMAT, "temperature": 1.0, **about, **how.about},
        *(np.zeros(len(nothing), int), nothing, np.zeros(len(nothing)), nothing, nothing),
        np.zeros(len(nothing), bool),
        values,
    )


def folds_of(block: Ints, folds: int) -> list[tuple[Ints, Ints]]:
    """Indices of the points that are learnt from and kept back, of each fold: whole blocks."""
    from sklearn.model_selection import GroupKFold

    return list(GroupKFold(folds).split(block, groups=block))


def kept_back(
    points: Labelled, folds: Sequence[tuple[Ints, Ints]], how: Settings, ctx: Context = QUIET
) -> tuple[Floats, list[Trained]]:
    """Scores of each point by a model that saw nothing of its block, (n, k), and these models."""
    found, models = np.zeros((len(points.label), len(how.about["classes"]))), []
    for done, (own, kept) in enumerate(folds):
        models.append(trained(points.some(own), how))
        found[kept] = models[-1].scores(points.data[kept])
        ctx.progress((done + 1) / len(folds))
    return found, models


def temperature(scores: Floats, points: Labelled) -> float:
    """The number by which scores are divided so that probabilities are as often right as they say.

    It makes the log loss of points that were kept back smallest.
    """
    from scipy.optimize import minimize_scalar
    from sklearn.metrics import log_loss

    labels = np.arange(scores.shape[1])

    def loss(log_heat: float) -> float:
        chance = softmax(scores / np.exp(log_heat))
        return float(log_loss(points.label, chance, sample_weight=points.weight, labels=labels))

    limits = (np.log(COOLEST), np.log(HOTTEST))
    return float(np.exp(minimize_scalar(loss, bounds=limits, method="bounded").x))
