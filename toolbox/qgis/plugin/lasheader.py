"""Reads the CRS of a LAS or LAZ file from its header.

It is needed to transform coordinates from the map to those of the points, and QGIS without PDAL
does not read it. Layout: LAS 1.4 R15 (ASPRS), sections 2.4 and 2.5.
"""

from __future__ import annotations

import struct

PROJECTION = b"LASF_Projection"
WKT, GEO_KEYS = 2112, 34735
PROJECTED, GEOGRAPHIC = 3072, 2048  # GeoTIFF keys that hold an EPSG code
USER_DEFINED = 32767


def las_crs(path: str) -> str:
    """The CRS as WKT or ``EPSG:code``; empty if the file states none or is no LAS file."""
    try:
        with open(path, "rb") as file:
            header = file.read(104)
            if header[:4] != b"LASF":
                return ""
            size, _, count = struct.unpack_from("<HII", header, 94)
            file.seek(size)
            for _ in range(count):
                user, number, length = struct.unpack("<2x16sHH32x", file.read(54))
                body = file.read(length)
                if user.rstrip(b"\0") == PROJECTION and number == WKT:
                    return body.rstrip(b"\0").decode("utf-8", "replace")
                if user.rstrip(b"\0") == PROJECTION and number == GEO_KEYS:
                    return _of_keys(body)
    except (OSError, struct.error):
        pass
    return ""


def _of_keys(body: bytes) -> str:
    """The EPSG code among GeoTIFF keys: rows of key, location, count and value."""
    rows = list(struct.iter_unpack("<4H", body[: len(body) // 8 * 8]))[1:]
    codes = {key: value for key, location, _, value in rows if location == 0}
    code = codes.get(PROJECTED) or codes.get(GEOGRAPHIC)
    return f"EPSG:{code}" if code and code != USER_DEFINED else ""
