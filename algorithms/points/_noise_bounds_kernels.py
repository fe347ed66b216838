"""Compiled loops of :mod:`algorithms.points._noise_bounds`.

Cells are numbered along a curve (Morton 1966): the bits of column and row by turns. `east` holds
the bits of each column and `north` those of each row, so that a cell has the sum of both.
"""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import exact_sums, helper, kernel, rough_sums

WIDEST = 3  # cells on each side of a window: where points are nine times as sparse as usual
MOST = 25  # times k points in a window; the sums of more would take longer than a search
WIDER = (1, 2, 4)  # times the window, for closer looks one after the other
MOST_CLOSER = 100  # times k points in it
HALVINGS = 6  # of a limit, until hardly more than k points are within it: bounds are tight enough
ROUNDING = 1e-6  # of a coordinate in single precision; and of distances, a thousand times as much


@kernel
def counts(xyz, west, south, cell, columns, rows):
    """Number of points in each cell, row by row."""
    found = np.zeros(columns * rows, np.int64)
    for i in range(len(xyz)):
        found[int((xyz[i, 1] - south) / cell) * columns + int((xyz[i, 0] - west) / cell)] += 1
    return found


@kernel
def sort_into_cells(xyz, west, south, cell, east, north):
    """The points along the curve, their indices, and where each cell begins among them."""
    edges = np.zeros(east[-1] + north[-1] + 3, np.int64)
    for i in range(len(xyz)):
        edges[_cell(xyz, i, west, south, cell, east, north) + 2] += 1
    for k in range(2, len(edges)):
        edges[k] += edges[k - 1]
    placed, order = np.empty_like(xyz), np.empty(len(xyz), np.int64)
    for i in range(len(xyz)):
        k = _cell(xyz, i, west, south, cell, east, north) + 1
        at = edges[k]
        placed[at, 0], placed[at, 1], placed[at, 2] = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        order[at] = i
        edges[k] += 1
    return placed, order, edges[:-1]


@helper
def _cell(xyz, i, west, south, cell, east, north):
    """Number of the cell of a point."""
    return north[int((xyz[i, 1] - south) / cell)] + east[int((xyz[i, 0] - west) / cell)]


@kernel
def bounds(first_row, last_row, xyz, edges, east, north, cell, k, reach, upper, low, wide):
    """Fill in bounds of the mean distance to the k nearest points, for some rows of cells.

    `upper` is for each point; `low`, for each cell, lies below those of all its points; `wide` is
    the number of cells on each side of the window it was found in.
    """
    near = np.empty((3, MOST * k), np.float32)
    for row in range(first_row, last_row):
        for column in range(len(east)):
            at = north[row] + east[column]
            start, stop = edges[at], edges[at + 1]
            low[at] = np.inf
            if start == stop:
                continue
            for w in range(1, WIDEST + 1):
                wide[at] = w
                count = _count(edges, east, north, row, column, w)
                if count > 2 * k:
                    break
            if count > near.shape[1]:
                low[at] = 0.0
                upper[start:stop] = np.inf
                continue
            own = _gather(xyz, edges, east, north, row, column, wide[at], near)
            step = np.float32(min(wide[at] * cell, reach))
            for j in range(start, stop):
                under, upper[j] = _bounds(near, count, own + j - start, step, k, reach)
                low[at] = min(low[at], under)


@helper
def _count(edges, east, north, row, column, w):
    """Number of points in a window."""
    count = 0
    for r in range(max(row - w, 0), min(row + w + 1, len(north))):
        for c in range(max(column - w, 0), min(column + w + 1, len(east))):
            at = north[r] + east[c]
            count += edges[at + 1] - edges[at]
    return count


@helper
def _gather(xyz, edges, east, north, row, column, w, near):
    """Copy the points of a window, relative to the first of its cell; the place of that one."""
    own, first = north[row] + east[column], 0
    x, y, z = xyz[edges[own], 0], xyz[edges[own], 1], xyz[edges[own], 2]
    count = 0
    for r in range(max(row - w, 0), min(row + w + 1, len(north))):
        for c in range(max(column - w, 0), min(column + w + 1, len(east))):
            at = north[r] + east[c]
            if at == own:
                first = count
            for i in range(edges[at], edges[at + 1]):
                near[0, count], near[1, count] = xyz[i, 0] - x, xyz[i, 1] - y
                near[2, count] = xyz[i, 2] - z
                count += 1
    return first


@helper
def _bounds(near, count, own, step, k, reach):
    """Lower and upper bound of the mean distance of a point to its k nearest.

    All points within `step` are there. The mean of the k smallest distances d is at least
    t - sum(max(t - d, 0)) / k for any t, of those within t; and where the n points within t are k
    or more, it is at most the mean of these, t - sum(max(t - d, 0)) / n.
    """
    x, y, z = near[0, own], near[1, own], near[2, own]
    half, twice = np.float32(0.5) * step, np.float32(min(2.0 * step, reach))
    of_half, of_step, of_twice, within, in_all = _sums(near, count, x, y, z, half, step, twice)
    slack = ROUNDING * (abs(x) + abs(y) + abs(z) + 1000.0 * twice)
    # The point itself, at no distance, is in all of them.
    under = max(half - (of_half - half) / k, step - (of_step - step) / k)
    over = np.inf
    if within > k:
        over = step - (of_step - step) / (within - 1)
    if in_all > k:
        over = min(over, twice - (of_twice - twice) / (in_all - 1))
    return max(under - slack, 0.0), over + slack


@rough_sums
def _sums(near, count, x, y, z, half, step, twice):
    """Sums of what distances are below three limits, and the counts within the last two."""
    nought, one = np.float32(0.0), np.float32(1.0)
    of_half, of_step, of_twice = nought, nought, nought
    within, in_all = nought, nought  # whole numbers would be widened to 64 bits
    for i in range(count):
        dx, dy, dz = near[0, i] - x, near[1, i] - y, near[2, i] - z
        d = np.sqrt(dx * dx + dy * dy + dz * dz)
        of_half += max(half - d, nought)
        of_step += max(step - d, nought)
        of_twice += max(twice - d, nought)
        within += one if d <= step else nought
        in_all += one if d <= twice else nought
    return of_half, of_step, of_twice, within, in_all


@kernel
def doubtful(
    first_row, last_row, edges, east, north, cell, ratio, upper, low, wide, lowest, within
):
    """Fill in the lower bound of all points within some distance, where it leaves a doubt.

    The distance is that of two windows. There is no doubt, and the bound becomes infinite, where
    the upper bound of a point is at most `ratio` times the lowest of the lower bounds there.
    """
    for row in range(first_row, last_row):
        for column in range(len(east)):
            at = north[row] + east[column]
            if edges[at] == edges[at + 1]:
                continue
            w, least = 2 * wide[at], np.float32(np.inf)
            for r in range(max(row - w, 0), min(row + w + 1, len(north))):
                for c in range(max(column - w, 0), min(column + w + 1, len(east))):
                    least = min(least, low[north[r] + east[c]])
            for j in range(edges[at], edges[at + 1]):
                lowest[j] = np.inf if upper[j] <= ratio * least else least
                within[j] = w * cell * (1.0 - ROUNDING)


@kernel
def closer(
    first_row, last_row, xyz, edges, east, north, cell, k, reach, ratio, few, wide, lowest, within
):
    """Look once more at the points that are in doubt, in wider windows, for some rows of cells.

    `lowest` becomes infinite for those that are in no doubt any more.
    """
    near, squared = (
        np.empty((3, MOST_CLOSER * k), np.float32),
        np.empty(MOST_CLOSER * k, np.float32),
    )
    some = np.empty(few, np.int64)
    for row in range(first_row, last_row):
        for column in range(len(east)):
            at = north[row] + east[column]
            for wider in WIDER:
                left = False
                for j in range(edges[at], edges[at + 1]):
                    left |= lowest[j] < np.inf
                if not left:
                    break
                w = wider * wide[at]
                count = _count(edges, east, north, row, column, w)
                if count > len(squared):
                    break
                own = _gather(xyz, edges, east, north, row, column, w, near) - edges[at]
                full = min(w * cell, reach)
                for j in range(edges[at], edges[at + 1]):
                    if lowest[j] < np.inf and _is_usual(
                        near,
                        squared,
                        some,
                        count,
                        own + j,
                        k,
                        full,
                        reach,
                        ratio,
                        lowest[j],
                        within[j],
                    ):
                        lowest[j] = np.inf


@helper
def _is_usual(near, squared, some, count, own, k, full, reach, ratio, lowest, within):
    """Whether a point is no noise for sure, by the points around it, all of which within `full`.

    More than half of its nearest, as many as `some` has room for, must have means that are no less
    than its own by `ratio`. Those within `within` have no less than `lowest`; means of two points
    differ by no more than what is between them; and what is left is worked out for each of them.
    """
    few, enough = len(some), len(some) // 2 + 1
    slack = _slack(near, own, full)
    under, upper, limit, number = _closely(near, squared, count, own, k, full, reach)
    if upper == np.inf:
        return False
    # The point itself, at no distance, is in all counts.
    if upper <= ratio * lowest and _number(squared, count, within - slack) > enough:
        return True
    if _number(squared, count, under * (1.0 - 1.0 / ratio) - slack) > enough:
        return True
    if number <= few:
        return False
    nearest = _limit(squared, count, few, 0.0, limit)
    limit, found = (nearest + slack) ** 2, 0
    for i in range(count):
        if squared[i] <= limit and i != own:
            if found == few:  # others are as near as the last
                return False
            some[found] = i
            found += 1
    unusual = few - found
    for i in some[:found]:
        beside = full - nearest - slack
        unusual += ratio * _closely(near, squared, count, i, k, beside, reach)[0] < upper
    return few - unusual >= enough


@helper
def _slack(near, own, full):
    """What rounding may change of distances from a point."""
    return ROUNDING * (abs(near[0, own]) + abs(near[1, own]) + abs(near[2, own]) + 1000.0 * full)


@helper
def _closely(near, squared, count, own, k, full, reach):
    """Lower and upper bound of a mean distance, a distance, and how many points are within it.

    All points within `full` are there, and so are those within the distance. The upper bound is
    infinite if fewer than k are within `reach`. Squared distances are put into `squared`.
    """
    _squares(near, count, own, squared)
    slack = _slack(near, own, full)
    if _number(squared, count, reach - slack) <= k:
        return 0.0, np.inf, 0.0, 0.0
    complete = _number(squared, count, full) > k
    limit = (
        _limit(squared, count, k, 0.0, full) if complete else _limit(squared, count, k, full, reach)
    )
    total, number = _sum(squared, count, limit)
    upper = total / (number - 1) + slack
    if not complete:
        limit = full
        total, number = _sum(squared, count, limit)
    under = limit - ((number - 1) * limit - total) / k - slack
    return max(under, 0.0), upper, limit, number


@helper
def _limit(squared, count, k, low, high):
    """A distance within which there are more than k points, and hardly more."""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _number(squared, count, middle) > k:
            high = middle
        else:
            low = middle
    return high


@helper
def _squares(near, count, own, squared):
    """Fill in squared distances from a point."""
    x, y, z = near[0, own], near[1, own], near[2, own]
    for i in range(count):
        dx, dy, dz = near[0, i] - x, near[1, i] - y, near[2, i] - z
        squared[i] = dx * dx + dy * dy + dz * dz


@exact_sums
def _number(squared, count, limit):
    """How many of the first are within a distance."""
    nought, one = np.float32(0.0), np.float32(1.0)
    found = nought  # exact; whole numbers would be widened to 64 bits
    limit = np.float32(limit * abs(limit))
    for i in range(count):
        found += one if squared[i] <= limit else nought
    return found


@rough_sums
def _sum(squared, count, limit):
    """Sum of the distances up to a limit, and how many there are."""
    nought, one = np.float32(0.0), np.float32(1.0)
    total, found = nought, nought
    limit = np.float32(limit * abs(limit))
    for i in range(count):
        total += np.sqrt(squared[i]) if squared[i] <= limit else nought
        found += one if squared[i] <= limit else nought
    return total, found
