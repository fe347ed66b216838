"""Bins of features between which boosted trees may branch.

References
----------
Ke, G. et al. (2017). LightGBM: a highly efficient gradient boosting decision tree. NIPS, 3146-3154:
histograms of bins in place of sorted values.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MOST = 255  # bins of a feature, which is the most that scikit-learn has

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Rows = NDArray[np.float32]


@dataclass(frozen=True)
class Bins:
    """Features in steps between which trees may branch: for all models of a training the same.

    Attributes
    ----------
    edges : of each feature, the last value of each bin but the last one, rising
    number : of the bin of each point, array of shape (n, f); NaN where it lacks the feature
    """

    edges: tuple[Floats, ...]
    number: Rows

    @classmethod
    def of(cls, data: Rows, weight: Floats) -> Bins:
        """Bins between weighted quantiles of features of shape (n, f), without labels."""
        edges = tuple(_quantiles(column, weight) for column in data.T)
        number = np.empty(data.shape, np.float32)
        for k, (own, column) in enumerate(zip(edges, data.T, strict=True)):
            number[:, k] = np.searchsorted(own, column)
        number[np.isnan(data)] = np.nan
        return cls(edges, number)

    def threshold(self, feature: Ints, number: Floats) -> Floats:
        """Values of features up to which points go left where bins up to `number` do."""
        found = np.zeros(len(feature))
        for k, own in enumerate(self.edges):
            asks = feature == k
            found[asks] = np.append(own, np.inf)[
                np.floor(number[asks]).clip(max=len(own)).astype(int)
            ]
        return found


def _quantiles(column: NDArray[np.float32], weight: Floats) -> Floats:
    """Values that cut those of a feature into MOST parts of the same weight, or fewer."""
    known = ~np.isnan(column)
    values, weight = column[known].astype(float), weight[known]
    if not len(values):
        return np.zeros(0)
    order = np.argsort(values, kind="stable")
    values, held = values[order], np.cumsum(weight[order])
    if len(distinct := np.unique(values)) <= MOST:
        return np.asarray(distinct[:-1] + np.diff(distinct) / 2)
    wanted = held[-1] * np.arange(1, MOST) / MOST
    return np.unique(values[np.searchsorted(held, wanted).clip(max=len(values) - 1)])
