"""Classes and numbers of points, from the power line that was found."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox.data import PointCloud

WIRE, TOWER, OTHER = np.uint8(14), np.uint8(15), np.uint8(1)  # ASPRS classes
LINE_CLASSES = (13, 14, 15, 16)  # given anew: wire guard, conductor, tower, connector
DOUBTFUL = 0.25  # confidence of points that are alone beside a wire: half the least of others
POINT_NUMBER = "point_number"
LABEL_NUMBERS = ("wire_id", "span_id", "tower_id")
LABEL_DESCRIPTIONS = {
    "wire_id": "conductor, the same from span to span",
    "span_id": "between two towers",
    "tower_id": "tower or pole",
    "confidence": "0 doubtful to 1 clear",
}

Ints = NDArray[np.int64]


def labelled(
    cloud: PointCloud,
    use: NDArray[np.bool_],
    index: Ints,
    labels: Mapping[str, NDArray[np.generic]],
) -> PointCloud:
    """A cloud of n points with the labels of m of them; all others belong to no line.

    Parameters
    ----------
    use : array of shape (n,), points that take part; all others keep their class
    index : array of shape (m,), of the points that have labels
    labels : wire_id, span_id, tower_id and confidence of these, arrays of shape (m,)
    """
    made = none_labelled(len(cloud)) | {"confidence": use.astype(np.float32)}
    for name, values in made.items():
        values[index] = labels[name]
    old = classes_of(cloud)
    classes = np.where(np.isin(old, LINE_CLASSES) & use, OTHER, old)
    classes[made["tower_id"] > 0] = TOWER
    classes[made["wire_id"] > 0] = WIRE
    return cloud.with_attributes(
        {"classification": classes, **made}, descriptions=LABEL_DESCRIPTIONS
    )


def none_labelled(count: int) -> dict[str, NDArray[Any]]:
    """Labels of points that surely belong to no line."""
    labels: dict[str, NDArray[Any]] = {name: np.zeros(count, np.uint32) for name in LABEL_NUMBERS}
    return labels | {"confidence": np.ones(count, np.float32)}


def classes_of(cloud: PointCloud) -> NDArray[np.uint8]:
    """The classes of points; class 1 where they have no classification."""
    if "classification" in cloud:
        return np.asarray(cloud["classification"], np.uint8)
    return np.full(len(cloud), OTHER)
