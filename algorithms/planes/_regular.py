"""Planes made regular: parallel and square to each other where they almost are.

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
    """Planes of few directions, those that lie in one plane joined; the points keep to them.

    The plane with the most points keeps its direction. Each of the others takes a direction that
    is there already if it is parallel to it but for an angle, or else becomes square to those to
    which it is so but for the angle. It turns about the mean of its points, and only if these
    stay near it: their root mean square distance must not exceed half the tolerance. Planes of one
    direction, none farther than the tolerance from the first, become one.

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
    """The directions that a plane almost has, the nearest first."""
    near = [d for d in directions if abs(d @ plane.normal) >= math.cos(angle)]
    return sorted(near, key=lambda d: -abs(float(d @ plane.normal)))


def _square(plane: Plane, directions: list[Floats], angle: float) -> list[Floats]:
    """The direction that is square to two, or one, to which a plane is almost square."""
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
    """The same points, with planes of one direction within the tolerance as one."""
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
