"""The verb ``info``: the properties of a file of any format."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pyproj import CRS

from toolbox.context import QUIET, Context, log
from toolbox.data import Raster, Table, Vector, drivers
from toolbox.data.crs import describe_crs, parse_crs
from toolbox.data.paths import Paths, PointFiles, missing
from toolbox.data.remote.address import as_path
from toolbox.data.text import is_number, standard_names
from toolbox.errors import DataError, ParameterError, memory_named
from toolbox.execute import run

TABLES = (".parquet", ".json")
VECTORS = drivers.VECTORS.keys() - TABLES
RASTERS = drivers.RASTERS.keys() - VECTORS

Row = dict[str, Any]


@memory_named()
def describe_file(paths: Paths, ctx: Context = QUIET, assume_crs: CRS | None = None) -> Table:
    """Make a table of the properties of a layer: rows of property, value and unit.

    A CSV file whose columns include x, y and z, or have no names, is a point cloud, and any other
    a table. Of a file with several vector layers, such as a GeoPackage, all are listed.

    Parameters
    ----------
    paths : a file, or files of points: a folder, a pattern, a VPC, or a list of these
    assume_crs : of layers that state none

    Raises
    ------
    ParameterError
        There is no such file.
    DataError
        The file cannot be read.
    """
    items = [paths] if isinstance(paths, str | Path) else list(paths)
    if absent := missing(items):
        raise ParameterError(f"there is no file {', '.join(absent)}")
    path = as_path(items[0])
    if len(items) > 1 or not path.is_file():
        return _points(items, ctx, assume_crs)
    suffix = path.suffix.lower()
    if suffix in RASTERS:
        return _table(_raster(Raster.open(path, ctx=ctx, assume_crs=assume_crs)))
    if suffix in VECTORS or (suffix == ".parquet" and Vector.layers(path)):
        return _table(_vectors(path, ctx, assume_crs))
    if suffix in TABLES or (suffix == ".csv" and not _holds_points(path)):
        return _table(_rows_of_table(Table.open(path, ctx=ctx)))
    return _points(items, ctx, assume_crs)


def describe_files(
    paths: Sequence[str], ctx: Context = QUIET, assume_crs: str | None = None
) -> list[Table]:
    """One table, as of `describe_file`; one of each file, also of a folder, that are no survey.

    Raises
    ------
    ParameterError, DataError
        As of `describe_file`, for any of the files; or `assume_crs` is no CRS.
    """
    try:
        crs = parse_crs(assume_crs) if assume_crs else None
    except ValueError as error:
        raise ParameterError("info", {"assume_crs": str(error)}) from None
    try:
        return [describe_file(paths, ctx, crs)]
    except DataError as error:
        folder = len(paths) == 1 and as_path(paths[0]).is_dir()
        files = PointFiles.of(paths).paths if folder else paths
        if len(files) < 2:
            raise
        made = [describe_file(path, ctx, crs) for path in files]
        log.warning("the files are described one by one, as they are no survey: %s", error)
        return made


def _points(paths: Paths, ctx: Context, crs: CRS | None) -> Table:
    made: Table = run("points.info", {"points": paths}, assume_crs=crs, ctx=ctx)["table"]
    return made


def _holds_points(path: Path) -> bool:
    """Whether a text file looks like points: its first line has names x, y, z, or three numbers."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        first = file.readline().strip()
    cells = [cell.strip("\"'") for cell in re.split(r"[\s,;]+", first)]
    numbers = sum(is_number(cell) for cell in cells)
    comment = first.startswith(("#", "//"))
    return comment or not first or numbers >= 3 or {"x", "y", "z"} <= {*standard_names(cells)}


def _table(rows: Iterable[Row]) -> Table:
    return Table.from_rows({"property": "", "value": None, "unit": ""} | row for row in rows)


def _row(name: str, value: Any, unit: str = "") -> Row:
    return {"property": name, "value": value, "unit": unit}


def _crs(layer: Raster | Vector) -> str | None:
    return describe_crs(layer.crs) if layer.crs else None


def _bounds(bounds: Iterable[float]) -> Iterator[Row]:
    for name, value in zip(("xmin", "ymin", "xmax", "ymax"), bounds, strict=True):
        yield _row(name, float(value))


def _raster(raster: Raster) -> Iterator[Row]:
    rows, cols = raster.shape
    yield _row("file", raster.name)
    yield _row("crs", _crs(raster))
    yield _row("rows", rows)
    yield _row("columns", cols)
    yield _row("cell", raster.cell)
    yield from _bounds(raster.bounds)
    for number, (text, unit) in enumerate(zip(raster.descriptions, raster.units, strict=True), 1):
        values = raster.band(number)
        known = values[np.isfinite(values)]
        band = f"band {number}"
        yield _row(band, text)
        yield _row(f"{band} type", raster.values.dtype.name)
        yield _row(f"{band} cells without data", values.size - known.size)
        if known.size:
            yield _row(f"{band} minimum", float(known.min()), unit)
            yield _row(f"{band} mean", float(known.mean()), unit)
            yield _row(f"{band} maximum", float(known.max()), unit)


def _vectors(path: Path, ctx: Context, crs: CRS | None) -> Iterator[Row]:
    """Describe one layer or table in full, or list several."""
    names, tables = Vector.layers(path), Table.layers(path)
    if len(names) + len(tables) < 2:
        yield from (
            _rows_of_table(Table.open(path))
            if tables
            else _vector(Vector.open(path, ctx=ctx, assume_crs=crs))
        )
        return
    yield _row("file", path.name)
    yield _row("layers", len(names) + len(tables))
    for index, name in enumerate(names):
        share = index / len(names), (index + 1) / len(names)
        layer = Vector.open(path, layer=name, ctx=ctx.part(*share), assume_crs=crs)
        yield _row(f"layer {name}", _geometry(layer))
        yield _row(f"layer {name} crs", _crs(layer))
        yield _row(f"layer {name} features", len(layer))
    for name in tables:
        yield _row(f"table {name} rows", len(Table.open(path, layer=name)))


def _vector(vector: Vector) -> Iterator[Row]:
    yield _row("file", vector.name)
    yield _row("crs", _crs(vector))
    yield _row("features", len(vector))
    yield _row("geometry", _geometry(vector))
    if np.isfinite(vector.frame.total_bounds).all():
        yield from _bounds(vector.frame.total_bounds)
    yield from _columns(vector.frame.drop(columns=vector.frame.geometry.name))


def _geometry(vector: Vector) -> str:
    """The geometry types that occur; for an empty layer the type that it declares."""
    found = sorted(set(vector.frame.geom_type.dropna()))
    return ", ".join(found) or vector.geometry_type


def _rows_of_table(table: Table) -> Iterator[Row]:
    yield _row("file", table.name)
    yield _row("rows", len(table))
    yield from _columns(table.frame)


def _columns(frame: pd.DataFrame) -> Iterator[Row]:
    for name, column in frame.items():
        yield _row(f"column {name}", str(column.dtype))
