"""Heights of points above the ground, and the elevation of the ground below a support."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.corridor._extraction.labels import classes_of
from algorithms.corridor._settings import SETTINGS
from algorithms.shared.ground import may_be_ground
from algorithms.shared.heights import HEIGHT, given_heights
from algorithms.shared.terrain import find_terrain, height_above
from toolbox.context import Context
from toolbox.data import PointCloud
from toolbox.errors import DataError

Floats = NDArray[np.float64]


def heights_of(
    cloud: PointCloud, use: NDArray[np.bool_], ground_classes: Sequence[int] | None, ctx: Context
) -> Floats:
    """Heights of the n points above the ground in metres, shape (n,); NaN where not known.

    Parameters
    ----------
    use : array of shape (n,), points that take part
    ground_classes : classes that are ground; None to take the heights that the points have, or to
        find the ground

    Raises
    ------
    DataError
        No point is of the ground classes.
    """
    if HEIGHT in cloud and ground_classes is None:
        return given_heights(cloud)
    ground = use & may_be_ground(cloud, "last")
    if ground_classes is not None:
        ground = use & np.isin(classes_of(cloud), ground_classes)
        if use.any() and not ground.any():
            raise DataError(f"points: none is of the ground_classes {ground_classes}")
    if not ground.any():
        return np.full(len(cloud), np.nan)
    ground &= accompanied(cloud.xyz, cloud.metre)
    bare = cloud.xyz[ground]
    bare.flags.writeable = False  # kernels would be compiled for writable arrays once more
    known = ground_classes is not None
    return height_above(cloud.xyz, find_terrain(bare, known=known, metre=cloud.metre, ctx=ctx))


def accompanied(xyz: Floats, metre: float) -> NDArray[np.bool_]:
    """False for isolated points if most are not: low outliers would pull the terrain down.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    metre : length of one metre in the unit of the points
    """
    cell = np.floor(
        (xyz - xyz.min(axis=0))
        / (
            np.array(
                (
                    SETTINGS.points.company_side,
                    SETTINGS.points.company_side,
                    SETTINGS.points.company_side / 2,
                )
            )
            * metre
        )
    ).astype(np.int64)
    size = cell.max(axis=0) + 1
    key = (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
    _, which, count = np.unique(key, return_inverse=True, return_counts=True)
    found = count[which] > 1
    return found if found.mean() > SETTINGS.points.company_share else np.ones(len(xyz), bool)


def elevation(xyz: Floats, height: Floats) -> Callable[[float, float], float]:
    """Function for the ground elevation at a position, by a plane through points near by.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    height : array of shape (n,), above the ground, metres; NaN where not known
    """
    low = np.flatnonzero(height <= SETTINGS.points.off_ground)
    low = low if len(low) else np.flatnonzero(np.isfinite(height))
    xy, ground = xyz[low, :2], xyz[low, 2] - height[low]
    tree = cKDTree(xy)

    def at(x: float, y: float) -> float:
        near = np.asarray(
            tree.query((x, y), k=range(1, min(SETTINGS.points.plane_points, len(low)) + 1))[1]
        )
        middle = xy[near].mean(axis=0)
        sides = np.column_stack([xy[near] - middle, np.ones(len(near))])
        slope = np.linalg.lstsq(sides, ground[near], rcond=0.01)[0]
        return float(np.append((x, y) - middle, 1.0) @ slope)

    return at
