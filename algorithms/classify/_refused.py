"""What is no building here, though it may be one: refused regions, and buildings of the file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.classify._density import Lengths
from algorithms.classify._evidence import BUILDING, FOOT, PointFeatures
from algorithms.classify._outlines import TOUCHING, name_of, without_spikes
from algorithms.classify._sorted_points import SortedPoints
from algorithms.shared.alpha_shape import alpha_shape
from algorithms.shared.data_edge import cut
from toolbox.context import log
from toolbox.data import PointCloud, Vector
from toolbox.errors import DataError

AT_EDGE = 0.25  # of the least area of a building: a corner of the data holds a quarter of it

Mask = NDArray[np.bool_]
Shapes = NDArray[Any]


def steep_regions(
    shapes: Shapes, points: PointCloud, features: PointFeatures, lengths: Lengths
) -> list[dict[str, Any]]:
    """Attributes and outlines of regions that are no roofs because they are steep and torn.

    Parameters
    ----------
    shapes : polygons
    points : all points, which tell where the data end, as they do for buildings
    features : n points, some of which are above the ground in each
    lengths : of which the spacing tells where the data end
    """
    above, metre = features.terrain[1] > FOOT, features.cloud.metre
    at_edge = cut(list(shapes), points.places, lengths.spacing, metre, ctx=features.ctx)
    rows = []
    for shape, there in zip(shapes, at_edge, strict=True):
        inside = features.within(shape, above)
        ground = float(np.median(features.ground_below(inside)))
        top = float(features.xyz[inside, 2].max())
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
    """Tell how many points the file calls building that are none now, and places without any.

    Single points, and walls of buildings that are found, are counted, but are no place. The edge
    of the data may leave a quarter of a building of the least area.

    Parameters
    ----------
    given, classified : the same points with the classes of the file and with those found
    least : area of a building, in the unit of the points
    lengths : by which points are joined to regions, as those of roofs are
    """
    if "classification" not in given:
        return
    was = given["classification"] == BUILDING
    lost = was & (classified["classification"] != BUILDING)
    if not lost.any():
        return
    shapes, held = _without_building(given, was, lost, least, lengths)
    if not len(shapes):
        text = "points that the file calls building are none now: %d, at no place without building"
        log.info(text, np.count_nonzero(lost))
        return
    area, metre = shapely.area(shapes), given.metre
    log.warning(
        "points that the file calls building are none now: %d; %d at places of %g m2 or more (%g "
        "m2 at the edge of the data) where no building is now: %d, the largest at %s (%.0f m2); "
        "%d at smaller ones or where a building is",
        np.count_nonzero(lost),
        held,
        least / metre**2,
        AT_EDGE * least / metre**2,
        len(shapes),
        _place(shapes[area.argmax()]),
        area.max() / metre**2,
        np.count_nonzero(lost) - held,
    )


def _without_building(
    given: PointCloud, was: Mask, lost: Mask, least: float, lengths: Lengths
) -> tuple[Shapes, int]:
    """Places where most points of buildings of the file are none now, and how many they hold."""
    xyz = given.xyz
    try:
        found = alpha_shape(xyz[lost, :2], lengths.alpha, region_threshold=AT_EDGE * least).polygons
    except DataError:  # hardly any point
        return np.empty(0, object), 0
    shapes = without_spikes(np.asarray(found, object), lengths.alpha)
    shapes = shapes[~shapely.is_empty(shapes)]
    at_edge = cut(list(shapes), given.places, lengths.spacing, given.metre)
    shapes = shapes[shapely.area(shapes) >= np.where(at_edge, AT_EDGE, 1.0) * least]
    points = SortedPoints.of(xyz, given.metre)
    around = shapely.buffer(shapes, TOUCHING * given.metre)  # their corners are points, too
    inside = [points.within(one, xyz, was) for one in around]
    of_lost = np.array([np.count_nonzero(lost[one]) for one in inside], np.int64)
    empty = 2 * of_lost > [len(one) for one in inside]
    return shapes[empty], int(of_lost[empty].sum())


def _place(shape: Any) -> str:
    """Easting and northing of a place within."""
    place = shape.representative_point()
    return f"{place.x:.1f},{place.y:.1f}"
