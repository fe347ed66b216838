"""Compiled loops of :mod:`algorithms.planes._search`."""

from __future__ import annotations

import math

import numpy as np

from algorithms.planes._cells_kernels import LEVELS
from algorithms.shared.kernels.compiling import helper, kernel
from algorithms.shared.kernels.sorting import first_at
from algorithms.shared.sets import root

GROUP = 32  # cells that are looked at together


@kernel
def boxes(reach):
    """Bounding boxes of groups of GROUP consecutive cells, array of shape (groups, 6)."""
    found = np.empty((-(-len(reach) // GROUP), 6))
    found[:, :3], found[:, 3:] = np.inf, -np.inf
    for cell in range(len(reach)):
        for a in range(3):
            found[cell // GROUP, a] = min(found[cell // GROUP, a], reach[cell, a])
            found[cell // GROUP, 3 + a] = max(found[cell // GROUP, 3 + a], reach[cell, 3 + a])
    return found


@helper
def _meets(box, plane, limit):
    """Whether a box comes within a distance of a plane."""
    middle, half = -plane[3], limit
    for a in range(3):
        middle += plane[a] * 0.5 * (box[a] + box[3 + a])
        half += abs(plane[a]) * 0.5 * (box[3 + a] - box[a])
    return abs(middle) <= half


@helper
def _around(keys, levels, cell, up):
    """First and last index of the cells in the octree cell `up` levels above one."""
    level = levels[cell] - up
    if up <= 0 or level < 0:
        return cell, cell + 1
    shift = np.uint64(3 * (LEVELS - level))
    base = keys[cell] >> shift
    start = first_at(keys, base << shift, 0, cell)
    stop = first_at(keys, (base + np.uint64(1)) << shift, cell, len(keys))
    return start, stop


@kernel
def draw(chance, running, keys, levels, centres, normals, weights, cosine, cone, planes):
    """Fill in planes through the centres of three cells drawn from one octree cell.

    The first cell is drawn by its weight, then how large the cell of the octree around it is, then
    two others in that one. A cell that is alone has its own plane.

    Parameters
    ----------
    chance : array of shape (k, 4), numbers from 0 to 1
    running : array of shape (m,), sums of the weights
    cosine : of the largest angle between the plane and the normals of its cells
    cone : array of shape (2,), least and largest size of the third part of the normal
    planes : array of shape (k, 4) to fill, normal and offset; NaN where there is none
    """
    for k in range(len(chance)):
        planes[k] = np.nan
        first = np.searchsorted(running, chance[k, 0] * running[-1], side="right")
        first = min(first, len(running) - 1)
        up = int(chance[k, 1] * (levels[first] + 1))
        start, stop = _around(keys, levels, first, up)
        second = start + int(chance[k, 2] * (stop - start))
        third = start + int(chance[k, 3] * (stop - start))
        if weights[first] <= 0.0 or weights[second] <= 0.0 or weights[third] <= 0.0:
            continue
        n = normals[first]
        x, y, z = n[0], n[1], n[2]
        if first not in (second, third) and second != third:
            a, b = centres[second] - centres[first], centres[third] - centres[first]
            x, y, z = (
                a[1] * b[2] - a[2] * b[1],
                a[2] * b[0] - a[0] * b[2],
                a[0] * b[1] - a[1] * b[0],
            )
            length = math.sqrt(x * x + y * y + z * z)
            # Three positions almost on a line say little of the plane through them.
            if length <= 0.2 * max((a * a).sum(), (b * b).sum()):
                continue
            x, y, z = x / length, y / length, z / length
            for other in (first, second, third):
                m = normals[other]
                if abs(x * m[0] + y * m[1] + z * m[2]) < cosine:
                    length = 0.0
            if length == 0.0:
                continue
        if not cone[0] <= abs(z) <= cone[1]:
            continue
        planes[k, 0], planes[k, 1], planes[k, 2] = x, y, z
        planes[k, 3] = x * centres[first, 0] + y * centres[first, 1] + z * centres[first, 2]


@kernel
def score(first, last, planes, centres, normals, weights, group, limit, cosine, gains):
    """Fill in the scores of planes: the sum of weight * (1 - (distance / limit)**2) over cells.

    Groups of cells that are nowhere near a plane are passed over.
    """
    square = 1.0 / (limit * limit)
    for p in range(first, last):
        plane = planes[p]
        gain = 0.0
        if not np.isnan(plane[0]):
            x, y, z, offset = plane[0], plane[1], plane[2], plane[3]
            for g in range(len(group)):
                if not _meets(group[g], plane, limit):
                    continue
                for i in range(g * GROUP, min((g + 1) * GROUP, len(centres))):
                    away = x * centres[i, 0] + y * centres[i, 1] + z * centres[i, 2] - offset
                    rest = 1.0 - away * away * square
                    if rest > 0.0 and weights[i] > 0.0:
                        n = normals[i]
                        if abs(x * n[0] + y * n[1] + z * n[2]) >= cosine:
                            gain += rest * weights[i]
        gains[p] = gain


@kernel
def support(plane, centres, normals, weights, group, limit, cosine, found):
    """Fill in the indices of the cells that support a plane; their number."""
    x, y, z, offset = plane[0], plane[1], plane[2], plane[3]
    count = 0
    for g in range(len(group)):
        if not _meets(group[g], plane, limit):
            continue
        for i in range(g * GROUP, min((g + 1) * GROUP, len(centres))):
            away = x * centres[i, 0] + y * centres[i, 1] + z * centres[i, 2] - offset
            if weights[i] > 0.0 and abs(away) < limit:
                n = normals[i]
                if abs(x * n[0] + y * n[1] + z * n[2]) >= cosine:
                    found[count] = i
                    count += 1
    return count


@kernel
def hits(some, cells, keys, levels, weights, member):
    """Mean chance that two cells drawn near a cell of a plane are on this plane too.

    Parameters
    ----------
    some : cells of the plane to look at
    cells : all cells of the plane, sorted
    member : array of shape (m,), scratch
    """
    total = 0.0
    for cell in some:
        own = 0.0
        for up in range(levels[cell] + 1):
            start, stop = _around(keys, levels, cell, up)
            inside = first_at(cells, stop, 0, len(cells)) - first_at(cells, start, 0, len(cells))
            share = inside / (stop - start)
            own += share * share
        total += own / (levels[cell] + 1)
    return total / len(some)


@kernel
def sums(cells, xyz, starts, free, plane, middle, limit, found):
    """Fill in sums over free points near a plane: 1, x, y, z, xx, xy, xz, yy, yz, zz.

    Coordinates are measured from `middle`.
    """
    found[:] = 0.0
    for cell in cells:
        for i in range(starts[cell], starts[cell + 1]):
            if not free[i]:
                continue
            x, y, z = xyz[i, 0] - middle[0], xyz[i, 1] - middle[1], xyz[i, 2] - middle[2]
            away = plane[0] * xyz[i, 0] + plane[1] * xyz[i, 1] + plane[2] * xyz[i, 2] - plane[3]
            if abs(away) <= limit:
                found[0] += 1.0
                found[1] += x
                found[2] += y
                found[3] += z
                found[4] += x * x
                found[5] += x * y
                found[6] += x * z
                found[7] += y * y
                found[8] += y * z
                found[9] += z * z


@kernel
def weighted(xyz, part, plane, middle, limit, found):
    """Fill in the sums of :func:`sums`, with weights that fall with the distance from the plane.

    The weight is Tukey's, (1 - (distance / limit)**2)**2, and 0 beyond the limit.
    """
    found[:] = 0.0
    square = 1.0 / (limit * limit)
    for i in part:
        away = plane[0] * xyz[i, 0] + plane[1] * xyz[i, 1] + plane[2] * xyz[i, 2] - plane[3]
        rest = 1.0 - away * away * square
        if rest > 0.0:
            x, y, z = xyz[i, 0] - middle[0], xyz[i, 1] - middle[1], xyz[i, 2] - middle[2]
            w = rest * rest
            found[0] += w
            found[1] += w * x
            found[2] += w * y
            found[3] += w * z
            found[4] += w * x * x
            found[5] += w * x * y
            found[6] += w * x * z
            found[7] += w * y * y
            found[8] += w * y * z
            found[9] += w * z * z


@kernel
def squares(cells, xyz, starts, free, plane, axes, limit, gap, found, owner):
    """Fill in the squares of a grid on a plane that hold free points of given cells.

    Squares that follow each other are written once. `owner` is the index in `cells` of the cell of
    each. Returns their number.
    """
    count = 0
    for place in range(len(cells)):
        last = np.int64(-1)
        for i in range(starts[cells[place]], starts[cells[place] + 1]):
            away = plane[0] * xyz[i, 0] + plane[1] * xyz[i, 1] + plane[2] * xyz[i, 2] - plane[3]
            if free[i] and abs(away) <= limit:
                key = _square(xyz[i], axes, gap)
                if key != last:
                    if count == len(found):
                        return -1
                    found[count], owner[count] = key, place
                    count += 1
                    last = key
    return count


@helper
def _square(place, axes, gap):
    """Number of the square of the grid on a plane in which a point lies."""
    u = axes[0, 0] * place[0] + axes[0, 1] * place[1] + axes[0, 2] * place[2]
    v = axes[1, 0] * place[0] + axes[1, 1] * place[1] + axes[1, 2] * place[2]
    return (
        ((np.int64(math.floor(u / gap)) + (1 << 30)) << 31)
        + np.int64(math.floor(v / gap))
        + (1 << 30)
    )


@kernel
def pieces(squares, groups):
    """Connected pieces of squares, joined by sides, corners or groups.

    Parameters
    ----------
    squares : array of shape (k,), sorted, without repeats
    groups : array of shape (g, 2), places of squares in `squares` that hang together anyhow

    Returns
    -------
    array of shape (k,), the first square of the piece of each
    """
    parent = np.arange(len(squares))
    for pair in range(len(groups)):
        _join(parent, groups[pair, 0], groups[pair, 1])
    for i in range(len(squares)):
        for step in (1, (1 << 31) - 1, 1 << 31, (1 << 31) + 1):
            j = first_at(squares, squares[i] + step, 0, len(squares))
            if j < len(squares) and squares[j] == squares[i] + step:
                _join(parent, i, j)
    for i in range(len(squares)):
        parent[i] = root(parent, i)
    return parent


@helper
def _join(parent, i, j):
    a, b = root(parent, i), root(parent, j)
    if a < b:
        parent[b] = a
    elif b < a:
        parent[a] = b


@kernel
def take(plane, axes, limit, gap, squares, xyz, starts, reach, group, free, weights, counts):
    """Mark the points of a patch as taken, and update the weights of their cells; their number."""
    taken = 0
    for g in range(len(group)):
        if not _meets(group[g], plane, limit):
            continue
        for cell in range(g * GROUP, min((g + 1) * GROUP, len(reach))):
            if not _meets(reach[cell], plane, limit):
                continue
            lost = 0
            for i in range(starts[cell], starts[cell + 1]):
                away = plane[0] * xyz[i, 0] + plane[1] * xyz[i, 1] + plane[2] * xyz[i, 2] - plane[3]
                if free[i] and abs(away) <= limit and _within(squares, _square(xyz[i], axes, gap)):
                    free[i] = False
                    lost += 1
            if lost > 0:
                taken += lost
                counts[cell] -= lost
                left = counts[cell]
                weights[cell] = left if 2 * left > starts[cell + 1] - starts[cell] else 0.0
    return taken


@kernel
def near(plane, axes, limit, gap, squares, xyz, starts, reach, group, free):
    """Number of free points near a patch."""
    count = 0
    for g in range(len(group)):
        if not _meets(group[g], plane, limit):
            continue
        for cell in range(g * GROUP, min((g + 1) * GROUP, len(reach))):
            if not _meets(reach[cell], plane, limit):
                continue
            for i in range(starts[cell], starts[cell + 1]):
                away = plane[0] * xyz[i, 0] + plane[1] * xyz[i, 1] + plane[2] * xyz[i, 2] - plane[3]
                if free[i] and abs(away) <= limit:
                    count += _within(squares, _square(xyz[i], axes, gap))
    return count


@kernel
def over(xyz, axes, gap, squares):
    """True for points of shape (n, 3) whose projection lies on a patch."""
    found = np.empty(len(xyz), np.bool_)
    for i in range(len(xyz)):
        found[i] = _within(squares, _square(xyz[i], axes, gap))
    return found


@helper
def _within(squares, key):
    j = first_at(squares, key, 0, len(squares))
    return j < len(squares) and squares[j] == key


@kernel
def assign(
    plane,
    axes,
    limit,
    spread,
    gap,
    squares,
    number,
    xyz,
    starts,
    reach,
    group,
    nearest,
    owner,
):
    """Assign the points near a patch to its plane, unless another plane is nearer.

    Parameters
    ----------
    spread : unit in which distances from the plane are compared with those from others
    squares : sorted, those of the patch
    number : of the plane
    nearest, owner : arrays of shape (n,), distance and number of the nearest plane so far
    """
    for g in range(len(group)):
        if not _meets(group[g], plane, limit):
            continue
        for cell in range(g * GROUP, min((g + 1) * GROUP, len(reach))):
            if not _meets(reach[cell], plane, limit):
                continue
            for i in range(starts[cell], starts[cell + 1]):
                x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
                away = plane[0] * x + plane[1] * y + plane[2] * z - plane[3]
                near = abs(away) <= limit and abs(away) < spread * nearest[i]
                if near and _within(squares, _square(xyz[i], axes, gap)):
                    nearest[i], owner[i] = abs(away) / spread, number


@kernel
def near_edges(
    plane,
    axes,
    tolerance,
    gap,
    squares,
    cosine,
    number,
    planes,
    xyz,
    starts,
    reach,
    group,
    owner,
    edge,
):
    """Mark points of other planes near the line where their plane meets a patch.

    How far they are is measured within their own plane, so that their noise does not choose among
    them. Planes that face almost the same way do not meet.

    Parameters
    ----------
    number : of the patch, from 1
    planes : array of shape (k, 4), of all patches
    owner : array of shape (n,), number of the plane of each point, 0 of none
    edge : array of shape (n,) to mark
    """
    place = np.empty(3)
    for g in range(len(group)):
        if not _meets(group[g], plane, 3.0 * tolerance):
            continue
        for cell in range(g * GROUP, min((g + 1) * GROUP, len(reach))):
            if not _meets(reach[cell], plane, 3.0 * tolerance):
                continue
            for i in range(starts[cell], starts[cell + 1]):
                if owner[i] == 0 or owner[i] == number or edge[i]:
                    continue
                own = planes[owner[i] - 1]
                facing = plane[0] * own[0] + plane[1] * own[1] + plane[2] * own[2]
                if abs(facing) >= cosine:
                    continue
                x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
                noise = own[0] * x + own[1] * y + own[2] * z - own[3]
                away = plane[0] * x + plane[1] * y + plane[2] * z - plane[3] - facing * noise
                if abs(away) <= (1.0 + abs(facing)) * tolerance:
                    step = away / (1.0 - facing * facing)
                    for a in range(3):  # along its own plane to where that meets the other
                        place[a] = xyz[i, a] - noise * own[a] - step * (plane[a] - facing * own[a])
                    edge[i] = _within(squares, _square(place, axes, gap))
