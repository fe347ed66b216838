"""Styles for QGIS; that it reads them is seen in tests/qgis/inside.py."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import geopandas
import pytest
import shapely

from toolbox.data import Vector
from toolbox.declare.show import Classes, Isolines, OfClass, Show, Texts
from toolbox.pictures.qml import style

SQUARE, LINE, DOT = (
    shapely.box(0, 0, 9, 9),
    shapely.LineString([(0, 0), (9, 9)]),
    shapely.Point(1, 2),
)


def styled(geometry: Any, show: Show | None = None, **columns: Any) -> ElementTree.Element:
    frame = geopandas.GeoDataFrame(columns, geometry=geometry, crs=32635)
    return ElementTree.fromstring(style(Vector(frame), [show] if show else []))


def options(found: ElementTree.Element, name: str) -> list[str]:
    return [o.attrib["value"] for o in found.iter("Option") if o.get("name") == name]


@pytest.mark.parametrize(
    ("geometry", "kind", "name"),
    [(SQUARE, "fill", "outline_color"), (LINE, "line", "line_color"), (DOT, "marker", "color")],
)
def test_features_have_the_colour_of_their_class(geometry: Any, kind: str, name: str) -> None:
    made = styled([geometry], OfClass(9))
    renderer = made.find("renderer-v2")
    assert renderer is not None
    assert renderer.attrib["type"] == "singleSymbol"
    assert [symbol.attrib["type"] for symbol in made.iter("symbol")] == [kind]
    assert options(made, name)[0] == "52,101,146,255"
    assert options(styled([geometry]), name)[0] == "31,58,95,255", "that of our plots"


def test_areas_leave_the_picture_below_to_be_seen() -> None:
    assert options(styled([SQUARE], OfClass(9)), "color") == ["52,101,146,102"]


def test_words_have_their_colours_and_names() -> None:
    looks = {"tree": ("Trees, high", "#102030")}
    made = styled([DOT] * 4, Classes("kind", looks), kind=["tree", "pole", None, "tree"])
    found = [(c.attrib["value"], c.attrib["label"]) for c in made.iter("category")]
    assert found == [("pole", "pole"), ("tree", "Trees, high"), ("", "not known")]
    assert options(made, "color")[1:] == ["16,32,48,255", "154,154,154,255"]
    made = styled([DOT] * 2, Classes("kind", looks), kind=["tree", "pole"])
    assert "" not in [c.attrib["value"] for c in made.iter("category")], "all are known"


def test_yes_and_no_are_those_of_qgis() -> None:
    made = styled([DOT] * 3, Classes("seen", {}), seen=[True, None, False])
    found = [(c.attrib["value"], c.attrib["type"]) for c in made.iter("category")]
    assert found == [("false", "bool"), ("true", "bool"), ("", "string")]


def test_characters_that_xml_does_not_have_are_replaced() -> None:
    made = styled([DOT], Classes("kind", {}), kind=["a\x0bb\x00 & \u0131"])
    assert [c.attrib["label"] for c in made.iter("category")] == ["a\ufffdb\ufffd & \u0131"]


def test_index_lines_are_heavy_and_have_their_height() -> None:
    show = Isolines("elevation", heavy="is_index")
    made = styled([LINE] * 2, show, elevation=[5.0, 6.0], is_index=[True, False])
    assert [c.attrib["value"] for c in made.iter("category")] == ["true", "false"]
    assert options(made, "line_width") == ["0.5", "0.15"]
    text = made.find("labeling/settings/text-style")
    assert text is not None
    assert text.attrib["fieldName"] == """if("is_index", round("elevation", 3), '')"""
    assert made.attrib["labelsEnabled"] == "1"


def test_texts_stand_at_their_angle_without_dots() -> None:
    made = styled([DOT], Texts("text", angle="angle"), text=["5"], angle=[30.0])
    renderer = made.find("renderer-v2")
    assert renderer is not None
    assert renderer.attrib["type"] == "nullSymbol"
    assert options(made, "expression") == ['-"angle"'], "QGIS turns clockwise"
