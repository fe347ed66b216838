"""Glass of curtain walls: large planes behind the frames that part them into panels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

PER_CELL = 4.0  # points of the frames in a square, about
FEW = 20_000  # points of the frames that tell how far neighbours are apart
NEAREST = math.sqrt(math.log(2) / math.pi)  # distance of the nearest of points by chance, median
MOSTLY = 0.5  # share of the points of glass between frames: 0.8, less where some were not seen
SPARSE = 0.5  # points of glass over those on as much of its frames, at most: wall has about 1
SIGMAS = 3.0  # standard deviations of a plane, within which another lies in its depth

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Part(Protocol):
    """A plane of a front: index, depth and spread of its points, width and height."""

    @property
    def number(self) -> int: ...
    @property
    def depth(self) -> float: ...
    @property
    def spread(self) -> float: ...
    @property
    def size(self) -> Floats: ...


def glass(
    parts: Sequence[Part],
    uv: Floats,
    ids: NDArray[Any],
    largest: tuple[float, float],
    recess: float,
) -> list[int]:
    """Numbers of the planes that are the glass of a curtain wall.

    One is larger than an opening, the others lie in its depth. Most of their points are between
    frames that stand before them, no farther than panes stand back, and no farther from each other
    than the sides of an opening. There they have fewer points than the frames: glass sends little
    back, while wall between pilasters sends as much as these.

    Parameters
    ----------
    uv : array of shape (n, 2), places of all points on the front
    ids : array of shape (n,), number of the plane of each, from 1
    largest : width and height of an opening
    recess : farthest that panes stand back

    Examples
    --------
    >>> from types import SimpleNamespace as Plane
    >>> frame = np.array([(x, y) for x in np.arange(0, 6.1, 1.5) for y in np.arange(0, 9, 0.02)])
    >>> frame = np.vstack([frame, [(x, y) for x in np.arange(0, 6, 0.02) for y in (0, 3, 6, 9)]])
    >>> pane = np.random.default_rng(1).random((3000, 2)) * [6, 9]
    >>> size = np.array([6, 9])
    >>> planes = [Plane(number=k, depth=0.1 * k, spread=0.01, size=size) for k in (0, 1)]
    >>> ids = np.repeat([1, 2], [len(frame), len(pane)])
    >>> glass(planes, np.vstack([frame, pane]), ids, (4.0, 6.0), 0.25)
    [1]
    """
    found: set[int] = set()
    for part in parts:
        if part.number not in found and (part.size > largest).any():
            step = SIGMAS * part.spread
            level = [one.number for one in parts if abs(one.depth - part.depth) <= step]
            before = [one.number for one in parts if step < part.depth - one.depth <= recess]
            own, frames = (uv[np.isin(ids, np.array(some, int) + 1)] for some in (level, before))
            if _between_frames(own, frames, largest):
                found.update(level)
    return sorted(found)


def _between_frames(own: Floats, frames: Floats, largest: tuple[float, float]) -> bool:
    """Whether most points of shape (n, 2) lie between those of frames, and are fewer there."""
    if len(frames) < 2:
        return False
    away, _ = KDTree(frames).query(frames[:: 1 + len(frames) // FEW], k=[2])
    side = math.sqrt(PER_CELL) * max(float(np.median(away)) / NEAREST, 1e-9)
    low = np.minimum(own.min(axis=0), frames.min(axis=0))
    own, frames = (np.floor((some - low) / side).astype(np.int64) for some in (own, frames))
    held = np.zeros(np.maximum(own.max(axis=0), frames.max(axis=0)) + 1, bool)
    held[tuple(frames.T)] = True
    between = ~held
    for axis, limit in enumerate(largest):
        between &= _apart(held, axis) * side <= limit
    inside = between[tuple(own.T)]
    sparse = inside.sum() * held.sum() < SPARSE * len(frames) * between.sum()
    return bool(sparse and inside.mean() > MOSTLY)


def _apart(held: Mask, axis: int) -> Floats:
    """Squares from the last that is held to the next along an axis; infinite without one."""
    place = np.arange(held.shape[axis], dtype=float).reshape((-1, 1) if axis == 0 else (1, -1))
    last = np.maximum.accumulate(np.where(held, place, -np.inf), axis)
    after = np.flip(np.where(held, place, np.inf), axis)
    return np.asarray(np.flip(np.minimum.accumulate(after, axis), axis) - last)
