"""Whether the heights of a surface and a reference can be of one unit and one height system."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.error_measures import NORMAL

UNITS = {  # how many of the one are one of the other
    "feet beside metres": 1 / 0.3048,
    "centimetres beside metres": 100.0,
    "millimetres beside metres": 1000.0,
}
ALIKE = 0.01  # share by which a ratio may miss that of two units; metres and yards differ by 9 %
# An offset is one of the height system where it is so many times the scatter, and as many metres:
# national systems differ by decimetres and ellipsoid and geoid by up to 106 m, while ground that
# rises, or is built up, by a metre does not do so alike everywhere.
TIMES, LEAST = 10.0, 1.0

Floats = NDArray[np.float64]


def height_mismatch(error: Floats, surface: Floats, metre: float) -> str | None:
    """What keeps heights from being comparable, as a clause; None where nothing is seen.

    Parameters
    ----------
    error, surface : arrays of shape (n,), surface minus reference, and the surface; finite
    metre : length of one metre in their unit

    Examples
    --------
    >>> ground = np.linspace(200.0, 260.0, 500)
    >>> height_mismatch(np.full(500, 44.2), ground, 1.0)
    'lies 44.20 m above the reference (median; NMAD 0.000 m): are they in one height system?'
    >>> height_mismatch(ground - ground / 0.3048, ground, 1.0)
    'has 0.305 times the heights of the reference: feet beside metres?'
    >>> height_mismatch(np.sin(ground), ground, 1.0) is None
    True
    """
    reference = surface - error
    for name, ratio in UNITS.items():
        for found in (ratio, 1 / ratio):
            if _is_multiple(surface, reference, found):
                return f"has {found:.3g} times the heights of the reference: {name}?"
    middle = float(np.median(error)) / metre
    nmad = NORMAL * float(np.median(np.abs(error / metre - middle)))
    if abs(middle) < max(LEAST, TIMES * nmad):
        return None
    side = "above" if middle > 0 else "below"
    return (
        f"lies {abs(middle):.2f} m {side} the reference (median; NMAD {nmad:.3f} m): "
        "are they in one height system?"
    )


def far_apart(error: Floats, median: float, nmad: float, least: float) -> NDArray[np.intp]:
    """The numbers of errors that are no part of the distribution of the others, the largest first.

    Normal errors never are ten times their scatter from the middle; a point that was read, typed
    or surveyed wrong is.

    Parameters
    ----------
    error : array of shape (n,)
    median, nmad : of them, see `algorithms.shared.error_measures`
    least : from the median, in the unit of the errors, below which none is far

    Examples
    --------
    >>> far_apart(np.array([0.01, -0.02, 0.0, 0.02, 3.0, -0.01]), 0.005, 0.022, 0.1).tolist()
    [4]
    """
    off = np.abs(error - median)
    far = np.flatnonzero(off > max(least, TIMES * nmad))
    return far[np.argsort(-off[far], kind="stable")]


def _is_multiple(one: Floats, other: Floats, ratio: float) -> bool:
    """Whether both the middle and the spread of heights are a number of times those of others."""
    low, middle, high = np.quantile(one, (0.05, 0.5, 0.95))
    under, centre, over = ratio * np.quantile(other, (0.05, 0.5, 0.95))
    spread, size = over - under, abs(centre)
    close = abs(middle - centre) <= ALIKE * size and abs(high - low - spread) <= ALIKE * spread
    return bool(close and size > 0 and spread > 0)
