"""Bridges: which of the regions that look like roofs are bridge decks."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.classify._evidence import PointFeatures
from algorithms.shared.places import may_be_near
from toolbox.context import log

BESIDE = 1.5  # metres from a deck in which ground lies at its ends
LEVEL = 0.75  # metres that ground may be above or below a deck there
NEAR = 5.0  # metres around an end: a deck hardly rises over that, and a roof does from its eaves
ENDS = 3.0  # metres, length of an end
BETWEEN = 0.75  # share of a deck that lies between its ends; of a house in a slope two thirds do
OVER_GROUND = 3.0  # metres, height of a deck

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Shapes = NDArray[Any]


def bridges(features: PointFeatures, roof: Mask, shapes: Shapes) -> Mask:
    """True for regions at whose two ends the ground rises to their level: bridges.

    At an end, points nearer to the ground than a roof lie beside the region, at its level there. A
    low roof has those as well, but rises from its eaves; a house on a slope on one side only, or on
    two that meet at a corner.

    Parameters
    ----------
    features : n points
    roof : array of shape (n,), those of roofs
    shapes : polygons around them, array of shape (m,)

    Returns
    -------
    array of shape (m,)
    """
    height, metre = features.terrain[1], features.cloud.metre
    found = np.zeros(len(shapes), bool)
    if not len(shapes):
        return found
    low = low_beside(features, roof)
    point, beside = shapely.STRtree(shapes).query(
        shapely.points(features.xyz[low, :2]), predicate="dwithin", distance=BESIDE * metre
    )
    for number in np.unique(beside):
        deck, ends = features.within(shapes[number], roof), low[point[beside == number]]
        if np.median(height[deck]) < OVER_GROUND:
            continue
        ends = ends[levels(features, ends) >= levels_around(features, ends, deck) - LEVEL]
        found[number] = between_ends(shapes[number], features.xyz[ends, :2], metre)
    if found.any():
        log.info("%d regions meet ground at both ends: bridges", np.count_nonzero(found))
    return found


def low_beside(features: PointFeatures, roof: Mask) -> NDArray[np.int64]:
    """Indices of low points beside a roof point and at its level; low is below all roof points."""
    height, metre, tops = features.terrain[1], features.cloud.metre, np.flatnonzero(roof)
    near = may_be_near(features.xyz, features.xyz[tops, :2], BESIDE * metre)
    low = np.flatnonzero(near & ~roof & (height < height[tops].min()))
    tree = cKDTree(features.xyz[tops, :2])
    found = tree.query(features.xyz[low, :2], distance_upper_bound=BESIDE * metre)
    away, nearest = map(np.asarray, found)
    near = np.isfinite(away)
    low, nearest = low[near], nearest[near]
    rise = levels(features, tops[nearest]) - levels(features, low)
    return np.asarray(low[np.abs(rise) <= LEVEL])


def levels(features: PointFeatures, some: NDArray[np.int64]) -> NDArray[np.float64]:
    """Elevations of some points, given by index, in metres."""
    return np.asarray(features.xyz[some, 2] / features.cloud.metre)


def levels_around(
    features: PointFeatures, some: NDArray[np.int64], deck: NDArray[np.int64]
) -> Floats:
    """Median elevation of the points of a deck around each of some, in metres; inf without any."""
    tree, height = cKDTree(features.xyz[deck, :2]), levels(features, deck)
    near = tree.query_ball_point(features.xyz[some, :2], NEAR * features.cloud.metre)
    return np.array([np.median(height[around]) if around else np.inf for around in near])


def between_ends(deck: Any, xy: Floats, metre: float) -> bool:
    """Whether a polygon lies between two or more ends: long rows of the points beside it.

    Parameters
    ----------
    deck : shapely polygon
    xy : points beside it, array of shape (n, 2)
    metre : length of one metre in the unit of the data
    """
    rows = shapely.get_parts(shapely.union_all(shapely.buffer(shapely.points(xy), metre)))
    ends = rows[2 * shapely.minimum_bounding_radius(rows) >= ENDS * metre]
    if len(ends) < 2:
        return False
    between = shapely.convex_hull(shapely.union_all(ends))
    return bool(between.intersection(deck).area >= BETWEEN * deck.area)
