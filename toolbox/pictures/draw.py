"""Plots of layers: one PNG with a map and its key, or a chart, for each layer.

Points are gathered into pixels before they are drawn, so a picture of a hundred million points
is as small as one of a thousand. The same layers give the same bytes.
"""

from __future__ import annotations

import fnmatch
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from toolbox.context import log
from toolbox.data import PointCloud, Raster, Table, Vector
from toolbox.data.crs import crs_conflict
from toolbox.data.layer import Layer
from toolbox.data.record import CHUNK, checked
from toolbox.declare.fields import Field
from toolbox.declare.show import (
    Classes,
    Curve,
    Histogram,
    Matrix,
    Profile,
    Show,
    Values,
)
from toolbox.errors import DataError, nearest
from toolbox.pictures.charts import Bars, Curves, Sections
from toolbox.pictures.features import Coloured, Colouring
from toolbox.pictures.images import Bounds, Image, cloud_image, raster_image
from toolbox.pictures.maps import Drawn, Panel, arrange, in_proportion, say
from toolbox.pictures.matrix import Square

_DPI = 140
_MOST_BANDS = 6
_MARGIN = 0.12  # of a map of vectors, so that the scale bar hides none

Shown = tuple[Any, tuple[Show, ...]]
"""A layer, and how it is shown; by what it is if nothing is said."""


def draw(layers: Mapping[str, Any | Shown], path: str | Path, *, record: str = "") -> None:
    """Draw layers side by side into one PNG.

    A layer is shown as the sink says that has given it, see `toolbox.declare.show`. If nothing is
    said, a raster is shown as relief, as colours, or as classes where it holds few integers, named
    bands side by side; a cloud from above, the highest point on top, in the colours of its classes,
    its elevation or its intensity; a vector layer in one colour; and a table not at all. A vector
    layer lies over the map before it, if that is in the same CRS and overlaps it, and has a map of
    its own otherwise.

    Parameters
    ----------
    layers : by title, each alone or with how it is shown
    path : ends in .png
    record : how the picture was made, as JSON text (see `toolbox.runs.provenance`)

    Raises
    ------
    DataError
        There is nothing to draw, a layer is of another type, or the picture cannot be written.
    """
    if Path(path).suffix.lower() != ".png":
        raise DataError(f"{path}: pictures are written as .png")
    made = png(layers, record=record)
    try:
        Path(path).write_bytes(made)
    except OSError as error:
        raise DataError(f"{path} cannot be written: {error}") from error


def png(layers: Mapping[str, Any | Shown], *, record: str = "") -> bytes:
    """The bytes of the PNG that :func:`draw` writes.

    Raises
    ------
    DataError
        There is nothing to draw, or a layer is of another type.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    panels: list[Drawn] = []
    for title, value in layers.items():
        layer, shows = value if isinstance(value, tuple) else (value, ())
        _add(panels, title, layer, _usable(title, layer, shows) if shows else ())
    if not panels:
        raise DataError("nothing to draw: no layer has points, cells, features or bins")
    figure = Figure(facecolor="white")
    FigureCanvasAgg(figure)
    for panel, place in zip(panels, arrange(figure, panels), strict=True):
        panel.draw_on(figure, place)
    say(figure)
    texts = {"Software": None} | ({CHUNK: checked(record)} if record else {})
    made = io.BytesIO()
    figure.savefig(made, dpi=_DPI, metadata=texts, format="png")
    return made.getvalue()


def drawable(found: Mapping[str, Any], fields: Mapping[str, Field]) -> dict[str, Shown]:
    """The layers among the results of a run that a plot can show, by title.

    Parameters
    ----------
    found : what a tool gave, by name
    fields : its outputs, which say how they are shown
    """
    layers: dict[str, Shown] = {}
    for name, value in found.items():
        show = fields[name].show
        if isinstance(value, tuple):  # of a repeated step
            layers |= {f"{name} {i}": (item, show) for i, item in enumerate(value, 1)}
        else:
            layers[name] = value, show
    usable = {
        title: (layer, _usable(title, layer, show))
        for title, (layer, show) in layers.items()
        if isinstance(layer, Layer)
    }
    return {title: shown for title, shown in usable.items() if has_something_to_see(*shown)}


def has_something_to_see(layer: Layer, shows: Sequence[Show] = ()) -> bool:
    """Whether a plot can show a layer: it has cells, points or features, or makes a chart."""
    match layer:
        case Raster():
            return bool(np.isfinite(layer.band()).any())
        case PointCloud() | Vector():
            return len(layer) > 0
        case Table():
            return any(_chart("", layer, show) for show in shows)
        case _:
            return False


def _usable(title: str, layer: Layer, shows: Sequence[Show]) -> tuple[Show, ...]:
    """The ways to show a layer for which it has the columns; a warning names what others lack."""
    usable: list[Show] = []
    for show in shows if layer.size() else ():
        known = (*layer.axes, *layer.names)
        named = {n: [k for k in known if fnmatch.fnmatchcase(k, n)] for n in show.columns}
        missing = [name for name, found in named.items() if not found]
        texts = [
            found[0] for n in show.numbers if (found := named[n]) and _is_text(layer, found[0])
        ]
        if not missing and not texts:
            if isinstance(show, Values):
                usable.append(replace(show, attribute=named[show.attribute][0]))
            else:
                usable.append(show)
        elif texts or not show.optional:
            word = type(show).__name__.lower()
            why = f"{texts[0]!r} holds no numbers" if texts else _lacks(missing[0], known)
            log.warning("%s is not shown as %s: %s", title, word, why)
    return tuple(usable)


def _lacks(name: str, known: Sequence[str]) -> str:
    return f"it has no {name!r}{nearest(name, known)}"


def _is_text(layer: Layer, name: str) -> bool:
    """Whether a column holds anything but numbers."""
    if not isinstance(layer, Table | Vector):
        return False
    try:
        layer.frame[name].to_numpy(float)
    except (ValueError, TypeError):
        return True
    return False


def _add(panels: list[Drawn], title: str, layer: Any, shows: Sequence[Show]) -> None:
    """Append the maps and charts of a layer."""
    match layer:
        case Raster():
            panels += _of_bands(title, layer)
        case PointCloud():
            ways: Sequence[Show | None] = (shows or [None]) if len(layer) else []
            panels += [_of_image(title, layer.crs, cloud_image(layer, way)) for way in ways]
        case Vector():
            coloured = layer, next((s for s in shows if isinstance(s, Colouring)), None)
            _add_vector(panels, title, coloured, apart=is_apart(shows))
            made = [Sections.of(title, layer, s) for s in shows if isinstance(s, Profile)]
            panels += [chart for chart in made if chart]
        case Table():
            panels += [chart for show in shows if (chart := _chart(title, layer, show))]
        case _:
            raise DataError(f"{title}: a {type(layer).__name__} cannot be drawn")


def is_apart(shows: Sequence[Show]) -> bool:
    """Whether features are in coordinates of their own, and have a map of their own."""
    return any(isinstance(show, Classes) and show.apart for show in shows)


def _chart(title: str, table: Table, show: Show) -> Bars | Curves | Square | None:
    match show:
        case Histogram():
            return Bars.of(title, table, show)
        case Curve():
            return Curves.of(title, table, show)
        case Matrix():
            return Square.of(title, table, show)
        case _:
            return None


def _of_bands(title: str, raster: Raster) -> Iterator[Panel]:
    """A map of each named band; only of the first one where bands have no names."""
    names = raster.descriptions if all(raster.descriptions) else raster.descriptions[:1]
    for number, name in enumerate(names[:_MOST_BANDS], start=1):
        text = title if number == 1 else f"{title}: {name}"
        yield _of_image(text, raster.crs, raster_image(raster, number))


def _of_image(title: str, crs: CRS | None, image: Image) -> Panel:
    return Panel(title, crs, in_proportion(image.bounds), image, ())


def _add_vector(panels: list[Drawn], title: str, features: Coloured, *, apart: bool) -> None:
    """Add a vector layer to the last map if they overlap, or as a map; skip it without geometry."""
    layer = features[0]
    west, south, east, north = (float(value) for value in layer.frame.total_bounds)
    bounds = (west, south, east, north)
    if not np.isfinite(bounds).all():
        return
    last = panels[-1] if panels else None
    if (
        isinstance(last, Panel)
        and not (apart or last.apart)
        and (last.image is None or last.image.above)
        and _meet(last.bounds, bounds)
        and _same_ground(last, layer)
    ):
        panels[-1] = last.under(title, features)
    elif not panels or west < east or south < north:  # a single place alone is no map
        around = in_proportion(bounds, margin=_MARGIN)
        panels.append(Panel(title, layer.crs, around, None, (features,), apart))


def _meet(one: Bounds, other: Bounds) -> bool:
    across = one[0] < other[2] and one[2] > other[0]
    return across and one[1] < other[3] and one[3] > other[1]


def _same_ground(panel: Panel, layer: Vector) -> bool:
    return crs_conflict(panel.crs, layer.crs, heights=False) is None
