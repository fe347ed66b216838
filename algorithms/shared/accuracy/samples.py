"""Accuracy and area of classes from a sample that was drawn class by class from a map.

References
----------
Olofsson, P. et al. (2014). Good practices for estimating area and assessing accuracy of land
change. Remote Sensing of Environment 148, 42-57: equations 4 to 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
CONFIDENCE = 1.96  # standard errors, as in the paper


@dataclass(frozen=True)
class Estimate:
    """Values with their standard errors, as shares from 0 to 1.

    Attributes
    ----------
    value, error : numbers, or arrays with one number for each class
    """

    value: Floats
    error: Floats

    @property
    def limits(self) -> tuple[Floats, Floats]:
        """Limits of the 95 % interval."""
        half = CONFIDENCE * self.error
        return np.maximum(self.value - half, 0.0), np.minimum(self.value + half, 1.0)


@dataclass(frozen=True)
class Estimates:
    """What a stratified sample tells of a map of k classes: see the equations of the paper."""

    overall: Estimate
    users: Estimate
    producers: Estimate
    share: Estimate

    @classmethod
    def of(cls, counts: NDArray[np.int64], mapped: Floats) -> Estimates:
        """Estimate from the counts of a sample and the mapped areas of its strata.

        Parameters
        ----------
        counts : array of shape (k, k), a row for each class of the reference
        mapped : array of shape (k,), the area of each class on the map, in any unit

        Returns
        -------
        Estimates
            NaN where a stratum has fewer than two samples.

        Examples
        --------
        The example of section 4.3 of the paper: deforestation, gain, forest, no forest.

        >>> counts = [[66, 0, 1, 2], [0, 55, 0, 1], [5, 8, 153, 9], [4, 12, 11, 313]]
        >>> mapped = np.array([200_000, 150_000, 3_200_000, 6_450_000.0])
        >>> found = Estimates.of(np.array(counts), mapped)
        >>> round(float(found.overall.value), 2), found.users.value.round(2)
        (0.95, array([0.88, 0.73, 0.93, 0.96]))
        """
        n = counts.T.astype(float)  # a row for each class of the map, as in the paper
        size, total = n.sum(axis=1), mapped.sum()
        weight = mapped / total
        with np.errstate(divide="ignore", invalid="ignore"):
            given = np.where(size[:, None] > 0, n / size[:, None], 0.0)
            spread = given * (1 - given) / np.where(size > 1, size - 1, np.nan)[:, None]
            spread[mapped == 0] = 0.0
            users = np.where(size > 0, np.diag(given), np.nan)
            share = weight @ given
            producers = weight * np.diag(given) / share
            variance = np.diag(spread)
            overall = float(weight @ np.diag(given))
            off = mapped[:, None] ** 2 * spread
            own = mapped**2 * (1 - producers) ** 2 * variance
            others = producers**2 * (off.sum(axis=0) - np.diag(off))
            error = np.sqrt(own + others) / (share * total)
        return cls(
            overall=Estimate(np.array(overall), np.sqrt(weight**2 @ variance)),
            users=Estimate(users, np.sqrt(variance)),
            producers=Estimate(producers, error),
            share=Estimate(share, np.sqrt(weight**2 @ spread)),
        )
