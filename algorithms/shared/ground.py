"""What all ground filters share: which points take part, and what becomes of their classes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from toolbox.data import PointCloud

GROUND, OTHER = 2, 1  # ASPRS classes

Returns = Literal["last", "all"]
Mask = NDArray[np.bool_]


def taking_part(cloud: PointCloud, ignore: Sequence[int] | None) -> Mask:
    """True for the points that a filter looks at: neither of an ignored class nor withheld.

    Returns
    -------
    array of shape (n,)
    """
    part = np.ones(len(cloud), bool)
    if ignore and "classification" in cloud:
        part &= ~np.isin(cloud["classification"], ignore)
    if "withheld" in cloud:
        part &= cloud["withheld"] == 0
    return part


def may_be_ground(cloud: PointCloud, returns: Returns) -> Mask:
    """True for last and only returns, or for all.

    A pulse goes on to the ground after all its other returns. Points without return numbers, or
    with zeros in them, may all be last returns.

    Returns
    -------
    array of shape (n,)
    """
    if returns == "all" or not {"return_number", "number_of_returns"} <= set(cloud.names):
        return np.ones(len(cloud), bool)
    number, count = cloud["return_number"], cloud["number_of_returns"]
    last: Mask = (number == 0) | (number >= count)
    return last


def classified(cloud: PointCloud, ground: Mask, part: Mask, *, keep_classes: bool) -> PointCloud:
    """The cloud with class 2 on ground and 1 elsewhere.

    Parameters
    ----------
    cloud : n points
    ground : array of shape (n,)
    part : array of shape (n,), see :func:`taking_part`; all other points keep their class
    keep_classes : let points that are not ground keep their class, unless it was 2
    """
    old = cloud["classification"] if "classification" in cloud else np.zeros(len(cloud), "u1")
    classes = np.where(ground, GROUND, OTHER)
    if keep_classes:
        classes = np.where(ground | (old == GROUND), classes, old)
    return cloud.with_attributes({"classification": np.where(part, classes, old).astype(np.uint8)})
