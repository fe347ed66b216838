"""Pictures of layers: one PNG with a map and its key for each.

Points are gathered into pixels before they are drawn, so a picture of a hundred million points
is as small as one of a thousand. The same layers give the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.data.crs import length_problem, same_crs, vertical_unit
from toolbox.data.raster import Lattice, Raster
from toolbox.data.table import Table
from toolbox.data.vector import Vector
from toolbox.errors import DataError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from toolbox.data import PointCloud

Colour: TypeAlias = str
Classes: TypeAlias = Mapping[int, tuple[str, Colour]]

ASPRS_CLASSES: dict[int, tuple[str, Colour]] = {
    0: ("Never classified", "#c9c9c9"),
    1: ("Unclassified", "#a3a3a3"),
    2: ("Ground", "#c2a477"),
    3: ("Low vegetation", "#b5d78f"),
    4: ("Medium vegetation", "#74b356"),
    5: ("High vegetation", "#2f7d3b"),
    6: ("Building", "#d0533f"),
    7: ("Low point (noise)", "#e0399f"),
    8: ("Model key-point", "#8a6036"),
    9: ("Water", "#4a90d0"),
    10: ("Rail", "#4f4a52"),
    11: ("Road surface", "#7f828c"),
    12: ("Overlap", "#ddd0b4"),
    13: ("Wire - guard", "#f2d04b"),
    14: ("Wire - conductor", "#f09d1a"),
    15: ("Transmission tower", "#7f3f98"),
    16: ("Wire-structure connector", "#b98bd0"),
    17: ("Bridge deck", "#e6955f"),
    18: ("High noise", "#ff5ac8"),
    19: ("Overhead structure", "#a5688f"),
    20: ("Ignored ground", "#e0cfa6"),
    21: ("Snow", "#dff0f8"),
    22: ("Temporal exclusion", "#c3c2dc"),
}
"""Name and colour of the point classes of LAS 1.4 R15 (ASPRS 2019), table 17."""

ERROR_CLASSES: dict[int, tuple[str, Colour]] = {
    0: ("Ground, correct", "#d4d4d4"),
    1: ("Object, correct", "#6e6e6e"),
    2: ("Type I: ground missed", "#2166d1"),
    3: ("Type II: object taken for ground", "#d7261e"),
    4: ("No reference", "#f0dfae"),
}
"""Codes of the attribute "error" of a filtered cloud, in the colours of Sen & Bayasli (2020)."""

_OTHER = ("#5b8def", "#e5a93c", "#58b2a3", "#c46bb0", "#93b245", "#d9755b", "#7a72c9", "#9c8567")
_RELIEF = ("#62a392", "#8fbe99", "#c1d59e", "#efe6b6", "#dfbb88", "#c0906a", "#a38178", "#f7f5f2")
_EMPTY = "#f3f3f1"
_INK = "#3a3a3a"
_LENGTHS = {"metre": "m", "foot": "ft", "US survey foot": "US ft"}

_WIDTH = 4.4  # inches of a map
_FLATTEST, _TALLEST = 0.25, 1.6  # height of a map to its width
_DPI = 140
_PIXELS = 1000  # at most, along the longer side of a map
_MANY = 20  # more distinct values than this are no classes


@dataclass(frozen=True)
class Ramp:
    """The key of a continuous image."""

    colours: str | Sequence[Colour]  # a matplotlib name, or our own from low to high
    low: float
    high: float
    label: str
    extend: str = "neither"


@dataclass(frozen=True)
class Image:
    """What a map shows: RGBA of shape (rows, cols, 4), 0..1, and how to read it."""

    rgba: NDArray[np.float64]
    bounds: tuple[float, float, float, float]
    key: Ramp | Classes


@dataclass(frozen=True)
class Panel:
    """One map: what is below, and the vector layers over it."""

    title: str
    crs: CRS | None
    bounds: tuple[float, float, float, float]
    image: Image | None
    vectors: tuple[Vector, ...]

    def under(self, title: str, vector: Vector) -> Panel:
        """The map with one more layer over it."""
        return replace(self, title=f"{self.title} + {title}", vectors=(*self.vectors, vector))


def draw(layers: Mapping[str, PointCloud | Raster | Vector | Table], path: str | Path) -> None:
    """Draw layers side by side into one PNG.

    A raster is shown as relief, as colours, or as classes where it holds few integers; a cloud
    from above, the highest point on top, in the colours of its "error", its classes, its
    elevation or its intensity. A vector layer lies over the map before it, if that is in the
    same CRS and overlaps it, and has a map of its own otherwise. Tables are left out.

    Parameters
    ----------
    layers : by title
    path : ends in .png

    Raises
    ------
    DataError
        There is nothing to draw, or the picture cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if Path(path).suffix.lower() != ".png":
        raise DataError(f"{path}: pictures are written as .png")
    panels = _panels(layers)
    if not panels:
        raise DataError("nothing to draw: no layer has points, cells or features")
    figure = Figure(facecolor="white")
    FigureCanvasAgg(figure)
    for panel, place in zip(panels, _arrange(figure, panels), strict=True):
        _show(figure, panel, place)
    try:
        figure.savefig(path, dpi=_DPI, metadata={"Software": None}, format="png")
    except OSError as error:
        raise DataError(f"{path} cannot be written: {error}") from error


def _panels(layers: Mapping[str, PointCloud | Raster | Vector | Table]) -> list[Panel]:
    panels: list[Panel] = []
    for title, layer in layers.items():
        if isinstance(layer, Table):
            continue
        if isinstance(layer, Raster):
            panels.append(_of_image(title, layer.crs, raster_image(layer)))
        elif not isinstance(layer, Vector):
            panels += [_of_image(title, layer.crs, cloud_image(layer))] if len(layer) else []
        elif not np.isfinite(layer.frame.total_bounds).all():
            continue  # no feature has a geometry
        elif panels and _overlap(panels[-1], layer):
            panels[-1] = panels[-1].under(title, layer)
        else:
            west, south, east, north = (float(value) for value in layer.frame.total_bounds)
            bounds = _in_proportion(west, south, east, north, margin=0.04)
            panels.append(Panel(title, layer.crs, bounds, None, (layer,)))
    return panels


def _of_image(title: str, crs: CRS | None, image: Image) -> Panel:
    return Panel(title, crs, _in_proportion(*image.bounds), image, ())


def _overlap(panel: Panel, layer: Vector) -> bool:
    west, south, east, north = layer.frame.total_bounds
    left, bottom, right, top = panel.bounds
    meet = west < right and east > left and south < top and north > bottom
    return meet and same_crs(panel.crs, layer.crs)


def _in_proportion(
    west: float, south: float, east: float, north: float, margin: float = 0.0
) -> tuple[float, float, float, float]:
    """Bounds with a margin, widened where they are too flat or too narrow for a map."""
    margin *= max(east - west, north - south)
    width = max(east - west, (north - south) / _TALLEST) + 2 * margin or 1.0
    height = max(north - south, width * _FLATTEST)
    x, y = (west + east) / 2, (south + north) / 2
    if width == east - west and height == north - south:
        return west, south, east, north
    return x - width / 2, y - height / 2, x + width / 2, y + height / 2


# Images ------------------------------------------------------------------------------------


def raster_image(raster: Raster) -> Image:
    """The first band of a raster, in its colours."""
    step = max(1, math.ceil(max(raster.shape) / _PIXELS))
    band = raster.band()[::step, ::step]
    text = raster.descriptions[0]
    if raster.values.dtype.kind != "f" and len(found := _codes(band)) <= _MANY:
        table = ASPRS_CLASSES if "class" in text.lower() else {}
        classes = _table(found, table)
        return Image(_class_colours(band, classes), raster.bounds, classes)
    unit = raster.units[0]
    relief = unit in (*_LENGTHS, "m", "ft") or (unit == "" and len(raster.values) == 1)
    if "differ" in text.lower() or "change" in text.lower():
        high = float(np.nanpercentile(np.abs(band), 99)) if np.isfinite(band).any() else 1.0
        ramp = Ramp("RdBu_r", -high or -1.0, high or 1.0, _label(text, unit), "both")
        return Image(_colours(band, ramp), raster.bounds, ramp)
    ramp = _ramp(band, _RELIEF if relief else "viridis", _label(text, unit))
    rgba = _colours(band, ramp)
    if relief:
        rgba = _lit(rgba, band, raster.cell * step)
    return Image(rgba, raster.bounds, ramp)


def cloud_image(cloud: PointCloud) -> Image:
    """A cloud from above, one colour per pixel, the highest point on top."""
    lattice = _pixels(cloud)
    top = _highest(cloud, lattice)
    height = _gathered(cloud.xyz[:, 2], top)
    if "error" in cloud.names:
        return _classes_from_above(cloud["error"], ERROR_CLASSES, top, height, lattice)
    if "classification" in cloud.names and np.any(cloud["classification"] != 0):
        return _classes_from_above(cloud["classification"], ASPRS_CLASSES, top, height, lattice)
    flat = np.ptp(cloud.xyz[:, 2]) == 0
    if flat and "intensity" in cloud.names:
        shown = _gathered(cloud["intensity"].astype(np.float64), top)
        ramp = _ramp(shown, "gray", "Intensity")
        return Image(_colours(shown, ramp), lattice.bounds, ramp)
    ramp = _ramp(height, _RELIEF, _label("Elevation", vertical_unit(cloud.crs)))
    return Image(_lit(_colours(height, ramp), height, lattice.cell), lattice.bounds, ramp)


def _classes_from_above(
    codes: NDArray[Any],
    table: Classes,
    top: NDArray[np.int64],
    height: NDArray[np.float64],
    lattice: Lattice,
) -> Image:
    shown = _gathered(codes.astype(np.float64), top)
    classes = _table(_codes(shown), table)
    rgba = _lit(_class_colours(shown, classes), height, lattice.cell, strength=0.35)
    return Image(rgba, lattice.bounds, classes)


def _pixels(cloud: PointCloud) -> Lattice:
    """Pixels of about the spacing of the points, so that ground shows and detail stays."""
    west, south, _, east, north, _ = cloud.bounds
    longest = max(east - west, north - south)
    spacing = math.sqrt(max((east - west) * (north - south), 1e-6 * longest**2) / len(cloud))
    return Lattice.cover(cloud.bounds, max(longest / _PIXELS, spacing) or 1.0)


def _highest(cloud: PointCloud, lattice: Lattice) -> NDArray[np.int64]:
    """Index of the highest point of each pixel, of the nearest one in small gaps, or -1."""
    from scipy import ndimage

    row, col = lattice.indices(cloud.xyz[:, 0], cloud.xyz[:, 1])
    upwards = np.argsort(cloud.xyz[:, 2], kind="stable")
    top = np.full(lattice.shape, -1, np.int64)
    top[row[upwards], col[upwards]] = upwards  # the last one written is the highest
    away, nearest = ndimage.distance_transform_edt(top < 0, return_indices=True)
    return np.where(away < 1.5, top[tuple(nearest)], -1)


def _gathered(values: NDArray[Any], top: NDArray[np.int64]) -> NDArray[np.float64]:
    """The value of the point shown in each pixel; NaN where there is none."""
    return np.where(top >= 0, values[top], np.nan)


# Colours -----------------------------------------------------------------------------------


def _ramp(values: NDArray[np.float64], colours: str | Sequence[Colour], label: str) -> Ramp:
    """Colours over the values but for the outermost 0.5 %, which would fade all others."""
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return Ramp(colours, 0.0, 1.0, label)
    low, high = (float(v) for v in np.percentile(known, [0.5, 99.5]))
    if low == high:
        low, high = low - 0.5, high + 0.5
    below, above = bool(known.min() < low), bool(known.max() > high)
    extend = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[below, above]
    return Ramp(colours, low, high, label, extend)


def _colour_map(ramp: Ramp) -> Any:
    import matplotlib
    from matplotlib.colors import LinearSegmentedColormap

    if isinstance(ramp.colours, str):
        return matplotlib.colormaps[ramp.colours]
    return LinearSegmentedColormap.from_list("ramp", list(ramp.colours))


def _colours(values: NDArray[np.float64], ramp: Ramp) -> NDArray[np.float64]:
    share = np.clip((values - ramp.low) / (ramp.high - ramp.low), 0, 1)
    rgba = np.array(_colour_map(ramp)(np.nan_to_num(share)), np.float64)
    rgba[~np.isfinite(values)] = 0
    return rgba


def _codes(values: NDArray[np.float64]) -> list[int]:
    return [int(code) for code in np.unique(values[np.isfinite(values)])]


def _table(found: Sequence[int], table: Classes) -> Classes:
    """Name and colour of each code found; codes that the table lacks get colours in turn."""
    lacking = [code for code in found if code not in table]
    word = "Class " if table else ""
    own = {c: (f"{word}{c}", _OTHER[i % len(_OTHER)]) for i, c in enumerate(lacking)}
    return {code: own[code] if code in own else table[code] for code in found}


def _class_colours(values: NDArray[np.float64], classes: Classes) -> NDArray[np.float64]:
    from matplotlib.colors import to_rgba

    rgba = np.zeros((*values.shape, 4))
    for code, (_, colour) in classes.items():
        rgba[values == code] = to_rgba(colour)
    return rgba


def _lit(
    rgba: NDArray[np.float64], height: NDArray[np.float64], cell: float, strength: float = 0.6
) -> NDArray[np.float64]:
    """Colours in the light of a sun in the north-west, 45 degrees high.

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
    shade = np.where(np.isfinite(light), np.clip(light, 0, 1) - math.sqrt(0.5), 0)
    lit = rgba.copy()
    colour = rgba[..., :3]
    darker = colour * (1 + strength * np.minimum(shade, 0)[..., None] / math.sqrt(0.5))
    lighter = darker + (1 - darker) * strength * np.maximum(shade, 0)[..., None]
    lit[..., :3] = lighter
    return lit


# Layout ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Place:
    """Where a map and its key go, as (left, bottom, width, height) in inches."""

    map: tuple[float, float, float, float]
    key: tuple[float, float, float, float]


def _arrange(figure: Figure, panels: Sequence[Panel]) -> list[Place]:
    """Rows of up to three maps of one width, as high as each extent asks for."""
    columns = len(panels) if len(panels) <= 3 else 2 + (len(panels) > 4)
    left, gap, head, foot = 0.42, 0.5, 0.36, 0.32
    rows = [panels[i : i + columns] for i in range(0, len(panels), columns)]
    heights = [max(_height(p) for p in row) for row in rows]
    keys = [max(_key_height(p) for p in row) for row in rows]
    total = sum(heights) + sum(keys) + len(rows) * (head + foot) + 0.1
    figure.set_size_inches(columns * (_WIDTH + gap) + left - gap + 0.15, total)
    places, y = [], total
    for row, height, key in zip(rows, heights, keys, strict=True):
        for column, panel in enumerate(row):
            x, own = left + column * (_WIDTH + gap), _height(panel)
            bottom = y - head - own
            places.append(
                Place((x, bottom, _WIDTH, own), (x, bottom - foot - key, _WIDTH, key - 0.05))
            )
        y -= head + height + foot + key
    return places


def _height(panel: Panel) -> float:
    """Of a map in inches, by the shape of its extent."""
    west, south, east, north = panel.bounds
    return _WIDTH * (north - south) / (east - west)


def _key_height(panel: Panel) -> float:
    if panel.image is None:
        return 0.1
    key = panel.image.key
    return 0.5 if isinstance(key, Ramp) else 0.12 + 0.19 * math.ceil(len(key) / _key_columns(key))


def _key_columns(key: Classes) -> int:
    """As many as fit beside each other by the longest name."""
    longest = max((len(name) for name, _ in key.values()), default=1)
    return max(1, min(4, len(key), int(_WIDTH / (0.32 + 0.055 * longest))))


def _show(figure: Figure, panel: Panel, place: Place) -> None:
    size = [*figure.get_size_inches()] * 2
    west, south, east, north = panel.bounds
    fractions = [a / b for a, b in zip(place.map, size, strict=True)]
    axes = figure.add_axes((fractions[0], fractions[1], fractions[2], fractions[3]))
    axes.set_facecolor(_EMPTY)
    if panel.image is not None:
        left, bottom, right, top = panel.image.bounds
        axes.imshow(panel.image.rgba, extent=(left, right, bottom, top), interpolation="auto")
        fractions = [a / b for a, b in zip(place.key, size, strict=True)]
        _show_key(figure, panel.image.key, fractions)
    for vector in panel.vectors:
        _show_vector(axes, vector, over=panel.image is not None)
    axes.set(xlim=(west, east), ylim=(south, north), aspect="equal")
    axes.set_title(panel.title, fontsize=10, color=_INK, loc="left", pad=6, fontweight="bold")
    _show_ticks(axes)
    if length_problem(panel.crs) is None:
        _show_scale(axes, panel)


def _show_key(figure: Figure, key: Ramp | Classes, place: Sequence[float]) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.patches import Patch

    left, bottom, width, height = place
    if not isinstance(key, Ramp):
        axes = figure.add_axes((left, bottom, width, height), frameon=False)
        axes.set_axis_off()
        patches = [Patch(facecolor=c, edgecolor="#00000055", lw=0.4) for _, c in key.values()]
        names = [name for name, _ in key.values()]
        style = {"fontsize": 7.5, "labelcolor": _INK, "frameon": False, "ncols": _key_columns(key)}
        axes.legend(
            patches, names, loc="upper left", borderaxespad=0, borderpad=0.2, handlelength=1.1,
            handleheight=0.9, columnspacing=1.2, **style,
        )  # fmt: skip
        return
    inch = height / 0.45
    axes = figure.add_axes((left, bottom + height - 0.12 * inch, width, 0.12 * inch))
    norm = Normalize(key.low, key.high)
    bar = figure.colorbar(
        ScalarMappable(norm, _colour_map(key)),
        cax=axes,
        orientation="horizontal",
        extend=key.extend,
        extendfrac=0.025,
    )
    bar.outline.set(linewidth=0.5, edgecolor=_INK)
    bar.set_label(key.label, fontsize=7.5, color=_INK, labelpad=2)
    axes.tick_params(labelsize=7, colors=_INK, length=2.5, width=0.5, pad=2)


def _show_ticks(axes: Axes) -> None:
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        ticks = _round_ticks(low, high)
        axis.set_ticks(ticks, [f"{tick:,.10g}" for tick in ticks])
    axes.tick_params(labelsize=6.5, colors="#6a6a6a", length=2.5, width=0.5, pad=2)
    for label in axes.get_yticklabels():
        label.set(rotation=90, verticalalignment="center")
    for spine in axes.spines.values():
        spine.set(linewidth=0.6, edgecolor="#8a8a8a")


def _show_scale(axes: Axes, panel: Panel) -> None:
    """A bar of 1, 2 or 5 times a power of ten, about a fifth of the map wide."""
    from matplotlib.patches import Rectangle

    width = panel.bounds[2] - panel.bounds[0]
    length = _round_length(width / 4.5)
    unit = _LENGTHS.get(vertical_unit(panel.crs), "units")
    text = f"{length / 1000:g} km" if unit == "m" and length >= 1000 else f"{length:g} {unit}"
    share = length / width
    inch = 1 / _height(panel)
    box: dict[str, Any] = {"transform": axes.transAxes, "zorder": 9}
    axes.add_patch(
        Rectangle((0.02, 0.08 * inch), share + 0.03, 0.28 * inch, fc="#ffffffd8", ec="none", **box)
    )
    axes.add_patch(Rectangle((0.035, 0.14 * inch), share, 0.03 * inch, fc=_INK, ec="none", **box))
    axes.text(
        0.035 + share / 2, 0.19 * inch, text, fontsize=7, color=_INK, ha="center", va="bottom",
        transform=axes.transAxes, zorder=10,
    )  # fmt: skip


def _round_ticks(low: float, high: float) -> list[float]:
    """Two to five round numbers, away from the corners, where their texts would meet."""
    step = _round_length((high - low) / 2.5)
    first, last = math.ceil(low / step), math.floor(high / step)
    margin = 0.07 * (high - low)
    ticks = [count * step for count in range(first, last + 1)]
    return [tick for tick in ticks if low + margin <= tick <= high - margin]


def _round_length(length: float) -> float:
    power = 10.0 ** math.floor(math.log10(length))
    return next(f for f in (5, 2, 1) if f * power <= length * (1 + 1e-9)) * power


def _show_vector(axes: Axes, vector: Vector, *, over: bool) -> None:
    """Polygons filled where nothing is below them, lines with a light edge where something is."""
    import shapely
    from matplotlib.collections import LineCollection, PathCollection
    from matplotlib.path import Path as Outline

    parts = shapely.get_parts(shapely.force_2d(vector.frame.geometry.to_numpy()))
    kind = shapely.get_dimensions(parts)
    if not over:
        rings = [[shapely.get_coordinates(r) for r in _rings(p)] for p in parts[kind == 2]]
        outlines = [
            Outline.make_compound_path(*(Outline(c, closed=True) for c in r)) for r in rings
        ]
        axes.add_collection(PathCollection(outlines, facecolor="#9db8d2", alpha=0.6, lw=0))
    lines = [shapely.get_coordinates(line) for line in parts[kind == 1]]
    lines += [shapely.get_coordinates(r) for p in parts[kind == 2] for r in _rings(p)]
    if over:
        axes.add_collection(LineCollection(lines, colors="#ffffffb0", linewidths=1.8))
    axes.add_collection(LineCollection(lines, colors="#1f3a5f", linewidths=0.8))
    points = shapely.get_coordinates(parts[kind == 0])
    axes.plot(*points.T, "o", ms=3, mfc="#1f3a5f", mec="white", mew=0.5, ls="none")


def _rings(polygon: Any) -> list[Any]:
    return [polygon.exterior, *polygon.interiors]


def _label(text: str, unit: str) -> str:
    """Text and unit, such as "Elevation (m)"."""
    short = "" if unit == "1" else _LENGTHS.get(unit, unit)
    return f"{text} ({short})" if text and short else text or short
