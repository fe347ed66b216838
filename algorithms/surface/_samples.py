"""The points that a surface is made of."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from algorithms.points.filter import Returns, return_mask
from toolbox.data import PointCloud
from toolbox.errors import DataError
from toolbox.expression import Expression
from toolbox.values import Attribute, ClassList


def choice_problems(
    cloud: PointCloud, classes: ClassList | None, returns: Returns
) -> Iterator[tuple[str, str]]:
    """What the cloud lacks for the choice."""
    if classes and "classification" not in cloud:
        yield "classes", f"{cloud.name} has no classification"
    if returns != "all" and not {"return_number", "number_of_returns"} <= {*cloud.names}:
        yield "returns", f"{cloud.name} has no return numbers"


def chosen(
    cloud: PointCloud, classes: ClassList | None, returns: Returns, where: Expression | None
) -> NDArray[np.bool_]:
    """True for the points that meet all three; array of shape (n,)."""
    keep = np.ones(len(cloud), bool)
    if classes:
        keep &= np.isin(cloud["classification"], classes)
    if returns != "all":
        keep &= return_mask(cloud["return_number"], cloud["number_of_returns"], returns)
    if where:
        keep &= where.mask({name: cloud[name] for name in where.names}, len(cloud))
    return keep


def samples(
    cloud: PointCloud, attribute: Attribute, keep: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places of shape (n, 2) and values of shape (n,) of the points of a mask.

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
    """Why no point was chosen."""
    if len(cloud) and classes and not np.isin(cloud["classification"], classes).any():
        return f"points: none is of class {classes}; classify them first"
    return "points: there are none to grid"
