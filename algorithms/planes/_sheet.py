"""A sheet with the fronts of a building: walls, openings, dimensions, frame and title block."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import geopandas
import numpy as np
import pandas as pd
import shapely
from numpy.typing import ArrayLike, NDArray

from algorithms.planes import _columns as columns
from algorithms.planes._labels import DIGIT, LETTER, Labels, box_of, reach, shifts
from algorithms.planes._openings import DOOR_HEIGHT, may_hide_door
from toolbox.data import Vector
from toolbox.data.crs import is_local, parse_crs
from toolbox.data.plan import MARGIN, PAPERS, Pen
from toolbox.data.report import guessed

Floats = NDArray[np.float64]
Line = tuple[str, str, str | None]  # of a title block: name, text, what of a set stands there
PENS = {  # mm on paper, the groups of ISO 128
    "frame": Pen(0.7),
    "walls": Pen(0.5),
    "openings": Pen(0.35),
    columns.DATA_EDGE: Pen(0.25, "#555555", dashed=True),
    columns.UNSEEN: Pen(0.13, "#888888"),
    "title": Pen(0.35),
}
AT_EDGE = 1.5  # distances of points: as far from the outline a part that was not seen is at it
INSIDE = 5.0  # mm on paper between the frame and what is drawn
OFF = 0.6  # heights of a text between a chain of dimensions with its texts and the next
WALL = 1.9  # and between a wall and the first of them
WIDEST = 45  # letters that fit into the title block for what a set says of itself
ROW = 1.8  # heights of a text from one line of the title block to the next
SMALL = 0.72  # height of levels over that of other texts: 1.8 mm, the least of ISO 3098, for 2.5
MILLIMETRES = 1000.0  # in a metre


class Sheet:
    """A drawing in the making, in the unit of the elevation.

    Parameters
    ----------
    paper : a name in `PAPERS`
    mm : of paper, in the unit of the elevation
    size : height of texts
    rounding : step of dimensions
    metre : in the unit of the elevation
    shown : numbers in dimensions are metres times this
    """

    def __init__(
        self, paper: str, mm: float, size: float, rounding: float, metre: float, shown: float
    ) -> None:
        self.paper, self.mm = paper, mm
        self.size, self.rounding, self.metre, self.shown = size, rounding, metre, shown
        self.rows: list[dict[str, Any]] = []
        self.shapes: list[Any] = []
        self.starred = False
        self.fits = True

    def front(self, wall: Any, openings: geopandas.GeoDataFrame, unseen: list[Any]) -> None:
        """Draw a front with its openings and their dimensions, and what was not seen of it."""
        outline = shapely.unary_union([wall.geometry, *openings.geometry])
        left, bottom, right, top = outline.bounds
        self._outline(outline, unseen, AT_EDGE * getattr(wall, "spacing", 0.0))
        for one in openings.itertuples():
            self._opening(one)
        for part in unseen:
            self._unseen(part, may_hide_door(part, outline, self.metre))
        zero = np.array([left, bottom])
        boxes = zero[[0, 1, 0, 1]] + rounded(openings.geometry.bounds, zero, self.rounding)
        right, top = zero + rounded(np.array([right, top]), zero, self.rounding)
        vague = vague_places(openings, boxes)
        self._labels(openings, boxes, vague, bottom, [outline.boundary, *openings.boundary])
        name = f"Front {int(wall.front_id)}"
        if np.isfinite(foot := getattr(wall, "corner_z", np.nan) + bottom * _upright(wall)):
            unit = "m" if self.shown == 1 else "mm"
            name = f"{name}, 0 = height {self._number(foot)} {unit} of the points"
        self._text("numbers", name, (left + right) / 2, top + (WALL + 0.5) * self.size)
        numbers = openings["opening_id"].to_numpy(np.int64)
        self._rows_below(boxes, vague, numbers, left, bottom, right)
        column = leftmost(boxes)
        places = ends(boxes[column][:, [1, 3]], bottom, top)
        chains = [places] if len(places) <= 2 else [places, places[[0, -1]]]
        x, gap = left, WALL
        for chain in chains:
            texts = self._lengths(chain, vague[column][:, [1, 3]] if len(chain) > 2 else ())
            moved = shifts(chain, texts, self.size)
            above, below = reach(moved)
            x -= (gap + below) * self.size
            self._chain(chain, x, texts, moved, along=1)
            gap = above + OFF

    def _unseen(self, part: Any, door: bool) -> None:
        """Cross out a part that was not seen, and say whether it may hide a door."""
        self._add(columns.UNSEEN, shapely.LineString(part.exterior.coords))
        for across in crossed(part):
            self._add(columns.UNSEEN, across)
        if door:
            left, bottom, right, _ = part.bounds
            low = shapely.box(left, bottom, right, bottom + DOOR_HEIGHT * self.metre)
            x, y = shapely.maximum_inscribed_circle(part & low).coords[0]
            self._text(columns.UNSEEN, "door?", x, y, size=SMALL * self.size)

    def _outline(self, outline: Any, unseen: list[Any], near: float) -> None:
        """Draw the edges of a wall, and broken those of the data: along what was not seen."""
        hidden = shapely.union_all(unseen).buffer(near) if unseen else shapely.Polygon()
        for part in shapely.get_parts(outline):
            line = shapely.LineString(part.exterior.coords)
            for name, drawn in (("walls", line - hidden), (columns.DATA_EDGE, line & hidden)):
                for piece in _lines(drawn):
                    self._add(name, piece)

    def _opening(self, one: Any) -> None:
        """Draw an opening; sides that are unsure or were not seen are broken lines."""
        vague = unsure_sides(one)
        self.starred |= bool(vague)
        edges = edges_of(one.geometry)
        broken = shapely.union_all([edges[side] for side in sorted(vague)])
        sure = shapely.union_all(list(edges.values())) - broken
        for layer, drawn in (("openings", sure), (columns.DATA_EDGE, broken)):
            for piece in _lines(drawn):
                self._add(layer, piece)

    def _labels(
        self,
        openings: geopandas.GeoDataFrame,
        boxes: Floats,
        vague: Floats,
        zero: float,
        lines: list[Any],
    ) -> None:
        """Write into each opening its number, and the heights of sill and head above a zero."""
        labels, size = Labels(lines), SMALL * self.size
        for one, (left, bottom, right, top) in zip(openings.itertuples(), boxes, strict=True):
            text = f"{one.opening_id}{'*' if unsure_sides(one) else ''}"
            x, y = (left + right) / 2, (bottom + top) / 2
            inner = shapely.maximum_inscribed_circle(one.geometry).coords[0]
            aside = (LETTER * len(text) / 2 + 0.5) * self.size
            places = [(x, y), inner, (right + aside, y), (left - aside, y)]
            self._text("numbers", text, *labels.place(text, self.size, places))
        for (left, bottom, right, top), unsure in zip(boxes, vague, strict=True):
            for level, inwards in ((bottom, size), (top, -size)):
                value = f"{'+' if level > zero else ''}{self._number(level - zero)}"
                value = guessed(value) if level in unsure[[1, 3]] else value
                along = [(left * (1 - k) + right * k) for k in (0.5, 0.25, 0.75)]
                places = [(x, level + up) for up in (inwards, -inwards) for x in along]
                x, y = labels.place(value, size, places)
                self._text("levels", value, x, y, size=size)

    def _rows_below(
        self,
        boxes: Floats,
        vague: Floats,
        numbers: NDArray[np.int64],
        left: float,
        low: float,
        right: float,
    ) -> None:
        """Dimensions of each row of openings with their numbers, and the whole length, below."""
        gap = OFF + 0.6
        for row in [*rows_of(boxes), None]:
            inner, unsure = (
                np.empty((0, 2)) if row is None else of[row][:, [0, 2]] for of in (boxes, vague)
            )
            places = ends(inner, left, right)
            texts = self._lengths(places, unsure)
            moved = shifts(places, texts, self.size)
            above, below = reach(moved)
            low -= (gap + above) * self.size
            self._chain(places, low, texts, moved, along=0)
            if row is not None:
                name = ", ".join(map(str, numbers[row[np.argsort(boxes[row, 0])]]))
                self._text("dimensions", name, left - (DIGIT * len(name) / 2 + 1) * self.size, low)
            gap = below + OFF

    def _lengths(self, places: Floats, vague: ArrayLike) -> list[str]:
        """Distances between places; "ca." before those with an end among the vague places."""
        numbers = [self._number(other - one) for one, other in pairwise(places)]
        ends_in = pairwise(np.isin(places, vague))
        return [guessed(n) if any(two) else n for n, two in zip(numbers, ends_in, strict=True)]

    def _chain(
        self, places: Floats, across: float, texts: list[str], moved: list[float], *, along: int
    ) -> None:
        """A line of dimensions, with a stroke at each place and the distances between."""
        for (one, other), text, shift in zip(pairwise(places), texts, moved, strict=True):
            line = [_at(p, across, along) for p in (one, other)]
            self._add(
                "dimensions",
                shapely.LineString(line),
                text=text,
                text_height=self.size,
                shift=shift,
            )

    def _number(self, length: float) -> str:
        """A length between rounded places, as it stands in the drawing."""
        value = round(length / self.rounding) * self.rounding / self.metre * self.shown
        digits = max(0, math.ceil(-math.log10(self.rounding / self.metre * self.shown) - 1e-9))
        return f"{value:.{digits}f}"

    def finish(self, head: list[Line], notes: list[tuple[str, str]]) -> None:
        """Put a frame around all, with the title block in its corner and the notes beside it.

        Parameters
        ----------
        head : name, text, and which text of the head of a set stands there if there is one
        notes : name and text
        """
        west, south, east, north = shapely.total_bounds(np.array([*self.shapes, *self._boxes()]))
        wide, high = (self.mm * (side - 2 * MARGIN) for side in PAPERS[self.paper])
        blocks: list[list[Line]] = [[(name, text, None) for name, text in notes], head]
        strip = max(map(len, blocks)) * ROW * self.size
        left = (west + east - wide) / 2
        low = (south + north - (high - strip)) / 2 - strip
        right, inside = left + wide, 2 * INSIDE * self.mm
        for rows in reversed(blocks):
            right -= self._block(rows, right, low)
        self.fits = bool(
            east - west <= wide - inside
            and north - south <= high - strip - inside
            and right >= left - 1e-9 * wide
        )
        self._add("frame", shapely.box(left, low, left + wide, low + high).exterior)

    def _block(self, rows: list[Line], right: float, low: float) -> float:
        """Draw a table whose lower right corner is given; its width."""
        first = (LETTER * max(len(name) for name, *_ in rows) + 2) * self.size
        longest = max(max(len(text), WIDEST if about else 0) for _, text, about in rows)
        width = first + (LETTER * longest + 1) * self.size
        top, left = low + len(rows) * ROW * self.size, right - width
        for number, (name, text, about) in enumerate(rows):
            line = top - number * ROW * self.size
            self._add("title", shapely.LineString([(left, line), (right, line)]))
            middle = line - 0.5 * ROW * self.size
            self._text("title", name, left + self.size, middle, anchor="left")
            if text or about:
                x = left + first + 0.5 * self.size
                self._text("title", text or None, x, middle, anchor="left", about=about)
        for x in (left, left + first):
            self._add("title", shapely.LineString([(x, top), (x, low)]))
        return width

    def _boxes(self) -> list[Any]:
        """The room that the texts take so far."""
        made = []
        for row, shape in zip(self.rows, self.shapes, strict=True):
            if "text" in row:
                (x, y), (_, up) = shape.centroid.coords[0], (0.0, row.get("shift", 0.0))
                ends_at = shapely.get_coordinates(shape)
                upright = len(ends_at) == 2 and ends_at[0, 0] == ends_at[1, 0]
                x, y = (x - up * self.size, y) if upright else (x, y + up * self.size)
                made.append(
                    box_of(row["text"], x, y, row["text_height"], angle=90.0 if upright else 0.0)
                )
        return made

    def _text(
        self,
        layer: str,
        text: str | None,
        x: float,
        y: float,
        size: float | None = None,
        **more: Any,
    ) -> None:
        high = self.size if size is None else size
        more = {"text": text, "angle": 0.0, "text_height": high, **more}
        self._add(layer, shapely.Point(x, y), **more)

    def _add(self, layer: str, shape: Any, **more: Any) -> None:
        self.rows.append({"layer": layer, **more})
        self.shapes.append(shape)

    def layer(self, elevation: Vector) -> Vector:
        """The drawing in metres or millimetres, if the unit of the elevation is known."""
        names = list(columns.DRAWING)
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


def unsure_sides(opening: Any) -> set[str]:
    """Sides of an opening that are unsure or were not seen; no door has wall below it."""
    said = (getattr(opening, name, None) for name in ("unsure", "hidden"))
    sides = {side for text in said if isinstance(text, str) and text for side in text.split(", ")}
    return sides - ({"bottom"} if opening.kind == "door" else set())


def edges_of(shape: Any) -> dict[str, Any]:
    """The edges at each side of a polygon: those that face it, or end at it if none does.

    Examples
    --------
    >>> slanted = shapely.Polygon([(0, 0), (3, 0), (3, 1), (0, 2)])
    >>> {side: edges.length for side, edges in edges_of(slanted).items()}["left"]
    2.0
    """
    ring = np.array(shapely.orient_polygons(shape).exterior.coords)
    ends = np.stack([ring[:-1], ring[1:]], axis=1)
    step = ends[:, 1] - ends[:, 0]
    outwards = np.column_stack([step[:, 1], -step[:, 0]])
    facing = np.abs(outwards).argmax(axis=1)
    facing += 2 * (np.take_along_axis(outwards, facing[:, None], axis=1)[:, 0] > 0)
    found = {}
    for side, name in enumerate(columns.SIDES):
        own = facing == side
        if not own.any():
            own = (ends[:, :, side % 2] == shape.bounds[side]).any(axis=1)
        found[name] = shapely.multilinestrings(shapely.linestrings(ends[own]))
    return found


def _lines(shape: Any) -> list[Any]:
    """The lines of a shape, those that only meet joined."""
    merged = shapely.line_merge(shape)
    return [line for line in shapely.get_parts(merged).tolist() if line.geom_type == "LineString"]


def _upright(wall: Any) -> float:
    """How far up in space one goes along a front's own height."""
    return float(getattr(wall, "up_z", 1.0))


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


def leftmost(boxes: Floats) -> NDArray[np.bool_]:
    """Which openings are above or below the one that ends farthest to the left.

    Parameters
    ----------
    boxes : array of shape (n, 4), bounds of the openings

    Examples
    --------
    >>> leftmost(np.array([[0, 0, 1, 2], [2, 1, 3, 2], [0.5, 3, 2, 4.0]])).tolist()
    [True, False, True]
    """
    if not len(boxes):
        return np.zeros(0, bool)
    first = boxes[np.argmin(boxes[:, 2])]
    return np.asarray((boxes[:, 0] < first[2]) & (boxes[:, 2] > first[0]))


def vague_places(openings: geopandas.GeoDataFrame, boxes: Floats) -> Floats:
    """The bounds of openings at sides that are unsure or were not seen; NaN at the others.

    Parameters
    ----------
    boxes : array of shape (n, 4), bounds of the openings as they are drawn
    """
    sides = [[side in unsure_sides(one) for side in columns.SIDES] for one in openings.itertuples()]
    return np.where(np.reshape(np.array(sides, bool), (-1, 4)), boxes, np.nan)


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
