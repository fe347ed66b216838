"""The CRS in the VLRs of LAS files: OGC WKT, GeoTIFF keys, and one of ours for a local CRS."""

from __future__ import annotations

import struct
from collections.abc import Iterable

from pyproj import CRS
from pyproj.exceptions import CRSError

from toolbox.context import log
from toolbox.data.crs import (
    crs_text,
    describe_crs,
    horizontal_crs,
    is_local,
    local_crs,
    same_crs,
    vertical_unit,
)
from toolbox.data.las.header import Vlr

WKT_BIT = 16  # of the global encoding
_USER = "LASF_Projection"
_WKT, _KEYS, _DOUBLES, _TEXT = 2112, 34735, 34736, 34737
_LOCAL = ("lidar-toolbox", 2)  # holds a word such as "local:mm"


def is_crs_vlr(vlr: Vlr) -> bool:
    """Whether a VLR or EVLR states a CRS (2111 is the unused math transform)."""
    user, number = vlr.key
    return vlr.key == _LOCAL or (user == _USER and number in (2111, _WKT, _KEYS, _DOUBLES, _TEXT))


def read_crs(vlrs: Iterable[Vlr], *, wkt: bool, name: str) -> CRS | None:
    """The CRS that VLRs state, or None; the statement of a local CRS counts if there is no other.

    Parameters
    ----------
    vlrs : VLRs and EVLRs
    wkt : whether the file says that its CRS is stated as WKT; decides where both are present
    name : of the file, for the log, which tells why a CRS cannot be understood
    """
    keyed = [(*vlr.key, vlr.data) for vlr in vlrs]
    found = {number: data for user, number, data in keyed if user == _USER}
    readers = {_WKT: _read_wkt, _KEYS: _read_geotiff}
    order = (_WKT, _KEYS) if wkt else (_KEYS, _WKT)
    for number in order:
        if number not in found:
            continue
        try:
            crs = readers[number](found)
        except (ValueError, CRSError) as error:
            log.warning("%s: its CRS record %s cannot be understood: %s", name, number, error)
        else:
            if crs is not None:
                return crs
    local = next((data for *key, data in keyed if tuple(key) == _LOCAL), b"")
    return local_crs(local.decode("ascii", "replace"))


def crs_vlrs(crs: CRS | None, point_format: int, *, wkt: bool) -> tuple[tuple[Vlr, ...], bool]:
    """The VLRs that state a CRS, and whether they are WKT.

    Point formats 6-10 need WKT (LAS 1.4, 2.2). For the older ones GeoTIFF keys are written where
    they can say it, that is where the components of the CRS have EPSG codes.

    Parameters
    ----------
    crs : None gives no VLR
    point_format : of the file
    wkt : the WKT bit that is returned if there is no VLR
    """
    if crs is None or is_local(crs):
        said = () if crs is None else (Vlr.make(*_LOCAL, "local CRS", crs_text(crs).encode()),)
        return said, wkt or point_format >= 6
    keys = _geotiff(crs) if point_format < 6 else None
    if keys is not None:
        return (Vlr.make(_USER, _KEYS, "GeoTIFF keys", keys),), False
    return (Vlr.make(_USER, _WKT, "OGC WKT", _wkt(crs).encode() + b"\0"),), True


def _read_wkt(found: dict[int, bytes]) -> CRS | None:
    text = found[_WKT].split(b"\0")[0].decode("utf-8").strip()
    return CRS.from_wkt(text) if text else None


def _wkt(crs: CRS) -> str:
    """WKT 1 as the LAS specification has it (OGC 01-009), if it can say what the CRS is."""
    try:
        text: str = crs.to_wkt("WKT1_GDAL")
        if same_crs(CRS.from_wkt(text), crs):
            return text
    except CRSError:
        pass
    return str(crs.to_wkt("WKT2_2019"))


def _geotiff(crs: CRS) -> bytes | None:
    """A GeoTIFF key directory of EPSG codes alone, or None if they cannot say what the CRS is."""
    components = crs.sub_crs_list or [crs]
    codes = [component.to_epsg() for component in components]
    if (
        None in codes
        or len(components) > 2
        or not (components[0].is_projected or components[0].is_geographic)
    ):
        return None
    projected = components[0].is_projected
    keys = [(1024, 1 if projected else 2), (1025, 1), (3072 if projected else 2048, codes[0])]
    keys += [(4096, code) for code in codes[1:]]
    entries = [value for number, code in sorted(keys) for value in (number, 0, 1, code)]
    directory = struct.pack(f"<{4 + len(entries)}H", 1, 1, 0, len(keys), *entries)
    try:
        again = _read_geotiff({_KEYS: directory})
    except (ValueError, CRSError):
        return None
    return directory if same_crs(again, crs) else None


def _read_geotiff(found: dict[int, bytes]) -> CRS | None:
    """The CRS of GeoTIFF keys as GDAL reads them, since it may have no code."""
    import rasterio
    from rasterio.errors import RasterioError

    keys = found[_KEYS]
    count = struct.unpack_from("<H", keys, 6)[0] if len(keys) >= 8 else 0
    if count == 0:
        return None
    keys = keys[: 8 + 8 * count]
    if len(keys) < 8 + 8 * count:
        raise ValueError(f"{count} keys are promised, and {len(keys) // 8 - 1} are there")
    tiff = _tiff(keys, found.get(_DOUBLES, b""), found.get(_TEXT, b""))
    try:
        with (
            rasterio.Env(GTIFF_REPORT_COMPD_CS="YES"),
            rasterio.MemoryFile(tiff) as file,
            file.open(driver="GTiff") as raster,
        ):
            text = raster.crs.to_wkt(version="WKT2_2019") if raster.crs else ""
    except RasterioError as error:
        raise ValueError(f"GDAL says {error}") from error
    if not text:
        raise ValueError("GDAL finds no CRS in its GeoTIFF keys")
    crs = CRS.from_wkt(text)
    horizontal = horizontal_crs(crs)
    if horizontal.is_engineering:
        raise ValueError(f"its GeoTIFF keys name no known CRS ({describe_crs(crs)})")
    return horizontal if _says_nothing_of_heights(crs, horizontal) else crs


def _says_nothing_of_heights(crs: CRS, horizontal: CRS) -> bool:
    """Whether the vertical component has no name and only repeats the horizontal unit."""
    return (
        crs.is_compound
        and crs.sub_crs_list[1].name in ("", "unknown")
        and vertical_unit(crs) == vertical_unit(horizontal)
    )


def _tiff(keys: bytes, doubles: bytes, text: bytes) -> bytes:
    """The bytes of a TIFF image of one pixel with these GeoTIFF keys."""
    short, double, characters = 3, 12, 2
    tags = [(number, short, struct.pack("<H", 1)) for number in (256, 257, 259, 262, 277, 278, 279)]
    tags += [(258, short, struct.pack("<H", 8)), (273, short, struct.pack("<H", 8))]
    tags += [(33550, double, struct.pack("<3d", 1, 1, 0)), (33922, double, bytes(48))]
    tags += [(_KEYS, short, keys), (_DOUBLES, double, doubles), (_TEXT, characters, text)]
    tags = sorted(tag for tag in tags if tag[2])
    size = {short: 2, double: 8, characters: 1}
    offset = 16 + 2 + 12 * len(tags) + 4  # of the values that do not fit in an entry
    entries, values = b"", b""
    for number, kind, content in tags:
        entries += struct.pack("<HHI", number, kind, len(content) // size[kind])
        fits = len(content) <= 4
        entries += content.ljust(4, b"\0") if fits else struct.pack("<I", offset + len(values))
        values += b"" if fits else content + b"\0" * (len(content) % 2)
    start = struct.pack("<2sHI", b"II", 42, 16) + bytes(8)  # the pixel is at byte 8
    return start + struct.pack("<H", len(tags)) + entries + bytes(4) + values
