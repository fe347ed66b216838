"""Compiled loops of robust interpolation; see :mod:`algorithms.ground.robust_interpolation`.

A surface is an array of heights in the middle of its cells, NaN where it is unknown, and its
`place`: (left, top, cell), the whole cells between the origin of the coordinates and its
north-west corner. So a position in the terrain has the same numbers in every tile.
"""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel

WINDOW = 2  # cells on each side of a node whose points it looks at
SUPPORT = 3.0  # cells: the influence of a point has faded to nothing
NUGGET = 0.02  # weight of the trend against that of one good point in the middle of the window
TILT_NUGGET = 0.1  # the same for the slope of the plane, per cell
TRUNCATION = 3.0  # half widths above the shift beyond which the weight is 0
STEEPEST = 1.0  # slope that still widens a threshold, rise over run


@helper
def _height_and_slope(surface, place, x, y):
    """Height at (x, y) from the known nodes around it, bilinear, and the slope as rise over run."""
    left, top, cell = place
    across, down = x / cell - left - 0.5, top - y / cell - 0.5
    col, row = int(np.floor(across)), int(np.floor(down))
    across, down = across - col, down - row
    weights, heights, eastward, southward = 0.0, 0.0, 0.0, 0.0
    known = 0
    for i in range(2):
        for j in range(2):
            if not (0 <= row + i < surface.shape[0] and 0 <= col + j < surface.shape[1]):
                continue
            height = surface[row + i, col + j]
            if np.isnan(height):
                continue
            along, beside = (across if j else 1 - across), (down if i else 1 - down)
            known += 1
            weights += along * beside
            heights += along * beside * height
            eastward += beside * (height if j else -height)
            southward += along * (height if i else -height)
    if weights <= 0.0:
        return np.nan, 0.0
    slope = np.hypot(eastward, southward) / cell if known == 4 else 0.0
    return heights / weights, slope


@kernel
def residuals(first, last, xyz, surface, place, residual, rise):
    """Fill in heights of points above the surface, and the rise of the surface over one cell."""
    for i in range(first, last):
        height, slope = _height_and_slope(surface, place, xyz[i, 0], xyz[i, 1])
        residual[i] = xyz[i, 2] - height
        rise[i] = min(slope, STEEPEST) * place[2]


@kernel
def interpolate(
    first, last, xyz, lowest, offset, place, trend, trend_place, half, relief, depth, rounds, out
):
    """Fill in the heights of nodes in the rows first..last: trend plus a robust plane above it.

    `lowest` has the index of a point for each cell or -1, `offset` is its height above the
    trend. An empty `trend` stands for none; then nodes without points near them are unknown.
    """
    left, top, cell = place
    with_trend = trend.size > 0
    points = np.empty((4, (2 * WINDOW + 1) ** 2))
    residual = np.empty(points.shape[1])
    for row in range(first, last):
        y = (top - row - 0.5) * cell
        for col in range(lowest.shape[1]):
            x = (left + col + 0.5) * cell
            height, slope = 0.0, 0.0
            if with_trend:
                height, slope = _height_and_slope(trend, trend_place, x, y)
            count = 0
            if not np.isnan(height):
                count = _window(xyz, lowest, offset, row, col, x, y, cell, points)
            if count > 0:
                wide = half + relief * (1.0 + 2.0 * min(slope, STEEPEST)) * cell
                nugget = NUGGET if with_trend else 0.0
                height += _robust_plane(points, count, residual, wide, depth, nugget, rounds)
            elif not with_trend:
                height = np.nan
            out[row, col] = height


@helper
def _window(xyz, lowest, offset, row, col, x, y, cell, points):
    """Collect the points around a node at (x, y) in the columns of `points`; their number.

    The rows of `points`: x and y from the node in cells, height above the trend, and a weight
    that fades with the distance.
    """
    rows, cols = lowest.shape
    count = 0
    for r in range(max(0, row - WINDOW), min(rows, row + WINDOW + 1)):
        for c in range(max(0, col - WINDOW), min(cols, col + WINDOW + 1)):
            i = lowest[r, c]
            if i < 0:
                continue
            dx, dy = (xyz[i, 0] - x) / cell, (xyz[i, 1] - y) / cell
            near = 1.0 - (dx * dx + dy * dy) / SUPPORT**2
            if near > 0.0:
                points[0, count], points[1, count] = dx, dy
                points[2, count], points[3, count] = offset[r, c], near * near
                count += 1
    return count


@helper
def _robust_plane(points, count, residual, half, depth, nugget, rounds):
    """Height at the node of a robust plane through the lower points; see :func:`_window`.

    Without a nugget there is no trend to begin with, so all points start out equal.
    """
    x, y, z, weight = points
    a, b, c = 0.0, 0.0, 0.0
    for k in range(rounds):
        for i in range(count):
            residual[i] = z[i] - (a + b * x[i] + c * y[i])
        shift = _shift(residual, weight, count, depth)
        m, mx, my, mz = nugget, 0.0, 0.0, 0.0
        mxx, mxy, myy, mxz, myz = TILT_NUGGET, 0.0, TILT_NUGGET, 0.0, 0.0
        for i in range(count):
            p = weight[i]
            if k > 0 or nugget > 0.0:
                p *= robust_weight(residual[i], shift, half, depth)
            m += p
            mx += p * x[i]
            my += p * y[i]
            mz += p * z[i]
            mxx += p * x[i] * x[i]
            mxy += p * x[i] * y[i]
            myy += p * y[i] * y[i]
            mxz += p * x[i] * z[i]
            myz += p * y[i] * z[i]
        if m <= 0.0:
            break
        minor_a, minor_b, minor_c = mxx * myy - mxy * mxy, mx * myy - mxy * my, mx * mxy - mxx * my
        det = m * minor_a - mx * minor_b + my * minor_c
        a = (mz * minor_a - mxz * minor_b + myz * minor_c) / det
        b = (m * (mxz * myy - mxy * myz) - mz * minor_b + my * (mx * myz - mxz * my)) / det
        c = (m * (mxx * myz - mxz * mxy) - mx * (mx * myz - mxz * my) + mz * minor_c) / det
    return a


@helper
def _shift(residual, weight, count, depth):
    """Mean of the negative residuals, which locates the ground in their histogram."""
    total, mass = 0.0, 0.0
    for i in range(count):
        if -depth <= residual[i] < 0.0:
            total += weight[i] * residual[i]
            mass += weight[i]
    return total / mass if mass > 0.0 else 0.0


@helper
def robust_weight(residual, shift, half, depth):
    """Weight of a residual: 1 up to the shift, 1/2 at a half width above it, 0 far from it."""
    if residual < -depth:
        return 0.0
    ratio = (residual - shift) / half
    if ratio <= 0.0:
        return 1.0
    return 1.0 / (1.0 + ratio**4) if ratio <= TRUNCATION else 0.0
