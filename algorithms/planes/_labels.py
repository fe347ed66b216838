"""Where the texts of a drawing stand, so that none touches another, a stroke or a line.

Texts of dimensions stand above their line; where one is wider than its dimension, it is moved below
the line, or above the others, as draughtsmen do (ISO 129-1). Other texts take the first place that
is free.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from toolbox.data.dxf import ABOVE, TICK

Floats = NDArray[np.float64]
DIGIT = 0.87  # width of a digit over its height, as printed
LETTER = 0.82  # the same of the widest letters in use
AIR = 0.2  # heights of a text between it and what it must not touch
ON_LINE = ABOVE + 0.5  # heights of a text from its line to its middle, where it stands on it
BELOW = -(TICK + AIR + 0.5)  # below the strokes
STEP = 1 + AIR  # to the next row of texts


def shifts(places: Floats, texts: Sequence[str], size: float) -> list[float]:
    """How far above its line each text of a chain of dimensions stands, in heights of a text.

    Parameters
    ----------
    places : array of shape (n + 1,) where dimensions begin and end, in order
    texts : n, each in the middle of its dimension
    size : height of the texts, in the unit of the places

    Examples
    --------
    >>> shifts(np.array([0, 10, 11, 12, 22.0]), ["1000", "100", "100", "1000"], 1.0)
    [0.8, -1.3, 2.0, 0.8]
    """
    taken: dict[float, float] = {}  # where the last text of each row ends
    found = []
    for begin, end, text in zip(places[:-1], places[1:], texts, strict=True):
        half = (DIGIT * len(text) / 2 + AIR) * size
        left, right = (begin + end) / 2 - half, (begin + end) / 2 + half
        rows = [] if right - left > end - begin - 2 * TICK * size else [ON_LINE]
        rows += [
            row for k in range(len(texts)) for row in (BELOW - k * STEP, ON_LINE + STEP * (k + 1))
        ]
        row = next(row for row in rows if taken.get(row, -np.inf) <= left)
        taken[row] = right
        found.append(round(row, 6))
    return found


def reach(moved: Sequence[float]) -> tuple[float, float]:
    """How far texts and strokes reach above and below a chain, in heights of a text.

    Examples
    --------
    >>> reach([0.8, -1.3])
    (1.3, 1.8)
    """
    return max([TICK, *(row + 0.5 for row in moved)]), max([TICK, *(0.5 - row for row in moved)])


def box_of(text: str, x: float, y: float, size: float, *, angle: float = 0.0) -> Any:
    """The box of a text centred on a place, level or upright, with some air around."""
    wide, high = (LETTER * len(text) / 2 + AIR) * size, (0.5 + AIR) * size
    return (
        shapely.box(x - wide, y - high, x + wide, y + high)
        if angle == 0.0
        else shapely.box(x - high, y - wide, x + high, y + wide)
    )


class Labels:
    """Texts that stand where they touch neither another nor a line, if there is such a place.

    Parameters
    ----------
    lines : of the drawing, which no text may cross
    """

    def __init__(self, lines: Iterable[Any]) -> None:
        self._lines = shapely.union_all(list(lines))
        self._taken: list[Any] = []
        shapely.prepare(self._lines)

    def place(
        self, text: str, size: float, places: Sequence[tuple[float, float]]
    ) -> tuple[float, float]:
        """The first of some places that is free; else one without another text, or the first."""
        boxes = [box_of(text, x, y, size) for x, y in places]
        bare = [k for k, box in enumerate(boxes) if not shapely.intersects(box, self._taken).any()]
        free = [k for k in bare if not shapely.intersects(self._lines, boxes[k])]
        chosen = next(iter([*free, *bare, 0]))
        self._taken.append(boxes[chosen])
        return places[chosen]
