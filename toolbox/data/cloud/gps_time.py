"""The days that GPS times are of."""

from __future__ import annotations

from datetime import UTC, date, datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

_EPOCH = datetime(1980, 1, 6, tzinfo=UTC) - timedelta(seconds=18)  # leap seconds since 2017
_FIRST_TIME = -7.0e8  # adjusted standard GPS time, in July 1989: before there were such surveys


def days_of(times: NDArray[Any]) -> tuple[date, date] | None:
    """First and last day of adjusted standard GPS times; None if none is a time of a survey."""
    known = times[np.isfinite(times) & (times > _FIRST_TIME)]
    if not len(known):
        return None
    low, high = (_EPOCH + timedelta(seconds=float(t) + 1e9) for t in (known.min(), known.max()))
    return low.date(), high.date()
