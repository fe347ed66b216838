"""Outlines of planes: polygons on the plane, and in space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import geopandas
import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.planes._figures import UP, figures
from algorithms.planes._search import axes_of
from algorithms.planes._segment import parts_of
from algorithms.shared.alpha_shape import alpha_shape
from algorithms.shared.plane_fit import Plane
from toolbox.context import QUIET, Context

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


@dataclass(frozen=True)
class View:
    """Coordinates on a plane: u horizontal, v upwards, from the lower left corner.

    Attributes
    ----------
    plane : that is looked at
    axes : array of shape (2, 3), of length 1
    corner : array of shape (2,), from the centre of the plane
    """

    plane: Plane
    axes: Floats
    corner: Floats

    @classmethod
    def of(cls, plane: Plane, xyz: Floats) -> View:
        """Coordinates on a plane whose origin is the lower left of points of shape (n, 3)."""
        view = cls(plane, axes_of(plane.normal), np.zeros(2))
        return cls(plane, view.axes, view.flat(xyz).min(axis=0))

    def flat(self, xyz: Floats) -> Floats:
        """Coordinates on the plane, shape (n, 2), of points of shape (n, 3)."""
        near = (xyz - self.plane.origin) - self.plane.centre
        return np.asarray(near @ self.axes.T - self.corner)

    def solid(self, uv: Floats) -> Floats:
        """Coordinates in space, shape (n, 3), of points on the plane, shape (n, 2)."""
        near = (uv + self.corner) @ self.axes
        return np.asarray((near + self.plane.centre) + self.plane.origin)

    def raised(self, shapes: Any) -> Any:
        """Shapes in space from shapes on the plane."""
        return _through(self.solid, shapes)

    def seen(self, shapes: Any) -> Any:
        """Shapes on the plane from shapes in space, projected at right angles."""
        return _through(self.flat, shapes)


def _through(places: Callable[[Floats], Floats], shapes: Any) -> Any:
    """Shapes with their vertices transformed, from space to a plane or the other way."""
    to_space = not shapely.has_z(shapes).any()
    start = shapely.force_3d(shapes) if to_space else shapes
    made = shapely.transform(
        start,
        lambda xyz: places(xyz[:, :2]) if to_space else np.column_stack([places(xyz), xyz[:, 2]]),
        include_z=True,
    )
    return made if to_space else shapely.force_2d(made)


def outline(uv: Floats, alpha: float, *, ctx: Context = QUIET) -> Any:
    """Polygon around points on a plane, shape (n, 2); a multipolygon where these have wide gaps.

    Parameters
    ----------
    alpha : radius of the smallest circle that makes a gap, if there are points so near each other;
        otherwise as large as all points need
    """
    shape = alpha_shape(uv, alpha, ctx=ctx)
    if not len(shape.polygons):
        shape = alpha_shape(uv, "all_points")
    parts = list(shape.polygons)
    return parts[0] if len(parts) == 1 else shapely.multipolygons(parts)


def drawn(
    xyz: Floats, ids: Ints, planes: Sequence[Plane], alpha: float, ctx: Context = QUIET
) -> geopandas.GeoDataFrame:
    """Outlines of all planes in space, with their numbers.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    ids : array of shape (n,), number of the plane of each point, from 1; 0 of none
    planes : one less than the largest number
    alpha : see :func:`outline`
    ctx : progress and cancellation
    """
    rows, shapes = [], []
    parts = parts_of(ids, len(planes))
    for number, (plane, part) in enumerate(zip(planes, parts, strict=True), start=1):
        own = xyz[part]
        view = View.of(plane.turned(UP), own)
        step = ctx.part((number - 1) / len(planes), number / len(planes))
        flat = outline(view.flat(own), alpha, ctx=step)
        rows.append({"plane_id": number} | _numbers(view, own, flat))
        shapes.append(view.raised(flat))
    return geopandas.GeoDataFrame(rows, geometry=shapes, columns=None if rows else ["plane_id"])


def _numbers(view: View, xyz: Floats, flat: Any) -> dict[str, Any]:
    """Attributes of a plane, from its points of shape (n, 3) and its outline."""
    found = figures(view.plane, view.plane.distances(xyz))._asdict()
    sides = np.hypot(
        *np.diff(shapely.get_coordinates(shapely.oriented_envelope(flat))[:3], axis=0).T
    )
    return found | {
        "area": flat.area,
        "length": float(sides.max()),
        "width": float(sides.min()),
        "lowest": float(xyz[:, 2].min()),
        "highest": float(xyz[:, 2].max()),
        "points": len(xyz),
    }
