"""Which bodies above the ground are vehicles: buses, trams, lorries, containers, cars.

Roads and rails set the size of vehicles. What is no wider and no higher than that, and has ground
all around, also between it and a wall close by, is taken for one: narrow annexes lean on a house,
and free-standing houses are wider.
Cars are told from shrubs as well: they are oblongs, and let few pulses through. And a roof hides
the ground: where ground is seen between, as among vehicles in rows, below crowns, or where one
stood in one strip and had left in the next, there is no roof.

References
----------
Council Directive 96/53/EC, annex I: vehicles are up to 2.55 m wide (2.60 m if refrigerated) and
4.0 m high. BOStrab (1987), section 34: trams are up to 2.65 m wide. ISO 668: containers are 2.44 m.
Osserman, R. (1979). Bonnesen-style isoperimetric inequalities. American Mathematical Monthly 86(1),
1-29: area, perimeter and the largest disc within.

On which data the limits were chosen, and how well they do on other: the page urban-classes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.classify._evidence import FOOT, PointFeatures
from algorithms.classify._outlines import TOUCHING, margin
from algorithms.shared.alpha_shape import alpha_shape
from algorithms.shared.places import may_be_near
from toolbox.context import QUIET, Context
from toolbox.errors import DataError

WIDEST = 2.65  # metres, a tram
HIGHEST = 5.0  # metres: double-deckers have up to 4.6, trams carry boxes and arms on their roofs
TOP = 95  # percentile of the heights of a body, so that an arm or a wire does not decide
SMALLEST = 4.0  # m2: the smallest cars are 1.7 m wide and 2.7 m long
LONG = 1.5  # times as long as wide, at least; small cars have 1.6
APART = 0.4  # metres: half the gap between two bodies that are seen apart, if points allow
BY_SPACING = 1.25  # times the spacing of points: the same where they are sparse
SURE = 1.05  # times the largest area of narrow shapes: GEOS smooths by a hundredth of the width
AROUND = 1.5  # metres from its side, and as much again, in which there is ground
FREE = 0.75  # share of its sides that must have ground beside; an annexe has a wall at one
EDGE = 0.75  # metres inside of an outline where pulses pass roofs and meet the ground
SEEN = 0.1  # share of ground among the points within that no roof has
TURNS = 9  # directions of a row that are tried: between two its ends move half a point spacing
LINE = 1.0  # metres of a line of ground, at least: of ground below an eave 0.7 m were seen
FEWEST = 2  # points on the ground that may be an accident
STRIP = 1 / 3  # share of ground in a strip without an inside: more among wires, not beside walls
LOWEST = 0.3  # metres above the ground, from which on bodies are looked at
LOW_CAR, CAR = 1.1, 6.5  # metres, least height of a car and length; what is longer is a row,
WIDE = 1.6  # metres, and no hedge if it is as wide as cars
OBLONG = 0.6  # share of its bounding rectangle that a car fills, and a shrub hardly does
GLASS = 1 / 3  # share of the returns from a car after which the pulse goes on, at most

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Shapes = NDArray[Any]


class Body(NamedTuple):
    """Points that are near each other, narrow, low, and stand free.

    Attributes
    ----------
    outline : shapely polygon around the points
    points : their indices
    width, length : metres
    top : height above the ground that few points exceed, metres
    """

    outline: Any
    points: Ints
    width: float
    length: float
    top: float


def large_vehicles(
    features: PointFeatures, roof: Mask, spacing: float, smallest: float, ctx: Context = QUIET
) -> Mask:
    """True for points that look like a roof but are of a vehicle, array of shape (n,).

    Parameters
    ----------
    features : n points
    roof : array of shape (n,), those that look like a roof
    spacing : distance between points, in their unit
    smallest : area of a building, in its square; what is as large must be longer than wide as well
    """
    found = np.zeros(len(roof), bool)
    for body in bodies(features, roof, spacing, ctx.part(0.0, 0.5)):
        if _oblong(body, smallest):
            found[body.points] = True
    low = roof & ~found & (features.terrain[1] <= HIGHEST)  # without the roofs that one is close to
    for body in bodies(features, low, spacing, ctx.part(0.5, 1.0)):
        if _oblong(body, smallest) and _has_ground_between(body, features, roof, spacing):
            found[body.points] = True
    return found


def _oblong(body: Body, smallest: float) -> bool:
    """Whether a body is longer than wide, or smaller than buildings."""
    return bool(body.outline.area < smallest or body.length >= LONG * body.width)


def _has_ground_between(body: Body, features: PointFeatures, roof: Mask, spacing: float) -> bool:
    """Whether ground is seen between a body and the higher roofs that it stands close to, if any.

    A lorry at a wall has it along its side. An annexe leans on the wall, and what is low of a roof
    goes on in what is high of it. Of lorries side by side, which crowns may join, one taken out
    would leave fewer places where ground is seen between (:func:`ground_seen`).
    """
    reach = AROUND * features.cloud.metre
    edge = shapely.get_coordinates(shapely.segmentize(shapely.boundary(body.outline), spacing))
    near = features.within(shapely.box(*shapely.buffer(body.outline, reach).bounds))
    height, others = features.terrain[1][near], roof[near] & ~np.isin(near, body.points)
    to_roof, to_higher, to_ground = (
        _distances(edge, features.xyz[near[some]], reach)
        for some in (others, others & (height > HIGHEST), height < FOOT)
    )
    close = np.isfinite(to_roof)
    between = (to_ground < to_roof) & (to_higher == to_roof)
    return not close.any() or bool(between[close].mean() >= FREE)


def vehicles(features: PointFeatures, some: Mask, spacing: float, ctx: Context = QUIET) -> Mask:
    """True for points of vehicles among those that are neither ground nor building, shape (n,).

    Parameters
    ----------
    features : n points
    some : array of shape (n,)
    spacing : distance between points, in their unit
    """
    found = np.zeros(len(some), bool)
    high = some & (features.terrain[1] >= LOWEST)
    for body in bodies(features, high, spacing, ctx):
        box = shapely.minimum_rotated_rectangle(body.outline)
        oblong = body.length >= LONG * body.width and body.outline.area >= OBLONG * box.area
        no_hedge = body.length <= CAR or body.width >= WIDE
        dense = features.let_through[body.points].mean() <= GLASS
        if oblong and no_hedge and dense and body.top >= LOW_CAR:
            found[body.points] = True
    return found


def bodies(
    features: PointFeatures, some: Mask, spacing: float, ctx: Context = QUIET
) -> Iterator[Body]:
    """Bodies that are as narrow and low as vehicles, and stand free.

    Parameters
    ----------
    features : n points
    some : array of shape (n,), those of which bodies may consist
    spacing : distance between points, in their unit
    """
    xyz, height, metre = features.xyz, features.terrain[1], features.cloud.metre
    alpha = max(APART * metre, BY_SPACING * spacing)
    shapes = _outlines(xyz.compress(some, axis=0)[:, :2], alpha, ctx)
    shapes = shapes[shapely.area(shapes) >= SMALLEST * metre**2]
    shapes = shapes[~surely_wide(shapes, WIDEST * metre)]
    shapes = shapes[are_narrow(shapes, metre)]
    shapes = shapes[standing_free(shapes, xyz.compress(height < FOOT, axis=0), metre) >= FREE]
    for shape in shapes:
        inside = features.within(shape.buffer(TOUCHING * metre), some)
        away = margin(len(inside) / shape.area, alpha)
        short, long = sides(shape)
        round_about = 2 * (shapely.maximum_inscribed_circle(shape).length + away)
        width = min(round_about, short * seen_short(len(inside)))
        top = float(np.percentile(height[inside], TOP))
        if width <= WIDEST * metre + away and top <= HIGHEST:
            yield Body(shape, inside, width / metre, (long + 2 * away) / metre, top)


def as_narrow_and_low(shapes: Shapes, features: PointFeatures) -> Mask:
    """True for outlines most of which is as narrow and low as vehicles: crowns may join these."""
    narrow = _wide(shapes, features.cloud.metre) < shapely.area(shapes) / 2
    return np.asarray(narrow & are_low(shapes, features))


def are_low(shapes: Shapes, features: PointFeatures) -> Mask:
    """True for outlines in which half of the points are no higher than vehicles."""
    around = shapely.buffer(shapes, TOUCHING * features.cloud.metre)
    height = features.terrain[1]
    middle = [np.median(height[features.within(shape)]) for shape in around]
    return np.asarray(np.array(middle) <= HIGHEST)


def _wide(shapes: Any, metre: float) -> Any:
    """Area of each polygon in which a disc as wide as vehicles has room."""
    core = shapely.buffer(shapes, -WIDEST * metre / 2, join_style="mitre")
    return shapely.area(shapely.buffer(core, WIDEST * metre / 2, join_style="mitre"))


def in_rows(shapes: Shapes, seen: Floats, features: PointFeatures, spacing: float) -> Mask:
    """True for low outlines that lines of ground part into vehicles side by side, shape (m,).

    They may stand so close that no disc in which points are expected has room between. So each is
    cut into strips along and across it, half as wide as points are apart. Where most points of a
    strip are ground, it parts what lies at both sides; vehicles are what is narrow then. Directions
    are tried by as much as the ends of a side may be off, a point spacing each.

    Parameters
    ----------
    shapes : polygons, array of shape (m,)
    seen : array of shape (m,), share of ground in each (:func:`ground_seen`)
    features : n points
    spacing : distance between points, in their unit
    """
    found = seen > 0
    found[found] = are_low(shapes[found], features)
    for k in np.flatnonzero(found):
        box = np.asarray(shapely.minimum_rotated_rectangle(shapes[k]).exterior.coords)
        near = features.within(shapes[k])
        xy, ground = features.xyz[near, :2] - box[0], features.terrain[0][near]
        sides = box[[1, 3]] - box[0]
        off = np.linspace(-1, 1, TURNS) * 2 * spacing / np.hypot(*sides.T).max()
        ways = [np.arctan2(y, x) + turn for x, y in sides for turn in off]
        turned = (xy @ [[np.cos(way), -np.sin(way)], [np.sin(way), np.cos(way)]] for way in ways)
        least = LINE * features.cloud.metre
        widest = min(_widest(place, ground, spacing / 2, least) for place in turned)
        found[k] = widest <= WIDEST * features.cloud.metre
    return found


def _widest(xy: Floats, ground: Mask, strip: float, least: float) -> float:
    """Width of the widest run of strips along y that no line of ground is in.

    Most points of a line are ground, and these reach over a least length: less is seen of the
    ground below an eave.
    """
    across, along = xy.T
    number = np.floor(across / strip).astype(np.int64)
    number -= number.min()
    count = np.bincount(number)
    low, high = np.full(len(count), np.inf), np.full(len(count), -np.inf)
    np.minimum.at(low, number[ground], along[ground])
    np.maximum.at(high, number[ground], along[ground])
    lines = np.flatnonzero((2 * np.bincount(number, ground) > count) & (high - low >= least))
    return float(np.diff(np.concatenate([[-1], lines, [len(count)]])).max() - 1) * strip


def are_narrow(shapes: Shapes, metre: float) -> Mask:
    """True for outlines in which no disc as wide as vehicles has room."""
    return np.asarray(shapely.is_empty(shapely.buffer(shapes, -WIDEST * metre / 2)))


def _outlines(xy: Floats, alpha: float, ctx: Context) -> Shapes:
    """Polygons without holes around points of shape (n, 2) that are near each other."""
    try:
        return alpha_shape(xy, alpha, hole_threshold=np.inf, ctx=ctx).polygons
    except DataError:  # hardly any
        return np.empty(0, object)


def surely_wide(shapes: Shapes, width: float) -> Mask:
    """True for polygons without holes in which a disc of a width has room for certain: most woods.

    The area is less than the radius of the largest disc times the perimeter (Osserman 1979), which
    is known long before the shape is drawn in.

    >>> wide, hardly, narrow = (shapely.box(0, 0, 1000, width) for width in (2.9, 2.75, 2.6))
    >>> surely_wide(np.array([wide, hardly, narrow]), 2.65).tolist()
    [True, False, False]
    """
    return np.asarray(shapely.area(shapes) > SURE * width / 2 * shapely.length(shapes))


def sides(shape: Any) -> tuple[float, float]:
    """Shorter and longer side of the bounding rectangle of a polygon."""
    corners = np.asarray(shapely.minimum_rotated_rectangle(shape).exterior.coords)
    short, long = np.sort(np.hypot(*np.diff(corners[:3], axis=0).T))
    return float(short), float(long)


def seen_short(count: int) -> float:
    """How many times as wide as what is seen of it a straight body is, of so many points.

    The range of n places drawn evenly from a width is (n - 1) / (n + 1) of it in the mean. Many
    points of a long body say more about its width than a disc within does, of few of them.

    >>> [round(seen_short(count), 2) for count in (4, 9, 39)]
    [1.67, 1.25, 1.05]
    """
    return (count + 1) / max(count - 1, 1)


def standing_free(shapes: Shapes, low: Floats, metre: float) -> Floats:
    """Share of the sides of each polygon that have low points beside them, array of shape (m,).

    Parameters
    ----------
    shapes : polygons, array of shape (m,)
    low : points at the height of the ground, array of shape (k, 2) or (k, 3)
    metre : length of one metre in their unit
    """
    if not len(shapes) or not len(low):
        return np.zeros(len(shapes))
    reach = AROUND * metre
    around = shapely.segmentize(shapely.boundary(shapely.buffer(shapes, reach)), metre)
    places, owner = shapely.get_coordinates(around, return_index=True)
    away = _distances(places, low, reach)
    return np.asarray(np.bincount(owner, np.isfinite(away)) / np.bincount(owner))


def _distances(places: Floats, points: Floats, reach: float) -> Floats:
    """Distance in plan from places to the nearest point; infinite where none is within reach."""
    near = points[may_be_near(points, places, reach), :2]
    return np.asarray(cKDTree(near).query(places, distance_upper_bound=reach)[0])


def ground_seen(shapes: Shapes, features: PointFeatures) -> Floats:
    """Share of ground among the points well inside of outlines, array of shape (m,).

    It is 0 if there are only FEWEST points on the ground. A strip that has no inside is wires side
    by side if more than STRIP of all its points are on the ground.
    """
    metre, ground = features.cloud.metre, features.terrain[0]
    share = np.zeros(len(shapes))
    for k, core in enumerate(shapely.buffer(shapes, -EDGE * metre)):
        parts = [ground[features.within(part)] for part in shapely.get_parts(core)]
        inside = np.concatenate(parts) if parts else np.zeros(0, bool)
        if len(inside) <= FEWEST:
            of_strip = ground[features.within(shapes[k].buffer(TOUCHING * metre))].mean()
            share[k] = of_strip if of_strip > STRIP else 0.0
        elif np.count_nonzero(inside) > FEWEST:
            share[k] = inside.mean()
    return share
