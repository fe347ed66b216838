"""Compiled loops of :mod:`algorithms.shared.covariance`: moments and axes of neighbourhoods.

Sums over neighbours are made of whole numbers, so that they do not depend on the order in which
the tree meets the points: offsets from the point are rounded to a millionth of the neighbourhood.
Axes are found without a branch, for several points at once.
"""

from __future__ import annotations

import math

import numpy as np

from algorithms.shared.kernels import cells
from algorithms.shared.kernels import neighbours as tree
from algorithms.shared.kernels.compiling import exact_sums, helper, inlined, kernel

# What is known of a neighbourhood, by row of `found`.
COUNT, REACH, LARGE, MIDDLE, SMALL, NX, NY, NZ, OFF_PLANE, RISE, SPREAD = range(11)
# Sums of the offsets and of their products, in steps, from which that is made, in the same rows.
X, Y, Z, XX, XY, XZ, YY, YZ, ZZ, RANGE = range(2, 12)
ROWS = 12
TOGETHER = 256  # points whose axes are found together
FINE = 1 << 20  # steps of rounding in the reach: 8 million squares of them have an exact sum
PART = 1 << 13  # points whose squares have an exact sum in a double, too
OUTSIDE = 1e9  # offset of points that are no neighbours, above FINE
LINE = 1e-12  # share of the largest eigenvalue below which the others are those of a line
SEEN = 16  # points noted while searching, for each one that is wanted
WIDER = (
    1.2  # times the farthest neighbour of a leaf on average, how far the next one looks at first
)
WIDEN = 1.5  # times as far, where that does not hold all neighbours of a point


# Neighbourhoods ----------------------------------------------------------------------------


@kernel
def nearest(first_leaf, last_leaf, xyz, box, depth, k, reach, found):
    """Fill in the moments and axes of the k nearest neighbours of points, within `reach`.

    They are looked for among the points around the leaf, as far away as those of the leaf before
    were; point by point where that does not tell them. `found` has the shape (ROWS, points of the
    leaves).
    """
    n = len(xyz)
    around, index = np.empty((3, tree.ROOM)), np.empty(tree.ROOM, np.int64)
    squared, kept = np.empty(tree.ROOM), np.empty(tree.ROOM, np.int64)
    held = np.empty(tree.DEEPEST, np.int64)
    alone = _room(k)
    begin, farthest, wide = tree.first(first_leaf, depth, n), reach, 0.0
    inside = np.nextafter(reach * reach, 0.0)  # neighbours are nearer than the reach
    for leaf in range(first_leaf, last_leaf):
        count = tree.around(xyz, box, depth, leaf, wide, held, around, index) if wide > 0.0 else -1
        start, stop = tree.first(leaf, depth, n), tree.first(leaf + 1, depth, n)
        total = 0.0
        for own in range(start, stop):
            bound = reach
            if own > begin:  # what is near the point before cannot be far from this one
                step = 0.0
                for a in range(3):
                    step += (xyz[own, a] - xyz[own - 1, a]) ** 2
                bound = min(reach, (farthest + np.sqrt(step)) * (1.0 + tree.ROUNDING))
            row = found[:, own - begin]
            if bound == 0.0:  # no distance is below zero, so more points than k share this place
                row[:] = 0.0
                row[COUNT] = k + 1
                continue
            limit, few = -1.0, 0
            while count >= 0:
                within = min(min(wide, bound) ** 2, inside)
                limit, few = tree.among(around, count, xyz[own], k + 1, within, squared, kept)
                if few > k or wide >= bound:
                    break
                wide = min(WIDEN * wide, bound)
                count = tree.around(xyz, box, depth, leaf, wide, held, around, index)
            if limit >= 0.0 or (count >= 0 and few <= k):
                farthest = np.sqrt(limit) if limit >= 0.0 else reach  # fewer than wanted: take all
                used, far = _others(own, limit, few, squared, kept, index)
                _describe(xyz, own, kept, used, np.sqrt(far), row)
            else:
                farthest = _alone(xyz, box, depth, leaf, own, k, bound, reach, alone, row)
            total += farthest
        wide = WIDER * total / max(stop - start, 1)
    _axes(found)


@helper
def _others(own, limit, few, squared, kept, index):
    """Put the numbers of the points up to the limit into `kept`, but for the point itself.

    All of the few without a limit, -1. Returns their number, and the largest squared distance.
    """
    used, far = 0, 0.0
    for j in range(few):
        if (limit < 0.0 or squared[j] <= limit) and index[kept[j]] != own:
            kept[used] = index[kept[j]]
            used, far = used + 1, max(far, squared[j])
    return used, far


@helper
def _room(k):
    """Scratch for a search of the k nearest of one point."""
    return (
        *(np.empty(k), np.empty(k, np.int64), np.empty(k)),
        *(np.empty(SEEN * k, np.int64), np.empty(SEEN * k)),
        *(np.empty(tree.DEEPEST, np.int64), np.empty(tree.DEEPEST)),
    )


@helper
def _alone(xyz, box, depth, leaf, own, k, bound, reach, room, row):
    """Fill in the row of one point by a search of its own; the distance of its farthest neighbour.

    What is as near as `bound` is looked at.
    """
    far, near, near_far, seen, seen_far, held, held_away = room
    far[:] = bound * bound
    noted = tree.search(xyz, box, depth, leaf, own, far, held, held_away, seen, seen_far)
    farthest, limit = np.sqrt(far[0]), far[0]
    if limit >= reach * reach:  # fewer than wanted: all of those nearer than the reach
        limit = np.nextafter(reach * reach, 0.0)
    used = _keep(limit, min(noted, len(seen)), seen, seen_far)
    if noted <= len(seen) and used <= k:
        _describe(xyz, own, seen, used, _farthest(seen_far, used), row)
    else:  # several are equally far, and not all of them are wanted
        used = tree.gather(xyz, box, depth, own, limit, near, near_far, held)
        _describe(xyz, own, near, used, _farthest(near_far, used), row)
    return farthest


@helper
def _keep(limit, count, seen, seen_far):
    """Drop the noted points whose squared distance is above the limit; the number that remain."""
    kept = 0
    for j in range(count):
        if seen_far[j] <= limit:
            seen[kept], seen_far[kept] = seen[j], seen_far[j]
            kept += 1
    return kept


@helper
def _farthest(squared, count):
    """The largest of the first `count` squared distances, as a distance."""
    most = 0.0
    for j in range(count):
        most = max(most, squared[j])
    return math.sqrt(most)


@kernel
def within(first_cell, last_cell, xyz, key, start, stride, reach, asked, again, found):
    """Fill in the moments and axes of all neighbours within `reach` of points that are `asked` for.

    The points of the cells around are brought together once for all points of a cell; `found` has
    the shape (ROWS, points of the cells that are asked for). Points `again` at the place of another
    are no neighbours.
    """
    step, at = cells.columns(stride, key)
    first, last = np.empty(cells.COLUMNS, np.int64), np.empty(cells.COLUMNS, np.int64)
    near_x, near_y, near_z = np.empty(64), np.empty(64), np.empty(64)
    away = np.empty(PART), np.empty(PART), np.empty(PART), np.empty(PART, np.int32)
    if first_cell < last_cell:
        cells.begin(key, first_cell, step, at)
    done = 0
    for cell in range(first_cell, last_cell):
        if not asked[start[cell] : start[cell + 1]].any():
            continue
        total = cells.around(key, start, cell, step, at, first, last)
        if len(near_x) < total:
            near_x, near_y, near_z = np.empty(2 * total), np.empty(2 * total), np.empty(2 * total)
        total = _bring(xyz, again, first, last, near_x, near_y, near_z)
        near = near_x[:total], near_y[:total], near_z[:total]
        for own in range(start[cell], start[cell + 1]):
            if asked[own]:
                _describe_within(near, xyz[own], reach, away, found[:, done])
                done += 1
    _axes(found)


@helper
def _bring(xyz, again, first, last, near_x, near_y, near_z):
    """Copy runs of points, so that their coordinates are side by side; how many there are."""
    used = 0
    for c in range(len(first)):
        for i in range(first[c], last[c]):
            near_x[used], near_y[used], near_z[used] = xyz[i, 0], xyz[i, 1], xyz[i, 2]
            used += not again[i]
    return used


@kernel
def repeated(xyz, start):
    """True for points at the place of one before them, which is in the same cell."""
    found = np.zeros(len(xyz), np.bool_)
    for cell in range(len(start) - 1):
        for i in range(start[cell] + 1, start[cell + 1]):
            for j in range(start[cell], i):
                if xyz[i, 0] == xyz[j, 0] and xyz[i, 1] == xyz[j, 1] and xyz[i, 2] == xyz[j, 2]:
                    found[i] = True
                    break
    return found


@helper
def _describe_within(near, own, reach, away, row):
    """Fill in the sums of a point; those points that are nearer than `reach` are its neighbours.

    They are taken a part at a time, for whose whole numbers a double is exact.
    """
    (x, y, z), (away_x, away_y, away_z, rise) = near, away
    count = sx = sy = sz = sxx = sxy = sxz = syy = syz = szz = lowest = highest = np.int64(0)
    for begin in range(0, len(x), PART):
        end = min(begin + PART, len(x))
        _offsets(x[begin:end], y[begin:end], z[begin:end], own, reach, away_x, away_y, away_z, rise)
        n, a, b, c, aa, ab, ac, bb, bc, cc = _sums(away_x[: end - begin], away_y, away_z)
        low, high = _range(rise[: end - begin])
        count, sx, sy, sz = (
            count + np.int64(n),
            sx + np.int64(a),
            sy + np.int64(b),
            sz + np.int64(c),
        )
        sxx, sxy, sxz = sxx + np.int64(aa), sxy + np.int64(ab), sxz + np.int64(ac)
        syy, syz, szz = syy + np.int64(bb), syz + np.int64(bc), szz + np.int64(cc)
        lowest, highest = min(lowest, np.int64(low)), max(highest, np.int64(high))
    row[COUNT], row[REACH], row[RANGE] = count, reach, highest - lowest
    row[X], row[Y], row[Z] = sx, sy, sz
    row[XX], row[XY], row[XZ], row[YY], row[YZ], row[ZZ] = sxx, sxy, sxz, syy, syz, szz


@helper
def _offsets(x, y, z, own, reach, away_x, away_y, away_z, rise):
    """Offsets of points in steps, rounded; far beyond all others for those not within reach."""
    east, north, up = own[0], own[1], own[2]
    fine, limit = FINE / reach, reach * reach
    for j in range(len(x)):
        dx, dy, dz = x[j] - east, y[j] - north, z[j] - up
        inside = dx * dx + dy * dy + dz * dz < limit
        away_x[j] = np.rint(dx * fine) if inside else OUTSIDE
        away_y[j], away_z[j] = np.rint(dy * fine), np.rint(dz * fine)
        rise[j] = np.int32(away_z[j]) if inside else np.int32(0)


@exact_sums
def _sums(away_x, away_y, away_z):
    """Number of the neighbours, sums and products of their offsets."""
    n = sx = sy = sz = sxx = sxy = sxz = syy = syz = szz = 0.0
    for j in range(len(away_x)):
        x, y, z = away_x[j], away_y[j], away_z[j]
        one = 1.0 if x < OUTSIDE else 0.0
        x, y, z = x * one, y * one, z * one
        n, sx, sy, sz = n + one, sx + x, sy + y, sz + z
        sxx, sxy, sxz = sxx + x * x, sxy + x * y, sxz + x * z
        syy, syz, szz = syy + y * y, syz + y * z, szz + z * z
    return n, sx, sy, sz, sxx, sxy, sxz, syy, syz, szz


@helper
def _range(rise):
    """Lowest and highest of some whole numbers and 0; a loop of its own is faster."""
    low = high = np.int32(0)
    for j in range(len(rise)):
        low = rise[j] if rise[j] < low else low
        high = rise[j] if rise[j] > high else high
    return low, high


# Axes --------------------------------------------------------------------------------------


@helper
def _describe(xyz, own, near, count, reach, row):
    """Fill in the sums of the offsets of a point and its neighbours within `reach`."""
    fine = FINE / reach if reach > 0.0 else 0.0
    east, north, up = xyz[own, 0], xyz[own, 1], xyz[own, 2]
    lowest = highest = sx = sy = sz = sxx = sxy = sxz = syy = syz = szz = np.int64(0)
    for j in range(count):
        i = near[j]
        ix = np.int64(np.rint((xyz[i, 0] - east) * fine))
        iy = np.int64(np.rint((xyz[i, 1] - north) * fine))
        iz = np.int64(np.rint((xyz[i, 2] - up) * fine))
        sx, sy, sz = sx + ix, sy + iy, sz + iz
        sxx, sxy, sxz = sxx + ix * ix, sxy + ix * iy, sxz + ix * iz
        syy, syz, szz = syy + iy * iy, syz + iy * iz, szz + iz * iz
        lowest, highest = min(lowest, iz), max(highest, iz)
    row[COUNT], row[REACH], row[RANGE] = count + 1, reach, highest - lowest
    row[X], row[Y], row[Z] = sx, sy, sz
    row[XX], row[XY], row[XZ], row[YY], row[YZ], row[ZZ] = sxx, sxy, sxz, syy, syz, szz


@inlined
def _axes(found):
    """Fill in what is known of neighbourhoods from the sums in their rows.

    In one array with steps known beforehand, as rows that may overlap are not computed together.
    """
    work = np.zeros(ROWS * TOGETHER)
    for begin in range(0, found.shape[1], TOGETHER):
        count = min(TOGETHER, found.shape[1] - begin)
        for k in range(ROWS):
            work[k * TOGETHER : k * TOGETHER + count] = found[k, begin : begin + count]
        for i in range(TOGETHER):
            _axes_of_one(work, i)
        for k in range(ROWS):
            found[k, begin : begin + count] = work[k * TOGETHER : k * TOGETHER + count]


@inlined
def _axes_of_one(work, i):
    """Make what is known of a neighbourhood of its sums, which are TOGETHER numbers apart."""
    size, step = work[i], work[REACH * TOGETHER + i] / FINE
    x, y, z = (
        work[X * TOGETHER + i] / size,
        work[Y * TOGETHER + i] / size,
        work[Z * TOGETHER + i] / size,
    )
    xx, xy, xz = (
        work[XX * TOGETHER + i] / size - x * x,
        work[XY * TOGETHER + i] / size - x * y,
        work[XZ * TOGETHER + i] / size - x * z,
    )
    yy, yz, zz = (
        work[YY * TOGETHER + i] / size - y * y,
        work[YZ * TOGETHER + i] / size - y * z,
        max(work[ZZ * TOGETHER + i] / size - z * z, 0.0),
    )
    rise, square = work[RANGE * TOGETHER + i] * step, step * step
    large, middle, small, a, b, c = eigen(xx, xy, xz, yy, yz, zz)
    down = (c < 0.0) | ((c == 0.0) & ((b < 0.0) | ((b == 0.0) & (a < 0.0))))
    way = -1.0 if down else 1.0
    way = np.nan if middle <= LINE * large else way  # a line or a place lies in many planes
    a, b, c = way * a, way * b, way * c
    work[LARGE * TOGETHER + i] = large * square
    work[MIDDLE * TOGETHER + i] = middle * square
    work[SMALL * TOGETHER + i] = small * square
    work[NX * TOGETHER + i], work[NY * TOGETHER + i], work[NZ * TOGETHER + i] = a, b, c
    work[OFF_PLANE * TOGETHER + i] = abs(a * x + b * y + c * z) * step
    work[RISE * TOGETHER + i], work[SPREAD * TOGETHER + i] = rise, math.sqrt(zz) * step


@inlined
def _cross(ax, ay, az, bx, by, bz):
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inlined
def _unit(x, y, z):
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@inlined
def _longer(x, y, z, p, q, r):
    """The longer of two vectors, the first if they are equally long."""
    more = p * p + q * q + r * r > x * x + y * y + z * z
    return (p if more else x), (q if more else y), (r if more else z)


@inlined
def _root(half):
    """2 cos(acos(half) / 3) of a number from 0 to 1: the largest root of t**3 - 3 t = 2 half.

    Newton's method from within 0.0011 of the root doubles the digits in each step: 3, 6, 12, all.
    """
    root = 1.7331 + half * (0.3192 - 0.0531 * half)
    for _ in range(3):
        root -= (root * (root * root - 3.0) - 2.0 * half) / (3.0 * root * root - 3.0)
    return root


@inlined
def eigen(xx, xy, xz, yy, yz, zz):
    """Eigenvalues of a covariance matrix in falling order, and the axis of the smallest one.

    The eigenvalue that is farthest from the other two comes from the cubic equation (Smith 1961),
    its axis from the rows of the matrix; the other two from the 2 x 2 matrix across that axis
    (Eberly 2014). No step subtracts numbers that are almost equal, so all is exact to rounding,
    relative to the largest eigenvalue. None is below zero.
    """
    size = max(abs(xx), abs(yy), abs(zz), abs(xy), abs(xz), abs(yz))
    scale = size if size > 0.0 else 1.0
    xx, xy, xz, yy, yz, zz = xx / scale, xy / scale, xz / scale, yy / scale, yz / scale, zz / scale
    mean = (xx + yy + zz) / 3.0
    a, b, c = xx - mean, yy - mean, zz - mean
    spread = math.sqrt((a * a + b * b + c * c + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0)
    ball = spread < 1e-15  # all axes are alike
    spread = 1.0 if ball else spread
    half = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    half = half / (2.0 * spread * spread * spread)
    first = half >= 0.0  # the largest eigenvalue is the one that is alone, else the smallest
    away = spread * _root(min(abs(half), 1.0))
    alone = mean + (away if first else -away)
    # The axis of the eigenvalue that is alone is square to all rows of the matrix less it.
    a, b, c = xx - alone, yy - alone, zz - alone
    x, y, z = _cross(a, xy, xz, xy, b, yz)
    x, y, z = _longer(x, y, z, *_cross(a, xy, xz, xz, yz, c))
    x, y, z = _unit(*_longer(x, y, z, *_cross(xy, b, yz, xz, yz, c)))
    # Two axes across it, u and v, and the matrix between them.
    east = abs(x) > abs(y)
    ux, uy, uz = _unit(-z if east else 0.0, 0.0 if east else z, x if east else -y)
    vx, vy, vz = _cross(x, y, z, ux, uy, uz)
    px, py, pz = (
        xx * ux + xy * uy + xz * uz,
        xy * ux + yy * uy + yz * uz,
        xz * ux + yz * uy + zz * uz,
    )
    qx, qy, qz = (
        xx * vx + xy * vy + xz * vz,
        xy * vx + yy * vy + yz * vz,
        xz * vx + yz * vy + zz * vz,
    )
    uu, uv, vv = (
        ux * px + uy * py + uz * pz,
        ux * qx + uy * qy + uz * qz,
        vx * qx + vy * qy + vz * qz,
    )
    # The rotation that makes the 2 x 2 matrix diagonal (Jacobi 1846).
    turned = uv != 0.0
    slant = (vv - uu) / (2.0 * (uv if turned else 1.0))
    t = 1.0 / (abs(slant) + math.sqrt(1.0 + slant * slant))
    t = (t if slant >= 0.0 else -t) if turned else 0.0
    cosine = 1.0 / math.sqrt(1.0 + t * t)
    sine = t * cosine
    one, other = uu - t * uv, vv + t * uv
    less = one < other  # the axis of the smaller of the two
    p, q = (cosine, -sine) if less else (sine, cosine)
    nx, ny, nz = p * ux + q * vx, p * uy + q * vy, p * uz + q * vz
    low, high = max(min(one, other), 0.0), max(one, other, 0.0)
    alone = max(alone, 0.0)
    large, middle, small = (alone, high, low) if first else (high, low, min(alone, low))
    nx, ny, nz = (nx, ny, nz) if first else (x, y, z)
    large, middle, small = (mean, mean, mean) if ball else (large, middle, small)
    nx, ny, nz = (0.0, 0.0, 1.0) if ball else (nx, ny, nz)
    return large * size, middle * size, small * size, nx, ny, nz
