"""The map of a report: images below, layers above, as JSON values that the page draws."""

from __future__ import annotations

import base64
import functools
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import shapely

from toolbox import language
from toolbox.data import Figure, PointCloud, Raster, Vector
from toolbox.data.crs import (
    crs_conflict,
    is_local,
    length_problem,
    short_height_unit,
    unit_of_lengths,
)
from toolbox.data.layer import Layer
from toolbox.data.report import Plot
from toolbox.declare.fields import Spec
from toolbox.declare.show import Classes, Show, Values, colour_of, is_thin, number_of
from toolbox.pictures.draw import Shown, drawable, is_apart
from toolbox.pictures.features import feature_classes
from toolbox.pictures.images import (
    Bounds,
    Image,
    Ramp,
    cloud_image,
    intensity_image,
    raster_image,
)
from toolbox.reports import words
from toolbox.reports.map_picture import HALF, map_png

DRAWING = "Drawing: "  # before the name of a layer that has a map of its own
_MOST_BASES, _QUALITY = 8, 82  # images that can lie below, and of these in WebP
_MOST_FEATURES, _MOST_CORNERS = 3000, 60_000  # of a layer, and of all layers together
_MOST_NUMBERS = 30  # of features of a layer, that they do not lie on each other
_SPARSE = 0.005  # share of the cells of a raster below which a picture of it is blank
_CROWDED = 500  # points of a layer, such as corners of outlines, that would hide all others
_FINEST = 20_000  # steps of coordinates in the width of the map
_MARGIN = 0.04  # around what is drawn
_SHAPES = ("area", "line", "point")  # by how they lie over each other
_DEEP, _LOW = 1 / 3, 1 / 5  # of a wall: depth over height, and height over length of no wire
_BRIGHT = (Values("intensity", "Intensity"),)
_COLOURS = ("#0b5fa5", "#d7261e", "#8e3fa8", "#e08a00", "#00806b", "#b0306a", "#5a6b00", "#6b4a2f")
"""Of layers that say none; each is seen on light and on dark, and none comes twice."""


Base = tuple[str, Image, Layer, tuple[Show, ...]]
"""Title, image, layer, and how it is shown."""


def maps_of(
    spec: Spec, found: Mapping[str, Any], given: Mapping[str, Any]
) -> Iterator[tuple[str, Plot]]:
    """The maps of what a tool gave above what it was given, with their titles.

    Layers that lie elsewhere than the first, such as a drawing in a plane, have a map of
    their own.
    """
    shown = drawable(found, spec.results)
    titles = {name: words.titled(field) for name, field in {**spec.sources, **spec.results}.items()}
    bases = list(_bases(shown, given, titles))
    # Results have the first colours, whatever they are compared with.
    waiting = {n: pair for n, pair in shown.items() if isinstance(pair[0], Vector)}
    waiting |= {n: (v, ()) for n, v in given.items() if isinstance(v, Vector) and len(v)}
    if bases:
        together = _together(bases[0][1].bounds, bases[0][2], waiting)
        if not _is_upright([layer for layer, _ in together.values()]):
            yield "Map", _map(bases, together, titles)
        waiting = {n: pair for n, pair in waiting.items() if n not in together}
    while waiting:
        name, (layer, _) = next(iter(waiting.items()))
        together = {name: waiting[name]} | _together(layer.bounds, layer, waiting)
        waiting = {n: pair for n, pair in waiting.items() if n not in together}
        if np.isfinite(layer.bounds).all():
            title = f"{DRAWING}{titles[name].lower()}" if bases else "Map"
            yield title, _map([], together, titles)


def _is_upright(layers: Sequence[Layer]) -> bool:
    """Whether all features stand on one line of the ground, as of a wall: a map shows a stroke."""
    frames = [layer.frame.geometry.to_numpy() for layer in layers if isinstance(layer, Vector)]
    shapes = np.concatenate(frames) if frames else np.empty(0, object)
    xyz = shapely.get_coordinates(shapes, include_z=True)
    if len(xyz) < 3 or not np.isfinite(xyz).all():
        return False
    box = shapely.minimum_rotated_rectangle(shapely.multipoints(xyz[:, :2]))
    corners = shapely.get_coordinates(box)
    sides = np.hypot(*np.diff(corners, axis=0).T) if len(corners) == 5 else np.ptp(corners, axis=0)
    height = float(np.ptp(xyz[:, 2]))
    return bool(min(sides) < height * _DEEP and height > max(sides) * _LOW)


def _together(extent: Bounds, first: Layer, layers: Mapping[str, Shown]) -> dict[str, Shown]:
    """The layers that can lie on one map with the first."""
    return {
        name: pair
        for name, pair in layers.items()
        if not is_apart(pair[1])
        and _meets(pair[0], extent)
        and crs_conflict(first.crs, pair[0].crs, heights=False) is None
    }


def _map(bases: Sequence[Base], layers: Mapping[str, Shown], titles: Mapping[str, str]) -> Plot:
    first = bases[0][2] if bases else next(iter(layers.values()))[0]
    crs = first.crs
    x0, y0, x1, y1 = (float(v) for v in (bases[0][1].bounds if bases else first.bounds))
    west, south, east, north = _with_margin((x0, y0, x1, y1))
    origin = math.floor(west), math.floor(south)
    step = max(east - west, north - south) / _FINEST
    on_classes = bool(bases) and not isinstance(bases[0][1].key, Ramp)
    overlays, left_out = _overlays(layers, titles, origin, step, on_classes=on_classes)
    unit = short_height_unit(crs)
    names = ("x", "y") if crs is None or is_local(crs) else ("Easting", "Northing")
    data = {
        "x0": origin[0],
        "y0": origin[1],
        "bounds": _relative((west, south, east, north), origin),
        "length": _of_scale(first),
        "north": crs is not None and not is_local(crs),
        "axes": [f"{name} [{unit}]" if unit else name for name in names],
        "bases": [_base(name, image, origin) for name, image, _, _ in bases],
        "layers": overlays,
    }
    picture = Figure(
        map_png(data, bases[0][1] if bases else None),
        _caption(bases, [titles[n] for n in layers], left_out),
    )
    return Plot("map", data, picture, functools.partial(_others, data, bases))


def _of_scale(layer: Layer) -> tuple[str, float] | None:
    """The unit of the scale bar, feet of data in feet, and its length in the data; None without."""
    if length_problem(layer.crs):
        return None
    unit = unit_of_lengths(layer.crs)
    return (unit[0], 1.0) if unit and unit[0].endswith("ft") else ("m", layer.metre)


def _others(data: Mapping[str, Any], bases: Sequence[Base]) -> Iterator[Figure]:
    """The other rasters that can lie below, each with nothing above it."""
    for number, (name, image, layer, _) in enumerate(bases):
        if number and isinstance(layer, Raster) and _is_seen(layer):
            alone = {**data, "bases": [data["bases"][number]], "layers": []}
            yield Figure(map_png(alone, image, width=HALF), name)


def _is_seen(raster: Raster) -> bool:
    """Whether so many cells have a value that a picture shows some."""
    return float(np.isfinite(raster.band()).mean()) >= _SPARSE


def _bases(
    shown: Mapping[str, Shown], given: Mapping[str, Any], titles: Mapping[str, str]
) -> Iterator[Base]:
    """The images of rasters and points, of the results first, at most so many."""
    made: list[Base] = []
    for name, (layer, shows) in shown.items():
        if isinstance(layer, Raster):
            made.append((titles[name], raster_image(layer), layer, ()))
        elif isinstance(layer, PointCloud):
            image = cloud_image(layer, shows[0] if shows else None)
            if image.above and _covers(layer, given):
                made.append((titles[name], image, layer, shows))
    for name, layer in given.items():
        if isinstance(layer, Raster):
            made.append((f"{titles[name]} (input)", raster_image(layer), layer, ()))
        if isinstance(layer, PointCloud) and len(layer):
            if brightness := intensity_image(layer):
                made.append((f"{titles[name]} (input): intensity", brightness, layer, _BRIGHT))
            made.append((f"{titles[name]} (input)", cloud_image(layer), layer, ()))
    yield from made[:_MOST_BASES]


def _covers(layer: PointCloud, given: Mapping[str, Any]) -> bool:
    """Whether points are many enough to be an image below; few are drawn as dots in space."""
    sizes = [len(other) for other in given.values() if isinstance(other, PointCloud)]
    return len(layer) >= 0.05 * max(sizes, default=0)


def _base(name: str, image: Image, origin: tuple[int, int]) -> dict[str, Any]:
    from matplotlib.colors import to_hex

    if isinstance(key := image.key, Ramp):
        map_of_colours = key.colour_map()
        ramp = [to_hex(map_of_colours(share)) for share in np.linspace(0, 1, 9)]
        low, high = key.ends
        told: Any = {"ramp": ramp, "low": low, "high": high, "label": key.label}
    else:
        told = {"classes": [[text, colour] for text, colour in key.values()]}
    bounds = _relative(image.bounds, origin)
    return {"name": name, "source": _webp(image.rgba), "bounds": bounds, "key": told}


def _webp(rgba: Any) -> str:
    """An image as a data URL, a fifth of its size as PNG."""
    from PIL import Image as Pillow

    made = io.BytesIO()
    pixels = np.round(np.clip(rgba, 0, 1) * 255).astype(np.uint8)
    Pillow.fromarray(pixels, "RGBA").save(made, "WEBP", quality=_QUALITY, method=4)
    return "data:image/webp;base64," + base64.b64encode(made.getvalue()).decode()


def _overlays(
    layers: Mapping[str, Shown],
    titles: Mapping[str, str],
    origin: tuple[int, int],
    step: float,
    *,
    on_classes: bool,
) -> tuple[list[dict[str, Any]], int]:
    """The layers as JSON values, and the number of features for which there is no room.

    Areas in colours of a number are outlines where a class is seen by its colour below them: two
    sets of colours in one place are none.
    """
    corners = sum(
        int(shapely.get_num_coordinates(layer.frame.geometry.to_numpy()).sum())
        for layer, _ in layers.values()
    )
    coarse = step * max(1.0, corners / _MOST_CORNERS) * 2
    made, colours, left_out = [], iter(_COLOURS * 4), 0
    for name, (layer, shows) in layers.items():
        kept = min(len(layer), _MOST_FEATURES)
        left_out += len(layer) - kept
        show = next((s for s in shows if isinstance(s, Classes | Values)), None)
        groups = [
            {
                "name": text,
                "colour": colour or colour_of(shows, next(colours)),
                "shape": shape,
                "thin": is_thin(shows),
                "open": on_classes and isinstance(show, Values),
                "features": features,
            }
            for text, colour, own in _classes(layer, show, titles[name])
            for shape, features in _features(layer, own[own < kept], origin, step, coarse).items()
        ]
        if groups:
            table = words.anchor_of(name)
            hidden = kept > _CROWDED and {g["shape"] for g in groups} == {"point"}
            title = titles[name]
            layer_data = {"name": title, "table": table, "groups": groups, "hidden": hidden}
            if number := number_of(shows):
                layer_data["texts"] = list(_numbers(layer, number, origin, step))
            made.append((show is not None, layer_data))
    # What has colours of its own lies above what has not: errors above their checkpoints.
    made.sort(key=lambda one: (_height(one[1]), one[0]))
    return [layer_data for _, layer_data in made], left_out


def _numbers(
    layer: Vector, number: str, origin: tuple[int, int], step: float
) -> Iterator[tuple[float, float, str]]:
    """Place and number of the largest features, as tables have it."""
    largest = layer.frame.iloc[np.argsort(-layer.frame.area.to_numpy(), kind="stable")]
    for text, shape in zip(largest[number][:_MOST_NUMBERS], largest.geometry, strict=False):
        x, y = _corners(shapely.point_on_surface(shape), origin, _digits(step))
        yield x, y, str(text)


def _height(layer: Mapping[str, Any]) -> int:
    """How far up a layer lies: areas below lines, and these below points."""
    return max(_SHAPES.index(group["shape"]) for group in layer["groups"])


def _classes(
    layer: Vector, show: Classes | Values | None, name: str
) -> Iterator[tuple[str, str, Any]]:
    """Name, colour and rows of each class of features; all alike where nothing is said."""
    found = feature_classes((layer, show)) if show else None
    if not found:
        yield name, "", np.arange(len(layer))
        return
    for text, colour, own in found:
        yield text, colour, np.flatnonzero(own)


def _features(
    layer: Vector, rows: Any, origin: tuple[int, int], step: float, coarse: float
) -> dict[str, list[Any]]:
    """Features by shape, each with its row and the corners of its parts."""
    shapes = shapely.force_2d(layer.frame.geometry.to_numpy())
    digits = _digits(step)
    made: dict[str, list[Any]] = {}
    for row in rows.tolist():
        shape = shapes[row]
        if shape is None or shape.is_empty:
            continue
        dimension = shapely.get_dimensions(shape)
        if dimension:
            shape = shapely.simplify(shape, coarse)
        parts = [_corners(ring, origin, digits) for ring in _rings(shape)]
        made.setdefault(_SHAPES[-1 - dimension], []).append([row, parts])
    return made


def _digits(step: float) -> int:
    """Digits after the point of coordinates in such steps."""
    return max(0, math.ceil(-math.log10(step)))


def _rings(shape: Any) -> Iterator[Any]:
    """The points, lines and rings of a shape; holes turn the other way, so that they stay empty."""
    for part in shapely.get_parts(shape):
        if shapely.get_dimensions(part) < 2:
            yield part
        elif not part.is_empty:
            turned = shapely.orient_polygons(part)
            yield from (turned.exterior, *turned.interiors)


def _corners(ring: Any, origin: tuple[int, int], digits: int) -> list[float]:
    return [float(v) for v in np.round(shapely.get_coordinates(ring) - origin, digits).ravel()]


def _meets(layer: Vector, extent: Bounds) -> bool:
    box = layer.bounds
    across = box[0] <= extent[2] and box[2] >= extent[0]
    return bool(np.isfinite(box).all() and across and box[1] <= extent[3] and box[3] >= extent[1])


def _with_margin(bounds: Bounds) -> Bounds:
    west, south, east, north = bounds
    margin = _MARGIN * max(east - west, north - south) or 1.0
    return west - margin, south - margin, east + margin, north + margin


def _relative(bounds: Bounds, origin: tuple[int, int]) -> list[float]:
    return [round(value - origin[k % 2], 4) for k, value in enumerate(bounds)]


def _caption(bases: Sequence[Any], names: Sequence[str], left_out: int) -> str:
    below = [name for name, _, _, _ in bases[:1]]
    text = f"{'Map' if bases else 'Drawing'}: {', '.join(map(language.label, [*names, *below]))}"
    return text + (
        f"; {left_out} features have no room on it, and are in the files" * bool(left_out)
    )
