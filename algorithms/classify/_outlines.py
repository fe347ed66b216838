"""Where the outline of a roof runs among its points."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.classify._evidence import PointFeatures
from algorithms.shared.places import may_be_near

BESIDE = 5  # spacings of points around an outline, so that there are points all around it
TOUCHING = 0.01  # metres, so that points on an outline are inside whatever the rounding

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Shapes = NDArray[Any]


def without_spikes(shapes: Shapes, width: float) -> Shapes:
    """Polygons without what is narrower than a width, such as branches and fences beside a roof."""
    core = shapely.buffer(shapes, -width / 2, join_style="mitre")
    return np.asarray(shapely.get_parts(shapely.buffer(core, width / 2, join_style="mitre")))


def within_data(
    outline: Any, features: PointFeatures, spacing: float, *, straight: bool
) -> tuple[Any, bool]:
    """What the edge of the data cuts, without what lies beyond it: corners there are not seen.

    The edge is taken for straight: in a notch of it nothing is taken off.

    Parameters
    ----------
    outline : polygon
    features : n points
    spacing : of the points, in their unit; the data end half of it beyond the last ones
    straight : whether its walls were squared

    Returns
    -------
    polygon, and whether its walls are still those that were squared
    """
    around = shapely.box(*outline.buffer(BESIDE * spacing).bounds)
    data = shapely.convex_hull(shapely.linestrings(features.xyz[features.within(around), :2]))
    seen = shapely.buffer(data, spacing / 2, join_style="mitre")
    if shapely.contains(seen, outline):
        return outline, straight
    return max(shapely.get_parts(outline.intersection(seen)), key=shapely.area), False


def margin(density: Any, alpha: float) -> Any:
    """Mean distance by which a straight edge lies outside the alpha shape of points along it.

    Between two points that it touches, a disc of radius r sinks in by h = l^2 / (8 r) for a chord
    of length l. Where one point is expected in the area l h, no other is in the way: so
    h = (density sqrt(8 r))^(-2/3), as it is with convex hulls (Rényi and Sulanke 1963).

    Parameters
    ----------
    density : points per area
    alpha : radius of the disc

    References
    ----------
    Rényi, A. and Sulanke, R. (1963). Über die konvexe Hülle von n zufällig gewählten Punkten.
    Zeitschrift für Wahrscheinlichkeitstheorie 2, 75-84: how far inside of an edge hulls of points
    stay.
    """
    return (density * np.sqrt(8 * alpha)) ** (-2 / 3)


def name_of(outline: Any) -> str:
    """Name of an object by a place within: its easting and northing in whole units.

    Examples
    --------
    >>> name_of(shapely.box(0.0, 10.0, 5.0, 12.0))
    '2_11'
    """
    place = outline.representative_point()
    return f"{np.floor(place.x):.0f}_{np.floor(place.y):.0f}"


def is_ground_around(features: PointFeatures, radius: float, places: Floats) -> Mask:
    """True for places around which most points are ground, array of shape (m,).

    Parameters
    ----------
    features : n points
    radius : around a place, in their unit
    places : array of shape (m, 2)
    """
    near = may_be_near(features.xyz, places, radius)
    xy, ground = features.xyz[near, :2], features.terrain[0][near]
    on_ground, others = (
        cKDTree(xy[some]).query_ball_point(places, radius, return_length=True)
        for some in (ground, ~ground)
    )
    return np.asarray(on_ground > others)
