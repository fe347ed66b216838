"""Values at the cells of a lattice from values at points, by each method of surface.grid."""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple, cast, get_args

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.places import averaged
from algorithms.surface import _near as near
from algorithms.surface._centre_triangles import linear
from algorithms.surface._statistics import Statistic, per_cell
from algorithms.surface._tin import Tin
from toolbox.context import QUIET, Context
from toolbox.data import Lattice
from toolbox.errors import DataError

Method = Literal["linear", "natural", "cubic", "idw", "nearest"] | Statistic
STATISTICS = get_args(Statistic)
TRIANGLES = ("linear", "natural", "cubic")
ROUNDING = 1e-6  # share by which a reach is widened; more than what rounding can move

Array = NDArray[np.float64]


class Bands(NamedTuple):
    """Raster of gridded values, and of what supports them; arrays of shape (rows, cols).

    Attributes
    ----------
    surface : the values, NaN where there is no data
    used : number of points that made them
    nearest : distance from the centre to the nearest point
    error : root mean square of what the points used differ from the surface without them
    """

    surface: Array
    used: NDArray[Any] | None = None
    nearest: Array | None = None
    error: Array | None = None


def grid(
    xy: Array,
    values: Array,
    lattice: Lattice,
    *,
    method: Method = "linear",
    max_gap: float | None = None,
    power: float = 2.0,
    neighbours: int = 12,
    radius: float | None = None,
    smoothing: float = 0.0,
    percentile: float = 95.0,
    support: bool = False,
    uncertainty: bool = False,
    ctx: Context = QUIET,
) -> Bands:
    """Gridded values at the cell centres of a lattice, from values at scattered points.

    Parameters
    ----------
    xy : array of shape (n, 2); for interpolation, points at one position are averaged
    values : array of shape (n,), finite
    lattice : the cells
    method, max_gap, power, ... : see :class:`SurfaceGrid`; lengths in the unit of xy
    support : give `used` and `nearest`
    uncertainty : give `error`; not for statistics
    ctx : progress and cancellation

    Returns
    -------
    Bands
        Independent of the order of the points.

    Raises
    ------
    DataError
        The points do not span a triangle, which linear, natural and cubic need unless there is a
        max_gap.
    """
    ready, working = ctx.part(0.0, 0.1), ctx.part(0.1, 0.9 if support else 1.0)
    gap = math.inf if max_gap is None else max_gap
    if method in STATISTICS:
        statistic = cast(Statistic, method)
        bands = Bands(*per_cell(xy, values, lattice, statistic, percentile=percentile, ctx=working))
    elif method == "linear" and not uncertainty:
        bands = _linear(xy, values, lattice, gap, working)
    else:
        xy, values = averaged(xy, values, ctx=ready)
        if method in TRIANGLES:
            bands = _on_triangles(xy, values, lattice, method, gap, uncertainty, working)
        else:
            how = near.Weighting(reach=gap)
            if method == "idw":
                how = near.Weighting(neighbours, radius or math.inf, power, smoothing)
            bands = _from_nearest(xy, values, lattice, how, gap, uncertainty, working)
    ctx.progress(0.9 if support else 1.0)
    if not support:
        return bands._replace(used=None, nearest=None)
    return _supported(bands, xy, lattice, ctx.part(0.9, 1.0))


def _linear(xy: Array, values: Array, lattice: Lattice, gap: float, ctx: Context) -> Bands:
    """Linear interpolation, for which most triangles need not be made."""
    try:
        return Bands(linear(xy, values, lattice, gap, ctx=ctx))
    except DataError as err:
        return _without_triangles(err, "linear", lattice, gap, uncertainty=False)


def _on_triangles(
    xy: Array,
    values: Array,
    lattice: Lattice,
    method: Method,
    gap: float,
    uncertainty: bool,
    ctx: Context,
) -> Bands:
    """Values by a method on triangles, of points of which no two share a position."""
    try:
        tin = Tin(xy, lattice, gap, ctx=ctx.part(0.0, 0.7))
    except DataError as err:
        return _without_triangles(err, method, lattice, gap, uncertainty)
    drawing, used = ctx.part(0.7, 0.9 if uncertainty else 1.0), None
    if method == "linear":
        surface = tin.linear(values, ctx=drawing)
    elif method == "natural":
        surface, used = tin.natural(values, ctx=drawing)
    else:
        surface = tin.cubic(values, ctx=drawing)
    if not uncertainty:
        return Bands(surface, used)
    squares = tin.left_out(values, ctx=ctx.part(0.9, 0.95))
    spread = ctx.part(0.95, 1.0)
    natural = method == "natural"
    mean = tin.natural(squares, ctx=spread)[0] if natural else tin.linear(squares, ctx=spread)
    return Bands(surface, used, error=np.sqrt(mean))


def _without_triangles(
    err: DataError, method: Method, lattice: Lattice, gap: float, uncertainty: bool
) -> Bands:
    """Bands without data where no triangle exists; an error unless there is a maximum gap."""
    if math.isinf(gap):
        raise DataError(f"{err}, which {method} needs; use nearest") from err
    return _nothing(lattice, uncertainty)


def _from_nearest(
    xy: Array,
    values: Array,
    lattice: Lattice,
    how: near.Weighting,
    gap: float,
    uncertainty: bool,
    ctx: Context,
) -> Bands:
    """Values from the nearest points: inverse distance weighting or nearest neighbour."""
    if not len(xy):
        return _nothing(lattice, uncertainty)
    there = near.buckets(xy, lattice.rows * lattice.cols, ctx=ctx.part(0.0, 0.2))
    found = near.weighted(
        there, values, lattice, how, gap, ctx=ctx.part(0.2, 0.5 if uncertainty else 1.0)
    )
    if not uncertainty:
        return Bands(*found)
    squares = near.left_out(there, values, how, ctx=ctx.part(0.5, 0.7))
    mean, _, _ = near.weighted(there, squares, lattice, how, gap, ctx=ctx.part(0.7, 1.0))
    return Bands(*found, error=np.sqrt(mean))


def _supported(bands: Bands, xy: Array, lattice: Lattice, ctx: Context) -> Bands:
    """Bands with the number of points used (3 on triangles) and the distance to the nearest."""
    used, nearest = bands.used, bands.nearest
    if used is None:
        used = np.where(np.isfinite(bands.surface), 3, 0)
    if nearest is None:
        nearest = np.full(lattice.shape, np.nan)
        if len(xy):
            there = near.buckets(xy, lattice.rows * lattice.cols, ctx=ctx.part(0.0, 0.2))
            nearest = near.weighted(
                there, np.zeros(len(xy)), lattice, near.Weighting(), ctx=ctx.part(0.2, 1.0)
            )[2]
            nearest[used == 0] = np.nan
    return bands._replace(used=used.astype(np.float64), nearest=nearest)


def _nothing(lattice: Lattice, uncertainty: bool) -> Bands:
    """Bands without data in any cell."""
    empty, zero = np.full(lattice.shape, np.nan), np.zeros(lattice.shape)
    return Bands(empty, zero, error=empty.copy() if uncertainty else None)
