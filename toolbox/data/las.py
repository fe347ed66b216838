"""Reading and writing LAS, LAZ and COPC files.

Headers and records are read and checked here (see `las_header`), and only then does lazrs see the
compressed points, chunk by chunk, so that a damaged file ends in a message and not in a hang.

References
----------
ASPRS (2019). LAS specification 1.4, R15. Isenburg, M. (2013). LASzip: lossless compression of
LiDAR data. Bell, A. et al. (2021). COPC: cloud optimized point cloud, 1.0.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import lazrs  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from toolbox.context import QUIET, Context
from toolbox.data.las_crs import WKT_BIT, read_crs
from toolbox.data.las_header import Frame, Header, Layout, Record, read_frame
from toolbox.data.las_points import attribute
from toolbox.errors import DataError

log = logging.getLogger("toolbox")

_BLOCK = 1_000_000  # points between two reports of progress
_LASZIP = struct.Struct("<HHBBHIIqqH")
_LAYERED = 3  # compressor: each attribute of a chunk in a layer of its own
_VARIABLE = 0xFFFF_FFFF  # chunk size that says: each chunk has its own
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}  # of an item in point formats 6-10; one per byte in others
_MIXED = "lazrs does not keep the wave packets of several scanner channels in LAZ"
_DENSEST = 1000  # points per compressed byte; identical points, the densest there are, reach 150
_NODE = struct.Struct("<4iQii")  # of the COPC hierarchy
_Field = tuple[int, str, tuple[Any, ...]]  # of the header: offset, form, values
_PAGE = -1  # number of points of a node that says: further down in another page


@dataclass(frozen=True)
class _Chunk:
    """Compressed points: where in the file, how many bytes, how many points."""

    start: int
    size: int
    points: int


def read_las(
    path: Path, *, bounds: Sequence[float] | None = None, ctx: Context = QUIET
) -> tuple[Frame, NDArray[Any]]:
    """Read a LAS, LAZ or COPC file.

    Parameters
    ----------
    path : of an existing file
    bounds : (xmin, ymin, xmax, ymax); of a COPC file only the nodes that touch it are read,
        of others everything
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
    try:
        with path.open("rb") as stream:
            frame = read_frame(stream, size, lambda text: log.warning("%s %s", path.name, text))
            record = _read_points(stream, frame, size, bounds, ctx)
    except MemoryError as error:
        raise DataError(f"{path} claims more points than fit in memory") from error
    except DataError as error:
        raise DataError(f"{path} {error}") from error
    _check_box(frame.header, record, path.name)
    if frame.laszip and _mixes_waveforms(frame, record):
        log.warning("%s: %s; read with care", path.name, _MIXED)
    wkt = bool(frame.header.encoding & WKT_BIT)
    crs = read_crs(frame.records, wkt=wkt, name=path.name)
    return replace(frame, crs=crs), record


def _read_points(
    stream: BinaryIO, frame: Frame, size: int, bounds: Sequence[float] | None, ctx: Context
) -> NDArray[Any]:
    header, dtype = frame.header, frame.layout.dtype
    if header.point_count == 0:
        return np.empty(0, dtype)
    if not header.compression:
        return _read_plain(stream, header, dtype, ctx)
    _check_laszip(frame.laszip, header.record_length)
    if bounds is not None and frame.copc:
        chunks = _copc_chunks(stream, frame, size, bounds)
    else:
        chunks = _all_chunks(stream, frame, size)
    return _read_chunks(stream, frame, chunks, ctx)


def _read_plain(
    stream: BinaryIO, header: Header, dtype: np.dtype[Any], ctx: Context
) -> NDArray[Any]:
    record = np.empty(header.point_count, dtype)
    stream.seek(header.offset_to_points)
    for start in range(0, len(record), _BLOCK):
        ctx.progress(start / len(record))
        block = record[start : start + _BLOCK]
        if stream.readinto(block.view("u1")) < block.nbytes:  # type: ignore[attr-defined]
            raise DataError(f"is cut off: its points from number {start} on are not all there")
    return record


def _check_laszip(laszip: bytes, record_length: int) -> None:
    """Whether lazrs knows this way of compression, and its items make up a point record."""
    if len(laszip) < _LASZIP.size:
        raise DataError(f"has a LASzip record of {len(laszip)} bytes, which is too short")
    compressor, coder, *_, items = _LASZIP.unpack_from(laszip)
    if compressor not in (2, _LAYERED) or coder != 0:
        raise DataError(
            f"is compressed in the way {compressor} (coder {coder}) of LASzip; only chunked "
            "files (2 and 3) can be read, as LASzip writes them since 2011"
        )
    if len(laszip) < _LASZIP.size + 6 * items:
        raise DataError(f"has a LASzip record that ends before its {items} items")
    lengths = [size for _, size, _ in _items(laszip)]
    if sum(lengths) != record_length:
        raise DataError(
            f"has point records of {record_length} bytes, but compressed ones of {sum(lengths)}"
        )


def _items(laszip: bytes) -> list[tuple[int, ...]]:
    """Type, size and version of the parts that a point record is compressed in."""
    count = _LASZIP.unpack_from(laszip)[-1]
    start = _LASZIP.size
    return list(struct.iter_unpack("<3H", laszip[start : start + 6 * count]))


def _all_chunks(stream: BinaryIO, frame: Frame, size: int) -> list[_Chunk]:
    """The chunks in the order of the file, from its chunk table."""
    header, start = frame.header, frame.header.offset_to_points
    first, table = start + 8, _chunk_table_place(stream, start, size)
    stream.seek(table)
    _, count = struct.unpack("<II", stream.read(8))
    if count * header.record_length > table - first:
        raise DataError(f"claims {count} chunks of points in {table - first} bytes")
    stream.seek(start)
    with _lazrs_errors("has a damaged chunk table"):
        pairs = lazrs.read_chunk_table(stream, lazrs.LazVlr(frame.laszip))
    sizes = np.array([size for _, size in pairs], np.uint64).astype(float)
    if len(pairs) != count or sizes.sum() > table - first:
        raise DataError("has a damaged chunk table: its chunks do not fit before it")
    points = _chunk_points(frame.laszip, [points for points, _ in pairs], header.point_count)
    starts = first + np.concatenate([[0], np.cumsum(sizes)])
    return [_Chunk(int(s), size, n) for s, (_, size), n in zip(starts, pairs, points, strict=False)]


def _chunk_table_place(stream: BinaryIO, start: int, size: int) -> int:
    """Where the chunk table is: stated before the points, or at the end of a streamed file."""
    place = -1
    for where in (start, size - 8):
        if place == -1 and start + 8 <= size:
            stream.seek(where)
            (place,) = struct.unpack("<q", stream.read(8))
    if not start + 8 <= place <= size - 8:
        raise DataError(
            f"is cut off or damaged: its table of chunks should be at byte {place} of {size}"
        )
    return int(place)


def _chunk_points(laszip: bytes, stated: list[int], total: int) -> list[int]:
    """Points per chunk; only chunks of variable size state it."""
    chunk_size = _LASZIP.unpack_from(laszip)[6]
    if chunk_size != _VARIABLE:
        stated = [chunk_size] * (len(stated) - 1)
        last = total - sum(stated)
        stated += [last] if 0 < last <= chunk_size else []
    if sum(stated) != total:
        raise DataError(
            f"is cut off or damaged: its header promises {total} points, and its chunks hold "
            f"{sum(stated)}"
        )
    return stated


def _copc_chunks(
    stream: BinaryIO, frame: Frame, size: int, bounds: Sequence[float]
) -> list[_Chunk]:
    """The chunks of the octree nodes that touch the bounds, in the order of the file."""
    if len(frame.copc) < 56:
        raise DataError(f"has a COPC record of {len(frame.copc)} bytes, which is too short")
    *centre, half, _ = struct.unpack_from("<5d", frame.copc)
    pages: list[tuple[int, int]] = [struct.unpack_from("<2Q", frame.copc, 40)]
    seen, chunks = set(), []
    while pages:
        start, length = pages.pop()
        if start in seen or not 0 <= length <= size - start or length % _NODE.size:
            raise DataError("has a damaged COPC hierarchy")
        seen.add(start)
        stream.seek(start)
        for level, x, y, _, *place, points in _NODE.iter_unpack(stream.read(length)):
            if not _touches(bounds, centre, half, (level, x, y)):
                continue
            if points == _PAGE:
                pages.append((place[0], place[1]))
            elif points > 0:
                chunks.append(_Chunk(place[0], place[1], points))
    inside = all(0 < chunk.size <= size - chunk.start for chunk in chunks)
    if not inside or sum(chunk.points for chunk in chunks) > frame.header.point_count:
        raise DataError("has a damaged COPC hierarchy")
    return sorted(chunks, key=lambda chunk: chunk.start)


def _touches(
    bounds: Sequence[float], centre: Sequence[float], half: float, node: tuple[int, int, int]
) -> bool:
    side = 2 * half / 2.0 ** min(max(node[0], 0), 63)
    west, south = (centre[axis] - half + node[1 + axis] * side for axis in (0, 1))
    return (
        west <= bounds[2]
        and west + side >= bounds[0]
        and south <= bounds[3]
        and south + side >= bounds[1]
    )


def _read_chunks(
    stream: BinaryIO, frame: Frame, chunks: list[_Chunk], ctx: Context
) -> NDArray[Any]:
    for chunk in chunks:
        if chunk.points > _DENSEST * chunk.size:
            raise DataError(f"is damaged: it claims {chunk.points} points in {chunk.size} bytes")
    record = np.empty(sum(chunk.points for chunk in chunks), frame.layout.dtype)
    done = 0
    for group in _groups(chunks):
        ctx.progress(done / len(record))
        data = b"".join(_bytes(stream, chunk, frame) for chunk in group)
        count = sum(chunk.points for chunk in group)
        out = record[done : done + count].view("u1")
        table = [(chunk.points, chunk.size) for chunk in group]
        with _lazrs_errors(f"is damaged: its points from number {done} on cannot be decompressed"):
            lazrs.decompress_points_with_chunk_table(data, frame.laszip, out, table)
        done += count
    return record


def _groups(chunks: list[_Chunk]) -> Iterator[list[_Chunk]]:
    """Chunks to decompress at once, in parallel: about a million points."""
    group: list[_Chunk] = []
    for chunk in chunks:
        group.append(chunk)
        if sum(member.points for member in group) >= _BLOCK:
            yield group
            group = []
    if group:
        yield group


def _bytes(stream: BinaryIO, chunk: _Chunk, frame: Frame) -> bytes:
    """A compressed chunk.

    In layers it begins with a plain point, the number of points, and the size of each layer,
    for which lazrs would set memory aside before it looks whether they are there.
    """
    stream.seek(chunk.start)
    data = stream.read(chunk.size)
    if _LASZIP.unpack_from(frame.laszip)[0] == _LAYERED:
        count = sum(_LAYERS.get(kind, size) for kind, size, _ in _items(frame.laszip))
        start = frame.header.record_length + 4
        sizes = np.frombuffer(data[start : start + 4 * count], "<u4").astype(np.int64)
        if len(sizes) < count or sizes.sum() > len(data) - start - 4 * count:
            raise DataError(f"is damaged: the chunk of points at byte {chunk.start} is incomplete")
    return data


@contextmanager
def _lazrs_errors(text: str) -> Iterator[None]:
    """Turn what lazrs raises into a DataError; a panic in Rust is not even an Exception."""
    try:
        yield
    except (lazrs.LazrsError, ArithmeticError, TypeError, ValueError, OSError) as error:
        raise DataError(f"{text} ({error})") from error
    except BaseException as error:
        if type(error).__name__ != "PanicException":
            raise
        raise DataError(f"{text} ({error})") from error


def _check_box(header: Header, record: NDArray[Any], name: str) -> None:
    """Log a bounding box that does not contain the points; it is computed anew on writing."""
    if len(record) == 0:
        return
    low, high = (_limits(header, record, np.min), _limits(header, record, np.max))
    near = np.abs(header.scales)
    least, most = np.minimum(low, high), np.maximum(low, high)
    if not (np.all(header.mins <= least + near) and np.all(header.maxs >= most - near)):
        log.warning(
            "%s: the bounding box in its header does not contain its points; the points are used",
            name,
        )


def _mixes_waveforms(frame: Frame, record: NDArray[Any]) -> bool:
    """Whether compression spoils the wave packets (as of lazrs 0.8)."""
    if frame.layout.point_format not in (9, 10) or len(record) == 0:
        return False
    channels = attribute(frame.layout, record, "scanner_channel")
    return bool((channels != channels[0]).any())


def _limits(header: Header, record: NDArray[Any], limit: Any) -> NDArray[np.float64]:
    corner = np.array([limit(record[axis]) for axis in "XYZ"], float)
    return np.asarray(corner * header.scales + header.offsets)


def write_las(
    path: Path, frame: Frame, record: NDArray[Any], *, compress: bool, ctx: Context = QUIET
) -> None:
    """Write records and frame as they are; counts, bounds and places are computed anew.

    Raises
    ------
    DataError
        The points are too many for the version of LAS, or LAZ would not keep their waveforms.
    """
    header = frame.header
    if header.minor < 4 and len(record) >= 2**32:
        raise DataError(f"{path}: LAS 1.{header.minor} holds fewer than 2^32 points")
    if compress and _mixes_waveforms(frame, record):
        raise DataError(f"{path}: {_MIXED}; write .las")
    vlrs, laszip = frame.vlrs, None
    if compress:
        extra = header.record_length - Layout(frame.layout.point_format).dtype.itemsize
        laszip = lazrs.LazVlr.new_for_compression(frame.layout.point_format, extra)
        vlrs += (Record.make("laszip encoded", 22204, "lidar-toolbox", laszip.record_data()),)
    with path.open("wb") as stream:
        stream.write(header.raw)
        for vlr in vlrs:
            stream.write(vlr.head + vlr.data)
        stream.write(frame.gap)
        start = stream.tell()
        summary = _write_points(stream, frame, record, laszip, ctx)
        places = [stream.tell()]
        for evlr in frame.evlrs:
            stream.write(evlr.head + evlr.data)
            places.append(stream.tell())
        fields: list[_Field] = [(96, "<II", (start, len(vlrs)))]
        fields += [(104, "<B", (frame.layout.point_format | 0x80 * compress,))]
        fields += _place_fields(frame, places)
        stream.seek(0)
        stream.write(header.patched(*fields, *summary.fields(header)).raw)


def _write_points(
    stream: BinaryIO, frame: Frame, record: NDArray[Any], laszip: Any, ctx: Context
) -> _Summary:
    """Write the records at the present place, compressed if laszip is not None."""
    sink = None if laszip is None else lazrs.ParLasZipCompressor(stream, laszip)
    write: Any = stream.write if sink is None else sink.compress_many
    summary = _Summary()
    for place in range(0, len(record), _BLOCK):
        ctx.progress(place / len(record))
        block = np.ascontiguousarray(record[place : place + _BLOCK])
        summary.add(frame, block)
        write(block.view("u1"))
    if sink is not None:
        sink.done()
        stream.seek(0, 2)
    return summary


def _place_fields(frame: Frame, places: list[int]) -> list[_Field]:
    """Where the records after the points begin."""
    fields: list[_Field] = []
    if frame.header.minor >= 3:
        wave = 0 if frame.waveform is None else places[frame.waveform]
        if wave or not frame.header.encoding & 4:  # 4: waveforms are in a file of their own
            fields.append((227, "<Q", (wave,)))
    if frame.header.minor >= 4:
        fields.append((235, "<QI", (places[0] if frame.evlrs else 0, len(frame.evlrs))))
    return fields


class _Summary:
    """Counts and bounds of the points written so far."""

    def __init__(self) -> None:
        self.returns = np.zeros(16, np.int64)
        self.low = np.full(3, np.iinfo(np.int32).max)
        self.high = np.full(3, np.iinfo(np.int32).min)
        self.count = 0

    def add(self, frame: Frame, block: NDArray[Any]) -> None:
        field, first, bits = frame.layout.bits["return_number"]
        numbers = (block[field] >> first) & ((1 << bits) - 1)
        self.returns += np.bincount(numbers, minlength=16)
        self.low = np.minimum(self.low, [block[axis].min() for axis in "XYZ"])
        self.high = np.maximum(self.high, [block[axis].max() for axis in "XYZ"])
        self.count += len(block)

    def fields(self, header: Header) -> list[_Field]:
        by_return = [int(count) for count in self.returns[1:]]
        legacy = (header.point_format < 6 or header.minor < 4) and self.count < 2**32
        counts = (self.count, *by_return[:5]) if legacy else (0,) * 6
        fields: list[_Field] = [(107, "<6I", counts), (179, "<6d", self._box(header))]
        if header.minor >= 4:
            fields.append((247, "<16Q", (self.count, *by_return)))
        return fields

    def _box(self, header: Header) -> tuple[float, ...]:
        """max and min of x, y, z; as in the source where they agree within half a step."""
        if self.count == 0:
            return (0.0,) * 6
        corners = np.array([self.high, self.low]) * header.scales + header.offsets
        corners = np.array([corners.max(axis=0), corners.min(axis=0)])
        stated = np.array([header.maxs, header.mins])
        near = np.abs(stated - corners) <= np.abs(header.scales) / 2
        return tuple(np.where(near, stated, corners).T.ravel())
