"""Values of a raster at the points: attributes, or the colours of an image."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Raster
from toolbox.declare import outputs, param, sink, source, tool

LONGEST = 32  # bytes of a name in LAS
BLOCK = 1_000_000  # points between two reports of progress
COLOURS = ("red", "green", "blue", "nir")
EIGHT_BITS = 257  # by which 255 becomes 65535, as LAS has colours

Floats = NDArray[np.float64]


@tool(
    "points.sample_raster",
    title="Sample raster at points",
    tags=(
        "colour",
        "colorize",
        "rgb",
        "nir",
        "orthophoto",
        "extract-values",
        "drape",
    ),
)
class PointsSampleRaster:
    """Give points the values that a raster has at their place.

    As attributes, each band becomes one, named like the band, or like the raster with a number;
    points beside the raster or in a cell without a value have NaN. As `colour`, three bands are
    red, green and blue, a fourth is near infrared; bands of 8 bits are stretched to the 16 bits of
    LAS, and points without a value keep the colour they have, or 0.

    The place in plan counts, heights do not: what stands under a tree gets the colour of the tree.
    """

    points: PointCloud = source("Points that get the values")
    raster: Raster = source("Raster to take values from")
    bands: tuple[int, ...] | None = param(
        "Numbers of the bands, counted from 1; all by default",
        default=None,
        unit="1",
        ge=1,
        of="raster",
    )
    method: Literal["nearest", "linear"] = param(
        "Value of the cell that holds a point, or mean of the four around it", default="nearest"
    )
    store: Literal["attributes", "colour"] = param(
        "Store values as attributes, or as colours", default="attributes"
    )
    names: tuple[str, ...] | None = param(
        "Names of the attributes, one for each band", default=None
    )

    @outputs
    class Outputs:
        sampled: PointCloud = sink("The same points with the values")
        without_value: int = sink("Points that got no value from some band", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """Colours have names already."""
        if self.names and self.store == "colour":
            yield "names", "are for attributes; colours are red, green, blue and nir"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """There are such bands, and their names can be attributes."""
        count, numbers = len(self.raster.values), self._numbers()
        if numbers and max(numbers) > count:
            yield "bands", f"{self.raster.name} has bands 1 to {count}, not {max(numbers)}"
            return
        if self.store == "colour":
            if len(numbers) not in (3, 4):
                yield "bands", f"colours are three or four bands, and there are {len(numbers)}"
            elif self.raster.values.dtype.name not in ("uint8", "uint16"):
                kind = self.raster.values.dtype
                yield "raster", f"{self.raster.name} holds {kind}; colours have 8 or 16 bits"
            return
        names = self._names()
        if len(names) != len(numbers):
            yield "names", f"{len(names)} names for {len(numbers)} bands"
        for name in names:
            if name in PointCloud.OF_LAS or not 0 < len(name.encode()) <= LONGEST:
                yield "names", f"{name!r} is an attribute of LAS, or too long; give other names"
        if len(set(names)) < len(names):
            yield "names", f"must differ, got {', '.join(names)}"

    def halo(self) -> float:
        """Zero, as each point is looked at by itself."""
        return 0.0

    def _numbers(self) -> tuple[int, ...]:
        return self.bands or tuple(range(1, len(self.raster.values) + 1))

    def _names(self) -> tuple[str, ...]:
        """Names of the attributes."""
        return self.names or tuple(_name(self.raster, number) for number in self._numbers())

    def run(self, ctx: Context = QUIET) -> PointsSampleRaster.Outputs:
        """Sample each band."""
        cloud, raster, numbers = self.points, self.raster, self._numbers()
        columns = sampled(cloud.xyz, raster, numbers, self.method, ctx=ctx)
        lost = np.isnan(columns).any(axis=0)
        count = int(np.count_nonzero(lost & cloud.core))
        if len(cloud) and lost.all() and cloud.origin is None:
            log.warning("no point lies on a cell of %s with a value", raster.name)
        if self.store == "colour":
            made = _coloured(cloud, columns, raster.values.dtype)
            return self.Outputs(sampled=made, without_value=count)
        kind = np.float32 if raster.values.dtype.itemsize <= 4 else np.float64
        units = [raster.units[number - 1] for number in numbers]
        found = cloud.with_attributes(
            dict(zip(self._names(), columns.astype(kind), strict=True)),
            descriptions={
                name: f"of {raster.name}"[:LONGEST] if not unit else f"of a raster, {unit}"
                for name, unit in zip(self._names(), units, strict=True)
            },
        )
        return self.Outputs(sampled=found, without_value=count)


def sampled(
    xyz: Floats,
    raster: Raster,
    bands: tuple[int, ...],
    method: Literal["nearest", "linear"] = "nearest",
    *,
    ctx: Context = QUIET,
) -> Floats:
    """Values of bands, counted from 1, at points of shape (n, 3): an array of shape (bands, n).

    NaN where a point is beside the raster, or a cell that it needs has no value.
    """
    found = np.empty((len(bands), len(xyz)))
    ctx.progress(0.0)
    for row, band in enumerate(bands):
        take = raster.sampler(band, method=method)
        for start in range(0, len(xyz), BLOCK):
            part = slice(start, start + BLOCK)
            found[row, part] = take(xyz[part, 0], xyz[part, 1])
            ctx.progress((row + min(1.0, (start + BLOCK) / len(xyz))) / len(bands))
    ctx.progress(1.0)
    return found


def _coloured(cloud: PointCloud, columns: Floats, kind: np.dtype[np.generic]) -> PointCloud:
    """The points with colours of 16 bits, where a colour is known."""
    factor = EIGHT_BITS if kind.itemsize == 1 else 1
    colours = {}
    for name, values in zip(COLOURS, columns, strict=False):
        known = ~np.isnan(values)
        before = cloud[name] if name in cloud else np.zeros(len(cloud), np.uint16)
        made = np.array(before, np.uint16)
        made[known] = np.rint(values[known] * factor).astype(np.uint16)
        colours[name] = made
    return cloud.with_attributes(colours)


def _name(raster: Raster, number: int) -> str:
    """A name for a band as an attribute: of letters, numbers and underscores."""
    text = raster.descriptions[number - 1] or f"{raster.name.partition('.')[0] or 'band'}_{number}"
    return re.sub(r"\W+", "_", text).strip("_")[:LONGEST] or f"band_{number}"
