"""Compiled loop of :mod:`algorithms.corridor._curves.arcs`."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel

TINY = 1e-9


@helper
def _misfit(m, bend, sigma):
    """Least sum of squares of a + b p + c q, with the prior that c is `bend` +- `sigma`.

    `m` holds the sums of w, w p, w q, w p^2, w p q, w q^2, w y, w p y, w q y and w y^2.
    """
    trust = 1.0 / (sigma * sigma)
    n01, n02, n12 = m[1] / m[0], m[2] / m[0], 0.0
    y0 = m[6]
    left = m[9] + bend * bend * trust - y0 * y0 / m[0]
    d1 = m[3] - n01 * m[1]
    y1 = m[7] - n01 * y0
    e12 = m[4] - n01 * m[2]
    if d1 > TINY * m[3]:
        n12 = e12 / d1
        left -= y1 * y1 / d1
    d2 = m[5] + trust - n02 * m[2] - n12 * e12
    y2 = m[8] + bend * trust - n02 * y0 - n12 * y1
    return max(left - y2 * y2 / d2, 0.0)


@helper
def _add(m, w, d, y, k):
    """Add an observation to the sums of `_misfit`: p is sinh(k d) / k, and q its integral.

    A catenary with c = 1 / k is a sum of 1, p and q, whatever its slope; with k = 0 it is a
    parabola. The series are good to 1e-4 of the sag up to k d = 1.
    """
    square = d * d
    h = 0.5 * square * (1.0 + k * k * square / 12.0 * (1.0 + k * k * square / 30.0))
    d *= 1.0 + k * k * square / 6.0 * (1.0 + k * k * square / 20.0)
    m[0] += w
    m[1] += w * d
    m[2] += w * h
    m[3] += w * d * d
    m[4] += w * d * h
    m[5] += w * h * h
    m[6] += w * y
    m[7] += w * d * y
    m[8] += w * h * y
    m[9] += w * y * y


@kernel
def cuts(tall, flat, x, z, v, price, bend, spread, c, least, total, before):
    """Cut tracks into arcs at common edges of bins, for the least sum of misfits and prices.

    Parameters
    ----------
    tall, flat, x, z, v : arrays of shape (s, t): of what is seen of each track in each bin:
        1 / variance of height and offset, chainage in bins, height and offset
    price : array of shape (s + 1,), of a cut at each edge
    bend, spread : usual curvature of an arc, and how far it may be from that
    c : of the catenary of that curvature, in bins
    least : fewest steps between two cuts
    total, before : arrays of shape (s + 1,), filled in: least cost up to each edge, and where
        the last arc up to there begins
    """
    steps, tracks = x.shape
    high, side = np.zeros((tracks, 10)), np.zeros((tracks, 10))
    misfit = np.zeros(tracks)
    total[:] = np.inf
    total[0] = 0.0
    for a in range(steps):
        if total[a] == np.inf:
            continue
        high[:], side[:], misfit[:] = 0.0, 0.0, 0.0
        cost = 0.0
        for b in range(a + 1, steps + 1):
            for t in range(tracks):
                if tall[b - 1, t] == 0.0:
                    continue
                d = x[b - 1, t] - a
                _add(high[t], tall[b - 1, t], d, z[b - 1, t], 1.0 / c)
                _add(side[t], flat[b - 1, t], d, v[b - 1, t], 0.0)
                cost -= misfit[t]
                misfit[t] = _misfit(high[t], bend, spread) + _misfit(side[t], 0.0, spread)
                cost += misfit[t]
            if total[a] + cost >= total[steps]:
                break  # it can only grow
            if a > 0 and b < steps and b - a < least:
                continue
            here = total[a] + cost + (price[b] if b < steps else 0.0)
            if here < total[b]:
                total[b] = here
                before[b] = a


@kernel
def misfits(tall, flat, x, z, v, low, high, bend, spread, c, out):
    """Fill in the misfit of each track as an arc between low[k] and high[k], arrays of shape (k,).

    `out` is an array of shape (k, tracks) and filled in. The other parameters are those of
    :func:`cuts`.
    """
    sums = np.zeros((2, 10))
    for k in range(len(low)):
        for t in range(x.shape[1]):
            sums[:] = 0.0
            for i in range(low[k], high[k]):
                if tall[i, t] > 0.0:
                    _add(sums[0], tall[i, t], x[i, t] - low[k], z[i, t], 1.0 / c)
                    _add(sums[1], flat[i, t], x[i, t] - low[k], v[i, t], 0.0)
            out[k, t] = 0.0
            if sums[0, 0] > 0.0:
                out[k, t] = _misfit(sums[0], bend, spread) + _misfit(sums[1], 0.0, spread)
