"""What is no building here, though it may be one: refused regions, and buildings of the file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.classify._density import Lengths
from algorithms.classify._evidence import BUILDING, FOOT, PointFeatures
from algorithms.classify._outlines import name_of, without_spikes
from algorithms.shared.alpha_shape import alpha_shape
from algorithms.shared.data_edge import cut
from algorithms.shared.polygons import Polygons
from toolbox.context import log
from toolbox.data import PointCloud, Vector
from toolbox.errors import DataError

Shapes = NDArray[Any]


def steep_regions(
    shapes: Shapes, features: PointFeatures, lengths: Lengths
) -> list[dict[str, Any]]:
    """Attributes and outlines of regions that are no roofs because they are steep and torn.

    Parameters
    ----------
    shapes : polygons
    features : n points, some of which are above the ground in each
    lengths : of which the spacing tells where the data end
    """
    above, metre = features.terrain[1] > FOOT, features.cloud.metre
    at_edge = cut(list(shapes), features.xyz, lengths.spacing, metre, ctx=features.ctx)
    rows = []
    for shape, there in zip(shapes, at_edge, strict=True):
        inside = features.within(shape, above)
        z = features.xyz[inside, 2]
        ground = float(np.median(z - features.terrain[1][inside] * metre))
        top = float(z.max())
        row = {"id": name_of(shape), "area": shape.area, "points": len(inside), "ground": ground}
        row |= {"top": top, "height": top - ground, "cut": bool(there), "geometry": shape}
        rows.append(row)
    return rows


def refused_in_words(refused: Vector) -> str:
    """What is said of regions that were refused, of which there is one."""
    metre = refused.metre
    rows = refused.frame.sort_values("height", ascending=False)
    most = rows.iloc[0]
    return (
        f"Regions that look like roofs, but are steep and torn as crowns of conifers, and were "
        f"taken for no buildings: {len(rows)}, {rows['area'].sum() / metre**2:.0f} m² in all; the "
        f"highest at {_place(most.geometry)} ({most['area'] / metre**2:.0f} m², "
        f"{most['height'] / metre:.1f} m high). Spires and torn roofs may be among them."
    )


def unlike(given: PointCloud | None, points: PointCloud) -> Iterator[tuple[str, str]]:
    """The problem with `given` where it cannot be the same points with the classes of the file."""
    if given is not None and len(given) != len(points):
        yield "given", f"must be the {len(points)} points of points, got {len(given)}"


def warn_of_lost(given: PointCloud, classified: PointCloud, least: float, lengths: Lengths) -> None:
    """Tell places where the file has buildings and none is now.

    Parameters
    ----------
    given, classified : the same points with the classes of the file and with those found
    least : area of a building, in the unit of the points
    lengths : by which points are joined to regions, as those of roofs are
    """
    if "classification" not in given:
        return
    lost = (given["classification"] == BUILDING) & (classified["classification"] != BUILDING)
    xy = given.xyz[lost, :2]
    try:
        found = alpha_shape(xy, lengths.alpha, region_threshold=least).polygons
    except DataError:  # no point, or hardly any
        return
    shapes = without_spikes(np.asarray(found, object), lengths.alpha)
    shapes = shapes[shapely.area(shapes) >= least]
    if not len(shapes):
        return
    area = shapely.area(shapes)
    log.warning(
        "points that the file calls building are none now: %d, at %d places; the largest at %s "
        "(%.0f m2)",
        np.count_nonzero(Polygons.of(shapes).hold(xy)),
        len(shapes),
        _place(shapes[area.argmax()]),
        area.max() / given.metre**2,
    )


def _place(shape: Any) -> str:
    """Easting and northing of a place within."""
    place = shape.representative_point()
    return f"{place.x:.1f},{place.y:.1f}"
