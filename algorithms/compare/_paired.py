"""Whether one of two classifications of the same points is better than the other, or luckier.

References
----------
McNemar, Q. (1947). Note on the sampling error of the difference between correlated proportions or
percentages. Psychometrika 12(2), 153-157.
Edwards, A. L. (1948). Note on the "correction for continuity" in testing the significance of the
difference between correlated proportions. Psychometrika 13(3), 185-187.
Foody, G. M. (2004). Thematic map comparison: evaluating the statistical significance of differences
in classification accuracy. Photogrammetric Engineering & Remote Sensing 70(5), 627-633.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest, chi2

from algorithms.shared.accuracy.blocks import Floats, Tallies, spread
from algorithms.shared.accuracy.confusion import MEASURES, Confusion, class_measures, measures

FEW = 25  # points that one alone has right, below which the test is exact


def mcnemar(first_alone: int, second_alone: int) -> tuple[float, float]:
    """Statistic of McNemar, with Edwards' correction, and its p value.

    With few such points the p value is that of the binomial test.

    Parameters
    ----------
    first_alone, second_alone : points that only the first, only the second classification has right

    Examples
    --------
    >>> statistic, p = mcnemar(121, 59)
    >>> round(statistic, 2), f"{p:.1e}"
    (20.67, '5.5e-06')
    """
    count = first_alone + second_alone
    if not count:
        return 0.0, 1.0
    statistic = max(abs(first_alone - second_alone) - 1, 0) ** 2 / count
    if count < FEW:
        return statistic, float(binomtest(first_alone, count).pvalue)
    return statistic, float(chi2.sf(statistic, 1))


def paired_rows(
    labels: Sequence[str], first: Tallies, second: Tallies, right: Sequence[int], seed: int
) -> Iterator[dict[str, Any]]:
    """Rows of a table: measures of both, their difference with its interval, and McNemar's test.

    Parameters
    ----------
    labels : names of the k classes
    first, second : matrices of the same blocks
    right : points that both, only the first, only the second, and neither has right
    seed : of the draws of blocks
    """
    words = "both right", "the first alone right", "the second alone right", "both wrong"
    for word, number in zip(words, right, strict=True):
        yield _plain(word, number, "points", "")
    statistic, p = mcnemar(right[1], right[2])
    yield _plain("mcnemar", statistic, "1", "chi squared of one degree of freedom")
    text = "chance of so unequal numbers, as if points were independent"
    yield _plain("mcnemar_p", p, "1", text)
    one, other = (Confusion(tuple(labels), of.counts.sum(axis=0)) for of in (first, second))
    pairs = Tallies(np.stack([first.counts, second.counts], axis=1).astype(float), first.square)
    limits = spread(pairs, _differences, seed)
    values = one.measures(), other.measures()
    for name, (unit, meaning) in MEASURES.items():
        pair = values[0][name], values[1][name]
        yield _row(name, unit, pair, limits[name], meaning)
    each = one.class_measures(), other.class_measures()
    for k, label in enumerate(labels):
        for name in ("f1", "iou"):
            low, high = limits[name]
            pair = each[0][name][k], each[1][name][k]
            of = f"of {label.removeprefix('of ')}"  # one is called "of interest"
            yield _row(f"{name} {of}", "%", pair, (low[k], high[k]), "")


def _plain(name: str, value: float, unit: str, meaning: str) -> dict[str, Any]:
    row = {"measure": name, "first": None, "second": None, "difference": value}
    return row | {"low": None, "high": None, "verdict": None, "unit": unit, "meaning": meaning}


def _row(
    name: str,
    unit: str,
    pair: tuple[float | None, float | None],
    interval: tuple[Any, Any],
    meaning: str,
) -> dict[str, Any]:
    first, second = pair
    difference = None if first is None or second is None else second - first
    low, high = (None if np.isnan(v) else float(v) for v in interval)
    row = {"measure": name, "first": first, "second": second, "difference": difference}
    row |= {"low": low, "high": high, "verdict": verdict(low, high)}
    return row | {"unit": unit, "meaning": meaning}


def verdict(low: float | None, high: float | None) -> str:
    """What an interval of a difference says: zero within it may be luck.

    >>> verdict(0.2, 1.4), verdict(-0.2, 1.4), verdict(0.0, 0.0)
    ('differs', 'may be luck', 'the same')
    """
    if low is None or high is None:
        return "not known"
    if low == high == 0:
        return "the same"
    return "differs" if low > 0 or high < 0 else "may be luck"


def _differences(both: Floats) -> dict[str, Floats]:
    """Measures of second minus first, of a stack of pairs of matrices, (m, 2, k, k)."""
    one, other = (measures(of) | class_measures(of) for of in (both[:, 0], both[:, 1]))
    return {name: value - one[name] for name, value in other.items()}
