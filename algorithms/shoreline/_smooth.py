"""Smoothing of shorelines: the zigzag between single points is taken out.

Each corner of an outline is wrong by up to a point spacing, on its own. The area hardly notices,
but the zigzag makes the outline longer, the more so the denser the points are. So the corners are
moved to the curve q that makes the sum of

    |q - p|^2 + h^4 |q''|^2

along the outline smallest, p being the outline as found and h a length along the shore: a smoothing
spline. It leaves what is longer than some h as it is, and does not draw bends and islands together
as averages do: a circle of radius r loses a share of (h / r)^4 of it.

References
----------
Reinsch, C. H. (1967). Smoothing by spline functions. Numerische Mathematik 10, 177-183.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

HOLD = 1e6  # weight of a corner that must stay
SHORTEST = 0.05  # of h: sides count as no shorter, or the equations lose their digits
WIDTHS = 3.0  # h is at most the mean width of what a ring encloses, divided by this
HALVINGS = 4


def smooth_part(rings: Sequence[Floats], fixed: Sequence[Mask], length: float) -> list[Floats]:
    """Smooth the rings of a polygon, less than asked for if it would cross itself.

    Parameters
    ----------
    rings : arrays of shape (k, 2), closed (the first corner is not repeated): outline, then holes
    fixed : of each ring an array of shape (k,), corners that stay
    length : h, in the unit of the data
    """
    for halving in range(HALVINGS):
        smooth = [
            smooth_ring(ring, stays, length / 2**halving)
            for ring, stays in zip(rings, fixed, strict=True)
        ]
        if shapely.Polygon(smooth[0], smooth[1:]).is_valid:
            return smooth
    return list(rings)


def smooth_ring(ring: Floats, fixed: Mask, length: float) -> Floats:
    """Smooth one closed line, but for fixed vertices; see :func:`smooth_part`."""
    shape = shapely.Polygon(ring)
    h = min(length, 2 * shape.area / shape.length / WIDTHS)
    if h <= 0 or fixed.all():
        return ring
    n = len(ring)
    forth = np.roll(ring, -1, axis=0) - ring
    side = np.maximum(np.hypot(*forth.T), SHORTEST * h)
    share = (side + np.roll(side, 1)) / 2  # of the outline that a corner stands for
    here, after = np.arange(n), np.roll(np.arange(n), -1)
    rows, cols = np.concatenate([here, here]), np.concatenate([here, after])
    ones = np.ones(n)
    step = sparse.csr_matrix((np.concatenate([-ones, ones]), (rows, cols)), (n, n))
    bend = step.T @ sparse.diags(1 / side) @ step  # turns of direction at the corners
    stiff = h**4 * bend.T @ sparse.diags(1 / share) @ bend
    hold = sparse.diags(share * np.where(fixed, HOLD, 1.0))
    move = spsolve((hold + stiff).tocsc(), -(stiff @ (ring - ring[0])))
    return ring + np.where(fixed[:, None], 0.0, move)
