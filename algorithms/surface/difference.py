"""Difference of two rasters: heights of objects above terrain, or change between surveys."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.heights import infinity_problem
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, Raster
from toolbox.data.crs import crs_conflict
from toolbox.declare import outputs, sink, source, tool

Array = NDArray[np.float64]
ROWS = 512  # subtracted between two looks at whether the user cancelled
ALIGNED = 1e-4  # cells: corners that are this close to whole cells apart lie on one lattice


@tool("surface.difference")
class SurfaceDifference:
    """Subtract one raster from another, cell by cell.

    A surface minus the terrain is the height of objects (nDSM); a later survey minus an earlier
    one is what has changed. Both rasters must have cells of one size that lie on each other, one
    band, and the same CRS and unit of heights; nothing is resampled. The result has the cells of
    the first raster and is empty where one of the two has no value.
    """

    surface: Raster = source("Raster to subtract from")
    base: Raster = source("Raster that is subtracted")

    @outputs
    class Outputs:
        difference: Raster = sink("First raster minus second, empty where one has no value")
        mean: float | None = sink("Mean difference, in the unit of the rasters")
        std: float | None = sink("Standard deviation, in the unit of the rasters")
        lowest: float | None = sink("Lowest difference, in the unit of the rasters")
        highest: float | None = sink("Highest difference, in the unit of the rasters")
        filled_share: float = sink("Share of the cells of the first raster with a value", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """Rasters that cannot be subtracted."""
        one, other = self.surface, self.base
        for name, raster in (("surface", one), ("base", other)):
            if len(raster.values) != 1:
                bands = f"{len(raster.values)} bands; choose one with the option band"
                yield name, f"{_named(raster)} has {bands}"
            elif text := infinity_problem(raster):
                yield name, f"{_named(raster)} {text}"
        if text := crs_conflict(other.crs, one.crs, heights=True):
            yield "base", f"{_named(other)} {text} of {_named(one)}"
        elif one.units[0] and other.units[0] and one.units[0] != other.units[0]:
            units = f"is in {other.units[0]}, {_named(one)} in {one.units[0]}"
            yield "base", f"{_named(other)} {units}; convert one of them first"
        if text := misfit(Lattice.of(one), Lattice.of(other)):
            yield "base", f"{_named(other)} {text} of {_named(one)}"

    def halo(self) -> float:
        """Each cell by itself."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> SurfaceDifference.Outputs:
        """Subtract, and sum up."""
        one, other = self.surface, self.base
        dtype = np.result_type(one.values.dtype, other.values.dtype, np.float32)
        found = difference(one, other, ctx.part(0.0, 0.8)).astype(dtype)
        known = found[np.isfinite(found)].astype(np.float64)
        if not len(known):
            log.warning("no cell has a value in both rasters")
        raster = Raster.from_lattice(
            found,
            Lattice.of(one),
            crs=one.crs,
            descriptions=(" minus ".join(map(_title, (one, other))),),
            units=one.units,
        )
        ctx.progress(1.0)
        return self.Outputs(
            difference=raster,
            mean=float(known.mean()) if len(known) else None,
            std=float(known.std()) if len(known) else None,
            lowest=float(known.min()) if len(known) else None,
            highest=float(known.max()) if len(known) else None,
            filled_share=len(known) / found.size,
        )


def misfit(one: Lattice, other: Lattice) -> str | None:
    """Why cells of the other lattice do not lie on those of the first; continues a sentence."""
    if abs(other.cell - one.cell) * max(one.shape) > ALIGNED * one.cell:
        return f"has cells of {other.cell:g}, not the {one.cell:g}"
    for apart in ((other.west - one.west) / one.cell, (other.north - one.north) / one.cell):
        if abs(apart - round(apart)) > ALIGNED:
            return f"lies {abs(apart - round(apart)):.3g} of a cell beside the cells"
    down, right = offset(one, other)
    rows, cols = one.shape
    if not (-other.rows < down < rows and -other.cols < right < cols):
        return "lies nowhere on the area"
    return None


def offset(one: Lattice, other: Lattice) -> tuple[int, int]:
    """Row and column of the first lattice at which the other begins."""
    down = round((one.north - other.north) / one.cell)
    return down, round((other.west - one.west) / one.cell)


def difference(one: Raster, other: Raster, ctx: Context = QUIET) -> Array:
    """The first raster minus the other on the cells of the first.

    Parameters
    ----------
    one, other : of one band, on aligned cells of one size (see :func:`misfit`)

    Returns
    -------
    array of shape (rows, cols) of the first, NaN where one of the two has no value
    """
    first, second = one.band(), other.band()
    down, right = offset(Lattice.of(one), Lattice.of(other))
    rows, cols = first.shape
    top, bottom = max(0, down), min(rows, down + second.shape[0])
    west, east = max(0, right), min(cols, right + second.shape[1])
    found = np.full(first.shape, np.nan)
    for row in range(top, bottom, ROWS):
        ctx.progress((row - top) / (bottom - top))
        block = slice(row, min(row + ROWS, bottom)), slice(west, east)
        beside = slice(row - down, block[0].stop - down), slice(west - right, east - right)
        found[block] = first[block] - second[beside]
    return found


def _named(raster: Raster) -> str:
    return raster.name or "the raster"


def _title(raster: Raster) -> str:
    return raster.descriptions[0] or _named(raster)
