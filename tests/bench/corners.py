"""Corners of outlines of buildings beside those of maps, one to one, and what parts them.

What is no error of an outline is taken apart and counted:

- the shift of the map, and how far eaves reach beyond walls, which maps show (one for each house);
- corners of houses that lean on others, which no roof shows;
- corners that are not where the points of buildings end, by the classes of the provider.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from tests.bench.measuring import DATA, say

WALL = 1.0  # metres, length of walls on both sides of a corner that is looked at
BEND = 0.2  # metres, by which a wall may bend and is one
TURN = (
    30.0  # degrees, least turn of walls at a corner: of less, nobody knows where along them it is
)
NEAR = 2.0  # metres, within which two corners may be the same
MOST, STEP = 1.5, 0.05  # metres, that a map may be off, and in which steps this is looked for
EAVES = 1.0  # metres, that roofs may reach beyond walls at most
SAME = 0.5  # share of the smaller of two buildings that both have in common if they are one
UNSEEN = 1.0  # metres from the edge of the points from which on a corner is not in them
DISC = 0.75  # metres, radius of the disc that rolls around the points of buildings
BY_SPACING = 2.0  # times the spacing of points: both where that is more
TOWNS = (5, 6, 11, 12, 15, 16, 17, 18)  # seeds; nothing was chosen on the last four
DENSITIES = (4.0, 2.0, 1.0, 0.5)  # points per m2, besides 8


def corners() -> None:
    """Corners of outlines beside those of maps and of synthetic towns."""
    for place in places():
        say(f"corners  {place.name:14} {compared(place)}")
    for density in DENSITIES:
        for seed in TOWNS:
            say(f"corners  town {seed}, {density:g} points per m2 {compared(_town(seed, density))}")


class Place(NamedTuple):
    """Points, and polygons of buildings, all of them within an area."""

    name: str
    points: Any
    shapes: Any
    area: Any


def places() -> Iterator[Place]:
    """Towns, whose truth are roofs, and surveys with maps of walls."""
    for seed in TOWNS:
        yield _town(seed, 8.0)
    yield from maps()


def maps() -> Iterator[Place]:
    """Surveys with maps of walls."""
    import csv
    import json

    import numpy as np
    import shapely

    from toolbox.data import Vector

    rural = opened("ign_buildings_bdtopo/870000_6618000_class_1_2_6.laz")
    plan = Vector.open(DATA / "ign_buildings_bdtopo/bdtopo_buildings.shp").frame.geometry
    yield Place("BD TOPO, rural", rural, shapely.force_2d(plan.to_numpy()), _box(rural))
    plan, area = (
        Vector.open(DATA / "ahn3_delft_bgt/bgt_east_cropped_2.gpkg", layer=layer).frame.geometry
        for layer in ("pand", "coverage")
    )
    delft = opened("ahn3_delft_bgt/ahn3_cropped_2.laz")
    inside = shapely.union_all(area.to_numpy()) & _box(delft)
    yield Place("BGT, Delft", delft, plan.to_numpy(), inside)
    amsterdam = opened("ahn_amsterdam/ahn3_2386_9702.laz")
    with (DATA / "ahn_amsterdam/bgt_buildings_demo_tile2386_only.csv").open() as lines:
        plan = [shapely.Polygon(json.loads(row["polygon"])) for row in csv.DictReader(lines)]
    yield Place("BGT, Amsterdam", amsterdam, np.array(plan), _box(amsterdam))


def _town(seed: int, density: float) -> Place:
    import shapely

    from algorithms.samples.scene import SamplesScene

    made = SamplesScene(kind="town", size=200.0, density=density, seed=seed).run()
    frame = made.features.frame
    shapes = shapely.force_2d(frame[frame.kind == "building"].geometry.to_numpy())
    return Place(f"town {seed}", made.points, shapes, _box(made.points))


def opened(path: str) -> Any:
    """Points, in the Dutch system if the file does not say."""
    from pyproj import CRS

    from toolbox.data import PointCloud

    cloud = PointCloud.open(DATA / path)
    return cloud if cloud.crs else cloud.with_crs(CRS(28992))


def outlined(points: Any, **settings: Any) -> Any:
    """Ground, then buildings, of points whose classes nobody knows."""
    import numpy as np

    from algorithms.classify.buildings import ClassifyBuildings
    from algorithms.ground.classify import GroundClassify

    bare = points.with_attributes({"classification": np.zeros(len(points), np.uint8)})
    return ClassifyBuildings(points=GroundClassify(points=bare).run().classified, **settings).run()


def _box(points: Any) -> Any:
    import shapely

    x0, y0, _, x1, y1, _ = points.bounds
    return shapely.box(x0, y0, x1, y1)


class Corners(NamedTuple):
    """Corners of a map beside those of outlines.

    Attributes
    ----------
    of_map, own : arrays of shape (n, 2), pairs, the map's without its shift and with eaves
    bare : array of shape (n, 2), those of the map without eaves
    edge : array of shape (n,), from them to where the points of buildings end: no outline that is
        true to the points can be nearer
    unseen, missed, extra : arrays of shape (., 2), corners of the map that the points do not have,
        other ones without a partner, and those of outlines without a partner
    inner : how many corners of single houses lean on others
    eaves : beyond walls, one for each building of the map, metres
    shift : of the map, metres
    iou : of all outlines
    """

    of_map: Any
    own: Any
    bare: Any
    edge: Any
    unseen: Any
    missed: Any
    extra: Any
    inner: int
    eaves: list[float]
    shift: Any
    iou: float


def compared(place: Place) -> str:
    """What is told of a place."""
    import numpy as np

    found = matched(place, outlined(place.points).outlines.frame.geometry.to_numpy())
    away = np.hypot(*(found.of_map - found.own).T)
    bare = np.hypot(*(found.bare - found.own).T)
    return (
        f"IoU {found.iou:.3f}, map off by {np.hypot(*found.shift):.2f} m, "
        f"eaves {np.median(found.eaves):.2f} m; {_rms(away)} pairs ({_rms(bare)} with eaves in "
        f"it; points end {_rms(found.edge)} from the map's); without partner {len(found.missed)} "
        f"of the map, {len(found.extra)} of outlines; not in the points {len(found.unseen)}, "
        f"between houses {found.inner}"
    )


def _rms(away: Any) -> str:
    import numpy as np

    if not len(away):
        return "no"
    return f"{np.sqrt(np.mean(away**2)):.2f} m RMS, {np.median(away):.2f} m median of {len(away)}"


def matched(place: Place, drawn: Any) -> Corners:
    """Corners of a map and of outlines, each with one of the other at most."""
    import numpy as np
    import shapely
    from scipy.optimize import linear_sum_assignment

    inside = place.area.buffer(-NEAR)  # what the edge of the data cuts has corners of its own
    single = shapely.make_valid(place.shapes)
    plan, own = shapely.union_all(single) & place.area, shapely.union_all(drawn) & place.area
    shift = shift_of(own, plan)
    single, plan = (shapely.transform(one, lambda xy: xy + shift) for one in (single, plan))
    houses = [house for house in shapely.get_parts(plan) if is_one(house, own)]
    eaves = [eaves_of(house, own) for house in houses]
    bare, wide, house_of = _of_houses(houses, eaves, inside)
    theirs = [_within(corners_of(one), inside) for one in shapely.get_parts(own)]
    part_of = np.repeat(np.arange(len(theirs)), [len(some) for some in theirs])
    mine = np.concatenate(theirs)
    spacing = spacing_of(place)
    edge = shapely.distance(shapely.points(wide), ends_of_points(place).boundary)
    seen = edge <= max(UNSEEN, BY_SPACING * spacing)
    away = np.hypot(*(wide[:, None] - mine[None]).transpose(2, 0, 1))
    allowed = np.array([[_shared(h, o) >= SAME for o in shapely.get_parts(own)] for h in houses])
    cost = np.where(allowed[house_of][:, part_of] & seen[:, None], away, np.inf)
    cost = np.minimum(cost, NEAR) ** 2
    i, j = linear_sum_assignment(cost)
    pairs = cost[i, j] < NEAR**2
    i, j = i[pairs], j[pairs]
    missed = seen.copy()
    missed[i] = False
    of_points = shapely.distance(shapely.points(mine), shapely.multipoints(wide[~seen])) > NEAR
    left = np.setdiff1d(np.flatnonzero(of_points), j)
    all_corners = np.concatenate([_within(corners_of(one), inside) for one in single])
    outer = shapely.distance(shapely.points(all_corners), shapely.multipoints(bare)) < BEND
    return Corners(
        *(wide[i], mine[j], bare[i], edge[i], wide[~seen], wide[missed], mine[left]),
        *(int((~outer).sum()), eaves, shift),
        own.intersection(plan).area / own.union(plan).area,
    )


def is_one(house: Any, own: Any) -> bool:
    """Whether a building of the map is among the outlines."""
    return bool((house & own).area >= SAME * house.area)


def _shared(house: Any, other: Any) -> float:
    """Share of the smaller of two buildings that both have."""
    return float((house & other).area / min(house.area, other.area))


def spacing_of(place: Place) -> float:
    """Distance between points, metres."""
    return float((_box(place.points).area / len(place.points)) ** 0.5)


def ends_of_points(place: Place) -> Any:
    """Polygons around points of buildings, by the classes that the survey came with."""
    import shapely

    from algorithms.shared.alpha_shape import alpha_shape

    xyz = place.points.xyz[place.points["classification"] == 6]
    disc = max(DISC, BY_SPACING * spacing_of(place))
    return shapely.union_all(alpha_shape(xyz[:, :2], disc).polygons)


def _of_houses(houses: list[Any], eaves: list[float], inside: Any) -> tuple[Any, Any, Any]:
    """Corners of walls, the same moved out to the eaves, and the number of the house of each."""
    import numpy as np

    bare, wide, number = [], [], []
    for k, (house, out) in enumerate(zip(houses, eaves, strict=True)):
        some, outward = _with_outward(house)
        keep = _is_within(some, inside)
        bare.append(some[keep])
        wide.append((some + out * outward)[keep])
        number.append(np.full(keep.sum(), k))
    return np.concatenate(bare), np.concatenate(wide), np.concatenate(number)


def _is_within(xy: Any, inside: Any) -> Any:
    import shapely

    return shapely.contains_xy(inside, *xy.T)


def _within(xy: Any, inside: Any) -> Any:
    return xy[_is_within(xy, inside)]


def shift_of(own: Any, plan: Any) -> Any:
    """East and north by which a plan is moved so that most of it lies on the outlines."""
    import numpy as np
    import shapely

    best = np.zeros(2)
    for step in (0.5, 0.1, STEP):
        reach = MOST if step == 0.5 else 5 * step
        steps = np.arange(-reach, reach + step / 2, step)
        tries = best + np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
        tries = tries[np.abs(tries).max(axis=1) <= MOST]
        shared = [
            shapely.intersection(own, shapely.transform(plan, lambda xy, t=t: xy + t)).area  # type: ignore[misc]
            for t in tries
        ]
        best = tries[int(np.argmax(shared))]
    return best


def eaves_of(house: Any, own: Any) -> float:
    """Distance outwards by which the walls of a house fit the outlines best."""
    import numpy as np

    beside = own & house.buffer(NEAR)
    tries = np.arange(0.0, EAVES + STEP / 2, STEP)
    wider = [house.buffer(out, join_style="mitre") for out in tries]
    return float(tries[np.argmax([(one & beside).area / (one | beside).area for one in wider])])


def corners_of(shape: Any) -> Any:
    """Corners between walls that are long enough and turn enough, array of shape (n, 2)."""
    return _with_outward(shape)[0]


def _with_outward(shape: Any) -> tuple[Any, Any]:
    """Corners, and by what each moves if all walls move out by one, two arrays of shape (n, 2)."""
    import numpy as np
    import shapely
    from shapely.geometry.polygon import orient

    found, outward = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for part in map(orient, shapely.get_parts(shape)):
        for ring in (part.exterior, *part.interiors):
            xy = shapely.get_coordinates(shapely.simplify(ring, BEND))[:-1]
            step = xy - np.roll(xy, 1, axis=0)
            length = np.hypot(*step.T)
            normal = np.column_stack([step[:, 1], -step[:, 0]]) / length[:, None]
            after = np.roll(normal, -1, axis=0)
            cosine = (normal * after).sum(axis=1)
            turns = np.abs(cosine) <= np.cos(np.radians(TURN))
            keep = (length > WALL) & (np.roll(length, -1) > WALL) & turns
            found.append(xy[keep])
            outward.append(((normal + after) / (1 + cosine)[:, None])[keep])
    return np.concatenate(found), np.concatenate(outward)
