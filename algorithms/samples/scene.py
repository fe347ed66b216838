"""Synthetic surveys with ground truth: for demonstrations, tests and benchmarks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import geopandas
from pyproj import CRS

from algorithms.samples._corridor.classic import corridor, power_lines
from algorithms.samples._corridor.preset_scene import preset_scene
from algorithms.samples._corridor.presets import PRESETS, Name
from algorithms.samples._facade import facade
from algorithms.samples._reservoir import reservoir
from algorithms.samples._survey import NOISE, SceneData
from algorithms.samples._town import town
from algorithms.shared import parameters
from toolbox.context import QUIET, Context
from toolbox.data import Lattice, PointCloud, Raster, Vector
from toolbox.data.crs import length_problem, metres_per_unit
from toolbox.declare import outputs, param, show, sink, tool
from toolbox.errors import ParameterError

SIZE, DENSITY = 200.0, 8.0  # m, points per square metre
MOST_POINTS = 1e8  # 20 GB while they are made
KINDS = {
    "town": town,
    "corridor": corridor,
    "power_lines": power_lines,
    "reservoir": reservoir,
    "facade": facade,
}


@tool(
    "samples.scene",
    title="Make a sample survey",
    tags=(
        "sample",
        "example",
        "synthetic",
        "demo",
        "test",
        "data",
    ),
)
class SamplesScene:
    """Make a small synthetic survey with known truth.

    Every point knows its true class, and further attributes name the object, wire, span, tower or
    plane it belongs to, 0 for none. The terrain is the true ground without noise; the features are
    building outlines (town), wires and towers (corridor, and power_lines, where the seed decides on
    their size), water bodies (reservoir), or planes and
    openings (facade), all in three dimensions. The same seed gives the same survey.

    A corridor has presets: lines of many kinds in many lands and surveys, some of them worse than
    one would wish, and scenes without a line (no_line_...) but with what looks like one. Their
    features are wires as far as they were surveyed, once for each wind that moved them by 0.1 m or
    more, the points where these are attached, towers with their type, houses, trees and what is no
    line.
    """

    kind: Literal["town", "corridor", "power_lines", "reservoir", "facade"] = param(
        "What the survey shows",
        default="town",
        label="What the survey shows",
        words={
            "town": "Town",
            "corridor": "Power line",
            "power_lines": "Several power lines",
            "reservoir": "Reservoir",
            "facade": "House front",
        },
    )
    preset: Name | None = param(
        "For a corridor: which of those with a name; it has its own size and density", default=None
    )
    size: float = param("Side, or length of a corridor", default=SIZE, unit="m", ge=20, le=5000)
    density: float = param(
        "Points per square metre, on the wall for a facade",
        default=DENSITY,
        unit="1/m2",
        ge=0.1,
        le=1000,
    )
    noise: float = param(
        "Standard deviation of the ranges of a scanner, for a facade",
        default=0.004,
        unit="m",
        ge=0,
        le=0.1,
    )
    facade_relief: float = param(
        "How far pilasters stand before the wall of a facade; 0 for a plain house",
        default=0.0,
        unit="m",
        ge=0,
        le=1,
        label="Relief of the façade",
    )
    water_noise: float = param(
        "Standard deviation of points on the water of a reservoir, with its waves",
        default=NOISE,
        unit="m",
        ge=0,
        le=0.3,
        label="Noise of water",
    )
    seed: int = parameters.seed()
    crs: CRS = param("Projected CRS in metres to place the survey in", default=CRS(32635))

    @outputs
    class Outputs:
        points: PointCloud = sink(
            "The survey, with true classes", show=show.Planes("plane_id", optional=True)
        )
        terrain: Raster = sink("True elevation of the ground, also below water and buildings")
        features: Vector = sink(
            "True outlines, wires, water bodies or planes", show=show.Classes("kind")
        )

    def check(self) -> Iterator[tuple[str, str]]:
        """The coordinate reference system is in metres, and the points are not too many."""
        if problem := length_problem(self.crs):
            yield "crs", problem
        elif metres_per_unit(self.crs) != 1.0:
            yield "crs", f"must be in metres, got {self.crs.name}"
        if self.preset and self.kind != "corridor":
            yield "preset", f"is for the kind 'corridor', got kind {self.kind!r}"
        elif self.preset:
            for name, default in (("size", SIZE), ("density", DENSITY)):
                if (value := getattr(self, name)) != default:
                    yield name, f"is that of the preset; leave it out, got {value:g}"
        wanted = self.density * self.size**2
        if self.kind in ("town", "reservoir") and wanted > MOST_POINTS:
            yield "size", f"with this density makes {wanted:.2g} points; at most {MOST_POINTS:.2g}"

    def run(self, ctx: Context = QUIET) -> SamplesScene.Outputs:
        """Make the survey and its layers."""
        made = scene(
            self.kind,
            preset=self.preset,
            size=self.size,
            density=self.density,
            seed=self.seed,
            noise=self.noise,
            relief=self.facade_relief,
            water_noise=self.water_noise,
            ctx=ctx,
        )
        heights, west, north, cell = made.terrain
        lattice = Lattice(west, north, cell, *heights.shape)
        terrain = Raster.from_lattice(
            heights, lattice, crs=self.crs, descriptions=("true ground",), units=("metre",)
        )
        frame = geopandas.GeoDataFrame(
            [properties for _, properties in made.features],
            geometry=[geometry for geometry, _ in made.features],
            crs=self.crs,
        )
        return self.Outputs(
            points=PointCloud(made.xyz, made.attributes, crs=self.crs),
            terrain=terrain,
            features=Vector(frame),
        )


def scene(
    kind: str,
    *,
    seed: int,
    size: float = SIZE,
    density: float = DENSITY,
    preset: Name | None = None,
    noise: float = 0.004,
    relief: float = 0.0,
    water_noise: float = NOISE,
    ctx: Context = QUIET,
) -> SceneData:
    """A synthetic survey as a LAS file would hold it, and its ground truth.

    Parameters
    ----------
    kind : town, corridor, power_lines, reservoir or facade
    size : side of the square, length of the corridor or of the house front, metres
    density : points per square metre of the scene, for a facade of wall in sight
    seed : the same seed gives the same scene
    preset : of a corridor, which then has its own size and density
    noise : standard deviation of the ranges of the scanner of a facade, metres
    relief : how far pilasters stand before the wall of a facade, metres
    water_noise : standard deviation of points on the water of a reservoir, metres

    Returns
    -------
    SceneData
        Points with classes, returns and identifiers of the objects that they lie on; the ground
        without noise; the objects as 3-D shapes: polygons, for a corridor lines.

    Raises
    ------
    ParameterError
        No such kind.
    """
    if kind not in KINDS:
        raise ParameterError("scene", {"kind": f"must be one of {', '.join(KINDS)}, got {kind!r}"})
    if preset is not None:
        return preset_scene(PRESETS[preset], seed, ctx)
    noises = {
        "facade": {"noise": noise, "relief": relief},
        "reservoir": {"water_noise": water_noise},
    }
    more = noises.get(kind, {})
    return KINDS[kind](size=size, density=density, seed=seed, ctx=ctx, **more)
