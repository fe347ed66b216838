"""The land of a preset: its relief, roads, woods and houses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely

from algorithms.samples._corridor.routes import Range, Route, drawn
from algorithms.samples._corridor.site import Area, Site, Wire
from algorithms.samples._objects import SceneBuilder, Wing, building, car, crown, shrub
from algorithms.samples._survey import (
    ASPHALT,
    COLUMN,
    CONE,
    EAST,
    FOREST,
    GRASS,
    MEADOW,
    NORTH,
    ROUND,
    Floats,
    blank_terrain,
    rolling,
)

MARGIN = 15.0  # of the terrain around what is surveyed, m
ROAD = 3.0  # half width of a street, m


@dataclass(frozen=True)
class Land:
    """Relief in metres; slopes are rise over run.

    Attributes
    ----------
    hills : height of the longest waves; shorter ones are lower in proportion
    wave : length of the longest waves
    along, across : slopes of the whole land along the first leg of the route and square to it
    valley : depth of a valley square to the route, and half its width
    """

    hills: float = 4.0
    wave: float = 400.0
    along: float = 0.0
    across: float = 0.0
    valley: tuple[float, float] = (0.0, 1.0)


@dataclass(frozen=True)
class Plants:
    """Woods and what grows below the wires.

    Attributes
    ----------
    trees : per hectare, outside the belt
    tall : heights of trees, metres
    belt : cleared to both sides of each line, metres
    shrubs : per hectare, everywhere
    below : trees below the wires, per 100 m of each line
    reach : heights of these as a share of that of the wire above; above 1 they stand in the wires
    """

    trees: float = 60.0
    tall: Range = (6.0, 20.0)
    belt: float = 14.0
    shrubs: float = 20.0
    below: float = 0.0
    reach: Range = (0.6, 0.9)


@dataclass(frozen=True)
class Street:
    """Houses on both sides of a street along the route.

    Attributes
    ----------
    set_back : distance of the middle of a house from that of the street, metres
    gap : distance from house to house, metres
    storeys : how many at least and at most
    drops : share of the houses to which a wire goes from a pole
    """

    set_back: Range = (12.0, 17.0)
    gap: Range = (17.0, 26.0)
    storeys: tuple[int, int] = (1, 3)
    drops: float = 0.0


def relief(land: Land, area: Area, route: Route, rng: np.random.Generator) -> SceneBuilder:
    """An empty scene whose south-west corner is the origin.

    Parameters
    ----------
    area : what is surveyed, moved to begin at MARGIN
    """
    _, _, east, north = area.bounds
    east, north = east + MARGIN, north + MARGIN
    terrain = blank_terrain(0, 0, east, north)
    x, y = terrain.centres()
    middle = route.place(route.length / 2)
    hx, hy = route.heading(0.0)
    u = (x - middle[0]) * hx + (y - middle[1]) * hy
    v = (y - middle[1]) * hx - (x - middle[0]) * hy
    waves = [(land.hills * share, land.wave * share) for share in (1.0, 0.45, 0.18)]
    z = rolling(rng, x, y, [*waves, (0.1, 19.0)]) + land.along * u + land.across * v
    depth, half = land.valley
    z -= depth * np.exp(-((u / half) ** 2))
    z += 400.0 - float(z.min())
    terrain = replace(terrain, values=z.astype(np.float32))
    cover = np.full(z.shape, MEADOW, np.uint8)
    dry = np.full(z.shape, -np.inf, np.float32)
    taken = np.zeros((int(np.ceil(north)), int(np.ceil(east))), bool)
    return SceneBuilder(terrain, cover, dry, taken, max(east, north), rng)


# --- streets -------------------------------------------------------------------------------


def street(site: Site, town: Street) -> None:
    """Build a street along the route, its houses, and cars that are parked in it."""
    _pave(site, site.route, ROAD)
    for side in (-1, 1):
        chainage = drawn(site.rng, (5, 15))
        while chainage < site.route.length - 8:
            offset = side * drawn(site.rng, town.set_back)
            _house(site, chainage, offset, town)
            if site.rng.random() < 0.4:
                x, y = site.route.place(chainage, side * (ROAD - 1.0))
                car(site.builder, x, y, _turn(site.route, chainage))
            chainage += drawn(site.rng, town.gap)


def _pave(site: Site, route: Route, half: float) -> None:
    """Mark the ground within a distance of a route as asphalt, and its verges as grass."""
    terrain = site.builder.terrain
    x, y = (v.ravel() for v in np.broadcast_arrays(*terrain.centres()))
    for width, cover in ((half + 2.0, GRASS), (half, ASPHALT)):
        band = route.area(width)
        shapely.prepare(band)
        inside = shapely.contains_xy(band, x, y).reshape(terrain.values.shape)
        site.builder.cover[inside] = cover


def _turn(route: Route, chainage: float) -> float:
    hx, hy = route.heading(chainage)
    return float(np.arctan2(hy, hx))


def _house(site: Site, chainage: float, offset: float, town: Street) -> None:
    """A house with its gable to the street or along it, or with a flat roof."""
    rng = site.rng
    x, y = site.route.place(chainage, offset)
    turn = _turn(site.route, chainage) + float(rng.choice((0, np.pi / 2))) + rng.normal(0, 0.05)
    a, b = drawn(rng, (5.0, 8.0)), drawn(rng, (3.5, 5.0))
    slope = float(rng.choice((0.0, 0.6, 0.9), p=(0.2, 0.4, 0.4)))
    hip = 0.8 if slope and rng.random() < 0.3 else 0.0
    low, high = town.storeys
    storeys = int(rng.integers(low, high + 1))
    building(
        site.builder,
        float(x),
        float(y),
        turn,
        wings=[Wing(0, 0, a, b, slope=slope, hip=hip)],
        storeys=storeys,
    )


# --- plants --------------------------------------------------------------------------------


def grow(site: Site, plants: Plants) -> None:
    """Grow trees below the wires, then woods beside the belts, then shrubs."""
    _below_wires(site, plants)
    lines: list[shapely.Geometry] = [
        shapely.LineString(wire.points(20.0)[:, :2]) for wire in site.wires
    ]
    lines += site.clearings
    belts = shapely.union_all(lines).buffer(plants.belt) if lines else shapely.Polygon()
    shapely.prepare(belts)
    hectares = site.area.area / 1e4
    spots = _spots(site, int(plants.trees * hectares))
    wood = ~shapely.contains_xy(belts, *spots.T)
    for x, y in spots[wood]:
        _tree(site, x, y, drawn(site.rng, plants.tall))
    if plants.trees > 150:
        terrain = site.builder.terrain
        cells = (v.ravel() for v in np.broadcast_arrays(*terrain.centres()))
        shade = ~shapely.contains_xy(belts, *cells).reshape(terrain.values.shape)
        site.builder.cover[shade & (site.builder.cover == MEADOW)] = FOREST
    for x, y in _spots(site, int(plants.shrubs * hectares)):
        shrub(site.builder, x, y)


def _spots(site: Site, count: int) -> Floats:
    """Random places in the area, shape (n, 2)."""
    west, south, east, north = site.area.bounds
    share = site.area.area / ((east - west) * (north - south))
    spots = site.rng.uniform((west, south), (east, north), (int(count / share), 2))
    return np.asarray(spots[site.covers(spots)])


def _tree(site: Site, x: float, y: float, height: float) -> None:
    """A tree of random shape, if there is room for its trunk and half of its crown."""
    shape = int(site.rng.choice((ROUND, CONE, COLUMN), p=(0.5, 0.3, 0.2)))
    radius = height * drawn(site.rng, ((0.2, 0.3), (0.13, 0.19), (0.11, 0.16))[shape])
    trunk = (0.3, 0.12, 0.2)[shape] * height
    if site.builder.claim(x, y, 0.0, a=0.5 * radius, b=0.5 * radius):
        crown(site.builder, x, y, trunk=trunk, height=height, radius=radius, shape=shape)


def _below_wires(site: Site, plants: Plants) -> None:
    """Trees in the way of the wires, away from the supports."""
    spans: dict[int, list[Wire]] = {}
    for wire in site.wires:
        spans.setdefault(wire.span_id, []).append(wire)
    for wires in spans.values():
        for _ in range(site.rng.poisson(plants.below * wires[0].curve.span / 100)):
            wire = wires[int(site.rng.integers(len(wires)))]
            places = wire.points(1.0)
            x, y, z = places[int(len(places) * drawn(site.rng, (0.15, 0.85)))]
            height = (z - site.ground((x, y))) * drawn(site.rng, plants.reach)
            if 2.0 < height < 40.0 and site.covers(np.array([[x, y]]))[0]:
                _tree(site, x, y, height)


# --- wires to houses -----------------------------------------------------------------------


def drops(site: Site, share: float) -> None:
    """Hang a wire from the nearest pole to the eaves of some houses."""
    poles = [(shape, p) for shape, p in site.features if p["kind"] == "tower"]
    for shape, properties in list(site.builder.features):
        if properties["kind"] != "building" or site.rng.random() > share or not poles:
            continue
        tops = np.array([shapely.get_coordinates(pole, include_z=True)[1] for pole, _ in poles])
        tops -= (EAST, NORTH, 0.0)
        walls = shapely.transform(shape, lambda xy: xy - (EAST, NORTH))
        away = np.atleast_1d(shapely.distance(walls, shapely.points(tops[:, :2])))
        k = int(np.argmin(away))
        if not 4.0 < away[k] < 30.0:
            continue
        wall = shapely.shortest_line(walls, shapely.Point(tops[k, :2]))
        x, y = shapely.get_coordinates(wall)[0]
        end = (float(x), float(y), properties["eave_z"] - 0.3)
        start = (tops[k, 0], tops[k, 1], tops[k, 2] - drawn(site.rng, (0.3, 1.0)))
        site.drop(start, end, c=drawn(site.rng, (60, 150)), tower=poles[k][1]["tower_id"])
