"""Pictures of scenes in space: points, lines and areas seen obliquely, the nearest on top."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from toolbox.pictures.images import Ramp

_WIDTH, _TALLEST, _FLATTEST = 1400, 0.75, 0.3  # pixels, and height to width
_PAPER = (244, 246, 248)
_EDGE = 0.03  # of the width, around the scene

Floats = NDArray[np.float64]


def _none() -> NDArray[np.int64]:
    return np.zeros((0, 3), np.int64)


@dataclass(frozen=True)
class Item:
    """Something of one colour in a scene; coordinates are relative to its origin.

    Attributes
    ----------
    kind : "points", "marks" (large ones), "lines", or "areas" made of triangles
    xyz : array of shape (n, 3)
    share, ramp : of points in continuous colours, where each is on the ramp
    parts : of lines and marks, the corners of each
    rows : the row of each part in the table of its layer
    triangles : of areas, indices of corners, of shape (m, 3)
    """

    kind: Literal["points", "marks", "lines", "areas"]
    name: str
    colour: str
    xyz: Floats
    size: float = 1.0
    share: Floats = field(default_factory=lambda: np.zeros(0))
    ramp: Ramp | None = None
    parts: Sequence[Floats] = ()
    rows: Sequence[int] = ()
    table: str = ""
    triangles: NDArray[np.int64] = field(default_factory=_none)


def view_png(items: Sequence[Item], towards: Floats) -> bytes:
    """The scene as a PNG, in parallel projection.

    Parameters
    ----------
    towards : unit vector to the eye
    """
    from PIL import Image

    right, up = _axes(towards)
    parts = [(_dense(item), item) for item in items if item.kind != "areas"]
    xyz = np.concatenate([places for places, _ in parts])
    flat, near = xyz @ np.array([right, up]).T, xyz @ towards
    low, high = flat.min(axis=0), flat.max(axis=0)
    scale = _WIDTH * (1 - 2 * _EDGE) / max(high[0] - low[0], (high[1] - low[1]) / _TALLEST, 1e-9)
    height = int((high[1] - low[1]) * scale + 2 * _EDGE * _WIDTH)
    height = max(height, int(_FLATTEST * _WIDTH))
    middle = (low + high) / 2
    col = np.rint(_WIDTH / 2 + (flat[:, 0] - middle[0]) * scale).astype(int)
    row = np.rint(height / 2 - (flat[:, 1] - middle[1]) * scale).astype(int)
    colours = np.concatenate([_colours(item, len(places)) for places, item in parts])
    sizes = np.concatenate([np.full(len(places), _reach(item)) for places, item in parts])
    above = np.concatenate([np.full(len(p), item.kind != "points") for p, item in parts])
    order = np.lexsort([near, above])  # lines and marks on top, else they would drown in points
    canvas = np.full((height, _WIDTH, 3), _PAPER, np.uint8)
    for size in np.unique(sizes):
        own = order[sizes[order] == size]
        for dy in range(-size, size + 1):
            for dx in range(-size, size + 1):
                y, x = np.clip(row[own] + dy, 0, height - 1), np.clip(col[own] + dx, 0, _WIDTH - 1)
                canvas[y, x] = colours[own]
    made = io.BytesIO()
    Image.fromarray(canvas).quantize(128).save(made, "PNG", optimize=True)
    return made.getvalue()


def _axes(towards: Floats) -> tuple[Floats, Floats]:
    """Right and up in the picture."""
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    return right, np.cross(towards, right)


def _reach(item: Item) -> int:
    """Pixels to both sides of each place."""
    return {"points": 1, "lines": 1, "marks": 4}.get(item.kind, 0)


def _dense(item: Item) -> Floats:
    """The places of an item; lines are filled with places along them."""
    if item.kind != "lines":
        return item.xyz
    made = []
    for part in item.parts:
        pieces = np.linspace(part[:-1], part[1:], 60, axis=1).reshape(-1, 3)
        made.append(pieces if len(pieces) else part)
    return np.concatenate(made)


def _colours(item: Item, count: int) -> NDArray[np.uint8]:
    from matplotlib.colors import to_rgb

    if item.ramp is not None:
        rgba: Floats = np.array(item.ramp.colour_map()(item.share))
        return np.rint(rgba[:, :3] * 255).astype(np.uint8)
    colour = np.rint(np.array(to_rgb(item.colour)) * 255).astype(np.uint8)
    return np.broadcast_to(colour, (count, 3))
