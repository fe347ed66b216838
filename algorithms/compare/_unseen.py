"""What a comparison cannot tell: the reference without a counterpart or class, small numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import shapely

from algorithms.compare._shapes import Shapes
from algorithms.shared.accuracy.blocks import LEAST
from algorithms.shared.accuracy.confusion import Confusion
from toolbox.context import log

# Share of the reference without a counterpart that is told in a warning: figures are read to the
# percent, and what is absent could move a share by as much as there is of it.
TELL = 0.01
# Points compared, below which a warning tells what may still be wrong: of 100 points without an
# error, 3 % may be wrong in truth (rule of three).
FEW = 100
# Share of the points, or of the area, that cannot be right or found because one side has no such
# class, or ends before: from there on it decides what the figures are, and not the method.
UNKNOWN = 0.05


def warn_absent(absent: int, total: int, what: str) -> None:
    """Warn if more than one percent of the reference has no counterpart.

    Parameters
    ----------
    absent, total : how many of the reference have none, and how many there are
    what : such as "points" or "cells"
    """
    if absent > TELL * total:
        log.warning(
            "%d of %d %s of the reference (%.0f %%) are absent from what is judged: they count in "
            "no figure but `absent`",
            absent,
            total,
            what,
            100 * absent / total,
        )


def warn_not_known(confusion: Confusion) -> None:
    """Warn of classes that many points have and none of the reference, so that none can be right.

    Parameters
    ----------
    confusion : of the points that are compared
    """
    total = int(confusion.counts.sum())
    for k, name in enumerate(confusion.labels):
        said = int(confusion.counts[:, k].sum())
        if confusion.counts[k].any() or said <= UNKNOWN * total:
            continue
        most = confusion.labels[int(confusion.counts[:, k].argmax())]
        log.warning(
            "%d of %d points (%.0f %%) are of %s, which the reference does not have: none of "
            "them can be right; there most are of %s: make classes one with map, or leave "
            "some out",
            said,
            total,
            100 * said / total,
            name,
            most,
        )


def warn_outside(shapes: Shapes, other: Shapes, whose: str, of: str) -> None:
    """Warn if much of a layer lies outside of the rectangle around the other one.

    Parameters
    ----------
    shapes, other : arrays of polygons
    whose, of : names of the parameters that these are
    """
    area = shapely.area(shapes)
    if not area.sum() or not shapely.area(other).sum():
        return
    away = ~shapely.intersects(shapes, shapely.box(*shapely.total_bounds(other)))
    if area[away].sum() > UNKNOWN * area.sum():
        log.warning(
            "%s: %d of %d polygons (%.0f %% of their area) lie outside of the rectangle around all "
            "of %s, and count as errors; if one layer extends farther than the other, give "
            "`coverage` or `extent`, where both are complete",
            whose,
            np.count_nonzero(away),
            len(shapes),
            100 * area[away].sum() / area.sum(),
            of,
        )


def warn_few(count: int, what: str) -> None:
    """Warn if so few are compared that no error among them means little.

    Parameters
    ----------
    count : how many are compared, at least 1
    what : such as "points" or "cells"
    """
    if count < FEW:
        log.warning(
            "only %d %s are compared: intervals are too narrow, and even if all agreed, up to "
            "%.0f %% of all such %s could differ",
            count,
            what,
            100 * could_differ(count),
            what,
        )


def could_differ(count: int) -> float:
    """Largest share of errors of which a sample shows none in one of twenty cases.

    It is one minus the root of 0.05 of the order `count` (Clopper and Pearson 1934).

    >>> round(could_differ(8), 3), round(could_differ(100), 4)
    (0.312, 0.0295)
    """
    return float(1 - 0.05 ** (1 / count))


def no_limits(accuracy: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """A sentence if the overall accuracy has no interval, given the rows of the measures."""
    rows = {row["measure"]: row for row in accuracy}
    if rows["overall_accuracy"]["low"] is None:
        yield (
            f"How far the figures may be off: {rows['blocks']['value']:.0f} blocks do not tell it, "
            f"as they are fewer than {LEAST} or all alike."
        )


def not_compared(count: int, absent: int, what: str) -> Iterator[str]:
    """Sentences on the same for the page of a result."""
    if absent:
        yield f"Of the reference, {absent} {what} are absent from what is judged."
    if count < FEW:
        yield f"Only {count} {what} are compared, too few for intervals that can be trusted."
