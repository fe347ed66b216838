"""Rows on two classifications of the same points."""

from __future__ import annotations

import numpy as np

from algorithms.compare._paired import paired_rows
from algorithms.shared.accuracy.blocks import Tallies


def test_a_class_called_of_interest_has_no_second_of() -> None:
    counts = np.array([[[8.0, 1.0], [2.0, 9.0]]] * 3)
    tallies = Tallies(counts, np.arange(3))
    rows = paired_rows(("all others", "of interest"), tallies, tallies, (1, 1, 1, 1), seed=0)
    names = {row["measure"] for row in rows}
    assert {"iou of all others", "iou of interest", "f1 of interest"} <= names
