"""Points with waveforms: a Gaussian echo at each point, in the file or in a .wdp beside it."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np

from toolbox.data import PointCloud

SAMPLES, SPACING = 60, 1000  # of a packet; picoseconds
TO_SENSOR = (
    0.0,
    3e-5,
    1.47e-4,
)  # metres per picosecond: light there and back, pulses nearly upright
GAIN = 0.01  # volts
HEAD = 60  # bytes


def location(number: int) -> float:
    """Picoseconds from the first sample to the echo of a point."""
    return 20_000.0 + 100 * (number % 50)


def packet(number: int) -> bytes:
    """The samples of a point: noise of one step, and an echo of 200."""
    times = SPACING * np.arange(SAMPLES) - location(number)
    return (200 * np.exp(-((times / 4000) ** 2)) + 1).astype(np.uint8).tobytes()


def scanned(points: PointCloud, path: Path, *, inside: bool = False) -> PointCloud:
    """The points, written and read again in LAS 1.4, point format 9, with waveforms.

    The packets are in the order of the coordinates, whatever that of the points is.

    Parameters
    ----------
    path : to write to, .las or .laz
    inside : whether the packets are in the file itself
    """
    header = laspy.LasHeader(version="1.4", point_format=9)
    header.scales, header.offsets = np.full(3, 0.001), np.floor(points.xyz[:1].sum(axis=0))
    header.global_encoding.waveform_data_packets_external = not inside
    header.global_encoding.waveform_data_packets_internal = inside
    kind = struct.pack("<2B2I2d", 8, 0, SAMPLES, SPACING, GAIN, 0.0)
    header.vlrs.append(laspy.VLR("LASF_Spec", 100, "waveform", kind))
    las, count = laspy.LasData(header), len(points)
    ranks = np.argsort(np.lexsort(points.xyz.T[::-1]))
    las.x, las.y, las.z = points.xyz.T
    for name in ("intensity", "classification", "return_number", "number_of_returns", "gps_time"):
        if name in points:
            las[name] = points[name]
    las.wavepacket_index = np.ones(count, np.uint8)
    las.wavepacket_offset = HEAD + SAMPLES * ranks
    las.wavepacket_size = np.full(count, SAMPLES)
    las.return_point_wave_location = [location(number) for number in ranks.tolist()]
    for name, value in zip(("x_t", "y_t", "z_t"), TO_SENSOR, strict=True):
        las[name] = np.full(count, value * points.metre)
    las.write(path)
    data = b"".join(map(packet, range(count)))
    record = struct.pack("<2x16sHQ32s", b"LASF_Spec", 65535, len(data), b"") + data
    if inside:
        _append(path, record)
    else:
        path.with_suffix(".wdp").write_bytes(record)
    return PointCloud.open(path).with_crs(points.crs)


def _append(path: Path, record: bytes) -> None:
    """Put the packets behind the points, and their place into the header."""
    content = bytearray(path.read_bytes())
    struct.pack_into("<QQI", content, 227, len(content), len(content), 1)
    path.write_bytes(content + record)
