"""Which chunks of a COPC file hold the points within bounds.

References
----------
Bell, A. et al. (2021). COPC: cloud optimized point cloud, 1.0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import BinaryIO

import numpy as np
from laspy.copc import Bounds, CopcInfoVlr, HierarchyPage, load_octree_for_query

from toolbox.data.las.header import Chunk, LasMetadata, demand, library_errors


class _Pages:
    """A file of which laspy reads pages of the COPC hierarchy, each once and within the file."""

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self._stream, self._size = stream, size
        self._seen: set[int] = set()

    def seek(self, start: int) -> None:
        demand(start < self._size and start not in self._seen, "has a damaged COPC hierarchy")
        self._seen.add(self._stream.seek(start))

    def read(self, length: int) -> bytes:
        room = self._size - self._stream.tell()
        demand(0 <= length <= room, "has a damaged COPC hierarchy")
        return self._stream.read(length)


def copc_chunks(
    stream: BinaryIO, metadata: LasMetadata, size: int, bounds: Sequence[float]
) -> list[Chunk]:
    """The chunks of the octree nodes that touch the bounds, in the order of the file."""
    info, pages = CopcInfoVlr(), _Pages(stream, size)
    with library_errors("has a damaged COPC record"):
        info.parse_record_data(metadata.copc)
    pages.seek(info.hierarchy_root_offset)
    root = HierarchyPage.from_bytes(pages.read(info.hierarchy_root_size))
    box = Bounds(np.array([*bounds[:2], -np.inf]), np.array([*bounds[2:], np.inf]))
    nodes = load_octree_for_query(pages, info, root, box)
    chunks = [[node.offset, node.byte_size, node.point_count] for node in nodes]
    chunks = sorted(chunk for chunk in chunks if chunk[2] > 0)
    fits = all(0 < length <= size - start for start, length, _ in chunks)
    fits &= sum(points for *_, points in chunks) <= metadata.header.point_count
    demand(fits, "has a damaged COPC hierarchy")
    return chunks
