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
