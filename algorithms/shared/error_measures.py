"""Measures of errors: bias, RMSE, NMAD, quantiles.

References
----------
Höhle, J. and Höhle, M. (2009). Accuracy assessment of digital elevation models by means of robust
statistical methods. ISPRS Journal 64(4), 398-406: median, NMAD and quantiles.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

NORMAL = 1.4826  # times the MAD is the standard deviation, if errors are normal
FAR = 3.0  # NMAD from the median: errors that should be checked

MEANING: Mapping[str, str] = {
    "count": "cells or points compared",
    "bias": "mean of surface minus reference",
    "std": "standard deviation about the bias",
    "rmse": "root mean square",
    "mae": "mean size, whatever the sign",
    "median": "half of the errors are lower",
    "mad": "median of the distances from the median",
    "nmad": "1.4826 MAD: the standard deviation of normal errors, whatever outliers there are",
    "le90": "90 % of the errors are no larger, as found",
    "le95": "95 % of the errors are no larger, as found",
    "min": "lowest",
    "p5": "5 % are lower",
    "p25": "25 % are lower",
    "p75": "75 % are lower",
    "p95": "95 % are lower",
    "max": "highest",
    "far": "farther than 3 NMAD from the median: look at them, nothing was left out",
}
COUNTS = ("count", "far")

Array = NDArray[np.float64]


def measures(error: Array) -> dict[str, Any]:
    """The measures of `MEANING`, in the unit of the errors; the same for any order of them.

    Parameters
    ----------
    error : array of shape (n,), at least one

    Examples
    --------
    >>> found = measures(np.array([-0.1, 0.0, 0.4]))
    >>> round(float(found["bias"]), 3), round(float(found["rmse"]), 3)
    (0.1, 0.238)
    """
    error = np.sort(error)
    size, median = np.sort(np.abs(error)), float(np.median(error))
    deviation = np.abs(error - median)
    nmad = NORMAL * float(np.median(deviation))
    le90, le95 = np.quantile(size, (0.9, 0.95))
    p5, p25, p75, p95 = np.quantile(error, (0.05, 0.25, 0.75, 0.95))
    found = {
        "count": len(error),
        "bias": error.mean(),
        "std": error.std(ddof=1) if len(error) > 1 else None,
        "rmse": np.sqrt(np.mean(error**2)),
        "mae": size.mean(),
        "median": median,
        "mad": nmad / NORMAL,
        "nmad": nmad,
        "le90": le90,
        "le95": le95,
        "min": error[0],
        "p5": p5,
        "p25": p25,
        "p75": p75,
        "p95": p95,
        "max": error[-1],
        "far": int(np.count_nonzero(deviation > FAR * nmad)),
    }
    return {n: v if v is None or n in COUNTS else float(v) for n, v in found.items()}
