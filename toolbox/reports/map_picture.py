"""The map of a report on paper: the same image, layers and colours as on the screen, with a key."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox.pictures.images import Image, Ramp
from toolbox.pictures.maps import INK, round_length, say

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DPI, WIDTH = 150, 7.2  # inches
HALF = 3.9  # inches of a map that stands beside another, so that its texts are as large
_LINE, _THIN = 1.3, 0.5  # points
_BELOW = 0.45  # inches from a map to its key
_BAR = 0.07, 0.42  # inches: height of a ramp of colours, and what it takes with its texts
_TALLEST, _FLATTEST = 1.25, 0.35  # height to width
_ROOM = "#e9edf1"


def map_png(data: Mapping[str, Any], image: Image | None, width: float = WIDTH) -> bytes:
    """The map as a PNG.

    Parameters
    ----------
    data : as the page draws it, see `toolbox.reports.maps`
    image : what lies below; None for nothing
    width : in inches
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    west, south, east, north = _in_proportion(data["bounds"])
    x0, y0 = data["x0"], data["y0"]
    shape = (north - south) / (east - west)
    tall = width * shape + 0.5
    figure = Figure(figsize=(width, tall), facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.08, _BELOW / tall, 0.9, 0.9 * width * shape / tall))
    axes.set_facecolor(_ROOM)
    if image is not None:
        left, bottom, right, top = image.bounds
        axes.imshow(image.rgba, extent=(left, right, bottom, top), interpolation="auto")
    for layer in data["layers"]:
        for group in layer["groups"] if not layer["hidden"] else ():
            _draw(axes, group, x0, y0)
        _write(axes, () if layer["hidden"] else layer.get("texts", ()), x0, y0)
    axes.set(xlim=(x0 + west, x0 + east), ylim=(y0 + south, y0 + north), aspect="equal")
    axes.set_xlabel(data["axes"][0], fontsize=7, color=INK)
    axes.set_ylabel(data["axes"][1], fontsize=7, color=INK)
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.locator_params(nbins=5 if width > HALF else 3)
    axes.tick_params(labelsize=6.5, colors=INK, length=2.5, width=0.5)
    _scale(axes, data, east - west)
    below = -_BELOW / (0.9 * width * shape)
    if image is not None and isinstance(image.key, Ramp):
        _ramp(axes, image.key, below, 0.9 * width * shape)
        below -= _BAR[1] / (0.9 * width * shape)
    if handles := [*_of_layers(data["layers"]), *_of_image(image)]:
        columns = 3 if width > HALF else 2
        key = axes.legend(
            handles=handles, loc="upper left", ncols=columns, fontsize=7, frameon=False
        )
        key.set_bbox_to_anchor((0, below))
    say(figure)
    made = io.BytesIO()
    how: dict[str, Any] = {"bbox_inches": "tight", "metadata": {"Software": None}}
    figure.savefig(made, dpi=_DPI, format="png", **how)
    return made.getvalue()


def _in_proportion(bounds: Sequence[float]) -> tuple[float, float, float, float]:
    """Bounds that are neither too flat nor too tall for a page."""
    west, south, east, north = bounds
    width = max(east - west, (north - south) / _TALLEST)
    height = max(north - south, width * _FLATTEST)
    x, y = (west + east) / 2, (south + north) / 2
    return x - width / 2, y - height / 2, x + width / 2, y + height / 2


def _draw(axes: Axes, group: Mapping[str, Any], x0: float, y0: float) -> None:
    from matplotlib.collections import LineCollection, PathCollection
    from matplotlib.path import Path

    origin = np.array([x0, y0])
    features = [
        [np.reshape(part, (-1, 2)) + origin for part in parts] for _, parts in group["features"]
    ]
    flat = [part for parts in features for part in parts]
    colour = group["colour"]
    if group["shape"] == "point":
        x, y = np.concatenate(flat).T
        axes.scatter(x, y, s=22, c=colour, edgecolors="white", linewidths=0.7, zorder=4)
        return
    if group["shape"] == "area" and not group.get("open"):
        areas = [Path.make_compound_path(*(Path(p, closed=True) for p in f)) for f in features]
        axes.add_collection(PathCollection(areas, facecolor=f"{colour}66", edgecolor="none"))
    wide = _THIN if group.get("thin") else _LINE
    axes.add_collection(LineCollection(flat, colors=colour, linewidths=wide, zorder=3))


def _write(axes: Axes, texts: Sequence[Any], x0: float, y0: float) -> None:
    """The numbers of features, with a white edge, that they are read upon everything."""
    from matplotlib.patheffects import withStroke

    edge = [withStroke(linewidth=2, foreground="white")]
    how: dict[str, Any] = {"ha": "center", "va": "center", "zorder": 5, "clip_on": True}
    for x, y, text in texts:
        axes.text(x0 + x, y0 + y, text, fontsize=8, color=INK, path_effects=edge, **how)


def _ramp(axes: Axes, key: Ramp, below: float, tall: float) -> None:
    """The colours of continuous values under a map, with the numbers of ends and middle."""
    bar = axes.inset_axes((0.0, below - _BAR[0] / tall, 0.5, _BAR[0] / tall))
    bar.imshow(np.linspace(0, 1, 256)[np.newaxis], aspect="auto", cmap=key.colour_map())
    low, high = key.ends
    bar.set_xticks([0, 127.5, 255], [low, key.text((key.low + key.high) / 2), high])
    bar.set_yticks([])
    bar.tick_params(labelsize=6.5, colors=INK, length=2, width=0.5)
    bar.spines[:].set_linewidth(0.3)
    axes.annotate(
        key.label, (0.52, below), xycoords="axes fraction", fontsize=7, color=INK, va="top"
    )


def _scale(axes: Axes, data: Mapping[str, Any], width: float) -> None:
    """A scale bar, and an arrow to the north."""
    how: dict[str, Any] = {"transform": axes.transAxes, "color": INK, "zorder": 6}
    if data["length"]:
        name, size = data["length"]
        length = round_length(width / size / 5)
        share = length * size / width
        axes.plot([0.03, 0.03 + share], [0.03, 0.03], lw=2.5, **how)
        far = name == "m" and length >= 1000
        text = f"{length / 1000:g} km" if far else f"{length:g} {name}"
        box = {"facecolor": "#ffffffd8", "edgecolor": "none", "pad": 1.5}
        axes.text(0.03, 0.04, text, fontsize=7, bbox=box, va="bottom", **how)
    if data["north"]:
        axes.text(0.97, 0.03, "▲\nN", fontsize=8, ha="center", va="bottom", **how)


def _of_layers(layers: Sequence[Mapping[str, Any]]) -> Iterator[Any]:
    """The key of the layers."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    for layer in layers:
        for group in layer["groups"] if not layer["hidden"] else ():
            name, colour = group["name"], group["colour"]
            label = name if name == layer["name"] else f"{layer['name']}: {name}"
            if group["shape"] == "point":
                dot: dict[str, Any] = {"ls": "none", "marker": "o", "markeredgecolor": "white"}
                yield Line2D([], [], color=colour, label=label, **dot)
            elif group["shape"] == "line":
                yield Line2D([], [], color=colour, lw=1.5, label=label)
            else:
                inside = "none" if group.get("open") else f"{colour}66"
                yield Patch(facecolor=inside, edgecolor=colour, label=label)


def _of_image(image: Image | None) -> Iterator[Any]:
    """The key of an image with classes."""
    from matplotlib.patches import Patch

    if image is None or isinstance(image.key, Ramp):
        return
    for name, colour in image.key.values():
        yield Patch(facecolor=colour, edgecolor="#00000033", label=name)
