"""Checks and repairs of the features of vector layers before these are compared."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from toolbox.context import QUIET, Context, log
from toolbox.data import Vector

MOST_NAMED = 5  # features in one message
BLOCK = 200_000  # positions looked up between two checks for cancellation
AREAS = ("Polygon", "MultiPolygon")
LINES = ("LineString", "MultiLineString", "LinearRing")

Shapes = NDArray[Any]  # of shapely geometries


def layer_problem(
    layer: Vector, types: Collection[str], word: str, *, repair: bool | None = None
) -> str | None:
    """Why a layer cannot be compared, naming its features; None if it can.

    Features are numbered from 1 in the order of the file.

    Parameters
    ----------
    types : names of geometry types that are wanted
    word : for these types
    repair : whether features that are not valid, or without a geometry, will be mended; None if
        the tool has no such setting

    Returns
    -------
    str or None
        Continues a sentence that begins with the name of the parameter.
    """
    shapes, named = _geometries(layer), layer.name or "the layer"
    if not len(shapes) and not _may_hold(layer.geometry_type, types):
        return f"must be {word}, {named} is an empty layer of {layer.geometry_type}"
    nothing = shapely.is_missing(shapes) | shapely.is_empty(shapes)
    if (other := ~np.isin(shapely.get_type_id(shapes), _codes(types)) & ~nothing).any():
        where = np.flatnonzero(other)
        return f"must be {word}, {named} holds a {shapes[other][0].geom_type} ({features(where)})"
    if (unknown := ~_finite(shapes)).any():
        return f"{named} has coordinates that are no numbers ({features(np.flatnonzero(unknown))})"
    text = None if repair else _invalid(shapes, nothing, named)
    return f"{text}; mend it, or give repair" if text and repair is not None else text


def _invalid(shapes: Shapes, nothing: NDArray[np.bool_], named: str) -> str | None:
    """The problem with features that can be repaired; continues a sentence."""
    if nothing.any():
        return f"{named} has no geometry in {features(np.flatnonzero(nothing))}"
    if (bad := ~shapely.is_valid(shapes)).any():
        reason = shapely.is_valid_reason(shapes[bad][0]).replace("[", " at ").rstrip("]")
        which = features(np.flatnonzero(bad))
        return f"{named} is not valid in {which}: {reason}"
    return None


def _codes(types: Collection[str]) -> list[int]:
    """Codes of geometry types in shapely, by their names."""
    return [shapely.GeometryType[name.upper()].value for name in types]


def features(indices: Iterable[int]) -> str:
    """Text that names features by number, from 1: "feature 3", "features 3, 4 and 5 more"."""
    numbers = [int(index) + 1 for index in indices]
    listed = ", ".join(map(str, numbers[:MOST_NAMED]))
    more = f" and {len(numbers) - MOST_NAMED} more" if len(numbers) > MOST_NAMED else ""
    return f"feature{'s' if len(numbers) > 1 else ''} {listed}{more}"


def mended(layer: Vector, name: str) -> Shapes:
    """The polygons of a layer in the plane, repaired where they are not valid.

    The layer must have passed :func:`layer_problem`.

    Those that are not valid are rebuilt from their rings, and that is logged; without a geometry
    they are empty polygons.
    """
    shapes = shapely.force_2d(_geometries(layer))
    nothing = shapely.is_missing(shapes) | shapely.is_empty(shapes)
    shapes[nothing] = shapely.Polygon()
    bad = ~shapely.is_valid(shapes)
    if nothing.any():
        log.warning("%s: no geometry in %s", name, features(np.flatnonzero(nothing)))
    if bad.any():
        before = float(shapely.area(shapes[bad]).sum())
        rebuilt = shapely.make_valid(shapes[bad], method="structure", keep_collapsed=False)
        shapes[bad] = rebuilt
        log.warning(
            "%s: mended %s; their area was %.3f and is %.3f",
            name,
            features(np.flatnonzero(bad)),
            before,
            float(shapely.area(rebuilt).sum()),
        )
    return shapes


def attribute_problem(name: str, layers: Iterable[Vector]) -> Iterator[str]:
    """The problem that no layer has an attribute, with a list of those that there are."""
    known: dict[str, None] = {}
    for layer in layers:
        frame = layer.frame
        known |= {str(column): None for column in frame.columns if column != frame.geometry.name}
    if name not in known:
        yield f"no attribute {name!r}; there are {', '.join(known) or 'none'}"


def _geometries(layer: Vector) -> Shapes:
    shapes: Shapes = layer.frame.geometry.to_numpy().astype(object)
    return shapes


def _may_hold(geometry_type: str | None, types: Collection[str]) -> bool:
    """Whether an empty layer may be of one of these types, by its declared type."""
    plain = (geometry_type or "Unknown").removeprefix("2.5D ").split(" ")[0]
    return plain in (*types, "Unknown", "GeometryCollection", "Geometry")


def _finite(shapes: Shapes) -> NDArray[np.bool_]:
    """Whether x and y of each shape are numbers; heights may be missing."""
    xy, index = shapely.get_coordinates(shapes, return_index=True)
    finite = np.ones(len(shapes), bool)
    finite[index[~np.isfinite(xy).all(axis=1)]] = False
    return finite


def areas_at(layer: Vector, xy: NDArray[np.float64], ctx: Context = QUIET) -> NDArray[np.int64]:
    """Index of the polygon at each position, the first one of several; -1 for none."""
    tree = shapely.STRtree(layer.frame.geometry.to_numpy())
    found = np.full(len(xy), len(layer), np.int64)
    for first in range(0, len(xy), BLOCK):
        ctx.progress(first / len(xy))
        place, area = tree.query(shapely.points(xy[first : first + BLOCK]), predicate="intersects")
        np.minimum.at(found, first + place, area)
    return np.where(found < len(layer), found, -1)
