"""Rows of the tables in which the accuracy of classes is told."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from algorithms.compare._counts import Counts
from algorithms.shared.accuracy.blocks import Clumping, Floats, Tallies, intervals
from algorithms.shared.accuracy.confusion import (
    CLASS_MEASURES,
    MEASURES,
    Confusion,
    class_measures,
    measures,
)
from algorithms.shared.accuracy.samples import Estimate, Estimates
from toolbox.errors import DataError

AREA = re.compile(r"\s*(.+?)\s*=\s*([0-9.eE+]+)\s*")
OF_STRATA = "overall_accuracy", "mean_f1", "mean_iou", "kappa"

Row = dict[str, Any]


def rows(confusion: Confusion, by_block: Tallies, side: float | None, seed: int) -> Iterator[Row]:
    """Measures of all classes, with the intervals of blocks with a side in metres."""
    spread = intervals(by_block, measures, seed)
    for name, value in confusion.measures().items():
        unit, meaning = MEASURES[name]
        row = {"measure": name, "value": value} | limits(spread[name])
        yield row | {"unit": unit, "meaning": meaning}
    yield _count("points", int(confusion.counts.sum()), "points", "compared")
    yield _count("blocks", len(by_block.counts), "1", "drawn in squares of four for the intervals")
    yield _count("block", side, "m", "side of the blocks")
    found = Clumping.of(by_block)
    text = "variance of squares of four blocks, of that of blocks; 1 if blocks are independent"
    yield _count("growth", found and found.growth, "1", text)
    text = "so many independent errors would vary as much"
    yield _count("clumps", found and found.clumps, "1", text)


def class_rows(confusion: Confusion, by_block: Tallies, seed: int) -> Iterator[Row]:
    """One row per class: points, and each measure with its limits."""
    spread = intervals(by_block, class_measures, seed)
    found = confusion.class_measures()
    for k, label in enumerate(confusion.labels):
        row: Row = {"class": label, "reference": int(confusion.counts[k].sum())}
        row |= {"given": int(confusion.counts[:, k].sum()), "right": int(confusion.counts[k, k])}
        for name in CLASS_MEASURES:
            low, high = spread[name]
            row |= {name: found[name][k]} | limits((low[k], high[k]), f"{name}_")
        yield row


def matrix_rows(confusion: Confusion) -> Iterator[Row]:
    """One row per class of the reference, with a column for each class that is given."""
    for label, line in zip(confusion.labels, confusion.counts.tolist(), strict=True):
        given = dict(zip(confusion.labels, line, strict=True))
        yield {"reference": label} | given | {"total": sum(line)}


def stratum_row(confusion: Confusion, by_block: Tallies, seed: int) -> Row:
    """The main measures of all classes side by side, with limits for blocks."""
    found, spread, row = confusion.measures(), intervals(by_block, measures, seed), Row()
    for name in OF_STRATA:
        label = "kappa_of_classes" if name == "kappa" else name
        row |= {label: found[name]} | limits(spread[name], f"{label}_block_")
    return row


def filter_rows(
    counts: Counts, unmatched: int, absent: int, by_block: Tallies, seed: int
) -> Iterator[Row]:
    """Measures of the class of interest, with limits for independent points and for blocks."""

    def of(stack: Floats) -> dict[str, Floats]:
        each, whole = class_measures(stack), measures(stack)
        return {
            "Type I": 100 - each["producers_accuracy"][:, 0],
            "Type II": 100 - each["producers_accuracy"][:, 1],
            "total error": 100 - whole["overall_accuracy"],
            "correctness": each["users_accuracy"][:, 0],
            "completeness": each["producers_accuracy"][:, 0],
            "quality": each["iou"][:, 0],
            "kappa": whole["kappa"],
        }

    spread = intervals(by_block, of, seed)
    for row in counts.rows(unmatched, absent):
        nothing = {"block_low": None, "block_high": None}
        known = row["measure"] in spread
        found = limits(spread[row["measure"]], "block_") if known else nothing
        told = {k: row.pop(k) for k in ("unit", "meaning")}
        yield row | found | told


def area_rows(confusion: Confusion, mapped: Floats) -> Iterator[Row]:
    """One row per class, and one for all: accuracies and areas that a sample by class tells."""
    found = Estimates.of(confusion.counts, mapped)
    for k, label in enumerate(confusion.labels):
        row: Row = {"class": label, "sample": int(confusion.counts[:, k].sum())}
        row["mapped_area"] = float(mapped[k])
        row |= _estimate("area", found.share, k, float(mapped.sum()))
        row |= _estimate("users_accuracy", found.users, k, 100)
        yield row | _estimate("producers_accuracy", found.producers, k, 100)
    row = {
        "class": "all",
        "sample": int(confusion.counts.sum()),
        "mapped_area": float(mapped.sum()),
    }
    yield row | _estimate("overall_accuracy", found.overall, (), 100)


def _estimate(name: str, estimate: Estimate, which: Any, factor: float) -> Row:
    value, (low, high) = estimate.value[which], estimate.limits
    pair = low[which] * factor, high[which] * factor
    return {name: None if np.isnan(value) else float(value * factor)} | limits(pair, f"{name}_")


def area_problem(entries: Sequence[str] | None) -> str:
    """What is wrong with entries such as ``vegetation=1200``; empty if nothing is."""
    for entry in entries or ():
        found = AREA.fullmatch(entry)
        try:
            positive = found is not None and float(found[2]) > 0
        except ValueError:
            positive = False
        if not positive:
            return f"{entry!r} is not class=area with an area above zero, such as vegetation=1200"
    return ""


def mapped_areas(entries: Sequence[str], labels: Sequence[str]) -> Floats:
    """The mapped area of each class; a bare number names the class of that code.

    Raises
    ------
    DataError
        A class of the classification has no area, or the name is unknown.
    """
    areas = {}
    for entry in entries:
        name, area = AREA.fullmatch(entry).groups()  # type: ignore[union-attr]  # checked before
        areas[f"class {name}" if name.isdigit() else name] = float(area)
    if unknown := sorted(areas.keys() - set(labels)):
        raise DataError(f"mapped_area: no class {unknown[0]!r}; there are {', '.join(labels)}")
    if missing := [label for label in labels if label not in areas]:
        raise DataError(f"mapped_area: there is none for {missing[0]!r}")
    return np.array([areas[label] for label in labels])


def limits(pair: tuple[Any, Any], prefix: str = "") -> Row:
    """Columns with the limits of an interval; None for NaN."""
    low, high = (None if np.isnan(value) else float(value) for value in pair)
    return {f"{prefix}low": low, f"{prefix}high": high}


def _count(measure: str, value: float | None, unit: str, meaning: str) -> Row:
    known = value if value is not None and np.isfinite(value) else None
    row = {"measure": measure, "value": known, "low": None, "high": None}
    return row | {"unit": unit, "meaning": meaning}
