"""Surfaces of waters as layers tell them: level, or between the heights of their outlines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shared.polygons import polygons
from toolbox.data import Vector
from toolbox.errors import DataError

Array = NDArray[np.float64]
Surface = Callable[[Array, Array], Array]
"""The heights of a water at places x and y."""
LEVEL, SLOPE, SCATTER = "level", "slope", "scatter"  # attributes of a polygon of water
WIDEST = 3.0  # standard deviations from the level to the farthest point that is of the water
MOST_SIGMA = 0.25  # m: standard deviation of points on a rough water


@dataclass(frozen=True)
class WaterSurface:
    """A polygon of water with its surface.

    Attributes
    ----------
    shape : in the unit of the heights, as all lengths here
    at : the heights of its surface
    scatter : standard deviation of single returns from it; NaN if that is not known
    """

    shape: shapely.Polygon
    at: Surface
    scatter: float

    def holds(self, above: Array, metre: float) -> NDArray[np.bool_]:
        """True where a last return came from the water rather than from what is around it.

        Banks, reeds and boats are above the water, so a return from it is no higher than those
        scatter. Nothing but water is below: there its troughs count as those of rough water. So
        does water whose scatter the layer does not tell, as that which was drawn by hand.

        Parameters
        ----------
        above : array of shape (n,), heights above the surface
        metre : length of one metre in the unit of the heights

        Examples
        --------
        >>> calm = WaterSurface(shapely.box(0, 0, 9, 9), between, 0.04)
        >>> calm.holds(np.array([-0.8, -0.7, 0.1, 0.2]), metre=1.0)
        array([False,  True,  True, False])
        """
        rough = WIDEST * MOST_SIGMA * metre
        crest = WIDEST * self.scatter if math.isfinite(self.scatter) else rough
        return np.asarray((above <= crest) & (above >= -max(crest, rough)))


def surfaces(layer: Vector, name: str) -> Iterator[WaterSurface]:
    """The polygons of a layer with their surfaces.

    Parameters
    ----------
    name : of the source that it is, for errors

    Raises
    ------
    DataError
        A polygon has neither a level nor heights.

    Examples
    --------
    >>> import geopandas
    >>> pond = {"level": [12.5], "geometry": [shapely.box(0, 0, 9, 9)]}
    >>> (one,) = surfaces(Vector(geopandas.GeoDataFrame(pond, crs=32635)), "water")
    >>> one.at(np.array([4.0]), np.array([5.0]))
    array([12.5])
    """
    for k in range(len(layer)):
        row = layer.frame.iloc[k]
        for shape in polygons(Vector(layer.frame.iloc[[k]], name=layer.name), name):
            yield WaterSurface(shape, _surface_of(row, shape, name), as_number(row.get(SCATTER)))


def _surface_of(row: Any, shape: shapely.Polygon, name: str) -> Surface:
    """The surface of a polygon by its attributes, or by the heights of its vertices."""
    level = as_number(row.get(LEVEL))
    if math.isfinite(level) and not (as_number(row.get(SLOPE)) > 0 and shape.has_z):
        return lambda x, y: np.full(np.broadcast(x, y).shape, level)
    corners = shapely.get_coordinates(shape, include_z=True)
    if not np.isfinite(corners).all():
        raise DataError(f"{name}: a polygon has no level")
    return between(corners)


def as_number(value: Any) -> float:
    """A number, or NaN for what is none.

    Examples
    --------
    >>> as_number(3), as_number(None)
    (3.0, nan)
    """
    return float(value) if isinstance(value, int | float | np.number) else math.nan


def between(xyz: Array) -> Surface:
    """The surface between heights at places; beyond them it is as at the nearest one.

    Parameters
    ----------
    xyz : array of shape (n, 3)

    Examples
    --------
    >>> surface = between(np.array([[0.0, 0, 1], [0, 2, 1], [4, 0, 3], [4, 2, 3]]))
    >>> surface(np.array([1.0, 9.0]), np.array([1.0, 1.0]))
    array([1.5, 3. ])
    """
    from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

    middle = xyz[:, :2].mean(axis=0)
    places, heights = xyz[:, :2] - middle, xyz[:, 2]
    inside, beyond = (
        make(places, heights) for make in (LinearNDInterpolator, NearestNDInterpolator)
    )

    def at(x: Array, y: Array) -> Array:
        x, y = np.broadcast_arrays(x - middle[0], y - middle[1])
        found = inside(x, y)
        return np.asarray(np.where(np.isnan(found), beyond(x, y), found))

    return at
