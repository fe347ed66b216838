"""NDVI from two bands, and the threshold above which it means vegetation.

References
----------
Rouse, J. W. et al. (1974). Monitoring vegetation systems in the Great Plains with ERTS. Third ERTS
Symposium, NASA SP-351, 309-317.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.otsu import otsu_threshold
from toolbox.data import Raster

Floats = NDArray[np.float64]


def ndvi(nir: NDArray[Any], red: NDArray[Any]) -> Floats:
    """NDVI = (NIR - red) / (NIR + red), Rouse et al. (1974).

    Parameters
    ----------
    nir, red : arrays of one shape and any type, NaN where there is nothing

    Returns
    -------
    array of that shape
        From -1 to 1; NaN where a band is NaN, infinite or below 0, or both are 0.
    """
    nir, red = np.asarray(nir, np.float64), np.asarray(red, np.float64)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        found = (nir - red) / (nir + red)
        found[~((nir >= 0) & (red >= 0))] = np.nan
    return np.asarray(found)


def chosen_threshold(
    values: Floats, threshold: float | Literal["otsu"], all_of_them: str
) -> float | None:
    """The threshold that is given, or that by Otsu's method; None if there are no values for it.

    Raises
    ------
    DataError
        All values are equal.
    """
    if threshold != "otsu":
        return float(threshold)
    return otsu_threshold(values, all_of_them) if len(values) else None


def named(raster: Raster) -> str:
    """Name of an image for messages."""
    return raster.name or "the image"
