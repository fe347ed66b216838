"""The point classes of the LAS format."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

CLASSES: Mapping[int, str] = MappingProxyType(
    {
        0: "Never classified",
        1: "Unclassified",
        2: "Ground",
        3: "Low vegetation",
        4: "Medium vegetation",
        5: "High vegetation",
        6: "Building",
        7: "Low point (noise)",
        8: "Model key-point",
        9: "Water",
        10: "Rail",
        11: "Road surface",
        12: "Overlap",
        13: "Wire - guard",
        14: "Wire - conductor",
        15: "Transmission tower",
        16: "Wire-structure connector",
        17: "Bridge deck",
        18: "High noise",
        19: "Overhead structure",
        20: "Ignored ground",
        21: "Snow",
        22: "Temporal exclusion",
    }
)
"""Name of each class: LAS 1.4 R15 (ASPRS 2019), table 17, with 8 and 12 as of LAS 1.2."""

NAMES: Mapping[int, str] = MappingProxyType(
    {**CLASSES, 26: "Bridges and quays in Dutch surveys"}  # the "kunstwerk" of the AHN
)
"""Those, and what a class that LAS reserves is in surveys of a whole country."""

COLOURS: Mapping[int, str] = MappingProxyType(
    {
        0: "#c9c9c9",
        1: "#a3a3a3",
        2: "#c2a477",
        3: "#b5d78f",
        4: "#74b356",
        5: "#2f7d3b",
        6: "#d0533f",
        7: "#e0399f",
        8: "#8a6036",
        9: "#4a90d0",
        10: "#4f4a52",
        11: "#7f828c",
        12: "#ddd0b4",
        13: "#f2d04b",
        14: "#f09d1a",
        15: "#7f3f98",
        16: "#b98bd0",
        17: "#e6955f",
        18: "#ff5ac8",
        19: "#a5688f",
        20: "#e0cfa6",
        21: "#dff0f8",
        22: "#c3c2dc",
        26: "#c07c74",
    }
)
"""Colour of each class in plots, drawings and QGIS."""


def class_name(code: int) -> str:
    """The name of a class, or who may give it one: LAS 1.4 R15, table 17.

    Examples
    --------
    >>> class_name(6), class_name(30), class_name(65)
    ('Building', 'Reserved by the ASPRS', 'Defined by the producer')
    >>> class_name(26)
    'Bridges and quays in Dutch surveys'
    """
    return NAMES.get(code, "Reserved by the ASPRS" if code < _OWN else "Defined by the producer")


def within_sentence(name: str) -> str:
    """The name of a class as it stands within a sentence.

    >>> within_sentence("Bridges and quays in Dutch surveys")
    'bridges and quays in Dutch surveys'
    """
    return name[:1].lower() + name[1:]


def class_label(code: int) -> str:
    """The name of a class, or its number.

    >>> class_label(6), class_label(30)
    ('Building', 'Class 30')
    """
    return NAMES.get(code, f"Class {code}")


_OWN = 64  # the first class that whoever makes a file may define
