"""Compiled loops of :mod:`algorithms.shared.plane_fit`."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import kernel


@kernel
def score(first, last, xyz, planes, limit, gains, counts):
    """Fill in the scores of planes: the sum of limit**2 - distance**2 over points within limit.

    Up to a constant that is the cost of MSAC, with the sign turned.

    Parameters
    ----------
    first, last : planes to look at
    xyz : array of shape (3, n)
    planes : array of shape (m, 4), normal and offset; NaN where there is none
    limit : largest distance that supports
    gains, counts : arrays of shape (m,) to fill, sums and numbers of points
    """
    square = limit * limit
    for p in range(first, last):
        nx, ny, nz, offset = planes[p]
        if np.isnan(nx):
            continue
        gain = np.zeros(4)  # four sums, so that the next does not wait for the one before
        count = 0
        for i in range(xyz.shape[1]):
            away = nx * xyz[0, i] + ny * xyz[1, i] + nz * xyz[2, i] - offset
            rest = square - away * away
            if rest >= 0.0:
                gain[i & 3] += rest
                count += 1
        gains[p] = gain.sum()
        counts[p] = count


@kernel
def moments(first, last, xyz, origin, normal, centre, limit, block, sums):
    """Fill in sums over the points within a distance of a plane.

    They are kept with twice the digits of a float, so that the order of points does not matter.

    Parameters
    ----------
    first, last : points to look at
    xyz : array of shape (n, 3)
    origin : of shape (3,), taken off the coordinates
    normal, centre : of the plane, of shape (3,); the centre is measured from the origin
    limit : largest distance
    block : points in a row of sums
    sums : array of shape (blocks, 2, 10), filled: 1, x, y, z, xx, xy, xz, yy, yz, zz from the
        centre, in two parts each
    """
    high, low = np.zeros(10), np.zeros(10)
    for i in range(first, last):
        x = (xyz[i, 0] - origin[0]) - centre[0]
        y = (xyz[i, 1] - origin[1]) - centre[1]
        z = (xyz[i, 2] - origin[2]) - centre[2]
        if abs(normal[0] * x + normal[1] * y + normal[2] * z) > limit:
            continue
        terms = (1.0, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z)
        for k in range(10):
            total = high[k] + terms[k]
            part = total - high[k]
            low[k] += (high[k] - (total - part)) + (terms[k] - part)
            high[k] = total
    sums[first // block, 0] = high
    sums[first // block, 1] = low
