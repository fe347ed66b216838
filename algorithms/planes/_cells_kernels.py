"""Compiled loops of :mod:`algorithms.planes._cells`: an octree in the order of its keys."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel
from algorithms.shared.kernels.covariance import eigen
from algorithms.shared.kernels.sorting import first_at

LEVELS = 20  # of the octree: a millionth of its side
FEWEST = 8  # points that make a normal
SURE = 0.02  # least variance over the middle one, of points that are a plane for certain


@kernel
def keys(first, last, xyz, low, side, found):
    """Fill in the keys of points: positions along a curve through the octree (Morton 1966)."""
    fine = (1 << LEVELS) / side
    top = (1 << LEVELS) - 1
    for i in range(first, last):
        key = np.uint64(0)
        for axis in range(3):
            place = np.uint64(min(top, max(0, int((xyz[i, axis] - low[axis]) * fine))))
            key |= _spread(place) << np.uint64(axis)
        found[i] = key


@helper
def _spread(bits):
    """The low bits of a number with two zero bits between each two."""
    bits &= np.uint64(0x1FFFFF)
    bits = (bits | bits << np.uint64(32)) & np.uint64(0x1F00000000FFFF)
    bits = (bits | bits << np.uint64(16)) & np.uint64(0x1F0000FF0000FF)
    bits = (bits | bits << np.uint64(8)) & np.uint64(0x100F00F00F00F00F)
    bits = (bits | bits << np.uint64(4)) & np.uint64(0x10C30C30C30C30C3)
    return (bits | bits << np.uint64(2)) & np.uint64(0x1249249249249249)


@kernel
def leaves(sorted_keys, most, deepest, starts, levels):
    """Split cells until each holds at most `most` points or is at the level `deepest`.

    Fills in where the points of each leaf begin, and its level; returns their number.
    """
    held = np.empty((8 * LEVELS + 8, 3), np.int64)
    held[0, 0], held[0, 1], held[0, 2] = 0, len(sorted_keys), 0
    waiting, found = 1, 0
    while waiting > 0:
        waiting -= 1
        start, stop, level = held[waiting]
        if stop - start <= most or level >= deepest:
            starts[found], levels[found] = start, level
            found += 1
            continue
        shift = np.uint64(3 * (LEVELS - level - 1))
        base = (sorted_keys[start] >> shift) & ~np.uint64(7)
        end = stop
        for child in range(7, -1, -1):  # the first child is to come off the stack first
            begin = first_at(sorted_keys, (base | np.uint64(child)) << shift, start, end)
            if begin < end:
                held[waiting, 0], held[waiting, 1], held[waiting, 2] = begin, end, level + 1
                waiting += 1
                end = begin
    return found


@kernel
def at_scales(some, xyz, keys, starts, levels, piece, found):
    """Fill in the middle and least variance of leaves and of the cells above, and within them.

    Parameters
    ----------
    some : array of shape (k,), leaves
    piece : points of a piece of a leaf; 0 to look at none
    found : array of shape (k, 6) to fill, the last two with the median of the least variances of
        the pieces of the leaf, and the variance between neighbours in the cell above; infinity
        where there are too few points
    """
    for k in range(len(some)):
        leaf = some[k]
        start, stop = starts[leaf], starts[leaf + 1]
        found[k] = np.inf
        for step in range(2):
            if step > 0:
                start, stop = _above(keys, start, stop, levels[leaf] - step)
            if stop - start >= FEWEST:
                middle, least, x, y, z = _axes(xyz, start, stop)
                found[k, 2 * step], found[k, 2 * step + 1] = middle, least
                if step > 0:
                    found[k, 5] = between_neighbours(xyz[start:stop], x, y, z)
        start, stop = starts[leaf], starts[leaf + 1]
        count = (stop - start) // piece if piece > 0 else 0
        if count > 1:
            within = np.empty(count)
            for k_piece in range(count):
                first = start + k_piece * piece
                _, least, _, _, _ = _axes(xyz, first, first + piece)
                within[k_piece] = least
            found[k, 4] = np.median(within)


@kernel
def between_neighbours(xyz, x, y, z):
    """Variance across a plane that neighbours on it do not have in common (von Neumann 1941).

    Parameters
    ----------
    xyz : array of shape (n, 3)
    x, y, z : normal of the plane
    """
    step = steps_across(xyz, x, y, z)
    return np.sum(step**2) / (2 * len(step))


@kernel
def steps_across(xyz, x, y, z):
    """Differences of neighbours across a plane, array of shape (n - 1,).

    Neighbours follow each other in strips along the plane, forth and back. They are chosen by
    their place on the plane alone, so that they differ across it as any two do, if it is noise.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    x, y, z : normal of the plane
    """
    count = len(xyz)
    normal = np.array([x, y, z])
    first = np.zeros(3)
    first[np.argmin(np.abs(normal))] = 1.0
    first = np.cross(normal, first)
    first /= np.sqrt(np.sum(first**2))
    second = np.cross(normal, first)
    along, strip, across = np.empty(count), np.empty(count), np.empty(count)
    for i in range(count):
        along[i] = strip[i] = across[i] = 0.0
        for axis in range(3):
            away = xyz[i, axis] - xyz[0, axis]
            strip[i] += away * first[axis]
            along[i] += away * second[axis]
            across[i] += away * normal[axis]
    low, high = strip.min(), strip.max()
    length = along.max() - along.min()
    strips = max(1, int(np.sqrt(count) / 2))
    for i in range(count):
        number = min(strips - 1, int(strips * (strip[i] - low) / max(high - low, 1e-300)))
        turn = 1.0 if number % 2 == 0 else -1.0
        strip[i] = 3.0 * number * length + turn * along[i]
    order = np.argsort(strip)
    step = np.empty(count - 1)
    for i in range(count - 1):
        step[i] = across[order[i + 1]] - across[order[i]]
    return step


@helper
def _above(keys, start, stop, level):
    """First and last index of the points in the cell of a given level that holds a smaller cell."""
    if level < 0:
        return start, stop
    shift = np.uint64(3 * (LEVELS - level))
    base = keys[start] >> shift
    first = first_at(keys, base << shift, 0, start)
    return first, first_at(keys, (base + np.uint64(1)) << shift, stop, len(keys))


@kernel
def describe(first, last, xyz, keys, starts, levels, up, centres, normals, spread, reach):
    """Fill in centre, normal, variances and bounding box of the leaves first..last.

    A leaf with few points, or with points that are no plane, takes the normal of the cell around
    it, at most `up` levels up.

    Parameters
    ----------
    first, last : leaves
    xyz : array of shape (n, 3), sorted
    centres, normals : arrays of shape (m, 3) to fill
    spread : array of shape (m, 2) to fill: middle and least variance of the cell of the normal
    reach : array of shape (m, 6) to fill: lowest and highest coordinates of the leaf's points
    """
    for leaf in range(first, last):
        start, stop = starts[leaf], starts[leaf + 1]
        for axis in range(3):
            total, low, high = 0.0, np.inf, -np.inf
            for i in range(start, stop):
                total += xyz[i, axis]
                low, high = min(low, xyz[i, axis]), max(high, xyz[i, axis])
            centres[leaf, axis] = total / (stop - start)
            reach[leaf, axis], reach[leaf, 3 + axis] = low, high
        best = np.inf
        normals[leaf] = np.nan
        spread[leaf] = np.inf
        for step in range(min(up, levels[leaf]) + 1):
            if step > 0:
                start, stop = _above(keys, start, stop, levels[leaf] - step)
            if stop - start < FEWEST:
                continue
            middle, least, x, y, z = _axes(xyz, start, stop)
            if middle > 0.0 and least / middle < best:
                best = least / middle
                normals[leaf, 0], normals[leaf, 1], normals[leaf, 2] = x, y, z
                spread[leaf, 0], spread[leaf, 1] = middle, least
            if best < SURE:
                break


@helper
def _axes(xyz, start, stop):
    """Middle and least variance of points, and the normal of their plane."""
    count = stop - start
    mx = my = mz = 0.0
    for i in range(start, stop):
        mx, my, mz = mx + xyz[i, 0], my + xyz[i, 1], mz + xyz[i, 2]
    mx, my, mz = mx / count, my / count, mz / count
    xx = xy = xz = yy = yz = zz = 0.0
    for i in range(start, stop):
        x, y, z = xyz[i, 0] - mx, xyz[i, 1] - my, xyz[i, 2] - mz
        xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
        yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
    _, middle, least, a, b, c = eigen(
        xx / count, xy / count, xz / count, yy / count, yz / count, zz / count
    )
    return middle, least * count / (count - 3), a, b, c
