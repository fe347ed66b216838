"""Waveforms of a LAS file: the descriptors of their packets, the packets, and what is in one.

References
----------
ASPRS (2019). LAS specification 1.4, R15, 2.3 and "Waveform packet descriptor", point formats 4, 5,
9 and 10.
"""

from __future__ import annotations

import shutil
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox.context import log
from toolbox.data.las.header import LasMetadata, demand
from toolbox.errors import DataError

FORMATS = (4, 5, 9, 10)
"""Point formats that have waveforms."""

_FIRST = 99  # id of the record of descriptor 0, which means no waveform; 1 to 255 follow
_DESCRIPTOR = struct.Struct("<2B2I2d")
_HEAD = 60  # bytes of the record's head, from whose beginning the places of packets are counted
_SAMPLES = {8: "u1", 16: "<u2", 32: "<u4"}  # types of samples, by their bits
_EXTERNAL = 4  # bit of the global encoding, in byte 6 of the file
_SUFFIX = ".wdp"

Array = NDArray[Any]


@dataclass(frozen=True)
class WaveformDescriptor:
    """How the packets of some points are sampled.

    Attributes
    ----------
    number : by which points refer to it, 1 to 255
    bits, samples : of a packet
    spacing : picoseconds between two samples
    gain, offset : volts of a sample are offset + gain * value
    compression : 0 for none
    """

    number: int
    compression: int
    bits: int
    samples: int
    spacing: int
    gain: float
    offset: float


@dataclass(frozen=True, eq=False)
class Pulse:
    """The waveform of one point.

    Attributes
    ----------
    times : picoseconds from the first sample, of shape (n,)
    volts : of each sample, of shape (n,)
    location : picoseconds from the first sample to the point
    vector : by how much x, y and z change in a picosecond on the way to the sensor, of shape (3,)
    """

    times: NDArray[np.float64]
    volts: NDArray[np.float64]
    location: float
    vector: NDArray[np.float64]


def descriptors(metadata: LasMetadata) -> tuple[WaveformDescriptor, ...]:
    """The descriptors of a file in the order of their numbers; damaged ones are left out."""
    found = []
    for record in metadata.all_vlrs:
        user, number = record.key
        whole = len(record.data) >= _DESCRIPTOR.size
        if user == "LASF_Spec" and _FIRST < number <= _FIRST + 255 and whole:
            bits, compression, *rest = _DESCRIPTOR.unpack_from(record.data)
            found.append(WaveformDescriptor(number - _FIRST, compression, bits, *rest))
    return tuple(sorted(found, key=lambda one: one.number))


def place_of(metadata: LasMetadata) -> str:
    """Where the packets are, in words; "" for nowhere."""
    if metadata.waveform is not None:
        return "in the file"
    if metadata.packets is not None:
        return "in a file .wdp beside it"
    return "in a file .wdp, which is not beside it" if _is_external(metadata) else ""


def size_of(metadata: LasMetadata) -> int:
    """Bytes of all packets that are there, with the head of their record."""
    if metadata.waveform is not None:
        return _HEAD + len(metadata.waveform.data)
    return metadata.packets.stat().st_size if metadata.packets else 0


def packets_beside(metadata: LasMetadata, path: Path) -> Path | None:
    """The file .wdp beside a LAS file that says that its packets are there; None without one."""
    if not _is_external(metadata):
        return None
    names = (path.with_suffix(suffix) for suffix in (_SUFFIX, _SUFFIX.upper()))
    return next((beside for beside in names if beside.is_file()), None)


def own_packets(path: Path) -> tuple[Path, ...]:
    """A tuple of the file .wdp that belongs to the LAS file at a path; empty without one."""
    beside = path.with_suffix(_SUFFIX)
    return (beside,) if beside.is_file() and _says_external(path) else ()


def foreign_packets(path: Path) -> Path | None:
    """The file .wdp where the packets of a LAS file would be written, if it is not its own."""
    beside = path.with_suffix(_SUFFIX)
    return beside if beside.exists() and not own_packets(path) else None


def copy_packets(metadata: LasMetadata, path: Path) -> None:
    """Put the packets of points that were written to a path beside it, if they are in a .wdp.

    All are copied, whichever points are left, as points tell their packets by their places.

    Raises
    ------
    OSError
        They cannot be copied.
    """
    if not _is_external(metadata) or metadata.header.point_format.id not in FORMATS:
        return
    if metadata.packets is None:
        text = "%s: its waveforms are in a file .wdp that was not beside the input"
        log.warning(text, path.name)
        return
    shutil.copyfile(metadata.packets, path.with_suffix(_SUFFIX))
    log.info("waveforms are in %s", path.with_suffix(_SUFFIX).name)


def pulse(metadata: LasMetadata, packed: Array, number: int) -> Pulse:
    """The waveform of one of n packed point records.

    Raises
    ------
    DataError
        The point has none, or its packet is not there or cannot be read.
    """
    if metadata.header.point_format.id not in FORMATS or not packed["wavepacket_index"][number]:
        raise DataError(f"point {number} has no waveform")
    point = packed[number]
    kind = _described(metadata, int(point["wavepacket_index"]))
    offset, size = int(point["wavepacket_offset"]), int(point["wavepacket_size"])
    needed = kind.samples * kind.bits // 8
    demand(
        size >= needed,
        f"point {number} has a packet of {size} bytes; descriptor {kind.number} needs {needed}",
    )
    values = np.frombuffer(_packet(metadata, offset, needed), _SAMPLES[kind.bits])
    vector = np.array([point[name] for name in ("x_t", "y_t", "z_t")], float)
    return Pulse(
        times=np.arange(kind.samples, dtype=np.float64) * kind.spacing,
        volts=kind.offset + kind.gain * values,
        location=float(point["return_point_wave_location"]),
        vector=vector,
    )


def _described(metadata: LasMetadata, number: int) -> WaveformDescriptor:
    """The descriptor of a number, if its packets can be read."""
    kind = next((one for one in descriptors(metadata) if one.number == number), None)
    if kind is None:
        raise DataError(f"waveform descriptor {number} is not there")
    demand(kind.compression == 0, f"waveforms of descriptor {number} are compressed")
    bits = ", ".join(map(str, _SAMPLES))
    text = f"waveforms of descriptor {number} have {kind.bits} bits a sample; {bits} can be read"
    demand(kind.bits in _SAMPLES, text)
    return kind


def _packet(metadata: LasMetadata, offset: int, size: int) -> bytes:
    """The bytes of a packet, whose place is counted from the head of the record."""
    if metadata.waveform is not None:
        start = offset - _HEAD
        found = metadata.waveform.data[start : start + size] if start >= 0 else b""
    elif metadata.packets is not None:
        with metadata.packets.open("rb") as stream:
            stream.seek(offset)
            found = stream.read(size)
    else:
        raise DataError(f"waveforms are {place_of(metadata) or 'not there'}")
    demand(
        len(found) == size,
        f"a packet of {size} bytes at byte {offset} is beyond the end of the waveforms, which "
        f"have {size_of(metadata)} bytes: they are cut off",
    )
    return found


def _is_external(metadata: LasMetadata) -> bool:
    return bool(metadata.header.global_encoding.waveform_data_packets_external)


def _says_external(path: Path) -> bool:
    """Whether there is a LAS file at a path whose packets are in a file beside it."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        start = stream.read(7)
    return len(start) == 7 and start[:4] == b"LASF" and bool(start[6] & _EXTERNAL)
