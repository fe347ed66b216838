"""GeoPackage files: names of their tables, the files beside them, styles, and a constant date."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from toolbox.data.reading import errors_named
from toolbox.data.writing import refuse_to_replace
from toolbox.errors import ParameterError
from toolbox.files import OwnFiles

SUFFIX = ".gpkg"
DAY = "2000-01-01"  # said by every file; with the day of the run, no two would be the same
WRITTEN = f"{DAY}T00:00:00.000Z"
OPTIONS = {"dataset_options": {"VERSION": "1.3"}}  # which older QGIS reads too
STYLES = "layer_styles"
"""Name of the table in which QGIS looks for styles of layers; it holds no data."""
_STYLES = f"""
CREATE TABLE IF NOT EXISTS {STYLES} (
  id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, f_table_catalog TEXT(256),
  f_table_schema TEXT(256), f_table_name TEXT(256), f_geometry_column TEXT(256),
  styleName TEXT(30), styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN, description TEXT,
  owner TEXT(30), ui TEXT(30),
  update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')));
INSERT OR IGNORE INTO gpkg_contents (table_name, data_type, identifier, last_change)
  VALUES ('{STYLES}', 'attributes', '{STYLES}', '{WRITTEN}');
"""
_BESIDE = ("-wal", "-shm", "-journal")  # of the SQLite database that it is


def own_files(path: Path) -> tuple[Path, ...]:
    """The GeoPackage, and the journals that SQLite keeps beside it."""
    return path, *(Path(f"{path}{ending}") for ending in _BESIDE)


def tables(path: Path) -> list[str]:
    """Names of the tables without geometry in a GeoPackage."""
    query = "SELECT table_name FROM gpkg_contents WHERE data_type = 'attributes'"
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
        names = [str(name) for (name,) in database.execute(query)]
    return [name for name in names if name != STYLES]


def add_style(path: Path, layer: str, qml: str) -> None:
    """Add the style in which QGIS draws a layer that was just written.

    References
    ----------
    QGIS 3.22, QgsOgrProviderMetadata::saveStyle: the columns of the table.
    """
    column = "SELECT column_name FROM gpkg_geometry_columns WHERE table_name = ?"
    row = f"""
        INSERT INTO {STYLES} (f_table_catalog, f_table_schema, f_table_name, f_geometry_column,
                              styleName, styleQML, useAsDefault, description, owner, update_time)
        VALUES ('', '', ?, ({column}), ?, ?, 1, '', '', ?)
    """
    with closing(sqlite3.connect(path)) as database, database:
        database.executescript(_STYLES)
        database.execute(row, (layer, layer, layer, qml, WRITTEN))


def as_stored(path: Path, layer: str) -> str | None:
    """The name of a table of a GeoPackage, whose letters may be small or large; None without it.

    Raises
    ------
    DataError
        There is another kind of file.
    """
    query = "SELECT table_name FROM gpkg_contents WHERE lower(table_name) = lower(?)"
    with errors_named(f"{path} cannot be read as a GeoPackage"):
        if not path.exists():
            return None
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
            row = database.execute(query, (layer,)).fetchone()
    return str(row[0]) if row else None


def name_to_write(
    path: Path, layer: str | None, own_files: OwnFiles, *, add: bool, overwrite: bool
) -> str:
    """The name of a layer to write to a file, if that, or the layer in it, may be replaced.

    A layer that is added to a GeoPackage has the name of the one that it replaces, as spelt there.

    Raises
    ------
    ParameterError
        There is the file or, with `add`, a layer of this name.
    DataError
        A layer cannot be added to what is there, or no file can be there.
    """
    name = layer or path.stem
    if not add or path.suffix.lower() != SUFFIX:
        refuse_to_replace(path, own_files, overwrite=overwrite)
        return name
    stored = as_stored(path, name)
    if stored and not overwrite:
        text = f"layer {stored} of {path} exists; allow it with overwrite=True beside add=True"
        raise ParameterError(text)
    return stored or name


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
