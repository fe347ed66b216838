"""Towers are columns of voxels with more points above each other than wires have."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

from algorithms.corridor._voxels.growing import components
from algorithms.corridor._voxels.voxels import Voxels, otsu

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Columns:
    """The k columns of v voxels.

    Attributes
    ----------
    of_voxel : array of shape (v,)
    place : array of shape (k, 2), their middles in plan, metres
    count : array of shape (k,), points in all of their voxels
    to_wires : array of shape (k,), distance in plan to the next one with a wire, metres
    """

    of_voxel: Ints
    place: Floats
    count: Ints
    to_wires: Floats

    @classmethod
    def of(cls, voxels: Voxels, group: Ints) -> Columns:
        """The columns of voxels, of which those with a group are of wires."""
        cells, of_voxel = np.unique(voxels.cell[:, :2], axis=0, return_inverse=True)
        of_voxel = of_voxel.ravel()
        count = np.bincount(of_voxel, voxels.count).astype(np.int64)
        wires = np.unique(of_voxel[group > 0])
        away = np.full(len(cells), np.inf)
        if len(wires):
            away[:], _ = cKDTree(cells[wires]).query(cells)
        place = np.asarray((cells + 0.5) * voxels.size, np.float64)
        return cls(of_voxel, place, count, away * voxels.size)


def towers_among(voxels: Voxels, group: Ints, *, spacing: float, repeated: bool) -> Ints:
    """Tower of each of v voxels, from 1 on; 0 for voxels of none.

    Among the columns within half the spacing of a wire, as those of a tower are, the ones above
    Otsu's threshold are dense. Dense columns nearer to each other than the spacing are of one
    tower; in plan, as no two columns of points are above each other.

    Where a tower stands out little among wires, the threshold parts columns with many wires from
    those with few, and a tower becomes as long as the line. But what is longer than the spacing is
    not one tower, as the next one may begin there. So it is parted by a threshold of its own, and
    that again, until what remains is short. Where towers stand out, nothing is parted twice.

    Parameters
    ----------
    group : array of shape (v,), see :func:`~algorithms.corridor._voxels.growing.grown`
    spacing : least distance between two towers, metres
    repeated : whether there is a second threshold
    """
    columns = Columns.of(voxels, group)

    def found_among(some: Ints) -> Iterator[Ints]:
        dense = some[columns.count[some] > otsu(columns.count[some])]
        for cluster in clusters(columns.place, dense, spacing):
            if repeated and diameter(columns.place[cluster]) >= spacing:
                yield from found_among(cluster)
            else:
                yield cluster

    tower = np.zeros(len(columns.count), np.int64)
    near = np.flatnonzero(columns.to_wires <= spacing / 2)
    for number, cluster in enumerate(found_among(near), start=1):
        tower[cluster] = number
    return tower[columns.of_voxel]


def clusters(place: Floats, some: Ints, spacing: float) -> list[Ints]:
    """Some of n places, shape (n, 2), in groups that are farther than the spacing apart."""
    if not len(some):
        return []
    pairs = cKDTree(place[some]).query_pairs(spacing, output_type="ndarray")
    label = components(len(some), pairs)
    return [some[label == k] for k in range(label.max() + 1)]


def diameter(xy: Floats) -> float:
    """Largest distance between two of n positions, shape (n, 2)."""
    outline = shapely.get_coordinates(shapely.convex_hull(shapely.MultiPoint(xy)))
    return float(pdist(outline).max(initial=0.0))


def bounds_of(xyz: Floats, tower: Ints) -> Floats:
    """West, south, east and north of each tower, shape (towers, 4).

    Parameters
    ----------
    xyz : array of shape (n, 3)
    tower : array of shape (n,), number of the tower of each point, 0 for none
    """
    found = [xyz[tower == k, :2] for k in range(1, tower.max(initial=0) + 1)]
    return np.array([[*p.min(axis=0), *p.max(axis=0)] for p in found]).reshape(-1, 4)


def within(bounds: Floats, xyz: Floats) -> Ints:
    """Number of the tower whose bounds hold a point in plan; 0 for none.

    Where bounds overlap it is the tower with the smaller ones.
    """
    number = np.zeros(len(xyz), np.int64)
    area = (bounds[:, 2:] - bounds[:, :2]).prod(axis=1)
    for k in np.argsort(-area, kind="stable").tolist():
        held = (xyz[:, :2] >= bounds[k, :2]) & (xyz[:, :2] <= bounds[k, 2:])
        number[held.all(axis=1)] = k + 1
    return number


def nearest(bounds: Floats, xyz: Floats, within: float) -> Ints:
    """Number of the tower whose bounds are nearest to a point in plan; 0 if none is within reach.

    Parameters
    ----------
    bounds : array of shape (towers, 4), metres
    xyz : array of shape (n, 3), metres
    within : farthest tower, metres
    """
    if not len(bounds):
        return np.zeros(len(xyz), np.int64)
    inside = np.clip(xyz[:, None, :2], bounds[:, :2], bounds[:, 2:])
    away = np.linalg.norm(xyz[:, None, :2] - inside, axis=2)
    return np.where(away.min(axis=1) <= within, away.argmin(axis=1) + 1, 0)
