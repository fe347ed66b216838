"""Compiled loops of :mod:`algorithms.corridor._clearance.distances`: points and catenaries."""

from __future__ import annotations

import math

import numpy as np

from algorithms.shared.kernels.compiling import kernel

# Columns of the array of wires, metres; see `Catenary`, and `rows_of` for the last ones.
WIRE_X, WIRE_Y, WIRE_EX, WIRE_EY, WIRE_LENGTH = range(5)
WIRE_Z_START, WIRE_CHORD, WIRE_CURVATURE, WIRE_U0, WIRE_Z0 = range(5, 10)
WIRE_V0, WIRE_V1, WIRE_SWING = range(10, 13)
WIRE_LOW, WIRE_TOP, WIRE_BEND, WIRE_FOURTH, WIRE_FLAT, WIRE_SPACE = range(13, 19)
NEWTON_STARTS = 24  # steps along a wire where its distance may have several minima
NEWTON_ROUNDS, NEWTON_EARLY = 60, 12  # of Newton's method, the early ones without halving
NEWTON_LAST_STEP = 1e-5  # metres along the wire: a smaller step of Newton's method is the last


@kernel
def _place(w, u):
    """Offset and height of a wire at u, and the first two derivatives of the height."""
    grown = math.expm1(w[WIRE_CURVATURE] * (u - w[WIRE_U0]))
    rise = 0.5 * (grown + grown / (1.0 + grown))  # sinh, and cosh less one below: exact if small
    hung = 0.5 * grown * grown / (1.0 + grown)
    z = w[WIRE_Z0] + hung / w[WIRE_CURVATURE]
    chord = w[WIRE_Z_START] + w[WIRE_CHORD] * u
    return (
        w[WIRE_V0] + w[WIRE_V1] * u + w[WIRE_SWING] * (chord - z),
        z,
        rise,
        w[WIRE_CURVATURE] * (1.0 + hung),
    )


@kernel
def _slope(w, u, p, q, h, tall):
    """Half the derivative of the squared distance at u, and the derivative of that.

    `tall` is 1 for the distance in space and 0 for that in plan.
    """
    v, z, rise, curve = _place(w, u)
    aside = w[WIRE_V1] + w[WIRE_SWING] * (w[WIRE_CHORD] - rise)
    first = (u - p) + (v - q) * aside + tall * (z - h) * rise
    second = 1.0 + aside * aside - (v - q) * w[WIRE_SWING] * curve
    second += tall * (rise * rise + (z - h) * curve)
    return first, second


@kernel
def _within(w, low, high, start, p, q, h, tall):
    """The u between low and high with the least distance, by Newton's method within the bounds.

    Where Newton's method does not converge early, the interval is halved.
    """
    u = min(max(start, low), high)
    for k in range(NEWTON_ROUNDS):
        first, second = _slope(w, u, p, q, h, tall)
        if first > 0.0:
            high = u
        else:
            low = u
        step = -first / second if second > 0.0 else -math.copysign(math.inf, first)
        fresh = min(max(u + step, low), high) if k < NEWTON_EARLY else 0.5 * (low + high)
        if abs(fresh - u) < NEWTON_LAST_STEP:
            return fresh
        u = fresh
    return u


@kernel
def _nearest(w, p, q, h):
    """The u of the point of a wire nearest to a point p along its axis, q to its left, at height h.

    The squared distance has one minimum if the point is nearer to all of the wire than this is
    bent; else several starting points along the wire are tried.
    """
    length = w[WIRE_LENGTH]
    away = max(abs(w[WIRE_TOP] - h), abs(w[WIRE_Z0] - h)) + abs(w[WIRE_SWING] * q)
    if away * w[WIRE_BEND] < 0.9:
        return _within(w, 0.0, length, p, p, q, h, 1.0)
    best, least = 0, math.inf
    for i in range(NEWTON_STARTS + 1):
        u = length * i / NEWTON_STARTS
        v, z, _, _ = _place(w, u)
        square = (u - p) ** 2 + (v - q) ** 2 + (z - h) ** 2
        if square < least:
            best, least = i, square
    low, high = (
        length * max(best - 1, 0) / NEWTON_STARTS,
        length * min(best + 1, NEWTON_STARTS) / NEWTON_STARTS,
    )
    return _within(w, low, high, length * best / NEWTON_STARTS, p, q, h, 1.0)


@kernel
def _along_axis(w, x, y):
    """Coordinates of a position in plan along the axis of a wire and to its left."""
    dx, dy = x - w[WIRE_X], y - w[WIRE_Y]
    return dx * w[WIRE_EX] + dy * w[WIRE_EY], dy * w[WIRE_EX] - dx * w[WIRE_EY]


@kernel
def _in_space(w, x, y, z):
    """Distance of a point from a wire in space, and u of the nearest point of the wire."""
    p, q = _along_axis(w, x, y)
    u = _nearest(w, p, q, z)
    v, height, _, _ = _place(w, u)
    return math.sqrt((u - p) ** 2 + (v - q) ** 2 + (height - z) ** 2), u


@kernel
def _in_plan(w, x, y, z):
    """Vertical and horizontal distance where a wire is nearest in plan; positive below the wire."""
    p, q = _along_axis(w, x, y)
    u = _within(w, 0.0, w[WIRE_LENGTH], p, p, q, z, 0.0)
    v, height, _, _ = _place(w, u)
    return height - z, math.hypot(u - p, v - q)


@kernel
def _at_least(w, x, y, z):
    """Lower bounds of the squared distances of a point from a wire, in space and in plan.

    A wire whose slopes are at most s is no nearer to a point than its distance square to the axis
    over sqrt(1 + s^2); beyond an end, the distance along the axis from the end is added. The height
    is only bounded, by the series of cosh and its remainder, which is several times as fast.
    """
    p, q = _along_axis(w, x, y)
    u = min(max(p, 0.0), w[WIRE_LENGTH])
    square = (u - w[WIRE_U0]) ** 2
    low = w[WIRE_Z0] + w[WIRE_CURVATURE] * square * (
        0.5 + w[WIRE_CURVATURE] ** 2 * square * (1 / 24)
    )
    spare = w[WIRE_FOURTH] * square**2
    chord = w[WIRE_Z_START] + w[WIRE_CHORD] * u
    beside = (
        abs(w[WIRE_V0] + w[WIRE_V1] * u + w[WIRE_SWING] * (chord - low) - q)
        - abs(w[WIRE_SWING]) * spare
    )
    above = max(low - z, z - low - spare, 0.0) ** 2
    beside, past = max(beside, 0.0) ** 2, (p - u) ** 2
    return past + (beside + above) * w[WIRE_SPACE], past + beside * w[WIRE_FLAT]


@kernel
def distances(first, last, xyz, wire, result):
    """Fill in space, vertical and horizontal distances of points first..last from a wire, and u."""
    for i in range(first, last):
        result[i, 0], result[i, 3] = _in_space(wire, xyz[i, 0], xyz[i, 1], xyz[i, 2])
        result[i, 1], result[i, 2] = _in_plan(wire, xyz[i, 0], xyz[i, 1], xyz[i, 2])


@kernel
def _judged(rule, space, tall, flat):
    """Distance measured by a rule and its ratio to the threshold; infinite if the rule is kept."""
    value, other = space, 0.0
    if rule[0] == 1:
        value, other = tall, flat
    elif rule[0] == 2:
        value, other = flat, tall
    if value >= rule[1] or other > rule[2]:
        return value, math.inf
    return value, max(value / rule[1], other / rule[2] if other > 0 else 0.0)


@kernel
def _matters(kind, old, ratio, rules, masks):
    """Distance in space beyond which no rule is broken worse than rule `old` at the given ratio."""
    farthest = 0.0
    for r in range(len(rules)):
        if rules[r, 0] == 0 and masks[r] >> kind & 1:
            if rules[r, 3] < rules[old, 3]:
                farthest = max(farthest, rules[r, 1])
            elif rules[r, 3] == rules[old, 3]:
                farthest = max(farthest, rules[r, 1] * ratio)
    return farthest


@kernel
def _wires_near(x, y, cells, starts, candidates):
    """Indices of the wires near the lattice cell of a position."""
    column, row = int((x - cells[0]) // cells[2]), int((y - cells[1]) // cells[2])
    if column < 0 or row < 0 or column >= cells[3] or row >= cells[4]:
        return candidates[:0]
    cell = row * int(cells[3]) + column
    return candidates[starts[cell] : starts[cell + 1]]


@kernel
def _bound(wires, near, x, y, z, least, limit, bounds):
    """Fill in the lower bounds of the distances to several wires; the index of the least one.

    Infinite for those that are higher above the point than it matters: `limit`, or `least` of the
    wire if that is more.
    """
    nearest = 0
    for j in range(len(near)):
        k = near[j]
        if wires[k, WIRE_LOW] - z >= max(limit, least[k]):
            bounds[j, 0] = bounds[j, 1] = math.inf
            continue
        bounds[j, 0], bounds[j, 1] = _at_least(wires[k], x, y, z)
        if bounds[j, 0] < bounds[nearest, 0]:
            nearest = j
    return nearest


@kernel
def check(
    first,
    last,
    xyz,
    kind,
    cells,
    starts,
    candidates,
    wires,
    rules,
    masks,
    far,
    reach,
    own,
    real,
    least,
    who,
):
    """Find the worst broken rule of each point, and the nearest point of each kind to each wire.

    Parameters
    ----------
    xyz, kind : n points and their kinds; a kind below zero takes no part
    cells : west, south, size, columns and rows of the lattice of candidates
    starts, candidates : the wires that are near each of its cells
    wires : array of shape (m, 19)
    rules : array of shape (r, 4): direction, threshold, within, rank of severity
    masks : array of shape (r,), bits of the kinds that a rule holds for
    far : array of shape (kinds, 2): distances in space and in plan from which no rule matters
    reach : distance in plan up to which the nearest points are looked for
    own : array of shape (n, 2): the wire and rule of each point, -1 for none
    real : array of shape (n, 6): measure and its ratio to the threshold, or that of the other
        distance to `within` if it is larger; distance in space, vertical and horizontal, and u
    least, who : arrays of shape (m, kinds): least distance in space, and the point that has it, of
        those within `reach`
    """
    bounds = np.empty((len(wires), 2))
    for i in range(first, last):
        own[i, 0] = own[i, 1] = -1
        real[i, 2] = math.inf
        x, y, z, what = xyz[i, 0], xyz[i, 1], xyz[i, 2], kind[i]
        if what < 0:
            continue
        near = _wires_near(x, y, cells, starts, candidates)
        limit = far[what, 0]
        highest = limit if far[what, 1] == 0 else math.inf  # a vertical rule may reach up farther
        nearest = _bound(wires, near, x, y, z, least[:, what], highest, bounds)
        for step in range(len(near)):  # the nearest first, so that few others can be worse
            j = nearest + step if nearest + step < len(near) else nearest + step - len(near)
            k = near[j]
            close = bounds[j, 1] < far[what, 1] ** 2
            farthest = limit
            if bounds[j, 1] <= reach * reach:
                farthest = max(limit, least[k, what])
            if bounds[j, 0] >= farthest * farthest and not close:
                continue
            space, u = _in_space(wires[k], x, y, z)
            if space >= farthest and not close:
                continue
            vertical, flat = _in_plan(wires[k], x, y, z)
            if flat <= reach and space < least[k, what]:
                least[k, what], who[k, what] = space, i
            if own[i, 1] < 0 and space < real[i, 2]:
                own[i, 0] = k
                real[i, 2], real[i, 3], real[i, 4], real[i, 5] = space, vertical, flat, u
                limit = min(limit, space)
            for r in range(len(rules)):
                if not masks[r] >> what & 1:
                    continue
                value, ratio = _judged(rules[r], space, abs(vertical), flat)
                old = own[i, 1]
                if math.isinf(ratio):
                    continue
                if old >= 0 and (rules[old, 3], real[i, 1]) <= (rules[r, 3], ratio):
                    continue
                own[i, 0], own[i, 1] = k, r
                real[i, 0], real[i, 1] = value, ratio
                real[i, 2], real[i, 3], real[i, 4], real[i, 5] = space, vertical, flat, u
                limit = _matters(what, r, ratio, rules, masks)


@kernel
def sweep(first, last, xyz, kind, cells, starts, candidates, high, low, reach, least, beside):
    """Find distances of points from the sheets that wires sweep between two curvatures.

    A point at a height that the wire takes is as far from the sheet as it is beside it; all others
    are nearest to its edges, and not looked at here.

    Parameters
    ----------
    high, low : arrays of shape (m, 19), the wires at their highest and at their lowest
    reach : farthest to the side, metres
    least : array of shape (m, kinds), least distance of each wire
    beside : array of shape (n,), least distance of each point
    """
    for i in range(first, last):
        x, y, z, what = xyz[i, 0], xyz[i, 1], xyz[i, 2], kind[i]
        if what < 0:
            continue
        for k in _wires_near(x, y, cells, starts, candidates):
            w = high[k]
            if z < low[k, WIRE_LOW] or z > w[WIRE_TOP]:
                continue
            u, q = _along_axis(w, x, y)
            if u < 0.0 or u > w[WIRE_LENGTH]:
                continue
            if z > _place(w, u)[1] or z < _place(low[k], u)[1]:
                continue
            chord = w[WIRE_Z_START] + w[WIRE_CHORD] * u
            v = w[WIRE_V0] + w[WIRE_V1] * u + w[WIRE_SWING] * (chord - z)
            away = abs(v - q) / math.sqrt((1.0 + w[WIRE_V1] ** 2) * (1.0 + w[WIRE_SWING] ** 2))
            if away <= reach:
                least[k, what] = min(least[k, what], away)
                beside[i] = min(beside[i], away)


@kernel
def falls(first, last, xyz, foot, cells, starts, candidates, wires, own, real):
    """Fill in the wire nearest to the foot of each tree, its distance from there, and u.

    Parameters
    ----------
    xyz : tops of n trees
    foot : array of shape (n,), height of the ground below each
    own : array of shape (n,), the wire that it comes nearest to, -1 for none
    real : array of shape (n, 2), distance of that wire from the foot, and u
    """
    for i in range(first, last):
        own[i], real[i, 0] = -1, math.inf
        for k in _wires_near(xyz[i, 0], xyz[i, 1], cells, starts, candidates):
            space, u = _in_space(wires[k], xyz[i, 0], xyz[i, 1], foot[i])
            if space < real[i, 0]:
                own[i], real[i, 0], real[i, 1] = k, space, u
