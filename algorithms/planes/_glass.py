"""Glass of curtain walls: large planes behind the frames that part them into panels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, label, uniform_filter
from scipy.spatial import KDTree

PER_CELL = 4.0  # points of the frames in a square, about
MOST_SQUARES = 2e6  # of a picture; more, where frames have twins of other scans, cost memory alone
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
    away: Floats,
    ids: NDArray[Any],
    largest: tuple[float, float],
    recess: float,
) -> Mask:
    """Which points are on the glass of a curtain wall, array of shape (n,).

    Of its planes one is larger than an opening, the others lie in its depth. Most of their points
    are between frames that stand before them, no farther than panes stand back, and no farther from
    each other than the sides of an opening. Most of what is between has fewer points than the
    frames: glass sends little back, while wall between pilasters sends as much as these. Panels
    with as many are opaque, as bands below the glass are.

    Parameters
    ----------
    uv : array of shape (n, 2), places of all points on the front
    away : array of shape (n,), their depths
    ids : array of shape (n,), number of the plane of each, from 1
    largest : width and height of an opening
    recess : farthest that panes stand back

    Examples
    --------
    Panes above opaque bands 0.9 m high, between frames that stand 0.1 m before them.

    >>> from types import SimpleNamespace as Plane
    >>> side = np.arange(0, 9, 0.02)
    >>> frame = np.vstack([[(x, y) for x in np.arange(0, 6.1, 1.5) for y in side]])
    >>> frame = np.vstack([frame, [(x, y) for x in side[:300] for y in (0, 1, 3, 4, 6, 7, 9)]])
    >>> uv = np.random.default_rng(1).random((40_000, 2)) * [6, 9]
    >>> opaque = uv[:, 1] % 3 < 0.95
    >>> uv = np.vstack([frame, uv[opaque], uv[~opaque][::20]])
    >>> ids = np.repeat([1, 2], [len(frame), len(uv) - len(frame)])
    >>> size = np.array([6, 9])
    >>> planes = [Plane(number=k, depth=0.1 * k, spread=0.01, size=size) for k in (0, 1)]
    >>> made = glass(planes, uv, 0.1 * (ids - 1), ids, (4.0, 6.0), 0.25)
    >>> pane = (ids == 2) & (uv[:, 1] % 3 > 1.05)
    >>> bool(made[pane].mean() > 0.95), bool(made[~pane].mean() < 0.05)
    (True, True)
    """
    found, numbers = np.zeros(len(uv), bool), [part.number + 1 for part in parts]
    for part in parts:
        if (part.size > largest).any() and not found[ids == part.number + 1].any():
            step = SIGMAS * part.spread
            level = [one.number for one in parts if abs(one.depth - part.depth) <= step]
            in_level, before = np.isin(ids, np.array(level, int) + 1), part.depth - away
            own = np.flatnonzero(in_level)
            frames = np.flatnonzero((before > step) & (before <= recess) & ~in_level)
            flat = np.isin(ids[frames], numbers)
            found[own[_in_panels(uv[own], uv[frames], flat, largest)]] = True
    return found


def _in_panels(own: Floats, frames: Floats, flat: Mask, largest: tuple[float, float]) -> Mask:
    """Which points of shape (n, 2) are on panels with fewer than frames; none unless most are.

    Parameters
    ----------
    flat : which points of the frames are on planes that face the way of the front
    """
    none, places = np.zeros(len(own), bool), np.unique(frames[flat], axis=0)
    if len(places) < 2:
        return none
    away, _ = KDTree(places).query(places[:: 1 + len(places) // FEW], k=[2])
    side = math.sqrt(PER_CELL) * max(float(np.median(away)) / NEAREST, 1e-9)
    low, high = own.min(axis=0) - largest, own.max(axis=0) + largest
    side = max(side, math.sqrt(float(np.prod(high - low)) / MOST_SQUARES))
    here = ((frames >= low) & (frames <= high)).all(axis=1)
    frames, flat = frames[here], flat[here]
    own, frames = (np.floor((some - low) / side).astype(np.int64) for some in (own, frames))
    glassy, framed, held = np.zeros((3, *np.floor((high - low) / side).astype(int) + 1))
    np.add.at(glassy, tuple(own.T), 1.0)
    np.add.at(framed, tuple(frames[flat].T), 1.0)
    held[tuple(frames.T)] = 1.0
    between = held == 0
    for axis, limit in enumerate(largest):
        between &= _apart(held > 0, axis) * side <= limit
    room = [1 + 2 * int(limit / side / 2) for limit in largest]
    # Frames are narrower than squares: a point of one has as many beside it as where they are full.
    full, some = (uniform_filter(framed**k, room, mode="constant") for k in (2, 1))
    panels, _ = label(between)
    seen = np.bincount(panels.ravel(), (glassy * some).ravel())
    most = np.bincount(panels.ravel(), full.ravel())
    few = (seen < SPARSE * most)[panels] & between
    if between[tuple(own.T)].mean() <= MOSTLY or few.sum() <= MOSTLY * between.sum():
        return none
    return np.asarray((binary_dilation(few) & ~(between & ~few))[tuple(own.T)])


def _apart(held: Mask, axis: int) -> Floats:
    """Squares from the last that is held to the next along an axis; infinite without one."""
    place = np.arange(held.shape[axis], dtype=float).reshape((-1, 1) if axis == 0 else (1, -1))
    last = np.maximum.accumulate(np.where(held, place, -np.inf), axis)
    after = np.flip(np.where(held, place, np.inf), axis)
    return np.asarray(np.flip(np.minimum.accumulate(after, axis), axis) - last)
