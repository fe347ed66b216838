"""Sorting within kernels."""

from __future__ import annotations

from numba import njit


@njit(cache=True, nogil=True)
def sort_few(values):  # type: ignore[no-untyped-def]
    """Sort a few values in place, by insertion."""
    for i in range(1, len(values)):
        value, j = values[i], i
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value
