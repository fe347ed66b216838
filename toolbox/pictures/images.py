"""Images from rasters and point clouds: arrays of colours, each with its key."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.data import Lattice, PointCloud, Raster
from toolbox.data.asprs import COLOURS, NAMES
from toolbox.data.crs import LENGTHS, vertical_unit
from toolbox.data.report import unit_text
from toolbox.declare.show import Classes, Planes, Show, Values
from toolbox.pictures.oblique import oblique

Colour: TypeAlias = str
Looks: TypeAlias = Mapping[int, tuple[str, Colour]]
Bounds: TypeAlias = tuple[float, float, float, float]
Array: TypeAlias = NDArray[np.float64]

POINT_CLASSES: Looks = {code: (name, COLOURS[code]) for code, name in NAMES.items()}
"""Name and colour of the point classes."""

OTHER = (
    *("#7a72c9", "#58b2a3", "#2f4b7c", "#c46bb0", "#8c2d3a", "#9c8567", "#5c2e6e", "#e5a93c"),
    *("#93b245", "#d9755b", "#5b8def", "#2f6b45"),
)
"""Colours in turn, of what has none of its own; the first are unlike those of point classes."""
PALE = 0.45  # how far the colours of planes without a name are from white
RELIEF = ("#62a392", "#8fbe99", "#c1d59e", "#efe6b6", "#dfbb88", "#c0906a", "#a38178", "#f7f5f2")
GREY = ("hillshade", "intensity")
CHANGES = ("differ", "change")
NO_HEIGHTS = ("(std)", "(count)", "points", "distance", "error", *GREY)
"""Words in the descriptions of bands that are drawn in grey, about zero, and without relief."""
_PIXELS = 1000  # at most, along the longer side of a map
_MOST_DIGITS = 6  # after the point, of the ends of a ramp
_MANY = 20  # more distinct values than this are no classes
_OF_Z = re.compile(r"\bz \(\w+\)")


@dataclass(frozen=True)
class Ramp:
    """The key of an image with continuous colours."""

    colours: str | Sequence[Colour]  # a matplotlib name, or our own from low to high
    low: float
    high: float
    label: str
    extend: str = "neither"

    @classmethod
    def over(cls, values: Array, colours: str | Sequence[Colour], label: str) -> Ramp:
        """Colours over the range without the outermost 0.5 %, which would fade all others."""
        known = values[np.isfinite(values)]
        if len(known) == 0:
            return cls(colours, 0.0, 1.0, label)
        low, high = (float(v) for v in np.percentile(known, [0.5, 99.5]))
        if low == high:
            low, high = low - 0.5, high + 0.5
        return cls(colours, low, high, label, _beyond(known, low, high))

    @classmethod
    def about_zero(cls, values: Array, label: str) -> Ramp:
        """Colours from blue (below zero) to red (above), over the range of 99 % of the values."""
        known = np.abs(values[np.isfinite(values)])
        high = (float(np.percentile(known, 99)) if len(known) else 0.0) or 1.0
        return cls("RdBu_r", -high, high, label, _beyond(values, -high, high))

    @property
    def ends(self) -> tuple[str, str]:
        """The texts of both ends, with a sign where values lie beyond.

        >>> Ramp("gray", 0.0, 5.0, "Intensity", "max").ends
        ('0.00', '≥ 5.00')
        """
        low, high = self.text(self.low), self.text(self.high)
        below, above = (self.extend in (end, "both") for end in ("min", "max"))
        return f"≤ {low}" if below else low, f"≥ {high}" if above else high

    def text(self, value: float) -> str:
        """A value with the digits that tell something in this range, never as a power of ten.

        >>> Ramp("gray", 0.0, 57090.3, "Intensity").text(57090.3)
        '57090'
        >>> Ramp("gray", 1820.11, 1823.57, "Elevation (m)").text(1820.114)
        '1820.11'
        >>> Ramp("gray", -0.004, 190.0, "Elevation (m)").text(-0.004)
        '0'
        """
        span = self.high - self.low
        digits = max(0, 2 - math.floor(math.log10(span))) if span > 0 else 2
        return f"{value:z.{digits}f}" if digits <= _MOST_DIGITS else f"{value:.4g}"

    def colour_map(self) -> Any:
        """The colour map of matplotlib."""
        import matplotlib
        from matplotlib.colors import LinearSegmentedColormap

        if isinstance(self.colours, str):
            return matplotlib.colormaps[self.colours]
        return LinearSegmentedColormap.from_list("ramp", list(self.colours))


def _beyond(values: Array, low: float, high: float) -> str:
    """At which ends of a range values lie beyond it, as matplotlib says it."""
    below, above = bool((values < low).any()), bool((values > high).any())
    return {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[below, above]


Key: TypeAlias = Ramp | Looks
"""What the colours of an image mean."""


@dataclass(frozen=True)
class Image:
    """Image of a map: RGBA of shape (rows, cols, 4) from 0 to 1, with bounds and key."""

    rgba: Array
    bounds: Bounds
    key: Key
    above: bool = True  # whether it is seen from there, as a map


def raster_image(raster: Raster, number: int = 1) -> Image:
    """Image of a band of a raster: classes, relief, differences or continuous colours."""
    step = max(1, math.ceil(max(raster.shape) / _PIXELS))
    band = raster.band(number)[::step, ::step]
    text, unit = raster.descriptions[number - 1], raster.units[number - 1]
    name, label = text.lower(), _label(_in_words(text), unit)
    if raster.values.dtype.kind != "f" and _is_code(name) and len(found := _codes(band)) <= _MANY:
        classes = _table(found, POINT_CLASSES if "class" in name else {})
        return Image(_class_colours(band, classes), raster.bounds, classes)
    if _is_height(name, unit, len(raster.values)) and not _is_change(name, band):
        return _relief(band, raster.cell * step, raster.bounds, label)
    ramp = _ramp(name, band, label)
    return Image(_colours(band, ramp), raster.bounds, ramp)


def _in_words(text: str) -> str:
    """The name of a band for people: of heights not how their cells were made.

    >>> _in_words("z (linear)"), _in_words("z (max) minus z (linear)"), _in_words("Slope")
    ('Elevation', 'Difference of heights', 'Slope')
    """
    short = _OF_Z.sub("elevation", text)
    short = "difference of heights" if short == "elevation minus elevation" else short
    return short[:1].upper() + short[1:]


def _is_code(name: str) -> bool:
    return not any(word in name for word in ("hillshade", "intensity", "count", "points"))


def _is_height(name: str, unit: str, bands: int) -> bool:
    """Whether a band holds heights, which shading suits: no spreads, distances, or other units."""
    if any(word in name for word in NO_HEIGHTS):
        return False
    attribute, bracket, _ = name.partition(" (")  # as surface.grid names them: "z (linear)"
    named = not bracket or attribute == "z" or "height" in attribute or "elevation" in attribute
    return named and (unit in (*LENGTHS, "m", "ft") or (unit == "" and bands == 1))


def _is_change(name: str, band: Array) -> bool:
    """Whether a band holds changes, whose sign matters: not heights of objects above terrain."""
    if any(word in name for word in CHANGES):
        return True
    known = band[np.isfinite(band)]
    if " minus " not in name or len(known) == 0:
        return False
    low, high = np.percentile(known, (2, 98))
    return bool(-low > high / 20)


def _ramp(name: str, band: Array, label: str) -> Ramp:
    if _is_change(name, band):
        return Ramp.about_zero(band, label)
    return Ramp.over(band, "gray" if any(word in name for word in GREY) else "viridis", label)


def cloud_image(cloud: PointCloud, show: Show | None = None) -> Image:
    """Image of a point cloud: one colour per pixel, that of its highest point.

    Unless `show` says otherwise, in the colours of its classes, else of its elevation, or of its
    intensity where it is flat.
    """
    match show:
        case Classes():
            return _from_front(cloud, show.front_of, show.attribute, show.looks)
        case Planes():
            looks = _looks_of_planes(cloud, show)
            image = _from_front(cloud, show.attribute, show.attribute, looks)
            return replace(image, key=_named(looks))
        case Values():
            lattice, shown = _from_above(cloud, cloud[show.attribute])
            ramp = ramp_of(show, shown, cloud.crs)
            return Image(_colours(shown, ramp), lattice.bounds, ramp)
    if "classification" in cloud and np.any(cloud["classification"]):
        return _classed(cloud, "classification", POINT_CLASSES)
    if np.ptp(cloud.xyz[:, 2]) == 0 and (flat := intensity_image(cloud)):
        return flat
    lattice, height = _from_above(cloud, cloud.xyz[:, 2])
    label = _label("Elevation", vertical_unit(cloud.crs))
    return _relief(height, lattice.cell, lattice.bounds, label)


def intensity_image(cloud: PointCloud) -> Image | None:
    """Image of the intensity of a cloud from above; None if it has none that differ."""
    if "intensity" not in cloud or not np.ptp(cloud["intensity"]):
        return None
    lattice, shown = _from_above(cloud, cloud["intensity"])
    ramp = Ramp.over(shown, "gray", "Intensity")
    return Image(_colours(shown, ramp), lattice.bounds, ramp)


def point_key(cloud: PointCloud, show: Show | None = None) -> tuple[Array, Key]:
    """The value of each point that its colour tells, and the key of the colours.

    Unless `show` says otherwise, classes, else the elevation, or the intensity where it is flat.
    """
    match show:
        case Classes():
            values = cloud[show.attribute].astype(np.float64)
            return values, _table(_codes(values), show.looks)
        case Planes():
            looks = _looks_of_planes(cloud, show)
            return cloud[show.attribute].astype(np.float64), _named(looks)
        case Values():
            values = cloud[show.attribute].astype(np.float64)
            return values, ramp_of(show, values, cloud.crs)
    if "classification" in cloud and np.any(cloud["classification"]):
        values = cloud["classification"].astype(np.float64)
        return values, _table(_codes(values), POINT_CLASSES)
    if np.ptp(cloud.xyz[:, 2]) == 0 and "intensity" in cloud:
        values = cloud["intensity"].astype(np.float64)
        return values, Ramp.over(values, "gray", "Intensity")
    heights = cloud.xyz[:, 2]
    return heights, Ramp.over(heights, RELIEF, _label("Elevation", vertical_unit(cloud.crs)))


def _from_front(cloud: PointCloud, planes: str, attribute: str, looks: Looks) -> Image:
    """Image of classes from the front of the largest plane if it is upright, or from above."""
    turned = oblique(cloud, planes) if planes in cloud else None
    if turned is None:
        return _classed(cloud, attribute, looks)
    return replace(_classed(turned, attribute, looks), above=False)


def _classed(cloud: PointCloud, attribute: str, looks: Looks) -> Image:
    lattice, shown, height = _from_above(cloud, cloud[attribute], cloud.xyz[:, 2])
    classes = _table(_codes(shown), looks)
    rgba = _lit(_class_colours(shown, classes), height, lattice.cell, strength=0.35)
    return Image(rgba, lattice.bounds, classes)


def _looks_of_planes(cloud: PointCloud, show: Planes) -> Looks:
    """Name and colour of each plane, by number; those that the key leaves out are pale."""
    numbers = _codes(cloud[show.attribute].astype(np.float64))
    own = {number: (f"Plane {number}", _of_plane(number)) for number in numbers}
    return own | ({0: ("No plane", "#c9c9c9")} if 0 in own else {})


def _named(looks: Looks) -> Looks:
    """The planes that a key names: those with a colour of their own, the largest."""
    return {code: look for code, look in looks.items() if code <= len(OTHER)}


def _of_plane(number: int) -> str:
    from matplotlib.colors import to_hex, to_rgb

    colour = OTHER[(number - 1) % len(OTHER)]
    if number <= len(OTHER):
        return colour
    red, green, blue = (1 - PALE * (1 - part) for part in to_rgb(colour))
    return to_hex((red, green, blue))


def ramp_of(show: Values, values: Array, crs: CRS | None) -> Ramp:
    """The key of the values of an attribute."""
    text = show.label or show.attribute.replace("_", " ")
    label = _label(text, vertical_unit(crs) if show.length else "")
    label += f", {show.note}" if show.note else ""
    return Ramp.about_zero(values, label) if show.centred else Ramp.over(values, "viridis", label)


def _relief(height: Array, cell: float, bounds: Bounds, label: str) -> Image:
    ramp = Ramp.over(height, RELIEF, label)
    return Image(_lit(_colours(height, ramp), height, cell), bounds, ramp)


def _label(text: str, unit: str) -> str:
    """Text and unit, such as "Elevation (m)"."""
    short = LENGTHS.get(unit) or unit_text(unit)
    return f"{text} ({short})" if text and short else text or short


# From points to pixels ---------------------------------------------------------------------


def _pixels(cloud: PointCloud) -> Lattice:
    """Lattice of pixels about as wide as the points are apart."""
    west, south, _, east, north, _ = cloud.bounds
    longest = max(east - west, north - south)
    spacing = math.sqrt(max((east - west) * (north - south), 1e-6 * longest**2) / len(cloud))
    return Lattice.cover(cloud.bounds, max(longest / _PIXELS, spacing) or 1.0)


def _highest(cloud: PointCloud, lattice: Lattice) -> NDArray[np.int64]:
    """Index of the highest point of each pixel, in small gaps of the nearest pixel; -1 for none."""
    from scipy import ndimage

    row, col = lattice.indices(cloud.xyz[:, 0], cloud.xyz[:, 1])
    upwards = np.argsort(cloud.xyz[:, 2], kind="stable")
    top = np.full(lattice.shape, -1, np.int64)
    top[row[upwards], col[upwards]] = upwards  # the last one written is the highest
    away, nearest = ndimage.distance_transform_edt(top < 0, return_indices=True)
    return np.where(away < 1.5, top[tuple(nearest)], -1)


def _from_above(cloud: PointCloud, *values: NDArray[Any]) -> tuple[Any, ...]:
    """The lattice of pixels, and the values of the highest point in each; NaN without points."""
    lattice = _pixels(cloud)
    top = _highest(cloud, lattice)
    shown = (np.where(top >= 0, each[top].astype(np.float64), np.nan) for each in values)
    return lattice, *shown


# From values to colours --------------------------------------------------------------------


def _colours(values: Array, ramp: Ramp) -> Array:
    share = np.clip((values - ramp.low) / (ramp.high - ramp.low), 0, 1)
    rgba = np.array(ramp.colour_map()(np.nan_to_num(share)), np.float64)
    rgba[~np.isfinite(values)] = 0
    return rgba


def _codes(values: Array) -> list[int]:
    return [int(code) for code in np.unique(values[np.isfinite(values)])]


def _table(found: Sequence[int], table: Looks) -> Looks:
    """Name and colour of each code found; codes that the table lacks get colours in turn."""
    lacking = [code for code in found if code not in table]
    word = "Class " if table else ""
    own = {c: (f"{word}{c}", OTHER[i % len(OTHER)]) for i, c in enumerate(lacking)}
    return {code: own[code] if code in own else table[code] for code in found}


def _class_colours(values: Array, classes: Looks) -> Array:
    from matplotlib.colors import to_rgba

    rgba = np.zeros((*values.shape, 4))
    for code, (_, colour) in classes.items():
        rgba[values == code] = to_rgba(colour)
    return rgba


def _lit(rgba: Array, height: Array, cell: float, strength: float = 0.6) -> Array:
    """Colours shaded by a sun in the north-west, 45 degrees high."""
    shade = _shade(height, cell)[..., None]
    darker = rgba[..., :3] * (1 + strength * np.minimum(shade, 0) / math.sqrt(0.5))
    lighter = darker + (1 - darker) * strength * np.maximum(shade, 0)
    return np.concatenate([lighter, rgba[..., 3:]], axis=-1)


def _shade(height: Array, cell: float) -> Array:
    """Light on each pixel minus that on flat ground: -0.71 to 0.29, 0 where not known.

    Gentle terrain is exaggerated until a typical slope shows.
    """
    down, right = np.gradient(height, cell) if min(height.shape) > 1 else (height * 0, height * 0)
    steepness = np.hypot(down, right)
    known = steepness[np.isfinite(steepness)]
    typical = float(np.percentile(known, 75)) if len(known) else 0.0
    factor = min(max(0.35 / typical, 1.0), 6.0) if typical > 0 else 1.0
    # Ground that rises to the east and to the south faces the sun.
    towards = factor * (right + down) / math.sqrt(2)
    light = (1 + towards) / np.sqrt(1 + (factor * steepness) ** 2) / math.sqrt(2)
    return np.where(np.isfinite(light), np.clip(light, 0, 1) - math.sqrt(0.5), 0)
