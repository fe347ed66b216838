"""The octree of a COPC file: which point stands in which node.

At level l the cube of the file is cut into 128 * 2^l cells along each side, and of the points in a
cell the one with the lowest priority is shown. Priorities are mixed from the coordinates, so which
point it is depends on nothing but the points of that cell: not on their order, on blocks, or on
tiles. Cells of one level are cut into those of the next, so a point that is shown at a level is
shown at all finer ones; it stands in the node of the first. A node with few points and none below
it gives them to its parent.

References
----------
Bell, A. et al. (2021). COPC: cloud optimized point cloud, 1.0.
Schütz, M., Ohrhallinger, S. and Wimmer, M. (2020). Fast out-of-core octree generation for massive
point clouds. Computer Graphics Forum 39(7), 155-167: sampling by cells of a grid in each node.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

CELLS = 128
"""Cells along a side of a node, as other writers of COPC have it: some 16 000 on a surface."""

FEWEST = 1000
"""Points below which a node is not worth a chunk: an eighth of its parent gets a quarter denser."""

_BITS = 7  # of CELLS
_DEEPEST = 14  # level; with 7 bits for the cells of a node, three coordinates fit in 63 bits
_BLOCK = 65_536  # points, whose arrays fit into the cache of a processor
_CROWDED = 0.7  # share of points still shown, below which the others are put aside
_DENSER = 4  # levels beyond that of the mean density, for places that are up to 256 times denser

Codes = NDArray[np.uint64]
Levels = NDArray[np.uint8]


class Cube(NamedTuple):
    """The cube of an octree.

    Attributes
    ----------
    low : its lowest corner, of shape (3,)
    side : its length
    depth : the deepest level
    """

    low: NDArray[np.float64]
    side: float
    depth: int

    @classmethod
    def around(cls, low: NDArray[Any], high: NDArray[Any], step: float, count: int) -> Cube:
        """The cube around `count` points between two corners, with a `step` of room."""
        side = float((high - low).max()) * (1 + 1e-9) + 2 * step
        mean = math.ceil(math.log2(max(math.sqrt(count) / CELLS, 1)))
        return cls(np.asarray(low, float) - step, side, min(mean + _DENSER, _DEEPEST))

    def codes(self, axes: NDArray[np.float64]) -> Codes:
        """The cell of each point at the deepest level, x, y and z bit by bit (Morton order).

        Parameters
        ----------
        axes : x, y and z, of shape (3, n)
        """
        found = np.empty(axes.shape[1], np.uint64)
        for start in range(0, len(found), _BLOCK):
            index = self._cells(axes[:, start : start + _BLOCK], _BITS + self.depth)
            part = _spread(index[0])
            part |= _spread(index[1]) << np.uint64(1)
            part |= _spread(index[2]) << np.uint64(2)
            found[start : start + _BLOCK] = part
        return found

    def coarse(self, axes: NDArray[np.float64], level: int) -> NDArray[np.int64]:
        """The node of a level that holds each point, numbered row by row and not by its code.

        Parameters
        ----------
        axes : x, y and z, of shape (3, n)
        """
        found = np.empty(axes.shape[1], np.int64)
        for start in range(0, len(found), _BLOCK):
            x, y, z = self._cells(axes[:, start : start + _BLOCK], level).view(np.int64)
            found[start : start + _BLOCK] = ((x << level) | y) << level | z
        return found

    def codes_of(self, coarse: NDArray[np.int64], level: int) -> Codes:
        """The codes of nodes that :meth:`coarse` has numbered."""
        one = (1 << level) - 1
        x, y, z = coarse >> 2 * level, (coarse >> level) & one, coarse & one
        found: Codes = _spread(x.astype(np.uint64))
        found |= _spread(y.astype(np.uint64)) << np.uint64(1)
        found |= _spread(z.astype(np.uint64)) << np.uint64(2)
        return found

    def _cells(self, axes: NDArray[np.float64], bits: int) -> Codes:
        """The x, y and z, of shape (3, n), of the cell of each point, 2^bits along a side."""
        count = 1 << bits
        place = axes - self.low[:, None]
        place *= count / self.side
        return np.minimum(place.astype(np.uint64), np.uint64(count - 1))

    def shift(self, level: int) -> np.uint64:
        """Bits of a code below those of the node of a level."""
        return np.uint64(3 * (_BITS + self.depth - level))


def _spread(values: Codes) -> Codes:
    """Two zero bits between each of 21 bits."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        values = (values | (values << np.uint64(shift))) & np.uint64(mask)
    return values


def place(code: int) -> tuple[int, int, int]:
    """The x, y and z of a node among those of its level.

    >>> place(0b111_010)
    (2, 3, 2)
    """
    axes = (sum(((code >> (3 * bit + axis)) & 1) << bit for bit in range(21)) for axis in range(3))
    x, y, z = axes
    return x, y, z


def priorities(records: NDArray[Any]) -> Codes:
    """A number for each point, mixed from its whole coordinates, the fields X, Y and Z.

    The upper half is mixed (the finaliser of MurmurHash3), the lower one the rank among points of
    equal coordinates, so that no two are equal in one array.
    """
    found = np.arange(len(records), dtype=np.uint64)
    for start in range(0, len(records), _BLOCK):
        block = records[start : start + _BLOCK]
        mixed = np.zeros(len(block), np.uint64)
        for axis in "XYZ":
            mixed ^= block[axis].astype(np.int64).view(np.uint64)
            for factor in (0xFF51AFD7ED558CCD, 0xC4CEB9FE1A85EC53):
                mixed ^= mixed >> np.uint64(33)
                mixed *= np.uint64(factor)
            mixed ^= mixed >> np.uint64(33)
        found[start : start + len(block)] |= mixed & np.uint64(0xFFFFFFFF00000000)
    return found


def levels_of(codes: Codes, priority: Codes, cube: Cube) -> Levels:
    """The level of each point: the first at which it is the one that its cell shows.

    Parameters
    ----------
    codes : sorted
    """
    levels = np.zeros(len(codes), np.uint8)
    together = _last_level_together(codes, cube)
    shown, stays, left = np.arange(len(codes)), np.ones(len(codes), bool), len(codes)
    for level in range(cube.depth - 1, -1, -1):
        lost = _not_lowest(together >= level, priority)
        lost = lost[stays[lost]]
        levels[shown[lost]] = level + 1
        stays[lost] = False
        left -= len(lost)
        if left < _CROWDED * len(stays):  # those that are out harm nothing but take time
            kept = np.flatnonzero(stays)
            # two that follow each other now were parted where any between them were
            together = np.minimum.reduceat(together, np.r_[0, kept[:-1] + 1])
            priority, shown = priority[kept], shown[kept]
            stays = np.ones(left, bool)
    return levels


def _last_level_together(codes: Codes, cube: Cube) -> NDArray[np.int8]:
    """The last level at which each point shares its cell with the one before it, -1 for none.

    Parameters
    ----------
    codes : sorted, at least one
    """
    found = np.full(len(codes), -1, np.int8)
    for start in range(1, len(codes), _BLOCK):
        part = codes[start : start + _BLOCK]
        differ = part ^ codes[start - 1 : start - 1 + len(part)]
        bits = np.frexp(differ.astype(np.float64))[1]  # exact to 53, and a cell has 3 * depth
        found[start : start + len(part)] = np.maximum(cube.depth - (bits + 2) // 3, -1)
    return found


def _not_lowest(as_before: NDArray[np.bool_], rank: Codes) -> NDArray[np.intp]:
    """Indices of all but the lowest of each group; no two ranks are equal.

    Parameters
    ----------
    as_before : whether each is of the group of the one before it
    """
    several = as_before.copy()  # whether a group has another one
    several[:-1] |= as_before[1:]
    among = np.flatnonzero(several)
    if not len(among):
        return among
    starts = np.flatnonzero(~as_before[among])
    rank = rank[among]
    lowest = np.minimum.reduceat(rank, starts)
    higher: NDArray[np.bool_] = rank != np.repeat(lowest, np.diff(starts, append=len(among)))
    return among[higher]


def merge_small(
    levels: Levels, codes: Codes, cube: Cube, last: int, below: Codes | None = None
) -> Codes:
    """Give the points of small nodes to their parents, in place; gives nodes above `last`.

    Parameters
    ----------
    levels, codes : of points sorted by code
    last : the coarsest level whose nodes are merged
    below : parents of nodes of a deeper level that stay, if not all of them are among the points

    Returns
    -------
    array
        Codes of the nodes of level last - 1 that have something below them.
    """
    kept = np.empty(0, np.uint64) if below is None else below
    for level in range(int(levels.max(initial=0)), last - 1, -1):
        here = np.flatnonzero(levels == level)
        nodes = codes[here] >> cube.shift(level)
        starts = starts_of(nodes)
        names, size = nodes[starts], np.diff(starts, append=len(here))
        stays = (size >= FEWEST) | np.isin(names, kept)
        levels[here[np.repeat(~stays, size)]] = level - 1
        kept = np.unique(np.concatenate([names[stays], kept]) >> np.uint64(3))
    return kept


def starts_of(values: Codes) -> NDArray[np.intp]:
    """Where each run of equal values begins."""
    new = np.ones(len(values), bool)
    np.not_equal(values[1:], values[:-1], out=new[1:])
    return np.flatnonzero(new)
