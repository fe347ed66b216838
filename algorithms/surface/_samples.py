"""The points from which a surface is made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.ground import is_withheld
from toolbox.data import PointCloud
from toolbox.declare import Attribute, ClassList
from toolbox.errors import DataError


def samples(
    cloud: PointCloud, attribute: Attribute, keep: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions of shape (n, 2) and values of shape (n,) of the points of a mask.

    Raises
    ------
    DataError
        A value is not finite.
    """
    xy, values = cloud.xyz[:, :2], np.asarray(cloud[attribute], np.float64)
    if not keep.all():
        xy, values = xy[keep], values[keep]
    if not np.isfinite(values).all():
        raise DataError(f"points: attribute {attribute!r} holds values that are not finite")
    return xy, values


def why_none(cloud: PointCloud, classes: ClassList | None) -> str:
    """Reason why no point was chosen."""
    if len(cloud) and classes and not np.isin(cloud["classification"], classes).any():
        return f"points: none is of class {classes}; classify them first"
    if withheld := int(np.count_nonzero(is_withheld(cloud))):
        return f"points: there are none to grid besides {withheld} flagged as withheld"
    return "points: there are none to grid"
