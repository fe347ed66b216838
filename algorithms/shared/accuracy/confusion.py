"""Confusion matrices, and the measures that are made of them.

A matrix is all that is kept of any number of points: each of its cells goes to scikit-learn as one
sample whose weight is the count. For the thousands of matrices of a bootstrap that takes too long
(12 ms for each, against 0.02 ms), so that :func:`measures` and :func:`class_measures` compute the
same from a stack of matrices at once; a test holds both together.

References
----------
Congalton, R. G. (1991). A review of assessing the accuracy of classifications of remotely sensed
data. Remote Sensing of Environment 37(1), 35-46: producer's and user's accuracy.
Cohen, J. (1968). Weighted kappa. Psychological Bulletin 70(4), 213-220.
Gorodkin, J. (2004). Comparing two K-category assignments by a K-category correlation coefficient.
Computational Biology and Chemistry 28(5-6), 367-374: the MCC of several classes.
Pontius, R. G. and Millones, M. (2011). Death to kappa: birth of quantity disagreement and
allocation disagreement for accuracy assessment. International Journal of Remote Sensing 32(15),
4407-4429: equations 2 to 5.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MEASURES: Mapping[str, tuple[str, str]] = {
    "overall_accuracy": ("%", "of the class of the reference"),
    "mean_producers_accuracy": ("%", "mean over the classes of the reference (balanced accuracy)"),
    "mean_f1": ("%", "mean over the classes of the reference (macro F1)"),
    "mean_iou": ("%", "mean over the classes of the reference"),
    "kappa": ("1", "agreement beyond chance"),
    "kappa_linear": ("1", "the same where an error counts for the classes that it skips"),
    "kappa_quadratic": ("1", "the same where it counts for the square of that"),
    "mcc": ("1", "correlation of both classifications (Matthews, Gorodkin)"),
    "quantity_disagreement": ("%", "classes are of other sizes than in the reference"),
    "allocation_disagreement": ("%", "classes are of the same sizes, but elsewhere"),
}
"""Unit and meaning of the measures of a whole matrix."""

CLASS_MEASURES: Mapping[str, str] = {
    "producers_accuracy": "right, of those of the reference (recall, completeness)",
    "users_accuracy": "right, of those given the class (precision, correctness)",
    "f1": "harmonic mean of both",
    "iou": "right, of all that either has (quality)",
}
"""Meaning of the measures of a class, all in percent."""


@dataclass(frozen=True)
class Confusion:
    """Counts by class of the reference and given class.

    Attributes
    ----------
    labels : names of the k classes
    counts : array of shape (k, k), a row for each class of the reference

    Examples
    --------
    >>> study = Confusion(("ground", "object"), np.array([[15703, 2049], [5573, 23113]]))
    >>> round(study.measures()["kappa"], 3)
    0.665
    """

    labels: tuple[str, ...]
    counts: NDArray[np.int64]

    def measures(self) -> dict[str, float | None]:
        """The measures of MEASURES; None where not defined, as kappa of a single class."""
        from sklearn import metrics

        true, said, count = self._samples()
        if not count.sum():
            return dict.fromkeys(MEASURES)
        present = self.counts.sum(axis=1) > 0
        each = self._by_class()
        several = len(np.union1d(true, said)) > 1
        weighed = {"sample_weight": count}
        found: dict[str, float | None] = {
            "overall_accuracy": 100 * metrics.accuracy_score(true, said, **weighed),
            "mean_producers_accuracy": float(each["producers_accuracy"][present].mean()),
            "mean_f1": float(each["f1"][present].mean()),
            "mean_iou": float(each["iou"][present].mean()),
        }
        for name, how in (
            ("kappa", None),
            ("kappa_linear", "linear"),
            ("kappa_quadratic", "quadratic"),
        ):
            kappa = (
                metrics.cohen_kappa_score(true, said, weights=how, **weighed) if several else None
            )
            found[name] = None if kappa is None else float(kappa)
        varied = (self.counts.sum(axis=0) > 0).sum() > 1 and present.sum() > 1
        found["mcc"] = float(metrics.matthews_corrcoef(true, said, **weighed)) if varied else None
        quantity, allocation = _disagreement(self.counts.astype(float))
        return found | {
            "quantity_disagreement": float(quantity),
            "allocation_disagreement": float(allocation),
        }

    def class_measures(self) -> dict[str, list[float | None]]:
        """The measures of CLASS_MEASURES in percent, a value for each class; None where 0 of 0."""
        return {
            name: [None if np.isnan(v) else float(v) for v in values]
            for name, values in self._by_class().items()
        }

    def _samples(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Class of the reference, given class and count of the cells that are not empty."""
        true, said = np.nonzero(self.counts)
        return true, said, self.counts[true, said]

    def _by_class(self) -> dict[str, Floats]:
        from sklearn import metrics

        true, said, count = self._samples()
        how = {"labels": np.arange(len(self.labels)), "average": None, "sample_weight": count}
        precision, recall, f1, _ = metrics.precision_recall_fscore_support(
            true, said, zero_division=np.nan, **how
        )
        with warnings.catch_warnings():  # IoU of a class that is nowhere is 0 there, with a warning
            warnings.simplefilter("ignore")
            iou = metrics.jaccard_score(true, said, zero_division=0, **how)
        nowhere = (self.counts.sum(axis=0) + self.counts.sum(axis=1)) == 0
        values = recall, precision, f1, np.where(nowhere, np.nan, iou)
        return {
            name: 100 * np.asarray(value, float)
            for name, value in zip(CLASS_MEASURES, values, strict=True)
        }


def measures(counts: Floats) -> dict[str, Floats]:
    """The measures of MEASURES of a stack of matrices of shape (m, k, k); NaN where not defined.

    Examples
    --------
    >>> measures(np.array([[[3.0, 1.0], [0.0, 4.0]]]))["overall_accuracy"]
    array([87.5])
    """
    total = counts.sum(axis=(1, 2))
    rows, columns = counts.sum(axis=2), counts.sum(axis=1)
    right = np.trace(counts, axis1=1, axis2=2)
    each = class_measures(counts)
    present = rows > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        found = {"overall_accuracy": 100 * right / total}
        for name in ("producers_accuracy", "f1", "iou"):
            inside = np.where(present, each[name], 0.0).sum(axis=1)
            found[f"mean_{name}"] = inside / present.sum(axis=1)
        apart = np.abs(np.subtract.outer(np.arange(counts.shape[1]), np.arange(counts.shape[1])))
        for name, weight in (
            ("kappa", apart > 0),
            ("kappa_linear", apart),
            ("kappa_quadratic", apart**2),
        ):
            seen = (counts * weight).sum(axis=(1, 2))
            by_chance = np.einsum("mi,ij,mj->m", rows, weight, columns) / total
            found[name] = 1 - seen / by_chance
        covariance = right * total - (rows * columns).sum(axis=1)
        spread = (total**2 - (rows**2).sum(axis=1)) * (total**2 - (columns**2).sum(axis=1))
        found["mcc"] = covariance / np.sqrt(spread)
    quantity, allocation = _disagreement(counts)
    return found | {"quantity_disagreement": quantity, "allocation_disagreement": allocation}


def class_measures(counts: Floats) -> dict[str, Floats]:
    """The measures of CLASS_MEASURES of a stack of matrices of shape (m, k, k); NaN for 0 of 0.

    Each is an array of shape (m, k).

    Examples
    --------
    >>> class_measures(np.array([[[3.0, 1.0], [0.0, 4.0]]]))["iou"]
    array([[75., 80.]])
    """
    rows, columns = counts.sum(axis=2), counts.sum(axis=1)
    right = np.diagonal(counts, axis1=1, axis2=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        return {
            "producers_accuracy": 100 * right / rows,
            "users_accuracy": 100 * right / columns,
            "f1": 200 * right / (rows + columns),
            "iou": 100 * right / (rows + columns - right),
        }


def _disagreement(counts: Floats) -> tuple[Floats, Floats]:
    """Quantity and allocation disagreement in percent of matrices of shape (..., k, k)."""
    rows, columns = counts.sum(axis=-1), counts.sum(axis=-2)
    right = np.diagonal(counts, axis1=-2, axis2=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = 100 / rows.sum(axis=-1)
        quantity = np.abs(columns - rows).sum(axis=-1) / 2 * share
        allocation = np.minimum(rows - right, columns - right).sum(axis=-1) * share
    return np.asarray(quantity), np.asarray(allocation)
