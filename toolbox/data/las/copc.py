"""Which chunks of a COPC file hold the points within bounds.

The whole hierarchy is read, and compared with the header: a damaged cube or node would be sought at
another place, and its points be missing without a word.

References
----------
Bell, A. et al. (2021). COPC: cloud optimized point cloud, 1.0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, BinaryIO

import numpy as np
from laspy.copc import CopcInfoVlr
from numpy.typing import NDArray

from toolbox.data.las.header import Chunk, LasMetadata, demand
from toolbox.data.reading import errors_named

# The key of a node is its level, and its x, y, z among the nodes of that level.
_ENTRY = np.dtype([("key", "<i4", 4), ("offset", "<u8"), ("size", "<i4"), ("points", "<i4")])
_PAGE = -1  # number of points of an entry that stands for another page
_DEEPEST = 30  # level, whose x, y and z still fit their type
_DAMAGED = "has a damaged COPC hierarchy"


def copc_chunks(
    stream: BinaryIO, metadata: LasMetadata, size: int, bounds: Sequence[float]
) -> list[Chunk]:
    """The chunks of the octree nodes that touch the bounds, in the order of the file.

    Raises
    ------
    DataError
        The hierarchy does not hold all points of the header, or its cube not their bounds.
    """
    info = CopcInfoVlr()
    with errors_named("has a damaged COPC record"):
        info.parse_record_data(metadata.copc)
    _check_cube(info, metadata)
    nodes = _nodes(stream, info, size)
    _check_keys(nodes["key"])
    total = int(nodes["points"].sum(dtype=np.int64))
    count = metadata.header.point_count
    demand(total == count, f"{_DAMAGED}: it holds {total} points, and the header promises {count}")
    nodes = nodes[nodes["points"] > 0]
    fits = (nodes["size"] > 0) & (nodes["offset"] < size)
    fits &= nodes["offset"] + nodes["size"].astype(np.uint64) <= size
    demand(bool(fits.all()), _DAMAGED)
    edge = 2 * info.halfsize / 2.0 ** nodes["key"][:, :1]
    low = (info.center - info.halfsize)[:2] + nodes["key"][:, 1:3] * edge
    step = np.abs(metadata.header.scales[:2])  # by which points may be beyond the edge of a node
    touching = ((low - step <= bounds[2:]) & (low + edge + step >= bounds[:2])).all(axis=1)
    chunks = zip(
        *(nodes[touching][name].tolist() for name in ("offset", "size", "points")), strict=True
    )
    return sorted(map(list, chunks))


def _check_cube(info: CopcInfoVlr, metadata: LasMetadata) -> None:
    """Raise a DataError unless the cube of the octree holds the bounds of the header."""
    header = metadata.header
    low, high = info.center - info.halfsize, info.center + info.halfsize
    step = np.abs(header.scales)  # by which bounds may be rounded
    inside = (low - step <= header.mins) & (header.maxs <= high + step)
    demand(
        bool(inside.all()) and bool(np.isfinite(info.halfsize)),
        f"has a damaged COPC record: its cube from {low.tolist()} to {high.tolist()} does not hold "
        f"the bounds of the header, from {header.mins.tolist()} to {header.maxs.tolist()}",
    )


def _nodes(stream: BinaryIO, info: CopcInfoVlr, size: int) -> NDArray[Any]:
    """The entries of all pages of the hierarchy, without those that stand for a page."""
    waiting = [(info.hierarchy_root_offset, info.hierarchy_root_size)]
    seen: set[int] = set()
    found = [np.empty(0, _ENTRY)]
    while waiting:
        start, length = waiting.pop()
        demand(start not in seen and 0 <= length <= size - start, _DAMAGED)
        demand(length % _ENTRY.itemsize == 0, _DAMAGED)
        seen.add(start)
        stream.seek(start)
        page = np.frombuffer(stream.read(length), _ENTRY)
        is_page = page["points"] == _PAGE
        found.append(page[~is_page])
        waiting += zip(*(page[is_page][name].tolist() for name in ("offset", "size")), strict=True)
    nodes = np.concatenate(found)
    demand(bool((nodes["points"] >= 0).all()), _DAMAGED)
    return nodes


def _check_keys(keys: NDArray[np.int32]) -> None:
    """Raise a DataError unless each node is in the cube, is there once, and has its parent."""
    level, place = keys[:, :1], keys[:, 1:].astype(np.int64)
    within = (level >= 0) & (level <= _DEEPEST) & (place >= 0) & (place < 2.0**level)
    there = set(map(tuple, keys.tolist()))
    below = keys[keys[:, 0] > 0]
    parents = np.column_stack([below[:, 0] - 1, below[:, 1:] // 2])
    whole = len(there) == len(keys) and there >= set(map(tuple, parents.tolist()))
    demand(bool(within.all()) and whole, f"{_DAMAGED}: a node is at a place that cannot be")
