"""COPC files written with lazrs: points sorted into the nodes of an octree, each one chunk of LAZ.

The points are looked at in parts of the cube that fit into memory. Cells that show a point lie
within one part, so parts do not show in the file.

References
----------
Bell, A. et al. (2021). COPC: cloud optimized point cloud, 1.0.
"""

from __future__ import annotations

import io
import itertools
import mmap
import struct
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import lazrs
import numpy as np
from numpy.typing import NDArray

from toolbox.context import QUIET, Context
from toolbox.data.las.header import LasMetadata, Vlr
from toolbox.data.las.octree import (
    CELLS,
    Codes,
    Cube,
    Levels,
    levels_of,
    merge_small,
    place,
    priorities,
    starts_of,
)
from toolbox.data.las.points import attribute, axes_of, box_of
from toolbox.data.las.versions import recast
from toolbox.data.las.write import empty_file, las_sink
from toolbox.data.paths import is_copc, suffix_of
from toolbox.data.reading import errors_named
from toolbox.errors import DataError

_BLOCK = 1_000_000  # points looked at when parts are chosen
_PART = 2_000_000  # points in a part, which takes some 400 MB
_FINEST = 6  # level of the nodes that are parts at most
_GROUP = 64  # chunks that are compressed at the same time
_INFO = struct.Struct("<5d2Q2d88x")  # of the COPC info VLR
_ENTRY = struct.Struct("<4iQ2i")  # of the hierarchy
_RETURNS = 15
_LEVEL = 48  # bit of a key above those of the code of a node

Array = NDArray[Any]
Indices = NDArray[np.integer[Any]]


def points_sink(
    path: Path, metadata: LasMetadata
) -> AbstractContextManager[Callable[[Array], None]]:
    """Write LAS, LAZ or COPC, as the name of the file says, by calling the result with points."""
    if is_copc(path):
        return copc_sink(path, metadata)
    return las_sink(path, metadata, compress=suffix_of(path) == ".laz")


def for_copc(metadata: LasMetadata) -> tuple[LasMetadata, Callable[[Array], Array]]:
    """The metadata of points as COPC has them, LAS 1.4 in point format 6 to 8; and a converter.

    Raises
    ------
    DataError
        They have waveforms, which COPC does not hold.
    """
    number = metadata.header.point_format.id
    if number in (4, 5, 9, 10):
        raise DataError(f"COPC holds no waveforms, which point format {number} has; write .laz")
    target = number if number >= 6 else 7 if number in (2, 3) else 6
    return recast(metadata, 4, target)


def write_copc(path: Path, metadata: LasMetadata, packed: Array, ctx: Context = QUIET) -> None:
    """Write a COPC file of points that are in memory.

    Raises
    ------
    DataError
        COPC cannot hold them, or the file cannot be written.
    """
    metadata, convert = for_copc(metadata)
    with path.open("wb") as stream, errors_named(f"{path} cannot be written"):
        _write(stream, metadata, np.ascontiguousarray(convert(packed)), ctx)


@contextmanager
def copc_sink(path: Path, metadata: LasMetadata) -> Iterator[Callable[[Array], None]]:
    """Open a COPC file to write; gives the function that appends point records (n,).

    They are kept in a hidden file beside it, until all are there.

    Raises
    ------
    DataError
        As for :func:`write_copc`.
    """
    metadata, convert = for_copc(metadata)
    draft = path.with_name(f".{path.name}.points")
    dtype, count = metadata.header.point_format.dtype(), 0

    def write(packed: Array) -> None:
        nonlocal count
        np.ascontiguousarray(convert(packed)).tofile(kept)
        count += len(packed)

    try:
        with draft.open("wb") as kept:
            yield write
        records = np.memmap(draft, dtype, "r") if count else np.empty(0, dtype)
        with path.open("wb") as stream, errors_named(f"{path} cannot be written"):
            _write(stream, metadata, records, QUIET)
    finally:
        draft.unlink(missing_ok=True)


@dataclass
class _Chunks:
    """Compresses nodes one after the other, and remembers which they are.

    Attributes
    ----------
    nodes : level and code of each, in the order of the file
    """

    compressor: Any
    nodes: list[tuple[int, int]] = field(default_factory=list)

    def add(self, rows: Array, order: Indices, levels: Levels, codes: Codes, cube: Cube) -> None:
        """Write points by node; within one they keep their order.

        Parameters
        ----------
        rows : all points, as rows of bytes
        order : which of them, sorted by code
        levels, codes : of those, in the same order
        """
        if not len(order):
            return
        by_level = np.argsort(levels, kind="stable")  # one byte each, so sorted by counting
        order, levels, codes = order[by_level], levels[by_level], codes[by_level]
        shifts = np.array([cube.shift(level) for level in range(cube.depth + 1)], np.uint64)
        nodes = codes >> shifts[levels]
        starts = starts_of((levels.astype(np.uint64) << np.uint64(_LEVEL)) | nodes)
        self.nodes += zip(levels[starts].tolist(), nodes[starts].tolist(), strict=True)
        sizes = np.diff(starts, append=len(order))
        own = _by_number(len(rows), order, sizes)
        waiting: list[Array] = []
        for start, stop in itertools.pairwise([*starts.tolist(), len(own)]):
            waiting.append(np.take(rows, own[start:stop], axis=0).ravel())
            if len(waiting) == _GROUP or stop == len(own):
                self.compressor.compress_chunks(waiting)
                waiting = []


def _by_number(count: int, members: Indices, sizes: Indices) -> Indices:
    """Members of groups, which follow each other, sorted within each group.

    Parameters
    ----------
    count : members are below it
    sizes : of the groups

    Examples
    --------
    >>> _by_number(9, np.array([5, 2, 8, 7, 1]), np.array([2, 3])).tolist()
    [2, 5, 1, 7, 8]
    """
    small = np.min_scalar_type(len(sizes))  # mostly 16 bits, which are sorted by counting
    group = np.full(count, len(sizes), small)
    group[members] = np.repeat(np.arange(len(sizes), dtype=small), sizes)
    return np.argsort(group, kind="stable")[: len(members)]


def _write(stream: BinaryIO, metadata: LasMetadata, records: Array, ctx: Context) -> None:
    """Write header, nodes and hierarchy."""
    layout = metadata.header.point_format
    laszip = lazrs.LazVlr.new_for_compression(layout.id, layout.num_extra_bytes, True)
    vlrs = (
        Vlr.make("copc", 1, "COPC info VLR", bytes(_INFO.size)),
        Vlr.make("laszip encoded", 22204, "by lazrs", laszip.record_data()),
        *metadata.vlrs,
    )
    head = bytearray(empty_file(replace(metadata, vlrs=vlrs, evlrs=())))
    (start,) = struct.unpack_from("<I", head, 96)
    stream.write(head[:start])
    chunks = _Chunks(lazrs.ParLasZipCompressor(stream, laszip))
    chunks.compressor.reserve_offset_to_chunk_table()
    figures = _Figures.of(metadata, records, ctx.part(0, 0.2))
    if len(records):
        _add_points(chunks, metadata, records, figures, ctx.part(0.2, 0.95))
    chunks.compressor.done()
    stream.flush()
    hierarchy = _hierarchy(stream, chunks.nodes, laszip, start)
    _finish(stream, metadata, head, figures, hierarchy)
    ctx.progress(1.0)


@dataclass(frozen=True)
class _Figures:
    """What header and octree need to know of all points.

    Attributes
    ----------
    low, high : lowest and highest coordinates
    returns : number of points by return, from 1
    times : first and last GPS time
    parts : number of points in each node of level _FINEST, as :meth:`Cube.coarse` numbers them
    """

    cube: Cube
    count: int
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    returns: NDArray[np.int64]
    times: tuple[float, float]
    parts: NDArray[np.int64]

    @classmethod
    def of(cls, metadata: LasMetadata, records: Array, ctx: Context) -> _Figures:
        header, layout = metadata.header, metadata.header.point_format
        returns = np.zeros(_RETURNS + 1, np.int64)
        boxes, times, parts = [], [], np.zeros(8**_FINEST, np.int64)
        for done, block in _blocks(records):
            ctx.progress(0.5 * done / len(records))
            boxes.append(box_of(header, block))
            returns += np.bincount(attribute(layout, block, "return_number"), minlength=16)
            times.append((block["gps_time"].min(), block["gps_time"].max()))
        low = np.min([box[0] for box in boxes], axis=0) if boxes else np.zeros(3)
        high = np.max([box[1] for box in boxes], axis=0) if boxes else np.zeros(3)
        cube = Cube.around(low, high, float(np.abs(header.scales).max()), len(records))
        for done, block in _blocks(records):
            ctx.progress(0.5 + 0.5 * done / len(records))
            nodes = cube.coarse(axes_of(header, block), _FINEST)
            parts += np.bincount(nodes, minlength=len(parts))
        span = (float(np.min(times)), float(np.max(times))) if times else (0.0, 0.0)
        return cls(cube, len(records), low, high, returns[1:], span, parts)

    @property
    def level(self) -> int:
        """The coarsest level whose nodes are small enough to be parts."""
        there = np.flatnonzero(self.parts)
        codes = self.cube.codes_of(there, _FINEST)
        for level in range(_FINEST):
            _, node = np.unique(codes >> np.uint64(3 * (_FINEST - level)), return_inverse=True)
            if np.bincount(node, self.parts[there]).max() <= _PART:
                return level
        return _FINEST


def _blocks(records: Array) -> Iterator[tuple[int, Array]]:
    """Blocks of point records, each with how many are before it."""
    for start in range(0, len(records), _BLOCK):
        yield start, records[start : start + _BLOCK]
        _let_go(records)


def _let_go(records: Array) -> None:
    """Give the pages of a file back to the system, which else count as memory of ours."""
    if isinstance(records.base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        records.base.madvise(mmap.MADV_DONTNEED)


def _parts(
    metadata: LasMetadata, records: Array, figures: _Figures, level: int
) -> Iterator[Indices]:
    """The indices of the points of each part, in their order."""
    if level == 0:
        yield np.arange(len(records))
        return
    cube, there = figures.cube, np.flatnonzero(figures.parts)
    codes = cube.codes_of(there, _FINEST) >> np.uint64(3 * (_FINEST - level))
    names, numbers = np.unique(codes, return_inverse=True)
    number_of = np.zeros(len(figures.parts), np.min_scalar_type(len(names)))
    number_of[there] = numbers
    ends = np.cumsum(np.bincount(numbers, figures.parts[there])).astype(np.int64)
    fill = np.r_[0, ends[:-1]]
    index = np.empty(len(records), np.uint32 if len(records) < 2**32 else np.int64)
    for done, block in _blocks(records):
        part = number_of[cube.coarse(axes_of(metadata.header, block), _FINEST)]
        order = np.argsort(part, kind="stable")
        sizes = np.bincount(part, minlength=len(names))
        ahead = np.cumsum(sizes) - sizes
        index[np.repeat(fill - ahead, sizes) + np.arange(len(block))] = done + order
        fill += sizes
    yield from np.split(index, ends[:-1])


def _add_points(
    chunks: _Chunks, metadata: LasMetadata, records: Array, figures: _Figures, ctx: Context
) -> None:
    """Write the nodes of all points, part by part, and those of coarser levels at the end."""
    header, cube, level = metadata.header, figures.cube, figures.level
    coarse: list[tuple[Array, Levels, Codes]] = []
    kept: list[Codes] = []
    done = 0
    plain = records.view(np.uint8).reshape(len(records), -1)
    for part in _parts(metadata, records, figures, level):
        rows = np.take(plain, part, axis=0)
        _let_go(records)
        block = rows.view(records.dtype)[:, 0]
        codes = cube.codes(axes_of(header, block))
        order = np.argsort(codes)  # which of equal codes comes first makes no difference
        ordered = codes[order]
        levels = levels_of(ordered, priorities(block)[order], cube)
        kept.append(merge_small(levels, ordered, cube, max(level, 1)))
        fine = levels >= level
        if level:
            left = np.sort(order[~fine])
            of_point = np.empty(len(levels), np.uint8)
            of_point[order] = levels
            coarse.append((rows[left], of_point[left], codes[left]))
            order, levels, ordered = order[fine], levels[fine], ordered[fine]
        chunks.add(rows, order, levels, ordered, cube)
        done += len(part)
        ctx.progress(done / figures.count)
    if level == 0:
        return
    rows, of_point, codes = (np.concatenate(found) for found in zip(*coarse, strict=True))
    order = np.argsort(codes)
    levels = of_point[order]
    merge_small(levels, codes[order], cube, 1, np.unique(np.concatenate(kept)))
    chunks.add(rows, order, levels, codes[order], cube)


def _hierarchy(stream: BinaryIO, nodes: list[tuple[int, int]], laszip: Any, start: int) -> bytes:
    """The one page of the hierarchy, from the sizes of the chunks."""
    with open(stream.name, "rb") as again:
        again.seek(start)
        table = lazrs.read_chunk_table(again, laszip) if nodes else []
    entries, at = {}, start + 8
    for (level, code), (points, size) in zip(nodes, table, strict=True):
        entries[level, code] = (at, size, points)
        at += size
    for level, code in nodes:  # what leads to a dense spot may hold no point of its own
        for up in range(1, level + 1):
            entries.setdefault((level - up, code >> 3 * up), (0, 0, 0))
    return b"".join(
        _ENTRY.pack(level, *place(code), *entries[level, code]) for level, code in sorted(entries)
    )


def _finish(
    stream: BinaryIO, metadata: LasMetadata, head: bytearray, figures: _Figures, page: bytes
) -> None:
    """Write the records behind the points, and the header with all figures."""
    end = stream.seek(0, io.SEEK_END)
    title = b"EPT hierarchy"
    stream.write(struct.pack("<2x16sHQ32s", b"copc", 1000, len(page), title) + page)
    for evlr in metadata.evlrs:
        stream.write(evlr.head + evlr.data)
    cube = figures.cube
    half = cube.side / 2
    info = _INFO.pack(
        *(cube.low + half), half, cube.side / CELLS, end + 60, len(page), *figures.times
    )
    head[104] |= 0x80
    (header_size,) = struct.unpack_from("<H", head, 94)
    head[header_size + 54 : header_size + 54 + len(info)] = info
    box = np.column_stack([figures.high, figures.low]).ravel()
    struct.pack_into("<6d", head, 179, *box)
    struct.pack_into("<QI", head, 235, end, 1 + len(metadata.evlrs))
    struct.pack_into("<Q15Q", head, 247, figures.count, *figures.returns.tolist())
    stream.seek(0)
    stream.write(head)
