"""Compiled loops of :mod:`algorithms.ground.ptd`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel
from algorithms.shared.kernels.delaunay import in_circle, is_ghost, locate, orient
from algorithms.shared.sets import root


class PointLimits(NamedTuple):
    """Conditions for a point to enter the surface; lengths in the unit of the points."""

    angle: float  # degrees, to each corner of the facet
    distance: float  # from the plane of the facet
    steepest: float  # rise per length
    stop: float  # no point enters a facet whose edges are all shorter
    reduce: float  # facets smaller than this lower the angle; 0 for never
    mirror: bool
    gentle: float  # greatest rise of the facet that a mirrored point falls on


@helper
def _normal(mesh, z, t):
    """Upward normal vector of facet t; its vertical component is twice the area in plan."""
    xy = mesh.xy
    a, b, c = mesh.triangles[t, 0], mesh.triangles[t, 1], mesh.triangles[t, 2]
    ux, uy, uz = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1], z[b] - z[a]
    vx, vy, vz = xy[c, 0] - xy[a, 0], xy[c, 1] - xy[a, 1], z[c] - z[a]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@helper
def _against(mesh, z, t, x, y, h):
    """Distance, angles and slopes of a point relative to facet t.

    Signed distance from its plane, greatest angle to its corners in degrees, steepest rise to
    them, longest edge, rise of the facet, and its highest corner.
    """
    xy = mesh.xy
    a = mesh.triangles[t, 0]
    nx, ny, nz = _normal(mesh, z, t)
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    distance = ((x - xy[a, 0]) * nx + (y - xy[a, 1]) * ny + (h - z[a]) * nz) / length
    sine, steepest, square, top = 0.0, 0.0, 0.0, a
    for k in range(3):
        v, w = mesh.triangles[t, k], mesh.triangles[t, (k + 1) % 3]
        square = max(square, (xy[v, 0] - xy[w, 0]) ** 2 + (xy[v, 1] - xy[w, 1]) ** 2)
        plan = np.sqrt((xy[v, 0] - x) ** 2 + (xy[v, 1] - y) ** 2)
        away = np.sqrt(plan**2 + (z[v] - h) ** 2)
        sine = max(sine, abs(distance) / away if away > abs(distance) else 1.0)
        steepest = max(steepest, (h - z[v]) / max(plan, 1e-9))
        if (z[v], xy[v, 0], xy[v, 1]) > (z[top], xy[top, 0], xy[top, 1]):
            top = v
    rise = np.sqrt(nx * nx + ny * ny) / nz
    return distance, np.degrees(np.arcsin(sine)), steepest, np.sqrt(square), rise, top


@helper
def _enters(mesh, z, t, x, y, h, limits, break_rise):
    """Whether a point may enter facet t, and its distance from the facet."""
    distance, angle, steepest, longest, rise, top = _against(mesh, z, t, x, y, h)
    most = limits.angle
    if limits.reduce > 0:
        most *= min(1.0, longest / limits.reduce)
    if longest < limits.stop:
        enters = False
    elif distance < 0:
        enters = True
    elif steepest > limits.steepest:
        enters = False
    elif angle <= most and distance <= limits.distance:
        enters = True
    else:
        enters = limits.mirror and rise >= break_rise
        enters = enters and _enters_beyond(mesh, z, t, x, y, h, limits, most, top)
    return enters, distance


@helper
def _enters_beyond(mesh, z, t, x, y, h, limits, angle, top):
    """Whether a point, mirrored in plan and height at corner `top` of facet t, is on the surface.

    On the other side of a break the surface may be known already. Mirrored in plan alone, plants
    on a slope would be held against the higher ground uphill. What is as steep as a wall there is
    no level to go on from: walls would let the roofs above them in.
    """
    x, y, h = 2 * mesh.xy[top, 0] - x, 2 * mesh.xy[top, 1] - y, 2 * z[top] - h
    s = locate(mesh.xy, mesh.triangles, mesh.neighbours, x, y, t)
    if is_ghost(mesh.triangles, s):
        return False
    _, seen, _, _, beyond, _ = _against(mesh, z, s, x, y, h)
    return seen <= angle and beyond <= limits.gentle


@helper
def _take_points(t, head, following, found, n):
    """Move the points of facet t from its list to `found`, from n on; the new count."""
    i = head[t]
    while i >= 0:
        found[n] = i
        n += 1
        i = following[i]
    head[t] = -1
    return n


@kernel
def points_of(facets, head, following, found):
    """Move the points of facets from their lists to `found`; their number."""
    n = 0
    for t in facets:
        n = _take_points(t, head, following, found, n)
    return n


@kernel
def points_at_rim(mesh, real, head, following, found):
    """Move the points of facets with a corner from `real` on to `found`; their number."""
    n = 0
    for t in range(mesh.size[0]):
        a, b, c = mesh.triangles[t, 0], mesh.triangles[t, 1], mesh.triangles[t, 2]
        if max(a, b, c) >= real:
            n = _take_points(t, head, following, found, n)
    return n


@kernel
def best_of_facets(
    mesh, z, points, entered, limits, break_rise, facet, head, following, best, lowest, chosen, n
):
    """Test points against their facets, and keep the lowest one per facet that may enter.

    Facets with such a point are listed in `chosen` from n on; returns how many there are now.
    Equal distances are decided by position, never by the order of the points. All points that
    are not vertices yet are put on the lists of their facets, `head` and `following`.
    """
    last = np.int64(0)
    for i in points:
        if entered[i]:
            continue
        x, y = mesh.xy[i, 0], mesh.xy[i, 1]
        hint = facet[i] if facet[i] >= 0 else last
        t = locate(mesh.xy, mesh.triangles, mesh.neighbours, x, y, hint)
        facet[i] = last = t
        following[i], head[t] = head[t], i
        good, distance = _enters(mesh, z, t, x, y, z[i], limits, break_rise)
        if not good:
            continue
        j = best[t]
        if j < 0:
            chosen[n] = t
            n += 1
        if j < 0 or (distance, x, y) < (lowest[t], mesh.xy[j, 0], mesh.xy[j, 1]):
            best[t], lowest[t] = i, distance
    return n


@kernel
def against_facets(mesh, z, points, facet, seen):
    """Fill in the greatest angle (row 0 of `seen`) and distance of each point from its facet."""
    t = np.int64(0)
    for k in range(len(points)):
        i = points[k]
        x, y = mesh.xy[i, 0], mesh.xy[i, 1]
        hint = facet[i] if facet[i] >= 0 else t
        facet[i] = t = locate(mesh.xy, mesh.triangles, mesh.neighbours, x, y, hint)
        seen[1, k], seen[0, k], _, _, _, _ = _against(mesh, z, t, x, y, z[i])


# Taking vertices out again.


@kernel
def take_out(mesh, gone, facet, head, following, found):
    """Remove the vertices marked in `gone`; list the points of the facets that go.

    Goes through the triangles from the last to the first: those behind have no such vertex, and
    only they change their number. `gone[-1]` must be False. Returns how many points are listed.
    """
    n, t = np.int64(0), mesh.size[0] - 1  # a plain 0 would be a type of its own
    while t >= 0:
        k = 0
        while k < 3 and not gone[mesh.triangles[t, k]]:
            k += 1
        if k == 3:
            t -= 1
        else:
            n = _remove(mesh, t, k, facet, head, following, found, n)
            t = min(t, mesh.size[0] - 1)
    return n


@helper
def _remove(mesh, t, k, facet, head, following, found, n):
    """Remove vertex k of triangle t from the mesh; it must not be on the hull.

    The triangles around it leave a hole, from which corners are cut off where the circle of
    the new triangle holds no other corner of the hole.
    """
    triangles, neighbours = mesh.triangles, mesh.neighbours
    taken, corner, outer, _ = mesh.scratch  # outer[i] is across the edge from corner i to i + 1
    v, s, count, before_n = triangles[t, k], t, 0, n
    while count == 0 or s != t:
        k = (triangles[s, 1] == v) + 2 * (triangles[s, 2] == v)
        taken[count], corner[count] = s, triangles[s, (k + 1) % 3]
        outer[count] = neighbours[s, k]
        n = _take_points(s, head, following, found, n)
        s = neighbours[s, (k + 1) % 3]
        count += 1
    facet[found[before_n:n]] = -1
    made, i = np.int64(0), np.int64(0)
    while count > 2:
        before, after = (i - 1) % count, (i + 1) % count
        if not _is_ear(mesh.xy, corner, count, before, i, after):
            i = after
            continue
        s = taken[made]
        made += 1
        a, b, c = corner[before], corner[i], corner[after]
        triangles[s, 0], triangles[s, 1], triangles[s, 2] = a, b, c
        _join(mesh, s, c, outer[i], b)
        _join(mesh, s, b, outer[before], a)
        outer[before] = s
        count -= 1
        for j in range(i, count):
            corner[j], outer[j] = corner[j + 1], outer[j + 1]
        i %= count
    _join(mesh, outer[0], corner[0], outer[1], corner[1])
    for s in (max(taken[made], taken[made + 1]), min(taken[made], taken[made + 1])):
        _fill_gap(mesh, s, facet, head, following)
    return n


@helper
def _is_ear(xy, corner, count, before, i, after):
    """Whether corner i of a hole forms a Delaunay triangle with the corners beside it."""
    a, b, c = corner[before], corner[i], corner[after]
    ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
    if orient(ax, ay, bx, by, cx, cy) <= 0.0:
        return False
    for j in range(count):
        v = corner[j]
        if v not in (a, b, c) and in_circle(ax, ay, bx, by, cx, cy, xy[v, 0], xy[v, 1]):
            return False
    return True


@helper
def _join(mesh, s, a, t, b):
    """Make s and t neighbours at the edge that ends at vertex a in s, and at vertex b in t."""
    for k in range(3):
        if mesh.triangles[s, (k + 2) % 3] == a:
            mesh.neighbours[s, k] = t
        if mesh.triangles[t, (k + 2) % 3] == b:
            mesh.neighbours[t, k] = s


@helper
def _fill_gap(mesh, t, facet, head, following):
    """Renumber the last triangle of the mesh to t, with its points."""
    mesh.size[0] -= 1
    last = mesh.size[0]
    if t == last:
        return
    for k in range(3):
        mesh.triangles[t, k] = mesh.triangles[last, k]
        mesh.neighbours[t, k] = s = mesh.neighbours[last, k]
        for j in range(3):
            if mesh.neighbours[s, j] == last:
                mesh.neighbours[s, j] = t
    head[t], head[last] = head[last], -1
    i = head[t]
    while i >= 0:
        facet[i] = t
        i = following[i]


@kernel
def join_patches(mesh, z, real, step, rise, first, last, group, walls, n):
    """Join vertices below `real` into groups along edges, unless the edge is a wall.

    Looks at the triangles first to last. Walls climb more than `step` and steeper than `rise`.
    They are listed in `walls` from n on, foot and top, and so are edges to vertices from `real`
    on, the rim of the data. Returns how many there are now.
    """
    xy = mesh.xy
    for t in range(first, last):
        a = mesh.triangles[t, 2]
        for k in range(3):
            a, b = mesh.triangles[t, k], a  # each edge is met both ways round
            if a < 0 or b <= a or a >= real:
                continue
            up = z[b] - z[a]
            run = np.sqrt((xy[b, 0] - xy[a, 0]) ** 2 + (xy[b, 1] - xy[a, 1]) ** 2)
            if b < real and abs(up) <= max(step, rise * run):
                one, other = root(group, a), root(group, b)
                group[max(one, other)] = min(one, other)
                continue
            downwards = b < real and up < 0
            walls[n, 0], walls[n, 1] = (b, a) if downwards else (a, b)
            n += 1
    return n


@kernel
def patches_of(mesh, first, last, group, boxes):
    """Set the patch of each vertex, and extend its box (west, south, -east, -north)."""
    for v in range(first, last):
        group[v] = g = root(group, v)
        x, y = mesh.xy[v, 0], mesh.xy[v, 1]
        boxes[g, 0], boxes[g, 1] = min(boxes[g, 0], x), min(boxes[g, 1], y)
        boxes[g, 2], boxes[g, 3] = min(boxes[g, 2], -x), min(boxes[g, 3], -y)


@kernel
def near_surface(xyz, first, cells, lowest, facet, mesh, z, tolerance, per_rise, near):
    """Set `near` for the points from `first` on that are near the surface.

    The points lie within the ring.

    The search begins at the facet of the lowest point of the cell, if it has one.
    """
    t = np.int64(0)
    for k in range(len(cells)):
        i = first + k
        x, y, h = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        j = lowest[cells[k]]
        if j >= 0 and 0 <= facet[j] < mesh.size[0]:
            t = facet[j]
        t = locate(mesh.xy, mesh.triangles, mesh.neighbours, x, y, t)
        nx, ny, nz = _normal(mesh, z, t)
        a = mesh.triangles[t, 0]
        over = h - z[a] + ((x - mesh.xy[a, 0]) * nx + (y - mesh.xy[a, 1]) * ny) / nz
        rise = np.sqrt(nx * nx + ny * ny) / nz
        near[i] = abs(over) <= tolerance + per_rise * rise
