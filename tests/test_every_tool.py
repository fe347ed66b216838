"""Laws that every tool keeps. A new tool is covered the moment it is declared."""

from __future__ import annotations

import functools
import itertools
import json
import math
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import geopandas
import numpy as np
import pandas
import pytest
import shapely
from affine import Affine
from jsonschema import Draft202012Validator
from numpy.typing import NDArray
from process_schema import PROCESS
from pyproj import CRS
from scenes.waves import scanned

from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._extraction.layers import wire_layer
from algorithms.corridor._extraction.spans import Wire
from toolbox import catalog, reference
from toolbox.context import Context
from toolbox.data import Drawing, Lattice, PointCloud, Raster, Report, Survey, Table, Vector
from toolbox.data.crs import local_like, vertical_unit
from toolbox.declare import outputs, sink, source, tool
from toolbox.declare.fields import Field, Spec
from toolbox.declare.kinds import KINDS
from toolbox.declare.spec import HELP, LONGEST, REGISTRY, TITLE
from toolbox.errors import Cancelled, DataError, ParameterError
from toolbox.labels import LONGEST_TITLE
from toolbox.models.model import Model


def cloud_name(spec: Spec) -> str | None:
    """The source that the laws about points speak of: the first cloud."""
    clouds = (name for name, f in spec.sources.items() if f.kind.word == "PointCloud")
    return next(clouds, None)


TOOLS = [catalog.load(id) for id in catalog.own_ids()]
MODELS = [spec for spec in TOOLS if isinstance(spec, Model)]
NUMBERS = [(s, f) for s in TOOLS for f in s.inputs.values() if f.kind.word in ("number", "integer")]
LIMITED = [(s, f) for s, f in NUMBERS if f.limits]
POINT_TOOLS = [s for s in TOOLS if cloud_name(s)]
FAST: dict[str, dict[str, Any]] = {  # settings that make a tool quick
    "classify.train": {
        "trees": 2,
        "per_class": 100,
        "folds": 2,
        "features": ["intensity", "planarity@2", "height_range@2"],
    },
    "samples.scene": {"size": 50.0, "density": 2.0},
    "surface.cross_validation": {"folds": 3},
    # settings that must be given
    "points.assign_crs": {"crs": CRS(32635), "replace": True},
    "points.reproject": {"crs": CRS(4326), "missing_grid": "next_best"},
    "surface.reproject": {"crs": CRS(4326)},
    "vectors.reproject": {"crs": CRS(4326)},
}
OF_CRS = {"points.assign_crs", "points.reproject"}
"""Tools that change the CRS, and with it what feet are."""
REFERENCE: dict[str, dict[str, Any]] = {  # settings that a tool needs
    "compare.classes": {"reference_attribute": "truth"},
    "compare.planes": {"attribute": "classification", "reference_attribute": "truth"},
    "models.facade": {"plane": 1},
    "planes.openings": {"attribute": "classification", "plane": 2},
    "surface.flatten_water": {"level": 20.0},
}
WEST, TILE = 500_002.0, 300.0  # metres, three tiles in the strip; no cell begins where they do
IN_STRIP: dict[str, dict[str, Any]] = {  # settings that suit the strip
    "features.local": {"neighbours": None, "radius": 3.0},
    "classify.vegetation_by_returns": {"difference": 0.1, "spread": 9.0, "building_classes": None},
    "ground.csf": {"cloth_resolution": 1.0},
    "points.denoise": {"reach": 5.0},
    "points.denoise_voxels": {"cell": 7.0, "most": 300},
    "points.reproject": {"crs": CRS(25835)},
    "points.thin": {"method": "random", "cell": 7.0},
    "models.terrain": {"denoise": False, "max_gap": 6.0},
}
GRIDS: list[dict[str, Any]] = [
    {"method": "nearest", "max_gap": 6.0},
    {"method": "linear", "max_gap": 6.0},
    {"method": "natural", "max_gap": 6.0},
    {"method": "idw", "radius": 6.0},
    {"method": "mean", "cell": 7.0},
    {"method": "percentile", "cell": 7.0, "support": True},
    {"method": "linear", "max_gap": 6.0, "support": True},
    {"method": "idw", "radius": 6.0, "max_gap": 4.0, "uncertainty": True},
]
TILED = [
    *((spec, IN_STRIP.get(spec.id, {})) for spec in POINT_TOOLS),
    (catalog.load("ground.csf"), {"cloth_resolution": 1.0, "rigidness": 3}),
    (catalog.load("features.local"), {"neighbours": 200, "radius": 6.0}),
    (catalog.load("points.height_above_ground"), {"method": "nearest", "max_distance": 6.0}),
    *((catalog.load("surface.grid"), settings) for settings in GRIDS),
    (
        catalog.load("compare.classes"),
        {"max_distance": 6.0, "positive": "1,2,3", "reference": "sparse"},
    ),
]
DIFFER = {  # parameters that are declared in several ways, and why
    "alpha": "roofs are of a size; the gaps of other points are not known beforehand",
    "attribute": "each tool reads another attribute",
    "block": "blocks are drawn for intervals, or left out to be predicted",
    "classes": "trees are of high vegetation, other tools read all points",
    "context": "a map is applied with the radius that it learnt with, others follow the density",
    "cell": "edges of roofs and points of a scan ask for finer cells than terrain",
    "crs": "one is stated, the other is that of the result",
    "keep_classes": "bridges of class 26 would stand in terrains; the crest of a dam is ground",
    "features": "a map learns from few features, features.local gives many",
    "folds": "of single points, and of blocks of ground",
    "ground_classes": "corridor.extract finds the ground unless it is told",
    "keep": "points are inside or outside, features are cut",
    "height_error": "a model knows how well heights of surveys are known, a curve only its level",
    "highest": "a curve ends at the rim of its lake, or at the highest ground without one",
    "iterations": "each method goes round in its own way",
    "labels": "a map takes labels if there are any, training needs them",
    "max_distance": "how far is far depends on what is compared",
    "max_gap": "the terrain of a model closes gaps below houses, a grid all of them",
    "max_trials": "many planes take more draws than one",
    "method": "each tool has methods of its own",
    "min_area": "polygons that are compared count whatever their size, ponds do not",
    "min_height": "plants, roofs and conductors begin at different heights",
    "min_points": "objects, planes and openings are of different sizes",
    "neighbours": "a cell takes fewer points than a feature, which may take all in a radius",
    "nir": "a band of an image, or an attribute of points",
    "preset": "of how to find water, and of scenes",
    "radius": "of a plane, a neighbourhood and what is near a cell",
    "red": "a band of an image, or an attribute of points",
    "reference_attribute": "each tool reads another attribute",
    "returns": "filters look for ground among last returns, other tools take all",
    "smoothing": "of a line, and of a surface",
    "threshold": "of an index of vegetation, and of distances",
}
AMPLE = {
    "classify.apply",
    "classify.buildings",
    "classify.som_apply",
    "classify.urban",
    "classify.vegetation_by_returns",
    "ground.robust_interpolation",  # a bound for chains of outliers, which the strip has not
}
"""Tools for which half the halo may do here, though not everywhere."""
BUILT = {"classify.buildings"}
"""Tools that are tried on a strip with a house across the edge of a tile."""
IN_LISTS = {"classify.water"}
"""Tools whose halo is for lists of first and last returns, which the strip is not."""
ALIGNED = {"corridor.candidates"}
"""Tools whose cells begin where the tiles do; its own tests have others."""
NUMBER = "point_number"  # tells the order of points

SLACK = {  # of numbers that are not whole; classes have none
    "classify.som_apply": 0.002,  # distance from a neuron: ground.classify tells heights
    "ground.csf": 0.01,  # metres of height: a cloth at rest may still creep
    "ground.classify": 0.001,  # metres and confidence: heights are single precision
    "models.terrain": 0.001,  # runs it
}

CORNERS = [(500_010, 4_600_001, 20), (500_700, 4_600_020, 21), (500_020, 4_600_030, 22)]
OF_SHAPE = {
    "point": shapely.Point(CORNERS[0]),
    "line": shapely.LineString(CORNERS),
    "polygon": shapely.Polygon(CORNERS),
}
SHAPED = [(spec, name) for spec in TOOLS for name, f in spec.sources.items() if f.shapes]

tiled = pytest.mark.parametrize(
    ("spec", "settings"), TILED, ids=lambda v: v.id if isinstance(v, Spec) else "-".join(v)
)
tools = pytest.mark.parametrize("spec", TOOLS, ids=lambda s: s.id)
SHARES = {"classify.urban"}  # the class that withheld points keep counts in its share
IGNORING = [s for s in POINT_TOOLS if "ignore" in s.inputs and s.id not in SHARES]
MEASURING = [
    spec
    for spec in POINT_TOOLS
    if spec.id.partition(".")[0] in ("surface", "compare")
    or spec.id in ("classify.trees", "points.profile", "points.survey_quality")
    or spec.id in ("shoreline.alpha_shape", "shoreline.storage_curve")
]
"""Tools that make surfaces and figures of points, to which withheld ones are deleted."""
point_tools = pytest.mark.parametrize("spec", POINT_TOOLS, ids=lambda s: s.id)
DRY = {"models.reservoir_storage"}
"""Tools that end with an error without a lake, as the block is; their own tests have one."""
runs, point_runs = (
    pytest.mark.parametrize("spec", [s for s in some if s.id not in DRY], ids=lambda s: s.id)
    for some in (TOOLS, POINT_TOOLS)
)


def name_of(value: Any) -> str:
    return str(getattr(value, "id", getattr(value, "name", value)))


@pytest.fixture(scope="module")
def block() -> PointCloud:
    """500 x 40 m of rough slope with two roofs and all the attributes that tools ask for."""
    rng = np.random.default_rng(1)
    n = 10_000
    x, y = rng.uniform(0, 500, n), rng.uniform(0, 40, n)
    z = 0.1 * x + rng.normal(0, 0.05, n)
    for east, half in [(50, 8), (154, 10)]:  # one across the edge of a tile
        z[(abs(x - east) < half) & (abs(y - 20) < half)] += 8
    xyz = np.column_stack([x + 500_000.3, y + 4_600_000.4, z])
    attributes = columns(rng, n) | {"gps_time": in_pairs(x)}
    return PointCloud(xyz, attributes, crs=CRS(32635), name="block.laz")


@pytest.fixture(scope="module")
def strip() -> PointCloud:
    """900 x 24 m of rough terrain with trees, a terrace, a block and ponds across edges of tiles.

    It steepens eastwards, so that slopes averaged over too little data differ. The block is so
    high that a stiff cloth spans it, if the halo sees its other side. The terrace becomes ground
    from the first seed cell without anything lower in it, which the yard moves far inside.
    """
    rng = np.random.default_rng(1)
    n = 44_000
    x, y = rng.uniform(0, 3 * TILE, n), rng.uniform(0, 24, n)
    z = x**2 / 9000 + 0.5 * np.sin(x / 9) + rng.normal(0, 0.05, n)
    yard = (abs(x - 348) < 4) & (y > 8)
    terrace, block = (abs(x - 385) < 95) & ~yard, abs(x - 575) < 29
    z += 8 * terrace + 40 * block
    for east, north in rng.uniform(0, (3 * TILE, 24), (120, 2)):
        tree = (np.hypot(x - east, y - north) < 2) & ~terrace & ~block
        z[tree] += rng.uniform(0, 10, tree.sum())
    water = (abs(x - 301) < 9) | (abs(x - 601.5) < 5.5)
    xyz = np.vstack([np.column_stack([x, y, z])[~water | (y < 6)], birds()])
    attributes = columns(rng, len(xyz))
    attributes["classification"][-len(birds()) :] = 1
    attributes["gps_time"] = in_pairs(xyz[:, 0])
    xyz += np.array([WEST, 4_600_000, 0])
    return PointCloud(xyz, attributes, crs=CRS(32635), name="strip.laz")


def with_house(strip: PointCloud) -> PointCloud:
    """The strip with a meadow around the first edge of tiles, and a house across it.

    Half a metre of it lies in the first tile, which is less than the smallest building. Classes
    are drawn at random, and what they call ground is: so the meadow is ground, and the house not.
    """
    rng = np.random.default_rng(2)
    n = 8000
    x, y = rng.uniform(TILE - 40, TILE + 40, n), rng.uniform(0, 24, n)
    z = x**2 / 9000 + rng.normal(0, 0.03, n)
    house = (abs(x - TILE - 8.5) < 9) & (abs(y - 12) < 7)
    z[house] = 18 - 0.5 * abs(y[house] - 12) + rng.normal(0, 0.03, house.sum())
    attributes = columns(rng, n) | {"gps_time": in_pairs(x)}
    attributes["classification"] = np.where(house, 1, 2).astype(np.uint8)
    rest = strip.select(abs(strip["x"] - WEST - TILE) > 40)
    xyz = np.vstack([rest.xyz, np.column_stack([x + WEST, y + 4_600_000, z])])
    both = {name: np.concatenate([rest[name], attributes[name]]) for name in attributes}
    return PointCloud(xyz, both, crs=strip.crs, name=strip.name)


def birds() -> NDArray[np.float64]:
    """One over a pond, and six that are its only neighbours; eight over another pond.

    The six are too high above the shore, which is in the next cell to theirs, but not to that of
    the one. Without the shore they would be no noise, and hence neither would the one be.
    """
    one, eight = [[298.2, 17, 160]], [[596 + i, 14, 120] for i in range(8)]
    six = [[303.1, 17 + i / 50, 160] for i in range(6)]
    return np.array([*one, *six, *eight], float)


def in_pairs(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """GPS times that two points share which are neighbours in x."""
    return np.asarray(np.argsort(np.argsort(x)) // 2, float)


def columns(rng: np.random.Generator, n: int) -> dict[str, Any]:
    """Random attributes."""
    returns = rng.integers(1, 3, n).astype(np.uint8)
    return {
        "intensity": rng.integers(0, 500, n).astype(np.uint16),
        "return_number": np.minimum(returns, rng.integers(1, 3, n)).astype(np.uint8),
        "number_of_returns": returns,
        "classification": rng.integers(1, 7, n).astype(np.uint8),
        "truth": rng.integers(1, 7, n).astype(np.uint8),
    }


def job(
    spec: Spec, points: PointCloud | None = None, reference: PointCloud | None = None, **more: Any
) -> Any:
    """The tool with its defaults on the given points."""
    source = layers(spec, points) | ({"reference": reference} if reference else {})
    settings, problems = spec.parse(
        FAST.get(spec.id, {}) | REFERENCE.get(spec.id, {}) | more, present=source
    )
    assert not problems
    return spec.make(**settings, **source)


def layers(spec: Spec, points: PointCloud | None = None) -> dict[str, Any]:
    """Every layer that the tool requires, made from its declaration, in the unit of the points.

    The first cloud among them is the points themselves. Layers in SPECIAL are given even if they
    are not required.
    """
    points = PointCloud(np.zeros((0, 3)), crs=CRS(32635)) if points is None else points
    first, special = cloud_name(spec), SPECIAL.get(spec.id, {})
    made: dict[str, Any] = {}
    for name, field in spec.sources.items():
        if name in special:
            layer = special[name](points)
        elif name == first:
            layer = points
        elif field.required:
            layer = MADE[field.kind.word](points)
        else:
            continue
        made[name] = (layer,) if field.many else layer
    return made


def mirrored(points: PointCloud) -> PointCloud:
    """Another cloud of the same eastings: its points in a tile come from points in that tile."""
    return points.with_xyz(points.xyz * (1, -1, 1) + np.array([0, 9_200_040 * points.metre, 0]))


def slope(points: PointCloud) -> Raster:
    """Below all points."""
    lattice = Lattice.cover(edges(points), 10 * points.metre)
    height = 0.1 * (lattice.centres()[0] - 500_000.3 * points.metre)
    return Raster.from_lattice(np.tile(height, (lattice.rows, 1)), lattice, crs=points.crs)


def waters(points: PointCloud) -> Vector:
    """The shapes as water at a height that the slope has in them."""
    made = shapes(points)
    return Vector(made.frame.assign(level=20.0 * points.metre), name=made.name)


def shapes(points: PointCloud) -> Vector:
    """Two polygons among the points that overlap."""
    triangle = np.array([[500_010, 4_600_001], [500_700, 4_600_020], [500_020, 4_600_030]])
    square = np.array(shapely.box(500_100, 4_600_010, 500_120, 4_600_030).exterior.coords)
    polygons = [shapely.Polygon(corners * points.metre) for corners in (triangle, square)]
    return Vector(geopandas.GeoDataFrame(geometry=polygons, crs=points.crs), name="shapes.gpkg")


def in_a_file(points: PointCloud) -> Survey:
    """The points as a survey of one file."""
    folder = Path(tempfile.mkdtemp())
    points.save(folder / "a.laz")
    return Survey.open(folder)


MADE: dict[str, Callable[[PointCloud], Any]] = {  # a layer of each kind
    "PointCloud": mirrored,
    "Raster": slope,
    "Survey": in_a_file,
    "Vector": shapes,
    "Table": lambda points: Table(pandas.DataFrame({"name": ["a", "b"], "value": [1.0, 2.0]})),
}


def with_heights(points: PointCloud) -> PointCloud:
    """The points with their heights above a slope."""
    slope = 0.1 * (points.xyz[:, 0] - 500_000.3 * points.metre)
    heights = {"HeightAboveGround": (points.xyz[:, 2] - slope).astype(np.float32)}
    unit = f"above ground, {vertical_unit(points.crs)}"
    return points.with_attributes(heights, descriptions=dict.fromkeys(heights, unit))


def with_waveforms(points: PointCloud) -> PointCloud:
    """The points with a waveform each, where there are any points."""
    return scanned(points, Path(tempfile.mkdtemp()) / "a.las") if len(points) else points


def extracted_line(points: PointCloud) -> PointCloud:
    """Some of the points with the numbers of a wire."""
    on_line = np.flatnonzero(points["intensity"] > 400)
    ids = {name: np.ones(len(on_line), np.uint32) for name in ("wire_id", "span_id", "tower_id")}
    sure = np.full(len(on_line), 0.5, np.float32)
    return points.select(on_line).with_attributes({**ids, "confidence": sure, NUMBER: on_line})


def axis(points: PointCloud) -> Vector:
    """A bent line among the points."""
    line = np.array([[500_010, 4_600_010], [500_200, 4_600_015], [500_400, 4_600_012]])
    shapes = [shapely.LineString(line * points.metre)]
    return Vector(geopandas.GeoDataFrame(geometry=shapes, crs=points.crs), name="axis.gpkg")


def greenness(points: PointCloud) -> Raster:
    """An NDVI that changes eastwards."""
    lattice = Lattice.cover(edges(points), 7 * points.metre)
    ndvi = np.sin(np.arange(lattice.cols)) * np.ones((lattice.rows, 1))
    return Raster.from_lattice(ndvi, lattice, crs=points.crs)


def elevation(points: PointCloud) -> Vector:
    """A front that looks south along the middle of the points, with one opening."""
    m = points.metre
    ids = {"kind": ["facade", "window"], "front_id": [1, 1], "opening_id": [0, 1]}
    sizes = {"width": [None, 2 * m], "height": [None, 2 * m], "sill": [None, 1 * m]}
    place = np.array([[500_000, 4_600_020, 0], [1, 0, 0], [0, 0, 1]], float)
    place[0] *= m
    names = [f"{name}_{axis}" for name in ("corner", "right", "up") for axis in "xyz"]
    where = {name: [value, None] for name, value in zip(names, place.ravel(), strict=True)}
    boxes = [shapely.box(0, 0, 40 * m, 9 * m), shapely.box(3 * m, m, 5 * m, 3 * m)]
    frame = geopandas.GeoDataFrame(ids | sizes | where, geometry=boxes, crs=local_like(points.crs))
    return Vector(frame, name="elevation")


def two_bands(points: PointCloud) -> Raster:
    """An image in near infrared and red."""
    values = np.stack([np.eye(4), 2 + np.eye(4)])
    corner = Affine(1, 0, 0, 0, -1, 4)
    return Raster(values, corner, crs=points.crs, descriptions=("NIR", "red"))


def classes_of_cells(points: PointCloud) -> Raster:
    """A map of three classes in strips."""
    lattice = Lattice.cover(edges(points), 10 * points.metre)
    codes = np.tile(np.arange(lattice.cols) % 3, (lattice.rows, 1)).astype(np.uint8)
    return Raster.from_lattice(codes, lattice, crs=points.crs)


def edges(points: PointCloud) -> NDArray[np.float64]:
    """Bounds around the block and the strip, in the unit of the points."""
    return np.array([499_900, 4_599_900, 501_000, 4_600_100]) * points.metre


def wire(points: PointCloud) -> Vector:
    """One wire along the block, above its ground and through its roofs."""
    curve = Catenary(500_000.3, 4_600_020.4, 1.0, 0.0, 480.0, 20.0, 64.0, 1 / 3000.0)
    found = Wire(curve, (-1, -1), (0.0, curve.length), 0.25, 1, 1, 1)
    return wire_layer([found], np.zeros(3), points.metre, points.crs)


@functools.cache
def trained() -> Table:
    """A self-organising map of level ground, trees and a roof, with all features."""
    rng = np.random.default_rng(3)
    n = 6000
    xyz = rng.uniform((0, 0, 0), (60, 60, 0.05), (n, 3))
    xyz[: n // 3, 2] = rng.uniform(2, 12, n // 3)
    xyz[n // 3 : n // 2] = rng.uniform((20, 20, 6), (40, 40, 6.05), (n // 2 - n // 3, 3))
    cloud = PointCloud(xyz, columns(rng, n), crs=CRS(32635))
    features = ("height_above_ground", "ground", "planarity", "roughness", "returns", "intensity")
    made: Table = catalog.load("classify.som").make(points=cloud, features=features).run().map
    return made


@functools.cache
def learnt() -> Table:
    """A model of ground, trees and a roof, of points as dense as the strip."""
    rng = np.random.default_rng(3)
    n = 6000
    xyz = rng.uniform((0, 0, 0), (60, 60, 0.05), (n, 3))
    codes = np.full(n, 2, np.uint8)
    xyz[: n // 3, 2], codes[: n // 3] = rng.uniform(2, 12, n // 3), 5
    roof = slice(n // 3, n // 2)
    xyz[roof] = rng.uniform((20, 20, 6), (40, 40, 6.05), (n // 2 - n // 3, 3))
    codes[roof] = 6
    attributes = columns(rng, n) | {"classification": codes}
    cloud = PointCloud(xyz, attributes, crs=CRS(32635))
    settings = {"features": ("height_above_ground", "planarity@2", "height_range@2", "intensity")}
    made = catalog.load("classify.train").make(points=cloud, trees=5, per_class=200, **settings)
    return cast(Table, made.run().model)


SPECIAL: dict[str, dict[str, Callable[[PointCloud], Any]]] = {  # layers that need certain content
    "classify.apply": {"model": lambda points: learnt()},  # reads what classify.train gives
    "classify.ndvi": {"image": two_bands},  # finds the bands by their names
    "classify.som_apply": {"map": lambda points: trained()},  # reads the columns of classify.som
    "classify.vegetation_by_ndvi": {"image": greenness},  # unless the points have a colour
    "classify.water": {"water": waters},  # reads levels
    "compare.rasters": {"classes": classes_of_cells, "reference": classes_of_cells},
    "compare.spans": {"wires": wire, "reference": wire},  # reads the columns of corridor.extract
    "corridor.candidates": {"points": with_heights},  # asks for heights above ground
    "corridor.clearance": {"wires": wire},  # reads the columns of corridor.extract
    "corridor.surroundings": {"wires": wire},  # takes lines alone
    "corridor.label": {"line": extracted_line},  # its points are among those of the cloud
    "planes.drawing": {"elevation": elevation},  # reads what planes.openings gives
    "planes.orthophoto": {"elevation": elevation},  # reads what planes.openings gives
    "points.clip": {"polygons": shapes},  # asks for these or an extent
    "points.profile": {"line": axis},  # takes lines alone
    "points.sample_raster": {"raster": greenness},  # values that are no heights
    "points.waveform": {"points": with_waveforms},  # reads packets
    "vectors.clip": {"polygons": shapes},  # asks for these or an extent
}


def values(layer: Any) -> Any:
    """What two equal results have in common, as plain arrays."""
    if isinstance(layer, PointCloud):
        return {"xyz": layer.xyz} | {name: layer[name] for name in layer.names}
    if isinstance(layer, Report):
        return layer.html()
    if isinstance(layer, Drawing):
        return np.concatenate([np.sort(found, axis=None) for _, found in layer.contents()])
    if isinstance(layer, Survey):
        return np.array([(file.count, *file.bounds) for file in layer.files])
    if hasattr(layer, "frame"):
        return layer.frame.to_dict()
    return getattr(layer, "values", layer)


def contents(result: Any) -> dict[str, Any]:
    return {name: values(layer) for name, layer in vars(result).items()}


def beyond(field: Field) -> Iterator[float]:
    """Values just outside the declared limits."""
    step = 1 if field.kind.word == "integer" else 1e-9
    for key, limit in field.limits.items():
        yield {"gt": limit, "lt": limit, "ge": limit - step, "le": limit + step}[key]


@pytest.mark.parametrize(("spec", "field"), LIMITED, ids=name_of)
def test_limits_are_enforced_by_name(spec: Spec, field: Field, block: PointCloud) -> None:
    kind = int if field.kind.word == "integer" else float
    for value in beyond(field):
        with pytest.raises(ParameterError, match=rf"{field.name}: must be"):
            spec.build(FAST.get(spec.id, {}) | layers(spec, block) | {field.name: kind(value)})


@pytest.mark.parametrize(("spec", "name"), SHAPED, ids=name_of)
def test_features_of_another_shape_are_refused_by_name(
    spec: Spec, name: str, block: PointCloud
) -> None:
    """Dialogs do not offer them, but files can be given in other ways."""
    for shape in set(OF_SHAPE) - set(spec.sources[name].shapes):
        columns = {"level": [20.0], "class": [2], "geometry": [OF_SHAPE[shape]]}
        wrong = Vector(geopandas.GeoDataFrame(columns, crs=block.crs), name="wrong.gpkg")
        given = layers(spec, block) | {name: wrong}
        settings, _ = spec.parse(FAST.get(spec.id, {}) | REFERENCE.get(spec.id, {}), present=given)
        with pytest.raises((DataError, ParameterError), match=rf"\b{name}: "):
            spec.make(**settings, **given).run()


def test_parameters_of_one_name_are_one() -> None:
    """One unit, one help and one default, or a reason why not."""
    declared: dict[str, set[tuple[Any, ...]]] = {}
    for spec in TOOLS:
        for name, field in spec.inputs.items():
            if field.role == "param":
                meaning = (field.unit, field.help, repr(field.default))
                declared.setdefault(name, set()).add(meaning)
    several = {name: sorted(map(str, ways)) for name, ways in declared.items() if len(ways) > 1}
    assert {n: w for n, w in several.items() if n not in DIFFER} == {}
    assert DIFFER.keys() - several.keys() == set(), "these need no reason any more"


def test_titles_tags_and_groups_are_stated() -> None:
    """People find a tool by these, in the list and in the toolbox of QGIS."""
    titles = [spec.title for spec in TOOLS]
    assert len(set(titles)) == len(titles), "two tools would look the same"
    for spec in TOOLS:
        assert len(spec.title) <= LONGEST_TITLE, spec.id
        assert spec.tags, f"{spec.id}: @tool needs tags, words by which people search for it"
        assert all(re.fullmatch("[a-z0-9-]+", tag) for tag in spec.tags), (spec.id, spec.tags)
        assert len(set(spec.tags)) == len(spec.tags), spec.id
        assert spec.heading or spec in MODELS, f"{spec.id}: the docstring of its package"


@pytest.mark.parametrize("spec", MODELS, ids=name_of)
def test_models_are_described_as_tools_are(spec: Spec) -> None:
    """What @tool asks of classes; models of users may be as they like."""
    assert TITLE.fullmatch(spec.title)
    assert TITLE.fullmatch(spec.summary)
    assert spec.help.endswith(".")
    assert max(map(len, spec.help.splitlines())) <= LONGEST
    for field in [*spec.inputs.values(), *spec.outputs.values()]:
        assert HELP.fullmatch(field.help), f"{field.name}: {field.help}"
        assert len(field.help) <= LONGEST, field.name
        assert field.role != "param" or field.unit or field.kind.word not in ("number", "integer")


@tools
def test_defaults_are_accepted(spec: Spec, block: PointCloud) -> None:
    for field in spec.inputs.values():
        if field.role == "param" and not field.required:
            assert field.problem(field.default) is None, field.name
            texts = [None if item is None else str(item) for item in field.items(field.default)]
            several = field.many and field.default is not None
            assert field.parse(texts if several else texts[0]) == field.default, field.name
    job(spec, block)


@tools
def test_reach_and_rules_need_no_layers(spec: Spec) -> None:
    """Models and the tile engine ask before there is any data."""
    settings = FAST.get(spec.id, {})
    assert spec.rules(settings) == {}
    if spec.sources:
        assert spec.halo(settings) >= 0


@runs
def test_same_input_same_answer_and_input_untouched(spec: Spec, block: PointCloud) -> None:
    before = {name: array.copy() for name, array in values(block).items()}
    first, second = (contents(job(spec, block).run()) for _ in range(2))
    np.testing.assert_equal(first, second)
    np.testing.assert_equal(before, values(block))


@runs
def test_progress_rises_and_cancel_stops(spec: Spec, block: PointCloud) -> None:
    seen: list[float] = []
    job(spec, block).run(Context(seen.append))
    assert seen, "call ctx.progress(), or nobody can cancel the tool"
    assert seen == sorted(seen)
    assert all(0 <= f <= 1 for f in seen)
    with pytest.raises(Cancelled):
        job(spec, block).run(Context(stop=lambda: True))


@point_runs
def test_order_of_points_does_not_matter(spec: Spec, block: PointCloud) -> None:
    order = np.random.default_rng(2).permutation(len(block))
    straight = contents(job(spec, block).run())
    shuffled = contents(job(spec, block.select(order)).run())
    for name, found in straight.items():
        if not isinstance(found, dict) or "xyz" not in found:
            np.testing.assert_allclose(_numbers(found), _numbers(shuffled[name]), rtol=1e-9)
            continue
        np.testing.assert_array_equal(_sorted_points(found), _sorted_points(shuffled[name]))


def _numbers(found: Any) -> Any:
    """Tables are compared by the numbers in them, pages by their length."""
    if isinstance(found, str):
        return len(found)
    if not isinstance(found, dict):
        return np.asarray(np.nan if found is None else found, float)
    cells = [cell for column in found.values() for cell in column.values()]
    return [cell for cell in cells if isinstance(cell, int | float)]


def _sorted_points(columns: dict[str, Any]) -> list[tuple[Any, ...]]:
    names = sorted(columns.keys() - {"xyz", NUMBER})
    rows = np.column_stack([columns["xyz"], *(columns[name] for name in names)])
    return sorted(map(tuple, rows.tolist()))


@point_runs
def test_feet_give_the_answer_of_metres(
    spec: Spec, block: PointCloud, caplog: pytest.LogCaptureFixture
) -> None:
    """The same block in US survey feet: equal labels and shares, lengths told in metres."""
    if spec.id in OF_CRS:
        pytest.skip("feet are another CRS, which its own tests look at")
    foot = 1200 / 3937
    columns = {name: block[name] for name in block.names}
    in_feet = PointCloud(block.xyz / foot, columns, crs=CRS(2263), name="feet.laz")
    metres, told = job(spec, block).run(), lengths_told(caplog)
    feet = job(spec, in_feet).run()
    assert lengths_told(caplog) == pytest.approx(told, rel=0.05), "metres that are feet"
    for name, field in spec.outputs.items():
        here, there = getattr(feet, name), getattr(metres, name)
        if field.kind.word in ("number", "integer"):
            assert here is there is None or here == pytest.approx(there, rel=1e-6), name
        elif field.kind.word == "PointCloud":
            for column in there.names:
                scale = foot if is_length(here, column) else 1.0
                close = {"rtol": 1e-5, "atol": 1e-5, "equal_nan": True}
                same = np.isclose(scale * here[column], there[column], **close)
                assert not same.size or same.mean() > 0.999, f"{name}.{column}"


def lengths_told(caplog: pytest.LogCaptureFixture) -> list[float]:
    """The lengths that messages tell, in metres; the messages are then forgotten."""
    found = re.findall(r"(\d[\d.]*) (m|US survey foot)\b", caplog.text)
    caplog.clear()
    return [float(number) * (1.0 if unit == "m" else 1200 / 3937) for number, unit in found]


def is_length(cloud: PointCloud, column: str) -> bool:
    """Whether an attribute says that it is in the unit of the heights."""
    return cloud.descriptions.get(column, "").endswith(f", {vertical_unit(cloud.crs)}")


@point_tools
@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_hardly_any_points(spec: Spec, count: int, block: PointCloud) -> None:
    """A correct answer or a clear error, never a crash."""
    try:
        result = job(spec, block.select(range(count))).run()
    except (DataError, ParameterError) as err:
        message = str(err)
        assert "points" in message or "reference" in message
        return
    for name, field in spec.outputs.items():
        layer = getattr(result, name)
        if field.kind.word == "PointCloud":
            assert len(layer) <= count


@pytest.mark.parametrize("spec", IGNORING, ids=lambda s: s.id)
def test_withheld_points_count_as_little_as_ignored_ones(spec: Spec, block: PointCloud) -> None:
    """A hundredth of the points, of class 7 or withheld: all but their class comes out the same."""
    some = np.arange(len(block)) % 100 == 0
    classes = np.where(some, 7, block["classification"]).astype(np.uint8)
    noise = block.with_attributes({"classification": classes})
    withheld = block.with_attributes({"withheld": some.astype(np.uint8)})
    one, other = (_run_or_error(spec, points) for points in (noise, withheld))
    assert one.keys() == other.keys()
    for name, found in one.items():
        if not isinstance(found, str) and not (isinstance(found, dict) and "xyz" in found):
            np.testing.assert_allclose(_numbers(found), _numbers(other[name]), err_msg=name)


@pytest.mark.parametrize("spec", MEASURING, ids=lambda s: s.id)
def test_withheld_points_count_as_little_as_deleted_ones(
    spec: Spec, block: PointCloud, caplog: pytest.LogCaptureFixture
) -> None:
    """Far too high points, withheld or not there: the same surfaces and figures, and a warning."""
    some = np.arange(len(block)) % 100 == 0
    raised = block.with_xyz(block.xyz + np.column_stack([0 * some, 0 * some, 40.0 * some]))
    withheld = raised.with_attributes({"withheld": some.astype(np.uint8)})
    one, other = (contents(job(spec, p).run()) for p in (withheld, block.select(~some)))
    for name, found in other.items():
        if not isinstance(found, str) and not (isinstance(found, dict) and "xyz" in found):
            np.testing.assert_allclose(_numbers(one[name]), _numbers(found), err_msg=name)
    told = re.findall(r"(\d+) points are flagged as withheld", caplog.text)
    assert len(told) == 1
    assert 0 < int(told[0]) <= 100


def _run_or_error(spec: Spec, points: PointCloud) -> dict[str, Any]:
    try:
        return contents(job(spec, points).run())
    except DataError:
        return {}


@point_runs
def test_attributes_survive(spec: Spec, block: PointCloud) -> None:
    result = job(spec, block).run()
    for name, field in spec.outputs.items():
        if field.kind.word == "PointCloud":
            layer = getattr(result, name)
            assert set(layer.names) >= set(block.names)
            assert layer.crs == (FAST[spec.id]["crs"] if spec.id in OF_CRS else block.crs)


@tiled
def test_tiles_with_halo_equal_the_whole(
    spec: Spec, settings: dict[str, Any], strip: PointCloud
) -> None:
    """Labels and cells of tiles, each read with the halo that the tool asks for."""
    strip = with_house(strip) if spec.id in BUILT else strip
    check_tiles(spec, settings, strip, reach(spec, settings, strip))


@tiled
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_too_small_a_halo_is_noticed(
    spec: Spec, settings: dict[str, Any], share: float, strip: PointCloud
) -> None:
    """The law above means something: it fails for less than the tool asks for."""
    halo = reach(spec, settings, strip)
    if halo == 0:
        pytest.skip("the tool asks for none")
    if not {field.kind.word for field in spec.outputs.values()} & {"PointCloud", "Raster"}:
        pytest.skip("features are compared by the tests of the tool")
    strip = with_house(strip) if spec.id in BUILT else strip
    if spec.id in ALIGNED | IN_LISTS or (share and spec.id in AMPLE):
        pytest.skip("what needs all of it cannot be seen")
    with pytest.raises(AssertionError):
        check_tiles(spec, settings, strip, share * halo)


def reach(spec: Spec, settings: dict[str, Any], strip: PointCloud) -> float:
    """The halo that the tool asks for; skips tools that need the whole cloud."""
    halo = spec.halo(spec.parse(settings)[0])
    if math.isinf(halo):
        pytest.skip("needs the whole cloud")
    assert halo < TILE, "make the strip longer: a tile with its halo is the whole"
    return halo


def tile_job(
    spec: Spec,
    settings: dict[str, Any],
    strip: PointCloud,
    bounds: tuple[float, float] = (-math.inf, math.inf),
) -> Any:
    """The tool on the part of all its layers between two eastings."""

    def cut(cloud: PointCloud) -> PointCloud:
        return cloud.select((cloud["x"] >= bounds[0]) & (cloud["x"] < bounds[1]))

    others = dict(settings)
    if others.pop("reference", None):
        moved = strip.with_xyz(strip.xyz + np.array([0.3, 0, 0]))
        others["reference"] = cut(moved.select(np.arange(0, len(strip), 150)))
    return job(spec, cut(strip), **others)


def check_tiles(spec: Spec, settings: dict[str, Any], strip: PointCloud, halo: float) -> None:
    """Compare each tile, read with the halo, with the whole on the points and cells of the tile."""
    whole = tile_job(spec, settings, strip).run()
    for west in WEST + TILE * np.arange(3):
        east = west + TILE
        tile = tile_job(spec, settings, strip, (west - halo, east + halo)).run()
        for name, field in spec.outputs.items():
            here, there = getattr(tile, name), getattr(whole, name)
            if field.kind.word == "PointCloud":
                check_points(here, there, (west, east), SLACK.get(spec.id, 0.0))
            elif field.kind.word == "Raster":
                check_cells(here, there, (west, east), SLACK.get(spec.id, 0.0))


def check_points(
    tile: PointCloud, whole: PointCloud, core: tuple[float, float], slack: float
) -> None:
    here, there = (c.select((c["x"] >= core[0]) & (c["x"] < core[1])) for c in (tile, whole))
    np.testing.assert_equal(here.xyz, there.xyz)
    assert here.names == there.names
    for name in set(there.names) - {NUMBER}:
        allowed = slack if there[name].dtype.kind == "f" else 0.0
        np.testing.assert_allclose(here[name], there[name], 0, allowed, err_msg=name)


def check_cells(tile: Raster, whole: Raster, core: tuple[float, float], slack: float) -> None:
    x, y = np.meshgrid(*Lattice.of(whole).centres())
    inside = (x >= core[0]) & (x < core[1])
    for band, name in enumerate(whole.descriptions, start=1):
        here, there = (raster.sample(x[inside], y[inside], band=band) for raster in (tile, whole))
        np.testing.assert_allclose(here, there, rtol=0, atol=slack, err_msg=name)


@tools
def test_description_is_an_ogc_process(spec: Spec) -> None:
    described = json.loads(reference.as_json(spec.describe()))
    Draft202012Validator.check_schema(PROCESS)
    Draft202012Validator(PROCESS).validate(described)
    for name, field in described["inputs"].items():
        Draft202012Validator.check_schema(field["schema"])
        if "default" in field["schema"]:
            Draft202012Validator(field["schema"]).validate(field["schema"]["default"])
        for value in beyond(spec.inputs[name]):
            assert not Draft202012Validator(field["schema"]).is_valid(value)


WRITTEN = ("Report", "Drawing")  # and never read
READ = {  # types of layers by their words
    kind.word: hint for hint, kind in KINDS.items() if kind.is_layer and kind.word not in WRITTEN
}


def any_layers(first: Any, second: Any) -> Spec:
    """A tool that requires layers of two types and a list of the second, and gives the two back."""

    def run(job: Any, ctx: Context) -> Any:
        ctx.progress(1.0)
        return job.Outputs(one_again=job.one, other_again=job.other)

    given = {"one": first, "other": second, "more": tuple[second, ...]}
    again = {"one_again": first, "other_again": second}
    sinks = {"__annotations__": again} | {name: sink("A layer") for name in again}
    body = {
        "__doc__": "Give layers back.\n\nAs they are.",
        "__annotations__": given,
        "Outputs": outputs(type("Outputs", (), sinks)),
        "run": run,
        "halo": lambda job: 0.0,
    }
    number = len(REGISTRY)  # no id twice
    cls = type(f"TestingAny{number}", (), body | {name: source("A layer") for name in given})
    return cast(Spec, cast(Any, tool(f"testing.any{number}")(cls)).spec)


@pytest.mark.parametrize(("first", "second"), list(itertools.product(READ, repeat=2)))
def test_a_tool_with_any_layers_is_covered(
    first: str,
    second: str,
    block: PointCloud,
    strip: PointCloud,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The moment it is declared: each law finds layers for it, and passes."""
    spec = any_layers(READ[first], READ[second])
    for law in (
        test_defaults_are_accepted,
        test_same_input_same_answer_and_input_untouched,
        test_progress_rises_and_cancel_stops,
    ):
        law(spec, block)
    test_reach_and_rules_need_no_layers(spec)
    if cloud_name(spec):
        test_order_of_points_does_not_matter(spec, block)
        test_feet_give_the_answer_of_metres(spec, block, caplog)
        test_attributes_survive(spec, block)
        test_tiles_with_halo_equal_the_whole(spec, {}, strip)
        for count in range(4):
            test_hardly_any_points(spec, count, block)


def test_published_files_are_current() -> None:
    wanted = dict(reference.files())
    stale = [p for p, text in wanted.items() if not p.is_file() or p.read_text("utf-8") != text]
    assert not stale, "run: make docs"
    kept = {path for folder in {p.parent for p in wanted} for path in Path(folder).iterdir()}
    assert kept == wanted.keys()
