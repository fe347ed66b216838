"""Sections through points: along a line, or across it again and again."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shared import parameters
from algorithms.shared.cells import SortedCells
from algorithms.shared.ground import without_withheld
from algorithms.shared.routes import IndexedRoute, Route, routes
from toolbox.context import QUIET, Context, log
from toolbox.data import Drawing, PointCloud, Survey, Vector
from toolbox.data.asprs import COLOURS, class_label
from toolbox.data.crs import vertical_unit
from toolbox.data.drawing import Panel
from toolbox.declare import ClassList, outputs, param, sink, source, tool
from toolbox.errors import DataError

BATCH = 1_000_000  # points of a survey that are looked at at a time
MOST = 2000  # sections; more are taken for a mistake in the spacing
GREY = "#777777"  # of points without a class
MARGIN = 1e-3  # of half a width around the points of a cell, so that a single one has an area
ENDS = 1e-9  # share of a spacing by which the end of a line is no shorter

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


@tool(
    "points.profile",
    title="Profiles and cross-sections",
    tags=(
        "profile",
        "section",
        "cross-section",
        "long-section",
        "transect",
        "chainage",
        "drawing",
        "dxf",
    ),
)
class PointsProfile:
    """Cut sections through points along a line, and draw them to scale.

    Without `every`, each line is a section: it takes the points beside it within half the `width`.
    With `every`, a chain of cross-sections stands on each line, from its beginning on, each of so
    many metres of `length`, half of them on either side; seen along the line, left is left.

    Points get the number of their section, their chainage (length along the section from its
    beginning) and their offset from it, positive on the left, in the unit of the data. A point in
    two sections is there twice. Points beyond the ends of a line are in none.

    The surface is the median height of points of the ground, or of all points where none has such a
    class, in pieces of `piece`; it is not drawn across gaps longer than `max_gap`.

    A PDF has a page for each section; a DXF has the unit of the data and no exaggeration.
    """

    points: PointCloud | Survey = source("Points to cut")
    line: Vector = source("Lines to cut along", shapes="line")
    width: float = param("Width of a section", default=1.0, unit="m", gt=0)
    every: float | None = param(
        "Distance between cross-sections; without it, one section along each line",
        default=None,
        unit="m",
        gt=0,
    )
    length: float = param("Length of a cross-section", default=40.0, unit="m", gt=0)
    ground_classes: ClassList = parameters.ground_classes()
    piece: float = param("Length of a piece of the surface", default=0.5, unit="m", gt=0)
    max_gap: float = param(
        "Longest gap that the surface is drawn across", default=5.0, unit="m", gt=0
    )
    paper_scale: int | None = param(
        "Scale of the drawing, 1 to this; without it, one that fits a sheet A3",
        default=None,
        unit="1",
        ge=1,
    )
    exaggeration: float = param(
        "How much larger than lengths heights are drawn", default=1.0, unit="1", gt=0, le=1000
    )

    @outputs
    class Outputs:
        section: PointCloud = sink("Points of the sections with section, chainage and offset")
        surface: Vector = sink("Line on the surface of each section, with heights")
        drawing: Drawing = sink("The sections to scale")
        count: int = sink("Number of sections", unit="1")
        without_points: int = sink("Sections that have no points", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """There are lines, and nothing else."""
        shapes = self.line.frame.geometry
        if not len(shapes):
            yield "line", f"{self.line.name or 'the layer'} has no lines"
        elif not shapes.geom_type.isin(["LineString", "MultiLineString"]).all():
            yield "line", f"{self.line.name or 'the layer'} must hold lines and nothing else"

    def halo(self) -> float:
        """Infinite, as a line may run through all points."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> PointsProfile.Outputs:
        """Find the points of each section, its surface, and draw."""
        ctx.progress(0.0)
        shapes = self.line.frame.geometry.to_numpy().astype(object)
        lines = [vertices for vertices in routes(shapes) if len(vertices) > 1]
        if not lines:
            raise DataError(f"line: the lines of {self.line.name or 'the layer'} have no length")
        sections = list(self._sections(lines))
        if len(sections) > MOST:
            text = f"makes {len(sections)} sections, more than {MOST}; take a larger distance"
            raise DataError(f"every: {text}")
        cloud = self._near(sections, ctx.part(0.0, 0.5))
        lines = [section.line for section in sections]
        found = list(places_of(cloud.xyz[:, :2], lines, self.width / 2, ctx.part(0.5, 0.7)))
        cut = _cut(cloud, found)
        firm = without_withheld(cloud, np.ones(len(cloud), bool), ctx)
        drawn = [place.of(firm[place.rows]) for place in found]
        surfaces = [
            self._surface(cloud, place, section)
            for place, section in zip(drawn, sections, strict=True)
        ]
        panels = [
            self._panel(cloud, *parts) for parts in zip(sections, drawn, surfaces, strict=True)
        ]
        empty = sum(not len(place.rows) for place in found)
        if empty:
            log.warning("%d of %d sections have no points", empty, len(sections))
        drawing = Drawing(
            self.points.name,
            tuple(panels),
            tuple((class_label(c), COLOURS.get(c, GREY)) for c in range(256))
            if "classification" in cloud
            else (("Points", GREY),),
            crs=self.points.crs,
            scale=self.paper_scale,
            exaggeration=self.exaggeration,
        )
        ctx.progress(1.0)
        return self.Outputs(
            section=cut,
            surface=_layer(sections, surfaces, self.points),
            drawing=drawing,
            count=len(sections),
            without_points=empty,
        )

    def _sections(self, lines: list[Floats]) -> Iterator[Section]:
        """The lines themselves, or cross-sections of them."""
        for number, vertices in enumerate(lines, start=1):
            line = vertices[:, :2]
            if self.every is None:
                name = "Section along the line" + (f" {number}" if len(lines) > 1 else "")
                yield Section(name, number, 0.0, 0.0, line)
                continue
            word = f"Line {number}, at" if len(lines) > 1 else "At"
            for at, place, way in across(line, self.every):
                left = np.array([-way[1], way[0]]) * self.length / 2
                title = f"{word} {chainage_text(at / self.points.metre)}"
                ends = np.array([place + left, place - left])
                yield Section(title, number, at, -self.length / 2, ends)

    def _near(self, sections: list[Section], ctx: Context) -> PointCloud:
        """The points in any of the sections; of a survey no more than needed is in memory."""
        half = self.width / 2
        area = shapely.union_all(
            [shapely.LineString(s.line).buffer(half * 1.001, quad_segs=32) for s in sections]
        )
        shapely.prepare(area)

        def near(cloud: PointCloud) -> PointCloud:
            x, y = cloud.xyz[:, 0], cloud.xyz[:, 1]
            return cloud.select(shapely.intersects_xy(area, x, y))

        if isinstance(self.points, PointCloud):
            return near(self.points)
        survey = self.points.limited_to(area.bounds)
        found = [near(cloud) for cloud in survey.batches(BATCH, ctx=ctx)]
        return survey.template.filled(found, sum(map(len, found)))

    def _surface(self, cloud: PointCloud, place: Places, section: Section) -> list[Floats]:
        """Lines of chainage and height on the ground of a section."""
        rows = place.rows
        if "classification" in cloud:
            ground = np.isin(cloud["classification"][rows], list(self.ground_classes))
            if ground.any():
                place, rows = place.of(ground), rows[ground]
        heights = cloud.xyz[rows, 2]
        return medians(place.chainage, heights, self.piece, self.max_gap)

    def _panel(
        self, cloud: PointCloud, section: Section, place: Places, surface: list[Floats]
    ) -> Panel:
        rows = place.rows
        known = "classification" in cloud
        group = cloud["classification"][rows] if known else np.zeros(len(rows), np.uint8)
        xy = np.column_stack([place.chainage, cloud.xyz[rows, 2]])
        length = float(np.hypot(*np.diff(section.line, axis=0).T).sum())
        return Panel(section.title, length, section.origin, xy, group, surface)


class Section(NamedTuple):
    """A line that is cut along.

    Attributes
    ----------
    title : of its drawing
    number : of the line that it belongs to, from 1
    at : where it stands on that line
    origin : what the axis of the drawing says at its beginning
    line : its vertices, of shape (k, 2)
    """

    title: str
    number: int
    at: float
    origin: float
    line: Floats


class Places(NamedTuple):
    """Points of a section: their indices, chainages and offsets, arrays of shape (n,)."""

    rows: Indices
    chainage: Floats
    offset: Floats

    def of(self, which: NDArray[np.bool_]) -> Places:
        """Some of the points."""
        return Places(self.rows[which], self.chainage[which], self.offset[which])


def places_of(
    xy: Floats, lines: Sequence[Floats], half: float, ctx: Context = QUIET
) -> Iterator[Places]:
    """The points of shape (n, 2) within half a width of each line of shape (k, 2), and where.

    Points nearest to an end of a line are beyond it, and left out, unless they are abeam of it.

    Examples
    --------
    >>> line = np.array([[0.0, 0.0], [10.0, 0.0]])
    >>> list(places_of(np.array([[4.0, 0.5], [4.0, 2.0], [11.0, 0.0]]), [line], 1.0))
    [Places(rows=array([0]), chainage=array([4.]), offset=array([0.5]))]
    """
    for number, (line, rows) in enumerate(zip(lines, _beside(xy, lines, half), strict=True)):
        ctx.progress(number / len(lines))
        route = IndexedRoute(Route.of([np.column_stack([line, np.zeros(len(line))])]))
        feet = route.feet(xy[rows], ctx.part(number / len(lines), (number + 1) / len(lines)))
        side, abeam = route.sides(xy[rows], feet)
        _, chainage, _ = route.at(feet)
        inside = (feet.distance <= half) & abeam
        yield Places(rows[inside], chainage[inside], (side * feet.distance)[inside])


def _beside(xy: Floats, lines: Sequence[Floats], half: float) -> Iterator[Indices]:
    """Indices, rising, of the points in cells within half a width of each line: few too many."""
    if not len(xy):
        yield from (np.empty(0, np.intp) for _ in lines)
        return
    cells = SortedCells.of(np.column_stack([xy, np.zeros(len(xy))]), half)
    starts, ends = cells.start[:-1], cells.start[1:]
    margin = half * MARGIN
    low = np.minimum.reduceat(cells.xyz[:, :2], starts) - margin
    high = np.maximum.reduceat(cells.xyz[:, :2], starts) + margin
    boxes: NDArray[Any] = np.asarray(shapely.box(*low.T, *high.T))
    tree = shapely.STRtree(boxes)
    shapes = [shapely.LineString(line) for line in lines]
    number, cell = tree.query(shapes, predicate="dwithin", distance=half)
    for chosen in np.split(cell, np.searchsorted(number, np.arange(1, len(lines)))):
        runs = [
            cells.order[first:last]
            for first, last in zip(starts[chosen], ends[chosen], strict=True)
        ]
        yield np.sort(np.concatenate([np.empty(0, np.intp), *runs]))


def across(line: Floats, every: float) -> Iterator[tuple[float, Floats, Floats]]:
    """Chainage, place and direction of cross-sections on a line of shape (k, 2), from its start.

    >>> [(at, place.tolist()) for at, place, _ in across(np.array([[0.0, 0], [5, 0]]), 2.0)]
    [(0.0, [0.0, 0.0]), (2.0, [2.0, 0.0]), (4.0, [4.0, 0.0])]
    """
    ways = np.diff(line, axis=0)
    lengths = np.hypot(*ways.T)
    ends = np.cumsum(lengths)
    for number in range(int(ends[-1] / every + ENDS) + 1):
        at = min(number * every, float(ends[-1]))
        piece = min(int(np.searchsorted(ends, at, side="right")), len(lengths) - 1)
        way = ways[piece] / lengths[piece]
        yield at, line[piece] + (at - (ends[piece] - lengths[piece])) * way, way


def medians(chainage: Floats, height: Floats, step: float, gap: float) -> list[Floats]:
    """Median height at the middle of each piece of a length, as lines of shape (k, 2).

    Parameters
    ----------
    gap : longest way between two vertices of a line, if they are not neighbours
    """
    if not len(chainage):
        return []
    piece = np.floor(chainage / step).astype(np.int64)
    order = np.lexsort((height, piece))
    pieces, starts, counts = np.unique(piece[order], return_index=True, return_counts=True)
    ranked = height[order]
    low, high = ranked[starts + (counts - 1) // 2], ranked[starts + counts // 2]
    line = np.column_stack([(pieces + 0.5) * step, (low + high) / 2])
    breaks = np.flatnonzero(np.diff(line[:, 0]) > max(gap, 1.5 * step)) + 1
    return [part for part in np.split(line, breaks) if len(part) > 1]


def chainage_text(metres: float) -> str:
    """A chainage as surveyors write it: kilometres, a plus, and metres.

    >>> chainage_text(1234.5)
    '1+234.50'
    """
    kilometres, rest = divmod(round(metres, 2), 1000)
    return f"{int(kilometres)}+{rest:06.2f}"


def _cut(cloud: PointCloud, found: list[Places]) -> PointCloud:
    """The points of all sections, one after the other."""
    number = np.repeat(np.arange(1, len(found) + 1), [len(place.rows) for place in found])
    rows, chainage, offset = (np.concatenate(values) for values in zip(*found, strict=True))
    unit = vertical_unit(cloud.crs)
    said = f", {unit}" if unit else ""
    return cloud.select(rows).with_attributes(
        {"section": number.astype(np.uint16), "chainage": chainage, "offset": offset},
        descriptions={
            "section": "number of the section",
            "chainage": f"along section{said}",
            "offset": f"left of section{said}",
        },
    )


def _layer(
    sections: list[Section], surfaces: list[list[Floats]], points: PointCloud | Survey
) -> Vector:
    """Lines with heights in the CRS, one feature for each section that has a surface."""
    import geopandas

    rows: list[dict[str, Any]] = []
    for number, (section, lines) in enumerate(zip(sections, surfaces, strict=True), start=1):
        if not lines:
            continue
        axis = shapely.LineString(section.line)
        parts = []
        for line in lines:
            places = shapely.get_coordinates(shapely.line_interpolate_point(axis, line[:, 0]))
            parts.append(np.column_stack([places, line[:, 1]]))
        shape = shapely.MultiLineString([shapely.LineString(part) for part in parts])
        rows.append(
            {
                "section": number,
                "line": section.number,
                "at": section.at,
                "title": section.title,
                "geometry": shape,
            }
        )
    columns = ["section", "line", "at", "title", "geometry"]
    frame = geopandas.GeoDataFrame(rows, columns=columns, geometry="geometry", crs=points.crs)
    return Vector(frame, geometry_type="MultiLineString Z")
