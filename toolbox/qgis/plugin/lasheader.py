"""Reads the CRS and the attributes of a LAS or LAZ file from its header.

The CRS is needed to transform coordinates from the map to those of the points, and QGIS without
PDAL does not read it; the names of attributes are offered in dialogs. Layout: LAS 1.4 R15 (ASPRS),
sections 2.4 to 2.7.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

PROJECTION = b"LASF_Projection"
WKT, GEO_KEYS = 2112, 34735
PROJECTED, GEOGRAPHIC = 3072, 2048  # GeoTIFF keys that hold an EPSG code
USER_DEFINED = 32767
EXTRA_BYTES = 4
EVERY_POINT = (
    "intensity",
    "return_number",
    "number_of_returns",
    "classification",
    "scan_angle",
    "user_data",
    "point_source_id",
)
WITH_TIME = (1, 3, 4, 5, 6, 7, 8, 9, 10)  # formats of points
WITH_COLOUR = (2, 3, 5, 7, 8, 10)
WITH_INFRARED = (8, 10)


def las_crs(path: str) -> str:
    """The CRS as WKT or ``EPSG:code``; empty if the file states none or is no LAS file."""
    for user, number, body in _records(path):
        if user == PROJECTION and number == WKT:
            return body.rstrip(b"\0").decode("utf-8", "replace")
        if user == PROJECTION and number == GEO_KEYS:
            return _of_keys(body)
    return ""


def las_attributes(path: str) -> list[str]:
    """The names of the attributes of points; empty if the file is no LAS file."""
    try:
        with open(path, "rb") as file:
            header = file.read(105)
    except OSError:
        return []
    if header[:4] != b"LASF" or len(header) < 105:
        return []
    format = header[104] & 0x3F  # the bits above say that it is packed
    names = [*EVERY_POINT]
    names += ["gps_time"] * (format in WITH_TIME)
    names += ["red", "green", "blue"] * (format in WITH_COLOUR)
    names += ["nir"] * (format in WITH_INFRARED)
    for user, number, body in _records(path):
        if user == b"LASF_Spec" and number == EXTRA_BYTES:
            each = (body[start : start + 192] for start in range(0, len(body) - 191, 192))
            names += [one[4:36].rstrip(b"\0").decode("utf-8", "replace") for one in each]
    return names


def _records(path: str) -> Iterator[tuple[bytes, int, bytes]]:
    """The variable length records of the header: user, number and body."""
    try:
        with open(path, "rb") as file:
            header = file.read(104)
            if header[:4] != b"LASF":
                return
            size, _, count = struct.unpack_from("<HII", header, 94)
            file.seek(size)
            for _ in range(count):
                user, number, length = struct.unpack("<2x16sHH32x", file.read(54))
                yield user.rstrip(b"\0"), number, file.read(length)
    except (OSError, struct.error):
        return


def _of_keys(body: bytes) -> str:
    """The EPSG code among GeoTIFF keys: rows of key, location, count and value."""
    rows = list(struct.iter_unpack("<4H", body[: len(body) // 8 * 8]))[1:]
    codes = {key: value for key, location, _, value in rows if location == 0}
    code = codes.get(PROJECTED) or codes.get(GEOGRAPHIC)
    return f"EPSG:{code}" if code and code != USER_DEFINED else ""
