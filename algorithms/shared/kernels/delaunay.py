"""Compiled loops of the Delaunay triangulation; see :mod:`algorithms.shared.delaunay`.

Vertex k of a triangle is `triangles[t, k]`, counter-clockwise, and `neighbours[t, k]` is the
triangle across the edge opposite that vertex. A live mesh is closed by ghosts: triangles between
a hull edge and the vertex at infinity, -1. `walk` and `locate` take the arrays of a Mesh or of a
LiveMesh; `insert` takes `LiveMesh.arrays`.

References
----------
Shewchuk, J. R. (1997). Adaptive precision floating-point arithmetic and fast robust geometric
predicates. Discrete & Computational Geometry 18, 305-363. Error bounds, exact sums and products.
Bowyer, A. (1981), and Watson, D. F. (1981). The Computer Journal 24(2), 162-166 and 167-172.
Devillers, O. & Teillaud, M. (2011). Perturbations for Delaunay and weighted Delaunay 3D
triangulations. Computational Geometry 44(3), 160-168. The rule for points on a common circle.
Devillers, O., Pion, S. & Teillaud, M. (2002). Walking in a triangulation. International Journal
of Foundations of Computer Science 13(2), 181-199.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.kernels.compiling import helper, kernel

HALF_ULP = 2.0**-53
ORIENT_ERROR = (3 + 16 * HALF_ULP) * HALF_ULP  # Shewchuk's ccwerrboundA
CIRCLE_ERROR = (10 + 96 * HALF_ULP) * HALF_ULP  # and iccerrboundA
GHOST = np.int32(-1)  # the vertex at infinity
SPLITTER = 2.0**27 + 1

BITS = 20  # of a cell number on the Hilbert curve, in x and in y
ROUNDS, THINNING = 8, 4  # all but one in 2**THINNING points wait for the next round
DIGIT = 11  # bits that one pass of the radix sort looks at
PASSES = -(-(2 * BITS + 3) // DIGIT)  # three bits for the round


class Arrays(NamedTuple):
    """The arrays of a live mesh, for kernels."""

    xy: NDArray[np.float64]  # (n, 2), read-only
    triangles: NDArray[np.int32]  # (2 n, 3)
    neighbours: NDArray[np.int32]  # (2 n, 3)
    size: NDArray[np.int64]  # (1,), how many triangles there are
    scratch: NDArray[np.int64]  # (4, 2 n), see insert


# Exact sums: `e[:n]` holds n floats that do not overlap, in growing size; their sum is the value.
# n begins as np.int64(0): numba would compile functions for the literal 0 once more.


@helper
def _add(e, n, b):
    """Add a float to an exact sum in place; the new number of its terms (Shewchuk, figure 6)."""
    length = 0
    for i in range(n):
        total = b + e[i]
        part = total - b
        rest = (b - (total - part)) + (e[i] - part)
        if rest != 0.0:
            e[length] = rest
            length += 1
        b = total
    if b != 0.0:
        e[length] = b
        length += 1
    return length


@helper
def _add_product(e, n, a, b):
    """Add a x b to an exact sum in place; the new number of terms (Dekker, figure 14 there)."""
    product = a * b
    if product == 0.0:
        return n
    c = SPLITTER * a
    a_high = c - (c - a)
    a_low = a - a_high
    c = SPLITTER * b
    b_high = c - (c - b)
    b_low = b - b_high
    error = product - a_high * b_high - a_low * b_high - a_high * b_low
    n = _add(e, n, a_low * b_low - error)
    return _add(e, n, product)


@helper
def _difference(ax, ay, bx, by):
    """Exact difference a - b: rounded x and y, and the rounding errors of both, mostly 0."""
    x, y = ax - bx, ay - by
    u, v = ax - x, ay - y
    return x, y, (ax - (x + u)) + (u - bx), (ay - (y + v)) + (v - by)


@helper
def _cross(e, a, b):
    """Cross product of two differences as an exact sum; the number of its terms."""
    n = _add_product(e, np.int64(0), a[0], b[1])
    n = _add_product(e, n, -a[1], b[0])
    if a[2] != 0.0 or a[3] != 0.0 or b[2] != 0.0 or b[3] != 0.0:
        for u, v in ((a[0], b[3]), (a[2], b[1]), (a[2], b[3])):
            n = _add_product(e, n, u, v)
        for u, v in ((a[1], b[2]), (a[3], b[0]), (a[3], b[2])):
            n = _add_product(e, n, -u, v)
    return n


@helper
def _square(e, a):
    """Squared length of a difference as an exact sum; the number of its terms."""
    n = _add_product(e, np.int64(0), a[0], a[0])
    n = _add_product(e, n, a[1], a[1])
    if a[2] != 0.0 or a[3] != 0.0:
        n = _add_product(e, n, 2.0 * a[0], a[2])
        n = _add_product(e, n, a[2], a[2])
        n = _add_product(e, n, 2.0 * a[1], a[3])
        n = _add_product(e, n, a[3], a[3])
    return n


@helper
def _orient_exact(ax, ay, bx, by, cx, cy):
    e = np.empty(16)
    n = _cross(e, _difference(ax, ay, cx, cy), _difference(bx, by, cx, cy))
    area = 0.0
    for i in range(n):
        area += e[i]
    return area


@helper
def _circle_exact(ax, ay, bx, by, cx, cy, px, py):
    """The largest term of the exact determinant, which has its sign; 0 only if it is 0."""
    a = _difference(ax, ay, px, py)
    b = _difference(bx, by, px, py)
    c = _difference(cx, cy, px, py)
    square, cross, e = np.empty(16), np.empty(16), np.empty(1536)
    n = np.int64(0)
    for u, v, w in ((a, b, c), (b, c, a), (c, a, b)):
        squares, crosses = _square(square, u), _cross(cross, v, w)
        for i in range(squares):
            for j in range(crosses):
                n = _add_product(e, n, square[i], cross[j])
    return e[n - 1] if n > 0 else 0.0


# The two questions of which everything is made.


@helper
def orient(ax, ay, bx, by, cx, cy):
    """Twice the area of triangle abc, with the exact sign: > 0 counter-clockwise, 0 on a line."""
    left = (ax - cx) * (by - cy)
    right = (ay - cy) * (bx - cx)
    area = left - right
    if abs(area) > ORIENT_ERROR * (abs(left) + abs(right)):
        return area
    return _orient_exact(ax, ay, bx, by, cx, cy)


@helper
def in_circle(ax, ay, bx, by, cx, cy, px, py):
    """Whether p is inside the circle of the counter-clockwise triangle abc."""
    adx, ady = ax - px, ay - py
    bdx, bdy = bx - px, by - py
    cdx, cdy = cx - px, cy - py
    bc, cb = bdx * cdy, cdx * bdy
    ca, ac = cdx * ady, adx * cdy
    ab, ba = adx * bdy, bdx * ady
    a2, b2, c2 = adx * adx + ady * ady, bdx * bdx + bdy * bdy, cdx * cdx + cdy * cdy
    det = a2 * (bc - cb) + b2 * (ca - ac) + c2 * (ab - ba)
    size = a2 * (abs(bc) + abs(cb)) + b2 * (abs(ca) + abs(ac)) + c2 * (abs(ab) + abs(ba))
    if abs(det) > CIRCLE_ERROR * size:
        return det > 0.0
    rectangle = _in_pairs(ax, bx, cx, px) and _in_pairs(ay, by, cy, py)  # as in any grid
    det = 0.0 if rectangle else _circle_exact(ax, ay, bx, by, cx, cy, px, py)
    if det != 0.0:
        return det > 0.0
    return _in_common_circle(ax, ay, bx, by, cx, cy, px, py)


@helper
def _in_pairs(a, b, c, d):
    """Whether the four numbers are two pairs of equal ones."""
    return (d == a and b == c) or (d == b and c == a) or (d == c and a == b)


@helper
def _in_common_circle(ax, ay, bx, by, cx, cy, px, py):
    """The same for points on one circle: the one with the greatest (x, y) counts as outside."""
    a, b, c, p = (ax, ay), (bx, by), (cx, cy), (px, py)
    if p > a and p > b and p > c:
        return False
    if a > b and a > c:
        return orient(px, py, bx, by, cx, cy) > 0.0
    if b > c:
        return orient(ax, ay, px, py, cx, cy) > 0.0
    return orient(ax, ay, bx, by, px, py) > 0.0


# Finding a triangle.


@helper
def is_ghost(triangles, t):
    """Whether a triangle of a live mesh lies outside the hull."""
    return triangles[t, 1] < 0 or triangles[t, 2] < 0


@helper
def walk(xy, triangles, neighbours, x, y, hint):
    """The triangle at a position, the last real triangle visited, and whether an edge is touched.

    Outside the hull the first is -1 in a Mesh, a ghost in a LiveMesh. Goes through any edge that
    has the position on its other side; in a Delaunay triangulation that comes to an end.
    """
    t = hint
    if is_ghost(triangles, t):
        t = neighbours[t, 1 if triangles[t, 1] < 0 else 2]
    before, last, touches = -2, t, False
    while t >= 0:
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        if b < 0 or c < 0:
            break
        ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
        last, touches = t, False
        if neighbours[t, 0] != before:
            side = orient(bx, by, cx, cy, x, y)
            if side < 0.0:
                before, t = t, neighbours[t, 0]
                continue
            touches = side == 0.0
        if neighbours[t, 1] != before:
            side = orient(cx, cy, ax, ay, x, y)
            if side < 0.0:
                before, t = t, neighbours[t, 1]
                continue
            touches = touches or side == 0.0
        if neighbours[t, 2] != before:
            side = orient(ax, ay, bx, by, x, y)
            if side < 0.0:
                before, t = t, neighbours[t, 2]
                continue
            touches = touches or side == 0.0
        break
    return t, last, touches


@helper
def locate(xy, triangles, neighbours, x, y, hint):
    """The triangle at a position, found from triangle `hint`; the same for any hint.

    On an edge or a vertex it is the triangle a hair to the right (then above); on the hull, where
    that may be outside, the last one counter-clockwise around the vertex. Outside the hull: -1 in
    a Mesh, a ghost in a LiveMesh (see is_ghost).
    """
    t, last, touches = walk(xy, triangles, neighbours, x, y, hint)
    if t != last or not touches:
        return t
    return _of_the_touched(xy, triangles, neighbours, x, y, t)


@helper
def _of_the_touched(xy, triangles, neighbours, x, y, t):
    """The triangle chosen by rule among those that touch a position, of which t is one."""
    outside = False
    k = 0
    while k < 3:
        a, b = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
        ax, ay, bx, by = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1]
        k += 1
        leftwards = by > ay or (by == ay and bx < ax)  # what is a hair to the right is across
        if leftwards and orient(ax, ay, bx, by, x, y) == 0.0:
            across = neighbours[t, k - 1]
            if across < 0 or is_ghost(triangles, across):
                outside = True
            else:
                t, k = across, 0
    if outside:
        t = _last_around(xy, triangles, neighbours, x, y, t)
    return t


@helper
def _last_around(xy, triangles, neighbours, x, y, t):
    """The last triangle before the hull, counter-clockwise around a vertex at the position."""
    k = 0
    while k < 3:
        v = triangles[t, k]
        if xy[v, 0] == x and xy[v, 1] == y:
            across = neighbours[t, (k + 1) % 3]
            if across < 0 or is_ghost(triangles, across):
                break
            t, k = across, 0
        else:
            k += 1
    return t


@kernel
def locate_block(xy, triangles, neighbours, places, order, first, last, hint, found):
    """Fill in the triangles at positions order[first:last], -1 outside the hull; the next hint."""
    for i in range(first, last):
        x, y = places[order[i], 0], places[order[i], 1]
        t, hint, touches = walk(xy, triangles, neighbours, x, y, hint)
        inside = t == hint
        if inside and touches:
            t = _of_the_touched(xy, triangles, neighbours, x, y, t)
        found[order[i]] = t if inside else -1
    return hint


@helper
def facet_weights(xy, triangles, t, x, y):
    """Barycentric weights (three floats >= 0, sum 1) of a position in triangle t."""
    a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
    u = orient(bx, by, cx, cy, x, y)
    v = orient(cx, cy, ax, ay, x, y)
    w = orient(ax, ay, bx, by, x, y)
    area = u + v + w
    return u / area, v / area, w / area


@kernel
def interpolate_block(xy, triangles, values, places, found, first, last, out):
    """Fill in linear interpolations at places[first:last]; NaN where `found` is -1."""
    for i in range(first, last):
        t = found[i]
        if t < 0:
            out[i] = np.nan
            continue
        u, v, w = facet_weights(xy, triangles, t, places[i, 0], places[i, 1])
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        out[i] = u * values[a] + v * values[b] + w * values[c]


# Growing.


@kernel
def start(mesh, points):
    """Make the first triangle and its ghosts; False if all points are on one line."""
    xy, triangles, neighbours = mesh.xy, mesh.triangles, mesh.neighbours
    a, b = points[0], points[0]
    for point in points:
        c = point
        ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
        if ax == bx and ay == by:
            b = c
            continue
        side = orient(ax, ay, bx, by, cx, cy)
        if side == 0.0:
            continue
        if side < 0.0:
            b, c = c, b
        vertices = ((a, b, c), (b, a, GHOST), (c, b, GHOST), (a, c, GHOST))
        across = ((2, 3, 1), (3, 2, 0), (1, 3, 0), (2, 1, 0))
        for t in range(4):
            for k in range(3):
                triangles[t, k], neighbours[t, k] = vertices[t][k], across[t][k]
        mesh.size[0] = 4
        return True
    return False


@helper
def insert(mesh, point, hint):
    """Insert a point into a live mesh; a triangle of which it is vertex 0.

    Returns ~v (negative) if vertex v is at that position already; then nothing is changed. All
    changed triangles are around the new vertex, and it is vertex 0 of each: from t go on to
    `neighbours[t, 1]` until t comes again.

    The triangles whose circle holds the point are taken out; their rim is joined to the point
    (Bowyer 1981, Watson 1981). The rim is found in order, since those triangles form a tree.
    """
    xy, triangles, neighbours = mesh.xy, mesh.triangles, mesh.neighbours
    x, y = xy[point, 0], xy[point, 1]
    t, _, _ = walk(xy, triangles, neighbours, x, y, hint)
    for k in range(3):
        v = triangles[t, k]
        if v >= 0 and xy[v, 0] == x and xy[v, 1] == y:
            return ~v
    waiting, taken, corner, outer = mesh.scratch  # edges are numbered 4 t + k
    taken[0] = t
    waiting[0], waiting[1], waiting[2] = 4 * t + 2, 4 * t + 1, 4 * t
    count, edges, rim = 1, 3, 0
    while edges > 0:
        edges -= 1
        t, k = waiting[edges] >> 2, waiting[edges] & 3
        s = neighbours[t, k]
        j = (neighbours[s, 1] == t) + 2 * (neighbours[s, 2] == t)
        previous = j - 1 if j > 0 else 2
        if _conflict(xy, triangles, s, x, y):
            taken[count] = s
            count += 1
            waiting[edges], waiting[edges + 1] = 4 * s + previous, 4 * s + (j + 1 if j < 2 else 0)
            edges += 2
        else:
            corner[rim], outer[rim] = triangles[s, previous], 4 * s + j
            rim += 1
    taken[count], taken[count + 1] = mesh.size[0], mesh.size[0] + 1
    mesh.size[0] += 2
    before = taken[rim - 1]
    for i in range(rim):
        t, following = taken[i], i + 1 if i + 1 < rim else 0
        s, j = outer[i] >> 2, outer[i] & 3
        triangles[t, 0], neighbours[t, 0] = point, s
        triangles[t, 1], neighbours[t, 1] = corner[i], taken[following]
        triangles[t, 2], neighbours[t, 2] = corner[following], before
        neighbours[s, j] = before = t
    return taken[0]


@helper
def _conflict(xy, triangles, t, x, y):
    """Whether a new vertex invalidates a triangle or ghost."""
    a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    if b < 0:
        return _beyond(xy[c, 0], xy[c, 1], xy[a, 0], xy[a, 1], x, y)
    if c < 0:
        return _beyond(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], x, y)
    return in_circle(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1], x, y)


@helper
def _beyond(ax, ay, bx, by, x, y):
    """Whether a position is outside of hull edge ab (to its left), or on it."""
    side = orient(ax, ay, bx, by, x, y)
    if side != 0.0:
        return side > 0.0
    if ax != bx:
        return min(ax, bx) < x < max(ax, bx)
    return min(ay, by) < y < max(ay, by)


@kernel
def insert_block(mesh, points, first, last, hint, vertex_of):
    """Insert points[first:last], and note the vertex at the position of each; the next hint."""
    for i in range(first, last):
        point = points[i]
        t = insert(mesh, point, hint)
        if t < 0:
            vertex_of[point] = ~t
        else:
            vertex_of[point] = point
            hint = t
    return hint


@kernel
def drop_ghosts(triangles, neighbours, size):
    """Move the real triangles to the front, and set neighbours at the hull to -1; their number."""
    for g in range(size):
        if is_ghost(triangles, g):
            s = neighbours[g, 1 if triangles[g, 1] < 0 else 2]
            _exchange(neighbours, s, g, -1)
    gap, end = 0, size
    while True:
        while gap < end and not is_ghost(triangles, gap):
            gap += 1
        while gap < end and is_ghost(triangles, end - 1):
            end -= 1
        if gap == end:
            return end
        end -= 1
        for k in range(3):
            triangles[gap, k], neighbours[gap, k] = triangles[end, k], neighbours[end, k]
            if neighbours[gap, k] >= 0:
                _exchange(neighbours, neighbours[gap, k], end, gap)


@helper
def _exchange(neighbours, t, old, new):
    """Replace a neighbour of triangle t by another one."""
    for k in range(3):
        if neighbours[t, k] == old:
            neighbours[t, k] = new


# Order of insertion: rounds of growing size, along a Hilbert curve in each.


@kernel
def keys_block(xy, points, low_x, low_y, scale, rounds, first, last, keys, counts):
    """Fill in the sort keys of points[first:last], and count their digits."""
    for i in range(first, last):
        x = int((xy[points[i], 0] - low_x) * scale)
        y = int((xy[points[i], 1] - low_y) * scale)
        key = _hilbert(x, y)
        if rounds:
            key |= _round(key) << (2 * BITS)
        keys[i] = key
        for p in range(PASSES):
            counts[p, (key >> (p * DIGIT)) & (2**DIGIT - 1)] += 1


@helper
def _hilbert(x, y):
    """Index of a cell along the Hilbert curve."""
    key = 0
    for bit in range(BITS - 1, -1, -1):
        right, upper = (x >> bit) & 1, (y >> bit) & 1
        key = (key << 2) | ((3 * right) ^ upper)
        turned = upper - 1  # all bits where the curve of the quarter is turned, else none
        mirrored = turned & -right
        swap = (x ^ y) & turned
        x, y = x ^ swap ^ mirrored, y ^ swap ^ mirrored
    return key


@helper
def _round(key):
    """Insertion round of a cell, drawn from its key alone; the last round has most cells."""
    mixed = key * 0x2545F4914F6CDD1D
    mixed ^= mixed >> 29
    mixed *= 0x1B873593CC9E2D51
    mixed ^= mixed >> 32
    back = 0
    while back < ROUNDS - 1 and mixed & (2**THINNING - 1) == 0:
        mixed >>= THINNING
        back += 1
    return ROUNDS - 1 - back


@kernel
def sort_block(keys, points, shift, starts, first, last, keys_out, points_out):
    """One pass of a radix sort over [first:last], by the digit at `shift`."""
    for i in range(first, last):
        digit = (keys[i] >> shift) & (2**DIGIT - 1)
        to = starts[digit]
        starts[digit] += 1
        keys_out[to], points_out[to] = keys[i], points[i]
