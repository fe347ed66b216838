"""LAS and LAZ files, written with laspy; VLRs and texts are put back as they were read.

References
----------
ASPRS (2019). LAS specification 1.4, R15.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, BinaryIO

import laspy
import numpy as np
from numpy.typing import NDArray

from toolbox.context import QUIET, Context
from toolbox.data.las.header import SIZES, LasMetadata, parse_metadata
from toolbox.data.las.points import MIXED_WAVEFORMS, waveform_channels
from toolbox.data.reading import errors_named
from toolbox.errors import DataError

_BLOCK = 1_000_000  # points between two reports of progress
_BOXES = 6 * 8  # bytes of the bounds that a header states, which a file without points has not

Array = NDArray[Any]


def write_las(
    path: Path, metadata: LasMetadata, packed: Array, *, compress: bool, ctx: Context = QUIET
) -> None:
    """Write a LAS or LAZ file; counts, bounds and byte positions are computed anew.

    Raises
    ------
    DataError
        The points are too many for the version of LAS, or LAZ would not keep their waveforms.
    """
    with las_sink(path, metadata, compress=compress) as write:
        for done in range(0, len(packed), _BLOCK):
            ctx.progress(done / len(packed))
            write(packed[done : done + _BLOCK])


@contextmanager
def las_sink(
    path: Path, metadata: LasMetadata, *, compress: bool
) -> Iterator[Callable[[Array], None]]:
    """Open a LAS or LAZ file to write; gives the function that appends point records (n,).

    The file does not depend on how the point records are divided.

    Raises
    ------
    DataError
        As for :func:`write_las`.
    """
    with (
        path.open("wb") as stream,
        _sink(stream, metadata, str(path), compress=compress) as write,
    ):
        yield write


@contextmanager
def _sink(
    stream: BinaryIO, metadata: LasMetadata, path: str, *, compress: bool
) -> Iterator[Callable[[Array], None]]:
    """As `las_sink`, for a stream at its start; `path` is for messages."""
    header = metadata.header.copy()
    header.vlrs.clear()
    header.vlrs.extend(laspy.VLR("", 0, "", vlr.data) for vlr in metadata.vlrs)  # see _restore
    channels: set[int] = set()
    named = partial(errors_named, f"{path} cannot be written")  # not of who gives the points
    with named():
        writer = laspy.LasWriter(stream, header, compress, closefd=False, encoding_errors="ignore")

    def write(packed: Array) -> None:
        if header.version.minor < 4 and writer.header.point_count + len(packed) >= 2**32:
            raise DataError(f"{path}: LAS {header.version} holds fewer than 2^32 points")
        channels.update(waveform_channels(metadata, packed))
        if compress and len(channels) > 1:
            raise DataError(f"{path}: {MIXED_WAVEFORMS}; write .las")
        block = np.ascontiguousarray(packed)
        with named():
            writer.write_points(laspy.PackedPointRecord(block, header.point_format))

    yield write
    with named():
        writer.point_writer.done()
        writer.done = True
        _write_evlrs(stream, metadata, writer.header)
        _tidy_box(metadata.header, writer.header)
        writer.close()
        _restore(stream, metadata, writer.header)


def empty_file(metadata: LasMetadata) -> bytes:
    """The bytes of a LAS file of this metadata without points."""
    stream = io.BytesIO()
    with _sink(stream, metadata, "the header", compress=False):
        pass
    return stream.getvalue()


def metadata_bytes(metadata: LasMetadata) -> bytes:
    """The metadata as a LAS file without points, which :func:`metadata_of` reads."""
    boxes = struct.pack("<6d", *metadata.header.mins, *metadata.header.maxs)
    return boxes + empty_file(metadata)


@lru_cache(maxsize=64)  # the pieces of a survey share a few headers
def metadata_of(content: bytes) -> LasMetadata:
    """The metadata that :func:`metadata_bytes` has written, but for the CRS."""
    boxes, content = np.frombuffer(content[:_BOXES]), content[_BOXES:]
    metadata = parse_metadata(io.BytesIO(content), len(content), lambda text: None)
    metadata.header.mins, metadata.header.maxs = boxes[:3].copy(), boxes[3:].copy()
    return metadata


def _write_evlrs(stream: BinaryIO, metadata: LasMetadata, header: laspy.LasHeader) -> None:
    """Write the EVLRs, which laspy does not do in LAS 1.3, and their positions into the header."""
    start = stream.seek(0, 2)
    if not header.global_encoding.waveform_data_packets_external:
        header.start_of_waveform_data_packet_record = 0
    for evlr in metadata.evlrs:
        if evlr is metadata.waveform:
            header.start_of_waveform_data_packet_record = stream.tell()
        stream.write(evlr.head + evlr.data)
    header.start_of_first_evlr = start if metadata.evlrs else 0
    header.number_of_evlrs = len(metadata.evlrs)


def _tidy_box(stated: laspy.LasHeader, header: laspy.LasHeader) -> None:
    """Set the bounding box, as in the source where the points agree within half a step."""
    if header.point_count:
        low, high = np.sort([header.mins, header.maxs], axis=0)
        half = np.abs(header.scales) / 2
        header.mins = np.where(np.abs(stated.mins - low) <= half, stated.mins, low)
        header.maxs = np.where(np.abs(stated.maxs - high) <= half, stated.maxs, high)


def _restore(stream: BinaryIO, metadata: LasMetadata, header: laspy.LasHeader) -> None:
    """Write what laspy cannot: LAS 1.0, no date, counts for older readers, texts to the byte."""
    minor = metadata.minor if header.version.minor <= 2 else header.version.minor
    stream.seek(25)
    stream.write(bytes([minor]) + metadata.texts)
    if header.point_format.id < 6 and header.point_count < 2**32:
        counts = header.number_of_points_by_return[:5]
        stream.seek(107)
        stream.write(struct.pack("<6I", header.point_count, *map(int, counts)))
    stream.seek(SIZES[header.version.minor] + len(header.extra_header_bytes))
    stream.write(b"".join(vlr.head + vlr.data for vlr in metadata.vlrs))
