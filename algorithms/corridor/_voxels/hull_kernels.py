"""Points in tetrahedra."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels.compiling import kernel

Floats = NDArray[np.float64]


@kernel
def inside_any(
    xyz: Floats,
    corner: Floats,
    inverse: Floats,
    low: Floats,
    high: Floats,
    found: NDArray[np.bool_],
) -> None:
    """Mark the points in at least one tetrahedron, with its faces.

    Parameters
    ----------
    xyz : array of shape (n, 3), in ascending order of x
    corner : array of shape (m, 3), the first corner of each tetrahedron
    inverse : array of shape (m, 3, 3), of the matrix whose columns are the edges from there
    low, high : arrays of shape (m, 3), bounds of each
    found : array of shape (n,), set True for points inside
    """
    for k in range(len(corner)):
        first = np.searchsorted(xyz[:, 0], low[k, 0])
        for i in range(first, len(xyz)):
            x, y, z = xyz[i]
            if x > high[k, 0]:
                break
            if found[i] or y < low[k, 1] or y > high[k, 1] or z < low[k, 2] or z > high[k, 2]:
                continue
            dx, dy, dz = x - corner[k, 0], y - corner[k, 1], z - corner[k, 2]
            total, within = 0.0, True
            for row in range(3):
                a, b, c = inverse[k, row]
                share = a * dx + b * dy + c * dz
                within = within and share >= 0.0
                total += share
            found[i] = within and total <= 1.0
