"""The hull of wires: the part of space around their points, concave or convex.

References
----------
Edelsbrunner, H. and Muecke, E. P. (1994). Three-dimensional alpha shapes. ACM Transactions on
Graphics 13(1), 43-72.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError, cKDTree

from algorithms.corridor._voxels.growing import components
from algorithms.corridor._voxels.hull_kernels import inside_any

CORNERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])  # of the face across from each

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Hull:
    """Tetrahedra between points of wires.

    Attributes
    ----------
    wires : array of shape (n, 3), all points of wires, metres
    net : tetrahedra of Delaunay between some of them; None where they span no volume
    inside : array with a value for each tetrahedron: whether it is in the hull
    """

    wires: Floats
    net: Delaunay | None
    inside: Mask

    @classmethod
    def of(cls, wires: Floats, radius: float | None, grain: float) -> Hull:
        """The hull of points.

        Parameters
        ----------
        wires : array of shape (n, 3), metres
        radius : of the ball that cannot enter the hull, metres: tetrahedra with a larger sphere
            around them are outside; None for the convex hull
        grain : edge of cubes, of which one point each is taken, metres
        """
        empty = cls(wires, None, np.zeros(0, bool))
        if not len(wires):
            return empty
        first = np.unique(np.floor(wires / grain), axis=0, return_index=True)[1]
        try:
            net = Delaunay(wires[np.sort(first)])
        except (QhullError, ValueError):  # fewer than four, or all in one plane
            return empty
        inside = np.ones(len(net.simplices), bool)
        if radius is not None:
            inside = radii(net.points[net.simplices]) < radius
        return cls(wires, net, inside)

    def hold(self, xyz: Floats, margin: float) -> Mask:
        """True for points of shape (n, 3) in the hull, or within the margin of a wire's point."""
        found = np.zeros(len(xyz), bool)
        if not len(self.wires):
            return found
        low, high = self.wires.min(axis=0) - margin, self.wires.max(axis=0) + margin
        some = np.flatnonzero(((xyz >= low) & (xyz <= high)).all(axis=1))
        away, _ = cKDTree(self.wires).query(xyz[some], distance_upper_bound=margin)
        found[some] = away < margin
        rest = some[away >= margin]
        rest = rest[np.argsort(xyz[rest, 0], kind="stable")]
        found[rest] = self._between(xyz[rest])
        return found

    def _between(self, xyz: Floats) -> Mask:
        """True for points of shape (n, 3), in ascending order of x, in a tetrahedron inside."""
        found = np.zeros(len(xyz), bool)
        if self.net is None:
            return found
        own = self.net.points[self.net.simplices[self.inside]]
        own = own[is_solid(own)]
        low, high = own.min(axis=1), own.max(axis=1)
        inverse = np.asarray(np.linalg.inv(edges(own).transpose(0, 2, 1)), np.float64)
        inside_any(np.ascontiguousarray(xyz), own[:, 0].copy(), inverse, low, high, found)
        return found

    def bodies(self) -> Iterator[tuple[Floats, float]]:
        """The faces of each connected part, shape (m, 3, 3), and its volume in cubic metres."""
        if self.net is None:
            return
        corners, beside = self.net.simplices, self.net.neighbors
        volume = np.abs(np.linalg.det(edges(self.net.points[corners]))) / 6
        own = np.flatnonzero(self.inside)
        number = np.full(len(corners), -1)
        number[own] = np.arange(len(own))
        shared = (beside[own] >= 0) & self.inside[beside[own]]
        pairs = np.column_stack([np.nonzero(shared)[0], number[beside[own][shared]]])
        label = components(len(own), pairs)
        for k in range(label.max(initial=-1) + 1):
            mine = own[label == k]
            which, across = np.nonzero(~shared[label == k])
            faces = corners[mine][which[:, None], CORNERS[across]]
            yield self.net.points[faces], float(volume[mine].sum())


def edges(tetrahedra: Floats) -> Floats:
    """The three edges from the first corner of tetrahedra (n, 4, 3), shape (n, 3, 3)."""
    return tetrahedra[:, 1:] - tetrahedra[:, :1]


def is_solid(tetrahedra: Floats) -> Mask:
    """False for tetrahedra (n, 4, 3) whose corners lie in a plane, as far as numbers can tell."""
    edge = edges(tetrahedra)
    smallest = np.finfo(float).eps * np.abs(edge).max(axis=(1, 2), initial=0.0) ** 3
    return np.asarray(np.abs(np.linalg.det(edge)) > smallest)


def radii(tetrahedra: Floats) -> Floats:
    """Radius of the sphere through the corners of tetrahedra (n, 4, 3); infinite for flat ones.

    Examples
    --------
    >>> corner = np.array([[[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]]])
    >>> radii(corner).round(3).tolist()
    [1.732]
    """
    edge, solid = edges(tetrahedra), is_solid(tetrahedra)
    radius = np.full(len(edge), np.inf)
    half = (edge[solid] ** 2).sum(axis=2)[..., None] / 2
    radius[solid] = np.linalg.norm(np.linalg.solve(edge[solid], half)[..., 0], axis=1)
    return radius
