"""DXF drawings hold all that a layer has, for CAD."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import ezdxf
import geopandas
import numpy as np
import pytest
import shapely

from toolbox.data import Vector, dxf
from toolbox.data.crs import parse_crs
from toolbox.errors import DataError

X, Y = 700_000.123, 6_600_000.456
RING = np.array([[X, Y], [X + 9, Y], [X + 9, Y + 9], [X, Y + 9]])
HOLE = RING[[0, 3, 2, 1]] * 0.5 + RING.mean(axis=0) * 0.5
SOLID = [(X, Y, 1.5), (X + 1, Y, 2.5), (X + 2, Y + 1, 4.25)]


def drawn(path: Path, shapes: list[Any], crs: Any = "EPSG:2154", **columns: Any) -> Any:
    crs = parse_crs(crs) if crs else None
    Vector(geopandas.GeoDataFrame(columns, geometry=shapes, crs=crs)).save(path)
    return ezdxf.readfile(path)


def test_points_lines_and_polygons(tmp_path: Path) -> None:
    shapes = [shapely.Point(SOLID[0]), shapely.LineString(SOLID), shapely.Polygon(RING, [HOLE])]
    entities = [*drawn(tmp_path / "a.dxf", shapes, n=[1, 2, 3]).modelspace()]
    kinds = ["POINT", "POLYLINE", "LWPOLYLINE", "LWPOLYLINE"]
    assert [e.dxftype() for e in entities] == kinds
    assert tuple(entities[0].dxf.location) == SOLID[0]
    assert [tuple(v.dxf.location) for v in entities[1].vertices] == SOLID
    assert entities[1].is_closed is False
    assert np.array_equal(np.array(entities[2].get_points("xy")), RING)
    assert np.array_equal(np.array(entities[3].get_points("xy")), HOLE)
    assert entities[2].closed
    assert entities[3].closed


def test_solid_ring_is_closed_without_its_first_corner_twice(tmp_path: Path) -> None:
    wall = shapely.Polygon([(X, Y, 0), (X + 1, Y, 0), (X + 1, Y, 3), (X, Y, 3)])
    (entity,) = drawn(tmp_path / "a.dxf", [shapely.MultiPolygon([wall])]).modelspace()
    assert entity.is_closed
    assert [v.dxf.location.z for v in entity.vertices] == [0, 0, 3, 3]


def test_attributes_and_layers(tmp_path: Path) -> None:
    shapes = [shapely.Point(0, 0), shapely.Point(1, 1)]
    columns = {"layer": ["Wall é", None], "n": [1, 2], "note": [None, "a=b"]}
    drawing = drawn(tmp_path / "roofs.dxf", shapes, **columns)
    entities = [*drawing.modelspace()]
    assert [e.dxf.layer for e in entities] == ["Wall é", "roofs"]
    texts = [[tag.value for tag in e.get_xdata("LIDAR-TOOLBOX")] for e in entities]
    assert texts == [["layer=Wall é", "n=1"], ["n=2", "note=a=b"]]


def test_kinds_are_layers(tmp_path: Path) -> None:
    shapes = [shapely.Point(k, 0) for k in range(3)]
    columns = {"layer": ["a", None, None], "kind": ["door", "door", None]}
    drawing = drawn(tmp_path / "front.dxf", shapes, **columns)
    assert [e.dxf.layer for e in drawing.modelspace()] == ["a", "door", "front"]
    listed = {layer.dxf.name: layer.dxf.color for layer in drawing.layers}
    assert {"a", "door", "front"} <= listed.keys()
    assert listed["door"] != listed["front"]


def test_kinds_of_several_words_are_one_name(tmp_path: Path) -> None:
    drawing = drawn(tmp_path / "a.dxf", [shapely.Point(0, 0)], kind=["door or window"])
    assert [e.dxf.layer for e in drawing.modelspace()] == ["door_or_window"]


@pytest.mark.parametrize(
    "together",
    [
        ("walls", "openings", "unseen", "dimensions", "levels", "numbers", "title"),
        ("door", "window", "door_or_window"),
        ("contours", "contours_index"),
        ("wires", "towers", "crossings"),
    ],
)
def test_a_layer_has_one_colour_in_all_drawings(tmp_path: Path, together: tuple[str, ...]) -> None:
    """Offices plot by colour. Layers of one drawing differ, whatever comes first in it."""
    found = []
    for number, names in enumerate((together, together[::-1], together[1:])):
        shapes = [shapely.Point(k, 0) for k in range(len(names))]
        drawing = drawn(tmp_path / f"{number}.dxf", shapes, layer=list(names))
        found.append({name: drawing.layers.get(name).dxf.color for name in names})
    assert found[0] == found[1]
    assert found[2].items() <= found[0].items()
    assert len(set(found[0].values())) == len(together)


@pytest.mark.parametrize(
    ("crs", "code"),
    [
        *[("EPSG:2154", 6), ("EPSG:2227", 21), ("EPSG:2256", 2), ("EPSG:4326", 0), (None, 0)],
        *[("local", 6), ("local:mm", 4), ("local:cm", 5), ("local:ft", 2)],
    ],
)
def test_unit(tmp_path: Path, crs: str | None, code: int) -> None:
    drawing = drawn(tmp_path / "a.dxf", [shapely.Point(0, 0)], crs)
    assert drawing.header["$INSUNITS"] == code


@pytest.mark.parametrize(
    ("columns", "problem"),
    [
        ({"note": ["é" * 127]}, "attributes of at most 255 bytes each"),
        ({f"n{i}": ["x" * 200] for i in range(90)}, "16000 together"),
        ({"layer": ["a;b"]}, r"a DXF layer cannot be called 'a;b'"),
        ({"layer": ["a\n  0\nLINE"]}, r"a DXF layer cannot be called 'a\\n"),
        ({"note": ["a\n  0\nLINE"]}, r"no line breaks and control characters, as in 'note=a\\n"),
        ({"note": ["a\rb"]}, "no line breaks"),
        ({"note": ["a\x00b"]}, "no line breaks"),
        ({"note": ["a\x85b"]}, "no line breaks"),
        ({"note\nb": ["a"]}, "no line breaks"),
    ],
)
def test_what_a_drawing_cannot_hold(tmp_path: Path, columns: Any, problem: str) -> None:
    with pytest.raises(DataError, match=problem):
        drawn(tmp_path / "a.dxf", [shapely.Point(0, 0)], **columns)
    assert not (tmp_path / "a.dxf").exists()


def test_empty_layer(tmp_path: Path) -> None:
    assert len(drawn(tmp_path / "a.dxf", []).modelspace()) == 0


def test_a_drawing_opens_where_its_entities_are(tmp_path: Path) -> None:
    drawing = drawn(tmp_path / "a.dxf", [shapely.LineString(SOLID), shapely.Polygon(RING)])
    assert drawing.header["$EXTMIN"] == pytest.approx((X, Y, 0))
    assert drawing.header["$EXTMAX"] == pytest.approx((X + 9, Y + 9, 4.25))
    (view,) = drawing.viewports.get("*Active")
    assert tuple(view.dxf.center)[:2] == pytest.approx((X + 4.5, Y + 4.5))
    assert 9 < view.dxf.height < 12


def test_an_empty_drawing_is_written(tmp_path: Path) -> None:
    drawn(tmp_path / "a.dxf", [])


def test_severities_have_layers_and_colours_of_their_own(tmp_path: Path) -> None:
    shapes = [shapely.Point(k, 0) for k in range(7)]
    columns = {
        "layer": [
            *("wires", "objects", "objects", "objects_labels", "crossings"),
            *("objects", "objects_labels"),
        ],
        "severity": [None, "watch", "critical", "critical", "kept", "not sure", "not sure"],
        "text": [None, None, None, "7", None, None, "8"],
    }
    drawing = drawn(tmp_path / "line.dxf", shapes, **columns)
    found = [(e.dxf.layer, e.dxftype()) for e in drawing.modelspace()]
    assert found == [
        ("wires", "POINT"),
        ("objects_watch", "POINT"),
        ("objects_critical", "POINT"),
        ("objects_labels_critical", "TEXT"),
        ("crossings_kept", "POINT"),
        ("objects_not_sure", "POINT"),
        ("objects_labels_not_sure", "TEXT"),
    ]
    colours = {layer.dxf.name: layer.dxf.color for layer in drawing.layers}
    assert (colours["objects_critical"], colours["objects_labels_critical"]) == (1, 1)
    assert colours["objects_watch"] == 52
    assert colours["objects_not_sure"] == colours["objects_labels_not_sure"]
    assert len({colours[name] for name in ("wires", "objects_critical", "crossings_kept")}) == 3


def test_what_has_no_rule_has_a_colour_of_its_own(tmp_path: Path) -> None:
    found = ["critical", "warning", "watch", "not sure", "no rule"]
    shapes = [shapely.Point(k, 0) for k in range(len(found))]
    drawing = drawn(tmp_path / "line.dxf", shapes, layer=["objects"] * 5, severity=found)
    colours = {layer.dxf.name: layer.dxf.color for layer in drawing.layers}
    names = [f"objects_{one.replace(' ', '_')}" for one in found]
    assert len({colours[name] for name in names}) == 5
    assert colours["objects_no_rule"] == 8, "grey, whatever the layer is called"


def test_labels_have_the_colour_of_what_they_name(tmp_path: Path) -> None:
    shapes = [shapely.Point(k, 0) for k in range(3)]
    columns = {"layer": ["wires", "towers", "towers_labels"], "text": [None, None, "1"]}
    drawing = drawn(tmp_path / "line.dxf", shapes, **columns)
    colours = {layer.dxf.name: layer.dxf.color for layer in drawing.layers}
    assert colours["towers"] == colours["towers_labels"] != colours["wires"]


def test_index_contours_are_apart_and_heavier(tmp_path: Path) -> None:
    shapes = [shapely.LineString(SOLID), shapely.LineString(SOLID), shapely.Point(0, 0)]
    columns = {"layer": ["contours"] * 2 + ["labels"], "is_index": [True, False, None]}
    drawing = drawn(tmp_path / "a.dxf", shapes, **columns)
    layers = [e.dxf.layer for e in drawing.modelspace()]
    assert layers == ["contours_index", "contours", "labels"]
    heavy, usual = (drawing.layers.get(name).dxf.lineweight for name in layers[:2])
    assert heavy > max(usual, 25), "25 is the usual width of lines in CAD"


def test_layers_are_told_as_they_are_written(tmp_path: Path) -> None:
    rows = {"layer": ["walls", "walls", "objects"], "severity": [None, None, "warning"]}
    frame = geopandas.GeoDataFrame(rows, geometry=[shapely.Point(k, 0) for k in range(3)])
    told = dxf.layers_of(frame, tmp_path / "a.dxf")
    assert {name: count for name, (_, count) in told.items()} == {"walls": 2, "objects_warning": 1}
    Vector(frame).save(tmp_path / "a.dxf")
    written = ezdxf.readfile(tmp_path / "a.dxf").layers
    assert {name: written.get(name).dxf.color for name in told} == {
        name: colour for name, (colour, _) in told.items()
    }
    assert dxf.colour_name(told["objects_warning"][0]) == "orange (30)"


def test_every_colour_has_a_name() -> None:
    for colour in (*dxf._OTHERS, *dxf._OF_LAYER.values(), *dxf._OF_SEVERITY.values()):
        assert dxf.colour_name(colour).endswith(f" ({colour})")


def test_a_line_with_a_text_is_a_dimension(tmp_path: Path) -> None:
    """Dimensions were lines and texts, which nobody can stretch or edit in CAD."""
    frame = geopandas.GeoDataFrame(
        {"layer": ["dimensions"] * 2, "text": ["3.00", "4,000"], "text_height": [0.25] * 2},
        geometry=[shapely.LineString([(1, 2), (4, 2)]), shapely.LineString([(0, 0), (0, 4)])],
    )
    dxf.write(frame, tmp_path / "a.dxf", "a")
    found = ezdxf.readfile(tmp_path / "a.dxf")  # type: ignore[attr-defined]
    across, up = found.modelspace().query("DIMENSION")
    assert [one.get_measurement() for one in (across, up)] == pytest.approx([3.0, 4.0])
    written = [one.virtual_entities() for one in (across, up)]
    said = [[e.text for e in drawn if e.dxftype() == "MTEXT"] for drawn in written]
    assert said == [["3.00"], ["4,000"]], "with the decimals of the text"
    blocks = [one.get_geometry_block() for one in (across, up)]
    layers = {part.dxf.layer for block in blocks for part in block}
    assert layers == {"dimensions", "Defpoints"}, "viewers draw what is on layer 0 black"
    sizes = {found.header["$DIMTXT"], found.dimstyles.get(across.dxf.dimstyle).dxf.dimtxt}
    assert sizes == {0.25}, "LibreCAD reads no other"
    assert not found.audit().errors


def test_edges_of_the_data_are_broken_lines(tmp_path: Path) -> None:
    frame = geopandas.GeoDataFrame(
        {"layer": ["walls", "data_edge"]},
        geometry=[
            shapely.LineString([(0, 0), (9, 0)]),
            shapely.LineString([(9, 0), (9, 5), (0, 5)]),
        ],
    )
    dxf.write(frame, tmp_path / "a.dxf", "a")
    layers = ezdxf.readfile(tmp_path / "a.dxf").layers  # type: ignore[attr-defined]
    assert layers.get("data_edge").dxf.linetype == "DASHED"
    assert layers.get("walls").dxf.linetype == "Continuous"


def test_the_edge_of_the_data_is_no_part_of_a_shore_in_a_drawing(tmp_path: Path) -> None:
    """A client took the edge of the survey for the shore of a lake, as both were one layer."""
    frame = geopandas.GeoDataFrame(
        {"layer": ["shoreline"] * 2 + ["walls"], "kind": ["shore", "data edge", "facade"]},
        geometry=[shapely.LineString([(k, 0), (k, 9)]) for k in range(3)],
    )
    dxf.write(frame, tmp_path / "a.dxf", "a")
    drawn = ezdxf.readfile(tmp_path / "a.dxf").modelspace()  # type: ignore[attr-defined]
    assert [one.dxf.layer for one in drawn] == ["shoreline", "data_edge", "walls"]
    assert dxf.layers_of(frame, tmp_path / "a.dxf")["data_edge"] == (8, 1)
