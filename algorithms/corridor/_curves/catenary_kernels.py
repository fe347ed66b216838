"""Compiled loops of :mod:`algorithms.corridor._curves.catenary`. All lengths are metres."""

from __future__ import annotations

import math

import numpy as np

from algorithms.corridor._curves.trace_kernels import solve
from algorithms.shared.kernels.compiling import helper, kernel
from algorithms.shared.kernels.sorting import median

LEAST_CURVATURE, MOST_CURVATURE = 1e-5, 0.1  # 1 / metre: a wire straighter than this is straight
FIT_ROUNDS = 30
TUKEY_CUT = 4.685  # standard deviations at which a point loses all weight: 95 % efficient (Tukey)
RIDGE = 1e-9  # keeps normal matrices regular, beside the weights of points
# What a fit fills in: heights at both ends, curvature, plan curve, RMS, standard error of a height.
FIT_Z_START, FIT_Z_END, FIT_CURVATURE, FIT_V0, FIT_V1, FIT_SWING, FIT_RMS, FIT_ERROR = range(8)
FIT_SIZE = 8


@helper
def _hung(length, z_start, z_end, curvature):
    """Horizontal position and height of the lowest point of a catenary."""
    half = math.sinh(0.5 * curvature * length)
    u0 = length / 2 - math.asinh(0.5 * curvature * (z_end - z_start) / half) / curvature
    return u0, z_start - 2 * math.sinh(0.5 * curvature * u0) ** 2 / curvature


@helper
def _height(u, u0, z0, curvature):
    return z0 + 2 * math.sinh(0.5 * curvature * (u - u0)) ** 2 / curvature


@helper
def _add(row, value, weight, normal, right):
    """Add an observation to the normal equations."""
    for j in range(3):
        right[j] += weight * row[j] * value
        for k in range(3):
            normal[j, k] += weight * row[j] * row[k]


@helper
def _begun(u, z, length, normal, right, result, inverse):
    """First approximation: end heights and second derivative of a parabola through the points."""
    normal[:], right[:] = 0.0, 0.0
    for i in range(len(u)):
        t = 2 * u[i] / length - 1
        _add((1.0, t, t * t), z[i], 1.0, normal, right)
    for j in range(3):
        normal[j, j] += RIDGE
    solve(normal, right, result, inverse)
    middle, slope, bend = result[0], result[1], result[2]
    return middle - slope + bend, middle + slope + bend, 8 * bend / length**2


@helper
def _plan(u, v, length, weight, sways, shape, off, normal, right, result, inverse):
    """Fit the curve in plan to the offsets v, and fill `off` with the residuals."""
    u0, z0 = _hung(length, shape[FIT_Z_START], shape[FIT_Z_END], shape[FIT_CURVATURE])
    slope = (shape[FIT_Z_END] - shape[FIT_Z_START]) / length
    deep = max(shape[FIT_CURVATURE] * length**2 / 8, RIDGE) if sways else math.inf
    normal[:], right[:] = 0.0, 0.0
    for i in range(len(u)):
        sag = shape[FIT_Z_START] + slope * u[i] - _height(u[i], u0, z0, shape[FIT_CURVATURE])
        _add((1.0, u[i] / length, sag / deep), v[i], weight[i], normal, right)
    for j in range(3):
        normal[j, j] += RIDGE
    solve(normal, right, result, inverse)
    shape[FIT_V0], shape[FIT_V1], shape[FIT_SWING] = result[0], result[1] / length, result[2] / deep
    for i in range(len(u)):
        sag = shape[FIT_Z_START] + slope * u[i] - _height(u[i], u0, z0, shape[FIT_CURVATURE])
        off[i] = v[i] - shape[FIT_V0] - shape[FIT_V1] * u[i] - shape[FIT_SWING] * sag


@helper
def _rise(u, z, length, weight, known, known_sigma, sigma, shape, normal, right, result, inverse):
    """One Gauss-Newton step for the heights at both ends and the curvature.

    A curvature that is known of other wires, above 0, is one more observation.
    """
    start, end, bent = shape[FIT_Z_START], shape[FIT_Z_END], shape[FIT_CURVATURE]
    more, scale = 1e-3 * bent + 1e-9, length**2 / 8
    u0, z0 = _hung(length, start, end, bent)
    raised_u0, raised_z0 = _hung(length, start, end + 1e-3, bent)
    bent_u0, bent_z0 = _hung(length, start, end, bent + more)
    normal[:], right[:] = 0.0, 0.0
    for i in range(len(u)):
        if weight[i] > 0:
            base = _height(u[i], u0, z0, bent)
            rise = (_height(u[i], raised_u0, raised_z0, bent) - base) / 1e-3
            bend = (_height(u[i], bent_u0, bent_z0, bent + more) - base) / more
            _add((1 - rise, rise, bend / scale), z[i] - base, weight[i], normal, right)
    for j in range(3):
        normal[j, j] += RIDGE
    if known > 0:
        square = (sigma / (known_sigma * known * scale)) ** 2
        normal[2, 2] += square
        right[2] += square * (known - bent) * scale
    solve(normal, right, result, inverse)
    shape[FIT_Z_START] += result[0]
    shape[FIT_Z_END] += result[1]
    shape[FIT_CURVATURE] = min(max(bent + result[2] / scale, LEAST_CURVATURE), MOST_CURVATURE)
    inverse[2] /= scale
    inverse[:, 2] /= scale


@helper
def _squares(u, z, length, weight, limit, shape, off, square):
    """Fill in the squared distances of points from the curve, its RMS and its error of a height.

    The error is that of an estimator that weights points by how far they lie (Huber 1981, 7.6): far
    ones count less, which makes their scatter about the curve seem less than it is.

    Parameters
    ----------
    limit : distance at which points have lost all weight
    """
    u0, z0 = _hung(length, shape[FIT_Z_START], shape[FIT_Z_END], shape[FIT_CURVATURE])
    total, tall, stiff, flat, count = 0.0, 0.0, 0.0, 0.0, 0
    for i in range(len(u)):
        away = (z[i] - _height(u[i], u0, z0, shape[FIT_CURVATURE])) ** 2
        square[i] = off[i] ** 2 + away
        if weight[i] > 0:
            total += weight[i]
            tall += weight[i] ** 2 * away
            stiff += weight[i] - 4 * math.sqrt(weight[i]) * away / limit**2
            flat += square[i]
            count += 1
    shape[FIT_RMS] = math.sqrt(flat / count)
    shape[FIT_ERROR] = math.sqrt(total * count * tall / max(count - 3, 1)) / max(stiff, RIDGE)


@kernel
def fitted(
    u,
    v,
    z,
    length,
    spread,
    known,
    known_sigma,
    least_sigma,
    sways,
    least_sag,
    shape,
    covariance,
):
    """Fit a catenary to the points of a wire; the number of points used, 0 if there is no fit.

    Points are given along the axis, to the left of it, and by height.

    Parameters
    ----------
    u, v, z : arrays of shape (n,), u from 0 to `length`
    spread : points farther than this from the first curve lose all weight
    known : curvature known of other wires, 0 for none
    known_sigma : its standard deviation, as a share of it
    least_sigma : scatter of the points, at least, metres
    sways : whether to look for a swing by wind
    least_sag : from which a swing can be told from an azimuth, metres
    shape : array of shape (SIZE,), filled in
    covariance : array of shape (3, 3), filled in: of both heights and the curvature
    """
    weight, fresh = np.ones(len(u)), np.empty(len(u))
    off, square, some = np.empty(len(u)), np.empty(len(u)), np.empty(len(u))
    normal, right, result, inverse = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros((3, 3))
    start, end, bend = _begun(u, z, length, normal, right, result, inverse)
    bend = min(max(bend, LEAST_CURVATURE), MOST_CURVATURE) if length > 10 else LEAST_CURVATURE
    shape[:] = 0.0
    shape[FIT_Z_START], shape[FIT_Z_END], shape[FIT_CURVATURE] = (
        start,
        end,
        known if known > 0 else bend,
    )
    sways &= shape[FIT_CURVATURE] * length**2 / 8 > least_sag
    sigma, limit, used = spread / TUKEY_CUT, math.inf, len(u)
    for number in range(FIT_ROUNDS):
        _plan(u, v, length, weight, sways, shape, off, normal, right, result, inverse)
        _rise(
            u,
            z,
            length,
            weight,
            known,
            known_sigma,
            max(sigma, least_sigma),
            shape,
            normal,
            right,
            result,
            inverse,
        )
        _squares(u, z, length, weight, limit, shape, off, square)
        count = 0
        for i in range(len(u)):
            if weight[i] > 0:
                some[count] = square[i]
                count += 1
        # The median square of two normal variables is 2 ln 2 times their variance.
        sigma = max(math.sqrt(median(some[:count]) / math.log(4.0)), least_sigma)
        limit = min(spread, TUKEY_CUT * sigma)
        left, change = 0, 0.0
        for i in range(len(u)):
            fresh[i] = max(1 - square[i] / limit**2, 0.0) ** 2
            change = max(change, abs(fresh[i] - weight[i]))
            left += fresh[i] > 0
        if number > 3 and change < 1e-4:
            break
        if left < 4:
            return 0
        weight[:], used = fresh, left
    covariance[:] = inverse * max(shape[FIT_ERROR], least_sigma) ** 2
    return used
