"""Compiled loop of :mod:`algorithms.corridor._curves.stacks`."""

from __future__ import annotations

from algorithms.shared.kernels.compiling import kernel


@kernel
def hang(u, z, first, middle, lifts, step, gain, slot, bend, price, least, most, total, before):
    """Hang one shape from places along a stack so that most points are likely on its wires.

    Every place may be a support at any of the heights. A stretch of which the points tell nothing
    may be left out: then the shape begins anew behind it.

    Parameters
    ----------
    u, z : arrays of shape (n,), chainages of points, rising, and heights, metres
    first : array of shape (s + 1,), of the points, the first behind each place
    middle : array of shape (s + 1,), height in the middle of the points at each place
    lifts : array of shape (h,), heights above it at which the shape may be held
    step : between two places, metres
    gain : array of shape (2 g + 1,), logarithm of how much likelier a point so many slots above
        the shape is on a wire than anywhere; the slot of the shape itself is g
    slot : height of one, metres
    bend : curvature of the shape, 1 / metre
    price : of a span
    least, most : shortest and longest span, in steps
    total, before : arrays of shape (s + 1, h), filled in: most gain up to a state, and where
        the span that ends there begins, as row * h + column; -1 where none does
    """
    places, heights = total.shape
    half = len(gain) // 2
    highest = gain.max()
    idle = 0.0
    for b in range(places):
        before[b, :] = -1
        total[b, :] = idle - price
        for a in range(max(0, b - most), b - least + 1):
            length = (b - a) * step
            n = first[b] - first[a]
            for low in range(heights):
                start = total[a, low] - price
                if start + n * highest <= idle - price:
                    continue
                z0 = middle[a] + lifts[low]
                for high in range(heights):
                    slope = (middle[b] + lifts[high] - z0) / length
                    told, rest = start, n
                    for p in range(first[a], first[b]):
                        x = u[p] - a * step
                        above = z[p] - z0 - slope * x + 0.5 * bend * x * (length - x)
                        at = round(above / slot) + half
                        if 0 <= at < len(gain):
                            told += gain[at]
                        else:
                            told += gain[0]
                        rest -= 1
                        if told + rest * highest <= total[b, high]:
                            break
                    if told > total[b, high]:
                        total[b, high] = told
                        before[b, high] = a * heights + low
        idle = max(idle, total[b].max())
