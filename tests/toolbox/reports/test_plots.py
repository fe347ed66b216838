"""Maps and views of reports hold the layers as they are."""

from __future__ import annotations

import base64
import json
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from affine import Affine

from toolbox import catalog
from toolbox.data import PointCloud, Raster, Report, Section, Vector
from toolbox.data.crs import parse_crs
from toolbox.data.report.render import render
from toolbox.declare.show import OfClass
from toolbox.qgis.tools import tool
from toolbox.reports.maps import maps_of
from toolbox.reports.space import space_of
from toolbox.reports.words import anchor_of

CRS = parse_crs("EPSG:32635+3855")
SPEC = catalog.load("shoreline.extract")
ORIGIN = np.array([500_000.0, 4_400_000.0, 0.0])


def layer(shapes: list[Any], **columns: list[Any]) -> Vector:
    moved = shapely.transform(np.array(shapes), lambda xyz: xyz + ORIGIN, include_z=True)
    return Vector(geopandas.GeoDataFrame(columns, geometry=moved, crs=CRS))


def cloud() -> PointCloud:
    xyz = np.random.default_rng(2).uniform(0, 100, (5000, 3)) * (1, 1, 0.1)
    more = {"intensity": np.arange(5000) % 200}
    return PointCloud(xyz + ORIGIN, more, crs=CRS, name="points")


def found() -> dict[str, Any]:
    ring = shapely.Polygon(
        [(10, 10, 3), (90, 10, 3), (90, 90, 3), (10, 90, 3)],
        [[(40, 40, 3), (60, 40, 3), (60, 60, 3), (40, 60, 3)]],
    )
    edge = shapely.LineString([(10, 10, 3), (90, 10, 3)])
    shore = shapely.LineString([(90, 10, 3), (90, 90, 3)])
    corners = [shapely.Point(k / 100, 10, 3) for k in range(3500)]
    return {
        "water": layer([ring], body=[1]),
        "shoreline": layer([edge, shore], kind=["data edge", "shore"]),
        "vertices": layer(corners),
    }


def test_a_large_layer_takes_no_features_from_a_small_one() -> None:
    ((title, plot),) = maps_of(SPEC, found(), {"points": cloud()})
    assert title == "Map"
    water, shoreline, vertices = plot.data["layers"]
    assert {g["name"]: len(g["features"]) for g in shoreline["groups"]} == {
        "edge of the data, no shore": 1,
        "shore": 1,
    }
    assert len(vertices["groups"][0]["features"]) == 3000
    assert "500 features have no room" in plot.picture.caption
    assert (water["hidden"], vertices["hidden"]) == (False, True)
    colours = [g["colour"] for part in plot.data["layers"] for g in part["groups"]]
    assert len(set(colours)) == len(colours) == 4


@pytest.mark.parametrize(("known", "pictures"), [(3, []), (60, ["Difference of strips"])])
def test_a_raster_with_hardly_a_cell_has_no_picture_on_paper(
    known: int, pictures: list[str]
) -> None:
    """As of the difference of strips that hardly overlap: it was blank."""
    cells = np.full((40, 40), np.nan)
    cells.flat[:known] = 0.02
    made = {
        "density": Raster(np.ones((40, 40)), Affine(1, 0, 0, 0, -1, 40), crs=CRS),
        "strip_difference": Raster(cells, Affine(1, 0, 0, 0, -1, 40), crs=CRS),
    }
    ((_, plot),) = maps_of(catalog.load("points.survey_quality"), made, {})
    assert [base["name"] for base in plot.data["bases"]][1:] == ["Difference of strips"]
    assert [figure.caption for figure in plot.others()] == pictures


def test_areas_lie_below_lines_and_what_was_found_has_the_first_colour() -> None:
    """The water that was found is blue, the map that it is compared with is red."""
    ((_, plot),) = maps_of(SPEC, dict(reversed(found().items())), {"points": cloud()})
    shapes = [part["groups"][0]["shape"] for part in plot.data["layers"]]
    assert shapes == ["area", "line", "point"]
    lake = layer([shapely.box(0, 0, 50, 50)])
    spec = catalog.load("models.reservoir_storage")
    ((_, plot),) = maps_of(spec, {"water": found()["water"]}, {"reference": lake})
    colours = {part["name"]: part["groups"][0]["colour"] for part in plot.data["layers"]}
    assert colours == {"Water": OfClass(9).colour, "Reference": "#d7261e"}


def test_things_have_the_colour_of_their_class_on_maps_in_space_and_in_dialogs() -> None:
    spec = catalog.load("models.urban_classes")
    square = [(10, 10, 3), (20, 10, 3), (20, 20, 3), (10, 20, 3)]
    made = {
        "outlines": layer([shapely.Polygon(square)]),
        "tree_tops": layer([shapely.Point(1, 1, 9)]),
    }
    expected = {"outlines": OfClass(6).colour, "tree_tops": OfClass(5).colour}
    ((_, plot),) = maps_of(spec, made, {"points": cloud()})
    seen = {part["table"]: part["groups"][0]["colour"] for part in plot.data["layers"]}
    assert [seen[anchor_of(name)] for name in made] == list(expected.values())
    space = space_of(spec, made, {"points": cloud()})
    assert space is not None
    assert {one["colour"] for one in space.data["lines"]} == set(expected.values())
    asked = {f["name"]: f.get("colour") for f in tool(spec)["outputs"]}
    assert {name: asked[name] for name in made} == expected


def test_parts_in_colours_of_their_height_are_outlines_above_classes() -> None:
    """Their fill lay over the colours of the classes, and neither could be read."""
    spec = catalog.load("models.urban_classes")
    houses = layer([shapely.box(0, 0, 9, 9), shapely.box(20, 0, 40, 30)], height=[3.0, 9.0])
    points = cloud().with_attributes({"classification": np.full(5000, 6, np.uint8)})
    made = {"building_parts": houses, "outlines": houses}
    for below, is_open in ((points, True), (cloud(), False)):
        ((_, plot),) = maps_of(spec, made, {"points": below.without_attributes(["intensity"])})
        groups = {g["name"]: g["open"] for one in plot.data["layers"] for g in one["groups"]}
        assert groups.pop("Outlines of buildings") is False
        assert set(groups.values()) == {is_open}


def test_waters_have_their_numbers_on_the_map() -> None:
    """Tables and warnings name them by number, and no map told which is which."""
    ponds = [shapely.box(0, 0, 9, 9), shapely.box(20, 20, 60, 60)]
    spec = catalog.load("shoreline.extract")
    ((_, plot),) = maps_of(spec, {"water": layer(ponds, body=[2, 1])}, {"points": cloud()})
    (water,) = plot.data["layers"]
    west, south, east, north = plot.data["bounds"]
    found = [(text, west < x < east, south < y < north) for x, y, text in water["texts"]]
    assert found == [("1", True, True), ("2", True, True)]
    many = layer([shapely.box(k, 0, k + 1, 9) for k in range(99)], body=list(range(99)))
    ((_, plot),) = maps_of(spec, {"water": many}, {"points": cloud()})
    assert len(plot.data["layers"][0]["texts"]) == 30, "more would lie on each other"


def test_errors_lie_above_the_checkpoints_that_they_are_of() -> None:
    spots = [shapely.Point(10, 10, 3), shapely.Point(20, 10, 3)]
    shown = {"errors": layer(spots, error=[-0.1, 0.1])}
    ((_, plot),) = maps_of(catalog.load("compare.surfaces"), shown, {"checkpoints": layer(spots)})
    assert [part["name"] for part in plot.data["layers"]] == ["Checkpoints", "Errors"]


def test_holes_turn_the_other_way_so_that_they_stay_empty() -> None:
    ((_, plot),) = maps_of(SPEC, found(), {})
    ((row, (outer, hole)),) = plot.data["layers"][0]["groups"][0]["features"]
    origin = np.array([plot.data["x0"], plot.data["y0"]])
    turns = [shapely.LinearRing(np.reshape(ring, (-1, 2))).is_ccw for ring in (outer, hole)]
    assert row == 0
    assert turns[0] != turns[1]
    assert np.allclose(np.reshape(outer, (-1, 2)).min(axis=0) + origin, ORIGIN[:2] + 10)


def test_layers_that_lie_elsewhere_have_a_map_of_their_own() -> None:
    drawing = Vector(geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 5, 3)]))
    made = dict(maps_of(SPEC, {**found(), "vertices": drawing}, {"points": cloud()}))
    assert list(made) == ["Map", "Drawing: vertices"]
    assert made["Drawing: vertices"].data["bases"] == []
    assert not made["Drawing: vertices"].data["north"]


def test_a_drawing_in_its_own_coordinates_lies_on_no_other_map() -> None:
    """Although it has the same local coordinates as the points, and meets them."""
    local = parse_crs("local")
    spec = catalog.load("planes.extract")
    points = cloud().with_xyz(cloud().xyz - ORIGIN).with_crs(local)
    front = geopandas.GeoDataFrame({"kind": ["facade"]}, geometry=[shapely.box(0, 0, 9, 5)])
    made = {"elevation": Vector(front.set_crs(local))}
    titles = [title for title, _ in maps_of(spec, made, {"points": points})]
    assert titles == ["Map", "Drawing: elevation"]


def unpacked(places: dict[str, Any]) -> Any:
    """Places of a view, of shape (n, 3)."""
    return places["step"] * np.frombuffer(base64.b64decode(places["packed"]), "<i2").reshape(-1, 3)


def test_the_view_holds_points_to_a_centimetre_and_fills_areas() -> None:
    plot = space_of(SPEC, found(), {"points": cloud()})
    assert plot is not None
    data = plot.data
    (points,) = data["clouds"]
    assert np.abs(unpacked(points["xyz"]) + data["origin"] - cloud().xyz).max() < 0.01
    (water,) = data["meshes"]
    corners = unpacked(water["xyz"]).reshape(-1, 3, 3)
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert area.sum() / 2 == pytest.approx(80 * 80 - 20 * 20, abs=0.5)
    names = [line["name"] for line in data["lines"]]
    assert names == ["Water", "Shoreline: edge of the data, no shore", "Shoreline: shore"]
    assert water["name"] == "Water, filled"
    assert "filled" not in plot.picture.caption


def test_the_view_has_a_key_of_its_colours_for_paper() -> None:
    """A print had the picture, and nobody knew what its colours mean."""
    plot = space_of(SPEC, found(), {"points": cloud()})
    assert plot is not None
    heights, *lines = plot.data["key"]
    assert (heights["label"], len(heights["ramp"])) == ("Elevation (m)", 9)
    low, high = (float(heights[end].split()[-1]) for end in ("low", "high"))
    assert low == pytest.approx(0.05, abs=0.05)
    assert high == pytest.approx(9.95, abs=0.05)
    drawn = [(line["name"], line["colour"]) for line in plot.data["lines"]]
    assert [(one["name"], one["colour"]) for one in lines] == drawn
    report = Report("View", [Section("3-D view", [plot])])
    for on_paper in (True, False):
        key = render(report, on_paper=on_paper).partition('<ul class="key still">')[2]
        said = key.partition("</ul>")[0]
        assert "linear-gradient(to right, #62a392" in said
        assert all(f'{colour}"></i>{name}</li>' in said for name, colour in drawn)


def test_lines_of_the_view_are_small_and_one_that_goes_far_leaves_the_points_sharp() -> None:
    """A page of contours had 10 MB: each height of a line stood there in decimals."""
    bends = [(k / 10, 50 + np.sin(k / 7), 3 + k / 9000) for k in range(900)]
    long, short = shapely.LineString([*bends, (40_000, 50, 3)]), shapely.LineString(bends[:2])
    made = {"shoreline": layer([long, short], kind=["shore", "shore"])}
    plot = space_of(SPEC, made, {"points": cloud()})
    assert plot is not None
    (points,), (line,) = plot.data["clouds"], plot.data["lines"]
    assert line["sizes"] == [901, 2]
    assert np.abs(unpacked(points["xyz"]) + plot.data["origin"] - cloud().xyz).max() < 0.01
    expected = np.array([*bends, (40_000, 50, 3), *bends[:2]]) + ORIGIN - plot.data["origin"]
    assert np.abs(unpacked(line["xyz"]) - expected).max() < 40_000 / 32_000
    assert len(json.dumps(line)) < 9 * 903, "bytes: 8 a place, and its name"


def test_the_same_layers_make_the_same_plots() -> None:
    given = {"points": cloud()}
    one, other = (list(maps_of(SPEC, found(), given)) for _ in range(2))
    assert one == other
    assert space_of(SPEC, found(), given) == space_of(SPEC, found(), given)


def test_there_is_no_plot_where_nothing_has_a_place() -> None:
    assert list(maps_of(SPEC, {"level": 3.0}, {})) == []
    assert space_of(SPEC, {"level": 3.0}, {}) is None


def test_a_wall_has_no_map_since_it_is_a_stroke_from_above() -> None:
    """A page of the report was a line of 20 m; a wire is as narrow, and its map is looked at."""
    wall = shapely.Polygon([(10, 10, 0), (30, 10.2, 0), (30, 10.2, 9), (10, 10, 9)])
    corner = shapely.Polygon([(30, 10, 0), (30, 30, 0), (30, 30, 9), (30, 10, 9)])
    wire = shapely.LineString([(10, 10, 12), (60, 10, 8), (90, 10, 12)])
    spec = catalog.load("planes.extract")
    for shapes, titles in (([wall], []), ([wall, corner], ["Map"]), ([wire], ["Map"])):
        made = maps_of(spec, {"planes": layer(shapes)}, {"points": cloud()})
        assert [title for title, _ in made] == titles
