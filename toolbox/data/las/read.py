"""Points and metadata of LAS, LAZ and COPC files, read with laspy and lazrs.

Every file is checked before these libraries see it (see also `header`), so that a damaged one ends
in a message and not in a hang.

References
----------
ASPRS (2019). LAS specification 1.4, R15. Isenburg, M. (2013). LASzip: lossless compression of
LiDAR data.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO

import laspy
import lazrs
import numpy as np
from numpy.typing import NDArray

from toolbox.context import QUIET, Context, log
from toolbox.data.las.copc import copc_chunks
from toolbox.data.las.crs import read_crs
from toolbox.data.las.header import Chunk, LasMetadata, demand, parse_metadata
from toolbox.data.las.points import MIXED_WAVEFORMS, box_of, waveform_channels
from toolbox.data.las.waveforms import packets_beside
from toolbox.data.paths import COPC, is_copc
from toolbox.data.reading import Reading, announced, errors_named, opened
from toolbox.data.record import record_in
from toolbox.errors import DataError

_BLOCK = 1_000_000  # points between two reports of progress
_GROUP = 20  # chunks between two reports; most have 50 000 points
_LAYERED = 3  # compressor: each attribute of a chunk in a layer of its own
_LAYERS = {6: 9, 7: 10, 8: 11, 9: 10, 10: 12}  # of a point format; and one per extra byte
_DENSEST = 1000  # points per compressed byte; identical points, the densest there are, reach 150
Array = NDArray[Any]


def read_las(
    path: Path,
    *,
    bounds: Sequence[float] | None = None,
    point_range: tuple[int, int] | None = None,
    reading: Reading | None = None,
    ctx: Context = QUIET,
) -> tuple[LasMetadata, Array]:
    """Read metadata and points of a LAS, LAZ or COPC file.

    Parameters
    ----------
    path : of an existing file
    bounds : (xmin, ymin, xmax, ymax); of a COPC file only the nodes that touch it are read,
        of others everything
    point_range : (start, stop): only the points with these indices, stop excluded; of a
        compressed file the chunks that hold them are unpacked
    reading : where the hash of the file and its record are noted
    ctx : progress is reported every million points

    Returns
    -------
    metadata : all but the points
    packed : packed point records, of shape (n,)

    Raises
    ------
    DataError
        The file is damaged or of an unknown kind; says which rule it breaks.
    """
    size = path.stat().st_size
    with _named(path), opened(path, reading, ctx) as stream:
        metadata = parse_metadata(stream, size, lambda text: log.warning("%s %s", path.name, text))
        with errors_named("is damaged: its points cannot be read"):
            packed = _read_points(stream, metadata, size, bounds, point_range, ctx)
    if reading:
        reading.records[path] = record_in(metadata)
    _check_box(metadata.header, packed, path.name)
    if metadata.laszip and len(waveform_channels(metadata, packed)) > 1:
        log.warning("%s: %s; read with care", path.name, MIXED_WAVEFORMS)
    return _completed(metadata, path, lambda text: log.warning("%s %s", path.name, text)), packed


def read_metadata(path: Path, warn: Callable[[str], None]) -> LasMetadata:
    """Read and check the metadata of a LAS, LAZ or COPC file.

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
        metadata = parse_metadata(stream, path.stat().st_size, warn)
    return _completed(metadata, path, warn)


def chunk_sizes(path: Path) -> list[int] | None:
    """Number of points in each chunk of a LAZ file, in its order; None of a LAS file.

    Raises
    ------
    DataError
        The file is damaged; says which rule it breaks.
    """
    with _named(path), path.open("rb") as stream:
        size = path.stat().st_size
        metadata = parse_metadata(stream, size, lambda text: None)
        if metadata.header.point_count == 0 or not metadata.header.are_points_compressed:
            return None
        with errors_named("is damaged: its points cannot be read"):
            _check_laszip(metadata)
            return [points for *_, points in _all_chunks(stream, metadata, size)]


def _completed(metadata: LasMetadata, path: Path, warn: Callable[[str], None]) -> LasMetadata:
    """The metadata with the CRS, and with what stands beside the file."""
    if is_copc(path) and not metadata.copc:
        warn(f"is named {COPC}, but is none by its content; it is read as LAZ, from end to end")
    crs = read_crs(metadata.all_vlrs, wkt=metadata.header.global_encoding.wkt, name=path.name)
    return replace(metadata, crs=crs, packets=packets_beside(metadata, path))


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Put the path before the message of a DataError, and turn other errors into one."""
    try:
        yield
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from error
    except DataError as error:
        raise DataError(f"{path} {error}") from error


def _read_points(
    stream: BufferedReader,
    metadata: LasMetadata,
    size: int,
    bounds: Sequence[float] | None,
    point_range: tuple[int, int] | None,
    ctx: Context,
) -> Array:
    header = metadata.header
    start, stop = point_range or (0, header.point_count)
    demand(0 <= start <= stop <= header.point_count, f"has no points {start} to {stop}")
    if header.point_count == 0 or not header.are_points_compressed:
        return _read_plain(stream, header, start, stop, ctx)
    _check_laszip(metadata)
    if bounds is not None and metadata.copc:
        chunks = copc_chunks(stream, metadata, size, bounds)
    else:
        chunks = _all_chunks(stream, metadata, size)
    ahead = 0
    if point_range:
        chunks, ahead = _covering(chunks, start, stop)
    announced(stream, [(start, size) for start, size, _ in chunks], ctx)
    _check_chunks(stream, metadata, chunks)
    packed = _read_chunks(stream, metadata, chunks, ctx)
    return packed[ahead : ahead + stop - start] if point_range else packed


def _covering(chunks: list[Chunk], start: int, stop: int) -> tuple[list[Chunk], int]:
    """The chunks with the points from start to before stop; how many points precede start there."""
    ends = np.cumsum([points for *_, points in chunks])
    first = int(np.searchsorted(ends, start, side="right"))
    last = int(np.searchsorted(ends, stop, side="left"))
    kept = chunks[first : last + 1] if start < stop else []
    return kept, start - (int(ends[first - 1]) if first else 0)


def _read_plain(
    stream: BufferedReader, header: laspy.LasHeader, start: int, stop: int, ctx: Context
) -> Array:
    packed = np.empty(stop - start, header.point_format.dtype())
    stream.seek(header.offset_to_point_data + start * packed.itemsize)
    for done in range(0, len(packed), _BLOCK):
        ctx.progress(done / len(packed))
        block = packed[done : done + _BLOCK]
        whole = stream.readinto(block.view("u1").data) == block.nbytes
        demand(whole, "is cut off: its points end early")
    return packed


def _read_chunks(
    stream: BinaryIO, metadata: LasMetadata, chunks: list[Chunk], ctx: Context
) -> Array:
    """Read and decompress the points of some chunks.

    Not with the reader of laspy: it sets memory aside for as many points as the LASzip record
    claims for a chunk, and ends the process if there is not so much.
    """
    packed = np.empty(sum(points for *_, points in chunks), metadata.header.point_format.dtype())
    done = 0
    for number in range(0, len(chunks), _GROUP):
        ctx.progress(number / len(chunks))
        group = chunks[number : number + _GROUP]
        data = b"".join(_bytes(stream, start, size) for start, size, _ in group)
        table = [(points, size) for _, size, points in group]
        block = packed[done : done + sum(points for points, _ in table)]
        lazrs.decompress_points_with_chunk_table(data, metadata.laszip, block.view("u1"), table)
        done += len(block)
    return packed


def _bytes(stream: BinaryIO, start: int, size: int) -> bytes:
    stream.seek(start)
    return stream.read(size)


def _check_laszip(metadata: LasMetadata) -> None:
    """Raise a DataError unless lazrs knows the compression and it fits the point records."""
    with errors_named("has a damaged LASzip record"):
        length = lazrs.LazVlr(metadata.laszip).item_size()
    compressor, coder = struct.unpack_from("<HH", metadata.laszip)
    demand(
        compressor in (2, _LAYERED) and coder == 0,
        f"is compressed in the way {compressor} (coder {coder}) of LASzip; only chunked files "
        "(2 and 3) can be read, as LASzip writes them since 2011",
    )
    stated = metadata.header.point_format.size
    same = length == stated
    demand(same, f"has point records of {stated} bytes, but compressed ones of {length}")


def _all_chunks(stream: BinaryIO, metadata: LasMetadata, size: int) -> list[Chunk]:
    """All chunks in the order of the file, from its chunk table.

    lazrs sets memory aside for as many chunks as the table claims, so they are looked at first.
    """
    header, laszip = metadata.header, lazrs.LazVlr(metadata.laszip)
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


def _check_chunks(stream: BinaryIO, metadata: LasMetadata, chunks: list[Chunk]) -> None:
    """Raise a DataError unless the chunks can hold their points.

    In layers a chunk begins with a plain point, the number of points, and the size of each layer,
    for which lazrs would set memory aside before it looks whether they are there.
    """
    layout = metadata.header.point_format
    layers = _LAYERS.get(layout.id, 0) + layout.num_extra_bytes
    ahead = layout.size + 4
    for start, size, points in chunks:
        dense = points > _DENSEST * size
        demand(not dense, f"is damaged: it claims {points} points in {size} bytes")
        if metadata.laszip[0] == _LAYERED:
            data = _bytes(stream, start + ahead, 4 * layers)
            needed = ahead + len(data) + sum(memoryview(data[: len(data) // 4 * 4]).cast("I"))
            demand(
                len(data) == 4 * layers and needed <= size,
                f"is damaged: the chunk of points at byte {start} is incomplete",
            )


def _check_box(header: laspy.LasHeader, packed: Array, name: str) -> None:
    """Log a bounding box that does not contain the points; it is computed anew on writing."""
    if len(packed) == 0:
        return
    corners = box_of(header, packed)
    near = np.abs(header.scales)
    if not (np.all(header.mins <= corners[0] + near) and np.all(header.maxs >= corners[1] - near)):
        log.warning(
            "%s: the bounding box in its header does not contain its points; the points are used",
            name,
        )
