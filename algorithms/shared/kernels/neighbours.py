"""Compiled loops of :mod:`algorithms.shared.neighbours`: a balanced k-d tree in flat arrays.

Node j of level l holds the points from ``first(j, l, n)`` to ``first(j + 1, l, n)`` of the
reordered cloud. Its box is number ``2**l + j``, so the children of box b are 2b and 2b + 1.
"""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import exact_sums, helper, kernel

DEEPEST = 64  # levels: more than any memory holds
SOME = 64  # points of a node that tell its widest axis; with all, a tree takes a fourth longer
ROUNDING = 1e-9  # share by which a bound made of two square roots is widened
ROOM = 2048  # points that are copied around a leaf at most: what the nearest cache holds
PROBES = 12  # tries to part the nearest from the rest; equal distances cannot be parted


@helper
def first(node, level, n):
    """Index of the first point of a node."""
    return (node * n) >> level


@helper
def leaf_of(own, depth, n):
    """The leaf of a point: the last that begins at or before it."""
    return (((own + 1) << depth) - 1) // n


# Building ----------------------------------------------------------------------------------


@kernel
def split(first_node, last_node, xyz, order, level):
    """Split nodes of a level at the median of their widest axis (in place)."""
    n = len(xyz)
    for node in range(first_node, last_node):
        start, stop = first(node, level, n), first(node + 1, level, n)
        middle = first(2 * node + 1, level + 1, n)
        _part(xyz, order, start, stop, middle, _widest(xyz, start, stop))


@helper
def _widest(xyz, start, stop):
    """Axis along which the points extend farthest, by some of them."""
    axis, width = 0, -1.0
    step = 1 + (stop - start) // SOME
    for a in range(3):
        low = high = xyz[start, a]
        for i in range(start + step, stop, step):
            low, high = min(low, xyz[i, a]), max(high, xyz[i, a])
        if high - low > width:
            axis, width = a, high - low
    return axis


@helper
def _part(xyz, order, start, stop, middle, axis):
    """Partition points so that none before index `middle` is above any after it (Hoare 1961)."""
    low, high = start, stop - 1
    while low < high:
        a, b, c = xyz[low, axis], xyz[(low + high) >> 1, axis], xyz[high, axis]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = low, high
        while i <= j:
            while xyz[i, axis] < pivot:
                i += 1
            while xyz[j, axis] > pivot:
                j -= 1
            if i <= j:
                for k in range(3):
                    xyz[i, k], xyz[j, k] = xyz[j, k], xyz[i, k]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@kernel
def boxes(xyz, depth):
    """Bounding boxes of all nodes, array of shape (2**(depth + 1), 6)."""
    n = len(xyz)
    box = np.empty((2 << depth, 6))
    for leaf in range(1 << depth):
        here = box[(1 << depth) + leaf]
        here[:3], here[3:] = np.inf, -np.inf
        for i in range(first(leaf, depth, n), first(leaf + 1, depth, n)):
            for a in range(3):
                here[a], here[3 + a] = min(here[a], xyz[i, a]), max(here[3 + a], xyz[i, a])
    for node in range((1 << depth) - 1, 0, -1):
        for a in range(3):
            box[node, a] = min(box[2 * node, a], box[2 * node + 1, a])
            box[node, 3 + a] = max(box[2 * node, 3 + a], box[2 * node + 1, 3 + a])
    return box


# Distances ---------------------------------------------------------------------------------


@helper
def _beyond(low, high, at):
    """Squared distance of a number from an interval, 0 inside."""
    under, over = low - at, at - high
    most = under if under > over else over
    return most * most if most > 0.0 else 0.0


@helper
def away(box, node, x, y, z):
    """Squared distance of a position from the box of a node."""
    flat = _beyond(box[node, 0], box[node, 3], x) + _beyond(box[node, 1], box[node, 4], y)
    return flat + _beyond(box[node, 2], box[node, 5], z)


@helper
def _scan(xyz, start, stop, own, far, seen, seen_far, count):
    """Merge the squared distances of a leaf's points from point `own` into the smallest so far."""
    x, y, z = xyz[own, 0], xyz[own, 1], xyz[own, 2]
    last = len(far) - 1
    for i in range(start, stop):
        dx, dy, dz = xyz[i, 0] - x, xyz[i, 1] - y, xyz[i, 2] - z
        d = dx * dx + dy * dy + dz * dz
        if d <= far[0] and i != own:
            if count < len(seen):
                seen[count], seen_far[count] = i, d
            count += 1
            # All elements are computed without a branch, so the processor can do it in parallel.
            for j in range(last):
                kept = d if d < far[j] else far[j]
                far[j] = kept if kept > far[j + 1] else far[j + 1]
            far[last] = d if d < far[last] else far[last]
    return count


@helper
def search(xyz, box, depth, leaf, own, far, held, held_away, seen, seen_far):
    """Fill in the squared distances from point `own` to its nearest points, the largest first.

    The search goes from the leaf up to the root, and down into what else may hold a nearer point.

    `far` comes filled with a bound that the distances must be below; where there are too few
    points it keeps the bound. `held` and `held_away` are scratch for DEEPEST nodes.

    Points that were among the nearest so far when they were met, and hence all those that no other
    is nearer than, are noted in `seen` with their squared distances, as far as these are long
    enough; returns how many there were.
    """
    n = len(xyz)
    x, y, z = xyz[own, 0], xyz[own, 1], xyz[own, 2]
    start, stop = first(leaf, depth, n), first(leaf + 1, depth, n)
    count = _scan(xyz, start, stop, own, far, seen, seen_far, 0)
    node = (1 << depth) + leaf
    while node > 1:
        here = node ^ 1
        d = away(box, here, x, y, z)
        waiting = 0
        while True:
            if d <= far[0]:
                if here >> depth:
                    other = here - (1 << depth)
                    start, stop = first(other, depth, n), first(other + 1, depth, n)
                    count = _scan(xyz, start, stop, own, far, seen, seen_far, count)
                else:
                    near, other = 2 * here, 2 * here + 1
                    d, d_other = away(box, near, x, y, z), away(box, other, x, y, z)
                    if d_other < d:
                        near, other, d, d_other = other, near, d_other, d
                    held[waiting], held_away[waiting] = other, d_other
                    waiting += 1
                    here = near
                    continue
            if waiting == 0:
                break
            waiting -= 1
            here, d = held[waiting], held_away[waiting]
        node >>= 1
    return count


# Nearest points of all points of a leaf ------------------------------------------------------


@helper
def around(xyz, box, depth, leaf, reach, held, near, index):
    """Copy the points of all leaves within `reach` of a leaf; their number, -1 if there is no room.

    One walk through the tree for all points of the leaf, whose distances can be computed several at
    once then: `near` has a row each for x, y and z.
    """
    n, own = len(xyz), box[(1 << depth) + leaf]
    count, waiting, limit = 0, 1, reach * reach
    held[0] = 1
    while waiting > 0:
        waiting -= 1
        here, gap = held[waiting], 0.0
        for a in range(3):
            gap += max(box[here, a] - own[3 + a], 0.0, own[a] - box[here, 3 + a]) ** 2
        if gap > limit:
            continue
        if not here >> depth:
            held[waiting], held[waiting + 1] = 2 * here, 2 * here + 1
            waiting += 2
            continue
        other = here - (1 << depth)
        start, stop = first(other, depth, n), first(other + 1, depth, n)
        if count + stop - start > len(index):
            return -1
        for i in range(start, stop):
            near[0, count], near[1, count], near[2, count] = xyz[i, 0], xyz[i, 1], xyz[i, 2]
            index[count] = i
            count += 1
    return count


@helper
def among(near, count, place, k, limit, squared, kept):
    """Squared distance of the k-th nearest of some points from a place; -1 if it is not clear.

    It is not if fewer than k are within `limit` (squared), or others are as near as the k-th. The
    places in `near` of those within the limit are put into `kept`, and their squared distances into
    `squared`; returns their number as well.
    """
    east, north, up = near[0], near[1], near[2]
    x, y, z = place[0], place[1], place[2]
    for j in range(count):
        dx, dy, dz = east[j] - x, north[j] - y, up[j] - z
        squared[j] = dx * dx + dy * dy + dz * dz
    few = 0
    for j in range(count):  # without a branch, which the processor could not foresee
        d = squared[j]
        squared[few], kept[few] = d, j
        few += d <= limit
    if few < k:
        return -1.0, few
    return _parted(squared[:few], k, limit), few


@helper
def _parted(squared, k, limit):
    """The k-th smallest of numbers up to a limit; -1 if no number parts k of them from the rest."""
    low, high, below, up_to = 0.0, limit, 0, len(squared)
    for probe in range(PROBES):
        if up_to == k:
            return _largest(squared, high)
        # Numbers are spread about evenly: by turns where k of them should end, and in the middle.
        share = 0.5 if probe & 1 else (k - 0.5 - below) / (up_to - below)
        middle = low + (high - low) * share
        count = _number(squared, middle)
        if count < k:
            low, below = middle, count
        else:
            high, up_to = middle, count
    return -1.0


@exact_sums
def _number(values, limit):
    """How many values are at most the limit."""
    count = np.int64(0)
    for value in values:
        count += np.int64(value <= limit)
    return count


@exact_sums
def _largest(values, limit):
    """The largest of the values that are at most the limit."""
    most = 0.0
    for value in values:
        small = value if value <= limit else 0.0
        most = small if small > most else most
    return most


@kernel
def mean_distances(first_leaf, last_leaf, xyz, box, depth, k, reach, mean, farthest):
    """Fill in the mean and largest distance to the k nearest points, for the points of some leaves.

    A neighbour that is missing within `reach` counts as being that far away.
    """
    n = len(xyz)
    far, held, held_away = np.empty(k), np.empty(DEEPEST, np.int64), np.empty(DEEPEST)
    for leaf in range(first_leaf, last_leaf):
        start = first(leaf, depth, n)
        for own in range(start, first(leaf + 1, depth, n)):
            known = own - 1 if own > start else -1
            mean[own], farthest[own] = mean_distance(
                xyz, box, depth, leaf, own, known, farthest, reach, far, held, held_away
            )


@helper
def mean_distance(xyz, box, depth, leaf, own, known, farthest, reach, far, held, held_away):
    """Mean and largest distance of a point to its nearest, as many as `far` holds the squares of.

    A neighbour that is missing within `reach` counts as being that far away. `known` is a point
    near by whose largest distance is known, -1 if there is none.
    """
    bound = reach
    if known >= 0:  # what is near that point cannot be far from this one
        step = 0.0
        for a in range(3):
            step += (xyz[own, a] - xyz[known, a]) ** 2
        bound = min(reach, (farthest[known] + np.sqrt(step)) * (1.0 + ROUNDING))
    far[:] = bound * bound
    if bound == 0.0:  # no distance is below zero, so more points than k share this place
        return 0.0, 0.0
    search(xyz, box, depth, leaf, own, far, held, held_away, held[:0], far[:0])
    total = 0.0
    for j in range(len(far)):
        total += np.sqrt(far[j])
    return total / len(far), np.sqrt(far[0])


# Neighbours --------------------------------------------------------------------------------


@helper
def _before(x, y, z, place):
    """Whether (x, y, z) precedes a position in the order of x, then y, then z."""
    if x != place[0]:
        return x < place[0]
    if y != place[1]:
        return y < place[1]
    return z < place[2]


@helper
def _enter(xyz, i, d, near, far):
    """Insert point i at squared distance d into the nearest; of equal ones x, y, z decide."""
    x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
    at = len(near)
    while at > 0 and (
        near[at - 1] < 0
        or d < far[at - 1]
        or (d == far[at - 1] and _before(x, y, z, xyz[near[at - 1]]))
    ):
        at -= 1
        if at + 1 < len(near):
            far[at + 1], near[at + 1] = far[at], near[at]
    if at < len(near):
        far[at], near[at] = d, i


@helper
def gather(xyz, box, depth, own, limit, near, far, held):
    """Fill in the nearest points of point `own` within `limit` (squared); their number.

    Of points equally near to the last those that come first by x, y, z are taken.
    """
    n, last = len(xyz), len(near) - 1
    x, y, z = xyz[own, 0], xyz[own, 1], xyz[own, 2]
    near[:], far[:] = -1, np.inf
    held[0], waiting = 1, 1
    while waiting > 0:
        waiting -= 1
        here = held[waiting]
        corner, d = box[here], away(box, here, x, y, z)
        if d > limit or d > far[last]:
            continue
        if d == far[last] and not _before(corner[0], corner[1], corner[2], xyz[near[last]]):
            continue
        if here >> depth:
            leaf = here - (1 << depth)
            for i in range(first(leaf, depth, n), first(leaf + 1, depth, n)):
                dx, dy, dz = xyz[i, 0] - x, xyz[i, 1] - y, xyz[i, 2] - z
                d = dx * dx + dy * dy + dz * dz
                if d <= limit and d <= far[last] and i != own:
                    _enter(xyz, i, d, near, far)
        else:
            held[waiting], held[waiting + 1] = 2 * here, 2 * here + 1
            waiting += 2
    found = 0
    while found <= last and near[found] >= 0:
        found += 1
    return found


@helper
def nearest(xyz, box, depth, leaf, own, reach, near, far, held, held_away):
    """Fill in the nearest points of point `own` that are nearer than `reach`; their number."""
    far[:] = reach * reach
    search(xyz, box, depth, leaf, own, far, held, held_away, near[:0], far[:0])
    limit = far[0]
    if limit >= reach * reach:  # fewer than wanted: all of those nearer than the reach
        limit = np.nextafter(reach * reach, 0.0)
    return gather(xyz, box, depth, own, limit, near, far, held)
