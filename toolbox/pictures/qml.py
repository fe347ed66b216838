"""Styles of QGIS (QML) of vector layers, in the colours of our plots and maps.

References
----------
QGIS 3.22, QgsVectorLayer::writeSymbology: what it reads again of `renderer-v2` and `labeling`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np

from toolbox import language
from toolbox.data import Vector
from toolbox.declare.show import Classes, Isolines, Show, Texts, colour_of, is_thin
from toolbox.pictures.features import UNKNOWN, feature_key

_VERSION = "3.22.0"  # of QGIS, the oldest that the plugin knows
_LINE = "#1f3a5f"  # of layers that declare no colour, as in our plots
_THIN, _HEAVY, _DOT = 0.15, 0.5, 2.0  # millimetres
_TEXT, _EDGE = 7.0, 0.7  # points, and millimetres around letters
_SOLID, _LIGHT = 255, 102  # opacity; that of areas, as on the maps of reports
_SYMBOLS = (("marker", "SimpleMarker"), ("line", "SimpleLine"), ("fill", "SimpleFill"))
_OTHERS = ""  # value of the category of QGIS for features whose value has none, such as null
_NOT_IN_XML = r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"  # takes 10 ms to read
_INSTEAD = "\ufffd"
_OVER_POINT, _ALONG_LINE, _ON_LINE = "1", "2", "1"  # numbers of QgsPalLayerSettings, QgsLabeling

_Symbol = tuple[str, float]
"""Colour and width in millimetres."""
_Look = tuple[str, str, str, _Symbol]
"""Value, its type, label and symbol of a category."""


def style(layer: Vector, shows: Sequence[Show]) -> str:
    """The style of a layer: categories of an attribute, isolines, texts or one symbol.

    Parameters
    ----------
    shows : how the output is declared to be shown

    Examples
    --------
    >>> import geopandas, shapely
    >>> from toolbox.declare.show import OfClass
    >>> pond = Vector(geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 9, 9)], crs=32635))
    >>> 'value="52,101,146,102"' in style(pond, [OfClass(9)])
    True
    """
    made = ElementTree.Element("qgis", version=_VERSION, styleCategories="Symbology|Labeling")
    if not any(_as_declared(made, layer, show) for show in shows):
        renderer = ElementTree.SubElement(made, "renderer-v2", type="singleSymbol")
        width = _THIN if is_thin(shows) else _HEAVY
        _symbols(renderer, layer, [(colour_of(shows, _LINE), width)])
    return re.sub(_NOT_IN_XML, _INSTEAD, ElementTree.tostring(made, encoding="unicode"))


def _as_declared(made: ElementTree.Element, layer: Vector, show: Show) -> bool:
    """Add what a declaration asks for; whether it asks for more than a colour."""
    match show:
        case Isolines():
            _categories(made, layer, show.heavy, _of_isolines(show))
            expression = f'if("{show.heavy}", round("{show.attribute}", 3), \'\')'
            _labels(made, expression, placement=_ALONG_LINE, placementFlags=_ON_LINE)
        case Texts():
            ElementTree.SubElement(made, "renderer-v2", type="nullSymbol")
            _labels(made, f'"{show.text}"', placement=_OVER_POINT, angle=show.angle)
        case Classes() if isinstance(key := feature_key((layer, show)), Mapping):
            _categories(made, layer, show.attribute, list(_of_classes(layer, show, key)))
        case _:
            return False
    return True


def _of_classes(
    layer: Vector, show: Classes, key: Mapping[int, tuple[str, str]]
) -> Iterator[_Look]:
    """A category for each word, and one for features without any, as our maps have it."""
    values = layer.frame[show.attribute]
    found = {str(value): value for value in values.dropna().unique()}
    for word, (label, colour) in zip(sorted(found), key.values(), strict=True):
        if isinstance(found[word], bool | np.bool_):
            yield word.lower(), "bool", language.text(label), (colour, _HEAVY)
        else:
            yield word, "string", language.text(label), (colour, _HEAVY)
    if values.isna().any():
        yield _OTHERS, "string", language.text("not known"), (UNKNOWN, _HEAVY)


def _of_isolines(show: Isolines) -> list[_Look]:
    return [
        ("true", "bool", language.text("Index lines"), (show.colour, _HEAVY)),
        ("false", "bool", language.text("Lines between"), (show.colour, _THIN)),
    ]


def _categories(
    made: ElementTree.Element,
    layer: Vector,
    attribute: str,
    looks: Sequence[_Look],
) -> None:
    """A symbol for each value, given with its type, label and symbol."""
    renderer = ElementTree.SubElement(made, "renderer-v2", type="categorizedSymbol", attr=attribute)
    listed = ElementTree.SubElement(renderer, "categories")
    for number, (value, kind, label, _) in enumerate(looks):
        said = {"value": value, "type": kind, "label": label, "symbol": str(number)}
        ElementTree.SubElement(listed, "category", said, render="true")
    _symbols(renderer, layer, [symbol for *_, symbol in looks])


def _symbols(renderer: ElementTree.Element, layer: Vector, symbols: Iterable[_Symbol]) -> None:
    import shapely

    dimension = int(shapely.get_dimensions(layer.frame.geometry.to_numpy()).max(initial=0))
    kind, drawn = _SYMBOLS[dimension]
    listed = ElementTree.SubElement(renderer, "symbols")
    for number, (colour, width) in enumerate(symbols):
        symbol = ElementTree.SubElement(listed, "symbol", type=kind, name=str(number), alpha="1")
        within = ElementTree.SubElement(symbol, "layer", {"class": drawn}, enabled="1")
        _map(within, _looks(dimension, colour, width))


def _looks(dimension: int, colour: str, width: float) -> dict[str, str]:
    if dimension == 0:
        return {
            "name": "circle",
            "color": _rgba(colour),
            "outline_color": "255,255,255,255",
            "size": str(_DOT),
        }
    if dimension == 1:
        return {"line_color": _rgba(colour), "line_width": str(width)}
    edge = {"outline_color": _rgba(colour), "outline_width": str(width)}
    return {"color": _rgba(colour, _LIGHT), **edge}


def _rgba(colour: str, opacity: int = _SOLID) -> str:
    return ",".join(map(str, (*bytes.fromhex(colour.removeprefix("#")), opacity)))


def _labels(made: ElementTree.Element, expression: str, angle: str = "", **placement: str) -> None:
    """Small texts with a light edge, from an expression; at an angle that an attribute holds."""
    made.set("labelsEnabled", "1")
    labeling = ElementTree.SubElement(made, "labeling", type="simple")
    settings = ElementTree.SubElement(labeling, "settings")
    looks = {"fieldName": expression, "isExpression": "1", "fontSize": str(_TEXT)}
    text = ElementTree.SubElement(settings, "text-style", looks, textColor=_rgba(_LINE))
    edge = {"bufferDraw": "1", "bufferSize": str(_EDGE), "bufferColor": "255,255,255,255"}
    ElementTree.SubElement(text, "text-buffer", edge, bufferSizeUnits="MM")
    ElementTree.SubElement(settings, "placement", placement)
    if angle:  # QGIS turns clockwise
        turned = {"active": True, "expression": f'-"{angle}"', "type": 3}
        said = {"properties": {"LabelRotation": turned}}
        _map(ElementTree.SubElement(settings, "dd_properties"), said)


def _map(parent: ElementTree.Element, values: Mapping[str, Any], name: str = "") -> None:
    """A map of values, as Qt writes its variants."""
    made = ElementTree.SubElement(
        parent, "Option", {"type": "Map"} | ({"name": name} if name else {})
    )
    for key, value in values.items():
        match value:
            case Mapping():
                _map(made, value, key)
            case bool():
                said = str(value).lower()
                ElementTree.SubElement(made, "Option", name=key, type="bool", value=said)
            case _:
                kind = "int" if isinstance(value, int) else "QString"
                ElementTree.SubElement(made, "Option", name=key, type=kind, value=str(value))
