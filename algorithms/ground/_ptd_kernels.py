"""Compiled loops of :mod:`algorithms.ground.ptd`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from algorithms.shared._delaunay_kernels import is_ghost, locate


class Limits(NamedTuple):
    """What a point must keep to enter the surface; lengths in the unit of the points."""

    angle: float  # degrees, to each corner of the facet
    distance: float  # from the plane of the facet
    steepest: float  # rise per length
    stop: float  # no point enters a facet whose edges are all shorter
    reduce: float  # facets smaller than this lower the angle; 0 for never
    mirror: bool
    gentle: float  # greatest rise of the facet that a mirrored point falls on
    below: float  # degrees, for points below the surface


@njit(cache=True, nogil=True)
def _normal(mesh, z, t):  # type: ignore[no-untyped-def]
    """Upward normal of facet t; twice its area in plan is the vertical part."""
    xy = mesh.xy
    a, b, c = mesh.triangles[t, 0], mesh.triangles[t, 1], mesh.triangles[t, 2]
    ux, uy, uz = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1], z[b] - z[a]
    vx, vy, vz = xy[c, 0] - xy[a, 0], xy[c, 1] - xy[a, 1], z[c] - z[a]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@njit(cache=True, nogil=True)
def _against(mesh, z, t, x, y, h):  # type: ignore[no-untyped-def]
    """Compare a place with facet t.

    Signed distance from its plane, greatest angle to its corners in degrees, steepest rise to
    them, longest edge, rise of the facet, and its highest corner.
    """
    xy = mesh.xy
    a, b, c = mesh.triangles[t, 0], mesh.triangles[t, 1], mesh.triangles[t, 2]
    nx, ny, nz = _normal(mesh, z, t)
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    distance = ((x - xy[a, 0]) * nx + (y - xy[a, 1]) * ny + (h - z[a]) * nz) / length
    sine, steepest, square, top = 0.0, 0.0, 0.0, a
    for v, w in ((a, b), (b, c), (c, a)):
        square = max(square, (xy[v, 0] - xy[w, 0]) ** 2 + (xy[v, 1] - xy[w, 1]) ** 2)
        plan = np.sqrt((xy[v, 0] - x) ** 2 + (xy[v, 1] - y) ** 2)
        away = np.sqrt(plan**2 + (z[v] - h) ** 2)
        sine = max(sine, abs(distance) / away if away > abs(distance) else 1.0)
        steepest = max(steepest, (h - z[v]) / max(plan, 1e-9))
        if (z[v], xy[v, 0], xy[v, 1]) > (z[top], xy[top, 0], xy[top, 1]):
            top = v
    rise = np.sqrt(nx * nx + ny * ny) / nz
    return distance, np.degrees(np.arcsin(sine)), steepest, np.sqrt(square), rise, top


@njit(cache=True, nogil=True)
def _enters(mesh, z, t, x, y, h, limits, break_rise):  # type: ignore[no-untyped-def]
    """Whether a point may enter facet t, and its distance from it."""
    distance, angle, steepest, longest, rise, top = _against(mesh, z, t, x, y, h)
    most = limits.angle
    if limits.reduce > 0:
        most *= min(1.0, longest / limits.reduce)
    if longest < limits.stop:
        enters = False
    elif distance < 0:
        enters = angle <= limits.below
    elif steepest > limits.steepest:
        enters = False
    elif angle <= most and distance <= limits.distance:
        enters = True
    else:
        enters = limits.mirror and rise >= break_rise
        enters = enters and _enters_beyond(mesh, z, t, x, y, h, limits, most, top)
    return enters, distance


@njit(cache=True, nogil=True)
def _enters_beyond(mesh, z, t, x, y, h, limits, angle, top):  # type: ignore[no-untyped-def]
    """Mirror a point at corner `top` of facet t, in plan and height: is it on the surface there?

    On the other side of a break the surface may be known already. Mirrored in plan alone, plants
    on a slope would be held against the higher ground uphill. What is as steep as a wall there is
    no level to go on from: walls would let the roofs above them in.
    """
    x, y, h = 2 * mesh.xy[top, 0] - x, 2 * mesh.xy[top, 1] - y, 2 * z[top] - h
    s = locate(mesh.xy, mesh.triangles, mesh.neighbours, x, y, t)
    if is_ghost(mesh.triangles, s):
        return False
    off, seen, _, _, beyond, _ = _against(mesh, z, s, x, y, h)
    return seen <= angle and abs(off) <= limits.distance and beyond <= limits.gentle


@njit(cache=True, nogil=True)
def points_of(changed, head, following, found):  # type: ignore[no-untyped-def]
    """List the points of facets, and empty the facets; how many points there are."""
    n = 0
    for t in changed:
        i = head[t]
        while i >= 0:
            found[n] = i
            n += 1
            i = following[i]
        head[t] = -1
    return n


@njit(cache=True, nogil=True)
def best_of_facets(  # type: ignore[no-untyped-def]
    mesh, z, points, entered, limits, break_rise, facet, head, following, best, lowest, chosen, n
):
    """Test points against the surface; per facet keep the lowest one that may enter.

    Facets with such a point are listed in `chosen` from n on; returns how many there are now.
    Equal distances are decided by position, never by the order of the points. All points that
    are not vertices yet are put on the lists of their facets, `head` and `following`.
    """
    last = 0
    for i in points:
        if entered[i]:
            continue
        x, y = mesh.xy[i, 0], mesh.xy[i, 1]
        hint = facet[i] if facet[i] >= 0 else last
        t = locate(mesh.xy, mesh.triangles, mesh.neighbours, x, y, hint)
        facet[i] = last = t
        following[i], head[t] = head[t], i
        if is_ghost(mesh.triangles, t):
            continue
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


@njit(cache=True, nogil=True)
def relocate(mesh, points, facet):  # type: ignore[no-untyped-def]
    """Bring the facets of the points up to date."""
    last = 0
    for i in points:
        x, y = mesh.xy[i, 0], mesh.xy[i, 1]
        last = locate(mesh.xy, mesh.triangles, mesh.neighbours, x, y, last)
        facet[i] = last


@njit(cache=True, nogil=True)
def _root(group, v):  # type: ignore[no-untyped-def]
    while group[v] != v:
        group[v] = group[group[v]]
        v = group[v]
    return v


@njit(cache=True, nogil=True)
def _wall(xy, z, a, b, step, rise):  # type: ignore[no-untyped-def]
    """1 if the edge climbs a wall from a to b, -1 if from b to a, 0 if it is no wall."""
    up = z[b] - z[a]
    if abs(up) <= max(step, rise * np.hypot(xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1])):
        return 0
    return 1 if up > 0 else -1


@njit(cache=True, nogil=True)
def join_patches(mesh, z, real, step, rise, first, last, group):  # type: ignore[no-untyped-def]
    """Put vertices below `real` that an edge joins into one group, unless it is a wall.

    Looks at the triangles first to last. Walls climb more than `step` and steeper than `rise`.
    """
    for t in range(first, last):
        for k in range(3):
            a, b = mesh.triangles[t, k], mesh.triangles[t, (k + 1) % 3]
            if 0 <= a < b < real and _wall(mesh.xy, z, a, b, step, rise) == 0:
                group[_root(group, a)] = _root(group, b)


@njit(cache=True, nogil=True)
def patches_of(mesh, first, last, group, boxes):  # type: ignore[no-untyped-def]
    """Name the patch of each vertex, and widen its box (west, south, -east, -north)."""
    for v in range(first, last):
        group[v] = g = _root(group, v)
        x, y = mesh.xy[v, 0], mesh.xy[v, 1]
        boxes[g, 0], boxes[g, 1] = min(boxes[g, 0], x), min(boxes[g, 1], y)
        boxes[g, 2], boxes[g, 3] = min(boxes[g, 2], -x), min(boxes[g, 3], -y)


@njit(cache=True, nogil=True)
def outlines_of(mesh, z, real, step, rise, first, last, group, outline):  # type: ignore[no-untyped-def]
    """Sum up the walls around patches: walls, of them down, edges to the rim, drop and run.

    Looks at the triangles first to last. Vertices from `real` on are the rim of the data.
    """
    xy = mesh.xy
    for t in range(first, last):
        for k in range(3):
            a, b = mesh.triangles[t, k], mesh.triangles[t, (k + 1) % 3]
            if 0 <= a < real <= b:
                outline[group[a], 2] += 1
            if not 0 <= a < b < real or group[a] == group[b]:
                continue
            climbs = _wall(xy, z, a, b, step, rise)
            if climbs != 0:
                top = group[b] if climbs > 0 else group[a]
                outline[group[a], 0] += 1
                outline[group[b], 0] += 1
                outline[top, 1] += 1
                outline[top, 3] += abs(z[b] - z[a])
                outline[top, 4] += np.hypot(xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1])


@njit(cache=True, nogil=True, parallel=True)
def near_surface(  # type: ignore[no-untyped-def]
    xyz, first, row, col, lowest, facet, mesh, z, tolerance, per_rise, greatest_rise, near
):
    """Whether points from `first` on are near the surface; beyond it they are not.

    The search begins at the facet of the lowest point of the cell (row, col).
    """
    for k in prange(len(row)):
        i = first + k
        x, y, h = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        j = lowest[row[k], col[k]]
        t = locate(mesh.xy, mesh.triangles, mesh.neighbours, x, y, facet[j] if j >= 0 else 0)
        if is_ghost(mesh.triangles, t):
            near[i] = False
            continue
        nx, ny, nz = _normal(mesh, z, t)
        a = mesh.triangles[t, 0]
        over = h - z[a] + ((x - mesh.xy[a, 0]) * nx + (y - mesh.xy[a, 1]) * ny) / nz
        rise = np.sqrt(nx * nx + ny * ny) / nz
        near[i] = abs(over) <= tolerance + per_rise * min(rise, greatest_rise)
