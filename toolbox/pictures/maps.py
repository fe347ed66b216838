"""Maps on a matplotlib figure: layout, image, vector layers, key, ticks and scale bar."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox import language
from toolbox.data import Vector
from toolbox.data.crs import length_problem, short_height_unit
from toolbox.declare.show import Isolines, Texts, colour_of
from toolbox.pictures.features import Coloured, feature_colours, feature_key
from toolbox.pictures.images import Bounds, Image, Key, Looks, Ramp

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Box = tuple[float, float, float, float]  # left, bottom, width, height

_EMPTY, _PAPER = "#ccd3db", "#f6f6f4"  # no data in a map is no colour of its key
INK = "#3a3a3a"
_FEW = 500  # features that have room for large dots
_TEXT_WIDTH = 0.3  # inches around a text that others leave free: one of six digits
_LIGHT, _HEAVY = 0.35, 1.1  # points, widths of isolines; 0.8 of other lines
_LINE, _SHADOW = "#1f3a5f", "#9a9a9a"
WIDTH = 4.4  # inches of a map
TITLE = 50  # characters of 10 points that are as wide as a map
_FLATTEST, _TALLEST = 0.25, 1.6  # height of a map to its width
_TICK_TEXT = 0.5  # inches that a coordinate of nine digits takes
LEFT, _GAP, _HEAD, _FOOT = 0.42, 0.5, 0.36, 0.32  # inches around a map, for its texts


@dataclass(frozen=True)
class Panel:
    """One map: its image, and the vector layers over it.

    Attributes
    ----------
    apart : it is in coordinates of its own, so that no other layer lies over it
    """

    title: str
    crs: CRS | None
    bounds: Bounds
    image: Image | None
    vectors: tuple[Coloured, ...]
    apart: bool = False

    def under(self, title: str, vector: Coloured) -> Panel:
        """The map with one more vector layer on top."""
        return replace(self, title=f"{self.title} + {title}", vectors=(*self.vectors, vector))

    @property
    def height(self) -> float:
        """Height of the map in inches, by the shape of its bounds."""
        west, south, east, north = self.bounds
        return WIDTH * (north - south) / (east - west)

    @property
    def key(self) -> Key | None:
        """Key of the image, or else of the first vector layer; None if that has none."""
        return self.image.key if self.image else feature_key(self.vectors[0])

    @property
    def key_height(self) -> float:
        """Height of the key in inches."""
        if (key := self.key) is None:
            return 0.1
        if isinstance(key, Ramp):
            return 0.5
        return 0.12 + 0.19 * math.ceil(len(key) / _key_columns(key))

    def draw_on(self, figure: Figure, place: Place) -> None:
        """Draw one map with its key."""
        axes = figure.add_axes(fractions(figure, place.map))
        axes.set_facecolor(_PAPER if self.image is None else _EMPTY)
        if self.image is not None:
            west, south, east, north = self.image.bounds
            axes.imshow(self.image.rgba, extent=(west, east, south, north), interpolation="auto")
        if self.key is not None:
            _show_key(figure, self.key, fractions(figure, place.key))
        for number, vector in enumerate(self.vectors):
            if self.image is None and self.key is not None and number == 0:
                _show_coloured(axes, vector[0], feature_colours(vector, self.key))
            else:
                _show_vector(axes, vector, self.bounds, over=self.image is not None)
        west, south, east, north = self.bounds
        axes.set(xlim=(west, east), ylim=(south, north), aspect="equal")
        size = min(10.0, 10.0 * TITLE / len(self.title)) if self.title else 10.0
        axes.set_title(self.title, fontsize=size, color=INK, loc="left", pad=6, fontweight="bold")
        _show_ticks(axes, self)
        if length_problem(self.crs) is None:
            _show_scale(axes, self)


@dataclass(frozen=True)
class Place:
    """Boxes of a map and of its key on the figure, in inches."""

    map: Box
    key: Box


def in_proportion(bounds: Bounds, margin: float = 0.0) -> Bounds:
    """Bounds with a margin, widened where they are too flat or too narrow for a map.

    Parameters
    ----------
    bounds : (xmin, ymin, xmax, ymax)
    margin : share of the longer side
    """
    west, south, east, north = bounds
    margin *= max(east - west, north - south)
    width = max(east - west, (north - south) / _TALLEST) + 2 * margin or 1.0
    height = max(north - south + 2 * margin, width * _FLATTEST)
    if width == east - west and height == north - south:
        return bounds
    x, y = (west + east) / 2, (south + north) / 2
    return x - width / 2, y - height / 2, x + width / 2, y + height / 2


class Drawn(Protocol):
    """A map or chart, which has a height in inches and can be drawn."""

    @property
    def height(self) -> float: ...

    @property
    def key_height(self) -> float: ...

    def draw_on(self, figure: Figure, place: Place) -> None: ...


def arrange(figure: Figure, panels: Sequence[Drawn]) -> list[Place]:
    """Set the size of the figure, and return the boxes of all panels, in rows of up to three."""
    columns = len(panels) if len(panels) <= 3 else 2 + (len(panels) > 4)
    rows = [panels[i : i + columns] for i in range(0, len(panels), columns)]
    heights = [max(panel.height for panel in row) for row in rows]
    keys = [max(panel.key_height for panel in row) for row in rows]
    y = sum(heights) + sum(keys) + len(rows) * (_HEAD + _FOOT) + 0.1
    figure.set_size_inches(columns * (WIDTH + _GAP) + LEFT - _GAP + 0.15, y)
    places = []
    for row, height, key in zip(rows, heights, keys, strict=True):
        for column, panel in enumerate(row):
            x, bottom = LEFT + column * (WIDTH + _GAP), y - _HEAD - panel.height
            below = (x, bottom - _FOOT - key, WIDTH, key - 0.05)
            places.append(Place((x, bottom, WIDTH, panel.height), below))
        y -= _HEAD + height + _FOOT + key
    return places


def fractions(figure: Figure, box: Box) -> Box:
    """A box in inches as fractions of the figure."""
    width, height = (float(inches) for inches in figure.get_size_inches())
    return box[0] / width, box[1] / height, box[2] / width, box[3] / height


def say(figure: Figure) -> None:
    """Put all texts of a figure into the language of the user."""
    from matplotlib.axes import Axes
    from matplotlib.text import Text

    from toolbox.pictures.ticks import Said

    if language.chosen() == "en":
        return
    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        if text.get_text():
            text.set_text(language.label(text.get_text()))
    for axes in figure.findobj(Axes):
        assert isinstance(axes, Axes)
        for axis in (axes.xaxis, axes.yaxis):  # which write their ticks as they are drawn
            axis.set_major_formatter(Said(axis.get_major_formatter()))


# Keys --------------------------------------------------------------------------------------


def _show_key(figure: Figure, key: Key, place: Box) -> None:
    if isinstance(key, Ramp):
        _show_ramp(figure, key, place)
    else:
        _show_classes(figure, key, place)


def _show_ramp(figure: Figure, ramp: Ramp, place: Box) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    left, bottom, width, height = place
    thickness = height * 0.12 / 0.45  # inches
    axes = figure.add_axes((left, bottom + height - thickness, width, thickness))
    colours = ScalarMappable(Normalize(ramp.low, ramp.high), ramp.colour_map())
    bar = figure.colorbar(
        colours, cax=axes, orientation="horizontal", extend=ramp.extend, extendfrac=0.025
    )
    bar.outline.set(linewidth=0.5, edgecolor=INK)
    bar.set_label(ramp.label, fontsize=7.5, color=INK, labelpad=2)
    axes.tick_params(labelsize=7, colors=INK, length=2.5, width=0.5, pad=2)


def _show_classes(figure: Figure, classes: Looks, place: Box) -> None:
    from matplotlib.patches import Patch

    axes = figure.add_axes(place, frameon=False)
    axes.set_axis_off()
    patches = [Patch(facecolor=c, edgecolor="#00000055", lw=0.4) for _, c in classes.values()]
    axes.legend(
        patches,
        [name for name, _ in classes.values()],
        ncols=_key_columns(classes),
        fontsize=7.5,
        labelcolor=INK,
        frameon=False,
        loc="upper left",
        borderaxespad=0,
        borderpad=0.2,
        handlelength=1.1,
        handleheight=0.9,
        columnspacing=1.2,
    )


def _key_columns(classes: Looks) -> int:
    """Number of columns of a key, by its longest name."""
    longest = max((len(name) for name, _ in classes.values()), default=1)
    return max(1, min(4, len(classes), int(WIDTH / (0.32 + 0.055 * longest))))


# Ticks and scale ---------------------------------------------------------------------------


def _show_ticks(axes: Axes, panel: Panel) -> None:
    west, south, east, north = panel.bounds
    for axis, low, high, inches in (
        (axes.xaxis, west, east, WIDTH),
        (axes.yaxis, south, north, panel.height),
    ):
        ticks = _round_ticks(low, high, inches)
        axis.set_ticks(ticks, [f"{tick:,.10g}" for tick in ticks])
    axes.tick_params(labelsize=6.5, colors="#6a6a6a", length=2.5, width=0.5, pad=2)
    for label in axes.get_yticklabels():
        label.set(rotation=90, verticalalignment="center")
    for spine in axes.spines.values():
        spine.set(linewidth=0.6, edgecolor="#8a8a8a")


def _show_scale(axes: Axes, panel: Panel) -> None:
    """Draw a scale bar of 1, 2 or 5 times a power of ten, about a fifth of the map wide."""
    from matplotlib.patches import Rectangle

    width = panel.bounds[2] - panel.bounds[0]
    length = round_length(width / 4.5)
    unit = short_height_unit(panel.crs) or "units"
    text = f"{length / 1000:g} km" if unit == "m" and length >= 1000 else f"{length:g} {unit}"
    share, inch = length / width, 1 / panel.height
    box: dict[str, Any] = {"transform": axes.transAxes, "zorder": 9, "ec": "none"}
    axes.add_patch(Rectangle((0.02, 0.08 * inch), share + 0.03, 0.28 * inch, fc="#ffffffd8", **box))
    axes.add_patch(Rectangle((0.035, 0.14 * inch), share, 0.03 * inch, fc=INK, **box))
    axes.text(
        0.035 + share / 2,
        0.19 * inch,
        text,
        fontsize=7,
        color=INK,
        ha="center",
        va="bottom",
        transform=axes.transAxes,
        zorder=10,
    )


def _round_ticks(low: float, high: float, inches: float) -> list[float]:
    """At most five round numbers between limits, away from each other and from the corners.

    Examples
    --------
    >>> _round_ticks(0, 100, 3.0), _round_ticks(0, 100, 1.1)
    ([20.0, 40.0, 60.0, 80.0], [50.0])
    """
    step = round_length((high - low) / 2.5)
    while step * inches < _TICK_TEXT * (high - low):
        step = round_length(2.5 * step)
    first, last = math.ceil(low / step), math.floor(high / step)
    margin = 0.07 * (high - low)
    ticks = [count * step for count in range(first, last + 1)]
    return [tick for tick in ticks if low + margin <= tick <= high - margin]


def round_length(length: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not longer."""
    power = 10.0 ** math.floor(math.log10(length))
    return next(f for f in (5, 2, 1) if f * power <= length * (1 + 1e-9)) * power


# Vectors -----------------------------------------------------------------------------------


def _show_vector(axes: Axes, features: Coloured, bounds: Bounds, *, over: bool) -> None:
    """Draw a vector layer in one colour: filled, or with light edges over an image."""
    import shapely
    from matplotlib.collections import LineCollection

    vector, show = features
    if isinstance(show, Isolines):
        _show_isolines(axes, vector, show)
        return
    if isinstance(show, Texts):
        _show_texts(axes, vector, show, bounds)
        return
    parts = shapely.get_parts(shapely.force_2d(vector.frame.geometry.to_numpy()))
    kind = shapely.get_dimensions(parts)
    polygons = [_rings(polygon) for polygon in parts[kind == 2]]
    lines = [shapely.get_coordinates(line) for line in parts[kind == 1]]
    lines += [ring for rings in polygons for ring in rings]
    if over:
        axes.add_collection(LineCollection(lines, colors="#ffffffb0", linewidths=1.8))
    else:
        _fill(axes, polygons)
    colour = colour_of((show,) if show else (), _LINE)
    axes.add_collection(LineCollection(lines, colors=colour, linewidths=0.8))
    points = shapely.get_coordinates(parts[kind == 0])
    size, edge = (3, 0.5) if len(points) <= _FEW else (1.2, 0)  # many, as corners of a line
    axes.plot(*points.T, "o", ms=size, mfc=colour, mec="white", mew=edge, ls="none")


def _show_isolines(axes: Axes, vector: Vector, show: Isolines) -> None:
    """Draw thin lines, and heavy ones where they are index lines."""
    import shapely
    from matplotlib.collections import LineCollection

    shapes = shapely.force_2d(vector.frame.geometry.to_numpy())
    parts, feature = shapely.get_parts(shapes, return_index=True)
    heavy = vector.frame[show.heavy].to_numpy(bool)[feature]
    lines = [shapely.get_coordinates(line) for line in parts]
    widths = [_HEAVY if index else _LIGHT for index in heavy]
    axes.add_collection(LineCollection(lines, colors=_LINE, linewidths=widths))


def _show_texts(axes: Axes, vector: Vector, show: Texts, bounds: Bounds) -> None:
    """Write texts at points, on paper that hides the line below, but for those upon others."""
    import shapely

    places = shapely.get_coordinates(vector.frame.geometry.to_numpy())
    texts, angles = vector.frame[show.text].to_numpy(), vector.frame[show.angle].to_numpy(float)
    paper: dict[str, Any] = {"facecolor": _PAPER, "edgecolor": "none", "pad": 0.4}
    for n in _apart(places, _TEXT_WIDTH / WIDTH * (bounds[2] - bounds[0])):
        x, y = places[n]
        written = axes.text(x, y, str(texts[n]), fontsize=5.5, color=_LINE, bbox=paper)
        written.set(rotation=angles[n], ha="center", va="center", clip_on=True)


def _apart(places: NDArray[np.float64], far: float) -> list[int]:
    """Indices of places that are this far from each other; of those closer the first stays.

    >>> _apart(np.array([[0.0, 0.0], [3.0, 0.0], [9.0, 0.0]]), 5.0)
    [0, 2]
    """
    squares = np.unique(np.floor(places / far), axis=0, return_index=True)[1]
    kept: list[int] = []
    for n in sorted(squares.tolist()):
        if all(np.hypot(*(places[n] - places[k])) >= far for k in kept):
            kept.append(n)
    return kept


def _show_coloured(axes: Axes, vector: Vector, colours: NDArray[Any]) -> None:
    """Draw each feature in its colour; narrow polygons show by their outlines."""
    import shapely
    from matplotlib.collections import LineCollection, PathCollection

    shapes = shapely.force_2d(vector.frame.geometry.to_numpy())
    parts, feature = shapely.get_parts(shapes, return_index=True)
    kind, colour = shapely.get_dimensions(parts), colours[feature]
    areas = [_path(_rings(polygon)) for polygon in parts[kind == 2]]
    axes.add_collection(
        PathCollection(areas, facecolor=colour[kind == 2], edgecolor=colour[kind == 2], lw=0.6)
    )
    lines = [shapely.get_coordinates(line) for line in parts[kind == 1]]
    axes.add_collection(LineCollection(lines, colors=colour[kind == 1], linewidths=1.2))
    points = shapely.get_coordinates(parts[kind == 0])
    size = 22 if len(points) <= _FEW else 5  # square points
    x, y = points.T
    axes.scatter(x, y, c=_SHADOW, s=(size**0.5 + 1) ** 2, lw=0)  # or white would not show
    axes.scatter(x, y, c=colour[kind == 0], s=size, lw=0)


def _path(rings: Sequence[Any]) -> Any:
    """Path of matplotlib for a polygon with holes."""
    from matplotlib.path import Path

    return Path.make_compound_path(*(Path(ring, closed=True) for ring in rings))


def _fill(axes: Axes, polygons: Sequence[Sequence[Any]]) -> None:
    """Fill polygons, each given as its rings: the exterior and then the holes."""
    from matplotlib.collections import PathCollection

    paths = [_path(rings) for rings in polygons]
    axes.add_collection(PathCollection(paths, facecolor="#9db8d2", alpha=0.6, lw=0))


def _rings(polygon: Any) -> list[Any]:
    """Coordinates of the exterior and of each hole."""
    import shapely

    return [shapely.get_coordinates(ring) for ring in (polygon.exterior, *polygon.interiors)]
