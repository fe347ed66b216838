"""Difference of two rasters: heights of objects above terrain, or change between surveys."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from algorithms.shared.alignment import difference, misfit
from algorithms.shared.heights import infinity_problem
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, Raster
from toolbox.data.crs import crs_conflict
from toolbox.declare import Memory, outputs, sink, source, tool


@tool(
    "surface.difference",
    title="Difference of rasters",
    tags=(
        "difference",
        "subtract",
        "dod",
        "change",
        "ndsm",
        "chm",
        "volume",
    ),
)
class SurfaceDifference:
    """Subtract one raster from another, cell by cell.

    A surface minus the terrain is the height of objects (nDSM); a later survey minus an earlier
    one is what has changed. Both rasters must have cells of one size that lie on each other, one
    band, and the same CRS and unit of heights; nothing is resampled. The result has the cells of
    the first raster and is empty where one of the two has no value.
    """

    surface: Raster = source("Raster to subtract from")
    base: Raster = source("Raster that is subtracted")

    memory = Memory(point=200.0, area=200.0)  # as surface.grid, whose rasters it takes

    @outputs
    class Outputs:
        difference: Raster = sink("First raster minus second, empty where one has no value")
        mean: float | None = sink("Mean difference, in the unit of the rasters")
        std: float | None = sink(
            "Standard deviation, in the unit of the rasters", label="Standard deviation"
        )
        lowest: float | None = sink(
            "Lowest difference, in the unit of the rasters", label="Lowest difference"
        )
        highest: float | None = sink(
            "Highest difference, in the unit of the rasters", label="Highest difference"
        )
        filled_share: float = sink("Share of the cells of the first raster with a value", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The rasters can be subtracted."""
        one, other = self.surface, self.base
        for name, raster in (("surface", one), ("base", other)):
            if len(raster.values) != 1:
                bands = f"{len(raster.values)} bands; choose one with the option band"
                yield name, f"{_named(raster)} has {bands}"
            elif text := infinity_problem(raster):
                yield name, f"{_named(raster)} {text}"
        if text := crs_conflict(other.crs, one.crs, heights=True, tools="surface"):
            yield "base", f"{_named(other)} {text} of {_named(one)}"
        elif one.units[0] and other.units[0] and one.units[0] != other.units[0]:
            units = f"is in {other.units[0]}, {_named(one)} in {one.units[0]}"
            yield "base", f"{_named(other)} {units}; convert one of them first"
        if text := misfit(Lattice.of(one), Lattice.of(other)):
            yield "base", f"{_named(other)} {text} of {_named(one)}"

    def halo(self) -> float:
        """Zero, as each cell is computed by itself."""
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


def _named(raster: Raster) -> str:
    return raster.name or "the raster"


def _title(raster: Raster) -> str:
    return raster.descriptions[0] or _named(raster)
