"""Openings in the picture of a front: regions that stand back, and rectangles around them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from algorithms.planes._bands import is_slim
from algorithms.planes._relief import BEHIND, EMPTY, HIDDEN, WALL, Relief

BRIDGE = 2  # squares without echoes that do not part a region
UNSEEN = 0.02  # what a square without echoes takes from a rectangle; one of the wall takes 1
REACH = 3  # squares by which a rectangle may be larger than its region, and beside which is wall
FULL = 0.8  # share of a rectangle, as far as it is seen, that is not wall; of its region inside
STRAY = (0.02, 0.98)  # quantiles of the squares of a region between which its box lies
CORNER = 0.15  # side of a corner over the shorter side of the box
CORNER_WALL = 0.7  # share of a corner that is wall, if the region is round or pointed there
BESIDE = 0.4  # share of a side along which there is wall
ENCLOSED = 0.8  # share of each of its sides along which there is wall
REVEAL = 0.3  # share of a side, beside which something stands back, if there is a reveal
SAME = 1.5  # squares by which sides of openings in one row or column differ at most
UNSEEN_IN = "nothing seen in it"
TOO_WIDE = "too wide or too high"
NOT_BETWEEN = "not between parts of the wall"

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Limits = tuple[float, float, float]  # least width and height, largest width, largest height
Box = tuple[int, int, int, int]  # first row and column, and those after the last


class Gap(NamedTuple):
    """A region of a front that is not wall.

    Attributes
    ----------
    shape : rectangle of it, or the squares of it if it is none, on the front
    rectangle : whether it is one
    found_by : behind (something stands back in it), outline (little is seen in it, but wall on
        all sides of a level rectangle) or grid (its sides are those of others)
    dropped : why it is no opening; empty if it is one
    pure : share of the squares in it that stand back, of those and the wall
    beside : share of its left, lower, right and upper side along which there is wall
    """

    shape: Any
    rectangle: bool
    found_by: str
    dropped: str
    pure: float
    beside: tuple[float, float, float, float]


def gaps(
    relief: Relief, *, min_width: float, max_width: float, tallest: float, recess: float
) -> list[Gap]:
    """Regions of a front that stand back or hold no points, from left to right.

    Lengths are in the unit of the points.

    Parameters
    ----------
    recess : farthest that panes stand back, and so the depth of reveals
    """
    limits = (min_width, max_width, tallest)
    made = [*_behind(relief, limits), *_empty(relief, limits, recess)]
    found = _apart([gap for gap in made if not gap.dropped])
    known = np.array([gap.shape.bounds for gap in found]).reshape(-1, 4)
    whole = shapely.union_all([gap.shape for gap in found])
    made = found + [
        _by_grid(gap, known, SAME * relief.side)
        for gap in made
        if gap.dropped and gap.shape.intersection(whole).area <= gap.shape.area / 2
    ]
    return sorted(made, key=lambda gap: gap.shape.bounds)


def too_large(gap: Gap) -> bool:
    """Whether a gap is no opening for its size alone: a rectangle with wall on three sides.

    A strip between two parts of a wall has it on two.
    """
    walls = sum(share >= BESIDE for share in gap.beside)
    return gap.dropped == TOO_WIDE and gap.rectangle and walls >= 3


def _apart(found: list[Gap]) -> list[Gap]:
    """Those of several gaps that do not lie in a larger one, or in the same as one before."""
    kept: list[Gap] = []
    for gap in sorted(found, key=lambda gap: -gap.shape.area):
        if all(gap.shape.intersection(one.shape).area <= gap.shape.area / 2 for one in kept):
            kept.append(gap)
    return kept


def _behind(relief: Relief, limits: Limits) -> Iterator[Gap]:
    """Regions where something stands back."""
    back = relief.states == BEHIND
    wide = ndimage.binary_dilation(back, iterations=BRIDGE // 2) & (relief.states != WALL)
    hidden = relief.states == HIDDEN
    holes = np.asarray(ndimage.label(np.isin(relief.states, (EMPTY, BEHIND)))[0], np.int64)
    for seen in _regions(wide, back):
        box = _box(seen)
        if max(box[2] - box[0], box[3] - box[1]) * relief.side < limits[0]:
            continue  # a strip or a speck
        whole = _completed(seen, holes, hidden)
        best = _best(relief, [whole] if whole is seen else [whole, seen], limits)
        hole = holes == np.bincount(holes[seen]).argmax()
        if whole is seen and (best.dropped or _as_high(box, _box(hole))):
            neat = _neat(relief, hole, limits)
            if neat and 2 * seen.sum() < hole.sum():
                neat = neat._replace(found_by="outline")
            best = neat or best
        parts = []
        if best.dropped == TOO_WIDE:
            parts = _parted(seen, relief.states == EMPTY, limits[0] / relief.side)
        made = [_best(relief, [part], limits) for part in parts]
        made = [
            gap
            if gap.dropped or _between(gap) or _in_band(gap.shape, gap.beside, limits[1])
            else gap._replace(dropped=NOT_BETWEEN)
            for gap in made
        ]
        yield from made if sum(not gap.dropped for gap in made) > 1 else [best]


def _between(gap: Gap) -> bool:
    """Whether wall lies beside a region on both sides and above."""
    return min(gap.beside[0], gap.beside[2], gap.beside[3]) >= BESIDE


def _in_band(shape: Any, beside: tuple[float, ...], widest: float) -> bool:
    """Whether a gap is a band of windows: low, with wall along its upper and its lower side."""
    left, bottom, right, top = shape.bounds
    return is_slim(right - left, top - bottom, widest) and min(beside[1], beside[3]) >= ENCLOSED


def _best(relief: Relief, regions: list[Mask], limits: Limits) -> Gap:
    """The first of several regions that may be an opening, or the last."""
    judged = [
        _judged(relief, region, _fitted(region, relief.states, _box(region)), limits)
        for region in regions
    ]
    return next((gap for gap in judged if not gap.dropped), judged[-1])


def _as_high(seen: Box, hole: Box) -> bool:
    """Whether a hole is as high as what is seen in it, of which its sides may hide a part.

    A hole that is higher may be the board above a shop and the shop.
    """
    return max(abs(seen[0] - hole[0]), abs(seen[2] - hole[2])) <= BRIDGE


def _neat(relief: Relief, hole: Mask, limits: Limits) -> Gap | None:
    """A hole of the wall as an opening by its outline, if it is a rectangle with wall all around.

    Half of the squares along its sides may belong to either.
    """
    first, left, last, right = box = _fitted(hole, relief.states, _box(hole))
    gap = _judged(relief, hole, box, limits)
    # A board: bands are told by what is in them.
    wide = (right - left - 1) * relief.side > limits[1]
    if gap.dropped or wide or not gap.rectangle or min(gap.beside) < ENCLOSED:
        return None
    inside = np.zeros_like(hole)
    inside[first:last, left:right] = True
    return gap if (hole ^ inside).sum() <= last - first + right - left else None


def _has_reveal(relief: Relief, gap: Gap, recess: float) -> bool:
    """Whether something stands back along a side of a rectangle, as in no shadow and no cut.

    Boards and pictures that were cut out of a scan leave rectangles as neat as openings.
    """
    low, high = np.array(gap.shape.bounds).reshape(2, 2)
    back = (relief.behind > relief.step) & (relief.behind <= recess)
    rim = SAME * relief.side
    near = relief.uv[back & ((relief.uv > low - rim) & (relief.uv < high + rim)).all(axis=1)]
    for axis in (0, 1):
        for end in (low[axis], high[axis]):
            beside = near[np.abs(near[:, axis] - end) <= rim, 1 - axis]
            held = np.unique(np.floor((beside - low[1 - axis]) / relief.side))
            if len(held) * relief.side >= REVEAL * (high - low)[1 - axis]:
                return True
    return False


def _parted(region: Mask, empty: Mask, width: float) -> list[Mask]:
    """Parts of a region that are joined where it is narrower than an opening, as arches at foot.

    Parameters
    ----------
    empty : squares without echoes: those among its own, as of glass, do not part it
    width : of the narrowest opening, in squares
    """
    size = math.ceil(width)
    closed = ndimage.binary_closing(region, np.ones((3, 3), bool), iterations=BRIDGE)
    wide = ndimage.binary_opening(region | (closed & empty), np.ones((size, size), bool))
    return list(_regions(wide, wide))


def _empty(relief: Relief, limits: Limits, recess: float) -> Iterator[Gap]:
    """Regions in which nothing is seen, or something before them, with wall beside and above."""
    for state, reason in ((EMPTY, UNSEEN_IN), (HIDDEN, "something stands before it")):
        some = ndimage.binary_opening(relief.states == state, np.ones((2, 2), bool))
        for region in _regions(some, some):
            box = _box(region)
            if min(box[2] - box[0], box[3] - box[1]) * relief.side < limits[0]:
                continue
            best = _fitted(region, relief.states, box)
            neat = _neat(relief, region, limits) if state == EMPTY else None
            judged = _judged(relief, region, best, limits, "", reason)
            if neat and _has_reveal(relief, neat, recess):
                yield neat._replace(found_by="outline")
            elif _between(judged):
                yield judged


def _regions(connected: Mask, some: Mask) -> Iterator[Mask]:
    """Squares of each connected region."""
    label, _ = ndimage.label(connected, np.ones((3, 3), bool))
    for number, place in enumerate(ndimage.find_objects(label), start=1):
        region = np.zeros_like(some)
        region[place] = (label[place] == number) & some[place]
        yield region


def _completed(seen: Mask, holes: Ints, hidden: Mask) -> Mask:
    """The hole of the wall in which a region lies, if the region fills most of it from its middle.

    What is seen of a room may be smaller than the opening. A hole that goes on to one side only
    may be an opening and a part of the wall that was not seen; it is taken if it ends there at
    something that stands before the wall, in the shadow of which it is.
    """
    number = np.bincount(holes[seen]).argmax()
    hole = holes == number
    filled = ndimage.binary_closing(seen, np.ones((3, 3), bool), iterations=BRIDGE)
    if 2 * filled.sum() < hole.sum() or not number:
        return seen
    inner, outer = np.array(_box(seen)), np.array(_box(hole))
    beyond = np.abs(outer - inner)
    even = np.abs(beyond[:2] - beyond[2:]).max() <= BRIDGE
    first, left, last, right = inner
    aside = np.zeros_like(seen)
    aside[:, left:right] = True
    aside[first:last, :] = True
    shadow = ndimage.binary_dilation(hole & aside & ~filled) & hidden
    return hole if even or shadow.sum() >= min(last - first, right - left) / 2 else seen


def _box(region: Mask) -> Box:
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    return int(rows[0]), int(columns[0]), int(rows[-1]) + 1, int(columns[-1]) + 1


def _fitted(region: Mask, states: NDArray[np.int8], box: Box) -> Box:
    """The rectangle that holds most of a region and least of the wall, side after side."""
    worth = np.where(region, 1.0, np.where(states == WALL, -1.0, -UNSEEN))
    worth[(states == BEHIND) & ~region] = -1.0
    sums = np.pad(worth.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    limits = np.array([box[0], box[1], box[2], box[3]])
    low = np.maximum(limits[:2] - REACH, 0)
    high = np.minimum(limits[2:] + REACH, states.shape)
    best, before = list(box), None
    while best != before:
        before = list(best)
        for side in range(4):
            axis = side % 2
            tries = (
                np.arange(low[axis], best[axis + 2])
                if side < 2
                else np.arange(best[axis] + 1, high[axis] + 1)
            )
            sides: list[Any] = list(best)
            sides[side] = tries
            first, left, last, right = sides
            total = sums[last, right] - sums[first, right] - sums[last, left] + sums[first, left]
            top = total.max() - 1e-9
            good = tries[total >= top]
            best[side] = int(good[-1] if side < 2 else good[0])  # the smallest of the best
    return best[0], best[1], best[2], best[3]


def _judged(
    relief: Relief,
    region: Mask,
    box: Box,
    limits: Limits,
    found_by: str = "behind",
    dropped: str = "",
) -> Gap:
    """A region with its shape, and whether it may be an opening."""
    first, left, last, right = box
    inside = np.zeros_like(region)
    inside[first:last, left:right] = True
    wall = relief.states == WALL
    mine, others = int((region & inside).sum()), int((wall & inside).sum())
    pure = mine / max(1, mine + others)
    rectangle = pure >= FULL and mine >= FULL * region.sum() and _corners(wall, region) < 2
    shape = _squares(region, relief.side)
    if rectangle:
        shape = shapely.box(*(relief.side * np.array([left, first, right, last])))
    else:
        first, left, last, right = box = _box(region)
        solid = region.sum() / (shape.convex_hull.area / relief.side**2)
        pure = min(1.0, float(solid))
    beside = _beside(wall, region, box)
    width, height = (right - left) * relief.side, (last - first) * relief.side
    min_width, max_width, tallest = limits
    if not dropped:
        if min(width, height) < min_width - relief.side:
            dropped = "too narrow"
        elif width > max_width + relief.side or height > tallest + relief.side:
            band = rectangle and _in_band(shape, beside, max_width)
            dropped = "" if band else TOO_WIDE
        elif not rectangle and pure < FULL:
            dropped = "no clear outline"
        elif min(beside[0], beside[2]) < BESIDE and min(beside[1], beside[3]) < BESIDE:
            dropped = NOT_BETWEEN
    return Gap(shape, rectangle, found_by, dropped, pure, beside)


def _corners(wall: Mask, region: Mask) -> int:
    """How many corners of the box around a region, but for what sticks out, are wall."""
    ends = []
    for places in np.nonzero(region):
        low, high = np.quantile(places, STRAY, method="nearest")
        ends.append((int(low), int(high) + 1))
    (first, last), (left, right) = ends
    size = max(1, round(CORNER * min(last - first, right - left)))
    blocks = (
        wall[rows, columns]
        for rows in (slice(first, first + size), slice(last - size, last))
        for columns in (slice(left, left + size), slice(right - size, right))
    )
    return sum(bool(block.mean() >= CORNER_WALL) for block in blocks)


def _squares(region: Mask, side: float) -> Any:
    """The squares of a region as one shape, small holes and notches filled."""
    row, column = np.nonzero(region)
    squares = shapely.box(column * side, row * side, (column + 1) * side, (row + 1) * side)
    whole = shapely.union_all(shapely.buffer(squares, BRIDGE / 2 * side, cap_style="square"))
    # Mitres of edges in one line divide by zero in GEOS, which then joins them as they are.
    with np.errstate(divide="ignore", invalid="ignore"):
        return shapely.buffer(whole, -BRIDGE / 2 * side, join_style="mitre")


def _beside(wall: Mask, region: Mask, box: Box) -> tuple[float, float, float, float]:
    """Share of the rows or columns of a region with wall soon beyond its left, lower, ... end.

    Below the lowest wall there is the ground.
    """
    first, left, last, right = box
    shares = []
    for axis, end in ((1, 0), (0, 0), (1, 1), (0, 1)):
        lines = region[first:last, left:right].any(axis=axis)
        strip = wall[first:last] if axis == 1 else wall[:, left:right]
        strip = strip if axis == 1 else strip.T
        low, high = (left, right) if axis == 1 else (first, last)
        seen = strip[:, max(0, low - REACH) : low] if end == 0 else strip[:, high : high + REACH]
        share = float(np.asarray(seen.any(axis=1))[lines].mean()) if lines.any() else 0.0
        if axis == 0 and end == 0 and not strip[:, : max(0, low - REACH)].any():
            share = 1.0  # no wall is lower
        shares.append(float(share))
    return shares[0], shares[1], shares[2], shares[3]


def _by_grid(gap: Gap, known: Floats, limit: float) -> Gap:
    """A region without echoes is an opening if its row and its column are those of others."""
    if gap.dropped != UNSEEN_IN or gap.pure < FULL or not len(known):
        return gap
    near = np.abs(known - np.array(gap.shape.bounds)) <= limit
    row, column = near[:, 1] & near[:, 3], near[:, 0] & near[:, 2]
    if row.sum() >= 2 and column.any():
        return gap._replace(found_by="grid", dropped="")
    return gap


def in_grid(boxes: Floats, limit: float) -> Mask:
    """Which rectangles have the sides of another one in their row or column.

    Parameters
    ----------
    boxes : array of shape (n, 4), left, bottom, right, top
    limit : by which the sides differ at most
    """
    near = np.abs(boxes[:, None] - boxes[None]) <= limit
    alike = (near[..., 1] & near[..., 3]) | (near[..., 0] & near[..., 2])
    np.fill_diagonal(alike, False)
    return np.asarray(alike.any(axis=1))
