"""Rasters brought to another CRS, each new cell taking its value from where its centre was.

Which operation is taken, and what is refused: docs/explanation/reference-systems.md.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.shared import parameters
from algorithms.shared.reprojection import chosen, operation_table
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, Raster, Table
from toolbox.data.crs import length_problem, metres_per_height, vertical_unit
from toolbox.data.operation import MissingGrid, Operation, plane
from toolbox.data.reprojecting import unit_of_plan
from toolbox.declare import DataFile, outputs, param, sink, source, tool
from toolbox.errors import DataError

ROWS = 256  # rows of the result that are made at a time
EDGE = 21  # places along an edge of the raster by which its new bounds are found

Method = Literal["linear", "nearest"]
Meaning = Literal["elevations", "lengths", "other"]
Floats = NDArray[np.float64]


@tool(
    "surface.reproject",
    title="Reproject raster",
    tags=(
        "reproject",
        "warp",
        "crs",
        "resample",
        "gdalwarp",
        "geoid",
        "epsg",
    ),
)
class SurfaceReproject:
    """Reproject a raster.

    The centre of each new cell is brought back to the raster, where `linear` takes the mean of the
    four cells around it by their distance, and `nearest` the cell that holds it, which keeps
    classes and integers as they are. Nothing is averaged over more cells: make a raster coarser
    before. New cells lie on whole multiples of their size.

    The operation is chosen as in points.reproject. Where it changes heights, say what the `values`
    are: elevations are moved, lengths (as heights of objects) change their unit alone, others stay.
    """

    surface: Raster = source("Raster to reproject", any_crs=True)
    crs: CRS = parameters.target_crs()
    cell: float | None = param(
        "Size of a new cell; without it, that of the old ones",
        default=None,
        unit="m",
        gt=0,
        le=10_000,
        label="Cell size",
    )
    method: Method = param("How a new cell gets its value", default="linear")
    values: Meaning | None = param("What the values are, if heights change", default=None)
    geoid: DataFile | None = parameters.geoid()
    epoch: float | None = parameters.epoch()
    missing_grid: MissingGrid = parameters.missing_grid()

    @outputs
    class Outputs:
        reprojected: Raster = sink("The raster in the new CRS")
        operation: Table = sink("What was done: property, value, unit")

    def check(self) -> Iterator[tuple[str, str]]:
        """A geoid is for elevations."""
        if self.geoid and self.values not in (None, "elevations"):
            yield "geoid", f"is for elevations, and values are {self.values}"

    def halo(self) -> float:
        """Zero; a raster comes whole."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> SurfaceReproject.Outputs:
        """Choose the operation, lay the new cells, and fill them."""
        ctx.progress(0.0)
        raster = self.surface
        way = chosen(
            "surface",
            raster,
            self.crs,
            heights=self.values != "other",
            geoid=self.geoid,
            epoch=self.epoch,
            missing_grid=self.missing_grid,
        )
        if way.moves_heights and self.values is None:
            text = "heights change by this operation; say whether the values are elevations,"
            raise DataError(f"values: {text} lengths or other, so that they are not left wrong")
        lattice = cells_of(raster, way, self._cell(raster, way))
        found = resampled(raster, way, lattice, self.method, self.values, ctx=ctx.part(0.1, 1.0))
        return self.Outputs(reprojected=found, operation=operation_table(way, self.geoid))

    def _cell(self, raster: Raster, way: Operation) -> float | None:
        """The size that is asked for, in the unit of the target."""
        if self.cell is None:
            return None
        metric = length_problem(raster.crs) is None
        return self.cell / (raster.metre if metric else 1.0) / unit_of_plan(way.target)


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
