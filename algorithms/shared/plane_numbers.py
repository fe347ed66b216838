"""Numbers of planes at points, and which of them means none."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from toolbox.data import PointCloud
from toolbox.errors import DataError

Ints = NDArray[np.int64]
SHOWN = 3  # numbers that a message lists


def plane_numbers(cloud: PointCloud, attribute: str) -> Ints:
    """The number of the plane of each point, array of shape (n,).

    Raises
    ------
    DataError
        They are no whole numbers.

    Examples
    --------
    >>> cloud = PointCloud(np.zeros((2, 3)), {"plane_id": [-1.0, 4.0]})
    >>> plane_numbers(cloud, "plane_id")
    array([-1,  4])
    """
    values = cloud[attribute]
    with np.errstate(invalid="ignore"):
        numbers = values.astype(np.int64)
    if bad := int(np.count_nonzero(numbers != values)):
        raise DataError(f"points: {attribute} has {bad} values that are no numbers of planes")
    return numbers


def number_of_none(numbers: Ints, attribute: str, parameter: str) -> int:
    """The number that means no plane: the negative one, or else 0.

    Open3D and scikit-learn count planes and clusters from 0 and have -1 for none.

    Raises
    ------
    DataError
        There are several negative numbers.

    Examples
    --------
    >>> number_of_none(np.array([-1, 0, 0, 1]), "plane_id", "none_id")
    -1
    """
    negative = np.unique(numbers[numbers < 0])
    if len(negative) > 1:
        shown = ", ".join(map(str, negative[:SHOWN])) + (", ..." if len(negative) > SHOWN else "")
        raise DataError(
            f"points: {attribute} has {len(negative)} negative numbers ({shown}); "
            f"say with {parameter} which of them is none"
        )
    return int(negative[0]) if len(negative) else 0
