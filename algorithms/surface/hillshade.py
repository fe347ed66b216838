"""Hillshade: illumination of each cell of a surface by a low sun.

References
----------
Horn, B. K. P. (1981). Hill shading and the reflectance map. Proceedings of the IEEE 69(1), 14-47:
slopes from eight neighbours, and the light on a matt surface.
Mark, R. K. (1992). A multidirectional, oblique-weighted, shaded-relief image of the Island of
Hawaii. USGS Open-File Report 92-422: light from four directions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.heights import heights_problem
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, Raster
from toolbox.declare import outputs, param, sink, source, tool

Array = NDArray[np.float64]
ROWS = 512  # shaded between two checks for cancellation
DIRECTIONS = (-90.0, -45.0, 0.0, 45.0)  # of Mark's four lights, from the middle one
DARK, BRIGHT = 1, 255  # of whole numbers, of which 0 is nodata


@tool(
    "surface.hillshade",
    title="Hillshade",
    tags=(
        "hillshade",
        "shaded",
        "relief",
        "shade",
    ),
)
class SurfaceHillshade:
    """Shade a surface as a low sun would, to look at it.

    The shade is the cosine of the angle between the sun and the upright on the surface, whose
    slope comes from the eight neighbours of a cell (Horn 1981). It is written as whole numbers
    from 1, dark, to 255, lit from straight ahead, with 0 for no data; or with `fraction` as 0 to 1.
    No shadows are cast.

    `multidirectional` takes four lights, 45 degrees apart, so that slopes along one direction
    show as well; each counts most where the slope lies across it (Mark 1992). They stand around
    the azimuth: at 225, 270, 315 and 360 degrees for the default.

    A cell has no shade where it or a neighbour has no value, so the outermost cells of the raster
    are empty. `edges` shades those too and takes the surface to go on straight beyond them.
    """

    surface: Raster = source("Raster of heights")
    azimuth: float = param(
        "Direction from which the light comes, clockwise from north",
        default=315.0,
        unit="deg",
        ge=0,
        le=360,
    )
    altitude: float = param(
        "Height of the sun above the horizon",
        default=45.0,
        unit="deg",
        gt=0,
        le=90,
        label="Height of the sun",
    )
    z_factor: float = param(
        "Exaggeration of the heights",
        default=1.0,
        unit="1",
        gt=0,
        le=1e6,
        label="Exaggeration of heights",
    )
    multidirectional: bool = param(
        "Take light from four directions", default=False, label="Light from four sides"
    )
    edges: bool = param(
        "Shade the outermost cells of the raster too", default=False, label="Shade the edges too"
    )
    fraction: bool = param(
        "Write 0 to 1, not whole numbers from 1 to 255", default=False, label="Values from 0 to 1"
    )

    @outputs
    class Outputs:
        hillshade: Raster = sink("Light on each cell, empty where a neighbour has no value")
        filled_share: float = sink("Share of cells with a value", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The heights are in the unit of the plane."""
        if text := heights_problem(self.surface):
            yield "surface", f"{self.surface.name or 'the raster'} {text}"

    def halo(self) -> float:
        """Infinite, as the reach is one cell, whose size is no parameter."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> SurfaceHillshade.Outputs:
        """Shade, and choose how to write it."""
        heights = self.surface.band()
        light = hillshade(
            heights,
            self.surface.cell,
            azimuth=self.azimuth,
            altitude=self.altitude,
            z_factor=self.z_factor,
            multidirectional=self.multidirectional,
            edges=self.edges,
            ctx=ctx.part(0.0, 0.9),
        )
        known = np.isfinite(light)
        if not known.any():
            log.warning("no cell has a shade: none has eight neighbours with a value")
        if self.fraction:
            values, nodata = light.astype(np.float32), None
        else:
            shades = np.rint(DARK + (BRIGHT - DARK) * light)
            values, nodata = np.where(known, shades, 0).astype(np.uint8), 0.0
        raster = Raster.from_lattice(
            values,
            Lattice.of(self.surface),
            crs=self.surface.crs,
            nodata=nodata,
            descriptions=("hillshade",),
            units=("1",),
        )
        ctx.progress(1.0)
        return self.Outputs(hillshade=raster, filled_share=float(known.mean()))


def hillshade(
    heights: Array,
    cell: float,
    *,
    azimuth: float = 315.0,
    altitude: float = 45.0,
    z_factor: float = 1.0,
    multidirectional: bool = False,
    edges: bool = False,
    ctx: Context = QUIET,
) -> Array:
    """Illumination of each cell, from its slope and aspect.

    Parameters
    ----------
    heights : array of shape (rows, cols), NaN where not known, the northernmost row first
    cell : size of a cell, in the unit of the heights
    azimuth, altitude : of the sun, in degrees; with `multidirectional` of the third of four lights
    edges : whether to continue the surface straight beyond the outermost cells

    Returns
    -------
    array of shape (rows, cols)
        From 0, turned away, to 1, straight towards the light; NaN where a neighbour is not known.
    """
    light: Array = np.full(heights.shape, np.nan)
    known = continued(heights) if edges else heights
    edge = 0 if edges else 1
    inside = light[edge : len(light) - edge, edge : light.shape[1] - edge]
    for top in range(0, len(inside) if inside.size else 0, ROWS):
        ctx.progress(top / len(inside))
        east, north = slopes(known[top : top + ROWS + 2], cell / z_factor)
        if multidirectional:
            shade = from_all_sides(east, north, azimuth, altitude)
        else:
            shade = from_one_side(east, north, azimuth, altitude)
        inside[top : top + ROWS] = shade
    ctx.progress(1.0)
    return light


def slopes(heights: Array, cell: float) -> tuple[Array, Array]:
    """Slopes to the east and to the north, as rise per unit of length: equation 16 of Horn (1981).

    Parameters
    ----------
    heights : array of shape (rows + 2, cols + 2), the northernmost row first

    Returns
    -------
    two arrays of shape (rows, cols), NaN where one of the nine heights is
    """
    down = heights[:-2] + 2 * heights[1:-1] + heights[2:]
    across = heights[:, :-2] + 2 * heights[:, 1:-1] + heights[:, 2:]
    centre = 0 * heights[1:-1, 1:-1]  # the formula leaves it out; unknown, it has no slope
    east = (down[:, 2:] - down[:, :-2]) / (8 * cell) + centre
    return east, (across[:-2] - across[2:]) / (8 * cell) + centre


def from_one_side(east: Array, north: Array, azimuth: float, altitude: float) -> Array:
    """Illumination by one light: the cosine of its angle with the normal, 0 where turned away."""
    towards, height = math.radians(azimuth), math.radians(altitude)
    falls = -(east * math.sin(towards) + north * math.cos(towards))
    light = math.sin(height) + math.cos(height) * falls
    light /= np.sqrt(1 + east**2 + north**2)
    return np.maximum(light, 0)


def from_all_sides(east: Array, north: Array, azimuth: float, altitude: float) -> Array:
    """Mean illumination by four lights, weighted by the squared sine of their angles to the aspect.

    These add up to 2. Where the ground is flat all lights are alike. gdaldem takes the square of
    the cosine, so that its four lights are strongest along the slope.
    """
    total, steepness = np.zeros_like(east), np.hypot(east, north)
    flat = steepness == 0
    for turned in DIRECTIONS:
        towards = math.radians(azimuth + turned)
        across = east * math.cos(towards) - north * math.sin(towards)
        sine = across / np.where(flat, 1, steepness)
        weight = np.where(flat, 0.5, sine**2)
        total += weight * from_one_side(east, north, azimuth + turned, altitude)
    return total / 2


def continued(heights: Array) -> Array:
    """The raster with one row and column more on each side, extrapolated linearly."""
    if min(heights.shape) < 2:
        return np.pad(heights, 1, constant_values=np.nan)
    wide = np.pad(heights, 1)
    wide[0], wide[-1] = 2 * wide[1] - wide[2], 2 * wide[-2] - wide[-3]
    wide[:, 0], wide[:, -1] = 2 * wide[:, 1] - wide[:, 2], 2 * wide[:, -2] - wide[:, -3]
    return wide
