"""Features in the view of a report: marks, lines, and areas filled with triangles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from toolbox.data import Vector
from toolbox.declare.show import Classes, Values, colour_of
from toolbox.pictures.features import feature_classes
from toolbox.pictures.views import Item
from toolbox.reports import words

FILLED = ", filled"  # after the name of areas, beside that of their outlines
_MOST_FEATURES, _MOST_CORNERS = 2000, 60_000  # of a class of a layer
_CROWDED = 500  # marks of a layer that would hide all others

Floats = NDArray[np.float64]


def items_of(
    name: str, title: str, layer: Vector, shows: Any, origin: Floats, colours: Iterator[str]
) -> Iterator[Item]:
    """The features of a layer that have heights, an item for each class and shape.

    Parameters
    ----------
    name, title : of the layer, and its heading
    origin : of shape (3,), which is subtracted
    colours : of layers that say none
    """
    show = next((s for s in shows if isinstance(s, Classes | Values)), None)
    classes = (feature_classes((layer, show)) if show else None) or [
        (title, colour_of(shows, next(colours)), np.ones(len(layer), bool))
    ]
    shapes = layer.frame.geometry.to_numpy()
    for text, colour, own in classes:
        named = text if text == title else f"{title}: {text}"
        rows = np.flatnonzero(own)[:_MOST_FEATURES]
        parts, row = shapely.get_parts(shapes[rows], return_index=True)
        solid = shapely.has_z(parts) & ~shapely.is_empty(parts)
        parts, row = parts[solid], rows[row[solid]]
        dimension = shapely.get_dimensions(parts)
        table = words.anchor_of(name)
        marks, lines = _marks(parts, row, dimension, origin), _lines(parts, row, dimension, origin)
        for kind, (corners, numbers) in (("marks", marks), ("lines", lines)):
            if corners:
                yield Item(
                    "marks" if kind == "marks" else "lines",
                    named,
                    colour,
                    np.concatenate(corners),
                    parts=corners,
                    rows=numbers,
                    table=table,
                )
        yield from _areas(f"{named}{FILLED}", colour, parts[dimension == 2], origin)


Rings = tuple[list[Floats], list[int]]
"""Corners of each part, and the row that it is of."""


def _marks(parts: Any, row: Any, dimension: Any, origin: Floats) -> Rings:
    """The points, unless they are so many that they would hide all else."""
    own = dimension == 0
    if not own.any() or np.count_nonzero(own) > _CROWDED:
        return [], []
    xyz = shapely.get_coordinates(parts[own], include_z=True) - origin
    return list(xyz[:, None]), row[own].tolist()


def _lines(parts: Any, row: Any, dimension: Any, origin: Floats) -> Rings:
    """The lines, and the outlines of areas with their holes; long ones with fewer corners."""
    corners: list[Floats] = []
    numbers: list[int] = []
    for part, number, size in zip(parts, row.tolist(), dimension, strict=True):
        if size == 0:
            continue
        rings = [part] if size == 1 else [part.exterior, *part.interiors]
        corners += [shapely.get_coordinates(ring, include_z=True) - origin for ring in rings]
        numbers += [number] * len(rings)
    keep = max(1, math.ceil(sum(map(len, corners)) / _MOST_CORNERS))
    return [np.concatenate([c[:-1:keep], c[-1:]]) for c in corners], numbers


def _areas(name: str, colour: str, parts: Any, origin: Floats) -> Iterator[Item]:
    """The areas as triangles."""
    made = [filled(part, origin) for part in parts]
    xyz = np.concatenate([triangles for triangles in made if len(triangles)] or [np.zeros((0, 3))])
    if len(xyz):
        triangles = np.arange(len(xyz)).reshape(-1, 3)
        yield Item("areas", name, colour, xyz, triangles=triangles)


def filled(polygon: Any, origin: Floats) -> Floats:
    """Corners of triangles that fill a flat area in space, whichever way it faces.

    Returns
    -------
    array of shape (3 n, 3), three rows for each triangle; holes are left out
    """
    from scipy.spatial import cKDTree

    corners = shapely.get_coordinates(polygon, include_z=True) - origin
    centre = corners.mean(axis=0)
    across, up, normal = np.linalg.svd(corners - centre, full_matrices=False)[2]
    uv = (corners - centre) @ np.array([across, up]).T
    flat = shapely.make_valid(shapely.set_coordinates(shapely.force_2d(polygon), uv))
    made = shapely.get_parts(shapely.constrained_delaunay_triangles(flat))
    if not len(made):
        return np.zeros((0, 3))
    inside = shapely.get_coordinates(made).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    # An area that is a little bent stays so.
    _, nearest = cKDTree(uv).query(inside)
    off = ((corners - centre) @ normal)[nearest]
    return np.asarray(centre + inside @ np.array([across, up]) + off[:, None] * normal)
