"""The header of a LAS file and its variable length records (VLR, EVLR).

What a file claims is checked here before laspy and lazrs see it: they would wait for billions of
records, set memory aside for points that are not there, or read fewer points without a word.

References
----------
ASPRS (2019). LAS specification 1.4, R15.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from laspy import ExtraBytesParams, LasHeader, PointFormat
from laspy.errors import LaspyException
from laspy.header import Version
from laspy.point.dims import DimensionInfo, is_point_fmt_compatible_with_version
from laspy.vlrs.known import ExtraBytesVlr
from pyproj import CRS

from toolbox.errors import DataError

SIZES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375}  # of the header, by minor version
EXTRA_BYTES = ("LASF_Spec", 4)
DESCRIPTOR = 192  # bytes that describe one dimension of extra bytes
_FAR = 1e290  # beyond that, coordinates are no numbers any more
SPARE = "_spare"  # bytes of a point that nothing describes
_LASZIP, _COPC = ("laszip encoded", 22204), ("copc", 1)
_COMPRESSION = (_LASZIP, _COPC, ("copc", 1000))

Chunk = list[int]
"""Compressed points: where in the file, how many bytes, how many points."""


@dataclass(frozen=True, eq=False)
class Vlr:
    """The bytes of a variable length record (VLR), or an extended one (head of 60 bytes)."""

    head: bytes
    data: bytes

    @classmethod
    def make(cls, user: str, number: int, description: str, data: bytes) -> Vlr:
        head = struct.pack("<2x16sHH32s", user.encode(), number, len(data), description.encode())
        return cls(head, data)

    @property
    def key(self) -> tuple[str, int]:
        """User id and record id."""
        user, number = struct.unpack_from("<16sH", self.head, 2)
        return user.split(b"\0")[0].decode("latin-1"), number


@dataclass(frozen=True, eq=False)
class LasMetadata:
    """Header, VLRs and EVLRs of a LAS file: all but its points. Copy the header to change it.

    Parameters
    ----------
    header : of laspy, in the oldest version it can write; its own lists of VLRs are not used
    minor : version 1.x that the file states
    texts : bytes 26-93 of the file: system, software and date, where laspy is not exact
    vlrs : without those that describe the compression (LASzip, COPC)
    evlrs : VLRs after the points; in LAS 1.3 the waveform packets alone
    waveform : the one that holds the waveform packets, or None
    packets : the file .wdp that holds them instead; None if they are in none, or it is not there
    laszip : content of the LASzip VLR; b"" if the points are not compressed
    copc : content of the COPC info VLR; b"" unless it is the first of all, as in COPC files
    crs : that the VLRs state, or None
    """

    header: LasHeader
    minor: int
    texts: bytes
    vlrs: tuple[Vlr, ...] = ()
    evlrs: tuple[Vlr, ...] = ()
    waveform: Vlr | None = None
    packets: Path | None = None
    laszip: bytes = b""
    copc: bytes = b""
    crs: CRS | None = None

    @property
    def all_vlrs(self) -> tuple[Vlr, ...]:
        return self.vlrs + self.evlrs

    @property
    def extras(self) -> tuple[DimensionInfo, ...]:
        """The extra bytes that the file describes, in its order."""
        found = self.header.point_format.extra_dimensions
        return tuple(dimension for dimension in found if dimension.name != SPARE)

    @property
    def spare(self) -> int:
        """Bytes per point that nothing describes."""
        described = sum(dimension.num_bytes for dimension in self.extras)
        return int(self.header.point_format.num_extra_bytes - described)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the attributes of the points."""
        extras = tuple(dimension.name for dimension in self.extras)
        return standard_names(self.header.point_format.id) + extras

    def without(self, dropped: Callable[[Vlr], bool]) -> LasMetadata:
        """The metadata without the VLRs and EVLRs for which dropped(vlr) holds."""
        vlrs, evlrs = (
            tuple(vlr for vlr in vlrs if not dropped(vlr)) for vlrs in (self.vlrs, self.evlrs)
        )
        return replace(self, vlrs=vlrs, evlrs=evlrs)


@lru_cache
def standard_names(number: int) -> tuple[str, ...]:
    """Names of the attributes of a LAS point format, in the order of the specification."""
    return tuple(fields(number))


def fields(number: int) -> dict[str, np.dtype[Any]]:
    """Type of each attribute of a LAS point format, by name."""
    dimensions = PointFormat(number).dimensions[3:]  # without X, Y, Z
    return {found.name: found.dtype or np.dtype("u1") for found in dimensions}


def point_format(number: int, extras: list[ExtraBytesParams], spare: int) -> PointFormat:
    """A laspy point format with described extra bytes and `spare` bytes that nothing describes."""
    found = PointFormat(number)
    params = [*extras, ExtraBytesParams(SPARE, f"{spare}u1")] if spare else extras
    for param in params:
        found.add_extra_dimension(param)
    return found


def oldest_version(minor: int, number: int) -> Version:
    """The oldest LAS version, not below 1.`minor`, in which laspy writes a point format."""
    versions = [Version(1, later) for later in range(max(minor, 1), 5)]
    return next(v for v in versions if is_point_fmt_compatible_with_version(number, str(v)))


def demand(holds: bool, text: str) -> None:
    """Raise a DataError with the text unless a condition holds."""
    if not holds:
        raise DataError(text)


def parse_metadata(stream: BinaryIO, size: int, warn: Callable[[str], None]) -> LasMetadata:
    """Read and check the metadata of a LAS file from a stream.

    Parameters
    ----------
    stream : of the file, at its start
    size : of the file, bytes
    warn : is told what is odd but does no harm, without the name of the file

    Raises
    ------
    DataError
        What is wrong, without the name of the file.
    """
    raw = _raw_header(stream, size)
    header = _parsed(raw, warn)
    start = header.offset_to_point_data
    _check_positions(header, len(raw), size, warn)
    (count,) = struct.unpack_from("<I", raw, 100)
    vlrs, starts = _read_vlrs(stream, len(raw), start, count, 54)
    if len(vlrs) < count:
        warn(
            f"promises {count} variable length records, but only {len(vlrs)} fit before the "
            "points; the others are ignored"
        )
    stream.seek(starts[-1])
    header.extra_vlr_bytes = stream.read(start - starts[-1])
    evlrs, waveform = _read_evlrs(stream, header, size)
    header.version = oldest_version(raw[25], header.point_format.id)
    header.point_format = _described(header, vlrs, warn)
    metadata = LasMetadata(header, raw[25], raw[26:94], vlrs, evlrs, waveform)
    metadata = metadata.without(lambda vlr: vlr.key in _COMPRESSION)
    if not header.are_points_compressed:
        return metadata
    found = {vlr.key: vlr.data for vlr in vlrs}
    demand(_LASZIP in found, "is compressed, but has no LASzip record that says how")
    copc = vlrs[0].data if vlrs[0].key == _COPC else b""  # where the format wants it to be
    return replace(metadata, laszip=found[_LASZIP], copc=copc)


def _raw_header(stream: BinaryIO, size: int) -> bytes:
    demand(size > 0, "is empty (0 bytes)")
    raw = stream.read(0xFFFF)
    demand(raw[:4] == b"LASF", f"is not a LAS file: it begins with {raw[:4]!r}, not b'LASF'")
    least = SIZES[0]
    demand(len(raw) >= least, f"ends within the header, after {len(raw)} of {least} bytes")
    (major, minor), (length,) = raw[24:26], struct.unpack_from("<H", raw, 94)
    demand(
        major == 1 and minor in SIZES,
        f"is LAS version {major}.{minor}; versions 1.0 to 1.4 can be read",
    )
    demand(
        SIZES[minor] <= length <= size,
        f"claims a header of {length} bytes; version 1.{minor} has at least {SIZES[minor]}, "
        f"and the file {size}",
    )
    return raw[:length]


def _parsed(raw: bytes, warn: Callable[[str], None]) -> LasHeader:
    """The header as laspy reads it, without the VLRs, which it would not read unchanged."""
    start, _, packed, record_length, legacy = struct.unpack_from("<IIBHI", raw, 96)
    number = packed & 0x3F
    demand(packed >> 6 in (0, 2) and number <= 10, f"has the unknown point format {packed}")
    least = PointFormat(number).size
    demand(
        record_length >= least,
        f"has point records of {record_length} bytes; point format {number} needs {least}",
    )
    alone = bytearray(raw)
    struct.pack_into("<HHHII", alone, 90, 0, 0, len(raw), len(raw), 0)  # no date, no VLRs
    header = LasHeader.read_from(io.BytesIO(alone))
    header.offset_to_point_data = start
    header.point_count = header.point_count or legacy
    for axis, scale, offset in zip("xyz", header.scales, header.offsets, strict=True):
        demand(0 < abs(scale) < _FAR, f"has the impossible scale {scale} for {axis}")
        demand(abs(offset) < _FAR, f"has the impossible offset {offset} for {axis}")
    if legacy not in (0, header.point_count):
        warn(
            f"counts {header.point_count} points, and {legacy} in the field for older readers, "
            "which is ignored"
        )
    return header


def _check_positions(
    header: LasHeader, length: int, size: int, warn: Callable[[str], None]
) -> None:
    """Raise a DataError unless points and VLRs lie within the file."""
    start, end, count = header.offset_to_point_data, size, header.point_count
    demand(
        length <= start <= size,
        f"claims that its points begin at byte {start}; the header ends at {length} and the file "
        f"at {size}",
    )
    if header.number_of_evlrs:
        end = header.start_of_first_evlr
        inside = start <= end <= size
        demand(inside, f"claims records after the points at byte {end}; it has {size} bytes")
    if header.are_points_compressed:
        return
    more = (end - start) // header.point_format.size - count
    demand(
        more >= 0, f"is cut off: its header promises {count} points, and {count + more} are there"
    )
    if more and not header.start_of_waveform_data_packet_record:
        warn(f"has room for {more} points more than its header promises; they are not read")


def _read_vlrs(
    stream: BinaryIO, start: int, end: int, count: int, head: int
) -> tuple[tuple[Vlr, ...], list[int]]:
    """Read up to `count` VLRs before `end`; gives them, where each begins and the last one ends."""
    vlrs: list[Vlr] = []
    starts = [start]
    while len(vlrs) < count and start + head <= end:
        stream.seek(start)
        top = stream.read(head)
        (length,) = struct.unpack_from("<H" if head == 54 else "<Q", top, 20)
        start += head + length
        if start > end:
            break
        vlrs.append(Vlr(top, stream.read(length)))
        starts.append(start)
    return tuple(vlrs), starts


def _read_evlrs(
    stream: BinaryIO, header: LasHeader, size: int
) -> tuple[tuple[Vlr, ...], Vlr | None]:
    """Read the EVLRs; gives them, and the one that holds the waveform packets."""
    start, count = header.start_of_first_evlr, header.number_of_evlrs
    wave = header.start_of_waveform_data_packet_record
    if header.version.minor == 3 and header.global_encoding.waveform_data_packets_internal:
        start, count = wave, 1
    vlrs, starts = _read_vlrs(stream, start, size, count, 60)
    found = len(vlrs)
    demand(
        found == count,
        f"is cut off: record {found + 1} of {count} after the points ends beyond the file",
    )
    return vlrs, dict(zip(starts, vlrs, strict=False)).get(wave)


def _described(
    header: LasHeader, vlrs: tuple[Vlr, ...], warn: Callable[[str], None]
) -> PointFormat:
    """The point format with its extra bytes; wrongly described ones are kept without a name."""
    number, size = header.point_format.id, header.point_format.size
    data = b"".join(vlr.data for vlr in vlrs if vlr.key == EXTRA_BYTES)
    plain = PointFormat(number)
    try:
        made = ExtraBytesVlr()
        made.parse_record_data(data)
        extras = made.type_of_extra_dims()
        names = [*plain.dimension_names, *(plain.dtype().names or ()), "x", "y", "z", SPARE, ""]
        for extra in extras:
            if extra.name in names:
                raise ValueError(f"the name {extra.name!r} is empty or taken")
            names.append(extra.name)
        described = point_format(number, extras, 0).dtype().itemsize
        if described > size:
            raise ValueError(
                f"{described - plain.size} bytes per point are described, and "
                f"{size - plain.size} are there"
            )
    except (ValueError, ArithmeticError, LaspyException) as error:
        warn(f"describes its extra bytes wrongly, so that they are not shown: {error}")
        return point_format(number, [], size - plain.size)
    return point_format(number, extras, size - described)
