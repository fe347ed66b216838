"""How unlike the training data other points are, feature by feature.

A town with more trees is no other survey: features are compared among points of one class, and
differences count only beyond those that parts of the training area have from each other.

References
----------
Siddiqi, N. (2006). Credit risk scorecards. Wiley: the population stability index, of which more
than 0.25 is a major change.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._learning.model import Trained
from algorithms.classify._learning.training import Labelled, Rows

LEVELS = np.linspace(0, 1, 11)  # of the quantiles that are kept
MAJOR = 0.25  # population stability index of a major change
LEAST = 1e-3  # share in place of nothing, whose logarithm is infinite

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def learnt(points: Labelled, folds: Sequence[tuple[Ints, Ints]], k: int) -> dict[str, Any]:
    """What a model keeps of the features: quantiles of each class, and how far folds differ.

    Returns
    -------
    dict
        "quantiles", of each feature a list of LEVELS for each class, and "usual", of each feature
        the largest stability index of the kept part of a fold.
    """
    edges = np.array(
        [[_quantiles(column[points.label == c]) for c in range(k)] for column in points.data.T]
    )
    usual = [
        max(unlike(edges[f], points.data[kept, f], points.label[kept]) for _, kept in folds)
        for f in range(len(edges))
    ]
    return {"quantiles": edges.tolist(), "usual": usual}


def rows(made: Trained, data: Rows, given: Ints) -> Iterator[dict[str, Any]]:
    """One row per feature, the most unlike first.

    Parameters
    ----------
    data : features of n points
    given : number of the class that each point was given
    """
    found = []
    for f, name in enumerate(made.features):
        edges, column = np.array(made.about["quantiles"][f]), data[:, f]
        known = column[np.isfinite(column)]
        low, high = float(edges.min()), float(edges.max())
        index, usual = unlike(edges, column, given), float(made.about["usual"][f])
        row: dict[str, Any] = {"feature": name, "trained_low": low, "trained_high": high}
        row["median"] = float(np.median(known)) if len(known) else None
        row["outside"] = _percent((known < low) | (known > high))
        row["missing"] = _percent(~np.isfinite(column))
        row |= {"stability_index": index, "usual": usual}
        row["verdict"] = "unlike" if index > MAJOR and index > 2 * usual else "alike"
        found.append(row)
    yield from sorted(found, key=lambda row: -row["stability_index"])


def beyond(made: Trained, data: Rows) -> NDArray[np.bool_]:
    """True for points with a feature outside of all that was learnt from, array of shape (n,)."""
    low, high = made.limits
    return np.asarray(((data < low) | (data > high)).any(axis=1))


def stuck(made: Trained, data: Rows) -> Iterator[tuple[str, float]]:
    """Features that have one value in all points, beyond all of the training, and the value."""
    for name, low, high, column in zip(made.features, *made.limits, data.T, strict=True):
        known = column[np.isfinite(column)]
        one = len(known) and known.min() == known.max()
        if one and not low <= known[0] <= high:
            yield name, float(known[0])


def unlike(edges: Floats, values: Rows, label: Ints) -> float:
    """The stability index of a feature, as mean over the points of all classes.

    Parameters
    ----------
    edges : quantiles of each class, array of shape (k, levels)
    values, label : feature and number of the class, arrays of shape (n,)
    """
    total, count = 0.0, 0
    for k, own in enumerate(edges):
        some = values[(label == k) & np.isfinite(values)]
        total, count = total + len(some) * stability_index(own, some), count + len(some)
    return total / count if count else 0.0


def stability_index(edges: Floats, values: NDArray[Any]) -> float:
    """The population stability index of values against the quantiles of others; 0 of none.

    >>> round(stability_index(LEVELS, np.linspace(0, 1, 1000)), 3)
    0.0
    >>> stability_index(LEVELS, np.full(1000, 2.0)) > MAJOR
    True
    """
    if not len(values):
        return 0.0
    inner = np.unique(edges[1:-1])  # of equal ones, all values up to them are in one bin
    last = np.searchsorted(edges[1:-1], inner, side="right")
    expected = np.diff([0.0, *LEVELS[last], 1.0])
    found = np.bincount(np.searchsorted(inner, values), minlength=len(expected)) / len(values)
    expected, found = np.maximum(expected, LEAST), np.maximum(found, LEAST)
    return float(((found - expected) * np.log(found / expected)).sum())


def _quantiles(values: NDArray[Any]) -> Floats:
    known = values[np.isfinite(values)]
    return np.quantile(known, LEVELS) if len(known) else np.zeros(len(LEVELS))


def _percent(which: NDArray[np.bool_]) -> float | None:
    return 100 * float(which.mean()) if len(which) else None
