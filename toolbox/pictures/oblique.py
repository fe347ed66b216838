"""Oblique views of clouds with walls, as seen from the street; from above walls are mere lines."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from toolbox.data import PointCloud

_MOST, _SOME = 10, 2000  # planes that are looked at, and points of each
_UPRIGHT = math.sin(math.radians(10.0))  # third part of the normal of a wall, at most
_ROUND = 0.4  # variance across to that along of a scene that has no length
_ASIDE, _ABOVE = math.radians(25.0), math.radians(20.0)  # where the eye is, seen from the wall

Floats = NDArray[np.float64]


def direction_of(cloud: PointCloud, planes: str = "") -> Floats:
    """Unit vector to an eye that sees a scene well: before its largest wall, or across its length.

    Parameters
    ----------
    planes : attribute with the number of the plane of each point, 0 for none; "" for none
    """
    xyz = cloud.xyz - cloud.xyz[0]
    wall = _wall(xyz, cloud[planes]) if planes and planes in cloud else None
    if wall is not None:
        return _eye_before(xyz, wall, cloud.metre)
    some = xyz[:: 1 + len(xyz) // (_MOST * _SOME), :2]
    sizes, ways = np.linalg.eigh(np.cov(some.T) if len(some) > 2 else np.eye(2))
    if sizes[0] > _ROUND * sizes[1]:
        return _lifted(math.radians(-125.0), math.radians(35.0))  # from the south-west
    across = ways[:, 0] if ways[1, 0] < 0 else -ways[:, 0]  # from the south
    return _lifted(math.atan2(across[1], across[0]) + _ASIDE, math.radians(25.0))


def _lifted(heading: float, height: float) -> Floats:
    level = math.cos(height)
    return np.array([level * math.cos(heading), level * math.sin(heading), math.sin(height)])


def oblique(cloud: PointCloud, planes: str) -> PointCloud | None:
    """The cloud in the coordinates of an oblique view: right, up, and towards the viewer.

    The eye is before the upright plane with the most points, on the side of the street, a little
    aside and above, so that ground, side walls and roofs are seen too.

    Parameters
    ----------
    planes : attribute with the number of the plane of each point, 0 for none

    Returns
    -------
    None if none of their largest planes is upright
    """
    xyz = cloud.xyz - cloud.xyz[0]
    wall = _wall(xyz, cloud[planes])
    if wall is None:
        return None
    eye = _eye_before(xyz, wall, cloud.metre)
    right = np.array([-eye[1], eye[0], 0.0]) / math.cos(_ABOVE)
    view = xyz @ np.array([right, np.cross(eye, right), eye]).T
    kept = {name: cloud[name] for name in cloud.names}
    return PointCloud(view - view.min(axis=0), kept, crs=cloud.crs, descriptions=cloud.descriptions)


def _eye_before(xyz: Floats, wall: tuple[Floats, Floats], metre: float) -> Floats:
    """From a wall to the eye: on the side of the street, a little aside and above."""
    normal = _to_the_street(xyz, *wall, metre)
    return _lifted(math.atan2(normal[1], normal[0]) + _ASIDE, _ABOVE)


def _to_the_street(xyz: Floats, normal: Floats, centre: Floats, metre: float) -> Floats:
    """The normal of a wall, towards the side from which it was seen.

    A wall hides what is behind it, so more squares of ground before it hold points. Where nothing
    is away from it, what is seen in its openings stands back.

    Parameters
    ----------
    metre : length of one metre in the unit of the points
    """
    away, along = (xyz - centre) @ normal, xyz @ np.cross(normal, [0.0, 0.0, 1.0])
    places = np.floor(np.column_stack([along, away]) / metre)
    squares = np.unique(places[np.abs(away) > metre], axis=0)
    before = np.sign(squares[:, 1] + 0.5).sum() if len(squares) else -away.mean()
    return normal if before >= 0 else -normal


def _wall(xyz: Floats, ids: NDArray[np.int64]) -> tuple[Floats, Floats] | None:
    """Normal and centre of the upright plane with the most points; None if none is upright."""
    numbers, counts = np.unique(ids[ids > 0], return_counts=True)
    for number in numbers[np.argsort(-counts, kind="stable")[:_MOST]]:
        own = xyz[ids == number]
        some = own[:: 1 + len(own) // _SOME]
        centre = some.mean(axis=0)
        normal = np.linalg.eigh((some - centre).T @ (some - centre))[1][:, 0]
        if len(some) > 3 and abs(normal[2]) <= _UPRIGHT:
            return normal, centre
    return None
