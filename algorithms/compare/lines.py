"""How far lines are from reference lines.

What each figure means: docs/explanation/comparing-areas-and-lines.md.

References
----------
Goodchild, M. F. and Hunter, G. J. (1997). A simple positional accuracy measure for linear features.
International Journal of Geographical Information Science 11(3), 299-306: the share of a line within
a buffer around the reference.
Heipke, C. et al. (1997). Evaluation of automatic road extraction. IAPRS 32(3-2W3), 47-56:
completeness, correctness, quality, redundancy.
Alt, H. and Godau, M. (1995). Computing the Fréchet distance between two polygonal curves.
International Journal of Computational Geometry and Applications 5, 75-91.
Odabaş (2018). MSc thesis, Karadeniz Technical University: shorelines as polynomials.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.compare._curves import curve_rows
from algorithms.compare._frechet import frechet
from algorithms.compare._shapes import AREAS, LINES, layer_problem
from algorithms.shared.routes import Array, Feet, IndexedRoute, Route, farthest, routes, within
from toolbox.context import QUIET, Context, log
from toolbox.data import Table, Vector
from toolbox.data.crs import crs_conflict
from toolbox.declare import Extent, outputs, param, show, sink, source, tool
from toolbox.errors import DataError

ROUNDING = 1e-7  # of the largest value: how far a quantile may be wrong
WITHIN = 1e-4  # metres: how far Hausdorff and Fréchet distances may be wrong

Row = dict[str, Any]


@tool(
    "compare.lines",
    title="Compare lines",
    tags=(
        "accuracy",
        "hausdorff",
        "frechet",
        "buffer",
        "offset",
        "shoreline",
        "validation",
    ),
)
class CompareLines:
    """Compare lines with reference lines: distances, sides, and how much of each is found.

    Distances are exact, from a place on one line to the nearest place on the other, in the plane.
    They are taken at all vertices and every `spacing` between, and change straight in between, so
    that means and percentiles are those of the length, not of the vertices. Hausdorff and Fréchet
    distances are those of the lines themselves, to 0.1 mm.

    Correctness is the share of the length that lies within `buffer` of the reference, completeness
    the share of the reference within `buffer` of the lines.

    The offset of a place is positive on the left of the reference, as this runs, and negative on
    the right. Places whose nearest one is the end of a reference line have no side; they keep their
    distance, and are left out of the bias.

    Polygons are taken as their outlines, with the inside on the left. Lines that go on where
    another of the same direction ends are one line. Fréchet asks for one line on each side; the
    second may be walked either way, and a closed one from anywhere.

    With `coverage` or `extent` both layers are cut, and only what is within is compared. Near the
    new ends the nearest place may have been cut off: take the area wide enough.

    `compare_heights` compares Z too, at the nearest places. `polynomial` also fits y as a
    polynomial of x to the vertices of each side, and tells how far these curves are apart. Tables
    are in metres, layers in the unit of the data.
    """

    lines: Vector = source(
        "Lines to judge, or polygons for their outlines", shapes=("line", "polygon")
    )
    reference: Vector = source(
        "Reference lines, or polygons for their outlines", shapes=("line", "polygon")
    )
    coverage: Vector | None = source(
        "Polygons within which is compared",
        default=None,
        label="Area to compare in",
        shapes="polygon",
    )
    extent: Extent | None = param("Rectangle to work in; that of the data by default", default=None)
    buffer: float = param("Distance at which a line counts as found", default=1.0, unit="m", gt=0)
    spacing: float = param(
        "Longest distance along a line between two positions that are compared",
        default=1.0,
        unit="m",
        gt=0,
        label="Distance of positions on a line",
    )
    compare_heights: bool = param(
        "Compare heights (Z) as well", default=False, label="Compare heights too"
    )
    polynomial: int | None = param(
        "Degree of the polynomials that are compared",
        default=None,
        unit="1",
        ge=1,
        le=9,
        label="Degree of polynomials",
    )

    @outputs
    class Outputs:
        table: Table = sink("One row per measure: measure, value, unit, meaning")
        offsets: Vector = sink(
            "Positions along the lines with chainage, distance and offset",
            show=(
                show.Values(
                    "offset",
                    label="Offset",
                    note="left of the reference above zero",
                    length=True,
                    centred=True,
                ),
                show.Profile("line", along="chainage", across="offset", note="left +"),
            ),
            label="Positions with offsets",
        )
        curves: Table | None = sink("Coefficients, fit and agreement of the polynomials")
        mean: float = sink("Mean distance to the reference", unit="m")
        rms: float = sink("Root mean square distance", unit="m", label="RMS")
        p95: float = sink(
            "Distance that 95 % of the length does not exceed", unit="m", label="95th percentile"
        )
        bias: float | None = sink("Mean offset, positive on the left of the reference", unit="m")
        hausdorff: float = sink("Largest distance, of both directions", unit="m")
        frechet: float | None = sink("Fréchet distance of two single lines", unit="m")
        correctness: float = sink("Length within the buffer of the reference", unit="%")
        completeness: float = sink("Length of the reference within the buffer", unit="%")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """Both layers hold lines, with heights if these are compared."""
        for name in ("lines", "reference"):
            layer = getattr(self, name)
            if text := layer_problem(layer, (*LINES, *AREAS), "lines or polygons"):
                yield name, text
            elif not len(layer):
                yield name, f"{_named(layer)} has no lines"
            elif self.compare_heights and not _has_heights(layer):
                yield name, f"{_named(layer)} has no heights (Z) to compare"
        if self.coverage is not None:
            if text := layer_problem(self.coverage, AREAS, "polygons"):
                yield "coverage", text
            elif not len(self.coverage):
                yield "coverage", f"{_named(self.coverage)} has no polygons"
        text = crs_conflict(self.reference.crs, self.lines.crs, heights=True, tools="vectors")
        if self.compare_heights and text:
            yield "compare_heights", f"{_named(self.reference)} {text} of {_named(self.lines)}"

    def halo(self) -> float:
        """Infinite, as lines are of any length."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> CompareLines.Outputs:
        """Measure distances in both directions, and sum up."""
        metre = self.lines.metre
        own, other = self._route("lines"), self._route("reference")
        to, back = IndexedRoute(other), IndexedRoute(own)
        places, returns = own.divided(self.spacing), other.divided(self.spacing)
        feet = to.feet(places.nodes[:, :2], ctx.part(0.0, 0.3))
        feet_back = back.feet(returns.nodes[:, :2], ctx.part(0.3, 0.6))
        there, here = Along.of(places, feet.distance), Along.of(returns, feet_back.distance)
        within = WITHIN * metre
        longest = farthest(places, feet, to, within, ctx.part(0.6, 0.7))
        longest_back = farthest(returns, feet_back, back, within, ctx.part(0.7, 0.8))
        hausdorff = max(longest, longest_back)
        leash = self._frechet(own, other, hausdorff, ctx.part(0.8, 0.9))
        side, abeam = to.sides(places.nodes[:, :2], feet)
        offset = there.weighted(np.where(abeam, side * feet.distance, np.nan))
        offsets = self._offsets(places, feet, side, abeam, to)
        ctx.progress(0.95)
        found = BufferOverlay.of(there, here, self.buffer)
        rows = [
            *distance_rows(there, longest, "", "of the lines to the reference"),
            *distance_rows(here, longest_back, "reverse_", "of the reference to the lines"),
            *_leash_rows(hausdorff, leash),
            *offset_rows(offset, there.length),
            *found.rows(self.buffer),
        ]
        if self.compare_heights:
            height = places.nodes[:, 2] - to.at(feet)[2]
            rows += spread_rows(there.weighted(height), "height_", "Z of lines minus reference")
        curves = None
        if self.polynomial is not None:
            _warn_of_rings(own, other)
            vertices, known = own.nodes[:, :2] / metre, other.nodes[:, :2] / metre
            curves = Table.from_rows(curve_rows(vertices, known, self.polynomial))
        ctx.progress(1.0)
        return self.Outputs(
            table=Table.from_rows(in_metres(rows, metre)),
            offsets=offsets,
            curves=curves,
            mean=there.mean,
            rms=there.rms,
            p95=there.quantile(0.95),
            bias=offset.mean if offset.length else None,
            hausdorff=hausdorff,
            frechet=leash[0] if leash else None,
            correctness=100 * found.lines / found.length,
            completeness=100 * found.reference / found.reference_length,
        )

    def _route(self, name: str) -> Route:
        """The lines of a layer, as far as they are compared.

        Raises
        ------
        DataError
            None of them is.
        """
        found = routes(_shapes(getattr(self, name)))
        areas: list[Any] = [shapely.box(*self.extent)] if self.extent else []
        if self.coverage is not None:
            areas.append(shapely.union_all(_shapes(self.coverage)))
        if areas:
            whole = Route.of(found).length
            found = within(found, shapely.intersection_all(areas))
            if not found:
                where = "coverage" if self.coverage is not None else "extent"
                raise DataError(f"{where}: nothing of the {name} lies within")
            share = 100 * Route.of(found).length / whole
            log.info("%s: %.3g %% of the length is compared", name, share)
        return Route.of(found)

    def _frechet(
        self, own: Route, other: Route, least: float, ctx: Context
    ) -> tuple[float, bool] | None:
        """Fréchet distance, and whether one line runs the other way; None where not defined."""
        if (counts := (len(own.closed), len(other.closed))) != (1, 1):
            log.info("no Fréchet distance: %d lines against %d", *counts)
            return None
        if own.closed[0] != other.closed[0]:
            log.info("no Fréchet distance: a closed line against an open one")
            return None
        one, two = own.vertices(0), other.vertices(0)
        return frechet(one, two, least, WITHIN * self.lines.metre, self.spacing, ctx)

    def _offsets(
        self, places: Route, feet: Feet, side: Array, abeam: NDArray[np.bool_], to: IndexedRoute
    ) -> Vector:
        """Layer of positions along the lines with their distances; lines are numbered from 1."""
        import geopandas

        line, chainage, z = to.at(feet)
        columns = {
            "line": places.line + 1,
            "chainage": places.chainage,
            "distance": feet.distance,
            "offset": np.where(abeam, side * feet.distance, np.nan),
            "reference": line + 1,
            "reference_chainage": chainage,
        }
        if self.compare_heights:
            columns["height"] = places.nodes[:, 2] - z
        width = 3 if self.compare_heights else 2
        frame = geopandas.GeoDataFrame(
            columns, geometry=shapely.points(places.nodes[:, :width]), crs=self.lines.crs
        )
        return Vector(frame)


def _warn_of_rings(own: Route, other: Route) -> None:
    """Warn of closed lines, which no polynomial y of x can follow."""
    names = [
        n
        for n, route in (("the lines are", own), ("the reference is", other))
        if route.closed.any()
    ]
    if names:
        log.warning(
            "polynomial: %s closed, so that an x has more than one y; compare a reach "
            "of them, with `extent` or `coverage`",
            " and ".join(names),
        )


def _named(layer: Vector) -> str:
    return layer.name or "the layer"


def _shapes(layer: Vector) -> Any:
    return layer.frame.geometry.to_numpy().astype(object)


def _has_heights(layer: Vector) -> bool:
    heights = shapely.get_coordinates(_shapes(layer), include_z=True)[:, 2]
    return bool(np.isfinite(heights).all())


# Values along lines ---------------------------------------------------------------------------


class Along(NamedTuple):
    """A value at the nodes of lines that is linear between them.

    Attributes
    ----------
    first, last : arrays of shape (m,), at the ends of each piece
    lengths : array of shape (m,), of the pieces
    value : array of shape (n,), at the nodes
    share : array of shape (n,), half of the length of the pieces beside each node
    """

    first: Array
    last: Array
    lengths: Array
    value: Array
    share: Array

    @classmethod
    def of(cls, route: Route, value: Array) -> Along:
        """Build from values of shape (n,) at the nodes of a route."""
        begins, lengths = route.begins, route.lengths
        count = len(route.nodes)
        share = np.bincount(begins, lengths, count) + np.bincount(begins + 1, lengths, count)
        return cls(value[begins], value[begins + 1], lengths, value, share / 2)

    @property
    def length(self) -> float:
        return float(self.lengths.sum())

    @property
    def mean(self) -> float:
        return float((self.lengths * (self.first + self.last)).sum() / 2 / self.length)

    @property
    def rms(self) -> float:
        square = self.first**2 + self.first * self.last + self.last**2
        return math.sqrt(float((self.lengths * square).sum() / 3 / self.length))

    def weighted(self, value: Array) -> Weighted:
        """Values at the same nodes with lengths as weights; NaN is left out."""
        known = np.isfinite(value) & (self.share > 0)
        return Weighted.of(value[known], self.share[known])

    def quantile(self, part: float) -> float:
        """The value that a share of the length does not exceed."""
        low, high = float(self.value.min()), float(self.value.max())
        near = ROUNDING * max(abs(low), abs(high))
        while high - low > near:
            middle = (low + high) / 2
            if self.below(middle)[0] < part * self.length:
                low = middle
            else:
                high = middle
        return high

    def below(self, limit: float) -> tuple[float, float]:
        """Length along which the value is at most a limit, and the integral of its square there."""
        low, high = np.minimum(self.first, self.last), np.maximum(self.first, self.last)
        rise = np.where(high > low, high - low, 1.0)
        part = np.where(high > low, np.clip((limit - low) / rise, 0, 1), low <= limit)
        top = np.minimum(high, limit)
        length = part * self.lengths
        return float(length.sum()), float((length * (low**2 + low * top + top**2)).sum() / 3)


class Weighted(NamedTuple):
    """Values in rising order, weighted by lengths; arrays of shape (n,)."""

    value: Array
    share: Array

    @classmethod
    def of(cls, value: Array, share: Array) -> Weighted:
        """Sort values and their weights."""
        order = np.argsort(value, kind="stable")
        return cls(value[order], share[order])

    @property
    def length(self) -> float:
        return float(self.share.sum())

    @property
    def mean(self) -> float:
        return float((self.value * self.share).sum() / self.length)

    @property
    def std(self) -> float:
        return math.sqrt(float(((self.value - self.mean) ** 2 * self.share).sum() / self.length))

    def quantile(self, part: float) -> float:
        """The value that a share of the length does not exceed."""
        middle = np.cumsum(self.share) - self.share / 2
        return float(np.interp(part * self.length, middle, self.value))


class BufferOverlay(NamedTuple):
    """Lengths within the buffer around the other layer, and total lengths."""

    lines: float
    reference: float
    length: float
    reference_length: float
    squares: float

    @classmethod
    def of(cls, there: Along, here: Along, buffer: float) -> BufferOverlay:
        """Sum up lengths from distances in both directions."""
        lines, squares = there.below(buffer)
        return cls(lines, here.below(buffer)[0], there.length, here.length, squares)

    def rows(self, buffer: float) -> Iterator[Row]:
        """Table rows of the buffer overlay (Heipke et al. 1997)."""
        missed = self.reference_length - self.reference
        matched = self.lines
        yield row("buffer", buffer, "m", "a line within it of the other side counts as found")
        yield row("correctness", 100 * matched / self.length, "%", "length of the lines found")
        share = 100 * self.reference / self.reference_length
        yield row("completeness", share, "%", "length of the reference found")
        share = 100 * matched / (self.length + missed)
        yield row("quality", share, "%", "lines found / (all lines + reference not found)")
        twice = 100 * (matched - self.reference) / matched if matched else None
        yield row("redundancy", twice, "%", "(lines found - reference found) / lines found")
        rms = math.sqrt(self.squares / matched) if matched else None
        yield row("rms_found", rms, "m", "root mean square distance of the lines found")


def row(measure: str, value: float | None, unit: str, meaning: str) -> Row:
    """One row of the table of measures."""
    return {"measure": measure, "value": value, "unit": unit, "meaning": meaning}


def distance_rows(along: Along, longest: float, word: str, what: str) -> Iterator[Row]:
    """Table rows: distances in one direction."""
    yield row(f"{word}length", along.length, "m", f"length {what}".split(" to ")[0])
    yield row(f"{word}mean", along.mean, "m", f"mean distance {what}")
    yield row(f"{word}rms", along.rms, "m", "root mean square of it")
    yield row(f"{word}median", along.quantile(0.5), "m", "half of the length is no farther")
    yield row(f"{word}p90", along.quantile(0.9), "m", "90 % of the length are no farther")
    yield row(f"{word}p95", along.quantile(0.95), "m", "95 % of the length are no farther")
    yield row(f"{word}max", longest, "m", "directed Hausdorff distance")


def _leash_rows(hausdorff: float, leash: tuple[float, bool] | None) -> Iterator[Row]:
    yield row("hausdorff", hausdorff, "m", "largest distance of both directions")
    what = "shortest leash of two who walk along the lines"
    if leash and leash[1]:
        what += ", one of them backwards"
    text = what if leash else "not defined: one line each, both open or both closed"
    yield row("frechet", leash[0] if leash else None, "m", text)


def offset_rows(offset: Weighted, length: float) -> Iterator[Row]:
    """Table rows: offsets to the sides; no offsets where no position is beside the reference."""
    share = 100 * offset.length / length
    yield row("abeam", share, "%", "length beside the reference, not beyond its ends")
    if not offset.length:
        yield row("bias", None, "m", "mean offset, positive on the left of the reference")
        return
    left = 100 * float(offset.share[offset.value > 0].sum()) / offset.length
    yield row("left", left, "%", "of that, on the left of the reference")
    yield row("bias", offset.mean, "m", "mean offset, positive on the left of the reference")
    yield row("offset_std", offset.std, "m", "standard deviation about the bias")
    yield row("offset_median", offset.quantile(0.5), "m", "half of the offsets are lower")


def spread_rows(values: Weighted, word: str, what: str) -> Iterator[Row]:
    """Table rows: statistics of signed differences."""
    sizes = Weighted.of(np.abs(values.value), values.share)
    yield row(f"{word}bias", values.mean, "m", f"mean of {what}")
    yield row(f"{word}std", values.std, "m", "standard deviation about it")
    yield row(f"{word}rms", math.hypot(values.mean, values.std), "m", "root mean square")
    yield row(f"{word}median", values.quantile(0.5), "m", "half are lower")
    yield row(f"{word}p95", sizes.quantile(0.95), "m", "95 % of the sizes are no larger")
    yield row(f"{word}max", float(sizes.value[-1]), "m", "largest size at a place")


def in_metres(rows: list[Row], metre: float) -> Iterator[Row]:
    """Table rows with lengths converted to metres."""
    for one in rows:
        length = one["unit"] == "m" and one["value"] is not None
        yield one | ({"value": one["value"] / metre} if length else {})
