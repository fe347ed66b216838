"""Rasters brought to another CRS, each new cell taking its value from where its centre was."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.context import QUIET, Context, log
from toolbox.data.crs import describe_crs, metres_per_height, vertical_unit
from toolbox.data.lattice import Lattice
from toolbox.data.operation import Operation, operation, plane
from toolbox.data.raster import Raster
from toolbox.data.reprojecting import unit_of_plan
from toolbox.errors import DataError

ROWS = 256  # rows of the result that are made at a time
EDGE = 21  # places along an edge of the raster by which its new bounds are found

Method = Literal["linear", "nearest"]
Meaning = Literal["elevations", "lengths", "other"]
Floats = NDArray[np.float64]


def on_the_way(raster: Raster, wanted: CRS, *, ctx: Context = QUIET) -> Raster:
    """A raster as surface.reproject makes it, where nothing need be asked.

    Integers, such as classes, keep their values, each that of the cell it lies in; floats are
    interpolated. Heights are not looked at in integers, and stay as they are in floats.

    Raises
    ------
    DataError
        There is no such operation, or it changes heights: then it must be said what values are.
    """
    whole = raster.values.dtype.kind != "f"
    try:
        target = plane(wanted) if whole else wanted
        way = operation(raster.crs, target, raster.bounds, heights=not whole)
    except DataError as error:
        raise DataError(f"{raster.name}: {error}") from error
    if way.moves_heights:
        raise DataError(
            f"{raster.name}: its heights change on the way to {describe_crs(way.target)}; "
            "surface.reproject does that, told by --values what its values are"
        )
    log.info("%s: %s", raster.name, way)
    method: Method = "nearest" if whole else "linear"
    return resampled(raster, way, cells_of(raster, way, None), method, ctx=ctx)


def cells_of(raster: Raster, way: Operation, cell: float | None) -> Lattice:
    """The cells of the target that cover a raster.

    Parameters
    ----------
    cell : size in the unit of the target; without it the length of the old cells, and of or to
        degrees their size in the middle of the raster, rounded to two digits
    """
    if cell is None:
        units = [unit_of_plan(crs) for crs in (way.source, way.target)]
        if any(plane(crs).is_geographic for crs in (way.source, way.target)):
            cell = float(f"{_size_there(raster, way):.1e}")
        else:
            cell = float(f"{raster.cell * units[0] / units[1]:.12g}")
        log.info("cells of %g become cells of %g", raster.cell, cell)
    xmin, ymin, xmax, ymax = raster.bounds
    along = np.linspace(0, 1, EDGE)
    x, y = xmin + along * (xmax - xmin), ymin + along * (ymax - ymin)
    ends = np.ones(EDGE)
    edge = np.column_stack(
        [
            np.concatenate([x, x, ends * xmin, ends * xmax]),
            np.concatenate([ends * ymin, ends * ymax, y, y]),
        ]
    )
    there = way.transform(edge)
    return Lattice.cover((*there.min(axis=0), *there.max(axis=0)), cell)


def _size_there(raster: Raster, way: Operation) -> float:
    """Mean length of the sides of the middle cell in the target."""
    xmin, ymin, xmax, ymax = raster.bounds
    middle = np.array([(xmin + xmax) / 2, (ymin + ymax) / 2])
    corners = way.transform(middle + raster.cell * np.array([[0, 0], [1, 0], [0, 1]]))
    sides = np.hypot(*(corners[1:] - corners[0]).T)
    return float(math.sqrt(sides.prod()))


def resampled(
    raster: Raster,
    way: Operation,
    lattice: Lattice,
    method: Method = "linear",
    values: Meaning | None = None,
    *,
    ctx: Context = QUIET,
) -> Raster:
    """A raster on the cells of a lattice in the target of an operation.

    Parameters
    ----------
    method : of taking a value
    values : what the values are; elevations change with heights

    Examples
    --------
    >>> from toolbox.data.operation import operation
    >>> lattice = Lattice(500_000, 4_600_100, 10.0, 10, 10)
    >>> raster = Raster.from_lattice(np.full((10, 10), 7.0), lattice, crs=CRS(32635))
    >>> way = operation(raster.crs, CRS(32636), raster.bounds)
    >>> there = resampled(raster, way, cells_of(raster, way, None))
    >>> there.cell, np.unique(there.band().round(9)).tolist()
    (10.0, [7.0, nan])
    """
    x, y = lattice.centres()
    bands = [
        raster.sampler(band, method="nearest" if method == "nearest" else "linear")
        for band in range(1, len(raster.values) + 1)
    ]
    found = np.empty((len(bands), *lattice.shape), _dtype(raster, method))
    holes = np.zeros((len(bands), *lattice.shape), bool)
    for top in range(0, lattice.rows, ROWS):
        ctx.progress(top / lattice.rows)
        rows = y[top : top + ROWS]
        there = np.column_stack([np.tile(x, len(rows)), np.repeat(rows, len(x))])
        here = way.transform(there, back=True, strict=False)
        inside = np.isfinite(here).all(axis=1)
        here[~inside] = np.inf
        for number, take in enumerate(bands):
            block = np.full(len(here), np.nan)
            block[inside] = take(*here[inside].T)
            cells = _valued(block, here, way, values).reshape(len(rows), -1)
            holes[number, top : top + ROWS] = np.isnan(cells)
            kept = np.where(np.isnan(cells), 0, cells) if found.dtype.kind != "f" else cells
            found[number, top : top + ROWS] = kept
    made, nodata = _with_nodata(found, holes, raster.nodata)
    ctx.progress(1.0)
    return dataclasses.replace(
        raster,
        values=made,
        transform=lattice.transform,
        crs=way.target,
        nodata=nodata,
        units=_units(raster, way, values),
    )


def _dtype(raster: Raster, method: Method) -> np.dtype[Any]:
    """Classes stay integers; means of integers are floats."""
    if method == "nearest" or raster.values.dtype.kind == "f":
        return raster.values.dtype
    return np.dtype(np.float32)


def _valued(block: Floats, here: Floats, way: Operation, values: Meaning | None) -> Floats:
    """The values of cells as they are in the target, given where their centres were."""
    if not way.moves_heights or values in (None, "other"):
        return block
    if values == "lengths":
        return block * (metres_per_height(way.source) / metres_per_height(way.target))
    known = ~np.isnan(block)
    moved = block.copy()
    moved[known] = way.transform(np.column_stack([here[known], block[known]]))[:, 2]
    return moved


def _with_nodata(
    found: NDArray[Any], holes: NDArray[np.bool_], nodata: float | None
) -> tuple[NDArray[Any], float | None]:
    """The values with a mark in the cells that have none: a value that no other cell has."""
    if found.dtype.kind == "f" or not holes.any():
        return found, nodata
    limits = np.iinfo(found.dtype)
    tried = [int(limits.max), int(limits.min)] if nodata is None else [int(nodata)]
    free = [value for value in tried if not (found[~holes] == value).any()]
    if not free:
        log.info("no integer is left to mark cells without a value; they become floats")
        return np.where(holes, np.nan, found).astype(np.float32), None
    found[holes] = free[0]
    return found, free[0]


def _units(raster: Raster, way: Operation, values: Meaning | None) -> tuple[str, ...]:
    """The units of the bands, which change with heights."""
    if not way.moves_heights or values in (None, "other"):
        return raster.units
    unit = vertical_unit(way.target) or "metre"
    return tuple(unit if text else "" for text in raster.units)
