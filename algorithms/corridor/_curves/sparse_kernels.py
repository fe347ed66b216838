"""Compiled loops of :mod:`algorithms.corridor._curves.sparse`. All lengths are metres."""

from __future__ import annotations

import math

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel

NEAR = 4.0  # metres from a seed, beyond which the plane of a wire is a narrow angle
MOST_WIRES = 40  # that are looked for beside each other


@helper
def _tail(k, n, p):
    """Hoeffding's bound of the probability that of n points at least k are where p are usual.

    Its natural logarithm, at most 0.
    """
    if k <= n * p or n <= 0:
        return 0.0
    if k >= n:
        return n * math.log(p)
    share = k / n
    return -n * (share * math.log(share / p) + (1.0 - share) * math.log((1.0 - share) / (1.0 - p)))


@helper
def _group(v, w, u, n, taken, v0, w0, radius, ring, filled, step):
    """Steps of u with free points within a radius of a place, and free points in a ring around."""
    filled[:] = False
    own, around = 0, 0
    for k in range(n):
        if taken[k]:
            continue
        square = (v[k] - v0) ** 2 + (w[k] - w0) ** 2
        if square < radius * radius:
            s = min(int(u[k] / step), len(filled) - 1)
            if not filled[s]:
                filled[s] = True
                own += 1
        elif square < ring * ring:
            around += 1
    return own, around


@helper
def _take(v, w, n, taken, v0, w0, radius, number):
    for k in range(n):
        if not taken[k] and (v[k] - v0) ** 2 + (w[k] - w0) ** 2 < radius * radius:
            taken[k] = number


@kernel
def evidence(v, w, u, n, length, radius, reach, ring, inner, steps, taken, proof):
    """How unlikely wires are by chance: logarithm of the probability, wires marked in `taken`.

    Parameters
    ----------
    v, w, u : of n points, offset and height from the wire supposed, and distance along it
    length : of that wire
    radius, reach : of a wire, and of what is looked at around it
    ring, inner : radius around a wire, and share of the points within it that are on it by chance
    steps : of the wire, in each of which points count once
    taken : number of the wire of each point, from 1, is filled in
    proof : logarithm for each wire beside the first, of how many as good are expected by chance
    """
    area = math.pi * radius * radius / (4.0 * reach * reach)
    filled = np.empty(steps, np.bool_)
    step = length / steps
    taken[:n] = 0
    left = n
    own, around = _group(v, w, u, n, taken, 0.0, 0.0, radius, ring, filled, step)
    # two points and the curvature are given
    total = max(_tail(own - 3, left - 3, area), _tail(own - 3, own - 3 + around, inner))
    if own < 4:
        return 0.0
    _take(v, w, n, taken, 0.0, 0.0, radius, 1)
    number = 1
    while number < MOST_WIRES:
        left = 0
        for k in range(n):
            left += taken[k] == 0
        best, v0, w0 = 0.0, 0.0, 0.0
        for k in range(n):
            if taken[k]:
                continue
            own, around = _group(v, w, u, n, taken, v[k], w[k], radius, ring, filled, step)
            if own < 3:
                continue
            here = max(_tail(own - 1, left - 1, area), _tail(own - 1, own - 1 + around, inner))
            here += math.log(left)
            if here < best:
                best, v0, w0 = here, v[k], w[k]
        if best >= 0.0:
            break
        number += 1
        total += best
        proof[number - 1] = best
        _take(v, w, n, taken, v0, w0, radius, number)
    return total


@kernel
def moved(i, j, bend, points, xyz, used, reach, u, v, w, index):
    """Points between two of them: distance along and aside, and height above the wire from i to j.

    Only those within reach of it; the arrays are filled in. Returns their number and the length.
    """
    dx, dy = xyz[j, 0] - xyz[i, 0], xyz[j, 1] - xyz[i, 1]
    d = math.sqrt(dx * dx + dy * dy)
    ex, ey, slope = dx / d, dy / d, (xyz[j, 2] - xyz[i, 2]) / d
    n = 0
    for k in range(len(points)):
        m = points[k]
        if m < 0 or used[m]:
            continue
        px, py = xyz[m, 0] - xyz[i, 0], xyz[m, 1] - xyz[i, 1]
        a = px * ex + py * ey
        b = py * ex - px * ey
        if a < -1e-9 or a > d + 1e-9 or abs(b) > reach:
            continue
        h = xyz[m, 2] - xyz[i, 2] - slope * a + 0.5 * bend * a * (d - a)
        if abs(h) < reach:
            u[n], v[n], w[n], index[n] = a, b, h, m
            n += 1
    return n, d


@helper
def _between(k, n, azimuth, px, py, pz, close, ex, ey, d, slope, radius, u, z):
    """Fill in points near the vertical plane from the seed to the k-th neighbour by azimuth.

    Those farther away than NEAR lie within few degrees of it; `close` of all neighbours are nearer.
    """
    lines, widest = 0, math.asin(min(1.0, radius / NEAR))
    for side in (-1, 1):
        m = k
        for _ in range(n):
            m += side
            if m < 0:
                m = n - 1
            elif m >= n:
                m = 0
            turn = abs(azimuth[m] - azimuth[k])
            if m == k or min(turn, 2 * math.pi - turn) > widest:
                break
            a = px[m] * ex + py[m] * ey
            if NEAR < a < d and abs(py[m] * ex - px[m] * ey) < radius:
                u[lines], z[lines] = a, pz[m] - slope * a
                lines += 1
    for c in range(n):
        if not close[c]:
            continue
        a = px[c] * ex + py[c] * ey
        if 0.0 < a <= NEAR and abs(py[c] * ex - px[c] * ey) < radius:
            u[lines], z[lines] = a, pz[c] - slope * a
            lines += 1
    return lines


@helper
def _bent(lines, u, z, d, radius, flattest, tightest):
    """Curvature of the arc through both ends and most of the points between, how many these are.

    The third number is how many curvatures were tried.
    """
    best, found, tests = 0, 0.0, 0
    for a in range(lines):
        tried = -2.0 * z[a] / (u[a] * (d - u[a]))
        if tried < flattest or tried > tightest:
            continue
        tests += 1
        count = 0
        for b in range(lines):
            count += abs(z[b] + 0.5 * tried * u[b] * (d - u[b])) < radius
        if count > best:
            best, found = count, tried
    return best, found, tests


@kernel
def search(first, last, order, xyz, near, used, shape, steps, score, other, bend, tests):
    """For each point first..last of an order, the wire from it that is least likely by chance.

    `shape` holds radius, reach, ring and inner as for :func:`evidence`, shortest length, steepest
    slope, largest sag by length, least and largest curvature. `score` receives the logarithm of its
    probability, `other` its far end, `bend` its curvature, and `tests` how many were tried.
    """
    radius, reach, ring, inner, shortest, steepest, sag, flattest, tightest = shape
    most = near.shape[1] + 1
    u, v, z, w = np.empty(2 * most), np.empty(most), np.empty(2 * most), np.empty(most)
    px, py, pz = np.empty(most), np.empty(most), np.empty(most)
    close = np.empty(most, np.bool_)
    index, taken = np.empty(most, np.int64), np.zeros(most, np.int64)
    proof = np.empty(MOST_WIRES)
    for at in range(first, last):
        i = order[at]
        score[i], other[i], tests[i] = 0.0, -1, 0
        if used[i]:
            continue
        n = 0
        for k in range(near.shape[1]):
            m = near[i, k]
            if m >= 0 and m != i and not used[m]:
                index[n] = m
                n += 1
        own = index[:n].copy()
        azimuth = np.arctan2(xyz[own, 1] - xyz[i, 1], xyz[own, 0] - xyz[i, 0])
        by_azimuth = np.argsort(azimuth)
        azimuth, own = azimuth[by_azimuth], own[by_azimuth]
        for k in range(n):
            px[k], py[k] = xyz[own[k], 0] - xyz[i, 0], xyz[own[k], 1] - xyz[i, 1]
            pz[k] = xyz[own[k], 2] - xyz[i, 2]
            close[k] = px[k] ** 2 + py[k] ** 2 < (NEAR + radius) ** 2
        for k in range(n):
            d = math.sqrt(px[k] ** 2 + py[k] ** 2)
            if d < shortest or abs(pz[k]) > steepest * d:
                continue
            ex, ey, slope = px[k] / d, py[k] / d, pz[k] / d
            lines = _between(k, n, azimuth, px, py, pz, close, ex, ey, d, slope, radius, u, z)
            if lines < 2:
                continue
            count, k0, made = _bent(lines, u, z, d, radius, flattest, min(tightest, 8.0 * sag / d))
            tests[i] += made
            if count < 2:
                continue
            j = own[k]
            inside, d = moved(i, j, k0, near[i], xyz, used, reach, u, v, w, index)
            found = evidence(v, w, u, inside, d, radius, reach, ring, inner, steps, taken, proof)
            if found < score[i]:
                score[i], other[i], bend[i] = found, j, k0
