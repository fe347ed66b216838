"""Reads and writes the XML of a QGIS model file: values as elements ``Option``.

The layout is that of `QgsXmlUtils`; it is the same from QGIS 3.22 to 3.40.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

LARGEST = 2**31
WHOLE = ("int", "uint", "longlong", "qlonglong", "ulonglong", "qulonglong")


@dataclass(frozen=True)
class Foreign:
    """A value of a type that only QGIS has, such as a colour or a property."""

    type: str


def text(value: Mapping[str, Any]) -> str:
    """Write a model as the text of its file."""
    root = _element(value)
    ET.indent(root, "  ")
    return "<!DOCTYPE model>\n" + ET.tostring(root, encoding="unicode") + "\n"


def value(text: str) -> Any:
    """Read a model from the text of its file.

    Raises
    ------
    ValueError
        It is not XML.
    """
    try:
        return _value(ET.fromstring(text))
    except ET.ParseError as err:
        raise ValueError(str(err)) from None


def _element(value: Any, name: str | None = None) -> ET.Element:
    made = ET.Element("Option")
    if name is not None:
        made.set("name", name)
    if isinstance(value, Mapping | list | tuple):
        _fill(made, value)
        return made
    type, shown = _scalar(value)
    made.set("type", type)
    if shown is not None:
        made.set("value", shown)
    return made


def _fill(made: ET.Element, value: Any) -> None:
    """Fill the element of a map or list; an empty one has no type."""
    if not value:
        return
    if isinstance(value, Mapping):
        made.set("type", "Map")
        made.extend(_element(value[key], key) for key in sorted(value))
        return
    texts = all(isinstance(item, str) for item in value)
    made.set("type", "StringList" if texts else "List")
    made.extend(_element(item) for item in value)


def _scalar(value: Any) -> tuple[str, str | None]:
    if value is None:
        return "invalid", None
    if isinstance(value, bool):
        return "bool", str(value).lower()
    if isinstance(value, int):
        return ("int" if -LARGEST <= value < LARGEST else "qlonglong"), str(value)
    if isinstance(value, float):
        return "double", repr(value)
    if isinstance(value, str):
        return "QString", value
    raise TypeError(f"{type(value).__name__} has no place in a model of QGIS")


def _value(element: ET.Element) -> Any:
    type = element.get("type")
    inner = [child for child in element if child.tag == "Option"]
    if type == "Map":
        return {child.get("name", ""): _value(child) for child in inner}
    if type in ("List", "StringList"):
        return [_value(child) for child in inner]
    return {} if type is None else _plain(element, type)


def _plain(element: ET.Element, type: str) -> Any:
    shown = element.get("value", "")
    read: dict[str, Callable[[], Any]] = {
        "invalid": lambda: None,
        "QString": lambda: shown,
        "double": lambda: float(shown),
        "bool": lambda: shown == "true",
        "QgsCoordinateReferenceSystem": lambda: element.findtext(".//authid") or Foreign(type),
    }
    read |= dict.fromkeys(WHOLE, lambda: int(shown))
    return read[type]() if type in read else Foreign(type)
