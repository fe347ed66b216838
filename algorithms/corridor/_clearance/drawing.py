"""SVG drawings of points, curves and marks in a window with two axes.

A report has a drawing per span: this takes milliseconds for one, matplotlib a tenth of a second.
"""

from __future__ import annotations

import base64
import functools
import io
import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

# Pixels, for axes and a key of 18 letters.
MARGINS = {"left": 70, "right": 165, "above": 10, "below": 45}
DOT = 2  # pixels, of a point
TICK_SPACING = 80  # pixels from one tick to the next, or more
LETTER = 6.5, 8  # pixels, width (of a digit 6.4) and height of a letter of 10 pixels
MARK = 3  # pixels, radius of a mark
GAP = 4  # pixels between a position and its text, and between texts
RINGS = 40  # ever farther around a position, by a letter, where a free place is looked for
SIDES = ((1, -1), (1, 1), (-1, -1), (-1, 1), (1, 0), (-1, 0), (0, -1), (0, 1))  # right, down

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]  # left, top, right, bottom, in pixels


class Drawing:
    """A drawing with axes and a legend; later shapes are drawn over earlier ones, texts over all.

    Parameters
    ----------
    low, high : corners of the window in the coordinates of what is drawn
    size : of the window in pixels
    labels : of both axes
    origin, metre : the axes have the numbers origin + metre * coordinates
    """

    def __init__(
        self,
        low: Floats,
        high: Floats,
        size: tuple[float, float],
        labels: tuple[str, str],
        *,
        origin: Floats | None = None,
        metre: float = 1.0,
    ) -> None:
        self.low, self.high, self.labels = low, high, labels
        self.origin, self.metre = np.zeros(2) if origin is None else origin, metre
        self.size = tuple(round(length) for length in size)
        self.shapes: list[dict[str, Any]] = []
        self.texts: list[dict[str, Any]] = []
        self.keys: list[dict[str, Any]] = []

    def at(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Positions in pixels from the left and the top of the window."""
        right, up = self.size / (self.high - self.low)
        return (x - self.low[0]) * right, self.size[1] - (y - self.low[1]) * up

    def points(
        self,
        x: Floats,
        y: Floats,
        kind: NDArray[np.integer],
        colours: Sequence[str],
        opacity: float,
    ) -> None:
        """Draw points in the colours of their kinds; the first kinds are drawn on top."""
        cols, rows = (math.ceil(length / DOT) for length in self.size)
        col, row = (np.floor(pixel / DOT).astype(np.int64) for pixel in self.at(x, y))
        inside = (col >= 0) & (row >= 0) & (col < cols) & (row < rows)
        col, row, kind = col[inside], row[inside], kind[inside]
        image = np.zeros((rows, cols), np.uint8)
        for number in reversed(range(len(colours))):
            here = kind == number
            image[row[here], col[here]] = number + 1
        size = {"wide": cols * DOT, "tall": rows * DOT}
        # What shows PDF mixes the colours of dots with that of the blank ones between them.
        png = _png(image, ["#ffffff", *colours])
        self.shapes.append({"shape": "points", "png": png, "opacity": opacity, **size})

    def curve(self, x: Floats, y: Floats, colour: str, width: float, dashes: str = "") -> None:
        """Draw a line through positions."""
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(*self.at(x, y), strict=True))
        style = {"colour": colour, "width": width, "dashes": dashes}
        self.shapes.append({"shape": "curve", "points": points, **style})

    def mark(self, x: float, y: float, colour: str) -> None:
        """Draw a dot with an outline."""
        self.shapes.append({"shape": "mark", "colour": colour, **self._position(x, y)})

    def text(self, x: float, y: float, text: str, colour: str = "#000") -> None:
        """Write a small text beside a position, on no other text; none where there is no room."""
        self.texts.append({"text": text, "colour": colour, **self._position(x, y)})

    def key(self, shape: str, name: str, colour: str, dashes: str = "") -> None:
        """Add an entry to the legend, for the shape "points", "curve" or "mark"."""
        self.keys.append({"shape": shape, "name": name, "colour": colour, "dashes": dashes})

    def svg(self) -> bytes:
        """The drawing as the bytes of an SVG file."""
        ends = self.origin + self.metre * np.array([self.low, self.high])
        across, up = (_ticks(*ends) for ends in zip(*ends, self.size, strict=True))
        columns, _ = self.at((across - self.origin[0]) / self.metre, self.low[1])
        _, rows = self.at(self.low[0], (up - self.origin[1]) / self.metre)
        text = _template().render(
            vars(self),
            **MARGINS,
            mark=MARK,
            placed=list(self._placed()),
            wide=self.size[0],
            tall=self.size[1],
            across=_labelled(columns, across),
            up=_labelled(rows, up),
        )
        return text.encode()

    def _placed(self) -> Iterator[dict[str, Any]]:
        """The texts, each with the place of its first letter, and where its leader ends if far."""
        taken: list[Box] = []
        for text in self.texts:
            if (place := self._free(text, taken)) is None:
                continue
            ring, box = place
            taken.append(box)
            left, top, right, bottom = box
            yield {
                **text,
                "left": round(left, 1),
                "base": round(bottom, 1),
                "far": ring > 0,
                "to_x": round(min(max(text["x"], left), right), 1),
                "to_y": round(min(max(text["y"], top), bottom), 1),
            }

    def _free(self, text: dict[str, Any], taken: Sequence[Box]) -> tuple[int, Box] | None:
        """The nearest place of a text in the window on no other, on no mark either if there is one.

        None where all places are taken.
        """
        wide, tall = LETTER[0] * len(text["text"]), LETTER[1]
        places = []
        for ring, (right, down) in itertools.product(range(RINGS), SIDES):
            away = GAP + ring * tall
            left = _within(text["x"] + right * away - wide * (1 - right) / 2, self.size[0] - wide)
            top = _within(text["y"] + down * away - tall * (1 - down) / 2, self.size[1] - tall)
            places.append((ring, (left, top, left + wide, top + tall)))
        free = [place for place in places if not any(_meet(place[1], box, GAP) for box in taken)]
        marks = [self._box_of(shape) for shape in self.shapes if shape["shape"] == "mark"]
        clear = (p for p in free if not any(_meet(p[1], box, 0.0) for box in marks))
        return next(clear, free[0] if free else None)

    @staticmethod
    def _box_of(mark: dict[str, Any]) -> Box:
        x, y = mark["x"], mark["y"]
        return x - MARK, y - MARK, x + MARK, y + MARK

    def _position(self, x: float, y: float) -> dict[str, float]:
        a, b = self.at(np.array(x), np.array(y))
        return {"x": round(float(a), 1), "y": round(float(b), 1)}


def _within(start: float, last: float) -> float:
    """Where a text starts that begins in the window and ends there, if it has room."""
    return max(min(start, last), 0.0)


def _meet(one: Box, other: Box, gap: float) -> bool:
    """Whether two boxes are nearer to each other than a gap."""
    return all(
        one[k] < other[k + 2] + gap
        and other[k] < one[k + 2] + gap  # left and right, top and bottom
        for k in (0, 1)
    )


def _labelled(pixels: Floats, ticks: Floats) -> list[tuple[float, str]]:
    """Where ticks are, and their numbers, coordinates with all of their digits."""
    return [(round(at, 1), f"{tick:.12g}") for at, tick in zip(pixels, ticks, strict=True)]


@functools.cache
def _template() -> jinja2.Template:
    """Template of the drawing, from the .svg file beside this module."""
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(Path(__file__).with_suffix(".svg").read_text(encoding="utf-8"))


def _ticks(low: float, high: float, pixels: float) -> Floats:
    """Multiples of 1, 2 or 5 times a power of ten between two ends of an axis."""
    least = (high - low) * min(TICK_SPACING / pixels, 0.5)
    power = 10.0 ** math.floor(math.log10(least))
    step = next(power * k for k in (1, 2, 5, 10) if power * k >= least)
    return np.asarray(np.arange(math.ceil(low / step), math.floor(high / step) + 1) * step)


def _png(image: NDArray[np.uint8], colours: Sequence[str]) -> str:
    """Base64-encoded PNG file of an image of colour numbers; 0 is transparent."""
    picture, file = Image.fromarray(image), io.BytesIO()
    picture.putpalette(b"".join(bytes.fromhex(colour[1:]) for colour in colours))
    picture.save(file, "PNG", transparency=0)
    return base64.b64encode(file.getvalue()).decode()
