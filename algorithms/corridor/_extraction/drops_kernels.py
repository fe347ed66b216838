"""Compiled loops of :mod:`algorithms.corridor._extraction.drops`. All lengths are metres."""

from __future__ import annotations

import math

import numpy as np

from algorithms.shared.kernels.compiling import kernel


@kernel
def search(x, y, starts, xyz, ends, shape, fullest, start, bend):
    """For each of some ends, the wire to it from a pole on which most steps have points.

    Parameters
    ----------
    x, y : of the axis of the pole
    starts : heights at which a wire may begin there
    xyz : array of shape (n, 3), points that may be on one
    ends : array of shape (m, 3), some of them
    shape : radius of a wire, how far beside the axis it may begin, its shortest length, steepest
        slope, largest curvature and sag by length, and the step; wires that differ by the radius
        are tried
    fullest, start, bend : steps with points, height at the axis and curvature are filled in

    Returns
    -------
    how many wires were tried
    """
    radius, beside, shortest, steepest, tightest, largest_sag, step = shape
    n, tests = len(xyz), 0
    u, z = np.empty(n), np.empty(n)
    for i in range(len(ends)):
        dx, dy = ends[i, 0] - x, ends[i, 1] - y
        d = math.hypot(dx, dy)
        if d < shortest:
            continue
        ex, ey = dx / d, dy / d
        inside = 0
        for k in range(n):
            px, py = xyz[k, 0] - x, xyz[k, 1] - y
            along = px * ex + py * ey
            aside = abs(py * ex - px * ey)
            if 0.0 < along < d and aside < radius + beside * (1.0 - along / d):
                u[inside], z[inside] = along, xyz[k, 2]
                inside += 1
        steps = math.ceil(d / step)
        filled = np.empty(steps, np.bool_)
        most = min(tightest * d * d / 8.0, largest_sag * d)
        sags = math.ceil(most / radius)
        for s in range(len(starts)):
            slope = (ends[i, 2] - starts[s]) / d
            if abs(slope) > steepest:
                continue
            tests += sags
            for a in range(sags):
                tried = 8.0 * min((a + 0.5) * radius, most) / (d * d)
                filled[:] = False
                filled[steps - 1] = True  # the point itself
                for b in range(inside):
                    sag = 0.5 * tried * u[b] * (d - u[b])
                    if abs(z[b] - starts[s] - slope * u[b] + sag) < radius:
                        filled[min(int(u[b] / step), steps - 1)] = True
                count = filled.sum()
                if count > fullest[i]:
                    fullest[i], start[i], bend[i] = count, starts[s], tried
    return tests * math.ceil(1.0 + beside / radius)
