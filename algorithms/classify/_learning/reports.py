"""What a training tells: accuracies, importance of features, learning curve, and verdict.

References
----------
Breiman, L. (2001). Random forests. Machine Learning 45(1), 5-32: importance by permutation.
Niculescu-Mizil, A. and Caruana, R. (2005). Predicting good probabilities with supervised learning.
ICML, 625-632: reliability.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._learning.model import Trained, softmax
from algorithms.classify._learning.training import (
    Floats,
    Labelled,
    Rows,
    Settings,
    trained,
)
from algorithms.shared.accuracy.blocks import Tallies, intervals
from algorithms.shared.accuracy.confusion import (
    CLASS_MEASURES,
    MEASURES,
    class_measures,
    measures,
)
from toolbox.context import QUIET, Context

SHARES = (0.1, 0.25, 0.5, 1.0)  # of the blocks, in the learning curve
ASKED = 3000  # points with which importances are found
GAIN = 0.5  # percent of accuracy that the last doubling may bring if labels suffice
FEW_BLOCKS, FEW_POINTS = 10, 500  # of a class, below which its figures are luck
LOW_F1 = 200 / 3  # percent; below it less than half of what has the class in either has it in both
RELIABLE = 3.0  # percent by which probabilities may miss the share that is right
MORE_LABELS = "label more of it, at other places"
TELL_APART = (
    "label more places where both stand side by side, give features that tell them apart, or leave "
    "one out"
)

Row = dict[str, Any]
Ints = NDArray[np.int64]


def matrices(points: Labelled, given: Ints, classes: int) -> Tallies:
    """Confusion matrix of each block, of the points that the learnt ones stand for."""
    held, number = np.unique(points.block, return_inverse=True)
    cell = (number * classes + points.label) * classes + given
    found = np.bincount(cell, points.weight, minlength=len(held) * classes**2)
    counts = np.asarray(found.reshape(-1, classes, classes), float)
    square = np.zeros(len(held), np.int64) if points.square is None else points.square[held]
    return Tallies(counts, square)


def accuracy_rows(by_block: Tallies, seed: int) -> Iterator[Row]:
    """Measures of all classes with the intervals of blocks."""
    values, spread = (
        measures(by_block.counts.sum(axis=0)[None]),
        intervals(by_block, measures, seed),
    )
    for name, (unit, meaning) in MEASURES.items():
        low, high = (_known(v) for v in spread[name])
        row = {"measure": name, "value": _known(values[name][0]), "low": low, "high": high}
        yield row | {"unit": unit, "meaning": meaning}


def class_rows(by_block: Tallies, classes: Sequence[int], seed: int) -> Iterator[Row]:
    """One row per class: points, blocks, and each measure with its limits."""
    whole, spread = by_block.counts.sum(axis=0), intervals(by_block, class_measures, seed)
    values = class_measures(whole[None])
    for k, code in enumerate(classes):
        row: Row = {"class": int(code), "points": round(whole[k].sum())}
        row["blocks"] = int(np.count_nonzero(by_block.counts[:, k].sum(axis=1)))
        for name in CLASS_MEASURES:
            low, high = (_known(limit[k]) for limit in spread[name])
            value = _known(values[name][0, k])
            row |= {name: value, f"{name}_low": low, f"{name}_high": high}
        yield row


def matrix_rows(by_block: Tallies, classes: Sequence[int]) -> Iterator[Row]:
    """One row per class of the labels."""
    for code, line in zip(classes, by_block.counts.sum(axis=0), strict=True):
        given = {f"class {c}": round(n) for c, n in zip(classes, line, strict=True)}
        yield {"reference": f"class {code}"} | given | {"total": round(line.sum())}


def importance_rows(made: Trained, kept: Labelled, seed: int, ctx: Context) -> list[Row]:
    """Loss of overall accuracy where a feature is that of another point, the largest first."""
    from sklearn.inspection import permutation_importance

    rng = np.random.default_rng(seed)
    few = kept.some(np.sort(rng.permutation(len(kept.label))[:ASKED]))
    found = permutation_importance(
        _Estimator(made), few.data, few.label, scoring=_right(few.weight), random_state=seed
    )
    ctx.progress(1.0)
    order = np.argsort(-found["importances_mean"], kind="stable")
    return [
        {
            "feature": made.features[k],
            "importance": 100 * float(found["importances_mean"][k]),
            "spread": 100 * float(found["importances_std"][k]),
            "unit": "%",
        }
        for k in order
    ]


class _Estimator:
    """A model under the names that scikit-learn asks for."""

    def __init__(self, made: Trained) -> None:
        self.made = made

    def fit(self, data: Rows, label: Ints) -> _Estimator:
        """It is trained already."""
        return self

    def predict(self, data: Rows) -> Ints:
        """Number of the class of each point."""
        return np.asarray(self.made.scores(data).argmax(axis=1))


def _right(weight: Floats) -> Any:
    """Score: the share of points that are right, each for as many as it stands for."""

    def score(estimator: _Estimator, data: Rows, label: Ints) -> float:
        return float(np.average(estimator.predict(data) == label, weights=weight))

    return score


def learning_rows(
    own: Labelled, kept: Labelled, made: Trained, how: Settings, ctx: Context = QUIET
) -> Iterator[Row]:
    """Accuracy at blocks that are kept back, with more and more of the others to learn from.

    `made` is the model of all the others.
    """
    held = np.unique(own.block)
    order = np.random.default_rng(how.seed).permutation(held)
    k = len(how.about["classes"])
    for done, share in enumerate(SHARES):
        count = max(1, round(share * len(held)))
        some = own.some(np.isin(own.block, order[:count]))
        if len(np.unique(some.label)) > 1:
            model = made if count == len(held) else trained(some, how)
            given = model.scores(kept.data).argmax(axis=1)
            found = measures(matrices(kept, given, k).counts.sum(axis=0)[None])
            row: Row = {"blocks": count, "points": len(some.label)}
            row["overall_accuracy"] = float(found["overall_accuracy"][0])
            yield row | {"mean_f1": float(found["mean_f1"][0])}
        ctx.progress((done + 1) / len(SHARES))


def reliability(scores: Floats, heat: float, points: Labelled) -> float:
    """How far probabilities miss the share that is right, in percent, as mean over ten bins."""
    chance = softmax(scores / heat)
    best, given = chance.max(axis=1), chance.argmax(axis=1)
    place = np.minimum((best * 10).astype(int), 9)
    weight = np.bincount(place, points.weight, minlength=10)
    said = np.bincount(place, points.weight * best, minlength=10)
    right = np.bincount(place, points.weight * (given == points.label), minlength=10)
    return float(100 * np.abs(said - right).sum() / weight.sum())


def verdict_rows(
    by_class: Sequence[Mapping[str, Any]],
    matrix: Floats,
    learning: Sequence[Mapping[str, Any]],
    missed: float,
) -> Iterator[Row]:
    """Whether the labels suffice: one row for each thing that was looked at.

    Parameters
    ----------
    by_class : of `class_rows`
    matrix : counts by label and given class, array of shape (k, k)
    learning : of `learning_rows`
    missed : of `reliability`, percent
    """
    codes = [row["class"] for row in by_class]
    for k, row in enumerate(by_class):
        few = row["blocks"] < FEW_BLOCKS or row["points"] < FEW_POINTS
        text = f"{row['points']} points in {row['blocks']} blocks"
        rule = f"at least {FEW_POINTS} points in {FEW_BLOCKS} blocks"
        yield _verdict(f"labels of class {row['class']}", text, rule, not few)
        value = row["f1"] or 0.0
        low = value < LOW_F1
        text = f"{value:.1f} %" + (f": {_confused(codes, matrix, k)}" if low else "")
        made = _verdict(f"F1 of class {row['class']}", text, f"at least {LOW_F1:.1f} %", not low)
        yield made | ({"advice": MORE_LABELS if few else TELL_APART} if low else {})
    if len(learning) > 1:
        gain = learning[-1]["overall_accuracy"] - learning[-2]["overall_accuracy"]
        more = "more" if gain >= 0 else "less"  # a sign first would be a formula to spreadsheets
        text = f"{abs(gain):.2f} % {more} accuracy from the last doubling of blocks"
        yield _verdict("more labels", text, f"at most {GAIN:g} %", gain <= GAIN)
    else:
        yield {"what": "more labels", "found": "too few blocks to tell", "verdict": "not known"}
    text = f"{missed:.2f} % away from the share that is right"
    yield _verdict("probabilities", text, f"at most {RELIABLE:g} %", missed <= RELIABLE)


def in_words(row: Row) -> str:
    """A row of `verdict_rows` as a warning."""
    text = f"{row['what']}: {row['found']} ({row.get('rule', 'not known')})"
    return f"{text}; {row['advice']}" if "advice" in row else text


def _confused(codes: Sequence[int], matrix: Floats, k: int) -> str:
    """What most of the errors of a class are."""
    lost, taken = np.delete(matrix[k], k), np.delete(matrix[:, k], k)
    other = int(np.argmax(np.maximum(lost, taken)))
    code = [*codes[:k], *codes[k + 1 :]][other]
    if lost[other] >= taken[other]:
        share = 100 * lost[other] / max(matrix[k].sum(), 1)
        return f"{share:.0f} % of its points are taken for class {code}"
    share = 100 * taken[other] / max(matrix[:, k].sum(), 1)
    return f"{share:.0f} % of what is taken for it is class {code}"


def _verdict(what: str, found: str, rule: str, fine: bool) -> Row:
    return {"what": what, "found": found, "rule": rule, "verdict": "ok" if fine else "look at it"}


def _known(value: Any) -> float | None:
    return None if np.isnan(value) else float(value)
