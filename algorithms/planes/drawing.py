"""Drawing of all fronts of a building: walls, openings, dimensions, title block."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, Literal

import geopandas
import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from algorithms.planes import _columns as columns
from toolbox.context import QUIET, Context
from toolbox.data import Table, Vector
from toolbox.data.crs import is_local, parse_crs
from toolbox.declare import outputs, param, sink, source, tool

Floats = NDArray[np.float64]
NEEDED = ("kind", "front_id", "opening_id", "width", "height", "sill")
TICK = 0.6  # of the height of a text: half of the stroke that ends a dimension line
OFF = 2.5  # heights of a text from the wall to the first line of dimensions, and to the next
ROW = 1.8  # heights of a text from one line of the title block to the next
SHOWN_DIGITS = 3  # of a certainty
SMALL = 0.6  # height of the levels in an opening over that of other texts
LETTER = 0.7  # width of a letter over its height
MILLIMETRES = 1000.0  # in a metre


@tool(
    "planes.drawing",
    title="Drawing of fronts",
    tags=(
        "facade",
        "drawing",
        "dxf",
        "dimension",
        "elevation",
        "title-block",
        "window",
        "schedule",
    ),
)
class PlanesDrawing:
    """Draw all fronts with their openings, dimensions and a title block.

    Write it as .dxf: a layer each for walls, openings, dimensions, numbers and the title block, in
    metres or millimetres as asked. Parts of a front without points of its wall are crossed out on a
    layer of their own, `unseen`. A star at the number of an opening tells that some of its sides
    were not seen and may be elsewhere. Below each front stand, row by row, the widths of the
    openings and the piers between them, with the numbers of the openings at its left, and its whole
    length; to the left sills and heads of the openings that are farthest to the left, and its whole
    height. In each opening stand its number and the levels of sill and head above the lowest point
    of the front. Places are rounded to `rounding` from the lower left corner of the front, so that
    dimensions add up. The title block says how far apart the points are.

    The table lists the openings with place, width, height and sill in millimetres, front by front,
    with the figures of the drawing, and how sure an edge can be: as the points are apart. Of each
    front `areas` has the area within its outline, and what of it is openings, wall and not seen.
    """

    elevation: Vector = source("Elevation by planes.openings")
    unit: Literal["m", "mm"] = param(
        "Unit of the drawing", default="m", words={"m": "Metres", "mm": "Millimetres"}
    )
    text_height: float = param("Height of the labels", default=0.2, unit="m", gt=0, le=100)
    rounding: float = param(
        "Step to which dimensions are rounded", default=0.01, unit="m", gt=0, le=1, label="Rounding"
    )
    subject: str | None = param(
        "What is drawn, for the title block", default=None, label="Subject of the drawing"
    )

    @outputs
    class Outputs:
        drawing: Vector = sink(
            "Walls, openings, dimensions and texts, with a layer each", columns=columns.DRAWING
        )
        schedule: Table = sink(
            "Openings with front, kind, width, height and sill", columns=columns.SCHEDULE
        )
        areas: Table = sink("Areas of each front, which add up", columns=columns.AREAS)

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The elevation is one of planes.openings."""
        if missing := [name for name in NEEDED if name not in self.elevation.names]:
            yield (
                "elevation",
                f"has no attribute {', '.join(missing)}; take that of planes.openings",
            )

    def halo(self) -> float:
        """Infinite, as all fronts are on one sheet."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> PlanesDrawing.Outputs:
        """Draw front by front, then the title block."""
        ctx.progress(0.0)
        frame = self.elevation.frame
        metre = self.elevation.metre
        sheet = Sheet(
            self.text_height, self.rounding, metre, 1 if self.unit == "m" else MILLIMETRES
        )
        walls = frame[frame["kind"] == "facade"]
        for wall in walls.itertuples():
            here = frame[frame["front_id"] == wall.front_id]
            bare = here.loc[here["kind"] == columns.UNSEEN].geometry.tolist()
            sheet.front(int(wall.front_id), wall.geometry, _openings(here), bare)
        if len(walls):
            sheet.title_block(
                self.subject or "Fronts of the building",
                len(walls),
                self.unit,
                float(walls["spacing"].max()) if "spacing" in walls else None,
                (frame["kind"] == columns.UNSEEN).any(),
            )
        return self.Outputs(
            drawing=sheet.layer(self.elevation),
            schedule=schedule(frame, self.rounding, metre),
            areas=areas(frame, metre),
        )


class Sheet:
    """A drawing in the making, in the unit of the elevation.

    Parameters
    ----------
    size : height of texts
    rounding : step of dimensions
    metre : in the unit of the elevation
    shown : numbers in dimensions are metres times this
    """

    def __init__(self, size: float, rounding: float, metre: float, shown: float) -> None:
        self.size, self.rounding, self.metre, self.shown = size, rounding, metre, shown
        self.rows: list[dict[str, Any]] = []
        self.shapes: list[Any] = []
        self.starred = False

    def front(
        self, number: int, wall: Any, openings: geopandas.GeoDataFrame, unseen: list[Any]
    ) -> None:
        """Draw a front with its openings and their dimensions, and what was not seen of it."""
        outline = shapely.unary_union([wall, *openings.geometry])
        left, bottom, right, top = outline.bounds
        for part in shapely.get_parts(outline):
            self._add("walls", shapely.LineString(part.exterior.coords))
        for one in openings.itertuples():
            self._add("openings", shapely.LineString(one.geometry.exterior.coords))
            star = "*" if _unsure(one) else ""
            self.starred |= bool(star)
            self._text("numbers", f"{one.opening_id}{star}", *_middle(one.geometry))
        for part in unseen:
            self._add(columns.UNSEEN, shapely.LineString(part.exterior.coords))
            for across in crossed(part):
                self._add(columns.UNSEEN, across)
        self._text("numbers", f"Front {number}", (left + right) / 2, top + OFF * self.size)
        zero = np.array([left, bottom])
        boxes = zero[[0, 1, 0, 1]] + rounded(openings.geometry.bounds, zero, self.rounding)
        right, top = zero + rounded(np.array([right, top]), zero, self.rounding)
        self._levels(boxes, bottom)
        near = OFF * self.size
        numbers = openings["opening_id"].to_numpy(np.int64)
        low, rows = bottom, rows_of(boxes)
        for row in rows:
            low -= near
            self._chain(ends(boxes[row][:, [0, 2]], left, right), low, along=0)
            name = ", ".join(map(str, numbers[row[np.argsort(boxes[row, 0])]]))
            self._text("dimensions", name, left - (LETTER * len(name) / 2 + 1) * self.size, low)
        self._chain(np.array([left, right]), low - near, along=0)
        column = levels(boxes, bottom, top)
        self._chain(column, left - near, along=1)
        if len(column) > 2:
            self._chain(column[[0, -1]], left - 2 * near, along=1)

    def _levels(self, boxes: Floats, zero: float) -> None:
        """The heights of sill and head above the zero of the front, within each opening."""
        size = SMALL * self.size
        for left, bottom, right, top in boxes:
            for level, inwards in ((bottom, size), (top, -size)):
                value = f"{'+' if level > zero else ''}{self._number(level - zero)}"
                self._text("levels", value, (left + right) / 2, level + inwards, size=size)

    def _chain(self, places: Floats, across: float, *, along: int) -> None:
        """A line of dimensions, with a stroke at each place and the distances between."""
        self._add(
            "dimensions", shapely.LineString([_at(p, across, along) for p in places[[0, -1]]])
        )
        tick = TICK * self.size
        for place in places:
            x, y = _at(place, across, along)
            self._add(
                "dimensions", shapely.LineString([(x - tick, y - tick), (x + tick, y + tick)])
            )
        for one, other in pairwise(places):
            x, y = _at(
                (one + other) / 2, across + 0.8 * self.size * (1 if along == 0 else -1), along
            )
            self._text("dimensions", self._number(other - one), x, y, angle=90.0 * along)

    def _number(self, length: float) -> str:
        """A length between rounded places, as it stands in the drawing."""
        value = round(length / self.rounding) * self.rounding / self.metre * self.shown
        digits = max(0, math.ceil(-math.log10(self.rounding / self.metre * self.shown) - 1e-9))
        return f"{value:.{digits}f}"

    def title_block(
        self, subject: str, fronts: int, unit: str, spacing: float | None, bare: bool
    ) -> None:
        """A frame at the lower right with what is drawn, in which unit, and how exactly.

        Parameters
        ----------
        spacing : distance of points on the walls, in the unit of the elevation
        bare : whether some of the walls were not seen
        """
        west, south, east, _ = shapely.total_bounds(np.array(self.shapes, object))
        step = self.rounding / self.metre * self.shown
        lines = [
            subject,
            f"Elevation of {fronts} front{'s' if fronts != 1 else ''}, outside",
            f"Dimensions in {unit}, rounded to {step:g} {unit}",
            "From points of a laser scan",
        ]
        if bare:
            lines.append("Crossed out: no point of the wall was seen there")
        if self.starred:
            lines.append("* some sides were not seen and may be elsewhere: see the schedule")
        if spacing is not None:
            apart = f"{spacing / self.metre * self.shown:.{0 if unit == 'mm' else 2}f} {unit}"
            lines.append(f"Points {apart} apart: no edge is surer than that")
        width = LETTER * self.size * max(map(len, lines)) + 2 * self.size
        top, height = south - 2 * OFF * self.size, (len(lines) + 1) * ROW * self.size
        right = max(east, west + width)
        self._add(
            "title",
            shapely.LineString(
                shapely.box(right - width, top - height, right, top).exterior.coords
            ),
        )
        for number, text in enumerate(lines, start=1):
            self._text("title", text, right - width / 2, top - number * ROW * self.size)

    def _text(
        self,
        layer: str,
        text: str,
        x: float,
        y: float,
        *,
        angle: float = 0.0,
        size: float | None = None,
    ) -> None:
        high = self.size if size is None else size
        self._add(layer, shapely.Point(x, y), text=text, angle=angle, text_height=high)

    def _add(self, layer: str, shape: Any, **more: Any) -> None:
        self.rows.append({"layer": layer, **more})
        self.shapes.append(shape)

    def layer(self, elevation: Vector) -> Vector:
        """The drawing in metres or millimetres, if the unit of the elevation is known."""
        names = ["layer", "text", "angle", "text_height"]
        frame = geopandas.GeoDataFrame(
            pd.DataFrame(self.rows, columns=names), geometry=self.shapes, crs=elevation.crs
        )
        if elevation.crs is not None and is_local(elevation.crs):
            factor = self.shown / self.metre
            moved = shapely.transform(frame.geometry.to_numpy(), lambda xy: xy * factor)
            crs = parse_crs("local" if self.shown == 1 else "local:mm")
            frame = frame.assign(text_height=frame["text_height"] * factor)
            frame = frame.set_geometry(moved).set_crs(crs, allow_override=True)
        return Vector(frame, name="drawing", geometry_type="Unknown")


def _unsure(opening: Any) -> bool:
    """Whether sides of an opening were not seen; no door has wall below it."""
    hidden = getattr(opening, "hidden", None)
    sides = set(hidden.split(", ")) if isinstance(hidden, str) and hidden else set()
    return bool(sides - ({"bottom"} if opening.kind == "door" else set()))


def crossed(part: Any) -> list[Any]:
    """Lines from corner to corner of the box around a polygon, within it."""
    left, bottom, right, top = part.bounds
    lines = shapely.linestrings(
        [[(left, bottom), (right, top)], [(left, top), (right, bottom)]],
    )
    inside = shapely.get_parts(shapely.intersection(lines, part))
    return [line for line in inside.tolist() if line.geom_type == "LineString"]


def _at(place: float, across: float, along: int) -> tuple[float, float]:
    return (place, across) if along == 0 else (across, place)


def _middle(shape: Any) -> tuple[float, float]:
    left, bottom, right, top = shape.bounds
    return (left + right) / 2, (bottom + top) / 2


def rows_of(boxes: Floats) -> list[NDArray[np.int64]]:
    """Indices of the openings of each row, from the lowest up.

    To a row belong those that reach into the height of the one whose head is the lowest.

    Parameters
    ----------
    boxes : array of shape (n, 4), bounds of the openings

    Examples
    --------
    >>> [row.tolist() for row in rows_of(np.array([[0, 0, 1, 2], [2, 1, 3, 2], [0, 3, 1, 4.0]]))]
    [[0, 1], [2]]
    """
    rows, left = [], np.arange(len(boxes))
    while len(left):
        lowest = boxes[left[np.argmin(boxes[left, 3])]]
        here = (boxes[left, 1] < lowest[3]) & (boxes[left, 3] > lowest[1])
        rows.append(left[here])
        left = left[~here]
    return rows


def ends(pairs: Floats, first: float, last: float) -> Floats:
    """Where openings begin and end, of shape (n, 2), with the ends of what they lie in."""
    return np.unique(np.append(pairs, [first, last]))


def levels(boxes: Floats, bottom: float, top: float) -> Floats:
    """Heights of sills and heads of the openings farthest to the left, with foot and top.

    Parameters
    ----------
    boxes : array of shape (n, 4), bounds of the openings
    """
    if not len(boxes):
        return np.array([bottom, top])
    first = boxes[np.argmin(boxes[:, 2])]
    column = boxes[(boxes[:, 0] < first[2]) & (boxes[:, 2] > first[0])]
    return ends(column[:, [1, 3]], bottom, top)


def rounded(places: Any, zero: Floats, step: float) -> Floats:
    """Places less a zero in whole steps: distances between such add up to the whole.

    Parameters
    ----------
    places : array of shape (..., 2 k): right and up by turns
    zero : of shape (2,)

    Examples
    --------
    >>> rounded(np.array([[1.004, 0.0, 2.008, 2.1]]), np.zeros(2), 0.01).round(6).tolist()
    [[1.0, 0.0, 2.01, 2.1]]
    """
    less = np.asarray(places, float) - np.resize(zero, np.shape(places)[-1])
    return np.asarray(np.round(less / step) * step)


def _openings(frame: geopandas.GeoDataFrame) -> geopandas.GeoDataFrame:
    return frame[~frame["kind"].isin(["facade", columns.UNSEEN])]


def schedule(frame: geopandas.GeoDataFrame, step: float, metre: float) -> Table:
    """Table of the openings of an elevation, lengths in millimetres, in steps as in its drawing."""
    found = _openings(frame)
    places = np.empty((len(found), 4))
    for number, front in frame[frame["kind"] != columns.UNSEEN].groupby("front_id"):
        here = (found["front_id"] == number).to_numpy()
        places[here] = rounded(found.geometry.bounds[here], front.total_bounds[:2], step)
    left, bottom, right, top = (places / metre * MILLIMETRES).round().astype("int64").T
    sill = rounded(found[["sill", "sill"]].to_numpy(float), np.zeros(2), step)[:, 0]
    rows = pd.DataFrame(
        {
            "front_id": found["front_id"].astype("int64"),
            "opening_id": found["opening_id"].astype("int64"),
            "kind": found["kind"].astype(str),
            "left_mm": left,
            "level_mm": bottom,
            "width_mm": right - left,
            "height_mm": top - bottom,
            "sill_mm": (sill / metre * MILLIMETRES).round().astype("int64"),
        }
    )
    if "spacing" in frame:
        apart = frame[frame["kind"] == "facade"].set_index("front_id")["spacing"]
        edge = found["front_id"].map(apart) / metre * MILLIMETRES
        rows["edge_mm"] = edge.round().astype("Int64")
    if "set_back" in found:  # not known where nothing was seen in an opening
        back = found["set_back"].astype(float) / metre * MILLIMETRES
        rows["set_back_mm"] = back.round().astype("Int64")
    if "hidden" in found:
        rows["hidden"] = found["hidden"]
    if "certainty" in found:
        rows["certainty"] = found["certainty"].astype(float).round(SHOWN_DIGITS)
    return Table(rows)


def areas(frame: geopandas.GeoDataFrame, metre: float) -> Table:
    """Table of the fronts of an elevation: openings, wall and what was not seen make up the whole.

    Square metres, rounded before they are summed.
    """
    rows = []
    for wall in frame[frame["kind"] == "facade"].itertuples():
        here = frame[frame["front_id"] == wall.front_id]
        openings = shapely.union_all(_openings(here).geometry)
        whole = shapely.union_all([wall.geometry, openings])
        unseen = shapely.union_all(here.geometry[here["kind"] == columns.UNSEEN])
        bare = shapely.intersection(unseen, whole) - openings
        parts = {"openings": openings, "wall": whole - openings - bare, "unseen": bare}
        sizes = {f"{name}_m2": round(part.area / metre**2, 2) for name, part in parts.items()}
        gross = round(sum(sizes.values()), 2)
        rows.append({"front_id": int(wall.front_id), "gross_m2": gross, **sizes})
    return Table(pd.DataFrame(rows, columns=list(columns.AREAS)))
