"""The arrays of point clouds: checked, and such that nobody can change them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from toolbox.errors import DataError


def coordinates(xyz: ArrayLike) -> NDArray[np.float64]:
    """A copy that nobody can change, or an array of its own that is so already."""
    given = np.asarray(xyz, np.float64)
    fixed = given is xyz and given.base is None and not given.flags.writeable
    found = given if fixed and given.flags.c_contiguous else np.array(given, order="C", ndmin=2)
    if found.size == 0:
        found = found.reshape(0, 3)
    if found.ndim != 2 or found.shape[1] != 3:
        raise DataError(f"coordinates must have the shape (n, 3), got {found.shape}")
    return frozen(found)


def columns_of(attributes: Mapping[str, ArrayLike], size: int) -> dict[str, NDArray[Any]]:
    """Read-only copies of attributes, checked."""
    columns = {}
    for name, values in attributes.items():
        column = np.array(values, order="C")
        if name in ("x", "y", "z", "X", "Y", "Z"):
            raise DataError(f"{name!r} is a coordinate, not an attribute; see with_xyz")
        if column.dtype.kind not in "biuf":
            raise DataError(f"attribute {name!r} must be numbers, got {column.dtype}")
        if column.shape[:1] != (size,) or column.ndim > 2:
            raise DataError(f"attribute {name!r} must have {size} values, got {column.shape}")
        columns[name] = frozen(column)
    return columns


def indices(which: NDArray[Any], size: int) -> NDArray[np.intp]:
    """The indices that a mask selects, or the given indices."""
    # An array of bytes is more likely a mask that lost its type than indices up to 255.
    if which.size and (which.dtype.kind not in "biu" or which.dtype in (np.uint8, np.int8)):
        raise DataError(f"points are selected by a mask or by indices, not by {which.dtype}")
    if which.dtype.kind != "b":
        return which.astype(np.intp)
    if which.shape != (size,):
        raise DataError(f"a mask of shape {which.shape} does not fit a cloud of {size} points")
    return np.flatnonzero(which)


def plain(array: NDArray[Any]) -> NDArray[Any]:
    """Point records as rows of bytes, which numpy copies faster than their many fields."""
    if array.dtype.names is None:
        return array
    return array.view(np.uint8).reshape(len(array), array.itemsize)


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """The array itself, which from now on nobody can change."""
    array.flags.writeable = False
    return array
