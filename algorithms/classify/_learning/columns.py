"""Features of the column of points around each point: nine cells as wide as a radius.

Neighbourhoods in space see a wall or a hedge; the column over a place says whether it belongs to
a roof above it, or to a tree that lets pulses through to the ground. Heights are those above the
ground, and sums are of whole numbers, so that the order of the points does not matter.

References
----------
Chehata, N., Guo, L. and Mallet, C. (2009). Airborne lidar feature selection for urban
classification using random forests. ISPRS Archives 38(3/W8), 207-212: heights and echoes in
cylinders.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from algorithms.classify._learning import kernels
from toolbox.errors import DataError

BORDER = (
    0.00037  # metres: borders lie here, where no coordinate does that is written in millimetres
)
MOST_CELLS = 1 << 26  # of the rectangle around the points: 5 GB
STEPS = 1024.0  # of a metre, in which heights are summed up
SHARES = float(1 << 20)  # steps in which surface variations are summed up
SHAPELESS = 0.2  # surface variation of a point without a neighbourhood: that of leaves
FLAT = 0.02  # surface variation up to which points lie on a plane: 2 cm across 1 m
HIGH = 1.5  # metres above the ground, of what may be a roof
NAMES = (
    "above_lowest",
    "below_highest",
    "top_height",
    "top_spread",
    "ground_share",
    "passing_share",
    "mean_height",
    "height_spread",
    "above_mean",
    "mean_intensity",
    "intensity_spread",
    "mean_variation",
    "flat_share",
    "below_top",
)
"""Those that there are; see :func:`features`."""
EXTREMES = ("above_lowest", "below_highest")  # need neither heights nor sums

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Measured:
    """What columns are made of.

    Attributes
    ----------
    xyz : array of shape (n, 3), metres
    height : above the ground, metres; NaN where it is not known
    ground : True for ground
    passing : True for returns after which the pulse went on
    intensity : array of shape (n,), zeros if there is none
    variation : surface variation of the neighbourhood in space; NaN where it has no shape
    """

    xyz: Floats
    height: Floats
    ground: NDArray[np.bool_]
    passing: NDArray[np.bool_]
    intensity: Floats
    variation: Floats


def features(points: Measured, radius: float, names: Sequence[str] = NAMES) -> dict[str, Singles]:
    """Some features of NAMES, arrays of shape (n,); NaN where a column has none.

    above_lowest and below_highest are metres from the lowest and highest point of the nine cells,
    top_height the height of their highest one and top_spread the standard deviation of the highest
    of each cell. ground_share is the share of ground among all; of the points above it are
    passing_share, the share of returns after which the pulse went on, mean_height and
    height_spread, mean and standard deviation of their heights, and above_mean, how far the point
    is above that mean; mean_variation is their mean surface variation, and flat_share the share of
    those that lie on planes among those as high as a roof may be. mean_intensity and
    intensity_spread are of all points. below_top is how far the highest point of the point's own
    cell is above it.

    Raises
    ------
    DataError
        The rectangle around the points has more than MOST_CELLS cells.
    """
    cell = np.floor((points.xyz[:, :2] + BORDER) / radius).astype(np.int64)
    cell -= cell.min(axis=0) - 1
    rows, cols = (int(size) for size in cell.max(axis=0) + 2)
    if rows * cols > MOST_CELLS:
        raise DataError("points: they extend too far for these radii: remove stray points")
    place = cell[:, 0] * cols + cell[:, 1]
    found = _extremes(points.xyz[:, 2], place, rows, cols)
    if any(name not in EXTREMES for name in names):
        found |= _sums(points, place, rows, cols)
    return {name: found[name] for name in names}


def _extremes(z: Floats, place: Ints, rows: int, cols: int) -> dict[str, Singles]:
    """How far points are from the lowest and the highest one of nine cells."""
    low, high = np.full((rows, cols), np.inf), np.full((rows, cols), -np.inf)
    np.minimum.at(low.reshape(-1), place, z)
    np.maximum.at(high.reshape(-1), place, z)
    low, high = minimum_filter(low, 3), maximum_filter(high, 3)
    found = z - low.reshape(-1)[place], high.reshape(-1)[place] - z
    return {name: away.astype(np.float32) for name, away in zip(EXTREMES, found, strict=True)}


def _sums(points: Measured, place: Ints, rows: int, cols: int) -> dict[str, Singles]:
    """What nine cells have in sum."""
    names = [name for name in NAMES if name not in EXTREMES]
    found = np.empty((len(names), len(place)), np.float32)
    steps = np.rint(np.where(np.isfinite(points.height), points.height, 0.0) * STEPS)
    bent = np.where(np.isnan(points.variation), SHAPELESS, points.variation)
    kernels.columns(
        place,
        cols,
        rows,
        points.xyz[:, 2],
        steps.astype(np.int64),
        points.ground,
        points.passing,
        np.rint(points.intensity).astype(np.int64),
        np.rint(bent * SHARES).astype(np.int64),
        steps > HIGH * STEPS,
        points.variation < FLAT,
        found,
    )
    for name in ("top_height", "top_spread", "mean_height", "height_spread", "above_mean"):
        found[names.index(name)] /= np.float32(STEPS)
    found[names.index("mean_variation")] /= np.float32(SHARES)
    return dict(zip(names, found, strict=True))
