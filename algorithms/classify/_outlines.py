"""Where the outline of a roof runs among its points."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

TOUCHING = 0.01  # metres, so that points on an outline are inside whatever the rounding

Shapes = NDArray[Any]


def without_spikes(shapes: Shapes, width: float) -> Shapes:
    """Polygons without what is narrower than a width, such as branches and fences beside a roof."""
    core = shapely.buffer(shapes, -width / 2, join_style="mitre")
    return np.asarray(shapely.get_parts(shapely.buffer(core, width / 2, join_style="mitre")))


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
