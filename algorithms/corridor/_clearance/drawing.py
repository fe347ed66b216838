"""Pictures in SVG: points, curves and marks in a window with two axes.

A report has a picture per span; this takes milliseconds for one, and stays sharp when enlarged.
"""

from __future__ import annotations

import base64
import math
import struct
import zlib
from collections.abc import Sequence
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

LEFT, RIGHT, ABOVE, BELOW = 70, 130, 10, 45  # pixels around the window, for axes and key
DOT = 2  # pixels, of a point
TICKS = 80  # pixels from one to the next, or more
STYLE = (
    "text{font:12px sans-serif}.s{font-size:10px;paint-order:stroke;stroke:#fff;stroke-width:3px;"
    "stroke-opacity:.7}polyline{fill:none}image{image-rendering:pixelated}"
)

Floats = NDArray[np.float64]


class Drawing:
    """A window with axes and a key; what is drawn first lies below.

    Parameters
    ----------
    low, high : corners of the window in the coordinates of what is drawn
    size : of the window in pixels
    labels : of both axes
    """

    def __init__(
        self, low: Floats, high: Floats, size: tuple[float, float], labels: tuple[str, str]
    ) -> None:
        self.low, self.high, self.labels = low, high, labels
        self.size = np.array([round(length) for length in size], float)
        self.parts: list[str] = []
        self.keys: list[tuple[str, str]] = []

    def at(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Pixels from the left and from the top of the window."""
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
        """Points in the colours of their kinds, the first of which are on top."""
        cols, rows = np.ceil(self.size / DOT).astype(int)
        col, row = (np.floor(part / DOT).astype(np.int64) for part in self.at(x, y))
        inside = (col >= 0) & (row >= 0) & (col < cols) & (row < rows)
        col, row, kind = col[inside], row[inside], kind[inside]
        image = np.zeros((rows, cols), np.uint8)
        for number in reversed(range(len(colours))):
            here = kind == number
            image[row[here], col[here]] = number + 1
        png = base64.b64encode(_png(image, colours)).decode()
        self.parts.append(
            f'<image width="{cols * DOT}" height="{rows * DOT}" opacity="{opacity:g}" '
            f'href="data:image/png;base64,{png}"/>'
        )

    def curve(self, x: Floats, y: Floats, colour: str, width: float, dashes: str = "") -> None:
        """A line from place to place."""
        places = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(*self.at(x, y), strict=True))
        dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
        self.parts.append(
            f'<polyline stroke="{colour}" stroke-width="{width:g}"{dashed} points="{places}"/>'
        )

    def mark(self, x: float, y: float, colour: str) -> None:
        """A dot with a rim."""
        a, b = self.at(np.array(x), np.array(y))
        self.parts.append(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3" {_rimmed(colour)}/>')

    def text(self, x: float, y: float, text: str, colour: str = "#000") -> None:
        """A small text just right of a place."""
        a, b = self.at(np.array(x), np.array(y))
        self.parts.append(
            f'<text class="s" x="{a + 4:.1f}" y="{b - 4:.1f}" fill="{colour}">{escape(text)}</text>'
        )

    def key_of_points(self, name: str, colour: str) -> None:
        """Tell what a colour of points means."""
        self.keys.append((f'<rect x="8" y="-9" width="8" height="8" fill="{colour}"/>', name))

    def key_of_curves(self, name: str, colour: str, dashes: str = "") -> None:
        """Tell what a line means."""
        line = f'<path d="M0-5h24" stroke="{colour}" stroke-dasharray="{dashes or "none"}"/>'
        self.keys.append((line, name))

    def key_of_marks(self, name: str, colour: str) -> None:
        """Tell what a colour of marks means."""
        self.keys.append((f'<circle cx="12" cy="-5" r="4" {_rimmed(colour)}/>', name))

    def svg(self) -> bytes:
        """The content of a file."""
        wide, tall = self.size.tolist()
        lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide + LEFT + RIGHT:g}" '
            f'height="{tall + ABOVE + BELOW:g}"><style>{STYLE}</style>',
            '<rect width="100%" height="100%" fill="#fff"/>',
            f'<svg x="{LEFT}" y="{ABOVE}" width="{wide:g}" height="{tall:g}">',
            *self.parts,
            f'</svg><g transform="translate({LEFT} {ABOVE})">',
            f'<rect width="{wide:g}" height="{tall:g}" fill="none" stroke="#000"/>',
            *self._axes(),
            *(
                f'<g transform="translate({wide + 12:g} {20 + 18 * k})">{symbol}'
                f'<text x="32">{escape(name)}</text></g>'
                for k, (symbol, name) in enumerate(self.keys)
            ),
            "</g></svg>",
        ]
        return "\n".join(lines).encode()

    def _axes(self) -> list[str]:
        """Ticks with their numbers, and the names of the axes."""
        wide, tall = self.size.tolist()
        across, up = (_ticks(*ends) for ends in zip(self.low, self.high, self.size, strict=True))
        columns, _ = self.at(across, np.full(len(across), self.low[1]))
        _, rows = self.at(np.full(len(up), self.low[0]), up)
        return [
            *(
                f'<path d="M{a:.1f} {tall:g}v4" stroke="#000"/><text x="{a:.1f}" y="{tall + 17:g}" '
                f'text-anchor="middle">{number:g}</text>'
                for a, number in zip(columns, across, strict=True)
            ),
            *(
                f'<path d="M0 {b:.1f}h-4" stroke="#000"/><text x="-7" y="{b + 4:.1f}" '
                f'text-anchor="end">{number:g}</text>'
                for b, number in zip(rows, up, strict=True)
            ),
            f'<text x="{wide / 2:g}" y="{tall + 36:g}" text-anchor="middle">'
            f"{escape(self.labels[0])}</text>",
            f'<text transform="translate(-52 {tall / 2:g}) rotate(-90)" text-anchor="middle">'
            f"{escape(self.labels[1])}</text>",
        ]


def _rimmed(colour: str) -> str:
    return f'fill="{colour}" stroke="#000" stroke-width=".5"'


def _ticks(low: float, high: float, pixels: float) -> Floats:
    """Round numbers on an axis: 1, 2 or 5 times a power of ten apart."""
    least = (high - low) * min(TICKS / pixels, 0.5)
    power = 10.0 ** math.floor(math.log10(least))
    step = next(power * k for k in (1, 2, 5, 10) if power * k >= least)
    return np.asarray(np.arange(math.ceil(low / step), math.floor(high / step) + 1) * step)


def _png(image: NDArray[np.uint8], colours: Sequence[str]) -> bytes:
    """A PNG file of numbers of colours from 1; 0 lets through what is below."""
    rows, cols = image.shape
    palette = b"\0\0\0" + b"".join(bytes.fromhex(colour[1:]) for colour in colours)
    lines = np.zeros((rows, cols + 1), np.uint8)  # each begins with its filter, which is none
    lines[:, 1:] = image
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", cols, rows, 8, 3, 0, 0, 0)), (b"PLTE", palette),
        (b"tRNS", b"\0"), (b"IDAT", zlib.compress(lines.tobytes(), 6)), (b"IEND", b""),
    )  # fmt: skip
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in chunks
    )
