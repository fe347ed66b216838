"""DXF drawings hold all that a layer has, for CAD."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import ezdxf
import geopandas
import numpy as np
import pytest
import shapely

from toolbox.data import Vector
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
    assert len({listed[name] for name in ("a", "door", "front")}) == 3


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
