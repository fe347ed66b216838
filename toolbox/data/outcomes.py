"""Values of the attributes "error" and "difference", which comparisons give to points.

The words are those of Sithole and Vosselman (2004), with ground as the class of interest.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

CORRECT_POSITIVE, CORRECT_NEGATIVE, TYPE_1, TYPE_2, NO_REFERENCE = range(5)

OUTCOMES: Mapping[int, str] = MappingProxyType(
    {
        CORRECT_POSITIVE: "Ground, correct",
        CORRECT_NEGATIVE: "Object, correct",
        TYPE_1: "Type I: ground missed",
        TYPE_2: "Type II: object taken for ground",
        NO_REFERENCE: "No reference",
    }
)
"""Name of each value."""

IN_BOTH, IN_NEITHER, REFERENCE_ALONE, FOUND_ALONE = range(4)

DIFFERENCES: Mapping[int, str] = MappingProxyType(
    {
        IN_BOTH: "In both",
        IN_NEITHER: "In neither",
        REFERENCE_ALONE: "In the reference alone",
        FOUND_ALONE: "Found alone, or elsewhere",
        NO_REFERENCE: "No reference",
    }
)
"""The same for things that are found, such as planes: values of the attribute "difference"."""
