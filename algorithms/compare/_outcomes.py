"""Values of the attributes "error" and "difference", which comparisons give to points.

The words are those of Sithole and Vosselman (2004), with ground as the class of interest; the
colours those of Şen and Bayaslı (2020).
"""

from __future__ import annotations

from collections.abc import Mapping

CORRECT_POSITIVE, CORRECT_NEGATIVE, TYPE_1, TYPE_2, NO_REFERENCE, OTHER_CLASS = range(6)
IN_BOTH, IN_NEITHER, REFERENCE_ALONE, FOUND_ALONE = range(4)

_NOT_KNOWN = "No reference", "#f0dfae"
OUTCOMES: Mapping[int, tuple[str, str]] = {
    CORRECT_POSITIVE: ("Ground, correct", "#d4d4d4"),
    CORRECT_NEGATIVE: ("Object, correct", "#6e6e6e"),
    TYPE_1: ("Type I: ground missed", "#2166d1"),
    TYPE_2: ("Type II: object taken for ground", "#d7261e"),
    NO_REFERENCE: _NOT_KNOWN,
    OTHER_CLASS: ("Another class than in the reference", "#f08c1a"),
}
"""Name and colour of each value of "error", in a comparison of classes."""

DIFFERENCES: Mapping[int, tuple[str, str]] = {
    IN_BOTH: ("In both", "#d4d4d4"),
    IN_NEITHER: ("In neither", "#6e6e6e"),
    REFERENCE_ALONE: ("In the reference alone", "#2166d1"),
    FOUND_ALONE: ("Found alone, or elsewhere", "#d7261e"),
    NO_REFERENCE: _NOT_KNOWN,
}
"""Name and colour of each value of "difference", of things that are found, such as planes."""
