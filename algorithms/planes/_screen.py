"""What stands before a whole front and lets it be seen through: a scaffold, nets, a gallery.

Tubes and nets are told from parts of the front by three things. They reach over more than a storey,
which balconies do not. They stand free: nothing joins them to the wall, as sides join pilasters,
and leaves fill a tree. And the wall is seen beside or through them, as nothing is behind the wall
of the next house, which stands forward.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

CELL = 0.1  # metres: width, height and depth of a cell, twice that of a tube
NEAREST = 0.6  # metres before the wall of its outer side: boards of scaffolds are as wide at least
JOINED = 0.15  # metres before the wall: what is nearer is of the wall, as courses and sills are
LONG = 5.0  # metres: height of two storeys, of the least upright
BREAK = 0.5  # metres of an upright that are not seen, at most: a board or a net hides it
FREE = 0.7  # share of the height of an upright at which nothing joins it to the wall
THROUGH = 0.5  # share of its height at which the wall is seen beside it
WIDE = 5  # cells beside each other that are no tube, whose points lie in three at most
POROUS = 0.2  # share of the cells of a net through which the wall is seen: of a pilaster none
FEW = 0.25  # share of its columns through which less is seen, at most: behind a pilaster half
HALF = 0.5  # share of the depth to the wall at which something lies where it is joined
FIELD = 3.2  # metres from one upright to the next: fields of scaffolds are 3.07 m long at most
FEWEST = 3  # uprights: two may be a lamp and a mast
APART = 1.0  # metres between two of them at least, and pieces of a net that count as much

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Screen(NamedTuple):
    """What stands before a front.

    Attributes
    ----------
    points : array of shape (n,), which points are on it or between it and the wall
    spans : array of shape (k, 2), from where to where along the front it stands
    share : of the width of the front
    depth : how far before the wall, in the unit of the points
    """

    points: Mask
    spans: Floats
    share: float
    depth: float

    def hides(self, left: float, right: float) -> bool:
        """Whether it stands before a part of the front."""
        return bool(((self.spans[:, 0] < right) & (self.spans[:, 1] > left)).any())


def screen_of(uv: Floats, behind: Floats, wall: Mask, depth: float, metre: float) -> Screen:
    """What stands before a front and is no part of it.

    Parameters
    ----------
    uv : array of shape (n, 2), places of all points on the front
    behind : array of shape (n,), how far each lies behind the reference
    wall : array of shape (n,), which are on planes near the reference
    depth : farthest before the wall that is looked at
    metre : in the unit of the points

    Examples
    --------
    Tubes 1 m before a wall of 10 by 6 m, and pilasters of the same depth.

    >>> rng = np.random.default_rng(1)
    >>> wall = np.column_stack([rng.random((60_000, 2)) * [10, 6], np.zeros(60_000)])
    >>> up = np.arange(0, 6, 0.02)
    >>> tubes = np.array([(x, y, -1.0) for x in (1, 3, 5) for y in up])
    >>> sides = np.array([(x, y, -z) for x in (1, 3, 5) for y in up for z in np.arange(0, 1, 0.1)])
    >>> for before in (tubes, np.vstack([tubes, sides])):
    ...     xyz = np.vstack([wall, before])
    ...     made = screen_of(xyz[:, :2], xyz[:, 2], xyz[:, 2] == 0, 1.5, 1.0)
    ...     made.spans.round(1).tolist(), int(made.points.sum())
    ([[0.8, 5.0]], 900)
    ([], 0)
    """
    none = Screen(np.zeros(len(uv), bool), np.zeros((0, 2)), 0.0, 0.0)
    if not wall.any():
        return none
    low, size = uv[wall].min(axis=0), np.ptp(uv[wall], axis=0)
    before = (behind < -JOINED * metre) & (behind >= -depth)
    if size[1] < LONG * metre or not before.any():
        return none
    side = CELL * metre
    place = np.floor((uv - low) / side).astype(np.int32)
    columns, rows = (np.floor(size / side) + 1).astype(int)
    here = ((place >= 0) & (place < (columns, rows))).all(axis=1)
    some = here & before
    layer = np.floor(-behind[some] / side - JOINED / CELL).astype(np.int32)
    held = np.zeros((int(depth / side) + 2, columns, rows), bool)
    held[layer, *place[some].T] = True
    seen = np.zeros((columns, rows), bool)
    seen[tuple(place[here & (behind >= -JOINED * metre)].T)] = True
    upright = _uprights(held, seen, side / metre)
    found = np.flatnonzero(upright.any(axis=0))
    chains = np.split(found, np.flatnonzero(np.diff(found) > FIELD * metre / side) + 1)
    chains = [chain for chain in chains if _count(chain, APART * metre / side) >= FEWEST]
    if not chains:
        return none
    spans = np.array([(chain[0], chain[-1] + 1) for chain in chains])
    inside = np.zeros(columns, bool)
    for first, last in spans:
        inside[first:last] = True
    before &= inside[np.clip(place[:, 0], 0, columns - 1)]  # above the wall and past its ends, too
    counts = upright[:, inside].sum(axis=1)
    return Screen(
        before, low[0] + side * spans, float(inside.mean()), side * (int(counts.argmax()) + 2.5)
    )


def _uprights(held: Mask, seen: Mask, cell: float) -> Mask:
    """Which columns of cells of each layer are uprights or nets, of shape (layers, columns).

    Parameters
    ----------
    held : cells that hold points before the wall, array of shape (layers, columns, rows)
    seen : cells in which the wall or what is behind it is seen, array of shape (columns, rows)
    cell : side of a cell in metres
    """
    found = np.zeros(held.shape[:2], bool)
    first = round((NEAREST - JOINED) / cell)
    two = np.zeros_like(held)
    two[first:-1] = held[first:-1] | held[first + 1 :]
    two[:, :-1] |= two[:, 1:]
    long = _long(two, round(BREAK / cell), round(LONG / cell))
    beside = ndimage.binary_dilation(seen, np.ones((3, 1), bool))
    for layer in np.flatnonzero(long.any(axis=(1, 2))).tolist():
        between = np.asarray(held[: layer - 1].mean(axis=0) >= HALF)
        joined = ndimage.binary_dilation(between, np.ones((3, 1), bool))
        standing = long[layer].any(axis=1)
        wide = np.asarray(long[max(layer - 1, 0) : layer + 2].any(axis=(0, 2)))
        groups, _ = ndimage.label(ndimage.binary_opening(wide, np.ones(WIDE, bool)))
        wide = ndimage.binary_dilation(groups > 0)
        for column in np.flatnonzero(standing & ~wide).tolist():
            run = long[layer, column]
            free = ~joined[column, run & two[layer, column]]
            found[layer, column] = free.mean() >= FREE and beside[column, run].mean() >= THROUGH
        for (place,) in ndimage.find_objects(groups):
            run = long[layer, place]
            # Past its edges the wall is seen.
            inner = ndimage.binary_erosion(np.asarray(run.any(axis=1)))
            free = ~joined[place][run & two[layer, place]]
            if not inner.any() or free.mean() < FREE:
                continue
            through = [
                float(cells[one].mean())
                for one, cells in zip(run[inner], seen[place][inner], strict=True)
                if one.any()
            ]
            if np.quantile(through, FEW) >= POROUS:
                found[layer, place] = standing[place]
    return found


def _count(columns: NDArray[np.int64], apart: float) -> int:
    """How many columns there are, no two of which are nearer than that."""
    count, last = 0, -apart
    for column in columns.tolist():
        if column - last >= apart:
            count, last = count + 1, column
    return count


def _long(held: Mask, gap: int, least: int) -> Mask:
    """Cells of runs along the last axis, in which gaps are closed, of a least length."""
    pad = ((0, 0), (0, 0), (gap, gap))
    closed = ndimage.binary_closing(np.pad(held, pad), np.ones((1, 1, gap + 1), bool))
    only_along = np.zeros((3, 3, 3), bool)
    only_along[1, 1] = True
    runs, _ = ndimage.label(closed[..., gap:-gap], only_along)
    sizes = np.bincount(runs.ravel())
    sizes[0] = 0
    return np.asarray((sizes >= least)[runs])
