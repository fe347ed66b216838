"""A front as a picture: which squares of it are wall, and what stands behind or before the wall.

A front has wall in several depths: panels between pilasters, storeys that stand back. What is seen
in an opening is behind the wall around it, not behind the front as a whole.

References
----------
Besag, J. (1986). On the statistical analysis of dirty pictures. Journal of the Royal Statistical
Society B 48(3), 259-302: a square is told by its points and by the squares around it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_opening, find_objects, label, uniform_filter
from scipy.special import ndtr

from algorithms.planes._bands import is_band
from algorithms.planes._fronts import Front
from algorithms.planes._glass import MOSTLY, glass
from algorithms.planes._outlines import View
from algorithms.planes._screen import JOINED, Screen, screen_of
from algorithms.shared.error_measures import NORMAL
from algorithms.shared.windows import between

PER_CELL = 4.0  # points of the wall in a square, about
SIGMAS = 3.0  # standard deviations of a wall within which its points lie
OF_MEDIAN = math.sqrt(math.pi / 2)  # standard error of the median of normal numbers over the mean's
HOLES = (0.05, 0.6)  # share of a panel that its openings take
MUCH, OPEN = 0.1, 0.1  # shares of a front and of holes in it, of planes in one depth that are wall
NEAR = 0.25  # width of the largest opening, within which wall tells the depth of a piece beside it
LIKE = 3.0  # standard deviations of the logarithm of intensity, within which a panel is wall
FEW = 20_000  # points of a plane that tell its size
NOISY = 2.0  # spread of the wall over a third of the least step, from which on planes slant
SLANT = 2.0  # spread of a small plane that slants through wall and pane, over that of the wall
ROUNDS = 20  # squares from which one can be told what it is
NEIGHBOUR = 1.0  # logarithm of the odds that a square around tells; 0.5 to 1 are alike
SURE = 3.0  # logarithm of the odds, 20 to 1, of a point of wall whose square stands back
INNER = (0.02, 0.98)  # quantiles of its points that its size is measured between

EMPTY, WALL, BEHIND, HIDDEN = range(4)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


class Relief(NamedTuple):
    """A front seen square to it.

    Attributes
    ----------
    view : coordinates on the reference plane
    uv : array of shape (n, 2), of all points
    behind : array of shape (n,), how far they lie behind the wall around them
    own : array of shape (n,), which are on the wall
    apart : distance of neighbours on it
    step : how far behind the wall a point lies at least that is not of it
    side : of a square
    states : array of shape (rows, columns), EMPTY, WALL, BEHIND or HIDDEN (something stands before)
    glass : numbers of the planes that are the glass of a curtain wall
    screen : what stands before the front and is no part of it
    """

    view: View
    uv: Floats
    behind: Floats
    own: Mask
    apart: float
    step: float
    side: float
    states: NDArray[np.int8]
    glass: list[int]
    screen: Screen

    def cells(self, uv: Floats) -> tuple[Ints, Ints, Mask]:
        """Row and column of places, and which of these lie in the picture."""
        return _cells(uv, self.side, self.states.shape)

    def twice(self) -> float:
        """Share of the squares with wall that hold wall of another depth, too."""
        row, column, inside = self.cells(self.uv[self.own])
        place = (row * self.states.shape[1] + column)[inside]
        level = np.abs(self.behind[self.own][inside]) <= self.step
        here, other = (np.unique(place[some]) for some in (level, ~level))
        return len(np.intersect1d(here, other)) / max(len(here), 1)


class _Plane(NamedTuple):
    """A plane of the front: depth and spread of its points, size, logarithm of their intensity.

    Attributes
    ----------
    some : array of shape (m, 3), places and depths of points, not all of many
    apart : distance of neighbours
    """

    number: int
    depth: float
    spread: float
    size: Floats
    shade: float
    shade_spread: float
    holes: float
    some: Floats
    apart: float = 1.0

    def beside(self, part: _Plane, reach: float) -> float:
        """Its depth beside another one, as it may slant; NaN if it is nowhere as near."""
        low, high = np.quantile(part.some[:, :2], INNER, axis=0)
        places = self.some[:, :2]
        near = ((places >= low - reach) & (places <= high + reach)).all(axis=1)
        return float(np.median(self.some[near, 2])) if near.any() else math.nan


class _Walls(NamedTuple):
    """Indices of the planes that are wall, and the spread of their points about them."""

    planes: list[int]
    spread: float


def relief_of(
    xyz: Floats,
    ids: NDArray[Any],
    front: Front,
    shades: Floats | None,
    *,
    largest: tuple[float, float],
    recess: float,
    depth: float,
    least: float,
    front_depth: float,
    metre: float,
) -> Relief:
    """The picture of a front.

    Parameters
    ----------
    xyz, ids : all points, and the number of the plane of each, from 1
    shades : logarithm of the intensity of all points, if it is known
    largest : width and height of what is seen in an opening; larger planes are wall
    recess : farthest that panes stand back
    depth : farthest behind the wall that is looked at
    least : step that is looked at, if the noise is not larger
    front_depth : farthest before the wall that a part of the front is
    metre : in the unit of the points
    """
    members = np.flatnonzero(np.isin(ids, np.array(front.members) + 1))
    view = View.of(front.plane, xyz[members])
    uv, away = view.flat(xyz), -front.plane.distances(xyz)
    near = np.abs(away) <= JOINED * metre
    near &= np.isin(ids, np.array(front.members) + 1)
    screen = screen_of(uv, away, near, front_depth, metre)
    away = np.where(screen.points, -depth, away)  # as far away as anything that hides the wall
    ids = np.where(screen.points, 0, ids)
    parts = [_plane(k, uv, away, ids, shades) for k in front.members if (ids == k + 1).any()]
    parts, ids = _parted(parts, uv, away, ids, shades, largest, least)
    panes = glass(parts, uv, away, ids, largest, recess)
    shares = {part.number: float(panes[ids == part.number + 1].mean()) for part in parts}
    bare = [part for part in parts if shares[part.number] <= MOSTLY]
    if not bare:  # a front that is nothing but glass has no wall to see it against
        panes[:], bare, shares = False, parts, {}
    glazed = [number for number, share in shares.items() if share > 0]
    ids = np.where(panes, 0, ids)
    walls = _walls(bare, largest, recess, least)
    own = np.isin(ids, np.array(walls.planes) + 1)
    apart = _apart(uv[own])
    side = math.sqrt(PER_CELL) * apart
    shape = tuple((np.ceil(uv[members].max(axis=0)[::-1] / side) + 1).astype(int))
    row, column, inside = _cells(uv, side, shape)
    level = _levels(uv, away, ids, walls.planes)
    local = around(_median(row, column, level, own & inside, shape))
    step = max(SIGMAS * walls.spread, least)
    behind = away.copy()
    behind[inside] -= np.nan_to_num(local[row[inside], column[inside]])
    place = np.where(inside & (behind <= depth), row * shape[1] + column, -1)
    told = _told(behind, step, least, recess)
    states = _states(place, behind, step, told, shape)
    on_wall = own | (inside & (np.abs(behind) <= step) & (ids == 0))
    # Points of panes in the depth of the wall are no edge of it.
    back = (states == BEHIND)[row * inside, column * inside]
    on_wall &= ~(inside & back & (told > -SURE))
    if panes.any():  # frames are narrower than squares, which hold their sides, too
        states.flat[place[on_wall & (place >= 0) & (told < -SURE)]] = WALL
    return Relief(view, uv, behind, on_wall, apart, step, side, states, glazed, screen)


def _states(
    place: Ints, behind: Floats, step: float, told: Floats, shape: tuple[int, ...]
) -> NDArray[np.int8]:
    """State of each square.

    Parameters
    ----------
    place : number of the square of each point, below 0 for none
    told : see :func:`_told`
    """
    seen, before = (place >= 0) & (behind >= -step), (place >= 0) & (behind < -step)
    sums = np.bincount(place[seen], told[seen], minlength=shape[0] * shape[1])
    evidence = np.asarray(sums.reshape(shape), float)
    some, hidden = (
        np.bincount(place[which], minlength=evidence.size).reshape(shape) > 0
        for which in (seen, before)
    )
    back = np.where(weighed(evidence), BEHIND, WALL)
    return np.select([some, hidden], [back, HIDDEN], EMPTY).astype(np.int8)


def _told(behind: Floats, step: float, least: float, recess: float) -> Floats:
    """How much each depth tells that its point stands back, and is not of the wall, shape (n,).

    The logarithm of how likely it is in either case. Depths of the wall are normal, those of what
    stands back are evenly spread from the least step to the recess, and scatter as those of the
    wall. None tells more than one in the middle of the wall, for either.

    Examples
    --------
    >>> _told(np.array([0.0, 0.03, 0.04, 0.2]), 0.06, 0.02, 0.25).round(1).tolist()
    [-3.4, -0.8, 0.3, 3.4]
    """
    spread, most = step / SIGMAS, max(recess, least + step)
    depth = np.clip(np.append(behind, 0.0), 0.0, most)
    back = (ndtr((depth - least) / spread) - ndtr((depth - most) / spread)) / (most - least)
    told = np.log(back * spread * math.sqrt(2 * math.pi)) + (depth / spread) ** 2 / 2
    return np.asarray(np.clip(told[:-1], told[-1], -told[-1]))


def weighed(evidence: Floats) -> Mask:
    """Which squares stand back, by their points and by the squares around (Besag 1986).

    Each of the eight squares around that stands back counts as much as odds of e. All are weighed
    at once, again and again, by how sure each is (mean field).

    Parameters
    ----------
    evidence : logarithm of the odds by the points of each square, 0 where there are none

    Examples
    --------
    >>> evidence = np.full((5, 6), -4.0)
    >>> evidence[:, 3:] = 2.0
    >>> noisy = evidence.copy()
    >>> noisy[2, 1], noisy[3, 4] = 1.0, -1.0
    >>> bool((weighed(noisy) == (evidence > 0)).all())
    True
    """
    lean = np.tanh(evidence / 2)
    for _ in range(ROUNDS):
        others = 9 * uniform_filter(lean, 3, mode="nearest") - lean
        lean = np.tanh((evidence + NEIGHBOUR * others) / 2)
    return np.asarray(lean > 0)


def _cells(uv: Floats, side: float, shape: Any) -> tuple[Ints, Ints, Mask]:
    row, column = np.floor(uv.T[::-1] / side).astype(np.int64)
    inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    return row, column, inside


def _levels(uv: Floats, away: Floats, ids: NDArray[Any], planes: list[int]) -> Floats:
    """Depth of the planes of a wall at their points, array of shape (n,)."""
    level = away.copy()
    for number in planes:
        part = np.flatnonzero(ids == number + 1)
        places = np.column_stack([np.ones(len(part)), uv[part]])
        level[part] = places @ np.linalg.lstsq(places, away[part], rcond=None)[0]
    return level


def _apart(uv: Floats) -> float:
    """Distance of neighbours among points of shape (n, 2), where there are any."""
    side = max(math.sqrt(float(np.prod(np.ptp(uv, axis=0))) / len(uv)), 1e-9)
    for _ in range(2):
        held = np.unique(np.floor(uv / (4 * side)).astype(np.int64), axis=0)
        side = 4 * side * math.sqrt(len(held) / len(uv))
    return side


def _plane(
    index: int, uv: Floats, away: Floats, ids: NDArray[Any], shades: Floats | None
) -> _Plane:
    part = np.flatnonzero(ids == index + 1)
    held, row, column = _held(uv[part])
    size, holes = _size(uv[part], held, row, column), _holes(held)
    each = 1 + len(part) // FEW
    part = part[::each]
    shade = np.full(1, np.nan) if shades is None else shades[part]
    some = np.column_stack([uv[part], away[part]])
    depth, shaded = _robust(away[part]), _robust(shade)
    apart = _apart(some[:, :2]) / math.sqrt(each)
    return _Plane(index, *depth, size, *shaded, holes, some, apart)


def _parted(
    parts: list[_Plane],
    uv: Floats,
    away: Floats,
    ids: NDArray[Any],
    shades: Floats | None,
    largest: tuple[float, float],
    least: float,
) -> tuple[list[_Plane], NDArray[Any]]:
    """The planes of a front, and the plane of each point, where large ones are parted by depth.

    In noise, and where points are few, a plane may slant through the wall and a pane beside it, or
    join panes above each other by points of the wall between: it is too large for an opening, and
    its panes would be wall. Squares of it in the depth of the reference are given to that, if what
    is left is no larger than an opening.
    """
    first, made = parts[0], []
    spread = max(first.spread, least / SIGMAS)
    for part in parts[1:]:
        made.append(part)
        slants = spread > NOISY * least / SIGMAS and part.spread > SLANT * spread
        if not (slants or (part.size > largest).any()):
            continue
        here = np.flatnonzero(ids == part.number + 1)
        level = _in_depth(uv[here], away[here] - first.depth, spread)
        if not level.any() or level.mean() > 1 - MUCH:  # single squares of noise are no pane
            continue
        left = ids.copy()
        left[here[level]] = first.number + 1
        rest = _plane(part.number, uv, away, left, shades)
        if (rest.size <= largest).all():
            made[-1], ids = rest, left
    return [_plane(first.number, uv, away, ids, shades), *made], ids


def _in_depth(uv: Floats, off: Floats, spread: float) -> Mask:
    """Which points lie in squares whose median is in the depth of the reference, shape (n,).

    Parameters
    ----------
    off : array of shape (n,), how far they lie behind the reference
    spread : of the points of the reference about it
    """
    held, row, column = _held(uv)
    middle = _median(row, column, off, np.ones(len(off), bool), held.shape)
    count = np.zeros(held.shape)
    np.add.at(count, (row, column), 1)
    error = OF_MEDIAN * spread / np.sqrt(np.maximum(count, 1))
    limit = np.maximum(SIGMAS * error, spread)
    return np.asarray((np.abs(middle) <= limit)[row, column])


def _robust(values: Floats) -> tuple[float, float]:
    """Median, and standard deviation from the median of the sizes."""
    middle = float(np.median(values))
    return middle, NORMAL * float(np.median(np.abs(values - middle)))


def _size(uv: Floats, held: Mask, row: Ints, column: Ints) -> Floats:
    """Width and height of the piece of a plane with the most points.

    The panes of windows above each other may be one plane, and larger than an opening.
    """
    piece = label(binary_dilation(held), np.ones((3, 3), bool))[0][row, column]
    largest = uv[piece == np.bincount(piece).argmax()]
    return np.asarray(np.ptp(np.quantile(largest, INNER, axis=0), axis=0))


def _held(uv: Floats) -> tuple[Mask, Ints, Ints]:
    """Squares that hold points of a plane, and row and column of each point."""
    side = 2 * _apart(uv)
    row, column = np.floor((uv - uv.min(axis=0)).T[::-1] / side).astype(np.int64)
    held = np.zeros((row.max() + 1, column.max() + 1), bool)
    held[row, column] = True
    return held, row, column


def _holes(held: Mask) -> float:
    """Share of the squares inside the pieces of a plane that are holes, at least three wide.

    Inside is what has points of its piece to the left, right, above and below: doors in one depth
    leave wall between them, which is no hole in them. Single squares that hold no points are no
    holes: panes send few points back.
    """
    pieces, _ = label(binary_dilation(held), np.ones((3, 3), bool))
    inside = empty = 0
    for number, place in enumerate(find_objects(pieces), start=1):
        one = held[place] & (pieces[place] == number)
        inner = between(one, 0) & between(one, 1)
        inside += int(inner.sum())
        empty += int(binary_opening(inner & ~one, np.ones((3, 3), bool)).sum())
    return empty / inside


def _walls(
    parts: list[_Plane], largest: tuple[float, float], recess: float, least: float
) -> _Walls:
    """The planes of a front that are wall.

    The first is, the reference. Those too large for an opening are, and those in the depth of one
    that is. A panel that stands back is told from a pane by its intensity, which is that of the
    wall, and by the openings in it; if the intensity is not known, by its depth or by the size of
    all panels in its depth.
    """
    large = [part for part in parts if part is parts[0] or (part.size > largest).any()]
    step = max(SIGMAS * parts[0].spread, least)
    bands = [part for part in large[1:] if is_band(part, large, step, recess, largest[0])]
    large = [part for part in large if part not in bands]
    parts = [part for part in parts if part not in bands]
    weights = [float(part.size.prod()) for part in large]
    shade = np.average([part.shade for part in large], weights=weights)
    squares = [(part.shade - shade) ** 2 + part.shade_spread**2 for part in large]
    shade_limit = LIKE * math.sqrt(np.average(squares, weights=weights))
    walls = list(large)
    firm = list(large)  # whose depths count, so that they do not creep from one to the next
    for panels in (False, True, False):
        for part in parts:
            if part in walls:
                continue
            known = not math.isnan(part.shade)
            like = known and max(abs(part.shade - shade), part.shade_spread) <= shade_limit
            level = _level(part, firm, (step, recess), NEAR * largest[0])
            panel = panels and HOLES[0] <= part.holes <= HOLES[1]
            if not known:
                panel &= part.depth > recess or _layer(part, parts, step)
            if (like or not known) and (level or panel):
                walls.append(part)
                firm += [part] if panel else []
    return _Walls([part.number for part in walls], parts[0].spread)


def _level(part: _Plane, walls: list[_Plane], panes: tuple[float, float], reach: float) -> bool:
    """Whether a plane lies in the depth of one that is wall.

    What stands back as panes do from the wall beside it is none, though the wall of the next house
    may lie in its depth; what stands farther back is none behind a wall that is wider, as curtains
    are, while panels lie between pilasters that are narrower.

    Parameters
    ----------
    panes : how far they stand back, from and to
    reach : how far away a wall is beside it
    """
    back = part.depth - np.array([wall.beside(part, reach) for wall in walls])
    if (np.abs(back) <= panes[0]).any():
        return True
    level = any(abs(part.depth - wall.depth) <= panes[0] for wall in walls)
    wider = np.array([wall.size[0] > part.size[0] for wall in walls])
    return level and not ((back > panes[0]) & ((back <= panes[1]) | wider)).any()


def _layer(part: _Plane, parts: list[_Plane], step: float) -> bool:
    """Whether planes in the depth of one are much of the front, and have holes as a wall has."""
    area = np.array([other.size.prod() for other in parts])
    here = np.array([abs(other.depth - part.depth) <= step for other in parts])
    holes = np.array([other.holes for other in parts])
    share = area[here].sum() / area.sum()
    return bool(share >= MUCH and np.average(holes[here], weights=area[here]) >= OPEN)


def _median(row: Ints, column: Ints, values: Floats, some: Mask, shape: Any) -> Floats:
    """The median of values in each square; NaN in squares without any."""
    flat = row[some] * shape[1] + column[some]
    order = np.lexsort((values[some], flat))
    keys, start, count = np.unique(flat[order], return_index=True, return_counts=True)
    found = np.full(shape[0] * shape[1], np.nan)
    found[keys] = values[some][order[start + (count - 1) // 2]]
    return found.reshape(shape)


def around(level: Floats) -> Floats:
    """Depth of the wall around each square: of the nearest to the left, right, above and below.

    Of three or four the second deepest, as pilasters beside a window stand before its wall.
    """
    near = []
    for axis in (0, 1):
        for flip in (False, True):
            turned = np.flip(level, axis) if flip else level
            near.append(np.flip(_filled(turned, axis), axis) if flip else _filled(turned, axis))
    depths = np.sort(np.stack(near), axis=0)  # NaN last
    count = (~np.isnan(depths)).sum(axis=0)
    pick = np.where(count >= 3, count - 2, np.maximum(count - 1, 0))
    found = np.take_along_axis(depths, pick[None], axis=0)[0]
    return np.where(np.isnan(level), found, level)


def _filled(level: Floats, axis: int) -> Floats:
    """Each NaN replaced by the last number before it along an axis."""
    places = np.arange(level.shape[axis]).reshape((-1, 1) if axis == 0 else (1, -1))
    last = np.maximum.accumulate(np.where(np.isnan(level), 0, places), axis=axis)
    return np.asarray(np.take_along_axis(level, last, axis=axis))
