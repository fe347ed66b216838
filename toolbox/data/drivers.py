"""Which driver of GDAL may read a file: those of its suffix.

GDAL goes by the content. Left to itself, it would take a virtual raster called ``a.tif`` for what
it is, and read whatever file or address of the network that names. So rasters are opened with the
driver of their suffix alone. Vector files, where pyogrio leaves no choice, must begin as those of
their suffix do, and hold no mark of a format that refers to other places.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from toolbox.errors import DataError

RASTERS: Mapping[str, str] = {
    ".tif": "GTiff",
    ".tiff": "GTiff",
    ".asc": "AAIGrid",
    ".img": "HFA",
    ".bil": "EHdr",
    ".flt": "EHdr",
    ".dem": "USGSDEM",
    ".dt0": "DTED",
    ".dt1": "DTED",
    ".dt2": "DTED",
    ".hgt": "SRTMHGT",
    ".jp2": "JP2OpenJPEG",
    ".png": "PNG",
    ".jpg": "JPEG",
    ".nc": "netCDF",
    ".gpkg": "GPKG",
}
"""Driver by suffix."""

_SQLITE, _XML = rb"SQLite format 3\0", rb"\s*<"
VECTORS: Mapping[str, bytes] = {
    ".gpkg": _SQLITE,
    ".sqlite": _SQLITE,
    ".geojson": rb"\s*\{",
    ".json": rb"\s*\{",
    ".fgb": rb"fgb",
    ".shp": rb"\0\0'\n",
    ".kml": _XML,
    ".gml": _XML,
    ".gpx": _XML,
    ".dxf": rb"\s*(0|999)\s|AutoCAD Binary DXF",
    ".tab": rb"!table",
    ".mif": rb"(?i)version",
}
"""How files begin, by suffix: a regular expression; a mark of the byte order may stand before."""

_TABLE = ".csv with columns x, y and z, or easting, northing and elevation, or wkt"
_TEXTS, _CLOUDS = (".txt", ".xyz", ".pts"), (".las", ".laz", ".ply", ".e57", ".pcd", ".ptx")
_ELSEWHERE = re.compile(rb"(?i)<OGR(VRT|WFS)DataSource|gdal_streamed_alg")
_HEAD = 2**16  # bytes, in which GDAL looks for such marks; it begins with 1024
_SIDE_CARS = (".msk", ".ovr")  # rasters that GDAL opens beside a raster, whatever they are
_TIFF = re.compile(rb"II[*+]\0|MM\0[*+]")


def raster_driver(path: Path) -> str:
    """The driver that may read a raster.

    Raises
    ------
    DataError
        There is no such file, or none for its suffix, or a file beside it is no TIFF.
    """
    driver = RASTERS.get(path.suffix.lower())
    if driver is None:
        raise DataError(_unknown(path, "rasters", RASTERS, "gdal_translate"))
    if not path.is_file():
        raise DataError(f"{path}: no such file")
    for beside in (Path(f"{path}{ending}") for ending in _SIDE_CARS):
        if beside.is_file() and not _TIFF.match(_begin(beside)):
            raise DataError(f"{path} has a mask or overviews beside it that are no TIFF: {beside}")
    return driver


def check_vector(path: Path) -> None:
    """Raise an error unless a vector file is what its suffix says, as far as its first bytes tell.

    Raises
    ------
    DataError
        There is no such file, or it is of another format.
    """
    begins = VECTORS.get(path.suffix.lower())
    if begins is None:
        raise DataError(_unknown(path, "vector layers", [*VECTORS, ".parquet", _TABLE], "ogr2ogr"))
    if not path.is_file():
        raise DataError(f"{path}: no such file")
    head = _begin(path)
    if not re.match(rb"(\xef\xbb\xbf)?(" + begins + b")", head) or _ELSEWHERE.search(head):
        suffix = path.suffix.lower()
        raise DataError(
            f"{path} cannot be read as a vector layer: it does not begin as {suffix} files do"
        )


def _unknown(path: Path, what: str, suffixes: Iterable[str], program: str) -> str:
    ending = path.suffix.lower() or "a file without ending"
    read = ", ".join(suffixes)
    if program == "ogr2ogr" and ending in _TEXTS:  # of which no program knows the columns
        return (
            f"{path}: {what} are read from {read}, not {ending}; save it as .csv whose first line "
            "has the names of its columns, such as id,x,y,z"
        )
    if program == "gdal_translate" and ending in _CLOUDS:
        return f"{path} holds points; surface.grid makes a raster of them"
    return f"{path}: {what} are read from {read}, not {ending}; convert it with {program}"


def _begin(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(_HEAD)
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from error
