"""Pictures: what is drawn, in which colours."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import geopandas
import matplotlib.image
import numpy as np
import pytest
import shapely
from affine import Affine
from matplotlib.colors import to_rgb, to_rgba
from numpy.typing import NDArray
from pyproj import CRS
from scenes import layers

from algorithms.planes.sweep import PlanesSweep
from toolbox import language
from toolbox.data import PointCloud, Raster, Table, Vector
from toolbox.data.asprs import COLOURS
from toolbox.data.crs import LOCAL, parse_crs
from toolbox.declare import show
from toolbox.errors import DataError
from toolbox.pictures.charts import Bars, Curves, Sections
from toolbox.pictures.draw import draw, drawable, has_something_to_see
from toolbox.pictures.features import feature_classes, feature_colours, feature_key
from toolbox.pictures.images import (
    OTHER,
    POINT_CLASSES,
    RELIEF,
    Ramp,
    _looks_of_planes,
    cloud_image,
    point_key,
    raster_image,
)
from toolbox.pictures.maps import _EMPTY, say
from toolbox.pictures.oblique import direction_of

LAMBERT = CRS(2154)
raster = functools.partial(layers.raster, west=100.0, north=200.0, crs=LAMBERT)


def square(size: int = 20, **attributes: NDArray[Any]) -> PointCloud:
    """A flat grid of points, one per metre, from north-west to south-east."""
    y, x = np.mgrid[size - 1 : -1 : -1, 0:size]
    xyz = np.column_stack([x.ravel() + 0.5, y.ravel() + 0.5, np.zeros(size * size)])
    return PointCloud(xyz, attributes, crs=LAMBERT)


def outline(*shapes: Any, crs: CRS | None = LAMBERT) -> Vector:
    return Vector(geopandas.GeoDataFrame(geometry=list(shapes), crs=crs))


def colours(rgba: NDArray[np.float64]) -> set[str]:
    """Colours of the opaque pixels."""
    found = np.unique((rgba[rgba[..., 3] > 0][:, :3] * 255).round().astype(int), axis=0)
    return {"#{:02x}{:02x}{:02x}".format(*colour) for colour in found}


def read(path: Path) -> NDArray[np.float64]:
    return np.asarray(matplotlib.image.imread(path), float)


def test_classes_of_flat_ground_have_their_exact_colours() -> None:
    codes = np.repeat(np.array([2, 6, 9, 200], np.uint8), 100)
    image = cloud_image(square(classification=codes))
    assert colours(image.rgba) == {
        POINT_CLASSES[2][1],
        POINT_CLASSES[6][1],
        POINT_CLASSES[9][1],
        "#7a72c9",
    }
    assert not isinstance(image.key, Ramp)
    assert [name for name, _ in image.key.values()] == ["Ground", "Building", "Water", "Class 200"]
    north_west, south_east = image.rgba[1, 1], image.rgba[-2, -2]
    assert north_west == pytest.approx(to_rgba(POINT_CLASSES[2][1]))
    assert south_east == pytest.approx(to_rgba("#7a72c9"))


def test_highest_point_is_on_top() -> None:
    ground = square(classification=np.full(400, 2, np.uint8))
    for order in (1, -1):
        xyz = np.vstack([ground.xyz, np.add(ground.xyz, [0, 0, 5])])[::order]
        codes = np.repeat([2, 5], 400).astype(np.uint8)[::order]
        image = cloud_image(PointCloud(xyz, {"classification": codes}, crs=LAMBERT))
        assert colours(image.rgba) == {POINT_CLASSES[5][1]}


def test_declared_classes_come_before_those_of_las_in_their_own_colours() -> None:
    codes = np.repeat(np.arange(4, dtype=np.uint8), 100)
    looks = {0: ("Right", "#d4d4d4"), 3: ("Wrong", "#d7261e")}
    image = cloud_image(square(error=codes, classification=codes + 2), show.Classes("error", looks))
    assert colours(image.rgba) == {"#d4d4d4", "#d7261e", "#7a72c9", "#58b2a3"}
    assert image.key == looks | {1: ("Class 1", "#7a72c9"), 2: ("Class 2", "#58b2a3")}
    assert image.rgba[-2, -2] == pytest.approx(to_rgba("#d7261e"))


def test_without_classes_elevation_then_intensity() -> None:
    unclassified = {"classification": np.zeros(400, np.uint8), "intensity": np.arange(400)}
    flat = cloud_image(square(**unclassified))
    assert isinstance(flat.key, Ramp)
    assert flat.key.label == "Intensity"
    assert flat.rgba[1, 1, 0] < flat.rgba[-2, -2, 0]
    xyz = square().xyz + np.linspace(0, 9, 400)[:, None] * [0, 0, 1]
    slope = cloud_image(PointCloud(xyz, unclassified, crs=LAMBERT))
    assert isinstance(slope.key, Ramp)
    assert slope.key.label == "Elevation (m)"
    assert slope.key.low == pytest.approx(0, abs=0.1)
    assert slope.key.high == pytest.approx(9, abs=0.1)


def test_gaps_between_points_are_closed_but_voids_stay_open() -> None:
    xyz = np.random.default_rng(0).uniform(0, 60, (3600, 3))  # leaves a third of pixels empty
    hole = (np.abs(xyz[:, 0] - 30) < 8) & (np.abs(xyz[:, 1] - 30) < 8)
    image = cloud_image(PointCloud(xyz[~hole], {"intensity": xyz[~hole, 0]}, crs=LAMBERT))
    opaque = image.rgba[..., 3] > 0
    middle = opaque.shape[0] // 2
    assert not opaque[middle, middle]
    assert 0.9 < opaque.mean() < 0.99


def test_slopes_towards_the_light_are_brighter() -> None:
    """The sun is in the north-west, so a ridge from south-west to north-east shows two sides."""
    y, x = np.mgrid[0:21, 0:21]
    ridge = raster(-np.abs(x + y - 20.0))  # row 0 is north
    rgba = raster_image(ridge).rgba
    assert rgba[8, 8, :3].sum() > rgba[12, 12, :3].sum()  # same elevation on both sides


def test_small_integers_are_classes_and_nodata_is_open() -> None:
    image = raster_image(raster(np.array([[0, 2, 6]], np.uint8), nodata=0))
    assert image.key == {2: ("2", "#7a72c9"), 6: ("6", "#58b2a3")}
    assert image.rgba[0, 0, 3] == 0
    named = raster_image(raster(np.array([[2, 6]], np.uint8), descriptions=("classification",)))
    assert named.key == {2: POINT_CLASSES[2], 6: POINT_CLASSES[6]}
    assert isinstance(raster_image(raster(np.arange(42).reshape(6, 7))).key, Ramp)


def test_only_lengths_are_shaded() -> None:
    values = np.random.default_rng(0).normal(size=(20, 20))
    shares = raster_image(raster(values, units=("1",), descriptions=("Share",)))
    metres = raster_image(raster(values, units=("metre",), descriptions=("Elevation",)))
    assert isinstance(shares.key, Ramp)
    assert (shares.key.colours, shares.key.label) == ("viridis", "Share")
    assert isinstance(metres.key, Ramp)
    assert metres.key.label == "Elevation (m)"


@pytest.mark.parametrize(
    ("name", "unit", "colours"),
    [
        ("intensity (mean)", "", "gray"),
        ("points per cell", "", "viridis"),
        ("z (std)", "metre", "viridis"),
        ("user_data (mean)", "", "viridis"),
        ("distance to the nearest point", "metre", "viridis"),
        ("error without the points used", "metre", "viridis"),
    ],
)
def test_what_is_no_height_has_no_light_and_shade(name: str, unit: str, colours: str) -> None:
    """Cells of one value have one colour, whatever is beside them."""
    values = np.random.default_rng(0).integers(0, 5, (30, 30)).astype(np.float32)
    image = raster_image(raster(values, descriptions=(name,), units=(unit,)))
    assert isinstance(image.key, Ramp)
    assert image.key.colours == colours
    assert len(np.unique(image.rgba.reshape(-1, 4), axis=0)) == 5
    for lit in ("z (linear)", "height_above_ground (max)", ""):
        relief = raster_image(raster(values, descriptions=(lit,)))
        assert len(np.unique(relief.rgba.reshape(-1, 4), axis=0)) > 50


def test_surface_minus_terrain_is_relief_and_change_is_two_colours() -> None:
    rng = np.random.default_rng(0)
    for share, colours in ((0.005, None), (0.4, "RdBu_r"), (1.0, "RdBu_r")):
        values = np.where(rng.random((50, 50)) < share, -1, 1) * rng.uniform(0, 9, (50, 50))
        key = raster_image(raster(values, descriptions=("a minus b",), units=("metre",))).key
        assert isinstance(key, Ramp)
        assert (key.colours == colours) == (colours is not None)


def test_errors_of_points_are_two_colours_about_zero() -> None:
    errors = np.linspace(-1, 1, 400).astype(np.float32)
    codes = np.full(400, 2, np.uint8)
    cloud = square(classification=codes).with_attributes(
        {"error_linear": errors}, descriptions={"error_linear": "surface minus point, metre"}
    )
    way = show.Values("error_linear", length=True, centred=True)
    key = cloud_image(cloud, way).key
    assert isinstance(key, Ramp)
    assert (key.colours, key.label, key.low) == ("RdBu_r", "error linear (m)", -key.high)
    plain = cloud_image(cloud, show.Values("error_linear", label="Error", note="of some")).key
    assert isinstance(plain, Ramp)
    assert (plain.colours, plain.label) == ("viridis", "Error, of some")


def test_checkpoints_are_coloured_by_their_error_and_whole(tmp_path: Path) -> None:
    """Those at the edge have room; the highest and the lowest error have the ends of the key."""
    places = [shapely.Point(x, y) for x in (0, 50) for y in (0, 50)]
    frame = geopandas.GeoDataFrame({"error": [-1.0, 1.0, 1.0, -1.0]}, geometry=places, crs=LAMBERT)
    way = show.Values("error", centred=True)
    draw({"errors": (Vector(frame), (way,))}, tmp_path / "a.png")
    picture = read(tmp_path / "a.png")[:, :, :3]
    ramp = Ramp.about_zero(np.array([-1.0, 1.0]), "").colour_map()
    shapes = [
        np.argwhere(np.abs(picture[:640] - to_rgba(ramp(end))[:3]).max(axis=-1) < 0.01)
        for end in (0.0, 1.0)
    ]
    low, high = (np.bincount(found[:, 1] > 360) for found in shapes)
    assert low.tolist() == pytest.approx(high[::-1].tolist(), rel=0.15)
    assert low[0] == pytest.approx(low[1], rel=0.15)  # the lower left one is as whole as the others
    assert low[0] > 30


def test_no_data_has_a_colour_of_its_own() -> None:
    empty = np.array(to_rgba(_EMPTY)[:3])
    for colours in (RELIEF, "viridis", "RdBu_r"):
        ramp = Ramp(colours, 0, 1, "").colour_map()(np.linspace(0, 1, 100))[:, :3]
        assert np.abs(ramp - empty).max(axis=1).min() > 0.05


def test_named_bands_have_a_map_each(tmp_path: Path) -> None:
    values, names = np.random.default_rng(0).normal(size=(3, 9, 9)), ("z", "points used", "error")
    draw({"a": raster(values)}, tmp_path / "a.png")
    draw({"a": raster(values, descriptions=names)}, tmp_path / "b.png")
    assert read(tmp_path / "b.png").shape[1] > 2.5 * read(tmp_path / "a.png").shape[1]


def test_differences_are_centred_on_zero() -> None:
    values = np.linspace(-1, 3, 100).reshape(10, 10)
    key = raster_image(raster(values, descriptions=("Difference to reference",))).key
    assert isinstance(key, Ramp)
    assert key.low == -key.high
    assert key.colours == "RdBu_r"


def test_same_bytes_on_every_run_and_no_date_in_the_file(tmp_path: Path) -> None:
    layers = {"a": square(classification=np.full(400, 2, np.uint8)), "b": raster(np.eye(9))}
    for name in ("a.png", "b.png"):
        draw(layers, tmp_path / name)
    content = (tmp_path / "a.png").read_bytes()
    assert content == (tmp_path / "b.png").read_bytes()
    assert not any(word in content for word in (b"Software", b"tEXt", b"tIME", b"Date"))


@pytest.mark.parametrize("street", [False, True])
def test_a_wall_is_seen_from_the_street(street: bool) -> None:
    """A front with wide shop windows was shown from inside, as most points stood back in them."""
    along, up = (a.ravel() for a in np.mgrid[0:10:0.25, 0:6:0.25])
    inside = (along % 3 > 1) & (up > 1)
    xyz = np.column_stack([along, np.where(inside, 0.2, 0.0), up])
    if street:
        ground = np.column_stack([along, -1 - up, np.zeros(len(along))])
        room = np.column_stack([along, np.full(len(along), 2.5), up])
        xyz = np.concatenate([xyz, ground, room])
    ids = (np.abs(xyz[:, 1]) < 0.1).astype(np.int32)
    assert direction_of(PointCloud(xyz, {"plane_id": ids}), "plane_id")[1] < -0.8


def test_ticks_have_the_decimal_sign_of_the_user_and_names_their_points() -> None:
    """A Turkish picture of a front had ticks at 2.5, and its legend 2,5."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure()
    FigureCanvasAgg(figure)
    numbers, names = figure.subplots(1, 2)
    numbers.set(xlim=(0, 10), xticks=[0, 2.5])
    names.set_xticks([0, 1], ["tree", "Plot 2.5"])
    with language.speaking("tr"):
        say(figure)
        found = [[tick.get_text() for tick in axes.get_xticklabels()] for axes in (numbers, names)]
    assert found == [["0,0", "2,5"], ["ağaç", "Plot 2.5"]]


@pytest.mark.slow
def test_the_title_of_many_layers_is_not_cut(tmp_path: Path) -> None:
    """They lie over one map, and all are named above it."""
    over = {name * 6: outline(shapely.box(110, 160, 140, 190)) for name in ("tops", "rows", "ways")}
    draw({"ground": raster(np.full((50, 50), 3.0)), **over}, tmp_path / "a.png")
    edge = read(tmp_path / "a.png")[:, -2:, :3]
    assert edge.min() == 1.0, "white"


def test_one_panel_per_layer_in_rows_of_three(tmp_path: Path) -> None:
    sizes = {}
    for count in (1, 3, 4):
        draw({str(i): raster(np.eye(9)) for i in range(count)}, tmp_path / "a.png")
        sizes[count] = read(tmp_path / "a.png").shape
    assert sizes[3][0] == sizes[1][0]
    assert sizes[4][0] == pytest.approx(2 * sizes[1][0], rel=0.05)
    assert sizes[3][1] > sizes[4][1] > sizes[1][1]


def test_picture_is_as_high_as_the_extent_asks_for(tmp_path: Path) -> None:
    heights = []
    for shape in ((5, 100), (50, 100), (100, 100), (100, 5)):
        draw({"a": raster(np.random.default_rng(0).random(shape))}, tmp_path / "a.png")
        heights.append(read(tmp_path / "a.png").shape[0])
    assert heights == sorted(heights)
    assert heights[2] > 1.5 * heights[1]
    assert heights[3] < 2 * heights[2]  # a strip does not make a picture without end


def test_vector_lies_over_the_map_before_it(tmp_path: Path) -> None:
    ground = raster(np.full((50, 50), 3.0))
    roof = outline(shapely.box(110, 160, 140, 190), shapely.Point(105, 155))
    draw({"ground": ground}, tmp_path / "a.png")
    draw({"ground": ground, "roof": roof}, tmp_path / "b.png")
    bare, over = read(tmp_path / "a.png"), read(tmp_path / "b.png")
    assert bare.shape == over.shape
    assert np.any(np.abs(bare - over)[200:500] > 0.5)


def test_isolines_are_heavy_where_they_are_index_lines_and_labels_are_texts(tmp_path: Path) -> None:
    """An index line has more ink, and texts are no dots."""
    lines = [shapely.LineString([(100, y), (200, y)]) for y in (110, 150)]
    frame = geopandas.GeoDataFrame(
        {"elevation": [10.0, 11.0], "is_index": [True, False]}, geometry=lines, crs=LAMBERT
    )
    at = geopandas.GeoDataFrame(
        {"text": ["10", ""], "angle": [0.0, 0.0]},
        geometry=shapely.points([(150, 110), (150, 150)]),
        crs=LAMBERT,
    )
    shows = show.Isolines("elevation", heavy="is_index")
    texts = show.Texts("text", angle="angle")
    draw({"c": (Vector(frame), (shows,))}, tmp_path / "a.png")
    draw({"c": (Vector(frame), (shows,)), "l": (Vector(at), (texts,))}, tmp_path / "b.png")
    bare, named = read(tmp_path / "a.png")[..., 0], read(tmp_path / "b.png")[..., 0]
    ink = 1 - bare[60:340, 420:600].mean(axis=1)  # beside the title, the ticks and the scale bar
    thin, heavy = (float((part - ink.min()).sum()) for part in (ink[:140], ink[140:]))
    assert heavy > 2 * thin, (heavy, thin)
    changed = np.argwhere(np.abs(bare - named)[100:] > 0.2)
    assert len(changed) > 20
    assert np.ptp(changed[:, 0]) < 60, "only at one of the lines: an empty text is nothing"


def test_outlines_without_heights_lie_over_a_map_with_heights(tmp_path: Path) -> None:
    ground = raster(np.full((50, 50), 3.0)).with_crs(parse_crs("EPSG:2154+5720"))
    roof = outline(shapely.box(110, 160, 140, 190), crs=CRS(2154))
    draw({"ground": ground}, tmp_path / "a.png")
    draw({"ground": ground, "roof": roof}, tmp_path / "b.png")
    assert read(tmp_path / "a.png").shape == read(tmp_path / "b.png").shape


def test_nothing_lies_over_a_layer_in_coordinates_of_its_own(tmp_path: Path) -> None:
    """Planes of a scan in local coordinates were drawn over its elevation."""
    sides = geopandas.GeoDataFrame({"kind": ["wall"]}, geometry=[shapely.box(0, 0, 9, 6)])
    elevation = Vector(sides.set_crs(LOCAL))
    planes = outline(shapely.box(1, 1, 5, 4), crs=LOCAL)
    widths = []
    for apart in (False, True):
        shows = (show.Classes("kind", apart=apart),)
        draw({"elevation": (elevation, shows), "planes": planes}, tmp_path / "a.png")
        widths.append(read(tmp_path / "a.png").shape[1])
    assert widths[1] > 1.5 * widths[0], "two maps beside each other"


@pytest.mark.parametrize(
    "vector",
    [
        outline(shapely.box(110, 160, 140, 190), crs=CRS(2192)),  # another CRS
        outline(shapely.box(910, 160, 940, 190)),  # elsewhere
    ],
)
def test_vector_that_does_not_belong_over_a_map_has_its_own(tmp_path: Path, vector: Vector) -> None:
    draw({"ground": raster(np.eye(50))}, tmp_path / "a.png")
    draw({"ground": raster(np.eye(50)), "map": vector}, tmp_path / "b.png")
    assert read(tmp_path / "b.png").shape[1] > 1.8 * read(tmp_path / "a.png").shape[1]


def test_scale_bar_needs_lengths(tmp_path: Path) -> None:
    """The bar is the only dark thing in the lower left of an empty map."""
    for crs, dark in ((LAMBERT, True), (LOCAL, True), (CRS(2992), True), (CRS(4326), False)):
        empty = Raster(np.full((20, 20), np.nan), Affine(1, 0, 10, 0, -1, 40), crs=crs)
        draw({"a": empty}, tmp_path / "a.png")
        picture = read(tmp_path / "a.png")
        corner = picture[560:660, 70:250, :3]
        assert (corner.min() < 0.4) == dark


@pytest.mark.parametrize(
    "layer",
    [
        PointCloud(np.array([[1.0, 2.0, 3.0]]), crs=LAMBERT),
        PointCloud(np.column_stack([np.arange(9.0), np.zeros(9), np.zeros(9)])),
        PointCloud(np.tile([[1.0, 2.0, 3.0]], (5, 1)), {"intensity": np.ones(5)}),
        raster(np.full((3, 3), np.nan)),
        raster(np.array([[np.nan, 1.0]])),
        raster(np.array([[1.0]])),
        raster(np.full((2, 2), 7, np.uint8), nodata=7),
        outline(shapely.Point(3, 4)),
        outline(shapely.LineString([(0, 0), (0, 9)]), None),
        outline(shapely.GeometryCollection([shapely.Point(0, 0), shapely.box(1, 1, 2, 2)])),
        outline(shapely.box(0, 0, 9, 9).difference(shapely.box(2, 2, 3, 3)), crs=None),
    ],
)
def test_the_smallest_layers_are_drawn(tmp_path: Path, layer: PointCloud | Raster | Vector) -> None:
    draw({"a": layer}, tmp_path / "a.png")
    assert read(tmp_path / "a.png").std() > 0.01


def test_nothing_to_draw(tmp_path: Path) -> None:
    nothing = {
        "table": Table.from_rows([{"a": 1}]),
        "cloud": PointCloud(np.zeros((0, 3))),
        "map": outline(),
    }
    with pytest.raises(DataError, match="nothing to draw"):
        draw(nothing, tmp_path / "a.png")
    draw(nothing | {"raster": raster(np.eye(3))}, tmp_path / "a.png")
    assert (tmp_path / "a.png").exists()


BINS = [(None, 0.0, 1), (0.0, 0.5, 6), (0.5, 1.0, 3), (1.0, None, 2)]


def test_a_table_of_bins_is_a_histogram(tmp_path: Path) -> None:
    table = Table.from_rows(
        {"low": low, "high": high, "count": count, "unit": "m"} for low, high, count in BINS
    )
    way = show.Histogram("low", "high", "count", unit_in="unit")
    bars = Bars.of("histogram", table, way)
    assert bars == Bars("histogram", [0.0, 0.5, 1.0], [1, 6, 3, 2], "m")
    assert Bars.of("short", Table(table.frame[:2]), way) is None
    assert has_something_to_see(table, (way,))
    layers = (table, square(), outline())
    assert [has_something_to_see(layer) for layer in layers] == [False, True, False]
    draw({"map": raster(np.eye(3)), "histogram": (table, (way,))}, tmp_path / "a.png")
    picture = read(tmp_path / "a.png")[:, 700:, :3]  # right of the map
    inside, beyond = (
        np.all(np.abs(picture - to_rgba(colour)[:3]) < 1 / 255, axis=-1).sum()
        for colour in ("#7f9fbf", "#c9c9c9")
    )
    assert inside == pytest.approx(3 * beyond, rel=0.05)  # 6 + 3 to 1 + 2


def test_a_storage_curve_has_two_axes(tmp_path: Path) -> None:
    """The lines in their colours, and grey where the figures are lower limits."""
    table = Table.from_rows(
        {
            "level": h,
            "unit": "metre",
            "area_m2": 900.0 * h,
            "volume_m3": 450e3 * h**2,
            "open": h > 8,
        }
        for h in range(11)
    )
    way = show.Curve(
        show.Axis("level", "level", unit_in="unit"),
        (show.Axis("area_m2", "area", "m²"), show.Axis("volume_m3", "volume", "m³")),
        upright=True,
        shaded="open",
        shaded_as="lower limits",
    )
    curve = Curves.of("curve", table, way)
    assert curve is not None
    assert (curve.over.label, curve.shaded, curve.dashed) == (
        "level, m; grey: lower limits",
        9.0,
        None,
    )
    assert [line.label for line in curve.lines] == ["area, 1000 m²", "volume, million m³"]
    assert curve.lines[1].values[-1] == 45
    assert has_something_to_see(table, (way,))
    draw({"curve": (table, (way,))}, tmp_path / "a.png")
    picture = read(tmp_path / "a.png")[..., :3]
    for colour, least in (("#c4742b", 1000), ("#2f6da8", 1000), ("#e9e9e9", 15_000)):
        near = np.all(np.abs(picture - to_rgba(colour)[:3]) < 2 / 255, axis=-1)
        assert near.sum() > least, colour
    assert Curves.of("short", Table(table.frame[:1]), way) is None


def test_the_label_of_long_levels_is_not_cut(tmp_path: Path) -> None:
    """Levels of six digits push it to the left, where the picture ends."""
    rows = ({"level": 805.805 + 0.005 * k, "area": 900.0 + k} for k in range(9))
    way = show.Curve(show.Axis("level", "level"), (show.Axis("area", "area"),), upright=True)
    draw({"curve": (Table.from_rows(rows), (way,))}, tmp_path / "a.png")
    edge = read(tmp_path / "a.png")[:, :2, :3]
    assert edge.min() == 1.0, "white"


@pytest.mark.parametrize("upright", [True, False])
def test_a_curve_of_one_line_has_one_axis_and_a_dashed_line(upright: bool, tmp_path: Path) -> None:
    rows = [{"t": 0.01 * k, "n": 40.0 - k, "best": k in (3, 5)} for k in range(9)]
    way = show.Curve(
        show.Axis("t", "tolerance", "cm", factor=100),
        (show.Axis("n", "planes"),),
        upright=upright,
        dots=True,
        dashed="best",
    )
    table = Table.from_rows(rows)
    curve = Curves.of("curve", table, way)
    assert curve is not None
    assert (curve.dashed, curve.over.label) == (3, "tolerance, cm; dashed: the best")
    assert curve.lines[0].label == "planes"
    sizes = []
    for name, shown in {"a": way, "b": replace(way, lines=way.lines * 2)}.items():
        draw({"curve": (table, (shown,))}, tmp_path / f"{name}.png")
        picture = read(tmp_path / f"{name}.png")[..., :3]
        near = np.all(np.abs(picture - to_rgba("#2f6da8")[:3]) < 2 / 255, axis=-1)
        sizes.append(near.sum())
    assert sizes[0] == 0  # the colour of the second line
    assert sizes[1] > 500


def test_a_curve_has_one_line_or_two() -> None:
    axis = show.Axis("a", "a")
    with pytest.raises(TypeError, match="one line or two, not 3"):
        show.Curve(axis, (axis, axis, axis))


def test_missing_columns_are_named_and_the_rest_is_drawn(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    table = Table.from_rows([{"level": 1.0, "area": 2.0}] * 4)
    way = show.Curve(show.Axis("level", "level"), (show.Axis("aera", "area"),))
    cloud = square(classification=np.full(400, 2, np.uint8))
    layers = {"curve": (table, (way,)), "cloud": (cloud, (show.Planes("plane"),))}
    draw(layers, tmp_path / "a.png")
    assert "curve is not shown as curve: it has no 'aera'; did you mean 'area'?" in caplog.text
    assert "cloud is not shown as planes: it has no 'plane'" in caplog.text
    draw({"cloud": cloud}, tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    caplog.clear()
    draw({"cloud": (cloud, (show.Planes("plane", optional=True),))}, tmp_path / "c.png")
    assert not caplog.text
    assert (tmp_path / "c.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize("way", [show.Values("a"), show.Profile("n", "n", "a")])
def test_words_are_not_drawn_as_numbers(way: Any, caplog: pytest.LogCaptureFixture) -> None:
    """A run does not fail for its plot; features of one colour are shown all the same."""
    columns = {"a": ["x", "y"], "n": [1.0, None]}
    points = geopandas.points_from_xy([0, 1], [0, 1])
    layer = Vector(geopandas.GeoDataFrame(columns, geometry=points, crs=32635))
    tool: Any = PlanesSweep
    fields = {"t": replace(tool.spec.outputs["table"], show=(way,))}
    ((_, shows),) = drawable({"t": layer}, fields).values()
    assert shows == ()
    assert "t is not shown as" in caplog.text
    assert "'a' holds no numbers" in caplog.text


def test_a_result_without_a_usable_column_or_row_is_left_out(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """So that a run does not fail for a plot, which is drawn when all is done."""
    tool: Any = PlanesSweep
    fields = {"table": tool.spec.outputs["table"]}
    rows = [{"tolerance": 0.1 * k, "planes": k, "share": 1.0, "knee": False} for k in range(3)]
    assert drawable({"table": Table.from_rows(rows)}, fields)
    assert not drawable({"table": Table.from_rows(rows[:1])}, fields)
    assert not drawable({"table": None}, fields)
    assert not caplog.text
    assert not drawable({"table": Table.from_rows({**row, "n": 1} for row in [{}, {}])}, fields)
    assert "table is not shown as curve: it has no 'tolerance'" in caplog.text


def test_the_first_attribute_of_a_pattern_is_shown(tmp_path: Path) -> None:
    cloud = square(error_b=np.arange(400.0), error_a=np.zeros(400))
    for name, attribute in (("a", "error_*"), ("b", "error_b"), ("c", "error_a")):
        draw({"cloud": (cloud, (show.Values(attribute),))}, tmp_path / f"{name}.png")
    contents = [(tmp_path / f"{name}.png").read_bytes() for name in "abc"]
    assert contents[0] == contents[1] != contents[2]


def test_a_hillshade_is_grey() -> None:
    image = raster_image(raster(np.array([[1, 128, 255]], np.uint8), descriptions=("hillshade",)))
    assert isinstance(image.key, Ramp)
    np.testing.assert_array_equal(image.rgba[..., 0], image.rgba[..., 2])
    assert (np.diff(image.rgba[0, :, 0]) > 0.3).all()


def test_layers_of_other_types_are_refused(tmp_path: Path) -> None:
    unknown: Any = {"ground": raster(np.eye(3)), "mesh": [1, 2, 3]}
    with pytest.raises(DataError, match="mesh: a list cannot be drawn"):
        draw(unknown, tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()


def test_file_name_is_checked(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"a\.jpg: pictures are written as \.png"):
        draw({"a": raster(np.eye(3))}, tmp_path / "a.jpg")
    with pytest.raises(DataError, match=r"a\.png cannot be written"):
        draw({"a": raster(np.eye(3))}, tmp_path / "none" / "a.png")


@pytest.mark.slow
def test_city_block(tmp_path: Path, data: Callable[[str], Path]) -> None:
    """Real points and surfaces: most of the map is covered, in more than a few colours."""
    cloud = PointCloud.open(data("ign_urban_50m/77055_627755.laz"))
    image = cloud_image(cloud)
    assert (image.rgba[..., 3] > 0).mean() > 0.97
    assert not isinstance(image.key, Ramp)
    assert {"Ground", "Building", "High vegetation"} <= {name for name, _ in image.key.values()}
    terrain = Raster.open(data("ign_gridding_reference/DTM_77055_627755.tif"))
    draw({"Points": cloud, "Terrain": terrain}, tmp_path / "a.png")
    assert read(tmp_path / "a.png").std() > 0.1


# Planes -----------------------------------------------------------------------------------------


def walls(upright: bool = True) -> PointCloud:
    """A wall that faces north, with ground before it; or lying on its back."""
    rng = np.random.default_rng(1)
    u, v = rng.random((2, 20_000))
    zero = np.zeros(20_000)
    wall = np.column_stack([10 * u, zero, 5 * v])
    ground = np.column_stack([10 * u, 8 * v, zero])
    xyz = np.vstack([wall if upright else wall[:, [0, 2, 1]] + [0, 20, 0], ground])
    place = np.array([500.0, 900.0, 30.0])
    number = np.repeat(np.array([1, 2], np.int32), 20_000)
    return PointCloud(place + xyz, {"plane_id": number}, crs=LAMBERT)


def test_a_plane_that_is_not_named_has_no_colour_of_one_that_is() -> None:
    rng = np.random.default_rng(1)
    number = np.repeat(np.arange(1, 21, dtype=np.int32), 200)
    xyz = np.column_stack([rng.random(4000) + number, rng.random(4000), number / 9])
    cloud, way = PointCloud(xyz, {"plane_id": number}, crs=LAMBERT), show.Planes("plane_id")
    assert list(cloud_image(cloud, way).key) == list(range(1, 13))
    assert list(point_key(cloud, way)[1]) == list(range(1, 13))  # of the view in space
    looks = _looks_of_planes(cloud, way)
    assert len({colour for _, colour in looks.values()}) == 20


def test_each_word_of_a_key_has_a_colour_of_its_own() -> None:
    words = [f"kind {k:02d}" for k in range(12)]
    shapes = [shapely.box(k, 0, k + 1, 1) for k in range(12)]
    layer = Vector(geopandas.GeoDataFrame({"kind": words}, geometry=shapes, crs=LAMBERT))
    key = feature_key((layer, show.Classes("kind")))
    assert len({colour for _, colour in key.values()}) == 12


def test_planes_have_their_colours_and_walls_are_seen_from_the_front(tmp_path: Path) -> None:
    way = show.Planes("plane_id")
    image, flat = cloud_image(walls(), way), cloud_image(walls(upright=False), way)
    assert (image.above, flat.above) == (False, True)
    assert not isinstance(image.key, Ramp)
    assert [name for name, _ in image.key.values()] == ["Plane 1", "Plane 2"]
    shown = image.rgba[..., 3] > 0
    blue = shown & (image.rgba[..., 2] > image.rgba[..., 1])  # of plane 1, the other one is green
    aside, above = np.radians([25, 20])  # of the eye
    seen = 50 * np.cos(aside) * np.cos(above) / (80 * np.sin(above))
    assert blue.sum() / (shown & ~blue).sum() == pytest.approx(seen, rel=0.1)
    assert np.argwhere(blue)[:, 0].mean() < np.argwhere(shown & ~blue)[:, 0].mean()
    outline = Vector(geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 9, 9)], crs=LAMBERT))
    draw({"a": (walls(), (way,)), "b": outline}, tmp_path / "a.png")
    draw({"a": (walls(), (way,))}, tmp_path / "b.png")
    assert read(tmp_path / "a.png").shape[1] > 1.5 * read(tmp_path / "b.png").shape[1]


def test_classes_of_a_wall_are_seen_from_its_front() -> None:
    codes = np.tile(np.array([3, 7], np.int32), 20_000)
    cloud = walls().with_attributes({"said": codes})
    looks = {3: ("Three", "#111111"), 7: ("Seven", "#eeeeee")}
    image = cloud_image(cloud, show.Classes("said", looks, front_of="plane_id"))
    assert (image.above, image.key) == (False, looks)
    assert cloud_image(cloud, show.Classes("said", looks, front_of="absent")).above
    assert cloud_image(cloud, show.Classes("said", looks)).above


# Features by kind and by offset ---------------------------------------------------------------


def kinds(*names: Any) -> Vector:
    """A square of ten metres for each, one beside the other."""
    boxes = [shapely.box(100 + 10 * i, 0, 110 + 10 * i, 10) for i in range(len(names))]
    return Vector(geopandas.GeoDataFrame({"kind": names}, geometry=boxes, crs=LAMBERT))


def test_kinds_have_their_colours_and_a_key(tmp_path: Path) -> None:
    layer = kinds("omission", "agree", "commission")
    looks = {"commission": ("Too much", "#d7261e"), "omission": ("Too little", "#2166d1")}
    way = show.Classes("kind", looks)
    key = feature_key((layer, way))
    assert key is not None
    assert not isinstance(key, Ramp)
    assert list(key.values()) == [("agree", "#7a72c9"), *looks.values()]
    np.testing.assert_allclose(feature_colours((layer, way), key)[0], to_rgba("#2166d1"))
    draw({"a": (layer, (way,))}, tmp_path / "a.png")
    draw({"a": Vector(layer.frame.drop(columns="kind"))}, tmp_path / "b.png")
    with_key, plain = read(tmp_path / "a.png"), read(tmp_path / "b.png")
    assert with_key.shape[0] > plain.shape[0]
    red = np.isclose(with_key[..., :3], to_rgba("#d7261e")[:3], atol=0.01).all(axis=-1)
    assert 0.08 < red.mean() < 0.4
    assert not np.isclose(plain[..., :3], to_rgba("#d7261e")[:3], atol=0.01).all(axis=-1).any()


def test_kinds_that_are_too_many_or_missing() -> None:
    way = show.Classes("kind")
    assert feature_key((kinds(*map(str, range(13))), way)) is None
    assert feature_key((kinds(None, None), way)) is None
    assert feature_key((kinds("tree"), None)) is None
    layer = kinds("tree", None)
    key = feature_key((layer, way))
    assert key is not None
    assert len(key) == 1  # type: ignore[arg-type]
    assert feature_colours((layer, way), key)[1] == pytest.approx(to_rgba("#9a9a9a"))


def test_offsets_have_a_profile(tmp_path: Path) -> None:
    chainage = np.arange(50.0)
    frame = geopandas.GeoDataFrame(
        {"line": np.repeat([1, 2], 25), "chainage": chainage, "offset": chainage - 20},
        geometry=shapely.points(chainage, chainage),
        crs=LAMBERT,
    )
    layer = Vector(frame)
    across = show.Profile("line", along="chainage", across="offset", note="left +")
    colours = show.Values("offset", label="Offset", length=True, centred=True)
    profile = Sections.of("a", layer, across)
    assert profile is not None
    assert [len(along) for along, _ in profile.lines] == [25, 25]
    assert profile.labels == ("chainage (m)", "offset (m), left +")
    key = feature_key((layer, colours))
    assert isinstance(key, Ramp)
    assert (key.label, key.low) == ("Offset (m)", -key.high)
    draw({"a": (layer, (colours, across))}, tmp_path / "a.png")
    draw({"a": layer}, tmp_path / "b.png")
    assert read(tmp_path / "a.png").shape[1] > 1.8 * read(tmp_path / "b.png").shape[1]
    assert Sections.of("a", Vector(frame.assign(offset=np.nan)), across) is None


def test_ranges_of_numbers_have_no_powers_of_ten() -> None:
    errors = np.array([-0.05415, 0.01, 0.1083])  # the middle of whose ranges is not 0, but 1e-17
    spots = geopandas.GeoDataFrame({"error": errors}, geometry=shapely.points(errors, 0))
    found = feature_classes((Vector(spots), show.Values("error", centred=True)))
    assert [name for name, *_ in found][1] == "error: 0.000 to 0.036"


@pytest.mark.parametrize(
    ("beyond", "first", "last"),
    [
        ((), "error: -0.90 to -0.60", "error: 0.60 to 0.90"),
        ((5.0,), "error: -0.90 to -0.60", "error: ≥ 0.60"),
        ((5.0, -7.0), "error: ≤ -0.60", "error: ≥ 0.60"),
    ],
)
def test_the_ends_of_a_key_of_errors_say_what_they_hold(
    beyond: tuple[float, ...], first: str, last: str
) -> None:
    """An error of 5 m was drawn in the colour of "0.6 to 0.9", and nothing said so."""
    errors = np.array([*np.resize([-0.9, 0.9], 600), 0.0, *beyond])
    spots = geopandas.GeoDataFrame({"error": errors}, geometry=shapely.points(errors, 0))
    layer, way = Vector(spots), show.Values("error", centred=True)
    names = [name for name, *_ in feature_classes((layer, way))]
    assert (names[0], names[-1]) == (first, last)
    key = feature_key((layer, way))
    assert isinstance(key, Ramp)
    signs = [text[0] in "≤≥" for text in key.ends]
    assert signs == [name[7] in "≤≥" for name in (first, last)]


def test_the_first_other_colours_are_unlike_those_of_point_classes() -> None:
    """Classes that the standard leaves open have them, and kinds of towers upon the points."""

    def unlike(colour: str) -> float:
        return min(math.dist(to_rgb(colour), to_rgb(own)) for own in COLOURS.values())

    assert min(map(unlike, OTHER[:4])) > max(map(unlike, OTHER[-4:]))
