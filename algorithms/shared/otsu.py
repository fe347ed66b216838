"""Otsu's threshold between two groups of values.

References
----------
Otsu, N. (1979). A threshold selection method from gray-level histograms. IEEE Transactions on
Systems, Man, and Cybernetics 9(1), 62-66.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox.errors import DataError


def otsu_threshold(values: NDArray[Any], all_of_them: str = "all values") -> float:
    """The value that splits a histogram into two classes with the largest variance between them.

    Parameters
    ----------
    values : array of shape (n,); every distinct value is a bin of its own
    all_of_them : what an error calls the values

    Returns
    -------
    float
        The lowest value of the upper class: ``values >= threshold`` is that class.

    Raises
    ------
    DataError
        All values are equal.

    Notes
    -----
    Otsu (1979), equation 14: the variance between the classes is w0 * w1 * (m1 - m0)**2.

    Examples
    --------
    >>> otsu_threshold(np.array([1, 2, 2, 9, 10]))
    9.0
    """
    level, count = np.unique(values, return_counts=True)
    if len(level) < 2:
        raise DataError(f"{all_of_them} are {level[0]:g}, which cannot be split in two")
    below = np.cumsum(count)[:-1].astype(np.float64)
    total = np.cumsum(count * level.astype(np.float64))
    above = len(values) - below
    gap = (total[-1] - total[:-1]) / above - total[:-1] / below
    return float(level[int(np.argmax(below * above * gap**2)) + 1])
