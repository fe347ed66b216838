"""Regular planes: parallel and at right angles to each other where they nearly are.

References
----------
Monszpart, A., Mellado, N., Brostow, G. J. and Mitra, N. J. (2015). RAPter: rebuilding man-made
scenes with regular arrangements of planes. ACM Transactions on Graphics 34(4), 103.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from algorithms.planes._segment import Segments, parts_of
from algorithms.shared.plane_fit import Plane

SAME = 1 - 1e-12  # cosine of an angle that is rounding

Floats = NDArray[np.float64]


def regular(xyz: Floats, found: Segments, angle: float) -> Segments:
    """Planes turned to few common directions, and joined where coplanar; points keep their planes.

    The plane with the most points keeps its direction. Each of the others takes an existing
    direction if it is parallel to it within an angle, or else becomes perpendicular to those to
    which it is perpendicular within that angle. It turns about the mean of its points, and only if
    these stay near it: their root mean square distance must not exceed half the tolerance. Planes
    of one direction, none farther than the tolerance from the first, become one.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    found : planes of these points, the one with the most points first
    angle : by which a normal is off at most, radians
    """
    parts = [xyz[part] for part in parts_of(found.ids, len(found.planes))]
    directions: list[Floats] = []
    turned: list[Plane] = []
    for plane, part in zip(found.planes, parts, strict=True):
        near = (part - plane.origin) - plane.centre
        covariance = near.T @ near / len(near)
        wanted = (*_parallel(plane, directions, angle), *_square(plane, directions, angle))
        most = (found.rules.tolerance / 2) ** 2
        axis = next((axis for axis in wanted if axis @ covariance @ axis <= most), plane.normal)
        if not any(np.array_equal(axis, other) for other in directions):
            directions.append(axis)
        turned.append(replace(plane, normal=axis))
    return _joined(found, turned)


def _parallel(plane: Plane, directions: list[Floats], angle: float) -> list[Floats]:
    """Known directions within the angle of a plane's normal, the nearest first."""
    near = [d for d in directions if abs(d @ plane.normal) >= math.cos(angle)]
    return sorted(near, key=lambda d: -abs(float(d @ plane.normal)))


def _square(plane: Plane, directions: list[Floats], angle: float) -> list[Floats]:
    """Directions near a plane's normal, at right angles to two known ones or to one."""
    square = [d for d in directions if abs(d @ plane.normal) <= math.sin(angle)]
    other = [d for d in square if abs(d @ square[0]) < math.cos(angle)]
    found = []
    for basis in ([square[0], other[0]] if other else [], square[:1]):
        if basis:
            along = np.linalg.qr(np.array(basis).T)[0]
            axis = plane.normal - along @ (along.T @ plane.normal)
            found.append(axis / np.linalg.norm(axis))
    return found


def _joined(found: Segments, planes: list[Plane]) -> Segments:
    """The same segments, in which coplanar planes are one."""
    counts = np.bincount(found.ids, minlength=len(planes) + 1)[1:]
    heads: list[list[int]] = []
    for number, plane in enumerate(planes):
        for head in heads:
            first = planes[head[0]]
            away = abs(float(first.normal @ (plane.centre - first.centre)))
            if abs(first.normal @ plane.normal) > SAME and away <= found.rules.tolerance:
                head.append(number)
                break
        else:
            heads.append([number])
    heads.sort(key=lambda head: -int(counts[head].sum()))
    ids = np.zeros(len(planes) + 1, np.int32)
    made = []
    for rank, head in enumerate(heads, start=1):
        ids[np.array(head) + 1] = rank
        centres = [planes[number].centre for number in head]
        centre = np.average(centres, axis=0, weights=counts[head])
        made.append(replace(planes[head[0]], centre=centre))
    return replace(found, ids=ids[found.ids], planes=made)
