"""Reading and writing LAS, LAZ and COPC files with laspy and lazrs.

Every file is checked before these see it (see also `las_header`), so that a damaged one ends in a
message and not in a hang, and records are put back as they were.

References
----------
ASPRS (2019). LAS specification 1.4, R15. Isenburg, M. (2013). LASzip: lossless compression of
LiDAR data. Bell, A. et al. (2021). COPC: cloud optimized point cloud, 1.0.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import laspy
import lazrs
import numpy as np
from laspy.copc import Bounds, CopcInfoVlr, HierarchyPage, load_octree_for_query
from laspy.errors import LaspyException
from numpy.typing import NDArray

from toolbox.context import QUIET, Context, log
from toolbox.data.las.crs import read_crs
from toolbox.data.las.header import SIZES, Frame, demand, read_frame
from toolbox.data.las.points import attribute, box_of
from toolbox.errors import DataError

_BLOCK = 1_000_000  # points between two reports of progress
_GROUP = 20  # chunks between two reports; most have 50 000 points
_LAYERED = 3  # compressor: each attribute of a chunk in a layer of its own
_LAYERS = {6: 9, 7: 10, 8: 11, 9: 10, 10: 12}  # of a point format; and one per extra byte
_MIXED = "lazrs does not keep the wave packets of several scanner channels in LAZ"
_DENSEST = 1000  # points per compressed byte; identical points, the densest there are, reach 150

_BAD = (ArithmeticError, TypeError, ValueError, struct.error)

Array = NDArray[Any]
Chunk = list[int]
"""Compressed points: where in the file, how many bytes, how many points."""


def read_las(
    path: Path,
    *,
    bounds: Sequence[float] | None = None,
    part: tuple[int, int] | None = None,
    ctx: Context = QUIET,
) -> tuple[Frame, Array]:
    """Read a LAS, LAZ or COPC file.

    Parameters
    ----------
    path : of an existing file
    bounds : (xmin, ymin, xmax, ymax); of a COPC file only the nodes that touch it are read,
        of others everything
    part : only the points from the first of these places in the file to before the second; of a
        compressed file the chunks that hold them are unpacked
    ctx : progress is reported every million points

    Returns
    -------
    frame : all but the points
    record : packed point records, of shape (n,)

    Raises
    ------
    DataError
        The file is damaged or of an unknown kind; says which rule it breaks.
    """
    size = path.stat().st_size
    with _named(path), path.open("rb") as stream:
        frame = read_frame(stream, size, lambda text: log.warning("%s %s", path.name, text))
        with _errors("is damaged: its points cannot be read"):
            record = _read_points(stream, frame, size, bounds, part, ctx)
    _check_box(frame.header, record, path.name)
    if frame.laszip and _mixes_waveforms(frame, record):
        log.warning("%s: %s; read with care", path.name, _MIXED)
    return _with_crs(frame, path), record


def read_header(path: Path, warn: Callable[[str], None]) -> Frame:
    """Read and check all but the points of a LAS, LAZ or COPC file.

    Parameters
    ----------
    path : of an existing file
    warn : is told what is odd but does no harm, without the name of the file

    Raises
    ------
    DataError
        The file is damaged or of an unknown kind; says which rule it breaks.
    """
    with _named(path), path.open("rb") as stream:
        frame = read_frame(stream, path.stat().st_size, warn)
    return _with_crs(frame, path)


def chunk_sizes(path: Path) -> list[int] | None:
    """Points in each chunk of a compressed file, in its order; None of one that is not.

    Raises
    ------
    DataError
        The file is damaged; says which rule it breaks.
    """
    size = path.stat().st_size
    with _named(path), path.open("rb") as stream:
        frame = read_frame(stream, size, lambda text: None)
        if frame.header.point_count == 0 or not frame.header.are_points_compressed:
            return None
        with _errors("is damaged: its points cannot be read"):
            _check_laszip(frame)
            return [points for *_, points in _all_chunks(stream, frame, size)]


def _with_crs(frame: Frame, path: Path) -> Frame:
    crs = read_crs(frame.records, wkt=frame.header.global_encoding.wkt, name=path.name)
    return replace(frame, crs=crs)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Name the file in what is said of it."""
    try:
        yield
    except MemoryError as error:
        raise DataError(f"{path} claims more points than fit in memory") from error
    except DataError as error:
        raise DataError(f"{path} {error}") from error


@contextmanager
def _errors(text: str) -> Iterator[None]:
    """Turn what laspy and lazrs raise into a DataError; a panic in Rust is no Exception."""
    try:
        yield
    except (LaspyException, lazrs.LazrsError, *_BAD) as error:
        raise DataError(f"{text} ({error})") from error
    except BaseException as error:
        if type(error).__name__ != "PanicException":
            raise
        raise DataError(f"{text} ({error})") from error


def _read_points(
    stream: BinaryIO,
    frame: Frame,
    size: int,
    bounds: Sequence[float] | None,
    part: tuple[int, int] | None,
    ctx: Context,
) -> Array:
    header = frame.header
    start, stop = part or (0, header.point_count)
    demand(0 <= start <= stop <= header.point_count, f"has no points {start} to {stop}")
    if header.point_count == 0 or not header.are_points_compressed:
        return _read_plain(stream, header, start, stop, ctx)
    _check_laszip(frame)
    if bounds is not None and frame.copc:
        chunks = _copc_chunks(stream, frame, size, bounds)
    else:
        chunks = _all_chunks(stream, frame, size)
    ahead = 0
    if part:
        chunks, ahead = _covering(chunks, start, stop)
    _check_chunks(stream, frame, chunks)
    record = _read_chunks(stream, frame, chunks, ctx)
    return record[ahead : ahead + stop - start] if part else record


def _covering(chunks: list[Chunk], start: int, stop: int) -> tuple[list[Chunk], int]:
    """The chunks with the points from start to before stop, and how many come ahead of these."""
    ends = np.cumsum([points for *_, points in chunks])
    first = int(np.searchsorted(ends, start, side="right"))
    last = int(np.searchsorted(ends, stop, side="left"))
    kept = chunks[first : last + 1] if start < stop else []
    return kept, start - (int(ends[first - 1]) if first else 0)


def _read_plain(
    stream: BinaryIO, header: laspy.LasHeader, start: int, stop: int, ctx: Context
) -> Array:
    record = np.empty(stop - start, header.point_format.dtype())
    stream.seek(header.offset_to_point_data + start * record.itemsize)
    for place in range(0, len(record), _BLOCK):
        ctx.progress(place / len(record))
        block = record[place : place + _BLOCK]
        block[:] = np.fromfile(stream, record.dtype, len(block))
    return record


def _read_chunks(stream: BinaryIO, frame: Frame, chunks: list[Chunk], ctx: Context) -> Array:
    """The points of chunks.

    Not with the reader of laspy: it sets memory aside for as many points as the LASzip record
    claims for a chunk, and ends the process if there is not so much.
    """
    record = np.empty(sum(points for *_, points in chunks), frame.header.point_format.dtype())
    done = 0
    for number in range(0, len(chunks), _GROUP):
        ctx.progress(number / len(chunks))
        group = chunks[number : number + _GROUP]
        data = b"".join(_bytes(stream, start, size) for start, size, _ in group)
        table = [(points, size) for _, size, points in group]
        block = record[done : done + sum(points for points, _ in table)]
        lazrs.decompress_points_with_chunk_table(data, frame.laszip, block.view("u1"), table)
        done += len(block)
    return record


def _bytes(stream: BinaryIO, start: int, size: int) -> bytes:
    stream.seek(start)
    return stream.read(size)


def _check_laszip(frame: Frame) -> None:
    """Whether lazrs knows this way of compression, and its items make up a point record."""
    with _errors("has a damaged LASzip record"):
        length = lazrs.LazVlr(frame.laszip).item_size()
    compressor, coder = struct.unpack_from("<HH", frame.laszip)
    demand(
        compressor in (2, _LAYERED) and coder == 0,
        f"is compressed in the way {compressor} (coder {coder}) of LASzip; only chunked files "
        "(2 and 3) can be read, as LASzip writes them since 2011",
    )
    stated = frame.header.point_format.size
    same = length == stated
    demand(same, f"has point records of {stated} bytes, but compressed ones of {length}")


def _all_chunks(stream: BinaryIO, frame: Frame, size: int) -> list[Chunk]:
    """The chunks in the order of the file, from its chunk table.

    lazrs sets memory aside for as many chunks as the table claims, so they are looked at first.
    """
    header, laszip = frame.header, lazrs.LazVlr(frame.laszip)
    start, total = header.offset_to_point_data, header.point_count
    demand(start + 8 <= size, "is cut off where its points begin")
    (table,) = struct.unpack("<q", _bytes(stream, start, 8))
    if table == -1:  # of a file written as a stream
        (table,) = struct.unpack("<q", _bytes(stream, size - 8, 8))
    inside = start + 8 <= table <= size - 8
    demand(inside, f"is cut off or damaged: its table of chunks should be at {table} of {size}")
    room = table - start - 8
    _, count = struct.unpack("<II", _bytes(stream, table, 8))
    possible = count * header.point_format.size <= room
    demand(possible, f"claims {count} chunks of points in {room} bytes")
    stream.seek(start)
    pairs = lazrs.read_chunk_table(stream, laszip)
    points, sizes = np.array(pairs, float).reshape(-1, 2).T
    fits = len(pairs) == count and sizes.sum() <= room
    demand(fits, "has a damaged chunk table: its chunks do not fit before it")
    if count and not laszip.uses_variable_size_chunks():
        points[:] = laszip.chunk_size()
        points[-1] = np.clip(total - points[:-1].sum(), 0, points[-1])
    demand(
        points.sum() == total,
        f"is cut off or damaged: its header promises {total} points, and its chunks hold "
        f"{points.sum():.0f}",
    )
    starts = start + 8 + np.cumsum(sizes) - sizes
    chunks: list[Chunk] = np.stack([starts, sizes, points], axis=1).astype(np.int64).tolist()
    return chunks


def _check_chunks(stream: BinaryIO, frame: Frame, chunks: list[Chunk]) -> None:
    """Whether the chunks can hold their points.

    In layers a chunk begins with a plain point, the number of points, and the size of each layer,
    for which lazrs would set memory aside before it looks whether they are there.
    """
    layout = frame.header.point_format
    layers = _LAYERS.get(layout.id, 0) + layout.num_extra_bytes
    ahead = layout.size + 4
    for start, size, points in chunks:
        dense = points > _DENSEST * size
        demand(not dense, f"is damaged: it claims {points} points in {size} bytes")
        if frame.laszip[0] == _LAYERED:
            data = _bytes(stream, start + ahead, 4 * layers)
            needed = ahead + len(data) + sum(memoryview(data[: len(data) // 4 * 4]).cast("I"))
            demand(
                len(data) == 4 * layers and needed <= size,
                f"is damaged: the chunk of points at byte {start} is incomplete",
            )


class _Pages:
    """Pages of a COPC hierarchy; laspy would follow pages in a circle for ever."""

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


def _copc_chunks(stream: BinaryIO, frame: Frame, size: int, bounds: Sequence[float]) -> list[Chunk]:
    """The chunks of the octree nodes that touch the bounds, in the order of the file."""
    info, pages = CopcInfoVlr(), _Pages(stream, size)
    with _errors("has a damaged COPC record"):
        info.parse_record_data(frame.copc)
    pages.seek(info.hierarchy_root_offset)
    root = HierarchyPage.from_bytes(pages.read(info.hierarchy_root_size))
    box = Bounds(np.array([*bounds[:2], -np.inf]), np.array([*bounds[2:], np.inf]))
    nodes = load_octree_for_query(pages, info, root, box)
    chunks = [[node.offset, node.byte_size, node.point_count] for node in nodes]
    chunks = sorted(chunk for chunk in chunks if chunk[2] > 0)
    fits = all(0 < length <= size - start for start, length, _ in chunks)
    fits &= sum(points for *_, points in chunks) <= frame.header.point_count
    demand(fits, "has a damaged COPC hierarchy")
    return chunks


def _check_box(header: laspy.LasHeader, record: Array, name: str) -> None:
    """Log a bounding box that does not contain the points; it is computed anew on writing."""
    if len(record) == 0:
        return
    corners = box_of(header, record)
    near = np.abs(header.scales)
    if not (np.all(header.mins <= corners[0] + near) and np.all(header.maxs >= corners[1] - near)):
        log.warning(
            "%s: the bounding box in its header does not contain its points; the points are used",
            name,
        )


def _mixes_waveforms(frame: Frame, record: Array) -> bool:
    """Whether compression spoils the wave packets (as of lazrs 0.8)."""
    return len(_waveform_channels(frame, record)) > 1


def _waveform_channels(frame: Frame, record: Array) -> set[int]:
    """The scanner channels of points that have wave packets."""
    if frame.header.point_format.id not in (9, 10):
        return set()
    channels = attribute(frame.header.point_format, record, "scanner_channel")
    return set(np.unique(channels).tolist())


def write_las(
    path: Path, frame: Frame, record: Array, *, compress: bool, ctx: Context = QUIET
) -> None:
    """Write records and frame as they are; counts, bounds and places are computed anew.

    Raises
    ------
    DataError
        The points are too many for the version of LAS, or LAZ would not keep their waveforms.
    """
    with las_sink(path, frame, compress=compress) as write:
        for place in range(0, len(record), _BLOCK):
            ctx.progress(place / len(record))
            write(record[place : place + _BLOCK])


@contextmanager
def las_sink(path: Path, frame: Frame, *, compress: bool) -> Iterator[Callable[[Array], None]]:
    """Write a file block by block: gives the function that writes records of shape (n,).

    The file does not depend on how the records are divided.

    Raises
    ------
    DataError
        As for :func:`write_las`.
    """
    header = frame.header.copy()
    header.vlrs.clear()
    header.vlrs.extend(laspy.VLR("", 0, "", vlr.data) for vlr in frame.vlrs)  # see _restore
    channels: set[int] = set()
    with path.open("wb") as stream, _errors(f"{path} cannot be written"):
        writer = laspy.LasWriter(stream, header, compress, closefd=False, encoding_errors="ignore")

        def write(record: Array) -> None:
            if header.version.minor < 4 and writer.header.point_count + len(record) >= 2**32:
                raise DataError(f"{path}: LAS {header.version} holds fewer than 2^32 points")
            channels.update(_waveform_channels(frame, record))
            if compress and len(channels) > 1:
                raise DataError(f"{path}: {_MIXED}; write .las")
            block = np.ascontiguousarray(record)
            writer.write_points(laspy.PackedPointRecord(block, header.point_format))

        yield write
        writer.point_writer.done()
        writer.done = True
        _write_evlrs(stream, frame, writer.header)
        _tidy_box(frame.header, writer.header)
        writer.close()
        _restore(stream, frame, writer.header)


def _write_evlrs(stream: BinaryIO, frame: Frame, header: laspy.LasHeader) -> None:
    """Records after the points, which laspy does not write in LAS 1.3, and their places."""
    start = stream.seek(0, 2)
    if not header.global_encoding.waveform_data_packets_external:
        header.start_of_waveform_data_packet_record = 0
    for evlr in frame.evlrs:
        if evlr is frame.waveform:
            header.start_of_waveform_data_packet_record = stream.tell()
        stream.write(evlr.head + evlr.data)
    header.start_of_first_evlr = start if frame.evlrs else 0
    header.number_of_evlrs = len(frame.evlrs)


def _tidy_box(stated: laspy.LasHeader, header: laspy.LasHeader) -> None:
    """The bounding box as in the source where the points agree with it within half a step."""
    if header.point_count:
        low, high = np.sort([header.mins, header.maxs], axis=0)
        half = np.abs(header.scales) / 2
        header.mins = np.where(np.abs(stated.mins - low) <= half, stated.mins, low)
        header.maxs = np.where(np.abs(stated.maxs - high) <= half, stated.maxs, high)


def _restore(stream: BinaryIO, frame: Frame, header: laspy.LasHeader) -> None:
    """What laspy cannot write: LAS 1.0, no date, counts for older readers, texts to the byte."""
    minor = frame.minor if header.version.minor <= 2 else header.version.minor
    stream.seek(25)
    stream.write(bytes([minor]) + frame.texts)
    if header.point_format.id < 6 and header.point_count < 2**32:
        counts = header.number_of_points_by_return[:5]
        stream.seek(107)
        stream.write(struct.pack("<6I", header.point_count, *map(int, counts)))
    stream.seek(SIZES[header.version.minor] + len(header.extra_header_bytes))
    stream.write(b"".join(vlr.head + vlr.data for vlr in frame.vlrs))
