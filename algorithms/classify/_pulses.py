"""First and last returns of the same pulse."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from toolbox.data import PointCloud
from toolbox.errors import DataError

How = Literal["gps_time", "order"]
RETURNS = ("return_number", "number_of_returns")
KEYS = ("gps_time", "point_source_id", "scanner_channel", "number_of_returns")
MANY = 0.5  # share of points in pulses with several first or last returns that is too many

Ints = NDArray[np.int64]


def pulses(cloud: PointCloud, how: How) -> tuple[Ints, Ints, Ints]:
    """Returns of the pulses whose first and last return are present, with these two.

    Parameters
    ----------
    cloud : n points
    how : by time, flight line and channel; or by the order of the points, in which the returns of
        a pulse follow each other from the first to the last

    Returns
    -------
    members : array of shape (m,), indices of points
    first, last : arrays of shape (m,), index of the first and last return of the pulse of each

    Raises
    ------
    DataError
        The times do not distinguish pulses.
    """
    number, count = (cloud[name].astype(np.int64) for name in RETURNS)
    some = np.flatnonzero((count >= 2) & (number >= 1) & (number <= count))
    number, count = number[some], count[some]
    pulse = _by_time(cloud, some) if how == "gps_time" else _by_order(number, count)
    total = int(pulse.max()) + 1 if len(pulse) else 0
    is_first, is_last = number == 1, number == count
    firsts, lasts = (np.bincount(pulse[which], minlength=total) for which in (is_first, is_last))
    mixed = ((firsts > 1) | (lasts > 1))[pulse]
    if len(pulse) and mixed.mean() > MANY:
        raise DataError(
            f"points: {np.count_nonzero(mixed)} of {len(pulse)} returns share their gps_time with "
            "other pulses; use pairs order if the points are in the order of the scan"
        )
    whole = ((firsts == 1) & (lasts == 1))[pulse]
    first, last = np.full(total, -1), np.full(total, -1)
    first[pulse[is_first]], last[pulse[is_last]] = some[is_first], some[is_last]
    return some[whole], first[pulse[whole]], last[pulse[whole]]


def _by_time(cloud: PointCloud, some: Ints) -> Ints:
    """Number of the pulse of each point, by its time, flight line, channel and return count."""
    columns = [cloud[name][some] for name in KEYS if name in cloud]
    order = np.lexsort(columns[::-1])
    new = np.zeros(len(some), bool)
    for column in columns:
        new[1:] |= np.diff(column[order].astype(np.float64)) != 0
    pulse = np.empty(len(some), np.int64)
    pulse[order] = np.cumsum(new)
    return pulse


def _by_order(number: Ints, count: Ints) -> Ints:
    """Number of the pulse of each point in file order; a gap in return numbers begins a new one."""
    new = np.ones(len(number), bool)
    new[1:] = (np.diff(number) != 1) | (np.diff(count) != 0)
    return np.cumsum(new) - 1
