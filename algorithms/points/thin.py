"""Fewer points: one for each cell, or without duplicates.

What becomes of the attributes, why the answer does not depend on order or tiles, and how the
methods differ: docs/explanation/preparing-points.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.points import _thin_kernels as kernels
from algorithms.points._groups import ROUNDING, cells, grouped
from algorithms.shared import parameters
from algorithms.shared.chance import random_keys
from algorithms.shared.ground import is_withheld
from algorithms.shared.lowest import blocks, require_finite
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud
from toolbox.declare import Attribute, Share, outputs, param, sink, source, tool

Method = Literal[
    "grid_average", "first", "lowest", "highest", "random", "nearest_to_centre", "duplicates"
]
MEASURED = ("intensity", "red", "green", "blue", "nir")  # whole numbers whose mean has a meaning

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@tool(
    "points.thin",
    title="Thin points",
    tags=(
        "thin",
        "decimate",
        "sample",
        "voxel",
        "duplicates",
        "reduce",
        "downsample",
    ),
)
class PointsThin:
    """Keep one point for each cell, or one of those that are duplicates.

    Cells are cubes, or with `dimensions` 2 columns, that begin at whole multiples of `cell`. Of the
    points in a cell are kept: `nearest_to_centre`; `lowest` or `highest`; `random` by chance;
    `first` the one with the earliest GPS time. All these stay as they were measured. For about d
    points per square metre take `random` and 2-D cells of 1 / sqrt(d) metres.

    `grid_average` makes a new point at the mean place of all in the cell, which was never
    measured: original coordinates and most attributes are lost, also with cells of 1 cm. The new
    point has the mean of intensity, colours and attributes with decimals; all else, such as class,
    flags, returns and GPS time, is that of the point nearest to the mean. A file rounds the mean
    to its own steps.

    `duplicates` removes points with exactly the same x, y and z as another, and the same values of
    the attributes in `agree`; the one with the earliest GPS time stays.
    """

    points: PointCloud = source("Points to thin")
    method: Method = param(
        "What to keep of each cell",
        default="nearest_to_centre",
        words={
            "grid_average": "Mean of the cell",
            "first": "First in the file",
            "lowest": "Lowest",
            "highest": "Highest",
            "random": "By chance",
            "nearest_to_centre": "Nearest to the centre",
            "duplicates": "Remove duplicates only",
        },
    )
    cell: float = parameters.cell(default=0.01)
    dimensions: Literal[3, 2] = param(
        "Cells are cubes (3) or columns (2)",
        default=3,
        unit="1",
        label="Cells are",
        words={3: "Cubes", 2: "Columns"},
    )
    agree: tuple[Attribute, ...] | None = param(
        "Attributes that duplicates must have in common, besides the position",
        default=None,
        of="points",
        label="Attributes that must agree",
    )
    seed: int = parameters.seed()

    @outputs
    class Outputs:
        thinned: PointCloud = sink("One point for each cell, or none twice", label="Thinned points")
        removed_share: float = sink("Share of points removed", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """`agree` is only given for duplicates."""
        if self.agree and self.method != "duplicates":
            yield "agree", f"is for method duplicates, not for {self.method}"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have GPS times if the first are kept; file order is not time order."""
        if self.method == "first" and "gps_time" not in self.points:
            yield "method", f"first needs gps_time, which {self.points.name} does not have"

    def halo(self) -> float:
        """One cell, which may lie across a tile edge; zero for duplicates, in one position."""
        return 0.0 if self.method == "duplicates" else self.cell * (1 + 10 * ROUNDING)

    def run(self, ctx: Context = QUIET) -> PointsThin.Outputs:
        """Choose the points, or make new ones."""
        cloud = self.points
        require_finite(cloud.xyz)
        groups, size = grouped(self._codes(), ctx=ctx.part(0.0, 0.3))
        if size == len(cloud):  # none shares its cell
            return self._outputs(cloud, np.arange(size))
        if self.method == "grid_average":
            return self._averaged(groups, size, ctx.part(0.3, 1.0))
        kept = best_of(cloud, groups, size, self._key(), ctx=ctx.part(0.3, 1.0))
        return self._outputs(cloud.select(kept), kept)

    def _codes(self) -> Indices:
        """Integers that are equal for points of the same group, array of shape (n, k)."""
        cloud = self.points
        if self.method == "duplicates":
            columns = [column for name in self.agree or () for column in _columns(cloud[name])]
            values = np.column_stack([cloud.xyz, *(column.astype(float) for column in columns)])
            return np.asarray((values + 0.0).view(np.int64))  # + 0.0 turns -0.0 into 0.0
        codes = cells(cloud.xyz[:, : self.dimensions], self.cell)
        withheld = is_withheld(cloud)  # thinned among themselves, as they stand for no others
        return np.column_stack([codes, withheld]) if withheld.any() else codes

    def _key(self) -> Floats:
        """Key by which points are chosen, the lowest first; array of shape (n,)."""
        xyz = self.points.xyz
        if self.method == "nearest_to_centre":
            places = xyz[:, : self.dimensions]
            away = places - (cells(places, self.cell) + 0.5) * self.cell
            return np.asarray((away * away).sum(axis=1))
        if self.method == "random":
            return (random_keys(xyz, self.seed) >> np.uint64(11)).astype(np.float64)
        if self.method in ("lowest", "highest"):
            return xyz[:, 2] if self.method == "lowest" else -xyz[:, 2]
        if "gps_time" not in self.points:
            return np.zeros(len(xyz))
        time = np.asarray(self.points["gps_time"], np.float64)
        return np.where(np.isnan(time), math.inf, time)

    def _averaged(self, groups: Indices, size: int, ctx: Context) -> PointsThin.Outputs:
        """A new point at the mean position of each group."""
        cloud = self.points
        xyz = np.column_stack([mean(groups, size, cloud.xyz[:, axis]) for axis in range(3)])
        ctx.progress(0.3)
        key = np.zeros(len(cloud))
        for axis in range(3):
            key += (cloud.xyz[:, axis] - xyz[groups, axis]) ** 2
        nearest = best_of(cloud, groups, size, key, ctx=ctx.part(0.4, 0.7))
        order = groups[nearest]
        means = {}
        for name in filter(self._has_mean, cloud.names):
            values = [mean(groups, size, column)[order] for column in _columns(cloud[name])]
            made = np.column_stack(values) if cloud[name].ndim > 1 else values[0]
            kind = cloud[name].dtype
            means[name] = (made if kind.kind == "f" else np.rint(made)).astype(kind)
            ctx.progress(0.8)
        made_of = cloud.select(nearest).with_xyz(xyz[order]).with_attributes(means)
        return self._outputs(made_of, nearest)

    def _has_mean(self, name: str) -> bool:
        return name in MEASURED or (self.points[name].dtype.kind == "f" and name != "gps_time")

    def _outputs(self, thinned: PointCloud, kept: Indices) -> PointsThin.Outputs:
        removed = np.ones(len(self.points), bool)
        removed[kept] = False
        share = Share.of_points(removed, self.points.core)
        return self.Outputs(thinned=thinned, removed_share=share)


def best_of(
    cloud: PointCloud, groups: Indices, size: int, key: Floats, *, ctx: Context = QUIET
) -> Indices:
    """Index of the point with the lowest key in each group, sorted; shape (size,).

    Where keys are the same, x, y and z decide, and then all attributes, in the order of their
    names; points that have all this in common are not told apart.
    """
    rank = np.zeros(len(cloud), np.int64)
    best = _lowest(cloud, groups, size, key, rank, ctx.part(0.0, 0.5))
    alike = best[groups]
    tied = (alike != np.arange(len(cloud))) & (key == key[alike])
    tied[tied] = (cloud.xyz[tied] == cloud.xyz[alike[tied]]).all(axis=1)
    if tied.any() and cloud.names:
        tied[alike[tied]] = True
        columns = [c[tied] for name in sorted(cloud.names) for c in _columns(cloud[name])]
        rank[np.flatnonzero(tied)[np.lexsort(columns)]] = np.arange(np.count_nonzero(tied))
        best = _lowest(cloud, groups, size, key, rank, ctx.part(0.5, 1.0))
    ctx.progress(1.0)
    return np.sort(best)


def _lowest(
    cloud: PointCloud, groups: Indices, size: int, key: Floats, rank: Indices, ctx: Context
) -> Indices:
    best = np.full(size, -1, np.int64)
    for first, last in blocks(len(groups)):
        kernels.lowest(first, last, groups, key, cloud.xyz, rank, best)
        ctx.progress(last / len(groups))
    return best


def mean(groups: Indices, size: int, values: NDArray[Any]) -> Floats:
    """Mean of the values, of shape (n,), in each group; NaN where all are NaN.

    The order of the points does not matter.
    """
    high, low, count = np.zeros(size), np.zeros(size), np.zeros(size, np.int64)
    numbers = np.ascontiguousarray(values, np.float64)
    kernels.add(0, len(groups), groups, numbers, high, low, count)
    with np.errstate(invalid="ignore"):
        return np.where(count > 0, (high + low) / count, math.nan)


def _columns(values: NDArray[Any]) -> list[NDArray[Any]]:
    """An attribute of n points as one or more arrays of shape (n,)."""
    return [values] if values.ndim == 1 else list(values.T)
