"""Contours: lines of one height on a surface."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.heights import heights_problem
from algorithms.surface._smooth import smoothed
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, Raster, Vector
from toolbox.data.crs import own_unit, unit_of_heights
from toolbox.data.report import Column
from toolbox.declare import outputs, param, sink, source, tool
from toolbox.declare.show import Isolines, Texts
from toolbox.errors import DataError

if TYPE_CHECKING:
    import geopandas

Array = NDArray[np.float64]
MOST_LEVELS = 10_000  # more are taken for a mistake in the interval
ROUNDING = 1e-9  # intervals: a level this close below the lowest value may be meant to be it
DIGITS = 9  # of a level after the point, so that three times 0.1 is 0.3
TOLERANCE = 0.25  # m, of smoothing where none is given: what an airborne survey knows of a height
PART = 0.25  # of the interval: half of what maps allow a line, as smoothing is one error of several
TOUCH = 1e-9  # square cells: a ring that is smaller only touches the level

ELEVATION = Column("Elevation", "unit")


@tool(
    "surface.contours",
    title="Contours",
    tags=(
        "contour",
        "isoline",
        "elevation",
        "lines",
    ),
)
class SurfaceContours:
    """Draw lines of equal height on a raster of heights.

    Heights are taken at the centres of cells, and change straight along the lines between them. A
    line ends where one of the four cells around it has no value, so it never crosses a gap, and
    half a cell before the edge of the raster. Lines around a top or a hollow are closed: the last
    vertex is the first. The higher ground is to the right of each line. A cell that is exactly
    as high as a level counts as below it.

    The attribute elevation is the height of the line, in the unit of the data as its Z;
    `interval` and `base` are metres. Every so many lines, counted from `base`, one is an index
    contour, whose attribute is_index is true.

    Lines are not smoothed, since smoothed ones may cross. With `smooth_lines` or `smooth_tolerance`
    the surface is made as smooth as it can be without moving any height by more, and the lines are
    those of that surface; water that was laid level stays level. A level that this would leave
    without a line, as on flat land, keeps the lines of the surface as it is, if the interval is
    more than the tolerance; their number is told, and so is a tolerance of more than a quarter of
    the interval, as lines are then farther from the ground than maps allow. With `min_length`
    shorter lines are left out, and their number is told: the noise of a survey makes many around
    single cells.

    `labels` has a position on index contours every `label_spacing` along them, at least one on
    each that is half as long, and on the longest of each height, with the text, and the angle in
    degrees, counterclockwise from the direction of x, at which it can be read. In a drawing (.dxf)
    they are texts.
    """

    surface: Raster = source("Raster of heights")
    interval: float = param(
        "Height between two lines", default=1.0, unit="m", gt=0, label="Height between lines"
    )
    base: float = param("Height of one of the lines", default=0.0, unit="m")
    index_every: int = param(
        "Lines from one index contour to the next",
        default=5,
        unit="1",
        ge=1,
        label="Lines per index contour",
    )

    smooth_lines: bool = param("Whether to smooth the lines", default=False, label="Smooth lines")
    smooth_tolerance: float | None = param(
        "How far smooth lines may move heights; a quarter of the interval, at most 0.25 m, "
        "if not given",
        default=None,
        unit="m",
        ge=0,
        le=10,
        label="Tolerance of smoothing",
    )
    min_length: float = param(
        "Length below which lines are left out", default=0.0, unit="m", ge=0, label="Least length"
    )
    label_spacing: float = param(
        "Distance along an index contour from one label to the next",
        default=250.0,
        unit="m",
        gt=0,
        label="Distance between labels",
    )

    @outputs
    class Outputs:
        contours: Vector = sink(
            "Lines with Z and the attributes elevation and is_index",
            columns={"elevation": ELEVATION, "is_index": Column("Index contour")},
            show=Isolines("elevation", heavy="is_index"),
            label="Contours",
            listed=False,
        )
        labels: Vector = sink(
            "Where the heights of index contours are written: text, angle",
            columns={
                "elevation": ELEVATION,
                "text": Column("Text"),
                "angle": Column("Angle of the text, counterclockwise", "°", 0),
            },
            show=Texts("text", angle="angle"),
        )
        levels: int = sink("Number of levels that have lines", unit="1", label="Number of levels")
        left_out: int = sink("Lines shorter than min_length", unit="1", label="Lines left out")
        largest_move: float = sink(
            "Largest change of a height by smoothing", unit="m", label="Largest change"
        )

        def in_words(self) -> str:
            """How many levels have lines, and how far smoothing has moved heights."""
            said = f"Contours are at {self.levels} levels."
            if not self.largest_move:
                return said
            own = own_unit(self.largest_move, unit_of_heights(self.contours.crs))
            return (
                f"{said} They are smooth, for which no height was moved by more than "
                f"{self.largest_move:.3f} m{own}."
            )

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The heights have the unit in which the interval is given."""
        if text := heights_problem(self.surface):
            yield "surface", f"{self.surface.name or 'the raster'} {text}"

    @property
    def tolerance(self) -> float:
        """How far heights may be moved, in the unit of the surface; 0 for lines as they are."""
        if self.smooth_tolerance is not None:
            return self.smooth_tolerance
        usual = min(self.interval * PART, TOLERANCE * self.surface.metre)
        return usual if self.smooth_lines else 0.0

    def halo(self) -> float:
        """Infinite, as a line may run through the whole raster."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> SurfaceContours.Outputs:
        """Draw level by level, from the lowest."""
        import geopandas
        import shapely

        surface = self.surface.band()
        heights = surface
        if self.tolerance > self.interval * PART:
            log.warning(
                "lines may be up to %.4g m higher or lower than the surface, more than a quarter "
                "of the interval, %.4g m: a smaller tolerance of smoothing brings them nearer",
                self.tolerance / self.surface.metre,
                self.interval / self.surface.metre,
            )
        if self.tolerance:
            heights = smoothed(surface, self.tolerance, ctx=ctx.part(0.0, 0.5))
            ctx = ctx.part(0.5, 1.0)
        steps = steps_between(surface, self.interval, self.base)
        levels = [round(self.base + step * self.interval, DIGITS) for step in steps]
        lattice = Lattice.of(self.surface)
        every = contours(heights, lattice, levels, ctx=ctx.part(0.0, 0.9))
        gone = [n for n, lines in enumerate(every) if not self._long_enough(lines)]
        if 0 < self.tolerance < self.interval:
            # Lines of two levels cannot cross, as heights are moved by less than the interval.
            ctx = ctx.part(0.9, 1.0)
            rough = contours(surface, lattice, [levels[n] for n in gone], ctx=ctx)
            self._tell_rough(rough)
            for n, lines in zip(gone, rough, strict=True):
                every[n] = lines
        found = [self._long_enough(lines) for lines in every]
        left_out = sum(map(len, every)) - sum(map(len, found))
        counts = np.array([len(lines) for lines in found], int)
        frame = geopandas.GeoDataFrame(
            {
                "elevation": np.repeat(np.array(levels, float), counts),
                "is_index": np.repeat(np.array(steps) % self.index_every == 0, counts),
            },
            geometry=[
                shapely.LineString(np.column_stack([line, np.full(len(line), level)]))
                for level, lines in zip(levels, found, strict=True)
                for line in lines
            ],
            crs=self.surface.crs,
        )
        if frame.empty:
            self._tell_none(surface, every, steps)
        moves = np.abs(heights - surface)
        return self.Outputs(
            contours=Vector(frame, geometry_type="LineString Z"),
            labels=labels_on(frame[frame["is_index"]], self.label_spacing),
            levels=int(np.count_nonzero(counts)),
            left_out=left_out,
            largest_move=float(np.max(moves, initial=0.0, where=np.isfinite(moves))),
        )

    def _long_enough(self, lines: list[Array]) -> list[Array]:
        """The lines that are not left out."""
        return [line for line in lines if length(line) >= self.min_length]

    def _tell_rough(self, rough: list[list[Array]]) -> None:
        """Warn of lines that smoothing would have taken away with all of their level."""
        if kept := sum(len(self._long_enough(lines)) for lines in rough):
            log.warning(
                "%d lines are not smoothed: smoothing by up to %.4g m would leave none there",
                kept,
                self.tolerance / self.surface.metre,
            )

    def _tell_none(self, surface: Array, every: list[list[Array]], steps: range) -> None:
        """Warn that there are no lines, and why."""
        metre = self.surface.metre
        lengths = [length(line) for lines in every for line in lines]
        if not np.isfinite(surface).any():
            why = "no cell has a value"
        elif not lengths and len(steps) and self.tolerance:
            why = f"smoothing by up to {self.tolerance / metre:.4g} m leaves none"
        elif not lengths:
            why = "no height between cells is a multiple of the interval"
        else:
            why = (
                f"all {len(lengths)} are shorter than {self.min_length / metre:.4g} m, the longest "
                f"is {max(lengths) / metre:.4g} m; a smaller min_length of surface.contours, or "
                "contour_length of models.terrain, keeps them"
            )
        log.warning("there are no lines: %s", why)


def length(line: Array) -> float:
    """Length of a line, array of shape (n, 2), in its own unit."""
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def labels_on(lines: geopandas.GeoDataFrame, spacing: float) -> Vector:
    """Points with the text and angle of labels on lines, in the unit of their coordinates."""
    import geopandas
    import shapely

    rows: dict[str, list[Any]] = {"elevation": [], "text": [], "angle": []}
    places = []
    longest = set(lines.geometry.length.groupby(lines["elevation"]).idxmax())
    for own, line, elevation in zip(lines.index, lines.geometry, lines["elevation"], strict=True):
        count = max(math.floor(line.length / spacing + 0.5), int(own in longest))
        step = min(spacing, line.length) / 20  # along which its direction is taken
        for k in range(count):
            along = (k + 0.5) / count * line.length
            place, *around = (line.interpolate(along + d * step) for d in (0, -1, 1))
            dx, dy = around[1].x - around[0].x, around[1].y - around[0].y
            places.append(shapely.Point(place.x, place.y, elevation))
            rows["elevation"].append(elevation)
            rows["text"].append(f"{elevation:.10g}")
            rows["angle"].append((math.degrees(math.atan2(dy, dx)) + 90) % 180 - 90)
    frame = geopandas.GeoDataFrame(rows, geometry=places, crs=lines.crs)
    return Vector(frame, geometry_type="Point Z")


def steps_between(heights: Array, interval: float, base: float) -> range:
    """Integers k for which base + k * interval lies between the lowest and the highest value.

    Raises
    ------
    DataError
        They are more than `MOST_LEVELS`.
    """
    if not np.isfinite(heights).any():
        return range(0)
    first = math.ceil((np.nanmin(heights) - base) / interval - ROUNDING)
    last = math.floor((np.nanmax(heights) - base) / interval)
    if last - first >= MOST_LEVELS:
        raise DataError(
            f"interval: makes {last - first + 1} levels, more than {MOST_LEVELS}; take a larger one"
        )
    return range(first, last + 1)


def contours(
    heights: Array, lattice: Lattice, levels: Sequence[float], *, ctx: Context = QUIET
) -> list[list[Array]]:
    """Lines of each level.

    Parameters
    ----------
    heights : array of shape (rows, cols), NaN where not known
    lattice : its cells
    levels : in the unit of the heights

    Returns
    -------
    for each level a list of arrays of shape (n, 2)
        Coordinates of the vertices, no two of them at one position in a row; the higher ground on
        the right. A closed line ends with its first vertex.
    """
    from contourpy import LineType, contour_generator

    if min(heights.shape) < 2:
        return [[] for _ in levels]
    generator: Any = contour_generator(
        z=np.ma.masked_invalid(heights),
        name="serial",
        corner_mask=False,
        line_type=LineType.ChunkCombinedOffset,
    )
    found = []
    for number, level in enumerate(levels):
        ctx.progress(number / len(levels))
        (points,), (offsets,) = generator.lines(level)
        found.append([] if points is None else separated(points, offsets, lattice))
    ctx.progress(1.0)
    return found


def separated(points: Array, offsets: NDArray[Any], lattice: Lattice) -> list[Array]:
    """Single lines in coordinates, without those that only touch their level.

    Parameters
    ----------
    points : array of shape (n, 2), columns and rows of cells
    offsets : array of shape (lines + 1,), where each line begins and the last one ends
    """
    new = np.ones(len(points), bool)
    new[1:] = (np.diff(points, axis=0) != 0).any(axis=1)
    new[offsets[:-1]] = True
    ends = np.concatenate([[0], np.cumsum(new)])[offsets]
    points = points[new]
    west, north = (centre[0] for centre in lattice.centres())
    places = np.column_stack(
        [west + lattice.cell * points[:, 0], north - lattice.cell * points[:, 1]]
    )
    return [
        places[first:last] for first, last in pairwise(ends) if not is_touch(points[first:last])
    ]


def is_touch(line: Array) -> bool:
    """Whether a line in cell coordinates is closed and encloses no area; a single point is."""
    if (line[0] != line[-1]).any():
        return False
    x, y = (line - line[0]).T
    return bool(abs(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1])) < 2 * TOUCH)
