"""What numbers of single precision have done to coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NEAR, MANY = 0.2, 20  # of a step; of so many points by chance not one in 10^7 clouds is as near
COARSE = 1e-3  # in the unit of the data: smaller steps are below what scanners measure


def rounded_to_single(xyz: NDArray[np.float64]) -> str | None:
    """What single precision has done to coordinates, as a clause; None where nothing is seen.

    Numbers of 32 bits hold 24 binary digits. Programs that keep coordinates of a map in them round
    these to steps such as 0.03125, and write them out with as many digits as they like.

    Parameters
    ----------
    xyz : array of shape (n, 3)

    Examples
    --------
    >>> scan = np.random.default_rng(0).uniform(0, 20, (99, 3)) + [500_000, 4_500_000, 100]
    >>> rounded_to_single(scan.astype(np.float32).astype(float))
    'its coordinates were rounded to single precision, x to 0.03125, y to 0.5'
    >>> rounded_to_single(scan.astype(np.float32).astype(float).round(2)) is None
    False
    >>> rounded_to_single(scan.round(2)) is None
    True
    """
    steps = {}
    for name, values in zip("xyz", xyz.T, strict=True):
        with np.errstate(over="ignore"):
            single = values.astype(np.float32)
        off = np.abs(values - single)
        near = len(values) >= MANY and bool((off < NEAR * np.spacing(np.abs(single))).all())
        if len(values) and (near or not off.any()):  # near, where a text has fewer digits
            step = float(np.spacing(np.abs(single).max()))
            # Whole and quarter steps are those of many a regular grid, in any precision.
            steps[name] = step, bool((4 * single.astype(float) % 1).any())
    if not any(fine and step >= COARSE for step, fine in steps.values()):
        return None
    told = [f"{name} to {step:g}" for name, (step, _) in steps.items() if step >= COARSE]
    return f"its coordinates were rounded to single precision, {', '.join(told)}"
