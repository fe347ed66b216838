"""The view in space of a report: thinned points, lines, marks and areas as JSON values."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox import language
from toolbox.data import Figure, PointCloud, Raster, Vector
from toolbox.data.crs import crs_conflict, is_local, short_height_unit
from toolbox.data.layer import Layer
from toolbox.data.report import Plot
from toolbox.declare.fields import Spec
from toolbox.declare.show import Classes, Planes, Show, Values
from toolbox.pictures.draw import drawable
from toolbox.pictures.images import OTHER, Ramp, point_key
from toolbox.pictures.oblique import direction_of
from toolbox.pictures.views import Item, view_png
from toolbox.reports import words
from toolbox.reports.shapes import FILLED, items_of

_MOST, _MOST_MARKED = 120_000, 20_000  # points of the scene, and of a layer above it
_STEPS = 32_000  # of a coordinate to both sides of the middle, as 16 bits have
_MOST_CLASSES = len(OTHER) + 1  # each has a colour of its own; points of none are one more
_COLOURS = ("#0b5fa5", "#d7261e", "#8e3fa8", "#e08a00", "#00806b", "#b0306a", "#5a6b00", "#6b4a2f")
_OTHERS = "#b9bec5"

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class _Scene:
    """The cloud that is seen, and where it lies."""

    name: str
    cloud: PointCloud
    show: Show | None
    origin: Floats

    @classmethod
    def of(cls, shown: Mapping[str, Any], given: Mapping[str, Any]) -> _Scene | None:
        """The largest cloud among the results or else the inputs, or the cells of a raster."""
        clouds = [(n, c, s) for n, (c, s) in shown.items() if isinstance(c, PointCloud) and len(c)]
        inputs = [(n, c, ()) for n, c in given.items() if isinstance(c, PointCloud) and len(c)]
        most = max((len(c) for _, c, _ in [*clouds, *inputs]), default=0)
        large = [entry for entry in [*clouds, *inputs] if len(entry[1]) >= 0.5 * most]
        if not large:
            rasters = [(n, c) for n, (c, _) in shown.items()] + list(given.items())
            large = [(n, _cells(c), ()) for n, c in rasters if isinstance(c, Raster)][:1]
        if not large or not len(large[0][1]):
            return None
        name, cloud, shows = large[0]
        low, high = np.reshape(cloud.bounds, (2, 3))
        return cls(name, cloud, shows[0] if shows else None, np.floor((low + high) / 2))


def space_of(spec: Spec, found: Mapping[str, Any], given: Mapping[str, Any]) -> Plot | None:
    """The view in space; None if there are no points and no raster of heights."""
    shown = drawable(found, spec.results)
    scene = _Scene.of(shown, given)
    if scene is None:
        return None
    titles = {name: words.titled(field) for name, field in {**spec.sources, **spec.results}.items()}
    title = titles[scene.name]
    items = list(_points(title, scene.cloud, scene.show, scene.origin, most=_MOST, size=1.6))
    for name, (layer, shows) in shown.items():
        if isinstance(layer, PointCloud) and len(layer) < 0.5 * len(scene.cloud):
            show = shows[0] if shows else None
            items += _points(titles[name], layer, show, scene.origin, most=_MOST_MARKED, size=3.5)
    colours = iter(_COLOURS * 4)
    for name, (layer, shows) in shown.items():
        if isinstance(layer, Vector) and _belongs(layer, scene.cloud):
            items += items_of(name, titles[name], layer, shows, scene.origin, colours)
    towards = direction_of(scene.cloud, _planes(scene.show))
    span = np.concatenate([item.xyz for item in items if item.kind == "points"])
    unit = short_height_unit(scene.cloud.crs)
    labels = ("x", "y", "z") if is_local_or_none(scene.cloud) else ("East", "North", "Up")
    data = {
        "origin": scene.origin.tolist(),
        "eye": _eye(towards, span),
        "axes": [f"{name} [{unit}]" if unit else name for name in labels],
        "clouds": [_cloud_json(item) for item in items if item.kind == "points"],
        "lines": [_line_json(item) for item in items if item.kind in ("lines", "marks")],
        "meshes": [_mesh_json(item) for item in items if item.kind == "areas"],
        "key": list(_key(items)),
    }
    found = dict.fromkeys(item.name.removesuffix(FILLED) for item in items)
    names = ", ".join(map(language.label, found))
    origin = ", ".join(f"{value:z.0f}" for value in scene.origin)
    shown_points = sum(len(item.xyz) for item in items if item.kind == "points")
    caption = f"View in space: {names}. {shown_points} points are shown; lengths from {origin}"
    return Plot("space", data, Figure(view_png(items, towards), caption))


def _key(items: Sequence[Item]) -> Iterator[dict[str, Any]]:
    """What the colours of the picture mean, each once; areas are seen by their outlines."""
    told = set()
    for item in items:
        ramp = item.ramp
        if item.kind == "areas" or (item.name, item.colour) in told:
            continue
        told.add((item.name, item.colour))
        if ramp is None:
            yield {"name": item.name, "colour": item.colour}
        else:
            low, high = ramp.ends
            yield {"ramp": _colours_of(ramp), "low": low, "high": high, "label": ramp.label}


def is_local_or_none(layer: Layer) -> bool:
    """Whether the axes of a layer do not point to the east and north."""
    return layer.crs is None or is_local(layer.crs)


def _cells(raster: Raster) -> PointCloud:
    """The cells of a raster as points, so many as are shown."""
    step = max(1, math.ceil(math.sqrt(raster.shape[0] * raster.shape[1] / _MOST)))
    band = raster.band(1)[::step, ::step]
    west, _, _, north = raster.bounds
    row, col = np.nonzero(np.isfinite(band))
    x, y = west + (col * step + 0.5) * raster.cell, north - (row * step + 0.5) * raster.cell
    return PointCloud(np.column_stack([x, y, band[row, col]]), crs=raster.crs)


def _belongs(layer: Vector, cloud: PointCloud) -> bool:
    """Whether features have heights, and lie where the points are."""
    if not len(layer) or not layer.frame.has_z.any():
        return False
    if crs_conflict(cloud.crs, layer.crs, heights=False) is not None:
        return False
    a, b = layer.bounds, cloud.bounds
    return bool(a[0] <= b[3] and a[2] >= b[0] and a[1] <= b[4] and a[3] >= b[1])


def _planes(show: Show | None) -> str:
    match show:
        case Planes():
            return show.attribute
        case Classes():
            return show.front_of
        case _:
            return ""


def _thinned(cloud: PointCloud, most: int) -> PointCloud:
    """So many points, drawn by chance that is the same each time; in their order."""
    if len(cloud) <= most:
        return cloud
    chosen = np.random.default_rng(0).choice(len(cloud), most, replace=False, shuffle=False)
    return cloud.select(np.sort(chosen))


def _points(
    title: str, cloud: PointCloud, show: Show | None, origin: Floats, *, most: int, size: float
) -> Iterator[Item]:
    """The points of a layer, an item for each class."""
    some = _thinned(cloud, most)
    xyz = some.xyz - origin
    values, key = point_key(some, show if not isinstance(show, Values) or len(some) else None)
    if isinstance(key, Ramp):
        share = np.nan_to_num(np.clip((values - key.low) / (key.high - key.low), 0, 1))
        yield Item("points", title, "", xyz, size=size, share=share, ramp=key)
        return
    largest = sorted(key, key=lambda code: -int(np.count_nonzero(values == code)))[:_MOST_CLASSES]
    for code, (text, colour) in key.items():
        if code in largest and (own := values == code).any():
            yield Item("points", text, colour, xyz[own], size=size)
    rest = ~np.isin(values, largest)
    if rest.any():
        yield Item("points", f"{title}: others", _OTHERS, xyz[rest], size=size)


def _eye(towards: Floats, span: Floats) -> dict[str, float]:
    """The place of the eye for plotly: in lengths of the scene's mean edge."""
    size = np.ptp(span, axis=0) + 1e-6
    mean = float(np.prod(size)) ** (1 / 3)
    far = 1.05 * float(np.hypot(size[0], size[1])) / mean + 0.4
    return dict(zip("xyz", np.round(towards * far, 3).tolist(), strict=True))


def _colours_of(ramp: Ramp) -> list[str]:
    """Colours of a ramp from its low to its high end."""
    from matplotlib.colors import to_hex

    colours = ramp.colour_map()
    return [to_hex(colours(share)) for share in np.linspace(0, 1, 9)]


def _cloud_json(item: Item) -> dict[str, Any]:
    made: dict[str, Any] = {"name": item.name, "size": item.size, "xyz": _steps(item.xyz)}
    if item.ramp is None:
        return made | {"colour": item.colour}
    ramp = _colours_of(item.ramp)
    codes = np.rint(item.share * 255).astype(np.uint8)
    return made | {"colour": ramp[4], "codes": _packed(codes), "ramp": ramp}


def _packed(values: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()


def _steps(xyz: Floats) -> dict[str, Any]:
    """Places as whole steps of 16 bits: a third of the size of their decimals.

    The steps are of these places alone, so that a line that goes far leaves the points sharp.
    """
    step = max(float(np.abs(xyz).max(initial=0.0)) / _STEPS, 0.001)
    return {"step": step, "packed": _packed(np.rint(xyz / step).astype("<i2"))}


def _line_json(item: Item) -> dict[str, Any]:
    return {
        "name": item.name,
        "colour": item.colour,
        "marks": item.kind == "marks",
        "xyz": _steps(np.concatenate(item.parts)),
        "sizes": [len(part) for part in item.parts],
        "table": item.table,
        "rows": list(item.rows),
    }


def _mesh_json(item: Item) -> dict[str, Any]:
    """The areas, three places for each triangle."""
    return {
        "name": item.name,
        "colour": item.colour,
        "opacity": 0.45,
        "xyz": _steps(item.xyz[item.triangles.ravel()]),
    }
