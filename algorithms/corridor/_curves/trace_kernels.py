"""Compiled loops of :mod:`algorithms.corridor._curves.trace`. All lengths are metres.

A curve is an array: origin x, y; direction x, y; ends low, high of the distance u from
the origin along it; three coefficients each of the offset to the left, and of the height, in t =
(u - middle) / half; middle and half.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels.compiling import helper, kernel

CURVE_X, CURVE_Y, CURVE_EX, CURVE_EY, CURVE_LOW, CURVE_HIGH = range(6)
CURVE_V, CURVE_Z = 6, 9  # the first of three coefficients each
CURVE_MIDDLE, CURVE_HALF, CURVE_RMS = range(12, 15)
CURVE_SIZE = 16
MOST_EXTENSIONS = 1000


class Following(NamedTuple):
    """Numbers by which wires are followed: those of :class:`algorithms.corridor._settings.Trace`.

    Attributes
    ----------
    look_most : metres by which one looks ahead at most
    """

    look_share: float
    look_least: float
    look_most: float
    usual_bend: float
    usual_sag: float
    least_rms: float
    widest: float
    resuming_share: float


class Cells(NamedTuple):
    """Points in the order of square cells in plan, row by row.

    Attributes
    ----------
    xyz : array of shape (n, 3)
    start : where each cell begins
    """

    xyz: NDArray[np.float64]
    start: NDArray[np.int64]
    west: float
    south: float
    size: float
    rows: int
    cols: int


@kernel
def in_cells(xyz, by_x, cell, free, start, order):
    """Fill in the order of points by cell, x, y and z, from their order by x.

    `free` is where the next point of each cell goes; it begins as `start`.
    """
    for i in by_x:
        at = free[cell[i]]
        free[cell[i]] += 1
        while at > start[cell[i]]:  # points with one x come in any order
            j = order[at - 1]
            if xyz[j, 0] < xyz[i, 0] or (xyz[j, 1], xyz[j, 2]) <= (xyz[i, 1], xyz[i, 2]):
                break
            order[at] = j
            at -= 1
        order[at] = i


@kernel
def crowding(keys, masks, offsets, first, last, out):
    """Fill in how many eighths of the voxels around each voxel first..last have points.

    `offsets` are the first and last key of each column around, relative to that of the middle.
    """
    for j in range(offsets.shape[0]):
        at = np.searchsorted(keys, keys[first] + offsets[j, 0])
        for i in range(first, last):
            low, high = keys[i] + offsets[j, 0], keys[i] + offsets[j, 1]
            while at < len(keys) and keys[at] < low:
                at += 1
            k = at
            while k < len(keys) and keys[k] <= high:
                out[i] += masks[k]
                k += 1


@helper
def _around(x, y, radius, cells):
    """First and last row and column of the cells that meet a square, clipped to the lattice."""
    r0 = min(max(0, int((y - radius - cells.south) / cells.size)), cells.rows - 1)
    r1 = max(0, min(cells.rows - 1, int((y + radius - cells.south) / cells.size)))
    c0 = min(max(0, int((x - radius - cells.west) / cells.size)), cells.cols - 1)
    c1 = max(0, min(cells.cols - 1, int((x + radius - cells.west) / cells.size)))
    return r0, r1, c0, c1


@kernel
def straightness(first, last, seeds, cells, reach, tube, steepest, score, heading):
    """Score the seeds first..last by the metres of the best line through each that hold points.

    They count the less the farther they are off the line, as those of a line across several wires
    are. Points in a shell around it, thrice as wide as the tube, count against it. `heading`
    receives the direction of the line.
    """
    xyz, start, cols = cells.xyz, cells.start, cells.cols
    near = np.empty((4096, 3))
    bins = int(2 * reach) + 2
    inside = np.empty(bins, np.bool_)
    for s in range(first, last):
        x, y, z = xyz[seeds[s], 0], xyz[seeds[s], 1], xyz[seeds[s], 2]
        n = 0
        r0, r1, c0, c1 = _around(x, y, reach, cells)
        for r in range(r0, r1 + 1):
            for i in range(start[r * cols + c0], start[r * cols + c1 + 1]):
                dx, dy, dz = xyz[i, 0] - x, xyz[i, 1] - y, xyz[i, 2] - z
                if dx * dx + dy * dy + dz * dz < reach * reach and n < len(near):
                    near[n, 0], near[n, 1], near[n, 2] = dx, dy, dz
                    n += 1
        best = 0.0
        step = max(1, n // 48)
        for j in range(0, n, step):
            dx, dy, dz = near[j, 0], near[j, 1], near[j, 2]
            flat = math.sqrt(dx * dx + dy * dy)
            if flat < 0.25 * reach or abs(dz) > steepest * flat:
                continue
            size = math.sqrt(flat * flat + dz * dz)
            dx, dy, dz = dx / size, dy / size, dz / size
            inside[:] = False
            tubed, shelled, close = 0, 0, 0.0
            for i in range(n):
                along = near[i, 0] * dx + near[i, 1] * dy + near[i, 2] * dz
                square = near[i, 0] ** 2 + near[i, 1] ** 2 + near[i, 2] ** 2 - along * along
                if square < tube * tube:
                    inside[int(along + reach)] = True
                    tubed += 1
                    close += 1.0 - square / (tube * tube)
                elif square < 9 * tube * tube:
                    shelled += 1
            found = 0.0
            for k in range(bins):
                found += inside[k]
            found *= min(1.0, 3.0 * tubed / max(1, shelled)) * close / max(1, tubed)
            if found > best:
                best = found
                heading[s, 0], heading[s, 1], heading[s, 2] = dx, dy, dz
        score[s] = best


@helper
def _values(curve, u):
    """Offset and height of a curve at u."""
    t = (u - curve[CURVE_MIDDLE]) / curve[CURVE_HALF]
    v = curve[CURVE_V] + t * (curve[CURVE_V + 1] + t * curve[CURVE_V + 2])
    z = curve[CURVE_Z] + t * (curve[CURVE_Z + 1] + t * curve[CURVE_Z + 2])
    return v, z


@helper
def _gather(by, curve, low, high, tolerance, spread, cells, found, count):
    """Append to `found` the points near the curve with u from low to high; the new count.

    `spread` is the inverse normal matrix of the fit, by which the tolerance grows away from what
    is known.
    """
    xyz, start, cols = cells.xyz, cells.start, cells.cols
    most = by.widest * tolerance
    pieces = max(1, math.ceil((high - low) / cells.size))
    for p in range(pieces):
        a = low + (high - low) * p / pieces
        b = low + (high - low) * (p + 1) / pieces
        u = 0.5 * (a + b)
        v, _ = _values(curve, u)
        x = curve[CURVE_X] + u * curve[CURVE_EX] - v * curve[CURVE_EY]
        y = curve[CURVE_Y] + u * curve[CURVE_EY] + v * curve[CURVE_EX]
        r0, r1, c0, c1 = _around(x, y, 0.5 * (b - a) + most + 0.5, cells)
        for r in range(r0, r1 + 1):
            for i in range(start[r * cols + c0], start[r * cols + c1 + 1]):
                dx, dy = xyz[i, 0] - curve[CURVE_X], xyz[i, 1] - curve[CURVE_Y]
                u = dx * curve[CURVE_EX] + dy * curve[CURVE_EY]
                if u < a or u >= b:
                    continue
                v, z = _values(curve, u)
                dv, dz = dy * curve[CURVE_EX] - dx * curve[CURVE_EY] - v, xyz[i, 2] - z
                if abs(dv) > most or abs(dz) > most:
                    continue
                t = (u - curve[CURVE_MIDDLE]) / curve[CURVE_HALF]
                q = (1.0, t, t * t)
                flat, tall = 0.0, 0.0
                for j in range(3):
                    for k in range(3):
                        flat += q[j] * q[k] * spread[0, j, k]
                        tall += q[j] * q[k] * spread[1, j, k]
                sigma = max(curve[CURVE_RMS], by.least_rms)
                wide = min(most, math.sqrt(tolerance**2 + 9 * sigma**2 * flat))
                high_ = min(most, math.sqrt(tolerance**2 + 9 * sigma**2 * tall))
                if (dv / wide) ** 2 + (dz / high_) ** 2 < 1 and count < len(found):
                    found[count] = i
                    count += 1
    return count


@helper
def solve(normal, right, result, inverse):
    """Solve a symmetric system of three equations, and invert its matrix."""
    a, b, c = normal[0, 0], normal[0, 1], normal[0, 2]
    d, e, f = normal[1, 1], normal[1, 2], normal[2, 2]
    ca, cb, cc = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * ca + b * cb + c * cc
    inverse[0, 0], inverse[0, 1], inverse[0, 2] = ca / det, cb / det, cc / det
    inverse[1, 1], inverse[1, 2] = (a * f - c * c) / det, (b * c - a * e) / det
    inverse[2, 2] = (a * d - b * b) / det
    inverse[1, 0], inverse[2, 0], inverse[2, 1] = inverse[0, 1], inverse[0, 2], inverse[1, 2]
    for j in range(3):
        result[j] = 0.0
        for k in range(3):
            result[j] += inverse[j, k] * right[k]


@helper
def _fit(by, curve, found, count, tolerance, xyz, spread, rounds):
    """Fit parabolas in plan and height to points robustly (Tukey); updates curve and spread."""
    old_mid, old_half = curve[CURVE_MIDDLE], curve[CURVE_HALF]
    lo, hi = np.inf, -np.inf
    for k in range(count):
        i = found[k]
        u = (xyz[i, 0] - curve[CURVE_X]) * curve[CURVE_EX] + (xyz[i, 1] - curve[CURVE_Y]) * curve[
            CURVE_EY
        ]
        lo, hi = min(lo, u), max(hi, u)
    mid, half = 0.5 * (lo + hi), max(0.5 * (hi - lo), 0.5)
    # The same parabolas, about the new middle.
    for c in (CURVE_V, CURVE_Z):
        p0, p1, p2 = curve[c], curve[c + 1], curve[c + 2]
        s, g = (mid - old_mid) / old_half, half / old_half
        curve[c] = p0 + p1 * s + p2 * s * s
        curve[c + 1], curve[c + 2] = (p1 + 2 * p2 * s) * g, p2 * g * g
    curve[CURVE_MIDDLE], curve[CURVE_HALF] = mid, half
    normal = np.zeros((3, 3))
    right_v, right_z = np.zeros(3), np.zeros(3)
    result = np.zeros(3)
    sigma = max(curve[CURVE_RMS], by.least_rms)
    for _ in range(rounds):
        normal[:], right_v[:], right_z[:] = 0.0, 0.0, 0.0
        total, weights = 0.0, 0.0
        for k in range(count):
            i = found[k]
            dx, dy = xyz[i, 0] - curve[CURVE_X], xyz[i, 1] - curve[CURVE_Y]
            u = dx * curve[CURVE_EX] + dy * curve[CURVE_EY]
            t = (u - mid) / half
            v, z = _values(curve, u)
            dv, dz = dy * curve[CURVE_EX] - dx * curve[CURVE_EY] - v, xyz[i, 2] - z
            square = (dv * dv + dz * dz) / (4 * tolerance * tolerance)
            if square >= 1:
                continue
            w = (1 - square) ** 2
            total += w * (dv * dv + dz * dz) / 2
            weights += w
            q = (1.0, t, t * t)
            for j in range(3):
                right_v[j] += w * q[j] * (v + dv)
                right_z[j] += w * q[j] * (z + dz)
                for m in range(3):
                    normal[j, m] += w * q[j] * q[m]
        if weights < 3:
            return False
        sigma = max(math.sqrt(total / weights), by.least_rms)
        for which in range(2):
            usual = (by.usual_bend if which == 0 else by.usual_sag) * half * half
            kept = normal[2, 2]
            normal[2, 2] += (sigma / usual) ** 2
            normal[1, 1] += 1e-6
            solve(normal, right_v if which == 0 else right_z, result, spread[which])
            normal[1, 1] -= 1e-6
            normal[2, 2] = kept
            base = CURVE_V if which == 0 else CURVE_Z
            for j in range(3):
                curve[base + j] = result[j]
        curve[CURVE_RMS] = sigma
    curve[CURVE_LOW], curve[CURVE_HIGH] = lo, hi
    return True


@helper
def _keep_near(curve, found, count, tolerance, xyz):
    """Drop the points of `found` that are too far from the curve; the number that remain."""
    kept = 0
    for k in range(count):
        i = found[k]
        dx, dy = xyz[i, 0] - curve[CURVE_X], xyz[i, 1] - curve[CURVE_Y]
        u = dx * curve[CURVE_EX] + dy * curve[CURVE_EY]
        v, z = _values(curve, u)
        dv, dz = dy * curve[CURVE_EX] - dx * curve[CURVE_EY] - v, xyz[i, 2] - z
        if dv * dv + dz * dz < tolerance * tolerance:
            found[kept] = i
            kept += 1
    return kept


@helper
def _begin(by, seed, heading, cells, reach, tolerance, curve, found, spread):
    """Fit the first curve to the points around a seed; their number, 0 if there are too few."""
    xyz = cells.xyz
    flat = math.sqrt(heading[0] ** 2 + heading[1] ** 2)
    curve[:] = 0.0
    curve[CURVE_X], curve[CURVE_Y] = xyz[seed, 0], xyz[seed, 1]
    curve[CURVE_EX], curve[CURVE_EY] = heading[0] / flat, heading[1] / flat
    curve[CURVE_HALF] = 1.0
    curve[CURVE_Z], curve[CURVE_Z + 1] = xyz[seed, 2], heading[2] / flat
    count = _gather(by, curve, -reach, reach, tolerance, spread, cells, found, 0)
    if count < 4 or not _fit(by, curve, found, count, tolerance, xyz, spread, 5):
        return 0
    count = _keep_near(curve, found, count, tolerance, xyz)
    if count < 4 or not _fit(by, curve, found, count, tolerance, xyz, spread, 2):
        return 0
    return count


@kernel
def trace(by, seed, heading, cells, reach, tolerance, max_gap, curve, found):
    """Trace a wire from a seed in both directions; the number of its points.

    `curve` and `found` are filled in; `by` is :class:`Following`.
    """
    xyz, spread = cells.xyz, np.zeros((2, 3, 3))
    count = _begin(by, seed, heading, cells, reach, tolerance, curve, found, spread)
    if count == 0:
        return 0
    gaps = np.zeros(2)  # looked into without finding anything, behind and ahead
    steps = 0
    while gaps.min() < np.inf and steps < MOST_EXTENSIONS:
        steps += 1
        for side in range(2):
            if gaps[side] == np.inf:
                continue
            length = curve[CURVE_HIGH] - curve[CURVE_LOW]
            look = min(max(by.look_share * length, by.look_least), by.look_most)
            if side == 1:
                low = curve[CURVE_HIGH] + gaps[side] + 1e-9
                high = low + look
            else:
                high = curve[CURVE_LOW] - gaps[side] - 1e-9
                low = high - look
            before = count
            count = _gather(by, curve, low, high, tolerance, spread, cells, found, count)
            usual = before / max(length, 1.0)
            needed = 1.0 if gaps[side] == 0.0 else max(3.0, by.resuming_share * usual * look)
            if count - before >= needed:
                if not _fit(by, curve, found, count, tolerance, xyz, spread, 3):
                    return 0
                count = _keep_near(curve, found, count, by.widest * tolerance, xyz)
                gaps[:] = 0.0
            else:
                count = before
                gaps[side] += look
                if gaps[side] > min(max_gap, length):
                    gaps[side] = np.inf
        if count >= len(found):
            return 0
    count = _keep_near(curve, found, count, tolerance, xyz)
    if count < 4 or not _fit(by, curve, found, count, tolerance, xyz, spread, 5):
        return 0
    return _keep_near(curve, found, count, tolerance, xyz)


@kernel
def profile(curve, step, tube, cells, tubed, shelled):
    """Count points in a tube around a curve, and in the shell around that, per step along it."""
    xyz, start, cols = cells.xyz, cells.start, cells.cols
    for k in range(len(tubed)):
        u = curve[CURVE_LOW] + (k + 0.5) * step
        v, _ = _values(curve, u)
        x = curve[CURVE_X] + u * curve[CURVE_EX] - v * curve[CURVE_EY]
        y = curve[CURVE_Y] + u * curve[CURVE_EY] + v * curve[CURVE_EX]
        r0, r1, c0, c1 = _around(x, y, 0.5 * step + 3 * tube, cells)
        for r in range(r0, r1 + 1):
            for i in range(start[r * cols + c0], start[r * cols + c1 + 1]):
                dx, dy = xyz[i, 0] - curve[CURVE_X], xyz[i, 1] - curve[CURVE_Y]
                u = dx * curve[CURVE_EX] + dy * curve[CURVE_EY]
                if int((u - curve[CURVE_LOW]) / step) != k or u < curve[CURVE_LOW]:
                    continue
                v, z = _values(curve, u)
                dv, dz = dy * curve[CURVE_EX] - dx * curve[CURVE_EY] - v, xyz[i, 2] - z
                square = dv * dv + dz * dz
                if square < tube * tube:
                    tubed[k] += 1
                elif square < 9 * tube * tube:
                    shelled[k] += 1


@kernel
def tube(shape, low, high, radius, cells, found, away):
    """Fill in the points within a radius of a catenary, from u = low to high; their number.

    `shape` holds x, y, ex, ey, u0, z0, curvature, the chord's height at 0 and its slope, v0, v1 and
    swing of :class:`algorithms.corridor._curves.catenary.Catenary`.
    """
    xyz, start, cols = cells.xyz, cells.start, cells.cols
    x0, y0, ex, ey, u0, z0, k, chord, slope, v0, v1, swing = shape
    count = 0
    pieces = max(1, math.ceil((high - low) / cells.size))
    for p in range(pieces):
        a = low + (high - low) * p / pieces
        b = low + (high - low) * (p + 1) / pieces
        u = 0.5 * (a + b)
        z = z0 + 2 * math.sinh(0.5 * k * (u - u0)) ** 2 / k
        v = v0 + v1 * u + swing * (chord + slope * u - z)
        x, y = x0 + u * ex - v * ey, y0 + u * ey + v * ex
        r0, r1, c0, c1 = _around(x, y, 0.5 * (b - a) + radius + 0.5, cells)
        for r in range(r0, r1 + 1):
            for i in range(start[r * cols + c0], start[r * cols + c1 + 1]):
                dx, dy = xyz[i, 0] - x0, xyz[i, 1] - y0
                u = dx * ex + dy * ey
                if u < a or u >= b:
                    continue
                z = z0 + 2 * math.sinh(0.5 * k * (u - u0)) ** 2 / k
                dv = dy * ex - dx * ey - v0 - v1 * u - swing * (chord + slope * u - z)
                dz = xyz[i, 2] - z
                square = dv * dv + dz * dz
                if square < radius * radius:
                    found[count] = i
                    away[count] = math.sqrt(square)
                    count += 1
    return count
