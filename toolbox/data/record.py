"""The provenance record of a file, read and written in the way of its format.

A record is a JSON object with the member "lidar-toolbox"; what else is in it is not looked at
here (see `toolbox.runs.provenance`). It stands in the file where the format has room, so that it is
not lost when the file is moved, and in a file `<name>.json` beside it elsewhere:

===================  ===========================================================
LAS, LAZ             variable length record "lidar-toolbox" 1, an extended one if it is long
GeoTIFF              GDAL metadata item PROVENANCE, which is in a TIFF tag
GeoPackage           row of the table gpkg_metadata
PNG                  text chunk "provenance"
HTML                 script element "provenance" of type application/json
all others           side-car `<name>.json`
===================  ===========================================================

References
----------
OGC 12-128r17, GeoPackage 1.3.0, annex F.8: metadata.
"""

from __future__ import annotations

import json
import sqlite3
import struct
import warnings
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from toolbox.data.drivers import raster_driver
from toolbox.data.las.header import LasMetadata, Vlr, parse_metadata
from toolbox.data.paths import local
from toolbox.data.reading import errors_named
from toolbox.data.remote.address import as_path
from toolbox.errors import DataError

MEMBER = "lidar-toolbox"
"""The member of the JSON object that makes it a record of ours."""

ITEM = "PROVENANCE"
"""Name of the GDAL metadata item of a GeoTIFF."""

CHUNK = "provenance"
"""Keyword of the text chunk of a PNG."""

# Not through GDAL: of metadata that it has written itself it would put a copy, which becomes
# stale, in a file .aux.xml beside a GeoPackage that is merely opened.
_STANDARD = "urn:lidar-toolbox:provenance"
_METADATA = """
CREATE TABLE IF NOT EXISTS gpkg_extensions (
  table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL, definition TEXT NOT NULL,
  scope TEXT NOT NULL, CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name));
CREATE TABLE gpkg_metadata (
  id INTEGER CONSTRAINT m_pk PRIMARY KEY ASC NOT NULL, md_scope TEXT NOT NULL DEFAULT 'dataset',
  md_standard_uri TEXT NOT NULL, mime_type TEXT NOT NULL DEFAULT 'text/xml',
  metadata TEXT NOT NULL DEFAULT '');
CREATE TABLE gpkg_metadata_reference (
  reference_scope TEXT NOT NULL, table_name TEXT, column_name TEXT, row_id_value INTEGER,
  timestamp DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  md_file_id INTEGER NOT NULL, md_parent_id INTEGER,
  CONSTRAINT crmr_mfi_fk FOREIGN KEY (md_file_id) REFERENCES gpkg_metadata(id),
  CONSTRAINT crmr_mpi_fk FOREIGN KEY (md_parent_id) REFERENCES gpkg_metadata(id));
INSERT INTO gpkg_extensions
  SELECT column1, NULL, 'gpkg_metadata',
         'http://www.geopackage.org/spec120/#extension_metadata', 'read-write'
  FROM (VALUES ('gpkg_metadata'), ('gpkg_metadata_reference'));
"""
_VLR = ("lidar-toolbox", 1)
_LONGEST = 0xFFFF  # bytes in a VLR
_MOST = 1_000_000  # bytes that are looked at in what may be a side-car
_LAS, _TIFF = (".las", ".laz"), (".tif", ".tiff")
_PNG_START = b"\x89PNG\r\n\x1a\n"


def is_record(text: str) -> bool:
    """Whether a text is a provenance record of this toolbox."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return False
    return isinstance(found, dict) and MEMBER in found


def checked(text: str) -> str:
    """The given text, if it is a provenance record.

    Raises
    ------
    ValueError
        It is no record, and could not be read back.
    """
    if not is_record(text):
        raise ValueError(f"a record is a JSON object with the member {MEMBER!r}, got {text[:60]!r}")
    return text


def read_record(path: str | Path) -> str:
    """Read the provenance record of a file; "" if it has none.

    Raises
    ------
    DataError
        The file is missing, or is not what its suffix says.
    """
    path = as_path(path)
    path = path if path.suffix.lower() in _LAS else local(path)
    if not path.is_file():
        raise DataError(f"{path}: no such file")
    readers = dict.fromkeys(_LAS, _of_las) | dict.fromkeys(_TIFF, _of_tiff)
    readers |= {".gpkg": _of_geopackage, ".png": _of_png, ".html": _of_html}
    with errors_named(f"{path} cannot be read"):
        text = readers.get(path.suffix.lower(), _beside)(path)
    return text if is_record(text) else ""


def side_car(path: str | Path) -> Path | None:
    """The path beside a file at which its record stands; None if the file holds it itself."""
    inside = (*_LAS, *_TIFF, ".gpkg", ".png", ".html")
    return None if Path(path).suffix.lower() in inside else Path(f"{path}.json")


def own_side_car(path: str | Path) -> tuple[Path, ...]:
    """A tuple of the side-car of a file if that holds a record of this toolbox; else empty."""
    beside = side_car(path)
    return (beside,) if beside and beside.is_file() and is_record(_text(beside)) else ()


def foreign_side_car(path: str | Path) -> Path | None:
    """A file of somebody else at the path where the record of a file would be written; or None."""
    beside = side_car(path)
    return beside if beside and beside.exists() and not own_side_car(path) else None


def write_beside(path: Path, text: str) -> None:
    """Write a record to the side-car of a file; the text "" removes that of an earlier run.

    Raises
    ------
    DataError
        Another file stands in its place.
    """
    beside = side_car(path)
    if beside is None:
        raise ValueError(f"{path} holds its record itself")
    if not text:
        for stale in own_side_car(path):
            stale.unlink()
        return
    if other := foreign_side_car(path):
        raise DataError(f"{other} is no record of ours, and would be replaced by one")
    beside.write_text(checked(text) + "\n", encoding="utf-8", newline="\n")


def write_into_geopackage(path: Path, text: str, timestamp: str) -> None:
    """Add a record to a GeoPackage that was just written and has no metadata yet.

    Parameters
    ----------
    timestamp : that the row states, in ISO 8601

    Raises
    ------
    DataError
        It cannot be written, as on a full disk.
    """
    row = "INSERT INTO gpkg_metadata VALUES (1, 'dataset', ?, 'application/json', ?)"
    values = "VALUES ('geopackage', NULL, NULL, NULL, ?, 1, NULL)"
    try:
        with closing(sqlite3.connect(path)) as database, database:
            database.executescript(_METADATA)
            database.execute(row, (_STANDARD, checked(text)))
            database.execute(f"INSERT INTO gpkg_metadata_reference {values}", (timestamp,))
    except sqlite3.Error as error:
        raise DataError(f"{path} cannot be written: {error}") from error


def with_record(metadata: LasMetadata, text: str) -> LasMetadata:
    """The metadata of a LAS file with this record, and without one of an earlier run.

    A record of more than 65 535 bytes goes behind the points, which only LAS 1.4 can do.

    Raises
    ------
    DataError
        It is too long for an older version of LAS.
    """
    metadata = metadata.without(lambda vlr: vlr.key == _VLR)
    if not text:
        return metadata
    data = checked(text).encode()
    if len(data) <= _LONGEST:
        return replace(metadata, vlrs=(*metadata.vlrs, Vlr.make(*_VLR, "provenance", data)))
    if metadata.header.version.minor < 4:
        raise DataError(f"a record of {len(data)} bytes is too long for LAS before 1.4")
    head = struct.pack("<2x16sHQ32s", _VLR[0].encode(), _VLR[1], len(data), b"provenance")
    return replace(metadata, evlrs=(*metadata.evlrs, Vlr(head, data)))


def _of_las(path: Path) -> str:
    with path.open("rb") as stream:
        try:
            metadata = parse_metadata(stream, path.stat().st_size, lambda text: None)
        except DataError as error:
            raise DataError(f"{path} {error}") from error
    return record_in(metadata)


def record_in(metadata: LasMetadata) -> str:
    """The record that a LAS file carries, given all but its points; "" if it has none."""
    text = next((_decoded(found.data) for found in metadata.all_vlrs if found.key == _VLR), "")
    return text if is_record(text) else ""


def _decoded(data: bytes) -> str:
    return data.decode(errors="replace")


def _of_tiff(path: Path) -> str:
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(path, driver=raster_driver(path)) as source:
            return str(source.tags().get(ITEM, ""))


def _of_geopackage(path: Path) -> str:
    address = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    query = "SELECT metadata FROM gpkg_metadata WHERE md_standard_uri = ?"
    with closing(sqlite3.connect(address, uri=True)) as database:
        tables = database.execute("SELECT name FROM sqlite_master").fetchall()
        if ("gpkg_metadata",) not in tables:
            return ""
        row = database.execute(query, (_STANDARD,)).fetchone()
    return str(row[0]) if row else ""


def _of_png(path: Path) -> str:
    content = path.read_bytes()
    if not content.startswith(_PNG_START):
        raise DataError(f"{path} is not a PNG file")
    position, wanted = len(_PNG_START), CHUNK.encode() + b"\0"
    while position + 8 <= len(content):
        length, kind = struct.unpack_from(">I4s", content, position)
        data = content[position + 8 : position + 8 + length]
        if kind == b"tEXt" and data.startswith(wanted):
            return data[len(wanted) :].decode("latin-1")
        position += length + 12  # with the four bytes of its checksum
    return ""


def _of_html(path: Path) -> str:
    start = '<script type="application/json" id="provenance">'
    _, _, rest = _text(path).partition(start)
    return rest.partition("</script>")[0]


def _beside(path: Path) -> str:
    beside = side_car(path)
    return _text(beside).strip() if beside and beside.is_file() else ""


def _text(path: Path) -> str:
    with path.open("rb") as stream:
        return _decoded(stream.read(_MOST))
