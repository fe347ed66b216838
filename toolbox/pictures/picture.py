"""Pictures of layers: one PNG with a map and its key for each.

Points are gathered into pixels before they are drawn, so a picture of a hundred million points
is as small as one of a thousand. The same layers give the same bytes.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from toolbox.data import PointCloud, Raster, Table, Vector
from toolbox.data.crs import crs_conflict
from toolbox.data.record import CHUNK, checked
from toolbox.errors import DataError
from toolbox.pictures.bars import Bars, Profile, show_bars, show_profile
from toolbox.pictures.curves import Curve, Sweep, show_curve, show_sweep
from toolbox.pictures.images import Bounds, Image, cloud_image, raster_image
from toolbox.pictures.maps import Panel, arrange, in_proportion, show

_DPI = 140
_MOST_BANDS = 6
_MARGIN = 0.12  # of a map of vectors, so that the scale bar hides none

Drawn = Panel | Bars | Profile | Curve | Sweep


def draw(
    layers: Mapping[str, PointCloud | Raster | Vector | Table],
    path: str | Path,
    *,
    record: str = "",
) -> None:
    """Draw layers side by side into one PNG.

    A raster is shown as relief, as colours, or as classes where it holds few integers, named bands
    side by side; a cloud from above, the highest point on top, in the colours of its "error", its
    planes (from the front if there is a wall), its classes, its elevation or its intensity. A
    vector layer lies over the map before it, if that is in the same CRS and overlaps it, and has a
    map of its own otherwise, in the colours of its `kind` or `offset`; points with line, chainage
    and offset have a profile too. A table of the columns low, high and count is a histogram, one of
    level, unit, area_m2 and volume_m3 a storage curve, one of tolerance, planes, share and knee the
    curve of these; other tables are left out.

    Parameters
    ----------
    layers : by title
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


def png(layers: Mapping[str, PointCloud | Raster | Vector | Table], *, record: str = "") -> bytes:
    """Draw layers as :func:`draw` does; the content of the file.

    Raises
    ------
    DataError
        There is nothing to draw, or a layer is of another type.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    panels = _panels(layers)
    if not panels:
        raise DataError("nothing to draw: no layer has points, cells, features or bins")
    figure = Figure(facecolor="white")
    FigureCanvasAgg(figure)
    for panel, place in zip(panels, arrange(figure, panels), strict=True):
        match panel:
            case Bars():
                show_bars(figure, panel, place)
            case Profile():
                show_profile(figure, panel, place)
            case Curve():
                show_curve(figure, panel, place)
            case Sweep():
                show_sweep(figure, panel, place)
            case Panel():
                show(figure, panel, place)
    texts = {"Software": None} | ({CHUNK: checked(record)} if record else {})
    made = io.BytesIO()
    figure.savefig(made, dpi=_DPI, metadata=texts, format="png")
    return made.getvalue()


def has_something_to_see(layer: object) -> bool:
    """Whether a picture can show a layer: one that has cells, points, features or bins."""
    if isinstance(layer, Table):
        return _of_table("", layer) is not None
    return isinstance(layer, Raster) or (isinstance(layer, PointCloud | Vector) and len(layer) > 0)


def drawable(found: Mapping[str, Any]) -> dict[str, Any]:
    """The layers among the results of a run that hold anything to see, by title."""
    layers: dict[str, Any] = {}
    for name, value in found.items():
        several = isinstance(value, tuple)  # of a repeated step
        layers |= (
            {f"{name} {i}": item for i, item in enumerate(value, 1)} if several else {name: value}
        )
    return {title: layer for title, layer in layers.items() if has_something_to_see(layer)}


def _panels(
    layers: Mapping[str, PointCloud | Raster | Vector | Table],
) -> list[Drawn]:
    panels: list[Drawn] = []
    for title, layer in layers.items():
        match layer:
            case Raster():
                panels += _of_bands(title, layer)
            case PointCloud():
                if len(layer):
                    panels.append(_of_image(title, layer.crs, cloud_image(layer)))
            case Vector():
                _add_vector(panels, title, layer)
                if profile := Profile.of(title, layer):
                    panels.append(profile)
            case Table():
                if diagram := _of_table(title, layer):
                    panels.append(diagram)
            case _:
                raise DataError(f"{title}: a {type(layer).__name__} cannot be drawn")
    return panels


def _of_bands(title: str, raster: Raster) -> Iterator[Panel]:
    """A map of each band with a name of its own; only of the first, where bands are colours."""
    names = raster.descriptions if all(raster.descriptions) else raster.descriptions[:1]
    for number, name in enumerate(names[:_MOST_BANDS], start=1):
        text = title if number == 1 else f"{title}: {name}"
        yield _of_image(text, raster.crs, raster_image(raster, number))


def _of_image(title: str, crs: CRS | None, image: Image) -> Panel:
    return Panel(title, crs, in_proportion(image.bounds), image, ())


def _of_table(title: str, table: Table) -> Bars | Curve | Sweep | None:
    return Bars.of(title, table) or Curve.of(title, table) or Sweep.of(title, table)


def _add_vector(panels: list[Drawn], title: str, layer: Vector) -> None:
    """Over the last map where it belongs there; nowhere if no feature has a geometry."""
    west, south, east, north = (float(value) for value in layer.frame.total_bounds)
    bounds = (west, south, east, north)
    if not np.isfinite(bounds).all():
        return
    last = panels[-1] if panels else None
    above = isinstance(last, Panel) and (last.image is None or last.image.above)
    if (
        isinstance(last, Panel)
        and above
        and _meet(last.bounds, bounds)
        and _same_ground(last, layer)
    ):
        panels[-1] = last.under(title, layer)
    else:
        panels.append(
            Panel(title, layer.crs, in_proportion(bounds, margin=_MARGIN), None, (layer,))
        )


def _meet(one: Bounds, other: Bounds) -> bool:
    across = one[0] < other[2] and one[2] > other[0]
    return across and one[1] < other[3] and one[3] > other[1]


def _same_ground(panel: Panel, layer: Vector) -> bool:
    return crs_conflict(panel.crs, layer.crs, heights=False) is None
