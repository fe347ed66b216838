"""Fronts of buildings: upright planes that face one way, one before the other within a depth.

A front is more than a plane: pilasters, cornices, balconies and storeys that stand back are planes
of their own. The one in which most lies, for how much it scatters, is the reference; the relief of
a part is how far it stands before it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import geopandas
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from algorithms.planes._outlines import View
from algorithms.planes._search import axes_of
from algorithms.planes._segment import parts_of
from algorithms.shared.plane_fit import Plane

UPRIGHT = math.sin(math.radians(10.0))  # third part of the normal of an upright plane, at most
ALIKE = math.cos(math.radians(10.0))  # of the angle between planes of an elevation
PARALLEL = math.cos(math.radians(15.0))  # of the angle between parts of a front
STOREY = 2.5  # metres: a front is as wide and as high, and its parts are as near along it
INNER = (0.05, 0.95)  # quantiles of the points of a part that lie within the depth
ASIDE = 1.0  # metres from a wall, more than panes stand back; farther points tell its outside
DECISIVE = 3.0  # squares of ground with points on one side over those on the other that tell it
SOME = 0.05  # points on a side over those of the wall that count
EXPLAINED = 0.8  # share of the variance of directions that a curve explains: 1.0, else up to 0.3
SQUARE = 0.25  # metres: planes across a wall hold points in few squares of this side
COPLANAR = 1.5  # distance of points from the plane of another over that of its own, at most
FEW = 500  # points of a plane that tell whether it is in the plane of another
SAMPLE = 20_000  # points of a plane that tell where it lies
CELLS = 4.0  # points of the wall in a cell of the picture, about
FRONT_COLUMNS = (
    "front_id",
    "planes",
    "azimuth",
    "length",
    "height",
    "area",
    "relief_from",
    "relief_to",
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


class Front(NamedTuple):
    """Parallel planes that make a front.

    Attributes
    ----------
    plane : the reference, the normal towards the outside
    members : index of each plane, the reference first, then by its size
    relief : array of shape (m,), how far each lies before the reference, the median of its points
    sided : whether something tells from which side it was seen
    """

    plane: Plane
    members: list[int]
    relief: Floats
    sided: bool

    def turned(self) -> Front:
        """The same as seen from the other side."""
        plane = replace(self.plane, normal=-self.plane.normal)
        return self._replace(plane=plane, relief=-self.relief)


class _Part(NamedTuple):
    """Points of a plane, not all of many, the area of squares that hold some, and their spread."""

    number: int
    xyz: Floats
    few: Floats
    area: float
    wide: bool
    spread: float


def fronts_of(
    xyz: Floats, ids: NDArray[Any], planes: Sequence[Plane], *, depth: float, metre: float
) -> list[Front]:
    """Fronts of a cloud, the largest first.

    The upright plane in which most lies of what is left, in one piece or several, begins a front.
    Planes join that are parallel to it, lie within the depth before or behind it, and are no
    farther along it than a storey from a plane of the front. The reference is the one of these in
    which most lies over the root of its spread: goods and panes of a shop may be more than its
    wall, which is flatter, and gates may be flatter than a large wall of rubble.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    ids : array of shape (n,), number of the plane of each point, from 1; 0 of none
    planes : one less than the largest number
    depth : in the unit of the points
    metre : in the unit of the points
    """
    upright = [k for k, plane in enumerate(planes) if abs(plane.normal[2]) <= UPRIGHT]
    parts = parts_of(np.asarray(ids, np.int32), len(planes))
    waiting = [_part(k, planes[k], xyz[_some(parts[k])], metre) for k in upright if len(parts[k])]
    level = {part.number: _in_plane(part, waiting, planes) for part in waiting if part.wide}
    support = {number: sum(part.area for part in same) for number, same in level.items()}
    waiting.sort(key=lambda part: (-support.get(part.number, 0.0), -part.area, part.number))
    upright_points = np.isin(ids, [k + 1 for k in upright])
    found = []
    while (first := next((part for part in waiting if part.wide), None)) is not None:
        left = {part.number for part in waiting}
        members = _members(first, planes[first.number], waiting, planes, depth, STOREY * metre)
        wide = [part for part in members if part.wide]
        flat = max(wide, key=lambda part: support[part.number] / math.sqrt(part.spread))
        same = [part for part in level[flat.number] if part.number in left]
        first = max((part for part in same if part.wide), key=lambda part: part.area)
        reference = planes[first.number]
        members = _members(first, reference, waiting, planes, depth, STOREY * metre)
        chosen = {part.number for part in members}
        waiting = [part for part in waiting if part.number not in chosen]
        own = np.concatenate([parts[part.number] for part in same if part.number in chosen])
        others = upright_points & ~np.isin(ids, [k + 1 for k in chosen])
        outwards, sided = outside(xyz, reference, own, metre, others)
        relief = np.array([float(np.median(outwards.distances(part.xyz))) for part in members])
        found.append(Front(outwards, [part.number for part in members], relief, sided))
    return found


def _in_plane(part: _Part, others: list[_Part], planes: Sequence[Plane]) -> list[_Part]:
    """The parts in the plane of one, as far as their points and its own spread."""
    limit = COPLANAR * part.spread
    return [other for other in others if _farthest(planes[part.number], other.few) <= limit]


def _farthest(plane: Plane, xyz: Floats) -> float:
    """Distance from a plane within which nineteen of twenty points lie."""
    return float(np.quantile(np.abs(plane.distances(xyz)), INNER[1]))


def _some(part: NDArray[Any]) -> NDArray[Any]:
    return part[:: 1 + len(part) // SAMPLE]


def _part(number: int, plane: Plane, xyz: Floats, metre: float) -> _Part:
    flat = _flat(plane, xyz)
    side = SQUARE * metre
    held = np.unique(np.floor(flat / side).astype(np.int64), axis=0)
    wide = bool(np.ptp(flat, axis=0).min() >= STOREY * metre)
    few = xyz[:: 1 + len(xyz) // FEW]
    return _Part(number, xyz, few, len(held) * side**2, wide, max(_farthest(plane, few), 1e-9))


def _flat(plane: Plane, xyz: Floats) -> Floats:
    return np.asarray(((xyz - plane.origin) - plane.centre) @ axes_of(plane.normal).T)


def _members(
    first: _Part,
    reference: Plane,
    waiting: list[_Part],
    planes: Sequence[Plane],
    depth: float,
    along: float,
) -> list[_Part]:
    """The parts of the front of a plane, that plane first."""
    like = []
    for part in waiting:
        if part.number == first.number or (
            abs(planes[part.number].normal @ reference.normal) >= PARALLEL
            and np.abs(np.quantile(reference.distances(part.xyz), INNER)).max() <= depth
        ):
            like.append(part)
    boxes = np.array([_box(_flat(reference, part.xyz)) for part in like])
    near = shapely.dwithin(boxes[:, None], boxes[None, :], along)
    start = next(k for k, part in enumerate(like) if part.number == first.number)
    reached: NDArray[Any] = np.arange(len(like)) == start
    more: NDArray[Any] = near[start]
    while more.sum() > reached.sum():
        reached, more = more, near[more].any(axis=0)
    rest = (part for part, here in zip(like, reached, strict=True) if here and part is not first)
    return [first, *rest]


def _box(uv: Floats) -> Any:
    low, high = np.quantile(uv, INNER, axis=0)
    return shapely.box(*low, *high)


def outside(xyz: Floats, plane: Plane, own: Ints, metre: float, others: Mask) -> tuple[Plane, bool]:
    """The plane with its normal towards the side from which it was seen, and whether that is told.

    A wall hides what is behind it. So ground away from it is before it if it lies over the wall;
    what lies over its gaps may have been seen through them, and what lies near its ends past them.
    Without ground, what is in the gaps stands back. Walls of other fronts, on the other side of the
    street or around the corner, are neither: they count where nothing else tells a side.

    Parameters
    ----------
    own : indices of the points on the plane
    others : array of shape (n,), which points are on upright planes of other fronts
    """
    uv, away = _flat(plane, xyz), plane.distances(xyz)
    picture = _Picture.of(uv[own])
    inside = picture.inside(uv)
    past = min(ASIDE * metre, (picture.high[0] - picture.low[0]) / 4)
    within = (uv[:, 0] >= picture.low[0] + past) & (uv[:, 0] <= picture.high[0] - past)
    gap = np.zeros(len(xyz), bool)
    gap[inside] = picture.gaps()[picture.cells(uv[inside])]
    free = (np.abs(away) > ASIDE * metre) & within & ~gap
    spread = 3 * math.sqrt(float(np.mean(away[own] ** 2)))
    told = False
    for walls in (others, np.zeros(len(xyz), bool)):
        ground = _sides(uv[free, 0], away[free], walls[free], SQUARE * metre, SOME * len(own))
        before, behind = ground
        if max(ground) <= DECISIVE * min(ground):
            set_back = [
                len(np.unique(picture.cells(uv[gap & ~walls & (sign * away > spread)]), axis=1).T)
                for sign in (1, -1)
            ]
            # What stands before gaps, such as balconies, may be as much as what is seen in them.
            before = (ground[0] + 1) * (set_back[1] + 1)
            behind = (ground[1] + 1) * (set_back[0] + 1)
        decided = max(before, behind) > DECISIVE * min(before, behind)
        if walls is others:  # other walls alone may stand behind the house as well as before it
            told = decided or any(ground)
        if decided:
            break
    return plane if before >= behind else replace(plane, normal=-plane.normal), told


def _sides(along: Floats, away: Floats, walls: Mask, side: float, least: float) -> list[int]:
    """Squares of the ground before and behind a wall that hold points, and none of other walls.

    Each counts once: a side wall behind the corner of a house holds more points than the street,
    but stands on few squares. A side of fewer points than the least has none.

    Parameters
    ----------
    along, away : places of points along a wall, and their distances from it
    walls : which of them are on other walls
    side : of a square
    """
    squares = np.floor(np.column_stack([along, away]) / side).astype(np.int64)
    held, square = np.unique(squares, axis=0, return_inverse=True)
    square = square.reshape(-1)
    built = np.bincount(square, walls, len(held)) > 0
    left = ~built[square]
    return [
        len(np.unique(square[here])) if here.sum() >= least else 0
        for here in (left & (away > 0), left & (away < 0))
    ]


class _Picture(NamedTuple):
    """Which squares of a grid on a plane hold points of it."""

    low: Floats
    high: Floats
    side: float
    held: Mask

    @classmethod
    def of(cls, uv: Floats) -> _Picture:
        low, high = uv.min(axis=0), uv.max(axis=0)
        side = max(math.sqrt(CELLS * float(np.prod(high - low)) / len(uv)), 1e-9)
        empty = cls(low, high, side, np.zeros(0, bool))
        shape = np.max(empty.cells(high[None]), axis=1) + 1
        held = np.zeros(shape, bool)
        held[empty.cells(uv)] = True
        return cls(low, high, side, held)

    def cells(self, uv: Floats) -> tuple[Ints, Ints]:
        """Row and column of places on the plane."""
        row, column = np.floor((uv - self.low).T[::-1] / self.side).astype(np.int64)
        return row, column

    def inside(self, uv: Floats) -> Mask:
        """Which places of shape (n, 2) lie on the picture."""
        return np.asarray(((uv >= self.low) & (uv <= self.high)).all(axis=1))

    def gaps(self) -> Mask:
        """Squares without points that have some on both sides and above, and no neighbour with any.

        Those beside the wall may hold points of its edges.
        """
        held = self.held
        left = np.logical_or.accumulate(held, axis=1)
        right = np.logical_or.accumulate(held[:, ::-1], axis=1)[:, ::-1]
        above = np.logical_or.accumulate(held[::-1], axis=0)[::-1]
        return np.asarray(
            left & right & above & ~ndimage.binary_dilation(held, np.ones((3, 3), bool))
        )


def front_numbers(fronts: Sequence[Front], count: int) -> tuple[NDArray[np.int32], Floats]:
    """Number of the front of each plane, from 1, 0 for none; and its relief, NaN for none."""
    numbers, relief = np.zeros(count, np.int32), np.full(count, np.nan)
    for number, front in enumerate(fronts, start=1):
        numbers[front.members] = number
        relief[front.members] = front.relief
    return numbers, relief


def pieces(fronts: Sequence[Front], points: Ints) -> float:
    """How many planes a front has, each counted by its share of the points (Simpson 1949).

    The mean of all fronts, each counted by its points; NaN without fronts.

    Parameters
    ----------
    points : of each plane
    """
    sizes = [points[front.members].astype(float) for front in fronts]
    if not sizes:
        return math.nan
    whole = np.array([size.sum() for size in sizes])
    numbers = [float(size.sum() ** 2 / (size**2).sum()) for size in sizes]
    return float(np.average(numbers, weights=whole))


def turn(front: Front, planes: Sequence[Plane], points: Ints) -> float:
    """Degrees by which the planes of a front turn from its one end to the other, as on a curve.

    A line through their directions over their places, each plane counted by its points; 0 if it
    leaves more than a fifth of their variance, as the directions of small parts are not known well.

    Parameters
    ----------
    points : of each plane
    """
    across = front.plane.normal[:2]
    along = np.array([-across[1], across[0]])
    normals = np.array([planes[k].normal[:2] for k in front.members])
    places = np.array([(planes[k].centre + planes[k].origin)[:2] for k in front.members])
    directions = np.degrees(np.arctan((normals @ along) / (normals @ across)))
    values = np.vstack([(places - places[0]) @ along, directions])
    if len(front.members) < 3 or not np.ptp(values, axis=1).all():
        return 0.0
    spread = np.cov(values, aweights=points[front.members])
    if spread[0, 1] ** 2 < EXPLAINED * spread[0, 0] * spread[1, 1]:
        return 0.0
    return float(abs(spread[0, 1] / spread[0, 0]) * np.ptp(values[0]))


def outlines(
    fronts: Sequence[Front], shapes: Sequence[Any]
) -> Iterator[tuple[dict[str, Any], Any]]:
    """Attributes of each front, and the outlines of its planes seen square to it.

    Parameters
    ----------
    shapes : outlines of all planes in space
    """
    for number, front in enumerate(fronts, start=1):
        parts = [shapes[k] for k in front.members]
        view = View.of(front.plane, shapely.get_coordinates(parts, include_z=True))
        flat = shapely.union_all(shapely.buffer(view.seen(np.array(parts, object)), 0))
        left, bottom, right, top = flat.bounds
        east, north, _ = front.plane.normal
        yield (
            {
                "front_id": number,
                "planes": len(parts),
                "azimuth": math.degrees(math.atan2(east, north)) % 360.0,
                "length": right - left,
                "height": top - bottom,
                "area": flat.area,
                "relief_from": float(front.relief.min()),
                "relief_to": float(front.relief.max()),
            },
            view.raised(flat),
        )


def elevation(
    solid: geopandas.GeoDataFrame,
    planes: Sequence[Plane],
    xyz: Floats,
    ids: NDArray[Any],
    metre: float,
) -> geopandas.GeoDataFrame:
    """Outlines projected on the largest vertical plane, or on the largest if none is vertical.

    Parameters
    ----------
    solid : outlines in space, the first of the plane with the most points
    planes : of the outlines
    xyz, ids : all points, and the number of the plane of each
    metre : in the unit of the points
    """
    if not planes:
        return geopandas.GeoDataFrame({"plane_id": []}, geometry=[])
    upright = [k for k, plane in enumerate(planes) if abs(plane.normal[2]) <= UPRIGHT]
    main = max(upright or range(len(planes)), key=lambda k: solid["area"][k])
    others = np.isin(ids, [k + 1 for k in upright if k != main])
    front, _ = outside(xyz, planes[main], np.flatnonzero(ids == main + 1), metre, others)
    view = View.of(front, shapely.get_coordinates(solid.geometry[main], include_z=True))
    like = [k for k, plane in enumerate(planes) if abs(plane.normal @ front.normal) >= ALIKE]
    shown = solid.iloc[like][["plane_id", "area", "points"]].copy()
    centres = np.array([planes[k].centre + planes[k].origin for k in like])
    shown["depth"] = -front.distances(centres)
    shown["kind"] = np.where(shown["depth"] > 0, "behind", "in front")
    shown.loc[shown.index == main, ["depth", "kind"]] = 0.0, "facade"
    flat = view.seen(solid.geometry.to_numpy()[like])
    return geopandas.GeoDataFrame(shown.reset_index(drop=True), geometry=flat)
