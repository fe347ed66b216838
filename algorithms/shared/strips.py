"""Flight lines of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from toolbox.data import PointCloud


def strips_of(
    cloud: PointCloud, which: NDArray[np.integer] | NDArray[np.bool_]
) -> NDArray[np.uint16]:
    """The flight line of some points, by point_source_id; 0 for all where it is not known.

    Parameters
    ----------
    which : indices of the n points, or a value for each point of the cloud, n of them true

    Returns
    -------
    array of shape (n,)

    Examples
    --------
    >>> cloud = PointCloud(np.zeros((3, 3)), {"point_source_id": np.array([4, 4, 7], np.uint16)})
    >>> strips_of(cloud, np.array([0, 2]))
    array([4, 7], dtype=uint16)
    """
    if "point_source_id" in cloud:
        return np.asarray(cloud["point_source_id"][which], np.uint16)
    return np.zeros(len(cloud), np.uint16)[which]
