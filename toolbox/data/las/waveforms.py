"""What a LAS file says of its waveforms: the descriptors of their packets.

References
----------
ASPRS (2019). LAS specification 1.4, R15, 2.3 and "Waveform packet descriptor".
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from toolbox.data.las.header import LasMetadata

_FIRST = 99  # id of the record of descriptor 0, which means no waveform; 1 to 255 follow
_DESCRIPTOR = struct.Struct("<2B2I2d")


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
    """Where the packets are: "in the file", "in a file .wdp beside it", or "" for nowhere."""
    encoding = metadata.header.global_encoding
    if metadata.waveform is not None:
        return "in the file"
    return "in a file .wdp beside it" if encoding.waveform_data_packets_external else ""
