"""Compiled loops of :mod:`algorithms.classify._som`.

The weights of the neurons come as columns, shape (features, neurons): then the processor works on
several neurons at once.
"""

from __future__ import annotations

import math

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel

ROUNDING = 1e-9  # by which bounds of distances are widened


@helper
def _distances(data, i, weights, away):
    """Fill in the squared distances of a point from all neurons, in feature space."""
    x = data[i, 0]
    for j in range(len(away)):
        away[j] = (x - weights[0, j]) ** 2
    for f in range(1, len(weights)):
        x = data[i, f]
        for j in range(len(away)):
            away[j] += (x - weights[f, j]) ** 2


@helper
def _two_nearest(away):
    """Indices of the nearest and the second nearest neuron; the first of those equally near."""
    best, second = 0, 0
    near, next_near = math.inf, math.inf
    for j in range(len(away)):
        d = away[j]
        if d < next_near:
            if d < near:
                second, next_near = best, near
                best, near = j, d
            else:
                second, next_near = j, d
    return best, second


@kernel
def assign(first, last, data, steps, weights, moved, most, best, upper, lower, sums, counts):
    """Assign points to their nearest neurons, and update the sums and counts of each neuron.

    A point is within `upper` of its neuron and not within `lower` of any other, as far as the
    neurons have `moved` since that was found; `most` is the largest move. Only points for which
    that does not settle the matter are looked at (Hamerly 2010). `steps` are the data as whole
    numbers, of which the sums are exact.
    """
    width = data.shape[1]
    away = np.empty(len(moved))
    for i in range(first, last):
        old = best[i]
        if old >= 0:
            upper[i] += moved[old]
            lower[i] -= most
            if upper[i] < lower[i]:
                continue
            total = 0.0
            for f in range(width):
                total += (data[i, f] - weights[f, old]) ** 2
            upper[i] = math.sqrt(total) * (1.0 + ROUNDING)
            if upper[i] < lower[i]:
                continue
        _distances(data, i, weights, away)
        new, second = _two_nearest(away)
        upper[i] = math.sqrt(away[new]) * (1.0 + ROUNDING)
        lower[i] = math.sqrt(away[second]) * (1.0 - ROUNDING) if second != new else math.inf
        if new == old:
            continue
        best[i] = new
        counts[new] += 1
        for f in range(width):
            sums[new, f] += steps[i, f]
        if old >= 0:
            counts[old] -= 1
            for f in range(width):
                sums[old, f] -= steps[i, f]


@kernel
def nearest(first, last, data, weights, best, second, distance):
    """Fill in the two nearest neurons of points first..last, and the distance of the nearest."""
    away = np.empty(weights.shape[1])
    for i in range(first, last):
        _distances(data, i, weights, away)
        best[i], second[i] = _two_nearest(away)
        distance[i] = math.sqrt(away[best[i]])


@kernel
def learn(order, data, pull, weights):
    """Train neurons on points one after the other (in place).

    m_i(t + 1) = m_i(t) + h_ci(t) (x(t) - m_i(t)), where h_ci is the row of `pull` of the nearest
    neuron c.
    """
    away = np.empty(weights.shape[1])
    for i in order:
        _distances(data, i, weights, away)
        winner = _two_nearest(away)[0]
        for f in range(len(weights)):
            for j in range(len(away)):
                weights[f, j] += pull[winner, j] * (data[i, f] - weights[f, j])
