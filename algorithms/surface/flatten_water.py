"""Terrain with level water: hydro-flattening.

References
----------
USGS (2024). Lidar Base Specification 2024 rev. A, hydro-flattening: water bodies are flat and
level, with the water surface at or just below the immediately surrounding terrain.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shared.heights import heights_problem
from algorithms.shared.polygons import cells_within, polygons
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, Raster, Vector
from toolbox.declare import outputs, param, sink, source, tool
from toolbox.errors import DataError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
LEVEL = "level"  # attribute of a polygon of water


@tool(
    "surface.flatten_water",
    title="Flatten water",
    tags=("hydro-flattening", "water", "lake", "dtm", "level", "breakline", "shore"),
)
class SurfaceFlattenWater:
    """Lay water level into a terrain, with no shore lower than the water.

    Cells whose centre is in a polygon of water get its level: that of the attribute `level`, or of
    a `level` that is given for all. Cells beyond the shore that are joined to it over lower ground
    are raised to the level as far as `shore` from the water, so that noise and the spacing of
    points leave no ditch around a lake; what lies lower farther away, such as the land below a dam,
    stays. How many cells were raised, and by how much at most, is told.
    """

    terrain: Raster = source("Raster of heights of the ground")
    water: Vector = source("Polygons of water")
    level: float | None = param(
        "Level of all water, in place of the attribute level of the polygons",
        default=None,
        unit="m",
        label="Level of the water",
    )
    shore: float = param(
        "How far from the water lower ground is raised to its level",
        default=5.0,
        unit="m",
        ge=0,
        le=100,
        label="Width of the shore",
    )

    @outputs
    class Outputs:
        flattened: Raster = sink("The terrain with level water", label="Flattened terrain")
        raised: int = sink("Cells of the shore that were raised", unit="1", label="Raised cells")
        largest_raise: float = sink("By how much at most", unit="m", label="Largest raise")
        bodies: int = sink("Water bodies laid level", unit="1", label="Water bodies")

        def in_words(self) -> str:
            """What was done to the shore."""
            if not self.bodies:
                return "No water lies on the terrain: it is as it was."
            if not self.raised:
                return "The water is level, and no ground at its shore lies lower."
            return (
                f"The water is level; {self.raised} cells of the shore were lower, and raised to "
                f"it by at most {self.largest_raise:.2f} m."
            )

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The raster holds heights, and the level is known."""
        if text := heights_problem(self.terrain):
            yield "terrain", f"{self.terrain.name or 'the raster'} {text}"
        if self.level is None and len(self.water) and LEVEL not in self.water.names:
            yield (
                "level",
                f"must be given, as {self.water.name or 'the water'} has no attribute level",
            )

    def halo(self) -> float:
        """Infinite, as ground may be joined to the shore along any way."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> SurfaceFlattenWater.Outputs:
        """Fill body by body."""
        heights = self.terrain.band().copy()
        before = heights.copy()
        lattice = Lattice.of(self.terrain)
        reach = math.ceil(self.shore / lattice.cell)
        wet = np.zeros(heights.shape, bool)
        bodies = list(self._bodies())
        level_bodies = 0
        for number, (shape, level) in enumerate(bodies):
            ctx.progress(number / len(bodies))
            inside = np.zeros(heights.shape, bool)
            inside[cells_within(shape, lattice)] = True
            level_bodies += bool(inside.any())
            lower = shore_below(heights, inside, level, reach)
            heights[inside | lower] = level
            wet |= inside
        raised = (heights != before) & ~wet & np.isfinite(before)
        most = float(np.max((heights - before)[raised], initial=0.0))
        if not bodies:
            log.warning("there is no water to flatten")
        elif apart := len(bodies) - level_bodies:
            log.warning("%d of %d bodies of water hold no cell of the terrain", apart, len(bodies))
        return self.Outputs(
            flattened=Raster.from_lattice(
                heights.astype(np.float32),
                lattice,
                crs=self.terrain.crs,
                descriptions=("terrain",),
                units=self.terrain.units[:1],
            ),
            raised=int(np.count_nonzero(raised)),
            largest_raise=most,
            bodies=level_bodies,
        )

    def _bodies(self) -> Iterator[tuple[shapely.Polygon, float]]:
        """The polygons with the level of each, in the unit of the heights."""
        frame = self.water.frame
        for number in range(len(frame)):
            level = self.level if self.level is not None else float(frame[LEVEL].iloc[number])
            if not math.isfinite(level):
                raise DataError("surface.flatten_water", {"water": "a polygon has no level"})
            one = Vector(frame.iloc[[number]], name=self.water.name)
            for shape in polygons(one, "water"):
                yield shape, level


def shore_below(heights: Array, water: Mask, level: float, reach: int) -> Mask:
    """The cells outside the water that lie lower than it and are joined to it within some cells.

    Parameters
    ----------
    heights : array of shape (rows, cols), NaN where not known
    water : its cells
    reach : cells from the water that are looked at
    """
    from scipy.ndimage import binary_dilation

    lower = (heights < level) & ~water
    eight = np.ones((3, 3), bool)
    return (
        binary_dilation(water, eight, iterations=reach, mask=water | lower) & lower
        if reach
        else lower & False
    )
