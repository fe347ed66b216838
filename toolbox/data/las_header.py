"""The header of a LAS file and the records around its points, checked before they are trusted.

Everything is kept as the bytes of the file, so that what nobody changes is written back as it was.

References
----------
ASPRS (2019). LAS specification 1.4, R15.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.errors import DataError

SIZES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375}  # of the header, by minor version

_CORE = [("X", "<i4"), ("Y", "<i4"), ("Z", "<i4"), ("intensity", "<u2"), ("_returns", "u1")]
_ID = [("user_data", "u1"), ("point_source_id", "<u2")]
_TIME = [("gps_time", "<f8")]
_OLD = [*_CORE, ("_class", "u1"), ("scan_angle_rank", "i1"), *_ID]
_NEW = [*_CORE, ("_flags", "u1"), ("classification", "u1"), ("user_data", "u1")]
_NEW += [("scan_angle", "<i2"), ("point_source_id", "<u2"), *_TIME]
_RGB = [("red", "<u2"), ("green", "<u2"), ("blue", "<u2")]
_NIR = [("nir", "<u2")]
_WAVE = [("wavepacket_index", "u1"), ("wavepacket_offset", "<u8"), ("wavepacket_size", "<u4")]
_WAVE += [("return_point_wave_location", "<f4"), ("x_t", "<f4"), ("y_t", "<f4"), ("z_t", "<f4")]
_FORMATS = (
    _OLD,
    _OLD + _TIME,
    _OLD + _RGB,
    _OLD + _TIME + _RGB,
    _OLD + _TIME + _WAVE,
    _OLD + _TIME + _RGB + _WAVE,
    _NEW,
    _NEW + _RGB,
    _NEW + _RGB + _NIR,
    _NEW + _WAVE,
    _NEW + _RGB + _NIR + _WAVE,
)
_OLD_BITS = {
    "return_number": ("_returns", 0, 3),
    "number_of_returns": ("_returns", 3, 3),
    "scan_direction_flag": ("_returns", 6, 1),
    "edge_of_flight_line": ("_returns", 7, 1),
    "classification": ("_class", 0, 5),
    "synthetic": ("_class", 5, 1),
    "key_point": ("_class", 6, 1),
    "withheld": ("_class", 7, 1),
}
_NEW_BITS = {
    "return_number": ("_returns", 0, 4),
    "number_of_returns": ("_returns", 4, 4),
    "synthetic": ("_flags", 0, 1),
    "key_point": ("_flags", 1, 1),
    "withheld": ("_flags", 2, 1),
    "overlap": ("_flags", 3, 1),
    "scanner_channel": ("_flags", 4, 2),
    "scan_direction_flag": ("_flags", 6, 1),
    "edge_of_flight_line": ("_flags", 7, 1),
}
_EXTRA = struct.Struct("<2xBB32s4x72s3d3d32s")  # one descriptor of the Extra Bytes record
_EXTRA_TYPES = ("u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f4", "<f8")
_HAS_SCALE, _HAS_OFFSET = 8, 16


@dataclass(frozen=True, eq=False)
class Record:
    """A variable length record (VLR), or an extended one (EVLR, whose head has 60 bytes)."""

    head: bytes
    data: bytes

    @classmethod
    def make(cls, user: str, number: int, description: str, data: bytes) -> Record:
        head = struct.pack("<2x16sHH32s", user.encode(), number, len(data), description.encode())
        return cls(head, data)

    @property
    def key(self) -> tuple[str, int]:
        """User id and record id."""
        user, number = struct.unpack_from("<16sH", self.head, 2)
        return user.split(b"\0")[0].decode("latin-1"), number

    def with_data(self, data: bytes) -> Record:
        form = "<H" if len(self.head) == 54 else "<Q"
        size = struct.pack(form, len(data))
        return Record(self.head[:20] + size + self.head[20 + len(size) :], data)

    def __len__(self) -> int:
        return len(self.head) + len(self.data)


@dataclass(frozen=True, eq=False)
class Extra:
    """An extra-byte dimension; scale and offset have one value per element, or are None."""

    name: str
    dtype: np.dtype[Any]
    descriptor: bytes
    scale: NDArray[np.float64] | None = None
    offset: NDArray[np.float64] | None = None

    @classmethod
    def make(cls, name: str, dtype: np.dtype[Any], description: str) -> Extra:
        """A new dimension.

        Raises
        ------
        DataError
            LAS has no such type, or the name is too long.
        """
        kind = (np.dtype("u1") if dtype.kind == "b" else dtype).newbyteorder("<")
        if kind.base not in _DTYPES or kind.shape not in ((), (2,), (3,)):
            raise DataError(f"attribute {name!r} is of type {dtype}, which LAS cannot hold")
        if not 0 < len(name.encode()) <= 32:
            raise DataError(f"LAS holds attribute names of 1 to 32 bytes, not {name!r}")
        elements = kind.shape[0] if kind.shape else 1
        number = _DTYPES.index(kind.base) + 1 + 10 * (elements - 1)
        text = description.encode()[:32].decode(errors="ignore").encode()
        nothing = (b"", *[0.0] * 6)
        return cls(name, kind, _EXTRA.pack(number, 0, name.encode(), *nothing, text))

    @classmethod
    def read(cls, descriptor: bytes) -> Extra:
        number, options, name, _, *numbers, _text = _EXTRA.unpack(descriptor)
        text = name.split(b"\0")[0].decode("utf-8", "backslashreplace")
        if number == 0 and options:  # so many bytes, of which nothing is said
            return cls(text, np.dtype(("u1", (options,)) if options > 1 else "u1"), descriptor)
        if not 0 < number <= 30:
            raise ValueError(f"data type {number} of {text!r} does not exist")
        elements = (number - 1) // 10 + 1
        base = _EXTRA_TYPES[(number - 1) % 10]
        dtype = np.dtype((base, (elements,)) if elements > 1 else base)
        if not options & (_HAS_SCALE | _HAS_OFFSET):
            return cls(text, dtype, descriptor)
        scale = np.array(numbers[:elements] if options & _HAS_SCALE else [1.0] * elements)
        offset = np.array(numbers[3 : 3 + elements] if options & _HAS_OFFSET else [0.0] * elements)
        return cls(text, dtype, descriptor, scale, offset)

    @property
    def description(self) -> str:
        text: bytes = _EXTRA.unpack(self.descriptor)[-1]
        return text.split(b"\0")[0].decode("utf-8", "backslashreplace")


_DTYPES = [np.dtype(name) for name in _EXTRA_TYPES]


@dataclass(frozen=True, eq=False)
class Layout:
    """What one point record holds.

    Parameters
    ----------
    point_format : 0-10
    extras : described extra bytes, in the order of the file
    spare : further bytes per point that nothing describes
    """

    point_format: int
    extras: tuple[Extra, ...] = ()
    spare: int = 0

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        fields: list[Any] = [*_FORMATS[self.point_format]]
        fields += [(extra.name, extra.dtype) for extra in self.extras]
        return np.dtype(fields + ([("_spare", f"V{self.spare}")] if self.spare else []))

    @cached_property
    def bits(self) -> dict[str, tuple[str, int, int]]:
        """Attributes within a byte: field, first bit, number of bits."""
        return _OLD_BITS if self.point_format < 6 else _NEW_BITS

    @cached_property
    def standard(self) -> tuple[str, ...]:
        """Attributes of the point format itself."""
        return standard_names(self.point_format)

    @property
    def names(self) -> tuple[str, ...]:
        return self.standard + tuple(extra.name for extra in self.extras)

    def extra(self, name: str) -> Extra | None:
        return next((extra for extra in self.extras if extra.name == name), None)

    @property
    def description(self) -> bytes:
        """Content of the Extra Bytes record."""
        return b"".join(extra.descriptor for extra in self.extras)


def standard_names(point_format: int) -> tuple[str, ...]:
    """Attributes of a point format, in the order of the specification."""
    bits = _OLD_BITS if point_format < 6 else _NEW_BITS
    names: list[str] = []
    for field, _ in _FORMATS[point_format]:
        inside = [name for name, (byte, *_) in bits.items() if byte == field]
        names += inside or [field]
    return tuple(name for name in names if name not in ("X", "Y", "Z"))


def fields(point_format: int) -> dict[str, np.dtype[Any]]:
    """Type of each attribute of a point format."""
    kinds = dict(_FORMATS[point_format])
    return {name: np.dtype(kinds.get(name, "u1")) for name in standard_names(point_format)}


class Header:
    """The header block, with the fields that matter here decoded."""

    def __init__(self, raw: bytes) -> None:
        self.raw = raw
        self.encoding: int = self._get("<H", 6)[0]
        self.minor: int = self._get("<B", 25)[0]
        self.offset_to_points, self.vlr_count, packed, self.record_length, legacy = self._get(
            "<IIBHI", 96
        )
        self.point_format, self.compression = packed & 0x3F, packed >> 6
        self.scales, self.offsets = np.array(self._get("<6d", 131)).reshape(2, 3)
        self.maxs, self.mins = np.array(self._get("<6d", 179)).reshape(3, 2).T
        self.waveform_start: int = self._get("<Q", 227)[0] if self.minor >= 3 else 0
        self.evlr_start, self.evlr_count, count = (
            self._get("<QIQ", 235) if self.minor >= 4 else (0, 0, 0)
        )
        self.legacy_count: int = legacy
        self.point_count: int = count or legacy

    def _get(self, form: str, offset: int) -> tuple[Any, ...]:
        return struct.unpack_from(form, self.raw, offset)

    def patched(self, *fields: tuple[int, str, tuple[Any, ...]]) -> Header:
        """A copy with (offset, form, values) packed into it."""
        raw = bytearray(self.raw)
        for offset, form, values in fields:
            struct.pack_into(form, raw, offset, *values)
        return Header(bytes(raw))

    def with_minor(self, minor: int) -> Header:
        """The same facts in a newer version of the header; an older one is left as it is."""
        if minor <= self.minor:
            return self
        size, old = SIZES[minor], SIZES[self.minor]
        raw = self.raw[:old] + bytes(size - old) + self.raw[old:]
        header = Header(raw[:25] + bytes([minor]) + raw[26:])
        return header.patched((94, "<H", (len(raw),)))


@dataclass(frozen=True, eq=False)
class Frame:
    """All that a LAS file holds beside its points.

    Parameters
    ----------
    header : as in the file
    layout : of the point records
    vlrs : without those that describe the compression (LASzip, COPC)
    gap : bytes between the VLRs and the points
    evlrs : records after the points; in LAS 1.3 the waveform packets alone
    waveform : which of them holds the waveform packets, or None
    laszip : content of the LASzip VLR; b"" if the points are not compressed
    copc : content of the COPC info VLR; b"" if there is none
    crs : that the records state, or None
    """

    header: Header
    layout: Layout
    vlrs: tuple[Record, ...] = ()
    gap: bytes = b""
    evlrs: tuple[Record, ...] = ()
    waveform: int | None = None
    laszip: bytes = b""
    copc: bytes = b""
    crs: CRS | None = None

    @property
    def records(self) -> tuple[Record, ...]:
        return self.vlrs + self.evlrs

    def without(self, dropped: Any) -> Frame:
        """The frame without the records for which dropped(record) holds."""
        kept = tuple(record for record in self.evlrs if not dropped(record))
        wave = None if self.waveform is None else self.evlrs[self.waveform]
        vlrs = tuple(record for record in self.vlrs if not dropped(record))
        place = kept.index(wave) if wave in kept else None
        return replace(self, vlrs=vlrs, evlrs=kept, waveform=place)


def read_frame(stream: BinaryIO, size: int, warn: Callable[[str], None]) -> Frame:
    """Read and check everything but the points.

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
    header = _read_header(stream, size)
    _check_numbers(header, warn)
    _check_places(header, size, warn)
    vlrs, gap = _read_vlrs(stream, header, warn)
    layout = _layout(header, vlrs, warn)
    evlrs, starts = _read_evlrs(stream, header, size)
    frame = Frame(header, layout, vlrs, gap, evlrs)
    if header.waveform_start in starts:
        frame = replace(frame, waveform=starts.index(header.waveform_start))
    found = {record.key: record.data for record in vlrs}
    frame = frame.without(lambda record: record.key in _COMPRESSION)
    if not header.compression:
        return frame
    laszip = found.get(_LASZIP)
    if laszip is None:
        raise DataError("is compressed, but has no LASzip record that says how")
    return replace(frame, laszip=laszip, copc=found.get(_COPC, b""))


_LASZIP, _COPC = ("laszip encoded", 22204), ("copc", 1)
_COMPRESSION = (_LASZIP, _COPC, ("copc", 1000))
_WAVEFORM_INTERNAL = 2  # bit of the global encoding


def _read_header(stream: BinaryIO, size: int) -> Header:
    if size == 0:
        raise DataError("is empty (0 bytes)")
    start = stream.read(SIZES[4])
    if start[:4] != b"LASF":
        raise DataError(f"is not a LAS file: it begins with {start[:4]!r}, not b'LASF'")
    if len(start) < SIZES[0]:
        raise DataError(f"ends within the header, after {len(start)} of {SIZES[0]} bytes")
    major, minor = start[24], start[25]
    if major != 1 or minor not in SIZES:
        raise DataError(f"is LAS version {major}.{minor}; versions 1.0 to 1.4 can be read")
    (length,) = struct.unpack_from("<H", start, 94)
    if not SIZES[minor] <= length <= size:
        raise DataError(
            f"claims a header of {length} bytes; version 1.{minor} has at least {SIZES[minor]}, "
            f"and the file {size}"
        )
    stream.seek(0)
    return Header(stream.read(length))


def _check_numbers(header: Header, warn: Callable[[str], None]) -> None:
    """Point format, record length, scales and offsets, counts."""
    if header.compression not in (0, 2) or header.point_format >= len(_FORMATS):
        raise DataError(f"has the unknown point format {header.raw[104]}")
    least = Layout(header.point_format).dtype.itemsize
    if header.record_length < least:
        raise DataError(
            f"has point records of {header.record_length} bytes; "
            f"point format {header.point_format} needs {least}"
        )
    for what, values in (("scale", header.scales), ("offset", header.offsets)):
        bad = ~np.isfinite(values) | ((values == 0) & (what == "scale"))
        if bad.any():
            axis = "xyz"[int(np.argmax(bad))]
            raise DataError(f"has the impossible {what} {values[bad][0]} for {axis}")
    if header.legacy_count not in (0, header.point_count):
        warn(
            f"counts {header.point_count} points, and {header.legacy_count} in the field for "
            "older readers, which is ignored"
        )


def _check_places(header: Header, size: int, warn: Callable[[str], None]) -> None:
    """Whether points and records lie within the file."""
    start = header.offset_to_points
    if not len(header.raw) <= start <= size:
        raise DataError(
            f"claims that its points begin at byte {start}; the header ends at "
            f"{len(header.raw)} and the file at {size}"
        )
    promised = header.point_count * header.record_length
    end = size
    if header.evlr_count:
        end = header.evlr_start
        if not start <= end <= size:
            raise DataError(f"claims records after the points at byte {end}; it has {size} bytes")
    if not header.compression and promised > end - start:
        present = (end - start) // header.record_length
        raise DataError(
            f"is cut off: its header promises {header.point_count} points, and {present} are there"
        )
    more = (end - start - promised) // header.record_length
    if more and not header.compression and not header.waveform_start:
        warn(f"has room for {more} points more than its header promises; they are not read")


def _read_vlrs(
    stream: BinaryIO, header: Header, warn: Callable[[str], None]
) -> tuple[tuple[Record, ...], bytes]:
    """The VLRs, and the bytes between them and the points."""
    block = stream.read(header.offset_to_points - len(header.raw))
    records: list[Record] = []
    place = 0
    for _ in range(header.vlr_count):
        head = block[place : place + 54]
        size = struct.unpack_from("<H", head, 20)[0] if len(head) == 54 else len(block)
        if place + 54 + size > len(block):
            warn(
                f"promises {header.vlr_count} variable length records, but only {len(records)} "
                "fit before the points; the others are ignored"
            )
            break
        records.append(Record(head, block[place + 54 : place + 54 + size]))
        place += 54 + size
    return tuple(records), block[place:]


def _read_evlrs(
    stream: BinaryIO, header: Header, size: int
) -> tuple[tuple[Record, ...], list[int]]:
    """The records after the points, and where each begins."""
    start, count = header.evlr_start, header.evlr_count
    if header.minor == 3 and header.encoding & _WAVEFORM_INTERNAL:
        start, count = header.waveform_start, 1
    records: list[Record] = []
    starts: list[int] = []
    for number in range(1, count + 1):
        stream.seek(min(start, size))
        head = stream.read(60)
        length = struct.unpack_from("<Q", head, 20)[0] if len(head) == 60 else size
        if start + 60 + length > size:
            raise DataError(
                f"is cut off: record {number} of {count} after the points ends beyond the file"
            )
        records.append(Record(head, stream.read(length)))
        starts.append(start)
        start += 60 + length
    return tuple(records), starts


def _layout(header: Header, vlrs: tuple[Record, ...], warn: Callable[[str], None]) -> Layout:
    """The point record; extra bytes whose description is wrong are kept but not named."""
    plain = Layout(header.point_format)
    spare = header.record_length - plain.dtype.itemsize
    data = b"".join(record.data for record in vlrs if record.key == ("LASF_Spec", 4))
    try:
        extras = tuple(_extras(data, plain))
        described = sum(extra.dtype.itemsize for extra in extras)
        if described > spare:
            raise ValueError(f"{described} bytes per point are described, and {spare} are there")
    except ValueError as error:
        warn(f"describes its extra bytes wrongly, so that they are not shown: {error}")
        return replace(plain, spare=spare)
    return replace(plain, extras=extras, spare=spare - described)


def _extras(data: bytes, plain: Layout) -> Iterator[Extra]:
    if len(data) % _EXTRA.size:
        raise ValueError(f"{len(data)} bytes are not a multiple of {_EXTRA.size}")
    seen = {*plain.standard, *(plain.dtype.names or ()), "x", "y", "z"}
    for place in range(0, len(data), _EXTRA.size):
        extra = Extra.read(data[place : place + _EXTRA.size])
        if not extra.name or extra.name in seen or extra.name == "_spare":
            raise ValueError(f"the name {extra.name!r} is empty or taken")
        seen.add(extra.name)
        yield extra
