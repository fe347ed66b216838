"""GeoPackage files: names of their tables, the files beside them, and a constant date."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

SUFFIX = ".gpkg"
DAY = "2000-01-01"  # said by every file; with the day of the run, no two would be the same
WRITTEN = f"{DAY}T00:00:00.000Z"
OPTIONS = {"dataset_options": {"VERSION": "1.3"}}  # which older QGIS reads too
_BESIDE = ("-wal", "-shm", "-journal")  # of the SQLite database that it is


def own_files(path: Path) -> tuple[Path, ...]:
    """The GeoPackage, and the journals that SQLite keeps beside it."""
    return path, *(Path(f"{path}{ending}") for ending in _BESIDE)


def tables(path: Path) -> list[str]:
    """Names of the tables without geometry in a GeoPackage."""
    query = "SELECT table_name FROM gpkg_contents WHERE data_type = 'attributes'"
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
        return [str(name) for (name,) in database.execute(query)]


def description(path: Path, layer: str) -> str:
    """What a GeoPackage says of one of its layers."""
    query = "SELECT description FROM gpkg_contents WHERE table_name = ?"
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
        try:
            row = database.execute(query, (layer,)).fetchone()
        except sqlite3.Error as error:
            raise ValueError(str(error)) from error
    return str(row[0] or "") if row else ""


@contextmanager
def same_date() -> Iterator[None]:
    """Make GDAL write the same date into every file."""
    import pyogrio

    option = "OGR_CURRENT_DATE"
    before = pyogrio.get_gdal_config_option(option)
    pyogrio.set_gdal_config_options({option: WRITTEN})
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options({option: before})
