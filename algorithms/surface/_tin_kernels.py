"""Compiled loops of :mod:`algorithms.surface._tin`: surfaces over a Delaunay triangulation.

Points are numbered in the order of x, then y. Sums run in the order of these numbers, differences
are taken from the position itself, and a cell centre on an edge looks at the two ends of that edge
alone. So a value depends on nothing but the points that it is made of: not on other points, not
on the triangle from which a cell is looked at, not on where a tile begins.

References
----------
Sibson, R. (1981). A brief description of natural neighbour interpolation. In: Interpreting
Multivariate Data, Wiley, 21-36.
Nielson, G. M. (1983). A method for interpolating scattered data based upon a minimum norm
network. Mathematics of Computation 40, 253-271. The gradients.
Alfeld, P. (1984). A trivariate Clough-Tocher scheme for tetrahedral data. Computer Aided Geometric
Design 1, 169-181. The cubic pieces, with the cross-boundary directions of scipy.
"""

from __future__ import annotations

import math

import numpy as np

from algorithms.shared.kernels.compiling import kernel
from algorithms.shared.kernels.delaunay import in_circle, orient
from algorithms.shared.kernels.sorting import sort_few

CLOSE = 1e-6  # cells: what rounding may move; candidates this close are put to the exact test


# Triangles -----------------------------------------------------------------------------------


@kernel
def _turned(triangles, t):
    """Vertices of a triangle, counter-clockwise, beginning with the lowest index."""
    a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    if b < a and b < c:
        return b, c, a
    if c < a and c < b:
        return c, a, b
    return a, b, c


@kernel
def _squared_radius(ax, ay, bx, by, cx, cy):
    """Squared radius of the circle through three points."""
    ab = (bx - ax) ** 2 + (by - ay) ** 2
    bc = (cx - bx) ** 2 + (cy - by) ** 2
    ca = (ax - cx) ** 2 + (ay - cy) ** 2
    twice = orient(ax, ay, bx, by, cx, cy)
    return (ab / twice) * (bc / twice) * ca / 4.0 if twice != 0.0 else np.inf


@kernel
def _is_gap(xy, triangles, t, limit):
    """Whether the circumcircle of a triangle has a radius larger than the limit."""
    if np.isinf(limit):
        return False
    a, b, c = _turned(triangles, t)
    ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
    return _squared_radius(ax, ay, bx, by, cx, cy) > limit * limit


@kernel
def _crossing(ax, ay, bx, by, y, low, high):
    """Interval low..high, widened by the x at which an edge crosses the line of constant y."""
    if min(ay, by) <= y <= max(ay, by):
        x = ax if ay == by else ax + (y - ay) / (by - ay) * (bx - ax)
        other = bx if ay == by else x
        return min(low, x, other), max(high, x, other)
    return low, high


@kernel
def draw(xy, triangles, first, last, limit, xs, ys, cell, facet):
    """Enter triangles first..last, if they are no gaps, into the cells whose centre they contain.

    Of two triangles with a centre on their common edge either may be entered.
    """
    rows, cols = facet.shape
    for t in range(first, last):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ay, by, cy = xy[a, 1], xy[b, 1], xy[c, 1]
        top = max(0, math.ceil((ys[0] - max(ay, by, cy)) / cell - CLOSE))
        bottom = min(rows - 1, math.floor((ys[0] - min(ay, by, cy)) / cell + CLOSE))
        if top > bottom:
            continue
        ax, bx, cx = xy[a, 0], xy[b, 0], xy[c, 0]
        left = max(0, math.ceil((min(ax, bx, cx) - xs[0]) / cell - CLOSE))
        right = min(cols - 1, math.floor((max(ax, bx, cx) - xs[0]) / cell + CLOSE))
        if left > right or _is_gap(xy, triangles, t, limit):
            continue
        for row in range(top, bottom + 1):
            y = ys[row]
            low, high = _crossing(ax, ay, bx, by, y, np.inf, -np.inf)
            low, high = _crossing(bx, by, cx, cy, y, low, high)
            low, high = _crossing(cx, cy, ax, ay, y, low, high)
            if low > high:
                continue
            begin = max(left, math.ceil((low - xs[0]) / cell - CLOSE))
            end = min(right, math.floor((high - xs[0]) / cell + CLOSE))
            for col in range(begin, end + 1):
                x = xs[col]
                if (
                    orient(ax, ay, bx, by, x, y) >= 0.0
                    and orient(bx, by, cx, cy, x, y) >= 0.0
                    and orient(cx, cy, ax, ay, x, y) >= 0.0
                ):
                    facet[row, col] = t


@kernel
def _weights(xy, a, b, c, x, y):
    """Barycentric weights; one is exactly 0 where the position is on the opposite edge."""
    ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
    area = orient(ax, ay, bx, by, cx, cy)
    u = orient(bx, by, cx, cy, x, y) / area
    v = orient(cx, cy, ax, ay, x, y) / area
    w = orient(ax, ay, bx, by, x, y) / area
    return u, v, w


@kernel
def _edge(a, b, c, u, v, w):
    """End vertices, sorted, of the edge below a position; twice a vertex at it; else -1, -1."""
    if u == 0.0:
        i, j = (c if v == 0.0 else b), (b if w == 0.0 else c)
    elif v == 0.0:
        i, j = (a if w == 0.0 else c), a
    elif w == 0.0:
        i, j = a, b
    else:
        return -1, -1
    return min(i, j), max(i, j)


@kernel
def _share(xy, i, j, x, y):
    """Fraction of the edge from i to j at which a position lies, 0..1."""
    dx, dy = xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
    return (x - xy[i, 0]) / dx if abs(dx) >= abs(dy) else (y - xy[i, 1]) / dy


@kernel
def _on_facet(xy, values, triangles, t, x, y):
    """Linear interpolation in triangle t."""
    a, b, c = _turned(triangles, t)
    return on_corners(xy, values, a, b, c, x, y)


@kernel
def on_corners(xy, values, a, b, c, x, y):
    """Linear interpolation in a triangle, counter-clockwise, of which `a` is the lowest index."""
    u, v, w = _weights(xy, a, b, c, x, y)
    i, j = _edge(a, b, c, u, v, w)
    if i >= 0:
        return values[i] + (0.0 if i == j else _share(xy, i, j, x, y) * (values[j] - values[i]))
    return values[a] + v * (values[b] - values[a]) + w * (values[c] - values[a])


@kernel
def linear(xy, values, triangles, facet, first, last, xs, ys, surface):
    """Fill in the columns first..last of the surface by linear interpolation, inside triangles."""
    for row in range(len(ys)):
        for col in range(first, last):
            t = facet[row, col]
            if t >= 0:
                surface[row, col] = _on_facet(xy, values, triangles, t, xs[col], ys[row])


# Natural neighbours --------------------------------------------------------------------------


@kernel
def _cavity(xy, triangles, neighbours, t, x, y, waiting, rim):
    """Find the triangles whose circumcircle contains a position in triangle t, and their rim.

    Edges are numbered 4 t + k, edge k being opposite vertex k. The rim is found in order,
    counter-clockwise, since those triangles form a tree.

    Returns
    -------
    waiting, rim : the arrays given, or larger ones
    count : edges on the rim; rim[count] is rim[0]
    """
    waiting[0], waiting[1], waiting[2] = 4 * t + 2, 4 * t + 1, 4 * t
    edges, count = 3, 0
    while edges > 0:
        if edges + 2 > len(waiting) or count + 2 > len(rim):
            waiting = np.concatenate((waiting, waiting))
            rim = np.concatenate((rim, rim))
        edges -= 1
        s, k = waiting[edges] >> 2, waiting[edges] & 3
        n = neighbours[s, k]
        if n >= 0:
            a, b, c = triangles[n, 0], triangles[n, 1], triangles[n, 2]
            ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
            if in_circle(ax, ay, bx, by, cx, cy, x, y):
                j = (neighbours[n, 1] == s) + 2 * (neighbours[n, 2] == s)
                waiting[edges], waiting[edges + 1] = 4 * n + (j + 2) % 3, 4 * n + (j + 1) % 3
                edges += 2
                continue
        rim[count] = 4 * s + k
        count += 1
    rim[count] = rim[0]
    return waiting, rim, count


@kernel
def _centre(ax, ay, bx, by):
    """Centre of the circle through the origin, a and b; infinite if these are collinear."""
    aa, bb, twice = ax * ax + ay * ay, bx * bx + by * by, 2.0 * (ax * by - ay * bx)
    if twice == 0.0:
        return np.inf, np.inf
    return (by * aa - ay * bb) / twice, (ax * bb - bx * aa) / twice


@kernel
def _stolen(xy, triangles, neighbours, x, y, rim, i, here, there):
    """Twice the area that a position takes from the Voronoi cell between rim edges i and i + 1.

    The area is a polygon: from the centre `here` of the circle through the position and rim edge i,
    along the centres of the old circles around the vertex, to that of rim edge i + 1, `there`.
    """
    t, k = rim[i] >> 2, rim[i] & 3
    vertex = triangles[t, (k + 2) % 3]
    area, before_x, before_y = 0.0, 0.0, 0.0  # all seen from `here`
    while True:
        a, b, c = _turned(triangles, t)
        ax, ay = xy[a, 0], xy[a, 1]
        u, v = _centre(xy[b, 0] - ax, xy[b, 1] - ay, xy[c, 0] - ax, xy[c, 1] - ay)
        u, v = u + (ax - x) - here[0], v + (ay - y) - here[1]
        area += before_x * v - before_y * u
        before_x, before_y = u, v
        previous = 0 if triangles[t, 1] == vertex else 1 if triangles[t, 2] == vertex else 2
        if rim[i + 1] == 4 * t + previous:
            break
        t = neighbours[t, previous]
    return abs(area + before_x * (there[1] - here[1]) - before_y * (there[0] - here[0]))


@kernel
def _rim_centre(xy, triangles, x, y, edge):
    """Centre, relative to a position, of the circle through it and both ends of a rim edge."""
    t, k = edge >> 2, edge & 3
    a, b = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
    return _centre(xy[a, 0] - x, xy[a, 1] - y, xy[b, 0] - x, xy[b, 1] - y)


@kernel
def natural(xy, values, triangles, neighbours, limit, facet, first, last, xs, ys, surface, used):
    """Fill in the columns first..last by natural neighbour interpolation (Sibson weights).

    A cell stays empty if a corner of the Voronoi cell of its centre is beyond the limit.
    """
    waiting, rim = np.empty(64, np.int64), np.empty(64, np.int64)
    for row in range(len(ys)):
        y = ys[row]
        for col in range(first, last):
            t, x = facet[row, col], xs[col]
            if t < 0:
                continue
            a, b, c = _turned(triangles, t)
            i, j = _edge(a, b, c, *_weights(xy, a, b, c, x, y))
            if i >= 0 and (i == j or _at_hull(triangles, neighbours, t, i, j)):
                if i == j or np.isinf(limit):
                    surface[row, col] = _on_facet(xy, values, triangles, t, x, y)
                    used[row, col] = 1 if i == j else 2
                continue
            waiting, rim, count = _cavity(xy, triangles, neighbours, t, x, y, waiting, rim)
            _begin_with_first(triangles, rim, count)
            here = _rim_centre(xy, triangles, x, y, rim[0])
            farthest, total, above, low = 0.0, 0.0, 0.0, values[a]
            for e in range(count):
                there = _rim_centre(xy, triangles, x, y, rim[e + 1])
                taken = _stolen(xy, triangles, neighbours, x, y, rim, e, here, there)
                vertex = triangles[rim[e] >> 2, ((rim[e] & 3) + 2) % 3]
                if e == 0:
                    low = values[vertex]
                total += taken
                above += taken * (values[vertex] - low)
                farthest = max(farthest, here[0] * here[0] + here[1] * here[1])
                here = there
            if farthest <= limit * limit:
                used[row, col] = count
                surface[row, col] = low + above / total if total > 0.0 else np.nan
                if np.isnan(surface[row, col]):  # too thin a triangle, at the hull
                    surface[row, col] = _on_facet(xy, values, triangles, t, x, y)


@kernel
def _at_hull(triangles, neighbours, t, i, j):
    """Whether the edge of triangle t between vertices i and j is on the convex hull."""
    for k in range(3):
        if triangles[t, k] not in (i, j):
            return neighbours[t, k] < 0
    return False


@kernel
def _begin_with_first(triangles, rim, count):
    """Rotate the rim so that its first edge begins at the vertex with the lowest index."""
    start, lowest = 0, -1
    for e in range(count):
        vertex = triangles[rim[e] >> 2, ((rim[e] & 3) + 1) % 3]
        if lowest < 0 or vertex < lowest:
            start, lowest = e, vertex
    rim[:count] = np.concatenate((rim[start:count], rim[:start]))
    rim[count] = rim[0]


# Cubic ---------------------------------------------------------------------------------------


@kernel
def edges(xy, triangles, neighbours, limit, starts):
    """Neighbours of each vertex along edges, sorted by index.

    Those of vertex i are ends[starts[i] : starts[i + 1]]; edges of gaps are left out.
    """
    gap = np.empty(len(triangles), np.bool_)
    for t in range(len(triangles)):
        gap[t] = _is_gap(xy, triangles, t, limit)
    for t in range(len(triangles)):
        for k in range(3):
            if not gap[t]:
                starts[triangles[t, (k + 1) % 3] + 1] += 1
                n = neighbours[t, k]
                starts[triangles[t, (k + 2) % 3] + 1] += n < 0 or gap[n]
    for i in range(len(xy)):
        starts[i + 1] += starts[i]
    ends, free = np.empty(starts[-1], np.int32), starts[:-1].copy()
    for t in range(len(triangles)):
        for k in range(3):
            if not gap[t]:
                a, b, n = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3], neighbours[t, k]
                ends[free[a]] = b
                free[a] += 1
                if n < 0 or gap[n]:
                    ends[free[b]] = a
                    free[b] += 1
    for i in range(len(xy)):
        sort_few(ends[starts[i] : starts[i + 1]])
    return ends


@kernel
def planes(xy, values, starts, ends, first, last, ways, inverse, plane):
    """Prepare the gradient estimation at vertices first..last.

    `ways` takes the direction of each edge, weighted by its length to the power of -3/2;
    `inverse` xx, xy, yy of the inverse of the sum of their squares at each vertex; `plane` the
    slope of the plane through the vertex that fits its neighbours best with these weights.
    """
    for i in range(first, last):
        xx, mixed, yy, sx, sy = 0.0, 0.0, 0.0, 0.0, 0.0
        for e in range(starts[i], starts[i + 1]):
            j = ends[e]
            dx, dy = xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
            square = dx * dx + dy * dy
            weight = 1.0 / math.sqrt(square * math.sqrt(square))
            dx, dy, rise = weight * dx, weight * dy, weight * (values[j] - values[i])
            ways[e, 0], ways[e, 1] = dx, dy
            xx, mixed, yy = xx + dx * dx, mixed + dx * dy, yy + dy * dy
            sx, sy = sx + dx * rise, sy + dy * rise
        area = xx * yy - mixed * mixed
        if area > 0.0:
            xx, mixed, yy = yy / area, -mixed / area, xx / area
            inverse[i, 0], inverse[i, 1], inverse[i, 2] = xx, mixed, yy
            plane[i, 0], plane[i, 1] = xx * sx + mixed * sy, mixed * sx + yy * sy


@kernel
def relax(starts, ends, ways, inverse, plane, first, last, weight, old, new):
    """One relaxation step for the gradients of vertices first..last, towards edges that bend least.

    Edges are the cubic curves that the values and gradients of both ends make. `old` holds the
    gradients of the step before, `new` those of two steps before, and takes those of this step.
    """
    for i in range(first, last):
        sx, sy = 0.0, 0.0
        for e in range(starts[i], starts[i + 1]):
            j = ends[e]
            slope = ways[e, 0] * old[j, 0] + ways[e, 1] * old[j, 1]
            sx, sy = sx + ways[e, 0] * slope, sy + ways[e, 1] * slope
        x = 1.5 * plane[i, 0] - 0.5 * (inverse[i, 0] * sx + inverse[i, 1] * sy)
        y = 1.5 * plane[i, 1] - 0.5 * (inverse[i, 1] * sx + inverse[i, 2] * sy)
        new[i, 0] += weight * (x - new[i, 0])
        new[i, 1] += weight * (y - new[i, 1])


@kernel
def _tilt(xy, triangles, neighbours, limit, t, i, a, b, c):
    """Direction along which the derivative across the edge bc is linear: to the apex beyond it.

    i is the vertex a as it stands in triangle t. The coefficient `g` of Alfeld's construction;
    the edge's middle, -1/2, where there is no triangle beyond.
    """
    k = 0 if triangles[t, 0] == i else 1 if triangles[t, 1] == i else 2
    n = neighbours[t, k]
    if n < 0 or _is_gap(xy, triangles, n, limit):
        return -0.5
    for m in range(3):
        apex = triangles[n, m]
        if apex not in (b, c):
            _, v, w = _weights(xy, a, b, c, xy[apex, 0], xy[apex, 1])
            return -(v + 2.0 * w) / (3.0 * (v + w))
    return -0.5


@kernel
def _along(xy, values, gradients, i, j):
    """The two inner control values of the cubic curve along the edge from i to j."""
    dx, dy = xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
    return (
        values[i] + (gradients[i, 0] * dx + gradients[i, 1] * dy) / 3.0,
        values[j] - (gradients[j, 0] * dx + gradients[j, 1] * dy) / 3.0,
    )


@kernel
def _on_curve(xy, values, gradients, i, j, x, y):
    """Value of the cubic curve on the edge from i to j; the value at the vertex if i equals j."""
    if i == j:
        return values[i]
    s = _share(xy, i, j, x, y)
    p, q = _along(xy, values, gradients, i, j)
    r = 1.0 - s
    return r * r * r * values[i] + 3.0 * r * s * (r * p + s * q) + s * s * s * values[j]


@kernel
def _on_piece(xy, values, gradients, triangles, neighbours, limit, t, x, y):
    """Value of the cubic surface in triangle t, in the Bernstein form of its three subtriangles.

    Names say how often a vertex counts: c210 belongs to twice the first and once the second,
    and the fourth number in c2001 is the middle of the triangle, in which the parts meet.
    """
    a, b, c = _turned(triangles, t)
    u, v, w = _weights(xy, a, b, c, x, y)
    i, j = _edge(a, b, c, u, v, w)
    if i >= 0:
        return _on_curve(xy, values, gradients, i, j, x, y)
    c300, c030, c003 = values[a], values[b], values[c]
    c210, c120 = _along(xy, values, gradients, a, b)
    c021, c012 = _along(xy, values, gradients, b, c)
    c102, c201 = _along(xy, values, gradients, c, a)
    c2001 = (c210 + c201 + c300) / 3.0
    c0201 = (c120 + c030 + c021) / 3.0
    c0021 = (c102 + c012 + c003) / 3.0
    g = _tilt(xy, triangles, neighbours, limit, t, a, a, b, c)
    h = _tilt(xy, triangles, neighbours, limit, t, b, b, c, a)
    k = _tilt(xy, triangles, neighbours, limit, t, c, c, a, b)
    c0111 = _across(g, c030, c021, c012, c003, c0201, c0021)
    c1011 = _across(h, c003, c102, c201, c300, c0021, c2001)
    c1101 = _across(k, c300, c210, c120, c030, c2001, c0201)
    c1002 = (c1101 + c1011 + c2001) / 3.0
    c0102 = (c1101 + c0111 + c0201) / 3.0
    c0012 = (c1011 + c0111 + c0021) / 3.0
    low = min(u, v, w)
    u, v, w, m = u - low, v - low, w - low, 3.0 * low
    return (
        u * u * (u * c300 + 3.0 * (v * c210 + w * c201 + m * c2001))
        + v * v * (v * c030 + 3.0 * (u * c120 + w * c021 + m * c0201))
        + w * w * (w * c003 + 3.0 * (u * c102 + v * c012 + m * c0021))
        + 6.0 * m * (u * v * c1101 + u * w * c1011 + v * w * c0111)
        + 3.0 * m * m * (u * c1002 + v * c0102 + w * c0012)
        + m * m * m * (c1002 + c0102 + c0012) / 3.0
    )


@kernel
def _across(g, p, pq, qp, q, inner_p, inner_q):
    """Control value beside the middle of an edge p..q that makes the surface smooth across it."""
    bend = g * (-p + 3.0 * pq - 3.0 * qp + q)
    return (bend - p + 2.0 * pq - qp + inner_p + inner_q) / 2.0


@kernel
def cubic(xy, values, gradients, triangles, neighbours, limit, facet, first, last, xs, ys, surface):
    """Fill in the columns first..last of the surface by cubic interpolation, inside triangles."""
    for row in range(len(ys)):
        for col in range(first, last):
            t = facet[row, col]
            if t >= 0:
                surface[row, col] = _on_piece(
                    xy, values, gradients, triangles, neighbours, limit, t, xs[col], ys[row]
                )


# Leaving one out -----------------------------------------------------------------------------


@kernel
def triangle_of_each(triangles, n):
    """Index of a triangle at each vertex, -1 where there is none; shape (n,)."""
    found = np.full(n, -1, np.int32)
    for t in range(len(triangles)):
        for k in range(3):
            found[triangles[t, k]] = t
    return found


@kernel
def _ring(xy, triangles, neighbours, limit, t, vertex, ring):
    """Neighbours of a vertex, counter-clockwise, and their number: 0 at the hull and at gaps."""
    begin, count = t, 0
    while t >= 0 and not _is_gap(xy, triangles, t, limit):
        k = 0 if triangles[t, 0] == vertex else 1 if triangles[t, 1] == vertex else 2
        if count == len(ring):
            ring = np.concatenate((ring, ring))
        ring[count] = triangles[t, (k + 1) % 3]
        count += 1
        t = neighbours[t, (k + 1) % 3]
        if t == begin:
            return ring, count
    return ring, 0


@kernel
def _holds(xy, a, b, c, x, y):
    """Whether a position is in the counter-clockwise triangle abc or on its edges."""
    return (
        orient(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]) > 0.0
        and orient(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], x, y) >= 0.0
        and orient(xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1], x, y) >= 0.0
        and orient(xy[c, 0], xy[c, 1], xy[a, 0], xy[a, 1], x, y) >= 0.0
    )


@kernel
def _without(xy, ring, count, x, y):
    """Delaunay triangle around the position of a vertex after the vertex is removed.

    Begins with any that does. While a vertex of the ring lies within its circle, one of the three
    triangles with that vertex holds the position, and that triangle is taken next.
    """
    a, b, c = ring[0], ring[1], ring[2]
    for k in range(1, count - 1):
        if _holds(xy, a, ring[k], ring[k + 1], x, y):
            b, c = ring[k], ring[k + 1]
            break
    k = 0
    while k < count:
        q = ring[k]
        k += 1
        if q not in (a, b, c) and in_circle(
            xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1], xy[q, 0], xy[q, 1]
        ):
            if _holds(xy, q, b, c, x, y):
                a = q
            elif _holds(xy, a, q, c, x, y):
                b = q
            else:
                c = q
            k = 0
    return a, b, c


@kernel
def left_out(xy, values, triangles, neighbours, limit, of_each, first, last, squares):
    """Squared differences of vertices first..last from the triangle that is there without them.

    NaN at the hull and at gaps.
    """
    ring = np.empty(64, np.int32)
    one = np.empty((1, 3), np.int32)
    for i in range(first, last):
        squares[i] = np.nan
        if of_each[i] < 0:
            continue
        ring, count = _ring(xy, triangles, neighbours, limit, of_each[i], i, ring)
        if count > 0:
            one[0, 0], one[0, 1], one[0, 2] = _without(xy, ring, count, xy[i, 0], xy[i, 1])
            squares[i] = (values[i] - _on_facet(xy, values, one, 0, xy[i, 0], xy[i, 1])) ** 2
