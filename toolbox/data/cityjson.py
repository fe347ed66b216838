"""Outlines of buildings as blocks in a city model: CityJSON, level of detail 1.2 or 1.3.

Each polygon is raised from the ground to the mean height of its roof: attributes `ground` and
`mean`, or else `eave`, `ridge`, or `height` above the ground. Corners are rounded to thousandths of
the unit.

Polygons that all have the attributes `id`, `building`, `points` and `cut` are parts of the building
of that name, as :mod:`algorithms.classify.buildings` finds them: level of detail 1.3. A building of
several has no block of its own, but one for each of its parts, and the attributes in which these
agree; it is `cut` by the edge of the data if any part is, and its height is their
`building_height`, or else that of the highest part. An attribute
`building` alone tells no parts: in OpenStreetMap it is `yes` or `house`.

References
----------
OGC 20-072r5 (2023). CityJSON Community Standard 2.0.
Biljecki, F., Ledoux, H. and Stoter, J. (2016). An improved LOD specification for 3D building
models. Computers, Environment and Urban Systems 59, 25-37: LoD1.2, blocks with one height; LoD1.3,
blocks of different heights in one building.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from toolbox.data.crs import metres_per_height
from toolbox.data.layer import day_of
from toolbox.errors import DataError

if TYPE_CHECKING:
    import geopandas
    from pyproj import CRS

SUFFIX = ".city.json"
GROUND, TOPS, HEIGHT = "ground", ("mean", "eave", "ridge"), "height"
ID, RIDGE, FORM = "id", "ridge", "form"
WHOLE = "building"  # of which a polygon is a part
WHOLE_HEIGHT = "building_height"
CUT = "cut"  # whether the edge of the data cuts it
PART = ("id", WHOLE, "points", CUT)  # what all polygons have if they are parts
_SCALE = 0.001
_APART = 0.01  # in the unit of the data: between a hole and the ring that it touches
_SURFACES = ({"type": "GroundSurface"}, {"type": "RoofSurface"}, {"type": "WallSurface"})
_FOOT, _ROOF, _WALL = range(3)


def write(
    frame: geopandas.GeoDataFrame, path: Path, head: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Write a city model with a building for each polygon.

    Parameters
    ----------
    head : title and date (YYYY-MM-DD) of the set that it belongs to, if they are known

    Raises
    ------
    DataError
        A feature is no polygon, or has no height of its ground and roof.
    """
    places = _Places(frame)
    metre = 1.0 if frame.crs is None else 1 / metres_per_height(frame.crs)
    are_parts = _are_parts(frame)
    lod, kind = ("1.3", "part") if are_parts else ("1.2", "building")
    objects: dict[str, Any] = {}
    names = [str(name) for name in frame.columns if name != frame.geometry.name]
    rows = frame[names].to_dict("records")
    for key, shape, values in zip(_keys(frame, kind), frame.geometry, rows, strict=True):
        low, high = heights_of(values, path)
        made = (places.solid(part, low, high) for part in _polygons(shape, path))
        solids = [solid for solid in made if solid]
        if solids:
            objects[key] = {
                "type": "Building",
                "attributes": _attributes(values, metre),
                "geometry": [_geometry(solids, lod)],
            }
    if are_parts:
        objects = _with_parents(objects, metre)
    model: dict[str, Any] = {"type": "CityJSON", "version": "2.0"}
    model["transform"] = {"scale": [_SCALE] * 3, "translate": places.origin.tolist()}
    model["metadata"] = _metadata(frame.crs, places, head)
    model |= {"CityObjects": objects, "vertices": places.vertices}
    path.write_text(json.dumps(model, ensure_ascii=False, default=_plain) + "\n", encoding="utf-8")


def _are_parts(frame: geopandas.GeoDataFrame) -> bool:
    """Whether the polygons are parts of buildings: all of them say of which."""
    return set(PART) <= set(frame.columns) and bool(frame[list(PART)].notna().all(axis=None))


def _keys(frame: geopandas.GeoDataFrame, kind: str) -> list[str]:
    """What the blocks are called: by their own ids if these tell them apart, else by number."""
    if ID in frame and frame[ID].notna().all() and frame[ID].astype(str).is_unique:
        return [f"{kind}-{name}" for name in frame[ID]]
    return [f"{kind}-{number}" for number in range(1, len(frame) + 1)]


def _with_parents(blocks: Mapping[str, Any], metre: float) -> dict[str, Any]:
    """Buildings before the blocks that are parts of them; one with a single block is that block."""
    of_whole: dict[str, list[str]] = {}
    for key, block in blocks.items():
        of_whole.setdefault(str(block["attributes"][WHOLE]), []).append(key)
    objects: dict[str, Any] = {}
    for name, keys in of_whole.items():
        whole = f"building-{name}"
        if len(keys) == 1:
            objects[whole] = blocks[keys[0]]
            continue
        said = [blocks[key]["attributes"] for key in keys]
        shared = {k: v for k, v in said[0].items() if all(k in one and one[k] == v for one in said)}
        shared[CUT] = any(one[CUT] for one in said)
        heights = [one["measuredHeight"] for one in said if "measuredHeight" in one]
        if WHOLE_HEIGHT in shared:
            shared["measuredHeight"] = round(float(shared[WHOLE_HEIGHT]) / metre, 3)
        elif heights:
            shared["measuredHeight"] = max(heights)
        objects[whole] = {"type": "Building", "attributes": shared, "children": keys}
        for key in keys:
            objects[key] = {**blocks[key], "type": "BuildingPart", "parents": [whole]}
    return objects


def heights_of(values: Mapping[str, Any], path: Path) -> tuple[float, float]:
    """Height of the ground and of the roof of a building."""
    ground = values.get(GROUND)
    if not _holds(ground):
        raise DataError(f"{path}: a building has no attribute ground, its height there")
    found = [float(values[name]) for name in TOPS if _holds(values.get(name))]
    if not found and _holds(values.get(HEIGHT)):
        found = [float(ground) + float(values[HEIGHT])]  # type: ignore[arg-type]
    if not found:
        raise DataError(f"{path}: a building has none of {', '.join(TOPS)} and {HEIGHT}")
    return float(ground), found[0]  # type: ignore[arg-type]


def _attributes(values: Mapping[str, Any], metre: float) -> dict[str, Any]:
    """What is known of a building, and its height and form under the names of the standard.

    `measuredHeight` is the height of the ridge above the ground in metres, `roofType` the form. The
    block ends at the mean height of the roof, and so is lower.
    """
    made = {name: value for name, value in values.items() if _holds(value)}
    ground, ridge = (made.get(name) for name in (GROUND, RIDGE))
    if ground is not None and ridge is not None and ridge > ground:
        made["measuredHeight"] = round(float(ridge - ground) / metre, 3)
    if FORM in made:
        made["roofType"] = made[FORM]
    return made


def _holds(value: Any) -> bool:
    return value is not None and not (isinstance(value, float) and not np.isfinite(value))


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else str(value)


def _polygons(shape: Any, path: Path) -> list[Any]:
    parts: list[Any] = shapely.get_parts(shape).tolist()
    if any(part.geom_type != "Polygon" for part in parts):
        raise DataError(f"{path}: buildings are polygons, got a {shape.geom_type}")
    return parts


def _geometry(solids: list[tuple[list[Any], list[int]]], lod: str) -> dict[str, Any]:
    """One solid, or several of one building."""
    semantics = {"surfaces": list(_SURFACES)}
    if len(solids) == 1:
        ((shell, values),) = solids
        whole = {"type": "Solid", "boundaries": [shell]}
        return {**whole, "lod": lod, "semantics": {**semantics, "values": [values]}}
    return {
        "type": "MultiSolid",
        "lod": lod,
        "boundaries": [[shell] for shell, _ in solids],
        "semantics": {**semantics, "values": [[values] for _, values in solids]},
    }


class _Places:
    """The vertices of a model, each once, as whole numbers of steps from an origin."""

    def __init__(self, frame: geopandas.GeoDataFrame) -> None:
        low = np.nan_to_num(frame.total_bounds[:2]) if len(frame) else np.zeros(2)
        self.origin = np.array([*np.floor(low), 0.0])
        self.vertices: list[list[int]] = []
        self._known: dict[tuple[int, int, int], int] = {}

    def _number(self, x: float, y: float, z: float) -> int:
        steps = np.rint((np.array([x, y, z]) - self.origin) / _SCALE).astype(int).tolist()
        key = (steps[0], steps[1], steps[2])
        if key not in self._known:
            self._known[key] = len(self.vertices)
            self.vertices.append(steps)
        return self._known[key]

    def solid(self, polygon: Any, low: float, high: float) -> tuple[list[Any], list[int]] | None:
        """The shell of a block and the kind of each of its surfaces; None if it is too small.

        The outer ring runs counterclockwise and holes clockwise, so all surfaces face outwards.
        """
        flat = shapely.orient_polygons(_without_touching_holes(shapely.force_2d(polygon)))
        if high - low < _SCALE or flat.is_empty:
            return None
        rings = [self._ring(ring, low, high) for ring in (flat.exterior, *flat.interiors)]
        if len(rings[0][0]) < 3:
            return None
        rings = [ring for ring in rings if len(ring[0]) >= 3]
        shell = [[feet[::-1] for feet, _ in rings], [heads for _, heads in rings]]
        kinds = [_FOOT, _ROOF]
        for feet, heads in rings:
            for k in range(len(feet)):
                n = (k + 1) % len(feet)
                shell.append([[feet[k], feet[n], heads[n], heads[k]]])
                kinds.append(_WALL)
        return shell, kinds

    def _ring(self, ring: Any, low: float, high: float) -> tuple[list[int], list[int]]:
        """The vertices of a ring at its foot and its head, no two of them at one place."""
        xy = shapely.get_coordinates(ring)[:-1]
        feet = [self._number(x, y, low) for x, y in xy]
        keep = [k for k in range(len(feet)) if feet[k] != feet[k - 1]]
        return [feet[k] for k in keep], [self._number(xy[k, 0], xy[k, 1], high) for k in keep]


def _without_touching_holes(polygon: Any) -> Any:
    """The polygon with holes that touch another ring drawn in a little.

    A block of it would have an edge at which four walls meet, which is no solid.
    """
    rings = [polygon.exterior, *polygon.interiors]
    holes = []
    for number, ring in enumerate(rings[1:], start=1):
        hole = shapely.Polygon(ring)
        others = [other for k, other in enumerate(rings) if k != number]
        if shapely.distance(ring, others).min() < 2 * _SCALE:
            hole = hole.buffer(-_APART, join_style="mitre")
        holes += [part.exterior for part in shapely.get_parts(hole).tolist() if not part.is_empty]
    return shapely.Polygon(polygon.exterior, holes)


def _metadata(crs: CRS | None, places: _Places, head: Mapping[str, str]) -> dict[str, Any]:
    """Title and day, CRS by its EPSG code, and extent."""
    made: dict[str, Any] = {"title": head["title"]} if head.get("title") else {}
    if day := day_of(head):
        made["referenceDate"] = day
    code = crs.to_epsg() if crs is not None else None
    if crs is not None and code is None and len(crs.sub_crs_list) == 2:
        code = crs.sub_crs_list[0].to_epsg()
    if code is not None:
        made["referenceSystem"] = f"https://www.opengis.net/def/crs/EPSG/0/{code}"
    if places.vertices:
        corners = np.array(places.vertices)
        low, high = (
            (c * _SCALE + places.origin).round(6).tolist()
            for c in (corners.min(axis=0), corners.max(axis=0))
        )
        made["geographicalExtent"] = [*low, *high]
    return made
